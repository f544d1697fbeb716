"""Scenes of contact for tests and what is asked of them."""

from __future__ import annotations

import numpy as np

import gossamer_fx as gx
from gossamer_fx.contact.compiled import CompiledContacts
from gossamer_fx.contact.contact_set import ContactSet
from gossamer_fx.contact.narrow_phase.intersections import intersections
from meshes.sheet import sheet

FILM = {"E": 1e9, "nu": 0.3, "density": 1400.0, "thickness": 1e-4}
SIGMA = 0.14  # kg/m²


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
    """A square film about (at, height), turned about z, at a velocity [m/s]."""
    c, s = np.cos(turn), np.sin(turn)

    def moved(X):
        x, y = X[0] - size / 2, X[1] - size / 2
        return np.vstack([c * x - s * y + at[0], s * x + c * y + at[1], 0 * x + height]) - X

    return gx.Membrane(
        sheet(comm, n, n, size, size),
        gx.Miyazaki(**FILM, residual_stiffness=1e-6),
        name=name,
        order=order,
        displacement=moved,
        velocity=lambda X: np.outer(velocity, np.ones(X.shape[1])),
    )


def solid_of(
    kind: str, block: gx.RigidBody, **given
) -> gx.contact.Plane | gx.contact.Sphere | gx.contact.Cylinder | gx.contact.Box:
    """A solid that is a part of a block, in the way of a film that falls from z = 0."""
    makes, where = {
        "plane": (gx.contact.Plane, {"point": (0, 0, -0.008), "normal": (0.1, 0, 1)}),
        "ball": (gx.contact.Sphere, {"centre": (0, 0, -0.022), "radius": 0.02}),
        "cylinder": (
            gx.contact.Cylinder,
            {"start": (-0.06, 0, -0.022), "end": (0.03, 0, -0.022), "radius": 0.02},
        ),
        "box": (gx.contact.Box, {"centre": (0, 0, -0.022), "sizes": (0.04, 0.04, 0.04)}),
        "in ball": (gx.contact.Sphere, {"centre": (0, 0, 0.02), "radius": 0.077, "inside": True}),
        "in cylinder": (
            gx.contact.Cylinder,
            {"start": (0, 0, 0.01), "end": (1, 0, 0.01), "radius": 0.0523, "inside": True},
        ),
        "in box": (
            gx.contact.Box,
            {"centre": (0, 0, 0), "sizes": (0.12, 0.12, 0.006), "inside": True},
        ),
    }[kind]
    return makes(**where, body=block, **given)


def group_of(run) -> ContactSet:
    """The only contact of a run."""
    (group,) = next(
        c for c in run.system.compiled if isinstance(c, CompiledContacts)
    ).groups.values()
    return group


def pierced(run) -> int:
    """Edges that pierce triangles, over all ranks."""
    group, system = group_of(run), run.system
    found = intersections(
        group.bodies.surface, group.points.at(system.q0, system.time), group.bodies.own_edges
    )
    return system.comm.allreduce(len(found))


def conserved(run, energy=1e-9, momentum=1e-11) -> None:
    """Energy and both momenta are those of the start, supplied work counted."""
    first, now = run.first, run.totals
    assert abs(run.energy_error) < energy
    size = np.abs(first.momentum).max() or 1.0
    assert np.abs(now.momentum - first.momentum).max() < momentum * size
    size = max(np.abs(first.angular_momentum).max(), 0.05 * size)  # the films are 0.1 m large
    assert np.abs(now.angular_momentum - first.angular_momentum).max() < momentum * size


def simulate(items, until, dt=1e-4, **options):
    """Run a scene."""
    run = gx.Simulation(gx.Scene(*items), gx.Midpoint(dt=dt), **options)
    run.run(until=until)
    return run
