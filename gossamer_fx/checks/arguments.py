"""Arguments of the public names are of the kinds that their annotations say, or are refused in one sentence.

Values out of range are refused by those who take them, who are asked first.  Here it is seen to that numbers are
numbers, finite but where an infinite one is the default, and that objects are of their class.
"""

from __future__ import annotations

import functools
import inspect
import math
import os
import re
import sys
from collections.abc import Callable, Container, Mapping
from numbers import Integral, Real
from os import PathLike
from typing import Any, get_origin

import numpy as np
from mpi4py import MPI

from gossamer_fx.checks.errors import InputError

Test = tuple[Callable[[Any], bool], str]


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)


def _are_numbers(value: Any, count: int = 0) -> bool:
    if isinstance(value, str) or not np.iterable(value):
        return False
    try:
        numbers = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        return False
    return numbers.ndim == 1 and bool(np.isfinite(numbers).all()) and count in (0, len(numbers))


def _is_path(value: Any) -> bool:
    """Whether a word or path can be the name of a file: null characters cannot, nor what has no bytes."""
    try:
        return b"\0" not in os.fsencode(value)
    except (TypeError, UnicodeEncodeError):
        return False


_TESTS: dict[str, Test] = {
    "float": (_is_number, "a number"),
    "int": (lambda v: isinstance(v, Integral) and not isinstance(v, bool), "a whole number"),
    "bool": (lambda v: isinstance(v, bool | np.bool_), "True or False"),
    "str": (lambda v: isinstance(v, str), "a word"),
    "Path": (
        lambda v: isinstance(v, str | PathLike) and _is_path(v),
        "a path without null characters",
    ),
    "None": (lambda v: v is None, "None"),
    "tuple[float, float, float]": (lambda v: _are_numbers(v, 3), "three numbers"),
    "Vector": (lambda v: _are_numbers(v, 3), "three numbers"),
    "Sequence[float]": (_are_numbers, "numbers"),
    "tuple[int, ...]": (_are_numbers, "whole numbers"),
    "tuple[float, ...]": (_are_numbers, "numbers"),
    "npt.NDArray[np.float64]": (lambda v: isinstance(v, np.ndarray), "an array"),
    "Array": (lambda v: bool(np.iterable(v)) and not isinstance(v, str), "an array"),
    "MPI.Intracomm": (
        lambda v: isinstance(v, MPI.Intracomm),
        "a communicator, e.g. MPI.COMM_WORLD",
    ),
    # contracts
    "Stepper": (
        lambda v: hasattr(v, "start") and hasattr(v, "dt"),
        "a stepper, e.g. Midpoint(dt=1e-3)",
    ),
    "Output": (lambda v: hasattr(v, "record"), "an output, e.g. Ledger"),
    "Volume": (lambda v: hasattr(v, "gas"), "a chamber or tank"),
    "StressRule": (lambda v: hasattr(v, "alpha"), "a rule, e.g. PathAverage()"),
    "Joint": (
        lambda v: hasattr(v, "a") and hasattr(v, "b") and hasattr(v, "terms"),
        "a joint, e.g. BallJoint",
    ),
    "Ring": (lambda v: hasattr(v, "film") and hasattr(v, "edges"), "a Ring"),
    "State": (lambda v: hasattr(v, "system"), "a Simulation or an Equilibrium"),
    "Body": (lambda v: hasattr(v, "block"), "a body"),
    "MeshBody": (lambda v: hasattr(v, "block") and hasattr(v, "space"), "a body on a mesh"),
}


def guarded(thing: Any, public: Container[str] = ()) -> Any:
    """A public class or function that checks its arguments; a class is changed in place.

    Args:
        thing: a class or function.
        public: names of all public classes; an annotation may name one whose module is not loaded.

    Raises, when it is called:
        InputError: an argument that is missing, unknown, or of another kind than its annotation says.
    """
    if inspect.isclass(thing):
        init = thing.__dict__.get("__init__")
        if (
            init is not None
            and not issubclass(thing, BaseException)
            and not hasattr(init, "__wrapped__")
        ):
            thing.__init__ = _checking(init, thing.__name__, public)
        return thing
    return _checking(thing, thing.__name__, public) if inspect.isfunction(thing) else thing


