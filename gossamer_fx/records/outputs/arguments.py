"""The arguments of a scene's items as data, which recordings and checkpoints store and a restart
compares.

Stored are

1. numbers, words and collections of them by value,
2. other items of the scene by class and name, attached points by their position,
3. other objects of this package, e.g. laws, optics or obstacles, by their own arguments,
4. functions by their qualified name, a hash of their source, their default arguments, and the
   numbers and words that they read from outside.

Limits.  Of a list, an array or an object that a function reads from outside, and that may change
during a run, only the class is stored.
"""

from __future__ import annotations

import functools
import hashlib
import inspect
import tokenize
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from numbers import Integral, Real
from types import FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.model.body import Ground, Port
from gossamer_fx.mechanics.terms.scalar_unknowns import InitialCondition

# A value for JSON: None, bool, int, float, str, and lists and dictionaries of them.
Known = Any

# Keys of numbers that are computed from a mesh, and of their tolerance.
MEASURED = "measured"
TOLERANCE = "tolerance"

# Names are the keys of items, meshes are compared by their cells, and the communicator may differ.
_NOT_COMPARED = ("name", "comm", "mesh")

# Levels of objects in objects, and of functions that use functions: some refer to each other in a
# circle.
_MAX_DEPTH = 6

# Numbers of an array that is stored: larger ones would make the file long.
_MAX_ARRAY = 1000

# Hexadecimal digits of the hash of a function's source.
_HASH_DIGITS = 16

# Over the body's size: points on cells are interpolated.
_POSITION_TOLERANCE = 1e-9


def arguments_of(items: Sequence[Any]) -> dict[str, dict[str, Known]]:
    """The arguments of the items of a scene, by the items' names.  Collective.

    A checkpoint stores them, and a restart compares them with those of the present scene.  Initial
    conditions are left out: a restart replaces them by the state of the checkpoint.
    """
    arguments = {}
    for item in items:
        if not isinstance(item, InitialCondition):
            arguments[item.name] = of_item(item, items)
    return arguments


def of_item(item: Any, items: Iterable[Any]) -> dict[str, Known]:
    """The arguments of an item of a scene, by name, and its public attributes that are numbers,
    words or obstacles.  Collective.
    """
    return _attributes(item, functools.partial(describe, items=tuple(items), depth=1))


def describe(value: Any, items: Iterable[Any] = (), depth: int = 0) -> Known:
    """Convert a value to data for JSON; the name of its class stands for one that cannot be
    converted.

    Numbers and words are returned as they are, items of the scene as "Class 'name'", objects of
    this package by their arguments, functions by what their code contains.  Collective, as
    positions of attached points are sums over all ranks.
    """
    known_items = tuple(items)
    inner = functools.partial(describe, items=known_items, depth=depth + 1)
    if isinstance(value, np.bool_):
        return bool(value)
    # Before the numbers, as Python counts True and False as integers.
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real):
        return float(value)
    if any(value is item for item in known_items):
        return f"{type(value).__name__} '{value.name}'"
    if isinstance(value, Port):
        return _of_port(value)
    if isinstance(value, Ground):
        return {"ground": [float(x) for x in value.vector]}
    if isinstance(value, np.ndarray):
        is_numeric = value.dtype.kind in "fiub"
        if is_numeric and value.size <= _MAX_ARRAY:
            return value.tolist()
    if isinstance(value, list | tuple):
        return [inner(one) for one in value]
    if isinstance(value, set | frozenset):
        # Sorted, as the order of a set of words differs from run to run.
        return sorted((inner(one) for one in value), key=repr)
    if isinstance(value, Mapping):
        return {str(key): inner(one) for key, one in value.items()}
    if depth < _MAX_DEPTH:
        if _is_of_package(value) or is_dataclass(value):
            return {"class": type(value).__name__, **_attributes(value, inner)}
        if callable(value) and not isinstance(value, type):
            return _of_function(value, inner)
    return type(value).__name__


