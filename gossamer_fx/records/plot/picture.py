"""Pictures that are drawn at the end of a run: its shapes, and curves over time.

They are drawn from a recording, by the code that draws pictures of a run's folder.  The output
records what it needs in a hidden folder next to the picture, and removes that folder when the
program ends.
"""

from __future__ import annotations

import shutil
import weakref
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Literal

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import OutputFailure, check, on_rank_zero
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.records.outputs.output import Output, Schedule, Times, make_parent
from gossamer_fx.records.outputs.recording import Recording
from gossamer_fx.records.plot.camera import View
from gossamer_fx.records.plot.colours import by_state, colouring
from gossamer_fx.records.plot.curve_panels import run_curves
from gossamer_fx.records.plot.page import Views, write_page
from gossamer_fx.records.plot.plot import field_views
from gossamer_fx.records.plot.run_reader import RunReader
from gossamer_fx.solve.view import StateView

# Shapes in one picture: more would be too small.
MAX_SHAPES = 24

# So many steps between records of the fields that only the first and the last state are recorded.
NEVER = 10**9


class DrawnRun(Output):
    """Base of outputs that record a run and draw a picture from the record when the run ends."""

    times: Sequence[float] = ()

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._recording: Recording | None = None
        check(
            self.path.suffix == ".png",
            f"{type(self).__name__} cannot write '{path}'; give a name that ends in .png.",
        )

    @property
    def folder(self) -> Path:
        """Folder of the recording."""
        return self.path.with_name(f".{self.path.name}.run")

    @property
    def writes(self) -> Sequence[Path]:
        return [self.path, self.folder]

    def open(self, run: StateView) -> None:
        """Make the recording.  Collective."""
        make_parent(run.comm, self.path, file=True)

        def prepare() -> None:
            """Remove an old recording, and have the new one removed with this object."""
            # A run that was killed may have left its recording.
            shutil.rmtree(self.folder, ignore_errors=True)
            weakref.finalize(self, shutil.rmtree, self.folder, ignore_errors=True)

        on_rank_zero(run.comm, prepare)
        self._recording = self.recording(run)
        self._recording.open(run)

    def record(self, run: StateView, last: bool) -> None:
        assert self._recording is not None
        self._recording.record(run, last)

    def close(self, run: StateView) -> None:
        """Close the recording, and draw the picture on rank 0.  Collective.

        Nothing is drawn if no state was recorded.
        """
        recording = self._recording
        if recording is None or not recording.has_begun:
            return
        if run.time < run.account.until:
            # The run was stopped; the picture ends with its last state.  If that cannot be written,
            # there is a failure already, and the picture shows the states before.
            with suppress(OutputFailure):
                recording.record_fields(run)
        recording.close(run)
        on_rank_zero(run.comm, lambda: self.draw(RunReader(self.folder)))

    def recording(self, run: StateView) -> Recording:
        """The recording that the picture needs."""
        raise NotImplementedError

    def draw(self, run: RunReader) -> None:
        """Write the picture."""
        raise NotImplementedError


@check_arguments
class Picture(DrawnRun):
    """PNG of a run, drawn at its end or failure: deformed films, energies, gas, states, ledger
    errors.

    Args:
        path: of the file, ending in `.png`.
        times: at which the films are drawn [s]; default: the start and the end.  If the run stops
            early, its last state is added.
        title: a line on top.
        view: camera; default as `View` chooses it.
        colour: "state" of the film (taut, wrinkled, slack), or "group" (films, and groups of their
            cells).

    Raises:
        InputError: too many times, or another colour; when the run is made: a folder that cannot be
            written.

    Example:
        >>> picture = gx.plot.Picture(
        ...     folder / "tube.png", times=[0.0, 0.1], title="A tube is inflated"
        ... )
        >>> picture.writes[0].name
        'tube.png'
    """

    def __init__(
        self,
        path: str | Path,
        times: Times = (),
        *,
        title: str = "",
        view: View | None = None,
        colour: Literal["state", "group"] = "state",
    ) -> None:
        super().__init__(path)
        self.title = title
        self.view = view or View()
        self.times = tuple(times)
        check(
            len(self.times) <= MAX_SHAPES,
            f"Picture '{path}' of {len(self.times)} times; give at most {MAX_SHAPES}, and use VTU "
            "for more.",
        )
        self.colour = colour

    def recording(self, run: StateView) -> Recording:
        """The recording that the picture needs: displacements, and the field that gives the
        colours.

        Args:
            run: with the films of the scene.
        """
        films = [body.name for body in run.system.unknowns.bodies if isinstance(body, Membrane)]
        return Recording(
            self.folder,
            fields=dict.fromkeys(films, ("displacement", self.colour)),
            every=None if self.times else NEVER,
            times=self.times,
            title=self.title,
            states_every=1,
        )

    def draw(self, run: RunReader) -> None:
        """Write the picture from its recording."""
        curves = run_curves(run, solver=False)
        write_page(self.path, self.title, self._views(run), curves)

    def _views(self, run: RunReader) -> Views | None:
        """The shapes to draw; None for a run without recorded states."""
        records = self._records(run)
        if not records:
            return None
        # Without films the shapes of cables and masses are drawn in one colour.
        colours = by_state(False)
        if run.films:
            colours = colouring(run, self.colour)
        return field_views(run, colours, records, self.view)

    def _records(self, run: RunReader) -> list[int]:
        """Indices of the states to draw: those that were asked for, and the last one of a stopped
        run."""
        count = len(run.times)
        if count == 0:
            return []
        last = count - 1
        schedule = Schedule(times=tuple(self.times))
        chosen = {k for k, time in enumerate(run.times) if schedule.meets(float(time))}
        if not self.times:
            chosen = {0, last}
        axis = run.about["axis"]
        was_stopped = axis["at"] < axis["until"]
        # A run that stopped before the first time that was asked for has a picture, too.
        if not chosen or was_stopped:
            chosen.add(last)
        return sorted(chosen)
