"""Pictures of a run's folder: a field at one time or several, an animation, curves."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.checks.arguments import Range, at_least, check_arguments, ends_in
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array
from gossamer_fx.records.fields.units import NAMES, scaled_axis, scaled_unit
from gossamer_fx.records.outputs.output import make_parent, replace_file
from gossamer_fx.records.plot.camera import Camera, View, aim, render
from gossamer_fx.records.plot.colours import (
    NO_LIMITS,
    Colouring,
    Limits,
    by_state,
    colouring,
    sampled,
)
from gossamer_fx.records.plot.curve_panels import run_curves
from gossamer_fx.records.plot.page import WIDTH, Views, write_page
from gossamer_fx.records.plot.run_reader import RunReader
from gossamer_fx.records.plot.shapes import Integers, Shape

Image = np.ndarray  # (height, width, 3) of bytes

# Pictures of a strip, if no number is given.
STRIP_COUNT = 6
# Most pictures in a strip, and longest animation [s].
MAX_PICTURES = 1000
MAX_SECONDS = 3600.0

# The field by which modes are coloured.
MODE_FIELD = "mode_amplitude"
# Share of the largest displacement from which on that along the normals is drawn.
_OUT_OF_PLANE = 0.1

# A picture that is enlarged by less than this factor counts as of the scale of the others.
_SAME_SCALE = 1.05

# ---- animations

# Enough for a smooth motion; more frames make the file larger.
_FRAMES_PER_SECOND = 20

# Pixels of the width of an animation of a wide scene, and their range; of a tall one it is less.
_ANIMATION_PIXELS = 960
_MIN_ANIMATION_PIXELS = 320
_MAX_ANIMATION_PIXELS = 1920

# Most pixels per inch of an animation: more make letters and files large.
_MAX_ANIMATION_DPI = 120

# Least width of the page of an animation, which its key needs, and the height of its picture
# [inches].
_MIN_ANIMATION_WIDTH = 5.0
_ANIMATION_HEIGHT = 5.0

# Least width of the page of a single picture [inches]: a page of full width would be half empty.
_MIN_PICTURE_WIDTH = 7.0

# Height of the letters of the time, and their distance above the image [inches].
_TIME_SIZE = 0.13
_TIME_ABOVE = 0.24

# Colour of the time: that of the text on the page.
_INK = (51, 56, 61)

# Shortest pause between frames [ms]: browsers slow down animations with shorter ones.
_MIN_PAUSE = 20

# Pixels with a channel below this number are drawn on; all others are nearly white.
_SHORT_OF_WHITE = 240

# Bits of red, green and blue by which the colours of a GIF are told apart before its palette is
# made.
_COLOUR_BITS = 7

# Smallest interval of recorded times whose digits are shown, in the unit of the times.
_MIN_INTERVAL = 1e-6


@check_arguments
def field(
    run: RunReader,
    field: str,
    *,
    times: Annotated[Sequence[float], at_least(1)],
    path: str | Path,
    view: View | None = None,
    limits: Limits = NO_LIMITS,
) -> None:
    """Write a PNG of a field at some times, with the same colours and scale.

    Args:
        run: a recorded run.
        field: name of a recorded field, e.g. "state".
        times: [s].
        path: of the file, ending in `.png`.
        view: camera; default: chosen for all times.
        limits: of the colours of numbers.

    Raises:
        InputError: no times, an unknown field, a time outside the run, files of the run that cannot
            be read, or a path that is a folder.
        OutputFailure: the file cannot be written.

    Example:
        >>> picture = folder / "stress.png"
        >>> gx.plot.field(recorded, "stress1", times=[0.0, 0.02], path=picture)
        >>> picture.is_file()
        True
    """
    records = [run.record_at(time) for time in times]
    colours = colouring(run, field, limits, records)
    views = field_views(run, colours, records, view or View())
    width = WIDTH
    if len(records) == 1:
        aspect = views.size[0] / views.size[1]
        width = min(max(_ANIMATION_HEIGHT * aspect, _MIN_PICTURE_WIDTH), WIDTH)
    write_page(file_to_write(path), _title(run, field), views, width=width)


@check_arguments
def strip(
    run: RunReader,
    field: str,
    *,
    path: str | Path,
    count: Annotated[int, Range(1, MAX_PICTURES)] = STRIP_COUNT,
    view: View | None = None,
    limits: Limits = NO_LIMITS,
) -> None:
    """Write a PNG of a field at times that are evenly spread over the run.

    Args:
        run: a recorded run.
        field: name of a recorded field, e.g. "state".
        path: of the file, ending in `.png`.
        count: number of times.
        view: camera; default: chosen for all times.
        limits: of the colours of numbers.

    Raises:
        InputError: an unknown field, a count below one, a run without fields, files of the run that
            cannot be read, or a path that is a folder.
        OutputFailure: the file cannot be written.

    Example:
        >>> picture = folder / "fall.png"
        >>> gx.plot.strip(recorded, "displacement", path=picture, count=2)
        >>> picture.is_file()
        True
    """
    views = strip_views(run, field, count, view or View(), limits)
    write_page(file_to_write(path), _title(run, field), views)


def strip_views(
    run: RunReader,
    field: str,
    count: int,
    view: View,
    limits: Limits = NO_LIMITS,
) -> Views:
    """Pictures of a field at times that are evenly spread over the run."""
    run.require_fields()
    # Equal times, not equal numbers: steps may differ in length.
    evenly = [run.record_at(time) for time in np.linspace(run.times[0], run.times[-1], count)]
    # A run may have fewer records than pictures were asked for.
    records = sorted(set(evenly))
    return field_views(run, colouring(run, field, limits, records), records, view)


def _title(run: RunReader, field: str) -> str:
    """Title of a picture of a field."""
    if field in NAMES:
        name = NAMES[field]
        return f"{run.title}: {name[0].lower()}{name[1:]}"
    return run.title


@check_arguments
def curves(run: RunReader, path: str | Path) -> None:
    """Write a PNG of energies, gas, states of films, iterations and probes over the time.

    Args:
        run: a recorded run.
        path: of the file, ending in `.png`.

    Raises:
        InputError: the run has fewer than two steps, its tables cannot be read, or the path is a
            folder.
        OutputFailure: the file cannot be written.

    Example:
        >>> picture = folder / "curves.png"
        >>> gx.plot.curves(recorded, picture)
        >>> picture.is_file()
        True
    """
    found = run_curves(run)
    check(
        bool(found.panels),
        f"The run in '{run.folder}' has fewer than two steps; let it run before its curves are "
        "drawn.",
    )
    write_page(file_to_write(path), run.title, None, found)


def field_views(
    run: RunReader,
    colours: Colouring,
    records: Sequence[int],
    view: View,
) -> Views:
    """Pictures of the scene in recorded states, coloured by a field.

    Returns:
        captions, size [m], key, and a function that draws the pictures at a number of pixels per
        metre.
    """
    shapes = [colours.shape(run, record) for record in records]
    camera = aim(shapes, view)
    words = captions(run, records, camera.zooms)
    ways = _positions(shapes)
    return Views(
        captions=[
            caption + way + colours.caption(record)
            for caption, way, record in zip(words, ways, records, strict=True)
        ],
        size=camera.size,
        draw=lambda scale: render(camera, shapes, scale, colours),
        colours=colours,
    )


def _positions(shapes: Sequence[Shape]) -> list[str]:
    """Where the middle of a scene is that travels farther than its size, e.g. ", z = 1.7 km": the
    coordinate along which it travels farthest.  Else empty words."""
    if not all(len(shape.points) for shape in shapes):
        return [""] * len(shapes)
    boxes = [(shape.points.min(axis=0), shape.points.max(axis=0)) for shape in shapes]
    middles = np.array([(low + high) / 2 for low, high in boxes])
    largest = max(float((high - low).max()) for low, high in boxes)
    ways = np.ptp(middles, axis=0)
    if ways.max() <= largest:
        return [""] * len(shapes)
    axis = int(ways.argmax())
    values = middles[:, axis]
    factor, unit = scaled_unit(float(abs(values).max()), "m")
    return [f", {'xyz'[axis]} = {value / factor:.4g}\u00a0{unit}" for value in values]


def captions(run: RunReader, records: Sequence[int], zooms: Sequence[float]) -> list[str]:
    """Captions: times of recorded states, and the enlargement of pictures relative to the scale
    bar.

    Args:
        records: indices of the states in `run.times` [s].
    """
    found = []
    for record, zoom in zip(records, zooms, strict=True):
        enlarged = ""
        if zoom > _SAME_SCALE:
            # Spaces at which a long caption is not broken into lines
            enlarged = f", {zoom:.2g}\u00a0times\u00a0larger"
        words = run.caption(record)
        found.append(f"{words}{enlarged}")
    return found


@check_arguments
def modes(
    folders: Annotated[Sequence[str | Path], at_least(1)],
    path: str | Path,
    *,
    view: View | None = None,
) -> None:
    """Write a PNG of vibration modes side by side, each at its largest displacement.

    Films are coloured by their displacement along the normal, with its sign, or by its length where
    they move in their planes.

    Args:
        folders: of the modes, as `outputs.record_modes` returns them.
        path: of the file, ending in `.png`.
        view: camera; default: chosen for all modes.

    Raises:
        InputError: no folder, one that holds no record of a mode, or files that cannot be read.
        OutputFailure: the file cannot be written.

    Example:
        >>> edges = [gx.Fixed(film, edge) for edge in ("left", "right", "bottom", "top")]
        >>> equilibrium = gx.Equilibrium(gx.Scene(film, *edges))
        >>> result = equilibrium.find()
        >>> found = gx.analysis.modes(equilibrium, 2)
        >>> folders = gx.outputs.record_modes(equilibrium, found, folder / "vibrations", frames=4)
        >>> gx.plot.modes(folders, folder / "vibrations.png")
        >>> (folder / "vibrations.png").is_file()
        True
    """
    runs = [RunReader(one) for one in folders]
    for run in runs:
        check(
            run.kind == "mode",
            f"'{run.folder}' holds no record of a mode; give folders that outputs.record_modes "
            "made.",
        )
    # Cables and beams have no such field: they are drawn in one colour.
    colours = by_state(False)
    if runs[0].films:
        # All modes are shown with the same largest displacement, which may be that of a body
        # without a mesh.
        shown = runs[0].about["result"]["largest displacement shown [m]"]
        along_normals = [run.values(f"{MODE_FIELD}_normal", 0) for run in runs]
        largest = max(float(abs(part).max()) for parts in along_normals for part in parts)
        if largest > _OUT_OF_PLANE * shown:
            limits = Limits(low=-float(shown), high=float(shown))
            colours = colouring(runs[0], f"{MODE_FIELD}_normal", limits)
        else:
            colours = colouring(runs[0], MODE_FIELD, Limits(low=0.0, high=float(shown)))
    shapes = [colours.shape(run, 0) for run in runs]
    camera = aim(shapes, replace(view or View(), zoom=False))
    views = Views(
        captions=[run.title for run in runs],
        size=camera.size,
        draw=lambda scale: render(camera, shapes, scale, colours),
        colours=colours,
    )
    write_page(file_to_write(path), "", views)


# ---- animations ----------------------------------------------------------------------------------


@check_arguments
def animate(
    run: RunReader,
    field: str,
    *,
    path: Annotated[str | Path, ends_in(".gif")],
    seconds: Annotated[float, Range(0.0, MAX_SECONDS, "s", above=True)] = 6.0,
    until: float | None = None,
    pixels: Annotated[int, Range(_MIN_ANIMATION_PIXELS, _MAX_ANIMATION_PIXELS)] = _ANIMATION_PIXELS,
    view: View | None = None,
    limits: Limits = NO_LIMITS,
) -> None:
    """Write a GIF of a field over the run, or its beginning.

    Args:
        run: a recorded run.
        field: name of a recorded field, e.g. "state".
        path: of the file, ending in `.gif`; `ffmpeg -i a.gif a.mp4` makes a film of it.
        seconds: length of the animation [s].
        until: time of the run [s] at which it ends; default: the end of the run.
        pixels: width of a wide scene; a tall one has less.  The file grows with its square.
        view: camera; `follow` keeps the scene in the middle, `zoom` has no effect.
            Default: a camera that stands still and sees the whole run.
        limits: of the colours of numbers.

    Raises:
        InputError: a path with another ending, a length that is not positive, a time before the
            run, an unknown field, or files of the run that cannot be read.
        OutputFailure: the file cannot be written.

    Example:
        >>> animation = folder / "fall.gif"
        >>> gx.plot.animate(recorded, "displacement", path=animation, seconds=0.2)
        >>> animation.is_file()
        True
    """
    path = file_to_write(path)
    run.require_fields()
    # No more frames than there are records, but the first and the last one in any case.
    first = float(run.times[0])
    last = float(run.times[-1]) if until is None else min(until, float(run.times[-1]))
    check(
        last >= first,
        f"The run begins at {first:g}, and the animation is to end at {until}; give a later time.",
    )
    shown = int(np.count_nonzero(np.asarray(run.times) <= last))
    count = min(max(shown, 1), max(round(seconds * _FRAMES_PER_SECOND), 2))
    times = np.linspace(first, last, count)
    records = sorted({run.record_at(time) for time in times})
    frames = np.array(records)
    colours = colouring(run, field, limits, records)
    view = replace(view or View(), zoom=False)
    camera = _camera_for_all(run, colours, view)
    images = _images(run, colours, camera, frames, pixels, follow=bool(view.follow))
    _write_gif(path, images, seconds / len(frames))


def _camera_for_all(
    run: RunReader,
    colours: Colouring,
    view: View,
) -> Camera:
    """A camera for one picture at a time, which sees the whole run, or follows each shape."""
    shapes = [colours.shape(run, record) for record in sampled(run)]
    if not view.follow:
        # A camera that stands still sees all points of the run as those of one shape.
        shapes = [Shape(time=0.0, dots=np.concatenate([shape.points for shape in shapes]))]
    camera = aim(shapes, view)
    return replace(camera, centres=camera.centres[:1], zooms=[1.0])


def _images(
    run: RunReader,
    colours: Colouring,
    camera: Camera,
    frames: Integers,
    pixels: int,
    follow: bool,
) -> Iterator[Image]:
    """Yield the frames of an animation: the page is laid out once, then pictures and times are put
    in.

    Args:
        frames: numbers of recorded states.
        pixels: width of a wide scene.
        follow: whether the camera moves with the shapes.

    Yields:
        bytes (height, width, 3).
    """
    # Imported here, as most plots need no images in memory.
    from matplotlib import get_data_path
    from PIL import Image, ImageDraw, ImageFont

    def blank(scale: float) -> list[Array]:
        width, height = camera.size
        return [np.ones((round(height * scale), round(width * scale), 3))]

    file = BytesIO()
    views = Views(captions=[" "], size=camera.size, draw=blank, colours=colours)
    # The page is as wide as its picture: a tall scene would leave most of a wide one empty.
    width = min(max(_ANIMATION_HEIGHT * camera.aspect, _MIN_ANIMATION_WIDTH), WIDTH)
    dpi = min(round(pixels / width), _MAX_ANIMATION_DPI)
    place = write_page(file, run.title, views, dpi=dpi, width=width)
    assert place is not None
    page = Image.open(file).convert("RGB")
    letters = round(_TIME_SIZE * dpi)
    font = ImageFont.truetype(f"{get_data_path()}/fonts/ttf/DejaVuSans.ttf", letters)
    caption = (place.left, place.top - _TIME_ABOVE * dpi)
    factor, _ = scaled_axis(run.axis, run.times)
    # As many digits as tell two records from each other, the same in all frames.
    shortest = max(np.diff(run.times).min(initial=1.0) / factor, _MIN_INTERVAL)
    digits = max(0, 1 - int(np.floor(np.log10(shortest))))
    for frame in frames:
        shape = colours.shape(run, int(frame))
        if follow:
            seen = shape.points @ camera.axes[:2].T
            middle = (seen.min(axis=0) + seen.max(axis=0)) / 2
            centre = (float(middle[0]), float(middle[1]))
            camera = replace(camera, centres=[centre])
        whole = page.copy()
        for image in render(camera, [shape], place.scale, colours):
            bytes_of_image = np.rint(255 * image).astype(np.uint8)
            whole.paste(Image.fromarray(bytes_of_image), (place.left, place.top))
        words = run.caption(int(frame), digits) + colours.caption(int(frame))
        ImageDraw.Draw(whole).text(caption, words, fill=_INK, font=font)
        yield np.asarray(whole)


def _write_gif(path: Path, images: Iterable[Image], pause: float) -> None:
    """Write a GIF.

    Args:
        images: bytes (height, width, 3), all of one size, at least one.
        pause: between two frames [s]; at least 0.02 s are written.
    """
    from PIL import Image

    frames = [Image.fromarray(image) for image in images]
    # One palette for all frames, so that colours do not flicker.
    palette = Image.new("P", (1, 1))
    palette.putpalette([255, 255, 255, *_palette_colours(frames)])
    indexed = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    animation = BytesIO()
    indexed[0].save(
        animation,
        format="GIF",
        save_all=True,
        append_images=indexed[1:],
        duration=max(round(1000 * pause), _MIN_PAUSE),
        loop=0,
        optimize=False,
    )
    replace_file(path, animation.getvalue())


def _palette_colours(frames: Sequence[Any]) -> list[int]:
    """Red, green and blue of at most 255 colours of all frames, as one list of numbers from 0 to
    255.

    Each colour counts once, however many pixels it has: a few slack cells in one frame of a hundred
    stay blue.  White is left out, which is a colour of the palette by itself."""
    from PIL import Image

    step = 8 - _COLOUR_BITS
    found = set()
    for frame in frames:
        pixels = np.asarray(frame).reshape(-1, 3)
        is_drawn = (pixels < _SHORT_OF_WHITE).any(axis=1)
        coarse = (pixels[is_drawn] >> step).astype(np.int64)
        numbers = (coarse[:, 0] << 2 * _COLOUR_BITS) | (coarse[:, 1] << _COLOUR_BITS) | coarse[:, 2]
        found.update(np.unique(numbers).tolist())
    numbers = np.array(sorted(found), dtype=np.int64)
    mask = (1 << _COLOUR_BITS) - 1
    channels = [numbers >> 2 * _COLOUR_BITS, numbers >> _COLOUR_BITS & mask, numbers & mask]
    # The middle of the interval that the remaining bits leave.
    colours = ((np.stack(channels, axis=1) << step) + (1 << step) // 2).astype(np.uint8)
    if not len(colours):
        return []
    drawn = Image.fromarray(colours[None])
    palette = drawn.quantize(255, method=Image.Quantize.MEDIANCUT).getpalette() or []
    return list(palette[: 3 * 255])


def file_to_write(path: str | Path) -> Path:
    """The path of a file to be written, with its folder made."""
    path = Path(path)
    make_parent(MPI.COMM_SELF, path, file=True)
    return path
