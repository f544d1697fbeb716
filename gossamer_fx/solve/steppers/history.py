"""The complete state of a run between two steps, as a record that does not change."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gossamer_fx.core.algebra.named_rows import NamedRows
from gossamer_fx.core.model.body import Array, MeshBody
from gossamer_fx.mechanics.terms.assembly import HistoryVariables, history_parts
from gossamer_fx.solve.steppers.stepping import Carrier
from gossamer_fx.solve.system.system import System

# The vectors of a state of a body in motion; the others say how it came there.  The names are part
# of the format of checkpoint files.
MOTION = ("coordinates", "velocities")
BEFORE = "coordinates before"
REMAINDERS = "remainders of coordinates"


@dataclass(frozen=True, eq=False)
class SavedState:
    """All on which the next step depends, on this rank.

    Rejected steps, checkpoints, tapes of runs and searches for several equilibria go back to such
    a record.

    Attributes:
        time: of the state [s].
        time_before: at the start of the step that led to it [s].
        vectors: values (n,) of this rank's unknowns by name, such as "coordinates" [m], with
            multipliers, and "velocities" [m/s].
        cells: values (n,) of this rank's cells by name, such as temperatures [K].
        variables: history variables by the name of the object that has them, see
            `HistoryVariables.get_history`.
        supplied_energy: this rank's share of what was supplied since the start [J].
        losses: this rank's share of what was lost since then [J], by name.
    """

    time: float
    time_before: float
    vectors: Mapping[str, Array]
    cells: Mapping[str, Array]
    variables: Mapping[str, Any]
    supplied_energy: float
    losses: Mapping[str, float]

    def moved_by(self, change: Array) -> SavedState:
        """The state with other coordinates, of which each of this rank's (n,) is changed [m], and
        the same history."""
        moved = self.vectors["coordinates"] + change
        return replace(self, vectors={**self.vectors, "coordinates": moved})


class History:
    """Saves and restores the state of a system, with the history variables of terms, stepper and
    step control, which do not follow from coordinates, e.g. rest angles of creases.

    Attributes:
        system: as given.
        vectors, cells: those at work, by the names that they have in a `SavedState`; of cells the
            body, and values (n,) of the cells that this rank owns.
    """

    def __init__(self, system: System, carriers: Iterable[Carrier] = ()) -> None:
        """Collect what has a state; nothing is copied."""
        self.system = system
        self.vectors = {
            "coordinates": system.unknowns.q0,
            REMAINDERS: system.unknowns.increment.remainder,
            "velocities": system.unknowns.v0,
            BEFORE: system.unknowns.previous,
        }
        if system.unknowns.supports.forces is not None:
            # Else reactions after a restart were zero until the next step.
            self.vectors["reactions"] = system.unknowns.supports.forces
        self.cells: dict[str, tuple[MeshBody, Array]] = {}
        # Objects with history variables by name: themselves, or fields of terms, which other
        # numbers replace.
        self._owners: dict[str, tuple[Any, str]] = {}
        self._find_carriers(carriers)
        self._find_terms()

    def _find_carriers(self, carriers: Iterable[Carrier]) -> None:
        """Add the history variables of the stepper and of the step control."""
        for carrier in carriers:
            name = type(carrier).__name__
            self._owners[name] = carrier, ""
            for what, vector in carrier.vectors.items():
                self.vectors[f"{name} {what}"] = vector

    def _find_terms(self) -> None:
        """Collect the objects with history variables, scalar unknowns, kinds of terms, and fields
        of terms, by names that are the same in each run of a scene."""
        system = self.system
        for k, scalars in enumerate(system.equations.scalar_unknowns):
            self._owners[name_of_scalars(k)] = scalars, ""
        for compiled in system.equations.compiled_as(HistoryVariables):
            self._owners[type(compiled).__name__] = compiled, ""
            self.cells |= compiled.cell_history()
        # Terms have no unique names, so their positions in the scene are part of the names.
        for k, term in enumerate(system.unknowns.terms):
            for what in history_parts(term):
                self._owners[f"part {k} {what}"] = term, what

    def _variables(self) -> dict[str, HistoryVariables]:
        """The objects with history variables, by name."""
        return {
            name: getattr(owner, what) if what else owner
            for name, (owner, what) in self._owners.items()
        }

    def save(self, vectors: Sequence[str] | None = None) -> SavedState:
        """The present state.  With `vectors` some of them only, as `MOTION`: it is then restored as
        if it had been at rest there before."""
        system = self.system
        names = self.vectors if vectors is None else vectors
        return SavedState(
            time=system.unknowns.time,
            time_before=system.unknowns.previous_time,
            vectors={name: np.array(self.vectors[name].array_r) for name in names},
            cells={name: values.copy() for name, (_, values) in self.cells.items()},
            variables={name: one.get_history() for name, one in self._variables().items()},
            supplied_energy=system.balance.supplied_energy,
            losses=dict(system.balance.losses),
        )

    def restore(self, saved: SavedState) -> None:
        """Make a saved state the present one; what the system derives from coordinates is computed
        again.  Vectors that it lacks stay as they are.  Collective."""
        unknowns = self.system.unknowns
        for name, saved_values in saved.vectors.items():
            self.vectors[name].array[:] = saved_values
        for name, (_, values) in self.cells.items():
            values[:] = saved.cells[name]
        unknowns.time = saved.time
        unknowns.previous_time = saved.time_before
        self.system.balance.supplied_energy = saved.supplied_energy
        # A copy, as the system changes its dictionary in place.
        self.system.balance.losses = dict(saved.losses)
        # Quantities derived from the coordinates first: history variables may depend on them.
        if BEFORE in saved.vectors:
            self.system.restart()
        else:
            unknowns.previous_time = saved.time
            unknowns.q0.copy(unknowns.previous)
            self.system.equations.start_from(unknowns.q0, saved.time)
        for name, variables in self._variables().items():
            # A restart may bring a step control, which starts without a history.
            if name in saved.variables or not isinstance(variables, Carrier):
                variables.set_history(saved.variables[name])

    def variables_of_all_ranks(self) -> dict[str, Any]:
        """The history variables of the present state for JSON, with the rows of all ranks: numbers,
        words, lists and dictionaries, the same on every rank.  Collective."""
        comm = self.system.comm
        found: dict[str, Any] = {}
        for name, variables in self._variables().items():
            found[name] = {
                key: value.of_all_ranks(comm).as_data() if isinstance(value, NamedRows) else value
                for key, value in variables.get_history().items()
            }
        return found


def name_of_scalars(k: int) -> str:
    """The name in `SavedState.variables` of the scalar unknowns with the number k in a scene."""
    return f"scalar unknowns {k}"


def variables_of_data(data: Mapping[str, Any]) -> dict[str, Any]:
    """What `History.variables_of_all_ranks` returned, as variables of a `SavedState`."""
    return {
        name: {
            key: NamedRows.of_data(value) if NamedRows.is_data(value) else value
            for key, value in variables.items()
        }
        for name, variables in data.items()
    }
