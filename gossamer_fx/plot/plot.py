"""Pictures of a run's folder: a field at one time or several, an animation, curves."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import InputError, OutputFailure, check
from gossamer_fx.fields.fields import STATES
from gossamer_fx.model.body import Array
from gossamer_fx.plot.camera import BY_STATE, STATE_COLOURS, Camera, aim, enlarged, render
from gossamer_fx.plot.colours import NAMES, Scale, scale
from gossamer_fx.plot.curve_panels import scaled
from gossamer_fx.plot.page import DPI, arrange, write
from gossamer_fx.plot.run_curves import run_curves
from gossamer_fx.plot.run_reader import RunReader
from gossamer_fx.plot.view import Integers, Shape
from gossamer_fx.plot.viewpoint import View

ALONE = MPI.COMM_SELF
_SAMPLES = 24  # frames that decide on scale and camera
_FRAME_WIDTH, _FRAMES_PER_SECOND = 960, 20


@dataclass(frozen=True)
class Colouring:
    """How triangles are coloured: by state, by a scale, or all alike; `table` has a row (red, green, blue) a kind."""

    key: dict[str, Any] | Scale
    table: Array

    def kinds(self, values: Array) -> Integers:
        """Rows of the table for values (n,)."""
        if isinstance(self.key, Scale):
            return self.key.bins(np.nan_to_num(values))
        # films without states are drawn as taut
        found: Integers = np.rint(
            np.where(np.isfinite(values), values, max(STATES.values()))
        ).astype(np.int64)
        return found


def default_field(run: RunReader) -> str:
    """The state of films, or else what there is."""
    known = run.known_fields()
    check(bool(known), f"The run in '{run.folder}' has no bodies on a mesh; plot its curves.")
    return "state" if "state" in known else known[0]


@check_arguments
def field(
    run: RunReader,
    field: str,
    *,
    times: Sequence[float],
    path: str | Path,
    view: View | None = None,
) -> None:
    """PNG of a field at some times, at one scale of colours.

    Args:
        run: what was recorded.
        field: name of a recorded field, or "state".
        times: [s].
        path: `.png`.
        view: from where; default: one that is chosen for all times, and one scale.

    Raises:
        InputError: an unknown field, a time outside the run.
    """
    _write_field(run, field, times, path, view)


def _write_field(
    run: RunReader, field: str, times: Sequence[float], path: str | Path, view: View | None
) -> None:
    check(
        bool(len(times)),
        "There are no times of which to draw a picture; give one or more in seconds.",
    )
    frames = [run.frame(t) for t in times]
    colours = colouring(run, field)
    shapes = [run.shape(k, field, colours.kinds) for k in frames]
    camera = aim(ALONE, shapes, view or View())
    grid = arrange(len(shapes), camera.size[0] / camera.size[1])
    metre = grid.width / camera.size[0]
    images = render(ALONE, camera, shapes, metre * DPI, colours.table)
    factor, prefix = scaled(float(run.times[-1]))
    captions = [
        f"t = {shape.time / factor:.4g} {prefix}s{enlarged(zoom)}"
        for shape, zoom in zip(shapes, camera.zooms, strict=True)
    ]
    title = f"{run.title}: {NAMES[field].lower()}" if field in NAMES else run.title
    write(
        file_to_write(path),
        title,
        list(zip(captions, images, strict=True)),
        grid,
        metre,
        colours.key,
        [],
        (0, 1, ""),
    )


@check_arguments
def strip(
    run: RunReader, field: str, *, path: str | Path, count: int = 6, view: View | None = None
) -> None:
    """PNG of a field at `count` times, evenly spread over the run; `view` as of `field`."""
    check(count >= 1, f"The number of pictures is {count!r}; give one or more.")
    frames = np.unique(np.rint(np.linspace(0, len(run.times) - 1, count)).astype(int))
    run.frame(run.times[0] if len(run.times) else 0.0)
    _write_field(run, field, run.times[frames].tolist(), path, view)


@check_arguments
def curves(run: RunReader, path: str | Path) -> None:
    """PNG of ledger, gas and probes over the time."""
    panels, times, unit = run_curves(run)
    check(
        bool(panels),
        f"The run in '{run.folder}' has fewer than two steps; let it run before its curves are drawn.",
    )
    write(file_to_write(path), run.title, [], arrange(1, 1.0), 1.0, {}, panels, (*times, unit))


@check_arguments
def animate(
    run: RunReader, field: str, *, path: str | Path, seconds: float = 6.0, view: View | None = None
) -> None:
    """GIF, or MP4 if `ffmpeg` is at hand, of a field over the run.

    Args:
        run: what was recorded.
        field: as of `field`.
        path: `.gif` or `.mp4`.
        seconds: length of the animation.
        view: from where; `follow` keeps the shape in the middle, `zoom` is not for animations.  Default: a camera that
            stands still and sees the whole run.

    Raises:
        InputError: a name that ends in neither, no ffmpeg, an unknown field.
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
    run.frame(run.times[0] if len(run.times) else 0.0)
    count = min(len(run.times), max(round(seconds * _FRAMES_PER_SECOND), 2))
    evenly = np.linspace(run.times[0], run.times[-1], count)
    frames = np.unique([run.frame(t) for t in evenly])
    colours = colouring(run, field)
    view = replace(view or View(), zoom=False)
    camera = _camera(run, field, colours, view)
    images = _frames(run, field, colours, camera, frames, bool(view.follow))
    if path.suffix == ".gif":
        _gif(path, images, seconds / len(frames))
    else:
        _mp4(path, images, len(frames) / seconds)


# ---- how ----------------------------------------------------------------------------------------------------------


