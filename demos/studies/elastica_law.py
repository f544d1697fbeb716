"""The law `Elastica` compared with a plate whose wrinkles are resolved, on a sheared film.

The question is when the law is better than a tension field.  The film of `wrinkled_plate` (380 ×
128 mm, both long edges clamped, one moved along itself) has thicknesses from 50 to 400 µm and is
sheared by γ = 0.3/128.  The half wavelength that the law needs is predicted by the theory of Wong &
Pellegrino (2006), not measured on the plate:

    λ = (πHt)^½ (3(1-ν²)γ)^(-¼)

Its wrinkles bear Euler's strain e = π² t²/(12 λ²) of compression.  A tension field leaves it out,
and the share of the stress that it leaves out is, with the strain γ/2 along the wrinkles,

    r = 2 e/γ = π t/(6 H) (3(1-ν²)/γ)^½

A strip of the law bends across its wrinkle only.  A wrinkle in a film is also held down by the
tension σ1 along it, which curves with the half length ℓ of its envelope.  The stress that keeps it
is that of both,

    D (π/λ)²/t + σ1 (λ/ℓ)²

and λ makes this least, where both parts are equal: the wrinkles bear twice the stress of the strip.
A strip of length λ/√2 bears it alone.

Models: "plate" is the reference, with four cells to a half wave; "plate, finer" has six, and is the
error of the reference; "tension field", "Elastica" with λ and "Elastica, λ/√2" are held in their
plane, as the law has the wrinkles already.  The films "Elastica, free" with λ may move out of it.
They have a compressive stress and no bending stiffness, so that short cells buckle: cells are of 16
mm, long ones of 32 mm.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache, partial
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.studies import wrinkled_plate
from demos.studies.engine.study import NOT_REGULAR, NOT_STABLE, Claim, Study, search_figures
from demos.studies.wrinkled_plate import FILM, HEIGHT, LEAN, LENGTH
from gossamer_fx.extend import FilmLaw, Result
from gossamer_fx.meshes.plates import leaning_sheet
from gossamer_fx.meshes.sheet import sheet

SHEAR = 0.3e-3  # displacement of the upper edge [m]
GAMMA = SHEAR / HEIGHT
# Cells of the plate to a half wave, along the sheet, by model; fewer than four make wrinkles
# longer, see `wrinkled_plate`.
CELLS_PER_HALF_WAVE = {"plate": 4, "plate, finer": 6}
# Cells of the plate across the sheet, along the wrinkles, for each cell of a half wave.
ROWS_PER_CELL = 4
# Cells of the films along the sheet and across it, of order 2.  With 48 × 16 forces are 0.4 %
# smaller, and the search takes ten times as long: the corners at the free ends are slack.
FILM_CELLS = (24, 8)
LONG_CELLS = (12, 4)
# The law with the length that stands for bending and tension.
WITH_TENSION = "Elastica, λ/√2"
# The law of films that may leave their plane; the second one has cells as long as the wrinkles of
# 200 µm.
FREE = "Elastica, free"
FREE_COARSE = "Elastica, free, long cells"
MODELS = ("plate", "plate, finer", "tension field", "Elastica", WITH_TENSION, FREE, FREE_COARSE)


def half_wavelength(thickness: float) -> float:
    """λ [m] of the theory."""
    return wrinkled_plate.half_wavelength(thickness, GAMMA)


def left_out(thickness: float) -> float:
    """r: Euler's strain of the wrinkles over the strain along them."""
    return math.pi * thickness / (6 * HEIGHT) * math.sqrt(3 * (1 - FILM["nu"] ** 2) / GAMMA)


moved = partial(wrinkled_plate.moved, shear=SHEAR)


def sheared(X: np.ndarray) -> np.ndarray:
    """Displacement (3, n) [m] of a uniform shear."""
    return np.stack([GAMMA * X[1], 0 * X[0], 0 * X[0]])


def waved(X: np.ndarray) -> np.ndarray:
    """Sheared, with waves of 1 µm: a film that is exactly plane has no reason to leave its
    plane."""
    height = 1e-6 * np.sin(150 * X[0] + 90 * X[1])
    return sheared(X) + np.stack([0 * height, 0 * height, height])


def plate(comm: MPI.Comm, thickness: float, cells: int) -> tuple[gx.Fixed, gx.Equilibrium]:
    """The plate with `cells` to a half wave, which starts with small wrinkles of the theory's
    length at 45°."""
    λ = half_wavelength(thickness)
    amplitude = wrinkled_plate.amplitude_of(λ, GAMMA)

    def wrinkled(X: np.ndarray) -> np.ndarray:
        across = (X[0] - X[1]) / math.sqrt(2)
        envelope = np.sin(math.pi * np.clip(X[1] / HEIGHT, 0, 1))
        height = amplitude * envelope * np.sin(math.pi / λ * across)
        return sheared(X) + np.stack([0 * height, 0 * height, height])

    columns = round(cells * LENGTH / (math.sqrt(2) * λ))
    mesh = leaning_sheet(comm, columns, ROWS_PER_CELL * cells, LENGTH, HEIGHT, LEAN)
    return wrinkled_plate.clamped_plate(mesh, thickness, wrinkled, SHEAR)


