"""The arguments of a scene's items as data, which recordings and checkpoints store and a restart
compares.

Stored are

1. numbers, words and collections of them by value,
2. other items of the scene by class and name, attached points by their position,
3. other objects of this package, e.g. laws, optics or obstacles, by their own arguments,
4. functions by their qualified name, the numbers and words in their body, the names of what they
   use (`sin` for `np.sin`), their default arguments, and the numbers and words that they read from
   outside.

Another constant or parameter of a function is therefore noticed.

Limits.  Changes of a function that leave all these as they are, e.g. `a - b` for `b - a`, are not
noticed. A list, an array or an object that a function reads from outside may change during a run,
and is reported as unknown.
"""

from __future__ import annotations

import dis
import functools
import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from numbers import Integral, Real
from types import CodeType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.model.body import Ground, Port
from gossamer_fx.mechanics.terms.scalar_unknowns import InitialCondition

# A value for JSON: None, bool, int, float, str, and lists and dictionaries of them.
Known = Any

# The only key of a dictionary in place of a value that is not stored; its value is the name of the
# class.
UNKNOWN = "unknown"

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

# Over the body's size: points on cells are interpolated.
_POSITION_TOLERANCE = 1e-9


def arguments_of(items: Sequence[Any]) -> dict[str, dict[str, Known]]:
    """The arguments of the items of a scene, by the items' names.  Collective.

    A checkpoint stores them, and a restart compares them with those of the present scene.  Initial
    conditions are left out: a restart replaces them by the state of the checkpoint.

    Args:
        items: bodies, loads, constraints and other items of the scene, each with a name.

    Returns:
        for each item the values of its arguments as data for JSON, as `describe` makes them.
    """
    arguments = {}
    for item in items:
        if not isinstance(item, InitialCondition):
            arguments[item.name] = of_item(item, items)
    return arguments


def of_item(item: Any, items: Iterable[Any]) -> dict[str, Known]:
    """The arguments of an item of a scene, by name, and its public attributes that are numbers,
    words or obstacles.  Collective.

    Args:
        item: it keeps each argument as an attribute of the argument's name, maybe after an
            underscore.
        items: of the scene; references to them are stored as class and name.

    Returns:
        values as data for JSON, as `describe` makes them.
    """
    return _attributes(item, functools.partial(describe, items=tuple(items), depth=1))


