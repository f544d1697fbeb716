"""A run's folder, read back: tables of numbers, and the bodies at the times at which their fields were written."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import InputError, check
from gossamer_fx.mesh.quality import ALIKE, area_vectors
from gossamer_fx.model.body import Array
from gossamer_fx.outputs.adios import adios2_for
from gossamer_fx.outputs.field_files import noted_steps
from gossamer_fx.outputs.file_names import file_name, segments
from gossamer_fx.outputs.recording import about_run
from gossamer_fx.outputs.solid_frames import REST, placed
from gossamer_fx.plot.view import Integers, Shape, of_solid, smooth

Tables = dict[str, Array]

# straight pieces of cells by their number of nodes, in VTK's order (corners, then edges 01, 12, 20)
_TRIANGLES = {3: [[0, 1, 2]], 6: [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]}
_LINES = {2: [[0, 1]], 3: [[0, 2], [2, 1]]}
_FINE = 4000  # triangles from which on a picture is not made finer


@check_arguments
class RunReader:
    """Reads the folder of a run that a `Recording` wrote, also of one that is still going on or was killed.

    Args:
        folder: of the run.

    Raises:
        InputError: it is not the folder of a run, or its files cannot be read.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self.about = about_run(self.folder)
        self.fields: dict[str, list[str]] = self.about["fields"]
        self.meshes = {name: Mesh(self.folder / "fields", name) for name in self.fields}
        self.times: Array = min(
            (mesh.times for mesh in self.meshes.values()), key=len, default=np.zeros(0)
        )
        self._points = self.table("points.csv")
        self._frames = self.table("solids.csv")
        self.solids = [
            RecordedSolid(**solid) for solid in self.about.get("solids", [])
        ]  # older runs have none

    @property
    def films(self) -> list[str]:
        """Names of the films."""
        return [name for name, mesh in self.meshes.items() if mesh.is_film]

    @property
    def title(self) -> str:
        """Title of the run, or the name of its folder."""
        return str(self.about.get("title") or self.folder.name)

    def table(self, name: str) -> Tables:
        """Columns of "ledger.csv", "gas.csv", "probes.csv", "points.csv" or "solids.csv"; empty if the run wrote none.

        A last row that is not whole is left out.

        Raises:
            InputError: the file cannot be read, or holds something else than rows of numbers.
        """
        path = self.folder / name
        if not path.is_file():
            return {}
        try:
            with path.open(newline="", encoding="utf-8") as file:
                head, *rows = list(csv.reader(file)) or [[]]
            if rows and len(rows[-1]) != len(head):
                rows.pop()
            values = np.array([[float(word) for word in row] for row in rows])
            values = values.reshape(len(rows), len(head))
        except (OSError, ValueError, csv.Error) as error:
            raise InputError(
                f"'{path}' holds something else than numbers ({error}); write the run again."
            ) from error
        return dict(zip(head, values.T, strict=True))

    def frame(self, time: float) -> int:
        """The frame that is nearest to a time [s].

        Raises:
            InputError: no fields were written, or the time is outside the run.
        """
        check(
            len(self.times) > 0,
            f"The run in '{self.folder}' has no fields; let it run, or plot its curves.",
        )
        first, last = self.times[0], self.times[-1]
        slack = 1e-6 * (last - first)
        check(
            first - slack <= time <= last + slack,
            f"The run in '{self.folder}' goes from {first:.6g} s to {last:.6g} s; t = {time:.6g} s is not in it.",
        )
        return int(abs(self.times - time).argmin())

    def known_fields(self) -> list[str]:
        """Fields of films, or displacement where there are only lines."""
        names = [name for film in self.films or self.fields for name in self.fields[film]]
        return list(dict.fromkeys(name for name in names if name != "direction"))

    def check_field(self, field: str) -> None:
        """Raise `InputError` for a field that the run has not."""
        known = self.known_fields()
        check(
            field in known,
            f"The run in '{self.folder}' has no field {field!r}; its fields are: {', '.join(known)}.",
        )

    def values(self, field: str, frame: int) -> list[Array]:
        """Corner values (n, 3) of the triangles of each film that has the field; lengths of vectors."""
        looks = [self.meshes[film].at(frame) for film in self.films if field in self.fields[film]]
        return [segment.read(field, k)[segment.pieces] for segment, k in looks]

    def shape(self, frame: int, field: str, kinds: Callable[[Array], Integers]) -> Shape:
        """The bodies at a frame, coloured by what `kinds` makes of the values of a field on triangles."""
        corners: Array = np.zeros((0, 3, 3))
        normals: Array = corners
        values: Array = np.zeros((0, 3))
        lines: Array = np.zeros((0, 2, 3))
        for name, mesh in self.meshes.items():
            segment, k = mesh.at(frame)
            own = segment.positions(k)[segment.pieces]
            if not mesh.is_film:
                lines = np.concatenate([lines, own])
                continue
            known = field in self.fields[name]
            here = (
                segment.read(field, k)[segment.pieces] if known else np.full(own.shape[:2], np.nan)
            )
            corners, normals = (
                np.concatenate([corners, own]),
                np.concatenate([normals, segment.normals(own)]),
            )
            values = np.concatenate([values, here])
        while 0 < len(corners) < _FINE and np.ptp(values, axis=1).max() > 0:
            corners, normals = _finer(corners), _finer(normals)
            values = _finer(values[..., None])[..., 0]
        time = float(self.times[frame])
        of_triangles = kinds(values.mean(axis=1))
        for x, solid in zip(self.places(time), self.solids, strict=True):
            of_solids = of_solid(x, solid.triangles)
            corners, normals = (
                np.concatenate([corners, of_solids[0]]),
                np.concatenate([normals, of_solids[1]]),
            )
            of_triangles = np.concatenate([of_triangles, of_solids[2]])
            lines = lines if len(solid.triangles) else np.concatenate([lines, x[solid.lines]])
        return Shape(time, corners, normals, of_triangles, lines, self._dots(time))

    def places(self, time: float) -> list[Array]:
        """Points (n, 3) of each of the solids at a time [s]."""
        moving = iter(_numbers(self._frames, time).reshape(-1, 4, 3))
        return [placed(solid.X, next(moving) if solid.moves else REST) for solid in self.solids]

    def _dots(self, time: float) -> Array:
        """Positions (n, 3) of the bodies without a mesh."""
        return _numbers(self._points, time).reshape(-1, 3)


