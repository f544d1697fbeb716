"""Surfaces of cut patterns, lines on them, and strips between the lines."""

from __future__ import annotations

import gmsh
import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.build.patterns.closest import barycentric
from gossamer_fx.meshes.sheet import CORNERS, EDGES, sheet
from tests.pattern_shapes import CYLINDER, grid, surface_of


def test_closest_points_of_a_square_are_the_clipped_ones():
    """On a graded mesh, whose triangles have very different sizes."""
    form = surface_of(lambda u, v: (u**4, v**3, 0 * u), 12, 9)
    given = np.random.default_rng(0).normal(loc=(0.5, 0.5, 0.0), size=(300, 3))
    exact = np.clip(given, [0, 0, 0], [1, 1, 0])
    on = form.closest(given)
    assert on.points == pytest.approx(exact, abs=1e-12)
    assert on.distance == pytest.approx(np.linalg.norm(given - exact, axis=1))
    corners = form.points[form.triangles[on.triangle]]
    assert np.einsum("nk,nkc->nc", on.weights, corners) == pytest.approx(exact, abs=1e-12)


def test_the_corners_of_triangles_are_closest_to_themselves():
    """They are as far from the centre of the largest triangle as any point of it, or, by round-off,
    farther."""
    for corners in np.random.default_rng(0).normal(size=(50, 3, 3)):
        on = gx.patterns.surface((corners, [[0, 1, 2]])).closest(corners)
        assert on.distance == pytest.approx(0.0, abs=1e-12)


@pytest.mark.mpi
def test_the_surface_of_a_mesh_is_the_mesh_on_any_number_of_ranks(comm):
    mesh = sheet(comm, 4, 3, 2.0, 1.5)
    form = gx.patterns.surface(mesh)
    assert form.area == pytest.approx(3.0)
    assert len(form.triangles) == 24 and len(form.points) == 20
    assert set(form.groups) == {*EDGES, *CORNERS}
    assert form.points[form.groups["top right"]].ravel() == pytest.approx([2.0, 1.5, 0.0])
    assert form.points[form.groups["left"]][:, :, 0] == pytest.approx(0.0)
    film = gx.Membrane(
        mesh,
        gx.Linear(1e7, 0.3, density=1e3, thickness=1e-4),
        order=2,
        displacement=lambda X: np.stack([0 * X[0], 0 * X[0], X[0] / 2]),
    )
    state = gx.Equilibrium(gx.Scene(film, gx.Fixed(film, "left")))
    moved = gx.patterns.surface(film, at=state)
    assert moved.points == pytest.approx(form.points + [0, 0, 0.5] * form.points[:, :1])


def test_the_surface_of_a_height_has_it():
    corners = [(-1.0, 0.0), (1.0, 0.0), (1.0, 2.0), (-1.0, 2.0)]
    form = gx.patterns.height_surface(lambda x, y: x * y, outline=corners, size=0.3)
    x, y, z = form.points.T
    assert z == pytest.approx(x * y)
    assert form.points[form.groups["corner 2"]].ravel() == pytest.approx([1.0, 0.0, 0.0])
    assert form.points[form.groups["rim 2"]][:, :, 0] == pytest.approx(1.0)


def write_dome(path, metres):
    """A sphere of a radius of one unit, of so many metres, as CAD would write it."""
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.occ.addSphere(0, 0, 0, 1 / metres)
        gmsh.model.occ.synchronize()
        if path.suffix == ".stl":
            gmsh.option.setNumber("Mesh.MeshSizeMax", 0.2 / metres)
            gmsh.model.mesh.generate(2)
        gmsh.write(str(path))
    finally:
        gmsh.finalize()


@pytest.mark.parametrize("name", ["ball.stl", "ball.step"])
def test_files_give_surfaces_in_metres(tmp_path, name):
    path = tmp_path / name
    write_dome(path, 1e-3)
    form = gx.patterns.read_surface(path, scale=1e-3, size=None if name.endswith("stl") else 0.2)
    assert np.linalg.norm(form.points, axis=1) == pytest.approx(1.0, abs=1e-6)
    # The chords of triangles of 0.2 m take 1 % of the area.
    assert form.area == pytest.approx(4 * np.pi, rel=0.02)
    assert np.einsum("nc,nc->n", form.normals, form.points[form.triangles[:, 0]]).min() > 0.9


