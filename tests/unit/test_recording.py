"""The folder of a run, and what is drawn from it: values, pictures, curves, animation, report."""

from __future__ import annotations

import json
import math
import re
import resource
import shutil
from base64 import b64decode
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.extend import Output
from gossamer_fx.meshes.airbag import airbag
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.records.outputs.output import replace_file
from gossamer_fx.records.outputs.tables import Table
from gossamer_fx.records.plot import report
from gossamer_fx.records.plot.colours import NO_LIMITS, Scale, scale
from gossamer_fx.records.plot.curve_panels import grouped
from gossamer_fx.records.plot.viewer import RunView

WORLD = MPI.COMM_WORLD
AIR = gx.IdealGas(gamma=1.4, R=287.0)
V0 = np.array([1.0, 2.0, 0.5])
DT = 1e-3


def moving(x: np.ndarray) -> np.ndarray:
    return np.repeat(V0[:, None], x.shape[1], axis=1)


def pillow(comm: MPI.Intracomm, order: int = 1) -> gx.Case:
    """A pillow full of gas, a cable and a point, all with the same velocity."""
    law = gx.Miyazaki(E=1e9, nu=0.3, density=1400.0, thickness=1e-4)
    film = gx.Membrane(airbag(comm, 1.0, 4), law, order=order, velocity=moving, name="the film")
    bag = gx.Chamber(film, gas=AIR, pressure=1e-3, temperature=300.0, dead_volume=1e-3, name="bag")
    cable = gx.Cable(line(comm, [(0, 0, 1), (1, 0, 1)], 3), gx.CableLaw(1e5, 0.1), velocity=moving)
    ball = gx.PointMass(1.0, (0.5, 0.5, 2.0), velocity=tuple(V0), name="ball")
    return gx.Case(
        gx.Scene(film, bag, cable, ball),
        gx.Midpoint(dt=DT),
        until=10 * DT,
        title="A <pillow>",
        probes={"x of the ball": gx.probes.Position(ball.port(), "x")},
        frames=5,
    )


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder: Path = WORLD.bcast(tmp_path_factory.mktemp("run"))
    case = pillow(WORLD)
    case.simulation([case.recording(folder)]).run(until=case.until)
    return folder


@pytest.mark.mpi
def test_what_was_recorded_is_read_back(recorded: Path) -> None:
    run = gx.plot.RunReader(recorded)
    assert run.title == "A <pillow>" and run.about["status"] == "finished"
    assert set(run.bodies) == {"the film", "cable"} and run.films == ["the film"]
    assert run.times == pytest.approx(np.arange(0, 12, 2) * DT)
    for name, body in run.bodies.items():
        for frame, t in enumerate(run.times):
            segment, k = body.at(frame)
            assert segment.positions(k) - segment.X == pytest.approx(
                np.tile(V0 * t, (len(segment.X), 1)), abs=1e-5
            )
        cells = run.about["scene"]["bodies"][name]["cells"]
        assert len(body.segments[0].pieces) == cells == (64 if name == "the film" else 3)
    assert (
        len(np.unique(run.bodies["the film"].segments[0].vertices)) == 34
    )  # 2 × 25 nodes, 16 of them on the seam
    assert run.table("points.csv")["ball z"] == pytest.approx(
        2.0 + 0.5 * run.table("points.csv")["time"]
    )
    assert run.table("probes.csv")["x of the ball"][-1] == pytest.approx(0.5 + 10 * DT)
    assert run.values("pressure", 5)[0] == pytest.approx(
        run.table("gas.csv")["bag pressure"][-1], rel=1e-12
    )
    assert run.values("displacement", 5)[0] == pytest.approx(np.linalg.norm(V0) * 10 * DT, rel=1e-3)
    assert len(run.table("ledger.csv")["time"]) == 11 and run.table("no.csv") == {}


def test_heads_have_units(tmp_path: Path) -> None:
    """In the files; the reader knows the columns without.  A restart refuses other columns."""
    comm = MPI.COMM_SELF
    case = pillow(comm)
    case.simulation([case.recording(tmp_path)]).run(until=DT)
    for name, column in (("ledger.csv", "kinetic [J]"), ("gas.csv", "bag pressure [Pa]")):
        lines = (tmp_path / name).read_text(encoding="utf-8").splitlines(keepends=True)
        head = lines[0].strip().split(",")
        assert column in head
        assert column.partition(" [")[0] in gx.plot.RunReader(tmp_path).table(name)
        cursor = {"end": (tmp_path / name).stat().st_size, "rows": len(lines) - 1}
        Table(tmp_path / name).cut(comm, head, cursor)
        with pytest.raises(gx.InputError, match="has other columns than this run"):
            Table(tmp_path / name).cut(comm, [*head, "more"], cursor)


