"""A cone as an obstacle: exact distances and derivatives, force balance on its slope, impacts."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.mechanics.contact.cone import EdgeCone, PointInCone
from gossamer_fx.mechanics.contact.contact_step import (
    ContactLaw,
    PairState,
    PairStep,
    energy_of_pairs,
    unit_energies,
)
from gossamer_fx.mechanics.contact.narrow_phase.ccd import find_collisions
from gossamer_fx.mechanics.contact.pairs import STENCILS, ActivePairs, PairTable, closest_points
from gossamer_fx.meshes.line import line
from tests.contact.random_pairs import step_of
from tests.contact.scenes import count_intersections, film, simulate

KINDS = (EdgeCone.number, PointInCone.number)
both_kinds = pytest.mark.parametrize("kind", KINDS, ids=["outside", "inside"])


def edges_and_axes(n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return n random edges and axes (n, 4, 3), a tenth of them parallel, and the tapers T (n,)."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(n, 4, 3))
    parallel = slice(0, n // 10)
    x[parallel, 1] = x[parallel, 0] + 0.3 * (x[parallel, 3] - x[parallel, 2])
    length = np.linalg.norm(x[:, 3] - x[:, 2], axis=1)
    # The balls at both ends of an axis are not within each other.
    return x, length * rng.uniform(-0.95, 0.95, n)


def points_in_cones(n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return n points in cones as pairs (n, 4, 3), their shapes (n,), and gaps (n,) from the
    mantle."""
    rng = np.random.default_rng(seed)
    half_angle = rng.uniform(0.2, 1.2, n)
    frames = np.linalg.qr(rng.normal(size=(n, 3, 3)))[0]
    height = rng.uniform(0.5, 2, n)
    distance = height * np.tan(half_angle) * rng.uniform(0.5, 0.9, n)
    azimuth = rng.uniform(0, 2 * np.pi, n)
    components = np.column_stack([distance * np.cos(azimuth), distance * np.sin(azimuth), height])
    apex = rng.normal(size=(n, 3))
    behind = rng.uniform(1, 2, n)
    x = np.empty((n, 4, 3))
    x[:, 0] = apex + np.einsum("nk,nkc->nc", components, frames)
    x[:, 1] = apex - behind[:, None] * frames[:, 2]
    x[:, 2:] = np.cos(half_angle)[:, None, None] * frames[:, :2]
    gap = height * np.sin(half_angle) - distance * np.cos(half_angle)
    return x, behind * np.sin(half_angle), gap


def table_of(kind: int, shape: np.ndarray) -> PairTable:
    n = len(shape)
    points = np.arange(4 * n, dtype=np.int32).reshape(n, 4)
    return PairTable(np.full(n, kind, np.uint8), points, shape=shape)


