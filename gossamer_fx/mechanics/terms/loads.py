"""Loads on mesh bodies: their force at q_mid and their work over a step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
import ufl
from dolfinx import fem, la
from petsc4py import PETSc

from gossamer_fx.core.forms.backend import add_to_vector
from gossamer_fx.core.forms.compilation import compile_form
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.model.body import Array, Body, MeshBody
from gossamer_fx.core.model.terms import Parameter
from gossamer_fx.mechanics.terms.assembly import (
    Assembly,
    CompiledTerms,
    Compiler,
    Differentiable,
)
from gossamer_fx.mechanics.terms.coordinates import Coordinates


class Loads(Differentiable, CompiledTerms["Load"]):
    """All `Load` terms of a scene."""

    is_external_load = True
    forces_are_forms = True
    has_shape_derivative = True

    def __init__(self, terms: Sequence[Load], system: Assembly) -> None:
        self._system = system
        self._loads = [LoadForces(term, system.coordinates[term.body]) for term in terms]

    def begin_step(self, t: float) -> None:
        for load in self._loads:
            if load.term.at is not None:
                load.term.at(t)

    def add_forces(self, r: PETSc.Vec) -> None:
        """Subtract the loads [N] from r."""
        with r as values:
            for load in self._loads:
                load.assemble()
                body = load.term.body
                owned = self._system.block(body).owned
                self._system.coordinates[body].add_forces(-load.force.array, values[owned])

    def tangent_forms(self, body: Body) -> list[fem.Form]:
        return [load.tangent for load in self._loads if load.term.body is body and load.tangent]

    def residual_forms(self, body: Body, w: Expr) -> list[ufl.Form]:
        found = []
        for load in self._loads:
            if load.term.body is body:
                at = self._system.coordinates[load.term.body]
                found.append(-load.term.work(at.mid, w))
        return found

    def parameters_changed(self) -> None:
        for load in self._loads:
            load.forget()

    def supplied(self) -> float:
        """Work [J] of the loads in the present step; collective for loads that follow the body, in
        statics."""
        work = 0.0
        # Change (n,) [m] of this rank's coordinates in the step.
        Δq = self._system.q1.array_r - self._system.q0.array_r
        for load in self._loads:
            body = load.term.body
            owned = self._system.block(body).owned
            forces = np.zeros(owned.stop - owned.start)
            self._system.coordinates[body].add_forces(load.path_average(), forces)
            work += float(Δq[owned] @ forces)
        return work

    def resultants(self) -> dict[str, Array]:
        """Resultants in the configuration in which the forces of the last accepted step acted."""
        # α is the weight of the end of the step in the configuration q in which forces f acted.
        system = self._system
        found = dict[str, Array]()
        α = system.rule.alpha
        for load in self._loads:
            body = load.term.body
            owned = system.block(body).owned
            # The step is committed: its start is `previous`, its end is q0.
            start = system.previous.array_r[owned]
            end = system.q0.array_r[owned]
            q = ((1 - α) * start + α * end).reshape(-1, 3)
            f = load.force.array[: owned.stop - owned.start].reshape(-1, 3)
            # Of the vectors of a node the first is its position; directors have a moment only.
            vectors_per_node = body.block.size // 3
            force = f[::vectors_per_node].sum(axis=0)
            moment = np.cross(q, f).sum(axis=0)
            found[load.term.name] = found.get(load.term.name, 0.0) + np.array([force, moment])
        return found


@dataclass(frozen=True, eq=False)
class Load:
    """A load: `work(q, w)` is its virtual work, linear in w; `at(t)`, if given, sets its constants
    to time t.

    `parameters` are constants of the work that no `at` sets.
    """

    name: str
    body: MeshBody
    work: Callable[[Expr, Expr], ufl.Form]
    # Whether the work form depends on the configuration q: then it has a tangent.
    follows: bool = False
    at: Callable[[float], None] | None = None
    parameters: tuple[Parameter, ...] = ()
    compiler: ClassVar[Compiler] = Loads


class RateWork(Protocol):
    """What a load needs that also depends on the mean velocity of the step: `work(q, rate, w)`."""

    @property
    def name(self) -> str: ...

    @property
    def body(self) -> MeshBody: ...

    @property
    def work(self) -> Callable[[Expr, Expr, Expr], ufl.Form]: ...


def rate_of(at: Coordinates) -> Expr:
    """(q1 - q0)/h."""
    return (at.q1 - at.q0) / at.h


def at_rate(term: RateWork, at: Coordinates) -> Load:
    """The term as a load on these coordinates, whose step h [s] is to be set before each step."""

    def work(q: Expr, w: Expr) -> ufl.Form:
        return term.work(q, rate_of(at), w)

    return Load(term.name, term.body, work, follows=True)


class LoadForces:
    """A load, compiled."""

    def __init__(self, term: Load, at: Coordinates) -> None:
        """Compile the virtual work [J] of the load, and its derivative if the load follows the
        body.  Collective."""
        self.term = term
        self._at = at
        # Virtual work along the test function, at the configuration in which the force acts.
        δW = term.work(at.mid, at.w)
        self.form = compile_form(δW)
        # Compiling a zero derivative would take a kernel, and assembling it time.
        self.tangent = None
        if term.follows:
            self.tangent = compile_form(-ufl.derivative(δW, at.q1, at.dq))
        dofmap = at.q0.function_space.dofmap
        self.force = la.vector(dofmap.index_map, dofmap.index_map_bs)
        # A dead load is assembled once in a run.
        self._changes = term.follows or term.at is not None
        self._assembled = False

    def assemble(self) -> None:
        """Assemble the forces, unless they are known and cannot have changed."""
        if self._changes or not self._assembled:
            self.force.array[:] = 0
            add_to_vector(self.force.array, self.form)
            self.force.scatter_reverse(la.InsertMode.add)
            self._assembled = True

    def forget(self) -> None:
        """Assemble the force again when it is asked for, also if it is constant in a run."""
        self._assembled = False

    def path_average(self) -> Array:
        """The force (n,) [N], over owned and ghost unknowns, whose product with the change Δq of
        the coordinates is the work of the step; `force` has to be that of the end of the step.
        Collective.

        The midpoint rule does its work with the force at the middle of the step.  Of a force at the
        end of the step, the work along the straight path is taken, by Simpson's rule: exact for
        forces that are at most cubic in the coordinates, such as pressure.
        """
        end: Array = self.force.array.copy()
        α = self._at.α
        if not self.term.follows or α.value != 1:
            return end
        # α is a constant of the form: the same kernel gives the force anywhere on the path.
        average = end / 6
        for weight, position in ((1 / 6, 0.0), (4 / 6, 0.5)):
            α.value = position
            self.assemble()
            average += weight * self.force.array
        # Others read the force and α of the end of the step.
        α.value = 1.0
        self.force.array[:] = end
        return average
