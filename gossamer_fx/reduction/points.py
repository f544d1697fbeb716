"""The quadrature points of a reduced film: their strains, stresses, forces and stiffness, by one compiled kernel.

The law's expressions are those that dolfinx would evaluate; the kernel of `points.c` calls the same compiled functions
itself, and holds all else of an iteration that happens at a point.
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

TRUE, LINEAR, GIVEN = 0, 1, 2  # ways to set strains
RESPONSE = 12  # numbers of a stress and its derivative


class Law:
    """Compiled expressions of a law as the kernel calls them, with the numbers of one cell.

    Args:
        strains: the functions e0, ê at the points, of which the expressions are made.
        expressions: of S̄ and D̄ (points, 12); the first serves all points.
        sort: which of them is the cheapest that serves a point, if there are several.
        energy: of the density ψ(e0) (points, 1).
        cells: this rank's.
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
        everything = [*expressions, energy, *([] if sort is None else [sort])]
        found = dict.fromkeys(
            [*strains, *(f for e in everything for f in extract_coefficients(e.ufl_expression))]
        )
        values = [_in_cells(f, cells) for f in found]
        ends = np.cumsum([v.shape[1] for v in values])
        self._places = {
            f: np.arange(ends[k] - v.shape[1], ends[k])
            for k, (f, v) in enumerate(zip(found, values, strict=True))
        }
        self.others = np.ascontiguousarray(np.hstack(values)[:, ends[len(strains) - 1] :])
        self.pool_size = int(ends[-1])  # numbers of a cell that expressions may take
        self.most_arguments = 0  # that one of them takes
        self._constants: list[
            tuple[Array, list[Array]]
        ] = []  # what the kernel reads, and views of the values
        self._kept: list[Any] = []  # what the kernel points at
        self.expressions = ffi.new("expression[]", [self._entry(e) for e in expressions])
        self.energy = ffi.new("expression *", self._entry(energy))
        self.sort = ffi.NULL if sort is None else ffi.new("expression *", self._entry(sort))
        self.read_constants()

    def _entry(self, expression: fem.Expression) -> dict[str, Any]:
        compiled, ufl_expression = expression.ufcx_expression, expression.ufl_expression
        kernel, coefficients = library(), extract_coefficients(ufl_expression)
        used = [
            coefficients[compiled.original_coefficient_positions[k]]
            for k in range(compiled.num_coefficients)
        ]
        places = np.concatenate([np.zeros(0), *[self._places[f] for f in used]]).astype(np.int32)
        constants = [np.ravel(c._cpp_object.value) for c in extract_constants(ufl_expression)]
        numbers = np.zeros(sum(c.size for c in constants))
        self._constants.append((numbers, constants))
        check_indices("The numbers of a cell", places, self.pool_size)
        self.most_arguments = max(self.most_arguments, len(places))
        self._kept += [expression, places]
        return {
            "function": int(kernel.ffi.cast("uintptr_t", compiled.tabulate_tensor_float64)),
            "constants": kernel.array("constants", numbers, "float64", numbers.shape),
            "n": len(places),
            "from": kernel.array("from", places, "int32", places.shape),
        }

    def read_constants(self) -> None:
        """Take the present values of the law's constants."""
        for numbers, constants in self._constants:
            if constants:
                np.concatenate(constants, out=numbers)


