"""First bending frequency of a film tube under tension, which vibrates in air.

The tube is a beam of its measured bending stiffness EI, clamped at both ends, of which one is moved
outwards until the tension is T.  The air inside moves with the tube, and so does as much air
outside: a slender round tube that moves across a fluid of density ρ has the added mass ρ A, with
the area A of its section.  Shear and rotary inertia are those of a round thin wall.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.validation.engine.case import Array, Inputs
from demos.validation.engine.comparison import Predicted, Prediction
from gossamer_fx.extend import check
from meshes.line import line

CELLS = 48
QUICK_CELLS = 16
# Part of the area of a round thin wall that bears shear.
SHEAR_PART = 0.5


def section(inputs: Inputs, air: float) -> gx.sections.Section:
    """Of the tube, with the mass of air [kg/m] that moves with it."""
    diameter = inputs.number("diameter", "m", above=0)
    wall = inputs.number("wall_thickness", "m", above=0)
    E = inputs.number("E", "Pa", above=0)
    shear_modulus = E / (2 * (1 + inputs.number("poisson", "1")))
    area = math.pi * diameter * wall
    second_moment = area * diameter**2 / 8
    mass = inputs.number("mass_per_length", "kg/m", above=0)
    bending = inputs.number("bending_stiffness", "N m2", above=0)
    shear = SHEAR_PART * shear_modulus * area
    # The wall turns, and the air in it slides.
    rotary = mass * second_moment / area
    return gx.sections.Section(
        EA=E * area,
        GA2=shear,
        GA3=shear,
        EI2=bending,
        EI3=bending,
        GJ=2 * shear_modulus * second_moment,
        line_density=mass + air,
        rotary2=rotary,
        rotary3=rotary,
    )


def moved(X: Array, tension: float, EA: float) -> Array:
    """Displacement (3, n) [m] of the end by which the beam has a tension [N]."""
    return np.stack([X[0] * tension / EA, 0 * X[1], 0 * X[2]])


def predict(inputs: Inputs, comm: MPI.Intracomm, quick: bool) -> Prediction:
    """Frequencies [Hz] under each tension, in air and without air."""
    length = inputs.number("length", "m", above=0)
    tensions = inputs.numbers("tension_masses", "kg") * inputs.number("gravity", "m/s2")
    check(
        bool((tensions > 0).all()),
        f"{inputs.where}: tension_masses are {tensions.tolist()} N; give masses above 0.",
    )
    air = inputs.number("air_inside", "kg/m") + inputs.number("air_outside", "kg/m")
    cells = QUICK_CELLS if quick else CELLS
    if "cells" in inputs:
        cells = inputs.whole("cells", least=2)
    quantities = {}
    details = {"unknowns": 0.0, "iterations": 0.0, "seconds": 0.0}
    for name, carried in (("frequency", air), ("frequency without air", 0.0)):
        beam = gx.Beam(line(comm, [(0, 0, 0), (length, 0, 0)], cells), section(inputs, carried))
        pulled = gx.Fixed(beam, "end", motion=partial(moved, EA=beam.section.EA), rotation=True)
        search = gx.Equilibrium(gx.Scene(gx.Fixed(beam, "start", rotation=True), pulled))
        found = []
        for tension in tensions.tolist():
            result = search.find(at=tension)
            details["iterations"] += result.iterations
            details["seconds"] += result.seconds
            # Two planes share each frequency.
            found.append(gx.analysis.modes(search, 2)[0].frequency)
        quantities[name] = Predicted(np.array(found))
        details["unknowns"] = float(search.system.unknowns.numbering.size)
    return Prediction(quantities, details)


# Numbers that a case may leave out, with the unit in which they are set then.
OPTIONAL_INPUTS = {"cells": "1"}
