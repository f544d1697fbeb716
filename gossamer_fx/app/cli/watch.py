"""The command gossamer watch: a run in the browser, of a scene that it starts or of a folder."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from threading import Event
from types import FrameType

from gossamer_fx.app.cli.launch import OWN_COMMAND, child_environment, end_child_with_parent
from gossamer_fx.core.checks.errors import check

_WRONG_INPUT = 2  # exit code


def watch(what: Path, output: Path | None, port: int, others: Sequence[str]) -> int:
    """Show a run in the browser until Ctrl-C: `gossamer watch`.

    A scene file is run by another process, which does not wait for the browser; Ctrl-C ends both,
    the run with its step and a checkpoint.  A button of the view ends the run alone, in the same
    way.

    Args:
        what: a scene file, or the folder of a run.
        output: folder of the run of a scene; None: as of `gossamer run`.
        others: further words for `gossamer run`.

    Returns:
        Exit code of the run, or 0 if it had ended by itself.

    Raises:
        InputError: there is no run in the folder, or words of run follow it.
    """
    is_scene = what.suffix == ".py"
    check(
        is_scene or not (others or output),
        f"'{what}' is not a scene file; give one before the options and arguments of run.",
    )
    folder = what
    if is_scene:
        folder = output or Path("out") / what.stem
    from gossamer_fx.records.plot.watch import Watch

    stopped = Event()
    stopped_from_view = Event()
    run: subprocess.Popen[bytes] | None = None

    def stop_run() -> None:
        """Let the run end with its step, as Ctrl-C does; the server calls it."""
        if run is None or run.poll() is not None:
            return
        stopped_from_view.set()
        print("gossamer: stopped from the view; the run ends with its step", flush=True)
        run.send_signal(signal.SIGINT)

    server = Watch(
        folder,
        port=port,
        must_exist=not is_scene,
        on_stop=stop_run if is_scene else None,
    )
    print(f"gossamer: look at {server.address} until Ctrl-C", flush=True)

    def stop(number: int, frame: FrameType | None) -> None:
        """End the view, and hand the signal on to the run, which ends with its step."""
        # A second signal would break a run off that the view has stopped already.
        is_first = not stopped.is_set()
        stopped.set()
        if is_first and stopped_from_view.is_set():
            return
        if run is not None and run.poll() is None:
            run.send_signal(number)

    # In the process group of this program the run would get a second Ctrl-C from the terminal.
    if is_scene:
        command = [*OWN_COMMAND, "run", str(what), *others, "--output", str(folder)]
        run = subprocess.Popen(
            [sys.executable, *command],
            env=child_environment(),
            start_new_session=True,
            preexec_fn=end_child_with_parent,
        )
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
    code = 0
    if run is not None:
        code = run.wait()
        if code == _WRONG_INPUT:
            return code
        if not stopped.is_set():
            print("gossamer: the run has ended; Ctrl-C ends the view", flush=True)
    ended = stopped.is_set() or stopped_from_view.is_set()
    stopped.wait()
    server.stop()
    return code if ended else 0
