"""Which Newton iterations are given up before their last iterate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.core.checks.errors import Inadmissible, NotConverged
from gossamer_fx.mechanics.terms.discrete_gradient import AtRest
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.solve.solvers.convergence import ConvergenceTest, StallRule
from gossamer_fx.solve.solvers.newton import Newton
from gossamer_fx.solve.steppers.midpoint import DELAYED_STEPS, GEOMETRIC_STIFFNESS_DELAY

# Residuals [N] that come down and then alternate, as those of film that switches its state.
STALLED = [40.0, 1.0, 0.1, *[0.2, 0.09, 0.3, 0.15] * 2]

# Iterations that are allowed: two fifths of them are as many as alternate.
RULE = StallRule(max_iterations=20)

SHARES = [1.0] * (len(STALLED) - 1)

# A norm [N] that passes the test of the forces.
SMALL = 1e-9


def has_stalled(norms: Sequence[float], kept_shares: Sequence[float], small: float = SMALL) -> bool:
    """Whether the rule gives up an iteration with these norms [N], of which `small` passes."""
    test = ConvergenceTest(gx.Tolerances(relative=0.0, absolute=small), has_contact=True)
    for number, norm in enumerate(norms):
        test.record(norm, is_first=number == 0)
    return RULE.has_stalled(test, kept_shares)


def test_residuals_that_no_longer_fall_are_given_up() -> None:
    assert has_stalled(STALLED, SHARES)
    # Contact shortens all updates much: the iteration is on its way.
    assert not has_stalled(STALLED, [0.3] * len(SHARES))
    # The residual falls again.
    falling = [*STALLED[:-4], 60.0, 40.0, 25.0, 15.0]
    assert not has_stalled(falling, SHARES)
    # One residual below 0.7 of the least one before, and the iteration goes on.
    for ratio, is_given_up in ((0.69, False), (0.71, True)):
        norms = [*STALLED[:-4], 0.09, 0.3, 0.2, ratio * 0.1]
        assert has_stalled(norms, SHARES) == is_given_up


def test_a_first_residual_of_round_off_does_not_count() -> None:
    """The predictor may be nearly exact: then the first residual is the least of all."""
    # The last four are equal: they do not fall again.
    falling = 10.0 ** -np.minimum(np.arange(10), 6)
    norms = [1e-12, *falling]
    assert not has_stalled(norms, [1.0] * 10)


def test_residuals_within_the_tolerance_wait_for_the_other_tests() -> None:
    norms = [1.0, *[0.5 * SMALL] * 20]
    assert not has_stalled(norms, [1.0] * 20)
    # The same residuals above it have stalled.
    assert has_stalled(norms, [1.0] * 20, 0.4 * SMALL)


def film_above_a_floor(comm, friction: float) -> gx.Scene:
    film = gx.Membrane(
        sheet(comm, 2, 2), gx.Linear(1e6, 0.3, density=1e3, thickness=1e-4), name="film"
    )
    floor = gx.contact.Plane(point=(0, 0, -0.01), normal=(0, 0, 1))
    return gx.Scene(film, gx.Contact(film, floor, distance=1e-3, friction=friction))


@pytest.mark.mpi
@pytest.mark.parametrize("friction, is_given_up", [(0.0, True), (0.3, False)])
def test_friction_may_stay_at_one_residual(comm, friction: float, is_given_up: bool) -> None:
    stepper = gx.Midpoint(dt=1e-3, tolerances=gx.Tolerances(max_iterations=20))
    run = gx.Simulation(film_above_a_floor(comm, friction), stepper)
    newton: Newton = run.solver.newton
    assert newton.stall_rule == (RULE if is_given_up else None)


def test_an_equilibrium_has_no_step_that_could_be_divided(comm) -> None:
    system = film_above_a_floor(comm, friction=0.0).compile(AtRest())
    assert Newton(system, gx.Tolerances()).stall_rule is None


def test_a_step_that_fails_and_those_after_it_begin_without_geometric_stiffness(
    comm, monkeypatch
) -> None:
    """One repetition, then the step is given up; the next ones do not begin as it did."""
    solver = gx.Simulation(film_above_a_floor(comm, 0.0), gx.Midpoint(dt=1e-4)).solver
    outcomes: list[type[Exception] | None] = []
    delays = []

    def attempt(h: float, is_delayed: bool) -> None:
        delays.append(late * is_delayed)
        failure = outcomes.pop(0)
        if failure:
            raise failure

    monkeypatch.setattr(solver, "_attempt", attempt)
    late = GEOMETRIC_STIFFNESS_DELAY
    outcomes += [None, NotConverged, NotConverged, Inadmissible, NotConverged, NotConverged]
    solver.step(1e-4)
    for failure in (NotConverged, Inadmissible, NotConverged):
        with pytest.raises(failure):
            solver.step(1e-4)
    assert delays == [0, 0, late, late, late, 0]
    # So does a run that continues from a checkpoint.
    solver.set_history(solver.get_history())
    delays.clear()
    outcomes += [None] * (DELAYED_STEPS + 1)
    for _ in range(DELAYED_STEPS + 1):
        solver.step(1e-4)
    assert delays == [late] * DELAYED_STEPS + [0]
