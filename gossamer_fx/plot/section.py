"""Sections: the lines in which a plane cuts films, coloured by group, or by layer where all is of one group."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.errors import check, is_vector
from gossamer_fx.fields.body_shape import BodyShape
from gossamer_fx.forms.spaces import cell_nodes
from gossamer_fx.model.body import Array, Vector
from gossamer_fx.plot.groups import COLOURS, groups_of
from gossamer_fx.plot.page import Grid
from gossamer_fx.plot.view import TRIANGLES, Integers, unit
from gossamer_fx.system.system import System

LINE = 1.3  # points
BACK = 0.1  # part of the section's length by which a line must go back to begin a new layer


@dataclass(frozen=True)
class Cut:
    """Lines (m, 2, 2) [m] to the right and up in the plane at one time, and their kinds (m,); on rank 0."""

    time: float
    ends: Array
    kinds: Integers


class Section:
    """Cuts the films of a system by a plane through a point [m] with a normal, which points to the eye."""

    def __init__(self, system: System, point: Vector, normal: Vector) -> None:
        self._system, self._point = system, np.asarray(point, dtype=float)
        n = unit(np.asarray(normal, dtype=float))
        upright = np.array([0.0, 0.0, 1.0]) if abs(n[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
        up = unit(upright - (upright @ n) * n)
        self._axes = np.array([np.cross(up, n), up, n])
        self._films = []
        films = [body for body in system.bodies if isinstance(body, Membrane)]
        self._names, parts = groups_of(films)
        for film, of_cells in zip(films, parts, strict=True):
            shape, pieces = BodyShape(system.state, film), np.array(TRIANGLES[film.order])
            cells = cell_nodes(shape.body.space)[: len(of_cells)].astype(np.int64)
            self._films.append(
                (shape, cells[:, pieces].reshape(-1, 3), np.repeat(of_cells, len(pieces)))
            )

    def cut(self) -> Cut:
        """The accepted state; collective."""
        ends: list[Array] = [np.zeros((0, 2, 2))]
        kinds: list[npt.NDArray[np.int64]] = [np.zeros(0, dtype=np.int64)]
        for shape, triangles, of_triangles in self._films:
            shape.update()
            corners = shape.q.x.array.reshape(-1, 3)[triangles]
            lines, which = _crossings((corners - self._point) @ self._axes.T)
            ends.append(lines)
            kinds.append(of_triangles[which])
        parts = self._system.comm.gather((np.concatenate(ends), np.concatenate(kinds)))
        if parts is None:
            return Cut(self._system.time, ends[0], kinds[0])
        lines, of_lines = (np.concatenate(part) for part in zip(*parts, strict=True))
        if len(self._names) == 1:
            of_lines = layers(lines)
        return Cut(self._system.time, lines, of_lines)

    def key(self, cuts: Sequence[Cut]) -> dict[str, str]:
        """Names and colours of what is cut."""
        most = max((int(cut.kinds.max(initial=-1)) + 1 for cut in cuts), default=0)
        names = self._names if len(self._names) > 1 else [f"layer {k + 1}" for k in range(most)]
        return dict(zip(names, COLOURS, strict=False))


def check_section(owner: str, section: tuple[Vector, Vector]) -> None:
    """Raise `InputError` for what is no point and normal."""
    good = (
        isinstance(section, Sequence)
        and len(section) == 2
        and all(is_vector(v) for v in section)
        and bool(np.any(section[1]))
    )
    check(
        good,
        f"{owner}: section is {section!r}; give a point [m] and a normal, ((x, y, z), (nx, ny, nz)).",
    )


def _crossings(x: Array) -> tuple[Array, Integers]:
    """Where triangles x (n, 3, 3) cross the plane of their first two coordinates: lines (m, 2, 2), and whose they are.

    The ends of lines of neighbours are the same to the last digit.
    """
    above = x[..., 2] >= 0
    which = np.flatnonzero(above.any(axis=1) & ~above.all(axis=1))
    x, above = x[which], above[which]
    points = np.zeros((len(which), 3, 2))
    crossed = np.zeros((len(which), 3), dtype=bool)
    for k, (i, j) in enumerate(((0, 1), (1, 2), (2, 0))):
        crossed[:, k] = above[:, i] != above[:, j]
        low, high = (
            np.where(above[:, i : i + 1] == side, x[:, i], x[:, j]) for side in (False, True)
        )
        gap = np.where(crossed[:, k], high[:, 2] - low[:, 2], 1.0)
        points[:, k] = low[:, :2] - (low[:, 2] / gap)[:, None] * (high - low)[:, :2]
    return points[crossed].reshape(-1, 2, 2), which


def layers(lines: Array) -> Integers:
    """Number (m,) of the layer of lines (m, 2, 2): one follows them from an end, and where they turn back along the
    section's longer axis, the next layer begins."""
    kinds = np.zeros(len(lines), dtype=np.int64)
    if not len(lines):
        return kinds
    places, which = np.unique(lines.reshape(-1, 2), axis=0, return_inverse=True)
    ends = which.reshape(-1, 2)
    spread = places - places.mean(axis=0)
    along = spread @ np.linalg.eigh(spread.T @ spread)[1][:, 1]
    at: list[list[int]] = [[] for _ in places]
    for line, (i, j) in enumerate(ends):
        at[i].append(line)
        at[j].append(line)
    left = np.ones(len(lines), dtype=bool)
    layer = -1
    # loops after open lines; from the end that comes first in the mesh, so that colours stay in the course of a run
    for start in sorted(range(len(places)), key=lambda i: (len(at[i]) != 1, at[i])):
        chain, place = [], start
        while True:
            line = next((k for k in at[place] if left[k]), -1)
            if line < 0:
                break
            left[line] = False
            chain.append(line)
            place = int(ends[line].sum() - place)
        if chain:
            turns = _turns(along[_follow(ends[chain], start)], BACK * float(np.ptp(along)))
            for first, last in pairwise([0, *turns, len(chain)]):
                layer += 1
                kinds[chain[first:last]] = layer
    return kinds


