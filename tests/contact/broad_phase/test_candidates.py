"""Candidates are complete while points are within their bounds, and few where points move
together."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.mechanics.contact.broad_phase.candidates import (
    MAX_HORIZON,
    WAY_MARGIN,
    TrajectoryBounds,
    find_candidates,
)
from gossamer_fx.mechanics.contact.pairs import closest_points
from gossamer_fx.meshes.sheet import sheet
from tests.contact.broad_phase.test_trajectory_bounds import TURN, drifted
from tests.contact.random_pairs import all_pairs, separate_triangles, table_of_primitives
from tests.small_scenes import run_until

TRIANGLES = 60
RADIUS = 2e-3
DISTANCE = 0.02


def identifier_of(kind, first, second):
    """Return a number that tells pairs of fewer than 1000 primitives apart."""
    return first * 1000 + second + 10**6 * kind


def mesh_of(surface) -> SimpleNamespace:
    """Return what a search asks a collision mesh for, without bodies."""
    count = 3 * TRIANGLES
    return SimpleNamespace(
        surface=surface,
        radius=np.full(count, RADIUS),
        area=np.ones(count),
        own_vertices=np.arange(count, dtype=np.int32),
        own_edges=np.arange(count, dtype=np.int32),
        boundaries=[],
        kinds_of=lambda kind, primitives: (kind, np.zeros(len(kind))),
        areas=lambda kind, points, primitives: np.ones(len(kind)),
        identifiers=lambda kind, primitives: identifier_of(kind.astype(int), *primitives.T),
    )


def test_no_pair_is_missed_while_points_are_within_their_bounds() -> None:
    rng = np.random.default_rng(2)
    surface = separate_triangles(TRIANGLES)
    middle = rng.uniform(size=(TRIANGLES, 1, 3))
    x = (middle + rng.normal(scale=0.05, size=(TRIANGLES, 3, 3))).reshape(-1, 3)
    velocities = np.repeat(rng.normal(scale=0.3, size=(TRIANGLES, 3)), 3, axis=0)
    margin = rng.uniform(0.01, 0.03, len(x))
    bounds = TrajectoryBounds(TURN, x, velocities, margin, duration=0.2)
    found, _ = find_candidates(mesh_of(surface), bounds, DISTANCE)  # type: ignore[arg-type]
    known = set(found.identifier.tolist())

    pairs = sorted(all_pairs(surface))
    table = table_of_primitives(surface, pairs)
    identifiers = np.array([identifier_of(*pair) for pair in pairs])
    # Fewer than half of all pairs, or the search selects nothing.
    assert len(known) < 0.5 * len(pairs)
    near_count = 0
    for time in (0.5, 0.6, 0.7):
        off = rng.normal(size=x.shape)
        # Close to the bound on most points: rng ** 0.1 is near 1.
        share = 0.999 * rng.uniform(size=len(x)) ** 0.1
        off *= (share * margin / np.linalg.norm(off, axis=1))[:, None]
        without_drift = np.ascontiguousarray(x + (time - 0.5) * velocities + off)
        assert bounds.hold(drifted(TURN, without_drift, time), time)
        # A drift changes no distance.
        gap = np.sqrt(closest_points(table, without_drift)[0]) - 2 * RADIUS
        near = identifiers[gap < DISTANCE]
        near_count += len(near)
        assert set(near.tolist()) <= known
    # Enough near pairs that missing one would show.
    assert near_count > 40


@pytest.mark.parametrize("spin", [0.0, 40.0])
def test_a_stack_that_spins_has_no_more_candidates(spin: float) -> None:
    films = [
        gx.Membrane(
            sheet(MPI.COMM_SELF, 6, 6, 0.3, 0.3),
            gx.Miyazaki(E=1e9, nu=0.3, density=1400.0, thickness=1e-4, residual_stiffness=1e-6),
            name=f"film {k}",
            displacement=lambda X, k=k: np.vstack([0 * X[0], 0 * X[0], 0 * X[0] + 3e-3 * k]),
            velocity=lambda X: spin * np.vstack([-(X[1] - 0.15), X[0] - 0.15, 0 * X[0]]),
        )
        for k in range(3)
    ]
    contact = gx.Contact(*films, distance=1e-3)
    run = run_until(1e-3, contact, dt=1e-4)
    contact_set = run.system.equations.active_sets[0]
    assert contact_set.search.count <= 4
    # 3 films of 98 nodes have some 1e5 pairs; those within reach are a few.
    assert len(contact_set.candidates) <= 100


def test_searches_become_rare_while_bodies_keep_their_velocities() -> None:
    """Two films part, each at 0.5 m/s.  A search for h steps serves for these and until its margin
    is used up, which is half of the activation distance and a part of the way."""
    dt = 1e-3
    distance = 1e-3
    speed = 0.5
    films = [
        gx.Membrane(
            sheet(MPI.COMM_SELF, 2, 2, 0.3, 0.3),
            gx.Linear(E=1e6, nu=0.3, density=1400.0, thickness=1e-4),
            name=f"film {side}",
            displacement=lambda X, side=side: np.outer([0, 0, 0.03 * side], 1 + 0 * X[0]),
            velocity=lambda X, side=side: np.outer([0, 0, speed * side], 1 + 0 * X[0]),
        )
        for side in (-1, 1)
    ]
    run = gx.Simulation(gx.Scene(gx.Contact(*films, distance=distance)), gx.Midpoint(dt=dt))
    search = run.system.equations.active_sets[0].search
    counts = [search.count]
    for step in range(130):
        run.run(until=(step + 1) * dt)
        counts.append(search.count)
    searched_at = np.flatnonzero(np.diff(counts))
    # The search at rest serves for none of the first steps: the next one is for a single step.
    horizons = [min(2**k, MAX_HORIZON) for k in range(len(searched_at) - 1)]
    margin_in_steps = distance / 2 / (speed * dt)
    served = [int((1 + WAY_MARGIN) * h + margin_in_steps) for h in horizons]
    assert searched_at[0] == 0
    assert np.diff(searched_at).tolist() == served
