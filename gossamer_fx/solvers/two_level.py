"""The preconditioner of large meshes: a coarse space, then an incomplete factorisation of what it leaves.

    z = z0 + L⁻¹ (r - A z0),   z0 = P (PᵀAP)⁻¹ Pᵀ r,   L ≈ A

What the coarse space does not see is local: an incomplete factorisation does.  Its levels of fill decide: if a film
switches between taut and slack, the tangent has narrow stiff bands in an almost slack film.  With two levels most
systems of a fluttering film of 78 thousand unknowns are not solved in 60 iterations; four levels take 25, six 6, and
eight cost more than they save.  Of a quiet film the two serve as well, for a third of the time; so it begins with them.

Several ranks factorise what overlaps by two cells, or iterations double.  Options have the prefix `gx_local_`.
"""

from __future__ import annotations

from petsc4py import PETSc

from gossamer_fx.algebra.numbering import PREFIX
from gossamer_fx.solvers.coarse_space import CoarseSpace
from gossamer_fx.system.system import System

FEW, MANY = 2, 6  # levels of fill
ENOUGH = 10  # applications in a solve up to which PᵀAP of an earlier A of the step does
LONG = 20  # applications in a solve from which on many levels cost less


class TwoLevel:
    """PETSc's Python preconditioner; see the module."""

    def __init__(self, system: System) -> None:
        self._system = system
        self._coarse = CoarseSpace(system)
        self._local = PETSc.PC().create(system.comm)
        self._local.setOptionsPrefix(PREFIX + "local_")
        self._local.setType("ilu" if system.comm.size == 1 else "asm")
        self._local.setASMOverlap(2)
        self._local.setFromOptions()
        self._step: tuple[float, float] | None = None
        self._levels = 0
        self._applications = 0  # since the last set-up

    def __str__(self) -> str:
        return f"a coarse space and {self._local.getType()} of {self._levels} levels"

    def setUp(self, pc: PETSc.PC) -> None:
        self._A = A = pc.getOperators()[0]
        step = self._system.time, self._system.h
        if step != self._step or self._applications > ENOUGH:
            self._coarse.set_up(self._system.A)  # whose pattern stays
        self._local.setOperators(A)
        if not self._levels:
            self._fill(FEW)
            self._r, self._z = A.createVecs()
        elif self._applications > LONG and self._levels < MANY:
            self._fill(MANY)
        self._local.setUp()
        self._local.setUpOnBlocks()
        self._step, self._applications = step, 0
        reason = PETSc.PC.FailedReason
        failed = self._system.comm.allreduce(self._local.getFailedReason() != reason.NOERROR)
        pc.setFailedReason(reason.SUBPC_ERROR if failed else reason.NOERROR)

    def apply(self, pc: PETSc.PC, r: PETSc.Vec, z: PETSc.Vec) -> None:
        self._applications += 1
        self._coarse.solve(r, z)
        self._A.mult(z, self._r)
        self._r.aypx(-1.0, r)
        self._local.apply(self._r, self._z)
        z.axpy(1.0, self._z)

    def recover(self) -> None:
        """Forget that an earlier matrix, which may have been infinite, could not be factorised."""
        self._local.reset()
        self._local.setFailedReason(PETSc.PC.FailedReason.NOERROR)
        self._step = None

    def _fill(self, levels: int) -> None:
        """Choose the levels of fill."""
        self._levels = levels
        parts = [self._local]
        if self._local.getType() == "asm":
            self._local.setUp()
            parts = [ksp.getPC() for ksp in self._local.getASMSubKSP()]
        for part in parts:
            part.setType("ilu")
            part.setFactorOrdering("rcm")
            part.setFactorLevels(levels)
            part.setFromOptions()
