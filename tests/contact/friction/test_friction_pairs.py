"""Friction of single pairs: no resultant, no moment, the stated loss, and its derivative."""

from __future__ import annotations

import numpy as np
import pytest

from gossamer_fx.mechanics.contact.assembly import PairBlocks
from gossamer_fx.mechanics.contact.contact_step import ContactLaw, PairStep
from gossamer_fx.mechanics.contact.friction.friction_pairs import FrictionPairs
from gossamer_fx.mechanics.contact.friction.sliding import (
    EDGE_WEIGHTS,
    BetweenBodies,
    SlidingGeometry,
)
from gossamer_fx.mechanics.contact.pairs import EdgeEdge, PointTriangle, gap_weights_of
from tests.contact.random_pairs import derivative_by_differences, near_pairs, step_of

# Pairs of each kind; of them some ten rub.
COUNT = 40
COEFFICIENT = 0.4
CREEP = 0.01


def rubbing_pairs(kind: int, alpha: float) -> tuple[FrictionPairs, np.ndarray, np.ndarray]:
    """Return pairs that rub, each between its four points, and both ends of a step."""
    pairs, x0, x1 = near_pairs(kind, COUNT, seed=8)
    step = step_of(pairs, x0, ContactLaw.BARRIER, alpha)
    weights = gap_weights_of(pairs.kind, step.pairs.parameters)
    gap = np.einsum("nk,nkc->nc", weights, x0.reshape(COUNT, 4, 3))
    start = SlidingGeometry(
        normal=gap / np.linalg.norm(gap, axis=1)[:, None],
        gap_weights=weights,
        direction_weights=np.broadcast_to(EDGE_WEIGHTS[kind], (COUNT, 2, 4)),
    )
    return pairs_with_start(kind, step, start), x0, x1


def pairs_with_start(kind: int, step: PairStep, start: SlidingGeometry) -> FrictionPairs:
    is_triangle = kind == PointTriangle.number
    points = step.pairs.points
    return FrictionPairs(
        step=step,
        block_rows=points,
        # Weights of the points of one side of the pair: one point, or two of an edge.
        side_weights=np.tile([1.0, 0, 0, 0] if is_triangle else [1.0, 1, 0, 0], (COUNT, 1)),
        geometry=BetweenBodies(step.pairs.kind),
        start=start,
        points=points,
        point_weights=np.broadcast_to(np.eye(4), (COUNT, 4, 4)),
        is_moved=np.ones((COUNT, 4)),
        coefficient=np.full(COUNT, COEFFICIENT),
        has_shared_coefficient=np.ones(COUNT, dtype=bool),
        creep=CREEP,
    )


@pytest.mark.parametrize("kind", [PointTriangle.number, EdgeEdge.number])
# Weight of the end where normal forces act; friction acts in the middle with each.
@pytest.mark.parametrize("alpha", [0.5, 1.0])
def test_a_pair_that_rubs_has_no_resultant_and_the_derivative_it_states(
    kind: int, alpha: float
) -> None:
    rub, x0, x1 = rubbing_pairs(kind, alpha)

    def forces(end: np.ndarray) -> np.ndarray:
        found = np.zeros((4 * COUNT, 3))
        rub.add_forces(end, found)
        return found.reshape(COUNT, 4, 3)

    F = forces(x1)
    size = np.abs(F).max(axis=(1, 2))
    rubs = size > 0
    # Enough pairs with a friction force.
    assert rubs.sum() > 10
    middle = ((x0 + x1) / 2).reshape(COUNT, 4, 3)
    displacement = (x1 - x0).reshape(COUNT, 4, 3)
    # Internal forces: round-off of sums of four.
    assert (np.abs(F.sum(axis=1)).max(axis=1) <= 1e-13 * size).all()
    assert (np.abs(np.cross(middle, F).sum(axis=1)).max(axis=1) <= 1e-12 * size).all()
    work = np.einsum("nkc,nkc->n", F, displacement)
    # The work of the resistance, with the sign that the residual takes it.
    assert (work[rubs] > 0).all()
    assert work.sum() == pytest.approx(rub.loss(x1), rel=1e-12)

    blocks = np.zeros((16 * COUNT, 9))
    block_index = np.arange(16 * COUNT, dtype=np.int32).reshape(COUNT, 16)
    state = rub.step.states(x1)
    rub.add_tangents(x1, state, 1.0, PairBlocks(block_index, blocks), last=None)
    K = blocks.reshape(COUNT, 4, 4, 3, 3).transpose(0, 1, 3, 2, 4).reshape(COUNT, 12, 12)
    # 1e-7 balances truncation and round-off for positions of unit size.
    numeric = derivative_by_differences(forces, x1, 1e-7)
    good = [
        np.allclose(K[i], numeric[i], rtol=1e-4, atol=1e-4 * abs(K[i]).max())
        for i in np.flatnonzero(rubs)
    ]
    # The others have the end of a side within the difference, where the distance has a kink.
    assert np.mean(good) > 0.9


def forces_from(kind: int, pairs, x0: np.ndarray, x1: np.ndarray) -> np.ndarray:
    """Friction forces (4n, 3) of pairs in a step from x0, with the geometry found there."""
    found = np.zeros((len(x0), 3))
    sliding_pairs(kind, pairs, x0).add_forces(x1, found)
    return found


