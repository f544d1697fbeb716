"""Energy and momenta of films that switch their state, with loads, supports, damping and gas."""

from __future__ import annotations

import csv
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mpi4py import MPI

import gossamer_fx as gx
from demos.films import spinning_sheet
from demos.inflatables import inflate_tube
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.meshes.tube import flat_tube
from gossamer_fx.records.outputs.output import Output
from gossamer_fx.records.outputs.run_file import read_run_file
from tests.small_scenes import run_until

LAW = gx.Miyazaki(E=1e9, nu=0.3, density=1400.0, thickness=1e-4)
SHEET = sheet(MPI.COMM_WORLD, 5, 5)


@pytest.mark.mpi(1)
@pytest.mark.parametrize(
    "order, n, dt, steps", [(1, 8, 1e-3, 60), (2, 4, 1e-3, 40), (1, 8, 4e-3, 30)]
)
def test_free_sheet(order: int, n: int, dt: float, steps: int) -> None:
    drift = spinning_sheet.main(n=n, dt=dt, steps=steps, order=order)
    assert drift["energy_drift"] < 1e-10
    assert drift["linear_momentum_drift"] < 1e-12
    assert drift["angular_momentum_drift"] < 1e-12


def test_tube_deployed_from_a_tank(comm, folder: Path) -> None:
    seen = inflate_tube.main(cells=4, until=4e-3, dt=2e-4, output=folder)
    assert seen["energy_error"] < 1e-9
    assert seen["mass_error"] < 1e-12
    assert seen["volume"] > 1e-3
    comm.barrier()  # rank 0 writes the picture
    for name in ("ledger.csv", "gas.csv", "tube.png", "fields/film.pvd", "run.json"):
        assert (folder / name).exists()


def test_gas_keeps_the_momenta_of_a_free_film(comm) -> None:
    """A closed film in tumbling flight, filled from a tank: the gas pushes on itself only."""
    gas = gx.IdealGas(gamma=1.4, R=296.8)
    spin = np.array([3.0, -2.0, 5.0])
    film = gx.Membrane(
        flat_tube(comm, 0.2, 0.06, 4),
        LAW,
        velocity=lambda x: np.cross(spin, x.T).T + np.array([[1.0], [2.0], [3.0]]),
    )
    bag = gx.Chamber(film, gas=gas, pressure=10.0, temperature=293.0, dead_volume=1e-6, name="bag")
    tank = gx.Tank(1e-5, gas=gas, pressure=1e5, temperature=293.0)
    run = run_until(1e-2, film, bag, gx.Orifice(tank, bag, area=1e-7), dt=2e-4)
    first = run.first
    last = run.totals
    # 50 steps in which the gas flows in: the film must move by the gas alone.
    assert abs(run.energy_error) < 1e-12
    error = np.abs(last.momentum - first.momentum).max()
    assert error < 1e-12 * np.abs(first.momentum).max()
    error = np.abs(last.angular_momentum - first.angular_momentum).max()
    assert error < 1e-11 * np.abs(first.angular_momentum).max()


def test_loads_supports_and_damping_are_booked(comm) -> None:
    film = gx.Membrane(sheet(comm, 6, 6), LAW)
    scene = gx.Scene(
        film,
        gx.Fixed(film, "left"),
        gx.Gravity(film, (0.5, 0.0, -9.81)),
        gx.Pressure(film, lambda t: -2.0 * np.sin(50 * t)),
        gx.Damping(film, mass_factor=2.0, stiffness_factor=1e-5),
    )
    run = gx.Simulation(scene, gx.Midpoint(dt=2e-3))
    run.run(until=0.06)
    # Loads and damping must act, or a closed ledger means nothing.
    assert run.totals.supplied > 1e-2
    assert run.totals.dissipated > 1e-4
    assert abs(run.energy_error) < 1e-10


@pytest.mark.mpi
def test_the_error_is_over_the_largest_energy_also_if_nobody_looked(comm) -> None:
    """A mass falls on a spring and comes back to rest, where its energies and flows are almost zero
    again."""

    def fall(*outputs: Output) -> gx.Simulation:
        mass = gx.PointMass(2.0, position=(0.0, 0.0, -1.0), comm=comm)
        spring = gx.connectors.Spring(
            mass.port(),
            gx.Ground((0, 0, 0)),
            stiffness=100.0,
            length=1.0,
        )
        scene = gx.Scene(spring, gx.Gravity(mass, (0.0, 0.0, -9.81)))
        run = gx.Simulation(scene, gx.Midpoint(dt=5e-3), outputs=outputs)
        # One period 2π √(m/k): the mass is at rest at its start again.
        run.run(until=2 * np.pi * (2.0 / 100.0) ** 0.5)
        return run

    errors = gx.Series({"error": lambda run: run.energy_error, "size": lambda run: run.totals.size})
    watched = fall(errors)
    alone = fall()
    # At the end the energies are almost zero, below 1 % of the largest.
    assert alone.totals.size < 1e-2 * errors["size"].max()
    assert alone.energy_error == errors["error"][-1] == watched.energy_error != 0


