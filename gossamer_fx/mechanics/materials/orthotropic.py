"""Laws of orthotropic films: woven, braided and laminated.

Problem.  Film bears no compression: it wrinkles across the direction of its tension.  In isotropic
film this is the direction of the largest strain; in orthotropic film it is not.

Idea.  Wrinkles are extra strain A ≥ 0 (as a matrix) that the film takes without stress.  The film
takes as much of it as makes its energy least.  The strain is e = (E11, E22, 2 E12) in the axes of
the film, C e its taut stress, and F the inverse of C.  The relaxed energy

    W(e) = min over A ≥ 0 of ½ (e + A):C:(e + A) = max over S ≥ 0 of S:e - ½ S:F:S               (1)

is convex and has a continuous stress for every positive definite C.  Along t, with the strain
e_tt = t·e t and the compliance F_tt, its stress is

    taut      S = C e                      where C e ≥ 0 (as a matrix)
    slack     S = 0                        where e ≤ 0
    wrinkled  S = (e_tt/F_tt) t⊗t          elsewhere; t maximises e_tt²/F_tt, e_tt > 0           (2)

Algorithm, for the stress of a strain.

1. Find the state by the two inequalities of (2).
2. In wrinkled film, find the angle of t as the root of

       φ = e_tn F_tt - e_tt F_tn,    n across t,                                                 (3)

   in the interval around the direction of the largest strain where e_tt > 0.
3. Check that the strain of the wrinkles A = F S - e is ≥ 0.  If it is not, e_tt²/F_tt has two
   maxima, as happens where the shear stiffness is far above that of the axes.  Then find the larger
   maximum on a grid of `GRID_DIRECTIONS` directions, and improve it by Newton's method.

Algorithm, for the average stress of a step along a straight path of strain.

4. Taut and slack strains are cones; cut the path where it enters and leaves them, at roots of
   quadratics.  Their stress is linear, so that their average is the stress at the middle.
5. Integrate the wrinkled pieces by Gauss points.

The C functions of `materials.kernels` do this in the iterations of a step.  `Orthotropic.energy` is
the same energy in UFL, for fields that are drawn and for user's forms.

Cost.  Some iterations on one angle for each wrinkled Gauss point; the grid is used at few points.

Limits.  The average of a wrinkled piece is not exact, so that a correction along the change of
strain closes the energy (`terms.discrete_gradient`).  Wrinkles have no bending stiffness and no
wave length.

Source of equation (1): A. C. Pipkin, IMA J. Appl. Math. 36 (1986) 85, doi:10.1093/imamat/36.1.85.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated, Any, Self

import numpy as np
import ufl
from mpi4py import MPI
from ufl.variable import Variable

from gossamer_fx.core.checks.arguments import NOT_ZERO, Count, check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.forms.bending import BendingStiffness, OrthotropicBending
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.materials.film import (
    ROUND_OFF,
    SLACK,
    TAUT,
    WRINKLED,
    CLaw,
    FilmLaw,
    Modulus,
    StiffnessRatio,
)

NotZero = Annotated[Sequence[float], Count(3), NOT_ZERO]
Direction = NotZero | Mapping[str, NotZero] | Callable[[Array], Array]

# The C functions of these laws.
HEADER = Path(__file__).parent / "kernels" / "orthotropic.h"

# In UFL: directions of the grid on which the largest maximum is looked for, and bracketed steps of
# Newton from there.  The peaks of e_tt²/F_tt are wider than 5 degrees for stiffnesses of condition
# 300.
GRID_DIRECTIONS = 36
NEWTON_STEPS = 8


@check_arguments
@dataclass(frozen=True)
class AroundAxis:
    """Directions around an axis: (x - point) turned by a right angle, for the hoops of a tube.

    It is a function of points, as `direction` of `Orthotropic` takes.

    Args:
        axis: vector (3,) along the axis.
        point: a point (3,) [m] of the axis.

    Raises:
        InputError: the axis is zero.

    Example:
        >>> hoops = gx.materials.AroundAxis((0, 0, 1))
        >>> hoops(np.array([[2.0], [0.0], [5.0]])).ravel().tolist()
        [0.0, 2.0, 0.0]
    """

    axis: NotZero
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __call__(self, points: Array) -> Array:
        """The directions (3, n) at points (3, n)."""
        arms = points - np.array(self.point, dtype=float)[:, None]
        return np.cross(np.array(self.axis, dtype=float), arms.T).T


@check_arguments
@dataclass(frozen=True)
class LinearOrthotropic(FilmLaw):
    """Orthotropic St. Venant-Kirchhoff film that never wrinkles.

        W = t/2 [E1 e1² + 2 ν12 E2 e1 e2 + E2 e2²]/(1 - ν12 ν21) + t/2 G12 e12²,   ν21 = ν12 E2/E1

    with the Green-Lagrange strain (e1, e2, e12 = 2 E12) along the axes of the film.

    Args:
        E1: Young's modulus [Pa] along the first axis, positive.
        E2: Young's modulus [Pa] along the second axis, positive.
        nu12: ratio of the contraction along the second axis to the extension along the first, if
            pulled along the first; nu12² < E1/E2.
        G12: shear modulus [Pa], positive.
        density: mass density ρ [kg/m³], positive.
        thickness: t [m], positive.
        direction: of the first axis: a vector (3,), which is projected on the film; or {group:
            vector} of all surfaces of the mesh; or a function of points (3, n) that returns vectors
            (3, n), for instance `AroundAxis`.  Along a tube: its axis.

    Raises:
        InputError: a number out of its range; stiffnesses that are not positive definite.

    Example:
        >>> law = gx.LinearOrthotropic(
        ...     10e9, 1e9, 0.3, 0.5e9, density=1400.0, thickness=1e-4, direction=(1, 0, 0)
        ... )
        >>> round(law.nu21, 12)
        0.03
    """

    E1: Modulus
    E2: Modulus
    nu12: float
    G12: Modulus
    _: KW_ONLY
    direction: Direction

    quadratic = True

    def __post_init__(self) -> None:
        super().__post_init__()
        check(
            self.nu12**2 < self.E1 / self.E2,
            f"{type(self).__name__}: nu12 is {self.nu12!r}, "
            "so that the stiffness is not positive definite; "
            f"give less than √(E1/E2) = {math.sqrt(self.E1 / self.E2):.6g} in size.",
        )

    @classmethod
    @check_arguments
    def from_stiffnesses(
        cls,
        A11: float,
        A12: float,
        A22: float,
        A66: float,
        *,
        thickness: float,
        density: float,
        direction: Direction,
        **further: Any,
    ) -> Self:
        """The law of given stiffnesses per width, as tests of fabrics and braids give them.

            N1 = A11 e1 + A12 e2,    N2 = A12 e1 + A22 e2,    N12 = A66 · 2 E12

        Args:
            A11, A12, A22, A66: stiffnesses [N/m].
            thickness: t [m], which together with the density gives the mass.
            density: ρ [kg/m³].
            direction: of the first axis.
            further: other arguments of the law.

        Raises:
            InputError: stiffnesses that are not positive definite.

        Example:
            >>> law = gx.Orthotropic.from_stiffnesses(
            ...     336e3, 704e3, 1526e3, 703e3, thickness=4e-4, density=1400.0, direction=(1, 0, 0)
            ... )
            >>> round(law.nu12, 6)
            0.461337
        """
        determinant = A11 * A22 - A12**2
        check(
            A11 > 0 and A22 > 0 and A66 > 0 and determinant > 0,
            f"{cls.__name__}: the stiffnesses A11 = {A11!r}, "
            f"A12 = {A12!r}, A22 = {A22!r}, A66 = {A66!r} N/m are not positive definite; "
            "give A11, A22, A66 > 0 and A12² < A11 A22.",
        )
        return cls(
            determinant / A22 / thickness,
            determinant / A11 / thickness,
            A12 / A22,
            A66 / thickness,
            density=density,
            thickness=thickness,
            direction=direction,
            **further,
        )

    @property
    def nu21(self) -> float:
        """ν21 = ν12 E2/E1, the contraction along the first axis if pulled along the second."""
        return self.nu12 * self.E2 / self.E1

    def energy(self, e: Expr, c: Any) -> Expr:
        e = in_axes(e, c)
        return ufl.dot(_taut_stress(e, c), e) / 2

    def taut_strain(self, S: Expr, c: Any) -> Expr:
        """The strain at which taut film has the stress S = (S11, S22, S12) [N/m], by the compliance
        in the axes of the law."""
        # `in_axes` takes twice the shear, as strains have it.
        stress = in_axes(ufl.as_vector([S[0], S[1], 2 * S[2]]), c)
        F11 = 1 / (c.E1 * c.thickness)
        F22 = 1 / (c.E2 * c.thickness)
        F12 = -c.nu12 * F11
        F66 = 1 / (c.G12 * c.thickness)
        strain = ufl.as_vector(
            [
                F11 * stress[0] + F12 * stress[1],
                F12 * stress[0] + F22 * stress[1],
                F66 * stress[2] / 2,
            ]
        )
        return _out_of_axes(strain, c)

    def bending_stiffness(self, c: Any) -> BendingStiffness:
        D11, D12, D22, D66 = (stiffness * c.thickness**2 / 12 for stiffness in _stiffnesses(c))
        return OrthotropicBending(D11, D12, D22, D66, c.cosine, c.sine)

    def unwrinkled(self) -> FilmLaw:
        return self


@check_arguments
@dataclass(frozen=True)
class Orthotropic(LinearOrthotropic):
    """Orthotropic film that bears no compression: woven, braided or laminated.

    Its stress is the taut stress, reduced to tension by the wrinkles: (1) and (2) of the module.
    With a residual stiffness u the energy is (1 - u) times the relaxed one and u times that of
    `LinearOrthotropic`.

    Args:
        E1, E2, nu12, G12, density, thickness, direction: as of `LinearOrthotropic`.
        residual_stiffness: u, between 0 and 1.

    Raises:
        InputError: a number out of its range; stiffnesses that are not positive definite.

    Example:
        >>> fabric = gx.Orthotropic(
        ...     10e9, 1e9, 0.3, 0.5e9, density=1400.0, thickness=1e-4, direction=(1, 0, 0)
        ... )
        >>> gx.Membrane(mesh, fabric).law.residual_stiffness
        0.0

    Source: A. C. Pipkin, The relaxed energy density for isotropic elastic membranes, IMA J. Appl.
        Math. 36 (1986) 85; its equation (1) holds for any stiffness.
    """

    _: KW_ONLY
    residual_stiffness: StiffnessRatio = 0.0

    quadratic = False

    def energy(self, e: Expr, c: Any) -> Expr:
        """W, with the direction of tension t from a grid of directions and bracketed steps of
        Newton; one further step carries its derivative."""
        frozen = _without_variables(e)
        e = in_axes(e, c)
        taut = ufl.dot(_taut_stress(e, c), e) / 2
        t = _tension_direction(in_axes(frozen, c), c)
        # One more step, of which UFL takes derivatives: that of a converged iteration, dt/de.
        _, is_maximum, step = _newton_step(e, t, c)
        t = _turned(t, ufl.conditional(is_maximum, step, 0.0))
        wrinkled = _strain_along(e, t)[0] ** 2 / (2 * _compliance_along(t, c)[0])
        relaxed = _by_state(in_axes(frozen, c), c, taut, wrinkled, 0.0)
        u = c.residual_stiffness
        return (1 - u) * relaxed + u * taut

    def state(self, e: Expr, c: Any) -> Expr:
        return _by_state(in_axes(e, c), c, TAUT, WRINKLED, SLACK)

    def c_law(self, c: Any, comm: MPI.Intracomm) -> CLaw:
        """The C functions of this law, compiled by rank 0 or loaded; without a C compiler
        `InputError`. Collective."""
        from gossamer_fx.core.forms.c_source import c_library

        compiled = c_library(HEADER, comm)
        C11, C12, C22, C66 = _stiffnesses(c)
        address = compiled.lib.orthotropic_function
        return CLaw(
            path_average=address(compiled.lib.PATH_AVERAGE),
            end_point=address(compiled.lib.END_POINT),
            density=address(compiled.lib.DENSITY),
            numbers=ufl.as_vector([c.cosine, c.sine, C11, C12, C22, C66, c.residual_stiffness]),
            owner=compiled,
        )

    def unwrinkled(self) -> FilmLaw:
        return LinearOrthotropic(
            self.E1,
            self.E2,
            self.nu12,
            self.G12,
            density=self.density,
            thickness=self.thickness,
            direction=self.direction,
        )


def in_axes(e: Expr, c: Any) -> Expr:
    """A strain (E11, E22, 2 E12) of the film's frame in the axes of an orthotropic law, of which c
    has cosine and sine; of a stress give twice the shear."""
    # Squares and product of cosine and sine
    c2 = c.cosine**2
    s2 = c.sine**2
    cs = c.cosine * c.sine
    return ufl.as_vector(
        [
            c2 * e[0] + s2 * e[1] + cs * e[2],
            s2 * e[0] + c2 * e[1] - cs * e[2],
            2 * cs * (e[1] - e[0]) + (c2 - s2) * e[2],
        ]
    )


def _out_of_axes(e: Expr, c: Any) -> Expr:
    """A strain (E11, E22, 2 E12) in the axes of an orthotropic law in the film's frame."""
    backwards = SimpleNamespace(cosine=c.cosine, sine=-c.sine)
    return in_axes(e, backwards)