@pytest.mark.mpi
def test_a_restart_on_other_ranks_is_one_run(folder: Path) -> None:
    """Half on one rank, each on its own folder; the rest on all: the films of both halves are read
    as one."""
    case = pillow(WORLD)
    saved = gx.Checkpoints(folder / "checkpoints", every=4)
    first = case.simulation([case.recording(folder)], saved)
    first.run(until=4 * DT)
    case = pillow(WORLD)
    second = case.simulation([case.recording(folder)], restart=folder / "checkpoints")
    second.run(until=10 * DT)
    run = gx.plot.RunReader(folder)
    assert run.times == pytest.approx(np.arange(0, 12, 2) * DT)
    assert len(run.bodies["the film"].segments) == 2
    view = RunView(run).whole()
    assert [state["mesh"] for state in view["states"]] == [0, 0, 0, 1, 1, 1]


def test_a_checkpoint_that_lacks_a_file_is_refused_by_its_name(tmp_path: Path) -> None:
    """As one of a version that did not write this file."""
    case = pillow(MPI.COMM_SELF)
    recording = case.recording(tmp_path)
    run = case.simulation([recording])
    cursor = recording.cursor()
    del cursor["ledger.csv"]
    with pytest.raises(gx.InputError, match=r"no position in 'ledger.csv'.*start the run again"):
        recording.resume(run, cursor)


@pytest.mark.parametrize("order", [1, 2])
def test_films_of_either_order_are_seen(tmp_path: Path, order: int) -> None:
    case = pillow(MPI.COMM_SELF, order)
    case.simulation([case.recording(tmp_path)]).run(until=2 * DT)
    run = gx.plot.RunReader(tmp_path)
    shape = run.shape(1, "state", lambda values: np.rint(values).astype(int))
    edges = shape.corners[:, 1:] - shape.corners[:, :1]
    assert np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).sum() / 2 == pytest.approx(
        2.0, rel=1e-4
    )
    assert len(shape.lines) == 3 and shape.dots == pytest.approx(
        np.array([[0.5, 0.5, 2.0]]) + V0 * 2 * DT
    )


def test_pictures_and_animation(recorded: Path, tmp_path: Path) -> None:
    from PIL import Image

    run = gx.plot.RunReader(recorded)
    gx.plot.strip(run, "stress1", path=tmp_path / "new" / "strip.png", count=3)
    gx.plot.field(run, "displacement", times=[0.0, 10 * DT], path=tmp_path / "field.png")
    gx.plot.curves(run, tmp_path / "curves.png")
    for name in ("new/strip.png", "field.png", "curves.png"):
        with Image.open(tmp_path / name) as image:
            pixels = np.asarray(image.convert("RGB"))
        assert pixels.shape[1] == 1800 and 0.01 < (pixels < 250).any(axis=2).mean() < 0.9
    gx.plot.animate(run, "state", path=tmp_path / "run.gif", seconds=1.0)
    with Image.open(tmp_path / "run.gif") as image:
        assert image.n_frames == 6 and image.info["duration"] == pytest.approx(1000 / 6, abs=10)
        wide = image.size
    gx.plot.animate(run, "state", path=tmp_path / "run.gif", seconds=1.0, until=5 * DT, pixels=480)
    with Image.open(tmp_path / "run.gif") as image:
        # Records every second step until half of the run.
        assert image.n_frames == 3 and image.size[0] < 0.9 * wide[0]
    with pytest.raises(gx.InputError, match=r"give a name that ends in \.gif"):
        gx.plot.animate(run, "state", path=tmp_path / "run.mp4")


