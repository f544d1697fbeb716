"""Triangles to pixels, in NumPy: of what covers a pixel, the nearest is kept.

A pixel is one 64-bit number, the distance from the eye in its high 40 bits and the colour (red, green, blue) in its low
24.  The nearer of two is then the smaller number, so that drawing is a minimum and the order of triangles does not
matter.  The background is the largest number: infinitely far, and white.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gossamer_fx.model.body import Array

Colours = npt.NDArray[np.uint8]
Integers = npt.NDArray[np.int64]

_BACKGROUND = np.uint64(0xFFFF_FFFF_FFFF_FFFF)
_FARTHEST = float(2**40 - 2)
_COLOUR_BITS = np.uint64(24)
_CHANNEL_SHIFTS = np.array([16, 8, 0], dtype=np.uint64)
_MAX_SAMPLES = 2_000_000  # pixels that are drawn at once, to bound the memory
# Twice the area [pixels²] below which a triangle is seen on edge: it covers nothing, and has no slopes.
_MIN_TWICE_AREA = 1e-9


class Canvas:
    """An image into which triangles between two distances from the eye are drawn.

    Args:
        height: rows of pixels; row 0 is on top.
        width: columns of pixels.
        near: the smallest distance.
        far: the largest distance.
    """

    def __init__(self, height: int, width: int, near: float, far: float) -> None:
        self.height = height
        self.width = width
        self._near = near
        self._scale = _FARTHEST / (far - near)
        self._pixels = np.full(height * width, _BACKGROUND)
        # distances of the layer in front, up to which nothing is drawn
        self._in_front: npt.NDArray[np.uint64] | None = None

    def behind(self) -> Canvas | None:
        """A canvas for what is behind all that this one shows; None if this one shows nothing."""
        if (self._pixels == _BACKGROUND).all():
            return None
        other = Canvas(self.height, self.width, self._near, self._near + _FARTHEST / self._scale)
        other._in_front = self._pixels >> _COLOUR_BITS
        return other

    def draw(self, corners: Array, shades: Array, kinds: Integers, palette: Colours) -> None:
        """Draw triangles.

        A triangle owns the pixels whose centres lie in it.  Of two triangles that share an edge, one owns a centre on
        that edge.

        Args:
            corners: (n, 3, 3), x to the right and y down in pixels, and the distance from the eye.
            shades: (n, 3), brightness of the corners in [0, 1], linear between them.
            kinds: (n,), row of the palette of each triangle.
            palette: (k, 256, 3), colours of each kind from dark to bright.
        """
        x = corners[..., 0]
        y = corners[..., 1]
        # rows whose centres are in the triangle: top <= row < bottom
        top = np.ceil(y.min(axis=1) - 0.5).clip(0, self.height).astype(np.int64)
        bottom = np.ceil(y.max(axis=1) - 0.5).clip(0, self.height).astype(np.int64)
        in_picture = (bottom > top) & (x.max(axis=1) > 0) & (x.min(axis=1) < self.width)
        seen = np.flatnonzero(in_picture & (abs(_twice_area(x, y)) > _MIN_TWICE_AREA))
        colours = (palette.astype(np.uint64) << _CHANNEL_SHIFTS).sum(axis=2, dtype=np.uint64)
        # a triangle covers about half of its box
        boxes = (bottom - top)[seen] * np.ptp(x[seen].clip(0, self.width), axis=1)
        batch_of = np.floor(np.cumsum(boxes) / (2 * _MAX_SAMPLES))
        for batch in np.split(seen, np.flatnonzero(np.diff(batch_of)) + 1):
            self._draw_batch(
                corners=corners[batch],
                shades=shades[batch],
                kinds=kinds[batch],
                top=top[batch],
                bottom=bottom[batch],
                colours=colours,
            )

    def _draw_batch(
        self,
        corners: Array,
        shades: Array,
        kinds: Integers,
        top: Integers,
        bottom: Integers,
        colours: npt.NDArray[np.uint64],
    ) -> None:
        """Draw triangles row by row; `colours` (kinds, 256) are packed in the low bits."""
        # A row of pixels in a triangle is a span.
        triangle, row = _ranges(top, bottom)
        level = row + 0.5
        left, right = _span_ends(corners[..., 0], corners[..., 1], triangle, level)
        start = np.ceil(left - 0.5).clip(0, self.width).astype(np.int64)
        end = np.ceil(right - 0.5).clip(0, self.width).astype(np.int64)
        span, column = _ranges(start, end)
        depths = (corners[..., 2] - self._near) * self._scale
        depth, depth_slope = _along_spans(corners, depths, triangle, level)
        shade, shade_slope = _along_spans(corners, 255.0 * shades, triangle, level)
        x = column + 0.5
        z = (depth[span] + depth_slope[span] * x).clip(0, _FARTHEST).astype(np.uint64)
        brightness = np.rint(shade[span] + shade_slope[span] * x).clip(0, 255).astype(np.int64)
        colour = colours[kinds[triangle][span], brightness]
        pixel = row[span] * self.width + column
        if self._in_front is not None:
            seen = z > self._in_front[pixel]
            pixel = pixel[seen]
            z = z[seen]
            colour = colour[seen]
        np.minimum.at(self._pixels, pixel, (z << _COLOUR_BITS) | colour)

    def outlined(self, jump: float, strength: float) -> Array:
        """The image, darkened at silhouettes, where the distance jumps.

        Args:
            jump: distance from which on a jump is outlined.  It is measured by the second difference, which is zero on
                any plane, however oblique.
            strength: share of the light that an outline takes.

        Returns:
            Colours (height, width, 3) in [0, 1].
        """
        pixels = self._pixels.reshape(self.height, self.width)
        z = np.pad((pixels >> _COLOUR_BITS).astype(float) / self._scale, 1, mode="edge")
        middle = z[1:-1, 1:-1]
        down = z[:-2, 1:-1] + z[2:, 1:-1] - 2 * middle
        across = z[1:-1, :-2] + z[1:-1, 2:] - 2 * middle
        at_jump = (down > jump) | (across > jump)
        image = ((pixels[..., None] >> _CHANNEL_SHIFTS) & np.uint64(255)).astype(float) / 255
        image[at_jump] *= 1 - strength
        return image


def _ranges(start: Integers, end: Integers) -> tuple[Integers, Integers]:
    """All integers j of the ranges start[i] <= j < end[i], as arrays of i and of j."""
    counts = (end - start).clip(0)
    which = np.repeat(np.arange(len(start)), counts)
    offset = start - (np.cumsum(counts) - counts)
    return which, np.arange(len(which)) + offset[which]


def _twice_area(x: Array, y: Array) -> Array:
    """Twice the signed areas of triangles with corners x and y (n, 3)."""
    area: Array = (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0])
    area -= (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0])
    return area


def _span_ends(x: Array, y: Array, triangle: Integers, level: Array) -> tuple[Array, Array]:
    """Where the lines y = level enter and leave their triangles; both are zero where they miss them.

    Every edge is taken from its upper to its lower end.  Both triangles of an edge then compute the same number, and no
    pixel between them is left out or drawn twice.
    """
    left: Array = np.full(len(level), np.inf)
    right: Array = np.full(len(level), -np.inf)
    every = np.arange(len(x))
    for i, j in ((0, 1), (1, 2), (2, 0)):
        goes_down = (y[:, i] < y[:, j]) | ((y[:, i] == y[:, j]) & (x[:, i] < x[:, j]))
        upper = np.where(goes_down, i, j)
        lower = np.where(goes_down, j, i)
        x_upper = x[every, upper]
        y_upper = y[every, upper]
        y_lower = y[every, lower]
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
    corners: Array, values: Array, triangle: Integers, level: Array
) -> tuple[Array, Array]:
    """A linear function of each triangle on the lines y = level: its value at x = 0, and its slope along x.

    Args:
        corners: (n, 3, 3) of the triangles.
        values: (n, 3), of the function at the corners.
        triangle: (m,), of each line.
        level: (m,), of each line.
    """
    x = corners[..., 0]
    y = corners[..., 1]
    value_1 = values[:, 1] - values[:, 0]
    value_2 = values[:, 2] - values[:, 0]
    x_1 = x[:, 1] - x[:, 0]
    x_2 = x[:, 2] - x[:, 0]
    y_1 = y[:, 1] - y[:, 0]
    y_2 = y[:, 2] - y[:, 0]
    # Cramer's rule for the gradient of the function
    area = _twice_area(x, y)
    slope_x = (value_1 * y_2 - value_2 * y_1) / area
    slope_y = (value_2 * x_1 - value_1 * x_2) / area
    at_origin = values[:, 0] - slope_x * x[:, 0] - slope_y * y[:, 0]
    return at_origin[triangle] + slope_y[triangle] * level, slope_x[triangle]
