"""Scenes that start from the end of another scene: joints, springs and probes use the initial
positions."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.core.model.body import Array
from gossamer_fx.meshes.creased_strip import creased_strip
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.solve.view import chamber_state
from tests.small_scenes import LINEAR, at_rest, run_until

COMM = MPI.COMM_WORLD
TIP = (0.0, 1.0, 0.0)


def turned() -> tuple[gx.Cable, gx.StartFrom]:
    """A cable from (0, 0, 0) to (1, 0, 0), and a start in which it goes to (0, 1, 0) instead."""
    mesh = line(COMM, [(0, 0, 0), (1, 0, 0)], 4)
    law = gx.CableLaw(1e3, 1.0)

    def quarter(X: Array) -> Array:
        # A quarter turn: (X, Y) goes to (-Y, X), so the displacement is (-Y - X, X - Y).
        return np.array([-X[1] - X[0], X[0] - X[1], 0 * X[2]])

    return gx.Cable(mesh, law), gx.StartFrom(
        gx.Scene(gx.Cable(mesh, law, displacement=quarter)).compile()
    )


@pytest.mark.mpi
def test_a_ball_joint_takes_the_points_of_the_start() -> None:
    cable, start = turned()
    joint = gx.constraints.BallJoint(cable.port("end"), gx.Ground(TIP))
    run = run_until(2e-3, cable, start, joint, dt=1e-3)
    # A joint of the start pulls on nothing: round-off.
    assert gx.probes.Position(cable.port("end"), "y")(run) == pytest.approx(1.0, abs=1e-12)
    with pytest.raises(gx.InputError, match=r"its two points are 1\.41421 m apart at the start"):
        gx.Scene(
            cable, start, gx.constraints.BallJoint(cable.port("end"), gx.Ground((1.0, 0.0, 0.0)))
        ).compile()


@pytest.mark.mpi
def test_a_link_keeps_the_distance_of_the_start() -> None:
    cable, start = turned()
    link = gx.constraints.Link(cable.port("end"), gx.Ground((0.0, 3.0, 0.0)))
    run = run_until(5e-2, cable, start, link, gx.Gravity(cable, (9.0, 2.0, 3.0)), dt=1e-2)
    end = np.array([gx.probes.Position(cable.port("end"), axis)(run) for axis in "xyz"])
    assert abs(end[0]) > 1e-3
    # The distance from TIP to (0, 3, 0) at the start.
    assert np.linalg.norm(end - (0.0, 3.0, 0.0)) == pytest.approx(2.0, rel=1e-10)


@pytest.mark.mpi
def test_a_rigid_motion_is_that_of_bodies_where_they_start() -> None:
    cable, start = turned()
    motion = gx.RigidMotion(spin=(0.0, 0.0, 2.0))
    for order in ((start, motion), (motion, start)):
        state = gx.Scene(cable, *order).compile().unknowns.state
        # Ω × x at TIP, where the end starts.
        assert state.rate(cable.port("end")) == pytest.approx([-2.0, 0.0, 0.0], abs=1e-12)


@pytest.mark.mpi
def test_a_displacement_begins_at_zero() -> None:
    cable, start = turned()
    shift = gx.RigidMotion(velocity=(0.0, 0.5, 0.0))
    run = gx.Simulation(gx.Scene(cable, start, shift), gx.Midpoint(dt=1e-2))
    probe = gx.probes.Displacement(cable.port("end"), "y")
    assert probe(run) == 0.0
    run.run(until=2e-2)
    # 0.5 m/s for 0.02 s, without forces.
    assert probe(run) == pytest.approx(0.01, rel=1e-9)


@pytest.mark.mpi
def test_a_region_is_fixed_to_a_rigid_body_where_both_start() -> None:
    """The points of the hub are those at which the nodes are after hub and film have moved."""
    film = gx.Membrane(sheet(COMM, 4, 2), gx.Miyazaki(E=1e9, nu=0.3, thickness=1e-5, density=1e3))
    hub = gx.RigidBody(1.0, (1.0, 1.0, 1.0), position=(-0.2, 0.5, 0.0), comm=COMM, name="hub")
    bodies = (film, hub, gx.RigidRegion(film, "left", rigid_body=hub))
    motion = gx.RigidMotion(spin=(0.5, 0.0, 3.0), velocity=(0.0, 1.0, 0.0))
    before = run_until(0.2, *bodies, motion, dt=0.02)
    after = gx.Simulation(
        gx.Scene(*bodies, gx.StartFrom(before.system), motion), gx.Midpoint(dt=0.02)
    )
    # The hub has turned by more than half a radian.
    assert after.system.unknowns.state.vectors(hub.frame().directors)[0, 0] < 0.9
    moved = (
        after.system.unknowns.state[film].positions()
        - before.system.unknowns.state[film].positions()
    )
    assert np.abs(moved).max(initial=0.0) < 1e-15
    corner = film.port_at((0.0, 1.0, 0.0))
    after.run(until=0.04)
    ends = after.system.unknowns.state.vectors([corner, hub.port()])
    # The corner is 0.2 m and 0.5 m from the centre of the hub.
    assert np.linalg.norm(ends[1] - ends[0]) == pytest.approx(np.hypot(0.2, 0.5), rel=1e-9)


@pytest.mark.mpi
def test_another_mesh_is_refused_on_all_ranks() -> None:
    """On two ranks the first one has as many nodes of both meshes, 11."""
    other, film = (gx.Membrane(sheet(COMM, n, m), LINEAR, name="film") for n, m in ((3, 5), (4, 4)))
    start = gx.StartFrom(gx.Scene(other).compile())
    with pytest.raises(gx.InputError, match="'film' has other nodes in 'start'"):
        gx.Scene(film, start).compile()


@pytest.mark.mpi
def test_a_hinge_has_turned_with_its_bodies() -> None:
    """Bodies of 1 kg m² on a hinge with a spring of 2 N m/rad, 0.3 rad from rest, swing by φ =
    0.3 (1 - cos 2t) about the axis of the bodies, wherever these start."""
    quarter = ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0))

    def pair(attitude: object) -> list[gx.RigidBody]:
        return [
            gx.RigidBody(1.0, (1.0, 1.0, 1.0), attitude=attitude, comm=COMM, name=name)
            for name in ("one", "other")
        ]

    one, other = pair(np.eye(3))
    sides = one.frame(), other.frame()
    axis = (1.0, 0.0, 0.0)
    hinge = gx.constraints.RevoluteJoint(*sides, axis=axis)
    spring = gx.connectors.TorsionSpring(*sides, axis=axis, stiffness=2.0, rest_angle=0.3)
    start = gx.StartFrom(gx.Scene(*pair(quarter)).compile())
    run = run_until(np.pi / 2, hinge, spring, start, dt=np.pi / 100)
    a, b = run.system.unknowns.state.vectors([one.vector(2), other.vector(2)])
    assert np.arccos(a @ b) == pytest.approx(0.6, rel=1e-3)


def test_two_starts_are_refused(comm):
    mass = gx.PointMass(1.0, comm=comm)
    system = gx.Scene(mass).compile()
    with pytest.raises(gx.InputError, match="several StartFrom"):
        gx.Scene(mass, gx.StartFrom(system, name="first"), gx.StartFrom(system, name="second"))


@pytest.mark.mpi
def test_a_film_on_the_ground_stays_in_contact() -> None:
    """Without the pairs that carry it, it would fall until it touches again."""
    film = gx.Membrane(sheet(COMM, 3, 3, 0.1, 0.1), LINEAR, name="film")
    distance = 2e-3
    ground = gx.contact.Plane(point=(0.0, 0.0, -0.9 * distance), normal=(0.0, 0.0, 1.0))
    items = [gx.Contact(film, ground, distance=distance), gx.Gravity(film, (0.0, 0.0, -9.81))]
    search = gx.analysis.Continuation(tolerance=1e-9)
    before = at_rest(*items, search=search).system
    run = run_until(0.02, *items, gx.StartFrom(before), dt=1e-3)
    moved = run.system.unknowns.state[film].positions() - before.unknowns.state[film].positions()
    # A free fall over 0.02 s is 2 mm.
    assert np.abs(moved).max(initial=0.0) < 1e-5 * distance
    assert run.first.stored["contact"] == pytest.approx(before.balance.totals().stored["contact"])


@pytest.mark.mpi
def test_a_crease_keeps_the_rest_angle_to_which_it_yielded() -> None:
    """A fold of 1.4 rad that yields from 0.4 rad on is at rest at 1 rad, from 0.6 rad on as if it
    began there."""

    def folded(X: Array) -> Array:
        return np.array([(np.cos(0.7) - 1) * X[0], 0 * X[1], np.sin(0.7) * abs(X[0])])

    film = gx.Membrane(creased_strip(COMM, 2, 1, 0.02, 0.03), LINEAR, displacement=folded)
    crease = gx.connectors.Crease(film, "crease", stiffness=1.0, yield_angle=0.4)
    before = at_rest(film, crease, gx.Fixed(film, "crease")).system
    after = gx.Scene(film, crease, gx.StartFrom(before)).compile()
    angle = gx.probes.FoldAngle(crease)
    assert angle.of(before) == pytest.approx(1.0, abs=1e-4)
    # The energy would be ½ 0.4² times 1 N m/m/rad and 0.03 m.
    assert after.balance.totals().stored["crease"] < 1e-6 * 0.4**2 / 2 * 0.03


@pytest.mark.mpi
def test_a_piston_has_displaced_its_volume() -> None:
    mass = gx.PointMass(0.5, comm=COMM)
    chamber = gx.Chamber(
        gx.gas.Piston(mass.port(), 0.01, direction=(1.0, 0.0, 0.0)),
        gas=gx.IdealGas(gamma=1.4, R=287.05),
        pressure=1e5,
        temperature=300.0,
        dead_volume=2e-3,
        name="chamber",
    )
    moved = gx.PointMass(0.5, (0.1, 0.0, 0.0), comm=COMM)
    start = gx.StartFrom(gx.Scene(moved).compile())
    gas = chamber_state(gx.Scene(mass, chamber, start).compile(), "chamber")
    assert gas.volume == pytest.approx(2e-3 + 0.01 * 0.1, rel=1e-14)


@pytest.mark.mpi
def test_a_body_that_has_turned_spins_about_the_same_axis() -> None:
    """Its spin is in axes of space.  The frame of a beam turns with the beam's velocities."""
    quarter = ((0, -1, 0), (1, 0, 0), (0, 0, 1))

    def scene(attitude: object) -> tuple[gx.RigidBody, gx.Beam]:
        body = gx.RigidBody(
            1.0, (1.0, 2.0, 2.5), attitude=attitude, spin=(0.3, -0.2, 0.5), comm=COMM
        )
        section = gx.sections.solid_circle(0.01, E=1e9, nu=0.3, density=1500.0)
        ends = [(0, 0, 0), np.asarray(attitude) @ (1, 0, 0)]
        beam = gx.Beam(
            line(COMM, ends, 2),
            section,
            normal=(0, 0, 1),
            velocity=lambda X: np.cross((0.3, -0.2, 0.5), X.T).T,
        )
        return body, beam

    start = gx.StartFrom(gx.Scene(*scene(quarter)).compile())
    body, beam = scene(np.eye(3))
    run = gx.Simulation(gx.Scene(body, start), gx.Midpoint(dt=1e-2))
    for axis, rate in zip("xyz", (0.3, -0.2, 0.5), strict=True):
        spin = gx.probes.AngularVelocity(body.frame(), axis)
        assert spin(run) == pytest.approx(rate, abs=1e-14)
    state = gx.Scene(body, beam, start).compile().unknowns.state[beam]
    directors = state.coordinates()[:, 1:]
    expected = np.cross((0.3, -0.2, 0.5), directors)
    np.testing.assert_allclose(state.rates()[:, 1:], expected, atol=1e-14)


