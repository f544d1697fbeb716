"""Gradients of runs through the history variables of rows: what slips, pays out or is wound in."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.extend import Parameter, PointMeasure, Rows
from tests import own_part
from tests.small_scenes import run_of

# States that are solved to round-off, for differences
SOLVED = gx.Tolerances(relative=1e-13)
SLIDER = own_part.module_of("A spring with friction")


class Slider(SLIDER.SlidingSpring):  # type: ignore[misc, name-defined]
    """The tutorial's spring with friction, with numbers that have gradients."""

    numbers: dict[str, float]

    def terms(self, start: Any) -> Any:
        difference = np.hstack([np.eye(3), -np.eye(3)])
        H = (difference.T @ difference)[None]
        measure = PointMeasure([self.ends], H, np.zeros((1, 6)), np.zeros(1))
        units = {"k": "N/m", "L": "m", "F": "N", "slip": "m"}
        parameters = tuple(Parameter(name, unit, name) for name, unit in units.items())
        given = dict(self.numbers)
        history = {"slip": given.pop("slip")}
        yield Rows(self.name, measure, SLIDER.slider, given, parameters, history)


def on_slider(comm: MPI.Comm, k=100.0, L=1.0, F=2.0, slip=0.0, v=0.8, x=1.01) -> gx.Simulation:
    """It slips forth and back; with x = 1.1 already at the start."""
    mass = gx.PointMass(0.5, (x, 0.0, 0.0), velocity=(v, 0.3, 0.0), name="mass", comm=comm)
    spring = Slider((mass.port(), gx.Ground((0.0, 0.0, 0.0))))
    object.__setattr__(spring, "numbers", {"k": k, "L": L, "F": F, "slip": slip})
    return run_of(mass, spring, dt=5e-3, tolerances=SOLVED)


def on_reel(comm: MPI.Comm, v=2.0, **changes: Any) -> gx.Simulation:
    """A mass that pulls rope from a braked reel, and swings back."""
    given = {"stiffness": 500.0, "length": 0.95, "brake_force": 4.0} | changes
    mass = gx.PointMass(0.5, (1.0, 0.0, 0.0), velocity=(v, 0.3, 0.0), name="mass", comm=comm)
    reel = gx.Ground((0.0, 0.0, 0.0))
    tether = gx.connectors.Tether(mass.port(), reel, **given)
    return run_of(mass, tether, dt=5e-3, tolerances=SOLVED)


def on_winch(comm: MPI.Comm, v=1.0, stiffness=500.0) -> gx.Simulation:
    """A mass on a rope that is wound in."""
    mass = gx.PointMass(0.5, (1.0, 0.0, 0.0), velocity=(v, 0.3, 0.0), name="mass", comm=comm)
    winch = gx.connectors.Tether(
        mass.port(),
        gx.Ground((0.0, 0.0, 0.0)),
        stiffness=stiffness,
        length=lambda t: 0.98 - 0.3 * t,
    )
    return run_of(mass, winch, dt=5e-3, tolerances=SOLVED)


# Scene, parameter, argument and its value
CASES: list[tuple[Callable[..., gx.Simulation], str, str, float]] = [
    (on_slider, "slider.k", "k", 100.0),
    (on_slider, "slider.L", "L", 1.0),
    (on_slider, "slider.F", "F", 2.0),
    (on_slider, "slider.slip", "slip", 1e-3),
    (on_slider, "mass.initial_velocity", "v", 0.8),
    (on_slider, "mass.initial_position", "x", 1.01),
    (on_slider, "mass.initial_position", "x", 1.1),
    (on_slider, "slider.F", "F", 0.5),
    (on_reel, "tether.stiffness", "stiffness", 500.0),
    (on_reel, "tether.length", "length", 0.95),
    (on_reel, "tether.brake_force", "brake_force", 4.0),
    (on_reel, "mass.initial_velocity", "v", 2.0),
    (on_winch, "tether.stiffness", "stiffness", 500.0),
    (on_winch, "mass.initial_velocity", "v", 1.0),
]


@pytest.mark.mpi
@pytest.mark.parametrize(("make", "name", "argument", "value"), CASES)
def test_gradients_go_through_history_variables(comm, make, name, argument, value) -> None:
    """Of the energy and of a position at the end, against differences of runs."""

    def recorded(number: float) -> tuple[gx.Simulation, gx.analysis.RunTape, list[float]]:
        run = make(comm, **{argument: number})
        tape = gx.analysis.RunTape(run)
        run.run(until=0.5)
        [mass] = run.system.unknowns.bodies
        stored = sum(run.totals.stored.values())
        place = gx.probes.Position(mass.port(), "x")(run)
        return run, tape, [run.totals.kinetic + stored, place]

    run, tape, _ = recorded(value)
    [mass] = run.system.unknowns.bodies
    results = (gx.analysis.Energy(), gx.probes.Position(mass.port(), "x"))
    step = 1e-6 * value
    ends = [recorded(value + sign * step)[2] for sign in (-1, 1)]
    for result, low, high in zip(results, *ends, strict=True):
        values = gx.analysis.gradient(tape, of=result, by=[name])[name].values
        own = float(np.ravel(values)[0]) if np.size(values) else 0.0
        found = comm.allreduce(own) if "initial" in name else own
        difference = (high - low) / (2 * step)
        assert found == pytest.approx(difference, rel=1e-5, abs=1e-9)