def _checking(
    function: Callable[..., Any], name: str, public: Container[str]
) -> Callable[..., Any]:
    signature = inspect.signature(function)
    tests: dict[str, list[Test]] = {}

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        try:
            given = signature.bind(*args, **kwargs).arguments
        except TypeError as error:
            known = ", ".join(p for p in signature.parameters if p != "self") or "none"
            raise InputError(f"{name}: {error}; its arguments are: {known}.") from error
        try:
            result = function(*args, **kwargs)
        except InputError:
            raise
        except (TypeError, ValueError, AttributeError) as error:
            refuse(given, error)
            raise
        refuse(given, None)
        return result

    def refuse(given: Mapping[str, Any], cause: Exception | None) -> None:
        if not tests:
            tests.update(_tests(function, signature.parameters, public))
        for argument, value in given.items():
            allowed = tests.get(argument)
            if allowed and not any(test(value) for test, _ in allowed):
                words = " or ".join(words for _, words in allowed)
                raise InputError(f"{name}: {argument} is {_shown(value)}; give {words}.") from cause

    return call


def _tests(
    function: Callable[..., Any],
    parameters: Mapping[str, inspect.Parameter],
    public: Container[str],
) -> dict[str, list[Test]]:
    """What the annotations of a function allow; arguments with an annotation that is not understood allow all."""
    scope = vars(sys.modules[function.__module__]) if function.__module__ in sys.modules else {}
    found: dict[str, list[Test]] = {}
    for name, parameter in parameters.items():
        if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD) or name == "self":
            continue
        # alternatives that stand outside brackets
        kinds = re.split(r"\s*\|\s*(?![^\[]*\])", str(parameter.annotation))
        if "Path" in kinds:
            kinds = [kind for kind in kinds if kind != "str"]  # a word is tested as a path
        tests = [_test_of(kind, scope, public) for kind in kinds]
        if all(tests) and parameter.default != math.inf:
            found[name] = [test for test in tests if test is not None]
    return found


def _test_of(kind: str, scope: Mapping[str, Any], public: Container[str]) -> Test | None:
    """The test of one alternative of an annotation."""
    several = re.fullmatch(r"(?:tuple|Sequence)\[(\w+)(?:, \.\.\.)?\]", kind)
    if kind in _TESTS or not several:
        name = kind.split("[")[0]
        if name not in scope and name in public:  # not loaded where it is annotated only
            return (lambda v: any(c.__name__ == name for c in type(v).__mro__)), f"a {name}"
        return _TESTS.get(kind) or _of_class(scope.get(name))
    each = _test_of(several[1], scope, public)
    if each is None:
        return None
    one, words = each
    return (
        lambda v: bool(np.iterable(v)) and not isinstance(v, str) and all(map(one, v))
    ), f"several, each {words}"


def _of_class(kind: Any) -> Test | None:
    """Whether a value is of a class, or is called; none for a contract that is not written down as a class."""
    if kind is Callable or get_origin(kind) is Callable:
        return callable, "a function"
    if getattr(kind, "__module__", "") == "typing":
        return None
    if inspect.isclass(kind) and not getattr(kind, "_is_protocol", False):
        return (lambda value: isinstance(value, kind)), f"a {kind.__name__}"
    alternatives = getattr(kind, "__args__", ())
    if (
        kind is not None
        and alternatives
        and all(inspect.isclass(a) for a in alternatives)
        and "|" in str(kind)
    ):
        words = " or ".join(f"a {a.__name__}" for a in alternatives)
        return (lambda value: isinstance(value, alternatives)), words
    return None


def _shown(value: Any) -> str:
    text = repr(value)
    plain = "\n" not in text and len(text) <= 40 and " object at " not in text
    return text if plain else f"of the kind {type(value).__name__}"
