"""Loops over cells and entries of blocks against dolfinx's own assembly, on one and two ranks."""

from __future__ import annotations

import basix.ufl
import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.core.algebra.block_entries import block_assembly
from gossamer_fx.core.algebra.numbering import Numbering
from gossamer_fx.core.forms.backend import (
    add_to_matrix,
    add_to_vector,
    cell_integral,
    distribute,
    interpolation_points,
)
from gossamer_fx.core.forms.cell_loops import assembly, tabulation
from gossamer_fx.core.forms.compilation import compile_form, constant
from gossamer_fx.core.model.body import Block

pytestmark = pytest.mark.mpi

# unknowns of a node of the body, and of those of another body in the same matrix
SIZES = [(3, None), (9, None), (9, 3)]


class Problem:
    """A function with `size` components of order 2, and a constant."""

    def __init__(self, comm: MPI.Intracomm, size: int, domain: mesh.Mesh | None = None) -> None:
        self.domain = domain or mesh.create_unit_square(comm, 3, 4)
        element = basix.ufl.element("Lagrange", "triangle", 2, shape=(size,))
        self.space = fem.functionspace(self.domain, element)
        self.u = fem.Function(self.space)
        self.u.interpolate(lambda x: np.array([np.sin((k + 1) * x[0]) + x[1] for k in range(size)]))
        self.c = constant(self.domain, 2.0)
        self.w = ufl.TestFunction(self.space)
        self.v = ufl.TrialFunction(self.space)
        gradient = ufl.grad(self.u)
        self.force = (
            self.c * ufl.dot(self.u, self.u) * ufl.inner(gradient, ufl.grad(self.w)) * ufl.dx
        )
        # Not symmetric: transposed blocks would differ.
        along = ufl.dot(self.u, self.v) * self.w[0].dx(0)
        self.tangent = self.c * (along + ufl.inner(ufl.grad(self.v), ufl.grad(self.w))) * ufl.dx


def test_forces_are_those_of_dolfinx_when_constants_and_functions_change(comm) -> None:
    problem = Problem(comm, 3)
    form = compile_form(problem.force)
    own = np.zeros_like(problem.u.x.array)
    add = assembly(form, own)
    for c in (2.0, 5.0):
        problem.c.value = c
        problem.u.x.array[:] *= c
        own[:] = 1.0
        expected = own.copy()
        add()
        add_to_vector(expected, form)
        assert abs(expected).max() > 10
        assert np.array_equal(own, expected)


def test_forces_of_some_cells_are_those_of_dolfinx(comm) -> None:
    problem = Problem(comm, 3)
    cells = np.arange(1, problem.domain.topology.index_map(2).size_local, 3, dtype=np.int32)
    dx = ufl.dx(domain=problem.domain, subdomain_data=[(1, cells)], subdomain_id=1)
    form = compile_form(ufl.inner(problem.u, problem.w) * dx)
    own, expected = np.zeros((2, len(problem.u.x.array)))
    assembly(form, own)()
    add_to_vector(expected, form)
    assert own.any()
    assert np.array_equal(own, expected)


def test_values_at_points_are_those_of_the_function(comm) -> None:
    """x² + c y at the points, ghost cells included."""
    domain = mesh.create_unit_square(comm, 3, 4)
    quadrature = basix.ufl.quadrature_element("triangle", value_shape=(2,), degree=3)
    at_points = fem.Function(fem.functionspace(domain, quadrature))
    points = interpolation_points(at_points.function_space)
    x = ufl.SpatialCoordinate(domain)
    c = constant(domain, 2.0)
    fill = tabulation(ufl.as_vector([x[0] ** 2 + c * x[1], x[0]]), at_points)
    place = fem.Function(fem.functionspace(domain, quadrature))
    place.interpolate(fem.Expression(x, points))
    X, Y = place.x.array.reshape(-1, 2).T
    for value in (2.0, -3.0):
        c.value = value
        fill()
        found = at_points.x.array.reshape(-1, 2)
        assert np.allclose(found[:, 0], X**2 + value * Y, rtol=1e-14, atol=1e-14)
        assert np.allclose(found[:, 1], X, rtol=1e-14, atol=1e-14)


@pytest.mark.mpi
@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_a_loaded_kernel_takes_functions_and_constants_by_their_order(comm, order) -> None:
    """c₀ f₁ - c₁ f₀ of functions and constants that were created in either order, twice."""
    domain = mesh.create_unit_square(comm, 2, 3)
    space = fem.functionspace(domain, ("Lagrange", 1))
    quadrature = basix.ufl.quadrature_element("triangle", degree=2)
    for scale in (1.0, 10.0):
        f = {k: fem.Function(space) for k in order}
        c = {k: constant(domain, scale * (k + 2.0)) for k in order}
        for k, function in f.items():
            function.x.array[:] = k + 5.0
        found = fem.Function(fem.functionspace(domain, quadrature))
        tabulation(c[0] * f[1] - c[1] * f[0], found)()
        assert np.allclose(found.x.array, scale * (2.0 * 6.0 - 3.0 * 5.0), rtol=1e-14)


@pytest.mark.parametrize(("size", "neighbour"), SIZES)
def test_tangents_are_those_of_dolfinx(comm, size: int, neighbour: int | None) -> None:
    assert_tangents_agree(comm, Problem(comm, size), size, neighbour)


def test_a_rank_may_have_no_cells(comm) -> None:
    """One triangle, of which only one rank has cells and nodes."""
    cells = np.array([[0, 1, 2]] if comm.rank == 0 else np.zeros((0, 3)), dtype=np.int64)
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])[: 3 * len(cells)]
    triangle = distribute(comm, cells, corners, "triangle", order=1, sheets=1)
    assert_tangents_agree(comm, Problem(comm, 3, triangle), 3, None)


def assert_tangents_agree(
    comm: MPI.Intracomm, problem: Problem, size: int, neighbour: int | None
) -> None:
    """The entries of `block_assembly` are those of dolfinx, also after a constant changes."""
    form = compile_form(problem.tangent)
    index_map = problem.space.dofmap.index_map
    blocks = [Block(index_map, size)]
    if neighbour is not None:
        blocks.insert(0, Block(index_map, neighbour))
    numbering = Numbering(comm, blocks)
    block = numbering.matrix()
    k = len(blocks) - 1
    local = numbering.local_sets[k]
    unrolled = numbering.block_size != size
    add_to_matrix(block.getLocalSubMatrix(local, local), form, unrolled)
    block.assemble()
    expected = block.copy()
    own = block.duplicate()
    numbering.fix_pattern(own)
    add = block_assembly(own, form, numbering.indices[k])
    for share in (1.0, 3.0):
        problem.c.value = 2.0 * share
        own.zeroEntries()
        own.assemble()
        add()
        own.assemble()
        scale = own.norm()
        own.axpy(-share, expected, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        assert scale > 10 * share
        assert own.norm() < 1e-13 * scale


def test_forms_of_edges_are_added_by_dolfinx(comm) -> None:
    problem = Problem(comm, 3)
    edges = compile_form(ufl.inner(problem.u, problem.w) * ufl.ds + problem.force)
    assert cell_integral(edges) is None
    own, expected = np.zeros((2, len(problem.u.x.array)))
    assembly(edges, own)()
    add_to_vector(expected, edges)
    assert own.any()
    assert np.array_equal(own, expected)
