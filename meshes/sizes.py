"""Checks of the lengths and numbers of cells that mesh generators take.

Without them a size of zero or below ends in a mesh that is turned over, or in a message of gmsh
that does not name the argument.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from numbers import Integral, Real
from typing import Any

from gossamer_fx.extend import check


def require_lengths(generator: str, **lengths: Any) -> None:
    """Raise `InputError` about a generator unless lengths [m], by the names of its arguments, are
    finite and positive numbers; the same on all ranks, as below."""
    for name, length in lengths.items():
        # Not a number and infinity are neither: comparisons with them are false.
        is_length = isinstance(length, Real) and 0 < float(length) < math.inf
        check(is_length, f"{generator}: {name} is {length!r} m; give a positive number.")


def require_counts(generator: str, least: int = 1, **counts: Any) -> None:
    """Raise `InputError` unless counts, by the names of arguments, are whole numbers of at least
    `least`."""
    for name, count in counts.items():
        # Whole numbers of NumPy are accepted, 4.0 is not: gmsh would refuse it later.
        is_count = isinstance(count, Integral) and int(count) >= least
        check(
            is_count,
            f"{generator}: {name} is {count!r}; give a whole number of at least {least}.",
        )


def require_order(generator: str, order: Any) -> None:
    """Raise `InputError` unless the order of the geometry is 1, plane triangles, or 2, curved
    ones."""
    check(order in (1, 2), f"{generator}: order is {order!r}; give 1 or 2.")


def require_ascending(generator: str, names: Sequence[str], lengths: Sequence[float]) -> None:
    """Raise `InputError` unless the second of two lengths, named `names`, is the larger one."""
    check(
        lengths[0] < lengths[1],
        f"{generator}: {names[0]} is {lengths[0]!r} and {names[1]} is {lengths[1]!r}; "
        f"give a larger {names[1]}.",
    )
