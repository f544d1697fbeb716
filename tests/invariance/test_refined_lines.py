"""Straight cables and beams under loads whose exact solution does not depend on the number of their
elements."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.line import line

COUNTS = (1, 2, 5)
LENGTH = 0.8


def pulled_cable(law, elements):
    """A cable in two straight halves, with a force where they meet."""
    points = [(-0.5, 0.0, 0.0), (0.1, 0.0, 0.0), (0.7, 0.2, 0.0)]
    rope = gx.Cable(line(MPI.COMM_SELF, points, elements), law, name="rope")
    middle = rope.port("point 1")
    items = [gx.Fixed(rope, "start"), gx.Fixed(rope, "end")]
    return middle, [*items, gx.loads.Force(middle, (3.0, -20.0, -40.0))]


def elastic_cable(elements):
    return pulled_cable(gx.CableLaw(EA=1e4, line_density=0.1), elements)


def cable_without_compression(elements):
    return pulled_cable(gx.TensionOnly(EA=1e4, line_density=0.1), elements)


def bundle_on_a_spring(elements):
    """Two cables in series, which carry a weight on a spring."""
    law = gx.CableLaw(EA=2e3, line_density=1e-3)
    upper = gx.Cable(line(MPI.COMM_SELF, [(0, 0, 0), (0, 0, -0.5)], elements), law, name="upper")
    lower = gx.Cable(line(MPI.COMM_SELF, [(0, 0, -0.5), (0, 0, -0.8)], 1), law, name="lower")
    load = gx.PointMass(2.0, (0.0, 0.0, -1.0), comm=MPI.COMM_SELF, name="load")
    spring = gx.connectors.Spring(lower.port("end"), load.port(), stiffness=500.0, length=0.2)
    joint = gx.constraints.BallJoint(upper.port("end"), lower.port("start"))
    return load.port(), [gx.Fixed(upper, "start"), joint, spring, gx.Gravity(load)]


def boom(load, elements):
    """A cantilever under a force that bends it by 1e-5 of its length: a cubic line."""
    section = gx.sections.solid_circle(0.01, E=1e9, nu=0.3, density=1500.0)
    mesh = line(MPI.COMM_SELF, [(0, 0, 0), (LENGTH, 0, 0)], elements)
    beam = gx.Beam(mesh, section, normal=(0.0, 0.0, 1.0), name="boom")
    tip = beam.port("end")
    return tip, [gx.Fixed(beam, "start", rotation=True), gx.loads.Force(tip, load)]


def boom_across(elements):
    return boom((0.0, 2e-4, -1e-4), elements)


def boom_along(elements):
    return boom((50.0, 0.0, 0.0), elements)


# With the largest deviation over the displacement: of a beam what bending has of higher order.
SCENES = {
    elastic_cable: 1e-8,
    cable_without_compression: 1e-8,
    bundle_on_a_spring: 1e-8,
    boom_across: 1e-6,
    boom_along: 1e-8,
}


@pytest.mark.parametrize("make", SCENES)
def test_more_elements_of_a_straight_line_change_nothing(make):
    displacements = []
    stiffnesses = []
    energies = []
    for elements in COUNTS:
        port, items = make(elements)
        search = gx.analysis.Continuation(tolerance=1e-12)
        equilibrium = gx.Equilibrium(gx.Scene(*items), search)
        result = equilibrium.find(progress=False)
        assert result.regular and result.unstable == 0 and result.free == ()
        system = equilibrium.system
        displacements.append(
            system.unknowns.state.vector(port) - system.unknowns.initial.vector(port)
        )
        # Along the displacement: pulled beams are not cubic lines across it.
        along = tuple(displacements[0] / np.linalg.norm(displacements[0]))
        stiffnesses.append(gx.analysis.point_stiffness(equilibrium, port, direction=along))
        energies.append(sum(result.totals.stored.values()))
    moved = np.abs(displacements[0]).max()
    for others in displacements[1:]:
        np.testing.assert_allclose(others, displacements[0], rtol=0, atol=SCENES[make] * moved)
    np.testing.assert_allclose(stiffnesses, stiffnesses[0], rtol=SCENES[make])
    np.testing.assert_allclose(energies, energies[0], rtol=SCENES[make])
