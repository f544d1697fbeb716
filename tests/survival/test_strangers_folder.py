"""A folder of a stranger, in which one stands, runs no code and changes no number: PETSc's option
files, options of FFCx and dolfinx, matplotlibrc, and whatever else a library might open there.

Files that are opened are seen by inotify, so also those that a library in C opens."""

from __future__ import annotations

import ctypes
import json
import os
import struct
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


# ---- every file that is opened -------------------------------------------------------------------

# From <sys/inotify.h>: events, and the head of one, after which its name follows.
IN_ACCESS = 0x1
IN_OPEN = 0x20
IN_ISDIR = 0x40000000
EVENT = struct.Struct("iIII")

# Files that libraries, tools or Python look for in some folder.
STRANGE_FILES = (
    *(".petscrc", "petscrc", "petsc.cfg", "slepc.cfg", "ffcx_options.json"),
    *("dolfinx_jit_options.json", "dolfinx_parameters.json", "matplotlibrc", ".matplotlibrc"),
    *("default.mplstyle", ".env", "sitecustomize.py", "usercustomize.py", "pyvenv.cfg"),
    *("numpy.py", "gmsh.py", "json.py", "pickle.py", "mpi4py.py", "gossamer_fx.py", "ctypes.py"),
    *(".gmshrc", ".gmsh-options", "untitled.geo", "fonts.conf", ".fonts.conf", "ucx.conf"),
    *("mca-params.conf", "openmpi-mca-params.conf", "pmix-mca-params.conf", "hostfile"),
    *("pyproject.toml", "setup.cfg", "setup.py", "distutils.cfg", ".pydistutils.cfg", "specs"),
    *(".numbarc", ".gdbinit", ".inputrc", "pytest.ini", "conftest.py", "site.cfg", "messages.mo"),
)
STRANGE_FOLDERS = ("locale", "share", "lib", "bin", ".config", ".cache", ".openmpi", "numpy")

GMSH_SCENE = """
import gossamer_fx as gx


def rectangle(model):
    model.occ.addRectangle(0, 0, 0, 2, 1)
    model.occ.synchronize()
    model.mesh.setSize(model.getEntities(0), 1.0)
    model.mesh.generate(2)


def build(comm, modulus=1e9):
    law = gx.Miyazaki(modulus, 0.3, density=1000.0, thickness=1e-4)
    film = gx.Membrane(gx.gmsh_mesh(rectangle, comm), law, name="film")
    return gx.Case(gx.Scene(film), gx.Midpoint(dt=1e-3), until=2e-3, fields={"film": ["stress1"]})
"""


class Opened:
    """Names in a folder that any process opens or reads while this stands."""

    def __init__(self, folder: Path) -> None:
        library = ctypes.CDLL(None, use_errno=True)
        self._events = library.inotify_init1(os.O_NONBLOCK)
        watched = library.inotify_add_watch(self._events, os.fsencode(folder), IN_OPEN | IN_ACCESS)
        assert watched >= 0, os.strerror(ctypes.get_errno())

    def names(self) -> set[str]:
        """Of files and folders; the folder itself has an empty name."""
        found = set()
        try:
            events = os.read(self._events, 1 << 20)
        except BlockingIOError:
            return found
        begin = 0
        while begin < len(events):
            _, _, _, length = EVENT.unpack_from(events, begin)
            begin += EVENT.size
            found.add(events[begin : begin + length].rstrip(b"\0").decode())
            begin += length
        return found - {""}

    def close(self) -> None:
        os.close(self._events)


@pytest.fixture
def strange(tmp_path: Path) -> Path:
    """A folder with a run, a scene, and files that a library might take for its own."""
    (tmp_path / "scene.py").write_text(GMSH_SCENE)
    (tmp_path / "case.toml").write_text("name = 1\n")
    made = program(tmp_path, "-m", "gossamer_fx", "run", "scene.py", "--output", "out")
    assert made.returncode == 0, made.stderr
    for name in STRANGE_FILES:
        (tmp_path / name).write_text("of a stranger\n")
    for name in STRANGE_FOLDERS:
        (tmp_path / name).mkdir()
    return tmp_path


