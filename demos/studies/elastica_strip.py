"""The law `Elastica` compared with a plate whose wrinkles are resolved, on a strip that is bent under
tension.

The strip is that of `bending_strip` (Stein & Hedgepeth, NASA TN D-813, 1961) as a film of some
thickness: height H, the stress σ0 along and across it, ends that are turned by ±κL/2.  With

    K = E t H² κ/(2P) > 1

it wrinkles below y = b, and a film without any compressive stress has the closed form

    m = 2M/(PH) = 1 - ⅔ K^(-½),    b/H = 1 - K^(-½).

The wave length is predicted.  Wrinkles w = a(y) sin(kx) are as long as the film, which is
shortened by κ (b - y), so that

    a(y) = (2/k) √(κ (b - y)).

Their bending and the tension T = σ0 t along them cost, per length of the strip,

    D k² κ b²/2 + T κ Λ/(4 k²),    Λ = ln(k b),

where the logarithm is the integral of a'² up to the distance 1/k from the line y = b, as a wrinkle
does not change sooner than over its own length.  The smallest sum has

    k⁴ = T Λ/(2 D b²),    λ = π/k,                                                               (1)

and both parts are equal: as in the sheared film of `elastica_law` the wrinkles bear twice the stress
of Euler's strip, s = D k²/t.  A strip of the length λ/√2 bears it alone.

A section that bears the stress -s where a tension field bears none has the closed form of
`moment`, the prediction by hand.

The plate chooses its wave length: it starts with wrinkles of several lengths, and the equilibrium
with the least potential energy counts.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
from mpi4py import MPI
from scipy.optimize import brentq

import gossamer_fx as gx
from demos.studies.engine.study import Result, Study
from gossamer_fx.materials.film import FilmLaw
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.model.body import Array

# Height and length of the strip [m].
HEIGHT = 0.1
LENGTH = 0.2
FILM = {"E": 2.5e9, "nu": 0.3, "density": 1420.0}
# Strain of the tension σ0, and how far the strip is bent: 42 % of its height wrinkle.
STRAIN = 5e-4
TENSION = STRAIN * FILM["E"]  # σ0 [Pa]
BEND = 3.0  # K
CURVATURE = 2 * STRAIN * BEND / HEIGHT  # κ [1/m]
WRINKLED = HEIGHT * (1 - BEND**-0.5)  # b [m]
# Lengths of the first wrinkles of the plate over that of equation (1).
STARTS = (0.65, 0.8, 1.0, 1.25)
# Cells of the plate to a half wave along the strip, and over its height for each of them.
CELLS_PER_HALF_WAVE = {"plate": 4, "plate, finer": 6}
ROWS_PER_CELL = 6
# Cells of the films over the height, of order 2.
FILM_CELLS = 20
WITH_TENSION = "Elastica, λ/√2"
MODELS = ("plate", "plate, finer", "tension field", "Elastica", WITH_TENSION)
PLATE_SEARCH = gx.analysis.Continuation(
    first_step=1e-4,
    growth_factor=2.0,
    inner_tolerance=0.3,
    tolerance=1e-5,
    fast_iterations=20,
    max_iterations=40,
    total_iterations=1000,
)
FILM_SEARCH = gx.analysis.Continuation(first_step=1e-4, tolerance=1e-6)


def wave_number(thickness: float) -> float:
    """k [1/m] of equation (1)."""
    bending = FILM["E"] * thickness**3 / (12 * (1 - FILM["nu"] ** 2))

    def excess(k: float) -> float:
        return k**4 - TENSION * thickness * math.log(k * WRINKLED) / (2 * bending * WRINKLED**2)

    # Wrinkles are shorter than b and longer than the thickness.
    return float(brentq(excess, 2 / WRINKLED, 1 / thickness))


def half_wavelength(thickness: float) -> float:
    """λ [m] of equation (1)."""
    return math.pi / wave_number(thickness)


def strip_stress(thickness: float, half: float) -> float:
    """Stress s [Pa] of Euler's strip with the length `half` [m]."""
    modulus = FILM["E"] / (1 - FILM["nu"] ** 2)
    return modulus * (math.pi * thickness / half) ** 2 / 12


