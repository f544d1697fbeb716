"""Edge loops of a film: virtual walls between chambers, through which gas may pass."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import basix
import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from gossamer_fx.algebra.point_measures import Gather, add_blocks
from gossamer_fx.algebra.rotations import cross_matrices
from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.model.body import Array
from gossamer_fx.terms.assembly import Assembly

Indices = npt.NDArray[np.int64]
# end vertices, end nodes, the node between them or -1, and where on the mesh the edge starts and ends
Edge = tuple[int, int, int, int, int, tuple[float, ...], tuple[float, ...]]

ALIKE = 1e-9  # of a ring's extent: coordinates that differ by less count as equal


@check_arguments
@dataclass(frozen=True, eq=False)
class Ring:
    """A closed line of film edges: the named group of curves `edges`.

    As the `area` of an `Orifice` it is the deformed opening, |½ ∮ x × dx| [m²], taken half a step ahead of the known
    state: a folded tube chokes where it is folded.  In `Chamber(rings=...)` it is spanned by strips between opposite
    edges, which close the chamber; the pressure on the strips is borne by the nodes at their ends.
    """

    body: Membrane
    edges: str

    def requires(self) -> Iterable[Any]:
        yield self.body

    def loop(self) -> Indices:
        """The edges in the order of a walk around the ring, on every rank.

        An array (n, 5) of end vertices, end nodes and nodes between (or -1), in global numbers.  The walk starts where
        the mesh has the lowest x, of these the lowest y, then z: at the same place for any number of ranks, and at the
        seam of a tube that is pressed flat.

        Raises:
            InputError: the edges do not form one closed line.
        """
        edges = sorted(e for part in self.body.comm.allgather(self._own_edges()) for e in part)
        one_loop = f"Ring: the edges '{self.edges}' of '{self.body.name}' form no closed line; name a group that does."
        at: dict[int, list[int]] = {}
        for i, (a, b, *_) in enumerate(edges):
            at.setdefault(a, []).append(i)
            at.setdefault(b, []).append(i)
        check(len(edges) > 2 and all(len(meeting) == 2 for meeting in at.values()), one_loop)
        walk: list[Edge] = []
        i, vertex = 0, edges[0][0]
        while not walk or i != 0:
            a, b, node_a, node_b, middle, start, end = edges[i]
            walk.append(edges[i] if a == vertex else (b, a, node_b, node_a, middle, end, start))
            vertex = walk[-1][1]
            i = sum(at[vertex]) - i
        check(len(walk) == len(edges), one_loop)
        starts = np.array([edge[5] for edge in walk])
        low = starts.min(axis=0)
        x, y, z = np.rint(
            (starts - low) / (ALIKE * float(np.linalg.norm(starts.max(axis=0) - low)) or 1.0)
        ).T
        return np.roll(
            np.array([edge[:5] for edge in walk]), -int(np.lexsort((z, y, x))[0]), axis=0
        )

    def _own_edges(self) -> list[Edge]:
        """This rank's edges."""
        film = self.body
        table = film.mesh.edges
        edges = film.mesh.curve(self.edges, f"Ring on '{film.name}'")
        own = edges[edges < table.owned]
        local = table.nodes(film.space, own)
        nodes = film.block.index_map.local_to_global(local.ravel()).reshape(local.shape)
        middles = nodes[:, 1] if film.order == 2 else np.full(len(own), -1)
        x = film.space.tabulate_dof_coordinates()
        numbers: Any = np.column_stack(
            [table.ends[own], nodes[:, 0], nodes[:, -1], middles]
        ).tolist()
        starts, ends = (
            [(float(a), float(b), float(c)) for a, b, c in x[local[:, k]]] for k in (0, -1)
        )
        rows = zip(numbers, starts, ends, strict=True)
        return [
            (a, b, node_a, node_b, middle, start, end)
            for (a, b, node_a, node_b, middle), start, end in rows
        ]


