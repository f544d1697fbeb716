"""Feedback by a law of the user: sampled probes, and the actuators that hold its commands.

Algorithm.  Before a step, if a sample is due, the run lets the law turn the values of the probes
into commands.  They are constant until the next sample (zero-order hold), so that a step is that of
constant loads, and a step that is rejected and made again has the same commands.  A step ends at
the time of the next sample at the latest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import KW_ONLY, dataclass
from functools import partial
from typing import Annotated, Any, ClassVar, cast

import numpy as np

from gossamer_fx.core.checks.arguments import (
    Direction,
    at_least,
    check_arguments,
    not_negative,
    positive,
)
from gossamer_fx.core.checks.errors import InputError, check
from gossamer_fx.core.checks.lookups import check_in_scene, check_once
from gossamer_fx.core.checks.user_functions import ask_numbers
from gossamer_fx.core.model.body import Array, unit
from gossamer_fx.core.model.state import HasSystem, Sampled, State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.bodies.frames import Frame, along, bodies_of
from gossamer_fx.mechanics.terms.assembly import Compiler, HistoryVariables
from gossamer_fx.mechanics.terms.loads import Couple, PointForce, PointLoad, PointLoads

# Fraction of a period by which a sample may be early, or a step too long: round-off of times.
SAMPLE_ROUND_OFF = 1e-9


# ---- forces of actuators -------------------------------------------------------------------------


class _Actuation(PointForce, HistoryVariables):
    """The force of an actuator on attached vectors, from n commands that are held: of a torque
    three [N m], of a thruster one [N], of a wheel one [N m].  It depends on earlier states by its
    command, so that it has no gradient."""

    def __init__(self, size: int) -> None:
        self.command: Array = np.zeros(size)
        self.work = 0.0  # since the start [J]

    def hold(self, t: float, command: Array) -> None:
        """Take a new command (n,) at a time [s]."""
        self.command = command

    def energy(self, t: float) -> float:
        """Kinetic energy of the actuator [J] at a time [s], beyond that of the body."""
        return 0.0

    def get_history(self) -> dict[str, Any]:
        return {"command": self.command.tolist(), "work": self.work}

    def set_history(self, state: dict[str, Any]) -> None:
        self.command = np.array(state["command"])
        self.work = state["work"]


class _HeldTorque(_Actuation, Couple):
    """The torque of a `BodyTorque`."""

    def __init__(self) -> None:
        Couple.__init__(self)
        _Actuation.__init__(self, 3)

    def force(self, X: Array) -> Array:
        self.torque = self.command
        return super().force(X)

    def tangent(self, X: Array) -> Array:
        self.torque = self.command
        return super().tangent(X)


class _Thrust(_Actuation):
    """The force of a `Thruster`, on the stacked vectors X (6,) of a point and a direction d."""

    def force(self, X: Array) -> Array:
        # The direction is divided by its length: it is shorter than 1 in the middle of a step.
        return np.concatenate([self.command * unit(X[3:]), np.zeros(3)])

    def tangent(self, X: Array) -> Array:
        # A unit vector changes across itself.
        d = unit(X[3:])
        K = np.zeros((6, 6))
        K[:3, 3:] = self.command * (np.eye(3) - np.outer(d, d)) / np.linalg.norm(X[3:])
        return K


class _WheelTorque(_Actuation, Couple):
    """The torque of a `ReactionWheel`, on the stacked vectors X of its axis a and of the frame.

    The wheel has the angular momentum l a, and dl/dt = -u with the command u.  In a step from 0 to
    1 of length h the body takes the torque

        T = -(l_1 a_1 - l_0 a_0)/h = u a_mid - (l_0 - u h/2) (a_mid - a_0)/(h/2)              (1)

    so that the sum of both angular momenta stays the same to round-off.  The second term does no
    work on a body that rotates rigidly from 0 to 1.
    """

    def __init__(self, inertia: float, spin: float) -> None:
        Couple.__init__(self)
        _Actuation.__init__(self, 1)
        self.inertia = inertia
        # At the time of the last command, (momentum [kg m²/s], time [s]).
        self._since = (inertia * spin, 0.0)
        # Of the present step: its axis and momentum at the start, and half of its length [s].
        self._axis0: Array = np.zeros(3)
        self._momentum0 = 0.0
        self._lag = 1.0

    def momentum(self, t: float) -> float:
        """Angular momentum of the wheel about its axis [kg m²/s] at a time [s]."""
        momentum, since = self._since
        return momentum - float(self.command[0]) * (t - since)

    def energy(self, t: float) -> float:
        return self.momentum(t) ** 2 / (2 * self.inertia)

    def hold(self, t: float, command: Array) -> None:
        self._since = (self.momentum(t), t)
        super().hold(t, command)

    def begin(self, t: float, lag: float, X: Array, V: Array) -> None:
        self._axis0 = X[:3]
        self._momentum0 = self.momentum(t)
        self._lag = lag

    def force(self, X: Array) -> Array:
        """Forces on the stacked vectors: zeros on the axis, then those of the torque (1) on the
        vectors of the frame."""
        self._set_torque(X[:3])
        return np.concatenate([np.zeros(3), super().force(X[3:])])

    def tangent(self, X: Array) -> Array:
        by_axis = self._set_torque(X[:3])
        K = np.zeros((X.size, X.size))
        K[3:, 3:] = super().tangent(X[3:])
        K[3:, :3] = self.forces_by_torque(X[3:]) * by_axis
        return K

    def _set_torque(self, axis: Array) -> float:
        """Set the torque (1) for the axis (3,) in the middle of the step; returns the factor of its
        derivative by the axis, a multiple of the unit matrix."""
        u = float(self.command[0])
        # (l_0 - u h/2)/(h/2)
        gyroscopic = self._momentum0 / self._lag - u
        self.torque = u * axis - gyroscopic * (axis - self._axis0)
        return u - gyroscopic

    def get_history(self) -> dict[str, Any]:
        return super().get_history() | {"since": list(self._since)}

    def set_history(self, state: dict[str, Any]) -> None:
        super().set_history(state)
        momentum, since = state["since"]
        self._since = (momentum, since)


class Actuators(PointLoads):
    """All actuators of a scene, with what their wheels add to momentum and energy."""

    def _actuations(self) -> Iterable[tuple[int, _Actuation]]:
        """The laws of all terms, each with its number."""
        return enumerate(cast("list[_Actuation]", self._laws))

    def begin_search(self) -> None:
        """Refuse equilibria: a command needs the time."""
        raise InputError(
            f"'{self._terms[0].name}' is an actuator of a feedback, which acts in runs only; "
            "leave the feedback out of this scene."
        )

    def without_gradient(self) -> str:
        return (
            f"'{self._terms[0].name}' is an actuator of a feedback, "
            "whose law has no known derivatives; leave the feedback out of the scene"
        )

    def supplied(self) -> float:
        """Work of the step [J] on bodies and wheels, this rank's share."""
        t = self._system.time
        total = 0.0
        ends = list(zip(self._X0, self._vectors(self._system.q1), self._middle(), strict=True))
        for k, actuation in self._actuations():
            X0, X1, X = ends[k]
            work = float(self._laws[k].force(X) @ (X1 - X0))
            if not self._system.rule.is_static:
                work += actuation.energy(t + self._system.h) - actuation.energy(t)
            # The system asks once in each accepted step.
            actuation.work += work
            if self._mine[k]:
                total += work
        return total

    def energies(self) -> dict[str, float]:
        found: dict[str, float] = {}
        for k, actuation in self._actuations():
            if isinstance(actuation, _WheelTorque):
                energy = actuation.energy(self._system.time) if self._mine[k] else 0.0
                found[self._terms[k].name] = energy
        return found

    def momenta(self) -> Array:
        return np.array([np.zeros(3), self.wheel_momentum()])

    def wheel_momentum(self) -> Array:
        total = np.zeros(3)
        vectors = self._vectors(self._system.q0)
        for k, actuation in self._actuations():
            if isinstance(actuation, _WheelTorque) and self._mine[k]:
                total += actuation.momentum(self._system.time) * vectors[k][:3]
        return total


