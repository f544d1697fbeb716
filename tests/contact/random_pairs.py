"""Random and degenerate contact pairs for tests."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gossamer_fx.mechanics.contact.contact_step import ContactLaw, PairStep, begin_at
from gossamer_fx.mechanics.contact.geometry.facets import CollisionPrimitives
from gossamer_fx.mechanics.contact.pairs import (
    ActivePairs,
    EdgeEdge,
    PairTable,
    PointInCylinder,
    PointInSphere,
    PointPlane,
    PointTriangle,
    closest_points,
)

# The kinds of which there are random pairs here; those of cones are in test_cone.py.
KINDS = tuple(
    stencil.number
    for stencil in (PointTriangle, EdgeEdge, PointPlane, PointInSphere, PointInCylinder)
)


def near_pairs(
    kind: int,
    n: int,
    seed: int = 0,
    d: float = 0.1,
) -> tuple[ActivePairs, np.ndarray, np.ndarray]:
    """Return n pairs of unit size at distances about d, and two states of a step of about d.

    Returns:
        the pairs, and points x0, x1 (4n, 3) at the start and at the end.
    """
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(n, 4, 3))
    if kind == PointTriangle.number:
        _place_above_triangle(x, d, rng)
    elif kind == EdgeEdge.number:
        _place_across_edge(x, d, rng)
    else:
        _place_at_boundary(x, kind, d, rng)
    # Origins of boundaries move, directions do not.
    moves = np.ones((4, 1))
    if kind > EdgeEdge.number:
        moves[2:] = 0.0
    # A step of about a third of the distance: some pairs begin to touch, others separate.
    y = x + 0.3 * d * rng.normal(size=(n, 4, 3)) * moves
    # In rooms of radius 1 the squared distance is -r², from -1 at the boundary to -(1 - d)².
    offset, width = {
        PointPlane.number: (0.0, d),
        PointInSphere.number: (-1.0, 1 - (1 - d) ** 2),
        PointInCylinder.number: (-1.0, 1 - (1 - d) ** 2),
    }.get(int(kind), (0.0, d * d))
    pairs = ActivePairs(
        kind=np.full(n, kind, np.uint8),
        points=np.arange(4 * n, dtype=np.int32).reshape(n, 4),
        identifier=np.arange(n),
        stiffness=rng.uniform(0.5, 2.0, n),
        width=np.full(n, width),
        offset=np.full(n, offset),
    )
    return pairs, x.reshape(-1, 3), y.reshape(-1, 3)


def step_of(pairs: ActivePairs, x0: np.ndarray, law: ContactLaw, alpha: float = 0.5) -> PairStep:
    """Return pairs in a step that starts at points x0."""
    return PairStep(begin_at(pairs, x0, *closest_points(pairs, x0)), x0, law, alpha)


def _place_above_triangle(x: np.ndarray, d: float, rng: np.random.Generator) -> None:
    """Put the first points of pairs (n, 4, 3) above or below points of their triangles."""
    # Uniform in the triangle, so that all of its parts are tested.
    weights = rng.dirichlet([1, 1, 1], len(x))
    one_side = x[:, 2] - x[:, 1]
    other_side = x[:, 3] - x[:, 1]
    normal = _unit(np.cross(one_side, other_side))
    # From well within the activation distance to beyond it.
    height = d * rng.uniform(0.3, 1.4, (len(x), 1))
    foot = np.einsum("nk,nkc->nc", weights, x[:, 1:])
    x[:, 0] = foot + height * normal


def _place_across_edge(x: np.ndarray, d: float, rng: np.random.Generator) -> None:
    """Move the second edges of pairs (n, 4, 3) near the first ones, at or just beyond their
    ends."""
    first_edge = x[:, 1] - x[:, 0]
    second_edge = x[:, 3] - x[:, 2]
    normal = _unit(np.cross(first_edge, second_edge))
    # A tenth of the length beyond either end.
    u, v = rng.uniform(-0.1, 1.1, (2, len(x), 1))
    point_on_first = x[:, 0] + u * first_edge
    point_on_second = x[:, 2] + v * second_edge
    gap = point_on_first - point_on_second
    height = d * rng.uniform(0.3, 1.4, (len(x), 1))
    x[:, 2:] += (gap + height * normal)[:, None]


def _place_at_boundary(x: np.ndarray, kind: int, d: float, rng: np.random.Generator) -> None:
    """Make the last two points of pairs (n, 4, 3) orthonormal, and put the first ones near the
    boundary."""
    axis = _unit(x[:, 2])
    along_axis = np.einsum("nc,nc->n", axis, x[:, 3])
    x[:, 2] = axis
    x[:, 3] = _unit(x[:, 3] - along_axis[:, None] * axis)
    height = d * rng.uniform(0.3, 1.4, (len(x), 1))
    if kind == PointPlane.number:
        x[:, 0] = x[:, 1] + height * axis + x[:, 3]
        return
    x[:, 0] = x[:, 1] + (1 - height) * axis
    if kind == PointInCylinder.number:
        # Anywhere along the cylinder, whose axis is the cross product.
        distance = rng.normal(size=(len(x), 1))
        x[:, 0] += distance * np.cross(axis, x[:, 3])


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


def make_degenerate(kind: int, x: np.ndarray) -> None:
    """Make degenerate pairs of x (n, 4, 3), in place.

    A third are parallel edges or slivers, a third edges of no length or triangles of two corners,
    and a sixth have a common point of both sides.
    """
    count = len(x)
    third = slice(0, count // 3)
    other = slice(count // 3, 2 * count // 3)
    last_sixth = slice(5 * count // 6, count)
    x[last_sixth, 0] = x[last_sixth, 2]
    if kind == EdgeEdge.number:
        x[third, 3] = x[third, 2] + x[third, 1] - x[third, 0]
        x[other, 3] = x[other, 2]
    else:
        # A sliver, 1e-9 wide.
        x[third, 3] = x[third, 1] + 1e-9 * x[third, 3]
        x[other, 2] = x[other, 1]


def table_of(kind: int, count: int) -> PairTable:
    """Return pairs of one kind between the points 0, 1, 2, ..., four each."""
    points = np.arange(4 * count, dtype=np.int32).reshape(count, 4)
    return PairTable(np.full(count, kind, np.uint8), points)


def triangle_soup(n: int, seed: int, size: float = 0.2) -> tuple[CollisionPrimitives, np.ndarray]:
    """Return n triangles anywhere in the unit cube, of sizes that differ by a factor of 100.

    Returns:
        the primitives, and their points x (3n, 3).
    """
    rng = np.random.default_rng(seed)
    middle = rng.uniform(size=(n, 1, 3))
    # Sizes over two decades, as around refined corners.
    extent = size * 10 ** rng.uniform(-2, 0, (n, 1, 1))
    x = (middle + extent * rng.normal(size=(n, 3, 3))).reshape(-1, 3)
    return separate_triangles(n), x


def separate_triangles(n: int) -> CollisionPrimitives:
    """Return n triangles that have no point in common."""
    triangles = np.arange(3 * n, dtype=np.int32).reshape(n, 3)
    edges = np.ascontiguousarray(triangles[:, [[0, 1], [1, 2], [0, 2]]].reshape(-1, 2))
    return CollisionPrimitives(
        vertices=np.arange(3 * n, dtype=np.int32),
        edges=edges,
        triangles=triangles,
        is_fixed=np.zeros(3 * n, np.uint8),
    )


def all_pairs(surface: CollisionPrimitives) -> set[tuple[int, int, int]]:
    """Return kind and primitives of all pairs without a common point."""
    pairs = set()
    for vertex in surface.vertices:
        for number, triangle in enumerate(surface.triangles):
            if vertex not in triangle:
                pairs.add((PointTriangle.number, int(vertex), number))
    for i, edge in enumerate(surface.edges):
        for j in range(i + 1, len(surface.edges)):
            if not set(edge) & set(surface.edges[j]):
                pairs.add((EdgeEdge.number, i, j))
    return pairs


def table_of_primitives(
    surface: CollisionPrimitives, pairs: list[tuple[int, int, int]]
) -> PairTable:
    """Return pairs that are given by their kind and primitives."""
    points = []
    for kind, first, second in pairs:
        if kind == PointTriangle.number:
            points.append([first, *surface.triangles[second]])
        else:
            points.append([*surface.edges[first], *surface.edges[second]])
    kinds = np.array([kind for kind, _, _ in pairs], np.uint8)
    return PairTable(kinds, np.array(points, dtype=np.int32))


def derivative_by_differences(
    forces: Callable[[np.ndarray], np.ndarray], x: np.ndarray, difference: float
) -> np.ndarray:
    """Derivatives (n, 12, 12) of forces on the points of n pairs by the positions (4 n, 3)."""
    count = len(x) // 4
    found = np.zeros((count, 12, 12))
    for j in range(12):
        step = np.zeros((4, 3))
        step.flat[j] = difference
        everywhere = np.tile(step, (count, 1))
        change = forces(x + everywhere) - forces(x - everywhere)
        found[:, :, j] = change.reshape(count, 12) / (2 * difference)
    return found
