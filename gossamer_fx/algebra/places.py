"""Degrees of freedom of attached vectors, measures of them as arrays, and their gather."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from petsc4py import PETSc

from gossamer_fx.algebra.numbering import GlobalIndices, Numbering
from gossamer_fx.checks.errors import check
from gossamer_fx.model.body import Array, Attached, Body, Ground, Port

LARGE = 50  # numbers of a block, for each of them, from which blocks are entered one by one


def is_here(place: tuple[Attached, ...]) -> bool:
    """Whether this rank evaluates a place: it owns the first node of the place's first port."""
    port = next(p for p in place if isinstance(p, Port))
    start, end = port.body.block.index_map.local_range
    return bool(start <= port.nodes[0] < end)


def is_point(port: Attached) -> float:
    """1 for a point of a body or of space, 0 for a director or a difference of points."""
    if isinstance(port, Ground):
        return 1.0
    vectors = port.vectors or (0,) * len(port.nodes)
    return sum(w for w, v in zip(port.weights, vectors, strict=True) if v == 0)


def own_places(places: Sequence[tuple[Attached, ...]]) -> list[int]:
    """Which of the places this rank evaluates."""
    return [i for i, place in enumerate(places) if is_here(place)]


def attach(
    numbering: Numbering, bodies: list[Body], place: tuple[Attached, ...]
) -> tuple[GlobalIndices, Array, Array]:
    """Unknowns (D,), map P (3k, D) and offset (3k,) of the stacked vectors X = P q + offset of a place."""
    indices, offset = [], np.zeros(3 * len(place))
    columns: list[tuple[int, float]] = []
    for j, port in enumerate(place):
        if isinstance(port, Ground):
            offset[3 * j : 3 * j + 3] = port.vector
            continue
        vectors = np.array(port.vectors or (0,) * len(port.nodes))
        check(
            len(port.nodes) == len(port.weights) == len(vectors)
            and bool((vectors * 3 < port.body.block.size).all()),
            f"A port of '{port.body.name}' has {len(port.nodes)} nodes, {len(port.weights)} weights and vectors "
            f"{port.vectors}; give one weight and one existing vector for each node.",
        )
        unknowns = numbering.to_global(
            bodies.index(port.body), np.array(port.nodes, dtype=np.int64)
        )
        rows = np.arange(len(vectors))[:, None]
        indices.append(unknowns[rows, 3 * vectors[:, None] + np.arange(3)].ravel())
        columns += [(j, w) for w in port.weights]
    P = np.zeros((3 * len(place), 3 * len(columns)))
    for k, (j, weight) in enumerate(columns):
        P[3 * j : 3 * j + 3, 3 * k : 3 * k + 3] = weight * np.eye(3)
    return np.concatenate(indices), P, offset


def attach_all(
    numbering: Numbering, bodies: list[Body], places: Sequence[tuple[Attached, ...]], rows: int
) -> tuple[GlobalIndices, Array, Array]:
    """Unknowns (n, D), maps (n, rows, D) and offsets (n, rows) of n places.

    Places with fewer unknowns than others take their first one several times, with weight zero.
    """
    attached = [attach(numbering, bodies, place) for place in places]
    D = max((len(indices) for indices, _, _ in attached), default=0)
    indices = np.array(
        [np.pad(i, (0, D - len(i)), constant_values=i[0]) for i, _, _ in attached],
        dtype=PETSc.IntType,
    )
    P = np.array([np.pad(p, ((0, 0), (0, D - p.shape[1]))) for _, p, _ in attached])
    o = np.array([offset for _, _, offset in attached])
    return (
        indices.reshape(len(attached), D),
        P.reshape(len(attached), rows, D),
        o.reshape(len(attached), rows),
    )


@dataclass(frozen=True, eq=False)
class PointMeasure:
    """Quadratic measures e_i = ½ X·H_i X + L_i·X + c_i of stacked attached vectors X (3k,): the same at n places.

    places: n tuples of k vectors, not all of them `Ground`; a place is evaluated on the rank of its first port, and
        each rank may list all places, or its own only.
    H (m, 3k, 3k) symmetric, L (m, 3k), c (m,), or (n, m) where the places differ
    """

    places: Sequence[tuple[Attached, ...]]
    H: Array
    L: Array
    c: Array


