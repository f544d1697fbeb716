"""What does a step show of a motion that it does not resolve?

A dish of film hangs on 12 ties in a ring that is inflated within 0.2 s.  Dish and ties vibrate with
periods below 5 ms, and nothing damps them.  A step that conserves energy keeps what it does not
resolve: with dt = 5 ms the tension of a tie at the ends of steps is a quarter above its mean and
then a quarter below it, and the taut part of the dish alternates, too.  This looks like physics,
and is the step.

The program runs the scene with several steps and prints, over the last 0.1 s, the mean of the taut
part and of the tension of a tie, and how far neighbouring records lie apart: as means over the
steps, which are recorded by default, and at their ends (`at="end"`).  The last run has a damping of
the dish and of the ties with a time constant near the step, which removes the oscillation itself.

Where the values come from:
    ring      chosen: coated fabric of 0.1 mm, 1 m across its centre line, 30 mbar
    dish      polyimide film of 25 µm
    ties      chosen: 5 kN/m, half a percent shorter than the distance of their ends

    ./gossamer demo step_size
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mpi4py import MPI
from scipy.spatial import Delaunay

import gossamer_fx as gx
from demos.common.deployment import print_figures
from demos.common.figures import BLUE, RED, finish, new_figure, save
from gossamer_fx.extend import Array
from gossamer_fx.meshes.arrays import Groups, Numbers, Points, mesh_of_arrays

RADIUS = 0.5  # of the centre line of the ring [m]
TUBE_RADIUS = 0.08  # m
DISH_RADIUS = 0.38  # m
TIES = 12
AROUND = 36  # cells around the ring, and on the rim of the dish
AROUND_TUBE = 8  # cells around the tube of the ring
FABRIC = gx.Miyazaki(4e8, 0.3, density=1000.0, thickness=1e-4, residual_stiffness=1e-3)
FILM = gx.Miyazaki(2.5e9, 0.34, density=1420.0, thickness=25e-6, residual_stiffness=1e-6)
STIFFNESS = 5e3  # of a tie [N/m]
SHORTENING = 0.995  # length of a tie over the distance of its ends
PRESSURE = 3e3  # Pa
INFLATED = 0.2  # time at which the ring has its pressure, and from which motions are compared [s]
DURATION = 0.3  # s
STEPS = (5e-3, 2.5e-3, 1e-3, 5e-4, 1e-4)  # s


def circle(radius: float, count: int, height: float = 0.0) -> Points:
    """Points (n, 3) [m] on a circle about the z axis, the first one on the x axis."""
    angle = 2 * math.pi * np.arange(count) / count
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(count, height)])


def ring_arrays() -> tuple[Points, Numbers, Groups]:
    """A torus with nodes at the ends of ties; its normals point outwards."""
    angles = 2 * math.pi * np.arange(AROUND_TUBE) / AROUND_TUBE
    circles = [
        circle(RADIUS - TUBE_RADIUS * math.cos(a), AROUND, TUBE_RADIUS * math.sin(a))
        for a in angles
    ]
    k, i = np.meshgrid(np.arange(AROUND_TUBE), np.arange(AROUND), indexing="ij")
    here = k * AROUND
    above = (k + 1) % AROUND_TUBE * AROUND
    following = (i + 1) % AROUND
    first = np.stack([here + i, above + i, above + following], axis=-1)
    second = np.stack([here + i, above + following, here + following], axis=-1)
    return np.concatenate(circles), np.concatenate([first, second]).reshape(-1, 3), {}


def dish_arrays() -> tuple[Points, Numbers, Groups]:
    """A disc with nodes on its rim at the ends of ties."""
    counts = (AROUND, 30, 24, 18, 12, 6)
    circles = [
        circle(DISH_RADIUS * (len(counts) - k) / len(counts), count)
        for k, count in enumerate(counts)
    ]
    points = np.concatenate([*circles, np.zeros((1, 3))])
    return points, Delaunay(points[:, :2]).simplices.astype(np.int64), {}


class Ring(NamedTuple):
    """The scene, its dish and one of the ties."""

    scene: gx.Scene
    dish: gx.Membrane
    tie: gx.connectors.Rope


def build(comm: MPI.Intracomm, damping_time: float = 0.0) -> Ring:
    """The ring with its dish; `damping_time` [s] is that of the stiffness damping of dish and
    ties."""
    ring = gx.Membrane(mesh_of_arrays(comm, ring_arrays), FABRIC, name="ring")
    dish = gx.Membrane(mesh_of_arrays(comm, dish_arrays), FILM, name="dish")
    rim = circle(DISH_RADIUS, TIES)
    inner = circle(RADIUS - TUBE_RADIUS, TIES)
    ties = [
        gx.connectors.Rope(
            dish.port_at(a),
            ring.port_at(b),
            stiffness=STIFFNESS,
            length=SHORTENING * float(np.linalg.norm(b - a)),
            damping=damping_time * STIFFNESS,
            name=f"tie {k}",
        )
        for k, (a, b) in enumerate(zip(rim, inner, strict=True), start=1)
    ]
    parts = [gx.Pressure(ring, lambda t: PRESSURE * min(t / INFLATED, 1.0))]
    if damping_time:
        parts.append(gx.Damping(dish, stiffness_factor=damping_time, name="damping of the dish"))
    return Ring(gx.Scene(ring, dish, *ties, *parts), dish, ties[0])


def move(
    comm: MPI.Intracomm, dt: float, damping_time: float = 0.0, until: float = DURATION
) -> gx.Series:
    """The taut part of the dish and the tension of a tie after each step, in both ways."""
    case = build(comm, damping_time)
    probes = {}
    for at in ("mean", "end"):
        probes[f"taut, {at}"] = gx.probes.AreaFraction(case.dish, "taut", at=at)
        probes[f"tension, {at}"] = gx.probes.Tension(case.tie, at=at)
    series = gx.Series(probes)
    gx.Simulation(case.scene, gx.Midpoint(dt=dt), outputs=[series]).run(until=until)
    return series


def window(series: gx.Series, name: str, since: float = INFLATED) -> Array:
    """The values from a time [s] on."""
    return series[name][series.time > since]


def swing(values: Array) -> float:
    """How far a record lies from the middle of its neighbours, on average: nothing of a straight
    line, and all of what changes from record to record and back."""
    return float(np.abs(np.diff(values, n=2)).mean() / 2)


def draw(runs: Mapping[str, gx.Series], path: Path) -> None:
    """The coarsest and the finest step over time: ends, and means over the step."""
    figure = new_figure(10.0, 5.6)
    panels = figure.subplots(2, 2, sharex=True, sharey="row")
    names = {"taut": "taut part of the dish [%]", "tension": "tension of a tie [N]"}
    for row, (quantity, label) in zip(panels, names.items(), strict=True):
        factor = 100 if quantity == "taut" else 1
        for axes, (title, series) in zip(row, runs.items(), strict=True):
            for at, colour, words in (
                ("end", RED, "at the ends of steps"),
                ("mean", BLUE, "means over the steps"),
            ):
                values = factor * window(series, f"{quantity}, {at}")
                t = 1e3 * series.time[series.time > INFLATED]
                axes.plot(t, values, color=colour, linewidth=1, label=words)
            axes.set_title(title)
            finish(axes, "t [ms]", label)
            axes.label_outer()
    save(figure, path)


def main(
    output: str | Path | None = None,
    steps: Sequence[float] = STEPS,
    damping_time: float = 5e-3,
    comm: MPI.Intracomm = MPI.COMM_SELF,
) -> dict[str, float]:
    """Means of the last 0.1 s and distances of neighbouring records, for each step.

    Args:
        output: folder of the picture; None: none is drawn.
        steps: [s], the coarsest first.
        damping_time: of the run with damping and the coarsest step [s].
        comm: ranks of the scene.
    """
    runs = {f"dt = {1e3 * dt:g} ms": move(comm, dt) for dt in steps}
    if output is not None and comm.rank == 0:
        first, *_, last = runs
        shown = {name: runs[name] for name in (first, last)}
        draw(shown, Path(output) / "step_size.png")
    damped = f"dt = {1e3 * steps[0]:g} ms, damping of {1e3 * damping_time:g} ms"
    runs[damped] = move(comm, steps[0], damping_time)
    results = {}
    for name, series in runs.items():
        for at in ("mean", "end"):
            taut = window(series, f"taut, {at}")
            tension = window(series, f"tension, {at}")
            results[f"{name}, {at}: taut"] = float(taut.mean())
            results[f"{name}, {at}: taut, swing"] = swing(taut)
            results[f"{name}, {at}: tension [N]"] = float(tension.mean())
            results[f"{name}, {at}: tension, swing [N]"] = swing(tension)
    return results


if __name__ == "__main__":
    found = main(output="out/step_size")
    if MPI.COMM_WORLD.rank == 0:
        print_figures(found)
