"""How surfaces reflect, absorb and radiate sunlight; forces of light and of rarefied air on a face.

The argument `maths` of the formulas is `Symbolic` for films, whose forces are compiled by UFL, and
`Arrays` for the flat faces of rigid bodies, which are NumPy arrays.
"""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Any

import numpy as np
import ufl
from scipy import special

from gossamer_fx.core.checks.arguments import Direction, Mark
from gossamer_fx.extend import (
    Array,
    Expr,
    Range,
    Vector,
    check,
    check_arguments,
    not_negative,
    positive,
)

PRESSURE = 4.563e-6  # N/m² at 1 AU (1368 W/m²; McInnes 1999)

Share = Annotated[float, Range(0.0, 1.0)]
ONE_SIDED = Mark(lambda optics: optics.other_side is None, "the optics of one side of a film")


@check_arguments
@dataclass(frozen=True)
class Optics:
    """Optical properties of a surface, for the pressure of light.

    Light of pressure P comes along u, at an angle α to the normal n of the side away from it.  The
    force per area on the lit side is

        f/P = cos α {[2 r s cos α + B (1-s) r + (1-r) (ε B - ε' B')/(ε + ε')] n + (1 - r s) u}

    with ε', B' of the other side.  Absorbed light is radiated at once (C. R. McInnes, Solar
    Sailing, 1999, section 2.6, also for the coefficients `JPL_SAIL`).

    Args:
        reflectivity: r, fraction of the light that is reflected, 0 to 1.
        specular: s, fraction of the reflected light that is mirrored; the remainder is scattered.
        emissivity: ε.
        lambertian: B, 2/3 for an ideal scatterer.
        other_side: optics of the back; None: as the front.

    Raises:
        InputError: a value is out of its range.

    Example:
        >>> sail = gx.orbit.Optics(0.88, 0.94, emissivity=0.05, lambertian=0.79)
        >>> sail.reflectivity
        0.88
    """

    reflectivity: Share = 1.0
    specular: Share = 1.0
    _: KW_ONLY
    emissivity: Share = 0.05
    lambertian: Share = 2 / 3
    other_side: Annotated[Optics, ONE_SIDED] | None = None

    def __post_init__(self) -> None:
        back = self.other_side
        check(
            self.emissivity + (back or self).emissivity > 0 or self.reflectivity == 1,
            "Optics: a surface that absorbs must radiate; give a positive emissivity.",
        )

    @property
    def sides(self) -> tuple[Optics, Optics]:
        """Front and back."""
        return self, self.other_side or self

    @check_arguments
    def coefficients(self, back: bool = False) -> tuple[float, float, float]:
        """Coefficients (2rs, B(1-s)r + (1-r)(εB - ε'B')/(ε + ε'), 1 - rs) of the force of light on
        a surface whose front, or back, is lit:

            f/P = cos α {[c_0 cos α + c_1] n + c_2 u}

        with ε', B' of the dark side, see the class.
        """
        lit, dark = self.sides[::-1] if back else self.sides
        r = lit.reflectivity
        s = lit.specular
        total_emissivity = lit.emissivity + dark.emissivity
        # The recoil of the heat that both sides radiate; it is the difference of the sides.
        radiated = lit.emissivity * lit.lambertian - dark.emissivity * dark.lambertian
        thermal = 0.0
        # Zero emissivity is allowed for a surface that absorbs nothing.
        if total_emissivity:
            thermal = (1 - r) * radiated / total_emissivity
        return 2 * r * s, lit.lambertian * (1 - s) * r + thermal, 1 - r * s


# The default of `SolarPressure` and `Surface`: an ideal mirror on both sides.
MIRROR = Optics()
# Aluminium on the front, chromium, which radiates more heat, on the back.
JPL_SAIL = Optics(
    0.88,
    0.94,
    emissivity=0.05,
    lambertian=0.79,
    other_side=Optics(0.88, 0.94, emissivity=0.55, lambertian=0.55),
)


# Boltzmann's constant [J/K].
BOLTZMANN = 1.380649e-23

