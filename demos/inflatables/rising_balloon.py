"""At which altitude is a balloon full that is let go with room for its gas?

A helium balloon is let go with 77 % of its volume.  It rises, the pressure of the air falls, the
gas expands, and the folds of the film open.  By hand, with the volumes V0 at the start and V1 when
it is full, and the scale height H = R T/g of air of one temperature:

    free lift at the start       (ρ V0 - masses) g
    speed                        √(2 lift/(ρ C π r²))
    full, if the gas keeps T     after H ln(V1/V0)
    full, if no heat passes      after γ H ln(V1/V0)

From 11 to 20 km the standard atmosphere has one temperature; the balloon starts at 12 km.  Heat
comes to the gas through the film (`gx.gas.FilmHeat`) with a time constant of seconds, the ascent
takes minutes: the gas stays within 1.1 K of the air, and the balloon is full after 1650 m, 2 %
later than by hand at constant temperature; without heat it would be 2700 m.  It rises with 4.1 m/s.

Left out are the mass of the air that moves along, half of what the balloon displaces, the fall of
the air's density in the drag, and sunlight.  The film bears the weight of the gas.  The triangles
are too coarse for its folds: where it is slack it has little stiffness.

Where the values come from:
    air      U.S. Standard Atmosphere 1976, `gx.loads.StandardAtmosphere`
    drag     0.47 of a sphere: S. F. Hoerner, Fluid-Dynamic Drag (1965), ch. 3
    others   chosen; the film is as light as 20 µm of polyethylene, but softer, so that long steps
             converge

    ./gossamer demo rising_balloon
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import first_time, print_figures
from demos.common.figures import (
    BLUE,
    GREEN,
    GREY,
    RED,
    draw_film,
    finish,
    flat_triangles,
    new_figure,
    save,
    triangles,
)
from gossamer_fx.extend import Array
from gossamer_fx.meshes.sphere import sphere
from gossamer_fx.presets.gases import AIR, HELIUM

RADIUS = 1.0  # of the film as made [m]
START = 12e3  # altitude [m]
# Semi-axes of the ellipsoid at the start over the radius; its meridians are nearly as long as made.
SLENDER = 0.82
TALL = math.sqrt(2 - SLENDER**2)
THICKNESS = 20e-6  # m
FILM_DENSITY = 920.0  # kg/m³
PAYLOAD = 0.2  # kg
LINE = 1.8  # from film to payload [m]
COEFFICIENT = 3.0  # of the heat through the film [W/(m² K)]
DRAG = 0.47
G = 9.80665  # m/s²
ATMOSPHERE = gx.loads.StandardAtmosphere(altitude=START)
TEMPERATURE = ATMOSPHERE.temperature(START)  # K
PRESSURE = ATMOSPHERE(START)  # Pa
AIR_DENSITY = ATMOSPHERE.density(START)  # kg/m³
UNTIL = 410.0  # s


def slender(X: Array) -> Array:
    """Displacement [m] from the sphere to the ellipsoid."""
    return np.vstack([(SLENDER - 1) * X[0], (SLENDER - 1) * X[1], (TALL - 1) * X[2]])


def full_size(film: gx.Membrane) -> tuple[float, float]:
    """Volume [m³] and area [m²] of the film as made.  Collective."""
    a, b, c = flat_triangles(film).transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    volume = float(np.sum(a * normals)) / 6
    area = float(np.linalg.norm(normals, axis=1).sum()) / 2
    return film.comm.allreduce(volume), film.comm.allreduce(area)


def build(comm: MPI.Intracomm, cells: int, until: float = UNTIL) -> tuple[gx.Membrane, gx.Case]:
    """The balloon with its payload on a line, in the atmosphere."""
    mesh = sphere(comm, RADIUS, cells)
    volume, area = full_size(gx.Membrane(mesh, film_law(FILM_DENSITY)))
    gas_mass = PRESSURE * SLENDER**2 * TALL * volume / (HELIUM.R * TEMPERATURE)
    law = film_law(FILM_DENSITY + gas_mass / (area * THICKNESS))
    film = gx.Membrane(mesh, law, displacement=slender, name="film")
    payload = gx.PointMass(PAYLOAD, (0.0, 0.0, -TALL * RADIUS - LINE), comm=comm, name="payload")
    foot = film.port_at((0.0, 0.0, -RADIUS))
    line = gx.connectors.Spring(foot, payload.port(), stiffness=200.0, length=LINE)
    # The atmosphere is a load on the film: outside of the chamber there is a vacuum.
    air = gx.loads.FluidPressure(film, ATMOSPHERE, side="outside")
    gas = gx.Chamber(film, gas=HELIUM, pressure=PRESSURE, temperature=TEMPERATURE, name="gas")
    heat = gx.gas.FilmHeat(
        gas, gx.gas.FilmArea(film), coefficient=COEFFICIENT, temperature=TEMPERATURE
    )
    drag = gx.loads.AirDrag(film, AIR_DENSITY, drag_coefficient=DRAG)
    # It damps strains, not the ascent; without it steps of 0.2 s do not converge.
    damping = gx.Damping(film, stiffness_factor=0.05)
    weights = [gx.Gravity(body, (0.0, 0.0, -G)) for body in (film, payload)]
    scene = gx.Scene(film, payload, line, air, gas, heat, drag, damping, *weights)
    probes = {
        "altitude": gx.probes.Displacement(payload.port(), "z"),
        "volume": lambda run: run.chamber("gas").volume,
        "temperature": lambda run: run.chamber("gas").temperature,
    }
    case = gx.Case(scene, gx.Midpoint(dt=0.2), until=until, title="A rising balloon", probes=probes)
    return film, case


def film_law(density: float) -> gx.Miyazaki:
    """The film, of a density [kg/m³]."""
    return gx.Miyazaki(E=2e7, nu=0.3, density=density, thickness=THICKNESS, residual_stiffness=2e-2)


def free_lift(comm: MPI.Intracomm, cells: int) -> tuple[float, float]:
    """Free lift [N] at the start: from the momentum after a step that is too short for drag, and by
    hand."""
    dt = 1e-4
    film, case = build(comm, cells)
    run = gx.Simulation(case.scene, gx.Midpoint(dt=dt))
    gas = run.chamber("gas")
    _, area = full_size(film)
    masses = FILM_DENSITY * THICKNESS * area + gas.mass + PAYLOAD
    by_hand = G * (AIR_DENSITY * gas.volume - masses)
    run.run(until=dt)
    return float(run.totals.momentum[2]) / dt, by_hand


def draw(history: gx.Series, shapes: dict[str, Array], full: float, path: Path) -> None:
    """The balloon at three times, and its volume over the altitude with both closed forms."""
    figure = new_figure(10.5)
    layout = figure.add_gridspec(1, 4, width_ratios=(1, 1, 1, 2.4))
    for place, (title, corners) in enumerate(shapes.items()):
        axes = figure.add_subplot(layout[place], projection="3d")
        draw_film(axes, corners, view=(8.0, -60.0), zoom=1.3)
        axes.set_title(title, fontsize=10)
    plot = figure.add_subplot(layout[3])
    rise = np.array(history["altitude"])
    volume = np.array(history["volume"])
    falling = np.array([ATMOSPHERE(START + z) for z in rise])
    for name, exponent, colour in (
        ("gas keeps T, by hand", 1.0, BLUE),
        ("no heat, by hand", HELIUM.gamma, RED),
    ):
        closed_form = volume[0] * (falling[0] / falling) ** (1 / exponent)
        plot.plot(1e-3 * rise, closed_form, color=colour, label=name)
    plot.axhline(full, color=GREY, linewidth=1, label="full")
    plot.plot(1e-3 * rise[::50], volume[::50], "o", color=GREEN, markersize=4, label="run")
    finish(plot, "altitude above 12 km [km]", "volume [m³]", loc="lower right")
    save(figure, path)


def main(
    output: str | Path | None = None,
    cells: int = 12,
    until: float = UNTIL,
    comm: MPI.Intracomm = MPI.COMM_SELF,
) -> dict[str, float]:
    """Lift, speed and the altitude where the balloon is full, and those by hand; a picture in
    the folder `output`."""
    lift, lift_by_hand = free_lift(comm, cells)
    film, case = build(comm, cells, until)
    full, _ = full_size(film)
    history = gx.Series(case.probes)
    run = case.simulation([history])
    shapes = {}
    for share in (0.01, 0.4, 1.0):
        run.run(until=share * until)
        title = f"{history['altitude'][-1]:.0f} m, {100 * history['volume'][-1] / full:.0f} %"
        shapes[title] = triangles(run.system, film)
    rise = np.array(history["altitude"])
    time = np.array(history.time)
    reached = first_time(time, np.array(history["volume"]), full)
    scale_height = AIR.R * TEMPERATURE / G
    room = math.log(full / history["volume"][0])
    radius = (3 * full / (4 * math.pi)) ** (1 / 3)
    speed_by_hand = math.sqrt(2 * lift_by_hand / (AIR_DENSITY * DRAG * math.pi * radius**2))
    if output is not None and comm.rank == 0:
        draw(history, shapes, full, Path(output) / "rising_balloon.png")
    return {
        "free lift [N]": lift,
        "free lift by hand [N]": lift_by_hand,
        "speed [m/s]": float((rise[-1] - rise[0]) / time[-1]),
        "speed by hand [m/s]": speed_by_hand,
        "full after [m]": float(np.interp(reached, time, rise)),
        "full by hand, gas keeps T [m]": scale_height * room,
        "full by hand, no heat [m]": HELIUM.gamma * scale_height * room,
        "least temperature [K]": float(np.min(history["temperature"])),
        "energy error": abs(run.energy_error),
    }


if __name__ == "__main__":
    if MPI.COMM_WORLD.rank == 0:
        print_figures(main(output="out/rising_balloon"))
