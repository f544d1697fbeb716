"""VTU and PVD files: what is written is read back, also after a restart and on several ranks."""

from __future__ import annotations

import math
from pathlib import Path

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

WORLD = MPI.COMM_WORLD
LAW = gx.Miyazaki(E=1e9, nu=0.3, density=1400.0, thickness=1e-4)
DT = 1e-3
SPEED = 0.5


def drifting(x: np.ndarray) -> np.ndarray:
    velocity = np.zeros((3, x.shape[1]))
    velocity[2] = SPEED
    return velocity


def recorded(
    folder: Path,
    format: str = "vtu",
    order: int = 1,
    **options: object,
) -> gx.Simulation:
    """A film and a cable that drift along z; the run is ready to start."""
    film = gx.Membrane(
        sheet(WORLD, 3, 2),
        LAW,
        order=order,
        velocity=drifting,
        name="the film",
    )
    curve = line(
        WORLD,
        [(0, 0, 1), (1, 0, 1)],
        3,
    )
    cable = gx.Cable(
        curve,
        gx.CableLaw(1e5, 0.1),
        velocity=drifting,
        name="cable",
    )
    fields = {"the film": ("stress1", "displacement", "state", "direction")}
    recording = gx.Recording(folder, fields, every=2, format=format)
    return gx.Simulation(
        gx.Scene(film, cable),
        gx.Midpoint(dt=DT),
        outputs=[recording],
        **options,
    )


