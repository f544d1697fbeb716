"""Iterates that stay on their sides: momentum, sides and what is not touched; solutions that do not change."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc

import gossamer_fx as gx
from gossamer_fx.contact import separation
from gossamer_fx.contact.pair_table import ActivePairs, PairKind
from gossamer_fx.contact.potential import ContactLaw, PairState, evaluate
from gossamer_fx.contact.separation import Separation
from tests.contact.random_pairs import near_pairs
from tests.contact.scenes import film

DISTANCE = 0.1


class FreePoints:
    """Points that are unknowns of their own, on one rank."""

    def __init__(self, count: int) -> None:
        self.count = count
        self.body_count = count

    def of_block_rows(self, vector: PETSc.Vec) -> np.ndarray:
        values: np.ndarray = vector.array_r.reshape(-1, 3)
        return values

    def add(self, values: np.ndarray, vector: PETSc.Vec) -> None:
        vector.array[:] += values.ravel()


def parted(
    pairs: ActivePairs, x0: np.ndarray, x1: np.ndarray, masses: np.ndarray, held: np.ndarray
) -> np.ndarray:
    """The end points without passed pairs, by the masses (m,) and positions of fixed unknowns."""
    M = PETSc.Mat().createDiagonal(
        PETSc.Vec().createWithArray(np.repeat(masses, 3), comm=PETSc.COMM_SELF)
    )
    system = SimpleNamespace(M=M, supports=SimpleNamespace(held=held), comm=MPI.COMM_SELF)
    parting = Separation(FreePoints(len(x0)), system)
    parting.begin_step()
    change = PETSc.Vec().createSeq(3 * len(x0))
    parting.of(pairs, x0, x1, change)
    return x1 + change.array_r.reshape(-1, 3)


def have_passed(pairs: ActivePairs, x0: np.ndarray, x1: np.ndarray) -> np.ndarray:
    state = evaluate(pairs, x0, x1, ContactLaw.PENALTY, 0.5).state
    return state == PairState.PASSED


@pytest.mark.parametrize("kind", [PairKind.POINT_TRIANGLE, PairKind.EDGE_EDGE])
def test_pairs_that_passed_are_parted_without_a_change_of_momentum(kind):
    """A pair has its momentum and its moment before and after; pairs that have not passed stay as they are."""
    pairs, x0, _ = near_pairs(kind, 2000, seed=5, d=DISTANCE)
    rng = np.random.default_rng(8)
    x1 = x0 + 0.5 * DISTANCE * rng.normal(size=x0.shape)
    masses = rng.uniform(0.5, 2.0, len(x0))
    before = have_passed(pairs, x0, x1)
    assert 20 < before.sum() < 1000
    end = parted(pairs, x0, x1, masses, np.zeros(0, dtype=int))
    assert not have_passed(pairs, x0, end).any()
    moved = (end - x1).reshape(-1, 4, 3)
    assert (moved[~before] == 0).all()
    impulses = masses.reshape(-1, 4, 1) * moved
    assert abs(impulses.sum(axis=1)).max() < 1e-14


def test_fixed_points_do_not_give_way():
    """Of a point that passes a fixed triangle only the point moves back."""
    pairs, x0, _ = near_pairs(PairKind.POINT_TRIANGLE, 200, seed=2, d=DISTANCE)
    x1 = x0.copy().reshape(-1, 4, 3)
    normal = np.cross(x1[:, 2] - x1[:, 1], x1[:, 3] - x1[:, 1])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    height = np.einsum("nc,nc->n", x1[:, 0] - x1[:, 1], normal)
    x1[:, 0] -= 1.5 * height[:, None] * normal
    x1 = x1.reshape(-1, 3)
    corners = np.flatnonzero(np.arange(len(x0)) % 4)
    held = (3 * corners[:, None] + np.arange(3)).ravel()
    assert have_passed(pairs, x0, x1).all()
    end = parted(pairs, x0, x1, np.ones(len(x0)), held)
    assert not have_passed(pairs, x0, end).any()
    assert (end[corners] == x1[corners]).all()


def thrown(comm):
    """A film that is thrown at another one: the prediction of a step passes through it."""
    falling = film(comm, n=4, height=0.002, velocity=(0.0, 0.0, -2.0), turn=0.2, name="falling")
    lying = film(comm, n=4, name="lying")
    scene = gx.Scene(falling, lying, gx.Contact(falling, lying, distance=1e-3))
    return gx.Simulation(scene, gx.Midpoint(dt=2e-3))


@pytest.mark.mpi
def test_the_solution_of_a_step_does_not_depend_on_the_parting(comm, monkeypatch):
    """Only iterates are moved: the balances close, and the state is that of an iteration without it."""
    run = thrown(comm)
    parts = []
    original = Separation.of

    def watched(self, *given):
        found = original(self, *given)
        parts.append(found)
        return found

    monkeypatch.setattr(Separation, "of", watched)
    run.run(until=4e-3)
    assert any(parts)
    assert abs(run.energy_error) < 1e-12 * run.totals.energy
    monkeypatch.setattr(separation, "MAX_SWEEPS", 0)
    other = thrown(comm)
    other.run(until=4e-3)
    if run.step == other.step:
        difference = run.system.q0.copy()
        difference.axpy(-1.0, other.system.q0)
        assert difference.norm() < 1e-6 * other.system.q0.norm()
    assert run.totals.momentum == pytest.approx(other.totals.momentum, abs=1e-14)
