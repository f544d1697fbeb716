"""Edges that pierce triangles, of films that may or may not be kept apart by a contact."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

import numpy as np

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.errors import check
from gossamer_fx.contact.facets import facets_of
from gossamer_fx.contact.kernel import Integers, library
from gossamer_fx.contact.search import Surface, Tree
from gossamer_fx.model.terms import Array
from gossamer_fx.outputs.run import Run

ROUND_OFF = 1e-14  # error of a volume in double precision, over the sum of its terms' sizes


class Crossings:
    """Number of edges of films that pierce a triangle of the same or another one, with which they have no common node.

    Signs of volumes are exact: where double precision does not tell them, they are computed in fractions.  An edge that
    only touches a triangle does not pierce it.  Films of order 2 are cut into plane triangles.  Boxes of triangles are
    in a tree, and each rank asks for its part of the edges; every rank knows all positions, as with `Contact`.

    Args:
        films: one or several, in the scene.

    Raises:
        InputError: no film, or one twice.
    """

    def __init__(self, *films: Membrane) -> None:
        check(bool(films), "Crossings: there is no film; give one or several.")
        for k, film in enumerate(films):
            check(isinstance(film, Membrane), f"Crossings: {getattr(film, 'name', film)!r} is no film; give films.")
            check(not any(film is other for other in films[:k]), f"Crossings: '{film.name}' is given twice.")
        self.films = films
        self._surface: Surface | None = None

    def __call__(self, run: Run) -> float:
        bodies, system = run.system.bodies, run.system
        for film in self.films:
            check(any(film is b for b in bodies), f"'{film.name}' is not in the scene; add it, or remove its probe.")
        library(run.comm)
        if self._surface is None:
            self._take()
        assert self._surface is not None
        owned = [system.q0.array_r[system.numbering.owned(bodies.index(film))].reshape(-1, 3) for film in self.films]
        x = np.concatenate(
            [np.concatenate(run.comm.allgather(part))[nodes] for part, nodes in zip(owned, self._nodes, strict=True)]
        )
        mine = np.arange(run.comm.rank, len(self._surface.edges), run.comm.size, dtype=np.int32)
        return float(run.comm.allreduce(len(piercing(self._surface, np.ascontiguousarray(x), mine))))

    def _take(self) -> None:
        """Points, edges and triangles of all films."""
        facets = [facets_of(film) for film in self.films]
        self._nodes = [f.nodes for f in facets]
        starts = np.cumsum([0, *(len(f.nodes) for f in facets)])
        T = np.vstack([f.triangles + start for f, (start, _) in zip(facets, pairwise(starts), strict=True)])
        sides = np.unique(np.sort(T[:, [[0, 1], [1, 2], [0, 2]]].reshape(-1, 2), axis=1), axis=0)
        edges, triangles = (np.ascontiguousarray(part, dtype=np.int32) for part in (sides, T))
        n = int(starts[-1])
        self._surface = Surface(np.arange(n, dtype=np.int32), edges, triangles, np.zeros(n, dtype=np.uint8))


def piercing(surface: Surface, x: Array, edges: Integers) -> Integers:
    """Which of some edges pierce a triangle, at points x (m, 3); exactly."""
    if not (len(edges) and len(surface.triangles)):
        return edges[:0]
    lines, triangles = surface.edges, surface.triangles
    boxes = [np.ascontiguousarray(np.hstack([x[part].min(axis=1), x[part].max(axis=1)])) for part in (triangles, lines)]
    fixed = surface.all_fixed(lines), surface.all_fixed(triangles)
    near = Tree(boxes[0]).overlapping(edges, boxes[1], lines, triangles, fixed)
    e, (a, b, c) = lines[near[:, 0]], triangles[near[:, 1]].T
    p, q = e.T
    sides = _signs(x, a, b, c, p) * _signs(x, a, b, c, q) < 0
    near, p, q, a, b, c = (part[sides] for part in (near, p, q, a, b, c))
    u, v, w = _signs(x, p, q, a, b), _signs(x, p, q, b, c), _signs(x, p, q, c, a)
    return np.unique(near[(u == v) & (v == w) & (u != 0), 0])


def _signs(x: Array, a: Integers, b: Integers, c: Integers, d: Integers) -> Integers:
    """Signs (n,) of the volumes (b - a) × (c - a) · (d - a) of points; exact."""
    u, v, w = x[b] - x[a], x[c] - x[a], x[d] - x[a]
    volume = np.einsum("ni,ni->n", np.cross(u, v), w)
    sizes = [np.abs(x[i]).max(axis=1) + np.abs(x[a]).max(axis=1) for i in (b, c, d)]
    unsure = np.flatnonzero(np.abs(volume) <= 6 * ROUND_OFF * sizes[0] * sizes[1] * sizes[2])
    sign = np.sign(volume).astype(np.int32)
    for i in unsure:
        sign[i] = _exact_sign(x[[a[i], b[i], c[i], d[i]]])
    return sign


def _exact_sign(corners: Array) -> int:
    origin, *others = ([Fraction(float(value)) for value in corner] for corner in corners)
    (a, b, c), (d, e, f), (g, h, i) = ([p - o for p, o in zip(other, origin, strict=True)] for other in others)
    volume = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return (volume > 0) - (volume < 0)
