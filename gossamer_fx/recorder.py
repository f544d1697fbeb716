"""What a run leaves in files: fields for ParaView, numbers as a table."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING

from gossamer_fx.errors import InputError, check, on_rank_zero
from gossamer_fx.fields import FieldFunctions, check_fields
from gossamer_fx.parts import MeshBody, is_on_mesh
from gossamer_fx.probes import Probe
from gossamer_fx.schedule import Schedule
from gossamer_fx.simulate import Simulation, make_parent

if TYPE_CHECKING:
    from dolfinx.io import VTXWriter


class VTX:
    """Fields of one body as an ADIOS2 file that ParaView shows over time; "Warp By Vector" deforms the mesh.

    One file holds functions of one element.  Displacement and velocity alone are continuous; with a field that jumps
    between cells all are discontinuous of the body's order, since ParaView does not follow cell data in time
    (ADIOS2 issue 4179).  The mesh is written once.

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
        fields: Sequence[str] = ("displacement",),
        every: int = 1,
        times: Sequence[float] = (),
    ) -> None:
        self.path, self.body, self.fields = Path(path), body, fields
        self.schedule = Schedule(every, tuple(times))
        check(self.path.suffix == ".bp", f"VTX cannot write '{path}'; give a name that ends in .bp.")
        check(not isinstance(fields, str), f"VTX '{path}': fields is {fields!r}; give a tuple of names, ({fields!r},).")
        self._writer: VTXWriter | None = None
        self._closed = False

    @property
    def times(self) -> Sequence[float]:
        return self.schedule.times

    def open(self, run: Simulation) -> None:
        body = self._chosen(run)
        check_fields(body, self.fields)
        make_parent(run.comm, self.path)
        on_rank_zero(
            run.comm,
            lambda: check(
                not self.path.is_file(), f"VTX writes a folder, but '{self.path}' is a file; remove it or rename."
            ),
        )
        self._functions = FieldFunctions(run.system, body, self.fields)

    def _chosen(self, run: Simulation) -> MeshBody:
        bodies = [b for b in run.system.bodies if is_on_mesh(b)]
        names = ", ".join(f"'{b.name}'" for b in bodies) or "none"
        if self.body is None:
            check(len(bodies) == 1, f"VTX '{self.path}': say which body is meant; those on a mesh are: {names}.")
            return bodies[0]
        check(
            self.body in bodies,
            f"VTX '{self.path}': '{self.body.name}' is no body of the scene on a mesh; those are: {names}.",
        )
        return self.body

    def record(self, run: Simulation, last: bool) -> None:
        if not self.schedule.due(run.step, run.time, last):
            return
        check(not self._closed, f"VTX '{self.path}' is finished and cannot be continued; run to the end at once.")
        if self._writer is None:
            from dolfinx.io import VTXWriter
            from dolfinx.io.utils import VTXMeshPolicy

            self._writer = VTXWriter(
                run.comm, self.path, self._functions.functions, engine="BP4", mesh_policy=VTXMeshPolicy.reuse
            )
        self._functions.update()
        self._writer.write(run.time)

    def close(self, run: Simulation) -> None:
        if self._writer is not None:
            self._writer.close()
            self._closed = True


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
        self, path: str | Path, probes: Mapping[str, Probe], every: int = 1, times: Sequence[float] = ()
    ) -> None:
        self.path, self.probes = Path(path), dict(probes)
        self.schedule = Schedule(every, tuple(times))
        check(bool(self.probes), f"Probes '{path}': there is none; give a dict of names and functions of the run.")
        for name, probe in self.probes.items():
            check(callable(probe), f"Probe '{name}' is {probe!r}; give a function of the run that returns a number.")
            check(name not in ("time", "step"), f"Probe '{name}' has the name of a column that exists; rename it.")
        self._file: IO[str] | None = None

    @property
    def times(self) -> Sequence[float]:
        return self.schedule.times

    def open(self, run: Simulation) -> None:
        make_parent(run.comm, self.path)
        self._row(run)
        if run.comm.rank == 0:
            self._file = self.path.open("w", newline="")
            csv.writer(self._file).writerow(["time", "step", *self.probes])

    def _row(self, run: Simulation) -> list[float]:
        return [self._value(run, name, probe) for name, probe in self.probes.items()]

    def _value(self, run: Simulation, name: str, probe: Probe) -> float:
        value, problem = math.nan, ""
        try:
            value = float(probe(run))
        except InputError as error:
            problem = str(error)
        except Exception as error:  # whatever a user's function raises
            problem = f"it raises {type(error).__name__} ({error}); correct its function."
        else:
            if not math.isfinite(value):
                problem = f"it returns {value}; it must return a finite number."
        values, problems = zip(*run.comm.allgather((value, problem)), strict=True)
        found = next(filter(None, problems), "")
        if not found and max(values) - min(values) > 1e-9 * max(map(abs, values)):
            found = "it differs from rank to rank; sum what each rank has with run.comm.allreduce."
        check(not found, f"Probe '{name}' at t = {run.time:.6g} s: {found}")
        return value

    def record(self, run: Simulation, last: bool) -> None:
        if not self.schedule.due(run.step, run.time, last):
            return
        row = self._row(run)
        if self._file is not None:
            if self._file.closed:  # the run goes on after its end
                self._file = self.path.open("a", newline="")
            csv.writer(self._file).writerow([repr(float(run.time)), run.step, *map(repr, row)])
            self._file.flush()

    def close(self, run: Simulation) -> None:
        if self._file is not None:
            self._file.close()
