"""A sail through an eclipse: temperature, tension and flatness over one orbit.

A square film of 10 m hangs by springs in a rigid frame, which stands for the booms.  It is mounted
at 285 K, and two bands of it carry a coating, which stores more heat and absorbs more light.
Sunlight, the infrared and the reflected light of the Earth heat it; it radiates to space and
expands with its temperature.  In the shadow of the Earth it cools within a minute, the bands more
slowly, shrinks, and pulls at the springs.

    ./gossamer demo sail_eclipse
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from dolfinx.mesh import locate_entities
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import effort, print_figures
from demos.common.figures import new_figure, save
from demos.common.framed_sail import RADIUS, SIDE, SPIN, framed_sail
from gossamer_fx.extend import Probe
from gossamer_fx.meshes.sheet import crossed_sheet
from gossamer_fx.orbit.optics import JPL_SAIL

SPRING = 800.0  # stiffness [N/m] of the springs on a metre of the edge
TENSION = 8.0  # N/m, at which the sail is mounted
MOUNTED = 285.0  # K, temperature at which the sail is mounted

# Polyimide with aluminium on its front: thickness, coefficient of expansion, and 1090 J/(kg K).
THICKNESS = 7.5e-6  # m
FILM = gx.Miyazaki(E=2.5e9, nu=0.3, density=1420.0, thickness=THICKNESS, residual_stiffness=1e-3)
ALPHA = 20e-6  # 1/K
SAIL = gx.orbit.ThermalProperties(
    1090.0 * FILM.density * THICKNESS, absorptivity=0.12, emissivity=(0.03, 0.5)
)
COATED = gx.orbit.ThermalProperties(40.0, absorptivity=(0.16, 0.12), emissivity=(0.08, 0.5))
BANDS = ((2.0, 4.0), (6.0, 8.0))  # of x [m] that are coated


def tension_of_edges(springs: list[gx.connectors.Spring]) -> Probe:
    """A probe of the mean tension of the edges [N/m]."""
    tensions = [gx.probes.Tension(spring, at="end") for spring in springs]
    return lambda run: sum(max(tension(run), 0.0) for tension in tensions) / (4 * SIDE)


def sail(
    comm: MPI.Comm, cells: int
) -> tuple[gx.Membrane, gx.RigidBody, list[gx.connectors.Spring]]:
    """Film, frame, and the springs between them; the centre is at the origin."""
    strain = TENSION * (1 - FILM.nu) / (FILM.E * THICKNESS)
    mesh = crossed_sheet(comm, cells, cells, SIDE, SIDE)
    groups = dict(mesh.groups)
    in_band = np.zeros(0, dtype=np.int32)
    for first, last in BANDS:
        found = locate_entities(
            mesh.domain, 2, lambda x, a=first, b=last: (x[0] > a - 1e-9) & (x[0] < b + 1e-9)
        )
        in_band = np.union1d(in_band, found).astype(np.int32)
    groups["coated"] = (2, in_band)
    return framed_sail(
        gx.Mesh(mesh.domain, groups),
        FILM,
        cells=cells,
        strain=strain,
        tension=TENSION,
        stiffness=SPRING * SIDE / cells,
        thermal=gx.materials.ThermalExpansion(ALPHA, MOUNTED, reference=MOUNTED),
    )


def main(
    cells: int = 10,
    dt: float = 10.0,
    until: float | None = None,
    output: str | Path | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> dict[str, float]:
    """Fly through the eclipse.

    Args:
        cells: of the film along an edge.
        dt: step [s].
        until: end of the flight [s]; None: one orbit.
        output: folder for a picture; None: no picture.
        comm: communicator of the mesh.

    Returns:
        temperature, tension and flatness before the eclipse, a minute into it and at its end;
        closing errors, effort.
    """
    start = gx.orbit.Elements(RADIUS, 0.0, i=math.pi / 2)  # over the poles; the Sun is in its plane
    orbit = gx.orbit.Orbit(start, sun=(0.0, 0.0, 1.0), shadow="cone")
    film, frame, springs = sail(comm, cells)
    light = gx.orbit.SolarPressure(film, orbit, optics=JPL_SAIL, name="sunlight")
    heating = gx.orbit.SolarHeating(
        film, orbit, SAIL, groups={"coated": COATED}, infrared=237.0, albedo=0.3
    )
    damping = gx.Damping(film, stiffness_factor=0.05)
    spin = gx.RigidMotion(spin=(0.0, 0.0, SPIN))
    scene = gx.Scene(film, frame, *springs, orbit, light, heating, damping, spin)
    series = gx.Series(
        {
            "sunlit": gx.probes.OrbitState(orbit, "sunlit"),
            "coldest": lambda run: heating.balance(run).lowest,
            "hottest": lambda run: heating.balance(run).highest,
            "mean": lambda run: heating.balance(run).mean,
            "tension": tension_of_edges(springs),
            # In the middle of steps, which are far longer than the vibrations of the film, so that
            # these alternate from step to step.
            "flatness": gx.probes.SurfaceError(film, at="mean"),
            "taut": gx.probes.AreaFraction(film, "taut"),
        }
    )
    run = gx.Simulation(scene, gx.Midpoint(dt=dt), outputs=[gx.outputs.Progress(), series])
    end = until or start.period(orbit.mu)
    entry, exit_ = eclipse(orbit)
    moments = {
        "before the eclipse": entry - 60.0,
        "a minute into it": entry + 60.0,
        "at its end": exit_ - 60.0,
    }
    fields: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    found: dict[str, float] = {}
    for name, moment in moments.items():
        if moment > end:
            break
        run.run(until=moment)
        fields[name] = gx.fields.field_values(run, film, field="temperature")
        found[f"mean temperature {name} [K]"] = heating.balance(run).mean
        found[f"tension {name} [N/m]"] = float(series["tension"][-1])
        found[f"flatness {name} [m]"] = float(series["flatness"][-1])
    run.run(until=end)
    if output is not None and comm.size == 1:
        draw(series, fields, Path(output) / "sail_eclipse.png")
    return found | {
        "hottest [K]": float(series["hottest"].max()),
        "coldest [K]": float(series["coldest"].min()),
        "heat_error": heating.balance(run).error,
        **effort(run),
    }


def eclipse(orbit: gx.orbit.Orbit) -> tuple[float, float]:
    """Beginning and end [s] of the shadow of a cylinder on a circular orbit that starts across
    it."""
    position, velocity = orbit.state
    rate = float(np.linalg.norm(velocity) / np.linalg.norm(position))
    half = math.asin(orbit.radius / float(np.linalg.norm(position)))
    # The orbit begins above the equator and goes north, towards the Sun: midnight is after 3/4 of
    # it.
    midnight = 1.5 * math.pi
    return (midnight - half) / rate, (midnight + half) / rate


def draw(series: gx.Series, fields: dict[str, tuple[np.ndarray, np.ndarray]], path: Path) -> None:
    """Temperature, tension and flatness over time, and the temperature of the film at three
    times."""
    from matplotlib.tri import Triangulation

    figure = new_figure(9.6, 7.2)
    grid = figure.add_gridspec(3, 2, width_ratios=(2.2, 1.0))
    minutes = series.time / 60
    dark = series["sunlit"] < 0.5
    curves = [
        ("temperature [K]", {"hottest": "#c1121f", "mean": "#444444", "coldest": "#1d5fa8"}, 1.0),
        ("tension of the edges [N/m]", {"tension": "#444444"}, 1.0),
        ("out of plane, rms [µm]", {"flatness": "#444444"}, 1e6),
    ]
    for row, (label, names, factor) in enumerate(curves):
        axes = figure.add_subplot(grid[row, 0])
        for name, colour in names.items():
            axes.plot(minutes, factor * series[name], color=colour, lw=1.2, label=name)
        axes.fill_between(
            minutes, 0, 1, where=dark, transform=axes.get_xaxis_transform(), color="#dddddd", lw=0
        )
        axes.set_ylabel(label)
        axes.margins(x=0)
        axes.spines[["top", "right"]].set_visible(False)
        if len(names) > 1:
            axes.legend(frameon=False, loc="lower left")
    axes.set_xlabel("time [min]; grey: shadow of the Earth")
    images = []
    for row, (name, (points, values)) in enumerate(fields.items()):
        axes = figure.add_subplot(grid[row, 1])
        # The field jumps between triangles: three points each, in the order of the triangles.
        triangles = np.arange(len(points)).reshape(-1, 3)
        shown = Triangulation(points[:, 0], points[:, 1], triangles)
        image = axes.tripcolor(
            shown, facecolors=values[triangles].mean(axis=1), cmap="inferno", vmin=120, vmax=320
        )
        axes.set(aspect="equal", title=name)
        axes.set_axis_off()
        images.append(image)
    if images:
        figure.colorbar(images[0], ax=figure.axes[3:], label="temperature [K]", shrink=0.7)
    save(figure, path)


if __name__ == "__main__":
    print_figures(main(output="out"))
