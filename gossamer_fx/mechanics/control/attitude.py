"""Attitude control: proportional-derivative torques about the Euler angles of a frame on a rigid
body, a beam's section or a patch of a film.

Idea.  A piece of a flexible body has no rotation matrix.  The position gradient F of its frame maps
the vectors of the frame at the start to the present ones; R of the polar decomposition F = R U is
its rotation, of which the Euler angles are taken.  Equation (1) of `AttitudeControl` gives a torque
about the axis of each angle.  `_SampledTorque` holds it for a period, `_ContinuousTorque` lets it
follow the motion within a step; both have derivatives, for gradients of runs.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from copy import copy
from typing import Annotated, Any, Self

import numpy as np

from gossamer_fx.core.checks.arguments import NOT_NEGATIVE, check_arguments, not_negative
from gossamer_fx.core.checks.errors import check, real_numbers
from gossamer_fx.core.model.body import Array, Port, Vector, combine, unit
from gossamer_fx.core.model.item import Item
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Parameter, Term
from gossamer_fx.mechanics.bodies.frames import Frame, TurningFrame, bodies_of
from gossamer_fx.mechanics.terms.assembly import HistoryVariables
from gossamer_fx.mechanics.terms.loads import Couple, ForceOfStart, PointLoad

# Eigenvalue of a moment matrix over the largest one below which the vectors lie in a plane.
FLATNESS = 1e-9


def position_gradient(vectors: Array, reference: Array) -> Array:
    """F (3, 3) such that F maps the k reference vectors (k, 3), not all parallel, to the present
    ones (k, 3) in the same unit, in least squares.

    Vectors that lie in a plane determine F in that plane only; F then maps the normal of the
    reference plane to the unit normal of the present one, and is not finite if the present vectors
    are parallel.
    """
    weights, in_plane, normal = _weights(reference)
    if normal is None:
        return vectors.T @ weights
    images = vectors.T @ weights
    image_of_normal = unit(np.cross(images[:, 0], images[:, 1]))
    F = images @ in_plane.T + np.outer(image_of_normal, normal)
    return F


def _weights(reference: Array) -> tuple[Array, Array, Array | None]:
    """Weights (k, b), orthonormal axes (3, b) and a normal (3,) of the k reference vectors (k, 3).

    vectorsᵀ weights are, in least squares, the images (3, b) of the axes under the map from the
    reference to other vectors (k, 3); the weights have the inverse unit of the reference.  If the
    reference spans space (all eigenvalues of its moments above 1e-9 of the largest), the axes are
    those of space, b = 3, and the normal is None.  Else the axes lie in its plane, b = 2, and the
    normal is that of the plane, right-handed with them.
    """
    moments = reference.T @ reference
    decomposition = np.linalg.eigh(moments)
    eigenvalues = decomposition.eigenvalues
    spans = eigenvalues > FLATNESS * eigenvalues[-1]
    if spans.all():
        return reference @ np.linalg.inv(moments), np.eye(3), None
    in_plane = decomposition.eigenvectors[:, spans]
    normal = decomposition.eigenvectors[:, ~spans][:, 0]
    # A right-handed basis, so that det F > 0.
    if np.linalg.det(np.column_stack([in_plane, normal])) < 0:
        normal = -normal
    return reference @ in_plane / eigenvalues[spans], in_plane, normal


def position_gradient_derivative(vectors: Array, reference: Array) -> Array:
    """Derivatives (3, 3, 3k) of `position_gradient` by the k present vectors, flattened, in their
    inverse unit."""
    weights, in_plane, normal = _weights(reference)
    if normal is None:
        return _derivative_of_product(weights)
    # The images of both axes in the plane; `of_images` and the like are derivatives (.., 3k).
    first = vectors.T @ weights[:, 0]
    second = vectors.T @ weights[:, 1]
    of_images = _derivative_of_product(weights)
    across = np.cross(first, second)
    length = np.linalg.norm(across)
    direction = across / length
    of_across = np.cross(of_images[:, 0], second, axisa=0, axisb=0, axisc=0)
    of_across = of_across + np.cross(first, of_images[:, 1], axisa=0, axisb=0, axisc=0)
    # A unit vector changes across itself.
    of_normal = (of_across - np.outer(direction, direction @ of_across)) / length
    in_plane_part = np.einsum("ibm,jb->ijm", of_images, in_plane)
    return in_plane_part + np.einsum("im,j->ijm", of_normal, normal)


def _derivative_of_product(weights: Array) -> Array:
    """Derivatives (3, b, 3k) of vectorsᵀ weights, weights (k, b), with respect to the vectors (k,
    3), flattened."""
    k, columns = weights.shape
    blocks = np.einsum("ic,kb->ibkc", np.eye(3), weights)
    return np.asarray(blocks.reshape(3, columns, 3 * k))


def rotation_derivative(F: Array, of_F: Array) -> Array:
    """Changes δω (3, m) [rad] of the rotation R = `rotation(F)` of a position gradient F of
    positive determinant, for m changes δF (3, 3, m) of it, the argument `of_F`.

    With F = V R, V symmetric, δF Rᵀ = δV + V [δω]×, of which the skew part is (tr V 1 - V) δω.
    """
    R = rotation(F)
    V = F @ R.T
    turned = np.einsum("ijm,kj->ikm", of_F, R)
    skew = turned - turned.transpose(1, 0, 2)
    axial = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
    return np.linalg.solve(np.trace(V) * np.eye(3) - V, axial)


def rotation(F: Array) -> Array:
    """R (3, 3) of the polar decomposition F = R U, U symmetric and positive definite, for det F >
    0."""
    U, _, Vt = np.linalg.svd(F)
    return U @ Vt


def euler_angles(R: Array) -> Array:
    """(θ, β, γ) [rad] of R = R_w(γ) R_v(β) R_u(θ); θ and γ in (-π, π], β in [-π/2, π/2]."""
    θ = np.arctan2(R[2, 1], R[2, 2])
    # Round-off may exceed the range of the arc sine.
    β = np.arcsin(np.clip(-R[2, 0], -1.0, 1.0))
    γ = np.arctan2(R[1, 0], R[0, 0])
    return np.array([θ, β, γ])


def euler_axes(angles: Array) -> Array:
    """Axes about which Euler angles (θ, β, γ) [rad] turn, as rows (3, 3): R_w R_v e_u, R_w e_v and
    e_w of the rotation R = R_w(γ) R_v(β) R_u(θ); they are dependent at β = ±π/2."""
    cos_β = np.cos(angles[1])
    sin_β = np.sin(angles[1])
    cos_γ = np.cos(angles[2])
    sin_γ = np.sin(angles[2])
    return np.array(
        [
            [cos_γ * cos_β, sin_γ * cos_β, -sin_β],
            [-sin_γ, cos_γ, 0.0],
            [0.0, 0.0, 1.0],
        ]
    )


# Fraction of a period by which a sample may be early: the round-off of summed times.
SAMPLE_ROUND_OFF = 1e-9

# Displacement of the vectors, over their length, in the difference that gives the rates of angles.
RATE_DIFFERENCE = 1e-6

# Smallest rate of a vector, [m/s] or [1/s], that is divided by, against division by zero.
TINY_VELOCITY = 1e-12

# Largest error of an entry of AᵀA for a rotation matrix A of the user.
ORTHONORMALITY = 1e-9
# One gain of all three axes, or one of each.
Gains = Annotated[float, not_negative()] | Annotated[Vector, NOT_NEGATIVE]

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
    """The torque of an `AttitudeControl`, with the gains "stiffness" and "damping", (3,) each, as
    numbers; `reference` has the frame's vectors (k, 3) at the start of the run."""

    def __init__(self, control: AttitudeControl, reference: Array) -> None:
        super().__init__()
        self._control = control
        self._reference = reference

    def get_number(self, key: str) -> Array:
        return np.array(getattr(self._control, key))

    def with_number(self, key: str, value: Array) -> Self:
        """The torque of a control with another gain; that of the user, which other scenes may
        share, has the same as before, and no longer the angles and torques of this scene."""
        changed = copy(self)
        changed._control = copy(self._control)
        setattr(changed._control, key, np.array(value))
        return changed


