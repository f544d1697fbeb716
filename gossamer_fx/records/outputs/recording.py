"""The folder of a run, from which pictures and reports are drawn and which other programs may read,
and the positions and orientations of the solids in it.

    run.json           the scene, the arguments of its items, versions, how the run was made and how
                       it ended
    ledger.csv         energies, momenta, errors, iterations of every step: `Ledger`
    gas.csv            pressure, temperature, volume and mass of each chamber, if there is gas, of a
                       mixture also the masses of its species, and mass flow of each opening
    states.csv         fractions of area of the films that are taut and wrinkled, as means over a
                       step, as the tensions
    points.csv         positions of the bodies without a mesh, if there are any
    masses.csv         positions of attached masses, at the times of the fields, if there are any
    solids.csv         origin and axes of the solids that move, if there are any; their shapes are
                       in run.json
    lines.csv          ends of ropes, springs and bars of tapes, at the times of the fields, if
                       there are any
    tensions.csv       tensions of these lines and of cables and beams, at the same times
    probes.csv         the probes that were asked for
    fields/NAME.pvd    fields of each body on a mesh, and the folder fields/NAME_files: `VTU`

`RunReader` reads the folder.  `Recording` writes `run.json`, and makes the outputs that write the
other files.
"""

from __future__ import annotations

import json
import logging
import shutil
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from gossamer_fx.core.checks.arguments import check_arguments, positive
from gossamer_fx.core.checks.errors import check, on_rank_zero
from gossamer_fx.core.checks.lookups import check_known
from gossamer_fx.core.checks.relations import at_most_one
from gossamer_fx.core.drawing import BOX_CORNERS, BOX_EDGES, Solid, box_surface
from gossamer_fx.core.model.body import Array, Attached, Body, MeshBody, Port
from gossamer_fx.mechanics.bodies.cable import Curve
from gossamer_fx.mechanics.bodies.frames import DrawnAsLines
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.bodies.rigid_body import RigidBody
from gossamer_fx.mechanics.connectors.spring import AttachedMass
from gossamer_fx.records.fields.body_shape import At, has_unknown_stress
from gossamer_fx.records.fields.fields import groups_of
from gossamer_fx.records.fields.film_states import STATES, AreaFractions
from gossamer_fx.records.outputs.description import describe, origin, versions
from gossamer_fx.records.outputs.output import (
    RUN_FILES,
    Continued,
    Every,
    Probe,
    Schedule,
    Times,
    arguments_of,
    make_parent,
    replace_file,
)
from gossamer_fx.records.outputs.run_file import FORMAT, file_name
from gossamer_fx.records.outputs.tables import Ledger, Probes, TableOutput
from gossamer_fx.records.outputs.vtu import VTU
from gossamer_fx.records.probes.points import (
    AXES,
    GAS,
    GAS_UNITS,
    GasFlow,
    GasState,
    Position,
    gas_flows,
)
from gossamer_fx.solve.system.system import System
from gossamer_fx.solve.view import StateView

if TYPE_CHECKING:
    from gossamer_fx.mechanics.gas.contract import Gas

# Pose (4, 3) of a solid that is not moved: its origin [m], then its axes [-].
REST = np.vstack([np.zeros(3), np.eye(3)])


def solids_of(system: System) -> list[Solid]:
    """The solids of all terms of a scene, e.g. obstacles, and a box for each rigid body without
    any."""
    solids: list[Solid] = []
    for compiled in system.equations.shown:
        solids += compiled.solids()
    shown = {id(solid.on) for solid in solids}
    for body in system.unknowns.bodies:
        if isinstance(body, RigidBody) and id(body) not in shown:
            solids.append(equal_box(body))
    return solids


def equal_box(body: RigidBody) -> Solid:
    """The box of uniform density with the mass and the inertia of a rigid body: pictures show it
    where nothing tells the shape of the body."""
    # Euler's tensor of a box with the edges s is diag(m s²/12) along its edges.
    moments, directions = np.linalg.eigh(body.euler_tensor)
    edges = np.sqrt(12 * np.maximum(moments, 0.0) / body.mass)
    corners = BOX_CORNERS * edges / 2 @ directions.T
    lines = np.array(BOX_EDGES, dtype=np.int32)
    return Solid(body.name, corners, box_surface(corners), lines, on=body)


