"""Cables with a measured law: exact potential and averages, conservation, tangents, and bad
tables."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.mechanics.bodies.piecewise_force import tabulated_bar
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet
from tests.rows import step_of
from tests.small_scenes import at_rest

COMM = MPI.COMM_WORLD
# Soft and hard in tension, with a plateau, and soft in compression beyond -1 %.
STRAIN = np.array([-0.05, -0.01, 0.0, 0.01, 0.02, 0.06])
FORCE = np.array([-6.0, -4.0, 0.0, 10.0, 10.0, 70.0])
MEASURED = gx.TabulatedCable(STRAIN, FORCE, line_density=0.1)


def strain_measure(x: np.ndarray) -> np.ndarray:
    """ε = ½(λ² - 1) as a column, of engineering strains x."""
    return (((1 + x) ** 2 - 1) / 2)[:, None]


def test_force_goes_through_the_points_and_on_with_the_last_slopes() -> None:
    assert MEASURED.force_at(STRAIN) == pytest.approx(FORCE, abs=1e-12)
    assert MEASURED.force_at(np.array([0.08, -0.09])) == pytest.approx([100.0, -8.0], abs=1e-12)
    error = abs(MEASURED.EA / 1000.0 - 1)
    assert error < 1e-12


def test_potential_is_the_integral_of_the_force() -> None:
    """W by trapezia between the points, which are exact there."""
    at = np.sort(np.concatenate([STRAIN, np.linspace(-0.08, 0.09, 40)]))
    force = MEASURED.force_at(at)
    work = np.concatenate([[0.0], np.cumsum(np.diff(at) * (force[1:] + force[:-1]) / 2)])
    work -= work[at == 0][0]
    assert MEASURED.corners.energy(at) == pytest.approx(work, abs=1e-13)


def test_average_does_the_change_of_the_potential() -> None:
    """S Δε = ΔW for any two strains, and dS/dε1 agrees with differences."""
    random = np.random.default_rng(3)
    x0, x1 = random.uniform(-0.08, 0.09, (2, 20000))
    numbers = {"length": 1.3} | MEASURED.corners.as_numbers()
    e0 = strain_measure(x0)
    e1 = strain_measure(x1)
    step = step_of(tabulated_bar, e0, e1, numbers)
    back = step_of(tabulated_bar, e1, e0, numbers)
    work = step.S[:, 0] * (e1 - e0)[:, 0]
    assert work == pytest.approx(step.energy - back.energy, abs=1e-13)
    δ = 1e-7
    ahead = step_of(tabulated_bar, e0, e1 + δ, numbers).S
    behind = step_of(tabulated_bar, e0, e1 - δ, numbers).S
    difference = (ahead - behind)[:, 0] / (2 * δ)
    # Averages of a piecewise linear force have no corner themselves, unless the path has no length.
    far = np.abs(x1 - x0) > 1e-3
    assert difference[far] == pytest.approx(step.dS[far, 0, 0], abs=1e-2)


def test_two_points_are_a_rope_and_three_a_bar() -> None:
    rope = gx.TabulatedCable([0.0, 1.0], [0.0, 50.0], line_density=1.0)
    bar = gx.TabulatedCable([-0.5, 0.0, 1.0], [-25.0, 0.0, 50.0], line_density=1.0)
    x = np.linspace(-0.4, 2.0, 13)
    assert rope.force_at(x) == pytest.approx(50.0 * np.maximum(x, 0))
    assert bar.force_at(x) == pytest.approx(50.0 * x)


@pytest.mark.parametrize("order", [1, 2])
def test_a_string_thrown_through_its_corners_conserves(order: int) -> None:
    """1000 steps, in which its elements pass all corners of the table."""
    string = gx.Cable(
        line(COMM, [(0, 0, 0), (1, 0, 0)], 6),
        MEASURED,
        order=order,
        displacement=lambda X: np.vstack([0.03 * np.sin(5 * X[0]), 0 * X[0], 0 * X[0]]),
        velocity=lambda X: np.vstack([np.cos(9 * X[0]), 3 * X[0], np.sin(7 * X[0])]),
    )
    run = gx.Simulation(gx.Scene(string), gx.Midpoint(dt=1e-3))
    seen = []
    for _ in range(20):
        run.run(until=run.time + 0.05)
        seen.append(string_strains(run, string, order))
    now = run.totals
    assert abs(run.energy_error) < 1e-10
    assert now.momentum == pytest.approx(run.first.momentum, abs=1e-11)
    assert now.angular_momentum == pytest.approx(run.first.angular_momentum, abs=1e-11)
    assert min(map(np.min, seen)) < -0.01
    assert max(map(np.max, seen)) > 0.02


def string_strains(run: gx.Simulation, string: gx.Cable, order: int) -> np.ndarray:
    """Engineering strains of the chords between the nodes."""
    x = run.system.unknowns.state[string].gathered()
    X = np.concatenate(COMM.allgather(own_points(string)))
    walk = np.argsort(X[:, 0])
    chords = np.linalg.norm(np.diff(x[walk], axis=0), axis=1)
    return chords * 6 * order - 1


def own_points(body: gx.Cable) -> np.ndarray:
    return body.space.tabulate_dof_coordinates()[: body.block.index_map.size_local]


@pytest.mark.mpi
def test_a_pendulum_hangs_at_the_measured_strain() -> None:
    """A mass of 2 kg under 10 m/s² on a light rope of the table: 20 N at 2.667 %."""
    law = gx.TabulatedCable(STRAIN, FORCE, line_density=1e-9)
    rope = gx.Cable(line(COMM, [(0, 0, 0), (0, 0, -1)], 2), law)
    mass = gx.PointMass(2.0, (0.0, 0.0, -1.0), comm=COMM)
    scene = gx.Scene(
        rope,
        gx.Fixed(rope, "start"),
        gx.constraints.BallJoint(mass.port(), rope.port("end")),
        gx.Gravity(mass, (0, 0, -10.0)),
    )
    statics = gx.Equilibrium(scene)
    statics.find()
    height = statics.system.unknowns.state.vector(mass.port())[2]
    assert height == pytest.approx(-1 - 0.02 - 10 / 1500, abs=1e-9)


def test_a_tape_with_a_table_bears_what_the_cable_bears() -> None:
    """A slack film of no stiffness to speak of, with a tape along its edge, pulled by 2 %."""
    film = gx.Membrane(
        sheet(COMM, 4, 2, 0.5, 0.1),
        gx.TensionField(E=1.0, nu=0.0, density=1.0, thickness=1e-6),
        displacement=lambda X: np.vstack([0.03 * X[0], 0 * X[0], 0 * X[0]]),
    )
    tape = gx.connectors.Tape.along_edges(film, MEASURED, edges="bottom")
    ends = [gx.Fixed(film, edge) for edge in ("left", "right")]
    statics = at_rest(film, tape, *ends)
    force, _ = statics.reaction(ends[1])
    assert force[0] == pytest.approx(MEASURED.force_at(np.array(0.03)), rel=1e-6)
    stored = statics.result.totals.stored["tape"]
    assert stored == pytest.approx(0.5 * MEASURED.corners.energy(np.array(0.03)), rel=1e-9)


@pytest.mark.parametrize(
    ("strain", "force", "words"),
    [
        ([0.0, 0.1, 0.1], [0.0, 1.0, 2.0], "whose number 3 does not fit"),
        (
            [0.0, 0.1, 0.2],
            [0.0, 2.0, 1.0],
            r"force is \[0\.0, 2\.0, 1\.0\], whose number 3 does not fit",
        ),
        ([0.0, 0.1], [0.0, 1.0, 2.0], "strain has 2 and force has 3 entries"),
        ([-1.2, 0.1], [-1.0, 1.0], "the strains go from -1.2"),
        ([0.1, 0.2], [0.0, 1.0], "the strains go from 0.1"),
        ([0.0, 0.2], [1.0, 2.0], "force at zero strain is 1 N"),
        ([0.0, 0.1, 0.2], [0.0, 0.0, 2.0], "force is zero up to the strain 0.1"),
    ],
)
def test_bad_tables_are_refused(strain: list[float], force: list[float], words: str) -> None:
    with pytest.raises(gx.InputError, match=words):
        gx.TabulatedCable(strain, force, line_density=0.1)
