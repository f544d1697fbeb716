"""The arguments of public classes and functions are of the types in their annotations.

`check_arguments` is put on a class or function where it is defined, so that the check is the same
by every import path and comes before the function does anything.  It refuses, in one sentence,
arguments that are missing or unknown, and values of another type, infinite numbers and NaN
included, and numbers so large or small that their powers overflow.  Marks limit numbers
(`Annotated[float, positive("m")]`) and count entries (`Count`).  What values mean beyond that is
checked by those who take them.

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
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from numbers import Integral, Real
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar, Union, get_args, get_origin, overload

import numpy as np
import numpy.typing as npt

from gossamer_fx.core.checks.errors import (
    LARGEST,
    LARGEST_COUNT,
    SMALLEST,
    InputError,
    are_usual_sizes,
    real_numbers,
)
from gossamer_fx.core.checks.relations import Given, Relation, shown_value
from gossamer_fx.core.checks.same_on_ranks import refuse_differences

# What messages ask for in place of the name of a class.
_DESCRIPTIONS = {
    "Intracomm": "a communicator, e.g. MPI.COMM_WORLD",
    "Body": "a body",
    "MeshBody": "a body on a mesh",
    "Meshed": "a body on a mesh",
    "Curve": "a cable or beam",
    "DrawnAsLines": "a Spring, Rope, RopeBundle, Tether or Tape",
    "Stepper": "a stepper, e.g. Midpoint(dt=1e-3), or an own one, derived from extend.Stepper",
    "Output": "an output, e.g. Ledger, or an own one, derived from extend.Output",
    "StressRule": "a stress rule, e.g. PathAverage()",
    "Joint": "a joint, e.g. BallJoint",
    "State": "a Simulation or an Equilibrium",
    "Item": "items of a scene: bodies, gas, loads, constraints or connectors; an obstacle belongs "
    "to a Contact, an actuator to a Feedback, an event to a Simulation, and an own item is derived "
    "from gossamer_fx.extend.Item",
    "Gas": "a gas, e.g. IdealGas(gamma=1.4, R=287.0)",
    "Holder": "gas of constant pressure",
    "Volume": "a chamber or tank",
    "Event": "an At or a When",
    "Objective": "a result with derivatives, e.g. a Position, EnclosedVolume(film) or Energy()",
    "Shapes": "a recording of shapes, e.g. Snapshots",
    "FilmLaw": "a law of films, e.g. Miyazaki",
    "IsotropicFilm": "a law of isotropic films, e.g. Miyazaki",
    "Obstacle": "an obstacle, e.g. a Plane",
    "System": "the system of an Equilibrium or a Simulation, or scene.compile()",
    "Enclosure": "a Piston",
}
# What is said of a call, by the names of the callee and of the kind of its first argument, where
# another callee takes that argument.
_OTHER_CALLEES = {
    ("Case", "Equilibrium"): "an Equilibrium is at rest and has neither a stepper nor an end; give "
    "it to gossamer_fx.analysis.StaticCase instead",
}
_COUNTS = {1: "one", 2: "two", 3: "three", 4: "four"}
_CALLABLE: Any = Callable  # compared with the origin of an annotation
# Bytes of a path and of a name in it that file systems take.
MAX_PATH = 4095
MAX_FILE_NAME = 255
# First arguments of methods, which no user gives.
RECEIVERS = frozenset({"self", "cls"})
# Arguments that may differ between ranks: only rank 0 prints.
_NOT_COMPARED = RECEIVERS | {"progress"}


class Mark:
    """Mark of an annotated value for which `holds` is true.

    `sentence` is what messages ask for, where {kind} stands for the words of the type, and `flaw`
    says more about a value that is refused.
    """

    unit: ClassVar[str] = ""

    def __init__(
        self,
        holds: Callable[[Any], bool],
        sentence: str,
        flaw: Callable[[Any], str] = lambda value: "",
    ) -> None:
        self.contains = holds
        self.flaw = flaw
        self._sentence = sentence

    def __repr__(self) -> str:
        return f"Mark({self._sentence!r})"

    def words(self, kind: str) -> str:
        """What messages ask for, of a kind, e.g. "a list of numbers"."""
        return self._sentence.format(kind=kind)


@dataclass(frozen=True)
class Range:
    """Mark of an annotated number from `low` to `high`; `low` itself is excluded if `above`, `high`
    if `below`.

    The unit is that of the number in messages.
    """

    low: float
    high: float = math.inf
    unit: str = ""
    above: bool = False
    below: bool = False

    def contains(self, number: float) -> bool:
        """Whether a number is in the range; NaN is not."""
        is_above = number > self.low if self.above else number >= self.low
        is_below = number < self.high if self.below else number <= self.high
        return bool(is_above and is_below)

    def words(self, kind: str) -> str:
        """What messages ask for, of a kind: "a number" or "a whole number"."""
        if self.high < math.inf:
            joint = "between {} and {}"
            if self.above or self.below:
                joint = "above {}" if self.above else "from {}"
                joint += " and below {}" if self.below else " and up to {}"
            return f"{kind} {joint.format(f'{self.low:g}', f'{self.high:g}')}"
        if kind == "a number" and self.low == 0:
            return "a positive number" if self.above else "zero or a positive number"
        return f"{kind} {'above' if self.above else 'of at least'} {self.low:g}"

    def check(self, what: str, number: float) -> None:
        """Raise `InputError` unless a number is in the range: one that a user's function has
        returned, or that is not an argument.  The message begins with `what`."""
        if not (math.isfinite(number) and self.contains(number)):
            unit = f" {self.unit}" if self.unit else ""
            raise InputError(f"{what} is {number!r}{unit}; give {self.words('a number')}.")


def positive(unit: str = "") -> Range:
    """Mark of an annotated number above zero."""
    return Range(0.0, unit=unit, above=True)


def not_negative(unit: str = "") -> Range:
    """Mark of an annotated number that is zero or above."""
    return Range(0.0, unit=unit)


def _numbers(count: int) -> str:
    """So many numbers, in words."""
    return f"{_COUNTS.get(count, count)} numbers"


def Count(entries: int) -> Mark:
    """Mark of an annotated sequence of numbers that has this number of entries."""
    return Mark(lambda value: len(value) == entries, _numbers(entries))


def at_least(entries: int) -> Mark:
    """Mark of an annotated list or mapping that has this number of entries or more."""
    words = "{kind}, with " + f"{_COUNTS.get(entries, entries)} or more entries"
    return Mark(
        lambda value: len(value) >= entries, words, lambda value: f", of length {len(value)}"
    )


def ends_in(*endings: str) -> Mark:
    """Mark of an annotated path whose name ends in one of these, e.g. ".png"."""
    words = f"a name that ends in {' or '.join(endings)}"
    return Mark(lambda path: Path(os.fspath(path)).suffix.lower() in endings, words)


def _each(fits: Callable[[Any], Any], sentence: str) -> Mark:
    """Mark of an annotated list whose entries all fit: `fits` returns a truth value for each entry,
    or for each but the first.  Messages name the first entry that does not."""

    def flaw(value: Any) -> str:
        each = np.atleast_1d(fits(np.asarray(value)))
        number = int(np.argmin(each)) + 1 + (np.size(value) - len(each))
        return f", whose number {number} does not fit"

    return Mark(lambda value: bool(np.all(fits(np.asarray(value)))), sentence, flaw)


NOT_ZERO = Mark(lambda value: bool(np.any(value)), "{kind}, not all zero")
POSITIVE = _each(lambda value: value > 0, "{kind}, all of them positive")
NOT_NEGATIVE = _each(lambda value: value >= 0, "{kind}, none of them negative")
RISING = _each(lambda value: np.diff(value) > 0, "{kind}, in rising order")
NOT_FALLING = _each(lambda value: np.diff(value) >= 0, "{kind}, which do not fall")
DISTINCT = Mark(lambda value: len(set(value)) == len(value), "{kind}, all of them different")
SAME_LENGTH = Mark(
    lambda columns: len(columns[0]) == len(columns[1]),
    "two columns of equal length, of two or more rising numbers and of numbers that do not fall",
)
FLAT = Mark(lambda value: np.ndim(value) == 1, "a list of numbers")
# The lowest and the highest of some frequencies [Hz].
Band = Annotated[Sequence[Annotated[float, positive("Hz")]], Count(2), RISING]
# A column of numbers, and two of a curve.
Column = Annotated[Sequence[float] | npt.NDArray[np.floating], FLAT]
Curve = Annotated[
    tuple[Annotated[Column, at_least(2), RISING], Annotated[Column, NOT_FALLING]], SAME_LENGTH
]
# A vector whose length does not count.
Direction = Annotated[Sequence[float], Count(3), NOT_ZERO]


@dataclass(frozen=True)
class Kind:
    """What an annotation allows: a test of values, and the words of a message that asks for one,
    with the unit of the values."""

    accepts: Callable[[Any], bool]
    words: str
    unit: str = ""
    # What is wrong with a value, if more can be said than that it is.
    flaw: Callable[[Any], str] = lambda value: ""


@overload
def check_arguments[T: Callable[..., Any]](thing: T, /) -> T: ...


@overload
def check_arguments[T: Callable[..., Any]](*relations: Relation) -> Callable[[T], T]: ...


def check_arguments(*given: Any) -> Any:
    """Let a class or function check its arguments when it is called, before it acts; a decorator.

    Of a class the arguments of its constructor are checked, and the run that its objects are called
    with, if they are probes.  A subclass with another constructor needs the decorator, too.  All
    arguments have annotations.  One that is missing, unknown, or not of the type and in the range
    of its annotation raises `InputError`.  So do arguments that do not fit together by the given
    relations, which subclasses with the same arguments inherit.

    Example:
        >>> from gossamer_fx.core.checks.arguments import check_arguments
        >>> from gossamer_fx.core.checks.relations import at_most_one
        >>> @check_arguments(at_most_one("R", "d"))
        ... def rod(length: float, R: float | None = None, d: float | None = None) -> None: ...
        >>> rod("long")
        Traceback (most recent call last):
        gossamer_fx.core.checks.errors.InputError: rod: length is 'long'; give a number.
        >>> rod(1.0, R=0.1, d=0.2)
        Traceback (most recent call last):
        gossamer_fx.core.checks.errors.InputError: rod: R and d are both given; give one of them.
    """
    if given and not isinstance(given[0], Relation):
        return _decorated(given[0], ())
    return lambda thing: _decorated(thing, given)


def _decorated(thing: Any, relations: tuple[Relation, ...]) -> Any:
    """A class or function that checks its arguments."""
    if not isinstance(thing, type):
        return _checking(thing, relations=relations)
    checked: Any = thing
    checked.argument_relations = (*getattr(thing, "argument_relations", ()), *relations)
    checked.__init__ = _checking(checked.__init__, thing, relations=checked.argument_relations)
    call = next(
        (vars(base)["__call__"] for base in thing.__mro__ if "__call__" in vars(base)), None
    )
    if call is not None and "run" in call.__annotations__:
        checked.__call__ = _reading_a_run(call)
    return thing


def collective[T: Callable[..., Any]](function: T) -> T:
    """Let `check_arguments` refuse arguments that differ between ranks, of a function that all
    ranks call together; a decorator.  Their communicator is the `comm` of the object whose method
    it is, or of the first argument that has one."""
    function.is_collective = True  # type: ignore[attr-defined]
    return function


def _checking(
    function: Callable[..., Any], owner: type | None = None, *, relations: tuple[Relation, ...]
) -> Callable[..., Any]:
    """Wrap a function, or the constructor of the class `owner`, so that a call whose arguments are
    missing, unknown, not of the types in its signature or not in the relations raises `InputError`,
    with one sentence that names the argument, its value and what to give.  Defaults are not
    checked."""

    # Signature and annotations are looked at in the first call: most of the classes that a scene
    # imports are never called, and an annotation may name a class that is defined further below.
    @functools.cache
    def signature() -> inspect.Signature:
        return inspect.signature(function)

    @functools.cache
    def kind(argument: str) -> Kind | None:
        return kind_of(resolved(function, argument, owner))

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        name = function.__name__
        if name == "__init__":
            name = type(args[0]).__name__
        elif next(iter(signature().parameters), "") == "self":
            name = f"{type(args[0]).__name__}.{name}"
        # After what is received comes the first argument, with its name or without.
        first = next((type(one).__name__ for one in (*args[1:], *kwargs.values())), "")
        if (name, first) in _OTHER_CALLEES:
            raise InputError(f"{name}: {_OTHER_CALLEES[name, first]}.")
        try:
            bound = signature().bind(*args, **kwargs)
        except TypeError as error:
            message = _wrong_call(signature(), args, kwargs, error)
            raise InputError(f"{name}: {message}.") from None
        given = bound.arguments
        # Items of a scene have names, which tell which of several is meant.
        if isinstance(given.get("name"), str):
            name = f"{name} '{given['name']}'"
        for argument, value in given.items():
            if argument in RECEIVERS:
                continue
            # A later change of the array would change what is made of it.
            if isinstance(value, np.ndarray):
                given[argument] = value.copy()
            parameter = signature().parameters[argument]
            # A default needs no check, and no import of what its annotation names.
            if value is parameter.default:
                continue
            for label, one in _labelled(parameter, value):
                allowed = kind(argument)
                if allowed is None or allowed.accepts(one):
                    continue
                # Infinity is a value where it is the default, e.g. for "without limit".
                if parameter.default is math.inf and _is_infinite(one):
                    continue
                unit = f" {allowed.unit}" if allowed.unit and isinstance(one, Real) else ""
                raise InputError(
                    f"{name}: {label} is {shown_value(one)}{unit}{allowed.flaw(one)}; "
                    f"give {allowed.words}{_size(one)}."
                )
        for relation in relations:
            # A constructor may have other arguments than that of the base with the relation.
            if signature().parameters.keys() >= relation.arguments:
                complaint = relation.complaint(Given(bound))
                if complaint:
                    raise InputError(f"{name}: {complaint}.")
        if getattr(function, "is_collective", False):
            comm = next(value.comm for value in given.values() if hasattr(value, "comm"))
            values = {key: one for key, one in given.items() if key not in _NOT_COMPARED}
            refuse_differences(comm, name, values)
        return function(*bound.args, **bound.kwargs)

    return call


def _reading_a_run(probe: Callable[[Any, Any], float]) -> Callable[[Any, Any], float]:
    """Wrap the call of a probe, which users may make by themselves, so that it refuses what is not
    a run or an equilibrium."""

    @functools.wraps(probe)
    def call(self: Any, run: Any) -> float:
        if not hasattr(run, "system"):
            raise InputError(
                f"{type(self).__name__}: run is {shown_value(run)}; give {_DESCRIPTIONS['State']}."
            )
        return probe(self, run)

    return call


def _labelled(parameter: inspect.Parameter, value: Any) -> list[tuple[str, Any]]:
    """Values that were given for a parameter, and what a message calls each of them."""
    if parameter.kind is parameter.VAR_KEYWORD:
        return list(value.items())
    if parameter.kind is parameter.VAR_POSITIONAL:
        return [(f"{parameter.name}[{k}]", one) for k, one in enumerate(value)]
    return [(parameter.name, value)]


def _wrong_call(
    signature: inspect.Signature, args: tuple[Any, ...], kwargs: dict[str, Any], error: TypeError
) -> str:
    """Explain in one clause of a message why arguments do not fit a signature: unknown names first,
    then too many positional arguments, then missing ones."""
    parameters = [p for p in signature.parameters.values() if p.name not in RECEIVERS]
    names = [parameter.name for parameter in parameters]
    known = f"its arguments are: {', '.join(names) or 'none'}"
    unknown = [argument for argument in kwargs if argument not in names]
    if unknown:
        return f"there is no argument {unknown[0]!r}; {known}"
    positional = [
        parameter.name
        for parameter in parameters
        if parameter.kind in (parameter.POSITIONAL_ONLY, parameter.POSITIONAL_OR_KEYWORD)
    ]
    given = len(args)
    if not RECEIVERS.isdisjoint(signature.parameters):
        given -= 1
    takes_any_number = any(p.kind is p.VAR_POSITIONAL for p in parameters)
    if given > len(positional) and not takes_any_number:
        limit = "in all cases"
        if positional:
            limit = f"after {positional[-1]!r}"
        return f"{given} arguments are given without a name; give names {limit}; {known}"
    for parameter in parameters:
        needed = parameter.default is parameter.empty
        needed = needed and parameter.kind is not parameter.VAR_POSITIONAL
        if needed and parameter.name not in kwargs and parameter.name not in positional[:given]:
            return f"the argument {parameter.name!r} is missing; {known}"
    # e.g. an argument that is given twice, for which Python has a sentence
    return f"{error}; {known}"


# ---- annotations -------------------------------------------------------------------------------


def resolved(function: Callable[..., Any], argument: str, owner: type | None = None) -> Any:
    """The annotation of an argument of a function, or of the constructor of the class `owner`, as a
    type.  Where a module imports `annotations` from `__future__` it is text; names that the module
    imports for type checkers only are imported now."""
    annotation = inspect.signature(function).parameters[argument].annotation
    if not isinstance(annotation, str):
        return annotation
    module = _module_of(function, argument, owner)
    return eval(annotation, vars(module), _TypeCheckingNames(module))


def _module_of(function: Callable[..., Any], argument: str, owner: type | None) -> types.ModuleType:
    """The module in which the annotation of an argument was written: that of the function, but for
    the constructor of a dataclass, the `owner` or else the class of its name, which takes fields,
    with their annotations, from base classes of other modules."""
    module = sys.modules[function.__module__]
    # A program that another one executes has its classes in no module.
    owner = owner or vars(module).get(function.__qualname__.split(".")[0])
    is_constructor = function.__name__ == "__init__"
    if is_constructor and isinstance(owner, type) and "__dataclass_params__" in vars(owner):
        for base in owner.__mro__:
            if argument in inspect.get_annotations(base):
                return sys.modules[base.__module__]
    return module


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
        raise KeyError(name)  # `eval` then asks the global and the built-in names


@functools.cache
def _type_checking_imports(module: str) -> dict[str, tuple[str, str]]:
    """Module and original name, by local name, of each import under `if TYPE_CHECKING` of a
    module."""
    found: dict[str, tuple[str, str]] = {}
    try:
        source = inspect.getsource(sys.modules[module])
    except (OSError, TypeError):
        # A session without a file, e.g. a notebook, has no such imports.
        return found
    for node in ast.parse(source).body:
        if not (isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"):
            continue
        for statement in node.body:
            if isinstance(statement, ast.ImportFrom) and statement.module:
                for alias in statement.names:
                    found[alias.asname or alias.name] = (statement.module, alias.name)
    return found


def kind_of(hint: Any) -> Kind | None:
    """The test of values that an annotated type allows, with the words by which a message asks for
    them; None if the type allows all values.  A type that cannot be tested, e.g. a protocol that is
    not `runtime_checkable`, raises `TypeError`, here and in the functions below."""
    if hint is Any or hint is object or isinstance(hint, TypeVar):
        return None
    # Before other aliases: newer versions of NumPy define it as an alias of a union of protocols,
    # which says less than "numbers".
    if hint is npt.ArrayLike:
        return Kind(_is_numeric, "numbers")
    if isinstance(hint, typing.TypeAliasType):
        return kind_of(hint.__value__)
    if hint in _SIMPLE:
        return _SIMPLE[hint]
    origin = get_origin(hint)
    arguments = get_args(hint)
    if isinstance(origin, typing.TypeAliasType):  # e.g. NDArray[int32] of newer versions of NumPy
        return kind_of(origin.__value__[arguments])
    if origin is Annotated:
        return _annotated(arguments[0], arguments[1:])
    if origin in (Union, types.UnionType):
        return _union(arguments)
    if origin is typing.Literal:
        words = " or ".join(repr(value) for value in arguments)
        return Kind(lambda value: isinstance(value, str | Integral) and value in arguments, words)
    if origin is tuple and arguments[-1] is not Ellipsis:
        return _tuple(arguments)
    if origin is not None and inspect.isclass(origin):
        return _generic(origin, arguments)
    if inspect.isclass(hint):
        return _class(hint)
    raise TypeError(f"{hint!r} is not a type that arguments can be tested for")


def _annotated(hint: Any, marks: Iterable[Any]) -> Kind | None:
    """The test of values of an `Annotated` type, which marks may limit."""
    kind = kind_of(hint)
    for mark in marks:
        if kind is not None and isinstance(mark, Mark | Range):
            kind = _marked(kind, mark)
    return kind


def _marked(kind: Kind, mark: Mark | Range) -> Kind:
    """The test of a kind, limited by a mark as well."""

    def flaw(value: Any) -> str:
        if isinstance(mark, Mark) and kind.accepts(value) and not mark.contains(value):
            return mark.flaw(value)
        return kind.flaw(value)

    return Kind(
        lambda value: kind.accepts(value) and mark.contains(value),
        mark.words(kind.words),
        mark.unit,
        flaw,
    )


def _union(alternatives: Iterable[Any]) -> Kind | None:
    """The test of values of a union of types: what one of them accepts; None if one allows all
    values."""
    hints = list(alternatives)
    if Path in hints:
        # A word is tested as a path, which is stricter.
        hints = [hint for hint in hints if hint is not str]
    kinds = []
    for hint in hints:
        kind = kind_of(hint)
        if kind is None:
            return None
        kinds.append(kind)
    words = " or ".join(dict.fromkeys(kind.words for kind in kinds))
    unit = next((kind.unit for kind in kinds if kind.unit), "")
    return Kind(
        lambda value: any(kind.accepts(value) for kind in kinds),
        words,
        unit,
        lambda value: next(filter(None, (kind.flaw(value) for kind in kinds)), ""),
    )


def _tuple(hints: tuple[Any, ...]) -> Kind:
    """The test of a collection of fixed length, with a type for each entry."""
    kinds = [kind_of(hint) for hint in hints]
    if all(hint is float for hint in hints):
        # Components may be tiny: next to the others they vanish.
        kinds = [Kind(_is_component, "a number") for _ in hints]

    def accepts(value: Any) -> bool:
        if not _is_collection(value) or len(value) != len(kinds):
            return False
        pairs = zip(kinds, value, strict=True)
        return all(kind is None or kind.accepts(one) for kind, one in pairs)

    def flaw(value: Any) -> str:
        if not _is_collection(value):
            return ""
        pairs = zip(kinds, value, strict=False)
        return next((k.flaw(one) for k, one in pairs if k is not None and not k.accepts(one)), "")

    if all(hint is float for hint in hints):
        return Kind(accepts, _numbers(len(kinds)))
    each = [kind.words for kind in kinds if kind is not None]
    if all(get_origin(hint) is Annotated and get_args(hint)[0] is float for hint in hints):
        return Kind(accepts, f"{_numbers(len(kinds))}, each {' and '.join(dict.fromkeys(each))}")
    return Kind(accepts, f"a tuple of {' and '.join(each)}", flaw=flaw)


def _generic(origin: type, arguments: tuple[Any, ...]) -> Kind | None:
    """The test of values of a class with type arguments, e.g. `Sequence[float]`; the types in the
    brackets of functions and arrays are not tested."""
    if origin is _CALLABLE:
        return Kind(callable, "a function")
    if issubclass(origin, np.ndarray):
        return Kind(lambda value: isinstance(value, np.ndarray), "an array")
    if issubclass(origin, Mapping):
        return _mapping(arguments[0], arguments[1])
    if issubclass(origin, type):
        names = " or ".join(one.__name__ for one in get_args(arguments[0]) or arguments)
        return Kind(
            lambda value: isinstance(value, type) and issubclass(value, arguments[0]),
            f"a kind of {names}",
        )
    if issubclass(origin, Collection):
        return _collection(arguments[0])
    return _class(origin)


def _mapping(key: Any, value: Any) -> Kind:
    """The test of a mapping whose keys and values are of annotated types."""
    keys = kind_of(key)
    values = kind_of(value)

    def accepts(given: Any) -> bool:
        if not isinstance(given, Mapping):
            return False
        if keys is not None and not all(map(keys.accepts, given)):
            return False
        return values is None or all(map(values.accepts, given.values()))

    def flaw(given: Any) -> str:
        if values is None or not isinstance(given, Mapping):
            return ""
        wrong = next((key for key, one in given.items() if not values.accepts(one)), None)
        return "" if wrong is None else f", where {wrong!r} is {shown_value(given[wrong])}"

    words = "a dict"
    if values is not None:
        words += f" whose values are each {values.words}"
    return Kind(accepts, words, flaw=flaw)


def _collection(entry: Any) -> Kind:
    """The test of a list, tuple, set or array of any length."""
    if entry is float:
        return Kind(_are_numbers, "a list of numbers")
    if entry is int:
        return Kind(_are_whole_numbers, "a list of whole numbers")
    kind = kind_of(entry)
    if kind is None:
        return Kind(_is_collection, "a list")
    return Kind(
        lambda value: _is_collection(value) and all(map(kind.accepts, value)),
        f"a list whose entries are each {kind.words}",
    )


def _class(hint: type) -> Kind:
    """The test of instances of a class, or of a protocol that can be checked at run time."""
    is_protocol = getattr(hint, "_is_protocol", False)
    if is_protocol and not getattr(hint, "_is_runtime_protocol", False):
        raise TypeError(f"the protocol {hint.__name__} is not runtime_checkable")
    article = "a"
    if hint.__name__[0] in "AEIOU":
        article = "an"
    words = _DESCRIPTIONS.get(hint.__name__, f"{article} {hint.__name__}")
    # A class has the methods of its instances, and so counts as an instance of a protocol.
    return Kind(
        lambda value: isinstance(value, hint) and not (is_protocol and isinstance(value, type)),
        words,
    )


# ---- values ------------------------------------------------------------------------------------


def _is_number(value: Any) -> bool:
    """Whether a value is a finite number; True and False, which Python counts as numbers, are
    not."""
    if not isinstance(value, Real) or isinstance(value, bool):
        return False
    number = real_numbers(value)
    return number is not None and are_usual_sizes(number)


def _is_component(value: Any) -> bool:
    """Whether a value is a finite number that may be one of several components."""
    if not isinstance(value, Real) or isinstance(value, bool):
        return False
    number = real_numbers([value])
    return number is not None and are_usual_sizes(number)


def _is_whole_number(value: Any) -> bool:
    """Whether a value is an integer of 64 bits; True and False are not."""
    if not isinstance(value, Integral) or isinstance(value, bool):
        return False
    return abs(int(value)) <= LARGEST_COUNT


def _is_collection(value: Any) -> bool:
    """Whether a value has entries and a length; a word, which has both, is one value."""
    return isinstance(value, Collection) and not isinstance(value, str | bytes | Mapping)


def _is_infinite(value: Any) -> bool:
    """Whether a value is plus infinity."""
    return isinstance(value, Real) and value == math.inf


def _size(value: Any) -> str:
    """Clause of a message about the size that numbers may have; empty if size is not what is
    wrong."""
    numbers = real_numbers(value)
    if isinstance(value, bool) or numbers is None or not np.isfinite(numbers).all():
        # A whole number beyond all floats cannot be an array.
        if not isinstance(value, Integral):
            return ""
    elif are_usual_sizes(numbers):
        return ""
    return f" of a size between {SMALLEST:g} and {LARGEST:g}, or zero"


def _are_numbers(value: Any) -> bool:
    """Whether a value is a list, tuple or array (n,) of finite numbers."""
    if not _is_collection(value):
        return False
    return _is_numeric(value) and np.ndim(value) == 1


def _are_whole_numbers(value: Any) -> bool:
    """Whether a value is a list, tuple, set or array (n,) of integers."""
    return _is_collection(value) and all(map(_is_whole_number, value))


def _is_numeric(value: Any) -> bool:
    """Whether NumPy makes an array of finite numbers, of any shape, of a value."""
    numbers = real_numbers(value)
    return numbers is not None and are_usual_sizes(numbers)


def _is_path(value: Any) -> bool:
    """Whether a value can be the name of a file: null characters cannot, nor what has no bytes or
    too many for a file system."""
    if not isinstance(value, str | PathLike):
        return False
    try:
        path = os.fsencode(value)
        names = path.split(os.fsencode(os.sep))
        is_short = len(path) <= MAX_PATH and max(map(len, names)) <= MAX_FILE_NAME
        return b"\0" not in path and is_short
    except (TypeError, UnicodeEncodeError):
        return False


_SIMPLE: dict[Any, Kind] = {
    float: Kind(_is_number, "a number"),
    int: Kind(_is_whole_number, "a whole number"),
    bool: Kind(lambda value: isinstance(value, bool | np.bool_), "True or False"),
    str: Kind(lambda value: isinstance(value, str), "a word"),
    Path: Kind(_is_path, "a path without null characters and of names up to 255 bytes"),
    None: Kind(lambda value: value is None, "None"),
    type(None): Kind(lambda value: value is None, "None"),
    typing.IO[str]: Kind(lambda value: hasattr(value, "write"), "an open file"),
    Callable: Kind(callable, "a function"),
}
