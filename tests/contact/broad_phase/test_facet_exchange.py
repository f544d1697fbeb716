"""Each rank knows its own facets and those near them, and together the ranks find the pairs of one
rank."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI
from scipy.spatial import KDTree

import gossamer_fx as gx
from gossamer_fx.mechanics.contact.broad_phase.candidates import GROUP_COUNT, group_boxes
from tests.contact.scenes import ARM, contact_set_of, simulate, two_films

CELLS = 24  # along a side of each film


def falling(comm):
    """A wide film that falls on another one; the activation distance is a fortieth of a cell."""
    lower, upper = two_films(comm, height=1.5e-3, turn=0.1, n=CELLS, size=1.0)
    return simulate([gx.Contact(lower, upper, distance=1e-3)], until=4e-4)


@pytest.mark.mpi
def test_no_rank_knows_all_facets(comm):
    run = falling(comm)
    contact_set = contact_set_of(run)
    mesh = contact_set.mesh
    whole = mesh.share.point_count
    # Owned once each, whatever else a rank knows.
    assert comm.allreduce(int(mesh.shared.is_own.sum())) == whole
    own_count = len(mesh.share.surface.points)
    foreign_count = len(mesh.known.points) - own_count
    if comm.size == 1:
        assert foreign_count == 0
        return
    # Of the films of other ranks a rank knows what is near its own: a strip along the boundary, or
    # all of the half of a film that the partition has put above its own half.
    assert foreign_count > 0
    is_own = np.isin(mesh.known.points.number, mesh.share.surface.points.number)
    x = mesh.points.at(run.system.unknowns.q0, run.system.unknowns.time)
    to_nearest, _ = KDTree(x[is_own]).query(x[~is_own])
    assert to_nearest.max() < 0.25
    # The unknowns that are fetched in each iteration are those of the known points.
    assert len(contact_set.points.first_dof) == len(mesh.known.points)


@pytest.mark.mpi
def test_ranks_find_the_pairs_that_one_rank_finds(comm):
    divided = falling(comm)
    alone = falling(MPI.COMM_SELF)
    of_ranks = comm.allgather(contact_set_of(divided).candidates.identifier)
    found = np.concatenate(of_ranks)
    assert len(np.unique(found)) == len(found)
    expected = contact_set_of(alone).candidates.identifier
    assert len(expected) > 100
    # Bounds of trajectories depend on round-off, so that a pair at the limit may be found by one
    # search only.
    difference = np.setxor1d(found, expected)
    assert len(difference) <= 0.001 * len(expected)


@pytest.mark.mpi
def test_steps_do_not_depend_on_the_number_of_ranks(comm):
    divided = falling(comm)
    alone = falling(MPI.COMM_SELF)
    assert divided.iterations == alone.iterations
    assert contact_set_of(divided).closest == pytest.approx(contact_set_of(alone).closest, rel=1e-9)
    now = divided.totals
    expected = alone.totals
    assert now.stored["contact"] > 0.1 * now.energy
    for name, energy in expected.stored.items():
        assert now.stored[name] == pytest.approx(energy, abs=1e-10 * expected.energy)
    size = ARM * np.abs(expected.momentum).max()
    assert now.momentum == pytest.approx(expected.momentum, abs=1e-10 * size)
    assert now.angular_momentum == pytest.approx(expected.angular_momentum, abs=1e-9 * size)


@pytest.mark.mpi
def test_a_checkpoint_holds_the_activation_distances_of_all_points(comm):
    history = contact_set_of(falling(comm)).history
    saved = history.get_history()
    expected = contact_set_of(falling(MPI.COMM_SELF)).history.get_history()
    distances = saved["activation distance"].of_all_ranks(comm)
    assert distances.values == pytest.approx(expected["activation distance"].values, rel=1e-9)
    pairs = saved["stiffness"].of_all_ranks(comm)
    assert pairs.names.tolist() == expected["stiffness"].names.tolist()
    before = history.activation_distance.copy()
    history.set_history(expected)
    assert history.activation_distance == pytest.approx(before, rel=1e-9)


def test_boxes_of_groups_hold_all_boxes():
    rng = np.random.default_rng(1)
    lower = rng.uniform(size=(1000, 3))
    boxes = np.hstack([lower, lower + rng.uniform(0.0, 0.1, (1000, 3))])
    groups = group_boxes(boxes)
    assert len(groups) == GROUP_COUNT
    inside = (groups[:, None, :3] <= boxes[:, :3]) & (groups[:, None, 3:] >= boxes[:, 3:])
    assert inside.all(axis=2).any(axis=0).all()
    # Groups are of neighbours: together they have less volume than one box round all for each.
    volume = np.prod(groups[:, 3:] - groups[:, :3], axis=1)
    assert volume.sum() < 8
    assert len(group_boxes(boxes[:0])) == 0
