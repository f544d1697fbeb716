"""The arguments of public classes and functions are of the types in their annotations.

`check_arguments` is put on a class or function where it is defined, so that the check is the same by every
import path and comes before the function does anything.  It refuses, in one sentence, arguments that
are missing or unknown, and values of another type, infinite numbers and NaN included.  What values
mean is check_arguments by those who take them.

Annotations are read as a user of NumPy reads them: an integer is a float, a NumPy number a number,
a list or an array is a tuple.  Type checkers such as beartype refuse these, and take 130 ms to
import.  An annotation is resolved when a value is first given for its argument, and a name that its
module imports for type checkers only is imported then: such a value cannot exist before.
"""

from __future__ import annotations

import ast
import functools
import inspect
import math
import os
import sys
import types
import typing
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from importlib import import_module
from numbers import Integral, Real
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin

import numpy as np
import numpy.typing as npt

from gossamer_fx.checks.errors import InputError

# What messages ask for in place of the name of a class.
_DESCRIPTIONS = {
    "Intracomm": "a communicator, e.g. MPI.COMM_WORLD",
    "Body": "a body",
    "MeshBody": "a body on a mesh",
    "Meshed": "a body on a mesh",
    "Curve": "a cable or beam",
    "Stepper": "a stepper, e.g. Midpoint(dt=1e-3)",
    "Output": "an output, e.g. Ledger",
    "StressRule": "a stress rule, e.g. PathAverage()",
    "Joint": "a joint, e.g. BallJoint",
    "State": "a Simulation or an Equilibrium",
    "Item": "parts of a scene: bodies, gas, loads, constraints or connectors",
    "Holder": "a reservoir or surroundings",
    "Volume": "a chamber or tank",
    "Event": "an At or a When",
    "Motion": "a recording of shapes, e.g. Snapshots",
    "FilmLaw": "a law of films, e.g. Miyazaki",
    "Obstacle": "an obstacle, e.g. a Plane",
    "Assembly": "the system of an Equilibrium or a Simulation, or scene.compile()",
    "Enclosure": "a Piston",
}
_COUNTS = {2: "two", 3: "three", 4: "four"}
_CALLABLE: Any = Callable  # compared with the origin of an annotation
_MAX_SHOWN = 40  # characters of a value in a message


@dataclass(frozen=True)
class Count:
    """Mark of an annotated sequence that has this number of entries."""

    entries: int


@dataclass(frozen=True)
class Kind:
    """What an annotation allows: a test of values, and the words of a message that asks for one."""

    accepts: Callable[[Any], bool]
    words: str


def check_arguments[T: Callable[..., Any]](thing: T) -> T:
    """Let a class or function check its arguments before it acts; a decorator.

    A class is check_arguments when it is made, a subclass with a constructor of its own is not.

    Raises, when it is called:
        InputError: an argument that is missing, unknown, or not of the type in its annotation.

    Example:
        >>> from gossamer_fx.checks.arguments import check_arguments
        >>> @check_arguments
        ... def area(width: float, height: float = 1.0) -> float:
        ...     return width * height
        >>> area("wide")
        Traceback (most recent call last):
        gossamer_fx.checks.errors.InputError: area: width is 'wide'; give a number.
    """
    if isinstance(thing, type):
        thing.__init__ = _checking(thing.__init__)  # type: ignore[misc]
        return typing.cast(T, thing)
    return typing.cast(T, _checking(thing))


def _checking(function: Callable[..., Any]) -> Callable[..., Any]:
    @functools.cache
    def signature() -> inspect.Signature:
        return inspect.signature(function)

    @functools.cache
    def kind(argument: str) -> Kind | None:
        return kind_of(resolved(function, argument))

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        name = function.__name__
        if name == "__init__":
            name = type(args[0]).__name__
        try:
            given = signature().bind(*args, **kwargs).arguments
        except TypeError as error:
            message = _wrong_call(signature(), args, kwargs, error)
            raise InputError(f"{name}: {message}.") from None
        if isinstance(given.get("name"), str):
            name = f"{name} '{given['name']}'"
        for argument, value in given.items():
            parameter = signature().parameters[argument]
            if argument == "self" or value is parameter.default:
                continue
            many = parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD)
            for label, one in _labelled(argument, value) if many else [(argument, value)]:
                allowed = kind(argument)
                if allowed is None or allowed.accepts(one):
                    continue
                # infinity is a value where it is the default
                if parameter.default == math.inf and one == math.inf:
                    continue
                raise InputError(f"{name}: {label} is {_shown(one)}; give {allowed.words}.")
        return function(*args, **kwargs)

    return call


def _labelled(argument: str, values: Any) -> list[tuple[str, Any]]:
    """Values given for `*argument` or `**argument`, and how a message calls each."""
    if isinstance(values, dict):
        return list(values.items())
    return [(f"{argument}[{k}]", value) for k, value in enumerate(values)]


