"""Dampers between the hub and the open sail of IKAROS that leave the least swing, by gradients of
runs.

The hub is given a little more spin than the sail and swings in it (the demo `ikaros_swing`).
Dampers in the tethers hardly act, as a small turn changes their length only to second order.  Here
eight dampers lie obliquely between the rim of the hub and the inner edges of the sail, so that a
turn changes their length to first order.  Weak ones take long; strong ones hold the inner edges
fast, and the film swings with the hub. Wanted is the damping c that leaves the least energy of the
swing at a time T,

    J(c) = E(T; c) - L²/(2 (I + J))

with the angular momentum L, which is constant, and the moments of inertia I of the hub and J of the
sail: the energy above that of a steady spin.  Each run gives J, and one pass backwards through its
steps dJ/dc. `gx.analysis.minimise_runs` finds c; its logarithm is varied, which keeps c positive.

The gradient is of the film as it is, not of a reduced model, on the mesh of the demo `ikaros`.

    ./gossamer demo swing_damper
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import print_figures
from demos.common.figures import BLUE, GREY, RED, finish, new_figure, save
from demos.common.spinning import spins
from demos.sails import ikaros
from gossamer_fx.extend import Array

# Spin of the sail, and how much faster the hub is at first [rpm].
SPIN = 2.5
EXTRA = 0.03
# Angle at the axis between the ends of a damper [deg].
OBLIQUITY = 60.0
NAME = "log of damping"
# Viscosity of the film over its stiffness [s], as in the demo `ikaros_swing`.
VISCOSITY = 1e-4


@dataclass(frozen=True)
class Run:
    """What a run gives.

    Attributes:
        damping: c [N s/m].
        energy: left of the swing [J].
        slope: derivative of the energy by the logarithm of c [J].
        share: energy left over that at the start.
        times: of the steps (n,) [s].
        swing: spin of the hub less that of the sail at them (n,) [rad/s].
    """

    damping: float
    energy: float
    slope: float
    share: float
    times: Array
    swing: Array


def build(
    steady: gx.Equilibrium, comm: MPI.Intracomm, pitch: float, damping: float
) -> tuple[gx.Scene, gx.Membrane, gx.RigidBody, list[str]]:
    """The sail, its hub and the dampers, and the names of these."""
    items, film, hub = ikaros.swinging(comm, steady, pitch, SPIN, EXTRA, VISCOSITY)
    inner = ikaros.rows(pitch)[0] * pitch
    names = []
    # Two for each trapezoid, mirror images of each other, so that they do not pull it aside.
    for k in range(4):
        # The middle of an inner edge, and its direction from the axis.
        angle = math.pi / 2 * (k - 1)
        edge = film.port_at((inner * math.cos(angle), inner * math.sin(angle), 0.0))
        for side in (1, -1):
            end = angle + side * math.radians(OBLIQUITY)
            x = ikaros.HUB_RADIUS * math.cos(end)
            y = ikaros.HUB_RADIUS * math.sin(end)
            names.append(f"damper {len(names)}")
            rim = hub.port((x, y, 0.0))
            items.append(gx.connectors.Damper(edge, rim, damping=damping, name=names[-1]))
    return gx.Scene(*items), film, hub, names  # type: ignore[arg-type]


def swing(
    steady: gx.Equilibrium,
    comm: MPI.Intracomm,
    damping: float,
    until: float,
    dt: float,
    pitch: float,
) -> Run:
    """Let the hub swing, and take the gradient of the energy that is left."""
    scene, film, hub, names = build(steady, comm, pitch, damping)
    series = gx.Series(spins(hub, film))
    run = gx.Simulation(scene, gx.Midpoint(dt=dt), outputs=[series])
    tape = gx.analysis.RunTape(run)
    # The inertia of the sail as meshed and strained, from its share of the angular momentum.
    Ω = SPIN * ikaros.RPM
    faster = EXTRA * ikaros.RPM
    inertia = ikaros.HUB_INERTIA[2]
    L = float(run.first.angular_momentum[2])
    of_sail = (L - inertia * (Ω + faster)) / Ω
    at_start = faster**2 / (1 / inertia + 1 / of_sail) / 2
    energy = gx.analysis.Energy()
    floor = energy(run) - at_start
    run.run(until=until)
    by = [f"{name}.damping" for name in names]
    found = gx.analysis.gradient(tape, of=energy, by=by)
    # All dampers are alike, and dJ/d(ln c) = c dJ/dc.
    slope = damping * sum(float(found[name].values[0]) for name in by)
    left = found.value - floor
    times = np.asarray(series.time)
    return Run(damping, left, slope, left / at_start, times, series["hub"] - series["sail"])


def main(
    until: float = 25.0,
    dt: float = 0.5,
    pitch: float = 0.64,
    start: float = 0.3,
    iterations: int = 6,
    sweep: Sequence[float] = (0.3, 1.0, 3.0, 10.0, 100.0),
    output: str | Path | None = None,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
) -> dict[str, float]:
    """Find the damping; with `output`, a folder, a picture with a sweep for comparison.

    Args:
        until: time T at which the swing shall be over [s].
        dt: length of a step [s].
        pitch: between folds of the sail, the size of its cells [m].
        start: first damping [N s/m].
        iterations: of the minimisation at most.
        sweep: dampings that are computed for the picture [N s/m].
        output: folder of the picture.
        comm: the communicator.
    """
    began = time.process_time()
    steady, _, _ = ikaros.steady(comm, pitch, SPIN, held=False)
    runs: list[Run] = []

    def evaluate(values: dict[str, Array]) -> gx.analysis.Gradient:
        damping = math.exp(float(values[NAME][0]))
        runs.append(swing(steady, comm, damping, until, dt, pitch))
        slope = gx.analysis.Derivative(NAME, "J", np.array([runs[-1].slope]), None)
        return gx.analysis.Gradient(runs[-1].energy, "J", (slope,))

    found = gx.analysis.minimise_runs(
        evaluate,
        {NAME: math.log(start)},
        bounds={NAME: (math.log(1e-2), math.log(1e3))},
        iterations=iterations,
        tolerance=1e-5,
        comm=comm,
    )
    # The last run of a line search need not be the best one.
    best = min(runs, key=lambda one: one.energy)
    if output is not None:
        compared = [swing(steady, comm, c, until, dt, pitch) for c in sweep]
        if comm.rank == 0:
            draw(runs, compared, best, Path(output) / "swing_damper.png")
    return {
        "damping [N s/m]": best.damping,
        "energy left over that at the start": best.share,
        "the same with the first damping": runs[0].share,
        "slope at the start over the energy": runs[0].slope / runs[0].energy,
        "slope at the end over the energy": best.slope / best.energy,
        "runs": len(runs),
        "iterations": found.iterations,
        "seconds": time.process_time() - began,
    }


def draw(runs: Sequence[Run], compared: Sequence[Run], best: Run, path: Path) -> None:
    """Energy that is left over the damping, with the slopes of the gradient, and the swing over the
    time."""
    figure = new_figure(10.0, 3.9)
    left, right = figure.subplots(1, 2)
    dampings = [run.damping for run in compared]
    left.loglog(dampings, [run.share for run in compared], "o-", color=GREY, label="sweep")
    for k, run in enumerate(compared):
        # A short piece of the tangent, in logarithmic axes a power of the damping.
        x = run.damping * np.array([0.7, 1.4])
        y = run.share * (x / run.damping) ** (run.slope / run.energy)
        left.loglog(x, y, color=RED, lw=2, label="slope by gradient" if k == 0 else None)
    dampings = [run.damping for run in runs]
    left.loglog(dampings, [run.share for run in runs], "x", color=BLUE, label="runs of the search")
    finish(left, "damping c [N s/m]", "energy of the swing left, over the first")
    for run, name, colour in ((runs[0], "first", GREY), (best, "found", BLUE)):
        label = f"{name}, {run.damping:.2g} N s/m"
        right.plot(run.times, 1e3 * run.swing, color=colour, label=label)
    finish(right, "t [s]", "spin of the hub less that of the sail [mrad/s]")
    save(figure, path)


if __name__ == "__main__":
    print_figures(main(output="out/swing_damper"))
