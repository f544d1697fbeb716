"""Equilibria with contact: a film on a floor, and a tube that is pressed between two planes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mpi4py import MPI
from scipy.optimize import brentq

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.meshes.tube_section import cylinder
from tests.contact.scenes import SIGMA, film
from tests.small_scenes import at_rest

# Activation distance [m] and gravity [m/s²].
DISTANCE = 1e-3
GRAVITY = 9.81


def barrier_slope(x):
    """Derivative of the barrier (1 - x)³/(4x)."""
    return -((1 - x) ** 2) * (1 + 2 * x) / (4 * x**2)


def penalty_slope(x):
    """Derivative of the penalty of boundaries (1 - x)²/2."""
    return x - 1


@pytest.mark.mpi(1)
@pytest.mark.parametrize(("law", "slope"), [("barrier", barrier_slope), ("penalty", penalty_slope)])
@pytest.mark.parametrize("stiffness", [None, 1e6])
def test_a_film_lies_on_a_floor_where_contact_carries_its_weight(comm, law, slope, stiffness):
    """K d b'(z/d) + σ g = 0; without a stiffness K d is ten times the pressure of the loads."""
    # Two activation distances above the floor: contact must be found.
    sheet = film(comm, height=2 * DISTANCE)
    floor = gx.contact.Plane(point=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0))
    contact = gx.Contact(sheet, floor, distance=DISTANCE, law=law, stiffness=stiffness)
    equilibrium = gx.Equilibrium(gx.Scene(contact, gx.Gravity(sheet, (0.0, 0.0, -GRAVITY))))
    result = equilibrium.find()
    weight = SIGMA * GRAVITY
    largest = 10 * weight if stiffness is None else stiffness * DISTANCE
    # Height over the distance d at which contact carries the weight.
    expected = brentq(lambda x: largest * slope(x) + weight, 1e-6, 1.0)
    heights = equilibrium.system.unknowns.state[sheet].positions()[:, 2]
    assert heights == pytest.approx(expected * DISTANCE, rel=1e-6)
    # The floor resists neither sliding nor the turn about z.
    assert set(result.free) == {"translation x", "translation y", "rotation z"}
    assert result.residual < 1e-7
    # Probes take an equilibrium as they take a run.
    assert gx.probes.Penetrations(contact)(equilibrium) == 0
    push = gx.probes.ContactForce(contact, sheet, axis="z")(equilibrium)
    assert gx.probes.ContactForce(contact, floor, axis="z")(equilibrium) == pytest.approx(
        -push, rel=1e-12
    )


@pytest.mark.mpi(1)
def test_a_film_that_lands_later_has_its_own_stiffness(comm):
    """Each presses with K (d - z) = σ g: nodes of a fine mesh that land after those of a coarse one
    stand for their own area."""
    coarse = film(comm, n=2, height=1.3 * DISTANCE, name="coarse")
    fine = film(comm, n=4, height=4 * DISTANCE, at=(0.2, 0.0), name="fine")
    floor = gx.contact.Plane(point=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0))
    K = 2e3
    contact = gx.Contact(coarse, fine, floor, distance=DISTANCE, law="penalty", stiffness=K)
    weights = [gx.Gravity(one, (0, 0, -GRAVITY), name=f"{one.name} g") for one in (coarse, fine)]
    equilibrium = gx.Equilibrium(gx.Scene(contact, *weights))
    equilibrium.find()
    for one in (coarse, fine):
        heights = equilibrium.system.unknowns.state[one].positions()[:, 2]
        assert heights == pytest.approx(DISTANCE - SIGMA * GRAVITY / K, rel=1e-6)


RADIUS = 0.05
LENGTH = 0.02
PRESSURE = 1000.0
# E t [N/m] of the tube.
STIFFNESS = 1e9 * 25e-6


@pytest.mark.mpi(1)
@pytest.mark.parametrize(
    ("law", "increments"),
    # With one increment planes move by twenty times the distance at which contact begins.
    [("penalty", 8), ("barrier", 40), ("penalty", 1), ("barrier", 1)],
)
def test_a_tube_between_two_planes(comm, law, increments):
    """A tube of the radius R, pressed to the height 2 H, lies flat on a width of π (R - H) on each
    side.

    The force is that of the pressure on this width.
    """
    tube = gx.Membrane(
        cylinder(comm, RADIUS, LENGTH, 32, 2),
        gx.Miyazaki(1e9, 0.3, density=1400.0, thickness=25e-6, residual_stiffness=1e-6),
        name="tube",
    )
    press = 0.02
    # Both planes start 1.5 activation distances away from the tube.
    start = RADIUS + 1.5 * DISTANCE
    planes = [
        gx.contact.Plane(
            point=(0.0, 0.0, side * start),
            normal=(0.0, 0.0, -side),
            motion=lambda t, side=side: (0.0, 0.0, -side * press * t),
            name=name,
        )
        for side, name in ((1.0, "upper"), (-1.0, "lower"))
    ]
    contact = gx.Contact(tube, *planes, distance=DISTANCE, law=law)
    supports = [gx.Fixed(tube, rim, components=(0,)) for rim in ("first rim", "last rim")]
    supports += [gx.Fixed(tube, line, components=(1,)) for line in ("top", "bottom")]
    equilibrium = gx.Equilibrium(gx.Scene(contact, gx.Pressure(tube, PRESSURE), *supports))
    for k in range(increments + 1):
        result = equilibrium.find(at=k / increments)
    # Each increment has a tangent without a free motion.
    assert result.regular
    heights = equilibrium.system.unknowns.state[tube].positions()[:, 2]
    top = comm.allreduce(float(heights.max(initial=-1.0)), MPI.MAX)
    bottom = comm.allreduce(float(heights.min(initial=1.0)), MPI.MIN)
    hoop_strain = PRESSURE * RADIUS / STIFFNESS * (1 - 0.3**2)
    width = math.pi * (RADIUS * (1 + hoop_strain) - (top - bottom) / 2)
    force = PRESSURE * width * LENGTH
    on_upper = gx.probes.ContactForce(contact, planes[0], axis="z")
    on_lower = gx.probes.ContactForce(contact, planes[1], axis="z")
    # 1 %: the section has 32 sides.
    assert on_upper(equilibrium) == pytest.approx(force, rel=0.01)
    assert on_lower(equilibrium) == pytest.approx(-force, rel=0.01)


