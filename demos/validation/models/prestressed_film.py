"""A square and a long film of one material, prestressed, clamped on their edges, under pressure.

A quarter of each is a flat film of order 2 with the prestress σ.  The closed forms for small
slopes give the pressure at a height h of the centre,

    p = A1 h + A2 h³
    long:    A1 = 2 σ t/a²,       A2 = 4/3 E t/((1-ν²) a⁴)                                      (1)
    square:  A1 = 3.393 σ t/a²,   A2 = E t/((1-ν) (0.8 + 0.062 ν)³ a⁴)                          (2)

with the thickness t and half the width, a.  (1) is exact far from the short edges.  In (2) A1 is
exact at small heights and A2 an approximation at large ones.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.validation.engine.case import Array, Inputs
from demos.validation.engine.comparison import Predicted, Prediction
from demos.validation.models.fabric_bulge import Bulge
from gossamer_fx.extend import check
from gossamer_fx.meshes.sheet import sheet

# Numbers that a case may leave out, with the unit in which they are set then.
OPTIONAL_INPUTS = {"cells": "1"}

# Cells over half of the width, and the largest length of a cell over its width: fields change along
# a long film near its short edges only.
CELLS = 10
QUICK_CELLS = 2
CELL_ASPECT = 1.5

# Pressures between zero and the largest one, evenly spaced.
PRESSURES = 18


def closed_form(
    tension: float, stiffness: float, poisson: float, half_width: float, is_square: bool
) -> tuple[float, float]:
    """A1 [Pa/m] and A2 [Pa/m³] of (1) or (2).

    Args:
        tension: σ t [N/m].
        stiffness: E t [N/m].
        poisson: ν.
        half_width: a [m].
        is_square: whether (2) holds.
    """
    if is_square:
        linear = 3.393 * tension
        cubic = stiffness / ((1 - poisson) * (0.8 + 0.062 * poisson) ** 3)
    else:
        linear = 2 * tension
        cubic = 4 / 3 * stiffness / (1 - poisson**2)
    return linear / half_width**2, cubic / half_width**4


def height_of(pressure: float, linear: float, cubic: float) -> float:
    """The height [m] with A1 h + A2 h³ = p, the one real root."""
    roots = np.roots([cubic, 0.0, linear, -pressure])
    return float(roots[np.argmin(np.abs(roots.imag))].real)


def predict(inputs: Inputs, comm: MPI.Intracomm, quick: bool) -> Prediction:
    """Heights [m] of the centres against pressure [Pa], their ratio, and both over the closed
    form."""
    a = inputs.number("width", "m", above=0) / 2
    b = inputs.number("length", "m", above=0) / 2
    thickness = inputs.number("thickness", "m", above=0)
    prestress = inputs.number("prestress", "Pa", above=0)
    law = gx.Linear(
        inputs.number("E", "Pa", above=0),
        inputs.number("poisson", "1"),
        density=inputs.number("density", "kg/m3", above=0),
        thickness=thickness,
    )
    check(b > a, f"{inputs.where}: length is {2 * b:g} m and width {2 * a:g} m; give a long film.")
    cells = QUICK_CELLS if quick else CELLS
    if "cells" in inputs:
        cells = inputs.whole("cells")
    largest = inputs.number("largest_pressure", "Pa", above=0)
    pressures = np.linspace(0.0, largest, PRESSURES + 1)[1:]

    heights: dict[str, Array] = {}
    quantities = {}
    details = {"unknowns": 0.0, "iterations": 0.0, "seconds": 0.0}
    for name, half_length in (("square", a), ("rectangle", b)):
        along = max(round(cells * half_length / (CELL_ASPECT * a)), cells)
        mesh = sheet(comm, along, cells, half_length, a, crossed=True)
        film = gx.Membrane(mesh, law, order=2, initial_stress=prestress, name=name)
        bulge = Bulge(film, ("right", "top"), on_x="bottom", on_y="left", centre="bottom left")
        found = bulge.heights(pressures)
        linear, cubic = closed_form(
            prestress * thickness,
            law.E * thickness,
            law.nu,
            a,
            is_square=name == "square",
        )
        exact = np.array([height_of(p, linear, cubic) for p in pressures.tolist()])
        heights[name] = found
        quantities[f"height of the {name}"] = Predicted(found, pressures)
        quantities[f"{name} over closed form"] = Predicted(found / exact, pressures)
        details["unknowns"] += bulge.unknowns
        details["iterations"] += bulge.effort.iterations
        details["seconds"] += bulge.effort.seconds
    ratio = heights["rectangle"] / heights["square"]
    quantities["rectangle over square"] = Predicted(ratio, pressures)
    return Prediction(quantities, details)
