"""Tapes on films against a closed form, and their mass and conservation.

A strip of film with a tape of the same strain, free to contract, has one stress in each, so that
the force is that of two bars of St. Venant-Kirchhoff's law side by side: N = λ (E1 t b + E2 A2)(λ²
- 1)/2.
"""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.arrays import mesh_of_arrays
from gossamer_fx.meshes.sheet import sheet
from tests.small_scenes import at_rest

COMM = MPI.COMM_WORLD
WIDTH = 0.1
LENGTH = 0.5
STRETCH = 1.01
FILM = gx.Linear(E=2.3e9, nu=0.3, density=1400.0, thickness=2e-5)
TAPE = gx.CableLaw(EA=6000.0, line_density=0.01)


def strip(order: int, **more) -> gx.Membrane:
    return gx.Membrane(sheet(COMM, 5, 2, LENGTH, WIDTH), FILM, order=order, **more)


def on_edge(film: gx.Membrane) -> gx.connectors.Tape:
    return gx.connectors.Tape.along_edges(film, TAPE, edges="bottom")


def across(film: gx.Membrane) -> gx.connectors.Tape:
    """Not on the edges of the mesh."""
    return gx.connectors.Tape.through(
        film,
        TAPE,
        points=[(0, 0.03, 0), (LENGTH, 0.03, 0)],
        bars_per_segment=7,
    )


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("tape", [on_edge, across])
def test_strip_and_tape_share_the_force(tape, order: int) -> None:
    """N = λ (E1 t b + E2 A2)(λ² - 1)/2 of a strip whose sides are free to contract."""
    contraction = np.sqrt(1 - FILM.nu * (STRETCH**2 - 1)) - 1
    film = strip(
        order,
        displacement=lambda x: np.vstack([(STRETCH - 1) * x[0], contraction * x[1], 0 * x[2]]),
    )
    ends = [
        gx.Fixed(film, "left", components=(0, 2)),
        gx.Fixed(film, "right", components=(0, 2)),
        gx.Fixed(film, "bottom left", components=(1,)),
    ]
    statics = at_rest(tape(film), *ends)
    system = statics.system
    x = system.unknowns.q0.array_r.reshape(-1, 3)[:, 0]
    forces = np.zeros(x.size * 3)
    forces[system.unknowns.supports.held] = system.unknowns.supports.reactions
    right = forces.reshape(-1, 3)[x > LENGTH, 0].sum()
    assert abs(right) == pytest.approx(107.5953, rel=2e-3)


@pytest.mark.mpi(1)
@pytest.mark.parametrize("tape", [on_edge, across])
def test_taped_film_conserves(tape) -> None:
    film = strip(1, velocity=lambda x: np.vstack([3 * x[1], -3 * x[0], np.sin(8 * x[0])]))
    run = gx.Simulation(gx.Scene(tape(film)), gx.Midpoint(dt=1e-3))
    mass = FILM.density * FILM.thickness * LENGTH * WIDTH + TAPE.line_density * LENGTH
    y = WIDTH * FILM.density * FILM.thickness * LENGTH * WIDTH / 2
    y += TAPE.line_density * LENGTH * (0.0 if tape is on_edge else 0.03)
    assert run.first.momentum[0] == pytest.approx(3 * y, rel=1e-10)
    assert run.first.momentum[1] == pytest.approx(-3 * mass * LENGTH / 2, rel=1e-10)
    run.run(until=0.05)
    assert abs(run.energy_error) < 1e-10
    assert run.totals.angular_momentum == pytest.approx(run.first.angular_momentum, abs=1e-12)
    assert run.totals.stored["tape"] > 0


def test_a_group_without_edges_cannot_hold_a_tape(comm) -> None:
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    groups = {"empty": np.zeros((0, 2), dtype=np.int64)}
    film = gx.Membrane(mesh_of_arrays(comm, lambda: (points, triangles, groups)), FILM)
    with pytest.raises(gx.InputError, match="'empty' has no edges of the mesh"):
        gx.connectors.Tape.along_edges(film, TAPE, edges="empty")
