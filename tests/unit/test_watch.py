"""A run in the browser while it computes: what the server tells to whom, and what a browser shows.

The second half needs playwright and Chromium: on PATH, or one that listens at the DevTools address
in GOSSAMER_CHROMIUM.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from base64 import b64decode
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.app.cli.launch import child_environment
from gossamer_fx.meshes.sheet import EDGES, sheet
from gossamer_fx.records.plot.viewer import RunView
from tests.small_scenes import WRINKLING

ALONE = MPI.COMM_SELF
DT = 1e-3


class Fall:
    """A film that falls with a point on a spring, recorded at each step."""

    def __init__(self, folder: Path, fields: tuple[str, ...] = ()) -> None:
        self.folder = folder
        self.film = gx.Membrane(sheet(ALONE, 4, 4), WRINKLING, name="film")
        ball = gx.PointMass(1.0, position=(0.5, 0.5, 0.3), comm=ALONE, name="ball")
        middle = self.film.port_at((0.5, 0.5, 0.0))
        leash = gx.connectors.Spring(ball.port(), middle, stiffness=9.0, length=0.1, name="leash")
        weight = gx.Gravity(self.film, (0.0, 0.0, -9.81))
        self.run = gx.Simulation(
            gx.Scene(self.film, ball, leash, weight),
            gx.Midpoint(dt=DT),
            outputs=[
                gx.Recording(
                    folder,
                    every=1,
                    title="A <fall>",
                    fields={"film": fields} if fields else None,
                )
            ],
        )

    def go(self, steps: int) -> None:
        self.run.run(until=steps * DT)


def ask(address: str) -> Any:
    """The answer of the server as data."""
    with urlopen(address) as answer:
        return json.loads(answer.read())


def code_of(watch: gx.plot.Watch, path: str) -> int:
    """The number of the answer to a path that is sent as it is."""
    port = int(watch.address.split(":")[2].split("/")[0])
    with socket.create_connection(("127.0.0.1", port)) as line:
        line.sendall(f"GET {path} HTTP/1.0\r\n\r\n".encode())
        return int(line.makefile("rb").readline().split()[1])


def rows(packed: dict[str, Any]) -> np.ndarray:
    """Numbers as the script of the view unpacks them."""
    raw = np.frombuffer(b64decode(packed["data"]), dtype="<u2").reshape(-1, len(packed["low"]))
    values = np.array(packed["low"]) + raw / 65534 * np.array(packed["span"])
    return np.where(raw == 65535, np.nan, values)


@pytest.fixture
def fall(tmp_path: Path) -> Fall:
    return Fall(tmp_path / "run")


@pytest.fixture
def watch(fall: Fall) -> Iterator[gx.plot.Watch]:
    fall.go(2)
    found = gx.plot.Watch(fall.folder)
    yield found
    found.stop()


# ---- the server ----------------------------------------------------------------------------------


def test_the_view_follows_the_run(fall: Fall, watch: gx.plot.Watch) -> None:
    """Positions and values of all states, as the folder has them, while it grows."""
    news = ask(watch.address + "progress")
    assert news["title"] == "A <fall>" and len(news["labels"]) == 3
    fall.go(7)
    news = ask(watch.address + "progress")
    assert len(news["labels"]) == 8 and "of 0.007 s" in news["status"]
    header = ask(f"{watch.address}header/{news['version']}")
    assert [part["name"] for part in header["meshes"][0]] == ["film", "leash", "ball"]
    reader = gx.plot.RunReader(fall.folder)
    number = header["fields"].index("Displacement")
    about = header["meshes"][0][0]
    start = np.frombuffer(b64decode(about["start"]), dtype="<f4").reshape(-1, 3)
    X = np.frombuffer(b64decode(about["X"]), dtype="<f8").reshape(-1, 3)
    for record in range(8):
        state = ask(f"{watch.address}state/{news['version']}/{record}/{number}")
        x = start + np.array(about["origin"]) + rows(state["moved"][0])
        mesh, step = reader.bodies["film"].at(record)
        nearest = [np.linalg.norm(mesh.X - point, axis=1).argmin() for point in X]
        assert x == pytest.approx(mesh.positions(step)[nearest], abs=1e-6)
        lengths = np.linalg.norm(mesh.components("displacement", step)[nearest], axis=1)
        values = rows(state["values"][str(number)][0])[:, 0]
        assert values == pytest.approx(lengths, abs=lengths.max() / 65534 + 1e-15)
        # The ball has no fields, and is where points.csv says.
        assert state["values"][str(number)][2] is None
        ball = np.array(header["meshes"][0][2]["origin"]) + rows(state["moved"][2])
        assert ball == pytest.approx(reader.dots(record * DT), abs=1e-7)
    legend = ask(f"{watch.address}legend/{news['version']}/{number}")
    assert legend["high"] == pytest.approx(lengths.max(), rel=1e-3)
    curves = ask(f"{watch.address}curves/{news['curves']}")
    assert curves["records"] == pytest.approx([1e3 * DT * record for record in range(8)])
    assert "Energy [" in curves["panels"][0]["title"]


def test_the_scale_of_colours_has_the_newest_state(
    fall: Fall, watch: gx.plot.Watch, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also before the view is made again, at twice as many states."""
    monkeypatch.setattr("gossamer_fx.records.plot.watch._PAUSE", 0.0)
    highest = []
    for steps in (2, 3, 4):
        fall.go(steps)
        news = ask(watch.address + "progress")
        assert news["version"] == 1 and news["legends"] == steps + 1
        number = ask(watch.address + "header/1")["fields"].index("Displacement")
        highest.append(ask(f"{watch.address}legend/1/{number}")["high"])
        film = gx.plot.RunReader(fall.folder).bodies["film"]
        mesh, step = film.at(steps)
        lengths = np.linalg.norm(mesh.components("displacement", step), axis=1)
        assert highest[-1] == pytest.approx(lengths.max(), rel=1e-3)
    assert highest[0] < highest[1] < highest[2]


