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
from demos.common.figures import BLUE, GREY, RED, draw_film, new_figure, petals_of, save
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.orbit.surface_forces import Rows, coefficients
from gossamer_fx.records.outputs.output import Output

ALTITUDE = 4e5  # m
MASS = 10.0  # kg
AREA = 25.0  # of all panels [m²]
SWEEP = math.radians(30)  # of the panels, towards the rear
RADIUS = 6378137.0 + ALTITUDE  # of the orbit [m]; equatorial radius of the Earth (WGS 84)
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
        panel = gx.orbit.Surface(
            AREA / 4,
            tuple(normal),
            centre=tuple(centre),
            two_sided=True,
        )
        found.append(panel)
    return found


def drag_area(air: gx.orbit.Air, speed: float) -> float:
    """F/(½ρU²) [m²] of the panels in flow along their axis."""
    speed_ratio = speed / air.thermal_speed
    wall = math.sqrt(WALL_TEMPERATURE / air.temperature)
    total = 0.0
    # Cosine of the angle between flow and normal, of the front and the rear side.
    for cosine in (math.cos(SWEEP), -math.cos(SWEEP)):
        A, B = coefficients(cosine, speed_ratio, 1.0, 1.0, wall, Rows)
        total += AREA * float(A * cosine + B)
    return total


def fall_by_formula(hours: float, mu: float) -> tuple[Array, Array]:
    """Times [s] and semi-major axes [m] of a circular orbit by the formula, with explicit Euler
    steps of a minute.

    Args:
        hours: how long.
        mu: gravitational parameter of the Earth [m³/s²].
    """
    step = 60.0
    times = step * np.arange(round(3600 * hours / step) + 1)
    axes = np.empty(len(times))
    axes[0] = RADIUS
    for k, a in enumerate(axes[:-1]):
        speed = math.sqrt(mu / a)
        air = AIR(a - (RADIUS - ALTITUDE))
        force = air.density * speed**2 / 2 * drag_area(air, speed)
        axes[k + 1] = a - step * 2 * force / MASS / math.sqrt(mu / a**3)
    return times, axes


def draw(series: gx.Series, formula: tuple[Array, Array], path: Path) -> None:
    """The panels with the direction of flight, and semi-major axis and attitude over the time."""
    figure = new_figure(width=11.0, height=4.6)
    left, right = figure.subfigures(1, 2, width_ratios=(1.0, 1.5))
    sail = left.add_subplot(projection="3d")
    draw_film(
        sail,
        petals_of(panels(), root=MAST, slope=PANEL_SLOPE),
        view=(18.0, -60.0),
    )
    sail.quiver(
        0.3,
        0,
        0,
        1.6,
        0,
        0,
        color=RED,
        lw=2,
    )
    sail.text(1.1, 0, 0.35, "flight", color=RED, ha="center")
    left.suptitle("25 m² in four panels, swept back by 30°", fontsize=10)
    above, below = right.subplots(2, 1, sharex=True)
    times, axes = formula
    above.plot(
        np.array(series.time) / 3600,
        (series["a"] - RADIUS) / 1e3,
        color=BLUE,
    )
    above.plot(times / 3600, (axes - RADIUS) / 1e3, "--", color=GREY)
    above.set_ylabel("semi-major axis,\nchange [km]")
    above.legend(["computed, swinging", "formula, aligned"], fontsize=8, frameon=False)
    angle = np.degrees(series["angle to the motion [rad]"])
    below.plot(
        np.array(series.time) / 3600,
        angle,
        color=BLUE,
        lw=0.4,
    )
    below.set(xlabel="time [h]", ylabel="angle to the\nmotion [deg]")
    for panel in (above, below):
        panel.grid(alpha=0.3)
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
    drag = gx.orbit.Drag(
        body,
        orbit,
        atmosphere=AIR,
        surfaces=panels(),
        rotation=0.0,
        name="drag",
    )
    nose = body.frame().directors[0]
    probes = {
        "angle to the motion [rad]": gx.probes.Attitude(orbit, nose, axis="along"),
        "a": gx.probes.OrbitState(orbit, "a"),
    }
    series = gx.Series(probes)
    outputs: list[Output] = [gx.outputs.Progress(), series]
    run = gx.Simulation(
        gx.Scene(drag),
        gx.Midpoint(dt=dt),
        outputs=outputs,
    )
    run.run(until=3600 * hours)
    formula = fall_by_formula(hours, orbit.mu)
    if output is not None and comm.rank == 0:
        draw(series, formula, Path(output) / "deorbit.png")
    last_quarter = len(series.time) * 3 // 4
    return {
        "fall [m]": float(series["a"][0] - series["a"][-1]),
        "fall by the formula [m]": float(RADIUS - formula[1][-1]),
        "largest angle to the motion, late [rad]": float(
            series["angle to the motion [rad]"][last_quarter:].max()
        ),
        "energy_error": run.energy_error,
        "newton_per_step": run.iterations / run.step,
        "seconds": run.seconds,
    }


if __name__ == "__main__":
    for key, value in main(output="out/deorbit").items():
        if MPI.COMM_WORLD.rank == 0:
            print(f"{key:40} {value:.6g}")
