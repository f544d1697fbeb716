"""The preconditioner that eliminates hubs and multipliers: it solves, and knows when to factorise
instead."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc

import gossamer_fx as gx
import gossamer_fx.solve.solvers.factorisation as factorisation
import gossamer_fx.solve.solvers.linear as linear
from demos.sails import ikaros
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.solve.solvers import eliminated_joints
from gossamer_fx.solve.solvers.eliminated_joints import (
    EliminatedJoints,
    can_be_eliminated,
    max_applications,
    other_unknowns,
)
from tests.small_scenes import begin_iteration

LAW = gx.Miyazaki(1e8, 0.3, density=1400.0, thickness=1e-5, residual_stiffness=1e-3)


def hung_film(comm, cells=6, *more):
    """A film that is thrown off a free hub on four ropes; `more` makes parts from the hub."""
    film = gx.Membrane(
        sheet(comm, cells, cells),
        LAW,
        name="film",
        velocity=lambda X: np.vstack([0 * X[0], 0 * X[0], X[0] * (1 - X[0])]),
    )
    hub = gx.RigidBody(1.0, (1.0, 1.0, 1.0), comm=comm, name="hub")
    items: list[object] = [film, hub, gx.Damping(film, stiffness_factor=1e-4)]
    for k, corner in enumerate([(0.0, 0, 0), (1.0, 0, 0), (0.0, 1, 0), (1.0, 1, 0)]):
        anchor = np.subtract(corner, (0.0, 0.1, 0.0))
        items.append(
            gx.connectors.Rope(
                hub.port(tuple(anchor)),
                film.port_at(corner),
                length=0.1,
                stiffness=1e2,
                name=f"rope {k}",
            )
        )
    items += [make(hub) for make in more]
    return gx.Simulation(gx.Scene(*items), gx.Midpoint(dt=1e-3))


def run_iteratively(comm, monkeypatch, **limits):
    """The run with the preconditioner, whatever its size."""
    monkeypatch.setattr(linear, "MAX_UNKNOWNS_DIRECT", 0)
    for name, value in limits.items():
        monkeypatch.setattr(eliminated_joints, name, value)
    run = hung_film(comm)
    monkeypatch.undo()
    return run


def test_steps_are_those_of_a_factorisation(monkeypatch):
    """Energy and momenta are kept, and the state is the same to the tolerance of Newton's
    iteration."""
    comm = MPI.COMM_SELF
    run = run_iteratively(comm, monkeypatch)
    solver = run.solver.newton
    assert solver.ksp.getType() == "fgmres"
    assert isinstance(solver._preconditioner.getPythonContext(), EliminatedJoints)
    other = hung_film(comm)
    assert other.solver.newton.ksp.getType() == "preonly"
    start = run.totals.momentum.copy()
    for simulation in (run, other):
        simulation.run(until=5e-3)
    assert abs(run.energy_error) < 1e-9 * run.totals.energy
    assert run.totals.momentum == pytest.approx(start, abs=1e-9)
    difference = run.system.unknowns.q0.array_r - other.system.unknowns.q0.array_r
    assert np.linalg.norm(difference) < 1e-7 * np.linalg.norm(other.system.unknowns.q0.array_r)
    assert solver.linear_iterations < 8 * solver.all_iterations


def test_factors_are_kept_within_a_step_and_the_steps_stay_the_same(monkeypatch):
    """Kept factors save set-ups, and change results by the tolerance of the linear solver only."""
    runs = []
    set_ups = []
    for most in (0, eliminated_joints.MAX_APPLICATIONS_TO_KEEP):
        run = run_iteratively(MPI.COMM_SELF, monkeypatch, MAX_APPLICATIONS_TO_KEEP=most)
        monkeypatch.setattr(eliminated_joints, "MAX_APPLICATIONS_TO_KEEP", most)
        count = [0]
        original = EliminatedJoints._set_up_incomplete

        def counted(preconditioner, *given, count=count, original=original):
            count[0] += 1
            original(preconditioner, *given)

        monkeypatch.setattr(EliminatedJoints, "_set_up_incomplete", counted)
        run.run(until=5e-3)
        monkeypatch.undo()
        runs.append(run)
        set_ups.append(count[0])
    every, kept = runs
    assert set_ups[0] == every.solver.newton.all_iterations
    # A step begins with new factors.
    assert kept.step <= set_ups[1] <= 0.8 * set_ups[0]
    difference = every.system.unknowns.q0.array_r - kept.system.unknowns.q0.array_r
    assert np.linalg.norm(difference) < 1e-7 * np.linalg.norm(every.system.unknowns.q0.array_r)
    assert kept.totals.energy == pytest.approx(every.totals.energy, rel=1e-9)


@pytest.mark.mpi
def test_factors_that_no_longer_serve_are_replaced_within_a_solve(comm, monkeypatch):
    """Kept factors of which nothing is left: each solve still converges, with new ones."""
    monkeypatch.setattr(linear, "MAX_UNKNOWNS_DIRECT_WITH_CONTACT", 0)
    keep_factors = EliminatedJoints.keep_factors
    spoilt = []
    iterations = []  # of all solves but the last

    def spoil(preconditioner):
        iterations.append(newton.ksp.getIterationNumber())
        if not keep_factors(preconditioner):
            return False
        identity = PETSc.PC().create(comm)
        identity.setType("none")
        identity.setOperators(preconditioner._incomplete.getOperators()[0])
        preconditioner._incomplete = identity
        spoilt.append(identity)
        return True

    monkeypatch.setattr(EliminatedJoints, "keep_factors", spoil)
    run = ikaros.build(comm, pitch=0.64, until=0.05).simulation([])
    newton = run.solver.newton
    run.run(until=4e-3)
    assert spoilt
    # Eight iterations with the old factors, and some with the new ones.
    assert max(iterations) <= 16


@pytest.mark.mpi
def test_kept_factors_are_not_made_again_where_nothing_touches(comm, monkeypatch):
    """Without pairs the matrix is that of the films itself, of which PETSc sees that it changed."""
    monkeypatch.setattr(linear, "MAX_UNKNOWNS_DIRECT_WITH_CONTACT", 0)
    kept = []
    set_ups = []
    keep_factors = EliminatedJoints.keep_factors
    set_up = EliminatedJoints._set_up_incomplete

    def keep(preconditioner):
        is_kept = keep_factors(preconditioner)
        kept.append(is_kept)
        return is_kept

    def counted(preconditioner, *given):
        set_ups.append(preconditioner)
        set_up(preconditioner, *given)

    monkeypatch.setattr(EliminatedJoints, "keep_factors", keep)
    monkeypatch.setattr(EliminatedJoints, "_set_up_incomplete", counted)
    run = ikaros.build(comm, pitch=0.64, until=0.05).simulation([])
    run.run(until=4e-3)
    assert any(kept)
    assert len(set_ups) == run.solver.newton.all_iterations - sum(kept)


@pytest.mark.mpi
def test_one_application_solves_where_the_films_are_factorised_completely(comm, monkeypatch):
    """With enough levels of fill and an overlap of the whole film F̃ is F, and the elimination
    exact, multipliers included."""
    run = run_iteratively(comm, monkeypatch)
    system = run.system
    begin_iteration(run, 1e-3)
    A = system.matrices.tangent()
    monkeypatch.setattr(eliminated_joints, "ILU_LEVELS", 1000)
    monkeypatch.setattr(factorisation, "OVERLAP", 100)
    unknowns = other_unknowns(system)
    assert comm.allreduce(len(unknowns)) == 12 + 6
    exact = EliminatedJoints(system, unknowns, max_iterations=60)
    pc = PETSc.PC().create(comm)
    pc.setOperators(A)
    exact.setUp(pc)
    r, z = A.createVecs()
    r.setRandom()
    exact.apply(pc, r, z)
    left = A * z - r
    assert left.norm() < 1e-9 * r.norm()


@pytest.mark.mpi
def test_matrices_are_factorised_after_a_solve_that_took_too_long(comm, monkeypatch):
    """A limit of no application at all lets each solve be too long."""
    run = run_iteratively(comm, monkeypatch)
    context = run.solver.newton._preconditioner.getPythonContext()
    monkeypatch.setattr(context, "max_applications", 0)
    monkeypatch.setattr(eliminated_joints, "MAX_APPLICATIONS_TO_KEEP", 0)
    run.run(until=2e-3)
    assert context._is_complete
    assert abs(run.energy_error) < 1e-11 * run.totals.energy
    monkeypatch.undo()
    run.run(until=2e-3 + 11e-3)
    assert not context._is_complete


def test_iterations_are_preferred_to_factorisations_the_longer_the_larger_the_film():
    """A factorisation of four times as many unknowns costs eight times as much, an iteration four
    times as much; a solve ends at 60 iterations."""
    assert max_applications(3_000, 60) == 30
    assert max_applications(30_000 * 2, 60) == pytest.approx(30 * math.sqrt(2))
    assert max_applications(200_000, 60) == 59
    assert max_applications(10**6, 60) == math.inf


@pytest.mark.mpi
def test_a_singular_elimination_is_followed_by_factorisations(comm, monkeypatch, recwarn):
    """A Schur complement of zeros ends the iteration without a warning of SciPy, and the step is
    made with complete factors."""
    run = run_iteratively(comm, monkeypatch)
    context = run.solver.newton._preconditioner.getPythonContext()
    take_rows = EliminatedJoints._take_rows

    def take_zeros(self, matrix):
        take_rows(self, matrix)
        self._C[:] = 0.0
        self._D.data[:] = 0.0

    monkeypatch.setattr(EliminatedJoints, "_take_rows", take_zeros)
    run.run(until=2e-3)
    assert context._is_complete
    # dolfinx 0.11 warns about its old names.
    assert not [one for one in recwarn if one.category is not DeprecationWarning]
    assert abs(run.energy_error) < 1e-11 * run.totals.energy


def film_between_panels(comm, cells, ropes=1, panels=8, has_contact=False):
    """A film on ropes between two chains of hinged panels, which it bends; `ropes` of them at each
    end of both chains."""
    film = gx.Membrane(
        sheet(comm, cells, cells),
        LAW,
        name="film",
        velocity=lambda X: np.vstack([0 * X[0], 0.1 * (0.5 - X[1]), X[0] * (1 - X[0])]),
    )
    items: list[object] = [film, gx.Damping(film, stiffness_factor=1e-4)]
    if has_contact:
        items.append(gx.Contact(film, distance=1e-3))
    half = 0.5 / panels
    for side, y in enumerate((-0.1, 1.1)):
        bodies = [
            gx.RigidBody(
                0.1,
                (1e-3, 1e-3, 1e-3),
                comm=comm,
                name=f"panel {side} {k}",
                position=((2 * k + 1) * half, y, 0.0),
            )
            for k in range(panels)
        ]
        items += bodies
        for k, (one, next_one) in enumerate(itertools.pairwise(bodies)):
            items.append(
                gx.constraints.RevoluteJoint(
                    one.frame((half, 0.0, 0.0)),
                    next_one.frame((-half, 0.0, 0.0)),
                    axis=(0.0, 1.0, 0.0),
                    name=f"hinge {side} {k}",
                )
            )
        for k in [*range(ropes), *range(panels - ropes, panels)]:
            place = ((2 * k + 1) * half, float(side), 0.0)
            items.append(
                gx.connectors.Rope(
                    bodies[k].port((0.0, 0.0, 1e-2 * k)),
                    film.port_at(place),
                    length=0.1,
                    stiffness=1e2,
                    name=f"rope {side} {k}",
                )
            )
    return gx.Simulation(gx.Scene(*items), gx.Midpoint(dt=1e-3))


@pytest.mark.mpi
def test_hinged_panels_are_eliminated_as_few_of_them_hold_the_film(comm):
    """358 unknowns of panels and hinges, of which four panels with 12 each are coupled with the
    film: the steps are those of a factorisation, energy and momentum are kept, and columns that are
    zero are not solved for."""
    run = film_between_panels(comm, cells=32)
    context = run.solver.newton._preconditioner.getPythonContext()
    assert isinstance(context, EliminatedJoints)
    # Two of them fill blocks of three.
    assert comm.allreduce(len(other_unknowns(run.system))) == 2 * (8 * 18 + 7 * 5) + 2
    start = run.totals.momentum.copy()
    run.run(until=3e-3)
    assert len(context._bound) == 4 * 12
    # Two panels are held at their centres, and two at a point on an axis.
    is_solved = comm.allreduce(np.abs(context._Z).sum(axis=1)) > 0
    assert is_solved.sum() == 2 * 3 + 2 * 6
    assert abs(run.energy_error) < 1e-9 * run.totals.energy
    assert run.totals.momentum == pytest.approx(start, abs=1e-9)
    monkeypatch = pytest.MonkeyPatch()
    monkeypatch.setattr(eliminated_joints, "MAX_ELIMINATED", 0)
    monkeypatch.setattr(eliminated_joints, "MAX_SHARE", 0.0)
    other = film_between_panels(comm, cells=32)
    monkeypatch.undo()
    assert other.solver.newton.ksp.getType() == "preonly"
    other.run(until=3e-3)
    # Nodes of the two meshes may be divided among the ranks in different ways.
    assert run.totals.kinetic == pytest.approx(other.totals.kinetic, rel=1e-8)
    for name, energy in other.totals.stored.items():
        assert run.totals.stored[name] == pytest.approx(energy, rel=1e-6, abs=1e-10)
    assert run.system.unknowns.q0.norm() == pytest.approx(other.system.unknowns.q0.norm(), rel=1e-9)


@pytest.mark.mpi
def test_bodies_that_are_mostly_held_to_the_film_are_factorised(comm):
    """More than 60 unknowns that are coupled with the film, or may come in contact with it, or more
    than an eighth of all: the preconditioner does not serve, on any rank."""
    of_many_ropes = film_between_panels(comm, cells=32, ropes=3).system
    assert not can_be_eliminated(of_many_ropes, other_unknowns(of_many_ropes))
    of_contact = film_between_panels(comm, cells=32, has_contact=True).system
    assert not can_be_eliminated(of_contact, other_unknowns(of_contact))
    of_small_film = film_between_panels(comm, cells=10).system
    assert not can_be_eliminated(of_small_film, other_unknowns(of_small_film))


@pytest.mark.mpi
def test_ranks_share_the_elimination(comm, monkeypatch):
    """All ranks together eliminate hub and multipliers, and the steps are those of one rank."""
    run = run_iteratively(comm, monkeypatch)
    context = run.solver.newton._preconditioner.getPythonContext()
    assert isinstance(context, EliminatedJoints)
    assert comm.allreduce(len(other_unknowns(run.system))) == 12 + 6
    other = hung_film(MPI.COMM_SELF)
    for simulation in (run, other):
        simulation.run(until=5e-3)
    assert not context._is_complete
    assert run.totals.energy == pytest.approx(other.totals.energy, rel=1e-9)
    assert run.solver.newton.linear_iterations < 12 * run.solver.newton.all_iterations


@pytest.mark.mpi
def test_ranks_with_contact_take_the_steps_of_one_rank(comm, monkeypatch):
    """Couplings of contact between hub, film and ranks are part of the eliminated matrix."""
    monkeypatch.setattr(linear, "MAX_UNKNOWNS_DIRECT_WITH_CONTACT", 0)
    runs = []
    for ranks in (comm, MPI.COMM_SELF):
        run = ikaros.build(ranks, pitch=0.64, until=0.05).simulation([])
        context = run.solver.newton._preconditioner.getPythonContext()
        assert isinstance(context, EliminatedJoints)
        run.run(until=4e-3)
        assert not context._is_complete
        runs.append(run)
    assert runs[0].totals.energy == pytest.approx(runs[1].totals.energy, rel=1e-9)
