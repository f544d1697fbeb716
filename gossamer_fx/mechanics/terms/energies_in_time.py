"""Energies of bodies on meshes that are forms of the coordinates and of a function of time, such as
a temperature or the direction of a clamped edge.  What changes the function supplies work.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import ufl
from dolfinx import fem, la
from petsc4py import PETSc

from gossamer_fx.core.forms.compilation import compile_form
from gossamer_fx.core.model.body import Body, MeshBody
from gossamer_fx.mechanics.terms.assembly import Assembly, CompiledTerms, KindOfTerm
from gossamer_fx.mechanics.terms.coordinates import Coordinates


@dataclass(frozen=True, eq=False)
class Varying:
    """A function of time on which an energy depends.

    Attributes:
        function: symbol of it in the forms; in those of a step its value at the end.
        set: gives a function of the same space its values at a time [s].
    """

    function: fem.Function
    set: Callable[[fem.Function, float], None]


@dataclass(frozen=True, eq=False)
class Change:
    """How a function of time changes in a step: from `before` at its start, by which the form
    `supplied` of work [J] comes into the energy."""

    varying: Varying
    before: fem.Function
    supplied: ufl.Form


@dataclass(frozen=True, eq=False)
class StepForms:
    """Forms of one energy in a step: its forces, their derivative by q1, and the energy [J] at q0;
    `change` is that of a function of time."""

    residual: ufl.Form
    tangent: ufl.Form
    energy: ufl.Form
    change: Change | None = None


class EnergiesInTime(CompiledTerms[KindOfTerm]):
    """All terms of one kind of energy in a scene; a kind says which forms it has in a step."""

    def __init__(self, terms: Sequence[Any], system: Assembly) -> None:
        """Compile the forms of all terms.  Collective."""
        self._system = system
        self._compiled = []
        for term in terms:
            forms = self._step_forms(term, system.coordinates[term.body])
            self._compiled.append(_Compiled(term, forms))

    @abstractmethod
    def _step_forms(self, term: Any, at: Coordinates) -> StepForms:
        """The forms of a term in the symbols `at` of a step."""

    def begin_step(self, t: float) -> None:
        # The end of the step, not the time t of its forces.
        self.take_time(self._system.time + self._system.h)

    def take_time(self, t: float) -> None:
        """Set the functions of time at the end of the step, t [s]."""
        for change in self._changes():
            change.varying.set(change.varying.function, t)

    def commit(self) -> None:
        """Take the functions of time at the end of the step as those at the start of the next."""
        # Copied, not evaluated again: a user's function may be expensive.
        for change in self._changes():
            change.before.x.array[:] = change.varying.function.x.array

    def supplied(self) -> float:
        """Work [J] of what changes with time in the step, this rank's share."""
        forms = [one.supplied for one in self._compiled if one.supplied is not None]
        return sum(float(fem.assemble_scalar(form)) for form in forms)

    def _changes(self) -> list[Change]:
        """The changes of those terms that have a function of time."""
        return [one.change for one in self._compiled if one.change is not None]

    def add_forces(self, r: PETSc.Vec) -> None:
        for one in self._compiled:
            # Assembly adds to what is there.
            one.force.array[:] = 0
            fem.assemble_vector(one.force.array, one.residual)
            one.force.scatter_reverse(la.InsertMode.add)
            owned = self._system.block(one.body).owned
            with r as values:
                values[owned] += one.force.array[: owned.stop - owned.start]

    def tangent_forms(self, body: Body) -> list[fem.Form]:
        return [one.tangent for one in self._compiled if one.body is body]

    def energies(self) -> dict[str, float]:
        """Stored energies [J] at q0 by name, this rank's share; terms of one name add up."""
        found: dict[str, float] = {}
        for one in self._compiled:
            energy = float(fem.assemble_scalar(one.energy))
            found[one.name] = found.get(one.name, 0.0) + energy
        return found


class _Compiled:
    """Compiled forms of one term, and the array of its forces with ghosts."""

    def __init__(self, term: Any, forms: StepForms) -> None:
        self.name: str = term.name
        self.body: MeshBody = term.body
        self.residual = compile_form(forms.residual)
        self.tangent = compile_form(forms.tangent)
        self.energy = compile_form(forms.energy)
        self.change = forms.change
        self.supplied = compile_form(forms.change.supplied) if forms.change else None
        self.force = la.vector(term.body.block.index_map, term.body.block.size)
