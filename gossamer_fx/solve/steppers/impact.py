"""Plastic impacts: velocities jump where a constraint begins to hold.

The velocities v⁺ behind the impact are those nearest to v⁻, in the metric of the mass, that keep
all constraints e = 0:

    M (v⁺ - v⁻) + Deᵀ Λ = 0,    De v⁺ = 0

The impulses Λ act along gradients of the constraints, so that momentum and angular momentum stay as
they are.  The loss is the kinetic energy of the jump, ½ (v⁺ - v⁻)·M (v⁺ - v⁻).  The velocities of
supports do not change; the work of those that move counts as supplied.
"""

from __future__ import annotations

import gossamer_fx.solve.solvers.factorisation as factorisation
from gossamer_fx.core.checks.errors import check
from gossamer_fx.solve.system.system import System


def switch_constraints(system: System) -> bool:
    """Engage and release the constraints of which that is wanted; whether velocities have changed.

    `InputError`: a latch would hold what is held already, or something that moves has no mass.
    Collective.
    """
    assert system.constraints is not None, "the caller asks whether constraints can switch"
    has_changed = False
    # One after the other, so that each has a loss.
    for name in system.constraints.switch():
        system.losses[name] += _project_velocities(system, name)
        has_changed = True
    return has_changed


def _project_velocities(system: System, name: str) -> float:
    """Project the velocities onto the constraints; returns this rank's share of the loss [J].
    Collective."""
    constraints = system.constraints
    assert constraints is not None
    multipliers = constraints.owned
    # Without multipliers the tangent of the constraints is De and its transpose.
    q = system.q0.copy()
    q.array[multipliers] = 0.0
    system.set_end(q)
    A = system.M.copy()
    constraints.add_tangents(A)
    A.assemble()
    system.set_end(system.q0)
    # A v⁻ has De v⁻ in the rows of the multipliers.
    right = A.createVecLeft()
    A.mult(system.v0, right)
    right.scale(-1.0)
    with right as values:
        values[: multipliers.start] = 0.0
        values[system.supports.held] = 0.0
    reduced = A.copy()
    system.supports.clear(reduced, 1.0)
    jump = A.createVecRight()
    problem = factorisation.solve(reduced, right, jump)
    check(
        not problem,
        f"'{name}' cannot be engaged: the velocities behind the impact are not determined "
        f"({problem}); give all that moves mass.",
    )
    # The impulses on held coordinates.
    A.mult(jump, right)
    held = system.supports.held
    system.supplied_energy += float(system.v0.array_r[held] @ right.array_r[held])
    jump.array[multipliers] = 0.0
    system.v0.axpy(1.0, jump)
    system.M.mult(jump, right)
    loss = float(jump.array_r @ right.array_r) / 2
    for thing in (q, A, reduced, right, jump):
        thing.destroy()
    return loss
