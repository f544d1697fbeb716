"""Exceptions of the package, and checks that raise them.

An exception on one rank alone would leave the other ranks waiting in their next message for ever.
So conditions that may differ between ranks are checked by functions that raise on all ranks
together.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from numbers import Real
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from gossamer_fx.core.checks.shown import shown

# Kinds of NumPy's types that are real numbers: truth values, whole numbers and floating-point
# numbers.
REAL_KINDS = "biuf"

# Sizes of numbers, other than zero, with which the package computes, in SI units: cubes of these,
# and ratios of their squares, are floating-point numbers.
LARGEST = 1e100
SMALLEST = 1e-100

# Whole numbers up to this one are integers of 64 bits.
LARGEST_COUNT = 2**63 - 1


def real_numbers(value: Any) -> npt.NDArray[np.float64] | None:
    """Return a number, list or array as an array of floats, of shape () for a number; None if an
    entry is not a real number.

    NaN and infinite values are returned, too.  Words, complex numbers, and lists whose rows differ
    in length are not real numbers; True and False are 1 and 0.

    >>> real_numbers([1, 2.5])
    array([1. , 2.5])
    >>> print(real_numbers(["1", "2"]), real_numbers([1j]))
    None None
    """
    try:
        found = np.asarray(value)
        if found.dtype.kind not in REAL_KINDS:
            # Fractions and numbers beyond 64 bits are objects for NumPy.
            are_real = all(isinstance(one, Real) for one in found.ravel().tolist())
            if found.dtype.kind != "O" or not are_real:
                return None
        return found.astype(float)
    except (TypeError, ValueError, OverflowError):
        return None


def are_usual_sizes(numbers: npt.NDArray[np.floating]) -> bool:
    """Return whether all numbers are finite, and zero or of a size that can be computed with.

    A size may be at most `LARGEST`, 1e100 in SI units.  A single number, of shape (), must also be
    zero or at least `SMALLEST`, 1e-100; entries of a list may be smaller, since a component that
    vanishes next to the others is harmless.

    >>> are_usual_sizes(np.array([1e-300, -1e9])), are_usual_sizes(np.array([1e300]))
    (True, False)
    >>> are_usual_sizes(np.array(1e-300))
    False
    """
    sizes = np.abs(numbers)
    # NaN is not below the limit.
    is_below = bool((sizes <= LARGEST).all())
    if sizes.ndim > 0:
        return is_below
    return is_below and bool(sizes == 0 or sizes >= SMALLEST)


# Seconds for which a rank that could not write a file waits for the others: longer than a large
# file takes.
WRITE_PATIENCE = 60.0


class InputError(ValueError):
    """A scene, mesh or option that cannot be computed; the message names the culprit, the value and
    the remedy.

    The message is one line, also if a name in it has line breaks or other characters that cannot be
    shown.

    Example:
        >>> gx.PointMass(-1.0, comm=comm)
        Traceback (most recent call last):
            ...
        gossamer_fx.core.checks.errors.InputError: ...
    """

    def __init__(self, message: str) -> None:
        super().__init__(shown(message))


class NotFoundYet(InputError):
    """A number of an equilibrium is asked for before one was found."""


class StepFailure(RuntimeError):
    """A time step did not converge, also not in sub-steps.

    The message names the time, the step, the reason and the location.

    Example:
        >>> try:
        ...     fall = gx.Simulation(gx.Scene(mass), gx.Midpoint(dt=0.1), halvings=3)
        ...     fall.run(until=0.1)
        ... except gx.StepFailure as failure:
        ...     print(f"Take shorter steps: {failure}")
    """


class NoEquilibrium(RuntimeError):
    """The equilibrium of a static problem was not found.

    The message names the residual that was reached, the reason and the location.

    Example:
        >>> adrift = gx.Scene(mass, gx.Gravity(mass, (0.0, 0.0, -9.81)))
        >>> try:
        ...     gx.Equilibrium(adrift).find()
        ... except gx.NoEquilibrium as failure:
        ...     print(str(failure)[:14])
        No equilibrium
    """


class OutputFailure(RuntimeError):
    """A file could not be written during a run; the message names it, the reason and the remedy.

    Example:
        >>> try:
        ...     fall = gx.Simulation(gx.Scene(mass), gx.Midpoint(dt=0.1))
        ...     fall.run(until=0.1)
        ... except gx.OutputFailure as failure:
        ...     print(f"The disk is full: {failure}")
    """


@contextmanager
def output_failures(path: str | Path) -> Iterator[None]:
    """Raise `OutputFailure` where a file, or files in a folder, cannot be written; on one rank."""
    try:
        yield
    except OSError as error:
        raise OutputFailure(
            f"Cannot write '{path}' ({error.strerror}); make room, or choose a folder that is "
            "writable."
        ) from error


@contextmanager
def errors_as_sentences() -> Iterator[None]:
    """Context for the main function of a program of this package: errors that users can mend end it
    without a trace of Python.

    `InputError` ends it with the code 2, `StepFailure`, `NoEquilibrium` and `OutputFailure` with 1;
    the first rank prints the message, as the commands do.

    Example:
        >>> with gx.extend.errors_as_sentences():
        ...     gx.extend.check(True, "thickness must be > 0, got -1.")
    """
    try:
        yield
    except (InputError, StepFailure, NoEquilibrium, OutputFailure) as error:
        if MPI.COMM_WORLD.rank == 0:
            print(f"gossamer: {error}", file=sys.stderr, flush=True)
        # Scripts can tell wrong input from a computation that failed.
        sys.exit(2 if isinstance(error, InputError) else 1)


def check(condition: bool, message: str) -> None:
    """Raise `InputError(message)` unless a condition holds that is the same on all ranks.

    >>> check(True, "The thickness must be > 0.")
    """
    if not condition:
        raise InputError(message)


def check_positive(owner: Any, quantity: str, unit: str) -> None:
    """Raise `InputError` unless an attribute of a named object is a finite, positive number.

    Args:
        owner: object with a `name`.
        quantity: name of the attribute.
        unit: SI unit of the attribute, for the message.
    """
    what = f"{type(owner).__name__} '{owner.name}': {quantity}"
    require_positive(what, getattr(owner, quantity), unit)


def require_positive(what: str, value: float, unit: str) -> None:
    """Raise `InputError` unless a value is a finite, positive number, the same on all ranks.  The
    message begins with `what`, and gives the value with its unit.

    >>> require_positive("The thickness", 1e-3, "m")
    """
    check(
        math.isfinite(value) and value > 0,
        f"{what} is {value!r} {unit}; give a positive number.",
    )


def check_on_all(comm: MPI.Intracomm, condition: bool, message: str) -> None:
    """Raise `InputError` on all ranks unless a condition holds on all of them.  Collective.

    Args:
        comm: the ranks.
        condition: what has to hold; ranks may differ.
        message: of this rank.  All ranks raise that of the first one where the condition fails.
    """
    message_of_failure = None
    if not condition:
        message_of_failure = message
    for found in comm.allgather(message_of_failure):
        if found is not None:
            raise InputError(found)


def is_vector(value: Any) -> bool:
    """Whether a value is three finite numbers.

    >>> is_vector((0, 0, 9.81)), is_vector([1.0, 2.0])
    (True, False)
    """
    numbers = real_numbers(value)
    return numbers is not None and numbers.shape == (3,) and bool(np.isfinite(numbers).all())


def on_rank_zero[T](comm: MPI.Intracomm, task: Callable[[], T]) -> T | None:
    """Run a task that does not communicate on rank 0, and return its result there, None on the
    others.  Collective.

    An error of the task is raised on all ranks: on the others of the same type if it is built in or
    defined in this module, otherwise as `RuntimeError`.
    """
    result = None
    failure = None
    if comm.rank == 0:
        try:
            result = task()
        except Exception as error:
            failure = error
    report: tuple[type[Exception], str] | None = None
    if failure is not None:
        # Other exceptions may need more arguments than a message, or cannot be pickled.
        kind: type[Exception] = RuntimeError
        if type(failure).__module__ in ("builtins", __name__):
            kind = type(failure)
        report = kind, str(failure)
    report = comm.bcast(report)
    if failure is not None:
        raise failure
    if report is not None:
        kind, message = report
        raise kind(message)
    return result


def write_on_all[T](comm: MPI.Intracomm, path: Path, task: Callable[[], T]) -> T:
    """Run a task that writes the file `path` on all ranks together, and return its result.
    Collective.

    If it raises OSError or RuntimeError on one rank, `OutputFailure` is raised on all.  The task
    may itself wait for other ranks.  Where it has failed on one rank and the others have not
    returned from it after `WRITE_PATIENCE`, 60 s, that rank prints the message and ends the
    program.
    """
    result = None
    reason = ""
    try:
        result = task()
    except (OSError, RuntimeError) as error:
        reason = _reason(error)
    # A first message only asks whether there is a reason at all, so that a rank with one can stop
    # waiting.
    has_reason = np.array([bool(reason)])
    request = comm.Iallreduce(MPI.IN_PLACE, has_reason, op=MPI.LOR)
    if reason:
        wait_for_others(
            comm,
            request,
            patience=WRITE_PATIENCE,
            message=(
                f"{_cannot_write(path, reason)} Rank {comm.rank} failed alone, and the run ends."
            ),
            exit_code=1,
        )
    else:
        request.Wait()
    if has_reason[0]:
        reasons = [text for text in comm.allgather(reason) if text]
        raise OutputFailure(_cannot_write(path, reasons[0]))
    return cast(T, result)


def _cannot_write(path: Path, reason: str) -> str:
    """The message of an `OutputFailure`."""
    return (
        f"Cannot write '{path}' ({reason}); "
        "what was written before is kept: make room or mend the folder, "
        "then restart from the last checkpoint, or start again if there is none."
    )


def _reason(error: Exception) -> str:
    """Why a file could not be written, as one line: in the words of the operating system if they
    are known, else at least the name of the exception's class."""
    system_message = getattr(error, "strerror", None)
    if system_message:
        return str(system_message)
    return " ".join(str(error).split()) or type(error).__name__


def wait_for_others(
    comm: MPI.Intracomm, request: MPI.Request, *, patience: float, message: str, exit_code: int
) -> None:
    """Wait for a request of MPI.  If it does not complete within `patience` [s], print the message
    to standard error and end the program on all ranks."""
    deadline = time.monotonic() + patience
    while not request.Test():
        if time.monotonic() > deadline:
            sys.stderr.write(f"gossamer: {message}\n")
            sys.stderr.flush()
            comm.Abort(exit_code)
        # Poll, since a blocking wait could not end after `patience`.
        time.sleep(1e-3)


# ---- reasons to reject a step --------------------------------------------------------------------


class NotConverged(Exception):
    """Newton's iteration failed; the message holds PETSc's reason and where the residual is
    largest."""


class Inadmissible(NotConverged):
    """Newton's iteration converged to an inadmissible state: interpenetration, a negative
    volume."""
