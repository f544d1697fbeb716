"""Mixtures of gases: properties by mass fractions, and the masses of all chambers of a network.

Species are pure gases.  A chamber has an unknown for the mass of each species that it holds or can
receive through openings; a scene of one gas has one for each chamber.  The mixture is ideal:

    p V = T Σ m_s R_s,     U = Σ m_s u_s(T),     γ = 1 + Σ m_s R_s/Σ m_s c_v,s              (1)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import numpy as np

from gossamer_fx.core.checks.arguments import Range, check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.laws.tracing import Number
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.gas.contract import Gas, Holder, Opening, Volume

# Mass fractions that are given may differ from a sum of one by their last printed digits.
SUM_TOLERANCE = 1e-6

# Newton's method for the temperature converges quadratically, as u(T) is convex and smooth within a
# range of its polynomials; a few more iterations cross from one range to the next.
MAX_ITERATIONS = 50


class Blend(Gas):
    """Properties of species in given amounts, numbers of any kind in any unit of mass."""

    def __init__(self, species: Sequence[Gas], amounts: Sequence[Number], name: str) -> None:
        total = sum(amounts)
        self.name = name
        self._species = tuple(species)
        self.fractions: Sequence[Number] = [amount / total for amount in amounts]
        self.R = self._mean([gas.R for gas in species])

    @property
    def species(self) -> tuple[Gas, ...]:
        """The gases that are mixed."""
        return self._species

    @property
    def constant_heat_ratio(self) -> float | None:
        """None: it changes with the fractions."""
        return None

    def heat_ratio(self, T: Number) -> Number:
        """γ = 1 + R/c_v."""
        return 1 + self.R / self.heat_capacity(T)

    def heat_capacity(self, T: Number) -> Number:
        """c_v [J/(kg K)]."""
        return self._mean([gas.heat_capacity(T) for gas in self.species])

    def energy(self, T: Number) -> Number:
        """u [J/kg]."""
        return self._mean([gas.energy(T) for gas in self.species])

    def enthalpy(self, T: Number) -> Number:
        """u + R T [J/kg]."""
        return self.energy(T) + self.R * T

    def _mean(self, values: Sequence[Number]) -> Number:
        """Mean of a quantity per mass over the species."""
        return sum(Y * value for Y, value in zip(self.fractions, values, strict=True))


@check_arguments
class Mixture(Blend):
    """A mixture of gases by mass fractions, for chambers, tanks and surroundings.

    Args:
        fractions: mass fraction of each gas, in (0, 1]; their sum is one.
        name: in messages.

    Raises:
        InputError: there is no gas, a fraction is out of its range, or their sum is not one.

    Example:
        >>> from gossamer_fx.presets.gases import HELIUM, NITROGEN
        >>> mixture = gx.gas.Mixture({HELIUM: 0.25, NITROGEN: 0.75})
        >>> tank = gx.Tank(1e-3, gas=mixture, pressure=2e5, temperature=300.0)
    """

    def __init__(
        self,
        fractions: Mapping[Gas, Annotated[float, Range(0.0, 1.0, above=True)]],
        *,
        name: str = "mixture",
    ) -> None:
        total = sum(fractions.values())
        check(
            abs(total - 1) <= SUM_TOLERANCE,
            f"Mixture '{name}': the mass fractions add up to {total:.9g}; give fractions of one.",
        )
        # A mixture may be made of others.
        amounts: dict[Gas, float] = {}
        for gas, share in fractions.items():
            for one, part in zip(gas.species, gas.fractions, strict=True):
                amounts[one] = amounts.get(one, 0.0) + share * part
        super().__init__(list(amounts), list(amounts.values()), name)


class Contents:
    """Which species the chambers of a network hold, and their energy as a function of pressures,
    volumes and masses.

    The masses of all chambers are one array (s,), chamber after chamber.

    Attributes:
        species: all species of the scene.
        owners: chamber of each mass (s,).
        gases: species of each mass.
        rows: for each chamber the positions of its masses.
    """

    def __init__(self, chambers: Sequence[Volume], openings: Sequence[Opening]) -> None:
        """Find the species that each chamber can receive.  `InputError`: two gases have the same
        name."""
        held = _reachable(chambers, openings)
        found: dict[Gas, None] = {}
        given = [chamber.gas for chamber in chambers]
        for gas in (*given, *(boundary.gas for boundary in _boundaries(openings))):
            found |= dict.fromkeys(_species(gas))
        self.species = list(found)
        names = [gas.name for gas in self.species]
        twice = next((name for name in names if names.count(name) > 1), "")
        check(
            not twice,
            f"Different gases of the scene have the same name '{twice}'; give each its own `name`.",
        )
        self.owners = [k for k, own in enumerate(held) for _ in own]
        self.gases = [gas for own in held for gas in own]
        self.rows: list[list[int]] = []
        start = 0
        for own in held:
            self.rows.append(list(range(start, start + len(own))))
            start += len(own)
        # With one species in each chamber sums over species are the values themselves.
        self._is_pure = len(self.gases) == len(chambers)
        self._R: Array = np.array([gas.R for gas in self.gases])
        # γ - 1 of each chamber (n,) if it has a value for all temperatures and masses, else None
        ratios = [gas.constant_heat_ratio for gas in self.gases]
        self._gamma_1: Array | None = None
        if self._is_pure and None not in ratios:
            self._gamma_1 = np.array(ratios, dtype=float) - 1

    @property
    def n(self) -> int:
        """Number of chambers."""
        return len(self.rows)

    @property
    def is_simple(self) -> bool:
        """Whether the scene has one species, whose specific heats are constant."""
        return len(self.species) == 1 and self._gamma_1 is not None

    def sums(self, values: Array) -> Array:
        """Sums (n,) of values of all masses (s,) over each chamber."""
        if self._is_pure:
            return values
        return np.array([sum(values[row] for row in rows) for rows in self.rows])

    def per_mass(self, values: Array) -> Array:
        """For each mass the value of its chamber, (s,), from values (n,) of the chambers."""
        if self._is_pure:
            return values
        return values[self.owners]

    # ---- the equations of state (1) --------------------------------------------------------------

    def masses_times_R(self, m: Array) -> Array:
        """Σ m_s R_s [J/K] of each chamber, p V/T."""
        if self._is_pure:
            # Asked for in every iteration: a scene of one gas sums nothing.
            return m * self._R
        return self.sums(m * self._R)

    def temperatures(self, pV: Array, m: Array) -> Array:
        """Temperature [K] of each chamber from p V [J] and masses [kg]."""
        return pV / self.masses_times_R(m)

    def energies(self, pV: Array, m: Array) -> Array:
        """Internal energy [J] of each chamber from p V [J] and masses [kg]."""
        if self._gamma_1 is not None:
            return pV / self._gamma_1
        return self.thermal_energies(self.temperatures(pV, m), m)

    def thermal_energies(self, T: Array, m: Array) -> Array:
        """Internal energy Σ m_s u_s(T) [J] of each chamber."""
        return self.sums(m * self.specific_energies(T))

    def specific_energies(self, T: Array) -> Array:
        """u_s(T) [J/kg] of each mass's species at its chamber's temperature, (s,)."""
        return self._each("energy", T)

    def pressures(self, U: Array, m: Array, V: Array, T: Array) -> Array:
        """Pressure [Pa] of each chamber from its energy [J], masses [kg] and volume [m³]; T (n,)
        [K] is a guess of the temperature, which is solved for to round-off, in at most 50
        iterations, unless the specific heats are constant."""
        if self._gamma_1 is not None:
            return self._gamma_1 * U / V
        for _ in range(MAX_ITERATIONS):
            update = (U - self.thermal_energies(T, m)) / self.sums(
                m * self._each("heat_capacity", T)
            )
            T = T + update
            # The last update is quadratically small: round-off of T is some 1e-16.
            if (abs(update) <= 1e-9 * T).all():
                break
        return self.masses_times_R(m) * T / V

    def _each(self, quantity: str, T: Array) -> Array:
        """A function of temperature of each mass's gas, by name, at its chamber's T (n,)."""
        pairs: Any = zip(self.gases, self.per_mass(T), strict=True)
        return np.array([getattr(gas, quantity)(temperature) for gas, temperature in pairs])


def _species(gas: Gas | None) -> tuple[Gas, ...]:
    """The species of a gas; none if the gas is that of the scene."""
    return () if gas is None else gas.species


def _boundaries(openings: Sequence[Opening]) -> list[Holder]:
    """The ends of openings that are boundaries of constant state."""
    ends = [end for opening in openings for end in (opening.a, opening.b)]
    return [end for end in ends if isinstance(end, Holder)]


def _reachable(chambers: Sequence[Volume], openings: Sequence[Opening]) -> list[list[Gas]]:
    """The species that each chamber holds at the start or can receive through openings, in the
    order of the scene."""
    # Gas flows either way through an opening; what a boundary receives does not come back.
    held = [dict.fromkeys(chamber.gas.species) for chamber in chambers]
    numbers = {id(chamber): k for k, chamber in enumerate(chambers)}
    grows = True
    while grows:
        before = sum(map(len, held))
        for opening in openings:
            for source, target in ((opening.a, opening.b), (opening.b, opening.a)):
                if isinstance(target, Holder):
                    continue
                if isinstance(source, Holder):
                    held[numbers[id(target)]] |= dict.fromkeys(_species(source.gas))
                else:
                    held[numbers[id(target)]] |= held[numbers[id(source)]]
        grows = sum(map(len, held)) > before
    return [list(own) for own in held]
