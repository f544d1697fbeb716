"""Reduced plates: bending in closed forms, compared with the whole plate, and conservation."""

from __future__ import annotations

import re

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import sheet
from tests.small_scenes import momentum_changes

COMM = MPI.COMM_WORLD
SIDE = 2.0  # m
SPIN = 1.0  # rad/s
THICKNESS = 1e-2  # of the plate of the closed forms [m]
LAW = gx.Linear(E=2e9, nu=0.3, density=1400.0, thickness=THICKNESS)
FILM = gx.Miyazaki(E=2e9, nu=0.3, density=1400.0, thickness=2e-4)
STIFFNESS = LAW.E * THICKNESS**3 / (12 * (1 - LAW.nu**2))  # D [N m]
# A plate that is free of moments as a saddle [1/m].
CURVED = np.diag((0.05, -0.02, 0.0))
CORNERS = [(x, y, 0.0) for x in (0.0, SIDE) for y in (0.0, SIDE)]


def plate(cells: int, law=FILM, spin: float = SPIN, **options) -> gx.Plate:
    """A square that spins about its middle and swings out of its plane."""

    def velocity(X: np.ndarray) -> np.ndarray:
        x = X[0] - SIDE / 2
        y = X[1] - SIDE / 2
        return spin * np.stack([-y, x, 0.1 * x * y])

    return gx.Plate(sheet(COMM, cells, cells, SIDE, SIDE), law, velocity=velocity, **options)


def noise(film: gx.Plate, count: int) -> gx.reduction.Snapshots:
    """Random shapes: with as many as nodes they span all motions."""
    shapes = gx.reduction.Snapshots(film)
    random = np.random.default_rng(3 + COMM.rank)
    nodes = film.space.dofmap.index_map.size_local
    shapes.positions += [random.standard_normal((nodes, 3)) for _ in range(count)]
    return shapes


def twisted(film: gx.Plate) -> gx.reduction.Snapshots:
    """The shape z = xy, of which the plate has uniform twist."""
    shapes = gx.reduction.Snapshots(film)
    X = film.space.tabulate_dof_coordinates()[: film.space.dofmap.index_map.size_local]
    shapes.positions.append(X + np.outer(X[:, 0] * X[:, 1], [0.0, 0.0, 1.0]))
    return shapes


def held(film: gx.Plate, corners: list[tuple[float, float, float]]) -> list:
    """Ball joints of these corners of the plate to the ground."""
    found = []
    for k, corner in enumerate(corners):
        ground = gx.ground_frame(corner).origin
        found.append(gx.constraints.BallJoint(film.port_at(corner), ground, name=f"corner {k}"))
    return found


@pytest.fixture(scope="module")
def recorded() -> tuple[gx.Plate, gx.reduction.Snapshots]:
    film = plate(4, rest_curvature=CURVED)
    shapes = gx.reduction.Snapshots(film)
    gx.Simulation(gx.Scene(film), gx.Midpoint(dt=0.04), outputs=[shapes]).run(until=0.4)
    return film, shapes


@pytest.mark.parametrize("rest", [None, CURVED])
def test_with_all_modes_it_is_the_plate(rest) -> None:
    film = plate(2, rest_curvature=rest)
    nodes = film.space.dofmap.index_map.size_global
    # 1, X and Y are modes without recordings.
    reduced = gx.reduction.reduce(film, [noise(film, nodes)], modes=nodes - 3)
    shapes = []
    for body in (film, reduced):
        run = gx.Simulation(gx.Scene(body), gx.Midpoint(dt=0.02))
        run.run(until=0.2)
        assert abs(run.energy_error) < 1e-12
        shapes.append(run.system.unknowns.q0.array_r.reshape(-1, 3).copy())
    assert run.totals.stored["plate bending"] > 0
    error = np.abs(reduced.basis.values @ shapes[1] - shapes[0]).max()
    # The cubic energy of a rest curvature returns what the gradient in the middle of a step misses
    # by other forces, with a difference of second order in the step.
    assert error < (1e-9 if rest is None else 1e-5)


@pytest.mark.mpi
@pytest.mark.parametrize("cells", [None, 12])
def test_it_conserves_energy_and_momenta(recorded, cells) -> None:
    film, shapes = recorded
    reduced = gx.reduction.reduce(film, [shapes], modes=8, cells=cells)
    run = gx.Simulation(gx.Scene(reduced), gx.Midpoint(dt=0.04))
    run.run(until=0.6)
    assert abs(run.energy_error) < 1e-12
    assert max(momentum_changes(run)) < 1e-12 * np.abs(run.first.angular_momentum).max()
    # Held plane, a plate with this rest curvature has energy; it bends and is strained.
    assert 0 < run.first.stored["plate bending"] != run.totals.stored["plate bending"] > 0
    assert run.totals.stored["plate"] > 0
    # The few sampled cells leave some motions soft.
    assert 0 < gx.reduction.OutsideBasis(reduced)(run) < (1 if cells is None else 10)


@pytest.mark.mpi
def test_the_twist_by_a_force_at_a_corner_is_that_of_the_closed_form() -> None:
    film = plate(3, LAW, spin=0.0)
    reduced = gx.reduction.reduce(film, [twisted(film)], modes=1)
    # It bends by a fiftieth of the thickness, so that its stretch does not matter.
    force = 0.01
    corner = reduced.port_at(CORNERS[3])
    push = gx.loads.Force(corner, (0.0, 0.0, force))
    # Its membrane forces have a round-off of 1e-4 of the load.
    method = gx.analysis.Continuation(tolerance=1e-4)
    search = gx.Equilibrium(gx.Scene(reduced, push, *held(reduced, CORNERS[:3])), method)
    search.find()
    deflection = search.system.unknowns.state.vector(corner)[2]
    # w = F x y/(2 D (1-ν)): the twisting moments of all four corners are the force.
    exact = force * SIDE**2 / (2 * STIFFNESS * (1 - LAW.nu))
    assert deflection == pytest.approx(exact, rel=1e-4)


def test_frequencies_of_a_plate_on_its_corners() -> None:
    film = plate(6, LAW, spin=0.0)
    found = gx.Equilibrium(gx.Scene(film, *held(film, CORNERS)))
    found.find()
    modes = gx.analysis.modes(found, 4)
    shapes = gx.analysis.ModeShapes(film, found, modes=modes, height=1e-3)
    # Without the twist all shapes of the basis that are not plane vanish at the corners.
    reduced = gx.reduction.reduce(film, [shapes, twisted(film)], modes=5)
    again = gx.Equilibrium(gx.Scene(reduced, *held(reduced, CORNERS)))
    again.find()
    frequencies = [mode.frequency for mode in gx.analysis.modes(again, 4)]
    # Its modes are in the basis.
    assert frequencies == pytest.approx([mode.frequency for mode in modes], rel=1e-6)
    # Square on its corners, ν = 0.3: ω a² √(ρt/D) = 7.12 (collected by A. W. Leissa,
    # Vibration of Plates, NASA SP-160, 1969).
    # Point supports converge slowly: 2.8 % more with these cells, 0.7 % with half of their size.
    unit = (STIFFNESS / (LAW.density * THICKNESS)) ** 0.5 / SIDE**2 / (2 * np.pi)
    assert frequencies[0] / unit == pytest.approx(7.12, rel=0.03)


def test_a_curved_plate_is_refused(comm) -> None:
    shell = gx.Plate(sheet(comm, 2, 2), LAW)
    shell.shape = shell.space
    with pytest.raises(gx.InputError, match=re.escape("is curved; give a plate with plane")):
        gx.reduction.reduce(shell, [], modes=1)
