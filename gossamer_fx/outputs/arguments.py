"""The arguments of a scene's items, as data that recordings and checkpoints store and a restart compares.

Numbers, words and collections of them are stored by value, other items of the scene by their class and name, attached
points by their position.  Other objects of this package, e.g. laws, optics or obstacles, are stored by their own
arguments.

A function is stored by its qualified name, the numbers and words in its body, the names of what it uses (`sin` for
`np.sin`), its default arguments, and the numbers and words that it takes from outside.  So another constant or another
parameter is noticed.  Not noticed are changes of the body that leave all these as they are, e.g. `a - b` for `b - a`.
A list, an array or an object that a function takes from outside may change during a run, and is reported as unknown.
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

from gossamer_fx.model.body import Ground, Port
from gossamer_fx.terms.scalar_unknowns import InitialCondition

Known = Any  # None, bool, int, float, str, and lists and dicts of them

UNKNOWN = (
    "unknown"  # the only key of what stands for a value that is not stored; its value is the class
)
MEASURED = "measured"  # key of numbers that are computed from a mesh, next to their tolerance
TOLERANCE = "tolerance"

# Meshes are compared by themselves, and the communicator may be another one.
_NOT_COMPARED = ("name", "comm", "mesh")
_MAX_DEPTH = 6  # of functions that use functions, and of objects in objects
_MAX_ARRAY = 1000  # numbers of an array that is stored
_POSITION_TOLERANCE = 1e-9  # of the body's size: points on cells are interpolated


def arguments_of(items: Sequence[Any]) -> dict[str, dict[str, Known]]:
    """The arguments of the items of a scene, by the items' names; of all but initial conditions.  Collective."""
    return {
        item.name: of_item(item, items) for item in items if not isinstance(item, InitialCondition)
    }


def of_item(item: Any, items: Iterable[Any]) -> dict[str, Known]:
    """The arguments of an item of a scene, by name, and its public attributes that are numbers, words or obstacles.

    Args:
        item: it keeps each argument as an attribute of the argument's name, maybe after an underscore.
        items: of the scene.
    """
    return _attributes(item, functools.partial(describe, items=tuple(items), depth=1))


def describe(value: Any, items: Iterable[Any] = (), depth: int = 0) -> Known:
    """A value as data; `{"unknown": class}` where it has none."""
    known_items = tuple(items)
    inner = functools.partial(describe, items=known_items, depth=depth + 1)
    if value is None or isinstance(value, bool | np.bool_ | str):
        return bool(value) if isinstance(value, np.bool_) else value
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
    if isinstance(value, np.ndarray) and value.dtype.kind in "fiub" and value.size <= _MAX_ARRAY:
        return value.tolist()
    if isinstance(value, list | tuple):
        return [inner(one) for one in value]
    if isinstance(value, set | frozenset):  # the order of a set of words differs from run to run
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
    """Where in a description values are unknown, in words."""
    if isinstance(known, dict):
        if UNKNOWN in known:
            return [where]
        return [place for key, one in known.items() for place in unknown(one, f"{where} {key}")]
    if isinstance(known, list):
        return [place for one in known for place in unknown(one, where)]
    return []


# ---- objects --------------------------------------------------------------------------------------------------------


def _is_of_package(value: Any) -> bool:
    own = type(value).__module__.startswith("gossamer_fx.")
    return own and not isinstance(value, type | FunctionType | MethodType)


def _attributes(thing: Any, inner: Callable[[Any], Known]) -> dict[str, Known]:
    """The arguments with which an object was made, as far as it keeps them, and further plain attributes."""
    if is_dataclass(thing):
        arguments = [field.name for field in fields(thing)]
    else:
        arguments = list(inspect.signature(type(thing)).parameters)
    attributes = vars(thing) if hasattr(thing, "__dict__") else {}
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
    """Whether an attribute that is not an argument says something about the object: not what is made of meshes."""
    if isinstance(value, list | tuple):
        return all(_is_plain(one) or _is_of_package(one) for one in value)
    return value is None or isinstance(value, bool | str | Real)


def _of_port(port: Port) -> Known:
    """A vector that is attached to a body: its value at the start, whatever the numbering of the nodes."""
    body = port.body
    coordinates = body.initial_state()[0]
    largest = body.comm.allreduce(float(np.abs(coordinates).max(initial=0.0)), MPI.MAX)
    return {
        "body": body.name,
        "vectors": list(port.vectors),
        "at": {MEASURED: port.initial().tolist(), TOLERANCE: _POSITION_TOLERANCE * largest},
    }


# ---- functions ------------------------------------------------------------------------------------------------------


def _of_function(function: Callable[..., Any], inner: Callable[[Any], Known]) -> Known:
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
    # a function of a compiled library, e.g. a ufunc of NumPy
    name = getattr(function, "__qualname__", getattr(function, "__name__", ""))
    return {"function": f"{getattr(function, '__module__', '')}.{name}"}


def _of_python_function(function: FunctionType, inner: Callable[[Any], Known]) -> Known:
    code = function.__code__
    cells = function.__closure__ or ()
    outside = {name: _contents(cell) for name, cell in zip(code.co_freevars, cells, strict=True)}
    used = list(dict.fromkeys(_names(code)))
    outside |= {name: function.__globals__[name] for name in used if name in function.__globals__}
    return {
        "function": function.__qualname__,
        "constants": [inner(constant) for constant in _constants(code)],
        "names": used,
        "defaults": [inner(function.__defaults__), inner(function.__kwdefaults__)],
        "outside": {
            name: _from_outside(value, inner)
            for name, value in outside.items()
            if not isinstance(value, ModuleType | type | MPI.Comm)
        },
    }


def _contents(cell: Any) -> Any:
    try:
        return cell.cell_contents
    except ValueError:  # a variable that is not assigned yet
        return None


def _from_outside(value: Any, inner: Callable[[Any], Known]) -> Known:
    """A variable that a function uses and does not own: only of constant kinds is its value that of the whole run."""
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
    """Numbers and words in the body of a function, in their order.

    They are read from the instructions, which the module `dis` knows for each version of Python: small integers are no
    longer among `co_consts` in Python 3.14, and a docstring is.
    """
    for each in _codes(code):
        for instruction in dis.get_instructions(each):
            if "CONST" in instruction.opname or instruction.opname == "LOAD_SMALL_INT":
                yield from _plain_constants(instruction.argval)


def _plain_constants(value: Any) -> Sequence[Known]:
    if isinstance(value, tuple | frozenset):
        return [plain for one in value for plain in _plain_constants(one)]
    if isinstance(value, str | Real) and not isinstance(value, bool):
        return [value]
    if isinstance(value, complex | bytes):
        return [repr(value)]
    return []
