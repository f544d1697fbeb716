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
        of_floor = [part for part in parts if part["name"] == "solid 3"]
        assert [part["corners"] for part in of_floor] == [2] and of_floor[0]["pieces"]
        assert (folder / "seen.png").read_bytes()[1:4] == b"PNG"


def test_a_scene_without_solids_records_none(tmp_path) -> None:
    film = gx.Membrane(sheet(MPI.COMM_SELF, 2, 2, 0.1, 0.1), WRINKLING)
    recording = gx.Recording(tmp_path)
    gx.Simulation(gx.Scene(film), gx.Midpoint(dt=1e-3), outputs=[recording]).run(until=2e-3)
    assert not (tmp_path / "solids.csv").exists() and RunReader(tmp_path).solids == []