@pytest.mark.skipif(sys.platform != "linux", reason="inotify belongs to Linux")
@pytest.mark.parametrize(
    ("words", "code", "ours"),
    [
        (("--help",), 0, set()),
        (("run", "scene.py", "-o", "new", "-n", "2"), 0, {"scene.py", "new"}),
        (("run", "scene.py", "-o", "out", "--restart"), 0, {"scene.py", "out"}),
        (("report", "out"), 0, {"out"}),
        (("plot", "out", "--field", "stress1", "--time", "0.002"), 0, {"out"}),
        (("export", "out"), 0, {"out"}),
        # Its check of mpirun depends on the machine.
        (("doctor",), None, set()),
        (("validate", "case.toml"), 2, {"case.toml"}),
        (
            ("sweep", "scene.py", "--over", "modulus=1e9,2e9", "-o", "swept"),
            0,
            {"scene.py", "swept"},
        ),
        (("watch", "nothing"), 2, set()),
        (("study", "nothing"), 2, set()),
    ],
)
def test_commands_open_no_other_file_there(
    strange: Path, words: tuple[str, ...], code: int | None, ours: set[str]
) -> None:
    opened = Opened(strange)
    module = ["-m", "gossamer_fx", *words]
    if words[0] == "study":
        module = ["-m", "demos.studies", *words[1:]]
    done = program(strange, *module)
    names = opened.names()
    opened.close()
    assert code in (None, done.returncode), done.stderr
    assert names <= ours, names - ours
    # What has to be opened was seen; a folder is opened only to list it.
    assert {name for name in ours if "." in name} <= names


@pytest.mark.skipif(sys.platform != "linux", reason="inotify belongs to Linux")
def test_a_script_opens_no_other_file_there(strange: Path) -> None:
    """Where the package is the first import; libraries of the package are not taken from there."""
    opened = Opened(strange)
    code = (
        "import gossamer_fx as gx, gmsh, dolfinx, matplotlib.pyplot\nfrom petsc4py import PETSc\n"
    )
    done = program(strange, "-c", code + "gmsh.initialize()")
    names = opened.names()
    opened.close()
    assert done.returncode == 0, done.stderr
    assert not names


def test_the_files_are_seen(tmp_path: Path) -> None:
    """The test of the tests: PETSc alone does open its file."""
    (tmp_path / ".petscrc").write_text("-of_the_folder\n")
    opened = Opened(tmp_path)
    done = program(tmp_path, "-c", "from petsc4py import PETSc")
    assert done.returncode == 0, done.stderr
    assert ".petscrc" in opened.names()
    opened.close()


def test_no_library_of_the_folder_is_loaded_and_nothing_is_overwritten(folder: Path) -> None:
    """UCX would write the file that it is told, petsc4py load the library of a folder."""
    mine = folder / "overwritten"
    (folder / "ucx.conf").write_text(f"UCX_LOG_FILE={mine}\nUCX_LOG_LEVEL=debug\n")
    (folder / "petsc.cfg").write_text(f"PETSC_ARCH={folder / 'build'}\n")
    (folder / "build").mkdir()
    done = program(folder, "-m", "gossamer_fx", "run", "scene.py", "-o", "out")
    assert done.returncode == 0, done.stderr
    assert mine.read_text() == "mine"


def test_a_demo_and_a_script_that_begin_with_mpi4py_read_nothing_there(folder: Path) -> None:
    """UCX would write the file that it is told when mpi4py loads MPI."""
    mine = folder / "overwritten"
    (folder / "ucx.conf").write_text(f"UCX_LOG_FILE={mine}\nUCX_LOG_LEVEL=debug\n")
    (folder / "helper.py").write_text("WORDS = 'of the folder'\n")
    script = "import sys\nfrom mpi4py import MPI\nimport helper\n"
    script += "words = [__name__, *sys.argv[1:], str(MPI.COMM_WORLD.size), helper.WORDS]\n"
    # Written at once, so that the lines of two ranks cannot mix.
    script += "sys.stdout.write(' '.join(words) + '\\n')\n"
    script += "sys.stdout.flush()\n"
    (folder / "script.py").write_text(script)
    launched = program(folder, "-m", "gossamer_fx.app.cli.launch", "2", "script.py", "a")
    assert launched.stdout == "__main__ a 2 of the folder\n" * 2, launched
    demos = folder / "clone" / "demos" / "subject"
    demos.mkdir(parents=True)
    (demos / "folded_tube.py").write_text(script + "sys.exit(3)\n")
    (demos / "helper.py").write_text("WORDS = 'of the demo'\n")
    code = (
        "from gossamer_fx.app.cli import demo\n"
        f"demo.find_demos = lambda: demo.Path({str(demos.parent)!r})\n"
        "demo.main(['folded_tube', 'a'])\n"
    )
    done = program(folder, "-c", code)
    assert (done.stdout, done.returncode) == ("__main__ a 1 of the demo\n", 3), done
    assert mine.read_text() == "mine"


def test_modules_of_the_folder_are_not_taken_without_safe_paths(folder: Path) -> None:
    """`python3 -m gossamer_fx` puts the current folder first."""
    for name in ("ctypes", "numpy", "argparse", "csv"):
        (folder / f"{name}.py").write_text("open('overwritten', 'w').close()\n")
    done = subprocess.run(
        [sys.executable, "-m", "gossamer_fx", "--version"],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=HANG_TIMEOUT,
    )
    assert done.returncode == 0, done.stderr
    assert (folder / "overwritten").read_text() == "mine"
