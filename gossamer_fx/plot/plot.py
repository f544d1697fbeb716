"""Pictures of a run's folder: a field at one time or several, an animation, curves."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import InputError, OutputFailure, check
from gossamer_fx.model.body import Array
from gossamer_fx.plot.camera import Camera, aim, render
from gossamer_fx.plot.colours import Colouring, colouring, sampled
from gossamer_fx.plot.curve_panels import run_curves
from gossamer_fx.plot.page import Views, write_page
from gossamer_fx.plot.run_reader import RunReader
from gossamer_fx.plot.shapes import Integers, Shape
from gossamer_fx.plot.units import NAMES, scaled
from gossamer_fx.plot.viewpoint import View

Image = np.ndarray  # (height, width, 3) of bytes

# ---- animations
_FRAMES_PER_SECOND = 20
_ANIMATION_DPI = 80  # of a page that is 12 inches wide: 960 pixels
_TIME_SIZE = 0.13  # height of the letters of the time [inches]
_TIME_ABOVE = 0.24  # above the image [inches]
_INK = (51, 56, 61)
_MIN_PAUSE = 20  # ms; browsers slow down animations with shorter ones
_SHORT_OF_WHITE = 250  # brightness of pixels on which something is drawn
_PALETTE_FRAMES = 6  # whose colours make the palette of a GIF


@check_arguments
def field(
    run: RunReader,
    field: str,
    *,
    times: Sequence[float],
    path: str | Path,
    view: View | None = None,
) -> None:
    """Write a PNG of a field at some times, with the same colours and scale.

    Args:
        run: what was recorded.
        field: name of a recorded field, e.g. "state".
        times: [s].
        path: `.png`.
        view: from where the scene is seen; default: chosen for all times.

    Raises:
        InputError: an unknown field, a time outside the run.
        OutputFailure: the file cannot be written.

    Example:
        `gx.plot.field(gx.plot.RunReader("out/run"), "stress1", times=[0.0, 0.1], path="s.png")`
    """
    check(
        bool(len(times)),
        "There are no times of which to draw a picture; give one or more in seconds.",
    )
    _write_frames(run, field, [run.frame(time) for time in times], path, view)


@check_arguments
def strip(
    run: RunReader, field: str, *, path: str | Path, count: int = 6, view: View | None = None
) -> None:
    """Write a PNG of a field at `count` times that are evenly spread over the run; else as `field`."""
    check(count >= 1, f"The number of pictures is {count!r}; give one or more.")
    run.frame(run.times[0] if len(run.times) else 0.0)  # refuses a run without fields
    evenly = np.rint(np.linspace(0, len(run.times) - 1, count))
    _write_frames(run, field, np.unique(evenly.astype(int)).tolist(), path, view)


@check_arguments
def curves(run: RunReader, path: str | Path) -> None:
    """Write a PNG of ledger, gas, states of films, iterations and probes over the time.

    Raises:
        InputError: the run has fewer than two steps.
        OutputFailure: the file cannot be written.
    """
    found = run_curves(run)
    check(
        bool(found.panels),
        f"The run in '{run.folder}' has fewer than two steps; let it run before its curves are drawn.",
    )
    write_page(file_to_write(path), run.title, None, found)


def _write_frames(
    run: RunReader, field: str, frames: Sequence[int], path: str | Path, view: View | None
) -> None:
    title = f"{run.title}: {NAMES[field].lower()}" if field in NAMES else run.title
    views = field_views(run, field, colouring(run, field), frames, view or View())
    write_page(file_to_write(path), title, views)


def field_views(
    run: RunReader, field: str, colours: Colouring, frames: Sequence[int], view: View
) -> Views:
    """The scene in some recorded states, coloured by a field."""
    shapes = [run.shape(frame, field, colours.kinds) for frame in frames]
    camera = aim(shapes, view)
    return Views(
        captions=captions(run, frames, camera.zooms),
        size=camera.size,
        draw=lambda scale: render(camera, shapes, scale, colours.table),
        key=colours.key,
    )


def captions(run: RunReader, frames: Sequence[int], zooms: Sequence[float]) -> list[str]:
    """The times of recorded states, and how much larger than the scale bar says their pictures are."""
    factor, prefix = scaled(float(run.times[-1]))
    found = []
    for frame, zoom in zip(frames, zooms, strict=True):
        enlarged = f", {zoom:.2g} times larger" if zoom > 1.05 else ""
        found.append(f"t = {run.times[frame] / factor:.4g} {prefix}s{enlarged}")
    return found


# ---- animations -----------------------------------------------------------------------------------------------------


@check_arguments
def animate(
    run: RunReader, field: str, *, path: str | Path, seconds: float = 6.0, view: View | None = None
) -> None:
    """Write a GIF, or an MP4 if `ffmpeg` is installed, of a field over the run.

    Args:
        run: what was recorded.
        field: as of `field`.
        path: `.gif` or `.mp4`.
        seconds: length of the animation.
        view: from where the scene is seen; `follow` keeps it in the middle, `zoom` has no effect.  Default: a camera
            that stands still and sees the whole run.

    Raises:
        InputError: a name that ends in neither, no ffmpeg, an unknown field.
        OutputFailure: the file cannot be written.
    """
    path = file_to_write(path)
    check(
        path.suffix in (".gif", ".mp4"),
        f"An animation cannot be written to '{path}'; end its name in .gif or .mp4.",
    )
    check(
        path.suffix == ".gif" or shutil.which("ffmpeg") is not None,
        f"'{path}' needs ffmpeg, which is not on the PATH; install it, or write a .gif.",
    )
    check(seconds > 0, f"An animation of {seconds!r} s cannot be made; give its length in seconds.")
    run.frame(run.times[0] if len(run.times) else 0.0)  # refuses a run without fields
    count = min(len(run.times), max(round(seconds * _FRAMES_PER_SECOND), 2))
    times = np.linspace(run.times[0], run.times[-1], count)
    frames = np.unique([run.frame(time) for time in times])
    colours = colouring(run, field)
    view = replace(view or View(), zoom=False)
    camera = _camera_for_all(run, field, colours, view)
    images = _images(run, field, colours, camera, frames, follow=bool(view.follow))
    if path.suffix == ".gif":
        _write_gif(path, images, seconds / len(frames))
    else:
        _write_mp4(path, images, len(frames) / seconds)


def _camera_for_all(run: RunReader, field: str, colours: Colouring, view: View) -> Camera:
    """A camera for one picture at a time: it sees the whole run and stands still or, if it follows, each shape."""
    shapes = [run.shape(frame, field, colours.kinds) for frame in sampled(run)]
    if not view.follow:
        # all points of the run as those of one shape
        shapes = [Shape(time=0.0, dots=np.concatenate([shape.points for shape in shapes]))]
    camera = aim(shapes, view)
    return replace(camera, centres=camera.centres[:1], zooms=[1.0])


def _images(
    run: RunReader,
    field: str,
    colours: Colouring,
    camera: Camera,
    frames: Integers,
    follow: bool,
) -> Iterator[Image]:
    """The frames of an animation; the page is laid out once, then pictures and times are put into it."""
    from matplotlib import get_data_path
    from PIL import Image, ImageDraw, ImageFont

    def blank(scale: float) -> list[Array]:
        return [np.ones((round(camera.size[1] * scale), round(camera.size[0] * scale), 3))]

    file = BytesIO()
    views = Views(captions=[" "], size=camera.size, draw=blank, key=colours.key)
    place = write_page(file, run.title, views, dpi=_ANIMATION_DPI)
    assert place is not None
    written = Image.open(file).convert("RGB")
    # MP4 needs an even number of rows
    page = Image.new("RGB", (written.width, 2 * ((written.height + 1) // 2)), "white")
    page.paste(written, (0, 0))
    letters = round(_TIME_SIZE * _ANIMATION_DPI)
    font = ImageFont.truetype(f"{get_data_path()}/fonts/ttf/DejaVuSans.ttf", letters)
    caption = (place.left, place.top - _TIME_ABOVE * _ANIMATION_DPI)
    factor, prefix = scaled(float(run.times[-1]))
    shortest = max(np.diff(run.times).min(initial=1.0) / factor, 1e-6)
    digits = max(0, 1 - int(np.floor(np.log10(shortest))))
    for frame in frames:
        shape = run.shape(int(frame), field, colours.kinds)
        if follow:
            seen = shape.points @ camera.axes[:2].T
            middle = (seen.min(axis=0) + seen.max(axis=0)) / 2
            camera = replace(camera, centres=[(float(middle[0]), float(middle[1]))])
        whole = page.copy()
        for image in render(camera, [shape], place.scale, colours.table):
            whole.paste(
                Image.fromarray(np.rint(255 * image).astype(np.uint8)), (place.left, place.top)
            )
        words = f"t = {shape.time / factor:.{digits}f} {prefix}s"
        ImageDraw.Draw(whole).text(caption, words, fill=_INK, font=font)
        yield np.asarray(whole)


def _write_gif(path: Path, images: Iterable[Image], pause: float) -> None:
    """Write a GIF whose frames stand for `pause` seconds."""
    from PIL import Image

    frames = [Image.fromarray(image) for image in images]
    # One palette for all frames, so that colours do not flicker: white, and what is drawn on some of them.
    some = frames[:: max(len(frames) // _PALETTE_FRAMES, 1)]
    pixels = np.concatenate([np.asarray(frame).reshape(-1, 3) for frame in some])
    drawn = Image.fromarray(pixels[(pixels < _SHORT_OF_WHITE).any(axis=1)][None])
    colours = drawn.quantize(255, method=Image.Quantize.MEDIANCUT).getpalette() or []
    palette = Image.new("P", (1, 1))
    palette.putpalette([255, 255, 255, *colours[: 3 * 255]])
    indexed = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    try:
        indexed[0].save(
            path,
            save_all=True,
            append_images=indexed[1:],
            duration=max(round(1000 * pause), _MIN_PAUSE),
            loop=0,
            optimize=False,
        )
    except OSError as error:
        raise OutputFailure(
            f"Cannot write '{path}' ({error.strerror}); choose a folder that is writable."
        ) from error


def _write_mp4(path: Path, images: Iterator[Image], rate: float) -> None:
    """Write an MP4 with `rate` frames a second."""
    first = next(images)
    height, width = first.shape[:2]
    command = ["ffmpeg", "-y", "-loglevel", "error"]
    command += ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}"]
    command += ["-r", f"{rate:.6g}", "-i", "-"]
    # colours that all players know, and the index in front, so that a browser plays while it loads
    command += ["-pix_fmt", "yuv420p", "-movflags", "+faststart", str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as encoder:
        assert encoder.stdin is not None
        assert encoder.stderr is not None
        try:
            for image in (first, *images):
                encoder.stdin.write(image.tobytes())
            encoder.stdin.close()
        except BrokenPipeError:  # it has ended; the reason is in its messages
            pass
        messages = encoder.stderr.read().decode(errors="replace").strip().splitlines()
    if encoder.returncode:
        reason = messages[-1] if messages else "no reason given"
        raise OutputFailure(f"ffmpeg could not write '{path}' ({reason}); try a .gif.")


def file_to_write(path: str | Path) -> Path:
    """The path of a file, with its folder made.

    Raises:
        InputError: the folder cannot be made, or the path is a folder.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"Cannot write '{path}' ({error.strerror}); choose a folder that is writable."
        ) from error
    check(not path.is_dir(), f"Cannot write '{path}', which is a folder; give the name of a file.")
    return path