def _stiffnesses(c: Any) -> tuple[Expr, Expr, Expr, Expr]:
    """C11, C12, C22, C66 [N/m] of the numbers of a law."""
    nu21 = c.nu12 * c.E2 / c.E1
    factor = c.thickness / (1 - c.nu12 * nu21)
    return factor * c.E1, factor * c.nu12 * c.E2, factor * c.E2, c.thickness * c.G12


def _taut_stress(e: Expr, c: Any) -> Expr:
    """C e (3,) [N/m] of a strain in the axes."""
    C11, C12, C22, C66 = _stiffnesses(c)
    return ufl.as_vector([C11 * e[0] + C12 * e[1], C12 * e[0] + C22 * e[1], C66 * e[2]])


def _by_state(e: Expr, c: Any, taut: Expr, wrinkled: Expr, slack: Expr) -> Expr:
    """Choose one of three expressions by the state of the film at the strain e, in its axes: taut
    where trace and determinant of the taut stress are not negative, to round-off."""
    S = _taut_stress(e, c)
    C11, _, C22, _ = _stiffnesses(c)
    margin = ROUND_OFF * ufl.max_value(C11, C22)
    S1 = S[0] + margin
    S2 = S[1] + margin
    is_taut = ufl.And(ufl.ge(S1 + S2, 0), ufl.ge(S1 * S2, S[2] ** 2))
    is_slack = ufl.And(ufl.le(e[0] + e[1], 0), ufl.ge(e[0] * e[1], e[2] ** 2 / 4))
    not_taut = ufl.conditional(is_slack, slack, wrinkled)
    return ufl.conditional(is_taut, taut, not_taut)


