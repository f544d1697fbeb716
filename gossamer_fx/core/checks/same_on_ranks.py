"""Arguments of a call that all ranks make together are the same on all of them.

Otherwise ranks make different steps, say, and wait for each other's messages for ever, or each
computes a part of another scene.  One reduction compares a hash of all arguments; only where it
differs they are exchanged, to find which one it is.

Compared are numbers, words, truth values and lists of them, also those within objects of this
package.  Functions of the user are compared when they are called (`user_functions`).  Not compared
are paths, which may have different names on different machines, objects of other packages, and
large arrays, of which each rank may have its part.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from hashlib import blake2b
from numbers import Real
from types import FunctionType, MethodType
from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.checks.errors import InputError

# Numbers, or a word.
Value = tuple[float, ...] | str
# A label for messages, and what it stands for.
Entry = tuple[str, Value]

# Difference of numbers, relative to the largest one of a list, that counts as round-off.
SAME = 1e-9

# Numbers of the largest array that is compared: a matrix of inertia.
_MAX_ARRAY = 9


def refuse_differences(comm: MPI.Intracomm, what: str, arguments: Mapping[str, Any]) -> None:
    """Raise `InputError` on all ranks if an argument, by its name, differs between ranks by more
    than round-off; `what` begins the message.  Collective."""
    if comm.size == 1:
        return
    mine: list[Entry] = []
    known: set[int] = set()
    for name, value in arguments.items():
        mine += _entries(name, value, known)
    number = int.from_bytes(blake2b(repr(mine).encode(), digest_size=7).digest())
    extremes = np.array([number, -number])
    comm.Allreduce(MPI.IN_PLACE, extremes, op=MPI.MAX)
    if extremes[0] == -extremes[1]:
        return
    first, *others = [dict(entries) for entries in comm.allgather(mine)]
    for rank, other in enumerate(others, start=1):
        for label in first | other:
            here = first.get(label)
            there = other.get(label)
            if not _are_same(here, there):
                raise InputError(
                    f"{what}: {label} is {_shown(here)} on rank 0 and {_shown(there)} on rank "
                    f"{rank}; give all ranks the same."
                )


def given_arguments(thing: Any) -> dict[str, Any]:
    """The arguments with which an object was made, by name, as far as it has attributes of the same
    names, with or without an underscore."""
    if is_dataclass(thing):
        return {field.name: getattr(thing, field.name) for field in fields(thing)}
    # Objects with slots have no dictionary.
    attributes: dict[str, Any] = getattr(thing, "__dict__", {})
    found = {}
    for name in inspect.signature(type(thing)).parameters:
        for kept in (name, f"_{name}"):
            if kept in attributes:
                found[name] = attributes[kept]
                break
    return found


def is_of_package(value: Any) -> bool:
    """Whether a value is an object, not a class or function, of this package."""
    own = type(value).__module__.startswith("gossamer_fx.")
    return own and not isinstance(value, type | FunctionType | MethodType)


def _entries(label: str, value: Any, known: set[int]) -> Iterator[Entry]:
    """Numbers and words of a value with their labels; nothing of what is not compared.  Objects
    that are `known` by their numbers in memory are named only."""
    if value is None or isinstance(value, bool | np.bool_ | str):
        yield label, repr(value)
    elif isinstance(value, Real):
        yield label, (float(value),)
    elif isinstance(value, np.ndarray):
        # Whole numbers may be those of nodes or cells of the rank.
        if value.dtype.kind == "f" and value.size <= _MAX_ARRAY:
            yield label, tuple(float(one) for one in value.flat)
    elif isinstance(value, list | tuple):
        if value and all(isinstance(one, Real) for one in value):
            yield label, tuple(float(one) for one in value)
            return
        # An own output of the user may be on one rank alone, so that it is not counted.
        count = 0
        for one in value:
            entries = list(_entries(f"{label}[{count}]", one, known))
            count += bool(entries)
            yield from entries
    elif isinstance(value, Mapping):
        for key, one in value.items():
            yield from _entries(f"{label}[{key!r}]", one, known)
    elif is_of_package(value):
        yield from _of_object(label, value, known)


def _of_object(label: str, value: Any, known: set[int]) -> Iterator[Entry]:
    """Entries of an object of this package: its class, and the arguments that the user gave."""
    title = type(value).__name__
    name = getattr(value, "name", None)
    inner = f"{label}."
    if isinstance(name, str) and name:
        title = f"{title} '{name}'"
        inner = f"{title}: "
    yield label, title
    # Other objects than those whose arguments were checked are not made by users.
    is_public = hasattr(type(value).__init__, "__wrapped__")
    if not is_public or id(value) in known:
        return
    known.add(id(value))
    for argument, one in given_arguments(value).items():
        # Of a mesh each rank has its part.
        if argument == "mesh":
            continue
        yield from _entries(f"{inner}{argument}", one, known)
    # The arguments `every` and `times` of an output.
    if hasattr(value, "schedule"):
        for argument, one in vars(value.schedule).items():
            yield from _entries(f"{inner}{argument}", one, known)


def _are_same(a: Value | None, b: Value | None) -> bool:
    """Whether an argument has the same value on two ranks, but for round-off; None: it has none."""
    if not isinstance(a, tuple) or not isinstance(b, tuple):
        return a == b
    if len(a) != len(b):
        return False
    largest = max((abs(number) for number in (*a, *b)), default=0.0)
    return all(abs(p - q) <= SAME * largest for p, q in zip(a, b, strict=True))


def _shown(value: Value | None) -> str:
    """A value as a message shows it."""
    if value is None:
        return "not given"
    if isinstance(value, str):
        return value
    if len(value) == 1:
        return f"{value[0]:.12g}"
    return f"({', '.join(f'{number:.12g}' for number in value)})"
