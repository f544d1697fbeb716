"""Exceptions, and checks that raise them on every rank."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
from mpi4py import MPI


class InputError(ValueError):
    """A scene, mesh or option that cannot be computed; the message names the culprit and the remedy.

    It is one line, also if a name in it has line breaks or other characters that cannot be shown.
    """

    def __init__(self, message: str) -> None:
        super().__init__("".join(c if c.isprintable() else ascii(c)[1:-1] for c in message))


class StepFailure(RuntimeError):
    """A time step that did not converge, also not in sub-steps; the message names time, step, reason and place."""


class NoEquilibrium(RuntimeError):
    """A static problem whose equilibrium was not found; the message names what was reached, reason and place."""


class OutputFailure(RuntimeError):
    """A file that could not be written in the course of a run; the message names it, the reason and the remedy."""


def check(condition: bool, message: str) -> None:
    """Raise `InputError(message)` unless `condition` holds; for conditions that are the same on every rank."""
    if not condition:
        raise InputError(message)


def check_positive(item: Any, quantity: str, unit: str) -> None:
    """Raise `InputError` unless that attribute of a named item is a positive number."""
    require_positive(
        f"{type(item).__name__} '{item.name}': {quantity}", getattr(item, quantity), unit
    )


def require_positive(what: str, value: float, unit: str, hint: str = "") -> None:
    """Raise `InputError` unless a value is a positive number; a hint may follow the remedy."""
    check(
        math.isfinite(value) and value > 0,
        f"{what} is {value!r} {unit}; give a positive number{hint}.",
    )


def check_on_all(comm: MPI.Intracomm, condition: bool, message: str) -> None:
    """As `check`, for conditions that may fail on some ranks only: all ranks raise, so that none waits for ever."""
    if not comm.allreduce(condition, MPI.LAND):
        raise InputError(message)


def is_vector(value: Any) -> bool:
    """Whether a value is three finite numbers."""
    try:
        numbers = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        return False
    return numbers.shape == (3,) and bool(np.isfinite(numbers).all())


def on_rank_zero[T](comm: MPI.Intracomm, task: Callable[[], T]) -> T | None:
    """Run `task` on rank 0; an error there is raised on every rank.  Other ranks get None."""
    result, failure = None, None
    if comm.rank == 0:
        try:
            result = task()
        except Exception as error:
            failure = error
    known = type(failure) if type(failure).__module__ in ("builtins", __name__) else RuntimeError
    told = comm.bcast((known, str(failure)) if failure else None)
    if failure is not None:
        raise failure
    if told is not None:
        kind, words = told
        raise kind(words)
    return result


def write_on_all[T](comm: MPI.Intracomm, path: Path, task: Callable[[], T]) -> T:
    """Run on every rank a `task` that writes `path`.

    Raises:
        OutputFailure: on every rank, if it failed on one of them.
    """
    result, reason = None, ""
    try:
        result = task()
    except (OSError, RuntimeError) as error:
        reason = (
            getattr(error, "strerror", None) or " ".join(str(error).split()) or type(error).__name__
        )
    reason = next(filter(None, comm.allgather(reason)), "")
    if reason:
        raise OutputFailure(
            f"Cannot write '{path}' ({reason}); what was written before is kept: make room or mend the folder, and "
            "restart from the last checkpoint."
        )
    return cast(T, result)
