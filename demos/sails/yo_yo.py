"""A spinning hub is stopped by two masses on cords that unwind from it: the yo-yo of satellites.

Two cords are wound half way round a cylinder each and touch it by contact only.  A mass at the end
of each is released. With cords without mass that leave the cylinder along its tangent (Fedor, NASA
TN D-708, 1961, from the conservation of energy and angular momentum), the unwound length is s = R
ω0 t and the spin of the hub

    ω = ω0 (c R² - s²)/(c R² + s²),   c = 1 + I/(2 m R²)

so that cords of the length R √c stop it.  Here the cords have mass, stretch, and touch the cylinder
at a distance that the contact sets.

Chosen: cylinder of 0.1 m radius, masses of 20 g, cords of 0.1 g/m; I such that π R is what stops
the hub.

    ./gossamer demo yo_yo
    ./gossamer run demos/sails/yo_yo.py cells=60 --output out/yo_yo
    ./gossamer report out/yo_yo
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import print_figures, run_case, run_figures
from demos.common.figures import BLUE, RED, finish, new_figure, save
from demos.common.spinning import drum
from gossamer_fx.core.model.body import Array
from gossamer_fx.meshes.line import line
from gossamer_fx.solve.system.totals import relative_drift

TITLE = "A hub is stopped by two masses on cords"
RADIUS = 0.1  # of the cylinder [m]
MASS = 0.02  # at the end of a cord [kg]
SPIN = 10.0  # of the hub at the start [rad/s]
CORD_RADIUS = 1e-4  # m
CONTACT_DISTANCE = 4e-4  # m
LINE_DENSITY = 1e-4  # of a cord [kg/m]
EA = 5e3  # of a cord [N]
# The tension of the cords reduces their gap by a hundredth of the contact distance at this
# stiffness.
CONTACT_STIFFNESS = 5e9  # N/m³
# Of the stretch of the cords: without damping the masses bounce on them for ever.
DAMPING = 1e-3  # s
# Part of half a turn that a cord is wound: it ends before the other one begins.
WOUND_PART = 0.98


def wound(cells: int) -> tuple[float, float, float]:
    """Radius of a cord's corners, its length [m] and the angle of a cell [rad]: its cells lie
    outside of contact."""
    step = WOUND_PART * math.pi / cells
    # The middle of a cell is the nearest to the cylinder: one per cent outside of contact.
    corners = (RADIUS + CORD_RADIUS + 1.01 * CONTACT_DISTANCE) / math.cos(step / 2)
    return corners, cells * 2 * corners * math.sin(step / 2), step


def inertia(cells: int) -> float:
    """I [kg m²] of a hub that cords of π R stop."""
    R = wound(cells)[0]
    return 2 * MASS * R**2 * (math.pi**2 - 1)


def spin_of(t: Array) -> Array:
    """ω(t) [rad/s] of the closed form."""
    c = math.pi**2
    s = SPIN * t  # over R
    return np.asarray(SPIN * (c - s**2) / (c + s**2))


def build(
    comm: MPI.Comm,
    cells: int = 36,
    until: float | None = None,
    dt: float = 2e-4,
    largest: float = 1e-3,
) -> gx.Case:
    """The hub and two cords of `cells` cells until the time `until` [s], at which they are all but
    unwound.

    Steps [s] are as long as `largest` at most, the first one `dt`.
    """
    R, length, step = wound(cells)
    I = inertia(cells)  # noqa: E741 (as in the formula)
    hub = gx.RigidBody(2 * I / RADIUS**2, (I / 2, I / 2, I), name="hub", comm=comm)
    cords: list[gx.Cable] = []
    items: list[object] = [hub]
    for k in range(2):

        def wind(X: Array, first: float = math.pi * k) -> Array:
            angle = first - X[0] / length * cells * step
            return np.vstack([R * np.cos(angle), R * np.sin(angle), 0 * angle]) - X

        mesh = line(comm, [(0.0, 0.0, 0.0), (length, 0.0, 0.0)], cells)
        law = gx.TensionOnly(EA=EA, line_density=LINE_DENSITY)
        cord = gx.Cable(mesh, law, name=f"cord {k + 1}", displacement=wind)
        end = math.pi * k - cells * step
        place = (R * math.cos(end), R * math.sin(end), 0.0)
        tip = gx.PointMass(MASS, place, name=f"mass {k + 1}", comm=comm)
        start = math.pi * k
        root = hub.port((R * math.cos(start), R * math.sin(start), 0.0))
        items += [
            cord,
            tip,
            gx.constraints.BallJoint(cord.port("start"), root, name=f"knot {k + 1}"),
            gx.constraints.BallJoint(cord.port("end"), tip.port(), name=f"end {k + 1}"),
            gx.Damping(cord, stiffness_factor=DAMPING, name=f"damping {k + 1}"),
        ]
        cords.append(cord)
    contact = gx.Contact(
        *cords,
        drum(hub, RADIUS, -0.02, 0.02),
        distance=CONTACT_DISTANCE,
        stiffness=CONTACT_STIFFNESS,
        radius=dict.fromkeys((c.name for c in cords), CORD_RADIUS),
    )
    scene = gx.Scene(*items, contact, gx.RigidMotion(spin=(0.0, 0.0, SPIN)))  # type: ignore[arg-type]
    probes = {
        "spin of the hub [rad/s]": gx.probes.AngularVelocity(hub.frame(), "z"),
        "penetrations": gx.probes.Penetrations(contact),
    }
    # In the closed form, s = R ω0 t, the cords are unwound at this time.
    end_time = WOUND_PART * math.pi / SPIN if until is None else until
    control = gx.StepControl(target_iterations=10, max_step=largest)
    return gx.Case(
        scene,
        gx.Midpoint(dt=dt),
        until=end_time,
        title=TITLE,
        probes=probes,
        control=control,
        frames=60,
    )


def main(
    output: str | Path | None = None,
    cells: int = 36,
    dt: float = 2e-4,
    largest: float = 1e-3,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> dict[str, float]:
    """Unwind the cords; errors of the hub's spin over the first one, until half and until all of
    them is unwound.

    With `output`, a folder: the recording of the run, and a picture.
    """
    case = build(comm, cells, dt=dt, largest=largest)
    run, series = run_case(case, output)
    t = series.time
    spin = series["spin of the hub [rad/s]"]
    error = np.abs(spin - spin_of(t)) / SPIN
    if output is not None and comm.rank == 0:
        draw(t, spin, Path(output) / "yo_yo.png")
    first = run.first.angular_momentum
    now = run.totals.angular_momentum
    return {
        "error_half": float(error[t <= case.until / 2].max()),
        "error_whole": float(error.max()),
        "last_spin": float(spin[-1]),
        "angular_momentum_drift": relative_drift(now, first),
        **run_figures(run, series),
    }


def draw(t: Array, spin: Array, path: Path) -> None:
    """The spin of the hub over the time, computed and of the closed form, and their difference."""
    figure = new_figure(9.0, 3.8)
    left, right = figure.subplots(1, 2)
    exact = spin_of(t)
    left.plot(1e3 * t, spin, color=RED, label="computed")
    left.plot(1e3 * t, exact, "--", color=BLUE, label="closed form")
    finish(left, "t [ms]", "spin of the hub [rad/s]")
    right.plot(1e3 * t, 100 * (spin - exact) / SPIN, color="black")
    finish(right, "t [ms]", "difference [% of the first spin]")
    save(figure, path, TITLE)


if __name__ == "__main__":
    print_figures(main(output="out/yo_yo"), {"last_spin": "rad/s"})