def _without_variables(e: Expr) -> Expr:
    """The strain without its label as a variable of UFL, so that UFL does not derive an iteration
    that uses it."""
    while isinstance(e, Variable):
        e = e.expression()
    return e


def _strain_along(e: Expr, t: tuple[Expr, Expr]) -> tuple[Expr, Expr, Expr]:
    """Strain e_tt along a direction t, and its first and second derivatives by the angle of t.  e
    is in the axes of the law."""
    c, s = t
    double_sine = 2 * c * s
    double_cosine = c**2 - s**2
    difference = e[1] - e[0]
    value = c**2 * e[0] + s**2 * e[1] + c * s * e[2]
    first = double_sine * difference + double_cosine * e[2]
    second = 2 * (double_cosine * difference - double_sine * e[2])
    return value, first, second


def _compliance_along(t: tuple[Expr, Expr], c: Any) -> tuple[Expr, Expr, Expr]:
    """Compliance F_tt [m/N] along a direction t, the strain along t of a unit stress t⊗t, and its
    two derivatives by the angle of t."""
    F11 = 1 / (c.E1 * c.thickness)
    F22 = 1 / (c.E2 * c.thickness)
    K = 1 / (c.G12 * c.thickness) - 2 * c.nu12 * F11
    c2 = t[0] ** 2
    s2 = t[1] ** 2
    double_sine = 2 * t[0] * t[1]
    double_cosine = c2 - s2
    slope = -2 * F11 * c2 + 2 * F22 * s2 + K * double_cosine
    value = F11 * c2**2 + F22 * s2**2 + K * c2 * s2
    second = 2 * double_cosine * slope + 2 * double_sine**2 * (F11 + F22 - K)
    return value, double_sine * slope, second


