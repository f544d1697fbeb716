"""Where the memory of a process is limited, as by ulimit -v, commands end in a sentence that names
memory: they do not wait for ever, as OpenBLAS would, and blame no file."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from mpi4py import MPI

from gossamer_fx.app.cli.user_files import guarded
from gossamer_fx.core.checks.ending import lacks_room, no_room
from tests.hanging import HANG_TIMEOUT
from tests.survival.on_ranks import ROOT

pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="starts programs")

SCENE = "import gossamer_fx as gx\n\n\ndef build(comm):\n    return 1\n"


def program(folder: Path, mib: int, *words: str) -> subprocess.CompletedProcess[str]:
    """Run Python in a folder with that many MiB of addresses."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (mib << 20, mib << 20))

    return subprocess.run(
        [sys.executable, "-P", *words],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        preexec_fn=limit,
        capture_output=True,
        text=True,
        timeout=HANG_TIMEOUT,
    )


# At 250 OpenBLAS waited while it was loaded, at 450 MPI; at 500 PETSc broke off.
@pytest.mark.parametrize("mib", [100, 250, 450, 500, 560])
@pytest.mark.parametrize("words", [("run", "scene.py", "-o", "out"), ("report", "out")])
def test_a_command_without_memory_says_so(tmp_path: Path, mib: int, words: tuple[str, ...]) -> None:
    (tmp_path / "scene.py").write_text(SCENE)
    done = program(tmp_path, mib, "-m", "gossamer_fx", *words)
    assert done.returncode == 1, done.stderr
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith("gossamer: there is not enough memory (")
    assert not (tmp_path / "out").exists()


def test_blas_has_its_buffer_once_numpy_is_imported(tmp_path: Path) -> None:
    """It cannot ask for it later, where it would wait for ever."""
    code = """
import resource
import gossamer_fx, numpy
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + 2**24, used + 2**24))
matrix = numpy.ones((300, 300))
print(matrix.dot(matrix)[0, 0])
"""
    done = program(tmp_path, 2000, "-c", code)
    assert done.stdout == "300.0\n", done.stderr


@pytest.fixture
def group() -> Iterator[Path]:
    """A group of processes that have 100 MiB of memory, where one can be made."""
    homes = (("memory", "memory.limit_in_bytes"), ("", "memory.max"))
    path = Path()
    for home, limit in homes:
        path = Path("/sys/fs/cgroup") / home / f"gossamer-{os.getpid()}"
        try:
            path.mkdir()
            (path / limit).write_text(str(100 << 20))
            break
        except OSError:
            if path.exists():
                path.rmdir()
    else:
        pytest.skip("no group of processes can be made without privileges")
    yield path
    # Its processes have ended, but the kernel may still clear up.
    for _ in range(50):
        try:
            path.rmdir()
            break
        except OSError:
            time.sleep(0.1)


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_command_that_the_system_kills_for_lack_of_memory_says_so(
    tmp_path: Path, group: Path, ranks: int
) -> None:
    lines = ["import gossamer_fx as gx", "", "def build(comm):", "    x = b'x' * 2**28"]
    (tmp_path / "scene.py").write_text("\n".join(lines))
    words = ["-m", "gossamer_fx", "run", "scene.py", "-n", str(ranks)]
    done = subprocess.run(
        ["sh", "-c", f'echo $$ > {group}/cgroup.procs; exec "$@"', "sh", sys.executable, *words],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=HANG_TIMEOUT,
    )
    assert done.returncode in (-signal.SIGKILL, 128 + signal.SIGKILL), done.stderr
    assert done.stderr.count("gossamer: ") == 1
    assert "the memory of its group of processes, 100 MiB, was used up" in done.stderr


def test_a_library_without_room_is_no_error_of_the_scene(tmp_path: Path) -> None:
    error = OSError("libTKV3d.so.7.8: failed to map segment from shared object")

    def load() -> None:
        raise error

    with pytest.raises(OSError, match="failed to map"):
        guarded(MPI.COMM_SELF, tmp_path / "scene.py", False, load)
    assert lacks_room(error) and no_room(error).endswith(".")
    assert not lacks_room(OSError("no such file"))
