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
    """Refuse lengths that are not finite and positive numbers, the same on all ranks.

    Args:
        generator: name of the function that makes the mesh, for the message.
        lengths: length [m] by the name of its argument.

    Raises:
        InputError: one of them is not a finite, positive number; it names the argument.
    """
    for name, length in lengths.items():
        # Not a number and infinity are neither: comparisons with them are false.
        is_length = isinstance(length, Real) and 0 < float(length) < math.inf
        check(is_length, f"{generator}: {name} is {length!r} m; give a positive number.")


def require_counts(generator: str, least: int = 1, **counts: Any) -> None:
    """Refuse numbers of cells, sides or parts that are not whole or too small, the same on all
    ranks.

    Args:
        generator: name of the function that makes the mesh, for the message.
        least: smallest number that the generator can use.
        counts: number by the name of its argument.

    Raises:
        InputError: one of them is not a whole number of at least `least`; it names the argument.
    """
    for name, count in counts.items():
        # Whole numbers of NumPy are accepted, 4.0 is not: gmsh would refuse it later.
        is_count = isinstance(count, Integral) and int(count) >= least
        check(
            is_count,
            f"{generator}: {name} is {count!r}; give a whole number of at least {least}.",
        )


def require_order(generator: str, order: Any) -> None:
    """Refuse an order of the geometry other than 1, plane triangles, and 2, curved ones.

    Args:
        generator: name of the function that makes the mesh, for the message.
        order: of the polynomials that describe the shape of a triangle.

    Raises:
        InputError: it is neither 1 nor 2.
    """
    check(order in (1, 2), f"{generator}: order is {order!r}; give 1 or 2.")


def require_ascending(generator: str, names: Sequence[str], lengths: Sequence[float]) -> None:
    """Refuse two lengths of which the second is not the larger one, the same on all ranks.

    Args:
        generator: name of the function that makes the mesh, for the message.
        names: of the two arguments, the smaller length first.
        lengths: their values, in the same order and unit.

    Raises:
        InputError: the second one is not larger; it names both arguments.
    """
    check(
        lengths[0] < lengths[1],
        f"{generator}: {names[0]} is {lengths[0]!r} and {names[1]} is {lengths[1]!r}; give a "
        f"larger {names[1]}.",
    )
