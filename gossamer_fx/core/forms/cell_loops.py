"""Compiled expressions and forms in all cells of a mesh, by one call without copies.

Problem.  dolfinx first packs the values of all functions in all cells into one array: for a large
mesh that takes longer than what is computed from them.

Idea.  The loops of `cells.c` gather the values of one cell from the arrays of the functions, call
what FFCx has compiled, and set or add the results.  All addresses are stored once, so that a call
has no arguments to convert.  What is computed, and the order of sums, are those of dolfinx.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import Mesh

from gossamer_fx.core.forms.backend import (
    Array,
    Indices,
    add_to_vector,
    cell_integral,
    geometry_nodes,
    interpolation_points,
    values_and_rows,
)
from gossamer_fx.core.forms.c_source import CLibrary, CStruct, c_library, check_indices
from gossamer_fx.core.forms.compilation import expression_kernel
from gossamer_fx.core.forms.kinematics import Expr

# Its functions are declared in this header.
HEADER = Path(__file__).parent / "cells.h"


@dataclass(frozen=True, eq=False)
class CellFunction:
    """A compiled C function of the values in one cell, with the signature of FFCx's expressions and
    integrals.

    Attributes:
        address: of the function.
        coefficients: functions of dolfinx's C++ library whose values in the cell are its arguments,
            in this order.
        constants: arrays that hold the present values of its constants.
        owner: what has to exist as long as it is called.
    """

    address: int
    coefficients: tuple[Any, ...]
    constants: Sequence[Array]
    owner: object


def cell_function(expression: Expr, points: Array) -> CellFunction:
    """Compile the C function of a UFL expression at points (n, tdim) of the reference cell, of
    float values.  Collective."""
    kernel = expression_kernel(expression, points)
    compiled = kernel.compiled
    # The compiler drops functions that the expression does not need.
    positions = [
        compiled.original_coefficient_positions[k] for k in range(compiled.num_coefficients)
    ]
    return CellFunction(
        address=_address(compiled),
        coefficients=tuple(kernel.coefficients[position]._cpp_object for position in positions),
        constants=_values(kernel.constants),
        owner=kernel,
    )


def _values(constants: Sequence[fem.Constant]) -> list[Array]:
    """The arrays that hold the present values of constants."""
    return [constant._cpp_object.value for constant in constants]


def _address(compiled: Any) -> int:
    """Address of the C function of a compiled expression or integral."""
    ffi = c_library(HEADER).ffi
    return int(ffi.cast("uintptr_t", compiled.tabulate_tensor_float64))


@dataclass(frozen=True, eq=False)
class CellValues:
    """Values (n, size) at nodes or points, and their rows (cells, k) in each cell."""

    values: npt.NDArray[np.floating[Any]]
    rows: Indices

    def fields(self, c: CLibrary) -> dict[str, Any]:
        """Members of the C struct `cell_values` of cells.h, by name."""
        check_indices("The rows of the values", self.rows, len(self.values))
        # Those of some cells may be scattered in those of all.
        rows = np.ascontiguousarray(self.rows)
        return {
            "values": c.array("values", self.values, "float64", self.values.shape, writable=True),
            "nodes": c.array("rows", rows, "int32", rows.shape),
            "node_count": rows.shape[1],
            "size": self.values.shape[1],
        }

    def struct(self, c: CLibrary) -> CStruct:
        """The C structure."""
        return c.struct("cell_values", self.fields(c))

    @property
    def width(self) -> int:
        """How many values a cell has."""
        return int(self.rows.shape[1] * self.values.shape[1])


class Cells:
    """Cells of a mesh, by their local numbers, in which C functions are evaluated.

    Attributes:
        numbers: their local numbers, or the slice of the first of them.
        library: C functions whose header includes cells.h.
        fields: members of the C struct `cell_set`, by name.
    """

    def __init__(self, mesh: Mesh, numbers: Indices, header: Path = HEADER) -> None:
        """Load the library of a header, and note where the cells have their corners.
        Collective."""
        self.library = c_library(header, mesh.comm)
        self.numbers: Indices | slice = numbers
        if np.array_equal(numbers, np.arange(len(numbers))):
            # Rows of the first cells need no copy.
            self.numbers = slice(len(numbers))
        corners = CellValues(mesh.geometry.x, geometry_nodes(mesh)[self.numbers])
        self.fields = {
            "count": len(numbers),
            "corners": corners.fields(self.library),
            "x": self.work(corners.width),
        }

    def values_of(self, function: Any) -> CellValues:
        """The values of a function of dolfinx's C++ library."""
        values, rows = values_and_rows(function)
        return CellValues(values, rows[self.numbers])

    def work(self, count: int) -> Any:
        """Work space of `count` numbers for C."""
        return self.library.array("work", np.zeros(count), "float64", (count,), writable=True)