REFUSED = {
    "no triangles": (([[0, 0, 0]], np.zeros((0, 3), dtype=int)), "no triangles"),
    "words": (([["a", "b", "c"]], [[0, 0, 0]]), "give a tuple of numbers"),
    "points in a plane": (([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]]), "points are not rows"),
    "floats": (([[0, 0, 0]] * 3, [[0.0, 1.0, 2.0]]), "give integers"),
    "a number too large": (([[0, 0, 0]] * 3, [[0, 1, 3]]), "none of the 3 points"),
    "no area": (([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]]), "no area"),
    "a branch": (
        (
            [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, -1, 0]],
            [[0, 1, 2], [0, 1, 3], [0, 1, 4]],
        ),
        "3 triangles meet",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_not_a_surface_is_refused(case):
    source, words = REFUSED[case]
    with pytest.raises(gx.InputError, match=words):
        gx.patterns.surface(source)


def test_files_that_are_none_are_refused(tmp_path):
    with pytest.raises(gx.InputError, match="There is no file"):
        gx.patterns.read_surface(tmp_path / "none.stl")
    with pytest.raises(gx.InputError, match="give size"):
        gx.patterns.read_surface(tmp_path / "none.step")
    with pytest.raises(gx.InputError, match="ends in"):
        gx.patterns.read_surface(tmp_path / "none.txt")
    (tmp_path / "bad.stl").write_text("solid\nfacet normal a b c")
    with pytest.raises(gx.InputError):
        gx.patterns.read_surface(tmp_path / "bad.stl")


def test_a_strip_with_one_side_is_refused():
    """A Möbius strip of 12 quadrilaterals."""
    angle = 2 * np.pi * np.arange(12) / 12
    points = []
    for a in angle:
        for side in (-0.2, 0.2):
            r = 1 + side * np.cos(a / 2)
            points.append((r * np.cos(a), r * np.sin(a), side * np.sin(a / 2)))
    triangles = []
    for k in range(11):
        triangles += [(2 * k, 2 * k + 2, 2 * k + 1), (2 * k + 1, 2 * k + 2, 2 * k + 3)]
    triangles += [(22, 1, 23), (23, 1, 0)]
    with pytest.raises(gx.InputError, match="one side"):
        gx.patterns.surface((points, triangles))


def test_a_plane_across_a_cylinder_cuts_its_polygon():
    """Half a cylinder of 40 facets: its sections are half polygons, at any height."""
    form = surface_of(CYLINDER, 40, 20)
    exact = 40 * 2 * np.sin(np.pi / 80)
    lines = form.by_planes([[0, 0, z] for z in (0.22, 0.5, 0.77)], (0, 0, 1))
    assert [line.length for line in lines] == pytest.approx([exact] * 3)
    # z = 0.5 goes along sides of triangles.
    assert np.abs(lines[1].points[:, 2] - 0.5).max() < 1e-15
    # Along (normal of the plane) × (normal outwards): against the direction of the clock
    assert lines[0].points[0] == pytest.approx([1.0, 0.0, 0.22])


def test_a_plane_cuts_a_closed_surface_in_a_closed_line():
    form = surface_of(lambda u, v: (np.cos(6.0 * u), np.sin(6.0 * u), v), 40, 10)
    lines = form.by_planes([[0.0, 0.5, 0.0]], (0, 1, 0))
    assert len(lines) == 2
    assert [line.length for line in lines] == pytest.approx([1.0, 1.0])


