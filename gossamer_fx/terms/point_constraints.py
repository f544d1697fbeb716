"""Constraints between points, kept exactly by multipliers that are unknowns of the sparse matrix.

    e(q1) = 0,    force De(q̄)ᵀλ,    tangent [ α λ·D²e  De(q̄)ᵀ ]
                                            [ De(q1)     0    ]

A multiplier whose measure touches held coordinates only has nothing to do: it is held too.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from dolfinx.common import IndexMap
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.algebra.numbering import Numbering
from gossamer_fx.algebra.places import Gather, Places, add_blocks, own_places
from gossamer_fx.checks.errors import check
from gossamer_fx.model.terms import Array, Block, Body, PointConstraint

DISTANCE = 1e-8  # largest violation at the start, in units of the constraint; it stands for "coincides"
CHECK_UP_TO = 1500  # constraints; above, redundant ones are not looked for (the matrix is then singular)


def multiplier_block(comm: MPI.Intracomm, part: PointConstraint) -> Block:
    """One multiplier for each measure, on the rank that evaluates it."""
    return Block(IndexMap(comm, len(own_places(part.measure.places))), part.measure.H.shape[0])


class PointConstraints:
    """All `PointConstraint` parts of a scene; the multipliers of part k are block `first` + k of the numbering."""

    def __init__(self, numbering: Numbering, bodies: list[Body], parts: list[PointConstraint], alpha: float) -> None:
        self._comm, self._α, self._parts = numbering.comm, alpha, parts
        self._places = [Places(numbering, bodies, part.measure) for part in parts]
        self._q0: list[Array] = [np.zeros((at.n, at.D)) for at in self._places]
        self._rows = []
        self._owned = []
        for k, at in enumerate(self._places):
            block = len(bodies) + k
            start = numbering.blocks[block].index_map.local_range[0]
            self._rows.append(numbering.to_global(block, np.arange(start, start + at.n)))
            self._owned.append(numbering.owned(block))
        self._gather = Gather(numbering, [at.indices for at in self._places])
        self.owned = slice(numbering.owned(len(bodies)).start, numbering.size_local)

    def begin(self, q0: PETSc.Vec) -> None:
        """Take the accepted state as the start of a step."""
        self._q0 = self._gather(q0)

    def add_forces(self, q1: PETSc.Vec, r: PETSc.Vec) -> None:
        """r += De(q̄)ᵀλ, and e(q1) in the rows of the multipliers."""
        values = q1.array_r.copy()
        for k, (at, q) in enumerate(zip(self._places, self._gather(q1), strict=True)):
            force = np.einsum("nm,nmx->nx", self._multipliers(values, k), self._middle_gradient(k, q))
            r.setValues(at.indices.ravel(), force.ravel(), addv=PETSc.InsertMode.ADD_VALUES)
            r.setValues(self._rows[k].ravel(), at.strain(q).ravel(), addv=PETSc.InsertMode.ADD_VALUES)
        r.assemble()

    def add_tangents(self, q1: PETSc.Vec, A: PETSc.Mat) -> None:
        values = q1.array_r.copy()
        for k, (at, q) in enumerate(zip(self._places, self._gather(q1), strict=True)):
            λ, rows = self._multipliers(values, k), self._rows[k]
            add_blocks(A, at.indices, at.indices, self._α * np.einsum("nm,nmxy->nxy", λ, at.H))
            add_blocks(A, at.indices, rows, self._middle_gradient(k, q).transpose(0, 2, 1))
            add_blocks(A, rows, at.indices, at.gradient(q))
            add_blocks(A, rows, rows, np.zeros((at.n, at.m, at.m)))

    def add_curvature(self, v: PETSc.Vec, r: PETSc.Vec) -> None:
        """D²e[v, v] in the rows of the multipliers."""
        for rows, at, rates in zip(self._rows, self._places, self._gather(v), strict=True):
            curvature = np.einsum("nx,nmxy,ny->nm", rates, at.H, rates, optimize=True)
            r.setValues(rows.ravel(), curvature.ravel(), addv=PETSc.InsertMode.ADD_VALUES)
        r.assemble()

    def _multipliers(self, values: Array, k: int) -> Array:
        """λ (n, m)."""
        return values[self._owned[k]].reshape(self._places[k].n, self._places[k].m)

    def _middle_gradient(self, k: int, q: Array) -> Array:
        return self._places[k].gradient((1 - self._α) * self._q0[k] + self._α * q)

    def violation(self, q: PETSc.Vec) -> float:
        """Largest violation of a constraint in a state, in its own units; the same on every rank."""
        worst = [
            float(np.abs(at.strain(x)).max(initial=0.0)) for at, x in zip(self._places, self._gather(q), strict=True)
        ]
        return float(self._comm.allreduce(max(worst), op=MPI.MAX))

    # ---- before the first step ---------------------------------------------------------------------------------

    def idle(self, free: PETSc.Vec, q0: PETSc.Vec) -> npt.NDArray[np.int64]:
        """Positions in this rank's part of a vector of the multipliers that touch held coordinates only.

        `free` is 1 at coordinates that may move and 0 at held ones.
        """
        found: list[npt.NDArray[np.int64]] = [np.zeros(0, dtype=np.int64)]
        for k, (at, q, mask) in enumerate(zip(self._places, self._gather(q0), self._gather(free), strict=True)):
            nothing = (np.abs(at.gradient(q)) * mask[:, None, :]).max(axis=2, initial=0.0) < 1e-12
            found.append(np.flatnonzero(nothing.ravel()) + self._owned[k].start)
        return np.concatenate(found)

    def validate(self, q0: PETSc.Vec, v0: PETSc.Vec, free: PETSc.Vec) -> None:
        """See that the initial state keeps all constraints, and that none follows from the others.

        Raises:
            InputError: a constraint is violated or redundant, by name.
        """
        for part, at, q, v in zip(self._parts, self._places, self._gather(q0), self._gather(v0), strict=True):
            e, De = at.strain(q), at.gradient(q)
            rate = np.abs(np.einsum("nmx,nx->nm", De, v))
            speed = np.abs(De).max(initial=1.0) * np.abs(v).max(initial=0.0)
            worst = np.array([np.abs(e).max(initial=0.0), rate.max(initial=0.0), speed])
            self._comm.Allreduce(MPI.IN_PLACE, worst, op=MPI.MAX)
            off, rate, speed = worst
            check(
                off <= DISTANCE,
                f"'{part.name}' does not hold at the start: it is off by {off:.3g}; let the joined points coincide.",
            )
            check(
                rate <= 1e-8 * max(speed, 1.0),
                f"'{part.name}' does not hold in rate at the start: the joined points separate with {rate:.3g} per "
                "second; give both bodies the same velocity there.",
            )
        self._refuse_redundant(q0, free)

    def _refuse_redundant(self, q0: PETSc.Vec, free: PETSc.Vec) -> None:
        """Look for left null vectors of the gradient of all constraints, its rows gathered on rank 0."""
        n = self._comm.allreduce(sum(at.n * at.m for at in self._places))
        if n > CHECK_UP_TO:
            return
        mine: list[tuple[int, Array, Array]] = []
        for k, (at, q, mask) in enumerate(zip(self._places, self._gather(q0), self._gather(free), strict=True)):
            De = at.gradient(q) * mask[:, None, :]
            mine += [(k, at.indices[i], De[i, j]) for i in range(at.n) for j in range(at.m) if np.any(De[i, j])]
        message = ""
        gathered = self._comm.gather(mine)
        if gathered is not None:
            message = self._redundancy([row for rows in gathered for row in rows])
        message = self._comm.bcast(message)
        check(not message, message)

    def _redundancy(self, rows: list[tuple[int, Array, Array]]) -> str:
        """A sentence that names the constraints that depend on each other, or nothing."""
        if not rows:
            return ""
        columns = np.unique(np.concatenate([indices for _, indices, _ in rows]))
        G = np.zeros((len(rows), len(columns)))
        for i, (_, indices, values) in enumerate(rows):
            np.add.at(G[i], np.searchsorted(columns, indices), values)
        length = np.linalg.norm(G, axis=1)
        G /= np.where(length > 0, length, 1.0)[:, None]
        eigenvalues, vectors = np.linalg.eigh(G @ G.T)
        null = vectors[:, eigenvalues < 1e-12]
        if not null.size:
            return ""
        involved = {self._parts[rows[i][0]].name for i in np.flatnonzero(np.abs(null).max(axis=1) > 1e-6)}
        names = ", ".join(f"'{name}'" for name in sorted(involved))
        return (
            f"{null.shape[1]} of the constraints {names} follow from the others; free one of the joints, e.g. by a "
            "ball joint in the place of a revolute one."
        )
