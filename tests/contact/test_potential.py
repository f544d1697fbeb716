"""The contact potential: the C kernel against its twin, conservation by the discrete rule,
tangents."""

from __future__ import annotations

import numpy as np
import pytest

from gossamer_fx.mechanics.contact.assembly import PairBlocks
from gossamer_fx.mechanics.contact.contact_step import (
    ContactLaw,
    PairState,
    energy_of_pairs,
    unit_energies,
)
from gossamer_fx.mechanics.contact.pairs import (
    STENCILS,
    ActivePairs,
    EdgeEdge,
    PointTriangle,
    closest_points,
)
from tests.contact.pairs_twin import PairTwin
from tests.contact.random_pairs import KINDS, derivative_by_differences, near_pairs, step_of

BARRIER = ContactLaw.BARRIER
EDGE_EDGE = EdgeEdge.number
POINT_TRIANGLE = PointTriangle.number
every_kind = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: type(STENCILS[kind]).__name__)
every_law = pytest.mark.parametrize("law", list(ContactLaw), ids=lambda law: law.name)
of_surfaces = pytest.mark.parametrize("kind", [POINT_TRIANGLE, EDGE_EDGE])


@every_kind
@every_law
def test_the_kernel_agrees_with_its_twin(kind: int, law: ContactLaw) -> None:
    pairs, x0, x1 = near_pairs(kind, 200)
    state, forces = step_of(pairs, x0, law).forces(x1)
    touching = np.flatnonzero(state == PairState.TOUCHES)
    # At least a quarter of the pairs touch.
    assert len(touching) > 50
    for i in touching:
        twin = PairTwin(pairs, i, x0, law)
        expected = twin.force(x0, x1)
        found = forces[i]
        # The twin computes from squared lengths and loses digits that the kernel keeps.
        assert np.allclose(found, expected, rtol=1e-7, atol=1e-9 * np.abs(expected).max())
        one = pairs.rows(np.array([i]))
        assert energy_of_pairs(one, x0, law)[0] == pytest.approx(twin.energy(x0), rel=1e-9)


@every_kind
@every_law
def test_stiffness_times_unit_energies_adds_up_to_the_energy(kind: int, law: ContactLaw) -> None:
    pairs, x0, _ = near_pairs(kind, 200)
    energy, scaled_distance = energy_of_pairs(pairs, x0, law)
    parts = pairs.stiffness * unit_energies(pairs, scaled_distance, law)
    assert energy > 0
    assert parts.sum() == pytest.approx(energy, rel=1e-12)
    assert (parts[scaled_distance >= 1] == 0).all()


@every_kind
@every_law
def test_work_is_the_change_of_energy(kind: int, law: ContactLaw) -> None:
    pairs, x0, x1 = near_pairs(kind, 500, seed=1)
    state, forces = step_of(pairs, x0, law).forces(x1)
    assert set(np.unique(state)) >= {PairState.NO_CONTACT, PairState.TOUCHES}
    for i in np.flatnonzero(state == PairState.TOUCHES):
        one = pairs.rows(np.array([i]))
        points = pairs.points[i]
        change = energy_of_pairs(one, x1, law)[0] - energy_of_pairs(one, x0, law)[0]
        work = np.sum(forces[i] * (x1[points] - x0[points]))
        # The discrete gradient is exact; relative round-off of differences of energies.
        assert work == pytest.approx(change, rel=1e-10, abs=1e-13)


@of_surfaces
def test_forces_have_no_resultant_and_no_moment(kind: int) -> None:
    pairs, x0, x1 = near_pairs(kind, 500, seed=2)
    state, forces = step_of(pairs, x0, BARRIER).forces(x1)
    forces = np.where((state == PairState.TOUCHES)[:, None, None], forces, 0)
    size = np.abs(forces).max(axis=(1, 2))
    middle = ((x0 + x1) / 2).reshape(-1, 4, 3)
    # Sums of four forces: round-off.
    assert (np.abs(forces.sum(1)).max(1) <= 1e-13 * size).all()
    assert (np.abs(np.cross(middle, forces).sum(1)).max(1) <= 1e-11 * size).all()


