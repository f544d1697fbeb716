"""Interface to dolfinx: all differences between its versions 0.9, 0.10 and 0.11 are handled here.

    what                       0.9                       0.10 and 0.11
    triangles at one edge      two                       a given number, if `create_mesh` has the
                                                         argument
    `Expression.eval`          (cells, points × values)  (cells, points, *values)
    kernels' last argument     permutation               data of the caller
    `interpolation_points`     a method                  a property
    reader of gmsh files       `io.gmshio`               `io.gmsh`
    cells of a submesh         an array                  an `EntityMap`
    UFL's derivatives          by a stack                by recursion

In 0.11 a mesh has lists of `dofmaps` and `cmaps`, with an entry for each kind of cells.  The
arguments of `create_mesh` are ordered points, element in 0.9 and 0.11, and element, points in 0.10.

Assembly is here too, by functions of dolfinx's C++ library (`add_to_matrix`, `add_to_vector`).
dolfinx's Python function for matrices chooses by itself whether it enters single numbers or the
blocks of nodes; here the caller has to choose.  Its function for vectors makes six calls of Python
for one of C++, in each iteration.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from inspect import signature
from typing import Any

import basix.ufl
import dolfinx
import dolfinx.cpp
import dolfinx.jit
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.fem import coordinate_element
from dolfinx.mesh import (
    GhostMode,
    Mesh,
    Topology,
    create_cell_partitioner,
    create_mesh,
    create_submesh,
    to_type,
)
from mpi4py import MPI
from petsc4py import PETSc

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int32]

__all__ = [
    "KERNELS_TAKE_DATA",
    "SHEETS_MAY_MEET",
    "VERSION",
    "Topology",
    "add_to_matrix",
    "add_to_vector",
    "cell_integral",
    "cell_nodes",
    "distribute",
    "evaluate",
    "facets_of",
    "geometry_element",
    "geometry_nodes",
    "gmsh_order",
    "interpolation_points",
    "loaded_kernel",
    "submesh_of",
    "values_and_rows",
    "with_points",
]

# (major, minor) of dolfinx
_version: str = dolfinx.__version__  # type: ignore[attr-defined]
_major, _minor = _version.split(".")[:2]
VERSION = int(_major), int(_minor)
if not (0, 9) <= VERSION <= (0, 11):
    raise ImportError(
        f"gossamer_fx runs on dolfinx 0.9, 0.10 and 0.11, and this is {_version}; use one of those."
    )

# The argument of `create_mesh` for the number of triangles at one edge.  Some builds of 0.10 lack
# it, so the signature decides and not the version.
_LIMIT = "max_facet_to_cell_links"

# Whether three triangles or more may share an edge.
SHEETS_MAY_MEET = _LIMIT in signature(create_mesh).parameters

# Whether compiled kernels have one more argument, a pointer to data of the caller.
KERNELS_TAKE_DATA = VERSION >= (0, 10)

if VERSION >= (0, 10):
    # UFL calls itself several times at each level of an expression, and that of the film
    # `Orthotropic` has 450.  The error beyond the limit prints expressions as trees: gigabytes.
    sys.setrecursionlimit(max(sys.getrecursionlimit(), 20_000))


def distribute(
    comm: MPI.Intracomm,
    cells: npt.NDArray[np.int64],
    points: Array,
    kind: str,
    order: int,
    sheets: int,
) -> Mesh:
    """Create a mesh that is distributed over all ranks, with ghost cells that share facets, so that
    both triangles at an edge are known to the rank that owns the edge.  Collective.

    A rank contributes the node numbers (m, k) of cells of a kind, "interval" or "triangle", and of
    order 1 or 2, in dolfinx's order, which count the points of all ranks, and coordinates (n, 3)
    [m] of points.  At most `sheets` triangles meet at one edge, more than 2 only if
    `SHEETS_MAY_MEET`.
    """
    domain = ufl.Mesh(basix.ufl.element("Lagrange", kind, order, shape=(3,)))
    # dolfinx expects a manifold by default, two triangles at an edge.
    cells_at_facet = max(sheets, 2)
    limit: dict[str, Any] = {}
    if SHEETS_MAY_MEET:
        limit[_LIMIT] = cells_at_facet
    partitioner = _partitioner(GhostMode.shared_facet, cells_at_facet)
    # The order of these arguments changed with 0.10, their names did not.
    return create_mesh(comm, cells, x=points, e=domain, partitioner=partitioner, **limit)


def _partitioner(mode: GhostMode, cells_at_facet: int) -> Any:
    """Partitioner of cells; since 0.10 it needs the largest number of cells at a facet."""
    make: Any = create_cell_partitioner
    if VERSION < (0, 10):
        return make(mode)
    return make(mode, cells_at_facet)


def submesh_of(whole: Mesh, cells: Indices) -> tuple[Mesh, Indices]:
    """Create a mesh of some cells of another mesh, by their local numbers (n,); returned with the
    local number in `whole` of each of its local cells, ghosts last.  Collective."""
    found: Any = create_submesh(whole, whole.topology.dim, cells)
    submesh, parents, *_ = found
    if VERSION >= (0, 10):
        # An `EntityMap` has replaced the array of parent cells.
        cell_map = submesh.topology.index_map(whole.topology.dim)
        count = cell_map.size_local + cell_map.num_ghosts
        local_cells = np.arange(count, dtype=np.int32)
        parents = parents.sub_topology_to_topology(local_cells, False)
    return submesh, np.asarray(parents, dtype=np.int32)


def facets_of(curved: Mesh) -> Mesh:
    """The plane triangles between the corners of curved ones, a mesh with the same topology.
    Collective."""
    # Corners of the cells, numbered apart from other nodes.
    corners = fem.functionspace(curved, ("Lagrange", 1))
    cells = corners.dofmap.list
    index_map = corners.dofmap.index_map
    count = index_map.size_local + index_map.num_ghosts
    original = np.zeros(count, dtype=np.int64)
    nodes = geometry_nodes(curved)[:, : cells.shape[1]]
    original[cells] = curved.geometry.input_global_indices[nodes]
    points = np.zeros((count, 3))
    points[cells] = curved.geometry.x[nodes]
    element = coordinate_element(curved.topology.cell_type, 1)._cpp_object
    # dolfinx's Python function takes the element of C++ in 0.9 and that of Python in 0.11.
    geometry = type(curved.geometry._cpp_object)(index_map, cells, element, points, original)
    compiled = type(curved._cpp_object)(curved.comm, curved.topology._cpp_object, geometry)
    domain = ufl.Mesh(basix.ufl.element("Lagrange", curved.basix_cell(), 1, shape=(3,)))
    return Mesh(compiled, domain)


def with_points(mesh: Mesh, points: npt.NDArray[Any]) -> Mesh:
    """A mesh with the same cells, whose nodes, ghosts included, are at points (n, 3) [m].
    Collective."""
    old = mesh.geometry
    element = coordinate_element(mesh.topology.cell_type, geometry_element(mesh).degree)
    # The arguments are those of `facets_of`.
    geometry = type(old._cpp_object)(
        old.index_map(),
        geometry_nodes(mesh),
        element._cpp_object,
        points,
        old.input_global_indices,
    )
    compiled = type(mesh._cpp_object)(mesh.comm, mesh.topology._cpp_object, geometry)
    degree = geometry_element(mesh).degree
    domain = ufl.Mesh(basix.ufl.element("Lagrange", mesh.basix_cell(), degree, shape=(3,)))
    return Mesh(compiled, domain)


def gmsh_order(kind: str, nodes: int) -> Indices:
    """Permutation p (nodes,) from gmsh's node order to dolfinx's of an "interval" or "triangle":
    node i of dolfinx is p[i] of gmsh.

    >>> [int(node) for node in gmsh_order("triangle", 6)]
    [0, 1, 2, 4, 5, 3]
    """
    name = "dolfinx.io.gmshio"
    if VERSION >= (0, 10):
        name = "dolfinx.io.gmsh"
    # The reader imports gmsh's Python module if there is one, so it is loaded only when needed.
    reader = import_module(name)
    return np.asarray(reader.cell_perm_array(to_type(kind), nodes), dtype=np.int32)


@contextmanager
def _symbols_by_hash() -> Iterator[None]:
    """Let FFCx look up the symbols of a subexpression in the table of its graph.

    By itself it compares each one with all others: for the law of a film that wrinkles that is half
    of the time of a compilation, without that of the C compiler.
    """
    numberer: Any = import_module("ffcx.ir.analysis.valuenumbering").ValueNumberer
    search = numberer.get_node_symbols

    def look_up(self: Any, expression: Any) -> Any:
        return self.V_symbols[self.G.e2i[expression]]

    numberer.get_node_symbols = look_up
    try:
        yield
    finally:
        numberer.get_node_symbols = search


@contextmanager
def loaded_kernel(kernels: dict[bytes, Any], key: bytes) -> Iterator[None]:
    """Let dolfinx take the kernel of a form or expression from a dictionary, whose values are what
    its `ffcx_jit` returns, or enter there the one that it compiles or finds on disk.  dolfinx has
    no argument for it."""
    compile_or_find = dolfinx.jit.ffcx_jit

    def take(*args: Any, **options: Any) -> Any:
        if key not in kernels:
            with _symbols_by_hash():
                compiled, module, _ = compile_or_find(*args, **options)
            # The source is not kept: it is much larger than the kernel.
            kernels[key] = (compiled, module, (None, None))
        return kernels[key]

    dolfinx.jit.ffcx_jit = take
    try:
        yield
    finally:
        dolfinx.jit.ffcx_jit = compile_or_find


def interpolation_points(space: fem.FunctionSpace) -> Array:
    """Points (n, tdim) of the reference cell at which functions are evaluated for interpolation."""
    points: Any = space.element.interpolation_points
    if callable(points):  # 0.9
        points = points()
    return np.asarray(points)


def evaluate(expression: fem.Expression, mesh: Mesh, cells: Indices) -> Array:
    """Values (n, points × components) of a compiled expression in cells (n,) of a mesh, by their
    local numbers; n may be 0."""
    values = expression.eval(mesh, cells)
    if len(cells):
        return np.asarray(values).reshape(len(cells), -1)
    # With no cells -1 is ambiguous for `reshape`, so the width is computed.
    components = int(np.prod(expression.ufl_expression.ufl_shape, dtype=int))
    width = expression.X().shape[0] * components
    return np.asarray(values).reshape(len(cells), width)


def values_and_rows(function: Any) -> tuple[Array, Indices]:
    """Values (n, size) of a function of dolfinx's C++ library at its nodes, ghosts included, and
    the rows (cells, k) of the nodes of each local cell."""
    dofmap = function.function_space.dofmap
    return function.x.array.reshape(-1, dofmap.bs), dofmap.map()


def geometry_nodes(mesh: Any) -> Indices:
    """Rows (cells, k) in `geometry.x` of the nodes of each local cell of a mesh, of Python or of
    dolfinx's C++ library."""
    geometry = mesh.geometry
    return np.asarray(geometry.dofmap if VERSION < (0, 11) else geometry.dofmaps[0])


