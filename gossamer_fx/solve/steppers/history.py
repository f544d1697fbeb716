"""The complete state of a run between two steps, for checkpoints and for rejected steps."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from petsc4py import PETSc

from gossamer_fx.core.model.body import Array, MeshBody
from gossamer_fx.mechanics.terms.assembly import HistoryVariables, history_parts
from gossamer_fx.solve.steppers.stepping import Carrier
from gossamer_fx.solve.system.system import System


class History:
    """Saves and restores the state of a run: coordinates, with multipliers, velocities and all
    history variables of system, terms, stepper and step control.

    A step may be undone by `rollback` to the last `commit`; a checkpoint writes `vectors`, `cells`,
    which have values (n,) in this rank's own cells, and `get_history()`.  Each is a dictionary by
    name; vectors and cells are those of the run, not copies.
    """

    def __init__(self, system: System, carriers: Iterable[Carrier]) -> None:
        """Collect the vectors and history variables, the state that does not follow from
        coordinates, e.g. rest angles of creases.  Nothing is copied before the first `commit`."""
        self._system = system
        # The names are part of the format of checkpoint files.
        self.vectors = {
            "coordinates": system.unknowns.q0,
            "remainders of coordinates": system.unknowns.increment.remainder,
            "velocities": system.unknowns.v0,
            "coordinates before": system.unknowns.previous,
        }
        if system.unknowns.supports.forces is not None:
            # Else reactions after a restart were zero until the next step.
            self.vectors["reactions"] = system.unknowns.supports.forces
        self.cells: dict[str, tuple[MeshBody, Array]] = {}
        self._variables: dict[str, HistoryVariables | Carrier] = {}
        self._find_carriers(carriers)
        self._find_terms()
        self._committed: dict[str, PETSc.Vec] = {}
        self._committed_cells: dict[str, Array] = {}

    def _find_carriers(self, carriers: Iterable[Carrier]) -> None:
        """Add the history variables of the stepper and of the step control."""
        for carrier in carriers:
            name = type(carrier).__name__
            self._variables[name] = carrier
            for what, vector in carrier.vectors.items():
                self.vectors[f"{name} {what}"] = vector

    def _find_terms(self) -> None:
        """Collect the objects with history variables, scalar unknowns, kinds of terms, and fields
        of terms, by names that are the same in each run of a scene."""
        system = self._system
        for k, scalars in enumerate(system.equations.scalar_unknowns):
            self._variables[f"scalar unknowns {k}"] = scalars
        for compiled in system.equations.compiled_as(HistoryVariables):
            self._variables[type(compiled).__name__] = compiled
            self.cells |= compiled.cell_history()
        # Terms have no unique names, so their positions in the scene are part of the names.
        for k, term in enumerate(system.unknowns.terms):
            for what, part in history_parts(term).items():
                self._variables[f"part {k} {what}"] = part

    def get_history(self) -> dict[str, Any]:
        """The history variables of each object that has some, by the object's name."""
        return {name: variables.get_history() for name, variables in self._variables.items()}

    def set_history(self, state: dict[str, Any]) -> None:
        """Restore what `get_history` returned, once `vectors` and `cells` are restored.
        Collective."""
        # Quantities derived from the coordinates first: history variables may depend on them.
        self._system.restart()
        for name, variables in self._variables.items():
            # A restart may bring a step control, which starts without a history.
            if name in state or not isinstance(variables, Carrier):
                variables.set_history(state[name])

    def commit(self) -> None:
        """Save the present state, which replaces the one saved before.  Collective."""
        system = self._system
        # Made at the first call only: a run without rejected steps needs no copies.
        if not self._committed:
            for name, vector in self.vectors.items():
                self._committed[name] = vector.duplicate()
        for name, vector in self.vectors.items():
            vector.copy(self._committed[name])
        for name, (_, values) in self.cells.items():
            self._committed_cells[name] = values.copy()
        self._times = (system.unknowns.previous_time, system.unknowns.time)
        self._supplied_energy = system.balance.supplied_energy
        # A copy, as the system changes its dictionary in place.
        self._losses = dict(system.balance.losses)
        self._state = self.get_history()

    def rollback(self) -> None:
        """Restore the state of the last `commit`, in place, as often as wanted; what the system
        derives from coordinates is computed again.  Collective."""
        system = self._system
        for name, vector in self.vectors.items():
            self._committed[name].copy(vector)
        for name, (_, values) in self.cells.items():
            values[:] = self._committed_cells[name]
        system.unknowns.previous_time, system.unknowns.time = self._times
        system.balance.supplied_energy = self._supplied_energy
        system.balance.losses = dict(self._losses)
        self.set_history(self._state)
