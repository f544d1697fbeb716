"""VTU and PVD files: what is written is read back, also after a restart and on several ranks."""

from __future__ import annotations

import math
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.records.outputs.vtu_format import (
    Entry,
    Grid,
    read_pvd,
    read_vtu,
    write_pvd,
    write_vtu,
)
from gossamer_fx.records.plot import vtk_export
from tests.small_scenes import run_until

WORLD = MPI.COMM_WORLD
ROOT = Path(__file__).parents[2]
LAW = gx.Miyazaki(E=1e9, nu=0.3, density=1400.0, thickness=1e-4)
DT = 1e-3
SPEED = 0.5


def parts_of(path: Path) -> list[tuple[str, str]]:
    """Names and files of the parts that a VTM file lists."""
    listed = ElementTree.parse(path).iter("DataSet")
    return [(element.attrib["name"], element.attrib["file"]) for element in listed]


def drifting(x: np.ndarray) -> np.ndarray:
    velocity = np.zeros((3, x.shape[1]))
    velocity[2] = SPEED
    return velocity


def recorded(folder: Path, order: int = 1, **options: object) -> gx.Simulation:
    """A film and a cable that drift along z; the run is ready to start."""
    film = gx.Membrane(sheet(WORLD, 3, 2), LAW, order=order, velocity=drifting, name="the film")
    curve = line(WORLD, [(0, 0, 1), (1, 0, 1)], 3)
    cable = gx.Cable(curve, gx.CableLaw(1e5, 0.1), velocity=drifting, name="cable")
    fields = {"the film": ("stress1", "displacement", "state", "direction")}
    recording = gx.Recording(folder, fields, every=2)
    return gx.Simulation(gx.Scene(film, cable), gx.Midpoint(dt=DT), outputs=[recording], **options)


KINDS = [(0, 1), (1, 2), (1, 3), (2, 3), (2, 6)]


@pytest.mark.parametrize(("dimension", "nodes"), KINDS)
def test_a_grid_is_read_back_to_the_last_bit(tmp_path: Path, dimension: int, nodes: int) -> None:
    random = np.random.default_rng(1)
    points = random.normal(size=(9, 3))
    cells = random.integers(0, 9, size=(7, nodes))
    arrays = {"stress1 [Pa]": random.normal(size=9), 'a "<&>" [m]': random.normal(size=(9, 3))}
    # Numbers that are compressed, and numbers that are not
    in_cells = {"state": np.ones(7), "direction": random.normal(size=(7, 3))}
    write_vtu(tmp_path / "a.vtu", Grid(points, cells, dimension, arrays, in_cells))
    grid = read_vtu(tmp_path / "a.vtu")
    assert grid.dimension == dimension
    assert (grid.points == points).all()
    assert (grid.cells == cells).all()
    for ours, theirs in ((arrays, grid.arrays), (in_cells, grid.cell_arrays)):
        assert list(theirs) == list(ours)
        assert all((theirs[name] == values).all() for name, values in ours.items())


def test_a_grid_without_cells_is_read_back(tmp_path: Path) -> None:
    """As a rank without cells writes."""
    nothing = Grid(
        np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64), 2, {"u [m]": np.zeros((0, 3))}
    )
    write_vtu(tmp_path / "a.vtu", nothing)
    assert len(read_vtu(tmp_path / "a.vtu").points) == 0


def triangle(path: Path) -> bytes:
    """The bytes of a file with one triangle."""
    write_vtu(path, Grid(np.eye(3), np.array([[0, 1, 2]]), 2, {"u [m]": np.arange(3.0)}))
    return path.read_bytes()


@pytest.mark.parametrize("cut", [0.1, 0.5, 0.9, 0.99])
def test_a_file_that_was_cut_is_refused(tmp_path: Path, cut: float) -> None:
    path = tmp_path / "a.vtu"
    whole = triangle(path)
    path.write_bytes(whole[: math.floor(cut * len(whole))])
    with pytest.raises(gx.InputError, match=r"a\.vtu' is missing or damaged"):
        read_vtu(path)


