"""The mass and energy balance of a network in C, where gases and openings allow it.

That is the most frequent network: the scene has one gas of constant specific heats, and all
openings obey `isentropic_flow`.  The equations are those of `gas.balance`, whose class takes over
for all other networks, e.g. with mixtures, walls or laws of the user.  Derivatives are written out
where `gas.balance` takes complex steps; the flows of the accepted state, once a step, stay there.

Why: of an iteration of the folded tube, with 582 unknowns, the twelve equations of its balance took
a quarter of the time, in hundreds of calls of Python.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.forms.c_source import c_library, check_indices
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.gas.balance import (
    ACCEPTABLE_RESIDUAL,
    MAX_HALVINGS,
    MAX_ITERATIONS,
    MIN_REMAINING_SHARE,
    RESIDUAL_TOLERANCE,
    ROUND_OFF_SHARE,
    Balance,
    HeatPath,
    Passage,
    Rates,
)
from gossamer_fx.mechanics.gas.mixture import Contents

HEADER = Path(__file__).parent / "kernels" / "balance.h"


def compile_balance(
    contents: Contents, passages: list[Passage], walls: list[HeatPath], comm: MPI.Intracomm
) -> Balance:
    """The balance of a network in time steps: in C if it can be.  Collective."""
    laminar = []
    for passage in passages:
        opening = passage.opening
        found = opening.isentropic_range
        if found is not None:
            laminar.append(found)
    has_one_law = len(laminar) == len(passages) and not walls
    if not (has_one_law and contents.is_simple):
        return Balance(contents, passages, walls)
    c_library(HEADER, comm)
    return CompiledBalance(contents, passages, laminar)


class CompiledBalance(Balance):
    """A `Balance` of n chambers and m isentropic openings with the given laminar ranges (m,)."""

    def __init__(
        self, contents: Contents, passages: list[Passage], laminar: Sequence[float]
    ) -> None:
        super().__init__(contents, passages, walls=[])
        n = contents.n
        m = len(passages)
        self._c = c_library(HEADER)
        ends = np.full((m, 2), -1, dtype=np.int32)
        for row, passage in zip(ends, passages, strict=True):
            for side, end in enumerate(passage.ends):
                if isinstance(end, int):
                    row[side] = end
        check_indices("The chambers of openings", ends[ends >= 0], n)
        # Of the present step, see the header
        self._length: Array = np.zeros(1)
        self._areas: Array = np.zeros(m)
        self._boundary: Array = np.zeros((m, 2, 2))
        self._start: Array = np.zeros((6, n))
        # What functions take and set: y, V and W; the sizes of the terms of volumes [m³]
        self._y: Array = np.zeros(2 * n)
        self._volumes: Array = np.zeros((2, n))
        self._magnitude: Array = np.zeros(n)
        self._result: Array = np.zeros(2 * n)
        self._by_y: Array = np.zeros((2 * n, 2 * n))
        self._by_V: Array = np.zeros((2 * n, n))
        (gas,) = contents.species
        self._network = self._c.struct(
            "gas_network",
            {
                "chamber_count": n,
                "opening_count": m,
                "R": gas.R,
                "gamma": gas.constant_heat_ratio,
                "ends": self._c.array("ends", ends, "int32", (m, 2)),
                "laminar": self._pointer("laminar", np.array(laminar, dtype=float)),
                "h": self._pointer("h", self._length),
                "area": self._pointer("area", self._areas),
                "boundary": self._pointer("boundary", self._boundary),
                "start": self._pointer("start", self._start),
                "max_iterations": MAX_ITERATIONS,
                "max_halvings": MAX_HALVINGS,
                "round_off": ROUND_OFF_SHARE,
                "tolerance": RESIDUAL_TOLERANCE,
                "acceptable": ACCEPTABLE_RESIDUAL,
                "remaining": MIN_REMAINING_SHARE,
                "work": self._pointer("work", np.zeros(6 * n * n + 10 * n)),
            },
        )
        # Pointers are made once: to make them takes longer than the functions.
        self._at = (
            self._network.pointer,
            self._pointer("y", self._y),
            self._pointer("V", self._volumes[0]),
            self._pointer("W", self._volumes[1]),
        )
        self._c_magnitude = self._pointer("magnitude", self._magnitude)
        self._c_result = self._pointer("result", self._result)
        self._c_by_y = self._pointer("by_y", self._by_y)
        self._c_by_V = self._pointer("by_V", self._by_V)

    def _pointer(self, name: str, values: Array) -> object:
        """An array of numbers for C, which may write into it."""
        return self._c.array(name, values, "float64", values.shape, writable=True)

    def begin(self, h: float, t: float, p: Array, m: Array, U: Array, V: Array) -> None:
        super().begin(h, t, p, m, U, V)
        self._length[0] = h
        self._start[:] = (p, m, U, self._pV0, self._weights, self._amplification)
        for i, passage in enumerate(self.passages):
            self._areas[i] = passage.area
            for side, end in enumerate(passage.ends):
                if not isinstance(end, int):
                    self._boundary[i, side] = (end.pressure, end.temperature)

    def _take(self, y: Array, V: Array, W: Array) -> None:
        """Copy what the next function of C reads."""
        self._y[:] = y
        self._volumes[0] = V
        self._volumes[1] = W

    def residual(self, y: Array, V: Array, W: Array, known: Rates | None = None) -> Array:
        self._take(y, V, W)
        self._c.lib.gas_residual(*self._at, self._c_result)
        return self._result.copy()

    def derivatives(self, y: Array, V: Array, W: Array) -> tuple[Array, Array]:
        self._take(y, V, W)
        self._c.lib.gas_derivatives(*self._at, self._c_by_y, self._c_by_V)
        return self._by_y.copy(), self._by_V.copy()

    def scales(self, y: Array, V: Array, magnitude: Array) -> Array:
        self._take(y, V, self._volumes[1])
        self._magnitude[:] = magnitude
        self._c.lib.gas_scales(*self._at[:3], self._c_magnitude, self._c_result)
        return self._result.copy()

    def settle(self, y: Array, V: Array, W: Array, magnitude: Array) -> Array | None:
        self._take(y, V, W)
        self._magnitude[:] = magnitude
        is_solved = self._c.lib.gas_solve(*self._at, self._c_magnitude)
        return self._y.copy() if is_solved else None