@pytest.mark.mpi
def test_a_viscoelastic_film_goes_on_to_relax() -> None:
    """A film that is held stretched for 1 s, and then in a second scene, has the stress of one run:
    C ε (1 + r exp(-t/τ))."""
    film = gx.Membrane(sheet(COMM, 1, 1), LINEAR)
    held = [
        gx.Fixed(film, edge, motion=lambda X, t: 0.01 * np.sin(np.pi / 2 * min(t, 1.0)) * X)
        for edge in ("left", "right", "bottom", "top")
    ]
    relaxing = gx.loads.Viscoelasticity(film, ratios=(0.5,), times=(1.0,))
    whole = run_until(1.5, *held, relaxing, dt=0.25)
    first = run_until(1.0, *held, relaxing, dt=0.25)
    start = gx.StartFrom(first.system)
    still = [
        gx.Fixed(film, edge, motion=lambda X, t: 0.01 * X, name=f"{edge} still")
        for edge in ("left", "right", "bottom", "top")
    ]
    second = gx.Simulation(gx.Scene(*still, relaxing, start), gx.Midpoint(dt=0.25))
    stress = gx.probes.LargestStress(film, at="end")
    assert stress(second) == pytest.approx(stress(first), rel=1e-12)
    second.run(until=0.5)
    assert stress(second) == pytest.approx(stress(whole), rel=1e-9)
    assert abs(second.energy_error) < 1e-12


