"""Laws of films: stored energy per unit reference area as a function of the strain.

A film law is a frozen dataclass of numbers.  Its method `energy(e, c)` returns the energy per unit
reference area [J/m²] of the Green-Lagrange strain e = (E11, E22, 2 E12), as a UFL expression.  The
argument `c` has the numbers of the law as UFL constants, so that a changed number does not compile
new code.  UFL derives the stress and the tangent.

The principal strains γ1 ≥ γ2 are h + r and h - r, with centre h and radius r of Mohr's circle.
Where they coincide r has a kink, but trace and determinant of the strain are smooth; so energies
are written by trace and determinant as far as possible.
"""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, fields
from numbers import Real
from types import SimpleNamespace
from typing import Annotated, Any

import ufl
from dolfinx.mesh import Mesh
from mpi4py import MPI

from gossamer_fx.core.checks.arguments import Range, check_arguments, positive
from gossamer_fx.core.checks.errors import check, require_positive
from gossamer_fx.core.forms.bending import BendingStiffness, IsotropicBending
from gossamer_fx.core.forms.compilation import constant
from gossamer_fx.core.forms.kinematics import Expr, half_trace_and_radius
from gossamer_fx.core.forms.strain_path import Piece, energy_gradient, mean_gradient, within_cone
from gossamer_fx.core.model.terms import Parameter


@dataclass(frozen=True, eq=False)
class CLaw:
    """Addresses of the C functions of a law, with the signature that FFCx gives to expressions.

    At p points of a cell they take the strains e0 and e1 (p, m) at the start and at the end of a
    step and k `numbers` of the law (p, k), and as their only constant p.

    Attributes:
        path_average: address of the mean stress along the path from e0 to e1, with its derivative
            by e1 (p, m + m²).
        end_point: address of the stress at e1, with its derivative (p, m + m²).
        density: address of the energy density at e0 (p,).
        numbers: expression (k,) of the numbers of the law, which may differ from point to point.
        owner: what has to exist as long as the functions are called.
    """

    path_average: int
    end_point: int
    density: int
    numbers: Expr
    owner: object


Modulus = Annotated[float, positive("Pa")]
PoissonsRatio = Annotated[float, Range(-1.0, 0.5, above=True)]
# Compressive over tensile stiffness
StiffnessRatio = Annotated[float, Range(0.0, 1.0)]

# Values of `FilmLaw.state`.
SLACK = 0
WRINKLED = 1
TAUT = 2

# Compressive strains smaller than this are round-off and count as taut.  Otherwise the state of an
# unstrained film would be random, and with it a tangent that no multigrid method can precondition.
# The stress jumps by 1e-12 E at most.
ROUND_OFF = 1e-12


def constants(law: Any, mesh: Mesh) -> SimpleNamespace:
    """The numbers of a law, a dataclass, as UFL constants on a mesh under the same names."""
    result = SimpleNamespace()
    for field in fields(law):
        value = getattr(law, field.name)
        # Directions of axes are not numbers; bodies add them, see `bodies.properties`.
        if isinstance(value, Real):
            setattr(result, field.name, constant(mesh, float(value)))
    return result


# SI units of the numbers of laws, by name; numbers of other names are taken for pure numbers.
# Squares of the ratios of thickness and area, below which a shown stress counts them as this: no
# film is so thin, but the moduli of small strain allow it.
SMALLEST_THICKNESS_SQUARE = 1e-4
SMALLEST_AREA_SQUARE = 1e-8

UNITS = {
    "E": "Pa",
    "E1": "Pa",
    "E2": "Pa",
    "G12": "Pa",
    "shear_modulus": "Pa",
    "C1": "Pa",
    "warp": "N/m",
    "weft": "N/m",
    "shear": "N/m",
    "C2": "Pa",
    "density": "kg/m³",
    "thickness": "m",
    "EA": "N",
    "line_density": "kg/m",
}


def parameters(law: Any, coefficients: SimpleNamespace) -> tuple[Parameter, ...]:
    """The numbers of a law as parameters of its terms, by which results can be derived.

    A law with numbers that are derived from others has none but its density: the forms do not show
    how the derived ones change.  Tables of a law do not count as parameters.
    """
    has_derived = any(not field.init for field in fields(law))
    return tuple(
        Parameter(field.name, UNITS.get(field.name, ""), getattr(coefficients, field.name))
        for field in fields(law)
        if hasattr(coefficients, field.name) and (not has_derived or field.name == "density")
    )


