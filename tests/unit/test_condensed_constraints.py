"""Ties condensed in the linear solver: exact, and the steps are those of a factorisation."""

from __future__ import annotations

import gc
import itertools
import weakref

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc

import gossamer_fx as gx
import gossamer_fx.solve.solvers.factorisation as factorisation
import gossamer_fx.solve.solvers.linear as linear
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.meshes.tube_section import capped_cylinder
from gossamer_fx.solve.solvers import condensed_constraints, eliminated_joints, two_level
from gossamer_fx.solve.solvers.condensed_constraints import CondensedConstraints
from tests.contact.scenes import leaf
from tests.small_scenes import AIR, begin_iteration

LAW = gx.Miyazaki(1e8, 0.3, density=1400.0, thickness=1e-5, residual_stiffness=1e-3)


def thrown(x0):
    """A velocity [m/s] that is one function of the position of films that begin at x = x0."""
    return lambda X: np.vstack([0 * X[0], 0 * X[0], np.sin(3 * (X[0] + x0)) * X[1]])


def moved(x0):
    return lambda X: np.vstack([np.full(X.shape[1], x0), 0 * X[0], 0 * X[0]])


def films(comm, *names):
    """Films side by side, each of another mesh, and the finer line tied to the coarser one."""
    found = []
    for k, name in enumerate(names):
        film = gx.Membrane(
            sheet(comm, 4, 4 + 2 * k),
            LAW,
            name=name,
            displacement=moved(k),
            velocity=thrown(k),
        )
        found.append(film)
    ties = [
        gx.Tie(finer, coarser, group_a="left", group_b="right")
        for coarser, finer in itertools.pairwise(found)
    ]
    return found, ties


def chain(comm):
    """Two films and a cable on the line between them: its nodes follow nodes that follow others.
    The line ends at a fixed point, and one of its nodes is held in one direction."""
    (left, right), ties = films(comm, "left", "right")
    cable = gx.Cable(
        line(comm, [(0, 0, 0), (0, 1, 0)], 9),
        gx.CableLaw(10.0, 0.01),
        name="cable",
        displacement=moved(1.0),
        velocity=thrown(1.0),
    )
    nail = gx.constraints.BallJoint(cable.port("start"), gx.Ground((1.0, 0.0, 0.0)), name="nail")
    return [
        left,
        right,
        cable,
        *ties,
        gx.Tie(cable, right, group_b="left"),
        gx.Fixed(left, "bottom left", components=(0, 2)),
        nail,
    ]


def plane(comm):
    """A film whose edge slides in a plane that is not one of the axes."""
    film = gx.Membrane(sheet(comm, 6, 6), LAW, name="film")
    normal = (0.6, 0.8, 0.0)
    return [
        film,
        gx.Fixed(film, "left", normal=normal),
        gx.RigidMotion(velocity=(0.8, -0.6, 0.3)),
        gx.Gravity(film, (0.0, 1.0, -1.0)),
    ]


def braced(comm):
    """A film that turns about a corner, tied to a beam along its edge and to a rigid body next to
    the opposite corner; the ground holds the corner of both film and beam."""
    film = gx.Membrane(sheet(comm, 7, 7), LAW, name="film")
    section = gx.sections.tube(0.01, 5e-4, E=1e9, nu=0.3, density=1500.0)
    beam = gx.Beam(line(comm, [(0, 0, 0), (0, 1, 0)], 3), section, name="beam")
    hub = gx.RigidBody(0.01, (1e-5, 2e-5, 2e-5), position=(1.1, 0.95, 0.1), comm=comm, name="hub")
    corner = film.port_at((1.0, 1.0, 0.0))
    items = [film, beam, hub]
    items.append(gx.constraints.BallJoint(corner, hub.port_at((1.0, 1.0, 0.0)), name="to hub"))
    for k in (0, 1, 3):
        point = (0.0, k / 3, 0.0)
        joint = gx.constraints.BallJoint(film.port_at(point), beam.port_at(point), name=f"tie {k}")
        items.append(joint)
    origin = film.port_at((0.0, 0.0, 0.0))
    items.append(gx.constraints.BallJoint(origin, gx.Ground((0.0, 0.0, 0.0)), name="nail"))
    return [*items, gx.RigidMotion(spin=(3.0, -5.0, 20.0)), gx.Gravity(film, (0.0, 0.0, -50.0))]