# ---- actuators -----------------------------------------------------------------------------------


@check_arguments
@dataclass(frozen=True, eq=False)
class BodyTorque:
    """An actuator of a `Feedback`: a torque on a frame; its command is three numbers [N m] in space
    axes.

    Args:
        frame: of a rigid body, a beam's section, or a `patch` of a film.
        name: of the actuator in messages and output.

    Example:
        >>> gx.control.BodyTorque(hub.frame()).name
        'torque'
    """

    frame: Frame
    _: KW_ONLY
    name: str = "torque"
    commands: ClassVar[int] = 3

    def _load(self, controller: _Controller) -> _ActuatorLoad:
        return _ActuatorLoad(self.name, self.frame.directors, _HeldTorque(), controller=controller)


@check_arguments
@dataclass(frozen=True, eq=False)
class Thruster:
    """An actuator of a `Feedback`: a force along a direction that turns with a frame; its command
    is the force [N].

    Args:
        frame: of a rigid body, at the point on which the force acts.
        direction: of a positive force at the start, in space axes, of any length.
        name: of the actuator in messages and output.

    Raises:
        InputError: a direction without length; at the start of a run: a frame that has none.

    Example:
        >>> gx.control.Thruster(hub.frame((0.0, 0.1, 0.0)), (1.0, 0.0, 0.0)).name
        'thruster'
    """

    frame: Frame
    direction: Direction
    _: KW_ONLY
    name: str = "thruster"
    commands: ClassVar[int] = 1

    def _load(self, controller: _Controller) -> _ActuatorLoad:
        ports = (self.frame.origin, along(unit(self.direction), self.frame))
        return _ActuatorLoad(self.name, ports, _Thrust(1), controller=controller)


