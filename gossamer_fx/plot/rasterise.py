"""Triangles to pixels, in NumPy: every rank draws its own, and the nearer pixel wins.

A pixel is one 64-bit number, the distance from the eye in its high 40 bits and the colour (red, green, blue) in its
low 24.  The nearer of two is then the smaller, so that drawing a triangle and combining the images of all ranks are
one operation, a minimum: no rank sees another's triangles, and neither order nor partition matters.  The background
is the largest number, infinitely far and white.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from gossamer_fx.model.body import Array

Colours = npt.NDArray[np.uint8]

_BACKGROUND = np.uint64(0xFFFF_FFFF_FFFF_FFFF)
_FARTHEST = float(2**40 - 2)
_COLOUR_BITS = np.uint64(24)
_SAMPLES = 2_000_000  # drawn at once, to bound the memory


class Canvas:
    """An image of `height` × `width` pixels (row 0 on top) that triangles between two depths are drawn into."""

    def __init__(self, height: int, width: int, near: float, far: float) -> None:
        self.height, self.width = height, width
        self._near, self._scale = near, _FARTHEST / (far - near)
        self._pixels = np.full(height * width, _BACKGROUND)
        self._before: npt.NDArray[np.uint64] | None = None  # depths up to which nothing is drawn

    def behind(self, comm: MPI.Intracomm) -> Canvas | None:
        """A canvas that shows what is behind all that rank 0's shows; none if that shows nothing."""
        comm.Bcast(self._pixels)
        if (self._pixels == _BACKGROUND).all():
            return None
        other = Canvas(self.height, self.width, self._near, self._near + _FARTHEST / self._scale)
        other._before = self._pixels >> _COLOUR_BITS
        return other

    def draw(
        self, corners: Array, shades: Array, kinds: npt.NDArray[np.int64], palette: Colours
    ) -> None:
        """Draw triangles: those with a pixel's centre inside own it, and no two that share an edge both do.

        corners (n, 3, 3): x to the right and y down in pixels, distance from the eye
        shades (n, 3): brightness of the corners in [0, 1], linear between them
        kinds (n,): row of the palette of each triangle
        palette (k, 256, 3): colours of each kind from dark to bright
        """
        x, y = corners[..., 0], corners[..., 1]
        top = np.ceil(y.min(axis=1) - 0.5).clip(0, self.height).astype(np.int64)
        bottom = np.ceil(y.max(axis=1) - 0.5).clip(0, self.height).astype(np.int64)
        seen = (
            (bottom > top)
            & (x.max(axis=1) > 0)
            & (x.min(axis=1) < self.width)
            & (abs(_twice_area(x, y)) > 1e-9)
        )
        box = ((bottom - top) * np.ptp(x.clip(0, self.width), axis=1))[seen]
        batches = np.floor(np.cumsum(box) / (2 * _SAMPLES))
        corners, shades, kinds, top, bottom = (
            a[seen] for a in (corners, shades, kinds, top, bottom)
        )
        lookup = (palette.astype(np.uint64) << np.array([16, 8, 0], dtype=np.uint64)).sum(
            axis=2, dtype=np.uint64
        )
        for batch in np.split(np.arange(len(batches)), np.flatnonzero(np.diff(batches)) + 1):
            self._draw(
                corners[batch], shades[batch], kinds[batch], top[batch], bottom[batch], lookup
            )

    def _draw(
        self,
        corners: Array,
        shades: Array,
        kinds: npt.NDArray[np.int64],
        top: npt.NDArray[np.int64],
        bottom: npt.NDArray[np.int64],
        lookup: npt.NDArray[np.uint64],
    ) -> None:
        # a line of each triangle: from the left edge to the right one
        triangle, row = _expand(top, bottom)
        level: Array = row.astype(np.float64) + 0.5
        left, right = _edges(corners[..., 0], corners[..., 1], triangle, level)
        first = np.ceil(left - 0.5).clip(0, self.width).astype(np.int64)
        last = np.ceil(right - 0.5).clip(0, self.width).astype(np.int64)
        line, column = _expand(first, last)
        # depth and shade are linear: the value on a line at x = 0, and the slope along it
        depth, depth_slope = _along_lines(
            corners, (corners[..., 2] - self._near) * self._scale, triangle, level
        )
        shade, shade_slope = _along_lines(corners, shades * 255.0, triangle, level)
        x = column + 0.5
        z = (depth[line] + depth_slope[line] * x).clip(0, _FARTHEST).astype(np.uint64)
        s = np.rint(shade[line] + shade_slope[line] * x).clip(0, 255).astype(np.int64)
        colour = lookup.ravel()[(kinds[triangle] * lookup.shape[1])[line] + s]
        places = (row * self.width)[line] + column
        if self._before is not None:
            seen = z > self._before[places]
            places, z, colour = places[seen], z[seen], colour[seen]
        np.minimum.at(self._pixels, places, (z << _COLOUR_BITS) | colour)

    def combine(self, comm: MPI.Intracomm) -> Canvas:
        """The image of all ranks together, on rank 0; on the others this rank's own."""
        whole = Canvas(self.height, self.width, self._near, self._near + _FARTHEST / self._scale)
        comm.Reduce(self._pixels, whole._pixels if comm.rank == 0 else None, op=MPI.MIN)
        return whole

    def outlined(self, jump: float, strength: float) -> Array:
        """Colours (height, width, 3) in [0, 1], darkened where the depth jumps by more than `jump`: at silhouettes.

        A jump is measured by the second difference, which is zero on any plane, however oblique.
        """
        pixels = self._pixels.reshape(self.height, self.width)
        z = (pixels >> _COLOUR_BITS).astype(float) / self._scale
        z = np.pad(z, 1, mode="edge")
        behind = np.zeros((self.height, self.width), dtype=bool)
        for a, b in ((z[:-2, 1:-1], z[2:, 1:-1]), (z[1:-1, :-2], z[1:-1, 2:])):
            behind |= a + b - 2 * z[1:-1, 1:-1] > jump
        shifts = np.array([16, 8, 0], dtype=np.uint64)
        colours = ((pixels[..., None] >> shifts) & np.uint64(255)).astype(float) / 255
        colours[behind] *= 1 - strength
        return colours


