"""The numbering of unknowns: which scenes have matrices of blocks of three."""

from __future__ import annotations

import pytest

import gossamer_fx as gx
from tests.unit.test_eliminated_joints import hung_film


def revolute(hub):
    return gx.constraints.RevoluteJoint(hub.frame(), gx.ground_frame(), axis=(0, 0, 1))


def spin(hub):
    return gx.RigidMotion(spin=(0, 0, 1.0))


@pytest.mark.mpi
@pytest.mark.parametrize(("more", "size"), [((spin,), 3), ((spin, revolute), 1)])
def test_a_hub_leaves_blocks_of_three_unless_a_joint_has_five_constraints(comm, more, size):
    """Both make steps that keep the energy."""
    run = hung_film(comm, 4, *more)
    assert run.system.A.getBlockSize() == size
    run.run(until=5e-3)
    assert abs(run.energy_error) < 1e-12 * run.totals.energy
