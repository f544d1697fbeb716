"""The quadrature points of a reduced film: strains, stresses, forces and stiffness, by a compiled kernel.

Problem.  A reduced film has some hundred to some thousand quadrature points.  Evaluating a law there
by dolfinx or NumPy costs more in calls than in arithmetic.

Idea.  The kernel of `points.c` calls the compiled functions of the law's expressions itself, the same
that dolfinx would call, and does everything else that an iteration does at a point: the choice of
strains, forces N and products T G (see `reduced_energies`).  Python multiplies with the gradients of
the modes, before and after, as full matrices.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from ufl.algorithms.analysis import extract_coefficients, extract_constants

from gossamer_fx.forms.c_source import check_indices
from gossamer_fx.model.body import Array, Indices
from gossamer_fx.reduction.kernel import library
from gossamer_fx.terms.element_energies import (
    FRUITFUL_ERROR_RATIO,
    MAX_FRUITLESS_CHOICES,
    STRAIN_CHOICE_STIFFNESS,
    STRAIN_CHOICE_TRIGGER,
)

# How `Points.set_strains` sets strains: from the gradients, linearly from the last iterate, or not at
# all.  points.c has the same numbers.
TRUE = 0
LINEAR = 1
GIVEN = 2

# Numbers of a stress (3) and its derivatives (9)
RESPONSE = 12


class Law:
    """Compiled expressions of a law as the kernel calls them, with the values of one cell.

    Args:
        strains: the functions e0 and ê at the points, of which the expressions are made.
        expressions: of the mean stress S̄ and its derivatives D̄ (points, 12); the first serves all
            points, the others are cheaper and serve some.
        sort: expression of which of them serves a point; None if there is one only.
        energy: expression of the density ψ(e0) (points, 1) [J/m²].
        cells: this rank's own cells.

    Attributes:
        others: values (cells, k) of all other functions in the expressions, e.g. a thickness.
        pool_size: number of values of a cell that expressions may take, strains included.
        most_arguments: largest number of values that one expression takes.
    """

    def __init__(
        self,
        strains: Sequence[fem.Function],
        expressions: Sequence[fem.Expression],
        sort: fem.Expression | None,
        energy: fem.Expression,
        cells: Indices,
    ) -> None:
        ffi = library(strains[0].function_space.mesh.comm).ffi
        everything = [*expressions, energy]
        if sort is not None:
            everything.append(sort)
        self.others = self._number_values(strains, everything, cells)
        self.most_arguments = 0
        # For each expression the constants as the kernel reads them, and views of their values
        self._constants: list[tuple[Array, list[Array]]] = []
        # Objects at which the kernel points: Python must not free them.
        self._kept: list[Any] = []
        self.expressions = ffi.new("expression[]", [self._entry(e) for e in expressions])
        self.energy = ffi.new("expression *", self._entry(energy))
        self.sort = ffi.NULL
        if sort is not None:
            self.sort = ffi.new("expression *", self._entry(sort))
        self.read_constants()

    def _number_values(
        self,
        strains: Sequence[fem.Function],
        expressions: Sequence[fem.Expression],
        cells: Indices,
    ) -> Array:
        """Number the values of all functions of the expressions in one array; strains come first.

        Returns:
            The values (cells, k) of the functions that are not strains.
        """
        functions = list(strains)
        for expression in expressions:
            functions += extract_coefficients(expression.ufl_expression)
        self._numbers: dict[fem.Function, Indices] = {}
        others: list[Array] = [np.zeros((len(cells), 0))]
        start = 0
        # A dictionary in place of a set, which has no order
        for function in dict.fromkeys(functions):
            values = _in_cells(function, cells)
            end = start + values.shape[1]
            self._numbers[function] = np.arange(start, end, dtype=np.int32)
            start = end
            # The kernel writes the strains itself.
            if all(function is not strain for strain in strains):
                others.append(values)
        self.pool_size = start
        return np.ascontiguousarray(np.hstack(others))

    def _entry(self, expression: fem.Expression) -> dict[str, Any]:
        """An `expression` of points.c: function, constants, and the numbers of the values it takes."""
        kernel = library()
        compiled = expression.ufcx_expression
        ufl_expression = expression.ufl_expression
        coefficients = extract_coefficients(ufl_expression)
        # The compiler drops functions that the expression does not need.
        numbers: list[Indices] = [np.zeros(0, dtype=np.int32)]
        for k in range(compiled.num_coefficients):
            function = coefficients[compiled.original_coefficient_positions[k]]
            numbers.append(self._numbers[function])
        taken = np.concatenate(numbers)
        values = [np.ravel(c._cpp_object.value) for c in extract_constants(ufl_expression)]
        constants = np.zeros(sum(value.size for value in values))
        self._constants.append((constants, values))
        check_indices("The numbers of a cell", taken, self.pool_size)
        self.most_arguments = max(self.most_arguments, len(taken))
        self._kept += [expression, taken]
        return {
            "function": int(kernel.ffi.cast("uintptr_t", compiled.tabulate_tensor_float64)),
            "constants": kernel.array("constants", constants, "float64", constants.shape),
            "n": len(taken),
            "from": kernel.array("from", taken, "int32", taken.shape),
        }

    def read_constants(self) -> None:
        """Read the current values of the law's constants, which users may change between steps."""
        for constants, values in self._constants:
            if values:
                np.concatenate(values, out=constants)


