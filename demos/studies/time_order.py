"""Order in time, and what error a second of computing leaves: the midpoint rule against
generalised-α.

    sheet      a stretched square film after a blow, its edges held; it never wrinkles
    flutter    the free, spinning sheet of the demo, which wrinkles and goes slack all the time
    balloon    a sphere of rubber filled from a reservoir through an orifice
    antenna    the pendulum of the demo: a film on two booms, swinging from a ball joint

The error is that of all positions, Euclidean norms, against the midpoint rule with a quarter of the
smallest step, over the way that was gone.  Where a film goes slack, a step of order two meets a
stress that is not smooth; in the antenna, gravity sets in at once and excites vibrations of the
booms, of 1e5 rad/s, that no step resolves.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.antennas.antenna_attitude import antenna
from demos.films.spinning_sheet import throw
from demos.studies.engine.study import Measure, Study, Trial
from gossamer_fx.extend import Array, FilmLaw
from gossamer_fx.meshes.sheet import EDGES, sheet
from gossamer_fx.meshes.sphere import sphere

STEPPERS: dict[str, Callable[[float], gx.Midpoint | gx.GeneralizedAlpha]] = {
    "Midpoint": lambda dt: gx.Midpoint(dt=dt),
    "GeneralizedAlpha 0.8": lambda dt: gx.GeneralizedAlpha(dt=dt, spectral_radius=0.8),
    "GeneralizedAlpha 0": lambda dt: gx.GeneralizedAlpha(dt=dt, spectral_radius=0.0),
}
# Coarsest step [s] of each scene, and the number of such steps in a run.
COARSEST = {
    "sheet": 5e-5,
    "flutter": 1e-4,
    "balloon": 1e-3,
    "antenna": 1e-3,
}
STEPS = {
    "sheet": 20,
    "flutter": 20,
    "balloon": 20,
    "antenna": 40,
}
# The step of the reference is that of the finest level over this number, so that its error is a
# sixteenth.
FINER = 4
# The step is halved from level to level.
LEVELS = (0, 1, 2, 3)


# 20 µm thick: at 5 % of stretch no cell wrinkles.
TAUT = {"E": 2.3e9, "nu": 0.3, "density": 1400.0, "thickness": 20e-6}


def taut_sheet(
    comm: MPI.Comm, law: FilmLaw | None = None, order: int = 1, cells: int = 8
) -> gx.Scene:
    """A square film of 1 m, stretched by 5 %, with fixed edges, after a blow of 30 m/s in its
    middle; of a law that can wrinkle, unless another one is given.
    """

    def blow(X: Array) -> Array:
        speed = 30 * np.sin(math.pi * X[0]) * np.sin(math.pi * X[1])
        return np.vstack([0 * X[0], 0 * X[0], speed])

    film = gx.Membrane(
        sheet(comm, cells, cells, crossed=True),
        law or gx.Miyazaki(**TAUT),
        order=order,
        displacement=lambda X: 0.05 * X,
        velocity=blow,
    )
    return gx.Scene(film, *(gx.Fixed(film, edge) for edge in EDGES))


def flutter(comm: MPI.Comm) -> gx.Scene:
    law = gx.Miyazaki(
        E=1e9,
        nu=0.3,
        density=1400.0,
        thickness=1e-4,
        residual_stiffness=1e-6,
    )
    return gx.Scene(gx.Membrane(sheet(comm, 8, 8), law, velocity=throw))


def balloon(comm: MPI.Comm, cells: int = 6) -> gx.Scene:
    """A rubber sphere of 0.2 m radius that fills from 1 bar through an orifice of 0.3 cm²."""
    law = gx.Linear(
        E=2e6,
        nu=0.45,
        density=1100.0,
        thickness=2e-4,
    )
    film = gx.Membrane(sphere(comm, 0.2, cells, order=2), law, order=2)
    bag = gx.Chamber(
        film,
        gas=gx.IdealGas(gamma=1.4, R=287.0),
        pressure=50.0,
        temperature=300.0,
    )
    source = gx.gas.Ambient(1e5, 300.0, name="reservoir")
    valve = gx.Orifice(source, bag, area=3e-5)
    return gx.Scene(film, bag, valve)


def pendulum(comm: MPI.Comm) -> gx.Scene:
    """The antenna of the demo, hung at one corner by a ball joint, under a gravity of 1 m/s²."""
    model = antenna(comm, 2, 4, 1)
    corner = model.points[2]
    hook = gx.Ground(tuple(corner.tolist()))
    hinge = gx.constraints.BallJoint(
        model.film.port_at(corner),
        hook,
        name="hinge",
    )
    weights = []
    for body in (model.film, *model.booms):
        weights.append(gx.Gravity(body, (0.0, 0.0, -1.0)))
    return gx.Scene(*model.items, hinge, *weights)


SCENES: dict[str, Callable[[MPI.Comm], gx.Scene]] = {
    "sheet": taut_sheet,
    "flutter": flutter,
    "balloon": balloon,
    "antenna": pendulum,
}


def positions(run: gx.Simulation) -> Array:
    """Positions of this rank's nodes, flattened."""
    system = run.system
    # A rank may have no body.
    found = [np.zeros(0)]
    for k, body in enumerate(system.unknowns.bodies):
        q = system.unknowns.q0.array_r[system.unknowns.numbering.owned(k)].reshape(
            -1, body.block.size
        )
        found.append(q[:, :3].ravel())
    return np.concatenate(found)


