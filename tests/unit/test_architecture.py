"""The house: imports go down its layers, files stay small, public names exist and are explained."""

from __future__ import annotations

import ast
import inspect
import subprocess
import sys
from graphlib import TopologicalSorter
from operator import attrgetter
from pathlib import Path

import pytest

import gossamer_fx
from gossamer_fx.checks.lazy_names import public_names

PACKAGE = Path(gossamer_fx.__file__).parent

# From the ground up; a module imports from its own folder or from those below.
FLOORS = (
    "version",
    "checks",
    "forms",
    "drawing",
    "model",
    "mesh",
    "materials",
    "algebra",
    "terms",
    "sections",
    "bodies",
    "gas",
    "constraints",
    "connectors",
    "patterns",
    "fold",
    "contact",
    "loads",
    "control",
    "extend",
    "orbit",
    "presets",
    "assemblies",
    "system",
    "scene",
    "solvers",
    "steppers",
    "sensitivity",
    "analysis",
    "fields",
    "probes",
    "outputs",
    "reduction",
    "plot",
    "run",
    "sweep",
    "cli",
    "__main__",
)
# Rooms that are written against the promised interface for extensions and public names alone.
WRITTEN_AS_EXTENSIONS = ("orbit",)
HEAVY = {"gmsh", "matplotlib", "pyvista", "slepc4py", "h5py", "rich", "pandas"}
LEVEL = {name: level for level, name in enumerate(FLOORS)}
MODULES = sorted(p for p in PACKAGE.rglob("*.py") if p != PACKAGE / "__init__.py")


def house_of(module: str) -> str:
    """Name in FLOORS of a dotted module of the package."""
    return module.split(".")[1] if "." in module else "gossamer_fx"


def imports_of(path: Path) -> set[str]:
    """Modules of the package that a file imports, those for annotations and within functions
    included."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("gossamer_fx"):
            found.add(str(node.module))
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names if alias.name.startswith("gossamer_fx.")}
    return found


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_imports_go_down(path: Path) -> None:
    here = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
    assert here in LEVEL, f"give '{here}' its floor"
    for module in imports_of(path):
        assert LEVEL[house_of(module)] <= LEVEL[here], f"{here} imports {module} from above"


@pytest.mark.parametrize("room", WRITTEN_AS_EXTENSIONS)
def test_a_room_needs_no_more_than_extensions_do(room: str) -> None:
    """The proof that `gossamer_fx.extend` suffices: a whole room uses nothing else from inside."""
    allowed = {"gossamer_fx.extend", "gossamer_fx.checks.lazy_names"}
    for path in (PACKAGE / room).rglob("*.py"):
        for module in imports_of(path):
            own = module.startswith(f"gossamer_fx.{room}.")
            is_namespace = (PACKAGE / module.split(".")[1] / "__init__.pyi").exists()
            public = is_namespace and module.count(".") == 1
            assert own or public or module in allowed, f"{path.name} imports {module} from inside"


def test_no_files_import_each_other_in_a_circle() -> None:
    names = {".".join(p.relative_to(PACKAGE.parent).with_suffix("").parts): p for p in MODULES}
    TopologicalSorter(
        {name: imports_of(path) & set(names) for name, path in names.items()}
    ).prepare()


def test_the_top_of_the_house_is_small() -> None:
    assert len([p for p in PACKAGE.glob("*.py") if p.is_file()]) <= 6


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_heavy_libraries_are_imported_where_they_are_used(path: Path) -> None:
    """At the top of a file they would be loaded by scenes that do not need them."""
    top = [
        node
        for node in ast.parse(path.read_text()).body
        if isinstance(node, ast.Import | ast.ImportFrom)
    ]
    loaded = {
        name.split(".")[0]
        for node in top
        for name in (
            [node.module or ""]
            if isinstance(node, ast.ImportFrom)
            else [a.name for a in node.names]
        )
    }
    assert not loaded & HEAVY


# ---- public names --------------------------------------------------------------------------------


STUBS = sorted(PACKAGE.rglob("__init__.pyi"))


def test_public_names_exist_and_are_explained() -> None:
    names = public_names()
    assert len(names) > 140
    for name in names:
        assert inspect.getdoc(attrgetter(name)(gossamer_fx)), f"{name} has no docstring"


def test_core_names_are_few_and_also_in_their_namespaces() -> None:
    """A core name and the same name of a namespace are one object."""
    core_names = [name for name in public_names() if "." not in name]
    assert 35 <= len(core_names) <= 55
    shared = 0
    for namespace in set(gossamer_fx.__all__) - set(core_names):
        module = getattr(gossamer_fx, namespace)
        for name in set(core_names) & set(getattr(module, "__all__", ())):
            assert getattr(module, name) is getattr(gossamer_fx, name)
            shared += 1
    assert shared >= len(core_names) - 8


@pytest.mark.parametrize("stub", STUBS, ids=lambda p: str(p.parent.relative_to(PACKAGE.parent)))
def test_no_public_name_is_also_a_module(stub: Path) -> None:
    """The import of such a module would replace the class or function of the same name."""
    modules = {path.stem for path in stub.parent.glob("*.py")}
    for node in ast.parse(stub.read_text()).body:
        if isinstance(node, ast.ImportFrom) and node.module:
            assert not {alias.name for alias in node.names} & modules


def test_class_names_are_unique() -> None:
    homes: dict[str, list[str]] = {}
    for path in MODULES:
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                homes.setdefault(node.name, []).append(str(path.relative_to(PACKAGE)))
    twice = {name: paths for name, paths in homes.items() if len(paths) > 1}
    assert not twice


def test_an_unknown_name_is_answered_with_similar_names() -> None:
    with pytest.raises(AttributeError, match="did you mean Membrane"):
        _ = gossamer_fx.Membran
    with pytest.raises(AttributeError, match=r"did you mean gas\.Ring"):
        _ = gossamer_fx.Ring
    with pytest.raises(AttributeError, match="its names are: At, Beam"):
        _ = gossamer_fx.nothing_like_it


def test_tab_shows_core_names_and_namespaces() -> None:
    assert {"Scene", "Simulation", "gas", "sections"} <= set(dir(gossamer_fx))
    assert {"Chamber", "Orifice", "Ring"} <= set(dir(gossamer_fx.gas))


def test_the_import_of_the_package_is_cheap() -> None:
    """Neither dolfinx nor NumPy nor MPI is imported before a name is used."""
    code = (
        "import sys; import gossamer_fx; dir(gossamer_fx); gossamer_fx.gas; "
        "print({'dolfinx', 'mpi4py', 'numpy', 'ufl'} & set(sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=PACKAGE.parent
    )
    assert done.stdout == "set()\n", done.stdout + done.stderr
