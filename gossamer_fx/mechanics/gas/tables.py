"""Functions that are given by points: curves of blowers, discharge coefficients, flows in time."""

from __future__ import annotations

from itertools import pairwise

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.laws.tracing import Number, at_most


@check_arguments
class LinearTable:
    """A function that is linear between given points and constant outside of them.

    Args:
        points: pairs (x, y) by rising x, at least one.

    Raises:
        InputError: there is no point, or x does not rise.

    Example:
        >>> flow = gx.gas.LinearTable((0.0, 0.0), (0.1, 2.0), (0.3, 1.0))
        >>> flow(0.05), flow(1.0)
        (1.0, 1.0)
    """

    def __init__(self, *points: tuple[float, float]) -> None:
        self.points = tuple(points)
        xs = [x for x, _ in points]
        check(
            bool(points) and all(low < high for low, high in pairwise(xs)),
            f"LinearTable: its points are at {xs}; give at least one, by rising x.",
        )

    def __call__(self, x: Number) -> Number:
        """The value at x, a real or complex number or a symbol."""
        value: Number = self.points[-1][1]
        for (low, first), (high, last) in reversed(list(pairwise(self.points))):
            inside = first + (last - first) / (high - low) * (x - low)
            value = at_most(x, high, holds=inside, fails=value)
        least, first = self.points[0]
        return at_most(x, least, holds=first, fails=value)