@every_kind
@every_law
@pytest.mark.parametrize("alpha", [0.5, 1.0])
def test_the_tangent_is_the_derivative(kind: int, law: ContactLaw, alpha: float) -> None:
    pairs, x0, x1 = near_pairs(kind, 60, seed=3)
    step = step_of(pairs, x0, law, alpha)
    state, _, tangents = step.forces_and_tangents(x1)
    K = tangents.reshape(-1, 12, 12)
    # Cube root of the machine epsilon would be 6e-6; the curvature of the barrier asks for less.
    numeric = derivative_by_differences(lambda x: step.forces(x)[1].reshape(-1, 12), x1, 1e-6)
    good = [
        np.allclose(K[i], numeric[i], rtol=1e-4, atol=1e-5 * np.abs(K[i]).max())
        for i in np.flatnonzero(state == PairState.TOUCHES)
    ]
    # Enough pairs that touch.
    assert len(good) > 15
    # The others have the end of a side within the difference, where the distance has a kink.
    assert np.mean(good) > 0.95


@every_kind
def test_sums_over_pairs_are_those_of_the_pairs(kind: int) -> None:
    """Forces by points and tangents by blocks, with closest points and states that are known."""
    pairs, x0, x1 = near_pairs(kind, 50, seed=5)
    step = step_of(pairs, x0, BARRIER)
    state, forces, tangents = step.forces_and_tangents(x1)
    point_forces = np.zeros_like(x0)
    assert (step.add_forces(x1, point_forces) == state).all()
    blocks = np.zeros((16 * 50, 9))
    block_index = np.arange(16 * 50, dtype=np.int32).reshape(50, 16)
    step.add_tangents(x1, state, 1.0, PairBlocks(block_index, blocks))
    assert (point_forces.reshape(50, 4, 3) == forces).all()
    by_pairs = blocks.reshape(50, 4, 4, 3, 3).swapaxes(2, 3)
    assert (by_pairs == tangents).all()
    assert (step.tangents(x1, state, 1.0) == tangents).all()


def test_small_distances_of_large_triangles_keep_their_digits() -> None:
    pairs, x0, x1 = near_pairs(POINT_TRIANGLE, 200, seed=4, d=1e-6)
    state, forces = step_of(pairs, x0, BARRIER).forces(x1)
    missing = []
    for i in np.flatnonzero(state == PairState.TOUCHES):
        one = pairs.rows(np.array([i]))
        points = pairs.points[i]
        b0 = energy_of_pairs(one, x0, BARRIER)[0]
        b1 = energy_of_pairs(one, x1, BARRIER)[0]
        work = np.sum(forces[i] * (x1[points] - x0[points]))
        missing.append(abs(work - (b1 - b0)) / max(b0, b1))
    # Relative digits of the work.
    # Positions have digits to 1e-16 of 1, distances to 1e-10 of 1e-6.
    assert np.median(missing) < 1e-9


def test_iterates_that_passed_through_are_pushed_back() -> None:
    x0 = np.array([[0.3, 0.3, 0.05], [0, 0, 0], [1, 0, 0], [0, 1, 0]], float)
    x1 = x0.copy()
    x1[0, 2] = -0.02
    pairs, _, _ = near_pairs(POINT_TRIANGLE, 1)
    (state,), (forces,), (tangents,) = step_of(pairs, x0, BARRIER).forces_and_tangents(x1)
    assert state == PairState.PASSED
    assert forces[0, 2] < 0  # the residual asks for a way up
    # A positive stiffness draws the iteration back up.
    assert tangents[0, 2, 0, 2] > 0
    error = abs(forces.sum(0)).max()
    assert error < 1e-12


