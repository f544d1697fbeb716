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
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import print_figures, run_case, run_figures
from demos.common.figures import BLUE, RED, finish, new_figure, save
from demos.common.spinning import drum
from gossamer_fx.extend import Array, relative_drift
from gossamer_fx.meshes.line import line

TITLE = "A hub is stopped by two masses on cords"
RADIUS = 0.1  # of the cylinder [m]
MASS = 0.02  # at the end of a cord [kg]
SPIN = 10.0  # of the hub at the start [rad/s]
CORD_RADIUS = 1e-4  # m
CONTACT_DISTANCE = 4e-4  # m
# From the drum to the middle of a wound cell [m]: one per cent outside of contact.
STANDOFF = CORD_RADIUS + 1.01 * CONTACT_DISTANCE
LINE_DENSITY = 1e-4  # of a cord [kg/m]
EA = 5e3  # of a cord [N]
# The tension of the cords reduces their gap by a hundredth of the contact distance at this
# stiffness.
CONTACT_STIFFNESS = 5e9  # N/m³
# Speed [m/s] up to which friction grows: cords fall along a drum ten to a hundred times as fast.
SLIP_VELOCITY = 1e-2
# Of the stretch of the cords: without damping the masses bounce on them for ever.
DAMPING = 1e-3  # s
# Part of half a turn that a cord is wound: it ends before the other one begins.
WOUND_PART = 0.98


def wound(cells: int) -> tuple[float, float, float]:
    """Radius of a cord's corners, its length [m] and the angle of a cell [rad]: its cells lie
    outside of contact."""
    step = WOUND_PART * math.pi / cells
    # The middle of a cell is the nearest to the cylinder.
    corners = (RADIUS + STANDOFF) / math.cos(step / 2)
    return corners, cells * 2 * corners * math.sin(step / 2), step


@dataclass(frozen=True)
class WoundCord:
    """A cord wound on a hub with the axis z, with a mass at its end.

    Args:
        comm: the communicator.
        hub: what it is knotted to.
        number: of the cord, for names.
        knot: angle of its knot [rad]; it is wound clockwise from there.
        corners: radius of its corners [m].
        step: angle of a cell [rad].
        cells: their number.
        height: of the cord [m].
        mass: at its end [kg].
        law: of the cord.
    """

    comm: MPI.Intracomm
    hub: gx.RigidBody
    number: int
    knot: float
    corners: float
    step: float
    cells: int
    height: float
    mass: float
    law: gx.TensionOnly

    def _at(self, angle: Array) -> Array:
        height = self.height + 0 * angle
        return np.vstack([self.corners * np.cos(angle), self.corners * np.sin(angle), height])

    def _corner(self, k: int) -> tuple[float, float, float]:
        x, y, z = self._at(np.array([self.knot - k * self.step]))[:, 0].tolist()
        return x, y, z

    @cached_property
    def cord(self) -> gx.Cable:
        """The cord, of straight cells."""
        length = self.cells * 2 * self.corners * math.sin(self.step / 2)

        def wind(X: Array) -> Array:
            return self._at(self.knot - X[0] / length * self.cells * self.step) - X

        mesh = line(self.comm, [(0.0, 0.0, 0.0), (length, 0.0, 0.0)], self.cells)
        return gx.Cable(mesh, self.law, name=f"cord {self.number}", displacement=wind)

    @cached_property
    def tip(self) -> gx.PointMass:
        """The mass."""
        return gx.PointMass(
            self.mass, self._corner(self.cells), name=f"mass {self.number}", comm=self.comm
        )

    @cached_property
    def root(self) -> gx.Port:
        """The knot, a point of the hub."""
        return self.hub.port(self._corner(0))

    def items(self) -> list[object]:
        """All that a scene needs of it but contact."""
        k = self.number
        cord = self.cord
        return [
            cord,
            self.tip,
            gx.constraints.BallJoint(cord.port("start"), self.root, name=f"knot {k}"),
            gx.constraints.BallJoint(cord.port("end"), self.tip.port(), name=f"end {k}"),
            gx.Damping(cord, stiffness_factor=DAMPING, name=f"damping {k}"),
        ]


def on_drum(
    cords: list[WoundCord], obstacle: gx.contact.Cylinder, friction: float = 0.0
) -> gx.Contact:
    """Contact of cords with the drum that they are wound on, with a coefficient of friction."""
    return gx.Contact(
        *(one.cord for one in cords),
        obstacle,
        distance=CONTACT_DISTANCE,
        stiffness=CONTACT_STIFFNESS,
        friction=friction,
        slip_velocity=SLIP_VELOCITY,
        radius=dict.fromkeys((one.cord.name for one in cords), CORD_RADIUS),
    )


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
    R, _, step = wound(cells)
    I = inertia(cells)  # noqa: E741 (as in the formula)
    hub = gx.RigidBody(2 * I / RADIUS**2, (I / 2, I / 2, I), name="hub", comm=comm)
    law = gx.TensionOnly(EA=EA, line_density=LINE_DENSITY)
    cords = [
        WoundCord(comm, hub, k + 1, math.pi * k, R, step, cells, 0.0, MASS, law) for k in range(2)
    ]
    items = [item for cord in cords for item in cord.items()]
    contact = on_drum(cords, drum(hub, RADIUS, -0.02, 0.02))
    scene = gx.Scene(hub, *items, contact, gx.RigidMotion(spin=(0.0, 0.0, SPIN)))  # type: ignore[arg-type]
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
