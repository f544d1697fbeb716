"""How a compiled scene takes its initial state, or the history of the scene that was before."""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

import gossamer_fx.solve.solvers.factorisation as factorisation
from gossamer_fx.mechanics.terms.assembly import HistoryVariables, Multipliers, history_parts
from gossamer_fx.solve.system.equations import Equations
from gossamer_fx.solve.system.residual_sizes import out_of_balance
from gossamer_fx.solve.system.system import System
from gossamer_fx.solve.system.unknowns import Unknowns

# Gaps of constraints at the start, over their size, that are above round-off.
GAP = 1e-14


def initialise(system: System) -> None:
    """Set the initial state, with velocities of fixed coordinates zero, and make the matrices, once
    scalar unknowns are attached, which begin with the volumes of this state.  `InputError` if a
    constraint does not hold in it, or follows from others.  Collective."""
    unknowns = system.unknowns
    constraints = system.equations.constraints
    unknowns.initial.copy_to(unknowns.q0, unknowns.v0)
    unknowns.v0.array[unknowns.supports.at_rest] = 0
    unknowns.supports.check_agreement(unknowns.q0, unknowns.time)
    if constraints:
        free = unknowns.free_marks()
        # Constraints have to hold at the start: a step would close a gap with a jump.
        constraints.validate(unknowns.q0, unknowns.v0, free)
        # Multipliers of constraints between fixed points have no equation, and neither have
        # unknowns that complete a block of the matrix; they are held at zero.
        idle = constraints.idle(free, unknowns.q0)
        everything = np.arange(unknowns.numbering.size_local)
        unknowns.supports.hold(np.union1d(idle, everything[unknowns.numbering.unused]))
    unknowns.q0.copy(unknowns.previous)
    system.restart()
    is_dynamic = not unknowns.rule.is_static
    if constraints and is_dynamic and _close_gaps(unknowns, system.equations, constraints):
        unknowns.q0.copy(unknowns.previous)
        system.restart()
    # Gas starts from the volumes of the initial state, which are known now.
    for scalars in system.equations.scalar_unknowns:
        scalars.start()
        system.matrices.add_scalars(scalars)
    system.matrices.build()


def _close_gaps(unknowns: Unknowns, equations: Equations, constraints: Multipliers) -> bool:
    """Move the coordinates at the start by as little as closes the gaps that `validate` allows, and
    return whether there are any.  The first step of length h would close a gap d with the velocity
    2d/h, and no later one would end it.  Collective."""
    r = unknowns.numbering.vector()
    constraints.add_forces(r)
    _, gap = out_of_balance(equations, r)
    if gap <= GAP:
        return False
    # Least squares of the moves over the extent of the scene, and of those of directors.
    multipliers = constraints.owned
    weights = unknowns.numbering.vector()
    of_vectors = np.where(unknowns.position_marks, unknowns.initial.extent() ** -2.0, 1.0)
    weights.array[: multipliers.start] = np.repeat(of_vectors, 3)
    A = unknowns.numbering.matrix()
    constraints.add_tangents(A)
    A.setDiagonal(weights, addv=PETSc.InsertMode.ADD_VALUES)
    A.assemble()
    unknowns.supports.clear(A, 1.0)
    r.array[unknowns.supports.held] = 0.0
    move = unknowns.numbering.vector()
    problem = factorisation.solve(A, r, move)
    if not problem:
        move.array[multipliers] = 0.0
        unknowns.q0.axpy(-1.0, move)
    for thing in (r, weights, A, move):
        thing.destroy()
    return not problem


def take_shape_history(system: System, other: System) -> None:
    """Take the history variables of items that are in another scene, too, from whose shape this one
    starts.  Kinds of terms that have them together are to have the same items.  Collective."""
    pairs: list[tuple[HistoryVariables, HistoryVariables]] = []
    for each in system.unknowns.items_with_terms:
        # The other scene may lack the item.
        for term, before in zip(each.terms, other.unknowns.terms_of(each.item), strict=False):
            sources = history_parts(before)
            parts = history_parts(term).items()
            pairs += [(part, sources[name]) for name, part in parts if name in sources]
    for compiled in system.equations.compiled_as(HistoryVariables):
        kind = type(compiled)
        if _items_of(system, kind) == _items_of(other, kind):
            pairs += [(compiled, there) for there in other.equations.compiled_as(kind)]
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
        system.restart()
    for part, _, history in taken:
        part.set_history(history)
    constraints = system.equations.constraints
    if constraints and constraints.can_switch:
        # What latches hold now, the velocities have to fit.
        unknowns = system.unknowns
        constraints.validate(unknowns.q0, unknowns.v0, unknowns.free_marks())


def _items_of(system: System, kind: type) -> list[int]:
    """The items whose terms a class compiles, by identity: an item for each of its terms."""
    return [
        id(each.item)
        for each in system.unknowns.items_with_terms
        for term in each.terms
        if term.compiler is kind
    ]