@check_arguments
@dataclass(frozen=True, eq=False)
class ReactionWheel:
    """An actuator of a `Feedback`: a wheel in a body; its command is the torque on the body about
    the axis [N m], the wheel takes the opposite one.

    The ledger has the wheel's angular momentum and, by its name, its kinetic energy; the work of
    the motor counts as supplied.  The inertia of the body is without that of the wheel about the
    axis, and with its mass and its inertia across.

    Args:
        frame: of a rigid body.
        axis: of the wheel at the start, in space axes, of any length.
        inertia: of the wheel about the axis [kg m²].
        spin: rate of the wheel about the axis at the start, in inertial space [rad/s].
        name: of the actuator in messages and output.

    Raises:
        InputError: an axis without length; at the start of a run: a frame that has no such axis.

    Example:
        >>> gx.control.ReactionWheel(hub.frame(), (0.0, 0.0, 1.0), inertia=1e-3).spin
        0.0
    """

    frame: Frame
    axis: Direction
    _: KW_ONLY
    inertia: Annotated[float, positive("kg m²")]
    spin: float = 0.0
    name: str = "reaction wheel"
    commands: ClassVar[int] = 1

    def _load(self, controller: _Controller) -> _ActuatorLoad:
        ports = (along(unit(self.axis), self.frame), *self.frame.directors)
        law = _WheelTorque(self.inertia, self.spin)
        return _ActuatorLoad(self.name, ports, law, controller=controller)


Actuator = BodyTorque | Thruster | ReactionWheel


# ---- the feedback --------------------------------------------------------------------------------


class _Controller(HistoryVariables):
    """The law of a feedback at work: its samples, delayed commands and discrete state."""

    def __init__(self, state: Array) -> None:
        self.start: float | None = None  # time of the first sample [s]; None before
        self.samples = 0
        self.delayed: list[Array] = []  # commands (n,) that are yet to act, the next one first
        self.state = state

    def get_history(self) -> dict[str, Any]:
        return {
            "start": self.start,
            "samples": self.samples,
            "delayed": [command.tolist() for command in self.delayed],
            "state": self.state.tolist(),
        }

    def set_history(self, state: dict[str, Any]) -> None:
        self.start = state["start"]
        self.samples = state["samples"]
        self.delayed = [np.array(command) for command in state["delayed"]]
        self.state = np.array(state["state"])


@dataclass(frozen=True, eq=False)
class _ActuatorLoad(PointLoad):
    """The load of an actuator, and the controller of its feedback, whose history it carries."""

    compiler: ClassVar[Compiler] = Actuators
    _: KW_ONLY
    controller: _Controller