def membrane(comm: MPI.Comm, law: FilmLaw, model: str) -> tuple[gx.Fixed, gx.Equilibrium]:
    """The film with a law for its mean stress, held in its plane unless the model is free."""
    is_free = model in (FREE, FREE_COARSE)
    along, across = FILM_CELLS
    if model == FREE_COARSE:
        along, across = LONG_CELLS
    mesh = sheet(comm, along, across, LENGTH, HEIGHT)
    start = waved if is_free else sheared
    body = gx.Membrane(mesh, law, order=2, displacement=start)
    # A film that is held in its plane has its heights from there, also on its edges.
    held = (0, 1, 2) if is_free else (0, 1)
    above = gx.Fixed(body, "top", motion=moved, components=held)
    items: list[object] = [body, gx.Fixed(body, "bottom", components=held), above]
    if not is_free:
        items.append(gx.Fixed(body, "film", components=(2,), name="plane"))
    # A search that ends in NoEquilibrium is not longer than needed to tell.
    iterations = 150 if is_free else 500
    search = gx.analysis.Continuation(tolerance=1e-4, total_iterations=iterations)
    return above, gx.Equilibrium(gx.Scene(*items), search)  # type: ignore[arg-type]


@cache
def reference(thickness: float, model: str = "plate") -> Mapping[str, float]:
    """Force and energy of the plate, and the half wavelength that it has [mm]."""
    above, search = plate(MPI.COMM_WORLD, thickness, CELLS_PER_HALF_WAVE[model])
    found = solved(above, search)
    measured = wrinkled_plate.wrinkles(above.body, search)
    return found | {"plate's λ [mm]": measured["λ [mm]"]}


def solved(above: gx.Fixed, search: gx.Equilibrium) -> dict[str, float]:
    """Find the equilibrium: force [N] on the upper edge along the sheet, and stored energy [J]."""
    found = search.find()
    return {
        "force": float(search.reaction(above)[0][0]),
        "energy": sum(found.totals.stored.values()),
        "unknowns": search.system.unknowns.numbering.size,
        **search_figures(found),
    }


def problem(comm: MPI.Comm, thickness: float, model: str) -> dict[str, float]:
    """One model of the film; errors are those against the plate."""
    known = reference(thickness)
    λ = half_wavelength(thickness)
    if model in CELLS_PER_HALF_WAVE:
        found = dict(reference(thickness, model))
    else:
        law: FilmLaw = gx.TensionField(**FILM, thickness=thickness)
        if model.startswith("Elastica"):
            half = λ / math.sqrt(2) if model == WITH_TENSION else λ
            law = gx.Elastica(**FILM, thickness=thickness, half_wavelength=half)
        found = solved(*membrane(comm, law, model))
    return found | {
        "λ [mm]": 1e3 * λ,
        "r": left_out(thickness),
        "force error": found["force"] / known["force"] - 1,
        "energy error": found["energy"] / known["energy"] - 1,
    }


def draw(results: list[Result], path: Path) -> None:
    """Errors of the force and the energy of both laws over the share of the stress that a tension
    field leaves out."""
    from demos.common.figures import BLUE, GREEN, RED, finish, new_figure, save

    figure = new_figure()
    axes = figure.subplots(1, 2, sharex=True)
    for panel, what in zip(axes, ("force", "energy"), strict=True):
        for model, colour in (("tension field", BLUE), ("Elastica", RED), (WITH_TENSION, GREEN)):
            done = [r for r in results if not r.failed]
            rows = [r for r in done if r.values["model"] == model]
            shares = [r.numbers["r"] for r in rows]
            errors = [100 * r.numbers[f"{what} error"] for r in rows]
            panel.plot(shares, errors, "o-", color=colour, label=model)
        panel.axhline(0.0, color="black", linewidth=0.8)
        across = "Euler's strain over the strain along the wrinkles"
        finish(panel, across, f"error of the {what} against the plate [%]")
    save(figure, path, "A sheared film: laws of its mean stress and resolved wrinkles")


STUDY = Study(
    "elastica_law",
    "A sheared film: Elastica, the tension field and resolved wrinkles",
    problem,
    {"thickness": [400e-6, 200e-6, 100e-6, 50e-6], "model": list(MODELS)},
    lambda case: case["thickness"],
    quick={"thickness": [400e-6], "model": ["plate", "Elastica"]},
    shows=("force error", "energy error"),
    # Of the table of docs/theory/wrinkling.md: force less that of the plate, over it.
    claims=tuple(
        Claim("force error", value - 0.002, value + 0.002, {"thickness": thickness, "model": model})
        for thickness, values in (
            (400e-6, (-0.204, -0.152, -0.104)),
            (200e-6, (-0.122, -0.093, -0.065)),
            (50e-6, (-0.043, -0.035, -0.027)),
        )
        for model, value in zip(("tension field", "Elastica", WITH_TENSION), values, strict=True)
    ),
    columns=(
        "λ [mm], plate's λ [mm], r, force, force error, energy, energy error, unknowns, "
        "iterations, residual, seconds"
    ),
    # The free film with a compressive stress has no equilibrium on fine meshes: that is the result.
    may_fail=True,
    draw=draw,
    expected_warnings=NOT_STABLE | NOT_REGULAR,
)
