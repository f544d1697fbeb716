"""What is known of the parameters of a scene's items and of functions, as data that a checkpoint can hold and compare.

Numbers, words, and whatever is made of them are known by value, other items of the scene by their kind and name,
attached points by their place.  Of a function, its code is known, and the numbers and words in it, among its defaults,
and among what it takes from outside; a list, an array or an object that it takes from outside is not.
"""

from __future__ import annotations

import functools
import hashlib
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields, is_dataclass
from numbers import Integral, Real
from types import CodeType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

from gossamer_fx.model.body import Ground, Port

Known = Any  # numbers, words, lists and dicts of them

SAME = 1e-9  # relative difference of numbers that is round-off
_UNKNOWN = "unknown"  # key of what is not known, with what it is called
_DEPTH = 6  # functions that call functions that ...


def describe(thing: Any, items: Iterable[Any] = (), depth: int = 0) -> Known:
    """What is known of a value; dicts of one key, `unknown`, stand for what is not."""
    known = tuple(items)
    inner = functools.partial(describe, items=known, depth=depth + 1)
    if thing is None or isinstance(thing, bool | str):
        return thing
    if isinstance(thing, Integral):
        return int(thing)
    if isinstance(thing, Real):
        return float(thing)
    if any(thing is item for item in known):
        return f"{type(thing).__name__} '{thing.name}'"
    if isinstance(thing, Port):
        return {
            "body": thing.body.name,
            "vectors": list(thing.vectors),
            "at": thing.initial().tolist(),
        }
    if isinstance(thing, Ground):
        return {"ground": [float(x) for x in thing.vector]}
    if isinstance(thing, np.ndarray) and thing.dtype.kind in "fiub" and thing.size <= 1000:
        return thing.tolist()
    if isinstance(thing, list | tuple | set | frozenset):
        return [inner(one) for one in thing]
    if isinstance(thing, Mapping):
        return {str(key): inner(value) for key, value in thing.items()}
    if depth < _DEPTH:
        if callable(thing) and not isinstance(thing, type):
            return _of_function(thing, inner)
        if is_dataclass(thing) and not isinstance(thing, type):
            return {f.name: inner(getattr(thing, f.name)) for f in fields(thing)}
    return {_UNKNOWN: type(thing).__name__}


def of_item(item: Any, items: Iterable[Any]) -> dict[str, Known]:
    """What is known of the parameters of an item of a scene: of its public attributes that it was given."""
    import inspect

    given = set(inspect.signature(type(item)).parameters) - {"name", "comm", "mesh"}
    found = {}
    for name, value in vars(item).items():
        simple = isinstance(value, bool | str | Real | tuple) or value is None
        if not name.startswith("_") and name not in ("name", "comm") and (name in given or simple):
            found[name] = describe(value, items)
    return found


def _of_function(function: Callable[..., Any], inner: Callable[[Any], Known]) -> Known:
    if isinstance(function, functools.partial):
        return {
            "function": inner(function.func),
            "with": [inner(function.args), inner(function.keywords)],
        }
    if isinstance(function, MethodType):
        return {"function": inner(function.__func__), "of": inner(function.__self__)}
    if not isinstance(function, FunctionType):
        call = vars(type(function)).get("__call__")
        if not isinstance(call, FunctionType):  # of a compiled library
            return {
                "function": f"{getattr(function, '__module__', '')}.{getattr(function, '__name__', '')}"
            }
        return {
            "function": inner(call),
            "of": {str(k): inner(v) for k, v in vars(function).items()},
        }
    code = function.__code__
    cells = zip(code.co_freevars, function.__closure__ or (), strict=True)
    outside = {name: _contents(cell) for name, cell in cells}
    outside |= {
        name: function.__globals__[name] for name in _names(code) if name in function.__globals__
    }
    return {
        "code": f"Python {sys.version_info[0]}.{sys.version_info[1]} {_hash(code)}",
        "defaults": [inner(function.__defaults__), inner(function.__kwdefaults__)],
        "outside": {
            k: _from_outside(v, inner)
            for k, v in outside.items()
            if not isinstance(v, ModuleType | type)
        },
    }


def _contents(cell: Any) -> Any:
    try:
        return cell.cell_contents
    except ValueError:  # not yet filled
        return None


def _from_outside(value: Any, inner: Callable[[Any], Known]) -> Known:
    """Of what a function takes from outside: what may change in the course of a run is not known."""
    if isinstance(value, bool | str | Real | tuple | FunctionType) or value is None:
        return inner(value)
    return {_UNKNOWN: type(value).__name__}


def _names(code: CodeType) -> set[str]:
    """Names that a function and those in it use."""
    return set(code.co_names).union(
        *(_names(part) for part in code.co_consts if isinstance(part, CodeType))
    )


def _hash(code: CodeType) -> str:
    """Of what a function does, wherever it stands."""
    parts = [code.co_code, repr((code.co_names, code.co_varnames, code.co_freevars)).encode()]
    for constant in code.co_consts:
        parts.append(
            _hash(constant).encode() if isinstance(constant, CodeType) else repr(constant).encode()
        )
    return hashlib.sha256(b"\0".join(parts)).hexdigest()[:16]


def difference(there: Known, here: Known, place: str = "") -> tuple[str, Known, Known] | None:
    """The first place where two descriptions differ, and what stands there; None where nothing that is known does."""
    if isinstance(there, dict) and isinstance(here, dict):
        if _UNKNOWN in there and _UNKNOWN in here:
            return None
        for key in there.keys() | here.keys():
            if key not in there or key not in here:
                return _at(place, key), there.get(key), here.get(key)
        pairs: list[tuple[str, Known, Known]] = [
            (_at(place, key), there[key], here[key]) for key in sorted(there)
        ]
    elif isinstance(there, list) and isinstance(here, list) and len(there) == len(here):
        pairs = [(place, one, other) for one, other in zip(there, here, strict=True)]
    elif _is_number(there) and _is_number(here):
        same = abs(there - here) <= SAME * max(abs(there), abs(here)) + 1e-12
        return None if same or there == here else (place, there, here)
    else:
        return None if there == here else (place, there, here)
    found = (difference(one, other, where) for where, one, other in pairs)
    first = next((f for f in found if f), None)
    if first and isinstance(there, list) and all(map(_is_number, [*there, *here])):
        return place, there, here
    return first


def _at(place: str, key: str) -> str:
    return f"{place} {key}".strip()


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def unknown(known: Known, place: str = "") -> list[str]:
    """Places of what is not known in a description."""
    if isinstance(known, dict):
        if _UNKNOWN in known:
            return [place]
        return [where for key, value in known.items() for where in unknown(value, _at(place, key))]
    return (
        [where for one in known for where in unknown(one, place)] if isinstance(known, list) else []
    )
