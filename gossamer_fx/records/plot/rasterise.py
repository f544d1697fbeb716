"""Rasterisation of triangles with hidden surfaces, in NumPy.

Problem.  Of all triangles that cover a pixel, the nearest is visible; loops over triangles or
pixels in Python would be slow.

Idea.  A pixel is one integer of 64 bits: the distance from the eye in its high 40 bits, the colour
(red, green, blue) in its low 24.  The nearer of two is then the smaller integer, so that drawing is
a minimum and does not depend on the order of the triangles.  The background is the largest integer:
farthest, and white.

Algorithm of `Canvas.draw`.

1. Find the rows of pixels that each triangle covers, and in each row its span of columns.
2. For each span, the distance and the brightness are linear functions of the column.
3. Pack distance and colour of all pixels of all spans, and take the minimum with the image.

Cost.  Proportional to the pixels that are covered, in batches of bounded memory.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gossamer_fx.core.model.body import Array

Colours = npt.NDArray[np.uint8]
Integers = npt.NDArray[np.int64]

_BACKGROUND = np.uint64(0xFFFF_FFFF_FFFF_FFFF)

# The largest distance of a triangle as an integer, one less than that of the background.
_FARTHEST = float(2**40 - 2)

_COLOUR_BITS = np.uint64(24)
_WHITE = np.uint64(0xFF_FFFF)
_BLACK = np.uint64(0)

# Bits of red, green and blue above the lowest one.
_CHANNEL_SHIFTS = np.array([16, 8, 0], dtype=np.uint64)

# Pixels that are drawn at once, to bound the memory.
_MAX_SAMPLES = 2_000_000

# Pixels across which two lines of a hatch, a bright and a dark one, return, and of one line.
_HATCH_PITCH = 16
_HATCH_LINE = 2

# Twice the area [pixels²] below which a triangle is seen on edge: it covers nothing, and has no
# slopes.
_MIN_TWICE_AREA = 1e-9


class Canvas:
    """An image into which triangles between two distances from the eye are drawn."""

    def __init__(
        self,
        height: int,
        width: int,
        near: float,
        far: float,
    ) -> None:
        self.height = height
        self.width = width
        self._near = near
        self._scale = _FARTHEST / (far - near)
        self._pixels = np.full(height * width, _BACKGROUND)

    def draw(
        self,
        corners: Array,
        shades: Array,
        kinds: Integers,
        palette: Colours,
        is_hatched: npt.NDArray[np.bool_] | None = None,
    ) -> None:
        """Draw triangles.

        A triangle owns the pixels whose centres lie in it.  Of two triangles that share an edge,
        exactly one owns a centre on that edge.

        Args:
            corners: (n, 3, 3), x to the right and y down in pixels, and the distance from the eye.
            shades: (n, 3), brightness of the corners in [0, 1], linear between them.
            kinds: (n,), row of the palette of each triangle.
            palette: (k, 256, 3), colours of each kind from dark to bright.
            is_hatched: (n,), whether white and black lines are drawn on a triangle; None: on none.
        """
        if is_hatched is None:
            is_hatched = np.zeros(len(kinds), dtype=bool)
        x = corners[..., 0]
        y = corners[..., 1]
        # Rows whose centres are in the triangle: top <= row < bottom.
        top = np.ceil(y.min(axis=1) - 0.5).clip(0, self.height).astype(np.int64)
        bottom = np.ceil(y.max(axis=1) - 0.5).clip(0, self.height).astype(np.int64)
        is_in_rows = bottom > top
        is_in_columns = (x.max(axis=1) > 0) & (x.min(axis=1) < self.width)
        has_area = abs(_twice_area(x, y)) > _MIN_TWICE_AREA
        seen = np.flatnonzero(is_in_rows & is_in_columns & has_area)
        channels = palette.astype(np.uint64) << _CHANNEL_SHIFTS
        colours = channels.sum(axis=2, dtype=np.uint64)
        # A triangle covers about half of the box around it.
        widths = np.ptp(x[seen].clip(0, self.width), axis=1)
        boxes = (bottom - top)[seen] * widths
        batch_of = np.floor(np.cumsum(boxes) / (2 * _MAX_SAMPLES))
        first_of_batches = np.flatnonzero(np.diff(batch_of)) + 1
        for batch in np.split(seen, first_of_batches):
            self._draw_batch(
                corners=corners[batch],
                shades=shades[batch],
                kinds=kinds[batch],
                is_hatched=is_hatched[batch],
                top=top[batch],
                bottom=bottom[batch],
                colours=colours,
            )

    def _draw_batch(
        self,
        corners: Array,
        shades: Array,
        kinds: Integers,
        is_hatched: npt.NDArray[np.bool_],
        top: Integers,
        bottom: Integers,
        colours: npt.NDArray[np.uint64],
    ) -> None:
        """Draw n triangles row by row into the image.

        Args:
            corners: (n, 3, 3): x to the right and y down [pixels], and the distance from the eye.
            shades: brightness (n, 3) of the corners in [0, 1].
            kinds: row (n,) of each triangle in `colours`.
            is_hatched: whether (n,) lines are drawn on it.
            top: first row (n,) of pixels that each triangle covers.
            bottom: row (n,) after the last one.
            colours: (kinds, 256), red, green and blue packed in the low 24 bits, from dark to
                bright.
        """
        # A row of pixels in a triangle is a span; its centres are at half-integers.
        triangle, row = _ranges(top, bottom)
        level = row + 0.5
        left, right = _span_ends(corners[..., 0], corners[..., 1], triangle, level)
        start = np.ceil(left - 0.5).clip(0, self.width).astype(np.int64)
        end = np.ceil(right - 0.5).clip(0, self.width).astype(np.int64)

        # Distance and brightness of each pixel of each span.
        span, column = _ranges(start, end)
        x = column + 0.5
        depths = (corners[..., 2] - self._near) * self._scale
        depth, depth_slope = _along_spans(corners, depths, triangle, level)
        shade, shade_slope = _along_spans(corners, 255.0 * shades, triangle, level)
        distance = depth[span] + depth_slope[span] * x
        light = shade[span] + shade_slope[span] * x
        # Round-off in a narrow triangle may exceed the range of its corners.
        z = distance.clip(0, _FARTHEST).astype(np.uint64)
        brightness = np.rint(light).clip(0, 255).astype(np.int64)

        kind = kinds[triangle][span]
        colour = colours[kind, brightness]
        if is_hatched.any():
            # Lines of the image, not of the film: they have one width in all pictures.
            position = (row[span] + column) % _HATCH_PITCH
            position = np.where(is_hatched[triangle][span], position, _HATCH_PITCH)
            colour = np.where(position < 2 * _HATCH_LINE, _BLACK, colour)
            colour = np.where(position < _HATCH_LINE, _WHITE, colour)
        pixel = row[span] * self.width + column
        # A batch may have several triangles in one pixel; an assignment would keep an arbitrary
        # one.
        packed = (z << _COLOUR_BITS) | colour
        np.minimum.at(self._pixels, pixel, packed)

    def outlined(self, jump: float, strength: float) -> Array:
        """The image, darkened at silhouettes, where the distance jumps.

        Returns:
            Colours (height, width, 3) in [0, 1].
        """
        pixels = self._pixels.reshape(self.height, self.width)
        distances = (pixels >> _COLOUR_BITS).astype(float) / self._scale
        # With repeated edges, the margin of the image is not outlined.
        z = np.pad(distances, 1, mode="edge")
        middle = z[1:-1, 1:-1]
        down = z[:-2, 1:-1] + z[2:, 1:-1] - 2 * middle
        across = z[1:-1, :-2] + z[1:-1, 2:] - 2 * middle
        at_jump = (down > jump) | (across > jump)
        channels = (pixels[..., None] >> _CHANNEL_SHIFTS) & np.uint64(255)
        image = channels.astype(float) / 255
        image[at_jump] *= 1 - strength
        return image


def _ranges(start: Integers, end: Integers) -> tuple[Integers, Integers]:
    """All integers j of the ranges start[i] <= j < end[i], as arrays of i and of j."""
    counts = (end - start).clip(0)
    which = np.repeat(np.arange(len(start)), counts)
    # Numbered through all ranges, the first integer of range i has the number of all before it.
    numbers_before = np.cumsum(counts) - counts
    offset = start - numbers_before
    return which, np.arange(len(which)) + offset[which]


def _twice_area(x: Array, y: Array) -> Array:
    """Twice the signed areas of triangles with corners x and y (n, 3)."""
    area: Array = (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0])
    area -= (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0])
    return area


def _span_ends(
    x: Array,
    y: Array,
    triangle: Integers,
    level: Array,
) -> tuple[Array, Array]:
    """The x at which the lines y = level enter and leave their triangles.

    Args:
        x: of the corners of n triangles, (n, 3) [pixels].
        y: of the corners, (n, 3) [pixels].
        triangle: index of the triangle of each line, (m,).
        level: y of each line, (m,) [pixels].

    Returns:
        left and right x (m,) [pixels]; both are zero where a line misses its triangle.
    """
    left: Array = np.full(len(level), np.inf)
    right: Array = np.full(len(level), -np.inf)
    every = np.arange(len(x))
    for i, j in ((0, 1), (1, 2), (2, 0)):
        # Every edge is taken from its upper to its lower end.  Both triangles of an edge then
        # compute the same number, and no pixel between them is left out or drawn twice.
        is_level = y[:, i] == y[:, j]
        goes_down = (y[:, i] < y[:, j]) | (is_level & (x[:, i] < x[:, j]))
        upper = np.where(goes_down, i, j)
        lower = np.where(goes_down, j, i)
        x_upper = x[every, upper]
        y_upper = y[every, upper]
        y_lower = y[every, lower]
        # No line crosses an edge without height, so that its slope is not used.
        height = np.where(y_lower > y_upper, y_lower - y_upper, 1.0)
        slope = (x[every, lower] - x_upper) / height
        crosses = (y_upper[triangle] <= level) & (level < y_lower[triangle])
        crossing = x_upper[triangle] + (level - y_upper[triangle]) * slope[triangle]
        left = np.where(crosses, np.fmin(left, crossing), left)
        right = np.where(crosses, np.fmax(right, crossing), right)
    missed = left > right
    left[missed] = 0.0
    right[missed] = 0.0
    return left, right


def _along_spans(
    corners: Array,
    values: Array,
    triangle: Integers,
    level: Array,
) -> tuple[Array, Array]:
    """A linear function of each triangle on the lines y = level.

    Args:
        corners: (n, 3, 3) of the triangles, of which x and y [pixels] are used; none is seen on
            edge.
        values: (n, 3), of the function at the corners, in any unit.
        triangle: index (m,) of the triangle of each line.
        level: y (m,) of each line [pixels].

    Returns:
        the value (m,) at x = 0, and the slope (m,) along x per pixel.
    """
    x = corners[..., 0]
    y = corners[..., 1]
    value_1 = values[:, 1] - values[:, 0]
    value_2 = values[:, 2] - values[:, 0]
    x_1 = x[:, 1] - x[:, 0]
    x_2 = x[:, 2] - x[:, 0]
    y_1 = y[:, 1] - y[:, 0]
    y_2 = y[:, 2] - y[:, 0]
    # Cramer's rule for the gradient of the function.  The area is not zero: triangles seen on edge
    # are not drawn.
    area = _twice_area(x, y)
    slope_x = (value_1 * y_2 - value_2 * y_1) / area
    slope_y = (value_2 * x_1 - value_1 * x_2) / area
    at_origin = values[:, 0] - slope_x * x[:, 0] - slope_y * y[:, 0]
    at_left = at_origin[triangle] + slope_y[triangle] * level
    return at_left, slope_x[triangle]
