"""One picture of a run: the films at chosen times, coloured by their state, and the curves of what happened."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.fields.fields import STATES, AreaFractions
from gossamer_fx.model.body import Vector
from gossamer_fx.outputs.output import make_parent
from gossamer_fx.outputs.schedule import Schedule
from gossamer_fx.plot.camera import BY_STATE, STATE_COLOURS, aim, enlarged, render
from gossamer_fx.plot.curve_panels import Snapshot, observe, panels, scaled
from gossamer_fx.plot.groups import COLOURS, colour_table
from gossamer_fx.plot.page import DPI, arrange, write
from gossamer_fx.plot.section import Cut, Section, check_section, draw, window
from gossamer_fx.plot.view import Renderer, Shape
from gossamer_fx.plot.viewpoint import View
from gossamer_fx.probes.run import Run

MOST_SHAPES = 24


@check_arguments
class Picture:
    """PNG of a run, made at its end or failure: deformed films at given times, energies, gas, states, ledger errors.

    Each rank draws its own part of the films, and only images are put together.

    Args:
        path: `.png`.
        times: when the films are drawn [s]; if none are given, at the start and the end.  If the run stops early, its
            last state is added.
        title: a line on top.
        view: from where the films are seen; default as `View` chooses it.
        colour: "state" of the film (taut, wrinkled, slack), or "group": films, and the groups of their cells.
        section: a point [m] and a normal: instead of the films, the lines in which this plane cuts them are drawn, in
            the colours of the films and their groups, or of the layers of a film that has none.

    Raises:
        InputError: too many times, a section without a normal, a folder that cannot be written.
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
        self.path, self.title, self.view = Path(path), title, view or View()
        self.schedule = Schedule(times=tuple(times))
        check(
            self.path.suffix == ".png",
            f"Picture cannot write '{path}'; give a name that ends in .png.",
        )
        check(
            len(self.times) <= MOST_SHAPES,
            f"Picture '{path}' of {len(self.times)} times; give at most {MOST_SHAPES}, and use VTX for more.",
        )
        check(
            colour in ("state", "group"),
            f'Picture \'{path}\': colour is {colour!r}; give "state" or "group".',
        )
        self.colour = colour
        if section is not None:
            check_section(f"Picture '{path}'", section)
        self.section = section

    @property
    def times(self) -> Sequence[float]:
        return self.schedule.times

    @property
    def writes(self) -> Sequence[Path]:
        return [self.path]

    def open(self, run: Run) -> None:
        make_parent(run.comm, self.path, file=True)
        films = [body for body in run.system.bodies if isinstance(body, Membrane)]
        self._renderers = (
            [Renderer(run.system, self.colour == "group")] if run.system.bodies else []
        )
        self._fractions = [AreaFractions(films)] if films else []
        self._shapes: list[Shape] = []
        self._cuts: list[Cut] = []
        self._section = Section(run.system, *self.section) if self.section and films else None
        self._moments: list[Snapshot] = []

    def record(self, run: Run, last: bool) -> None:
        self._moments.append(observe(run, self._fractions))
        chosen = self.schedule.meets(run.time) if self.times else run.step == 0 or last
        if chosen or (last and not (self._shapes or self._cuts)):
            self._look()

    def _look(self) -> None:
        if self._section:
            self._cuts.append(self._section.cut())
            return
        self._shapes += [sight.shape() for sight in self._renderers]

    def _key(self) -> dict[str, Any]:
        """Names and colours of what is shown."""
        if self.colour == "group":
            names = [name for renderer in self._renderers for name in renderer.groups]
            return dict(zip(names, COLOURS, strict=False))
        states = ("taut", "wrinkled", "slack") if self._fractions else ()
        return {name: STATE_COLOURS[STATES[name]] for name in states}

    def close(self, run: Run) -> None:
        if not self._moments:
            return
        seen: Sequence[Shape | Cut] = self._cuts if self._section else self._shapes
        if run.time < run.until and all(shape.time < run.time for shape in seen):
            self._look()
        factor, prefix = scaled(max(m.time for m in self._moments))
        images, metre, grid = [], 1.0, arrange(1, 1.0)
        zooms: list[float] = []
        if self._shapes:
            camera = aim(run.comm, self._shapes, self.view)
            zooms = camera.zooms
            grid = arrange(len(self._shapes), camera.size[0] / camera.size[1])
            metre = grid.width / camera.size[0]
            table = (
                colour_table(len(self._renderers[0].groups)) if self.colour == "group" else BY_STATE
            )
            images = render(run.comm, camera, self._shapes, metre * DPI, table)
        if run.comm.rank == 0:
            key = self._key()
            captions = [
                f"t = {shape.time / factor:.4g} {prefix}s{enlarged(zoom)}"
                for shape, zoom in zip(seen, zooms or [1.0] * len(seen), strict=True)
            ]
            if self._section:
                key = self._section.key(self._cuts)
                size, middles = window(self._cuts)
                grid = arrange(len(self._cuts), size[0] / size[1])
                metre = grid.width / size[0]
                images = [
                    draw(cut, size, at, grid, DPI)
                    for cut, at in zip(self._cuts, middles, strict=True)
                ]
            write(
                self.path,
                self.title,
                list(zip(captions, images, strict=True)),
                grid,
                metre,
                key,
                panels(self._moments, factor),
                (self._moments[0].time / factor, self._moments[-1].time / factor, f"{prefix}s"),
            )
