"""Flights: Kepler's motion of rigid and flexible bodies, drift by oblateness, libration by the tide.

    rigid, flexible   10 revolutions, a = 7000 km, e = 0.1, of a tumbling body and of a dumbbell on a spring of 20 m:
                      1 + |R - R_exact|/a of the centre of mass, by Kepler's equation
    node              20 revolutions under J2, a = 7000 km, i = 50°: slope of the node's angle over -9.381567e-7 rad/s
                      that an integration of the whole equations has; -3/2 n J2 (a_E/p)² cos i is 0.4 % less
    swing, wide swing time of a quarter of the libration of a bar in a circular orbit, from 1e-3 rad and from 40°, over
                      K(sin²θ)/(√3 n)

`energy` and `momentum` are the closing error of the ledger and the change of the angular momentum of the whole.  The
ledger holds the motion about the centre of mass, 1 mJ of the dumbbell; the round-off of its spring's force (1e5 N/m times
20 m times 1e-16) along paths of metres is 1e-9 J a step of that, and 1e-17 of the energy of the orbit.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from mpi4py import MPI
from scipy.special import ellipk

import gossamer_fx as gx
from demos.studies.engine.study import Measure, Study
from gossamer_fx.algebra.places import values_of

A = 7e6
NODE_RATE = -9.381567e-7  # rad/s
SWINGS = {"swing": 1e-3, "wide swing": math.radians(40)}


def dumbbell(comm: MPI.Comm, rate: float) -> list[Any]:
    arm, v = np.array([8.0, 6.0, 0.0]), rate * np.array([-6.0, 8.0, 0.0])
    a, b = (gx.PointMass(10.0, tuple(s * arm), tuple(s * v), comm=comm, name=n) for s, n in ((-1, "a"), (1, "b")))
    return [a, b, gx.Spring(a.port(), b.port(), stiffness=1e5, length=20.0)]


def problem(comm: MPI.Comm, scene: str, h: float) -> dict[str, float]:
    orbit = gx.Orbit(
        gx.Elements(A, 0.0, math.radians(50)) if scene == "node" else gx.Elements(A, 0.1 * (scene not in SWINGS)),
        gravity="J2" if scene == "node" else "point",
    )
    n = math.sqrt(orbit.mu / A**3)
    events, until = [], 20 * math.pi / n
    if scene == "flexible":
        bodies = dumbbell(comm, n)
    elif scene in SWINGS:
        angle = SWINGS[scene]
        c, s = math.cos(angle), math.sin(angle)
        turned = ((c, -s, 0), (s, c, 0), (0, 0, 1))
        bar = gx.RigidBody(20.0, (1e-3, 600.0, 600.0), attitude=turned, spin=(0, 0, n), comm=comm)

        def from_the_vertical(run: gx.Simulation) -> float:
            d = values_of(run.system, [bar.frame().directors[0]], run.system.q0)[0]
            R = orbit.flight(run.system).origin.R0
            return float(R[0] * d[1] - R[1] * d[0]) / A

        bodies, exact = [bar], float(ellipk(s**2)) / (math.sqrt(3) * n)
        events, until = [gx.When(from_the_vertical, falling=True, stop=True, tolerance=1e-3)], 2 * exact
    else:
        bodies = [gx.RigidBody(20.0, (1.0, 2.0, 2.5), spin=(0.002, 0.001, 0.003), comm=comm)]
        until *= 2 if scene == "node" else 1
    run = gx.Simulation(gx.Scene(*bodies, orbit), gx.Midpoint(dt=h), events=events)
    start = run.first.angular_momentum
    angles = []
    times = np.arange(240.0, until, 240.0) if scene == "node" else np.array([until])
    for t in times:
        run.run(until=t)
        angles.append(gx.OrbitState(orbit, "node")(run) if scene == "node" else 0.0)
    r, _ = orbit.flight(run.system).state()
    if scene == "node":
        # the node swings twice a revolution: over whole ones a straight line does not see that
        result = np.polyfit(times, np.unwrap(angles), 1)[0] / NODE_RATE
    elif scene in SWINGS:
        result = run.time / exact
    else:
        where, _ = gx.Elements(A, 0.1).after(run.time).state()
        result = 1 + float(np.linalg.norm(r - where)) / A
    change = np.linalg.norm(run.totals.angular_momentum - start) / np.linalg.norm(start)
    return {
        "result/exact": result,
        "energy": abs(run.energy_error),
        "momentum": float(change) if scene != "node" else math.nan,
        "iterations": run.iterations / run.step,
        "seconds": run.seconds,
    }


STUDY = Study(
    "orbit",
    "Flights by Kepler's laws, oblateness and the tide",
    problem,
    {"scene": ["rigid", "flexible", "node", *SWINGS], "h": [60.0, 30.0, 15.0]},
    lambda case: case["h"],
    (Measure("result/exact", 1.0, 1e-3, lambda case: 2.0),),
    quick={"scene": list(SWINGS), "h": [60.0, 30.0]},
    columns=("energy", "momentum", "iterations", "seconds"),
)
