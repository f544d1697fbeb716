"""Search, motion check and intersections against all pairs, computed one by one."""

from __future__ import annotations

import numpy as np
import pytest

from gossamer_fx.contact.pairs import EDGE_EDGE, POINT_TRIANGLE, squared_distances
from gossamer_fx.contact.piercing import _pierces_exactly, intersections
from gossamer_fx.contact.search import Surface, candidates, refused


def soup(n: int, seed: int, size: float = 0.2) -> tuple[Surface, np.ndarray]:
    """n triangles anywhere in the unit cube, of sizes that differ by a factor of 100."""
    rng = np.random.default_rng(seed)
    middle, extent = rng.uniform(size=(n, 1, 3)), size * 10 ** rng.uniform(-2, 0, (n, 1, 1))
    x = (middle + extent * rng.normal(size=(n, 3, 3))).reshape(-1, 3)
    triangles = np.arange(3 * n, dtype=np.int32).reshape(n, 3)
    edges = np.ascontiguousarray(triangles[:, [[0, 1], [1, 2], [0, 2]]].reshape(-1, 2))
    return Surface(np.arange(3 * n, dtype=np.int32), edges, triangles, np.zeros(3 * n, np.uint8)), x


def everything(surface: Surface) -> set[tuple[int, ...]]:
    """All pairs without a common point."""
    pairs = {
        (POINT_TRIANGLE, v, t)
        for v in surface.vertices
        for t, c in enumerate(surface.triangles)
        if v not in c
    }
    for i, a in enumerate(surface.edges):
        pairs |= {
            (EDGE_EDGE, i, j)
            for j in range(i + 1, len(surface.edges))
            if not set(a) & set(surface.edges[j])
        }
    return pairs


def found(surface: Surface, x: np.ndarray, reach: float):
    nv, ne = len(surface.vertices), len(surface.edges)
    whole = np.arange(nv, dtype=np.int32), np.arange(ne, dtype=np.int32)
    return candidates(surface, x - reach / 2, x + reach / 2, *whole)


def test_no_near_pair_is_missed_and_none_is_found_twice() -> None:
    surface, x = soup(30, 0)
    nodes, kind, numbers = found(surface, x, 0.05)
    names = [(int(k), int(i), int(j)) for k, (i, j) in zip(kind, numbers, strict=True)]
    assert len(set(names)) == len(names)
    missing = sorted(everything(surface) - set(names))
    rest = np.array(
        [
            [i, *surface.triangles[j]]
            if k == POINT_TRIANGLE
            else [*surface.edges[i], *surface.edges[j]]
            for k, i, j in missing
        ],
        dtype=np.int32,
    )
    s = squared_distances(rest, np.array([m[0] for m in missing], np.uint8), x)
    assert s.min() > 0.05**2
    assert squared_distances(nodes, kind, x).min() < 0.05**2


def test_search_in_parts_finds_the_same() -> None:
    surface, x = soup(200, 1)
    whole = found(surface, x, 0.02)[2]
    parts = []
    for rank in range(3):
        share = [
            np.arange(rank, n, 3, dtype=np.int32)
            for n in (len(surface.vertices), len(surface.edges))
        ]
        _, kind, numbers = candidates(surface, x - 0.01, x + 0.01, *share)
        parts.append(np.column_stack([kind, numbers]))
    joined = np.vstack(parts)
    assert len(joined) == len(whole)


def stopped(
    nodes: np.ndarray, kind: np.ndarray, x0: np.ndarray, x1: np.ndarray, radius: np.ndarray
) -> set[int]:
    """Pairs that do not keep a tenth of their distance."""
    gap = np.sqrt(squared_distances(nodes, kind, x0)) - radius
    return set(refused(nodes, kind, x0, x1, radius, gap, 0.1 * gap).tolist())


def test_motion_check_refuses_what_passes_through() -> None:
    rng = np.random.default_rng(2)
    n, passes = 2000, 0
    for kind in (POINT_TRIANGLE, EDGE_EDGE):
        x0, x1 = rng.normal(size=(2, 4 * n, 3))
        nodes = np.arange(4 * n, dtype=np.int32).reshape(n, 4)
        kinds = np.full(n, kind, np.uint8)
        no = stopped(nodes, kinds, x0, x1, np.zeros(n))
        t = np.linspace(0, 1, 400)
        way = (
            np.array(
                [
                    squared_distances(nodes, kinds, np.ascontiguousarray(x0 + τ * (x1 - x0)))
                    for τ in t
                ]
            )
            ** 0.5
        )
        hits = set(np.flatnonzero(way.min(0) < 0.02 * way[0]).tolist())
        passes += len(hits)
        assert hits <= no
        clear = set(np.flatnonzero(way.min(0) > 0.15 * way[0]).tolist())
        assert not clear & no
    assert passes > 50


def test_a_radius_is_kept_clear_of() -> None:
    x0 = np.array([[0.3, 0.3, 1.0], [0, 0, 0], [1, 0, 0], [0, 1, 0]])
    x1 = x0 - [[0, 0, 0.6], [0, 0, 0], [0, 0, 0], [0, 0, 0]]
    nodes, kind = np.arange(4, dtype=np.int32)[None], np.array([POINT_TRIANGLE], np.uint8)
    assert len(stopped(nodes, kind, x0, x1, np.array([0.2]))) == 0
    assert len(stopped(nodes, kind, x0, x1, np.array([0.5]))) == 1


