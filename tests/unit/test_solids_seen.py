"""Obstacles in pictures and recordings: their surfaces and positions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.records.plot.run_reader import RunReader
from gossamer_fx.records.plot.shapes import SOLID
from gossamer_fx.records.plot.viewer import RunView
from tests.small_scenes import WRINKLING

NEAR = np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 0.5]])
SHARE = 0.97  # of the volume of something round that its facets enclose, at least


@pytest.mark.parametrize(
    "obstacle, volume",
    [
        (gx.contact.Sphere(centre=(1, 2, 3), radius=0.5), math.pi / 6),
        (
            gx.contact.Cylinder(start=(0, 0, 0), end=(0, 2, 0), radius=0.5),
            math.pi / 6 + math.pi / 2,
        ),
        (
            gx.contact.Box(
                centre=(1, 0, 0), sizes=(1, 2, 3), axes=((0, 1, 0), (0, 0, 1), (1, 0, 0))
            ),
            6.0,
        ),
    ],
)
def test_surfaces_are_closed_and_enclose_the_volume(obstacle, volume) -> None:
    solid = obstacle.solid(NEAR)
    a, b, c = (solid.X[corners] for corners in solid.triangles.T)
    enclosed = np.einsum("ni,ni->n", np.cross(a, b), c).sum() / 6
    assert SHARE * volume < enclosed < volume * (1 + 1e-12)
    assert np.abs(np.cross(b - a, c - a).sum(axis=0)).max() < 1e-12  # closed


@pytest.mark.parametrize("inside", [gx.contact.Sphere, gx.contact.Cylinder, gx.contact.Box])
def test_rooms_and_planes_are_lines(inside) -> None:
    given = {
        gx.contact.Sphere: {"centre": (0, 0, 0), "radius": 1.0},
        gx.contact.Cylinder: {"start": (0, 0, 0), "end": (0, 0, 1), "radius": 1.0},
        gx.contact.Box: {"centre": (0, 0, 0), "sizes": (1, 1, 1)},
    }[inside]
    room = inside(**given, inside=True).solid(NEAR)
    assert not len(room.triangles) and len(room.lines)
    plane = gx.contact.Plane(point=(0, 0, -1), normal=(0, 0, 2)).solid(NEAR)
    assert np.allclose(plane.X[:, 2], -1) and not len(plane.triangles)
    assert np.ptp(plane.X[:, 0]) == pytest.approx(2.4)  # a little larger than what is before it


def gap_to_balls(X: np.ndarray, first, second, radii) -> np.ndarray:
    """Gaps [m] of points (n, 3) to all balls whose centres and radii go from one to the other."""
    share = np.linspace(0.0, 1.0, 4001)
    centres = np.outer(1 - share, first) + np.outer(share, second)
    radius = (1 - share) * radii[0] + share * radii[1]
    distances = np.linalg.norm(X[:, None] - centres, axis=2)
    return (distances - radius).min(axis=1)


@pytest.mark.parametrize("inside", [False, True])
def test_drawn_points_are_on_the_surface(inside) -> None:
    """Of a ball, of a mast, and of a frustum, whose mantle goes through both circles."""
    sphere = gx.contact.Sphere(centre=(1, 2, 3), radius=0.5, inside=inside).solid(NEAR)
    assert np.abs(gap_to_balls(sphere.X, (1, 2, 3), (1, 2, 3), (0.5, 0.5))).max() < 1e-12
    ends = np.array([[0.1, 0.0, 0.2], [0.4, 2.0, 0.3]])
    mast = gx.contact.Cylinder(start=ends[0], end=ends[1], radius=0.3, inside=inside).solid(NEAR)
    assert np.abs(gap_to_balls(mast.X, *ends, (0.3, 0.3))).max() < 1e-6
    # A line of the mantle from one circle to the other stands on the radii of both balls there.
    radii = np.array([0.6, 0.2])
    between = ends[1] - ends[0]
    length = np.linalg.norm(between)
    slope = (radii[0] - radii[1]) / length
    centres = ends - slope * radii[:, None] * between / length
    frustum = gx.contact.Cone(start=ends[0], end=ends[1], radii=tuple(radii), inside=inside)
    cone = frustum.solid(NEAR)
    assert np.abs(gap_to_balls(cone.X, *centres, np.hypot(1, slope) * radii)).max() < 1e-6
    # Both circles are among its lines, and lines along it join them.
    along = (cone.X - ends[0]) @ between / length
    across = np.linalg.norm(cone.X - ends[0] - np.outer(along, between / length), axis=1)
    for height, radius in zip((0.0, length), radii, strict=True):
        on_circle = np.flatnonzero((abs(along - height) < 1e-9) & (abs(across - radius) < 1e-9))
        is_on = np.isin(cone.lines, on_circle)
        assert is_on.all(axis=1).sum() == len(on_circle) >= 16
        # Of each line along the mantle two pieces end on the circle, on its two sides.
        assert (is_on.sum(axis=1) == 1).sum() == 2 * 4


def test_a_plane_is_a_square_grid_in_the_middle_of_what_is_near() -> None:
    near = np.array([[1.0, -1.0, 0.0], [4.0, 0.5, 0.5], [2.0, 0.0, 1.0]])
    normal = np.array([1.0, 2.0, 2.0]) / 3
    point = np.array([0.3, 0.2, -1.0])
    plane = gx.contact.Plane(point=tuple(point), normal=tuple(5 * normal)).solid(near)
    assert np.abs((plane.X - point) @ normal).max() < 1e-14
    middle = np.array([2.5, -0.25, 0.5])
    seen = middle - (middle - point) @ normal * normal
    assert plane.X.mean(axis=0) == pytest.approx(seen, abs=1e-12)
    starts, ends = (plane.X[column] for column in plane.lines.T)
    # 1.2 of the largest size, 3 m along x
    assert np.linalg.norm(ends - starts, axis=1) == pytest.approx(3.6, rel=1e-12)
    directions = (ends - starts) / 3.6
    first = np.abs(directions @ directions[0])
    assert sorted(np.round(first, 12)) == [0.0] * 7 + [1.0] * 7
    # The middles of seven parallel lines are at equal distances from side to side of the square.
    for family in (first > 0.5, first < 0.5):
        middles = ((starts + ends) / 2)[family]
        steps = np.linalg.norm(np.diff(middles, axis=0), axis=1)
        assert steps == pytest.approx(0.6, rel=1e-12)


@pytest.mark.mpi
def test_pictures_and_recordings_see_solids_move(comm, folder) -> None:
    film = gx.Membrane(sheet(comm, 2, 2, 0.1, 0.1), WRINKLING)
    block = gx.RigidBody(
        0.1, (1e-4, 1e-4, 1e-4), position=(0, 0, -0.1), spin=(0, 0, 30.0), comm=comm
    )
    box = gx.contact.Box(centre=(0.02, 0, -0.1), sizes=(0.04, 0.02, 0.02), body=block, name="box")
    ball = gx.contact.Sphere(centre=(0, 0, 0.1), radius=0.02, motion=lambda t: (t, 0.0, 0.0))
    floor = gx.contact.Plane(point=(0, 0, -0.3), normal=(0, 0, 1))
    recording = gx.Recording(folder / "run", every=1)
    picture = gx.plot.Picture(folder / "seen.png")
    scene = gx.Scene(gx.Contact(film, box, ball, floor, distance=1e-3))
    run = gx.Simulation(scene, gx.Midpoint(dt=1e-3), outputs=[recording, picture])
    run.run(until=5e-3)
    if comm.rank == 0:
        read = RunReader(folder / "run")
        shape = read.shape(
            read.record_at(5e-3), "state", lambda values: np.zeros(len(values), dtype=np.int64)
        )
        assert (shape.kinds != SOLID).sum() == 8  # of the film
        corners = shape.corners[shape.kinds == SOLID]
        of_box = corners[:12].reshape(36, 3)
        c = math.cos(0.15)
        s = math.sin(0.15)
        turned = (of_box[:, :2]) @ np.array([[c, -s], [s, c]])  # back by the angle of five steps
        assert np.allclose(np.ptp(turned, axis=0), (0.04, 0.02), atol=1e-6)
        assert corners[12:, :, 0].mean() == pytest.approx(5e-3, abs=1e-3)
        assert len(shape.lines) == 14  # of the floor
        [parts] = RunView(read).whole()["header"]["meshes"]
        of_floor = [part for part in parts if part["name"] == f"{floor.name} 3"]
        assert [part["corners"] for part in of_floor] == [2] and of_floor[0]["pieces"]
        assert (folder / "seen.png").read_bytes()[1:4] == b"PNG"


def test_a_scene_without_solids_records_none(tmp_path) -> None:
    film = gx.Membrane(sheet(MPI.COMM_SELF, 2, 2, 0.1, 0.1), WRINKLING)
    recording = gx.Recording(tmp_path)
    gx.Simulation(gx.Scene(film), gx.Midpoint(dt=1e-3), outputs=[recording]).run(until=2e-3)
    assert not (tmp_path / "solids.csv").exists() and RunReader(tmp_path).solids == []


def test_a_rigid_body_without_a_shape_is_a_box_of_its_inertia(tmp_path) -> None:
    """Of a brick, turned: the box is the brick, with the name of the body."""
    mass = 2.0
    a, b, c = 0.1, 0.2, 0.4
    inertia = mass / 12 * np.array([b**2 + c**2, a**2 + c**2, a**2 + b**2])
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    hub = gx.RigidBody(
        mass, inertia, position=(1, 2, 3), attitude=turn, comm=MPI.COMM_SELF, name="hub"
    )
    run = gx.Simulation(gx.Scene(hub), gx.Midpoint(dt=1e-3), outputs=[gx.Recording(tmp_path)])
    run.run(until=2e-3)
    reader = RunReader(tmp_path)
    [points] = reader.solid_points(2e-3)
    assert np.ptp(points, axis=0) == pytest.approx((b, a, c), rel=1e-5)
    assert points.mean(axis=0) == pytest.approx((1, 2, 3))
    assert [solid.name for solid in reader.solids] == ["hub"]
    # The view can hide the box and the dot of its centre one by one.
    [parts] = RunView(reader).whole()["header"]["meshes"]
    assert [part["name"] for part in parts] == ["hub", "hub, centre"]
    corners = points[reader.solids[0].triangles]
    x, y, z = corners[:, 0], corners[:, 1], corners[:, 2]
    # Its faces look outwards.
    assert np.einsum("ni,ni->n", np.cross(x, y), z).sum() / 6 == pytest.approx(a * b * c, rel=1e-5)


@pytest.mark.mpi
def test_masses_at_points_of_bodies_are_dots(comm, folder) -> None:
    """Where their points are; recorded with the fields."""
    film = gx.Membrane(sheet(comm, 2, 2, 0.1, 0.1), WRINKLING, name="film")
    corners = ("top right", "bottom left")
    tips = [
        gx.connectors.AttachedMass(film.port(corner), 0.1, name=f"{corner} mass")
        for corner in corners
    ]
    fall = gx.Gravity(film, (0.0, 0.0, -9.81))
    recording = gx.Recording(folder / "run", every=5)
    run = gx.Simulation(gx.Scene(film, fall, *tips), gx.Midpoint(dt=1e-2), outputs=[recording])
    run.run(until=0.1)
    if comm.rank == 0:
        reader = RunReader(folder / "run")
        assert reader.point_names == ["top right mass", "bottom left mass"]
        fallen = -9.81 * 0.1**2 / 2
        expected = [(0.1, 0.1, fallen), (0.0, 0.0, fallen)]
        assert reader.dots(0.1) == pytest.approx(np.array(expected), abs=1e-9)
        [parts] = RunView(reader).whole()["header"]["meshes"]
        assert [part["name"] for part in parts] == ["film", *reader.point_names]
