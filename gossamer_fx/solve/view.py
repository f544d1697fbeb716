"""The protocol of a run: what outputs, probes and events may read of a scene in time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from mpi4py import MPI

from gossamer_fx.solve.scene.scene import Scene
from gossamer_fx.solve.steppers.history import History
from gossamer_fx.solve.steppers.stepping import Stepper, Stepping, StepSolver
from gossamer_fx.solve.system.system import System
from gossamer_fx.solve.system.totals import Totals


# `Simulation` is the implementation.  Probes import the protocol only, so that they do not depend
# on the code that runs them.
class Run(Protocol):
    """A scene in time, after its last accepted step.  All members are the same on every rank.

    Attributes:
        comm: communicator of the scene.
        scene: what was given.
        system: the compiled scene, with its state.
        stepper: the time stepping rule that was given.
        solver: the rule at work on the system.
        stepping: the choice of step lengths.
        history: what earlier steps left for the next, e.g. for extrapolation.
        first: totals at the start.
        step: number of steps that were made.
        iterations: Newton iterations of all steps.
        last_iterations: Newton iterations of the last step.
        substeps: sub-steps of rejected steps.
        until: time at which the run ends [s].
        seconds: wall-clock time of the run so far [s].
        compile_seconds: wall-clock time before the first step [s].
        output_seconds: wall-clock time in outputs [s].
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
        """Time of the state [s]."""
        ...

    @property
    def totals(self) -> Totals:
        """Energies [J], momenta and masses [kg] of the state."""
        ...

    @property
    def at_rest(self) -> bool:
        """Whether no energy so far was larger than what round-off gives to a scene at rest."""
        ...

    @property
    def energy_error(self) -> float:
        """Closing error of the energy balance, as a share of the largest energy so far; zero at
        rest."""
        ...

    @property
    def energy_defect(self) -> float:
        """Closing error of the energy balance [J]."""
        ...

    @property
    def largest_energy(self) -> float:
        """Largest energy so far [J], to which `energy_error` refers."""
        ...

    @property
    def mass_error(self) -> float:
        """Closing error of the gas masses, as a share of the largest mass."""
        ...

    @property
    def chambers(self) -> Mapping[str, Any]:
        """State of the gas in each chamber and tank by name, see `gas.contract.ChamberState`."""
        ...

    def chamber(self, name: str) -> Any:
        """State of the gas in one chamber, see `gas.contract.ChamberState`.

        Raises:
            InputError: the scene has no chamber of this name.
        """
        ...

    def log(self, words: str) -> None:
        """Pass a line to the listeners of the log."""
        ...