def test_intersections_are_those_of_all_pairs() -> None:
    surface, x = soup(80, 3, 0.5)
    expected = set()
    for i, (p, q) in enumerate(surface.edges):
        for j, t in enumerate(surface.triangles):
            if {p, q} & set(t):
                continue
            a, b, c = x[t]
            matrix = np.column_stack([x[q] - x[p], a - b, a - c])
            s, u, v = np.linalg.solve(matrix, a - x[p])
            if 0 < s < 1 and u > 0 and v > 0 and u + v < 1:
                expected.add((i, j))
    assert len(expected) > 20
    assert {tuple(pair) for pair in intersections(surface, x).tolist()} == expected


def test_intersections_of_what_touches_are_exact() -> None:
    """Corners on a coarse grid, where every second volume is zero, turned, moved far off and put on the last bits."""
    surface, x = soup(60, 4, 0.5)
    x = np.round(4 * x) / 4
    every = {
        (i, j)
        for i, e in enumerate(surface.edges)
        for j, t in enumerate(surface.triangles)
        if not set(e) & set(t)
    }
    a = np.array([[3, -4, 0], [4, 3, 0], [0, 0, 5]]) / 5
    for points in (x, x @ a, 1e3 + x @ a, np.nextafter(x @ a, 1)):
        expected = {
            (i, j)
            for i, j in every
            if _pierces_exactly(points[surface.edges[i]], points[surface.triangles[j]])
        }
        assert {tuple(pair) for pair in intersections(surface, points).tolist()} == expected
        assert len(expected) > 10


def degenerate(kind: int, x: np.ndarray) -> None:
    """Make of pairs x (n, 4, 3) a third parallel edges and slivers, a third edges of no length and triangles of two
    corners, and let a sixth have a point of both sides in one place."""
    third = slice(0, len(x) // 3)
    other = slice(len(x) // 3, 2 * len(x) // 3)
    x[5 * len(x) // 6 :, 0] = x[5 * len(x) // 6 :, 2]
    if kind == EDGE_EDGE:
        x[third, 3] = x[third, 2] + x[third, 1] - x[third, 0]
        x[other, 3] = x[other, 2]
    else:
        x[third, 3] = x[third, 1] + 1e-9 * x[third, 3]
        x[other, 2] = x[other, 1]


@pytest.mark.slow
@pytest.mark.parametrize("ordinary", [True, False])
def test_pairs_are_those_of_ipctk(ordinary: bool) -> None:
    """Distances to 1e-12, and no missed collision, on 1e5 pairs; ipctk is on PyPI."""
    ipctk = pytest.importorskip("ipctk")
    rng, n = np.random.default_rng(4), 50_000
    worst = missed = 0
    for kind in (POINT_TRIANGLE, EDGE_EDGE):
        x0, x1 = rng.normal(size=(2, n, 4, 3))
        if not ordinary:
            degenerate(kind, x0)
            degenerate(kind, x1)
        kinds, nodes = np.full(n, kind, np.uint8), np.arange(4 * n, dtype=np.int32).reshape(n, 4)
        flat0, flat1 = (np.ascontiguousarray(x.reshape(-1, 3)) for x in (x0, x1))
        ours = squared_distances(nodes, kinds, flat0)
        far = np.ones(n, bool)
        far[list(stopped(nodes, kinds, flat0, flat1, np.zeros(n)))] = False
        check = ipctk.TightInclusionCCD()
        if kind == POINT_TRIANGLE:
            distance, collides = ipctk.point_triangle_distance, check.point_triangle_ccd
        else:
            distance, collides = ipctk.edge_edge_distance, check.edge_edge_ccd
        theirs = np.array([distance(*x) for x in x0])
        if (
            kind == EDGE_EDGE and not ordinary
        ):  # of which ipctk 1.6 takes the whole line of the other edge
            points = slice(n // 3, 2 * n // 3)
            theirs[points] = [ipctk.point_edge_distance(x[2], x[0], x[1]) for x in x0[points]]
        worst = max(worst, float((abs(ours - theirs) / np.maximum(theirs, 1e-3)).max()))
        missed += sum(collides(*x0[i], *x1[i])[0] for i in np.flatnonzero(far))
    assert worst < 1e-12
    assert missed == 0


@pytest.mark.slow
def test_candidates_are_those_of_ipctk() -> None:
    ipctk = pytest.importorskip("ipctk")
    surface, x = soup(3000, 5, 0.1)
    mesh = ipctk.CollisionMesh(x, surface.edges, surface.triangles)
    theirs = ipctk.Candidates()
    theirs.build(mesh, x, inflation_radius=0.005)
    expected = {(POINT_TRIANGLE, c.vertex_id, c.face_id) for c in theirs.fv_candidates}
    expected |= {(EDGE_EDGE, *sorted((c.edge0_id, c.edge1_id))) for c in theirs.ee_candidates}
    _, kind, numbers = found(surface, x, 0.01)
    ours = {(int(k), int(i), int(j)) for k, (i, j) in zip(kind, numbers, strict=True)}
    assert len(ours) > 10_000
    assert ours == expected
