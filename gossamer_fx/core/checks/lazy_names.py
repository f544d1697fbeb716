"""Public names of a package, read from its stub `__init__.pyi` and imported at their first use
(SPEC 1 of Scientific Python).

A scene therefore imports only the modules of what it contains, and each public name is written
once.  Rooms that the top stub lists, e.g. `gas` of `gossamer_fx.mechanics`, are namespaces: they
can also be imported without their house, as `gossamer_fx.gas`.
"""

from __future__ import annotations

import ast
import difflib
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec, resolve_name
from pathlib import Path
from types import ModuleType
from typing import Any

from gossamer_fx.version import VERSION

# Libraries that pip does not install with this package.
_FROM_THE_SYSTEM = {"dolfinx", "basix", "ufl", "petsc4py", "mpi4py", "gmsh"}
# Names that an error about an unknown name proposes.
_MAX_PROPOSALS = 5


def names_of_stub(package: str, stub: Path) -> dict[str, str]:
    """Public names of a stub with lines `from .module import Name as Name`, and the module from
    which each is imported, relative to a package."""
    homes: dict[str, str] = {}
    for node in ast.parse(stub.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom):
            module = resolve_name("." * node.level + (node.module or ""), package)
            homes |= {alias.name: module for alias in node.names}
    return homes


def lazy_names(
    package: str, init_file: str, module: str = ""
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Make `__getattr__`, `__dir__` and `__all__` of a package from the stub `__init__.pyi` next to
    its `__init__.py`.

    `module` is the module that has the names, if that is not the package itself.  A name that is
    not in the stub raises `AttributeError`, which proposes similar names; a missing library of the
    system raises `ImportError`.
    """
    module = module or package
    homes = names_of_stub(package, Path(init_file).with_suffix(".pyi"))
    names = sorted(homes)

    def __getattr__(name: str) -> Any:
        """Load a public name of the package at its first use."""
        if name not in homes:
            raise AttributeError(_unknown(module, name, names))
        try:
            found = _load(homes[name], name)
        except ModuleNotFoundError as error:
            library = (error.name or "").split(".")[0]
            if library not in _FROM_THE_SYSTEM:
                raise
            raise ImportError(
                f"gossamer_fx {VERSION} needs {library}, which this Python does not have; "
                "use a Python with dolfinx, petsc4py, mpi4py and gmsh, "
                "or pip install 'gossamer_fx[light]'."
            ) from error
        # The next use finds the attribute without this function.
        setattr(sys.modules[module], name, found)
        return found

    def __dir__() -> list[str]:
        """Public names of the package, for completion."""
        return names

    return __getattr__, __dir__, names


def _load(home: str, name: str) -> Any:
    """Import what a stub names: a class or function of the module `home`, or a module below it."""
    module = import_module(home)
    # Not by getattr, which would call the lazy function that called this one.
    if name in vars(module):
        return vars(module)[name]
    return import_module(f"{home}.{name}")


class NamespaceFinder(MetaPathFinder):
    """Imports `gossamer_fx.gas` and what lies below it as `gossamer_fx.mechanics.gas`, the same
    module: public namespaces do not change where rooms move from house to house."""

    def __init__(self, package: str, init_file: str) -> None:
        """Read the houses of the namespaces from the stub of the package."""
        homes = names_of_stub(package, Path(init_file).with_suffix(".pyi"))
        # A room is a module directly below a house; classes have names with capitals.
        self._houses = {
            f"{package}.{name}": f"{home}.{name}"
            for name, home in homes.items()
            if home.count(".") == 1 and name.islower()
        }

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Spec of the module of a namespace; None for all other modules."""
        package, _, rest = fullname.partition(".")
        room, _, below = rest.partition(".")
        home = self._houses.get(f"{package}.{room}")
        if home is None:
            return None
        home = f"{home}.{below}" if below else home
        spec = find_spec(home)
        if spec is None:
            return None
        is_package = spec.submodule_search_locations is not None
        return ModuleSpec(fullname, _AliasLoader(home), is_package=is_package)


class _AliasLoader(Loader):
    """Loads a module under a second name: the same object, not a copy of it."""

    def __init__(self, home: str) -> None:
        """Take the name under which the module is imported."""
        self._home = home

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """Import the module; its own spec is kept for `exec_module`."""
        module = import_module(self._home)
        self._spec = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Give the module its own spec again, in place of that of its second name."""
        module.__spec__ = self._spec


def public_names() -> list[str]:
    """Names of all public classes and functions as they follow `gx.`: core names alone, e.g.
    "Chamber", the others with their namespace, e.g. "gas.Ring"."""
    core_names = import_module("gossamer_fx").__all__
    namespaces = _namespaces("gossamer_fx", core_names)
    found = [name for name in core_names if name not in namespaces]
    for namespace, names in namespaces.items():
        for name in names:
            if not _is_module(f"gossamer_fx.{namespace}", name):
                found.append(f"{namespace}.{name}")
    return found


def _unknown(package: str, name: str, names: list[str]) -> str:
    """Message about an unknown name, with similar names of the package and of its namespaces, and
    the core name that is meant."""
    message = f"{package} has no '{name}'"
    # Programs that look at all objects, as pytest does, ask each module for names of protocols:
    # nobody reads what is near to them, and it takes 5 ms to find.
    if name.startswith("_"):
        return f"{message}."
    proposals = difflib.get_close_matches(name, names, n=_MAX_PROPOSALS, cutoff=0.75)
    for namespace, known in _namespaces(package, names).items():
        if name in known:
            proposals.insert(0, f"{namespace}.{name}")
    if name in import_module("gossamer_fx").__all__:
        proposals.insert(0, f"gossamer_fx.{name}")
    if proposals:
        return f"{message}; did you mean {' or '.join(proposals)}?"
    return f"{message}; its names are: {', '.join(names)}."


def _namespaces(package: str, names: list[str]) -> dict[str, list[str]]:
    """Public names of each namespace among the names of a package."""
    modules = [name for name in names if _is_module(package, name)]
    return {name: getattr(import_module(f"{package}.{name}"), "__all__", []) for name in modules}


def _is_module(package: str, name: str) -> bool:
    """Whether a name of a package is one of its modules rather than a class or function."""
    is_package = "__path__" in vars(import_module(package))
    return is_package and find_spec(f"{package}.{name}") is not None
