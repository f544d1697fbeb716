"""The sail of IKAROS as it was built: devices where they are, reinforcing tapes, creases; flown by
sunlight for a day.

The demo `ikaros` spreads the mass of the devices evenly over a film without bending stiffness.
Here the sail is a `Plate` whose film bears no compression.  Where devices are bonded to it, it is
thicker, has nearly all of the mass, and has a natural curvature: a laminate of several layers
curls.  Tapes that only bear tension run along the edges and the seams of the trapezoids.  Creases
along all folds have a rest angle.

The steady spin is an equilibrium in axes that turn with the sail, with the pressure of sunlight
along the axis.  From its shape follow the flatness, the slack tethers, the spin that the angular
momentum of the flat sail leaves, and the windmill torque of sunlight: a device that is curved or
tilted turns a part of the pressure into the plane.

Then the sail flies round the Sun: the whole plate for some turns, and for a day a rigid body that
has the surfaces of the deformed sail, or with `flexible=86400` a reduced plate.

Where the values come from:
    7.5 µm polyimide; cells of 25 µm; 15 kg in all
                         sheets and press kit of the project; 14 kg in the four trapezoids as in
                         the demo `ikaros`
    devices along the outer edge steer, cells lie in the middle of each trapezoid
                         pictures of the project; sizes here are whole squares of 0.64 m, chosen
    natural curvature    not published: the study varies it
    tapes of 25 µm × 10 mm polyimide, creases
                         chosen: not published; the study varies them
    -2.7e-5 N m          windmill torque in June 2011, 1.03 au, from > 1 to 0.4 rpm in 21 days
                         (docs/measured.md)
    front with aluminium the optics of the demo `windmill`

    ./gossamer demo ikaros_devices
    ./gossamer study ikaros_devices
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import print_figures
from demos.common.figures import area_vectors, flat_triangles, triangles
from demos.common.flight_picture import FlightPicture
from demos.orbit.windmill import (
    DISTANCE,
    FLIGHT,
    OPTICS,
    PRESSURE_AT_AU,
    days_of_braking,
    round_the_sun,
    torque_of_light,
)
from demos.sails import ikaros
from gossamer_fx.extend import AU, Array, Output, Port, ReducedMembrane
from gossamer_fx.meshes.sails import trapezoids

PITCH = 0.64  # between folds, and side of the squares that are devices [m]
INNER = 2  # rows of the hole
OUTER = 11  # rows of the sail
RPM = ikaros.RPM
FILM = ikaros.FILM
FILM_DENSITY = 1420.0  # of polyimide [kg/m³]
# Row and columns of the cells of a trapezoid; with these they are 5 % of the sail.
CELL_ROW = 6
CELL_COLUMNS = 3
# The search for the steady spin.  Shapes that are found take 40 to 90 iterations.
SEARCH = gx.analysis.Continuation(tolerance=1e-4, total_iterations=300)
# Shapes of a reduced sail: shares of the pressure of sunlight, of which the first is the easiest to
# find and the last 1, and height of modes [m].
SHARES_OF_LIGHT = (1.0, 0.0, 2.0, -1.0, 1.0)
MODE_HEIGHT = 0.05
# Sun angles at the start and the end of the day [rad]: the axis of spin stays, the direction of the
# light turns with the motion round the Sun.
DAY = (math.radians(1.0), math.radians(1.94))
# A windmill torque below this is round-off [N m]: a thousandth of the smallest of the study.
SMALLEST_TORQUE = 1e-12
# Tethers whose tension is below this part of the mean count as slack.
SLACK_SHARE = 1e-3


@dataclass(frozen=True)
class Build:
    """How the sail is built.

    Args:
        tape: stiffness EA of the reinforcing tapes [N]; 0: no tapes.
        curvature: natural curvature of the devices [1/m], the same in all directions, away from the
            Sun.
        spread: standard deviation of the curvature of single devices over `curvature`.
        seed: of the random numbers of that spread.
        crease: stiffness of the creases [N m/m/rad]; 0: no creases.
        bends: whether film and devices resist bending; without it there is neither curvature nor
            crease.
        device: thickness of a device with the film on which it is [m].
        refine: cells between folds.

    Example:
        >>> Build(tape=0.0).curvature
        0.5
    """

    tape: float = 750.0
    curvature: float = 0.5
    spread: float = 0.3
    seed: int = 1
    crease: float = 1e-6
    bends: bool = True
    device: float = 32.5e-6
    refine: int = 1


BUILD = Build()
# Rest angle of a crease over the angle of the pressed fold: film that was folded for months.
SET_ANGLE_RATIO = 0.5


def device_numbers(X: Array) -> Array:
    """Number of the device (n,) at points X (3, n) [m] of the flat sail, from 1 on; 0 where there
    is film only."""
    # Along and outward in the frame of the trapezoid in which a point lies.
    quarter = np.round(np.arctan2(X[0], -X[1]) / (math.pi / 2))
    turn = quarter * math.pi / 2
    along = np.cos(turn) * X[0] + np.sin(turn) * X[1]
    outward = np.sin(turn) * X[0] - np.cos(turn) * X[1]
    column = np.floor(along / PITCH + 1e-9)
    row = np.floor(outward / PITCH + 1e-9)
    is_cell = (row == CELL_ROW) & (column >= -CELL_COLUMNS) & (column < CELL_COLUMNS)
    # Every second square along the outer edge steers; the triangles at its ends are not squares.
    # Counted from the middle to both sides: a sail with a mirror plane has no windmill torque.
    from_middle = np.maximum(column, -1 - column)
    is_square = from_middle < OUTER - 1
    steers = (row == OUTER - 1) & is_square & (np.remainder(from_middle, 2) == 0)
    number = 1 + (column + OUTER) + 2 * OUTER * (row + OUTER * np.remainder(quarter, 4))
    return np.where(is_cell | steers, number, 0.0)


def device_squares() -> int:
    """Number of squares that are devices."""
    steering_on_a_side = len(range(0, OUTER - 1, 2))
    return 4 * 2 * (CELL_COLUMNS + steering_on_a_side)


def device_weight() -> float:
    """Mass [kg/m²] of a device, with the film on which it is."""
    area = 4 * (OUTER**2 - INNER**2) * PITCH**2
    film_weight = FILM_DENSITY * FILM["thickness"]
    devices = device_squares() * PITCH**2
    return (ikaros.PETALS - film_weight * area) / devices + film_weight


def curvature_at(build: Build) -> Any:
    """Natural curvature (3, 3, n) [1/m] as a function of points X (3, n)."""
    random = np.random.default_rng(build.seed)
    factors = 1 + build.spread * random.normal(size=8 * OUTER**2 + 2)

    def curvature(X: Array) -> Array:
        number = device_numbers(X).astype(int)
        κ = np.where(number > 0, build.curvature * factors[number], 0.0)
        in_plane = np.diag([1.0, 1.0, 0.0])
        return in_plane[:, :, None] * κ

    return curvature


def folds() -> gx.fold.Ikaros:
    """The fold, whose lines are the creases of the sail."""
    _, _, bends = ikaros.rows(PITCH)
    return gx.fold.Ikaros(n=4, inner=INNER, outer=OUTER, pitch=PITCH, bends=bends)


def sail(comm: MPI.Comm, build: Build) -> gx.Membrane:
    """The four trapezoids with their devices.

    Those have all of the mass of the trapezoids that the film has not.
    """
    device_density = device_weight() / build.device
    properties = {
        "thickness": lambda X: np.where(device_numbers(X) > 0, build.device, FILM["thickness"]),
        "density": lambda X: np.where(device_numbers(X) > 0, device_density, FILM_DENSITY),
    }
    law = gx.Miyazaki(**FILM, density=FILM_DENSITY, residual_stiffness=1e-6)
    mesh = trapezoids(comm, 4, INNER, OUTER, PITCH, build.refine)
    # A film without bending stiffness costs a twentieth: it has a quarter of the unknowns.
    if not build.bends:
        return gx.Membrane(mesh, law, properties=properties, name="sail")
    hinges: list[str] = []
    if build.crease:
        mesh = folds().mark(mesh)
        hinges = [line.name for line in folds().lines(mesh)]
    # Without a natural curvature the plate has no cubic energy.
    rest_curvature = curvature_at(build) if build.curvature else None
    return gx.Plate(
        mesh, law, hinges=hinges, rest_curvature=rest_curvature, properties=properties, name="sail"
    )


def parts(film: gx.Membrane, build: Build) -> tuple[gx.RigidBody, list[Any]]:
    """The hub, and what is with the sail: masses at the tips, tethers, tapes and creases."""
    hub = ikaros.hub_body(film.comm)
    items: list[Any] = [*ikaros.tip_masses(film)]
    items.append(ikaros.tethers(film, hub, PITCH, ikaros.HUB_RADIUS))
    items += ikaros.tapes(film, PITCH, build.tape, build.refine)
    if build.crease and build.bends:
        items += folds().creases(film, stiffness=build.crease, set_angle_ratio=SET_ANGLE_RATIO)
    return hub, items


def sun_pressure(distance: float = DISTANCE, sun_angle: float = 0.0) -> float:
    """Pressure of sunlight at a distance from the Sun [au]: force across a flat sail over its area
    [Pa], with the light at `sun_angle` [rad] to the normal of the sail."""
    mirrored, diffuse, along_light = OPTICS.coefficients()
    cosine = math.cos(sun_angle)
    return PRESSURE_AT_AU / distance**2 * cosine * (diffuse + (mirrored + along_light) * cosine)


def steady(comm: MPI.Comm, build: Build, rpm: float, sunlit: bool = True) -> gx.Equilibrium:
    """Equilibrium of the open sail in axes that turn with a spin [rpm]; the hub is held in them."""
    pressure = sun_pressure() if sunlit else 0.0
    search = spinning_sail(sail(comm, build), build, rpm, pressure, SEARCH)
    search.find()
    return search


def spinning_sail(
    film: gx.Membrane,
    build: Build,
    rpm: float,
    pressure: float | Callable[[float], float],
    method: gx.analysis.Continuation,
) -> gx.Equilibrium:
    """The open sail in axes that turn with a spin [rpm], before the search for its equilibrium.

    Args:
        film: the sail, or a reduced one.
        pressure: of sunlight [Pa]; a number, 0 for none, or a function of the time that is given
            to `find`.
        method: how the equilibrium is searched.
    """
    hub, items = parts(film, build)
    items.append(gx.loads.Centrifugal(film, (0.0, 0.0, rpm * RPM)))
    items.append(gx.constraints.FixedJoint(hub.frame(), gx.ground_frame()))
    if pressure:
        items.append(gx.Pressure(film, pressure, name="sunlight"))
    return gx.Equilibrium(gx.Scene(film, hub, *items), method)


def change_over_a_day(
    comm: MPI.Comm,
    build: Build,
    rpm: float,
    sun_angles: tuple[float, float] = DAY,
) -> dict[str, float]:
    """How much the shape of the sail changes while its sun angle does: the error of a flight of
    its frozen shape.  Collective.

    Both shapes are equilibria: a day is thousands of periods of the sail.  What light does once a
    turn, because it comes from the side, is in `fly_plate`.

    Args:
        sun_angles: between the light and the axis of spin at the start and at the end [rad].

    Returns:
        pressure change: of sunlight across the sail, relative.
        shape change: root of the mean square of the change of height over that of the height.
        torque change: of the windmill torque, relative; nan without a torque.
        light over spin: force of sunlight on the sail over the sum of the centrifugal forces of
            its mass.
    """

    def pressure(angle: float) -> float:
        """Pressure [Pa]; the time of a search is the sun angle [rad]."""
        return sun_pressure(sun_angle=angle)

    # The change is a thousandth, which the usual tolerance of 1e-4 would not resolve.
    method = replace(SEARCH, tolerance=1e-6)
    search = spinning_sail(sail(comm, build), build, rpm, pressure, method)
    film = sail_of(search)
    heights = []
    torques = []
    for angle in sun_angles:
        search.find(at=angle)
        corners = triangles(search.system, film)
        heights.append(corners[:, :, 2].mean(axis=1))
        torques.append(torque_of_light(comm, corners))
    areas = np.linalg.norm(area_vectors(corners), axis=1)
    of_mass = masses(film) * np.linalg.norm(corners.mean(axis=1)[:, :2], axis=1)
    centrifugal = comm.allreduce(float(of_mass.sum())) * (rpm * RPM) ** 2
    first = pressure(sun_angles[0])
    last = pressure(sun_angles[1])
    shape_change = rms(comm, heights[1] - heights[0], areas) / rms(comm, heights[0], areas)
    # A sail with mirror planes has a torque of round-off.
    torque_change = math.nan
    if abs(torques[0]) > SMALLEST_TORQUE:
        torque_change = torques[1] / torques[0] - 1
    return {
        "pressure change": last / first - 1,
        "shape change": shape_change,
        "torque change": torque_change,
        "light over spin": first * comm.allreduce(float(areas.sum())) / centrifugal,
    }


def masses(film: gx.Membrane) -> Array:
    """Masses (n,) [kg] of the triangles of this rank, with their devices."""
    flat = flat_triangles(film)
    area = np.linalg.norm(area_vectors(flat), axis=1)
    is_device = device_numbers(flat.mean(axis=1).T) > 0
    return np.where(is_device, device_weight(), FILM_DENSITY * FILM["thickness"]) * area


def inertia(comm: MPI.Comm, corners: Array, mass: Array) -> float:
    """Moment of inertia [kg m²] about z of triangles (n, 3, 3) with masses (n,), and of the masses
    at the tips."""
    xy = corners[:, :, :2]
    # ∫ x² of a triangle is its mass times (Σ x_k² + (Σ x_k)²)/12.
    of_corners = (xy**2).sum(axis=(1, 2))
    of_sums = (xy.sum(axis=1) ** 2).sum(axis=1)
    squares = of_corners + of_sums
    of_film = comm.allreduce(float(mass @ squares) / 12)
    radius = np.linalg.norm(xy, axis=2).max(initial=0.0)
    of_tips = 4 * ikaros.TIP * comm.allreduce(float(radius), op=MPI.MAX) ** 2
    return of_film + of_tips


def rms_height(comm: MPI.Comm, corners: Array) -> float:
    """Root of the mean square of z [m] about its mean, of triangles (n, 3, 3) by area."""
    areas = np.linalg.norm(area_vectors(corners), axis=1)
    return rms(comm, corners[:, :, 2].mean(axis=1), areas)


def rms(comm: MPI.Comm, values: Array, areas: Array) -> float:
    """Root of the mean square of values (n,) about their mean, by the areas (n,) of triangles of
    this rank."""
    sums = np.array([areas.sum(), areas @ values, areas @ values**2])
    area, first, second = comm.allreduce(sums)
    # Round-off of a flat sail may be negative.
    return math.sqrt(max(second / area - (first / area) ** 2, 0.0))


def sail_of(search: gx.Equilibrium) -> Any:
    """The film of a steady spin."""
    return next(body for body in search.system.unknowns.bodies if body.name == "sail")


def figures(search: gx.Equilibrium) -> dict[str, float]:
    """What a designer asks of a steady spin.  Collective.

    Returns:
        rms height: of the sail over its mean plane [mm].
        warp: mean height of the tips over that of the inner edge [mm].
        rms tilt: of the triangles against the mean plane [mrad].
        taut: part of the area.
        slack tethers: of 16.
        J: moment of inertia of sail and tips [kg m²].
        spin change: relative, against the flat sail with the same angular momentum, hub included.
        torque: windmill torque of sunlight [N m].
        iterations, residual, unknowns, seconds: of the search; compilation is not counted.
    """
    system = search.system
    film = sail_of(search)
    comm = film.comm
    corners = triangles(system, film)
    flat = flat_triangles(film)
    areas = area_vectors(corners)
    size = np.linalg.norm(areas, axis=1)
    # Squared sines of the angles between the normals and the axis.
    tilts = 1 - (areas[:, 2] / size) ** 2
    area, tilted = comm.allreduce(np.array([size.sum(), size @ tilts]))
    # Tips and inner corners, on all ranks.
    ends = [film.port(f"tip {k}") for k in range(4)]
    inner = [
        film.port_at((sx * INNER * PITCH, sy * INNER * PITCH, 0.0))
        for sx in (-1, 1)
        for sy in (-1, 1)
    ]
    height_of_tips = system.unknowns.state.vectors(ends)[:, 2].mean()
    height_of_inner_edge = system.unknowns.state.vectors(inner)[:, 2].mean()
    mass = masses(film)
    J = inertia(comm, corners, mass)
    flat_J = inertia(comm, flat, mass)
    hub = ikaros.HUB_INERTIA[2]
    assert search.result is not None
    return {
        "rms height": 1e3 * rms_height(comm, corners),
        "warp": 1e3 * float(height_of_tips - height_of_inner_edge),
        "rms tilt": 1e3 * math.sqrt(tilted / area),
        "taut": gx.probes.AreaFraction(film, "taut")(search),
        "slack tethers": slack_tethers(search),
        "J": J,
        "spin change": (hub + flat_J) / (hub + J) - 1,
        "torque": torque_of_light(comm, corners),
        "iterations": search.result.iterations,
        "residual": search.result.residual,
        "unknowns": system.unknowns.numbering.size,
        "seconds": search.result.seconds,
    }


def slack_tethers(search: gx.Equilibrium) -> int:
    """Number of tethers without tension."""
    ropes = next(item for item in search.scene.items if isinstance(item, gx.connectors.RopeBundle))
    stretches = []
    for pair, length in zip(ropes.ends, ropes.lengths, strict=True):
        a, b = search.system.unknowns.state.vectors(pair)
        stretches.append(max(float(np.linalg.norm(a - b)) - length, 0.0))
    return int(np.sum(np.array(stretches) <= SLACK_SHARE * np.mean(stretches)))


def orbit_of_flight(sun_angle: float) -> gx.orbit.Orbit:
    """Round the Sun at the distance of June 2011; at the start light travels at `sun_angle` [rad]
    to z."""
    return round_the_sun(
        gx.orbit.Elements(DISTANCE * AU, i=math.pi / 2, perigee=math.pi / 2 + sun_angle)
    )


def torque_probe(orbit: gx.orbit.Orbit) -> Any:
    """The torque of sunlight about z [N m], from which the axis of spin hardly turns."""
    return gx.probes.LoadResultant(orbit, "sunlight", action="torque", axis="z")


def fly_plate(
    search: gx.Equilibrium,
    build: Build,
    rpm: float,
    sun_angle: float,
    turns: float,
    steps: int,
    outputs: Sequence[Output] = (),
) -> dict[str, float]:
    """Fly the whole or reduced sail from its steady spin, `steps` steps a turn.

    Returns:
        torque: mean windmill torque of sunlight [N m] over the flight.
        rms height: of the sail at the end [mm]
        energy_error, iterations per step, rejected steps, seconds; and of a reduced sail
        spin change: by the angular momentum along its direction at the start [rpm].
        drift of the axis: angle between the angular momentum at the start and the end [rad].
        outside: energy outside of the basis over the stored energy, `OutsideBasis`.
    """
    film = sail_of(search)
    hub, items = parts(film, build)
    orbit = orbit_of_flight(sun_angle)
    light = gx.orbit.SolarPressure(film, orbit, optics=OPTICS, name="sunlight")
    items += [orbit, light, gx.StartFrom(search.system)]
    items.append(gx.RigidMotion(spin=(0.0, 0.0, rpm * RPM)))
    period = 60 / rpm
    series = gx.Series({"torque": torque_probe(orbit)})
    run = gx.Simulation(
        gx.Scene(film, hub, *items), gx.Midpoint(dt=period / steps), outputs=[series, *outputs]
    )
    of_reduced: dict[str, float] = {}
    if isinstance(film, ReducedMembrane):
        before = momentum_of_reduced(run, film, hub)
        run.run(until=turns * period)
        size, turned = change_of(before, momentum_of_reduced(run, film, hub))
        of_reduced = {
            "spin change": size / moments(search)[1] / RPM,
            "drift of the axis": turned,
            "outside": gx.reduction.OutsideBasis(film)(run),
        }
    run.run(until=turns * period)
    corners = triangles(run.system, film)
    return {
        **of_reduced,
        # The first value is of no step.
        "torque": float(series["torque"][1:].mean()),
        "rms height": 1e3 * rms_height(film.comm, corners),
        "energy_error": abs(run.energy_error),
        "iterations": run.iterations / run.step,
        "rejected": run.substeps,
        "seconds": run.seconds,
    }


def reduced_steady(
    comm: MPI.Comm, build: Build, rpm: float, modes: int, cells: int | None
) -> gx.Equilibrium:
    """The steady spin of a reduced sail, of which nothing has flown: its shapes are steady spins
    under several pressures of sunlight, and the lowest `modes` modes of vibration about that in
    sunlight.  It has `cells` cells with strains, None for all."""
    film = sail(comm, build)
    pressure = sun_pressure()
    search = spinning_sail(film, build, rpm, lambda share: share * pressure, SEARCH)
    shapes = gx.reduction.Snapshots(film)
    for share in SHARES_OF_LIGHT:
        search.find(at=share)
        shapes.positions.append(search.system.unknowns.state[film].positions().copy())
    found = gx.analysis.modes(search, modes, spin=(0.0, 0.0, rpm * RPM))
    swinging = gx.analysis.ModeShapes(film, search, modes=found, height=MODE_HEIGHT)
    # The mean of the shapes is nearly the plane one, which is in every basis.
    count = len(set(SHARES_OF_LIGHT)) - 1 + modes
    reduced = gx.reduction.reduce(film, [shapes, swinging], modes=count, cells=cells)
    steady_spin = spinning_sail(reduced, build, rpm, pressure, SEARCH)
    steady_spin.find()
    return steady_spin


def momentum_of_reduced(run: gx.Simulation, film: ReducedMembrane, hub: gx.RigidBody) -> Array:
    """Angular momentum (3,) [N m s] of hub, reduced sail and tips about their centre of mass; that
    of the whole run has the orbit's in it."""
    # The coefficients of the modes are as points with the mass of the sail; only the first, that of
    # uniform displacement, has a momentum.
    size = film.basis.size
    coefficients = [Port(film, (0,), weights=(1.0,), vectors=(k,)) for k in range(size)]
    points = [*coefficients, *ikaros.tip_ports(film), hub.port()]
    mass = np.array([film.basis.mass] * size + [ikaros.TIP] * 4 + [ikaros.HUB_MASS])
    moved = mass.copy()
    moved[1:size] = 0.0
    state = run.system.unknowns.state
    x = state.vectors(points)
    v = state.rates(points)
    momentum: Array = np.cross(x, mass[:, None] * v).sum(axis=0)
    momentum -= np.cross(moved @ x, moved @ v) / moved.sum()
    return momentum + angular_momentum(
        run, hub.frame(), ikaros.HUB_INERTIA[0], ikaros.HUB_INERTIA[2]
    )


