"""Pictures that are drawn at the end of a run: of a deployment with the curves of what happened.

A picture asked for during a run is drawn from a recording, as pictures of a run's folder are: the output records what
it needs in a hidden folder next to the picture, and removes that folder when the program ends.
"""

from __future__ import annotations

import shutil
import weakref
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import OutputFailure, check, on_rank_zero
from gossamer_fx.model.body import Vector
from gossamer_fx.outputs.adios import adios2_for
from gossamer_fx.outputs.output import make_parent
from gossamer_fx.outputs.recording import Recording
from gossamer_fx.outputs.schedule import Schedule
from gossamer_fx.plot.colours import by_state, colouring
from gossamer_fx.plot.curve_panels import run_curves
from gossamer_fx.plot.page import Views, write_page
from gossamer_fx.plot.plane_cut import PlaneCut, check_section
from gossamer_fx.plot.plot import field_views
from gossamer_fx.plot.run_reader import RunReader
from gossamer_fx.plot.viewpoint import View
from gossamer_fx.probes.run import Run

MAX_SHAPES = 24
NEVER = 10**9  # steps between records of the fields: only the first and the last state


class DrawnRun:
    """An output that records a run next to a picture and, whenever the run ends, draws the picture from the record.

    Args:
        path: `.png`.
    """

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
        """Of the record."""
        return self.path.with_name(f".{self.path.name}.run")

    @property
    def writes(self) -> Sequence[Path]:
        return [self.path, self.folder]

    def open(self, run: Run) -> None:
        make_parent(run.comm, self.path, file=True)

        def prepare() -> None:
            adios2_for(self.folder)  # refuses a Python that could not read the record
            shutil.rmtree(self.folder, ignore_errors=True)  # of a run that was killed
            weakref.finalize(self, shutil.rmtree, self.folder, ignore_errors=True)

        on_rank_zero(run.comm, prepare)
        self._recording = self.recording(run)
        self._recording.open(run)

    def record(self, run: Run, last: bool) -> None:
        assert self._recording is not None
        self._recording.record(run, last)

    def close(self, run: Run) -> None:
        recording = self._recording
        if recording is None or not recording.has_begun:
            return
        if run.time < run.until:
            # The run was stopped; the picture ends with its last state.  If that cannot be written, there is a failure
            # already, and the picture shows the states before.
            with suppress(OutputFailure):
                recording.record_fields(run)
        recording.close(run)
        on_rank_zero(run.comm, lambda: self.draw(RunReader(self.folder)))

    def recording(self, run: Run) -> Recording:
        """The recording that the picture needs."""
        raise NotImplementedError

    def draw(self, run: RunReader) -> None:
        """Write the picture."""
        raise NotImplementedError


@check_arguments
class Picture(DrawnRun):
    """PNG of a run, made at its end or failure: deformed films at given times, energies, gas, states, ledger errors.

    Args:
        path: `.png`.
        times: when the films are drawn [s]; by default at the start and the end.  If the run stops early, its last
            state is added.
        title: a line on top.
        view: from where the films are seen; default as `View` chooses it.
        section: a point [m] and a normal: instead of the films, the lines in which this plane cuts them are drawn, in
            the colours of the films and their groups, or of the layers of a film that has none.
        colour: "state" of the film (taut, wrinkled, slack), or "group": films, and the groups of their cells.

    Raises:
        InputError: too many times, a section without a normal, a folder that cannot be written.

    Example:
        `gx.plot.Picture("out/tube.png", times=[0.0, 0.1, 0.2], title="A tube is inflated")`
    """

    def __init__(
        self,
        path: str | Path,
        times: Sequence[float] = (),
        *,
        title: str = "",
        view: View | None = None,
        section: tuple[Vector, Vector] | None = None,
        colour: str = "state",
    ) -> None:
        super().__init__(path)
        self.title = title
        self.view = view or View()
        self.times = Schedule(times=tuple(times)).times
        check(
            len(self.times) <= MAX_SHAPES,
            f"Picture '{path}' of {len(self.times)} times; give at most {MAX_SHAPES}, and use VTX for more.",
        )
        check(
            colour in ("state", "group"),
            f'Picture \'{path}\': colour is {colour!r}; give "state" or "group".',
        )
        self.colour = colour
        if section is not None:
            check_section(f"Picture '{path}'", section)
        self.section = section

    def recording(self, run: Run) -> Recording:
        field = "state" if self.section is None else "group"
        if self.colour == "group":
            field = "group"
        films = [body.name for body in run.system.bodies if isinstance(body, Membrane)]
        return Recording(
            self.folder,
            fields=dict.fromkeys(films, ("displacement", field)),
            every=NEVER,
            times=self.times,
            title=self.title,
            states_every=1,
        )

    def draw(self, run: RunReader) -> None:
        write_page(self.path, self.title, self._views(run), run_curves(run, solver=False))

    def _views(self, run: RunReader) -> Views | None:
        frames = self._frames(run)
        if not frames:
            return None
        if self.section is not None and run.films:
            point, normal = self.section
            return PlaneCut(run, point, normal).views(frames)
        colours = colouring(run, self.colour) if run.films else by_state(False)
        return field_views(run, self.colour, colours, frames, self.view)

    def _frames(self, run: RunReader) -> list[int]:
        """Numbers of the recorded states that are drawn: those that were asked for, and the last of a stopped run."""
        last = len(run.times) - 1
        schedule = Schedule(times=tuple(self.times))
        chosen = {k for k, time in enumerate(run.times) if schedule.meets(float(time))}
        if not self.times:
            chosen = {k for k in (0, last) if k >= 0}
        stopped = run.about["statistics"]["time"] < run.about["statistics"]["until"]
        if not chosen or stopped:
            chosen |= {last} - {-1}
        return sorted(chosen)
