"""Ports at nodes: those of a group, the one that is nearest, and a force on each."""

from __future__ import annotations

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.core.mesh.quality import corner_points
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.meshes.sphere import sphere
from tests.small_scenes import LINEAR, at_rest


@pytest.mark.mpi
def test_a_port_snaps_to_the_nearest_node(comm) -> None:
    film = gx.Membrane(sheet(comm, 4, 4), LINEAR)
    state = gx.Scene(film).compile().unknowns.state
    with pytest.raises(gx.InputError, match=r"is 0\.2 m away from 'film'.*snap=True"):
        film.port_at((0.3, 0.6, 0.2))
    near = film.port_at((0.3, 0.6, 0.2), snap=True)
    np.testing.assert_allclose(state.vector(near), (0.25, 0.5, 0), atol=1e-12)
    # The middle of a cell is as far from four nodes: the first by x, then by y, on any ranks.
    middle = film.port_at((0.375, 0.375, 0.0), snap=True)
    np.testing.assert_allclose(state.vector(middle), (0.25, 0.25, 0), atol=1e-12)


@pytest.mark.mpi
@pytest.mark.parametrize("size", [1e-3, 1e3])
def test_a_port_is_on_the_mesh_to_a_millionth_of_its_size(comm, size) -> None:
    film = gx.Membrane(sheet(comm, 4, 4, size, size), LINEAR)
    port = film.port_at((0.3 * size, 0.6 * size, 1e-7 * size))
    x = gx.Scene(film).compile().unknowns.state.vector(port)
    np.testing.assert_allclose(x, (0.3 * size, 0.6 * size, 0), atol=1e-12 * size)
    with pytest.raises(gx.InputError, match="away from 'film'"):
        film.port_at((0.3 * size, 0.6 * size, 1e-5 * size))


@pytest.mark.mpi
@pytest.mark.parametrize("order", [1, 2])
def test_a_port_is_on_the_nearest_cell(comm, order) -> None:
    """Of points in cells, on edges and at nodes; also after the mesh was moved."""
    mesh = sphere(comm, 1.0, 8, order=order)
    film = gx.Membrane(mesh, LINEAR, order=order)
    rng = np.random.default_rng(1)
    for shift in (0.0, 5.0):
        mesh.domain.geometry.x[:] += shift
        corners = comm.bcast(corner_points(mesh.domain))
        for cell in rng.integers(len(corners), size=5):
            for weights in ((1.0, 0.0, 0.0), (0.5, 0.5, 0.0), (0.2, 0.3, 0.5)):
                x = np.asarray(weights) @ corners[cell]
                # Within a curved cell the chord is not on the mesh, but its corner is.
                if order == 2 and weights[0] < 1:
                    continue
                port = film.port_at(x)
                np.testing.assert_allclose(port.initial() + shift, x, atol=1e-9)
                assert len(port.nodes) == np.count_nonzero(weights)


@pytest.mark.mpi(1)
@pytest.mark.parametrize("in_time", [False, True])
def test_a_force_on_each_node_of_a_group_is_that_on_its_ports(comm, in_time) -> None:
    """A bar that is pulled at its two last nodes, with the elongations of a chain: N/(E A) each."""
    cable = gx.Cable(line(comm, [(0, 0, 0), (1, 0, 0), (2, 0, 0)], 1), gx.CableLaw(1e6, 0.01))
    asked = []

    def pull(t: float) -> tuple[float, float, float]:
        asked.append(t)
        return (0.5, 0.0, 0.0)

    ends = [cable.port("point 1"), cable.port("point 2")]
    load = gx.loads.Force(ends, pull if in_time else (0.5, 0.0, 0.0))
    scene = at_rest(cable, gx.Fixed(cable, "start"), load)
    moved = [gx.probes.Displacement(end, "x")(scene) for end in ends]
    # 1 N in the first half and 0.5 N in the second one.
    np.testing.assert_allclose(moved, [1e-6, 1.5e-6], rtol=1e-5)
    # The function of the user is asked once a step, not once a node.
    assert len(asked) == len(set(asked))


@pytest.mark.mpi
def test_ports_of_a_group_are_all_its_nodes(comm) -> None:
    film = gx.Membrane(sheet(comm, 4, 4), LINEAR, order=2)
    ports = film.ports("top")
    x = gx.Scene(film).compile().unknowns.state.vectors(ports)
    np.testing.assert_allclose(np.sort(x[:, 0]), np.arange(9) / 8, atol=1e-12)
    np.testing.assert_allclose(x[:, 1:], [[1, 0]] * 9, atol=1e-12)
    # The gradient by the force is that of all of them: the sum of the displacements.
    load = gx.loads.Force(ports, (0.0, 1.0, 0.0))
    scene = at_rest(film, gx.Fixed(film, "bottom"), gx.Fixed(film, "film", components=(2,)), load)
    corner = gx.probes.Position(film.port("top left"), "y")
    (derivative,) = gx.analysis.gradient(scene, of=corner, by=["force.force"]).derivatives
    moved = gx.probes.Displacement(film.port("top left"), "y")(scene)
    assert derivative.values[1] == pytest.approx(moved, rel=1e-3)
    with pytest.raises(gx.InputError, match=r"port is \[\]"):
        gx.loads.Force([], (0.0, 0.0, 1.0))


@pytest.mark.mpi
def test_a_single_step_is_a_run_until_its_end(comm) -> None:
    mass = gx.PointMass(1.0, velocity=(1.0, 0.0, 0.0), comm=comm)
    run = gx.Simulation(gx.Scene(mass), gx.Midpoint(dt=0.1))
    for step in (1, 2, 3):
        run.run(until=run.time + run.stepper.dt)
        assert run.step == step
    assert gx.probes.Position(mass.port(), "x")(run) == pytest.approx(0.3, rel=1e-12)
