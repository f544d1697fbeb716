"""A case: a scene, a time stepper, an end time, and what is recorded.  A scene file builds one."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from gossamer_fx.core.checks.arguments import Range, check_arguments, positive
from gossamer_fx.records.outputs.output import Output, Probe
from gossamer_fx.records.outputs.recording import Recording
from gossamer_fx.records.run.simulation import Simulation
from gossamer_fx.solve.scene.scene import Scene
from gossamer_fx.solve.steppers.stepping import Stepper

if TYPE_CHECKING:
    from gossamer_fx.records.run.checkpoint import Checkpoints
    from gossamer_fx.records.run.events import Event
    from gossamer_fx.solve.steppers.step_control import StepControl


@check_arguments
@dataclass(frozen=True, eq=False)
class Case:
    """A case for `./gossamer run`: the return value of the function `build(comm)` of a scene file.

    A scene at rest is a `gx.analysis.StaticCase`.

    Args:
        scene: bodies, gas, constraints, loads, contacts.
        stepper: time stepping rule, e.g. `Midpoint(dt=1e-3)`.
        until: end time [s].
        title: a line for pictures and reports.
        fields: names of fields by the names of films, see `Recording`.
        probes: functions of the run by name, see `outputs.Probes`; "tip x [m]" and "tip y [m]" are
            drawn as the curves x and y of "tip [m]".
        frames: number of equal intervals of time, with a record of the fields for each, at the end
            of the step that contains its end, and one of the start: 25 frames are 26 records.
            Where steps are longer, there are fewer.
        control: see `Simulation`.
        events: see `Simulation`.
        halvings: see `Simulation`.
        outputs: others than the recording.

    Raises:
        InputError: the end time is not positive, or the number of frames is below one.

    Example:
        >>> def build(comm):
        ...     ball = gx.PointMass(2.0, position=(0.0, 0.0, 1.0), comm=comm, name="ball")
        ...     scene = gx.Scene(ball, gx.Gravity(ball, (0.0, 0.0, -9.81)))
        ...     return gx.Case(scene, gx.Midpoint(dt=0.01), until=0.4, title="A fall")
        >>> build(comm).until
        0.4
    """

    # In the order of their use in scene files: the first two are given without a name.
    scene: Scene
    stepper: Stepper
    _: KW_ONLY
    until: Annotated[float, positive("s")]
    title: str = ""
    # No fields: only the ledger and the probes are written.
    fields: Mapping[str, Sequence[str]] = field(default_factory=dict)
    probes: Mapping[str, Probe] = field(default_factory=dict)
    frames: Annotated[int, Range(1)] = 100
    control: StepControl | None = None
    events: Sequence[Event] = ()
    halvings: int | None = None
    outputs: Sequence[Output] = ()

    @check_arguments
    def recording(
        self,
        folder: str | Path,
        *,
        overwrite: bool = False,
        parameters: Mapping[str, Any] | None = None,
    ) -> Recording:
        """The output that writes the folder of the run: ledger, probes and fields at `frames`
        times.

        Args:
            folder: of the run.
            overwrite: whether another run in the folder is replaced; else it is refused.
            parameters: from which the scene was made, by name, see `Recording`.

        Raises, when a run is made with it:
            InputError: an unknown field or film, or a folder that holds another run.
        """
        frames = self.frames
        longest = self.stepper.dt
        if self.control is None:
            # Steps that are longer than that are the request, with a record for each.
            frames = min(frames, max(math.floor(self.until / longest + 1e-9), 1))
        return Recording(
            folder,
            self.fields,
            probes=self.probes,
            interval=self.until / frames,
            title=self.title,
            parameters=parameters,
            overwrite=overwrite,
        )

    @check_arguments
    def simulation(
        self,
        outputs: Sequence[Output] = (),
        checkpoints: Checkpoints | None = None,
        restart: str | Path | None = None,
        changes: Sequence[str] = (),
    ) -> Simulation:
        """The run of this case, ready to start.

        Args:
            outputs: what is called with the run at its steps, in addition to the outputs of the
                case.
            checkpoints: when and where states are saved for a restart; None: not at all.
            restart: folder of a checkpoint, or of several, of which the newest counts, from which
                the run goes on; None: it starts at zero.
            changes: names of the items whose parameters may differ from those of the checkpoint.

        Raises:
            InputError: what is wrong with the scene, the outputs, `halvings` or the checkpoint, as
                `Simulation` checks them: a scene, folder or checkpoint that does not fit the run,
                or a checkpoint that is absent or unreadable.

        Collective.
        """
        return Simulation(
            self.scene,
            self.stepper,
            outputs=[*outputs, *self.outputs],
            halvings=self.halvings,
            control=self.control,
            events=self.events,
            checkpoints=checkpoints,
            restart=restart,
            changes=changes,
        )


def all_arguments(build: Callable[..., Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """The arguments of a function that builds a case, after the communicator: those that are given,
    and the defaults of the others."""
    parameters = list(inspect.signature(build).parameters.values())[1:]
    defaults = {one.name: one.default for one in parameters if one.default is not one.empty}
    return {**defaults, **given}
