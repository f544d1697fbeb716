"""The programs that are compared: this one, and peers from PyPI in a separate environment.

A contestant in a problem is the script PROBLEM_PROGRAM.py of this folder, or for this program
`own_program.py PROBLEM`.  It takes words `key=value`, and prints as its last line a JSON object
with `cpu` and `wall` [s] of the computing alone (no start-up, no compilation), `dofs`, `steps`, and
whatever the result is, to be shown next to the time.
"""

from __future__ import annotations

import json
import logging
import os
import shutil
import subprocess
import sys
import time
import zlib
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
    "newton": ("newton==1.8.0", "warp-lang==1.19.0"),
    "ngsolve": ("ngsolve==6.2.2608", "netgen-mesher==6.2.2608"),
}
SELF = "gossamer"
CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "gossamer_fx"
# Its libraries lie next to the folder of modules, where pip puts them with a prefix only.
PREFIXED = ("ngsolve",)
LOG = logging.getLogger("gossamer_fx")


class Failed(Exception):
    """A contestant cannot be installed, or does not solve the problem; the message is its last
    words."""


def installed(program: str) -> Path:
    """The folder of a peer's modules in the user's cache, filled from PyPI at the first use.

    Raises:
        Failed: pip does not find or install them.
    """
    packages = PACKAGES[program]
    version = (
        f"{packages[0].split('==')[1]}-python{sys.version_info.major}.{sys.version_info.minor}"
    )
    folder = CACHE / f"{program}-{version}"
    if not (folder / ".complete").exists():
        print(f"installing {', '.join(packages)} in {folder}", file=sys.stderr)
        pip = [
            sys.executable,
            "-m",
            "pip",
            "install",
            "--quiet",
            "--disable-pip-version-check",
            "--upgrade",
        ]
        place = (
            ["--prefix", folder, "--ignore-installed"]
            if program in PREFIXED
            else ["--target", folder]
        )
        done = subprocess.run(
            [*pip, "--root-user-action=ignore", *place, *packages], capture_output=True, text=True
        )
        if done.returncode:
            raise Failed(f"cannot be installed: {_last_words(done)}")
        (folder / ".complete").touch()
    if program in PREFIXED:
        return next(
            path.parent
            for path in sorted(folder.rglob("netgen"))
            if (path / "__init__.py").is_file()
        )
    return folder


def run(problem: str, program: str, case: dict[str, object], seconds: float) -> dict[str, float]:
    """Let a program solve a case within `seconds`, each process on one thread.

    Of the case's words `ranks` is how many processes MPI starts, one without it; words in capitals
    are variables of the environment; the others are the script's.

    Raises:
        Failed: it does not end well, with its message.
    """
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    environment["PYTHONPATH"] = str(installed(program) if program != SELF else HERE.parent.parent)
    environment |= {key: str(value) for key, value in case.items() if key.isupper()}
    script = [sys.executable, str(HERE / f"{problem}_{program}.py")]
    if program == SELF:
        script = [sys.executable, str(HERE / "own_program.py"), problem]
    given = [
        f"{key}={value}" for key, value in case.items() if not key.isupper() and key != "ranks"
    ]
    start = ["mpirun", "-n", str(case["ranks"])] if "ranks" in case else []
    if "ranks" in case and problem == "rank_counts":
        # Of the ranks alone: mpirun would not start with it.
        start += ["env", f"LD_PRELOAD={message_counter()}"]
    with subprocess.Popen(
        [*start, *script, *given],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
    ) as process:
        try:
            output, errors = process.communicate(timeout=seconds)
        except BaseException as why:
            process.terminate()  # mpirun hands it on to its ranks; a kill would leave them
            if isinstance(why, subprocess.TimeoutExpired):
                raise Failed(f"not finished after {seconds:g} s") from None
            raise
    done = subprocess.CompletedProcess(process.args, process.returncode, output, errors)
    if done.returncode:
        raise Failed(_last_words(done))
    results = [
        line for line in output.splitlines() if line.startswith("{")
    ]  # libraries may say good-bye after it
    if not results:
        raise Failed(_last_words(done))
    figures = dict(json.loads(results[-1]))
    # Warnings of the other process are those of this one, so that the engine of cases finds them.
    for text in figures.pop("warnings", []):
        LOG.warning("%s", text)
    return figures


def message_counter() -> Path:
    """The library of `count_messages.c`, compiled in the user's cache for the MPI of `mpicc`.

    Raises:
        Failed: there is no `mpicc`, or it does not compile, as that of another MPI than Open MPI.
    """
    compiler = shutil.which("mpicc")
    if compiler is None:
        raise Failed("mpicc is missing")
    source = HERE / "count_messages.c"
    # A machine may have several MPIs.
    digest = zlib.crc32(source.read_bytes() + compiler.encode())
    library = CACHE / f"count_messages-{digest:08x}.so"
    if not library.exists():
        library.parent.mkdir(parents=True, exist_ok=True)
        # Fortran's part of Open MPI is named, as C does not link it by itself.  That of MPICH hands
        # its calls to C's, which would be counted twice.
        command = [compiler, "-shared", "-fPIC", "-O2", "-o", library, source, "-lmpi_mpifh"]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            raise Failed(f"cannot be compiled: {_last_words(done)}")
    return library


class Clock:
    """The time of computing, from here on."""

    def __init__(self) -> None:
        self._cpu = time.process_time()
        self._wall = time.perf_counter()

    def figures(self) -> dict[str, float]:
        """CPU and wall time [s] until now."""
        return {
            "cpu": time.process_time() - self._cpu,
            "wall": time.perf_counter() - self._wall,
        }


def words(defaults: dict[str, float | str]) -> dict[str, float | str]:
    """The script's words `key=value` over its defaults, each of its default's type."""
    given = dict(word.split("=", 1) for word in sys.argv[1:])
    return {key: type(value)(given.get(key, value)) for key, value in defaults.items()}


def _last_words(done: subprocess.CompletedProcess[str]) -> str:
    lines = [line.strip() for line in (done.stderr or done.stdout).splitlines() if line.strip()]
    return lines[-1] if lines else f"exit code {done.returncode}"
