"""Coulomb friction of contact pairs: a stress against how far their points slide, measured so that no rotation counts.

Of a pair that presses with the mean force N in a step, let r lead from a point of the one side to that of the
other, both fixed in the material, and let t1 and t2 be directions fixed in the material: edges of the pair, or axes of
the solid.  The measures

    m_i = r·t_i

are quadratic in the coordinates and do not change when the pair moves and turns as a whole; at the start their
gradients with respect to r are two directions across the normal.  A step slides by w = (m_1, m_2)(q1) - (m_1, m_2)(q0)
and has the stress

    S = μ N φ(|w|/w_s) w/|w|,   φ(y) = 2y - y² for y < 1, else 1,   w_s = h v_s

as the force Dm(q̄)ᵀ S.  S·w ≥ 0 is what the step dissipates, and momentum and angular momentum stay: the moment of two
forces at a distance is carried by the directions.  Of solids the point lies where the film's is, so that a ball rolls.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gossamer_fx.contact.geometry.collision_mesh import CollisionMesh
from gossamer_fx.contact.kernels.library import Array, Integers
from gossamer_fx.contact.potential import (
    EDGE_EDGE,
    IN_CYLINDER,
    IN_SPHERE,
    PLANE,
    POINT_TRIANGLE,
    TOUCHES,
    ContactPairs,
    act,
    nearest_points,
)

THIN = 1e-3  # sine of the angle to the normal below which an edge is no direction to slide along

# the edges of pairs by their four points: two of a triangle, or one of each side
EDGES = np.array([[[0, 1, -1, 0], [0, 1, 0, -1]], [[-1, 1, 0, 0], [0, 0, 1, -1]]], dtype=float)


@dataclass
class FrictionPairs:
    """n pairs that may rub, and the points between which they do.

    `nodes` (n, k), and as weights of these r (n, k) and t (n, 2, k); μ (n,).  N (n,) is the part along `normal` (n, 3)
    of the mean force of `pairs` on their points with the weights `side` (n, 4); each point is the sum of nodes with the
    weights `points` (n, 4, k).  `vectors` (n, k) are those behind the nodes, and `slots` (n, k k) the blocks that they
    couple.
    """

    pairs: ContactPairs
    law: int
    side: Array
    normal: Array
    nodes: Integers
    r: Array
    t: Array
    points: Array
    μ: Array
    vectors: npt.NDArray[np.int64]

    def __post_init__(self) -> None:
        self._before: Array | None = None
        self._steady = np.ones(
            len(self.nodes), dtype=bool
        )  # whether slopes beyond w_s can be relied on
        self.slots: Integers = np.zeros((0, 0), dtype=np.int32)

    def _vectors(self, x: Array) -> tuple[Array, Array]:
        """r (n, 3) and t (n, 2, 3) at points x."""
        at = x[self.nodes]
        return np.einsum("nk,nkc->nc", self.r, at), np.einsum("nik,nkc->nic", self.t, at)

    def _slide(self, x0: Array, x1: Array) -> tuple[Array, Array, Array, Array, Array]:
        """w (n, 2) of a step, and r, t in its middle and at its end."""
        (r0, t0), (r1, t1) = self._vectors(x0), self._vectors(x1)
        r, t = (r0 + r1) / 2, (t0 + t1) / 2
        w = np.einsum("nc,nic->ni", r, t1 - t0) + np.einsum("nic,nc->ni", t, r1 - r0)
        return w, r, t, r1, t1

    def _press(self, x0: Array, x1: Array, α: float, tangents: bool = False) -> tuple[Array, Array]:
        """N (n,) of a step, and its derivative (n, k, 3) with respect to the nodes if it is asked for."""
        done = act(self.pairs, x0, x1, self.law, α, each=True, tangents=tangents)
        forces = np.asarray(done.forces).reshape(-1, 4, 3)
        N = -np.einsum("nk,nc,nkc->n", self.side, self.normal, forces)
        pushes = (done.state == TOUCHES) & (N > 0)
        slope = np.zeros((0, 4, 3))
        if tangents:
            K = np.asarray(done.tangents).reshape(-1, 4, 3, 4, 3)
            slope = -np.einsum(
                "nk,nc,nkcld,n->nld", self.side, self.normal, K, pushes.astype(float), optimize=True
            )
            slope = np.einsum("npd,npk->nkd", slope, self.points)
        return np.where(pushes, N, 0.0), slope

    def _grip(self, w: Array, least: float) -> tuple[Array, Array, Array]:
        """|w|/w_s, g (n,) of S = μ N g w, and its derivative with respect to |w|; `least` is w_s [m]."""
        y = np.linalg.norm(w, axis=1) / least
        beyond = np.maximum(y, 1)
        return (
            y,
            np.where(y < 1, 2 - y, 1 / beyond) / least,
            np.where(y < 1, -1.0, -1 / beyond**2) / least**2,
        )

    def loss(self, x0: Array, x1: Array, least: float, α: float) -> float:
        """S·w [J] of a step."""
        w = self._slide(x0, x1)[0]
        return float(
            np.sum(
                self.μ * self._press(x0, x1, α)[0] * self._grip(w, least)[1] * (w * w).sum(axis=1)
            )
        )

    def add_forces(self, x0: Array, x1: Array, least: float, α: float, force: Array) -> None:
        """Add the forces on points to `force` (m, 3)."""
        w, r, t, _, _ = self._slide(x0, x1)
        S = (self.μ * self._press(x0, x1, α)[0] * self._grip(w, least)[1])[:, None] * w
        np.add.at(force, self.nodes, self._forces(S, r, t))

    def _forces(self, S: Array, r: Array, t: Array) -> Array:
        """Forces (n, k, 3) of a stress (n, 2) where the vectors are r and t."""
        of_r, of_t = np.einsum("ni,nic->nc", S, t), np.einsum("ni,nik->nk", S, self.t)
        forces: Array = self.r[:, :, None] * of_r[:, None] + of_t[:, :, None] * r[:, None]
        return forces

    def add_tangents(
        self, x0: Array, x1: Array, least: float, α: float, γ: float, moves: Array, values: Array
    ) -> None:
        """Add the derivative with respect to x1 to blocks; points of which `moves` is 0 have none."""
        w, r, t, r1, t1 = self._slide(x0, x1)
        y, grip, slope = self._grip(w, least)
        N, of_N = self._press(x0, x1, α, tangents=True)
        if (
            self._before is not None
        ):  # once it turned round, g alone leads near the solution, slowly and safely
            self._steady &= (self._before * w).sum(axis=1) >= 0
            self._steady |= np.linalg.norm(w - self._before, axis=1) < 0.1 * np.linalg.norm(
                w, axis=1
            )
        self._before = w
        bend = np.where(self._steady | (y < 1), slope / np.maximum(y * least, 1e-9 * least), 0.0)
        D = (self.μ * N)[:, None, None] * (
            grip[:, None, None] * np.eye(2) + bend[:, None, None] * _square(w)
        )
        middle, end = (
            self.r[:, None, :, None] * v[:, :, None] + self.t[..., None] * u[:, None, None]
            for u, v in ((r, t), (r1, t1))
        )
        K = np.einsum("nika,nij,njlb->nklab", middle, D, end, optimize=True)
        of_t = np.einsum("ni,nik->nk", (self.μ * N * grip)[:, None] * w, self.t)
        both = self.r[:, :, None] * of_t[:, None] + of_t[:, :, None] * self.r[:, None]
        K += α * γ * both[..., None, None] * np.eye(3)
        forces = self._forces((self.μ * grip)[:, None] * w, r, t)
        K += np.einsum("nka,nlb->nklab", forces, of_N)
        there = moves[self.nodes]
        K *= (there[:, :, None] * there[:, None])[..., None, None]
        np.add.at(values, self.slots, K.reshape(*self.slots.shape, 9))


def _square(w: Array) -> Array:
    """w wᵀ (n, 2, 2)."""
    both: Array = w[:, :, None] * w[:, None]
    return both


class Friction:
    """Friction of one contact at work.

    `own` is the coefficient of films, cables and beams with each other, `of_solids` that of each obstacle with them;
    `creep` the speed v_s [m/s] below which what sticks may slide.
    """

    def __init__(
        self,
        bodies: CollisionMesh,
        own: float,
        of_solids: Sequence[float],
        creep: float,
        system: Any,
    ) -> None:
        self._bodies, self._points, self._system, self._creep = bodies, bodies.points, system, creep
        self._μ = np.array([own] * len(bodies.indices) + list(of_solids))
        P = bodies.points.P
        self._vector = np.full(
            bodies.points.m, -1, dtype=np.int64
        )  # behind each point, if there is one
        self._vector[: bodies.points.n] = np.arange(bodies.points.n)
        frames = bodies.frames[bodies.frames >= 0]
        for i in (frames[:, None] + np.arange(4)).ravel():
            self._vector[i] = [*P.indices[P.indptr[i] : P.indptr[i + 1]], -1][0]
        self._moves = (self._vector >= 0).astype(float)
        self._rubbing: list[FrictionPairs] = []

    @property
    def _least(self) -> float:
        return self._creep * float(self._system.h)

    def take(self, pairs: ContactPairs, x0: Array, law: int) -> list[npt.NDArray[np.int64]]:
        """Let those of a step's pairs rub; the vectors (n, k) that each group of them couples."""
        pairs = pairs.some(self._μ[self._partner(pairs.nodes)] > 0)
        solid: npt.NDArray[np.bool_] = np.asarray((pairs.nodes >= self._points.n).any(axis=1))
        parts = (
            self._on_film(pairs.some(~solid), x0, law),
            self._on_solid(pairs.some(solid), x0, law),
        )
        self._rubbing = [part for part in parts if len(part.nodes)]
        return [part.vectors for part in self._rubbing]

    def place(self, slots: Sequence[Integers]) -> None:
        """Where the blocks of each group stand."""
        for part, of_part in zip(self._rubbing, slots, strict=True):
            part.slots = of_part

    # ---- forces -------------------------------------------------------------------------------------------------

    def add_forces(self, x0: Array, x1: Array, force: Array) -> None:
        """Add the forces on points to `force` (m, 3)."""
        for part in self._rubbing:
            part.add_forces(x0, x1, self._least, self._system.rule.alpha, force)

    def add_tangents(self, x0: Array, x1: Array, values: Array) -> None:
        """Add the derivative with respect to x1 to the blocks."""
        α, γ = self._system.rule.alpha, self._system.geometric
        for part in self._rubbing:
            part.add_tangents(x0, x1, self._least, α, γ, self._moves, values)

    def loss(self, x0: Array, x1: Array) -> float:
        """Dissipation [J] of a step, on this rank."""
        return sum(
            part.loss(x0, x1, self._least, self._system.rule.alpha) for part in self._rubbing
        )

    # ---- pairs --------------------------------------------------------------------------------------------------

    def _partner(self, nodes: Integers) -> npt.NDArray[np.intp]:
        """Number (n,) of what the coefficient of pairs (n, 4) belongs to: an obstacle if there is one."""
        return np.asarray(self._bodies.body[nodes].max(axis=1), dtype=np.intp)

    def _with_frame(self, nodes: Integers) -> Integers:
        """Points (n, 8) of pairs with obstacles: their own, and the obstacles' frames."""
        first = self._bodies.frames[self._partner(nodes) - len(self._bodies.indices)]
        return np.hstack([nodes, first[:, None] + np.arange(4)]).astype(np.int32)

    def _behind(self, points: Integers) -> npt.NDArray[np.int64]:
        """The vectors behind points (n, k); what has none repeats a node of the film."""
        vectors = self._vector[points]
        films = points < self._points.n
        film = points[np.arange(len(points)), films.argmax(axis=1)]
        return np.where(vectors >= 0, vectors, film[:, None])

    def _on_film(self, pairs: ContactPairs, x0: Array, law: int) -> FrictionPairs:
        """Pairs between films: the directions are edges, of which what is along the normal is taken away."""
        nodes, r = pairs.nodes, _weights(pairs, x0)
        t = EDGES[np.minimum(pairs.kind, EDGE_EDGE)]
        gap, edges = np.einsum("nk,nkc->nc", r, x0[nodes]), np.einsum("nik,nkc->nic", t, x0[nodes])
        normal = _unit(gap)
        along = np.einsum("nic,nc->ni", edges, normal)
        across = edges - along[:, :, None] * normal[:, None]
        # the gradient of r·t with respect to r is then across the normal
        t = (
            t
            - (along / (2 * np.maximum(np.linalg.norm(gap, axis=1), 1e-300)[:, None]))[:, :, None]
            * r[:, None]
        )
        t = np.einsum("nij,njk->nik", _orthonormal(across, np.linalg.norm(edges, axis=2)), t)
        side = np.where((pairs.kind == EDGE_EDGE)[:, None], [1.0, 1, 0, 0], [1.0, 0, 0, 0])
        own = np.broadcast_to(np.eye(4), (len(nodes), 4, 4))
        μ = self._μ[self._partner(nodes)]
        return FrictionPairs(pairs, law, side, normal, nodes, r, t, own, μ, self._behind(nodes))

    def _on_solid(self, pairs: ContactPairs, x0: Array, law: int) -> FrictionPairs:
        """Pairs with an obstacle: a point of the film, the point of the obstacle that is there, and two of its axes."""
        films = pairs.nodes < self._points.n
        weights = _weights(pairs, x0)
        of_film = np.abs(weights) * films
        points = self._with_frame(pairs.nodes)
        origin, axes = x0[points[:, 4]], x0[points[:, 5:]]
        place = np.einsum("nk,nkc->nc", of_film, x0[pairs.nodes])
        normal = _unit(
            self._towards(
                pairs, weights * np.where((weights * films).sum(axis=1) < 0, -1, 1)[:, None], x0
            )
        )
        n = np.einsum("nic,nc->ni", axes, normal)  # in the obstacle's axes
        t = np.zeros((len(points), 2, 8))
        t[:, 0, 5:] = _unit(np.cross(n, np.eye(3)[np.abs(n).argmin(axis=1)]))
        t[:, 1, 5:] = np.cross(n, t[:, 0, 5:])
        r = np.hstack(
            [of_film, -np.ones((len(points), 1)), -np.einsum("nic,nc->ni", axes, place - origin)]
        )
        μ = self._μ[self._partner(pairs.nodes)]
        side, of_frame = films.astype(float), self._by_frame(points)
        return FrictionPairs(
            pairs, law, side, normal, points, r, t, of_frame, μ, self._behind(points)
        )

    def _by_frame(self, points: Integers) -> Array:
        """Weights (n, 4, 8) by which the first four of points (n, 8) follow the film and the obstacle's frame."""
        weights = np.zeros((*points[:, :4].shape, 8))
        films = points[:, :4] < self._points.n
        weights[:, range(4), range(4)] = films
        vectors = np.repeat(self._vector[points[:, None, 4:]], 4, axis=1)
        rows = np.broadcast_to(points[:, :4, None], vectors.shape)
        there = (vectors >= 0) & ~films[:, :, None]
        if there.any():
            weights[:, :, 4:][there] = np.asarray(
                self._points.P[rows[there], vectors[there]]
            ).ravel()
        return weights

    @staticmethod
    def _towards(pairs: ContactPairs, weights: Array, x0: Array) -> Array:
        """A vector (n, 3) from each pair's obstacle towards its film."""
        x = x0[pairs.nodes]
        from_wall = x[:, 1] - x[:, 0]
        round_axis = np.einsum("nkc,nc->nk", x[:, 2:], from_wall)
        kinds = [(pairs.kind == kind)[:, None] for kind in (PLANE, IN_SPHERE, IN_CYLINDER)]
        ways = [x[:, 2], from_wall, np.einsum("nk,nkc->nc", round_axis, x[:, 2:])]
        return np.select(kinds, ways, np.einsum("nk,nkc->nc", weights, x))


