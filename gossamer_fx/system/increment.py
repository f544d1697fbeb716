"""The increment of a step, kept apart from the coordinates so that their round-off does not enter the inertia."""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from gossamer_fx.algebra.numbering import Numbering
from gossamer_fx.model.terms import Array
from gossamer_fx.terms.supports import Supports


class Increment:
    """q1 = q0 + p + w: p is predicted by the stepper, w is what is solved for.

    The inertia c M (w + o) is no difference of coordinates: c M would enlarge their round-off by 1/h² and by the
    distance from the origin.  What q1 loses by rounding, `remainder`, is added to the next p, lest it accumulate.
    """

    def __init__(self, numbering: Numbering, supports: Supports) -> None:
        self._supports, self._comm = supports, numbering.comm
        self.remainder, self._p, self._w, self._scratch = (numbering.vector() for _ in range(4))
        self._offset: PETSc.Vec | None = None
        self._masses: PETSc.Vec | None = None
        self._c = 0.0

    def inertia(self, c: float, offset: PETSc.Vec | None) -> None:
        """Choose c and o (none: zero)."""
        self._c, self._offset = c, offset

    def predict(self, increment: PETSc.Vec, q0: PETSc.Vec, t: float) -> Array:
        """Choose p; returns the w of the held coordinates, which have their values of time t."""
        self._p.waxpy(1.0, self.remainder, increment)
        self._scratch.waxpy(1.0, self._p, q0)
        self._supports.prescribe(self._scratch, t)
        held = self._supports.held
        w: Array = self._scratch.array_r[held] - q0.array_r[held] - self._p.array_r[held]
        return w

    def end(self, w: PETSc.Vec, q0: PETSc.Vec, q1: PETSc.Vec) -> None:
        """Set w, and q1 = q0 + p + w."""
        w.copy(self._w)
        self._scratch.waxpy(1.0, w, self._p)
        q1.waxpy(1.0, self._scratch, q0)

    def add_inertia(self, M: PETSc.Mat, r: PETSc.Vec) -> None:
        """r = c M (w + o)."""
        if self._offset is None:
            M.mult(self._w, r)
        else:
            self._scratch.waxpy(1.0, self._offset, self._w)
            M.mult(self._scratch, r)
        r.scale(self._c)

    def size(self, M: PETSc.Mat, diagonal: PETSc.Vec, q1: PETSc.Vec) -> float:
        """Norm [N] of diag(K) q1 and diag(c M)(w + o), of which a residual is made; diag(K) + diag(c M) is given."""
        if self._masses is None:
            self._masses = M.getDiagonal()
        cM = self._c * self._masses.array_r
        offset = 0.0 if self._offset is None else self._offset.array_r
        stiff, inert = (diagonal.array_r - cM) * q1.array_r, cM * (self._w.array_r + offset)
        return float(np.sqrt(self._comm.allreduce(float(stiff @ stiff + inert @ inert))))

    def accept(self, q0: PETSc.Vec, q1: PETSc.Vec) -> None:
        """Note what rounding took from q1 = q0 + (p + w), exactly (Knuth's sum of two numbers)."""
        start, end, increment = q0.array_r, q1.array_r, self._p.array_r + self._w.array_r
        taken = end - start
        with self.remainder as lost:
            lost[:] = (start - (end - taken)) + (increment - taken)
            lost[self._supports.held] = 0
