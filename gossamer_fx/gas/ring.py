"""Edge loops of a film: virtual walls between chambers, through which gas may pass."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import basix
import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from gossamer_fx.algebra.places import Gather, add_blocks
from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.errors import check
from gossamer_fx.model.terms import Array, Assembly

Indices = npt.NDArray[np.int64]
Edge = tuple[int, int, int, int, int]  # end vertices, end nodes, and the node between them or -1


@dataclass(frozen=True, eq=False)
class Ring:
    """A closed line of film edges: the named group of curves `edges`.

    As the `area` of an `Orifice` it is the deformed opening, |½ ∮ x × dx| [m²], taken half a step ahead of the known
    state: a folded tube chokes where it is folded.  In `Chamber(rings=...)` it is spanned by a fan of triangles from
    the mean of its nodes, which closes the chamber; the pressure on the fan is borne by the ring.
    """

    film: Membrane
    edges: str

    def requires(self) -> Iterable[Any]:
        yield self.film

    def loop(self) -> Indices:
        """The edges in the order of a walk around the ring, on every rank.

        An array (n, 5) of `Edge`s in global numbers.

        Raises:
            InputError: the edges do not form one closed line.
        """
        edges = sorted(e for part in self.film.comm.allgather(self._own_edges()) for e in part)
        one_loop = f"Ring: the edges '{self.edges}' of '{self.film.name}' form no closed line; name a group that does."
        at: dict[int, list[int]] = {}
        for i, (a, b, *_) in enumerate(edges):
            at.setdefault(a, []).append(i)
            at.setdefault(b, []).append(i)
        check(len(edges) > 2 and all(len(meeting) == 2 for meeting in at.values()), one_loop)
        walk: list[Edge] = []
        i, vertex = 0, edges[0][0]
        while not walk or i != 0:
            a, b, node_a, node_b, middle = edges[i]
            walk.append(edges[i] if a == vertex else (b, a, node_b, node_a, middle))
            vertex = walk[-1][1]
            i = sum(at[vertex]) - i
        check(len(walk) == len(edges), one_loop)
        return np.array(walk)

    def _own_edges(self) -> list[Edge]:
        """This rank's edges: global numbers of end vertices, of end nodes, and of the node between (or -1)."""
        film = self.film
        table = film.mesh.edges
        edges = film.mesh.curve(self.edges, f"Ring on '{film.name}'")
        own = edges[edges < table.owned]
        local = table.nodes(film.space, own)
        nodes = film.block.index_map.local_to_global(local.ravel()).reshape(local.shape)
        middles = nodes[:, 1] if film.order == 2 else np.full(len(own), -1)
        columns = (*table.ends[own].T, nodes[:, 0], nodes[:, -1], middles)
        return list(zip(*(column.tolist() for column in columns), strict=True))


