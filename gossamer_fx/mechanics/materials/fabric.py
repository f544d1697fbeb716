"""A law of woven fabrics from measured curves of warp, weft and shear.

Problem.  A fabric is tested along its warp, along its weft, and in shear.  Each test gives a curve
of tension over strain, which bends as the yarns straighten.  A strip that is pulled along one yarn
contracts along the other one, as crimp goes from one to the other.  Yarns bear no compression.

Idea.  With the strains e1 = E11, e2 = E22 and γ = 2 E12 in the axes of the yarns,

    W = Q(e1, e2) + R1(e1) + R2(e2) + Φ12(γ) + residual stiffness.                               (1)

Q is the energy of a linear film with the first slopes K1, K2 of both curves and the contraction
ν12, relaxed: a yarn that would be pressed is slack, and takes the strain without stress.  With k1 =
K1/(1 - ν12 ν21), k2 alike, ν21 = ν12 K2/K1 and u1 = e1 + ν21 e2, u2 = e2 + ν12 e1,

    both taut     u1, u2 ≥ 0       Q = ½ (k1 e1² + 2 ν12 k2 e1 e2 + k2 e2²)
    weft slack    e1 ≥ 0 ≥ u2      Q = ½ K1 e1²                                                  (2)
    warp slack    e2 ≥ 0 ≥ u1      Q = ½ K2 e2²
    both slack    e1, e2 ≤ 0       Q = 0

R1 and R2 are what the curves have beyond their first slopes, sums of ½ c ⟨e - e_k⟩² over the
corners.  A strip that is pulled along a yarn, its sides free, has the measured curve exactly at the
measured points: in (1) they stand as (E, S) = (x + ½x², N/(1 + x)) of an engineering strain x and a
tension N, and the law is linear in between.

The stress is piecewise linear, so that its average along the straight path of a step is a sum of
few terms: the path meets each of the four cones (2) in one interval, and corners as in
`bodies.tabulated_cable`.  (1) is convex unless slopes fall so far that the product of both is at
most (ν12 k2)², which is checked.

Limits.  Loading and unloading follow the same curve; friction between yarns is that of
`loads.InternalFriction`.  Contraction is that of small strain.  The axes turn with the film and
stay orthogonal in (1): large shear angles, as in draping, are not followed.

Source: laws of the same kind are LAW58 of Radioss and MAT_FABRIC, form 14, of LS-DYNA, by their
published manuals; the relaxation is that of `orthotropic` in fixed axes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh as DolfinxMesh
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.algorithms.apply_derivatives import apply_derivatives

from gossamer_fx.core.checks.arguments import Curve, check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.forms.strain_path import Piece, energy_gradient, mean_of_positive_part
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.materials.film import (
    ROUND_OFF,
    SLACK,
    TAUT,
    WRINKLED,
    FilmLaw,
    StiffnessRatio,
)
from gossamer_fx.mechanics.materials.orthotropic import Direction, in_axes

# Strains or angles, and tensions [N/m] there.

CURVES = ("warp", "weft", "shear")


@check_arguments
@dataclass(frozen=True, kw_only=True)
class Fabric(FilmLaw):
    """A woven fabric, by the measured curves of its warp, its weft and its shear.

    The curves are piecewise linear between their points, and go on with their last slope.  Warp and
    weft bear no compression; shear is the same in both senses.

    Args:
        warp: two columns: engineering strains of a strip that is pulled along the warp, its sides
            free, from zero on, rising; and its tensions [N/m] per stress-free width, from zero on,
            not falling.
        weft: the same along the weft.
        shear: two columns: shears γ = 2 E12 [rad] from zero on, and shear forces [N/m].
        contraction: ν12, the contraction along the weft over the extension along the warp of the
            first of these strips at small strain.
        residual_stiffness: stiffness of slack yarns over that of their first slope.
        density: [kg/m³], thickness: [m]: together the mass; stresses are tensions over thickness.
        direction: of the warp: a vector (3,), {group: vector}, or a function of points.

    Raises:
        InputError: curves that do not begin at zero, do not rise, or fall; a contraction with which
            the energy is not convex.

    Example:
        >>> law = gx.materials.Fabric(
        ...     warp=([0.0, 0.01, 0.03], [0.0, 2e3, 20e3]),
        ...     weft=([0.0, 0.03], [0.0, 15e3]),
        ...     shear=([0.0, 0.1], [0.0, 500.0]),
        ...     density=800.0,
        ...     thickness=3e-4,
        ...     direction=(1, 0, 0),
        ... )
        >>> [round(tension) for tension in law.tensions(0.03, 0.0, 0.05)]
        [20000, 0, 250]
    """

    warp: Curve
    weft: Curve
    shear: Curve
    contraction: float = 0.0
    residual_stiffness: StiffnessRatio = 1e-6
    direction: Direction

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in CURVES:
            columns = [np.asarray(column, dtype=float) for column in getattr(self, name)]
            _check_curve(name, *columns)
            object.__setattr__(self, name, tuple(tuple(column.tolist()) for column in columns))
        # Of each yarn the first slope, and the least change of it.
        first, least = zip(*(self._slope_range(name) for name in CURVES[:2]), strict=True)
        ratio = self.contraction**2 * first[1] / first[0]
        check(
            ratio < 1,
            f"Fabric: contraction is {self.contraction!r}; give less than √(warp/weft) = "
            f"{np.sqrt(first[0] / first[1]):.4g} of the first slopes in size.",
        )
        stiff = [slope / (1 - ratio) + change for slope, change in zip(first, least, strict=True)]
        check(
            stiff[0] > 0 and stiff[0] * stiff[1] > (self.contraction * first[1] / (1 - ratio)) ** 2,
            f"Fabric: with a contraction of {self.contraction!r} the energy is not convex where a "
            "curve is flattest; give a smaller contraction, or curves that flatten less.",
        )

    def _slope_range(self, name: str) -> tuple[float, float]:
        """First slope [N/m] of a curve over the Green-Lagrange strain, and the least slope less
        it."""
        strains, stresses = _green(name, *getattr(self, name))
        slopes = np.diff(stresses) / np.diff(strains)
        return float(slopes[0]), float(slopes.min() - slopes[0])

    def constants(self, mesh: DolfinxMesh) -> SimpleNamespace:
        """The points as constants of a mesh: another fabric with as many points compiles nothing,
        and results have derivatives by the tensions of the points."""
        found = super().constants(mesh)
        for name, values in self._points().items():
            setattr(found, name, fem.Constant(mesh, np.array(values)))
        return found

    def _points(self) -> dict[str, Any]:
        """Strains and tensions of the points of all curves, as `constants` names them."""
        found: dict[str, Any] = {}
        for name in CURVES:
            found[f"{name}_strains"], found[name] = getattr(self, name)
        return found

    # ---- curves ----------------------------------------------------------------------------------

    def _corners(self, name: str, c: Any) -> tuple[list[Expr], list[Expr]]:
        """Strains [-] at which the slope of a curve changes, and its changes [N/m]: the first one
        is the first slope, at zero strain."""
        count = len(getattr(self, name)[0])
        given = [getattr(c, f"{name}_strains")[k] for k in range(count)]
        tensions = [getattr(c, name)[k] for k in range(count)]
        strains, stresses = _green(name, given, tensions)
        slopes = [
            (stresses[k + 1] - stresses[k]) / (strains[k + 1] - strains[k])
            for k in range(count - 1)
        ]
        changes = [slopes[0], *(slopes[k] - slopes[k - 1] for k in range(1, count - 1))]
        return strains[:-1], changes

    def _beyond(self, name: str, c: Any, term: Callable[[Expr], Expr], first: int) -> Expr:
        """Σ c_k term(e_k) over the corners from the number `first` on."""
        strains, changes = self._corners(name, c)
        total = ufl.as_ufl(0.0)
        for strain, change in list(zip(strains, changes, strict=True))[first:]:
            total += change * term(strain)
        return total

    def _linear(self, c: Any) -> SimpleNamespace:
        """K1, K2 and k1, k2, ν12, ν21 of (2)."""
        K1 = self._corners("warp", c)[1][0]
        K2 = self._corners("weft", c)[1][0]
        ν12 = c.contraction
        ν21 = ν12 * K2 / K1
        return SimpleNamespace(
            K1=K1, K2=K2, k1=K1 / (1 - ν12 * ν21), k2=K2 / (1 - ν12 * ν21), ν12=ν12, ν21=ν21
        )

    # ---- the law ---------------------------------------------------------------------------------

    def energy(self, e: Expr, c: Any) -> Expr:
        return self._energy_in_axes(in_axes(e, c), c)

    def _energy_in_axes(self, e: Expr, c: Any) -> Expr:
        """Equation (1) of the module, of a strain in the axes of the yarns."""
        m = self._linear(c)
        taut = (m.k1 * e[0] ** 2 + 2 * m.ν12 * m.k2 * e[0] * e[1] + m.k2 * e[1] ** 2) / 2
        total = self._by_state(e, m, taut, m.K1 * e[0] ** 2 / 2, m.K2 * e[1] ** 2 / 2, 0.0)
        for k, name in enumerate(CURVES[:2]):
            total += self._beyond(name, c, _half_square(e[k]), 1)
        for side in (e[2], -e[2]):
            total += self._beyond("shear", c, _half_square(side), 0)
        return total + c.residual_stiffness * (m.K1 * e[0] ** 2 + m.K2 * e[1] ** 2) / 2

    def _by_state(self, e: Expr, m: Any, taut: Any, warp: Any, weft: Any, slack: Any) -> Expr:
        """A value by the state of a strain in the axes: both yarns taut, the warp alone, the weft
        alone, none."""
        u1 = e[0] + m.ν21 * e[1]
        u2 = e[1] + m.ν12 * e[0]
        alone = ufl.conditional(
            ufl.gt(e[0], 0.0), warp, ufl.conditional(ufl.gt(e[1], 0.0), weft, slack)
        )
        # Strains of round-off are those of an unstrained film, which is taut.
        both = ufl.And(ufl.ge(u1, -ROUND_OFF), ufl.ge(u2, -ROUND_OFF))
        return ufl.conditional(both, taut, alone)

    def pieces(self, e0: Expr, e1: Expr, c: Any) -> list[Piece]:
        """The four cones (2), each met in one interval; in each the stress is linear but for
        corners."""
        m = self._linear(c)
        start = in_axes(e0, c)
        end = in_axes(e1, c)
        # Values at both ends of the path of what has a sign in each cone, and the margin by which
        # strains of round-off count as those of an unstrained film, which is taut.
        along = {
            "e1": (start[0], end[0]),
            "e2": (start[1], end[1]),
            "u1": (start[0] + m.ν21 * start[1], end[0] + m.ν21 * end[1]),
            "u2": (start[1] + m.ν12 * start[0], end[1] + m.ν12 * end[0]),
        }
        margin = {"e1": 0.0, "e2": 0.0, "u1": ROUND_OFF, "u2": ROUND_OFF}

        def interval(*signs: tuple[str, float]) -> tuple[Expr, Expr]:
            """Where all of these have their signs."""
            first = ufl.as_ufl(0.0)
            last = ufl.as_ufl(1.0)
            for name, sign in signs:
                a, b = (sign * (value + margin[name]) for value in along[name])
                begin, cease = _positive_interval(a, b)
                first = ufl.max_value(first, begin)
                last = ufl.min_value(last, cease)
            return first, ufl.max_value(first, last)

        def stress(of_Q: Callable[[Expr], tuple[Any, Any]]) -> Callable[[Expr, Expr], Expr]:
            def mean(ea: Expr, eb: Expr) -> Expr:
                a = in_axes(ea, c)
                b = in_axes(eb, c)
                parts = zip((*of_Q((a + b) / 2), 0.0), self._rest(a, b, m, c), strict=True)
                return self._out_of_axes([linear + rest for linear, rest in parts], c)

            return mean

        def taut(e: Expr) -> tuple[Expr, Expr]:
            return m.k1 * e[0] + m.ν12 * m.k2 * e[1], m.k2 * (e[1] + m.ν12 * e[0])

        def warp(e: Expr) -> tuple[Expr, float]:
            return m.K1 * e[0], 0.0

        def weft(e: Expr) -> tuple[float, Expr]:
            return 0.0, m.K2 * e[1]

        def slack(e: Expr) -> tuple[float, float]:
            return 0.0, 0.0

        return [
            Piece(*interval(("u1", 1.0), ("u2", 1.0)), stress(taut), TAUT),
            Piece(*interval(("e1", 1.0), ("u2", -1.0)), stress(warp), WRINKLED),
            Piece(*interval(("e2", 1.0), ("u1", -1.0)), stress(weft), WRINKLED),
            Piece(*interval(("e1", -1.0), ("e2", -1.0)), stress(slack), SLACK),
        ]

    def _rest(self, a: Expr, b: Expr, m: Any, c: Any) -> list[Expr]:
        """Stress (3,) [N/m] of all of (1) but Q, averaged from the strain a to b in the axes."""
        found = []

        def mean(ya: Expr, yb: Expr) -> Callable[[Expr], Expr]:
            return lambda at: mean_of_positive_part(ya - at, yb - at)

        for k, (name, K) in enumerate(zip(CURVES[:2], (m.K1, m.K2), strict=True)):
            beyond = self._beyond(name, c, mean(a[k], b[k]), 1)
            found.append(beyond + c.residual_stiffness * K * (a[k] + b[k]) / 2)
        sides = [self._beyond("shear", c, mean(s * a[2], s * b[2]), 0) for s in (1.0, -1.0)]
        return [*found, sides[0] - sides[1]]

    def _out_of_axes(self, stress: Sequence[Expr], c: Any) -> Expr:
        """A stress (3,) in the axes of the yarns as one in the frame of the film: the strain in the
        axes is linear in that of the frame, and this is its transpose."""
        rows = [in_axes(ufl.unit_vector(k, 3), c) for k in range(3)]
        return ufl.as_vector([sum(row[m] * stress[m] for m in range(3)) for row in rows])

    def state(self, e: Expr, c: Any) -> Expr:
        """Taut where both yarns are, slack where neither is, wrinkled where one is slack."""
        m = self._linear(c)
        wrinkled = float(WRINKLED)
        return self._by_state(in_axes(e, c), m, float(TAUT), wrinkled, wrinkled, float(SLACK))

    def unwrinkled(self) -> FirstStiffness:
        """The film with the stiffnesses at zero strain, without slack yarns."""
        return FirstStiffness(density=self.density, thickness=self.thickness, fabric=self)

    def first_energy(self, e: Expr, c: Any) -> Expr:
        """Energy [J/m²] of a strain in the frame with the stiffnesses at zero strain."""
        e = in_axes(e, c)
        m = self._linear(c)
        G = self._corners("shear", c)[1][0]
        quadratic = m.k1 * e[0] ** 2 + 2 * m.ν12 * m.k2 * e[0] * e[1] + m.k2 * e[1] ** 2
        return (quadratic + G * e[2] ** 2) / 2

    @check_arguments
    def tensions(self, warp: float, weft: float, shear: float) -> tuple[float, float, float]:
        """Tensions of warp and weft per stress-free width [N/m], and the shear force [N/m].

        Args:
            warp, weft: engineering strains, above -1.
            shear: γ = 2 E12 [rad].
        """
        strains = ufl.as_vector([warp + warp**2 / 2, weft + weft**2 / 2, shear])
        c = SimpleNamespace(
            contraction=self.contraction,
            residual_stiffness=self.residual_stiffness,
            **self._points(),
        )
        slopes = energy_gradient(partial(self._energy_in_axes, c=c), strains)
        S = apply_derivatives(apply_algebra_lowering(slopes))
        N1, N2, in_shear = (float(S[k](())) for k in range(3))
        return N1 * (1 + warp), N2 * (1 + weft), in_shear


@dataclass(frozen=True, kw_only=True)
class FirstStiffness(FilmLaw):
    """A film with the stiffnesses of a fabric at zero strain, by which damping acts; its constants
    are those of the fabric."""

    fabric: Fabric

    quadratic = True

    def energy(self, e: Expr, c: Any) -> Expr:
        return self.fabric.first_energy(e, c)


def _positive_interval(a: Expr, b: Expr) -> tuple[Expr, Expr]:
    """Where on [0, 1] a number is positive that goes linearly from a to b; (0, 0) if nowhere."""
    passes = ufl.lt(a * b, 0.0)
    root = a / ufl.conditional(passes, a - b, 1.0)
    is_never = ufl.And(ufl.le(a, 0.0), ufl.le(b, 0.0))
    begin = ufl.conditional(ufl.lt(a, 0.0), root, 0.0)
    cease = ufl.conditional(ufl.lt(a, 0.0), 1.0, root)
    whole = ufl.conditional(is_never, 0.0, 1.0)
    return ufl.conditional(passes, begin, 0.0), ufl.conditional(passes, cease, whole)


def _half_square(y: Expr) -> Callable[[Expr], Expr]:
    """½ ⟨y - corner⟩² as a function of a corner."""
    return lambda corner: ufl.max_value(y - corner, 0.0) ** 2 / 2


def _green(name: str, strains: Any, tensions: Any) -> tuple[Any, Any]:
    """Points of a curve as Green-Lagrange strains and stresses along them; those of shear as they
    are.  Columns of numbers or of expressions."""
    if name == "shear":
        return list(strains), list(tensions)
    pairs = list(zip(strains, tensions, strict=True))
    return [x + x**2 / 2 for x, _ in pairs], [N / (1 + x) for x, N in pairs]


def _check_curve(name: str, strains: Array, tensions: Array) -> None:
    """Raise `InputError` unless the columns (n,) are those of a curve."""
    check(
        strains[0] == 0 and tensions[0] == 0,
        f"Fabric: {name} begins at ({strains[0]:g}, {tensions[0]:g}); begin at zero strain and "
        "zero tension.",
    )
    check(
        bool(tensions[1] > 0),
        f"Fabric: the tensions of {name} are zero at the second point; give some that rise from "
        "zero on.",
    )