def pose_of(solid: Solid, system: System) -> Array:
    """Origin [m] and axes [-] of a solid in the accepted state, (4, 3); the same on every rank.

    A solid is a rigid shape in pictures: on a rigid body, with a prescribed motion, or at rest.
    Its axes are the rows 1 to 3; those of a solid that is not on a body are the coordinate axes.

    Collective: all ranks call it.
    """
    if solid.on is not None:
        # One rank has the body's only node, and all others an empty array.
        own = system.unknowns.state[solid.on].coordinates().copy()
        poses = np.concatenate(system.comm.allgather(own))
        return np.asarray(poses[0])
    origin: Array = np.zeros(3)
    if solid.motion is not None:
        origin = np.asarray(solid.motion(system.unknowns.time), dtype=float)
    # A prescribed motion moves the origin, and does not turn the axes.
    return np.vstack([REST[0] + origin, REST[1:]])


def placed(X: Array, pose: Array) -> Array:
    """Positions in space (n, 3) [m] of points X (n, 3) [m] of a solid; its pose as in `pose_of`."""
    return pose[0] + X @ pose[1:]


def moves(solid: Solid) -> bool:
    """Whether a solid is on a body, or has a prescribed motion."""
    return solid.on is not None or solid.motion is not None


def as_data(solid: Solid) -> dict[str, Any]:
    """The shape of a solid as lists, for JSON: points [m] to six digits, triangles, lines.

    Args:
        solid: a rigid shape that pictures show, with points X (n, 3) [m].
    """
    points = []
    for point in solid.X:
        # Six digits are enough for pictures, and keep the file short.
        points.append([float(f"{x:.6g}") for x in point])
    return {
        "name": solid.name,
        "X": points,
        "triangles": solid.triangles.tolist(),
        "lines": solid.lines.tolist(),
        "moves": moves(solid),
    }


def _plain(value: Any) -> Any:
    """A number, a word or None as it is, for JSON; what else there is as text."""
    if isinstance(value, float) and not np.isfinite(value):
        return str(value)
    return value if isinstance(value, str | int | float | None) else str(value)


def _pose_component(solid: Solid, index: tuple[int, int], run: StateView) -> float:
    """A component of a solid's pose (4, 3), its origin and axes, as a probe."""
    return float(pose_of(solid, run.system)[index])


# The third state of a film is slack; its area is the remainder.
RECORDED_STATES = ("taut", "wrinkled")

# Default fields of a film: enough to see its shape, its wrinkles, and where it may tear.
LOG = logging.getLogger("gossamer_fx")

FILM_FIELDS = ("displacement", "state", "stress1", "strain2")

# A run has finished if it ends before its end time by less than this fraction of it: round-off.
_END_TOLERANCE = 1e-12