def nodes_of(measure: PointMeasure) -> int:
    """The largest number of nodes that a place of a measure ties."""
    return max(
        (sum(len(getattr(port, "nodes", ())) for port in place) for place in measure.places),
        default=0,
    )


class Places:
    """Point measures on this rank: e_i = ½ Y·H_i Y + L_i·Y + c_i of Y = P (q - z), q each place's D unknowns.

    Measures of one kind become one array, if they have as many strains m and unknowns D.
    Arrays over n places: indices (n, D), P (n, 3k, D), H (n, m, 3k, 3k), L (n, m, 3k), c (n, m); `of` (n,) is the
    measure of each.  Where P has not more columns than rows, H and L are those of q - z, and there is no P; else
    vectors that depend on many unknowns, as the points of a reduced film do, would have large matrices.
    z (n, D) is where the measures are stationary, if there is ground: ½|x - g|² of a point g far from the origin would
    else be a small difference of large numbers.
    """

    def __init__(
        self, numbering: Numbering, bodies: list[Body], measures: Sequence[PointMeasure]
    ) -> None:
        own = [own_places(measure.places) for measure in measures]
        self.of = np.repeat(np.arange(len(measures)), [len(o) for o in own])
        self.m = measures[0].H.shape[0]
        place = [m.places[i] for m, here in zip(measures, own, strict=True) for i in here]
        self.indices, P, o = attach_all(numbering, bodies, place, measures[0].H.shape[1])
        self.n, self.D = self.indices.shape
        H, L = (np.array([getattr(m, what) for m in measures])[self.of] for what in "HL")
        c = [
            np.broadcast_to(m.c, (len(m.places), self.m))[here]
            for m, here in zip(measures, own, strict=True)
        ]
        self._z = np.zeros((self.n, self.D))
        if o.any():
            slope = np.einsum("nax,nma->nmx", P, np.einsum("nmab,nb->nma", H, o) + L)
            for k in np.flatnonzero(o.any(axis=1)):
                stiffness = P[k].T @ H[k] @ P[k]
                self._z[k] = np.linalg.lstsq(
                    stiffness.reshape(-1, self.D), -slope[k].ravel(), rcond=1e-12
                )[0]
        X = np.einsum("nax,nx->na", P, self._z) + o
        HX = np.einsum("nmab,nb->nma", H, X)
        self.c = np.concatenate(c) + np.einsum("na,nma->nm", X, HX / 2 + L)
        self._P: Array | None
        self._H: Array
        self._L: Array
        self._P, self._H, self._L = (
            (P, H, HX + L) if P.shape[1] < self.D else (None, *_of_unknowns(P, H, HX + L))
        )
        # many unknowns of which all places depend, as those of a reduced film
        self.alike = (
            self._P is not None and self.n > 1 and bool((self.indices == self.indices[:1]).all())
        )
        self.linear = not any(measure.H.any() for measure in measures)
        self._slope = self.forces(self._L) if self.linear else None

    def vectors(self, q: Array) -> Array:
        """Y (n, 3k)."""
        u = q - self._z
        return u if self._P is None else (self._P @ u[..., None])[..., 0]

    def measure(self, Y: Array) -> Array:
        """e (n, m)."""
        found: Array = ((self._times(Y) / 2 + self._L) @ Y[..., None])[..., 0] + self.c
        return found

    def strain(self, q: Array) -> Array:
        """The same of the unknowns."""
        if self._slope is None:
            return self.measure(self.vectors(q))
        found: Array = (self._slope @ (q - self._z)[..., None])[..., 0] + self.c
        return found

    def gradient(self, q: Array) -> Array:
        """De (n, m, D)."""
        return self.forces(self.slope(self.vectors(q))) if self._slope is None else self._slope

    def slope(self, Y: Array, on: Any = slice(None)) -> Array:
        """∂e/∂Y (n, m, 3k), of all places, or of those that `on` picks, to which Y (k, 3k) then belongs."""
        return self._times(Y, on) + self._L[on]

    def bend(self, S: Array, on: Any = slice(None)) -> Array:
        """Σ_i S_i ∂²e_i/∂Y² (n, 3k, 3k) of stresses S (n, m)."""
        return np.einsum("nm,nmab->nab", S, self._H[on])

    def forces(self, f: Array, on: Any = slice(None)) -> Array:
        """Forces (n, j, D) on the unknowns of forces f (n, j, 3k) on Y."""
        return f if self._P is None else f @ self._P[on]

    def stiffness(self, K: Array, on: Any = slice(None)) -> Array:
        """Stiffness (n, D, D) of the unknowns of stiffness K (n, 3k, 3k) of Y."""
        return K if self._P is None else self._P[on].transpose(0, 2, 1) @ (K @ self._P[on])

    def sum_of_stiffness(self, K: Array, on: Any = slice(None)) -> Array:
        """The sum (D, D) of the stiffness of places with the same unknowns."""
        whole: Any = self._P
        P = whole[on]
        rows = P.shape[0] * P.shape[1]
        total: Array = P.reshape(rows, self.D).T @ (K @ P).reshape(rows, self.D)
        return total

    def second(self, v: Array) -> Array:
        """D²e[v, v] (n, m)."""
        Y = v if self._P is None else (self._P @ v[..., None])[..., 0]
        return np.einsum("na,nmab,nb->nm", Y, self._H, Y, optimize=True)

    def _times(self, Y: Array, on: Any = slice(None)) -> Array:
        """H Y (n, m, 3k); matrix products take less time than sums by Einstein's rule."""
        found: Array = (self._H[on] @ Y[:, None, :, None])[..., 0]
        return found


