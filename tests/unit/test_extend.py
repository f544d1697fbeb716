"""One part of each kind that a user may add, made with `gossamer_fx.extend` alone."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc

import gossamer_fx as gx
from gossamer_fx.extend import (
    GasNetwork,
    Newton,
    Obstacle,
    ObstacleBoundary,
    ObstacleSolid,
    Opening,
    Output,
    StateView,
    Step,
    Stepper,
    StepSolver,
    System,
    check,
)
from gossamer_fx.meshes.sheet import sheet


@dataclass(frozen=True)
class BackwardEuler(Stepper):
    """An own integrator: v1 = v0 + h a1, q1 = q0 + h v1, of first order and dissipative."""

    dt: float
    rule = gx.steppers.EndPoint()

    def start(self, system: System) -> BackwardEulerSolver:
        return BackwardEulerSolver(system)


class BackwardEulerSolver(StepSolver):
    # The next term of q1 is that of h² a/2: a step control has no constant for the first order.
    error_constant = 0.5

    def __init__(self, system: System) -> None:
        self.newton = Newton(system, gx.Tolerances())
        self._system = system
        self._increment = system.unknowns.numbering.vector()
        self._v1 = system.unknowns.numbering.vector()

    def step(self, h: float) -> Step:
        system = self._system
        y = system.equations.begin_step(h)
        system.unknowns.v0.copy(self._increment)
        self._increment.scale(h)
        # M (v1 - v0)/h = (1/h²) M w with q1 = q0 + h v0 + w
        system.equations.set_inertia(1 / h**2)
        w, _, iterations = self.newton.solve(self._increment, y)
        self._v1.waxpy(1 / h, w, system.unknowns.v0)
        return Step(h, self._v1, iterations)


def oscillator(comm, stepper: Any) -> gx.Simulation:
    """A mass of 1 kg on a spring of (2π)² N/m, whose period is 1 s."""
    mass = gx.PointMass(1.0, (1.1, 0.0, 0.0), comm=comm)
    spring = gx.connectors.Spring(
        mass.port(), gx.Ground((0.0, 0.0, 0.0)), stiffness=4 * np.pi**2, length=1.0
    )
    return gx.Simulation(gx.Scene(mass, spring), stepper)


@pytest.mark.mpi
def test_an_own_integrator(comm) -> None:
    def end(dt: float) -> float:
        run = oscillator(comm, BackwardEuler(dt))
        run.run(until=0.5)
        assert run.totals.energy < 0.02 * 4 * np.pi**2 / 4
        return float(gx.probes.Position(run.scene.bodies[0].port(), "x")(run))

    # Half a period later it is on the other side, but for the damping of the method.
    errors = [end(dt) - 0.9 for dt in (2e-3, 1e-3)]
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.05)


class Largest(Output):
    """An own output: the largest value of a probe."""

    def __init__(self, probe: Any) -> None:
        self._probe = probe
        self.values: list[float] = []
        self.is_open = False

    @property
    def times(self) -> Sequence[float]:
        return [0.25]

    def open(self, run: StateView) -> None:
        check(run.time == 0.0, "Largest: start it with the run.")
        self.is_open = True

    def record(self, run: StateView, last: bool) -> None:
        self.values.append(self._probe(run))

    def close(self, run: StateView) -> None:
        self.is_open = False


@dataclass(frozen=True)
class Elongation:
    """An own probe [m]: how far a mass is from the origin, less 1 m."""

    port: Any
    unit: str = "m"

    def __call__(self, run: StateView) -> float:
        x = run.system.unknowns.state.vector(self.port)
        return float(np.linalg.norm(x) - 1.0)


def test_an_own_output_and_an_own_probe() -> None:
    run = oscillator(MPI.COMM_SELF, gx.Midpoint(dt=0.02))
    largest = Largest(Elongation(run.scene.bodies[0].port()))
    run.outputs.append(largest)
    run.run(until=1.0)
    assert not largest.is_open
    assert max(largest.values) == pytest.approx(0.1, rel=1e-3)
    # 0.25 s, at which the run is to stop, is not a multiple of 0.02 s.
    assert len(largest.values) >= 52


@dataclass(frozen=True, eq=False, kw_only=True)
class Dumbbell(Obstacle):
    """An own obstacle: two balls on a rod."""

    ends: tuple[tuple[float, float, float], tuple[float, float, float]]
    radius: float

    def parts(self) -> tuple[list[ObstacleBoundary], list[ObstacleSolid]]:
        corners = tuple(gx.Ground(end) for end in self.ends)
        return [], [ObstacleSolid(corners, edges=((0, 1),), radius=self.radius)]


@pytest.mark.mpi
def test_an_own_obstacle(comm) -> None:
    """A film that falls on it rests above it, and slides off where there is none."""
    mesh = sheet(comm, 8, 8, 0.2, 0.2)
    material = gx.TensionField(E=1e6, nu=0.3, density=1400.0, thickness=1e-4)
    film = gx.Membrane(
        mesh, material, velocity=lambda x: np.tile([[0.0], [0.0], [-1.0]], x.shape[1])
    )
    ends = ((0.05, 0.1, -0.02), (0.15, 0.1, -0.02))
    rod = Dumbbell(ends=ends, radius=0.01, name="dumbbell")
    contact = gx.Contact(film, rod, distance=1e-3)
    run = gx.Simulation(gx.Scene(film, contact), gx.Midpoint(dt=1e-3))
    run.run(until=0.03)
    x = run.system.unknowns.state[film].positions()
    # Distance of the nodes above the rod from its axis.
    is_above = (np.abs(x[:, 1] - 0.1) < 1e-3) & (x[:, 0] > 0.05) & (x[:, 0] < 0.15)
    heights = x[is_above, 2] + 0.02
    assert heights.min(initial=1.0) > 0.01
    lowest = comm.allreduce(float(x[:, 2].min(initial=1.0)), op=MPI.MIN)
    assert lowest < -0.022
    assert abs(run.energy_error) < 1e-10


@dataclass(frozen=True, eq=False)
class Leak(Opening):
    """An own opening: a mass flow [kg/s] that is proportional to the difference of pressures."""

    a: gx.Tank
    b: gx.Tank
    conductance: float
    name: str = "leak"
    scalar_unknowns = GasNetwork

    def flow(self, gases: Any, area: float, p: Any, T: Any) -> Any:
        return self.conductance * (p[0] - p[1])


@pytest.mark.mpi
def test_an_own_opening(comm, folder: Path) -> None:
    """Two tanks of which one is ten times as large: p V is shared, in a restarted run as in one."""
    air = gx.IdealGas(gamma=1.4, R=287.0)

    def run(until: float, **options: Any) -> gx.Simulation:
        full = gx.Tank(1e-3, gas=air, pressure=2e5, temperature=300.0, name="full")
        wide = gx.Tank(1e-2, gas=air, pressure=1e5, temperature=300.0, name="wide")
        anything = gx.PointMass(1.0, (0.0, 0.0, 0.0), comm=comm)
        scene = gx.Scene(anything, Leak(full, wide, 2e-9))
        made = gx.Simulation(scene, gx.Midpoint(dt=0.1), **options)
        made.run(until=until)
        return made

    whole = run(100.0)
    pressure = (2e5 * 1e-3 + 1e5 * 1e-2) / 1.1e-2
    assert whole.chamber("full").pressure == pytest.approx(pressure, rel=1e-6)
    assert whole.chamber("wide").pressure == pytest.approx(pressure, rel=1e-6)
    assert abs(whole.totals.mass - whole.first.mass) < 1e-13 * whole.first.mass
    run(5.0, checkpoints=gx.Checkpoints(folder))
    again = run(10.0, restart=folder)
    assert again.chamber("full").pressure == run(10.0).chamber("full").pressure


def test_a_solver_option_of_the_user(monkeypatch) -> None:
    options = PETSc.Options()
    options["gx_ksp_type"] = "cg"
    try:
        run = oscillator(MPI.COMM_SELF, gx.Midpoint(dt=0.1))
        assert run.solver.newton.ksp.getType() == "cg"
        run.run(until=0.1)
    finally:
        options.delValue("gx_ksp_type")


def test_nothing_else_of_the_package_is_imported() -> None:
    tree = ast.parse(Path(__file__).read_text(encoding="utf-8"))
    imported = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    imported |= {one.name for n in ast.walk(tree) if isinstance(n, ast.Import) for one in n.names}
    of_package = {str(name) for name in imported if str(name).startswith("gossamer_fx")}
    assert of_package == {"gossamer_fx", "gossamer_fx.extend", "gossamer_fx.meshes.sheet"}
