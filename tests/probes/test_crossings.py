"""`Crossings` counts edges that intersect triangles, not those that touch, on any number of
ranks."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import sheet
from tests.small_scenes import WRINKLING


def film(comm, name, moved, n=4):
    """Return a film on the unit square whose points X go to moved(X)."""
    return gx.Membrane(sheet(comm, n, n), WRINKLING, name=name, displacement=lambda X: moved(X) - X)


def upright(height):
    """Return the map to a square across the middle of the unit square, from a height [m]
    upwards."""
    return lambda X: np.vstack([0 * X[0] + 0.4321, 0.1 + 0.8 * X[1], X[0] + height])


def count(films, *probed):
    """Return the crossings of all films of a scene, or of those that are probed."""
    run = gx.Simulation(gx.Scene(*films), gx.Midpoint(dt=1e-3))
    return gx.probes.Crossings(*(probed or films))(run)


@pytest.mark.mpi
def test_two_films_that_cross_touch_or_part(comm) -> None:
    flat = film(comm, "flat", lambda X: X)
    crossing = film(comm, "crossing", upright(-0.4))
    touching = film(comm, "touching", upright(0.0))
    apart = film(comm, "apart", upright(0.1))
    # A film of several cells crosses the other in more than five edges.
    assert count([flat, crossing]) > 5
    assert count([flat, touching]) == 0
    assert count([flat, apart]) == 0
    assert count([flat, crossing], flat) == 0


def volume(x: np.ndarray, i: int, j: int, k: int, m: int) -> float:
    """Return six times the volume between four points."""
    return float(np.linalg.det(x[[j, k, m]] - x[i]))


def crosses(x: np.ndarray, edge: np.ndarray, triangle: np.ndarray) -> bool:
    """Return whether an edge intersects a triangle without a common point."""
    p, q = edge
    a, b, c = triangle
    if {p, q} & {a, b, c}:
        return False
    turns = [volume(x, p, q, a, b), volume(x, p, q, b, c), volume(x, p, q, c, a)]
    # Both ends are on different sides of the triangle's plane.
    is_across = volume(x, a, b, c, p) * volume(x, a, b, c, q) < 0
    return is_across and (min(turns) > 0 or max(turns) < 0)


def crossed_films(comm):
    """A run of a wavy film through a flat one, and the probe of their crossings."""
    wavy = film(comm, "wavy", lambda X: np.vstack([X[0], X[1], 0.3 * np.sin(5 * X[0]) + 0.05]))
    # Moved a little: edges in the plane of an edge of the film would cross triangles or not by
    # round-off of the mesh.
    flat = film(comm, "flat", lambda X: np.vstack([X[0], X[1] + 0.013, X[2]]), 5)
    run = gx.Simulation(gx.Scene(wavy, flat), gx.Midpoint(dt=1e-3))
    return run, gx.probes.Crossings(wavy, flat)


@pytest.mark.mpi
def test_the_count_is_that_of_all_pairs_in_turn(comm) -> None:
    run, probe = crossed_films(comm)
    found = probe(run)
    # One rank knows all edges and triangles.
    alone, probe_alone = crossed_films(MPI.COMM_SELF)
    found_alone = probe_alone(alone)
    mesh = probe_alone._mesh(alone.system)
    x = mesh.points.at(alone.system.unknowns.q0, alone.system.unknowns.time)
    expected = sum(
        any(crosses(x, edge, triangle) for triangle in mesh.surface.triangles)
        for edge in mesh.surface.edges
    )
    # At least one, or the waves are too flat.
    assert found == found_alone == expected > 0


@pytest.mark.mpi
def test_a_fold_does_not_cross_itself(comm) -> None:
    """Neighbouring panels touch along their fold, where double precision has no sign."""
    folds = gx.fold.Zigzag(length=0.8, panels=5, angle=1.4)
    sail = gx.Membrane(sheet(comm, 20, 4, 0.8, 0.1), WRINKLING)
    run = gx.Simulation(gx.Scene(sail, folds.start(sail)), gx.Midpoint(dt=1e-3))
    assert gx.probes.Crossings(sail)(run) == 0


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: gx.probes.Crossings(), r"bodies is \(\)"),
        (lambda: gx.probes.Crossings(1), r"bodies\[0\] is 1"),
    ],
)
def test_what_has_no_crossings_is_refused(call, words: str) -> None:
    with pytest.raises(gx.InputError, match=words):
        call()