def change_of(before: Array, after: Array) -> tuple[float, float]:
    """Change of the length of a vector (3,), and the angle [rad] by which it has turned."""
    size_before = float(np.linalg.norm(before))
    size_after = float(np.linalg.norm(after))
    sine = float(np.linalg.norm(np.cross(before, after)))
    return size_after - size_before, math.atan2(sine, float(before @ after))


def moments(search: gx.Equilibrium) -> tuple[float, float]:
    """Moments of inertia [kg m²] of hub and sail about a line in the plane of the sail, and about
    the axis."""
    film = sail_of(search)
    own = triangles(search.system, film)
    J = inertia(film.comm, own, masses(film))
    # A flat body has half of the moment about its axis about a line in its plane.
    return ikaros.HUB_INERTIA[0] + J / 2, ikaros.HUB_INERTIA[2] + J


def frozen(search: gx.Equilibrium, rpm: float) -> tuple[gx.RigidBody, list[Any]]:
    """Hub and sail as one rigid body in the shape of a steady spin, and its surfaces.  Collective.

    Its products of inertia are left out: a thousandth of the moments.
    """
    film = sail_of(search)
    comm = film.comm
    own = triangles(search.system, film)
    corners = np.concatenate(comm.allgather(own))
    about_diameter, about_axis = moments(search)
    surfaces = [
        gx.orbit.Surface(
            float(np.linalg.norm(area)),
            tuple(area),
            centre=tuple(triangle.mean(axis=0)),
            optics=OPTICS,
            two_sided=True,
        )
        for triangle, area in zip(corners, area_vectors(corners), strict=True)
    ]
    body = gx.RigidBody(
        ikaros.HUB_MASS + ikaros.PETALS + 4 * ikaros.TIP,
        (about_diameter, about_diameter, about_axis),
        spin=(0.0, 0.0, rpm * RPM),
        comm=comm,
        name="hub and sail",
    )
    return body, surfaces


