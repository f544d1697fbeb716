"""Results with derivatives of films, gas and whole runs; the positions of points are in
`records.probes`, and what an objective is `records.probes.objective` says."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import ufl
from dolfinx import fem, la
from petsc4py import PETSc

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import InputError, check
from gossamer_fx.core.checks.lookups import check_in_scene
from gossamer_fx.core.forms.compilation import compile_form
from gossamer_fx.core.forms.kinematics import Expr, area_vector
from gossamer_fx.core.model.body import Array, MeshBody
from gossamer_fx.core.model.state import HasSystem
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.records.probes.objective import Objective
from gossamer_fx.solve.system.system import System
from gossamer_fx.solve.view import chamber_states

if TYPE_CHECKING:
    # A scene without gas does not load it.
    from gossamer_fx.mechanics.gas.volumes import Chamber


def add_gas_pressures(
    objective: Objective,
    system: System,
    gas: Sequence[tuple[Array, float]],
    by_position: PETSc.Vec,
) -> None:
    """Add Σ -κ ∂J/∂p g to the derivative of a result J by the coordinates, over the closed films
    whose volume has the derivative g (n,) [m²] and whose gas the stiffness κ [Pa/m³]: pressures in
    tanks do not depend on coordinates."""
    if not gas:
        return
    by_scalars = np.zeros(system.matrices.scalar_count)
    objective.add_scalar_derivative(system, by_scalars)
    states = chamber_states(system).values()
    enclosed = [k for k, state in enumerate(states) if state.enclosure is not None]
    for k, (gradient, stiffness) in zip(enclosed, gas, strict=True):
        by_position.array[:] -= by_scalars[k] * stiffness * gradient


@check_arguments
class Integral(Objective):
    """An integral over a body, e.g. a measure of wrinkling or the difference from a wanted shape.

    Args:
        body: a film, plate, cable or beam.
        form: function of the positions q of the body, a UFL expression, that returns a UFL form.
        unit: SI unit of the integral.

    Example:
        >>> equilibrium = gx.Equilibrium(gx.Scene(film))
        >>> deflection = gx.analysis.Integral(film, lambda q: q[2] ** 2 * film.dx, unit="m⁴")
        >>> deflection(equilibrium)
        0.0
    """

    def __init__(self, body: MeshBody, form: Callable[[Expr], ufl.Form], *, unit: str = "") -> None:
        self.body = body
        self.unit = unit
        self._form = form
        self._q = fem.Function(body.space)
        self._compiled: tuple[fem.Form, fem.Form] | None = None

    def _prepare(self, system: System) -> tuple[fem.Form, fem.Form]:
        """The forms of the integral and of its derivative, which read the present positions;
        compiled at the first use.  Collective."""
        check_in_scene(f"Integral: '{self.body.name}'", self.body in system.unknowns.bodies)
        if self._compiled is None:
            form = self._form(self._q)
            derivative = ufl.derivative(form, self._q, ufl.TestFunction(self.body.space))
            self._compiled = compile_form(form), compile_form(derivative)
        owned = system.unknowns.q0.array_r[system.unknowns.block(self.body).owned]
        system.unknowns.coordinates[self.body].take(self._q, owned)
        return self._compiled

    def __call__(self, run: HasSystem) -> float:
        value, _ = self._prepare(run.system)
        return float(run.system.comm.allreduce(fem.assemble_scalar(value)))

    def add_derivative(
        self, system: System, by_position: PETSc.Vec, by_velocity: PETSc.Vec
    ) -> None:
        """Add the derivative by the positions; the integral does not depend on velocities."""
        _, derivative = self._prepare(system)
        dofs = self.body.space.dofmap
        b = la.vector(dofs.index_map, dofs.index_map_bs)
        b.array[:] = 0
        fem.assemble_vector(b.array, derivative)
        b.scatter_reverse(la.InsertMode.add)
        with by_position as values:
            owned = system.unknowns.block(self.body).owned
            system.unknowns.coordinates[self.body].add_forces(b.array, values[owned])

    def forms(self, system: System) -> list[ufl.Form]:
        """The integral at the end of a step."""
        return [self._form(system.unknowns.coordinates[self.body].q1)]


@check_arguments
class EnclosedVolume(Integral):
    """Volume [m³] between a film and the origin, V = ⅓ ∫ x·n da.

    It is the volume of a closed film.  Of an open one it is that of the cone from its rim to the
    origin, e.g. the volume above the plane of the rim if the origin lies in that plane.

    Args:
        film: the film; the normal points outwards.

    Example:
        >>> equilibrium = gx.Equilibrium(gx.Scene(film))
        >>> volume = gx.analysis.EnclosedVolume(film)
        >>> volume(equilibrium)
        0.0
    """

    def __init__(self, film: Membrane) -> None:
        # Exact for the deformed surface: the area vector has the degree 2 (order - 1), x the order.
        degree = 2 * (film.order - 1) + film.order
        dx = ufl.Measure("dx", film.space.mesh, metadata={"quadrature_degree": degree})

        def volume(q: Expr) -> ufl.Form:
            return ufl.dot(area_vector(film.deformation(q)), q) / 3 * dx

        super().__init__(film, volume, unit="m³")


@check_arguments
class Rate:
    """Rate of change in time of a result that depends on positions, e.g. of an enclosed volume: a
    probe.

    It is ∂J/∂q·v of the present state, with the velocities v.

    Args:
        of: the result, e.g. an `EnclosedVolume`.

    Raises:
        InputError: the result has no derivative.

    Example:
        >>> inflow = gx.analysis.Rate(gx.analysis.EnclosedVolume(film))
        >>> inflow.unit, inflow(gx.Simulation(gx.Scene(film), gx.Midpoint(dt=0.1)))
        ('m³/s', 0.0)
    """

    def __init__(self, of: Objective) -> None:
        self.of = of
        self.unit = f"{of.unit}/s"

    def __call__(self, run: HasSystem) -> float:
        system = run.system
        by_position = system.unknowns.numbering.vector()
        by_velocity = system.unknowns.numbering.vector()
        self.of.add_derivative(system, by_position, by_velocity)
        rate = float(by_position.dot(system.unknowns.v0))
        by_position.destroy()
        by_velocity.destroy()
        return rate


@check_arguments
class Energy(Objective):
    """Energy [J] of a scene: stored, kinetic, and the internal energy of gas; of an equilibrium the
    stored one.

    Example:
        >>> energy = gx.analysis.Energy()
        >>> energy(run) == run.totals.kinetic + sum(run.totals.stored.values())
        True
    """

    unit = "J"

    def __call__(self, run: HasSystem) -> float:
        totals = run.system.balance.totals()
        return float(totals.kinetic + sum(totals.stored.values()))

    def add_derivative(
        self, system: System, by_position: PETSc.Vec, by_velocity: PETSc.Vec
    ) -> None:
        """Add ψ'(q) [N], the forces of stored energies in a step of no length, and M v [kg m/s].
        The internal energy U(p V, m) of a chamber adds p ∂U/∂(pV) ∂V/∂q."""
        forces = system.equations.stored_forces()
        by_position.axpy(1.0, forces)
        with by_position as values:
            for gas in chamber_states(system).values():
                if gas.enclosure is not None:
                    values += gas.pressure * gas.heat_factor * gas.enclosure.of_volume
        momenta = system.unknowns.numbering.vector()
        system.unknowns.M.mult(system.unknowns.v0, momenta)
        by_velocity.axpy(1.0, momenta)

    def add_scalar_derivative(self, system: System, by_scalars: Array) -> None:
        """Add the derivatives of U by the pressure and the masses of each chamber."""
        chambers = list(chamber_states(system).values())
        # The masses of all species follow the pressures.
        start = len(chambers)
        for k, gas in enumerate(chambers):
            by_scalars[k] += gas.volume * gas.heat_factor
            end = start + len(gas.masses)
            by_scalars[start:end] += gas.energy_by_mass
            start = end

    def forms(self, system: System) -> list[ufl.Form]:
        """The stored energy as forms; `TransientGradients` adds what the kinetic energy depends on
        by the masses."""
        found = []
        for compiled in system.equations.differentiable:
            for body in system.unknowns.coordinates:
                found += compiled.energy_forms(body)
        return found


@check_arguments
class CrossingTime(Objective):
    """Time [s] at which another result of a run first passes a value, e.g. at which a tube is open.

    Between two steps the result counts as linear, so that the time has an error of second order in
    h.

    Args:
        of: the result that is observed.
        value: the value that it passes.

    Raises:
        InputError: when derived: the result did not pass the value in the recorded steps.

    Example:
        >>> opened = gx.analysis.CrossingTime(gx.analysis.ChamberPressure(tank), 500.0)
        >>> opened.unit
        's'
    """

    unit = "s"

    def __init__(self, of: Objective, value: float) -> None:
        self.of = of
        self.value = value

    def __call__(self, run: HasSystem) -> float:
        """Not known from one state; `gx.analysis.gradient` finds it in a tape."""
        raise InputError(
            "CrossingTime: one state does not know when a value was passed; "
            "use it in gx.analysis.gradient(tape, ...)."
        )

    def add_derivative(
        self, system: System, by_position: PETSc.Vec, by_velocity: PETSc.Vec
    ) -> None:
        """Refuse, as `__call__` does."""
        self(SceneView(system))

    def has_passed(self, values: Sequence[float]) -> bool:
        """Whether the value lies between the last two of these results, or is one of them; not if
        there is one only, or both are equal."""
        if len(values) < 2:
            return False
        before, after = values[-2:]
        return (before - self.value) * (after - self.value) <= 0 and before != after

    def found(
        self, times: Sequence[float], values: Sequence[float]
    ) -> tuple[float, dict[int, float]]:
        """The time of the crossing, which is in the last step, and the derivatives of this time by
        the observed result at both ends of that step: by the number of the state."""
        check(
            self.has_passed(values),
            f"CrossingTime: the result does not pass {self.value!r}; "
            f"in the recorded steps it is between {min(values):.6g} and {max(values):.6g}.",
        )
        last = len(times) - 1
        before, after = np.asarray(values[-2:]) - self.value
        h = times[-1] - times[-2]
        change = after - before
        time = times[-2] - before / change * h
        # d/d(before) and d/d(after) of t - h before/(after - before)
        return time, {last - 1: -h * after / change**2, last: h * before / change**2}


@check_arguments
class Functional(Objective):
    """A result given by two functions: its value and its derivative with respect to all
    coordinates.

    Args:
        value: function of a run that returns a number, the same on every rank.
        derivative: function of a run that returns, for each body that the result depends on, the
            derivative with respect to its coordinates: {body: array of this rank's coordinates}.
        unit: SI unit of the result.

    Raises:
        InputError: when derived: an array of another size than the coordinates of the body.

    Example:
        >>> highest = gx.analysis.Functional(
        ...     lambda run: run.system.unknowns.state[mass].positions()[0, 2],
        ...     lambda run: {mass: np.array([0.0, 0.0, 1.0])},
        ...     unit="m",
        ... )
        >>> highest(run)
        -1.0
    """

    def __init__(
        self,
        value: Callable[[Any], float],
        derivative: Callable[[Any], dict[Any, Array]],
        *,
        unit: str = "",
    ) -> None:
        self._value = value
        self._derivative = derivative
        self.unit = unit

    def __call__(self, run: HasSystem) -> float:
        return float(self._value(run))

    def add_derivative(
        self, system: System, by_position: PETSc.Vec, by_velocity: PETSc.Vec
    ) -> None:
        """Add the derivative that the function of the user returns, by coordinates."""
        found = self._derivative(SceneView(system))
        with by_position as values:
            for body, by_coordinates in found.items():
                owned = system.unknowns.block(body).owned
                given = np.ravel(np.asarray(by_coordinates, dtype=float))
                check(
                    len(given) == owned.stop - owned.start,
                    f"Functional: the derivative by '{body.name}' has {len(given)} entries; give "
                    f"one for each of the {owned.stop - owned.start} coordinates of this rank.",
                )
                values[owned] += given


class SceneView(HasSystem):
    """A compiled scene as a run, for objectives and functions of the user."""

    def __init__(self, system: System) -> None:
        self.system = system


@check_arguments
class ChamberPressure(Objective):
    """Pressure [Pa] of the gas in a chamber or tank.

    Args:
        chamber: the chamber.

    Example:
        >>> pressure = gx.analysis.ChamberPressure(tank)
        >>> pressure.unit
        'Pa'
    """

    unit = "Pa"

    def __init__(self, chamber: Chamber) -> None:
        self.chamber = chamber

    def _index(self, system: System) -> int:
        """Index of this pressure among the scalar unknowns, of which pressures are the first."""
        for k, gas in enumerate(chamber_states(system).values()):
            if gas.chamber is self.chamber:
                return k
        raise InputError(f"ChamberPressure: '{self.chamber.name}' is not in the scene; add it.")

    def __call__(self, run: HasSystem) -> float:
        return float(list(chamber_states(run.system).values())[self._index(run.system)].pressure)

    def add_derivative(
        self, system: System, by_position: PETSc.Vec, by_velocity: PETSc.Vec
    ) -> None:
        """Add nothing: it is one of the unknowns, which `add_scalar_derivative` derives by."""

    def add_scalar_derivative(self, system: System, by_scalars: Array) -> None:
        """Add one, the derivative of the pressure by itself, at its scalar unknown."""
        by_scalars[self._index(system)] += 1.0
