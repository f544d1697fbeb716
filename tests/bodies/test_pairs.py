"""Conservation for every body, every pair of bodies with every joint, and random scenes (property
tests)."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from pairs import (
    AXIS,
    BODIES,
    DT,
    EXTERNAL,
    INTERNAL,
    JOINTED,
    Motion,
    conserves,
    frame,
    hinge_parts,
    joint,
    loose_mass,
    port,
    spring,
)

import gossamer_fx as gx

# Of pairs: what acts on them acts within a quarter of a second.
STEPS = 100
WITHOUT_SHRINKING = (Phase.explicit, Phase.generate)  # an example takes seconds
numbers = st.tuples(*[st.floats(-3, 3)] * 6).filter(lambda n: np.linalg.norm(n) > 0.5)


@pytest.mark.parametrize("name", BODIES)
@settings(max_examples=2, phases=WITHOUT_SHRINKING)
@given(numbers=numbers)
def test_alone(name: str, numbers: tuple[float, ...]) -> None:
    item = BODIES[name](Motion(numbers), name)
    conserves(gx.Scene(item, *spring(item, loose_mass())))


@pytest.mark.parametrize(("first", "second", "kind"), JOINTED)
@settings(max_examples=1, phases=WITHOUT_SHRINKING)
@given(numbers=numbers)
def test_pair_with_joint(first: str, second: str, kind: str, numbers: tuple[float, ...]) -> None:
    motion = Motion(numbers)
    a = BODIES[first](motion, "first")
    b = BODIES[second](motion, "second")
    conserves(gx.Scene(a, b, joint(kind, a, b), *spring(a, loose_mass())), steps=STEPS)


DISTANCES = {
    "link": lambda p, q: gx.constraints.Link(p, q),
    "spring": lambda p, q: gx.connectors.Spring(
        p,
        q,
        stiffness=200.0,
        # The mass starts √0.29 m = 0.54 m from the origin: spring and rope act at once or soon.
        length=0.3,
    ),
    "rope": lambda p, q: gx.connectors.Rope(p, q, length=0.6, stiffness=500.0),
    "stop": lambda p, q: gx.connectors.Stop(p, q, length=0.5, stiffness=500.0),
}


def test_a_spin_below_the_round_off_of_the_velocity_is_taken() -> None:
    motion = Motion((-2.00001, 0.0, 0.0, -1e-38, 0.0, 1e-38))
    beam = BODIES["beam"](motion, "beam")
    run = gx.Simulation(gx.Scene(beam, *spring(beam, loose_mass())), gx.Midpoint(dt=DT))
    run.run(until=DT)
    assert abs(run.energy_error) < 1e-12


@pytest.mark.parametrize("kind", DISTANCES)
@pytest.mark.parametrize("name", BODIES)
@settings(max_examples=1, phases=WITHOUT_SHRINKING)
@given(numbers=numbers)
def test_pair_at_a_distance(name: str, kind: str, numbers: tuple[float, ...]) -> None:
    motion = Motion(numbers)
    item = BODIES[name](motion, name)
    place = np.array([0.3, 0.4, 0.2])
    other = gx.PointMass(0.5, tuple(place), velocity=motion.at(place), name="other")
    connector = DISTANCES[kind](port(item), other.port())
    conserves(gx.Scene(item, connector, *spring(item, loose_mass())), steps=STEPS)


@st.composite
def scenes(draw: st.DrawFn) -> tuple[gx.Scene, bool, bool]:
    """Two joined bodies with anything that can act on them; whether the system is closed, and loses
    nothing."""
    first, second, kind = draw(st.sampled_from(JOINTED))
    motion = Motion(draw(numbers))
    a = BODIES[first](motion, "first")
    b = BODIES[second](motion, "second")
    chosen = draw(st.sets(st.sampled_from([*INTERNAL, *EXTERNAL]), min_size=1))
    loose = loose_mass()
    items = [joint(kind, a, b)]
    for name in sorted(chosen):
        items += (INTERNAL | EXTERNAL)[name](draw(st.sampled_from([a, b])), loose)
    hinge = (first, second, kind) == ("body", "body", "revolute")
    if hinge:
        items += hinge_parts(a, b)
    return gx.Scene(a, b, *items), not chosen & set(EXTERNAL), "damper" not in chosen and not hinge


def books_close(case: tuple[gx.Scene, bool, bool]) -> None:
    scene, closed, lossless = case
    run = conserves(scene, closed)
    assert run.totals.dissipated == 0 if lossless else run.totals.dissipated > 0


@settings(max_examples=6, phases=WITHOUT_SHRINKING)
@given(case=scenes())
def test_random_scene(case: tuple[gx.Scene, bool, bool]) -> None:
    books_close(case)


@pytest.mark.slow
@settings(max_examples=60, phases=WITHOUT_SHRINKING)
@given(case=scenes())
def test_many_random_scenes(case: tuple[gx.Scene, bool, bool]) -> None:
    books_close(case)


@pytest.mark.parametrize(("axis", "angle"), [((1.0, 0.0, 0.0), 0.0), ((0.0, 1.0, 0.0), 0.4)])
def test_hinge_with_torsional_spring(axis: tuple[float, float, float], angle: float) -> None:
    motion = Motion((0.0, 0.0, 0.0, 1.0, 2.0, 0.5))
    a, b = (BODIES["body"](motion, name) for name in ("first", "second"))
    spiral = gx.connectors.TorsionSpring(
        frame(a),
        frame(b),
        axis=axis,
        stiffness=2.0,
        rest_angle=angle,
    )
    conserves(
        gx.Scene(
            a,
            b,
            gx.constraints.RevoluteJoint(frame(a), frame(b), axis=axis),
            spiral,
            *spring(a, loose_mass()),
        )
    )


def test_dampers_lose_what_is_booked() -> None:
    motion = Motion((0.0, 0.0, 0.0, 1.0, 2.0, 0.5))
    a, b = (BODIES["body"](motion, name) for name in ("first", "second"))
    loose = loose_mass()
    scene = gx.Scene(
        a,
        b,
        gx.constraints.RevoluteJoint(frame(a), frame(b), axis=AXIS),
        gx.connectors.TorsionDamper(frame(a), frame(b), axis=AXIS, damping=0.5),
        gx.connectors.Damper(port(b), loose.port(), damping=0.5),
        *spring(a, loose),
    )
    run = gx.Simulation(scene, gx.Midpoint(dt=DT, tolerances=gx.Tolerances(relative=1e-12)))
    run.run(until=1.0)
    # A loss that is too small could hide a wrong sign within the tolerance of the ledger.
    assert run.totals.dissipated > 0.1
    assert abs(run.energy_error) < 1e-9
    error = np.abs(run.totals.angular_momentum - run.first.angular_momentum).max()
    assert error < 1e-10