def fly_frozen(
    search: gx.Equilibrium,
    rpm: float,
    sun_angle: float,
    until: float,
    dt: float,
    output: str | Path | None = None,
) -> dict[str, float]:
    """Fly hub and sail as a rigid body with the surfaces of the deformed sail, until a time [s].

    Returns:
        torque: mean windmill torque [N m].
        spin change: [rpm].
        days from 1 to 0.4 rpm: by this torque; in flight 21.
        drift of the axis: angle between the axis of spin at start and end [rad].
        sun angle: at the end [rad].
        torque across: mean torque that turns the axis [N m].
        energy_error, seconds.
    """
    body, surfaces = frozen(search, rpm)
    orbit = orbit_of_flight(sun_angle)
    light = gx.orbit.SolarPressure(body, orbit, surfaces=surfaces, name="sunlight")
    frame = body.frame()
    # The front of the mesh, along z, is the side away from the Sun.
    to_sun = gx.probes.SunAngle(orbit, frame.directors[2])
    probes = {
        "sun angle [rad]": lambda run: math.pi - to_sun(run),
        "torque about the axis [N m]": torque_probe(orbit),
    }
    series = gx.Series(probes)
    outputs: list[Any] = [gx.outputs.Progress(), series]
    if output is not None:
        path = Path(output) / "ikaros_devices.png"
        title = "IKAROS as built: a day in sunlight"
        outputs.append(FlightPicture(path, orbit, probes=probes, title=title))
    run = gx.Simulation(gx.Scene(light), gx.Midpoint(dt=dt), outputs=outputs)
    about_diameter, about_axis = moments(search)
    before = angular_momentum(run, frame, about_diameter, about_axis)
    run.run(until=until)
    after = angular_momentum(run, frame, about_diameter, about_axis)
    change, turned = change_of(before, after)
    torque = change / run.time
    return {
        "torque": torque,
        "mean torque of the probe": float(series["torque about the axis [N m]"][1:].mean()),
        "spin change": torque * run.time / about_axis / RPM,
        "days from 1 to 0.4 rpm": days_of_braking(torque, about_axis),
        "drift of the axis": turned,
        "sun angle": probes["sun angle [rad]"](run),
        "energy_error": abs(run.energy_error),
        "seconds": run.seconds,
    }


