"""Run the tests on one rank, then those marked mpi on two: ./gossamer test [PYTEST ARGUMENTS].

With `--with 0.11` first, they run in a virtual environment with dolfinx 0.11 from PyPI.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path

from children import run_child
from packages import ROOT, environment_with_wheels

AS_A_RANK = "--as-a-rank"
# of pytest: there were no tests to run
NO_TESTS = 5


def main(words: Sequence[str]) -> int:
    """Run what the words select; returns the first exit code that is not zero."""
    if words[:1] == [AS_A_RANK]:
        return run_as_a_rank(words[1:])
    os.chdir(ROOT)
    environment = dict(os.environ)
    python = sys.executable
    selections: list[list[str]] = [[]]
    if words[:1] == ["--with"]:
        if words[1:2] != ["0.11"]:
            print(
                "gossamer: test --with needs a version of dolfinx that PyPI has in addition to the "
                "usual one: ./gossamer test --with 0.11",
                file=sys.stderr,
            )
            return 2
        words = words[2:]
        home = environment_with_wheels()
        python = str(home / "bin" / "python3")
        environment |= variables_of(home)
        if not words:
            # MPICH has 2048 communicators, which all tests on two ranks together use up
            selections = [[str(path)] for path in files_marked_mpi()]
    options: list[str] = []
    if not words:
        # The table of the longest tests: what makes the suite long is seen at each run.
        options = ["--durations=30", "--durations-min=5"]
    # The whole suite takes all cores; a few tests are done before a second process has started.
    if not words and find_spec("xdist") is not None:
        # What the tests of one file share, such as a recorded run, is made by one worker.
        options += ["-n", "auto", "--dist", "loadfile"]
    code = run_child([python, "-m", "pytest", *options, *words], environment)
    if code:
        return code
    if not sys.stdout.isatty():
        # mpirun gives its ranks a terminal in any case
        environment["NO_COLOR"] = "1"
    for selection in selections:
        code = run_on_two_ranks(python, [*selection, *words_for_ranks(words)], environment)
        if code:
            return code
    return 0


def variables_of(home: Path) -> dict[str, str]:
    """What a virtual environment with MPICH and dolfinx needs, for every order of imports."""
    return {
        "PATH": f"{home / 'bin'}{os.pathsep}{os.environ['PATH']}",
        "LD_LIBRARY_PATH": str(home / "lib"),
        "PYTHONPATH": str(ROOT),
    }


def files_marked_mpi() -> list[Path]:
    """The files of tests of which some run on two ranks."""
    files = sorted(Path("tests").glob("**/test_*.py"))
    return [path for path in files if "mark.mpi" in path.read_text(encoding="utf-8")]


def words_for_ranks(words: Sequence[str]) -> list[str]:
    """Pytest's arguments on two ranks: those marked mpi, no workers.

    A marker expression of the user is joined with `mpi`, which it would replace otherwise.
    """
    markers = "mpi and not slow"
    kept = []
    rest = list(words)
    while rest:
        word = rest.pop(0)
        option = word[:2]
        if option not in ("-m", "-n"):
            kept.append(word)
            continue
        # -m EXPRESSION or -mEXPRESSION
        value = word[2:]
        if not value and rest:
            value = rest.pop(0)
        if option == "-m":
            markers = f"mpi and ({value})"
    return [*kept, "-m", markers]


def run_on_two_ranks(python: str, words: Sequence[str], environment: Mapping[str, str]) -> int:
    """Run pytest on two ranks; returns the exit code of mpirun."""
    program = [python, str(Path(__file__).resolve()), AS_A_RANK, *words]
    return run_child(["mpirun", "-n", "2", *program], environment)


def run_as_a_rank(words: Sequence[str]) -> int:
    """Run pytest as one of the ranks of mpirun.  The second rank is heard only if it fails."""
    command = [sys.executable, "-m", "pytest", *words]
    # of Open MPI, then of MPICH
    rank = os.environ.get("OMPI_COMM_WORLD_RANK") or os.environ.get("PMI_RANK") or "0"
    if rank == "0":
        code = run_child(command)
        said = b""
    else:
        done = subprocess.run(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, close_fds=False
        )
        # a signal that has ended it has a negative number
        code = abs(done.returncode)
        said = done.stdout
    if code in (0, NO_TESTS):
        return 0
    sys.stdout.buffer.write(said)
    return code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
