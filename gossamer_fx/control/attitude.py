"""Attitude control of rigid and flexible bodies."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from gossamer_fx.algebra.rotations import cross_matrices
from gossamer_fx.bodies.between import bodies_of
from gossamer_fx.bodies.frames import Frame
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.control.rotation import euler_angles, euler_axes, position_gradient, rotation
from gossamer_fx.loads.force import Couple
from gossamer_fx.model.body import Array, Port, Vector
from gossamer_fx.model.ports import combine
from gossamer_fx.model.state import State
from gossamer_fx.model.terms import Term
from gossamer_fx.terms.point_loads import PointLoad


@check_arguments
def patch(centre: Port, points: Sequence[Port]) -> Frame:
    """The arms from a centre to points around it: a position gradient averaged over that piece of a flexible body.

    A torque on it is spread over the points, with the opposite forces at the centre.
    """
    return Frame(centre, tuple(combine((1.0, -1.0), (point, centre)) for point in points))


class _Held(Couple):
    """The torque of an `AttitudeControl` that is sampled at the start of a period and held."""

    def __init__(self, control: AttitudeControl, reference: Array) -> None:
        super().__init__()
        self._control, self._reference, self._next = control, reference, -math.inf

    def begin(self, t: float, lag: float, X: Array, V: Array) -> None:
        control = self._control
        if t >= self._next - 1e-9 * control.period:
            self._next = (t if self._next == -math.inf else self._next) + control.period
            self.torque = control.sample(X, V, self._reference)

    def get_state(self) -> dict[str, Any]:
        control = self._control
        due = None if self._next == -math.inf else self._next
        return {
            "due": due,
            "torque": self.torque.tolist(),
            "angles": control.angles.tolist(),
            "torques": control.torques.tolist(),
        }

    def set_state(self, state: dict[str, Any]) -> None:
        self._next = -math.inf if state["due"] is None else state["due"]
        self.torque = np.array(state["torque"])
        self._control.angles, self._control.torques = (
            np.array(state["angles"]),
            np.array(state["torques"]),
        )


class _Continuous(Couple):
    """The torque of an `AttitudeControl` that follows the motion in the step: angles at its middle, rates over it.

    Of the rate of an angle it takes the work -K_d (Δα)²/h: vibrations are damped whatever their frequency and the step.
    """

    def __init__(self, control: AttitudeControl, reference: Array) -> None:
        super().__init__()
        self._control, self._reference = control, reference
        self._h = 1.0
        self._X0: Array = reference.ravel()

    def begin(self, t: float, lag: float, X: Array, V: Array) -> None:
        self._h, self._X0 = 2 * lag, X
        self._control.sample(X, V, self._reference)

    def force(self, X: Array) -> Array:
        control = self._control
        middle, before, after = (
            control.angles_of(Y, self._reference) for Y in (X, self._X0, 2 * X - self._X0)
        )
        self.torque = control.in_space(
            middle, control.law(middle, wrapped(after - before) / self._h)
        )
        return super().force(X)

    def tangent(self, X: Array) -> Array:
        """With the rotation of a patch that does not stretch, δω = (tr S 1 - S)⁻¹ Σ r_i × δr_i."""
        control, r = self._control, X.reshape(-1, 3)
        inverse, _ = self._spread(r)
        arms = np.hstack(tuple(cross_matrices(r)))
        axes = euler_axes(control.angles_of(X, self._reference)) @ control.axes.T
        gain = control.stiffness + 2 * control.damping / self._h
        turning = axes.T @ (gain[:, None] * np.linalg.solve(axes.T, inverse @ arms))
        return super().tangent(X) + arms.T @ inverse @ -turning


def wrapped(angles: Array) -> Array:
    """Differences of angles, in [-π, π)."""
    result: Array = np.remainder(angles + np.pi, 2 * np.pi) - np.pi
    return result


def _three_by_three(axes: object) -> Array:
    """A matrix (3, 3); of nothing but zeros for what is none."""
    try:
        matrix = np.asarray(axes, dtype=float)
    except (TypeError, ValueError):
        return np.zeros((3, 3))
    return matrix if matrix.shape == (3, 3) else np.zeros((3, 3))


@check_arguments
class AttitudeControl:
    """Proportional-derivative torque on a body whose attitude is that of its position gradient.

    The gradient F at the frame is decomposed, F = R U, and R into Euler angles, R = R_w(γ) R_v(β) R_u(θ), relative to
    the start.  About the axis of each angle acts

        T = K_p (target - angle) - K_d d(angle)/dt,

        target - angle taken between -π and π: the short way round,

    as a torque on the frame's vectors, booked as supplied.

    Args:
        frame: of a rigid body, a beam's section, or a `patch` of a film.
        target: (θ, β, γ) [rad].
        stiffness: K_p [N m/rad], one number or three.
        damping: K_d [N m s/rad], one number or three.
        axes: rotation matrix whose columns are u, v, w in space at the start.
        period: time for which a sampled torque is held [s]; 0: it follows the motion also within a step.

    Attributes:
        angles: (θ, β, γ) at the last sample; without period, at the start of the step.
        torques: about the axes of the three angles, then.

    Raises:
        InputError: the frame has no position gradient.
    """

    def __init__(
        self,
        frame: Frame,
        target: Vector,
        *,
        stiffness: float | Vector,
        damping: float | Vector,
        axes: Sequence[Sequence[float]] = ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
        period: float = 0.0,
        name: str = "attitude control",
    ) -> None:
        check(
            len(frame.directors) >= 2,
            f"'{name}' acts on something without position gradient; give the frame of a rigid body or beam, or a patch "
            "of a film.",
        )
        check(
            math.isfinite(period) and period >= 0,
            f"'{name}': period is {period!r} s; give none or a positive one.",
        )
        self.frame, self.period, self.name = frame, period, name
        self.target = np.asarray(target, dtype=float)
        self.stiffness, self.damping = (
            np.broadcast_to(np.asarray(k, dtype=float), 3) for k in (stiffness, damping)
        )
        check(
            bool((self.stiffness >= 0).all() and (self.damping >= 0).all()),
            f"'{name}': gains {self.stiffness.tolist()} N m/rad and {self.damping.tolist()} N m s/rad; none may be "
            "negative.",
        )
        self.axes = _three_by_three(axes)
        check(
            bool(
                np.allclose(self.axes.T @ self.axes, np.eye(3), atol=1e-9)
                and np.linalg.det(self.axes) > 0
            ),
            f"'{name}': its axes are not right-handed and orthonormal; give a rotation matrix with columns u, v, w.",
        )
        self.angles: Array = np.zeros(3)
        self.torques: Array = np.zeros(3)

    def requires(self) -> Iterable[Any]:
        yield from bodies_of(self.frame)

    def terms(self, start: State) -> Iterable[Term]:
        law = _Held if self.period > 0 else _Continuous
        yield PointLoad(self.name, self.frame.directors, law(self, self.reference()))

    def reference(self) -> Array:
        """The frame's vectors at the start, (k, 3)."""
        vectors = np.array([d.initial() for d in self.frame.directors])
        check(
            bool(np.linalg.svd(vectors)[1][1] > 1e-9),
            f"'{self.name}': the vectors of its frame are parallel, which leaves a rotation open; give others.",
        )
        return vectors

    def angles_of(self, X: Array, reference: Array) -> Array:
        """(θ, β, γ) of the frame's stacked vectors X (3k,)."""
        R = rotation(position_gradient(X.reshape(-1, 3), reference))
        return euler_angles(self.axes.T @ R @ self.axes)

    def sample(self, X: Array, V: Array, reference: Array) -> Array:
        """The torque in space axes for the frame's vectors and their rates (3k,)."""
        self.angles = self.angles_of(X, reference)
        moved = 1e-6 * np.abs(X).max() / max(float(np.abs(V).max()), 1e-12)
        ahead, behind = (self.angles_of(X + s * moved * V, reference) for s in (1, -1))
        self.torques = self.law(self.angles, wrapped(ahead - behind) / (2 * moved))
        return self.in_space(self.angles, self.torques)

    def law(self, angles: Array, rates: Array) -> Array:
        """Torques about the axes of the three angles."""
        torques: Array = self.stiffness * wrapped(self.target - angles) - self.damping * rates
        return torques

    def in_space(self, angles: Array, torques: Array) -> Array:
        """Their sum in space axes."""
        total: Array = self.axes @ (euler_axes(angles).T @ torques)
        return total
