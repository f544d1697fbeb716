"""Forces of light and of rarefied air on faces, the same formulas for UFL expressions and for arrays."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np
import ufl
from scipy import special

from gossamer_fx.extend import Array, Expr, Vector, check, check_arguments, is_vector
from gossamer_fx.orbit.free_molecular import coefficients
from gossamer_fx.orbit.optics import MIRROR, Optics


class Symbolic:
    """What the formulas need, of UFL vectors."""

    dot, root, exp, erf = ufl.dot, ufl.sqrt, ufl.exp, ufl.erf

    @staticmethod
    def choose(where_positive: Expr, a: Expr, b: Expr) -> Expr:
        return ufl.conditional(ufl.gt(where_positive, 0.0), a, b)


class Rows:
    """The same of arrays (..., 3) and (..., 1), real or complex: their derivatives are taken by complex steps."""

    root, exp, erf = np.sqrt, np.exp, special.erf

    @staticmethod
    def dot(a: Array, b: Array) -> Array:
        product: Array = np.sum(a * b, axis=-1, keepdims=True)
        return product

    @staticmethod
    def choose(where_positive: Array, a: Any, b: Any) -> Array:
        return np.where(np.real(where_positive) > 0, a, b)


def light_force(a: Any, u: Any, front: Any, back: Any, maths: Any) -> Any:
    """Force over the pressure of light along u on a face with the area vector a: see `Optics`.

    front, back: the three coefficients of either side when it is lit; the front is where a points to.
    """
    c, area = maths.dot(a, u), maths.root(maths.dot(a, a))
    to_us = maths.choose(c, 1.0, -1.0)
    mirrored, both, along = (
        maths.choose(c, of_back, of_front) for of_front, of_back in zip(front, back, strict=True)
    )
    shade = to_us * c  # projected area
    return shade * ((mirrored * shade / area + both) * (to_us / area) * a + along * u)


def flow_force(
    a: Any, U: Any, thermal: Any, σn: Any, σt: Any, wall: Any, two_sided: Any, maths: Any
) -> Any:
    """Force over the density of air that comes with the velocity U on a face with the area vector a.

    thermal: √(2kT/m) of the air [m/s]; wall: √(T_w/T); two_sided: 1, or 0 if the back is not reached.
    """
    area, speed = maths.root(maths.dot(a, a)), maths.root(maths.dot(U, U))
    c, s = maths.dot(a, U) / (area * speed), speed / thermal
    into_front, shear_front = coefficients(-c, s, σn, σt, wall, maths)
    into_back, shear_back = coefficients(c, s, σn, σt, wall, maths)
    normal = two_sided * into_back - into_front
    shear = shear_front + two_sided * shear_back
    return speed / 2 * (normal * speed * a + shear * area * U)


@check_arguments
@dataclass(frozen=True)
class Surface:
    """A flat face of a rigid body.

    Args:
        area: [m²].
        normal: outward, in body axes.
        centre: its centroid in body axes, from the centre of mass [m].
        optics: of the front, where the normal points to, and of the back.
        two_sided: whether light and air reach the back, too: a plate instead of a side of a box.
    """

    area: float
    normal: Vector
    _: KW_ONLY
    centre: Vector = (0.0, 0.0, 0.0)
    optics: Optics = MIRROR
    two_sided: bool = False

    def __post_init__(self) -> None:
        check(self.area > 0, f"Surface: area is {self.area!r} m²; give a positive number.")
        for what in ("normal", "centre"):
            check(
                is_vector(getattr(self, what)),
                f"Surface: {what} is {getattr(self, what)!r}; give three numbers.",
            )
        check(
            bool(np.any(np.asarray(self.normal))),
            "Surface: normal is zero; give the direction outward.",
        )