def test_a_line_through_points_of_a_plane_is_straight():
    points, triangles = grid(lambda u, v: (u, 0.7 * v, 0 * u), 13, 7)
    form = gx.patterns.surface((points, triangles))
    ends = np.array([[0.013, 0.31, 0.0], [0.47, 0.11, 0.0], [0.91, 0.632, 0.0]])
    line = form.along(ends)
    steps = np.diff(ends, axis=0)
    assert line.length == pytest.approx(np.linalg.norm(steps, axis=1).sum(), rel=1e-12)
    # From corner to corner it goes along sides and through corners.
    assert form.along([[0, 0, 0], [1, 0, 0], [1, 0.7, 0]]).length == pytest.approx(1.7)
    assert form.along([[0, 0, 0], [1, 0.7, 0]]).length == pytest.approx(np.hypot(1, 0.7))


def test_lines_off_the_surface_are_refused():
    form = surface_of(CYLINDER, 8, 4)
    with pytest.raises(gx.InputError, match="point 2 is"):
        form.along([[1, 0, 0], [0, 2, 0]])
    with pytest.raises(gx.InputError, match="all points are one"):
        form.along([[1, 0, 0], [1, 0, 0]])
    with pytest.raises(gx.InputError, match="plane 1 does not cut"):
        form.by_planes([[0, 0, 5.0]], (0, 0, 1))
    with pytest.raises(gx.InputError, match="not zero"):
        form.by_planes([[0, 0, 0.5]], (0, 0, 0))


@pytest.mark.parametrize("facets", [16, 40])
def test_geodesics_of_a_cylinder_are_helices(facets):
    """Of the polygonal one, which can be unfolded: straight lines there, in all digits."""
    form = surface_of(CYLINDER, facets, facets)
    at_start = np.array([[0.125, 0.0], [0.0, 0.03], [1.0, 1.0]])
    at_end = np.array([[0.75, 1.0], [1.0, 0.98], [0.0, 0.0]])

    def on_cylinder(at):
        return np.stack([np.cos(np.pi * at[:, 0]), np.sin(np.pi * at[:, 0]), at[:, 1]], axis=1)

    def unfolded(points):
        facet = np.arctan2(points[:, 1], points[:, 0]) * facets / np.pi
        facet = np.clip(np.floor(facet), 0, facets - 1)
        edge = np.stack([np.cos(facet * np.pi / facets), np.sin(facet * np.pi / facets)], axis=1)
        chord = 2 * np.sin(np.pi / facets / 2)
        across = facet * chord + np.linalg.norm(points[:, :2] - edge, axis=1)
        return np.stack([across, points[:, 2]], axis=1)

    for line in form.geodesics(on_cylinder(at_start), on_cylinder(at_end)):
        flat = unfolded(line.points)
        way = flat[-1] - flat[0]
        assert line.length == pytest.approx(np.linalg.norm(way), rel=1e-12)
        off = (flat - flat[0]) @ [-way[1], way[0]]
        assert off == pytest.approx(0.0, abs=1e-12)


def patch(u, v):
    """A part of the unit sphere between the longitudes and latitudes ±1.1 and ±1.2."""
    longitude = 2.2 * (u - 0.5)
    latitude = 2.4 * (v - 0.5)
    return (
        np.cos(longitude) * np.cos(latitude),
        np.sin(longitude) * np.cos(latitude),
        np.sin(latitude),
    )


def test_geodesics_of_a_sphere_are_great_circles():
    """Lengths of the second order, h²/24 for chords h; lines of the first or better."""
    errors = []
    offsets = []
    start = np.array(patch(0.25, 0.125))
    end = np.array(patch(0.875, 0.75))
    normal = np.cross(start, end)
    for cells in (16, 32):
        (line,) = surface_of(patch, cells, cells).geodesics([start], [end])
        errors.append(1 - line.length / np.arccos(start @ end))
        offsets.append(np.abs(line.points @ normal).max() / np.linalg.norm(normal))
    assert errors[0] == pytest.approx(4 * errors[1], rel=0.1)
    assert 0 < errors[1] < 1e-3
    assert offsets[1] < offsets[0] / 2 < 5e-3