def _of_unknowns(P: Array, H: Array, L: Array) -> tuple[Array, Array]:
    """H (n, m, D, D) and L (n, m, D) of the unknowns."""
    return np.einsum("nax,nmab,nby->nmxy", P, H, P, optimize=True), np.einsum("nax,nma->nmx", P, L)


class Gather:
    """Fetches the unknowns of several places from a distributed vector, in one scatter."""

    def __init__(self, numbering: Numbering, indices: Sequence[GlobalIndices]) -> None:
        self._shapes = [i.shape for i in indices]
        needed = np.concatenate([np.zeros(0, dtype=PETSc.IntType), *[i.ravel() for i in indices]])
        self._parts = list(
            itertools.pairwise(itertools.accumulate((i.size for i in indices), initial=0))
        )
        self._values = PETSc.Vec().createSeq(len(needed))
        source = PETSc.IS().createGeneral(needed.astype(PETSc.IntType))
        self._scatter = PETSc.Scatter().create(numbering.vector(), source, self._values, None)

    def __call__(self, q: PETSc.Vec) -> list[Array]:
        self._scatter.scatter(q, self._values)
        values = self._values.array_r.copy()
        return [
            values[a:b].reshape(shape)
            for (a, b), shape in zip(self._parts, self._shapes, strict=True)
        ]


def add_blocks(A: PETSc.Mat, rows: GlobalIndices, columns: GlobalIndices, values: Array) -> None:
    """Add dense blocks values (n, r, c) at global rows (n, r) and columns (n, c) of A."""
    n, r, c = values.shape
    if n == 0:  # nothing on this rank
        return
    if r * c >= LARGE * n:
        for row, column, block in zip(rows, columns, values, strict=True):
            A.setValues(row, column, np.ascontiguousarray(block), addv=PETSc.InsertMode.ADD_VALUES)
        return
    A.setValuesIJV(
        np.arange(0, n * r * c + 1, c, dtype=PETSc.IntType),
        np.repeat(columns, r, axis=0).ravel().astype(PETSc.IntType),
        values.ravel(),
        addv=PETSc.InsertMode.ADD_VALUES,
        rowmap=rows.ravel().astype(PETSc.IntType),
    )