SCENES = (chain, plane, braced)


def book(comm):
    """Two films of different meshes, tied along the y axis, clap together."""
    lower = leaf(comm, law=LAW, name="lower")
    upper = leaf(comm, 6, angle=0.03, spin=-20.0, law=LAW, name="upper")
    tie = gx.Tie(upper, lower, group_a="left", group_b="left")
    return [lower, upper, tie, gx.Contact(lower, upper, distance=1e-3)]


def stiff_book(comm):
    """The same, and the lower film is tied to a beam along its free edge, where they touch."""
    lower, upper, tie, contact = book(comm)
    section = gx.sections.tube(2e-4, 5e-5, E=1e9, nu=0.3, density=1500.0)
    beam = gx.Beam(line(comm, [(0.1, 0, 0), (0.1, 0.1, 0)], 4), section, name="beam")
    joints = []
    for k in range(5):
        point = (0.1, k / 40, 0.0)
        joint = gx.constraints.BallJoint(lower.port_at(point), beam.port_at(point), name=f"tie {k}")
        joints.append(joint)
    return [lower, upper, beam, tie, *joints, contact]


def inflated_book(comm):
    """The same without the beam, and a bag of gas hangs on a seam below the lower film."""
    lower, upper, tie, contact = book(comm)
    radius = 0.02
    bag = gx.Membrane(
        capped_cylinder(comm, radius, 0.1, 8, 4),
        LAW,
        name="bag",
        displacement=lambda X: np.vstack([0 * X[0], 0 * X[0], 0 * X[0] - radius]),
    )
    seam = []
    for k in (1, 2, 3):
        on_bag = bag.port_at((k / 40, 0.0, radius))
        on_film = lower.port_at((k / 40, 0.0, 0.0))
        seam.append(gx.constraints.BallJoint(on_bag, on_film, name=f"stitch {k}"))
    gas = gx.Chamber(bag, gas=AIR, pressure=20.0, temperature=300.0)
    return [lower, upper, bag, tie, *seam, gas, contact]


def simulation(make, comm, monkeypatch=None, **options):
    """The run of a scene; with `monkeypatch` by Krylov iterations, whatever its size."""
    if monkeypatch is not None:
        monkeypatch.setattr(linear, "MAX_UNKNOWNS_DIRECT", 0)
        monkeypatch.setattr(linear, "MAX_UNKNOWNS_DIRECT_WITH_CONTACT", 0)
        monkeypatch.setattr(eliminated_joints, "MAX_ELIMINATED", 0)
        monkeypatch.setattr(condensed_constraints, "MIN_UNKNOWNS_WITH_FRAMES", 0)
    run = gx.Simulation(gx.Scene(*make(comm)), gx.Midpoint(dt=1e-3), **options)
    if monkeypatch is not None:
        monkeypatch.undo()
    return run


