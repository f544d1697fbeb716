"""Energies ½ a(t; q, q) of a quadratic form that changes with time, such as those of clamps that
turn or heat up."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import ufl
from dolfinx import fem, la
from petsc4py import PETSc

from gossamer_fx.core.forms.compilation import compile_form, constant
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.model.body import Body, MeshBody
from gossamer_fx.mechanics.terms.assembly import Assembly, CompiledTerms, Compiler


class MovingEnergies(CompiledTerms["MovingEnergy"]):
    """All `MovingEnergy` terms of a scene.

    With the matrices K0, K1 of both ends of a step the force is ½ (K0 + K1) q_mid; what changes the
    form supplies ¼ (q1·(K1 - K0) q1 + q0·(K1 - K0) q0), and both together change the energy
    exactly.
    """

    def __init__(self, terms: Sequence[MovingEnergy], system: Assembly) -> None:
        """Compile force, tangent, supplied work and energy of each term.  Collective.

        A term is a stored energy ½ a(d; q, q) [J], quadratic in the coordinates q, with a function
        d of time.  Two forms are compiled without their factors: the form `energy` is a(d; q, q) at
        the start of the step, twice the stored energy, and the form `work` is four times the
        supplied work.  `energies` and `supplied` divide by these factors.

        Args:
            terms: all such terms of the scene.
            system: the compiled scene, which has the fields of their bodies.
        """
        self._system = system
        self._compiled = []
        # Where forces act at the end, so does the matrix; else it is the mean of both ends.
        at_end = system.rule.acts_at_end
        for term in terms:
            # The symbols of a step: coordinates q0 at its start, q1 at its end and mid = (1 - α) q0
            # + α q1, where the forces act; test function w and trial function dq.
            at = system.coordinates[term.body]
            before = fem.Function(term.space)
            after = fem.Function(term.space)
            share = constant(term.body.space.mesh, 1.0 if at_end else 0.5)
            ends = (after,) if at_end else (before, after)
            residual = sum(share * term.form(at.mid, at.w, d) for d in ends)
            tangent = sum(at.α * share * term.form(at.dq, at.w, d) for d in ends)
            # With the matrix K of a, a(d; q, q) = q·K q.  The sum of q·(K1 - K0) q at both ends of
            # the step is four times the supplied work; `energy` is twice the stored energy.
            energy = term.form(at.q0, at.q0, before)
            change_at_start = term.form(at.q0, at.q0, after) - energy
            change_at_end = term.form(at.q1, at.q1, after) - term.form(at.q1, at.q1, before)
            compiled = _Compiled(
                term=term,
                before=before,
                after=after,
                force=la.vector(term.body.block.index_map, term.body.block.size),
                residual=compile_form(residual),
                tangent=compile_form(tangent),
                work=compile_form(change_at_start + change_at_end),
                energy=compile_form(energy),
            )
            self._compiled.append(compiled)

    def begin_step(self, t: float) -> None:
        self.take_time(self._system.time + self._system.h)

    def take_time(self, t: float) -> None:
        for c in self._compiled:
            c.term.set(c.after, t)

    def commit(self) -> None:
        # Copied, not evaluated again: a user's function may be expensive.
        for c in self._compiled:
            c.before.x.array[:] = c.after.x.array

    def add_forces(self, r: PETSc.Vec) -> None:
        """Add the forces [N] of all terms to r."""
        for c in self._compiled:
            c.force.array[:] = 0
            fem.assemble_vector(c.force.array, c.residual)
            c.force.scatter_reverse(la.InsertMode.add)
            owned = self._system.block(c.term.body).owned
            with r as values:
                values[owned] += c.force.array[: owned.stop - owned.start]

    def tangent_forms(self, body: Body) -> list[fem.Form]:
        return [c.tangent for c in self._compiled if c.term.body is body]

    def supplied(self) -> float:
        """This rank's share of the work [J] that the changes of the terms supply in the step."""
        return sum(float(fem.assemble_scalar(c.work)) / 4 for c in self._compiled)

    def energies(self) -> dict[str, float]:
        """This rank's share of the stored energy [J] at the start of the step, by name."""
        # The clamps of a plate have one name, and that of its bending.
        found: dict[str, float] = {}
        for c in self._compiled:
            energy = float(fem.assemble_scalar(c.energy)) / 2
            found[c.term.name] = found.get(c.term.name, 0.0) + energy
        return found


@dataclass(frozen=True, eq=False)
class MovingEnergy:
    """Stored energy ½ a(d; q, q) of a symmetric bilinear form, written form(q, w, d), with a
    function d of time.

    `set` gives a function of `space` the values of d at a time [s].  The work of what changes d is
    supplied.
    """

    name: str
    body: MeshBody
    form: Callable[[Expr, Expr, Expr], ufl.Form]
    space: fem.FunctionSpace
    set: Callable[[fem.Function, float], None]
    compiler: ClassVar[Compiler] = MovingEnergies


@dataclass(frozen=True, eq=False)
class _Compiled:
    """A term with its compiled forms.

    Attributes:
        term: the stored energy ½ a(d; q, q) [J].
        before, after: d at the start and at the end of the step.
        force: work array for the force [N] of this rank's nodes, ghosts included.
        residual: the force of the step [N].
        tangent: its derivative [N/m] by the coordinates at the end.
        work: four times the work [J] that the change of d supplies.
        energy: a(d; q, q) [J] at the start of the step, twice the stored energy.
    """

    term: MovingEnergy
    before: fem.Function
    after: fem.Function
    force: la.Vector
    residual: fem.Form
    tangent: fem.Form
    work: fem.Form
    energy: fem.Form
