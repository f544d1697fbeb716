"""Normals of meshes that gmsh_mesh and read_mesh turn: neighbours agree, closed surfaces have them
outwards."""

from __future__ import annotations

import math

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI

import gossamer_fx as gx
from tests.small_scenes import WRINKLING

pytestmark = pytest.mark.mpi


def flux(mesh: gx.Mesh, field) -> float:
    """∫ field(x)·n dA over the triangles, with the normals of their nodes' order."""
    domain = mesh.domain
    x = ufl.SpatialCoordinate(domain)
    tangents = ufl.Jacobian(domain)
    normal = ufl.cross(tangents[:, 0], tangents[:, 1])
    normal /= ufl.sqrt(ufl.dot(normal, normal))
    form = fem.form(ufl.dot(field(x), normal) * ufl.dx(domain))
    return float(mesh.comm.allreduce(fem.assemble_scalar(form), MPI.SUM))


def enclosed_volume(mesh: gx.Mesh) -> float:
    return flux(mesh, lambda x: x) / 3


def turn_some(model, share: float) -> None:
    """Turn a share of all triangles inside out, chosen at random."""
    _, tags, _ = model.mesh.getElements(2)
    chosen = np.random.default_rng(7).random(len(tags[0])) < share
    model.mesh.reverseElements(tags[0][chosen])


def two_balls(order: int):
    """Spheres of radius 1 and 0.5 next to each other, half of whose triangles are inside out."""

    def build(model):
        import gmsh

        model.occ.addSphere(5, 0, 0, 1)
        model.occ.addSphere(7, 0, 0, 0.5)
        model.occ.synchronize()
        surfaces = [tag for _, tag in model.getEntities(2)]
        model.addPhysicalGroup(2, surfaces, name="balls")
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.25)
        model.mesh.generate(2)
        model.mesh.setOrder(order)
        turn_some(model, 0.5)

    return build


@pytest.mark.parametrize("order, tolerance", [(1, 0.05), (2, 1e-3)])
def test_normals_of_closed_surfaces_point_outwards(comm, order, tolerance):
    mesh = gx.gmsh_mesh(two_balls(order), comm, orient=True)
    exact = 4 / 3 * math.pi * (1 + 0.5**3)
    assert enclosed_volume(mesh) == pytest.approx(exact, rel=tolerance)


def test_a_chamber_accepts_a_surface_that_was_oriented(comm):
    air = gx.IdealGas(gamma=1.4, R=287.05)
    refused = gx.Membrane(gx.gmsh_mesh(two_balls(1), comm), WRINKLING)
    with pytest.raises(gx.InputError, match=r"opposite normals.*orient=True"):
        gas = gx.Chamber(refused, gas=air, pressure=2e5, temperature=300.0)
        gx.Scene(refused, gas).compile()
    mesh = gx.gmsh_mesh(two_balls(1), comm, orient=True)
    film = gx.Membrane(mesh, WRINKLING)
    gas = gx.Chamber(film, gas=air, pressure=2e5, temperature=300.0)
    blown = gx.Simulation(gx.Scene(film, gas), gx.Midpoint(dt=1e-4))
    assert blown.chamber("chamber").volume == pytest.approx(enclosed_volume(mesh), rel=1e-12)


@pytest.mark.parametrize("share, side", [(0.2, 1.0), (0.8, -1.0)])
def test_an_open_surface_keeps_the_side_of_most_triangles(comm, share, side):
    def square(model):
        model.occ.addRectangle(0, 0, 0, 2, 1)
        model.occ.synchronize()
        model.mesh.setSize(model.getEntities(0), 0.2)
        model.mesh.generate(2)
        turn_some(model, share)

    mesh = gx.gmsh_mesh(square, comm, orient=True)
    upwards = flux(mesh, lambda x: ufl.as_vector((0, 0, 1)))
    assert upwards == pytest.approx(2.0 * side, rel=1e-12)


