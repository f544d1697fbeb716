"""What a gradient costs: the pass backwards through a run, over the run itself.

`scene` is "sheet", the free sheet that wrinkles, of which the thickness of every cell is a
parameter, or "contact", two films that collide, "friction", the same with friction, or "gas", an
airbag that a tank blows up.
"""

from __future__ import annotations

import time

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.films.spinning_sheet import throw
from gossamer_fx.analysis.sensitivity.transient import TransientGradients
from gossamer_fx.meshes.airbag import airbag
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.presets.gases import NITROGEN

COMM = MPI.COMM_WORLD
THICKNESS = 1e-4  # m


def wrinkling(n: int) -> tuple[gx.Scene, float]:
    """The sheet and its time step [s]."""
    law = gx.Miyazaki(
        1e9,
        0.3,
        density=1400.0,
        thickness=THICKNESS,
        residual_stiffness=1e-3,
    )
    film = gx.Membrane(
        sheet(COMM, n, n),
        law,
        velocity=throw,
        # A field, so that each cell has a parameter.
        properties={"thickness": lambda x: np.full(x.shape[1], THICKNESS)},
    )
    return gx.Scene(film), 1e-3


def colliding(n: int, friction: float = 0.0) -> tuple[gx.Scene, float]:
    """Two films and their time step [s]."""
    law = gx.Linear(1e7, 0.3, density=1400.0, thickness=THICKNESS)
    lower = gx.Membrane(
        sheet(COMM, n, n, 0.2, 0.2),
        law,
        name="lower",
    )
    # No symmetry between the films, and a gap just beyond the distance of contact.
    shift = np.array([[0.011], [0.013], [1.5e-3]])
    film = gx.Membrane(
        sheet(COMM, n, n, 0.2, 0.2),
        law,
        displacement=lambda X: 0 * X + shift,
        velocity=lambda X: np.vstack([0.5 + 0 * X[0], 3 * X[0], X[1] - 2]),
        properties={"thickness": lambda x: np.full(x.shape[1], THICKNESS)},
    )
    # Contact is stiff: the step is twenty times shorter.
    contact = gx.Contact(
        lower, film, distance=1e-3, stiffness=6e6, friction=friction, slip_velocity=0.05
    )
    return gx.Scene(contact), 5e-5


def rubbing(n: int) -> tuple[gx.Scene, float]:
    """The same films with friction."""
    return colliding(n, friction=0.4)


def blown_up(n: int) -> tuple[gx.Scene, float]:
    """A quarter of an airbag, free in space, with a tank, and its time step [s]."""
    law = gx.Miyazaki(
        1e8,
        0.3,
        density=1400.0,
        thickness=THICKNESS,
        residual_stiffness=1e-2,
    )
    film = gx.Membrane(
        airbag(COMM, edge=0.2, cells=n),
        law,
        # Without symmetry, so that no derivative is zero.
        velocity=lambda X: np.vstack([np.sin(15 * X[0]), np.sin(9 * X[1]), np.sin(11 * X[0])]),
        properties={"thickness": lambda x: np.full(x.shape[1], THICKNESS)},
    )
    contents = {"gas": NITROGEN, "temperature": 293.0}
    bag = gx.Chamber(film, pressure=1e3, dead_volume=1e-3, **contents)
    tank = gx.Tank(4e-4, pressure=3e4, **contents)
    return gx.Scene(gx.Orifice(tank, bag, area=5e-5)), 1e-4


SCENES = {"sheet": wrinkling, "contact": colliding, "friction": rubbing, "gas": blown_up}


def gradient(n: int = 20, steps: int = 50, scene: str = "sheet") -> dict[str, float]:
    """The pass backwards over the run, for a scene of `SCENES` of n x n cells."""
    compiled_scene, h = SCENES[scene](n)
    # Gradients are as exact as the steps are solved.
    run = gx.Simulation(compiled_scene, gx.Midpoint(dt=h, tolerances=gx.Tolerances(relative=1e-12)))
    tape = gx.analysis.RunTape(run)
    started = time.process_time()
    run.run(until=steps * h)
    forward = time.process_time() - started

    gradients = TransientGradients(tape, ["film.thickness", "film.initial_velocity"])
    energy = gx.analysis.Energy()
    # The first pass compiles what the derivatives of the result need.
    gradients.of(energy)
    started = time.process_time()
    found = gradients.of(energy)
    backward = time.process_time() - started

    # dE/dv0 = M v0, as energy is conserved from every start; with friction it is not.
    velocity = run.system.unknowns.numbering.vector()
    velocity.array[:] = tape.states[0].v
    momenta = velocity.duplicate()
    run.system.unknowns.M.mult(velocity, momenta)
    film = next(body for body in run.system.unknowns.bodies if body.name == "film")
    exact = momenta.array_r[run.system.unknowns.block(film).owned]
    error = np.abs(found["film.initial_velocity"].values - exact).max() / np.abs(exact).max()
    measured = {
        "cpu": forward,
        "wall": forward,
        "dofs": run.system.unknowns.numbering.size,
        "steps": run.step,
        "Newton/step": run.iterations / run.step,
        "backward [s]": backward,
        "ratio": backward / forward,
        "parameters": sum(len(derivative.values) for derivative in found),
        "tape [MB]": tape.bytes / 2**20,
    }
    if scene != "friction":
        measured["energy's gradient off by"] = float(error)
    return measured
