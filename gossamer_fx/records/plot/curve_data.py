"""The curves of a run as data for `curves.js`, which draws them in a page with a cursor.

The panels are the functions that draw the picture of the curves: they draw on axes of matplotlib
that nobody renders, from which lines, areas and limits are read.  So picture and page show the
same.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from gossamer_fx.core.model.body import Array
from gossamer_fx.records.plot.curve_panels import Curves
from gossamer_fx.records.plot.packing import packed

# Lines with a name of matplotlib's own begin so.
_UNNAMED = "_"


def curve_data(curves: Curves, records: Array) -> dict[str, Any]:
    """The panels of a run for `curves.js`.

    Args:
        curves: of the run, see `run_curves`.
        records: positions (n,) of the recorded states that the view shows on the axis of the
            curves, in its unit.

    Returns:
        label and ends of the axis, the positions, and of each panel its title, limits, lines and
        areas; numbers are packed, logarithms of those on a logarithmic axis.
    """
    import matplotlib
    from matplotlib.figure import Figure

    panels = []
    # Without margins at the sides, as on the page of the picture.
    with matplotlib.rc_context({"axes.xmargin": 0, "axes.titlelocation": "left"}):
        for draw in curves.panels:
            axes = Figure().subplots()
            draw(axes)
            panels.append(_panel(axes))
    return {
        "label": curves.label,
        "start": curves.start,
        "end": curves.end,
        "records": [float(f"{x:.8g}") for x in records],
        "panels": panels,
    }


def _panel(axes: Any) -> dict[str, Any]:
    """Title, limits, lines and areas of a panel that was drawn on axes of matplotlib."""
    is_log = axes.get_yscale() == "log"
    low, high = axes.get_ylim()
    lines = []
    for line in axes.lines:
        y = np.asarray(line.get_ydata(), dtype=float)
        if is_log:
            # A logarithm of zero is a gap.
            y = np.log10(np.where(y > 0, y, np.nan))
        x = np.asarray(line.get_xdata(), dtype=float)
        lines.append(
            {
                "name": _named(line.get_label()),
                "colour": line.get_color(),
                "faint": bool((line.get_alpha() or 1.0) < 1.0),
                "xy": packed(np.stack([x, y], axis=1)),
            }
        )
    areas = []
    for area in axes.collections:
        [red, green, blue, alpha] = area.get_facecolor()[0]
        for path in area.get_paths():
            corners = np.array(path.vertices)
            if is_log:
                corners[:, 1] = np.log10(np.where(corners[:, 1] > 0, corners[:, 1], np.nan))
            areas.append(
                {
                    "name": _named(area.get_label()),
                    "colour": f"rgb({255 * red:.0f},{255 * green:.0f},{255 * blue:.0f})",
                    "alpha": float(alpha),
                    "xy": packed(corners),
                }
            )
    return {
        "title": axes.get_title(loc="left").replace("\\$", "$").replace("\n", " "),
        "log": is_log,
        "low": float(np.log10(low) if is_log else low),
        "high": float(np.log10(high) if is_log else high),
        "lines": lines,
        "areas": areas,
    }


def _named(label: object) -> str:
    """The name of a line or an area; empty for one that matplotlib named."""
    name = str(label)
    return "" if name.startswith(_UNNAMED) else name
