"""Candidate pairs: all that can come within the activation distance in the next steps.

Trajectories are bounded, so that one search serves for several steps.  A search returns all pairs
that can meet while every point stays within a margin of its expected position.  Points are expected
to take part in a rigid drift of all points together, and to move at a constant velocity relative to
it.  A rigid drift changes no distance, so a sail that spins has no more candidate pairs than one at
rest.

    x(t) = D(t) (x + (t - t0) u ± margin)        drift D, relative velocity u

On several ranks a search begins with an exchange of facets: a rank sends its edges and triangles to
every rank that searches near them.  Each rank describes where it searches by a few boxes round
groups of neighbouring primitives.  All ranks get these boxes, and find in a tree over them to whom
their primitives may be near.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.algebra.rank_exchange import RankExchange
from gossamer_fx.core.algebra.rotations import LAST, NEXT, rotations
from gossamer_fx.mechanics.contact.broad_phase.box_tree import (
    BoxTree,
    Nearness,
    find_overlaps,
    morton_order,
)
from gossamer_fx.mechanics.contact.contract import Array, ByteArray, Int32Array, Int64Array, Sides
from gossamer_fx.mechanics.contact.geometry.collision_mesh import CollisionMesh
from gossamer_fx.mechanics.contact.geometry.facets import FilteredPrimitives
from gossamer_fx.mechanics.contact.geometry.surface_share import SurfaceTables
from gossamer_fx.mechanics.contact.pairs import SIDES, CandidatePairs, is_boundary

# Boxes by which a rank describes where it searches.  In a folded sail the one box round all
# primitives of a rank overlaps everything; with this many, boxes are about as flat as the folds.
GROUP_COUNT = 64


def group_boxes(boxes: Array) -> Array:
    """Return a few boxes (g, 6) [m] that hold all of many boxes (n, 6), one for each group of
    neighbours; at most `GROUP_COUNT`, and none if there are no boxes."""
    if not len(boxes):
        return np.zeros((0, 6))
    ordered = boxes[morton_order(boxes)]
    starts = np.unique(np.linspace(0, len(boxes), GROUP_COUNT, endpoint=False).astype(int))
    lower = np.minimum.reduceat(ordered[:, :3], starts)
    upper = np.maximum.reduceat(ordered[:, 3:], starts)
    return np.hstack([lower, upper])


class SearchRegions:
    """Where other ranks search."""

    def __init__(self, comm: MPI.Intracomm, boxes: Array) -> None:
        """Exchange with the other ranks where each searches; `boxes` (n, 6) [m] are those of the
        primitives of this rank.  Collective."""
        of_ranks = comm.allgather(group_boxes(boxes))
        # What is near this rank's own region needs no sending.
        of_ranks[comm.rank] = np.zeros((0, 6))
        self._rank = np.repeat(np.arange(comm.size), [len(of_rank) for of_rank in of_ranks])
        self._size = comm.size
        self._boxes = np.ascontiguousarray(np.concatenate(of_ranks))

    def destinations(self, boxes: Array) -> tuple[Int64Array, Int64Array]:
        """Return which primitives to send to which ranks: those with boxes (n, 6) [m] where the
        rank searches.  Returns number of the primitive (k,) and rank (k,); one may go to
        several."""
        none: Int64Array = np.zeros(0, dtype=np.int64)
        if not len(boxes) or not len(self._boxes):
            return none, none
        tree = BoxTree(_unfiltered(self._boxes, first_label=0))
        asked: Int32Array = np.arange(len(boxes), dtype=np.int32)
        found = tree.overlaps(_unfiltered(boxes, first_label=len(self._boxes)), asked)
        # Several groups of one rank may be near the same primitive.
        pairs = np.unique(found[:, 0].astype(np.int64) * self._size + self._rank[found[:, 1]])
        return pairs // self._size, pairs % self._size


def _unfiltered(boxes: Array, first_label: int) -> FilteredPrimitives:
    """Return primitives (boxes) that are connected to nothing and not fixed: each has a label for
    itself."""
    count = len(boxes)
    labels: Int32Array = np.arange(first_label, first_label + count, dtype=np.int32)
    is_fixed: ByteArray = np.zeros(count, dtype=np.uint8)
    return FilteredPrimitives(np.ascontiguousarray(boxes), labels[:, None], is_fixed)


def import_facets(mesh: CollisionMesh, lower: Array, upper: Array) -> None:
    """Let this rank know the edges and triangles of other ranks that may come near its own;
    collective.  `lower, upper`: corners (m, 3) [m] of a box round each point.  Afterwards the
    points of the mesh are other ones, with other numbers: its own, and those of what it has
    received."""
    comm = mesh.comm
    # The only rank has all facets.
    if comm.size == 1:
        return
    surface = mesh.surface
    known = mesh.known
    vertices = surface.vertices[mesh.own_vertices]
    edge_boxes = _boxes(surface.edges[mesh.own_edges], lower, upper)
    searched = np.vstack([_boxes(vertices[:, None], lower, upper), edge_boxes])
    regions = SearchRegions(comm, searched)
    edge, edge_rank = regions.destinations(_boxes(surface.edges[mesh.sent_edges], lower, upper))
    edge = mesh.sent_edges[edge]
    triangles = surface.triangles[mesh.sent_triangles]
    triangle, triangle_rank = regions.destinations(_boxes(triangles, lower, upper))
    triangle = mesh.sent_triangles[triangle]

    # The points of what is sent, each once for each rank.
    points = np.concatenate([surface.edges[edge].ravel(), surface.triangles[triangle].ravel()])
    ranks = np.concatenate([np.repeat(edge_rank, 2), np.repeat(triangle_rank, 3)])
    pairs = np.unique(points.astype(np.int64) * comm.size + ranks)
    point = pairs // comm.size
    received = SurfaceTables(
        points=known.points.received(point, RankExchange(comm, pairs % comm.size)),
        edges=known.edges.received(edge, RankExchange(comm, edge_rank)),
        triangles=known.triangles.received(triangle, RankExchange(comm, triangle_rank)),
    )
    mesh.show(mesh.share.surface.united(received))


def _boxes(primitives: Int32Array, lower: Array, upper: Array) -> Array:
    """Return the boxes (n, 6) of primitives (n, k) from those of their points."""
    return np.hstack([lower[primitives].min(axis=1), upper[primitives].max(axis=1)])


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
        """Return the rigid motion, from a time [s] on, that is nearest to velocities v (n, 3) [m/s]
        of points x (n, 3) [m] of all ranks; collective."""
        sums = np.concatenate([x.sum(axis=0), v.sum(axis=0), [len(x)]])
        comm.Allreduce(MPI.IN_PLACE, sums)
        centre = sums[:3] / sums[6]
        velocity = sums[3:6] / sums[6]
        # Vectors from the centre to the points (n, 3) [m]
        r = x - centre
        # Least squares: the angular momentum of points of unit mass is that of the rigid motion.
        # Both follow from the sums of r_i r_j and r_i v_j.
        moments = np.stack([r.T @ r, r.T @ v])
        comm.Allreduce(MPI.IN_PLACE, moments)
        of_points, of_motion = moments
        inertia = np.trace(of_points) * np.eye(3) - of_points
        angular_momentum = of_motion[NEXT, LAST] - of_motion[LAST, NEXT]
        spin = np.linalg.lstsq(inertia, angular_momentum, rcond=INERTIA_TOLERANCE)[0]
        return cls(time, centre, velocity, spin)

    def velocities(self, x: Array) -> Array:
        """Return the velocities (n, 3) [m/s] of points x (n, 3) at the beginning."""
        a, b, c = self.spin
        turned = (x - self.centre) @ np.array([[0.0, c, -b], [-c, 0.0, a], [b, -a, 0.0]])
        return np.asarray(self.velocity + turned)

    def undone(self, x: Array, time: float) -> Array:
        """Return where points that are at x (n, 3) [m] at a time [s] would be without the drift:
        turned and shifted back to the time at which it began."""
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
        """Return whether this rank's points, at x (m, 3) [m] at a time [s], are within their
        margins."""
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


# Part of its expected way by which a point may miss its expected position.  A wider margin makes
# more candidates, a smaller one more searches.
WAY_MARGIN = 0.3

# Steps for which one search shall serve: one at rest, and any at most.  The number doubles when a
# search served to its end, and falls to what was reached when it did not.
FIRST_HORIZON = 4
MAX_HORIZON = 32

# Time that a candidate takes in a step over that which it takes in a search, as measured.  Longer
# horizons find more candidates: in packed layers, soon those of the next layer, which take more
# time, and memory, than the searches that are saved.
STEP_COST = 0.2

# Searches after which a horizon that did not pay is tried again.
PATIENCE = 8

# A part of a step [1] by which a search lasts longer than its horizon, so that round-off in the
# time does not end it one step early.
SPARE_TIME = 1e-6


@dataclass(frozen=True)
class StepPoints:
    """The m points of a contact that this rank knows, in one step.

    Attributes:
        x: points (m, 3) [m] at the start.
        v: their velocities (m, 3) [m/s] at the start.
        end: points (m, 3) [m] at the end, which are within the bounds of a search, too.
    """

    x: Array
    v: Array
    end: Array


@dataclass(frozen=True, eq=False)
class Candidates:
    """What a search found.

    Attributes:
        pairs: the n candidates of this rank, complete as long as points stay within the bounds.
        bounds: of the trajectories.
    """

    pairs: CandidatePairs
    bounds: TrajectoryBounds
    comm: MPI.Intracomm

    def hold(self, x: Array, time: float) -> bool:
        """Return whether the points (m, 3) of all ranks are within their bounds at a time [s];
        collective."""
        return bool(self.comm.allreduce(self.bounds.hold(x, time), op=MPI.LAND))


class CandidateSearch:
    """Finds candidates, for as many steps at once as pay.

    On several ranks a search also lets the mesh know facets of other ranks that may come near, so
    that the number m of points that this rank knows changes.

    Attributes:
        count: number of searches so far.
    """

    def __init__(self, mesh: CollisionMesh, activation_distance: float) -> None:
        self._mesh = mesh
        self._activation_distance = activation_distance
        # Steps for which the next search is made, and steps since the last one.
        self._horizon = FIRST_HORIZON
        self._age = 0
        # Primitives and candidates of all ranks in the last search, and the fewest in one.
        self._size = 0
        self._least_size = 0
        # The longest horizon, up to a number of searches.
        self._longest = MAX_HORIZON
        self._next_trial = 0
        self._pair_counts = (0, 0)  # of triangle pairs and edge pairs found in the last search
        self.count = 0

    def begin_step(self) -> None:
        self._age += 1

    def find_at_rest(self, read: Callable[[], Array], time: float) -> Candidates:
        """Find the contact pairs whose gap can fall below the activation distance while each point
        stays within half of that distance from where it is; collective.

        `read` returns the points (m, 3) [m] that this rank knows when it is called; it is called
        again after facets of other ranks were added.
        """

        def at_rest() -> TrajectoryBounds:
            x = read()
            return self._bounds(x, np.zeros_like(x), time, duration=0.0)

        self._choose_horizon()
        found = self._find(at_rest)
        self._least_size = self._size
        return found

    def find(self, read: Callable[[], StepPoints], time: float, step: float) -> Candidates:
        """Find the contact pairs whose gap can fall below the activation distance in the present
        step and some after it; collective.  `time`: at the start of the step [s]; `step`: its
        length [s].

        The number of steps doubles, up to `MAX_HORIZON`, after a search that served for all its
        steps; after one that served for fewer, but at least for one, it is the number of these.  A
        search at rest counts as one for `FIRST_HORIZON` steps.  A horizon that finds too many
        candidates is halved, and not tried again for `PATIENCE` searches.

        `read` returns the points that this rank knows when it is called; it is called again after
        facets of other ranks were added.
        """

        def in_motion() -> TrajectoryBounds:
            points = read()
            duration = (self._horizon + SPARE_TIME) * step
            bounds = self._bounds(points.x, points.v, time, duration)
            end_time = time + step
            # Positions at the end of the step without the drift: by the velocities of the bounds,
            # and by `end`.  The margin grows by their distance, so that `end` is within the bounds.
            # As in `TrajectoryBounds.hold`, the duration is a difference of times.
            expected = points.x + (end_time - time) * bounds.velocities
            missed = bounds.drift.undone(points.end, end_time) - expected
            bounds.margin[:] += np.linalg.norm(missed, axis=1)
            return bounds

        self._choose_horizon()
        return self._find(in_motion)

    def _choose_horizon(self) -> None:
        """Choose for how many steps the next search serves, from how many the last one did and how
        many candidates it found."""
        if not self._age:
            return
        horizon = self._horizon
        self._least_size = min(self._least_size, self._size)
        if horizon == 1:
            # Layers may have come together since there were fewer.
            self._least_size = self._size
        # Time of a step with this horizon, and with half of it if that finds the fewest candidates,
        # in units of the time that one takes in a search.
        time = self._size * (1 / horizon + STEP_COST)
        if time > self._least_size * (2 / horizon + STEP_COST):
            self._longest = horizon // 2
            self._next_trial = self.count + PATIENCE
        elif self.count >= self._next_trial:
            self._longest = MAX_HORIZON
        wanted = 2 * horizon if self._age >= horizon else self._age
        self._horizon = min(wanted, self._longest)

    def _bounds(self, x: Array, v: Array, time: float, duration: float) -> TrajectoryBounds:
        """Return bounds of the trajectories of points x (m, 3) [m] with velocities v (m, 3) [m/s]:
        a rigid drift and a uniform relative motion.  Collective: the drift is that of all ranks'
        points.  `duration`: for which the velocities count [s]."""
        mesh = self._mesh
        vertices = mesh.surface.vertices
        own = vertices[mesh.own_vertices]
        drift = RigidDrift.of(x[own], v[own], time, mesh.comm)
        velocities = v - drift.velocities(x)
        # Points of boundaries do not belong to a primitive: their pairs are candidates wherever
        # they are.
        margin = np.full(len(x), np.inf)
        way = duration * np.linalg.norm(velocities[vertices], axis=1)
        margin[vertices] = self._activation_distance / 2 + WAY_MARGIN * way
        return TrajectoryBounds(drift, x, velocities, margin, duration)

    def _find(self, bounds_of_mesh: Callable[[], TrajectoryBounds]) -> Candidates:
        """Find the candidates that can come near while points stay within bounds; collective.  On
        several ranks, facets of other ranks are fetched first, and the bounds asked for again."""
        mesh = self._mesh
        bounds = bounds_of_mesh()
        if mesh.comm.size > 1:
            import_facets(mesh, *searched_boxes(mesh, bounds, self._activation_distance))
            bounds = bounds_of_mesh()
        pairs, self._pair_counts = find_candidates(
            mesh, bounds, self._activation_distance, self._pair_counts
        )
        primitive_count = len(mesh.own_vertices) + len(mesh.own_edges)
        self._size = mesh.comm.allreduce(primitive_count + len(pairs))
        self._age = 0
        self.count += 1
        return Candidates(pairs, bounds, mesh.comm)


def searched_boxes(
    mesh: CollisionMesh, bounds: TrajectoryBounds, activation_distance: float
) -> tuple[Array, Array]:
    """Return least and greatest coordinates (m, 3) [m] of a box round the trajectory of each point,
    without the rigid drift of all.  Boxes are larger by half of the activation distance and the
    radius of the point, so that those of two points overlap if their gap can fall below the
    activation distance."""
    reach = (activation_distance / 2 + mesh.radius)[:, None]
    lower, upper = bounds.boxes()
    return lower - reach, upper + reach


def find_candidates(
    mesh: CollisionMesh,
    bounds: TrajectoryBounds,
    activation_distance: float,
    expected: tuple[int, int] = (0, 0),
) -> tuple[CandidatePairs, tuple[int, int]]:
    """Return this rank's contact pairs whose gap can fall below a distance while points stay within
    bounds, and how many pairs of triangles and of edges were found among bodies and solids.
    `expected`: these two numbers of an earlier search; 0: not known.

    1. Boxes of primitives, with half of the distance and their radius around them, overlap.
    2. The gap at the beginning, less what the pair can come closer, is below the distance.  Both
       are asked in one pass: in packed layers most boxes overlap without coming near.
    3. Pairs are sorted by their primitives: their order depends on no position, so that sums over
       pairs are the same after a restart.
    4. Each point of a body and each boundary are a pair.
    """
    lower, upper = searched_boxes(mesh, bounds, activation_distance)
    near = Nearness(
        x0=bounds.x,
        x1=bounds.end,
        margin=bounds.margin,
        radius=mesh.radius,
        distance=activation_distance,
    )
    found = find_overlaps(
        mesh.surface, lower, upper, mesh.own_vertices, mesh.own_edges, expected, near
    )
    edge_pair_count = int((SIDES[found.kind] == Sides.EDGE_EDGE).sum())
    counts = (len(found) - edge_pair_count, edge_pair_count)
    first, second = found.primitives.T
    found = found.rows(np.lexsort((first, second, found.kind)))
    kind, shape = mesh.kinds_of(found.kind, found.primitives)
    candidates = CandidatePairs(
        kind=kind,
        points=found.points,
        shape=shape,
        identifier=mesh.identifiers(SIDES[kind], found.primitives),
        area=mesh.areas(found.kind, found.points, found.primitives),
        radius=mesh.radius[found.points[:, 0]] + mesh.radius[found.second_point],
    )
    # Most scenes have none.
    if mesh.boundaries:
        candidates = candidates.followed_by(mesh.boundary_pairs())
    return candidates, counts


def nearest_gaps(pairs: CandidatePairs, gap: Array, mesh: CollisionMesh) -> Array:
    """Return the gap (m,) [m] of each point of a contact to what is nearest on any rank, given the
    gaps (n,) of this rank's pairs, of which infinite ones are left out; infinite for points without
    a pair.  Collective."""
    nearest = np.full(mesh.points.count, np.inf)
    rows = np.isfinite(gap)
    points = pairs.points[rows]
    gap = gap[rows]
    boundaries = is_boundary(pairs.kind[rows])
    for k in range(4):
        np.minimum.at(nearest, points[~boundaries, k], gap[~boundaries])
    # Only the first point of a boundary pair is a point that touches.
    np.minimum.at(nearest, points[boundaries, 0], gap[boundaries])
    mesh.take_minimum(nearest)
    return nearest
