"""A compiled scene: its unknowns, residual and tangent.

`System` knows the contract of terms (`terms.assembly`), but no kind of term by name.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Never, cast

import numpy as np
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc

import gossamer_fx.solve.solvers.factorisation as factorisation
from gossamer_fx.core.algebra.numbering import NumberedBlock, Numbering
from gossamer_fx.core.algebra.rotations import LAST, NEXT
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array, Body, is_on_mesh
from gossamer_fx.core.model.state import InitialState, State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.terms.assembly import (
    ActiveSet,
    CompiledTerms,
    Compiler,
    Differentiable,
    HistoryVariables,
    ItemTerms,
    Multipliers,
    Shown,
    history_parts,
)
from gossamer_fx.mechanics.terms.coordinates import Coordinates
from gossamer_fx.mechanics.terms.discrete_gradient import StressRule
from gossamer_fx.mechanics.terms.scalar_unknowns import ScalarUnknowns
from gossamer_fx.mechanics.terms.supports import Support, Supports
from gossamer_fx.solve.system.increment import Increment
from gossamer_fx.solve.system.tangent import Tangent
from gossamer_fx.solve.system.totals import Totals

# Gaps of constraints at the start, over their size, that are above round-off.
GAP = 1e-14


SAME_PATTERN = PETSc.Mat.Structure.SAME_NONZERO_PATTERN


class System:
    """Unknowns and equations of a scene for one stress rule.

    The unknowns of a step are the end coordinates q1 of all bodies, in one vector, and the scalar
    unknowns y, such as gas pressures.  The residual is

        r = c M (w + o) + Σ stored and dissipated forces - Σ loads + forces of scalar unknowns
        q1 = q0 + p + w

    The stepper predicts the increment p (`predict`) and chooses c and o (`set_inertia`): the
    midpoint rule has p = h v0, c = 2/h², o = 0.  The solver finds w, see `Increment`.  Lagrange
    multipliers stand behind the coordinates in the same vector; they have no mass and no rate, and
    their rows of r are the constraints.

    Args:
        start: the initial state, with initial conditions applied.
        items: those of the scene with their terms.
        rule: the stress rule.

    Attributes:
        bodies: the bodies of the scene, in the order of their unknowns.
        terms: all terms of the scene.
        compiled: the compiled kinds of terms, all of which take part in each step.
        constraints, active_sets, differentiable, shown: those of them with these facets.
        scalar_unknowns: gas networks and the like; the scene adds them before `initialise`.
        scalar_count: number of all scalar unknowns.
        state: the accepted state.
        end: coordinates at the end of the step, as iterated; its velocities are those of the start.
        coordinates: of bodies on meshes, as functions for forms.
        numbering: global indices of all unknowns, which makes vectors and matrices.
        supports: fixed and prescribed coordinates.
        increment: p, w and the inertia of the step.
        M, A, K: mass matrix [kg], tangent [N/m], and constant stiffness [N/m], None if no term has
            one; made by `initialise`.
        coupled_tangent: A with the couplings of active sets.
        c: factor [1/s²] of the inertia, from the last `set_inertia`.
        q0, v0: coordinates and velocities of the accepted state.
        q1: coordinates at the end of the step, as iterated.
        previous: coordinates at the start of the last accepted step.
        initial: the state in which the scene starts.
        position_marks: 1 for each position and 0 for each director among the vectors of this rank's
            nodes, (n,).
        time: of the accepted state [s].
        previous_time: at the start of the last accepted step [s].
        h: length of the step [s].
        geometric: share of the geometric stiffness in tangents, 0 or 1.
        supplied_energy: since the start [J], this rank's share.
        restored_resultants: those of the last step of a run that was restarted, until the next one;
            else None.
        recorders: called after each accepted step.
        losses: dissipated energies since the start [J] by name, this rank's share.
    """

    def __init__(self, start: InitialState, items: Sequence[ItemTerms], rule: StressRule) -> None:
        self.comm = start.comm
        self.initial = start
        self.rule = rule
        self.bodies: list[Body] = [one.body for one in start]
        self._items = items
        self.terms: list[Term] = [term for each in items for term in each.terms]
        self.scalar_unknowns: list[ScalarUnknowns] = []
        # With their part of all of them.
        self._scalar_parts: list[tuple[ScalarUnknowns, slice]] = []
        self.scalar_count = 0
        self.recorders: list[Callable[[], None]] = []
        self.time = 0.0
        self.previous_time = 0.0
        self.h = 1.0
        self.geometric = 1.0
        self.supplied_energy = 0.0
        self.restored_resultants: dict[str, Array] | None = None

        # All terms of a kind are compiled together, so that their arrays and forms are shared.
        kinds: dict[Compiler, list[Term]] = {}
        for term in self.terms:
            kinds.setdefault(term.compiler, []).append(term)
        # Before any kind is compiled, since a kind needs the numbering.  A block is the unknowns of
        # one body, or the Lagrange multipliers of one constraint.
        multipliers = [
            block
            for kind, alike in kinds.items()
            if issubclass(kind, Multipliers)
            for block in kind.multipliers(alike, self.comm)
        ]
        blocks = [body.block for body in self.bodies]
        self.numbering = numbering = Numbering(self.comm, blocks, multipliers)
        self._block_of = {body: NumberedBlock(numbering, k) for k, body in enumerate(self.bodies)}
        # Distributed vectors of all unknowns, without ghosts: coordinates [m] at the start (q0) and
        # the end (q1) of the step, velocities [m/s] at its start, and q0 of the step before.
        self.q0 = numbering.vector()
        self.q1 = numbering.vector()
        self.v0 = numbering.vector()
        self.previous = numbering.vector()
        self._scratch = numbering.vector()
        self._momenta = numbering.vector()
        self.state = State(self.bodies, self.comm, self.q0, self.v0)
        self.end = State(self.bodies, self.comm, self.q1, self.v0)
        self.coordinates: dict[Body, Coordinates] = {
            body: body.coordinates(rule.alpha) for body in self.bodies if is_on_mesh(body)
        }
        self.position_marks = self._mark_positions()

        supports = [term for term in kinds.pop(Supports, []) if isinstance(term, Support)]
        self.supports = Supports(supports, self)
        self.increment = Increment(numbering, self.supports)
        # The terms of a kind are those that name it as their compiler, which the type of `kinds`
        # cannot say.
        self.compiled = [
            compiled
            for kind, alike in kinds.items()
            for compiled in kind.compile(cast("list[Never]", alike), self)
        ]
        self._find_facets()
        self.losses = {name: 0.0 for compiled in self.compiled for name in compiled.losses}

    def _mark_positions(self) -> Array:
        """`position_marks` of this rank."""
        marks = []
        for body in self.bodies:
            of_node = np.zeros(body.block.size // 3)
            of_node[0] = 1.0
            marks.append(np.tile(of_node, body.block.index_map.size_local))
        return np.concatenate([np.zeros(0), *marks])

    def _find_facets(self) -> None:
        """Find the compiled kinds of terms with a facet, once for the whole run."""
        # The constraints with Lagrange multipliers are of one kind; None without any.
        self.constraints: Multipliers | None = next(iter(self.compiled_as(Multipliers)), None)
        self.active_sets = self.compiled_as(ActiveSet)
        self.differentiable = self.compiled_as(Differentiable)
        self.shown = self.compiled_as(Shown)
        # What an iteration asks; the other terms have nothing to do there.
        self._updated = self._defining("update")
        self._acting = self._defining("add_forces")
        self._with_tangents = self._defining("add_tangents")
        self._with_forms = self._defining("tangent_forms")

    def _defining(self, method: str) -> list[CompiledTerms[Never]]:
        """The compiled terms that define a method of the contract, whose default does nothing."""
        default = getattr(CompiledTerms, method)
        return [each for each in self.compiled if getattr(type(each), method) is not default]

    # ---- look-ups --------------------------------------------------------------------------------

    def compiled_as[T](self, facet: type[T]) -> list[T]:
        """The compiled terms of a class or with a facet."""
        return [compiled for compiled in self.compiled if isinstance(compiled, facet)]

    @property
    def chambers(self) -> dict[str, Any]:
        """States of the gas chambers and tanks by name, see `gas.contract.ChamberState`."""
        found: dict[str, Any] = {}
        for scalars in self.scalar_unknowns:
            found |= scalars.states()
        return found

    def chamber(self, name: str) -> Any:
        """State of the gas in one chamber or tank."""
        chambers = self.chambers
        known = ", ".join(chambers) or "none"
        check(
            name in chambers,
            f"The scene has no chamber '{name}'; its chambers and tanks are: {known}.",
        )
        return chambers[name]

    @property
    def items(self) -> list[object]:
        """The items of the scene that bring terms."""
        return [each.item for each in self._items]

    def block(self, body: Body) -> NumberedBlock:
        """The unknowns of a body in the numbering of the system."""
        return self._block_of[body]

    def terms_of(self, item: object) -> Sequence[Term]:
        """The terms that an item of the scene has brought; none if it is not in the scene."""
        return next((each.terms for each in self._items if each.item is item), ())

    # ---- the initial state -----------------------------------------------------------------------

    def initialise(self) -> None:
        """Set the initial state, with velocities of fixed coordinates zero, and set up the
        matrices, once scalar unknowns are attached, which begin with the volumes of this state.
        `InputError` if a constraint does not hold in it, or follows from others.  Collective."""
        self.initial.copy_to(self.q0, self.v0)
        self.v0.array[self.supports.at_rest] = 0
        self.supports.check_agreement(self.q0, self.time)
        if self.constraints:
            free = self.free_marks()
            # Constraints have to hold at the start: a step would close a gap with a jump.
            self.constraints.validate(self.q0, self.v0, free)
            # Multipliers of constraints between fixed points have no equation, and neither have
            # unknowns that complete a block of the matrix; they are held at zero.
            idle = self.constraints.idle(free, self.q0)
            everything = np.arange(self.numbering.size_local)
            self.supports.hold(np.union1d(idle, everything[self.numbering.unused]))
        self.q0.copy(self.previous)
        self.restart()
        if self.constraints and not self.rule.is_static and self._close_gaps():
            self.q0.copy(self.previous)
            self.restart()
        # Gas starts from the volumes of the initial state, which are known now.
        for scalars in self.scalar_unknowns:
            scalars.start()
            start = self.scalar_count
            self.scalar_count += scalars.size
            self._scalar_parts.append((scalars, slice(start, self.scalar_count)))
        self._build_matrices()

    def take_shape_history(self, other: System) -> None:
        """Take the history variables of items that are in another scene, too, from whose shape this
        one starts.  Kinds of terms that have them together are to have the same items.
        Collective."""
        pairs: list[tuple[HistoryVariables, HistoryVariables]] = []
        for each in self._items:
            # The other scene may lack the item.
            for term, before in zip(each.terms, other.terms_of(each.item), strict=False):
                sources = history_parts(before)
                parts = history_parts(term).items()
                pairs += [(part, sources[name]) for name, part in parts if name in sources]
        for compiled in self.compiled_as(HistoryVariables):
            kind = type(compiled)
            if self._items_of(kind) == other._items_of(kind):
                pairs += [(compiled, there) for there in other.compiled_as(kind)]
        taken = []
        for part, source in pairs:
            history = source.shape_history()
            if history is not None:
                taken.append((part, source, history))
        of_cells = False
        for part, source, _ in taken:
            there = source.cell_history()
            for name, (_, values) in part.cell_history().items():
                # An equilibrium has no strains of viscoelastic branches, which have relaxed.
                if name in there:
                    values[:] = there[name][1]
                    of_cells = True
        if of_cells:
            # Strains follow from temperatures.
            self.restart()
        for part, _, history in taken:
            part.set_history(history)
        if self.constraints and self.constraints.can_switch:
            # What latches hold now, the velocities have to fit.
            self.constraints.validate(self.q0, self.v0, self.free_marks())

    def _items_of(self, kind: type) -> list[int]:
        """The items whose terms a class compiles, by identity: an item for each of its terms."""
        return [
            id(each.item) for each in self._items for term in each.terms if term.compiler is kind
        ]

    def _close_gaps(self) -> bool:
        """Move the coordinates at the start by as little as closes the gaps that `validate` allows,
        and return whether there are any.  The first step of length h would close a gap d with the
        velocity 2d/h, and no later one would end it.  Collective."""
        assert self.constraints is not None, "the caller asks whether there are constraints"
        r = self.numbering.vector()
        self.constraints.add_forces(r)
        _, gap = self.imbalance(r)
        if gap <= GAP:
            return False
        # Least squares of the moves over the extent of the scene, and of those of directors.
        multipliers = self.constraints.owned
        weights = self.numbering.vector()
        of_vectors = np.where(self.position_marks, self.initial.extent() ** -2.0, 1.0)
        weights.array[: multipliers.start] = np.repeat(of_vectors, 3)
        A = self.numbering.matrix()
        self.constraints.add_tangents(A)
        A.setDiagonal(weights, addv=PETSc.InsertMode.ADD_VALUES)
        A.assemble()
        self.supports.clear(A, 1.0)
        r.array[self.supports.held] = 0.0
        move = self.numbering.vector()
        problem = factorisation.solve(A, r, move)
        if not problem:
            move.array[multipliers] = 0.0
            self.q0.axpy(-1.0, move)
        for thing in (r, weights, A, move):
            thing.destroy()
        return not problem

    def free_marks(self) -> PETSc.Vec:
        """A new vector with 0 at coordinates that are held, else 1."""
        free = self.numbering.vector()
        free.set(1.0)
        free.array[self.supports.held] = 0
        return free

    def restart(self) -> None:
        """Update all derived quantities from `previous` and q0, and their times, which the caller
        has set: histories and extrapolations follow from the last step.  q1 becomes equal to q0.
        Collective."""
        start = self.previous_time
        if self.rule.is_static:
            # The time of a pseudo-step is none at which loads were asked for.
            start = self.time
        for time, q in ((start, self.previous), (self.time, self.q0)):
            self._take_time(time)
            self.set_end(q)
            self._commit()

    def parameters_changed(self) -> None:
        """Assemble mass matrix, constant stiffness and loads again in place, whose coefficients of
        forms the caller has changed, and update what follows from coordinates, as strains.
        Collective."""
        for compiled in self.differentiable:
            compiled.parameters_changed()
        self.M.zeroEntries()
        for mass in self.compiled:
            mass.add_mass(self.M)
        self.M.assemble()
        self.increment.mass_changed()
        for compiled in self.differentiable:
            compiled.masses_changed()
        if self.K is not None:
            self.K.zeroEntries()
            for stiffness in self.compiled:
                stiffness.add_stiffness(self.K)
            self.K.assemble()
            # No step has an infinite c, so that the base is built at the next tangent.
            self._base_inertia = math.inf
        self.restart()

    def reverse_step(self, start: Array, rates: Array, t: float, end: Array) -> None:
        """Set the system to the present step run backwards in time, for gradients of a run.
        Collective.

        A step of length h from t - h to t becomes one of length -h from t to t - h.  Terms with
        active sets (contact) retain their pairs; most others start as from an accepted state
        (`CompiledTerms.exchange_ends`).  `start` and `rates` (n,) are this rank's coordinates [m]
        and velocities at time t [s], `end` the coordinates at t - h, multipliers included.  Totals
        of energies stay.
        """
        self.time = t
        self.v0.array[:] = rates
        self.q0.array[:] = start
        self.h = -self.h
        self._take_time(t)
        self.set_end(self.q0)
        for at in self.coordinates.values():
            at.q0.x.array[:] = at.q1.x.array
        for compiled in self.compiled:
            compiled.exchange_ends()
        for compiled in self.compiled:
            compiled.begin_step(t + self.rule.alpha * self.h)
        end_vector = self._scratch
        end_vector.array[:] = end
        self.set_end(end_vector)

    def extend_pattern(self, add_entries: Callable[[PETSc.Mat], None]) -> None:
        """Make all matrices again, with more entries in their pattern, which `add_entries` adds to
        a matrix as zeros, e.g. for a solver that stores more in a copy.  Collective."""
        # On several ranks PETSc would hold what Python drops.
        for matrix in (self.M, self.A, self.K, self._base):
            if matrix is not None:
                matrix.destroy()
        self._build_matrices(add_entries)

    def _build_matrices(self, add_entries: Callable[[PETSc.Mat], None] | None = None) -> None:
        """Make the mass matrix M [kg], the constant stiffness K [N/m] if there is one, and the
        tangent A, which is not assembled.  Collective.

        All have one pattern and are duplicates of one matrix: PETSc 3.22 multiplies those by BLAS,
        in half of the time of its kernel for blocks of three.  The pattern of A is fixed: an entry
        outside it raises an error of PETSc.
        """
        pattern = self.numbering.matrix()
        for compiled in self.compiled:
            compiled.add_mass(pattern)
        for compiled in self.compiled:
            compiled.add_stiffness(pattern)
        self._add_tangents(pattern)
        if add_entries is not None:
            add_entries(pattern)
        # All that rows of fixed coordinates keep is the diagonal.
        pattern.setDiagonal(self.numbering.vector(), addv=PETSc.InsertMode.ADD_VALUES)
        pattern.assemble()
        self.M = pattern.duplicate()
        self.A = pattern.duplicate()
        has_stiffness = any(compiled.has_constant_stiffness for compiled in self.compiled)
        self.K = pattern.duplicate() if has_stiffness else None
        # c M + α K, with the factor c [1/s²] of the inertia and the weight α [-] of the end of a
        # step in the point at which forces act: it is the same for all tangents of steps of one
        # length.
        self._base = pattern.duplicate() if has_stiffness else None
        self._base_inertia = 0.0
        self.numbering.fix_pattern(self.A)
        for compiled in self.compiled:
            compiled.add_mass(self.M)
        self.M.assemble()
        if self.K is not None:
            for compiled in self.compiled:
                compiled.add_stiffness(self.K)
            self.K.assemble()
        self.coupled_tangent = Tangent(self.A, self.active_sets)

    # ---- a step ----------------------------------------------------------------------------------

    def begin_step(self, h: float) -> Array:
        """Start a step of length h [s] from the accepted state (q0, v0), with a new search for
        active sets (contact pairs).  Returns the first guess of the scalar unknowns.  Collective.
        """
        self.h = h
        self.supports.check_turns(self.time, h)
        for active_set in self.active_sets:
            active_set.update_active_set()
        return self.begin_without_search(h)

    def begin_recorded_step(self, h: float, active_sets: Sequence[Any]) -> Array:
        """Start a step of length h [s] with recorded active sets of this rank, one for each kind of
        contact, instead of a search.  Returns the first guess of the scalar unknowns.  Collective.
        """
        self.h = h
        for compiled, saved in zip(self.active_sets, active_sets, strict=True):
            compiled.load_active_set(saved)
        return self.begin_without_search(h)

    def begin_without_search(self, h: float) -> Array:
        """Start a step of length h [s] with the present active sets.  Returns the first guess of
        the scalar unknowns.  Collective."""
        self.h = h
        t = self.time + self.rule.alpha * h
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
        return self.comm.allreduce(any(missed))

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
        self.c = c
        self.increment.set_inertia(c, offset)

    def predict(self, increment: PETSc.Vec) -> Array:
        """Choose p [m], from which w counts, by the stepper's increment [m] of the coordinates;
        returns w of this rank's fixed coordinates, in the order of `supports.held`.  Collective."""
        return self.increment.predict(increment, self.q0, self.time + self.h)

    def set_increment(self, w: PETSc.Vec, base: PETSc.Vec | None) -> None:
        """Set the coordinates at the end of the step, q1 = q0 + p + w, and the strains there.  They
        follow linearly from those of the last iterate, w = `base` [m]; without it they are the true
        ones. Collective."""
        self.increment.end(w, self.q0, self.q1)
        self._spread(self.q1, "q1")
        if base is not None:
            self._scratch.waxpy(-1.0, base, w)
            self._spread(self._scratch, "δ")
        for compiled in self._updated:
            compiled.update(base is not None)

    def set_end(self, q: PETSc.Vec) -> None:
        """Set q1 = q [m], with its true strains.  Collective."""
        q.copy(self.q1)
        self._spread(self.q1, "q1")
        for compiled in self._updated:
            compiled.update(False)

    def residual(self, y: Array, r: PETSc.Vec) -> Array:
        """Set r to the residual [N] of the coordinates at the present iterate, and return that of
        the scalar unknowns y (m,).  The rows of fixed coordinates go to `supports`, as reactions.
        Collective."""
        # First the gas: its pressure enters the forces on films.  s: residuals of scalar unknowns.
        s = np.zeros(self.scalar_count)
        for scalars, part in self._scalar_parts:
            s[part] = scalars.residual(y[part])
        self.increment.add_inertia(self.M, r)
        if self.K is not None:
            α = self.rule.alpha
            # K q_mid with q_mid = (1 - α) q0 + α q1, where α is the weight of the end of the step.
            self._scratch.waxpy((1 - α) / α, self.q0, self.q1)
            self._scratch.scale(α)
            self.K.multAdd(self._scratch, r, r)
        for compiled in self._acting:
            compiled.add_forces(r)
        for scalars in self.scalar_unknowns:
            scalars.add_force(r.array)
        # Last: the sum of all forces on fixed coordinates is the reaction of their supports.
        self.supports.take(r)
        return s

    def stored_forces(self) -> PETSc.Vec:
        """Derivatives ψ'(q0) [N] of all stored energies of bodies in the accepted state, as a new
        vector: [J] for directors, zero for multipliers.  Collective.

        They are the forces of a step that goes nowhere.  Contact is included, gas pressures and
        loads are not.  Two things are changed and stay so: q1 becomes q0, and the active pairs of
        contact become those with energy at q0.
        """
        out = self.numbering.vector()
        self.set_end(self.q0)
        # The active pairs are those of the last step: replace them by those of the present state.
        for active_set in self.active_sets:
            active_set.activate_present()
        if self.K is not None:
            self.K.mult(self.q0, out)
        for compiled in self.compiled:
            if not compiled.is_external_load and not isinstance(compiled, Multipliers):
                compiled.add_forces(out)
        return out

    def load_forces(self) -> PETSc.Vec:
        """Forces [N] of loads at the last residual, with the opposite sign; zero at fixed
        coordinates."""
        out = self.numbering.vector()
        for compiled in self.compiled:
            if compiled.is_external_load:
                compiled.add_forces(out)
        with out as values:
            values[self.supports.held] = 0.0
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
            values[self.supports.held] = self.supports.reactions
        return out

    def gyroscopic(self, spin: tuple[float, float, float]) -> PETSc.Mat:
        """A new matrix [kg/s] of the Coriolis force in a frame that turns with `spin` [rad/s].
        Collective."""
        G = self.A.duplicate()
        # The Coriolis force couples components that the tangent may not couple.
        G.setOption(PETSc.Mat.Option.NEW_NONZERO_LOCATION_ERR, False)
        for compiled in self.compiled:
            compiled.add_gyroscopic(G, spin)
        G.assemble()
        return G

    def tangent(self) -> PETSc.Mat:
        """The sum of `assemble_tangent` as one matrix [N/m]: A itself, which the next assembly
        overwrites, or a new matrix if pairs of contact are active.  Collective."""
        return self.assemble_tangent().whole()

    def assemble_tangent(self) -> Tangent:
        """Derivative [N/m] of the residual of the coordinates by q1, at the last residual: c M + α
        K and the tangents of all terms, in a matrix of fixed pattern, and coupling matrices of
        contact pairs.

        Rows and columns of fixed coordinates are those of the unit matrix.  The object is the same
        in every call, and is overwritten by the next one.  Collective.
        """
        if self._base is None:
            # Without constant stiffness the base would be a copy of c M.
            self.M.copy(self.A, SAME_PATTERN)
            self.A.scale(self.c)
        else:
            # c changes with the length of the step only.
            if self._base_inertia != self.c:
                self.M.copy(self._base, SAME_PATTERN)
                self._base.scale(self.c)
                self._base.axpy(self.rule.alpha, self.K, SAME_PATTERN)
                self._base_inertia = self.c
            self._base.copy(self.A, SAME_PATTERN)
        self._add_tangents(self.A)
        self.A.assemble()
        # Rows and columns of fixed coordinates are those of the unit matrix.
        self.supports.clear(self.A, 1.0)
        self.coupled_tangent.fetch_couplings()
        return self.coupled_tangent

    def coupling(self) -> tuple[list[Array | None], list[Array | None], Array]:
        """Coupling of all m scalar unknowns y, such as gas pressures, with the coordinates in the
        tangent: this rank's parts (n,) of the m columns ∂r/∂y and of the m rows ∂s/∂q1, None where
        zero, with zeros at fixed coordinates; and ∂s/∂y (m, m), of residuals r and s."""
        columns: list[Array | None] = []
        rows: list[Array | None] = []
        corner = np.zeros((self.scalar_count, self.scalar_count))
        for scalars, part in self._scalar_parts:
            own_columns, own_rows, corner[part, part] = scalars.coupling()
            columns += own_columns
            rows += own_rows
        for vector in columns + rows:
            if vector is not None:
                vector[self.supports.held] = 0
        return columns, rows, corner

    def commit(self, v1: PETSc.Vec) -> None:
        """Accept the step: its end is the state now, and its works and losses [J] are added to the
        totals. The step must have been solved: nothing is checked here.  Collective."""
        change = self.q1.array_r - self.q0.array_r
        self.supplied_energy += self.supports.work(change)
        self.supplied_energy += sum(compiled.supplied() for compiled in self.compiled)
        for compiled in self.compiled:
            for name, loss in zip(compiled.losses, compiled.dissipated(), strict=True):
                self.losses[name] += float(loss)
        for scalars in self.scalar_unknowns:
            scalars.commit()
        # Before q0 changes: the remainder of the sum q0 + p + w is needed.
        self.increment.commit(self.q0, self.q1)
        self.q0.copy(self.previous)
        self.q1.copy(self.q0)
        v1.copy(self.v0)
        if self.constraints:
            # Multipliers have no rate.
            self.v0.array[self.constraints.owned] = 0
        self._commit()
        self.previous_time = self.time
        self.time += self.h
        self.restored_resultants = None
        for recorder in self.recorders:
            recorder()

    def restore(self, q: Array, v: Array, t: float) -> None:
        """Set an earlier accepted state of this rank's coordinates q, with multipliers, and
        velocities v (n,) at a time [s]: q0, q1 and `previous` become q.  History variables are set
        by the caller (`Differentiable.load_history`); totals of energies do not change.
        Collective."""
        # On several ranks PETSc keeps what was dropped in the step that was restored before this.
        PETSc.garbage_cleanup(self.comm)
        self.time = t
        self.previous_time = t
        self.v0.array[:] = v
        self.q0.array[:] = q
        self.q0.copy(self.previous)
        self._take_time(t)
        self.set_end(self.q0)
        self._commit()

    def _take_time(self, t: float) -> None:
        """Give the time t [s] of the state that follows to terms that depend on it."""
        for compiled in self.compiled:
            compiled.take_time(t)

    def _commit(self) -> None:
        """Make q1 and its strains the start of the next step."""
        for at in self.coordinates.values():
            at.q0.x.array[:] = at.q1.x.array
        for compiled in self.compiled:
            compiled.commit()

    # ---- the energy balance ----------------------------------------------------------------------

    def totals(self) -> Totals:
        """Energies and momenta of the accepted state, and what was supplied and lost since the
        start; the same on every rank.  Collective."""
        self.M.mult(self.v0, self._momenta)
        # Momenta p and coordinates q of this rank's vectors, (n, 3); qp is the matrix Σ q_i p_j.
        size = 3 * len(self.position_marks)  # without multipliers
        p = self._momenta.array_r[:size].reshape(-1, 3)
        q = self.q0.array_r[:size].reshape(-1, 3)
        qp = q.T @ p
        # Sums over positions; the moment is summed over directors, too.
        momenta = np.stack([self.position_marks @ p, qp[NEXT, LAST] - qp[LAST, NEXT]])
        for compiled in self.compiled:
            momenta += compiled.momenta()
        stored: dict[str, float] = {}
        for compiled in self.compiled:
            for name, energy in compiled.energies().items():
                stored[name] = stored.get(name, 0.0) + energy
        kinetic = self.v0.array_r @ self._momenta.array_r / 2

        # One message for all sums over the ranks.
        local = [kinetic, self.supplied_energy, *momenta.ravel(), *stored.values()]
        sums = self.comm.allreduce(np.array([*local, *self.losses.values()])).tolist()
        kinetic, supplied = sums[:2]
        linear, angular = np.array(sums[2:8]).reshape(2, 3)
        first_loss = 8 + len(stored)
        stored = dict(zip(stored, sums[8:first_loss], strict=True))
        losses = dict(zip(self.losses, sums[first_loss:], strict=True))

        mass = 0.0
        mass_supplied = 0.0
        for scalars in self.scalar_unknowns:
            share = scalars.totals()
            stored |= share.stored
            supplied += share.supplied
            mass += share.mass
            mass_supplied += share.mass_supplied
        return Totals(
            time=self.time,
            kinetic=kinetic,
            stored=stored,
            supplied=supplied,
            losses=losses,
            momentum=linear,
            angular_momentum=angular,
            mass=mass,
            mass_supplied=mass_supplied,
        )

    def resultants(self) -> dict[str, Array]:
        """Force [N] and torque about the origin [N m], (2, 3), of each load over the last step, by
        its name; the same on every rank.  Collective."""
        if self.restored_resultants is not None:
            return self.restored_resultants
        total: dict[str, Array] = {}
        own: dict[str, Array] = {}
        for compiled in self.compiled:
            for name, value in compiled.resultants().items():
                own[name] = own.get(name, 0.0) + value
        # A load on a point is known to one rank only.
        for of_rank in self.comm.allgather(own):
            for name, value in of_rank.items():
                total[name] = total.get(name, 0.0) + value
        return total

    # ---- the residual, for solvers ---------------------------------------------------------------

    def force_scales(self, diagonal: PETSc.Vec) -> tuple[float, Array]:
        """Norms [N] of the forces that cancel in the last residual, the scale of its round-off,
        from the diagonal of the tangent: of all of them, and of those of each body (bodies,), none
        in scenes of one body and in statics.  Collective."""
        squares = self.increment.cancelling_squares(self.M, diagonal, self.q1)
        own = [squares.sum()]
        if len(self.bodies) > 1 and not self.rule.is_static:
            own += self._body_sums(squares)
        # Forces of gas may act on any body.
        of_scalars = sum([scalars.force_square() for scalars in self.scalar_unknowns])
        own_squares = np.array(own) + of_scalars
        # With contact this is asked in each iteration, and one rank has nothing to send.
        if self.comm.size > 1:
            own_squares = self.comm.allreduce(own_squares)
        norms = np.sqrt(own_squares)
        return float(norms[0]), norms[1:]

    def body_imbalances(self, r: PETSc.Vec) -> Array:
        """Norms (bodies,) of the forces of each body in a residual [N].  Collective."""
        return np.sqrt(self.comm.allreduce(np.array(self._body_sums(r.array_r**2))))

    def _body_sums(self, values: Array) -> list[float]:
        """Sums over the unknowns of each body that this rank has."""
        return [values[self.block(body).owned].sum() for body in self.bodies]

    def kinetic_energy_of_step(self) -> float:
        """Kinetic energy [J] at the mean velocity of the step, (q1 - q0)/h.  Collective."""
        increment = self.increment.total()
        self.M.mult(increment, self._momenta)
        return float(increment.dot(self._momenta)) / (2 * self.h**2)

    def round_off_energy(self, diagonal: PETSc.Vec) -> float:
        """Energy [J] that round-off gives to a scene at rest; the diagonal is that of the
        tangent."""
        return self.increment.round_off_energy(self.M, diagonal, self.q1)

    def imbalance(self, r: PETSc.Vec) -> tuple[float, float]:
        """Norm of the forces in a residual [N], and the largest violation of a constraint, over its
        size in the scene, the same on every rank.  Collective."""
        if self.constraints is None:
            return float(r.norm()), 0.0
        values = r.array_r
        multipliers = self.constraints.owned
        forces = values[: multipliers.start]
        squares = float(forces @ forces)
        violations = np.abs(values[multipliers]) / self.constraints.sizes
        worst = float(violations.max(initial=0.0))
        if self.comm.size > 1:
            squares = self.comm.allreduce(squares)
            worst = self.comm.allreduce(worst, op=MPI.MAX)
        return squares**0.5, worst

    def locate(self, r: PETSc.Vec) -> str:
        """Where the forces of a residual are largest, in words, e.g. "'film' at the node (0, 0, 1)
        m of the mesh".  Collective, the same on every rank."""
        values = abs(r.array_r[: 3 * len(self.position_marks)])  # without multipliers
        i = int(values.argmax()) if values.size else -1
        largest = float(values[i]) if i >= 0 else -1.0
        words = ""
        for body in self.bodies:
            owned = self.block(body).owned
            if owned.start <= i < owned.stop:
                words = f"'{body.name}' {body.describe((i - owned.start) // body.block.size)}"
        # The rank with the largest entry names it, the others receive the words.
        _, rank = max(self.comm.allgather((largest, self.comm.rank)))
        return str(self.comm.bcast(words, root=rank))

    # ---- forms -----------------------------------------------------------------------------------

    def tangent_forms(self, body: Body) -> list[fem.Form]:
        """Compiled bilinear forms that add up to the tangent of a body on a mesh, of all terms."""
        return [form for compiled in self._with_forms for form in compiled.tangent_forms(body)]

    def _add_tangents(self, A: PETSc.Mat) -> None:
        """Add to A the tangents of forms on meshes, of terms with arrays, and of scalar
        unknowns."""
        for body, at in self.coordinates.items():
            at.assemble(A, self.tangent_forms(body), self._block_of[body])
        for compiled in self._with_tangents:
            compiled.add_tangents(A)
        for scalars in self.scalar_unknowns:
            scalars.add_tangents(A)

    def _spread(self, z: PETSc.Vec, name: str) -> None:
        """Copy a vector to the function `name`, "q1" or "δ", of the coordinates of each body on a
        mesh, ghosts included."""
        values = z.array_r
        for body, at in self.coordinates.items():
            at.take(getattr(at, name), values[self._block_of[body].owned])
