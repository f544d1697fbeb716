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
@pytest.mark.parametrize("more", [(spin,), (spin, revolute)])
def test_hubs_and_joints_leave_blocks_of_three(comm, more):
    """The five multipliers of a revolute joint are completed by an unknown that stays zero; steps
    keep the energy."""
    run = hung_film(comm, 4, *more)
    system = run.system
    assert system.matrices.A.getBlockSize() == 3
    run.run(until=5e-3)
    assert abs(run.energy_error) < 1e-12 * run.totals.energy
    unused = system.unknowns.q0.array_r[system.unknowns.numbering.unused]
    assert comm.allreduce(len(unused)) == len(more) - 1
    assert not unused.any()
