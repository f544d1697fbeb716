"""Fields of a body as VTU files and a PVD file, which ParaView, VisIt and pyvista read.

Next to `film.pvd` are in the folder `film_files`

    00007.vtu, 00007_1.vtu      record 7 of rank 0, and of rank 1
    mesh_00000.vtu, ...         the stress-free mesh of each rank, for the records from 0 on

A run that is restarted may divide the mesh among its ranks in another way.  Therefore it writes the
mesh again, with the number of its first record.

VTU was chosen among the formats of ParaView since each record is a separate file: a run that is
killed leaves whole records, a restart removes files, ranks do not wait for each other, and no
library is needed.  `tools/measure_field_formats.py` compares time and size with VTX and VTKHDF.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from dolfinx import fem

from gossamer_fx.core.checks.arguments import check_arguments, ends_in
from gossamer_fx.core.checks.errors import InputError, check, on_rank_zero, write_on_all
from gossamer_fx.core.forms.backend import cell_nodes
from gossamer_fx.core.model.body import Array, MeshBody
from gossamer_fx.records.fields.body_shape import At
from gossamer_fx.records.fields.fields import FieldFunctions, check_fields, jumps
from gossamer_fx.records.fields.units import with_unit
from gossamer_fx.records.outputs.output import Continued, Every, Schedule, Times, make_parent
from gossamer_fx.records.outputs.vtu_format import (
    DataArray,
    Entry,
    Grid,
    Integers,
    cell_blocks,
    check_end,
    read_pvd,
    write_pvd,
    write_vtu,
)
from gossamer_fx.solve.view import StateView

# Names of the files of records and of meshes.
_NUMBERED = re.compile(r"(?:mesh_)?(\d{5,})(?:_\d+)?\.vtu")


@check_arguments
class VTU(Continued):
    """Fields of one body in VTU files, one for each time and rank, and a PVD file that lists them.

    The points are at their present positions, so that the deformed shape is seen without a filter;
    the stress-free mesh is at the position less the displacement.  Fields of bodies of order 1 that
    jump between cells are values of cells; a body of order 2 has quadratic cells, each with its own
    points if a field jumps.  Arrays have their units in their names, e.g. "stress1 [Pa]".

    Args:
        path: of the PVD file, ending in `.pvd`; the VTU files are in a folder next to it,
            `film_files` of `film.pvd`.
        body: a body on a mesh; it may be left out if the scene has just one.
        fields: names, see `gx.fields`; the displacement is always written.
        at: "mean" for stresses, tensions, moments and states of films as means over the last step,
            or "end" for those at its end.
        every: steps between two records, 1 by default; the first and the last state are always
            recorded.
        times: at which fields are recorded instead [s]; not together with `every`.

    Attributes:
        last_time: of the last record [s]; None before the first.

    Raises:
        InputError: the path has another ending, or `fields` is a word; when the run is made: an
            unknown field or body, or a folder that cannot be written.

    Example:
        >>> fields = gx.outputs.VTU(folder / "film.pvd", film, fields=["stress1"])
        >>> fall = gx.Simulation(gx.Scene(film), gx.Midpoint(dt=0.1), outputs=[fields])
        >>> fall.run(until=0.2)
        >>> sorted(path.name for path in (folder / "film_files").iterdir())
        ['00000.vtu', '00001.vtu', '00002.vtu', 'mesh_00000.vtu']
    """

    def __init__(
        self,
        path: Annotated[str | Path, ends_in(".pvd")],
        body: MeshBody | None = None,
        *,
        fields: Sequence[str] = ("displacement",),
        at: At = "mean",
        every: Every | None = None,
        times: Times = (),
    ) -> None:
        self.path = Path(path)
        self.body = body
        self.fields = fields
        self.at: At = at
        self.schedule = Schedule.of("VTU", every, times)
        self.last_time: float | None = None
        self._since: float | None = None  # time [s] of the last call of `record`
        self._entries: list[Entry] = []
        self._records = 0  # number of records so far
        self._has_mesh = False  # whether the mesh of this run is written

    @property
    def times(self) -> Sequence[float]:
        """Times that the run must meet [s]."""
        return self.schedule.times

    @property
    def folder(self) -> Path:
        """Folder of the VTU files."""
        return self.path.with_name(f"{self.path.stem}_files")

    @property
    def writes(self) -> Sequence[Path]:
        return [self.path, self.folder]

    def open(self, run: StateView) -> None:
        """Check the request, and number the points that this rank writes.  Collective."""
        body = self._chosen_body(run)
        check_fields(body, self.fields)
        make_parent(run.comm, self.path, file=True)
        make_parent(run.comm, self.folder, file=False)
        names = list(dict.fromkeys(["displacement", *self.fields]))
        in_cells: list[str] = []
        # In a cell of order 1 such a field is constant.
        if body.space.ufl_element().degree == 1:
            in_cells = [name for name in names if jumps(name)]
        at_points = [name for name in names if name not in in_cells]
        self._functions = [FieldFunctions(run.system, body, at_points, at=self.at)]
        if in_cells:
            constants = ("Discontinuous Lagrange", 0)
            self._functions.append(
                FieldFunctions(run.system, body, in_cells, constants, at=self.at)
            )
        space = self._functions[0].functions[0].function_space
        topology = space.mesh.topology
        self._dimension = topology.dim
        self._owned_cells = topology.index_map(topology.dim).size_local
        cells = cell_nodes(space)[: self._owned_cells]
        # Of the nodes of all cells, ghosts included, only those of the own cells are written.
        self._nodes, numbers = np.unique(cells, return_inverse=True)
        self._cells: Integers = numbers.reshape(cells.shape)
        self._X: Array = space.tabulate_dof_coordinates()[self._nodes]
        self._blocks: list[DataArray] = cell_blocks(self._cells, self._dimension)
        self._has_mesh = False

    def _chosen_body(self, run: StateView) -> MeshBody:
        """The body whose fields are recorded: the given one, else the only one on a mesh."""
        bodies = [one for one in run.system.unknowns.bodies if isinstance(one, MeshBody)]
        names = ", ".join(f"'{one.name}'" for one in bodies) or "none"
        if self.body is None:
            check(
                len(bodies) == 1,
                f"VTU '{self.path}': say which body is meant; those on a mesh are: {names}.",
            )
            return bodies[0]
        check(
            self.body in bodies,
            f"VTU '{self.path}': '{self.body.name}' is not a body of the scene on a mesh; those "
            f"are: {names}.",
        )
        return self.body

    def record(self, run: StateView, last: bool) -> None:
        """Write the fields of the state if they are due.  Collective."""
        is_due = self.schedule.due(run.step, run.time, last, self._since)
        self._since = run.time
        if not is_due:
            return
        for functions in self._functions:
            functions.update()
        rank = run.comm.rank

        def make_folder() -> None:
            if rank == 0:
                shutil.rmtree(self.folder, ignore_errors=True)
                self.folder.mkdir(parents=True)

        # A run from the start replaces all records of an earlier one.
        if not self._records:
            write_on_all(run.comm, self.folder, make_folder)
        grid = self._grid()
        path = self.folder / _file_name(self._records, rank)

        def write_files() -> None:
            if not self._has_mesh:
                mesh = Grid(self._X, self._cells, self._dimension)
                write_vtu(self.folder / f"mesh_{path.name}", mesh, self._blocks)
            write_vtu(path, grid, self._blocks)

        write_on_all(run.comm, path, write_files)
        self._has_mesh = True
        for part in range(run.comm.size):
            file = f"{self.folder.name}/{_file_name(self._records, part)}"
            self._entries.append(Entry(run.time, part, file))
        self._records += 1
        self.last_time = run.time

        def write_list() -> None:
            if rank == 0:
                write_pvd(self.path, self._entries)

        # After the files that it lists: a run that is killed leaves a list of whole records.
        write_on_all(run.comm, self.path, write_list)

    def _grid(self) -> Grid:
        """The cells of this rank at their present positions [m], with the values of all fields."""
        arrays = {}
        for function in self._functions[0].functions:
            arrays[with_unit(function.name)] = _values(function, self._nodes)
        in_cells = {}
        for functions in self._functions[1:]:
            for function in functions.functions:
                nodes = cell_nodes(function.function_space)[: self._owned_cells, 0]
                in_cells[with_unit(function.name)] = _values(function, nodes)
        positions = self._X + arrays[with_unit("displacement")]
        return Grid(positions, self._cells, self._dimension, arrays, in_cells)

    def close(self, run: StateView) -> None:
        """Nothing to close: each record is written completely."""

    def cursor(self) -> dict[str, Any]:
        """Position for a checkpoint: number of records, and time of the last one [s]."""
        return {"records": self._records, "time": self.last_time}

    def resume(self, run: StateView, cursor: dict[str, Any]) -> None:
        """Continue after a restart: remove records after the cursor.  Collective."""
        self.open(run)
        self._since = run.time
        self._records = cursor["records"]
        self.last_time = cursor["time"]
        self._entries = run.comm.bcast(on_rank_zero(run.comm, self._cut) or [])

    def _cut(self) -> list[Entry]:
        """Remove records after the checkpoint from the list and the disk; on rank 0."""
        if not self._records:
            return []
        entries = read_pvd(self.path)
        times = sorted({entry.time for entry in entries})[: self._records]
        check(
            len(times) == self._records and times[-1] == self.last_time,
            f"'{self.path}' was replaced since the checkpoint was written, when it had "
            f"{self._records} records; put back a copy of it, or start again.",
        )
        kept = [entry for entry in entries if entry.time in times]
        for entry in kept:
            check_end(self.path.parent / entry.file)
        for records in read_records(self.path):
            for mesh in records.meshes:
                check_end(mesh)
        # First the list, so that it never names a file that is gone.
        write_pvd(self.path, kept)
        for file in self.folder.iterdir():
            number = _NUMBERED.fullmatch(file.name)
            if number is not None and int(number[1]) >= self._records:
                file.unlink()
        return kept


def _check_listed(path: Path, entries: list[Entry]) -> None:
    """Raise `InputError` if a PVD file lists a file that does not exist, or one twice: a list may
    be much longer than all files together."""
    # Sentences are written for what is wrong only: a million take half a minute.
    listed: set[str] = set()
    names_in: dict[str, set[str]] = {}
    for entry in entries:
        if entry.file in listed:
            raise InputError(f"'{path}' lists '{entry.file}' twice; write the run again.")
        listed.add(entry.file)
        folder, _, name = entry.file.rpartition("/")
        if folder not in names_in:
            # A file has any number of names, e.g. a/./b, and each folder is listed once.
            check(
                folder in ("", os.path.normpath(folder)),
                f"'{path}' names '{entry.file}' as no run does; write the run again.",
            )
            names_in[folder] = _names_in(path.parent / folder)
        if name not in names_in[folder]:
            raise InputError(
                f"'{path.parent / entry.file}' is missing; put back a copy of it, or write the "
                "run again."
            )


def _names_in(folder: Path) -> set[str]:
    """Names of the files in a folder; none if there is no such folder."""
    return set(os.listdir(folder)) if folder.is_dir() else set()


def _file_name(record: int, rank: int) -> str:
    """Name of the file of a record and a rank."""
    if rank == 0:
        return f"{record:05d}.vtu"
    return f"{record:05d}_{rank}.vtu"


def _values(function: fem.Function, nodes: Integers) -> Array:
    """Values (n,) or (n, 3) of a function at some of its nodes."""
    components = function.function_space.dofmap.bs
    values: Array = function.x.array.reshape(-1, components)[nodes]
    if components == 1:
        return values[:, 0]
    return values


@dataclass(frozen=True)
class FieldRecords:
    """Records of a body on one mesh: those of a run until it was restarted.

    Attributes:
        folder: in which the names of files begin.
        meshes: files of the stress-free mesh, one for each rank of the run.
        times: of the records [s].
        names: of the files of each record, one for each mesh: texts, as a million paths take
            seconds.
    """

    folder: Path
    meshes: list[Path]
    times: list[float]
    names: list[list[str]]

    def files(self, record: int) -> list[Path]:
        """The files of a record."""
        return [self.folder / name for name in self.names[record]]


def read_records(path: Path, folder: Path | None = None) -> list[FieldRecords]:
    """The records that a PVD file of `VTU` lists, in the order of their times.

    Args:
        folder: in which the file must be, also behind links; default: that of its path.

    Raises:
        InputError: it cannot be read, or lists files that do not exist, or one twice.
    """
    names_of_time: dict[float, list[str]] = {}
    entries = read_pvd(path, folder)
    _check_listed(path, entries)
    for entry in entries:
        names_of_time.setdefault(entry.time, []).append(entry.file)
    check(bool(names_of_time), f"'{path}' lists no files; let the run make a record.")
    names_in: dict[str, set[str]] = {}
    found: list[FieldRecords] = []
    for time, names in sorted(names_of_time.items()):
        parent, slash, name = names[0].rpartition("/")
        if parent not in names_in:
            names_in[parent] = _names_in(path.parent / parent)
        if f"mesh_{name}" in names_in[parent]:
            files = [path.parent / file for file in names]
            meshes = [file.with_name(f"mesh_{file.name}") for file in files]
            found.append(FieldRecords(path.parent, meshes, [], []))
        if not found or len(found[-1].meshes) != len(names):
            raise InputError(
                f"'{path.parent / parent}{slash}mesh_{name}' is missing; put back a copy of it, "
                "or write the run again."
            )
        found[-1].times.append(time)
        found[-1].names.append(names)
    return found
