"""A cable wound round a drum with friction, drawn slowly at one end: the ratio of the pulls at its
ends.

One end bears a constant pull T1; the other end is moved along its straight tail at a constant speed
that is far above the slip velocity of the regularised friction and slow enough for inertia to be
negligible. The pull T2 there is the tension of the last cell.  Euler's capstan equation, with the
friction coefficient μ and the angle of wrap θ [rad], is T2/T1 = exp(μ θ).

The cable is a helix of small pitch, so that turns do not touch each other.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.validation.engine.case import Array, Inputs
from demos.validation.engine.comparison import Predicted, Prediction
from gossamer_fx.meshes.line import line

# Angle [rad] between nodes on the drum, so that chords between them stay outside of it.
NODE_ANGLE = math.pi / 24
QUICK_NODE_ANGLE = math.pi / 18

# Lengths over the radius of the drum.
TAIL = 1.5
CABLE_RADIUS = 4e-3
DISTANCE = 6e-3
PITCH = 0.12

RADIUS = 0.05  # of the drum [m]; the ratio does not depend on it
PULL = 1.0  # T1 [N]
EA = 1e5  # [N]
LINE_DENSITY = 3.5e-4  # [kg/m]

# Motion.  Air of the drag c v per length damps the vibrations of the start; at this speed it is c v
# L, about 1e-3 of the pull.
SPEED = 5e-3  # [m/s]
SLIP_VELOCITY = 1e-3  # [m/s]; friction is whole above it
DAMPING = 4e3  # c over the line density [1/s]
RAMP = 4e-3  # duration of the increase of the pull, and then of the speed [s]
DT = 2e-4  # [s]

# The pull is averaged over the last part of the motion, after a slip of the drawn end of this many
# times the elongation of the cable.
SLIP_OVER_ELONGATION = 4.0
# Least duration of the motion [s], in which vibrations of the start have decayed.
MIN_DURATION = 0.05
AVERAGED_SHARE = 0.25


def helix(wrap: float, node_angle: float) -> Array:
    """Points (n, 3) of the cable: a tail, the wrapped part and a tail, at 0.9 of the contact
    distance."""
    standoff = RADIUS * (1 + CABLE_RADIUS + 0.9 * DISTANCE)
    count = max(round(wrap / node_angle), 2)
    angle = np.linspace(-wrap / 2, wrap / 2, count + 1)
    on_drum = np.stack(
        [
            standoff * np.sin(angle),
            PITCH * RADIUS * angle / (2 * math.pi),
            standoff * np.cos(angle),
        ],
        axis=1,
    )
    spacing = RADIUS * wrap / count
    steps = np.arange(1, max(round(TAIL * RADIUS / spacing), 2) + 1) * spacing
    first = tangent(wrap, -1)
    last = tangent(wrap, 1)
    before = on_drum[0] + steps[::-1, None] * first
    after = on_drum[-1] + steps[:, None] * last
    return np.concatenate([before, on_drum, after])


def tangent(wrap: float, side: int) -> Array:
    """Unit vector along the tail at an end of the wrapped part, away from the drum; side is -1 or
    1."""
    return np.array([side * math.cos(wrap / 2), 0.0, -math.sin(wrap / 2)])


def ramp(t: float, start: float) -> float:
    """From 0 to 1 within `RAMP`."""
    return min(max((t - start) / RAMP, 0.0), 1.0)


def travel(t: float, start: float) -> float:
    """Distance [m] at the time t of a motion whose speed grows within `RAMP`."""
    since = max(t - start, 0.0)
    if since < RAMP:
        return SPEED * since**2 / (2 * RAMP)
    return SPEED * (since - RAMP / 2)


def drawn_motion(direction: Array, start: float) -> Callable[[Array, float], Array]:
    """Displacement of the drawn end."""

    def motion(X: Array, t: float) -> Array:
        return np.repeat(
            travel(t, start) * direction[:, None],
            X.shape[1],
            axis=1,
        )

    return motion


def predict(inputs: Inputs, comm: MPI.Intracomm, quick: bool) -> Prediction:
    """The ratio of the pulls."""
    begun = time.process_time()
    wrap = inputs.number("wrap", "rad", above=0)
    friction = inputs.number("friction", "1", above=0)
    points = helix(wrap, QUICK_NODE_ANGLE if quick else NODE_ANGLE)
    cable = gx.Cable(
        line(
            comm,
            [tuple(map(float, point)) for point in points],
            1,
        ),
        gx.CableLaw(EA=EA, line_density=LINE_DENSITY),
        name="cable",
    )
    width = RADIUS * (1 + PITCH * wrap / (2 * math.pi))
    drum = gx.contact.Cylinder(
        start=(0.0, -width, 0.0),
        end=(0.0, width, 0.0),
        radius=RADIUS,
    )
    contact = gx.Contact(
        cable,
        drum,
        distance=DISTANCE * RADIUS,
        friction=friction,
        slip_velocity=SLIP_VELOCITY,
        radius={"cable": CABLE_RADIUS * RADIUS},
    )
    hold_direction = tangent(wrap, -1)

    def hold(t: float) -> tuple[float, float, float]:
        x, y, z = (PULL * ramp(t, 0.0) * hold_direction).tolist()
        return x, y, z

    scene = gx.Scene(
        contact,
        gx.loads.Force(cable.port("start"), hold, name="hold"),
        gx.Fixed(
            cable,
            "end",
            motion=drawn_motion(tangent(wrap, 1), RAMP),
        ),
        gx.Damping(cable, mass_factor=DAMPING),
    )
    run = gx.Simulation(scene, gx.Midpoint(dt=DT))
    cell = (cable.port("end"), cable.port_at(points[-2]))
    cell_length = float(np.linalg.norm(points[-1] - points[-2]))
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    elongation = PULL * math.exp(friction * wrap) / EA * length
    slip_time = (1 + SLIP_OVER_ELONGATION) * elongation / SPEED
    end_of_slip = 2 * RAMP + max(slip_time, MIN_DURATION)
    pulls = []
    averaged_from = (1 - AVERAGED_SHARE) * end_of_slip
    while run.time < end_of_slip:
        run.run(until=run.time + DT)
        if run.time > averaged_from:
            ends = [run.system.unknowns.state.vector(port) for port in cell]
            stretch = float(np.linalg.norm(ends[0] - ends[1])) / cell_length
            pulls.append(EA * (stretch**2 - 1) / 2 * stretch)
    details = {
        "scatter": float(np.std(pulls) / np.mean(pulls)),
        "unknowns": float(run.system.unknowns.numbering.size),
        "steps": float(run.step),
        "seconds": time.process_time() - begun,
    }
    return Prediction({"pull ratio": Predicted(float(np.mean(pulls)) / PULL)}, details)
