"""A cable, or a strip of film, that hangs between two supports at the distance of its length.

Without load it is straight and without stress; weight makes it sag, and heat makes it longer.  A
strip is held at its ends along its length and height, and along one side across, so that it
contracts freely.  The search begins with the parabola of the sag

    f = w L²/(8 H),    H³ = E A (w L)²/24                                                      (1)

under the weight w per length, whose elongation (w L/H)²/24 is H/EA.
"""

from __future__ import annotations

import time

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.validation.engine.case import Array, Inputs
from demos.validation.engine.comparison import Predicted, Prediction
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet

# Numbers that a case may leave out, with the unit in which they are set then.
OPTIONAL_INPUTS = {"thermal_strain": "1", "width": "m"}

# Cells along the span, an even number, so that there is a node in its middle; of order 2.
CELLS = 40
QUICK_CELLS = 10
CELLS_ACROSS = 2  # of a strip

REFERENCE = 300.0  # temperature without thermal strain [K]


def predict(inputs: Inputs, comm: MPI.Intracomm, quick: bool) -> Prediction:
    """The sag in the middle [m]."""
    begun = time.process_time()
    length = inputs.number("length", "m", above=0)
    area = inputs.number("area", "m2", above=0)
    E = inputs.number("E", "Pa", above=0)
    density = inputs.number("density", "kg/m3", above=0)
    gravity = inputs.number("gravity", "m/s2", above=0)
    cells = QUICK_CELLS if quick else CELLS
    weight = density * area * gravity
    pull = (E * area * (weight * length) ** 2 / 24) ** (1 / 3)
    first_sag = weight * length**2 / (8 * pull)

    def hanging(X: Array) -> Array:
        share = X[0] / length
        sag = 4 * first_sag * share * (1 - share)
        return np.vstack([0 * sag, 0 * sag, -sag])

    body: gx.Cable | gx.Membrane
    if "width" in inputs:
        width = inputs.number("width", "m", above=0)
        law = gx.Linear(
            E,
            inputs.number("poisson", "1"),
            density=density,
            thickness=area / width,
        )
        mesh = sheet(comm, cells, CELLS_ACROSS, length, width)
        body = gx.Membrane(mesh, law, order=2, displacement=hanging, name="strip")
        supports = [
            gx.Fixed(body, "left", components=(0, 2)),
            gx.Fixed(body, "right", components=(0, 2)),
            gx.Fixed(body, "bottom", components=(1,)),
        ]
    else:
        # One kelvin of heating, with the thermal strain as coefficient of expansion.
        strain = inputs.number("thermal_strain", "1") if "thermal_strain" in inputs else 0.0
        heated = gx.materials.ThermalExpansion(strain, REFERENCE + 1, reference=REFERENCE)
        ends = [(0.0, 0.0, 0.0), (length, 0.0, 0.0)]
        # The analytical reference has engineering strain; at a strain of 0.1 % the sag of a cable
        # with Green's is 0.05 % smaller.
        cable_law = gx.CableLaw(
            EA=E * area,
            line_density=density * area,
            strain="engineering",
        )
        body = gx.Cable(
            line(comm, ends, cells),
            cable_law,
            order=2,
            thermal=heated,
            displacement=hanging,
        )
        supports = [gx.Fixed(body, "start"), gx.Fixed(body, "end")]
    scene = gx.Scene(body, *supports, gx.Gravity(body, (0.0, 0.0, -gravity)))
    search = gx.Equilibrium(scene)
    search.find()
    middle = search.system.unknowns.state.vector(body.port_at((length / 2, 0.0, 0.0)))
    details = {"seconds": time.process_time() - begun}
    return Prediction({"sag": Predicted(-float(middle[2]))}, details)