class Loop:
    """A ring in a running scene; every rank knows all of its nodes.

    With the positions X (n, 3) of its nodes, their mean c, and the curve x(s), the fan x_c + r (x(s) - c) has

        a = ½ ∮ (x - c) × dx,   G[w] = ∮ (x - c) × dx · (w/3 + w_c/6),   V = ⅓ G[x]

    area vector, gradient of the volume, and volume.
    """

    def __init__(self, ring: Ring, system: Assembly) -> None:
        walk = ring.loop()
        self.vertices = walk[:, :2]
        order = ring.film.order
        n = len(walk)
        nodes = walk[:, 2] if order == 1 else np.concatenate([walk[:, 2], walk[:, 4]])
        # shape functions of the edges at Gauss points, as matrices from the ring's nodes
        rule: Any = basix.make_quadrature(basix.CellType.interval, 5 if order == 2 else 1)
        points, weights = rule
        element: Any = basix.create_element(basix.ElementFamily.P, basix.CellType.interval, order)
        shapes, slopes = element.tabulate(1, points)[:, :, :, 0]
        N, D = np.zeros((2, n, len(points), len(nodes)))
        for e in range(n):
            own = [e, (e + 1) % n] + ([n + e] if order == 2 else [])
            N[e][:, own], D[e][:, own] = shapes, slopes
        N, self._D = N.reshape(-1, len(nodes)), D.reshape(-1, len(nodes))
        self._weights = np.tile(weights, n)
        self._P = N - 1 / len(nodes)
        self._T = self._weights[:, None] * (N / 3 + 1 / (6 * len(nodes)))

        self._system = system
        self.indices = system.numbering.to_global(system.bodies.index(ring.film), nodes)
        self._gather = Gather(system.numbering, [self.indices])
        start, end = system.q0.getOwnershipRange()
        self._mine = (self.indices[:, 0] >= start) & (self.indices[:, 0] < end)
        self._own = self.indices[self._mine] - start
        self._X0: Array = np.zeros((len(nodes), 3))
        self._X1: Array = self._X0

    def aperture(self, h: float) -> float:
        """|a| [m²] at q0 + ½ h v0: the middle of the coming step, to second order."""
        X = self._gather(self._system.q0)[0] + h / 2 * self._gather(self._system.v0)[0]
        return float(np.linalg.norm(self._weights @ np.cross(self._P @ X, self._D @ X)) / 2)

    def follow(self) -> None:
        """Take the end of the step from the system."""
        self._X1 = self._gather(self._system.q1)[0]

    def accept(self) -> None:
        """The end of this step is the start of the next."""
        self._X0 = self._X1

    def gradient(self, share: float) -> Array:
        """G (n, 3) at (1 - share) q0 + share q1."""
        X: Array = (1 - share) * self._X0 + share * self._X1
        G: Array = self._T.T @ np.cross(self._P @ X, self._D @ X)
        return G

    def direction(self, vertices: Indices) -> Indices:
        """+1 or -1 for edges (k, 2), given by global end vertices, that the walk passes so or the other way; 0 else."""
        steps = {(int(a), int(b)) for a, b in self.vertices}
        pairs = ((int(a), int(b)) for a, b in vertices)
        return np.array([((a, b) in steps) - ((b, a) in steps) for a, b in pairs], dtype=np.int64)

    def add_own(self, values: Array, start: int, G: Array) -> None:
        """Add a gradient to this rank's share of the film, which begins at `start` of its part of a system vector."""
        values[self._own - start] += G[self._mine]

    def add_tangent(self, A: PETSc.Mat, scale: float, share: float) -> None:
        """A += scale · share · ∂G/∂q at that configuration; each rank adds its rows."""
        X = (1 - share) * self._X0 + share * self._X1
        Y, Z = self._P @ X, self._D @ X
        n = len(X)
        K = np.zeros((n, 3, n, 3))
        # component i of u × v is ε_ijk u_j v_k
        for i, j, k, sign in ((0, 1, 2, 1), (1, 2, 0, 1), (2, 0, 1, 1), (0, 2, 1, -1), (1, 0, 2, -1), (2, 1, 0, -1)):
            K[:, i, :, j] += sign * self._T.T @ (Z[:, k, None] * self._P)
            K[:, i, :, k] += sign * self._T.T @ (Y[:, j, None] * self._D)
        rows = self.indices[self._mine].ravel()
        block = scale * share * K[self._mine].reshape(1, len(rows), 3 * n)
        if len(rows):
            add_blocks(A, rows[None], self.indices.reshape(1, -1), block)


class Loops:
    """The rings of a running scene: each once, though two chambers and an orifice may share it."""

    def __init__(self, system: Assembly) -> None:
        self.comm = system.comm
        self._system = system
        self._of: dict[Ring, Loop] = {}

    def of(self, ring: Ring) -> Loop:
        """The loop of a ring, made when it is first asked for."""
        if ring not in self._of:
            self._of[ring] = Loop(ring, self._system)
        return self._of[ring]

    def follow(self) -> None:
        """Take the end of the step from the system."""
        for loop in self._of.values():
            loop.follow()

    def accept(self) -> None:
        """The end of this step is the start of the next."""
        for loop in self._of.values():
            loop.accept()
