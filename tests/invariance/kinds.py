"""Kinds of small scenes, written once in SI units: see `transformations.Description`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.core.model.body import Attached
from gossamer_fx.mechanics.orbit.harmonics import EARTH_MU
from gossamer_fx.meshes.creased_strip import creased_strip
from gossamer_fx.meshes.disc import ring
from gossamer_fx.meshes.plates import irregular_sheet
from gossamer_fx.meshes.sheet import crossed_sheet, sheet
from gossamer_fx.meshes.tube import flat_tube
from gossamer_fx.meshes.tube_section import capped_cylinder
from tests import own_part
from tests.invariance.transformations import Array, Description, Patch, Pieces

FILM = {"E": 1e9, "nu": 0.3, "density": 1400.0, "thickness": 1e-4}
SOFT = {"E": 1e6, "nu": 0.3, "density": 1000.0, "thickness": 1e-3}


@dataclass(frozen=True)
class Made:
    """A scene that was made.

    Attributes:
        parts: of the scene.
        ports: points whose positions and velocities are compared, by name.
        gas: names of the chambers and tanks whose pressures are compared.
    """

    parts: list[Any]
    ports: Mapping[str, Attached]
    gas: Sequence[str] = ()


def named_ports(**made: Any) -> dict[str, Attached]:
    """The ports of several films, with the names of the films before theirs."""
    return {
        f"{film} {name}": port for film, parts in made.items() for name, port in parts.ports.items()
    }


@dataclass(frozen=True, eq=False)
class Kind:
    """A kind of scene as data.

    Attributes:
        name: of the kind.
        make: makes the scene as a transformation describes it.
        dt: time step [s]; 0: the scene is at rest, and its equilibrium is compared.
        steps: number of steps.
        tolerance: of results, relative: round-off of 1e-16 and what steps make of it.
        left_out: names of transformations that change the physics of the scene, with the reason.
    """

    name: str
    make: Callable[[Description], Made]
    dt: float
    steps: int
    tolerance: float
    left_out: Mapping[str, str] = field(default_factory=dict)


@cache
def patch(generator: Callable[..., gx.Mesh], *sizes: float) -> Patch:
    """The arrays of a mesh that a generator makes."""
    return Patch.of(generator(MPI.COMM_SELF, *sizes))


def shifted(x: float, y: float, z: float, turn: float = 0.0) -> Callable[[Array], Array]:
    """A turn about z [rad] and a shift [m] of points (3, n)."""
    c, s = math.cos(turn), math.sin(turn)
    R = np.array([(c, -s, 0), (s, c, 0), (0, 0, 1)])
    return lambda X: R @ X + np.array([[x], [y], [z]])


def constant(*velocity: float) -> Callable[[Array], Array]:
    """A velocity [m/s] that all points have."""
    return lambda X: np.outer(velocity, np.ones(X.shape[1]))


def flutter(X: Array) -> Array:
    """A spin of 10 rad/s about the middle of a sheet of 1 m², with an out-of-plane bump [m/s]."""
    bump = np.sin(np.pi * X[0]) * np.sin(np.pi * X[1])
    return np.vstack([-10 * (X[1] - 0.5), 10 * (X[0] - 0.5), bump])


def of_film(film: Pieces, *others: Any) -> Made:
    """A scene of one film and other parts."""
    return Made([*film.parts, *others], film.ports)


# ---- films ---------------------------------------------------------------------------------------


def wrinkling_film(at: Description) -> Made:
    """A free film that wrinkles and goes slack."""
    law = at.law(gx.Miyazaki, **FILM)
    return of_film(at.film(patch(crossed_sheet, 4, 4), law, velocity=flutter))


def film_of_order_two(at: Description) -> Made:
    law = at.law(gx.Miyazaki, **FILM)
    return of_film(at.film(patch(crossed_sheet, 2, 2), law, velocity=flutter, order=2))


def orthotropic_film(at: Description) -> Made:
    fabric = {"E1": 1e9, "E2": 1e8, "nu12": 0.3, "G12": 5e7, "density": 1400.0, "thickness": 1e-4}
    law = at.law(gx.Orthotropic, **fabric, direction=at.vector((1.0, 0.3, 0.0)))
    return of_film(at.film(patch(crossed_sheet, 4, 4), law, velocity=flutter))


def film_with_friction(at: Description) -> Made:
    """A fabric whose yarns slide on each other, in two branches."""
    fabric = {"E1": 1e8, "E2": 1e8, "nu12": 0.1, "G12": 5e6, "density": 1400.0, "thickness": 1e-4}
    law = at.law(gx.LinearOrthotropic, **fabric, direction=at.vector((1.0, 0.3, 0.0)))
    film = at.film(patch(crossed_sheet, 4, 4), law, velocity=flutter)
    friction = [
        gx.loads.InternalFriction(
            body,
            strain=(0.2, -0.5, 1.0),
            stiffness=(at(5e3, "N/m"), at(2e3, "N/m")),
            limit=(at(2.0, "N/m"), at(5.0, "N/m")),
            name=f"friction of {body.name}",
        )
        for body in film.bodies
    ]
    return of_film(film, *friction)


def heated_film(at: Description) -> Made:
    """A film that cools and is taut, more on one side."""

    def waves(X: Array, t: float) -> Array:
        return 293.15 - 100.0 * np.sin(40.0 * t) * (1 + X[0])

    thermal = gx.materials.ThermalExpansion(2e-5, at.scalar_in_time(waves))
    law = at.law(gx.Miyazaki, **FILM)
    film = at.film(patch(crossed_sheet, 4, 4), law, velocity=flutter, thermal=thermal)
    return of_film(film)


def reinforced_film(at: Description) -> Made:
    """A film with a tape along an edge."""
    film = at.film(
        patch(crossed_sheet, 4, 2, 0.5, 0.1), at.law(gx.Linear, **FILM), velocity=flutter
    )
    law = gx.CableLaw(EA=at(6000.0, "N"), line_density=at(0.01, "kg/m"))
    tapes = [
        gx.connectors.Tape.along_edges(body, law, edges="bottom", name=f"tape of {body.name}")
        for body in film.having("bottom")
    ]
    return of_film(film, *tapes)


def pulled_film(at: Description) -> Made:
    """Wrinkles in shear at rest: two edges are fixed, and one of them is moved along itself."""

    def moved(X: Array, t: float) -> Array:
        return np.vstack([0.002 + 0 * X[0], 0.01 + 0 * X[0], 0 * X[0]])

    film = at.film(patch(crossed_sheet, 4, 2, 0.5, 0.2), at.law(gx.Miyazaki, **FILM))
    supports = [gx.Fixed(body, "left") for body in film.having("left")]
    motion = at.field_in_time(moved, "m")
    supports += [gx.Fixed(body, "right", motion=motion) for body in film.having("right")]
    return of_film(film, *supports)


def inflated_tube(at: Description) -> Made:
    """A closed tube under pressure, at rest; one end is fixed."""
    mesh = patch(capped_cylinder, 0.1, 0.4, 8, 4)
    tube = at.film(mesh, at.law(gx.Linear, **FILM), name="tube")
    pressures = [gx.Pressure(b, at(5e3, "Pa"), name=f"in {b.name}") for b in tube.bodies]
    supports = [gx.Fixed(body, "first rim") for body in tube.having("first rim")]
    return of_film(tube, *pressures, *supports)


def spinning_disc(at: Description) -> Made:
    """A ring on a hub that turns."""
    mesh = patch(ring, 0.1, 0.5, 2, 12)
    disc = at.film(mesh, at.law(gx.Miyazaki, **FILM), name="disc")
    hub = at.rigid_body(0.5, (0.01, 0.01, 0.02), "hub")
    regions = [gx.RigidRegion(body, "hub", rigid_body=hub) for body in disc.having("hub")]
    spin = gx.RigidMotion(
        at.vector((1.0, 0.5, 20.0), "1/s"), centre=at.point((0.0, 0.0, 0.0)), name="spin"
    )
    ports = disc.ports | {"hub": hub.port(), "arm": hub.port((at(0.1, "m"), 0.0, 0.0))}
    return Made([*disc.parts, hub, *regions, spin], ports)


def reduced_film(at: Description) -> Made:
    """A film as a sum of shapes that a run of the film has shown."""
    law = at.law(gx.Miyazaki, **FILM)
    film = at.film(patch(crossed_sheet, 4, 4), law, velocity=flutter).whole
    shapes = gx.reduction.Snapshots(film, every=1)
    stepper = gx.Midpoint(dt=at(1e-3, "s"), tolerances=gx.Tolerances(relative=1e-13))
    run = gx.Simulation(gx.Scene(film), stepper, outputs=[shapes])
    run.run(until=at(6e-3, "s"))
    reduced = gx.reduction.reduce(film, [shapes], modes=3)
    corners = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)]
    ports = {str(corner): reduced.port_at(at.point(corner)) for corner in corners}
    return Made([reduced], ports)


# ---- what connects films -------------------------------------------------------------------------


def tied_films(at: Description) -> Made:
    """Two films of different meshes on one line, which turn about it."""
    law = at.law(gx.Linear, **SOFT)
    coarse = at.film(patch(crossed_sheet, 2, 2, 0.2, 0.1), law, "coarse", velocity=swing)
    placed = patch(crossed_sheet, 2, 3, 0.2, 0.1).placed(shifted(0.2, 0.0, 0.0))
    fine = at.film(placed, law, "fine", velocity=swing)
    (right,) = coarse.having("right")
    (left,) = fine.having("left")
    tie = gx.Tie(left, right, group_a="left", group_b="right")
    ports = named_ports(coarse=coarse, fine=fine)
    return Made([*coarse.parts, *fine.parts, tie], ports)


def swing(X: Array) -> Array:
    """A velocity [m/s] that bends a film along x."""
    return np.vstack([0 * X[0], 0.3 * X[0], 2.0 * X[0] ** 2])


def sewn_seam(at: Description) -> Made:
    """Two panels that are drawn together while the scene runs."""
    law = at.law(gx.Linear, **SOFT)
    left = at.film(patch(crossed_sheet, 2, 2, 0.2, 0.1), law, "left panel")
    placed = patch(crossed_sheet, 2, 2, 0.2, 0.1).placed(shifted(0.21, 0.0, 0.0))
    right = at.film(placed, law, "right panel")
    (a,) = left.having("right")
    (b,) = right.having("left")
    seam = gx.Seam(a, "right", b, "left", closing=(0.0, at(5e-3, "s")))
    ports = named_ports(left=left, right=right)
    return Made([*left.parts, *right.parts, seam], ports)


def crease(at: Description) -> Made:
    """A folded strip that is thrown and yields."""
    length = 0.05
    c, s = math.cos(0.7), math.sin(0.7)
    mesh = patch(creased_strip, 2, 2, length, 0.02)
    film = at.film(
        mesh,
        at.law(gx.Linear, E=2.5e9, nu=0.3, density=1400.0, thickness=50e-6),
        displacement=lambda X: np.stack([(c - 1) * X[0], 0 * X[1], s * abs(X[0])]),
        velocity=lambda X: np.stack([X[1] - 0.01, -X[0], 0.4 * np.sin(40 * X[0])]),
    )
    fold = gx.connectors.Crease(
        film.whole, "crease", stiffness=at(2e-3, "N"), rest_angle=1.0, yield_angle=0.3
    )
    return of_film(film, fold)


def plate(at: Description) -> Made:
    """A plate with a rest curvature and a hinge, whose clamp turns."""

    def direction(X: Array, t: float) -> Array:
        return np.stack([np.cos(30 * t) + 0 * X[0], 0 * X[0], np.sin(30 * t) + 0 * X[0]])

    film = at.film(
        patch(irregular_sheet, 4, 2, 0.3, 0.1),
        at.law(gx.Linear, E=1e9, nu=0.3, density=1000.0, thickness=1e-3),
        name="plate",
        kind=gx.Plate,
        rest_curvature=at.tensor(np.diag((1.0, 0.0, 0.0)), "1/m"),
        hinges=("middle",),
    )
    clamp = gx.Fixed(film.whole, "left", rotation=True, direction=at.field_in_time(direction, "1"))
    return of_film(film, clamp)


# ---- gas, contact --------------------------------------------------------------------------------


def gas_inlet(at: Description) -> Made:
    """A tube pressed flat that a tank fills."""
    law = at.law(gx.Miyazaki, E=2.5e9, nu=0.34, density=1420.0, thickness=25e-6)
    film = at.film(patch(flat_tube, 0.2, 0.058, 4), law, name="wall")
    gas = gx.IdealGas(gamma=1.4, R=at(296.8, "m²/s²"))
    tube = gx.Chamber(
        film.whole,
        gas=gas,
        pressure=at(1.0, "Pa"),
        temperature=293.0,
        dead_volume=at(1e-6, "m³"),
        name="tube",
    )
    tank = gx.Tank(at(20e-6, "m³"), gas=gas, pressure=at(1.5e6, "Pa"), temperature=293.0)
    valve = gx.Orifice(tank, tube, area=at(3e-8, "m²"), name="valve")
    return Made([*film.parts, tube, valve], film.ports, gas=("tube", "tank"))


def valve_with_inertia(at: Description) -> Made:
    """The same tube, which is filled through a valve whose plate swings."""
    made = gas_inlet(at)
    tube, orifice = made.parts[-2:]
    valve = own_part.module_of("A valve whose plate has inertia").PlateValve(
        orifice.a,
        tube,
        mass=at(1e-5, "kg"),
        spring=at(2e3, "N/m"),
        damping=at(0.02, "kg/s"),
        diameter=at(2e-3, "m"),
        speed=at(0.1, "m/s"),
    )
    return Made([*made.parts[:-1], valve], made.ports, gas=made.gas)


def films_in_contact(at: Description, friction: float = 0.0) -> Made:
    """A film that falls on another one."""
    law = at.law(gx.Miyazaki, **FILM)
    mesh = patch(sheet, 4, 4, 0.1, 0.1)
    lower = at.film(mesh, law, "lower")
    placed = mesh.placed(shifted(0.01, -0.005, 1.2e-3, turn=0.4))
    upper = at.film(placed, law, "upper", velocity=constant(0.2, 0.1, -2.0))
    contact = gx.Contact(
        *lower.bodies,
        *upper.bodies,
        distance=at(1e-3, "m"),
        friction=friction,
        slip_velocity=at(1e-3, "m/s"),
    )
    ports = named_ports(lower=lower, upper=upper)
    return Made([*lower.parts, *upper.parts, contact], ports)


def films_that_rub(at: Description) -> Made:
    return films_in_contact(at, friction=0.3)


def friction_on_an_obstacle(at: Description) -> Made:
    """A film that slides on a floor."""
    placed = patch(sheet, 4, 4, 0.1, 0.1).placed(shifted(0.0, 0.0, 1.2e-3, turn=0.3))
    film = at.film(placed, at.law(gx.Miyazaki, **FILM), velocity=constant(1.0, 0.4, -2.0))
    floor = gx.contact.Plane(
        point=at.point((0.0, 0.0, 0.0)), normal=at.vector((0.0, 0.05, 1.0)), friction=0.4
    )
    contact = gx.Contact(*film.bodies, floor, distance=at(1e-3, "m"), slip_velocity=at(1e-3, "m/s"))
    return of_film(film, contact)


# ---- cables, beams, rigid bodies -----------------------------------------------------------------


def cable_net(at: Description) -> Made:
    """Two pairs of taut cables that cross, at rest under their weight."""
    law = gx.TensionOnly(EA=at(1e4, "N"), line_density=at(0.05, "kg/m"))
    cables = []
    for k, y in enumerate((-0.2, 0.2)):
        along = [(-0.5, y, 0.0), (-0.2, y, 0.05), (0.5, y, 0.0)]
        across = [(y, -0.5, 0.0), (y, -0.2, 0.05), (y, 0.5, 0.1)]
        for points, name in ((along, f"along {k}"), (across, f"across {k}")):
            tension = at(50.0, "N")
            cables.append(at.cable(points, 2, law, name, initial_tension=tension))
    parts = [part for cable in cables for part in cable.parts]
    ports = {f"{k}, {name}": port for k, c in enumerate(cables) for name, port in c.ports.items()}
    ends = [gx.constraints.BallJoint(cables[0].ports["1"], cables[1].ports["1"], name="crossing")]
    for cable in cables:
        first, last = cable.bodies[0], cable.bodies[-1]
        ends += [gx.Fixed(first, "start"), gx.Fixed(last, "end")]
    weights = [
        gx.Gravity(body, at.vector((0.0, 0.0, -9.81), "m/s²"))
        for cable in cables
        for body in cable.bodies
    ]
    return Made([*parts, *ends, *weights], ports)


def boom(at: Description) -> Made:
    """A beam on a hub with sampled attitude control, a damper and weight."""
    section = gx.sections.solid_circle(
        at(0.01, "m"), E=at(1e9, "Pa"), nu=0.3, density=at(1500.0, "kg/m³")
    )
    points = [(0.0, 0.0, 0.0), (0.4, 0.0, 0.0), (1.0, 0.0, 0.0)]
    normal = at.vector((0.0, 0.0, 1.0))
    hub = at.rigid_body(1.0, (0.02, 0.03, 0.04), "hub")
    if at.transformation.is_split:
        first = gx.Beam(at.line(points[:2], 2), section, normal=normal, name="boom")
        last = gx.Beam(at.line(points[1:], 2), section, normal=normal, name="boom, second half")
        middle = first.port("end")
        fixed = gx.constraints.FixedJoint(first.frame("end"), last.frame("start"), name="middle")
        beams = [first, last]
        parts = [*beams, fixed]
    else:
        first = last = gx.Beam(at.line(points, 2), section, normal=normal, name="boom")
        middle = first.port("point 1")
        beams = parts = [first]
    control = gx.control.AttitudeControl(
        hub.frame(),
        (0.0, 0.0, 0.1),
        stiffness=at(2.0, "N m"),
        damping=at(0.3, "N m s"),
        axes=at.rotation,
        period=at(2.5e-3, "s"),
    )
    joint = gx.constraints.FixedJoint(first.frame("start"), hub.frame(), name="root")
    post = gx.Ground(at.point((1.0, 0.0, -1.0)))
    damper = gx.connectors.Damper(last.port("end"), post, damping=at(0.5, "kg/s"))
    weights = [gx.Gravity(beam, at.vector((0.0, 0.0, -9.81), "m/s²")) for beam in beams]
    ports = {"root": first.port("start"), "middle": middle, "tip": last.port("end")}
    return Made([*parts, hub, control, joint, damper, *weights], ports)


def rigid_body_with_joint(at: Description) -> Made:
    """A pendulum on a hinge that is inclined, with a ball on its end."""
    arm = at.rigid_body(2.0, (0.1, 0.2, 0.25), "arm", position=(0.5, 0.0, 0.0))
    ball = at.rigid_body(
        0.5, (0.01, 0.02, 0.03), "ball", position=(1.0, 0.0, 0.0), spin=(3.0, 1.0, 0.5)
    )
    axis = at.vector((0.0, 1.0, 0.4))
    hinge = gx.constraints.RevoluteJoint(
        arm.frame_at(at.point((0.0, 0.0, 0.0))),
        gx.ground_frame(at.point((0.0, 0.0, 0.0))),
        axis=axis,
    )
    end = at.point((1.0, 0.0, 0.0))
    joint = gx.constraints.BallJoint(arm.port_at(end), ball.port(), name="end")
    weights = [gx.Gravity(body, at.vector((0.0, 0.0, -9.81), "m/s²")) for body in (arm, ball)]
    ports = {"arm": arm.port(), "end": ball.port(), "side": ball.port((0.0, at(0.1, "m"), 0.0))}
    return Made([arm, ball, hinge, joint, *weights], ports)


def springs(at: Description) -> Made:
    """Three masses on a spring, a rope and a damper."""
    a = at.point_mass(1.0, (0.0, 0.0, 0.0), (0.0, 0.5, 0.0), "a")
    b = at.point_mass(0.5, (1.0, 0.0, 0.0), (0.0, -1.0, 0.3), "b")
    c = at.point_mass(0.7, (1.0, 0.8, 0.1), (0.4, 0.0, 0.2), "c")
    spring = gx.connectors.Spring(
        a.port(), b.port(), stiffness=at(200.0, "N/m"), length=at(0.9, "m")
    )
    rope = gx.connectors.Rope(
        b.port(), c.port(), stiffness=at(500.0, "N/m"), length=at(0.8, "m"), damping=at(1.0, "kg/s")
    )
    damper = gx.connectors.Damper(a.port(), c.port(), damping=at(2.0, "kg/s"))
    ports = {"a": a.port(), "b": b.port(), "c": c.port()}
    return Made([a, b, c, spring, rope, damper], ports)


def attitude(at: Description) -> Made:
    """A rigid body whose attitude is controlled as it moves."""
    body = at.rigid_body(3.0, (1.0, 1.5, 2.0), "satellite", spin=(0.1, 0.2, -0.1))
    control = gx.control.AttitudeControl(
        body.frame(),
        (0.1, -0.2, 0.3),
        stiffness=at(5.0, "N m"),
        damping=at(3.0, "N m s"),
        axes=at.rotation,
    )
    arms = {"x": (0.5, 0.0, 0.0), "y": (0.0, 0.5, 0.0)}
    ports = {name: body.port([at(x, "m") for x in arm]) for name, arm in arms.items()}
    return Made([body, control], ports)


def orbit(at: Description) -> Made:
    """Two masses on a spring in a low orbit, and a rigid body."""
    R = 7e6
    speed = math.sqrt(EARTH_MU / R)
    flight = gx.orbit.Orbit(
        (at.vector((R, 0.0, 0.0), "m"), at.vector((0.0, 0.8 * speed, 0.6 * speed), "m/s")),
        mu=at(EARTH_MU, "m³/s²"),
        radius=at(6.378137e6, "m"),
        following=at(1000.0, "s"),
        shadow="none",
    )
    a = at.point_mass(10.0, (-8.0, 2.0, 0.0), (0.0, -0.01, 0.0), "a")
    b = at.point_mass(10.0, (8.0, 0.0, 1.0), (0.0, 0.01, 0.0), "b")
    spring = gx.connectors.Spring(
        a.port(), b.port(), stiffness=at(10.0, "N/m"), length=at(16.0, "m")
    )
    body = at.rigid_body(
        20.0, (1.0, 2.0, 2.5), "body", position=(0.0, 5.0, 0.0), spin=(0.01, 0.02, 0.0)
    )
    ports = {"a": a.port(), "b": b.port(), "arm": body.port((at(1.0, "m"), 0.0, 0.0))}
    return Made([a, b, spring, body, flight], ports)


# ---- all of them ---------------------------------------------------------------------------------

NO_TRIANGLES = {"renumbered": "the nodes of lines are numbered along them"}
NO_FILM = {"split": "no body that could be cut", **NO_TRIANGLES}
WHOLE = {"split": "the film of a chamber is whole"}
NO_BENDING = {"split": "a tie carries no bending"}

KINDS = (
    Kind("wrinkling film", wrinkling_film, 1e-3, 6, 1e-9),
    Kind("film of order two", film_of_order_two, 1e-3, 6, 1e-9),
    Kind("orthotropic film", orthotropic_film, 1e-3, 6, 1e-9),
    Kind("film with friction", film_with_friction, 1e-3, 6, 1e-9),
    Kind("heated film", heated_film, 1e-3, 6, 1e-9),
    Kind("reinforced film", reinforced_film, 1e-3, 6, 1e-8),
    Kind("pulled film", pulled_film, 0.0, 0, 1e-7),
    Kind("inflated tube", inflated_tube, 0.0, 0, 1e-7),
    Kind(
        "spinning disc",
        spinning_disc,
        1e-3,
        6,
        1e-9,
        {"split": "the hub holds the nodes of the cut already"},
    ),
    Kind("reduced film", reduced_film, 1e-3, 6, 1e-9, {"split": "one body is reduced"}),
    Kind("tied films", tied_films, 1e-3, 6, 1e-9),
    Kind("sewn seam", sewn_seam, 1e-3, 6, 1e-9),
    Kind("crease", crease, 2e-4, 6, 1e-8, {"split": "the crease is the line of the cut"}),
    Kind("plate", plate, 1e-3, 4, 1e-8, NO_BENDING),
    Kind("gas inlet", gas_inlet, 1e-4, 6, 1e-9, WHOLE),
    Kind("valve with inertia", valve_with_inertia, 1e-4, 6, 1e-9, WHOLE),
    Kind("films in contact", films_in_contact, 1e-4, 6, 1e-8),
    Kind("films that rub", films_that_rub, 1e-4, 6, 1e-8),
    Kind("friction on an obstacle", friction_on_an_obstacle, 1e-4, 6, 1e-9),
    Kind("cable net", cable_net, 0.0, 0, 1e-7, NO_TRIANGLES),
    Kind("boom", boom, 1e-3, 6, 1e-9, NO_TRIANGLES),
    Kind("rigid body with joint", rigid_body_with_joint, 1e-2, 6, 1e-9, NO_FILM),
    Kind("springs", springs, 1e-2, 6, 1e-9, NO_FILM),
    Kind("controlled attitude", attitude, 5e-2, 6, 1e-9, NO_FILM),
    Kind("orbit", orbit, 5.0, 6, 1e-9, {**NO_FILM, "moved": "gravity differs there"}),
)
