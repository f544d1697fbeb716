"""The film and the gas of most small scenes, and scenes that are brought to rest or moved."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.arrays import mesh_of_arrays
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet

MATERIAL = {"E": 1e9, "nu": 0.3, "density": 1400.0, "thickness": 1e-4}
WRINKLING = gx.Miyazaki(**MATERIAL)
LINEAR = gx.Linear(**MATERIAL)
AIR = gx.IdealGas(gamma=1.4, R=287.0)
ALONG_X = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]


def film(comm: MPI.Intracomm = MPI.COMM_WORLD, **options: Any) -> gx.Membrane:
    """A unit square of eight cells."""
    return gx.Membrane(sheet(comm, 2, 2), LINEAR, **options)


def plate(**options: Any) -> gx.Plate:
    """The same as a plate."""
    return gx.Plate(sheet(MPI.COMM_WORLD, 2, 2), LINEAR, **options)


def cable(**options: Any) -> gx.Cable:
    """Two cells along x."""
    return gx.Cable(line(MPI.COMM_WORLD, ALONG_X, 2), gx.CableLaw(1e5, 0.1), **options)


def beam(**options: Any) -> gx.Beam:
    """Two cells along x."""
    section = gx.sections.tube(0.02, 5e-4, E=1e11, nu=0.3, density=1560.0)
    return gx.Beam(line(MPI.COMM_WORLD, ALONG_X, 2), section, **options)


def body(**options: Any) -> gx.RigidBody:
    """Of unit mass and inertia."""
    return gx.RigidBody(1.0, (1.0, 1.0, 1.0), **options)


def tank(gas: gx.IdealGas = AIR, **options: Any) -> gx.Tank:
    """A litre at 1 bar."""
    return gx.Tank(1e-3, **({"gas": gas, "pressure": 1e5, "temperature": 300.0} | options))


def three_sheets() -> gx.Mesh:
    """Three triangles at one edge, the "seam", on each rank: dolfinx 0.9 cannot distribute them."""
    points = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1)], dtype=float)
    triangles = np.array([(0, 1, 2), (0, 1, 3), (0, 1, 4)])
    return mesh_of_arrays(MPI.COMM_SELF, lambda: (points, triangles, {"seam": np.array([[0, 1]])}))


def at_rest(*items: Any, search: gx.analysis.Continuation | None = None) -> gx.Equilibrium:
    """The equilibrium of a scene of these items."""
    equilibrium = gx.Equilibrium(gx.Scene(*items), search or gx.analysis.Continuation())
    equilibrium.find()
    return equilibrium


def run_of(
    *items: Any, dt: float, tolerances: gx.Tolerances | None = None, **options: Any
) -> gx.Simulation:
    """A run of a scene of these items by the midpoint rule with steps of dt [s], before its start.

    Args:
        tolerances: of the steps, instead of the usual ones.
        options: further arguments of the simulation.
    """
    stepper = gx.Midpoint(dt=dt, tolerances=tolerances or gx.Tolerances())
    return gx.Simulation(gx.Scene(*items), stepper, **options)


def run_until(until: float, *items: Any, **options: Any) -> gx.Simulation:
    """The run of `run_of` with these arguments to a time [s]."""
    run = run_of(*items, **options)
    run.run(until=until)
    return run


def thrown(X: np.ndarray) -> np.ndarray:
    """Velocities of a unit sheet, a spin with flutter: every cell switches between taut, wrinkled
    and slack."""
    x, y, _ = X
    return np.vstack([-5 * (y - 0.5), 5 * (x - 0.5), np.sin(np.pi * x) * np.sin(2 * np.pi * y)])


def rolled(κ: float) -> Callable[[np.ndarray], np.ndarray]:
    """Displacements that roll a sheet to a cylinder of the curvature κ [1/m] along x."""
    return lambda X: np.stack([np.sin(κ * X[0]) / κ - X[0], 0 * X[0], (1 - np.cos(κ * X[0])) / κ])


def inwards(X: np.ndarray) -> np.ndarray:
    """Velocities of 1 m/s towards the origin."""
    return -X / np.linalg.norm(X, axis=0)


def momentum_changes(run: gx.Simulation) -> tuple[float, float]:
    """Largest changes of momentum [kg m/s] and angular momentum [kg m²/s] since the start."""
    linear = run.totals.momentum - run.first.momentum
    angular = run.totals.angular_momentum - run.first.angular_momentum
    return float(np.abs(linear).max()), float(np.abs(angular).max())


def spin_drift(run: gx.Simulation) -> float:
    """Largest change of the angular momentum over its largest component at the start."""
    _, angular = momentum_changes(run)
    return angular / float(np.abs(run.first.angular_momentum).max())


def begin_iteration(run: gx.Simulation, h: float) -> None:
    """Set the system of a run to the first iterate of a step of length h [s]."""
    system = run.system
    system.equations.begin_step(h)
    system.equations.set_inertia(2 / h**2)
    zero = system.unknowns.numbering.vector()
    system.equations.predict(zero)
    system.equations.set_increment(zero, None)