class Loop:
    """A ring in a running scene; every rank knows all of its nodes.

    The walk goes from its first vertex along both sides at once: edge i on the one side and edge i on the other span a
    strip x(s, r) = (1 - r) x_a(s) + r x_b(s), between them.  (Of an odd number the last edge spans one with its end.)
    With n = x,s × x,r of all strips

        a = ∫∫ n ds dr,   G[w] = ∫∫ n·w ds dr,   V = ⅓ G[x]

    are area vector, gradient of the volume, and volume; a node is coupled to those of two strips only, and the pressure
    is spread as the strips' areas are.
    """

    def __init__(self, ring: Ring, system: Assembly) -> None:
        walk = ring.loop()
        self.vertices = walk[:, :2]
        order, n = ring.body.order, len(walk)
        nodes = walk[:, 2] if order == 1 else np.concatenate([walk[:, 2], walk[:, 4]])
        self._strips = _strips(n, order)
        s, ws = (
            np.asarray(part)
            for part in basix.make_quadrature(basix.CellType.interval, 3 * order - 1)
        )
        r, wr = (np.asarray(part) for part in basix.make_quadrature(basix.CellType.interval, 2))
        element: Any = basix.create_element(basix.ElementFamily.P, basix.CellType.interval, order)
        N, dN = element.tabulate(1, s)[:, :, :, 0]
        across, slope = np.stack([1 - r[:, 0], r[:, 0]], axis=1), np.array([-1.0, 1.0])

        def at_points(along: Array, sideways: Array) -> Array:
            """Products (points, nodes of a strip) of functions along it and across."""
            return np.einsum("si,rj->srji", along, sideways).reshape(len(s) * len(r), -1)

        self._ds, self._dr = (
            at_points(dN, across),
            at_points(N, np.broadcast_to(slope, across.shape)),
        )
        self._test = at_points(N, across) * np.outer(ws, wr).reshape(-1, 1)
        self._weights = np.outer(ws, wr).ravel()
        # products (points, i j) of a test function and the slope of another function
        self._by_xr, self._by_xs = (
            np.einsum("gi,gj->gij", self._test, slopes).reshape(len(slopes), -1)
            for slopes in (self._dr, self._ds)
        )

        self._system, self._α = system, system.rule.alpha
        self.indices = system.block(ring.body).to_global(nodes)
        self._gather = Gather(system.numbering, [self.indices])
        start, end = system.q0.getOwnershipRange()
        self._mine = (self.indices[:, 0] >= start) & (self.indices[:, 0] < end)
        self._own = self.indices[self._mine] - start
        self._rows = strip, _ = np.nonzero(self._mine[self._strips])
        columns = self.indices[self._strips[strip]].reshape(len(strip), 3 * self._strips.shape[1])
        self._places = self.indices[self._strips[self._rows]], columns
        self._X0: Array = np.zeros((len(nodes), 3))
        self._X1: Array = self._X0
        self.gradients: tuple[Array, Array] = (self._X0, self._X0)  # at q̄ and at q1

    def aperture(self, h: float) -> float:
        """|a| [m²] at q0 + ½ h v0: the middle of the coming step, to second order."""
        X = self._gather(self._system.q0)[0] + h / 2 * self._gather(self._system.v0)[0]
        xs, xr = self._tangents(X)
        return float(np.linalg.norm(np.einsum("g,ngd->d", self._weights, _cross(xs, xr))))

    def follow(self) -> None:
        """Take the end of the step from the system."""
        self._X1 = self._gather(self._system.q1)[0]
        self.gradients = self._gradient(self._middle()), self._gradient(self._X1)

    def accept(self) -> None:
        """The end of this step is the start of the next."""
        self._X0 = self._X1

    def products(self) -> Array:
        """G(q1)·q1, the sum of its terms' sizes, and G(q̄)·(q1 - q0): its share of three volumes, or of round-off."""
        mid, end = self.gradients
        terms = end * self._X1
        return np.array([terms.sum(), abs(terms).sum(), (mid * (self._X1 - self._X0)).sum()])

    def direction(self, vertices: Indices) -> Indices:
        """+1 or -1 for edges (k, 2), given by global end vertices, that the walk passes so or the other way; 0 else."""
        steps = {(int(a), int(b)) for a, b in self.vertices}
        pairs = ((int(a), int(b)) for a, b in vertices)
        return np.array([((a, b) in steps) - ((b, a) in steps) for a, b in pairs], dtype=np.int64)

    def add_own(self, values: Array, start: int, G: Array) -> None:
        """Add a gradient to this rank's share of the film, which begins at `start` of its part of a system vector."""
        values[self._own - start] += G[self._mine]

    def add_tangent(self, A: PETSc.Mat, scale: float) -> None:
        """A += scale · α · ∂G/∂q at q̄; each rank adds its rows."""
        xs, xr = self._tangents(self._middle())
        # G_i changes by Σ_j a_ij × δx_j
        k, n = self._strips.shape[1], len(self._strips)
        a = (self._by_xr.T @ xs - self._by_xs.T @ xr).reshape(n, k, k, 3)
        strip, i = self._rows
        blocks = scale * self._α * cross_matrices(a[strip, i])  # (rows, nodes, 3, 3)
        add_blocks(A, *self._places, blocks.transpose(0, 2, 1, 3).reshape(len(strip), 3, 3 * k))

    def _middle(self) -> Array:
        X: Array = (1 - self._α) * self._X0 + self._α * self._X1
        return X

    def _tangents(self, X: Array) -> tuple[Array, Array]:
        """x,s and x,r (strips, points, 3)."""
        corners = X[self._strips]
        return self._ds @ corners, self._dr @ corners

    def _gradient(self, X: Array) -> Array:
        """G (n, 3) of the positions X (n, 3)."""
        xs, xr = self._tangents(X)
        G = np.zeros_like(X)
        np.add.at(G, self._strips, self._test.T @ _cross(xs, xr))
        return G


def _strips(n: int, order: int) -> Indices:
    """Nodes of the strips of a ring of n edges: on either side start, end and, of order 2, the node between.

    Vertex i of the walk is node i, the node on the edge behind it n + i.
    """
    pairs = np.arange(n // 2)
    there = [pairs, pairs + 1, n + pairs]
    back = [(n - pairs) % n, n - 1 - pairs, 2 * n - 1 - pairs]
    strips = np.stack([*there[: order + 1], *back[: order + 1]], axis=1)
    if n % 2:
        m = n // 2
        strips = np.vstack([strips, [*(m, m + 1, n + m)[: order + 1], *[m + 1] * (order + 1)]])
    return strips


def _cross(a: Array, b: Array) -> Array:
    """a × b of (..., 3): NumPy's own takes thrice the time for so few."""
    (ax, ay, az), (bx, by, bz) = (np.moveaxis(v, -1, 0) for v in (a, b))
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)
