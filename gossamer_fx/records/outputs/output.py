"""What all outputs share: their protocol, schedules, the guard of other runs' files, the evaluation
of probes, and the arguments of a scene's items as data.

`begin` opens an output, or lets it continue at its position in a checkpoint.  `describe` turns
arguments into data, which recordings and checkpoints store and a restart compares:

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
import math
import os
import tokenize
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, is_dataclass
from numbers import Integral, Real
from pathlib import Path
from types import FunctionType, MethodType, ModuleType
from typing import Annotated, Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.checks.arguments import Range, not_negative
from gossamer_fx.core.checks.errors import (
    InputError,
    NotFoundYet,
    check,
    on_rank_zero,
    output_failures,
)
from gossamer_fx.core.checks.same_on_ranks import given_arguments, is_of_package
from gossamer_fx.core.checks.strange_files import open_to_write, write_new
from gossamer_fx.core.checks.user_functions import ask_numbers
from gossamer_fx.core.model.body import Ground, Port
from gossamer_fx.core.model.state import InitialCondition
from gossamer_fx.solve.view import StateView

# A value for JSON: None, bool, int, float, str, and lists and dictionaries of them.
Known = Any

# Keys of numbers that are computed from a mesh, and of their tolerance.
MEASURED = "measured"
TOLERANCE = "tolerance"

# Arguments that are left out: names are the keys of items, meshes are compared by their cells, and
# the communicator may differ.
_NOT_COMPARED = ("name", "comm", "mesh")

# Levels of objects in objects, and of functions that use functions: some refer to each other in a
# circle.
_MAX_DEPTH = 6

# Numbers of an array that is stored: larger ones would make the file long.
_MAX_ARRAY = 1000

# Hexadecimal digits of the hash of a function's source.
_HASH_DIGITS = 16

# Error of an attached point over the largest coordinate of its body: points on cells are
# interpolated.
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
    """The arguments of an item of a scene, by name, and its public attributes that are plain data,
    see `_is_plain`.  Collective.
    """
    return _attributes(item, functools.partial(describe, items=tuple(items), depth=1))


def describe(value: Any, items: Iterable[Any] = (), depth: int = 0) -> Known:
    """Convert a value to data for JSON, the same on every rank.

    Numbers and words are returned as they are, items of the scene as "Class 'name'", objects of
    this package by their arguments, functions by what their code contains.  Only the name of the
    class is returned of what cannot be converted, of arrays with more than `_MAX_ARRAY` numbers,
    and of objects and functions at the depth `_MAX_DEPTH`.  Collective, as positions of attached
    points are sums over all ranks.

    Args:
        items: of the scene.
        depth: number of objects and collections around the value.
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
        if is_of_package(value) or is_dataclass(value):
            return {"class": type(value).__name__, **_attributes(value, inner)}
        if callable(value) and not isinstance(value, type):
            return _of_function(value, inner)
    return type(value).__name__


# ---- objects -------------------------------------------------------------------------------------


def _attributes(thing: Any, inner: Callable[[Any], Known]) -> dict[str, Known]:
    """The arguments with which an object was made, see `given_arguments`, and its other public
    attributes that are plain; `inner` converts each."""
    found = {name: inner(value) for name, value in given_arguments(thing).items()}
    # Objects with slots have no dictionary.
    for name, value in getattr(thing, "__dict__", {}).items():
        if not name.startswith("_") and name not in found and _is_plain(value):
            found[name] = inner(value)
    return {name: value for name, value in found.items() if name not in _NOT_COMPARED}


def _is_plain(value: Any) -> bool:
    """Whether an attribute is a number, a word, or a list of these and of objects of this package,
    e.g. obstacles; anything else may have been computed from a mesh."""
    if isinstance(value, list | tuple):
        return all(_is_plain(one) or is_of_package(one) for one in value)
    return value is None or isinstance(value, bool | str | Real)


