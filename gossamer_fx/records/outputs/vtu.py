"""Fields of a body as VTU files and a PVD file, which ParaView and pyvista read without ADIOS2."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check, on_rank_zero, write_on_all
from gossamer_fx.core.forms.backend import cell_nodes
from gossamer_fx.core.mesh.linear_pieces import linear_pieces
from gossamer_fx.core.model.body import Array, MeshBody
from gossamer_fx.records.fields.fields import FieldFunctions
from gossamer_fx.records.fields.units import with_unit
from gossamer_fx.records.outputs.field_output import FieldOutput
from gossamer_fx.records.outputs.output import make_parent
from gossamer_fx.records.outputs.vtu_format import (
    Entry,
    Grid,
    Integers,
    read_pvd,
    write_pvd,
    write_vtu,
)
from gossamer_fx.solve.view import Run


@check_arguments
class VTU(FieldOutput):
    """Fields of one body in VTU files, one for each time and rank, and a PVD file that lists them.

    The points are at their present positions, so that the deformed shape is seen without a filter;
    the stress-free mesh is at the position less the displacement.  Cells of order 2 are cut into
    straight pieces.  Arrays have their units in their names, e.g. "stress1 [Pa]".  Each rank writes
    its own cells.

    Args:
        path: of the PVD file, ending in `.pvd`; the VTU files are in a folder next to it,
            `film_files` of `film.pvd`.
        body: a body on a mesh; it may be left out if the scene has just one.
        fields: names, see `gx.fields`; the displacement is always written.
        every: steps between two records; the first and the last state are always recorded.
        times: at which fields are recorded instead [s].

    Attributes:
        last_time: of the last record [s]; None before the first.

    Raises:
        InputError: the path has another ending; when the run is made: an unknown field or body, or
            a folder that cannot be written.

    Example:
        >>> fields = gx.outputs.VTU(folder / "film.pvd", film, fields=["stress1"])
        >>> fall = gx.Simulation(gx.Scene(film), gx.Midpoint(dt=0.1), outputs=[fields])
        >>> fall.run(until=0.2)
        >>> sorted(path.name for path in (folder / "film_files").iterdir())
        ['00000.vtu', '00001.vtu', '00002.vtu']
    """

    ending = ".pvd"

    def __init__(
        self,
        path: str | Path,
        body: MeshBody | None = None,
        *,
        fields: Sequence[str] = ("displacement",),
        every: int = 1,
        times: Sequence[float] = (),
    ) -> None:
        super().__init__(path, body, fields, every, times)
        self._times: list[float] = []
        self._ranks: list[int] = []  # number of files of each record

    @property
    def folder(self) -> Path:
        """Folder of the VTU files."""
        return files_of(self.path)

    @property
    def writes(self) -> Sequence[Path]:
        return [self.path, self.folder]

    def open(self, run: Run) -> None:
        """Check the request, and number the points that this rank writes.  Collective.

        Raises:
            InputError: an unknown field or body, or a folder that cannot be written.
        """
        body = self.chosen_body(run)
        make_parent(run.comm, self.path, file=True)
        make_parent(run.comm, self.folder, file=False)
        names = list(dict.fromkeys(["displacement", *self.fields]))
        self._functions = FieldFunctions(run.system, body, names)
        space = self._functions.functions[0].function_space
        topology = space.mesh.topology
        owned_cells = topology.index_map(topology.dim).size_local
        pieces = linear_pieces(cell_nodes(space)[:owned_cells], topology.dim)
        # Of the nodes of all cells, ghosts included, only those of the pieces are written.
        self._nodes, numbers = np.unique(pieces, return_inverse=True)
        self._pieces: Integers = numbers.reshape(pieces.shape)
        self._X: Array = space.tabulate_dof_coordinates()[self._nodes]

    def record(self, run: Run, last: bool) -> None:
        """Write the fields of the state if they are due.  Collective.

        Raises:
            OutputFailure: a file cannot be written; earlier records are whole.
        """
        if not self.schedule.due(run.step, run.time, last):
            return
        self._functions.update()
        # A run from the start replaces all records of an earlier one.
        if not self._times:
            on_rank_zero(run.comm, self._make_folder)
        grid = self._grid()
        number = len(self._times)
        path = self.folder / _file_name(number, run.comm.rank)
        write_on_all(run.comm, path, lambda: write_vtu(path, grid))
        self._times.append(run.time)
        self._ranks.append(run.comm.size)
        self.last_time = run.time

        def write_list() -> None:
            if run.comm.rank == 0:
                write_pvd(self.path, self._entries())

        # After the files that it lists: a run that is killed leaves a list of whole records.
        write_on_all(run.comm, self.path, write_list)

    def _make_folder(self) -> None:
        """Make an empty folder for the files of a new run."""
        if self.folder.is_dir():
            shutil.rmtree(self.folder)
        self.folder.mkdir(parents=True)

    def _grid(self) -> Grid:
        """The cells of this rank, cut into straight pieces, with the values of all fields.

        Returns:
            a grid whose p points are at their present positions (p, 3) [m], with arrays (p,) or (p,
            3) by names such as "stress1 [Pa]".
        """
        arrays = {}
        for function in self._functions.functions:
            components = function.function_space.dofmap.bs
            values = function.x.array.reshape(-1, components)[self._nodes]
            if components == 1:
                values = values[:, 0]
            arrays[with_unit(function.name)] = values
        positions = self._X + arrays[with_unit("displacement")]
        return Grid(positions, self._pieces, arrays)

    def _entries(self) -> list[Entry]:
        """What the PVD file lists."""
        entries = []
        for number, (time, ranks) in enumerate(zip(self._times, self._ranks, strict=True)):
            for rank in range(ranks):
                file = f"{self.folder.name}/{_file_name(number, rank)}"
                entries.append(Entry(time, rank, file))
        return entries

    def close(self, run: Run) -> None:
        """Nothing to close: each record is written completely."""

    def cursor(self) -> dict[str, Any]:
        """Position for a checkpoint: number of records, and time of the last one [s]."""
        return {"records": len(self._times), "time": self.last_time}

    def resume(self, run: Run, cursor: dict[str, Any]) -> None:
        """Continue after a restart: remove records after the cursor.  Collective.

        Raises:
            InputError: a file of a record before the cursor is gone, or the list was replaced.
        """
        self.open(run)
        count = cursor["records"]
        entries: list[Entry] = []

        def cut() -> None:
            """Remove the records after the cursor from the list and from the disk; on rank 0.

            Raises:
                InputError: the list is damaged or was replaced, or a file of a record that is kept
                    is gone.
            """
            if count:
                entries.extend(read_pvd(self.path))
            number_of = {time: n for n, time in enumerate(sorted({e.time for e in entries}))}
            for entry in list(entries):
                file = self.path.parent / entry.file
                if number_of[entry.time] >= count:
                    entries.remove(entry)
                    file.unlink(missing_ok=True)
                else:
                    check(
                        file.is_file(),
                        f"'{file}' is gone since the checkpoint was written; put it back, or start "
                        "again.",
                    )
            left = sorted({entry.time for entry in entries})
            check(
                len(left) == count and (not left or left[-1] == cursor["time"]),
                f"'{self.path}' was replaced since the checkpoint was written, when it had {count} "
                "records; put back a copy of it, or start again.",
            )

        on_rank_zero(run.comm, cut)
        entries = run.comm.bcast(entries)
        self._times = sorted({entry.time for entry in entries})
        self._ranks = [sum(entry.time == time for entry in entries) for time in self._times]
        self.last_time = cursor["time"]


def files_of(path: Path) -> Path:
    """Folder of the VTU files of a PVD file."""
    return path.with_name(f"{path.stem}_files")


def _file_name(record: int, rank: int) -> str:
    """Name of the file of a record and a rank."""
    if rank == 0:
        return f"{record:05d}.vtu"
    return f"{record:05d}_{rank}.vtu"
