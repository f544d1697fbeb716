"""Equilibrium paths past limit and branch points, against closed forms: what an error costs.

Load factors are those over the first limit or branch load of the closed form, "step" is the first
step of the load factor.

    truss          two bars of Green strain: p = 3√3/2 (1 - (z/h)²) z/h
    column         clamped, and its branch: the elastica, whose modulus k follows from the height of
                   the tip, x/L = 2 E(k)/K(k) - 1; p = (2 K(k)/π)²
    arch           hinged, of the shape z = a sin(kx) with k = π/L, under the load q sin(kx): it
                   keeps this shape with another amplitude b, and with the radius of gyration ρ of
                   its section

                       q = EA k⁴ (ρ² (a - b) + (a² - b²) b/4)

                   (Fung & Kaplan, NACA TN 2840 (1952)).  a = 4.5 ρ, so that both limit points come
                   before the arch sways
    swaying arch   a = 6 ρ, and its branch, on which the thrust is that of the second Euler load:
                   q = EA k⁴ ρ² (a + 3 b).  It is unstable
    balloon        an eighth of a sphere of neo-Hooke film with the stretch λ: p ~ 1/λ - λ⁻⁷

The arch is a polygon of straight beams with forces in its corners, so that its errors are of second
order.  The critical load of the column is as near as a branch point is located, 1e-4 of a step.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.studies.engine.study import Measure, Study, no_order
from gossamer_fx.extend import Array, Result
from gossamer_fx.meshes.line import line

# Rise of the truss over half of its span.
TRUSS_RISE = 0.2
# Modulus [Pa], radius of gyration ρ [m] and span [m] of the arch, which is shallow.
MODULUS = 1e9
GYRATION = 1e-3
SPAN = 1.0
SECTION = math.sqrt(12) * GYRATION  # side of its square section [m]
# Shear modulus μ [Pa], thickness and radius [m] of the balloon.
SHEAR_MODULUS = 1e5
THICKNESS = 1e-3
RADIUS = 0.1
# Stretch at the largest pressure of the balloon.
LIMIT_STRETCH = 7 ** (1 / 6)
# First steps of the load factor.
STEPS = (0.3, 0.1)


@dataclass(frozen=True)
class Problem:
    """A scene with one path of equilibria.

    Attributes:
        equilibrium: of the scene, whose loads are functions of the load factor.
        probes: "x", of which the load is a function, and "branch", if the path turns.
        exact: load factor (n,) of the closed form at values (n,) of x.
        until: load factor at the end.
        start: at the begin.
        max_steps: points after which the path ends.
        lower: load factor of the second limit point; NaN without one.
    """

    equilibrium: gx.Equilibrium
    probes: dict[str, Callable[[Any], float]]
    exact: Callable[[Array], Array]
    until: float = 1.5
    start: float = 0.0
    max_steps: int = 200
    lower: float = math.nan

    def follow(self, step: float) -> gx.analysis.EquilibriumPath:
        """The path, and the branch if there is a probe for it."""
        return gx.analysis.path(
            self.equilibrium,
            self.until,
            start=self.start,
            first_step=step,
            probes=self.probes,
            branch="branch" if "branch" in self.probes else "",
            max_steps=self.max_steps,
        )


def truss(comm: MPI.Comm, cells: int = 1) -> Problem:
    """Two bars that meet in an apex, which is pressed down; one cell each."""
    points = [(-1, 0, 0), (0, 0, TRUSS_RISE), (1, 0, 0)]
    bars = gx.Cable(line(comm, points, cells), gx.CableLaw(EA=1000.0, line_density=1.0))
    apex = bars.port("point 1")
    limit = 2 / 3**1.5 * 1000.0 * (TRUSS_RISE / math.hypot(1.0, TRUSS_RISE)) ** 3  # N
    push = gx.loads.Force(apex, lambda t: (0.0, 0.0, -limit * t))
    held = [gx.Fixed(bars, "start"), gx.Fixed(bars, "end")]
    guided = gx.Fixed(bars, "point 1", components=(0, 1))

    def exact(z: Array) -> Array:
        return 3**1.5 / 2 * (1 - (z / TRUSS_RISE) ** 2) * z / TRUSS_RISE

    equilibrium = gx.Equilibrium(gx.Scene(*held, guided, push))
    return Problem(equilibrium, {"x": gx.probes.Position(apex, "z")}, exact, lower=-1.0)


def column(comm: MPI.Comm, cells: int) -> Problem:
    """A clamped column of 1 m, pressed at its tip, which bends to +z."""
    section = gx.sections.rectangle(0.01, 0.02, E=MODULUS, nu=0.3, density=1000.0)
    beam = gx.Beam(line(comm, [(0, 0, 0), (1, 0, 0)], cells), section)
    clamped = gx.Fixed(beam, "start", rotation=True)
    euler = math.pi**2 * min(section.EI2, section.EI3) / 4  # N
    tip = beam.port("end")
    push = gx.loads.Force(tip, lambda t: (-euler * t, 0.0, 0.0))

    def exact(x: Array) -> Array:
        from scipy.optimize import brentq
        from scipy.special import ellipe, ellipk

        def parameter(height: float) -> float:
            """k² at the height of the tip."""
            return float(brentq(lambda m: 2 * ellipe(m) / ellipk(m) - 1 - height, 0.0, 0.99))

        # Before the branch the column is straight and a little shorter; its load is not judged.
        return np.array([(2 * ellipk(parameter(min(height, 1.0))) / math.pi) ** 2 for height in x])

    probes = {"x": gx.probes.Position(tip, "x"), "branch": gx.probes.Position(tip, "z")}
    return Problem(gx.Equilibrium(gx.Scene(clamped, push)), probes, exact, until=2.0)


def arch(comm: MPI.Comm, cells: int, rise: float = 4.5) -> Problem:
    """A hinged shallow arch with a rise a of so many radii of gyration."""
    k = math.pi / SPAN
    a = rise * GYRATION
    s = np.linspace(0.0, SPAN, cells + 1)
    shape = np.sin(k * s)
    points = [(x, 0.0, a * y) for x, y in zip(s.tolist(), shape.tolist(), strict=True)]
    section = gx.sections.rectangle(SECTION, SECTION, E=MODULUS, nu=0.3, density=1000.0)
    beam = gx.Beam(line(comm, points, 1), section)
    is_swaying = rise**2 > 22  # the arch sways before it snaps
    EA = MODULUS * SECTION**2

    def load(b: Array) -> Array:
        """Largest load per length [N/m] of the symmetric arch."""
        return EA * k**4 * (GYRATION**2 * (a - b) + (a**2 - b**2) * b / 4)

    limit = math.sqrt((a**2 - 4 * GYRATION**2) / 3)  # amplitude [m] at the limit points
    unit = float(load(np.array(limit)))
    if is_swaying:
        unit = float(load(np.array(math.sqrt(a**2 - 16 * GYRATION**2))))

    def exact(b: Array) -> Array:
        if is_swaying:
            return EA * k**4 * GYRATION**2 * (a + 3 * b) / unit
        return load(b) / unit

    def force(largest: float) -> Callable[[float], tuple[float, float, float]]:
        return lambda t: (0.0, 0.0, -largest * t)

    # Hinges that turn about y only: a section that rolls over would turn the arch inside out.
    items: list[Any] = []
    for end, x in (("start", 0.0), ("end", SPAN)):
        ground = gx.ground_frame((x, 0.0, 0.0))
        items.append(
            gx.constraints.RevoluteJoint(ground, beam.frame(end), axis=(0.0, 1.0, 0.0), name=end)
        )
    for i in range(1, cells):
        corner = f"point {i}"
        items.append(gx.Fixed(beam, corner, components=(1,)))
        largest = unit * float(shape[i]) * SPAN / cells
        items.append(gx.loads.Force(beam.port(corner), force(largest), name=f"load {i}"))
    probes = {"x": gx.probes.Position(beam.port(f"point {cells // 2}"), "z")}
    equilibrium = gx.Equilibrium(gx.Scene(*items))
    if is_swaying:
        probes["branch"] = gx.probes.Position(beam.port(f"point {cells // 4}"), "z")
        return Problem(equilibrium, probes, exact, max_steps=16)
    return Problem(equilibrium, probes, exact, lower=float(load(np.array(-limit))) / unit)


def octant(comm: MPI.Comm, cells: int) -> gx.Mesh:
    """An eighth of a sphere on curved triangles, with edges "x", "y", "z" in the planes of
    symmetry."""

    def build(model: Any) -> None:
        import gmsh

        right = math.pi / 2
        model.occ.addSphere(0, 0, 0, RADIUS, angle1=0.0, angle2=right, angle3=right)
        model.occ.synchronize()
        curved = [tag for _, tag in model.getEntities(2) if model.getType(2, tag) == "Sphere"]
        model.addPhysicalGroup(2, curved, name="film")
        edges = model.getBoundary([(2, curved[0])], oriented=False)
        for axis, name in enumerate("xyz"):
            within = [
                edge for _, edge in edges if model.getBoundingBox(1, edge)[axis + 3] < 1e-3 * RADIUS
            ]
            model.addPhysicalGroup(1, within, name=name)
        size = right * RADIUS / cells
        gmsh.option.setNumber("Mesh.MeshSizeMin", size)
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        model.mesh.generate(2)
        model.mesh.setOrder(2)

    return gx.gmsh_mesh(build, comm)


def balloon(comm: MPI.Comm, cells: int) -> Problem:
    """A balloon under a pressure, which falls beyond its limit."""
    law = gx.materials.NeoHooke(SHEAR_MODULUS, density=1000.0, thickness=THICKNESS)
    film = gx.Membrane(octant(comm, cells), law, order=2)
    held = [gx.Fixed(film, name, components=(axis,)) for axis, name in enumerate("xyz")]
    limit = 1 / LIMIT_STRETCH - LIMIT_STRETCH**-7
    unit = 2 * limit * SHEAR_MODULUS * THICKNESS / RADIUS  # Pa
    equilibrium = gx.Equilibrium(gx.Scene(gx.Pressure(film, lambda t: unit * t), *held))
    top = gx.probes.Position(film.port_at((0.0, 0.0, RADIUS)), "z")

    def exact(z: Array) -> Array:
        return (RADIUS / z - (RADIUS / z) ** 7) / limit

    return Problem(equilibrium, {"x": top}, exact, start=0.2, max_steps=16)


PROBLEMS = {
    "truss": truss,
    "column": column,
    "arch": arch,
    "swaying arch": lambda comm, cells: arch(comm, cells, rise=6.0),
    "balloon": balloon,
}


def problem(comm: MPI.Comm, path: str, step: float, cells: int) -> dict[str, float]:
    """Errors of the critical loads and of all points that the closed form has."""
    made = PROBLEMS[path](comm, cells)
    started = time.process_time()
    found = made.follow(step)
    seconds = time.process_time() - started
    x = found.columns["x"]
    first = min(found.limit_points + found.branch_points)
    judged = np.arange(len(x)) >= (first + 1 if "branch" in made.probes else 0)
    lower = math.nan
    if not math.isnan(made.lower):
        lower = abs(found.loads[found.limit_points[1]] - made.lower)
    return {
        "critical load": float(found.loads[first]),
        "lower limit off by": float(lower),
        "path off by": float(abs(found.loads - made.exact(x))[judged].max()),
        "points": len(x),
        "unstable": int(found.unstable[-1]),
        "iterations": found.iterations,
        "seconds": seconds,
    }


def draw(results: list[Result], path: Path) -> None:
    """The paths of coarse meshes on their closed forms, and errors against the CPU time."""
    from demos.common.figures import BLUE, GREY, RED, finish, new_figure, save

    figure = new_figure(13.0, 6.6)
    panels = figure.subplots(2, 3).ravel()
    ends = {
        "truss": (-1.4 * TRUSS_RISE, TRUSS_RISE),
        "column": (0.07, 1.0),
        "arch": (-5.3 * GYRATION, 4.5 * GYRATION),
        "swaying arch": (-1.0 * GYRATION, 4.5 * GYRATION),
        "balloon": (RADIUS, 9.0 * RADIUS),
    }
    for axes, (name, make) in zip(panels[:5], PROBLEMS.items(), strict=True):
        made = make(MPI.COMM_SELF, 1 if name == "truss" else 16)
        found = made.follow(0.1)
        stable = found.unstable == 0
        x = np.linspace(*ends[name], 300)
        axes.plot(x, made.exact(x), color=GREY, lw=1.2, label="closed form")
        axes.plot(found.columns["x"][stable], found.loads[stable], "o", color=BLUE, ms=4)
        axes.plot(found.columns["x"][~stable], found.loads[~stable], "s", color=RED, ms=4)
        axes.set_title(name)
        finish(axes, "height or radius [m]", "load over critical load")
    axes = panels[5]
    for name in PROBLEMS:
        done = [one for one in results if one.values["path"] == name and not one.failed]
        errors = [one.numbers["path off by"] for one in done]
        axes.loglog([one.numbers["seconds"] for one in done], errors, "o", ms=4, label=name)
    axes.set_title("4 to 32 cells, two steps")
    finish(axes, "CPU time [s]", "largest error of the load")
    save(figure, path, "Equilibrium paths, 16 cells: circles are stable, squares unstable")


def arch_rate(case: Any) -> float:
    """The order of the polygons."""
    return 2.0 if case["path"] in ("arch", "swaying arch") else no_order(case)


# The arches are polygons; the truss has one cell for each bar.
FINER = [
    *itertools.product(("arch", "swaying arch"), STEPS, (32,)),
    *itertools.product(("truss",), STEPS, (1,)),
]

STUDY = Study(
    "equilibrium_paths",
    "Equilibrium paths: critical loads and all points against closed forms",
    problem,
    {"path": [*PROBLEMS][1:], "step": STEPS, "cells": [4, 8, 16]},
    lambda case: 1 / case["cells"],
    (
        Measure("critical load", 1.0, 0.005, arch_rate, quick_tolerance=0.05),
        Measure("path off by", 0.0, 0.01, quick_tolerance=0.2),
    ),
    finer=[{"path": path, "step": step, "cells": cells} for path, step, cells in FINER],
    quick={"step": [0.3], "cells": [4, 8]},
    shows=("unstable",),
    columns="lower limit off by, points, iterations, seconds",
    draw=draw,
)
