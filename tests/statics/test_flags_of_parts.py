"""What an equilibrium says of parts that move freely, of slack ones and of unstable ones, alone and
next to each other."""

from __future__ import annotations

import math

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import EDGES, sheet

ROPE = gx.CableLaw(EA=2e4, line_density=0.01)
FILM = gx.Linear(1e9, 0.3, density=1000.0, thickness=1e-4)


def rope(comm, start, end, cells, name):
    return gx.Cable(line(comm, [start, end], cells), ROPE, name=name)


def hung(comm, feet, cells, knot=(0.0, 0.0, -1.0)):
    """A load that hangs in a knot of ropes, which are held at their feet."""
    load = gx.PointMass(5.0, knot, comm=comm, name="load")
    items: list[object] = [gx.Gravity(load, (0.0, 0.0, -9.81))]
    for k, foot in enumerate(feet):
        leg = rope(comm, foot, knot, cells, f"rope {k}")
        items.append(gx.Fixed(leg, "start", name=f"foot {k}"))
        items.append(gx.constraints.BallJoint(leg.port("end"), load.port(), name=f"knot {k}"))
    return items


def tripod(comm, cells, at=(0.0, 0.0, 0.0), size=1.0):
    angles = 2 * math.pi * np.arange(3) / 3
    centre = np.array(at)
    feet = [tuple(centre + size * np.array([math.cos(a), math.sin(a), 0.0])) for a in angles]
    return hung(comm, feet, cells, tuple(centre - [0.0, 0.0, size]))


def pendulum(comm, cells):
    return hung(comm, [(0.0, 0.0, 0.0)], cells)


def small_far_tripod(comm, cells):
    """Of a millimetre, at 10 m."""
    return tripod(comm, cells, at=(10.0, 3.0, 0.0), size=1e-3)


def clamped_film(comm):
    film = gx.Membrane(sheet(comm, 2, 2), FILM, initial_stress=1e6, name="clamped film")
    held = [gx.Fixed(film, edge, name=f"frame {edge}") for edge in EDGES]
    return [*held, gx.Pressure(film, 10.0, name="wind")]


def column(comm):
    """A column under 1.5 times the load at which it buckles in two planes."""
    section = gx.sections.tube(0.02, 5e-4, E=1e11, nu=0.3, density=1560.0)
    beam = gx.Beam(
        line(comm, [(0, 0, 0), (0, 0, 1.0)], 4), section, normal=(1.0, 0.0, 0.0), name="column"
    )
    stiffness = 1e11 * math.pi / 4 * (0.02**4 - (0.02 - 5e-4) ** 4)
    load = 1.5 * math.pi**2 * stiffness / 4
    foot = gx.Fixed(beam, "start", rotation=True, name="foot of the column")
    return [foot, gx.loads.Force(beam.port("end"), (0.0, 0.0, -load), name="weight")]


@pytest.mark.mpi
@pytest.mark.parametrize("cells", [1, 2])
@pytest.mark.parametrize("scene", [tripod, pendulum, small_far_tripod])
def test_a_part_of_ropes_is_held_alone_and_next_to_others(comm, scene, cells):
    """Free nodes may lie at one point, as the ends of three ropes, or on one line."""
    for others, unstable in ((lambda _: [], 0), (clamped_film, 0), (column, 2)):
        result = gx.Equilibrium(gx.Scene(*scene(comm, cells), *others(comm))).find()
        assert result.free == () and result.slack == ()
        assert result.regular and result.unstable == unstable


def test_a_free_part_does_not_hide_that_another_one_is_unstable(comm):
    """A bob of an extended body turns about its rope."""
    bob = gx.RigidBody(1.0, (1.0, 1.0, 2.0), position=(0.0, 0.0, -1.0), comm=comm, name="bob")
    hinge = gx.constraints.BallJoint(bob.port((0.0, 0.0, 1.0)), gx.Ground((0.0, 0.0, 0.0)))
    result = gx.Equilibrium(gx.Scene(hinge, gx.Gravity(bob), *column(comm))).find()
    assert result.free == ("rotation z of 'bob'",)
    assert not result.regular and result.unstable == 2
    assert "nothing resists" in result.summary() and "not stable" in result.summary()
    assert gx.Equilibrium(gx.Scene(hinge, gx.Gravity(bob))).find().unstable == 0


@pytest.mark.mpi
@pytest.mark.parametrize("size", [1e-3, 1.0, 100.0])
def test_motions_of_a_free_panel_have_their_names_at_any_size(comm, size):
    """Next to a clamped film of 1 m."""
    far = gx.Membrane(
        sheet(comm, 2, 2, size, size),
        FILM,
        initial_stress=1e6,
        name="panel",
        displacement=lambda X: np.stack([0 * X[0] + 20.0, 0 * X[0] - 30.0, 0 * X[0]]),
    )
    flat = gx.Fixed(far, "film", components=(2,), name="table")
    pull = gx.Fixed(far, "left", components=(0,), name="guide")
    result = gx.Equilibrium(gx.Scene(far, flat, pull, *clamped_film(comm))).find()
    assert result.free == ("translation y of 'panel'",)


def test_slack_film_between_clamps_is_slack_and_not_free(comm, caplog):
    film = gx.Membrane(sheet(comm, 3, 3), FILM, name="film")
    held = [gx.Fixed(film, edge) for edge in EDGES]
    result = gx.Equilibrium(gx.Scene(film, *held)).find()
    assert result.free == () and not result.regular
    assert "translation z" in result.slack
    assert len(set(result.slack)) == len(result.slack)
    assert "without stiffness against translation z" in caplog.text
    assert "hold it by gx.Fixed" not in caplog.text


@pytest.mark.parametrize("size", [1e-6, 1e-3, 1e3])
def test_a_clamped_beam_of_any_size_is_held(comm, size):
    """The stiffness of directors [N m] falls with the third power of the size, and was below the
    round-off of numbers near one that do not act: a micro-beam counted as slack about its axis."""
    section = gx.sections.solid_circle(0.01 * size, E=1e9, nu=0.3, density=1500.0)
    mesh = line(comm, [(0, 0, 0), (size, 0, 0)], 10)
    beam = gx.Beam(mesh, section, normal=(0.0, 0.0, 1.0))
    tip = gx.loads.Force(beam.port("end"), (-1e-2 * size**2, 0.0, 0.0))
    result = gx.Equilibrium(gx.Scene(gx.Fixed(beam, "start", rotation=True), tip)).find()
    assert result.free == result.slack == ()
