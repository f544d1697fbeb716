"""Deformed films as seen from a point: what is drawn, from where, how lit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from dolfinx import la
from mpi4py import MPI

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.fields import film_state
from gossamer_fx.forms import compile_expression
from gossamer_fx.materials import SLACK, TAUT, WRINKLED
from gossamer_fx.parts import Array
from gossamer_fx.rasterise import Canvas
from gossamer_fx.system import System

Integers = npt.NDArray[np.int64]

# blue, orange, light grey: told apart with any colour vision, and in print by their brightness
STATE_COLOURS = {SLACK: (0.18, 0.49, 0.75), WRINKLED: (0.96, 0.65, 0.14), TAUT: (0.87, 0.88, 0.89)}

# triangles between the nodes of a cell, by the order of its film
_TRIANGLES = {1: [[0, 1, 2]], 2: [[0, 5, 4], [5, 1, 3], [4, 3, 2], [5, 3, 4]]}
_NODES = {1: [[0, 0], [1, 0], [0, 1]], 2: [[0, 0], [1, 0], [0, 1], [0.5, 0.5], [0, 0.5], [0.5, 0]]}

_SUPERSAMPLES = 2
_LIGHT = np.array([-0.45, 0.55, 0.7]) / np.linalg.norm([-0.45, 0.55, 0.7])  # right, up, towards the eye
_AMBIENT, _GLOSS, _SHININESS = 0.5, 0.35, 24
_CREASE = 0.6  # cosine of the angle between neighbours beyond which an edge is drawn sharp


@dataclass(frozen=True)
class Shape:
    """This rank's triangles of the films at one time.

    corners (n, 3, 3) [m], normals (n, 3, 3) of the corners, kinds (n,) the states of the film
    """

    time: float
    corners: Array
    normals: Array
    kinds: Integers


class Surface:
    """The films of a system, ready to be looked at."""

    def __init__(self, system: System, films: Sequence[Membrane]) -> None:
        self._system = system
        self._films = []
        for film in films:
            x = system.fields[system.bodies.index(film)].q0
            pieces = np.array(_TRIANGLES[film.order])
            middles = np.array(_NODES[film.order], dtype=float)[pieces].mean(axis=1)
            owned = film.mesh.domain.topology.index_map(2).size_local
            nodes = film.space.dofmap.list[:owned].astype(np.int64)
            triangles = nodes[:, pieces].reshape(-1, 3)
            state = compile_expression(film_state(film, x), middles)
            self._films.append((film, x, triangles, state, np.arange(owned, dtype=np.int32)))

    def shape(self, time: float) -> Shape:
        """The accepted state."""
        corners, normals, kinds = [np.zeros((0, 3, 3))], [np.zeros((0, 3, 3))], [np.zeros(0, dtype=np.int64)]
        for film, x, triangles, state, cells in self._films:
            points = x.x.array.reshape(-1, 3)
            corners.append(points[triangles])
            normals.append(_corner_normals(film, corners[-1], triangles))
            kinds.append(np.rint(state.eval(film.mesh.domain, cells)).astype(np.int64).ravel())
        return Shape(time, np.concatenate(corners), np.concatenate(normals), np.concatenate(kinds))


def _corner_normals(film: Membrane, corners: Array, triangles: Integers) -> Array:
    """Unit normals at the corners: the mean of all triangles around, or the triangle's own where they differ much."""
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    vector = la.vector(film.block.index_map, 3)
    np.add.at(vector.array.reshape(-1, 3), triangles.ravel(), np.repeat(area, 3, axis=0))
    vector.scatter_reverse(la.InsertMode.add)
    vector.scatter_forward()
    own = np.repeat(_unit(area)[:, None], 3, axis=1)
    mean = _unit(vector.array.reshape(-1, 3))[triangles]
    smooth = (own * mean).sum(axis=2, keepdims=True) > _CREASE
    normals: Array = np.where(smooth, mean, own)
    return normals


def _unit(vectors: Array) -> Array:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    result: Array = vectors / np.where(length > 0, length, 1.0)
    return result


@dataclass(frozen=True)
class Camera:
    """Axonometric camera: `axes` (3, 3) are the unit vectors to the right, up and towards the eye; boxes in metres.

    The picture of each shape shows `size` (width, height) around its place in `centres` (n, 2), with depths in `depth`.
    """

    axes: Array
    size: tuple[float, float]
    centres: Array
    depth: tuple[float, float]


