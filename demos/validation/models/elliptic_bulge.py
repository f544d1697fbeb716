"""An elliptic film under pressure, whose modulus is that by which its top is as high as measured.

A quarter of a flat film of order 2 is clamped on an ellipse.  Its law is that of incompressible
rubber, `NeoHooke`, or `Linear` of Green strain with Poisson's ratio 0.49.  Shapes depend on
p a/(E t) only, with the pressure p, the short semi-axis a and the thickness t, so that E is found
by one root.  Strains are logarithmic and those of the two axes of symmetry, along these axes.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from scipy.optimize import brentq

import gossamer_fx as gx
from demos.validation.engine.case import Array, Inputs
from demos.validation.engine.comparison import Predicted, Prediction
from demos.validation.models.fabric_bulge import Bulge, along_edge
from gossamer_fx.extend import check
from meshes.disc import quarter_disc

# Numbers that a case may leave out, with the unit in which they are set then.
OPTIONAL_INPUTS = {"cells": "1"}
# Cells along a semi-axis.
CELLS = 12
QUICK_CELLS = 4
# The density does not matter to an equilibrium, and the thickness to E t only.
DENSITY = 1000.0
THICKNESS = 1e-4
MODULUS = 1e6
# Between these loads p a/(E t) the root is looked for, on this grid.
LOADS = np.geomspace(1e-3, 0.5, 16)
# Points on a semi-axis where predictions are given, and the step of differences over the semi-axis.
POINTS = 41
DIFFERENCE = 1e-3


def law_of(name: str) -> gx.materials.NeoHooke | gx.Linear:
    """A law of the modulus E = `MODULUS`."""
    if name == "neo-Hooke":
        return gx.materials.NeoHooke(
            MODULUS / 3, density=DENSITY, thickness=THICKNESS, residual_stiffness=1e-6
        )
    return gx.Linear(MODULUS, 0.49, density=DENSITY, thickness=THICKNESS)


def predict(inputs: Inputs, comm: MPI.Intracomm, quick: bool) -> Prediction:
    """Heights [m] and strains on both axes against the position on the flat film [m], and strains
    of the top."""
    short = inputs.number("short_semi_axis", "m", above=0)
    long = inputs.number("long_semi_axis", "m", above=0)
    top = inputs.number("known_height", "m", above=0)
    pressure = inputs.number("pressure", "Pa", above=0)
    check(
        top < short,
        f"{inputs.where}: known_height is {top:g} m; give less than the short semi-axis.",
    )
    cells = QUICK_CELLS if quick else CELLS
    if "cells" in inputs:
        cells = inputs.whole("cells", least=2)
    mesh = quarter_disc(comm, cells, 1.0, order=2)
    mesh.domain.geometry.x[:, 0] *= short
    mesh.domain.geometry.x[:, 1] *= long
    film = gx.Membrane(mesh, law_of(inputs.word("law", ("neo-Hooke", "Green"))), order=2)
    bulge = Bulge(film, ("rim",), "x axis", "y axis", "centre")
    unit = MODULUS * THICKNESS / short

    # Heights grow with the load: the search goes up to the first load that is too large.
    below = 0.0
    for load in LOADS.tolist():
        if bulge.heights(np.array([load * unit]))[0] > top:
            break
        below = load
    else:
        check(False, f"{inputs.where}: known_height is {top:g} m; give less.")

    def excess(load: float) -> float:
        return float(bulge.heights(np.array([load * unit]))[0]) - top

    load = float(brentq(excess, max(below, 1e-6), load, xtol=1e-7))
    bulge.heights(np.array([load * unit]))
    nodes = np.linspace(0.0, 1.0, 4 * max(round(cells / 2), 1) + 1)
    position = np.linspace(0.0, 0.99, POINTS)
    quantities = {}
    for component, axis, semi_axis in ((0, "short", short), (1, "long", long)):
        points = np.zeros((len(nodes), 3))
        points[:, component] = nodes * semi_axis
        deformed = points + bulge.displacements(points)
        stretch = stretches(deformed, position, semi_axis)
        height = along_edge(deformed, position)[:, 2]
        quantities[f"height on the {axis} axis"] = Predicted(height, position * semi_axis)
        quantities[f"strain on the {axis} axis"] = Predicted(np.log(stretch), position * semi_axis)
        quantities[f"strain of the top, {axis}"] = Predicted(float(np.log(stretch[0])))
    details = {
        "modulus [Pa]": pressure * short / (load * inputs.number("thickness", "m", above=0)),
        "unknowns": float(bulge.unknowns),
        "iterations": float(bulge.effort.iterations),
        "seconds": bulge.effort.seconds,
    }
    return Prediction(quantities, details)


def stretches(deformed: Array, position: Array, semi_axis: float) -> Array:
    """Stretches (n,) along an axis at positions (n,) from 0 to 1, by differences.

    Args:
        deformed: nodes of the axis (m, 3) [m].
        position: where.
        semi_axis: length [m] of the axis without stress.
    """
    ahead = along_edge(deformed, position + DIFFERENCE)
    # From the top on only forwards: the other side is its mirror image.
    behind = along_edge(deformed, position)
    lengths = np.linalg.norm(ahead - behind, axis=1)
    return lengths / (DIFFERENCE * semi_axis)