@pytest.mark.mpi(1)
@pytest.mark.parametrize("make", SCENES)
def test_one_application_solves_where_the_rest_is_factorised(make, comm, monkeypatch):
    """With enough levels of fill and an overlap of the whole film the inner preconditioner is
    exact, and the condensed solution is that of the whole system, multipliers included."""
    run = simulation(make, comm, monkeypatch)
    context = run.solver.newton._preconditioner.getPythonContext()
    assert isinstance(context, CondensedConstraints)
    monkeypatch.setattr(two_level, "ILU_LEVELS", 1000)
    monkeypatch.setattr(two_level, "ILU_LEVELS_DIFFICULT", 1000)
    monkeypatch.setattr(condensed_constraints, "MIN_UNKNOWNS_WITH_FRAMES", 0)
    monkeypatch.setattr(factorisation, "OVERLAP", 100)
    system = run.system
    begin_iteration(run, 1e-3)
    exact = condensed_constraints.for_constraints(system, 60, is_alone=True)
    A = system.matrices.tangent()
    pc = PETSc.PC().create(comm)
    pc.setOperators(A)
    exact.setUp(pc)
    r, z = A.createVecs()
    r.setRandom()
    # Rows of held coordinates have no residual.
    r.array[system.unknowns.supports.held] = 0.0
    exact.apply(pc, r, z)
    left = A * z - r
    assert left.norm() < 1e-9 * r.norm()


@pytest.mark.mpi(1)
@pytest.mark.parametrize("make", SCENES)
def test_steps_are_those_of_a_factorisation(make, comm, monkeypatch):
    """Energies, multipliers and Newton iterations are those of the complete factorisation on one
    rank, and the constraints hold to round-off."""
    run = simulation(make, comm, monkeypatch)
    other = simulation(make, MPI.COMM_SELF)
    context = run.solver.newton._preconditioner.getPythonContext()
    assert isinstance(context, CondensedConstraints)
    assert other.solver.newton.ksp.getType() == "preonly"
    multipliers = []
    for each in (run, other):
        each.run(until=5e-3)
        system = each.system
        owned = system.unknowns.q0.array_r[system.equations.constraints.owned]
        multipliers.append(system.comm.allreduce(float(owned @ owned)) ** 0.5)
        assert abs(each.energy_error) < 1e-10 * each.totals.size
    assert run.totals.energy == pytest.approx(other.totals.energy, rel=1e-9)
    assert multipliers[0] == pytest.approx(multipliers[1], rel=1e-6)
    assert multipliers[1] > 0
    assert run.system.equations.constraints.violation(run.system.unknowns.q0) < 1e-13
    newton = run.solver.newton
    assert newton.all_iterations <= other.solver.newton.all_iterations + 2
    assert newton.linear_iterations < 12 * newton.all_iterations


@pytest.mark.mpi
@pytest.mark.parametrize(("make", "most"), [(book, 3), (stiff_book, 3), (inflated_book, 10)])
def test_steps_with_contact_are_those_of_a_factorisation(make, most, comm, monkeypatch):
    """Couplings of contact, some at tied nodes and at nodes that a beam holds, are condensed."""
    run = simulation(make, comm, monkeypatch)
    other = simulation(make, MPI.COMM_SELF)
    newton = run.solver.newton
    assert isinstance(newton._preconditioner.getPythonContext(), CondensedConstraints)
    assert other.solver.newton.ksp.getType() != newton.ksp.getType()
    stored = []
    for each in (run, other):
        each.run(until=1e-3)
        stored.append(each.totals.stored["contact"])
        assert abs(each.energy_error) < 1e-10 * each.totals.size
    assert run.totals.energy == pytest.approx(other.totals.energy, rel=1e-9)
    assert stored[0] > 0
    assert stored[0] == pytest.approx(stored[1], rel=1e-6)
    assert run.system.equations.constraints.violation(run.system.unknowns.q0) < 1e-13
    assert newton.all_iterations <= 1.5 * other.solver.newton.all_iterations
    # Hardly more than one for one: the preconditioner has the couplings.  Slack film takes more.
    assert newton.linear_iterations < most * newton.all_iterations


def test_a_gradient_is_that_of_a_factorisation(monkeypatch):
    """The adjoint factorises the tangent with its multipliers, whose pattern now has the fill."""
    found = []
    for patch in (monkeypatch, None):
        run = simulation(chain, MPI.COMM_SELF, patch)
        tape = gx.analysis.RunTape(run)
        run.run(until=3e-3)
        (slope,) = gx.analysis.gradient(tape, of=gx.analysis.Energy(), by=["left.initial_velocity"])
        found.append(slope.values)
    assert np.linalg.norm(found[1]) > 0
    np.testing.assert_allclose(found[0], found[1], atol=1e-7 * np.abs(found[1]).max())


