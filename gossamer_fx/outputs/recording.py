"""The folder of a run: all that pictures, reports and other programs need to know about it.

    run.json           what the scene contains, arguments of its items, versions, how the run was made and how it ended
    ledger.csv         energies, momenta, errors, iterations of every step: `Ledger`
    gas.csv            pressure, temperature, volume and mass of each chamber, if there is gas
    states.csv         fractions of area of the films that are taut and wrinkled, when fields are written
    points.csv         positions of the bodies without a mesh, if there are any
    solids.csv         origin and axes of the solids that move, if there are any; their shapes are in run.json
    probes.csv         the probes that were asked for
    fields/NAME.bp     fields of each body on a mesh: `VTX`

`RunReader` reads it.
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
from gossamer_fx.checks.errors import InputError, check, on_rank_zero
from gossamer_fx.model.terms import Body, is_on_mesh
from gossamer_fx.outputs.arguments import arguments_of
from gossamer_fx.outputs.description import describe, versions
from gossamer_fx.outputs.file_names import file_name
from gossamer_fx.outputs.ledger import Ledger
from gossamer_fx.outputs.output import Output, Probe, make_parent, replace_file
from gossamer_fx.outputs.schedule import Schedule
from gossamer_fx.outputs.solid_frames import FramePart, as_data, moves, solids_of
from gossamer_fx.outputs.vtx import VTX, Probes
from gossamer_fx.probes.points import GAS, AreaFraction, GasState
from gossamer_fx.probes.run import Run

TOLD_STATES = ("taut", "wrinkled")  # what is neither is slack
FORMAT = 1  # of run.json and the files beside it
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
FILM_FIELDS = ("displacement", "state", "stress1", "strain2")


@check_arguments
class Recording:
    """Writes the folder of a run.

    Args:
        folder: where; files of the same names are replaced.
        fields: names for each film by its name, see `fields`; by default displacement, state, the larger stress, the
            smaller strain, and the pressure if a chamber is bounded by films.  Of other bodies it is the displacement.
        probes: further numbers, see `Probes`.
        every, times: when fields are written: every n-th step, or at these times [s]; first and last state always.
        title: a line for pictures and reports.

    Raises:
        InputError: an unknown field or film, a folder that cannot be written.
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
    ) -> None:
        self.folder, self.title = Path(folder), title
        self.fields, self.probes = dict(fields or {}), dict(probes or {})
        self.schedule = Schedule(every, tuple(times))
        self._outputs: dict[str, Output] = {}

    @property
    def times(self) -> Sequence[float]:
        return self.schedule.times

    @property
    def writes(self) -> Sequence[Path]:
        return [self.folder / name for name in FILES]

    # ---- the life of an output ---------------------------------------------------------------------------------

    def open(self, run: Run) -> None:
        self._prepare(run)
        for output in self._outputs.values():
            output.open(run)

    def resume(self, run: Run, cursor: Mapping[str, Any]) -> None:
        """Go on where a checkpoint was written."""
        self._prepare(run)
        for name, output in self._outputs.items():
            output.resume(run, cursor[name])  # type: ignore[attr-defined]

    def cursor(self) -> dict[str, Any]:
        """Where the files stand, for a checkpoint."""
        return {name: output.cursor() for name, output in self._outputs.items()}  # type: ignore[attr-defined]

    def record(self, run: Run, last: bool) -> None:
        for output in self._outputs.values():
            output.record(run, last)
        if run.step == 0:
            self._write(run, "running")

    def close(self, run: Run) -> None:
        for output in self._outputs.values():
            output.close(run)
        failure = sys.exception()
        at_end = run.time >= run.until * (1 - 1e-12)
        self._write(run, f"stopped: {failure}" if failure else "finished" if at_end else "stopped")

    # ---- what it is made of ------------------------------------------------------------------------------------

    def _prepare(self, run: Run) -> None:
        make_parent(run.comm, self.folder / "run.json")
        films = [body.name for body in run.system.bodies if isinstance(body, Membrane)]
        unknown = next((name for name in self.fields if name not in films), None)
        if unknown is not None:
            raise InputError(
                f"Recording '{self.folder}': the scene has no film '{unknown}'; its films are: "
                f"{', '.join(films) or 'none'}."
            )
        self._solids = solids_of(run.system)
        self._outputs = dict(self._parts(run))
        self._about = {
            "format": FORMAT,
            "title": self.title,
            "scene": describe(run),
            "arguments": arguments_of(run.scene.items),
            "stepper": {"kind": type(run.stepper).__name__, "dt": run.stepper.dt},
            "fields": {
                name: list(output.fields)
                for name, output in self._outputs.items()
                if isinstance(output, VTX)
            },
            "solids": [as_data(solid) for solid in self._solids],
            "versions": versions(),
            "ranks": run.comm.size,
        }

    def _parts(self, run: Run) -> Iterator[tuple[str, Output]]:
        """The outputs by name; those that can be refused come first."""
        every, times = self.schedule.every, self.schedule.times
        gas = run.chambers
        for body in run.system.bodies:
            if is_on_mesh(body):
                chosen = self.fields.get(body.name) or _usual_fields(body, run)
                yield (
                    body.name,
                    VTX(
                        self.folder / "fields" / f"{file_name(body.name)}.bp",
                        body,
                        fields=chosen,
                        every=every,
                        times=times,
                    ),
                )
        if self.probes:
            yield "probes.csv", Probes(self.folder / "probes.csv", self.probes)
        if gas:
            numbers = {
                f"{name} {q}": GasState(s.chamber, q) for name, s in gas.items() for q in GAS
            }
            yield "gas.csv", Probes(self.folder / "gas.csv", numbers)
        films = [body for body in run.system.bodies if isinstance(body, Membrane)]
        if films:
            shares = {
                f"{film.name} {state}": AreaFraction(film, state)
                for film in films
                for state in TOLD_STATES
            }
            yield "states.csv", Probes(self.folder / "states.csv", shares, every=every, times=times)
        points = [body for body in run.system.bodies if not is_on_mesh(body)]
        if points:
            places = {
                f"{body.name} {'xyz'[i]}": _Place(body, i) for body in points for i in range(3)
            }
            yield "points.csv", Probes(self.folder / "points.csv", places)
        moving = [solid for solid in self._solids if moves(solid)]
        if moving:
            frames: dict[str, Probe] = {
                f"{k} {solid.name} {part}{axis}": FramePart(solid, 3 * i + j)
                for k, solid in enumerate(moving, start=1)
                for i, part in enumerate(("", "d1", "d2", "d3"))
                for j, axis in enumerate("xyz")
            }
            yield "solids.csv", Probes(self.folder / "solids.csv", frames)
        yield "ledger.csv", Ledger(self.folder / "ledger.csv")

    def _write(self, run: Run, status: str) -> None:
        steps = max(run.step, 1)
        statistics = {
            "time": run.time,
            "until": run.until,
            "steps": run.step,
            "halved": run.substeps,
            "iterations": run.iterations,
            "iterations a step": run.iterations / steps,
            "seconds": run.seconds,
            "seconds of compilation": run.compile_seconds,
            "energy error": run.energy_error,
            "mass error": run.mass_error,
        }
        text = json.dumps(
            self._about | {"status": status, "statistics": statistics}, indent=1, ensure_ascii=False
        )
        on_rank_zero(run.comm, lambda: replace_file(self.folder / "run.json", text))


