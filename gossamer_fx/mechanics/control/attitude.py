"""Attitude control of rigid and flexible bodies by proportional-derivative torques."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Annotated, Any, Self

import numpy as np

from gossamer_fx.core.checks.arguments import check_arguments, not_negative
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array, Port, Vector, combine
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Parameter, Term
from gossamer_fx.mechanics.bodies.frames import Frame, bodies_of
from gossamer_fx.mechanics.control.rotation import (
    euler_angles,
    euler_axes,
    position_gradient,
    position_gradient_derivative,
    rotation,
    rotation_derivative,
)
from gossamer_fx.mechanics.terms.assembly import HistoryVariables
from gossamer_fx.mechanics.terms.point_loads import Couple, PointLoad

# Fraction of a period by which a sample may be early: the round-off of summed times.
SAMPLE_ROUND_OFF = 1e-9

# Displacement of the vectors, over their length, in the difference that gives the rates of angles.
RATE_DIFFERENCE = 1e-6

# Smallest velocity [m/s] that is divided by, against division by zero.
TINY_VELOCITY = 1e-12

# Largest error of an entry of AᵀA for a rotation matrix A of the user.
ORTHONORMALITY = 1e-9

# Second singular value of the frame's vectors below which they are parallel.
PARALLEL = 1e-9


@check_arguments
def patch(centre: Port, points: Sequence[Port]) -> Frame:
    """A frame whose directors are the arms from a centre to points around it.

    Its position gradient is the average of that of a piece of a flexible body.  A torque on it is
    distributed to the points, with the opposite forces at the centre.

    Args:
        centre: point of the piece.
        points: two or more points around it, of the same body.

    Returns:
        The frame; its directors are arms in m, neither unit vectors nor orthogonal.

    Raises:
        InputError: a point is of another body than the centre.

    Example:
        >>> corners = [film.port_at((0.25, 0.25, 0.0)), film.port_at((0.75, 0.25, 0.0))]
        >>> frame = gx.control.patch(film.port_at((0.5, 0.5, 0.0)), corners)
        >>> len(frame.directors)
        2
    """
    arms = [combine((1.0, -1.0), (point, centre)) for point in points]
    return Frame(centre, tuple(arms))


class _ControlTorque(Couple):
    """The torque of an `AttitudeControl`, whose gains are its numbers; `reference` has the frame's
    vectors (k, 3) at the start of the run."""

    def __init__(self, control: AttitudeControl, reference: Array) -> None:
        super().__init__()
        self._control = control
        self._reference = reference


class _SampledTorque(_ControlTorque, HistoryVariables):
    """The torque of an `AttitudeControl` that is computed once a period and held constant in
    between."""

    depends_on_position_only = False

    def __init__(self, control: AttitudeControl, reference: Array) -> None:
        super().__init__(control, reference)
        self._next_sample: float | None = None  # time [s]; None before the first sample

    def begin(self, t: float, lag: float, X: Array, V: Array) -> None:
        """Start a step, and compute a new torque (3,) [N m] if a sample is due."""
        control = self._control
        if self._next_sample is None:
            self._next_sample = t
        if t >= self._next_sample - SAMPLE_ROUND_OFF * control.period:
            # From the time at which it was due, so that lateness does not accumulate.
            self._next_sample += control.period
            self.torque = control.sample(X, V, self._reference)

    def get_history(self) -> dict[str, Any]:
        control = self._control
        return {
            "due": self._next_sample,
            "torque": self.torque.tolist(),
            "angles": control.angles.tolist(),
            "torques": control.torques.tolist(),
        }

    def set_history(self, state: dict[str, Any]) -> None:
        self._next_sample = state["due"]
        self.torque = np.array(state["torque"])
        self._control.angles = np.array(state["angles"])
        self._control.torques = np.array(state["torques"])


class _ContinuousTorque(_ControlTorque):
    """The torque of an `AttitudeControl` that follows the motion within the step.

    Angles are those at the middle of the step, rates are differences over it.  The damping then
    does the work -K_d (Δα)²/h on each angle α: it dissipates at every frequency and for every step
    length h.
    """

    def __init__(self, control: AttitudeControl, reference: Array) -> None:
        super().__init__(control, reference)
        self._h = 1.0
        self._X0: Array = reference.ravel()
        self._has_begun = False

    def get_number(self, key: str) -> Array:
        return np.array(getattr(self._control, key))

    def with_number(self, key: str, value: Array) -> Self:
        setattr(self._control, key, np.array(value))
        return self

    def begin(self, t: float, lag: float, X: Array, V: Array) -> None:
        # Length of the step [s], and vectors (3k,) at its start.
        self._h = 2 * lag
        self._X0 = X
        self._has_begun = True
        # For the attributes of the control, which hold the values at the start of the step.
        self._control.sample(X, V, self._reference)

    def force(self, X: Array) -> Array:
        control = self._control
        torques, _ = self._torques(X)
        self.torque = control.in_space(control.angles_of(X, self._reference), torques)
        return super().force(X)

    def tangent(self, X: Array) -> Array:
        """Derivatives (3k, 3k) of the forces on the frame's vectors, whose product with a vector is
        a moment [N m], by the vectors in the middle of the step.  Zero before the first step, where
        only the pattern of the matrix is needed."""
        # The pattern of the tangent is made before the first step, without vectors.
        if not self._has_begun:
            return np.zeros((X.size, X.size))
        control = self._control
        torques, _ = self._torques(X)
        angles = control.angles_of(X, self._reference)
        of_middle = control.angles_by_vectors(X, self._reference)
        # A change of X in the middle is twice as large at the end, 2 X - X0 with the vectors X0 at
        # the start, from which the rate is computed.
        of_end = 2 * control.angles_by_vectors(2 * X - self._X0, self._reference)
        of_torques = -control.stiffness[:, None] * of_middle
        of_torques -= (control.damping / self._h)[:, None] * of_end
        change_of_torque = control.torque_derivative(angles, torques, of_middle, of_torques)
        self.torque = control.in_space(angles, torques)
        return super().tangent(X) + self.forces_by_torque(X) @ change_of_torque

    def _torques(self, X: Array) -> tuple[Array, Array]:
        """Torques (3,) [N m] about the axes of the angles, and the rates (3,) [rad/s] of the
        angles."""
        control = self._control
        middle = control.angles_of(X, self._reference)
        before = control.angles_of(self._X0, self._reference)
        after = control.angles_of(2 * X - self._X0, self._reference)
        rates = wrapped(after - before) / self._h
        return control.law(middle, rates), rates

    def force_by_number(self, key: str, X: Array) -> Array:
        control = self._control
        angles = control.angles_of(X, self._reference)
        by_gain = wrapped(control.target - angles)
        if key == "damping":
            by_gain = -self._torques(X)[1]
        axes = euler_axes(angles) @ control.axes.T
        return self.forces_by_torque(X) @ (axes.T * by_gain)


def wrapped(angles: Array) -> Array:
    """Differences of angles [rad], in [-π, π)."""
    return np.remainder(angles + np.pi, 2 * np.pi) - np.pi


def _three_by_three(axes: object) -> Array:
    """The argument as a matrix (3, 3); zeros, which no check accepts, if it is not one."""
    try:
        matrix = np.asarray(axes, dtype=float)
    except (TypeError, ValueError):
        return np.zeros((3, 3))
    if matrix.shape != (3, 3):
        return np.zeros((3, 3))
    return matrix


@check_arguments
class AttitudeControl:
    """Proportional-derivative torque on a body whose attitude is that of its position gradient.

    The position gradient F at the frame is decomposed, F = R U, and R into Euler angles relative to
    the start, R = R_w(γ) R_v(β) R_u(θ).  About the axis of each angle α acts the torque

        T = K_p (target - α) - K_d dα/dt,                                                     (1)

    with target - α between -π and π (the shorter way).  It acts on the frame's vectors, and its
    work counts as supplied.

    Args:
        frame: of a rigid body, a beam's section, or a `patch` of a film.
        target: (θ, β, γ) [rad].
        stiffness: K_p [N m/rad], one number or three.
        damping: K_d [N m s/rad], one number or three.
        axes: rotation matrix whose columns are u, v, w in space at the start.
        period: time for which a sampled torque is held [s]; 0 lets it follow the motion also within
            a step.
        name: for messages.

    Attributes:
        angles: (θ, β, γ) [rad] at the last sample; for period 0, at the start of the step.
        torques: (1) at the same time [N m], (3,).

    Raises:
        InputError: the frame has no position gradient, a gain is negative, or the axes are not a
            rotation matrix.

    Example:
        >>> control = gx.control.AttitudeControl(
        ...     hub.frame(), (0.0, 0.0, 0.1), stiffness=2.0, damping=0.3
        ... )
        >>> run = gx.Simulation(gx.Scene(hub, control), gx.Midpoint(dt=0.1))
        >>> run.run(until=0.1)
        >>> round(float(control.torques[2]), 3)
        0.2
    """

    def __init__(
        self,
        frame: Frame,
        target: Vector,
        *,
        stiffness: float | Vector,
        damping: float | Vector,
        axes: Sequence[Sequence[float]] = ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
        period: Annotated[float, not_negative("s")] = 0.0,
        name: str = "attitude control",
    ) -> None:
        check(
            len(frame.directors) >= 2,
            f"'{name}' acts on something without position gradient; "
            "give the frame of a rigid body or beam, or a patch of a film.",
        )
        self.frame = frame
        self.period = period
        self.name = name
        self.target = np.asarray(target, dtype=float)
        self.stiffness = np.broadcast_to(np.asarray(stiffness, dtype=float), 3)
        self.damping = np.broadcast_to(np.asarray(damping, dtype=float), 3)
        check(
            bool((self.stiffness >= 0).all() and (self.damping >= 0).all()),
            f"'{name}': "
            f"gains {self.stiffness.tolist()} N m/rad and {self.damping.tolist()} N m s/rad; "
            "none may be negative.",
        )
        self.axes = _three_by_three(axes)
        is_orthonormal = np.allclose(self.axes.T @ self.axes, np.eye(3), atol=ORTHONORMALITY)
        check(
            bool(is_orthonormal and np.linalg.det(self.axes) > 0),
            f"'{name}': its axes are not right-handed and orthonormal; "
            "give a rotation matrix with columns u, v, w.",
        )
        self.angles: Array = np.zeros(3)
        self.torques: Array = np.zeros(3)

    def requires(self) -> Iterable[Any]:
        yield from bodies_of(self.frame)

    def terms(self, start: State) -> Iterable[Term]:
        reference = self.reference()
        gains = (
            Parameter("stiffness", "N m/rad", "stiffness"),
            Parameter("damping", "N m s/rad", "damping"),
        )
        torque: _SampledTorque | _ContinuousTorque = _ContinuousTorque(self, reference)
        if self.period > 0:
            torque = _SampledTorque(self, reference)
        yield PointLoad(self.name, self.frame.directors, torque, gains)

    def reference(self) -> Array:
        """The frame's k vectors (k, 3) at the start: unit vectors, or arms [m] of a `patch`, not
        parallel. Collective."""
        vectors = np.array([director.initial() for director in self.frame.directors])
        singular_values = np.linalg.svd(vectors)[1]
        check(
            bool(singular_values[1] > PARALLEL),
            f"'{self.name}': the vectors of its frame are parallel, which leaves a rotation open; "
            "give others.",
        )
        return vectors

    def angles_of(self, X: Array, reference: Array) -> Array:
        """(θ, β, γ) [rad] of the frame's stacked vectors X (3k,), relative to the reference (k,
        3)."""
        R = rotation(position_gradient(X.reshape(-1, 3), reference))
        return euler_angles(self.axes.T @ R @ self.axes)

    def angles_by_vectors(self, X: Array, reference: Array) -> Array:
        """Derivatives (3, 3k) of `angles_of` with respect to the stacked vectors X (3k,)."""
        vectors = X.reshape(-1, 3)
        F = position_gradient(vectors, reference)
        of_rotation = rotation_derivative(F, position_gradient_derivative(vectors, reference))
        axes = euler_axes(self.angles_of(X, reference)) @ self.axes.T
        return np.linalg.solve(axes.T, of_rotation)

    def sample(self, X: Array, V: Array, reference: Array) -> Array:
        """The torque in space axes [N m], (3,), in a state of the frame: stacked vectors X (3k,) in
        the unit of `reference` (k, 3), the vectors at the start, and rates V (3k,) per second.  It
        sets `angles` [rad] and `torques` [N m]."""
        # Rates of angles by central differences over a time dt [s] in which the vectors hardly
        # change.
        dt = RATE_DIFFERENCE * np.abs(X).max() / max(float(np.abs(V).max()), TINY_VELOCITY)
        ahead = self.angles_of(X + dt * V, reference)
        behind = self.angles_of(X - dt * V, reference)
        self.angles = self.angles_of(X, reference)
        self.torques = self.law(self.angles, wrapped(ahead - behind) / (2 * dt))
        return self.in_space(self.angles, self.torques)

    def law(self, angles: Array, rates: Array) -> Array:
        """Torques (1) about the axes of the three angles [N m], for angles [rad] and rates
        [rad/s]."""
        return self.stiffness * wrapped(self.target - angles) - self.damping * rates

    def torque_derivative(
        self, angles: Array, torques: Array, of_angles: Array, of_torques: Array
    ) -> Array:
        """Derivatives (3, m) [N m] of `in_space`, at angles (θ, β, γ) [rad] and torques (3,) [N m]
        about their axes, for m changes of the angles (3, m) and of the torques (3, m)."""
        axes = euler_axes(angles) @ self.axes.T
        # The axes of the first two angles turn with the angles behind them.
        turn_of_second = np.outer(axes[2], of_angles[2])
        turn_of_first = turn_of_second + np.outer(axes[1], of_angles[1])
        change: Array = axes.T @ of_torques
        change += torques[0] * np.cross(turn_of_first, axes[0], axisa=0, axisc=0)
        change += torques[1] * np.cross(turn_of_second, axes[1], axisa=0, axisc=0)
        return change

    def in_space(self, angles: Array, torques: Array) -> Array:
        """Sum in space axes [N m], (3,), of torques about the axes of the angles [rad]."""
        return self.axes @ (euler_axes(angles).T @ torques)
