"""A sheared film that wrinkles: as a plate, whose wrinkles are resolved, and as a tension field,
for comparison.

Kapton, L × H = 380 × 128 mm, t = 25 µm; both long edges are clamped, and one is moved by δ = 3 mm
along itself (Wong & Pellegrino, J. Mech. Mater. Struct. 1 (2006) 3, 27, 63).  With γ = δ/H their
theory has wrinkles at 45° of length √2 H, and

    half wavelength  λ = (πHt)^½ (3(1-ν²)γ)^(-¼) = 6.31 mm
    amplitude        a = (λ/π) (2(1-ν)γ)^½ = 0.361 mm
    number           L/(2√2 λ) = 21.3;  about 19 were counted
    force            E t L γ/4 (1 - c H/L), c near 1: the corners at the free ends are slack

λ and a are measured on the middle line in the middle 40 % of the length, away from the fans at the
ends; "counted" are the wrinkles of the whole line, fans included.  The cells of the plate are long
along the wrinkles and short across: four across half a wrinkle.  With two the wrinkles come out 1.7
times as long, with three 1.5 times: cells that cannot follow a wrinkle without stretching resist
it.  The plate starts from small wrinkles of the theory's length ("theory") or of 1.3 times that
("long").  From "long" it comes to 1.09 times the theory's length: 19.5 wrinkles, 1.22 times its
amplitude, and an energy that is less by 3e-5 of itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.studies.engine.study import NOT_REGULAR, Measure, Study
from gossamer_fx.meshes.plates import leaning_sheet
from gossamer_fx.meshes.sheet import sheet

# Sizes of the sheet, and displacement δ of its upper edge [m].
LENGTH = 0.38
HEIGHT = 0.128
THICKNESS = 25e-6
SHEAR = 3e-3
FILM = {"E": 3.5e9, "nu": 0.31, "density": 1420.0}
GAMMA = SHEAR / HEIGHT


def half_wavelength(thickness: float, gamma: float) -> float:
    """λ [m] of the theory, for a shear γ."""
    return math.sqrt(math.pi * HEIGHT * thickness) * (3 * (1 - FILM["nu"] ** 2) * gamma) ** -0.25


def amplitude_of(half: float, gamma: float) -> float:
    """a [m] of the theory, for a half wavelength λ [m] and a shear γ."""
    return half / math.pi * math.sqrt(2 * (1 - FILM["nu"]) * gamma)


LAMBDA = half_wavelength(THICKNESS, GAMMA)
AMPLITUDE = amplitude_of(LAMBDA, GAMMA)
FORCE = FILM["E"] * THICKNESS * LENGTH * GAMMA / 4
# Part of the length in which wrinkles are measured: away from the fans at the free ends.
CENTRE = (0.3, 0.7)
# Pseudo-steps of wrinkles need not be solved well; the remaining forces are in the slack corners.
SEARCH = gx.analysis.Continuation(
    first_step=1e-4,
    growth_factor=2.0,
    inner_tolerance=0.3,
    tolerance=1e-3,
    fast_iterations=20,
    max_iterations=40,
    total_iterations=2000,
)
# Length of the first wrinkles over that of the theory.
STARTS = {"theory": 1.0, "long": 1.3}
# Length at both ends in which the cells of the plate turn upright, see `leaning_sheet` [m].
LEAN = 0.11


def moved(X: np.ndarray, t: float, shear: float = SHEAR) -> np.ndarray:
    """Displacement (3, n) [m] of the upper edge."""
    return np.stack([shear + 0 * X[0], 0 * X[0], 0 * X[0]])


def sheared(X: np.ndarray) -> np.ndarray:
    """Displacement (3, n) [m] of a uniform shear."""
    return np.stack([SHEAR * X[1] / HEIGHT, 0 * X[0], 0 * X[0]])


def wrinkled(X: np.ndarray, scale: float) -> np.ndarray:
    """Sheared, with wrinkles at 45° of the length and slope of the theory, or of another length."""
    k = math.pi / (scale * LAMBDA)
    a = scale * AMPLITUDE
    across = (X[0] - X[1]) / math.sqrt(2)
    # No height at the clamped edges.
    height = a * np.sqrt(np.maximum(np.sin(math.pi * np.clip(X[1] / HEIGHT, 0, 1)), 0))
    # So that wrinkles do not strain.
    shift = -(height**2) * k / 8 * np.sin(2 * k * across) / math.sqrt(2)
    return sheared(X) + np.stack([shift, -shift, height * np.sin(k * across)])


def clamped_plate(
    mesh: gx.Mesh,
    thickness: float,
    start: Callable[[np.ndarray], np.ndarray],
    shear: float = SHEAR,
) -> tuple[gx.Fixed, gx.Equilibrium]:
    """The plate with clamped long edges, from a displacement at the start, and the moved clamp."""
    plate = gx.Plate(mesh, gx.Linear(**FILM, thickness=thickness), displacement=start)
    clamp = partial(gx.Fixed, plate, rotation=True, direction=(0.0, 1.0, 0.0))
    above = clamp("top", motion=partial(moved, shear=shear), name="top")
    below = clamp("bottom", name="bottom")
    return above, gx.Equilibrium(gx.Scene(plate, below, above), SEARCH)


def problem(comm: MPI.Comm, start: str, cells: int) -> dict[str, float]:
    """A plate with `cells` to a centimetre along the sheet, as long as they lie along the wrinkles;
    and a film."""
    shape = partial(wrinkled, scale=STARTS[start])
    # The cells lean with the wrinkles, and are long along them.
    mesh = leaning_sheet(comm, 38 * cells, 16, LENGTH, HEIGHT, LEAN)
    clamp, equilibrium = clamped_plate(mesh, THICKNESS, shape)
    found = equilibrium.find()
    measured = wrinkles(clamp.body, equilibrium)
    force = equilibrium.reaction(clamp)[0][0]

    # The film for comparison: fewer cells, order 2.
    mesh = sheet(comm, 48, 16, LENGTH, HEIGHT)
    law = gx.TensionField(**FILM, thickness=THICKNESS)
    film = gx.Membrane(mesh, law, order=2, displacement=sheared)
    top = gx.Fixed(film, "top", motion=moved)
    other = gx.Equilibrium(
        gx.Scene(film, gx.Fixed(film, "bottom"), top), gx.analysis.Continuation(tolerance=1e-4)
    )
    of_film = other.find()
    film_force = other.reaction(top)[0][0]
    return measured | {
        "force [N]": force,
        "film's force [N]": film_force,
        "force/film's": force / film_force,
        "force/(EtLγ/4)": force / FORCE,
        "energy [J]": sum(found.totals.stored.values()),
        "film's energy [J]": sum(of_film.totals.stored.values()),
        "residual": found.residual,
        "unknowns": equilibrium.system.unknowns.numbering.size,
        "film's unknowns": other.system.unknowns.numbering.size,
        "iterations": found.iterations,
        "seconds": found.seconds,
        "film's seconds": of_film.seconds,
    }


def wrinkles(plate: gx.Plate, equilibrium: gx.Equilibrium) -> dict[str, float]:
    """Number, half wavelength and amplitude of the wrinkles on the middle line."""
    z = equilibrium.system.unknowns.q0.array_r[2::3]
    X = plate.space.tabulate_dof_coordinates()[: len(z)]
    # Nodes of the middle line, of all ranks.
    middle = abs(X[:, 1] - HEIGHT / 2) < 1e-9
    parts = plate.comm.allgather(np.column_stack([X[middle, 0], z[middle]]))
    x, w = np.array(sorted(map(tuple, np.concatenate(parts)))).T
    # Changes of sign, and the zeros between by linear interpolation.
    i = np.flatnonzero(w[:-1] * w[1:] < 0)
    zeros = x[i] - w[i] * (x[i + 1] - x[i]) / (w[i + 1] - w[i])
    low, high = (share * LENGTH for share in CENTRE)
    central = zeros[(zeros > low) & (zeros < high)]
    # Along the sheet; across the wrinkles the distance is shorter by √2.
    half = math.nan
    if len(central) > 1:
        half = float(np.diff(central).mean()) / math.sqrt(2)
    # Amplitude of a sine from its standard deviation.
    amplitude = math.sqrt(2) * float(w[(x > low) & (x < high)].std())
    return {
        "number": LENGTH / (2 * math.sqrt(2) * half),
        "counted": len(zeros) / 2,
        "λ [mm]": 1e3 * half,
        "a [mm]": 1e3 * amplitude,
        "λ/theory": half / LAMBDA,
        "a/theory": amplitude / AMPLITUDE,
    }


STUDY = Study(
    "wrinkled_plate",
    "A sheared film: a plate with its wrinkles, and a tension field",
    problem,
    {"start": ["theory"], "cells": [5]},
    lambda case: 1e-2 / case["cells"],
    (
        Measure("λ/theory", 1.0, 0.15),
        Measure("a/theory", 1.0, 0.2),
        Measure("number", LENGTH / (2 * math.sqrt(2) * LAMBDA), 3 / 21.3),
        Measure("force/film's", 1.0, 0.05),
    ),
    quick={"start": ["theory"], "cells": [1]},
    expected_warnings=NOT_REGULAR,
    not_repeatable={"film's seconds": "a CPU time"},
    columns=(
        "counted, force [N], film's force [N], energy [J], unknowns, film's unknowns, iterations, "
        "seconds, film's seconds"
    ),
)
