"""Tethers with prescribed length or brake, attached masses, driven hubs, probes of spin."""

from __future__ import annotations

import math

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.mechanics.connectors.tether import braked_rope
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.presets.films import KAPTON_HN
from gossamer_fx.records.fields.lines import line_forces
from tests.rows import step_of
from tests.small_scenes import run_until

K = 400.0
MASS = 0.5
L = 1.0
BRAKE = 2.0


def flying(speed: float, **given) -> tuple[gx.Simulation, gx.PointMass]:
    """A mass at the end of a tether that is just straight."""
    mass = gx.PointMass(MASS, (L, 0.0, 0.0), velocity=(speed, 0.0, 0.0))
    tether = gx.connectors.Tether(gx.Ground((0.0, 0.0, 0.0)), mass.port(), stiffness=K, **given)
    return gx.Simulation(gx.Scene(mass, tether), gx.Midpoint(dt=5e-3)), mass


def length_of(run: gx.Simulation) -> float:
    [tether] = [
        item for item in run.system.unknowns.items if isinstance(item, gx.connectors.Tether)
    ]
    return float(line_forces(run.system, tether, "step").natural_lengths[0])


def test_a_brake_stops_a_mass_as_friction_does() -> None:
    """It pulls with B from where the tether is stretched by B/k: the rest of ½ m v² is lost on the
    way."""
    run, mass = flying(1.2, length=L, brake_force=BRAKE)
    run.run(until=0.45)
    kinetic = MASS * 1.2**2 / 2
    elastic = BRAKE**2 / 2 / K
    paid = (kinetic - elastic) / BRAKE
    assert length_of(run) - L == pytest.approx(paid, rel=1e-3)
    assert run.totals.dissipated == pytest.approx(BRAKE * paid, rel=1e-3)
    assert abs(run.energy_error) < 1e-13
    # what the tether has stored comes back: the mass flies inwards with that energy
    run.run(until=0.6)
    measured = gx.probes.Velocity(mass.port(), "x")(run)
    assert measured == pytest.approx(-math.sqrt(2 * elastic / MASS), rel=0.01)


def test_an_empty_reel_holds() -> None:
    run, mass = flying(3.0, length=L, brake_force=BRAKE, total_length=1.2)
    run.run(until=0.25)
    assert length_of(run) == pytest.approx(1.2, abs=1e-12)
    assert (
        run.totals.dissipated == pytest.approx(0.2 * BRAKE, rel=1e-9)
        and abs(run.energy_error) < 1e-13
    )
    left = MASS * 9 / 2 - 0.2 * BRAKE
    measured = gx.probes.Velocity(mass.port(), "x")(run)
    assert measured == pytest.approx(-math.sqrt(2 * left / MASS), rel=1e-3)


def test_a_whirling_mass_is_paid_out_and_keeps_its_angular_momentum() -> None:
    """Slowly: m l² ω is constant, and the reel takes what the kinetic energy loses."""
    ω = 2.0
    tension = MASS * ω**2 * L
    start = L - tension / K
    mass = gx.PointMass(MASS, (L, 0.0, 0.0), velocity=(0.0, ω * L, 0.0))
    tether = gx.connectors.Tether(
        gx.Ground((0, 0, 0)),
        mass.port(),
        length=lambda t: start + 0.25 * t**2 * (3 - 2 * t),
        stiffness=K,
    )
    run = run_until(1.0, mass, tether, dt=2e-2)
    x, y = (gx.probes.Position(mass.port(), axis)(run) for axis in "xy")
    assert run.totals.angular_momentum[2] == pytest.approx(MASS * ω * L**2, rel=1e-12)
    assert abs(run.energy_error) < 1e-13
    assert math.hypot(x, y) == pytest.approx(start + 0.25, abs=0.01)
    assert run.totals.supplied < 0


def test_the_tangent_of_a_tether_is_the_derivative() -> None:
    numbers = {"k": K, "brake": BRAKE, "total_length": 1.5}
    δ = 1e-7
    for l0 in (0.9, 1.003, 1.005):
        for l1 in (0.8, 1.002, 1.004, 1.2, 1.6, 1.005):
            if abs(l1 - l0) > 1e-6:
                e0, e1 = np.array([[l0]]) ** 2 / 2, np.array([[l1]]) ** 2 / 2
                slope = step_of(braked_rope, e0, e1, numbers, z0=L).dS
                above, below = (
                    step_of(braked_rope, e0, e1 + s * δ, numbers, z0=L).S for s in (1, -1)
                )
                assert slope[0] == pytest.approx((above - below) / 2 / δ, rel=1e-4, abs=1e-3)


def test_a_driven_hub_keeps_its_rate_and_books_the_work_of_its_motor(comm) -> None:
    """A mass on a rope comes up to the hub's rate or swings about it; what it gains is supplied."""
    hub = gx.RigidBody(1.0, (1.0, 1.0, 1.0), name="hub")
    mass = gx.PointMass(MASS, (1.0, 0.0, 0.0))
    rope = gx.connectors.Rope(hub.port((0.2, 0.0, 0.0)), mass.port(), length=0.8, stiffness=K)
    motor = gx.constraints.Driven(hub, (0, 0, 1), angle=lambda t: 3.0 * t)
    spin = gx.RigidMotion(spin=(0.0, 0.0, 3.0))
    run = run_until(0.2, hub, mass, rope, motor, spin, dt=5e-3)
    assert gx.probes.AngularVelocity(hub.frame(), "z")(run) == pytest.approx(3.0, rel=1e-4)
    first = run.first
    gained = run.totals.energy - first.energy
    assert run.totals.supplied == pytest.approx(gained, abs=1e-9 * first.energy)
    assert abs(run.energy_error) < 1e-10


