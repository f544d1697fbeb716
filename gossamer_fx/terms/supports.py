"""Coordinates that are held or moved, and the forces that it takes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from gossamer_fx.algebra.numbering import Numbering
from gossamer_fx.model.terms import Array, Body, Support, Term

Motion = Callable[[float], Array]


class Supports:
    """All `Support` parts of a scene; positions count in this rank's part of a vector.

    held (n,): positions that the equations do not govern;  reactions (n,): the forces [N] that hold them.
    """

    def __init__(self, numbering: Numbering, bodies: list[Body], parts: list[Term]) -> None:
        self._numbering = numbering
        found = [np.zeros(0, dtype=np.int64)]
        self._moved: list[tuple[npt.NDArray[np.int64], Motion]] = []
        for part in parts:
            if isinstance(part, Support):
                owned = numbering.owned(bodies.index(part.body))
                mine = part.dofs < owned.stop - owned.start
                at = part.dofs[mine].astype(np.int64) + owned.start
                found.append(at)
                if part.motion is not None:
                    self._moved.append((at, _restricted(part.motion, mine)))
        self.held: npt.NDArray[np.integer] = np.zeros(0, dtype=np.int64)
        self.hold(np.concatenate(found))

    def hold(self, positions: npt.NDArray[np.integer]) -> None:
        """Hold these positions, too; on all ranks together."""
        self.held = np.union1d(self.held, positions)
        self._any = self._numbering.comm.allreduce(len(self.held)) > 0
        self.reactions: Array = np.zeros(len(self.held))

    @property
    def at_rest(self) -> npt.NDArray[np.integer]:
        """Held positions that do not move."""
        moved = np.concatenate([np.zeros(0, dtype=np.int64), *[at for at, _ in self._moved]])
        return np.setdiff1d(self.held, moved)

    def prescribe(self, z: PETSc.Vec, t: float) -> None:
        """Give the moved coordinates of z their values at time t."""
        with z as values:
            for at, motion in self._moved:
                values[at] = motion(t)

    def take(self, r: PETSc.Vec) -> None:
        """Read the reactions off a residual, and take them out of it."""
        with r as values:
            self.reactions = values[self.held]
            values[self.held] = 0

    def work(self, Δq: Array) -> float:
        """What the moved supports supply in a step Δq."""
        return sum(float(Δq[at] @ self.reactions[np.searchsorted(self.held, at)]) for at, _ in self._moved)

    def clear(self, matrix: PETSc.Mat, diagonal: float) -> None:
        """Replace rows and columns of the held coordinates by `diagonal` times the identity."""
        if self._any:
            matrix.zeroRowsColumns((self.held + self._numbering.start).astype(PETSc.IntType), diag=diagonal)


def _restricted(motion: Motion, mine: npt.NDArray[np.bool_]) -> Motion:
    return lambda t: motion(t)[mine]
