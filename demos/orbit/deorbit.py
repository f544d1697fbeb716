"""A de-orbit sail: four panels like a shuttlecock align with the flow, and drag lowers the orbit.

The satellite has 10 kg and 25 m² and starts at 400 km.  The panels are swept back by 30°, so that
free-molecular flow turns the axis towards the velocity.  The semi-major axis a of a circular orbit
falls by da/dt = -2 F/(m n), with the drag F and the mean motion n.

    ./gossamer demo deorbit
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import effort, print_figures, run_case
from demos.common.drag import EARTH, drag_area, fall_by_formula
from demos.common.figures import (
    BLUE,
    GREY,
    arrow_of_flight,
    draw_film,
    finish,
    new_figure,
    petals_of,
    save,
)
from gossamer_fx.extend import Array

ALTITUDE = 4e5  # m
MASS = 10.0  # kg
AREA = 25.0  # of all panels [m²]
SWEEP = math.radians(30)  # of the panels, towards the rear
RADIUS = EARTH + ALTITUDE  # of the orbit [m]
# Half of the width of a triangular panel over the distance from its root: four panels that are
# swept by 30° just touch with cos 30°.
PANEL_SLOPE = 0.85
# From the root of a panel to its centre [m].
PANEL_DISTANCE = 2 / 3 * math.sqrt(AREA / 4 / PANEL_SLOPE)
MAST = np.array([-0.6, 0.0, 0.0])  # from the centre of mass to the roots of the panels [m]
WALL_TEMPERATURE = 300.0  # of the panels [K]
# Mean atmosphere at 400 km: density [kg/m³], scale height [m] and temperature [K].
AIR = gx.orbit.ExponentialAtmosphere(
    density=2.8e-12, altitude=ALTITUDE, scale_height=5.8e4, temperature=1000.0
)


def panels() -> list[gx.orbit.Surface]:
    """Four plates behind the mass, which flies along x; their normals point forward and outward."""
    found = []
    for k in range(4):
        out = np.array([0.0, math.cos(k * math.pi / 2), math.sin(k * math.pi / 2)])
        forward = np.array([1.0, 0, 0])
        normal = math.cos(SWEEP) * forward + math.sin(SWEEP) * out
        along_panel = math.cos(SWEEP) * out - math.sin(SWEEP) * forward
        centre = PANEL_DISTANCE * along_panel + MAST
        found.append(
            gx.orbit.Surface(AREA / 4, tuple(normal), centre=tuple(centre), two_sided=True)
        )
    return found


def drag(a: float, speed: float) -> float:
    """Force [N] on the panels in flow along their axis, on an orbit with the semi-major axis a
    [m]."""
    air = AIR(a - EARTH)
    # Cosines of the angles between flow and normal, of the front and the rear side.
    cosines = np.array([[math.cos(SWEEP)], [-math.cos(SWEEP)]])
    how = gx.orbit.Accommodation(wall_temperature=WALL_TEMPERATURE)
    return air.density * speed**2 / 2 * drag_area(AREA, cosines, air, speed, how)


def draw(series: gx.Series, formula: tuple[Array, Array], path: Path) -> None:
    """The panels with the direction of flight, and semi-major axis and attitude over the time."""
    figure = new_figure(width=11.0, height=4.6)
    left, right = figure.subfigures(1, 2, width_ratios=(1.0, 1.5))
    sail = left.add_subplot(projection="3d")
    draw_film(sail, petals_of(panels(), root=MAST, slope=PANEL_SLOPE), view=(18.0, -60.0))
    arrow_of_flight(sail, 0.3, 1.6)
    left.suptitle("25 m² in four panels, swept back by 30°", fontsize=10)
    above, below = right.subplots(2, 1, sharex=True)
    times, axes = formula
    hours = np.array(series.time) / 3600
    above.plot(hours, (series["a"] - RADIUS) / 1e3, color=BLUE, label="computed, swinging")
    above.plot(times / 3600, (axes - RADIUS) / 1e3, "--", color=GREY, label="formula, aligned")
    finish(above, "", "semi-major axis,\nchange [km]")
    angle = np.degrees(series["angle to the motion [rad]"])
    below.plot(hours, angle, color=BLUE, lw=0.4)
    finish(below, "time [h]", "angle to the\nmotion [deg]")
    save(figure, path)


def main(
    hours: float = 12.0,
    dt: float = 15.0,
    tilt: float = math.radians(15),
    output: str | Path | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> dict[str, float]:
    """Fly for some hours in steps of `dt` [s], at first `tilt` [rad] off the wind; with `output`, a
    folder: a picture.

    Returns:
        fall of the semi-major axis [m], the formula's, largest angle to the wind in the last
        quarter [rad].
    """
    start = gx.orbit.Elements(RADIUS, 0.0, i=0.9)
    orbit = gx.orbit.Orbit(start, sun=(1.0, 0.0, 0.0))
    out, along, across = orbit.local_axes.T
    # Body axes: the first is the axis of the panels, turned by the tilt from the velocity.
    c = math.cos(tilt)
    s = math.sin(tilt)
    attitude = np.column_stack([c * along + s * across, -out, -s * along + c * across])
    attitude[:, 1] = np.cross(attitude[:, 2], attitude[:, 0])
    rate = start.motion(orbit.mu)
    body = gx.RigidBody(
        MASS,
        (6.0, 6.0, 8.0),
        attitude=attitude,
        spin=tuple(rate * across),
        comm=comm,
        name="satellite",
    )
    wind = gx.orbit.Drag(body, orbit, atmosphere=AIR, surfaces=panels(), rotation=0.0, name="drag")
    nose = body.frame().directors[0]
    probes = {
        "angle to the motion [rad]": gx.probes.Attitude(orbit, nose, axis="along"),
        "a": gx.probes.OrbitState(orbit, "a"),
    }
    seconds = 3600 * hours
    case = gx.Case(gx.Scene(wind), gx.Midpoint(dt=dt), until=seconds, probes=probes)
    run, series = run_case(case)
    formula = fall_by_formula(RADIUS, drag, MASS, seconds, 60.0, orbit.mu)
    if output is not None and comm.rank == 0:
        draw(series, formula, Path(output) / "deorbit.png")
    last_quarter = len(series.time) * 3 // 4
    return {
        "fall [m]": float(series["a"][0] - series["a"][-1]),
        "fall by the formula [m]": float(RADIUS - formula[1][-1]),
        "largest angle to the motion, late [rad]": float(
            series["angle to the motion [rad]"][last_quarter:].max()
        ),
        **effort(run),
    }


if __name__ == "__main__":
    print_figures(main(output="out/deorbit"))
