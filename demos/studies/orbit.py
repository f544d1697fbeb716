"""Flights: Kepler's motion of rigid and flexible bodies, drift by oblateness, libration by the
tide.

    rigid, flexible   10 revolutions, a = 7000 km, e = 0.1, of a tumbling body and of a dumbbell on
                      a spring of 20 m: 1 + |R - R_exact|/a of the centre of mass, by Kepler's
                      equation
    node              drift of the node by J2, a = 7000 km, i = 50°, circular: slope of its angle
                      over 5 revolutions
    perigee, polar    drift of the perigee by J2, e = 0.1, i = 50° and 85°: its slope less that of
                      the same flight without J2, of which Kepler's law has none and a step of
                      finite length some
    critical          the same at i = 63.4349°, where it almost stops: 1 + (drift - exact)/(the
                      drift at i = 0)
    swing, wide swing time of a quarter of the libration of a bar in a circular orbit, from 1e-3 rad
    and from 40°, over
                      K(sin²θ)/(√3 n)

The exact drifts are those of an eighth-order integration of the whole equations; the formulas of
first order in J2, -3/2 n J2 (a_E/p)² cos i for the node, are some 0.4 % off.

`energy` and `momentum` are the closing error of the ledger and the change of the angular momentum
of the whole.  The ledger holds the motion about the centre of mass, 1 mJ of the dumbbell.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from mpi4py import MPI
from scipy.integrate import solve_ivp
from scipy.special import ellipk

import gossamer_fx as gx
from demos.studies.engine.study import Measure, Study
from gossamer_fx.extend import EARTH_J2, EARTH_MU, EARTH_RADIUS

# Semi-major axis [m] of all orbits: 620 km above the Earth.
A = 7e6
# Radius [m] that the Earth is given: with its own the perigees of e = 0.1 are below the ground.
CENTRE_RADIUS = 6e6
# Mean motion [rad/s], and time of a revolution [s].
RATE = math.sqrt(EARTH_MU / A**3)
REVOLUTION = 2 * math.pi / RATE
# Time [s] between readings of drifting angles: a multiple of all steps.
EVERY = 120.0
# Initial angle [rad] of the bar from the vertical; the large one makes the motion an elliptic
# function.
SWINGS = {"swing": 1e-3, "wide swing": math.radians(40)}
# The angle that drifts, eccentricity and inclination [rad] of the orbit.
DRIFTS = {
    "node": ("node", 0.0, math.radians(50)),
    "perigee": ("perigee", 0.1, math.radians(50)),
    "polar": ("perigee", 0.1, math.radians(85)),
    "critical": ("perigee", 0.1, math.radians(63.4349)),
}


def problem(comm: MPI.Comm, scene: str, h: float) -> dict[str, float]:
    """Fly one scene with steps of h [s]; `result/exact` is what the module lists for the scene."""
    if scene in SWINGS:
        run, result = libration(comm, SWINGS[scene], h)
    elif scene in DRIFTS:
        angle, e, i = DRIFTS[scene]
        run, result = drift(
            comm,
            angle,
            e,
            i,
            h,
            critical=scene == "critical",
        )
    else:
        run, result = keplers_motion(comm, scene, h)
    # The torque of an oblate Earth is a load, which changes the angular momentum.
    momentum_change = math.nan
    if scene not in DRIFTS:
        first = run.first.angular_momentum
        change = run.totals.angular_momentum - first
        momentum_change = float(np.linalg.norm(change) / np.linalg.norm(first))
    return {
        "result/exact": result,
        "energy": abs(run.energy_error),
        "momentum": momentum_change,
        "iterations": run.iterations / run.step,
        "seconds": run.seconds,
    }


def keplers_motion(comm: MPI.Comm, scene: str, h: float) -> tuple[gx.Simulation, float]:
    """Ten revolutions of a rigid or a flexible body, and how far it is from where it should be."""
    orbit = gx.orbit.Orbit(gx.orbit.Elements(A, 0.1), radius=CENTRE_RADIUS)
    # Three different moments of inertia: the body tumbles.
    tumbling = gx.RigidBody(
        20.0,
        (1.0, 2.0, 2.5),
        spin=(0.002, 0.001, 0.003),
        comm=comm,
    )
    bodies: list[Any] = [tumbling]
    if scene == "flexible":
        # A dumbbell of 20 m that turns once a revolution.
        arm = np.array([8.0, 6.0, 0.0])
        velocity = RATE * np.array([-6.0, 8.0, 0.0])
        a = gx.PointMass(
            10.0,
            tuple(-arm),
            velocity=tuple(-velocity),
            comm=comm,
            name="a",
        )
        b = gx.PointMass(
            10.0,
            tuple(arm),
            velocity=tuple(velocity),
            comm=comm,
            name="b",
        )
        spring = gx.connectors.Spring(
            a.port(),
            b.port(),
            stiffness=1e5,
            length=20.0,
        )
        bodies = [a, b, spring]
    run = gx.Simulation(gx.Scene(*bodies, orbit), gx.Midpoint(dt=h))
    run.run(until=10 * REVOLUTION)
    here, _ = orbit.flight(run.system.unknowns).state()
    exact, _ = gx.orbit.Elements(A, 0.1).after(run.time).state()
    return run, 1 + float(np.linalg.norm(here - exact)) / A


def libration(comm: MPI.Comm, angle: float, h: float) -> tuple[gx.Simulation, float]:
    """A bar that swings about the vertical, and its quarter of a period over the exact one."""
    orbit = gx.orbit.Orbit(gx.orbit.Elements(A, 0.0))
    c = math.cos(angle)
    s = math.sin(angle)
    turned = ((c, -s, 0), (s, c, 0), (0, 0, 1))
    # A moment of inertia about its own axis that is small, as of a bar, and not zero.
    bar = gx.RigidBody(
        20.0,
        (1e-3, 600.0, 600.0),
        attitude=turned,
        spin=(0, 0, RATE),
        comm=comm,
    )

    def from_the_vertical(run: gx.Simulation) -> float:
        """Sine of the angle between the bar and the vertical, in the plane of the orbit."""
        axis = run.system.unknowns.state.vectors([bar.frame().directors[0]])[0]
        outward = orbit.flight(run.system.unknowns).origin.R0
        return float(outward[0] * axis[1] - outward[1] * axis[0]) / A

    exact = float(ellipk(s**2)) / (math.sqrt(3) * RATE)
    vertical = gx.When(
        from_the_vertical,
        falling=True,
        stop=True,
        tolerance=1e-3,
    )
    run = gx.Simulation(
        gx.Scene(bar, orbit),
        gx.Midpoint(dt=h),
        events=[vertical],
    )
    run.run(until=2 * exact)
    return run, run.time / exact


def drift(
    comm: MPI.Comm, angle: str, e: float, i: float, h: float, critical: bool
) -> tuple[gx.Simulation, float]:
    """A flight over an oblate Earth, and the drift of an angle of its orbit over the exact one."""
    elements = gx.orbit.Elements(
        A,
        e,
        i=i,
        node=1.0,
        perigee=1.0,
    )
    times = np.arange(EVERY, 5 * REVOLUTION, EVERY)
    run, rate = _flight(comm, elements, "J2", angle, times, h)
    # Steps of finite length turn the perigee also without J2.
    if angle == "perigee":
        _, rate_without_j2 = _flight(comm, elements, "point", angle, times, h)
        rate -= rate_without_j2
    exact = _exact_drift(elements, angle, times)
    scale = exact
    # At the critical inclination the exact drift is almost zero, and no scale.
    if critical:
        semi_latus_rectum = A * (1 - e**2)
        scale = 3 * RATE * EARTH_J2 * (EARTH_RADIUS / semi_latus_rectum) ** 2
    return run, 1 + (rate - exact) / scale


def _flight(
    comm: MPI.Comm,
    elements: gx.orbit.Elements,
    gravity: str,
    angle: str,
    times: np.ndarray,
    h: float,
) -> tuple[gx.Simulation, float]:
    """A flight of a point mass, and the slope [rad/s] of an angle of its orbit over the times
    [s]."""
    orbit = gx.orbit.Orbit(elements, gravity=gravity, radius=CENTRE_RADIUS)
    scene = gx.Scene(gx.PointMass(20.0, comm=comm), orbit)
    run = gx.Simulation(scene, gx.Midpoint(dt=h))
    probe = gx.probes.OrbitState(orbit, angle)
    angles = []
    for t in times:
        run.run(until=t)
        angles.append(probe(run))
    return run, _slope(times, angles)


def _exact_drift(elements: gx.orbit.Elements, angle: str, times: np.ndarray) -> float:
    """The same slope [rad/s] from an integration of the whole equations by an eighth-order
    method."""

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        """Velocity and acceleration (6,) for position and velocity y (6,), gravity with J2."""
        r = float(np.linalg.norm(y[:3]))
        bulge = 1.5 * EARTH_J2 * (EARTH_RADIUS / r) ** 2
        along = 1 + bulge * (np.array([1.0, 1.0, 3.0]) - 5 * (y[2] / r) ** 2)
        return np.concatenate([y[3:], -EARTH_MU / r**3 * along * y[:3]])

    start = np.concatenate(elements.state())
    # Tolerances near round-off: 1 µm of 7000 km.
    solution = solve_ivp(
        rates,
        (0.0, times[-1]),
        start,
        method="DOP853",
        t_eval=times,
        rtol=1e-13,
        atol=1e-6,
    )
    angles = []
    for y in solution.y.T:
        angles.append(getattr(gx.orbit.elements_of(y[:3], y[3:]), angle))
    return _slope(times, angles)


def _slope(times: np.ndarray, angles: list[float]) -> float:
    """Of a straight line through angles that swing within each revolution, over whole ones."""
    return float(np.polyfit(times, np.unwrap(angles), 1)[0])


STUDY = Study(
    "orbit",
    "Flights by Kepler's laws, oblateness and the tide",
    problem,
    {"scene": ["rigid", "flexible", *DRIFTS, *SWINGS], "h": [60.0, 30.0, 15.0]},
    lambda case: case["h"],
    (Measure("result/exact", 1.0, 1e-3, lambda case: 2.0),),
    quick={"scene": list(SWINGS), "h": [60.0, 30.0]},
    shows=("energy", "momentum"),
    columns="energy, momentum, iterations, seconds",
)
