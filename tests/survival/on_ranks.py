"""How a test starts a program on several ranks."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from mpi4py import MPI

import gossamer_fx as gx
from tests.hanging import HANG_TIMEOUT

ROOT = Path(gx.__file__).parent.parent
# Open MPI asks for leave to have more ranks than cores, MPICH does not know the word
MANY = ("--oversubscribe",) if "Open MPI" in MPI.Get_library_version() else ()


def python(ranks: int) -> list[str]:
    """The words before the arguments of Python."""
    return [sys.executable] if ranks == 1 else ["mpirun", *MANY, "-n", str(ranks), sys.executable]


def start(command: list[str], **options: Any) -> subprocess.Popen[str]:
    """A command in the folder of the project, whose output is kept."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.Popen(command, cwd=ROOT, env=environment, text=True, **pipes | options)


def complete(command: list[str]) -> subprocess.CompletedProcess[str]:
    """Run a command to its end."""
    run = start(command)
    out, err = run.communicate(timeout=HANG_TIMEOUT)
    return subprocess.CompletedProcess(command, run.returncode, out, err)


def complete_module(name: str, *words: object, ranks: int = 1) -> subprocess.CompletedProcess[str]:
    """Run a module of tests/survival to its end."""
    module = f"tests.survival.{name}"
    return complete([*python(ranks), "-m", module, *map(str, words)])
