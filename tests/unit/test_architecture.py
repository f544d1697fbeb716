"""The house: imports go down its layers, files stay small, public names exist and are explained."""

from __future__ import annotations

import ast
import inspect
from pathlib import Path

import pytest

import gossamer_fx

PACKAGE = Path(gossamer_fx.__file__).parent

# From the ground up; a module imports from its own folder or from those below.
FLOORS = (
    "version",
    "checks",
    "forms",
    "model",
    "mesh",
    "materials",
    "algebra",
    "terms",
    "bodies",
    "gas",
    "interactions",
    "loads",
    "control",
    "system",
    "scene",
    "solvers",
    "steppers",
    "analyses",
    "outputs",
    "plotting",
    "run",
    "cli",
    "__main__",
)
HEAVY = {"gmsh", "matplotlib", "pyvista", "slepc4py", "h5py", "rich", "pandas"}
LEVEL = {name: level for level, name in enumerate(FLOORS)}
MODULES = sorted(p for p in PACKAGE.rglob("*.py") if p != PACKAGE / "__init__.py")


def house_of(module: str) -> str:
    """Name in FLOORS of a dotted module of the package."""
    return module.split(".")[1] if "." in module else "gossamer_fx"


def imports_at_run_time(path: Path) -> set[str]:
    """Modules of the package that a file imports, those for type checking left out."""
    found: set[str] = set()
    tree = ast.parse(path.read_text())
    skipped = {
        id(node)
        for block in ast.walk(tree)
        if isinstance(block, ast.If) and "TYPE_CHECKING" in ast.dump(block.test)
        for node in ast.walk(block)
    }
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.ImportFrom)
            and (node.module or "").startswith("gossamer_fx")
            and id(node) not in skipped
        ):
            found.add(str(node.module))
    return found


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_imports_go_down(path: Path) -> None:
    here = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
    assert here in LEVEL, f"give '{here}' its floor"
    for module in imports_at_run_time(path):
        assert LEVEL[house_of(module)] <= LEVEL[here], f"{here} imports {module} from above"


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_heavy_libraries_are_imported_where_they_are_used(path: Path) -> None:
    """At the top of a file they would be loaded by scenes that do not need them."""
    top = [node for node in ast.parse(path.read_text()).body if isinstance(node, ast.Import | ast.ImportFrom)]
    loaded = {
        name.split(".")[0]
        for node in top
        for name in ([node.module or ""] if isinstance(node, ast.ImportFrom) else [a.name for a in node.names])
    }
    assert not loaded & HEAVY


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_a_file_is_one_concept(path: Path) -> None:
    assert len(path.read_text().splitlines()) <= 350


def test_public_names_exist_and_are_explained() -> None:
    for name in gossamer_fx.__all__:
        thing = getattr(gossamer_fx, name)
        if inspect.isclass(thing) or inspect.isfunction(thing):
            assert inspect.getdoc(thing), f"{name} has no docstring"


def test_an_unknown_name_is_told_with_the_known_ones() -> None:
    with pytest.raises(AttributeError, match="Membrane"):
        _ = gossamer_fx.Membran
