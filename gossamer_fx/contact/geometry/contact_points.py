"""All points of a contact: those of bodies, one unknown vector each, and those of obstacles, which several may move."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc
from scipy.sparse import csr_matrix

from gossamer_fx.algebra.point_measures import Gather
from gossamer_fx.model.body import Array, Attached, Ground
from gossamer_fx.terms.assembly import Assembly

PrescribedMotion = Callable[[float], Sequence[float]]


@dataclass(frozen=True)
class ObstaclePoints:
    """Points or directions (k,) of an obstacle; points take part in its prescribed motion."""

    at: Sequence[Attached]
    moves: Sequence[bool]
    motion: PrescribedMotion | None


class ContactPoints:
    """Points x = P q + c(t) of n nodes of bodies, and after them those of obstacles, m in all.

    `unknowns` (v,) are the first of each vector's three unknowns, the nodes' first.  Point i is a combination of the
    vectors `vectors[i]` (w,) with `weights[i]` (w,); of nodes w is one.
    """

    def __init__(
        self,
        nodes: list[tuple[int, npt.NDArray[np.int64]]],
        supports: list[ObstaclePoints],
        system: Assembly,
    ) -> None:
        numbering, self._numbering = system.numbering, system.numbering
        self.comm = system.comm
        first = [numbering.to_global(k, at)[:, 0] for k, at in nodes]
        self.n = sum(map(len, first))
        unknowns: list[int] = []
        entries: list[tuple[int, int, float]] = []
        constants: list[Array] = []
        self._moved: list[tuple[npt.NDArray[np.int64], PrescribedMotion]] = []
        known: dict[int, int] = {}
        for support in supports:
            moved = []
            for port, moves in zip(support.at, support.moves, strict=True):
                i = self.n + len(constants)
                if isinstance(port, Ground):
                    constants.append(np.array(port.vector, dtype=float))
                    if moves and support.motion is not None:
                        moved.append(i)
                    continue
                constants.append(np.zeros(3))
                k = system.bodies.index(port.body)
                of_nodes: Any = numbering.to_global(k, np.array(port.nodes, dtype=np.int64))
                for row, weight, vector in zip(
                    of_nodes, port.weights, port.vectors or (0,) * len(port.nodes), strict=True
                ):
                    u = int(row[3 * vector])
                    if u not in known:
                        known[u] = self.n + len(unknowns)
                        unknowns.append(u)
                    entries.append((i, known[u], weight))
            if moved and support.motion is not None:
                self._moved.append((np.array(moved, dtype=np.int64), support.motion))
        self.unknowns = np.concatenate([*first, np.array(unknowns, dtype=np.int64)]).astype(
            np.int64
        )
        self.m = self.n + len(constants)
        self._constants = np.vstack([np.zeros((self.n, 3)), *constants])
        self.plain = not entries
        rows = np.array([*range(self.n), *(i for i, _, _ in entries)])
        columns = np.array([*range(self.n), *(j for _, j, _ in entries)])
        values = np.array([*np.ones(self.n), *(w for _, _, w in entries)])
        self.P = csr_matrix((values, (rows, columns)), shape=(self.m, len(self.unknowns)))
        self.moves = np.zeros(self.m, dtype=bool)  # whether the equations govern it
        self.moves[rows] = True
        self.prescribed = np.concatenate(
            [np.zeros(0, dtype=np.int64), *(points for points, _ in self._moved)]
        )
        self.width = int(np.diff(self.P.indptr).max(initial=1))
        self.components = self.unknowns[:, None] + np.arange(3)
        self._gather = Gather(numbering, [self.components])

    def owned(self, points: npt.NDArray[np.integer]) -> npt.NDArray[np.bool_]:
        """Whether this rank searches for what is near to a point: nodes where they live, others in turn."""
        numbering, comm = self._numbering, self._numbering.comm
        here = points % comm.size == comm.rank
        nodes = points < self.n
        first = self.unknowns[points[nodes]]
        here[nodes] = (first >= numbering.start) & (first < numbering.start + numbering.size_local)
        return here

    def at(self, q: PETSc.Vec, t: float) -> Array:
        """Points (m, 3) [m] of coordinates q at a time."""
        x = self._gather(q)[0]
        if not self.plain:
            x = np.asarray(self.P @ x)
        if self.m > self.n:
            x = (
                x if len(x) == self.m else np.vstack([x, np.zeros((self.m - len(x), 3))])
            ) + self._constants
            for points, motion in self._moved:
                x[points] += np.asarray(motion(t), dtype=float)
        return np.ascontiguousarray(x)

    def rates(self, v: PETSc.Vec, t: float, h: float) -> Array:
        """Their velocities (m, 3) [m/s]; of prescribed ones the mean of a step of h."""
        rates = np.zeros((self.m, 3))
        rates[:] = self.P @ self._gather(v)[0]
        for points, motion in self._moved:
            rates[points] = (
                np.asarray(motion(t + h), dtype=float) - np.asarray(motion(t), dtype=float)
            ) / h
        return rates

    def of_vectors(self, q: PETSc.Vec) -> Array:
        """What a vector of the system has at each of the vectors (v, 3), on all ranks."""
        return self._gather(q)[0]

    def add(self, force: Array, r: PETSc.Vec) -> None:
        """r += Pᵀ force of forces (m, 3) on points."""
        of_vectors = force[: self.n] if self.plain else np.asarray(self.P.T @ force)
        if self._numbering.comm.size == 1:
            with r as values:
                values[self.components.ravel()] += of_vectors.ravel()
            return
        touched = np.flatnonzero(of_vectors.any(axis=1))
        indices = self.components[touched].ravel().astype(PETSc.IntType)
        r.setValues(indices, of_vectors[touched].ravel(), addv=PETSc.InsertMode.ADD_VALUES)
        r.assemble()

    def expanded(self, nodes: npt.NDArray[np.int32]) -> tuple[npt.NDArray[np.int64], Array]:
        """Vectors (n, 4 w) behind the points of pairs (n, 4), and weights (n, 4, 4 w), zero where one has fewer."""
        n, w = len(nodes), self.width
        vectors, weights = np.zeros((n, 4, w), dtype=np.int64), np.zeros((n, 4, 4, w))
        starts, counts = self.P.indptr[nodes], np.diff(self.P.indptr)[nodes]
        for j in range(w):
            there = counts > j
            at = np.where(there, starts + j, 0)
            vectors[:, :, j] = np.where(
                there, self.P.indices[at], nodes[:, :1]
            )  # an unused one repeats the first
            for p in range(4):
                weights[:, p, p, j] = np.where(there[:, p], self.P.data[at[:, p]], 0.0)
        first = np.where(nodes[:, 0] < self.n, nodes[:, 0], nodes.min(axis=1))
        filled = np.where(weights.any(axis=1), vectors, first[:, None, None])
        return filled.reshape(n, 4 * w), weights.reshape(n, 4, 4 * w)
