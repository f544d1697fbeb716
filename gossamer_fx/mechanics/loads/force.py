"""Forces and torques on points and frames of bodies."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.algebra.point_measures import PointPort
from gossamer_fx.core.checks.arguments import at_least, check_arguments
from gossamer_fx.core.checks.user_functions import ask_numbers
from gossamer_fx.core.model.body import Array, Attached, Port, Vector
from gossamer_fx.core.model.item import Item
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Parameter, Term
from gossamer_fx.mechanics.bodies.frames import Frame, Line, bodies_of
from gossamer_fx.mechanics.terms.loads import Couple, PointForce, PointLoad

# A force [N] or torque [N m] as a function of time [s].
History = Callable[[float], Sequence[float]]


@dataclass(frozen=True)
class ConstantForce(PointForce):
    """Forces (3k,) [N] that never change, a vector that is one number of the load."""

    value: Array
    depends_on_position_only = True

    def force(self, X: Array) -> Array:
        return self.value

    def tangent(self, X: Array) -> Array:
        return np.zeros((X.size, X.size))

    def get_number(self, key: str) -> Array:
        return self.value

    def with_number(self, key: str, value: Array) -> ConstantForce:
        return ConstantForce(value)

    def force_by_number(self, key: str, X: Array) -> Array:
        """Derivatives (3k, 3k) of the forces by themselves."""
        return np.eye(X.size)


class ForceInTime(PointForce):
    """Force (3,) [N] as a function of time [s], taken where forces act, e.g. at the middle of the
    step; `factor` multiplies it, and is a parameter of gradients."""

    depends_on_position_only = True

    def __init__(self, comm: MPI.Intracomm, name: str, value: History) -> None:
        self._comm = comm
        self._name = name
        self._value = value
        self._now: Array = np.zeros(3)
        self._time = math.nan
        self.factor = 1.0

    def begin(self, t: float, lag: float, X: Array, V: Array) -> None:
        # Once a step, also for a force on many points: that all ranks compare costs a message.
        if t + lag != self._time:
            self._time = t + lag
            self._now = at_time(self._comm, self._name, self._value, self._time)

    def force(self, X: Array) -> Array:
        return self.factor * self._now

    def tangent(self, X: Array) -> Array:
        return np.zeros((3, 3))

    def get_number(self, key: str) -> Array:
        return np.array([self.factor])

    def with_number(self, key: str, value: Array) -> ForceInTime:
        changed = ForceInTime(self._comm, self._name, self._value)
        changed.factor = float(value[0])
        return changed

    def force_by_number(self, key: str, X: Array) -> Array:
        """Derivative (3, 1) [N] of the force by `factor`, the only number."""
        return self._now[:, None]


def at_time(comm: MPI.Intracomm, name: str, value: History, t: float) -> Array:
    """value(t) as three finite numbers, the same on every rank."""
    return ask_numbers(comm, f"'{name}' at t = {t:.6g} s", lambda: value(t), (3,))


class TorqueInTime(Couple):
    """Torque (3,) in space axes as a function of time, taken where forces act, e.g. at the middle
    of the step."""

    def __init__(self, comm: MPI.Intracomm, name: str, value: History) -> None:
        super().__init__()
        self._comm = comm
        self._name = name
        self._value = value

    def begin(self, t: float, lag: float, X: Array, V: Array) -> None:
        self.torque = at_time(self._comm, self._name, self._value, t + lag)


@check_arguments
@dataclass(frozen=True, eq=False)
class Force(Item):
    """A force on a point of a body, or on each of several points; its work counts as supplied.

    Args:
        port: the point, e.g. `film.port("tip")`, or points, e.g. `film.ports("rim")`.
        force: [N] on each point in space axes, three numbers or a function of time [s] that returns
            them.
        name: name in messages and output.

    Raises:
        InputError: a port that is a direction, or no port; during a run: a force that is not
            finite.

    Example:
        >>> push = gx.loads.Force(mass.port(), lambda t: (np.sin(t), 0.0, 0.0))
        >>> push.name
        'force'
    """

    port: PointPort | Annotated[Sequence[PointPort], at_least(1)]
    force: Vector | History
    _: KW_ONLY
    name: str = "force"

    @property
    def _ports(self) -> Sequence[Port]:
        return [self.port] if isinstance(self.port, Port) else self.port

    def requires(self) -> Iterable[Any]:
        for port in self._ports:
            yield port.body

    def terms(self, start: State) -> Iterable[Term]:
        """A load on each point; numbers, and a factor of a function of time, are parameters of
        gradients."""
        value = self.force
        law: PointForce
        if callable(value):
            law = ForceInTime(self._ports[0].body.comm, self.name, value)
            # A function of time belongs to its user; a gradient has the number that multiplies it.
            parameters = (Parameter("factor", "", "factor"),)
        else:
            law = ConstantForce(np.asarray(value, dtype=float))
            parameters = (Parameter("force", "N", "value"),)
        for port in self._ports:
            yield PointLoad(self.name, (port,), law, parameters)


@check_arguments
@dataclass(frozen=True, eq=False)
class Torque(Item):
    """A torque on a rigid body, a beam's section or a `RigidRegion`; its work counts as supplied.

    Args:
        frame: what it turns, e.g. `body.frame()`, or the line of a straight region, on which the
            torque across it acts.
        torque: [N m] in space axes, three numbers or a function of time [s] that returns them.
        name: name in messages and output.

    Raises:
        InputError: during a run: a torque that is not finite.

    Example:
        >>> gx.loads.Torque(hub.frame(), (0.0, 0.0, 0.5)).torque
        (0.0, 0.0, 0.5)
    """

    frame: Frame | Line
    torque: Vector | History
    _: KW_ONLY
    name: str = "torque"

    def requires(self) -> Iterable[Any]:
        yield from bodies_of(self.frame)

    def terms(self, start: State) -> Iterable[Term]:
        vectors: tuple[Attached, ...] = self.frame.directors
        value = self.torque
        law: PointForce
        if callable(value):
            comm = next(iter(self.requires())).comm
            law = TorqueInTime(comm, self.name, value)
        else:
            law = Couple()
            law.torque = np.asarray(value, dtype=float)
        yield PointLoad(self.name, vectors, law)