class Points:
    """The points of a rank's own cells, p in each, q in all.

    Args:
        dA: (cells, p) reference areas [m²], weights of cells included.
        G: gradients of the modes (q, 2, r).

    Attributes:
        past, start, strain: at the starts of the last step and of this one, and of the iteration (q, 3).
        response: S̄ [N/m] and D̄ of the last two (q, 12).
    """

    def __init__(self, law: Law, x: Array, dA: Array, G: Array) -> None:
        self._c, self._law = library(), law
        (n, p), (q, _, self._r) = dA.shape, G.shape
        self.past, self.start, self.strain = (np.zeros((q, 3)) for _ in range(3))
        self.response = np.zeros((q, RESPONSE))
        self._missed, self._idle = np.full(q, np.inf), np.zeros(q, dtype=np.int32)
        self._G = np.ascontiguousarray(G).reshape(2 * q, self._r)
        self._x, self._dA = np.ascontiguousarray(x), np.ascontiguousarray(dA)
        geometry = int(np.prod(x.shape[1:]))
        others = law.others.shape[1]
        if law.pool_size != 6 * p + others:
            raise ValueError(
                f"A cell with {p} points has {6 * p} strains, not {law.pool_size - others}."
            )
        constant: dict[str, tuple[npt.NDArray[Any], tuple[int, ...]]] = {
            "x": (self._x.reshape(n, geometry), (n, geometry)),
            "other": (law.others, (n, others)),
            "dA": (self._dA, (n, p)),
        }
        written: dict[str, tuple[npt.NDArray[Any], tuple[int, ...]]] = {
            "start": (self.start, (n * p, 3)),
            "strain": (self.strain, (n * p, 3)),
            "response": (self.response, (n * p, RESPONSE)),
            "missed": (self._missed, (n * p,)),
            "pool": (np.zeros(law.pool_size), (law.pool_size,)),
            "arguments": (np.zeros(law.most_arguments), (law.most_arguments,)),
            "of_points": (np.zeros(6 * p), (6 * p,)),
        }
        fields: dict[str, Any] = {"cells": n, "points": p, "others": others, "geometry": geometry}
        fields |= {"sort": law.sort, "law": law.expressions, "energy": law.energy}
        for name, (values, shape) in constant.items():
            fields[name] = self._c.array(name, values, "float64", shape)
        for name, (values, shape) in written.items():
            fields[name] = self._c.array(name, values, "float64", shape, writable=True)
        fields["idle"] = self._c.array("idle", self._idle, "int32", (n * p,), writable=True)
        self._struct = self._c.struct("film", fields)
        self._film = self._struct.pointer
        self._F0: Array = np.zeros((2 * q, 3))
        self._F: Array = np.zeros((2 * q, 3))
        self._N, self._TG = np.zeros((2 * q, 3)), np.zeros((2 * q, 9 * self._r))

    def move(self, c: Array) -> None:
        """Coefficients (r, 3) at the end of the step."""
        self._F = self._G @ c

    def begin(self) -> None:
        """Start a step: of its stress nothing is known yet."""
        self._law.read_constants()
        self._missed[:], self._idle[:] = np.inf, 0

    def keep(self) -> None:
        """End a step: what is at its end is at the start of the next one."""
        self.past[:] = self.start
        self.start[:], self._F0 = self.strain, self._F

    def set_strains(self, way: int, change: Array | None = None) -> None:
        """Strains that are true, linear from the last iterate, whose coefficients have changed since, or given."""
        dF = None if change is None else self._G @ change
        self._c.lib.set_strains(self._film, self._images(self._F), self._images(dF), way)

    def choose_strains(self, change: Array) -> bool:
        """Strains between the linear ones and those with linear stresses; whether these were far from each other."""
        return bool(
            self._c.lib.choose_strains(
                self._film,
                self._images(self._F),
                self._images(self._G @ change),
                STRAIN_CHOICE_STIFFNESS,
                STRAIN_CHOICE_TRIGGER,
                FRUITFUL_ERROR_RATIO,
                MAX_FRUITLESS_CHOICES,
            )
        )

    def energy(self) -> float:
        """Stored energy [J] at the start of the step."""
        return float(self._c.lib.energy(self._film))

    def forces(self, α: float) -> Array:
        """Forces (r, 3) on the coefficients."""
        N = self._c.array("N", self._N, "float64", self._N.shape, writable=True)
        self._c.lib.forces(self._film, self._images(self._F0), self._images(self._F), α, N)
        f: Array = self._G.T @ self._N
        return f

    def stiffness(self, α: float, share: float) -> Array:
        """Their derivatives (3r, 3r), with a `share` of the stress in them."""
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
    """Values (cells, numbers) that a compiled expression takes of a function."""
    dofmap = f.function_space.dofmap
    found = f.x.array.reshape(-1, dofmap.index_map_bs)[dofmap.list[cells]]
    return found.reshape(len(cells), dofmap.list.shape[1] * dofmap.index_map_bs)
