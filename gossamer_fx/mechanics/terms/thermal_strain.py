"""Thermal strain of a stored energy, at both ends of a step.

The stored energy is ψ(e - e_th(t)).  In a step the difference goes from e0 - e_th(t0) to e1 -
e_th(t1); the stress rule gives a mean stress S of this path, with

    S·(Δe - Δe_th) = Δψ.

The forces of S do the work ∫ S·Δe on the body.  The change of the stored energy less that work,
-∫ S·Δe_th, is what heat supplies.
"""

from __future__ import annotations

from collections.abc import Callable

from dolfinx import fem

from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.model.terms import Parameter

# Sets a function on a mesh to the temperatures [K] of a time [s].
SetTemperature = Callable[[fem.Function, float], None]


class ThermalStrain:
    """e_th of one body in one compiled scene, an expression of a temperature [K] with constants
    that are parameters.

    Attributes:
        start_temperature, end_temperature: temperatures at the start and at the end of the step.
        start, end: e_th there.
        before: e_th at the start of the last accepted step.
        in_time: whether the temperatures change with time.
        is_heated: whether another item of the scene computes the temperatures.
    """

    def __init__(
        self,
        strain: Callable[[Expr], Expr],
        space: fem.FunctionSpace,
        temperature: SetTemperature,
        *,
        in_time: bool,
        parameters: tuple[Parameter, ...],
    ) -> None:
        """Make thermal strains at both ends of a step, from the temperatures at time zero.
        Collective."""
        self.start_temperature = fem.Function(space)
        self.end_temperature = fem.Function(space)
        self._temperature_before = fem.Function(space)
        self.before = strain(self._temperature_before)
        self.start = strain(self.start_temperature)
        self.end = strain(self.end_temperature)
        self.in_time = in_time
        self.is_heated = False
        self._temperature = temperature
        self._constants = parameters
        temperature(self.end_temperature, 0.0)
        # Twice: the temperatures of the end are taken to the start, then to the start before it.
        self.commit()
        self.commit()

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters of the stored energy; temperatures only if they do not change with time."""
        if self.in_time:
            return self._constants
        both = (self.start_temperature, self.end_temperature)
        return (*self._constants, *(Parameter("temperature", "K", one) for one in both))

    def set_end(self, t: float) -> None:
        """Take the temperatures at the end of a step, t [s], unless they are constant or another
        item computes them."""
        if self.in_time and not self.is_heated:
            self._temperature(self.end_temperature, t)

    def commit(self) -> None:
        """Take the temperatures at the end of the step as those at the start of the next one."""
        self._temperature_before.x.array[:] = self.start_temperature.x.array
        self.start_temperature.x.array[:] = self.end_temperature.x.array
