"""Errors against CPU time and against the size of cells or steps: observed orders and pictures."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from gossamer_fx.core.checks.errors import OutputFailure
from gossamer_fx.core.model.body import Array

Numbers = Sequence[float] | Array

# A panel and the names of curves next to it [inch].
PANEL_WIDTH = 4.5
PANEL_HEIGHT = 3.3
NAME_HEIGHT = 0.165
RESOLUTION = 110  # dots per inch

# On an axis of a smaller ratio of the ends the usual ticks of a logarithmic axis are few.
WIDE_RATIO = 20.0

# Lines of the curves of one colour.
LINES = ("o-", "s--", "^:")
MAX_TEN_COLOURS = 10


@dataclass(frozen=True)
class ErrorCurve:
    """Errors of one quantity, or its values, on cells or with steps of several sizes.

    Attributes:
        name: of the curve.
        seconds: CPU times (n,) [s].
        errors: relative errors (n,).
        sizes: h of the cells or steps (n,); empty: there is no panel over h.
        colour_group: curves of the same group have one colour and different lines; default: the
            curve has its own colour.
    """

    name: str
    seconds: Numbers
    errors: Numbers
    sizes: Numbers = ()
    colour_group: str = ""


def observed_order(
    coarse_error: float, fine_error: float, coarse_size: float, fine_size: float
) -> float:
    """Order p of errors that fall like h^p from one size to another; NaN where there is none."""
    if not (coarse_error > 0 and fine_error > 0 and coarse_size != fine_size):
        return math.nan
    return math.log(coarse_error / fine_error) / math.log(coarse_size / fine_size)


def draw_error_curves(
    path: str | Path,
    rows: Mapping[str, Sequence[ErrorCurve]],
    title: str = "",
    are_errors: bool = True,
) -> None:
    """Draw a row of panels for each quantity: errors over CPU time, and over h if it is known.

    Args:
        path: of the PNG; its folder is made.
        rows: curves by the label of their axis.
        title: of the picture.
        are_errors: whether the vertical axis is logarithmic.

    Raises:
        OutputFailure: the file cannot be written.
    """
    # Imported here, as only pictures need it.
    from matplotlib import colormaps
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.ticker import NullFormatter

    has_sizes = any(len(curve.sizes) > 0 for curves in rows.values() for curve in curves)
    columns = 2 if has_sizes else 1
    count = max((len(curves) for curves in rows.values()), default=0)
    height = max(PANEL_HEIGHT, NAME_HEIGHT * count) * len(rows) + 0.4
    # A third column is for the names.
    figure = Figure(
        figsize=(PANEL_WIDTH * columns + 2.0, height), facecolor="white", layout="constrained"
    )
    FigureCanvasAgg(figure)
    panels = figure.subplots(len(rows), columns, squeeze=False, sharex="col", sharey="row")
    for (label, curves), axes in zip(rows.items(), panels, strict=True):
        groups = list(dict.fromkeys(curve.colour_group or curve.name for curve in curves))
        palette = colormaps["tab10" if len(groups) <= MAX_TEN_COLOURS else "tab20"]
        drawn: dict[str, int] = {}
        for curve in curves:
            group = curve.colour_group or curve.name
            line = LINES[drawn.get(group, 0) % len(LINES)]
            drawn[group] = drawn.get(group, 0) + 1
            colour = palette(groups.index(group) % palette.N)
            style = {"color": colour, "markersize": 4, "label": curve.name}
            axes[0].plot(curve.seconds, curve.errors, line, **style)
            if has_sizes:
                axes[1].plot(curve.sizes, curve.errors, line, **style)
        axes[0].set_ylabel(label)
        for panel in axes:
            panel.set_xscale("log")
            if are_errors:
                panel.set_yscale("log")
            panel.grid(True, which="both", alpha=0.25)
        axes[-1].legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    panels[-1, 0].set_xlabel("CPU time without compilation [s]")
    if has_sizes:
        panels[-1, 1].set_xlabel("h")
        sizes = sorted({h for curves in rows.values() for curve in curves for h in curve.sizes})
        if sizes and sizes[-1] < WIDE_RATIO * sizes[0]:
            panels[-1, 1].set_xticks(sizes, [f"{h:.2g}" for h in sizes])
            panels[-1, 1].xaxis.set_minor_formatter(NullFormatter())
    if title:
        figure.suptitle(title, fontsize=10)
    try:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=RESOLUTION)
    except OSError as error:
        raise OutputFailure(
            f"Cannot write '{path}' ({error.strerror}); choose a folder that is writable."
        ) from error