def test_a_geodesic_is_a_taut_thread_wherever_it_begins():
    """On random hills: as long from its other end, connected, and in its triangles."""
    rng = np.random.default_rng(2)
    for _ in range(5):
        hills = 0.02 * rng.normal(size=(9, 9))
        form = surface_of(lambda u, v, z=hills: (u, v, z), 8, 8)
        ends = form.points[rng.permutation(len(form.points))[:12]].reshape(2, 6, 3)
        ahead = form.geodesics(*ends)
        for line, back in zip(ahead, form.geodesics(ends[1], ends[0]), strict=True):
            assert line.length == pytest.approx(back.length, rel=1e-9)
            assert np.array_equal(line.ends[:-1], line.starts[1:])
            corners = form.points[form.triangles[line.triangles]]
            for points in (line.starts, line.ends):
                weights = barycentric(corners, points)
                assert weights.min() > -1e-9
                assert np.einsum("nk,nkc->nc", weights, corners) == pytest.approx(points, abs=1e-9)


def test_a_geodesic_goes_round_corners_of_the_rim_and_stays_on_its_part():
    """Of an L: along both of its arms, past the inner corner."""
    points, triangles = grid(lambda u, v: (u, v, 0 * u), 10, 10)
    inside = points[triangles].mean(axis=1)[:, :2].max(axis=1) < 0.5
    arms = (points[triangles].mean(axis=1)[:, :2] < 0.5).any(axis=1)
    form = gx.patterns.surface((points, triangles[arms]))
    (line,) = form.geodesics([[0.93, 0.31, 0]], [[0.27, 0.88, 0]])
    exact = np.hypot(0.43, 0.19) + np.hypot(0.23, 0.38)
    assert line.length == pytest.approx(exact, rel=1e-12)
    strips = form.cut([line])
    assert sum(strip.area for strip in strips) == pytest.approx(0.75, rel=1e-12)
    apart = gx.patterns.surface((points, triangles[inside | ~arms]))
    with pytest.raises(gx.InputError, match="not connected"):
        apart.geodesics([[0.2, 0.2, 0]], [[0.8, 0.8, 0]])
    with pytest.raises(gx.InputError, match="are one point"):
        form.geodesics([[0.2, 0.2, 0]], [[0.2, 0.2, 0]])
    with pytest.raises(gx.InputError, match="starts has 2 and ends has 1 entries"):
        form.geodesics([[0.2, 0.2, 0]] * 2, [[0.2, 0.2, 0]])
    with pytest.raises(gx.InputError, match="start 1 is"):
        form.geodesics([[0.2, 0.2, 1]], [[0.2, 0.2, 0]])


def test_lines_between_points_of_round_rims_cut_the_form():
    """Points of a round inner rim lie above its chords, inside of the form."""

    def horn(u, v):
        return (0.1 + v) * np.cos(6 * u), (0.1 + v) * np.sin(6 * u), 1 - np.sqrt(v)

    form = surface_of(horn, 40, 12)
    angle = np.array([1.0, 2.0, 3.0, 4.0])
    circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    inner = 0.1 * circle + [0, 0, 1]
    outer = 1.1 * circle
    assert len(form.cut(form.geodesics(inner, outer))) == 5
    assert len(form.cut([form.along(ends) for ends in zip(inner, outer, strict=True)])) == 5


def side_lengths(mesh, points):
    return np.linalg.norm(np.diff(mesh.points[points], axis=0), axis=1)


def test_a_cut_keeps_area_and_gives_both_sides_the_same_points():
    form = surface_of(CYLINDER, 12, 9)
    lines = form.by_planes([[0, 0, 0.4], [0, 0, 0.65]], (0.3, 0.1, 1))
    strips = form.cut(lines)
    assert len(strips) == 3
    assert sum(strip.area for strip in strips) == pytest.approx(form.area, rel=1e-12)
    mesh = strips.mesh
    for seam, line in zip(strips.seams, lines, strict=True):
        assert seam.strips == (seam.number + 1, seam.number)
        assert np.array_equal(mesh.points[seam.left], mesh.points[seam.right])
        assert not set(seam.left) & set(seam.right)
        assert side_lengths(mesh, seam.left).sum() == pytest.approx(line.length)
    # From below: the strip at z = 0 is the first.
    assert strips[0].points[:, 2].min() == 0
    assert {"seam 0", "seam 1"} <= set(strips[1].groups)