def moment(K: float, stress: float) -> float:
    """m = 2M/(PH) of a section that bears at most a compressive stress s [Pa], for K and σ0.

    In units of P and H: the section bears 2K (y - b) above, and -s/σ0 where that would be less.
    """
    most = stress / TENSION
    # Depth below b in which the compression grows to s.
    depth = most / (2 * K)

    def force(b: float) -> float:
        """P of a section whose stress vanishes at b."""
        return K * (1 - b) ** 2 - K * min(b, depth) ** 2 - most * max(b - depth, 0.0)

    b = float(brentq(lambda b: force(b) - 1, 0.0, 1.0))
    y, weights = np.polynomial.legendre.leggauss(400)
    y = (y + 1) / 2
    stresses = np.maximum(2 * K * (y - b), -most)
    # The weights are those of an interval of length two, and m has the factor 2.
    return float(weights @ (stresses * (y - 0.5)))


def ends(X: Array, t: float) -> Array:
    """Displacement (3, n) [m] of the ends, which stay straight, by the closed form."""
    uniaxial = CURVATURE * (X[1] - WRINKLED)
    strain = uniaxial - FILM["nu"] * STRAIN
    return np.stack([strain * (X[0] - LENGTH / 2), 0 * strain, 0 * strain])


def scene(body: gx.Membrane, is_plane: bool) -> tuple[gx.Fixed, gx.Scene]:
    """What moves the right end, and the strip with its supports and loads."""
    # A film that is held in its plane has its heights from there.
    held = (0,) if is_plane else (0, 2)
    moved = gx.Fixed(body, "right", motion=ends, components=held)
    pull = TENSION * body.law.thickness
    items: list[object] = [
        body,
        moved,
        gx.Fixed(body, "left", motion=ends, components=held),
        gx.Fixed(body, "bottom left", components=(1,)),
        gx.loads.EdgeLoad(body, "top", force=(0.0, pull, 0.0)),
        gx.loads.EdgeLoad(body, "bottom", force=(0.0, -pull, 0.0)),
    ]
    if is_plane:
        items.append(gx.Fixed(body, "film", components=(2,)))
    return moved, gx.Scene(*items)  # type: ignore[arg-type]


def solved(moved: gx.Fixed, search: gx.Equilibrium) -> dict[str, float]:
    """Find the equilibrium; m and K of its force, its potential energy [J], and the search."""
    found = search.find()
    body = moved.body
    thickness = body.law.thickness
    edges = {name: edge(body, search, name) for name in ("bottom", "top")}
    # The centre of the end as it has moved; dead loads have a moment about the old one.
    height = HEIGHT / 2 + float(edges["bottom"][-1, 2] + edges["top"][-1, 2]) / 2
    force, couple = search.reaction(moved, about=(LENGTH, height, 0.0))
    opening = simpson(edges["top"]) - simpson(edges["bottom"])
    stored = sum(found.totals.stored.values())
    P = float(force[0])
    return {
        "m": -2 * float(couple[2]) / (P * HEIGHT),
        "K": FILM["E"] * thickness * HEIGHT**2 * CURVATURE / (2 * P),
        "potential": stored - TENSION * thickness * opening,
        "unknowns": search.system.numbering.size,
        "iterations": found.iterations,
        "residual": found.residual,
        "seconds": found.seconds,
    }


def edge(body: gx.Membrane, search: gx.Equilibrium, name: str) -> Array:
    """Nodes (n, 4) of a long edge in order: x of the mesh, and their displacement [m]."""
    y = {"bottom": 0.0, "top": HEIGHT}[name]
    return line(body, search, y)


def line(body: gx.Membrane, search: gx.Equilibrium, y: float) -> Array:
    """Nodes (n, 4) at a height y of the mesh in order: x of the mesh, and their displacement [m];
    all ranks have all."""
    x = search.system.state[body].local_positions()
    X = body.space.tabulate_dof_coordinates()
    chosen = np.abs(X[:, 1] - y) < 1e-9
    mine = np.column_stack([X[chosen, 0], (x - X)[chosen]])
    parts = body.comm.allgather(mine)
    # Nodes on the border of two ranks are known to both.
    _, first = np.unique(np.round(np.concatenate(parts)[:, 0], 9), return_index=True)
    rows: Array = np.concatenate(parts)[first]
    return rows


def simpson(rows: Array) -> float:
    """Integral of the transverse displacement [m²] along an edge of cells of order 2."""
    h = rows[2:, 0] - rows[:-2, 0]
    v = rows[:, 2]
    cells = slice(None, None, 2)
    return float(np.sum(h[cells] * (v[:-2] + 4 * v[1:-1] + v[2:])[cells]) / 6)


