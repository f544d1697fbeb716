"""Creases of deploying sails give and take the energy of their closed forms; effects follow their
criteria."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import crease_figures, first_time
from demos.sails import spin_deployment
from demos.studies import fold_memory


@pytest.mark.parametrize(("ratio", "share"), [(0.0, 1.0), (0.5, 0.25), (1.0, 0.0)])
def test_creases_begin_with_the_energy_of_their_rest_angle(
    comm, ratio: float, share: float
) -> None:
    """½ k (θ - s θ)² L is (1 - s)² of the energy of folds that are flat at rest."""
    case = spin_deployment.build(comm, n=4, crease=1e-3, set_angle_ratio=ratio)
    series = gx.Series(case.probes)
    run = case.simulation([series])
    run.run(until=4e-4)
    found = crease_figures(run, series, case)
    assert found["crease_start"] == pytest.approx(
        share * found["fold_energy"], rel=1e-3, abs=1e-3 * found["fold_energy"]
    )
    assert found["crease_angle"] == pytest.approx(1.0, abs=0.02)
    assert found["crease_loss"] == 0


def test_opening_a_fold_takes_what_its_rest_angle_tells(comm) -> None:
    """Two panels are flattened slowly from a fold of θ0: the work is ½ k L θ0² (2 s - 1), or k L φ
    (θ0 - φ/2)."""
    fold = gx.fold.Zigzag(length=0.2, panels=2, angle=0.6)
    # A fold turns by twice the angle of its panels.
    turned = 1.2
    length = 0.1
    stiffness = 0.01
    energy = stiffness * turned**2 / 2 * length
    φ = 0.35
    plastic = stiffness * φ * (turned - φ / 2) * length
    cases = [(0.0, None, -energy), (0.5, None, 0.0), (1.0, None, energy), (1.0, φ, plastic)]
    for ratio, yield_angle, expected in cases:
        work = _work_of_flattening(comm, fold, stiffness, ratio, yield_angle)
        assert work == pytest.approx(expected, rel=1e-3, abs=1e-3 * energy), (ratio, yield_angle)


def _work_of_flattening(comm, fold, stiffness: float, ratio: float, yield_angle) -> float:
    """Energy [J] that a fold takes, stored and dissipated, while its panels are turned until they
    are flat."""
    from gossamer_fx.meshes.sheet import sheet
    from gossamer_fx.presets.films import KAPTON_HN

    mesh = fold.mark(sheet(comm, 4, 2, width=0.2, height=0.1))
    film = gx.Membrane(mesh, KAPTON_HN.law(25e-6))
    creases = fold.creases(
        film, stiffness=stiffness, set_angle_ratio=ratio, yield_angle=yield_angle
    )

    def flattened(X, t):
        """Displacement (3, n) [m] of the isometric fold whose angle falls to zero at t = 1."""
        angle = fold.angle * (1 - t)
        from_fold = np.minimum(X[0], 0.2 - X[0])
        return np.stack([(math.cos(angle) - 1) * X[0], 0 * X[1], math.sin(angle) * from_fold])

    # The width is left free: the film bears no stress, and an equilibrium needs an unknown.
    guide = gx.Fixed(film, "film", motion=flattened, components=(0, 2))
    scene = gx.Scene(film, fold.start(film), *creases, guide)
    equilibrium = gx.Equilibrium(scene)
    total = []
    for t in np.linspace(0.0, 1.0, 9):
        found = equilibrium.find(at=float(t))
        stored = sum(found.totals.stored[crease.name] for crease in creases)
        total.append(stored + found.totals.dissipated)
    return total[-1] - total[0]


def test_first_time_at_a_limit() -> None:
    time = np.array([0.0, 1.0, 2.0])
    assert first_time(time, np.array([0.0, 5.0, 1.0]), 5.0) == 1.0
    assert first_time(time, np.array([0.0, 5.0, 1.0]), 6.0) == math.inf


@pytest.mark.parametrize(
    ("opened", "word"),
    [(math.inf, "prevents"), (0.11, "hinders"), (0.104, "has no effect"), (0.09, "helps")],
)
def test_effects_are_those_of_the_criteria(opened: float, word: str) -> None:
    assert fold_memory.EFFECTS[int(fold_memory.effect(opened, 0.1))] == word
    assert math.isnan(fold_memory.effect(opened, math.inf))


def test_every_case_names_arguments_of_its_demo() -> None:
    sets = [fold_memory.STUDY.case_set(MPI.COMM_SELF, quick) for quick in (False, True)]
    for case in [case for cases in sets for case in cases.cases]:
        given = fold_memory.arguments(case["case"])
        ratio = given.get("set_angle_ratio", 0.5)
        assert 0 <= ratio <= 1
        assert given.get("crease", 1.0) > 0
