"""The test of convergence, on given sequences of residuals [N]."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NoReturn

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.solve.solvers.convergence import ConvergenceTest, Residual
from tests.small_scenes import LINEAR, run_until

# The round-off floor of one unit in the last place of 1 N is 2.2e-16 N.
TOLERANCES = gx.Tolerances(relative=1e-6, absolute=0.0, floor=1.0, scalars=1e-9, constraint=1e-10)
ULP = float(np.finfo(float).eps)


def never(*args: float) -> NoReturn:
    """What is not to be asked, as it needs all ranks."""
    raise AssertionError("all ranks were asked")


def no(factor: float) -> bool:
    return False


def yes(factor: float) -> bool:
    return True


def solves(
    test: ConvergenceTest,
    residual: Residual,
    energy: Callable[[float], bool],
    bodies: Callable[[], np.ndarray] = never,
) -> bool:
    """Whether the residual solves a step, by the test's energy and imbalances of the bodies."""
    return test.is_solved(residual, energy, bodies)


def after(
    norms: list[float], has_contact: bool = False, scale: float = 0.0, bodies: Sequence[float] = ()
) -> ConvergenceTest:
    """The test after an iteration, in which forces of a scale [N] cancel, and of scales of the
    bodies [N]."""
    test = ConvergenceTest(TOLERANCES, has_contact)
    for k, norm in enumerate(norms):
        test.record(norm, is_first=k == 0)
    if scale:
        test.lower_floor(scale, np.array(bodies))
    return test


def test_a_falling_residual_also_needs_a_small_work() -> None:
    test = after([10.0, 1.0, 0.99e-5])
    assert test.tolerance == pytest.approx(1e-5)
    assert solves(test, Residual(0.99e-5), yes)
    assert not solves(test, Residual(0.99e-5), no)
    # Above the tolerance the energy does not matter.
    assert not solves(test, Residual(1.01e-5), never)


def test_a_residual_that_no_longer_falls_needs_none() -> None:
    test = after([10.0, 0.9e-5, 0.8e-5])
    assert solves(test, Residual(0.8e-5), never)


@pytest.mark.parametrize("ratio, is_solved", [(0.51, True), (0.49, False)])
def test_round_off_counts_once_the_residual_stays(ratio: float, is_solved: bool) -> None:
    floor = 1e-3
    last = 3.9 * floor
    test = after([1.0, last / ratio, last], scale=floor / ULP)
    assert test.round_off_floor == pytest.approx(floor)
    assert test.round_off == pytest.approx(4 * floor)
    assert solves(test, Residual(last), never) == is_solved
    # Four times the floor is the limit.
    assert not solves(test, Residual(4.1 * floor), never)


def test_at_the_round_off_floor_a_falling_residual_needs_a_small_work_too() -> None:
    test = after([1.0, 0.1, 0.9e-3], scale=1e-3 / ULP)
    assert solves(test, Residual(0.9e-3), yes)
    assert not solves(test, Residual(0.9e-3), no)
    # It no longer falls.
    assert solves(after([1.0, 1e-3, 0.9e-3], scale=1e-3 / ULP), Residual(0.9e-3), never)


def test_the_smallest_floor_counts() -> None:
    test = after([1.0], scale=1e6)
    test.lower_floor(1e3, np.empty(0))
    test.lower_floor(1e9, np.empty(0))
    assert test.round_off_floor == pytest.approx(1e3 * ULP)


def test_round_off_of_a_stiff_body_does_not_hide_another_body() -> None:
    """A boom with 1e3 times the forces of a film: forces in the film of the round-off of the boom
    are not the round-off of the film."""
    floor = 1e-3
    residual = Residual(3 * floor)

    def answer(film: float, energy: Callable[[float], bool] = no, before: int = 1) -> bool:
        norms = [1.0] * before + [3 * floor, 3 * floor]
        test = after(norms, scale=floor / ULP, bodies=[floor / ULP, 1e-3 * floor / ULP])
        return solves(test, residual, energy, lambda: np.array([3 * floor, film]))

    assert not answer(film=2 * floor)
    assert not answer(film=4.1e-3 * floor)
    assert answer(film=3.9e-3 * floor)
    # Either the work of the residual is small, up to a factor of a hundred ...
    assert answer(film=2 * floor, energy=lambda factor: factor >= 100)
    # ... or three quarters of the iterations are over.
    assert not answer(film=2 * floor, before=28)
    assert answer(film=2 * floor, before=29)


