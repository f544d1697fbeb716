"""The coarse space of large meshes: the functions that it contains, and the number of Krylov
iterations with it."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest
from mpi4py import MPI
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

import gossamer_fx as gx
from demos.common import flat_rooted_tube
from demos.films.spinning_sheet import throw
from gossamer_fx.core.checks.errors import NotConverged
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.meshes.tube import flat_tube
from gossamer_fx.solve.solvers import coarse_space, factorisation, linear, two_level
from gossamer_fx.solve.solvers.coarse_space import NODES_PER_PATCH, groups, patches, prolongation
from gossamer_fx.solve.solvers.two_level import TwoLevel
from tests.small_scenes import WRINKLING
from tests.survival.on_ranks import complete, python


def simulation(comm, cells: int, *supports: str, order: int = 1) -> gx.Simulation:
    film = gx.Membrane(
        sheet(comm, cells, cells),
        WRINKLING,
        order=order,
        velocity=None if supports else throw,
    )
    return gx.Simulation(
        gx.Scene(film, *(gx.Fixed(film, s) for s in supports)), gx.Midpoint(dt=1e-3)
    )


def patches_of(body) -> np.ndarray:
    return patches(body, body.space.tabulate_dof_coordinates()[: body.block.index_map.size_local])


@pytest.mark.mpi(1)
@pytest.mark.parametrize("order", [1, 2])
def test_it_holds_every_affine_motion(comm, order):
    system = simulation(comm, 20, order=order).system
    P = prolongation(system)
    u = system.unknowns.numbering.vector()
    X = system.unknowns.q0.array_r.reshape(-1, 3)
    A = np.array([[0.3, -1.0, 0.0], [2.0, 0.7, 0.0], [0.1, -0.4, 0.0]])
    u.array[:] = (X @ A.T + [1.0, 2.0, 3.0]).ravel()
    coefficients = P.createVecRight()
    again = u.duplicate()
    P.multTranspose(u, coefficients)
    P.mult(coefficients, again)
    again.axpy(-1, u)
    assert again.norm() < 1e-13 * u.norm()
    assert coefficients.norm() == pytest.approx(u.norm(), rel=1e-13)
    # three functions of the plane for each of three directions and each patch, but where a rank's
    # share of a patch is a line or a point
    patch = patches_of(system.unknowns.bodies[0])
    affine = np.column_stack([np.ones(len(X)), X[:, :2]])
    ranks = [np.linalg.matrix_rank(affine[patch == k]) for k in range(patch.max() + 1)]
    assert P.getLocalSize()[1] == 3 * sum(ranks)
    assert np.mean(ranks) > 2.8


@pytest.mark.mpi
def test_its_columns_are_orthonormal_and_vanish_where_nodes_are_held(comm):
    system = simulation(comm, 20, "bottom", "bottom left").system
    P = prolongation(system)
    product = P.transposeMatMult(P)
    product.shift(-1.0)
    assert product.norm() < 1e-12
    i, _, values = P.getValuesCSR()
    entries = np.bincount(
        np.repeat(np.arange(len(i) - 1), np.diff(i)), np.abs(values), minlength=len(i) - 1
    )
    assert np.all(entries[system.unknowns.supports.held] == 0)
    free = np.setdiff1d(np.arange(len(entries)), system.unknowns.supports.held)
    assert np.all(entries[free] > 0)


@pytest.mark.parametrize("order", [1, 2])
def test_patches_have_the_same_size(comm, order):
    patch = patches_of(simulation(comm, 40, order=order).system.unknowns.bodies[0])
    sizes = np.bincount(patch)
    assert sizes.max() <= NODES_PER_PATCH
    assert np.median(sizes) > NODES_PER_PATCH / 2
    assert len(sizes) < 2.5 * len(patch) / NODES_PER_PATCH


@pytest.mark.parametrize("in_groups", [False, True])
def test_films_that_lie_on_each_other_are_in_patches_of_their_own(comm, monkeypatch, in_groups):
    monkeypatch.setattr(coarse_space, "PATCHES_PER_GROUP", 4)
    film = gx.Membrane(flat_tube(comm, 1.0, 0.2, 8), WRINKLING)
    system = gx.Simulation(gx.Scene(film), gx.Midpoint(dt=1e-3)).system
    body = system.unknowns.bodies[0]
    patch = patches_of(body)
    if in_groups:
        X = body.space.tabulate_dof_coordinates()[: len(patch)]
        patch = groups(body, X, patches(body, X, nodes_per_patch=10)).patch
    assert patch.max() > 1
    cells = body.space.dofmap.list
    edges = np.concatenate([cells[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))])
    inside = edges[patch[edges[:, 0]] == patch[edges[:, 1]]]
    graph = csr_matrix((np.ones(len(inside)), inside.T), shape=(len(patch), len(patch)))
    assert connected_components(graph, directed=False)[0] == patch.max() + 1


def test_a_cable_has_two_functions_a_direction(comm):
    cable = gx.Cable(line(comm, [(0, 0, 0), (1, 0.5, 0)], 500), gx.CableLaw(1e5, 0.1))
    system = gx.Simulation(gx.Scene(cable), gx.Midpoint(dt=1e-3)).system
    body = system.unknowns.bodies[0]
    patch = patches_of(body)
    assert prolongation(system).getLocalSize()[1] == 2 * 3 * (patch.max() + 1)


@pytest.mark.mpi
def test_krylov_iterations_do_not_grow_with_the_mesh(comm):
    """An incomplete factorisation alone needs 11 and 20 of them, and twice as many on 2 ranks."""
    counts = []
    for cells in (40, 80):
        run = simulation(comm, cells)
        run.run(until=2e-3)
        counts.append(run.solver.newton.linear_iterations / run.iterations)
    assert max(counts) < 7 and counts[1] < 1.3 * counts[0]


@pytest.mark.mpi
def test_a_krylov_iteration_applies_the_preconditioner_once(comm, monkeypatch):
    """The solution is a sum of the preconditioned vectors, and needs no other application."""
    counts = [0]
    apply = TwoLevel.apply

    def counted(preconditioner, *given):
        counts[0] += 1
        apply(preconditioner, *given)

    monkeypatch.setattr(TwoLevel, "apply", counted)
    run = simulation(comm, 40)
    run.run(until=1e-3)
    assert counts[0] == run.solver.newton.linear_iterations > 0


@pytest.mark.mpi
def test_functions_of_a_level_are_sums_of_those_on_the_level_below(comm, monkeypatch):
    monkeypatch.setattr(coarse_space, "PATCHES_PER_GROUP", 4)
    system = simulation(comm, 40).system
    levels = [
        prolongation(system),
        prolongation(system, nodes_per_patch=200),
        prolongation(system, nodes_per_patch=200, in_groups=True),
    ]
    for fine, coarse in itertools.pairwise(levels):
        assert 0 < coarse.getSize()[1] < fine.getSize()[1] / 1.9
        difference = fine.matMult(fine.transposeMatMult(coarse))
        difference.axpy(-1, coarse)
        assert difference.norm() < 1e-12 * coarse.norm()


@pytest.mark.mpi
def test_groups_cross_the_boundaries_of_ranks(comm):
    """One group of a whole sheet has three functions of the plane for each direction, as on one
    rank, and they are orthonormal."""
    system = simulation(comm, 20).system
    P = prolongation(system, in_groups=True)
    assert P.getSize()[1] == 9
    product = P.transposeMatMult(P)
    product.shift(-1.0)
    assert product.norm() < 1e-12


@pytest.mark.mpi
@pytest.mark.parametrize("on_one_rank", [1_000_000, 0], ids=["two levels", "three levels"])
def test_a_v_cycle_serves_as_a_factorisation_does(comm, monkeypatch, on_one_rank):
    """An incomplete factorisation alone needs three times as many iterations."""
    monkeypatch.setattr(coarse_space, "MAX_UNKNOWNS_ON_ONE_RANK", on_one_rank)
    monkeypatch.setattr(coarse_space, "NODES_PER_LARGE_PATCH", 400)
    monkeypatch.setattr(coarse_space, "PATCHES_PER_GROUP", 4)
    counts = []
    sizes = []
    for limit in (1_000_000, 100):
        monkeypatch.setattr(coarse_space, "MAX_UNKNOWNS_FACTORISED", limit)
        run = simulation(comm, 60)
        run.run(until=2e-3)
        counts.append(run.solver.newton.linear_iterations / run.iterations)
        # Meshes are not divided among ranks in the same way each time: the norm is the same.
        sizes.append(run.system.unknowns.q0.norm())
    assert counts[1] < 1.3 * counts[0]
    assert sizes[1] == pytest.approx(sizes[0], rel=1e-9)


def test_the_solver_of_the_last_level_does_not_depend_on_scenes_before(monkeypatch):
    """PETSc's options are those of the whole program."""
    found = []
    for limit in (1_000_000, 100, 1_000_000):
        monkeypatch.setattr(coarse_space, "MAX_UNKNOWNS_FACTORISED", limit)
        run = simulation(MPI.COMM_SELF, 40)
        run.run(until=1e-3)
        multigrid = run.solver.newton._preconditioner.getPythonContext()._multigrid
        found.append(multigrid.getMGCoarseSolve().getPC().getFactorSolverType())
    assert found == ["mumps", "petsc", "mumps"]