def _numbers(table: Tables, time: float) -> Array:
    """What a table says at the time nearest to one; nothing if it is empty."""
    row = int(abs(table["time"] - time).argmin()) if table else 0
    return np.array([column[row] for name, column in table.items() if name not in ("time", "step")])


class RecordedSolid:
    """A solid as `run.json` tells it; those that move have their frames in "solids.csv", in the same order."""

    def __init__(
        self, X: list[list[float]], triangles: list[list[int]], lines: list[list[int]], moves: bool
    ) -> None:
        self.X: Array = np.array(X, dtype=float)
        self.triangles = np.array(triangles, dtype=np.int64).reshape(len(triangles), 3)
        self.lines = np.array(lines, dtype=np.int64).reshape(len(lines), 2)
        self.moves = moves


class Mesh:
    """One body on a mesh, over the segments that a run and its restarts wrote."""

    def __init__(self, folder: Path, body: str) -> None:
        path = folder / f"{file_name(body)}.bp"
        self.segments = [Segment(one) for one in segments(path)]
        check(bool(self.segments), f"'{path}' is missing; write the run again.")
        self._frames = [
            (segment, k) for segment in self.segments for k in range(len(segment.times))
        ]
        self.times: Array = np.concatenate([segment.times for segment in self.segments])
        self.is_film = self.segments[0].is_film

    def at(self, frame: int) -> tuple[Segment, int]:
        """The segment that holds a frame, and its number there."""
        return self._frames[frame]