def area_ratio(e: Expr) -> Expr:
    """Present area over the one of which e = (E11, E22, 2 E12) is the strain."""
    tr, det = invariants(e)
    return ufl.sqrt(ufl.max_value(1 + 2 * tr + 4 * det, SMALLEST_AREA_SQUARE))


@dataclass(frozen=True, kw_only=True)
class FilmLaw:
    """Base of all laws of films; a law of your own defines `energy`.

    In its methods e is a strain (E11, E22, 2 E12) in the frame of the film, and c has the numbers
    of the law as UFL constants.

    Attributes:
        density: mass density [kg/m³].
        thickness: thickness [m].
        quadratic: whether the energy is quadratic in the strain.  The stress at the middle of a
            path is then its average.
        resists_loss_of_area: whether the energy of film without area is infinite, so that no cell
            can turn over.  Steps in which one has turned over are refused.
    """

    density: Annotated[float, positive("kg/m³")]
    thickness: Annotated[float, positive("m")]

    quadratic = False
    resists_loss_of_area = False

    def __post_init__(self) -> None:
        # Of laws of your own, too, which need not check their arguments.
        require_positive(f"{type(self).__name__}: density", self.density, "kg/m³")
        require_positive(f"{type(self).__name__}: thickness", self.thickness, "m")

    def constants(self, mesh: Mesh) -> SimpleNamespace:
        """The numbers of the law as coefficients of forms on a mesh, by their names."""
        return constants(self, mesh)

    def energy(self, e: Expr, c: Any) -> Expr:
        """Stored energy per unit reference area [J/m²] of the strain e."""
        raise TypeError(f"{type(self).__name__} has no energy")

    def pieces(self, e0: Expr, e1: Expr, c: Any) -> list[Piece]:
        """Pieces of the straight path from strain e0 to e1 on which the energy is smooth.

        An empty list means that the pieces are not known; the path is then integrated by Gauss
        points. See `gossamer_fx.core.forms.strain_path`.
        """
        return []

    def state(self, e: Expr, c: Any) -> Expr:
        """State of the film at a strain e: 0 slack, 1 wrinkled, 2 taut, as a UFL expression."""
        return ufl.as_ufl(TAUT)

    def c_law(self, c: Any, comm: MPI.Intracomm) -> CLaw | None:
        """The C functions of a law that UFL cannot write as one expression; None of all others.
        Collective."""
        return None

    def unwrinkled(self) -> FilmLaw:
        """The law of this film without wrinkles, for energies that are quadratic in the strain."""
        raise TypeError(f"{type(self).__name__} has no law without wrinkles")

    def taut_strain(self, S: Expr, c: Any) -> Expr:
        """The strain e at which taut film has the stress S = (S11, S22, S12) [N/m]."""
        raise TypeError(f"{type(self).__name__} has no strain of a given stress")

    def volume_ratio(self, e: Expr, c: Any) -> Expr:
        """Present volume of the material over that of the mesh, at the strain e of its surface
        without wrinkles: by default its thickness stays."""
        return area_ratio(e)

    def bending_stiffness(self, c: Any) -> BendingStiffness:
        """The bending stiffness of a plate of this material, uniform across its thickness."""
        raise TypeError(f"{type(self).__name__} has no bending stiffness")

    @property
    def has_wrinkle_maps(self) -> bool:
        """Whether the law gives the taut strain and the bending stiffness, which maps of wrinkles
        need."""
        law = type(self)
        has_strain = law.taut_strain is not FilmLaw.taut_strain
        return has_strain and law.bending_stiffness is not FilmLaw.bending_stiffness


@dataclass(frozen=True)
class IsotropicFilm(FilmLaw):
    """Base of laws with a Young's modulus and a Poisson's ratio.

    Attributes:
        E: Young's modulus [Pa].
        nu: Poisson's ratio.
    """

    E: Modulus
    nu: PoissonsRatio

    def taut_strain(self, S: Expr, c: Any) -> Expr:
        stiffness = c.E * c.thickness
        return ufl.as_vector(
            [
                (S[0] - c.nu * S[1]) / stiffness,
                (S[1] - c.nu * S[0]) / stiffness,
                2 * (1 + c.nu) * S[2] / stiffness,
            ]
        )

    def volume_ratio(self, e: Expr, c: Any) -> Expr:
        # No stress across the film: E33 = -ν/(1 - ν) (E11 + E22)
        across = 1 - 2 * c.nu / (1 - c.nu) * (e[0] + e[1])
        return area_ratio(e) * ufl.sqrt(ufl.max_value(across, SMALLEST_THICKNESS_SQUARE))

    def bending_stiffness(self, c: Any) -> BendingStiffness:
        return IsotropicBending(c.E * c.thickness**3 / (12 * (1 - c.nu**2)), c.nu)

    def unwrinkled(self) -> FilmLaw:
        return Linear(self.E, self.nu, density=self.density, thickness=self.thickness)


