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
from demos.common.figures import BLUE, GREY, RED, draw_film, new_figure, save, triangles
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.orbit.surface_forces import Rows, coefficients
from gossamer_fx.meshes.airbag import CORNERS, airbag
from gossamer_fx.presets.films import MYLAR
from gossamer_fx.presets.gases import NITROGEN
from gossamer_fx.records.outputs.output import Output

EDGE = 4.0  # of the flat films [m]
THICKNESS = 12.5e-6  # m
PRESSURE = 2.0  # of the gas [Pa]
TEMPERATURE = 293.0  # of gas and film [K]
SATELLITE = 10.0  # mass at the four corners [kg]
ALTITUDE = 3.5e5  # m
RADIUS = 6378137.0 + ALTITUDE  # of the orbit [m]; equatorial radius of the Earth (WGS 84)
AIR = gx.orbit.ExponentialAtmosphere(
    density=7e-12, altitude=ALTITUDE, scale_height=5.3e4, temperature=1000.0
)
HOW = gx.orbit.Accommodation(wall_temperature=TEMPERATURE)
# Viscosity of the film over its stiffness [s]: ends its vibrations within minutes.
DAMPING = 1.0


def drag_area(corners: Array, flow: Array, air: gx.orbit.Air, speed: float) -> float:
    """F/(½ρU²) [m²] along the flow, of the outer sides of triangles (n, 3, 3) [m] on this rank.

    Args:
        corners: of the triangles, anticlockwise as seen from outside.
        flow: unit vector (3,) of the velocity of the air.
        air: its state.
        speed: of the air [m/s].
    """
    first = corners[:, 1] - corners[:, 0]
    second = corners[:, 2] - corners[:, 0]
    area_vectors = np.cross(first, second) / 2
    areas = np.linalg.norm(area_vectors, axis=1)[:, None]
    normals = area_vectors / areas
    cosine = -normals @ flow[:, None]
    wall = math.sqrt(HOW.wall_temperature / air.temperature)
    normal_part, along = coefficients(
        cosine, speed / air.thermal_speed, HOW.normal, HOW.tangential, wall, Rows
    )
    # A pushes against the outer normal, B along the flow.
    return float(np.sum(areas * (normal_part * cosine + along)))


def fall_by_formula(area: float, mass: float, seconds: float, mu: float) -> tuple[Array, Array]:
    """Times [s] and semi-major axes [m] of a circular orbit by the formula, with explicit Euler
    steps of 10 s.

    Args:
        area: F/(½ρU²) [m²].
        mass: [kg].
        seconds: how long.
        mu: gravitational parameter of the Earth [m³/s²].
    """
    step = 10.0
    times = step * np.arange(round(seconds / step) + 1)
    axes = np.empty(len(times))
    axes[0] = RADIUS
    for k, a in enumerate(axes[:-1]):
        density = AIR(a - (RADIUS - ALTITUDE)).density
        force = density * mu / a / 2 * area
        axes[k + 1] = a - step * 2 * force / mass / math.sqrt(mu / a**3)
    return times, axes


