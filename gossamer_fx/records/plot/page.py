"""The page of a picture: a title, images of the scene with a key and a scale bar, and curves below.

matplotlib lays the page out (its engine "constrained").  Images are drawn when their position is
known, with as many pixels as that rectangle has, so that they are not resampled.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gossamer_fx.core.model.body import Array
from gossamer_fx.records.fields.units import plain_text
from gossamer_fx.records.outputs.output import replace_file
from gossamer_fx.records.plot.colours import MISSING_COLOUR, Colouring
from gossamer_fx.records.plot.curve_panels import INK, Curves

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

DPI = 150  # pixels per inch

# ---- lengths in inches
WIDTH = 12.0
_TITLE = 0.45
_KEY = 0.45  # height of the line with key and scale bar, of which a narrow page has two
_NARROW = 6.0  # width of a page below which key and scale bar do not fit into one line
_CAPTION = 0.35  # height of the line above an image
_CAPTION_LINE = 0.16  # height of a further line of a caption
_LETTER = 0.075  # width of a letter of a caption, of wide ones: a little more than the mean
_MAX_IMAGES = 4.8  # height of all images together
_PANEL = 2.9  # height of a panel with its title and axis
_PAD = 0.1  # around everything
_GAP = 3 * _PAD  # between images, about

_TICK_LETTER = 0.07  # width of a letter of the numbers at the bar of a scale
_TIP = 0.12  # of the triangles at its ends
_BAR_SPACE = 0.18  # left and right of the bar, for the triangles
_BAR_SHARE = 0.25  # width of the bar, of the width of the page

# Points of the letters of the title, on a wide and on a narrow page.
_TITLE_SIZE = 13
_SMALL_TITLE_SIZE = 10
_TITLE_LETTER = 0.0088  # width of one of its letters [inches], for each point of their size
_LINE = 0.0175  # distance of its lines [inches], for each point
_MAX_TITLE_LINES = 4

# Inches of a panel with its labels, at least.
_PANEL_WIDTH = 3.8
# Power of the number of rows by which the size of images counts less: full rows and few are
# preferred.
_FEW_ROWS = 0.35
_STYLE = {
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.linewidth": 0.6,
    # Numbers at an axis are whole: nothing is to be added to them in mind.
    "axes.formatter.useoffset": False,
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
class Views:
    """Images of one size that a page shows.

    Attributes:
        captions: of each image.
        size: width and height of what each image shows [m].
        draw: makes the images (height, width, 3) in [0, 1] at a number of pixels per metre.
        colours: of what is shown, for the legend.
    """

    captions: Sequence[str]
    size: tuple[float, float]
    draw: Callable[[float], Iterable[Array]]
    colours: Colouring


@dataclass(frozen=True)
class Place:
    """Where the first image of a page is: columns from the left, rows from the top, and pixels per
    metre."""

    left: int
    top: int
    scale: float


def write_page(
    path: Path | BytesIO,
    title: str,
    views: Views | None = None,
    curves: Curves | None = None,
    dpi: int = DPI,
    width: float = WIDTH,
) -> Place | None:
    """Write a page of images and curves as PNG.

    Args:
        width: of the page [inches]; letters have the same size in pages of any width.

    Returns:
        Where the first image is [pixels], and its scale [pixels/m]; None without images.
    """
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    panels = [] if curves is None else curves.panels
    panel_columns = max(int(width / _PANEL_WIDTH), 1)
    panel_rows = math.ceil(len(panels) / panel_columns)
    image_rows, image_columns = _arrange(views, width)
    size = _TITLE_SIZE if width >= WIDTH else _SMALL_TITLE_SIZE
    title_lines = _title_lines(title, width, size)
    title_height = 0.0
    if title_lines:
        title_height = _TITLE + (len(title_lines) - 1) * _LINE * size
    heights = []
    if views is not None:
        image_height = _image_height(views, image_rows, image_columns, width)
        caption_height = _caption_height(views, image_columns, width)
        key_height = 2 * _KEY if width < _NARROW else _KEY
        heights += [key_height, image_rows * (caption_height + image_height)]
    if curves is not None and curves.key is not None:
        heights.append(_KEY)
    if panels:
        heights.append(panel_rows * _PANEL)
    with matplotlib.rc_context(_STYLE):
        figure = Figure(
            figsize=(width, sum(heights) + title_height),
            dpi=dpi,
            facecolor="white",
            layout=ConstrainedLayoutEngine(w_pad=_PAD, h_pad=_PAD),
        )
        FigureCanvasAgg(figure)
        if title_lines:
            figure.suptitle("\n".join(title_lines), x=_PAD / width, ha="left", size=size)
        parts = iter(figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0])
        place = None
        if views is not None:
            header = next(parts).subplots()
            _draw_key(header, views.colours, width)
            frames = _frames(next(parts), views, image_rows, image_columns, width)
        if curves is not None and curves.key is not None:
            curves.key(next(parts).subplots())
        if curves is not None and panels:
            _draw_panels(next(parts), curves, panel_rows)
        if views is not None:
            figure.draw_without_rendering()
            figure.set_layout_engine("none")  # it is laid out
            place = _draw_images(figure, frames, views)
            corner = "lower right" if width < _NARROW else "center right"
            _draw_scale_bar(header, place.scale, views.size[0], corner)
        picture = BytesIO()
        figure.savefig(picture, format="png", dpi=dpi)
    if isinstance(path, BytesIO):
        path.write(picture.getvalue())
    else:
        replace_file(path, picture.getvalue())
    return place


def _title_lines(title: str, width: float, size: float) -> list[str]:
    """The title in lines that are no wider than the page; a very long one loses its end.

    Args:
        width: of the page [inches].
        size: of the letters [points].
    """
    letters = max(int((width - 2 * _PAD) / (_TITLE_LETTER * size)), 1)
    lines = textwrap.wrap(plain_text(title), letters)
    if len(lines) > _MAX_TITLE_LINES:
        lines = lines[:_MAX_TITLE_LINES]
        lines[-1] = f"{lines[-1][: letters - 1]}…"
    return lines


# ---- images --------------------------------------------------------------------------------------


def _arrange(views: Views | None, page_width: float) -> tuple[int, int]:
    """Rows and columns in which images become largest; full rows and few are preferred.

    Args:
        page_width: [inches].
    """
    if views is None:
        return 0, 0
    count = len(views.captions)
    best = 1
    best_score = 0.0
    for columns in range(1, count + 1):
        rows = math.ceil(count / columns)
        width = _image_height(views, rows, columns, page_width) * views.size[0] / views.size[1]
        # Width of an image, less for positions that stay empty and for more rows.
        score = width * count / (columns * rows) / rows**_FEW_ROWS
        if score > best_score:
            best = columns
            best_score = score
    return math.ceil(count / best), best


def _image_height(
    views: Views,
    rows: int,
    columns: int,
    page_width: float,
) -> float:
    """Height of an image [inches] that is as wide as its column, or as high as the rows allow.

    Args:
        page_width: [inches].
    """
    width = page_width / columns - _GAP
    # A narrow page is scrolled: its images may be higher together.
    highest = _MAX_IMAGES * max(WIDTH / page_width, 1.0)
    caption_height = _caption_height(views, columns, page_width)
    return min(width * views.size[1] / views.size[0], highest / rows - caption_height)


def _wrapped_captions(views: Views, columns: int, page_width: float) -> list[str]:
    """The captions in lines that are no wider than a column of images.

    Args:
        page_width: [inches].
    """
    letters = max(int((page_width / columns - _GAP) / _LETTER), 1)
    return [textwrap.fill(plain_text(caption), letters) for caption in views.captions]


def _caption_height(views: Views, columns: int, page_width: float) -> float:
    """Height [inches] of the captions above a row of images.

    Args:
        page_width: [inches].
    """
    captions = _wrapped_captions(views, columns, page_width)
    most_lines = max(caption.count("\n") + 1 for caption in captions)
    return _CAPTION + (most_lines - 1) * _CAPTION_LINE


def _frames(
    part: SubFigure,
    views: Views,
    rows: int,
    columns: int,
    page_width: float,
) -> list[Axes]:
    """Empty axes with captions, for the images, from the upper left.

    Args:
        page_width: [inches].
    """
    grid = part.subplots(rows, columns, squeeze=False).ravel()
    for axes in grid:
        axes.set_axis_off()
        axes.set_box_aspect(views.size[1] / views.size[0])
        axes.set_anchor("NW")
    captions = _wrapped_captions(views, columns, page_width)
    for axes, caption in zip(grid, captions, strict=False):
        axes.set_title(caption)
    return list(grid[: len(views.captions)])


def _draw_images(figure: Figure, frames: Sequence[Axes], views: Views) -> Place:
    """Draw images to whole pixels in the rectangles that the layout has found.

    Returns:
        where the first image is, and its scale [pixels/m].
    """
    boxes = [axes.get_window_extent() for axes in frames]
    scale = boxes[0].width / views.size[0]
    first: Place | None = None
    for box, image in zip(boxes, views.draw(scale), strict=True):
        height = image.shape[0]
        left = round(box.x0)
        bottom = round(box.y1) - height
        figure.figimage(image, xo=left, yo=bottom, origin="upper")
        if first is None:
            top = round(figure.bbox.height) - bottom - height
            first = Place(left=left, top=top, scale=scale)
    assert first is not None
    return first


# ---- key and scale bar ---------------------------------------------------------------------------


def _draw_key(header: Axes, colours: Colouring, page_width: float) -> None:
    """Draw what colours mean at the left end of the line above the images: a bar, or names.

    Args:
        page_width: [inches].
    """
    from matplotlib.patches import Patch

    header.set_axis_off()
    swatches = [
        Patch(facecolor=colour, edgecolor=INK, lw=0.6, label=plain_text(name))
        for name, colour in colours.names.items()
    ]
    if colours.has_slack:
        swatches.append(Patch(facecolor="white", edgecolor=INK, lw=0.6, hatch="/////"))
        swatches[-1].set_label("slack")
    if colours.has_missing:
        swatches.append(Patch(facecolor=MISSING_COLOUR, edgecolor=INK, lw=0.6, label="no value"))
    is_narrow = page_width < _NARROW
    swatches_at = (0.0, 0.5)
    swatches_from = "center left"
    if colours.scale is not None:
        left_of_bar = _BAR_SPACE / page_width
        # The number at the end of the bar is centred there.
        half_number = _TICK_LETTER * (len(colours.scale.ends[1]) / 2 + 1) / page_width
        right_of_bar = left_of_bar + _BAR_SHARE + max(left_of_bar, half_number)
        words = colours.scale.label[1]
        if colours.scale.beyond and not colours.scales:
            words += f"; {colours.scale.beyond}"
        bar_bottom = 0.35
        bar_height = 0.4
        words_at = (right_of_bar, 0.55)
        swatches_at = (right_of_bar, 0.5)
        swatches_from = "upper left"
        if is_narrow:
            bar_bottom = 0.2
            bar_height = 0.2
            words_at = (0.0, 0.75)
        bar = header.inset_axes((left_of_bar, bar_bottom, _BAR_SHARE, bar_height))
        _draw_bar(bar, colours, _BAR_SHARE * page_width)
        is_above = is_narrow or bool(swatches)
        header.text(
            *words_at,
            plain_text(words),
            va="bottom" if is_above else "center",
            transform=header.transAxes,
        )
    elif is_narrow:
        swatches_at = (0.0, 1.0)
        swatches_from = "upper left"
    if swatches:
        header.legend(
            swatches,
            # names that begin with "_" would be left out
            [f" {patch.get_label()}" for patch in swatches],
            loc=swatches_from,
            bbox_to_anchor=swatches_at,
            ncols=len(swatches),
            columnspacing=1.2,
            frameon=False,
            handlelength=1.0,
            handleheight=1.0,
            borderaxespad=0.0,
            borderpad=0.0,
        )


def _draw_bar(bar: Axes, colours: Colouring, width: float) -> None:
    """Draw the colours of a scale, with numbers at both ends, and triangles where values are
    beyond them.

    Args:
        colours: with a scale.
        width: of the bar [inches].
    """
    from matplotlib.ticker import LogLocator, MaxNLocator

    scale = colours.scale
    assert scale is not None
    table = colours.table[:-1]
    bar.imshow(table[None], aspect="auto", extent=(0, 1, 0, 1))
    # Each picture has its own ends, which its caption says.
    ends = ("low", "high")
    inner: Array = np.zeros(0)
    factor, _ = scale.label
    if not colours.scales:
        ends = scale.ends
        locator = LogLocator() if scale.log else MaxNLocator(4)
        inner = np.asarray(locator.tick_values(scale.low / factor, scale.high / factor))
    at = scale.parts(inner * factor)
    numbers = [f"{value:.4g}" for value in inner]
    longest = max(len(number) for number in (*ends, *numbers))
    gap = _TICK_LETTER * (longest + 1) / width
    is_apart = (at > gap) & (at < 1 - gap)
    if (np.diff(at[is_apart]) < gap).any():
        is_apart[:] = False
    labels = [ends[0], *np.array(numbers)[is_apart], ends[1]]
    bar.set(yticks=[])
    if scale.low == scale.high:
        bar.set_xticks([0.0], labels[:1])
    else:
        bar.set_xticks([0.0, *at[is_apart], 1.0], labels)
    bar.tick_params(axis="x", labelsize=7.5, pad=1.5)
    bar.spines[:].set_visible(False)
    tip = _TIP / width
    for is_beyond, base, point, colour in zip(
        scale.clipped, (0.0, 1.0), (-tip, 1 + tip), (table[0], table[-1]), strict=True
    ):
        if is_beyond and not colours.scales:
            bar.fill([base, point, base], [0, 0.5, 1], color=colour, lw=0, clip_on=False)
    bar.set(xlim=(0, 1), ylim=(0, 1))


def _draw_scale_bar(header: Axes, scale: float, width: float, corner: str) -> None:
    """Draw a bar of a round length, at most 0.3 of the width of an image, in the line above the
    images.

    Args:
        scale: of the images [pixels/m].
        width: of an image [m].
        corner: name of the position for matplotlib.
    """
    from matplotlib.transforms import IdentityTransform
    from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar

    longest = 0.3 * width
    power = 10.0 ** math.floor(math.log10(longest))
    length = max(factor * power for factor in (1.0, 2.0, 5.0) if factor * power <= longest)
    if length < 0.01:
        name = f"{length * 1e3:g} mm"
    elif length < 1:
        name = f"{length * 1e2:g} cm"
    else:
        name = f"{length:g} m"
    header.add_artist(
        AnchoredSizeBar(
            IdentityTransform(),  # a length in pixels
            length * scale,
            name,
            loc=corner,
            frameon=False,
            color=INK,
            sep=4,
            borderpad=0.0,
            pad=0.0,
        )
    )


# ---- curves --------------------------------------------------------------------------------------


def _draw_panels(part: SubFigure, curves: Curves, rows: int) -> None:
    """Draw all panels of curves in a grid."""
    columns = math.ceil(len(curves.panels) / rows)
    grid = part.subplots(rows, columns, squeeze=False).ravel()
    for axes in grid[len(curves.panels) :]:
        axes.remove()
    for axes, draw in zip(grid, curves.panels, strict=False):
        draw(axes)
        axes.minorticks_off()  # they would take half of the time of a page with logarithmic axes
        axes.set(xlabel=plain_text(curves.label), xlim=(curves.start, curves.end))