@pytest.mark.slow
def test_eight_ranks_take_few_more_iterations_than_one():
    """And give the same energies, with three levels of the coarse space."""
    words = "rank_counts", "scene=sheet", "size=120", "steps=3", "levels=3"
    figures = []
    for ranks in (1, 8):
        done = complete([*python(ranks), "demos/benchmarks/own_program.py", *words])
        assert done.returncode == 0, done.stderr
        figures.append(json.loads(done.stdout.splitlines()[-1]))
    one, eight = figures
    assert eight["energy"] == pytest.approx(one["energy"], rel=1e-9)
    assert eight["Krylov/step"] < 1.6 * one["Krylov/step"]


@pytest.mark.mpi(1)
@pytest.mark.parametrize("factorised", [1_000_000, 100])
def test_a_step_after_an_infinite_matrix_is_solved_as_ever(comm, monkeypatch, factorised):
    monkeypatch.setattr(coarse_space, "MAX_UNKNOWNS_FACTORISED", factorised)
    run = simulation(comm, 40)
    system = run.system
    newton = run.solver.newton
    y = system.equations.begin_step(1e-3)
    wild = system.unknowns.numbering.vector()
    wild.set(1e47)
    wild.array[::5] = -2e47
    system.equations.set_inertia(2 / 1e-3**2)
    with pytest.raises(NotConverged):
        newton.solve(wild, y)
    run.run(until=1e-3)
    assert run.substeps == 0 and run.iterations <= 8


