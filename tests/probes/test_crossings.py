"""Edges that pierce triangles are counted exactly, touching ones are not, on any number of ranks."""

from __future__ import annotations

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.contact.broad_phase.box_tree import CollisionPrimitives
from gossamer_fx.contact.narrow_phase.intersections import _exact_sign, intersections
from meshes.sheet import sheet

LAW = gx.Miyazaki(E=1e9, nu=0.3, density=1400.0, thickness=1e-4)


def film(comm, name, moved, n=4):
    return gx.Membrane(sheet(comm, n, n), LAW, name=name, displacement=lambda X: moved(X) - X)


def upright(height):
    """A square that stands across the middle of the unit square, from `height` upwards."""
    return lambda X: np.vstack([0 * X[0] + 0.4321, 0.1 + 0.8 * X[1], X[0] + height])


def count(films, *probed):
    run = gx.Simulation(gx.Scene(*films), gx.Midpoint(dt=1e-3))
    return gx.probes.Crossings(*(probed or films))(run)


@pytest.mark.mpi
def test_two_films_that_cross_touch_or_part(comm) -> None:
    flat = film(comm, "flat", lambda X: X)
    crossing, touching, apart = (
        film(comm, name, upright(height))
        for name, height in (("crossing", -0.4), ("touching", 0.0), ("apart", 0.1))
    )
    assert count([flat, crossing]) > 5
    assert count([flat, touching]) == 0
    assert count([flat, apart]) == 0
    assert count([flat, crossing], flat) == 0


@pytest.mark.mpi
def test_the_count_is_that_of_all_pairs_in_turn(comm) -> None:
    """Against a sum over all pairs of edges and triangles."""
    wavy = film(comm, "wavy", lambda X: np.vstack([X[0], X[1], 0.3 * np.sin(5 * X[0]) + 0.05]))
    flat = film(comm, "flat", lambda X: X, 5)
    run = gx.Simulation(gx.Scene(wavy, flat), gx.Midpoint(dt=1e-3))
    probe = gx.probes.Crossings(wavy, flat)
    found = probe(run)
    surface = probe._surface
    x = np.concatenate(
        [
            np.concatenate(comm.allgather(f.initial_state()[0].reshape(-1, 3)))[n]
            for f, n in zip(probe.bodies, probe._nodes, strict=True)
        ]
    )
    pierced = 0
    for p, q in surface.edges:
        for a, b, c in surface.triangles:
            if {p, q} & {a, b, c}:
                continue
            volume = lambda i, j, k, l: np.linalg.det(x[[j, k, l]] - x[i])  # noqa: E731,E741
            sides = volume(a, b, c, p) * volume(a, b, c, q)
            u, v, w = volume(p, q, a, b), volume(p, q, b, c), volume(p, q, c, a)
            if sides < 0 and (min(u, v, w) > 0 or max(u, v, w) < 0):
                pierced += 1
                break
    assert found == pierced > 0


@pytest.mark.mpi
def test_a_fold_does_not_pierce_itself(comm) -> None:
    """Neighbouring panels touch along their fold, where double precision has no sign."""
    folds = gx.fold.Zigzag(length=0.8, panels=5, angle=1.4)
    sail = gx.Membrane(sheet(comm, 20, 4, 0.8, 0.1), LAW)
    run = gx.Simulation(gx.Scene(sail, folds.start(sail)), gx.Midpoint(dt=1e-3))
    assert gx.probes.Crossings(sail)(run) == 0


def test_signs_of_volumes_near_zero() -> None:
    """Points on a plane, and one moved by the last bit; the coordinates are no round numbers."""
    corners = np.array([[0.1, 0.2, 0.3], [1.1, 0.3, 0.7], [0.4, 1.3, 0.9], [0.0, 0.0, 0.0]])
    corners[3] = corners[0] + 0.25 * (corners[1] - corners[0]) + 0.5 * (corners[2] - corners[0])
    exact = [
        _exact_sign(np.vstack([corners[:3], corners[3] + [0, 0, bits * 2.0**-53]]))
        for bits in (-4, 4)
    ]
    assert exact == [-1, 1] or exact == [1, -1]
    assert _exact_sign(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])) == 0


def test_the_count_follows_the_exact_sign_near_zero() -> None:
    """An edge from above ends at a triangle, to the last bits: it pierces where its end is below or not at all."""
    rng, seen = np.random.default_rng(5), set()
    nodes = np.arange(5, dtype=np.int32)
    surface = CollisionPrimitives(
        nodes, nodes[None, 3:], nodes[None, :3], np.zeros(5, dtype=np.uint8)
    )
    for _ in range(50):
        corners = rng.integers(1, 2**20, (3, 3)) / 2**20
        end = np.array([0.25, 0.25, 0.5]) @ corners  # without round-off
        up = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        for bits in range(-4, 5):
            moved = end + bits * 2.0**-53 * np.sign(up)
            sides = [_exact_sign(np.vstack([corners, point])) for point in (end + up, moved)]
            found = intersections(surface, np.vstack([corners, end + up, moved]))
            assert len(found) == (sides[0] * sides[1] < 0)
            seen.add(sides[0] * sides[1])
    assert seen == {-1, 0, 1}


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: gx.probes.Crossings(), "give one or several"),
        (lambda: gx.probes.Crossings(1), "give a Membrane"),
    ],
)
def test_what_has_no_crossings_is_refused(call, words: str) -> None:
    with pytest.raises(gx.InputError, match=words):
        call()
