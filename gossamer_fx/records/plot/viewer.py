"""The data of the view of a run that can be turned: meshes, states and values, in few bytes.

`viewer.js` shows it.  A report contains all of it, `Watch` serves it piece by piece:

    header      meshes, captions of the states and names of the fields
    legend      colours and scale of a field
    state       displacements of all parts in a recorded state, and values of some fields
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.materials.film import SLACK
from gossamer_fx.records.fields.units import COMPONENTS, LINE_FIELDS, NAMES, VECTOR_FIELDS
from gossamer_fx.records.plot.colours import Colouring, colouring, default_field
from gossamer_fx.records.plot.packing import NUMBER_BYTES, binary, packed
from gossamer_fx.records.plot.run_reader import RecordedMesh, RunReader
from gossamer_fx.records.plot.shapes import Integers

# Of displacements and values in a report together, about.
_MAX_BYTES = 6_000_000
_MAX_FRAMES = 80
_MAX_VERTICES = 20_000  # of all bodies together
_MIN_VERTICES = 100  # of each body, whatever the number of bodies
_FINEST = (
    1000  # cells along a body in which vertices are joined at first; then they grow by _COARSER
)
_COARSER = 1.25
_KINDS = ("state", "group")  # fields whose values are numbers of kinds
# Way of the parts over their size from which on the view moves with them, as the camera does.
_FAR = 1.6


@dataclass(frozen=True)
class _Surface:
    """A body's mesh in one of its files, with few vertices.

    Attributes:
        points: numbers (v,) of the points of the file that are kept.
        pieces: triangles (n, 3) or lines (n, 2), numbers of the kept points.
        origin: numbers (n,) of the pieces of the file that are kept.
    """

    points: Integers
    pieces: Integers
    origin: Integers


@dataclass(frozen=True)
class _Part:
    """What can be shown or hidden: a body, a connector, a solid or a point.

    Attributes:
        pieces: triangles (n, 3), lines (n, 2), or none for a point.
        positions: function that returns the points (v, 3) [m] in a recorded state.
        values: function that returns values of a field in a recorded state, (v,) at the points or
            (n,) on the pieces, and whether they are at the points; None if it does not have it.
        X: points (v, 3) of the stress-free mesh [m], at which probes are placed.
    """

    name: str
    pieces: Integers
    positions: Callable[[int], Array]
    values: Callable[[str, int], tuple[Array, bool] | None]
    X: Array | None = None


@dataclass(frozen=True)
class Probe:
    """A point of the view at which a value is read.

    Attributes:
        mesh: number of the mesh in the header.
        part: number of the part of that mesh.
        piece: number of a triangle or line of the part.
        point: number of one of its points.
    """

    mesh: int
    part: int
    piece: int
    point: int


class RunView:
    """A recorded run as data for `viewer.js`.

    Surfaces of more than 20 000 vertices are thinned out.

    Attributes:
        run: its reader; may be replaced by another one of the same run, which has grown.
        fields: names of the fields that can be shown; components of vectors and speeds come last.
    """

    def __init__(self, run: RunReader) -> None:
        self.run = run
        share = max(_MAX_VERTICES // max(len(run.bodies), 1), _MIN_VERTICES)
        self._surfaces = {
            name: [_thinned(file, share) for file in body.segments]
            for name, body in run.bodies.items()
        }
        # Here a mesh is a tuple with the number of each body's file, see `_files`.  It stays the
        # same while a run writes to the same files; a restart on other ranks has another one.
        of_records = [self._files(record) for record in range(len(run.times))]
        self._meshes = list(dict.fromkeys(of_records))
        self._parts = [list(self._parts_of(files)) for files in self._meshes]
        self._starts = [self._start(files) for files in self._meshes]
        self._legends: dict[str, dict[str, Any]] = {}
        self._main_fields: list[str] = []
        if run.bodies:
            first = default_field(run)
            others = [name for name in run.known_fields() if name not in (first, "velocity")]
            self._main_fields = [first, *others]
        self.fields = [*self._main_fields]
        if run.films:
            known = run.known_fields()
            vectors = [name for name in VECTOR_FIELDS if name in known]
            self.fields += [name for name in vectors if name not in self.fields]
            self.fields += [f"{name}_{end}" for name in vectors for end in COMPONENTS]

    def header(self, records: Sequence[int], fields: Sequence[str]) -> dict[str, Any]:
        """Captions of some recorded states, names of the fields, and all meshes, see `_mesh`.

        Args:
            fields: `fields`, or the first of them.
        """
        return {
            "labels": [self.run.caption(record) for record in records],
            "fields": [NAMES.get(name, name) for name in fields],
            "components": _components(fields),
            # Slack film is marked in every field.
            "stateField": self.fields.index("state") if "state" in self.fields else -1,
            "slack": SLACK,
            "follows": self._travels_far(),
            "meshes": [
                [_mesh(part, start) for part, start in zip(parts, starts, strict=True)]
                for parts, starts in zip(self._parts, self._starts, strict=True)
            ],
        }

    def legend(self, field: str) -> dict[str, Any]:
        """The colours of a field, on one scale for the states that there were when it was asked for
        first, or since `forget_legends`."""
        if field not in self._legends:
            self._legends[field] = _legend(field, colouring(self.run, field))
        return self._legends[field]

    def forget_legends(self) -> None:
        """Let scales be made again, with the states that have come."""
        self._legends.clear()

    def state(self, record: int, fields: Iterable[str]) -> dict[str, Any]:
        """Displacements, and values of fields, in a recorded state.

        Returns:
            "mesh", its number; "moved", displacements of each part from the start; "values", by the
            number of the field those of each part, None of one that does not have it.
        """
        mesh = self._meshes.index(self._files(record))
        parts = self._parts[mesh]
        moved = [
            packed(part.positions(record) - start)
            for part, start in zip(parts, self._starts[mesh], strict=True)
        ]
        values: dict[int, list[dict[str, Any] | None]] = {}
        for field in fields:
            of_parts: list[dict[str, Any] | None] = []
            for part in parts:
                found = part.values(field, record)
                if found is None:
                    of_parts.append(None)
                    continue
                numbers, at_points = found
                of_parts.append(packed(numbers[:, None]) | {"atPoints": at_points})
            values[self.fields.index(field)] = of_parts
        return {"mesh": mesh, "moved": moved, "values": values}

    def whole(self) -> dict[str, Any]:
        """All data at once, for a report.

        Frames are left out where there would be more than 80, or more than about six megabytes;
        speeds and components of vectors are left out where they would cost frames.
        """
        wanted = min(_MAX_FRAMES, max(len(self.run.times), 2))
        fields = self.fields
        if self._affordable_frames(fields) < wanted:
            fields = self._main_fields
        frames = min(max(self._affordable_frames(fields), 2), wanted)
        times = np.linspace(self.run.times[0], self.run.times[-1], frames)
        records = sorted({self.run.record_at(time) for time in times})
        return {
            "records": records,
            "header": self.header(records, fields),
            "legends": [self.legend(field) for field in fields],
            "states": [self.state(record, fields) for record in records],
        }

    def _affordable_frames(self, fields: Sequence[str]) -> int:
        """How many states with these fields a report can hold."""
        numbers = 0
        for part in self._parts[0]:
            points = len(part.positions(0))
            numbers += 3 * points + len(fields) * max(points, len(part.pieces))
        return int(_MAX_BYTES / max(NUMBER_BYTES * numbers, 1))

    def history(
        self, records: Iterable[int], field: str, probe: Probe, seconds: float
    ) -> dict[str, Any]:
        """Values of a field at a point over several states, or its height z [m] where its part does
        not have the field.

        Args:
            records: numbers of the states; the last ones are left out when the time is over.
            seconds: about as long as this may take [s]; one state is read in any case.

        Returns:
            "values", of as many states as were read, None where there is no number; "isField",
            whether they are those of the field.
        """
        until = time.monotonic() + seconds
        values: list[float | None] = []
        is_field = False
        for record in records:
            part = self._parts[probe.mesh][probe.part]
            value = math.nan
            # Another mesh has other points.
            if self._meshes[probe.mesh] == self._files(record):
                found = part.values(field, record)
                if found is None:
                    value = float(part.positions(record)[probe.point, 2])
                else:
                    numbers, at_points = found
                    is_field = True
                    value = float(numbers[probe.point if at_points else probe.piece])
            values.append(value if math.isfinite(value) else None)
            if time.monotonic() >= until:
                break
        return {"values": values, "isField": is_field}

    def has_point(self, probe: Probe) -> bool:
        """Whether there is such a point in the view."""
        if probe.mesh >= len(self._parts) or probe.part >= len(self._parts[probe.mesh]):
            return False
        part = self._parts[probe.mesh][probe.part]
        points = len(self._starts[probe.mesh][probe.part])
        return probe.point < points and probe.piece < max(len(part.pieces), 1)

    # ---- parts -----------------------------------------------------------------------------------

    def _files(self, record: int) -> tuple[int, ...]:
        """Number of the file of each body that contains a recorded state."""
        bodies = self.run.bodies.values()
        return tuple(body.segments.index(body.at(record)[0]) for body in bodies)

    def _parts_of(self, files: tuple[int, ...]) -> Iterable[_Part]:
        """Yield the parts in the states that these files of the bodies contain."""
        for name, number in zip(self.run.bodies, files, strict=True):
            surface = self._surfaces[name][number]
            yield _Part(
                name,
                surface.pieces,
                partial(self._body_positions, name, surface),
                partial(self._body_values, name, surface),
                self.run.bodies[name].segments[number].X[surface.points],
            )
        names = np.array(self.run.connector_names)
        for name in dict.fromkeys(self.run.connector_names):
            lines = np.flatnonzero(names == name)
            # Each line has its two ends for itself.
            yield _Part(
                name,
                np.arange(2 * len(lines)).reshape(-1, 2),
                partial(self._connector_positions, lines),
                partial(self._mean_tension, name, len(lines)),
            )
        names_of_solids = [solid.name for solid in self.run.solids]
        for number, solid in enumerate(self.run.solids):
            name = solid.name
            if names_of_solids.count(name) > 1:
                name = f"{name} {number + 1}"
            pieces = solid.triangles
            if not len(pieces):
                pieces = solid.lines
            solid_positions = partial(self._solid_positions, number)
            yield _Part(name, pieces, solid_positions, _no_values)
        for number, name in enumerate(self.run.point_names):
            dot = partial(self._dot_position, number)
            # A rigid body is drawn as a solid, too: the boxes that hide them have different names.
            if name in names_of_solids:
                name = f"{name}, centre"
            yield _Part(name, np.zeros((0, 2), dtype=np.int64), dot, _no_values)

    def _start(self, files: tuple[int, ...]) -> list[Array]:
        """Positions [m] of the points of all parts from which deformations are counted.

        Those of a run are the first recorded ones, of an equilibrium the stress-free mesh, of a
        mode the mean over its period.  A later mesh of a body has other points: each starts where
        the nearest one of the first stress-free mesh does.
        """
        from scipy.spatial import KDTree

        parts = self._parts[self._meshes.index(files)]
        starts = []
        for k, part in enumerate(parts):
            if self.run.kind == "mode":
                period = [part.positions(record) for record in range(len(self.run.times))]
                starts.append(np.mean(period, axis=0))
            elif self.run.kind == "equilibrium" and part.X is not None:
                starts.append(part.X)
            elif k < len(files) and files[k] > 0:
                first = self.run.bodies[part.name].segments[0]
                nearest = KDTree(first.X).query(part.X)[1]
                starts.append(first.positions(0)[nearest])
            else:
                starts.append(part.positions(0))
        return starts

    # The following functions return points [m] or values of a part, see `_Part`.

    def _body_positions(self, name: str, surface: _Surface, record: int) -> Array:
        file, step = self.run.bodies[name].at(record)
        return file.positions(step)[surface.points]

    def _body_values(
        self, name: str, surface: _Surface, field: str, record: int
    ) -> tuple[Array, bool] | None:
        """Values of a field of a body; those that are not constant on the pieces are means at
        points over the pieces that share them."""
        if not self.run.has_field(name, field):
            if field == "tension" and not self.run.bodies[name].is_film:
                return self._mean_tension(name, len(surface.pieces), field, record)
            return None
        file, step = self.run.bodies[name].at(record)
        at_corners = file.at_corners(field, step)[surface.origin]
        is_line = surface.pieces.shape[1] == 2
        if is_line or field in _KINDS or not np.ptp(at_corners, axis=1).any():
            return at_corners.mean(axis=1), False
        corners = surface.pieces.ravel()
        count = np.bincount(corners, minlength=len(surface.points))
        sums = np.bincount(corners, weights=at_corners.ravel(), minlength=len(surface.points))
        return np.where(count > 0, sums / np.maximum(count, 1), np.nan), True

    def _mean_tension(
        self, name: str, pieces: int, field: str, record: int
    ) -> tuple[Array, bool] | None:
        if field != "tension":
            return None
        mean = self.run.mean_tension(name, float(self.run.times[record]))
        return np.full(pieces, mean), False

    def _connector_positions(self, lines: Integers, record: int) -> Array:
        ends = self.run.connector_lines(float(self.run.times[record]))
        return ends[lines].reshape(-1, 3)

    def _solid_positions(self, number: int, record: int) -> Array:
        return self.run.solid_points(float(self.run.times[record]))[number]

    def _dot_position(self, number: int, record: int) -> Array:
        return self.run.dots(float(self.run.times[record]))[number : number + 1]

    def _travels_far(self) -> bool:
        """Whether the parts travel further in the run than about their size."""
        boxes = []
        for record in (0, len(self.run.times) - 1):
            parts = self._parts[self._meshes.index(self._files(record))]
            points = np.concatenate([part.positions(record) for part in parts])
            boxes.append((points.min(axis=0), points.max(axis=0)))
        size = max(float((high - low).max()) for low, high in boxes)
        # The distance between the centres of both boxes.
        way = np.abs(np.sum(boxes[1], axis=0) - np.sum(boxes[0], axis=0)).max() / 2
        return bool(way > (_FAR - 1) * size)


def _no_values(field: str, record: int) -> None:
    """Solids and points have no fields."""


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
    return _Surface(points[first_of_each], pieces[origin], origin)


# ---- as JSON -------------------------------------------------------------------------------------


def _components(fields: Sequence[str]) -> dict[int, list[tuple[str, int]]]:
    """Of each vector, by its number: names of what can be shown of it, with the numbers of these
    fields."""
    found = {}
    for number, name in enumerate(fields):
        ends = [end for end in COMPONENTS if f"{name}_{end}" in fields]
        if ends:
            shown = [(end, fields.index(f"{name}_{end}")) for end in ends]
            found[number] = [("magnitude", number), *shown]
    return found


def _mesh(part: _Part, start: Array) -> dict[str, Any]:
    """A part with its pieces, and its points at the start and in the stress-free mesh [m]."""
    # Numbers of 32 bits are differences from a point of the part, as it may be far from the origin.
    origin = start.mean(axis=0)
    found = {
        "name": part.name,
        "corners": part.pieces.shape[1],
        "pieces": binary(part.pieces, np.uint32),
        "origin": origin.tolist(),
        "start": binary(start - origin, np.float32),
    }
    if part.X is not None:
        found["X"] = binary(part.X, np.float64)
    return found


def _legend(name: str, colours: Colouring) -> dict[str, Any]:
    """The colours of a field, with its scale or the names of its kinds."""
    legend: dict[str, Any] = {
        "name": NAMES.get(name, name),
        "smooth": colours.scale is not None,
        "onLines": name in LINE_FIELDS,
        "hasMissing": colours.has_missing,
        "hasSlack": colours.has_slack,
        # The last row is that of what has no value.
        "table": np.rint(255 * colours.table).astype(int).tolist(),
        "names": [],
    }
    if colours.scale is not None:
        factor, _ = colours.scale.label
        return legend | {
            "low": colours.scale.low,
            "high": colours.scale.high,
            "ends": colours.scale.ends,
            "beyond": colours.scale.beyond,
            "factor": factor,
            "unit": colours.scale.multiple,
        }
    from matplotlib.colors import to_rgb

    # Each kind is listed with the row of the table that has its colour.
    for kind, colour in colours.names.items():
        distance = abs(colours.table[:-1] - np.asarray(to_rgb(colour))).sum(axis=1)
        legend["names"].append([kind, int(distance.argmin())])
    return legend