def sliding_pairs(kind: int, pairs, x0: np.ndarray) -> FrictionPairs:
    """Pairs in a step from x0, whose directions are those of the program."""
    step = step_of(pairs, x0, ContactLaw.BARRIER)
    start = BetweenBodies(pairs.kind).at(x0[pairs.points], step.pairs.parameters)
    return pairs_with_start(kind, step, start)


@pytest.mark.parametrize("kind", [PointTriangle.number, EdgeEdge.number])
def test_beyond_edges_and_corners_only_the_motion_across_the_gap_slides(kind: int) -> None:
    """One side moves along the gap, or across it.  The closest points of these pairs are on edges
    and corners, where the edges that give the directions are not perpendicular to the gap."""
    pairs, _, _ = near_pairs(kind, COUNT, seed=8)
    x0 = np.random.default_rng(5).normal(size=(4 * COUNT, 3))
    rub = sliding_pairs(kind, pairs, x0)
    gap, _ = rub.vectors_at(x0)
    normal = gap / np.linalg.norm(gap, axis=1)[:, None]
    edges = np.einsum("ik,nkc->nic", EDGE_WEIGHTS[kind], x0[rub.points])
    slopes = np.abs(np.einsum("nic,nc->ni", edges, normal)).max(axis=1)
    # More than half of the pairs have an edge that leaves the tangent plane.
    assert np.mean(slopes > 0.1) > 0.5

    first_side = [0] if kind == PointTriangle.number else [0, 1]
    # Second order in the motion is 1e-6 of it.
    size = 1e-6

    def slides(direction: np.ndarray) -> np.ndarray:
        x1 = x0.copy()
        x1[rub.points[:, first_side]] += size * direction[:, None]
        return rub.sliding(x1).w / size

    across = np.cross(normal, np.random.default_rng(6).normal(size=normal.shape))
    across /= np.linalg.norm(across, axis=1)[:, None]
    along_one = slides(across)
    along_other = slides(np.cross(normal, across))
    np.testing.assert_allclose(slides(normal), 0, atol=1e-4)
    np.testing.assert_allclose(np.linalg.norm(along_one, axis=1), 1, rtol=1e-4)
    np.testing.assert_allclose(np.linalg.norm(along_other, axis=1), 1, rtol=1e-4)
    np.testing.assert_allclose((along_one * along_other).sum(axis=1), 0, atol=1e-4)


# The point and the corners of a triangle, or the ends of two edges, 0.1 above each other.  One edge
# of each pair leads away along the gap, and one along x.
ALONG_THE_GAP = {
    "first side": (PointTriangle, [(0, 0, 0.1), (0, 0, 0), (0, 0, -1), (1, 0, 0)]),
    "second side": (PointTriangle, [(0, 0, 0.1), (0, 0, 0), (1, 0, 0), (0, 0, -1)]),
    "first edge": (EdgeEdge, [(0, 0, 0.1), (0, 0, 1.1), (0, 0, 0), (1, 0, 0)]),
    "second edge": (EdgeEdge, [(0, 0, 0.1), (1, 0, 0.1), (0, 0, 0), (0, 0, -1)]),
}


@pytest.mark.parametrize("name", ALONG_THE_GAP)
def test_an_edge_along_the_gap_leaves_the_direction_of_the_other_edge(name: str) -> None:
    stencil, points = ALONG_THE_GAP[name]
    kind = stencil.number
    pairs, _, _ = near_pairs(kind, COUNT, seed=8)
    x0 = np.tile(np.array(points, dtype=float), (COUNT, 1))
    rub = sliding_pairs(kind, pairs, x0)
    first_side = [0] if kind == PointTriangle.number else [0, 1]
    size = 1e-6
    x1 = x0.copy()
    x1[rub.points[:, first_side], 0] += size
    np.testing.assert_allclose(np.linalg.norm(rub.sliding(x1).w, axis=1), size, rtol=1e-5)


@pytest.mark.parametrize("kind", [PointTriangle.number, EdgeEdge.number])
def test_the_product_with_the_derivative_by_the_start_agrees_with_differences(kind: int) -> None:
    pairs, x0, x1 = near_pairs(kind, COUNT, seed=8)
    rub = sliding_pairs(kind, pairs, x0)
    rng = np.random.default_rng(2)
    μ = rng.normal(size=x0.shape)
    product = np.zeros_like(x0)
    rub.add_start_product(x1, μ, product)
    rubs = np.abs(product.reshape(COUNT, 12)).max(axis=1) > 0
    assert rubs.sum() > 10

    # Pairs have no point in common, so that one direction serves all of them.
    direction = rng.normal(size=x0.shape)
    δ = 1e-6
    up = forces_from(kind, pairs, x0 + δ * direction, x1)
    down = forces_from(kind, pairs, x0 - δ * direction, x1)
    difference = ((up - down) / (2 * δ) * μ).reshape(COUNT, 12).sum(axis=1)
    exact = (product * direction).reshape(COUNT, 12).sum(axis=1)
    scale = np.abs(product.reshape(COUNT, 12)).sum(axis=1)
    error = np.abs(exact - difference)[rubs] / scale[rubs]
    # Differences are good to 1e-7; a few pairs have a kink within them.
    assert np.mean(error < 1e-7) > 0.9