def test_deformations_of_an_equilibrium_and_of_a_mode_can_be_enlarged(tmp_path: Path) -> None:
    """They are counted from the stress-free mesh, and from the shape about which it vibrates."""
    film = gx.Membrane(sheet(ALONE, 4, 4), WRINKLING, initial_stress=1e6, name="drum")
    supports = [gx.Fixed(film, edge) for edge in EDGES]
    equilibrium = gx.Equilibrium(gx.Scene(film, gx.Pressure(film, 10.0), *supports))
    equilibrium.find()
    gx.outputs.record(equilibrium, [gx.Recording(tmp_path / "drum")])
    found = RunView(gx.plot.RunReader(tmp_path / "drum")).state(0, [])
    middle = gx.probes.Displacement(film.port_at((0.5, 0.5, 0.0)), "z")
    assert rows(found["moved"][0])[:, 2].max() == pytest.approx(middle(equilibrium), rel=1e-4)
    shapes = gx.analysis.modes(equilibrium, count=1)
    gx.outputs.record_modes(equilibrium, shapes, tmp_path / "modes", amplitude=0.1, frames=4)
    view = RunView(gx.plot.RunReader(next((tmp_path / "modes").iterdir())))
    heights = [rows(view.state(record, [])["moved"][0])[:, 2] for record in range(4)]
    assert abs(heights[0]).max() == pytest.approx(0.1, rel=1e-3)
    assert heights[2] == pytest.approx(-heights[0], abs=1e-5)


def test_only_the_token_opens_and_no_file_is_sent(
    fall: Fall, watch: gx.plot.Watch, tmp_path: Path
) -> None:
    token = watch.address.rstrip("/").rpartition("/")[2]
    assert code_of(watch, f"/{token}/") == 200
    for path in ("/", "/x/", "//", f"/{token}x/", f"/x/{token}/", "/progress", f"/?{token}", "/é/"):
        assert code_of(watch, path) == 403, path
    for path in (
        *("run.json", "ledger.csv", "fields/film.pvd", "../", "../../../../etc/passwd"),
        *(
            "/etc/passwd",
            "%2e%2e/%2e%2e/etc/passwd",
            "..%2frun.json",
            "state/1/../0",
            "state/1/-1/0",
        ),
        *("state/1/99/0", "state/1/0/99", "state/99/0/0", "legend/1/99", "header", "curves/../x"),
    ):
        found = code_of(watch, f"/{token}/{path}")
        assert found == 404, path


@pytest.mark.parametrize("target", ["http://[", "//[", "http://[::1", "/\\x00", "*", "%"])
def test_what_is_no_address_is_refused(watch: gx.plot.Watch, target: str) -> None:
    """Python's reader of addresses raises an error for some."""
    port = int(watch.address.split(":")[2].split("/")[0])
    with socket.create_connection(("127.0.0.1", port)) as connection:
        connection.sendall(f"GET {target} HTTP/1.0\r\n\r\n".encode())
        answer = connection.makefile("rb").read()
    assert answer.split()[1] in (b"400", b"403", b"404"), answer


