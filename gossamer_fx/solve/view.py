"""The view of a state that outputs and probes read.

A `Simulation`, an `Equilibrium` and a mode of vibration are such views.  An output therefore writes
any of them, and depends on none of the codes that make them.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from mpi4py import MPI

from gossamer_fx.core.checks.lookups import check_known
from gossamer_fx.core.model.state import HasSystem
from gossamer_fx.solve.scene.scene import Scene
from gossamer_fx.solve.steppers.history import History
from gossamer_fx.solve.steppers.stepping import Stepper
from gossamer_fx.solve.system.system import System
from gossamer_fx.solve.system.totals import Totals

# A name with a unit at its end, e.g. "pressure [Pa]".
_NAME_AND_UNIT = re.compile(r"(.*\S)\s*\[([^]]*)\]")


@dataclass(frozen=True)
class Axis:
    """What a record goes along: the time of a run, or the load parameter of a path of equilibria.

    Attributes:
        name: e.g. "time" or "pressure".
        unit: e.g. "s" or "Pa"; empty for a pure number.
    """

    name: str
    unit: str = ""

    @classmethod
    def of(cls, words: str) -> Axis:
        """The axis of a name with its unit, e.g. "pressure [Pa]"."""
        # Tables and run.json, which both hold the name, write other characters in different ways.
        shown = "".join(c if c.isprintable() else "\ufffd" for c in words)
        found = _NAME_AND_UNIT.fullmatch(shown)
        if found is None:
            return cls(shown)
        return cls(found[1], found[2])

    @property
    def symbol(self) -> str:
        """The name in captions: "t" for the time."""
        return "t" if self.name == "time" else self.name

    @property
    def column(self) -> str:
        """Name of the first column of tables: "time", or with the unit, e.g. "pressure [Pa]"."""
        return "time" if self.name == "time" else self.label(self.unit)

    def label(self, unit: str) -> str:
        """Label of the axis of a figure in a multiple of the unit, e.g. "t [ms]"."""
        return f"{self.symbol} [{unit}]" if unit else self.symbol

    def words(self, value: float, digits: int = 6) -> str:
        """A value in a message, e.g. "t = 0.1 s"."""
        return f"{self.symbol} = {value:.{digits}g} {self.unit}".rstrip()


TIME = Axis("time", "s")
LOAD_PARAMETER = Axis("load parameter")
# What curves of a path past limit points are drawn over; its record goes along its points, as the
# load may fall.
LOAD_FACTOR = Axis("load factor")


@dataclass(frozen=True)
class ClosingErrors:
    """How the balances of energy and gas close.

    Attributes:
        at_rest: whether no energy so far was larger than what round-off gives to a scene at rest.
        energy_error: closing error of the energy, as a share of the largest one; zero at rest.
        energy_defect: the same [J].
        largest_energy: to which the error refers [J].
        mass_error: closing error of the gas masses, as a share of the largest mass.
    """

    at_rest: bool
    energy_error: float
    energy_defect: float
    largest_energy: float
    mass_error: float


@dataclass(frozen=True)
class Account:
    """How a state was made, for tables, run.json and the terminal.

    Attributes:
        kind: "run", "equilibrium" or "mode".
        method: class and numbers of the time stepper or the search.
        until: value on the axis at which the record ends.
        iterations: of Newton's method in all steps.
        last_iterations: of Newton's method in the last step.
        rejected: number of rejected steps.
        seconds: wall time of all steps [s].
        compile_seconds: wall time before the first step [s].
        output_seconds: wall time of outputs [s].
        solver: the solver, its iterations and the shares of its wall time, in words.
        balance: None where no energy is conserved from state to state.
        columns: further numbers of the state for the ledger, e.g. the residual of an equilibrium.
        caption: words for the state in pictures; empty: the value on the axis.
        details: further entries of run.json.
    """

    kind: str
    method: Mapping[str, Any]
    until: float
    iterations: int = 0
    last_iterations: int = 0
    rejected: int = 0
    seconds: float = 0.0
    compile_seconds: float = 0.0
    output_seconds: float = 0.0
    solver: str = ""
    balance: ClosingErrors | None = None
    columns: Mapping[str, float] = field(default_factory=dict)
    caption: str = ""
    details: Mapping[str, Any] = field(default_factory=dict)


def chamber_states(system: System) -> dict[str, Any]:
    """States of the gas chambers and tanks of a scene by name, see `gas.contract.ChamberState`."""
    found: dict[str, Any] = {}
    for scalars in system.equations.scalar_unknowns:
        found |= scalars.states()
    return found


def chamber_state(system: System, name: str) -> Any:
    """State of the gas in one chamber or tank; `InputError` if none in the scene has this name."""
    chambers = chamber_states(system)
    check_known("The scene", "chamber", name, chambers)
    return chambers[name]


class StateView(HasSystem, ABC):
    """A state of a scene.  All members are the same on every rank, and may be collective.

    Attributes:
        comm: communicator of the scene.
        scene: what was given.
        system: the compiled scene, with its state.
        axis: what `time` is.
        step: number of steps, or of searches, that were made.
    """

    comm: MPI.Intracomm
    scene: Scene
    system: System
    axis: Axis
    step: int

    @property
    @abstractmethod
    def time(self) -> float:
        """Time of the state [s], or load parameter in the unit of the axis."""

    @property
    @abstractmethod
    def totals(self) -> Totals:
        """Energies [J], momenta and masses [kg] of the state."""

    @property
    @abstractmethod
    def account(self) -> Account:
        """How the state was made."""

    @property
    @abstractmethod
    def chambers(self) -> Mapping[str, Any]:
        """State of the gas in each chamber and tank by name, see `gas.contract.ChamberState`."""

    @abstractmethod
    def chamber(self, name: str) -> Any:
        """State of the gas in one chamber, see `gas.contract.ChamberState`.

        Raises:
            InputError: the scene has no chamber of this name.
        """


class SteppedRun(StateView):
    """A view that goes on by time steps, and that checkpoints save and restore: a `Simulation`.

    Attributes:
        stepper: the time stepping rule that was given.
        history: coordinates, velocities and history variables of the scene.
        outputs: those of the run, whose positions in their files are saved with it.
        recorded: whether the outputs have recorded the present state.
        cursors: positions of the outputs, each by its kind, before the present state, for the case
            that they have not.
    """

    stepper: Stepper
    history: History
    outputs: list[Any]
    recorded: bool
    cursors: list[tuple[str, dict[str, Any]]]

    @abstractmethod
    def log(self, words: str) -> None:
        """Pass a line to the listeners of the log."""

    @abstractmethod
    def get_history(self) -> dict[str, Any]:
        """Its state beyond the history of the scene, for JSON; the same on every rank."""

    @abstractmethod
    def set_history(self, state: dict[str, Any]) -> None:
        """Restore what `get_history` returned, after the history of the scene."""


class Sought(StateView):
    """A view whose state is searched for at a value of its load parameter: an `Equilibrium`."""

    @abstractmethod
    def find(self, at: float) -> Any:
        """Search for the state at a load parameter."""

    @abstractmethod
    def need(self, what: str) -> None:
        """Raise `InputError` unless a state was found; `what` names the caller."""

    @property
    @abstractmethod
    def is_known_regular(self) -> bool:
        """Whether the tangent in the present state was found to be regular."""

    @property
    @abstractmethod
    def free_words(self) -> str:
        """Why the tangent may be singular, as a clause, e.g. which motions nothing resists."""


class ForSystem[T]:
    """What a probe compiles for a system, again only if it is called with another system."""

    def __init__(self, compiled: Callable[[System], T]) -> None:
        self._compile = compiled
        self._last: tuple[System, T] | None = None

    def __call__(self, system: System) -> T:
        if self._last is None or self._last[0] is not system:
            self._last = (system, self._compile(system))
        return self._last[1]
