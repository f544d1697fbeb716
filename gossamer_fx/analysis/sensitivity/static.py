"""Gradients at a static equilibrium r(q, θ) = 0, by one transposed solve.

    Kᵀ λ = ∂J/∂q,    dJ/dθ = ∂J/∂θ - λ·∂r/∂θ                                                    (1)

K is the tangent of the equilibrium, which is factorised once, whatever the number of parameters.
Where it is singular, see `sensitivity.static_solver`.

Closed gas is a function of its volume, dp = -κ g·dq with the gradient g of the volume.  K then has
the stiffness κ g⊗g in addition, by the formula of Sherman, Morrison and Woodbury, and a result that
depends on pressures the derivative -κ ∂J/∂p g.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.analysis.sensitivity.along_shape import StiffnessAlong
from gossamer_fx.analysis.sensitivity.objectives import Energy, add_gas_pressures
from gossamer_fx.analysis.sensitivity.results import Gradient, collected
from gossamer_fx.analysis.sensitivity.static_solver import StaticSolver
from gossamer_fx.analysis.sensitivity.variables import (
    SHAPE,
    AdjointFields,
    FormDerivative,
    FormVariable,
    PointVariable,
    find_variables,
)
from gossamer_fx.core.checks.arguments import Direction, check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array, Port, Vector
from gossamer_fx.records.probes.objective import ForceObjective, Objective
from gossamer_fx.records.probes.points import AXES, Position
from gossamer_fx.solve.system.system import System
from gossamer_fx.solve.view import Sought

# Work of a change of a parameter on a free motion, over that of its parts with random signs, up to
# which it is round-off.
UNBALANCED = 1e-6


@check_arguments
def point_stiffness(
    equilibrium: Sought, port: Port, *, direction: Direction = (0.0, 0.0, 1.0)
) -> float:
    """Stiffness dF/du [N/m] of a point about an equilibrium, by its tangent.  Collective.

    A small force along the direction moves the point along it by u; the point is free to move
    across it, too.  With the row w by which the unknowns give u, dF/du = 1/(w·K⁻¹w).  Closed gas
    adds its stiffness.

    Args:
        equilibrium: an `Equilibrium` of which `find` was called.
        port: the point, e.g. the tip of a boom.
        direction: of force and displacement; its length does not matter.

    Returns:
        The stiffness [N/m]; infinite where the point is fixed, negative beyond a limit point.

    Raises:
        InputError: no equilibrium was found, the direction is zero, the scene has gas with
            openings, or nothing resists the force, as in a scene without supports.

    Example:
        >>> top = gx.Ground((0.0, 0.0, 0.0))
        >>> spring = gx.connectors.Spring(mass.port(), top, stiffness=100.0, length=0.9)
        >>> equilibrium = gx.Equilibrium(
        ...     gx.Scene(mass, spring, gx.Gravity(mass, (0.0, 0.0, -10.0)))
        ... )
        >>> result = equilibrium.find()
        >>> along = gx.analysis.point_stiffness(equilibrium, mass.port())
        >>> across = gx.analysis.point_stiffness(equilibrium, mass.port(), direction=(1, 0, 0))
        >>> f"{along:.3f}, {across:.3f} N/m"
        '100.000, 10.000 N/m'
    """
    return PointStiffness(equilibrium, port, direction=direction)(equilibrium)


@check_arguments
class PointStiffness(Objective):
    """Stiffness dF/du [N/m] of a point about an equilibrium, as a result with derivatives; see
    `point_stiffness`.

    With the displacements u under a unit force, dF/du = k = 1/(w·u) and ∂k = k² u·∂K u.

    Args:
        equilibrium: of a scene without contact and gas.
        port: the point, e.g. the tip of a boom.
        direction: of force and displacement; its length does not matter.

    Raises:
        InputError: as `point_stiffness`; when derived: the scene has contact or gas, or loads make
            the stiffness unsymmetric.

    Example:
        >>> top = gx.Ground((0.0, 0.0, 0.0))
        >>> spring = gx.connectors.Spring(mass.port(), top, stiffness=100.0, length=0.9)
        >>> equilibrium = gx.Equilibrium(
        ...     gx.Scene(mass, spring, gx.Gravity(mass, (0.0, 0.0, -10.0)))
        ... )
        >>> result = equilibrium.find()
        >>> along = gx.analysis.PointStiffness(equilibrium, mass.port())
        >>> found = gx.analysis.gradient(equilibrium, of=along, by=["spring.stiffness"])
        >>> found["spring.stiffness"].values.round(6), found.unit
        (array([1.]), 'N/m')
    """

    unit = "N/m"

    def __init__(
        self, equilibrium: Sought, port: Port, *, direction: Direction = (0.0, 0.0, 1.0)
    ) -> None:
        self._equilibrium = equilibrium
        self._row = partial(_row_of, equilibrium.system, port, direction)
        self._adjoint: StaticAdjoint | None = None
        # Of the state that was derived last: u, and k².
        self._shape: PETSc.Vec | None = None
        self._factor = 0.0

    def __call__(self, run: Any) -> float:
        """The stiffness in the equilibrium of this object, whatever `run` is."""
        compliance, shape = self._compliance()
        shape.destroy()
        return 1 / compliance if compliance else math.inf

    def _compliance(self) -> tuple[float, PETSc.Vec]:
        """w·K⁻¹ w [m/N], and K⁻¹ w as a new vector.  Collective."""
        row = self._row()
        if self._adjoint is None:
            self._adjoint = StaticAdjoint(self._equilibrium, "point_stiffness")
        self._adjoint.factorise()
        shape = self._adjoint.solve(row, "the stiffness of the point").copy()
        compliance = float(shape.dot(row))
        row.destroy()
        return compliance, shape

    def add_derivative(
        self, system: System, by_position: PETSc.Vec, by_velocity: PETSc.Vec
    ) -> None:
        """Add the derivative by the coordinates; the other ones are then those of this state."""
        compliance, self._shape = self._compliance()
        check(
            compliance != 0,
            "PointStiffness: the point is fixed, where its stiffness has no derivative; give "
            "another one.",
        )
        self._factor = 1 / compliance**2
        self._along(system).add_by_position(by_position)

    def _along(self, system: System) -> StiffnessAlong:
        assert self._shape is not None, "the stiffness is derived first"
        return StiffnessAlong(system, self._shape, self._factor, "PointStiffness")

    def residual_parts(self, system: System) -> list[tuple[PETSc.Vec, PETSc.Vec]]:
        return self._along(system).residual_parts()


def _row_of(system: System, port: Port, direction: Vector) -> PETSc.Vec:
    """The row w by which the unknowns give the displacement of a point along a direction, a new
    vector.  Collective."""
    unit = np.asarray(direction, dtype=float)
    length = float(np.linalg.norm(unit))
    of_unknowns = system.unknowns.numbering.vector()
    for axis, component in zip(AXES, unit / length, strict=True):
        if component:
            row = system.unknowns.numbering.vector()
            Position(port, axis).add_derivative(system, row, row)
            of_unknowns.axpy(component, row)
            row.destroy()
    return of_unknowns


class StaticAdjoint:
    """Solves (1) at one equilibrium, which may be found again in between."""

    def __init__(self, equilibrium: Sought, what: str) -> None:
        """`what` is the public function that needs it, for messages."""
        for scalars in equilibrium.system.equations.scalar_unknowns:
            check(
                scalars.is_closed,
                f"{what}: "
                "the gas of chambers with openings depends at equilibrium on how it got there; "
                "leave the openings out, or take the gradient of a run.",
            )
        self._what = what
        self._equilibrium = equilibrium
        self._system = equilibrium.system
        self._solver = StaticSolver(self._system)
        self._gas: list[tuple[Array, float]] = []
        self._λ = self._system.unknowns.numbering.vector()

    def factorise(self) -> None:
        """Take the tangent of the present equilibrium.  Collective."""
        self._equilibrium.need(self._what)
        system = self._system
        system.equations.set_end(system.unknowns.q0)
        system.equations.set_inertia(0.0)
        # Gradients g (n,) [m²] of the volumes and stiffnesses κ [Pa/m³] of the gas; pressures do
        # not change with coordinates that are held.
        self._gas = [
            pair for s in system.equations.scalar_unknowns for pair in s.static_stiffness()
        ]
        for gradient, _ in self._gas:
            gradient[system.unknowns.supports.held] = 0.0
        self._solver.factorise(self._equilibrium.is_known_regular, self._gas)

    def solve(self, by_position: PETSc.Vec, result: str) -> PETSc.Vec:
        """λ for the derivative ∂J/∂q of a result, named for messages, whose entries at fixed
        coordinates are set to zero; the next call overwrites λ.  `InputError` if the result depends
        on motions that nothing resists.  Collective."""
        # Fixed coordinates do not follow; their rows and columns of K are those of the identity.
        by_position.array[self._system.unknowns.supports.held] = 0
        is_solved = self._solver.solve(by_position, self._λ)
        check(
            is_solved,
            f"{self._what}: {result} is not determined by the equilibrium, as "
            f"{self._equilibrium.free_words}; hold what is free, prestress slack film or give it a "
            "residual_stiffness, or ask for what does not depend on it, e.g. a volume.",
        )
        return self._λ


class StaticGradients(StaticAdjoint):
    """Gradients of results of one equilibrium, by the same variables."""

    def __init__(self, equilibrium: Sought, by: Sequence[str]) -> None:
        super().__init__(equilibrium, "gradient")
        system = self._system
        check(
            not (
                system.equations.scalar_unknowns and any(name.endswith(f".{SHAPE}") for name in by)
            ),
            "gradient: the amount of gas in a chamber depends on the shape of its film; "
            "give the pressure as Pressure, or leave the shape out.",
        )
        self._adjoint = AdjointFields(system)
        self.variables = find_variables(system, by, self._adjoint, in_time=False)
        # One sentence if the equilibrium is not regular.
        self._notes: tuple[str, ...] = ()
        # By the identity of the result; one list for each variable.
        self._explicit: dict[int, list[list[FormDerivative]]] = {}
        self._by_position = system.unknowns.numbering.vector()
        self._by_velocity = system.unknowns.numbering.vector()

    def factorise(self) -> None:
        """Take the tangent of the present equilibrium.  `InputError` if a change of one of the
        variables leaves no equilibrium.  Collective."""
        super().factorise()
        self._notes = ()
        null_vector = self._solver.null_vector()
        if null_vector is None:
            return
        self._check_balance(null_vector)
        words = self._equilibrium.free_words
        self._notes = (f"{words}; the result and its derivatives do not depend on that.",)

    def _check_balance(self, null_vector: PETSc.Vec) -> None:
        """Raise `InputError` for a variable whose change pushes along a motion that nothing
        resists, of which a vector is given.  Collective."""
        pushes = self._residual_changes(null_vector)
        # The same numbers with random signs: the size of what balances.
        signs = np.random.default_rng(self._system.comm.rank).choice(
            (-1.0, 1.0), self._λ.local_size
        )
        null_vector.array[:] *= signs
        sizes = self._residual_changes(null_vector)
        for variable, push, size in zip(self.variables, pushes, sizes, strict=True):
            check(
                push <= UNBALANCED * size,
                f"{self._what}: a change of '{variable.name}' leaves the scene without equilibrium,"
                f" as {self._equilibrium.free_words}; hold what is free, or leave it out.",
            )

    def _residual_changes(self, vector: PETSc.Vec) -> list[float]:
        """The largest |vector·∂r/∂θ| of each variable θ.  Collective."""
        self._adjoint.set(vector)
        comm = self._system.comm
        changes = []
        for variable in self.variables:
            variable.start()
            variable.add_residual(vector, with_inertia=False)
            values = variable.sum.copy()
            if not variable.is_distributed:
                comm.Allreduce(MPI.IN_PLACE, values, op=MPI.SUM)
            largest = float(np.abs(values).max(initial=0.0))
            changes.append(comm.allreduce(largest, op=MPI.MAX))
        return changes

    def of(self, objective: Objective) -> Gradient:
        """The gradient of one result at the equilibrium of the last `factorise`.  Collective."""
        system = self._system
        self._by_position.set(0.0)
        self._by_velocity.set(0.0)
        objective.add_derivative(system, self._by_position, self._by_velocity)
        add_gas_pressures(objective, system, self._gas, self._by_position)
        self.solve(self._by_position, type(objective).__name__)
        self._adjoint.set(self._λ)
        for variable in self.variables:
            variable.start()
            variable.add_residual(self._λ, with_inertia=False)
        self._add_residual_parts(objective)
        self._add_mass_parts(objective)
        explicit = self._explicit_derivatives(objective)
        for variable, derivatives in zip(self.variables, explicit, strict=True):
            for derivative in derivatives:
                variable.sum += derivative.assemble()
            if isinstance(objective, Energy) and isinstance(variable, PointVariable):
                variable.sum += variable.energy_derivative()
            if isinstance(objective, ForceObjective) and isinstance(variable, PointVariable):
                variable.add_by_number(partial(objective.by_number, system))
        value = objective(self._equilibrium)
        return collected(value, objective.unit, self.variables, system.comm, notes=self._notes)

    def _add_residual_parts(self, objective: Objective) -> None:
        """Add Σ w·∂r/∂θ(q) of a result that depends on the residual.  Collective."""
        system = self._system
        for q, weights in objective.residual_parts(system):
            system.equations.set_end(q)
            weights.scale(-1.0)
            self._adjoint.set(weights)
            for variable in self.variables:
                variable.add_residual(weights, with_inertia=False)
            q.destroy()
            weights.destroy()
        system.equations.set_end(system.unknowns.q0)

    def _add_mass_parts(self, objective: Objective) -> None:
        """Add Σ w·∂M/∂θ v of a result that depends on masses.  Collective."""
        for v, weights in objective.mass_parts(self._system):
            self._adjoint.set(weights)
            self._adjoint.set_inertia(v)
            for variable in self.variables:
                if isinstance(variable, FormVariable):
                    variable.sum += variable.inertia_derivative()
                elif isinstance(variable, PointVariable):
                    variable.add_inertia(v, weights)

    def _explicit_derivatives(self, objective: Objective) -> list[list[FormDerivative]]:
        """The direct derivatives ∂J/∂θ of a result J by each variable θ, as forms that are compiled
        at the first use; empty where J does not depend on the variable directly."""
        known = self._explicit.get(id(objective))
        if known is not None:
            return known
        forms = objective.forms(self._system)
        found: list[list[FormDerivative]] = []
        for variable in self.variables:
            derivatives = []
            if forms and isinstance(variable, FormVariable):
                derivatives = [FormDerivative(forms, one) for one in variable.coefficients]
            found.append(derivatives)
        self._explicit[id(objective)] = found
        return found
