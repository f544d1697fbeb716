"""The equations of one step of a compiled scene.

`Equations` knows the contract of terms (`terms.assembly`), but no kind of term by name.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Never, cast

import numpy as np
from petsc4py import PETSc

from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.terms.assembly import (
    ActiveSet,
    Differentiable,
    Multipliers,
    Shown,
)
from gossamer_fx.mechanics.terms.scalar_unknowns import ScalarUnknowns
from gossamer_fx.solve.system.matrices import Matrices, defining
from gossamer_fx.solve.system.unknowns import Unknowns


class Equations:
    """The residual of a step, whose unknowns are the end coordinates q1 of all bodies, Lagrange
    multipliers, and the scalar unknowns y, such as gas pressures:

        r = c M (w + o) + Σ stored and dissipated forces - Σ loads + forces of scalar unknowns
        q1 = q0 + p + w

    The stepper predicts the increment p (`predict`) and chooses c and o (`set_inertia`): the
    midpoint rule has p = h v0, c = 2/h², o = 0.  The solver finds w, see `Increment`.  The rows of
    multipliers in r are the constraints.

    Attributes:
        compiled: the compiled kinds of terms, all of which take part in each step.
        constraints: the kind with Lagrange multipliers; None without any.
        active_sets, differentiable, shown: the kinds with these facets.
        scalar_unknowns: gas networks and the like; the scene adds them before the initial state is
            set.
        matrices: derivatives of the residual.
    """

    def __init__(self, unknowns: Unknowns) -> None:
        self.unknowns = unknowns
        # The terms of a kind are those that name it as their compiler, which the type of `kinds`
        # cannot say.
        self.compiled = unknowns.compiled
        self.compiled += [
            compiled
            for kind, alike in unknowns.kinds.items()
            for compiled in kind.compile(cast("list[Never]", alike), unknowns)
        ]
        self.constraints: Multipliers | None = next(iter(self.compiled_as(Multipliers)), None)
        self.active_sets = self.compiled_as(ActiveSet)
        self.differentiable = self.compiled_as(Differentiable)
        self.shown = self.compiled_as(Shown)
        # What an iteration asks; the other terms have nothing to do there.
        self._updated = defining("update", self.compiled)
        self._acting = defining("add_forces", self.compiled)
        self.scalar_unknowns: list[ScalarUnknowns] = []
        self.matrices = Matrices(unknowns, self.compiled, self.active_sets)

    def compiled_as[T](self, facet: type[T]) -> list[T]:
        """The compiled terms of a class or with a facet."""
        return [compiled for compiled in self.compiled if isinstance(compiled, facet)]

    # ---- the accepted state ----------------------------------------------------------------------

    def take_time(self, t: float) -> None:
        """Give the time t [s] of the state that follows to terms that depend on it."""
        for compiled in self.compiled:
            compiled.take_time(t)

    def start_from(self, q: PETSc.Vec, t: float) -> None:
        """Make q [m], of the time t [s], the start of the next step, with its true strains.
        Collective."""
        self.take_time(t)
        self.set_end(q)
        self.begin_next()

    def begin_next(self) -> None:
        """Make q1 and its strains the start of the next step."""
        self.unknowns.begin_next()
        for compiled in self.compiled:
            compiled.commit()

    # ---- a step ----------------------------------------------------------------------------------

    def begin_step(self, h: float) -> Array:
        """Start a step of length h [s] from the accepted state (q0, v0), with a new search for
        active sets (contact pairs).  Returns the first guess of the scalar unknowns.  Collective.
        """
        self.unknowns.h = h
        self.unknowns.supports.check_turns(self.unknowns.time, h)
        for active_set in self.active_sets:
            active_set.update_active_set()
        return self.begin_without_search(h)

    def begin_recorded_step(self, h: float, active_sets: Sequence[Any]) -> Array:
        """Start a step of length h [s] with recorded active sets of this rank, one for each kind of
        contact, instead of a search.  Returns the first guess of the scalar unknowns.  Collective.
        """
        self.unknowns.h = h
        for compiled, saved in zip(self.active_sets, active_sets, strict=True):
            compiled.load_active_set(saved)
        return self.begin_without_search(h)

    def begin_without_search(self, h: float) -> Array:
        """Start a step of length h [s] with the present active sets.  Returns the first guess of
        the scalar unknowns.  Collective."""
        self.unknowns.h = h
        t = self.unknowns.time + self.unknowns.rule.alpha * h
        for compiled in self.compiled:
            compiled.begin_step(t)
        guesses = [scalars.begin_step(h, t) for scalars in self.scalar_unknowns]
        return np.concatenate([np.zeros(0), *guesses])

    def extend_active_set(self) -> bool:
        """Add contact pairs that a solved step needs and that its active sets lack; returns whether
        any rank has added some.  Collective."""
        if not self.active_sets:
            return False
        missed = [active_set.extend_active_set() for active_set in self.active_sets]
        # Ranks decide together, as all of them solve the step again.
        return self.unknowns.comm.allreduce(any(missed))

    def inadmissible(self) -> str:
        """Why the solution of the step cannot be accepted, in words; empty if it can.
        Collective."""
        found = [scalars.inadmissible() for scalars in self.scalar_unknowns]
        found += [compiled.inadmissible() for compiled in self.compiled]
        # All checks are made before the first message is chosen: they are collective.
        return next(filter(None, found), "")

    def limit_update(self, update: Array) -> None:
        """Shorten a Newton update (n,) [m] of this rank's unknowns, in place, where contact
        requires it.  Collective."""
        for active_set in self.active_sets:
            active_set.limit_update(update)

    def set_inertia(self, c: float, offset: PETSc.Vec | None = None) -> None:
        """Choose c [1/s²] and o [m], None for zero, of the inertia c M (w + o)."""
        self.unknowns.increment.set_inertia(c, offset)

    def predict(self, increment: PETSc.Vec) -> Array:
        """Choose p [m], from which w counts, by the stepper's increment [m] of the coordinates;
        returns w of this rank's fixed coordinates, in the order of `supports.held`.  Collective."""
        end = self.unknowns.time + self.unknowns.h
        return self.unknowns.increment.predict(increment, self.unknowns.q0, end)

    def set_increment(self, w: PETSc.Vec, base: PETSc.Vec | None) -> None:
        """Set the coordinates at the end of the step, q1 = q0 + p + w, and the strains there.  They
        follow linearly from those of the last iterate, w = `base` [m]; without it they are the true
        ones. Collective."""
        self.unknowns.move_by(w, base)
        for compiled in self._updated:
            compiled.update(base is not None)

    def set_end(self, q: PETSc.Vec) -> None:
        """Set q1 = q [m], with its true strains.  Collective."""
        self.unknowns.move_to(q)
        for compiled in self._updated:
            compiled.update(False)

    # ---- forces ----------------------------------------------------------------------------------

    def residual(self, y: Array, r: PETSc.Vec) -> Array:
        """Set r to the residual [N] of the coordinates at the present iterate, and return that of
        the scalar unknowns y (m,).  The rows of fixed coordinates go to `supports`, as reactions.
        Collective."""
        # First the gas: its pressure enters the forces on films.  s: residuals of scalar unknowns.
        s = np.zeros(self.matrices.scalar_count)
        for scalars, part in self.matrices.scalars:
            s[part] = scalars.residual(y[part])
        self.unknowns.increment.add_inertia(self.unknowns.M, r)
        K = self.matrices.K
        if K is not None:
            K.multAdd(self.unknowns.middle(), r, r)
        for compiled in self._acting:
            compiled.add_forces(r)
        for scalars in self.scalar_unknowns:
            scalars.add_force(r.array)
        # Last: the sum of all forces on fixed coordinates is the reaction of their supports.
        self.unknowns.supports.take(r)
        return s

    def stored_forces(self) -> PETSc.Vec:
        """Derivatives ψ'(q0) [N] of all stored energies of bodies in the accepted state, as a new
        vector: [J] for directors, zero for multipliers.  Collective.

        They are the forces of a step that goes nowhere.  Contact is included, gas pressures and
        loads are not.  Two things are changed and stay so: q1 becomes q0, and the active pairs of
        contact become those with energy at q0.
        """
        out = self.unknowns.numbering.vector()
        self.set_end(self.unknowns.q0)
        # The active pairs are those of the last step: replace them by those of the present state.
        for active_set in self.active_sets:
            active_set.activate_present()
        if self.matrices.K is not None:
            self.matrices.K.mult(self.unknowns.q0, out)
        for compiled in self.compiled:
            if not compiled.is_external_load and not isinstance(compiled, Multipliers):
                compiled.add_forces(out)
        return out

    def load_forces(self) -> PETSc.Vec:
        """Forces [N] of loads at the last residual, with the opposite sign; zero at fixed
        coordinates."""
        out = self.unknowns.numbering.vector()
        for compiled in self.compiled:
            if compiled.is_external_load:
                compiled.add_forces(out)
        with out as values:
            values[self.unknowns.supports.held] = 0.0
        return out

    def external_forces(self) -> PETSc.Vec:
        """Forces [N] of loads, scalar unknowns such as gas pressures and supports (their reactions)
        at the last residual, as a new vector.  Collective."""
        out = self.load_forces()
        with out as values:
            for scalars in self.scalar_unknowns:
                scalars.add_force(values)
            # Internal forces have the opposite sign of those from outside.
            values *= -1
            values[self.unknowns.supports.held] = self.unknowns.supports.reactions
        return out