# ---- objects -------------------------------------------------------------------------------------


def _is_of_package(value: Any) -> bool:
    """Whether a value is an object, not a class or function, of this package."""
    own = type(value).__module__.startswith("gossamer_fx.")
    return own and not isinstance(value, type | FunctionType | MethodType)


def _attributes(thing: Any, inner: Callable[[Any], Known]) -> dict[str, Known]:
    """The arguments with which an object was made, if it keeps them, and other plain attributes."""
    if is_dataclass(thing):
        arguments = [field.name for field in fields(thing)]
    else:
        arguments = list(inspect.signature(type(thing)).parameters)
    # Objects with slots have no dictionary.
    attributes: dict[str, Any] = {}
    if hasattr(thing, "__dict__"):
        attributes = vars(thing)
    found: dict[str, Known] = {}
    for name in arguments:
        for kept in (name, f"_{name}"):
            if kept in attributes or (kept == name and is_dataclass(thing)):
                found[name] = inner(getattr(thing, kept))
                break
    for name, value in attributes.items():
        if not name.startswith("_") and name not in found and _is_plain(value):
            found[name] = inner(value)
    return {name: value for name, value in found.items() if name not in _NOT_COMPARED}


def _is_plain(value: Any) -> bool:
    """Whether an attribute that is not an argument is data of the object, and nothing made of a
    mesh."""
    if isinstance(value, list | tuple):
        return all(_is_plain(one) or _is_of_package(one) for one in value)
    return value is None or isinstance(value, bool | str | Real)


def _of_port(port: Port) -> Known:
    """Data about a vector attached to a body, for the comparison with a later run.  Collective.

    Args:
        port: weights on nodes of a body.  The numbers of its nodes are not stored, since they
            differ between runs; its initial value is, (3,) [m] or [-], with a tolerance [m].
    """
    body = port.body
    coordinates = body.initial_state()[0]
    largest = body.comm.allreduce(float(np.abs(coordinates).max(initial=0.0)), MPI.MAX)
    return {
        "body": body.name,
        "vectors": list(port.vectors),
        "at": {MEASURED: port.initial().tolist(), TOLERANCE: _POSITION_TOLERANCE * largest},
    }


# ---- functions -----------------------------------------------------------------------------------


def _of_function(function: Callable[..., Any], inner: Callable[[Any], Known]) -> Known:
    """Data about a function, method or partial function: its name, a hash of its source, and the
    values that it takes from its surroundings.

    Of compiled functions, e.g. those of NumPy, and other objects only the name is known.
    """
    if isinstance(function, functools.partial):
        return {
            "function": inner(function.func),
            "with": [inner(function.args), inner(function.keywords)],
        }
    if isinstance(function, MethodType):
        return {"function": inner(function.__func__), "of": inner(function.__self__)}
    name = getattr(function, "__qualname__", type(function).__name__)
    if not isinstance(function, FunctionType):
        return {"function": f"{getattr(function, '__module__', '')}.{name}"}
    known: dict[str, Known] = {
        "function": name,
        "defaults": [inner(function.__defaults__), inner(function.__kwdefaults__)],
        "outside": {},
    }
    try:
        source = inspect.getsource(function)
        known["source"] = hashlib.sha256(source.encode()).hexdigest()[:_HASH_DIGITS]
    except (OSError, TypeError, SyntaxError, tokenize.TokenError):
        # As of a function that was typed in or made by a program, or whose file was changed since.
        known["source"] = None
    read = inspect.getclosurevars(function)
    for outside, value in {**read.globals, **read.nonlocals}.items():
        # Modules and classes are known by their names, and the communicator may differ.
        if isinstance(value, ModuleType | type | MPI.Comm):
            continue
        is_constant = isinstance(value, bool | str | Real | tuple | FunctionType) or value is None
        # A list, an array or an object may change during the run.
        known["outside"][outside] = inner(value) if is_constant else type(value).__name__
    return known
