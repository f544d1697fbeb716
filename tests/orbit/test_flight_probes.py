"""Probes and pictures of scenes in orbit, and their checkpoints."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest

import gossamer_fx as gx
from demos.common.flight_picture import FlightPicture
from gossamer_fx.mechanics.orbit.elements import elements_of
from gossamer_fx.records.probes.flight import resultant
from tests.orbit.test_orbit_loads import AIR, film, plate
from tests.small_scenes import run_until

A = 7e6


@pytest.mark.mpi
def test_probes_tell_orbit_light_attitude_and_what_acts() -> None:
    start = gx.orbit.Elements(A, 0.01, i=0.8, node=1.0, perigee=0.5, anomaly=0.3)
    orbit = gx.orbit.Orbit(start, sun=(0.0, 0.0, 1.0))
    sail, (body, surface) = film(0.4), plate(0.0)
    run = run_until(
        2e-3,
        gx.orbit.SolarPressure(sail, orbit, name="light"),
        gx.orbit.Drag(body, orbit, atmosphere=AIR, surfaces=[surface], name="drag"),
        dt=1e-3,
    )
    r, v = orbit.flight(run.system.unknowns).state()
    found = elements_of(r, v, orbit.mu)
    for name in ("a", "e", "i", "node", "perigee", "anomaly"):
        measured = gx.probes.OrbitState(orbit, name)(run)
        # The probe reads the same state: only round-off separates the two.
        assert measured == pytest.approx(getattr(found, name), rel=1e-12)
    measured = gx.probes.OrbitState(orbit, "altitude")(run)
    assert measured == pytest.approx(np.linalg.norm(r) - orbit.radius, rel=1e-12)
    assert gx.probes.OrbitState(orbit, "sunlit")(run) == 1.0
    assert gx.probes.OrbitState(orbit, "depth")(run) < 0
    assert gx.probes.SunAngle(orbit, sail)(run) == pytest.approx(0.4, abs=1e-3)
    normal = body.frame().directors[2]
    assert gx.probes.SunAngle(orbit, normal)(run) == pytest.approx(0.0, abs=1e-3)
    assert gx.probes.Attitude(orbit, normal, axis="across")(run) == pytest.approx(0.8, abs=1e-6)
    push = [
        gx.probes.LoadResultant(orbit, "light", action="force", axis=axis)(run) for axis in "xyz"
    ]
    # An ideal mirror of 1 m² at 0.4 rad: 2 P cos² α.
    assert math.hypot(*push) == pytest.approx(2 * 4.563e-6 * math.cos(0.4) ** 2, rel=1e-3)
    # light on the film at its own place turns the whole about the centre of mass of both
    torque = [
        gx.probes.LoadResultant(orbit, "light", action="torque", axis=axis)(run) for axis in "xyz"
    ]
    # From the centre of mass to the middle of the film.
    arm = (
        np.array([0.5 * math.cos(0.4), 0.5, -0.5 * math.sin(0.4)])
        - orbit.flight(run.system.unknowns).centre
    )
    assert np.allclose(torque, np.cross(arm, push), rtol=1e-3, atol=1e-10)
    with pytest.raises(gx.InputError, match="no load"):
        gx.probes.LoadResultant(orbit, "wind", action="force", axis="x")(run)
    for wrong in (
        lambda: gx.probes.OrbitState(orbit, "speed"),
        lambda: gx.probes.Attitude(orbit, normal, axis="down"),
    ):
        with pytest.raises(gx.InputError):
            wrong()


def test_gravity_gradient_turns_as_the_formula() -> None:
    """3 n² r̂ × I r̂ on a body whose axes are inclined to the vertical."""
    orbit = gx.orbit.Orbit(gx.orbit.Elements(A))
    c = math.cos(0.6)
    s = math.sin(0.6)
    attitude = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array(
        [[1, 0, 0], [0, c, -s], [0, s, c]]
    )
    inertia = np.diag([3.0, 4.0, 2.0])
    body = gx.RigidBody(5.0, (3.0, 4.0, 2.0), attitude=attitude)
    run = run_until(1e-2, body, orbit, dt=1e-2)
    n2 = orbit.mu / A**3
    out = np.array([1.0, 0, 0])
    known = 3 * n2 * np.cross(out, attitude @ inertia @ attitude.T @ out)
    torque = [
        gx.probes.LoadResultant(orbit, "orbit", action="torque", axis=axis)(run) for axis in "xyz"
    ]
    # The field is not homogeneous: terms of L/R = 1e-7, and the last bits of positions of 7000 km.
    assert np.allclose(torque, known, rtol=1e-5, atol=1e-5 * np.abs(known).max())


@pytest.mark.mpi
def test_the_weight_of_a_body_without_mesh_has_a_resultant() -> None:
    place = np.array([2.0, 1.0, 0.0])
    hub = gx.RigidBody(3.0, (1.0, 1.1, 1.2), position=place, name="hub")
    run = run_until(1e-3, gx.Gravity(hub, (0.0, 0.0, -2.0)), dt=1e-3)
    force, torque = resultant(run, "gravity of hub")
    assert force == pytest.approx([0.0, 0.0, -6.0], abs=1e-12)
    # It has fallen along its weight only, which does not change the torque.
    assert torque == pytest.approx(np.cross(place, force), abs=1e-12)


@pytest.mark.mpi
def test_a_flight_goes_on_from_a_checkpoint(folder: Path) -> None:
    def flight(**options: object) -> tuple[gx.Simulation, gx.orbit.Orbit]:
        # Its perigee is within the Earth.
        orbit = gx.orbit.Orbit(
            gx.orbit.Elements(A, 0.1, i=0.5), gravity="J2", sun=(1.0, 0, 0), radius=6e6
        )
        sail = film(0.3)
        scene = gx.Scene(
            gx.orbit.SolarPressure(sail, orbit, name="sunlight"),
            gx.orbit.Drag(sail, orbit, atmosphere=AIR, name="drag"),
        )
        return gx.Simulation(scene, gx.Midpoint(dt=5e-3), **options), orbit

    whole, orbit = flight()
    whole.run(until=0.05)
    half, _ = flight(checkpoints=gx.Checkpoints(folder / "kept", every=4))
    half.run(until=0.03)
    again, other = flight(restart=folder / "kept")
    saved, first = flight()
    saved.run(until=again.time)
    for load in ("sunlight", "drag", "orbit"):
        for action, axis in itertools.product(("force", "torque"), "xyz"):
            found, expected = (
                gx.probes.LoadResultant(of, load, action=action, axis=axis)(run)
                for of, run in ((other, again), (first, saved))
            )
            # Torques are round-off of the forces.
            assert found == pytest.approx(expected, rel=1e-9, abs=1e-20)
    again.run(until=0.05)
    error = np.abs(again.system.unknowns.q0.array_r - whole.system.unknowns.q0.array_r).max()
    # The checkpoint holds the origin of the flight separately from small positions.
    assert error < 1e-12
    mine, theirs = (o.flight(r.system.unknowns).origin for o, r in ((other, again), (orbit, whole)))
    # m in 7000 km: the last bits.
    error = np.abs(mine.R0 - theirs.R0).max()
    assert error < 1e-8
    assert again.energy_error == pytest.approx(whole.energy_error, abs=1e-12)


def test_the_picture_of_a_flight(folder: Path) -> None:
    orbit = gx.orbit.Orbit(gx.orbit.Elements(A), sun=(1.0, 0.3, 0.2))
    body, surface = plate(0.3)
    probes = {"altitude [m]": gx.probes.OrbitState(orbit, "altitude")}
    picture = FlightPicture(folder / "flight.png", orbit, probes=probes, title="a plate")
    run_until(
        0.5,
        gx.orbit.SolarPressure(body, orbit, surfaces=[surface]),
        film(0.3),
        dt=0.1,
        outputs=[picture],
    )
    assert (folder / "flight.png").read_bytes()[1:4] == b"PNG"
