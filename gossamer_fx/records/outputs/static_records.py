"""Records of equilibria and modes, in the same files as those of runs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from gossamer_fx.core.checks.arguments import RISING, Range, check_arguments, positive
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.mesh.quality import box
from gossamer_fx.core.model.body import Array, Body, MeshBody
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.terms.assembly import Shown
from gossamer_fx.records.fields.units import with_decimals
from gossamer_fx.records.outputs.output import Output, begin
from gossamer_fx.records.outputs.recording import Recording
from gossamer_fx.records.outputs.run_file import FileLocks
from gossamer_fx.solve.system.totals import Totals
from gossamer_fx.solve.view import (
    TIME,
    Account,
    Axis,
    Sought,
    StateView,
    chamber_state,
    chamber_states,
)

# Size of the motion in the record of a mode, over the largest side of the scene.
AMPLITUDE_RATIO = 0.05

# States in the record of a mode: enough for a smooth animation.
PERIOD_FRAMES = 24

# Fields of films in the record of a mode.
MODE_FIELDS = ("displacement", "mode_amplitude")


class ModeShape:
    """What a record reads of a mode; see `analysis.vibration.natural_modes.Mode` for shapes and
    units."""

    frequency: float
    growth: float
    shape: npt.NDArray
    displacements: Mapping[str, npt.NDArray]
    effective_mass: Array


class ModeView(StateView):
    """A mode at a phase of its period, as a view: q(t) = q0 + a Re(φ e^(iωt)), v its rate.

    The energies are those of small vibrations: their sum is constant, the kinetic one is ½ v·M v.
    A mode without a frequency is shown as if its period were 1 s.

    Args:
        number: of the mode, from one.
        amplitude: largest displacement of a node [m].
        frames: states of a period.
    """

    axis = TIME

    def __init__(
        self, equilibrium: Sought, mode: ModeShape, number: int, amplitude: float, frames: int
    ) -> None:
        """Scale the mode to the amplitude, and compute the energy [J] of its vibration.

        Side effect: the amplitude of the mode is appended to the compiled terms of the system, so
        that it is recorded as a field."""
        self.comm = equilibrium.comm
        self.scene = equilibrium.scene
        self.system = equilibrium.system
        self.step = 0
        self._first = equilibrium.totals
        self._frames = frames
        self._frequency = mode.frequency or 1.0
        # State of the equilibrium, to be restored at the end.
        self._q0 = self.system.unknowns.q0.array_r.copy()
        self._v0 = self.system.unknowns.v0.array_r.copy()
        self._time0 = self.system.unknowns.time
        scale = amplitude / _largest_displacement(self.comm, mode)
        self._shape = scale * mode.shape
        # Of the modal mass of 1 kg: ½ ω² |scale|².
        self._energy = (2 * math.pi * self._frequency * scale) ** 2 / 2
        self._phase = 0.0
        self._result = {
            "mode": number,
            "frequency [Hz]": mode.frequency,
            "growth [1/s]": mode.growth,
            "largest displacement shown [m]": amplitude,
        }
        for axis, mass in zip("xyz", mode.effective_mass, strict=True):
            self._result[f"effective mass {axis} [kg]"] = float(mass)
        self.system.equations.shown.append(_ModeAmplitude(self))

    def show(self, step: int) -> None:
        """Put the state of a step into the system; its phase is 2π step/frames."""
        self.step = step
        self._phase = 2 * math.pi * step / self._frames
        turned = self._shape * complex(math.cos(self._phase), math.sin(self._phase))
        ω = 2 * math.pi * self._frequency
        # Multipliers follow the coordinates; they are not drawn.
        self.system.unknowns.q0.array[:] = self._q0 + turned.real
        self.system.unknowns.v0.array[:] = -ω * turned.imag
        self.system.unknowns.time = step / self._frames / self._frequency

    def end(self) -> None:
        """Put the equilibrium back."""
        system = self.system
        system.equations.shown.pop()
        system.unknowns.q0.array[:] = self._q0
        system.unknowns.v0.array[:] = self._v0
        system.unknowns.time = self._time0

    def displaced(self, body: Body) -> Array:
        """Distances (n,) [m] of the nodes that this rank owns from the equilibrium."""
        owned = self.system.unknowns.block(body).owned
        moved = (self.system.unknowns.q0.array_r - self._q0)[owned]
        positions = moved.reshape(-1, body.block.size // 3, 3)[:, 0]
        return np.linalg.norm(positions, axis=1)

    @property
    def time(self) -> float:
        return self.system.unknowns.time

    @property
    def totals(self) -> Totals:
        """Energies of the vibration; momenta are zero, and nothing is supplied or dissipated."""
        zero = np.zeros(3)
        kinetic = self._energy * math.sin(self._phase) ** 2
        return replace(
            self._first,
            time=self.time,
            kinetic=kinetic,
            stored={"mode": self._energy - kinetic},
            supplied=0.0,
            losses={},
            momentum=zero,
            angular_momentum=zero,
        )

    @property
    def account(self) -> Account:
        return Account(
            kind="mode",
            method={"kind": "modes"},
            until=(self._frames - 1) / self._frames / self._frequency,
            caption=f"{360 * self.step / self._frames:.0f}° of the period",
            details={"result": self._result},
        )

    @property
    def chambers(self) -> Mapping[str, Any]:
        return chamber_states(self.system)

    def chamber(self, name: str) -> Any:
        return chamber_state(self.system, name)


class _ModeAmplitude(Shown):
    """The field "mode_amplitude" while a mode is recorded."""

    def __init__(self, view: ModeView) -> None:
        self._view = view

    def node_values(self, field: str, body: Body) -> tuple[npt.NDArray[np.int64], Array] | None:
        if field != "mode_amplitude":
            return None
        distances = self._view.displaced(body)
        first = body.block.index_map.local_range[0]
        return first + np.arange(len(distances), dtype=np.int64), distances


@check_arguments
def record(
    equilibrium: Sought,
    outputs: Sequence[Output],
    *,
    at: Annotated[Sequence[float], RISING] = (),
    along: str = "load parameter",
) -> None:
    """Write equilibria to outputs, in the files of runs: for pictures, reports and other programs.

    With values `at`, the equilibrium at each of them is found and written, so that the record is a
    path of loads, which are functions of this parameter as those of a run are of the time.
    Without, the present state is written, also that of a search that was stopped.

    Args:
        equilibrium: of which `find` was called, if no values are given.
        outputs: e.g. `Recording("sail")`, `outputs.VTU("sail.pvd", film)`, `outputs.Probes(...)`.
        at: values of the load parameter, each larger than the one before.
        along: name of the parameter with its unit, for tables, captions and curves, e.g. "pressure
            [Pa]".

    Raises:
        InputError: values that do not ascend; a file or folder that cannot be written, or holds
            another run.
        NoEquilibrium: of a value of `at`; the states before are written.

    Example:
        >>> edges = [gx.Fixed(film, edge) for edge in ("left", "right")]
        >>> equilibrium = gx.Equilibrium(gx.Scene(film, *edges))
        >>> result = equilibrium.find()
        >>> gx.outputs.record(equilibrium, [gx.Recording(folder / "held", title="Held film")])
        >>> gx.plot.RunReader(folder / "held").about["kind"]
        'equilibrium'
    """
    check(bool(along.strip()), "record: along is empty; give the name of the load parameter.")
    equilibrium.axis = Axis.of(along)
    with OpenedOutputs(equilibrium, outputs) as opened:
        if not len(at):
            opened.write()
        for value in at:
            equilibrium.find(at=float(value))
            opened.write()


@check_arguments
def record_modes(
    equilibrium: Sought,
    modes: Sequence[ModeShape],
    folder: str | Path,
    *,
    amplitude: Annotated[float, positive("m")] | None = None,
    frames: Annotated[int, Range(2)] = PERIOD_FRAMES,
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
    if amplitude is None:
        amplitude = AMPLITUDE_RATIO * _scene_size(equilibrium)
    fields = {}
    for body in equilibrium.system.unknowns.bodies:
        if isinstance(body, Membrane) and isinstance(body, MeshBody):
            fields[body.name] = MODE_FIELDS
    folders = []
    for number, mode in enumerate(modes, start=1):
        check(
            _largest_displacement(equilibrium.comm, mode) > 0,
            f"record_modes: nothing moves in mode {number}; give modes of this equilibrium.",
        )
        path = Path(folder) / f"mode_{number}"
        title = f"Mode {number}: {with_decimals(mode.frequency)} Hz"
        recording = Recording(path, fields, title=title, every=1, overwrite=overwrite)
        view = ModeView(equilibrium, mode, number, amplitude, frames)
        try:
            view.show(0)
            with OpenedOutputs(view, [recording]) as opened:
                for step in range(frames):
                    view.show(step)
                    opened.write()
        finally:
            view.end()
        folders.append(path)
    return folders


class OpenedOutputs(ExitStack):
    """Locks the files of outputs and opens them; at its end closes them and releases the files."""

    def __init__(self, view: StateView, outputs: Sequence[Output]) -> None:
        super().__init__()
        self._view = view
        self._outputs = outputs
        paths: list[Path] = []
        for output in outputs:
            paths += output.writes
        locks = FileLocks(view.comm, paths)
        try:
            for output in outputs:
                begin(view, output, [])
        except Exception:
            locks.release()
            raise
        # Callbacks are called in reverse order: files are closed before they are released.
        self.callback(locks.release)
        for output in outputs:
            self.callback(output.close, view)

    def write(self) -> None:
        """Let all outputs write the present state."""
        for output in self._outputs:
            output.record(self._view, True)


def _scene_size(view: StateView) -> float:
    """Largest side of the box around all bodies [m]; 1 m for a scene of one point.  Collective."""
    positions = [body.node_positions() for body in view.system.unknowns.state]
    low, high = box(view.comm, np.concatenate([np.zeros((0, 3)), *positions]))
    return float((high - low).max()) or 1.0


def _largest_displacement(comm: MPI.Intracomm, mode: ModeShape) -> float:
    """Largest distance of a node of any rank from the equilibrium, in the scale of the mode."""
    largest = 0.0
    for displacement in mode.displacements.values():
        distances = np.linalg.norm(displacement, axis=1)
        largest = max(largest, float(distances.max(initial=0.0)))
    return float(comm.allreduce(largest, op=MPI.MAX))
