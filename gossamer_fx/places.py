"""Vectors attached to bodies, in the unknowns of a system: which of them, and how they are fetched."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from petsc4py import PETSc

from gossamer_fx.errors import check
from gossamer_fx.numbering import GlobalIndices, Numbering
from gossamer_fx.parts import Array, Assembly, Attached, Body, Ground, PointMeasure, Port


def is_here(place: tuple[Attached, ...]) -> bool:
    """Whether this rank evaluates a place: it owns the first node of the place's first port."""
    port = next(p for p in place if isinstance(p, Port))
    start, end = port.body.block.index_map.local_range
    return bool(start <= port.nodes[0] < end)


def own_places(measure: PointMeasure) -> list[tuple[Attached, ...]]:
    """The places that this rank evaluates."""
    return [place for place in measure.places if is_here(place)]


def attach(numbering: Numbering, bodies: list[Body], place: tuple[Attached, ...]) -> tuple[GlobalIndices, Array, Array]:
    """Unknowns (D,), map P (3k, D) and offset (3k,) of the stacked vectors X = P q + offset of a place."""
    indices, offset = [], np.zeros(3 * len(place))
    columns: list[tuple[int, float]] = []
    for j, port in enumerate(place):
        if isinstance(port, Ground):
            offset[3 * j : 3 * j + 3] = port.vector
            continue
        vectors = np.array(port.vectors or (0,) * len(port.nodes))
        check(
            len(port.nodes) == len(port.weights) == len(vectors) and bool((vectors * 3 < port.body.block.size).all()),
            f"A port of '{port.body.name}' has {len(port.nodes)} nodes, {len(port.weights)} weights and vectors "
            f"{port.vectors}; give one weight and one existing vector for each node.",
        )
        unknowns = numbering.to_global(bodies.index(port.body), np.array(port.nodes, dtype=np.int64))
        rows = np.arange(len(vectors))[:, None]
        indices.append(unknowns[rows, 3 * vectors[:, None] + np.arange(3)].ravel())
        columns += [(j, w) for w in port.weights]
    P = np.zeros((3 * len(place), 3 * len(columns)))
    for k, (j, weight) in enumerate(columns):
        P[3 * j : 3 * j + 3, 3 * k : 3 * k + 3] = weight * np.eye(3)
    return np.concatenate(indices), P, offset


class Places:
    """A point measure on this rank: e_i = ½ q·H_i q + L_i·q + c_i of each place's D unknowns q.

    Arrays over n places: indices (n, D), H (n, m, D, D), L (n, m, D), c (n, m).
    """

    def __init__(self, name: str, numbering: Numbering, bodies: list[Body], measure: PointMeasure) -> None:
        attached = [attach(numbering, bodies, place) for place in own_places(measure)]
        self.n, self.m = len(attached), len(measure.c)
        widths = {len(indices) for indices, _, _ in attached}
        check(len(widths) <= 1, f"The places of '{name}' have different numbers of nodes; give each kind its own part.")
        self.D = D = widths.pop() if widths else 0
        self.indices = np.array([i for i, _, _ in attached], dtype=PETSc.IntType).reshape(self.n, D)
        k = measure.H.shape[1]
        P = np.array([p for _, p, _ in attached]).reshape(self.n, k, D)
        o = np.array([o for _, _, o in attached]).reshape(self.n, k)
        Ho = np.einsum("mab,nb->nma", measure.H, o)
        self.H = np.einsum("nax,mab,nby->nmxy", P, measure.H, P, optimize=True)
        self.L = np.einsum("nax,nma->nmx", P, Ho + measure.L)
        self.c = measure.c + np.einsum("na,nma->nm", o, Ho / 2 + measure.L)

    def strain(self, q: Array) -> Array:
        """e (n, m)."""
        return np.einsum("nmx,nx->nm", np.einsum("nmxy,ny->nmx", self.H, q) / 2 + self.L, q) + self.c

    def gradient(self, q: Array) -> Array:
        """De (n, m, D)."""
        return np.einsum("nmxy,ny->nmx", self.H, q) + self.L


class Gather:
    """Fetches the unknowns of several places from a distributed vector, in one scatter."""

    def __init__(self, numbering: Numbering, indices: Sequence[GlobalIndices]) -> None:
        self._shapes = [i.shape for i in indices]
        needed = np.concatenate([np.zeros(0, dtype=PETSc.IntType), *[i.ravel() for i in indices]])
        self._ends = np.cumsum([i.size for i in indices])
        self._values = PETSc.Vec().createSeq(len(needed))
        source = PETSc.IS().createGeneral(needed.astype(PETSc.IntType))
        self._scatter = PETSc.Scatter().create(numbering.vector(), source, self._values, None)

    def __call__(self, q: PETSc.Vec) -> list[Array]:
        self._scatter.scatter(q, self._values)
        parts = np.split(self._values.array_r.copy(), self._ends[:-1])
        return [part.reshape(shape) for part, shape in zip(parts, self._shapes, strict=True)]


def values_of(system: Assembly, ports: Sequence[Attached], q: PETSc.Vec) -> Array:
    """The attached vectors (k, 3) in a state, e.g. `system.q0`, or their rates in `system.v0` if none is `Ground`."""
    indices, P, offset = attach(system.numbering, system.bodies, tuple(ports))
    values = Gather(system.numbering, [indices])(q)[0]
    return (P @ values + offset).reshape(-1, 3)


def add_blocks(A: PETSc.Mat, rows: GlobalIndices, columns: GlobalIndices, values: Array) -> None:
    """Add dense blocks values (n, r, c) at global rows (n, r) and columns (n, c) of A."""
    n, r, c = values.shape
    if n == 0:  # nothing on this rank
        return
    A.setValuesIJV(
        np.arange(0, n * r * c + 1, c, dtype=PETSc.IntType),
        np.repeat(columns, r, axis=0).ravel().astype(PETSc.IntType),
        values.ravel(),
        addv=PETSc.InsertMode.ADD_VALUES,
        rowmap=rows.ravel().astype(PETSc.IntType),
    )