@check_arguments
@dataclass(frozen=True)
class Linear(IsotropicFilm):
    """St. Venant-Kirchhoff film that never wrinkles.

        W = E t/(2(1-ν²)) [tr² - 2(1-ν) det]   with the Green-Lagrange strain of the surface

    Args:
        E: Young's modulus [Pa], positive.
        nu: Poisson's ratio, above -1 and at most 0.5.
        density: mass density ρ [kg/m³], positive.
        thickness: t [m], positive.

    Raises:
        InputError: a number out of its range.

    Example:
        >>> gx.Linear(70e9, 0.3, density=2700.0, thickness=1e-3).thickness
        0.001
    """

    quadratic = True

    def energy(self, e: Expr, c: Any) -> Expr:
        return _taut(e, c)


@check_arguments
@dataclass(frozen=True)
class Miyazaki(IsotropicFilm):
    """Film with reduced compressive stiffness, which stands for wrinkles that are not resolved.

    With f1 = γ2 + ν γ1, f2 = γ1 + u ν γ2 and the stiffness ratio u = `residual_stiffness` in [0,
    1]:

        taut      f1 ≥ 0        W = E t/(2(1-ν²))    [tr² - 2(1-ν) det]
        wrinkled  f1 < 0 < f2   W = E t/(2(1-uν²))   [γ1² + 2uν γ1γ2 + u γ2²]
        slack     f2 ≤ 0        W = E t u/(2(1-u²ν²)) [tr² - 2(1-uν) det]

    which is the elastic matrix Γ(k1, k2) with (1, 1), (1, u), (u, u): a C1, convex potential.  The
    pair (u, 1) that is printed for the wrinkled state elsewhere softens the *tension* direction and
    makes the stress jump at f1 = 0; two different ratios for wrinkled and slack would break either
    continuity or isotropy, so there is one.

    Args:
        E, nu, density, thickness: as of `Linear`.
        residual_stiffness: u, compressive over tensile stiffness, between 0 and 1.

    Raises:
        InputError: a number out of its range.

    Example:
        >>> law = gx.Miyazaki(2.5e9, 0.34, density=1420.0, thickness=25e-6, residual_stiffness=1e-4)
        >>> gx.Membrane(mesh, law).law.residual_stiffness
        0.0001

    Source: Y. Miyazaki, Wrinkle/slack model and finite element dynamics of membrane, IJNME 66
        (2006) 1179, eqs. 13-20.
    """

    _: KW_ONLY
    residual_stiffness: StiffnessRatio = 1e-6

    def energy(self, e: Expr, c: Any) -> Expr:
        return self._by_state(e, c, _taut(e, c), self._wrinkled(e, c), self._slack(e, c))

    def pieces(self, e0: Expr, e1: Expr, c: Any) -> list[Piece]:
        """Five pieces, of which any may be empty: taut, slack, and three that are wrinkled.

        Taut strains, f1 ≥ 0, are the cone h ≥ (1-ν)/(1+ν) r; slack strains, f2 ≤ 0, the cone -h ≥
        (1-uν)/(1+uν) r, with centre h and radius r of Mohr's circle.
        """
        ν = c.nu
        uν = c.residual_stiffness * c.nu
        taut = within_cone(e0, e1, (1 - ν) / (1 + ν), ROUND_OFF / (1 + ν))
        slack = within_cone(-e0, -e1, (1 - uν) / (1 + uν), 0.0)

        # Of the two intervals: where the first begins and ends, and where the last begins and ends.
        first_start = ufl.min_value(taut[0], slack[0])
        last_start = ufl.max_value(taut[0], slack[0])
        first_end = ufl.min_value(taut[1], slack[1])
        last_end = ufl.max_value(taut[1], slack[1])
        wrinkled = [
            (0.0, first_start),
            (first_end, ufl.max_value(first_end, last_start)),
            (last_end, 1.0),
        ]

        def taut_stress(a: Expr, b: Expr) -> Expr:
            return energy_gradient(lambda e: _taut(e, c), (a + b) / 2)

        def slack_stress(a: Expr, b: Expr) -> Expr:
            return energy_gradient(lambda e: self._slack(e, c), (a + b) / 2)

        def wrinkled_stress(a: Expr, b: Expr) -> Expr:
            return self._wrinkled_stress(a, b, c)

        return [
            Piece(*taut, taut_stress, TAUT),
            Piece(*slack, slack_stress, SLACK),
            *(Piece(*interval, wrinkled_stress, WRINKLED) for interval in wrinkled),
        ]

    def _wrinkled_stress(self, ea: Expr, eb: Expr, c: Any) -> Expr:
        """Stress (3,) [N/m] of the wrinkled state, averaged along the path from ea to eb.

        With γ1 = h + r the energy is quadratic except for a multiple of h r, with centre h and
        radius r of Mohr's circle.
        """
        ν = c.nu
        u = c.residual_stiffness
        factor = c.E * c.thickness / (1 - u * ν**2)

        def quadratic(e: Expr) -> Expr:
            tr, det = invariants(e)
            return factor / 2 * ((1 - u) * (tr**2 / 2 - det) + u * (tr**2 - 2 * (1 - ν) * det))

        of_quadratic = energy_gradient(quadratic, (ea + eb) / 2)
        return of_quadratic + factor * (1 - u) * mean_gradient(ea, eb)

    def _wrinkled(self, e: Expr, c: Any) -> Expr:
        """Energy [J/m²] of the wrinkled state."""
        h, r = half_trace_and_radius(e)
        tr, det = invariants(e)
        ν = c.nu
        u = c.residual_stiffness
        factor = c.E * c.thickness / (2 * (1 - u * ν**2))
        return factor * ((1 - u) * (h + r) ** 2 + u * (tr**2 - 2 * (1 - ν) * det))

    def _slack(self, e: Expr, c: Any) -> Expr:
        """Energy [J/m²] of the slack state."""
        tr, det = invariants(e)
        ν = c.nu
        u = c.residual_stiffness
        factor = c.E * c.thickness * u / (2 * (1 - (u * ν) ** 2))
        return factor * (tr**2 - 2 * (1 - u * ν) * det)

    def state(self, e: Expr, c: Any) -> Expr:
        return self._by_state(e, c, TAUT, WRINKLED, SLACK)

    def _by_state(self, e: Expr, c: Any, taut: Expr, wrinkled: Expr, slack: Expr) -> Expr:
        """One of three expressions, by the state of the film at the strain e: taut if f1 ≥ 0, to
        round-off, otherwise wrinkled if f2 > 0."""
        h, r = half_trace_and_radius(e)
        γ1 = h + r
        γ2 = h - r
        f1 = γ2 + c.nu * γ1
        f2 = γ1 + c.residual_stiffness * c.nu * γ2
        not_taut = ufl.conditional(ufl.gt(f2, 0), wrinkled, slack)
        return ufl.conditional(ufl.ge(f1, -ROUND_OFF), taut, not_taut)