def angular_momentum(
    run: gx.Simulation, frame: Any, about_diameter: float, about_axis: float
) -> Array:
    """Angular momentum (3,) [N m s] of a rigid body with an axis of symmetry about its centre of
    mass.

    That of the whole run has the orbit's in it, which is 1e13 times as large.
    """
    directors = run.system.unknowns.state.vectors(frame.directors)
    rates = run.system.unknowns.state.rates(frame.directors)
    # ω = ½ Σ d_k × d_k'
    spin = np.cross(directors, rates).sum(axis=0) / 2
    along = float(spin @ directors[2])
    momentum: Array = about_diameter * spin
    return momentum + (about_axis - about_diameter) * along * directors[2]


def main(
    build: Build = BUILD,
    rpm: float = 1.0,
    sun_angle: float = math.radians(1.0),
    turns: float = 1.0,
    steps: int = 30,
    until: float = 86400.0,
    dt: float = 10.0,
    flexible: float = 0.0,
    modes: int = 10,
    cells: int | None = None,
    output: str | Path | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> dict[str, float]:
    """Find the steady spin, fly the whole sail for some turns, 0 for none, and its frozen shape
    until a time [s]; and a reduced sail, which bends and swings, until the time `flexible` [s].

    The reduced sail has `modes` modes of vibration, and strains in `cells` cells, None for all.
    Tapes and creases have to be left out of its build: `tape=0`, `crease=0`.

    With the default step the frozen sail turns by 60° in each: the mean of its faces over a step is
    shorter by cos 30°, and so the torque of sunlight is 21 % too small; steps of 2 s, 12°, leave 1
    %.

    With `output`, a folder: a picture.  Returns `figures`, and with prefixes those of `fly_plate`,
    `fly_frozen` and `change_over_a_day`.
    """
    search = steady(comm, build, rpm)
    found = figures(search)
    whole: dict[str, float] = {}
    if turns:
        whole = fly_plate(search, build, rpm, sun_angle, turns, steps)
    rigid = fly_frozen(search, rpm, sun_angle, until, dt, output)
    found |= {f"whole sail: {name}": value for name, value in whole.items()}
    found |= {f"rigid sail: {name}": value for name, value in rigid.items()}
    if flexible:
        reduced = reduced_steady(comm, build, rpm, modes, cells)
        flown = fly_plate(reduced, build, rpm, sun_angle, flexible * rpm / 60, steps)
        found |= {f"reduced sail: {name}": value for name, value in flown.items()}
    day = change_over_a_day(comm, build, rpm)
    found |= {f"over the day: {name}": value for name, value in day.items()}
    found["torque over the flight's"] = found["torque"] / FLIGHT
    return found


if __name__ == "__main__":
    print_figures(main(output="out"))
