"""A saved state holds all on which the next step depends."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.solve.steppers.history import MOTION, History
from gossamer_fx.solve.system.system import System
from tests.invariance.kinds import KINDS, Kind
from tests.invariance.transformations import SAME, Description

MOVING = [kind for kind in KINDS if kind.dt > 0]
AT_REST = [kind for kind in KINDS if kind.dt == 0]


def scene_of(kind: Kind, comm: MPI.Intracomm) -> gx.Scene:
    at = Description(SAME, comm)
    return gx.Scene(*at.in_order(kind.make(at).parts))


def present(system: System) -> dict[str, np.ndarray]:
    """Coordinates, velocities, time, and what the balance of energy has."""
    found = {
        "q": np.array(system.unknowns.q0.array_r),
        "v": np.array(system.unknowns.v0.array_r),
        "supplied": np.array(system.balance.supplied_energy),
        "time": np.array(system.unknowns.time),
    }
    for name, loss in system.balance.losses.items():
        found[f"loss {name}"] = np.array(loss)
    for name, energy in system.balance.totals().stored.items():
        found[f"stored {name}"] = np.array(energy)
    return found


@pytest.mark.parametrize("kind", MOVING, ids=lambda kind: kind.name)
def test_a_step_that_is_dropped_leaves_no_trace(kind: Kind) -> None:
    ends = []
    for drops in (False, True):
        run = gx.Simulation(scene_of(kind, MPI.COMM_SELF), gx.Midpoint(dt=kind.dt))
        run.run(until=2 * kind.dt)
        for _ in range(3):
            if drops:
                before = present(run.system)
                run.solver.step(2 * kind.dt)
                for name, values in present(run.system).items():
                    assert np.array_equal(values, before[name]), name
            run.solver.accept(run.solver.step(kind.dt))
        ends.append(present(run.system))
    # The search of the longer step finds pairs of contact in another order: sums are rounded.
    tolerance = 1e-7 if run.system.equations.active_sets else 0.0
    for name, values in ends[0].items():
        size = np.abs(values).max(initial=1e-12)
        assert np.abs(values - ends[1][name]).max(initial=0.0) <= tolerance * size, name


def steps_made_twice(kind: Kind, comm: MPI.Intracomm) -> tuple[dict, dict]:
    """What three steps lead to, and what they lead to when they are undone and made again."""
    run = gx.Simulation(scene_of(kind, comm), gx.Midpoint(dt=kind.dt))
    run.run(until=2 * kind.dt)
    start = run.history.save()
    ends = []
    for _ in range(2):
        for _ in range(3):
            run.solver.accept(run.solver.step(kind.dt))
        ends.append(present(run.system))
        run.history.restore(start)
    return ends[0], ends[1]


@pytest.mark.parametrize("kind", MOVING, ids=lambda kind: kind.name)
def test_steps_that_were_undone_are_made_again_bit_for_bit(kind: Kind) -> None:
    first, again = steps_made_twice(kind, MPI.COMM_SELF)
    assert first.keys() == again.keys()
    for name, values in first.items():
        assert np.array_equal(values, again[name]), name


@pytest.mark.mpi
@pytest.mark.parametrize("kind", MOVING, ids=lambda kind: kind.name)
def test_ranks_undo_steps_together(kind: Kind, comm) -> None:
    if kind.name == "reduced film":
        pytest.skip("its basis is recorded on one rank")
    first, again = steps_made_twice(kind, comm)
    for name, values in first.items():
        # A search finds pairs of contact in another order than the one before: sums are rounded.
        size = np.abs(values).max(initial=1e-12)
        assert np.abs(values - again[name]).max(initial=0.0) <= 1e-7 * size, name


@pytest.mark.parametrize("kind", AT_REST, ids=lambda kind: kind.name)
def test_a_search_from_a_saved_state_is_the_same(kind: Kind) -> None:
    equilibrium = gx.Equilibrium(scene_of(kind, MPI.COMM_SELF))
    history = History(equilibrium.system)
    start = history.save(MOTION)
    ends = []
    for _ in range(2):
        equilibrium.find(progress=False)
        ends.append(present(equilibrium.system))
        history.restore(start)
        equilibrium.take_over(start.time)
    for name, values in ends[0].items():
        # A search knows from earlier ones how stiff the scene is, and takes another way.
        size = np.abs(values).max(initial=1e-12)
        assert np.abs(values - ends[1][name]).max(initial=0.0) <= 10 * kind.tolerance * size, name


@pytest.mark.parametrize("kind", MOVING, ids=lambda kind: kind.name)
def test_a_gradient_leaves_the_run_as_it_was(kind: Kind) -> None:
    ends = []
    for asks in (False, True):
        run = gx.Simulation(scene_of(kind, MPI.COMM_SELF), gx.Midpoint(dt=kind.dt))
        tape = gx.analysis.RunTape(run)
        run.run(until=2 * kind.dt)
        if asks:
            by = [f"{body.name}.initial_velocity" for body in run.scene.bodies]
            try:
                gx.analysis.gradient(tape, of=gx.analysis.Energy(), by=by)
            except gx.InputError as refusal:
                pytest.skip(str(refusal))
        for _ in range(3):
            run.solver.accept(run.solver.step(kind.dt))
        ends.append(present(run.system))
    for name, values in ends[0].items():
        assert np.array_equal(values, ends[1][name]), name
