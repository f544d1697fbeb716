"""Calls of the user's functions, loads, valves, probes, events: what is wrong on one rank is told on all.

Every rank calls the function, and then all agree, by messages that cannot be taken for those of others.  A function
that fails on one rank only may leave the others within a message of its own; then they never come to agree, and the
program ends after some seconds with the error.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from gossamer_fx.checks.errors import InputError

PATIENCE = 10.0  # s that a rank with an error waits for the others
SAME = 1e-9  # relative difference of the values of two ranks that is round-off

Numbers = npt.NDArray[np.floating]

_KEY = MPI.Comm.Create_keyval()


def ask[T](comm: MPI.Intracomm, what: str, function: Callable[[], T]) -> T:
    """What a user's function returns, which may be of this rank alone.

    Raises:
        InputError: on every rank, if the function raises on one of them.
    """
    result, problem, cause = _call(function)
    _agree(comm, what, problem, cause, np.zeros(0))
    return result


def ask_numbers(
    comm: MPI.Intracomm, what: str, function: Callable[[], Any], shape: tuple[int, ...] = ()
) -> Numbers:
    """The finite numbers, an array of this shape, that a user's function returns; the same on every rank.

    Raises:
        InputError: on every rank, if the function raises, returns something else on one of them, or not the same.
    """
    wanted = {(): "a finite number", (3,): "three finite numbers"}.get(
        shape, f"finite numbers {shape}"
    )
    return _agree(comm, what, *_numbers(function, shape, wanted))


def ask_points(
    comm: MPI.Intracomm, what: str, function: Callable[[], Any], shape: tuple[int, ...]
) -> Numbers:
    """The vectors (3, n) at this rank's own points that a user's function returns.

    Raises:
        InputError: on every rank, if the function raises or returns something else on one of them.
    """
    problem, cause, values = _numbers(
        function, shape, f"finite numbers {shape} for the points (3, n)"
    )
    _agree(comm, what, problem, cause, np.zeros(0))
    return values


def _numbers(
    function: Callable[[], Any], shape: tuple[int, ...], wanted: str
) -> tuple[str, Exception | None, Numbers]:
    """What is wrong with what it returns, and the numbers."""
    result, problem, cause = _call(function)
    values = np.zeros(shape)
    if not problem:
        try:
            found = np.asarray(result, dtype=float)
            good = (
                found.shape == shape
                and bool(np.isfinite(found).all())
                and not isinstance(result, str)
            )
        except (TypeError, ValueError):
            good = False
        if good:
            values = found
        else:
            problem = f"it returns {_shown(result)}; it must return {wanted}."
    return problem, cause, values


def _call(function: Callable[[], Any]) -> tuple[Any, str, Exception | None]:
    """What it returns, and what is wrong with it."""
    try:
        return function(), "", None
    except InputError as error:
        return None, str(error), error
    except Exception as error:  # whatever a user's function raises
        words = " ".join(str(error).split()) or "no words"
        return None, f"it raises {type(error).__name__} ({words}); correct its function.", error


def _shown(value: Any) -> str:
    if isinstance(value, np.ndarray) and value.size > 3:
        return f"an array {value.shape}"
    text = repr(value.tolist() if isinstance(value, np.ndarray | np.generic) else value)
    return (
        text
        if len(text) <= 60 and "\n" not in text and " object at " not in text
        else type(value).__name__
    )


def _agree(
    comm: MPI.Intracomm, what: str, problem: str, cause: Exception | None, values: Numbers
) -> Numbers:
    if comm.size == 1:
        if problem:
            raise InputError(f"{what}: {problem}") from cause
        return values
    talk, flat = _own_messages(comm), values.ravel()
    extremes = np.concatenate([[float(bool(problem))], flat, -flat])
    request = talk.Iallreduce(MPI.IN_PLACE, extremes, op=MPI.MAX)
    if problem:
        _wait(talk, request, f"{what}: {problem}")
    else:
        request.Wait()
    if extremes[0]:
        raise InputError(f"{what}: {next(filter(None, talk.allgather(problem)))}") from cause
    highest, lowest = extremes[1 : 1 + flat.size], -extremes[1 + flat.size :]
    if (highest - lowest > SAME * np.maximum(abs(highest), abs(lowest)).max(initial=0.0)).any():
        raise InputError(
            f"{what}: it differs from rank to rank; sum what each rank has with run.comm.allreduce."
        )
    return highest.reshape(values.shape)


def _own_messages(comm: MPI.Intracomm) -> MPI.Intracomm:
    """A communicator for these messages alone, one for all that have the same ranks as the world."""
    if MPI.Comm.Compare(comm, MPI.COMM_WORLD) in (MPI.IDENT, MPI.CONGRUENT):
        comm = MPI.COMM_WORLD
    known: Any = comm.Get_attr(_KEY)
    talk: MPI.Intracomm = known or comm.Dup()
    if not known:
        comm.Set_attr(_KEY, talk)
    return talk


def _wait(comm: MPI.Intracomm, request: MPI.Request, words: str) -> None:
    """Wait for the others, but not for ever."""
    deadline = time.monotonic() + PATIENCE
    while not request.Test():
        if time.monotonic() > deadline:
            sys.stderr.write(
                f"gossamer: {words} This is of rank {comm.rank} alone, and ends the run.\n"
            )
            sys.stderr.flush()
            comm.Abort(2)
        time.sleep(1e-3)
