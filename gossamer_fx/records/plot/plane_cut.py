"""Sections: the lines in which a plane cuts films, coloured by group or, where all is one group, by
layer."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from gossamer_fx.core.checks.errors import check, is_vector
from gossamer_fx.core.model.body import Array, Vector
from gossamer_fx.records.plot.colours import GROUP_COLOURS
from gossamer_fx.records.plot.page import Views
from gossamer_fx.records.plot.plot import captions
from gossamer_fx.records.plot.run_reader import RunReader
from gossamer_fx.records.plot.shapes import Integers, unit

LINE_WIDTH = 1.3  # points
# Part of the section's length by which a line must turn back to begin a new layer: less is a wave.
TURN_BACK = 0.1
_MIN_SIDE = 0.1  # of the larger side of the window, that the smaller one has at least
_MARGIN = 0.05  # of the larger side of the window
_UPRIGHT = 0.9  # vertical part of a unit normal from which on the plane counts as horizontal


@dataclass(frozen=True)
class Cut:
    """A section at one time.

    Attributes:
        time: [s].
        ends: of lines (m, 2, 2), to the right and up in the plane [m].
        kinds: numbers (m,) of the lines' groups or layers.
    """

    time: float
    ends: Array
    kinds: Integers


class PlaneCut:
    """Cuts the films of a recorded run by a plane.

    Args:
        point: of the plane [m].
    """

    def __init__(self, run: RunReader, point: Vector, normal: Vector) -> None:
        self._run = run
        self._point = np.asarray(point, dtype=float)
        towards = unit(np.asarray(normal, dtype=float))
        # z is up, but in a horizontal plane y
        upright = np.array([0.0, 0.0, 1.0])
        if abs(towards[2]) >= _UPRIGHT:
            upright = np.array([0.0, 1.0, 0.0])
        up = unit(upright - (upright @ towards) * towards)
        self._axes = np.array([np.cross(up, towards), up, towards])

    def cut(self, frame: int) -> Cut:
        """The section of a recorded state: m lines in the plane [m], and their groups or layers.

        With one group of cells only, the lines are divided into layers in place of groups. All
        films must have the field "group", as the constructor asks: ValueError otherwise.
        """
        corners = self._run.film_corners(frame)
        groups = self._run.values("group", frame)
        ends: list[Array] = [np.zeros((0, 2, 2))]
        kinds: list[Integers] = [np.zeros(0, dtype=np.int64)]
        for of_film, values in zip(corners, groups, strict=True):
            lines, cut_triangles = _crossings((of_film - self._point) @ self._axes.T)
            ends.append(lines)
            kinds.append(np.rint(values[cut_triangles, 0]).astype(np.int64))
        all_ends = np.concatenate(ends)
        all_kinds = np.concatenate(kinds)
        if len(self._run.groups) == 1:
            all_kinds = layers(all_ends)
        return Cut(float(self._run.times[frame]), all_ends, all_kinds)

    def views(self, frames: Sequence[int]) -> Views:
        """The sections of some recorded states, at one scale, each in the middle of its image.

        Returns:
            Images and captions; its size is that of the largest section, width and height [m], and
            `draw` takes pixels per metre.
        """
        cuts = [self.cut(frame) for frame in frames]
        size, middles = window(cuts)

        def draw(scale: float) -> Iterator[Array]:
            for cut, middle in zip(cuts, middles, strict=True):
                yield draw_cut(cut, size, middle, scale)

        return Views(
            captions=captions(self._run, frames, [1.0] * len(frames)),
            size=size,
            draw=draw,
            key=self.key(cuts),
        )

    def key(self, cuts: Sequence[Cut]) -> dict[str, str]:
        """Names and colours of what is cut."""
        names = self._run.groups
        if len(names) == 1:
            most = max((int(cut.kinds.max(initial=-1)) + 1 for cut in cuts), default=0)
            names = [f"layer {k + 1}" for k in range(most)]
        return dict(zip(names, GROUP_COLOURS, strict=False))


def check_section(owner: str, section: tuple[Vector, Vector]) -> None:
    """Raise `InputError` for something else than a point and a normal."""
    is_pair = isinstance(section, Sequence) and len(section) == 2
    good = is_pair and all(is_vector(v) for v in section) and bool(np.any(section[1]))
    check(
        good,
        f"{owner}: section is {section!r}; give a point [m] and a normal, ((x, y, z), (nx, ny, "
        "nz)).",
    )


def _crossings(x: Array) -> tuple[Array, Integers]:
    """Where triangles cross the plane of their first two coordinates.

    Args:
        x: corners (n, 3, 3) [m], along two axes in the plane and its normal.

    Returns:
        Lines (m, 2, 2) [m], whose ends at neighbours are equal to the last bit, and the numbers
        (m,) of their triangles.
    """
    above = x[..., 2] >= 0
    cut = np.flatnonzero(above.any(axis=1) & ~above.all(axis=1))
    x = x[cut]
    above = above[cut]
    points = np.zeros((len(cut), 3, 2))
    crossed = np.zeros((len(cut), 3), dtype=bool)
    for edge, (i, j) in enumerate(((0, 1), (1, 2), (2, 0))):
        crossed[:, edge] = above[:, i] != above[:, j]
        # Always from the lower to the upper end: both triangles of an edge compute the same number.
        i_is_above = above[:, i : i + 1]
        low = np.where(i_is_above, x[:, j], x[:, i])
        high = np.where(i_is_above, x[:, i], x[:, j])
        height = np.where(crossed[:, edge], high[:, 2] - low[:, 2], 1.0)
        part = (low[:, 2] / height)[:, None]
        points[:, edge] = low[:, :2] - part * (high - low)[:, :2]
    return points[crossed].reshape(-1, 2, 2), cut


# ---- layers --------------------------------------------------------------------------------------


def layers(lines: Array) -> Integers:
    """Numbers (m,) of the layers that the lines of a section of a folded film belong to, from 0.

    One follows connected lines from one of their ends.  Where they turn back along the section's
    longer axis, the next layer begins.

    Args:
        lines: ends (m, 2, 2) [m]; lines are connected where ends are equal to the last bit.
    """
    kinds = np.zeros(len(lines), dtype=np.int64)
    if not len(lines):
        return kinds
    points, which = np.unique(lines.reshape(-1, 2), axis=0, return_inverse=True)
    ends = which.reshape(-1, 2)
    spread = points - points.mean(axis=0)
    along = spread @ np.linalg.eigh(spread.T @ spread)[1][:, 1]
    turn_back = TURN_BACK * float(np.ptp(along))
    layer = -1
    for chain, chain_points in _chains(ends, len(points)):
        turns = _turns(along[chain_points], turn_back)
        for first, last in pairwise([0, *turns, len(chain)]):
            layer += 1
            kinds[chain[first:last]] = layer
    return kinds


def _chains(ends: npt.NDArray[np.integer], count: int) -> Iterator[tuple[list[int], list[int]]]:
    """Yield chains of connected lines.

    Args:
        ends: numbers of points (m, 2) of each line.
    """
    lines_at: list[list[int]] = [[] for _ in range(count)]
    for line in range(len(ends)):
        for point in ends[line]:
            lines_at[point].append(line)
    left = np.ones(len(ends), dtype=bool)
    # Open chains before closed ones; of each kind the one whose end comes first in the mesh, so
    # that layers have the same colours in all pictures of a run.
    starts = sorted(range(count), key=lambda i: (len(lines_at[i]) != 1, lines_at[i]))
    for start in starts:
        chain: list[int] = []
        points = [start]
        while True:
            line = next((k for k in lines_at[points[-1]] if left[k]), -1)
            if line < 0:
                break
            left[line] = False
            chain.append(line)
            points.append(int(ends[line].sum()) - points[-1])
        if chain:
            yield chain, points


def _turns(s: Array, back: float) -> list[int]:
    """Positions in a sequence of numbers at which it turns back by more than a length.

    Args:
        s: coordinates (n,) along a chain of points [m].
        back: length [m] by which a coordinate must go back from its extreme to count as a turn.
    """
    turns: list[int] = []
    direction = 0  # 1 upwards, -1 downwards, 0 while it is not known
    lowest = 0  # position of the least number of this layer
    highest = 0  # position of the greatest number of this layer
    for k, value in enumerate(s):
        if value < s[lowest]:
            lowest = k
        if value > s[highest]:
            highest = k
        if direction >= 0 and s[highest] - value > back:
            if direction == 1:
                turns.append(highest)
            direction = -1
            lowest = k
        elif direction <= 0 and value - s[lowest] > back:
            if direction == -1:
                turns.append(lowest)
            direction = 1
            highest = k
    return turns


# ---- drawing -------------------------------------------------------------------------------------


def window(cuts: Sequence[Cut]) -> tuple[tuple[float, float], list[Array]]:
    """Width and height [m] of a window that shows each cut at one scale, and the middles of the
    cuts.

    Returns:
        width and height, which are not zero, and a middle (2,) [m] for each cut.
    """
    boxes = []
    for cut in cuts:
        points = cut.ends.reshape(-1, 2) if len(cut.ends) else np.zeros((1, 2))
        boxes.append((points.min(axis=0), points.max(axis=0)))
    largest_box = np.max([high - low for low, high in boxes], axis=0)
    larger_side = float(largest_box.max()) or 1.0
    size = np.maximum(largest_box, _MIN_SIDE * larger_side) + _MARGIN * larger_side
    return (float(size[0]), float(size[1])), [(low + high) / 2 for low, high in boxes]


def draw_cut(
    cut: Cut,
    size: tuple[float, float],
    middle: Array,
    scale: float,
) -> Array:
    """The image (height, width, 3) in [0, 1] of a cut.

    Args:
        size: width and height of what is shown [m].
        middle: of what is shown (2,) [m].
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure

    from gossamer_fx.records.plot.page import DPI

    inches = [round(side * scale) / DPI for side in size]
    figure = Figure(figsize=(inches[0], inches[1]), dpi=DPI, facecolor="white")
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    colours = [GROUP_COLOURS[kind % len(GROUP_COLOURS)] for kind in cut.kinds]
    lines = LineCollection(list(cut.ends), colors=colours, linewidths=LINE_WIDTH, capstyle="round")
    axes.add_collection(lines)
    half = np.array(size) / 2
    axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axes.set_ylim(middle[1] - half[1], middle[1] + half[1])
    canvas.draw()
    image: Array = np.asarray(canvas.buffer_rgba())[..., :3] / 255
    return image