def geometry_element(mesh: Mesh) -> fem.CoordinateElement:
    """The element that interpolates the positions of a mesh within its cells."""
    geometry: Any = mesh.geometry
    return geometry.cmap if VERSION < (0, 11) else geometry.cmaps[0]


def cell_integral(form: fem.Form) -> tuple[Any, Indices] | None:
    """The compiled integral of a form that is one over owned cells, and their local numbers; None:
    it is not."""
    kind = fem.IntegralType.cell
    compiled = form.ufcx_form
    # Integrals over cells come first, up to this number.
    if form.integral_types != {kind} or compiled.form_integral_offsets[1] != 1:
        return None
    # Since 0.10 cells are found by the number of the integral, not of the sub-domain.
    number = compiled.form_integral_ids[0] if VERSION < (0, 10) else 0
    cells = np.asarray(form._cpp_object.domains(kind, number), dtype=np.int32)
    return compiled.form_integrals[0], cells


def add_to_matrix(matrix: PETSc.Mat, form: fem.Form, unrolled: bool) -> None:
    """Add a compiled bilinear form to a PETSc matrix, or to the result of `getLocalSubMatrix`,
    whose pattern has its entries; not assembled afterwards, since the caller may add more.

    Blocks of nodes are entered, or single numbers if `unrolled`: blocks are faster, but need the
    block size of the matrix to be that of the form's space.
    """
    compiled = form._cpp_object
    library = dolfinx.cpp.fem
    constants = library.pack_constants(compiled)
    coefficients = library.pack_coefficients(compiled)
    library.petsc.assemble_matrix(matrix, compiled, constants, coefficients, [], unrolled)


def add_to_vector(values: Array, form: fem.Form) -> None:
    """Add a compiled linear form to an array over the owned and ghost unknowns of its space."""
    compiled = form._cpp_object
    library = dolfinx.cpp.fem
    constants = library.pack_constants(compiled)
    coefficients = library.pack_coefficients(compiled)
    library.assemble_vector(values, compiled, constants, coefficients)


def cell_nodes(space: fem.FunctionSpace) -> npt.NDArray[np.int32]:
    """Local node numbers (cells, k) of all cells of a space: owned cells first, then ghost cells.
    In each row the corners come first; nodes on edges follow in the order of the element."""
    return space.dofmap.list
