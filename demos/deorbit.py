"""A de-orbit sail: a shuttlecock of four panels turns into the wind by itself and falls from its orbit by drag.

10 kg with 25 m² from 400 km; the panels are swept back by 30°, so that free-molecular flow brings the axis back to the
motion.  A circle of semi-major axis a falls by da/dt = -2 F/(m n), F the drag.

    ./gossamer demo deorbit
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.orbit.free_molecular import coefficients
from gossamer_fx.orbit.surface_forces import Rows
from gossamer_fx.outputs.output import Output

ALTITUDE, MASS, AREA, SWEEP = 4e5, 10.0, 25.0, math.radians(30)
RADIUS = 6378137.0 + ALTITUDE
AIR = gx.orbit.ExponentialAtmosphere(
    density=2.8e-12, altitude=ALTITUDE, scale_height=5.8e4, temperature=1000.0
)


def panels() -> list[gx.orbit.Surface]:
    """Four plates behind the mass, which flies along x; their normals point forward and outward."""
    found = []
    for k in range(4):
        out = np.array([0.0, math.cos(k * math.pi / 2), math.sin(k * math.pi / 2)])
        normal = math.cos(SWEEP) * np.array([1.0, 0, 0]) + math.sin(SWEEP) * out
        centre = 1.3 * (math.cos(SWEEP) * out - math.sin(SWEEP) * np.array([1.0, 0, 0])) - np.array(
            [0.6, 0, 0]
        )
        found.append(
            gx.orbit.Surface(AREA / 4, tuple(normal), centre=tuple(centre), two_sided=True)
        )
    return found


def drag_area(air: gx.orbit.Air, speed: float) -> float:
    """F/(½ρU²) [m²] of the panels in flow along their axis."""
    s = speed / air.thermal_speed
    wall = math.sqrt(300.0 / air.temperature)
    total = 0.0
    for c in (math.cos(SWEEP), -math.cos(SWEEP)):
        A, B = coefficients(c, s, 1.0, 1.0, wall, Rows)
        total += AREA * float(A * c + B)
    return total


def main(
    hours: float = 12.0,
    dt: float = 15.0,
    tilt: float = math.radians(15),
    output: str | Path | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> dict[str, float]:
    """Fly for some hours in steps of `dt` [s], at first `tilt` [rad] off the wind; with `output`, a folder: a picture.

    Returns:
        fall of the semi-major axis [m], the formula's, largest angle to the wind in the last quarter [rad].
    """
    start = gx.orbit.Elements(RADIUS, 0.0, i=0.9)
    orbit = gx.orbit.Orbit(start, sun=(1.0, 0.0, 0.0))
    out, along, across = orbit.local_axes.T
    c, s = math.cos(tilt), math.sin(tilt)
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
    drag = gx.orbit.Drag(body, orbit, atmosphere=AIR, surfaces=panels(), rotation=0.0, name="drag")
    nose = body.frame().directors[0]
    probes = {
        "altitude [km]": lambda run: gx.probes.OrbitState(orbit, "altitude")(run) / 1e3,
        "angle to the motion [rad]": gx.probes.Attitude(orbit, nose, axis="along"),
        "a": gx.probes.OrbitState(orbit, "a"),
    }
    series = gx.Series(probes)
    outputs: list[Output] = [gx.outputs.Progress(), series]
    if output is not None:
        drawn = {name: probes[name] for name in ("altitude [km]", "angle to the motion [rad]")}
        outputs.append(
            gx.plot.FlightPicture(
                Path(output) / "deorbit.png", orbit, probes=drawn, title="A de-orbit sail"
            )
        )
    run = gx.Simulation(gx.Scene(drag), gx.Midpoint(dt=dt), outputs=outputs)
    run.run(until=3600 * hours)
    # the circle's fall by the formula, a few minutes at a time
    a, step = RADIUS, 60.0
    for _ in range(round(3600 * hours / step)):
        speed = math.sqrt(orbit.mu / a)
        air = AIR(a - orbit.radius)
        force = air.density * speed**2 / 2 * drag_area(air, speed)
        a -= step * 2 * force / MASS / math.sqrt(orbit.mu / a**3)
    quarter = len(series.time) * 3 // 4
    return {
        "fall [m]": float(series["a"][0] - series["a"][-1]),
        "fall by the formula [m]": RADIUS - a,
        "largest angle to the motion, late [rad]": float(
            series["angle to the motion [rad]"][quarter:].max()
        ),
        "energy_error": run.energy_error,
        "newton_per_step": run.iterations / run.step,
        "seconds": run.seconds,
    }


if __name__ == "__main__":
    for key, value in main(output="out").items():
        if MPI.COMM_WORLD.rank == 0:
            print(f"{key:40} {value:.6g}")