def test_a_body_without_forces_is_asked_for_a_share_of_the_residual() -> None:
    floor = 1e-3
    test = after([1.0, floor, floor], scale=floor / ULP, bodies=[floor / ULP, 0.0])
    assert solves(test, Residual(floor), no, lambda: np.array([floor, 3.9e-4 * floor]))
    assert not solves(test, Residual(floor), no, lambda: np.array([floor, 4.1e-4 * floor]))


def test_contact_has_more_round_off_if_the_energy_closes() -> None:
    floor = 1e-3
    norms = [1.0, 21 * floor, 20 * floor]
    residual = Residual(20 * floor)
    assert solves(after(norms, has_contact=True, scale=floor / ULP), residual, yes)
    assert not solves(after(norms, has_contact=True, scale=floor / ULP), residual, no)
    assert not solves(after(norms, has_contact=False, scale=floor / ULP), residual, never)
    beyond = Residual(33 * floor)
    assert not solves(after(norms, has_contact=True, scale=floor / ULP), beyond, never)


def test_constraints_and_scalar_unknowns_have_their_own_tolerances() -> None:
    test = after([10.0, 0.0])
    assert solves(test, Residual(0.0, violation=0.9e-10, scalars=0.9e-9), yes)
    assert not solves(test, Residual(0.0, violation=1.1e-10), yes)
    assert not solves(test, Residual(0.0, scalars=1.1e-9), yes)
    assert not solves(test, Residual(0.0, scalars=math.nan), yes)


def test_forces_of_an_obstacle_that_was_passed_are_no_scale() -> None:
    # The predictor is behind an obstacle, whose force is a thousand times that of the motion.
    test = after([1e6], has_contact=True)
    test.limit_reference(stopping=1e3, external=lambda: 10.0)
    assert test.reference == 1e3
    # What rests has no motion; then the loads are the scale.
    test = after([1e6], has_contact=True)
    test.limit_reference(stopping=0.0, external=lambda: 10.0)
    assert test.reference == 10.0
    # Without loads, too, the residual itself is.
    test = after([1e6], has_contact=True)
    test.limit_reference(stopping=0.0, external=lambda: 0.0)
    assert test.reference == 1e6
    # A residual below the force of the motion is its own scale, and loads are not asked.
    test = after([1.0], has_contact=True)
    test.limit_reference(stopping=1e3, external=never)
    assert test.reference == 1.0


def test_film_in_flight_counts_as_free_of_forces() -> None:
    test = after([1e-20], has_contact=True)
    test.limit_reference(stopping=1e3, external=never)
    assert test.tolerance == pytest.approx(1e-9)


def test_a_second_iteration_of_a_step_has_its_own_reference() -> None:
    """It follows where contact pairs were missing."""
    test = after([10.0, 1e-3])
    test.record(5.0, is_first=True)
    assert test.reference == 5.0 and test.norms == [5.0]


@pytest.mark.parametrize(
    "norms, diverges",
    [
        ([1.0, 1e3, 1e14], False),
        ([1.0, 1e3, 1e16], True),
        # A first residual of round-off does not count alone.
        ([1e-15, 1.0, 1e3], False),
    ],
)
def test_growth_beyond_measure_is_divergence(norms: list[float], diverges: bool) -> None:
    assert after(norms).diverges() == diverges


@pytest.mark.mpi
def test_the_mass_of_a_held_point_has_no_round_off(comm: MPI.Comm) -> None:
    """Its inertia is a reaction of the support."""
    film = gx.Membrane(sheet(comm, 4, 4), LINEAR, velocity=lambda X: 0.1 * X)
    held = gx.Fixed(film, "left")
    ballast = gx.connectors.AttachedMass(film.port("top left"), 1e9)
    floors = []
    for items in ((film, held), (film, held, ballast)):
        run = run_until(1e-4, *items, dt=1e-4)
        floors.append(run.solver.newton.convergence.round_off_floor)
    assert floors[1] == pytest.approx(floors[0], rel=1e-9)
