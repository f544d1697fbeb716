"""The folder of a run from a stranger: links, FIFOs, files that claim to be huge, damaged tables.

Each reader gives a result or one sentence, takes memory in proportion to the bytes that exist, and
neither reads nor writes another file of the user."""

from __future__ import annotations

import csv
import errno
import fcntl
import io
import json
import os
import resource
import shutil
import struct
import time
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.core.checks.strange_files import LARGEST_EXPANSION, open_file, write_new
from gossamer_fx.core.forms import compilation
from gossamer_fx.core.mesh.geometry_files import check_geometry
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.records.outputs.vtu_format import Entry, Grid, read_vtu, write_pvd, write_vtu
from gossamer_fx.records.plot import curve_panels
from gossamer_fx.records.plot.watch import _Answers
from gossamer_fx.records.run.checkpoint import _checksum, _checksum_of, _page
from tests.small_scenes import LINEAR
from tests.unit.test_strange_recordings import record

ALONE = MPI.COMM_SELF

pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="files are read by one rank")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded") / "run"
    record(folder, "x")
    return folder


@pytest.fixture
def run(recorded: Path, tmp_path: Path) -> Path:
    """A copy of a run, to be damaged."""
    shutil.copytree(recorded, tmp_path / "run")
    return tmp_path / "run"


def look(run: Path, out: Path) -> dict[str, str]:
    """What report, plot, export and watch say about a run: a sentence, or nothing."""
    out.mkdir(exist_ok=True)

    def watch() -> None:
        answers = _Answers(run)
        found = [answers.answer(["progress"])]
        if answers._view is not None:
            version = str(answers._version)
            words = (["header"], ["legend", "0"], ["state", "0", "0"])
            found += [answers.answer([name, version, *rest]) for name, *rest in words]
        for answer in found:
            assert answer is not None
            message = json.loads(answer[1], parse_constant=pytest.fail).get("message")
            if message:
                raise gx.InputError(message)

    def export() -> None:
        shutil.rmtree(out / "vtu", ignore_errors=True)
        gx.plot.export(gx.plot.RunReader(run), out / "vtu")

    commands: dict[str, Callable[[], Any]] = {
        "report": lambda: gx.write_report(gx.plot.RunReader(run), out / "report.html"),
        "curves": lambda: gx.plot.curves(gx.plot.RunReader(run), out / "curves.png"),
        "strip": lambda: gx.plot.strip(
            gx.plot.RunReader(run), "state", path=out / "strip.png", count=2
        ),
        "export": export,
        "watch": watch,
    }
    said = {}
    for name, command in commands.items():
        said[name] = ""
        try:
            command()
        except gx.InputError as error:
            assert "\n" not in str(error) and str(error).endswith(".")
            said[name] = str(error)
    return said


# ---- links, and what is not a file ---------------------------------------------------------------


@pytest.mark.parametrize(
    "name", ["run.json", "ledger.csv", "fields/film x.pvd", "fields/film x_files/00001.vtu"]
)
def test_no_file_is_read_through_a_link_that_leads_out(
    run: Path, tmp_path: Path, name: str
) -> None:
    moved = tmp_path / "mine"
    (run / name).rename(moved)
    (run / name).symlink_to(moved)
    said = look(run, tmp_path / "out")
    for command in ("report", "watch"):
        assert "leads out of the folder" in said[command], said
    # A link within the folder is a file of the run.
    inside = run / "copy"
    moved.rename(inside)
    (run / name).unlink()
    (run / name).symlink_to(inside)
    assert not any(look(run, tmp_path / "out").values())


def test_no_folder_of_fields_is_read_through_a_link(run: Path, tmp_path: Path) -> None:
    (run / "fields").rename(tmp_path / "mine")
    (run / "fields").symlink_to(tmp_path / "mine")
    assert all("leads out of the folder" in words for words in look(run, tmp_path / "out").values())


@pytest.mark.parametrize(
    "name", ["ledger.csv", "fields/film x.pvd", "fields/film x_files/00001.vtu"]
)
def test_a_fifo_is_no_file(run: Path, tmp_path: Path, name: str) -> None:
    (run / name).unlink()
    os.mkfifo(run / name)
    said = look(run, tmp_path / "out")
    assert said["report"], said


def test_files_that_are_no_regular_ones_are_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "fifo")
    for path, kind in ((tmp_path / "fifo", "a FIFO"), (Path("/dev/zero"), "a device")):
        with pytest.raises(gx.InputError, match=f"is {kind}, not a regular file"):
            open_file(path)
    with pytest.raises(OSError, match=r"FIFO|No such device"):
        write_new(tmp_path / "fifo", b"words")


