"""Checks of meshes and parameters before a run, on any number of ranks."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.airbag import airbag
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.plates import slit_ring
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.meshes.sphere import sphere
from gossamer_fx.meshes.tube import flat_tube
from gossamer_fx.solve.scene.validation import validate, warnings
from tests.small_scenes import AIR, LINEAR, MATERIAL, WRINKLING, tank

WORLD = MPI.COMM_WORLD
THICK = gx.Linear(1e9, 0.3, density=1000.0, thickness=0.01)


def triangles(
    points: list[tuple[float, ...]], cells: list[tuple[int, ...]], order: int = 1
) -> gx.Mesh:
    """A mesh of given nodes (from 0) and triangles."""

    def build(model) -> None:
        surface = model.addDiscreteEntity(2)
        model.mesh.addNodes(2, surface, [], np.ravel(points))
        model.mesh.addElementsByType(surface, 2 if order == 1 else 9, [], np.ravel(cells) + 1)

    return gx.gmsh_mesh(build, WORLD)


def rows_of_squares(
    n: int, lift: Callable[[int, int], float] = lambda i, j: 0.0
) -> tuple[list, list]:
    """Nodes and triangles of n × n squares."""
    points = [(i / n, j / n, lift(i, j)) for i in range(n + 1) for j in range(n + 1)]
    corner = [(i, j) for i in range(n) for j in range(n)]
    at = lambda i, j: i * (n + 1) + j  # noqa: E731
    lower = [(at(i, j), at(i + 1, j), at(i + 1, j + 1)) for i, j in corner]
    return points, lower + [(at(i, j), at(i + 1, j + 1), at(i, j + 1)) for i, j in corner]


def crossings(film: gx.Membrane) -> float:
    run = gx.Simulation(gx.Scene(film), gx.Midpoint(dt=1e-3))
    return gx.probes.Crossings(film)(run)


def words_of(mesh: gx.Mesh, law: gx.Miyazaki = WRINKLING, **options) -> list[str]:
    return list(warnings([gx.Membrane(mesh, law, **options)]))


@pytest.mark.mpi(1)
@pytest.mark.parametrize(
    "mesh",
    [
        lambda: sheet(WORLD, 4, 4),
        lambda: airbag(WORLD, 1.0, 4),
        lambda: flat_tube(WORLD, 0.8, 0.058, 6),
        lambda: sphere(WORLD, 1.0, 12),
    ],
)
def test_good_meshes_are_not_suspected(mesh):
    film = gx.Membrane(mesh(), WRINKLING)
    assert list(warnings([film])) == [] and crossings(film) == 0


def test_curved_triangles_are_not_suspected():
    film = gx.Membrane(sphere(WORLD, 1.0, 12, order=2), WRINKLING, order=2)
    assert list(warnings([film])) == [] and crossings(film) == 0


def test_a_triangle_of_no_size_is_refused():
    """When the mesh is made, and also in a scene, if its nodes were moved."""
    points, cells = rows_of_squares(3)
    mesh = triangles(points, cells)
    nodes = mesh.domain.geometry.x
    is_moved = np.isclose(nodes, points[5]).all(axis=1)
    nodes[is_moved] = points[6]
    with pytest.raises(gx.InputError, match=r"'film' has 2 triangles of no size.*duplicate nodes"):
        gx.Scene(gx.Membrane(mesh, WRINKLING)).compile()
    points[5] = points[6]
    words = r"has 2 triangles of no size.*one at \(0, 0.333333, 0\) m.*removeDuplicateNodes"
    with pytest.raises(gx.InputError, match=words):
        triangles(points, cells)


MESH_FILE = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
2
1 2 "rim"
2 1 "sail"
$EndPhysicalNames
$Nodes
4
1 0 0 0
2 1 0 0
3 {third}
4 0 1 0
$EndNodes
$Elements
3
1 2 2 1 1 1 2 4
2 2 2 1 1 {cell}
3 1 2 2 2 1 2
$EndElements
"""


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("third", "cell", "words"),
    [
        ("2 0 0", "1 2 3", r"1 triangle of no size.*one of the group 'sail' at \(0, 0, 0\) m"),
        ("0 0 0", "1 3 4", r"1 triangle of no size.*one of the group 'sail' at \(0, 0, 0\) m"),
        ("1 1 0", "2 2 3", "has the node 2 twice"),
        ("nan 1 0", "2 3 4", r"[Tt]he (node 3 of the mesh is at \[nan, 1.0, 0.0\] m|file)"),
    ],
)
def test_cells_of_a_file_that_cannot_be_are_named(folder, comm, third, cell, words):
    """A triangle without area was read in silence."""
    path = folder / "sail.msh"
    if comm.rank == 0:
        path.write_text(MESH_FILE.format(third=third, cell=cell))
    comm.barrier()
    with pytest.raises(gx.InputError, match=words):
        gx.read_mesh(path, comm)


