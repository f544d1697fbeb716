"""Plates whose stress-free shape is a curved mesh: no energy and no force there, and linear shells
of the literature."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from demos.studies import shells
from gossamer_fx.meshes.sheet import EDGES, sheet
from tests.small_scenes import at_rest

LAW = gx.Linear(E=1e9, nu=0.3, density=1000.0, thickness=1e-2)


def dome(comm: MPI.Intracomm, cells: int, **given) -> gx.Plate:
    """A plate on a saddle in one part and a bowl in the other, without symmetry."""
    mesh = sheet(comm, cells, cells, 1.0, 1.0, crossed=True, order=2)
    x, y, _ = mesh.domain.geometry.x.T
    mesh.domain.geometry.x[:, 2] = 0.3 * x**2 * y + 0.2 * y**2 - 0.1 * x**3
    return gx.Plate(mesh, LAW, **given)


def stored_forces(plate: gx.Plate) -> float:
    forces = gx.Scene(plate).compile().equations.stored_forces().array_r
    return plate.comm.allreduce(float(np.abs(forces).max(initial=0.0)), op=MPI.MAX)


@pytest.mark.mpi(1)
def test_a_curved_mesh_has_no_energy_and_no_forces_wherever_it_is_turned(comm):
    Q, _ = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))
    forces = []
    for cells in (4, 8):
        plate = dome(comm, cells)
        turned = gx.Scene(plate).compile()
        positions = turned.unknowns.q0.array_w.reshape(-1, 3)
        positions[:] = positions @ Q.T
        turned.restart()
        energy = sum(turned.balance.totals().stored.values())
        flat = LAW.E * LAW.thickness**3 / 12 / 0.91
        # Its bending energy if it were flat without stress is some 0.2 D; the remainder is of third
        # order in the kinks between cells.
        assert abs(energy) < 1e-7 * flat
        forces.append(stored_forces(plate) / flat)
    # Of second order in the kinks between cells, whose angles are of second order.
    assert forces[1] < forces[0] / 4 and forces[1] < 1e-3


@pytest.mark.mpi(1)
@pytest.mark.parametrize(
    ("shell", "error"), [("roof", 0.02), ("cylinder", 0.1), ("hemisphere", 0.09)]
)
def test_shells_bend_as_the_literature_says(comm, shell, error):
    # Errors of 8 cells on a side; the study shows their convergence to less than a percent.
    assert shells.problem(comm, shell, 8)["deflection/tabled"] == pytest.approx(1, abs=error)


def test_a_symmetric_edge_may_be_given_in_either_direction():
    """A cylindrical strip, whose moments at rest bend along the clamped edge, too."""
    rises = []
    for sign in (-1.0, 1.0):
        plate = gx.Plate(
            sheet(MPI.COMM_WORLD, 6, 3, 0.3, 0.1),
            LAW,
            rest_curvature=np.diag((0.0, 1.0, 0.0)),
        )
        clamp = gx.Fixed(plate, "left", rotation=True, direction=(sign, 0.0, 0.0))
        equilibrium = at_rest(plate, clamp)
        rises.append(equilibrium.system.unknowns.q0.array_r[2::3].max())
    assert rises[1] == pytest.approx(rises[0], rel=1e-6)


def test_a_coarse_curved_mesh_is_refused():
    mesh = sheet(MPI.COMM_WORLD, 2, 2, 1.0, 1.0, order=2)
    x = mesh.domain.geometry.x
    x[:, 2] = -4 * (x[:, 0] - 0.5) ** 2
    with pytest.raises(gx.InputError, match="more than 45 degrees; use smaller cells"):
        gx.Plate(mesh, LAW)


def graded(u, power):
    """Map of [0, 1] whose cells get smaller towards both ends."""
    return np.where(u < 0.5, 0.5 * (2 * u) ** power, 1 - 0.5 * (2 * (1 - u)) ** power)


@pytest.mark.mpi
@pytest.mark.parametrize("power", [1.15, 1.6])
def test_the_middle_nodes_of_a_flat_plate_may_lie_anywhere_on_its_edges(comm, power):
    """A mesh that is graded with all its nodes bends as one whose middle nodes are in the
    middle."""
    cells = 8
    deflections = []
    for is_centred in (False, True):
        mesh = sheet(comm, cells, cells, crossed=True, order=2)
        x = mesh.domain.geometry.x
        for axis in (0, 1):
            if is_centred:
                # Vertices are at whole numbers of half cells, middles between two of them.
                u = np.rint(4 * cells * x[:, axis]) / 2
                low, high = np.floor(u), np.ceil(u)
                ends = [graded(end / (2 * cells), power) for end in (low, high)]
                x[:, axis] = (ends[0] + ends[1]) / 2
            else:
                x[:, axis] = graded(x[:, axis], power)
        plate = gx.Plate(mesh, gx.Linear(7e10, 0.3, density=2700.0, thickness=1e-3))
        rim = [gx.Fixed(plate, edge, rotation=True) for edge in EDGES]
        equilibrium = at_rest(gx.Pressure(plate, 1.0), *rim)
        own = float(gx.fields.positions(equilibrium, plate)[:, 2].max(initial=0.0))
        deflections.append(comm.allreduce(own, max))
    assert deflections[0] > 1e-7
    assert deflections[0] == pytest.approx(deflections[1], rel=1e-4)


@pytest.mark.parametrize(
    ("move", "words"),
    [
        ((0.0, 0.0, 0.3), r"middle node of an edge of the triangle at \(.*\) is 0.3 m from"),
        ((0.0, 0.0, 1e6), "is 1e[+]06 m from the middle of the edge"),
        ((0.15, 0.0, 0.0), "turn inside out|is 0.15 m from the middle"),
        ((5.0, 0.0, 0.0), "turn inside out"),
    ],
)
def test_a_middle_node_far_from_its_edge_is_refused(comm, move, words):
    mesh = sheet(comm, 2, 2, order=2)
    x = mesh.domain.geometry.x
    # The middle of an edge of half a metre.
    node = np.linalg.norm(x - [0.25, 0.5, 0.0], axis=1) < 1e-9
    x[node] += np.array(move)
    with pytest.raises(gx.InputError, match=words):
        gx.Plate(mesh, gx.Linear(7e10, 0.3, density=2700.0, thickness=1e-3))
