"""The house: imports go down its layers, files stay small, public names exist and are explained."""

from __future__ import annotations

import ast
import inspect
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import gossamer_fx

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
    "fold",
    "contact",
    "loads",
    "control",
    "orbit",
    "presets",
    "assemblies",
    "system",
    "scene",
    "solvers",
    "steppers",
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
HEAVY = {"gmsh", "matplotlib", "pyvista", "slepc4py", "h5py", "rich", "pandas"}
LEVEL = {name: level for level, name in enumerate(FLOORS)}
MODULES = sorted(p for p in PACKAGE.rglob("*.py") if p != PACKAGE / "__init__.py")


def house_of(module: str) -> str:
    """Name in FLOORS of a dotted module of the package."""
    return module.split(".")[1] if "." in module else "gossamer_fx"


def imports_of(path: Path) -> set[str]:
    """Modules of the package that a file imports, those for annotations and within functions included."""
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


def test_no_files_import_each_other_in_a_circle() -> None:
    names = {".".join(p.relative_to(PACKAGE.parent).with_suffix("").parts): p for p in MODULES}
    TopologicalSorter(
        {name: imports_of(path) & set(names) for name, path in names.items()}
    ).prepare()


def test_the_top_of_the_house_is_small() -> None:
    assert len([p for p in PACKAGE.iterdir() if p.is_file()]) <= 6


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


def test_public_names_exist_and_are_explained() -> None:
    for name in gossamer_fx.__all__:
        thing = getattr(gossamer_fx, name)
        if inspect.isclass(thing) or inspect.isfunction(thing):
            assert inspect.getdoc(thing), f"{name} has no docstring"


def test_an_unknown_name_is_told_with_the_known_ones() -> None:
    with pytest.raises(AttributeError, match="Membrane"):
        _ = gossamer_fx.Membran
