"""Contact pairs: the C kernel against its twin, conservation by the discrete rule, and tangents."""

from __future__ import annotations

import numpy as np
import pytest

from gossamer_fx.contact.potential import (
    BARRIER,
    EDGE_EDGE,
    IN_CYLINDER,
    IN_SPHERE,
    PASSED,
    PENALTY,
    PLANE,
    POINT_TRIANGLE,
    TOUCHES,
    ContactPairs,
    act,
    energy,
    infinite_at_crossings,
    squared_distances,
)
from tests.contact.pairs_twin import Pair
from tests.contact.random_pairs import near_pairs

KINDS = {
    "point-triangle": POINT_TRIANGLE,
    "edge-edge": EDGE_EDGE,
    "plane": PLANE,
    "in sphere": IN_SPHERE,
    "in cylinder": IN_CYLINDER,
}
LAWS = {"barrier": BARRIER, "penalty": PENALTY}
kinds = pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
laws = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)


@kinds
@laws
def test_kernel_agrees_with_its_twin(kind: int, law: int) -> None:
    pairs, x0, x1 = near_pairs(kind, 200)
    done = act(pairs, x0, x1, law, 0.5, each=True)
    acting = np.flatnonzero(done.state == TOUCHES)
    assert len(acting) > 50
    for i in acting:
        twin = Pair(pairs, i, x0, law)
        expected = twin.force(x0, x1)
        assert np.allclose(
            done.forces[i].reshape(4, 3), expected, rtol=1e-7, atol=1e-9 * np.abs(expected).max()
        )
        one = pairs.some(np.array([i]))
        assert energy(one, x0, law)[0] == pytest.approx(twin.energy(x0), rel=1e-9)


@kinds
@laws
def test_work_is_the_change_of_energy(kind: int, law: int) -> None:
    pairs, x0, x1 = near_pairs(kind, 500, seed=1)
    state, forces, _ = vars(act(pairs, x0, x1, law, 0.5, each=True)).values()
    assert set(np.unique(state)) >= {0, TOUCHES}
    for i in np.flatnonzero(state == TOUCHES):
        one, p = pairs.some(np.array([i])), pairs.nodes[i]
        change = energy(one, x1, law)[0] - energy(one, x0, law)[0]
        assert forces[i] @ (x1[p] - x0[p]).ravel() == pytest.approx(change, rel=1e-10, abs=1e-13)


@pytest.mark.parametrize("kind", [POINT_TRIANGLE, EDGE_EDGE])
def test_forces_have_no_resultant_and_no_moment(kind: int) -> None:
    pairs, x0, x1 = near_pairs(kind, 500, seed=2)
    done = act(pairs, x0, x1, BARRIER, 0.5, each=True)
    forces = np.where((done.state == TOUCHES)[:, None], done.forces, 0).reshape(-1, 4, 3)
    size = np.abs(forces).max(axis=(1, 2))
    middle = ((x0 + x1) / 2).reshape(-1, 4, 3)
    assert (np.abs(forces.sum(1)).max(1) <= 1e-13 * size).all()
    assert (np.abs(np.cross(middle, forces).sum(1)).max(1) <= 1e-11 * size).all()


@kinds
@laws
@pytest.mark.parametrize("alpha", [0.5, 1.0])
def test_tangent_is_the_derivative(kind: int, law: int, alpha: float) -> None:
    pairs, x0, x1 = near_pairs(kind, 60, seed=3)
    done = act(pairs, x0, x1, law, alpha, each=True, tangents=True)
    K, δ = done.tangents.reshape(-1, 12, 12), 1e-6
    numeric = np.zeros_like(K)
    for j in range(12):
        step = np.zeros((4, 3))
        step.flat[j] = δ
        up, down = (
            act(pairs, x0, x1 + np.tile(z, (60, 1)), law, alpha, each=True).forces
            for z in (step, -step)
        )
        numeric[:, :, j] = (up - down) / (2 * δ)
    good = [
        np.allclose(K[i], numeric[i], rtol=1e-4, atol=1e-5 * np.abs(K[i]).max())
        for i in np.flatnonzero(done.state == TOUCHES)
    ]
    assert len(good) > 15
    assert np.mean(good) > 0.95  # the others have the end of a side within the difference


def test_small_distances_of_large_triangles_keep_their_digits() -> None:
    pairs, x0, x1 = near_pairs(POINT_TRIANGLE, 200, seed=4, d=1e-6)
    state, forces, _ = vars(act(pairs, x0, x1, BARRIER, 0.5, each=True)).values()
    missing = []
    for i in np.flatnonzero(state == TOUCHES):
        one, p = pairs.some(np.array([i])), pairs.nodes[i]
        b0, b1 = energy(one, x0, BARRIER)[0], energy(one, x1, BARRIER)[0]
        missing.append(abs(forces[i] @ (x1[p] - x0[p]).ravel() - (b1 - b0)) / max(b0, b1))
    assert np.median(missing) < 1e-9  # positions have 1e-16 of 1, distances 1e-10 of 1e-6


