"""Calls of functions of the user (loads, valves, probes, events), whose errors are raised on all
ranks.

Every rank calls the function; then all ranks exchange whether it failed.  These messages have their
own communicator, so that they cannot be mixed up with others.  A function that fails on one rank
only may leave the other ranks waiting in a message inside the function.  They then never answer,
and the program ends after some seconds with the error.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from gossamer_fx.core.checks.ctrl_c import CtrlC
from gossamer_fx.core.checks.ending import PATIENCE
from gossamer_fx.core.checks.errors import LARGEST, InputError, real_numbers, wait_for_others

# Relative difference between the values of two ranks that counts as round-off.
SAME = 1e-9

# Longest text of a value in an error message.
LONGEST_TEXT = 60

Numbers = npt.NDArray[np.floating]

# Key under which a communicator stores its duplicate for these messages.
_KEY = MPI.Comm.Create_keyval()


def ask[T](comm: MPI.Intracomm, what: str, function: Callable[[], T]) -> T:
    """Call a function of the user and return its result, which may differ between ranks.
    Collective.

    Args:
        what: name of the function in error messages.
        function: called without arguments.

    Raises:
        InputError: on every rank, if the function raises on one of them.
    """
    result, problem, cause = _call(function)
    _agree(comm, what, problem, cause, np.zeros(0))
    return result


def ask_numbers(
    comm: MPI.Intracomm, what: str, function: Callable[[], Any], shape: tuple[int, ...] = ()
) -> Numbers:
    """Call a function of the user that returns numbers up to 1e100, and return them as an array;
    they must be the same on all ranks, to 1e-9 of the largest.  Collective.

    Args:
        what: name of the function in error messages.
        function: called without arguments, on every rank.
        shape: shape of the array that it must return, in its unit; () for a number.

    Raises:
        InputError: on all ranks, if the function raises or returns something else on one of them,
            or if the numbers differ between ranks.
    """
    names = {(): "a finite number", (3,): "three finite numbers"}
    wanted = names.get(shape, f"finite numbers {shape}")
    return _agree(comm, what, *_numbers(function, shape, wanted))


def ask_points(
    comm: MPI.Intracomm, what: str, function: Callable[[], Any], shape: tuple[int, ...]
) -> Numbers:
    """Call a function of the user that returns numbers up to 1e100 at this rank's points, and
    return them as an array.  Collective.

    Args:
        what: name of the function in error messages.
        function: called without arguments; it knows the n points of this rank.
        shape: shape of the array that it must return, in its unit, e.g. (3, n) or (n,).

    Raises:
        InputError: on all ranks, if the function raises or returns something else on one of them.
    """
    wanted = f"finite numbers {shape} for the points (3, n)"
    problem, cause, values = _numbers(function, shape, wanted)
    _agree(comm, what, problem, cause, np.zeros(0))
    return values


def _numbers(
    function: Callable[[], Any], shape: tuple[int, ...], wanted: str
) -> tuple[str, BaseException | None, Numbers]:
    """Call a user's function that is to return numbers of a shape, () for a number.  Returns the
    problem in words, empty if there is none; the exception that caused it, if any; and the numbers,
    zeros where there is a problem."""
    result, problem, cause = _call(function)
    values = np.zeros(shape)
    if not problem:
        found = real_numbers(result)
        if found is not None and found.shape == shape and _is_below_limit(found):
            values = found
        else:
            problem = f"it returns {_shown(result)}; it must return {wanted}."
            if found is not None and np.isfinite(found).all() and not _is_below_limit(found):
                problem = f"it returns {_shown(result)}; it must return numbers up to {LARGEST:g}."
    return problem, cause, values


def _is_below_limit(numbers: Numbers) -> bool:
    """Whether all numbers are finite, and can be computed with."""
    return bool((np.abs(numbers) <= LARGEST).all())


def _call(function: Callable[[], Any]) -> tuple[Any, str, BaseException | None]:
    """Call a function of the user.  Returns the result, None after an exception; the problem in
    words, empty if there is none; and the exception.  Ctrl-C is not caught."""
    try:
        return function(), "", None
    except InputError as error:
        return None, str(error), error
    except CtrlC:
        raise
    # A function of the user may raise anything, and may end the program on one rank alone.
    except BaseException as error:
        words = " ".join(str(error).split()) or "no words"
        return None, f"it raises {type(error).__name__} ({words}); correct its function.", error


def _shown(value: Any) -> str:
    """Text of a value for an error message: short, on one line, without addresses.  A long value is
    named by its class, an array of more than three numbers by its shape and any nan."""
    if isinstance(value, np.ndarray) and value.size > 3:
        has_nan = value.dtype.kind == "f" and bool(np.isnan(value).any())
        return f"nan in an array {value.shape}" if has_nan else f"an array {value.shape}"
    plain = value
    if isinstance(value, np.ndarray | np.generic):
        plain = value.tolist()
    text = repr(plain)
    if len(text) <= LONGEST_TEXT and "\n" not in text and " object at " not in text:
        return text
    return type(value).__name__


def _agree(
    comm: MPI.Intracomm, what: str, problem: str, cause: BaseException | None, values: Numbers
) -> Numbers:
    """Return the values if no rank has a problem and those of all ranks are the same, the largest
    where they differ by round-off.  Collective.

    Otherwise `InputError` is raised on all ranks; values differ if by more than `SAME` of the
    largest.  A function that ends the program on all ranks ends it.  If other ranks do not answer
    within `PATIENCE` seconds, a rank with a problem prints it and ends the program.
    """
    if comm.size == 1:
        if cause is not None and _ends_program(cause):
            raise cause
        if problem:
            raise InputError(f"{what}: {problem}") from cause
        return values
    talk = _own_messages(comm)
    flat = values.ravel()
    # One reduction finds whether a rank has a problem, and the largest and smallest values.
    extremes = np.concatenate([[float(bool(problem))], flat, -flat])
    request = talk.Iallreduce(MPI.IN_PLACE, extremes, op=MPI.MAX)
    if problem:
        wait_for_others(
            talk,
            request,
            patience=PATIENCE,
            message=f"{what}: {problem} This is of rank {comm.rank} alone, and ends the run.",
            exit_code=2,
        )
    else:
        request.Wait()
    if extremes[0]:
        problems = [text for text in talk.allgather(problem) if text]
        # The program ends if all ranks say so; one rank alone has an error.
        if talk.allreduce(_ends_program(cause), MPI.LAND):
            assert cause is not None
            raise cause
        raise InputError(f"{what}: {problems[0]}") from cause
    highest = extremes[1 : 1 + flat.size]
    lowest = -extremes[1 + flat.size :]
    largest = np.maximum(abs(highest), abs(lowest)).max(initial=0.0)
    if (highest - lowest > SAME * largest).any():
        raise InputError(
            f"{what}: it differs from rank to rank; sum what each rank has with run.comm.allreduce."
        )
    return highest.reshape(values.shape)


def _ends_program(cause: BaseException | None) -> bool:
    """Whether an exception ends a program, as SystemExit and KeyboardInterrupt do."""
    return cause is not None and not isinstance(cause, Exception)


def _own_messages(comm: MPI.Intracomm) -> MPI.Intracomm:
    """Communicator with the same ranks, for messages about users' functions only: a duplicate,
    which is made once, collectively, and stored as an attribute of `comm`.  Communicators with the
    same ranks as the world share one, since their number is limited."""
    if MPI.Comm.Compare(comm, MPI.COMM_WORLD) in (MPI.IDENT, MPI.CONGRUENT):
        comm = MPI.COMM_WORLD
    known: Any = comm.Get_attr(_KEY)
    talk: MPI.Intracomm = known or comm.Dup()
    if not known:
        comm.Set_attr(_KEY, talk)
    return talk
