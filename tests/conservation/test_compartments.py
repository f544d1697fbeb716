"""Chambers that share a film: rings, the strips that close them, and the flow between them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.core.algebra import numbering
from gossamer_fx.meshes.arrays import mesh_of_arrays
from gossamer_fx.meshes.tube import flat_tube
from gossamer_fx.meshes.tube_section import capped_cylinder

FILM = gx.Miyazaki(E=2.5e9, nu=0.34, density=1420.0, thickness=25e-6, residual_stiffness=1e-6)
NITROGEN = gx.IdealGas(gamma=1.4, R=296.8)


@pytest.mark.parametrize("order", [1, 2])
def test_a_cylinder_without_caps_holds_the_volume_of_its_polygon(order):
    radius = 0.1
    length = 0.5
    sides = 16
    film = gx.Membrane(capped_cylinder(MPI.COMM_WORLD, radius, length, sides, 6), FILM, order=order)
    rims = tuple(gx.gas.Ring(film, name) for name in ("first rim", "last rim"))
    bag = gx.Chamber(
        film,
        gas=NITROGEN,
        pressure=1e3,
        temperature=300.0,
        surface=("wall",),
        rings=rims,
    )
    outlet = gx.Orifice(bag, gx.gas.Ambient(), area=rims[1], discharge_coefficient=0.5)
    # Steps this short leave the volume at its start.
    run = gx.Simulation(gx.Scene(film, bag, outlet), gx.Midpoint(dt=1e-5))
    # Area of a regular polygon with 16 corners on the circle of 0.1 m.
    polygon = sides / 2 * radius**2 * math.sin(2 * math.pi / sides)
    assert pytest.approx(polygon * length, rel=1e-12) == run.chamber("chamber").volume
    assert gx.probes.RingArea(rims[1])(run) == pytest.approx(polygon, rel=1e-12)
    run.run(until=1e-5)
    # Choked flow into vacuum: C A p √(γ/RT) (2/(γ+1))^((γ+1)/(2(γ-1))), with an exponent of 3 at γ
    # = 1.4.
    choked = polygon / 2 * 1e3 / math.sqrt(296.8 * 300.0) * math.sqrt(1.4) * (2 / 2.4) ** 3
    assert run.totals.mass_supplied == pytest.approx(-choked * 1e-5, rel=0.02)


def compartments(order: int = 1, cells: int = 6, law=FILM):
    """A flat tube in space, turning and drifting, inflated from a tank through the first of two
    compartments; and other items."""

    def slightly_open(X):
        lift = 1e-3 * np.sin(np.pi * X[0] / 0.3) * np.cos(np.pi * X[1] / 0.1)
        return np.vstack([0 * lift, 0 * lift, lift])

    film = gx.Membrane(
        flat_tube(MPI.COMM_WORLD, 0.3, 0.06, cells, compartments=2),
        law,
        order=order,
        displacement=slightly_open,
        velocity=lambda X: np.vstack([-3 * X[1], 3 * X[0] + 0.5, 0.2 + 5 * X[1]]),
    )
    ring = gx.gas.Ring(film, "ring 1")
    one, two = (
        gx.Chamber(
            film,
            gas=NITROGEN,
            pressure=10.0,
            temperature=300.0,
            dead_volume=1e-6,
            surface=(f"compartment {i}",),
            rings=(ring,),
            name=f"compartment {i}",
        )
        for i in (1, 2)
    )
    tank = gx.Tank(1e-5, gas=NITROGEN, pressure=1e6, temperature=300.0)
    inlet = gx.Orifice(tank, one, area=1e-6, name="inlet")
    passage = gx.Orifice(one, two, area=ring, discharge_coefficient=0.8, name="passage")
    return gx.Simulation(gx.Scene(film, inlet, passage), gx.Midpoint(dt=1e-4))


@pytest.mark.parametrize("order", [1, 2])
def test_two_compartments_conserve_everything_in_free_flight(order):
    run = compartments(order, cells=6 if order == 1 else 4)
    run.run(until=6e-3 if order == 1 else 3e-3)
    first = run.first
    now = run.totals
    measured = run.chamber("compartment 2").mass
    # Ten times the gas that fills the dead volume at the start.
    limit = 10 * 10.0 * 1e-6 / (296.8 * 300.0)
    assert measured > limit  # gas has passed the ring
    assert abs(run.energy_error) < 1e-9 and abs(run.mass_error) < 1e-13
    error = np.abs(now.momentum - first.momentum).max()
    assert error < 1e-10 * np.abs(first.momentum).max()
    error = np.abs(now.angular_momentum - first.angular_momentum).max()
    assert error < 1e-9 * np.abs(first.angular_momentum).max()


@pytest.mark.mpi(1)
@pytest.mark.parametrize(("order", "block_size"), [(1, 3), (2, 3), (1, 1)])
def test_the_tangent_contains_the_share_of_the_rings(order, block_size, monkeypatch):
    """A δ against a central difference of the forces at held pressures, also of a matrix without
    blocks of three, as that of a reduced film."""
    monkeypatch.setattr(numbering, "_common_block_size", lambda *given: block_size)
    # Soft, so that the pressure loads and their tangent outweigh the stiffness of the film.
    soft = gx.Linear(E=1e3, nu=0.3, density=1420.0, thickness=25e-6)
    system = compartments(order, cells=4, law=soft).system
    assert system.matrices.A.getBlockSize() == block_size
    y = system.equations.begin_step(1e-4)
    system.equations.set_inertia(0.0)
    start, end = system.unknowns.q0.getOwnershipRange()
    direction = np.sin(np.arange(start, end) * 1.7)
    y = np.tile(1e4, len(y))  # pressure loads that outweigh the film
    monkeypatch.setattr(
        system.equations.scalar_unknowns[0], "_solve_at_iterate", lambda y: y
    )  # the gas would not have them

    def forces(step):
        z = system.unknowns.q0.copy()
        r = system.unknowns.q0.duplicate()
        z.array[:] += step * direction
        system.equations.set_end(z)
        system.equations.residual(y, r)
        return r

    # Balances truncation (ε²) and round-off (1e-16/ε) of the central difference.
    ε = 1e-5
    difference = forces(ε)
    difference.axpy(-1.0, forces(-ε))
    forces(0.0)
    δ = system.unknowns.q0.duplicate()
    product = system.unknowns.q0.duplicate()
    δ.array[:] = direction
    system.matrices.tangent().mult(δ, product)
    product.axpy(-1 / (2 * ε), difference)
    assert product.norm() < 1e-8 * difference.norm() / (2 * ε)


def test_a_ring_is_walked_once_for_both_chambers_and_the_orifice(monkeypatch):
    walks = []
    walk = gx.gas.Ring.loop
    monkeypatch.setattr(gx.gas.Ring, "loop", lambda ring: walks.append(ring) or walk(ring))
    compartments(cells=4)
    assert len(walks) == 1


@pytest.mark.parametrize(
    ("group", "words"),
    [
        ("ring 1", "its ring 'ring 1' is not a boundary of its surface"),
        ("tip", "form no closed line"),
    ],
)
def test_a_ring_inside_of_a_surface_and_an_open_line_are_refused(group, words):
    film = gx.Membrane(flat_tube(MPI.COMM_WORLD, 0.3, 0.06, 4, compartments=2), FILM)
    bag = gx.Chamber(
        film,
        gas=NITROGEN,
        pressure=1.0,
        temperature=300.0,
        dead_volume=1e-6,
        rings=(gx.gas.Ring(film, group),),
    )
    with pytest.raises(gx.InputError, match=words):
        gx.Simulation(gx.Scene(film, bag), gx.Midpoint(dt=1e-4))


def test_two_rims_in_one_group_are_no_ring():
    """Of an open cylinder, whose two rims have one name."""

    def cylinder(model):
        wall = model.occ.addCylinder(0, 0, 0, 0, 0, 1, 0.3)
        model.occ.synchronize()
        surfaces = model.getBoundary([(3, wall)], oriented=False)
        sides = [tag for dim, tag in surfaces if model.getType(dim, tag) == "Cylinder"]
        rims = []
        for _, curve in model.getEntities(1):
            if model.getType(1, curve) == "Circle":
                rims.append(curve)
        model.addPhysicalGroup(2, sides, name="wall")
        model.addPhysicalGroup(1, rims, name="rims")
        model.mesh.setSize(model.getEntities(0), 0.2)
        model.mesh.generate(2)

    film = gx.Membrane(gx.gmsh_mesh(cylinder, MPI.COMM_WORLD), FILM)
    with pytest.raises(gx.InputError, match="form several closed lines; make a group of each"):
        gx.gas.Ring(film, "rims").loop()


# ---- chambers that share a wall ------------------------------------------------------------------


def two_boxes() -> gx.Mesh:
    """Boxes of 1 m with a wall between them, whose normal points out of the first one; those of the
    second box point into it."""
    sides = {"first": [], "wall": [(4, 6, 7, 5)], "second": []}
    sides["first"] += [(0, 1, 3, 2), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    sides["second"] += [(8, 9, 11, 10), (4, 5, 9, 8), (6, 10, 11, 7), (4, 8, 10, 6), (5, 7, 11, 9)]
    groups = {
        name: np.array([half for a, b, c, d in squares for half in ((a, b, c), (a, c, d))])
        for name, squares in sides.items()
    }
    points = np.array([(x, y, z) for x in range(3) for y in range(2) for z in range(2)], float)
    triangles = np.concatenate(list(groups.values()))
    # dolfinx 0.9 cannot distribute a mesh where three triangles meet at an edge.
    return mesh_of_arrays(MPI.COMM_SELF, lambda: (points, triangles, groups))


def test_two_chambers_press_on_the_wall_that_they_share():
    """Each has its volume, the wall gains the momentum (p_1 - p_2) A t, and the whole none."""
    film = gx.Membrane(two_boxes(), gx.Linear(1e9, 0.3, density=1e3, thickness=1e-3))
    air = gx.IdealGas(gamma=1.4, R=287.0)
    chambers = [
        gx.Chamber(
            film,
            surface=(name, "wall"),
            gas=air,
            pressure=pressure,
            temperature=300.0,
            name=name,
        )
        for name, pressure in (("first", 1000.0), ("second", 400.0))
    ]
    run = gx.Simulation(gx.Scene(*chambers), gx.Midpoint(dt=1e-7))
    for state in run.chambers.values():
        assert state.volume == pytest.approx(1.0, rel=1e-14)
    system = run.system
    at_wall = abs(system.unknowns.q0.array_r.reshape(-1, 3)[:, 0] - 1) < 1e-9
    run.run(until=1e-7)
    momentum = system.unknowns.v0.duplicate()
    system.unknowns.M.mult(system.unknowns.v0, momentum)
    of_wall = momentum.array_r.reshape(-1, 3)[at_wall, 0].sum()
    assert of_wall == pytest.approx(600.0 * 1e-7, rel=1e-6)
    assert run.totals.momentum == pytest.approx([0, 0, 0], abs=1e-17)
    assert abs(run.energy_error) < 1e-13
