"""What outputs, probes and events see of a run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from mpi4py import MPI

from gossamer_fx.scene.scene import Scene
from gossamer_fx.steppers.history import History
from gossamer_fx.steppers.stepping import Stepper, Stepping, StepSolver
from gossamer_fx.system.system import System
from gossamer_fx.system.totals import Totals


class Run(Protocol):
    """A scene in time, as `Simulation` makes it; the same on every rank.

    Times in seconds: `until` is the end of the run, `seconds` and `output_seconds` were spent, `compile_seconds`
    before the first step.  `first` are the totals of the start.
    """

    comm: MPI.Intracomm
    scene: Scene
    system: System
    stepper: Stepper
    solver: StepSolver
    stepping: Stepping
    history: History
    first: Totals
    step: int
    iterations: int
    last_iterations: int
    substeps: int
    until: float
    seconds: float
    compile_seconds: float
    output_seconds: float

    @property
    def time(self) -> float:
        """[s]"""
        ...

    @property
    def totals(self) -> Totals:
        """Energies, momenta and masses now."""
        ...

    @property
    def energy_error(self) -> float:
        """Closing error of the ledger, over the largest energy so far."""
        ...

    @property
    def mass_error(self) -> float:
        """Closing error of the gas masses, over the largest mass."""
        ...

    @property
    def chambers(self) -> Mapping[str, Any]:
        """States of the gas chambers and tanks by name."""
        ...

    def chamber(self, name: str) -> Any:
        """State of the gas in one chamber, see `gas.state.ChamberState`."""
        ...

    def log(self, words: str) -> None:
        """Say something to those who listen to the log."""
        ...
