"""Rigid bodies in 12 coordinates."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt
from dolfinx.common import IndexMap
from mpi4py import MPI

from gossamer_fx.algebra.point_measures import PointMeasure
from gossamer_fx.bodies.frames import Frame
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.model.body import Array, Block, Port, Vector
from gossamer_fx.model.state import State
from gossamer_fx.model.terms import Term
from gossamer_fx.terms.masses import NodeKineticEnergy
from gossamer_fx.terms.point_constraints import PointConstraint

PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))


def orthonormality(count: int) -> tuple[Array, Array, Array]:
    """H, L, c of the measures ½(d_i·d_i - 1) and d_i·d_j of `count` stacked directors."""
    pairs = [(i, j) for i, j in PAIRS if i < count and j < count]
    H, c = np.zeros((len(pairs), 3 * count, 3 * count)), np.zeros(len(pairs))
    for k, (i, j) in enumerate(pairs):
        product = np.zeros((count, count))
        product[i, j] = product[j, i] = 1.0
        H[k] = np.kron(product, np.eye(3))
        c[k] = -0.5 if i == j else 0.0
    return H, np.zeros((len(pairs), 3 * count)), c


@check_arguments
class RigidBody:
    """A rigid body: position x of its centre of mass and three directors, its axes d1, d2, d3.

    Kinetic energy ½ m |ẋ|² + ½ Σ_ij E_ij ḋ_i·ḋ_j with Euler's tensor E = ½ tr(I) 1 - I (∫X Xᵀ dm in body axes); the
    directors stay orthonormal by six multipliers (Betsch & Steinmann, IJNME 50 (2001) 1931).

    Args:
        mass: [kg].
        inertia: about the centre of mass in body axes [kg m²]: three principal values, or (3, 3).
        position: of the centre of mass [m].
        attitude: rotation matrix (3, 3) whose columns are the directors; default the axes of space.
        velocity: of the centre of mass [m/s].
        spin: angular velocity in *space* axes [rad/s].

    Raises:
        InputError: mass or inertia not positive definite, an inertia that no body has, or an attitude that is no
            rotation.  (A plate without thickness has a director without mass, which the constraints determine.)

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
        check(
            math.isfinite(mass) and mass > 0,
            f"RigidBody '{name}': mass is {mass!r} kg; give a positive number.",
        )
        tensor = np.asarray(inertia, dtype=float)
        tensor = np.diag(tensor) if tensor.shape == (3,) else tensor
        check(
            tensor.shape == (3, 3)
            and bool(np.isfinite(tensor).all())
            and bool(np.allclose(tensor, tensor.T)),
            f"RigidBody '{name}': inertia is {tensor.tolist()} kg m²; give three numbers or a symmetric (3, 3).",
        )
        self.euler_tensor = np.trace(tensor) / 2 * np.eye(3) - tensor
        principal = np.linalg.eigvalsh(tensor)
        check(
            bool(principal[0] > 1e-12 * principal[2]),
            f"RigidBody '{name}': the inertia is singular, its principal values are {principal.tolist()} kg m²; give a "
            "rod its thickness.",
        )
        check(
            bool(principal[0] + principal[1] - principal[2] >= -1e-9 * principal[2]),
            f"RigidBody '{name}': no body has the principal inertias {principal.tolist()} kg m²; the largest is at "
            "most the sum of the two others.",
        )
        R = np.asarray(attitude, dtype=float)
        check(
            R.shape == (3, 3)
            and bool(np.allclose(R.T @ R, np.eye(3), atol=1e-12))
            and np.linalg.det(R) > 0,
            f"RigidBody '{name}': the attitude is not a rotation matrix; give orthonormal columns of determinant 1.",
        )
        self.mass, self.name, self.comm = mass, name, comm
        # arguments that a restart compares, see `outputs.arguments`
        self._inertia = tensor
        self._position = np.asarray(position, dtype=float)
        self._attitude = R
        self._velocity = np.asarray(velocity, dtype=float)
        self._spin = np.asarray(spin, dtype=float)
        directors = np.linalg.qr(R)[0]
        directors *= np.sign(np.sum(directors * R, axis=0))
        self._q = np.vstack([self._position, directors.T])
        self._v = np.vstack([self._velocity, np.cross(self._spin, directors.T)])
        self.block = Block(IndexMap(comm, 1 if comm.rank == 0 else 0), 12)

    def initial_state(self) -> tuple[Array, Array]:
        here = 12 * self.block.index_map.size_local
        return self._q.ravel()[:here].copy(), self._v.ravel()[:here].copy()

    def terms(self, start: State) -> Iterable[Term]:
        mass = np.zeros((self.block.index_map.size_local, 4, 4))
        mass[:, 0, 0] = self.mass
        mass[:, 1:, 1:] = self.euler_tensor
        yield NodeKineticEnergy(self, mass)
        yield PointConstraint(
            f"{self.name} directors", PointMeasure([self.frame().directors], *orthonormality(3))
        )

    def port(self, point: Sequence[float] = (0.0, 0.0, 0.0)) -> Port:
        """The material point with body coordinates `point` [m], from the centre of mass."""
        return Port(
            self, (0, 0, 0, 0), weights=(1.0, *(float(c) for c in point)), vectors=(0, 1, 2, 3)
        )

    def port_at(self, place: Sequence[float]) -> Port:
        """The material point that is at `place` [m] in space at the start."""
        return self.port((self._q[1:] @ (np.asarray(place, dtype=float) - self._q[0])).tolist())

    def frame(self, point: Sequence[float] = (0.0, 0.0, 0.0)) -> Frame:
        """The body's axes at the material point with body coordinates `point` [m]."""
        d1, d2, d3 = (Port(self, (0,), weights=(1.0,), vectors=(k,)) for k in (1, 2, 3))
        return Frame(self.port(point), (d1, d2, d3))

    def frame_at(self, place: Sequence[float]) -> Frame:
        """The body's axes at the material point that is at `place` [m] in space at the start."""
        return Frame(self.port_at(place), self.frame().directors)

    def describe(self, node: int) -> str:
        return "the rigid body"