def test_a_run_is_freed(monkeypatch):
    """PETSc holds the context of the operator and of the preconditioner of the condensed system."""
    run = simulation(chain, MPI.COMM_SELF, monkeypatch)
    run.run(until=1e-3)
    left = [weakref.ref(one) for one in (run.system, run.solver)]
    ranks = run.comm
    del run
    for _ in range(3):  # what a preconditioner held is dropped with it
        gc.collect()
        PETSc.garbage_cleanup(ranks)
    assert [one() for one in left] == [None, None]


def test_a_restart_goes_on_as_the_run(monkeypatch, tmp_path):
    """A checkpoint has multipliers and coordinates; the rules of ties are found again."""
    options = {"checkpoints": gx.Checkpoints(tmp_path / "saves", every=2)}
    whole = simulation(chain, MPI.COMM_SELF, monkeypatch)
    half = simulation(chain, MPI.COMM_SELF, monkeypatch, **options)
    half.run(until=2e-3)
    rest = simulation(chain, MPI.COMM_SELF, monkeypatch, restart=tmp_path / "saves")
    assert rest.step == 2
    for run in (whole, rest):
        run.run(until=4e-3)
    np.testing.assert_allclose(
        rest.system.unknowns.q0.array_r, whole.system.unknowns.q0.array_r, atol=1e-10
    )


@pytest.mark.filterwarnings("ignore:Diagonal number")
def test_ties_that_follow_from_others_end_the_step_in_words(monkeypatch):
    """Scenes with many constraints are not searched for dependent ones; the step then fails."""
    monkeypatch.setattr("gossamer_fx.mechanics.terms.point_constraints.MAX_CHECKED_CONSTRAINTS", 0)
    # Small matrices are regularised, so that such ties do not matter.
    monkeypatch.setattr(factorisation, "MAX_UNKNOWNS_BLOCKS", 0)

    def twice(comm):
        (left, right), ties = films(comm, "left", "right")
        return [left, right, *ties, gx.Tie(right, left, group_a="left", group_b="right", name="2")]

    run = simulation(twice, MPI.COMM_SELF, monkeypatch)
    with pytest.raises(gx.StepFailure, match="linear solver"):
        run.run(until=1e-3)


def test_a_step_of_many_iterations_is_factorised(monkeypatch):
    """After a solve that takes more Krylov iterations than a factorisation costs, the other
    matrices of the step and of the next one are factorised, and the result is the same."""
    run = simulation(braced, MPI.COMM_SELF, monkeypatch)
    other = simulation(braced, MPI.COMM_SELF)
    monkeypatch.setattr(condensed_constraints, "MAX_ITERATIONS", 0)
    set_ups = []
    original = CondensedConstraints._condense

    def counted(preconditioner, matrix):
        set_ups.append(preconditioner._system.unknowns.time)
        original(preconditioner, matrix)

    monkeypatch.setattr(CondensedConstraints, "_condense", counted)
    for each in (run, other):
        each.run(until=3e-3)
    # The third step begins with Krylov iterations again.
    assert set_ups == pytest.approx([0.0, 2e-3])
    assert run.solver.newton.all_iterations > 3
    assert run.totals.energy == pytest.approx(other.totals.energy, rel=1e-9)


