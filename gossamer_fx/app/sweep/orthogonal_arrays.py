"""Orthogonal arrays: few runs in which each level of a factor meets each level of every other one
equally often.

An array has a row for each run and a column for each factor; its entries are levels, counted from
0.  In any two columns all pairs of levels occur equally often, so that the mean over the runs with
one level of a factor does not depend on the other factors, if effects add up.

Sources: C. R. Rao, J. R. Stat. Soc. Suppl. 9 (1947) 128, doi:10.2307/2983576, for the linear
arrays; R. L. Plackett & J. P. Burman, Biometrika 33 (1946) 305, doi:10.1093/biomet/33.4.305, for
L12.  The names are those of G. Taguchi.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import numpy.typing as npt

from gossamer_fx.core.checks.errors import check

Levels = npt.NDArray[np.int64]

# A difference matrix: in the differences of two rows, modulo 3, each remainder occurs twice.
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

# Number of levels, and number of independent columns from which the others are sums.
_LINEAR = {
    "L4": (2, 2),
    "L8": (2, 3),
    "L16": (2, 4),
    "L9": (3, 2),
    "L27": (3, 3),
}


def orthogonal_array(name: str) -> Levels:
    """An orthogonal array (runs, columns) of levels from 0.

    A row is a run, a column a factor; in any two columns all pairs of levels occur equally often.

    Args:
        name: L4 (3 columns of two levels), L8 (7), L12 (11), L16 (15), L9 (4 columns of three
            levels), L27 (13), or L18 (1 column of two levels and 7 of three).

    Raises:
        InputError: the name is unknown.

    Example:
        orthogonal_array("L9").shape == (9, 4)
    """
    known = sorted([*_LINEAR, "L12", "L18"], key=_runs)
    check(
        name in known,
        f"There is no orthogonal array {name!r}; give one of: {', '.join(known)}.",
    )
    if name == "L12":
        return _plackett_burman()
    if name == "L18":
        return _from_differences()
    levels, generators = _LINEAR[name]
    return _linear(levels, generators)


def _runs(name: str) -> int:
    """Number of runs of an array, which its name contains."""
    return int(name[1:])


def _linear(levels: int, generators: int) -> Levels:
    """All linear combinations of some independent columns, modulo a prime number of levels.

    Returns:
        levels from 0 to p - 1, (p^k runs, (p^k - 1)/(p - 1) columns).
    """
    rows = list(product(range(levels), repeat=generators))
    weights = []
    for combination in product(range(levels), repeat=generators):
        # Multiples of a combination give the same column with its levels renamed, so that only
        # those count whose first entry other than zero is one.
        nonzero = [weight for weight in combination if weight]
        if nonzero and nonzero[0] == 1:
            weights.append(combination)
    return np.asarray(np.array(rows) @ np.array(weights).T % levels)


def _plackett_burman() -> Levels:
    """L12, from the squares modulo eleven (construction of Paley)."""
    squares = {k * k % 11 for k in range(1, 11)}
    first = np.array([int(k in squares) for k in range(11)])
    rotated = [np.roll(first, k) for k in range(11)]
    return np.vstack([rotated, np.ones(11, dtype=np.int64)])


def _from_differences() -> Levels:
    """L18: one column of two levels and seven of three."""
    rows = []
    for r in range(6):
        for shift in range(3):
            columns_of_three = (_DIFFERENCES[r] + shift) % 3
            rows.append([r // 3, r % 3, *columns_of_three])
    return np.array(rows)
