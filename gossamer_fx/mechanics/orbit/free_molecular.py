"""Force coefficients in free-molecular flow, where molecules hit the surface but not each other."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np

from gossamer_fx.extend import check, check_arguments

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

    density: float
    temperature: float = 1000.0
    _: KW_ONLY
    molecule: float = ATOM

    def __post_init__(self) -> None:
        """Refuse a negative density, and a temperature or mass that is not positive.

        Raises:
            InputError: density < 0 [kg/m³], temperature ≤ 0 [K] or molecule ≤ 0 [kg].
        """
        check(
            self.density >= 0,
            f"Air: density is {self.density!r} kg/m³; give a number that is not negative.",
        )
        check(
            self.temperature > 0,
            f"Air: temperature is {self.temperature!r} K; give a positive number.",
        )
        check(self.molecule > 0, f"Air: molecule is {self.molecule!r} kg; give a positive mass.")

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

    normal: float = 1.0
    tangential: float = 1.0
    _: KW_ONLY
    wall_temperature: float = 300.0

    def __post_init__(self) -> None:
        """Refuse fractions outside 0 to 1 and a wall temperature that is not positive.

        Raises:
            InputError: `normal` or `tangential` is outside 0 to 1, or `wall_temperature` ≤ 0 [K].
        """
        for quantity in ("normal", "tangential"):
            value = getattr(self, quantity)
            check(
                0 <= value <= 1,
                f"Accommodation: {quantity} is {value!r}; give a number between 0 and 1.",
            )
        check(
            self.wall_temperature > 0,
            f"Accommodation: wall_temperature is {self.wall_temperature!r} K; give a positive "
            "number.",
        )


def coefficients(
    c: Any,
    s: Any,
    σn: Any,
    σt: Any,
    wall: Any,
    maths: Any,
) -> tuple[Any, Any]:
    """(A, B): the flow of mass density ρ and velocity U exerts per area ½ρU² (A n + B u) on one
    side.

    n points into the surface, u = U/|U|, c = n·u (negative on the lee), s = |U|/√(2kT/m), wall =
    √(T_w/T).  With x = s c, the pressure and shear coefficients of Schaaf & Chambre are

        c_p s² = [(2-σ_n) x/√π + σ_n wall/2] exp(-x²)
                 + [(2-σ_n)(x² + ½) + σ_n √π wall x/2] (1 + erf x)
        c_τ s  = σ_t sin θ [exp(-x²)/√π + x (1 + erf x)]

    and A = c_p - c c_τ/sin θ, B = c_τ/sin θ.  All quantities are dimensionless: UFL scalars, or
    arrays that broadcast with each other and may be complex.

    Args:
        c: cosine between the normal into the surface and the flow.
        s: speed of the air over its thermal speed, not zero: for a face at rest in the air the
            coefficients are not finite.
        σn: accommodation of the normal momentum, 0 to 1.
        σt: accommodation of the tangential momentum, 0 to 1.
        wall: √(T_w/T), from the temperatures of the wall and of the air.
        maths: object with the functions `exp` and `erf`, of UFL or of SciPy.

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
