"""Windmill torque of sunlight: slightly pitched petals brake the spin of a sail, as that of IKAROS.

Four petals, 173 m² and 770 kg m² together, at 1.03 au and a sun angle of 1°.  Each is turned about
its radius by the pitch δ, which represents the mean effect of curved devices and wrinkles.  The
pressure of sunlight along its normal has the torque 2 P A δ r about the axis.  In June 2011 IKAROS
lost 0.6 rpm in 21 days, a torque of -2.7e-5 N m (or more): 0.18 % of 2 P A · 10 m.

Which shape has this torque?  Light along the axis pushes a face of slope ∇w by -P' ∇w dA in the
plane, P' = (c_0 + c_1) P of `Optics`, to first order.  About the axis that is

    torque = -P' ∫ ∂w/∂θ dA = -P' ∮ w r e_θ·ν ds                                             (1)

an integral of the heights w of the *edges* of the petals: waves, wrinkles and curled devices inside
of them have a torque of second order only, and on an outer edge only what is odd about its middle
counts, with the distance from there.  `sensitivities` computes the torque of such shapes.

    ./gossamer demo windmill
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from mpi4py import MPI
from scipy.constants import astronomical_unit

import gossamer_fx as gx
from demos.common.deployment import print_figures
from demos.common.figures import (
    BLUE,
    GREY,
    RED,
    area_vectors,
    draw_film,
    finish,
    new_figure,
    petals_of,
    save,
)
from demos.common.spinning import RPM
from gossamer_fx.extend import Array
from gossamer_fx.orbit.optics import Arrays, light_force

AREA = 173.0  # of the sail [m²]
INERTIA = 770.0  # about the axis of spin [kg m²]
ARM = 4.7  # from the axis to the centre of a petal [m]
MASS = 300.0  # kg
DISTANCE = 1.03  # from the sun [au]
RADIUS_OF_THE_SUN = 6.957e8  # m
MU_SUN = 1.32712440018e20  # gravitational parameter [m³/s²]
FLIGHT = -2.7e-5  # torque about the axis of spin in flight [N m]
OPTICS = gx.orbit.Optics(0.8, 0.9, emissivity=0.05, lambertian=0.79)
# Pressure of sunlight at 1 au on a black face [Pa].
PRESSURE_AT_AU = 4.56e-6
# Distances of the inner and outer edges of the petals from the axis, and side of a device [m].
INNER = 1.28
OUTER = 7.04
DEVICE = 0.64
# Largest height for which the torques of shapes are computed: they are linear in it [m].
SMALL_HEIGHT = 1e-4
# Torque over height [N] that counts as none: 0.1 % of that of turned petals.
ROUND_OFF = 1e-6
# Rms heights of the steady sails of the study `ikaros_devices` [mm].
COMPUTED_HEIGHTS = (0.5, 3.6)
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


# Height of a petal over the largest, at distances out and s from the axis, the latter along the
# outer edge from its middle [m].
Shape = Callable[[Array, Array], Array]


def at_edge(out: Array) -> Array:
    """1 on the outer edge, 0 one device from it."""
    return np.maximum(1 - (OUTER - out) / DEVICE, 0.0)


# All petals are alike.  Where the shape is odd in s and not zero at s = ±out, a seam has a step.
SHAPES: dict[str, Shape] = {
    "petals turned about their radius": lambda out, s: s / OUTER,
    "step at the seams, the same along them": lambda out, s: s / out / 2,
    "outer edge S-shaped, seams closed": lambda out, s: (
        np.sin(np.pi * s / out) * ((out - INNER) / (OUTER - INNER)) ** 2
    ),
    "three such waves": lambda out, s: np.sin(3 * np.pi * s / out) * (out / OUTER) ** 2,
    "one tip of each petal up, within 1 m": lambda out, s: (
        np.maximum(1 - (OUTER - out), 0.0) * np.maximum(1 - (out - s), 0.0)
    ),
    "devices up on one half of each edge": lambda out, s: at_edge(out) * (s > 0),
    "dome": lambda out, s: (out / OUTER) ** 2,
    "waves inside, seams and edges flat": lambda out, s: (
        np.sin(np.pi * (out - INNER) / (OUTER - INNER)) * np.sin(2 * np.pi * s / out)
    ),
}


def shaped(shape: Shape, height: float, cells: int = 48) -> Array:
    """Four petals of a largest height [m] as triangles (n, 3, 3) [m], `cells` rows of squares."""
    out = np.linspace(INNER, OUTER, cells + 1)[:, None]
    # An even number: the middle of the outer edge is a corner.
    s = out * np.linspace(-1.0, 1.0, 4 * cells + 1)
    out = out + 0 * s
    X = np.stack([out, s, height * shape(out, s)], axis=2)
    a, b, c, d = X[:-1, :-1], X[1:, :-1], X[1:, 1:], X[:-1, 1:]
    petal = np.concatenate([np.stack(three, axis=2) for three in ((a, b, c), (a, c, d))])
    petal = petal.reshape(-1, 3, 3)
    found = []
    for _ in range(4):
        found.append(petal)
        # By a right angle about the axis
        petal = petal[:, :, [1, 0, 2]] * [-1.0, 1.0, 1.0]
    return np.concatenate(found)


def torque_of_light(comm: MPI.Comm, corners: Array) -> float:
    """Torque of sunlight [N m] about z on triangles (n, 3, 3) [m] of all ranks; light travels along
    z."""
    areas = area_vectors(corners)
    along_z = np.array([0.0, 0.0, 1.0])
    forces = light_force(
        areas, along_z, OPTICS.coefficients(), OPTICS.coefficients(back=True), Arrays
    )
    torques = np.cross(corners.mean(axis=1), forces)
    return float(PRESSURE_AT_AU / DISTANCE**2 * comm.allreduce(torques[:, 2].sum()))


def sensitivities() -> dict[str, float]:
    """Torque over height [N] of the shapes that are alike in all petals, without its sign."""
    return {
        name: abs(torque_of_light(MPI.COMM_SELF, shaped(shape, SMALL_HEIGHT))) / SMALL_HEIGHT
        for name, shape in SHAPES.items()
    }


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
    """The petals, the torque over the pitch: computed, by the formula, and in flight; and the
    heights of other shapes that have the flight's torque.

    Args:
        results: of `main`, by pitch [rad].
        path: of the picture.
    """
    figure = new_figure(width=10.0, height=7.6)
    above, below = figure.subfigures(2, 1, height_ratios=(1.2, 1.0))
    left, right = above.subfigures(1, 2, width_ratios=(1.0, 1.3))
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
    bars = below.subplots()
    torques = sensitivities()
    heights = [1e3 * abs(FLIGHT) / max(torque, ROUND_OFF) for torque in torques.values()]
    bars.barh(list(torques), heights, color=BLUE)
    bars.axvspan(*COMPUTED_HEIGHTS, color=GREY, alpha=0.4, label="rms heights, IKAROS as built")
    bars.set_xscale("log")
    bars.set_xlim(0.3, 1e4)
    bars.invert_yaxis()
    finish(bars, "largest height with the flight's torque [mm]; full bars: none", "")
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
    orbit = round_the_sun(gx.orbit.Elements(DISTANCE * astronomical_unit))
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

    def spin() -> float:
        directors = run.system.unknowns.state.vectors(frame.directors[:2])
        rates = run.system.unknowns.state.rates(frame.directors[:2])
        return float(rates[0] @ directors[1])

    before = spin()
    run.run(until=steps * dt)
    braked = INERTIA * (spin() - before) / run.time
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
        for name, torque in sensitivities().items():
            needed = "none"
            if torque > ROUND_OFF:
                needed = f"{1e3 * abs(FLIGHT) / torque:.3g} mm"
            print(f"{name}: {1e-3 * torque:.2e} N m/mm, the flight's torque with {needed}")
