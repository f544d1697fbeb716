"""Hours of flight of a spinning sail in minutes of computing, by a reduced model of the film.

A square sail of 14 m with a mass of 0.5 kg at each corner spins freely about a hub, which four
tethers tie to it (figures after IKAROS: 7.5 µm of polyimide, 75 g/m² with its devices, 2.5 rpm; the
hub of 85 kg m² carries the tethers at 0.8 m).  It starts from the equilibrium of its steady spin
with an initial velocity out of its plane, the kick.  The shapes of that flight give a basis of
scalar modes with vector coefficients,

    x(X, t) = Σ_i φ_i(X) c_i(t),    c_i ∈ R³,

in which strains are quadratic and rotations are exact, so that the time step conserves energy,
momentum and angular momentum.  The reduced sail then flies under conditions that were not recorded:
with another spin, another kick, and for an hour, in which a torque disturbs its hub and a
controller stabilises the axis of its spin.

    ./gossamer demo reduced_sail
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import print_figures
from gossamer_fx.extend import Output, relative_drift
from gossamer_fx.meshes.sheet import sheet

SIDE = 14.0  # of the sail [m]
SPIN = 2.5 * 2 * np.pi / 60  # 2.5 rpm [rad/s]
CENTRE = (SIDE / 2, SIDE / 2, 0.0)
CORNERS = [(x, y, 0.0) for x in (0.0, SIDE) for y in (0.0, SIDE)]
# Density [kg/m³] with the mass of the devices: 75 g/m².
LAW = gx.Miyazaki(E=2.5e9, nu=0.34, density=1e4, thickness=7.5e-6)
TIP_MASS = 0.5  # at each corner [kg]
TETHER_RADIUS = 0.8  # of the ends of the tethers on the hub [m]
TETHER_STIFFNESS = 50.0  # N/m
# Shape of an initial velocity, as a function of x and y from the middle over half the side.
Kick = Callable[[np.ndarray, np.ndarray], np.ndarray]


def saddle(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Corners alternately up and down, and a tilt."""
    return x * y + 0.3 * x


