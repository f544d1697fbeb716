"""A compiled scene: its unknowns, equations, matrices and balance, and how its state changes."""

from __future__ import annotations

from collections.abc import Sequence

from petsc4py import PETSc

from gossamer_fx.core.model.body import Array
from gossamer_fx.core.model.state import InitialState
from gossamer_fx.mechanics.terms.assembly import ItemTerms
from gossamer_fx.mechanics.terms.discrete_gradient import StressRule
from gossamer_fx.solve.system.energy_balance import EnergyBalance
from gossamer_fx.solve.system.equations import Equations
from gossamer_fx.solve.system.unknowns import Unknowns


class System:
    """A scene that is compiled for one stress rule.

    Args:
        start: the initial state, with initial conditions applied.
        items: those of the scene with their terms.
        rule: the stress rule.

    Attributes:
        comm: communicator of the scene.
        unknowns: coordinates and velocities, their numbering, and supports.
        equations: the compiled terms, and the residual of a step.
        matrices: derivatives of the residual.
        balance: energies, momenta, supplies and losses.
    """

    def __init__(self, start: InitialState, items: Sequence[ItemTerms], rule: StressRule) -> None:
        self.comm = start.comm
        self.unknowns = Unknowns(start, items, rule)
        self.equations = Equations(self.unknowns)
        self.matrices = self.equations.matrices
        self.balance = EnergyBalance(self.unknowns, self.equations)

    def commit(self, v1: PETSc.Vec) -> None:
        """Accept the step, with the velocities v1 [m/s] at its end, which is the state now; its
        works and losses [J] are added to the balance.  The step must have been solved: nothing is
        checked here.  Collective."""
        self.balance.add_step()
        for scalars in self.equations.scalar_unknowns:
            scalars.commit()
        self.unknowns.accept(v1)
        constraints = self.equations.constraints
        if constraints:
            # Multipliers have no rate.
            self.unknowns.v0.array[constraints.owned] = 0
        self.equations.begin_next()

    def restart(self) -> None:
        """Update all derived quantities from `previous` and q0, and their times, which the caller
        has set: histories and extrapolations follow from the last step.  q1 becomes equal to q0.
        Collective."""
        unknowns = self.unknowns
        start = unknowns.previous_time
        if unknowns.rule.is_static:
            # The time of a pseudo-step is none at which loads were asked for.
            start = unknowns.time
        self.equations.start_from(unknowns.previous, start)
        self.equations.start_from(unknowns.q0, unknowns.time)

    def reverse_step(self, start: Array, rates: Array, t: float, end: Array) -> None:
        """Set the system to the present step run backwards in time, for gradients of a run.
        Collective.

        A step of length h from t - h to t becomes one of length -h from t to t - h.  Terms with
        active sets (contact) retain their pairs; most others start as from an accepted state
        (`CompiledTerms.exchange_ends`).  `start` and `rates` (n,) are this rank's coordinates [m]
        and velocities at time t [s], `end` the coordinates at t - h, multipliers included.  Totals
        of energies stay.
        """
        unknowns = self.unknowns
        unknowns.time = t
        unknowns.v0.array[:] = rates
        unknowns.q0.array[:] = start
        unknowns.h = -unknowns.h
        self.equations.take_time(t)
        self.equations.set_end(unknowns.q0)
        unknowns.begin_next()
        for compiled in self.equations.compiled:
            compiled.exchange_ends()
        for compiled in self.equations.compiled:
            compiled.begin_step(t + unknowns.rule.alpha * unknowns.h)
        unknowns.q1.array[:] = end
        self.equations.set_end(unknowns.q1)

    def parameters_changed(self) -> None:
        """Assemble mass matrix, constant stiffness and loads again in place, whose coefficients of
        forms the caller has changed, and update what follows from coordinates, as strains.
        Collective."""
        differentiable = self.equations.differentiable
        for compiled in differentiable:
            compiled.parameters_changed()
        self.matrices.assemble_again()
        for compiled in differentiable:
            compiled.masses_changed()
        self.restart()