def _follow(ends: npt.NDArray[np.integer], place: int) -> list[int]:
    """The places along a chain of lines (k, 2) from one of its ends on."""
    places = [place]
    for both in ends.sum(axis=1):
        places.append(int(both) - places[-1])
    return places


def _turns(s: Array, back: float) -> list[int]:
    """Where numbers turn back by more than a length."""
    turns: list[int] = []
    way, low, high = (
        0,
        0,
        0,
    )  # the direction, and where the least and the greatest number of this layer are
    for k, value in enumerate(s):
        low, high = (k if value < s[low] else low), (k if value > s[high] else high)
        if way >= 0 and s[high] - value > back:
            turns += [high] * way
            way, low = -1, k
        elif way <= 0 and value - s[low] > back:
            turns += [low] * -way
            way, high = 1, k
    return turns


def window(cuts: Sequence[Cut]) -> tuple[tuple[float, float], list[Array]]:
    """The size (width, height) [m] that shows each of the cuts at one scale, and their middles."""
    points = [cut.ends.reshape(-1, 2) if len(cut.ends) else np.zeros((1, 2)) for cut in cuts]
    boxes = [(p.min(axis=0), p.max(axis=0)) for p in points]
    width, height = np.max([high - low for low, high in boxes], axis=0)
    largest = max(float(width), float(height)) or 1.0
    return (
        (
            max(float(width), 0.1 * largest) + 0.05 * largest,
            max(float(height), 0.1 * largest) + 0.05 * largest,
        ),
        [(low + high) / 2 for low, high in boxes],
    )


def draw(cut: Cut, size: tuple[float, float], middle: Array, grid: Grid, dpi: float) -> Array:
    """An image (height, width, 3) in [0, 1] of a cut, as large as the grid's."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure

    figure = Figure(figsize=(grid.width, grid.height), dpi=dpi, facecolor="white")
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    colours = [COLOURS[k % len(COLOURS)] for k in cut.kinds]
    axes.add_collection(
        LineCollection(list(cut.ends), colors=colours, linewidths=LINE, capstyle="round")
    )
    half = np.array(size) / 2
    axes.set(
        xlim=(middle[0] - half[0], middle[0] + half[0]),
        ylim=(middle[1] - half[1], middle[1] + half[1]),
    )
    canvas.draw()
    image: Array = np.asarray(canvas.buffer_rgba())[..., :3] / 255
    return image
