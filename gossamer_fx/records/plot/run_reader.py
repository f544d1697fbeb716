"""Reading a run's folder: tables of numbers, and the bodies at the times at which their fields were
written.

All pictures and reports of a run are drawn from what is read here, also those that are made in the
course of the run.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.drawing import table
from gossamer_fx.core.mesh.linear_pieces import linear_pieces, middles
from gossamer_fx.core.mesh.quality import ALIKE
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.materials.film import SLACK
from gossamer_fx.records.fields.units import (
    COMPONENTS,
    LINE_FIELDS,
    NAMES,
    VECTOR_FIELDS,
    scaled_axis,
    split_component,
    with_unit,
)
from gossamer_fx.records.outputs.recording import REST, placed
from gossamer_fx.records.outputs.run_file import file_name
from gossamer_fx.records.outputs.vtu import FieldRecords, read_records
from gossamer_fx.records.outputs.vtu_format import Grid, read_vtu
from gossamer_fx.records.plot.run_tables import RunTables
from gossamer_fx.records.plot.shapes import INK, SOLID, Integers, Shape, smooth_normals

# Triangles of a film up to which values that vary in them are drawn on triangles of a quarter of
# the size.
_FINE = 12000
_TIME_SLACK = 1e-6  # of the run's length, by which a time may lie outside it
_LINE_PARTS = 6  # numbers of a line in lines.csv: its two ends
_VECTOR_PARTS = 12  # numbers of a pose in solids.csv: origin and three axes


@check_arguments
class RunReader(RunTables):
    """Reads the folder of a run that a `Recording` wrote, also of one that is going on or was
    killed.

    Args:
        folder: of the run.

    Attributes:
        about: the contents of run.json.
        fields: names of the recorded fields, by body.
        bodies: the bodies on meshes, by name.
        axis: what `times` are: the time [s], or the load parameter of a path of equilibria.
        connector_names: of the items to which the lines of `connector_lines` belong.
        point_names: of the bodies without a mesh and of the attached masses, in the order of
            `dots`.
        groups: names of the groups of the films' cells, see `fields.groups_of`; empty if the
            field "group" was not recorded.
        times: values on the axis at which pictures can be drawn: those of the fields or, without
            bodies on meshes, of all steps.

    Raises:
        InputError: it is not the folder of a run, or its files cannot be read.

    Example:
        >>> reader = gx.plot.RunReader(folder / "fall")
        >>> reader.table("ledger.csv")["step"].tolist()
        [0.0, 1.0, 2.0]
    """

    def __init__(self, folder: str | Path) -> None:
        """Open all files of a run; its times are those at which every body was written.

        Optional tables that the run did not write (points, solids, connector lines) count as empty;
        a missing or damaged run.json or field file is an error."""
        super().__init__(folder)
        self.fields: dict[str, list[str]] = self.about["fields"]
        self.bodies = {name: RecordedBody(self.folder, name) for name in self.fields}
        self.solids = [RecordedSolid(solid) for solid in self.about.get("solids", [])]
        self._points = self._vectors("points.csv", 3)
        self._masses = self._vectors("masses.csv", 3)
        self.point_names: list[str] = []
        for file in ("points.csv", "masses.csv"):
            # The first of the columns of each point is e.g. "tip x".
            firsts = [name for name in self.table(file) if name not in self.not_values][::3]
            self.point_names += [name.removesuffix(" x") for name in firsts]
        self._poses = self._vectors("solids.csv", _VECTOR_PARTS)
        self._connectors = self._vectors("lines.csv", _LINE_PARTS)
        # The first of the columns of each line is e.g. "3 rope ax".
        firsts = [c for c in self.table("lines.csv") if c not in self.not_values][::_LINE_PARTS]
        self.connector_names = [c.partition(" ")[2].removesuffix(" ax") for c in firsts]
        self._tensions = self.table("tensions.csv")
        self.times: Array = self._points[0]
        if self.bodies:
            # a run that was killed may have written fewer steps of one body
            self.times = min((body.times for body in self.bodies.values()), key=len)
        self.groups: list[str] = self.about.get("groups", [])
        self._captions: list[str] = self.about["captions"]

    def __repr__(self) -> str:
        """Title, how the run ended, and what there is to draw."""
        names = ", ".join(f"'{name}'" for name in self.bodies) or "no bodies on a mesh"
        return (
            f"<RunReader of '{self.folder}', {self.title!r}: {self.about['status']}; "
            f"{len(self.times)} states of {names}>"
        )

    def _repr_html_(self) -> str:
        """The bodies and their fields as a table, for notebooks."""
        rows = [(name, ", ".join(fields)) for name, fields in self.fields.items()]
        caption = escape(f"{self.title}: {self.about['status']}, {len(self.times)} states")
        return f"<p>{caption}</p>{table(('body', 'fields'), rows)}"

    @property
    def films(self) -> list[str]:
        """Names of the films."""
        return [name for name, body in self.bodies.items() if body.is_film]

    @check_arguments
    def caption(self, record: int, decimals: int | None = None) -> str:
        """Words below a recorded state: those of an equilibrium or a mode, or else its time.

        Args:
            record: number of the state, see `record_at`.
            decimals: of the time; default: four digits.
        """
        self._check_record(record)
        if len(self._captions) == len(self.times):
            return self._captions[record]
        factor, unit = scaled_axis(self.axis, self.times)
        value = self.times[record] / factor
        number = f"{value:.4g}"
        if decimals is not None:
            number = f"{value:.{decimals}f}"
        return f"{self.axis.symbol} = {number} {unit}".rstrip()

    def _check_record(self, record: int) -> None:
        """Raise `InputError` unless a state was recorded under this number."""
        check(
            0 <= record < len(self.times),
            f"The run in '{self.folder}' has {len(self.times)} states; {record} is none of them.",
        )

    # ---- vectors ---------------------------------------------------------------------------------

    def _vectors(self, name: str, size: int) -> tuple[Array, Array]:
        """Times of a table, and its other columns as vectors.

        Returns:
            times (t,) [s] and vectors (t, k, size), in metres for positions; without a table empty
            arrays.
        """
        table = self.table(name)
        columns = [column for key, column in table.items() if key not in self.not_values]
        check(
            len(columns) % size == 0,
            f"'{self.folder / name}' has {len(columns)} columns, which are not groups of {size}; "
            "write the run again.",
        )
        times = self.along(table)
        if not columns:
            return times, np.zeros((len(times), 0, size))
        return times, np.stack(columns, axis=1).reshape(len(times), -1, size)

    # ---- shapes ----------------------------------------------------------------------------------

    @check_arguments
    def record_at(self, time: float) -> int:
        """The number of the recorded state that is nearest to a time, in `times`.

        Args:
            time: [s].

        Raises:
            InputError: nothing to draw was written, or the time is outside the run.
        """
        check(
            len(self.times) > 0,
            f"The run in '{self.folder}' has no fields; let it run, or plot its curves (--curves).",
        )
        first = self.times[0]
        last = self.times[-1]
        slack = _TIME_SLACK * (last - first)
        check(
            first - slack <= time <= last + slack,
            f"The run in '{self.folder}' goes from {self.axis.words(first)} to "
            f"{self.axis.words(last)}; {self.axis.words(time)} is not in it.",
        )
        return int(abs(self.times - time).argmin())

    def require_fields(self) -> None:
        """Refuse a run without recorded states.

        Raises:
            InputError: there is nothing to draw.
        """
        first_time = 0.0
        if len(self.times):
            first_time = float(self.times[0])
        self.record_at(first_time)

    def known_fields(self) -> list[str]:
        """Names of the fields of films or, where there are only lines, of lines; without the
        direction of tension.  Tensions of cables and beams come last."""
        names = [name for body in self.films or self.fields for name in self.fields[body]]
        for fields in self.fields.values():
            names += [name for name in fields if name in LINE_FIELDS]
        if self._tensions and self.bodies:
            names.append("tension")
        return list(dict.fromkeys(name for name in names if name != "direction"))

    def check_field(self, field: str) -> None:
        """Raise `InputError` for a field that the run does not have.

        Args:
            field: name of a field, e.g. "stress1", or of a component, e.g. "displacement_z".

        Raises:
            InputError: names the fields that were recorded.
        """
        known = self.known_fields()
        remedy = "draw one of these"
        if field == "direction":
            remedy = "the direction of tension is not drawn"
        elif field in NAMES:
            remedy = "if a body of the scene has it, record it by gx.Recording(folder, fields=...)"
        recorded, _ = split_component(field)
        vectors = [f"{name}_x" for name in VECTOR_FIELDS if name in known]
        components = ""
        if vectors:
            ends = ", ".join(f"_{end}" for end in COMPONENTS)
            components = f" (and {' and '.join(vectors)} for a component, with {ends})"
        check(
            recorded in known,
            f"The run in '{self.folder}' has no field {field!r}; its fields are: "
            f"{', '.join(known)}{components}; {remedy}.",
        )

    def check_part(self, field: str, part: str) -> None:
        """Raise `InputError` unless a part has a field; an empty name is not checked.

        Args:
            field: that the run has.
            part: name of a film or line.
        """
        names = [name for name in self.bodies if self.has_field(name, field)]
        if field == "tension":
            names += self._lines_with_means()
        check(
            not part or part in names,
            f"The run in '{self.folder}' has no field {field!r} of a part '{part}'; the parts with "
            f"it are: {', '.join(names)}.",
        )

    def has_field(self, name: str, field: str, part: str = "") -> bool:
        """Whether a body has a field and is the wanted part; with an empty `part` any body is.

        Lines have no component along a normal.
        """
        recorded, component = split_component(field)
        is_defined = component != "normal" or self.bodies[name].is_film
        return recorded in self.fields[name] and is_defined and part in ("", name)

    def has_slack(self, record: int, part: str = "") -> bool:
        """Whether film, or that of a part, is slack in a recorded state."""
        states = self.values("state", record, part)
        return any((np.rint(one.mean(axis=1)) == SLACK).any() for one in states)

    @check_arguments
    def values(self, field: str, record: int, part: str = "") -> list[Array]:
        """Values (n, 3) at the corners of the triangles of each film that has the field; lengths of
        vectors, unless a component is asked for, e.g. "displacement_z".  Of a field of lines they
        are the values (n, 2) at the ends of the pieces of each.

        Args:
            record: number of the recorded state, see `record_at`.
            field: name of a field; bodies that did not record it are left out.
            part: name of the only body whose values are wanted; empty: those of all.

        Raises:
            InputError: there is no such state, or a file of fields is missing or damaged.
        """
        self._check_record(record)
        found = []
        bodies = self.films
        if field in LINE_FIELDS:
            bodies = list(self.fields)
        for name in bodies:
            if self.has_field(name, field, part):
                segment, step = self.bodies[name].at(record)
                found.append(segment.at_corners(field, step))
        if field == "tension":
            for name in self._lines_with_means():
                if part not in ("", name):
                    continue
                mean = self.mean_tension(name, float(self.times[record]))
                found.append(np.full((1, 2), mean))
        return found

    def _lines_with_means(self) -> list[str]:
        """Names of connectors, and of cables and beams whose field "tension" was not recorded."""
        names = list(dict.fromkeys(self.connector_names))
        for name, body in self.bodies.items():
            if not body.is_film and "tension" not in self.fields[name]:
                names.append(name)
        return names

    def mean_tension(self, name: str, time: float) -> float:
        """Mean tension [N] of a line at a recorded time [s]; NaN if it was not recorded."""
        values = self._tensions.get(f"{name} mean [N]", np.zeros(0))
        if not len(values):
            return float("nan")
        return float(values[int(np.abs(self.along(self._tensions) - time).argmin())])

    def _line_kinds(
        self,
        names: list[str],
        field: str,
        time: float,
        kinds: Callable[[Array], Integers],
        part: str,
    ) -> Integers:
        """Rows of the table of colours (n,) of lines by their mean tension, INK for other fields.

        Args:
            time: of a recorded state [s].
            kinds: function that returns rows of the table for values (n,) of the field.
        """
        found = np.full(len(names), INK, dtype=np.int64)
        if field == "tension":
            values = self._mean_tensions(names, time)
            is_known = np.isfinite(values)
            if part:
                is_known &= np.array(names) == part
            found[is_known] = kinds(values[is_known])
        return found

    def _mean_tensions(self, names: list[str], time: float) -> Array:
        """Mean tensions (n,) [N] of lines, which may be named several times."""
        of_name = {name: self.mean_tension(name, time) for name in set(names)}
        return np.array([of_name[name] for name in names])

    def shape(
        self,
        record: int,
        field: str,
        kinds: Callable[[Array], Integers],
        part: str = "",
    ) -> Shape:
        """The scene in a recorded state, as triangles, lines and dots [m] with colours.

        Args:
            record: number of the state, see `record_at`.
            field: by which films are coloured; where a film does not have it, values are not
                numbers.
            kinds: function that returns rows of a table of colours for values (n,) of the field on
                triangles, also for those that are not numbers.
            part: name of the only body whose values are shown; empty: those of all.

        Raises:
            InputError: the files of the run cannot be read.
        """
        corners: list[Array] = [np.zeros((0, 3, 3))]
        normals: list[Array] = [np.zeros((0, 3, 3))]
        values: list[Array] = [np.zeros((0, 3))]
        states: list[Array] = [np.zeros((0, 3))]
        edges: list[Array] = [np.zeros((0, 2, 3))]
        lines: list[Array] = [np.zeros((0, 2, 3))]
        line_kinds: list[Integers] = [np.zeros(0, dtype=np.int64)]
        for name, body in self.bodies.items():
            segment, step = body.at(record)
            points = segment.positions(step)[segment.pieces]
            if not body.is_film:
                lines.append(points)
                if field in LINE_FIELDS and self.has_field(name, field, part):
                    at_ends = segment.at_corners(field, step)
                    line_kinds.append(kinds(at_ends.mean(axis=1)))
                else:
                    time = float(self.times[record])
                    names = [name] * len(points)
                    line_kinds.append(self._line_kinds(names, field, time, kinds, part))
                continue
            corners.append(points)
            edges.append(segment.edges_of(points))
            normals.append(smooth_normals(points, segment.vertices))
            for one, found in ((field, values), ("state", states)):
                if self.has_field(name, one, part):
                    found.append(segment.at_corners(one, step))
                else:
                    found.append(np.full(points.shape[:2], np.nan))
        of_films = [np.concatenate(parts) for parts in (corners, normals, values, states)]
        fine_corners, fine_normals, fine_values, fine_states = _refined(*of_films)
        of_triangles = [kinds(fine_values.mean(axis=1))]
        corners = [fine_corners]
        normals = [fine_normals]
        is_slack = np.zeros(len(fine_corners), dtype=bool)
        if field != "state":
            is_slack = np.rint(fine_states.mean(axis=1)) == SLACK
        time = float(self.times[record])
        for X, solid in zip(self.solid_points(time), self.solids, strict=True):
            surface = X[solid.triangles]
            corners.append(surface)
            normals.append(smooth_normals(surface, solid.triangles))
            of_triangles.append(np.full(len(surface), SOLID, dtype=np.int64))
            if not len(solid.triangles):
                lines.append(X[solid.lines])
                line_kinds.append(np.full(len(solid.lines), INK))
        lines.append(self.connector_lines(time))
        line_kinds.append(self._line_kinds(self.connector_names, field, time, kinds, part))
        of_all = np.concatenate(of_triangles)
        return Shape(
            time=time,
            corners=np.concatenate(corners),
            normals=np.concatenate(normals),
            kinds=of_all,
            # Solids follow the films.
            is_slack=np.pad(is_slack, (0, len(of_all) - len(is_slack))),
            lines=np.concatenate(lines),
            line_kinds=np.concatenate(line_kinds),
            dots=self.dots(time),
            edges=np.concatenate(edges),
        )

    def connector_lines(self, time: float) -> Array:
        """Ends (n, 2, 3) of ropes, springs and bars of tapes at a time [m]."""
        return _at_time(self._connectors, time).reshape(-1, 2, 3)

    def connector_tensions(self, time: float) -> Array:
        """Mean tensions (n,) [N] of the items to which these lines belong; NaN if unknown."""
        return self._mean_tensions(self.connector_names, time)

    def dots(self, time: float) -> Array:
        """Positions (n, 3) of the bodies without a mesh and of the attached masses at a time
        [m]."""
        return np.concatenate([_at_time(self._points, time), _at_time(self._masses, time)])

    def solid_points(self, time: float) -> list[Array]:
        """Points (n, 3) of each of the solids at a time [m]."""
        poses = iter(_at_time(self._poses, time).reshape(-1, 4, 3))
        return [
            placed(solid.X, next(poses, REST) if solid.moves else REST) for solid in self.solids
        ]


def _at_time(table: tuple[Array, Array], time: float) -> Array:
    """The vectors (k, size) of a table in the row whose time is nearest; zeros without rows."""
    times, vectors = table
    # Without a vector the search of the time would take longer than all else in an export.
    if not vectors.size:
        return np.zeros(vectors.shape[1:])
    return vectors[int(abs(times - time).argmin())]


def _refined(corners: Array, normals: Array, values: Array, states: Array) -> list[Array]:
    """Triangles so small that a colour for each shows how values vary.

    All triangles are cut in four until there are 12 000 or more, or values are constant in each; an
    empty array stays empty.

    Args:
        corners: (n, 3, 3) [m].
        normals: unit vectors (n, 3, 3) at the corners.
        values: (n, 3) at the corners, in the unit of a field; NaN where a film does not have it.
        states: (n, 3) of films, constant in each triangle; NaN where they were not recorded.

    Returns:
        the same four arrays for n × 4^k triangles.
    """
    parts = [corners, normals, values, states]
    while 0 < len(parts[0]) < _FINE and np.nan_to_num(np.ptp(parts[2], axis=1)).max() > 0:
        for k, part in enumerate(parts):
            # the pieces of a quadratic triangle whose middle nodes have mean values
            nodes = middles(part)
            pieces = linear_pieces(np.arange(6)[None], 2)
            parts[k] = np.concatenate([nodes[:, piece] for piece in pieces])
    return parts


class RecordedSolid:
    """A solid from run.json: name, points X (n, 3) [m], triangles, lines, and whether it moves.

    The poses of solids that move are in solids.csv, in the same order.
    """

    def __init__(self, about: dict[str, Any]) -> None:
        self.name = str(about.get("name", "solid"))
        self.X: Array = np.array(about["X"], dtype=float).reshape(-1, 3)
        self.triangles = np.array(about["triangles"], dtype=np.int64).reshape(-1, 3)
        self.lines = np.array(about["lines"], dtype=np.int64).reshape(-1, 2)
        self.moves = bool(about["moves"])


class RecordedBody:
    """One body on a mesh, in the files that a run and its restarts wrote one after the other."""

    def __init__(self, run: Path, name: str) -> None:
        """Open the files of a body, by its name, in the folder of a run."""
        records = read_records(run / "fields" / f"{file_name(name)}.pvd", run)
        self.mesh_files = [mesh for one in records for mesh in one.meshes]
        self.segments = [RecordedMesh(one, run) for one in records]
        self._located = [
            (segment, step) for segment in self.segments for step in range(len(segment.times))
        ]
        self.times: Array = np.concatenate([segment.times for segment in self.segments])
        self.is_film: bool = self.segments[0].is_film

    def at(self, record: int) -> tuple[RecordedMesh, int]:
        """The mesh of a recorded state, and the number of the state among those of the mesh."""
        return self._located[record]


class RecordedMesh:
    """A mesh as the ranks of a run divided it, and fields on it at some times.

    Attributes:
        times: of the steps [s].
        X: points (p, 3) of the stress-free mesh [m]; points that ranks share come several times,
            and those that cells share may.
        pieces: points (n, 3) of straight triangles, or (n, 2) of straight lines.
        vertices: numbers of the same shape, equal where pieces share a point.
        is_film: whether the pieces are triangles.
    """

    def __init__(self, records: FieldRecords, run: Path) -> None:
        """Read a mesh; `run` is the folder of the run, in which all files are."""
        self._records = records
        self._run = run
        self.times: Array = np.array(records.times)
        mesh = _joined([read_vtu(path, run) for path in records.meshes])
        check(
            mesh.dimension > 0,
            f"'{records.meshes[0]}' is damaged: it has no lines or triangles; write the run again.",
        )
        self.X = mesh.points
        self.is_film = mesh.dimension == 2
        self.pieces = linear_pieces(mesh.cells, mesh.dimension)
        self._cells = len(mesh.cells)
        # The last step that was read: a picture asks for several of its fields.
        self._step = -1
        self._grid = mesh
        # Over all steps [m]; None until it is asked for.
        self._mean_positions: Array | None = None
        self._find_vertices()

    def grid(self, step: int) -> Grid:
        """The shares of all ranks at a step as one grid, with names as in the files."""
        if step != self._step:
            files = self._records.files(step)
            grid = _joined([read_vtu(path, self._run) for path in files])
            check(
                len(grid.points) == len(self.X) and len(grid.cells) == self._cells,
                f"'{files[0]}' is damaged: it has {len(grid.points)} points, but its mesh has "
                f"{len(self.X)}; write the run again.",
            )
            self._grid = grid
            self._step = step
        return self._grid

    def components(self, field: str, step: int) -> Array:
        """Values of a field at a step: (p,) or (p, 3) at points, or (n,), (n, 3) in cells."""
        grid = self.grid(step)
        name = with_unit(field)
        check(
            name in grid.arrays or name in grid.cell_arrays,
            f"'{self._records.files(step)[0]}' is damaged: its field {field!r} cannot be read; "
            "write the run again.",
        )
        if name in grid.arrays:
            return grid.arrays[name]
        return grid.cell_arrays[name]

    def at_corners(self, field: str, step: int) -> Array:
        """Values of a field at the corners of the pieces at a step, of the shape of `pieces`; of
        vectors their lengths, or the component that the name asks for."""
        recorded, component = split_component(field)
        if component:
            vectors = self.vectors(recorded, step)[self.pieces]
            if component == "normal":
                normals = smooth_normals(self.positions(step)[self.pieces], self.vertices)
                return (vectors * normals).sum(axis=2)
            return vectors[..., "xyz".index(component)]
        values = self.components(field, step)
        if values.ndim == 2:
            values = np.linalg.norm(values, axis=1)
        if with_unit(field) in self.grid(step).arrays:
            return values[self.pieces]
        # The pieces of a cell follow each other.
        of_pieces = values.repeat(len(self.pieces) // self._cells)
        return of_pieces[:, None].repeat(self.pieces.shape[1], axis=1)

    def vectors(self, field: str, step: int) -> Array:
        """Vectors (p, 3) of a field at the points at a step.

        Of a mode its amplitude was recorded without a direction: the vector is the way from the
        mean position over the period.
        """
        if field != "mode_amplitude":
            return self.components(field, step)
        if self._mean_positions is None:
            all_steps = [self.positions(one) for one in range(len(self.times))]
            self._mean_positions = np.mean(all_steps, axis=0)
        return self.positions(step) - self._mean_positions

    def positions(self, step: int) -> Array:
        """Positions (p, 3) of the points at a step [m]."""
        return self.grid(step).points

    def edges_of(self, corners: Array) -> Array:
        """Ends (e, 2, 3) [m] of the edges of the pieces with these corners (n, 3, 3), each once."""
        pairs = np.concatenate([self.vertices[:, [k, (k + 1) % 3]] for k in range(3)])
        ends = np.concatenate([corners[:, [k, (k + 1) % 3]] for k in range(3)])
        first_of_each = np.unique(np.sort(pairs, axis=1), axis=0, return_index=True)[1]
        return ends[first_of_each]

    def _find_vertices(self) -> None:
        """Set `vertices`.

        Points that lie on each other in the mesh and at the start, in the middle and at the end of
        the run are one vertex.  Layers of a folded film may lie on each other for some time, but
        not in the mesh.
        """
        last = len(self.times) - 1
        positions = [self.X] + [self.positions(step) for step in sorted({0, last // 2, last})]
        pitch = ALIKE * float(np.ptp(self.X, axis=0).max(initial=0.0)) or 1.0
        keys = np.rint(np.concatenate(positions, axis=1) / pitch).astype(np.int64)
        vertex_of_point = np.unique(keys, axis=0, return_inverse=True)[1]
        self.vertices: Integers = vertex_of_point.ravel()[self.pieces]


def _joined(parts: list[Grid]) -> Grid:
    """The shares of several ranks as one grid; those without cells are left out."""
    full = [part for part in parts if len(part.cells)] or parts[:1]
    firsts = np.cumsum([0, *(len(part.points) for part in full)])
    cells = [part.cells + first for part, first in zip(full, firsts, strict=False)]

    def joined(arrays: list[Mapping[str, Array]]) -> dict[str, Array]:
        """The arrays that all shares have, one share after the other."""
        return {
            name: np.concatenate([of_part[name] for of_part in arrays])
            for name in arrays[0]
            if all(name in of_part for of_part in arrays)
        }

    return Grid(
        np.concatenate([part.points for part in full]),
        np.concatenate(cells),
        full[0].dimension,
        joined([part.arrays for part in full]),
        joined([part.cell_arrays for part in full]),
    )
