"""SPROUT: two inflatable tubes in V unfold the film between them from a cube satellite that is free
in space, and hold it.

Stowed (`build`): tubes and film lie in one plane, and one Miura fold goes through all of them: the
tubes are pressed flat, and have two sheets at each crease.  The fold is not quite shut, so no two
layers coincide, and it costs no strain but for the room between the two sheets.  The parallelogram
at the roots lies as it will when all is open; the others are stacked in front of the cube.  At
t = 0 nothing holds the stack any more, and two valves open from a tank in the cube. Each tube has
compartments; gas passes from one to the next through the deformed ring of film between them, at a
fold. The tubes open, unfold and draw the film with them, whose edges are tied to theirs.  Contact
keeps all layers and the cube apart.  Nothing acts from outside: energy, momentum and angular
momentum stay as they were.

Arguments change the mass of the cube, stow the stack in a box with a lid that springs open, or make
a test on the ground: the cube is held, gravity acts along an axis, and air slows the films and
presses on the tubes.

Deployed (`deployed`): the equilibrium of the open figure.  As built it is not taut.  A tube that
becomes round is narrower by (π/2 - 1) d, while the film was cut for flat tubes: it pulls the tubes
to each other where they are next to each other, near the roots, and is slack at the tips.  The
roots, which are pressed flat, let the tubes turn.  With round roots, and a film cut for round
tubes, the angle of the V stays the same; but a tied film is 10⁴ times as stiff in its plane as the
tubes are in bending, so that it bears on a few points, and wrinkles.

A film that is hung is taut.  It hangs by three cords from the tips and from the cube, and its edges
are arcs with a cable in each, so that film and cables are in equilibrium with the same tension n in
all directions: a cable of radius R bears n R, and a cord the resultant of two cables.  The tips are
pulled inwards; the film is cut for the tips as a cantilever of the bending stiffness EI = π E t r³
has them under the cord's force F, across (n) and along (a) the tube:

    δ = F_n L³/(3 EI) / (1 - F_a/P),    P = π² EI/(4 L²)

For a tube alone there is another closed form, the first frequency 1.8751² √(EI/m)/(2π L²) with its
mass m per length.

Where the values come from:
    cube, tubes, film    20 cm, 7 kg, two tubes of 1.5 m in V with a triangular film: SPROUT, Nihon
                         University (eoPortal; Miyazaki, KAKENHI 19360384 final report, 2009).  The
                         report of 2009 has a satellite of the class of 5 kg; 7.1 kg flew in 2014.
                         The angle of 60° is chosen, as are diameter, folds, tank and valves, and
                         how film and roots are held, which were not published
    box, lid             chosen: a lid of 0.1 kg that is open after some 80 ms; the box is as wide
                         as the open V, and as high as a panel that turns about a fold needs
    air                  an ideal gas at 293 K; drag as of `gx.loads.AirDrag`, without the mass of
                         air that moves with the film
    film                 polyimide, Kapton HN 50 (DuPont data sheet H-38492): 12.5 µm, 2.5 GPa,
                         0.34, 1420 kg/m³
    tank                 chosen: nitrogen at 20 kPa and 293 K, two litres, which fill the tubes to
                         about 10 kPa
    damping              chosen: 1 ms, viscosity of the film over its stiffness
    tension              chosen: 8 mN/m.  The tubes then bear half of π p r³/2, at which a tube
                         begins to wrinkle (Comer & Levy, AIAA J. 1 (1963) 1652)
    cords                chosen: 1 N/m, so that an error of a millimetre changes the tension by a
                         few per cent
    cables               aramid thread of 0.1 mm: 500 N, 1.1e-5 kg/m

    ./gossamer demo sprout
    ./gossamer demo sprout deployed
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
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
from mpi4py import MPI
from scipy.spatial.transform import Rotation

import gossamer_fx as gx
from demos.common.arcs import Arc, arc_mesh, arcs, corner_pulls, radii_of
from demos.common.command_line import check_words
from demos.common.deployment import (
    UNITS,
    deployment_case,
    dissipation,
    first_time,
    print_figures,
    run_case,
    run_figures,
    square_millimetres,
)
from demos.common.inflatable_tube import InflatableTube
from demos.common.lidded_box import LiddedBox
from gossamer_fx.extend import Array, Obstacle, Port, Probe, check_arguments, relative_drift
from gossamer_fx.meshes.creased import creased_film, creased_tube
from gossamer_fx.presets.films import KAPTON_HN
from gossamer_fx.presets.gases import NITROGEN

TITLE = "Two tubes in V unfold a film from a cube"
VIEW = gx.plot.View(azimuth=math.radians(-60), elevation=math.radians(35), zoom=True)
VIEW_OF_V = gx.plot.View(azimuth=math.radians(-90), elevation=math.radians(60))
FILM = KAPTON_HN
THICKNESS = 12.5e-6  # m
DIAMETER = 0.03  # of the tubes [m]
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
# Of the deployed satellite.
PRESSURE = 10.3e3  # of the gas over that outside [Pa]
TENSION = 8e-3  # of the film [N/m]
CORD = 1.0  # stiffness of a cord [N/m]
CORD_LENGTH = 0.06  # under load [m]
SAG = 0.08  # of the arcs, over the distance of their ends
CABLE = gx.CableLaw(EA=500.0, line_density=1.1e-5)
# cos k cosh k = -1 of a cantilever.
FIRST_EIGENVALUE = 1.875104069
# Modes below this frequency [Hz] are rigid motions of the free satellite, of which there are six.
RIGID = 0.02
RIGID_MOTIONS = 6
Attachment = Literal["hung", "tied", "none"]
Roots = Literal["round", "flat"]
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

    @property
    def narrowing(self) -> float:
        """By which a side of a tube moves to its axis as it becomes round [m]."""
        return (self.width - self.diameter) / 2

    @property
    def stub(self) -> float:
        """Length of tube beyond a round end, in which it closes to a flat seam [m]."""
        return 1.5 * self.diameter

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

    def film(self, out: float = 0.0) -> list[Point]:
        """Outline of the film, which may be wider than between flat tubes, by `out` on each side;
        its side 1 is at the roots."""
        ends = ((-1, 0.0), (1, 0.0), (1, self.length), (-1, self.length))
        return [self.at(side, along, out) for side, along in ends]


def seams(film: gx.Membrane, tubes: Mapping[int, gx.Membrane], roots: Roots) -> list[gx.Tie]:
    """What ties the edges of the film to the inner sides of the tubes."""
    found = []
    for side, of_film, of_tube in ((1, "side 2", "side 4"), (-1, "side 4", "side 2")):
        if roots == "flat":
            tie = gx.Tie(tubes[side], film, group_a=of_tube, group_b=of_film)
        else:
            # The tubes go on beyond the film, in stubs.
            tie = gx.Tie(film, tubes[side], group_a=of_film, group_b=of_tube)
        found.append(tie)
    return found


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
    diameter: float = DIAMETER,
    a: float = 0.32,
    b: float = 0.37,
    gamma_degrees: float = 82.0,
    theta_degrees: float = 88.5,
    cell: float = 0.06,
    fine: float = 0.2,
    coarse: float = 0.3,
    rows: int = 2,
    lift: float = 5e-5,
    thickness: float = THICKNESS,
    tank: float = 2e-3,
    pressure: float = 20e3,
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
    law = FILM.law(thickness, residual_stiffness=1e-4)
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
            pressure=max(air, 1.0),
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
    tube_films = {side: tube.film for side, tube in tubes.items()}
    items += seams(film, tube_films, "flat")
    films = [film, *tube_films.values()]
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
    tips, at the end and as a mean over the last half of the time, and of their middle from the line
    of the roots [m], the time when all rings are half open, the spin of the cube at the end
    [rad/s], pressures at the end [Pa] and the time of the end [s].
    """
    case = build(comm, until=until, **given)  # type: ignore[arg-type]
    parts = (0.0, 0.08, 0.16, 0.22, 0.27, 0.31, 0.4, 0.5, 0.7, 1.0)
    run, series = run_case(case, output, "sprout", parts, VIEW)
    # Paths (n, 3) [m] of the tips.
    left, right = (np.column_stack([series[f"{k} tip {i} [m]"] for i in "xyz"]) for k in SIDES)
    spans = np.linalg.norm(right - left, axis=1)
    late = np.linspace(run.time / 2, run.time, 500)
    rings = [series[name] for name in case.probes if name.endswith("[mm2]")]
    diameter = float(given.get("diameter", DIAMETER))  # type: ignore[arg-type]
    half_open = 1e6 * math.pi * diameter**2 / 8
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
        "span": float(spans[-1]),
        "span_mean": float(np.interp(late, series.time, spans).mean()),
        "reach": float((left[-1] + right[-1])[1] / 2 - CUBE / 2 - STAND),
        "opened": first_time(series.time, np.min(rings, axis=0, initial=math.inf), half_open),
        "spin": float(spin[-1]),
        "time": run.time,
        **dissipation(run),
        **{f"pressure_{name[:-5].replace(' ', '_')}": p for name, p in ends.items()},
    }


