"""A tube that turns inside out at its tip, out of a vessel that gas flows into.

Gas and kinematics.  A travel s of the tip lets the gas take the volume A s, with the area A of the
inflated tube, and draws the length 2 s of the folded tube inside through the tip.  With the tension
T of that tail the work is p A ds = T 2 ds, so that the tube grows at p = 2 T/A, and half of the
pressure force moves the tip.

The chamber is the vessel and the volume behind a piston of the area A, at the position s.  The
friction of tail and reel is a constant force p_g A on the piston, from the mean pressure p_g of the
run; a stop keeps the tube from going back.  Inflow and leak are those of `leaking_vessel`.
"""

from __future__ import annotations

import math
import time

from mpi4py import MPI

import gossamer_fx as gx
from demos.validation.engine.case import Inputs
from demos.validation.engine.comparison import Predicted, Prediction
from demos.validation.models.leaking_vessel import AIR, QUICK_FACTOR, Air, leak_of

AXIS = (1.0, 0.0, 0.0)

# Of the stop [N/m]: it gives way by less than a millimetre under the friction.
STOP_STIFFNESS = 1e4
# Residual [N] that counts as zero: friction is some newtons, and while the tip rests only round-off
# changes.
NEGLIGIBLE_FORCE = 1e-9

# Distance from the piston to the fixed end of the stop [m].
STOP_LENGTH = 1.0


def predict(inputs: Inputs, comm: MPI.Intracomm, quick: bool) -> Prediction:
    """Travel of the tip [m] and gauge pressure [Pa] against time [s]."""
    begun = time.process_time()
    air = Air.read(inputs)
    volume = inputs.number("volume", "m3", above=0)
    radius = inputs.number("flat_width", "m", above=0) / math.pi
    area = math.pi * radius**2
    initial_length = inputs.number("initial_length", "m")
    start = inputs.number("start_pressure", "Pa")
    friction = inputs.number("growth_pressure", "Pa", above=0) * area
    duration = inputs.number("duration", "s", above=0)
    step = inputs.number("step", "s", above=0) * (QUICK_FACTOR if quick else 1)

    # The tail moves at twice the speed of the tip: its kinetic energy is ½ m (2v)².
    tail = inputs.number("line_density", "kg/m", above=0) * inputs.number("tube_length", "m")
    tip = gx.PointMass(4 * tail, comm=comm, name="tip")
    ambient = air.ambient()
    vessel = gx.Chamber(
        gx.gas.Piston(tip.port(), area, direction=AXIS),
        gas=AIR,
        pressure=air.pressure + start,
        temperature=air.temperature,
        dead_volume=volume + area * initial_length,
        outside=ambient,
        name="vessel",
    )
    # At the start the stop bears what friction has over pressure.
    preload = max(friction - start * area, 0.0)
    stop = gx.connectors.Stop(
        tip.port(),
        gx.Ground((-STOP_LENGTH, 0.0, 0.0)),
        stiffness=STOP_STIFFNESS,
        length=STOP_LENGTH + preload / STOP_STIFFNESS,
    )
    scene = gx.Scene(
        gx.loads.Force(tip.port(), (-friction, 0.0, 0.0), name="friction"),
        stop,
        air.wall(vessel),
        leak_of(inputs, air, volume, vessel, ambient),
        air.inflow(
            ambient,
            vessel,
            inputs.numbers("inflow_times", "s"),
            inputs.numbers("inflow", "m3/s"),
        ),
    )
    tolerances = gx.Tolerances(absolute=NEGLIGIBLE_FORCE)
    series = gx.Series({"travel": gx.probes.Position(tip.port(), "x"), "pressure": air.gauge_of})
    stepper = gx.Midpoint(dt=step, tolerances=tolerances)
    run = gx.Simulation(scene, stepper, outputs=[series])
    run.run(until=math.ceil(duration / step) * step)
    quantities = {name: Predicted(series[name], series.time) for name in ("travel", "pressure")}
    details = {
        "energy error": run.energy_error,
        "steps": float(run.step),
        "seconds": time.process_time() - begun,
    }
    return Prediction(quantities, details)
