"""Point masses, rigid bodies in 12 coordinates, and rigid pieces without mass: a position and one
to three directors, moved by what is tied to them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from gossamer_fx.core.algebra.point_measures import PointMeasure
from gossamer_fx.core.algebra.rotations import perpendicular_pair
from gossamer_fx.core.checks.arguments import check_arguments, positive
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array, Body, Port, Vector
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.bodies.frames import Frame, OneNode
from gossamer_fx.mechanics.terms.point_constraints import PointConstraint
from gossamer_fx.mechanics.terms.rows import AttachedKineticEnergy

Mass = Annotated[float, positive("kg")]

# The six products of three directors: three lengths, then three right angles.
PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))

# Least principal inertia over the largest one.  Below it the mass matrix of the directors is
# singular to working precision.
SINGULAR_INERTIA = 1e-12

# Round-off that is allowed in the symmetry and in the triangle inequality of inertias, relative to
# the largest. A flat plate satisfies the inequality as an equality.
INERTIA_TOLERANCE = 1e-9

# Allowed error of an attitude's orthonormality.  A matrix that a user typed with few digits is
# refused.
ATTITUDE_TOLERANCE = 1e-12
# Extent of a set of points, over its largest one, below which it counts as flat in that direction.
# Extents are roots of eigenvalues, whose round-off of 1e-16 is an extent of 1e-8.
FLAT = 1e-7


def orthonormality(count: int) -> tuple[Array, Array, Array]:
    """H (m, 3k, 3k), L (m, 3k) and c (m,) of the measures ½(d_i·d_i - 1) and d_i·d_j of k = `count`
    directors, up to 3, which are zero where these are orthonormal.

    With the stacked directors X (3k,) the m = k (k + 1)/2 measures are ½ X·H X + L·X + c: first the
    lengths, then the right angles.
    """
    pairs = [(i, j) for i, j in PAIRS if i < count and j < count]
    H = np.zeros((len(pairs), 3 * count, 3 * count))
    L = np.zeros((len(pairs), 3 * count))
    c = np.zeros(len(pairs))
    for row, (i, j) in enumerate(pairs):
        product = np.zeros((count, count))
        product[i, j] = 1.0
        product[j, i] = 1.0
        H[row] = np.kron(product, np.eye(3))
        # A length is measured from that of a unit vector; a right angle has the product 0.
        if i == j:
            c[row] = -0.5
    return H, L, c


@check_arguments
class RigidBody(OneNode):
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

    description = "the rigid body"

    def __init__(
        self,
        mass: Mass,
        inertia: npt.ArrayLike,
        *,
        position: Vector = (0.0, 0.0, 0.0),
        attitude: npt.ArrayLike = ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
        velocity: Vector = (0.0, 0.0, 0.0),
        spin: Vector = (0.0, 0.0, 0.0),
        comm: MPI.Intracomm = MPI.COMM_WORLD,
        name: str = "body",
    ) -> None:
        tensor = np.asarray(inertia, dtype=float)
        if tensor.shape == (3,):
            tensor = np.diag(tensor)
        # The shape is tested first: a matrix of another shape cannot be compared with its
        # transpose.
        round_off = INERTIA_TOLERANCE * np.abs(tensor).max(initial=0.0)
        is_symmetric = tensor.shape == (3, 3) and bool(
            np.allclose(tensor, tensor.T, rtol=0, atol=round_off)
        )
        check(
            is_symmetric,
            f"RigidBody '{name}': inertia is {tensor.tolist()} kg m²; "
            "give three numbers or a symmetric (3, 3).",
        )
        self.euler_tensor = np.trace(tensor) / 2 * np.eye(3) - tensor
        principal = np.linalg.eigvalsh(tensor)
        check(
            bool(principal[0] > SINGULAR_INERTIA * principal[2]),
            f"RigidBody '{name}': the inertia is singular, "
            f"its principal values are {principal.tolist()} kg m²; give a rod its thickness.",
        )
        # Euler's tensor has the eigenvalue (I1 + I2 - I3)/2 along the axis of the largest inertia
        # I3.
        excess = principal[0] + principal[1] - principal[2]
        check(
            bool(excess >= -INERTIA_TOLERANCE * principal[2]),
            f"RigidBody '{name}': no body has the principal inertias {principal.tolist()} kg m²; "
            "the largest is at most the sum of the two others.",
        )
        R = np.asarray(attitude, dtype=float)
        is_rotation = (
            R.shape == (3, 3)
            and bool(np.allclose(R.T @ R, np.eye(3), rtol=0, atol=ATTITUDE_TOLERANCE))
            and np.linalg.det(R) > 0
        )
        check(
            is_rotation,
            f"RigidBody '{name}': the attitude is not a rotation matrix; "
            "give orthonormal columns of determinant 1.",
        )
        self.mass = mass
        self.name = name
        self.comm = comm
        # Arguments that a restart compares, see `outputs.output`.
        self._inertia = tensor
        self._position = np.asarray(position, dtype=float)
        self._attitude = R
        # At the start, (3,): [m/s] of the centre of mass, and [rad/s] in space axes.
        self.velocity: Array = np.asarray(velocity, dtype=float)
        self.spin: Array = np.asarray(spin, dtype=float)
        # The attitude is orthonormal to `ATTITUDE_TOLERANCE` only; its QR factor is so to
        # round-off, as the constraints ask.  QR may reverse columns, and the signs turn them back.
        directors = np.linalg.qr(R)[0]
        directors *= np.sign(np.sum(directors * R, axis=0))
        self._q = np.vstack([self._position, directors.T])
        self._v = np.vstack([self.velocity, np.cross(self.spin, directors.T)])
        self._make_node(12)

    def terms(self, start: State) -> Iterable[Term]:
        # Of the rates of x [kg] and of the three directors [kg m²].
        mass = np.zeros((1, 4, 4))
        mass[0, 0, 0] = self.mass
        mass[0, 1:, 1:] = self.euler_tensor
        yield AttachedKineticEnergy([tuple(self.vector(k) for k in range(4))], mass)
        H, L, c = orthonormality(3)
        measure = PointMeasure([self.frame().directors], H, L, c)
        yield PointConstraint(f"{self.name} directors", measure, keeps_orthonormal=True)

    @check_arguments
    def port(self, point: Vector = (0.0, 0.0, 0.0)) -> Port:
        """The material point with body coordinates `point` [m], from the centre of mass."""
        weights = (1.0, *(float(component) for component in point))
        return Port(self, (0, 0, 0, 0), weights=weights, vectors=(0, 1, 2, 3))

    @check_arguments
    def port_at(self, place: Vector) -> Port:
        """The material point that is at `place` [m] in space at the start."""
        from_centre = np.asarray(place, dtype=float) - self._q[0]
        directors = self._q[1:]
        return self.port((directors @ from_centre).tolist())

    @check_arguments
    def frame(self, point: Vector = (0.0, 0.0, 0.0)) -> Frame:
        """The body's axes at the material point with body coordinates `point` [m]."""
        return Frame(self.port(point), (self.vector(1), self.vector(2), self.vector(3)))

    @check_arguments
    def frame_at(self, place: Vector) -> Frame:
        """The body's axes at the material point that is at `place` [m] in space at the start."""
        return Frame(self.port_at(place), self.frame().directors)