def test_a_link_out_of_the_folder_is_refused(fall: Fall, watch: gx.plot.Watch) -> None:
    outside = fall.folder.parent / "secret.csv"
    shutil.copy(fall.folder / "points.csv", outside)
    (fall.folder / "points.csv").unlink()
    (fall.folder / "points.csv").symlink_to(outside)
    assert "is a link that leads out" in ask(watch.address + "progress")["message"]
    with pytest.raises(gx.InputError, match="put the file itself there"):
        gx.plot.Watch(fall.folder)
    inside = fall.folder / "copy.csv"
    shutil.copy(outside, inside)
    (fall.folder / "points.csv").unlink()
    (fall.folder / "points.csv").symlink_to(inside)
    assert ask(watch.address + "progress")["title"] == "A <fall>"


def test_what_is_wrong_is_told_in_a_sentence(
    fall: Fall, watch: gx.plot.Watch, tmp_path: Path
) -> None:
    port = int(watch.address.split(":")[2].split("/")[0])
    (tmp_path / "empty").mkdir()
    for folder, used, words in (
        (fall.folder, port, "is in use"),
        (tmp_path / "none", 0, "There is no folder"),
        (tmp_path / "empty", 0, "There is no run in"),
        (fall.folder, -1, "port is -1"),
    ):
        with pytest.raises(gx.InputError, match=words) as error:
            gx.plot.Watch(folder, port=used)
        assert "\n" not in str(error.value) and str(error.value).endswith(".")
    # One that waits for a run says so, and then shows it.
    waiting = gx.plot.Watch(tmp_path / "later", must_exist=False)
    assert ask(waiting.address + "progress")["status"] == "waiting for the run"
    shutil.copytree(fall.folder, tmp_path / "later")
    assert len(ask(waiting.address + "progress")["labels"]) == 3
    # A record that is damaged is named; the others can still be asked for.
    damaged = next((tmp_path / "later" / "fields").rglob("00001.vtu"))
    damaged.write_bytes(b"<VTKFile>")
    version = ask(waiting.address + "progress")["version"]
    said = ask(f"{waiting.address}state/{version}/1/0")["message"]
    assert "00001.vtu" in said and said.endswith(".") and "\n" not in said
    assert ask(f"{waiting.address}state/{version}/0/0")["mesh"] == 0
    waiting.stop()


def test_a_browser_that_goes_disturbs_nothing(
    fall: Fall, watch: gx.plot.Watch, capfd: pytest.CaptureFixture[str]
) -> None:
    port = int(watch.address.split(":")[2].split("/")[0])
    path = watch.address.removeprefix(f"http://127.0.0.1:{port}")
    asked = [f"GET {path}{name} HTTP/1.0\r\n\r\n".encode() for name in ("", "", "", "progress")]
    for words in (b"", b"GET", *asked):
        line = socket.create_connection(("127.0.0.1", port))
        line.sendall(words)
        # The connection is cut instead of closed; PETSc would end the program at SIGPIPE.
        line.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
        line.close()
    fall.go(3)
    assert len(ask(watch.address + "progress")["labels"]) == 4
    assert capfd.readouterr().err == ""


def test_a_notebook_shows_the_page_in_a_frame(watch: gx.plot.Watch) -> None:
    assert f'src="{watch.address}"' in watch._repr_html_()


def points(values: np.ndarray, pieces: np.ndarray, points: int) -> np.ndarray:
    """Means at points of values (n, 3) at the corners of triangles."""
    sums = np.zeros(points)
    np.add.at(sums, pieces.ravel(), values.ravel())
    return sums / np.bincount(pieces.ravel(), minlength=points)


