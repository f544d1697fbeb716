"""Failures of a factorisation: a larger workspace, MUMPS's reason, and another attempt."""

from __future__ import annotations

import numpy as np
import pytest
from petsc4py import PETSc

import gossamer_fx as gx
from gossamer_fx.solve.solvers import factorisation, linear


def test_a_singular_full_matrix_is_told_and_the_next_one_is_solved():
    """PETSc's own factorisation of dense matrices raises an error, which would end the program."""
    A = PETSc.Mat().createDense((2, 2), array=np.ones((2, 2)), comm=PETSc.COMM_SELF)
    x, b = A.createVecs()
    b.array[:] = [1.0, 3.0]
    assert "LAPACK: the matrix is singular" in factorisation.solve(A, b, x)
    A.setValue(1, 1, 2.0)
    A.assemble()
    assert factorisation.solve(A, b, x) == ""
    assert x.array.tolist() == [-1.0, 2.0]


@pytest.mark.mpi(1)
@pytest.mark.parametrize("masses", [64, 128])
def test_a_pinned_hub_with_many_ropes_makes_its_steps(comm, masses, monkeypatch):
    """Pivots that MUMPS puts off need more than the workspace that it reckons with: INFOG(1) =
    -9.

    PETSc then returns an infinite solution, at which no force is computed.
    """
    monkeypatch.setattr(factorisation, "MAX_UNKNOWNS_BLOCKS", 0)
    scene = ropes(comm, masses, 0.0, gx.RigidMotion(spin=(0, 0, 1.0)))
    run = gx.Simulation(scene, gx.Midpoint(dt=1e-3), halvings=0)
    attempts = []
    enlarge = factorisation.enlarge
    monkeypatch.setattr(factorisation, "enlarge", lambda pc: attempts.append(1) or enlarge(pc))
    corrections = []
    set_increment = run.system.equations.set_increment

    def recorded(w, point):
        corrections.append(w.norm())
        set_increment(w, point)

    monkeypatch.setattr(run.system.equations, "set_increment", recorded)
    run.run(until=3e-3)
    assert abs(run.energy_error) < 1e-13
    # Divided among ranks the matrix may have workspace enough.
    assert attempts or comm.size > 1
    assert np.isfinite(corrections).all()


def matrix(diagonal: list[float]) -> PETSc.Mat:
    A = PETSc.Mat().createAIJ((len(diagonal), len(diagonal)), nnz=1, comm=PETSc.COMM_SELF)
    for i, value in enumerate(diagonal):
        A.setValue(i, i, value)
    A.assemble()
    return A


def test_the_reason_is_told_and_the_next_matrix_is_tried():
    """PETSc leaves out the numerical factorisation for ever after one that failed."""
    A = matrix([1.0, 0.0, 2.0])
    x, b = A.createVecs()
    b.set(1.0)
    ksp = PETSc.KSP().create(PETSc.COMM_SELF)
    ksp.setOperators(A)
    ksp.setType("preonly")
    pc = ksp.getPC()
    factorisation.choose(pc)
    ksp.solve(b, x)
    assert ksp.getConvergedReason() < 0
    assert "MUMPS: the matrix is singular" in factorisation.reason(pc)
    assert not factorisation.enlarge(pc)
    factorisation.renew(pc)
    A.setValue(1, 1, 4.0)
    A.assemble()
    ksp.setOperators(A)
    ksp.solve(b, x)
    assert x.array.tolist() == [1.0, 0.25, 0.5]
    assert factorisation.reason(pc) == ""


def ropes(comm, masses, spin, *more):
    """A pinned hub with masses on ropes, turning."""
    hub = gx.RigidBody(1.0, (1.0, 1.0, 1.0), comm=comm, name="hub")
    items = [gx.constraints.RevoluteJoint(hub.frame(), gx.ground_frame(), axis=(0, 0, 1))]
    for k in range(masses):
        e = np.array([np.cos(2 * np.pi * k / masses), np.sin(2 * np.pi * k / masses), 0.0])
        mass = gx.PointMass(0.1, tuple(0.5 * e), comm=comm, name=f"mass {k}")
        items += [
            gx.connectors.Rope(
                hub.port(tuple(0.1 * e)), mass.port(), length=0.39, stiffness=1e3, name=f"rope {k}"
            )
        ]
        items += [gx.loads.Centrifugal(mass, (0, 0, spin))] if spin else []
    return gx.Scene(*items, *more)