# Mass of an atom of oxygen [kg], the most frequent particle between 200 and 600 km.
ATOM = 16 * 1.66053906660e-27


@check_arguments
@dataclass(frozen=True)
class Air:
    """State of the atmosphere at a point.

    Args:
        density: [kg/m³].
        temperature: [K].
        molecule: mean mass of a molecule [kg]; default: atomic oxygen, the main component between
            200 and 600 km.

    Example:
        >>> gx.orbit.Air(1e-11, 1100.0).temperature
        1100.0
    """

    density: Annotated[float, not_negative("kg/m³")]
    temperature: Annotated[float, positive("K")] = 1000.0
    _: KW_ONLY
    molecule: Annotated[float, positive("kg")] = ATOM

    @property
    def thermal_speed(self) -> float:
        """√(2kT/m) [m/s]."""
        return float(np.sqrt(2 * BOLTZMANN * self.temperature / self.molecule))


@check_arguments
@dataclass(frozen=True)
class Accommodation:
    """Exchange of momentum between molecules and a surface.

    Args:
        normal: σ_n, accommodated fraction of the normal momentum, 0 to 1.
        tangential: σ_t, accommodated fraction of the tangential momentum, 0 to 1.  With σ_n = σ_t =
            1 all molecules leave diffusely at the temperature of the wall, with 0 they are
            mirrored.
        wall_temperature: [K].

    Raises:
        InputError: a value is out of its range.

    Example:
        >>> gx.orbit.Accommodation(0.9, 0.95, wall_temperature=350.0).normal
        0.9
    """

    normal: Share = 1.0
    tangential: Share = 1.0
    _: KW_ONLY
    wall_temperature: Annotated[float, positive("K")] = 300.0


def flow_coefficients(c: Any, s: Any, σn: Any, σt: Any, wall: Any, maths: Any) -> tuple[Any, Any]:
    """(A, B): the flow of mass density ρ and velocity U exerts per area ½ρU² (A n + B u) on one
    side.

    n points into the surface, u = U/|U|, c = n·u (negative on the lee), which is cos θ of the angle
    θ between n and u, s = |U|/√(2kT/m), wall = √(T_w/T) of wall and air.  With x = s c, the
    pressure and shear coefficients of Schaaf & Chambre are

        c_p s² = [(2-σ_n) x/√π + σ_n wall/2] exp(-x²)
                 + [(2-σ_n)(x² + ½) + σ_n √π wall x/2] (1 + erf x)
        c_τ s  = σ_t sin θ [exp(-x²)/√π + x (1 + erf x)]

    and A = c_p - c c_τ/sin θ, B = c_τ/sin θ.  σn and σt are the accommodations of the normal and
    the tangential momentum, 0 to 1.  All quantities are dimensionless: UFL scalars, or arrays that
    broadcast with each other and may be complex; `maths` has the functions `exp` and `erf`.  For a
    face at rest in the air, s = 0, the result is not finite.

    Source: Schaaf & Chambre, Flow of Rarefied Gases (1961), section H.
    """
    x = s * c
    root = float(np.sqrt(np.pi))
    bell = maths.exp(-x * x)
    step = 1 + maths.erf(x)
    pressure = ((2 - σn) * x / root + σn * wall / 2) * bell
    pressure += ((2 - σn) * (x * x + 0.5) + σn * root * wall * x / 2) * step
    shear = σt * (bell / root + x * step) / s
    # Both are divided by powers of s: the formulas do not hold for a face at rest in the air.
    return pressure / s**2 - c * shear, shear


class Symbolic:
    """Operations on UFL vectors."""

    dot = ufl.dot
    root = ufl.sqrt
    exp = ufl.exp
    erf = ufl.erf

    @staticmethod
    def choose(where_positive: Expr, a: Expr, b: Expr) -> Expr:
        """`a` where the first argument is positive, otherwise `b`."""
        return ufl.conditional(ufl.gt(where_positive, 0.0), a, b)


