"""Leaks through porous films and fabrics."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Annotated

from gossamer_fx.core.checks.arguments import check_arguments, not_negative, positive
from gossamer_fx.mechanics.gas.connection import PassiveOpening
from gossamer_fx.mechanics.gas.contract import Aperture, Gas
from gossamer_fx.mechanics.gas.film_area import FilmArea
from gossamer_fx.mechanics.gas.orifice import compile_aperture
from gossamer_fx.mechanics.gas.surface import Geometry


@check_arguments
@dataclass(frozen=True, eq=False)
class PorousFilm(PassiveOpening):
    """A film through which gas leaks by its deformed area and the difference of pressures Δp:

        Δp = viscous · v + inertial · v²,     ṁ = ρ A v

    with the density ρ upstream and the velocity v of the gas ahead of the film (Forchheimer's law;
    Ergun, Chem. Eng. Prog. 48 (1952) 89).  The law holds for small Mach numbers.  Parts that other
    films cover leak like the others.

    Args:
        a, b: chambers, tanks or surroundings on both sides; a flow from a to b is positive.
        area: the part of the film that leaks, a `FilmArea`, or a number [m²].
        viscous: Δp over v at low velocities [Pa s/m], > 0.
        inertial: Δp over v² at high ones [Pa s²/m²], ≥ 0.
        name: in messages.

    Raises:
        InputError: a quantity is out of its range, or both ends are the same.

    Example:
        >>> outside = gx.gas.Ambient(1e5, 300.0)
        >>> leak = gx.gas.PorousFilm(tank, outside, area=gx.gas.FilmArea(film), viscous=4e4)
    """

    _: KW_ONLY
    area: FilmArea | Annotated[float, not_negative("m²")]
    viscous: Annotated[float, positive("Pa s/m")]
    inertial: Annotated[float, not_negative("Pa s²/m²")] = 0.0
    name: str = "porous film"

    def aperture(self, geometry: Geometry) -> Aperture:
        """Return the area [m²] as a function of step length h [s] and time."""
        return compile_aperture(self.area, 1.0, geometry, f"PorousFilm '{self.name}'")

    def flux(self, gas: Gas, pu: complex, Tu: complex, pd: complex) -> complex:
        """ρ v [kg/(s m²)] of the law above."""
        difference = pu - pd
        root = (self.viscous**2 + 4 * self.inertial * difference) ** 0.5
        # The root of the quadratic equation in the form that does not cancel
        velocity = 2 * difference / (self.viscous + root)
        return pu / (gas.R * Tu) * velocity