@dataclass(frozen=True)
class Deployed:
    """The deployed satellite: the tips of its tubes, its film, the figure in which they are cut,
    and the search for the equilibrium."""

    tips: Mapping[int, Port]
    film: gx.Membrane | None
    figure: Figure
    shape: Cut
    statics: gx.Equilibrium

    def tip(self, side: int) -> Array:
        """Position (3,) [m] of the middle of a tube's tip."""
        return self.statics.system.unknowns.state.vector(self.tips[side])

    def span(self) -> float:
        """Distance of the tips [m]."""
        return float(np.linalg.norm(self.tip(1) - self.tip(-1)))

    def half_angle(self) -> float:
        """Angle [degrees] of the line from the root of the right tube to its tip with the axis of
        the V."""
        x, y, _ = self.tip(1)
        x0, y0 = self.figure.axis(1)[0]
        return math.degrees(math.atan2(x - x0, y - y0))


def rounding(X: Array, up: int, figure: Figure, side: int, deflection: float) -> Array:
    """Displacement (3, n) [m] of points X (3, n) of a flat tube that makes it round and bent, and
    keeps lengths but near its flat ends, which are a stub beyond root and tip.

    Args:
        X: points of one sheet.
        up: 1 for the upper sheet, -1 for the lower one.
        figure: of the flat tubes.
        side: of the tube.
        deflection: of the tip inwards [m], in the shape of a cantilever that is loaded there.
    """
    x0, y0 = figure.at(side, 0.0, 0.0)
    axis = np.array([side * math.sin(HALF), math.cos(HALF)])
    outward = np.array([side * math.cos(HALF), -math.sin(HALF)])
    from_root = X[:2] - np.array([[x0], [y0]])
    along = axis @ from_root
    out = outward @ from_root
    length = figure.length
    # Ends are cut along x: their distance depends on that across the tube.
    shift = out * math.tan(HALF)
    nearest_end = np.minimum(along - shift, length - along + shift) + figure.stub
    # From flat at the ends to round at a distance of one diameter.
    roundness = np.clip(nearest_end / figure.diameter, 0.0, 1.0)
    radius = figure.diameter / 2
    angle = np.pi * out / figure.width
    round_out = figure.width / 2 - radius * np.cos(angle)
    moved = roundness * (round_out - out)
    lifted = up * roundness * radius * np.sin(angle)
    # Sections stay normal to the bent axis, so that the start is nearly free of stress.
    station = np.clip(along / length, 0.0, 1.0)
    # Beyond the tip the tube goes on straight.
    beyond = np.maximum(along / length - 1, 0.0)
    inward = deflection * ((3 * station**2 - station**3) / 2 + 1.5 * beyond)
    slope = deflection * (6 * station - 3 * station**2) / (2 * length)
    from_axis = out + moved - figure.width / 2
    in_plane = np.outer(outward, moved - inward) + np.outer(axis, slope * from_axis)
    return np.vstack([in_plane, lifted])


