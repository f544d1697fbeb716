"""Ready-made probes: functions of a run that return one number, the same on every rank."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from gossamer_fx.bodies.frames import Frame
from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.fields.fields import STATES, AreaFractions
from gossamer_fx.model.body import Port
from gossamer_fx.probes.run import Run
from gossamer_fx.system.reactions import Joint, joint_force

if TYPE_CHECKING:
    from gossamer_fx.gas.contract import Volume
    from gossamer_fx.gas.ring import Ring

AXES = {"x": 0, "y": 1, "z": 2}
GAS = ("pressure", "temperature", "volume", "mass")


@check_arguments
class Position:
    """Coordinate [m] of a port, e.g. `Position(film.port("tip"), "z")`."""

    def __init__(self, port: Port, axis: str) -> None:
        check_axis(axis)
        self.port = port
        self.axis = axis

    def __call__(self, run: Run) -> float:
        return float(run.system.state.vector(self.port)[AXES[self.axis]])


@check_arguments
class Displacement(Position):
    """Component [m] of the displacement of a port from where the scene starts."""

    def __call__(self, run: Run) -> float:
        start = run.system.initial.vector(self.port)
        return super().__call__(run) - float(start[AXES[self.axis]])


class Velocity(Position):
    """Component [m/s] of the velocity of a port."""

    def __call__(self, run: Run) -> float:
        return float(run.system.state.rate(self.port)[AXES[self.axis]])


@check_arguments
class GasState:
    """Pressure [Pa], temperature [K], volume [m³] or mass [kg] of a chamber, e.g. `GasState(bag, "pressure")`."""

    def __init__(self, chamber: Volume, quantity: str) -> None:
        check(
            quantity in GAS,
            f"A chamber has no quantity {quantity!r}; its quantities are: {', '.join(GAS)}.",
        )
        self.chamber, self.quantity = chamber, quantity

    def __call__(self, run: Run) -> float:
        s = run.chamber(self.chamber.name)
        return {
            "pressure": s.pressure,
            "temperature": s.temperature,
            "volume": s.volume,
            "mass": s.mass,
        }[self.quantity]


@check_arguments
class AreaFraction:
    """Fraction of a film's reference area that is "slack", "wrinkled" or "taut"."""

    def __init__(self, body: Membrane, state: str) -> None:
        check(
            state in STATES, f"A film has no state {state!r}; its states are: {', '.join(STATES)}."
        )
        self.state, self._fractions = state, AreaFractions([body])

    def __call__(self, run: Run) -> float:
        return float(self._fractions(run.system)[STATES[self.state]])


@check_arguments
class AngularVelocity:
    """Component [rad/s] of the angular velocity of a frame, e.g. `AngularVelocity(hub.frame(), "z")`."""

    def __init__(self, frame: Frame, axis: str) -> None:
        check_axis(axis)
        self.axis, self._directors = axis, [d for d in frame.directors if isinstance(d, Port)]
        check(
            len(self._directors) == len(frame.directors),
            "AngularVelocity: the ground does not turn; give the frame of a body.",
        )

    def __call__(self, run: Run) -> float:
        d = run.system.state.vectors(self._directors)
        rates = run.system.state.rates(self._directors)
        if len(d) == 2:  # the normal of a beam's section
            normal = np.cross(rates[0], d[1]) + np.cross(d[0], rates[1])
            d, rates = np.vstack([np.cross(*d), d]), np.vstack([normal, rates])
        return float(np.cross(d, rates).sum(axis=0)[AXES[self.axis]] / 2)


@check_arguments
class JointForce:
    """Component [N] of the force that a joint exerts on its side `b`, in the last step."""

    def __init__(self, joint: Joint, axis: str) -> None:
        check_axis(axis)
        self.joint, self.axis = joint, axis

    def __call__(self, run: Run) -> float:
        return float(joint_force(run.system, self.joint)[0][AXES[self.axis]])


@check_arguments
class RingArea:
    """Deformed area [m²] of a `Ring`, the opening through which gas may pass."""

    def __init__(self, ring: Ring) -> None:
        self.ring = ring
        self._loops: dict[int, Any] = {}

    def __call__(self, run: Run) -> float:
        from gossamer_fx.gas.ring import Loop

        known = self.ring.body in run.system.bodies
        check(
            known,
            f"'{self.ring.body.name}' is not in the scene; add it, or remove the probe of its ring.",
        )
        if id(run.system) not in self._loops:
            self._loops = {id(run.system): Loop(self.ring, run.system)}
        return float(self._loops[id(run.system)].aperture(0.0))


def check_axis(axis: str) -> None:
    check(
        axis in AXES, f"A vector has no component {axis!r}; its components are: {', '.join(AXES)}."
    )