@pytest.mark.parametrize(
    "link", [".ledger.csv.try", "fields/film_files/00001.vtu", "fields/film.pvd.new", "ledger.csv"]
)
def test_a_run_that_replaces_another_writes_through_no_link(tmp_path: Path, link: str) -> None:
    def go(folder: Path, overwrite: bool) -> None:
        film = gx.Membrane(sheet(ALONE, 1, 1), LINEAR, name="film")
        recording = gx.Recording(folder, fields={"film": ["stress1"]}, overwrite=overwrite)
        gx.Simulation(gx.Scene(film), gx.Midpoint(dt=1e-3), outputs=[recording]).run(until=2e-3)

    folder = tmp_path / "run"
    go(folder, False)
    mine = tmp_path / "mine"
    mine.write_text("mine")
    (folder / link).unlink(missing_ok=True)
    (folder / link).symlink_to(mine)
    try:
        go(folder, True)
    except (gx.InputError, gx.OutputFailure) as error:
        assert "link" in str(error)
    assert mine.read_text() == "mine"


def test_a_restart_reads_through_no_link(tmp_path: Path) -> None:
    def go(restart: Path | None) -> None:
        ball = gx.PointMass(1.0, position=(0.0, 0.0, 1.0), comm=ALONE, name="ball")
        gx.Simulation(
            gx.Scene(ball),
            gx.Midpoint(dt=1e-3),
            checkpoints=gx.Checkpoints(tmp_path / "saves", overwrite=True),
            restart=restart,
        ).run(until=2e-3)

    go(None)
    share = tmp_path / "saves" / "step-00000002" / "rank-0000.npz"
    share.rename(tmp_path / "mine")
    share.symlink_to(tmp_path / "mine")
    with pytest.raises(gx.InputError, match="leads out of the folder"):
        go(tmp_path / "saves")


