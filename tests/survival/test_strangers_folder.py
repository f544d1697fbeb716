"""A folder of a stranger, in which one stands, runs no code and changes no number: PETSc's option
files, options of FFCx and dolfinx, matplotlibrc."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.hanging import HANG_TIMEOUT

ROOT = Path(__file__).parents[2]

SCENE = """
import gossamer_fx as gx
from gossamer_fx.meshes.sheet import sheet


def build(comm):
    law = gx.Miyazaki(1e9, 0.3, density=1000.0, thickness=1e-4)
    film = gx.Membrane(sheet(comm, 2, 2), law, name="film")
    return gx.Case(gx.Scene(film), gx.Midpoint(dt=1e-3), until=2e-3, fields={"film": ["stress1"]})
"""

SHOWN = """
import json, sys
import gossamer_fx as gx
from dolfinx.jit import get_options
from ffcx.options import get_options as form_options
import matplotlib
from petsc4py import PETSc

print(json.dumps({
    "epsilon": form_options()["epsilon"],
    "sum_factorization": form_options()["sum_factorization"],
    "cache": str(get_options()["cache_dir"]),
    "dpi": matplotlib.rcParams["figure.dpi"],
    "of the folder": PETSc.Options().hasName("of_the_folder"),
    "of the user": PETSc.Options().hasName("of_the_user"),
}))
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder whose files would be read, and a scene in it."""
    for name in (".petscrc", "petscrc"):
        (tmp_path / name).write_text("-of_the_folder\n-log_view :overwritten\n")
    (tmp_path / "overwritten").write_text("mine")
    form_options = {"epsilon": 0.5, "sum_factorization": True}
    (tmp_path / "ffcx_options.json").write_text(json.dumps(form_options))
    cache = {"cache_dir": str(tmp_path / "kernels")}
    (tmp_path / "dolfinx_jit_options.json").write_text(json.dumps(cache))
    (tmp_path / "matplotlibrc").write_text("figure.dpi: 3\n")
    (tmp_path / "scene.py").write_text(SCENE)
    return tmp_path


def program(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run Python in a folder."""
    environment = dict(os.environ) | {"PYTHONPATH": str(ROOT), "PETSC_OPTIONS": "-of_the_user"}
    environment["PETSC_OPTIONS_YAML"] = "of_the_folder: 1"
    return subprocess.run(
        [sys.executable, "-P", *words],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=HANG_TIMEOUT,
    )


def test_a_script_that_begins_with_the_package_reads_nothing_there(folder: Path) -> None:
    done = program(folder, "-c", SHOWN)
    assert done.returncode == 0, done.stderr
    shown = json.loads(done.stdout.splitlines()[0])
    assert shown["epsilon"] < 1e-10 and not shown["sum_factorization"]
    assert "kernels" not in Path(shown["cache"]).name
    assert shown["dpi"] > 50
    assert not shown["of the folder"]
    # What the user asks for is taken.
    assert shown["of the user"]


@pytest.mark.parametrize(
    "words",
    [
        ("run", "scene.py", "--output", "out"),
        ("doctor",),
        ("report", "out"),
        ("plot", "out", "--strip", "stress1"),
        ("export", "out"),
    ],
    ids=lambda words: words[0],
)
def test_commands_overwrite_nothing_there(folder: Path, words: tuple[str, ...]) -> None:
    if words[0] not in ("run", "doctor"):
        made = program(folder, "-m", "gossamer_fx", "run", "scene.py", "--output", "out")
        assert made.returncode == 0, made.stderr
    program(folder, "-m", "gossamer_fx", *words)
    assert (folder / "overwritten").read_text() == "mine"
    assert not (folder / "kernels").exists()


def test_a_folder_that_is_gone_is_no_obstacle(tmp_path: Path) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    code = f"import os; os.rmdir({str(gone)!r})\n" + SHOWN
    done = program(gone, "-c", code)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("link", "words"),
    [
        ("report.html", ("report", "out")),
        ("curves.png", ("plot", "out", "--curves")),
        ("vtu", ("export", "out")),
    ],
    ids=["report", "plot", "export"],
)
def test_nothing_is_written_through_a_link_of_a_run(
    folder: Path, link: str, words: tuple[str, ...]
) -> None:
    made = program(folder, "-m", "gossamer_fx", "run", "scene.py", "--output", "out")
    assert made.returncode == 0, made.stderr
    elsewhere = folder / "elsewhere"
    if link == "vtu":
        elsewhere.mkdir()
    else:
        elsewhere.write_text("mine")
    (folder / "out" / link).symlink_to(elsewhere)
    said = program(folder, "-m", "gossamer_fx", *words)
    assert said.returncode == 2 and "is a link; remove it" in said.stderr, said
    if link == "vtu":
        assert not list(elsewhere.iterdir())
    else:
        assert elsewhere.read_text() == "mine"
