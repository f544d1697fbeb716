"""Two inflatable tubes in V unfold the film between them from a cube satellite that is free in
space.

Tubes and film lie in one plane, and one Miura fold goes through all of them: the tubes are pressed
flat, and have two sheets at each crease.  The fold is not quite shut, so no two layers coincide,
and it costs no strain but for the room between the two sheets.  The parallelogram at the roots lies
as it will when all is open; the others are stacked in front of the cube.  At t = 0 nothing holds
the stack any more, and two valves open from a tank in the cube. Each tube has compartments; gas
passes from one to the next through the deformed ring of film between them, at a fold. The tubes
open, unfold and draw the film with them, whose edges are tied to theirs.  Contact keeps all layers
and the cube apart.  Nothing acts from outside: energy, momentum and angular momentum stay as they
were.

Arguments change the mass of the cube, stow the stack in a box with a lid that springs open, or make
a test on the ground: the cube is held, gravity acts along an axis, and air slows the films and
presses on the tubes.

Where the values come from:
    cube, tubes, film    20 cm, 7 kg, two tubes of 1.5 m in V with a triangular film: SPROUT, Nihon
                         University (eoPortal; Miyazaki, KAKENHI 19360384 final report, 2009).  The
                         report of 2009 has a satellite of the class of 5 kg; 7.1 kg flew in 2014.
                         The angle of 60° is chosen, as are diameter, folds, tank and valves, which
                         were not published
    box, lid             chosen: a lid of 0.1 kg that is open after some 80 ms; the box is as wide
                         as the open V, and as high as a panel that turns about a fold needs
    air                  an ideal gas at 293 K; drag as of `gx.loads.AirDrag`, without the mass of
                         air that moves with the film
    film                 polyimide, Kapton HN 50 (DuPont data sheet H-38492): 12.5 µm, 2.5 GPa,
                         0.34, 1420 kg/m³
    tank                 chosen: nitrogen at 20 kPa and 293 K, two litres, which fill the tubes to
                         about 10 kPa
    damping              chosen: 1 ms, viscosity of the film over its stiffness

    ./gossamer demo sprout
    ./gossamer run demos/inflatables/sprout.py crease=1.3e-3 --output out/sprout
    ./gossamer report out/sprout
    ./gossamer run demos/inflatables/sprout.py length=0.6 rows=1 tank=5e-4 damping=3e-4 \\
        until=0.12 --output out/short
    ./gossamer run demos/inflatables/sprout.py mass=5.0 box=True delay=0.06 until=1.5 \\
        --output out/box
    ./gossamer run demos/inflatables/sprout.py gravity=9.80665 down=-z --output out/ground
    ./gossamer run demos/inflatables/sprout.py gravity=9.80665 down=-z air=1000.0 \\
        --output out/chamber
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
from mpi4py import MPI
from scipy.spatial.transform import Rotation

import gossamer_fx as gx
from demos.common.deployment import (
    UNITS,
    deployment_case,
    dissipation,
    print_figures,
    run_case,
    run_figures,
    square_millimetres,
)
from demos.common.inflatable_tube import InflatableTube
from demos.common.lidded_box import LiddedBox
from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.contact.obstacles import Obstacle
from gossamer_fx.meshes.creased import creased_film, creased_tube
from gossamer_fx.presets.films import KAPTON_HN
from gossamer_fx.presets.gases import NITROGEN
from gossamer_fx.records.outputs.output import Probe
from gossamer_fx.solve.system.totals import relative_drift

TITLE = "Two tubes in V unfold a film from a cube"
VIEW = gx.plot.View(azimuth=math.radians(-60), elevation=math.radians(35), zoom=True)
CUBE = 0.2  # edge of the cube [m]
MASS = 7.0  # of the cube [kg]
# The axis along which gravity acts, and its sense.
Direction = Literal["-x", "+x", "-y", "+y", "-z", "+z"]
ROOM_TEMPERATURE = 293.0  # K
GAS_CONSTANT_OF_AIR = 287.05  # J/(kg K)
# Room between the stack and the walls of its box [m]: several times the distance at which contact
# begins.
BOX_ROOM = 0.01
# Box above the cube's face [m], so that contact of the film with face and floor does not begin at
# one point.
BOX_STAND = 2e-3
# Rotation vector [rad] that turns the axes x, y, z of a `LiddedBox` to z, x, y: it opens along y,
# with the hinge below.
BOX_TURN = -2 * math.pi / 3 / math.sqrt(3)
HALF = math.radians(30)  # half of the angle between the tubes
GAP = 0.1  # between the roots of the tubes [m]
STAND = 0.05  # distance of the roots from the cube [m]
BELOW = 0.055  # part of the first parallelogram before the roots [m]
SIDES = {"left": -1, "right": 1}
Point = tuple[float, float]


@dataclass(frozen=True)
class Figure:
    """The flat figure in the plane of the fold map: outlines of tubes and film, (x, y) of their
    corners [m].

    length, diameter: of the tubes [m]; centre: the point between their roots.
    """

    length: float
    diameter: float
    centre: Point

    @property
    def width(self) -> float:
        """Of a tube that is pressed flat [m]."""
        return math.pi * self.diameter / 2

    def at(self, side: int, along: float, out: float) -> Point:
        """The point `along` a leg of the V, from the line of the roots, and `out` of it [m]."""
        x = GAP / 2 + out / math.cos(HALF) + along * math.sin(HALF)
        return self.centre[0] + side * x, self.centre[1] + along * math.cos(HALF)

    def tube(self, side: int) -> list[Point]:
        """Outline of a tube, from its root; its sides 1 and 3 are its ends."""
        first, last = (0.0, self.width) if side > 0 else (self.width, 0.0)
        ends = ((0.0, first), (0.0, last), (self.length, last), (self.length, first))
        return [self.at(side, along, out) for along, out in ends]

    def axis(self, side: int) -> tuple[Point, Point]:
        """Root and tip of a tube."""
        return self.at(side, 0.0, self.width / 2), self.at(side, self.length, self.width / 2)

    def film(self) -> list[Point]:
        """Outline of the film; its side 1 is at the roots."""
        ends = ((-1, 0.0), (1, 0.0), (1, self.length), (-1, self.length))
        return [self.at(side, along, 0.0) for side, along in ends]


def lidded_box(
    stack: Array, figure: Figure, cube: gx.RigidBody, mass: float, panel: float
) -> LiddedBox:
    """The box on the cube in which the stack lies; its lid opens along y.

    Args:
        stack: positions (n, 3) [m] of all nodes at the start.
        figure: whose tubes leave the box straight, without touching its sides.
        cube: carries the box.
        mass: of the lid [kg].
        panel: length of a panel of the fold along the tubes [m].
    """
    floor = CUBE / 2 + BOX_STAND
    front = float(stack[:, 1].max()) + BOX_ROOM
    # Panels turn by half a turn about folds at the opening: in a box that is as high as the stack
    # the tubes were filled and did not get out.
    height = max(panel, float(np.abs(stack[:, 2]).max())) + BOX_ROOM
    # The outer side of an open tube where it passes the opening.
    along = (front - CUBE / 2 - STAND) / math.cos(HALF)
    outer_side = figure.at(1, along, figure.width)[0] - figure.centre[0]
    width = max(outer_side, float(np.abs(stack[:, 0]).max())) + BOX_ROOM
    return LiddedBox(
        (2 * height, 2 * width, front - floor),
        centre=(0.0, (front + floor) / 2, 0.0),
        mass=mass,
        stiffness=4.0,
        rest_angle=2.5,
        # Half of the critical damping: with a twentieth the lid sprang back, and the box was closed
        # again when the tubes were filled.
        damping=0.2,
        max_angle=2.0,
        body=cube,
        turn=(BOX_TURN, BOX_TURN, BOX_TURN),
        name="box",
    )


@check_arguments
def build(
    comm: MPI.Comm,
    length: float = 1.5,
    diameter: float = 0.03,
    a: float = 0.32,
    b: float = 0.37,
    gamma_degrees: float = 82.0,
    theta_degrees: float = 88.5,
    cell: float = 0.06,
    fine: float = 0.2,
    coarse: float = 0.3,
    rows: int = 2,
    lift: float = 5e-5,
    thickness: float = 12.5e-6,
    tank: float = 2e-3,
    pressure: float = 20e3,
    inside: float = 1.0,
    bore: float = 7e-3,
    opening: float = 0.03,
    dead_volume: float = 1e-5,
    crease: float = 0.0,
    contact: float = 5e-4,
    damping: float = 1e-3,
    until: float = 0.4,
    dt: float = 1e-4,
    largest: float = 1e-3,
    iterations: int = 14,
    growth: float = 1.02,
    mass: float = MASS,
    box: bool = False,
    lid: float = 0.1,
    delay: float = 0.0,
    gravity: float = 0.0,
    down: Direction = "-z",
    air: float = 0.0,
) -> gx.Case:
    """The folded tubes and film on the cube, the tank and its valves.

    Args:
        length, diameter: of the tubes [m].
        a, b, gamma_degrees, theta_degrees: of Miura's fold [m], [degrees].
        cell: of the tubes [m]; fine, coarse: of the film at its narrow and its wide end [m].
        rows: of parallelograms in a compartment.
        lift: half of the distance of a tube's sheets at the folds, along the stack [m].
        thickness: of the films [m].
        tank, pressure: its volume [m³], and the pressure in it at the start [Pa].
        inside: pressure in the tubes at the start [Pa].
        bore: of each valve [m], which opens in the time `opening` [s].
        dead_volume: that each compartment cannot be pressed out of [m³].
        crease: stiffness of folds with memory [N m/m/rad]; 0: none.
        contact: distance at which it begins [m].
        damping: viscosity of the films over their stiffness [s]; 0: none.
        largest, growth: step [s], and its ratio to the one before, at most: steps that grow faster
            fail more often.
        mass: of the cube [kg], evenly distributed.
        box, lid: whether the stack lies in a box on the cube, and the mass of its lid [kg],
            released at t = 0.
        delay: of the valves [s], e.g. until the lid is open.
        gravity, down: acceleration [m/s²] and its direction, "-z" across the plane of the V, "-y"
            against the tubes and so on.  The cube is then held.
        air: pressure of the air outside [Pa]; the tank and the tubes contain gas of this pressure
            in addition.
    """
    folds = gx.fold.Miura(
        a=a,
        b=b,
        gamma=math.radians(gamma_degrees),
        theta=math.radians(theta_degrees),
        opening=3e-4 if lift else 0.0,
        lift=lift,
    )
    column = b * math.sin(folds.gamma)
    figure = Figure(length, diameter, (column / 2, BELOW))
    lines = folds.segments((-length, 0.0), (column + length, 2 * length))
    # Of the first parallelogram, which stays as it is.
    origin = (-column / 2, CUBE / 2 + STAND - BELOW, 0.0)
    x, y, z = Rotation.from_matrix(folds.axes.T).as_rotvec()
    turn = (float(x), float(y), float(z))
    law = KAPTON_HN.law(thickness, residual_stiffness=1e-4)
    cube = gx.RigidBody(mass, [inertia(mass)] * 3, name="cube", comm=comm)
    source = gx.Tank(tank, gas=NITROGEN, pressure=pressure + air, temperature=ROOM_TEMPERATURE)
    outside = gx.gas.Ambient(air, ROOM_TEMPERATURE) if air else None

    mesh = creased_film(comm, figure.film(), lines, (fine, fine, coarse, coarse))
    film = gx.Membrane(folds.mark(mesh) if crease else mesh, law, name="film")
    folded_film = folds.start(film, origin, turn)
    items: list[object] = [cube, film, folded_film]
    if crease:
        items += folds.creases(film, stiffness=crease, set_angle_ratio=0.5)
    walls = range(rows, math.ceil((BELOW + length * math.cos(HALF)) / a - 0.5), rows)
    tubes: dict[int, InflatableTube] = {}
    for name, side in SIDES.items():
        outline = [*lines, figure.axis(side)]
        tube = InflatableTube(
            creased_tube(
                comm, figure.tube(side), outline, cell, lambda X: folds.lattice(X)[1], walls
            ),
            law,
            gas=NITROGEN,
            # In a vacuum the tubes are all but empty; in air they start with its pressure.
            pressure=max(air, inside),
            outside=outside,
            dead_volume=dead_volume,
            clamp=None,
            caps={"side 1": cube},
            folds=folds,
            origin=origin,
            turn=turn,
            crease_stiffness=crease,
            set_angle_ratio=0.5,
            name=name,
        )
        valve = tube.inlet(source, partial(valve_area, bore=bore, opening=opening, delay=delay))
        items += [tube, valve]
        tubes[side] = tube
    items += [
        gx.Tie(tubes[1].film, film, group_a="side 4", group_b="side 2"),
        gx.Tie(tubes[-1].film, film, group_a="side 2", group_b="side 4"),
    ]
    films = [film, *(tube.film for tube in tubes.values())]
    if damping:
        items += [
            gx.Damping(body, stiffness_factor=damping, name=f"{body.name} damping")
            for body in films
        ]
    walls_of_cube = gx.contact.Box(
        centre=(0.0, 0.0, 0.0), sizes=(CUBE, CUBE, CUBE), body=cube, name="walls"
    )
    obstacles: list[Obstacle] = [walls_of_cube]
    if box:
        folded_tubes = [tube.start for tube in tubes.values() if tube.start is not None]
        parts: list[Array] = []
        for start in (folded_film, *folded_tubes):
            parts += comm.allgather(start.positions())
        stowed = lidded_box(np.vstack(parts), figure, cube, lid, a)
        items.append(stowed)
        obstacles += stowed.obstacles
    touching = gx.Contact(*films, *obstacles, distance=contact)
    items.append(touching)
    if gravity:
        g = [0.0, 0.0, 0.0]
        g["xyz".index(down[1])] = float(f"{down[0]}{gravity}")
        items += [gx.Gravity(body, g) for body in films]
        items.append(gx.constraints.FixedJoint(gx.ground_frame(), cube.frame(), name="stand"))
    if air:
        density = air / (GAS_CONSTANT_OF_AIR * ROOM_TEMPERATURE)
        items += [
            gx.loads.AirDrag(body, density, name=f"air drag on {body.name}") for body in films
        ]

    probes = tube_probes(tubes, figure)
    probes |= {
        f"spin {axis} [rad/s]": gx.probes.AngularVelocity(cube.frame(), axis) for axis in "xyz"
    }
    probes["penetrations"] = gx.probes.Penetrations(touching)
    control = gx.StepControl(target_iterations=iterations, max_step=largest, max_factor=growth)
    return deployment_case(items, TITLE, probes, until, control, dt)


def tube_probes(tubes: Mapping[int, InflatableTube], figure: Figure) -> dict[str, Probe]:
    """Pressures of the compartments, areas of the rings between them, and positions of the tips."""
    probes: dict[str, Probe] = {}
    for name, side in SIDES.items():
        tube = tubes[side]
        probes |= {f"{bag.name} [Pa]": gx.probes.GasState(bag, "pressure") for bag in tube.chambers}
        probes |= {
            f"{name} ring {i} [mm2]": square_millimetres(gx.probes.RingArea(ring))
            for i, ring in enumerate(tube.rings, start=1)
        }
        tip = tube.film.port_at((*figure.axis(side)[1], 0.0))
        probes |= {f"{name} tip {axis} [m]": gx.probes.Position(tip, axis) for axis in "xyz"}
    return probes


def inertia(mass: float) -> float:
    """Moment of inertia [kg m²] of the cube about any axis through its centre, for a mass [kg]."""
    return mass * CUBE**2 / 6


def valve_area(t: float, bore: float, opening: float, delay: float) -> float:
    """Area [m²] of a valve at a time [s]: it opens from a twentieth of its bore [m], `delay` [s]
    after the start."""
    if t < delay:
        return 0.0
    part = min(0.05 + (t - delay) / opening, 1.0)
    return math.pi / 4 * bore**2 * part**2


def tips(series: gx.Series) -> dict[str, Array]:
    """Paths (n, 3) [m] of the tips of the tubes."""
    return {
        name: np.column_stack([series[f"{name} tip {axis} [m]"] for axis in "xyz"])
        for name in SIDES
    }


def main(
    output: str | Path | None = None,
    until: float = 0.4,
    comm: MPI.Comm = MPI.COMM_WORLD,
    **given: object,
) -> dict[str, float]:
    """Deploy tubes and film; `given` are arguments of `build`.  With `output`, a folder: a
    recording and a picture.

    Returns the figures of `run_figures` and `dissipation`, mass_error (of the gas, relative),
    angular_momentum_drift (over the largest angular momentum of the cube), the distance between the
    tips and of their middle from the line of the roots [m], the spin of the cube at the end
    [rad/s], pressures at the end [Pa] and the time of the end [s].
    """
    case = build(comm, until=until, **given)  # type: ignore[arg-type]
    parts = (0.0, 0.08, 0.16, 0.22, 0.27, 0.31, 0.4, 0.5, 0.7, 1.0)
    run, series = run_case(case, output, "sprout", parts, VIEW)
    left, right = tips(series).values()
    ends = {name: float(series[name][-1]) for name in case.probes if name.endswith("[Pa]")}
    spin = np.linalg.norm([series[f"spin {axis} [rad/s]"] for axis in "xyz"], axis=0)
    most = inertia(float(given.get("mass", MASS))) * float(spin.max())  # type: ignore[arg-type]
    drift = math.nan
    # The stand of a test on the ground and the air take momentum.
    if not given.get("gravity") and not given.get("air"):
        drift = relative_drift(run.totals.angular_momentum, run.first.angular_momentum, most)
    return {
        **run_figures(run, series),
        "mass_error": abs(run.mass_error),
        "angular_momentum_drift": drift,
        "span": float(np.linalg.norm(right[-1] - left[-1])),
        "reach": float((left[-1] + right[-1])[1] / 2 - CUBE / 2 - STAND),
        "spin": float(spin[-1]),
        "time": run.time,
        **dissipation(run),
        **{f"pressure_{name[:-5].replace(' ', '_')}": p for name, p in ends.items()},
    }


if __name__ == "__main__":
    print_figures(main(output="out/sprout"), UNITS)
