"""No file of a stranger's folder is executed because one stands in it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.core.forms import compilation
from gossamer_fx.meshes.sheet import sheet
from tests.small_scenes import run_until

ROOT = Path(gx.__file__).parent.parent
LIBRARIES = (
    "numpy",
    "mpi4py",
    "adios2",
    "dolfinx",
    "petsc4py",
    "ufl",
    "matplotlib",
    "gmsh",
    "scipy",
)


@pytest.fixture
def trap(tmp_path: Path) -> Path:
    """A folder whose files leave a mark when they are executed."""
    folder = tmp_path / "stranger"
    folder.mkdir()
    for library in LIBRARIES:
        mark = folder / f"{library} was executed"
        code = f"open({str(mark)!r}, 'w')\nraise SystemExit(3)\n"
        (folder / f"{library}.py").write_text(code)
    return folder


def marks(folder: Path) -> list[str]:
    return [path.name for path in folder.glob("* was executed")]


def recorded(folder: Path) -> None:
    """A short run in a folder."""
    film = gx.Membrane(
        sheet(MPI.COMM_SELF, 2, 2), gx.Miyazaki(1e9, 0.3, density=1400.0, thickness=1e-5)
    )
    run_until(0.2, film, dt=0.1, outputs=[gx.Recording(folder)])


@pytest.mark.parametrize(
    "words", [["report", "run"], ["plot", "run"], ["run", "scene.py", "--ranks", "2"]]
)
def test_a_command_executes_nothing_of_the_current_folder(trap: Path, words: list[str]) -> None:
    recorded(trap / "run")
    scenes = trap.parent / "own"
    scenes.mkdir()
    (scenes / "scene.py").write_text(
        "import gossamer_fx as gx\n"
        "def build(comm):\n"
        "    mass = gx.PointMass(1.0, velocity=(1.0, 0.0, 0.0), comm=comm)\n"
        "    return gx.Case(gx.Scene(mass), gx.Midpoint(dt=0.1), until=0.2)\n"
    )
    words = [str(scenes / word) if word == "scene.py" else word for word in words]
    for safe in ([], ["-P"]):
        done = subprocess.run(
            [sys.executable, *safe, "-m", "gossamer_fx", *words],
            cwd=trap,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
        )
        assert marks(trap) == [], done.stderr
        assert done.returncode == 0, done.stderr
        words = [*words, "--overwrite"] if words[0] == "run" else words


def test_reading_a_mesh_executes_no_file_beside_it(trap: Path, monkeypatch) -> None:
    mesh = sheet(MPI.COMM_SELF, 2, 2)
    import gmsh

    gmsh.initialize()
    gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
    gmsh.model.occ.synchronize()
    gmsh.model.addPhysicalGroup(2, [1], name="film")
    gmsh.model.mesh.generate(2)
    gmsh.write(str(trap / "mesh.msh"))
    gmsh.finalize()
    monkeypatch.chdir(trap)
    assert gx.read_mesh("mesh.msh", MPI.COMM_SELF).domain.topology.dim == mesh.domain.topology.dim
    assert marks(trap) == []


@pytest.fixture
def kernel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A kernel in the folder of kernels, which only its owner may enter."""
    folder = tmp_path / "kernels"
    folder.mkdir(mode=0o700)
    monkeypatch.setattr(compilation, "kernel_options", lambda: {"cache_dir": str(folder)})
    found = folder / "libffcx_forms_1.so"
    found.write_bytes(b"")
    return found


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files to another user")
@pytest.mark.parametrize("what", ["folder", "file"])
def test_kernels_of_another_user_are_refused(kernel: Path, what: str) -> None:
    """Two users of one cache: the second one is refused in a sentence."""
    nobody = 65534
    os.chown(kernel.parent if what == "folder" else kernel, nobody, nobody)
    with pytest.raises(gx.InputError, match="belongs to another user"):
        compilation.private_cache()
    assert kernel.exists()


@pytest.mark.parametrize("what", ["folder", "file"])
def test_kernels_that_others_may_write_are_refused(kernel: Path, what: str) -> None:
    kernel.parent.chmod(0o777 if what == "folder" else 0o755)
    kernel.chmod(0o777)
    with pytest.raises(gx.InputError, match="may be written by others"):
        compilation.private_cache()
    # A folder that others cannot enter is safe, whatever the mode of its files.
    kernel.parent.chmod(0o700)
    assert compilation.private_cache() == kernel.parent


def test_a_file_that_another_process_removes_meanwhile_is_no_matter(
    kernel: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Compilers of other processes make temporary files in the folder of kernels."""
    vanished = kernel.with_name("temporary.o")
    monkeypatch.setattr(Path, "iterdir", lambda folder: iter([vanished, kernel]))
    assert compilation.private_cache() == kernel.parent