def describe(value: Any, items: Iterable[Any] = (), depth: int = 0) -> Known:
    """Convert a value to data for JSON; `{"unknown": class}` stands for one that cannot be
    converted.

    Numbers and words are returned as they are, items of the scene as "Class 'name'", objects of
    this package by their arguments, functions by what their code contains.  Collective, as
    positions of attached points are sums over all ranks.

    Args:
        value: any object.
        items: of the scene, which are described by class and name.
        depth: number of objects in which the value is; deeper than 6 all objects are unknown.
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
    return {UNKNOWN: type(value).__name__}


def unknown(known: Known, where: str = "") -> list[str]:
    """Names, joined to words, that lead to the values of a description that could not be stored.

    Args:
        known: a description, as `describe` returns it: numbers, words, lists and dictionaries.
        where: words that lead to it.

    Returns:
        one text for each `{"unknown": class}`; an empty list if all values are stored.
    """
    if isinstance(known, dict):
        if UNKNOWN in known:
            return [where]
        found = []
        for key, value in known.items():
            found += unknown(value, f"{where} {key}")
        return found
    if isinstance(known, list):
        found = []
        for value in known:
            found += unknown(value, where)
        return found
    return []


# ---- objects -------------------------------------------------------------------------------------


def _is_of_package(value: Any) -> bool:
    """Whether a value is an object, not a class or function, of this package."""
    own = type(value).__module__.startswith("gossamer_fx.")
    return own and not isinstance(value, type | FunctionType | MethodType)


def _attributes(thing: Any, inner: Callable[[Any], Known]) -> dict[str, Known]:
    """The arguments with which an object was made, if it keeps them, and other plain attributes.

    Args:
        thing: the object; an argument is looked for under its name, or with an underscore before
            it.

    Returns:
        the data by name, without names, meshes and communicators, which are not compared.
    """
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
    """Data about a function, method, partial function, or object that can be called.

    Returns:
        a dictionary with the key "function"; of compiled functions it contains the name only.
    """
    if isinstance(function, functools.partial):
        return {
            "function": inner(function.func),
            "with": [inner(function.args), inner(function.keywords)],
        }
    if isinstance(function, MethodType):
        return {"function": inner(function.__func__), "of": inner(function.__self__)}
    if isinstance(function, FunctionType):
        return _of_python_function(function, inner)
    call = vars(type(function)).get("__call__")
    if isinstance(call, FunctionType):
        return {"function": inner(call), "of": inner(dict(vars(function)))}
    # A function of a compiled library, e.g. a ufunc of NumPy, has a name only.
    name = getattr(function, "__qualname__", getattr(function, "__name__", ""))
    return {"function": f"{getattr(function, '__module__', '')}.{name}"}


def _of_python_function(function: FunctionType, inner: Callable[[Any], Known]) -> Known:
    """Data about a function that is written in Python: what its code contains and uses.

    Returns:
        its name, the constants and names in its code, its default arguments, and the values of
        variables that it reads from outside.
    """
    code = function.__code__
    cells = function.__closure__ or ()
    outside: dict[str, Any] = {}
    for name, cell in zip(code.co_freevars, cells, strict=True):
        outside[name] = _contents(cell)
    # A dictionary removes repetitions and keeps the order.
    used = list(dict.fromkeys(_names(code)))
    for name in used:
        if name in function.__globals__:
            outside[name] = function.__globals__[name]
    # Modules and classes are known by their names, and the communicator may differ.
    described = {}
    for name, value in outside.items():
        if not isinstance(value, ModuleType | type | MPI.Comm):
            described[name] = _from_outside(value, inner)
    return {
        "function": function.__qualname__,
        "constants": [inner(constant) for constant in _constants(code)],
        "names": used,
        "defaults": [inner(function.__defaults__), inner(function.__kwdefaults__)],
        "outside": described,
    }


def _contents(cell: Any) -> Any:
    """The value of a variable of an enclosing function; None if it is not assigned yet."""
    try:
        return cell.cell_contents
    except ValueError:
        return None


def _from_outside(value: Any, inner: Callable[[Any], Known]) -> Known:
    """A variable that a function reads from outside, by its value if that cannot change during the
    run."""
    if isinstance(value, bool | str | Real | tuple | FunctionType) or value is None:
        return inner(value)
    return {UNKNOWN: type(value).__name__}


def _codes(code: CodeType) -> Iterator[CodeType]:
    """The code of a function and of the functions in it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


def _names(code: CodeType) -> Iterator[str]:
    """Names of variables of the module and of attributes that a function uses."""
    for each in _codes(code):
        yield from each.co_names


def _constants(code: CodeType) -> Iterator[Known]:
    """Yield the numbers and words in the body of a function, in their order.

    They are read from the instructions, which the module `dis` knows for each version of Python:
    small integers are no longer among `co_consts` in Python 3.14, and a docstring is."""
    for each in _codes(code):
        for instruction in dis.get_instructions(each):
            if "CONST" in instruction.opname or instruction.opname == "LOAD_SMALL_INT":
                yield from _plain_constants(instruction.argval)


def _plain_constants(value: Any) -> Sequence[Known]:
    """The numbers and words in a constant of a function; an empty list for others, e.g. None or a
    slice."""
    if isinstance(value, tuple | frozenset):
        found: list[Known] = []
        for element in value:
            found += _plain_constants(element)
        return found
    if isinstance(value, str | Real) and not isinstance(value, bool):
        return [value]
    if isinstance(value, complex | bytes):
        return [repr(value)]
    return []
