"""Ctrl-C before a command has begun its work: one sentence, and nothing is written."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from mpi4py import MPI

from gossamer_fx.core.checks import ctrl_c, door
from tests.hanging import HANG_TIMEOUT
from tests.survival.on_ranks import ROOT

pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="one rank is enough")

SENTENCE = f"gossamer: {ctrl_c.STOPPED}\n"


@pytest.mark.parametrize(
    "module", ["gossamer_fx.app.cli.command", "gossamer_fx.core.checks.errors", "dolfinx.common"]
)
def test_a_command_is_stopped_while_a_module_is_loaded(tmp_path: Path, module: str) -> None:
    """The finder of modules sends the signal when the module is asked for."""
    (tmp_path / "sitecustomize.py").write_text(
        "import os, signal, sys\n"
        "class Finder:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        f"        if name == {module!r}:\n"
        "            os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.meta_path.insert(0, Finder())\n"
    )
    (tmp_path / "scene.py").write_text("import dolfinx\n")
    done = subprocess.run(
        [sys.executable, "-P", "-m", "gossamer_fx", "run", "scene.py", "-o", "out"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": os.pathsep.join((str(tmp_path), str(ROOT)))},
        # A shell in the background ignores the signal, and so would its children.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        capture_output=True,
        text=True,
        timeout=HANG_TIMEOUT,
    )
    assert (done.returncode, done.stderr) == (130, SENTENCE)
    assert not (tmp_path / "out").exists()


def test_a_library_is_loaded_to_its_end() -> None:
    """As dolfinx catches whatever is raised within it."""
    loaded = []
    with pytest.raises(ctrl_c.CtrlC), ctrl_c.loading():
        with ctrl_c.loading():
            ctrl_c._raise(signal.SIGINT, None)
            loaded.append("inner")
        loaded.append("outer")
    assert loaded == ["inner", "outer"]
    with ctrl_c.loading():
        loaded.append("later")
    assert loaded[-1] == "later"


@pytest.mark.parametrize("name", ["TMPDIR", "TEMP", "TMP"])
def test_a_temporary_folder_that_cannot_be_written_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Open MPI breaks off without it."""
    for other in ("TMPDIR", "TEMP", "TMP"):
        monkeypatch.delenv(other, raising=False)
    door.check_temporary_folder()
    monkeypatch.setenv(name, str(tmp_path))
    door.check_temporary_folder()
    monkeypatch.setenv(name, str(tmp_path / "none"))
    with pytest.raises(OSError, match="none'; set TMPDIR to a folder that can be written"):
        door.check_temporary_folder()


def test_the_launcher_lets_ctrl_c_wait_until_the_package_can_say_what_it_ends(
    tmp_path: Path,
) -> None:
    """Python prints a trace while it starts itself: the launcher blocks the signal until then."""
    (tmp_path / "sitecustomize.py").write_text(
        "import os, signal\nos.kill(os.getpid(), signal.SIGINT)\n"
    )
    done = subprocess.run(
        ["sh", str(ROOT / "gossamer"), "--inside", "report", "out"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": os.pathsep.join((str(tmp_path), str(ROOT)))},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        capture_output=True,
        text=True,
        timeout=HANG_TIMEOUT,
    )
    assert (done.returncode, done.stderr) == (130, SENTENCE)


def test_the_launcher_is_stopped_while_it_looks_for_the_environment(tmp_path: Path) -> None:
    """The first python3 of the path, which the launcher asks for dolfinx, sends it the signal."""
    python = tmp_path / "python3"
    python.write_text("#!/bin/sh\nkill -s INT $PPID\nexit 1\n")
    python.chmod(0o755)
    done = subprocess.run(
        ["sh", str(ROOT / "gossamer"), "doctor"],
        cwd=tmp_path,
        env=os.environ | {"PATH": os.pathsep.join((str(tmp_path), os.environ["PATH"]))},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        capture_output=True,
        text=True,
        timeout=HANG_TIMEOUT,
    )
    assert (done.returncode, done.stderr) == (130, SENTENCE)
