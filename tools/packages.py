"""Packages from PyPI that only the work on this project needs, in folders of the user's cache."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "gossamer_fx"
PIP = (sys.executable, "-m", "pip")
# Extras that the tests with dolfinx from PyPI need.
EXTRAS_OF_TESTS = ("dependencies", "light", "orbit", "patterns", "pictures", "test")
QUIETLY = ("--quiet", "--disable-pip-version-check", "--root-user-action=ignore")


def extra(name: str) -> list[str]:
    """The packages of an extra in pyproject.toml, or what the package itself requires.

    Args:
        name: of an extra, or "dependencies".
    """
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    lists: dict[str, list[str]] = project["optional-dependencies"]
    return lists.get(name) or project[name]


def folder_with(packages: Sequence[str]) -> Path:
    """A folder that has the packages, for PYTHONPATH; filled at the first use.

    Raises:
        SystemExit: pip cannot install them.
    """
    folder = CACHE / f"packages-{_digest(packages)}"
    if not folder.is_dir():
        partial = folder.with_name(f"{folder.name}.{os.getpid()}")
        _pip("install", *QUIETLY, "--target", str(partial), *packages)
        try:
            partial.rename(folder)
        except OSError:  # another command was faster
            shutil.rmtree(partial)
    return folder


def environment_with_wheels() -> Path:
    """A virtual environment with dolfinx 0.11, PETSc and MPI as wheels; made at the first use.

    Raises:
        SystemExit: pip cannot install them.
    """
    packages = [package for name in EXTRAS_OF_TESTS for package in extra(name)]
    home = CACHE / f"wheels-{_digest(packages)}"
    if not (home / "complete").exists():
        print(f"gossamer: installing dolfinx 0.11 into {home} (0.7 GB).", file=sys.stderr)
        shutil.rmtree(home, ignore_errors=True)
        subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(home)], check=True)
        _pip("--python", str(home / "bin" / "python3"), "install", *QUIETLY, *packages)
        (home / "complete").touch()
    return home


def _pip(*words: str) -> None:
    CACHE.mkdir(parents=True, exist_ok=True)
    # What pip prints does not belong to the output of the command.
    done = subprocess.run([*PIP, *words], stdout=sys.stderr)
    if done.returncode:
        packages = " ".join(word for word in words if word[0].isalpha() and word != "install")
        sys.exit(f"gossamer: {packages} could not be installed from PyPI.")


def _digest(packages: Sequence[str]) -> str:
    return hashlib.sha256(" ".join(packages).encode()).hexdigest()[:10]
