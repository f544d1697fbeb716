"""The increment of a step, kept apart from the coordinates, so that their round-off does not enter
the inertia."""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from gossamer_fx.core.algebra.numbering import Numbering
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.terms.supports import Supports

# Units in the last place by which the coordinates of a scene at rest may be wrong: the round-off of
# many steps and the tolerance of Newton's iteration.  Films and plates at rest were measured to
# need 3 in 40 steps and 30 in 3000.
REST_UNITS = 300.0


class Increment:
    """The end of a step, q1 = q0 + p + w: p is predicted by the stepper, w is what the solver
    finds.

    The inertia c M (w + o) is not computed from a difference of coordinates: c M would enlarge
    their round-off by 1/h² and by the distance from the origin.  What q1 loses by rounding,
    `remainder` [m], a history variable of a run, is added to the next p, so that it does not
    accumulate.
    """

    def __init__(self, numbering: Numbering, supports: Supports) -> None:
        self._supports = supports
        self._comm = numbering.comm
        self.remainder = numbering.vector()
        self._p = numbering.vector()
        self._w = numbering.vector()
        self._scratch = numbering.vector()
        self._offset: PETSc.Vec | None = None
        self._masses: PETSc.Vec | None = None
        self.c = 0.0

    def set_inertia(self, c: float, offset: PETSc.Vec | None) -> None:
        """Choose c [1/s²] and o [m], None for zero, of the inertia c M (w + o)."""
        self.c = c
        self._offset = offset

    def predict(self, increment: PETSc.Vec, q0: PETSc.Vec, t: float) -> Array:
        """Choose p [m] of a step to the time t [s]: the given increment and what rounding took from
        the last coordinates.  Returns w [m] of this rank's fixed coordinates, which have their
        values of time t.  Collective."""
        self._p.waxpy(1.0, self.remainder, increment)
        self._scratch.waxpy(1.0, self._p, q0)
        self._supports.prescribe(self._scratch, t)
        fixed = self._supports.held
        return self._scratch.array_r[fixed] - q0.array_r[fixed] - self._p.array_r[fixed]

    def end(self, w: PETSc.Vec, q0: PETSc.Vec, q1: PETSc.Vec) -> None:
        """Take w, and set q1 = q0 + p + w."""
        w.copy(self._w)
        q1.waxpy(1.0, self.total(), q0)

    def total(self) -> PETSc.Vec:
        """p + w [m], in a vector that the next call of any method may overwrite."""
        self._scratch.waxpy(1.0, self._w, self._p)
        return self._scratch

    def add_inertia(self, M: PETSc.Mat, r: PETSc.Vec) -> None:
        """Set r = c M (w + o) [N]."""
        if self._offset is None:
            M.mult(self._w, r)
        else:
            self._scratch.waxpy(1.0, self._offset, self._w)
            M.mult(self._scratch, r)
        r.scale(self.c)

    def mass_changed(self) -> None:
        """Forget the masses of the last `cancelling_squares`."""
        self._masses = None

    def cancelling_squares(self, M: PETSc.Mat, diagonal: PETSc.Vec, q1: PETSc.Vec) -> Array:
        """Squares [N²] of the forces that cancel in each owned row of a residual, the scale of its
        round-off: diag(K) q1 and diag(c M)(w + o), from the diagonal of the tangent, diag(K) +
        diag(c M) [N/m].  Fixed coordinates have none: their forces are reactions."""
        inertia = self._diagonal_inertia(M)
        offset = 0.0 if self._offset is None else self._offset.array_r
        elastic = (diagonal.array_r - inertia) * q1.array_r
        inertial = inertia * (self._w.array_r + offset)
        squares: Array = elastic**2 + inertial**2
        squares[self._supports.held] = 0.0
        return squares

    def round_off_energy(self, M: PETSc.Mat, diagonal: PETSc.Vec, q1: PETSc.Vec) -> float:
        """Energy [J] that round-off gives to a scene at rest: ½ Σ K_ii (n ε q1_i)², n = REST_UNITS,
        from the diagonal of the tangent, diag(K) + diag(c M) [N/m].  The inertia does not count:
        the increment of a step does not take part in the round-off of the coordinates.  Collective.
        """
        stiffness = abs(diagonal.array_r - self._diagonal_inertia(M))
        # Fixed coordinates are set and not solved for: they have no round-off.
        stiffness[self._supports.held] = 0.0
        displacement = REST_UNITS * np.finfo(float).eps * q1.array_r
        return float(self._comm.allreduce(float(stiffness @ displacement**2) / 2))

    def _diagonal_inertia(self, M: PETSc.Mat) -> Array:
        """diag(c M) [N/m]."""
        if self._masses is None:
            self._masses = M.getDiagonal()
        return self.c * self._masses.array_r

    def commit(self, q0: PETSc.Vec, q1: PETSc.Vec) -> None:
        """Store what rounding took from q1 = q0 + (p + w), exactly, in `remainder` [m], by Knuth's
        sum of two numbers (The Art of Computer Programming, vol. 2, section 4.2.2, theorem B)."""
        start = q0.array_r
        end = q1.array_r
        increment = self._p.array_r + self._w.array_r
        taken = end - start
        with self.remainder as lost:
            lost[:] = (start - (end - taken)) + (increment - taken)
            lost[self._supports.held] = 0
