"""How does friction act between layers of film?

`Contact(..., friction=μ)` gives every pair of parts that touch the friction of Coulomb: at most μ times
their normal force, against the sliding.  In a stack of n sheets, pressed by p on the area A and held in
turn at the left and at the right edge, each of the n - 1 gaps between them carries it:

    F = (n - 1) μ p A                           to pull the odd sheets out between the even ones
    F dx                                        is dissipated, `run.totals.losses["contact"]`

so a thin stack holds far more than a sheet on a table: friction adds up, as between the pages of two
books.  The table printed compares F with the mean force of contact while the sheets slide, for two
to five sheets and three pressures.  Energy closes to round-off, with the heat of friction counted.

Coulomb's law needs care in three points.  Below `slip_velocity` the force falls to zero, so that
sheets at rest creep (1 mm/s by default: give less for long times).  Static and sliding friction are
the same.  An `Equilibrium` has no friction: pull slowly in a `Simulation` instead.

Where the values come from:
    μ = 0.4            chosen; polyimide on itself: 0.48 (DuPont, Kapton HN data sheet H-38492: kinetic)
    sheets             chosen: 0.1 m × 0.1 m × 0.1 mm, 0.2 mm apart, pulled at 20 mm/s

    ./gossamer demo film_friction
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.figures import BLUE, GREEN, RED, new_figure, save
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.model.body import Array

EDGE = 0.1  # of a sheet [m]
FRICTION = 0.4
FILM = gx.Miyazaki(E=1e9, nu=0.3, density=1400.0, thickness=1e-4, residual_stiffness=1e-6)
GAP = 2.2e-4  # between sheets at the start [m]
DISTANCE = 2e-4  # at which contact begins [m]
SPEED = 0.02  # m/s
PRESSED = 0.01  # time at which the full pressure acts, and at which the pull begins [s]
DURATION = 0.05  # s


def smooth(share: float) -> float:
    """Rise softly from 0 to 1 with a share from 0 to 1."""
    s = min(max(share, 0.0), 1.0)
    return s * s * (3 - 2 * s)


def pull(t: float) -> float:
    """Displacement [m] of the pulled edges: they reach `SPEED` within 5 ms."""
    ramp = 5e-3
    since = max(t - PRESSED, 0.0)
    share = min(since / ramp, 1.0)
    accelerating = SPEED * ramp * (share**3 - share**4 / 2)
    return accelerating + SPEED * max(since - ramp, 0.0)


def build(
    comm: MPI.Intracomm, sheets: int, pressure: float, until: float = DURATION
) -> tuple[gx.Contact, list[gx.Membrane], gx.Case]:
    """A stack on a smooth floor, pressed from above; every second sheet is pulled at its right edge."""

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
        *films, floor, distance=DISTANCE, stiffness=1e8, friction=FRICTION, slip_velocity=1e-4
    )
    load = gx.Pressure(films[-1], lambda t: -pressure * smooth(t / PRESSED))
    scene = gx.Scene(contact, load, *supports)
    case = gx.Case(scene, gx.Midpoint(dt=5e-4), until=until, title="Sheets pulled apart")
    return contact, films, case


def pulled_apart(comm: MPI.Intracomm, sheets: int, pressure: float) -> tuple[gx.Series, Any]:
    """The finished run of a stack, and the force [N] of contact on all pulled sheets in every step."""
    contact, films, case = build(comm, sheets, pressure)
    probes = [gx.probes.ContactForce(contact, film, axis="x") for film in films[1::2]]
    series = gx.Series({"force": lambda run: -sum(probe(run) for probe in probes)})
    run = case.simulation([series])
    run.run(until=case.until)
    return series, run
