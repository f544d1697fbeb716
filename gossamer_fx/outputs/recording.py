"""The folder of a run, from which pictures and reports are drawn and which other programs may read.

    run.json           the scene, the arguments of its items, versions, how the run was made and how it ended
    ledger.csv         energies, momenta, errors, iterations of every step: `Ledger`
    gas.csv            pressure, temperature, volume and mass of each chamber, if there is gas
    states.csv         fractions of area of the films that are taut and wrinkled
    points.csv         positions of the bodies without a mesh, if there are any
    solids.csv         origin and axes of the solids that move, if there are any; their shapes are in run.json
    probes.csv         the probes that were asked for
    fields/NAME.bp     fields of each body on a mesh: `VTX`

`RunReader` reads the folder.  All files are written by other outputs; `Recording` makes these, and
`run.json` in addition.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check, on_rank_zero
from gossamer_fx.fields.groups import groups_of
from gossamer_fx.model.body import Body, is_on_mesh
from gossamer_fx.outputs.arguments import arguments_of
from gossamer_fx.outputs.description import describe, versions
from gossamer_fx.outputs.file_names import file_name
from gossamer_fx.outputs.ledger import Ledger
from gossamer_fx.outputs.output import Probe, make_parent, replace_file
from gossamer_fx.outputs.run_file import FORMAT
from gossamer_fx.outputs.schedule import Schedule
from gossamer_fx.outputs.solid_frames import FramePart, as_data, moves, solids_of
from gossamer_fx.outputs.vtx import VTX, Probes
from gossamer_fx.probes.points import GAS, AreaFraction, GasState
from gossamer_fx.probes.run import Run

# The third state of a film is slack; its area is the remainder.
RECORDED_STATES = ("taut", "wrinkled")

# Files and folders of a run, which are locked together.
FILES = (
    "run.json",
    "ledger.csv",
    "gas.csv",
    "states.csv",
    "points.csv",
    "solids.csv",
    "probes.csv",
    "fields",
)
# Default fields of a film: enough to see its shape, its wrinkles, and where it may tear.
FILM_FIELDS = ("displacement", "state", "stress1", "strain2")

# A run has finished if it ends before its end time by less than this fraction of it: round-off.
_END_TOLERANCE = 1e-12


@check_arguments
class Recording:
    """Writes the folder of a run; see the module for its files.

    Args:
        folder: of the run; files of the same names are replaced.
        fields: names of fields by the names of films, see `gx.fields`.  Default: displacement, state, the
            larger stress, the smaller strain, and the pressure if the film bounds a chamber.  Of other
            bodies the displacement is recorded.
        probes: further numbers by name, see `outputs.Probes`.
        every: steps between two records of the fields; the first and the last state are always recorded.
        times: at which fields are recorded instead [s].
        title: a line for pictures and reports.
        states_every: steps between two rows of states.csv; default: as often as the fields.

    Raises:
        InputError: when the run is made: an unknown field or film, or a folder that cannot be written.

    Example:
        >>> ball = gx.PointMass(2.0, comm=comm, name="ball")
        >>> recording = gx.Recording(folder / "throw", title="A throw")
        >>> throw = gx.Simulation(gx.Scene(ball), gx.Midpoint(dt=0.1), outputs=[recording])
        >>> throw.run(until=0.2)
        >>> sorted(path.name for path in (folder / "throw").iterdir())
        ['ledger.csv', 'points.csv', 'run.json']
    """

    def __init__(
        self,
        folder: str | Path,
        fields: Mapping[str, Sequence[str]] | None = None,
        *,
        probes: Mapping[str, Probe] | None = None,
        every: int = 10,
        times: Sequence[float] = (),
        title: str = "",
        states_every: int | None = None,
    ) -> None:
        self.folder = Path(folder)
        self.title = title
        self.fields = dict(fields or {})
        self.probes = dict(probes or {})
        self.schedule = Schedule(every, tuple(times))
        self.states_schedule = self.schedule
        if states_every is not None:
            self.states_schedule = Schedule(states_every)
        self.has_begun = False  # whether a state was recorded
        self._fields: dict[str, VTX] = {}
        self._tables: dict[str, Probes | Ledger] = {}

    @property
    def times(self) -> Sequence[float]:
        """Times that the run must meet [s]."""
        return self.schedule.times

    @property
    def writes(self) -> Sequence[Path]:
        """Files and folders that no other run may write."""
        return [self.folder / name for name in FILES]

    # ---- the protocol of outputs -------------------------------------------------------------------------------

    def open(self, run: Run) -> None:
        """Check the request, and make all outputs.

        Raises:
            InputError: an unknown field or film, or a folder that cannot be written.
        """
        self._prepare(run)
        for _, output in self._outputs():
            output.open(run)

    def resume(self, run: Run, cursor: Mapping[str, Any]) -> None:
        """Continue after a restart, from the positions of all files in a checkpoint."""
        self._prepare(run)
        for name, output in self._outputs():
            output.resume(run, cursor[name])

    def cursor(self) -> dict[str, Any]:
        """Positions in all files, for a checkpoint."""
        return {name: output.cursor() for name, output in self._outputs()}

    def record(self, run: Run, last: bool) -> None:
        """Record the state wherever it is due; `last`: in all files."""
        self.has_begun = True
        for _, output in self._outputs():
            output.record(run, last)
        # Pictures may be drawn while the run goes on: they need run.json from the start.
        if run.step == 0:
            self._write(run, "running")

    def record_fields(self, run: Run) -> None:
        """Record the fields of the present state, unless they were just recorded."""
        for output in self._fields.values():
            if output.last_time != run.time:
                output.record(run, last=True)

    def close(self, run: Run) -> None:
        """Close all files, and write how the run ended."""
        for _, output in self._outputs():
            output.close(run)
        # `Simulation` closes its outputs while an error of a step passes.
        failure = sys.exception()
        if failure is not None:
            self._write(run, f"stopped: {failure}")
        elif run.time >= run.until * (1 - _END_TOLERANCE):
            self._write(run, "finished")
        else:
            self._write(run, "stopped")

    # ---- outputs for the files ---------------------------------------------------------------------------------

    def _outputs(self) -> Iterator[tuple[str, VTX | Probes | Ledger]]:
        """The outputs for the files, by the names under which checkpoints store their cursors."""
        for name, output in self._fields.items():
            yield f"fields of {name}", output
        yield from self._tables.items()

    def _prepare(self, run: Run) -> None:
        """Make the outputs, and the part of run.json that does not change.

        Raises:
            InputError: a film of `fields` is not in the scene, or the folder cannot be written.
        """
        make_parent(run.comm, self.folder / "run.json")
        films = [body for body in run.system.bodies if isinstance(body, Membrane)]
        names = [film.name for film in films]
        for name in self.fields:
            check(
                name in names,
                f"Recording '{self.folder}': the scene has no film '{name}'; its films are: "
                f"{', '.join(names) or 'none'}.",
            )
        self._solids = solids_of(run.system)
        self._fields = self._make_fields(run)
        self._tables = dict(self._make_tables(run, films))
        self._about = {
            "format": FORMAT,
            "title": self.title,
            "scene": describe(run),
            "arguments": arguments_of(run.scene.items),
            "stepper": {"kind": type(run.stepper).__name__, "dt": run.stepper.dt},
            "fields": {name: list(output.fields) for name, output in self._fields.items()},
            "solids": [as_data(solid) for solid in self._solids],
            "versions": versions(),
            "ranks": run.comm.size,
        }
        if any("group" in output.fields for output in self._fields.values()):
            self._about["groups"] = groups_of(films)[0]

    def _make_fields(self, run: Run) -> dict[str, VTX]:
        """The outputs of fields by the names of bodies."""
        outputs = {}
        for body in run.system.bodies:
            if not is_on_mesh(body):
                continue
            outputs[body.name] = VTX(
                self.folder / "fields" / f"{file_name(body.name)}.bp",
                body,
                fields=self.fields.get(body.name) or _default_fields(body, run),
                every=self.schedule.every,
                times=self.schedule.times,
            )
        return outputs

    def _make_tables(
        self,
        run: Run,
        films: Sequence[Membrane],
    ) -> Iterator[tuple[str, Probes | Ledger]]:
        """The tables by their file names; those without columns are left out."""
        gas: dict[str, Probe] = {}
        for name, state in run.chambers.items():
            for quantity in GAS:
                gas[f"{name} {quantity}"] = GasState(state.chamber, quantity)
        states: dict[str, Probe] = {}
        for film in films:
            for fraction in RECORDED_STATES:
                states[f"{film.name} {fraction}"] = AreaFraction(film, fraction)
        points: dict[str, Probe] = {}
        for body in run.system.bodies:
            if not is_on_mesh(body):
                for i, axis in enumerate("xyz"):
                    points[f"{body.name} {axis}"] = _Coordinate(body, i)
        columns: dict[str, Mapping[str, Probe]] = {
            "probes.csv": self.probes,
            "gas.csv": gas,
            "states.csv": states,
            "points.csv": points,
            "solids.csv": self._frame_columns(),
        }
        for name, probes in columns.items():
            schedule = Schedule()
            if name == "states.csv":
                # Areas are integrals over all films, dearer than the other columns.
                schedule = self.states_schedule
            if probes:
                path = self.folder / name
                yield name, Probes(path, probes, every=schedule.every, times=schedule.times)
        yield "ledger.csv", Ledger(self.folder / "ledger.csv")

    def _frame_columns(self) -> dict[str, Probe]:
        """Columns of solids.csv: origin and axes of each solid that moves."""
        columns: dict[str, Probe] = {}
        moving = [solid for solid in self._solids if moves(solid)]
        for number, solid in enumerate(moving, start=1):
            # Solids may have the same name; the number makes the columns unique.
            for i, vector in enumerate(("", "d1", "d2", "d3")):
                for j, axis in enumerate("xyz"):
                    columns[f"{number} {solid.name} {vector}{axis}"] = FramePart(solid, 3 * i + j)
        return columns

    def _write(self, run: Run, status: str) -> None:
        """Write run.json with how the run ended, or that it runs."""
        statistics = {
            "time": run.time,
            "until": run.until,
            "steps": run.step,
            "halved": run.substeps,
            "iterations": run.iterations,
            "iterations a step": run.iterations / max(run.step, 1),
            "seconds": run.seconds,
            "seconds of compilation": run.compile_seconds,
            "at rest": run.at_rest,
            "energy error": run.energy_error,
            "mass error": run.mass_error,
        }
        about = self._about | {"status": status, "statistics": statistics}
        # Records of equilibria and modes have more to tell, see `static_records`.
        about |= getattr(run, "about", {})
        text = json.dumps(about, indent=1, ensure_ascii=False)
        on_rank_zero(run.comm, lambda: replace_file(self.folder / "run.json", text))


class _Coordinate:
    """A coordinate [m] of the first node of a body, as a probe."""

    def __init__(self, body: Body, axis: int) -> None:
        self._body = body
        self._axis = axis

    def __call__(self, run: Run) -> float:
        """The coordinate in the state of a run."""
        positions = run.system.state[self._body].positions()
        # Ranks without the node contribute minus infinity.
        own = positions[:1, self._axis].max(initial=-np.inf)
        return float(run.comm.allreduce(own, MPI.MAX))


def _default_fields(body: Body, run: Run) -> tuple[str, ...]:
    """Fields of a body that are recorded if none were asked for."""
    if not isinstance(body, Membrane):
        return ("displacement",)
    enclosures = [state.chamber.enclosure for state in run.chambers.values()]
    films = [film for enclosure in enclosures if enclosure for film in enclosure.films]
    bounds_gas = any(film is body for film in films)
    if bounds_gas:
        return (*FILM_FIELDS, "pressure")
    return FILM_FIELDS
