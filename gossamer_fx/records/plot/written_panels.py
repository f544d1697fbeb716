"""Pictures of plain panels, without a scene: responses, errors, spreads of answers."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

from gossamer_fx.core.checks.errors import output_failures
from gossamer_fx.records.outputs.output import replace_file

RESOLUTION = 120  # dots per inch


@contextmanager
def written_panels(
    path: str | Path, size: tuple[float, float], rows: int, columns: int = 1, **shared: Any
) -> Iterator[Any]:
    """Axes (rows, columns) that are written when the block ends, to a file that is replaced as a
    whole.

    Args:
        path: of the file, a PNG unless it ends otherwise; its folder is made.
        size: width and height [inch].
        rows: number of rows of panels.
        columns: number of columns of panels.
        shared: axes that panels share, see `Figure.subplots` of matplotlib.

    Raises:
        OutputFailure: the file cannot be written.
    """
    # Imported here, as only pictures need it.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    yield figure.subplots(rows, columns, squeeze=False, **shared)
    path = Path(path)
    with output_failures(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    picture = BytesIO()
    figure.savefig(picture, format=path.suffix[1:] or "png", dpi=RESOLUTION)
    replace_file(path, picture.getvalue())
