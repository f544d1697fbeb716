"""The generalised-α method is second order, with joints and gas too, and drifts where the midpoint
rule does not."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import sheet
from tests.contact.scenes import film as contact_film
from tests.rates import observed_order

COMM = MPI.COMM_WORLD
# Halvings, fine enough that the errors follow their leading term.
STEPS = (4e-3, 1e-3)


def oscillator(stepper: gx.GeneralizedAlpha) -> float:
    """Error of x at t = 1 s of x'' = -100 x, from x = 1 at rest."""
    mass = gx.PointMass(1.0, (1.0, 0.0, 0.0))
    run = gx.Simulation(
        gx.Scene(mass, gx.connectors.AxialSpring(mass.port(), 100.0, direction=(1.0, 0.0, 0.0))),
        stepper,
    )
    run.run(until=1.0)
    # cos(ωt) with ω = √(100 N/m / 1 kg) = 10 rad/s.
    return abs(float(run.system.unknowns.q0.array_r[0]) - np.cos(10.0))


def physical_pendulum(stepper: gx.GeneralizedAlpha) -> float:
    """Error of the angle of a bar, hinged at its end and released at 1 rad from the vertical, after
    1 s, g = 9.81.

    θ'' = -(3g/2) sin θ; the exact angle is that of the Jacobi function sn.
    """
    from scipy.special import ellipj, ellipk

    k = np.sin(0.5)
    ω = np.sqrt(1.5 * 9.81)
    exact = 2 * np.arcsin(k * ellipj(ellipk(k**2) - ω, k**2)[0])
    e = np.array([np.sin(1.0), -np.cos(1.0), 0.0])
    attitude = np.array([e, np.cross([0, 0, 1], e), [0, 0, 1]]).T
    rod = gx.RigidBody(1.0, np.full(3, 1 / 12), position=e / 2, attitude=attitude)
    hinge = gx.constraints.RevoluteJoint(rod.frame((-0.5, 0, 0)), gx.ground_frame(), axis=(0, 0, 1))
    run = gx.Simulation(gx.Scene(hinge, gx.Gravity(rod, (0, -9.81, 0))), stepper)
    run.run(until=1.0)
    assert run.system.equations.constraints is not None
    # The constraint is imposed on positions, so it holds to round-off.
    assert run.system.equations.constraints.violation(run.system.unknowns.q0) < 1e-11
    d1 = run.system.unknowns.q0.array_r[3:6]
    return abs(float(np.arctan2(d1[0], -d1[1])) - exact)


def blown_piston(stepper: gx.GeneralizedAlpha) -> float:
    """Error of a piston driven by gas through a choked inlet, at t = 0.1 s (97.060879 mm by
    converged integration)."""
    gas = gx.IdealGas(gamma=1.4, R=287.0)
    mass = gx.PointMass(0.5, (0.0, 0.0, 0.0))
    bag = gx.Chamber(
        gx.gas.Piston(mass.port(), 0.01, direction=(1.0, 0.0, 0.0)),
        gas=gas,
        pressure=1e3,
        temperature=300.0,
        dead_volume=1e-3,
    )
    spring = gx.connectors.AxialSpring(mass.port(), 2000.0, direction=(1.0, 0.0, 0.0))
    run = gx.Simulation(
        gx.Scene(
            bag,
            spring,
            gx.Orifice(gx.gas.Ambient(1e5, 300.0, name="reservoir"), bag, area=2e-5),
        ),
        stepper,
    )
    run.run(until=0.1)
    return abs(float(run.system.unknowns.q0.array_r[0]) - 97.060879e-3)


@pytest.mark.parametrize("radius", [0.5, 0.8, 1.0])
@pytest.mark.parametrize("problem", [oscillator, physical_pendulum, blown_piston])
def test_second_order(problem, radius: float) -> None:
    errors = [problem(gx.GeneralizedAlpha(dt=dt, spectral_radius=radius)) for dt in STEPS]
    # 0.2: the smallest step still has a term of third order.
    assert observed_order(STEPS, errors) == pytest.approx(2, abs=0.2)


def test_starts_with_the_forces_of_dampers_and_constraints() -> None:
    """v' = -c v/m: one step has the error of the rule, some h², not that of an acceleration that
    begins at zero."""
    mass = gx.PointMass(2.0, (1.0, 0.0, 0.0), velocity=(1.0, 0.0, 0.0))
    damper = gx.connectors.Damper(mass.port(), gx.Ground((0.0, 0.0, 0.0)), damping=20.0)
    run = gx.Simulation(gx.Scene(mass, damper), gx.GeneralizedAlpha(dt=0.01))
    run.run(until=0.01)
    # A start without the damper's force would miss by v c h/m = 0.1.
    assert run.totals.momentum[0] / 2.0 == pytest.approx(np.exp(-10.0 * 0.01), abs=5e-3)


def fluttering(stepper) -> float:
    """Closing error of the ledger of a spinning, fluttering film after 0.1 s."""
    law = gx.Miyazaki(E=1e7, nu=0.3, density=1400.0, thickness=1e-4, residual_stiffness=1e-3)
    film = gx.Membrane(
        sheet(COMM, 4, 4),
        law,
        velocity=lambda x: np.vstack([-10 * (x[1] - 0.5), 10 * (x[0] - 0.5), np.sin(np.pi * x[0])]),
    )
    run = gx.Simulation(gx.Scene(film), stepper)
    run.run(until=0.1)
    return abs(run.energy_error)


def test_drifts_where_the_midpoint_rule_does_not() -> None:
    # The midpoint rule closes the ledger to round-off.
    assert fluttering(gx.Midpoint(dt=2e-3)) < 1e-12
    # This method has no discrete energy, so its error is that of the step, far above round-off.
    assert fluttering(gx.GeneralizedAlpha(dt=2e-3, spectral_radius=0.8)) > 1e-6


def test_contact_is_refused():
    """A film that fell on a floor came back at three times its height, with an open energy
    balance."""
    sheet = contact_film(MPI.COMM_SELF)
    floor = gx.contact.Plane(point=(0.0, 0.0, -0.01), normal=(0.0, 0.0, 1.0))
    scene = gx.Scene(gx.Contact(sheet, floor, distance=1e-3))
    with pytest.raises(gx.InputError, match="GeneralizedAlpha: the scene has contact"):
        gx.Simulation(scene, gx.GeneralizedAlpha(dt=1e-4))
