"""From where a scene is seen, and how it is lit and drawn."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from gossamer_fx.materials.film import SLACK, TAUT, WRINKLED
from gossamer_fx.model.body import Array
from gossamer_fx.plot.rasterise import Canvas, Colours
from gossamer_fx.plot.view import Integers, Shape, unit
from gossamer_fx.plot.viewpoint import LARGEST_ZOOM, View

# blue, orange, light grey: told apart with any colour vision, and in print by their brightness
STATE_COLOURS = {SLACK: (0.18, 0.49, 0.75), WRINKLED: (0.96, 0.65, 0.14), TAUT: (0.87, 0.88, 0.89)}
BY_STATE: Array = np.array([STATE_COLOURS[state] for state in sorted(STATE_COLOURS)])
_INK = (0.30, 0.33, 0.37)  # lines and dots
_SOLID = (0.66, 0.64, 0.60)

_SUPERSAMPLES = 2
_LIGHT = unit(np.array([-0.45, 0.55, 0.7]))  # right, up, towards the eye
_AMBIENT, _GLOSS, _SHININESS = 0.35, 0.35, 24
_HALF_LINE, _DOT = 1.3, 5.0  # pixels
_UNSEEN = 0.02  # share of light of layers that are left out behind others
_OUTLINE, _OUTLINE_STRENGTH = 6.0, 0.55  # depth [pixels] of a step that is outlined


@dataclass(frozen=True)
class Camera:
    """Axonometric camera: `axes` (3, 3) are the unit vectors to the right, up and towards the eye; boxes in metres.

    The picture of each shape shows `size` (width, height) around its place in `centres`, with depths in `depth`, but
    the part of it that is one over its number in `zooms`.
    """

    axes: Array
    size: tuple[float, float]
    centres: list[tuple[float, float]]
    depth: tuple[float, float]
    zooms: list[float]
    opacity: float = 1.0


def aim(comm: MPI.Intracomm, shapes: Sequence[Shape], view: View = View()) -> Camera:  # noqa: B008 (frozen)
    """A camera for all shapes, at one scale unless the view zooms.

    z is up.  The longest horizontal axis of the shapes runs to the right, turned by 25°; a flat shape is seen from
    higher above (38°) than a tall one (18°).  The camera stands still unless the shapes travel far.
    """
    axes = _axes(_spread(comm, shapes), view)
    low, high = np.full((len(shapes), 3), np.inf), np.full((len(shapes), 3), -np.inf)
    for i, shape in enumerate(shapes):
        seen = shape.points @ axes.T
        low[i], high[i] = seen.min(axis=0, initial=np.inf), seen.max(axis=0, initial=-np.inf)
    comm.Allreduce(MPI.IN_PLACE, low, op=MPI.MIN)
    comm.Allreduce(MPI.IN_PLACE, high, op=MPI.MAX)
    size, whole = (high - low).max(axis=0), high.max(axis=0) - low.min(axis=0)
    centres = (high + low)[:, :2] / 2
    follows = (
        view.zoom
        or view.follow
        or (view.follow is None and (whole[:2] > 1.6 * size[:2].max()).any())
    )
    if not follows:
        size, centres = (
            whole,
            np.broadcast_to((high.max(axis=0) + low.min(axis=0))[:2] / 2, centres.shape),
        )
    largest = float(size[:2].max()) or 1.0
    margin = 0.02 * largest
    width, height = (max(float(s), 0.2 * largest) + margin for s in size[:2])
    own = np.maximum(high - low, 1e-9 * largest)[:, :2] + margin
    zooms = (
        np.minimum((np.array([width, height]) / own).min(axis=1), LARGEST_ZOOM)
        if view.zoom
        else np.ones(len(low))
    )
    return Camera(
        axes,
        (width, height),
        [(float(x), float(y)) for x, y in centres],
        (-float(high[:, 2].max()) - margin, -float(low[:, 2].min()) + margin),
        [float(z) for z in zooms],
        view.opacity,
    )


def enlarged(zoom: float) -> str:
    """Words for a caption, where a picture is larger than the scale says."""
    return f", {zoom:.2g} times larger" if zoom > 1.05 else ""


def _spread(comm: MPI.Intracomm, shapes: Sequence[Shape]) -> Array:
    """Mean second moment (3, 3) of each shape's points about their centre."""
    moments = np.zeros((len(shapes), 13))
    for row, shape in zip(moments, shapes, strict=True):
        row[0], row[1:4], row[4:] = (
            len(shape.points),
            shape.points.sum(axis=0),
            (shape.points.T @ shape.points).ravel(),
        )
    comm.Allreduce(MPI.IN_PLACE, moments)
    count, first, second = moments[:, :1], moments[:, 1:4], moments[:, 4:].reshape(-1, 3, 3)
    centre = first / count
    spread: Array = (second / count[..., None] - np.einsum("ni,nj->nij", centre, centre)).mean(
        axis=0
    )
    return spread


