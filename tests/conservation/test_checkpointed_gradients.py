"""Tapes with little memory: states are dropped in the run and made again in the backward pass."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.presets.gases import NITROGEN
from tests.conservation.test_gradients_in_time import SOLVED, colliding, roped, taut

# Relative difference of gradients: steps that are made again agree to the tolerance of Newton's
# method, which films amplify a little.
AGREEMENT = 1e-9


def state_bytes(tape: gx.analysis.RunTape) -> int:
    return max(node.bytes for node in tape.states)


def recorded(
    make, comm, memory: float = 1e9, steps: int | None = None
) -> tuple[gx.Simulation, gx.analysis.RunTape, list[int]]:
    """A run, its tape, and the memory [bytes] of the tape after each step."""
    scene, h, count = make(comm)
    run = gx.Simulation(scene, gx.Midpoint(dt=h, tolerances=SOLVED))
    tape = gx.analysis.RunTape(run, memory=memory)
    used: list[int] = []
    run.stepping.recorders.append(lambda: used.append(tape.bytes))
    run.run(until=h * (steps or count))
    return run, tape, used


@pytest.mark.mpi(1)
@pytest.mark.parametrize(
    ("make", "name", "room"),
    [
        # Room for as many states as one further pass forwards needs, and for so few that states are
        # made again in several levels.
        (taut, "film.initial_velocity", 12),
        (taut, "film.initial_velocity", 4),
        (roped, "a.initial_velocity", 5),
        (colliding, "film.initial_velocity", 9),
    ],
    ids=["film, 12 states", "film, 4 states", "ropes, 5 states", "contact, 9 states"],
)
def test_little_memory_gives_the_same_gradient(comm, make, name, room):
    run, tape, _ = recorded(make, comm)
    energy = gx.analysis.Energy()
    exact = gx.analysis.gradient(tape, of=energy, by=[name])[name].values
    size = comm.allreduce(state_bytes(tape), op=MPI.MAX)
    memory = room * size

    run, tape, used = recorded(make, comm, memory=memory)
    assert max(used) <= memory
    assert tape.stride > 1
    assert tape.steps == run.step
    state = run.system.unknowns.q0.array_r.copy()
    totals = run.totals
    found = gx.analysis.gradient(tape, of=energy, by=[name])[name].values
    scale = comm.allreduce(np.abs(exact).max(initial=0.0), op=MPI.MAX)
    assert np.abs(found - exact).max(initial=0.0) < AGREEMENT * scale
    assert tape.bytes <= memory
    # The run stands where it was, and its totals know nothing of the steps that were made again.
    assert np.array_equal(run.system.unknowns.q0.array_r, state)
    assert run.totals.losses == totals.losses
    assert run.totals.supplied == totals.supplied


def test_times_of_crossings_need_no_states_in_between(comm):
    """Gas: pressures are part of the states, and the time of a crossing asks for all states."""

    def recorded_bag(memory: float) -> gx.analysis.Gradient:
        tank = gx.Tank(1e-4, gas=NITROGEN, pressure=1e6, temperature=293.0)
        bag = gx.Chamber(volume=1e-3, gas=NITROGEN, pressure=1e3, temperature=293.0, name="bag")
        mass = gx.PointMass(1.0, (0.0, 0.0, 0.0), velocity=(1.0, 0.0, 0.0))
        inlet = gx.Orifice(tank, bag, area=1e-5, name="inlet")
        run = gx.Simulation(gx.Scene(inlet, mass), gx.Midpoint(dt=1e-3, tolerances=SOLVED))
        tape = gx.analysis.RunTape(run, memory=memory)
        run.run(until=4e-2)
        filled = gx.analysis.CrossingTime(gx.analysis.ChamberPressure(bag), 2e4)
        return gx.analysis.gradient(tape, of=filled, by=["inlet.area", "tank.pressure"])

    exact = recorded_bag(1e9)
    # A state has the coordinates of one mass: 48 bytes.
    found = recorded_bag(6 * 48)
    assert found.value == pytest.approx(exact.value, rel=1e-12)
    for name in ("inlet.area", "tank.pressure"):
        assert found[name].values == pytest.approx(exact[name].values, rel=AGREEMENT)


@pytest.mark.parametrize("memory", [1e9, 4 * 48], ids=["all states", "four states"])
def test_steps_that_an_event_undid_leave_the_tape(comm, memory):
    """A mass passes x = 0.25 m between two steps: the run goes back and meets the crossing."""
    mass = gx.PointMass(1.0, (0.0, 0.0, 0.0), velocity=(1.0, 0.0, 0.0))
    crossing = gx.When(
        lambda run: run.system.unknowns.state[mass].positions()[0, 0],
        # The mass moves at 1 m/s, so the crossing is at t = 0.25 s.
        0.25,
        tolerance=1e-9,
    )
    run = gx.Simulation(gx.Scene(mass), gx.Midpoint(dt=0.1), events=[crossing])
    tape = gx.analysis.RunTape(run, memory=memory)
    run.run(until=1.0)
    if memory == 1e9:
        assert sum(node.h for node in tape.states) == pytest.approx(1.0)
    times = [node.time for node in tape.forwards()]
    assert times == sorted(times)
    assert times[-1] == pytest.approx(1.0)
    assert pytest.approx(min(times, key=lambda t: abs(t - 0.25)), abs=1e-8) == 0.25
    position = gx.probes.Position(mass.port(), "x")
    found = gx.analysis.gradient(tape, of=position, by=["mass.initial_velocity"])
    # x(T) = x0 + v T, so dx/dv = T = 1 s.
    assert found["mass.initial_velocity"].values == pytest.approx([1.0, 0.0, 0.0])


def test_no_room_for_four_states_is_refused(comm):
    mass = gx.PointMass(1.0, (0.0, 0.0, 0.0))
    run = gx.Simulation(gx.Scene(mass), gx.Midpoint(dt=0.1))
    with pytest.raises(gx.InputError, match="four states need 192 bytes"):
        gx.analysis.RunTape(run, memory=100)
