"""From where a scene is seen, and how it is lit and drawn."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Annotated, NamedTuple

import numpy as np
import numpy.typing as npt

from gossamer_fx.core.checks.arguments import Range, check_arguments
from gossamer_fx.core.model.body import Array
from gossamer_fx.records.plot.colours import Colouring
from gossamer_fx.records.plot.rasterise import Canvas, Colours
from gossamer_fx.records.plot.shapes import Integers, Shape, unit

_INK = (0.30, 0.33, 0.37)  # of lines and dots
_SOLID_COLOUR = (0.66, 0.64, 0.60)

# ---- where the camera stands
_TURN = np.radians(25)  # of the longest axis, so that depth is seen
_ELEVATION_FLAT = np.radians(38)  # of shapes without height
_ELEVATION_TALL = np.radians(18)  # of shapes without depth
# Part by which the spread along x counts more than along y: of equal axes x is the longer, whatever
# the round-off.
_PREFER_X = 2e-3
# Way of the shapes across the picture, over the largest of them, from which on the camera follows
# them.
_FAR = 1.6
_MARGIN = 0.02  # around the shapes, of the larger side
_MIN_SIDE = 0.2  # of the larger side, that the smaller one has at least

# ---- how it is drawn
_SUPERSAMPLES = 2  # pixels of a canvas along a pixel of the image
_LIGHT = unit(np.array([-0.45, 0.55, 0.7]))  # direction to it: right, up, towards the eye
_AMBIENT = 0.35  # share of light that comes from everywhere
_GLOSS = 0.35  # share of the range of brightness for reflections
_SHININESS = 24  # exponent of Phong's reflection
_HALF_LINE = 1.3  # pixels of the image
_HALF_EDGE = 0.4  # of edges of the mesh
# Brightness of the number of a surface that is seen on edge, as in the view of a report.
_DARKEST = 0.55
_DOT = 5.0  # radius in pixels of the image
_DOT_SECTORS = 24
_OUTLINE = 6.0  # pixels of the image: jump in depth that is outlined
_OUTLINE_STRENGTH = 0.55


# Largest enlargement of one picture relative to the others: a small body must not fill the page.
LARGEST_ZOOM = 20.0


@check_arguments
@dataclass(frozen=True)
class View:
    """Camera of pictures and animations; values that are None are chosen from the shapes.

    z is up.  With azimuth 0 the camera looks along y, with π/2 against x: it has moved
    counterclockwise.

    Args:
        azimuth: [rad].
        elevation: [rad] above the horizon, between -π/2 and π/2.
        follow: whether the camera moves with the shapes; None: if they travel far.
        zoom: whether each picture is as large as its frame allows, with a note of its enlargement;
            otherwise all have one scale.
        flat: whether each number has exactly the colour of the bar; otherwise shapes are lit, and
            only surfaces that face the eye have it, others the same colour darkened.
        edges: whether the edges of the mesh are drawn on films.

    Raises:
        InputError: an angle out of its range.

    Example:
        >>> view = gx.plot.View(azimuth=0.5, elevation=0.3)
        >>> gx.plot.strip(recorded, "displacement", path=folder / "view.png", view=view)
    """

    azimuth: float | None = None
    elevation: Annotated[float, Range(-math.pi / 2, math.pi / 2, "rad")] | None = None
    _: KW_ONLY
    follow: bool | None = None
    zoom: bool = False
    flat: bool = False
    edges: bool = False


@dataclass(frozen=True)
class Camera:
    """An axonometric camera for some shapes, one picture each.

    Attributes:
        axes: (3, 3), unit vectors to the right, up and towards the eye.
        size: width and height [m] of what a picture shows.
        centres: of each picture, along the first two axes [m].
        depth: distances from the eye between which the shapes lie [m].
        zooms: of each picture; it shows the part of `size` that is one over this number.
        flat: whether numbers have the colours of the bar, without light.
        edges: whether the edges of the mesh are drawn on films.
    """

    axes: Array
    size: tuple[float, float]
    centres: list[tuple[float, float]]
    depth: tuple[float, float]
    zooms: list[float]
    flat: bool = False
    edges: bool = False

    @property
    def aspect(self) -> float:
        """Width over height."""
        return self.size[0] / self.size[1]


def aim(shapes: Sequence[Shape], view: View = View()) -> Camera:
    """A camera that sees all shapes, at one scale unless the view zooms.

    z is up.  The longest horizontal axis of the shapes runs to the right, turned by 25°; a flat
    shape is seen from higher above (38°) than a tall one (18°).  The camera stands still unless the
    shapes travel far.

    Args:
        shapes: the scene at one or more times, each with points (p, 3) [m]; at least one.
    """
    axes = _axes(_spread(shapes), view)
    lows = np.full((len(shapes), 3), np.inf)
    highs = np.full((len(shapes), 3), -np.inf)
    for k, shape in enumerate(shapes):
        seen = shape.points @ axes.T
        lows[k] = seen.min(axis=0, initial=np.inf)
        highs[k] = seen.max(axis=0, initial=-np.inf)
    largest_box = (highs - lows).max(axis=0)
    whole_box = highs.max(axis=0) - lows.min(axis=0)
    travels_far = bool((whole_box[:2] > _FAR * largest_box[:2].max()).any())
    if view.zoom or view.follow or (view.follow is None and travels_far):
        box = largest_box
        centres = (highs + lows)[:, :2] / 2
    else:
        box = whole_box
        middle = (highs.max(axis=0) + lows.min(axis=0))[:2] / 2
        centres = np.broadcast_to(middle, (len(shapes), 2))
    larger_side = float(box[:2].max()) or 1.0
    margin = _MARGIN * larger_side
    size = np.maximum(box[:2], _MIN_SIDE * larger_side) + margin
    zooms = np.ones(len(shapes))
    if view.zoom:
        own_sizes = np.maximum((highs - lows)[:, :2], 1e-9 * larger_side) + margin
        zooms = np.minimum((size / own_sizes).min(axis=1), LARGEST_ZOOM)
    return Camera(
        axes=axes,
        size=(float(size[0]), float(size[1])),
        centres=[(float(x), float(y)) for x, y in centres],
        depth=(-float(highs[:, 2].max()) - margin, -float(lows[:, 2].min()) + margin),
        zooms=[float(zoom) for zoom in zooms],
        flat=view.flat,
        edges=view.edges,
    )


def _spread(shapes: Sequence[Shape]) -> Array:
    """Mean second moment (3, 3) of the points of the shapes, each about its centre."""
    moments = np.zeros((3, 3))
    for shape in shapes:
        if len(shape.points):
            moments += np.cov(shape.points.T, bias=True)
    return moments / len(shapes)


def _axes(spread: Array, view: View) -> Array:
    """Unit vectors (3, 3), one a row, to the right, up and towards the eye.

    Args:
        spread: second moment (3, 3) [m²] of the points of the shapes about their centres.
        view: azimuth and elevation [rad] of the user; None: chosen from the spread.
    """
    horizontal = spread[:2, :2] + np.diag([_PREFER_X, 0.0]) * np.trace(spread)
    # squares: second moments [m²] along the two horizontal directions, in rising order.
    squares, directions = np.linalg.eigh(horizontal)
    longest = directions[:, 1]
    # of the two directions of an axis, the one whose larger component is positive
    longest = longest * np.sign(longest[np.abs(longest).argmax()])
    azimuth = view.azimuth
    if azimuth is None:
        azimuth = np.arctan2(longest[1], longest[0]) - _TURN
    elevation = view.elevation
    if elevation is None:
        depth = np.sqrt(max(squares[0], 0.0))
        height = np.sqrt(max(spread[2, 2], 0.0))
        flatness = depth / max(depth + height, 1e-300)
        elevation = _ELEVATION_TALL + (_ELEVATION_FLAT - _ELEVATION_TALL) * flatness
    cos_azimuth = np.cos(azimuth)
    sin_azimuth = np.sin(azimuth)
    cos_elevation = np.cos(elevation)
    right = np.array([cos_azimuth, sin_azimuth, 0.0])
    eye = np.array([sin_azimuth * cos_elevation, -cos_azimuth * cos_elevation, np.sin(elevation)])
    return np.array([right, np.cross(eye, right), eye])


class _Triangles(NamedTuple):
    """Triangles on a canvas: corners (n, 3, 3) [pixels], brightness (n, 3), kinds (n,), and
    whether (n,) they are hatched."""

    corners: Array
    shades: Array
    kinds: Integers
    is_hatched: npt.NDArray[np.bool_] | None = None


def render(
    camera: Camera,
    shapes: Iterable[Shape],
    scale: float,
    colours: Colouring,
) -> Iterator[Array]:
    """Draw shapes (a scene at one or more times) as images with hidden surfaces.

    A light at the eye shows the shapes of films with numbers: where they face the eye they have the
    colour of the bar, elsewhere the same colour darkened.  With `flat` they all have it, and dark
    outlines show the shape.  Kinds are lit from the side, with highlights.

    Args:
        shapes: as many as the camera has centres, with points [m].
        scale: of the images [pixels/m], before the camera's zooms.

    Yields:
        An image (height, width, 3) in [0, 1] of each shape.
    """
    n = _SUPERSAMPLES
    width = round(camera.size[0] * scale) * n
    height = round(camera.size[1] * scale) * n
    palette = _palette(colours, camera.flat)
    numbers = len(colours.table) - 1 if colours.scale is not None else 0
    outline = _OUTLINE_STRENGTH
    if colours.scale is not None:
        # A colour that is only darkened would be that of another number.
        outline = 1.0
    ink = len(palette) - 2
    for shape, (x, y), zoom in zip(shapes, camera.centres, camera.zooms, strict=True):
        pixels_per_metre = scale * n * zoom
        # pixels count from the upper left corner
        origin = np.array([width / 2 - x * pixels_per_metre, height / 2 + y * pixels_per_metre, 0])
        project = _Projection(camera.axes, pixels_per_metre, origin)
        corners = project(shape.corners)
        seen_normals = shape.normals @ camera.axes.T
        shades = _shades(corners, seen_normals)
        has_number = (shape.kinds >= 0) & (shape.kinds < numbers)
        shades[has_number] = _DARKEST + (1 - _DARKEST) * abs(seen_normals[has_number, :, 2])
        films_and_solids = _Triangles(corners, shades, shape.kinds, shape.is_slack)
        line_kinds = np.where(shape.line_kinds < 0, ink, shape.line_kinds)
        bars = _bars(project(shape.lines), line_kinds)
        edges = _bars(np.zeros((0, 2, 3)), np.zeros(0, dtype=np.int64))
        if camera.edges:
            edges = _bars(project(shape.edges), np.full(len(shape.edges), ink), _HALF_EDGE)
        balls = _balls(project(shape.dots), ink)
        near = camera.depth[0] * pixels_per_metre
        far = camera.depth[1] * pixels_per_metre
        canvas = Canvas(height, width, near, far)
        for part in (films_and_solids, edges, bars, balls):
            canvas.draw(part.corners, part.shades, part.kinds, palette, part.is_hatched)
        image = canvas.outlined(_OUTLINE * n, outline)
        yield image.reshape(height // n, n, width // n, n, 3).mean(axis=(1, 3))


@dataclass(frozen=True)
class _Projection:
    """From metres in space to pixels to the right, down and away from the eye.

    Attributes:
        axes: of the camera (3, 3), see `Camera`.
        scale: [pixels/m].
        origin: pixels (3,) of the origin of space.
    """

    axes: Array
    scale: float
    origin: Array

    def __call__(self, points: Array) -> Array:
        seen = self.scale * (points @ self.axes.T)
        return self.origin + seen * np.array([1.0, -1.0, -1.0])


def _bars(ends: Array, kinds: Integers, half_line: float = _HALF_LINE) -> _Triangles:
    """Lines as round bars: on each side of the axis a strip of triangles that gets darker outwards.

    Args:
        ends: (m, 2, 3) [pixels]: to the right, down and away from the eye.
        kinds: rows (m,) of the palette.
        half_line: half of their width [pixels of the image].
    """
    half_width = half_line * _SUPERSAMPLES
    # the axis stands out by the radius, so that a line is seen on the film on which it lies
    start = ends[:, 0] - np.array([0.0, 0.0, half_width])
    end = ends[:, 1] - np.array([0.0, 0.0, half_width])
    along = end - start
    across = np.stack([-along[:, 1], along[:, 0], np.zeros(len(ends))], axis=1)
    across = half_width * unit(across)
    crest = np.array([0.0, 0.0, -half_width])
    corners = []
    shades = []
    for side in (across, -across):
        corners.append(np.stack([start + side, start + crest, end + crest], axis=1))
        shades.append(np.tile([0.35, 0.8, 0.8], (len(ends), 1)))
        corners.append(np.stack([start + side, end + crest, end + side], axis=1))
        shades.append(np.tile([0.35, 0.8, 0.35], (len(ends), 1)))
    return _Triangles(np.concatenate(corners), np.concatenate(shades), np.tile(kinds, 4))


def _balls(centres: Array, kind: int) -> _Triangles:
    """Dots as small balls: cones whose tips are bright and stand towards the eye.

    Args:
        centres: (k, 3) [pixels]: to the right, down and away from the eye.
    """
    radius = _DOT * _SUPERSAMPLES
    angles = np.linspace(0, 2 * np.pi, _DOT_SECTORS + 1)
    rim = radius * np.stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))], axis=1)
    tip = np.broadcast_to([0.0, 0.0, -radius], (_DOT_SECTORS, 3))
    cone = np.stack([tip, rim[:-1], rim[1:]], axis=1)
    corners = (centres[:, None, None] + cone).reshape(-1, 3, 3)
    shades = np.tile([0.85, 0.4, 0.4], (len(corners), 1))
    return _Triangles(corners, shades, np.full(len(corners), kind))


def _shades(corners: Array, normals: Array) -> Array:
    """Brightness (n, 3) in [0, 1] at corners: Phong's reflection with a distant light.

    Each triangle is lit on the side that is seen.

    Args:
        corners: of n triangles, (n, 3, 3) [pixels]: to the right, down and away from the eye.
        normals: unit vectors (n, 3, 3) at the corners, along the axes of the camera: to the right,
            up and towards the eye.
    """
    # pixels count downwards and depth away from the eye: in them, the normal of a front side points
    # away
    first_edge = corners[:, 1] - corners[:, 0]
    second_edge = corners[:, 2] - corners[:, 0]
    from_behind = np.cross(first_edge, second_edge)[:, 2] > 0
    normals = np.where(from_behind[:, None, None], -normals, normals)
    halfway = unit(_LIGHT + np.array([0.0, 0.0, 1.0]))
    diffuse = (0.5 + normals @ _LIGHT / 2).clip(0)
    gloss = (normals @ halfway).clip(0) ** _SHININESS
    matt = _AMBIENT + (1 - _AMBIENT) * diffuse
    return matt * (1 - _GLOSS) + _GLOSS * gloss


def _palette(colours: Colouring, flat: bool) -> Colours:
    """Colours (kinds + 3, 256, 3) by brightness, as bytes: the rows of `colours.table`, the last of
    which is of what has no value, then lines and solids.

    They go from black to the colour at 1 - gloss, then half-way on to white; colours of numbers go
    from black to the colour, or are the same at any brightness if pictures are flat.
    """
    brightness = np.linspace(0, 1, 256)[:, None]
    base = np.array([*colours.table, _INK, _SOLID_COLOUR])[:, None]
    matt = (brightness / (1 - _GLOSS)).clip(0, 1)
    gloss = ((brightness - (1 - _GLOSS)) / _GLOSS).clip(0, 1)
    shaded = base * matt * (1 - gloss / 2) + gloss / 2
    if colours.scale is not None:
        of_numbers = base[: len(colours.table) - 1]
        shaded[: len(colours.table) - 1] = of_numbers if flat else of_numbers * brightness
    return np.rint(255 * shaded).astype(np.uint8)
