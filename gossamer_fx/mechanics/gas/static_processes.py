"""Gas at rest: the balances of chambers while an equilibrium is looked for, by what stays constant.

A closed chamber at rest is a function of its volume V, whatever the way to it.  The work p̄ W of a
time step is not: its sum over pseudo-steps depends on their number.  With the pressure p0, volume
V0 and energy U0 at the start of a pseudo-step, the energy balance of `gas.balance` is replaced by
one of

    adiabatic        U1 = U0 (V0/V)^(γ - 1) + flows,    so that p V^γ = const if closed         (1)
    isothermal       p1 V = m1 R T0                                                             (2)
    held pressure    p1 = p0,   m1 = p0 V/(R T0)                                                (3)

with the temperature T0 of the start; for mixtures γ is that of the start.  Steps of (1) compose
exactly.  Heat of (2) and gas of (3) count as supplied.

An adiabatic chamber cools while its film unfolds: a bag that takes ten times its first volume ends
at 0.4 of its first temperature.  At rest a film has the temperature of its surroundings, or its
pressure is held by a blower: (2) and (3).

Limit.  Where gas flows through an opening during the search, (1) depends on the pseudo-steps.
"""

from __future__ import annotations

import numpy as np

from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.gas.balance import Balance, Rates

# Share of the volume at the start below which (1) is continued as a constant: Newton's iterates may
# have volumes that are zero or negative.
SMALLEST_VOLUME = 1e-6


class AdiabaticBalance(Balance):
    """The balances of `Balance` with the work of (1), which does not depend on the swept volume."""

    depends_on_swept_volume = False

    def begin(self, h: float, t: float, p: Array, m: Array, U: Array, V: Array) -> None:
        super().begin(h, t, p, m, U, V)
        self._V0 = V
        # γ - 1 at the start
        self._exponent = 1 / self.contents.heat_factors(self.temperatures, m)

    def work(self, y: Array, V: Array, W: Array) -> Array:
        """Work [J] of each chamber (n,) if it expands from V0 to V without heat and flow."""
        return self._U0 * (1 - self._ratio(V) ** self._exponent)

    def _ratio(self, V: Array) -> Array:
        """V0/V of each chamber, (n,)."""
        return self._V0 / np.maximum(V, SMALLEST_VOLUME * self._V0)

    def derivatives(self, y: Array, V: Array, W: Array) -> tuple[Array, Array]:
        """Derivatives (n + s, n + s) and (n + s, n) of the residual [J, kg] by y and by V."""
        n = self._n
        by_y, by_V = super().derivatives(y, V, np.zeros(n))
        # The work's derivative by V is the pressure p0 (V0/V)^γ at which it ends.
        pressures = self._p0 * self._ratio(V) ** (1 + self._exponent)
        by_V[np.arange(n), np.arange(n)] += pressures
        return by_y, by_V


class IsothermalBalance(Balance):
    """The mass balance of `Balance` with (2) in place of the energy balance."""

    depends_on_swept_volume = False

    def residual(self, y: Array, V: Array, W: Array, known: Rates | None = None) -> Array:
        """Residual (n + s,): excess of the energy at p and V over that at T0 [J] of each chamber,
        then the mass balance [kg]."""
        n = self._n
        masses = y[n:]
        # (2) as energies, e.g. p V/(γ - 1) = m c_v T0, the unit of the balance that it replaces.
        pressure_energy = self.contents.energies(y[:n] * V, masses)
        thermal_energy = self.contents.thermal_energies(self.temperatures, masses)
        both_balances = super().residual(y, V, W, known)
        mass_balance = both_balances[n:]
        return np.concatenate([pressure_energy - thermal_energy, mass_balance])

    def derivatives(self, y: Array, V: Array, W: Array) -> tuple[Array, Array]:
        """Derivatives (n + s, n + s) and (n + s, n) of the residual [J, kg] by y and by V; they do
        not depend on W."""
        n = self._n
        by_y, by_V = super().derivatives(y, V, W)
        p1 = y[:n]
        m1 = y[n:]
        contents = self.contents
        temperature = contents.temperatures(p1 * V, m1)
        heat_factor = contents.heat_factors(temperature, m1)
        # The rows of the energy balance; those of the mass balance stay.
        by_y[:n] = 0.0
        by_y[:n, :n] = np.diag(V * heat_factor)
        specific_energy = contents.specific_energies(self.temperatures)
        by_mass = contents.energy_slopes(temperature, m1) - specific_energy
        by_y[contents.owners, n + np.arange(len(m1))] = by_mass
        by_V[:n] = np.diag(p1 * heat_factor)
        return by_y, by_V


class HeldPressureBalance(Balance):
    """The equations (3) in place of both balances."""

    depends_on_swept_volume = False

    def begin(self, h: float, t: float, p: Array, m: Array, U: Array, V: Array) -> None:
        super().begin(h, t, p, m, U, V)
        # Pressures that are held do not equalise: a flow would last as long as the search.
        for passage in self.passages:
            passage.area = 0.0

    def residual(self, y: Array, V: Array, W: Array, known: Rates | None = None) -> Array:
        """Residual (n + s,): excess of the pressure as energy (p1 - p0) V [J], then of the masses
        [kg]; the held pressures p0 (n,) [Pa] are those at the start of the step."""
        n = self._n
        pressures = y[:n]
        masses = y[n:]
        excess_pressure = pressures - self._p0
        excess_mass = masses - self.held_masses(V)
        # The first rows in the unit of the energy balance that they replace.
        excess_energy = excess_pressure * V
        return np.concatenate([excess_energy, excess_mass])

    def derivatives(self, y: Array, V: Array, W: Array) -> tuple[Array, Array]:
        """Derivatives (n + s, n + s) and (n + s, n) of the residual [J, kg] by y and by V; they do
        not depend on W."""
        n = self._n
        # `_p0` (n,) [Pa] are the pressures at the start of the step, which are held.
        excess_pressure = y[:n] - self._p0
        # Each chamber's equations contain its own pressure, masses and volume only.
        by_y = np.diag(np.concatenate([V, np.ones(len(self._m0))]))
        by_V = np.zeros((len(y), n))
        by_V[:n] = np.diag(excess_pressure)
        by_V[n + np.arange(len(self._m0)), self.contents.owners] = -self.held_masses(np.ones(n))
        return by_y, by_V

    def held_masses(self, V: Array) -> Array:
        """Masses [kg] of the species in volumes V (n,) at the held pressures."""
        return self._m0 * self.contents.per_mass(self._p0 * V / self._pV0)
