"""What a run carries from step to step: what a checkpoint holds, and what is taken back when a step is made anew."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Protocol, runtime_checkable

from petsc4py import PETSc

from gossamer_fx.model.roles import HistoryVariables
from gossamer_fx.system.system import System


@runtime_checkable
class Carrier(HistoryVariables, Protocol):
    """A stepper or step control with a past: vectors of the system, and what it remembers."""

    vectors: Mapping[str, PETSc.Vec]


class History:
    """All that carries the past of a run: coordinates, velocities, those `carriers` that have one, borders and terms.

    `vectors` are those at work; coordinates hold the multipliers, too.
    """

    def __init__(self, system: System, carriers: Iterable[object]) -> None:
        self._system = system
        self.vectors = {
            "coordinates": system.q0,
            "remainders of coordinates": system.increment.remainder,
            "velocities": system.v0,
            "coordinates before": system.previous,
        }
        self._remembering: dict[str, HistoryVariables] = {}
        for carrier in carriers:
            if isinstance(carrier, Carrier):
                name = type(carrier).__name__
                self._remembering[name] = carrier
                self.vectors |= {
                    f"{name} {what}": vector for what, vector in carrier.vectors.items()
                }
        for k, border in enumerate(system.scalar_unknowns):
            self._remembering[f"border {k}"] = border
        for compiled in system.compiled:
            if isinstance(compiled, HistoryVariables):
                self._remembering[type(compiled).__name__] = compiled
        for k, term in enumerate(system.terms):
            for what, thing in vars(term).items():
                if isinstance(thing, HistoryVariables):
                    self._remembering[f"part {k} {what}"] = thing
        self._kept: dict[str, PETSc.Vec] = {}

    def get_state(self) -> dict[str, Any]:
        """What is remembered beside the vectors, by name; the same on every rank."""
        return {name: thing.get_state() for name, thing in self._remembering.items()}

    def set_state(self, state: dict[str, Any]) -> None:
        """Restore what `get_state` returned; the vectors have been set."""
        self._system.restart()
        for name, thing in self._remembering.items():
            thing.set_state(state[name])

    def keep(self) -> None:
        """Note the present."""
        system = self._system
        if not self._kept:
            self._kept = {name: vector.duplicate() for name, vector in self.vectors.items()}
        for name, vector in self.vectors.items():
            vector.copy(self._kept[name])
        self._numbers = system.time, system.supplied_energy, dict(system.losses)
        self._memory = self.get_state()

    def go_back(self) -> None:
        """Be as at the last `keep`."""
        system = self._system
        for name, vector in self.vectors.items():
            self._kept[name].copy(vector)
        system.time, system.supplied_energy, losses = self._numbers
        system.losses = dict(losses)
        self.set_state(self._memory)
