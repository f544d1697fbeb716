"""Sunlight, drag and magnetic torque on films and rigid bodies in flight."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.extend import InitialState
from gossamer_fx.mechanics.orbit.drag import Drag, ExponentialAtmosphere
from gossamer_fx.mechanics.orbit.flying_loads import _ByComplexSteps, axes_of
from gossamer_fx.mechanics.orbit.magnetic_dipole import MagneticDipole
from gossamer_fx.mechanics.orbit.optics import (
    JPL_SAIL,
    MIRROR,
    PRESSURE,
    Accommodation,
    Air,
    Arrays,
    Optics,
    Surface,
    flow_force,
    light_force,
)
from gossamer_fx.mechanics.orbit.shadow_map import lit_fractions
from gossamer_fx.mechanics.orbit.solar_pressure import SolarPressure
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.meshes.sphere import sphere
from tests.orbit.test_flight import drift
from tests.small_scenes import run_until

A = 7e6
LAW = {"E": 2.5e9, "nu": 0.3, "density": 1400.0, "thickness": 7.5e-6}
# Density [kg/m³] at the height of the orbit, and the height over which it falls by e [m].
AIR = ExponentialAtmosphere(density=1e-11, altitude=A - 6378137.0, scale_height=6e4)


def film(tilt: float, order: int = 1) -> gx.Membrane:
    """A square of 1 m² in the x-y plane, turned about y."""
    c = math.cos(tilt)
    s = math.sin(tilt)

    def turn(X: np.ndarray) -> np.ndarray:
        return np.array([c * X[0] + s * X[2], X[1], -s * X[0] + c * X[2]]) - X

    return gx.Membrane(
        sheet(MPI.COMM_WORLD, 2, 2),
        gx.Miyazaki(**LAW),
        order=order,
        displacement=turn,
    )


def plate(tilt: float, optics: Optics = MIRROR) -> tuple[gx.RigidBody, Surface]:
    """The same square as a rigid body."""
    c = math.cos(tilt)
    s = math.sin(tilt)
    body = gx.RigidBody(
        1.05e-2,
        (1e-3, 1e-3, 2e-3),
        attitude=((c, 0, s), (0, 1, 0), (-s, 0, c)),
        name="plate",
    )
    return body, Surface(1.0, (0, 0, 1), optics=optics, two_sided=True)


def pushed(run: gx.Simulation, name: str) -> np.ndarray:
    """Force and torque about the origin (2, 3) of a load in the last step."""
    found = [
        kind.resultants().get(name, np.zeros((2, 3))) for kind in run.system.equations.compiled
    ]
    return np.asarray(run.comm.allreduce(sum(found)))


def one_step(*items: object, dt: float = 1e-3) -> gx.Simulation:
    return run_until(dt, *items, dt=dt)


@pytest.mark.mpi(1)
@pytest.mark.parametrize("degrees", [0.0, 30.0, 60.0, 150.0])
def test_sunlight_on_film_and_plate(degrees: float) -> None:
    """Along and across the normal as McInnes' formulas, on a film and on a rigid plate, also lit
    from the back."""
    tilt = math.radians(degrees)
    orbit = Orbit(sun=(0, 0, 1))
    body, surface = plate(tilt, JPL_SAIL)
    flat = film(tilt)
    run = one_step(
        SolarPressure(flat, orbit, optics=JPL_SAIL, name="on film"),
        SolarPressure(body, orbit, surfaces=[surface], name="on plate"),
    )
    normal = np.array([math.sin(tilt), 0, math.cos(tilt)])
    lit_from_front = normal[2] > 0
    away = -normal if lit_from_front else normal
    u, P = orbit.flight(run.system.unknowns).light()
    assert np.allclose(u, [0, 0, -1], atol=1e-4)  # 7000 km of an astronomical unit
    assert pytest.approx(P, rel=1e-4) == PRESSURE
    c = float(away @ u)
    mirrored, both, along = JPL_SAIL.coefficients(back=not lit_from_front)
    known = P * c * ((mirrored * c + both) * away + along * u)
    for name in ("on film", "on plate"):
        force = pushed(run, name)[0]
        # One step of a stiff film: it stays flat.
        assert np.allclose(force, known, rtol=1e-8, atol=1e-14)
    assert abs(run.energy_error) < 1e-10


def Orbit(**options: object) -> gx.orbit.Orbit:
    return gx.orbit.Orbit(gx.orbit.Elements(A), shadow=options.pop("shadow", "none"), **options)


@pytest.mark.mpi
def test_groups_have_their_own_optics() -> None:
    orbit = Orbit(sun=(0, 0, 1))
    flat = film(0.0)
    cells = np.arange(flat.mesh.domain.topology.index_map(2).size_local, dtype=np.int32)
    flat.mesh.groups["all"] = (2, cells)
    black = Optics(reflectivity=0.0)
    run = one_step(SolarPressure(flat, orbit, optics=MIRROR, groups={"all": black}, name="light"))
    assert np.allclose(pushed(run, "light")[0], [0, 0, -PRESSURE], rtol=1e-4, atol=1e-4 * PRESSURE)


def test_shadow_takes_the_light() -> None:
    for sun, lit in (((1, 0, 0), 1.0), ((-1, 0, 0), 0.0)):
        body, surface = plate(math.pi / 2)
        run = one_step(
            SolarPressure(body, Orbit(sun=sun, shadow="cylinder"), surfaces=[surface], name="light")
        )
        measured = np.linalg.norm(pushed(run, "light")[0])
        # An edge-on orbit: the mirror is lit in full or not at all.
        assert measured == pytest.approx(2 * PRESSURE * lit, rel=2e-4)


def test_eclipse_begins_at_its_time() -> None:
    """A step ends where the shadow begins; the angle of the orbit there is known."""
    orbit = gx.orbit.Orbit(gx.orbit.Elements(A, anomaly=1.8), sun=(1, 0, 0))
    body = gx.PointMass(10.0)

    def depth(run: gx.Simulation) -> float:
        flight = orbit.flight(run.system.unknowns)
        return orbit.depth(flight.origin.R0, run.time)

    enters = gx.When(depth, stop=True, tolerance=1e-4)
    run = run_until(2000.0, body, orbit, dt=10.0, events=[enters])
    # The shadow of a cylinder begins where the distance from its axis is the Earth's radius.
    angle = math.pi - math.asin(orbit.radius / A)
    n = math.sqrt(orbit.mu / A**3)
    assert run.time == pytest.approx((angle - 1.8) / n, rel=1e-5)


@pytest.mark.parametrize("order", [1, 2])
def test_drag_on_film_and_plate(order: int) -> None:
    """A film and a plate of the same attitude have the same drag, by the formula."""
    orbit = Orbit()
    tilt = 0.7
    how = Accommodation(0.9, 0.8)
    body, surface = plate(tilt)
    flat = film(tilt, order)
    run = one_step(
        Drag(flat, orbit, atmosphere=AIR, accommodation=how, name="on film"),
        Drag(body, orbit, atmosphere=AIR, accommodation=how, surfaces=[surface], name="on plate"),
    )
    on_film, on_plate = (pushed(run, name)[0] for name in ("on film", "on plate"))
    flight = orbit.flight(run.system.unknowns)
    # The air turns with the Earth, 7.29e-5 rad/s.
    U = np.cross([0, 0, 7.292115e-5], flight.R) - flight.V
    air = AIR(A - orbit.radius)
    a = np.array([math.sin(tilt), 0, math.cos(tilt)])
    wall = math.sqrt(300 / air.temperature)
    known = air.density * flow_force(a, U, air.thermal_speed, 0.9, 0.8, wall, 1.0, Arrays)
    # The formula for one flat plate.
    assert np.allclose(on_plate, known, rtol=1e-6)
    assert np.allclose(on_film, known, rtol=1e-6)
    assert abs(run.energy_error) < 1e-10


@pytest.mark.mpi
def test_drag_on_a_closed_film_is_that_of_a_sphere() -> None:
    """Diffuse flow on a sphere (Schaaf & Chambre 1961), at a low and a high speed ratio; second
    order in the cells."""
    for molecule in (1e-28, 2.6566962e-26):
        errors = []
        for cells in (8, 16):
            ball = gx.Membrane(sphere(MPI.COMM_WORLD, 1.0, cells), gx.Miyazaki(**LAW))
            orbit = Orbit()

            def air_at(altitude: float, molecule: float = molecule) -> Air:
                return Air(1e-11, 1000.0, molecule=molecule)

            run = one_step(Drag(ball, orbit, atmosphere=air_at, closed=True, name="drag"))
            flight = orbit.flight(run.system.unknowns)
            U = np.cross([0, 0, 7.292115e-5], flight.R) - flight.V
            speed = np.linalg.norm(U)
            s = speed / air_at(0.0).thermal_speed
            bell = (2 * s**2 + 1) / (math.sqrt(math.pi) * s**3) * math.exp(-(s**2))
            step = (4 * s**4 + 4 * s**2 - 1) / (2 * s**4) * math.erf(s)
            emitted = 2 * math.sqrt(math.pi) / (3 * s) * math.sqrt(0.3)
            known = 1e-11 * speed**2 / 2 * math.pi * (bell + step + emitted)
            force = pushed(run, "drag")[0]
            errors.append(abs(float(force @ U) / speed / known - 1))
        # A polygon of 16 sides between points of the equator has 2.6 % less area than the circle.
        assert errors[1] < 0.04
        # Second order, but the mesh has only about as many cells as it was asked for.
        assert errors[0] / errors[1] > 2.5


def test_fast_air_is_newtons_stream() -> None:
    """Without heat of the air, molecules that stay leave their momentum, those mirrored twice the
    normal one."""
    a = np.array([0.3, 0.2, 0.9])
    U = np.array([100.0, -30.0, 50.0])
    cold = 1e-3
    stays = flow_force(a, U, cold, 1.0, 1.0, 0.0, 1.0, Arrays)
    # Newton's stream: the momentum ρ (a·U) U is left.
    assert np.allclose(stays, abs(a @ U) * U, rtol=1e-9)
    mirrored = flow_force(a, U, cold, 0.0, 0.0, 0.0, 1.0, Arrays)
    n = a / np.linalg.norm(a)
    # Mirrored: twice the normal component.
    assert np.allclose(mirrored, 2 * abs(a @ U) * (n @ U) * n, rtol=1e-9)
    assert np.allclose(
        flow_force(a, U, cold, 1.0, 1.0, 0.0, 0.0, Arrays),
        0,
        atol=1e-12,
    )  # on the back of a side


@pytest.mark.parametrize("what", ["light", "air", "magnet"])
def test_derivatives_by_complex_steps(what: str) -> None:
    """Against differences, away from grazing incidence."""
    pytest.importorskip("erfa")
    orbit = gx.orbit.Orbit(gx.orbit.Elements(A), epoch="2026-06-01", shadow="none")
    body, surface = plate(0.5, JPL_SAIL)
    if what == "magnet":
        load = MagneticDipole(body.frame(), orbit, moment=(1.0, 2.0, 3.0))
    elif what == "air":
        load = Drag(body, orbit, atmosphere=AIR, surfaces=[surface])
    else:
        load = SolarPressure(body, orbit, surfaces=[surface])
    term = next(iter(load.terms(InitialState([], MPI.COMM_WORLD))))
    run = one_step(body, load)
    law = _ByComplexSteps(term.law)
    term.law.prepare(orbit.flight(run.system.unknowns))
    X = np.random.default_rng(1).normal(size=(len(term.ports), 3)).ravel()
    law.begin(0.0, 0.5, 0.9 * X, X)
    K = law.tangent(X)
    step = 1e-6
    slopes = np.array(
        [(law.force(X + step * e) - law.force(X - step * e)) / (2 * step) for e in np.eye(X.size)]
    ).T
    # Relative truncation of the central difference.
    error = np.abs(K - slopes).max()
    assert error < 1e-6 * np.abs(K).max()


def test_magnetic_torque_is_m_cross_B() -> None:
    pytest.importorskip("erfa")
    orbit = gx.orbit.Orbit(gx.orbit.Elements(A, 0.0, i=1.2), epoch="2026-06-01")
    body = gx.RigidBody(5.0, (0.2, 0.3, 0.4), spin=(0.01, 0.0, 0.02))
    magnet = MagneticDipole(body.frame(), orbit, moment=(1.0, -2.0, 0.5))
    run = one_step(magnet)
    flight = orbit.flight(run.system.unknowns)
    B = magnet.field(flight)
    # 30 to 60 µT is the Earth's field in a low orbit; inclination makes it change.
    assert 2e-5 < np.linalg.norm(B) < 6e-5
    force, torque = pushed(run, "magnet")
    # One step: the attitude changes by 1e-5.
    assert np.allclose(torque, np.cross([1.0, -2.0, 0.5], B), rtol=1e-4, atol=1e-9)
    assert np.allclose(force, 0)
    assert abs(run.energy_error) < 1e-9


@pytest.mark.mpi
def test_work_of_all_loads_closes_the_ledger() -> None:
    pytest.importorskip("erfa")
    orbit = gx.orbit.Orbit(
        gx.orbit.Elements(A, 0.01, i=1.0),
        gravity=4,
        epoch="2026-06-01",
        third_bodies=("moon",),
        shadow="cone",
    )
    hub = gx.RigidBody(
        2.0,
        (0.1, 0.1, 0.15),
        position=(0.0, 0.0, 0.4),
        spin=(0, 0, 0.1),
        name="hub",
    )
    box = [
        Surface(0.04, n, centre=tuple(0.1 * np.array(n)), optics=JPL_SAIL)
        for n in ((1.0, 0, 0), (-1.0, 0, 0), (0, 0, 1.0))
    ]
    sail = film(0.3)
    corners = ("bottom left", "bottom right", "top left", "top right")
    run = gx.Simulation(
        gx.Scene(
            *(
                gx.connectors.Spring(hub.port(), sail.port(c), stiffness=5.0, length=0.5, name=c)
                for c in corners
            ),
            SolarPressure(sail, orbit, optics=JPL_SAIL, shadow_pixels=32),
            SolarPressure(hub, orbit, surfaces=box),
            Drag(sail, orbit, atmosphere=AIR),
            Drag(hub, orbit, atmosphere=AIR, surfaces=box),
            MagneticDipole(hub.frame(), orbit, moment=(0.1, 0.0, 0.0)),
            gx.loads.Force(hub.port((0.1, 0, 0)), (0.0, 1e-3, 0.0), name="thruster"),
        ),
        gx.Midpoint(dt=5e-3, tolerances=gx.Tolerances(relative=1e-13)),
    )
    start = run.first.angular_momentum
    run.run(until=0.1)
    assert abs(run.totals.supplied) > 1e-2  # J: the origin goes 7.5 km/s
    assert abs(run.energy_error) < 1e-10
    assert np.linalg.norm(run.totals.angular_momentum - start) > 100
    # Relative: the loads act for 0.1 s only.
    assert drift(run) < 1e-6


def test_a_folded_film_shades_itself() -> None:
    """Of two equal layers the one behind is dark; of steps half as wide, half of it."""
    layer = np.array(
        [[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]], dtype=float
    )
    u = np.array([0.0, 0.0, -1.0])
    both = np.concatenate([layer, layer - [0, 0, 0.1]])
    assert np.allclose(lit_fractions(MPI.COMM_SELF, both, u, 64), [1, 1, 0, 0])
    assert np.allclose(lit_fractions(MPI.COMM_SELF, both, -u, 64), [0, 0, 1, 1])
    aside = np.concatenate([layer, layer - [0.5, 0, 0.1]])
    assert np.allclose(lit_fractions(MPI.COMM_SELF, aside, u, 256)[2:].mean(), 0.5, atol=0.01)
    assert np.allclose(
        lit_fractions(MPI.COMM_SELF, layer, np.array([0.9, 0.0, -0.436]), 64), 1
    )  # it casts no shade


def test_wrong_loads_are_refused() -> None:
    orbit = Orbit()
    flat, (body, surface) = film(0.0), plate(0.0)
    for make in (
        lambda: SolarPressure(flat, orbit, surfaces=[surface]),
        lambda: SolarPressure(body, orbit),
        lambda: SolarPressure(body, orbit, surfaces=[surface], shadow_pixels=8),
        lambda: Drag(body, orbit, atmosphere=AIR),
        lambda: Drag(body, orbit, atmosphere=AIR, surfaces=[surface], closed=True),
        lambda: MagneticDipole(body.frame(), orbit, moment=(1.0, 0, 0)),
        lambda: Surface(1.0, (0, 0, 0)),
    ):
        with pytest.raises(gx.InputError):
            make()
    with pytest.raises(gx.InputError, match="Sun"):
        one_step(SolarPressure(flat, orbit))
    with pytest.raises(gx.InputError, match="return Air"):
        one_step(Drag(flat, orbit, atmosphere=lambda altitude: 1e-12))
    measured = light_force(np.ones(3), np.ones(3), (2, 0, 0), (2, 0, 0), Arrays).shape
    assert measured == (3,)
    assert len(axes_of(body)) == 4