def colouring(run: RunReader, field: str) -> Colouring:
    """The colours of a field, on one scale for the whole run.

    Raises:
        InputError: an unknown field.
    """
    run.check_field(field)
    if field == "state" or not run.films:
        names = ("taut", "wrinkled", "slack") if run.films else ()
        return Colouring({name: STATE_COLOURS[STATES[name]] for name in names}, BY_STATE)
    samples = [values.mean(axis=1) for k in _sampled(run) for values in run.values(field, k)]
    found = scale(field, samples)
    return Colouring(found, found.table)


def _sampled(run: RunReader) -> list[int]:
    last = len(run.times) - 1
    return sorted({round(k) for k in np.linspace(0, last, min(_SAMPLES, last + 1))})


def _camera(run: RunReader, field: str, colours: Colouring, view: View) -> Camera:
    """One that sees the whole run and stands still, or one for the largest shape."""
    shapes = [run.shape(k, field, colours.kinds) for k in _sampled(run)]
    if view.follow:
        every = aim(ALONE, shapes, view)
        return replace(every, centres=every.centres[:1], zooms=[1.0])
    points = np.concatenate([shape.points for shape in shapes])
    everything = Shape(
        0.0,
        np.zeros((0, 3, 3)),
        np.zeros((0, 3, 3)),
        np.zeros(0, np.int64),
        np.zeros((0, 2, 3)),
        points,
    )
    return aim(ALONE, [everything], view)


def _frames(
    run: RunReader, field: str, colours: Colouring, camera: Camera, frames: Integers, follow: bool
) -> Iterator[np.ndarray]:
    """Images (height, width, 3) of bytes: the page around is laid out once, then picture and time are put into it."""
    from io import BytesIO

    from matplotlib import get_data_path
    from PIL import Image, ImageDraw, ImageFont

    grid = arrange(1, camera.size[0] / camera.size[1])
    metre = grid.width / camera.size[0]
    factor, prefix = scaled(float(run.times[-1]))
    digits = max(
        0, 1 - int(np.floor(np.log10(max(np.diff(run.times).min(initial=1.0) / factor, 1e-6))))
    )
    file, blank = BytesIO(), np.ones((2, 2, 3))
    x, y = write(file, run.title, [("", blank)], grid, metre, colours.key, [], (0, 1, ""))
    page = Image.open(file).convert("RGB")
    smaller = _FRAME_WIDTH / page.width
    page = page.resize(
        (_FRAME_WIDTH, 2 * round(smaller * page.height / 2)), Image.Resampling.LANCZOS
    )
    corner = round(smaller * x), round(smaller * y)
    dots = smaller * DPI
    font = ImageFont.truetype(f"{get_data_path()}/fonts/ttf/DejaVuSans.ttf", round(0.13 * dots))
    for k in frames:
        shape = run.shape(int(k), field, colours.kinds)
        if follow:
            seen = shape.points @ camera.axes[:2].T
            middle = (seen.min(axis=0) + seen.max(axis=0)) / 2
            camera = replace(camera, centres=[(float(middle[0]), float(middle[1]))])
        [image] = render(ALONE, camera, [shape], metre * dots, colours.table)
        whole = page.copy()
        whole.paste(Image.fromarray(np.rint(255 * image).astype(np.uint8)), corner)
        words = f"t = {shape.time / factor:.{digits}f} {prefix}s"
        ImageDraw.Draw(whole).text(
            (corner[0], corner[1] - 0.24 * dots), words, fill=(51, 56, 61), font=font
        )
        yield np.asarray(whole)


def _gif(path: Path, images: Iterator[np.ndarray], pause: float) -> None:
    from PIL import Image

    frames = [Image.fromarray(image) for image in images]
    # one palette for all, so that colours do not flicker: white, and the colours of some frames
    few = np.concatenate(
        [np.asarray(frame).reshape(-1, 3) for frame in frames[:: max(len(frames) // 6, 1)]]
    )
    drawn = few[(few < 250).any(axis=1)]
    colours = (
        Image.fromarray(drawn[None]).quantize(255, method=Image.Quantize.MEDIANCUT).getpalette()
        or []
    )
    palette = Image.new("P", (1, 1))
    palette.putpalette([255, 255, 255, *colours[: 3 * 255]])
    indexed = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    try:
        indexed[0].save(
            path,
            save_all=True,
            append_images=indexed[1:],
            duration=max(round(1000 * pause), 20),
            loop=0,
            optimize=False,
        )
    except OSError as error:
        raise OutputFailure(
            f"Cannot write '{path}' ({error.strerror}); choose a folder that is writable."
        ) from error


def _mp4(path: Path, images: Iterator[np.ndarray], rate: float) -> None:
    first = next(images)
    height, width = first.shape[:2]
    command = [
        "ffmpeg",
        "-y",
        "-loglevel",
        "error",
        "-f",
        "rawvideo",
        "-pix_fmt",
        "rgb24",
        "-s",
        f"{width}x{height}",
    ]
    command += [
        "-r",
        f"{rate:.6g}",
        "-i",
        "-",
        "-pix_fmt",
        "yuv420p",
        "-movflags",
        "+faststart",
        str(path),
    ]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as film:
        assert film.stdin is not None and film.stderr is not None
        try:
            for image in (first, *images):
                film.stdin.write(image.tobytes())
            film.stdin.close()
        except BrokenPipeError:
            pass
        words = film.stderr.read().decode(errors="replace").strip().splitlines()
    if film.returncode:
        raise OutputFailure(
            f"ffmpeg could not write '{path}' ({words[-1] if words else 'no reason given'}); try a .gif."
        )


def file_to_write(path: str | Path) -> Path:
    """The path, with its folder made.

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