def move(
    comm: MPI.Comm, scene: str, stepper: str, h: float
) -> tuple[gx.Simulation, Array, Array, float]:
    """The run to the end, positions at start and end, CPU time."""
    run = gx.Simulation(SCENES[scene](comm), STEPPERS[stepper](h))
    start = positions(run)
    # CPU time of the steps only: compilation does not depend on the stepper.
    began = time.process_time()
    run.run(until=STEPS[scene] * COARSEST[scene])
    return run, start, positions(run), time.process_time() - began


def reference(comm: MPI.Comm, scene: str) -> tuple[Array, float]:
    """Positions at the end, and the way that was gone; computed once."""
    if scene not in _REFERENCES:
        finest = COARSEST[scene] / 2 ** LEVELS[-1]
        _, start, end, _ = move(comm, scene, "Midpoint", finest / FINER)
        _REFERENCES[scene] = end, norm(comm, end - start)
    return _REFERENCES[scene]


_REFERENCES: dict[str, tuple[Array, float]] = {}


def norm(comm: MPI.Comm, x: Array) -> float:
    return math.sqrt(comm.allreduce(float(x @ x)))


def problem(comm: MPI.Comm, scene: str, stepper: str, level: int) -> dict[str, float]:
    """The step is halved from level to level."""
    h = COARSEST[scene] / 2**level
    run, _, end, seconds = move(comm, scene, stepper, h)
    exact, way = reference(comm, scene)
    return {
        "positions": norm(comm, end - exact) / way,
        "h": h,
        "energy": abs(run.energy_error),
        "newton_per_step": run.iterations / run.step,
        "substeps": run.substeps,
        "seconds": seconds,
    }


def expected_order(case: Trial) -> float:
    """Where the steps resolve the motion; strong damping of high frequencies comes to its order
    with smaller ones."""
    orders = {"sheet": 2.0, "balloon": 2.0, "antenna": 1.8}
    # An infinite order is one that is not asked for.
    if case["stepper"] == "GeneralizedAlpha 0":
        return math.inf
    return orders.get(case["scene"], math.inf)


STUDY = Study(
    "time_order",
    "Order in time of the midpoint rule and of generalised-α",
    problem,
    {"scene": list(SCENES), "stepper": list(STEPPERS), "level": list(LEVELS)},
    lambda case: COARSEST[case["scene"]] / 2 ** case["level"],
    (Measure("positions", 0.0, rate=expected_order),),
    quick={"scene": ["sheet"], "level": [0, 1]},
    columns="h, energy, newton_per_step, substeps, seconds",
)
