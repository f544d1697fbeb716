"""Rows of values of which each rank has some, and which names find on any number of ranks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

Int64Array = npt.NDArray[np.int64]
Array = npt.NDArray[np.floating[Any]]


@dataclass(frozen=True, eq=False)
class NamedRows:
    """Values (n, k) of this rank by names that are the same on any number of ranks.

    Attributes:
        names: integers (n,), each once; other ranks may have the same row.
        values: numbers (n, k), which do not change.
    """

    names: Int64Array
    values: Array

    def of(self, names: Int64Array, otherwise: Array | None = None) -> Array:
        """The values (m, k) of other names (m,), each once, as a new array.  A name that has none
        gets those of `otherwise` (m, k); without it a `LookupError` is raised.

        >>> import numpy as np
        >>> rows = NamedRows(np.array([7, 3]), np.array([[70.0], [30.0]]))
        >>> rows.of(np.array([3, 4]), otherwise=np.zeros((2, 1)))
        array([[30.],
               [ 0.]])
        """
        # As a rule a state returns to the ranks from which it came.
        if np.array_equal(names, self.names):
            return self.values.copy()
        _, here, known = np.intersect1d(names, self.names, assume_unique=True, return_indices=True)
        if otherwise is None:
            missing = len(names) - len(here)
            if missing:
                raise LookupError(f"{missing} rows are missing")
            otherwise = np.zeros((len(names), self.values.shape[1]))
        found = np.array(otherwise)
        found[here] = self.values[known]
        return found

    def of_all_ranks(self, comm: MPI.Intracomm) -> NamedRows:
        """The rows of all ranks, each once, in the order of their names.  Collective."""
        parts = comm.allgather((self.names, self.values))
        names, first = np.unique(np.concatenate([part for part, _ in parts]), return_index=True)
        return NamedRows(names, np.concatenate([part for _, part in parts])[first])

    def as_data(self) -> dict[str, Any]:
        """Names, values, and the length of a row, for JSON."""
        return {
            "names": self.names.tolist(),
            "values": self.values.tolist(),
            "length": self.values.shape[1],
        }

    @staticmethod
    def of_data(data: Mapping[str, Any]) -> NamedRows:
        """What `as_data` returned."""
        names = np.array(data["names"], dtype=np.int64)
        values = np.array(data["values"], dtype=float).reshape(len(names), data["length"])
        return NamedRows(names, values)

    @staticmethod
    def is_data(value: object) -> bool:
        """Whether a value is one that `as_data` returned."""
        return isinstance(value, dict) and set(value) == {"names", "values", "length"}
