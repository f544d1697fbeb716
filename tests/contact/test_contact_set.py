"""Newton's iteration with contact: the limit of updates, and the tangents that are used."""

from __future__ import annotations

from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.mechanics.contact.contact_set import MAX_UPDATE
from gossamer_fx.solve.solvers.newton import COMPLETE_TANGENT_RATIO
from tests.contact.scenes import contact_set_of, count_intersections, film, simulate, two_films


@pytest.mark.mpi
def test_updates_go_no_farther_than_contact_can_follow(comm):
    lower = film(comm, name="lower")
    upper = film(comm, height=2e-3, name="upper", order=2)
    alone = film(comm, height=0.5, name="alone")
    run = gx.Simulation(
        gx.Scene(gx.Contact(lower, upper, distance=1e-3), alone), gx.Midpoint(dt=1e-4)
    )
    system = run.system
    # Updates larger than contact can follow, on average five activation distances.
    update = np.random.default_rng(comm.rank).normal(
        0.0, 5e-3, system.unknowns.numbering.vector().getLocalSize()
    )
    given = update.copy()
    system.equations.limit_update(update)
    for k, body in enumerate(system.unknowns.bodies):
        owned = system.unknowns.numbering.owned(k)
        before = given[owned].reshape(-1, 3)
        after = update[owned].reshape(-1, 3)
        ways = np.linalg.norm(before, axis=1)
        longest = np.inf if body is alone else MAX_UPDATE * contact_set_of(run).activation_distance
        expected = before * np.minimum(1.0, longest / ways)[:, None] if len(ways) else before
        assert np.allclose(after, expected, rtol=1e-14)


def test_a_scene_without_contact_limits_nothing(comm):
    run = gx.Simulation(gx.Scene(film(comm)), gx.Midpoint(dt=1e-4))
    assert not run.system.equations.active_sets


def test_tangents_have_their_geometric_stiffness_near_the_solution():
    lower = film(MPI.COMM_SELF, name="lower")
    upper = film(MPI.COMM_SELF, height=1.2e-3, velocity=(0.2, 0.1, -2.0), turn=0.4, name="upper")
    run = gx.Simulation(gx.Scene(gx.Contact(lower, upper, distance=1e-3)), gx.Midpoint(dt=1e-4))
    # As after a failure: the delay of 20 tangents is more than a step needs.
    run.solver.set_history({"care": 20})
    newton = run.solver.newton
    shares = []
    tangent = run.system.matrices.tangent

    def seen():
        shares.append(
            (run.system.unknowns.geometric, newton._r.norm() / newton.convergence.reference)
        )
        return tangent()

    newton._tangent = run.system.matrices.tangent = seen  # new matrices take the second
    run.run(until=4e-4)
    assert {share for share, _ in shares} == {0.0, 1.0}
    assert all((share == 0.0) == (residual > COMPLETE_TANGENT_RATIO) for share, residual in shares)
    # The step must have been solved within the delays.
    assert run.last_iterations < 20


def test_a_predictor_that_passed_through_is_no_measure_of_the_residual():
    comm = MPI.COMM_SELF
    lower = film(comm, name="lower")
    # 100 m/s × 1e-4 s is 10 mm, three times the gap: the predictor passes through.
    upper = film(comm, height=3e-3, velocity=(0.2, 0.1, -100.0), turn=0.4, name="upper")
    run = gx.Simulation(gx.Scene(gx.Contact(lower, upper, distance=1e-3)), gx.Midpoint(dt=1e-4))
    newton = run.solver.newton
    first = []
    solved = newton._is_solved

    def seen():
        test = newton.convergence
        if len(test.norms) == 1:  # the first residual of an iteration
            first.append((test.norm, test.reference))
        return solved()

    newton._is_solved = seen
    run.run(until=1e-3)
    # The first residual is far above the reference, and must not become the reference.
    assert max(forces / reference for forces, reference in first) > 100
    system = run.system
    momentum = system.unknowns.numbering.vector()
    system.unknowns.M.mult(system.unknowns.v0, momentum)
    assert (
        newton.convergence.reference < 2.1 / 1e-4 * momentum.norm()
    )  # 2 M v/h; the speeds hardly change in a step
    assert abs(run.energy_error) < 1e-11
    assert count_intersections(run) == 0


@pytest.mark.mpi(1)
# 0.16 of the distance separates the two gaps.
@pytest.mark.parametrize("gap, words", [(0.13, "would pass through"), (0.25, "")])
def test_edges_nearer_than_their_barrier_lets_them_are_refused(comm, gap, words):
    """In the middle of edges a barrier is infinite at 0.16 of the distance at which contact
    begins."""
    d = 1e-3
    films = [film(comm, n=2, name="lower"), film(comm, n=2, height=1.2 * d, turn=0.4, name="upper")]
    run = simulate([*films, gx.Contact(*films, distance=d)], 1e-6, dt=1e-6)
    system = run.system
    system.equations.begin_step(1e-6)
    system.unknowns.q0.copy(system.unknowns.q1)
    with system.unknowns.q1 as values:
        values[system.unknowns.numbering.owned(1)].reshape(-1, 3)[:, 2] -= (1.2 - gap) * d
    system.equations.extend_active_set()
    problem = system.equations.inadmissible()
    assert words in problem and bool(words) == bool(problem)


def test_results_of_a_step_are_not_those_of_its_next_iterate() -> None:
    run = simulate([gx.Contact(*two_films(MPI.COMM_SELF, height=1.2e-3), distance=1e-3)], 3e-4)
    run.system.equations.begin_step(1e-4)
    step = contact_set_of(run).step
    ends = [step.x0 + s * np.random.default_rng(1).normal(size=step.x0.shape) for s in (0, 1e-5)]
    first, second = (step.forces(x1) for x1 in ends)
    tangents = [step.tangent(forces, 1.0, None).blocks for forces in (first, second)]
    assert np.abs(first.on_points).max() > 0
    assert not np.array_equal(first.on_points, second.on_points)
    assert not np.array_equal(*tangents)
    # In the other order the same results come out.
    again = [step.forces(x1) for x1 in reversed(ends)]
    for forces, other in zip((second, first), again, strict=True):
        assert np.array_equal(forces.on_points, other.on_points)
        assert np.array_equal(
            step.tangent(forces, 1.0, None).blocks, step.tangent(other, 1.0, None).blocks
        )
    with pytest.raises(FrozenInstanceError):
        step.end_time = 0.0
