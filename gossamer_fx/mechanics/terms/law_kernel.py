"""A law with several states at the quadrature points of a rank: responses, and the choice of
strains.

Films that wrinkle have several states.  Full elements (`terms.element_energies`) and sampled ones
(`reduction.points`) both evaluate them here, so that they have the same iterations.  The loops over
points are those of `law.c`.

A law depends on the strains at the start and at the end of a step, on constants, and on functions
such as a thickness that differs from cell to cell.  FFCx compiles its UFL expressions into C
functions; the law kernel calls these by their addresses, as `forms.cell_loops` does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import basix.ufl
import numpy as np
import ufl
from dolfinx import fem

from gossamer_fx.core.forms.backend import interpolation_points
from gossamer_fx.core.forms.c_source import c_library
from gossamer_fx.core.forms.cell_loops import (
    CellFunction,
    Cells,
    CellValues,
    PreparedFunction,
    cell_function,
    tabulation,
)
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.forms.strain_path import with_derivative
from gossamer_fx.core.model.body import Array, Indices
from gossamer_fx.mechanics.materials.film import CLaw
from gossamer_fx.mechanics.terms.discrete_gradient import PathEnergy, StressRule

# Its functions are declared in this header.
HEADER = Path(__file__).parent / "law.h"


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
    refresh: Callable[[], object]


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
        return cell_function(expression, points)

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
    # C functions of this signature take numbers only, as floats.
    count = np.array([len(points)], dtype=float)
    arguments = (start._cpp_object, strain._cpp_object, numbers._cpp_object)

    def function(address: int) -> CellFunction:
        return CellFunction(address, arguments, [count], owner=c_law.owner)

    return LawFunctions(
        start=start,
        strain=strain,
        responses=(function(rule.function_of(c_law)),),
        sort=None,
        density=function(c_law.density),
        refresh=tabulation(c_law.numbers, numbers),
    )


def first_that_holds(cases: Sequence[tuple[Expr, Expr]]) -> Expr:
    """The number, from one, of the first case whose condition holds, or zero."""
    # Built from the last case inwards, so that the first one is asked first.
    which: Expr = ufl.as_ufl(0.0)
    for k, (holds, _) in reversed(list(enumerate(cases, 1))):
        which = ufl.conditional(holds, float(k), which)
    return which


# ---- several states at the quadrature points -----------------------------------------------------

# Whether the choice and the first guess of strains pay depends on the scene and on its steps.
# Iterations a step, with both, without both, and with a choice only after residuals that fell to no
# less than a third:
#
#     folded tube, 582 unknowns, steps of 30 µs    8.1    6.7    6.6
#     the same, steps of 80 µs                    11.7   13.4   12.7
#     free sheet, 16 cells                         7.1    9.6    7.8, with the first guess
#     spin deployment, 1674 unknowns               6.8    8.2    6.8, with the first guess

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
        """Prepare what the C kernel reads; no law is evaluated yet.
        Collective."""
        if len(cells) != len(values.rows):
            raise ValueError(f"There are rows for {len(values.rows)} cells, not for {len(cells)}.")
        self._functions = functions
        self._values = values
        self._may_choose = may_choose
        self._cells = Cells(functions.strain.function_space.mesh, cells, HEADER)
        self._c = self._cells.library
        # The strains of the points in place of those of the functions in UFL.
        self._strain = CellValues(values.strain, values.rows)
        self._in_place_of = {
            functions.start._cpp_object: CellValues(values.start, values.rows),
            functions.strain._cpp_object: self._strain,
        }
        # The responses, then what sorts the points, if there is anything.
        self._evaluated = [self._prepared(response) for response in functions.responses]
        if functions.sort is not None:
            self._evaluated.append(self._prepared(functions.sort))
        self._kernel = self._c.struct("point_law", self._members())
        self._choice = self._c.struct("strain_choice", self._choice_members())
        self.begin_step()

    # ---- a step ----------------------------------------------------------------------------------

    def begin_step(self) -> None:
        """Start a step: forget the choices of strains."""
        self._functions.refresh()
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
            found = self._c.lib.choose_strains(self._kernel.pointer, self._choice.pointer)
            # After some choices that changed little, strains stay linear for the rest of the step.
            self._chooses = self._iteration <= MAX_FRUITLESS_CHOICES or bool(found)
        self._iteration += 1

    def respond(self) -> None:
        """Evaluate the responses at the strains of the iterate."""
        self._c.lib.evaluate_responses(self._kernel.pointer)

    def density_in(self, values: Array) -> Callable[[], object]:
        """Return what sets `values` (q,) to the energy density at the strains of the start of the
        step."""
        to = CellValues(values.reshape(-1, 1), self._values.rows)
        density = self._prepared(self._functions.density)
        return density.applied("set_in_cells", to.struct(self._c), to.width)

    # ---- what the kernel reads -------------------------------------------------------------------

    def _prepared(self, function: CellFunction) -> PreparedFunction:
        """A function of the law at the points."""
        return PreparedFunction(function, self._cells, self._in_place_of)

    def _members(self) -> dict[str, Any]:
        """Members of the C struct `point_law` of law.h, by name."""
        ffi = self._c.ffi
        response = CellValues(self._values.response, self._values.rows)
        functions = ffi.new("cell_function[]", [one.fields for one in self._evaluated])
        sort = ffi.NULL if self._functions.sort is None else functions + len(functions) - 1
        return {
            "cells": self._cells.fields,
            "point_count": self._values.rows.shape[1],
            "strain_size": self._values.strain.shape[1],
            "responses": functions,
            "function_count": len(functions),
            "sort": sort,
            "strain": self._strain.fields(self._c),
            "response": response.fields(self._c),
            "work": self._cells.work(response.width),
        }

    def _choice_members(self) -> dict[str, Any]:
        """Members of the C struct `strain_choice` of law.h, by name: limits, linearised strains (q,
        m), the error of the last choice (q,) and how many choices did not reduce it (q,)."""
        count, m = self._values.strain.shape
        points = self._values.rows.shape[1]
        self._last_error = np.full(count, np.inf)
        self._fruitless = np.zeros(count, dtype=np.int32)
        self._linear_strain = np.zeros((count, m))
        array = self._c.array
        return {
            "linear_strain": array("linear_strain", self._linear_strain, "float64", (count, m)),
            "last_error": array("last_error", self._last_error, "float64", (count,), writable=True),
            "fruitless": array("fruitless", self._fruitless, "int32", (count,), writable=True),
            "stiffness_ratio": STRAIN_CHOICE_STIFFNESS,
            "trigger": STRAIN_CHOICE_TRIGGER,
            "fruitful_ratio": FRUITFUL_ERROR_RATIO,
            "max_fruitless": MAX_FRUITLESS_CHOICES,
            "forecast": self._cells.work(points * (m + 2)),
            "equations": self._cells.work(m * (m + 1)),
        }