@check_arguments
@dataclass(frozen=True, eq=False)
class Feedback(Sampled):
    """A control law of the user: sampled measurements, commands that are held, and actuators.

    At each sample the law is called once, on every rank, as `law(t, values)`, with the time [s] and
    the values (m,) of the measures; it returns the commands of all actuators, one after the other.
    With a `state` it is called as `law(t, values, state)`, and returns commands and the next state.
    Commands are constant from sample to sample, and zero before the first one acts.

    A restart has the same commands and state, but not what a function keeps elsewhere.

    Args:
        measures: probes, e.g. `gx.probes.AngularVelocity`; functions of the run that return the
            same number on every rank.
        law: the function.
        actuators: one or more `BodyTorque`, `Thruster` or `ReactionWheel`, of different names.
        period: time from sample to sample [s], at least the stepper's dt; steps end at samples.
        delay: number of samples after which a command acts.
        state: numbers that the law keeps from sample to sample, e.g. an integral or an estimate.
        name: for messages.

    Raises:
        InputError: no measures or actuators, two actuators of one name, a negative delay; in a run:
            a period shorter than dt, or a law that returns other than it must.

    Example:
        >>> wheel = gx.control.ReactionWheel(hub.frame(), (0.0, 0.0, 1.0), inertia=1e-3)
        >>> rate = gx.probes.AngularVelocity(hub.frame(), "z")
        >>> feedback = gx.control.Feedback(
        ...     [rate], lambda t, values: -0.1 * (values - 0.02), [wheel], period=0.1
        ... )
        >>> run = gx.Simulation(gx.Scene(feedback), gx.Midpoint(dt=0.1))
        >>> run.run(until=0.1)
        >>> feedback.commands(run).round(6)
        array([0.002])
    """

    measures: Annotated[Sequence[Callable[..., Any]], at_least(1)]
    law: Callable[..., Any]
    actuators: Annotated[Sequence[Actuator], at_least(1)]
    _: KW_ONLY
    period: Annotated[float, positive("s")]
    delay: Annotated[int, not_negative()] = 0
    state: Sequence[float] = ()
    name: str = "feedback"

    def __post_init__(self) -> None:
        names = [actuator.name for actuator in self.actuators]
        check_once(f"Feedback '{self.name}': the actuator", names)

    def requires(self) -> Iterable[Any]:
        for actuator in self.actuators:
            yield from bodies_of(actuator.frame)

    def terms(self, start: State) -> Iterable[Term]:
        controller = _Controller(np.array(self.state, dtype=float))
        for actuator in self.actuators:
            yield actuator._load(controller)

    def before_step(self, run: Any, h: float) -> float:
        """Sample, if that is due; the run calls it before a step of length h [s].  Returns the
        length up to the next sample, if that is shorter.  Collective."""
        dt = run.stepper.dt
        check(
            self.period >= dt * (1 - SAMPLE_ROUND_OFF),
            f"Feedback '{self.name}': its period of {self.period:g} s is shorter than the step "
            f"dt = {dt:g} s; give a longer period or a smaller dt.",
        )
        controller = self._loads(run)[0].controller
        t = run.time
        if controller.start is None:
            controller.start = t
        # From the number of samples, so that round-off does not accumulate.
        due = controller.start + controller.samples * self.period
        if t >= due - SAMPLE_ROUND_OFF * self.period:
            self._sample(run, controller)
            due += self.period
        remaining = due - t
        # A step that ends there but for round-off remains as long as the others.
        return h if h <= remaining * (1 + SAMPLE_ROUND_OFF) else remaining

    def _sample(self, run: Any, controller: _Controller) -> None:
        """Measure, call the law and give the actuators its commands, or with a delay those of an
        earlier sample, zeros if there is none yet.  Collective."""
        t = run.time
        where = f"Feedback '{self.name}' at t = {t:.6g} s"
        values = []
        for k, measure in enumerate(self.measures):
            value = ask_numbers(run.comm, f"{where}, measure {k + 1}", partial(measure, run))
            values.append(float(value))
        size = sum(actuator.commands for actuator in self.actuators)

        def answer() -> Array:
            """The commands of the law, and after them its next state."""
            if not len(controller.state):
                return np.atleast_1d(self.law(t, np.array(values)))
            command, state = self.law(t, np.array(values), controller.state.copy())
            check(
                np.size(command) == size and np.shape(state) == controller.state.shape,
                f"its law returns {np.size(command)} commands and {np.size(state)} numbers of the "
                f"state; it must return {size} and {len(controller.state)}.",
            )
            return np.concatenate([np.ravel(command), np.ravel(state)])

        answered = ask_numbers(run.comm, where, answer, (size + len(controller.state),))
        controller.delayed.append(answered[:size])
        command: Array = np.zeros(size)
        if len(controller.delayed) > self.delay:
            command = controller.delayed.pop(0)
        start = 0
        for load, actuator in zip(self._loads(run), self.actuators, strict=True):
            actuation = cast("_Actuation", load.law)
            actuation.hold(t, command[start : start + actuator.commands])
            start += actuator.commands
        controller.state = answered[size:]
        controller.samples += 1

    def commands(self, run: HasSystem) -> Array:
        """The commands (n,) of the last step, of all actuators, one after the other."""
        return np.concatenate([law.command for law in self._actuations(run).values()])

    def work(self, run: HasSystem) -> dict[str, float]:
        """Work that each actuator has done since the start [J], by its name."""
        return {name: law.work for name, law in self._actuations(run).items()}

    def spins(self, run: HasSystem) -> dict[str, float]:
        """Rate of each reaction wheel in inertial space [rad/s], by its name."""
        return {
            name: law.momentum(run.system.unknowns.time) / law.inertia
            for name, law in self._actuations(run).items()
            if isinstance(law, _WheelTorque)
        }

    def _loads(self, run: HasSystem) -> Sequence[_ActuatorLoad]:
        """The loads of the actuators in the scene of a run; `InputError` if there are none."""
        loads = run.system.unknowns.terms_of(self)
        check_in_scene(f"Feedback '{self.name}'", bool(loads))
        return cast("Sequence[_ActuatorLoad]", loads)

    def _actuations(self, run: HasSystem) -> dict[str, _Actuation]:
        """The laws of the actuators, by the names of the actuators."""
        return {load.name: cast("_Actuation", load.law) for load in self._loads(run)}
