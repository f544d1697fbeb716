"""Public names of a package, read from its stub `__init__.pyi` and imported at their first use
(SPEC 1).

A scene therefore imports only the modules of what it contains, and each public name is written
once.
"""

from __future__ import annotations

import difflib
import sys
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import lazy_loader

from gossamer_fx.version import VERSION

# Libraries that pip does not install with this package.
_FROM_THE_SYSTEM = {"dolfinx", "basix", "ufl", "petsc4py", "mpi4py", "gmsh"}
# Names that an error about an unknown name proposes.
_MAX_PROPOSALS = 5


def lazy_names(
    package: str, init_file: str, module: str = ""
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Make `__getattr__`, `__dir__` and `__all__` of a package from its stub.

    Args:
        package: name of the package, `__name__` in its `__init__.py`.
        init_file: path of its `__init__.py`; the stub `__init__.pyi` lies in the same folder.
        module: name of the module that has the names, if that is not the package itself.

    Returns:
        the functions `__getattr__` and `__dir__`, and the list `__all__`.

    Raises, when a name is used:
        AttributeError: a name that is not in the stub; similar names are proposed.
        ImportError: dolfinx or another library of the system is missing.
    """
    module = module or package
    load, list_names, names = lazy_loader.attach_stub(package, init_file)

    def __getattr__(name: str) -> Any:
        """Load a public name of the package at its first use, and return it.

        Raises:
            AttributeError: the package has no such name; similar names are proposed.
            ImportError: dolfinx or another library of the system, which pip does not install, is
                missing.
        """
        if name not in names:
            raise AttributeError(_unknown(module, name, names))
        try:
            found = load(name)
        except ModuleNotFoundError as error:
            library = (error.name or "").split(".")[0]
            if library not in _FROM_THE_SYSTEM:
                raise
            raise ImportError(
                f"gossamer_fx {VERSION} needs {library}, which this Python does not have; use a "
                "Python with dolfinx, petsc4py, mpi4py and gmsh, or pip install "
                "'gossamer_fx[light]'."
            ) from error
        # The next use finds the attribute without this function.
        setattr(sys.modules[module], name, found)
        return found

    return __getattr__, list_names, names


def public_names() -> list[str]:
    """Names of all public classes and functions as they follow `gx.`, each once.

    Core names stand alone, e.g. "Chamber"; the others have their namespace, e.g. "gas.Ring".
    """
    core_names = import_module("gossamer_fx").__all__
    namespaces = _namespaces("gossamer_fx", core_names)
    found = [name for name in core_names if name not in namespaces]
    for namespace, names in namespaces.items():
        for name in names:
            if name not in core_names and not _is_module(f"gossamer_fx.{namespace}", name):
                found.append(f"{namespace}.{name}")
    return found


def _unknown(package: str, name: str, names: list[str]) -> str:
    """Message about an unknown name, with similar names of the package and of its namespaces.

    Args:
        package: name of the package.
        name: the name that it has not.
        names: its public names.
    """
    message = f"{package} has no '{name}'"
    proposals = difflib.get_close_matches(name, names, n=_MAX_PROPOSALS, cutoff=0.75)
    for namespace, known in _namespaces(package, names).items():
        if name in known:
            proposals.insert(0, f"{namespace}.{name}")
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
