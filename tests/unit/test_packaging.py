"""What a user installs: metadata, and wheel and source distribution as they are built."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from dataclasses import dataclass
from pathlib import Path

import pytest

import gossamer_fx as gx
from tests.survival.on_ranks import complete

ROOT = Path(gx.__file__).parent.parent
QUIET = ("--quiet", "--disable-pip-version-check", "--root-user-action=ignore")
PROJECT = ROOT / "pyproject.toml"


def test_the_version_is_told_everywhere_alike() -> None:
    assert f"version: {gx.__version__}\n" in (ROOT / "CITATION.cff").read_text()
    done = complete([sys.executable, "-m", "gossamer_fx", "--version"])
    assert done.stdout == f"gossamer_fx {gx.__version__}\n"
    assert f"## {gx.__version__}" in (ROOT / "CHANGELOG.md").read_text()


def test_what_is_missing_is_told_in_one_sentence() -> None:
    code = "import sys; sys.modules['dolfinx'] = None\nimport gossamer_fx\ngossamer_fx.Membrane"
    done = complete([sys.executable, "-c", code])
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
        ("erfa", "pyerfa"),
        ("gmsh", "gmsh"),
    ):
        assert distribution in named, module


@dataclass(frozen=True)
class Archives:
    """A wheel and a source distribution of this project, and the hatchling that made them."""

    wheel: Path
    source: Path
    hatchling: Path


def execute(*words: str | Path, folder: Path, extra_modules: Path | None = None) -> str:
    """Standard output of a command that sees nothing of the clone; both streams if it fails."""
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PIP_TARGET")}
    if extra_modules is not None:
        environment["PYTHONPATH"] = str(extra_modules)
    done = subprocess.run(
        [str(word) for word in words],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def archives(tmp_path_factory: pytest.TempPathFactory) -> Archives:
    if not (ROOT / ".gitignore").exists():
        pytest.skip("this is not a clone and not a source distribution")
    folder = tmp_path_factory.mktemp("archives")
    hatchling = folder / "hatchling"
    install = [sys.executable, "-m", "pip", "install", *QUIET]
    execute(*install, "--target", hatchling, "hatchling>=1.27", folder=folder)
    build = [sys.executable, "-m", "hatchling", "build", "-d", folder / "dist"]
    execute(*build, folder=ROOT, extra_modules=hatchling)
    [wheel] = (folder / "dist").glob("*.whl")
    [source] = (folder / "dist").glob("*.tar.gz")
    return Archives(wheel, source, hatchling)


def unpacked(source: Path, folder: Path) -> Path:
    """The folder of a source distribution."""
    with tarfile.open(source) as archive:
        archive.extractall(folder, filter="data")
    [tree] = folder.iterdir()
    return tree


def environment_with(package: Path, archives: Archives, folder: Path) -> Path:
    """Folder `bin` of a fresh virtual environment that has the package and the system's dolfinx."""
    home = folder / "venv"
    make = [sys.executable, "-m", "venv", "--system-site-packages", "--without-pip", home]
    execute(*make, folder=folder)
    pip = [sys.executable, "-m", "pip", "--python", home / "bin" / "python3", "install", *QUIET]
    without_network = ["--no-deps", "--no-build-isolation"]
    execute(*pip, *without_network, package, folder=folder, extra_modules=archives.hatchling)
    return home / "bin"


@pytest.mark.slow
def test_the_wheel_has_the_package_with_its_meshes_and_nothing_else(archives: Archives) -> None:
    inside = set(zipfile.ZipFile(archives.wheel).namelist())
    for path in (ROOT / "gossamer_fx").rglob("*"):
        if path.is_file() and "__pycache__" not in path.parts:
            assert str(path.relative_to(ROOT)) in inside
    for path in (ROOT / "meshes").glob("*.py"):
        assert f"gossamer_fx/build/meshes/{path.name}" in inside
    assert {name.split("/")[0].split("-")[0] for name in inside} == {"gossamer_fx"}


