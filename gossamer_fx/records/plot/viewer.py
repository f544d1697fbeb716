"""The data of the view in a report that can be turned: surfaces, lines and colours at some times,
in few bytes."""

from __future__ import annotations

from base64 import b64encode
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gossamer_fx.core.model.body import Array
from gossamer_fx.records.fields.units import LINE_FIELDS, NAMES
from gossamer_fx.records.plot.colours import Colouring, colouring, default_field
from gossamer_fx.records.plot.run_reader import RecordedMesh, RunReader
from gossamer_fx.records.plot.shapes import Integers

_MAX_BYTES = 6_000_000  # of positions and colours together, about
_MAX_FRAMES = 80
_MAX_VERTICES = 20_000  # of all bodies together
_MIN_VERTICES = 100  # of each body, whatever the number of bodies
_FINEST = (
    1000  # cells along a body in which vertices are joined at first; then they grow by _COARSER
)
_COARSER = 1.25
_POSITION_BYTES = 6  # of a point: three numbers of 16 bits
_LARGEST_POSITION = 65535


@dataclass(frozen=True)
class _Surface:
    """A body's mesh in one of its files, with few vertices.

    Attributes:
        file: that holds the positions.
        points: numbers (v,) of the points of the file that are kept.
        pieces: triangles (n, 3) or lines (n, 2), numbers of the kept points.
        origin: numbers (n,) of the pieces of the file that are kept.
    """

    file: RecordedMesh
    points: Integers
    pieces: Integers
    origin: Integers

    @property
    def frame_bytes(self) -> int:
        """Bytes of the positions at one time."""
        return _POSITION_BYTES * len(self.points)


@dataclass(frozen=True)
class _Box:
    """The box around a whole run: its lowest corner (3,) and its sides (3,) [m]."""

    low: Array
    span: Array

    def packed(self, x: Array) -> Array:
        """Points (n, 3) as parts of the box, in whole numbers of 16 bits."""
        part = (x - self.low) / np.where(self.span > 0, self.span, 1.0)
        fractions: Array = np.rint(part * _LARGEST_POSITION).clip(0, _LARGEST_POSITION)
        return fractions