def open_tube(
    comm: MPI.Comm,
    figure: Figure,
    side: int,
    law: gx.Miyazaki,
    cell: float,
    roots: Roots,
    deflection: float,
) -> gx.Membrane:
    """A tube that is unfolded; with round roots it starts round and bent, and has a stub beyond
    each end that closes it.

    The groups "ring 1" and "ring 2" are its round sections at root and tip; "side 1" is the flat
    root of a flat tube.
    """
    name = {1: "right", -1: "left"}[side]
    # A line of edges along the axis, so that the sections have nodes there.
    lines = [figure.axis(side)]
    if roots == "flat":
        flat = creased_tube(comm, figure.tube(side), lines, cell, lambda X: X[:, 1], ())
        return gx.Membrane(flat, law, name=name)
    stub = figure.stub
    longer = Figure(figure.length + 2 * stub, figure.diameter, figure.at(0, -stub, 0.0))
    # The root of the longer tube is nearer to the middle, too.
    shift = -side * stub * math.sin(HALF)
    outline = [(x + shift, y) for x, y in longer.tube(side)]
    for along in (0.0, figure.length):
        lines.append((figure.at(side, along, 0.0), figure.at(side, along, figure.width)))
    walls = (0.0, figure.length * math.cos(HALF))
    mesh = creased_tube(comm, outline, lines, cell, lambda X: X[:, 1], walls)
    given = {"figure": figure, "side": side, "deflection": deflection}
    sheets = {"top": partial(rounding, up=1, **given), "bottom": partial(rounding, up=-1, **given)}
    return gx.Membrane(mesh, law, displacement=sheets, name=name)


