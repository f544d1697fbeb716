"""Scenes of contact for tests, and functions that evaluate them."""

from __future__ import annotations

import numpy as np

import gossamer_fx as gx
from gossamer_fx.mechanics.contact.contact_set import ContactSet
from gossamer_fx.mechanics.contact.narrow_phase.intersections import find_intersections
from gossamer_fx.mechanics.contact.obstacles import Obstacle
from gossamer_fx.meshes.sheet import sheet

# A polymer film of 0.1 mm, of 0.14 kg/m².
FILM = {"E": 1e9, "nu": 0.3, "density": 1400.0, "thickness": 1e-4}

# Area density of this film [kg/m²].
SIGMA = 0.14

# Least size [m] of a scene: angular momenta are compared with at least the momentum times this arm.
ARM = 0.05


def film(
    comm,
    n=4,
    size=0.1,
    height=0.0,
    velocity=(0.0, 0.0, 0.0),
    turn=0.0,
    name="film",
    order=1,
    at=(0.0, 0.0),
):
    """Return a square film of n x n x 2 cells about (at, height) [m], turned about z [rad]."""
    c = np.cos(turn)
    s = np.sin(turn)

    def displacement(X):
        x = X[0] - size / 2
        y = X[1] - size / 2
        moved = [c * x - s * y + at[0], s * x + c * y + at[1], 0 * x + height]
        return np.vstack(moved) - X

    return gx.Membrane(
        sheet(comm, n, n, size, size),
        gx.Miyazaki(**FILM, residual_stiffness=1e-6),
        name=name,
        order=order,
        displacement=displacement,
        velocity=lambda X: np.outer(velocity, np.ones(X.shape[1])),
    )


def leaf(comm, n=4, *, angle=0.0, spin=0.0, order=1, name="leaf", shift=0.0, law=None):
    """A square film of 0.1 m on the y axis, turned about it, with a spin about it [rad/s]."""
    c = np.cos(angle)
    s = np.sin(angle)
    return gx.Membrane(
        sheet(comm, 4, n, 0.1, 0.1),
        law or gx.Miyazaki(**FILM, residual_stiffness=1e-6),
        name=name,
        order=order,
        displacement=lambda X: np.vstack([c * X[0], X[1], s * X[0] + shift]) - X,
        velocity=lambda X: np.vstack([-s * spin * X[0], 0 * X[0], c * spin * X[0]]),
    )


def two_films(comm, height, velocity=(0.2, 0.1, -2.0), turn=0.4, **options):
    """Return a film, and one above it at a height [m], turned and shifted, that falls on it."""
    lower = film(comm, name="lower", **options)
    given = {"height": height, "velocity": velocity, "turn": turn, "at": (0.01, 0.005)}
    return lower, film(comm, name="upper", **given, **options)


def obstacle_of(kind: str, block: gx.RigidBody, **given) -> Obstacle:
    """Return an obstacle on a block, in the way of a film that falls from z = 0."""
    makes, geometry = {
        "plane": (gx.contact.Plane, {"point": (0, 0, -0.008), "normal": (0.1, 0, 1)}),
        "ball": (gx.contact.Sphere, {"centre": (0, 0, -0.022), "radius": 0.02}),
        "cylinder": (
            gx.contact.Cylinder,
            {"start": (-0.06, 0, -0.022), "end": (0.03, 0, -0.022), "radius": 0.02},
        ),
        "box": (gx.contact.Box, {"centre": (0, 0, -0.022), "sizes": (0.04, 0.04, 0.04)}),
        "cone": (
            gx.contact.Cone,
            {"start": (0.01, 0, -0.06), "end": (0.003, 0, -0.005), "radii": (0.04, 0.004)},
        ),
        "in ball": (gx.contact.Sphere, {"centre": (0, 0, 0.02), "radius": 0.077, "inside": True}),
        "in cylinder": (
            gx.contact.Cylinder,
            {"start": (0, 0, 0.01), "end": (1, 0, 0.01), "radius": 0.0523, "inside": True},
        ),
        "in cone": (
            gx.contact.Cone,
            {"start": (0, 0, -0.15), "end": (0, 0, 0.05), "radii": (0, 0.0972), "inside": True},
        ),
        "in box": (
            gx.contact.Box,
            {"centre": (0, 0, 0), "sizes": (0.12, 0.12, 0.006), "inside": True},
        ),
    }[kind]
    return makes(**geometry, body=block, **given)


def contact_set_of(run) -> ContactSet:
    """Return the only contact of a run."""
    (contact_set,) = (c for c in run.system.equations.compiled if isinstance(c, ContactSet))
    return contact_set


def count_intersections(run) -> int:
    """Return how many pairs of an edge and a triangle intersect, over all ranks."""
    contact_set = contact_set_of(run)
    mesh = contact_set.mesh
    x = contact_set.points.at(run.system.unknowns.q0, run.system.unknowns.time)
    found = find_intersections(mesh.surface, x, mesh.own_edges)
    return run.system.comm.allreduce(len(found))


def assert_conserved(run, energy=1e-9, momentum=1e-11) -> None:
    """Assert that energy, less supplied work, and both momenta are those of the start."""
    first = run.first
    now = run.totals
    assert abs(run.energy_error) < energy
    size = np.abs(first.momentum).max() or 1.0
    error = np.abs(now.momentum - first.momentum).max()
    assert error < momentum * size
    # Angular momentum that is zero by symmetry is compared with momentum times an arm.
    size = max(np.abs(first.angular_momentum).max(), ARM * size)
    error = np.abs(now.angular_momentum - first.angular_momentum).max()
    assert error < momentum * size


def simulate(items, until, dt=1e-4, **options):
    """Run a scene of these items until a time [s] in steps of dt [s]."""
    run = gx.Simulation(gx.Scene(*items), gx.Midpoint(dt=dt), **options)
    run.run(until=until)
    return run
