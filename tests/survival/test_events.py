"""Events: located within a step, met exactly, acted upon once."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from mpi4py import MPI

import gossamer_fx as gx
from tests.small_scenes import run_until
from tests.survival.scenes import GAS, filled_tube, fluttering_sheet

COMM = MPI.COMM_WORLD


def falling() -> tuple[gx.PointMass, gx.Scene]:
    """z = 1 - g t²/2, which the midpoint rule meets exactly."""
    mass = gx.PointMass(2.0, position=(0.0, 0.0, 1.0), comm=MPI.COMM_SELF)
    return mass, gx.Scene(mass, gx.Gravity(mass, (0.0, 0.0, -9.81)))


@pytest.mark.parametrize("control", [None, gx.StepControl(max_step=0.1)])
@pytest.mark.parametrize("height", [0.999, 0.5, 0.05])
def test_a_fall_ends_at_its_height(height: float, control: gx.StepControl | None) -> None:
    mass, scene = falling()
    event = gx.When(
        gx.probes.Position(mass.port(), "z"),
        height,
        falling=True,
        stop=True,
        tolerance=1e-12,
    )
    run = gx.Simulation(scene, gx.Midpoint(dt=0.04), events=[event], control=control)
    run.run(until=10.0)
    assert run.time == pytest.approx(math.sqrt(2 * (1 - height) / 9.81), abs=1e-11)
    assert run.system.unknowns.q0.array_r[2] <= height
    assert abs(run.energy_error) <= 1e-13


def test_a_word_that_is_true_or_false_is_located_too() -> None:
    """Of a valve that opens at 0.0123 s nothing can be interpolated: bisection finds it."""
    _, scene = falling()
    run = gx.Simulation(
        scene,
        gx.Midpoint(dt=0.01),
        events=[gx.When(lambda run: run.time >= 0.0123, stop=True, tolerance=1e-9)],
    )
    run.run(until=1.0)
    assert 0.0123 <= run.time <= 0.0123 + 1e-9


@pytest.mark.mpi
def test_the_first_of_two_events_in_a_step_comes_first() -> None:
    _, scene = falling()
    told: list[str] = []

    def log(name: str):
        return lambda run: told.append(f"{name} {run.time:.6f}")

    events = [
        gx.When(lambda run: run.time, 0.07, then=log("late")),
        gx.At(0.05, then=log("at")),
        gx.When(lambda run: run.time, 0.02, then=log("early")),
    ]
    run = gx.Simulation(scene, gx.Midpoint(dt=0.1), events=events)
    run.run(until=0.3)
    assert told == ["early 0.020000", "at 0.050000", "late 0.070000"]
    assert run.time == 0.3


@pytest.mark.mpi
def test_pressure_opens_a_valve() -> None:
    """A tank fills a bottle; at 1.2 bar a second orifice is opened.  Mass and energy are kept
    through the event."""
    opened = []
    tank = gx.Tank(1e-3, gas=GAS, pressure=5e5, temperature=300.0, name="tank")
    bottle = gx.Tank(2e-3, gas=GAS, pressure=1e5, temperature=300.0, name="bottle")
    outside = gx.gas.Ambient(0.0, 300.0)
    filling = gx.Orifice(tank, bottle, area=3e-6, name="filling")
    relief = gx.Orifice(bottle, outside, area=lambda t: 1e-6 if opened else 0.0, name="relief")
    event = gx.When(
        gx.probes.GasState(bottle, "pressure"),
        1.2e5,
        then=lambda run: opened.append(run.time),
        name="relief",
    )
    run = run_until(0.2, tank, bottle, filling, relief, dt=5e-3, events=[event])
    assert len(opened) == 1 and 0 < opened[0] < 0.2
    assert run.chamber("bottle").pressure < 2e5
    assert abs(run.energy_error) <= 1e-13 and abs(run.mass_error) <= 1e-13


@pytest.mark.mpi
def test_conservation_through_events_of_film_and_gas() -> None:
    scene = filled_tube(COMM)
    tube = next(item for item in scene.items if item.name == "tube")
    events = [
        gx.When(gx.probes.GasState(tube, "pressure"), 5.0 + k, name=f"{5 + k} Pa") for k in range(6)
    ]
    run = gx.Simulation(scene, gx.Midpoint(dt=5e-4), events=events)
    run.run(until=2e-3)
    plain = gx.Simulation(filled_tube(COMM), gx.Midpoint(dt=5e-4))
    plain.run(until=2e-3)
    assert run.step > plain.step
    assert abs(run.energy_error) <= 1e-11 and abs(run.mass_error) <= 1e-14


@pytest.mark.mpi
def test_after_a_restart_an_event_does_not_happen_again_but_acts(folder: Path) -> None:
    acted: list[float] = []
    event = gx.When(lambda run: run.time, 1.5e-3, then=lambda run: acted.append(run.time))

    def go(until: float, **options: object) -> gx.Simulation:
        run = gx.Simulation(fluttering_sheet(COMM), gx.Midpoint(dt=1e-3), events=[event], **options)
        run.run(until=until)
        return run

    first = go(3e-3, checkpoints=gx.Checkpoints(folder))
    assert acted == pytest.approx([1.5e-3], abs=2e-9)
    again = go(5e-3, restart=folder)
    assert acted == pytest.approx([1.5e-3, 3e-3], abs=2e-9)
    assert (first.step, again.step) == (4, 6)


@pytest.mark.mpi(1)
@pytest.mark.parametrize(
    ("event", "words"),
    [
        (
            lambda: gx.When(lambda run: float("nan"), name="bad"),
            "When 'bad' at t = 0 s: it returns nan",
        ),
        (lambda: gx.When(lambda run: 1 / 0, name="bad"), "it raises ZeroDivisionError"),
    ],
)
def test_bad_events_are_named(event, words: str) -> None:
    with pytest.raises(gx.InputError, match=words):
        gx.Simulation(fluttering_sheet(COMM, 2), gx.Midpoint(dt=1e-3), events=[event()])
