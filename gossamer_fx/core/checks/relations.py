"""Relations between the arguments of one call, which `check_arguments` is given and checks.

A relation names arguments and says what has to hold between them; its function below makes the
sentence of the error.  An argument counts as given if it is neither None, nor empty, nor its
default.
"""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Sized
from numbers import Real
from os import PathLike
from typing import Any

import numpy as np

_MAX_SHOWN = 40  # characters of a value in a message


class Given:
    """The arguments of one call."""

    def __init__(self, bound: inspect.BoundArguments) -> None:
        self._bound = bound

    def __getitem__(self, argument: str) -> Any:
        """The value of an argument, also if it is the default."""
        default = self._bound.signature.parameters[argument].default
        if default is inspect.Parameter.empty:
            default = ()  # of *arguments
        return self._bound.arguments.get(argument, default)

    def is_default(self, argument: str) -> bool:
        """Whether an argument is left out, None, or its default."""
        value = self._bound.arguments.get(argument)
        default = self._bound.signature.parameters[argument].default
        if value is None or value is default:
            return True
        # Other objects may compare entries, or take long.
        if isinstance(default, str | Real):
            return isinstance(value, str | Real) and bool(value == default)
        return isinstance(default, tuple) and np.array_equal(value, default)

    def has(self, argument: str) -> bool:
        """Whether an argument is given."""
        if self.is_default(argument):
            return False
        value = self[argument]
        if isinstance(value, np.ndarray):
            return value.size > 0
        return not isinstance(value, Sized) or len(value) > 0

    def listed(self, arguments: tuple[str, ...], joint: str = " and ") -> str:
        """Arguments with their values, for a message."""
        return joint.join(f"{one} is {shown_value(self[one])}" for one in arguments)


class Relation:
    """What has to hold between some arguments of a call.

    `complaint` returns a clause that names the arguments, their values and the remedy; an empty
    one if the relation holds.
    """

    def __init__(self, arguments: tuple[str, ...], complaint: Callable[[Given], str]) -> None:
        self.arguments = frozenset(arguments)
        self.complaint = complaint


def exactly_one(*arguments: str) -> Relation:
    """One of the arguments has to be given, and no other of them."""

    def complaint(given: Given) -> str:
        if sum(map(given.has, arguments)) == 1:
            return ""
        return f"{given.listed(arguments)}; give one of them"

    return Relation(arguments, complaint)


def at_most_one(*arguments: str, give: str = "one of them") -> Relation:
    """Arguments that exclude each other; `give` is the remedy."""

    def complaint(given: Given) -> str:
        those = [one for one in arguments if given.has(one)]
        if len(those) < 2:
            return ""
        return f"{those[0]} and {those[1]} are both given; give {give}"

    return Relation(arguments, complaint)


def both_or_none(first: str, second: str) -> Relation:
    """Arguments that are given together."""

    def complaint(given: Given) -> str:
        if given.has(first) == given.has(second):
            return ""
        return f"{given.listed((first, second))}; give both or none"

    return Relation((first, second), complaint)


def only_with(argument: str, *others: str) -> Relation:
    """An argument that needs one of others."""

    def complaint(given: Given) -> str:
        if not given.has(argument) or any(map(given.has, others)):
            return ""
        names = " or ".join(others)
        return f"{argument} is given without {names}; give both, or leave {argument} out"

    return Relation((argument, *others), complaint)


def some(*arguments: str) -> Relation:
    """At least one of the arguments has to be given."""

    def complaint(given: Given) -> str:
        if any(map(given.has, arguments)):
            return ""
        return f"{given.listed(arguments)}; give one or more"

    return Relation(arguments, complaint)


def as_many(*arguments: str) -> Relation:
    """Lists that have the same number of entries, where they are given."""

    def complaint(given: Given) -> str:
        lists = {one: given[one] for one in arguments if not given.is_default(one)}
        # What is not a list is refused elsewhere.
        are_lists = all(
            isinstance(one, Sized) and bool(getattr(one, "ndim", True)) for one in lists.values()
        )
        counts = {name: len(one) for name, one in lists.items() if are_lists}
        if len(set(counts.values())) <= 1:
            return ""
        listing = " and ".join(f"{one} has {count}" for one, count in counts.items())
        return f"{listing} entries; give as many of each"

    return Relation(arguments, complaint)


def rising(low: str, high: str, give: str = "") -> Relation:
    """Numbers of which the second is not below the first, where both are given; `give` is the
    remedy, by default a larger second one."""

    def complaint(given: Given) -> str:
        if given[low] is None or given[high] is None or given[low] <= given[high]:
            return ""
        return f"{given.listed((low, high))}; give {give or f'a larger {high}'}"

    return Relation((low, high), complaint)


def below(low: str, high: str, give: str = "") -> Relation:
    """Numbers of which the first is less than the second, where both are given; `give` is the
    remedy, by default a larger second one."""

    def complaint(given: Given) -> str:
        if given[low] is None or given[high] is None or given[low] < given[high]:
            return ""
        return f"{given.listed((low, high))}; give {give or f'a larger {high}'}"

    return Relation((low, high), complaint)


def different(*pairs: tuple[str, str], give: str) -> Relation:
    """Pairs of arguments of which at least one has two different objects; `give` is the remedy."""
    arguments = tuple(argument for pair in pairs for argument in pair)

    def complaint(given: Given) -> str:
        if not all(given[a] is given[b] or _are_equal_names(given[a], given[b]) for a, b in pairs):
            return ""
        listing = ", ".join(f"{a} and {b}" for a, b in pairs)
        return f"{listing} are the same; give {give}"

    return Relation(arguments, complaint)


def _are_equal_names(first: object, second: object) -> bool:
    return isinstance(first, str) and isinstance(second, str) and first == second


def each_once(argument: str) -> Relation:
    """Any number of objects, none of them twice."""

    def complaint(given: Given) -> str:
        values = given[argument]
        for k, value in enumerate(values):
            if any(value is other for other in values[:k]):
                return f"'{getattr(value, 'name', value)}' is given twice; give it once"
        return ""

    return Relation((argument,), complaint)


def shown_value(value: Any) -> str:
    """A value as a message shows it: itself if that is short, else its class."""
    text = repr(value)
    # The end of a path is the name of the file.
    if isinstance(value, str | PathLike) and len(text) > _MAX_SHOWN:
        return f"'...{os.fspath(value)[-_MAX_SHOWN:]}'"
    # Objects show in angle brackets what they contain, which is not what is wrong with them.
    is_object = text.startswith("<")
    if "\n" in text or len(text) > _MAX_SHOWN or is_object or " object at " in text:
        return f"of the kind {type(value).__name__}"
    return text
