"""A run in the browser while it computes: a small server of its view and its curves.

The folder of the run is the only link between the two: a browser that is closed, or a server that
is ended, does not disturb the run.  The server answers at 127.0.0.1 alone, and only to those who
know the token in its address.  It sends no files: every answer is computed from the folder.
"""

from __future__ import annotations

import errno
import json
import os
import secrets
import socket
import sys
import time
from collections.abc import Callable, Mapping
from html import escape
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from io import BytesIO
from pathlib import Path
from threading import Lock, Thread
from typing import Annotated, Any
from urllib.parse import urlsplit

from gossamer_fx.core.checks.arguments import Range, check_arguments
from gossamer_fx.core.checks.errors import InputError, check
from gossamer_fx.core.checks.strange_files import check_inside
from gossamer_fx.records.plot.curve_data import curve_data
from gossamer_fx.records.plot.curve_panels import run_curves
from gossamer_fx.records.plot.report import CURVES, VIEW, page_head, status_words, view_scripts
from gossamer_fx.records.plot.run_reader import RunReader
from gossamer_fx.records.plot.viewer import Probe, RunView

_HOST = "127.0.0.1"
# Time from one set of curves, or one scale of colours, to the next over the CPU time that
# it takes to make one: the cores belong to the run, which also makes the drawing wait.
_PAUSE = 5.0
_MAX_PORT = 65535
# Share of what was left of a run from which on its rate is known.
_KNOWN_SHARE = 0.01
# Longest time [s] for a part of a curve of a point: other requests wait for it.
_HISTORY_SECONDS = 0.2
_STOP = '<button id="stop" hidden>Stop the run</button>'


@check_arguments
class Watch:
    """Shows a run in the browser, also while it computes: the view to turn, and curves.

    A server at 127.0.0.1 reads the folder of the run when a browser asks, and answers only at
    `address`, which contains a token.  As the last line of a notebook cell the view is shown below
    the cell, and follows the run.  The server ends with `stop`, or with the program.

    Args:
        folder: of the run.
        port: at which the server answers; 0: any that is free.
        must_exist: whether the folder has to hold a run already; otherwise the page waits for it.
        height: of the frame in a notebook [pixels].
        on_stop: called once, in another thread, when the user asks in the view that the run be
            stopped; None: the view has no button for that.

    Attributes:
        address: of the page, for a browser on the same machine.

    Raises:
        InputError: there is no run, or its files cannot be read; the port is in use.

    Example:
        >>> watch = gx.plot.Watch(folder / "fall")
        >>> watch.address[:17]
        'http://127.0.0.1:'
        >>> watch.stop()
    """

    def __init__(
        self,
        folder: str | Path,
        *,
        port: Annotated[int, Range(0, _MAX_PORT)] = 0,
        must_exist: bool = True,
        height: Annotated[int, Range(1)] = 720,
        on_stop: Callable[[], object] | None = None,
    ) -> None:
        self._height = height
        answers = _Answers(Path(folder), on_stop)
        if must_exist:
            answers.read()
        token = secrets.token_urlsafe(24)
        try:
            self._server = _Server(port, token, answers)
        except OSError as error:
            if error.errno not in (errno.EADDRINUSE, errno.EACCES):
                raise
            raise InputError(
                f"Port {port} of {_HOST} is in use or reserved; give another one, or none."
            ) from error
        self.address = f"http://{_HOST}:{self._server.server_port}/{token}/"
        Thread(target=self._server.serve_forever, daemon=True).start()

    def stop(self) -> None:
        """End the server, and free its port."""
        self._server.shutdown()
        self._server.server_close()

    def _repr_html_(self) -> str:
        """The page in a frame of a notebook."""
        return (
            f'<iframe style="width: 100%; height: {self._height}px; border: 1px solid #dde1e5" '
            f'src="{escape(self.address)}"></iframe>'
        )


