"""Ready-made probes: functions of a run that return one number, the same on every rank."""

from __future__ import annotations

from typing import TYPE_CHECKING

from petsc4py import PETSc

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.errors import check
from gossamer_fx.model.ports import combined
from gossamer_fx.model.terms import Port
from gossamer_fx.outputs.fields import STATES, AreaFractions
from gossamer_fx.outputs.run import Run
from gossamer_fx.system.system import System

if TYPE_CHECKING:
    from gossamer_fx.gas.contract import Volume

AXES = {"x": 0, "y": 1, "z": 2}
GAS = ("pressure", "temperature", "volume", "mass")


class Position:
    """Coordinate [m] of a port, e.g. `Position(film.port("tip"), "z")`."""

    def __init__(self, port: Port, axis: str) -> None:
        _check_axis(axis)
        self.port, self.axis = port, axis

    def __call__(self, run: Run) -> float:
        return _component(run, self.port, self.axis, run.system.q0)


class Displacement(Position):
    """Component [m] of the way of a port from its place in the initial state."""

    def __init__(self, port: Port, axis: str) -> None:
        super().__init__(port, axis)
        self._origin: tuple[System, float] | None = None

    def __call__(self, run: Run) -> float:
        now, system, body = super().__call__(run), run.system, self.port.body
        if self._origin is None or self._origin[0] is not system:
            start = system.starts[system.bodies.index(body)] if system.starts else body.initial_state()[0]
            self._origin = system, float(combined(self.port, start)[AXES[self.axis]])
        return now - self._origin[1]


class Velocity(Position):
    """Component [m/s] of the velocity of a port."""

    def __call__(self, run: Run) -> float:
        return _component(run, self.port, self.axis, run.system.v0)


class GasState:
    """Pressure [Pa], temperature [K], volume [m³] or mass [kg] of a chamber, e.g. `GasState(bag, "pressure")`."""

    def __init__(self, chamber: Volume, quantity: str) -> None:
        check(quantity in GAS, f"A chamber has no quantity {quantity!r}; its quantities are: {', '.join(GAS)}.")
        self.chamber, self.quantity = chamber, quantity

    def __call__(self, run: Run) -> float:
        s = run.chamber(self.chamber.name)
        return {"pressure": s.p, "temperature": s.temperature, "volume": s.V, "mass": s.m}[self.quantity]


class AreaFraction:
    """Fraction of a film's reference area that is "slack", "wrinkled" or "taut"."""

    def __init__(self, film: Membrane, state: str) -> None:
        check(state in STATES, f"A film has no state {state!r}; its states are: {', '.join(STATES)}.")
        self.state, self._fractions = state, AreaFractions([film])

    def __call__(self, run: Run) -> float:
        return float(self._fractions(run.system)[STATES[self.state]])


def _check_axis(axis: str) -> None:
    check(axis in AXES, f"A vector has no component {axis!r}; its components are: {', '.join(AXES)}.")


def _component(run: Run, port: Port, axis: str, vector: PETSc.Vec) -> float:
    """Component of a port's vector in a state of the run, or of its rate."""
    check(port.body in run.system.bodies, f"'{port.body.name}' is not in the scene; add it, or remove its probe.")
    owned = run.system.numbering.owned(run.system.bodies.index(port.body))
    return float(combined(port, vector.array_r[owned])[AXES[axis]])