@settings(max_examples=5)
@given(st.lists(st.floats(1e-4, 3e-3), min_size=3, max_size=8))
def test_any_sequence_of_steps(steps: list[float]) -> None:
    run = gx.Simulation(
        gx.Scene(gx.Membrane(SHEET, LAW, velocity=spinning_sheet.throw)), gx.Midpoint(dt=1e-3)
    )
    for h in steps:
        run._advance(h)
    assert abs(run.energy_error) < 1e-11
    # Mass of 0.14 kg at some m/s: 1e-12 is round-off.
    assert np.allclose(run.totals.angular_momentum, run.first.angular_momentum, rtol=0, atol=1e-12)


@pytest.mark.mpi
def test_a_step_that_fails_says_where_and_leaves_the_ledger(comm, folder: Path) -> None:
    """One Newton iteration is not enough once the film flutters; the rows up to there are on
    file."""
    film = gx.Membrane(sheet(comm, 6, 6), LAW, velocity=spinning_sheet.throw)
    stepper = gx.Midpoint(dt=2e-3, tolerances=gx.Tolerances(max_iterations=3))
    run = gx.Simulation(
        gx.Scene(film),
        stepper,
        outputs=[gx.Ledger(folder / "ledger.csv")],
        # The first step of the flutter needs more than three iterations, once halved too.
        halvings=1,
    )
    with pytest.raises(gx.StepFailure) as caught:
        run.run(until=1.0)
    message = str(caught.value)
    assert "The step " in message and f"t = {run.time:.9g} s" in message
    assert "iterations" in message and "'film' at the node" in message
    if comm.rank == 0:
        rows = list(csv.DictReader((folder / "ledger.csv").open()))
        assert len(rows) == run.step + 1
        assert float(rows[-1]["time"]) == pytest.approx(run.time)


def test_a_run_that_goes_on_continues_the_ledger(folder: Path) -> None:
    run = run_until(0.2, gx.PointMass(1.0), dt=0.1, outputs=[gx.Ledger(folder / "ledger.csv")])
    run.run(until=0.5)
    times = [float(row["time"]) for row in csv.DictReader((folder / "ledger.csv").open())]
    assert np.allclose(times, np.arange(6) * 0.1)


def test_a_film_at_rest_is_said_to_be_at_rest(comm, folder: Path) -> None:
    film = gx.Membrane(sheet(comm, 6, 6), LAW)
    words = StringIO()
    recording = gx.Recording(folder)
    outputs = [recording, gx.outputs.Progress(words, seconds=0.0)]
    run = run_until(0.03, film, gx.Fixed(film, "left"), dt=1e-3, outputs=outputs)
    # what there is, is round-off, of which any share is without meaning
    # Round-off of 36 cells: squares of 1e-16 times the stiffness.
    assert 0 < run.totals.energy < 1e-20
    assert run.at_rest
    assert run.energy_error == 0
    comm.barrier()
    about = read_run_file(folder)
    assert about["statistics"]["at rest"] is True
    assert about["statistics"]["energy error"] == 0
    if comm.rank == 0:
        assert words.getvalue().count("at rest") >= 2
        assert "energy closes to" not in words.getvalue()
        gx.write_report(gx.plot.RunReader(folder), folder / "report.html")
        assert "steps, at rest" in (folder / "report.html").read_text(encoding="utf-8")


def test_a_film_that_hardly_moves_is_not_at_rest(comm) -> None:
    """A strain of 1e-10 is far below all that is computed, and far above round-off."""
    film = gx.Membrane(sheet(comm, 6, 6), LAW, displacement=lambda X: 1e-10 * X)
    run = run_until(0.03, film, dt=1e-3)
    assert not run.at_rest
    # 1e-10 of strain leaves 6 digits of the energy above round-off.
    assert 0 < abs(run.energy_error) < 1e-2


def test_a_restart_of_a_film_at_rest_stays_at_rest(folder: Path) -> None:
    def simulation(restart: Path | None) -> gx.Simulation:
        film = gx.Membrane(SHEET, LAW)
        return gx.Simulation(
            gx.Scene(film, gx.Fixed(film, "left")),
            gx.Midpoint(dt=1e-3),
            checkpoints=gx.Checkpoints(folder),
            restart=restart,
        )

    simulation(None).run(until=0.01)
    again = simulation(folder)
    assert again.totals.energy > 0
    assert again.at_rest