def test_pictures_from_a_chosen_place(recorded: Path, tmp_path: Path) -> None:
    """From above a flat scene is as deep as it is; each picture may fill its frame; a camera may
    follow."""
    from PIL import Image

    from gossamer_fx.records.plot.camera import aim
    from gossamer_fx.records.plot.shapes import Shape

    run = gx.plot.RunReader(recorded)

    def square(size: float, x: float) -> Shape:
        corners = np.array(
            [[x, 0, 0], [x + size, 0, 0], [x + size, size, 0], [x, size, 0]], dtype=float
        )
        return Shape(0.0, dots=corners)

    shapes = [square(1.0, 0.0), square(0.1, 5.0)]
    above = aim(shapes, gx.plot.View(azimuth=0.0, elevation=math.pi / 2, follow=False))
    assert above.size == pytest.approx((5.1 * 1.02, 0.2 * 5.1 + 0.02 * 5.1))
    assert above.axes == pytest.approx(np.eye(3), abs=1e-12) and above.zooms == [1.0, 1.0]
    each = aim(shapes, gx.plot.View(azimuth=0.0, elevation=math.pi / 2, zoom=True))
    assert each.size == pytest.approx((1.02, 1.02)) and each.zooms == pytest.approx(
        [1.0, 1.02 / 0.12]
    )
    assert each.centres[1] == pytest.approx((5.05, 0.05))
    gx.plot.strip(
        run,
        "state",
        path=tmp_path / "strip.png",
        count=3,
        view=gx.plot.View(elevation=0.5, zoom=True),
    )
    gx.plot.animate(
        run,
        "state",
        path=tmp_path / "run.gif",
        seconds=0.2,
        view=gx.plot.View(azimuth=1.0, follow=True),
    )
    with Image.open(tmp_path / "run.gif") as image:
        assert image.n_frames >= 2