class Arrays:
    """Operations on arrays, vectors (..., 3) and numbers (..., 1), complex for derivatives by
    complex steps."""

    root = np.sqrt
    exp = np.exp
    erf = special.erf

    @staticmethod
    def dot(a: Array, b: Array) -> Array:
        """Dot products (..., 1)."""
        return np.sum(a * b, axis=-1, keepdims=True)

    @staticmethod
    def choose(where_positive: Array, a: Any, b: Any) -> Array:
        """`a` where the first argument is positive, otherwise `b`."""
        return np.where(np.real(where_positive) > 0, a, b)


def light_force(a: Any, u: Any, front: Any, back: Any, maths: Any) -> Any:
    """Force of light on a face, divided by the pressure of light: a vector [m²], of the shape of
    `a`.

        |a·u| [(c_0 cos α + c_1) n + c_2 u]

    with the unit vector u along the light, the unit normal n of the face on the side away from the
    light, the angle α between n and u, and the coefficients c of the lit side, `front` or `back`.
    The area vector `a` [m²], a UFL vector or rows (..., 3), points away from its front; NaN where
    it is zero.

    >>> import numpy as np
    >>> mirror = (2.0, 0.0, 0.0)
    >>> light_force(np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0]), mirror, mirror, Arrays)
    array([0., 0., 2.])
    """
    # c = a·u [m²]; mirrored, both and along are the coefficients c_0, c_1 and c_2 of the lit side.
    c = maths.dot(a, u)
    area = maths.root(maths.dot(a, a))
    # The back is lit where light and area vector have the same direction.
    sign = maths.choose(c, 1.0, -1.0)
    mirrored, both, along = (
        maths.choose(c, of_back, of_front) for of_front, of_back in zip(front, back, strict=True)
    )
    # |a·u| without an absolute value, of which a complex step has no derivative.
    projected_area = sign * c
    # `a` has the length of the area, so that it is divided by the area once more.
    along_normal = (mirrored * projected_area / area + both) * (sign / area)
    return projected_area * (along_normal * a + along * u)


def flow_force(
    a: Any, U: Any, thermal: Any, σn: Any, σt: Any, wall: Any, two_sided: Any, maths: Any
) -> Any:
    """Force of free-molecular flow on a face, divided by the density of the air: a vector [m⁴/s²],
    of the shape of `a`; NaN where `a` or `U` is zero.

    The area vector `a` [m²], a UFL vector or rows (..., 3), points away from its front; U [m/s], of
    the same kind, is the velocity of the air relative to the face, `thermal` [m/s] the thermal
    speed √(2kT/m).  `two_sided` is 1, or 0 if air does not reach the back; a number, or (n, 1) for
    n faces.  The other arguments are those of `coefficients`.
    """
    area = maths.root(maths.dot(a, a))
    speed = maths.root(maths.dot(U, U))
    # c: cosine between area vector and relative wind [-].
    c = maths.dot(a, U) / (area * speed)
    s = speed / thermal
    # The normal of `coefficients` points into the surface: -a for the front, a for the back.
    into_front, shear_front = flow_coefficients(-c, s, σn, σt, wall, maths)
    into_back, shear_back = flow_coefficients(c, s, σn, σt, wall, maths)
    normal = two_sided * into_back - into_front
    shear = shear_front + two_sided * shear_back
    # ½U² (A n + B u) times the area, with the lengths of a and U multiplied out.
    return speed / 2 * (normal * speed * a + shear * area * U)


@check_arguments
@dataclass(frozen=True)
class Surface:
    """A flat surface of a rigid body, for light and air.

    Args:
        area: [m²].
        normal: outward, in body axes, (3,).
        centre: centroid in body axes, from the centre of mass [m], (3,).
        optics: of the front, to which the normal points, and of the back.
        two_sided: whether light and air reach the back: a plate instead of a side of a box.

    Raises:
        InputError: a value is out of its range.

    Example:
        >>> panel = gx.orbit.Surface(2.0, (0.0, 0.0, 1.0), centre=(1.5, 0.0, 0.0), two_sided=True)
        >>> panel.area
        2.0
    """

    area: Annotated[float, positive("m²")]
    normal: Direction
    _: KW_ONLY
    centre: Vector = (0.0, 0.0, 0.0)
    optics: Optics = MIRROR
    two_sided: bool = False
