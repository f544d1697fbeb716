"""Pairs that are found in each step: growing pattern of the matrix, rejected steps, and
conservation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gossamer_fx as gx
from tests.conservation.colliding_spheres import CollidingSpheres, Collisions
from tests.small_scenes import run_until


def cloud(foresight: float = 1.0, dt: float = 2e-3, **options) -> gx.Simulation:
    """27 spheres that fly at each other's middle, with some swirl."""
    places = np.stack(np.meshgrid(*3 * [np.linspace(-1, 1, 3)]), axis=-1).reshape(-1, 3)
    noise = np.random.default_rng(7).normal(scale=0.05, size=places.shape)
    masses = [
        gx.PointMass(
            1.0,
            tuple(x + δ),
            velocity=tuple(np.cross((0.0, 0.0, 1.0), x) - 2 * x),
            name=f"m{k}",
        )
        for k, (x, δ) in enumerate(zip(places, noise, strict=True))
    ]
    spheres = CollidingSpheres(tuple(m.port() for m in masses), 0.2, 5e4, foresight)
    return gx.Simulation(gx.Scene(*masses, spheres), gx.Midpoint(dt=dt), **options)


def collisions(run: gx.Simulation) -> Collisions:
    return next(c for c in run.system.equations.compiled if isinstance(c, Collisions))


@pytest.mark.mpi
def test_spheres_that_are_found_anew_collide_without_loss() -> None:
    run = cloud(dt=5e-3)
    assert not collisions(run).pairs
    run.run(until=0.5)
    assert collisions(run).found > 0, "no pair was found after the start"
    assert run.totals.kinetic > 0
    # 200 steps of 5 ms are 0.5 s with many collisions; each is solved to the default tolerance.
    assert abs(run.energy_error) < 1e-11
    # 27 kg at about 2 m/s.
    scale = 27 * 2.0
    error = np.abs(run.totals.momentum - run.first.momentum).max()
    assert error < 1e-12 * scale
    error = np.abs(run.totals.angular_momentum - run.first.angular_momentum).max()
    assert error < 1e-11 * scale


def test_pairs_that_were_overlooked_are_found_after_the_step() -> None:
    late = cloud(foresight=0.0)
    early = cloud()
    late.run(until=0.4)
    early.run(until=0.4)
    assert collisions(late).widened > 0 and collisions(early).widened == 0
    x = [run.system.unknowns.state.vectors(collisions(run).spheres.ports) for run in (late, early)]
    error = np.abs(x[0] - x[1]).max()
    # Pairs that are added after a solve lead to the same step, up to Newton's tolerance.
    assert error < 1e-9


def test_a_step_in_which_spheres_pass_through_each_other_is_refused() -> None:
    a = gx.PointMass(
        1.0,
        # Not half a metre: then both would end in one point, and round-off would decide what
        # follows.
        (-0.46, 0.0, 0.0),
        velocity=(50.0, 0.0, 0.0),
        name="a",
    )
    b = gx.PointMass(1.0, (0.46, 0.0, 0.0), velocity=(-50.0, 0.0, 0.0), name="b")
    spheres = CollidingSpheres((a.port(), b.port()), 0.1, 1e8)
    run = run_until(3e-2, a, b, spheres, dt=1e-2)
    x = run.system.unknowns.state.vectors(spheres.ports)
    assert run.substeps > 0 and x[0, 0] < x[1, 0]
    assert abs(run.energy_error) < 1e-10


def test_a_restart_finds_the_pairs_again(tmp_path: Path) -> None:
    whole = cloud(checkpoints=gx.Checkpoints(tmp_path / "points", every=50))
    whole.run(until=0.3)
    again = cloud(restart=tmp_path / "points")
    again.run(until=0.4)
    whole.run(until=0.4)
    error = np.abs(whole.system.unknowns.q0.array_r - again.system.unknowns.q0.array_r).max()
    # The checkpoint holds coordinates and pairs in full precision.
    assert error < 1e-12