@pytest.mark.mpi
def test_a_film_in_sunlight_keeps_its_temperatures() -> None:
    thermal = gx.materials.ThermalExpansion(2e-5, 293.0)
    film = gx.Membrane(sheet(COMM, 2, 2), LINEAR, thermal=thermal)
    orbit = gx.orbit.Orbit(gx.orbit.Elements(7e6), sun=(0.0, 0.6, 0.8), shadow="none")
    surface = gx.orbit.ThermalProperties(heat_capacity=3.0, absorptivity=0.9, emissivity=0.1)
    heating = gx.orbit.SolarHeating(film, orbit, surface)
    first = run_until(2.0, film, orbit, heating, dt=0.5)
    before = heating.balance(first)
    assert before.lowest > 400.0
    start = gx.StartFrom(first.system)
    second = gx.Simulation(gx.Scene(film, orbit, heating, start), gx.Midpoint(dt=0.5))
    stress = gx.probes.LargestStress(film, at="end")
    # Round-off of a stress that is some 1e-3 of the stiffness times the thermal strain.
    assert stress(second) == pytest.approx(stress(first), rel=1e-9)
    after = heating.balance(second)
    assert (after.lowest, after.highest) == pytest.approx((before.lowest, before.highest))
    assert (after.absorbed, after.emitted) == (0.0, 0.0)
    second.run(until=1.0)
    assert abs(heating.balance(second).error) < 1e-12
    assert abs(second.energy_error) < 1e-9
