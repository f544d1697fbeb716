"""Closest points and gaps: degenerate pairs, bounds of the approach, and lazy evaluation."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from gossamer_fx.mechanics.contact import pairs as module
from gossamer_fx.mechanics.contact.pairs import (
    CandidatePairs,
    EdgeEdge,
    PairDistances,
    PointTriangle,
    approach_bounds,
    closest_points,
)
from tests.contact.random_pairs import KINDS, near_pairs, table_of

EDGES = EdgeEdge.number
TRIANGLE = PointTriangle.number


# Kind, four points, and the squared distance that one sees in a sketch.
DEGENERATE = {
    "parallel edges": (EDGES, [[0, 0, 0], [1, 0, 0], [0, 0, 1], [1, 0, 1]], 1.0),
    "edges on one line": (EDGES, [[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]], 1.0),
    "edges of no length": (EDGES, [[0, 0, 0], [0, 0, 0], [2, 0, 0], [2, 0, 0]], 4.0),
    "no area, above": (TRIANGLE, [[0, 1, 0], [0, 0, 0], [1, 0, 0], [2, 0, 0]], 1.0),
    "no area, beyond": (TRIANGLE, [[3, 1, 0], [0, 0, 0], [1, 0, 0], [2, 0, 0]], 2.0),
    "one corner": (TRIANGLE, [[0, 0, 2], [0, 0, 0], [0, 0, 0], [0, 0, 0]], 4.0),
    "sliver": (TRIANGLE, [[0.5, 1e-9, 1], [0, 0, 0], [1, 0, 0], [0.5, 1e-8, 0]], 1.0),
}


@pytest.mark.parametrize("kind, x, squared_distance", DEGENERATE.values(), ids=DEGENERATE)
def test_degenerate_pairs(kind: int, x: list[list[float]], squared_distance: float) -> None:
    found, _ = closest_points(table_of(kind, 1), np.array(x, float))
    # Round-off of one square.
    assert found[0] == pytest.approx(squared_distance, rel=1e-14)


@pytest.mark.parametrize("kind", KINDS)
def test_no_pair_comes_closer_than_its_bound(kind: int) -> None:
    pairs, x0, x1 = near_pairs(kind, 300, seed=9)
    # Five times the step, so that some pairs pass through each other.
    x1 = x0 + 5 * (x1 - x0)
    bound = approach_bounds(pairs, x0, x1)
    if kind > EdgeEdge.number:
        assert np.isinf(bound).all()
        return
    start = np.sqrt(closest_points(pairs, x0)[0])
    for t in np.linspace(0, 1, 50):
        distance = np.sqrt(closest_points(pairs, np.ascontiguousarray(x0 + t * (x1 - x0)))[0])
        # 1e-12: round-off of the square roots.
        assert (start - distance <= bound + 1e-12).all()


def test_gaps_take_little_more_memory_than_is_kept() -> None:
    """Temporary arrays were as large as what is kept; the gaps are the same to the last bit."""
    count = 4 * module.PAIRS_AT_ONCE
    pairs, x, _ = near_pairs(PointTriangle.number, count)
    zeros = np.zeros(count)
    candidates = CandidatePairs(pairs.kind, pairs.points, pairs.identifier, zeros, zeros)
    # As one that is loaded and compiled allocates, too.
    closest_points(pairs, x)
    tracemalloc.start()
    found = PairDistances.of(candidates, x)
    kept, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert (most - kept) / count < 20.0
    assert (found.gap == np.sqrt(closest_points(pairs, x)[0])).all()


def test_gaps_and_closest_points_are_computed_of_the_pairs_that_are_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Pairs that stay far keep the lower bound of their gap."""
    pairs, x, _ = near_pairs(PointTriangle.number, 40)
    zeros = np.zeros(40)
    candidates = CandidatePairs(pairs.kind, pairs.points, np.arange(40), zeros, zeros)
    computed = []

    def counted(table, x):
        computed.append(len(table))
        return closest_points(table, x)

    monkeypatch.setattr(module, "closest_points", counted)
    distances = PairDistances(candidates, x, np.full(40, -1.0))
    distances.make_exact(np.arange(10))
    assert (distances.gap[10:] == -1).all()
    wanted = np.zeros(40, dtype=bool)
    wanted[5:15] = True
    squared_distance, parameters = distances.closest_points(wanted)
    assert computed == [10, 10]
    expected = closest_points(pairs.rows(wanted), x)
    assert (squared_distance == expected[0]).all() and (parameters == expected[1]).all()
    assert (distances.gap[10:] == -1).all()  # bounds stay what they were