def flat(x: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(x.reshape(-1, 3))


def active_pairs(kind: int, n: int = 200) -> tuple[ActivePairs, np.ndarray]:
    """Return n pairs that nearly all have energy, and their points (n, 4, 3)."""
    if kind == EdgeCone.number:
        x, shape = edges_and_axes(n)
        shape = 0.3 * shape
        s, _ = closest_points(table_of(kind, shape), flat(x))
        # From a tenth to nine tenths of the range, and some beyond it.
        width = np.abs(s) / np.random.default_rng(1).uniform(0.1, 1.1, n)
        offset = np.zeros(n)
    else:
        x, offset, gap = points_in_cones(n)
        shape = offset
        width = gap / np.random.default_rng(1).uniform(0.1, 1.1, n)
    table = table_of(kind, shape)
    pairs = ActivePairs(
        kind=table.kind,
        points=table.points,
        shape=shape,
        identifier=np.arange(n),
        stiffness=np.ones(n),
        width=width,
        offset=offset,
    )
    return pairs, x


def test_the_distance_of_an_edge_is_that_of_the_nearest_ball() -> None:
    x, taper = edges_and_axes(200)
    found, parameters = closest_points(table_of(EdgeCone.number, taper), flat(x))
    grid = np.linspace(0, 1, 301)
    u, v = np.meshgrid(grid, grid, indexing="ij")
    for (a, b, c, d), one, s, (at_u, at_v) in zip(x, taper, found, parameters, strict=True):
        z = a + u[..., None] * (b - a) - c - v[..., None] * (d - c)
        least = (np.linalg.norm(z, axis=-1) - one * v).min()
        # No point of the grid is nearer, and one is as near as the grid is fine.
        assert s - 1e-12 <= least < s + 1e-3
        at = a + at_u * (b - a) - c - at_v * (d - c)
        assert s == pytest.approx(np.linalg.norm(at) - one * at_v, abs=1e-13)


def test_the_gap_in_a_cone_is_that_of_its_mantle() -> None:
    x, shape, gap = points_in_cones(200)
    s, _ = closest_points(table_of(PointInCone.number, shape), flat(x))
    found = STENCILS[PointInCone.number].gap(s, np.zeros(200), shape)
    assert found == pytest.approx(gap, abs=1e-14)


@both_kinds
def test_derivatives_of_the_distance_agree_with_differences(kind: int) -> None:
    if kind == EdgeCone.number:
        x, shape = edges_and_axes(200)
        # Closest points of parallel edges jump.
        x, shape = x[20:], 0.5 * shape[20:]
    else:
        x, shape, _ = points_in_cones(200)
    table = table_of(kind, shape)
    s, parameters = closest_points(table, flat(x))
    stencil = STENCILS[kind]
    distance, gradient = stencil.derivatives(x, parameters, shape)
    assert distance == pytest.approx(s, abs=1e-13)
    of_parameters = stencil.parameter_derivatives(x, parameters, shape)
    h = 1e-6
    for point in range(4):
        for c in range(3):
            step = np.zeros((4, 3))
            step[point, c] = h
            ahead, uv_ahead = closest_points(table, flat(x + step))
            behind, uv_behind = closest_points(table, flat(x - step))
            # Central differences: h² and round-off over h.
            assert gradient[:, point, c] == pytest.approx((ahead - behind) / (2 * h), abs=1e-8)
            difference = (uv_ahead - uv_behind) / (2 * h)
            assert of_parameters[:, :, point, c] == pytest.approx(difference, abs=1e-6)


@both_kinds
@pytest.mark.parametrize("law", list(ContactLaw), ids=lambda law: law.name)
def test_forces_and_tangents_of_a_state_agree_with_differences(kind: int, law: ContactLaw) -> None:
    pairs, x = active_pairs(kind)
    state, of_points, tangents = step_of(pairs, flat(x), law, 1.0).forces_and_tangents(flat(x))
    touches = state == PairState.TOUCHES
    assert touches.sum() > 150
    tangents = tangents.reshape(-1, 12, 12)[touches]
    forces = of_points.reshape(-1, 12)[touches]
    h = 1e-6
    for k in range(12):
        step = np.zeros(12)
        step[k] = h
        ends = [flat(x + sign * step.reshape(4, 3)) for sign in (1, -1)]
        scaled = [energy_of_pairs(pairs, end, law)[1] for end in ends]
        energies = [unit_energies(pairs, one, law)[touches] for one in scaled]
        states = [PairStep.of_state(pairs, end, law) for end in ends]
        both = [
            state.forces(end)[1].reshape(-1, 12)[touches]
            for state, end in zip(states, ends, strict=True)
        ]
        size = np.abs(forces).max(axis=1)
        error = np.abs((energies[0] - energies[1]) / (2 * h) - forces[:, k])
        assert (error < 1e-6 * (1 + size)).all()
        error = np.abs((both[0] - both[1]) / (2 * h) - tangents[:, :, k]).max(axis=1)
        assert (error < 1e-5 * (1 + np.abs(tangents).max(axis=(1, 2)))).all()


@both_kinds
@pytest.mark.parametrize("law", list(ContactLaw), ids=lambda law: law.name)
def test_work_is_the_change_of_energy(kind: int, law: ContactLaw) -> None:
    pairs, x0 = active_pairs(kind)
    rng = np.random.default_rng(2)
    # A twentieth of the range, so that no pair passes; directions of boundaries do not move.
    moves = 0.05 * pairs.width[:, None, None] * rng.normal(size=x0.shape)
    if kind == PointInCone.number:
        moves[:, 2:] = 0
    x1 = x0 + moves
    state, forces = step_of(pairs, flat(x0), law).forces(flat(x1))
    touching = np.flatnonzero(state == PairState.TOUCHES)
    assert len(touching) > 150
    for i in touching:
        one = pairs.rows(np.array([i]))
        before, after = (energy_of_pairs(one, flat(x), law)[0] for x in (x0, x1))
        work = np.sum(forces[i] * moves[i])
        # The discrete gradient is exact; relative round-off of differences of energies.
        assert work == pytest.approx(after - before, rel=1e-9, abs=1e-12 * (1 + before))


@both_kinds
def test_forces_do_not_depend_on_the_unit_of_length(kind: int) -> None:
    pairs, x0 = active_pairs(kind)
    x1 = x0 + 0.2 * pairs.width[:, None, None] * np.random.default_rng(2).normal(size=x0.shape)
    # Directions of boundaries have no unit, and do not move.
    directions = slice(2, 2 if kind == EdgeCone.number else 4)
    x1[:, directions] = x0[:, directions]

    def forces_in(unit: float) -> np.ndarray:
        """The forces, with lengths as multiples of a unit [1/m]."""
        scaled = replace(
            pairs,
            width=unit * pairs.width,
            offset=unit * pairs.offset,
            shape=unit * np.asarray(pairs.shape),
        )
        ends = [unit * x0, unit * x1]
        for end, x in zip(ends, (x0, x1), strict=True):
            end[:, directions] = x[:, directions]
        state, forces = step_of(scaled, flat(ends[0]), ContactLaw.PENALTY).forces(flat(ends[1]))
        assert np.count_nonzero(state == PairState.TOUCHES) > 150
        forces = forces * unit
        forces[:, directions] /= unit
        return forces

    in_metres = forces_in(1.0)
    error = np.abs(forces_in(1000.0) - in_metres).max(axis=(1, 2))
    assert (error < 1e-8 * np.abs(in_metres).max(axis=(1, 2), initial=1.0)).all()


def test_edges_that_are_free_keep_their_gap_on_the_way() -> None:
    """Continuous collision detection: no motion that it lets pass comes nearer than the least gap,
    and it lets most of those pass that stay clear."""
    n = 400
    x0, taper = edges_and_axes(n, seed=5)
    x1 = x0 + np.random.default_rng(6).normal(size=(n, 1, 3)) * [[[1], [1], [0], [0]]]
    table = table_of(EdgeCone.number, taper)
    # The balls at the starts of the axes have half of the distance as radii.
    s, _ = closest_points(table, flat(x0))
    kept = np.flatnonzero(s > 0.05)
    table = table.rows(kept)
    radius = 0.5 * s[kept]
    gap = s[kept] - radius
    stopped = find_collisions(table, flat(x0), flat(x1), radius, gap, 0.1 * gap)
    least = gap.copy()
    for t in np.linspace(0, 1, 400):
        between, _ = closest_points(table, flat(x0 + t * (x1 - x0)))
        least = np.minimum(least, between - radius)
    is_free = np.ones(len(kept), bool)
    is_free[stopped] = False
    assert 30 < is_free.sum() < len(kept) - 30, is_free.sum()
    assert (least[is_free] >= 0.1 * gap[is_free] - 1e-12).all()
    # Gaps that fall below half as much again may be refused.
    assert (least[~is_free] < 0.15 * gap[~is_free]).mean() > 0.95


# ---- force balance on a slope ----

HALF_ANGLE = 0.5
SIN = math.sin(HALF_ANGLE)
COS = math.cos(HALF_ANGLE)
GRAVITY = 9.81
LINE_DENSITY = 0.02
RADIUS = 1e-3
ROPE = gx.CableLaw(EA=1e5, line_density=LINE_DENSITY)


@pytest.mark.mpi(1)
@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("law", ["barrier", "penalty"])
def test_a_rope_on_a_slope_presses_with_the_normal_part_of_its_weight(comm, inside, law) -> None:
    """N = W sin α along the normal of the mantle, and the rope is drawn by T = W cos α at its top.

    The generator on which the rope lies is the x axis, and gravity is turned accordingly.
    """
    side = 1 if inside else -1
    axis = np.array([COS, 0.0, side * SIN])
    cone = gx.contact.Cone(
        start=(0, 0, 0), end=tuple(2 * axis), radii=(0, 2 * math.tan(HALF_ANGLE)), inside=inside
    )
    height = RADIUS + 0.8e-3
    rope = gx.Cable(line(comm, [(0.5, 0, height), (1.5, 0, height)], 10), ROPE)
    contact = gx.Contact(
        rope, cone, distance=1e-3, stiffness=1e7, law=law, radius={rope.name: RADIUS}
    )
    weight = LINE_DENSITY * 1.0 * GRAVITY
    scene = gx.Scene(
        contact,
        gx.Gravity(rope, (GRAVITY * COS, 0.0, -GRAVITY * SIN)),
        gx.Fixed(rope, "start", components=(0,)),
        gx.Fixed(rope, "line", components=(1,)),
    )
    hung = gx.Equilibrium(scene)
    hung.find()
    push = [gx.probes.ContactForce(contact, rope, axis=axis)(hung) for axis in "xyz"]
    assert push[2] == pytest.approx(weight * SIN, rel=1e-6)
    assert abs(push[0]) < 1e-6 * weight
    assert gx.probes.ContactForce(contact, cone, axis="z")(hung) == pytest.approx(-push[2])
    # Within the first of ten cells the tension falls by a tenth.
    tension = gx.probes.Tension(rope, "largest")(hung)
    assert tension == pytest.approx(0.95 * weight * COS, rel=1e-4)


@pytest.mark.mpi
def test_a_ring_on_a_cone_is_stretched_by_its_weight(comm) -> None:
    """Contact bears the weight, N = W/sin α on the mantle, and the ring of n straight segments the
    tension W cot α/(2 n tan(π/n))."""
    n = 24
    rope_radius = 0.3
    # Height of the apex over the ring, whose segments lie on the mantle with their middles.
    height = 0.8e-3 + RADIUS
    inner = rope_radius * math.cos(math.pi / n)
    apex = inner / math.tan(HALF_ANGLE) - height / SIN
    angles = 2 * np.pi * np.arange(n) / n
    points = np.column_stack([np.cos(angles), np.sin(angles), 0 * angles]) * rope_radius
    ring = gx.Cable(line(comm, points.tolist(), 1, closed=True), ROPE)
    slope = math.tan(HALF_ANGLE)
    cone = gx.contact.Cone(
        start=(0, 0, apex - 2), end=(0, 0, apex), radii=(2 * slope, 0), name="cone"
    )
    contact = gx.Contact(ring, cone, distance=1e-3, stiffness=1e6, radius={ring.name: RADIUS})
    scene = gx.Scene(contact, gx.Gravity(ring, (0.0, 0.0, -GRAVITY)))
    hung = gx.Equilibrium(scene)
    result = hung.find()
    # The mantle resists no turn about its axis.
    assert set(result.free) == {"rotation z"}
    weight = LINE_DENSITY * n * 2 * rope_radius * math.sin(math.pi / n) * GRAVITY
    assert gx.probes.ContactForce(contact, ring, axis="z")(hung) == pytest.approx(weight, rel=1e-6)
    expected = weight / math.tan(HALF_ANGLE) / (2 * n * math.tan(math.pi / n))
    for which in ("least", "largest"):
        assert gx.probes.Tension(ring, which)(hung) == pytest.approx(expected, rel=2e-3)


# ---- motion ----


@pytest.mark.mpi(1)
@pytest.mark.parametrize("law", ["barrier", "penalty"])
def test_a_film_that_falls_on_the_tip_is_slowed_and_conserves_energy(comm, law) -> None:
    thrown = film(comm, velocity=(0.1, 0.05, -2.0))
    tip = gx.contact.Cone(start=(0, 0, -0.05), end=(0.003, 0.002, -0.0015), radii=(0.02, 0))
    contact = gx.Contact(thrown, tip, distance=1e-3, law=law)
    run = simulate([contact], 4e-3, dt=5e-5)
    # The sharp tip has pushed the middle of the film upwards, and is not through it.
    assert run.totals.momentum[2] > 0.95 * run.first.momentum[2]
    assert abs(run.energy_error) < 1e-9
    assert count_intersections(run) == 0


@pytest.mark.parametrize("dt", [1e-4, 2e-3])
def test_nothing_passes_through_in_long_steps(dt: float) -> None:
    """A rope at 20 m/s meets the side of a slender cone: long steps are divided."""
    comm = MPI.COMM_SELF
    rope = gx.Cable(
        line(comm, [(-0.1, 0.01, 0), (0.1, 0.01, 0)], 8),
        gx.CableLaw(EA=500.0, line_density=LINE_DENSITY),
        velocity=lambda X: np.outer((0.0, -20.0, 0.0), np.ones(X.shape[1])),
    )
    needle = gx.contact.Cone(start=(0, 0, -0.1), end=(0, 0, 0.1), radii=(0.006, 0.001))
    contact = gx.Contact(rope, needle, distance=1e-3, radius={rope.name: RADIUS})
    run = simulate([contact], 4e-3, dt=dt)
    assert gx.probes.ContactGap(contact)(run) > 0
    # The ends have gone past the needle, the middle has not.
    y = run.system.unknowns.state[rope].positions()[:, 1]
    assert y.min() < -0.02
    assert y.max() > 0.002
    assert abs(run.energy_error) < 1e-8


def test_a_cone_of_no_slope_is_refused() -> None:
    for radii in ((0.1, 0.1), (-0.1, 0.2), (math.inf, 0.1)):
        with pytest.raises(gx.InputError, match="radii"):
            gx.contact.Cone(start=(0, 0, 0), end=(0, 0, 1), radii=radii)
    nowhere = gx.contact.Cone(start=(0, 0, 0), end=(0, 0, 0), radii=(0.1, 0.2))
    with pytest.raises(gx.InputError, match="length"):
        nowhere.parts()


def test_a_cone_is_drawn_closed_with_its_volume() -> None:
    """The volume is that of the frustum between the circles where the balls touch, and two caps."""
    cone = gx.contact.Cone(start=(0, 0, 0), end=(0, 0, 1), radii=(0.4, 0.1))
    solid = cone.solid(np.zeros((1, 3)))
    a, b, c = (solid.X[corners] for corners in solid.triangles.T)
    enclosed = np.einsum("ni,ni->n", np.cross(a, b), c).sum() / 6
    assert np.abs(np.cross(b - a, c - a).sum(axis=0)).max() < 1e-12
    slope = 0.3
    stretch = math.hypot(1, slope)
    frustum = math.pi / 3 * (0.4**2 + 0.4 * 0.1 + 0.1**2)
    caps = 0.0
    for radius, side in ((0.4, -1), (0.1, 1)):
        ball = radius * stretch
        # Height of the cap beyond the circle, which is `slope radius` from the ball's centre.
        cap = ball - side * slope * radius
        caps += math.pi * cap**2 * (3 * ball - cap) / 3
    # 32 points round the circles enclose a little less.
    assert 0.98 * (frustum + caps) < enclosed < frustum + caps
    room = gx.contact.Cone(start=(0, 0, 0), end=(0, 0, 1), radii=(0.4, 0.1), inside=True)
    assert not len(room.solid(np.zeros((1, 3))).triangles)
