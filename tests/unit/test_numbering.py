"""The numbering of unknowns: which scenes have matrices of blocks of three."""

from __future__ import annotations

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import sheet

LAW = gx.Miyazaki(1e8, 0.3, density=1400.0, thickness=1e-5)


def hung_film(comm, *more):
    """A film on two ropes from a turning hub."""
    film = gx.Membrane(sheet(comm, 4, 4), LAW, name="film")
    hub = gx.RigidBody(
        1.0,
        (1.0, 1.0, 1.0),
        comm=comm,
        name="hub",
    )
    items = [film, hub, gx.RigidMotion(spin=(0, 0, 1.0))]
    for k, corner in enumerate([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]):
        rope = gx.connectors.Rope(
            hub.port(tuple(np.subtract(corner, (0.0, 0.1, 0.0)))),
            film.port_at(corner),
            length=0.1,
            stiffness=1e2,
            name=f"rope {k}",
        )
        items.append(rope)
    return gx.Simulation(gx.Scene(*items, *(make(hub) for make in more)), gx.Midpoint(dt=1e-3))


def revolute(hub):
    return gx.constraints.RevoluteJoint(hub.frame(), gx.ground_frame(), axis=(0, 0, 1))


@pytest.mark.mpi
@pytest.mark.parametrize(("more", "size"), [((), 3), ((revolute,), 1)])
def test_a_hub_leaves_blocks_of_three_unless_a_joint_has_five_constraints(comm, more, size):
    """Both make steps that keep the energy."""
    run = hung_film(comm, *more)
    assert run.system.A.getBlockSize() == size
    run.run(until=5e-3)
    assert abs(run.energy_error) < 1e-12 * run.totals.energy
