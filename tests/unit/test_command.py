"""The installed command: ranks, demos, missing packages, and what mpirun writes."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import gossamer_fx as gx
from gossamer_fx.app.cli import demo, doctor, launch
from gossamer_fx.app.cli.command import main
from gossamer_fx.app.cli.launch import RULE, MessageFilter
from gossamer_fx.app.cli.script import AS_DEMO, BEHIND_THE_DOOR
from gossamer_fx.app.cli.user_files import check_arguments_of, option
from tests.hanging import HANG_TIMEOUT

ROOT = Path(__file__).resolve().parents[2]

# what prterun of Open MPI 5.0.7 writes
EXIT_CODE = (
    RULE
    + b"""
prterun detected that one or more processes exited with non-zero status,
thus causing the job to be terminated. The first process to do so was:

   Process name: [prterun-vm-20596@1,1]
   Exit code:    2
"""
    + RULE
    + b"\n"
)
ABORTED = (
    RULE
    + b"""
MPI_ABORT was invoked on rank 0 in communicator MPI_COMM_WORLD
  Proc: [[42520,1],0]
  Errorcode: 2

NOTE: invoking MPI_ABORT causes Open MPI to kill all MPI processes.
"""
    + RULE
    + b"\n"
    + RULE
    + b"""
prterun has exited due to process rank 0 with PID 0 on node vm calling
"abort". This may have caused other processes in the application to be
terminated by signals sent by prterun (as reported here).
"""
    + RULE
    + b"\n\0"
)
KILLED = (
    RULE
    + b"""
prterun noticed that process rank 1 with PID 21461 on node vm exited on
signal 9 (Killed).
"""
    + RULE
    + b"\n"
)


def filtered(data: bytes, size: int) -> bytes:
    """What passes of data that come in pieces of a size."""
    passed: list[bytes] = []
    messages = MessageFilter(passed.append)
    for begin in range(0, len(data), size):
        messages.feed(data[begin : begin + size])
    messages.close()
    return b"".join(passed)


@pytest.mark.parametrize("size", [1, 2, 7, 73, 74, 75, 76, 400, 10**6])
@pytest.mark.parametrize(
    "repetition", [EXIT_CODE, ABORTED, EXIT_CODE + ABORTED], ids=["code", "abort", "both"]
)
def test_what_open_mpi_repeats_is_removed(size: int, repetition: bytes) -> None:
    sentence = b"gossamer: The mesh is damaged.\n"
    assert filtered(sentence + repetition, size) == sentence
    assert filtered(repetition + sentence, size) == sentence
    middle = b"10 %\r" + repetition + b"20 %\r---- a -- b\n" + RULE + b"\n" + sentence
    assert filtered(middle, size) == middle.replace(repetition, b"")


@pytest.mark.parametrize(
    "line",
    [
        b"Abort(2) on node 0 (rank 0 in comm 0): "
        b"application called MPI_Abort(MPI_COMM_WORLD, 2) - process 0\n",
        b"[vm:21134] PMIX ERROR: PMIX_ERR_UNREACH in file ../src/server/pmix_server.c at line 3184\n",
    ],
    ids=["MPICH", "PMIx"],
)
def test_a_line_about_a_rank_that_has_ended_is_removed(line: bytes) -> None:
    sentence = b"gossamer: The mesh is damaged.\n"
    assert filtered(sentence + line, 10**6) == sentence
    assert filtered(line, 10**6) == line
    # written by another process between the lines of a message
    lines = EXIT_CODE.splitlines(keepends=True)
    for place in range(len(lines)):
        parts = [sentence, *lines[:place], line, *lines[place:]]
        assert filtered(b"".join(parts), 10**6) == sentence


@pytest.mark.parametrize("size", [1, 76, 10**6])
def test_other_messages_pass(size: int) -> None:
    for data in (KILLED, b"words\n" + KILLED, RULE, RULE + b"\n" + RULE, RULE + b"x" * 1000):
        assert filtered(data, size) == data
    words = b"gossamer: Lost.\n"
    assert filtered(words + KILLED + EXIT_CODE, size) == words + KILLED


@pytest.mark.parametrize("size", [1, 76, 10**6])
def test_a_failure_without_words_keeps_the_message(size: int) -> None:
    assert filtered(EXIT_CODE, size) == EXIT_CODE


def test_progress_passes_at_once() -> None:
    passed: list[bytes] = []
    messages = MessageFilter(passed.append)
    messages.feed(b"10 %\r")
    messages.feed(b"20 %\r-")
    assert passed == [b"10 %\r", b"20 %\r"]
    messages.feed(b"-" * 73 + b"\nA table\n")
    assert b"".join(passed) == b"10 %\r20 %\r" + RULE + b"\nA table\n"


def test_mpirun_beside_the_python_of_an_environment_comes_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The environment need not be activated."""
    for name in ("venv", "path"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "mpirun").touch(mode=0o755)
    monkeypatch.setenv("PATH", str(tmp_path / "path"))
    monkeypatch.setattr(sys, "executable", str(tmp_path / "venv" / "python3"))
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "venv"))
    assert launch.find_mpirun() == str(tmp_path / "venv" / "mpirun")
    monkeypatch.setattr(sys, "prefix", "/usr")
    assert launch.find_mpirun() == str(tmp_path / "path" / "mpirun")


