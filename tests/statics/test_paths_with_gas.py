"""Equilibrium paths of scenes on closed gas: their points and stability do not depend on the length
of the steps, and the stability is that of the load over the displacement."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.meshes.arrays import mesh_of_arrays
from gossamer_fx.meshes.line import line

AIR = gx.IdealGas(gamma=1.4, R=287.0)
FIRST_STEPS = (0.23, 0.3, 0.5, 0.8, 1.1)
POINTS = ("x", "y", "z", "-x", "-y", "-z")
# The points of a balloon beyond its first limit point lie far apart.
MAX_STEPS = 20
PROCESSES = ("isothermal", "adiabatic")


def bars_on_a_piston(comm, process, pressure=1e4):
    """Three shallow bars on a piston, which are pushed down through their limit points; of more
    pressure the gas has none."""
    area = 0.01
    rise = 0.2
    mass = gx.PointMass(0.1, (0.0, 0.0, rise), comm=comm, name="apex")
    chamber = gx.Chamber(
        gx.gas.Piston(mass.port(), area, direction=(0.0, 0.0, 1.0)),
        gas=AIR,
        pressure=pressure,
        temperature=300.0,
        dead_volume=2e-3 + 2 * rise * area,
        outside=gx.gas.Ambient(pressure, 300.0),
    )
    items: list[object] = [chamber]
    for k in range(3):
        angle = 2 * math.pi * k / 3
        foot = (math.cos(angle), math.sin(angle), 0.0)
        law = gx.CableLaw(EA=2e4, line_density=1.0)
        bar = gx.Cable(line(comm, [foot, (0, 0, rise)], 1), law, name=f"bar {k}")
        hinge = gx.constraints.BallJoint(bar.port("end"), mass.port(), name=f"hinge {k}")
        items += [gx.Fixed(bar, "start", name=f"foot {k}"), hinge]
    push = gx.loads.Force(mass.port(), lambda t: (0.0, 0.0, -60.0 * t))
    equilibrium = gx.Equilibrium(gx.Scene(*items, push), gas=process)
    return equilibrium, gx.probes.Position(mass.port(), "z"), 14.0


def bars_on_stiff_gas(comm, process):
    """Nearly a limit point: the stiffness is a fortieth of that of bars and of gas."""
    return bars_on_a_piston(comm, process, pressure=4e4)


def octahedron(comm):
    """Eight triangles between points on the axes, each point is a group."""
    axes = np.eye(3)
    points = np.vstack([axes, -axes])
    triangles = []
    for i, j, k in product((0, 3), (1, 4), (2, 5)):
        # Normals point outwards.
        is_even = (i, j, k).count(0) + (j == 1) + (k == 2) in (1, 3)
        triangles.append((i, j, k) if is_even else (i, k, j))
    groups = {name: np.array([[k]]) for k, name in enumerate(POINTS)}
    return mesh_of_arrays(comm, lambda: (points, np.array(triangles), groups))


def balloon(comm, process):
    """A balloon of rubber with closed gas, blown up by a pressure in addition, past its limit."""
    law = gx.materials.NeoHooke(shear_modulus=1e6, density=1000.0, thickness=1e-3)
    film = gx.Membrane(octahedron(comm), law, name="film")
    chamber = gx.Chamber(
        film, gas=AIR, pressure=500.0, temperature=300.0, outside=gx.gas.Ambient(500.0, 300.0)
    )
    held = [
        gx.Fixed(film, name, components=[axis for axis in range(3) if axis != k % 3], name=name)
        for k, name in enumerate(POINTS)
    ]
    blown = gx.Pressure(film, lambda t: 1000.0 * t)
    equilibrium = gx.Equilibrium(gx.Scene(chamber, blown, *held), gas=process)
    return equilibrium, gx.probes.Position(film.port("x"), "x"), 6.0


def dome(comm, process):
    """A pyramid of film on closed gas, whose apex is pushed through its base."""
    corners = [(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)]
    points = np.array([*corners, (0.0, 0.0, 0.3)])
    sides = [(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)]
    triangles = np.array([*sides, (0, 2, 1), (0, 3, 2)])
    groups = {"base": np.array([[0, 2]]), "rim": np.array([[0, 1], [1, 2], [2, 3], [3, 0]])}
    groups["apex"] = np.array([[4]])
    film = gx.Membrane(
        mesh_of_arrays(comm, lambda: (points, triangles, groups)),
        gx.Linear(E=1e8, nu=0.3, density=1000.0, thickness=1e-3),
        name="film",
    )
    chamber = gx.Chamber(
        film,
        gas=AIR,
        pressure=100.0,
        temperature=300.0,
        dead_volume=1.0,
        outside=gx.gas.Ambient(100.0, 300.0),
    )
    apex = film.port("apex")
    push = gx.loads.Force(apex, lambda t: (0.0, 0.0, -1500.0 * t))
    equilibrium = gx.Equilibrium(gx.Scene(chamber, push, gx.Fixed(film, "rim")), gas=process)
    return equilibrium, gx.probes.Position(apex, "z"), 12.0


@pytest.mark.parametrize("process", PROCESSES)
@pytest.mark.parametrize("scene", [bars_on_a_piston, bars_on_stiff_gas, balloon, dome])
def test_paths_with_gas_do_not_depend_on_their_steps(comm, scene, process):
    """Limit and branch points are the same for every first step, and a point is unstable where the
    load falls: by differences of the path itself, next to which no limit point lies."""
    events = []
    for first in FIRST_STEPS:
        equilibrium, probe, until = scene(comm, process)
        probes = {"u": probe}
        path = gx.analysis.path(
            equilibrium, until, first_step=first, probes=probes, max_steps=MAX_STEPS
        )
        events.append(path.loads[list(path.limit_points)])
        assert path.branch_points == ()
        falls = np.diff(path.loads) < 0
        is_clear = falls[1:] == falls[:-1]
        assert is_clear.sum() > 4
        assert np.array_equal(path.unstable[1:-1][is_clear], falls[1:][is_clear])
    assert len(events[0]) == LIMIT_POINTS[scene]
    for others in events[1:]:
        np.testing.assert_allclose(others, events[0], rtol=1e-4)


def two_gases_and_two_bars(comm, process):
    """A double-acting piston that two bars hold in their plane; across it a spring is weaker than
    the bars in compression, so that the path has two branch points."""
    rise = 0.2
    mass = gx.PointMass(0.1, (0.0, 0.0, rise), comm=comm, name="apex")
    items: list[object] = []
    for name, sign, pressure in (("above", 1.0, 2e4), ("below", -1.0, 1.5e4)):
        piston = gx.gas.Piston(mass.port(), 0.01, direction=(0.0, 0.0, sign))
        chamber = gx.Chamber(
            piston,
            gas=AIR,
            pressure=pressure,
            temperature=300.0,
            dead_volume=7e-3,
            outside=gx.gas.Ambient(1e4, 300.0, name=f"outside {name}"),
            name=name,
        )
        items.append(chamber)
    for k, x in enumerate((-1.0, 1.0)):
        law = gx.CableLaw(EA=2e4, line_density=1.0)
        bar = gx.Cable(line(comm, [(x, 0.0, 0.0), (0.0, 0.0, rise)], 1), law, name=f"bar {k}")
        hinge = gx.constraints.BallJoint(bar.port("end"), mass.port(), name=f"hinge {k}")
        items += [gx.Fixed(bar, "start", name=f"foot {k}"), hinge]
    across = gx.connectors.AxialSpring(
        mass.port(), 50.0, direction=(0.0, 1.0, 0.0), origin=(0.0, 0.0, 0.0)
    )
    push = gx.loads.Force(mass.port(), lambda t: (0.0, 0.0, -60.0 * t))
    return gx.Equilibrium(gx.Scene(*items, across, push), gas=process)


@pytest.mark.parametrize("process", PROCESSES)
def test_branch_points_with_gas_do_not_depend_on_the_steps(comm, process):
    loads = []
    for first in FIRST_STEPS:
        equilibrium = two_gases_and_two_bars(comm, process)
        path = gx.analysis.path(equilibrium, 14.0, first_step=first)
        loads.append(path.loads[list(path.branch_points)])
    assert len(loads[0]) == 2
    for others in loads[1:]:
        np.testing.assert_allclose(others, loads[0], rtol=1e-5)


LIMIT_POINTS = {bars_on_a_piston: 2, bars_on_stiff_gas: 0, balloon: 1, dome: 2}
