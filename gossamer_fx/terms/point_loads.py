"""Loads on points and directors of bodies: known on every rank, entered by the one that owns the first port."""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from gossamer_fx.algebra.numbering import Numbering
from gossamer_fx.algebra.places import Gather, attach, is_here
from gossamer_fx.model.terms import Array, Body, PointLoad


class PointLoads:
    """All `PointLoad` parts of a scene: force f(X̄) on attached vectors X = P q + o, work f·(X1 - X0)."""

    def __init__(self, numbering: Numbering, bodies: list[Body], parts: list[PointLoad], alpha: float) -> None:
        self._α, self._laws = alpha, [part.law for part in parts]
        attached = [attach(numbering, bodies, part.ports) for part in parts]
        self._indices = [indices for indices, _, _ in attached]
        self._maps = [(P, o) for _, P, o in attached]
        self._mine = [is_here(part.ports) for part in parts]
        self._X0 = [o for _, o in self._maps]
        self._gather = Gather(numbering, self._indices)

    def _vectors(self, q: PETSc.Vec) -> list[Array]:
        return [P @ values + o for (P, o), values in zip(self._maps, self._gather(q), strict=True)]

    def _middle(self, q1: PETSc.Vec) -> list[Array]:
        """The vectors at which forces act."""
        return [(1 - self._α) * X0 + self._α * X1 for X0, X1 in zip(self._X0, self._vectors(q1), strict=True)]

    def begin(self, t: float, h: float, q0: PETSc.Vec, v0: PETSc.Vec) -> None:
        """Start a step of length h at time t."""
        self._X0 = self._vectors(q0)
        rates = [P @ values for (P, _), values in zip(self._maps, self._gather(v0), strict=True)]
        for law, X, V in zip(self._laws, self._X0, rates, strict=True):
            law.begin(t, self._α * h, X, V)

    def add_forces(self, q1: PETSc.Vec, r: PETSc.Vec) -> None:
        """r -= Pᵀ f."""
        for k, X in enumerate(self._middle(q1)):
            if self._mine[k]:
                force = self._maps[k][0].T @ self._laws[k].force(X)
                r.setValues(self._indices[k], -force, addv=PETSc.InsertMode.ADD_VALUES)
        r.assemble()

    def add_tangents(self, q1: PETSc.Vec, A: PETSc.Mat) -> None:
        for k, X in enumerate(self._middle(q1)):
            if self._mine[k]:
                P = self._maps[k][0]
                K = -self._α * P.T @ self._laws[k].tangent(X) @ P
                A.setValues(self._indices[k], self._indices[k], K, addv=PETSc.InsertMode.ADD_VALUES)

    def work(self, q1: PETSc.Vec) -> float:
        """This rank's work over the step; before it is accepted."""
        total = 0.0
        ends = zip(self._X0, self._vectors(q1), self._middle(q1), strict=True)
        for k, (X0, X1, X) in enumerate(ends):
            if self._mine[k]:
                total += float(np.dot(self._laws[k].force(X), X1 - X0))
        return total
