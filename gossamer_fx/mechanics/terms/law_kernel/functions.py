"""Functions of a law in the cells of a mesh, compiled: mean stress and its derivatives, and energy
density.

A law depends on the strains at the start and at the end of a step, on constants, and on functions
such as a thickness that differs from cell to cell.  FFCx compiles its UFL expressions into C
functions; the law kernel calls these by their addresses.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import basix.ufl
import numpy as np
import ufl
from dolfinx import fem
from ufl.algorithms.analysis import extract_coefficients, extract_constants

from gossamer_fx.core.forms.backend import interpolation_points, tabulate
from gossamer_fx.core.forms.compilation import compile_expression
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.forms.strain_path import with_derivative
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.materials.c_law import CLaw
from gossamer_fx.mechanics.terms.discrete_gradient import PathEnergy, StressRule
from gossamer_fx.mechanics.terms.law_kernel.library import library


@dataclass(frozen=True, eq=False)
class CellFunction:
    """A compiled C function of the values in one cell, with the signature of FFCx's expressions.

    Attributes:
        address: of the function.
        coefficients: the functions whose values in the cell are its arguments, in their order.
        constants: views of the values of its constants, in their order.
        owner: what has to exist as long as the function is called.
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
    """The C function of a compiled UFL expression, with the functions and constants on which it
    depends.

    Args:
        expression: made by `compile_expression`, of float values.

    Returns:
        Address of the function, the dolfinx functions whose values in a cell are its arguments, and
        views of its constants.  The object keeps the expression alive.
    """
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
        address=int(library().ffi.cast("uintptr_t", compiled.tabulate_tensor_float64)),
        coefficients=tuple(coefficients[position] for position in positions),
        constants=tuple(np.ravel(c._cpp_object.value) for c in constants),
        owner=expression,
    )


def law_functions(
    energy: PathEnergy,
    rule: StressRule,
    start: fem.Function,
    strain: fem.Function,
) -> LawFunctions:
    """Compile the C functions of a stored energy for a stress rule.  Collective.

    Args:
        energy: density as a function of the strain, and the pieces of a strain path on which it is
            smooth.
        rule: how the stress of a step follows from the strains at its ends.
        start, strain: strains (m,), dimensionless, at the start of the step and of the iterate, as
            functions at the quadrature points.

    Returns:
        Functions for the mean stress (m,) with its derivatives (m, m), for the density (per area
        [N/m], per length [N]), and for the choice of the cheapest of several expressions of the
        stress.

    Raises:
        InputError: the rule has no function for laws that are written in C.
    """
    # Rank 0 compiles the kernel here, where all ranks are.
    library(strain.function_space.mesh.comm)
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
    """The functions of a law that is written in C; they take its numbers at the quadrature points.

    Args:
        start, strain: strains (m,), dimensionless, at the start of the step and of the iterate, as
            functions at the quadrature points.

    Raises:
        InputError: the rule has no function for laws that are written in C.
    """
    space = strain.function_space
    mesh = space.mesh
    points = interpolation_points(space)
    element = basix.ufl.quadrature_element(
        mesh.basix_cell(), value_shape=c_law.numbers.ufl_shape, degree=space.ufl_element().degree
    )
    numbers = fem.Function(fem.functionspace(mesh, element))
    expression = compile_expression(c_law.numbers, points)
    index_map = mesh.topology.index_map(mesh.topology.dim)
    cells = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
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
        refresh=lambda: tabulate(expression, numbers, cells),
    )


def first_that_holds(cases: Sequence[tuple[Expr, Expr]]) -> Expr:
    """The number, from one, of the first case whose condition holds, or zero."""
    # Built from the last case inwards, so that the first one is asked first.
    which: Expr = ufl.as_ufl(0.0)
    for k, (holds, _) in reversed(list(enumerate(cases, 1))):
        which = ufl.conditional(holds, float(k), which)
    return which
