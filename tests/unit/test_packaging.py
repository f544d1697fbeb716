"""What a user installs: metadata, and wheel and source distribution as they are built."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

import gossamer_fx as gx

ROOT = Path(gx.__file__).parent.parent
PROJECT = ROOT / "pyproject.toml"


def test_the_version_is_told_everywhere_alike() -> None:
    assert f"version: {gx.__version__}\n" in (ROOT / "CITATION.cff").read_text()
    done = subprocess.run(
        [sys.executable, "-m", "gossamer_fx", "--version"], capture_output=True, text=True, cwd=ROOT
    )
    assert done.stdout == f"gossamer_fx {gx.__version__}\n"
    assert f"## {gx.__version__}" in (ROOT / "CHANGELOG.md").read_text()


def test_what_is_missing_is_told_in_one_sentence() -> None:
    code = "import sys; sys.modules['dolfinx'] = None\nimport gossamer_fx\ngossamer_fx.Membrane"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    last = done.stderr.strip().splitlines()[-1]
    assert (
        done.returncode == 1
        and "ImportError" in last
        and "needs dolfinx" in last
        and "[light]" in last
    )


def test_third_party_imports_are_in_some_extra() -> None:
    project = tomllib.loads(PROJECT.read_text())["project"]
    words = [
        *project["dependencies"],
        *(word for extra in project["optional-dependencies"].values() for word in extra),
    ]
    named = {re.split(r"[\[=<>~!]", word)[0] for word in words}
    for module, distribution in (
        ("matplotlib", "matplotlib"),
        ("rich", "rich"),
        ("erfa", "pyerfa"),
        ("gmsh", "gmsh"),
    ):
        assert distribution in named, module


@pytest.mark.slow
def test_wheel_and_source_distribution_install_beside_dolfinx(tmp_path: Path) -> None:
    """Both are built; the wheel goes into a fresh venv that sees the system's dolfinx and blows a pillow up; what is in
    the source distribution passes tests of its own with that wheel."""
    if (ROOT / ".git").exists() is False and not (ROOT / ".gitignore").exists():
        pytest.skip("this is a source distribution itself")
    quiet = ["--quiet", "--disable-pip-version-check"]
    env = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PIP_TARGET")}

    def run(*words: str | Path, cwd: Path = tmp_path) -> str:
        done = subprocess.run(
            [str(w) for w in words], cwd=cwd, env=env, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    hatch = tmp_path / "hatch"
    run(sys.executable, "-m", "pip", "install", *quiet, "--target", hatch, "hatchling>=1.27")
    env["PYTHONPATH"] = str(hatch)
    run(sys.executable, "-m", "hatchling", "build", "-d", tmp_path / "dist", cwd=ROOT)
    del env["PYTHONPATH"]
    [wheel], [source] = (tmp_path / "dist").glob("*.whl"), (tmp_path / "dist").glob("*.tar.gz")
    inside = set(zipfile.ZipFile(wheel).namelist())
    for path in (ROOT / "gossamer_fx").rglob("*"):
        if path.is_file() and "__pycache__" not in path.parts:
            assert str(path.relative_to(ROOT)) in inside
    assert not any(name.startswith(("tests/", "demos/", "meshes/")) for name in inside)

    home = tmp_path / "venv"
    run(sys.executable, "-m", "venv", "--system-site-packages", "--without-pip", home)
    python = home / "bin" / "python3"
    run(sys.executable, "-m", "pip", "--python", python, "install", *quiet, "--no-deps", wheel)
    with tarfile.open(source) as archive:
        archive.extractall(tmp_path / "source", filter="data")
    [tree] = (tmp_path / "source").iterdir()
    for name in (
        "README.md",
        "CITATION.cff",
        "gossamer",
        "docs/conf.py",
        "tests/conftest.py",
        "meshes/sheet.py",
    ):
        assert (tree / name).is_file(), name

    scene = tmp_path / "pillow.py"
    scene.write_text((tree / "demos" / "pillow.py").read_text())
    said = run(home / "bin" / "gossamer", "run", scene, "cells=4", "until=2e-3")
    assert "written to" in said and (tmp_path / "out" / "pillow" / "ledger.csv").is_file()
    assert str(home) in run(python, "-c", "import gossamer_fx; print(gossamer_fx.__file__)")

    for name in (
        "gossamer_fx",
        "gossamer",
    ):  # the tests find the installed package, as a packager's do
        (tree / name).rename(tree / f"{name}.away")
    files = ("tests/unit/test_gas.py", "tests/unit/test_materials.py")
    assert "passed" in run(python, "-m", "pytest", "-p", "no:cacheprovider", *files, cwd=tree)
