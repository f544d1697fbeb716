"""Coordinates that supports hold or move, and the reactions of the supports."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.core.checks.errors import Inadmissible, check_on_all
from gossamer_fx.core.model.body import Array, Body, Indices
from gossamer_fx.mechanics.terms.assembly import Assembly, CompiledTerms, Compiler

# Coordinates (n,) of a support at a time [s].
Motion = Callable[[float], Array]

# Difference of two supports at a coordinate that both prescribe, over the largest coordinate that
# is held, up to which they agree: round-off of the functions of the user.
AGREEMENT = 1e-9

# Part of the first step in which a motion shows the rate at which it begins; the accelerated motion
# of a smooth start reaches the same part of its mean speed in it.
START = 1e-3

# Difference of this rate from the velocity of the body, over the mean speed of the first step, up
# to which it is smooth.
SMOOTH = 0.1

# Round-off of the functions of the user over their largest value.
ROUND_OFF = 1e-12

# In place of the number of a support, where there is none.
NOBODY = -1


@dataclass(frozen=True, eq=False)
class MovedCoordinates:
    """Coordinates that a support moves, by their indices `at` (n,) in this rank's part of a vector.

    It sets those of the mask `sets` (n,).  The others are set by the supports `setters`, given by
    their names for all n, with which it has to agree.
    """

    name: str
    motion: Motion
    at: npt.NDArray[np.int64]
    sets: npt.NDArray[np.bool_]
    setters: Sequence[str]

    def disagreement(self, difference: Array, size: float, t: float) -> str:
        """A sentence on the largest difference (n,) from what others have set, empty if it is
        small against the size of the coordinates."""
        if difference.max(initial=0.0) <= AGREEMENT * size:
            return ""
        worst = int(difference.argmax())
        return (
            f"'{self.setters[worst]}' and '{self.name}' prescribe coordinates of the same node, "
            f"which differ by {difference[worst]:.3g} at t = {t:.6g} s; "
            "let both agree there, or give them other components."
        )


class Supports(CompiledTerms["Support"]):
    """All `Support` terms of a scene: sorted indices `held` (n,) of the fixed coordinates in this
    rank's part of a vector, and `reactions` (n,) [N] on them."""

    def __init__(self, terms: Sequence[Support], system: Assembly) -> None:
        """Collect the coordinates that are fixed or prescribed on this rank, by terms in the same
        order on all ranks.  Collective."""
        self._numbering = system.numbering
        self._moved: list[MovedCoordinates] = []
        self._angles: dict[str, Callable[[float], float]] = {}
        # Pseudo-steps of an equilibrium are not a motion.
        if not system.rule.is_static:
            self._angles = {term.name: term.angle for term in terms if term.angle is not None}
        # Each coordinate is set by one support, so that its work counts once.  What is fixed at its
        # initial value comes first: others agree with it, and do not move it by their round-off.
        in_order = sorted(terms, key=lambda term: term.motion is not None)
        setter = np.full(system.numbering.size_local, NOBODY)
        for number, term in enumerate(in_order):
            owned = system.block(term.body).owned
            # A ghost coordinate is fixed by its owner.
            mine = term.dofs < owned.stop - owned.start
            at = term.dofs[mine].astype(np.int64) + owned.start
            sets = setter[at] == NOBODY
            setter[at[sets]] = number
            if term.motion is not None:
                moved = MovedCoordinates(
                    name=term.name,
                    motion=_restricted(term.motion, mine),
                    at=at,
                    sets=sets,
                    setters=[in_order[k].name for k in setter[at]],
                )
                self._moved.append(moved)
        shared = sum(int((~moved.sets).sum()) for moved in self._moved)
        self._shares = system.numbering.comm.allreduce(shared) > 0
        self.held: npt.NDArray[np.integer] = np.zeros(0, dtype=np.int64)
        self.forces: PETSc.Vec | None = None
        self.hold(np.flatnonzero(setter != NOBODY))

    def hold(self, positions: npt.NDArray[np.integer]) -> None:
        """Hold further coordinates, given by positions (n,) in this rank's part of a vector, and
        set all reactions to zero.  Collective."""
        self.held = np.union1d(self.held, positions)
        # Asked and converted once, as `clear` is called in each iteration.
        self._held_rows = (self.held + self._numbering.start).astype(PETSc.IntType)
        self._any = self._numbering.comm.allreduce(len(self.held)) > 0
        if self._any and self.forces is None:
            self.forces = self._numbering.vector()

    @property
    def reactions(self) -> Array:
        """Forces (n,) [N] on the coordinates `held` in the last residual."""
        if self.forces is None:
            return np.zeros(0)
        found: Array = self.forces.array_r[self.held]
        return found

    @property
    def at_rest(self) -> npt.NDArray[np.integer]:
        """Those of `held` whose coordinates do not move."""
        moved = [moved.at[moved.sets] for moved in self._moved]
        return np.setdiff1d(self.held, np.concatenate([np.zeros(0, dtype=np.int64), *moved]))

    def prescribe(self, z: PETSc.Vec, t: float) -> None:
        """Set the moved coordinates of z to their values at a time t [s].  `InputError` on all
        ranks if two supports disagree about one.  Collective."""
        differences = []
        with z as values:
            for moved in self._moved:
                wanted = moved.motion(t)
                values[moved.at[moved.sets]] = wanted[moved.sets]
                differences.append(np.abs(values[moved.at] - wanted))
            size = float(np.abs(values[self.held]).max(initial=0.0))
        # Supports of most scenes share no coordinate, and exchange no message.
        if not self._shares:
            return
        size = self._numbering.comm.allreduce(size, op=MPI.MAX)
        for moved, difference in zip(self._moved, differences, strict=True):
            problem = moved.disagreement(difference, size, t)
            check_on_all(self._numbering.comm, not problem, problem)

    def check_agreement(self, q: PETSc.Vec, t: float) -> None:
        """Raise `InputError` on all ranks if supports disagree at a time t [s], in the state q.
        Collective."""
        if self._shares:
            self.prescribe(q.copy(), t)

    def sudden(self, q0: PETSc.Vec, v0: PETSc.Vec, t: float, h: float) -> dict[str, float]:
        """Supports, by name, whose motion begins at a time t [s] elsewhere than its coordinates in
        q0, with the largest jump of one [m, of directors 1], or, with a jump of zero, at another
        rate than theirs in the velocities v0; h [s] is the length of the first step.  Collective.
        """
        found = {}
        for moved in self._moved:
            first = moved.motion(t)
            change = moved.motion(t + START * h) - first
            way = moved.motion(t + h) - first
            unlike = change - START * h * v0.array_r[moved.at]
            jump = first - q0.array_r[moved.at]
            largest = np.zeros(4)
            for k, values in enumerate((unlike, way, first, jump)):
                largest[k] = np.abs(values).max(initial=0.0)
            self._numbering.comm.Allreduce(MPI.IN_PLACE, largest, op=MPI.MAX)
            gap, distance, size, offset = largest.tolist()
            if offset > max(SMOOTH * distance, AGREEMENT * size):
                found[moved.name] = offset
            elif gap > max(SMOOTH * START * distance, ROUND_OFF * size):
                found[moved.name] = 0.0
        return found

    def take(self, r: PETSc.Vec) -> None:
        """Take the reactions [N] from the rows of the residual r at held coordinates, and set these
        rows to zero."""
        if self.forces is None:
            return
        values = r.array
        self.forces.array[self.held] = values[self.held]
        values[self.held] = 0

    def check_turns(self, t: float, h: float) -> None:
        """Refuse a step of h [s] from a time t [s] in which a support turns its body by half a turn
        or more: coordinates show only the shorter way round.  Collective.

        Raises:
            Inadmissible: names the support; the step is then tried in parts.
        """
        for name, angle in self._angles.items():
            turn = angle(t + h) - angle(t)
            if abs(turn) >= math.pi:
                raise Inadmissible(
                    f"'{name}' turns by {turn:.3g} rad within {h:.3g} s, half a turn or more, so "
                    "that its sense would be lost; give a shorter dt, or an angle without jumps"
                )

    def work(self, Δq: Array) -> float:
        """Work [J] that the moved supports supply in a step Δq, this rank's share."""
        work = 0.0
        for moved in self._moved:
            at = moved.at[moved.sets]
            assert self.forces is not None
            reactions = self.forces.array_r[at]
            work += float(Δq[at] @ reactions)
        return work

    def clear(self, matrix: PETSc.Mat, diagonal: float) -> None:
        """Replace rows and columns of the held coordinates by `diagonal` times the identity.
        Collective."""
        # Skipped where no rank has a fixed coordinate, as the call is collective and takes time.
        if self._any:
            matrix.zeroRowsColumns(self._held_rows, diag=diagonal)


def _restricted(motion: Motion, mine: npt.NDArray[np.bool_]) -> Motion:
    """The motion of those coordinates for which `mine` is true."""
    return lambda t: motion(t)[mine]


@dataclass(frozen=True, eq=False)
class Support:
    """Coordinates that are fixed at their initial values, or have the values `motion(t)` [m], (n,)
    like `dofs`.

    `dofs` are owned and ghost scalar indices of the body's block.  A motion that turns the body
    about an axis has its `angle` [rad] as a function of time, the same on every rank.
    """

    name: str
    body: Body
    dofs: Indices
    motion: Callable[[float], Array] | None = None
    angle: Callable[[float], float] | None = None
    compiler: ClassVar[Compiler] = Supports