def test_ties_alone_are_not_factorised_because_of_some_iterations(monkeypatch):
    """With poor factors a solve takes more than the iterations that frames are allowed."""
    run = simulation(plane, MPI.COMM_SELF, monkeypatch)
    other = simulation(plane, MPI.COMM_SELF)
    monkeypatch.setattr(two_level, "ILU_LEVELS", 0)
    monkeypatch.setattr(two_level, "ILU_LEVELS_DIFFICULT", 0)
    monkeypatch.setattr(condensed_constraints, "MAX_ITERATIONS", 1)
    made = new_factorisations(monkeypatch)
    for each in (run, other):
        each.run(until=1e-3)
    assert run.solver.newton.linear_iterations > run.solver.newton.all_iterations
    assert not made
    assert run.totals.energy == pytest.approx(other.totals.energy, rel=1e-9)


def new_factorisations(monkeypatch) -> list[bool]:
    """A list that gets an entry for each new factorisation: whether it is scaled."""
    made: list[bool] = []
    original = factorisation.new

    def noted(A, is_scaled):
        made.append(is_scaled)
        return original(A, is_scaled)

    monkeypatch.setattr(factorisation, "new", noted)
    return made


@pytest.mark.parametrize("largest, is_scaled", [(1e-9, False), (0.0, True)])
def test_a_factorisation_that_is_not_accurate_is_made_with_scaling(largest, is_scaled, monkeypatch):
    run = simulation(braced, MPI.COMM_SELF, monkeypatch)
    other = simulation(braced, MPI.COMM_SELF)
    monkeypatch.setattr(condensed_constraints, "MAX_ITERATIONS", 0)
    monkeypatch.setattr(condensed_constraints, "MAX_RESIDUAL", largest)
    made = new_factorisations(monkeypatch)
    for each in (run, other):
        each.run(until=1e-3)
    assert not made[0]
    assert made[-1] is is_scaled
    assert run.totals.energy == pytest.approx(other.totals.energy, rel=1e-9)


def test_unknowns_in_contact_are_ordered_once(monkeypatch):
    """While the pairs are the same, factors of the whole matrix keep the order of its unknowns."""
    run = simulation(stiff_book, MPI.COMM_SELF, monkeypatch)
    other = simulation(stiff_book, MPI.COMM_SELF)
    monkeypatch.setattr(condensed_constraints, "MAX_ITERATIONS", 0)
    made = new_factorisations(monkeypatch)
    for each in (run, other):
        each.run(until=1e-3)
    assert run.totals.stored["contact"] > 0
    assert 2 * len(made) < run.solver.newton.all_iterations
    assert run.totals.energy == pytest.approx(other.totals.energy, rel=1e-9)


def test_hard_solves_of_a_rejected_step_do_not_count(monkeypatch):
    """The next attempt begins with Krylov iterations again."""
    run = simulation(braced, MPI.COMM_SELF, monkeypatch)
    run.run(until=1e-3)
    context = run.solver.newton._preconditioner.getPythonContext()
    context.give_up()
    assert context.is_factorised
    context.recover()
    assert not context.is_factorised


@pytest.mark.mpi(1)
def test_dependent_directors_fail_on_all_ranks(comm, monkeypatch):
    """The directors of one node vanish, which one rank alone may know: the linear solver fails on
    all of them, in words, and serves again afterwards."""
    run = simulation(braced, comm, monkeypatch)
    other = simulation(braced, comm, monkeypatch)
    system = run.system
    begin_iteration(run, 1e-3)
    kept = system.unknowns.q1.copy()
    beam = next(body for body in system.unknowns.coordinates if isinstance(body, gx.Beam))
    owned = system.unknowns.block(beam).owned
    if comm.rank == 0:
        system.unknowns.q1.array[owned.start + 3 : owned.start + 9] = 0.0
    newton = run.solver.newton
    A = system.matrices.assemble_tangent().A
    r, z = A.createVecs()
    r.setRandom()
    newton.ksp.setOperators(A)
    newton.ksp.solve(r, z)
    assert newton.ksp.getConvergedReason() < 0
    kept.copy(system.unknowns.q1)
    linear.recover(newton._preconditioner)
    for each in (run, other):
        each.run(until=1e-3)
    assert run.totals.energy == pytest.approx(other.totals.energy, rel=1e-9)