class _SampledTorque(_ControlTorque, ForceOfStart, HistoryVariables):
    """The torque of an `AttitudeControl` that is computed once a period and held constant in
    between."""

    # The force follows the position, by a torque that is a history variable.
    depends_on_position_only = True

    def __init__(self, control: AttitudeControl, reference: Array) -> None:
        super().__init__(control, reference)
        self._next_sample: float | None = None  # time [s]; None before the first sample
        # Vectors and rates of the sample that the present step has taken; None: it took none.
        self._sampled: tuple[Array, Array] | None = None
        # Of a backward pass: sum of w·∂force/∂torque (3,) over the later steps with this torque.
        self._by_torque: Array = np.zeros(3)

    def begin(self, t: float, lag: float, X: Array, V: Array) -> None:
        """Start a step, and compute a new torque (3,) [N m] if a sample is due."""
        # The reversed step of a gradient has a negative lag, and the torque of the step.
        if lag < 0:
            return
        control = self._control
        self._sampled = None
        if self._next_sample is None:
            self._next_sample = t
        if t >= self._next_sample - SAMPLE_ROUND_OFF * control.period:
            # From the time at which it was due, so that lateness does not accumulate.
            self._next_sample += control.period
            self.torque = control.sample(X, V, self._reference)
            self._sampled = X, V

    def start_adjoint(self) -> None:
        self._by_torque = np.zeros(3)

    def work_by_number(self, key: str, X: Array, w: Array) -> Array:
        """Derivative (3,) by the gains `key`, "stiffness" or "damping", of the work w·force of all
        steps with one sampled torque; X and w (3k,) are vectors and displacements of this step.  A
        backward pass calls it in every step, before `products_at_start`: the step that took the
        sample gives all of it, the others zero."""
        if self._sampled is None:
            return np.zeros(3)
        control = self._control
        angles, rates = control.angles_and_rates(*self._sampled, self._reference)
        by_gain = -rates
        if key == "stiffness":
            by_gain = wrapped(control.target - angles)
        axes = euler_axes(angles) @ control.axes.T
        by_torque = self._by_torque + self.forces_by_torque(X).T @ w
        return (axes @ by_torque) * by_gain

    def products_at_start(self, X: Array, w: Array) -> tuple[Array, Array]:
        """Derivatives of the work w·force of all steps with one sampled torque by the frame's
        vectors and rates at the start of a step, (3k,) each: zero unless the step took the sample.
        A backward pass calls it in each step, the last one first; `_by_torque` sums over the steps
        up to the one that took the sample, and begins again there."""
        self._by_torque = self._by_torque + self.forces_by_torque(X).T @ w
        if self._sampled is None:
            return np.zeros(X.size), np.zeros(X.size)
        by_position, by_rate = self._torque_derivatives(*self._sampled)
        by_torque = self._by_torque
        # Earlier steps have another torque.
        self.start_adjoint()
        return by_position.T @ by_torque, by_rate.T @ by_torque

    def _torque_derivatives(self, X: Array, V: Array) -> tuple[Array, Array]:
        """Derivatives (3, 3k) of the sampled torque [N m] by the frame's vectors X (3k,) at the
        sample and by their rates V (3k,) [1/s]."""
        # dt [s] is the time over which the angles are differenced for their rates.
        control = self._control
        angles, rates = control.angles_and_rates(X, V, self._reference)
        torques = control.law(angles, rates)
        dt = short_time(X, V)
        of_ahead = control.angles_by_vectors(X + dt * V, self._reference)
        of_behind = control.angles_by_vectors(X - dt * V, self._reference)
        of_angles = control.angles_by_vectors(X, self._reference)
        of_torques = -control.stiffness[:, None] * of_angles
        of_torques -= control.damping[:, None] * (of_ahead - of_behind) / (2 * dt)
        by_position = control.torque_derivative(angles, torques, of_angles, of_torques)
        # Rates turn no axes.
        by_rates = -control.damping[:, None] * (of_ahead + of_behind) / 2
        nothing = np.zeros_like(of_angles)
        by_rate = control.torque_derivative(angles, torques, nothing, by_rates)
        return by_position, by_rate

    def get_history(self) -> dict[str, Any]:
        """The time [s] at which the next sample is "due" (None before the first), and of the last
        one the "torque" in space axes (3,) [N m] that is held, the control's "angles" (3,) [rad]
        and its "torques" (3,) [N m] about the axes of these angles."""
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
        # Length of the step [s] and vectors (3k,) at its start; any before the first step.
        self._h = 1.0
        self._X0: Array = reference.ravel()
        self._has_begun = False

    def begin(self, t: float, lag: float, X: Array, V: Array) -> None:
        # Forces act a time `lag` after the start, in the middle of the step.
        self._h = 2 * lag
        self._X0 = X
        self._has_begun = True
        # For the attributes of the control, which hold the values at the start of the step.
        self._control.sample(X, V, self._reference)

    def force(self, X: Array) -> Array:
        """Forces (3k,) on the vectors X (3k,) in the middle of the step, of the torque there."""
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
        angles, for vectors X (3k,) in the middle of the step."""
        control = self._control
        middle = control.angles_of(X, self._reference)
        before = control.angles_of(self._X0, self._reference)
        after = control.angles_of(2 * X - self._X0, self._reference)
        rates = wrapped(after - before) / self._h
        return control.law(middle, rates), rates

    def force_by_number(self, key: str, X: Array) -> Array:
        """Derivatives (3k, 3) of the forces by the gains `key`, "stiffness" or "damping", at the
        vectors X (3k,) in the middle of the step."""
        control = self._control
        angles = control.angles_of(X, self._reference)
        by_gain = wrapped(control.target - angles)
        if key == "damping":
            by_gain = -self._torques(X)[1]
        axes = euler_axes(angles) @ control.axes.T
        return self.forces_by_torque(X) @ (axes.T * by_gain)


def short_time(X: Array, V: Array) -> float:
    """Time [s] in which vectors X (3k,) with the rates V hardly change."""
    return float(RATE_DIFFERENCE * np.abs(X).max() / max(float(np.abs(V).max()), TINY_VELOCITY))


def wrapped(angles: Array) -> Array:
    """Differences of angles [rad], in [-π, π)."""
    return np.remainder(angles + np.pi, 2 * np.pi) - np.pi


def _three_by_three(axes: object) -> Array:
    """The argument as a matrix (3, 3); zeros, which no check accepts, if it is not one."""
    matrix = real_numbers(axes)
    if matrix is None or matrix.shape != (3, 3):
        return np.zeros((3, 3))
    return matrix


@check_arguments
class AttitudeControl(Item):
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
        frame: TurningFrame,
        target: Vector,
        *,
        stiffness: Gains,
        damping: Gains,
        axes: Sequence[Sequence[float]] = ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
        period: Annotated[float, not_negative("s")] = 0.0,
        name: str = "attitude control",
    ) -> None:
        self.frame = frame
        self.period = period
        self.name = name
        self.target = np.asarray(target, dtype=float)
        self.stiffness = np.broadcast_to(np.asarray(stiffness, dtype=float), 3)
        self.damping = np.broadcast_to(np.asarray(damping, dtype=float), 3)
        self.axes = _three_by_three(axes)
        is_orthonormal = np.allclose(
            self.axes.T @ self.axes, np.eye(3), rtol=0, atol=ORTHONORMALITY
        )
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
        """Derivatives (3, 3k) of `angles_of` with respect to the stacked vectors X (3k,); they do
        not exist at β = ±π/2."""
        vectors = X.reshape(-1, 3)
        F = position_gradient(vectors, reference)
        of_rotation = rotation_derivative(F, position_gradient_derivative(vectors, reference))
        axes = euler_axes(self.angles_of(X, reference)) @ self.axes.T
        return np.linalg.solve(axes.T, of_rotation)

    def sample(self, X: Array, V: Array, reference: Array) -> Array:
        """The torque in space axes [N m], (3,), in a state of the frame: stacked vectors X (3k,) in
        the unit of `reference` (k, 3), the vectors at the start, and rates V (3k,) per second.  It
        sets `angles` [rad] and `torques` [N m]."""
        self.angles, rates = self.angles_and_rates(X, V, reference)
        self.torques = self.law(self.angles, rates)
        return self.in_space(self.angles, self.torques)

    def angles_and_rates(self, X: Array, V: Array, reference: Array) -> tuple[Array, Array]:
        """Angles (3,) [rad] and their rates [rad/s] in a state of the frame, see `sample`."""
        # Rates of angles by central differences over a time dt [s] in which the vectors hardly
        # change.
        dt = short_time(X, V)
        ahead = self.angles_of(X + dt * V, reference)
        behind = self.angles_of(X - dt * V, reference)
        return self.angles_of(X, reference), wrapped(ahead - behind) / (2 * dt)

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
        # R = R_w R_v R_u: the axis of θ turns with β and γ, that of β with γ, that of γ not at all.
        turn_of_second = np.outer(axes[2], of_angles[2])
        turn_of_first = turn_of_second + np.outer(axes[1], of_angles[1])
        change: Array = axes.T @ of_torques
        change += torques[0] * np.cross(turn_of_first, axes[0], axisa=0, axisc=0)
        change += torques[1] * np.cross(turn_of_second, axes[1], axisa=0, axisc=0)
        return change

    def in_space(self, angles: Array, torques: Array) -> Array:
        """Sum in space axes [N m], (3,), of torques about the axes of the angles [rad]."""
        return self.axes @ (euler_axes(angles).T @ torques)
