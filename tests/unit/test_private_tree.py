"""The private tree of the launcher: its end of the set-up, what is mounted, and bwrap's signals."""

from __future__ import annotations

import fcntl
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.hanging import HANG_TIMEOUT
from tools import private_tree

ROOT = Path(__file__).resolve().parents[2]


def make_complete(tree: Path, days_unused: float) -> Path:
    tree.mkdir()
    (tree / ".complete").touch()
    (tree / ".used").touch()
    then = time.time() - 86400 * days_unused
    os.utime(tree / ".used", (then, then))
    return tree


def test_a_finished_tree_has_places_for_the_files_of_the_machine(tmp_path: Path) -> None:
    partial = tmp_path / "debian13-1.partial"
    (partial / "etc").mkdir(parents=True)
    (partial / "etc" / "localtime").symlink_to("/usr/share/zoneinfo/Etc/UTC")
    incomplete = tmp_path / "debian13-1"
    incomplete.mkdir()
    private_tree.finish(incomplete)
    assert not partial.exists() and (tmp_path / "debian13-1" / ".complete").is_file()
    for name in private_tree.OWN_FILES:
        place = Path(f"{tmp_path / 'debian13-1'}{name}")
        assert place.is_file() and not place.is_symlink()
    assert (tmp_path / "debian13-1/etc/passwd").read_bytes() == Path("/etc/passwd").read_bytes()


def test_trees_that_nobody_uses_are_removed(tmp_path: Path) -> None:
    tree = make_complete(tmp_path / "debian13-new", 0.0)
    make_complete(tmp_path / "debian13-recent", 0.5)
    busy = make_complete(tmp_path / "debian13-busy", 3.0)
    old = make_complete(tmp_path / "debian13-old", 3.0)
    killed = tmp_path / "debian13-killed.partial"
    killed.mkdir()
    with (busy / ".used").open() as command:
        fcntl.flock(command, fcntl.LOCK_SH)
        found = private_tree.unused_trees(tree)
    assert found == [killed, old]
    private_tree.remove_in_background(found)
    left = {path.name for path in tmp_path.iterdir() if not path.name.startswith("trash-")}
    assert left == {"debian13-new", "debian13-recent", "debian13-busy"}


def test_words_of_a_command_name_paths(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    link = tmp_path / "link"
    link.symlink_to("/usr/share")
    monkeypatch.setenv("HOME", "/usr/home/me")
    words = ["run", "/etc/scene.py", "data=(/usr/a/b,/usr/c)", str(link), "", "--output=/tmp/x"]
    found = set(private_tree.named_paths(words))
    assert {"/etc/scene.py", "/usr/a/b", "/usr/c", "/usr/share", "/usr/home/me"} <= found
    assert not any(path.startswith("/tmp") for path in found)


def test_what_the_tree_has_is_not_mounted_over(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The machine's folders are seen only where the tree has no content itself."""
    monkeypatch.chdir(tmp_path)
    for name in ("HOME", "PWD", "TMPDIR", "XDG_CACHE_HOME"):
        monkeypatch.setenv(name, str(tmp_path))
    tree = tmp_path / "tree"
    (tree / "usr" / "lib" / "python3").mkdir(parents=True)
    (tree / "etc").mkdir()
    (tree / "etc" / "passwd").touch()
    words = ["/usr/lib", "/usr/bin", "/usr/local/new/file", "/etc/no/such", "/usr/nothing"]
    pairs = list(private_tree.bindings(str(tree), words))
    assert pairs[:3] == [(f"{tree}{name}", name) for name in ("/usr", "/etc", "/var/lib/dpkg")]
    own = [pair for pair in pairs if pair[0] == pair[1]]
    assert own == [("/etc/passwd", "/etc/passwd")] + [(p, p) for p in ("/usr/bin", "/usr/local")]
    assert (tree / "usr" / "bin").is_dir()


# bwrap as its caller sees it: it takes bindings from a file, and keeps signals to itself
BWRAP = f"""#!{sys.executable}
import os, signal, subprocess, sys
words = sys.argv[1:]
with open(int(words[words.index("--args") + 1]), "rb") as file:
    bindings = file.read().split(b"\\0")
assert bindings.pop() == b"" and bindings[0] == b"--bind" and len(bindings) % 3 == 0
for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGUSR1):
    signal.signal(number, lambda number, frame: None)
child = subprocess.Popen(words[words.index("/usr/bin/env"):])
code = child.wait()
sys.exit(code if code >= 0 else 128 - code)
"""
PATIENT = """
import signal, sys, time
def leave(number, frame):
    sys.exit(100 + number)
for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT, signal.SIGUSR1):
    signal.signal(number, leave)
print("up", flush=True)
time.sleep(60)
"""
ENTER = f"""
import sys
sys.path.insert(0, {str(ROOT)!r})
from tools import private_tree
sys.exit(private_tree.enter_as_user(sys.argv[1], sys.argv[2:]))
"""


@pytest.fixture
def bwrap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a tree, and bwrap on PATH."""
    program = tmp_path / "bwrap"
    program.write_text(BWRAP)
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    (tmp_path / "tree").mkdir()
    return tmp_path


def enter(folder: Path, script: str) -> subprocess.Popen[str]:
    """Run a script of sh by bwrap."""
    (folder / "script").write_text(script)
    return subprocess.Popen(
        [sys.executable, "-c", ENTER, str(folder / "tree"), str(folder / "script")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_streams_and_exit_code_pass_bwrap(bwrap: Path) -> None:
    run = enter(bwrap, "read word; echo got $word; exit 7")
    said = run.communicate("given\n", timeout=HANG_TIMEOUT)
    assert said == ("got given\n", "") and run.returncode == 7
    killed = enter(bwrap, "kill -9 $$")
    killed.communicate(timeout=HANG_TIMEOUT)
    assert killed.returncode == 128 + signal.SIGKILL


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT, signal.SIGUSR1])
def test_signals_pass_bwrap(bwrap: Path, number: signal.Signals) -> None:
    (bwrap / "patient.py").write_text(PATIENT)
    run = enter(bwrap, f"exec {sys.executable} {bwrap / 'patient.py'}")
    assert run.stdout is not None and run.stdout.readline() == "up\n"
    run.send_signal(number)
    run.communicate(timeout=HANG_TIMEOUT)
    assert run.returncode == 100 + number


def test_a_user_without_bwrap_is_told_what_to_install(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", ENTER, str(tmp_path), "script"],
        env={"PATH": str(tmp_path)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1
    assert done.stderr == "gossamer: please install bubblewrap: sudo apt-get install bubblewrap\n"
