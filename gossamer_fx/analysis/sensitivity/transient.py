"""Gradients of results at the end of a run, by one pass backwards through its steps.

Each step is repeated from the tape, its tangent factorised once, and one transposed system solved,
whatever the number of parameters; `sensitivity.backward` has the equations.

How long a gradient means anything.  Where films flutter or touch, neighbouring motions separate
exponentially.  The derivative is exact all the same, but it predicts finite changes only as long as
their amplified size stays small.  The backward pass measures that: the norm of dJ/dv grows with it.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence

import numpy as np

from gossamer_fx.analysis.sensitivity.backward import BackwardSteps
from gossamer_fx.analysis.sensitivity.objectives import CrossingTime, Energy, SceneView
from gossamer_fx.analysis.sensitivity.results import Gradient, collected
from gossamer_fx.analysis.sensitivity.tape import RecordedState, RunTape
from gossamer_fx.analysis.sensitivity.variables import (
    SHAPE,
    AdjointFields,
    FormDerivative,
    FormVariable,
    InitialVariable,
    PointVariable,
    find_variables,
)
from gossamer_fx.core.checks.errors import check
from gossamer_fx.mechanics.terms.element_energies import ElementEnergies
from gossamer_fx.records.probes.objective import Objective
from gossamer_fx.records.probes.points import Position

LOGGER = logging.getLogger("gossamer_fx")

# Growth of the adjoint over a run from which a warning is given.  A free motion lets it grow
# linearly with time, which is a factor of 4 by the measure of `growth_of`.
GROWTH_TO_WARN_OF = 1e3


class TransientGradients:
    """Gradients of results at the end of a recorded run, which stands at its last step."""

    def __init__(self, tape: RunTape, by: Sequence[str]) -> None:
        system = tape.system
        check(
            tape.steps > 0,
            "gradient: the tape has no step; make it before run.run().",
        )
        self._tape = tape
        self._system = system
        self._adjoint = AdjointFields(system)
        self.steps = BackwardSteps(tape)
        self.variables = find_variables(
            system, by, self._adjoint, in_time=True, scalars=self.steps.scalars.parts
        )
        # Adjoint of the state after the present step: derivatives of the result by it.
        self._by_position = system.unknowns.numbering.vector()
        self._by_velocity = system.unknowns.numbering.vector()
        # Norms of dJ/dv at the ends of the steps and at the start, the last step first.
        self.norms: list[float] = []

    def of(self, objective: Objective) -> Gradient:
        """The gradient of one result at the last step of the tape, or of a `CrossingTime`; the
        system is as before afterwards.  Collective."""
        system = self._system
        present = self._tape.history.save()
        try:
            value, duration = self._sum_up(objective)
            notes = self._notes_on_the_start()
        finally:
            # Also where a step cannot be repeated: the run goes on from here.
            self._tape.history.restore(present)
        growth = growth_of(self.norms)
        self._warn(growth, duration)
        for compiled in system.equations.differentiable:
            notes += compiled.gradient_notes()
        return collected(
            value=value,
            unit=objective.unit,
            variables=self.variables,
            comm=system.comm,
            growth=growth,
            notes=notes,
        )

    def _notes_on_the_start(self) -> list[str]:
        """One sentence for each film whose motion and shape results have no derivative by, as it
        starts without strain; the system stands at the start.  Collective."""
        names = [
            variable.name
            for variable in self.variables
            if variable.name.endswith(f".{SHAPE}") or isinstance(variable, InitialVariable)
        ]
        if not names:
            return []
        return [
            f"'{film}' has points without strain at the start, between taut and slack, where its "
            f"stress has a kink: by {', '.join(names)} the gradient is that of one side, as long "
            "as the film is not strained"
            for compiled in self._system.equations.compiled_as(ElementEnergies)
            for film in compiled.unstrained_films()
        ]

    def _sum_up(self, objective: Objective) -> tuple[float, float]:
        """Go backwards through the steps, and add up the derivatives of a result by the variables.
        Returns its value and how long the steps take together [s].  Collective."""
        value, observed, shares = self._observed(objective)
        for variable in self.variables:
            variable.start()
        self.steps.start()
        self._by_position.set(0.0)
        self._by_velocity.set(0.0)
        last = max(shares)
        duration = 0.0
        for start, end in self._tape.backwards(last):
            if end.index == last:
                self._add_result(observed, end, shares[last])
                self.norms = [float(self._by_velocity.norm())]
            duration += end.h
            self.steps.solve(start, end, self._by_position, self._by_velocity)
            self._adjoint.set(self.steps.μ)
            self._adjoint.set_inertia(self.steps.inertia)
            for variable in self.variables:
                variable.add_residual(self.steps.μ, with_inertia=True)
            self.steps.carry(start, end, self._by_position, self._by_velocity)
            if start.index in shares:
                self._add_result(observed, start, shares[start.index])
            self.norms.append(float(self._by_velocity.norm()))
        self._finish_at_start(observed, sum(shares.values()))
        self._add_masses()
        for variable in self.variables:
            variable.add_start(self._by_position, self._by_velocity)
        return value, duration

    def _observed(self, objective: Objective) -> tuple[float, Objective, dict[int, float]]:
        """The value of a result; the result that is observed in states of the tape; and the
        derivative of the value by the observed result, by the number of the state."""
        view = SceneView(self._system)
        if not isinstance(objective, CrossingTime):
            return objective(view), objective, {self._tape.steps: 1.0}
        times = []
        values = []
        for state in self._tape.forwards():
            self._tape.restore(state)
            times.append(state.time)
            values.append(objective.of(view))
            # States after the first crossing do not count.
            if objective.has_passed(values):
                break
        value, shares = objective.found(times, values)
        return value, objective.of, shares

    def _finish_at_start(self, observed: Objective, share: float) -> None:
        """Add what the initial state gives in another way than through the steps; the system then
        stands at it.  `share` is the derivative of the value by all that is observed."""
        system = self._system
        self._tape.restore(self._tape.states[0])
        if isinstance(observed, Position):
            observed.add_initial_derivative(system, share, self._by_position)
        for compiled in system.equations.differentiable:
            compiled.add_initial_derivatives(self._by_position)
        scalars = self.steps.scalars
        if scalars.size:
            with self._by_position as by_position:
                scalars.finish(by_position)
        self.steps.clear(self._by_position)

    def _add_result(self, objective: Objective, state: RecordedState, share: float) -> None:
        """Add a share of the derivatives of a result in a state, also those by parameters.
        Collective."""
        system = self._system
        self._tape.restore(state)
        result_by_position = system.unknowns.numbering.vector()
        result_by_velocity = system.unknowns.numbering.vector()
        objective.add_derivative(system, result_by_position, result_by_velocity)
        self.steps.clear(result_by_position)
        self.steps.clear(result_by_velocity)
        self._by_position.axpy(share, result_by_position)
        self._by_velocity.axpy(share, result_by_velocity)
        scalars = self.steps.scalars
        if scalars.size:
            by_scalars = np.zeros(scalars.size)
            objective.add_scalar_derivative(system, by_scalars)
            scalars.c += share * by_scalars
        forms = objective.forms(system)
        for variable in self.variables:
            if isinstance(variable, FormVariable):
                for coefficient in variable.coefficients:
                    variable.sum += share * FormDerivative(forms, coefficient).assemble()
            if isinstance(objective, Energy):
                self._add_energy(variable, share)
        if isinstance(objective, Energy):
            for part in scalars.parts:
                part.add_energy_derivative(share)
            self.steps.add_energy_by_history(share)

    def _add_energy(self, variable: object, share: float) -> None:
        """Add the part of the derivative of the energy that is not in its forms: of energies
        between points, and of kinetic energy by masses."""
        system = self._system
        if isinstance(variable, PointVariable):
            variable.sum += share * variable.energy_derivative()
        elif isinstance(variable, FormVariable):
            # ½ v·∂M v, by the forms of the inertia with the velocity in place of both vectors.
            self._adjoint.set(system.unknowns.v0)
            self._adjoint.set_inertia(system.unknowns.v0)
            variable.sum += share * variable.inertia_derivative() / 2

    def _add_masses(self) -> None:
        """Add what forces that depend on the masses of bodies give for densities and thicknesses.
        The mass of a body is v·M v of the unit velocity v along x."""
        system = self._system
        for compiled in system.equations.differentiable:
            for body, by_mass in compiled.derivatives_by_mass().items():
                unit = system.unknowns.numbering.vector()
                rows = unit.array[system.unknowns.block(body).owned].reshape(-1, body.block.size)
                rows[:, 0] = 1.0
                self._adjoint.set(unit)
                self._adjoint.set_inertia(unit)
                for variable in self.variables:
                    if isinstance(variable, FormVariable):
                        variable.sum += by_mass * variable.inertia_derivative()

    def _warn(self, growth: float, duration: float) -> None:
        """Log for how long the gradient predicts finite changes, if that is shorter than the run
        [s]."""
        if growth < GROWTH_TO_WARN_OF:
            return
        rate = math.log(growth) / duration
        if self._system.comm.rank == 0:
            LOGGER.warning(
                "gradient: changes of the motion grow by a factor of %.1e in this run, "
                "as exp(%.3g t); a relative change of 1e-4 is predicted for about %.3g s",
                growth,
                rate,
                math.log(1e4) / rate,
            )


def growth_of(norms: Sequence[float]) -> float:
    """Growth of the adjoint over a run from its norms, last step first, as a factor: the square of
    that over the earlier half of the run, so that a linear growth, which predicts finite changes
    well, counts as 4.  It is 1 for fewer than three norms, or if that in the middle is zero."""
    middle = norms[len(norms) // 2]
    if len(norms) < 3 or middle == 0:
        return 1.0
    return float(np.square(norms[-1] / middle))
