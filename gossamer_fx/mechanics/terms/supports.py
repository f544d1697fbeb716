"""Coordinates that are held or moved, and the forces that it takes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from gossamer_fx.core.checks.errors import check_on_all
from gossamer_fx.core.model.body import Array, Body, Indices
from gossamer_fx.mechanics.terms.assembly import Assembly, CompiledTerms, Compiler

Motion = Callable[[float], Array]


class Supports(CompiledTerms["Support"]):
    """All `Support` terms of a scene: sorted indices `held` (n,) of the fixed coordinates in this
    rank's part of a vector, and `reactions` (n,) [N] on them."""

    def __init__(self, terms: Sequence[Support], system: Assembly) -> None:
        """Collect the coordinates that are fixed or prescribed on this rank, by terms in the same
        order on all ranks.  Collective."""
        # For each support `at` has the indices of its coordinates in this rank's part of a vector.
        self._numbering = system.numbering
        found = [np.zeros(0, dtype=np.int64)]
        self._moved: list[tuple[npt.NDArray[np.int64], Motion]] = []
        for term in terms:
            owned = system.block(term.body).owned
            # A ghost coordinate is fixed by its owner.
            mine = term.dofs < owned.stop - owned.start
            at = term.dofs[mine].astype(np.int64) + owned.start
            found.append(at)
            if term.motion is not None:
                self._moved.append((at, _restricted(term.motion, mine)))
        self._refuse_contradictions(terms, system)
        self.held: npt.NDArray[np.integer] = np.zeros(0, dtype=np.int64)
        self.hold(np.concatenate(found))

    def _refuse_contradictions(self, terms: Sequence[Support], system: Assembly) -> None:
        """Raise `InputError` on all ranks if two supports have different values for one coordinate.
        Collective."""
        # Two that fix a coordinate at its initial value agree; one that moves it agrees with none.
        moved = [term for term in terms if term.motion is not None]
        for mover in moved:
            for other in terms:
                if other.body is mover.body and other is not mover:
                    both = len(np.intersect1d(mover.dofs, other.dofs))
                    check_on_all(
                        system.comm,
                        both == 0,
                        f"'{mover.name}' moves coordinates that '{other.name}' holds or moves, "
                        "too; "
                        "let each node be held by one of them, or give them other components.",
                    )

    def hold(self, positions: npt.NDArray[np.integer]) -> None:
        """Hold these positions, too; on all ranks together."""
        self.held = np.union1d(self.held, positions)
        # Asked once, as `clear` is called in each iteration.
        self._any = self._numbering.comm.allreduce(len(self.held)) > 0
        self.reactions: Array = np.zeros(len(self.held))

    @property
    def at_rest(self) -> npt.NDArray[np.integer]:
        """Held positions that do not move."""
        moved = np.concatenate([np.zeros(0, dtype=np.int64), *[at for at, _ in self._moved]])
        return np.setdiff1d(self.held, moved)

    def prescribe(self, z: PETSc.Vec, t: float) -> None:
        """Set the moved coordinates of z to their values at a time t [s]."""
        with z as values:
            for at, motion in self._moved:
                values[at] = motion(t)

    def take(self, r: PETSc.Vec) -> None:
        """Save the reactions from the residual r, and set its rows to zero."""
        with r as values:
            self.reactions = values[self.held]
            values[self.held] = 0

    def work(self, Δq: Array) -> float:
        """Work [J] that the moved supports supply in a step Δq, this rank's share."""
        work = 0.0
        for at, _ in self._moved:
            # `held` is sorted, so this finds the reactions of the moved coordinates.
            reactions = self.reactions[np.searchsorted(self.held, at)]
            work += float(Δq[at] @ reactions)
        return work

    def clear(self, matrix: PETSc.Mat, diagonal: float) -> None:
        """Replace rows and columns of the held coordinates by `diagonal` times the identity."""
        # Skipped where no rank has a fixed coordinate, as the call is collective and takes time.
        if self._any:
            rows = (self.held + self._numbering.start).astype(PETSc.IntType)
            matrix.zeroRowsColumns(rows, diag=diagonal)


def _restricted(motion: Motion, mine: npt.NDArray[np.bool_]) -> Motion:
    """The motion of those coordinates for which `mine` is true."""
    return lambda t: motion(t)[mine]


@dataclass(frozen=True, eq=False)
class Support:
    """Coordinates that are fixed at their initial values, or have the values `motion(t)` [m], (n,)
    like `dofs`.

    `dofs` are owned and ghost scalar indices of the body's block.
    """

    name: str
    body: Body
    dofs: Indices
    motion: Callable[[float], Array] | None = None
    compiler: ClassVar[Compiler] = Supports
