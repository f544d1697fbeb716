"""How do I control a soft body by gas pressure?

Each `Chamber` is a gas volume with its own valve, an `Orifice` whose area is a function of time.
The function may be an object that also reads the run after every step, as an output: a controller.

A finger is made of two tubes side by side (radius R, wall t, modulus E along, much stiffer around,
as if wound with thread), joined along a line.  Pressures p + Δ and p - Δ lengthen one and shorten
the other:

    ε = p R/(2 E t) in each,    κ = (ε₁ - ε₂)/(3 R),    angle at the tip  θ = κ L = Δ L/(3 E t)

(a beam of two thin tubes, axes 2R apart, small strains).  Printed: the angle over this form, 0.93
with eight edges around a tube and strains of 1.5 %; it is 0.98 with twelve edges and a sixth of the
pressures (`Finger(comm, 12)`, MEAN = 1000).  Without the thread rubber, of ν = ½, would only widen
and not lengthen: (1 - 2ν) of ε remains.

Then the valves are under control.  The first tube takes gas from a supply while the angle is too
small, and loses gas while it is too large, with areas in proportion to the error:

    A_in = G max(θ* - θ, 0),   A_out = G max(θ - θ*, 0)

The finger reaches 12° within 2 s, to 0.01°: closed valves hold the gas, so that no steady error is
left. Energy, with that of the supply, and the mass of the gas close to round-off.

Where the values come from:
    θ                  M = 2 Δ π R² · R of the end forces against 2 (E π R³ t + E 2πR t R²)
    sizes, film        chosen: silicone of 5 MPa, R = 5 mm, t = 0.2 mm, L = 0.2 m; 6 kPa above an
                       atmosphere
    gain G             chosen: 0.1 mm² per radian; with five times as much it swings

    ./gossamer demo soft_finger
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import print_figures
from demos.common.figures import BLUE, GREY, RED, draw_film, finish, new_figure, save, triangles
from gossamer_fx.extend import Array, Output
from gossamer_fx.meshes.tube_section import capped_cylinder
from gossamer_fx.presets.gases import AIR

RADIUS = 5e-3  # of a tube [m]
LENGTH = 0.2  # m
SKIN = gx.LinearOrthotropic(
    5e6,
    5e8,
    0.0,
    5e6,
    density=1000.0,
    thickness=2e-4,
    direction={"wall": (1.0, 0.0, 0.0), "caps": (0.0, 1.0, 0.0)},
)
ATMOSPHERE = 101325.0  # Pa
MEAN = 6e3  # pressure in both tubes above the atmosphere [Pa]
TEMPERATURE = 293.0  # K
TARGET = math.radians(12.0)
GAIN = 1e-7  # m²/rad


class Finger:
    """Two tubes along x, joined along the x axis; the first one lies at y > 0.

    Attributes:
        films: the tubes.
        parts: supports, joint, and the films.
    """

    def __init__(self, comm: MPI.Intracomm, around: int = 8, along: int = 8) -> None:
        """Make tubes of films of order 2 with `around` × `along` cells."""
        self.films = [self._tube(comm, side, around, along) for side in (1, -1)]
        first, second = self.films
        joint = gx.Tie(first, second, group_a="right", group_b="left")
        clamps = [gx.Fixed(film, "first rim") for film in self.films]
        self.parts = [*self.films, joint, *clamps]
        # A point at the end of the line along which the tubes are joined.
        tip = second.port_at((LENGTH, RADIUS, 0.0))
        self._tip = [gx.probes.Position(tip, axis) for axis in "xy"]

    @staticmethod
    def _tube(comm: MPI.Intracomm, side: int, around: int, along: int) -> gx.Membrane:
        mesh = capped_cylinder(comm, RADIUS, LENGTH, around, along)
        return gx.Membrane(
            mesh,
            SKIN,
            order=2,
            displacement=lambda X: np.stack([0 * X[0], 0 * X[1] + side * RADIUS, 0 * X[2]]),
            name=f"tube {side}",
        )

    def angle(self, run: Any) -> float:
        """Angle [rad] of the tip, of a finger that is bent to an arc, towards the second tube."""
        x, y = (probe(run) for probe in self._tip)
        return 2 * math.atan2(-y, x)


class Controller(Output):
    """Valves of the first tube, which follow the measured angle; as an output it reads the run."""

    def __init__(self, finger: Finger) -> None:
        self._finger = finger
        self.error = 0.0  # rad
        self.angles: list[float] = []

    def record(self, run: Any, last: bool) -> None:
        """Measure the angle after a step; the areas of the valves are constant within the next
        one."""
        angle = self._finger.angle(run)
        self.angles.append(angle)
        self.error = TARGET - angle

    def inlet_area(self, t: float) -> float:
        """Area [m²] of the valve to the supply."""
        return GAIN * max(self.error, 0.0)

    def vent_area(self, t: float) -> float:
        """Area [m²] of the valve to the atmosphere."""
        return GAIN * max(-self.error, 0.0)


def pressed(finger: Finger) -> gx.Equilibrium:
    """The finger under MEAN + Δ and MEAN - Δ; the "time" of its loads is Δ [Pa]."""
    first, second = finger.films
    loads = [
        gx.Pressure(first, lambda Δ: MEAN + Δ, name="pressure 1"),
        gx.Pressure(second, lambda Δ: MEAN - Δ, name="pressure 2"),
    ]
    return gx.Equilibrium(gx.Scene(*finger.parts, *loads))


def bent(differences: Array) -> tuple[Array, list[list[Array]]]:
    """Angles [rad] in equilibrium for differences Δ [Pa], and triangles of both tubes."""
    finger = Finger(MPI.COMM_SELF)
    search = pressed(finger)
    angles = []
    shapes = []
    for difference in differences:
        search.find(at=float(difference))
        angles.append(finger.angle(search))
        shapes.append([triangles(search.system, film) for film in finger.films])
    return np.array(angles), shapes


def build(comm: MPI.Intracomm, dt: float = 0.015, until: float = 2.0) -> tuple[Controller, gx.Case]:
    """The finger with gas in its tubes, and the controller of its valves."""
    finger = Finger(comm)
    # The film starts stretched by the pressure of the gas, straight and at rest.
    straight = pressed(finger)
    straight.find(at=0.0)
    outside = gx.gas.Ambient(ATMOSPHERE, TEMPERATURE)
    chambers = [
        gx.Chamber(
            film,
            gas=AIR,
            pressure=ATMOSPHERE + MEAN,
            temperature=TEMPERATURE,
            outside=outside,
            name=f"gas of {film.name}",
        )
        for film in finger.films
    ]
    controller = Controller(finger)
    supply = gx.gas.Ambient(ATMOSPHERE + 3e4, TEMPERATURE, name="reservoir")
    inlet = gx.Orifice(supply, chambers[0], area=controller.inlet_area, name="inlet")
    vent = gx.Orifice(chambers[0], outside, area=controller.vent_area, name="vent")
    # Silicone and air damp the swing of the finger.
    damping = [
        gx.Damping(film, mass_factor=10.0, stiffness_factor=1e-3, name=f"damping of {film.name}")
        for film in finger.films
    ]
    start = gx.StartFrom(straight.system)
    scene = gx.Scene(*finger.parts, *chambers, inlet, vent, *damping, start)
    title = "A finger under control"
    return controller, gx.Case(scene, gx.Midpoint(dt=dt), until=until, title=title)


def closed_form(differences: Array) -> Array:
    """Angle at the tip [rad]."""
    return differences * LENGTH / (3 * SKIN.E1 * SKIN.thickness)


def draw(
    differences: Array, angles: Array, shape: list[Array], control: tuple[Array, Array], path: Path
) -> None:
    """The bent finger, its angle against the difference of pressures, and its angle under
    control."""
    figure = new_figure(10.5, 3.6)
    finger = figure.add_subplot(1, 3, 1, projection="3d")
    both = np.concatenate(shape)
    draw_film(finger, both, view=(60.0, -80.0))
    statics = figure.add_subplot(1, 3, 2)
    dynamics = figure.add_subplot(1, 3, 3)
    kilopascal = 1e-3 * differences
    statics.plot(kilopascal, np.degrees(closed_form(differences)), color=GREY, label="beam")
    statics.plot(kilopascal, np.degrees(angles), "o", color=RED, label="film")
    finish(statics, "Δ [kPa]", "angle of the tip [°]", loc="lower right")
    time, angle = control
    dynamics.axhline(math.degrees(TARGET), color=GREY, linestyle="--", label="wanted")
    dynamics.plot(time, np.degrees(angle), color=BLUE, label="under control")
    dynamics.set(ylim=(0, None))
    finish(dynamics, "time [s]", "angle of the tip [°]", loc="lower right")
    save(figure, path)


def main(output: str | Path | None = None, until: float = 2.0) -> dict[str, float]:
    """Angle over its closed form, angle under control until a time [s], errors of energy and mass;
    picture."""
    differences = np.array([0.0, 1e3, 2e3, 3e3, 4e3])
    angles, shapes = bent(differences)
    controller, case = build(MPI.COMM_SELF, until=until)
    series = gx.Series({})
    run = case.simulation([controller, series])
    run.run(until=case.until)
    if output is not None:
        control = (np.array(series.time), np.array(controller.angles))
        draw(differences, angles, shapes[-1], control, Path(output) / "soft_finger.png")
    return {
        "angle at 1 kPa over closed form": angles[1] / closed_form(differences)[1],
        "angle at 4 kPa over closed form": angles[-1] / closed_form(differences)[-1],
        "angle wanted [deg]": math.degrees(TARGET),
        "angle under control [deg]": math.degrees(controller.angles[-1]),
        "energy error": abs(run.energy_error),
        "mass error": abs(run.mass_error),
    }


if __name__ == "__main__":
    if MPI.COMM_WORLD.rank == 0:
        print_figures(main(output="out/soft_finger"))