@check_arguments
@dataclass(frozen=True)
class TensionField(Miyazaki):
    """Tension field: the limit u → 0 of `Miyazaki`, film that resists no compression.

    Slack film has no stiffness at all, so a static problem may be singular; in dynamics the inertia
    carries it.

    Args:
        E, nu, density, thickness: as of `Linear`.
        residual_stiffness: zero; another value is refused.

    Raises:
        InputError: a number out of its range.

    Example:
        >>> gx.TensionField(2.5e9, 0.34, density=1420.0, thickness=25e-6).residual_stiffness
        0.0

    Source: A. C. Pipkin, The relaxed energy density for isotropic elastic membranes, IMA J. Appl.
        Math. 36 (1986) 85.
    """

    _: KW_ONLY
    residual_stiffness: StiffnessRatio = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check(
            self.residual_stiffness == 0,
            "TensionField has no residual stiffness; use Miyazaki for one.",
        )


def _taut(e: Expr, c: Any) -> Expr:
    """Energy [J/m²] of taut isotropic film at the strain e."""
    tr, det = invariants(e)
    return c.E * c.thickness / (2 * (1 - c.nu**2)) * (tr**2 - 2 * (1 - c.nu) * det)


def invariants(e: Expr) -> tuple[Expr, Expr]:
    """Trace and determinant of a strain (E11, E22, 2 E12)."""
    trace = e[0] + e[1]
    determinant = e[0] * e[1] - e[2] ** 2 / 4
    return trace, determinant