def test_lines_may_cross_each_other_and_end_inside():
    points, triangles = grid(lambda u, v: (u, v, 0 * u), 6, 5)
    form = gx.patterns.surface((points, triangles))
    across = form.by_planes([[0.37, 0, 0]], (1, 0, 0)) + form.by_planes([[0, 0.53, 0]], (0, 1, 0))
    strips = form.cut(across)
    assert sorted(strip.area for strip in strips) == pytest.approx(
        sorted([0.37 * 0.53, 0.37 * 0.47, 0.63 * 0.53, 0.63 * 0.47])
    )
    assert len(strips.seams) == 4
    slit = form.cut([form.along([[0.2, 0.31, 0], [0.7, 0.62, 0]])])
    assert len(slit) == 1 and slit[0].area == pytest.approx(1.0)
    (seam,) = slit.seams
    assert seam.names == ("seam 0 left", "seam 0 right")
    # The ends of a slit are not cut.
    assert seam.left[0] == seam.right[0] and seam.left[-1] == seam.right[-1]
    assert not set(seam.left[1:-1]) & set(seam.right[1:-1])


def test_many_lines_may_cross_in_one_point():
    """As the seams of gores do; inside of a triangle, on a side and at a corner of the mesh."""
    points, triangles = grid(lambda u, v: (u - 0.5, v - 0.5, 0 * u), 7, 6)
    form = gx.patterns.surface((points, triangles))
    angle = np.pi * np.arange(9) / 9
    normals = np.stack([-np.sin(angle), np.cos(angle), 0 * angle], axis=1)
    for centre in ([0.01, 0.02, 0], [0.1, 0, 0], [-1 / 14, 1 / 6, 0]):
        strips = form.cut(form.by_planes(np.tile(centre, (9, 1)), normals))
        assert len(strips) == len(strips.seams) == 18
        assert sum(strip.area for strip in strips) == pytest.approx(1.0, rel=1e-9)


def test_a_surface_is_printed_in_one_line():
    assert repr(surface_of(CYLINDER, 4, 2)) == (
        "<FormSurface of 16 triangles, 15 points, 3.061 m²; groups: none>"
    )


@pytest.mark.parametrize("shift", [0.0, 1e-3, 1e-5, 1e-7, 1e-10])
def test_lines_near_corners_of_triangles_are_cut_and_laid_flat(shift):
    """The triangles are thin by the distance of the line, or the line goes through the corner."""
    form = surface_of(lambda u, v: (u, v, 0 * u), 10, 10)
    strips = form.cut([form.along([[0.5 + shift, 0, 0], [0.5 - shift, 1, 0]])])
    assert [strip.area for strip in strips] == pytest.approx([0.5, 0.5], abs=1e-6)
    assert sum(strip.area for strip in strips) == pytest.approx(1.0, rel=1e-12)
    for strip in strips:
        assert strip.normals[:, 2].min() > 0.999
    panels = strips.flatten(gx.Linear(1e7, 0.3, density=1e3, thickness=1e-4))
    for panel, strip in zip(panels, strips, strict=True):
        assert panel.area == pytest.approx(strip.area, rel=1e-9)


def test_named_rims_are_kept_and_others_end_at_corners(comm):
    strips = gx.patterns.surface(sheet(comm, 4, 4)).cut(
        gx.patterns.surface(sheet(comm, 4, 4)).by_planes([[0.3, 0, 0]], (1, 0, 0))
    )
    assert set(strips[0].groups) == {"bottom", "left", "top", "seam 0", "bottom left", "top left"}
    points, triangles = grid(lambda u, v: (u, v, 0 * u), 3, 3)
    plain = gx.patterns.surface((points, triangles))
    left, right = plain.cut(plain.by_planes([[0.3, 0, 0]], (1, 0, 0)))
    names = {name for name in {**left.groups, **right.groups} if name.startswith("rim")}
    assert names == {"rim 1", "rim 2", "rim 3", "rim 4"}