class _Place:
    """A coordinate of the first node of a body, as a probe."""

    def __init__(self, body: Body, axis: int) -> None:
        self._body, self._axis = body, axis

    def __call__(self, run: Run) -> float:
        mine = run.system.state[self._body].positions()
        return float(run.comm.allreduce(mine[:1, self._axis].max(initial=-np.inf), MPI.MAX))


def _usual_fields(body: Body, run: Run) -> tuple[str, ...]:
    if not isinstance(body, Membrane):
        return ("displacement",)
    bounds = any(
        s.chamber.enclosure is not None and s.chamber.enclosure.film is body
        for s in run.chambers.values()
    )
    return (*FILM_FIELDS, "pressure") if bounds else FILM_FIELDS


def about_run(folder: Path) -> dict[str, Any]:
    """What the run.json in a run's folder says.

    Raises:
        InputError: there is none, it is damaged, or of another format.
    """
    path = folder / "run.json"
    check(
        path.is_file(),
        f"There is no run in '{folder}'; give a folder with a run.json, as `Recording` writes.",
    )
    try:
        about: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        version, _ = about["format"], about["fields"].items()
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"'{path}' cannot be read ({error}); write the run again.") from error
    check(
        version == FORMAT,
        f"'{path}' is of format {version}, not {FORMAT}; read it with the program that wrote it.",
    )
    return about
