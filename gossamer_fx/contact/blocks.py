"""Blocks of 3 x 3 that contact adds to the tangent: summed by places first, entered by rows at once."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from gossamer_fx.algebra.numbering import Numbering
from gossamer_fx.contact.kernel import Array, Integers

Keys = npt.NDArray[np.int64]
KEPT = 2.0  # size of the pattern, over that of the present blocks, up to which it keeps former ones


class Blocks:
    """The pattern of contact on this rank, by sorted keys row * size + column, and the present values."""

    def __init__(self, numbering: Numbering, unknowns: Keys) -> None:
        self._size, self._blocked = numbering.size, numbering.block_size == 3
        self._unknowns = unknowns
        self.keys: Keys = np.zeros(0, dtype=np.int64)
        self.values: Array = np.zeros((0, 9))
        self._lay_out()

    def keys_of(self, vectors: npt.NDArray[np.integer]) -> Keys:
        """Keys (n, w, w) of the blocks that vectors (n, w) couple."""
        at = self._unknowns[vectors]
        return at[:, :, None] * self._size + at[:, None, :]

    def hold(self, *keys: Keys) -> bool:
        """Whether the pattern has all of these keys."""
        if not len(self.keys):
            return not any(k.size for k in keys)
        at = [np.minimum(np.searchsorted(self.keys, k), len(self.keys) - 1) for k in keys]
        return all(bool((self.keys[i] == k).all()) for i, k in zip(at, keys, strict=True))

    def cover(self, *keys: Keys) -> None:
        """Let the pattern hold these keys, and former ones if they are not many more."""
        needed = np.unique(np.concatenate([k.ravel() for k in keys]))
        self.keys = needed if len(self.keys) > KEPT * len(needed) else np.union1d(needed, self.keys)
        self._lay_out()

    def slots(self, keys: Keys) -> Integers:
        """Where keys of the pattern stand in `values`."""
        return np.searchsorted(self.keys, keys).astype(np.int32)

    def _lay_out(self) -> None:
        rows, columns = np.divmod(self.keys, self._size)
        self.values = np.zeros((len(self.keys), 9))
        self._rows, first, counts = np.unique(rows, return_index=True, return_counts=True)
        if self._blocked:
            self._ends = np.append(first, len(rows)).astype(PETSc.IntType)
            self._columns = (columns // 3).astype(PETSc.IntType)
            self._map = (self._rows // 3).astype(PETSc.IntType)
            return
        # single numbers: each row of blocks is three rows
        place = np.arange(len(rows)) - np.repeat(first, counts)
        start, length = np.repeat(9 * first, counts), np.repeat(counts, counts)
        c, d = np.arange(3)[:, None], np.arange(3)
        there = start[:, None, None] + c * (3 * length)[:, None, None] + (3 * place)[:, None, None] + d
        self._order = np.empty(9 * len(rows), dtype=np.int64)
        self._order[there.ravel()] = np.arange(9 * len(rows))
        entries = np.empty(9 * len(rows), dtype=np.int64)
        entries[there.ravel()] = np.broadcast_to(columns[:, None, None] + d, there.shape).ravel()
        self._columns = entries.astype(PETSc.IntType)
        self._ends = np.append(0, np.cumsum(np.repeat(3 * counts, 3))).astype(PETSc.IntType)
        self._map = (self._rows[:, None] + np.arange(3)).ravel().astype(PETSc.IntType)

    def add_to(self, A: PETSc.Mat) -> None:
        """A += the present values, zeros included."""
        if not len(self.keys):
            return
        add = PETSc.InsertMode.ADD_VALUES
        if self._blocked:
            A.setValuesBlockedIJV(self._ends, self._columns, self.values.ravel(), addv=add, rowmap=self._map)
        else:
            A.setValuesIJV(self._ends, self._columns, self.values.ravel()[self._order], addv=add, rowmap=self._map)
