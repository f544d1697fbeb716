"""Exceptions of the package, and checks that raise them.

An exception on one rank alone would leave the other ranks waiting in their next message for ever.
So conditions that may differ between ranks are checked by functions that raise on all ranks
together.
"""

from __future__ import annotations

import math
import re
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.checks.real_numbers import real_numbers

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
        characters = []
        for character in message:
            if not character.isprintable():
                # The escape sequence, such as \n, without the quotes.
                character = ascii(character)[1:-1]
            characters.append(character)
        super().__init__("".join(characters))


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


def check(condition: bool, message: str) -> None:
    """Raise `InputError(message)` unless a condition holds that is the same on all ranks.

    >>> check(True, "The thickness must be > 0.")
    """
    if not condition:
        raise InputError(message)


def check_positive(item: Any, quantity: str, unit: str) -> None:
    """Raise `InputError` unless an attribute of a named item is a finite, positive number.

    Args:
        item: object with a `name`.
        quantity: name of the attribute.
        unit: SI unit of the attribute, for the message.
    """
    what = f"{type(item).__name__} '{item.name}': {quantity}"
    require_positive(what, getattr(item, quantity), unit)


def require_positive(
    what: str,
    value: float,
    unit: str,
    hint: str = "",
) -> None:
    """Raise `InputError` unless a value is a finite, positive number.

    Not collective: the value is the same on all ranks.

    Args:
        what: subject of the message.
        value: the number, in the unit `unit`.
        unit: its unit, for the message.
        hint: text that follows "give a positive number".

    >>> require_positive("The thickness", 1e-3, "m")
    """
    check(
        math.isfinite(value) and value > 0,
        f"{what} is {value!r} {unit}; give a positive number{hint}.",
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
    """Run a task on rank 0, and raise its error on all ranks.  Collective.

    Args:
        comm: the ranks.
        task: function without arguments that does not communicate.

    Returns:
        The result on rank 0, None on the other ranks.

    Raises:
        Exception: on rank 0 the error of the task.  On the other ranks one of the same type if it
            is built in or defined in this module, otherwise RuntimeError.
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
    """Run a task that writes a file on all ranks together.  Collective.

    Args:
        comm: the ranks.
        path: the file, for the message.
        task: function that writes the file.

    Returns:
        the result of the task.

    Raises:
        OutputFailure: on all ranks, if the task raised OSError or RuntimeError on one of them.

    The task may itself wait for other ranks, as those of ADIOS2 do.  Where it has failed on one
    rank and the others have not returned from it after `WRITE_PATIENCE`, that rank prints the
    message and ends the program.
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
    return (
        f"Cannot write '{path}' ({reason}); what was written before is kept: make room or mend the "
        "folder, then restart from the last checkpoint, or start again if there is none."
    )


def _reason(error: Exception) -> str:
    """Why a file could not be written, in the words of the operating system if they are known.

    Returns:
        One line, never empty: at least the name of the exception's class.
    """
    system_message = getattr(error, "strerror", None)
    if system_message:
        return str(system_message)
    # ADIOS2 colours its messages, and has the system's words behind a number.
    plain = re.sub(r"\x1b\[[0-9;]*m", "", str(error))
    found = re.search(r"errno = \d+: ([^:]+)", plain)
    if found is not None:
        return found[1].strip()
    return " ".join(plain.split()) or type(error).__name__


def wait_for_others(
    comm: MPI.Intracomm,
    request: MPI.Request,
    *,
    patience: float,
    message: str,
    exit_code: int,
) -> None:
    """Wait for a request of MPI, or end the program on all ranks if it does not complete.

    Args:
        comm: the ranks, all of which end.
        request: of a message that this rank has started.
        patience: time [s] after which the program ends.
        message: printed to standard error before the end.
        exit_code: with which the program then ends.
    """
    deadline = time.monotonic() + patience
    while not request.Test():
        if time.monotonic() > deadline:
            sys.stderr.write(f"gossamer: {message}\n")
            sys.stderr.flush()
            comm.Abort(exit_code)
        # Poll, since a blocking wait could not end after `patience`.
        time.sleep(1e-3)
