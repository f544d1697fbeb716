"""Orthotropic films in motion: energy and momenta are kept while cells switch between taut,
wrinkled and slack."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from demos.studies.orthotropic import AXES, LAWS, MASS
from gossamer_fx.meshes.sheet import sheet
from tests.small_scenes import momentum_changes, run_until, thrown

FABRIC = LAWS["10:1"]
BRAID = LAWS["braid"]
RESIDUAL = gx.Orthotropic(1e9, 1e8, 0.3, 5e7, residual_stiffness=1e-3, **AXES, **MASS)
NEVER_WRINKLES = gx.LinearOrthotropic(1e9, 1e8, 0.3, 5e7, **AXES, **MASS)
ISOTROPIC = LAWS["TensionField"]


def free_sheet(comm, law, steps: int, order: int = 1, n: int = 6) -> gx.Simulation:
    """A free film, thrown: every step solved to 1e-12, so that what is measured is the rule."""
    film = gx.Membrane(sheet(comm, n, n), law, order=order, velocity=thrown)
    tolerances = gx.Tolerances(relative=1e-12)
    return run_until(steps * 1e-3, film, dt=1e-3, tolerances=tolerances)


def momentum_errors(run: gx.Simulation) -> list[float]:
    """Changes of momentum and angular momentum over those of the moving mass."""
    film_mass = MASS["density"] * MASS["thickness"]
    # √(2 m T) with a film of 1 m²: the largest momentum that this kinetic energy allows.
    scale = math.sqrt(2 * film_mass * run.first.kinetic)
    return [change / scale for change in momentum_changes(run)]


@pytest.mark.mpi(1)
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(
    "law",
    [FABRIC, BRAID, RESIDUAL, NEVER_WRINKLES],
    ids=["fabric", "braid", "residual stiffness", "never wrinkles"],
)
def test_a_free_sheet_keeps_energy_and_momenta(comm, law, order: int) -> None:
    run = free_sheet(comm, law, steps=20, order=order)
    # The film must be strained.
    assert run.totals.stored["film"] > 1e-8
    assert abs(run.energy_error) <= 1e-12
    assert max(momentum_errors(run)) <= 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("law", [FABRIC, BRAID], ids=["fabric", "braid"])
def test_a_free_sheet_keeps_energy_and_momenta_for_long(law) -> None:
    run = free_sheet(MPI.COMM_SELF, law, steps=1000)
    assert run.step == 1000
    # A thousand steps at 1e-12 each.
    assert abs(run.energy_error) <= 1e-9
    assert max(momentum_errors(run)) <= 1e-12
    isotropic = free_sheet(MPI.COMM_SELF, ISOTROPIC, steps=1000)
    # Orthotropic relaxation must not cost the tangent: at most half as many iterations more.
    assert run.iterations <= 1.5 * isotropic.iterations


def test_iterations_are_those_of_an_isotropic_film() -> None:
    fabric = free_sheet(MPI.COMM_SELF, FABRIC, steps=40)
    isotropic = free_sheet(MPI.COMM_SELF, ISOTROPIC, steps=40)
    assert fabric.iterations <= 1.5 * isotropic.iterations


def test_equal_stiffness_in_all_directions_moves_as_a_tension_field() -> None:
    found = free_sheet(MPI.COMM_SELF, LAWS["1:1"], steps=10)
    expected = free_sheet(MPI.COMM_SELF, ISOTROPIC, steps=10)
    x = found.system.unknowns.q0.array_r
    error = abs(x - expected.system.unknowns.q0.array_r).max()
    # Another code path for the same law, over ten steps that amplify round-off.
    assert error <= 1e-8
    assert found.totals.kinetic == pytest.approx(expected.totals.kinetic, rel=1e-9)


def test_energy_of_other_rules_and_steppers() -> None:
    """`GeneralizedAlpha` takes the stress at the end of a step: it loses energy and gains none."""
    film = gx.Membrane(sheet(MPI.COMM_SELF, 6, 6), FABRIC, velocity=thrown)
    run = gx.Simulation(gx.Scene(film), gx.GeneralizedAlpha(dt=1e-3))
    run.run(until=0.02)
    # The end-point stress dissipates some per cent in twenty steps of 1 ms.
    assert run.totals.energy == pytest.approx(run.first.energy, rel=0.05)


def test_a_reduced_film_keeps_energy(comm) -> None:
    """Sampled cells take the axes of the film by groups, which the sample does not have."""
    law = gx.Orthotropic(1e9, 1e8, 0.3, 5e7, direction={"film": (1.0, 0.3, 0.0)}, **MASS)
    film = gx.Membrane(sheet(comm, 6, 6), law, velocity=thrown)
    shapes = gx.reduction.Snapshots(film)
    X = film.space.tabulate_dof_coordinates()[: film.block.index_map.size_local]
    x = X[:, 0]
    y = X[:, 1]
    for k in range(1, 4):
        bent = X.copy()
        bent[:, 2] = 0.1 * np.sin(k * np.pi * x) * np.cos(np.pi * y)
        bent[:, 0] += 0.02 * np.sin(k * np.pi * y)
        shapes.positions.append(bent)
    reduced = gx.reduction.reduce(film, [shapes], modes=6)
    tolerances = gx.Tolerances(relative=1e-12)
    # Reduction keeps the rule, so energy closes; a sum over sampled cells has more round-off.
    run = run_until(0.02, reduced, dt=1e-3, tolerances=tolerances)
    assert max(run.totals.stored.values()) > 1e-9
    assert abs(run.energy_error) <= 1e-11


@pytest.mark.parametrize("law", [FABRIC, NEVER_WRINKLES], ids=["wrinkles", "never"])
@pytest.mark.parametrize("tension_only", [False, True])
def test_damping_takes_what_the_energy_loses(law, tension_only: bool) -> None:
    film = gx.Membrane(sheet(MPI.COMM_SELF, 5, 5), law, velocity=thrown)
    damping = gx.Damping(film, stiffness_factor=1e-4, tension_only=tension_only)
    tolerances = gx.Tolerances(relative=1e-12)
    run = run_until(0.02, film, damping, dt=1e-3, tolerances=tolerances)
    assert run.totals.dissipated > 1e-8
    assert abs(run.energy_error) <= 1e-12