def bending_stiffness(figure: Figure, thickness: float) -> float:
    """π E t r³ [N m²] of a round tube."""
    return math.pi * FILM.E * thickness * (figure.diameter / 2) ** 3


@dataclass(frozen=True)
class Cut:
    """The film with arcs for edges, in the plane, and the forces in it.

    Attributes:
        supports: where its cords are held (3, 2) [m]: on the cube, and at the tips as they are
            under load, right and left.
        edges: arcs between the corners of the film.
        forces: of film and cables on the cords (3, 2) [N].
        deflection: of the tips [m], by the closed form.
    """

    supports: Array
    edges: list[Arc]
    forces: Array
    deflection: float

    @property
    def corners(self) -> Array:
        """Of the film (3, 2) [m]."""
        return np.array([arc.ends[0] for arc in self.edges])


def cut(figure: Figure, thickness: float, tension: float, pressure: float) -> Cut:
    """The film for a tension [N/m], for which the tips are where the closed forms say; pressure of
    the gas [Pa]."""
    length = figure.length
    EI = bending_stiffness(figure, thickness)
    buckling_load = math.pi**2 * EI / (4 * length**2)
    inward = np.array([-math.cos(HALF), math.sin(HALF)])
    along = np.array([math.sin(HALF), math.cos(HALF)])
    # A closed tube under pressure is longer by (½ - ν) p r/(E t).
    strain = (0.5 - FILM.nu) * pressure * figure.diameter / (2 * FILM.E * thickness)
    root = np.array(figure.axis(1)[0])
    straight_tip = root + (1 + strain) * length * along
    mirror = np.array([-1.0, 1.0])
    supports = np.array([[0.0, 0.0], straight_tip, straight_tip * mirror])
    corners = supports.copy()
    deflection = 0.0
    # Forces turn with the corners, and move them a little: a few turns until both agree.
    for _ in range(50):
        radii = radii_of(corners, SAG)
        forces = corner_pulls(arcs(corners, radii), tension)
        # The force pulls the tip towards the middle of the film: a part bends the tube, a part
        # presses on it.
        across_tube = float(forces[1] @ inward)
        along_tube = float(-forces[1] @ along)
        # Compression makes the tube softer in bending, as in Euler's buckling.
        small = across_tube * length**3 / (3 * EI)
        deflection = small / (1 - along_tube / buckling_load)
        tip = straight_tip + deflection * inward
        supports[1] = tip
        supports[2] = tip * mirror
        # Each cord lies along its force; on the way its length moves the corner of the film.
        directions = forces / np.linalg.norm(forces, axis=1)[:, None]
        corners = supports + CORD_LENGTH * directions
    return Cut(supports, arcs(corners, radii), forces, deflection)


def hung_film(
    comm: MPI.Comm, shape: Cut, law: gx.Miyazaki, tension: float, cell: float
) -> tuple[gx.Membrane, list[gx.connectors.Tape]]:
    """The film under its tension [N/m], with cells of a size [m], and the cables in its edges."""
    names = [f"corner {k}" for k in range(3)]
    mesh = arc_mesh(comm, shape.edges, names, lambda model, *_: model.mesh.generate(2), cell)
    film = gx.Membrane(mesh, law, initial_stress=tension / law.thickness, name="film")
    cables = []
    for k, arc in enumerate(shape.edges):
        # Made shorter by its strain, so that it bears its force at the length of the arc.
        strain = tension * arc.radius / CABLE.EA
        cable = gx.connectors.Tape.along_edges(
            film, CABLE, edges=f"edge {k}", length_factor=1 / (1 + strain), name=f"cable {k}"
        )
        cables.append(cable)
    return film, cables