def test_iterates_that_passed_through_are_pushed_back() -> None:
    x0 = np.array([[0.3, 0.3, 0.05], [0, 0, 0], [1, 0, 0], [0, 1, 0]], float)
    x1 = x0.copy()
    x1[0, 2] = -0.02
    pairs, _, _ = near_pairs(POINT_TRIANGLE, 1)
    done = act(pairs, x0, x1, BARRIER, 0.5, each=True, tangents=True)
    assert done.state[0] == PASSED
    assert done.forces[0, 2] < 0  # the residual asks for a way up
    assert done.tangents[0].reshape(12, 12)[2, 2] > 0
    assert abs(done.forces[0].reshape(4, 3).sum(0)).max() < 1e-12


def test_distance_of_degenerate_pairs() -> None:
    nodes = np.arange(4, dtype=np.int32)[None]
    cases = [
        (EDGE_EDGE, [[0, 0, 0], [1, 0, 0], [0, 0, 1], [1, 0, 1]], 1.0),  # parallel
        (EDGE_EDGE, [[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]], 1.0),  # on one line
        (EDGE_EDGE, [[0, 0, 0], [0, 0, 0], [2, 0, 0], [2, 0, 0]], 4.0),  # points
        (POINT_TRIANGLE, [[0, 1, 0], [0, 0, 0], [1, 0, 0], [2, 0, 0]], 1.0),  # no area
        (POINT_TRIANGLE, [[3, 1, 0], [0, 0, 0], [1, 0, 0], [2, 0, 0]], 2.0),
        (POINT_TRIANGLE, [[0, 0, 2], [0, 0, 0], [0, 0, 0], [0, 0, 0]], 4.0),
        (POINT_TRIANGLE, [[0.5, 1e-9, 1], [0, 0, 0], [1, 0, 0], [0.5, 1e-8, 0]], 1.0),  # sliver
    ]
    for kind, x, s in cases:
        found = squared_distances(nodes, np.array([kind], np.uint8), np.array(x, float))
        assert found[0] == pytest.approx(s, rel=1e-14)


@pytest.mark.parametrize("u", [0.0, 1e-2, 0.5, 1.0])
def test_the_barrier_begins_at_its_distance_and_is_infinite_where_edges_cross(u: float) -> None:
    nodes, kind = np.arange(4, dtype=np.int32)[None], np.array([EDGE_EDGE], np.uint8)
    S, offset = infinite_at_crossings(kind, np.full(1, 1e-6), np.zeros(1))
    pairs = ContactPairs(nodes, kind, np.ones(1), S, offset, np.zeros(1, np.int64))

    def energy_at(z: float) -> float:
        return energy(
            pairs, np.array([[-u, 0, z], [1 - u, 0, z], [0, -u, 0], [0, 1 - u, 0]]), BARRIER
        )[0]

    assert energy_at(1.001e-3) == 0 < energy_at(0.98e-3)
    assert not energy_at(1e-6) < 1e5  # in the middle it is infinite from 0.16e-3 on


def test_edges_about_to_cross_are_pushed_back_the_more_the_nearer_they_are() -> None:
    """Where s is below its offset a barrier has no energy, but their forces go on; no step ends there."""
    nodes, kind = np.arange(4, dtype=np.int32)[None], np.array([EDGE_EDGE], np.uint8)
    S, offset = infinite_at_crossings(kind, np.full(1, 1e-6), np.zeros(1))
    pairs = ContactPairs(nodes, kind, np.ones(1), S, offset, np.zeros(1, np.int64))
    heights = np.linspace(0.5e-3, 1e-5, 2000)
    x = [np.array([[-0.5, 0, z], [0.5, 0, z], [0, -0.5, 0], [0, 0.5, 0]]) for z in heights]
    done = [act(pairs, x[0], x1, BARRIER, 0.5, each=True) for x1 in x]
    stress = np.array([-d.forces[0].reshape(4, 3)[:2, 2].sum() for d in done]) / (
        heights[0] + heights
    )
    state = np.array([d.state[0] for d in done])
    assert (np.diff(state) >= 0).all() and set(state) == {TOUCHES, PASSED}
    assert (stress > 0).all() and (np.diff(stress) > 0).all()
    first = int(np.flatnonzero(state == PASSED)[0])
    assert stress[first] / stress[first - 1] < 1.05


@pytest.mark.parametrize("kind", [POINT_TRIANGLE, EDGE_EDGE])
def test_those_and_only_those_that_pass_through_are_pushed_back(kind: int) -> None:
    pairs, x0, x1 = near_pairs(kind, 400, seed=6)
    x1 = x0 + 4 * (x1 - x0)
    state = act(pairs, x0, x1, BARRIER, 0.5).state
    t = np.linspace(0, 1, 4001)
    way = (
        np.array([squared_distances(pairs.nodes, pairs.kind, x0 + τ * (x1 - x0)) for τ in t]).min(0)
        ** 0.5
    )
    assert (state == PASSED).sum() > 40
    steep = (kind == EDGE_EDGE) & (
        energy(pairs, x1, BARRIER)[1] < 0.02
    )  # edges, so near that they are pushed, too
    assert way[(state == PASSED) & ~steep].max() < 2e-3
    assert np.mean(way[state != PASSED] < 1e-4) < 0.03  # there and back
