"""Continuous collision detection: whether pairs keep a least gap while their points move on
straight lines, and whether bodies turn too far in a step for such lines.

A film that turns by θ about its middle in a step is shorter by the factor cos(θ/2) half way along
straight lines, so that with a large angle it shrinks past what it would hit.  Such a step is
refused where something else is within reach.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.algebra.rank_exchange import maximum_over_ranks
from gossamer_fx.core.mesh.quality import box
from gossamer_fx.mechanics.bodies.rigid_body import RigidBody
from gossamer_fx.mechanics.contact.contract import Array, Int64Array, MaskArray
from gossamer_fx.mechanics.contact.geometry.collision_mesh import CollisionMesh
from gossamer_fx.mechanics.contact.kernels.library import library
from gossamer_fx.mechanics.contact.pairs import (
    CandidatePairs,
    PairDistances,
    PairTable,
    is_boundary,
    pair_list,
)
from gossamer_fx.mechanics.terms.assembly import Assembly

# Positions on the way at which a distance is computed at most.  A sail that turns moves far while
# its layers stay near each other: with 100, every third step of such a sail was refused for
# nothing.
MAX_ADVANCES = 1000

# Part of its gap at the start, or of the activation distance if that is less, that a pair must keep
# in a step.  Layers that come nearer have all but passed through, and the next step would start
# inside.
KEPT_GAP = 0.1


def find_violations(
    candidates: CandidatePairs,
    x0: Array,
    x1: Array,
    *,
    gap: Array,
    activation_distance: Array,
    approach: Array,
    among: MaskArray,
) -> np.ndarray:
    """Return the indices (k,), ascending, of the pairs that do not keep a tenth of their gap from
    x0 to x1, or of the activation distance if that is less (`KEPT_GAP`).

    `gap`: at x0 (n,) [m]; `approach`: by how much pairs can come closer in the step (n,) [m];
    `among`: mask (n,) of the pairs that are asked for; boundaries are left out in any case.
    """
    min_gap = KEPT_GAP * np.minimum(gap, activation_distance)
    can_come_near = approach > gap - min_gap
    rows = (can_come_near & ~is_boundary(candidates.kind) & among).nonzero()[0]
    collisions = find_collisions(
        candidates.geometry(rows),
        x0,
        x1,
        radius=candidates.radius[rows],
        gap=gap[rows],
        min_gap=min_gap[rows],
    )
    return rows[collisions]


def find_collisions(
    pairs: PairTable, x0: Array, x1: Array, radius: Array, gap: Array, min_gap: Array
) -> np.ndarray:
    """Return the indices (k,) of the pairs that come nearer than `min_gap` (n,) [m] on the straight
    way from x0, where their gap is `gap` (n,) [m], to x1; also of those for which `MAX_ADVANCES`
    evaluations could not decide.

    Source: additive continuous collision detection, Li, Kaufman & Jiang, "Codimensional incremental
    potential contact", ACM Trans. Graph. 40 (2021) 170, section 4, doi:10.1145/3450626.3459767.
    """
    # The compiled C library of contact, which checks the arrays that it gets
    c = library()
    count = len(pairs)
    points = len(x0)
    motion = c.struct(
        "pair_motion",
        {
            "x0": c.array("x0", x0, "float64", (points, 3)),
            "x1": c.array("x1", x1, "float64", (points, 3)),
            "radius": c.array("radius", radius, "float64", (count,)),
            "gap": c.array("gap", gap, "float64", (count,)),
            "min_gap": c.array("min_gap", min_gap, "float64", (count,)),
            "max_advances": MAX_ADVANCES,
        },
    )
    keeps_gap = np.empty(count, dtype=np.uint8)
    c.lib.check_motion(
        pair_list(pairs).pointer,
        motion.pointer,
        c.array("keeps_gap", keeps_gap, "uint8", (count,), writable=True),
    )
    return (keeps_gap == 0).nonzero()[0]


# Angle [rad] between two bodies in one step up to which straight lines are accepted: they are
# shorter than the arcs by an eighth of the radius.  Deployments turn by a tenth of it in a step.
MAX_TURN = 1.0

# Part of the moments of a body that is added to all directions, so that points on a line, which
# have no turn about it, are not given one.
LINE_REGULARISATION = 1e-6


@dataclass(frozen=True)
class _Turn:
    """How a body or obstacle turns in a step; a deformable body by the best rotation of its points.

    Attributes:
        rotation: matrix (3, 3) from the start to the end.
        centre: point (2, 3) [m] about which it turns, at the start and at the end.
    """

    rotation: Array
    centre: Array

    def angle_to(self, other: _Turn) -> float:
        """Return the angle [rad], 0 to π, by which one body turns relative to another one."""
        cosine = (np.sum(self.rotation * other.rotation) - 1) / 2
        return float(np.arccos(np.clip(cosine, -1.0, 1.0)))


STAYS = _Turn(np.eye(3), np.zeros((2, 3)))


class LargeTurns:
    """Finds bodies that turn past others in a step."""

    def __init__(self, mesh: CollisionMesh, activation_distance: float, system: Assembly) -> None:
        self._mesh = mesh
        self._system = system
        self._activation_distance = activation_distance
        self._rigid_bodies: list[RigidBody | None] = [None] * len(mesh.bodies)
        self._rigid_bodies += [obstacle.body for obstacle in mesh.obstacles]
        self._has_boundaries = [False] * len(mesh.names)
        for numbered in mesh.boundaries:
            self._has_boundaries[numbered.obstacle] = True
        of_solids = mesh.surface.vertices[mesh.points.body_count :]
        self._has_corners = [
            k < len(mesh.bodies) or bool((mesh.body[of_solids] == k).any())
            for k in range(len(mesh.names))
        ]

    def find(self, distances: PairDistances, x1: Array) -> str:
        """Report a body or obstacle that turns too far past another one in a step, as a clause that
        is empty if there is none; collective.

        A deformable body turns by the rotation that brings all its points nearest to where they are
        at the end of the step, an obstacle on a rigid body by that of the rigid body.  It turns too
        far if its rotation relative to the other one is more than `MAX_TURN`, its rotation in space
        is more than half of that, and it may meet the other one on its way.  Two obstacles are not
        compared.  `distances`: gaps and points at the start of the step; `x1`: points at its end.
        """
        count = len(self._mesh.names)
        body_count = len(self._mesh.bodies)
        # Without a second body or an obstacle there is nothing to turn past.
        if count < 2:
            return ""
        # Points of each body and obstacle.  Each point of a body counts on one rank; all ranks have
        # those of obstacles.
        own, _ = self._mesh.own_points()
        body = self._mesh.body[own]
        points = [own[body == k] for k in range(count)]
        turns = [self._turn(k, points[k], distances.x, x1) for k in range(count)]
        for one, other in permutations(range(count), 2):
            angle = turns[one].angle_to(turns[other])
            # Of two bodies the one that turns in space is named.  Obstacles do not touch each
            # other.
            turns_itself = turns[one].angle_to(STAYS) > MAX_TURN / 2
            can_touch = min(one, other) < body_count
            if not (angle > MAX_TURN and turns_itself and can_touch):
                continue
            if self._may_meet(one, other, points, turns[one], distances, x1):
                return (
                    f"'{self._mesh.names[one]}' would turn by {np.degrees(angle):.0f}° past "
                    f"'{self._mesh.names[other]}' in one step"
                )
        return ""

    def _turn(self, k: int, points: Int64Array, x0: Array, x1: Array) -> _Turn:
        """Return how a body or obstacle turns in a step; collective. A body on a mesh turns by the
        best rotation of its points (p,), an obstacle with its rigid body; other obstacles do not
        turn."""
        if k < len(self._mesh.bodies):
            return _best_turn(x0[points], x1[points], self._mesh.comm)
        body = self._rigid_bodies[k]
        if body is None:
            return STAYS
        frame = body.frame()
        vectors = [frame.origin, *frame.directors]
        start = self._system.state.vectors(vectors)
        end = self._system.end.vectors(vectors)
        return _Turn(end[1:].T @ start[1:], np.array([start[0], end[0]]))

    def _may_meet(
        self,
        one: int,
        other: int,
        points: Sequence[Int64Array],
        turn: _Turn,
        distances: PairDistances,
        x1: Array,
    ) -> bool:
        """Return whether a body or obstacle that turns may meet another on its way; collective.  It
        may if a boundary of the other one is within its radius from the centre of the turn, or if
        the box round the other one is.  `points`: numbers (p,) of those of each body and
        obstacle."""
        touching = min(one, other)  # a body on a mesh
        gap = self._gap_to_boundaries(touching, max(one, other), distances)
        if gap < self._radius(points[touching], turn, distances.x, x1):
            return True
        mine = points[one]
        others = points[other]
        if not (self._has_corners[one] and self._has_corners[other]):
            return False
        reach = self._radius(mine, turn, distances.x, x1) + self._activation_distance
        thickness = [self._mesh.radius[some].max(initial=0.0) for some in (mine, others)]
        reach += float(maximum_over_ranks(self._mesh.comm, np.array(thickness)).sum())
        ends = np.vstack([distances.x[others], x1[others]])
        # Of the other one, of all ranks together.
        low, high = box(self._mesh.comm, ends)
        lower = turn.centre.min(axis=0) - reach
        upper = turn.centre.max(axis=0) + reach
        is_apart = (low > upper) | (high < lower)
        return not is_apart.any()

    def _radius(self, points: Int64Array, turn: _Turn, x0: Array, x1: Array) -> float:
        """Return the largest distance [m] of points (p,) from the centre of a turn, at the start or
        the end of the step; collective."""
        start = np.linalg.norm(x0[points] - turn.centre[0], axis=1)
        end = np.linalg.norm(x1[points] - turn.centre[1], axis=1)
        own = float(max(start.max(initial=0.0), end.max(initial=0.0)))
        return float(self._mesh.comm.allreduce(own, op=MPI.MAX))

    def _gap_to_boundaries(self, body: int, obstacle: int, distances: PairDistances) -> float:
        """Return the least gap [m] of a body to the boundaries of an obstacle at the start."""
        if not self._has_boundaries[obstacle]:
            return np.inf
        pairs = distances.candidates
        sides = self._mesh.body[pairs.points[:, :2]]
        is_between = is_boundary(pairs.kind) & (sides == (body, obstacle)).all(axis=1)
        nearest = float(distances.gap[is_between].min(initial=np.inf))
        return self._system.comm.allreduce(nearest, op=MPI.MIN)


def _best_turn(start: Array, end: Array, comm: MPI.Intracomm) -> _Turn:
    """Return the rotation that brings the points of all ranks nearest to their end; collective. W.
    Kabsch, Acta Cryst. A 32 (1976) 922, doi:10.1107/S0567739476001873."""
    sums = comm.allreduce(np.concatenate([start.sum(axis=0), end.sum(axis=0), [len(start)]]))
    centre = sums[:6].reshape(2, 3) / sums[6]
    moments = comm.allreduce((end - centre[1]).T @ (start - centre[0]))
    scale = np.linalg.norm(moments)
    # Orthogonal factors u and vt of the singular value decomposition; a reflection is excluded by
    # the sign of their determinant.
    u, _, vt = np.linalg.svd(moments + LINE_REGULARISATION * scale * np.eye(3))
    handedness = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    return _Turn((u * handedness) @ vt, centre)