def view_data(run: RunReader) -> dict[str, Any]:
    """The data that the script `viewer.js` shows in a report: positions, colours, labels; for JSON.

    Positions are 16-bit fractions of the box [m] around the whole run; colours are rows of a table
    for each field. Surfaces of more than 20 000 vertices are thinned out.  Frames are left out
    where there would be more than 80, or more than about six megabytes.
    """
    fields = _fields(run)
    files_of_frame = [
        tuple(body.at(frame)[0] for body in run.bodies.values()) for frame in range(len(run.times))
    ]
    # Of a triangle at one time.
    colour_bytes = sum(3 if _is_smooth(colours) else 1 for _, colours in fields)
    share = max(_MAX_VERTICES // max(len(run.bodies), 1), _MIN_VERTICES)
    surfaces = {
        file: _thinned(file, share) for body in run.bodies.values() for file in body.segments
    }
    frames = _chosen_frames(run, files_of_frame, surfaces, colour_bytes)
    box = _box_around(run, frames)
    parts: list[dict[str, Any]] = []
    first = 0
    # The mesh stays the same while a run writes to the same files; a restart on other ranks has
    # another one.
    for files in dict.fromkeys(files_of_frame):
        here = [frame for frame in frames if files_of_frame[frame] == files]
        if here:
            part = _part(run, [surfaces[file] for file in files], here, fields, box)
            parts.append(part | {"first": first})
            first += len(here)
    return {
        "low": box.low.tolist(),
        "span": box.span.tolist(),
        "labels": [run.caption(frame) for frame in frames],
        "fields": [_legend(name, colours) for name, colours in fields],
        "parts": parts,
    }


def _fields(run: RunReader) -> list[tuple[str, Colouring]]:
    """Names and colours of the fields that can be chosen; without films the colours do not
    matter."""
    first = default_field(run)
    names = [first]
    if run.films:
        # The view colours triangles only.
        hidden = (first, "velocity", *LINE_FIELDS)
        names += [name for name in run.known_fields() if name not in hidden]
    return [(name, colouring(run, name)) for name in names]


def _chosen_frames(
    run: RunReader,
    files_of_frame: list[tuple[RecordedMesh, ...]],
    surfaces: dict[RecordedMesh, _Surface],
    colour_bytes: int,
) -> list[int]:
    """Numbers of recorded states that are evenly spread over the run and do not need too many
    bytes."""
    sizes = [
        sum(
            surfaces[file].frame_bytes + colour_bytes * len(surfaces[file].pieces) for file in files
        )
        for files in files_of_frame
    ]
    affordable = int(_MAX_BYTES / max(float(np.mean(sizes)), 1.0))
    count = min(max(affordable, 2), _MAX_FRAMES, max(len(run.times), 2))
    spread = np.linspace(0, len(run.times) - 1, count)
    return np.unique(np.rint(spread).astype(int)).tolist()


def _box_around(run: RunReader, frames: list[int]) -> _Box:
    """The smallest box [m] around bodies, solids and connectors in some frames."""
    lows = []
    highs = []
    for frame in frames:
        time = float(run.times[frame])
        points = [*run.solid_points(time), run.connector_lines(time).reshape(-1, 3)]
        for body in run.bodies.values():
            file, step = body.at(frame)
            points.append(file.positions(step))
        for x in points:
            if len(x):
                lows.append(x.min(axis=0))
                highs.append(x.max(axis=0))
    low = np.min(lows, axis=0)
    return _Box(low, np.max(highs, axis=0) - low)


def _part(
    run: RunReader,
    surfaces: list[_Surface],
    frames: list[int],
    fields: list[tuple[str, Colouring]],
    box: _Box,
) -> dict[str, Any]:
    """Some recorded states with the same mesh, as data for `viewer.js`.

    Args:
        box: around the whole run [m], of which positions are fractions.

    Returns:
        numbers of frames and vertices, and arrays in base 64: triangles and lines as numbers of
        vertices, positions (16 bits), and for each field the rows of its table of colours (8 bits).
    """
    triangles: list[Integers] = [np.zeros((0, 3), dtype=np.int64)]
    lines: list[Integers] = [np.zeros((0, 2), dtype=np.int64)]
    vertices = 0
    for surface in surfaces:
        pieces = triangles if surface.file.is_film else lines
        pieces.append(surface.pieces + vertices)
        vertices += len(surface.points)
    for solid in run.solids:
        lines.append(solid.lines + vertices)
        vertices += len(solid.X)
    # Each rope, spring and bar of a tape has its two ends for itself.
    ends = run.connector_lines(float(run.times[frames[0]])).reshape(-1, 3)
    lines.append(np.arange(len(ends)).reshape(-1, 2) + vertices)
    vertices += len(ends)
    positions = []
    kinds: list[list[Integers]] = [[np.zeros(0, dtype=np.int64)] for _ in fields]
    for frame in frames:
        for name, surface in zip(run.bodies, surfaces, strict=True):
            _, step = run.bodies[name].at(frame)
            positions.append(box.packed(surface.file.positions(step)[surface.points]))
            if surface.file.is_film:
                for found, (field, colours) in zip(kinds, fields, strict=True):
                    has_field = field in run.fields[name]
                    values = _piece_values(surface, field, step, has_field)
                    # Numbers vary along a triangle, states and groups do not.
                    if _is_smooth(colours):
                        found.append(colours.kinds(values.ravel()))
                    else:
                        found.append(colours.kinds(values.mean(axis=1)))
        time = float(run.times[frame])
        positions += [box.packed(x) for x in run.solid_points(time)]
        positions.append(box.packed(run.connector_lines(time).reshape(-1, 3)))
    return {
        "frames": len(frames),
        "vertices": vertices,
        "triangles": _packed(np.concatenate(triangles), np.uint32),
        "lines": _packed(np.concatenate(lines), np.uint32),
        "positions": _packed(np.concatenate(positions), np.uint16),
        "kinds": [_packed(np.concatenate(found), np.uint8) for found in kinds],
    }


def _is_smooth(colours: Colouring) -> bool:
    """Whether a field has a colour at each corner of a triangle, instead of one for the
    triangle."""
    return colours.scale is not None


def _piece_values(
    surface: _Surface,
    field: str,
    step: int,
    has_field: bool,
) -> Array:
    """Values (n, 3) of a field at the corners of triangles; NaN where the body does not have it."""
    if not has_field:
        return np.full((len(surface.origin), 3), np.nan)
    return surface.file.at_corners(field, step)[surface.origin]


def _thinned(file: RecordedMesh, most: int) -> _Surface:
    """A surface with few vertices: those that stay near to each other in the run become one.

    Nearness is that of the first, the middle and the last state, so that layers that touch for some
    time are not joined.

    Args:
        file: mesh and positions [m] of a body.
    """
    vertices, first_corner = np.unique(file.vertices.ravel(), return_index=True)
    points = file.pieces.ravel()[first_corner]
    last = len(file.times) - 1
    looks = [file.positions(step)[points] for step in sorted({0, last // 2, last})]
    positions = np.concatenate(looks, axis=1)
    cluster: Integers = np.arange(len(vertices))
    pitch = float(np.ptp(positions, axis=0).max(initial=0.0)) / _FINEST
    while len(np.unique(cluster)) > most and pitch > 0:
        cells = np.rint(positions / pitch).astype(np.int64)
        cluster = np.unique(cells, axis=0, return_inverse=True)[1].ravel()
        pitch *= _COARSER
    kept, first_of_each = np.unique(cluster, return_index=True)
    number_of_vertex = np.searchsorted(kept, cluster)
    pieces = number_of_vertex[np.searchsorted(vertices, file.vertices)]
    # pieces of which two corners have become one are left out, and those that others cover
    whole = np.ones(len(pieces), dtype=bool)
    for i in range(pieces.shape[1]):
        whole &= pieces[:, i] != pieces[:, i - 1]
    origin = np.flatnonzero(whole)
    once = np.unique(np.sort(pieces[origin], axis=1), axis=0, return_index=True)[1]
    origin = origin[np.sort(once)]
    return _Surface(file, points[first_of_each], pieces[origin], origin)


def _legend(name: str, colours: Colouring) -> dict[str, Any]:
    """A field in the list of those that can be shown, as data for `viewer.js`.

    Args:
        colours: its table (kinds, 3), and its key: a scale or names of kinds.
    """
    legend: dict[str, Any] = {
        "name": NAMES.get(name, name),
        "smooth": _is_smooth(colours),
        "table": np.rint(255 * colours.table).astype(int).tolist(),
    }
    if colours.scale is not None:
        _, label = colours.scale.label
        low, high = colours.scale.ends
        return legend | {
            "low": low,
            "high": high,
            "unit": label[label.find("[") + 1 : -1],
        }
    from matplotlib.colors import to_rgb

    legend["names"] = [
        [kind, int(abs(colours.table - np.asarray(to_rgb(colour))).sum(axis=1).argmin())]
        for kind, colour in colours.names.items()
    ]
    return legend


def _packed(values: npt.NDArray[Any], kind: type) -> str:
    """Numbers as base64 of little-endian binary numbers."""
    binary = np.ascontiguousarray(values, dtype=np.dtype(kind).newbyteorder("<"))
    return b64encode(binary.tobytes()).decode()
