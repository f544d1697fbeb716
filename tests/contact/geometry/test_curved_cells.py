"""Contact of cells of order 2: it acts on points of the curved surface, in flat pieces."""

from __future__ import annotations

import basix
import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.mechanics.contact.geometry.facets import CellLattice
from gossamer_fx.meshes.sphere import sphere
from tests.contact.scenes import contact_set_of, film, simulate

DISTANCE = 1e-3  # m, at which contact of the ball begins


@pytest.mark.parametrize(("dimension", "dofs", "pieces"), [(1, 3, 2), (2, 6, 4), (2, 6, 8)])
def test_areas_of_points_integrate_the_shape_functions(dimension, dofs, pieces) -> None:
    """So contact carries a uniform load as the nodes do.  All areas are above zero: each point
    touches."""
    lattice = CellLattice.of(dimension, dofs, pieces)
    assert len(lattice.pieces) == pieces**dimension
    pieces_at = np.bincount(lattice.pieces.ravel(), minlength=len(lattice.corners))
    area = lattice.area_factors * pieces_at / lattice.pieces.size
    on_nodes = np.bincount(lattice.nodes.ravel(), (lattice.weights * area[:, None]).ravel())
    # ∫ N over the size of the cell, closed forms.
    expected = [1 / 6, 1 / 6, 4 / 6] if dimension == 1 else [0, 0, 0, 1 / 3, 1 / 3, 1 / 3]
    assert on_nodes == pytest.approx(expected, abs=1e-14)
    assert area.min() > 0


def ball_on_floor(comm, cells: int) -> tuple[gx.Simulation, float]:
    """A ball of 0.1 m with gas falls on a floor at z = 0; returns the run to about the deepest
    point, and the lowest point of its curved surface [m] of all steps."""
    ball = gx.Membrane(
        sphere(comm, 0.1, cells, order=2),
        gx.Miyazaki(E=1e9, nu=0.3, density=1400.0, thickness=2e-5),
        order=2,
        displacement=lambda X: np.vstack([0 * X[0], 0 * X[0], 0 * X[0] + 0.101]),
        velocity=lambda X: np.vstack([0 * X[0], 0 * X[0], 0 * X[0] - 2.0]),
        name="ball",
    )
    gas = gx.IdealGas(gamma=1.4, R=287.0)
    floor = gx.contact.Plane(point=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0))
    contact = gx.Contact(ball, floor, distance=DISTANCE)
    scene = gx.Scene(contact, gx.Chamber(ball, gas=gas, pressure=2e3, temperature=293.0))
    run = gx.Simulation(scene, gx.Midpoint(dt=1e-4))
    element = basix.create_element(basix.ElementFamily.P, basix.CellType.triangle, 2)
    lattice = basix.create_lattice(basix.CellType.triangle, 9, basix.LatticeType.equispaced, True)
    shape = element.tabulate(0, lattice)[0, :, :, 0]
    lowest = np.inf
    for step in range(1, 21):
        run.run(until=step * 1e-4)
        z = run.system.unknowns.state[ball].function().x.array[2::3]
        lowest = min(lowest, float((z[ball.space.dofmap.list] @ shape.T).min()))
    return run, comm.allreduce(lowest, op=MPI.MIN)


@pytest.mark.mpi(1)
def test_the_curved_surface_of_a_ball_stays_above_the_floor(comm, caplog) -> None:
    run, lowest = ball_on_floor(comm, 12)
    assert contact_set_of(run).closest < 0.9 * DISTANCE
    # Of the gap that contact keeps, half remains over the bulge of the surface.
    assert lowest > 0.3 * contact_set_of(run).closest
    assert abs(run.energy_error) < 1e-12
    assert "from the flat pieces as which it touches" not in caplog.text


def test_a_surface_that_is_too_curved_for_its_pieces_is_warned_of(caplog) -> None:
    ball_on_floor(MPI.COMM_SELF, 6)
    assert "'ball', 'obstacle': where it presses, a curved surface of order 2 is" in caplog.text


@pytest.mark.mpi(1)
def test_films_of_both_orders_are_tied_and_touch(comm) -> None:
    """Points between tied nodes are connected, too; the table of points has those of both."""
    films = [
        film(comm, 2, order=2, name="left"),
        film(comm, 2, order=2, at=(0.1, 0.0), name="right"),
        film(comm, 4, height=1.5e-3, velocity=(0, 0, -2.0), at=(0.05, 0.01), name="upper"),
    ]
    contact = gx.Contact(*films, distance=1e-3)
    seam = gx.Tie(films[0], films[1], group_a="right", group_b="left")
    run = simulate([contact, seam], 1e-3)
    assert contact_set_of(run).closest < 1e-3
    assert abs(run.energy_error) < 1e-12
    assert gx.probes.Penetrations(contact)(run) == 0