@pytest.mark.slow
def test_the_source_distribution_makes_the_same_wheel(archives: Archives, tmp_path: Path) -> None:
    tree = unpacked(archives.source, tmp_path / "source")
    files = ("README.md", "CITATION.cff", "gossamer", "docs/conf.py", "tests/conftest.py")
    for name in (*files, "meshes/sheet.py", "gossamer_fx/build/meshes/sheet.py"):
        assert (tree / name).is_file(), name
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", tmp_path / "dist"]
    execute(*build, folder=tree, extra_modules=archives.hatchling)
    [again] = (tmp_path / "dist").glob("*.whl")
    names = [set(zipfile.ZipFile(wheel).namelist()) for wheel in (archives.wheel, again)]
    assert names[0] == names[1]


@pytest.mark.slow
@pytest.mark.parametrize("package", ["wheel", "source distribution", "clone"])
def test_the_scene_of_the_readme_runs_outside_the_clone(
    archives: Archives, tmp_path: Path, package: str
) -> None:
    """With what `pip install` makes of the wheel, the source distribution and the clone itself."""
    packages = {"wheel": archives.wheel, "source distribution": archives.source, "clone": ROOT}
    programs = environment_with(packages[package], archives, tmp_path)
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    [scene] = re.findall(r"^```python\n(.*?)^```", readme, re.DOTALL | re.MULTILINE)
    (tmp_path / "scene.py").write_text(scene)
    said = execute(programs / "python3", "scene.py", folder=tmp_path)
    assert re.fullmatch(r"\d+ Pa; energy closes to \S+, gas to \S+\n", said)
    where = "import gossamer_fx.meshes; print(gossamer_fx.meshes.__file__)"
    home = execute(programs / "python3", "-c", where, folder=tmp_path)
    assert home.startswith(str(programs.parent))


@pytest.mark.slow
def test_the_installed_command_runs_a_scene_file(archives: Archives, tmp_path: Path) -> None:
    programs = environment_with(archives.wheel, archives, tmp_path)
    (tmp_path / "pillow.py").write_text((ROOT / "demos/inflatables/pillow.py").read_text())
    run = [programs / "gossamer", "run", "pillow.py", "cells=4", "until=2e-3"]
    assert "written to" in execute(*run, folder=tmp_path)
    assert (tmp_path / "out" / "pillow" / "ledger.csv").is_file()
    # Its environment is not activated, so that neither it nor its mpirun is on the PATH.
    assert "written to" in execute(*run, "--ranks", "2", "--output", "two", folder=tmp_path)
    assert '"ranks": 2' in (tmp_path / "two" / "run.json").read_text()


@pytest.mark.slow
def test_the_installed_command_has_doctor_and_tells_where_demos_are(
    archives: Archives, tmp_path: Path
) -> None:
    programs = environment_with(archives.wheel, archives, tmp_path)
    said = execute(programs / "gossamer", "doctor", folder=tmp_path)
    assert "self-check" in said and "FAILED" not in said and "MISSING" not in said
    for words in (["demo"], ["validate", "all"]):
        done = subprocess.run(
            [programs / "gossamer", *words],
            cwd=tmp_path,
            env={"PATH": "/usr/bin"},
            capture_output=True,
            text=True,
        )
        assert done.returncode == 2
        assert f"start gossamer {words[0]} in a clone" in done.stderr


@pytest.mark.slow
def test_the_source_distribution_passes_its_tests_with_the_wheel(
    archives: Archives, tmp_path: Path
) -> None:
    """The tests find the installed package, as a packager's do."""
    programs = environment_with(archives.wheel, archives, tmp_path)
    tree = unpacked(archives.source, tmp_path / "source")
    for name in ("gossamer_fx", "gossamer"):
        (tree / name).rename(tree / f"{name}.away")
    files = ("tests/unit/test_gas.py", "tests/unit/test_materials.py")
    pytest_words = [programs / "python3", "-m", "pytest", "-p", "no:cacheprovider", *files]
    assert "passed" in execute(*pytest_words, folder=tree)


def test_bare_pytest_finds_package_meshes_demos_and_helpers() -> None:
    """Without `python -m`, which would put the current folder on the path by itself."""
    files = (
        "tests/survival/test_other_runs.py",
        "tests/unit/test_study.py",
        "tests/unit/test_mesh.py",
    )
    # as the command pytest does it: the option -P leaves the current folder out
    words = [sys.executable, "-P", "-c", "import pytest; raise SystemExit(pytest.console_main())"]
    said = execute(*words, "--collect-only", "-p", "no:cacheprovider", *files, folder=ROOT)
    for name in files:
        assert f"{name}::" in said
