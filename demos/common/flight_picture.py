"""One picture of a flight: the orbit with its shadow, the scene with the directions of Sun and
motion, and history."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import gossamer_fx as gx
from gossamer_fx.extend import Array, Probe, StateView, check, check_arguments
from gossamer_fx.mechanics.orbit.environment import local_axes
from gossamer_fx.records.fields.units import plain_text
from gossamer_fx.records.plot.camera import Camera, aim, render
from gossamer_fx.records.plot.colours import by_state
from gossamer_fx.records.plot.picture import NEVER, DrawnRun
from gossamer_fx.records.plot.run_tables import Tables

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_DAY = (0.93, 0.60, 0.10)
_NIGHT = (0.22, 0.29, 0.42)
_EARTH = (0.55, 0.70, 0.85)
_SUN = (0.95, 0.70, 0.05)
_DPI = 110
_SCENE_PIXELS = 900.0  # of the larger side of the image of the scene
_WIDTH = 11.0  # inches
_ORBIT_HEIGHT = 4.6  # inches
_PROBE_HEIGHT = 1.5  # inches
_LONG = 3 * 3600.0  # s from which on the time is shown in hours
# Lengths of the arrows to the Sun and of motion over the largest that fits: if they are parallel,
# both are seen.
_SUN_ARROW = 1.0
_MOTION_ARROW = 0.7
_ALONG_VIEW = (
    0.7  # part of a unit vector towards the eye from which on an arrow is too short to show it
)
# Columns of the record that a flight needs in addition to the probes that were asked for.
_POSITION = ("flight x", "flight y", "flight z")  # of the origin from the attracting centre [m]
_VELOCITY = ("flight vx", "flight vy", "flight vz")  # [m/s]
_TO_SUN = ("flight sun x", "flight sun y", "flight sun z")  # from the attracting centre [m]
_LIT = "flight lit"  # part of the Sun that is seen


@check_arguments
class FlightPicture(DrawnRun):
    """PNG of a flight, drawn at the end of a run: its orbit, the last shapes, and probes over time.

    The orbit is seen along the normal of its plane at the start, bright in sunlight and dark in the
    shadow.

    Args:
        path: of the file, ending in `.png`.
        orbit: the orbit of the scene.
        probes: functions of the run by the labels of their curves, e.g. "altitude [m]".
        title: a line on top.

    Raises:
        InputError: the path has another ending.

    Example:
        >>> curves = {"altitude [m]": gx.probes.OrbitState(orbit, "altitude")}
        >>> picture = FlightPicture(folder / "flight.png", orbit, probes=curves)
        >>> picture.writes[0].name
        'flight.png'
    """

    def __init__(
        self,
        path: str | Path,
        orbit: gx.orbit.Orbit,
        *,
        probes: Mapping[str, Probe],
        title: str = "",
    ) -> None:
        super().__init__(path)
        self.orbit = orbit
        self.probes = dict(probes)
        self.title = title
        for name, probe in self.probes.items():
            check(
                callable(probe),
                f"Probe '{name}' is {probe!r}; give a function of the run that returns a number.",
            )

    def recording(self, run: StateView) -> gx.Recording:
        """The recording of the run: position, velocity, sunlight and the probes."""

        def flight_number(what: int, axis: int) -> Probe:
            """A component of the position, of the velocity or of the position of the Sun."""

            def number(run: StateView) -> float:
                vectors = (
                    *self.orbit.flight(run.system.unknowns).state(),
                    self.orbit.sun(run.time),
                )
                return float(vectors[what][axis])

            return number

        probes: dict[str, Probe] = {}
        for what, names in enumerate((_POSITION, _VELOCITY, _TO_SUN)):
            for axis, name in enumerate(names):
                probes[name] = flight_number(what, axis)
        probes[_LIT] = self._lit
        return gx.Recording(self.folder, probes=probes | self.probes, every=NEVER)

    def _lit(self, run: StateView) -> float:
        position, _ = self.orbit.flight(run.system.unknowns).state()
        return float(self.orbit.sunlit(position, self.orbit.sun(run.time)))

    def draw(self, run: gx.plot.RunReader) -> None:
        """Draw orbit and shapes in the first row, and one row for each probe; write the PNG.

        Args:
            run: reads the recording of the run that has ended.

        Raises:
            OSError: the file cannot be written.
            InputError: the recording cannot be read.
        """
        from matplotlib.figure import Figure

        table = run.table("probes.csv")
        heights = [_ORBIT_HEIGHT] + [_PROBE_HEIGHT] * len(self.probes)
        figure = Figure(figsize=(_WIDTH, sum(heights)), layout="constrained")
        grid = figure.add_gridspec(len(heights), 2, height_ratios=heights)
        self._draw_orbit(figure.add_subplot(grid[0, 0]), table)
        _draw_scene(figure.add_subplot(grid[0, 1]), run, table)
        in_hours = table["time"][-1] > _LONG
        t = table["time"] / (3600.0 if in_hours else 1.0)
        for row, name in enumerate(self.probes, start=1):
            axes = figure.add_subplot(grid[row, :])
            axes.plot(t, table[name], color=_NIGHT, lw=1.2)
            # A long label would be longer than the side of a low panel.
            axes.set_title(plain_text(name), loc="left", fontsize=10)
            axes.grid(alpha=0.3)
            if row == len(self.probes):
                axes.set_xlabel("time [h]" if in_hours else "time [s]")
        if self.title:
            figure.suptitle(plain_text(self.title))
        figure.savefig(self.path, dpi=_DPI)

    def _draw_orbit(self, axes: Axes, table: Tables) -> None:
        """Draw the orbit, seen along the normal of its plane at the start, in thousands of
        kilometres.

        Args:
            table: recorded columns (n,): position of the origin and of the Sun from the attracting
                centre [m], and the part of the Sun that is seen.
        """
        from matplotlib.patches import Circle

        outward, along, _ = local_axes(*self.orbit.state).T
        positions = _vectors(table, _POSITION) / 1e6
        lit = table[_LIT] > 0.5
        x = positions @ outward
        y = positions @ along
        axes.add_patch(Circle((0, 0), self.orbit.radius / 1e6, color=_EARTH))
        reach = float(np.linalg.norm(positions, axis=1).max())
        sun = _vectors(table, _TO_SUN)[0]
        if np.any(sun):
            to_sun = 1.35 * reach * sun / np.linalg.norm(sun)
            _draw_arrow(axes, (0.0, 0.0), (to_sun @ outward, to_sun @ along), "Sun", _SUN)
        axes.set_xlim(-1.7 * reach, 1.7 * reach)
        axes.set_ylim(-1.7 * reach, 1.7 * reach)
        for part, colour in ((lit, _DAY), (~lit, _NIGHT)):
            axes.plot(np.where(part, x, np.nan), np.where(part, y, np.nan), color=colour, lw=2.2)
        axes.plot(x[:1], y[:1], "o", color=_NIGHT, ms=5)
        axes.plot(x[-1:], y[-1:], "s", color=_NIGHT, ms=5)
        axes.set_aspect("equal")
        axes.set_xlabel("10³ km")
        axes.set_title("orbit: light, shadow; start ●, end ■", fontsize=10)


def _vectors(table: Tables, names: Sequence[str]) -> Array:
    """Three columns of a table as vectors (n, 3)."""
    return np.stack([table[name] for name in names], axis=1)


def _draw_scene(axes: Axes, run: gx.plot.RunReader, table: Tables) -> None:
    """Draw the scene at the end, with arrows to the Sun and along the motion as the camera sees
    them.

    Args:
        table: recorded columns (n,): positions of the origin and of the Sun from the attracting
            centre [m], and the velocity of the origin [m/s].
    """
    colours = by_state(bool(run.films))
    shapes = [colours.shape(run, len(run.times) - 1)]
    camera = aim(shapes)
    scale = _SCENE_PIXELS / max(camera.size)
    image = next(render(camera, shapes, scale, colours))
    axes.imshow(image)
    to_sun = (_vectors(table, _TO_SUN) - _vectors(table, _POSITION))[-1]
    motion = _vectors(table, _VELOCITY)[-1]
    _draw_direction(axes, camera, image, "Sun", to_sun, _SUN, _SUN_ARROW)
    _draw_direction(axes, camera, image, "motion", motion, _NIGHT, _MOTION_ARROW)
    axes.set_axis_off()
    axes.set_title("the scene at the end, with directions to the Sun and of motion", fontsize=10)


def _draw_direction(
    axes: Axes,
    camera: Camera,
    image: Array,
    name: str,
    direction: Array,
    colour: Any,
    length: float,
) -> None:
    """Draw an arrow along a direction in space, from the middle of an image.

    Args:
        image: (height, width, 3).
        direction: (3,) in space, of any length and unit, not zero.
    """
    height, width = image.shape[:2]
    middle = (width / 2, height / 2)
    reach = 0.42 * length * min(width, height)
    right, up, towards = camera.axes @ direction / np.linalg.norm(direction)
    if towards > _ALONG_VIEW:
        name = f"{name} towards us"
    elif towards < -_ALONG_VIEW:
        name = f"{name} away from us"
    # rows of an image count downwards
    tip = (middle[0] + reach * right, middle[1] - reach * up)
    _draw_arrow(axes, middle, tip, name, colour)


def _draw_arrow(
    axes: Axes,
    start: tuple[float, float],
    tip: tuple[float, float],
    name: str,
    colour: Any,
) -> None:
    """Draw an arrow between two points of a picture, with a name beyond its tip."""
    style = {"arrowstyle": "-|>", "color": colour, "lw": 2}
    axes.annotate("", xy=tip, xytext=start, arrowprops=style)
    # Next to the tip: an arrow that points to the right has its name on the right.
    to_the_right = tip[0] >= start[0]
    axes.annotate(
        name,
        xy=tip,
        xytext=(8 if to_the_right else -8, 0),
        textcoords="offset points",
        color=colour,
        ha="left" if to_the_right else "right",
        va="center",
    )