def _unit(vectors: Array) -> Array:
    """Vectors (n, 3) of length one."""
    unit: Array = vectors / np.maximum(np.linalg.norm(vectors, axis=1), 1e-300)[:, None]
    return unit


def _weights(pairs: ContactPairs, x0: Array) -> Array:
    """Those (n, 4) of a pair's points in what leads from its second side to its first; of walls their point's alone."""
    kind, uv = pairs.kind, nearest_points(pairs.nodes, pairs.kind, x0)
    u, v, one = uv[:, 0], uv[:, 1], np.ones(len(uv))
    of_triangle = np.column_stack([one, u + v - 1, -u, -v])
    of_edges = np.column_stack([1 - u, u, v - 1, -v])
    kinds = [(kind == POINT_TRIANGLE)[:, None], (kind == EDGE_EDGE)[:, None]]
    weights: Array = np.select(kinds, [of_triangle, of_edges], np.array([1.0, 0, 0, 0]))
    return weights


def _orthonormal(vectors: Array, sizes: Array) -> Array:
    """Combinations (n, 2, 2) of two vectors (n, 2, 3) that are orthonormal, the longer one first in turn.

    `sizes` (n, 2) are the lengths below a small part of which a vector is none; its combination is zero.
    """
    n = np.arange(len(vectors))
    a, b = vectors[:, 0], vectors[:, 1]
    la, lb = np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1)
    out = np.zeros((len(vectors), 2, 2))
    if not len(n):
        return out
    swap = lb / np.maximum(sizes[:, 1], 1e-300) > la / np.maximum(sizes[:, 0], 1e-300)
    p, q = np.where(swap, 1, 0), np.where(swap, 0, 1)
    first, size = vectors[n, p], np.where(swap, lb, la)
    good = size > THIN * sizes[n, p]
    out[n, 0, p] = np.where(good, 1 / np.maximum(size, 1e-300), 0)
    unit = first * out[n, 0, p][:, None]
    part = (vectors[n, q] * unit).sum(axis=1)
    rest = np.linalg.norm(vectors[n, q] - part[:, None] * unit, axis=1)
    good &= rest > THIN * sizes[n, q]
    scale = np.where(good, 1 / np.maximum(rest, 1e-300), 0)
    out[n, 1, q] = scale
    out[n, 1, p] = -scale * part * out[n, 0, p]
    return out