@check_arguments
def deployed(
    comm: MPI.Comm,
    length: float = 1.5,
    pressure: float = PRESSURE,
    cell: float = 0.012,
    film_cell: float = 0.06,
    held: bool = False,
    attachment: Attachment = "hung",
    roots: Roots = "round",
) -> Deployed:
    """The open figure before its equilibrium.

    Args:
        length: of the tubes [m].
        pressure: of the gas over that outside [Pa].
        cell, film_cell: of tubes and film [m].
        held: whether the cube is fixed in space.
        attachment: the film is "hung" by cords at its corners, or "tied" along the tubes: if their
            roots are flat, it is as wide as that of `build`, which is cut for flat tubes, else it
            is cut for round ones.  "none": there is no film.
        roots: "round", the tubes have round plates as ends, by which they are fixed to the cube, or
            "flat", they are pressed flat there, as those of `build`.
    """
    figure = Figure(length, DIAMETER, (0.0, 0.0))
    law = FILM.law(THICKNESS, residual_stiffness=1e-4)
    cube = gx.RigidBody(
        MASS,
        [inertia(MASS)] * 3,
        position=(0.0, -CUBE / 2 - STAND, 0.0),
        comm=comm,
        name="cube",
    )
    # Bodies and what joins them, in any order: the scene sorts them.
    items: list[object] = [cube]
    if held:
        items.append(gx.constraints.FixedJoint(gx.ground_frame(), cube.frame_at((0.0, 0.0, 0.0))))
    tubes: dict[int, gx.Membrane] = {}
    tips: dict[int, Port] = {}
    shape = cut(figure, THICKNESS, TENSION, pressure)
    deflection = shape.deflection if attachment == "hung" else 0.0
    for name, side in SIDES.items():
        tube = open_tube(comm, figure, side, law, cell, roots, deflection)
        root_group = "ring 1" if roots == "round" else "side 1"
        root = gx.RigidRegion(tube, root_group, rigid_body=cube, name=f"root of {name}")
        items += [tube, root, gx.Pressure(tube, pressure, name=f"gas of {name}")]
        tubes[side] = tube
        if roots == "round":
            plate = gx.RigidRegion(tube, "ring 2", name=f"tip of {name}")
            items.append(plate)
            tips[side] = plate.port()
        else:
            tips[side] = tube.port_at((*figure.axis(side)[1], 0.0))
    film = None
    if attachment == "hung":
        film, cables = hung_film(comm, shape, law, TENSION, film_cell)
        items += [film, *cables]
        ends = [cube.port_at((*shape.supports[0], 0.0)), tips[1], tips[-1]]
        for k, end in enumerate(ends):
            # At its length under load, `CORD_LENGTH`, the cord has the force of the cut.
            stretch = float(np.linalg.norm(shape.forces[k])) / CORD
            cord = gx.connectors.Spring(
                film.port(f"corner {k}"),
                end,
                stiffness=CORD,
                length=CORD_LENGTH - stretch,
                name=f"cord {k}",
            )
            items.append(cord)
    elif attachment == "tied":
        narrowing = figure.narrowing if roots == "round" else 0.0
        mesh = creased_film(comm, figure.film(narrowing), [], [film_cell] * 4)
        film = gx.Membrane(mesh, law, name="film")
        items += [film, *seams(film, tubes, roots)]
    scene = gx.Scene(*items)  # type: ignore[arg-type]
    # Slack film has no unique equilibrium to be found to more digits.
    search = gx.analysis.Continuation(tolerance=1e-4 if attachment == "tied" else 1e-8)
    return Deployed(tips, film, figure, shape, gx.Equilibrium(scene, search))


def moment_ratio(shape: Cut, figure: Figure, pressure: float) -> float:
    """Moment of the cord's force about the root of a tube, in its plane, over that at which a round
    tube under a pressure [Pa] begins to wrinkle, π p r³/2."""
    x0, y0 = figure.axis(1)[0]
    arm = shape.supports[1] - np.array([x0, y0])
    fx, fy = shape.forces[1]
    wrinkling_moment = math.pi * pressure * (figure.diameter / 2) ** 3 / 2
    return abs(float(arm[0] * fy - arm[1] * fx)) / wrinkling_moment