def test_a_strangers_file_is_read_or_refused_in_a_sentence(tmp_path: Path) -> None:
    """Each byte is changed in turn, and a declaration of XML is put in front."""
    path = tmp_path / "a.vtu"
    whole = triangle(path)
    refused = 0
    for position in range(len(whole)):
        for other in (0, ord("9"), 255):
            path.write_bytes(whole[:position] + bytes([other]) + whole[position + 1 :])
            try:
                read_vtu(path)
            except gx.InputError as error:
                refused += 1
                assert "\n" not in str(error)
                assert str(error).endswith(".")
    assert refused > len(whole)
    path.write_bytes(b'<!DOCTYPE a [<!ENTITY b SYSTEM "/etc/passwd">]>' + whole)
    with pytest.raises(gx.InputError, match="declarations"):
        read_vtu(path)


def test_a_list_that_names_a_file_elsewhere_is_refused(tmp_path: Path) -> None:
    write_pvd(tmp_path / "a.pvd", [Entry(0.0, 0, "../secret.vtu")])
    with pytest.raises(gx.InputError, match="outside its folder"):
        read_pvd(tmp_path / "a.pvd")


@pytest.mark.mpi(1)
@pytest.mark.parametrize("order", [1, 2])
def test_what_a_run_writes_is_the_same_to_its_reader(folder: Path, order: int) -> None:
    recorded(folder / "run", order).run(until=4 * DT)
    WORLD.barrier()
    run = gx.plot.RunReader(folder / "run")
    assert run.times == pytest.approx([0.0, 2 * DT, 4 * DT])
    for name, body in run.bodies.items():
        assert body.is_film == (name == "the film")
        for frame, time in enumerate(run.times):
            segment, step = body.at(frame)
            drift = [0.0, 0.0, SPEED * time]
            moved = segment.components("displacement", step)
            assert moved == pytest.approx(np.tile(drift, (len(moved), 1)), abs=1e-9)
            assert segment.positions(step) == pytest.approx(segment.X + drift, abs=1e-9)
    # The mesh that is written is that of the body: 12 triangles, each in four pieces at order 2.
    segment, step = run.bodies["the film"].at(0)
    assert len(segment.pieces) == 12 * order**2
    assert len(segment.grid(step).cells) == 12
    assert np.ptp(segment.X[:, 2]) == pytest.approx(0.0, abs=1e-12)
    corners = segment.X[segment.pieces]
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.linalg.norm(sides, axis=1).sum() / 2 == pytest.approx(1.0)
    assert segment.at_corners("state", step).shape == segment.pieces.shape


@pytest.mark.mpi
def test_a_restart_continues_the_list(folder: Path) -> None:
    saves = gx.Checkpoints(folder / "saves", every=4)
    recorded(folder / "run", checkpoints=saves).run(until=6 * DT)
    WORLD.barrier()
    recorded(folder / "run", restart=folder / "saves" / "step-00000004").run(until=8 * DT)
    WORLD.barrier()
    run = gx.plot.RunReader(folder / "run")
    assert run.times == pytest.approx(np.array([0, 2, 4, 6, 8]) * DT)
    files = list((folder / "run" / "fields" / "the film_files").iterdir())
    # Five records, and the mesh of the run and of its restart
    assert len(files) == 7 * WORLD.size


def test_a_list_of_another_run_is_refused_at_a_restart(tmp_path: Path) -> None:
    if WORLD.size > 1:
        pytest.skip("one rank is enough")
    saves = gx.Checkpoints(tmp_path / "saves", every=4)
    recorded(tmp_path / "run", checkpoints=saves).run(until=4 * DT)
    path = tmp_path / "run" / "fields" / "the film.pvd"
    write_pvd(path, read_pvd(path)[:1])
    with pytest.raises(gx.InputError, match="was replaced since the checkpoint"):
        recorded(tmp_path / "run", restart=tmp_path / "saves")