def test_components_of_vectors_are_the_same_in_the_view_and_in_pictures(
    tmp_path: Path,
) -> None:
    """Of displacements and velocities; the normal is that of the deformed film."""
    fall = Fall(tmp_path / "run", fields=("displacement", "velocity"))
    fall.go(20)
    watch = gx.plot.Watch(fall.folder)
    news = ask(watch.address + "progress")
    header = ask(f"{watch.address}header/{news['version']}")
    reader = gx.plot.RunReader(fall.folder)
    mesh, step = reader.bodies["film"].at(20)
    for name, field in (("Displacement", "displacement"), ("Speed", "velocity")):
        number = header["fields"].index(name)
        shown = header["components"][str(number)]
        assert [one for one, _ in shown] == ["magnitude", "x", "y", "z", "normal"]
        vectors = mesh.components(field, step)
        for end, part in shown[1:]:
            state = ask(f"{watch.address}state/{news['version']}/20/{part}")
            values = rows(state["values"][str(part)][0])[:, 0]
            [of_picture] = reader.values(f"{field}_{end}", 20)
            about = header["meshes"][0][0]
            pieces = np.frombuffer(b64decode(about["pieces"]), dtype="<u4").reshape(-1, 3)
            expected = points(of_picture, pieces, len(values))
            assert values == pytest.approx(expected, abs=np.ptp(expected) / 3e4 + 1e-15)
            if end in "xyz":
                at_corners = vectors[mesh.pieces, "xyz".index(end)]
                assert of_picture == pytest.approx(at_corners, abs=1e-15)
            legend = ask(f"{watch.address}legend/{news['version']}/{part}")
            assert legend["name"] == header["fields"][part]
            assert legend["unit"].endswith("m/s" if field == "velocity" else "m")
    # A flat film that falls along its normal has no other component along it.
    [normal] = reader.values("displacement_normal", 1)
    [z] = reader.values("displacement_z", 1)
    assert abs(normal) == pytest.approx(abs(z), rel=1e-3)
    with pytest.raises(gx.InputError, match="and displacement_x and velocity_x for a component"):
        reader.check_field("displacement_w")
    watch.stop()


