"""A restart compares the scene with that of the checkpoint and refuses other parameters, unless
they are named."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.records.outputs.output import describe
from gossamer_fx.records.run.checkpoint import differences
from tests.survival.scenes import DT, GAS, LAW

COMM = MPI.COMM_WORLD
USUAL: dict[str, Any] = {
    "g": (0.0, 0.0, -9.81),
    "area": 1e-6,
    "force": (1.0, 0.0, 0.0),
    "outside": 1e5,
    "motion": lambda x, t: 0.1 * t * x,
    "point": "bottom right",
    "ramp": 2.0,
}


def scene(**changed: Any) -> gx.Scene:
    """A bit of everything that acts from outside."""
    p = USUAL | changed
    ramp = p["ramp"]
    table = [0.0, 1.0]
    film = gx.Membrane(sheet(COMM, 2, 2), LAW)
    hub = gx.RigidBody(1.0, (0.02, 0.03, 0.04), comm=COMM, name="hub")
    bottle = gx.Tank(1e-3, gas=GAS, pressure=2e5, temperature=300.0, name="bottle")
    valve = gx.Orifice(
        bottle,
        gx.gas.Ambient(p["outside"], 300.0),
        area=p["area"],
        discharge_coefficient=0.8,
        name="valve",
    )
    return gx.Scene(
        film,
        hub,
        valve,
        gx.gas.WallHeat(bottle, 2.0, temperature=310.0),
        gx.Gravity(film, p["g"]),
        gx.Pressure(film, 3.0),
        gx.Damping(film, mass_factor=0.1),
        gx.loads.Force(film.port(p["point"]), p["force"], name="pull"),
        gx.loads.Force(
            hub.port(), lambda t: (ramp * t, np.interp(t, [0, 1], table), 0.0), name="push"
        ),
        gx.control.AttitudeControl(
            hub.frame(),
            (0.0, 0.0, 0.1),
            stiffness=2.0,
            damping=0.3,
            period=DT,
        ),
        gx.Fixed(film, "left", motion=p["motion"], name="mover"),
        gx.loads.EdgeLoad(film, "right", force=(0.0, 1.0, 0.0)),
    )


def run(steps: int, made: gx.Scene, **options: Any) -> gx.Simulation:
    sim = gx.Simulation(made, gx.Midpoint(dt=DT), **options)
    sim.run(until=steps * DT)
    return sim


# That any argument is compared is tested in test_every_argument.py.
OTHER: dict[str, tuple[Any, str]] = {
    "g": (
        (0.0, 0.0, -1.62),
        r"g of 'gravity of film' is \[0.0, 0.0, -9.81\] there and \[0.0, 0.0, -1.62\] here",
    ),
    "area": (2e-6, "area of 'valve' is 1e-06 there and 2e-06 here"),
    "force": ((2.0, 0.0, 0.0), "force of 'pull'"),
    "outside": (2e5, "pressure of '.*' is 100000 there and 200000 here"),
    "motion": (lambda x, t: 0.2 * t * x, "motion source of 'mover' is"),
    "point": ("top right", "port at of 'pull'"),
    "ramp": (3.0, "force outside ramp of 'push' is 2 there and 3 here"),
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
    with pytest.raises(gx.InputError, match="changes is given without restart"):
        run(3, scene(), changes=["valve"])


@pytest.mark.mpi
def test_a_checkpoint_of_one_number_of_ranks_is_compared_on_another(folder: Path) -> None:
    run(2, scene(), checkpoints=gx.Checkpoints(folder))
    COMM.barrier()
    assert run(3, scene(), restart=folder).step == 3


# ---- events --------------------------------------------------------------------------------------


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
    words = "the event When 'E' exceeds 0.062 is only in one of them; .* name it in changes"
    with pytest.raises(gx.InputError, match=words):
        fall(0.08, [*made, late], restart=folder)
    with pytest.raises(gx.InputError, match=r"the event At 0.065 s 'D' is only in one of them"):
        fall(0.08, made[:3], restart=folder)
    with pytest.raises(gx.InputError, match=r"the event At .* is only in one of them"):
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


# ---- contact and flight --------------------------------------------------------------------------


def touching(ball: Any = None, contact: Any = None, law: Any = LAW, under: Any = None) -> gx.Scene:
    """A film over a ball and a floor, of which arguments may be others."""
    film = gx.Membrane(sheet(COMM, 2, 2), law)
    usual_ball = {"centre": (0.5, 0.5, -0.5), "radius": 0.2, "friction": 0.3}
    usual_contact = {"distance": 1e-2, "friction": 0.1, "slip_velocity": 1e-3}
    under = under or gx.contact.Sphere(**usual_ball | (ball or {}), name="ball")
    floor = gx.contact.Plane(point=(0.0, 0.0, -1.0), normal=(0.0, 0.0, 1.0), name="floor")
    return gx.Scene(gx.Contact(film, under, floor, **usual_contact | (contact or {})))


def rises(t: float) -> tuple[float, float, float]:
    return (0.0, 0.0, 0.1 * t)


OTHER_CONTACT: dict[str, tuple[dict[str, Any], str]] = {
    "place": (
        {"ball": {"centre": (0.5, 0.5, -0.6)}},
        r"obstacles 1 centre of 'contact' is \[0.5, 0.5, -0.5\] there and \[0.5, 0.5, -0.6\] here",
    ),
    "radius": (
        {"ball": {"radius": 0.25}},
        "obstacles 1 radius of 'contact' is 0.2 there and 0.25 here",
    ),
    "friction of an obstacle": (
        {"ball": {"friction": 0.4}},
        "obstacles 1 friction of 'contact' is 0.3 there and 0.4 here",
    ),
    "kind": (
        {"under": gx.contact.Box(centre=(0.5, 0.5, -0.5), sizes=(0.2, 0.2, 0.2), name="ball")},
        "obstacles 1 class of 'contact' is 'Sphere' there and 'Box' here",
    ),
    "motion": (
        {"ball": {"motion": rises}},
        r"obstacles 1 motion of 'contact' is None there and \{'function': 'rises'",
    ),
    "friction": ({"contact": {"friction": 0.2}}, "friction of 'contact' is 0.1 there and 0.2 here"),
    "slip velocity": (
        {"contact": {"slip_velocity": 2e-3}},
        "slip_velocity of 'contact' is 0.001 there and 0.002 here",
    ),
    "distance": (
        {"contact": {"distance": 2e-2}},
        "distance of 'contact' is 0.01 there and 0.02 here",
    ),
    "E in free flight": (
        {
            "law": gx.Miyazaki(
                E=2e9, nu=0.3, density=1400.0, thickness=1e-4, residual_stiffness=1e-6
            )
        },
        "law E of 'film' is 1e.09 there and 2e.09 here",
    ),
}


@pytest.mark.mpi
def test_another_obstacle_or_contact_is_refused(folder: Path) -> None:
    run(1, touching(), checkpoints=gx.Checkpoints(folder))
    assert run(2, touching(), restart=folder).step == 2
    for changed, words in OTHER_CONTACT.values():
        with pytest.raises(gx.InputError, match=rf"of another scene: {words}.*name it in changes"):
            run(2, touching(**changed), restart=folder)


@pytest.mark.mpi
def test_another_motion_of_an_obstacle_is_refused(folder: Path) -> None:
    run(1, touching({"motion": rises}), checkpoints=gx.Checkpoints(folder))

    def sinks(t: float) -> tuple[float, float, float]:
        return (0.0, 0.0, -0.1 * t)

    words = "obstacles 1 motion function of 'contact' is 'rises' there and .*sinks"
    with pytest.raises(gx.InputError, match=words):
        run(2, touching({"motion": sinks}), restart=folder)
    assert run(2, touching({"motion": rises}), restart=folder).step == 2


def flying(**changed: Any) -> gx.Scene:
    """A film with drag in an orbit of which one argument may be another."""
    film = gx.Membrane(sheet(COMM, 2, 2), LAW)
    usual = {
        "start": gx.orbit.Elements(7e6),
        "gravity": "point",
        "sun": (1.0, 0.0, 0.0),
        "epoch": None,
        "third_bodies": (),
    }
    orbit = gx.orbit.Orbit(**usual | {key: value for key, value in changed.items() if key in usual})
    density = changed.get("density", 2e-13)
    air = gx.orbit.ExponentialAtmosphere(density=density, altitude=6e5, scale_height=7e4)
    return gx.Scene(film, orbit, gx.orbit.Drag(film, orbit, atmosphere=air, name="drag"))


OTHER_FLIGHT: dict[str, tuple[dict[str, Any], dict[str, Any], str]] = {
    "density": ({}, {"density": 9e-13}, "of 'drag' is.* 2e-13 there and 9e-13 here"),
    "epoch": (
        {"epoch": "2026-01-01"},
        {"epoch": "2026-06-01"},
        "epoch of 'orbit' is '2026-01-01' there and '2026-06-01' here",
    ),
    "degree of harmonics": (
        {"epoch": "2026-01-01", "gravity": 2},
        {"epoch": "2026-01-01", "gravity": 4},
        "gravity of 'orbit' is 2 there and 4 here",
    ),
    "third bodies": (
        {"epoch": "2026-01-01"},
        {"epoch": "2026-01-01", "third_bodies": ("moon",)},
        r"third_bodies of 'orbit' is \[\] there and \['moon'\] here",
    ),
}


@pytest.mark.mpi(1)
@pytest.mark.parametrize("what", OTHER_FLIGHT)
def test_another_orbit_or_drag_is_refused(folder: Path, what: str) -> None:
    usual, changed, words = OTHER_FLIGHT[what]
    if "epoch" in usual:
        pytest.importorskip("erfa")
    run(1, flying(**usual), checkpoints=gx.Checkpoints(folder))
    assert run(2, flying(**usual), restart=folder).step == 2
    with pytest.raises(gx.InputError, match=rf"of another scene: .*{words}.*name it in changes"):
        run(2, flying(**changed), restart=folder)


@pytest.mark.mpi(1)
@pytest.mark.parametrize(
    ("what", "small", "other", "words"),
    [
        ("area", 2e-13, 9e-13, "area of 'valve' is 2e-13 there and 9e-13 here"),
        (
            "force",
            (0.0, 0.0, 1e-13),
            (0.0, 0.0, 9e-13),
            r"force of 'pull' is \[0.0, 0.0, 1e-13\] there and \[0.0, 0.0, 9e-13\] here",
        ),
    ],
)
def test_small_numbers_are_compared_relatively(
    folder: Path, what: str, small: Any, other: Any, words: str
) -> None:
    run(1, scene(**{what: small}), checkpoints=gx.Checkpoints(folder))
    assert run(2, scene(**{what: small}), restart=folder).step == 2
    with pytest.raises(gx.InputError, match=words):
        run(2, scene(**{what: other}), restart=folder)


def test_what_is_noticed_of_a_function() -> None:
    """Its source, default arguments and values of enclosing scopes."""

    def noticed(one: Any, other: Any) -> bool:
        there, here = (json.loads(json.dumps(describe(f))) for f in (one, other))
        return next(differences(there, here), None) is not None

    def valve(factor: float) -> Callable[[float], float]:
        return lambda t: factor * t if t < 0.25 else 0.0

    assert not noticed(valve(2.0), valve(2.0))
    assert noticed(valve(2.0), valve(2.5))

    def doubled(t: float) -> float:
        return 2.0 * t

    def tripled(t: float) -> float:
        return 3.0 * t

    tripled.__qualname__ = doubled.__qualname__
    assert noticed(doubled, tripled)
    assert noticed(np.sin, np.cos)
    assert noticed(math.inf, 1.0) and not noticed(math.nan, math.nan)
