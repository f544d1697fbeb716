"""Rigid bodies in 12 coordinates."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt
from dolfinx.common import IndexMap
from mpi4py import MPI

from gossamer_fx.core.algebra.point_measures import PointMeasure
from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array, Block, Port, Vector
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.bodies.frames import Frame
from gossamer_fx.mechanics.terms.masses import NodeKineticEnergy
from gossamer_fx.mechanics.terms.point_constraints import PointConstraint

# The six products of three directors: three lengths, then three right angles.
PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))

# Least principal inertia over the largest one.  Below it the mass matrix of the directors is
# singular to working precision.
SINGULAR_INERTIA = 1e-12

# Round-off that is allowed in the triangle inequality of principal inertias, relative to the
# largest. A flat plate satisfies the inequality as an equality.
INERTIA_TOLERANCE = 1e-9

# Allowed error of an attitude's orthonormality.  A matrix that a user typed with few digits is
# refused.
ATTITUDE_TOLERANCE = 1e-12


def orthonormality(count: int) -> tuple[Array, Array, Array]:
    """H, L, c of the measures ½(d_i·d_i - 1) and d_i·d_j, which are zero for orthonormal directors.

    With m measures e = ½ X·H X + L·X + c of the stacked directors X (3 count,), dimensionless.

    Args:
        count: number of directors, 1 to 3.

    Returns:
        H (m, 3 count, 3 count), L (m, 3 count) and c (m,), with m = count (count + 1)/2: first the
        lengths, then the right angles.
    """
    pairs = [(i, j) for i, j in PAIRS if i < count and j < count]
    H = np.zeros((len(pairs), 3 * count, 3 * count))
    L = np.zeros((len(pairs), 3 * count))
    c = np.zeros(len(pairs))
    for k, (i, j) in enumerate(pairs):
        product = np.zeros((count, count))
        product[i, j] = 1.0
        product[j, i] = 1.0
        H[k] = np.kron(product, np.eye(3))
        # A length is measured from that of a unit vector; a right angle has the product 0.
        if i == j:
            c[k] = -0.5
    return H, L, c


@check_arguments
class RigidBody:
    """A rigid body: position x of its centre of mass and three directors, its axes d1, d2, d3.

    Kinetic energy ½ m |ẋ|² + ½ Σ_ij E_ij ḋ_i·ḋ_j with Euler's tensor E = ½ tr(I) 1 - I (∫X Xᵀ dm in
    body axes); the directors stay orthonormal by six multipliers (Betsch & Steinmann, IJNME 50
    (2001) 1931).

    Args:
        mass: [kg].
        inertia: about the centre of mass in body axes [kg m²]: three principal values, or (3, 3).
        position: of the centre of mass [m].
        attitude: rotation matrix (3, 3) whose columns are the directors; default the axes of space.
        velocity: of the centre of mass [m/s].
        spin: angular velocity in *space* axes [rad/s].

    Raises:
        InputError: mass or inertia not positive definite, an inertia that no body has, or an
            attitude that is not a rotation.  (A plate without thickness has a director without
            mass, which the constraints determine.)

    Example:
        >>> top = gx.RigidBody(2.0, (0.1, 0.1, 0.2), spin=(0.0, 0.0, 3.0), comm=comm)
        >>> run = gx.Simulation(gx.Scene(top), gx.Midpoint(0.01))
        >>> run.totals.angular_momentum.round(12)
        array([0. , 0. , 0.6])
    """

    def __init__(
        self,
        mass: float,
        inertia: npt.ArrayLike,
        *,
        position: Vector = (0.0, 0.0, 0.0),
        attitude: npt.ArrayLike = ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
        velocity: Vector = (0.0, 0.0, 0.0),
        spin: Vector = (0.0, 0.0, 0.0),
        comm: MPI.Intracomm = MPI.COMM_WORLD,
        name: str = "body",
    ) -> None:
        """Check the arguments; the coordinates of the body are on rank 0.  Collective."""
        check(
            math.isfinite(mass) and mass > 0,
            f"RigidBody '{name}': mass is {mass!r} kg; give a positive number.",
        )
        tensor = np.asarray(inertia, dtype=float)
        if tensor.shape == (3,):
            tensor = np.diag(tensor)
        # The shape is tested first: a matrix of another shape cannot be compared with its
        # transpose.
        is_symmetric = (
            tensor.shape == (3, 3)
            and bool(np.isfinite(tensor).all())
            and bool(np.allclose(tensor, tensor.T))
        )
        check(
            is_symmetric,
            f"RigidBody '{name}': inertia is {tensor.tolist()} kg m²; give three numbers or a "
            "symmetric (3, 3).",
        )
        self.euler_tensor = np.trace(tensor) / 2 * np.eye(3) - tensor
        principal = np.linalg.eigvalsh(tensor)
        check(
            bool(principal[0] > SINGULAR_INERTIA * principal[2]),
            f"RigidBody '{name}': the inertia is singular, its principal values are "
            f"{principal.tolist()} kg m²; give a "
            "rod its thickness.",
        )
        # Euler's tensor has the eigenvalue (I1 + I2 - I3)/2 along the axis of the largest inertia
        # I3.
        excess = principal[0] + principal[1] - principal[2]
        check(
            bool(excess >= -INERTIA_TOLERANCE * principal[2]),
            f"RigidBody '{name}': no body has the principal inertias {principal.tolist()} kg m²; "
            "the largest is at "
            "most the sum of the two others.",
        )
        R = np.asarray(attitude, dtype=float)
        is_rotation = (
            R.shape == (3, 3)
            and bool(np.allclose(R.T @ R, np.eye(3), atol=ATTITUDE_TOLERANCE))
            and np.linalg.det(R) > 0
        )
        check(
            is_rotation,
            f"RigidBody '{name}': the attitude is not a rotation matrix; give orthonormal columns "
            "of determinant 1.",
        )
        self.mass = mass
        self.name = name
        self.comm = comm
        # Arguments that a restart compares, see `outputs.arguments`.
        self._inertia = tensor
        self._position = np.asarray(position, dtype=float)
        self._attitude = R
        self._velocity = np.asarray(velocity, dtype=float)
        self._spin = np.asarray(spin, dtype=float)
        # The attitude is orthonormal to `ATTITUDE_TOLERANCE` only; its QR factor is so to
        # round-off, as the constraints ask.  QR may reverse columns, and the signs turn them back.
        directors = np.linalg.qr(R)[0]
        directors *= np.sign(np.sum(directors * R, axis=0))
        self._q = np.vstack([self._position, directors.T])
        self._v = np.vstack([self._velocity, np.cross(self._spin, directors.T)])
        # One node of four vectors.  Rank 0 owns it; all ranks know the initial state.
        owned_nodes = int(comm.rank == 0)
        self.block = Block(IndexMap(comm, owned_nodes), 12)

    def initial_state(self) -> tuple[Array, Array]:
        """Coordinates [m, 1] and velocities [m/s, 1/s] (12 on the owning rank, else 0) at the
        start.
        """
        here = 12 * self.block.index_map.size_local
        return self._q.ravel()[:here].copy(), self._v.ravel()[:here].copy()

    @property
    def velocity(self) -> Array:
        """Velocity (3,) [m/s] of the centre of mass at the start."""
        return self._velocity

    @property
    def spin(self) -> Array:
        """Angular velocity (3,) [rad/s] in space axes at the start."""
        return self._spin

    def terms(self, start: State) -> Iterable[Term]:
        mass = np.zeros((self.block.index_map.size_local, 4, 4))
        mass[:, 0, 0] = self.mass
        mass[:, 1:, 1:] = self.euler_tensor
        yield NodeKineticEnergy(self, mass)
        H, L, c = orthonormality(3)
        measure = PointMeasure([self.frame().directors], H, L, c)
        yield PointConstraint(f"{self.name} directors", measure)

    def port(self, point: Sequence[float] = (0.0, 0.0, 0.0)) -> Port:
        """The material point with body coordinates `point` [m], from the centre of mass."""
        weights = (1.0, *(float(component) for component in point))
        return Port(self, (0, 0, 0, 0), weights=weights, vectors=(0, 1, 2, 3))

    def port_at(self, place: Sequence[float]) -> Port:
        """The material point that is at `place` [m] in space at the start."""
        from_centre = np.asarray(place, dtype=float) - self._q[0]
        directors = self._q[1:]
        return self.port((directors @ from_centre).tolist())

    def frame(self, point: Sequence[float] = (0.0, 0.0, 0.0)) -> Frame:
        """The body's axes at the material point with body coordinates `point` [m]."""
        d1, d2, d3 = (Port(self, (0,), weights=(1.0,), vectors=(k,)) for k in (1, 2, 3))
        return Frame(self.port(point), (d1, d2, d3))

    def frame_at(self, place: Sequence[float]) -> Frame:
        """The body's axes at the material point that is at `place` [m] in space at the start."""
        return Frame(self.port_at(place), self.frame().directors)

    def describe(self, node: int) -> str:
        return "the rigid body"
