"""How does friction act between layers of film?

`Contact(..., friction=μ)` gives every pair of parts that touch the friction of Coulomb: at most μ
times their normal force, against the sliding.  In a stack of n sheets, pressed by p on the area A
and held in turn at the left and at the right edge, each of the n - 1 gaps between them carries it:

    F = (n - 1) μ p A                           to pull the odd sheets out between the even ones
    F dx                                        is dissipated, `run.totals.losses["contact"]`

so a thin stack holds far more than a sheet on a table: friction adds up over the gaps.  The table
printed compares F with the mean force of contact while the sheets slide, for two to five sheets and
three pressures.  The sheets vibrate; the means agree with F within 2 %.  Energy closes to 1e-9,
with the heat of friction counted.

Coulomb's law needs care in three points.  Below `slip_velocity` the force falls to zero, so that
sheets at rest creep (1 mm/s by default: give less for long times).  Static and sliding friction are
the same.  An `Equilibrium` has no friction: pull slowly in a `Simulation` instead.

Where the values come from:
    μ = 0.4            chosen; ASTM D1894 is the test that gives it for a film
    sheets             chosen: 0.1 m × 0.1 m × 0.1 mm, 0.2 mm apart, pulled at 20 mm/s

    ./gossamer demo film_friction
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import print_figures, smooth, smooth_start
from demos.common.figures import BLUE, GREEN, RED, finish, new_figure, save
from gossamer_fx.extend import Array
from gossamer_fx.meshes.sheet import sheet

EDGE = 0.1  # of a sheet [m]
FRICTION = 0.4
FILM = gx.Miyazaki(E=1e9, nu=0.3, density=1400.0, thickness=1e-4, residual_stiffness=1e-6)
GAP = 2.2e-4  # between sheets at the start [m]
DISTANCE = 2e-4  # at which contact begins [m]
SPEED = 0.02  # m/s
PRESSED = 0.01  # time at which the full pressure acts, and at which the pull begins [s]
SLIDING = 0.018  # time from which all sheets slide [s]
DURATION = 0.04  # s
# Sheets and pressures [Pa] of the runs.
STACKS = ((2, 20.0), (3, 20.0), (5, 20.0), (3, 5.0), (3, 10.0))


def pull(t: float) -> float:
    """Displacement [m] of the pulled edges: they reach `SPEED` within 5 ms."""
    return SPEED * smooth_start(max(t - PRESSED, 0.0), ramp=5e-3)


def build(
    comm: MPI.Intracomm, sheets: int, pressure: float, until: float = DURATION
) -> tuple[gx.Contact, list[gx.Membrane], gx.Case]:
    """A stack on a smooth floor, pressed from above; every second sheet is pulled at its right
    edge."""

    def lifted(height: float) -> Any:
        return lambda X: np.stack([0 * X[0], 0 * X[1], 0 * X[2] + height])

    def moved(X: Array, t: float) -> Array:
        return np.stack([0 * X[0] + pull(t), 0 * X[1], 0 * X[2]])

    films = []
    supports = []
    for k in range(sheets):
        # Sheets have different meshes, so that nodes do not lie on nodes.
        film = gx.Membrane(
            sheet(comm, 3 + k % 2, 3 + k % 2, EDGE, EDGE),
            FILM,
            displacement=lifted((k + 1) * GAP),
            name=f"sheet {k}",
        )
        films.append(film)
        if k % 2:
            supports.append(gx.Fixed(film, "right", components=(0, 1), motion=moved))
        else:
            supports.append(gx.Fixed(film, "left", components=(0, 1)))
    floor = gx.contact.Plane(point=(0, 0, 0), normal=(0, 0, 1), friction=0.0, name="floor")
    contact = gx.Contact(
        *films,
        floor,
        distance=DISTANCE,
        stiffness=1e8,
        friction=FRICTION,
        slip_velocity=1e-4,
    )
    load = gx.Pressure(films[-1], lambda t: -pressure * smooth(t / PRESSED))
    # The sheets jerk when they begin to slide; this damps their vibrations, not their motion.
    damping = [
        gx.Damping(film, stiffness_factor=1e-3, name=f"damping of {film.name}") for film in films
    ]
    scene = gx.Scene(contact, load, *supports, *damping)
    case = gx.Case(scene, gx.Midpoint(dt=5e-4), until=until, title="Sheets pulled apart")
    return contact, films, case


def pulled_apart(comm: MPI.Intracomm, sheets: int, pressure: float) -> tuple[gx.Series, Any]:
    """The finished run of a stack, and the force [N] of contact on all pulled sheets in every
    step."""
    contact, films, case = build(comm, sheets, pressure)
    probes = [gx.probes.ContactForce(contact, film, axis="x") for film in films[1::2]]
    series = gx.Series({"force": lambda run: -sum(probe(run) for probe in probes)})
    run = case.simulation([series])
    run.run(until=case.until)
    return series, run


def draw(histories: dict[tuple[int, float], tuple[Array, Array]], means: Array, path: Path) -> None:
    """Force against time of some stacks, and mean force against the sum of normal forces in the
    gaps."""
    figure = new_figure()
    left, right = figure.subplots(1, 2)
    shown = [stack for stack in histories if stack[1] == max(p for _, p in histories)]
    for stack, colour in zip(shown, (BLUE, GREEN, RED), strict=False):
        time, force = histories[stack]
        # Means of neighbouring steps: a mode of the sheets changes sign with every step.
        smoothed = (force[1:] + force[:-1]) / 2
        left.plot(1e3 * time[1:], 1e3 * smoothed, color=colour, linewidth=1)
        label = f"{stack[0]} sheets: (n - 1) μ p A"
        left.axhline(1e3 * closed_form(*stack), color=colour, linestyle="--", label=label)
    left.set(ylim=(0, None))
    finish(left, "time [ms]", "force [mN]")
    normal = np.array([(n - 1) * p * EDGE**2 for n, p in histories])
    line = np.array([0.0, normal.max()])
    right.plot(line, 1e3 * FRICTION * line, color=BLUE, label=f"μ = {FRICTION}")
    right.plot(normal, 1e3 * means, "o", color=RED, label="stacks of 2, 3 and 5 sheets")
    finish(right, "sum of normal forces (n - 1) p A [N]", "mean force [mN]")
    save(figure, path)


def closed_form(sheets: int, pressure: float) -> float:
    """Force [N] that pulls a stack apart."""
    return (sheets - 1) * FRICTION * pressure * EDGE**2


def main(
    output: str | Path | None = None,
    stacks: tuple[tuple[int, float], ...] = STACKS,
    comm: MPI.Intracomm = MPI.COMM_SELF,
) -> dict[str, float]:
    """Mean force over its closed form for (sheets, pressure [Pa]); largest energy error; picture in
    `output`."""
    histories = {}
    means = []
    results = {}
    errors = []
    for sheets, pressure in stacks:
        series, run = pulled_apart(comm, sheets, pressure)
        time = np.array(series.time)
        force = np.array(series["force"])
        histories[sheets, pressure] = (time, force)
        means.append(force[time > SLIDING].mean())
        errors.append(abs(run.energy_error))
        name = f"{sheets} sheets, {pressure:g} Pa: force over (n - 1) μ p A"
        results[name] = float(means[-1] / closed_form(sheets, pressure))
    if output is not None and comm.rank == 0:
        draw(histories, np.array(means), Path(output) / "film_friction.png")
    return results | {"energy error": max(errors)}


if __name__ == "__main__":
    if MPI.COMM_WORLD.rank == 0:
        print_figures(main(output="out/film_friction"))
