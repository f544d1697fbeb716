"""From the drawing of a dish to the sewn, stowed and deployed one: how far is it from the drawing?

The drawing is a paraboloid z = r²/4f between eight points that a ring will hold; between them the
rim is curved inwards, with a cord along it.  In one chain it becomes

    form        the surface z(x, y), as triangles
    pattern     eight gores, cut along planes through the axis, laid flat by the law of the film,
                and smaller by its strain; written as DXF, and read again
    sewn        films on the flat panels, seams, and cords that are shorter than their edges
    stowed      pressed flat and folded over its middle by a plate, a blade and a flap; with folds=2
                once more, to a quarter
    deployed    eight tethers draw the points of the rim to the ring, and the pressure rises
    deviation   of the equilibrium from the drawing, along its normal

The deployed dish has the equilibrium of one that was never folded: its deviation is that of its
pattern, of gores that are curved in one direction only and of a rim with eight points.

Where the values come from:
    film              of the stiffness of polyimide, 3 GPa, 25 µm: `gossamer_fx.presets.films`
    tension           p f of a shallow paraboloid of the focal length f under the pressure p
    sizes, pressure   chosen: 1 m between opposite points, f = 1 m, 50 Pa
    cords             chosen: 40 N, so that the rim's radius between the points is 40 N/50 N/m

    ./gossamer demo dish_from_drawing
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.command_line import named_values
from demos.common.deployment import print_figures
from demos.common.figures import GREY, draw_film, new_figure, save, triangles
from gossamer_fx.extend import Array

POINTS = 8  # of the rim that are held, and gores
RADIUS = 0.5  # of these points [m]
FOCAL_LENGTH = 1.0  # f [m]
PRESSURE = 50.0  # p [Pa]
TENSION = PRESSURE * FOCAL_LENGTH  # n [N/m]
CORD_FORCE = 40.0  # N
FILM = gx.Miyazaki(E=3e9, nu=0.3, density=1400.0, thickness=25e-6, residual_stiffness=1e-4)
CORD = gx.TensionOnly(EA=2e4, line_density=2e-3)
DRAWN_SIZE = 0.06  # of triangles of the drawing [m]
SPACING = 12e-3  # of layers [m]
# Where tethers are wound up, over the radius of the points that they draw
RING = 1.3
TETHER_STIFFNESS = 2e3  # N/m
DEPLOYMENT = 2.0  # s

ANGLES = 2 * np.pi * np.arange(POINTS) / POINTS


def height(x: Array, y: Array) -> Array:
    """z [m] of the drawing."""
    return (x**2 + y**2) / (4 * FOCAL_LENGTH)


def points_of_rim() -> Array:
    """The points (8, 3) [m] of the drawing that are held."""
    x = RADIUS * np.cos(ANGLES)
    y = RADIUS * np.sin(ANGLES)
    return np.stack([x, y, height(x, y)], axis=1)


def outline(parts: int = 6) -> Array:
    """The rim in plan (8 parts, 2) [m]: arcs between the points, of the radius of the cords."""
    radius = CORD_FORCE / TENSION
    points = points_of_rim()[:, :2]
    found = []
    for a, b in zip(points, np.roll(points, -1, axis=0), strict=True):
        half = np.linalg.norm(b - a) / 2
        along = (b - a) / (2 * half)
        outward = np.array([along[1], -along[0]])
        # The centre of the arc is outside of the dish.
        centre = (a + b) / 2 + np.sqrt(radius**2 - half**2) * outward
        largest = np.arcsin(half / radius)
        for angle in np.linspace(-largest, largest, parts + 1)[:-1]:
            on_arc = np.sin(angle) * along - np.cos(angle) * outward
            found.append(centre + radius * on_arc)
    return np.array(found)


def form(comm: MPI.Intracomm) -> gx.patterns.FormSurface:
    """The drawing as triangles, with the names of the points that are held."""
    drawn = gx.patterns.height_surface(height, outline=outline(), size=DRAWN_SIZE, comm=comm)
    # A rim without names is named by its corners: "rim 1" to "rim 8".
    groups = {}
    for k, point in enumerate(points_of_rim(), start=1):
        nearest = np.linalg.norm(drawn.points - point, axis=1).argmin()
        groups[f"point {k}"] = np.array([nearest])
    return gx.patterns.FormSurface(drawn.points, drawn.triangles, groups, comm)


def pattern(drawn: gx.patterns.FormSurface) -> gx.patterns.Panels:
    """Flat gores with a wanted tension, and cords along the rim."""
    planes = ANGLES[: POINTS // 2]
    normals = np.stack([-np.sin(planes), np.cos(planes), 0 * planes], axis=1)
    strips = drawn.cut(drawn.by_planes(np.zeros_like(normals), normals))
    rims = sorted({name for strip in strips for name in strip.groups if name.startswith("rim")})
    cords = dict.fromkeys(rims, (CORD, CORD_FORCE))
    return strips.flatten(FILM, tension=TENSION, edge_cables=cords)


@dataclass(frozen=True, eq=False)
class Dish:
    """A sewn dish.

    Attributes:
        panels: of which it is sewn.
        films: one of each panel.
        joined: seams and cords.
    """

    panels: gx.patterns.Panels
    films: list[gx.Membrane]
    joined: list[Any]

    def film_at(self, point: int) -> gx.Membrane:
        """A film that has a point of the rim, which is counted from 1."""
        return next(film for film in self.films if f"point {point}" in film.mesh.groups)

    def pressures(self, over_time: Any) -> list[gx.Pressure]:
        """The pressure [Pa] from the hollow side on all films: a number, or a function of time."""
        return [gx.Pressure(f, over_time, name=f"pressure on {f.name}") for f in self.films]

    def corners(self, system: Any) -> Array:
        """Present positions (n, 3, 3) [m] of the corners of all triangles."""
        return np.concatenate([triangles(system, film) for film in self.films])


def sewn(panels: gx.patterns.Panels, size: float) -> Dish:
    """Films with edges of a length [m], seams and cords."""
    films = panels.films(size=size)
    return Dish(panels, films, [*panels.seams(films), *panels.cables(films)])


def stowing(dish: Dish, folds: int) -> tuple[gx.fold.Stow, gx.Simulation]:
    """Press the dish, and fold it over up to two lines through its middle."""
    stow = gx.fold.Stow(dish.films, spacing=SPACING, layers=1).press()
    for towards in ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0))[:folds]:
        stow = stow.fold((0.0, 0.0, 0.0), towards)
    control = gx.StepControl(max_step=stow.longest_step, max_factor=1.3)
    scene = gx.Scene(*dish.films, *dish.joined, stow)
    return stow, gx.Simulation(scene, gx.Midpoint(dt=stow.first_step), control=control)


def deployment(dish: Dish, stowed: gx.Simulation) -> gx.Simulation:
    """Tethers draw the points of the rim towards a ring, while the pressure rises."""
    tethers = []
    ring = points_of_rim() * [RING, RING, 1.0]
    for k, (point, eye) in enumerate(zip(points_of_rim(), ring, strict=True), start=1):
        port = dish.film_at(k).port(f"point {k}")
        wound = float(np.linalg.norm(eye - point))
        paid_out = float(np.linalg.norm(eye - stowed.system.unknowns.state.vector(port)))

        def length(t: float, start: float = paid_out, end: float = wound) -> float:
            share = min(t / (0.7 * DEPLOYMENT), 1.0)
            return start + (end - start) * share * share * (3 - 2 * share)

        tether = gx.connectors.Tether(
            port,
            gx.Ground(tuple(eye)),
            stiffness=TETHER_STIFFNESS,
            length=length,
            name=f"tether {k}",
        )
        tethers.append(tether)
    damping = [
        gx.Damping(f, mass_factor=10.0, stiffness_factor=1e-3, name=f"damping of {f.name}")
        for f in dish.films
    ]
    rising = dish.pressures(lambda t: -PRESSURE * min(t / DEPLOYMENT, 1.0) ** 2)
    contact = gx.Contact(*dish.films, distance=SPACING)
    start = gx.StartFrom(stowed.system)
    scene = gx.Scene(*dish.films, *dish.joined, *tethers, *damping, *rising, contact, start)
    control = gx.StepControl(max_step=0.05, max_factor=1.3)
    return gx.Simulation(scene, gx.Midpoint(dt=2e-3), control=control)


def equilibrium(dish: Dish, start: Sequence[gx.StartFrom] = ()) -> gx.Equilibrium:
    """The dish under pressure with its points on the ring, from the drawing or another start."""
    held = []
    for k, point in enumerate(points_of_rim(), start=1):

        def to_ring(X: Array, t: float, point: Array = point) -> Array:
            return point[:, None] - X

        film = dish.film_at(k)
        held.append(gx.Fixed(film, f"point {k}", motion=to_ring, name=f"point {k} on the ring"))
    scene = gx.Scene(*dish.films, *dish.joined, *held, *dish.pressures(-PRESSURE), *start)
    return gx.Equilibrium(scene)


def read_again(panels: gx.patterns.Panels, path: Path) -> float:
    """Write the panels as DXF, read them, and return the area over that of the panels."""
    panels.write_dxf(path, allowance=0.01, hem=0.02, marks=0.1)
    mesh = gx.patterns.read_dxf(path, MPI.COMM_SELF, size=0.1, leave_out=("cut", "marks"))
    return gx.patterns.surface(mesh).area / sum(panel.area for panel in panels)


def draw(panels: gx.patterns.Panels, shapes: dict[str, Array], path: Path) -> None:
    """The drawing and its flat panels with their names, and the dish in all stages."""
    figure = new_figure(11.0, 6.2)
    above, below = figure.subfigures(2, 1, height_ratios=(1.0, 1.1))
    axes = above.add_subplot(1, 2, 1, projection="3d")
    drawn = panels.form
    draw_film(axes, drawn.points[drawn.triangles], view=(35.0, -60.0), zoom=1.4)
    axes.set_title("drawing", fontsize=10)
    flat = above.add_subplot(1, 2, 2)
    widest = max(panel.width for panel in panels)
    longest = max(panel.length for panel in panels)
    for panel in panels:
        # In two rows of four
        shift = np.array([panel.number % 4 * 1.15 * widest, -(panel.number // 4) * 1.3 * longest])
        for part in panel.boundary:
            x, y = (part.flat[:, ::-1] + shift).T
            is_seam = part.name.startswith("seam")
            flat.plot(x, y, color=GREY if is_seam else "k", lw=0.8 if is_seam else 1.4)
        flat.text(*(panel.points[:, ::-1].mean(axis=0) + shift), panel.name, ha="center", size=7)
    flat.set_aspect("equal")
    flat.set_axis_off()
    flat.set_title("panels, true to scale", fontsize=10)
    for place, (title, corners) in enumerate(shapes.items(), start=1):
        axes = below.add_subplot(1, len(shapes), place, projection="3d")
        draw_film(axes, corners, view=(35.0, -60.0), zoom=1.2)
        axes.set_title(title, fontsize=10)
    save(figure, path)


def main(output: str | Path | None = None, folds: int = 1, size: float = 0.2) -> dict[str, float]:
    """Deviation of the dish from the drawing [mm], deployed and never folded; sizes of the stowed
    dish [m]."""
    comm = MPI.COMM_SELF
    folder = Path(output or "out/dish_from_drawing")
    folder.mkdir(parents=True, exist_ok=True)
    panels = pattern(form(comm))
    found = {
        "area read from DXF, over that of the panels": read_again(panels, folder / "gores.dxf")
    }
    dish = sewn(panels, size)
    never_folded = equilibrium(dish)
    never_folded.find()
    deviation = panels.deviation(dish.films, at=never_folded)
    found["deviation, never folded, rms [mm]"] = 1e3 * deviation.rms

    stow, run = stowing(dish, folds)
    shapes = {}
    for title, end in zip(("pressed", "folded once", "folded twice"), stow.ends, strict=False):
        run.run(until=end)
        shapes[title] = dish.corners(run.system)
        print(f"{title} after {end:.1f} s, {run.step} steps: {1e3 * stow.box(run)} mm", flush=True)
    long, wide, high = stow.box(run)
    crossings = [gx.probes.Crossings(film)(run) for film in dish.films]
    found |= {
        "stowed length [m]": long,
        "stowed width [m]": wide,
        "stowed height [m]": high,
        "crossings": sum(crossings),
        "error of energy, stowing": run.energy_error,
    }

    out = deployment(dish, run)
    for share in (0.25, 1.0):
        out.run(until=share * 1.2 * DEPLOYMENT)
        print(f"deployment, {out.time:.1f} s, {out.step} steps", flush=True)
        shapes["on the way" if share < 1 else "deployed"] = dish.corners(out.system)
    at_rest = equilibrium(dish, [gx.StartFrom(out.system)])
    at_rest.find()
    deployed = panels.deviation(dish.films, at=at_rest)
    found |= {
        "error of energy, deployment": out.energy_error,
        "deviation, deployed, rms [mm]": 1e3 * deployed.rms,
        "largest change by folding [mm]": 1e3
        * float(np.abs(deployed.points - deviation.points).max()),
    }
    shapes[f"deployed, {1e3 * deployed.rms:.1f} mm rms off the drawing"] = shapes.pop("deployed")
    draw(panels, shapes, folder / "dish_from_drawing.png")
    return found


if __name__ == "__main__":
    if MPI.COMM_WORLD.rank == 0:
        given = named_values(sys.argv[1:], {"folds": 1, "size": 0.2})
        print_figures(main("out/dish_from_drawing", **given))