@of_surfaces
def test_those_and_only_those_that_pass_through_are_pushed_back(kind: int) -> None:
    pairs, x0, x1 = near_pairs(kind, 400, seed=6)
    x1 = x0 + 4 * (x1 - x0)
    state = step_of(pairs, x0, BARRIER).states(x1)
    squared = [closest_points(pairs, x0 + τ * (x1 - x0))[0] for τ in np.linspace(0, 1, 4001)]
    least = np.sqrt(np.min(squared, axis=0))
    passed = state == PairState.PASSED
    assert passed.sum() > 40
    # Edges that come very near are pushed back, too, before they cross.
    _, scaled_distance = energy_of_pairs(pairs, x1, BARRIER)
    is_too_near = (kind == EDGE_EDGE) & (scaled_distance < 0.02)
    assert least[passed & ~is_too_near].max() < 2e-3
    # Some pass there and back.
    assert np.mean(least[~passed] < 1e-4) < 0.03


def crossing_edges(width: float) -> ActivePairs:
    """Return one pair of edges with the barrier of a squared activation distance [m²]."""
    activation_distance = np.full(1, np.sqrt(width))
    zero = np.zeros(1)
    new_width, offset = STENCILS[EDGE_EDGE].energy_range(
        activation_distance, radius=zero, shape=zero, is_barrier=True
    )
    return ActivePairs(
        kind=np.array([EDGE_EDGE], np.uint8),
        points=np.arange(4, dtype=np.int32)[None],
        identifier=np.zeros(1, np.int64),
        stiffness=np.ones(1),
        width=new_width,
        offset=offset,
    )


@pytest.mark.parametrize("u", [0.0, 1e-2, 0.5, 1.0])
def test_the_barrier_begins_at_its_distance_and_is_infinite_where_edges_cross(u: float) -> None:
    pairs = crossing_edges(1e-6)

    def energy_at(z: float) -> float:
        x = np.array([[-u, 0, z], [1 - u, 0, z], [0, -u, 0], [0, 1 - u, 0]])
        return energy_of_pairs(pairs, x, BARRIER)[0]

    assert energy_at(1.001e-3) == 0 < energy_at(0.98e-3)
    # In the middle of edges it is infinite from 0.16e-3 on.
    assert not energy_at(1e-6) < 1e5


def test_edges_about_to_cross_are_pushed_back_the_more_the_nearer_they_are() -> None:
    """Where s is below its offset a barrier has no energy, but its forces go on; no step ends
    there."""
    pairs = crossing_edges(1e-6)
    heights = np.linspace(0.5e-3, 1e-5, 2000)
    x = [np.array([[-0.5, 0, z], [0.5, 0, z], [0, -0.5, 0], [0, 0.5, 0]]) for z in heights]
    step = step_of(pairs, x[0], BARRIER)
    responses = [step.forces(x1) for x1 in x]
    upwards = np.array([-forces[0, :2, 2].sum() for _, forces in responses])
    stress = upwards / (heights[0] + heights)
    state = np.array([states[0] for states, _ in responses])
    assert (np.diff(state) >= 0).all()
    exact = {PairState.TOUCHES, PairState.PASSED}
    assert set(state) == exact
    assert (stress > 0).all() and (np.diff(stress) > 0).all()
    first = int(np.flatnonzero(state == PairState.PASSED)[0])
    # The forces go on without a jump where energy ends: at most 5 % between two of 2000 heights.
    assert stress[first] / stress[first - 1] < 1.05


def test_edges_that_rock_push_across_however_little_they_stretch() -> None:
    """Of two parallel edges the right ends are the nearer ones at first, and the left ones at last.
    All lies across the edges but their tilt, 2e-4/0.28: so must the force."""
    pairs = crossing_edges(2.25e-6)
    x0 = np.array([[0, 0, 0], [0.28, 0, 0], [0, 0, 1.4e-3], [0.28, 0, 1.3e-3]])
    for stretch in np.linspace(-2e-4, 2e-4, 11):
        motion = np.array([[0, 0, 0], [stretch, 0, 0], [0, 0, -1.5e-4], [stretch, 0, 1.5e-4]])
        _, (force,) = step_of(pairs, x0, BARRIER).forces(x0 + motion)
        along, _, across = abs(force).max(axis=0)
        assert along < 1e-3 * across