def test_a_point_has_its_history_in_all_states(
    fall: Fall, watch: gx.plot.Watch, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also of more than a hundred; the server answers in parts, so that others need not wait."""
    fall.go(130)
    news = ask(watch.address + "progress")
    version = news["version"]
    header = ask(f"{watch.address}header/{version}")
    number = header["fields"].index("Displacement along z")
    X = np.frombuffer(b64decode(header["meshes"][0][0]["X"]), dtype="<f8").reshape(-1, 3)
    point = int(np.linalg.norm(X - (0.5, 0.5, 0.0), axis=1).argmin())
    found: list[float] = []
    while len(found) < 131:
        path = f"history/{version}/{number}/0/0/0/{point}/{len(found)}"
        answer = ask(watch.address + path)
        assert answer["isField"] and answer["values"]
        found += answer["values"]
    reader = gx.plot.RunReader(fall.folder)
    for record in (0, 60, 130):
        mesh, step = reader.bodies["film"].at(record)
        nearest = int(np.linalg.norm(mesh.X - X[point], axis=1).argmin())
        fallen = mesh.components("displacement", step)[nearest, 2]
        assert found[record] == pytest.approx(fallen, rel=1e-9, abs=1e-15)
    # A ball has no field, so that its height is told.
    answer = ask(f"{watch.address}history/{version}/{number}/0/2/0/0/130")
    assert answer == {"values": [pytest.approx(reader.dots(130 * DT)[0, 2])], "isField": False}
    monkeypatch.setattr("gossamer_fx.records.plot.watch._HISTORY_SECONDS", 0.0)
    assert len(ask(f"{watch.address}history/{version}/{number}/0/0/0/0/0")["values"]) == 1
    token = watch.address.rstrip("/").rpartition("/")[2]
    for words in ("99/0/0/0/0/0", "0/9/0/0/0/0", "0/0/9/0/0/0", "0/0/0/999/0/0", "0/0/0/0/999/0"):
        assert code_of(watch, f"/{token}/history/{version}/{words}") == 404, words
    assert code_of(watch, f"/{token}/history/{version}/0/0/0/0/0/131") == 404


def asked_to_stop(path: str, origin: str = "") -> int:
    """The number of the answer to a request to stop, from a page of an origin."""
    request = Request(path, data=b"", headers={"Origin": origin} if origin else {}, method="POST")
    try:
        with urlopen(request) as answer:
            return int(answer.status)
    except HTTPError as error:
        return error.code


def test_only_the_page_itself_stops_a_run(fall: Fall, watch: gx.plot.Watch) -> None:
    """With its token, from its own origin, once, and only where there is something to stop."""
    assert asked_to_stop(f"{watch.address}stop") == 404
    assert not ask(watch.address + "progress")["canStop"]
    calls: list[str] = []
    stoppable = gx.plot.Watch(fall.folder, on_stop=lambda: calls.append("stopped"))
    home = stoppable.address.rpartition("/")[0].rpartition("/")[0]
    for path, origin, code in (
        (f"{home}/stop", "", 403),
        (f"{home}/x/stop", "", 403),
        (f"{stoppable.address}stop", "http://example.org", 403),
        (f"{stoppable.address}stop", "null", 403),
        (f"{stoppable.address}state", "", 404),
    ):
        assert asked_to_stop(path, origin) == code, path
    # A link is a GET, which stops nothing.
    token = stoppable.address.rstrip("/").rpartition("/")[2]
    assert code_of(stoppable, f"/{token}/stop") == 404 and not calls
    assert asked_to_stop(f"{stoppable.address}stop", home) == 200
    assert asked_to_stop(f"{stoppable.address}stop", home) == 404
    assert calls == ["stopped"]
    assert "stopped from the view" in ask(stoppable.address + "progress")["status"]
    stoppable.stop()


SCENE = """
import gossamer_fx as gx
from mpi4py import MPI

def build(comm, until=1000.0):
    ball = gx.PointMass(1.0, position=(0.0, 0.0, 0.0), velocity=(1.0, 0.0, 0.0), comm=comm)
    spring = gx.connectors.Spring(ball.port(), gx.Ground((0, 0, 1)), stiffness=1.0, length=0.5)
    return gx.Case(gx.Scene(ball, spring), gx.Midpoint(dt=0.001), until=until)
"""


def test_the_command_runs_a_scene_and_ends_with_it(tmp_path: Path) -> None:
    """It prints an address that works; Ctrl-C ends the run with a checkpoint, and the server."""
    (tmp_path / "swing.py").write_text(SCENE)
    words = ["watch", "swing.py", "until=900.0", "--quiet", "--output", "here"]
    command = [sys.executable, "-P", "-m", "gossamer_fx", *words]
    program = subprocess.Popen(
        command, cwd=tmp_path, env=child_environment(), stdout=subprocess.PIPE, text=True
    )
    assert program.stdout is not None
    address = re.search(r"http\S+", program.stdout.readline())
    assert address is not None
    news: dict[str, Any] = {"labels": []}
    while len(news["labels"]) < 3 and program.poll() is None:
        news = ask(address[0] + "progress")
        time.sleep(0.1)
    assert "of 900 s" in news["status"]
    program.send_signal(signal.SIGINT)
    assert program.wait(60) == 130
    assert list((tmp_path / "here" / "checkpoints").iterdir())
    with pytest.raises(OSError):
        ask(address[0] + "progress")


def test_a_run_is_stopped_from_the_view(tmp_path: Path) -> None:
    """It ends with its step and a checkpoint, and can be gone on with; the view stays."""
    (tmp_path / "swing.py").write_text(SCENE)
    words = ["watch", "swing.py", "until=900.0", "--quiet", "--output", "here"]
    command = [sys.executable, "-P", "-m", "gossamer_fx", *words]
    program = subprocess.Popen(
        command,
        cwd=tmp_path,
        env=child_environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert program.stdout is not None
    address = re.search(r"http\S+", program.stdout.readline())
    assert address is not None
    news: dict[str, Any] = {"labels": []}
    while len(news["labels"]) < 3 and program.poll() is None:
        news = ask(address[0] + "progress")
        time.sleep(0.1)
    assert news["canStop"]
    assert asked_to_stop(f"{address[0]}stop") == 200
    assert "stopped from the view" in program.stdout.readline()
    assert "the run has ended" in program.stdout.readline()
    news = ask(address[0] + "progress")
    assert news["status"].startswith("stopped from the view: ") and not news["canStop"]
    program.send_signal(signal.SIGINT)
    said = program.communicate(timeout=60)[1]
    assert program.returncode == 130
    assert "go on with: ./gossamer run swing.py" in said and "Traceback" not in said
    assert list((tmp_path / "here" / "checkpoints").iterdir())
    rows_written = gx.plot.RunReader(tmp_path / "here").table("ledger.csv")["step"]
    assert len(rows_written) > 3


def test_the_command_refuses_what_it_cannot_show(tmp_path: Path) -> None:
    for words, said in (
        (["none"], "There is no folder 'none'"),
        (["none.py"], "There is no scene file 'none.py'"),
        ([".", "until=1"], "is not a scene file"),
    ):
        command = [sys.executable, "-P", "-m", "gossamer_fx", "watch", *words]
        found = subprocess.run(
            command, cwd=tmp_path, env=child_environment(), capture_output=True, text=True
        )
        assert found.returncode == 2 and said in found.stderr, words
        assert found.stderr.count("\n") == 1


def test_the_time_left_is_told_when_the_rate_is_known(
    fall: Fall, watch: gx.plot.Watch, monkeypatch: pytest.MonkeyPatch
) -> None:
    from gossamer_fx.records.plot.watch import _Answers, _duration

    clock = iter([0.0, 10.0, 20.0])
    monkeypatch.setattr("gossamer_fx.records.plot.watch.time.monotonic", lambda: next(clock))
    answers = _Answers(fall.folder)
    assert answers._time_left(0.2, 1.0) == ""
    # 0.001 of 0.8 is too little to know the rate; 0.2 in 20 s leave 60 s for 0.6.
    assert answers._time_left(0.201, 1.0) == ""
    assert answers._time_left(0.4, 1.0) == ", about 60 s left"
    assert [_duration(one) for one in (0.1, 130.0, 9000.0)] == ["1 s", "2 min", "2 h"]


# ---- the browser ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    running = os.environ.get("GOSSAMER_CHROMIUM", "")
    program = shutil.which("chromium")
    if not (running or program):
        pytest.skip("there is no Chromium")
    with api.sync_playwright() as tools:
        if running:
            found = tools.chromium.connect_over_cdp(running)
        else:
            drawing = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
            found = tools.chromium.launch(executable_path=program, args=drawing)
        yield found
        found.close()


def opened(browser: Any, address: str, width: int = 1280) -> Any:
    """A page of the browser, when the view is drawn; an error of its script is one of the test."""
    page = browser.new_context(viewport={"width": width, "height": 900}).new_page()

    def fail(error: Any) -> None:
        pytest.fail(f"{error}")

    page.on("pageerror", fail)
    page.goto(address)
    page.wait_for_selector("#view[data-drawn]", timeout=60_000)
    return page


def set_slider(page: Any, name: str, value: int) -> None:
    page.eval_on_selector(
        name, f"one => {{ one.value = {value}; one.dispatchEvent(new Event('input')); }}"
    )


def test_a_browser_follows_a_live_run(fall: Fall, watch: gx.plot.Watch, browser: Any) -> None:
    page = opened(browser, watch.address)
    page.wait_for_selector("#view[data-record='2']")
    assert page.inner_text("#time-label") == "t = 2 ms" and page.title() == "A <fall>"
    before = page.locator("#view").screenshot()
    fall.go(40)
    page.wait_for_selector("#view[data-record='40']", timeout=30_000)
    assert page.inner_text("#time-label") == "t = 40 ms"
    assert page.locator("#view").screenshot() != before
    # A state that the user has chosen stays, and playback can be paused.
    set_slider(page, "#time", 1)
    page.wait_for_selector("#view[data-record='1']")
    fall.go(42)
    page.wait_for_selector("#time[max='42']", timeout=30_000)
    assert page.get_attribute("#view", "data-record") == "1"
    page.click("#play")
    page.wait_for_selector("#view:not([data-record='1'])", timeout=30_000)
    page.click("#play")
    assert page.inner_text("#play") == "Play"
    page.wait_for_timeout(400)  # a state that was asked for before the pause may still be shown
    paused = page.inner_text("#time-label")
    page.wait_for_timeout(600)
    assert page.inner_text("#time-label") == paused
    page.close()


def test_a_point_is_picked_with_its_value_and_its_probe(
    fall: Fall, watch: gx.plot.Watch, browser: Any
) -> None:
    """The probe that is copied measures what the view has shown."""
    fall.go(40)
    page = opened(browser, watch.address)
    page.wait_for_selector("#view[data-record='40']", timeout=30_000)
    page.select_option("#field", label="Displacement")
    page.wait_for_selector("#view[data-field='Displacement']")
    frame = page.locator("#view").bounding_box()
    page.mouse.click(frame["x"] + 0.4 * frame["width"], frame["y"] + 0.75 * frame["height"])
    shown = page.inner_text("#picked")
    found = re.search(r"^film: at \((.*)\) m\nDisplacement: (\S+) mm$", shown, re.MULTILINE)
    assert found is not None, shown
    z = float(found[1].split(", ")[2])
    probes = eval(f"{{{page.input_value('#probe')}}}", {"gx": gx, "film": fall.film})
    [probe] = probes.values()
    assert z == pytest.approx(probe(fall.run), rel=1e-4)
    port = probe.port
    whole = [gx.probes.Displacement(port, axis)(fall.run) for axis in "xyz"]
    assert float(found[2]) == pytest.approx(1e3 * np.linalg.norm(whole), rel=1e-4)
    # Twice the deformation is twice the fall.
    page.fill("#factor", "2")
    page.wait_for_timeout(500)
    twice = re.search(r"at \((.*)\) m", page.inner_text("#picked"))
    assert twice is not None and float(twice[1].split(", ")[2]) == pytest.approx(2 * z, rel=1e-4)
    page.close()


def test_parts_are_hidden_and_cut(fall: Fall, watch: gx.plot.Watch, browser: Any) -> None:
    page = opened(browser, watch.address)
    box = page.get_by_role("checkbox", name="film")

    def is_drawn() -> bool:
        """Whether pixels that are neither white nor a line are on the screen."""
        from io import BytesIO

        from PIL import Image

        image = Image.open(BytesIO(page.locator("#view").screenshot())).convert("L")
        middle = np.asarray(image)[5:-5, 5:-5]
        return bool((middle < 245).mean() > 0.05)

    assert is_drawn()
    box.uncheck()
    assert not is_drawn()
    box.check()
    assert is_drawn()
    page.select_option("#cut", label="keep x >")
    set_slider(page, "#depth", 1000)
    assert page.inner_text("#depth-label").endswith(" m") and not is_drawn()
    set_slider(page, "#depth", 0)
    assert is_drawn()
    page.close()


def test_the_cursor_of_the_curves_follows_the_slider(
    fall: Fall, watch: gx.plot.Watch, browser: Any
) -> None:
    """And a click on a curve moves the slider; values are those at the cursor."""
    fall.go(8)
    page = opened(browser, watch.address)
    page.wait_for_selector("#curves[data-panels]")
    page.wait_for_selector("#time[max='8']", timeout=30_000)
    positions = []
    for record in (2, 6):
        set_slider(page, "#time", record)
        page.wait_for_selector(f"#view[data-record='{record}']")
        positions.append(float(page.get_attribute("#curves .cursor", "x1")))
        assert page.inner_text("#curves .values").startswith(f"{record} ")
    # From 52 to 372 of 380 units for 8 ms.
    assert positions == pytest.approx([52 + 320 * 2 / 8, 52 + 320 * 6 / 8], abs=0.5)
    picture = page.locator("#curves .panel > svg").first
    frame = picture.bounding_box()
    picture.click(position={"x": (52 + 320 * 4 / 8) / 380 * frame["width"], "y": 40})
    page.wait_for_selector("#view[data-record='4']")
    page.close()


def test_a_field_is_read_in_the_view(
    fall: Fall, watch: gx.plot.Watch, browser: Any, tmp_path: Path
) -> None:
    """Marks of its extremes, its curve at a picked point, other ends of the colours, edges, sides
    from which it is seen, and a picture in a file; a hidden part has no mark and no curve."""
    fall.go(40)
    page = opened(browser, watch.address)
    page.wait_for_selector("#view[data-record='40']", timeout=30_000)
    page.select_option("#field", label="Displacement")
    page.wait_for_selector("#view[data-field='Displacement']")
    page.check("#extremes")
    page.wait_for_function("document.getElementById('extreme-words').textContent")
    film = gx.plot.RunReader(fall.folder).bodies["film"]
    mesh, step = film.at(40)
    largest = np.linalg.norm(mesh.components("displacement", step), axis=1).max()
    said = re.match(r"Largest: (\S+) mm at", page.inner_text("#extreme-words"))
    assert said is not None and float(said[1]) == pytest.approx(1e3 * largest, rel=1e-3)
    frame = page.locator("#view").bounding_box()
    page.mouse.click(frame["x"] + 0.4 * frame["width"], frame["y"] + 0.75 * frame["height"])
    page.wait_for_selector("#history", timeout=60_000)
    title = page.inner_text("#history .title")
    assert title == "Displacement [mm] at the point of film"
    before = page.locator("#view").screenshot()
    for box in ("#edges", "#light"):
        page.click(box)
        page.wait_for_timeout(300)
        after = page.locator("#view").screenshot()
        assert after != before
        before = after
    page.fill("#high", "0.5")
    page.wait_for_timeout(300)
    assert page.locator("#view").screenshot() != before
    seen = set()
    for side in ("iso", "x", "y", "z"):
        page.click(f"#look-{side}")
        seen.add(page.locator("#view").screenshot())
    assert len(seen) == 4
    with page.expect_download() as download:
        page.click("#picture")
    assert download.value.suggested_filename == "A_fall_t_=_40_ms.png"
    page.get_by_role("checkbox", name="film").uncheck()
    page.wait_for_selector("#history", state="detached")
    assert page.is_hidden("#copying") and "Click on a point" in page.inner_text("#picked")
    assert page.inner_text("#extreme-words") == ""
    page.close()


def test_components_are_chosen_and_a_film_is_saved(
    fall: Fall, watch: gx.plot.Watch, browser: Any, tmp_path: Path
) -> None:
    """Also in a report, which has no server; all states of the run are in the film."""
    fall.go(20)
    report = tmp_path / "report.html"
    gx.write_report(gx.plot.RunReader(fall.folder), report)
    for address in (watch.address, report.as_uri()):
        page = opened(browser, address)
        page.wait_for_selector("#time[max='20']", timeout=30_000)
        assert page.is_hidden("#component")
        page.select_option("#field", label="Displacement")
        assert page.is_visible("#component")
        page.select_option("#component", label="z")
        page.wait_for_selector("#view[data-field='Displacement along z']")
        assert "Displacement along x" not in page.inner_text("#field")
        page.select_option("#speed", label="× 4")
        set_slider(page, "#time", 3)
        with page.expect_download(timeout=60_000) as download:
            page.click("#film")
        assert download.value.suggested_filename == "A_fall.webm"
        content = Path(download.value.path()).read_bytes()
        # The first bytes of WebM.
        assert content[:4] == b"\x1a\x45\xdf\xa3" and len(content) > 10_000
        page.wait_for_selector("#view[data-record='3']")
        assert page.inner_text("#film") == "Save film"
        page.select_option("#field", index=0)
        page.wait_for_selector("#component", state="hidden")
        page.close()


def test_a_browser_stops_a_run_with_two_clicks(fall: Fall, browser: Any) -> None:
    fall.go(2)
    calls: list[str] = []
    watch = gx.plot.Watch(fall.folder, on_stop=lambda: calls.append("stopped"))
    about = json.loads((fall.folder / "run.json").read_text())
    (fall.folder / "run.json").write_text(json.dumps(about | {"status": "running"}))
    page = opened(browser, watch.address)
    page.wait_for_selector("#stop:visible")
    page.click("#stop")
    assert "Stop?" in page.inner_text("#stop") and not calls
    page.click("#stop")
    page.wait_for_selector("#stop", state="hidden")
    assert calls == ["stopped"]
    page.wait_for_selector("#status:has-text('stopping')")
    page.close()
    watch.stop()


def test_one_state_has_no_playback(fall: Fall, browser: Any, tmp_path: Path) -> None:
    fall.go(1)
    gx.write_report(gx.plot.RunReader(fall.folder), tmp_path / "two.html")
    gx.outputs.record(gx.Equilibrium(gx.Scene(fall.film)), [gx.Recording(tmp_path / "one")])
    gx.write_report(gx.plot.RunReader(tmp_path / "one"), tmp_path / "one.html")
    for name, is_hidden in (("one", True), ("two", False)):
        page = opened(browser, (tmp_path / f"{name}.html").as_uri())
        assert page.is_hidden("#play") == page.is_hidden("#time") == is_hidden
        page.close()


@pytest.mark.parametrize("width", [1280, 390])
def test_nothing_overflows(
    fall: Fall, watch: gx.plot.Watch, browser: Any, tmp_path: Path, width: int
) -> None:
    """The page that follows a run and the report, which opens offline, on a desk and on a phone."""
    gx.write_report(gx.plot.RunReader(fall.folder), tmp_path / "report.html")
    with open(tmp_path / "report.html", encoding="utf-8") as file:
        report = file.read()
    for address in (watch.address, None):
        if address is None:
            page = browser.new_context(viewport={"width": width, "height": 900}).new_page()
            page.context.set_offline(True)
            page.set_content(report)
            page.wait_for_selector("#view[data-drawn]", timeout=60_000)
        else:
            page = opened(browser, address, width)
        page.mouse.click(width // 2, 300)
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        page.close()
