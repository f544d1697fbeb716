"""The tape of a run: the states between its steps, from which each step can be made again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check, check_on_all
from gossamer_fx.model import roles
from gossamer_fx.model.body import Array
from gossamer_fx.steppers.midpoint import Midpoint
from gossamer_fx.system.system import System
from gossamer_fx.terms.discrete_gradient import PathAverage

# Memory [bytes] that a tape may take on a rank, unless the user says otherwise.
DEFAULT_MEMORY = 4e9


@runtime_checkable
class RunToRecord(Protocol):
    """A `run.Simulation`, as far as a tape reads it."""

    @property
    def system(self) -> System:
        """The compiled scene."""
        ...

    @property
    def stepper(self) -> Any:
        """The time stepper."""
        ...


@dataclass(frozen=True, eq=False)
class Node:
    """An accepted state of a run.

    Attributes:
        time: [s].
        h: length of the step that led to it [s]; zero for the first node.
        q: this rank's coordinates and multipliers (n,).
        v: this rank's velocities (n,).
        histories: what kinds with history variables saved, in their order.
        scalars: states of the scalar unknowns, in their order.
    """

    time: float
    h: float
    q: Array
    v: Array
    histories: list[Any]
    scalars: list[dict[str, Any]]


@check_arguments
class RunTape:
    """Records the steps of a run from now on, for `gx.analysis.gradient`.

    It keeps coordinates and velocities of every accepted step, 16 bytes for each unknown and step, and
    what history variables need.  Factors are not kept: the backward pass computes them again.  Steps
    that were undone, because of an event or a step control, leave the tape.

    Args:
        run: a `Simulation` with `Midpoint` steps.
        memory: what the tape may take on each rank [bytes].

    Attributes:
        nodes: the states, from the one at the start of the recording.

    Raises:
        InputError: another stepper or stress rule; during the run: the tape would take more memory.

    Example:
        >>> run = gx.Simulation(gx.Scene(mass), gx.Midpoint(dt=0.1))
        >>> tape = gx.analysis.RunTape(run)
        >>> run.run(until=1.0)
        >>> len(tape.nodes)
        11
    """

    def __init__(self, run: RunToRecord, *, memory: float = DEFAULT_MEMORY) -> None:
        """Check the arguments, which the class describes, and record every step from now on."""
        stepper = run.stepper
        check(
            isinstance(stepper, Midpoint) and isinstance(stepper.rule, PathAverage),
            f"RunTape: the run makes steps of {stepper!r}, which are not the same backwards; use Midpoint(dt=...).",
        )
        check(memory > 0, f"RunTape: memory is {memory!r} bytes; give a positive number.")
        self.system = run.system
        self.memory = memory
        self._keepers = roles.playing(roles.StepHistory, self.system.compiled)
        self.nodes: list[Node] = [self._present(0.0)]
        self.system.recorders.append(self._record)

    def close(self) -> None:
        """Record no more steps."""
        if self._record in self.system.recorders:
            self.system.recorders.remove(self._record)

    @property
    def bytes(self) -> int:
        """Memory [bytes] of the coordinates and velocities on this rank."""
        return sum(node.q.nbytes + node.v.nbytes for node in self.nodes)

    def restore(self, node: Node) -> None:
        """Make a recorded state that of the system.  Collective."""
        self.system.restore(node.q, node.v, node.time)
        for kind, saved in zip(self._keepers, node.histories, strict=True):
            kind.load_history(saved)
        for scalars, state in zip(self.system.scalar_unknowns, node.scalars, strict=True):
            scalars.set_state(state)

    def _present(self, h: float) -> Node:
        """The accepted state of the system, as a node."""
        system = self.system
        return Node(
            time=system.time,
            h=h,
            q=np.array(system.q0.array_r),
            v=np.array(system.v0.array_r),
            histories=[kind.save_history() for kind in self._keepers],
            scalars=[scalars.get_state() for scalars in system.scalar_unknowns],
        )

    def _record(self) -> None:
        """Add the step that was accepted; called by the system on all ranks."""
        system = self.system
        start = system.time - system.h
        # A step that starts before the last node replaces steps that were undone.
        while len(self.nodes) > 1 and self.nodes[-1].time > start + system.h / 2:
            self.nodes.pop()
        per_node = 2 * 8 * system.numbering.size_local
        check_on_all(
            system.comm,
            (len(self.nodes) + 1) * per_node <= self.memory,
            f"RunTape: step {len(self.nodes)} needs more than {self.memory:.3g} bytes on a rank; record less, or "
            "give the tape more memory.",
        )
        self.nodes.append(self._present(system.h))