@check_arguments(at_most_one("interval", "every"), at_most_one("interval", "times"))
class Recording(Continued):
    """Writes the folder of a run; see the module for its files.

    Args:
        folder: of the run.  A folder that holds another run is refused.
        fields: names of fields by the names of bodies, see `gx.fields`.  Default of films:
            displacement, state, the larger stress, the smaller strain, and the pressure if the film
            bounds a chamber; of other bodies the displacement.  A reduced film that relaxes has no
            stress.
        probes: further numbers by name, see `outputs.Probes`.
        at: "mean" for stresses, tensions, moments and states of films as means over the last step,
            or "end" for those at its end.
        every: steps between two records of the fields, 10 by default; the first and the last state
            are always recorded.
        times: at which fields are recorded instead [s]; not together with `every`.
        interval: time between two records of the fields [s] instead, each at the end of the step
            that contains it; a warning says so if steps are longer.  Not together with the others.
        title: a line for pictures and reports.
        parameters: numbers and words from which the scene was made, by name, for run.json and the
            report, e.g. {"cells": 12}.
        states_every: steps between two rows of states.csv; default: as often as the fields.
        overwrite: whether another run in the folder is replaced.  Its files are removed when the
            first state is recorded, so that a run that is refused destroys nothing.

    Raises:
        InputError: when the run is made: an unknown field or body, or a folder that cannot be
            written or holds another run.

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
        at: At = "mean",
        every: Every | None = None,
        times: Times = (),
        interval: Annotated[float, positive("s")] | None = None,
        title: str = "",
        parameters: Mapping[str, Any] | None = None,
        states_every: Every | None = None,
        overwrite: bool = False,
    ) -> None:
        self.folder = Path(folder)
        self.title = title
        self.parameters = dict(parameters or {})
        self.overwrite = overwrite
        self.fields = dict(fields or {})
        self.probes = dict(probes or {})
        self.at: At = at
        self.schedule = Schedule.of("Recording", every, times, default=10)
        if interval is not None:
            self.schedule = Schedule(interval=interval)
        # Time [s] of the last call of `record`, and multiples of the interval that had no record.
        self._since: float | None = None
        self._frames_left_out = 0
        self.states_schedule = self.schedule
        if states_every is not None:
            self.states_schedule = Schedule(states_every)
        self.has_begun = False  # whether a state was recorded
        self._status = ""  # in run.json, of this run
        self._captions: list[str] = []  # of the states of a record that is not a run
        self._clears_folder = False  # whether the first record removes the files of another run
        self._fields: dict[str, VTU] = {}
        self._tables: dict[str, TableOutput] = {}

    @property
    def times(self) -> Sequence[float]:
        """Times that the run must meet [s]."""
        return self.schedule.times

    @property
    def writes(self) -> Sequence[Path]:
        return [self.folder / name for name in RUN_FILES]

    # ---- the protocol of outputs -----------------------------------------------------------------

    def open(self, run: StateView) -> None:
        """Check the request, and make all outputs.  Collective."""
        self._prepare(run)
        self._clears_folder = bool(self.overwrite)
        for _, output in self._outputs():
            output.open(run)

    def resume(self, run: StateView, cursor: Mapping[str, Any]) -> None:
        """Continue after a restart, from the positions of all files in a checkpoint."""
        self._prepare(run)
        # All names are known before the first file is shortened to its position.
        missing = [name for name, _ in self._outputs() if name not in cursor]
        check(
            not missing,
            f"Recording: the checkpoint has no position in '{' and '.join(missing)}', so that it "
            "is of a run with another recording, or of an older version; start the run again.",
        )
        for name, output in self._outputs():
            output.resume(run, cursor[name])

    def cursor(self) -> dict[str, Any]:
        return {name: output.cursor() for name, output in self._outputs()}

    def record(self, run: StateView, last: bool) -> None:
        """Record the state of a run in all files where it is due, and that it runs in run.json.
        Collective."""
        self.has_begun = True
        self._frames_left_out += max(self.schedule.frames_in(run.time, self._since) - 1, 0)
        self._since = run.time
        caption = run.account.caption
        if caption:
            self._captions.append(caption)
        if self._clears_folder:
            # Also tables that this run does not write, e.g. of a gas that it does not have.
            on_rank_zero(run.comm, self._clear_folder)
            self._clears_folder = False
        for _, output in self._outputs():
            output.record(run, last)
        # Pictures may be drawn while the run goes on, also after a restart: they need run.json.
        if self._status != "running":
            self._write(run, "running")

    def _clear_folder(self) -> None:
        """Remove the files of another run from the folder; the folder of the fields stays.  On one
        rank.
        """
        for path in self.writes:
            if path.is_dir():
                for inner in path.iterdir():
                    if inner.is_dir():
                        shutil.rmtree(inner)
                    else:
                        inner.unlink()
            else:
                path.unlink(missing_ok=True)

    def record_fields(self, run: StateView) -> None:
        """Record the fields of the present state, unless they were just recorded."""
        is_new = any(output.last_time != run.time for output in self._fields.values())
        for output in self._fields.values():
            if output.last_time != run.time:
                output.record(run, last=True)
        for name in ("masses.csv", "lines.csv", "tensions.csv"):
            table = self._tables.get(name)
            if is_new and table is not None:
                table.record(run, last=True)

    def close(self, run: StateView) -> None:
        """Close all files, and write to `run.json` how the run ended.  Collective.

        The status is "finished", "stopped", or "stopped: " with the message of the error that is
        being raised.
        """
        for _, output in self._outputs():
            output.close(run)
        if self._frames_left_out and run.comm.rank == 0:
            LOG.warning(
                "Recording '%s': %d of the records that were asked for, %.3g s apart, are missing, "
                "as steps were longer; take shorter steps (dt, max_step), or ask for fewer.",
                self.folder,
                self._frames_left_out,
                self.schedule.interval,
            )
        # `Simulation` closes its outputs while an error of a step passes.
        failure = sys.exception()
        if failure is not None:
            self._write(run, f"stopped: {failure}")
        elif run.time >= run.account.until * (1 - _END_TOLERANCE):
            self._write(run, "finished")
        else:
            self._write(run, "stopped")

    # ---- outputs for the files -------------------------------------------------------------------

    def _outputs(self) -> Iterator[tuple[str, VTU | TableOutput]]:
        """The outputs for the files, by the names under which checkpoints store their cursors."""
        for name, output in self._fields.items():
            yield f"fields of {name}", output
        yield from self._tables.items()

    def _prepare(self, run: StateView) -> None:
        """Make the outputs, and the part of run.json that does not change.  Collective."""
        make_parent(run.comm, self.folder / "run.json")
        films = [body for body in run.system.unknowns.bodies if isinstance(body, Membrane)]
        names = [body.name for body in run.system.unknowns.bodies if isinstance(body, MeshBody)]
        for name in self.fields:
            check_known(f"Recording '{self.folder}': the scene", "body on a mesh", name, names)
        self._solids = solids_of(run.system)
        self._fields = self._make_fields(run)
        self._tables = dict(self._make_tables(run, films))
        self._about = {
            "format": FORMAT,
            "title": self.title,
            "scene": describe(run),
            "parameters": {name: _plain(value) for name, value in self.parameters.items()},
            "arguments": arguments_of(run.scene.items),
            "fields": {name: list(output.fields) for name, output in self._fields.items()},
            "at": self.at,
            "solids": [as_data(solid) for solid in self._solids],
            "versions": versions(),
            "origin": origin(),
            "ranks": run.comm.size,
        }
        if any("group" in output.fields for output in self._fields.values()):
            self._about["groups"] = groups_of(films)[0]

    def _make_fields(self, run: StateView) -> dict[str, VTU]:
        """The outputs of fields by the names of bodies: one for each body on a mesh."""
        outputs: dict[str, VTU] = {}
        for body in run.system.unknowns.bodies:
            if not isinstance(body, MeshBody):
                continue
            output = VTU(
                self.folder / "fields" / f"{file_name(body.name)}.pvd",
                body,
                fields=self.fields.get(body.name) or _default_fields(body, run),
                at=self.at,
            )
            output.schedule = self.schedule
            outputs[body.name] = output
        return outputs

    def _make_tables(
        self,
        run: StateView,
        films: Sequence[Membrane],
    ) -> Iterator[tuple[str, TableOutput]]:
        """Yield the tables by their file names; those without columns are left out.

        These are tables of gas states, area fractions of films, positions of points, poses of
        solids, the user's probes, ends of connectors, tensions, and the energy balance.
        """
        gas: dict[str, Probe] = {}
        for name, state in run.chambers.items():
            for quantity in GAS:
                gas[f"{name} {quantity} [{GAS_UNITS[quantity]}]"] = GasState(
                    state.chamber, quantity
                )
            # The mass of one species is that of the chamber.
            for one in state.species if len(state.species) > 1 else ():
                gas[f"{name} mass of {one.name} [kg]"] = partial(_mass_of, name, one)
        flows = gas_flows(run.system)
        items: Sequence[Any] = run.scene.items
        for item in items:
            if item.name in flows:
                gas[f"{item.name} flow [kg/s]"] = GasFlow(item)
        points: dict[str, Probe] = {}
        for body in run.system.unknowns.bodies:
            if not isinstance(body, MeshBody):
                for axis in AXES:
                    points[f"{body.name} {axis}"] = Position(Port(body, (0,)), axis)
        columns: dict[str, Mapping[str, Probe]] = {
            "probes.csv": self.probes,
            "gas.csv": gas,
            "points.csv": points,
            "solids.csv": self._pose_columns(),
        }
        for name, probes in columns.items():
            if probes:
                yield name, Probes(self.folder / name, probes)
        if films:
            path = self.folder / "states.csv"
            yield "states.csv", FilmStates(path, films, self.at, self.states_schedule)
        # Without fields, pictures show the state after any step.
        schedule = Schedule()
        if self._fields:
            schedule = self.schedule
        items = run.scene.items
        for name, attached in (
            ("masses.csv", mass_points(items)),
            ("lines.csv", connector_ends(items)),
        ):
            if attached:
                yield name, AttachedPoints(self.folder / name, attached, schedule)
        tensions = _tension_columns(run, self.at)
        if tensions:
            table = Probes(self.folder / "tensions.csv", tensions)
            table.schedule = schedule
            yield "tensions.csv", table
        yield "ledger.csv", Ledger(self.folder / "ledger.csv")

    def _pose_columns(self) -> dict[str, Probe]:
        """Columns of solids.csv: probes of the origin [m] and axes [-] of each solid that moves.

        A solid is a rigid shape in pictures, e.g. of a rigid body or an obstacle; each has twelve
        columns.
        """
        columns: dict[str, Probe] = {}
        moving = [solid for solid in self._solids if moves(solid)]
        for number, solid in enumerate(moving, start=1):
            # Solids may have the same name; the number makes the columns unique.
            for i, vector in enumerate(("", "d1", "d2", "d3")):
                for j, axis in enumerate("xyz"):
                    column = f"{number} {solid.name} {vector}{axis}"
                    columns[column] = partial(_pose_component, solid, (i, j))
        return columns

    def _write(self, run: StateView, status: str) -> None:
        """Write run.json with the scene and the statistics of the run so far.  Collective.

        Args:
            run: with time [s], steps, iterations, wall times [s] and closing errors.
        """
        self._status = status
        account = run.account
        statistics: dict[str, Any] = {
            "steps": run.step,
            "rejected": account.rejected,
            "iterations": account.iterations,
            "iterations a step": account.iterations / max(run.step, 1),
            "seconds": account.seconds,
            "seconds of compilation": account.compile_seconds,
        }
        if account.balance is not None:
            for name, value in asdict(account.balance).items():
                statistics[name.replace("_", " ")] = value
        axis = {**asdict(run.axis), "at": run.time, "until": account.until}
        about = self._about | {
            "kind": account.kind,
            "status": status,
            "axis": axis,
            "method": dict(account.method),
            "statistics": statistics,
            "captions": self._captions,
            **account.details,
        }
        text = json.dumps(about, indent=1, ensure_ascii=False)
        on_rank_zero(run.comm, lambda: replace_file(self.folder / "run.json", text))


def _mass_of(chamber: str, gas: Gas, run: StateView) -> float:
    """Mass [kg] of a species in a chamber, as a probe."""
    return run.chamber(chamber).mass_of(gas)


def _tension_columns(run: StateView, at: At) -> dict[str, Probe]:
    """Columns of tensions.csv: the mean tension [N] of each line; of cables, beams and connectors
    of several lines the least and the largest, too."""
    lines = [item for item in run.scene.items if isinstance(item, Curve | DrawnAsLines)]
    if not lines:
        return {}
    # Imported here: scenes without lines do not load it.
    from gossamer_fx.records.probes.lines import Tension

    columns: dict[str, Probe] = {}
    for line in lines:
        columns[f"{line.name} mean [N]"] = Tension(line, at=at)
        has_parts = isinstance(line, Curve) or len(line.lines_to_draw) > 1
        if has_parts:
            columns[f"{line.name} least [N]"] = Tension(line, "least", at=at)
            columns[f"{line.name} largest [N]"] = Tension(line, "largest", at=at)
    return columns


def _default_fields(body: Body, run: StateView) -> tuple[str, ...]:
    """Names of the fields of a body that are recorded if none were asked for."""
    if not isinstance(body, Membrane):
        return ("displacement",)
    fields: tuple[str, ...] = FILM_FIELDS
    if has_unknown_stress(body, run.system):
        fields = tuple(name for name in FILM_FIELDS if name != "stress1")
    enclosures = [state.chamber.enclosure for state in run.chambers.values()]
    films = [film for enclosure in enclosures if enclosure for film in enclosure.films]
    bounds_gas = any(film is body for film in films)
    if bounds_gas:
        return (*fields, "pressure")
    return fields


class FilmStates(TableOutput):
    """CSV file with the shares of area of films that are taut and wrinkled, two columns a film."""

    def __init__(self, path: Path, films: Sequence[Membrane], at: At, schedule: Schedule) -> None:
        super().__init__(path, schedule)
        self._fractions = {film.name: AreaFractions([film], at) for film in films}

    def values(self, run: StateView) -> dict[str, Any]:
        found = {}
        for name, fractions in self._fractions.items():
            shares = fractions(run.system)
            for state in RECORDED_STATES:
                found[f"{name} {state}"] = float(shares[STATES[state]])
        return found


class AttachedPoints(TableOutput):
    """CSV file with the positions of attached points [m], three columns a point.

    Args:
        points: by the common beginning of their columns.
    """

    def __init__(self, path: Path, points: Mapping[str, Attached], schedule: Schedule) -> None:
        super().__init__(path, schedule)
        self._points = dict(points)

    def values(self, run: StateView) -> dict[str, Any]:
        points = run.system.unknowns.state.vectors(list(self._points.values()))
        columns = [f"{name}{axis}" for name in self._points for axis in "xyz"]
        return dict(zip(columns, points.ravel().tolist(), strict=True))


def mass_points(items: Sequence[object]) -> dict[str, Attached]:
    """The attached masses of a scene, for columns like "mass x"."""
    return {f"{item.name} ": item.port for item in items if isinstance(item, AttachedMass)}


def connector_ends(items: Sequence[object]) -> dict[str, Attached]:
    """Both ends of each line of the connectors of a scene, for columns like "1 rope ax"."""
    ends: dict[str, Attached] = {}
    number = 0
    for item in items:
        if not isinstance(item, DrawnAsLines):
            continue
        for pair in item.lines_to_draw:
            number += 1
            for end, letter in zip(pair, "ab", strict=True):
                ends[f"{number} {item.name} {letter}"] = end
    return ends
