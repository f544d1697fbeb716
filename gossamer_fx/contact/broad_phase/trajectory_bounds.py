"""Where points are expected for some steps: they drift and turn together, and each goes on at a rate of its own.

What only moves together comes no nearer, so a film that spins has no more pairs to look at than one at rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gossamer_fx.algebra.rotations import rotations
from gossamer_fx.contact.kernels.library import Array, Bytes, Integers
from gossamer_fx.contact.potential import approaches


@dataclass(frozen=True)
class RigidDrift:
    """A rigid motion from `time` [s] on: with `velocity` [m/s], and turning about `centre` with `spin` [rad/s]."""

    time: float
    centre: Array
    velocity: Array
    spin: Array

    @classmethod
    def of(cls, x: Array, v: Array, time: float) -> RigidDrift:
        """The one nearest, by least squares, to the velocities v (n, 3) of points x (n, 3)."""
        centre, velocity = x.mean(axis=0), v.mean(axis=0)
        r = x - centre
        inertia = np.sum(r**2) * np.eye(3) - r.T @ r
        spin = np.linalg.lstsq(inertia, np.cross(r, v).sum(axis=0), rcond=1e-9)[0]
        return cls(time, centre, velocity, spin)

    def rates(self, x: Array) -> Array:
        """Velocities (n, 3) of points at the beginning."""
        return self.velocity + np.cross(self.spin, x - self.centre)

    def undone(self, x: Array, time: float) -> Array:
        """Where the points that are at x (n, 3) at a time were at the beginning, if they only drifted."""
        τ, rate = time - self.time, float(np.linalg.norm(self.spin))
        r = x - (self.centre + τ * self.velocity)
        if rate * τ:
            r = r @ rotations(self.spin / rate, rate * τ)  # by the inverse
        return np.asarray(r + self.centre)


@dataclass(frozen=True)
class TrajectoryBounds:
    """Points are expected at x + τ `rates` (m, 3), drifted, within `margin` (m,) [m], up to τ = `duration` [s]."""

    drift: RigidDrift
    x: Array
    rates: Array
    margin: Array
    duration: float

    def holds(self, x: Array, time: float) -> bool:
        """Whether points (m, 3) are where they were expected, or still near the end of their course."""
        τ = min(time - self.drift.time, self.duration)
        missed = self.drift.undone(x, time) - (self.x + τ * self.rates)
        return bool((np.linalg.norm(missed, axis=1) <= self.margin).all())

    def boxes(self) -> tuple[Array, Array]:
        """Their least and greatest coordinates (m, 3) each, without the drift."""
        margin = self.margin[:, None]
        return np.minimum(self.x, self._end) - margin, np.maximum(self.x, self._end) + margin

    def approach(self, nodes: Integers, kind: Bytes) -> Array:
        """By how much [m] pairs (n, 4) of primitives may come nearer at most."""
        return approaches(nodes, kind, self.x, self._end, self.margin)

    @cached_property
    def _end(self) -> Array:
        return np.ascontiguousarray(self.x + self.duration * self.rates)
