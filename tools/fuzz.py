"""Fuzz the readers of files and of addresses: a result or one sentence, and nothing else.

    ./gossamer python tools/fuzz.py [READER ...] [--seconds 60] [--executions N] [--seed 0]

Bytes, words and lines of a small corpus are changed; an input that reaches a line of the package
that no input before has reached joins the corpus (coverage by sys.monitoring).  Readers that call
gmsh do so in a child process.  Prints the executions, and each failure once with its input.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import socket
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from types import CodeType
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from mpi4py import MPI

import gossamer_fx as gx
from demos.validation.__main__ import CASES, MODELS
from demos.validation.engine.case import read_case
from gossamer_fx.app.cli.command import _parser, _with_values
from gossamer_fx.app.cli.scene_sweep import values_of
from gossamer_fx.app.cli.user_files import option
from gossamer_fx.build.patterns import drawings
from gossamer_fx.core.mesh.gmsh_reader import BadMesh, read_file
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.records.plot import report
from gossamer_fx.records.plot.curve_panels import run_curves
from gossamer_fx.records.plot.viewer import RunView
from gossamer_fx.records.plot.watch import _Answers, _Handler
from gossamer_fx.records.run.checkpoint import _checksum, _checksum_of, _page

ALONE = MPI.COMM_SELF

# Seconds of one execution above which it counts as a failure.
SLOW = 10.0

WORDS = (
    *(b"nan", b"inf", b"-1", b"0", b"1e308", b"-1e308", b"99999999999999999999", b"null", b"true"),
    *(b"[]", b"{}", b'""', b"\x00", b"\xff", b",", b"\n", b"[[", b"<!", b"../", b"%00", b"-----1"),
)

Reader = Callable[[bytes], object]


def changed(rng: random.Random, data: bytes) -> bytes:
    """Data with one to four changes of bytes, of words, or of lines."""
    for _ in range(rng.randint(1, 4)):
        begin = rng.randint(0, len(data))
        end = min(len(data), begin + rng.choice((0, 1, 1, 2, 8, 40)))
        kind = rng.randint(0, 4)
        if kind == 0:
            data = data[:begin] + rng.choice(WORDS) + data[end:]
        elif kind == 1:
            data = data[:begin] + data[end:]
        elif kind == 2:
            data = data[:begin] + bytes([rng.randint(0, 255)]) + data[begin + 1 :]
        elif kind == 3:
            data = data[:end] + data[begin:end] + data[end:]
        else:
            separator = rng.choice((b",", b"\n", b" ", b'"'))
            words = data.split(separator)
            words[rng.randrange(len(words))] = rng.choice((*WORDS, rng.choice(words)))
            data = separator.join(words)
    return data


class Coverage:
    """Counts the lines of the package that were reached; each is noticed once."""

    def __init__(self) -> None:
        self.lines = 0
        home = str(Path(gx.__file__).parent)
        monitoring = sys.monitoring
        monitoring.use_tool_id(monitoring.COVERAGE_ID, "fuzz")

        def reached(code: CodeType, line: int) -> object:
            if code.co_filename.startswith(home):
                self.lines += 1
            return monitoring.DISABLE

        monitoring.register_callback(monitoring.COVERAGE_ID, monitoring.events.LINE, reached)
        monitoring.set_events(monitoring.COVERAGE_ID, monitoring.events.LINE)


def example(folder: Path) -> Path:
    """A recorded run with a film, a ball, a tank and checkpoints."""
    law = gx.Miyazaki(1e9, 0.3, density=1000.0, thickness=1e-4)
    film = gx.Membrane(sheet(ALONE, 2, 2), law, name="film")
    ball = gx.PointMass(1.0, position=(0.0, 0.0, 1.0), comm=ALONE, name="ball")
    gas = gx.IdealGas(gamma=1.4, R=287.0)
    tank = gx.Tank(1e-3, gas=gas, pressure=1e5, temperature=300.0, name="tank")
    recording = gx.Recording(
        folder,
        fields={"film": ("displacement", "state")},
        probes={"ball z [m]": gx.probes.Position(ball.port(), "z")},
        every=1,
    )
    run = gx.Simulation(
        gx.Scene(film, ball, tank),
        gx.Midpoint(dt=1e-3),
        outputs=[recording],
        checkpoints=gx.Checkpoints(folder / "checkpoints"),
    )
    run.run(until=2e-3)
    return folder


def read_all(run: Path) -> None:
    """What a report, curves and the view in a browser read; without pictures."""
    reader = gx.plot.RunReader(run)
    run_curves(reader)
    gx.write_report(reader, run.parent / "report.html")
    json.dumps(RunView(reader).whole(), allow_nan=False)


def readers(folder: Path) -> dict[str, tuple[list[bytes], Reader]]:
    """The corpus and the reader of each kind of input, by name."""
    run = example(folder / "run")
    # Pictures take a hundred times as long as all that is read.
    report._image = lambda *given: ""
    found: dict[str, tuple[list[bytes], Reader]] = {}

    def in_run(name: str) -> Reader:
        original = (run / name).read_bytes()

        def read(data: bytes) -> None:
            (run / name).write_bytes(data)
            try:
                read_all(run)
            finally:
                (run / name).write_bytes(original)

        return read

    of_run = {
        "run.json": "run.json",
        "ledger": "ledger.csv",
        "probes": "probes.csv",
        "points": "points.csv",
        "gas": "gas.csv",
        "pvd": "fields/film.pvd",
        "vtu": "fields/film_files/00001.vtu",
    }
    for name, path in of_run.items():
        found[name] = [(run / path).read_bytes()], in_run(path)

    ball_saves = folder / "saves"
    ball = gx.PointMass(1.0, position=(0.0, 0.0, 1.0), comm=ALONE, name="ball")
    gx.Simulation(gx.Scene(ball), gx.Midpoint(dt=1e-3), checkpoints=gx.Checkpoints(ball_saves)).run(
        until=1e-3
    )
    newest = gx.run.latest_checkpoint(ball_saves)
    assert newest is not None
    state = json.loads((newest / "run.json").read_bytes())
    share = (newest / "rank-0000.npz").read_bytes()

    def restart() -> None:
        ball = gx.PointMass(1.0, position=(0.0, 0.0, 1.0), comm=ALONE, name="ball")
        gx.Simulation(gx.Scene(ball), gx.Midpoint(dt=1e-3), restart=newest)

    def seal(contents: dict[str, Any]) -> None:
        """Set the checksums as a stranger would."""
        contents = {name: value for name, value in contents.items() if name != "checksum"}
        (newest / "run.json").write_bytes(_page(contents | {"checksum": _checksum_of(contents)}))

    def checkpoint(data: bytes) -> None:
        (newest / "rank-0000.npz").write_bytes(share)
        try:
            seal(dict(json.loads(data)))
        except (ValueError, TypeError, RecursionError):
            (newest / "run.json").write_bytes(data)
        restart()

    def arrays(data: bytes) -> None:
        (newest / "rank-0000.npz").write_bytes(data)
        seal(state | {"parts": [_checksum(newest / "rank-0000.npz")]})
        restart()

    found["checkpoint"] = [(newest / "run.json").read_bytes()], checkpoint
    found["arrays"] = [share], arrays

    def as_file(name: str, act: Callable[[Path], object]) -> Reader:
        def read(data: bytes) -> None:
            (folder / name).write_bytes(data)
            act(folder / name)

        return read

    cases = [path.read_bytes() for path in sorted(CASES.glob("*.toml"))[:4]]
    found["toml"] = cases, as_file("case.toml", lambda path: read_case(path, MODELS))
    found["dxf"] = dxf_corpus(folder), as_file("a.dxf", read_drawing)
    gmsh_files = gmsh_corpus(folder)
    found["msh"] = gmsh_files["msh"], as_file("a.msh", read_file)

    def merged(path: Path) -> None:
        def build(model: Any) -> None:
            import gmsh

            gmsh.merge(str(path))
            if path.suffix == ".step":
                model.mesh.generate(2)

        gx.gmsh_mesh(build, ALONE, time_limit=5.0)

    found["stl"] = gmsh_files["stl"], as_file("a.stl", merged)
    found["step"] = gmsh_files["step"], as_file("a.step", merged)
    found["command line"] = COMMANDS, command_line
    found["http"] = requests(run)
    return found


def read_drawing(path: Path) -> None:
    """Read the outlines of a drawing, without a mesh of them."""
    drawing = drawings._read(path, 1.0)
    drawings.panels_of(drawing, str(path))


def dxf_corpus(folder: Path) -> list[bytes]:
    """A drawing with an outline of lines, arcs and a spline, a hole, a text and a block."""
    import ezdxf

    document = ezdxf.new(units=6)  # type: ignore[attr-defined, unused-ignore]
    space = document.modelspace()
    space.add_lwpolyline([(0, 0), (2, 0), (2, 1), (0, 1)], close=True)
    space.add_circle((0.5, 0.5), 0.2)
    space.add_text("panel").set_placement((1.5, 0.5))
    block = document.blocks.new("B")
    block.add_line((3, 0), (4, 0))
    block.add_arc((3.5, 0), 0.5, 0, 180)
    space.add_blockref("B", (0, 0))
    path = folder / "made.dxf"
    document.saveas(path)
    return [path.read_bytes()]


def gmsh_corpus(folder: Path) -> dict[str, list[bytes]]:
    """A rectangle as MSH, STL and STEP."""
    found = {}
    for ending in ("msh", "stl", "step"):
        path = folder / f"made.{ending}"

        def build(model: Any, path: Path = path) -> None:
            import gmsh

            model.occ.addRectangle(0, 0, 0, 2, 1)
            model.occ.synchronize()
            model.mesh.setSize(model.getEntities(0), 1.0)
            model.mesh.generate(2)
            gmsh.write(str(path))

        gx.gmsh_mesh(build, ALONE)
        found[ending] = [path.read_bytes()]
    return found


COMMANDS = [
    b"run\0scene.py\0cells=3\0name={1: [2, 3]}\0--restart\0--ranks\x002",
    b"plot\0run\0--time\x000.1\x000.2\0--range\x000\x001\0--part\0film",
    b"sweep\0scene.py\0--over\0cells=1,2,3\0word=(1, 2)\0--jobs\x002",
    b"export\0run\0-o\0out",
]


def command_line(data: bytes) -> None:
    """Read the words of a command line, and arguments of a scene in it."""
    words = [word.decode(errors="surrogateescape") for word in data.split(b"\0")]
    wanted, _ = _parser().parse_known_args(_with_values(words))
    for word in getattr(wanted, "options", None) or []:
        option(word)
    if getattr(wanted, "over", None):
        values_of(wanted.over)


def requests(run: Path) -> tuple[list[bytes], Reader]:
    """Requests of a browser, and what answers them."""

    class Server:
        token = "token"
        answers = _Answers(run)
        lock = threading.Lock()

    class Quiet(_Handler):
        def log_error(self, format: str, *args: Any) -> None:
            """Print nothing."""

    def answer(data: bytes) -> None:
        ours, theirs = socket.socketpair()
        with ours, theirs:
            ours.sendall(data[:60_000])
            ours.shutdown(socket.SHUT_WR)
            theirs.settimeout(5.0)
            # A page is larger than the buffer of a socket.
            threading.Thread(target=drain, args=(ours,), daemon=True).start()
            server: Any = Server()
            Quiet(theirs, ("127.0.0.1", 0), server)

    def drain(end: socket.socket) -> None:
        try:
            while end.recv(1 << 20):
                pass
        except OSError:
            pass

    Server.answers.read()
    paths = ("", "progress", "header/1", "legend/1/0", "state/1/0/0", "curves/0")
    corpus = [f"GET /token/{path} HTTP/1.1\r\nHost: x\r\n\r\n".encode() for path in paths]
    return [*corpus, b"GET http://[ HTTP/1.1\r\n\r\n"], answer


def fuzz(name: str, corpus: list[bytes], read: Reader, seconds: float, most: int, seed: int) -> int:
    """Fuzz a reader for a time or a number of executions, whichever ends first, and print the
    executions; returns the number of failures."""
    rng = random.Random(seed)
    coverage_before = COVERAGE.lines
    failures: dict[tuple[Any, ...], bytes] = {}
    executions = 0
    slowest = 0.0
    began = time.monotonic()
    while time.monotonic() < began + seconds and executions < most:
        # The originals first.
        data = corpus[executions % len(corpus)]
        if executions >= len(corpus):
            data = changed(rng, rng.choice(corpus))
        executions += 1
        lines = COVERAGE.lines
        started = time.monotonic()
        try:
            read(data)
        except (gx.InputError, BadMesh) as error:
            if "\n" in str(error):
                failures.setdefault(("lines", str(error)[:80]), data)
        # The parser of command lines ends with a sentence.
        except SystemExit as error:
            if error.code not in (0, 2):
                failures.setdefault(("exit", error.code), data)
        except Exception as error:
            frame = traceback.extract_tb(error.__traceback__)[-1]
            key = (type(error).__name__, frame.filename, frame.lineno)
            if key not in failures:
                traceback.print_exc(limit=-4, file=sys.stdout)
            failures.setdefault(key, data)
        spent = time.monotonic() - started
        slowest = max(slowest, spent)
        if spent > SLOW:
            failures.setdefault(("slow", round(spent)), data)
        if COVERAGE.lines > lines:
            corpus.append(data)
    for number, (key, data) in enumerate(failures.items()):
        print(f"{name}: FAILED {key}")
        Path(tempfile.gettempdir(), f"fuzz_{name.replace(' ', '_')}_{number}").write_bytes(data)
    print(
        f"{name}: {executions} executions in {time.monotonic() - began:.0f} s, "
        f"{len(failures)} kinds of failures, "
        f"{COVERAGE.lines - coverage_before} lines reached, slowest {slowest:.1f} s",
        flush=True,
    )
    return len(failures)


def main(words: Sequence[str]) -> int:
    """Fuzz the readers that are named, or all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("readers", nargs="*")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--executions", type=int, default=sys.maxsize, help="at most this number")
    parser.add_argument("--seed", type=int, default=0)
    wanted = parser.parse_args(words)
    failures = 0
    with tempfile.TemporaryDirectory() as folder:
        # Sentences of the parser of command lines.
        with open(os.devnull, "w", errors="backslashreplace") as nowhere:
            known = readers(Path(folder))
            unknown = sorted(set(wanted.readers) - set(known))
            if unknown:
                parser.error(f"there is no reader '{unknown[0]}'; give of {', '.join(known)}.")
            for name, (corpus, read) in known.items():
                if not wanted.readers or name in wanted.readers:
                    sys.stderr = nowhere
                    failures += fuzz(
                        name,
                        list(corpus),
                        read,
                        seconds=wanted.seconds,
                        most=wanted.executions,
                        seed=wanted.seed,
                    )
                    sys.stderr = sys.__stderr__
        shutil.rmtree(folder, ignore_errors=True)
    return int(failures > 0)


if __name__ == "__main__":
    COVERAGE = Coverage()
    sys.exit(main(sys.argv[1:]))