@pytest.mark.mpi
def test_levels_of_fill_rise_when_a_solve_takes_long(comm):
    """Two of them serve a quiet film; where it flutters on a fine mesh they do not."""
    run = simulation(comm, 80)
    run.run(until=1e-3)
    assert "2 levels" in run.solver.newton.summary()
    run.run(until=8e-3)
    assert "6 levels" in run.solver.newton.summary()
    assert run.solver.newton.linear_iterations < 7 * run.iterations and run.substeps == 0


@pytest.mark.mpi
def test_most_fill_serves_for_the_rest_of_a_step(comm, monkeypatch):
    """A step begins with less of it, as hard steps are few."""
    monkeypatch.setattr(two_level, "MORE_FILL_ABOVE", 0)
    monkeypatch.setattr(two_level, "MOST_FILL_ABOVE", 0)
    chosen = []
    choose_fill = TwoLevel._choose_fill

    def note(self, levels):
        chosen.append(levels)
        choose_fill(self, levels)

    monkeypatch.setattr(TwoLevel, "_choose_fill", note)
    run = simulation(comm, 40)
    run.run(until=2e-3)
    assert run.iterations >= 6
    assert chosen == [2, 6, 10, 6, 10]


@pytest.mark.mpi
def test_a_difficult_system_with_contact_is_factorised_unless_the_factors_fill_up(
    comm, monkeypatch
):
    """A folded tube on one rank; several ranks have no such factors.  The steps are the same."""
    monkeypatch.setattr(linear, "MAX_UNKNOWNS_DIRECT_WITH_CONTACT", 0)
    # Solves of so small a system take few iterations.
    monkeypatch.setattr(two_level, "MORE_FILL_ABOVE", 0)
    names = []
    ends = []
    for limit in (0.0, factorisation.MAX_FILL):
        monkeypatch.setattr(factorisation, "MAX_FILL", limit)
        run = flat_rooted_tube.build(comm, cells=4).simulation()
        # Later steps are near the limit of iterations: whether one is rejected, and its parts end
        # elsewhere, is up to round-off.
        run.run(until=2e-5)
        assert run.substeps == 0
        names.append(str(run.solver.newton._preconditioner.getPythonContext()))
        ends.append(run.system.unknowns.q0.array_r.copy())
    assert "coarse space" in names[0]
    expected = "a factorisation of blocks" if comm.size == 1 else names[0]
    assert names[1] == expected
    assert ends[1] == pytest.approx(ends[0], abs=1e-9)


@pytest.mark.mpi
def test_options_choose_another_preconditioner(comm):
    from petsc4py import PETSc

    options = PETSc.Options("gx_")
    options["pc_type"] = "bjacobi"
    try:
        run = simulation(comm, 40)
        run.run(until=1e-3)
        assert "bjacobi" in run.solver.newton.summary()
    finally:
        options.delValue("pc_type")
