"""Continuous collision detection compared with sampled positions and with ipctk."""

from __future__ import annotations

import numpy as np
import pytest

from gossamer_fx.mechanics.contact.narrow_phase.ccd import find_collisions
from gossamer_fx.mechanics.contact.pairs import EdgeEdge, PairTable, PointTriangle, closest_points
from tests.contact.random_pairs import make_degenerate, table_of

KINDS = (PointTriangle.number, EdgeEdge.number)


def stopped(pairs: PairTable, x0: np.ndarray, x1: np.ndarray, radius: np.ndarray) -> set[int]:
    """Return the pairs that do not keep a tenth of their gap."""
    gap = np.sqrt(closest_points(pairs, x0)[0]) - radius
    return set(
        find_collisions(
            pairs,
            x0,
            x1,
            radius,
            gap,
            0.1 * gap,
            # A tenth of the gap is the minimal separation that the stepper asks for.
        ).tolist()
    )


def test_pairs_that_pass_through_are_found() -> None:
    rng = np.random.default_rng(2)
    n = 2000
    passed = 0
    for kind in KINDS:
        x0, x1 = rng.normal(size=(2, 4 * n, 3))
        pairs = table_of(kind, n)
        found = stopped(pairs, x0, x1, np.zeros(n))
        # 400 samples of the path stand in for an exact search.
        positions = [np.ascontiguousarray(x0 + τ * (x1 - x0)) for τ in np.linspace(0, 1, 400)]
        distances = np.sqrt(np.array([closest_points(pairs, x)[0] for x in positions]))
        # Least distance over the initial one, of each pair.
        least = distances.min(axis=0) / distances[0]
        # A pair that comes below 2 % has collided; with the limit at 10 %, sampling cannot misjudge
        # it.
        hits = set(np.flatnonzero(least < 0.02).tolist())
        passed += len(hits)
        assert hits <= found
        # Above 15 % it surely has not, though detection may be conservative between 10 and 15 %.
        clear = set(np.flatnonzero(least > 0.15).tolist())
        assert not clear & found
    assert passed > 50


def test_a_radius_is_kept_clear_of() -> None:
    x0 = np.array([[0.3, 0.3, 1.0], [0, 0, 0], [1, 0, 0], [0, 1, 0]])
    # The point falls from 1 to 0.4 above the triangle.
    x1 = x0 - [[0, 0, 0.6], [0, 0, 0], [0, 0, 0], [0, 0, 0]]
    pairs = table_of(PointTriangle.number, 1)
    # 0.4 is more than the radius of 0.2 and a tenth of the gap.
    assert len(stopped(pairs, x0, x1, np.array([0.2]))) == 0
    # And less than the radius of 0.5.
    assert len(stopped(pairs, x0, x1, np.array([0.5]))) == 1


@pytest.mark.slow
@pytest.mark.parametrize("degenerate", [False, True])
def test_distances_and_collisions_are_those_of_ipctk(degenerate: bool) -> None:
    """Distances to 1e-12, and no missed collision, on 1e5 pairs; ipctk is on PyPI."""
    ipctk = pytest.importorskip("ipctk")
    rng = np.random.default_rng(4)
    n = 50_000
    worst = 0.0
    missed = 0
    check = ipctk.TightInclusionCCD()
    for kind in KINDS:
        x0, x1 = rng.normal(size=(2, n, 4, 3))
        if degenerate:
            make_degenerate(kind, x0)
            make_degenerate(kind, x1)
        pairs = table_of(kind, n)
        start = np.ascontiguousarray(x0.reshape(-1, 3))
        end = np.ascontiguousarray(x1.reshape(-1, 3))
        ours, _ = closest_points(pairs, start)
        is_free = np.ones(n, bool)
        is_free[list(stopped(pairs, start, end, np.zeros(n)))] = False
        if kind == PointTriangle.number:
            distance = ipctk.point_triangle_distance
            collides = check.point_triangle_ccd
        else:
            distance = ipctk.edge_edge_distance
            collides = check.edge_edge_ccd
        theirs = np.array([distance(*x) for x in x0])
        if kind == EdgeEdge.number and degenerate:
            # Of an edge without a length ipctk 1.6 takes the whole line of the other edge.
            points = slice(n // 3, 2 * n // 3)
            theirs[points] = [ipctk.point_edge_distance(x[2], x[0], x[1]) for x in x0[points]]
        # Relative, but distances below 1e-3 count absolutely.
        worst = max(worst, float((abs(ours - theirs) / np.maximum(theirs, 1e-3)).max()))
        missed += sum(collides(*x0[i], *x1[i])[0] for i in np.flatnonzero(is_free))
    assert worst < 1e-12
    assert missed == 0
