"""A boom of bars unfolds by springs in its hinges, which latch one by one.

A hub in free space carries bars that are folded to and fro, on hinges with parallel axes.  A
torsion spring or a tape spring drives each hinge, and a latch holds it once the bar is straight.
Bars are not in contact; with tape springs, which hold them apart more weakly, end stops keep them
from folding back through each other.

Momentum and angular momentum are zero and stay so.  When the last hinge has latched, the structure
is one rigid body, and stands still: the latches have taken all the energy of the springs.  What
each of them took is in the ledger by its name.

A tape spring has the moment of the study `tape_spring`: a peak where it snaps at 13°, and the
constant moment (1+ν) D α of a fold from 26° on.  So it pushes evenly all the way and most at its
end, where a torsion spring is at rest.

Chosen: bars of 1 m and 0.5 kg, a hub of 20 kg and 2 kg m², springs of 0.2 N m/rad; the section of
the study; stops of 20 N m/rad.

    ./gossamer demo latched_boom
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import print_figures
from demos.common.figures import BLUE, GREY, RED, finish, new_figure, save
from demos.studies.tape_spring import FLAT, PLATEAU, peak_of_section

TITLE = "A boom unfolds and latches"
LENGTH = 1.0  # of a bar [m]
MASS = 0.5  # of a bar [kg]
STIFFNESS = 0.2  # of a spring [N m/rad]
STOP = 20.0  # stiffness of an end stop [N m/rad]
Z = (0.0, 0.0, 1.0)
# Rest angle of a spring over the angle of its latch: springs take less than half a turn.
REST_RATIO = 0.9999
# Angles [rad] between which a tape spring snaps, and moments [N m] there.
SNAP = (FLAT, 2 * FLAT)
# Times of the shapes in the picture, over that at which the last hinge latches.
SHOWN = (0.0, 0.35, 0.6, 0.8, 1.0)


Hinges = Literal["springs", "tape springs"]


@dataclass(frozen=True)
class Boom:
    """The scene, its latches, the events that engage them, and the points along the boom."""

    scene: gx.Scene
    latches: list[gx.constraints.Latch]
    events: list[gx.When]
    points: list[gx.Port]


def tape_spring(peak: float, folded: float) -> dict[str, list[float]]:
    """Angles [rad] and moments [N m] of a tape spring that is folded by an angle and straight at
    zero, where it snaps to both sides."""
    table = {0.0: 0.0}
    for side in (-1, 1):
        table[side * SNAP[0]] = side * peak
        table[side * SNAP[1]] = side * PLATEAU
    # Beyond the fold: an end stop gives way.
    table[1.2 * folded] = math.copysign(PLATEAU, folded)
    angles = sorted(table)
    return {"angle": angles, "moment": [table[angle] for angle in angles]}


def build(comm: MPI.Comm, bars: int, hinges: Hinges = "springs") -> Boom:
    """The folded boom of a number of bars, at rest."""
    peak = peak_of_section()
    hub = gx.RigidBody(20.0, (2.0, 2.0, 2.0), name="hub", comm=comm)
    inertia = MASS * LENGTH**2 / 12
    latches = []
    springs: list[object] = []
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
        name = f"spring {k + 1}"
        if hinges == "springs":
            spring = gx.connectors.TorsionSpring(
                a, b, axis=Z, stiffness=STIFFNESS, rest_angle=REST_RATIO * angle, name=name
            )
            springs.append(spring)
        else:
            table = tape_spring(peak, folded=-angle)
            tape = gx.connectors.TabulatedTorsion(
                a, b, axis=Z, **table, rest_angle=angle, name=name
            )
            springs.append(tape)
            limits = (min(angle, 0.0), max(angle, 0.0))
            stop = gx.connectors.TorsionStop(
                a, b, axis=Z, stiffness=STOP, limits=limits, name=f"stop {k + 1}"
            )
            springs.append(stop)
        event = gx.When(
            latch.position, angle, falling=angle < 0, then=latch.engage, name=latch.name
        )
        latches.append(latch)
        events.append(event)
        points.append(bar.port_at(tip))
        before = bar
    return Boom(gx.Scene(*latches, *springs), latches, events, points)


def main(
    output: str | Path | None = None,
    bars: int = 5,
    hinges: Hinges = "springs",
    dt: float = 0.01,
    until: float = 60.0,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> dict[str, float]:
    """Unfold the boom until its last hinge has latched; with `output`, a folder: a picture.

    Args:
        output: folder of the picture.
        bars: number of bars.
        hinges: what drives them.
        dt: length of a step [s].
        until: time [s] at which the run ends in any case.
        comm: the communicator.
    """
    boom = build(comm, bars, hinges)

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
    while run.time < until and not all_latched(run):
        run.run(until=min(run.time + 50 * dt, until))
    latched = run.time
    if output is not None and comm.rank == 0:
        draw(series, bars, hinges, latched, Path(output) / "latched_boom.png")
    return {
        "latched": sum(latch.is_engaged(run) for latch in boom.latches),
        "time": latched,
        "energy of the springs": first,
        "taken by the latches": run.totals.dissipated / first,
        "largest share of a latch": max(run.totals.losses.values()) / first,
        "kinetic energy left": run.totals.kinetic / first,
        "energy_error": run.energy_error,
        "momentum": float(np.abs(run.totals.momentum).max()),
        "angular_momentum": float(np.abs(run.totals.angular_momentum).max()),
    }


def draw(series: gx.Series, bars: int, hinges: Hinges, end: float, path: Path) -> None:
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
    above = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0), "columnspacing": 1.0}
    finish(left, "x [m]", "y [m]", ncols=len(SHOWN), **above)
    for name, color in (("stored", BLUE), ("kinetic", GREY), ("latches", RED)):
        right.plot(times, series[f"{name} [J]"], color=color, label=name)
    finish(right, "t [s]", "energy [J]")
    save(figure, path, f"{TITLE}: {hinges}")


if __name__ == "__main__":
    units = {"time": "s", "energy of the springs": "J"}
    print_figures(main(output="out/latched_boom"), units)
    print_figures(main(output="out/latched_boom_tapes", hinges="tape springs"), units)
