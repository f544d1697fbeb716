"""A static case: an equilibrium, a path or modes, and what is recorded of them."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path
from typing import Annotated, Any

from gossamer_fx.analysis.cases.recorded_numbers import recorded_numbers
from gossamer_fx.analysis.statics.equilibrium import Equilibrium
from gossamer_fx.core.checks.arguments import Range, check_arguments
from gossamer_fx.core.checks.errors import on_rank_zero
from gossamer_fx.core.checks.relations import at_most_one
from gossamer_fx.records.outputs.output import Output, Probe
from gossamer_fx.records.outputs.recording import Recording
from gossamer_fx.records.outputs.static_records import record, record_modes
from gossamer_fx.solve.scene.scene import Scene


@check_arguments(at_most_one("at", "path"))
@dataclass(frozen=True, eq=False)
class StaticCase:
    """A case at rest for `./gossamer run`: what `build(comm)` of a scene file returns, as `Case` is
    for a run.

    It finds one equilibrium, those at the values `at` of a load parameter, or those of a path past
    limit points; then the modes about the last one.

    Args:
        equilibrium: of the scene.
        at: values of the load parameter, ascending, see `outputs.record`; default: one equilibrium
            at 0.
        along: name of the load parameter with its unit, e.g. "pressure [Pa]".
        path: arguments of `analysis.path` by name, e.g. `{"until": 2.0, "by": "pull.force"}`; not
            together with `at`.
        modes: number of the modes to find and record, in `modes/mode_1` and so on.
        title: a line for pictures and reports.
        fields: names of fields by the names of films, see `Recording`.
        probes: functions of the equilibrium by name, see `outputs.Probes`.
        outputs: others than the recording.

    Raises:
        InputError: `at` and a path are given, or the number of modes is negative.

    Example:
        >>> def build(comm):
        ...     ball = gx.PointMass(2.0, comm=comm, name="ball")
        ...     hook = gx.Ground((0.0, 0.0, 1.0))
        ...     spring = gx.connectors.Spring(ball.port(), hook, stiffness=100.0, length=1.0)
        ...     scene = gx.Scene(ball, spring, gx.Gravity(ball, (0.0, 0.0, -9.81)))
        ...     probes = {"hook z [N]": gx.probes.Reaction(spring, "z")}
        ...     return gx.analysis.StaticCase(gx.Equilibrium(scene), probes=probes)
        >>> round(build(comm).compute(folder / "hung")["hook z [N] at the end"], 4)
        19.62
    """

    equilibrium: Equilibrium
    _: KW_ONLY
    at: Sequence[float] = ()
    along: str = "load parameter"
    path: Mapping[str, Any] = field(default_factory=dict)
    modes: Annotated[int, Range(0)] = 0
    title: str = ""
    fields: Mapping[str, Sequence[str]] = field(default_factory=dict)
    probes: Mapping[str, Probe] = field(default_factory=dict)
    outputs: Sequence[Output] = ()

    @property
    def scene(self) -> Scene:
        """The scene of the equilibrium."""
        return self.equilibrium.scene

    @check_arguments
    def compute(
        self,
        folder: str | Path,
        outputs: Sequence[Output] = (),
        *,
        overwrite: bool = False,
        parameters: Mapping[str, Any] | None = None,
    ) -> dict[str, float]:
        """Find what the case asks for, and write it to a folder in the files of a run.  Collective.

        Args:
            folder: for the recording.
            outputs: what is called with each equilibrium, in addition to those of the case.
            overwrite: whether another record in the folder is replaced; else it is refused.
            parameters: from which the scene was made, by name, see `Recording`.

        Returns:
            Numbers by name: of each probe the value at the end, the smallest and the largest one,
                of each chamber the last pressure, and "frequency 1 [Hz]" and so on of the modes.

        Raises:
            InputError: what is wrong with the scene, the loads or the outputs, or a folder that
                holds another run.
            NoEquilibrium: the equilibria before are written.
        """
        equilibrium = self.equilibrium
        recording = Recording(
            folder,
            self.fields,
            probes=self.probes,
            every=1,
            title=self.title,
            parameters=parameters,
            overwrite=overwrite,
        )
        modes_folder = Path(folder) / "modes"
        if overwrite:
            # Those of a record with more modes would stay.
            on_rank_zero(equilibrium.comm, lambda: shutil.rmtree(modes_folder, ignore_errors=True))
        writers = [recording, *outputs, *self.outputs]
        if self.path:
            from gossamer_fx.analysis.statics.path import path

            path(equilibrium, **{"outputs": writers, **self.path})
        else:
            record(equilibrium, writers, at=self.at or (0.0,), along=self.along)
        numbers = recorded_numbers(equilibrium.comm, Path(folder))
        if self.modes:
            from gossamer_fx.analysis.vibration.natural_modes import modes

            found = modes(equilibrium, self.modes)
            record_modes(equilibrium, found, modes_folder)
            frequencies = {
                f"frequency {number} [Hz]": mode.frequency
                for number, mode in enumerate(found, start=1)
            }
            numbers |= frequencies
        return numbers
