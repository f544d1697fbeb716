"""Films of rubber: incompressible laws of finite strain, in plane stress.

Problem.  The moduli of `film` hold for small strains.  A rubber balloon doubles its radius; its
pressure rises to a maximum on the way, and falls beyond it.

Idea.  A film is free to become thinner, so that the stress across it vanishes.  With the
right Cauchy-Green tensor C = I + 2E of the surface, an incompressible film has the square of its
third stretch λ3² = 1/det C, and the invariants

    I1 = tr C + 1/det C,    I2 = det C + tr C/det C                                              (1)

    neo-Hooke        W = μ t/2 (I1 - 3)                                                          (2)
    Mooney-Rivlin    W = t [C1 (I1 - 3) + C2 (I2 - 3)],    μ = 2 (C1 + C2)                       (3)

with the thickness t of the stress-free film.  Both are functions of trace and determinant of E
alone, and are written such that no digits are lost where the strain is small.

Wrinkles.  A film in uniaxial tension along the largest stretch λ1 contracts freely across it, to
λ2 = 1/√λ1.  Where it is narrower it has wrinkled, and where λ1 < 1 it is slack:

    taut       λ2 ≥ 1/√λ1    (2)
    wrinkled   otherwise     W = μ t/2 (λ1² + 2/λ1 - 3)
    slack      λ1 ≤ 1        W = 0

In the strain, (2) is convex: tr C is linear, and 1/det C is convex since log det C is concave.  The
relaxed energy is the smallest W(E + A) with A ≥ 0, thus convex as well, and so is each average
over a step.  (3) is not: det C is a saddle, and the sum loses its convexity at some equibiaxial
stretch, 1.39 for C2 = 0.1 C1.  Mooney-Rivlin film therefore has no wrinkled state; it resists
compression.

Algorithm.  The mean stress of a step is taken by Gauss points, and what they miss of the work is
added (`terms.discrete_gradient`): for a film that stays taut this is round-off.  Pieces of the
path by state were tried on a free sheet of 16 × 16 and 40 × 40 cells that goes slack: Newton's
iterations were the same within 2 %.

Sources: L. R. G. Treloar, The physics of rubber elasticity, Oxford 1975; wrinkled states, A. C.
Pipkin, The relaxed energy density for isotropic elastic membranes, IMA J. Appl. Math. 36 (1986) 85.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Any

import ufl

from gossamer_fx.core.checks.arguments import check_arguments, not_negative, positive
from gossamer_fx.core.forms.kinematics import Expr, half_trace_and_radius
from gossamer_fx.mechanics.materials.film import (
    ROUND_OFF,
    SLACK,
    TAUT,
    WRINKLED,
    FilmLaw,
    StiffnessRatio,
    invariants,
)

ShearModulus = Annotated[float, positive("Pa")]

# The determinant of C of an iterate below which 1/det C goes on as a straight line: there is no
# film of a smaller area, but Newton's iteration may ask for one.
SMALLEST_DETERMINANT = 1e-2


@check_arguments
@dataclass(frozen=True)
class NeoHooke(FilmLaw):
    """Incompressible neo-Hookean film of finite strain, which wrinkles and goes slack.

    Args:
        shear_modulus: μ [Pa], positive; a third of Young's modulus of small strain.
        density: mass density ρ [kg/m³], positive.
        thickness: t [m] of the stress-free film, positive.
        residual_stiffness: share, between 0 and 1, of the stiffness of small strain that also
            resists compression, so that slack film has a stiffness at all.  At an equibiaxial
            stretch λ it adds about 3 (λ² - 1) times this share to the stress.

    Raises:
        InputError: a number out of its range.

    Example:
        >>> rubber = gx.materials.NeoHooke(4e5, density=950.0, thickness=1e-3)
        >>> gx.Membrane(mesh, rubber).law.shear_modulus
        400000.0
    """

    shear_modulus: ShearModulus
    _: KW_ONLY
    residual_stiffness: StiffnessRatio = 1e-6

    def energy(self, e: Expr, c: Any) -> Expr:
        h, r = half_trace_and_radius(e)
        γ1 = h + r
        # λ1² + 2/λ1 - 3 = (λ1 - 1)² (λ1 + 2)/λ1, with λ1 - 1 from 2 γ1 = λ1² - 1
        λ1 = ufl.sqrt(1 + 2 * ufl.max_value(γ1, 0.0))
        pulled = 4 * γ1**2 * (λ1 + 2) / (λ1 * (λ1 + 1) ** 2)
        relaxed = self._by_state(e, _first_invariant(e), pulled, 0.0)
        u = c.residual_stiffness
        taut_or_relaxed = c.shear_modulus * c.thickness / 2 * (1 - u) * relaxed
        return taut_or_relaxed + u * _small_strain_energy(e, c.shear_modulus, c)

    def unwrinkled(self) -> FilmLaw:
        return _SmallStrain(
            lambda c: c.shear_modulus, density=self.density, thickness=self.thickness
        )

    def state(self, e: Expr, c: Any) -> Expr:
        return self._by_state(e, TAUT, WRINKLED, SLACK)

    def taut_strain(self, S: Expr, c: Any) -> Expr:
        # S = μ t (I - C⁻¹/det C), thus A = I - S/(μ t) = C⁻¹/det C and det A = (det C)⁻³
        μt = c.shear_modulus * c.thickness
        A11 = 1 - S[0] / μt
        A22 = 1 - S[1] / μt
        A12 = -S[2] / μt
        # C = A⁻¹/det C
        factor = (A11 * A22 - A12**2) ** (-2 / 3)
        return ufl.as_vector([(factor * A22 - 1) / 2, (factor * A11 - 1) / 2, -factor * A12])

    def volume_ratio(self, e: Expr, c: Any) -> Expr:
        return ufl.as_ufl(1.0)

    def _by_state(self, e: Expr, taut: Expr, wrinkled: Expr, slack: Expr) -> Expr:
        """One of three expressions, by the state of the film at the strain e."""
        h, r = half_trace_and_radius(e)
        γ1 = h + r
        γ2 = h - r
        # λ1² λ2⁴ - 1, without the difference of large numbers
        above = 2 * γ1 + (1 + 2 * γ1) * 4 * γ2 * (1 + γ2)
        is_taut = ufl.And(ufl.ge(above, -ROUND_OFF), ufl.ge(γ1, -ROUND_OFF))
        not_taut = ufl.conditional(ufl.gt(γ1, 0), wrinkled, slack)
        return ufl.conditional(is_taut, taut, not_taut)


@check_arguments
@dataclass(frozen=True)
class MooneyRivlin(FilmLaw):
    """Incompressible Mooney-Rivlin film of finite strain.  It does not wrinkle, as its relaxed
    energy is not convex; its shear modulus of small strain is 2 (C1 + C2).

    Args:
        C1: half the modulus of the first invariant [Pa], positive.
        C2: half the modulus of the second invariant [Pa], not negative.
        density: mass density ρ [kg/m³], positive.
        thickness: t [m] of the stress-free film, positive.

    Raises:
        InputError: a number out of its range.

    Example:
        >>> rubber = gx.materials.MooneyRivlin(2e5, 2e4, density=950.0, thickness=1e-3)
        >>> gx.Membrane(mesh, rubber).law.C2
        20000.0
    """

    C1: ShearModulus
    C2: Annotated[float, not_negative("Pa")]

    resists_loss_of_area = True

    def energy(self, e: Expr, c: Any) -> Expr:
        return c.thickness * (c.C1 * _first_invariant(e) + c.C2 * _second_invariant(e))

    def volume_ratio(self, e: Expr, c: Any) -> Expr:
        return ufl.as_ufl(1.0)

    def unwrinkled(self) -> FilmLaw:
        return _SmallStrain(
            lambda c: 2 * (c.C1 + c.C2), density=self.density, thickness=self.thickness
        )


@dataclass(frozen=True)
class _SmallStrain(FilmLaw):
    """Rubber at small strain, from the constants of its law, of which `shear_modulus` is a
    function; damping is a multiple of its energy."""

    shear_modulus: Callable[[Any], Expr]

    quadratic = True

    def energy(self, e: Expr, c: Any) -> Expr:
        return _small_strain_energy(e, self.shear_modulus(c), c)


def _small_strain_energy(e: Expr, shear_modulus: Expr, c: Any) -> Expr:
    """The energy per area [J/m²] of small strain: that of `Linear` with E = 3 μ and ν = 1/2."""
    tr, det = invariants(e)
    return 2 * shear_modulus * c.thickness * (tr**2 - det)


def _first_invariant(e: Expr) -> Expr:
    """I1 - 3 of the strain e, (1) of the module, as one fraction with the denominator det C: parts
    of first order in e cancel, and are left out."""
    tr, det = invariants(e)
    inverse, _ = _inverse_determinant(e)
    return (4 * tr**2 - 4 * det + 8 * tr * det) * inverse


def _second_invariant(e: Expr) -> Expr:
    """I2 - 3 of the strain e, as one fraction in the same way as `_first_invariant`."""
    _, det = invariants(e)
    inverse, change = _inverse_determinant(e)
    return (change**2 - 4 * det) * inverse


def _inverse_determinant(e: Expr) -> tuple[Expr, Expr]:
    """1/det C and det C - 1 of the strain e; below `SMALLEST_DETERMINANT` the first one goes on as
    its tangent."""
    tr, det = invariants(e)
    change = 2 * tr + 4 * det
    J0 = SMALLEST_DETERMINANT
    J = 1 + change
    inside = 1 / ufl.max_value(J, J0)
    return ufl.conditional(ufl.gt(J, J0), inside, (2 - J / J0) / J0), change
