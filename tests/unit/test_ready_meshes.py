"""Ready meshes: closed ones have the volume of their shape up to second order, normals point
outwards, groups are complete, triangles are well shaped; on any number of ranks."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.core.forms.compilation import constant
from gossamer_fx.core.mesh.enclosed_volume import enclosed_by
from gossamer_fx.core.mesh.quality import corner_points, shape_quality, sizes
from gossamer_fx.meshes.arc_polygon import arc_polygon, arc_radius
from gossamer_fx.meshes.arrays import mesh_of_arrays
from gossamer_fx.meshes.plates import free_slit_ring, slit_ring
from gossamer_fx.meshes.revolved import balloon, bulkhead_tube, dish, hull, torus, whole_disc
from gossamer_fx.meshes.sphere import sphere
from tests.small_scenes import LINEAR, WRINKLING, at_rest

# Closed shapes by the number of cells, and their volumes [m³].
CLOSED: dict[str, tuple[Callable[[MPI.Comm, int], gx.Mesh], float]] = {
    "torus": (
        lambda comm, n: torus(comm, 1.0, 0.3, 12 * n, 4 * n),
        2 * math.pi**2 * 0.3**2,
    ),
    "hull": (
        lambda comm, n: hull(comm, 0.5, 2.0, 2 * n),
        math.pi * 0.25 * 2.0 + 4 / 3 * math.pi * 0.125,
    ),
    "hull with flat domes": (
        lambda comm, n: hull(comm, 0.5, 1.0, 2 * n, cap_height=0.25),
        math.pi * 0.25 * 1.0 + 4 / 3 * math.pi * 0.25 * 0.25,
    ),
    "balloon": (lambda comm, n: balloon(comm, 2.0, 12, n), 4 / 3 * math.pi * 8.0),
    "flat balloon": (
        lambda comm, n: balloon(comm, 2.0, 8, 2 * n, height=2.0),
        4 / 3 * math.pi * 4.0,
    ),
    "tube with bulkheads": (
        lambda comm, n: bulkhead_tube(comm, 0.2, 1.0, 2 * n, 3).wall,
        math.pi * 0.04,
    ),
}

GROUPS = {
    "torus": {"film", "outer", "top", "inner", "bottom"},
    "hull": {"film", "wall"}
    | {f"{end} {part}" for end in ("first", "last") for part in ("cap", "rim", "pole")},
    "balloon": {"film", "equator", "south pole", "north pole"}
    | {f"{part} {k}" for part in ("gore", "seam") for k in range(1, 13)},
    "tube with bulkheads": {"film", "first cap", "last cap", "first rim", "last rim"}
    | {"compartment 1", "compartment 2", "compartment 3", "ring 1", "ring 2"},
}


def area(mesh: gx.Mesh, group: str = "film") -> float:
    """Area [m²] of a group of triangles on all ranks."""
    _, cells = mesh.group(group)
    owned = sizes(corner_points(mesh.domain))
    return float(mesh.domain.comm.allreduce(owned[cells[cells < len(owned)]].sum()))


def length(mesh: gx.Mesh, group: str) -> float:
    """Length [m] of a group of edges, as a cable along it has it."""
    film = gx.Membrane(mesh, LINEAR)
    x = gx.Scene(film).compile().unknowns.state.vectors(film.ports(group))
    # Nodes of a ring about an axis, in the order of their angles.
    away = x - x.mean(axis=0)
    _, _, axes = np.linalg.svd(away)
    order = np.argsort(np.arctan2(away @ axes[1], away @ axes[0]))
    return float(np.linalg.norm(np.roll(x[order], -1, axis=0) - x[order], axis=1).sum())


@pytest.mark.mpi(1)
@pytest.mark.parametrize("name", CLOSED)
def test_a_closed_mesh_has_the_volume_of_its_shape(comm, name) -> None:
    make, exact = CLOSED[name]
    errors = []
    for n in (2, 4):
        mesh = make(comm, n)
        enclosed = enclosed_by(mesh.domain, mesh.edges)
        assert enclosed.rims == 0
        # Positive: the normals point outwards.
        errors.append(1 - enclosed.volume / exact)
    assert 0 < errors[1] < 0.05
    assert math.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.3)


SQUARE = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))
# Of arcs that turn by a quarter of π.
SAG = math.tan(math.pi / 16) / 2

# Curved shapes by the number of cells, and their areas [m²].
CURVED: dict[str, tuple[Callable[[MPI.Comm, int], gx.Mesh], float]] = {
    "torus": (
        lambda comm, n: torus(comm, 1.0, 0.3, 12 * n, 4 * n, order=2),
        4 * math.pi**2 * 0.3,
    ),
    "hull": (
        lambda comm, n: hull(comm, 0.5, 2.0, 2 * n, order=2),
        2 * math.pi * 0.5 * 2.0 + 4 * math.pi * 0.25,
    ),
    "balloon": (lambda comm, n: balloon(comm, 2.0, 12, n, order=2), 16 * math.pi),
    "tube with bulkheads": (
        lambda comm, n: bulkhead_tube(comm, 0.2, 1.0, 2 * n, 3, order=2).wall,
        2 * math.pi * 0.2 + 2 * math.pi * 0.04,
    ),
    "disc": (lambda comm, n: whole_disc(comm, n, 2.0, order=2), 4 * math.pi),
    "dish": (
        lambda comm, n: dish(comm, 1.0, 0.5, 2 * n, order=2),
        2 * math.pi / 3 * (2**1.5 - 1),
    ),
    "slit ring": (
        lambda comm, n: slit_ring(comm, n, 6 * n, 0.5, 1.0, order=2),
        0.75 * math.pi,
    ),
    "free slit ring": (
        lambda comm, n: free_slit_ring(comm, 0.5 / n, 0.5, 1.0, order=2),
        0.75 * math.pi,
    ),
    # A square of 1 m less four segments of circles of a quarter of π.
    "square with arcs": (
        lambda comm, n: arc_polygon(comm, SQUARE, SAG, 0.4 / n, order=2),
        1 - 4 * (math.pi / 4 - math.sin(math.pi / 4)) / 2 * arc_radius(1.0, SAG) ** 2,
    ),
}


@pytest.mark.mpi(1)
@pytest.mark.parametrize("name", CURVED)
def test_a_curved_mesh_has_the_area_of_its_shape_to_fourth_order(comm, name) -> None:
    make, exact = CURVED[name]
    errors = []
    for n in (2, 4):
        domain = make(comm, n).domain
        measured = fem.form(constant(domain, 1.0) * ufl.dx(metadata={"quadrature_degree": 8}))
        total = comm.allreduce(fem.assemble_scalar(measured))
        errors.append(abs(1 - total / exact))
    assert errors[1] < 1e-3
    # Free meshes are not halved exactly; with plane triangles the order is two.
    assert math.log2(errors[0] / errors[1]) > 3.0


@pytest.mark.mpi
def test_rims_of_curved_meshes_are_circles(comm) -> None:
    tube = bulkhead_tube(comm, 0.2, 1.0, 2, 3, order=2)
    # A bulkhead fits to the ring of the wall also between the corners of cells.
    film = gx.Membrane(tube.wall, LINEAR, order=2)
    bulkhead = gx.Membrane(tube.bulkheads[0], LINEAR, order=2, name="bulkhead")
    state = gx.Scene(film, bulkhead).compile().unknowns.state
    ring = state.vectors(film.ports("ring 1"))
    rim = state.vectors(bulkhead.ports("rim"))
    assert len(ring) == len(rim) == 24
    for nodes in (ring, rim):
        np.testing.assert_allclose(np.hypot(nodes[:, 1], nodes[:, 2]), 0.2, rtol=1e-12)
        np.testing.assert_allclose(nodes[:, 0], 1 / 3, rtol=1e-12)


def test_middle_nodes_of_another_number_are_refused(comm) -> None:
    def triangle() -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
        return np.eye(3), np.array([[0, 1, 2]]), {}

    with pytest.raises(gx.InputError, match="middles returned no array of 3 points"):
        mesh_of_arrays(comm, triangle, lambda a, b: a[:1])


@pytest.mark.parametrize("name", CLOSED)
def test_triangles_are_well_shaped(comm, name) -> None:
    make, _ = CLOSED[name]
    worst = shape_quality(corner_points(make(comm, 3).domain)).min(initial=1.0)
    assert comm.allreduce(worst, op=MPI.MIN) > 0.45


@pytest.mark.mpi(1)
@pytest.mark.parametrize("name", GROUPS)
def test_groups_are_complete(comm, name) -> None:
    make, _ = CLOSED[name]
    mesh = make(comm, 2)
    assert set(mesh.groups) == GROUPS[name]
    surfaces = [group for group, (dim, _) in mesh.groups.items() if dim == 2 and group != "film"]
    if surfaces:
        whole = sum(area(mesh, group) for group in surfaces)
        assert whole == pytest.approx(area(mesh), rel=1e-12)


@pytest.mark.mpi
def test_circles_and_gores_are_where_their_names_say(comm) -> None:
    """A regular polygon of n sides in a circle of radius r has the length 2 n r sin(π/n)."""
    ring = torus(comm, 1.0, 0.3, 24, 8)
    for name, radius in (("outer", 1.3), ("top", 1.0), ("inner", 0.7), ("bottom", 1.0)):
        exact = 48 * radius * math.sin(math.pi / 24)
        assert length(ring, name) == pytest.approx(exact, rel=1e-12)
    envelope = balloon(comm, 2.0, 6, 3)
    shares = [area(envelope, f"gore {k}") for k in range(1, 7)]
    np.testing.assert_allclose(shares, np.mean(shares), rtol=1e-12)
    film = gx.Membrane(envelope, LINEAR)
    state = gx.Scene(film).compile().unknowns.state
    seam = state.vectors(film.ports("seam 2"))
    # From pole to pole at an angle of 60 degrees.
    np.testing.assert_allclose(seam[:, 1], seam[:, 0] * math.sqrt(3), atol=1e-12)
    assert np.ptp(seam[:, 2]) == pytest.approx(4.0)


@pytest.mark.mpi
def test_a_dish_has_its_focal_length_and_looks_at_its_focus(comm) -> None:
    mesh = dish(comm, 0.5, 0.4, 6)
    assert set(mesh.groups) == {"film", "rim", "centre"}
    film = gx.Membrane(mesh, LINEAR)
    scene = gx.Equilibrium(gx.Scene(film))
    found = gx.analysis.best_surface(scene, film, surface="paraboloid")
    assert found.focal_length == pytest.approx(0.4, rel=1e-12)
    corners = corner_points(mesh.domain)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert comm.allreduce(float(normals[:, 2].min(initial=1.0)), op=MPI.MIN) > 0
    assert len(film.ports("rim")) == 36


@pytest.mark.mpi
def test_bulkheads_are_tied_to_their_rings(comm) -> None:
    """Tube and bulkheads under pressure, as one scene that finds its rest."""
    parts = bulkhead_tube(comm, 0.2, 0.6, 2, 2)
    tube = gx.Membrane(parts.wall, WRINKLING, name="tube")
    (disc,) = (
        gx.Membrane(mesh, WRINKLING, name=f"bulkhead {k}")
        for k, mesh in enumerate(parts.bulkheads, start=1)
    )
    tie = gx.Tie(disc, tube, group_a="rim", group_b="ring 1")
    scene = at_rest(tube, disc, tie, gx.Fixed(tube, "first cap"), gx.Pressure(tube, 1e3))
    rim = scene.system.unknowns.state.vectors(disc.ports("rim"))
    ring = scene.system.unknowns.state.vectors(tube.ports("ring 1"))
    apart = np.linalg.norm(rim[:, None] - ring[None], axis=2).min(axis=1)
    assert apart.max() < 1e-12
    radii = np.hypot(ring[:, 1], ring[:, 2])
    # It moved: the bulkhead holds it to less than a free tube's p r²/(E t) (1 - ν/2).
    free = 1e3 * 0.2**2 / (WRINKLING.E * WRINKLING.thickness) * (1 - WRINKLING.nu / 2)
    assert 0.02 * free < radii.max() - 0.2 < free


@pytest.mark.mpi
def test_edges_of_a_polygon_are_arcs_of_one_radius(comm) -> None:
    """The area is that of the triangle less three segments, up to second order in the size."""
    corners = [(0.0, 0.0), (1.0, 0.0), (0.5, math.sqrt(3) / 2)]
    radius = arc_radius(1.0, 0.1)
    half = math.asin(0.5 / radius)
    segment = radius**2 * (half - math.sin(half) * math.cos(half))
    exact = math.sqrt(3) / 4 - 3 * segment
    errors = []
    for size in (0.1, 0.05):
        mesh = arc_polygon(comm, corners, 0.1, size)
        assert set(mesh.groups) == {"film"} | {
            f"{a} {k}" for a in ("edge", "corner") for k in (1, 2, 3)
        }
        errors.append(area(mesh) / exact - 1)
        film = gx.Membrane(mesh, LINEAR)
        x = gx.Scene(film).compile().unknowns.state.vectors(film.ports("edge 1"))
        away = np.hypot(x[:, 0] - 0.5, x[:, 1] + radius - 0.1)
        np.testing.assert_allclose(away, radius, rtol=1e-9)
    assert 0 < errors[1] < 0.01
    assert math.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.3)


@pytest.mark.mpi
def test_meshes_refuse_what_they_cannot_make(comm) -> None:
    square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    for call, words in (
        (lambda: torus(comm, 0.3, 1.0, 12, 8), "give a larger radius"),
        (lambda: bulkhead_tube(comm, 1.0, 1.0, 2, 0), "compartments is 0; give a whole number"),
        (lambda: arc_polygon(comm, square[::-1], 0.1, 0.1), "do not turn left"),
        (lambda: arc_polygon(comm, square, 0.3, 0.1), "arcs cross at a corner"),
        (lambda: arc_polygon(comm, square[:2], 0.1, 0.1), "not three points"),
    ):
        with pytest.raises(gx.InputError, match=words):
            call()


@pytest.mark.parametrize("radius", [1e-8, 1e-5, 1e6])
def test_a_sphere_has_the_same_mesh_at_each_size(radius):
    """gmsh's tolerances are lengths: a sphere of 1e6 m had five nodes."""
    expected = sphere(MPI.COMM_SELF, 1.0, 8, order=2).domain.geometry.x
    found = sphere(MPI.COMM_SELF, radius, 8, order=2).domain.geometry.x
    np.testing.assert_allclose(found / radius, expected, atol=1e-12)
