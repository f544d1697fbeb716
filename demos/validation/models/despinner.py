"""A spinning hub that two masses slow down: they unwind cords from it, which leave it when they are
radial.

The hub turns about a vertical axis, with a constant moment of friction in its bearing. Each cord is
knotted to the hub, wound around it and touches it by contact.  The masses also fall, so that they
pull the cords down along the drum; friction of cord and drum resists that.  When the cords have
turned into the radial direction at their knots, they leave them.  From then on the hub is alone:
its rate falls by T/I and ends at zero.

Closed form of the rate then, without friction, weight and mass of the cords: energy and momentum of
a mass at the radius R + L that moves around the axis only,

    I ω + m (R + L) v = I ω0 + m R² ω0,    I ω² + m v² = (I + m R²) ω0²,    m of both masses.

The length of a cord in the model is the given one less a shortening, which stands for not knowing
between which points a length was measured.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.spinning import drum
from demos.sails.yo_yo import STANDOFF, WoundCord, on_drum
from demos.validation.engine.case import Inputs
from demos.validation.engine.comparison import Predicted, Prediction
from gossamer_fx.extend import check

# Numbers that a case may leave out, with the unit in which they are set then.
OPTIONAL_INPUTS = {"cells": "1", "drum_friction": "1", "longest_step": "s"}

# Cells of a cord and longest step [s], unless the inputs "cells" and "longest_step" are given.
CELLS = 24
LONGEST_STEP = 1e-3
QUICK_CELLS = 12
QUICK_LONGEST_STEP = 2e-3
FIRST_STEP = 2e-4

# Heights [m] of the two cords, so that cords of more than half a turn do not touch each other.
HEIGHT = 3e-3
# The drum is so long that no cord slides off it [m].
DRUM_HALF_LENGTH = 0.3
# Mass of the hub [kg]: it is held by its bearing, so that it does not count.
HUB_MASS = 1.0

# Part of the drop at which it counts as ended, and the rest of it as begun: begin and end are flat,
# and readings have noise.
ENDED = 0.95

# Time before the drop that the curve of the rate shows [s].
BEFORE = 0.2

# Latest release over the time L/(R ω0) in which a cord without mass unwinds.
LATEST = 4.0


def closed_form(inertia: float, radius: float, mass: float, length: float, rate: float) -> float:
    """Rate of the hub [rad/s] after a radial release, of the equations of the module; `mass` [kg]
    is that of both masses."""
    far = radius + length
    ratio = mass * far**2 / inertia
    # With v = (P - ω) I/(m far), P = (1 + m R²/I) ω0, the energy is a quadratic equation in ω.
    whole = 1 + mass * radius**2 / inertia
    P = whole * rate
    discriminant = (P / ratio) ** 2 - (1 + 1 / ratio) * (P**2 / ratio - whole * rate**2)
    # The other root is that of the start, or beyond it.
    return (P / ratio - math.sqrt(discriminant)) / (1 + 1 / ratio)


def predict(inputs: Inputs, comm: MPI.Intracomm, quick: bool) -> Prediction:
    """The rate of the hub over time, after the drop, and the duration of the drop."""
    begun = time.process_time()
    inertia = inputs.number("inertia", "kg m2", above=0)
    radius = inputs.number("radius", "m", above=0)
    mass = inputs.number("mass", "kg", above=0)
    rate = inputs.number("start", "rad/s", above=0)
    friction = inputs.number("friction", "N m")
    # Cases of an earlier form have no friction of the drum.
    drum_friction = inputs.number("drum_friction", "1") if "drum_friction" in inputs else 0.0
    gravity = inputs.number("gravity", "m/s2")
    length = inputs.number("cord", "m") - inputs.number("shortening", "m")
    check(length > 0, f"{inputs.where}: the cord is not longer than its shortening.")
    half_drop = inputs.number("half_drop", "s", above=0)
    last_time = inputs.number("last_time", "s", above=half_drop)
    cells = QUICK_CELLS if quick else CELLS
    longest_step = QUICK_LONGEST_STEP if quick else LONGEST_STEP
    if "cells" in inputs:
        cells = inputs.whole("cells", least=4)
    if "longest_step" in inputs:
        longest_step = inputs.number("longest_step", "s", above=0)

    hub = gx.RigidBody(HUB_MASS, (inertia / 2, inertia / 2, inertia), name="hub", comm=comm)
    # Chords of this angle add up to the length, with their middles at the radius.
    step = 2 * math.atan(length / (2 * cells * radius))
    law = gx.TensionOnly(
        EA=inputs.number("cord_stiffness", "N", above=0),
        line_density=inputs.number("cord_density", "kg/m", above=0),
    )
    cords = [
        WoundCord(
            comm,
            hub,
            number=k + 1,
            knot=math.pi * k,
            corners=radius / math.cos(step / 2),
            step=step,
            cells=cells,
            height=HEIGHT * (1 - 2 * k),
            mass=mass,
            law=law,
        )
        for k in range(2)
    ]
    g = (0.0, 0.0, -gravity)
    weights = [gx.Gravity(body, g) for one in cords for body in (one.cord, one.tip)]
    contact = on_drum(
        cords,
        drum(hub, radius - STANDOFF, -DRUM_HALF_LENGTH, DRUM_HALF_LENGTH),
        friction=drum_friction,
    )
    items: list[object] = [item for one in cords for item in one.items()]
    scene = gx.Scene(
        hub,
        *items,  # type: ignore[arg-type]
        *weights,
        contact,
        gx.constraints.RevoluteJoint(hub.frame(), gx.ground_frame(), axis=(0.0, 0.0, 1.0)),
        gx.loads.Torque(hub.frame(), (0.0, 0.0, -friction), name="friction"),
        gx.RigidMotion(spin=(0.0, 0.0, rate)),
    )
    across = hub.vector(2)
    outwards = hub.vector(1)

    def angle(run: Any) -> float:
        """Angle [rad] that the first cord has still to turn until it is radial at its knot."""
        state = run.system.unknowns.state
        offset = state.vector(cords[0].tip.port()) - state.vector(cords[0].root)
        behind = -float(offset @ state.vector(across))
        return math.atan2(behind, float(offset @ state.vector(outwards)))

    spin = gx.probes.AngularVelocity(hub.frame(), "z")
    series = gx.Series({"rate": spin, "penetrations": gx.probes.Penetrations(contact)})
    released = gx.When(
        angle, inputs.number("release_angle", "rad"), falling=True, stop=True, name="release"
    )
    run = gx.Simulation(
        scene,
        gx.Midpoint(dt=FIRST_STEP),
        outputs=[series],
        events=[released],
        control=gx.StepControl(target_iterations=10, max_step=longest_step),
    )
    latest = LATEST * length / (radius * rate)
    run.run(until=latest)
    check(
        run.time < latest,
        f"{inputs.where}: the cords are not radial after {latest:g} s; give shorter cords.",
    )
    rates = series["rate"]
    last = float(rates[-1])
    # Parts of the drop, which rise but for the vibrations of the cords.
    parts = np.maximum.accumulate((rate - rates) / (rate - last))
    first, middle, end = np.interp([1 - ENDED, 0.5, ENDED], parts, series.time)
    # Readings begin at some time before the drop.
    times = series.time - middle + half_drop
    # Before the drop, and the hub alone after it.
    slowing = friction / inertia
    alone = np.linspace(times[-1], last_time, 50)[1:]
    slowed = np.abs(last) - slowing * (alone - times[-1])
    curve_times = np.concatenate([[times[0] - BEFORE], times, alone])
    before = rate + slowing * BEFORE
    curve = np.concatenate([[before], rates, np.sign(last) * np.maximum(slowed, 0.0)])
    momentum = run.first.angular_momentum[2]
    drift = run.totals.angular_momentum[2] + friction * run.time - momentum
    quantities = {
        "rate": Predicted(curve, curve_times),
        "rate after the drop": Predicted(last),
        "duration of the drop": Predicted(float(end - first)),
    }
    details = {
        "closed form": closed_form(inertia, radius, 2 * mass, inputs.number("cord", "m"), rate),
        "momentum_drift": abs(drift / momentum),
        "penetrations": float(series["penetrations"].max()),
        "steps": float(run.step),
        "unknowns": float(run.system.unknowns.numbering.size),
        "seconds": time.process_time() - begun,
    }
    return Prediction(quantities, details)


def gradients(inputs: Inputs, prediction: Prediction) -> Mapping[str, Mapping[str, Predicted]]:
    """Exact derivatives by the time of half the drop, by which the curve is shifted."""
    curve = prediction.quantities["rate"]
    shifted = Predicted(-np.gradient(curve.y, curve.x), curve.x)
    others = {name: Predicted(0.0) for name in prediction.quantities}
    return {
        name: {"half_drop": shifted if name == "rate" else other} for name, other in others.items()
    }