class _Answers:
    """What the server answers about the run in a folder; for one request at a time.

    The view is made again where it would be another one: when the run has twice as many states,
    when its files were replaced, and at its end.  In between, only new states are read, and the
    colours get scales that have them.
    """

    def __init__(self, folder: Path, on_stop: Callable[[], object] | None = None) -> None:
        self._folder = folder
        self._on_stop = on_stop
        self._is_stopped = False  # whether the user has asked for it
        self._stamp: tuple[int, ...] = ()
        self._run: RunReader | None = None
        self._view: RunView | None = None
        self._version = 0
        # What the view depends on: the status of the run, and its meshes.
        self._key: tuple[Any, ...] = ()
        self._count = 0  # of states when the view was made
        self._legends_count = 0  # of states that the scales of colours have
        self._next_legends = 0.0
        self._curves: dict[str, Any] = {}
        self._curves_count = 0
        self._next_curves = 0.0
        # Monotonic time [s] and value on the axis when the run was first seen.
        self._first_seen: tuple[float, float] | None = None

    def read(self) -> RunReader:
        """Read the folder again if it has changed.

        Raises:
            InputError: there is no run, a link leads out of its folder, or a file is damaged.
        """
        check(
            self._folder.is_dir(),
            f"There is no folder '{self._folder}'; give the folder of a run.",
        )
        stamp = _stamp(self._folder)
        if self._run is None or stamp != self._stamp:
            self._run = RunReader(self._folder)
            self._stamp = stamp
            self._update_view(self._run)
        return self._run

    def _update_view(self, run: RunReader) -> None:
        """Hand a run that has grown to the view, or make the view again."""
        meshes = [mesh for body in run.bodies.values() for mesh in body.mesh_files]
        key = (run.about["status"], *((mesh, mesh.stat().st_mtime_ns) for mesh in meshes))
        count = len(run.times)
        if key == self._key and self._count <= count < 2 * self._count and self._view is not None:
            self._view.run = run
            if count > self._legends_count and time.monotonic() >= self._next_legends:
                self._view.forget_legends()
                self._legends_count = count
            return
        self._key = key
        self._count = count
        self._legends_count = count
        self._view = None
        if count:
            self._view = RunView(run)
            self._version += 1

    def page(self) -> str:
        """The HTML page, which asks for everything else."""
        title = self._folder.name
        head = page_head(title, "connect-src 'self'")
        status = '<p class="status" id="status">waiting for the run</p>'
        scripts = view_scripts({})
        return f'{head}{status}{_STOP}<div id="watch">{VIEW}{CURVES}</div>{scripts}</body></html>'

    def progress(self) -> dict[str, Any]:
        """How far the run is, and which version of the view and of the curves there is."""
        if not (self._folder / "run.json").is_file():
            waits: dict[str, Any] = {"kind": "status", "status": "waiting for the run"}
            waits |= {"title": self._folder.name, "version": 0, "curves": 0, "labels": []}
            return waits | {"canStop": self._can_stop}
        run = self.read()
        self._draw_curves(run)
        kind, words = status_words(run.about)
        reached = run.along(run.table("ledger.csv"))
        # run.json is written again at the end only.
        if run.about["status"] == "running" and len(reached):
            until = run.about["axis"]["until"]
            words = f"running, {run.axis.words(reached[-1])} of {until:.6g} {run.axis.unit}"
            words += self._time_left(float(reached[-1]), float(until))
        if self._is_stopped:
            words = f"stopped from the view: {words}"
            if run.about["status"] == "running":
                words = "stopping: the run ends with its step"
        return {
            "title": run.title,
            "canStop": self._can_stop and run.about["status"] == "running",
            "kind": kind,
            "status": words,
            "version": 0 if self._view is None else self._version,
            "labels": [run.caption(record) for record in range(len(run.times))],
            "legends": self._legends_count,
            "curves": self._curves_count,
        }

    @property
    def _can_stop(self) -> bool:
        return self._on_stop is not None and not self._is_stopped

    def stop(self) -> bool:
        """Ask that the run be stopped; returns whether it could be asked for."""
        if self._on_stop is None or self._is_stopped:
            return False
        self._is_stopped = True
        self._on_stop()
        return True

    def _time_left(self, reached: float, until: float) -> str:
        """Words about the time left, at the rate since the page was opened; empty until a share of
        the run has passed since then."""
        now = time.monotonic()
        if self._first_seen is None or reached < self._first_seen[1]:
            self._first_seen = (now, reached)
        began, first = self._first_seen
        if until <= reached or reached - first < _KNOWN_SHARE * (until - first):
            return ""
        left = (now - began) * (until - reached) / (reached - first)
        return f", about {_duration(left)} left"

    def _draw_curves(self, run: RunReader) -> None:
        """Make the data of the curves again, unless that was done a short time ago."""
        rows = len(run.along(run.table("ledger.csv")))
        is_due = time.monotonic() >= self._next_curves or run.about["status"] != "running"
        # The energies of a mode are those of an arbitrary amplitude.
        if run.kind == "mode" or rows < 2 or rows == self._curves_count or not is_due:
            return
        began = time.thread_time()
        curves = run_curves(run)
        self._curves = curve_data(curves, curves.at(run.times))
        self._curves_count = rows
        self._next_curves = time.monotonic() + _PAUSE * (time.thread_time() - began)

    def answer(self, words: list[str]) -> tuple[str, bytes] | None:
        """Type and contents of what is asked for; None if there is no such thing.

        Args:
            words: of the address after the token: none for the page, "progress", "curves" with the
                number of their rows, or "header", "legend", "state" and "history", see
                `_part_of_view`.
        """
        if words == [""]:
            return "text/html; charset=utf-8", self.page().encode(errors="replace")
        data: Mapping[str, Any] | None = None
        try:
            if words == ["progress"]:
                data = self.progress()
            elif words == ["curves", str(self._curves_count)] and self._curves:
                data = self._curves
            elif self._view is not None:
                data = self._part_of_view(self._view, words[0], words[1:])
        except (InputError, OSError) as error:
            # A file may be replaced while it is read.
            data = {"message": str(error)}
        if data is None:
            return None
        return "application/json", json.dumps(data, separators=(",", ":")).encode()

    def _part_of_view(self, view: RunView, name: str, words: list[str]) -> Mapping[str, Any] | None:
        """Header, legend, state or history of the present version of the view; None for other
        words.

        Args:
            words: the version; then of a legend the number of the field, of a state its number and
                that of a field, of a history those of the field, mesh, part, piece and point, and
                of the first state.
        """
        if not all(word.isdecimal() and len(word) < 10 for word in words):
            return None
        version, *numbers = (int(word) for word in words or ["0"])
        if version != self._version:
            return None
        if name == "header" and not numbers:
            return view.header(range(len(view.run.times)), view.fields)
        if name == "legend" and len(numbers) == 1 and numbers[0] < len(view.fields):
            began = time.thread_time()
            legend = view.legend(view.fields[numbers[0]])
            self._next_legends = time.monotonic() + _PAUSE * (time.thread_time() - began)
            return legend
        if name == "state" and len(numbers) == 2 and numbers[0] < len(view.run.times):
            record, field = numbers
            # A scene without bodies on meshes has no fields.
            if field < max(len(view.fields), 1):
                # The state of films is needed to mark those that are slack.
                asked = dict.fromkeys([*view.fields[field : field + 1], "state"])
                return view.state(record, [name for name in asked if name in view.fields])
        if name == "history" and len(numbers) == 6:
            field, mesh, part, piece, point, first = numbers
            probe = Probe(mesh, part, piece, point)
            count = len(view.run.times)
            if field < max(len(view.fields), 1) and first < count and view.has_point(probe):
                shown = view.fields[field] if view.fields else ""
                return view.history(range(first, count), shown, probe, _HISTORY_SECONDS)
        return None


