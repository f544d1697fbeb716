"""A de-orbit balloon: a pillow of two square films is inflated in orbit, and its deformed shape
gives the drag.

Two flat films of 4 m, joined along their edges, take the shape that nitrogen of 2 Pa gives them: an
equilibrium, in which the edges are drawn in, and wrinkle.  The satellite's equipment is spread
along the seam.  The pillow then flies across the stream.  Free-molecular flow acts on the outer
sides of the deformed triangles; no wrinkle shades another. The semi-major axis a of a circular
orbit falls by da/dt = -2 F/(m n), with the mean motion n and the drag F of the shape that was
found, summed over its triangles.

Where the values come from:
    film                 aluminised polyester of 12.5 µm, as of Echo 1 (NASA TN D-1133, 1962): Mylar
    sizes, masses, gas   chosen
    air                  mean atmosphere at 350 km: 7e-12 kg/m³, scale height 53 km, 1000 K

    ./gossamer demo deorbit_balloon
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
    area_vectors,
    arrow_of_flight,
    draw_film,
    finish,
    new_figure,
    save,
    triangles,
)
from gossamer_fx.extend import Array
from gossamer_fx.meshes.airbag import CORNERS, airbag
from gossamer_fx.presets.films import MYLAR
from gossamer_fx.presets.gases import NITROGEN

EDGE = 4.0  # of the flat films [m]
THICKNESS = 12.5e-6  # m
PRESSURE = 2.0  # of the gas [Pa]
TEMPERATURE = 293.0  # of gas and film [K]
SATELLITE = 10.0  # mass at the four corners [kg]
ALTITUDE = 3.5e5  # m
RADIUS = EARTH + ALTITUDE  # of the orbit [m]
AIR = gx.orbit.ExponentialAtmosphere(
    density=7e-12, altitude=ALTITUDE, scale_height=5.3e4, temperature=1000.0
)
HOW = gx.orbit.Accommodation(wall_temperature=TEMPERATURE)
# Viscosity of the film over its stiffness [s]: ends its vibrations within minutes.
DAMPING = 1.0


def area_in_flow(corners: Array, air: gx.orbit.Air, speed: float) -> float:
    """F/(½ρU²) [m²] of the outer sides of triangles (n, 3, 3) [m], anticlockwise as seen from
    outside, in air that flows along -z with a speed [m/s]."""
    vectors = area_vectors(corners)
    areas = np.linalg.norm(vectors, axis=1)[:, None]
    return drag_area(areas, vectors[:, 2:] / areas, air, speed, HOW)


def draw(corners: Array, series: gx.Series, formula: tuple[Array, Array], path: Path) -> None:
    """The pillow with the direction of flight, and the semi-major axis over the time."""
    figure = new_figure(width=10.0, height=4.2)
    left, right = figure.subfigures(1, 2, width_ratios=(1.0, 1.2))
    axes = left.add_subplot(projection="3d")
    # The flight is along z of the scene; it is drawn to the right.
    draw_film(axes, corners[:, :, [2, 0, 1]], view=(18.0, -60.0))
    arrow_of_flight(axes, 1.5, 1.2)
    left.suptitle("two films of 4 m × 4 m at 2 Pa", fontsize=10)
    curve = right.add_subplot()
    times, semi_major_axes = formula
    curve.plot(np.array(series.time) / 60, series["a"] - RADIUS, color=BLUE, label="computed")
    label = "formula, deformed shape"
    curve.plot(times / 60, semi_major_axes - RADIUS, "--", color=GREY, label=label)
    finish(curve, "time [min]", "semi-major axis, change [m]")
    save(figure, path)


def main(
    cells: int = 12,
    seconds: float = 1800.0,
    dt: float = 5.0,
    output: str | Path | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> dict[str, float]:
    """Inflate the pillow and fly it.

    Args:
        cells: along an edge, an even number.
        seconds: how long it flies [s].
        dt: step [s].
        output: folder for a picture; None: no picture.
        comm: communicator of the mesh.

    Returns:
        Drag areas F/(½ρU²) [m²] of the pillow and of a flat square of its cut, and the fall of the
        semi-major axis [m], computed and by the formula.
    """
    mu = gx.orbit.Orbit(gx.orbit.Elements(RADIUS), sun=(1.0, 0.0, 0.0)).mu
    speed = math.sqrt(mu / RADIUS)
    orbital_rate = speed / RADIUS
    # At x = R, with the velocity along z: the film of the mesh, z = 0, is across the stream.
    orbit = gx.orbit.Orbit(((RADIUS, 0.0, 0.0), (0.0, 0.0, speed)), sun=(1.0, 0.0, 0.0))

    def turning(X: Array) -> Array:
        """Velocity (3, n) [m/s] of a film that turns with the orbit, about -y."""
        return np.vstack([-orbital_rate * X[2], 0 * X[1], orbital_rate * X[0]])

    film = gx.Membrane(
        airbag(comm, EDGE, cells),
        MYLAR.law(THICKNESS, residual_stiffness=1e-3),
        velocity=turning,
        name="pillow",
    )
    # The flat films enclose nothing: a litre for the gas of the start, which is not seen in 12 m³.
    gas = gx.Chamber(
        film, gas=NITROGEN, pressure=PRESSURE, temperature=TEMPERATURE, dead_volume=1e-3
    )
    masses = [
        gx.connectors.AttachedMass(film.port(corner), SATELLITE / 4, name=f"mass at {corner}")
        for corner in CORNERS
    ]
    statics = gx.Equilibrium(gx.Scene(film, gas), gas="held pressure")
    statics.find()
    corners = np.concatenate(comm.allgather(triangles(statics.system, film)))

    # At the start: within half an hour the density changes by some per cent.
    air = AIR(ALTITUDE)
    area = area_in_flow(corners, air, speed)
    square = EDGE / 2 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    # Two triangles of each side.
    flat = square[[[0, 1, 2], [0, 2, 3], [2, 1, 0], [3, 2, 0]]]
    # Air that turns with the Earth would have another speed than that of the formula.
    drag = gx.orbit.Drag(film, orbit, atmosphere=AIR, accommodation=HOW, closed=True, rotation=0.0)
    damping = gx.Damping(film, stiffness_factor=DAMPING)
    scene = gx.Scene(film, gas, *masses, drag, damping, gx.StartFrom(statics.system))
    probes = {"a": gx.probes.OrbitState(orbit, "a")}
    run, series = run_case(gx.Case(scene, gx.Midpoint(dt=dt), until=seconds, probes=probes))
    mass = 2 * EDGE**2 * THICKNESS * MYLAR.density + SATELLITE

    def force(a: float, speed: float) -> float:
        """Drag [N] of the shape at the start."""
        return AIR(a - EARTH).density * speed**2 / 2 * area

    formula = fall_by_formula(RADIUS, force, mass, seconds, 10.0, mu)
    if output is not None and comm.rank == 0:
        draw(corners, series, formula, Path(output) / "deorbit_balloon.png")
    return {
        "drag area of the pillow [m2]": area,
        "drag area of the flat films [m2]": area_in_flow(flat, air, speed),
        "fall [m]": float(series["a"][0] - series["a"][-1]),
        "fall by the formula [m]": float(RADIUS - formula[1][-1]),
        **effort(run),
    }


if __name__ == "__main__":
    print_figures(main(output="out/deorbit_balloon"))