@check_arguments
class PointMass(OneNode):
    """A point with mass.  It lives on rank 0.

    Args:
        mass: [kg], positive.
        position: [m] at the start.
        velocity: [m/s] at the start.
        comm: of the scene it is in.
        name: name in messages and output.

    Raises:
        InputError: a mass that is not positive.

    Example:
        >>> ball = gx.PointMass(1.0, (0.0, 0.0, 2.0), comm=comm)
        >>> run = gx.Simulation(gx.Scene(ball, gx.Gravity(ball)), gx.Midpoint(0.01))
        >>> run.run(until=0.1)
        >>> round(float(gx.probes.Position(ball.port(), "z")(run)), 4)
        1.951
    """

    description = "the point mass"

    def __init__(
        self,
        mass: Mass,
        position: tuple[float, float, float] = (0.0, 0.0, 0.0),
        *,
        velocity: tuple[float, float, float] = (0.0, 0.0, 0.0),
        comm: MPI.Intracomm = MPI.COMM_WORLD,
        name: str = "mass",
    ) -> None:
        self.mass = mass
        self.name = name
        self.comm = comm
        # Arguments that a restart compares, see `outputs.output`.
        self._position = np.asarray(position, dtype=float)
        self._velocity = np.asarray(velocity, dtype=float)
        self._q = self._position
        self._v = self._velocity
        self._make_node(3)

    def terms(self, start: State) -> Iterable[Term]:
        yield AttachedKineticEnergy([(self.port(),)], np.full((1, 1, 1), self.mass))

    def port(self) -> Port:
        """Where it is, for joints and springs."""
        return Port(self, (0,))


