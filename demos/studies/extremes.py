"""Extreme numbers in scenes whose answers are known: contact, folds, rigid bodies, mixtures of
gases, temperatures, scales.

`stability` maps an inflating tube, whose answer nobody knows: it judges balances.  Here each cell
has an answer, and a cell that completes with another one ends the study with an error.  A cell is
a scene and one number that is far from ordinary:

    bounce    a film falls on a floor in one piece, without damping: it leaves with the speed with
              which it came.  speed [m/s], thickness [m], distance of the contact [m]
    crease    a folded strip opens by its crease: the energy of the crease becomes that of the
              motion, and nothing is lost.  stiffness [N m/m/rad]
    top       a free symmetric body: it precesses by H/I1 about its angular momentum.  ratio of the
              inertia about its axis to that across, rate [rad/s]
    tanks     two tanks with different gases of one γ are joined: both come to the pressure
              (p1 V1 + p2 V2)/(V1 + V2).  volume and pressure of the second over the first
    heat      a film between two walls is cooled: its stress is E α ΔT/(1 - ν), engineering strain
              for small ones.  ΔT [K]
    scale     a square film of another size, load and mass in proportion: the shape is the same.
              size [m]
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.studies.engine.deployments import arguments
from demos.studies.engine.study import ROUND_OFF, Study
from demos.studies.stability import draw
from gossamer_fx.extend import check
from gossamer_fx.meshes.creased_strip import creased_strip
from gossamer_fx.meshes.sheet import crossed_sheet

FILM = {"E": 1e9, "nu": 0.3, "density": 1400.0}
# Closing error of the energy, relative, with which a cell counts as right.
ENERGY = 1e-9


@dataclass(frozen=True)
class Answer:
    """What a scene gave.

    Attributes:
        run: the run; None for an equilibrium.
        value: the number that is compared.
        exact: the answer.
        tolerance: largest relative error.
    """

    run: gx.Simulation | None
    value: float
    exact: float
    tolerance: float


def bounce(comm: MPI.Comm, speed: float, thickness: float, distance: float) -> Answer:
    """The film in one piece: all nodes meet the floor at once, as it is stiff in its plane only."""
    law = gx.Linear(**FILM, thickness=thickness)

    def falling(X: np.ndarray) -> np.ndarray:
        return np.stack([0 * X[0], 0 * X[0], -speed + 0 * X[0]])

    film = gx.Membrane(crossed_sheet(comm, 2, 2, 0.1, 0.1), law, velocity=falling)
    floor = gx.contact.Plane(point=(0.0, 0.0, -1.5 * distance), normal=(0.0, 0.0, 1.0))
    scene = gx.Scene(film, gx.Contact(film, floor, distance=distance))
    # It crosses the distance of the contact in some 20 steps.
    run = gx.Simulation(scene, gx.Midpoint(dt=distance / speed / 20))
    run.run(until=8 * distance / speed)
    mass = law.density * thickness * 0.1**2
    return Answer(run, float(run.totals.momentum[2]) / mass, speed, 1e-6)


def crease(comm: MPI.Comm, stiffness: float) -> Answer:
    """The energy at the end, over that at the start: of the crease by its angles as they are, with
    that of the film, which is zero in a strip that starts flat."""
    law = gx.Miyazaki(**FILM, thickness=25e-6)
    strip = gx.Membrane(creased_strip(comm, 2, 2, 0.05, 0.05), law, name="strip")
    fold = gx.connectors.Crease(strip, "crease", stiffness=stiffness, rest_angle=1.0)
    # The period of a panel on its crease [s].
    inertia = law.density * 25e-6 * 0.05**3 / 3
    period = 2 * math.pi * math.sqrt(inertia / stiffness)
    run = gx.Simulation(gx.Scene(strip, fold), gx.Midpoint(dt=period / 200))
    # Length of the two edges of the crease [m].
    edge = 0.025
    start = run.totals.stored["strip"]
    for y in (0.0, edge):
        angle = _fold_angle(run, strip, edge, y)
        start += stiffness * edge * (angle - fold.rest_angle) ** 2 / 2
    run.run(until=period / 5)
    end = run.totals.kinetic + sum(run.totals.stored.values())
    return Answer(run, end, start, 1e-9)


def _fold_angle(run: gx.Simulation, strip: gx.Membrane, edge: float, y: float) -> float:
    """The angle [rad] at an edge of the crease that starts at (0, y): by which the triangle on its
    right is turned, towards z, against the one on its left.  `edge`: of the mesh [m]."""

    def position(x: float, y: float) -> np.ndarray:
        return run.system.unknowns.state.vector(strip.port_at((x, y, 0.0)))

    first = position(0.0, y)
    along = position(0.0, y + edge) - first
    # All diagonals run to the upper right.
    left = np.cross(first - position(-edge, y), along)
    right = np.cross(position(edge, y + edge) - first, along)
    sine = np.cross(right, left) @ along / np.linalg.norm(along)
    return math.atan2(sine, left @ right)


def top(comm: MPI.Comm, ratio: float, rate: float) -> Answer:
    """The angle by which the axis has precessed after a tenth of a turn, over the exact one."""
    across = 1e-3
    about = ratio * across
    # The angular velocity leans by 30° from the axis z.
    spin = np.array([rate * math.sin(math.pi / 6), 0.0, rate * math.cos(math.pi / 6)])
    body = gx.RigidBody(1.0, (across, across, about), spin=tuple(spin), comm=comm)
    momentum = np.array([across * spin[0], 0.0, about * spin[2]])
    precession = float(np.linalg.norm(momentum)) / across
    turn = 0.2 * math.pi
    # Steps that resolve both the precession and the spin.
    steps = math.ceil(400 * max(1.0, rate / precession))
    run = gx.Simulation(gx.Scene(body), gx.Midpoint(dt=turn / precession / steps))
    run.run(until=turn / precession)
    axis = run.system.unknowns.state.vector(body.port((0.0, 0.0, 1.0)))
    e = momentum / np.linalg.norm(momentum)
    before = np.array([0.0, 0.0, 1.0])
    flat = [v - (v @ e) * e for v in (before, axis)]
    angle = math.atan2(float(np.cross(*flat) @ e), float(flat[0] @ flat[1]))
    return Answer(run, angle, turn, 1e-3)


def tanks(comm: MPI.Comm, volume: float, pressure: float) -> Answer:
    """The pressure of the second tank after 100 times the time in which they equalise."""
    light = gx.IdealGas(gamma=1.4, R=2077.0, name="light")
    heavy = gx.IdealGas(gamma=1.4, R=200.0, name="heavy")
    first = gx.Tank(1e-3, gas=light, pressure=1e5, temperature=300.0, name="first")
    second = gx.Tank(
        1e-3 * volume, gas=heavy, pressure=1e5 * pressure, temperature=300.0, name="second"
    )
    opening = gx.Orifice(second, first, area=1e-6, name="opening")
    mass = gx.PointMass(1.0, comm=comm, name="mass")
    # The smaller tank empties in V/(A √(R T)) [s].
    time = min(1e-3, 1e-3 * volume) / (1e-6 * math.sqrt(200.0 * 300.0))
    run = gx.Simulation(gx.Scene(mass, first, second, opening), gx.Midpoint(dt=time / 2))
    run.run(until=100 * time)
    exact = 1e5 * (1 + pressure * volume) / (1 + volume)
    return Answer(run, run.chamber("second").pressure, exact, 1e-4)


def heat(comm: MPI.Comm, cooling: float) -> Answer:
    """The larger principal stress of a film that is held on all sides."""
    law = gx.Miyazaki(**FILM, thickness=1e-4)
    alpha = 2e-5
    thermal = gx.materials.ThermalExpansion(alpha, lambda X, t: 293.15 - cooling + 0 * X[0])
    film = gx.Membrane(crossed_sheet(comm, 2, 2, 0.1, 0.1), law, thermal=thermal)
    held = [gx.Fixed(film, edge) for edge in ("left", "right", "bottom", "top")]
    search = gx.Equilibrium(gx.Scene(film, *held))
    residual = search.find().residual
    found = gx.analysis.largest_stress(search, film).stress
    strain = alpha * cooling
    # Where the stress is at the round-off of the film, a warning says to how much.
    tolerance = max(2 * strain, 3 * residual)
    return Answer(None, found, law.E * strain / (1 - law.nu), tolerance)


def scale(comm: MPI.Comm, size: float) -> Answer:
    """The height of the middle over the size, compared with that of a film of 1 m."""
    return Answer(None, _height(comm, size), _height(comm, 1.0), 1e-7)


def _height(comm: MPI.Comm, size: float) -> float:
    law = gx.Miyazaki(**FILM, thickness=1e-4 * size)
    film = gx.Membrane(crossed_sheet(comm, 4, 4, size, size), law)
    held = [gx.Fixed(film, edge) for edge in ("left", "right", "bottom", "top")]
    search = gx.Equilibrium(gx.Scene(film, *held, gx.Pressure(film, 1000.0)))
    search.find()
    middle = film.port_at((size / 2, size / 2, 0.0))
    return float(search.system.unknowns.state.vector(middle)[2]) / size


SCENES: dict[str, Callable[..., Answer]] = {
    "bounce": bounce,
    "crease": crease,
    "top": top,
    "tanks": tanks,
    "heat": heat,
    "scale": scale,
}
# Ordinary numbers of each scene, and the range of each.
ORDINARY: dict[str, dict[str, float]] = {
    "bounce": {"speed": 1.0, "thickness": 1e-4, "distance": 1e-3},
    "crease": {"stiffness": 1e-3},
    "top": {"ratio": 1.5, "rate": 10.0},
    "tanks": {"volume": 1.0, "pressure": 2.0},
    "heat": {"cooling": 10.0},
    "scale": {"size": 1.0},
}
RANGES: dict[str, dict[str, list[float]]] = {
    "bounce": {
        "speed": [1e-3, 1e-1, 10.0, 100.0],
        "thickness": [1e-6, 1e-5, 1e-3, 1e-2],
        "distance": [1e-6, 1e-5, 1e-4, 1e-2],
    },
    "crease": {"stiffness": [1e-9, 1e-6, 1.0, 1e2]},
    "top": {"ratio": [1e-3, 0.1, 1.9, 1.99], "rate": [1e-6, 1e-3, 1e3, 1e5]},
    "tanks": {"volume": [1e-6, 1e-3, 1e3, 1e6], "pressure": [1e-6, 1e-3, 1e3, 1e5]},
    "heat": {"cooling": [1e-6, 1e-3, 0.1, 200.0]},
    "scale": {"size": [1e-4, 1e-2, 1e2, 1e4]},
}


def cases() -> list[str]:
    """Names of all cells, e.g. "bounce" and "bounce speed=100"."""
    return [
        name
        for scene, ranges in RANGES.items()
        for name in (
            scene,
            *(f"{scene} {axis}={value:g}" for axis, values in ranges.items() for value in values),
        )
    ]


def problem(comm: MPI.Comm, case: str) -> Mapping[str, float]:
    """Run one cell.

    Raises:
        StepFailure: with the reason.
        NoEquilibrium: with the reason.
        InputError: the cell completed with a wrong answer.
    """
    scene = case.split()[0]
    answer = SCENES[scene](comm, **(ORDINARY[scene] | arguments(case)))
    error = abs(answer.value / answer.exact - 1)
    run = answer.run
    energy = abs(run.energy_error) if run is not None else 0.0
    check(
        error <= answer.tolerance and energy <= ENERGY,
        f"Cell '{case}' has a wrong result without an error: {answer.value:.9g} for "
        f"{answer.exact:.9g}, off by {error:.1e} > {answer.tolerance:.1e}; energy off by "
        f"{energy:.1e}.",
    )
    return {
        "error": error,
        "iterations": run.iterations / run.step if run is not None else 0.0,
        "substeps": run.substeps if run is not None else 0,
        "energy_error": energy,
        "seconds": run.seconds if run is not None else 0.0,
    }


STUDY = Study(
    "extremes",
    "Extreme numbers in scenes whose answers are known",
    problem,
    {"case": cases()},
    lambda case: 1.0,
    quick={"case": ["bounce", "crease", "top", "tanks", "heat", "scale"]},
    shows=("error",),
    limits={"energy_error": ENERGY},
    columns="error, iterations, substeps, energy_error, seconds",
    # Errors are far below the tolerances of the scenes, some at round-off.
    not_repeatable={"error": "judged by the tolerance of its scene"},
    may_fail=True,
    expected_warnings={
        "is unusual": "numbers far from ordinary are what the study is about",
        **ROUND_OFF,
    },
    draw=draw,
)
