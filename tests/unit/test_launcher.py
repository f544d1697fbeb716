"""The launcher inside an environment: it passes arguments through, and misuse is reported in one
sentence."""

import os
import pty
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.hanging import HANG_TIMEOUT

ROOT = Path(__file__).resolve().parents[2]
GOSSAMER = str(ROOT / "gossamer")
COMMANDS = (
    "demo",
    "validate",
    "run",
    "watch",
    "sweep",
    "plot",
    "report",
    "export",
    "study",
    "bench",
    "test",
    "python",
    "mpi",
    "shell",
    "lint",
    "docs",
    "doctor",
    "setup",
)

pytestmark = pytest.mark.skipif(
    "OMPI_COMM_WORLD_SIZE" in os.environ or "PMI_SIZE" in os.environ,
    reason="an mpirun cannot start another",
)


def launch(*words, program=GOSSAMER, **options):
    options = {
        "capture_output": True,
        "text": True,
        "timeout": HANG_TIMEOUT,
        "stdin": subprocess.DEVNULL,
    } | options
    if "input" in options:
        del options["stdin"]
    return subprocess.run([program, *words], **options)


@pytest.mark.parametrize("words", [(), ("--help",), ("-h",), ("help",)])
def test_help(words):
    done = launch(*words)
    assert done.returncode == 0 and not done.stderr
    assert len(done.stdout.splitlines()) == 2 + len(COMMANDS)
    for command in COMMANDS:
        assert re.search(rf"^  {command}\b", done.stdout, re.MULTILINE)


@pytest.mark.parametrize(
    "words, culprit",
    [
        (("inflate",), "inflate"),
        (("--verbose",), "--verbose"),
        (("demo", "no_such_demo"), "no_such_demo"),
        (("validate", "no_such_case"), "no_such_case"),
        (("study", "no_such_study"), "no_such_study"),
        (("mpi",), "number of ranks"),
        (("mpi", "two", "script.py"), "number of ranks"),
        (("mpi", "0", "script.py"), "number of ranks"),
        (("mpi", "2"), "script"),
        (("test", "--with", "0.8"), "0.11"),
        (("lint", "--fix"), "--fix"),
        (("setup", "--force"), "--force"),
    ],
)
def test_misuse_is_one_sentence(words, culprit):
    done = launch(*words)
    assert done.returncode == 2 and not done.stdout
    assert done.stderr.startswith("gossamer: ") and done.stderr.count("\n") == 1
    assert culprit in done.stderr


def test_it_is_plain_sh():
    for shell in filter(None, map(shutil.which, ("sh", "dash", "bash"))):
        assert subprocess.run([shell, "-n", GOSSAMER]).returncode == 0
    if shutil.which("shellcheck"):
        assert subprocess.run(["shellcheck", "-s", "sh", GOSSAMER]).returncode == 0


def test_packages_are_listed_once():
    text = (ROOT / "pyproject.toml").read_text()
    listed = re.search(
        r"^\[tool\.gossamer\]\ndebian = \[\n(.*?)^\]", text, re.MULTILINE | re.DOTALL
    )
    packages = re.findall(r'^    "([a-z0-9.+-]+)",$', listed[1], re.MULTILINE)
    assert "python3-dolfinx-real" in packages and len(packages) == listed[1].count("\n")
    for name in ("gossamer", "Containerfile", ".ci/run"):
        words = set(re.findall(r"[a-z0-9.+-]+", (ROOT / name).read_text()))
        # The launcher asks apt-get by this name whether a later Debian still has dolfinx 0.9.
        assert words & set(packages) <= {"python3-dolfinx-real", "mypy"}


def test_words_arrive_unchanged():
    words = ["a b", "", "--flag=c d", "'", '"', "$HOME", "*", "line\nbreak", "-x", "µ"]
    done = launch("python", "-c", "import sys; print(sys.argv[1:])", *words)
    assert done.stdout == f"{words}\n"


def test_standard_input_and_exit_code():
    done = launch("python", "-c", "import sys; print(sys.stdin.read()); sys.exit(7)", input="given")
    assert (done.stdout, done.stderr, done.returncode) == ("given\n", "", 7)
    done = launch("shell", input="echo $((6 * 7)); exit 3\n")
    assert (done.stdout, done.returncode) == ("42\n", 3)


def test_the_shell_has_the_python_of_the_environment(tmp_path):
    """Also where another `python` is first on PATH and Debian has only `python3`."""
    other = tmp_path / "python"
    other.write_text("#!/bin/sh\necho another python\n")
    other.chmod(0o755)
    environment = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}"}
    words = "python -c 'import dolfinx, sys; print(sys.argv[1:])' 'a b'\n"
    done = launch("shell", input=words, env=environment)
    assert (done.stdout, done.returncode) == ("['a b']\n", 0)


def test_current_folder_and_project_are_at_hand(tmp_path):
    folder = tmp_path / "with a space"
    folder.mkdir()
    link = tmp_path / "launch"
    link.symlink_to(GOSSAMER)
    done = launch(
        "python",
        "-c",
        "import os, sys; print(os.getcwd(), sys.path)",
        cwd=folder,
        program=str(link),
    )
    assert done.stdout.startswith(str(folder)) and f"'{ROOT}'" in done.stdout


@pytest.mark.parametrize("given, threads", [(None, "1"), ("2", "2")])
def test_threads(given, threads):
    environment = {name: value for name, value in os.environ.items() if name != "OMP_NUM_THREADS"}
    environment |= {"OMP_NUM_THREADS": given} if given else {}
    done = launch(
        "python", "-c", "import os; print(os.environ['OMP_NUM_THREADS'])", env=environment
    )
    assert done.stdout.strip() == threads