def test_the_first_acceleration_has_the_workspace_that_it_needs(comm):
    run = gx.Simulation(ropes(comm, 64, 0.0), gx.GeneralizedAlpha(dt=1e-3), halvings=0)
    run.run(until=2e-3)
    assert run.totals.energy == pytest.approx(64 * 0.5 * 1e3 * 0.01**2, rel=1e-4)


@pytest.mark.parametrize("turning", [False, True])
@pytest.mark.parametrize("above", [0.0, 0.3])
def test_modes_have_the_workspace_that_they_need(comm, turning, above):
    """In the plane ω = Ω √(R/l), with the length l to which spin and rope stretch it."""
    spin = 5.0
    equilibrium = gx.Equilibrium(ropes(comm, 64, spin))
    equilibrium.find()
    x = comm.bcast(equilibrium.system.unknowns.q0.array_r[12:15].copy())
    length = float(np.linalg.norm(x)) - 0.1
    found = gx.analysis.modes(
        equilibrium, 3, spin=(0.0, 0.0, spin) if turning else (0.0, 0.0, 0.0), above=above
    )
    exact = spin / (2 * np.pi) * np.sqrt(0.1 / length)
    assert found[-1].frequency == pytest.approx(exact, rel=2e-2)


def test_a_coarse_space_is_set_up_anew_after_a_failure():
    """PETSc would not try the next matrix; the reason is told."""
    pc = PETSc.PC().create(PETSc.COMM_SELF)
    factorisation.choose(pc)
    pc.setOperators(matrix([1.0, 0.0, 2.0]))
    assert "singular" in factorisation.set_up(pc)
    pc.setOperators(matrix([1.0, 4.0, 2.0]))
    assert factorisation.set_up(pc) == ""


def test_attempts_at_a_step_do_not_use_up_the_hard_steps():
    steps = factorisation.HardSteps(limit=8)
    for _ in range(2):
        steps.begin_step()
        steps.extend()
    assert steps.left == 2
    for _ in range(3):
        steps.begin_step()
        assert steps.left == 1
        steps.restore()


def blocks_of_three(dense: np.ndarray) -> PETSc.Mat:
    """A dense array as a matrix of 3 x 3 blocks, all of which are stored."""
    n = len(dense) // 3
    ends = np.arange(0, n * n + 1, n, dtype=PETSc.IntType)
    columns = np.tile(np.arange(n, dtype=PETSc.IntType), n)
    blocks = dense.reshape(n, 3, n, 3).transpose(0, 2, 1, 3)
    values = np.ascontiguousarray(blocks).ravel()
    A = PETSc.Mat().createBAIJ(dense.shape, 3, csr=(ends, columns, values), comm=PETSc.COMM_SELF)
    return A


def factorised(dense: np.ndarray) -> PETSc.PC:
    A = blocks_of_three(dense)
    pc = PETSc.PC().create(PETSc.COMM_SELF)
    pc.setOperators(A)
    factorisation.choose_for_steps(pc, A)
    assert str(pc.getPythonContext()) == "a factorisation of blocks"
    return pc


def solution(pc: PETSc.PC, right: np.ndarray) -> np.ndarray:
    pc.setUp()
    x, b = pc.getOperators()[0].createVecs()
    b.array[:] = right
    pc.apply(b, x)
    return x.array_r.copy()


