"""Fields of a body as files for ParaView, and values of probes as a table."""

from __future__ import annotations

import ctypes
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import OutputFailure, check, on_rank_zero, write_on_all
from gossamer_fx.core.model.body import MeshBody
from gossamer_fx.records.fields.fields import FieldFunctions, check_fields
from gossamer_fx.records.outputs import field_files
from gossamer_fx.records.outputs.field_output import FieldOutput
from gossamer_fx.records.outputs.file_names import segment, segment_number, segments
from gossamer_fx.records.outputs.output import make_parent
from gossamer_fx.solve.view import Run

if TYPE_CHECKING:
    from dolfinx.io import VTXWriter


@check_arguments
class VTX(FieldOutput):
    """Fields of one body in an ADIOS2 file, which ParaView shows over time.

    In ParaView, "Warp By Vector" deforms the mesh.  One file contains functions of one element.
    Displacement and velocity alone are continuous.  With a field that jumps between cells, all are
    discontinuous of the body's order, since ParaView does not follow cell data in time (ADIOS2
    issue 4179). The mesh is written once.  A run that continues, also after a restart, begins
    another file, `film.bp`, `film_0001.bp`, ...; each time is in one of them only.

    Args:
        path: of the file, ending in `.bp`.  It is made at the first record, so that a run that is
            refused destroys nothing.
        body: a body on a mesh; it may be left out if the scene has just one.
        fields: names, see `gx.fields`.
        every: steps between two records; the first and the last state are always recorded.
        times: at which fields are recorded instead [s].

    Attributes:
        last_time: of the last record [s]; None before the first.

    Raises:
        InputError: the path has another ending; when the run is made: an unknown field or body, or
            a folder that cannot be written.

    Example:
        >>> fields = gx.outputs.VTX(folder / "film.bp", film, fields=["displacement"], every=5)
        >>> fields.schedule.every
        5
    """

    ending = ".bp"

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
        self._writer: VTXWriter | None = None
        self._segment = 0  # number of the segment that is or was written last
        self._steps = 0  # records in it
        self._lengths: field_files.Lengths = {}  # of the segment's files, after the last record

    @property
    def writes(self) -> Sequence[Path]:
        return [self.path]

    def open(self, run: Run) -> None:
        """Check the request, and make functions of the fields.  Collective.

        Raises:
            InputError: an unknown field or body, or a folder that cannot be written.
        """
        body = self.chosen_body(run)
        check_fields(body, self.fields)
        make_parent(run.comm, self.path, file=False)
        self._functions = FieldFunctions(run.system, body, self.fields)

    def record(self, run: Run, last: bool) -> None:
        """Write the fields of the state if they are due.  Collective.

        Raises:
            OutputFailure: the file cannot be written; earlier records are whole.
        """
        if not self.schedule.due(run.step, run.time, last):
            return
        self._functions.update()
        comm = run.comm
        path = segment(self.path, self._segment)
        steps = self._steps + 1

        def clear() -> None:
            if comm.rank == 0:
                field_files.clear(path)

        def note_steps() -> field_files.Lengths:
            if comm.rank == 0:
                return field_files.note_steps(path, steps)
            return {}

        # A run from the start replaces all segments of an earlier one.
        if self._segment == 0 and self._steps == 0:
            on_rank_zero(comm, self._remove_later)
        if self._writer is None:
            write_on_all(comm, path, clear)
        try:
            write_on_all(comm, path, lambda: self._write(run))
        except OutputFailure:
            self._abandon()
            raise
        # After the writing: a restart cuts the file at these lengths.
        lengths = write_on_all(comm, path, note_steps)
        self._lengths = comm.bcast(lengths)
        self._steps = steps
        self.last_time = run.time

    def _write(self, run: Run) -> None:
        """Write the functions at the time of the run [s]; the first call makes the file.
        Collective.

        Raises:
            RuntimeError: ADIOS2 cannot write; the caller turns it into an `OutputFailure`.
        """
        if self._writer is None:
            # Imported here: reading the options of a run must not load ADIOS2.
            from dolfinx.io import VTXWriter
            from dolfinx.io.utils import VTXMeshPolicy

            self._writer = VTXWriter(
                run.comm,
                segment(self.path, self._segment),
                self._functions.functions,
                engine="BP5",
                mesh_policy=VTXMeshPolicy.reuse,
            )
        self._writer.write(run.time)

    def close(self, run: Run) -> None:
        """Close the file; a run that continues begins the next segment (another file).  Collective.

        Raises:
            OutputFailure: the last data cannot be written.
        """
        if self._writer is not None:
            writer = self._writer
            # Also if closing fails, the file must not be closed again.
            self._writer = None
            try:
                write_on_all(run.comm, segment(self.path, self._segment), writer.close)
            except OutputFailure:
                _keep_for_ever(writer)
                raise
            self._next_segment()

    def _abandon(self) -> None:
        """Drop a writer that has failed."""
        if self._writer is not None:
            _keep_for_ever(self._writer)
            self._writer = None

    def _next_segment(self) -> None:
        """Begin the next segment, unless the present one is empty."""
        if self._steps:
            self._segment += 1
            self._steps = 0

    def cursor(self) -> dict[str, Any]:
        """Position for a checkpoint: segment, its records and lengths, and time of the last record
        [s]."""
        return {
            "segment": self._segment,
            "steps": self._steps,
            "time": self.last_time,
            "bytes": self._lengths,
        }

    def resume(self, run: Run, cursor: dict[str, Any]) -> None:
        """Continue after a restart: remove records after the cursor, and begin the next segment.

        A segment is the file of one run, `film.bp`, and of each restart, `film_0001.bp`.
        Collective.

        Raises:
            InputError: the file of the cursor is gone or was replaced, or the request is wrong.
        """
        self.open(run)
        self._segment = cursor["segment"]
        self._steps = cursor["steps"]
        self.last_time = cursor["time"]
        on_rank_zero(run.comm, lambda: self._cut(cursor))
        self._next_segment()

    def _cut(self, cursor: dict[str, Any]) -> None:
        """Remove what came after a cursor: the end of its segment, and later segments.  On rank 0.

        Raises:
            InputError: the segment is gone, shorter than it was, or was replaced.
        """
        here = segment(self.path, self._segment)
        if self._steps:
            check(
                here.is_dir(),
                f"'{here}' is gone since the checkpoint was written; put it back, or start again.",
            )
            field_files.cut(here, steps=self._steps, lengths=cursor["bytes"], time=cursor["time"])
        self._remove_later()

    def _remove_later(self) -> None:
        """Remove the segments after the present one."""
        for other in segments(self.path):
            number = segment_number(self.path, other) or 0
            if number > self._segment and other.is_dir():
                shutil.rmtree(other)


def _keep_for_ever(writer: VTXWriter) -> None:
    """Add a reference that is never given back.

    The destructor of ADIOS2 closes the files once more; where they cannot be written it throws,
    which ends the program by a signal.
    """
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(writer))
