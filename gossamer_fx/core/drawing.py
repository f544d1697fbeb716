"""Solids that pictures and recordings show, and tables by which notebooks show objects."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from html import escape
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, eq=False)
class Solid:
    """A surface that moves as a whole: with a rigid body, by a function of time, or not at all.

    Args:
        name: in pictures and files.
        X: points (n, 3) [m].  With `on` they are coordinates along the directors of the body, from
            its position; else they are points in space.
        triangles: corners (t, 3), as indices of points.
        lines: edges to draw (l, 2), as indices of points.
        on: the body with one node that carries the solid, e.g. a `RigidBody`; None for no body.
        motion: displacement (3,) [m] as a function of time [s]; None for a solid at rest.

    Example:
        >>> from gossamer_fx.core.drawing import Solid
        >>> square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
        >>> plate = Solid("plate", square, np.array([[0, 1, 2], [0, 2, 3]]), np.array([[0, 1]]))
    """

    name: str
    X: npt.NDArray[np.floating]
    # Rooms and planes have no triangles, which would hide what is in them or behind them.
    triangles: npt.NDArray[np.int32]
    lines: npt.NDArray[np.int32]
    on: Any = None
    motion: Callable[[float], Sequence[float]] | None = None


# ---- boxes ---------------------------------------------------------------------------------------

# Signs of the coordinates of the corners (8, 3) of a box: the three bits of a corner's number, of
# which that of z is the lowest.
BOX_CORNERS = np.array(list(product((-1, 1), repeat=3)))
AXIS_BITS = (1, 2, 4)

# The two corners of an edge differ in one bit.
BOX_EDGES = tuple(
    (corner, corner | bit) for corner in range(8) for bit in AXIS_BITS if not corner & bit
)


def _triangles_of_box() -> tuple[tuple[int, int, int], ...]:
    """The 12 triangles of a box, two for each face, as numbers of its corners."""
    triangles = []
    for bit in AXIS_BITS:
        first, second = (other for other in AXIS_BITS if other != bit)
        for base in (0, bit):
            opposite = base | first | second
            triangles.append((base, base | first, opposite))
            triangles.append((base, base | second, opposite))
    return tuple(triangles)


BOX_TRIANGLES = _triangles_of_box()


def box_surface(corners: npt.NDArray[np.floating]) -> npt.NDArray[np.int32]:
    """The triangles (12, 3) of a box with corners (8, 3), as indices of these: seen from outside
    they run counterclockwise, as those of all surfaces that are drawn."""
    triangles = np.array(BOX_TRIANGLES, dtype=np.int32)
    centre = corners.mean(axis=0)
    a, b, c = (corners[column] - centre for column in triangles.T)
    is_inwards = np.einsum("ni,ni->n", np.cross(a, b), c) < 0
    triangles[is_inwards] = triangles[is_inwards, ::-1]
    return triangles


# ---- tables --------------------------------------------------------------------------------------


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table as one line of HTML, from the names of its columns and a text of each row for each of
    them; all texts are escaped.

    Example:
        >>> table(["kind"], [["a < b"]])
        '<table><tr><th>kind</th></tr><tr><td>a &lt; b</td></tr></table>'
    """
    lines = [_row("th", head)]
    for row in rows:
        lines.append(_row("td", row))
    inside = "".join(lines)
    return f"<table>{inside}</table>"


def _row(tag: str, words: Sequence[str]) -> str:
    """A row of a table in HTML, with cells of a tag, "th" or "td"."""
    cells = ""
    for word in words:
        text = escape(word)
        cells += f"<{tag}>{text}</{tag}>"
    return f"<tr>{cells}</tr>"
