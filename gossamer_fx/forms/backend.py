"""The seam to dolfinx: what differs between its versions 0.9, 0.10 and 0.11, and nothing else.

| what | 0.9 | 0.10 | 0.11 |
|---|---|---|---|
| order of `create_mesh`'s arguments | points, element | element, points | element, points |
| triangles at one edge | two | as many as are said, if it takes the number | as many as are said |
| `Expression.eval` | (cells, points × values) | (cells, points, *values) | (cells, points, *values) |
| kernels' last argument | permutation | data of the caller's | data of the caller's |
| `interpolation_points` | a method | a property | a property |
| gmsh's reader | `io.gmshio` | `io.gmsh` | `io.gmsh` |
| cells of a submesh in its parent | an array | an `EntityMap` | an `EntityMap` |

Assembly into a part of a PETSc matrix is here too: dolfinx has no public function for it that does not unroll blocks as
it sees fit.
"""

from __future__ import annotations

from importlib import import_module
from inspect import signature
from typing import Any

import basix.ufl
import dolfinx
import dolfinx.cpp
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
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
    "distribute",
    "evaluate",
    "gmsh_order",
    "interpolation_points",
    "part_of",
    "tabulate",
]

_version: str = dolfinx.__version__  # type: ignore[attr-defined]
VERSION = int(_version.split(".")[0]), int(_version.split(".")[1])
if not (0, 9) <= VERSION <= (0, 11):
    raise ImportError(
        f"gossamer_fx runs on dolfinx 0.9, 0.10 and 0.11, and this is {_version}; use one of those."
    )

_LIMIT = "max_facet_to_cell_links"

# whether three triangles or more may share an edge
SHEETS_MAY_MEET = _LIMIT in signature(create_mesh).parameters

KERNELS_TAKE_DATA = VERSION >= (0, 10)  # whether they have one more argument


def distribute(
    comm: MPI.Intracomm,
    cells: npt.NDArray[np.int64],
    points: Array,
    kind: str,
    order: int,
    sheets: int,
) -> Mesh:
    """A mesh over all ranks, whose neighbouring triangles are known across their borders.

    Args:
        cells: nodes (m, k) of this rank's cells, in dolfinx's order.
        points: nodes (n, 3) of this rank [m].
        kind, order: "interval" or "triangle", of order 1 or 2.
        sheets: the most triangles that share an edge; more than two only if `SHEETS_MAY_MEET`.
    """
    domain = ufl.Mesh(basix.ufl.element("Lagrange", kind, order, shape=(3,)))
    limit: dict[str, Any] = {_LIMIT: max(sheets, 2)} if SHEETS_MAY_MEET else {}
    partitioner = _partitioner(GhostMode.shared_facet, max(sheets, 2))
    return create_mesh(comm, cells, x=points, e=domain, partitioner=partitioner, **limit)


def _partitioner(mode: GhostMode, sheets: int) -> Any:
    make: Any = create_cell_partitioner
    return make(mode) if VERSION < (0, 10) else make(mode, sheets)


def part_of(whole: Mesh, cells: Indices) -> tuple[Mesh, Indices]:
    """A mesh of some cells of another one, and the number there of each of its cells, ghosts included."""
    found: Any = create_submesh(whole, whole.topology.dim, cells)
    part, parents, *_ = found
    if VERSION >= (0, 10):
        shared = part.topology.index_map(whole.topology.dim)
        here = np.arange(shared.size_local + shared.num_ghosts, dtype=np.int32)
        parents = parents.sub_topology_to_topology(here, False)
    return part, np.asarray(parents, dtype=np.int32)


def gmsh_order(kind: str, nodes: int) -> Indices:
    """Where the nodes of a cell stand in gmsh's order, in dolfinx's order."""
    reader = import_module("dolfinx.io.gmsh" if VERSION >= (0, 10) else "dolfinx.io.gmshio")
    return np.asarray(reader.cell_perm_array(to_type(kind), nodes), dtype=np.int32)


def interpolation_points(space: fem.FunctionSpace) -> Array:
    """Points of the reference cell (n, tdim) that values of a space are taken at."""
    points: Any = space.element.interpolation_points
    return np.asarray(points() if callable(points) else points)


def evaluate(expression: fem.Expression, mesh: Mesh, cells: Indices) -> Array:
    """Values of an expression in some cells, shape (cells, points × values)."""
    values = expression.eval(mesh, cells)
    if len(cells):
        return np.asarray(values).reshape(len(cells), -1)
    width = expression.X().shape[0] * int(np.prod(expression.ufl_expression.ufl_shape, dtype=int))
    return np.asarray(values).reshape(len(cells), width)


def tabulate(expression: fem.Expression, at_points: fem.Function, cells: Indices) -> None:
    """Set a function at the points of its cells to an expression there, as `interpolate` but without its copies."""
    if not len(cells):
        return
    space = at_points.function_space
    places, values = space.dofmap.list[cells], evaluate(expression, space.mesh, cells)
    at_points.x.array.reshape(-1, space.dofmap.index_map_bs)[places] = values.reshape(
        *places.shape, -1
    )


def add_to_matrix(matrix: PETSc.Mat, form: fem.Form, unrolled: bool) -> None:
    """Add a bilinear form to a matrix, or to a part of one, by local indices.

    `unrolled`: number by number instead of block by block.
    """
    compiled, library = form._cpp_object, dolfinx.cpp.fem
    constants, coefficients = library.pack_constants(compiled), library.pack_coefficients(compiled)
    library.petsc.assemble_matrix(matrix, compiled, constants, coefficients, [], unrolled)