def _axes(spread: Array, view: View) -> Array:
    """Right, up and towards the eye."""
    plane = spread[:2, :2] + np.diag([2e-3, 0.0]) * np.trace(
        spread
    )  # of equal axes, x is the longer
    squares, vectors = np.linalg.eigh(plane)
    first, second = vectors[:, 1]
    long = vectors[:, 1] * np.sign(first if abs(first) > abs(second) else second)
    deep, tall = np.sqrt(max(squares[0], 0.0)), np.sqrt(max(spread[2, 2], 0.0))
    chosen = (
        np.arctan2(long[1], long[0]) - np.radians(25),
        np.radians(18 + 20 * deep / max(deep + tall, 1e-300)),
    )
    azimuth, elevation = (
        own if given is None else given
        for given, own in zip((view.azimuth, view.elevation), chosen, strict=True)
    )
    right = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    eye = np.array(
        [
            np.sin(azimuth) * np.cos(elevation),
            -np.cos(azimuth) * np.cos(elevation),
            np.sin(elevation),
        ]
    )
    return np.array([right, np.cross(eye, right), eye])


def render(
    comm: MPI.Intracomm, camera: Camera, shapes: Iterable[Shape], scale: float, colours: Array
) -> list[Array]:
    """Images (height, width, 3) in [0, 1] of the shapes at `scale` pixels per metre, on rank 0; none on the others.

    Triangles of kind k have the colour colours[k] (red, green, blue in [0, 1]).
    """
    width, height = (round(s * scale) * _SUPERSAMPLES for s in camera.size)
    n = _SUPERSAMPLES
    palette, images = _palette(colours), []
    for shape, (x, y), zoom in zip(shapes, camera.centres, camera.zooms, strict=True):
        fine = scale * n * zoom
        to_pixels = _Projection(
            camera.axes, fine, np.array([width / 2 - x * fine, height / 2 + y * fine, 0.0])
        )
        corners = to_pixels(shape.corners)
        parts = [
            (corners, _shades(corners, shape.normals @ camera.axes.T), shape.kinds % len(palette))
        ]
        for triangles, shades in (_ribbons(to_pixels(shape.lines)), _discs(to_pixels(shape.dots))):
            parts.append((triangles, shades, np.full(len(triangles), len(palette) - 2)))
        first = Canvas(height, width, camera.depth[0] * fine, camera.depth[1] * fine)
        image = _image(comm, first, parts, palette, camera.opacity)
        if comm.rank == 0:
            images.append(image.reshape(height // n, n, width // n, n, 3).mean(axis=(1, 3)))
    return images


def _image(
    comm: MPI.Intracomm,
    canvas: Canvas,
    parts: Sequence[tuple[Array, Array, Integers]],
    palette: Colours,
    opacity: float,
) -> Array:
    """What is nearest, and through it what is behind, layer by layer (depth peeling): (height, width, 3) on rank 0."""
    image, share, light = np.ones((canvas.height, canvas.width, 3)), opacity, 1.0
    while True:
        for triangles, shades, kinds in parts:
            canvas.draw(triangles, shades, kinds, palette)
        whole = canvas.combine(comm)
        if comm.rank == 0:
            image += (
                light * share * (whole.outlined(_OUTLINE * _SUPERSAMPLES, _OUTLINE_STRENGTH) - 1)
            )
        light *= 1 - share
        behind = whole.behind(comm) if light > _UNSEEN else None
        if behind is None:
            return image
        canvas = behind


@dataclass(frozen=True)
class _Projection:
    """From metres in space to pixels to the right, down and away from the eye."""

    axes: Array
    scale: float
    origin: Array

    def __call__(self, points: Array) -> Array:
        pixels: Array = self.origin + self.scale * (points @ self.axes.T) * np.array(
            [1.0, -1.0, -1.0]
        )
        return pixels


def _ribbons(ends: Array) -> tuple[Array, Array]:
    """Lines (m, 2, 3) as round bars, before the film that they lie on: triangles and the shades of their corners."""
    towards = np.array([0.0, 0.0, -_HALF_LINE * _SUPERSAMPLES])
    a, b = ends[:, 0] + towards, ends[:, 1] + towards
    across = np.stack([a[:, 1] - b[:, 1], b[:, 0] - a[:, 0], np.zeros(len(a))], axis=1)
    across = _HALF_LINE * _SUPERSAMPLES * unit(across)
    triangles = []
    for side in (across, -across):
        triangles += [
            np.stack(t, axis=1)
            for t in ((a + side, a + towards, b + towards), (a + side, b + towards, b + side))
        ]
    shades = [np.tile(s, (len(a), 1)) for s in ([0.35, 0.8, 0.8], [0.35, 0.8, 0.35]) * 2]
    return np.concatenate(triangles), np.concatenate(shades)


def _discs(centres: Array) -> tuple[Array, Array]:
    """Dots (k, 3) as small balls."""
    angles = np.linspace(0, 2 * np.pi, 25)
    rim = _DOT * _SUPERSAMPLES * np.stack([np.cos(angles), np.sin(angles), np.zeros(25)], axis=1)
    summit = np.array([0.0, 0.0, -_DOT * _SUPERSAMPLES])
    fan = np.stack([np.broadcast_to(summit, (24, 3)), rim[:-1], rim[1:]], axis=1)
    triangles = (centres[:, None, None] + fan).reshape(-1, 3, 3)
    return triangles, np.tile([0.85, 0.4, 0.4], (len(triangles), 1))


def _shades(corners: Array, normals: Array) -> Array:
    """Brightness in [0, 1] of corners: Phong's reflection on the side that is seen, with a distant light."""
    # pixels count downwards and depth away: the cross product of a side that is seen points away in them
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0
    normals = np.where(facing[:, None, None], -normals, normals)
    half = unit(_LIGHT + np.array([0.0, 0.0, 1.0]))
    diffuse, gloss = (0.5 + normals @ _LIGHT / 2).clip(0), (normals @ half).clip(0) ** _SHININESS
    shades: Array = (_AMBIENT + (1 - _AMBIENT) * diffuse) * (1 - _GLOSS) + _GLOSS * gloss
    return shades


def _palette(colours: Array) -> npt.NDArray[np.uint8]:
    """Colours (kinds, ink and solids, 256, 3) from dark to the film's colour at 1 - gloss, and half-way on to white."""
    shade = np.linspace(0, 1, 256)[:, None]
    base = np.array([*colours, _INK, _SOLID])[:, None]
    matt, gloss = (shade / (1 - _GLOSS)).clip(0, 1), ((shade - (1 - _GLOSS)) / _GLOSS).clip(0, 1)
    palette: npt.NDArray[np.uint8] = np.rint(
        255 * (base * matt * (1 - gloss / 2) + gloss / 2)
    ).astype(np.uint8)
    return palette