def test_the_report_needs_nothing_else(recorded: Path, tmp_path: Path) -> None:
    run = gx.plot.RunReader(recorded)
    gx.write_report(run, tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text()
    # The one address in the library is the name of a language; a policy lets the page load nothing.
    library = Path(report.__file__).with_name("three.min.js").read_text(encoding="utf-8")
    assert library.count("http") == library.count("http://www.w3.org/1999/xhtml") == 1
    assert library in text
    without_images = re.sub(r"base64,[^\"]*", "", text.replace(library, ""))
    assert not re.search(r'(src|href)="(?!data:)', text)
    assert not re.search("http(?!-equiv=)", without_images)
    assert "A &lt;pillow&gt;" in text and "<h1>A <pillow>" not in text
    assert text.count("data:image/png;base64,") == 1
    data = json.loads(re.search(r'id="run-data">(.*?)</script>', text, re.DOTALL)[1])
    header = data["header"]
    assert len(header["labels"]) == len(data["states"]) == 6
    assert header["fields"][0] == "State of the film"
    [parts] = header["meshes"]
    vertices = {part["name"]: len(b64decode(part["start"])) // 12 for part in parts}
    assert vertices == {"the film": 34, "cable": 4, "ball": 1}


def test_large_films_are_thinned_for_the_view(
    recorded: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "gossamer_fx.records.plot.viewer._MAX_VERTICES", 1
    )  # at least 100 a body are kept in any case
    film, *_ = RunView(gx.plot.RunReader(recorded)).header([0], [])["meshes"][0]
    assert len(b64decode(film["start"])) == 34 * 12
    from gossamer_fx.records.plot.viewer import _thinned

    segment = gx.plot.RunReader(recorded).bodies["the film"].segments[0]
    thin = _thinned(segment, 20)
    assert 4 <= len(thin.points) <= 20 and thin.pieces.max() < len(thin.points)


def scale_of(field: str, values: np.ndarray) -> Scale:
    """The scale of all values of a field."""
    extremes = (float(values.min(initial=0.0)), float(values.max(initial=0.0)))
    return scale(field, values, extremes, NO_LIMITS)


def test_scales_show_what_matters() -> None:
    even = np.linspace(0, 1, 1001)
    assert scale_of("stress1", 3e6 * even).label == (1e6, "Larger principal stress (Cauchy) [MPa]")
    assert scale_of("stress1", 3e6 * even - 1.0).low == 0.0
    signed = scale_of("stress2", 3.0 * even - 1.0)
    assert signed.signed and signed.low == -signed.high
    assert scale_of("strain2", -even).high == 0.0
    assert scale_of("pressure", np.zeros(0)).parts(np.array([1.0])) == 0


@pytest.mark.parametrize(
    "act, culprit",
    [
        (lambda run: gx.plot.strip(run, "stres", path="x.png"), "stres"),
        (lambda run: gx.plot.strip(run, "state", path="x.png", count=0), "count is 0"),
        (lambda run: gx.plot.field(run, "state", times=[1.0], path="x.png"), "t = 1 s"),
        (lambda run: gx.plot.animate(run, "state", path="x.avi"), ".gif"),
        (lambda run: gx.plot.animate(run, "state", path="x.gif", seconds=0.0), "0.0 s"),
        (lambda run: gx.plot.animate(run, "state", path="x.gif", until=-1.0), "give a later time"),
        (lambda run: gx.plot.RunReader("nowhere"), "nowhere"),
    ],
)
def test_what_cannot_be_plotted_is_told(recorded: Path, act, culprit: str) -> None:
    with pytest.raises(gx.InputError, match=re.escape(culprit)) as caught:
        act(gx.plot.RunReader(recorded))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "spoil, culprit",
    [
        (lambda folder: (folder / "fields" / "cable.pvd").unlink(), "cable.pvd"),
        (lambda folder: shutil.rmtree(folder / "fields" / "cable_files"), "cable_files"),
        (
            lambda folder: [
                p.write_bytes(b"x" * 9) for p in (folder / "fields" / "cable_files").iterdir()
            ],
            "cable_files",
        ),
    ],
)
def test_damaged_folders_are_told(recorded: Path, tmp_path: Path, spoil, culprit: str) -> None:
    shutil.copytree(recorded, tmp_path / "run")
    spoil(tmp_path / "run")
    with pytest.raises(gx.InputError, match=re.escape(culprit)):
        gx.plot.RunReader(tmp_path / "run")


def test_components_of_a_probe_share_a_panel() -> None:
    x = np.zeros(3)
    y = np.ones(3)
    other = np.full(3, 2.0)
    alone = "rms from paraboloid [m]"
    panels = grouped({"tip x [m]": x, "tip y [m]": y, "x of the ball": other, alone: other})
    assert {title: list(curves) for title, curves in panels.items()} == {
        "tip [m]": ["x", "y"],
        "x of the ball": [""],
        alone: [""],
    }
    assert panels["tip [m]"]["y"] is y


# ---- another run in the folder -------------------------------------------------------------------


def fall(folder: Path, overwrite: bool = False) -> gx.Simulation:
    """The run of a ball that is recorded in a folder; it has neither gas nor films."""
    ball = gx.PointMass(1.0, comm=WORLD, name="ball")
    recording = gx.Recording(folder, overwrite=overwrite)
    return gx.Simulation(gx.Scene(ball), gx.Midpoint(dt=DT), outputs=[recording])


@pytest.mark.mpi
def test_a_folder_with_another_run_is_refused(folder: Path) -> None:
    fall(folder / "run").run(until=2 * DT)
    WORLD.barrier()
    before = (folder / "run" / "ledger.csv").read_bytes()
    with pytest.raises(gx.InputError, match=r"run' holds a run already.*overwrite=True\.$"):
        fall(folder / "run")
    WORLD.barrier()
    assert (folder / "run" / "ledger.csv").read_bytes() == before


@pytest.mark.mpi
def test_a_run_that_replaces_another_leaves_none_of_its_files(folder: Path) -> None:
    case = pillow(WORLD)
    case.simulation([case.recording(folder / "run")]).run(until=2 * DT)
    run = fall(folder / "run", overwrite=True)
    WORLD.barrier()
    assert (folder / "run" / "gas.csv").exists()  # as nothing was recorded yet
    WORLD.barrier()
    run.run(until=2 * DT)
    WORLD.barrier()
    names = {path.name for path in (folder / "run").rglob("*")} - {"fields"}
    assert names == {"run.json", "ledger.csv", "points.csv"}


@pytest.mark.mpi(1)
@pytest.mark.parametrize("name", ["ledger.csv", "gas.csv", "fields/film.pvd"])
def test_a_single_output_is_not_mixed_into_a_recorded_run(folder: Path, name: str) -> None:
    case = pillow(WORLD)
    case.simulation([case.recording(folder / "run")]).run(until=2 * DT)
    path = folder / "run" / name
    film = next(item for item in case.scene.items if isinstance(item, gx.Membrane))
    other: gx.Ledger | gx.outputs.Probes | gx.outputs.VTU
    if name == "fields/film.pvd":
        path = path.with_name("the film.pvd")
        other = gx.outputs.VTU(path, film)
    elif name == "gas.csv":
        other = gx.outputs.Probes(path, {"one": lambda run: 1.0})
    else:
        other = gx.Ledger(path)
    with pytest.raises(gx.InputError, match="holds a run already"):
        gx.Simulation(case.scene, gx.Midpoint(dt=DT), outputs=[other])
    # other files may be next to those of the run
    gx.Simulation(case.scene, gx.Midpoint(dt=DT), outputs=[gx.Ledger(folder / "run" / "mine.csv")])


class StatusWatch(Output):
    """Notes the status in the run.json of a folder, as a reader of a run that goes on sees it."""

    times = ()

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.seen: list[str] = []

    def open(self, run: object) -> None:
        pass

    def record(self, run: object, last: bool) -> None:
        self.seen.append(json.loads((self.folder / "run.json").read_text())["status"])

    def close(self, run: object) -> None:
        pass


def test_a_run_that_was_restarted_runs(tmp_path: Path) -> None:
    saves = gx.Checkpoints(tmp_path / "saves")
    ball = gx.PointMass(1.0, comm=MPI.COMM_SELF, name="ball")
    for until, restart in ((0.2, None), (0.4, saves.folder)):
        watch = StatusWatch(tmp_path)
        run = gx.Simulation(
            gx.Scene(ball),
            gx.Midpoint(dt=0.1),
            outputs=[gx.Recording(tmp_path), watch],
            checkpoints=saves,
            restart=restart,
        )
        run.run(until=until)
        assert set(watch.seen) == {"running"}
        assert gx.plot.RunReader(tmp_path).about["status"] == "finished"


def test_a_folder_that_goes_in_the_run_is_no_wrong_input(tmp_path: Path) -> None:
    ball = gx.PointMass(1.0, comm=MPI.COMM_SELF, name="ball")
    run = gx.Simulation(
        gx.Scene(ball),
        gx.Midpoint(dt=0.1),
        outputs=[gx.Recording(tmp_path / "run")],
        events=[gx.At(0.2, lambda run: shutil.rmtree(tmp_path / "run"))],
    )
    with pytest.raises(gx.OutputFailure, match="Cannot write"):
        run.run(until=0.4)


def test_processes_replace_a_file_by_files_of_their_own(tmp_path: Path) -> None:
    (tmp_path / "runs.new").write_text("of another process")
    replace_file(tmp_path / "runs.csv", "a,b")
    assert (tmp_path / "runs.csv").read_text() == "a,b"
    assert (tmp_path / "runs.new").read_text() == "of another process"


@pytest.mark.parametrize("control", [None, gx.StepControl(target_iterations=12, max_step=1e-2)])
def test_frames_are_at_equal_times_with_and_without_step_control(
    control: gx.StepControl | None, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A film that flies has steps that grow tenfold."""
    film = gx.Membrane(
        sheet(MPI.COMM_WORLD, 2, 2),
        gx.Miyazaki(2.5e9, 0.34, density=1000.0, thickness=1e-3),
        velocity=lambda X: 0 * X + [[1.0], [0], [0]],
    )
    scene = gx.Scene(film)
    case = gx.Case(scene, gx.Midpoint(dt=1e-3), until=0.5, frames=25, control=control)
    run = case.simulation([case.recording(tmp_path / "run")])
    run.run(until=case.until)
    times = gx.plot.RunReader(tmp_path / "run").times
    assert len(times) == 26
    # Each at the end of the step that contains it.
    late = times - 0.02 * np.arange(26)
    assert (late > -1e-12).all() and (late < 1.1e-2).all()
    assert "are missing" not in caplog.text


def test_records_that_long_steps_leave_out_are_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    scene = gx.Scene(gx.PointMass(1.0, comm=MPI.COMM_WORLD))
    recording = gx.Recording(tmp_path / "run", interval=0.01)
    gx.Simulation(scene, gx.Midpoint(dt=0.05), outputs=[recording]).run(until=0.1)
    if MPI.COMM_WORLD.rank == 0:
        assert "8 of the records that were asked for, 0.01 s apart, are missing" in caplog.text


def test_what_cannot_be_replaced_stays(tmp_path: Path) -> None:
    """A report or picture on a full disk."""
    path = tmp_path / "report.html"
    path.write_text("the former report")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        with pytest.raises(gx.OutputFailure, match=r"report.html"):
            replace_file(path, bytes(2000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert path.read_text() == "the former report"
    assert list(tmp_path.iterdir()) == [path]
