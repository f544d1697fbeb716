"""Overlaps of boxes against all pairs of primitives, computed one by one."""

from __future__ import annotations

import numpy as np
import pytest

from gossamer_fx.mechanics.contact.broad_phase.box_tree import (
    Nearness,
    OverlappingPairs,
    find_overlaps,
    morton_order,
)
from gossamer_fx.mechanics.contact.geometry.facets import CollisionPrimitives
from gossamer_fx.mechanics.contact.pairs import (
    EdgeEdge,
    PointTriangle,
    approach_bounds,
    closest_points,
)
from tests.contact.random_pairs import all_pairs, table_of_primitives, triangle_soup


def overlaps(surface: CollisionPrimitives, x: np.ndarray, reach: float) -> OverlappingPairs:
    """Return the pairs whose boxes, half of the reach [m] larger, overlap."""
    vertices = np.arange(len(surface.vertices), dtype=np.int32)
    edges = np.arange(len(surface.edges), dtype=np.int32)
    return find_overlaps(surface, x - reach / 2, x + reach / 2, vertices, edges)


def keys_of(pairs: OverlappingPairs) -> list[tuple[int, int, int]]:
    """Return the kind and the primitives of each pair."""
    rows = zip(pairs.kind, pairs.primitives, strict=True)
    return [(int(kind), int(first), int(second)) for kind, (first, second) in rows]


def test_no_near_pair_is_missed_and_none_is_found_twice() -> None:
    surface, x = triangle_soup(30, seed=0)
    found = overlaps(surface, x, 0.05)
    keys = keys_of(found)
    assert len(set(keys)) == len(keys)
    missing = sorted(all_pairs(surface) - set(keys))
    squared_distance, _ = closest_points(table_of_primitives(surface, missing), x)
    # Pairs that were left out are farther apart than the reach.
    assert squared_distance.min() > 0.05**2
    # And some that were found are nearer.
    assert closest_points(found, x)[0].min() < 0.05**2


def test_ranks_find_together_what_one_finds() -> None:
    surface, x = triangle_soup(200, seed=1)
    # A reach small enough that most boxes do not overlap.
    whole = keys_of(overlaps(surface, x, 0.02))
    parts = []
    for rank in range(3):
        vertices = np.arange(rank, len(surface.vertices), 3, dtype=np.int32)
        edges = np.arange(rank, len(surface.edges), 3, dtype=np.int32)
        parts += keys_of(find_overlaps(surface, x - 0.01, x + 0.01, vertices, edges))
    assert sorted(parts) == sorted(whole)


@pytest.mark.parametrize("margin", [0.0, 0.02])
def test_pairs_that_can_come_near_are_kept_and_no_others(margin: float) -> None:
    """Pairs of overlapping boxes that are dropped stay farther apart than the distance."""
    distance = 0.05
    surface, x0 = triangle_soup(30, seed=3)
    generator = np.random.default_rng(4)
    x1 = x0 + 0.03 * generator.uniform(-1, 1, x0.shape)
    radius = 0.01 * generator.uniform(0, 1, len(x0))
    near = Nearness(x0, x1, np.full(len(x0), margin), radius, distance)
    vertices = np.arange(len(surface.vertices), dtype=np.int32)
    edges = np.arange(len(surface.edges), dtype=np.int32)
    # Boxes so large that all overlap: pairs are dropped by their distance alone.
    kept = find_overlaps(surface, x0 - 10, x0 + 10, vertices, edges, near=near)
    every = find_overlaps(surface, x0 - 10, x0 + 10, vertices, edges)
    # The largest radius of each side counts.
    is_edges = every.kind == EdgeEdge.number
    of_points = radius[every.points]
    first = np.where(is_edges, of_points[:, :2].max(axis=1), of_points[:, 0])
    second = np.where(is_edges, of_points[:, 2:].max(axis=1), of_points[:, 1:].max(axis=1))
    gap = np.sqrt(closest_points(every, x0)[0]) - (first + second)
    # Each of the two sides may come nearer by its margin.
    reach = distance + approach_bounds(every, x0, x1) + 2 * margin
    expected = every.rows(gap < reach)
    assert 0 < len(expected) < len(every)
    assert keys_of(kept) == keys_of(expected)
    dropped = every.rows(gap >= reach)
    least = np.full(len(dropped), np.inf)
    for t in np.linspace(0, 1, 20):
        at = np.ascontiguousarray(x0 + t * (x1 - x0))
        least = np.minimum(least, np.sqrt(closest_points(dropped, at)[0]))
    radii = (first + second)[gap >= reach]
    # 1e-12: round-off of the square roots.
    assert (least - radii - 2 * margin >= distance - 1e-12).all()


def test_connected_and_fixed_primitives_are_no_pairs() -> None:
    """Of three triangles that coincide, two are connected by a label and two are fixed."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    x = np.vstack([corners, corners + 0.01, corners + 0.02])
    surface, _ = triangle_soup(3, seed=0)
    labels = np.arange(9, dtype=np.int32)
    labels[:6] = 0  # all points of the first two triangles
    is_fixed = np.repeat(np.array([0, 1, 1], np.uint8), 3)
    filtered = CollisionPrimitives(
        surface.vertices,
        surface.edges,
        surface.triangles,
        is_fixed,
        labels[:, None].copy(),
    )
    all_found = keys_of(overlaps(surface, x, 0.1))
    found = overlaps(filtered, x, 0.1)
    of_triangle = found.points // 3
    assert len(all_found) > len(found) > 0
    first = of_triangle[:, 0]
    second = found.second_point // 3
    # Only the pair of the first and the last triangle is neither connected nor fixed.
    assert {tuple(sorted(pair)) for pair in zip(first, second, strict=True)} == {(0, 2)}


@pytest.mark.slow
def test_candidates_are_those_of_ipctk() -> None:
    """ipctk is on PyPI."""
    ipctk = pytest.importorskip("ipctk")
    surface, x = triangle_soup(3000, seed=5, size=0.1)
    mesh = ipctk.CollisionMesh(x, surface.edges, surface.triangles)
    theirs = ipctk.Candidates()
    theirs.build(mesh, x, inflation_radius=0.005)
    expected = {(PointTriangle.number, c.vertex_id, c.face_id) for c in theirs.fv_candidates}
    for candidate in theirs.ee_candidates:
        first, second = sorted((candidate.edge0_id, candidate.edge1_id))
        expected.add((EdgeEdge.number, first, second))
    ours = set(keys_of(overlaps(surface, x, 0.01)))
    # Many pairs, so that equality is not accidental.
    assert len(ours) > 10_000
    assert ours == expected


def test_boxes_are_ordered_along_a_morton_curve() -> None:
    """The bits of the three coordinates alternate in the order, that of z first; boxes at one point
    stay in their order."""
    size = 8
    points = np.indices((size, size, size)).reshape(3, -1).T
    points = np.random.default_rng(4).permutation(np.vstack([points, points]))

    def code(point: np.ndarray) -> int:
        x, y, z = (int(coordinate) for coordinate in point)
        bits = ((z >> k & 1, y >> k & 1, x >> k & 1) for k in (2, 1, 0))
        return int("".join(str(bit) for three in bits for bit in three), base=2)

    expected = sorted(range(len(points)), key=lambda number: code(points[number]))
    middle = 0.3 * points - 2.0
    boxes = np.hstack([middle - 0.1, middle + 0.1])
    assert morton_order(boxes).tolist() == expected
    # Neither the size of the boxes nor that of the scene counts.
    assert morton_order(1e3 * boxes).tolist() == expected
