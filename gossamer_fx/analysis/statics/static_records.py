"""Records of equilibria and modes, in the same files as those of runs.

Outputs read a `Run`.  `StaticRun` shows an equilibrium as a run with a step for each state that is
recorded; `ModeRun` shows a mode as a run over one period.  Therefore `Recording`, `VTX` and all
other outputs write both, and `RunReader`, pictures and reports read them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from gossamer_fx.analysis.statics.equilibrium import Equilibrium
from gossamer_fx.analysis.vibration.natural_modes import Mode
from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array, Body, is_on_mesh
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.terms.assembly import Shown
from gossamer_fx.records.outputs.file_locks import FileLocks
from gossamer_fx.records.outputs.output import Output, Writing, begin
from gossamer_fx.records.outputs.recording import Recording
from gossamer_fx.solve.system.totals import Totals

# Size of the motion in the record of a mode, over the largest side of the scene.
AMPLITUDE_RATIO = 0.05

# States in the record of a mode: enough for a smooth animation.
PERIOD_FRAMES = 24

# Fields of films in the record of a mode.
MODE_FIELDS = ("displacement", "mode_amplitude")


class _Statics:
    """Stands for the time stepper, which an equilibrium does not have."""

    dt = 0.0


class StaticRun:
    """An equilibrium as a run, for outputs; see `probes.run.Run` for its members.

    Args:
        equilibrium: its scene and state are those of the run.

    Attributes:
        about: entries for run.json that only records of equilibria and modes have.
    """

    substeps = 0
    at_rest = True
    energy_error = 0.0
    energy_defect = 0.0
    mass_error = 0.0

    def __init__(self, equilibrium: Equilibrium) -> None:
        self.equilibrium = equilibrium
        self.comm = equilibrium.comm
        self.scene = equilibrium.scene
        self.system = equilibrium.system
        self.stepper: Any = _Statics()
        self.solver: Any = equilibrium
        self.stepping: Any = None
        self.history: Any = None
        self.first = equilibrium.totals
        self.step = 0
        self.iterations = 0
        self.last_iterations = 0
        self.until = equilibrium.time
        self.seconds = 0.0
        self.compile_seconds = equilibrium.compile_seconds
        self.output_seconds = 0.0
        self.captions: list[str] = []
        self.about: dict[str, Any] = {"kind": "equilibrium"}

    def note_result(self) -> None:
        """Take the counters and the result of the search that was made last.

        The number of steps grows by one, and a caption and the result are stored for run.json.  A
        search that was stopped has no result, and the caption says so.
        """
        self.step += 1
        self.until = self.time
        result = self.equilibrium.result
        caption = "not an equilibrium: the search was stopped"
        if result is not None:
            self.last_iterations = result.iterations
            self.iterations += result.iterations
            self.seconds += result.seconds
            caption = f"equilibrium, residual {result.residual:.1e}"
            if self.time or self.step > 1:
                caption = f"equilibrium of t = {self.time:.4g} s"
            self.about["result"] = {
                "residual": result.residual,
                "within tolerance": result.within_tolerance,
                "regular": result.regular,
                "free motions": ", ".join(result.free) or "none",
                "iterations": result.iterations,
                "pseudo-steps": result.steps,
            }
            self.about["prestress"] = {
                name: asdict(reached) for name, reached in result.prestress.items()
            }
        self.captions.append(caption)
        self.about["captions"] = self.captions

    @property
    def time(self) -> float:
        return self.equilibrium.time

    @property
    def totals(self) -> Totals:
        return self.equilibrium.totals

    @property
    def largest_energy(self) -> float:
        """Largest energy of the state [J]."""
        return self.totals.size

    @property
    def chambers(self) -> Mapping[str, Any]:
        return self.equilibrium.chambers

    def chamber(self, name: str) -> Any:
        return self.equilibrium.chamber(name)

    def log(self, words: str) -> None:
        """Lines for the log of a run; an equilibrium writes its own."""


class ModeRun(StaticRun):
    """A mode as a run over one period: q(t) = q0 + a Re(φ e^(iωt)), v its rate.

    The ledger has the energies of small vibrations, ½ |v|² by the mass and the rest of their sum.
    A mode without a frequency is shown as if its period were 1 s.

    Args:
        equilibrium: about which the mode vibrates.
        mode: of this equilibrium.
        number: of the mode, from 1.
        amplitude: largest displacement of a node [m].
        frames: states of the period.
    """

    def __init__(
        self, equilibrium: Equilibrium, mode: Mode, number: int, amplitude: float, frames: int
    ) -> None:
        """Scale the mode to the amplitude [m], and compute the energy [J] of its vibration.

        Side effect: the amplitude of the mode is appended to the compiled terms of the system, so
        that it is recorded as a field."""
        super().__init__(equilibrium)
        self._frames = frames
        self._frequency = mode.frequency or 1.0
        self.until = (frames - 1) / frames / self._frequency
        system = self.system
        # Coordinates [m], velocities [m/s] and time [s] of the equilibrium, to be restored at the
        # end.
        self._q0 = system.q0.array_r.copy()
        self._v0 = system.v0.array_r.copy()
        self._time0 = system.time
        self._shape = amplitude / _largest_displacement(self.comm, mode) * mode.shape
        # Of the modal mass of 1 kg: ½ ω² |scale|².
        scale = amplitude / _largest_displacement(self.comm, mode)
        self._energy = (2 * math.pi * self._frequency * scale) ** 2 / 2
        self._phase = 0.0
        degrees = [f"{360 * k / frames:.0f}° of the period" for k in range(frames)]
        self.about = {
            "kind": "mode",
            "captions": degrees,
            "result": {
                "mode": number,
                "frequency [Hz]": mode.frequency,
                "growth [1/s]": mode.growth,
                "largest displacement shown [m]": amplitude,
                **{
                    f"effective mass {axis} [kg]": float(mass)
                    for axis, mass in zip("xyz", mode.effective_mass, strict=True)
                },
            },
        }
        system.shown.append(_ModeAmplitude(self))

    def show(self, step: int) -> None:
        """Put the state of a step into the system: coordinates [m], velocities [m/s] and time [s].

        Args:
            step: number of the frame, 0 to `frames - 1`; its phase is 2π step/frames.
        """
        self.step = step
        self._phase = 2 * math.pi * step / self._frames
        turned = self._shape * complex(math.cos(self._phase), math.sin(self._phase))
        # Angular frequency [rad/s]; `turned` are the displacements [m] of this rank at the phase.
        ω = 2 * math.pi * self._frequency
        system = self.system
        # Multipliers follow the coordinates; they are not drawn.
        system.q0.array[:] = self._q0 + turned.real
        system.v0.array[:] = -ω * turned.imag
        system.time = step / self._frames / self._frequency

    def end(self) -> None:
        """Put the equilibrium back."""
        system = self.system
        system.shown.pop()
        system.q0.array[:] = self._q0
        system.v0.array[:] = self._v0
        system.time = self._time0

    def displaced(self, body: Body) -> Array:
        """Distances (n,) [m] of the nodes that this rank owns from the equilibrium."""
        owned = self.system.block(body).owned
        moved = (self.system.q0.array_r - self._q0)[owned]
        positions = moved.reshape(-1, body.block.size // 3, 3)[:, 0]
        distances: Array = np.linalg.norm(positions, axis=1)
        return distances

    @property
    def time(self) -> float:
        return self.system.time

    @property
    def totals(self) -> Totals:
        """Energies [J] of the vibration at the present phase: ½ v·Mv as kinetic, the remainder as
        stored.

        M is the mass matrix and v the velocity.  Momenta are zero, and nothing is supplied or
        dissipated.
        """
        zero = np.zeros(3)
        kinetic = self._energy * math.sin(self._phase) ** 2
        return replace(
            self.first,
            time=self.system.time,
            kinetic=kinetic,
            stored={"mode": self._energy - kinetic},
            supplied=0.0,
            losses={},
            momentum=zero,
            angular_momentum=zero,
        )


class _ModeAmplitude(Shown):
    """The field "mode_amplitude" while a mode is recorded."""

    def __init__(self, run: ModeRun) -> None:
        self._run = run

    def node_values(self, field: str, body: Body) -> tuple[npt.NDArray[np.int64], Array] | None:
        if field != "mode_amplitude":
            return None
        distances = self._run.displaced(body)
        index_map = body.block.index_map
        first = index_map.local_range[0]
        return first + np.arange(len(distances), dtype=np.int64), distances


@check_arguments
def record(
    equilibrium: Equilibrium,
    outputs: Sequence[Output],
    *,
    at: Sequence[float] = (),
) -> None:
    """Write equilibria to outputs, in the files of runs: for pictures, reports and other programs.

    With times `at`, the equilibrium under the loads of each time is found and written, so that the
    record is a path of loads.  Without, the present state is written, also that of a search that
    was stopped.

    Args:
        equilibrium: of which `find` was called, if no times are given.
        outputs: e.g. `Recording("sail")`, `outputs.VTX("sail.bp", film)`, `outputs.Probes(...)`.
        at: times of loads and prescribed positions [s], each later than the one before.

    Raises:
        InputError: times that do not ascend; a file or folder that cannot be written, or holds
            another run.
        NoEquilibrium: of a time `at`; the states before are written.

    Example:
        >>> edges = [gx.Fixed(film, edge) for edge in ("left", "right")]
        >>> equilibrium = gx.Equilibrium(gx.Scene(film, *edges))
        >>> result = equilibrium.find()
        >>> gx.outputs.record(equilibrium, [gx.Recording(folder / "held", title="Held film")])
        >>> gx.plot.RunReader(folder / "held").about["kind"]
        'equilibrium'
    """
    for before, after in pairwise(at):
        check(
            after > before,
            f"record: `at` goes from {before:g} s to {after:g} s; give ascending times, and loads "
            "that fall in them.",
        )
    run = StaticRun(equilibrium)
    locks = _open(run, outputs)
    try:
        if not len(at):
            run.note_result()
            _record_all(run, outputs)
        for time in at:
            equilibrium.find(at=float(time))
            run.note_result()
            _record_all(run, outputs)
    finally:
        _close(run, outputs, locks)


@check_arguments
def record_modes(
    equilibrium: Equilibrium,
    modes: Sequence[Mode],
    folder: str | Path,
    *,
    amplitude: float | None = None,
    frames: int = PERIOD_FRAMES,
    overwrite: bool = False,
) -> list[Path]:
    """Write each mode as a recording over one period, for animations and pictures.

    The folders `mode_1`, `mode_2`, ... have the field "mode_amplitude", the distance from the
    equilibrium, besides the displacement from the mesh.  `gx.plot.modes` shows all of them side by
    side.

    Args:
        equilibrium: about which the modes vibrate.
        modes: from `analysis.modes` of this equilibrium.
        folder: in which a folder is made for each mode.
        amplitude: largest displacement of a node [m]; default: 0.05 of the largest side of the
            scene.
        frames: states of a period, at least two.
        overwrite: whether records that are in the folders already are replaced.

    Returns:
        The folders of the modes.

    Raises:
        InputError: an amplitude or a number of frames that is too small, a mode that nothing moves
            in, or a folder that cannot be written or holds another run.

    Example:
        >>> edges = [gx.Fixed(film, edge) for edge in ("left", "right", "bottom", "top")]
        >>> equilibrium = gx.Equilibrium(gx.Scene(film, *edges))
        >>> result = equilibrium.find()
        >>> modes = gx.analysis.modes(equilibrium, 1)
        >>> folders = gx.outputs.record_modes(equilibrium, modes, folder / "modes", frames=4)
        >>> gx.plot.RunReader(folders[0]).about["kind"]
        'mode'
    """
    equilibrium.need("record_modes")
    check(frames >= 2, f"record_modes: frames is {frames!r}; give two or more.")
    if amplitude is None:
        amplitude = AMPLITUDE_RATIO * _scene_size(equilibrium)
    check(amplitude > 0, f"record_modes: amplitude is {amplitude!r} m; give a positive number.")
    folders = []
    for number, mode in enumerate(modes, start=1):
        check(
            _largest_displacement(equilibrium.comm, mode) > 0,
            f"record_modes: nothing moves in mode {number}; give modes of this equilibrium.",
        )
        path = Path(folder) / f"mode_{number}"
        title = f"Mode {number}: {mode.frequency:.4g} Hz"
        recording = _mode_recording(equilibrium, path, title, overwrite)
        run = ModeRun(equilibrium, mode, number, amplitude, frames)
        try:
            run.show(0)
            locks = _open(run, [recording])
            try:
                for step in range(frames):
                    run.show(step)
                    _record_all(run, [recording])
            finally:
                _close(run, [recording], locks)
        finally:
            run.end()
        folders.append(path)
    return folders


def _mode_recording(equilibrium: Equilibrium, path: Path, title: str, overwrite: bool) -> Recording:
    """The recording of a mode, with the fields of modes for films."""
    fields = {}
    for body in equilibrium.system.bodies:
        if isinstance(body, Membrane) and is_on_mesh(body):
            fields[body.name] = MODE_FIELDS
    return Recording(path, fields, title=title, every=1, overwrite=overwrite)


def _open(run: StaticRun, outputs: Sequence[Output]) -> FileLocks:
    """Lock the files of the outputs, and open them.  Collective.

    Returns:
        the locks, to be released after the outputs are closed.

    Raises:
        InputError: a file cannot be written, holds another run, or is locked by one.  The locks are
            released then.
    """
    paths: list[Path] = []
    for output in outputs:
        if isinstance(output, Writing):
            paths += output.writes
    locks = FileLocks(run.comm, paths)
    try:
        for output in outputs:
            begin(run, output, [])
    except Exception:
        locks.release()
        raise
    return locks


def _record_all(run: StaticRun, outputs: Sequence[Output]) -> None:
    """Let all outputs write the present state."""
    for output in outputs:
        output.record(run, True)


def _close(run: StaticRun, outputs: Sequence[Output], locks: FileLocks) -> None:
    """Close all outputs, and release their files."""
    try:
        for output in outputs:
            output.close(run)
    finally:
        locks.release()


def _scene_size(equilibrium: Equilibrium) -> float:
    """Largest side of the box around all bodies [m]; 1 m for a scene of one point.  Collective."""
    low: Array = np.full(3, np.inf)
    high: Array = np.full(3, -np.inf)
    for body in equilibrium.system.bodies:
        positions = equilibrium.system.state[body].positions()
        low = np.minimum(low, positions.min(axis=0, initial=np.inf))
        high = np.maximum(high, positions.max(axis=0, initial=-np.inf))
    comm = equilibrium.comm
    comm.Allreduce(MPI.IN_PLACE, low, op=MPI.MIN)
    comm.Allreduce(MPI.IN_PLACE, high, op=MPI.MAX)
    sides = high - low
    # A scene of one point has no size: a metre then.
    return float(sides.max()) or 1.0


def _largest_displacement(comm: MPI.Intracomm, mode: Mode) -> float:
    """Largest distance of a node from the equilibrium in a mode as it is scaled, on all ranks."""
    largest = 0.0
    for displacement in mode.displacements.values():
        distances = np.linalg.norm(displacement, axis=1)
        largest = max(largest, float(distances.max(initial=0.0)))
    return float(comm.allreduce(largest, op=MPI.MAX))
