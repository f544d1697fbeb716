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


def other_film(comm, gap=0.0):
    """A film beyond the edge "top" of the first one, on a separate mesh."""
    return gx.Membrane(
        sheet(comm, 3, 3, 1.0, 0.5),
        LAW,
        name="other",
        displacement=lambda X: np.stack([0 * X[0], 0 * X[0] + 1.0 + gap, 0 * X[0]]),
    )


def tied_film(film, comm):
    other = other_film(comm)
    return [gx.Fixed(other, "top"), gx.Tie(film, other, group_a="top", group_b="bottom")]


def seam(film, comm):
    other = other_film(comm)
    return [gx.Fixed(other, "top"), gx.Seam(film, "top", other, "bottom", closing=None)]


def closing_seam(film, comm):
    other = other_film(comm, gap=0.02)
    return [gx.Fixed(other, "top"), gx.Seam(film, "top", other, "bottom")]


def contact(film, comm):
    ceiling = gx.contact.Plane(point=(0.0, 0.0, 0.02), normal=(0.0, 0.0, -1.0))
    return [gx.Contact(film, ceiling, distance=5e-3, stiffness=1e5)]


# Whether a result with the item has a derivative by the shape.
ITEMS = {
    tape: False,
    tie: False,
    tied_film: False,
    seam: False,
    closing_seam: False,
    rigid_region: False,
    contact: False,
    spring: True,
    force: True,
    edge_load: True,
    drag: True,
    gravity: True,
}
REFUSAL = r"measured on the mesh when .* by 'film.shape'"


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
        with pytest.raises(gx.InputError, match=REFUSAL):
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


@pytest.mark.parametrize("make", [tied_film, seam, closing_seam])
def test_what_joins_two_films_measures_the_mesh_of_both(make):
    comm = MPI.COMM_SELF
    equilibrium, film = bulged(comm, make, 0.0)
    height = gx.probes.Position(middle(film), "z")
    with pytest.raises(gx.InputError, match=r"measured on the mesh when .* by 'other.shape'"):
        gx.analysis.gradient(equilibrium, of=height, by=["other.shape"])


@pytest.mark.mpi
@pytest.mark.parametrize("way", ["seam", "tie", "tape"])
def test_what_is_joined_node_to_node_stays_so(comm, way):
    """Derivatives by the nodes of a seam, of panels that are sewn or tied node to node, and with a
    tape of given lengths: as differences of the scene whose nodes are moved."""
    film = gx.Membrane(sheet(comm, 4, 4, crossed=True), LAW, name="film")
    other = gx.Membrane(
        sheet(comm, 4, 2, 1.0, 0.5),
        LAW,
        name="other",
        displacement=lambda X: np.stack([0 * X[0], 0 * X[0] + 1.0, 0 * X[0]]),
    )
    items = [gx.Fixed(film, "left"), gx.Fixed(film, "right"), gx.Pressure(film, 20.0)]
    if way == "tape":
        cord = gx.TensionOnly(EA=2e3, line_density=1e-3)
        measured = gx.connectors.Tape.along_edges(film, cord, edges="top", length_factor=0.995)
        tape = gx.connectors.Tape(film, cord, bars=measured.bars, lengths=measured.lengths)
        items.append(tape)
    else:
        items.append(gx.Fixed(other, "top"))
        if way == "seam":
            items.append(gx.Seam(film, "top", other, "bottom", closing=None))
        else:
            items.append(gx.Tie(film, other, group_a="top", group_b="bottom"))
    equilibrium = gx.Equilibrium(gx.Scene(*items))
    equilibrium.find()
    height = gx.probes.Position(film.port_at((0.5, 0.5, 0.0)), "z")
    derivative = gx.analysis.gradient(equilibrium, of=height, by=["film.shape"])["film.shape"]
    nodes = film.space.tabulate_dof_coordinates()[: len(derivative.values) // 3]
    own = float((derivative.values.reshape(-1, 3) * moves(nodes)).sum())
    found = comm.allreduce(own)
    x = film.space.mesh.geometry.x
    X = x.copy()
    ends = []
    for h in (STEP, -STEP):
        x[:] = X + h * moves(X)
        equilibrium.system.parameters_changed()
        equilibrium.find()
        ends.append(height(equilibrium))
    x[:] = X
    assert found == pytest.approx((ends[0] - ends[1]) / (2 * STEP), rel=1e-4)


def test_a_cable_on_a_film_is_measured_by_the_tie(comm):
    equilibrium, film = bulged(comm, tie, 0.0)
    height = gx.probes.Position(middle(film), "z")
    with pytest.raises(gx.InputError, match=r"measured on the mesh when .* by 'cord.shape'"):
        gx.analysis.gradient(equilibrium, of=height, by=["cord.shape"])


def prestressed(comm):
    return gx.Membrane(sheet(comm, 4, 4, crossed=True), LAW, initial_stress=1e5, name="film")


def heated(comm):
    def warm(X, t):
        return 293.15 + 100 * X[0]

    thermal = gx.materials.ThermalExpansion(2e-5, warm)
    return gx.Membrane(sheet(comm, 4, 4, crossed=True), LAW, thermal=thermal, name="film")


def fabric(comm):
    law = gx.Orthotropic(
        E1=1e7, E2=5e6, nu12=0.3, G12=2e6, density=1e3, thickness=1e-4, direction=(1.0, 0.3, 0.0)
    )
    return gx.Membrane(sheet(comm, 4, 4, crossed=True), law, name="film")


@pytest.mark.parametrize("make", [prestressed, fabric, heated])
def test_each_film_with_its_shape(make):
    def at_rest(h):
        film = make(MPI.COMM_SELF)
        film.space.mesh.geometry.x[:] += h * moves(film.space.mesh.geometry.x)
        held = [gx.Fixed(film, "left"), gx.Fixed(film, "right")]
        equilibrium = gx.Equilibrium(gx.Scene(film, *held, gx.Pressure(film, 20.0)))
        equilibrium.find()
        return equilibrium, film

    equilibrium, film = at_rest(0.0)
    height = gx.probes.Position(middle(film), "z")
    derivative = gx.analysis.gradient(equilibrium, of=height, by=["film.shape"])["film.shape"]
    X = film.space.tabulate_dof_coordinates()
    found = float((derivative.values.reshape(-1, 3) * moves(X)).sum())
    ends = []
    for h in (STEP, -STEP):
        moved, other = at_rest(h)
        ends.append(gx.probes.Position(middle(other), "z")(moved))
    assert found == pytest.approx((ends[0] - ends[1]) / (2 * STEP), rel=1e-4)


@pytest.mark.parametrize("order", [1, 2])
def test_a_plate_has_no_derivative_by_its_shape(comm, order):
    """It was wrong by up to half of the energy, and by the sign of deflections."""
    law = gx.Linear(E=1e9, nu=0.3, density=1e3, thickness=1e-3)
    plate = gx.Plate(sheet(comm, 2, 2, crossed=True, order=order), law, name="film")
    held = [gx.Fixed(plate, "left", rotation=True), gx.Fixed(plate, "right", rotation=True)]
    equilibrium = gx.Equilibrium(gx.Scene(plate, *held, gx.Pressure(plate, 2.0)))
    equilibrium.find()
    with pytest.raises(gx.InputError, match=r"plate 'film' has no derivative|has no gradient"):
        gx.analysis.gradient(equilibrium, of=gx.analysis.Energy(), by=["film.shape"])
