"""A boom of bars unfolds by springs in its hinges, which latch one by one.

A hub in free space carries bars that are folded to and fro, on hinges with parallel axes.  A
torsion spring drives each hinge, and a latch holds it once the bar is straight.  No bar sees
another, as nothing is in contact.

Momentum and angular momentum are zero and stay so.  When the last hinge has latched, the structure
is one rigid body, and stands still: the latches have taken all the energy of the springs.  What
each of them took is in the ledger by its name.

Chosen: bars of 1 m and 0.5 kg, a hub of 20 kg and 2 kg m², springs of 0.2 N m/rad.

    ./gossamer demo latched_boom
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import print_figures
from demos.common.figures import BLUE, GREY, RED, finish, new_figure, save

TITLE = "A boom unfolds and latches"
LENGTH = 1.0  # of a bar [m]
MASS = 0.5  # of a bar [kg]
STIFFNESS = 0.2  # of a spring [N m/rad]
Z = (0.0, 0.0, 1.0)
# Rest angle of a spring over the angle of its latch: springs take less than half a turn.
REST_RATIO = 0.9999
# Times of the shapes in the picture, over that at which the last hinge latches.
SHOWN = (0.0, 0.35, 0.6, 0.8, 1.0)


@dataclass(frozen=True)
class Boom:
    """The scene, its latches, the events that engage them, and the points along the boom."""

    scene: gx.Scene
    latches: list[gx.constraints.Latch]
    events: list[gx.When]
    points: list[gx.Port]


def build(comm: MPI.Comm, bars: int) -> Boom:
    """The folded boom of a number of bars, at rest."""
    hub = gx.RigidBody(20.0, (2.0, 2.0, 2.0), name="hub", comm=comm)
    inertia = MASS * LENGTH**2 / 12
    latches = []
    springs = []
    events = []
    points = [hub.port((0.0, 0.0, 0.0))]
    before = hub
    for k in range(bars):
        # Bars point to y and back in turn.  The first hinge opens by -90°, the others by 180° and
        # -180° in turn, so that the boom lies along x.
        side = 1.0 if k % 2 == 0 else -1.0
        root = (0.0, 0.0 if side > 0 else LENGTH, 0.0)
        tip = (0.0, LENGTH if side > 0 else 0.0, 0.0)
        bar = gx.RigidBody(
            MASS,
            (inertia, inertia / 100, inertia),
            position=(0.0, LENGTH / 2, 0.0),
            name=f"bar {k + 1}",
            comm=comm,
        )
        angle = -side * (math.pi if k else math.pi / 2)
        a = before.frame_at(root)
        b = bar.frame_at(root)
        hinge = gx.constraints.RevoluteJoint(a, b, axis=Z, name=f"hinge {k + 1}")
        latch = gx.constraints.Latch(hinge, angle=angle, name=f"latch {k + 1}")
        spring = gx.connectors.TorsionSpring(
            a,
            b,
            axis=Z,
            stiffness=STIFFNESS,
            rest_angle=REST_RATIO * angle,
            name=f"spring {k + 1}",
        )
        event = gx.When(
            latch.position, angle, falling=angle < 0, then=latch.engage, name=latch.name
        )
        latches.append(latch)
        springs.append(spring)
        events.append(event)
        points.append(bar.port_at(tip))
        before = bar
    return Boom(gx.Scene(*latches, *springs), latches, events, points)


def main(
    output: str | Path | None = None,
    bars: int = 5,
    dt: float = 0.01,
    until: float = 60.0,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> dict[str, float]:
    """Unfold the boom until its last hinge has latched; with `output`, a folder: a picture.

    Args:
        output: folder of the picture.
        bars: number of bars.
        dt: length of a step [s].
        until: time [s] at which the run ends in any case.
        comm: the communicator.
    """
    boom = build(comm, bars)

    def all_latched(run: gx.Simulation) -> bool:
        return all(latch.is_engaged(run) for latch in boom.latches)

    probes = {
        "kinetic [J]": lambda run: run.totals.kinetic,
        "stored [J]": lambda run: sum(run.totals.stored.values()),
        "latches [J]": lambda run: run.totals.dissipated,
    }
    for k, point in enumerate(boom.points):
        for axis in "xy":
            probes[f"{axis} {k} [m]"] = gx.probes.Position(point, axis)
    series = gx.Series(probes)
    run = gx.Simulation(boom.scene, gx.Midpoint(dt), outputs=[series], events=boom.events)
    first = sum(run.first.stored.values())
    latched = until
    while run.time < until and not all_latched(run):
        run.run(until=min(run.time + 50 * dt, until))
    latched = run.time
    if output is not None and comm.rank == 0:
        draw(series, bars, latched, Path(output) / "latched_boom.png")
    return {
        "latched": sum(latch.is_engaged(run) for latch in boom.latches),
        "time": latched,
        "energy of the springs": first,
        "taken by the latches": run.totals.dissipated / first,
        "kinetic energy left": run.totals.kinetic / first,
        "energy_error": run.energy_error,
        "momentum": float(np.abs(run.totals.momentum).max()),
        "angular_momentum": float(np.abs(run.totals.angular_momentum).max()),
    }


def draw(series: gx.Series, bars: int, end: float, path: Path) -> None:
    """Shapes of the boom, and the energies over the time."""
    figure = new_figure(9.0, 3.8)
    left, right = figure.subplots(1, 2)
    times = np.asarray(series.time)
    for share in SHOWN:
        k = int(np.abs(times - share * end).argmin())
        x = [series[f"x {i} [m]"][k] for i in range(bars + 1)]
        y = [series[f"y {i} [m]"][k] for i in range(bars + 1)]
        color = str(0.8 * (1 - share))
        left.plot(x, y, "o-", color=color, ms=3, label=f"{times[k]:.1f} s")
    left.set_aspect("equal")
    finish(left, "x [m]", "y [m]")
    for name, color in (("stored", BLUE), ("kinetic", GREY), ("latches", RED)):
        right.plot(times, series[f"{name} [J]"], color=color, label=name)
    finish(right, "t [s]", "energy [J]")
    save(figure, path, TITLE)


if __name__ == "__main__":
    print_figures(main(output="out/latched_boom"), {"time": "s", "energy of the springs": "J"})
