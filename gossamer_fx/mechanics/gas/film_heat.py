"""Heat that the gas of a chamber gives through its film to what is outside."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Any

from gossamer_fx.core.algebra.dual_numbers import Number
from gossamer_fx.core.checks.arguments import check_arguments, not_negative, positive
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.user_functions import ask_numbers
from gossamer_fx.mechanics.gas.contract import Conductance
from gossamer_fx.mechanics.gas.film_area import FilmArea
from gossamer_fx.mechanics.gas.network import GasNetwork
from gossamer_fx.mechanics.gas.surface import Geometry
from gossamer_fx.mechanics.gas.volumes import Chamber


@check_arguments
@dataclass(frozen=True, eq=False)
class FilmHeat:
    """Heat between the gas of a chamber and its surroundings through the deformed film:

        Q = h A (T_outside - T)

    The heat counts as supplied in the energy balance.  The film itself takes none, and sunlight
    does not reach the gas.  Films that fold on each other exchange heat as if they were apart.

    Args:
        chamber: the chamber or tank.
        area: the film or the part of it through which the heat goes; A is its deformed area [m²].
        coefficient: h [W/(m² K)] from the gas to the outside, ≥ 0: 1/h is the sum of 1/h on both
            sides and of thickness over conductivity of the film.  A number, or a function of the
            temperatures [K] of the gas and outside; gradients take a number.
        temperature: T_outside [K], > 0.
        name: in messages.

    Raises:
        InputError: a quantity is out of its range, also when the function gives it.

    Example:
        >>> outside = gx.gas.FilmHeat(
        ...     tank, gx.gas.FilmArea(film), coefficient=5.0, temperature=223.0
        ... )
        >>> def free_convection(gas, air):
        ...     return 1.3 * abs(gas - air) ** 0.25
        >>> outside = gx.gas.FilmHeat(
        ...     tank, gx.gas.FilmArea(film), coefficient=free_convection, temperature=223.0
        ... )
    """

    chamber: Chamber
    area: FilmArea
    _: KW_ONLY
    coefficient: Annotated[float, not_negative("W/(m² K)")] | Callable[[float, float], float]
    temperature: Annotated[float, positive("K")]
    name: str = "heat through film"
    scalar_unknowns = GasNetwork

    def requires(self) -> Iterable[Any]:
        yield self.chamber
        yield from self.area.requires()

    def compile(self, geometry: Geometry) -> Callable[[float], Conductance]:
        """h A [W/K] with the area in the middle of the step."""
        area = geometry.area(self.area)

        def conductance_in(h: float) -> Conductance:
            # Measured once a step, not in each iteration
            size = area.aperture(h)
            return lambda T: size * self._coefficient_at(T, geometry)

        return conductance_in

    def _coefficient_at(self, T: Number, geometry: Geometry) -> float:
        """The coefficient [W/(m² K)] at a temperature of the gas [K].  Collective."""
        given = self.coefficient
        if not callable(given):
            return given
        what = f"FilmHeat '{self.name}': its coefficient at {T:.6g} K"
        found = float(ask_numbers(geometry.comm, what, lambda: given(T, self.temperature)))
        check(found >= 0, f"{what} is {found!r} W/(m² K); give one that is not negative.")
        return found
