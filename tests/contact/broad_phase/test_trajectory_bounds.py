"""Candidates are complete as long as points keep their course, and few where points only move together."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.contact.broad_phase.box_tree import CollisionPrimitives
from gossamer_fx.contact.broad_phase.candidates import Candidates
from gossamer_fx.contact.broad_phase.trajectory_bounds import RigidDrift, TrajectoryBounds
from gossamer_fx.contact.potential import EDGE_EDGE, POINT_TRIANGLE, squared_distances
from meshes.sheet import sheet

TURN = RigidDrift(
    0.5, np.array([0.3, 0.1, -0.2]), np.array([2.0, -1.0, 0.5]), np.array([0.0, 3.0, 4.0])
)


def drifted(drift: RigidDrift, x: np.ndarray, time: float) -> np.ndarray:
    """Exactly, by many short turns."""
    n, r = 20000, x - drift.centre
    τ = (time - drift.time) / n
    for _ in range(n):
        middle = r + τ / 2 * np.cross(drift.spin, r)
        r = r + τ * np.cross(drift.spin, middle)
    return r + drift.centre + (time - drift.time) * drift.velocity


def test_a_drift_is_undone() -> None:
    x = np.random.default_rng(0).uniform(size=(5, 3))
    assert TURN.undone(drifted(TURN, x, 0.9), 0.9) == pytest.approx(x, abs=1e-7)
    assert TURN.undone(x, 0.5) == pytest.approx(x)


def test_the_drift_of_points_is_their_rigid_motion() -> None:
    x = np.random.default_rng(1).uniform(size=(20, 3))
    found = RigidDrift.of(x, TURN.rates(x), 0.5)
    assert found.spin == pytest.approx(TURN.spin)
    assert found.rates(x) == pytest.approx(TURN.rates(x))
    line = x[:1] + np.linspace(0, 1, 4)[:, None]  # its turn about itself is not seen
    assert RigidDrift.of(line, TURN.rates(line), 0.5).rates(line) == pytest.approx(TURN.rates(line))


def test_no_pair_is_missed_while_points_keep_their_course() -> None:
    rng = np.random.default_rng(2)
    middle = rng.uniform(size=(60, 1, 3))
    x = (middle + rng.normal(scale=0.05, size=(60, 3, 3))).reshape(-1, 3)
    triangles = np.arange(180, dtype=np.int32).reshape(60, 3)
    edges = np.ascontiguousarray(triangles[:, [[0, 1], [1, 2], [0, 2]]].reshape(-1, 2))
    surface = CollisionPrimitives(
        np.arange(180, dtype=np.int32), edges, triangles, np.zeros(180, np.uint8)
    )
    none = np.zeros((0, 4), np.int32), np.zeros(0, np.uint8), np.zeros(0, np.int64)
    bodies = SimpleNamespace(
        surface=surface,
        radius=np.full(180, 2e-3),
        area=np.ones(180),
        own_vertices=np.arange(180, dtype=np.int32),
        own_edges=np.arange(180, dtype=np.int32),
        wall_pairs=lambda: none,
        wall_radius=lambda nodes: np.zeros(len(nodes)),
        areas_of=lambda kind, nodes, numbers: np.ones(len(kind)),
        name=lambda kind, numbers: numbers[:, 0] * 1000 + numbers[:, 1] + 10**6 * kind.astype(int),
    )
    rates = np.repeat(rng.normal(scale=0.3, size=(60, 3)), 3, axis=0)
    course = TrajectoryBounds(TURN, x, rates, rng.uniform(0.01, 0.03, 180), duration=0.2)
    distance = 0.02
    known = set(Candidates.find(bodies, course, distance).names.tolist())  # type: ignore[arg-type]

    names, nodes, kinds = [], [], []
    for v in range(180):
        for t in range(60):
            if v // 3 != t:
                names.append(v * 1000 + t + 10**6 * POINT_TRIANGLE)
                nodes.append([v, *triangles[t]])
                kinds.append(POINT_TRIANGLE)
    for i in range(180):
        for j in range(i + 1, 180):
            if i // 3 != j // 3:
                names.append(i * 1000 + j + 10**6 * EDGE_EDGE)
                nodes.append([*edges[i], *edges[j]])
                kinds.append(EDGE_EDGE)
    all_nodes, all_kinds = np.array(nodes, dtype=np.int32), np.array(kinds, dtype=np.uint8)
    assert len(known) < 0.5 * len(names)
    near_ones = 0
    for time in (0.5, 0.6, 0.7):
        off = rng.normal(size=x.shape)
        off *= (
            0.999
            * (course.margin * rng.uniform(size=180) ** 0.1 / np.linalg.norm(off, axis=1))[:, None]
        )
        here = np.ascontiguousarray(x + (time - 0.5) * rates + off)
        there = drifted(TURN, here, time)
        assert course.holds(there, time)
        near = np.sqrt(squared_distances(all_nodes, all_kinds, here)) - 4e-3 < distance
        near_ones += int(near.sum())
        assert {name for name, is_near in zip(names, near, strict=True) if is_near} <= known
    assert near_ones > 40
    assert course.holds(drifted(TURN, x + 0.2 * rates, 0.75), 0.75)  # they wait at its end
    assert not course.holds(drifted(TURN, x + 0.4 * rates, 0.9), 0.9)
    off = np.zeros_like(x)
    off[7] = 1.01 * course.margin[7] / 3**0.5
    assert not course.holds(x + off, 0.5)


@pytest.mark.parametrize("spin", [0.0, 40.0])
def test_a_stack_that_spins_has_no_more_candidates(spin: float) -> None:
    films = [
        gx.Membrane(
            sheet(MPI.COMM_SELF, 6, 6, 0.3, 0.3),
            gx.Miyazaki(E=1e9, nu=0.3, density=1400.0, thickness=1e-4, residual_stiffness=1e-6),
            name=f"film {k}",
            displacement=lambda X, k=k: np.vstack([0 * X[0], 0 * X[0], 0 * X[0] + 3e-3 * k]),
            velocity=lambda X: spin * np.vstack([-(X[1] - 0.15), X[0] - 0.15, 0 * X[0]]),
        )
        for k in range(3)
    ]
    contact = gx.Contact(*films, distance=1e-3)
    run = gx.Simulation(gx.Scene(contact), gx.Midpoint(dt=1e-4))
    run.run(until=1e-3)
    group = run.system.active_sets[0].groups[contact]
    assert group.searches <= 4
    assert len(group.found.names) <= 100
