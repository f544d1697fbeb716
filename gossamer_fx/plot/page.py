"""The page of a picture: where captions, images, scale bar and curves stand.  Lengths are inches."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gossamer_fx.model.body import Array
from gossamer_fx.plot.colours import Scale
from gossamer_fx.plot.curve_panels import INK, Panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DPI = 150
_WIDTH, _MARGIN, _GAP = 12.0, 0.5, 0.2
_TITLE, _HEADER, _CAPTION, _MOST = 0.45, 0.4, 0.3, 4.8
_AXIS, _PANEL, _BESIDE, _TICKS, _COLUMNS = 0.5, 2.1, 1.15, 0.45, 4
_BAR = 3.0
_STYLE = {
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.titlepad": 8,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.xmargin": 0,
    "lines.linewidth": 1.4,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 3,
    "ytick.major.size": 3,
    "ytick.minor.size": 0,
    **dict.fromkeys(
        ("axes.edgecolor", "axes.labelcolor", "text.color", "xtick.color", "ytick.color"), INK
    ),
}


@dataclass(frozen=True)
class Grid:
    """Images of one size in rows."""

    columns: int
    rows: int
    width: float
    height: float


def arrange(n: int, aspect: float) -> Grid:
    """The grid in which n images of the given width over height become largest; full rows and few are preferred."""

    def grid(columns: int) -> Grid:
        rows = math.ceil(n / columns)
        width = (_WIDTH - 2 * _MARGIN - (columns - 1) * _GAP) / columns
        height = min(width / aspect, _MOST / rows - _CAPTION)
        return Grid(columns, rows, height * aspect, height)

    return max(
        map(grid, range(1, n + 1)), key=lambda g: g.width * n / (g.columns * g.rows) / g.rows**0.35
    )


def write(
    path: Path | BytesIO,
    title: str,
    images: Sequence[tuple[str, Array]],
    grid: Grid,
    metre: float,
    key: dict[str, Any] | Scale,
    panels: Sequence[Panel],
    time: tuple[float, float, str],
) -> tuple[int, int]:
    """Write a page as PNG; returns the pixel (to the right, down) where the first image begins.

    Args:
        images: captions and images (height, width, 3), none or as many as the grid holds.
        metre: its length in the images.
        key: names and colours of what the images show, or their scale.
        panels: curves, at most four in a row.
        time: start and end of the curves, and their unit.
    """
    import matplotlib

    top = _TITLE if title else 0.15
    block = _HEADER + grid.rows * (_CAPTION + grid.height + _GAP) if images else 0.0
    rows = math.ceil(len(panels) / _COLUMNS)
    columns = math.ceil(len(panels) / max(rows, 1))
    row = _AXIS + _PANEL + _TICKS
    with matplotlib.rc_context(_STYLE):
        page = _Page(top + block + row * rows)
        if title:
            page.text(_MARGIN, _TITLE / 2, title, size=13)
        if images:
            if isinstance(key, Scale):
                page.bar(top + _HEADER / 2, key)
            else:
                page.key(top + _HEADER / 2, key)
            page.scale_bar(top + _HEADER / 2, metre, grid.width)
        step = (_WIDTH - 2 * _MARGIN + _GAP) / grid.columns
        for i, (caption, image) in enumerate(images):
            x = _MARGIN + (i % grid.columns) * step
            y = top + _HEADER + (i // grid.columns) * (_CAPTION + grid.height + _GAP)
            page.text(x, y + _CAPTION / 2, caption)
            page.image(x, y + _CAPTION, grid, image)
        width = (_WIDTH - 2 * _MARGIN) / max(columns, 1)
        for i, panel in enumerate(panels):
            y = top + block + row * (i // columns) + _AXIS
            axes = page.axes(_MARGIN + i % columns * width, y, width - _BESIDE, _PANEL)
            panel(axes)
            axes.set(xlabel=f"t [{time[2]}]", xlim=time[:2])
        page.figure.savefig(path, format="png")
    return round(_MARGIN * DPI), round((top + _HEADER + _CAPTION) * DPI)


class _Page:
    """A figure on which places are measured from the top left."""

    def __init__(self, height: float) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self.height = height
        self.figure = Figure(figsize=(_WIDTH, height), dpi=DPI, facecolor="white")
        FigureCanvasAgg(self.figure)

    def axes(self, x: float, y: float, width: float, height: float) -> Axes:
        place = (x / _WIDTH, 1 - (y + height) / self.height, width / _WIDTH, height / self.height)
        return self.figure.add_axes(place)

    def text(self, x: float, y: float, text: str, **style: Any) -> float:
        """Write from x on, centred at height y; returns where it ends."""
        written = self.figure.text(x / _WIDTH, 1 - y / self.height, text, va="center", **style)
        end: float = written.get_window_extent().x1 / DPI
        return end

    def image(self, x: float, y: float, grid: Grid, image: Array) -> None:
        axes = self.axes(x, y, grid.width, grid.height)
        axes.imshow(image, aspect="auto", interpolation="nearest")
        axes.set_axis_off()

    def key(self, y: float, key: dict[str, Any]) -> None:
        x = _MARGIN
        for name, colour in key.items():
            axes = self.axes(x, y - 0.07, 0.14, 0.14)
            axes.set_facecolor(colour)
            axes.set(xticks=[], yticks=[])
            axes.spines[:].set_visible(True)
            x = self.text(x + 0.21, y, name) + 0.3

    def bar(self, y: float, scale: Scale) -> None:
        """Colours of a scale, with its ends and middle and its name."""
        factor, label = scale.label
        axes = self.axes(_MARGIN, y - 0.07, _BAR, 0.12)
        axes.imshow(
            scale.table[None], aspect="auto", extent=(scale.low / factor, scale.high / factor, 0, 1)
        )
        axes.set(yticks=[])
        axes.locator_params(axis="x", nbins=4)
        axes.tick_params(axis="x", labelsize=7.5, pad=1.5)
        axes.spines[:].set_visible(False)
        self.text(_MARGIN + _BAR + 0.25, y, label)

    def scale_bar(self, y: float, metre: float, width: float) -> None:
        """A round length of about a quarter of an image."""
        target = 0.3 * width / metre
        power = 10.0 ** math.floor(math.log10(target))
        length = max(f * power for f in (1.0, 2.0, 5.0) if f * power <= target)
        name = (
            f"{length * 1e3:g} mm"
            if length < 0.01
            else f"{length * 1e2:g} cm"
            if length < 1
            else f"{length:g} m"
        )
        right = _WIDTH - _MARGIN
        axes = self.axes(right - length * metre, y - 0.05, length * metre, 0.1)
        axes.spines["bottom"].set_visible(False)
        axes.set(xticks=[], yticks=[], xlim=(0, 1), ylim=(-1, 1))
        axes.plot([0, 0, 0, 1, 1, 1], [-1, 1, 0, 0, -1, 1], color=INK, linewidth=1, clip_on=False)
        axes.spines["left"].set_visible(False)
        self.text(right - length * metre - 0.1, y, name, ha="right")
