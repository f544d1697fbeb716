"""Newton's iteration with contact: how far an update may go."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import film, group_of

import gossamer_fx as gx
from gossamer_fx.contact.group import REACH


@pytest.mark.mpi
def test_updates_go_no_farther_than_contact_can_follow(comm):
    lower, upper = film(comm, name="lower"), film(comm, height=2e-3, name="upper", order=2)
    alone = film(comm, height=0.5, name="alone")
    run = gx.Simulation(gx.Scene(gx.Contact(lower, upper, distance=1e-3), alone), gx.Midpoint(dt=1e-4))
    system = run.system
    update = np.random.default_rng(comm.rank).normal(0.0, 5e-3, system.numbering.vector().getLocalSize())
    given = update.copy()
    system.limit(update)
    for k, body in enumerate(system.bodies):
        owned = system.numbering.owned(k)
        before, after = given[owned].reshape(-1, 3), update[owned].reshape(-1, 3)
        ways = np.linalg.norm(before, axis=1)
        longest = np.inf if body is alone else REACH * group_of(run)._d
        expected = before * np.minimum(1.0, longest / ways)[:, None] if len(ways) else before
        assert np.allclose(after, expected, rtol=1e-14)


def test_a_scene_without_contact_limits_nothing(comm):
    run = gx.Simulation(gx.Scene(film(comm)), gx.Midpoint(dt=1e-4))
    assert not run.system.searching