def _expand(
    start: npt.NDArray[np.int64], end: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.int64], ...]:
    """All integers of the ranges start[i] ≤ j < end[i], as (i, j)."""
    count = (end - start).clip(0)
    which = np.repeat(np.arange(len(start)), count)
    offset = start - (np.cumsum(count) - count)
    return which, np.arange(len(which)) + offset[which]


def _twice_area(x: Array, y: Array) -> Array:
    area: Array = (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (
        y[:, 1] - y[:, 0]
    )
    return area


def _edges(
    x: Array, y: Array, triangle: npt.NDArray[np.int64], level: Array
) -> tuple[Array, Array]:
    """Where the lines y = level enter and leave their triangles.

    Edges are taken from their upper to their lower end, so that both triangles of an edge find the same number.
    """
    left: Array = np.full(len(level), np.inf)
    right: Array = np.full(len(level), -np.inf)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        down = (y[:, i] < y[:, j]) | ((y[:, i] == y[:, j]) & (x[:, i] < x[:, j]))
        upper, lower = np.where(down, i, j), np.where(down, j, i)
        every = np.arange(len(x))
        xu, yu, xl, yl = x[every, upper], y[every, upper], x[every, lower], y[every, lower]
        slope = (xl - xu) / np.where(yl > yu, yl - yu, 1.0)
        crosses = (yu[triangle] <= level) & (level < yl[triangle])
        at = xu[triangle] + (level - yu[triangle]) * slope[triangle]
        left, right = (
            np.where(crosses, np.fmin(left, at), left),
            np.where(crosses, np.fmax(right, at), right),
        )
    return np.where(left <= right, left, 0.0), np.where(left <= right, right, 0.0)


def _along_lines(
    corners: Array, values: Array, triangle: npt.NDArray[np.int64], level: Array
) -> tuple[Array, Array]:
    """A linear function of each triangle, given at its corners, on the lines y = level: value at x = 0, slope."""
    x, y = corners[..., 0], corners[..., 1]
    d1, d2 = values[:, 1] - values[:, 0], values[:, 2] - values[:, 0]
    x1, x2, y1, y2 = x[:, 1] - x[:, 0], x[:, 2] - x[:, 0], y[:, 1] - y[:, 0], y[:, 2] - y[:, 0]
    area = _twice_area(x, y)
    dx, dy = (d1 * y2 - d2 * y1) / area, (d2 * x1 - d1 * x2) / area
    constant = values[:, 0] - dx * x[:, 0] - dy * y[:, 0]
    return constant[triangle] + dy[triangle] * level, dx[triangle]
