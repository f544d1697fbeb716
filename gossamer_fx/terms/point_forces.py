"""Energies and dissipation between points of bodies: evaluated where the first port lives, in global numbers.

The rule is that of `discrete_gradient`: force S̄·De(q̄) with S̄·(e1 - e0) = ψ(e1) - ψ(e0), or the loss of the step.
With α = 1 the forces are those of the end of the step, S̄ = ψ'(e1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc

from gossamer_fx.algebra.numbering import Numbering
from gossamer_fx.algebra.places import Gather, Places, add_blocks
from gossamer_fx.model.terms import Array, Body, PointDissipation, PointStoredEnergy


@dataclass
class _Local:
    """A point part on its rank: its places, their unknowns and strains at the start of the step."""

    part: PointStoredEnergy | PointDissipation
    at: Places
    q0: Array
    e0: Array


class PointForces:
    """All `PointStoredEnergy` and `PointDissipation` parts of a scene."""

    def __init__(
        self, numbering: Numbering, bodies: list[Body], parts: list[PointStoredEnergy | PointDissipation], alpha: float
    ) -> None:
        self._α, self.h = alpha, 1.0
        self._names = [part.name for part in parts if isinstance(part, PointStoredEnergy)]
        places = [Places(numbering, bodies, part.measure) for part in parts]
        self._mine = [
            _Local(part, at, np.zeros((at.n, at.D)), np.zeros((at.n, at.m)))
            for part, at in zip(parts, places, strict=True)
        ]
        self._gather = Gather(numbering, [at.indices for at in places])

    def begin(self, q0: PETSc.Vec) -> None:
        """Take the accepted state as the start of a step."""
        for local, q in zip(self._mine, self._gather(q0), strict=True):
            local.q0, local.e0 = q, local.at.strain(q)

    def add_forces(self, q1: PETSc.Vec, r: PETSc.Vec) -> None:
        """r += S̄·De(q̄)."""
        for local, q in zip(self._mine, self._gather(q1), strict=True):
            S, _ = self._stress(local, q)
            force = np.einsum("nm,nmx->nx", S, local.at.gradient(self._middle(local, q)))
            r.setValues(local.at.indices.ravel(), force.ravel(), addv=PETSc.InsertMode.ADD_VALUES)
        r.assemble()

    def add_tangents(self, q1: PETSc.Vec, A: PETSc.Mat) -> None:
        """A += De(q̄)ᵀ dS̄/de1 De(q1) + α S̄·D²e."""
        for local, q in zip(self._mine, self._gather(q1), strict=True):
            S, D = self._stress(local, q)
            B, B1 = local.at.gradient(self._middle(local, q)), local.at.gradient(q)
            K = np.einsum("nix,nij,njy->nxy", B, D, B1, optimize=True)
            K += self._α * np.einsum("nm,nmxy->nxy", S, local.at.H)
            add_blocks(A, local.at.indices, local.at.indices, K)

    def _middle(self, local: _Local, q: Array) -> Array:
        """The configuration in which forces act."""
        return (1 - self._α) * local.q0 + self._α * q

    def _stress(self, local: _Local, q: Array) -> tuple[Array, Array]:
        """Stress of the step and its derivative with respect to the end strain."""
        e1 = local.at.strain(q)
        if isinstance(local.part, PointDissipation):
            return local.part.density.average(local.e0, e1, self.h)
        if self._α == 0.5:
            return local.part.density.average(local.e0, e1)
        S, half = local.part.density.average(e1, e1)
        return S, 2 * half

    def energies(self) -> dict[str, float]:
        """This rank's energies at the last accepted state, by part."""
        result = dict.fromkeys(self._names, 0.0)
        for local in self._mine:
            if isinstance(local.part, PointStoredEnergy):
                result[local.part.name] += float(local.part.density.energy(local.e0).sum())
        return result

    def dissipated(self, q1: PETSc.Vec) -> float:
        """This rank's loss in the step; before it is accepted."""
        loss = 0.0
        for local, q in zip(self._mine, self._gather(q1), strict=True):
            if isinstance(local.part, PointDissipation):
                loss += float(np.sum(self._stress(local, q)[0] * (local.at.strain(q) - local.e0)))
        return loss