def aim(comm: MPI.Comm, shapes: Sequence[Shape]) -> Camera:
    """A camera for all shapes, at one scale.

    z is up.  The longest horizontal axis of the shapes runs to the right, turned by 25°; a flat shape is seen from
    higher above (38°) than a tall one (18°).  The camera stands still unless the shapes travel far.
    """
    axes = _axes(_spread(comm, shapes))
    low, high = np.full((len(shapes), 3), np.inf), np.full((len(shapes), 3), -np.inf)
    for i, shape in enumerate(shapes):
        seen = (shape.corners @ axes.T).reshape(-1, 3)
        low[i], high[i] = seen.min(axis=0, initial=np.inf), seen.max(axis=0, initial=-np.inf)
    comm.Allreduce(MPI.IN_PLACE, low, op=MPI.MIN)
    comm.Allreduce(MPI.IN_PLACE, high, op=MPI.MAX)
    size, whole = (high - low).max(axis=0), high.max(axis=0) - low.min(axis=0)
    centres = (high + low)[:, :2] / 2
    if (whole[:2] <= 1.6 * size[:2].max()).all():
        size, centres = whole, np.broadcast_to((high.max(axis=0) + low.min(axis=0))[:2] / 2, centres.shape)
    margin = 1e-9 + 0.02 * float(size[:2].max())
    return Camera(
        axes,
        (float(size[0]) + margin, float(size[1]) + margin),
        centres,
        (-float(high[:, 2].max()) - margin, -float(low[:, 2].min()) + margin),
    )


def _spread(comm: MPI.Comm, shapes: Sequence[Shape]) -> Array:
    """Mean second moment (3, 3) of each shape's corners about their centre."""
    moments = np.zeros((len(shapes), 13))
    for row, shape in zip(moments, shapes, strict=True):
        points = shape.corners.reshape(-1, 3)
        row[0], row[1:4], row[4:] = len(points), points.sum(axis=0), (points.T @ points).ravel()
    comm.Allreduce(MPI.IN_PLACE, moments)
    count, first, second = moments[:, :1], moments[:, 1:4], moments[:, 4:].reshape(-1, 3, 3)
    centre = first / count
    spread: Array = (second / count[..., None] - np.einsum("ni,nj->nij", centre, centre)).mean(axis=0)
    return spread


def _axes(spread: Array) -> Array:
    """Right, up and towards the eye."""
    plane = spread[:2, :2] + np.diag([2e-3, 0.0]) * np.trace(spread)  # of equal axes, x is the longer
    squares, vectors = np.linalg.eigh(plane)
    long = vectors[:, 1] * np.sign(vectors[np.argmax(abs(vectors[:, 1])), 1])
    deep, tall = np.sqrt(max(squares[0], 0.0)), np.sqrt(max(spread[2, 2], 0.0))
    azimuth = np.arctan2(long[1], long[0]) - np.radians(25)
    elevation = np.radians(18 + 20 * deep / max(deep + tall, 1e-300))
    right = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    eye = np.array([np.sin(azimuth) * np.cos(elevation), -np.cos(azimuth) * np.cos(elevation), np.sin(elevation)])
    return np.array([right, np.cross(eye, right), eye])


def render(comm: MPI.Comm, camera: Camera, shapes: Sequence[Shape], scale: float) -> list[Array]:
    """Images (height, width, 3) in [0, 1] of the shapes at `scale` pixels per metre, on rank 0; none on the others."""
    width, height = (round(s * scale) * _SUPERSAMPLES for s in camera.size)
    fine = scale * _SUPERSAMPLES
    palette, images = _palette(), []
    for shape, centre in zip(shapes, camera.centres, strict=True):
        seen = shape.corners @ camera.axes.T
        x = (seen[..., 0] - centre[0]) * fine + width / 2
        y = height / 2 - (seen[..., 1] - centre[1]) * fine
        canvas = Canvas(height, width, *camera.depth)
        shades = _shades(seen, shape.normals @ camera.axes.T)
        canvas.draw(np.stack([x, y, -seen[..., 2]], axis=2), shades, shape.kinds, palette)
        whole = canvas.combine(comm)
        if comm.rank == 0:
            colours = whole.outlined(jump=12 / fine, strength=0.55)
            blocks = colours.reshape(height // _SUPERSAMPLES, _SUPERSAMPLES, width // _SUPERSAMPLES, _SUPERSAMPLES, 3)
            images.append(blocks.mean(axis=(1, 3)))
    return images


def _shades(corners: Array, normals: Array) -> Array:
    """Brightness in [0, 1] of corners: Phong's reflection on the side that is seen, with a distant light."""
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] < 0
    normals = np.where(facing[:, None, None], -normals, normals)
    half = _unit(_LIGHT + np.array([0.0, 0.0, 1.0]))
    diffuse, gloss = (0.5 + normals @ _LIGHT / 2).clip(0), (normals @ half).clip(0) ** _SHININESS
    shades: Array = (_AMBIENT + (1 - _AMBIENT) * diffuse) * (1 - _GLOSS) + _GLOSS * gloss
    return shades


def _palette() -> npt.NDArray[np.uint8]:
    """Colours (states, 256, 3) from dark to the film's colour at 1 - gloss, and half-way on to white."""
    shade = np.linspace(0, 1, 256)[:, None]
    base = np.array([STATE_COLOURS[state] for state in sorted(STATE_COLOURS)])[:, None]
    matt, gloss = (shade / (1 - _GLOSS)).clip(0, 1), ((shade - (1 - _GLOSS)) / _GLOSS).clip(0, 1)
    colours: npt.NDArray[np.uint8] = np.rint(255 * (base * matt * (1 - gloss / 2) + gloss / 2)).astype(np.uint8)
    return colours
