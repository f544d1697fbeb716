"""Probes of scenes that fly: the orbit, light, attitude, and what acts."""

from __future__ import annotations

import math

import numpy as np
from mpi4py import MPI

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.forms.spaces import cell_nodes
from gossamer_fx.model.body import Array, Port
from gossamer_fx.model.roles import Resultants, playing
from gossamer_fx.orbit.elements import elements_of
from gossamer_fx.orbit.environment import local_axes
from gossamer_fx.orbit.orbit import Orbit
from gossamer_fx.probes.points import AXES
from gossamer_fx.probes.run import Run

ELEMENTS = ("a", "e", "i", "node", "perigee", "anomaly")
ORBITAL = (*ELEMENTS, "altitude", "depth", "sunlit")
ACTIONS = ("force", "torque")


@check_arguments
class OrbitState:
    """Of the orbit of the centre of mass, a quantity:

    osculating elements "a" [m], "e", "i", "node", "perigee", "anomaly" [rad]; "altitude" [m]; "depth" [m] in the
    cylinder of the shadow, negative outside: an eclipse begins and ends where it is zero; "sunlit", the part of the Sun
    that is seen.
    """

    def __init__(self, orbit: Orbit, quantity: str) -> None:
        check(
            quantity in ORBITAL,
            f"An orbit has no quantity {quantity!r}; its quantities are: {', '.join(ORBITAL)}.",
        )
        self.orbit, self.quantity = orbit, quantity

    def __call__(self, run: Run) -> float:
        r, v = self.orbit.flight(run.system).state()
        if self.quantity in ELEMENTS:
            return float(getattr(elements_of(r, v, self.orbit.mu), self.quantity))
        if self.quantity == "altitude":
            return float(np.linalg.norm(r)) - self.orbit.radius
        if self.quantity == "depth":
            return self.orbit.depth(r, run.time)
        return self.orbit.sunlit(r, self.orbit.sun(run.time))


@check_arguments
class SunAngle:
    """Angle [rad] between the direction to the Sun and a film's mean normal, or a director such as that of a frame."""

    def __init__(self, orbit: Orbit, of: Membrane | Port) -> None:
        check(
            isinstance(of, Membrane | Port),
            f"SunAngle of {of!r}; give a film, or a director such as body.frame().directors[2].",
        )
        self.orbit, self.of = orbit, of

    def __call__(self, run: Run) -> float:
        r, _ = self.orbit.flight(run.system).state()
        return _angle(self.orbit.sun(run.time) - r, direction_of(run, self.of))


@check_arguments
class Attitude:
    """Angle [rad] between a director or a film's mean normal and an axis of the orbit: "outward", "along", "across"."""

    NAMES = ("outward", "along", "across")

    def __init__(self, orbit: Orbit, of: Membrane | Port, *, axis: str) -> None:
        check(
            isinstance(of, Membrane | Port),
            f"Attitude of {of!r}; give a film, or a director such as body.frame().directors[2].",
        )
        check(
            axis in self.NAMES,
            f"An orbit has no axis {axis!r}; its axes are: {', '.join(self.NAMES)}.",
        )
        self.orbit, self.of, self.axis = orbit, of, axis

    def __call__(self, run: Run) -> float:
        axes = local_axes(*self.orbit.flight(run.system).state())
        return _angle(axes[:, self.NAMES.index(self.axis)], direction_of(run, self.of))


@check_arguments
class LoadResultant:
    """Component of the "force" [N] or of the "torque" about the centre of mass [N m] of a load in the last step.

    `load` is the name of a load; that of the orbit is gravity, less the acceleration of the frame.
    """

    def __init__(self, orbit: Orbit, load: str, *, action: str, axis: str) -> None:
        check(action in ACTIONS, f"A load has no {action!r}; it has: {', '.join(ACTIONS)}.")
        check(
            axis in AXES,
            f"A vector has no component {axis!r}; its components are: {', '.join(AXES)}.",
        )
        self.orbit, self.load, self.action, self.axis = orbit, load, action, axis

    def __call__(self, run: Run) -> float:
        force, torque = resultant(run, self.load)
        about = torque - np.cross(self.orbit.flight(run.system).centre, force)
        return float((force if self.action == "force" else about)[AXES[self.axis]])


def resultant(run: Run, load: str) -> Array:
    """Force and torque about the origin (2, 3) of a load in the last step, over all ranks."""
    found = [
        each[load]
        for each in (kind.resultants() for kind in playing(Resultants, run.system.compiled))
        if load in each
    ]
    known = run.comm.allreduce(len(found))
    check(known > 0 or run.step == 0, f"The scene has no load '{load}'.")
    total: Array = run.comm.allreduce(np.sum([np.zeros((2, 3)), *found], axis=0))
    return total


def direction_of(run: Run, of: Membrane | Port) -> Array:
    """The mean normal of a film, Σ of its triangles' area vectors, or the vector of a port; (3,)."""
    if isinstance(of, Port):
        return run.system.state.vector(of)
    x = run.system.fields[of].q0.x.array.reshape(-1, 3)
    owned = of.mesh.domain.topology.index_map(2).size_local
    a, b, c = np.moveaxis(x[cell_nodes(of.space)[:owned, :3]], 1, 0)
    total: Array = run.comm.allreduce(np.cross(b - a, c - a).sum(axis=0), op=MPI.SUM)
    return total


def _angle(a: Array, b: Array) -> float:
    return math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))
