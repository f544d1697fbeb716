"""Gas at rest: what stays constant in a chamber while an equilibrium is looked for.

An adiabatic chamber cools while its film unfolds: a bag that takes ten times its first volume ends at
0.4 of its first temperature.  At rest a film has the temperature of its surroundings, or its pressure is
held by a blower.  Here the energy balance of `balance` is replaced by one of

    isothermal       p1 V = m1 R T0                                                           (1)
    held pressure    p1 = p0,   m1 = p0 V/(R T0)                                              (2)

with pressure p0 and temperature T0 of the start.  Heat of (1) and gas of (2) count as supplied.
"""

from __future__ import annotations

import numpy as np

from gossamer_fx.gas.balance import Balance, Rates
from gossamer_fx.model.body import Array


class IsothermalBalance(Balance):
    """The mass balance of `Balance` with (1) in place of the energy balance."""

    depends_on_swept_volume = False

    def residual(self, y: Array, V: Array, W: Array, known: Rates | None = None) -> Array:
        pressure_energy = y[: self._n] * V / (self._gas.gamma - 1)
        thermal_energy = y[self._n :] * self._gas.cv * self.temperatures
        mass = super().residual(y, V, W, known)[self._n :]
        return np.concatenate([pressure_energy - thermal_energy, mass])

    def derivatives(self, y: Array, V: Array, W: Array) -> tuple[Array, Array]:
        """Derivatives (2n, 2n) and (2n, n) of the residual [J, kg] by pressures and masses y, and by volumes V [m³]."""
        n = self._n
        by_y, by_V = super().derivatives(y, V, W)
        heat_factor = self._gas.gamma - 1
        by_y[:n] = np.hstack([np.diag(V / heat_factor), -np.diag(self._gas.cv * self.temperatures)])
        by_V[:n] = np.diag(y[:n] / heat_factor)
        return by_y, by_V


class HeldPressureBalance(Balance):
    """The equations (2) in place of both balances."""

    depends_on_swept_volume = False

    def residual(self, y: Array, V: Array, W: Array, known: Rates | None = None) -> Array:
        excess_pressure = y[: self._n] - self._p0
        excess_mass = y[self._n :] - self._mass(V)
        return np.concatenate([excess_pressure * V / (self._gas.gamma - 1), excess_mass])

    def derivatives(self, y: Array, V: Array, W: Array) -> tuple[Array, Array]:
        """Derivatives (2n, 2n) and (2n, n) of the residual [J, kg] by pressures and masses y, and by volumes V [m³]."""
        n = self._n
        by_y = np.diag(np.concatenate([V / (self._gas.gamma - 1), np.ones(n)]))
        by_V = np.zeros((2 * n, n))
        by_V[np.arange(n), np.arange(n)] = (y[:n] - self._p0) / (self._gas.gamma - 1)
        by_V[n + np.arange(n), np.arange(n)] = -self._mass(np.ones(n))
        return by_y, by_V

    def _mass(self, V: Array) -> Array:
        """Masses [kg] of the gas in volumes V (n,) at the held pressures."""
        masses: Array = self._p0 * V / (self._gas.R * self.temperatures)
        return masses
