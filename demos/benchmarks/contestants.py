"""The programs that are compared: this one, and peers from PyPI in an environment of their own.

A contestant in a problem is the script PROBLEM_PROGRAM.py of this folder.  It takes words `key=value`, and prints as
its last line a JSON object with `cpu` and `wall` [s] of the computing alone (no start-up, no compilation), `dofs`,
`steps`, and whatever the result is, to be shown next to the time.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
PACKAGES = {
    "kratos": (
        "KratosMultiphysics==10.4.4",
        "KratosStructuralMechanicsApplication==10.4.4",
        "KratosConstitutiveLawsApplication==10.4.4",
        "KratosLinearSolversApplication==10.4.4",
    ),
    "exudyn": ("exudyn==1.13.6",),
}
SELF = "gossamer"


class Failed(Exception):
    """A contestant cannot be installed, or does not solve the problem; the message is its last words."""


def installed(program: str) -> Path:
    """The folder of a peer's packages in the user's cache, filled from PyPI at the first use.

    Raises:
        Failed: pip does not find or install them.
    """
    packages = PACKAGES[program]
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    version = f"{packages[0].split('==')[1]}-python{sys.version_info.major}.{sys.version_info.minor}"
    folder = cache / "gossamer_fx" / f"{program}-{version}"
    if not (folder / ".complete").exists():
        print(f"installing {', '.join(packages)} in {folder}", file=sys.stderr)
        pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--upgrade"]
        done = subprocess.run(
            [*pip, "--root-user-action=ignore", "--target", folder, *packages], capture_output=True, text=True
        )
        if done.returncode:
            raise Failed(f"cannot be installed: {_last_words(done)}")
        (folder / ".complete").touch()
    return folder


def run(problem: str, program: str, case: dict[str, object], seconds: float) -> dict[str, float]:
    """Let a program solve a case within `seconds`, on one thread.

    Raises:
        Failed: it does not end well, with its message.
    """
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    if program != SELF:
        environment["PYTHONPATH"] = str(installed(program))
    else:
        environment["PYTHONPATH"] = str(HERE.parent.parent)
    command = [sys.executable, str(HERE / f"{problem}_{program}.py"), *(f"{k}={v}" for k, v in case.items())]
    try:
        done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=seconds)
    except subprocess.TimeoutExpired:
        raise Failed(f"not finished after {seconds:g} s") from None
    if done.returncode:
        raise Failed(_last_words(done))
    try:
        return dict(json.loads(done.stdout.splitlines()[-1]))
    except (ValueError, IndexError):
        raise Failed(_last_words(done)) from None


def words(defaults: dict[str, float | str]) -> dict[str, float | str]:
    """The script's words `key=value` over its defaults, each of its default's type."""
    given = dict(word.split("=", 1) for word in sys.argv[1:])
    return {key: type(value)(given.get(key, value)) for key, value in defaults.items()}


def _last_words(done: subprocess.CompletedProcess[str]) -> str:
    lines = [line.strip() for line in (done.stderr or done.stdout).splitlines() if line.strip()]
    return lines[-1] if lines else f"exit code {done.returncode}"