class RigidPiece(OneNode):
    """Position x and orthonormal directors d_i without mass: what is tied to it decides its motion.
    Its coordinates are on rank 0; the arguments are the same on all ranks and not checked.

    Args:
        name: in messages.
        owner: the body that is tied to it.
        start: positions (1 + k, 3) of x [m] and the k directors.
        rates: their velocities (1 + k, 3) [m/s, 1/s].
        rigid: whether lengths and angles of the directors are constant; one director alone may else
            change its length.
    """

    description = "the piece without mass"

    def __init__(
        self, name: str, owner: Body, start: Array, rates: Array, rigid: bool = True
    ) -> None:
        self.name = name
        self.comm = owner.comm
        self._owner = owner
        self._rigid = rigid
        # Initial coordinates and rates, (1 + k, 3).
        self._q = start
        self._v = rates
        self._make_node(start.size)

    def requires(self) -> Iterable[Any]:
        yield self._owner

    @property
    def directors(self) -> tuple[Port, ...]:
        """The k directors as ports."""
        return tuple(self.vector(k) for k in range(1, len(self._q)))

    def port(self, *along: float) -> Port:
        """The point x + Σ along[i] d_i, of up to k coordinates along the directors."""
        count = 1 + len(along)
        nodes = (0,) * count
        vectors = tuple(range(count))
        return Port(self, nodes, weights=(1.0, *along), vectors=vectors)

    def terms(self, start: State) -> Iterable[Term]:
        if self._rigid:
            H, L, c = orthonormality(len(self._q) - 1)
            measure = PointMeasure([self.directors], H, L, c)
            # A single director does not say how the piece turns about it.
            turns = len(self._q) > 2
            yield PointConstraint(f"{self.name} directors", measure, keeps_orthonormal=turns)


def fitted(comm: MPI.Intracomm, x: Array, v: Array) -> tuple[Array, Array, Array]:
    """Frame (1 + k, 3) of the points x (n, 3) [m] of all ranks: their centre [m] and the k unit
    vectors of `directors_of`; its rates (1 + k, 3) [m/s, 1/s] in the affine motion that fits the
    velocities v (n, 3) [m/s] best; and the coordinates (n, k) [m] of this rank's points along the
    directors.  n may be zero, but not on all ranks.  Collective."""
    count = comm.allreduce(len(x))
    mean = comm.allreduce(x.sum(axis=0)) / count
    mean_velocity = comm.allreduce(v.sum(axis=0)) / count
    arms = x - mean
    covariance = comm.allreduce(arms.T @ arms)
    moments = comm.allreduce(arms.T @ (v - mean_velocity))
    # d (k, 3): the directors.  Sums may differ between ranks in the last digit, and with it the
    # sign of an eigenvector.
    d = comm.bcast(directors_of(covariance))
    along = arms @ d.T
    director_rates = np.zeros((0, 3))
    if len(d):
        # Least squares of along @ director_rates = v - mean_velocity over all points.
        director_rates = np.linalg.solve(d @ covariance @ d.T, d @ moments)
    frame = np.vstack([mean[None], d])
    frame_rates = np.vstack([mean_velocity[None], director_rates])
    return frame, frame_rates, along


def directors_of(covariance: Array) -> Array:
    """Orthonormal directors (k, 3) of a set of points, as many as it has dimensions.

    One along a line; two in a plane, right-handed with its normal; the axes of space for points in
    space; none where all points coincide.  `covariance` is Σ (x - x_mean)(x - x_mean)ᵀ (3, 3) [m²].
    """
    # Eigenvalues are in ascending order.  Round-off may make the least of them negative.
    squares, vectors = np.linalg.eigh(covariance)
    extents = np.sqrt(np.maximum(squares, 0.0))
    dimension = 0
    if extents[2] > 0:
        dimension = int((extents > FLAT * extents[2]).sum())
    if dimension == 0:
        return np.zeros((0, 3))
    if dimension == 3:
        return np.eye(3)
    # The direction of a line has the largest extent, the normal of a plane the smallest one.
    n: Array = vectors[:, 0]
    if dimension == 1:
        n = vectors[:, 2]
    # An eigenvector has no sign; its largest component is made positive.
    n = n * np.sign(n[np.argmax(np.abs(n))])
    if dimension == 1:
        return n[None]
    return np.array(perpendicular_pair(n))