@pytest.mark.mpi
def test_masses_on_a_film_count_in_its_spin_and_weight(comm) -> None:
    law = KAPTON_HN.law(25e-6)
    film = gx.Membrane(sheet(comm, 2, 2, 0.2, 0.2), law)
    corner = film.port("bottom left")
    far = gx.connectors.AttachedMass(corner, 0.01)
    hub = gx.RigidBody(1.0, (1.0, 1.0, 1.0), name="hub")
    scene = gx.Scene(
        film,
        far,
        hub,
        gx.Gravity(film, (0.0, 0.0, -9.81)),
        gx.RigidMotion(spin=(0.0, 0.0, 4.0)),
    )
    run = gx.Simulation(scene, gx.Midpoint(dt=1e-3))
    assert gx.probes.MeanSpin(film, "z")(run) == pytest.approx(4.0, rel=1e-12)
    x, y = (gx.probes.Position(corner, axis)(run) for axis in "xy")
    measured = gx.probes.PolarPosition(corner, hub.frame(), quantity="radius")(run)
    assert measured == pytest.approx(math.hypot(x, y), rel=1e-12)
    measured = gx.probes.PolarPosition(corner, hub.frame(), quantity="angle")(run)
    assert measured == pytest.approx(math.atan2(y, x), rel=1e-12)
    run.run(until=5e-3)
    weight = 0.01 + law.density * law.thickness * 0.04
    assert run.totals.momentum[2] == pytest.approx(-9.81 * 5e-3 * weight, rel=1e-9)


@pytest.mark.mpi(1)
@pytest.mark.parametrize("tension_only", [False, True])
def test_slack_film_is_free_of_damping_in_tension_only(comm, tension_only: bool) -> None:
    """A film that is pressed together flies apart: its slack strain rate is damped by the one, not
    by the other."""
    film = gx.Membrane(
        sheet(comm, 2, 2, 0.2, 0.2),
        KAPTON_HN.law(25e-6, residual_stiffness=0.0),
        displacement=lambda X: -0.2 * X,
        velocity=lambda X: X,
    )
    run = run_until(
        0.01, film, gx.Damping(film, stiffness_factor=1e-5, tension_only=tension_only), dt=1e-3
    )
    # of the kinetic energy three quarters are its flight as a whole, for it reaches from 0 to 0.2 m
    lost = run.totals.dissipated / run.first.kinetic
    assert lost == pytest.approx(0.0 if tension_only else 1 / 4, rel=0.1)
    assert abs(run.energy_error) < 1e-10


def test_taut_film_is_damped_in_tension_only_as_elsewhere(comm) -> None:
    lost = []
    for tension_only in (False, True):
        film = gx.Membrane(
            sheet(comm, 3, 3, 0.2, 0.2),
            KAPTON_HN.law(25e-6),
            displacement=lambda X: 2e-3 * X,
            velocity=lambda X: 0.5 * X,
        )
        held = [gx.Fixed(film, side) for side in ("left", "right", "top", "bottom")]
        damping = gx.Damping(film, stiffness_factor=1e-6, tension_only=tension_only)
        run = run_until(1e-5, film, *held, damping, dt=1e-6)
        lost.append(run.totals.dissipated)
        assert abs(run.energy_error) < 1e-12
    assert lost[0] > 0 and lost[1] == pytest.approx(lost[0], rel=1e-9)


@pytest.mark.mpi
def test_a_bundle_is_its_ropes(comm) -> None:
    motions = []
    for bundled in (False, True):
        film = gx.Membrane(
            sheet(comm, 2, 2, 0.2, 0.2),
            KAPTON_HN.law(25e-6),
            velocity=lambda X: 0 * X + [[0], [0], [1]],
        )
        ends = [
            (film.port(f"bottom {side}"), gx.Ground((x, 0.0, 0.0)))
            for side, x in (("left", -0.1), ("right", 0.3))
        ]
        if bundled:
            ropes = [
                gx.connectors.RopeBundle(ends, lengths=[0.1, 0.1], stiffness=50.0, damping=0.01)
            ]
        else:
            ropes = [
                gx.connectors.Rope(
                    *pair,
                    length=0.1,
                    stiffness=50.0,
                    name=f"rope {k}",
                    damping=0.01,
                )
                for k, pair in enumerate(ends)
            ]
        run = run_until(5e-3, film, *ropes, dt=1e-3)
        motions.append((gx.probes.Velocity(ends[0][0], "z")(run), run.totals.dissipated))
    assert motions[0] == pytest.approx(motions[1], rel=1e-9) and motions[0][1] > 0


def test_a_weight_hangs_at_the_length_that_is_out() -> None:
    mass = gx.PointMass(MASS, (0.0, 0.0, -L))
    tether = gx.connectors.Tether(
        gx.Ground((0.0, 0.0, 0.0)),
        mass.port(),
        length=lambda t: L + t,
        stiffness=K,
    )
    search = gx.Equilibrium(gx.Scene(mass, tether, gx.Gravity(mass, (0.0, 0.0, -9.81))))
    search.find(at=0.5)
    measured = gx.fields.positions(search, mass)[..., 2].ravel()[:1]
    assert measured == pytest.approx(-(L + 0.5 + MASS * 9.81 / K), rel=1e-9)