def half_waves(body: gx.Membrane, search: gx.Equilibrium, rows: int) -> float:
    """Number of half waves of the wrinkles along the line at half of their height; fractions by
    the zeros of the middle."""
    step = HEIGHT / rows
    y = step * round(WRINKLED / 2 / step)
    found = line(body, search, y)
    x = found[:, 0]
    w = found[:, 3]
    i = np.flatnonzero(w[:-1] * w[1:] < 0)
    zeros = x[i] - w[i] * (x[i + 1] - x[i]) / (w[i + 1] - w[i])
    if len(zeros) < 2:
        return math.nan
    return LENGTH / float(np.diff(zeros).mean())


@cache
def reference(thickness: float, model: str = "plate") -> Mapping[str, float]:
    """The plate that has the least potential energy of those that start with several lengths."""
    comm = MPI.COMM_WORLD
    cells = CELLS_PER_HALF_WAVE[model]
    predicted = half_wavelength(thickness)
    counts = [round(LENGTH / (scale * predicted)) for scale in STARTS]
    if model != "plate":
        # The finer plate has the wrinkles that the other one has chosen.
        counts = [round(1e3 * LENGTH / reference(thickness)["plate's λ [mm]"])]
    columns = round(cells * LENGTH / predicted)
    rows = ROWS_PER_CELL * cells
    candidates = []
    for n in counts:
        body = gx.Plate(
            sheet(comm, columns, rows, LENGTH, HEIGHT, crossed=True),
            gx.Linear(**FILM, thickness=thickness),
            displacement=lambda X, n=n: wrinkled(X, n),
        )
        moved, whole = scene(body, is_plane=False)
        search = gx.Equilibrium(whole, PLATE_SEARCH)
        found = solved(moved, search)
        found["plate's λ [mm]"] = 1e3 * LENGTH / half_waves(body, search, 2 * rows)
        candidates.append(found)
    best = min(candidates, key=lambda found: found["potential"])
    lengths = [found["plate's λ [mm]"] for found in candidates]
    seconds = sum(found["seconds"] for found in candidates)
    return best | {
        "seconds": seconds,
        "least λ [mm]": min(lengths),
        "largest λ [mm]": max(lengths),
    }


def wrinkled(X: Array, n: int) -> Array:
    """Displacement (3, m) [m] of the strip with n half waves of the size that takes up the
    shortening."""
    k = n * math.pi / LENGTH
    height = 2 / k * np.sqrt(CURVATURE * np.maximum(WRINKLED - X[1], 0.0)) * np.sin(k * X[0])
    plane = ends(X, 0.0)
    # Below b the film is as long as at rest along x, apart from its wrinkles.
    return plane + np.stack([0 * height, 0 * height, height])


def problem(comm: MPI.Comm, thickness: float, model: str) -> dict[str, float]:
    """One model of the strip; the excess is m over that of a film without compressive stress."""
    half = half_wavelength(thickness)
    known = reference(thickness)
    if model in CELLS_PER_HALF_WAVE:
        found = dict(reference(thickness, model))
    else:
        law: FilmLaw = gx.TensionField(**FILM, thickness=thickness)
        if model.startswith("Elastica"):
            length = half / math.sqrt(2) if model == WITH_TENSION else half
            law = gx.Elastica(**FILM, thickness=thickness, half_wavelength=length)
        cells = (round(FILM_CELLS * LENGTH / HEIGHT), FILM_CELLS)
        mesh = sheet(comm, *cells, LENGTH, HEIGHT, crossed=True)
        body = gx.Membrane(mesh, law, order=2, displacement=lambda X: ends(X, 0.0))
        moved, whole = scene(body, is_plane=True)
        found = solved(moved, gx.Equilibrium(whole, FILM_SEARCH))
    free = 1 - 2 / 3 * found["K"] ** -0.5
    free_of_plate = 1 - 2 / 3 * known["K"] ** -0.5
    stress = 2 * strip_stress(thickness, half)
    return found | {
        "λ [mm]": 1e3 * half,
        "s/σ0": stress / TENSION,
        "excess": found["m"] - free,
        "excess by hand": moment(found["K"], stress) - free,
        "error": (found["m"] - free) - (known["m"] - free_of_plate),
    }


STUDY = Study(
    "elastica_strip",
    "A bent strip: Elastica, the tension field and resolved wrinkles",
    problem,
    {"thickness": [200e-6, 140e-6, 100e-6, 70e-6], "model": list(MODELS)},
    lambda case: case["thickness"],
    quick={"thickness": [200e-6], "model": ["plate", "tension field", WITH_TENSION]},
    columns=(
        "λ [mm]",
        "plate's λ [mm]",
        "least λ [mm]",
        "largest λ [mm]",
        "s/σ0",
        "m",
        "K",
        "excess",
        "excess by hand",
        "error",
        "unknowns",
        "iterations",
        "residual",
        "seconds",
    ),
)