def _wrong_call(
    signature: inspect.Signature, args: tuple[Any, ...], kwargs: dict[str, Any], error: TypeError
) -> str:
    """Why arguments do not fit a signature."""
    parameters = {n: p for n, p in signature.parameters.items() if n != "self"}
    known = f"its arguments are: {', '.join(parameters) or 'none'}"
    unknown = [argument for argument in kwargs if argument not in parameters]
    if unknown:
        return f"there is no argument {unknown[0]!r}; {known}"
    positional = [
        n for n, p in parameters.items() if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)
    ]
    by_position = len(args) - ("self" in signature.parameters)
    if by_position > len(positional):
        limit = f"after {positional[-1]!r}" if positional else "in all cases"
        return f"{by_position} arguments are given without a name; give names {limit}; {known}"
    needed = [
        n for n, p in parameters.items() if p.default is p.empty and p.kind != p.VAR_POSITIONAL
    ]
    missing = [n for n in needed if n not in kwargs and n not in positional[:by_position]]
    if missing:
        return f"the argument {missing[0]!r} is missing; {known}"
    return f"{error}; {known}"


# ---- annotations -------------------------------------------------------------------------------


def resolved(function: Callable[..., Any], argument: str) -> Any:
    """The annotation of an argument as a type.

    Raises:
        NameError: the module of the function does not know a name in it.
    """
    annotation = inspect.signature(function).parameters[argument].annotation
    if not isinstance(annotation, str):
        return annotation
    # A dataclass takes fields, with their annotations, from base classes of other modules.
    owner = vars(sys.modules[function.__module__]).get(function.__qualname__.split(".")[0])
    modules = [function.__module__]
    if isinstance(owner, type) and "__dataclass_params__" in vars(owner):
        modules = [
            base.__module__ for base in owner.__mro__ if argument in inspect.get_annotations(base)
        ] or modules
    module = sys.modules[modules[0]]
    return eval(annotation, vars(module), _TypeCheckingNames(module))


class _TypeCheckingNames(dict[str, Any]):
    """Names that a module imports under `if TYPE_CHECKING`, imported when they are asked for."""

    def __init__(self, module: types.ModuleType) -> None:
        super().__init__()
        self._module = module

    def __missing__(self, name: str) -> Any:
        if name not in vars(self._module):
            home = _type_checking_imports(self._module.__name__).get(name)
            if home is not None:
                return getattr(import_module(home[0]), home[1])
        raise KeyError(name)  # a global name or a built-in one


