"""Orthogonal arrays: few runs in which each level of a factor meets each level of every other one equally often.

C. R. Rao, J. R. Stat. Soc. Suppl. 9 (1947) 128; their names are those of G. Taguchi.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import numpy.typing as npt

from gossamer_fx.checks.errors import check

Levels = npt.NDArray[np.int64]

# Rows whose differences have each remainder of division by three twice: a difference matrix
_DIFFERENCES = np.array(
    [
        [0, 0, 0, 0, 0, 0],
        [0, 0, 1, 1, 2, 2],
        [0, 1, 0, 2, 1, 2],
        [0, 1, 2, 0, 2, 1],
        [0, 2, 1, 2, 0, 1],
        [0, 2, 2, 1, 1, 0],
    ]
)
_LINEAR = {
    "L4": (2, 2),
    "L8": (2, 3),
    "L16": (2, 4),
    "L9": (3, 2),
    "L27": (3, 3),
}  # levels, generators


def orthogonal_array(name: str) -> Levels:
    """Levels from 0 (runs, columns) of L4 2³, L8 2⁷, L9 3⁴, L12 2¹¹, L16 2¹⁵, L18 2¹3⁷ or L27 3¹³.

    Raises:
        InputError: there is no such array.
    """
    known = [*_LINEAR, "L12", "L18"]
    check(
        name in known,
        f"There is no orthogonal array {name!r}; give one of: {', '.join(sorted(known, key=_runs))}.",
    )
    if name == "L12":
        return _paley()
    if name == "L18":
        return _from_differences()
    return _linear(*_LINEAR[name])


def _runs(name: str) -> int:
    return int(name[1:])


def _linear(levels: int, generators: int) -> Levels:
    """All sums of multiples of the generators, modulo a prime number of levels."""
    rows = np.array(list(product(range(levels), repeat=generators)))
    sums = [
        w for w in product(range(levels), repeat=generators) if next((k for k in w if k), 0) == 1
    ]
    return np.asarray(rows @ np.array(sums).T % levels)


def _paley() -> Levels:
    """From the squares modulo eleven (Plackett and Burman, Biometrika 33 (1946) 305)."""
    squares = {k * k % 11 for k in range(1, 11)}
    first = np.array([int(k in squares) for k in range(11)])
    return np.vstack([[np.roll(first, k) for k in range(11)], np.ones(11, dtype=np.int64)])


def _from_differences() -> Levels:
    """One column of two levels and seven of three."""
    rows = [
        (r // 3, r % 3, *((d + s) % 3 for d in _DIFFERENCES[r])) for r in range(6) for s in range(3)
    ]
    return np.array(rows)
