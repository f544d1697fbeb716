"""Energies between points of bodies: evaluated where the first port lives, entered in global numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc

from gossamer_fx.numbering import GlobalIndices, Numbering
from gossamer_fx.parts import Array, Body, PointStored


@dataclass
class _Local:
    """A point part on its rank: unknowns (n,), the map P (3k, n) from them to the stacked ports, and its strain."""

    part: PointStored
    indices: GlobalIndices
    P: Array
    X0: Array
    e0: float = 0.0
    S: float = 0.0

    def strain(self, X: Array) -> float:
        return float(X @ (self.part.H @ X) / 2 + self.part.L @ X + self.part.c)


class PointForces:
    """All `PointStored` parts of a scene, by the rule of `discrete_gradient`: S̄ (e1 - e0) = ψ(e1) - ψ(e0)."""

    def __init__(self, numbering: Numbering, bodies: list[Body], parts: list[PointStored], alpha: float) -> None:
        self._α, self._names = alpha, [part.name for part in parts]
        start, end = numbering.vector().getOwnershipRange()
        self._mine: list[_Local] = []
        for part in parts:
            indices = [
                numbering.to_global(bodies.index(p.body), np.array(p.nodes, dtype=np.int64))[:, :3] for p in part.ports
            ]
            if start <= indices[0][0, 0] < end:
                flat = np.concatenate([i.ravel() for i in indices])
                P = np.zeros((3 * len(part.ports), len(flat)))
                column = 0
                for k, port in enumerate(part.ports):
                    for weight in port.weights:
                        P[3 * k : 3 * k + 3, column : column + 3] = weight * np.eye(3)
                        column += 3
                self._mine.append(_Local(part, flat, P, np.zeros(len(P))))
        needed = np.concatenate([np.zeros(0, dtype=PETSc.IntType), *[m.indices for m in self._mine]])
        self._where = np.cumsum([0] + [len(m.indices) for m in self._mine])
        self._values = PETSc.Vec().createSeq(len(needed))
        source = PETSc.IS().createGeneral(needed.astype(PETSc.IntType))
        self._scatter = PETSc.Scatter().create(numbering.vector(), source, self._values, None)

    def _ports(self, q: PETSc.Vec) -> list[Array]:
        self._scatter.scatter(q, self._values)
        values = self._values.array_r
        return [
            m.P @ values[a:b] for m, a, b in zip(self._mine, self._where[:-1], self._where[1:], strict=True)
        ]

    def begin(self, q0: PETSc.Vec) -> None:
        for m, X in zip(self._mine, self._ports(q0), strict=True):
            m.X0, m.e0 = X, m.strain(X)

    def add_forces(self, q1: PETSc.Vec, r: PETSc.Vec) -> None:
        for m, X1 in zip(self._mine, self._ports(q1), strict=True):
            S, _ = self._stress(m, X1)
            r.setValues(m.indices, m.P.T @ (S * self._variation(m, X1)), addv=PETSc.InsertMode.ADD_VALUES)
        r.assemble()

    def add_tangents(self, q1: PETSc.Vec, A: PETSc.Mat) -> None:
        for m, X1 in zip(self._mine, self._ports(q1), strict=True):
            S, D = self._stress(m, X1)
            K = D * np.outer(self._variation(m, X1), m.part.H @ X1 + m.part.L) + self._α * S * m.part.H
            A.setValues(m.indices, m.indices, m.P.T @ K @ m.P, addv=PETSc.InsertMode.ADD_VALUES)

    def _variation(self, m: _Local, X1: Array) -> Array:
        """De at the configuration in which forces act."""
        return m.part.H @ ((1 - self._α) * m.X0 + self._α * X1) + m.part.L

    def _stress(self, m: _Local, X1: Array) -> tuple[float, float]:
        """Averaged stress and its derivative with respect to the end strain."""
        e1 = m.strain(X1)
        if self._α < 1:
            return m.part.density.average(m.e0, e1)
        S, half = m.part.density.average(e1, e1)
        return S, 2 * half

    def energies(self) -> dict[str, float]:
        """This rank's energies at the last accepted state, by part."""
        result = dict.fromkeys(self._names, 0.0)
        for m in self._mine:
            result[m.part.name] += m.part.density.energy(m.e0)
        return result