def test_a_missing_mpirun_is_told_in_one_sentence(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(launch, "find_mpirun", lambda: None)
    assert launch.launch(2, ["-c", "1"]) == 1
    said = capsys.readouterr().err
    assert said.startswith("gossamer: there is no mpirun") and "2 ranks" in said
    assert said.count("\n") == 1


@pytest.mark.parametrize("words", [[], ["2"], ["two", "a.py"], ["0", "a.py"], ["-1", "a.py"]])
def test_a_number_of_ranks_must_be_one(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert launch.main(words) == 2
    assert re.fullmatch(r"gossamer: mpi needs a number of ranks.*\n", capsys.readouterr().err)


LISTENER = """
import signal, sys, time
from pathlib import Path
heard = []
for number in (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1):
    signal.signal(number, lambda number, frame: heard.append(number))
Path(sys.argv[1], str(time.monotonic_ns())).touch()
while not heard:
    time.sleep(0.01)
time.sleep(0.2)
sys.exit(len(heard) - 1)
"""
LAUNCH = """
import sys
from gossamer_fx.app.cli import launch
launch.find_mpirun = lambda: sys.argv[2]
sys.exit(launch.{how}(2, ["-c", sys.argv[3], sys.argv[1]]))
"""


@pytest.mark.parametrize(
    "how, number", [("launch", signal.SIGUSR1), ("launch_alike", signal.SIGINT)]
)
def test_a_signal_reaches_the_started_programs_once(
    how: str, number: signal.Signals, tmp_path: Path
) -> None:
    """USR1 as of Slurm, and Ctrl-C, which a terminal sends to the whole group."""
    mpirun = tmp_path / "mpirun"
    mpirun.write_text('#!/bin/sh\nshift 2\nexec "$@"\n')
    mpirun.chmod(0o755)
    ready = tmp_path / "ready"
    ready.mkdir()
    count = 1 if how == "launch" else 2
    code = LAUNCH.format(how=how)
    with subprocess.Popen(
        [sys.executable, "-c", code, str(ready), str(mpirun), LISTENER],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stderr=subprocess.PIPE,
        start_new_session=True,
    ) as process:
        while len(list(ready.iterdir())) < count and process.poll() is None:
            time.sleep(0.02)
        os.killpg(process.pid, number)
        said = process.communicate(timeout=HANG_TIMEOUT)[1]
    assert (process.returncode, said) == (0, b"")


def command(*words: str, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run `gossamer` as it is installed."""
    return subprocess.run(
        [sys.executable, "-m", "gossamer_fx", *words],
        cwd=ROOT,
        env=os.environ | variables,
        capture_output=True,
        text=True,
    )


@pytest.mark.skipif(
    "OMPI_COMM_WORLD_SIZE" in os.environ or "PMI_SIZE" in os.environ, reason="one rank is enough"
)
class TestInstalledCommand:
    def test_ranks_of_another_mpi_are_told(self, tmp_path: Path) -> None:
        """That mpirun has started two ranks, each of which is alone."""
        for rank, lines in ((0, 1), (1, 0)):
            # variables that this MPI does not read, as it has been started without PMI
            done = command("report", str(tmp_path), PMI_SIZE="2", PMI_RANK=str(rank))
            assert done.returncode == 1 and done.stderr.count("\n") == lines, done
            assert "2 ranks that do not see each other" in done.stderr or rank == 1

    def test_ranks_that_were_not_started_are_told(self, tmp_path: Path) -> None:
        """As under srun; the script of a job of Slurm is not a rank, and starts them."""
        words = ("run", str(tmp_path / "no.py"), "--ranks", "2")
        done = command(*words, SLURM_STEP_ID="0")
        assert done.returncode == 2 and done.stderr.count("\n") == 1
        assert "--ranks is 2, but mpirun or srun has started 1" in done.stderr
        done = command(*words, SLURM_PROCID="0", PATH="")
        assert "no mpirun" in done.stderr or "no scene file" in done.stderr

    def test_a_python_without_mpi4py_is_told_in_one_sentence(self, tmp_path: Path) -> None:
        hidden = tmp_path / "mpi4py"
        hidden.mkdir()
        (hidden / "__init__.py").write_text("raise ImportError('no MPI here')")
        paths = f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}"
        done = command("report", str(tmp_path), PYTHONPATH=paths)
        assert done.returncode == 1 and "mpi4py cannot be imported (no MPI here)" in done.stderr
        assert done.stderr.count("\n") == 1

    def test_an_unknown_demo_is_told_with_the_known_ones(self) -> None:
        done = command("demo", "no_such_demo")
        assert done.returncode == 2 and done.stderr.count("\n") == 1
        assert "no demo 'no_such_demo'" in done.stderr and "folded_tube" in done.stderr

    @pytest.mark.parametrize(
        ("words", "said"),
        [
            (["robust_tube", "foo=1"], "There is no argument 'foo'"),
            (["robust_tube", "foo"], "'foo' has no value"),
            (["robust_tube", "length=0.9"], "There is no design of 0.9 m"),
            (["disc_waves", "folded", "x"], "'x' is not a number"),
            (["sprout", "opened"], "The demo has no 'opened'"),
        ],
    )
    def test_wrong_words_of_a_demo_are_told_in_a_sentence(
        self, words: list[str], said: str
    ) -> None:
        done = command("demo", *words)
        assert done.returncode == 2
        assert done.stderr.startswith(f"gossamer: {said}") and done.stderr.count("\n") == 1

    @pytest.mark.parametrize(
        ("body", "said"),
        [
            ("number('x')", "gossamer: 'x' is not a number; give one, e.g. 0.8.\n"),
            ("1 / 0", "ZeroDivisionError"),
        ],
    )
    def test_a_demo_without_the_command_ends_in_a_sentence_too(
        self, tmp_path: Path, body: str, said: str
    ) -> None:
        """Of an error of the program, and in a script of the user, the trace helps."""
        (tmp_path / "demos" / "sails").mkdir(parents=True)
        (tmp_path / "demos" / "common").symlink_to(ROOT / "demos" / "common")
        text = f"from demos.common.command_line import number\n\n{body}\n"
        demo_file = tmp_path / "demos" / "sails" / "one.py"
        script = tmp_path / "own.py"
        for file in (demo_file, script):
            file.write_text(text)
            done = subprocess.run(
                [sys.executable, str(file)],
                env={**os.environ, "PYTHONPATH": f"{tmp_path}:{ROOT}"},
                capture_output=True,
                text=True,
            )
            is_sentence = file == demo_file and "gossamer" in said
            assert ("Traceback" in done.stderr) != is_sentence, done.stderr
            if is_sentence:
                assert done.stderr == said and done.returncode == 2
            else:
                assert "_say" not in done.stderr and done.returncode == 1

    @pytest.mark.parametrize(
        ("error", "code"), [("InputError", 2), ("StepFailure", 1), ("NoEquilibrium", 1)]
    )
    def test_an_error_of_a_demo_is_a_sentence(self, tmp_path: Path, error: str, code: int) -> None:
        """A script of the user shows which of its lines has raised it."""
        script = tmp_path / "wrong.py"
        script.write_text(f"import gossamer_fx as gx\nraise gx.{error}('thickness must be > 0.')\n")
        for first, has_trace in (([AS_DEMO], False), ([], True)):
            done = subprocess.run(
                [sys.executable, *BEHIND_THE_DOOR, *first, str(script)],
                env=launch.child_environment(),
                capture_output=True,
                text=True,
            )
            assert ("Traceback" in done.stderr) == has_trace, done.stderr
            if not has_trace:
                assert done.returncode == code
                assert done.stderr == "gossamer: thickness must be > 0.\n"

    def test_help_lists_demo_and_doctor(self) -> None:
        said = command("--help").stdout
        assert re.search(r"^ +demo ", said, re.MULTILINE)
        assert re.search(r"^ +doctor ", said, re.MULTILINE)


def test_demos_are_those_of_the_clone_or_of_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert demo.find_demos() == ROOT / "demos"
    # as it is installed by a wheel
    monkeypatch.setattr(demo, "__file__", str(tmp_path / "gossamer_fx" / "cli" / "demo.py"))
    monkeypatch.chdir(tmp_path)
    assert demo.main(["pillow"]) == 2
    assert "start gossamer demo in a clone" in capsys.readouterr().err
    monkeypatch.chdir(ROOT)
    assert demo.find_demos() == ROOT / "demos"


def test_the_words_of_a_demo_are_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[list[str]] = []
    monkeypatch.setattr(os, "execv", lambda program, words: started.append(words))
    monkeypatch.setenv("PYTHONPATH", "")
    demo.main([])
    demo.main(["sprout.py", "deployed"])
    programs = [(Path(words[5]).name, words[6:]) for words in started]
    assert programs == [("folded_tube.py", []), ("sprout.py", ["deployed"])]


def test_a_demo_starts_neither_for_help_nor_with_words_that_it_does_not_take(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delattr(os, "execv")
    assert demo.main(["pillow", "--help"]) == 0
    assert "./gossamer demo pillow" in capsys.readouterr().out
    assert demo.main(["pillow", "cells=8"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "leave 'cells=8' out" in said


def test_doctor_tells_what_is_missing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(doctor, "NEEDED", (*doctor.NEEDED, "no_such_package"))
    monkeypatch.setattr(doctor, "rank_failures", lambda: ["two MPI ranks do not work together"])
    assert doctor.main() == 1
    said = capsys.readouterr().out
    assert re.search(r"^processor +\S", said, re.MULTILINE)
    assert re.search(r"^no_such_package +MISSING$", said, re.MULTILINE)
    assert re.search(r"^FAILED +the Python package no_such_package is MISSING$", said, re.MULTILINE)
    assert re.search(r"^FAILED +two MPI ranks", said, re.MULTILINE)


def test_doctor_solves_exactly() -> None:
    assert doctor.solution_error() < doctor.SOLVER_TOLERANCE


def test_a_truth_value_is_not_taken_for_a_word() -> None:
    """As a word, "false" would count as true."""

    def build(comm: object, held: bool = True, name: str = "film") -> None:
        """The function of a scene file."""

    given = [option(word) for word in ("held=false", "name=off")]
    assert given == [("held", False), ("name", "off")]
    check_arguments_of(build, Path("scene.py"), given)
    with pytest.raises(gx.InputError, match="held is 'off'; give true or false"):
        check_arguments_of(build, Path("scene.py"), [option("held=off")])


def test_an_argument_that_is_given_twice_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The last one counted."""
    scene = tmp_path / "fall.py"
    scene.write_text("def build(comm, mass=1.0):\n    raise RuntimeError(mass)\n")
    assert main(["run", str(scene), "mass=2", "mass=3", "--dry-run"]) == 2
    assert "mass is given 2 times" in capsys.readouterr().err


@pytest.mark.parametrize("word", ["-----1", "--=", "-\u00e9", "--restart=-----1"])
def test_an_unknown_word_is_refused_in_a_sentence(
    word: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["plot", "run", word])
    said = capsys.readouterr().err
    assert ended.value.code == 2 and said.count("\n") == 1 and said.startswith("gossamer: ")


@pytest.mark.parametrize(
    "text", ["{[]: 1}", "{{}: 1}", "1_", "(" * 1000, "1" * 5000, "\x00"], ids=range(6)
)
def test_what_python_does_not_read_is_a_word(text: str) -> None:
    assert option(f"name={text}") == ("name", text)


TYPO = """
import gossamer_fx as gx

def build(comm):
    ball = gx.PointMass(2.0, comm=comm, name="ball")
    ball.prot()
"""


def test_an_unknown_name_of_an_object_has_a_proposal(tmp_path: Path) -> None:
    (tmp_path / "typo.py").write_text(TYPO)
    command = [sys.executable, "-P", "-m", "gossamer_fx", "run", "typo.py"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    said = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert said.returncode == 2 and said.stderr.count("\n") == 1
    assert "'typo.py', line 6: AttributeError" in said.stderr
    assert "has no attribute 'prot'; did you mean port?" in said.stderr
    # A name of the package is proposed once, by its own message.
    (tmp_path / "typo.py").write_text(TYPO.replace("ball.prot", "gx" + ".loads.Damping"))
    said = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert "did you mean gossamer_fx.Damping" in said.stderr
    assert said.stderr.count("did you mean") == 1


def test_a_scene_is_read_from_its_text_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Compiled code would be that of another text of the same size and second."""
    from gossamer_fx.app.cli.user_files import load

    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    monkeypatch.setattr(sys, "pycache_prefix", None)
    scene = tmp_path / "scene_of_one_second.py"
    for number in (1, 2):
        scene.write_text(f"number = {number}\n")
        os.utime(scene, (1e9, 1e9))
        assert load(scene).number == number
    assert not list(tmp_path.glob("**/*.pyc"))
