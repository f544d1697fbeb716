"""A rigid body that turns about a fixed point under its weight: a pendulum or a heavy top.

The motion is computed with the steps of the case file and with steps of half their length, and
extrapolated by h².
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from scipy.spatial.transform import Rotation

import gossamer_fx as gx
from demos.validation.engine.case import Array, Inputs
from demos.validation.engine.comparison import Predicted, Prediction
from gossamer_fx.extend import check

# Steps of the quick form over those of the case file.
QUICK_SHARE = 0.5


@dataclass(frozen=True)
class TurningBody:
    """A body about a fixed point at the origin, in SI units.

    Attributes:
        mass: of the body.
        inertia: about its centre of mass along x, y, z.
        centre: of mass at the start.
        spin: at the start.
        gravity: acceleration.
    """

    mass: float
    inertia: Array
    centre: Array
    spin: Array
    gravity: Array

    @classmethod
    def read(cls, inputs: Inputs) -> TurningBody:
        """The body of a case file."""
        units = {"inertia": "kg m2", "centre": "m", "spin": "rad/s", "gravity": "m/s2"}
        vectors = {name: inputs.numbers(name, unit) for name, unit in units.items()}
        for name, vector in vectors.items():
            check(len(vector) == 3, f"{inputs.where}: {name} has not three numbers.")
        return cls(mass=inputs.number("mass", "kg", above=0), **vectors)

    def attitudes(self, times: Array, dt: float, comm: MPI.Intracomm) -> Array:
        """Rotation matrices (n, 3, 3) at some times, which are multiples of the step dt."""
        body = gx.RigidBody(
            self.mass,
            self.inertia,
            position=self.centre.tolist(),
            velocity=np.cross(self.spin, self.centre).tolist(),
            spin=self.spin.tolist(),
            comm=comm,
        )
        fixed_point = body.port((-self.centre).tolist())
        pivot = gx.constraints.BallJoint(fixed_point, gx.Ground((0.0, 0.0, 0.0)))
        scene = gx.Scene(body, pivot, gx.Gravity(body, self.gravity.tolist()))
        run = gx.Simulation(scene, gx.Midpoint(dt=dt))
        directors = body.frame().directors
        found = []
        for t in times.tolist():
            run.run(until=t)
            columns = [run.system.unknowns.state.vector(director) for director in directors]
            attitude = np.stack(columns, axis=1)
            found.append(attitude)
        return np.array(found)


def predict(inputs: Inputs, comm: MPI.Intracomm, quick: bool) -> Prediction:
    """Displacements ux, uy, uz [m] of a point at some times, and the Euler parameters e0 to e3 of
    the body at the last of them, e0 ≥ 0."""
    begun = time.process_time()
    body = TurningBody.read(inputs)
    times = inputs.numbers("times", "s")
    point = inputs.numbers("point", "m")
    steps = inputs.whole("steps")
    if quick:
        steps = math.ceil(QUICK_SHARE * steps)
    dt = float(times[-1]) / steps
    coarse = body.attitudes(times, dt, comm)
    fine = body.attitudes(times, dt / 2, comm)
    attitudes = fine + (fine - coarse) / 3
    moved = (attitudes - np.eye(3)) @ point
    quantities = {f"u{axis}": Predicted(moved[:, k]) for k, axis in enumerate("xyz")}
    x, y, z, w = Rotation.from_matrix(attitudes[-1]).as_quat(canonical=True)
    quantities["Euler parameters"] = Predicted(np.array([w, x, y, z]))
    return Prediction(quantities, {"seconds": time.process_time() - begun})