def draw(corners: Array, series: gx.Series, formula: tuple[Array, Array], path: Path) -> None:
    """The pillow with the direction of flight, and the semi-major axis over the time."""
    figure = new_figure(width=10.0, height=4.2)
    left, right = figure.subfigures(
        1,
        2,
        width_ratios=(1.0, 1.2),
    )
    axes = left.add_subplot(projection="3d")
    # The flight is along z of the scene; it is drawn to the right.
    turned = corners[:, :, [2, 0, 1]]
    draw_film(
        axes,
        turned,
        view=(18.0, -60.0),
    )
    axes.quiver(
        1.5,
        0,
        0,
        1.2,
        0,
        0,
        color=RED,
        lw=2,
    )
    axes.text(
        2.2,
        0,
        0.35,
        "flight",
        color=RED,
        ha="center",
    )
    left.suptitle("two films of 4 m × 4 m at 2 Pa", fontsize=10)
    curve = right.add_subplot()
    times, semi_major_axes = formula
    minutes = np.array(series.time) / 60
    curve.plot(
        minutes,
        series["a"] - RADIUS,
        color=BLUE,
    )
    curve.plot(
        times / 60,
        semi_major_axes - RADIUS,
        "--",
        color=GREY,
    )
    curve.set(xlabel="time [min]", ylabel="semi-major axis, change [m]")
    curve.legend(
        ["computed", "formula, deformed shape"],
        fontsize=8,
        frameon=False,
    )
    curve.grid(alpha=0.3)
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
        airbag(
            comm,
            EDGE,
            cells,
        ),
        MYLAR.law(THICKNESS, residual_stiffness=1e-3),
        velocity=turning,
        name="pillow",
    )
    # The flat films enclose nothing: a litre for the gas of the start, which is not seen in 7 m³.
    gas = gx.Chamber(
        film, gas=NITROGEN, pressure=PRESSURE, temperature=TEMPERATURE, dead_volume=1e-3
    )
    masses = [
        gx.connectors.AttachedMass(
            film.port(corner),
            SATELLITE / 4,
            name=f"mass at {corner}",
        )
        for corner in CORNERS
    ]
    statics = gx.Equilibrium(gx.Scene(film, gas), gas="held pressure")
    statics.find()
    corners = np.concatenate(comm.allgather(owned_triangles(statics, film)))

    flow = np.array([0.0, 0.0, -1.0])
    # At the start: within half an hour the density changes by some per cent, see `fall_by_formula`.
    air = AIR(ALTITUDE)
    area = drag_area(
        corners,
        flow,
        air,
        speed,
    )
    x, y = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]).T * EDGE / 2
    square = np.stack([x, y, 0 * x], axis=1)
    flat = square[[[0, 1, 2], [0, 2, 3], [2, 1, 0], [3, 2, 0]]]
    # Air that turns with the Earth would have another speed than that of the formula.
    drag = gx.orbit.Drag(
        film,
        orbit,
        atmosphere=AIR,
        accommodation=HOW,
        closed=True,
        rotation=0.0,
    )
    scene = gx.Scene(
        film,
        gas,
        *masses,
        drag,
        gx.Damping(film, stiffness_factor=DAMPING),
        gx.StartFrom(statics.system),
    )
    series = gx.Series({"a": gx.probes.OrbitState(orbit, "a")})
    outputs: list[Output] = [gx.outputs.Progress(), series]
    run = gx.Simulation(
        scene,
        gx.Midpoint(dt=dt),
        outputs=outputs,
    )
    run.run(until=seconds)
    mass = 2 * EDGE**2 * THICKNESS * MYLAR.density + SATELLITE
    formula = fall_by_formula(
        area,
        mass,
        seconds,
        mu,
    )
    if output is not None and comm.rank == 0:
        draw(
            corners,
            series,
            formula,
            Path(output) / "deorbit_balloon.png",
        )
    return {
        "drag area of the pillow [m2]": area,
        "drag area of the flat films [m2]": drag_area(
            flat,
            flow,
            air,
            speed,
        ),
        "fall [m]": float(series["a"][0] - series["a"][-1]),
        "fall by the formula [m]": float(RADIUS - formula[1][-1]),
        "energy_error": run.energy_error,
        "newton_per_step": run.iterations / run.step,
        "rejected": run.substeps,
        "seconds": run.seconds,
    }


def owned_triangles(statics: gx.Equilibrium, film: gx.Membrane) -> Array:
    """Positions (n, 3, 3) [m] of the corners of the triangles that this rank owns, anticlockwise
    from outside."""
    corners = triangles(statics.system, film)
    owned = film.space.mesh.topology.index_map(2).size_local
    return corners[:owned]


if __name__ == "__main__":
    for key, value in main(output="out/deorbit_balloon").items():
        if MPI.COMM_WORLD.rank == 0:
            print(f"{key:40} {value:.6g}")
