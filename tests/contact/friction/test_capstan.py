"""A cable with friction round a drum: the capstan equation, and a rest in which contact carries all
load."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.line import line

# Units: m, rad, N, m, kg/m and 1/s.
RADIUS = 0.05
WRAP = math.radians(120)
TAIL = 0.03
FRICTION = 0.3
CABLE_RADIUS = 2e-4
DISTANCE = 3e-4
LINE_DENSITY = 3.5e-4
DAMPING = 2e4

# Pull [N] at the end that holds.
HOLDING = 1.0


def wrapped_cable(pull, shift=0.0):
    """Return a run of a cable that lies on a drum, and the cable; its ends are pulled, one of them
    more.  All of it is moved along x by a shift [m]."""
    arc = RADIUS * WRAP
    s = np.linspace(-arc / 2 - TAIL, arc / 2 + TAIL, 17)
    angle = np.clip(s, -arc / 2, arc / 2) / RADIUS
    beyond = s - RADIUS * angle
    # Just inside the activation distance, so that contact begins gently.
    height = RADIUS + CABLE_RADIUS + 0.9 * DISTANCE
    x = height * np.sin(angle) + beyond * np.cos(angle)
    z = height * np.cos(angle) - np.abs(beyond) * np.sin(np.abs(angle))
    points = [(shift + float(one), 0.0, float(other)) for one, other in zip(x, z, strict=True)]
    cable = gx.Cable(
        line(MPI.COMM_SELF, points, 1), gx.CableLaw(EA=2500.0, line_density=LINE_DENSITY)
    )
    drum = gx.contact.Cylinder(start=(shift, -0.05, 0.0), end=(shift, 0.05, 0.0), radius=RADIUS)
    contact = gx.Contact(
        cable,
        drum,
        distance=DISTANCE,
        friction=FRICTION,
        radius={"cable": CABLE_RADIUS},
    )
    down = -math.sin(WRAP / 2)
    along = math.cos(WRAP / 2)

    def hold(time):
        force = HOLDING * min(time / 4e-3, 1.0)
        return -force * along, 0.0, force * down

    def draw(time):
        share = min(max(time - 8e-3, 0.0) / 5e-3, 1.0)
        force = (HOLDING + (pull - HOLDING) * share) * min(time / 4e-3, 1.0)
        return force * along, 0.0, force * down

    scene = gx.Scene(
        contact,
        gx.loads.Force(cable.port("start"), hold, name="hold"),
        gx.loads.Force(cable.port("end"), draw, name="draw"),
        gx.Damping(cable, mass_factor=DAMPING),
    )
    return gx.Simulation(scene, gx.Midpoint(dt=2e-4)), cable


# Far from the origin coordinates have fewer digits, but decisions do not depend on them.
@pytest.mark.parametrize("shift", [0.0, 100.0])
def test_sliding_follows_the_capstan_equation(shift):
    """Pull of a cable that slides at the speed v through air of the drag c v per length.

    On the drum dT/ds = μ T/R + c v, on the tails dT/ds = c v.
    """
    run, cable = wrapped_cable(pull=2.2, shift=shift)
    run.run(until=0.02)
    assert run.substeps == 0
    velocity = run.system.unknowns.state[cable].velocities()
    speed = np.linalg.norm(velocity, axis=1)
    # The same at both places [m/s], to the tolerance of the steps.
    assert speed.mean() == pytest.approx(0.210712, abs=1e-6)
    # All of the cable slides at one speed, up to the waves that damping leaves.
    assert speed.min() == pytest.approx(speed.max(), rel=0.05)
    drag = DAMPING * LINE_DENSITY * float(speed.mean())
    start = HOLDING + drag * TAIL
    share = drag * RADIUS / FRICTION
    end = (start + share) * math.exp(FRICTION * WRAP) - share + drag * TAIL
    # 2 %: the friction law is smoothed near zero slip.
    assert end == pytest.approx(2.2, rel=0.02)


def test_what_rests_under_load_takes_no_shorter_steps():
    """The residual is compared with the load that contact carries, because nothing moves."""
    run, cable = wrapped_cable(pull=1.5)
    start = run.system.unknowns.state[cable].positions().copy()
    run.run(until=0.022)
    moved = np.linalg.norm(run.system.unknowns.state[cable].positions() - start, axis=1)
    assert run.substeps == 0
    # The ends come nearer to the drum by the contact distance at most; they do not slide.
    assert moved.max() < DISTANCE
    assert abs(run.energy_error) < 1e-9