@pytest.mark.parametrize("share", [0.2, 0.8])
def test_the_enclosed_volume_of_a_tube_with_open_ends(comm, share):
    """A prism of n sides: its flat ends are spanned, and its normals point outwards."""
    n = 12
    radius = 0.2
    length = 5.0

    def tube(model):
        corners = []
        for angle in np.linspace(0, 2 * math.pi, n, endpoint=False):
            corners.append(
                model.geo.addPoint(3 + radius * math.cos(angle), radius * math.sin(angle), -7)
            )
        for i in range(n):
            side = model.geo.addLine(corners[i], corners[(i + 1) % n])
            model.geo.extrude([(1, side)], 0, 0, length)
        model.geo.synchronize()
        model.mesh.setSize(model.getEntities(0), 0.4)
        model.mesh.generate(2)
        model.mesh.removeDuplicateNodes()
        turn_some(model, share)

    mesh = gx.gmsh_mesh(tube, comm, orient=True)
    section = n / 2 * radius**2 * math.sin(2 * math.pi / n)
    assert mesh.enclosed_volume() == pytest.approx(section * length, rel=1e-12)


def test_curved_triangles_enclose_what_they_bulge_by(comm):
    from gossamer_fx.meshes.sphere import sphere
    from gossamer_fx.meshes.tube_section import cylinder

    ball = sphere(comm, 1.0, 8, 2)
    # The flat triangles of its corners enclose 3.43 m³, the ball 4.19.
    assert ball.enclosed_volume() == pytest.approx(flux(ball, lambda x: x / 3), rel=1e-12)
    assert ball.enclosed_volume() == pytest.approx(4 / 3 * math.pi, rel=6e-3)
    # Its open ends are spanned.
    tube = cylinder(comm, 0.5, 2.0, 12, 4, order=2)
    assert abs(tube.enclosed_volume()) == pytest.approx(math.pi / 2, rel=1e-3)


def test_a_line_mesh_encloses_nothing(comm):
    from gossamer_fx.meshes.line import line

    with pytest.raises(gx.InputError, match="line elements; give one of triangles"):
        line(comm, [(0, 0, 0), (1, 0, 0)], 3).enclosed_volume()


def test_a_file_is_oriented_and_keeps_its_groups(comm, folder):
    path = folder / "balls.msh"

    def write(model):
        import gmsh

        two_balls(1)(model)
        gmsh.write(str(path))

    written = gx.gmsh_mesh(write, comm, orient=True)
    comm.barrier()
    read = gx.read_mesh(path, comm, orient=True)
    assert enclosed_volume(read) == pytest.approx(enclosed_volume(written), rel=1e-12)
    dim, cells = read.group("balls")
    owned = int((cells < read.domain.topology.index_map(2).size_local).sum())
    assert dim == 2
    assert comm.allreduce(owned) == read.cells


def test_a_moebius_strip_is_refused(comm):
    n = 12

    def strip(model):
        points = []
        for angle in np.linspace(0, 2 * math.pi, n, endpoint=False):
            for width in (-0.3, 0.3):
                radius = 1 + width * math.cos(angle / 2)
                height = width * math.sin(angle / 2)
                points.append((radius * math.cos(angle), radius * math.sin(angle), height))
        cells = []
        for i in range(n):
            lower = 2 * i
            upper = 2 * i + 1
            next_lower = 2 * i + 2
            next_upper = 2 * i + 3
            if i == n - 1:
                # Half a turn: the strip's lower edge continues in its upper one.
                next_lower = 1
                next_upper = 0
            cells += [(lower, next_lower, next_upper), (lower, next_upper, upper)]
        surface = model.addDiscreteEntity(2)
        model.mesh.addNodes(2, surface, [], np.ravel(points))
        model.mesh.addElementsByType(surface, 2, [], np.ravel(cells) + 1)

    with pytest.raises(gx.InputError, match="one side only"):
        gx.gmsh_mesh(strip, comm, orient=True)
