"""One picture of a flight: the orbit with its shadow, the scene with the directions of Sun and motion, and history."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.model.body import Array
from gossamer_fx.orbit.environment import local_axes
from gossamer_fx.orbit.orbit import Orbit
from gossamer_fx.outputs.output import Probe, evaluate_probe, make_parent
from gossamer_fx.plot.camera import BY_STATE, Camera, aim, render
from gossamer_fx.plot.view import Renderer
from gossamer_fx.probes.run import Run

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_DAY, _NIGHT, _EARTH, _SUN = (
    (0.93, 0.60, 0.10),
    (0.22, 0.29, 0.42),
    (0.55, 0.70, 0.85),
    (0.95, 0.70, 0.05),
)
_PIXELS = 900.0


@check_arguments
class FlightPicture:
    """PNG of a flight, made at the end of a run: its orbit, the scene as it is then, and probes over time.

    The orbit is seen from the normal of its plane at the start, bright in the light and dark in the shadow.  Each rank
    draws its own part of the scene.

    Args:
        path: `.png`.
        orbit: of the scene.
        probes: functions of the run by the words under which they are drawn, a curve each, e.g. "altitude [m]".
        title: a line on top.
    """

    times: Sequence[float] = ()

    def __init__(
        self, path: str | Path, orbit: Orbit, *, probes: Mapping[str, Probe], title: str = ""
    ) -> None:
        self.path, self.orbit, self.probes, self.title = Path(path), orbit, dict(probes), title
        check(
            self.path.suffix == ".png",
            f"FlightPicture cannot write '{path}'; give a name that ends in .png.",
        )
        for name, probe in self.probes.items():
            check(
                callable(probe),
                f"Probe '{name}' is {probe!r}; give a function of the run that returns a number.",
            )

    def open(self, run: Run) -> None:
        make_parent(run.comm, self.path)
        self._renderer = Renderer(run.system)
        self._rows: list[list[float]] = []
        self._places: list[Array] = []
        self._lit: list[float] = []

    def record(self, run: Run, last: bool) -> None:
        r, _ = self.orbit.flight(run.system).state()
        self._places.append(r)
        self._lit.append(self.orbit.sunlit(r, self.orbit.sun(run.time)))
        values = [
            evaluate_probe(run, f"Probe '{name}'", probe) for name, probe in self.probes.items()
        ]
        self._rows.append([run.time, *values])

    def close(self, run: Run) -> None:
        shape = self._renderer.shape()
        camera = aim(run.comm, [shape])
        images = render(run.comm, camera, [shape], _PIXELS / max(camera.size), BY_STATE)
        r, v = self.orbit.flight(run.system).state()
        if run.comm.rank == 0:
            self._draw(camera, images[0], self.orbit.sun(run.time) - r, v)

    def _draw(self, camera: Camera, image: Array, to_sun: Array, v: Array) -> None:
        from matplotlib.figure import Figure

        rows = np.array(self._rows)
        figure = Figure(figsize=(11, 4.6 + 1.5 * len(self.probes)), layout="constrained")
        grid = figure.add_gridspec(
            1 + len(self.probes), 2, height_ratios=[4.6] + [1.5] * len(self.probes)
        )
        self._draw_orbit(figure.add_subplot(grid[0, 0]))
        _draw_scene(
            figure.add_subplot(grid[0, 1]),
            camera,
            image,
            {"Sun": (to_sun, _SUN), "motion": (v, _NIGHT)},
        )
        hours = rows[-1, 0] > 3 * 3600
        for k, name in enumerate(self.probes):
            axes = figure.add_subplot(grid[1 + k, :])
            axes.plot(rows[:, 0] / (3600 if hours else 1), rows[:, 1 + k], color=_NIGHT, lw=1.2)
            axes.set_ylabel(name)
            axes.grid(alpha=0.3)
        if self.probes:
            axes.set_xlabel("time [h]" if hours else "time [s]")
        if self.title:
            figure.suptitle(self.title)
        figure.savefig(self.path, dpi=110)

    def _draw_orbit(self, axes: Axes) -> None:
        """Seen along the normal of the plane of the start, in thousands of kilometres."""
        from matplotlib.patches import Circle

        out, along, _ = local_axes(*self.orbit.state).T
        places, lit = np.array(self._places) / 1e6, np.array(self._lit)
        x, y = places @ out, places @ along
        axes.add_patch(Circle((0, 0), self.orbit.radius / 1e6, color=_EARTH))
        sun, reach = self.orbit.sun(0.0), float(np.linalg.norm(places, axis=1).max())
        if np.any(sun):
            to_sun = sun / np.linalg.norm(sun)
            style = {"arrowstyle": "-|>", "color": _SUN, "lw": 2}
            tip = (1.5 * reach * float(to_sun @ out), 1.5 * reach * float(to_sun @ along))
            axes.annotate("", xy=tip, xytext=(0, 0), arrowprops=style)
            axes.text(1.1 * tip[0], 1.1 * tip[1], "Sun", color=_SUN, ha="center", va="center")
        axes.set_xlim(-1.7 * reach, 1.7 * reach)
        axes.set_ylim(-1.7 * reach, 1.7 * reach)
        for light, colour in ((lit > 0.5, _DAY), (lit <= 0.5, _NIGHT)):
            axes.plot(np.where(light, x, np.nan), np.where(light, y, np.nan), color=colour, lw=2.2)
        axes.plot(x[:1], y[:1], "o", color=_NIGHT, ms=5)
        axes.plot(x[-1:], y[-1:], "s", color=_NIGHT, ms=5)
        axes.set_aspect("equal")
        axes.set_xlabel("10³ km")
        axes.set_title("orbit: light, shadow; start ●, end ■", fontsize=10)


def _draw_scene(
    axes: Axes, camera: Camera, image: Array, arrows: Mapping[str, tuple[Array, tuple]]
) -> None:
    """The scene, and directions as they are seen from the camera."""
    height, width = image.shape[:2]
    axes.imshow(image)
    reach, x, y = 0.42 * min(width, height), width / 2, height / 2
    for name, (direction, colour) in arrows.items():
        right, up, towards = (float(c) for c in camera.axes @ direction / np.linalg.norm(direction))
        way = (reach * right, -reach * up)
        style = {"arrowstyle": "-|>", "color": colour, "lw": 2}
        axes.annotate("", xy=(x + way[0], y + way[1]), xytext=(x, y), arrowprops=style)
        depth = "towards us" if towards > 0.7 else "away from us" if towards < -0.7 else ""
        words = f"{name} {depth}".strip()
        axes.text(
            x + 1.12 * way[0], y + 1.12 * way[1], words, color=colour, ha="center", va="center"
        )
    axes.set_axis_off()
    axes.set_title("the scene at the end, with directions to the Sun and of motion", fontsize=10)