def _newton_step(e: Expr, t: tuple[Expr, Expr], c: Any) -> tuple[Expr, Expr, Expr]:
    """φ of equation (3), whether its slope is that of a maximum of e_tt²/F_tt, and the step of the
    angle of t towards it."""
    strain = _strain_along(e, t)
    F = _compliance_along(t, c)
    φ = strain[1] * F[0] - strain[0] * F[1] / 2
    slope = strain[2] * F[0] + strain[1] * F[1] / 2 - strain[0] * F[2] / 2
    is_maximum = ufl.lt(slope, 0)
    return φ, is_maximum, -φ / ufl.conditional(is_maximum, slope, -1.0)


def _turned(t: tuple[Expr, Expr], step: Expr) -> tuple[Expr, Expr]:
    """The direction t turned by atan(step)."""
    x = t[0] - step * t[1]
    y = t[1] + step * t[0]
    length = ufl.sqrt(x**2 + y**2)
    return x / length, y / length


def _tension_direction(e: Expr, c: Any) -> tuple[Expr, Expr]:
    """The direction t (cosine and sine) of tension of wrinkled film, which maximises e_tt²/F_tt,
    for a strain e in the axes of the law and without variables of UFL.

    The angle is found about the best one of a grid, by bracketed steps of Newton on φ, equation (3)
    of the module.  t is without meaning if no direction has tension.
    """
    largest = ufl.as_ufl(0.0)
    cosine = ufl.as_ufl(1.0)
    sine = ufl.as_ufl(0.0)
    for k in range(GRID_DIRECTIONS):
        angle = math.pi * k / GRID_DIRECTIONS
        t = (ufl.as_ufl(math.cos(angle)), ufl.as_ufl(math.sin(angle)))
        tension = ufl.max_value(_strain_along(e, t)[0], 0)
        energy = tension**2 / _compliance_along(t, c)[0]
        is_larger = ufl.gt(energy, largest)
        largest = ufl.conditional(is_larger, energy, largest)
        cosine = ufl.conditional(is_larger, t[0], cosine)
        sine = ufl.conditional(is_larger, t[1], sine)
    # Tangents of the angles from the grid's direction, between which the maximum is
    middle = (cosine, sine)
    low: Expr = ufl.as_ufl(-math.tan(math.pi / GRID_DIRECTIONS))
    high: Expr = ufl.as_ufl(math.tan(math.pi / GRID_DIRECTIONS))
    offset: Expr = ufl.as_ufl(0.0)
    for _ in range(NEWTON_STEPS):
        t = _turned(middle, offset)
        φ, is_maximum, step = _newton_step(e, t, c)
        rises = ufl.gt(φ, 0)
        low = ufl.conditional(rises, offset, low)
        high = ufl.conditional(rises, high, offset)
        # The derivative of the tangent by the angle is 1 + tangent².
        following = offset + step * (1 + offset**2)
        is_inside = ufl.And(ufl.ge(following, low), ufl.le(following, high))
        follows = ufl.And(is_maximum, is_inside)
        offset = ufl.conditional(follows, following, (low + high) / 2)
    return _turned(middle, offset)