def test_a_file_system_that_refuses_locks_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A network file system without its lock daemon; and a lock file that is a link."""

    def refuse(descriptor: int, operation: int) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    ball = gx.PointMass(1.0, position=(0.0, 0.0, 1.0), comm=ALONE, name="ball")

    def go() -> None:
        ledger = gx.Ledger(tmp_path / "ledger.csv")
        gx.Simulation(gx.Scene(ball), gx.Midpoint(dt=1e-3), outputs=[ledger]).run(until=2e-3)

    with monkeypatch.context() as patch:
        patch.setattr("fcntl.flock", refuse)
        go()
    assert (tmp_path / "ledger.csv").read_text().count("\n") == 4
    (tmp_path / "mine").write_text("mine")
    (tmp_path / ".ledger.csv.lock").symlink_to(tmp_path / "mine")
    with pytest.raises(gx.InputError, match="cannot be locked by"):
        go()
    assert (tmp_path / "mine").read_text() == "mine"


def test_laws_are_compiled_where_the_cache_has_no_locks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*given: Any) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(compilation, "kernel_options", lambda: {"cache_dir": tmp_path / "kernels"})
    with compilation._lock(fcntl.LOCK_SH) as folder:
        assert folder == tmp_path / "kernels"
    unfinished = tmp_path / "kernels" / "libffcx_x.c"
    unfinished.touch()
    monkeypatch.setattr("fcntl.flock", refuse)
    with compilation._lock(fcntl.LOCK_SH) as folder:
        assert folder is None
    # Of another process, maybe.
    compilation._remove_unfinished()
    assert unfinished.exists()


def test_a_cache_that_cannot_be_made_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setattr(compilation, "kernel_options", lambda: {"cache_dir": tmp_path / "file/x"})
    with pytest.raises(gx.InputError, match=r"cannot be made .*; set XDG_CACHE_HOME"):
        compilation.private_cache()


# ---- sizes ---------------------------------------------------------------------------------------


def peak() -> float:
    """The largest memory of this process so far [bytes]."""
    return 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def test_a_small_file_that_claims_to_be_large_takes_no_memory(run: Path, tmp_path: Path) -> None:
    """2 MB of zlib for 2 GB of zeros."""
    path = run / "fields/film x_files/00001.vtu"
    squeezer = zlib.compressobj(9)
    parts = [squeezer.compress(bytes(2**24)) for _ in range(128)]
    packed = b"".join([*parts, squeezer.flush()])
    head = (
        b'<VTKFile><UnstructuredGrid><Piece><PointData><DataArray type="UInt8" Name="a" '
        b'NumberOfComponents="1" offset="0"/></PointData></Piece></UnstructuredGrid>'
        b'<AppendedData encoding="raw">\n_'
    )
    sizes = np.array([1, 2**31, 2**31, len(packed)], dtype="<u8").tobytes()
    path.write_bytes(head + sizes + packed + b"\n</AppendedData>\n</VTKFile>\n")
    before = peak()
    with pytest.raises(gx.InputError, match=f"more than {LARGEST_EXPANSION} times as many"):
        read_vtu(path)
    assert peak() - before < 3e8


@pytest.mark.parametrize("kind", ["ledger.csv", "run.json", "fields/film x.pvd"])
def test_a_file_of_holes_is_refused(run: Path, tmp_path: Path, kind: str) -> None:
    os.truncate(run / kind, 3 * 2**30)
    before = peak()
    said = look(run, tmp_path / "out")
    assert "claims to have 3221225472 bytes" in said["report"], said
    assert peak() - before < 3e8


def test_a_film_at_rest_is_read(tmp_path: Path) -> None:
    """The fields of an honest file shrink most where all are zero."""
    n = 200
    x, y = np.meshgrid(np.arange(n) / n, np.arange(n) / n)
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(n * n)])
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    cells = np.concatenate(
        [
            np.column_stack([corner, corner + 1, corner + n]),
            np.column_stack([corner + 1, corner + n, corner + n + 1]),
        ]
    )
    arrays = {f"field {k}": np.zeros((n * n, 3)) for k in range(10)}
    write_vtu(tmp_path / "a.vtu", Grid(points, cells.astype(np.int32), 2, arrays))
    assert len(read_vtu(tmp_path / "a.vtu").points) == n * n


def test_a_list_longer_than_its_files_is_refused(run: Path, tmp_path: Path) -> None:
    entries = [Entry(float(k), 0, "film x_files/00001.vtu") for k in range(100_000)]
    write_pvd(run / "fields/film x.pvd", entries)
    assert "lists 'film x_files/00001.vtu' twice" in look(run, tmp_path / "out")["report"]
    entries = [Entry(float(k), 0, f"film x_files/{k + 10}.vtu") for k in range(100_000)]
    write_pvd(run / "fields/film x.pvd", entries)
    assert "is missing" in look(run, tmp_path / "out")["report"]


def test_a_geometry_of_many_solids_is_refused_before_it_is_read(tmp_path: Path) -> None:
    """20 000 boxes, which take gmsh hours, and a part of them with a time that is long enough."""
    path = tmp_path / "boxes.step"
    face = b"#1 = ADVANCED_FACE('',(#2),#3,.T.);\n"
    box = b"#4 = MANIFOLD_SOLID_BREP('box',#5);\n" + 6 * face
    path.write_bytes(b"ISO-10303-21;\n" + 20_000 * box)

    def build(model: Any) -> None:
        import gmsh

        gmsh.merge(str(path))

    before = time.monotonic()
    with pytest.raises(gx.InputError, match=r"20000 solids with 120000 faces, .* take gmsh about"):
        gx.gmsh_mesh(build, ALONE)
    assert time.monotonic() - before < 10.0
    check_geometry(path, 300.0, has_names=False)
    with pytest.raises(gx.InputError, match=r"about 2.4e.02 s, more than the 100 s"):
        check_geometry(path, 100.0, has_names=False)


def test_triangles_without_neighbours_are_refused(tmp_path: Path) -> None:
    """A damaged STL file; dolfinx took minutes for it."""
    triangles = np.zeros(50_000, dtype=[("normal", "<f4", 3), ("X", "<f4", 9), ("rest", "<u2")])
    triangles["X"] = np.random.default_rng(1).random((len(triangles), 9))
    path = tmp_path / "a.stl"
    path.write_bytes(bytes(80) + struct.pack("<I", len(triangles)) + triangles.tobytes())

    def build(model: Any) -> None:
        import gmsh

        gmsh.merge(str(path))

    before = time.monotonic()
    with pytest.raises(gx.InputError, match="falls into 50000 parts or more"):
        gx.gmsh_mesh(build, ALONE)
    assert time.monotonic() - before < 10.0
    with pytest.raises(gx.InputError, match=r"2500084 bytes in all, .* about 2 s, more than the 1"):
        check_geometry(path, 1.0)
    path.write_text("solid a\n" + 60_000 * "outer loop\nsolid b\n")
    with pytest.raises(gx.InputError, match="60000 solids with 60000 faces"):
        check_geometry(path, 120.0)


def test_gmsh_opens_regular_files_only(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "fifo.stl")

    def build(model: Any) -> None:
        model.occ.importShapes(str(tmp_path / "fifo.stl"))

    with pytest.raises(gx.InputError, match="is a FIFO"):
        gx.gmsh_mesh(build, ALONE)


@pytest.mark.parametrize("way", ["./film x_files", "film x_files/.", "film x_files//."])
def test_a_file_has_one_name_in_a_list(run: Path, tmp_path: Path, way: str) -> None:
    """Each folder is listed once, and a file has any number of names."""
    entries = [Entry(0.0, 0, "film x_files/00000.vtu"), Entry(1.0, 0, f"{way}/00000.vtu")]
    write_pvd(run / "fields/film x.pvd", entries)
    said = look(run, tmp_path / "out")["report"]
    assert f"names '{way}/00000.vtu' as no run does" in said, said


def altered(saves: Path, change: Callable[[dict[str, Any], Path], None]) -> None:
    """Change a checkpoint, and set its checksums as a stranger would."""
    newest = gx.run.latest_checkpoint(saves)
    assert newest is not None
    state = json.loads((newest / "run.json").read_text())
    change(state, newest)
    state["parts"] = [_checksum(newest / "rank-0000.npz")]
    del state["checksum"]
    state["checksum"] = _checksum_of(state)
    (newest / "run.json").write_bytes(_page(state))


def declared(shape: tuple[int, ...]) -> bytes:
    """The head of a file of NumPy that says a shape, without numbers."""
    head = repr({"descr": "<f8", "fortran_order": False, "shape": shape}).encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head) + 1) + head + b"\n"


def with_huge_array(state: dict[str, Any], folder: Path) -> None:
    with zipfile.ZipFile(folder / "rank-0000.npz", "w") as archive:
        archive.writestr("names 0.npy", declared((2**40,)))


def with_compressed_array(state: dict[str, Any], folder: Path) -> None:
    with zipfile.ZipFile(folder / "rank-0000.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("names 0.npy", declared((2**27,)) + bytes(2**27))


def with_encrypted_array(state: dict[str, Any], folder: Path) -> None:
    share = folder / "rank-0000.npz"
    content = bytearray(share.read_bytes())
    # The bits of a member in its own head and in the list at the end.
    for head, place in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        content[content.index(head) + place] |= 1
    share.write_bytes(content)


def with_nan(state: dict[str, Any], folder: Path) -> None:
    with np.load(folder / "rank-0000.npz") as file:
        arrays = dict(file)
    name = next(name for name in arrays if not name.startswith("names"))
    arrays[name] = np.full_like(arrays[name], np.nan)
    np.savez(folder / "rank-0000.npz", **arrays)


def with_other_history(state: dict[str, Any], folder: Path) -> None:
    state["run"] = {"step": []}


def with_other_time(state: dict[str, Any], folder: Path) -> None:
    state["time"] = "noon"


@pytest.mark.parametrize(
    "change",
    [
        with_huge_array,
        with_compressed_array,
        with_encrypted_array,
        with_nan,
        with_other_history,
        with_other_time,
    ],
)
def test_a_checkpoint_of_a_stranger_is_checked(
    tmp_path: Path, change: Callable[[dict[str, Any], Path], None]
) -> None:
    def go(restart: Path | None) -> None:
        ball = gx.PointMass(1.0, position=(0.0, 0.0, 1.0), comm=ALONE, name="ball")
        saves = gx.Checkpoints(tmp_path / "saves", overwrite=True)
        scene = gx.Scene(ball, gx.Gravity(ball, (0.0, 0.0, -9.81)))
        run = gx.Simulation(scene, gx.Midpoint(dt=1e-3), checkpoints=saves, restart=restart)
        run.run(until=2e-3)

    go(None)
    altered(tmp_path / "saves", change)
    before = peak()
    with pytest.raises(gx.InputError, match=r"is damaged|must be") as caught:
        go(tmp_path / "saves")
    assert "\n" not in str(caught.value)
    assert peak() - before < 3e8


# ---- damaged tables ------------------------------------------------------------------------------


def damage(path: Path, value: str, first: int) -> None:
    """Replace the last row of a table from a column on."""
    rows = list(csv.reader(io.StringIO(path.read_text())))
    rows[-1][first:] = [value] * (len(rows[-1]) - first)
    with path.open("w", newline="") as file:
        csv.writer(file).writerows(rows)


@pytest.mark.parametrize("name", ["ledger", "probes", "points", "states", "gas"])
def test_a_table_with_its_head_alone_is_one_without_rows(
    run: Path, tmp_path: Path, name: str
) -> None:
    path = run / f"{name}.csv"
    path.write_text(path.read_text().splitlines()[0] + "\n")
    said = look(run, tmp_path / "out")
    assert bool(said["report"]) == (name == "ledger"), said


@pytest.mark.parametrize("value", ["nan", "inf", "1e308"])
@pytest.mark.parametrize("first", [0, 2], ids=["all", "values"])
@pytest.mark.parametrize("name", ["ledger", "probes", "points"])
def test_what_is_no_usual_number_is_told(
    run: Path, tmp_path: Path, name: str, first: int, value: str
) -> None:
    damage(run / f"{name}.csv", value, first)
    said = look(run, tmp_path / "out")
    # A probe may be unknown at a time.
    is_harmless = name == "probes" and first and value == "nan"
    assert is_harmless or "is not a number up to 1e100" in said["report"] + said["curves"], said


def test_a_number_that_cannot_be_drawn_is_told(run: Path, tmp_path: Path) -> None:
    path = run / "fields/film x_files/00001.vtu"
    grid = read_vtu(path)
    for value in (np.nan, np.inf, 1e308):
        points = grid.points.copy()
        points[0] = value
        write_vtu(path, Grid(points, grid.cells.astype(np.int32), 2, grid.arrays))
        assert "is not at numbers up to 1e100 m" in look(run, tmp_path / "out")["report"]


@pytest.mark.parametrize("summary", [7, None, [], {}, True])
def test_a_summary_is_a_text(run: Path, tmp_path: Path, summary: Any) -> None:
    about = json.loads((run / "run.json").read_text())
    (run / "run.json").write_text(json.dumps(about | {"summary": summary}))
    assert "'summary' is" in look(run, tmp_path / "out")["report"]


@pytest.mark.parametrize("key", ["title", "captions", "fields"])
def test_a_text_has_a_largest_length(run: Path, tmp_path: Path, key: str) -> None:
    """matplotlib took minutes to draw it."""
    long = "x" * 100_000
    value = {"title": long, "captions": [long], "fields": {long: []}}[key]
    about = json.loads((run / "run.json").read_text())
    (run / "run.json").write_text(json.dumps(about | {key: value}))
    said = look(run, tmp_path / "out")
    assert all("a text of at most 5000 characters" in words for words in said.values()), said


def test_a_column_has_a_largest_name(run: Path, tmp_path: Path) -> None:
    path = run / "probes.csv"
    path.write_text(path.read_text().replace(",", f",{100_000 * 'x'}", 1))
    assert "a name of more than 5000 characters" in look(run, tmp_path / "out")["curves"]


def test_a_table_has_a_largest_number_of_columns(run: Path, tmp_path: Path) -> None:
    (run / "ledger.csv").write_text(",".join(f"x{k}" for k in range(300_001)) + "\n")
    said = look(run, tmp_path / "out")["report"]
    assert "it has 300001 columns, more than 300000" in said, said


def test_hundreds_of_probes_share_panels() -> None:
    """Each panel takes a third of a second, so that 300 took minutes."""
    values = np.linspace(0.0, 1.0, 3)
    few = {f"p{i} [m]": {"": values} for i in range(5)}
    assert curve_panels._few(few) == few
    many = {f"p{i} [m]": {"": i * values} for i in range(300)} | {"q [N]": {"x": values}}
    panels = curve_panels._few(many)
    assert [(title, len(curves)) for title, curves in panels.items()] == [
        ("300 probes [m]", 300),
        ("q [N] x", 1),
    ]
    assert len(curve_panels._in_bands(panels["300 probes [m]"])) == 3
    units = {f"p{i} [{i}]": {"": values} for i in range(300)}
    panels = curve_panels._few(units)
    assert len(panels) == 9 and sum(map(len, panels.values())) == 300


@pytest.mark.parametrize("file", ["film_files/../../a.vtu", "/a.vtu", "..", "film_files/none.vtu"])
def test_a_list_names_files_of_its_folder(run: Path, tmp_path: Path, file: str) -> None:
    listed = next((run / "fields").glob("*.pvd"))
    text = listed.read_text()
    first = text.index('file="') + 6
    listed.write_text(text[:first] + file + text[text.index('"', first) :])
    said = look(run, tmp_path)["report"]
    assert "outside its folder" in said or "is missing" in said
