"""A law with several states at the quadrature points of a rank: responses, and the choice of
strains.

Films that wrinkle have several states.  Full elements (`terms.element_energies`) and sampled ones
(`reduction.points`) both evaluate them here, so that they have the same iterations.  The loops over
points are those of `law.c`.

A law depends on the strains at the start and at the end of a step, on constants, and on functions
such as a thickness that differs from cell to cell.  FFCx compiles its UFL expressions into C
functions; the law kernel calls these by their addresses.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import basix.ufl
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from ufl.algorithms.analysis import extract_coefficients, extract_constants

from gossamer_fx.core.forms.backend import interpolation_points, tabulation
from gossamer_fx.core.forms.c_source import c_library, check_indices
from gossamer_fx.core.forms.compilation import compile_expression
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.forms.strain_path import with_derivative
from gossamer_fx.core.model.body import Array, Indices
from gossamer_fx.mechanics.materials.film import CLaw
from gossamer_fx.mechanics.terms.discrete_gradient import PathEnergy, StressRule

# Its functions are declared in this header.
HEADER = Path(__file__).parent / "law.h"


@dataclass(frozen=True, eq=False)
class CellFunction:
    """A compiled C function of the values in one cell, with the signature of FFCx's expressions.

    Attributes:
        address: of the function.
        coefficients: functions whose values in the cell are its arguments, in this order.
        constants: views of the values of its constants, in their order.
        owner: what has to exist as long as it is called.
    """

    address: int
    coefficients: tuple[fem.Function, ...]
    constants: tuple[Array, ...]
    owner: object


@dataclass(frozen=True, eq=False)
class LawFunctions:
    """The functions of one law.

    Attributes:
        start: strain at the start of the step, at quadrature points.
        strain: strain of the iterate.
        responses: mean stress and its derivatives; the first serves every point, the others are
            cheaper and serve points in certain cases.
        sort: which response is the cheapest for each point; None if there is one.
        density: ψ(start) per unit reference area or length.
        refresh: called when a step begins, before functions are read.
    """

    start: fem.Function
    strain: fem.Function
    responses: tuple[CellFunction, ...]
    sort: CellFunction | None
    density: CellFunction
    refresh: Callable[[], None]


def cell_function(expression: fem.Expression) -> CellFunction:
    """The C function of an expression that `compile_expression` made, of float values; the result
    keeps the expression alive."""
    compiled = expression.ufcx_expression
    ufl_expression = expression.ufl_expression
    coefficients = extract_coefficients(ufl_expression)
    # The compiler drops functions that the expression does not need.
    positions = [
        compiled.original_coefficient_positions[k] for k in range(compiled.num_coefficients)
    ]
    constants = extract_constants(ufl_expression)
    # The kernel calls the function by its address, and reads constants where dolfinx keeps them: a
    # changed constant needs no new call of this function.
    return CellFunction(
        address=int(c_library(HEADER).ffi.cast("uintptr_t", compiled.tabulate_tensor_float64)),
        coefficients=tuple(coefficients[position] for position in positions),
        constants=tuple(np.ravel(c._cpp_object.value) for c in constants),
        owner=expression,
    )


def law_functions(
    energy: PathEnergy, rule: StressRule, start: fem.Function, strain: fem.Function
) -> LawFunctions:
    """Compile the C functions of a stored energy for a stress rule, by which its mean stress (m,),
    with the derivatives (m, m), follows from the strains (m,) at the start of the step and of the
    iterate, functions at the quadrature points.  Stress and density are per area [N/m] or per
    length [N].  Collective.  `InputError`: the rule has no function for laws that are written in C.
    """
    # Rank 0 compiles the kernel here, where all ranks are.
    c_library(HEADER, strain.function_space.mesh.comm)
    if energy.c_law is not None:
        return _in_c(energy.c_law, rule, start, strain)
    points = interpolation_points(strain.function_space)

    def compiled(expression: Expr) -> CellFunction:
        made = compile_expression(expression, points)
        return cell_function(made)

    # A variable, by which the stress is derived.
    variable = ufl.variable(strain)
    cases = rule.cases(energy, start, variable)
    stresses = [rule.stress(energy, start, variable)]
    stresses += [stress for _, stress in cases]
    sort = None
    if cases:
        sort = compiled(first_that_holds(cases))
    return LawFunctions(
        start=start,
        strain=strain,
        responses=tuple(compiled(with_derivative(stress, variable)) for stress in stresses),
        sort=sort,
        density=compiled(energy.density(start)),
        refresh=lambda: None,
    )


def _in_c(c_law: CLaw, rule: StressRule, start: fem.Function, strain: fem.Function) -> LawFunctions:
    """The functions of a law that is written in C, see `law_functions`; they take its numbers at
    the quadrature points."""
    space = strain.function_space
    mesh = space.mesh
    points = interpolation_points(space)
    element = basix.ufl.quadrature_element(
        mesh.basix_cell(), value_shape=c_law.numbers.ufl_shape, degree=space.ufl_element().degree
    )
    numbers = fem.Function(fem.functionspace(mesh, element))
    expression = compile_expression(c_law.numbers, points)
    # C functions of this signature take numbers only, as floats.
    count = np.array([len(points)], dtype=float)

    def function(address: int) -> CellFunction:
        return CellFunction(address, (start, strain, numbers), (count,), owner=c_law.owner)

    return LawFunctions(
        start=start,
        strain=strain,
        responses=(function(rule.function_of(c_law)),),
        sort=None,
        density=function(c_law.density),
        refresh=tabulation(expression, numbers),
    )


def first_that_holds(cases: Sequence[tuple[Expr, Expr]]) -> Expr:
    """The number, from one, of the first case whose condition holds, or zero."""
    # Built from the last case inwards, so that the first one is asked first.
    which: Expr = ufl.as_ufl(0.0)
    for k, (holds, _) in reversed(list(enumerate(cases, 1))):
        which = ufl.conditional(holds, float(k), which)
    return which


# ---- several states at the quadrature points -----------------------------------------------------

# k of equation (5) of `terms.element_energies`, as a fraction of the largest stiffness at the
# point.
STRAIN_CHOICE_STIFFNESS = 0.03
# Relative error of the linearised stress from which a strain is chosen by (5).
STRAIN_CHOICE_TRIGGER = 0.1
# How often in a step a strain may be chosen at one point without the error falling: beyond that the
# point would cycle, or creep where the film is almost slack.
MAX_FRUITLESS_CHOICES = 5
# A choice is fruitless unless the error falls below this part of the last one.
FRUITFUL_ERROR_RATIO = 0.9


@dataclass(frozen=True, eq=False)
class PointValues:
    """Arrays of q rows, one for each quadrature point, which the law reads and writes.

    Attributes:
        start: strains (q, m) at the start of the step.
        strain: strains (q, m) of the iterate.
        response: mean stress and its derivatives (q, m + m²).
        rows: the row of each point (cells, p).
    """

    start: Array
    strain: Array
    response: Array
    rows: Indices


class PointLaw:
    """A law at the quadrature points of some cells, by their local numbers.  `may_choose`: whether
    strains are chosen by equation (5) of `terms.element_energies`."""

    def __init__(
        self, functions: LawFunctions, values: PointValues, cells: Indices, *, may_choose: bool
    ) -> None:
        """Prepare the constants and values that the C kernel reads; no law is evaluated yet.
        Collective."""
        self._functions = functions
        self._values = values
        self._cells = cells
        self._may_choose = may_choose
        # The C library with the kernel, compiled at the first use on a machine.
        self._c = c_library(HEADER, functions.strain.function_space.mesh.comm)
        # For each compiled function the constants as the kernel reads them, and views of their
        # values
        self._constants: list[tuple[Array, list[Array]]] = []
        # Objects at which the kernel points: Python must not free them.
        self._kept: list[Any] = []
        self._most_arguments = 0
        self._number_values()
        self._density = self._c.ffi.new("cell_function *", self._entry(functions.density))
        self._law = self._c.struct("point_law", self._members())
        self._choice = self._c.struct("strain_choice", self._choice_members())
        self.begin_step()

    # ---- a step ----------------------------------------------------------------------------------

    def begin_step(self) -> None:
        """Start a step: read constants, such as moduli, and functions of the law, such as a
        thickness [m] that differs from cell to cell, again, and forget the choices of strains."""
        self._functions.refresh()
        for constants, values in self._constants:
            if values:
                np.concatenate(values, out=constants)
        for function, columns in self._other_columns:
            self._others[:, columns] = _in_cells(function, self._cells)
        self._iteration = 0
        self._chooses = self._may_choose
        self._last_error[:] = np.inf
        self._fruitless[:] = 0

    def linearise(
        self, linear_strain: Callable[[], Array], first_guess: Callable[[], Array]
    ) -> None:
        """Set the strains of the next iterate, and evaluate stresses and their derivatives there.

        The strains are the linearised ones.  Where a law with several states may choose, those of
        the first iterate are a guess, and later ones are chosen point by point between the
        linearised strain and the strain of the linearised stress.
        """
        if not self._chooses:
            self._values.strain[:] = linear_strain()
            self.respond()
        elif self._iteration == 0:
            self._values.strain[:] = first_guess()
            self.respond()
        else:
            self._linear_strain[:] = linear_strain()
            found = self._c.lib.choose_strains(self._law.pointer, self._choice.pointer)
            # After some choices that changed little, strains stay linear for the rest of the step.
            self._chooses = self._iteration <= MAX_FRUITLESS_CHOICES or bool(found)
        self._iteration += 1

    def respond(self) -> None:
        """Evaluate the responses at the strains of the iterate."""
        self._c.lib.evaluate_responses(self._law.pointer)

    def density(self, values: Array) -> None:
        """Evaluate the energy density at the strains of the start of the step: `values` (q,)."""
        out = self._c.array("density", values, "float64", (self._count,), writable=True)
        self._c.lib.evaluate_density(self._law.pointer, self._density, out)

    # ---- what the kernel reads -------------------------------------------------------------------

    @property
    def _count(self) -> int:
        """q, the number of rows."""
        return len(self._values.strain)

    @property
    def _size(self) -> int:
        """m, the number of components of a strain."""
        return self._values.strain.shape[1]

    def _number_values(self) -> None:
        """Number the values in a cell of all functions on which the law depends, strains first.
        The kernel copies these values into one array, from which each C function takes its
        arguments."""
        law = self._functions
        everything = [*law.responses, law.density]
        if law.sort is not None:
            everything.append(law.sort)
        functions = [law.start, law.strain]
        for one in everything:
            functions += one.coefficients
        width = self._values.rows.shape[1] * self._size
        # Indices of the values of each function in the array of one cell; for all but the strains,
        # which fill its first 2 `width` numbers, also their columns in `_others`.
        self._indices: dict[fem.Function, Indices] = {}
        self._other_columns: list[tuple[fem.Function, slice]] = []
        start = 0
        # A dictionary in place of a set, which has no order
        for function in dict.fromkeys(functions):
            end = start + _values_in_cell(function)
            self._indices[function] = np.arange(start, end, dtype=np.int32)
            # The kernel copies the strains itself.
            if function is not law.start and function is not law.strain:
                columns = slice(start - 2 * width, end - 2 * width)
                self._other_columns.append((function, columns))
            elif end - start != width:
                raise ValueError(f"A cell has {width} strains, not {end - start}.")
            start = end
        self._pool_size = start
        self._others = np.zeros((len(self._cells), start - 2 * width))

    def _entry(self, function: CellFunction) -> dict[str, Any]:
        """Members of the C struct `cell_function` of law.h, by name: address, constants, and the
        indices (int32) of the arguments among all values of a cell.  The arrays are kept alive by
        this object."""
        indices: list[Indices] = [np.zeros(0, dtype=np.int32)]
        indices += [self._indices[coefficient] for coefficient in function.coefficients]
        arguments = np.concatenate(indices)
        check_indices("The numbers of a cell", arguments, self._pool_size)
        constants = np.zeros(sum(value.size for value in function.constants))
        self._constants.append((constants, list(function.constants)))
        self._kept += [function.owner, arguments]
        self._most_arguments = max(self._most_arguments, len(arguments))
        return {
            "function": function.address,
            "constants": self._c.array("constants", constants, "float64", constants.shape),
            "argument_count": len(arguments),
            "arguments": self._c.array("arguments", arguments, "int32", arguments.shape),
        }

    def _members(self) -> dict[str, Any]:
        """Members of the C struct `point_law` of law.h, by name: sizes, functions, arrays and work
        space.  The arrays must stay at their addresses as long as the kernel is used."""
        ffi = self._c.ffi
        values = self._values
        law = self._functions
        cells, points = values.rows.shape
        m = self._size
        check_indices("The rows of the points", values.rows, self._count)
        if len(self._cells) != cells:
            raise ValueError(f"There are rows for {cells} cells, not for {len(self._cells)}.")
        corners = self._functions.strain.function_space.mesh.geometry
        x = np.ascontiguousarray(corners.x[corners.dofmap[self._cells]])
        geometry_size = int(np.prod(x.shape[1:]))
        entries = [self._entry(response) for response in law.responses]
        sort = ffi.NULL
        if law.sort is not None:
            sort = ffi.new("cell_function *", self._entry(law.sort))
        return {
            "cell_count": cells,
            "point_count": points,
            "strain_size": m,
            "other_count": self._others.shape[1],
            "geometry_size": geometry_size,
            "responses": ffi.new("cell_function[]", entries),
            "sort": sort,
            "rows": self._c.array("rows", values.rows, "int32", (cells, points)),
            "geometry": self._constant(
                "geometry", x.reshape(cells, geometry_size), (cells, geometry_size)
            ),
            "others": self._constant("others", self._others, self._others.shape),
            "start": self._constant("start", values.start, (self._count, m)),
            "strain": self._written("strain", values.strain, (self._count, m)),
            "response": self._written("response", values.response, (self._count, m + m * m)),
            "pool": self._work(self._pool_size),
            "arguments": self._work(self._most_arguments),
            "cell_values": self._work(points * (m + m * m)),
        }

    def _choice_members(self) -> dict[str, Any]:
        """Members of the C struct `strain_choice` of law.h, by name: limits, linearised strains (q,
        m), the error of the last choice (q,) and how many choices did not reduce it (q,)."""
        m = self._size
        points = self._values.rows.shape[1]
        self._last_error = np.full(self._count, np.inf)
        self._fruitless = np.zeros(self._count, dtype=np.int32)
        self._linear_strain = np.zeros((self._count, m))
        fruitless = self._c.array(
            "fruitless", self._fruitless, "int32", (self._count,), writable=True
        )
        return {
            "linear_strain": self._constant("linear_strain", self._linear_strain, (self._count, m)),
            "last_error": self._written("last_error", self._last_error, (self._count,)),
            "fruitless": fruitless,
            "stiffness_ratio": STRAIN_CHOICE_STIFFNESS,
            "trigger": STRAIN_CHOICE_TRIGGER,
            "fruitful_ratio": FRUITFUL_ERROR_RATIO,
            "max_fruitless": MAX_FRUITLESS_CHOICES,
            "forecast": self._work(points * (m + 2)),
            "equations": self._work(m * (m + 1)),
        }

    def _constant(self, name: str, values: npt.NDArray[Any], shape: tuple[int, ...]) -> Any:
        """An array that the kernel reads."""
        return self._c.array(name, values, "float64", shape)

    def _written(self, name: str, values: Array, shape: tuple[int, ...]) -> Any:
        """An array into which the kernel writes."""
        return self._c.array(name, values, "float64", shape, writable=True)

    def _work(self, count: int) -> Any:
        """Work space of `count` numbers for the kernel."""
        return self._written("work", np.zeros(count), (count,))


def _values_in_cell(f: fem.Function) -> int:
    """How many values of a function a compiled expression takes in one cell."""
    dofmap = f.function_space.dofmap
    return dofmap.list.shape[1] * dofmap.index_map_bs


def _in_cells(f: fem.Function, cells: Indices) -> npt.NDArray[np.float64]:
    """Values (cells, k) of a function in local cells, as a compiled expression takes them."""
    dofmap = f.function_space.dofmap
    values = f.x.array.reshape(-1, dofmap.index_map_bs)[dofmap.list[cells]]
    return values.reshape(len(cells), _values_in_cell(f))
