"""The house: imports go down its layers, files stay small, public names exist and are explained."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import sys
from functools import cache
from graphlib import TopologicalSorter
from operator import attrgetter
from pathlib import Path

import pytest

import gossamer_fx
from gossamer_fx.core.checks.lazy_names import names_of_stub, public_names
from tests.survival.on_ranks import complete

PACKAGE = Path(gossamer_fx.__file__).parent
ROOT = PACKAGE.parent

# From the ground up; a module imports from its own house or from those below.
HOUSES = ("core", "mechanics", "build", "solve", "records", "analysis", "app")
FLOOR = {house: floor for floor, house in enumerate(HOUSES)}
# Modules outside the houses; names that come through `extend` count as imports of their homes.
BESIDE = {"version", "extend", "__main__"}
# Rooms of mechanics from the ground up.  Above them are the families, which do not know each other.
ROOMS_OF_MECHANICS = ("materials", "terms", "bodies")
FAMILIES = ("connectors", "constraints", "loads", "contact", "gas", "orbit", "control")
# Rooms that are written against the promised interface for extensions and public names alone.
WRITTEN_AS_EXTENSIONS = ("mechanics/orbit",)
# Demos that reach into the houses: benchmarks and studies that measure what lies inside, and those
# for whose need there is no public name yet.
DEMOS_THAT_REACH_IN = {
    "benchmarks/contact_cost.py",
    "benchmarks/gradient_cost.py",
    "benchmarks/newton_times.py",
    "benchmarks/own_program.py",
    "benchmarks/scaling_model.py",
    "common/flight_picture.py",
    "design/braid_identification.py",
    "studies/gradient_horizon.py",
    "studies/reduced.py",
    "validation/models/braided_tube.py",
    "validation/models/everting_film.py",
}
HEAVY = {"gmsh", "matplotlib", "pyvista", "slepc4py", "h5py", "pandas"}
MODULES = sorted(p for p in PACKAGE.rglob("*.py") if p != PACKAGE / "__init__.py")
STUBS = sorted(PACKAGE.rglob("__init__.pyi"))
# Public names of `gossamer_fx` and `gossamer_fx.extend` and the modules from which they come.
HOMES = {
    "gossamer_fx": names_of_stub("gossamer_fx", PACKAGE / "__init__.pyi"),
    "gossamer_fx.extend": names_of_stub("gossamer_fx", PACKAGE / "extend.pyi"),
}


# To be removed: outputs of equilibria are public in `gx.outputs`.
KNOWN: set[tuple[str, str]] = set()


@cache
def imports_of(path: Path) -> set[str]:
    """Modules of the package that a file imports, those for annotations and within functions
    included, and those from which lazy names come."""
    if path.suffix == ".pyi":
        package = ".".join(path.parent.relative_to(ROOT).parts)
        return set(names_of_stub(package, path).values()) - {package}
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("gossamer_fx"):
            module = str(node.module)
            homes = HOMES.get(module, {})
            found |= {homes.get(alias.name, module) for alias in node.names}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names if alias.name.startswith("gossamer_fx.")}
    return found


def place_of(path: Path) -> tuple[str, ...]:
    """House, room and modules of a file."""
    return path.relative_to(PACKAGE).with_suffix("").parts


SOURCES = [p for p in (*MODULES, *STUBS) if len(place_of(p)) > 1]


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_imports_go_down(path: Path) -> None:
    here = place_of(path)[0]
    assert here in FLOOR, f"'{here}' is none of the houses {HOUSES}"
    for module in imports_of(path):
        house = module.split(".")[1]
        if house not in BESIDE and (here, module) not in KNOWN:
            assert FLOOR[house] <= FLOOR[here], f"{here} imports {module} from above"


MECHANICS = [p for p in SOURCES if place_of(p)[0] == "mechanics" and len(place_of(p)) > 2]


@pytest.mark.parametrize("path", MECHANICS, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_families_of_mechanics_do_not_know_each_other(path: Path) -> None:
    room = place_of(path)[1]
    below = ROOMS_OF_MECHANICS
    if room in below:
        below = below[: below.index(room)]
    else:
        assert room in FAMILIES
    for module in imports_of(path):
        _, house, *rest = module.split(".")
        if house == "mechanics" and rest[0] != room:
            assert rest[0] in below, f"{room} imports {module}"


def houses_on_the_map() -> list[tuple[str, set[str]]]:
    """Houses and their rooms as the picture in CONTRIBUTING shows them."""
    text = (ROOT / "CONTRIBUTING.md").read_text()
    picture = re.search(r"^```text\n(app .*?)^```", text, re.MULTILINE | re.DOTALL)
    assert picture is not None
    rows = [re.split(r"  +", line) for line in picture.group(1).splitlines()]
    return [(house, set(rooms.split(" · "))) for house, rooms in rows]


def test_the_map_is_that_of_the_tree() -> None:
    shown = houses_on_the_map()
    assert [house for house, _ in shown] == list(reversed(HOUSES))
    assert {p.name for p in PACKAGE.iterdir() if (p / "__init__.py").exists()} == set(HOUSES)
    for house, rooms in shown:
        files = [p for p in (PACKAGE / house).iterdir() if not p.name.startswith("__")]
        assert rooms == {p.stem for p in files}, f"the rooms of {house}"


def test_paths_that_contributing_names_exist() -> None:
    """A path starts at the clone, at the package, or at a folder named before in its paragraph."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    prose = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    for paragraph in re.split(r"\n(?=\n|- |\|)", prose):
        folders = [ROOT, PACKAGE]
        for name in re.findall(r"`([\w./-]+)`", paragraph):
            if "/" in name or Path(name).suffix in (".py", ".pyi", ".c", ".md", ".toml"):
                found = [folder / name for folder in folders if (folder / name).exists()]
                assert found, f"CONTRIBUTING names `{name}`, which does not exist"
                folders.append(found[0] if found[0].is_dir() else found[0].parent)


