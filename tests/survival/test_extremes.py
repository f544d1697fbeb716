"""Extreme cases: each run ends with small errors of its balances, or with the reason of its
failure."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from demos.studies import extremes
from demos.studies.engine.deployments import arguments
from demos.studies.stability import ORDINARY, STUDY, cases, problem
from gossamer_fx.core.checks.errors import NotConverged
from gossamer_fx.solve.steppers.history import MOTION, History
from tests.small_scenes import run_until

COMM = MPI.COMM_WORLD


@pytest.mark.mpi(2)
@pytest.mark.parametrize("case", ["ordinary", "u=1e-12", "pressure=1", "mass=1e+06", "aspect=1000"])
def test_cells_of_the_map_keep_their_books(case: str) -> None:
    """The problem itself checks energy, gas, volumes and coordinates."""
    assert problem(COMM, case)["volume"] > 0


def test_the_map_covers_its_ranges() -> None:
    known = [ORDINARY | arguments(case) for case in cases()]
    assert len(known) == len({tuple(v.values()) for v in known})
    assert set(STUDY.quick["case"]) <= set(cases())
    for axis, (least, most) in {
        "u": (1e-12, 1.0),
        "thickness": (1e-6, 1e-3),
        "h": (0.01, 100.0),
        "pressure": (1.0, 1e8),
        "mass": (1e-6, 1e6),
        "aspect": (1.0, 1e3),
        "dead": (1e-9, 1e-3),
    }.items():
        values = [v[axis] for v in known]
        assert (min(values), max(values)) == (least, most)


@pytest.mark.mpi
def test_a_step_that_would_turn_a_chamber_inside_out_is_not_taken() -> None:
    """A piston that is pushed through its closed end: pV = const cannot pass V = 0, however long
    the step."""
    mass = gx.PointMass(1.0, velocity=(0.0, 0.0, -100.0), comm=COMM, name="piston")
    room = gx.Chamber(
        gx.gas.Piston(mass.port(), 1e-2, direction=(0.0, 0.0, 1.0)),
        gas=gx.IdealGas(gamma=1.4, R=287.0),
        pressure=1e2,
        temperature=300.0,
        dead_volume=1e-2,
        name="room",
    )
    run = gx.Simulation(gx.Scene(mass, room), gx.Midpoint(dt=0.05), halvings=0)
    with pytest.raises(gx.StepFailure, match="failed"):
        run.run(until=0.05)
    assert pytest.approx(1e-2) == run.chamber("room").volume
    with pytest.raises(NotConverged):
        run.solver.step(0.05)
    patient = run_until(0.05, mass, room, dt=0.05, halvings=20)
    assert patient.chamber("room").volume > 0 and abs(patient.energy_error) <= 1e-9


def test_the_answer_of_a_crease_is_that_of_its_start(monkeypatch: pytest.MonkeyPatch) -> None:
    """A start moved by 1e-6 of the size has another fold angle, and 1e-6 more or less energy."""
    compile_scene = gx.Scene.compile

    def compile_moved(scene: gx.Scene, *words, **options):
        system = compile_scene(scene, *words, **options)
        count = system.unknowns.numbering.size_local
        noise = 1e-7 * np.random.default_rng(0).uniform(-1, 1, count)
        history = History(system)
        history.restore(history.save(MOTION).moved_by(noise))
        return system

    monkeypatch.setattr(gx.Scene, "compile", compile_moved)
    # It compares the energies itself, to 1e-9.
    assert extremes.problem(COMM, "crease")["energy_error"] < 1e-9