def _of_port(port: Port) -> Known:
    """Data about a vector attached to a body, for the comparison with a later run.  Collective.

    The numbers of its nodes are not stored, since they differ between runs; its initial value is,
    (3,) [m] or [-], with a tolerance [m].
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
    values that it takes from its surroundings, each converted by `inner`.

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
    taken = dict(read.nonlocals)
    # What a function of this package reads in its module is known by the version; it may be another
    # number in each process, e.g. that of an attribute of MPI.
    if not (function.__module__ or "").startswith("gossamer_fx."):
        taken = {**read.globals, **taken}
    for outside, value in taken.items():
        # Modules and classes are known by their names, and the communicator may differ.
        if isinstance(value, ModuleType | type | MPI.Comm):
            continue
        is_constant = isinstance(value, bool | str | Real | tuple | FunctionType) or value is None
        # A list, an array or an object may change during the run.
        known["outside"][outside] = inner(value) if is_constant else type(value).__name__
    return known


# ---- the protocol of outputs ---------------------------------------------------------------------


Probe = Callable[[StateView], float]

# Steps between two records, and times of records [s].
Every = Annotated[int, Range(1)]
Times = Sequence[Annotated[float, not_negative("s")]]

# Files and folders of a recorded run, see `Recording`.
RUN_FILES = (
    "run.json",
    "ledger.csv",
    "gas.csv",
    "states.csv",
    "points.csv",
    "solids.csv",
    "masses.csv",
    "lines.csv",
    "tensions.csv",
    "probes.csv",
    "fields",
)


class Output(ABC):
    """A record of a run: it reads the state after each step, and does not change it.

    Attributes:
        overwrite: whether it replaces what is there.  None: it replaces a file of its name, but not
            one that belongs to the folder of a recorded run.
    """

    overwrite: bool | None = None

    @property
    def times(self) -> Sequence[float]:
        """Times [s] that the run must meet exactly."""
        return ()

    @property
    def writes(self) -> Sequence[Path]:
        """Files and folders that no other output and no other run may write."""
        return ()

    def open(self, run: StateView) -> None:
        """Check the request and make the files; before anything is computed."""
        return

    @abstractmethod
    def record(self, run: StateView, last: bool) -> None:
        """Look at the state; at the start and after every step.  With `last` it is the last one."""

    def close(self, run: StateView) -> None:
        """Finish the files; also after a failure."""
        return


class Continued(Output):
    """An output that continues at its position in a checkpoint; others start again after a
    restart."""

    @abstractmethod
    def cursor(self) -> dict[str, Any]:
        """Its position, for JSON: numbers, words, lists and dictionaries, the same on every
        rank."""

    @abstractmethod
    def resume(self, run: StateView, cursor: dict[str, Any]) -> None:
        """Remove what was written after the cursor, and continue there; called instead of
        `open`."""


def cursors_of(outputs: Iterable[Output]) -> list[tuple[str, dict[str, Any]]]:
    """Kinds and cursors of the outputs that continue after a restart."""
    cursors = []
    for output in outputs:
        if isinstance(output, Continued):
            cursors.append((type(output).__name__, output.cursor()))
    return cursors


def begin(run: StateView, output: Output, cursors: list[tuple[str, dict[str, Any]]]) -> None:
    """Open an output for a run, or let it continue at its position in a checkpoint.  Collective.

    Args:
        cursors: positions of the outputs that were not begun yet; that of this one is removed.
    """
    kind = type(output).__name__
    # Outputs have no names: those of one kind are matched in the order in which they are given.
    mine = next((cursor for cursor in cursors if cursor[0] == kind), None)
    if mine is not None and isinstance(output, Continued):
        cursors.remove(mine)
        try:
            output.resume(run, mine[1])
        except (LookupError, TypeError) as error:
            raise InputError(
                f"The checkpoint has no position of a {kind} that it can go on from "
                f"({type(error).__name__}: {error}); start again, or without that output."
            ) from error
    else:
        check_no_other_run(run.comm, output)
        output.open(run)


def check_no_other_run(comm: MPI.Intracomm, output: Output) -> None:
    """Refuse an output that would replace files of another run, or mix its own with them.

    One whose `overwrite` is not None owns all that it writes: unless that is true, none of its
    files may exist.
    """
    if output.overwrite:
        return
    owns_all = output.overwrite is not None

    def look() -> None:
        for path in output.writes:
            # An empty folder is what a run that was refused has left.
            exists = path.is_file() or (path.is_dir() and any(path.iterdir()))
            check(
                not exists or not (owns_all or _is_of_a_run(path)),
                f"'{path.parent}' holds a run already, with '{path.name}'; give another folder, "
                "continue that run with restart, or replace it with overwrite=True.",
            )

    on_rank_zero(comm, look)


def _is_of_a_run(path: Path) -> bool:
    """Whether a path is one of the files in the folder of a recorded run."""
    if path.parent.name == "fields":
        return (path.parent.parent / "run.json").exists()
    return path.name in RUN_FILES and (path.parent / "run.json").exists()


def make_parent(comm: MPI.Intracomm, path: Path, file: bool | None = None) -> None:
    """Make the folder of an output and try to write in it; `InputError` if that fails.  Collective.

    A link is refused, also as a folder within that of a run: the folder of a stranger may have one
    that leads to any file.

    Args:
        file: whether `path` is to be a file (True) or a folder (False); None: either.
    """

    def task() -> None:
        """Make the folder and write a page of 4096 bytes to it, which is removed; on rank 0."""
        for part in (path, *path.parents):
            is_ours = part == path or (part.parent / "run.json").exists()
            check(
                not (is_ours and part.is_symlink()),
                f"Cannot write '{path}': '{part}' is a link; remove it, or give another name.",
            )
        check(
            not (path.is_fifo() or path.is_socket()),
            f"Cannot write '{path}', which is a FIFO or a socket; remove it, or give another name.",
        )
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            probe = path.parent / f".{path.name}.try"
            try:
                # An empty file can be made on a full disk; a page cannot.
                write_new(probe, bytes(4096))
            finally:
                probe.unlink(missing_ok=True)
            if path.is_file():
                open_to_write(path, "r+b").close()
        except OSError as error:
            raise InputError(
                f"Cannot write '{path}' ({error.strerror}); choose a folder that exists and is "
                "writable."
            ) from error
        check(
            file is not True or not path.is_dir(),
            f"Cannot write '{path}', which is a folder; give the name of a file.",
        )
        check(
            file is not False or not path.is_file(),
            f"'{path}' is to be a folder, but it is a file; remove it or rename.",
        )

    on_rank_zero(comm, task)


def check_probe(run: StateView, name: str, probe: Probe) -> None:
    """Raise `InputError` if a probe fails before the first state is computed.  One that is a number
    of an equilibrium, as a stiffness, is asked when one was found.  Collective."""

    def value_if_found(view: StateView) -> float:
        try:
            return probe(view)
        except NotFoundYet:
            return 0.0

    evaluate_probe(run, name, value_if_found)


def evaluate_probe(run: StateView, name: str, probe: Probe) -> float:
    """The value of a probe in the state of a run; `name` is for error messages.  Collective."""

    def value() -> float:
        found = probe(run)
        # As the gap of a contact in which nothing is near, or the radius of a flat film.
        infinite = isinstance(found, float) and math.isinf(found)
        check(not infinite, f"it returns {found}; record its inverse, lambda run: 1 / probe(run).")
        return found

    return float(ask_numbers(run.comm, f"{name} at {run.axis.words(run.time)}", value))


def replace_file(path: Path, content: str | bytes) -> None:
    """Replace the contents of a file at once, so that a reader never finds half of them, and the
    former ones stay where the new ones cannot be written; on one rank.  A link is replaced, not
    followed.

    Raises:
        OutputFailure: the file cannot be written.
    """
    if isinstance(content, str):
        # JSON reads the replacement of half of a surrogate pair, \ud800, as that half.
        content = content.encode("utf-8", errors="backslashreplace")
    with output_failures(path):
        # Processes that share a sweep replace its tables at the same time.
        new = path.with_name(f"{path.name}.{os.getpid()}.new")
        try:
            write_new(new, content)
            new.replace(path)
        finally:
            # After an error only.
            new.unlink(missing_ok=True)


# A time is met if it differs by less than this from the one asked for, relatively above 1 s [s].
TIME_TOLERANCE = 1e-12


@dataclass(frozen=True)
class Schedule:
    """Every n-th step, given times, or equal intervals of time; the first and the last state are
    always due.

    Args:
        every: n, the steps from one record to the next.
        times: of records [s]; with any, `every` does not count.
        interval: between records [s], each at the end of the step in which a multiple of it lies;
            with one, `every` does not count.  Steps have the lengths that they have without it.
    """

    every: int = 1
    times: tuple[float, ...] = ()
    interval: float | None = None

    @classmethod
    def of(
        cls, owner: str, every: int | None, times: Sequence[float], default: int = 1
    ) -> Schedule:
        """The schedule that the arguments of an output ask for; both of them are refused."""
        check(
            every is None or not len(times),
            f"{owner}: every is {every}, but there are times, too; give one of them.",
        )
        return cls(every or default, tuple(times))

    def due(self, step: int, time: float, last: bool, since: float | None) -> bool:
        """Whether a record is due at the end of a step, from one time [s] to another; step 0 is the
        start."""
        if step == 0 or last:
            return True
        if self.times:
            return self.meets(time)
        if self.interval is not None:
            return self.frames_in(time, since) > 0
        return step % self.every == 0

    def frames_in(self, time: float, since: float | None) -> int:
        """Number of multiples of the interval after a time [s], up to another one."""
        if self.interval is None or since is None:
            return 0
        ends = [
            math.floor((t + TIME_TOLERANCE * max(abs(t), 1.0)) / self.interval)
            for t in (since, time)
        ]
        return ends[1] - ends[0]

    def meets(self, time: float) -> bool:
        """Whether a time [s] is one of the given ones."""
        return any(abs(time - t) <= TIME_TOLERANCE * max(abs(t), 1.0) for t in self.times)