def beam_frequency(figure: Figure, thickness: float) -> float:
    """First frequency [Hz] of a tube as a cantilever, with the mass of the stub at its tip
    (Rayleigh's quotient)."""
    EI = bending_stiffness(figure, thickness)
    mass_per_length = FILM.density * thickness * math.pi * figure.diameter
    stiffness = 3 * EI / figure.length**3
    # Without a stub this is 1.8751² √(EI/m)/(2π L²).
    own_mass = 3 / FIRST_EIGENVALUE**4 * mass_per_length * figure.length
    stub_mass = mass_per_length * figure.stub
    return math.sqrt(stiffness / (own_mass + stub_mass)) / (2 * math.pi)


def tip_deflection(loaded: Deployed, unloaded: Deployed) -> float:
    """Mean deflection [m] of the tips inwards, by the film."""
    total = 0.0
    for side in SIDES.values():
        outward = np.array([side * math.cos(HALF), -math.sin(HALF), 0.0])
        total += float((unloaded.tip(side) - loaded.tip(side)) @ outward)
    return total / len(SIDES)


def mean_tensions(satellite: Deployed) -> tuple[float, float]:
    """Mean principal tensions [N/m] of the film, each cell counted once; the larger first."""
    film = satellite.film
    assert film is not None
    thickness = film.law.thickness
    means = []
    for field in ("second_piola_stress1", "second_piola_stress2"):
        values = gx.fields.field_values(satellite.statics, film, field=field)[1]
        total = film.comm.allreduce(float(values.sum()))
        count = film.comm.allreduce(len(values))
        means.append(thickness * total / count)
    return means[0], means[1]


def at_rest(
    output: str | Path | None = None,
    count: int = 4,
    cell: float = 0.012,
    film_cell: float = 0.06,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> dict[str, float]:
    """Equilibrium and modes of the deployed satellite held and free, and of a tube alone.

    Args:
        output: folder for records of the equilibrium and of the modes, and a picture of the state
            of the film; None: nothing is written.
        count: number of modes.
        cell, film_cell: of `deployed`.
        comm: communicator of the meshes.

    Returns:
        Frequencies [Hz], tensions [N/m] and deflections [m], with those of the closed forms.
    """
    alone = deployed(comm, cell=cell, held=True, attachment="none")
    alone.statics.find()
    tube_modes = gx.analysis.modes(alone.statics, 4)
    held = deployed(comm, cell=cell, film_cell=film_cell, held=True)
    held.statics.find()
    tensions = mean_tensions(held)
    free = deployed(comm, cell=cell, film_cell=film_cell)
    free.statics.find()
    all_modes = gx.analysis.modes(free.statics, count + RIGID_MOTIONS)
    # A free satellite has six motions without frequency; they are not vibrations.
    free_modes = [mode for mode in all_modes if mode.frequency > RIGID]
    if output is not None:
        folder = Path(output)
        recording = gx.Recording(folder / "equilibrium", title="SPROUT deployed", overwrite=True)
        gx.outputs.record(free.statics, [recording])
        gx.outputs.record_modes(free.statics, free_modes, folder / "modes", overwrite=True)
        if comm.rank == 0:
            run = gx.plot.RunReader(folder / "equilibrium")
            picture = folder / "sprout_deployed.png"
            gx.plot.field(run, "state", times=run.times, path=picture, view=VIEW_OF_V)
    mean_tube = sum(mode.frequency for mode in tube_modes) / len(tube_modes)
    return {
        "a tube alone [Hz]": mean_tube,
        "a tube alone, closed form [Hz]": beam_frequency(alone.figure, THICKNESS),
        "span [m]": held.span(),
        "span, closed form [m]": 2 * float(held.shape.supports[1, 0]),
        "deflection of the tips [m]": tip_deflection(held, alone),
        "deflection of the tips, closed form [m]": held.shape.deflection,
        "moment at the root over that of wrinkling": moment_ratio(
            held.shape, held.figure, PRESSURE
        ),
        "larger tension of the film [N/m]": tensions[0],
        "smaller tension of the film [N/m]": tensions[1],
        **{f"free, mode {k} [Hz]": mode.frequency for k, mode in enumerate(free_modes, start=1)},
    }


if __name__ == "__main__":
    check_words(sys.argv[1:], ["deployed"])
    if "deployed" in sys.argv[1:]:
        print_figures(at_rest(output="out/sprout_deployed"))
    else:
        print_figures(main(output="out/sprout"), UNITS)