def bowl(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """All corners up, one more than the others."""
    return 0.5 * (x**2 + y**2) + 0.4 * x * y - 0.2 * y


def tilted(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A kick that no recording has: a mixture of both, turned and mirrored."""
    return 0.6 * saddle(y, x) - 0.8 * bowl(-x, y)


def disturbance(t: float) -> tuple[float, float, float]:
    """Torque [N m] on the hub in space."""
    return 5e-3 * float(np.sin(2 * np.pi * t / 600.0)), 2e-3, 0.0


def film(comm: MPI.Comm, cells: int, kick: Kick, speed: float) -> gx.Membrane:
    """The sail with `cells` squares a side and a kick of at most about `speed` [m/s]."""

    def velocity(X: np.ndarray) -> np.ndarray:
        x = 2 * X[0] / SIDE - 1
        y = 2 * X[1] / SIDE - 1
        return np.stack([0 * x, 0 * x, speed * kick(x, y)])

    return gx.Membrane(sheet(comm, cells, cells, SIDE, SIDE), LAW, velocity=velocity, name="sail")


def parts(sail: gx.Membrane) -> list[Any]:
    """The hub, the masses at the tips, and their joints and tethers to the sail."""
    hub = gx.RigidBody(200.0, (50.0, 50.0, 85.0), position=CENTRE, comm=sail.comm, name="hub")
    items: list[Any] = [hub]
    for k, corner in enumerate(CORNERS):
        port = sail.port_at(corner)
        tip = gx.PointMass(
            TIP_MASS,
            tuple(port.initial()),
            velocity=tuple(port.initial_rate()),
            comm=sail.comm,
            name=f"tip {k}",
        )
        # A tether is on the diagonal, from the hub to a point of the sail at an eighth of its side.
        diagonal = np.sign(np.asarray(corner[:2]) - SIDE / 2)
        on_sail = sail.port_at((*(SIDE / 2 + 0.125 * SIDE * diagonal), 0.0))
        on_hub = hub.port((*(TETHER_RADIUS / 2**0.5 * diagonal), 0.0))
        length = 0.25 * SIDE / 2**0.5 - TETHER_RADIUS
        tether = gx.connectors.Spring(
            on_hub, on_sail, stiffness=TETHER_STIFFNESS, length=length, name=f"tether {k}"
        )
        items += [tip, gx.constraints.BallJoint(port, tip.port(), name=f"joint {k}"), tether]
    return items


def steady(sail: gx.Membrane, spin: float) -> gx.Equilibrium:
    """Equilibrium of the sail and its masses in axes that rotate with `spin` [rad/s]; the hub is
    fixed."""
    items = parts(sail)
    hub = items[0]
    turning = [sail, *(item for item in items if isinstance(item, gx.PointMass))]
    items += [gx.loads.Centrifugal(body, (0.0, 0.0, spin), centre=CENTRE) for body in turning]
    hold = gx.constraints.FixedJoint(hub.frame_at(CENTRE), gx.ground_frame(CENTRE), name="hold")
    # With many modes the round-off of the forces is above the default tolerance, 1e-8 of the load.
    found = gx.Equilibrium(gx.Scene(sail, *items, hold), gx.analysis.Continuation(tolerance=1e-7))
    found.find()
    return found


def flight(
    sail: gx.Membrane,
    spin: float,
    dt: float,
    outputs: Sequence[Output] = (),
    controlled: bool = False,
) -> gx.Simulation:
    """A flight from the steady spin with the kick of the sail; `controlled`: with disturbance and
    controller."""
    items = parts(sail)
    if controlled:
        items.append(gx.loads.Torque(items[0].frame(), disturbance))
        # About x and y [N m/rad, N m s/rad]; the spin about z is not controlled.
        controller = gx.control.AttitudeControl(
            items[0].frame(),
            (0.0, 0.0, 0.0),
            stiffness=(0.5, 0.5, 0.0),
            damping=(20.0, 20.0, 0.0),
            period=1.0,
        )
        items.append(controller)
    start = gx.StartFrom(steady(sail, spin).system)
    turning = gx.RigidMotion(spin=(0.0, 0.0, spin), centre=CENTRE)
    scene = gx.Scene(sail, *items, start, turning)
    return gx.Simulation(scene, gx.Midpoint(dt=dt), outputs=outputs)


def main(
    cells: int = 24,
    modes: int = 40,
    sampled: int | None = 250,
    training: float = 48.0,
    until: float = 3600.0,
    dt: float = 0.1,
    output: str | Path | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> dict[str, float]:
    """Record `training` seconds, compare over twice that time, then fly until `until` [s].

    Returns errors over the largest displacement out of the plane, drifts over the initial values,
    the ratio of CPU times of the film and its reduced model, the energy outside of the basis, and
    the tilt of the axis of spin [rad].
    """
    shapes = []
    started = time.process_time()
    for kick in (saddle, bowl):
        known = film(comm, cells, kick, 0.02)
        shapes.append(gx.reduction.Snapshots(known, every=4))
        flight(known, SPIN, dt, outputs=[shapes[-1]]).run(until=training)
    recorded = time.process_time() - started

    spin = 1.1 * SPIN
    times = np.linspace(0, 2 * training, 41)[1:].tolist()
    other = film(comm, cells, tilted, 0.015)
    started = time.process_time()
    reduced = gx.reduction.reduce(other, shapes, modes=modes, cells=sampled)
    trained = time.process_time() - started
    truth = gx.reduction.Snapshots(other, times=times)
    whole = flight(other, spin, dt, [truth])
    few = flight(reduced, spin, dt)
    seconds = [0.0, 0.0]
    found = []
    for t in times:
        # Both runs alternate, so that other jobs of the machine slow both down.
        for k, run in enumerate((whole, few)):
            started = time.process_time()
            run.run(until=t)
            seconds[k] += time.process_time() - started
        found.append(gx.fields.positions(few, reduced))
    height = max(_largest(comm, x[:, 2]) for x in truth.positions)
    differences = [
        _largest(comm, (exact - approximate)[:, 2])
        for exact, approximate in zip(truth.positions[-40:], found, strict=True)
    ]
    error = max(differences) / height

    outside = gx.reduction.OutsideBasis(reduced)
    outputs: list[Output] = [gx.outputs.Progress()]
    if output is not None:
        drawn = [until / 4, until / 2, until]
        outputs.append(gx.plot.Picture(Path(output) / "reduced_sail.png", times=drawn))
    long = flight(reduced, spin, dt, outputs, controlled=True)
    long.run(until=until)
    hub = next(body for body in long.system.unknowns.bodies if body.name == "hub")
    axis = long.system.unknowns.state.vectors([hub.frame().directors[2]])[0]
    return {
        "error": error,
        "sampling_error": reduced.sample.error,
        "speed_up": seconds[0] / seconds[1],
        "unknowns": whole.system.unknowns.numbering.size,
        "reduced_unknowns": few.system.unknowns.numbering.size,
        "energy_error": abs(few.energy_error),
        "angular_momentum_drift": relative_drift(
            few.totals.angular_momentum, few.first.angular_momentum
        ),
        "energy_error_of_the_long_flight": abs(long.energy_error),
        "tilt_after_the_long_flight": float(np.hypot(*axis[:2])),
        "energy_outside": outside(few),
        "energy_outside_after_the_long_flight": outside(long),
        "seconds_recorded": recorded,
        "seconds_trained": trained,
        "seconds_of_the_long_flight": long.seconds,
    }


def _largest(comm: MPI.Comm, values: np.ndarray) -> float:
    """The largest absolute value on all ranks."""
    return float(comm.allreduce(np.abs(values).max(initial=0.0), MPI.MAX))


if __name__ == "__main__":
    print_figures(main(output="out/reduced_sail"))