def _duration(seconds: float) -> str:
    """A time in the largest unit of which it has some, e.g. "3 min"."""
    for unit, size in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{max(seconds, 1.0):.0f} s"


def _stamp(folder: Path) -> tuple[int, ...]:
    """Times of the last changes in a folder of a run [ns], by which a change is noticed.

    Raises:
        InputError: a link leads out of the folder.
    """
    times = []
    for here, folders, files in os.walk(folder):
        for name in (*folders, *files):
            path = Path(here) / name
            if path.is_symlink():
                check_inside(path, folder)
        for name in files:
            # Each record is a new file, after which its list changes.
            if name.endswith((".json", ".csv", ".pvd")):
                status = (Path(here) / name).stat()
                times += [status.st_mtime_ns, status.st_size]
    return tuple(times)


class _Server(ThreadingHTTPServer):
    """The server of one run, at this machine's own address."""

    daemon_threads = True

    def __init__(self, port: int, token: str, answers: _Answers) -> None:
        super().__init__((_HOST, port), _Handler)
        self.token = token
        self.answers = answers
        self.lock = Lock()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that has gone is not an error; others are shown as usual."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    """Answers one request: GET /TOKEN/WORDS, or POST /TOKEN/stop.

    The token alone keeps other pages of the browser out, also those that take the name of another
    host for this machine.
    """

    server: _Server
    # Seconds for a request, so that one that never ends holds no thread for ever.
    timeout = 30.0

    def setup(self) -> None:
        """Collect the answer, so that it is sent at once."""
        super().setup()
        self._answer = BytesIO()
        self.wfile = self._answer

    def finish(self) -> None:
        """Send the answer without the signal that a connection cut by the browser would raise:
        PETSc ends the program at it."""
        no_signal = getattr(socket, "MSG_NOSIGNAL", 0)
        self.connection.sendall(self._answer.getvalue(), no_signal)
        super().finish()

    def do_GET(self) -> None:
        words = self._words()
        if words is None:
            return
        with self.server.lock:
            found = self.server.answers.answer(words or ["?"])
        if found is None:
            self._send(404, "text/plain", b"There is no such thing.\n")
            return
        self._send(200, *found)

    def do_POST(self) -> None:
        words = self._words()
        if words is None:
            return
        # A browser says from which page it asks: from this one, or the run goes on.
        origin = self.headers.get("Origin")
        if origin is not None and origin != f"http://{self.headers.get('Host', '')}":
            self._send(403, "text/plain", b"Another page has asked.\n")
            return
        with self.server.lock:
            is_stopped = words == ["stop"] and self.server.answers.stop()
        if not is_stopped:
            self._send(404, "text/plain", b"There is no such thing.\n")
            return
        self._send(200, "application/json", b"{}")

    def _words(self) -> list[str] | None:
        """The words of the address after the token; None if it was refused."""
        try:
            path = urlsplit(self.path).path
        except ValueError:
            self._send(400, "text/plain", b"This is not an address.\n")
            return None
        token, *words = path.removeprefix("/").split("/")
        if not secrets.compare_digest(token.encode(), self.server.token.encode()):
            self._send(403, "text/plain", b"The token in the address is missing or wrong.\n")
            return None
        return words

    def _send(self, code: int, kind: str, contents: bytes) -> None:
        self.send_response(code)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(contents)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.end_headers()
        self.wfile.write(contents)

    def log_message(self, format: str, *args: Any) -> None:
        """Requests are not printed between the lines of a run."""