def test_pyvista_reads_the_files(tmp_path: Path) -> None:
    pyvista = pytest.importorskip("pyvista")
    if WORLD.size > 1:
        pytest.skip("one rank is enough")
    recorded(tmp_path / "run").run(until=4 * DT)
    reader = pyvista.get_reader(tmp_path / "run" / "fields" / "the film.pvd")
    assert reader.time_values == pytest.approx([0.0, 2 * DT, 4 * DT])
    reader.set_active_time_value(4 * DT)
    grid = reader.read()[0]
    assert grid.n_cells == 12
    assert grid["displacement [m]"][:, 2] == pytest.approx(SPEED * 4 * DT)
    assert grid.points[:, 2] == pytest.approx(SPEED * 4 * DT)


def test_the_recipe_for_pyvista_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The programs of the page, on a film between springs: by pyvista where it is at hand, and in
    any case by the reader of this package."""
    if WORLD.size > 1:
        pytest.skip("one rank is enough")
    page = (ROOT / "docs" / "howto" / "paraview.md").read_text(encoding="utf-8")
    [makes] = re.findall(r"^```python\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    [shows] = re.findall(r"^```text\n(import pyvista.*?)^```", page, re.DOTALL | re.MULTILINE)
    monkeypatch.chdir(tmp_path)
    exec(makes, {"__name__": "page"})
    listed = Path("out/hammock/vtu/run.pvd")
    assert str(listed) in shows
    of_last_time = listed.parent / read_pvd(listed)[-1].file
    scene = {name: read_vtu(of_last_time.parent / file) for name, file in parts_of(of_last_time)}
    assert list(scene) == ["film", "connectors"]
    for name, array in re.findall(r'scene\["(.*?)"\], scalars="(.*?)"', shows):
        assert array in {**scene[name].arrays, **scene[name].cell_arrays}
    # Four springs, shorter than their distance, lift a film of 0.14 kg with more than its weight.
    assert (scene["connectors"].cell_arrays["tension [N]"] > 0).all()
    assert scene["film"].arrays["displacement [m]"][:, 2].min() > 0.01
    pytest.importorskip("pyvista")
    exec(shows, {"__name__": "page"})
    assert Path("out/hammock/scene.png").stat().st_size > 10_000


def test_an_export_has_all_parts_of_the_scene(tmp_path: Path) -> None:
    if WORLD.size > 1:
        pytest.skip("one rank is enough")
    film = gx.Membrane(sheet(WORLD, 3, 2), LAW, velocity=drifting, name="the/film")
    ball = gx.PointMass(1.0, (0.0, 0.0, 1.0), comm=WORLD, velocity=(0.0, 0.0, SPEED))
    hub = gx.RigidBody(1.0, (1.0, 1.0, 1.0), comm=WORLD)
    box = gx.contact.Box(centre=(0.0, 0.0, 3.0), sizes=(0.1, 0.2, 0.3))
    scene = gx.Scene(film, ball, hub, gx.Contact(film, box, distance=1e-3, stiffness=1e3))
    recording = gx.Recording(tmp_path / "run", every=2)
    gx.Simulation(scene, gx.Midpoint(dt=DT), outputs=[recording]).run(until=4 * DT)
    run = gx.plot.RunReader(tmp_path / "run")
    scene = gx.plot.export(run, tmp_path / "out")
    entries = read_pvd(scene)
    assert [entry.time for entry in entries] == pytest.approx([0.0, 2 * DT, 4 * DT])
    listed = scene.parent / entries[-1].file
    last = {name: read_vtu(listed.parent / file) for name, file in parts_of(listed)}
    assert list(last) == ["the/film", "solids", "solid lines", "points"]
    assert len(last["the/film"].cells) == 12
    assert last["the/film"].arrays["displacement [m]"][:, 2] == pytest.approx(SPEED * 4 * DT)
    assert last["points"].dimension == 0
    assert pytest.approx(last["points"].points[:, 2].max()) == 1.0 + SPEED * 4 * DT
    # A second export replaces the first one, but nothing else is replaced.
    gx.plot.export(run, tmp_path / "out")
    with pytest.raises(gx.InputError, match="which is not part of an export; give another"):
        gx.plot.export(run, tmp_path / "run")


def names_of(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def test_an_export_leaves_nothing_of_an_earlier_one(tmp_path: Path) -> None:
    if WORLD.size > 1:
        pytest.skip("one rank is enough")
    recorded(tmp_path / "two bodies").run(until=4 * DT)
    ball = gx.PointMass(1.0, (0.0, 0.0, 1.0), comm=WORLD)
    film = gx.Membrane(sheet(WORLD, 3, 2), LAW, name="the film")
    recording = gx.Recording(tmp_path / "one film", every=1)
    run_until(DT, film, ball, dt=DT, outputs=[recording])
    later = gx.plot.RunReader(tmp_path / "one film")
    gx.plot.export(gx.plot.RunReader(tmp_path / "two bodies"), tmp_path / "out")
    gx.plot.export(later, tmp_path / "out")
    gx.plot.export(later, tmp_path / "fresh")
    assert names_of(tmp_path / "out") == names_of(tmp_path / "fresh")
    # An export that is ended has no list.
    (tmp_path / "out" / "run.pvd").unlink()
    gx.plot.export(later, tmp_path / "out")
    assert names_of(tmp_path / "out") == names_of(tmp_path / "fresh")
    (tmp_path / "out" / "run.pvd").unlink()
    (tmp_path / "out" / "run_files" / "mine.vtu").touch()
    with pytest.raises(gx.InputError, match="holds 'run_files', which is not part of an export"):
        gx.plot.export(later, tmp_path / "out")


def test_an_export_of_very_many_states_asks_how_many(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if WORLD.size > 1:
        pytest.skip("one rank is enough")
    recorded(tmp_path / "run").run(until=4 * DT)
    run = gx.plot.RunReader(tmp_path / "run")
    count = len(run.times)
    assert count == 3
    monkeypatch.setattr(vtk_export, "_MAX_STATES", 2)
    with pytest.raises(gx.InputError, match=rf"has {count} states, .* give every = \d"):
        gx.plot.export(run, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    listed = read_pvd(gx.plot.export(run, tmp_path / "out", every=3))
    assert [entry.time for entry in listed] == pytest.approx(run.times[[0, -1]])


def test_the_fields_of_a_body_named_run_are_no_export(tmp_path: Path) -> None:
    if WORLD.size > 1:
        pytest.skip("one rank is enough")
    bodies = [
        gx.Membrane(sheet(WORLD, 3, 2), LAW, name="run"),
        gx.Membrane(sheet(WORLD, 2, 2), LAW, name="other"),
    ]
    # A recording of a body with this name has a run.pvd, which is not that of an export.
    recording = gx.Recording(tmp_path / "run", every=1)
    gx.Simulation(gx.Scene(*bodies), gx.Midpoint(dt=DT), outputs=[recording]).run(until=DT)
    run = gx.plot.RunReader(tmp_path / "run")
    listed = read_pvd(gx.plot.export(run, tmp_path / "out"))
    assert len(listed) == len(run.times)
    assert [name for name, _ in parts_of(tmp_path / "out" / listed[0].file)] == ["run", "other"]
    with pytest.raises(gx.InputError, match="which is not part of an export"):
        gx.plot.export(run, tmp_path / "run" / "fields")


def test_a_folder_with_a_file_of_the_user_is_kept(tmp_path: Path) -> None:
    if WORLD.size > 1:
        pytest.skip("one rank is enough")
    recorded(tmp_path / "run").run(until=2 * DT)
    run = gx.plot.RunReader(tmp_path / "run")
    gx.plot.export(run, tmp_path / "out")
    (tmp_path / "out" / "notes.txt").write_text("mine")
    before = names_of(tmp_path / "out")
    with pytest.raises(gx.InputError, match=r"holds 'notes\.txt'"):
        gx.plot.export(run, tmp_path / "out")
    assert names_of(tmp_path / "out") == before