def test_a_curved_triangle_that_turns_inside_is_refused():
    corners = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
    for shift, turned in ((0.0, False), (0.3, True)):
        middles = [(0.5, shift, 0), (0.5 - shift, 0.5 - shift, 0), (shift, 0.5, 0)]
        mesh = triangles([*corners, *middles], [(0, 1, 2, 3, 4, 5)], order=2)
        film = gx.Membrane(mesh, WRINKLING, order=2)
        if turned:
            with pytest.raises(gx.InputError, match="1 curved triangles that turn inside out"):
                list(warnings([film]))
        else:
            measured = list(warnings([film]))
            assert measured == []


@pytest.mark.mpi
def test_slivers_folds_and_opposite_normals_are_told():
    points, cells = rows_of_squares(3)
    # a triangle on an edge of the boundary, almost without height
    [words] = words_of(triangles([*points, (1.0 + 1e-7, 1 / 2, 0.0)], [*cells, (13, 16, 14)]))
    assert "1 slivers" in words
    [words] = words_of(triangles(points, [*cells[:-1], cells[-1][::-1]]))
    assert "change sides at 2 edges" in words
    # the node in the middle of a square, moved across one of its edges
    ring = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.5, -0.2, 0)]
    [words] = words_of(triangles(ring, [(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)]))
    assert "1 triangles upside down" in words


def test_a_seam_that_is_not_glued_is_told():
    points, cells = rows_of_squares(4)
    shifted = [(x + 1, y, z) for x, y, z in points]
    twice = triangles(points + shifted, cells + [tuple(i + 25 for i in cell) for cell in cells])
    [words] = words_of(twice)
    assert "8 boundary edges of 'film' coincide" in words


def test_a_slit_whose_sides_are_named_is_meant():
    film = gx.Membrane(slit_ring(WORLD, 2, 16, 6.0, 10.0), WRINKLING)
    assert list(warnings([film])) == []
    del film.mesh.groups["start"]
    assert "4 boundary edges of 'film' coincide" in "".join(warnings([film]))


@pytest.mark.mpi
def test_a_film_that_penetrates_itself_crosses_itself():
    flat, cells = rows_of_squares(4)
    steep = [(0.49, y, x - 0.53) for x, y, _ in flat]
    mesh = triangles(flat + steep, cells + [tuple(i + 25 for i in cell) for cell in cells])
    assert crossings(gx.Membrane(mesh, WRINKLING)) > 5
    apart = [(x + 2, y, z) for x, y, z in steep]
    mesh = triangles(flat + apart, cells + [tuple(i + 25 for i in cell) for cell in cells])
    assert crossings(gx.Membrane(mesh, WRINKLING)) == 0


@pytest.mark.parametrize(
    "numbers, culprit",
    [
        ({"thickness": 25.0}, "25 m thick"),
        ({"thickness": 25.0}, "thickness = 25 m is unusual, 1e-08 to 0.01 m is not"),
        ({"E": 4.0}, "E = 4 Pa"),
        ({"density": 1.4}, "density = 1.4 kg/m³ is unusual, 5 to 30000 kg/m³ is not"),
    ],
)
def test_numbers_in_other_units_are_told(numbers, culprit):
    law = gx.Miyazaki(**(MATERIAL | numbers))
    assert any(culprit in words for words in words_of(sheet(WORLD, 2, 2), law))


def test_properties_of_cells_in_other_units_are_told(comm):
    """Also that a plate is thick for its width, by its thickest cell."""
    mesh = sheet(comm, 4, 2, 1.0, 0.05)
    properties = {
        "thickness": lambda X: 1e-3 + 9e-3 * (X[0] > 0.5),
        "E": lambda X: 1.0 + 1e9 * (X[1] > 0.025),
    }
    strip = gx.Plate(mesh, LINEAR, properties=properties, name="strip")
    words = list(warnings([strip]))
    assert any("'strip': E = 1 Pa is unusual" in each for each in words)
    assert any("0.01 m thick and 0.05 m wide" in each for each in words)
    assert not any("thickness = " in each for each in words)


def test_friction_of_an_obstacle_in_per_cent_is_told(comm):
    film = gx.Membrane(sheet(comm, 2, 2), WRINKLING)
    floor = gx.contact.Plane(point=(0, 0, -1), normal=(0, 0, 1), friction=30.0, name="floor")
    contact = gx.Contact(film, floor, distance=1e-3, name="contact")
    words = list(warnings([film, contact]))
    assert [each for each in words if "per cent" in each] == [
        "'floor of contact': friction = 30 is unusual, 0 to 3 is not; "
        "numbers are in SI units: is it in per cent?"
    ]