# A strip between two clamps that a drum lifts: E t [N/m], width, span and radius [m].
STRIP_STIFFNESS = 2.5e9 * 25e-6
WIDTH = 0.02
SPAN = 0.3
DRUM_RADIUS = 0.05
DRUM_DISTANCE = 5e-4
LIFT = 0.02


def force_of_drum(tension, gap):
    """Force of a drum on a strip under a tension [N] that was flat, from the straight parts and the
    arc, which is a gap [m] off the drum; without friction the tension is the same everywhere."""
    radius = DRUM_RADIUS + gap
    # Height of the axis above the clamps: the drum started two distances below the strip.
    height = LIFT - DRUM_RADIUS - 2 * DRUM_DISTANCE
    to_axis = math.hypot(SPAN / 2, height)
    straight = math.sqrt(to_axis**2 - radius**2)
    # Slope of the straight parts, and half of the angle of wrap.
    slope = math.asin(radius / to_axis) + math.atan2(height, SPAN / 2)
    stretch = 2 * (straight + radius * slope) / SPAN
    strain = (stretch**2 - 1) / 2
    return 2 * (tension + STRIP_STIFFNESS * WIDTH * strain) * stretch * math.sin(slope)


@pytest.mark.parametrize(
    ("law", "tension"), [("barrier", 20.0), ("barrier", 0.0), ("penalty", 0.0)]
)
def test_a_strip_without_loads_is_lifted_by_a_drum(comm, law, tension):
    """Prestress, or the stretch itself, presses the strip on the drum, but not through it."""
    mesh = sheet(comm, 40, 2, SPAN, WIDTH, crossed=True)
    fabric = gx.Miyazaki(2.5e9, 0.0, density=1400.0, thickness=25e-6, residual_stiffness=1e-4)
    stress = np.diag([tension / WIDTH / 25e-6, 0.0, 0.0])
    strip = gx.Membrane(mesh, fabric, initial_stress=stress if tension else None, name="strip")
    depth = -DRUM_RADIUS - 2 * DRUM_DISTANCE
    drum = gx.contact.Cylinder(
        start=(SPAN / 2, -WIDTH, depth),
        end=(SPAN / 2, 2 * WIDTH, depth),
        radius=DRUM_RADIUS,
        motion=lambda t: (0.0, 0.0, t),
    )
    contact = gx.Contact(strip, drum, distance=DRUM_DISTANCE, law=law)
    clamps = [gx.Fixed(strip, edge) for edge in ("left", "right")]
    equilibrium = gx.Equilibrium(gx.Scene(contact, *clamps))
    result = equilibrium.find(at=LIFT)
    assert result.regular and result.within_tolerance
    gap = gx.probes.ContactGap(contact)(equilibrium)
    # It was closed to a hundredth of this, or passed through.
    assert gap > 0.2 * DRUM_DISTANCE
    force = gx.probes.ContactForce(contact, strip, axis="z")(equilibrium)
    # 2.5 %: the arc has a corner at every 9 degrees.
    assert force == pytest.approx(force_of_drum(tension, gap), rel=0.025)


def test_an_obstacle_that_jumps_is_named(comm):
    sheet_on_floor = film(comm, height=2 * DISTANCE)
    floor = gx.contact.Plane(
        point=(0.0, 0.0, 0.0),
        normal=(0.0, 0.0, 1.0),
        motion=lambda t: (0.0, 0.0, 0.0 if t <= 0 else 5 * DISTANCE),
    )
    contact = gx.Contact(sheet_on_floor, floor, distance=DISTANCE)
    equilibrium = at_rest(contact, gx.Gravity(sheet_on_floor))
    with pytest.raises(
        gx.NoEquilibrium, match=r"no pseudo-step converged.*an obstacle moves by 0\.005 m"
    ):
        equilibrium.find(at=1.0)