@pytest.mark.parametrize("has_suitesparse", [True, False])
def test_blocks_are_factorised_whether_or_not_they_need_pivots(monkeypatch, has_suitesparse):
    """Without pivoting the second matrix has no factors: its diagonal blocks are zero."""
    if not has_suitesparse:
        monkeypatch.setattr(factorisation, "_minimum_degree", lambda: "qmd")
    random = np.random.default_rng(3)
    definite = random.normal(size=(12, 12)) + 12 * np.eye(12)
    saddle = random.normal(size=(12, 12))
    for k in range(0, 12, 3):
        saddle[k : k + 3, k : k + 3] = 0
    right = random.normal(size=12)
    pc = factorised(definite)
    assert solution(pc, right) == pytest.approx(np.linalg.solve(definite, right), rel=1e-12)
    pc.setOperators(blocks_of_three(saddle))
    assert solution(pc, right) == pytest.approx(np.linalg.solve(saddle, right), rel=1e-11)
    pc.setOperators(blocks_of_three(2 * definite))
    assert solution(pc, right) == pytest.approx(np.linalg.solve(definite, right) / 2, rel=1e-12)


def saddle_point(stiffness: float, director: float, random: np.random.Generator) -> np.ndarray:
    """A matrix of 12 coordinates of films, 9 of the directors of a disc, whose normal has no
    inertia, and 6 multipliers: three tie a point of the film to the disc, three keep directors
    normal to each other."""
    K = random.normal(size=(12, 12))
    matrix = np.zeros((27, 27))
    matrix[:12, :12] = stiffness * (K @ K.T + np.eye(12))
    matrix[15:21, 15:21] = director * np.eye(6)
    C = np.zeros((6, 21))
    C[:3, :3] = np.eye(3)
    C[:3, 15:18] = 0.02 * np.eye(3)
    d = np.linalg.qr(random.normal(size=(3, 3)))[0]
    for row, (i, j) in enumerate(((0, 1), (0, 2), (1, 2))):
        C[3 + row, 12 + 3 * i : 15 + 3 * i] = d[j]
        C[3 + row, 12 + 3 * j : 15 + 3 * j] = d[i]
    # The lengths of the directors and their turns keep some stiffness in a step.
    matrix[12:15, 12:15] = director * np.outer(d[0], d[0])
    matrix[21:, :21] = C
    matrix[:21, 21:] = C.T
    return matrix


@pytest.mark.parametrize("stiffness", [1.0, 1e6])
@pytest.mark.parametrize("director", [1.0, 1e-6])
def test_matrices_with_multipliers_are_factorised_without_pivots(stiffness, director):
    """Also with directors that have no inertia, and several matrices of one pattern, of which the
    later ones are ten times as stiff."""
    random = np.random.default_rng(5)
    kind = factorisation.SaddlePoint(
        np.arange(21, 27, dtype=np.int32), [np.arange(12, 21, dtype=np.int32)[None]]
    )
    factors = factorisation.BlockFactors(kind)
    pc = PETSc.PC().create(PETSc.COMM_SELF)
    pc.setType("python")
    pc.setPythonContext(factors)
    for factor in (1.0, 1.0, 10.0):
        dense = saddle_point(factor * stiffness, factor * director, random)
        right = dense @ np.ones(27)
        pc.setOperators(blocks_of_three(dense))
        found = solution(pc, right)
        assert factors._in_use is factors._without_pivots
        assert abs(dense @ found - right).max() < 1e-9 * abs(right).max()


def test_singular_blocks_are_told_and_the_next_matrix_is_solved():
    """A row of zeros has no pivot; the iteration that asked ends with NaN and goes on with the next
    matrix."""
    definite = np.eye(6)
    singular = np.diag([1.0, 1.0, 0.0, 1.0, 1.0, 1.0])
    pc = factorised(singular)
    assert np.isnan(solution(pc, np.ones(6))).all()
    assert "MUMPS: the matrix is singular" in factorisation.reason(pc)
    linear.recover(pc)
    pc.setOperators(blocks_of_three(definite))
    assert solution(pc, np.ones(6)) == pytest.approx(np.ones(6), rel=1e-15)
    assert factorisation.reason(pc) == ""
