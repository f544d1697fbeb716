"""The environment and the configuration of the user: what a library cannot read in them is told in
one sentence, by each command."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from mpi4py import MPI

from tests.hanging import HANG_TIMEOUT
from tests.sentences import is_line_of_command
from tests.survival.on_ranks import ROOT

pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="starts programs")

SCENE = """
import gossamer_fx as gx
from petsc4py import PETSc


def build(comm):
    ball = gx.PointMass(1.0, position=(0.0, 0.0, 1.0), comm=comm, name="ball")
    assert PETSc.Options().hasName("of_the_user")
    return gx.Case(gx.Scene(ball), gx.Midpoint(dt=1e-3), until=2e-3)
"""

COMMANDS = [
    ("run", "scene.py"),
    ("report", "out"),
    ("watch", "out"),
    ("export", "out"),
    ("validate", "all"),
]


def program(folder: Path, words: tuple[str, ...], **variables: str) -> tuple[int, str]:
    """The exit code and the standard error of a command in a folder."""
    done = subprocess.run(
        [sys.executable, "-P", "-m", "gossamer_fx", *words],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)} | variables,
        capture_output=True,
        text=True,
        timeout=HANG_TIMEOUT,
    )
    return done.returncode, done.stderr


@pytest.mark.parametrize("words", COMMANDS, ids=lambda words: words[0])
def test_a_missing_file_of_options_is_told_by_each_command(
    tmp_path: Path, words: tuple[str, ...]
) -> None:
    (tmp_path / "scene.py").write_text(SCENE)
    code, said = program(tmp_path, words, PETSC_OPTIONS="-options_file missing")
    assert code in (1, 2) and is_line_of_command(said), said
    assert "PETSC_OPTIONS names the file 'missing'" in said


@pytest.mark.parametrize(
    ("variable", "value", "words"),
    [
        ("PETSC_OPTIONS", "-options_file_yaml missing", "names the file 'missing'"),
        ("PETSC_OPTIONS", "-options_file fifo", "is a FIFO"),
        ("PETSC_OPTIONS", "-options_file", "is a folder"),
        ("PETSC_OPTIONS", "-malloc_debug x", "Unknown logical value: x"),
        ("XDG_CONFIG_HOME", "/dev/null", "file of options of ffcx"),
        ("XDG_CONFIG_HOME", "config", "file of options of dolfinx"),
        ("PYTHONOPTIMIZE", "2", "without docstrings"),
        ("OMPI_COMM_WORLD_SIZE", "word", "has started word ranks"),
        ("OMPI_COMM_WORLD_SIZE", "3", "has started 3 ranks"),
    ],
)
def test_what_a_library_refuses_is_told(
    tmp_path: Path, variable: str, value: str, words: str
) -> None:
    (tmp_path / "scene.py").write_text(SCENE)
    os.mkfifo(tmp_path / "fifo")
    if value == "config":
        options = tmp_path / "config/dolfinx/dolfinx_jit_options.json"
        options.parent.mkdir(parents=True)
        options.write_text("[1")
        value = str(tmp_path / "config")
    code, said = program(tmp_path, ("run", "scene.py"), **{variable: value})
    assert code in (1, 2) and is_line_of_command(said), said
    assert words in said


def test_a_backend_of_matplotlib_that_does_not_exist_is_told(tmp_path: Path) -> None:
    (tmp_path / "scene.py").write_text(SCENE)
    options = {"PETSC_OPTIONS": "-of_the_user"}
    assert program(tmp_path, ("run", "scene.py", "-o", "out", "--quiet"), **options)[0] == 0
    code, said = program(tmp_path, ("report", "out"), MPLBACKEND="nonsense", **options)
    assert code == 2 and is_line_of_command(said), said
    assert "MPLBACKEND" in said


def test_a_file_of_options_is_named_from_where_the_user_stands(tmp_path: Path) -> None:
    """PETSc is started while another folder is the current one."""
    (tmp_path / "scene.py").write_text(SCENE)
    (tmp_path / "options").write_text("-of_the_user\n-options_left no\n")
    code, said = program(
        tmp_path, ("run", "scene.py", "--quiet"), PETSC_OPTIONS="-options_file options"
    )
    assert code == 0, said


def test_a_name_that_is_not_utf8_is_a_name(tmp_path: Path) -> None:
    """dolfinx reads the words of the command line as UTF-8."""
    (tmp_path / "scene.py").write_text(SCENE)
    name = os.fsdecode(b"out\xff")
    words = ("run", "scene.py", "-o", name)
    code, said = program(tmp_path, words, PETSC_OPTIONS="-of_the_user")
    assert code == 0, said
    done = subprocess.run(
        [sys.executable, "-P", "-m", "gossamer_fx", "report", name],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        timeout=HANG_TIMEOUT,
    )
    assert done.returncode == 0, done.stderr
    # Scripts get the name as it is.
    assert done.stdout == b"out\xff/report.html\n"


def test_a_word_that_is_refused_does_not_control_the_terminal(tmp_path: Path) -> None:
    code, said = program(tmp_path, ("export", "out", "--every", "\x1b[2J"))
    assert code == 2 and is_line_of_command(said), said
    assert "\x1b" not in said