@functools.cache
def _type_checking_imports(module: str) -> dict[str, tuple[str, str]]:
    """Module and name by the local name of each import under `if TYPE_CHECKING`."""
    found: dict[str, tuple[str, str]] = {}
    for node in ast.parse(inspect.getsource(sys.modules[module])).body:
        if not (isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"):
            continue
        for statement in node.body:
            if isinstance(statement, ast.ImportFrom) and statement.module:
                for alias in statement.names:
                    found[alias.asname or alias.name] = (statement.module, alias.name)
    return found


def kind_of(hint: Any) -> Kind | None:
    """What a type allows; None if it allows all values.

    Raises:
        TypeError: a type that cannot be tested, e.g. a protocol that is not `runtime_checkable`.
    """
    if isinstance(hint, typing.TypeAliasType):
        return kind_of(hint.__value__)
    if hint is Any or hint is object or isinstance(hint, TypeVar):
        return None
    if hint is npt.ArrayLike:
        return Kind(_is_numeric, "numbers")
    if hint in _SIMPLE:
        return _SIMPLE[hint]
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return _annotated(arguments[0], arguments[1:])
    if origin in (Union, types.UnionType):
        return _union(arguments)
    if origin is typing.Literal:
        words = " or ".join(repr(value) for value in arguments)
        return Kind(lambda value: isinstance(value, str | int) and value in arguments, words)
    if origin is tuple and arguments[-1] is not Ellipsis:
        return _tuple([kind_of(argument) for argument in arguments], arguments)
    if origin is not None and inspect.isclass(origin):
        return _generic(origin, arguments)
    if inspect.isclass(hint):
        return _class(hint)
    raise TypeError(f"{hint!r} is not a type that arguments can be tested for")


def _annotated(hint: Any, marks: Iterable[Any]) -> Kind | None:
    kind = kind_of(hint)
    counts = [mark.entries for mark in marks if isinstance(mark, Count)]
    if kind is None or not counts:
        return kind
    [entries] = counts
    return Kind(
        lambda value: kind.accepts(value) and len(value) == entries,
        f"{_COUNTS.get(entries, entries)} {kind.words}",
    )


def _union(alternatives: Iterable[Any]) -> Kind | None:
    hints = list(alternatives)
    if Path in hints:
        hints = [hint for hint in hints if hint is not str]  # a word is tested as a path
    kinds = [kind_of(hint) for hint in hints]
    several = [kind for kind in kinds if kind is not None]
    if len(several) < len(kinds):
        return None
    words = " or ".join(dict.fromkeys(kind.words for kind in several))
    return Kind(lambda value: any(kind.accepts(value) for kind in several), words)


def _tuple(kinds: list[Kind | None], hints: Iterable[Any]) -> Kind:
    """Of fixed length."""

    def accepts(value: Any) -> bool:
        if not _is_collection(value) or len(value) != len(kinds):
            return False
        pairs = zip(kinds, value, strict=True)
        return all(kind is None or kind.accepts(one) for kind, one in pairs)

    count = _COUNTS.get(len(kinds), str(len(kinds)))
    if all(hint is float for hint in hints):
        return Kind(accepts, f"{count} numbers")
    each = " and ".join(kind.words if kind else "any value" for kind in kinds)
    return Kind(accepts, f"a tuple of {each}")


def _generic(origin: type, arguments: tuple[Any, ...]) -> Kind | None:
    """A class with arguments, e.g. Sequence[float]."""
    if origin is _CALLABLE:
        return Kind(callable, "a function")
    if issubclass(origin, np.ndarray):
        return Kind(lambda value: isinstance(value, np.ndarray), "an array")
    if issubclass(origin, Mapping):
        keys, values = kind_of(arguments[0]), kind_of(arguments[1])
        return Kind(
            lambda value: (
                isinstance(value, Mapping)
                and (keys is None or all(map(keys.accepts, value)))
                and (values is None or all(map(values.accepts, value.values())))
            ),
            "a dict" + (f" whose values are each {values.words}" if values else ""),
        )
    if issubclass(origin, type):
        return Kind(
            lambda value: isinstance(value, type) and issubclass(value, arguments[0]),
            f"a kind of {arguments[0].__name__}",
        )
    if issubclass(origin, Collection):
        each = kind_of(arguments[0])
        if arguments[0] is float:
            return Kind(_are_numbers, "numbers")
        if arguments[0] is int:
            return Kind(_are_whole_numbers, "whole numbers")
        return Kind(
            lambda value: _is_collection(value) and (each is None or all(map(each.accepts, value))),
            f"a list whose entries are each {each.words}" if each else "a list",
        )
    return _class(origin)


def _class(kind: type) -> Kind:
    is_protocol = getattr(kind, "_is_protocol", False)
    if is_protocol and not getattr(kind, "_is_runtime_protocol", False):
        raise TypeError(f"the protocol {kind.__name__} is not runtime_checkable")
    article = "an" if kind.__name__[0] in "AEIOU" else "a"
    words = _DESCRIPTIONS.get(kind.__name__, f"{article} {kind.__name__}")
    return Kind(lambda value: isinstance(value, kind), words)


# ---- values ------------------------------------------------------------------------------------


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)


def _is_whole_number(value: Any) -> bool:
    return isinstance(value, Integral) and not isinstance(value, bool)


def _is_collection(value: Any) -> bool:
    """Whether a value has entries and a length; a word, which has both, is one value."""
    return isinstance(value, Collection) and not isinstance(value, str | bytes | Mapping)


def _are_numbers(value: Any) -> bool:
    if not _is_collection(value):
        return False
    return _is_numeric(value) and np.ndim(value) == 1


def _are_whole_numbers(value: Any) -> bool:
    return _is_collection(value) and all(map(_is_whole_number, value))


def _is_numeric(value: Any) -> bool:
    """Whether NumPy makes an array of finite numbers of it."""
    if isinstance(value, str | bytes):
        return False
    try:
        numbers = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        return False
    return bool(np.isfinite(numbers).all())


def _is_path(value: Any) -> bool:
    """Whether a value can be the name of a file: null characters cannot, nor what has no bytes."""
    if not isinstance(value, str | PathLike):
        return False
    try:
        return b"\0" not in os.fsencode(value)
    except (TypeError, UnicodeEncodeError):
        return False


_SIMPLE: dict[Any, Kind] = {
    float: Kind(_is_number, "a number"),
    int: Kind(_is_whole_number, "a whole number"),
    bool: Kind(lambda value: isinstance(value, bool | np.bool_), "True or False"),
    str: Kind(lambda value: isinstance(value, str), "a word"),
    Path: Kind(_is_path, "a path without null characters"),
    None: Kind(lambda value: value is None, "None"),
    type(None): Kind(lambda value: value is None, "None"),
    typing.IO[str]: Kind(lambda value: hasattr(value, "write"), "an open file"),
    Callable: Kind(callable, "a function"),
}


def _shown(value: Any) -> str:
    """A value as a message shows it: itself if that is short, else its class."""
    text = repr(value)
    plain = "\n" not in text and len(text) <= _MAX_SHOWN and " object at " not in text
    return text if plain else f"of the kind {type(value).__name__}"
