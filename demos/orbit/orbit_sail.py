"""A spinning solar sail in one low orbit: sunlight, eclipse, oblateness, on a film that is
stretched in a frame.

A square film of 10 m hangs by springs in a rigid frame, which stands for the booms and the hub.
The springs balance a tension of the film of 2.7 N/m at the start, so that the film is taut and in
equilibrium; all turns slowly about the normal, which points to the Sun.

    ./gossamer demo orbit_sail
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import effort, print_figures
from demos.common.flight_picture import FlightPicture
from demos.common.framed_sail import RADIUS, SIDE, SPIN, framed_sail
from gossamer_fx.extend import Output
from gossamer_fx.meshes.sheet import crossed_sheet
from gossamer_fx.orbit.optics import JPL_SAIL

STRETCH = 1e-4  # of the film in both directions [1]
FILM = gx.Miyazaki(E=2.5e9, nu=0.3, density=1400.0, thickness=7.5e-6)
# Green-Lagrange strain ½(λ²-1) of both directions, and the force on a length of an edge as it was:
# λ S t
STRAIN = STRETCH + STRETCH**2 / 2
TENSION = (1 + STRETCH) * FILM.E * FILM.thickness / (1 - FILM.nu) * STRAIN


def main(
    cells: int = 4,
    dt: float = 10.0,
    until: float | None = None,
    output: str | Path | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> dict[str, float]:
    """Fly for `until` [s], default one orbit, in steps of `dt` [s]; with `output`, a folder: a
    picture.

    Returns:
        part of the time in light, mean force of sunlight in it over that on a flat sail towards the
        Sun, change of the sun angle [rad], part of the film that is not taut, error of the ledger,
        effort.
    """
    start = gx.orbit.Elements(RADIUS, 0.0, i=math.pi / 2)  # over the poles; the Sun is in its plane
    orbit = gx.orbit.Orbit(start, gravity="J2", sun=(0.0, 0.0, 1.0), shadow="cone")
    film, frame, springs = framed_sail(
        crossed_sheet(comm, cells, cells, SIDE, SIDE),
        FILM,
        cells=cells,
        strain=STRETCH,
        tension=TENSION,
        stiffness=500.0,
    )
    light = gx.orbit.SolarPressure(film, orbit, optics=JPL_SAIL, name="sunlight")
    spin = gx.RigidMotion(spin=(0.0, 0.0, SPIN))
    scene = gx.Scene(film, frame, *springs, orbit, light, spin)
    probes = {
        "sunlit": gx.probes.OrbitState(orbit, "sunlit"),
        "a": gx.probes.OrbitState(orbit, "a"),
        "sun angle": gx.probes.SunAngle(orbit, frame.frame().directors[2]),
        "force": lambda run: math.hypot(
            *(
                gx.probes.LoadResultant(orbit, "sunlight", action="force", axis=axis)(run)
                for axis in "xyz"
            )
        ),
        "wrinkled or slack": lambda run: 1 - gx.probes.AreaFraction(film, "taut")(run),
    }
    series = gx.Series(probes)
    outputs: list[Output] = [gx.outputs.Progress(), series]
    if output is not None:
        drawn = {
            "semi-major axis [m]": probes["a"],
            "force of sunlight [N]": probes["force"],
            "sun angle [rad]": probes["sun angle"],
        }
        path = Path(output) / "orbit_sail.png"
        title = "A spinning sail in orbit"
        outputs.append(FlightPicture(path, orbit, probes=drawn, title=title))
    run = gx.Simulation(scene, gx.Midpoint(dt=dt), outputs=outputs)
    run.run(until=until or start.period(orbit.mu))
    flat = orbit.pressure * SIDE**2 * sum(JPL_SAIL.coefficients())
    lit = series["sunlit"][1:] == 1.0
    return {
        "part of the time in light": float(series["sunlit"].mean()),
        "force over that on a flat sail": float(series["force"][1:][lit].mean() / flat),
        "largest change of the sun angle": float(np.ptp(series["sun angle"])),
        "part of the film not taut": float(series["wrinkled or slack"][-1]),
        **effort(run),
    }


if __name__ == "__main__":
    print_figures(main(cells=16, output="out/orbit_sail"))
