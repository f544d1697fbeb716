"""Balances of plates: bending conserves energy, and the work of a turning clamp counts as
supplied."""

from __future__ import annotations

import math

import numpy as np
import pytest

import gossamer_fx as gx
from demos.studies import tape_spring
from gossamer_fx.meshes.plates import irregular_sheet
from gossamer_fx.meshes.sheet import sheet
from tests.small_scenes import momentum_changes, run_of, run_until

LAW = gx.Linear(E=1e9, nu=0.3, density=1000.0, thickness=1e-3)
TIGHT = gx.Tolerances(relative=1e-12)


def thrown(X):
    """A spin of 2 rad/s with waves across."""
    return np.stack([2 * (X[1] - 0.07), -2 * (X[0] - 0.3), 0.5 * np.sin(8 * X[0]) * (1 + 5 * X[1])])


def assert_kept(run: gx.Simulation) -> None:
    """Energy, momentum and angular momentum are those of the start of steps solved to 1e-12."""
    assert run.totals.stored["plate bending"] > 1e-6 and run.substeps == 0
    # Relative to the energy of the throw.
    assert abs(run.totals.energy - run.first.energy) < 1e-9 * run.first.kinetic
    changes = momentum_changes(run)
    assert max(changes) < 1e-10 * np.abs(run.first.angular_momentum).max()


@pytest.mark.mpi(1)
@pytest.mark.parametrize("hinges", [(), ("middle",)])
@pytest.mark.parametrize("rest", [None, np.diag([3.0, 0.0, 0.0])])
def test_a_thrown_plate_keeps_energy_and_both_momenta(comm, rest, hinges):
    plate = gx.Plate(
        irregular_sheet(comm, 8, 2, 0.6, 0.15),
        LAW,
        rest_curvature=rest,
        hinges=hinges,
        velocity=thrown,
    )
    run = run_of(plate, dt=2e-4, tolerances=TIGHT)
    measured = run.totals.stored["plate bending"]
    # D κ²/2 times the area, D = E t³/12(1 - ν²) with 1 - ν² = 0.91, κ = 3 1/m, 0.6 m × 0.15 m.
    expected = 0.0 if rest is None else LAW.E * LAW.thickness**3 / 12 / 0.91 * 9 * 0.09 / 2
    assert measured == pytest.approx(expected, rel=1e-9, abs=1e-12)
    run.run(until=0.02)
    assert_kept(run)


@pytest.mark.mpi(1)
def test_a_thrown_shell_keeps_energy_and_both_momenta(comm):
    mesh = sheet(comm, 8, 2, 0.6, 0.15, crossed=True, order=2)
    x, y, _ = mesh.domain.geometry.x.T
    mesh.domain.geometry.x[:, 2] = x**2 - 2 * y**2
    plate = gx.Plate(mesh, LAW, velocity=thrown)
    assert_kept(run_until(0.01, plate, dt=2e-4, tolerances=TIGHT))


def test_a_clamp_that_turns_supplies_the_energy_of_the_plate(comm):
    def direction(X, t):
        angle = math.sin(40 * t)
        return np.stack([math.cos(angle) + 0 * X[0], 0 * X[0], math.sin(angle) + 0 * X[0]])

    plate = gx.Plate(sheet(comm, 6, 1, 0.3, 0.05), LAW)
    clamp = gx.Fixed(plate, "left", rotation=True, direction=direction)
    run = run_until(0.03, plate, clamp, dt=5e-4, tolerances=TIGHT)
    # The clamp's work must matter.
    assert run.totals.supplied > 1e-4 and run.totals.kinetic > 1e-4
    assert abs(run.energy_error) < 1e-9


def test_an_edge_moment_supplies_what_the_plate_gains(comm):
    plate = gx.Plate(sheet(comm, 6, 1, 0.3, 0.05), LAW)
    moment = gx.loads.EdgeMoment(plate, "right", moment=lambda t: 0.02 * math.sin(60 * t))
    held = gx.Fixed(plate, "left", rotation=True)
    run = run_until(0.03, plate, held, moment, dt=5e-4, tolerances=TIGHT)
    assert abs(run.totals.supplied) > 1e-6 and abs(run.energy_error) < 1e-9


def test_a_tape_spring_snaps_and_keeps_its_energy(comm):
    """A steel strip curved across; bent backwards fast, its middle flattens at once and folds."""
    length = 0.12
    width = tape_spring.WIDTH

    def bent(X):
        """Ends up, middle down, and a turn about y, so that there is angular momentum."""
        s = 2 * X[0] / length - 1
        return np.stack([20 * X[2], 0 * s, 25 * (s**2 - 1 / 3) - 20 * (X[0] - length / 2)])

    tape = tape_spring.tape_of(comm, length, 12, 4, velocity=bent)
    run = run_of(tape, dt=1e-5, tolerances=TIGHT)
    first = run.totals
    # Squared chord of the curved section; flattened it becomes the square of the width.
    at_rest = 4 * tape_spring.RADIUS**2 * math.sin(tape_spring.ANGLE / 2) ** 2
    run.run(until=5e-4)
    X = tape.space.tabulate_dof_coordinates()
    y = run.system.unknowns.q0.array_r.reshape(-1, 3)
    corners = [
        y[k]
        for k in range(len(y))
        if abs(X[k, 0] - length / 2) < 1e-9 and X[k, 1] * (width - X[k, 1]) < 1e-12
    ]
    ends = [p for part in comm.allgather(corners) for p in part]
    across = float(((ends[0] - ends[1]) ** 2).sum())
    # 0.87 and 0.98: the middle is clearly curved at the start, and nearly flat in the fold.
    assert at_rest < 0.87 * width**2 and across > 0.98 * width**2
    error = abs(run.totals.energy - first.energy)
    assert error < 1e-9 * first.kinetic
    assert run.totals.angular_momentum == pytest.approx(
        first.angular_momentum, abs=1e-10 * np.abs(first.angular_momentum).max()
    )