@pytest.mark.parametrize("room", WRITTEN_AS_EXTENSIONS)
def test_a_room_needs_no_more_than_extensions_do(room: str) -> None:
    """The proof that `gossamer_fx.extend` suffices: a whole room uses nothing else from inside."""
    own = ".".join(("gossamer_fx", *room.split("/"), ""))
    namespaces = {".".join(p.parent.relative_to(ROOT).parts) for p in STUBS}
    promised = {*HOMES["gossamer_fx"].values(), *HOMES["gossamer_fx.extend"].values(), *namespaces}
    promised.add("gossamer_fx.core.checks.lazy_names")
    for path in (PACKAGE / room).rglob("*.py"):
        for module in imports_of(path):
            assert module.startswith(own) or module in promised, f"{path.name} imports {module}"


def test_no_files_import_each_other_in_a_circle() -> None:
    names = {".".join(p.relative_to(PACKAGE.parent).with_suffix("").parts): p for p in MODULES}
    TopologicalSorter(
        {name: imports_of(path) & set(names) for name, path in names.items()}
    ).prepare()


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


def test_public_names_exist_and_are_explained() -> None:
    names = public_names()
    assert len(names) > 140
    for name in names:
        assert inspect.getdoc(attrgetter(name)(gossamer_fx)), f"{name} has no docstring"


def test_core_names_are_few_and_in_no_namespace() -> None:
    names = public_names()
    core_names = [name for name in names if "." not in name]
    assert 35 <= len(core_names) <= 55
    assert not set(core_names) & {name.split(".")[1] for name in names if "." in name}
    with pytest.raises(AttributeError, match=r"did you mean gossamer_fx\.Chamber"):
        _ = gossamer_fx.gas.Chamber


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
    # Programs that look at any object ask for such names; nobody reads proposals for them.
    with pytest.raises(AttributeError, match=r"^gossamer_fx has no '__test__'\.$"):
        _ = gossamer_fx.__test__


def test_namespaces_do_not_depend_on_houses() -> None:
    """Users import `gossamer_fx.presets.films`, in whichever house its room is."""
    films = importlib.import_module("gossamer_fx.presets.films")
    assert films is importlib.import_module("gossamer_fx.build.presets.films")
    assert films is gossamer_fx.presets.films
    assert films.__spec__ is not None and films.__spec__.name == films.__name__
    assert importlib.import_module("gossamer_fx.gas") is gossamer_fx.gas
    with pytest.raises(ModuleNotFoundError, match="woods"):
        importlib.import_module("gossamer_fx.presets.woods")


def test_tab_shows_core_names_and_namespaces() -> None:
    assert {"Scene", "Simulation", "gas", "sections"} <= set(dir(gossamer_fx))
    assert {"Ambient", "Piston", "Ring"} <= set(dir(gossamer_fx.gas))


def test_the_import_of_the_package_is_cheap() -> None:
    """Neither dolfinx nor NumPy nor MPI is imported before a name is used."""
    code = (
        "import sys; import gossamer_fx; dir(gossamer_fx); gossamer_fx.gas; "
        "print({'dolfinx', 'mpi4py', 'numpy', 'ufl'} & set(sys.modules))"
    )
    done = complete([sys.executable, "-c", code])
    assert done.stdout == "set()\n", done.stdout + done.stderr


def test_demos_import_public_names() -> None:
    """But for those listed, which become fewer."""
    inside = re.compile(rf"gossamer_fx\.({'|'.join(HOUSES)})(\.|$)")
    demos = ROOT / "demos"
    reaching = set()
    for path in demos.rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        modules = [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
        if any(map(inside.match, modules)):
            reaching.add(str(path.relative_to(demos)))
    assert reaching == DEMOS_THAT_REACH_IN
