"""Small scenes with many kinds of items, for the tests of restart and failure."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.extend import Output
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.meshes.tube import flat_tube

LAW = gx.Miyazaki(E=1e9, nu=0.3, density=1400.0, thickness=1e-4, residual_stiffness=1e-6)
GAS = gx.IdealGas(gamma=1.4, R=296.8)
DT = 1e-3


class Watch(Output):
    """An output that looks at each step of a run."""

    times = ()

    def __init__(self, look: Callable[[gx.Simulation], object]) -> None:
        self.look = look

    def open(self, run: gx.Simulation) -> None: ...
    def close(self, run: gx.Simulation) -> None: ...
    def record(self, run: gx.Simulation, last: bool) -> None:
        self.look(run)


def flutter(x: np.ndarray) -> np.ndarray:
    """Velocity [m/s] of a spin with an out-of-plane bump."""
    spin = 10.0  # rad/s, about the middle of the sheet
    out_of_plane = np.sin(np.pi * x[0]) * np.sin(np.pi * x[1])
    return np.vstack([-spin * (x[1] - 0.5), spin * (x[0] - 0.5), out_of_plane])


def fluttering_sheet(comm: MPI.Comm, n: int = 4, order: int = 1, law: Any = LAW) -> gx.Scene:
    """A free film that wrinkles and goes slack."""
    return gx.Scene(gx.Membrane(sheet(comm, n, n), law, order=order, velocity=flutter))


def filled_tube(comm: MPI.Comm, cells: int = 4) -> gx.Scene:
    """A tube pressed flat, with a tank and a valve: film, gas, and scalar unknowns."""
    law = gx.Miyazaki(E=2.5e9, nu=0.34, density=1420.0, thickness=25e-6, residual_stiffness=1e-6)
    film = gx.Membrane(flat_tube(comm, 0.2, 0.058, cells), law)
    tube = gx.Chamber(film, gas=GAS, pressure=1.0, temperature=293.0, dead_volume=1e-6, name="tube")
    tank = gx.Tank(20e-6, gas=GAS, pressure=1.5e6, temperature=293.0)
    return gx.Scene(film, tube, gx.Orifice(tank, tube, area=3e-8, name="valve"))


def turning_beam(comm: MPI.Comm) -> gx.Scene:
    """A beam on a hub with sampled attitude control, and a damper: multipliers and history
    variables."""
    section = gx.sections.solid_circle(0.01, E=1e9, nu=0.3, density=1500.0)
    axis = line(comm, [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)], 4)
    beam = gx.Beam(axis, section, normal=(0, 0, 1), name="boom")
    hub = gx.RigidBody(1.0, (0.02, 0.03, 0.04), spin=(0.0, 0.0, 0.0), comm=comm, name="hub")
    control = gx.control.AttitudeControl(
        hub.frame(),
        (0.0, 0.0, 0.1),
        stiffness=2.0,
        damping=0.3,
        period=2.5 * DT,
    )
    joint = gx.constraints.FixedJoint(beam.frame("start"), hub.frame(), name="root")
    damper = gx.connectors.Damper(beam.port("end"), gx.Ground((1.0, 0.0, -1.0)), damping=0.5)
    return gx.Scene(beam, hub, control, joint, damper, gx.Gravity(beam, (0, 0, -9.81)))


def numbers(run: gx.Simulation) -> np.ndarray:
    """Totals by which states are compared on any number of ranks: energies, works, momenta, gas
    mass."""
    totals = run.totals
    energies = [totals.kinetic, *totals.stored.values()]
    works = [totals.supplied, *totals.losses.values()]
    momenta = [*totals.momentum, *totals.angular_momentum]
    return np.array([totals.time, *energies, *works, *momenta, totals.mass])