class PreparedFunction:
    """A C function with the addresses of all that it reads in some cells.

    Attributes:
        fields: members of the C struct `cell_function`, by name.
    """

    def __init__(
        self, function: CellFunction, cells: Cells, in_place_of: Mapping[Any, CellValues]
    ) -> None:
        """Take the values of `in_place_of` for the functions that are its keys."""
        self._cells = cells
        self._function = function
        c = cells.library
        constants = [values.reshape(-1) for values in function.constants]
        sources = [
            {"values": c.array("constant", one, "float64", one.shape), "count": one.size}
            for one in constants
        ]
        arguments = [in_place_of.get(f) or cells.values_of(f) for f in function.coefficients]
        # cffi does not keep alive what the members of an array of structures point at.
        self._kept = [one.fields(c) for one in arguments], sources
        self.fields = {
            "function": function.address,
            "constants": cells.work(sum(one.size for one in constants)),
            "source_count": len(sources),
            "sources": c.ffi.new("constant_value[]", sources),
            "argument_count": len(arguments),
            "arguments": c.ffi.new("cell_values[]", self._kept[0]),
            "packed": cells.work(sum(one.width for one in arguments)),
        }

    def applied(self, loop: str, to: CStruct, width: int) -> Callable[[], Any]:
        """Return what calls a C loop, such as "set_in_cells", with the function; `to` is where the
        results go, `width` how many numbers they are in one cell."""
        c = self._cells.library
        function = c.struct("cell_function", self.fields)
        cells = c.struct("cell_set", self._cells.fields)
        work = self._cells.work(width)
        call = getattr(c.lib, loop)

        # The function is kept for its arrays: cffi does not keep what members of structures in
        # arrays point at.
        def apply(_kept: PreparedFunction = self) -> Any:
            return call(function.pointer, cells.pointer, to.pointer, work)

        return apply


def tabulation(expression: Expr, at_points: fem.Function) -> Callable[[], Any]:
    """Compile a UFL expression at the points of a function whose space stores values at points of
    cells; return what sets the function to it, in all cells, ghosts included.  Collective."""
    space = at_points.function_space
    cells = Cells(space.mesh, np.arange(len(space.dofmap.list), dtype=np.int32))
    function = PreparedFunction(cell_function(expression, interpolation_points(space)), cells, {})
    to = cells.values_of(at_points._cpp_object)
    return function.applied("set_in_cells", to.struct(cells.library), to.width)


def prepared_integral(
    form: fem.Form,
    only: Indices | None = None,
    in_place_of: Mapping[Any, CellValues] | None = None,
) -> tuple[PreparedFunction, Cells, Indices] | None:
    """The C function of a compiled form that is one integral over cells, the cells, and the rows of
    the nodes of its space there (cells, k); None: it is not.  `only` are the local numbers of some
    of the cells, which may occur several times; `in_place_of` as of `PreparedFunction`.
    Collective."""
    found = cell_integral(form)
    if found is None:
        return None
    integral, numbers = found
    cells = Cells(form.mesh, numbers if only is None else only)
    function = CellFunction(
        address=_address(integral),
        coefficients=tuple(form._cpp_object.coefficients),
        constants=_values(form.constants),  # type: ignore[attr-defined]
        owner=form,
    )
    space: Any = form.function_spaces[0]
    rows = space.dofmap.map()[cells.numbers]
    return PreparedFunction(function, cells, in_place_of or {}), cells, rows


def assembly(form: fem.Form, values: Array) -> Callable[[], Any]:
    """Return what adds a compiled linear form to an array over the owned and ghost unknowns of its
    space.  Collective."""
    prepared = prepared_integral(form)
    if prepared is None:
        return lambda: add_to_vector(values, form)
    function, cells, rows = prepared
    to = CellValues(values.reshape(-1, form.function_spaces[0].dofmap.bs), rows)
    return function.applied("add_in_cells", to.struct(cells.library), to.width)
