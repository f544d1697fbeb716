"""How does the pressure of an airbag follow its volume?

A `Chamber` knows the mass m and the energy U of its gas, and takes its volume V from the deformed
film in every iteration.  No curve of pressure is prescribed.  While no heat and no gas pass,

    dU = -p dV,   U = p V/(γ - 1)    hence    p V^γ = constant      (a fast event)

and with a wall that keeps the temperature of the gas, p V = constant (a slow one).  The time of
heat exchange τ = m c_v/G decides, G the conductance of `gx.gas.WallHeat`: with 10 W/(m² K) at the
film of a bag of this size τ is 5 s.  A crash takes 0.1 s and is adiabatic; a balloon in the sun is
isothermal.  Here a plate squeezes a closed bag within 0.1 s, with G = 0, with τ = 0.03 s, and
with a perfect wall.  The exponent -d ln p/d ln V comes out as 1.400, 1.16, and 1.000.

Where the values come from:
    adiabat, isotherm  Shapiro, Dynamics and Thermodynamics of Compressible Fluid Flow (1953) ch. 1
    film               of the stiffness of a coated nylon fabric: 400 MPa, 0.3 mm
    bag, pressure      chosen: 0.3 m across, 20 kPa above an atmosphere

    ./gossamer demo airbag_pressure
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import print_figures, smooth
from demos.common.figures import BLUE, GREEN, RED, draw_film, finish, new_figure, save, triangles
from gossamer_fx.extend import Array
from gossamer_fx.meshes.sphere import sphere
from gossamer_fx.presets.gases import AIR

RADIUS = 0.15  # of the bag [m]
ATMOSPHERE = 101325.0  # Pa
TEMPERATURE = 293.0  # of gas, wall and surroundings [K]
STROKE = 0.12  # of the plate [m]
DURATION = 0.1  # of the stroke [s]
FABRIC = gx.Miyazaki(E=4e8, nu=0.3, density=1000.0, thickness=3e-4, residual_stiffness=1e-3)
# Conductance [W/K] of the wall: m c_v is 14 J/K.
WALLS = {"no heat passes": 0.0, "τ = 0.03 s": 480.0, "perfect wall": 1e6}


def build(
    comm: MPI.Intracomm, conductance: float, cells: int = 14, until: float = DURATION
) -> tuple[gx.Membrane, gx.Case]:
    """The bag between a floor and a plate that comes down, with a wall of a conductance [W/K]."""
    film = gx.Membrane(sphere(comm, RADIUS, cells), FABRIC)
    outside = gx.gas.Ambient(ATMOSPHERE, TEMPERATURE)
    bag = gx.Chamber(
        film,
        gas=AIR,
        pressure=ATMOSPHERE + 2e4,
        temperature=TEMPERATURE,
        outside=outside,
    )
    wall = gx.gas.WallHeat(bag, conductance, temperature=TEMPERATURE)

    def plate_motion(t: float) -> tuple[float, float, float]:
        return 0.0, 0.0, -STROKE * smooth(t / DURATION)

    gap = 3e-3
    floor = gx.contact.Plane(point=(0, 0, -RADIUS - gap), normal=(0, 0, 1), name="floor")
    plate = gx.contact.Plane(
        point=(0, 0, RADIUS + gap),
        normal=(0, 0, -1),
        motion=plate_motion,
        name="plate",
    )
    contact = gx.Contact(film, floor, plate, distance=gap)
    # The air around the bag and the fabric itself damp its vibrations.
    damping = gx.Damping(film, mass_factor=100.0, stiffness_factor=1e-5)
    scene = gx.Scene(film, bag, wall, contact, damping)
    probes = {
        "volume": lambda run: run.chamber("chamber").volume,
        "pressure": lambda run: run.chamber("chamber").pressure,
    }
    stepper = gx.Midpoint(dt=1e-3)
    return film, gx.Case(scene, stepper, until=until, title="A squeezed airbag", probes=probes)


def exponent(volume: Array, pressure: Array) -> float:
    """n of p V^n = constant, between the first and the last state."""
    rise = np.log(pressure[-1] / pressure[0])
    growth = np.log(volume[-1] / volume[0])
    return -float(rise / growth)


def draw(histories: dict[str, gx.Series], shapes: list[Array], path: Path) -> None:
    """The bag before and after, and pressure against volume with both closed forms."""
    figure = new_figure()
    layout = figure.add_gridspec(1, 3, width_ratios=(1, 1, 2.4))
    for place, corners in enumerate(shapes):
        axes = figure.add_subplot(layout[place], projection="3d")
        draw_film(axes, corners, view=(8.0, -60.0))
        axes.set(zlim=(-RADIUS, RADIUS), xlim=(-0.2, 0.2), ylim=(-0.2, 0.2))
        axes.set_box_aspect((0.4, 0.4, 2 * RADIUS), zoom=1.4)
    plot = figure.add_subplot(layout[2])
    for (name, history), colour in zip(histories.items(), (RED, GREEN, BLUE), strict=True):
        V = np.array(history["volume"])
        p = np.array(history["pressure"])
        plot.plot(1e3 * V[::5], 1e-3 * p[::5], "o", color=colour, markersize=4, label=name)
    for name, n, colour in (("no heat passes", AIR.gamma, RED), ("perfect wall", 1.0, BLUE)):
        V = np.array(histories[name]["volume"])
        closed_form = histories[name]["pressure"][0] * (V[0] / V) ** n
        label = f"p V$^{{{n:g}}}$ = constant"
        plot.plot(1e3 * V, 1e-3 * closed_form, color=colour, linewidth=1, label=label)
    finish(plot, "volume [l]", "absolute pressure [kPa]")
    save(figure, path)


def main(
    output: str | Path | None = None, cells: int = 14, comm: MPI.Intracomm = MPI.COMM_SELF
) -> dict[str, float]:
    """Exponents of p V^n = constant for each wall, and energy errors; a picture in the folder
    `output`."""
    histories = {}
    shapes: list[Array] = []
    results = {}
    for name, conductance in WALLS.items():
        film, case = build(comm, conductance, cells)
        history = gx.Series(case.probes)
        run = case.simulation([history])
        start = triangles(run.system, film)
        run.run(until=case.until)
        shapes = [start, triangles(run.system, film)]
        histories[name] = history
        results[f"exponent, {name}"] = exponent(
            np.array(history["volume"]), np.array(history["pressure"])
        )
        results[f"energy error, {name}"] = abs(run.energy_error)
    if output is not None and comm.rank == 0:
        draw(histories, shapes, Path(output) / "airbag_pressure.png")
    return results


if __name__ == "__main__":
    if MPI.COMM_WORLD.rank == 0:
        print_figures(main(output="out/airbag_pressure"))