def test_what_is_suspected_is_told_once(caplog):
    film = gx.Membrane(
        sheet(MPI.COMM_SELF, 2, 2),
        gx.Linear(E=1e9, nu=0.3, density=1e-6, thickness=1e-4),
        name="air",
    )
    with caplog.at_level(logging.WARNING, logger="gossamer_fx"):
        for _ in range(2):
            validate([film], MPI.COMM_SELF)
    measured = [r.message for r in caplog.records]
    assert measured == [
        "'air': density = 1e-06 kg/m³ is unusual, 5 to 30000 kg/m³ is not; numbers are in SI units."
    ]


def test_initial_strains_that_cannot_be(comm):
    """Per cent and ppm taken for ratios are named; a length below zero, and stress that a film does
    not bear, are refused."""
    mesh = sheet(comm, 2, 2)
    film = gx.Membrane(mesh, LINEAR, initial_strain=1e3)
    assert any("initial_strain = 1000 is unusual" in words for words in warnings([film]))
    with pytest.raises(gx.InputError, match=r"initial_strain is -2; a Green-Lagrange strain"):
        gx.Membrane(mesh, LINEAR, initial_strain=-2.0)
    with pytest.raises(gx.InputError, match=r"initial_strain is -0\.5"):
        gx.Cable(line(comm, [(0, 0, 0), (1, 0, 0)], 2), gx.CableLaw(1.0, 1.0), initial_strain=-0.5)
    with pytest.raises(gx.InputError, match="normal to the film"):
        gx.Membrane(mesh, LINEAR, initial_stress=np.diag([0.0, 0.0, 1e5]))


def test_a_tensor_may_be_unsymmetric_by_round_off():
    turned = np.array([[1e5, 3e4, 0.0], [3e4 * (1 + 1e-15), 2e5, 0.0], [0.0, 0.0, 0.0]])
    gx.Membrane(sheet(WORLD, 2, 2), LINEAR, initial_stress=turned)


def test_a_separate_panel_may_lie_other_side_up(comm):
    """Parts of a mesh that are not connected do not cover each other's plane."""
    big = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)]
    small = [(3, 0, 0), (4, 0, 0), (4, 1, 0), (3, 1, 0)]
    mesh = triangles([*big, *small], [(0, 1, 2), (0, 2, 3), (4, 6, 5), (4, 7, 6)])
    film = gx.Membrane(mesh, WRINKLING)
    assert not any("upside down" in words for words in warnings([film]))


@pytest.mark.parametrize(
    ("items", "words"),
    [
        (lambda: [tank(temperature=20.0)], "initial_temperature = 20 K .* degrees Celsius"),
        (lambda: [tank(pressure=1e12)], "initial_pressure = 1e[+]12 Pa is unusual"),
        (lambda: [tank(gas=gx.IdealGas(gamma=1.4, R=0.287))], "R = 0.287 .* kJ"),
        (lambda: [tank(gas=gx.IdealGas(gamma=140.0, R=287.0))], "gamma = 140 is unusual"),
        (
            lambda: [gx.Orifice(one := tank(), gx.gas.Ambient(1e5, 20.0), area=1e-6), one],
            "'ambient': temperature = 20 K .* degrees Celsius",
        ),
        (
            lambda: [
                gx.gas.Inflator(
                    one := tank(), gas=AIR, mass_flow=2e3, temperature=300.0, name="inflator"
                ),
                one,
            ],
            "mass_flow = 2000 kg/s .* g/s",
        ),
        (
            lambda: [gx.gas.WallHeat(tank(), 5.0, temperature=20.0)],
            "'wall': temperature = 20 K .* degrees Celsius",
        ),
        (
            lambda: [gx.Orifice(tank(), gx.gas.Ambient(1e5), area=5.0)],
            "area = 5 m² .* mm² or cm²",
        ),
        (lambda: [gx.Gravity(gx.PointMass(1.0), (0.0, 0.0, -9810.0))], "g = 9810 .* mm/s²"),
        (lambda: [gx.Membrane(sheet(WORLD, 2, 2, 1e3, 1e3), LINEAR)], "1.41e.03 m .* millimetres"),
        (lambda: [gx.Plate(sheet(WORLD, 4, 2, 1.0, 0.05), THICK)], "too stiff by .* 1.12"),
    ],
)
def test_the_likely_slip_is_named_once(items, words):
    found = [one for one in warnings(items()) if re.search(words, one)]
    assert len(found) == 1


@pytest.mark.parametrize(
    ("order", "film_order", "is_told"), [(1, 2, True), (2, 2, False), (1, 1, False)]
)
def test_order_2_on_plane_cells_of_a_curved_surface_is_told(order, film_order, is_told):
    film = gx.Membrane(sphere(WORLD, 1.0, 6, order=order), LINEAR, order=film_order)
    assert any("cut off what the surface bulges" in words for words in warnings([film])) == is_told


def test_order_2_on_a_plane_mesh_is_not_told():
    film = gx.Membrane(airbag(WORLD, 1.0, 4), LINEAR, order=2)
    assert not any("cut off what the surface bulges" in words for words in warnings([film]))
