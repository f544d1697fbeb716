"""Windmill torque of sunlight: slightly pitched petals brake the spin of a sail, as that of IKAROS.

Four petals, 173 m² and 770 kg m² together, at 1.03 au and a sun angle of 1°.  Each is turned about
its radius by the pitch δ, which represents the mean effect of curved devices and wrinkles.  The
pressure of sunlight along its normal has the torque 2 P A δ r about the axis.  In June 2011 IKAROS
lost 0.6 rpm in 21 days, a torque of -2.7e-5 N m (or more): 0.16 % of 2 P A · 10 m.

    ./gossamer demo windmill
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import print_figures
from demos.common.figures import (
    BLUE,
    GREY,
    RED,
    draw_film,
    finish,
    new_figure,
    petals_of,
    save,
)
from demos.common.spinning import RPM
from gossamer_fx.mechanics.orbit.sky import AU, MU_SUN

AREA = 173.0  # of the sail [m²]
INERTIA = 770.0  # about the axis of spin [kg m²]
ARM = 4.7  # from the axis to the centre of a petal [m]
MASS = 300.0  # kg
DISTANCE = 1.03  # from the sun [au]
RADIUS_OF_THE_SUN = 6.957e8  # m
FLIGHT = -2.7e-5  # torque about the axis of spin in flight [N m]
OPTICS = gx.orbit.Optics(0.8, 0.9, emissivity=0.05, lambertian=0.79)
# Pitches of the picture [rad]; the petals are drawn with 60 times the pitch of the demo, which
# could not be seen.
PITCHES = (0.0, 2e-3, 4e-3, 5.2e-3, 6e-3, 8e-3)
DRAWN_PITCH = 60 * 5.2e-3


def petals(pitch: float) -> list[gx.orbit.Surface]:
    """Four petals with the normal -z, turned by `pitch` [rad] about their radius."""
    found = []
    for k in range(4):
        c = math.cos(k * math.pi / 2)
        s = math.sin(k * math.pi / 2)
        normal = (-s * math.sin(pitch), c * math.sin(pitch), -math.cos(pitch))
        centre = (ARM * c, ARM * s, 0.0)
        found.append(
            gx.orbit.Surface(AREA / 4, normal, centre=centre, optics=OPTICS, two_sided=True)
        )
    return found


def round_the_sun(start: gx.orbit.Elements) -> gx.orbit.Orbit:
    """An orbit whose central body is the Sun."""
    return gx.orbit.Orbit(
        start, mu=MU_SUN, sun=(0.0, 0.0, 0.0), shadow="none", radius=RADIUS_OF_THE_SUN
    )


def days_of_braking(torque: float, inertia: float) -> float:
    """Days in which a torque [N m] brakes a sail with a moment of inertia [kg m²] from 1 to 0.4
    rpm; in flight 21."""
    if torque == 0:
        return math.inf
    return 0.6 * RPM * inertia / abs(torque) / 86400


def draw(results: dict[float, dict[str, float]], path: Path) -> None:
    """The petals, and the torque over the pitch: computed, by the formula, and in flight.

    Args:
        results: of `main`, by pitch [rad].
        path: of the picture.
    """
    figure = new_figure(width=10.0, height=4.2)
    left, right = figure.subfigures(1, 2, width_ratios=(1.0, 1.3))
    sail = left.add_subplot(projection="3d")
    draw_film(sail, petals_of(petals(DRAWN_PITCH)), view=(32.0, -60.0))
    left.suptitle("The petals; pitch enlarged 60 times", fontsize=10)
    axes = right.subplots()
    pitches = [1e3 * pitch for pitch in results]
    formula = [1e6 * found["formula for a sun angle of 0 [N m]"] for found in results.values()]
    axes.plot(pitches, formula, color=GREY, label="formula")
    computed = [1e6 * found["torque [N m]"] for found in results.values()]
    axes.plot(pitches, computed, "o", color=BLUE, label="computed, sun angle 1°")
    axes.axhline(1e6 * FLIGHT, color=RED, ls="--", label="IKAROS in flight, June 2011")
    finish(axes, "pitch of the petals [mrad]", "torque about the axis of spin [µN m]")
    save(figure, path)


def main(
    pitch: float = 5.2e-3,
    sun_angle: float = math.radians(1.0),
    dt: float = 2.0,
    steps: int = 600,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> dict[str, float]:
    """Fly `steps` steps of `dt` [s] round the Sun with 1 rpm.

    Returns:
        torque about the spin axis [N m], its formula, its ratio to the flight's, days from 1 to 0.4
        rpm by it.
    """
    orbit = round_the_sun(gx.orbit.Elements(DISTANCE * AU))
    # Light travels along x at the start.  The axis of spin is tilted from it by the sun angle.
    axis = np.array([math.cos(sun_angle), math.sin(sun_angle), 0.0])
    attitude = np.column_stack([(0.0, 0.0, 1.0), np.cross(axis, (0.0, 0.0, 1.0)), axis])
    body = gx.RigidBody(
        MASS,
        (INERTIA / 2, INERTIA / 2, INERTIA),
        attitude=attitude,
        spin=tuple(RPM * axis),
        comm=comm,
        name="sail",
    )
    light = gx.orbit.SolarPressure(body, orbit, surfaces=petals(pitch), name="sunlight")
    probes = {
        "sun angle [rad]": gx.probes.SunAngle(orbit, body.frame().directors[2]),
        "torque": lambda run: sum(
            float(a) * gx.probes.LoadResultant(orbit, "sunlight", action="torque", axis=x)(run)
            for a, x in zip(axis, "xyz", strict=True)
        ),
    }
    series = gx.Series(probes)
    outputs = [gx.outputs.Progress(), series]
    run = gx.Simulation(gx.Scene(light), gx.Midpoint(dt=dt), outputs=outputs)
    frame = body.frame()

    def spin(system: object) -> float:
        directors = run.system.state.vectors(frame.directors[:2])
        rates = run.system.state.rates(frame.directors[:2])
        return float(rates[0] @ directors[1])

    before = spin(run.system)
    run.run(until=steps * dt)
    braked = INERTIA * (spin(run.system) - before) / run.time
    P = orbit.pressure / DISTANCE**2
    mirrored, both, _ = OPTICS.coefficients()
    # dF/dδ along the motion of a petal: only the part of the force along the normal has one.
    formula = -P * AREA * ARM * math.sin(pitch) * (mirrored + both)
    return {
        "torque [N m]": braked,
        "mean torque of the probe [N m]": float(series["torque"][1:].mean()),
        "formula for a sun angle of 0 [N m]": formula,
        "torque over the flight's": braked / FLIGHT,
        "torque over 2PA 10 m": abs(braked) / (2 * P * AREA * 10),
        "days from 1 to 0.4 rpm": days_of_braking(braked, INERTIA),
        "energy_error": run.energy_error,
        "seconds": run.seconds,
    }


if __name__ == "__main__":
    results = {pitch: main(pitch) for pitch in PITCHES}
    if MPI.COMM_WORLD.rank == 0:
        draw(results, Path("out/windmill/windmill.png"))
        # As in flight.
        print_figures(results[5.2e-3])
