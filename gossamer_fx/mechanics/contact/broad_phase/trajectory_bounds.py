"""Bounds of trajectories: where points will be in the next steps, so that one search serves for
several.

A search returns all pairs that can meet while every point stays within a margin of its expected
position.  Points are expected to take part in a rigid drift of all points together, and to move at
a constant velocity relative to it.  A rigid drift changes no distance, so a sail that spins has no
more candidate pairs than one at rest.

    x(t) = D(t) (x + (t - t0) u ± margin)        drift D, relative velocity u
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.algebra.rotations import rotations
from gossamer_fx.mechanics.contact.arrays import Array

# Singular values of the inertia tensor below this part of the largest one count as zero: points on
# a line have no spin about it.
INERTIA_TOLERANCE = 1e-9


@dataclass(frozen=True)
class RigidDrift:
    """A rigid motion that begins at a time.

    Attributes:
        time: [s].
        centre: point (3,) about which it turns [m].
        velocity: of the centre (3,) [m/s].
        spin: angular velocity (3,) [rad/s].
    """

    time: float
    centre: Array
    velocity: Array
    spin: Array

    @classmethod
    def of(cls, x: Array, v: Array, time: float, comm: MPI.Intracomm = MPI.COMM_SELF) -> RigidDrift:
        """Return the rigid motion that is nearest to velocities v of points x; collective."""
        sums = np.concatenate([x.sum(axis=0), v.sum(axis=0), [len(x)]])
        sums = comm.allreduce(sums)
        centre = sums[:3] / sums[6]
        velocity = sums[3:6] / sums[6]
        # Vectors from the centre to the points (n, 3) [m]
        r = x - centre
        # Least squares: the angular momentum of points of unit mass is that of the rigid motion.
        own_inertia = np.sum(r**2) * np.eye(3) - r.T @ r
        inertia = comm.allreduce(own_inertia)
        angular_momentum = comm.allreduce(np.cross(r, v).sum(axis=0))
        spin = np.linalg.lstsq(inertia, angular_momentum, rcond=INERTIA_TOLERANCE)[0]
        return cls(time, centre, velocity, spin)

    def velocities(self, x: Array) -> Array:
        """Return the velocities (n, 3) [m/s] of points x (n, 3) at the beginning."""
        return self.velocity + np.cross(self.spin, x - self.centre)

    def undone(self, x: Array, time: float) -> Array:
        """Return where points that are at x at a time would be without the drift. Returns points
        (n, 3) [m], turned and shifted back to the time at which the drift began."""
        duration = time - self.time
        spin_rate = float(np.linalg.norm(self.spin))
        # Vectors from the moved centre to the points (n, 3) [m]
        r = x - (self.centre + duration * self.velocity)
        if spin_rate * duration:
            # Rows times a matrix: the inverse rotation.
            r = r @ rotations(self.spin / spin_rate, spin_rate * duration)
        return np.asarray(r + self.centre)


@dataclass(frozen=True)
class TrajectoryBounds:
    """Where points are expected from the beginning of the drift on.

    Attributes:
        drift: of all points together.
        x: points (m, 3) at its beginning [m].
        velocities: relative to the drift (m, 3) [m/s].
        margin: distances (m,) [m] by which points may miss their expected positions; infinite: any.
        duration: time [s] for which the relative velocities count; after it points are expected to
            stop.
    """

    drift: RigidDrift
    x: Array
    velocities: Array
    margin: Array
    duration: float

    def hold(self, x: Array, time: float) -> bool:
        """Return whether this rank's points are within their margins at a time."""
        elapsed = min(time - self.drift.time, self.duration)
        expected = self.x + elapsed * self.velocities
        missed = np.linalg.norm(self.drift.undone(x, time) - expected, axis=1)
        return bool((missed <= self.margin).all())

    def boxes(self) -> tuple[Array, Array]:
        """Return the least and the greatest coordinates (m, 3) [m] of each point without the
        drift."""
        margin = self.margin[:, None]
        lower = np.minimum(self.x, self.end) - margin
        upper = np.maximum(self.x, self.end) + margin
        return lower, upper

    @cached_property
    def end(self) -> Array:
        """Points (m, 3) [m] where they are expected at last, without the drift."""
        return np.ascontiguousarray(self.x + self.duration * self.velocities)