class Segment:
    """One ADIOS2 file: the mesh as the ranks of that run shared it, its points, and fields at some times.

    `pieces` (n, 3) or (n, 2) are straight triangles or lines between points X; `vertices`, of the same shape, have the
    same number where pieces share a point.
    """

    def __init__(self, path: Path) -> None:
        adios2 = adios2_for(path)
        noted = noted_steps(path)
        try:
            self._file = adios2.FileReader(str(path))
            steps = self._file.num_steps()
            check(
                steps >= noted,
                f"'{path}' has {steps} steps, but {noted} were written; put back a copy of it.",
            )
            self.times: Array = np.asarray(
                self._file.read("step", step_selection=[0, steps])
            ).ravel()
            self._blocks = len(self._file.all_blocks_info("geometry")[0])
            self.is_film: bool = int(np.ravel(self._file.read("types"))[0]) in (
                5,
                22,
                69,
            )  # VTK's triangles
            self.X, cells = self._mesh()
            self.pieces, self.vertices = self._join(cells)
        except InputError:
            raise
        except Exception as error:  # adios2 raises what its C++ side throws
            raise InputError(
                f"'{path}' cannot be read; it is damaged, or no fields were written."
            ) from error

    def _mesh(self) -> tuple[Array, Integers]:
        """Points (n, 3) and cells (m, nodes) of all blocks."""
        points, cells, offset = [], [], 0
        for block in range(self._blocks):
            x = np.asarray(self._file.read("geometry", block_id=block)).reshape(-1, 3)
            rows = np.asarray(self._file.read("connectivity", block_id=block)).ravel()
            points.append(x)
            if rows.size:
                cells.append(rows.reshape(-1, int(rows[0]) + 1)[:, 1:] + offset)
            offset += len(x)
        return np.concatenate(points), np.concatenate(cells)

    def _join(self, cells: Integers) -> tuple[Integers, Integers]:
        """Pieces by points and by vertices; those that two ranks wrote come once."""
        pieces = cells[:, np.array((_TRIANGLES if self.is_film else _LINES)[cells.shape[1]])]
        pieces = pieces.reshape(-1, pieces.shape[-1]).astype(np.int64)
        # points that stay together are one vertex
        last = len(self.times) - 1
        looks = [self.X] + [self.positions(k) for k in sorted({0, last // 2, last})]
        pitch = ALIKE * float(np.ptp(self.X, axis=0).max(initial=0.0)) or 1.0
        keys = np.rint(np.concatenate(looks, axis=1) / pitch).astype(np.int64)
        vertices = np.unique(keys, axis=0, return_inverse=True)[1].ravel()[pieces]
        first = np.sort(np.unique(np.sort(vertices, axis=1), axis=0, return_index=True)[1])
        return pieces[first], vertices[first]

    def read(self, field: str, step: int) -> Array:
        """Values (n,) of a field at the points at a step; the lengths of vectors."""
        values = self._values(field, step)
        return np.linalg.norm(values, axis=1) if values.ndim == 2 else values

    def positions(self, step: int) -> Array:
        """Of the points (n, 3) at a step [m]."""
        moved: Array = self.X + self._values("displacement", step)
        return moved

    def normals(self, corners: Array) -> Array:
        """Normals (n, 3, 3) at the corners of the pieces of a film."""
        area = area_vectors(corners)
        sums = np.zeros((int(self.vertices.max(initial=-1)) + 1, 3))
        np.add.at(sums, self.vertices.ravel(), np.repeat(area, 3, axis=0))
        return smooth(area, sums[self.vertices])

    def _values(self, field: str, step: int) -> Array:
        parts = [
            np.asarray(self._file.read(field, block_id=block, step_selection=[step, 1])).ravel()
            for block in range(self._blocks)
        ]
        values: Array = np.concatenate(parts)
        return values if len(values) == len(self.X) else values.reshape(len(self.X), -1)


def _finer(values: Array) -> Array:
    """Corner values (n, 3, k) of triangles, each parted in four by the middles of its edges."""
    a, b, c = values[:, 0], values[:, 1], values[:, 2]
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    parts = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
    finer: Array = np.concatenate([np.stack(corners, axis=1) for corners in parts])
    return finer
