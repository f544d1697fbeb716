"""Derivatives of forces at supports, joints, springs against differences of equilibria."""

from __future__ import annotations

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.meshes.airbag import airbag
from gossamer_fx.meshes.sheet import crossed_sheet
from tests.small_scenes import AIR, at_rest, body

LAW = gx.Linear(E=1e9, nu=0.3, density=1000.0, thickness=1e-4)


def held_film(comm, **numbers):
    """A film on two edges, a spring and a rope at its corners, under pressure and weight."""
    given = {"pressure": 300.0, "stiffness": 200.0, "length": 0.4, "rope": 0.55} | numbers
    film = gx.Membrane(crossed_sheet(comm, 4, 4), LAW, initial_stress=1e6, name="film")
    edge = gx.Fixed(film, "left", name="edge")
    slide = gx.Fixed(film, "bottom", components=(2,), name="slide")
    spring = gx.connectors.Spring(
        film.port("top right"),
        gx.Ground((1.3, 1.4, 0.1)),
        stiffness=given["stiffness"],
        length=given["length"],
    )
    rope = gx.connectors.Rope(
        gx.Ground((1.5, 0.0, -0.2)),
        film.port("bottom right"),
        stiffness=150.0,
        length=given["rope"] * 0.9,
    )
    load = gx.Pressure(film, given["pressure"], name="load")
    weight = gx.Gravity(film, (0.0, 0.0, -9.81))
    return {"edge": edge, "slide": slide, "spring": spring, "rope": rope}, [load, weight]


def solved(comm, **numbers):
    parts, loads = held_film(comm, **numbers)
    return parts, at_rest(*parts.values(), *loads)


BY = {
    "load.pressure": ("pressure", 300.0),
    "spring.stiffness": ("stiffness", 200.0),
    "spring.length": ("length", 0.4),
}


@pytest.mark.mpi
@pytest.mark.parametrize("part", ["edge", "slide", "spring", "rope"])
@pytest.mark.parametrize("action", ["force", "moment"])
def test_reactions_of_a_film(comm, part, action):
    options = {"action": action, "about": (0.2, -0.3, 0.5)}
    parts, equilibrium = solved(comm)
    for axis in "xz":
        probe = gx.probes.Reaction(parts[part], axis, **options)
        found = gx.analysis.gradient(equilibrium, of=probe, by=list(BY))
        assert found.value == pytest.approx(probe(equilibrium))
        scale = max(abs(one.values[0] * BY[one.name][1]) for one in found)
        for name, (argument, value) in BY.items():
            change = 1e-4 * value
            values = []
            for sign in (1, -1):
                others, other = solved(comm, **{argument: value + sign * change})
                values.append(gx.probes.Reaction(others[part], axis, **options)(other))
            expected = (values[0] - values[1]) / (2 * change)
            assert found[name].values[0] * value == pytest.approx(
                expected * value, rel=2e-5, abs=1e-6 * scale
            ), (axis, name)


@pytest.mark.mpi
def test_all_derivatives_balance(comm):
    """The sum of all forces is that of the dead loads, which a length does not change."""
    parts, equilibrium = solved(comm, pressure=1e-12)
    total = 0.0
    for part in ("edge", "slide", "spring", "rope"):
        probe = gx.probes.Reaction(parts[part], "y")
        found = gx.analysis.gradient(equilibrium, of=probe, by=["spring.length"])
        total += found["spring.length"].values[0]
    assert total == pytest.approx(0.0, abs=1e-6)


def test_the_force_of_a_joint(comm):
    """A rigid body in a ball joint to the ground, pulled by a spring."""

    def made(stiffness):
        rigid = body(position=(0.0, 0.0, 0.0), name="body")
        joint = gx.constraints.BallJoint(
            gx.Ground((0.0, 0.0, 0.5)), rigid.port((0.0, 0.0, 0.5)), name="joint"
        )
        spring = gx.connectors.Spring(
            rigid.port((0.3, 0.0, -0.5)),
            gx.Ground((1.0, 0.4, -0.5)),
            stiffness=stiffness,
            length=0.2,
        )
        return joint, at_rest(rigid, joint, spring, gx.Gravity(rigid, (0.0, 0.0, -9.81)))

    joint, equilibrium = made(20.0)
    for action in ("force", "moment"):
        probe = gx.probes.Reaction(joint, "x", action=action, about=(0.0, 1.0, -1.0))
        found = gx.analysis.gradient(equilibrium, of=probe, by=["spring.stiffness"])
        values = []
        for k in (20.002, 19.998):
            other_joint, other = made(k)
            values.append(
                gx.probes.Reaction(other_joint, "x", action=action, about=(0.0, 1.0, -1.0))(other)
            )
        expected = (values[0] - values[1]) / 4e-3
        assert found["spring.stiffness"].values[0] == pytest.approx(expected, rel=1e-5, abs=1e-8)


@pytest.mark.mpi
def test_a_support_next_to_gas(comm):
    """The held half of an airbag bears the pressure of its gas, which expands as the other half
    gets softer."""

    def made(stress):
        bag = gx.Membrane(airbag(comm, 1.0, 4), LAW, initial_stress=stress, name="film")
        bottom = gx.Fixed(bag, "bottom", name="held")
        gas = gx.Chamber(
            bag, gas=AIR, pressure=1e3, temperature=300.0, dead_volume=0.02, name="gas"
        )
        return bottom, at_rest(bottom, gas)

    bottom, equilibrium = made(1e6)
    probe = gx.probes.Reaction(bottom, "z")
    found = gx.analysis.gradient(equilibrium, of=probe, by=["film.initial_stress"])
    values = []
    for stress in (1.001e6, 0.999e6):
        other_bottom, other = made(stress)
        values.append(gx.probes.Reaction(other_bottom, "z")(other))
    expected = (values[0] - values[1]) / 2e3
    assert float(np.sum(found["film.initial_stress"].values)) == pytest.approx(expected, rel=1e-4)


def test_runs_have_none(comm):
    point = gx.PointMass(1.0, (0.0, 0.0, 0.0), comm=comm)
    top = gx.Ground((0.0, 0.0, 1.0))
    spring = gx.connectors.Spring(point.port(), top, stiffness=1.0, length=1.0)
    run = gx.Simulation(gx.Scene(spring), gx.Midpoint(dt=0.1))
    tape = gx.analysis.RunTape(run)
    run.run(until=0.2)
    with pytest.raises(gx.InputError, match="derivatives in an equilibrium only"):
        gx.analysis.gradient(tape, of=gx.probes.Reaction(spring, "z"), by=["spring.length"])
