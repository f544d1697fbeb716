"""Gradients by the stress-free shape of a film, with each item that may lie on it: as differences
of scenes that are made again, or refused."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet

LAW = gx.Linear(E=1e7, nu=0.3, density=1e3, thickness=1e-4)
STEP = 1e-4


def moves(X):
    """A direction in which all nodes move, those of the edges along them."""
    along = 0.1 * np.sin(2 * np.pi * X[:, 0])
    across = (X[:, 1] - 0.5) * 0.2 * np.sin(np.pi * X[:, 0])
    return np.stack([along, across, 0 * X[:, 0]], axis=1)


def middle(film):
    x = film.space.tabulate_dof_coordinates()
    return gx.Port(film, (int(np.argmin(np.linalg.norm(x - [0.5, 0.5, 0.0], axis=1))),))


def tape(film, comm):
    return [
        gx.connectors.Tape.along_edges(
            film, gx.TensionOnly(EA=2e3, line_density=1e-3), edges="top", length_factor=0.995
        )
    ]


def tie(film, comm):
    at = [(0.2, 1.0, 0.0), (0.8, 1.0, 0.0)]
    cable = gx.Cable(line(comm, at, 4), gx.CableLaw(1e3, 1e-3), name="cord")
    return [gx.Tie(cable, film, group_b="top")]


def rigid_region(film, comm):
    return [gx.RigidRegion(film, "right")]


def spring(film, comm):
    anchor = gx.Ground((0.5, 0.5, 1.0))
    return [gx.connectors.Spring(middle(film), anchor, stiffness=20.0, length=0.9)]


def force(film, comm):
    return [gx.loads.Force(middle(film), (0.0, 0.1, 0.3))]


def edge_load(film, comm):
    return [gx.loads.EdgeLoad(film, "top", force=(0.0, 5.0, 0.0))]


def drag(film, comm):
    return [gx.loads.AirDrag(film, 1.2, drag_coefficient=1.1, wind=(0.0, 0.0, 5.0))]


def gravity(film, comm):
    return [gx.Gravity(film)]


# Whether a result with the item has a derivative by the shape.
ITEMS = {
    tape: False,
    tie: False,
    rigid_region: False,
    spring: True,
    force: True,
    edge_load: True,
    drag: True,
    gravity: True,
}


def bulged(comm, make, h):
    """A film under a pressure with an item, on a mesh whose nodes were moved by h."""
    film = gx.Membrane(sheet(comm, 4, 4, crossed=True), LAW, name="film")
    x = film.space.mesh.geometry.x
    x[:] += h * moves(x)
    held = [gx.Fixed(film, "left")]
    if make is not rigid_region:
        held.append(gx.Fixed(film, "right"))
    scene = gx.Scene(film, *held, gx.Pressure(film, 20.0), *make(film, comm))
    return gx.Equilibrium(scene), film


@pytest.mark.parametrize("make", ITEMS)
def test_each_item_on_a_film_with_its_shape(make):
    comm = MPI.COMM_SELF
    equilibrium, film = bulged(comm, make, 0.0)
    height = gx.probes.Position(middle(film), "z")
    if not ITEMS[make]:
        with pytest.raises(gx.InputError, match=r"measured on the mesh when .* by 'film.shape'"):
            gx.analysis.gradient(equilibrium, of=height, by=["film.shape"])
        return
    equilibrium.find()
    derivative = gx.analysis.gradient(equilibrium, of=height, by=["film.shape"])["film.shape"]
    X = film.space.tabulate_dof_coordinates()
    found = float((derivative.values.reshape(-1, 3) * moves(X)).sum())
    ends = []
    for h in (STEP, -STEP):
        moved, other = bulged(comm, make, h)
        moved.find()
        ends.append(gx.probes.Position(middle(other), "z")(moved))
    assert found == pytest.approx((ends[0] - ends[1]) / (2 * STEP), rel=1e-4)