class Points:
    """The quadrature points of a rank's own cells: p in each cell, q in all.

    Args:
        law: compiled expressions.
        x: coordinates (cells, corners, 3) [m] of the cells' corners.
        dA: reference areas (cells, p) [m²], times the weights of sampled cells.
        G: gradients of the modes (q, 2, r) [1/m].

    Attributes:
        past: strains (q, 3) at the start of the last step.
        start: strains (q, 3) at the start of this step.
        strain: strains (q, 3) of the iterate.
        response: mean stress S̄ [N/m] and its derivatives D̄ at start and strain (q, 12).
    """

    def __init__(self, law: Law, x: Array, dA: Array, G: Array) -> None:
        self._c = library()
        self._law = law
        cells, points = dA.shape
        q, _, self._r = G.shape
        self.past = np.zeros((q, 3))
        self.start = np.zeros((q, 3))
        self.strain = np.zeros((q, 3))
        self.response = np.zeros((q, RESPONSE))
        # Per point: the last error of a choice of strains, and how many choices changed little
        self._error = np.full(q, np.inf)
        self._fruitless = np.zeros(q, dtype=np.int32)
        self._G = np.ascontiguousarray(G).reshape(2 * q, self._r)
        self._x = np.ascontiguousarray(x)
        self._dA = np.ascontiguousarray(dA)
        # Gradients at the start and at the end of the step; forces N and products T G (module
        # `reduced_energies`)
        self._F0: Array = np.zeros((2 * q, 3))
        self._F: Array = np.zeros((2 * q, 3))
        self._N = np.zeros((2 * q, 3))
        self._TG = np.zeros((2 * q, 9 * self._r))
        self._struct = self._c.struct("film", self._members(cells, points))
        self._film = self._struct.pointer

    def _members(self, cells: int, points: int) -> dict[str, Any]:
        """Members of the struct `film` of points.h; it points at arrays that stay where they are."""
        law = self._law
        q = cells * points
        others = law.others.shape[1]
        geometry = int(np.prod(self._x.shape[1:]))
        # Two strains of three components at each point
        strains = 6 * points
        if law.pool_size != strains + others:
            raise ValueError(
                f"A cell with {points} points has {strains} strains, not {law.pool_size - others}."
            )
        constant: dict[str, tuple[npt.NDArray[Any], tuple[int, ...]]] = {
            "x": (self._x.reshape(cells, geometry), (cells, geometry)),
            "other": (law.others, (cells, others)),
            "dA": (self._dA, (cells, points)),
        }
        # The last three are work space of the kernel.
        written: dict[str, tuple[npt.NDArray[Any], tuple[int, ...]]] = {
            "start": (self.start, (q, 3)),
            "strain": (self.strain, (q, 3)),
            "response": (self.response, (q, RESPONSE)),
            "missed": (self._error, (q,)),
            "pool": (np.zeros(law.pool_size), (law.pool_size,)),
            "arguments": (np.zeros(law.most_arguments), (law.most_arguments,)),
            "of_points": (np.zeros(strains), (strains,)),
        }
        members: dict[str, Any] = {
            "cells": cells,
            "points": points,
            "others": others,
            "geometry": geometry,
            "sort": law.sort,
            "law": law.expressions,
            "energy": law.energy,
            "idle": self._c.array("idle", self._fruitless, "int32", (q,), writable=True),
        }
        for name, (values, shape) in constant.items():
            members[name] = self._c.array(name, values, "float64", shape)
        for name, (values, shape) in written.items():
            members[name] = self._c.array(name, values, "float64", shape, writable=True)
        return members

    def move(self, c: Array) -> None:
        """Set the coefficients (r, 3) [m] at the end of the step."""
        self._F = self._G @ c

    def begin(self) -> None:
        """Start a step: nothing is known of its stress yet."""
        self._law.read_constants()
        self._error[:] = np.inf
        self._fruitless[:] = 0

    def keep(self) -> None:
        """Accept a step: its end is the start of the next one."""
        # The kernel has the addresses of `start`: it is written to, not replaced.
        self.past[:] = self.start
        self.start[:] = self.strain
        self._F0 = self._F

    def set_strains(self, way: int, change: Array | None = None) -> None:
        """Set the strains of the iterate, and the response at them.

        Args:
            way: TRUE, from the gradients; LINEAR, from the last iterate by `change`; or GIVEN, as
                `strain` has them.
            change: coefficients (r, 3) [m] of the change since the last iterate, for LINEAR.
        """
        dF = None
        if change is not None:
            dF = self._G @ change
        self._c.lib.set_strains(self._film, self._images(self._F), self._images(dF), way)

    def choose_strains(self, change: Array) -> bool:
        """Set strains between the linear ones and those with linear stresses; see `element_energies`.

        Args:
            change: coefficients (r, 3) [m] of the change since the last iterate.

        Returns:
            Whether the two strains were far from each other at some point.
        """
        far = self._c.lib.choose_strains(
            self._film,
            self._images(self._F),
            self._images(self._G @ change),
            STRAIN_CHOICE_STIFFNESS,
            STRAIN_CHOICE_TRIGGER,
            FRUITFUL_ERROR_RATIO,
            MAX_FRUITLESS_CHOICES,
        )
        return bool(far)

    def energy(self) -> float:
        """Stored energy [J] of this rank's cells at the start of the step."""
        return float(self._c.lib.energy(self._film))

    def forces(self, α: float) -> Array:
        """Forces (r, 3) [N] on the coefficients, at the weight α of the rule."""
        N = self._c.array("N", self._N, "float64", self._N.shape, writable=True)
        self._c.lib.forces(self._film, self._images(self._F0), self._images(self._F), α, N)
        f: Array = self._G.T @ self._N
        return f

    def stiffness(self, α: float, share: float) -> Array:
        """Derivatives (3r, 3r) [N/m] of the forces by the coefficients.

        Args:
            α: weight of the rule.
            share: of the stress in them, 0 to α.
        """
        r = self._r
        self._c.lib.stiffness_times(
            self._film,
            self._images(self._F0),
            self._images(self._F),
            α,
            share,
            r,
            self._c.array("G", self._G, "float64", self._G.shape),
            self._c.array("TG", self._TG, "float64", self._TG.shape, writable=True),
        )
        K: Array = (self._G.T @ self._TG).reshape(r, 3, 3, r)
        return K.swapaxes(2, 3).reshape(3 * r, 3 * r)

    def _images(self, F: Array | None) -> Any:
        """Images of the frame (2q, 3) as an argument of a C function; None is a null pointer."""
        return self._c.array("F", F, "float64", self._N.shape)


def _in_cells(f: fem.Function, cells: Indices) -> Array:
    """Values (cells, k) of a function as a compiled expression takes them."""
    dofmap = f.function_space.dofmap
    size = dofmap.index_map_bs
    values = f.x.array.reshape(-1, size)[dofmap.list[cells]]
    return values.reshape(len(cells), dofmap.list.shape[1] * size)
