"""A restart goes on with the scene that wrote the checkpoint: other parameters are refused, unless they are meant."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from meshes.sheet import sheet
from tests.survival.scenes import DT, GAS, LAW

COMM = MPI.COMM_WORLD
USUAL: dict[str, Any] = {
    "g": (0.0, 0.0, -9.81),
    "pressure": 3.0,
    "damping": 0.1,
    "area": 1e-6,
    "discharge": 0.8,
    "force": (1.0, 0.0, 0.0),
    "stiffness": 2.0,
    "target": (0.0, 0.0, 0.1),
    "outside": 1e5,
    "conductance": 2.0,
    "motion": lambda x, t: 0.1 * t * x,
    "edge": (0.0, 1.0, 0.0),
    "point": "bottom right",
    "ramp": 2.0,
}


def scene(**changed: Any) -> gx.Scene:
    """A bit of everything that acts from outside."""
    p = USUAL | changed
    ramp, table = p["ramp"], [0.0, 1.0]
    film = gx.Membrane(sheet(COMM, 2, 2), LAW)
    hub = gx.RigidBody(1.0, (0.02, 0.03, 0.04), comm=COMM, name="hub")
    bottle = gx.Tank(1e-3, gas=GAS, pressure=2e5, temperature=300.0, name="bottle")
    valve = gx.Orifice(
        bottle,
        gx.gas.Ambient(p["outside"], 300.0),
        area=p["area"],
        discharge_coefficient=p["discharge"],
        name="valve",
    )
    return gx.Scene(
        film,
        hub,
        valve,
        gx.gas.WallHeat(bottle, p["conductance"], temperature=310.0),
        gx.Gravity(film, p["g"]),
        gx.Pressure(film, p["pressure"]),
        gx.Damping(film, mass_factor=p["damping"]),
        gx.loads.Force(film.port(p["point"]), p["force"], name="pull"),
        gx.loads.Force(
            hub.port(), lambda t: (ramp * t, np.interp(t, [0, 1], table), 0.0), name="push"
        ),
        gx.control.AttitudeControl(
            hub.frame(), p["target"], stiffness=p["stiffness"], damping=0.3, period=DT
        ),
        gx.constraints.Prescribed(film, "left", motion=p["motion"], name="mover"),
        gx.loads.EdgeLoad(film, "right", force=p["edge"]),
    )


def run(steps: int, made: gx.Scene, **options: Any) -> gx.Simulation:
    sim = gx.Simulation(made, gx.Midpoint(dt=DT), **options)
    sim.run(until=steps * DT)
    return sim


OTHER: dict[str, tuple[Any, str]] = {
    "g": (
        (0.0, 0.0, -1.62),
        r"g of 'gravity of film' is \[0.0, 0.0, -9.81\] there and \[0.0, 0.0, -1.62\] here",
    ),
    "pressure": (4.0, "pressure of 'pressure' is 3 there and 4 here"),
    "damping": (0.2, "mass_factor of '.*' is 0.1 there and 0.2 here"),
    "area": (2e-6, "area of 'valve' is 1e-06 there and 2e-06 here"),
    "discharge": (0.7, "discharge_coefficient of 'valve'"),
    "force": ((2.0, 0.0, 0.0), "force of 'pull'"),
    "stiffness": (3.0, "stiffness of 'attitude control'"),
    "target": ((0.0, 0.0, 0.2), "target of 'attitude control'"),
    "outside": (2e5, "pressure of '.*' is 100000 there and 200000 here"),
    "conductance": (3.0, "conductance of 'wall'"),
    "motion": (lambda x, t: 0.2 * t * x, "the function motion of 'mover' is another one"),
    "edge": ((0.0, 2.0, 0.0), "force of '.*'"),
    "point": ("top right", "port at of 'pull'"),
    "ramp": (3.0, "the function value of 'push' is another one"),
}


@pytest.mark.mpi
def test_other_parameters_are_refused(folder: Path) -> None:
    run(2, scene(), checkpoints=gx.Checkpoints(folder))
    assert run(3, scene(), restart=folder).step == 3
    for what, (value, words) in OTHER.items():
        with pytest.raises(
            gx.InputError, match=rf"of another scene: {words}.*; .* name it in changes"
        ):
            run(3, scene(**{what: value}), restart=folder)


@pytest.mark.mpi
def test_changes_that_are_meant_are_taken(folder: Path) -> None:
    run(2, scene(), checkpoints=gx.Checkpoints(folder))
    with pytest.raises(
        gx.InputError, match="changes holds 'vent', but the scene has no such part; it has: film"
    ):
        run(3, scene(), restart=folder, changes=["vent"])
    with pytest.raises(gx.InputError, match="force of 'pull'"):
        run(3, scene(area=2e-6, force=(2.0, 0.0, 0.0)), restart=folder, changes=["valve"])
    after = run(3, scene(area=2e-6), restart=folder, changes=["valve"])
    assert after.step == 3 and abs(after.mass_error) <= 1e-14
    with pytest.raises(gx.InputError, match="changes, but no restart"):
        run(3, scene(), changes=["valve"])


@pytest.mark.mpi
def test_what_was_not_compared_is_told(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    """The list that a function takes from outside may have been filled since; a number may not."""
    run(2, scene(), checkpoints=gx.Checkpoints(folder))
    with caplog.at_level("INFO", logger="gossamer_fx"):
        run(3, scene(), restart=folder)
    if COMM.rank == 0:
        assert "not compared with the checkpoint: force outside table of 'push'" in caplog.text


@pytest.mark.mpi
def test_a_checkpoint_of_one_number_of_ranks_is_compared_on_another(folder: Path) -> None:
    run(2, scene(), checkpoints=gx.Checkpoints(folder))
    COMM.barrier()
    assert run(3, scene(), restart=folder).step == 3


# ---- events --------------------------------------------------------------------------------------------------------


def fall(until: float, events: list[Any], **options: Any) -> gx.Simulation:
    mass = gx.PointMass(2.0, position=(0.0, 0.0, 1.0), comm=COMM)
    sim = gx.Simulation(
        gx.Scene(mass, gx.Gravity(mass, (0.0, 0.0, -9.81))),
        gx.Midpoint(dt=0.01),
        events=events,
        **options,
    )
    sim.run(until=until)
    return sim


@pytest.mark.mpi
def test_events_may_come_in_another_order(folder: Path) -> None:
    told: list[str] = []

    def event(kind: Callable[..., Any], *args: Any, name: str) -> Any:
        return kind(*args, then=lambda run: told.append(name), name=name)

    def clock(run: gx.Simulation) -> float:
        return run.time

    made = [
        event(gx.At, 0.015, name="A"),
        event(gx.When, clock, 0.022, name="B"),
        event(gx.When, clock, 0.052, name="C"),
        event(gx.At, 0.065, name="D"),
    ]
    fall(0.04, made, checkpoints=gx.Checkpoints(folder))
    assert told == ["A", "B"]
    told.clear()
    fall(0.08, made[::-1], restart=folder)
    assert told == ["A", "B", "C", "D"]
    late = event(gx.When, clock, 0.062, name="E")
    with pytest.raises(
        gx.InputError, match=r"the event When 'E' exceeds 0.062 is not in it; .* name it in changes"
    ):
        fall(0.08, [*made, late], restart=folder)
    with pytest.raises(gx.InputError, match=r"the event At 0.065 s 'D' is missing here"):
        fall(0.08, made[:3], restart=folder)
    with pytest.raises(gx.InputError, match=r"the event At .* is missing here"):
        fall(0.08, [], restart=folder)
    told.clear()
    fall(0.08, [late, *made], restart=folder, changes=["E"])
    assert told == ["A", "B", "C", "E", "D"]


@pytest.mark.mpi
def test_an_event_at_the_start_happens(folder: Path) -> None:
    told: list[float] = []
    events = [
        gx.At(0.0, then=lambda run: told.append(run.time)),
        gx.At(0.02, then=lambda run: told.append(run.time)),
    ]
    fall(0.03, events, checkpoints=gx.Checkpoints(folder))
    assert told == [0.0, 0.02]
    fall(0.04, events, restart=folder)
    assert told == [0.0, 0.02, 0.03, 0.03]
    stopped = fall(1.0, [gx.At(0.0, stop=True)], outputs=[gx.Ledger(folder / "a.csv")])
    assert (stopped.step, stopped.time) == (0, 0.0)
