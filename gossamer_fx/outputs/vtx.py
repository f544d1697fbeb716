"""What a run leaves in files: fields for ParaView, numbers as a table."""

from __future__ import annotations

import ctypes
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import OutputFailure, check, on_rank_zero, write_on_all
from gossamer_fx.fields.fields import FieldFunctions, check_fields
from gossamer_fx.model.body import MeshBody, is_on_mesh
from gossamer_fx.outputs import field_files
from gossamer_fx.outputs.file_names import segment, segment_number, segments
from gossamer_fx.outputs.output import Probe, Table, evaluate_probe, make_parent
from gossamer_fx.outputs.schedule import Schedule
from gossamer_fx.probes.run import Run

if TYPE_CHECKING:
    from dolfinx.io import VTXWriter


@check_arguments
class VTX:
    """Fields of one body as an ADIOS2 file that ParaView shows over time; "Warp By Vector" deforms the mesh.

    One file holds functions of one element.  Displacement and velocity alone are continuous; with a field that jumps
    between cells all are discontinuous of the body's order, since ParaView does not follow cell data in time
    (ADIOS2 issue 4179).  The mesh is written once.  A run that goes on, also after a restart, begins another file:
    `film.bp`, `film_0001.bp`, ...; none of them holds a time that another one has.

    Args:
        path: `.bp`; made at the first record, so that a run that is refused destroys nothing.
        body: a body on a mesh; it may be left out if the scene has just one.
        fields: names, see `fields`.
        every, times: every n-th step, or at these times [s]; the first and the last state always.

    Raises:
        InputError: an unknown field or body, a folder that cannot be written.
    """

    def __init__(
        self,
        path: str | Path,
        body: MeshBody | None = None,
        *,
        fields: Sequence[str] = ("displacement",),
        every: int = 1,
        times: Sequence[float] = (),
    ) -> None:
        self.path, self.body, self.fields = Path(path), body, fields
        self.schedule = Schedule(every, tuple(times))
        check(
            self.path.suffix == ".bp", f"VTX cannot write '{path}'; give a name that ends in .bp."
        )
        check(
            not isinstance(fields, str),
            f"VTX '{path}': fields is {fields!r}; give a tuple of names, ({fields!r},).",
        )
        self._writer: VTXWriter | None = None
        # Number of the segment that is or was written last, and what it holds.
        self._segment = 0
        self._steps = 0
        self.last_time: float | None = None  # [s] of the last step that was written
        self._lengths: field_files.Lengths = {}

    @property
    def times(self) -> Sequence[float]:
        return self.schedule.times

    @property
    def writes(self) -> Sequence[Path]:
        return [self.path]

    def open(self, run: Run) -> None:
        body = self._chosen(run)
        check_fields(body, self.fields)
        make_parent(run.comm, self.path, file=False)
        self._functions = FieldFunctions(run.system, body, self.fields)

    def _chosen(self, run: Run) -> MeshBody:
        bodies = [b for b in run.system.bodies if is_on_mesh(b)]
        names = ", ".join(f"'{b.name}'" for b in bodies) or "none"
        if self.body is None:
            check(
                len(bodies) == 1,
                f"VTX '{self.path}': say which body is meant; those on a mesh are: {names}.",
            )
            return bodies[0]
        check(
            self.body in bodies,
            f"VTX '{self.path}': '{self.body.name}' is no body of the scene on a mesh; those are: {names}.",
        )
        return self.body

    def record(self, run: Run, last: bool) -> None:
        if not self.schedule.due(run.step, run.time, last):
            return
        self._functions.update()
        path = segment(self.path, self._segment)
        first_rank = run.comm.rank == 0
        if self._segment == 0 and self._steps == 0:  # a run from the start has no later segments
            on_rank_zero(run.comm, self._remove_later)
        if self._writer is None:
            write_on_all(run.comm, path, lambda: field_files.clear(path) if first_rank else None)
        try:
            write_on_all(run.comm, path, lambda: self._write(run))
        except OutputFailure:
            self._abandon()
            raise
        steps = self._steps + 1
        lengths = write_on_all(
            run.comm, path, lambda: field_files.note_steps(path, steps) if first_rank else {}
        )
        self._lengths = run.comm.bcast(lengths)
        self._steps = steps
        self.last_time = run.time

    def _write(self, run: Run) -> None:
        if self._writer is None:
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
        if self._writer is not None:
            writer, self._writer = self._writer, None
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
        if self._steps:
            self._segment += 1
            self._steps = 0

    def cursor(self) -> dict[str, Any]:
        return {
            "segment": self._segment,
            "steps": self._steps,
            "time": self.last_time,
            "bytes": self._lengths,
        }

    def resume(self, run: Run, cursor: dict[str, Any]) -> None:
        self.open(run)
        self._segment = cursor["segment"]
        self._steps = cursor["steps"]
        self.last_time = cursor["time"]
        on_rank_zero(run.comm, lambda: self._cut(cursor))
        self._next_segment()

    def _cut(self, cursor: dict[str, Any]) -> None:
        """Remove what came after the cursor: the end of its segment, and later segments."""
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
            if (segment_number(self.path, other) or 0) > self._segment and other.is_dir():
                shutil.rmtree(other)


@check_arguments
class Probes:
    """CSV of named numbers: columns time [s], step, and a probe each.

    Args:
        path: of the table.
        probes: functions of the run that return a number, the same on every rank; see `probes` for ready-made ones.
        every, times: every n-th step, or at these times [s]; the first and the last state always.

    Raises:
        InputError: a probe that raises, or returns something else than a finite number, or different ones on
            different ranks; tried before the first step.
    """

    def __init__(
        self,
        path: str | Path,
        probes: Mapping[str, Probe],
        *,
        every: int = 1,
        times: Sequence[float] = (),
    ) -> None:
        self.path, self.probes = Path(path), dict(probes)
        self.schedule = Schedule(every, tuple(times))
        check(
            bool(self.probes),
            f"Probes '{path}': there is none; give a dict of names and functions of the run.",
        )
        for name, probe in self.probes.items():
            check(
                callable(probe),
                f"Probe '{name}' is {probe!r}; give a function of the run that returns a number.",
            )
            check(
                name not in ("time", "step"),
                f"Probe '{name}' has the name of a column that exists; rename it.",
            )
        self._table, self._head = Table(self.path), ["time", "step", *self.probes]

    @property
    def times(self) -> Sequence[float]:
        return self.schedule.times

    @property
    def writes(self) -> Sequence[Path]:
        return [self.path]

    def open(self, run: Run) -> None:
        make_parent(run.comm, self.path)
        self._row(run)
        self._table.create(run.comm, self._head)

    def cursor(self) -> dict[str, Any]:
        return self._table.cursor()

    def resume(self, run: Run, cursor: dict[str, Any]) -> None:
        self._row(run)
        self._table.cut(run.comm, self._head, cursor)

    def _row(self, run: Run) -> list[float]:
        return [
            evaluate_probe(run, f"Probe '{name}'", probe) for name, probe in self.probes.items()
        ]

    def record(self, run: Run, last: bool) -> None:
        if self.schedule.due(run.step, run.time, last):
            self._table.append(run.comm, [float(run.time), run.step, *self._row(run)])

    def close(self, run: Run) -> None:
        pass


def _keep_for_ever(writer: VTXWriter) -> None:
    """Add a reference that is never given back.

    The destructor of ADIOS2 closes the files once more; where they cannot be written it throws, which
    ends the program by a signal.
    """
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(writer))