def test_a_grid_is_read_back_to_the_last_bit(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    points = random.normal(size=(5, 3))
    arrays = {
        "stress1 [Pa]": random.normal(size=5),
        'a "<&>" [m]': random.normal(size=(5, 3)),
    }
    for nodes_of_cell in (1, 2, 3):
        cells = random.integers(0, 5, size=(7, nodes_of_cell))
        write_vtu(tmp_path / "a.vtu", Grid(points, cells, arrays))
        grid = read_vtu(tmp_path / "a.vtu")
        assert (grid.points == points).all()
        assert (grid.cells == cells).all()
        assert list(grid.arrays) == list(arrays)
        assert all((grid.arrays[name] == values).all() for name, values in arrays.items())


def test_a_grid_without_cells_is_read_back(tmp_path: Path) -> None:
    """As a rank without cells writes."""
    nothing = Grid(
        np.zeros((0, 3)),
        np.zeros((0, 3), dtype=np.int64),
        {"u [m]": np.zeros((0, 3))},
    )
    write_vtu(tmp_path / "a.vtu", nothing)
    assert len(read_vtu(tmp_path / "a.vtu").points) == 0


@pytest.mark.parametrize("cut", [0.1, 0.5, 0.9, 0.99])
def test_a_file_that_was_cut_is_refused(tmp_path: Path, cut: float) -> None:
    path = tmp_path / "a.vtu"
    write_vtu(path, Grid(np.eye(3), np.array([[0, 1, 2]]), {}))
    text = path.read_text()
    path.write_text(text[: math.floor(cut * len(text))])
    with pytest.raises(gx.InputError, match=r"a\.vtu' is missing or damaged"):
        read_vtu(path)


def test_a_list_that_names_a_file_elsewhere_is_refused(tmp_path: Path) -> None:
    write_pvd(tmp_path / "a.pvd", [Entry(0.0, 0, "../secret.vtu")])
    with pytest.raises(gx.InputError, match="outside its folder"):
        read_pvd(tmp_path / "a.pvd")


@pytest.mark.mpi
@pytest.mark.parametrize("order", [1, 2])
def test_a_run_in_either_format_is_the_same_to_its_reader(folder: Path, order: int) -> None:
    for format in ("vtx", "vtu"):
        recorded(folder / format, format, order).run(until=4 * DT)
    WORLD.barrier()
    one = gx.plot.RunReader(folder / "vtx")
    other = gx.plot.RunReader(folder / "vtu")
    assert (one.times == other.times).all()
    for name, body in one.bodies.items():
        same = other.bodies[name]
        assert body.is_film == same.is_film
        for frame in range(len(one.times)):
            first, step = body.at(frame)
            second, _ = same.at(frame)
            # Ranks may list their points in another order.
            a = first.positions(step)[first.pieces].mean(axis=1)
            b = second.positions(step)[second.pieces].mean(axis=1)
            assert len(a) == len(b)
            by_place = np.lexsort(np.round(a, 9).T)
            same_by_place = np.lexsort(np.round(b, 9).T)
            assert a[by_place] == pytest.approx(b[same_by_place], abs=1e-12)
            drift = SPEED * one.times[frame]
            assert second.read("displacement", step) == pytest.approx(drift, abs=1e-9)
    # The mesh that is written is that of the body: 12 triangles, each in four pieces at order 2.
    segment, _ = other.bodies["the film"].at(0)
    assert len(segment.pieces) == 12 * order**2
    assert np.ptp(segment.X[:, 2]) == pytest.approx(0.0, abs=1e-12)


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
    assert len(files) == 5 * WORLD.size


def test_a_list_of_another_run_is_refused_at_a_restart(tmp_path: Path) -> None:
    if WORLD.size > 1:
        pytest.skip("one rank is enough")
    saves = gx.Checkpoints(tmp_path / "saves", every=4)
    recorded(tmp_path / "run", checkpoints=saves).run(until=4 * DT)
    path = tmp_path / "run" / "fields" / "the film.pvd"
    write_pvd(path, read_pvd(path)[:1])
    with pytest.raises(gx.InputError, match="was replaced since the checkpoint"):
        recorded(tmp_path / "run", restart=tmp_path / "saves")


def test_an_unknown_format_is_refused() -> None:
    with pytest.raises(gx.InputError, match='format is \'xdmf\'; give "vtx" or "vtu"'):
        gx.Recording("out", format="xdmf")


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


@pytest.mark.parametrize("format", ["vtx", "vtu"])
def test_an_export_has_all_parts_of_the_scene(tmp_path: Path, format: str) -> None:
    if WORLD.size > 1:
        pytest.skip("one rank is enough")
    film = gx.Membrane(
        sheet(WORLD, 3, 2),
        LAW,
        velocity=drifting,
        name="the/film",
    )
    ball = gx.PointMass(
        1.0,
        (0.0, 0.0, 1.0),
        comm=WORLD,
        velocity=(0.0, 0.0, SPEED),
    )
    hub = gx.RigidBody(1.0, (1.0, 1.0, 1.0), comm=WORLD)
    box = gx.contact.Box(centre=(0.0, 0.0, 3.0), sizes=(0.1, 0.2, 0.3))
    scene = gx.Scene(
        film,
        ball,
        hub,
        gx.Contact(film, box, distance=1e-3, stiffness=1e3),
    )
    recording = gx.Recording(tmp_path / "run", every=2, format=format)
    gx.Simulation(scene, gx.Midpoint(dt=DT), outputs=[recording]).run(until=4 * DT)
    run = gx.plot.RunReader(tmp_path / "run")
    lists = gx.plot.export(run, tmp_path / "out")
    assert [path.name for path in lists][:2] == ["run.pvd", "the%2Ffilm.pvd"]
    entries = read_pvd(tmp_path / "out" / "run.pvd")
    assert sorted({entry.time for entry in entries}) == pytest.approx([0.0, 2 * DT, 4 * DT])
    parts = len(lists) - 1
    assert len(entries) == 3 * parts
    last = [read_vtu(tmp_path / "out" / entry.file) for entry in entries[-parts:]]
    assert len(last[0].cells) == 12
    assert last[0].arrays["displacement [m]"][:, 2] == pytest.approx(SPEED * 4 * DT)
    dots = last[-1]
    assert dots.cells.shape[1] == 1
    assert pytest.approx(dots.points[:, 2].max()) == 1.0 + SPEED * 4 * DT
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
    short = gx.Simulation(gx.Scene(film, ball), gx.Midpoint(dt=DT), outputs=[recording])
    short.run(until=DT)
    later = gx.plot.RunReader(tmp_path / "one film")
    gx.plot.export(gx.plot.RunReader(tmp_path / "two bodies"), tmp_path / "out")
    gx.plot.export(later, tmp_path / "out")
    gx.plot.export(later, tmp_path / "fresh")
    assert names_of(tmp_path / "out") == names_of(tmp_path / "fresh")


def test_a_body_named_run_has_its_own_list(tmp_path: Path) -> None:
    if WORLD.size > 1:
        pytest.skip("one rank is enough")
    bodies = [
        gx.Membrane(sheet(WORLD, 3, 2), LAW, name="run"),
        gx.Membrane(sheet(WORLD, 2, 2), LAW, name="other"),
    ]
    # A recording of a body with this name has a run.pvd, which is not that of an export.
    recording = gx.Recording(tmp_path / "run", every=1, format="vtu")
    gx.Simulation(gx.Scene(*bodies), gx.Midpoint(dt=DT), outputs=[recording]).run(until=DT)
    run = gx.plot.RunReader(tmp_path / "run")
    lists = gx.plot.export(run, tmp_path / "out")
    assert [path.name for path in lists] == ["run.pvd", "%72un.pvd", "other.pvd"]
    assert len(read_pvd(lists[0])) == 2 * len(run.times)
    assert len(read_pvd(lists[1])) == len(run.times)
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
