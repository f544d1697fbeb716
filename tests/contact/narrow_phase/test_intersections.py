"""Intersections of edges and triangles compared with all pairs, exact where double precision is not
sufficient."""

from __future__ import annotations

import numpy as np

from gossamer_fx.mechanics.contact.geometry.facets import CollisionPrimitives
from gossamer_fx.mechanics.contact.narrow_phase.intersections import (
    find_intersections,
    intersects_exactly,
    sign_of_volume,
)
from tests.contact.random_pairs import triangle_soup

# A rotation with rational entries, whose products are rounded all the same.
TURN = np.array([[3, -4, 0], [4, 3, 0], [0, 0, 5]]) / 5


def separate_pairs(surface: CollisionPrimitives) -> list[tuple[int, int]]:
    """Return all pairs of an edge and a triangle without a common point."""
    return [
        (i, j)
        for i, edge in enumerate(surface.edges)
        for j, triangle in enumerate(surface.triangles)
        if not set(edge) & set(triangle)
    ]


def found_pairs(surface: CollisionPrimitives, x: np.ndarray) -> set[tuple[int, ...]]:
    return {tuple(pair) for pair in find_intersections(surface, x).tolist()}


def test_intersections_are_those_of_all_pairs() -> None:
    surface, x = triangle_soup(80, seed=3, size=0.5)
    expected = set()
    for i, j in separate_pairs(surface):
        p, q = x[surface.edges[i]]
        a, b, c = x[surface.triangles[j]]
        matrix = np.column_stack([q - p, a - b, a - c])
        # Solve p + t (q - p) = a + u (b - a) + v (c - a).
        t, u, v = np.linalg.solve(matrix, a - p)
        if 0 < t < 1 and u > 0 and v > 0 and u + v < 1:
            expected.add((i, j))
    # The soup must contain intersections.
    assert len(expected) > 20
    assert found_pairs(surface, x) == expected


def test_intersections_of_what_touches_are_exact() -> None:
    """Corners on a coarse grid, where every second volume is zero, also turned, far off, and
    shifted by the last bits."""
    surface, x = triangle_soup(60, seed=4, size=0.5)
    x = np.round(4 * x) / 4
    pairs = separate_pairs(surface)
    for points in (x, x @ TURN, 1e3 + x @ TURN, np.nextafter(x @ TURN, 1)):
        expected = {
            (i, j)
            for i, j in pairs
            if intersects_exactly(points[surface.edges[i]], points[surface.triangles[j]])
        }
        assert found_pairs(surface, points) == expected
        # Touching pairs and real intersections both occur.
        assert len(expected) > 10


def test_signs_of_volumes_near_zero() -> None:
    """Points on a plane, and one moved by the last bit; the coordinates are not round numbers."""
    corners = np.array([[0.1, 0.2, 0.3], [1.1, 0.3, 0.7], [0.4, 1.3, 0.9], [0.0, 0.0, 0.0]])
    # A point of the plane of the other three, up to the last bits.
    one_side = corners[1] - corners[0]
    other_side = corners[2] - corners[0]
    corners[3] = corners[0] + 0.25 * one_side + 0.5 * other_side
    signs = []
    for bits in (-4, 4):
        moved = corners[3] + [0, 0, bits * 2.0**-53]
        signs.append(sign_of_volume(np.vstack([corners[:3], moved])))
    # Four units in the last place lie on either side of the plane.
    assert signs in ([-1, 1], [1, -1])
    assert sign_of_volume(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])) == 0


def test_the_answer_follows_the_exact_sign_near_zero() -> None:
    """An edge from above ends at a triangle, to the last bits: it intersects where its end is
    below."""
    rng = np.random.default_rng(5)
    seen = set()
    points = np.arange(5, dtype=np.int32)
    surface = CollisionPrimitives(
        vertices=points,
        edges=points[None, 3:].copy(),
        triangles=points[None, :3].copy(),
        is_fixed=np.zeros(5, dtype=np.uint8),
    )
    for _ in range(50):
        corners = rng.integers(1, 2**20, (3, 3)) / 2**20
        end = np.array([0.25, 0.25, 0.5]) @ corners  # without round-off
        one_side = corners[1] - corners[0]
        other_side = corners[2] - corners[0]
        up = np.cross(one_side, other_side)
        for bits in range(-4, 5):
            # Moved along the normal by up to four units in the last place.
            moved = end + bits * 2.0**-53 * np.sign(up)
            start_side = sign_of_volume(np.vstack([corners, end + up]))
            end_side = sign_of_volume(np.vstack([corners, moved]))
            found = find_intersections(surface, np.vstack([corners, end + up, moved]))
            product = start_side * end_side
            assert len(found) == (product < 0)
            seen.add(product)
    # The loop has seen ends below, above and exactly on the triangle.
    assert seen == {-1, 0, 1}
