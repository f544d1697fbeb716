"""The tangent of contact: which blocks are in the system's matrix, and which are multiplied
separately."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc

import gossamer_fx as gx
from gossamer_fx.mechanics.contact import assembly
from gossamer_fx.mechanics.contact.contact_step import ObstaclePairs
from gossamer_fx.mechanics.terms.assembly import CouplingBlocks
from gossamer_fx.solve.system.tangent import BlockSum, Tangent
from tests.bodies.spectrum import dense
from tests.contact.scenes import contact_set_of, simulate, two_films


def touching(comm, body: str, order: int = 1) -> gx.Simulation:
    """Films in the middle of a collision; one of them is held at an edge; with a body they rub,
    too."""
    lower, upper = two_films(comm, height=1.2e-3, order=order, n=6 - 2 * order)
    items = [gx.Fixed(lower, "left")]
    if body:
        # An orthonormal triad without zeros, so that no entry of the tangent vanishes by chance.
        turned = np.array([(0.36, 0.48, -0.8), (-0.8, 0.6, 0.0), (0.48, 0.64, 0.6)])
        block = gx.RigidBody(
            0.02,
            (1e-5, 1e-5, 1e-5),
            position=(0, 0, -0.0209),
            attitude=turned,
            comm=comm,
        )
        if body == "ball":
            solid = gx.contact.Sphere(
                centre=(0.0, 0.0, -0.0209),
                radius=0.02,
                body=block,
                friction=0.3,
            )
        elif body == "cylinder":
            solid = gx.contact.Cylinder(
                start=(-0.03, 0, -0.0209),
                end=(0.03, 0, -0.0209),
                radius=0.02,
                body=block,
                friction=0.3,
            )
        else:
            solid = gx.contact.Plane(
                point=(0.0, 0.0, -0.0009),
                normal=(0.0, 0.0, 1.0),
                body=block,
                friction=0.3,
            )
        return simulate(
            [gx.Contact(lower, upper, solid, distance=1e-3, friction=0.2), *items], 2e-4
        )
    return simulate([gx.Contact(lower, upper, distance=1e-3), *items], 2e-4)


@pytest.mark.mpi(2)
@pytest.mark.parametrize(
    ("body", "order"), [("", 1), ("ball", 1), ("cylinder", 1), ("plane", 1), ("ball", 2)]
)
def test_the_tangent_is_the_derivative_of_the_residual(comm, body, order) -> None:
    run = touching(comm, body, order)
    system = run.system
    numbering = system.unknowns.numbering
    contacts = system.equations.active_sets[0]
    held = system.unknowns.supports.held
    system.equations.begin_step(1e-4)
    q, z, end = (numbering.vector() for _ in range(3))
    q.waxpy(1e-4, system.unknowns.v0, system.unknowns.q0)
    z.array[:] = np.random.default_rng(comm.rank).normal(size=numbering.size_local)
    # Fixed degrees of freedom do not move.
    z.array[held] = 0

    def forces(step: float):
        end.waxpy(step, z, q)
        system.equations.set_end(end)
        r = numbering.vector()
        contacts.add_forces(r)
        r.array[held] = 0
        return r

    # Contact is stiff: the difference must be small compared with gaps of 1e-4 m.
    # Points of order 2 are nearer to each other, and closed further.
    ε = 1e-9 / order**2
    exact = forces(ε)
    exact.axpy(-1.0, forces(-ε))
    exact.scale(0.5 / ε)
    forces(0.0)
    # Enough points in contact, or the tangent is zero.
    pressed = contact_set_of(run).forces.on_points.any(axis=1)
    assert comm.allreduce(np.count_nonzero(pressed)) > 10
    A = numbering.matrix()
    contacts.add_tangents(A)
    A.assemble()
    system.unknowns.supports.clear(A, 0.0)
    tangent = Tangent(A, [contacts])
    tangent.fetch_couplings()
    of_sum, of_whole, of_factorised, of_strong = (numbering.vector() for _ in range(4))
    tangent.mult(z, of_sum)
    tangent.whole().mult(z, of_whole)
    tangent.for_factorisation().mult(z, of_factorised)
    tangent.for_preconditioner().mult(z, of_strong)
    # `-gx_mat_type aij` makes matrices of this kind.
    of_numbers = numbering.vector()
    numbers = Tangent(A.convert("aij", PETSc.Mat()), [contacts])
    numbers.fetch_couplings()
    numbers.for_factorisation().mult(z, of_numbers)
    size = exact.norm()
    for found in (of_sum, of_whole, of_factorised, of_numbers):
        found.axpy(-1.0, exact)
        # 1e-5: relative truncation of the difference near the barrier.
        assert found.norm() < 1e-5 * size
    of_strong.axpy(-1.0, exact)
    # The preconditioner's matrix leaves out weak couplings, and is closer than nothing.
    assert of_strong.norm() < size  # a part


def test_a_sum_of_blocks_keeps_its_pattern_until_it_lacks_a_block() -> None:
    ends = np.array([0, 2, 4, 5], dtype=np.int32)
    columns = np.array([0, 1, 0, 1, 2], dtype=np.int32)
    draw = np.random.default_rng(1)
    A = PETSc.Mat().createBAIJ(((9, 9), (9, 9)), 3, csr=(ends, columns, draw.random((5, 9))))
    total = BlockSum(A)

    def couplings(*places: tuple[int, int]) -> CouplingBlocks:
        rows, columns = np.array(places).T
        return CouplingBlocks(rows, columns, draw.random((len(rows), 9)))

    def sum_of(*several: CouplingBlocks) -> PETSc.Mat:
        found = total.set(several)
        expected = dense(A)
        for blocks in several:
            for row, column, values in zip(blocks.rows, blocks.columns, blocks.values, strict=True):
                at = slice(3 * row, 3 * row + 3), slice(3 * column, 3 * column + 3)
                expected[at] += values.reshape(3, 3)
        assert np.array_equal(dense(found), expected)
        return found

    # A has these blocks itself.
    sum_of(couplings((0, 1), (1, 0)))
    first = sum_of(couplings((0, 2), (1, 2)), couplings((1, 2), (2, 2)))
    # Both blocks are in the pattern, with new values of A.
    A.scale(2.0)
    assert sum_of(couplings((1, 2))).handle == first.handle
    wider = sum_of(couplings((0, 2), (1, 2), (2, 0)))
    assert wider.handle != first.handle
    # One coupling of four is left: the others are not kept.
    narrow = sum_of(couplings((2, 1)))
    assert narrow.getInfo()["nz_used"] < wider.getInfo()["nz_used"]


def test_strong_couplings_are_some_of_all_whichever_is_asked_for_first() -> None:
    system = touching(MPI.COMM_SELF, "").system
    contacts = system.equations.active_sets[0]
    system.equations.begin_step(1e-4)
    system.equations.set_end(system.unknowns.q0)
    contacts.add_forces(system.unknowns.numbering.vector())
    A = system.unknowns.numbering.matrix()
    contacts.add_tangents(A)
    A.assemble()
    (strong,) = contacts.coupling_matrices(A.getDiagonal())
    (every,) = contacts.coupling_matrices(None)
    is_strong = dense(strong) != 0
    assert 0 < is_strong.sum() < np.count_nonzero(dense(every))
    assert np.array_equal(dense(strong)[is_strong], dense(every)[is_strong])


@pytest.mark.mpi
def test_the_matrix_of_the_films_keeps_its_pattern(comm) -> None:
    run = touching(comm, "")
    entries = run.system.matrices.A.getInfo()["nz_used"]
    run.run(until=1.2e-3)
    assert run.system.matrices.A.getInfo()["nz_used"] == entries
    assert run.system.unknowns.M.getInfo()["nz_used"] == entries


def test_blocks_in_scalar_rows_have_their_entries_row_by_row():
    """Two blocks next to each other, of the columns 0 and 6, and one below them, of the column
    3."""
    columns, order = assembly._unrolled(np.array([0, 6, 3]), np.array([0, 2]), np.array([2, 1]))
    entries = np.arange(27).reshape(3, 3, 3)
    above = np.hstack([entries[0], entries[1]])
    assert order.tolist() == [*above.ravel(), *entries[2].ravel()]
    assert columns.tolist() == [0, 1, 2, 6, 7, 8] * 3 + [3, 4, 5] * 3


def test_a_floor_pays_nothing_for_an_obstacle_on_a_body(comm) -> None:
    """Its pairs have the block rows of their film only, those of the box four more of the body."""
    lower, upper = two_films(comm, height=1.2e-3)
    body = gx.RigidBody(0.02, (1e-5,) * 3, position=(0.0, 0.0, 0.0022), comm=comm)
    box = gx.contact.Box(centre=(0.0, 0.0, 0.0106), sizes=(0.02, 0.02, 0.018), body=body)
    floor = gx.contact.Plane(point=(0.0, 0.0, -9e-4), normal=(0.0, 0.0, 1.0))
    contact = gx.Contact(lower, upper, floor, box, distance=1e-3)
    run = simulate([contact, gx.Fixed(lower, "left")], 2e-4)
    run.run(until=2e-4)
    step = contact_set_of(run).accepted.step
    widths = {
        group.block_rows.shape[1] for group in step.groups if isinstance(group, ObstaclePairs)
    }
    assert 1 in widths and 5 in widths and max(widths) <= 7