PATIENT = """
import signal, sys, time
def leave(number, frame):
    sys.exit(9)
signal.signal(signal.SIGTERM, leave)
signal.signal(signal.SIGHUP, leave)
try:
    print("up", flush=True)
    time.sleep(60)
except KeyboardInterrupt:
    sys.exit(11)
"""


@pytest.mark.parametrize(
    "number, code", [(signal.SIGTERM, 9), (signal.SIGHUP, 9), (signal.SIGINT, 11)]
)
def test_signals_reach_the_program(number, code):
    # a shell that runs these tests in the background has made them ignore Ctrl-C
    command = ["env", "--default-signal=INT", GOSSAMER, "python", "-c", PATIENT]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "up\n"
        process.send_signal(number)
        assert process.wait(timeout=HANG_TIMEOUT) == code


@pytest.mark.filterwarnings("ignore:.*forkpty:DeprecationWarning")
def test_ctrl_c_of_a_terminal_reaches_the_program_once():
    program = PATIENT.replace("sys.exit(11)", "time.sleep(0.5); sys.exit(11)")
    try:
        process, terminal = pty.fork()
    except OSError:
        pytest.skip("this machine has no pseudo-terminals")
    if process == 0:
        os.execvp("env", ["env", "--default-signal=INT", GOSSAMER, "python", "-c", program])
    said = b""
    while b"up" not in said:
        said += os.read(terminal, 1000)
    os.write(terminal, b"\x03")
    assert os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == 11
    os.close(terminal)


def test_mpi():
    program = "from mpi4py import MPI; c = MPI.COMM_WORLD; print(c.allreduce(c.rank), end='')"
    done = launch("mpi", "3", "-c", program)
    assert (done.stdout.strip(), done.stderr, done.returncode) == ("333", "", 0)
    assert launch("mpi", "2", "-c", "import sys; sys.exit(5)").returncode == 5
    done = launch("mpi", "2", "-c", "import sys; print(sys.stdin.read())", input="to rank 0")
    assert "to rank 0" in done.stdout


ERROR_ON_TWO_RANKS = """
import sys
from mpi4py import MPI
MPI.COMM_WORLD.barrier()
if MPI.COMM_WORLD.rank == 0:
    print("gossamer: a sentence.", file=sys.stderr, flush=True)
    {ends}
MPI.COMM_WORLD.recv() if "Abort" in {ends!r} else sys.exit(2)
"""


@pytest.mark.parametrize("ends", ["sys.exit(2)", "MPI.COMM_WORLD.Abort(2)"])
def test_an_error_on_two_ranks_ends_with_its_sentence(ends):
    """Open MPI would write after it that a rank has ended with a code that is not zero."""
    done = launch("mpi", "2", "-c", ERROR_ON_TWO_RANKS.format(ends=ends))
    assert (done.stderr.strip(), done.returncode) == ("gossamer: a sentence.", 2)


def test_a_scene_that_is_refused_on_two_ranks_is_told_in_one_sentence(tmp_path):
    done = launch("run", "--ranks", "2", "--quiet", str(tmp_path))
    assert done.returncode == 2 and done.stderr.startswith("gossamer: There is no scene file")
    assert done.stderr.count("\n") == 1


@pytest.fixture
def project(tmp_path):
    """A project of one small test file, with a copy of the launcher."""
    for name in ("gossamer", "pyproject.toml"):
        shutil.copy(ROOT / name, tmp_path)
    shutil.copytree(ROOT / "tools", tmp_path / "tools")
    (tmp_path / "tests").mkdir()

    def write(text):
        (tmp_path / "tests" / "test_small.py").write_text(text)
        return str(tmp_path / "gossamer")

    return write


MARKED = """
import pytest
from mpi4py import MPI
def test_plain():
    assert MPI.COMM_WORLD.size == 1
@pytest.mark.mpi
def test_ranks():
    assert MPI.COMM_WORLD.rank == 0 or {passes}
"""


def test_tests_run_on_one_rank_then_on_two(project):
    launcher = project(MARKED.format(passes=True))
    done = launch("test", program=launcher)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "2 passed" in done.stdout and "1 deselected" in done.stdout
    assert launch("test", "-k", "plain", program=launcher).returncode == 0
    assert launch("test", "-m", "not mpi", program=launcher).returncode == 0
    assert launch("test", "-k", "no_such_test", program=launcher).returncode == 5
    done = launch("test", program=project(MARKED.format(passes=False)))
    assert done.returncode != 0 and "FAILED tests/test_small.py::test_ranks" in done.stdout


def test_doctor():
    done = launch("doctor")
    assert done.returncode == 0, done.stdout + done.stderr
    for name in (
        "gossamer_fx",
        "environment",
        "python",
        "dolfinx",
        "petsc4py",
        "gmsh",
        "mpi",
        "compiler",
        "self-check",
    ):
        assert re.search(rf"^{name} +\S", done.stdout, re.MULTILINE)
    assert "MISSING" not in done.stdout


def test_a_private_tree_is_protected():
    if not os.environ.get("GOSSAMER_ENVIRONMENT", "").startswith("a private"):
        pytest.skip("this machine has dolfinx 0.9 itself, so that no private tree is used")
    if sys.prefix == sys.base_prefix:  # not a virtual environment, as dolfinx 0.11 has
        assert sys.executable == "/usr/bin/python3"
    for folder in ("/usr", "/etc"):
        with pytest.raises(OSError):
            (Path(folder) / "gossamer_was_here").touch()
