"""Published benchmarks of membranes, of wrinkling and of cloth in contact, in one command.

Most scenes are those of other studies, with the finest of their laws.  Each case is computed on
three levels: finer meshes, or shorter steps.  `error` is that of the value from the published one,
and `error/accepted` the error over what was accepted before the first run.

    airbag         square airbag at rest.  w_M (height of the middle), u_B (middle of an edge) and
                   σ1 in the middle of Jarasjarungkiat, Wüchner & Bletzinger, CMAME 198 (2009) 1097
                   on 10 x 10 cells, as tabled by D. Zhang & J. Kiendl, arXiv:2504.03400, section
                   5.4; here 4, 8 and 16 cells.  The table was read in a report that quotes it
    bent film      moment of a film bent in its plane, K = 2 (Stein & Hedgepeth, NASA TN D-813,
                   1961); the first analytic case of Zhang & Kiendl
    bent tube      moment of an inflated tube at five times the curvature of its first wrinkle (the
                   same source)
    hub torsion    turn of a hub in a tensioned ring of film; the equations are in `hub_torsion`
    Mylar balloon  volume of two discs of inextensible film (Taylor 1919; Paulsen 1994)
    disc           height of a clamped disc, 0.6534 a q^(1/3) (Hencky 1915, as corrected by Fichter,
                   NASA TP-3658, 1997), at q = pa/(Et) = 1e-3
    balloon        pressure of a rubber balloon up to twice its radius; Mooney-Rivlin with C1 = 7 C2
                   is that of H. Verhelst's benchmark_Balloon (gismo/gsStructuralAnalysis), after
                   Kiendl et al., CMAME 291 (2015) 280, Figure 4; the curve has a closed form
    sheared film   length of the wrinkles of a sheared Kapton film (Wong & Pellegrino, J. Mech.
                   Mater. Struct. 1 (2006) 3)
    slope          a film on a slope of slope 1/2.  With the friction 0.51 it rests: ppf's scene
                   "friction" (github st-tech/ppf-contact-solver, commit 0c84dcfb, examples), which
                   has an elastic body there.  With 0.4 it slides, with the acceleration
                   g (sin θ - μ cos θ).  The error is over the free fall along the slope
    sheets         ppf's scene "stack" (the same source, commit 026b29c0): ten square sheets of 2 m,
                   0.05 m apart, each turned by 9 degrees, fall to a floor, and a ball of 0.25 m
                   falls on them with 5 m/s.  Here two to four sheets, of larger cells than 1/64 m
    cloths         layers fall on a cylinder, as in "Offset Geometric Contact" (A. H. Chen et al.,
                   ACM Trans. Graph. 44 (2025) 160), which has 50 layers, 246 000 nodes and 0.21 s a
                   step on a CPU

Sheets and cloths have no published answer but that nothing passes through anything, and so are held
to this and to a balance of energy within 1e-8.  Sources give neither the material of the cloth nor
the length of the step; here it has 1 MPa, 0.2 kg/m², 0.5 mm, steps are at most 5 ms, and the scenes
fall for 0.2 s.  `published time` and `time` are run times of a step over a thousand nodes; the
machines are others.  ppf gives ratios of run times between versions only.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.figures import BLUE, RED, finish
from demos.studies import (
    airbag,
    bending_strip,
    bent_tube,
    clamped_disc,
    hub_torsion,
    mylar_balloon,
    wrinkled_plate,
)
from demos.studies.engine.study import NOT_REGULAR, NOT_STABLE, Measure, Study, search_figures
from demos.studies.equilibrium_paths import RADIUS, octant
from gossamer_fx.extend import Array, FilmLaw, Item, Obstacle, Result
from gossamer_fx.meshes.sheet import sheet

Figures = dict[str, float]
G = 9.81
# A soft cloth [Pa, 1, kg/m³, m].
CLOTH = gx.Miyazaki(E=1e6, nu=0.3, density=400.0, thickness=5e-4, residual_stiffness=1e-4)
AREA_DENSITY = 400.0 * 5e-4
# Published values of the airbag: on 10 cells, and the relative errors from them on 4 and 8 cells of
# the same program.
AIRBAG = {
    "w_M": (0.2167, (0.2149, 0.2166)),
    "u_B": (0.1237, (0.1202, 0.1227)),
    "σ1": (3.8e6, (3.2e6, 3.8e6)),
}
AIRBAG_CELLS = (4, 8, 16)
HENCKY = 0.653443
HENCKY_PRESSURE = 1e-3
# Shear modulus [Pa] and thickness [m] of the rubber; results do not depend on them.
SHEAR_MODULUS = 4.225e5
RUBBER = {"density": 1000.0, "thickness": 1e-3}
# Largest error of the energy in scenes of contact, over the largest energy.
ENERGY = 1e-8
# Run time of a step [s] over 1000 nodes of the stack of 246 000 nodes.
OGC_TIME = 0.21 / 246


def of_airbag(comm: MPI.Comm, level: int, quantity: str) -> Figures:
    """A quarter of one sheet of order 1, as that of the published values."""
    published, coarser = AIRBAG[quantity]
    cells = AIRBAG_CELLS[level]
    film, search = airbag.airbag(comm, airbag.LAWS["Miyazaki 1e-6"], 1, cells)
    found = search.find()
    if quantity == "w_M":
        value = float(airbag.displacement(film, search, "bottom left")[2])
    elif quantity == "u_B":
        value = -float(airbag.displacement(film, search, "bottom right")[0])
    else:
        value = airbag.stress_at(film, search, "bottom left")
    # Of the published program, on the meshes that it shares with this study.
    theirs = math.nan
    if level < len(coarser):
        theirs = abs(coarser[level] / published - 1)
    return {
        "value": value,
        "reference": published,
        "published error": theirs,
        **search_figures(found),
    }


def as_in(figures: Mapping[str, float], name: str, reference: float = 1.0) -> Figures:
    """A result of another study, with its reference."""
    return {
        "value": figures[name],
        "reference": reference,
        "iterations": figures["iterations"],
        "seconds": figures["seconds"],
    }


def bent_film(comm: MPI.Comm, level: int) -> Figures:
    nodes = (12, 24, 48)[level]
    return as_in(bending_strip.problem(comm, "TensionField", "P2", 2.0, nodes), "m/exact")


def tube(comm: MPI.Comm, level: int) -> Figures:
    return as_in(bent_tube.problem(comm, "P2", (16, 32, 64)[level]), "M(5κ_w)/exact")


def hub(comm: MPI.Comm, level: int) -> Figures:
    nodes = (12, 24, 48)[level]
    return as_in(hub_torsion.problem(comm, "TensionField", "P2", 1.5, nodes), "θ/exact")


def mylar(comm: MPI.Comm, level: int) -> Figures:
    found = mylar_balloon.problem(comm, "Miyazaki 1e-6", "P2", level)
    return as_in(found, "V/a³", 1.218524216)


def disc(comm: MPI.Comm, level: int) -> Figures:
    nodes = (4, 8, 16)[level]
    found = clamped_disc.problem(comm, "Miyazaki", "P2", HENCKY_PRESSURE, nodes)
    return as_in(found, "w0/a", HENCKY * HENCKY_PRESSURE ** (1 / 3))


def balloon(comm: MPI.Comm, level: int, law: FilmLaw, share: float) -> Figures:
    """A balloon of rubber with C2 = `share` C1; the value is the largest ratio of a computed
    pressure to the exact one."""
    film = gx.Membrane(octant(comm, (4, 6, 8)[level]), law, order=2)
    held = [gx.Fixed(film, name, components=(axis,)) for axis, name in enumerate("xyz")]
    unit = SHEAR_MODULUS * RUBBER["thickness"] / RADIUS
    search = gx.Equilibrium(gx.Scene(gx.Pressure(film, lambda t: unit * t), *held))
    top = gx.probes.Position(film.port_at((0.0, 0.0, RADIUS)), "z")
    start = time.process_time()
    found = gx.analysis.path(
        search, 1.5, start=0.2, first_step=0.2, probes={"z": top}, max_steps=16
    )
    λ = np.asarray(found.columns["z"]) / RADIUS
    exact = 2 * (1 / λ - λ**-7) * (1 + share * λ**2) / (1 + share)
    ratios = np.asarray(found.loads) / exact
    inside = λ <= 2.0
    worst = ratios[inside][np.argmax(abs(ratios[inside] - 1))]
    return {"value": float(worst), "reference": 1.0, "seconds": time.process_time() - start}


def sheared_film(comm: MPI.Comm, level: int) -> Figures:
    return as_in(wrinkled_plate.problem(comm, "theory", (1, 3, 5)[level]), "λ/theory")


def on_slope(comm: MPI.Comm, level: int, friction: float) -> Figures:
    """A film that starts at rest on a slope of slope 1/2, with the gap at which it rests."""
    angle = math.atan(0.5)
    gravity = (G * math.sin(angle), 0.0, -G * math.cos(angle))
    distance = 2e-3
    # The weight closes the gap by a hundredth of the distance.
    stiffness = 100 * AREA_DENSITY * G * math.cos(angle) / distance
    gap = 0.99 * distance

    def lifted(X: Array) -> Array:
        return np.stack([0 * X[0], 0 * X[1], gap + 0 * X[2]])

    film = gx.Membrane(sheet(comm, 4, 4, 0.2, 0.2), CLOTH, displacement=lifted, name="sheet")
    slope = gx.contact.Plane(point=(0, 0, 0), normal=(0, 0, 1), name="slope")
    contact = gx.Contact(
        film,
        slope,
        distance=distance,
        stiffness=stiffness,
        law="penalty",
        friction=friction,
    )
    run = gx.Simulation(
        gx.Scene(contact, gx.Gravity(film, gravity)), gx.Midpoint(dt=(1e-2, 5e-3, 2.5e-3)[level])
    )
    until = 0.5
    figures = contact_figures(run, contact, until)
    mass = AREA_DENSITY * 0.2**2
    speed = run.totals.momentum[0] / mass
    # Over the free fall along the slope.
    expected = max(0.0, 1 - friction / math.tan(angle))
    return {
        "value": speed / (gravity[0] * until),
        "reference": expected,
        "error": abs(speed / (gravity[0] * until) - expected),
        **figures,
    }


def contact_figures(run: gx.Simulation, contact: gx.Contact, until: float) -> Figures:
    """Balance of energy, interpenetrations and effort of a run up to a time [s]."""
    # CPU time: the machine may be busy.
    start = time.process_time()
    run.run(until=until)
    seconds = time.process_time() - start
    return {
        "energy_error": abs(run.energy_error),
        "penetrations": gx.probes.Penetrations(contact)(run),
        "steps": run.step,
        "iterations": run.iterations / run.step,
        "seconds": seconds,
    }


def laid(edge: float, angle: float, height: float) -> Callable[[Array], Array]:
    """Displacement (3, n) [m] that turns a sheet about its middle and lifts it above the origin."""
    c = math.cos(angle)
    s = math.sin(angle)

    def displacement(X: Array) -> Array:
        x = X[0] - edge / 2
        y = X[1] - edge / 2
        return np.stack([c * x - s * y - X[0], s * x + c * y - X[1], height + 0 * X[2]])

    return displacement


def dropped(
    films: list[gx.Membrane], obstacles: Sequence[Obstacle], *items: Item
) -> tuple[gx.Simulation, gx.Contact]:
    """Sheets that are about to fall on obstacles, with further items of the scene."""
    forces: list[Item] = []
    for film in films:
        forces.append(gx.Gravity(film, (0.0, 0.0, -G)))
        forces.append(gx.Damping(film, stiffness_factor=1e-3, name=f"damping of {film.name}"))
    contact = gx.Contact(*films, *obstacles, distance=5e-3, friction=0.2)
    step = 5e-3
    run = gx.Simulation(
        gx.Scene(contact, *forces, *items),
        gx.Midpoint(dt=step),
        control=gx.StepControl(max_step=step),
    )
    return run, contact


def stack(
    comm: MPI.Comm, layers: int, cells: int, edge: float, spacing: float
) -> list[gx.Membrane]:
    """Square sheets over the origin, each turned by 9 degrees against the one below.

    Args:
        comm: ranks.
        layers: number of sheets.
        cells: along an edge.
        edge: of a sheet [m].
        spacing: of the sheets, and height of the lowest one [m].
    """
    turn = math.radians(9)
    return [
        gx.Membrane(
            sheet(comm, cells, cells, edge, edge),
            CLOTH,
            displacement=laid(edge, k * turn, (k + 1) * spacing),
            name=f"sheet {k}",
        )
        for k in range(layers)
    ]


def of_fall(run: gx.Simulation, contact: gx.Contact, nodes: int, published: float) -> Figures:
    """What is accepted of a fall of 0.2 s is that nothing passes through anything, and that energy
    closes."""
    figures = contact_figures(run, contact, until=0.2)
    return {
        "value": figures["penetrations"],
        "reference": 0.0,
        "error": figures["penetrations"] + figures["energy_error"],
        "nodes": nodes,
        "time": 1e3 * figures["seconds"] / figures["steps"] / nodes,
        "published time": published,
        **figures,
    }


def sheets(comm: MPI.Comm, level: int) -> Figures:
    """Sheets and a ball: of the published ten sheets two, three and four."""
    layers = (2, 3, 4)[level]
    cells = 4
    radius = 0.25
    # Twice as heavy as a sheet.
    mass = 2 * AREA_DENSITY * 2.0**2
    inertia = 0.4 * mass * radius**2
    ball = gx.RigidBody(
        mass,
        (inertia, inertia, inertia),
        position=(0.0, 0.0, 1.0),
        velocity=(0.0, 0.0, -5.0),
        comm=comm,
        name="ball",
    )
    surface = gx.contact.Sphere(centre=(0, 0, 1), radius=radius, body=ball, name="surface")
    floor = gx.contact.Plane(point=(0, 0, 0), normal=(0, 0, 1), name="floor")
    weight = gx.Gravity(ball, (0.0, 0.0, -G), name="weight of the ball")
    films = stack(comm, layers, cells, 2.0, 0.05)
    run, contact = dropped(films, [surface, floor], ball, weight)
    return of_fall(run, contact, layers * (cells + 1) ** 2, math.nan)


def cloths(comm: MPI.Comm, level: int) -> Figures:
    """Layers that fall on a cylinder: two, three and four, on finer meshes."""
    layers, cells = ((2, 4), (3, 6), (4, 8))[level]
    mast = gx.contact.Cylinder(start=(0, -1, -0.2), end=(0, 1, -0.2), radius=0.2, name="mast")
    run, contact = dropped(stack(comm, layers, cells, 1.0, 0.02), [mast])
    return of_fall(run, contact, layers * (cells + 1) ** 2, OGC_TIME)


NEO_HOOKE = gx.materials.NeoHooke(SHEAR_MODULUS, **RUBBER, residual_stiffness=0.0)
MOONEY_RIVLIN = gx.materials.MooneyRivlin(7 / 8 * SHEAR_MODULUS / 2, SHEAR_MODULUS / 16, **RUBBER)
# What is computed, and the error that is accepted.
CASES: dict[str, tuple[Callable[..., Figures], float]] = {
    "airbag w_M": (partial(of_airbag, quantity="w_M"), 1e-2),
    "airbag u_B": (partial(of_airbag, quantity="u_B"), 3e-2),
    "airbag σ1": (partial(of_airbag, quantity="σ1"), 5e-2),
    "bent film": (bent_film, 1e-2),
    "bent tube": (tube, 1e-2),
    "hub torsion": (hub, 1.5e-2),
    "Mylar balloon": (mylar, 5e-3),
    "disc": (disc, 5e-3),
    "balloon, neo-Hooke": (partial(balloon, law=NEO_HOOKE, share=0.0), 2e-3),
    "balloon, Mooney-Rivlin": (partial(balloon, law=MOONEY_RIVLIN, share=1 / 7), 2e-3),
    "sheared film": (sheared_film, 0.15),
    "slope, 0.51": (partial(on_slope, friction=0.51), 1e-2),
    "slope, 0.4": (partial(on_slope, friction=0.4), 1e-2),
    "sheets": (sheets, ENERGY),
    "cloths": (cloths, ENERGY),
}


def problem(comm: MPI.Comm, case: str, level: int) -> Figures:
    """Compute one case on one of three levels."""
    compute, accepted = CASES[case]
    figures = compute(comm, level)
    if "error" not in figures:
        figures["error"] = abs(figures["value"] / figures["reference"] - 1)
    return {"error/accepted": figures["error"] / accepted, **figures}


def draw(results: list[Result], path: Path) -> None:
    """Error against run time of each case, with what is accepted and what others published."""
    from matplotlib.figure import Figure

    columns = 5
    rows = -(-len(CASES) // columns)
    figure = Figure(figsize=(13, 2.6 * rows), dpi=100, facecolor="white", layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for panel, (name, (_, accepted)) in zip(panels, CASES.items(), strict=False):
        done = [one for one in results if one.values["case"] == name and not one.failed]
        if not done:
            panel.set_axis_off()
            continue
        seconds = [one.numbers["seconds"] for one in done]
        # A balance that closes exactly has no logarithm.
        errors = [max(one.numbers["error"], 1e-17) for one in done]
        panel.loglog(seconds, errors, "o-", color=BLUE, label="here")
        panel.axhline(accepted, color="grey", linestyle=":", label="accepted")
        theirs = [one.numbers.get("published error", 0.0) for one in done]
        for number, error in enumerate(error for error in theirs if error > 0):
            label = "published, coarser" if number == 0 else ""
            panel.axhline(error, color=RED, linestyle="--", linewidth=0.8, label=label)
        panel.set_title(name, fontsize=9)
        panel.minorticks_off()
        finish(panel, "CPU time [s]", "error")
        if panel is not panels[0]:
            panel.get_legend().remove()
    for panel in panels[len(CASES) :]:
        panel.set_axis_off()
    figure.savefig(path)


STUDY = Study(
    "published",
    "Published benchmarks of membranes, wrinkling and cloth in contact",
    problem,
    {"case": list(CASES), "level": [0, 1, 2]},
    lambda case: 0.5 ** case["level"],
    (Measure("error/accepted", 0.0, 1.0, quick_tolerance=5.0),),
    quick={
        "case": [name for name in CASES if name not in ("sheared film", "sheets")],
        "level": [0],
    },
    columns="value, reference, error, published error, energy_error, time, published time, seconds",
    limits={"energy_error": ENERGY, "penetrations": 0.5},
    not_repeatable={
        "time": "a run time",
        "published time": "a constant",
        "error": "of a fall it is at round-off",
    },
    expected_warnings={**NOT_REGULAR, **NOT_STABLE},
    draw=draw,
)
