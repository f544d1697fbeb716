"""Errors of one rank alone, which would leave the others waiting for it: all have it, or the program ends."""

from __future__ import annotations

import os
import sys
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mpi4py import MPI

PATIENCE, TAG = (
    10.0,
    28531,
)  # s that a rank with an error waits for the others; a message that nobody else sends
_SIZES = (
    "OMPI_COMM_WORLD_SIZE",
    "PMI_SIZE",
    "MPI_LOCALNRANKS",
)  # number of ranks, as those say who start them


@contextmanager
def abort_on_lone_error(comm: MPI.Intracomm) -> Iterator[None]:
    """See that an error of one rank does not leave the others waiting for it: all have it, or the program ends."""
    try:
        yield
    except Exception as error:
        agree_on_error(comm, error)
        raise


def agree_on_error(comm: MPI.Intracomm, error: Exception) -> None:
    """Return when all ranks are here with an error of the same kind; end the program if they are not."""
    if comm.size == 1:
        return
    others = [r for r in range(comm.size) if r != comm.rank]
    mine = type(error).__qualname__
    sent = [comm.isend(mine, r, TAG) for r in others]
    awaited = {r: comm.irecv(source=r, tag=TAG) for r in others}
    deadline = time.monotonic() + PATIENCE
    kinds = {mine}
    while awaited or not all(request.test()[0] for request in sent):
        for r in list(awaited):
            arrived, kind = awaited[r].test()
            if arrived:
                kinds.add(str(kind))
                del awaited[r]
        if time.monotonic() > deadline or len(kinds) > 1:
            words = (
                f"rank {comm.rank} failed alone"
                if len(kinds) == 1
                else "the ranks failed in different ways"
            )
            traceback.print_exception(error)
            sys.stderr.write(f"gossamer: {words}; its error is above, and the run ends.\n")
            sys.stderr.flush()
            comm.Abort(1)
        time.sleep(1e-3)


def watch_uncaught_errors() -> None:
    """Let an uncaught error of one rank, e.g. while it builds the scene, end the program on all.

    Without, Python would wait in MPI_Finalize for the others, which wait for this rank.
    """
    if not any(os.environ.get(name, "1") not in ("", "0", "1") for name in _SIZES):
        return
    usual = sys.excepthook

    def uncaught(
        kind: type[BaseException], error: BaseException, trace: TracebackType | None
    ) -> None:
        usual(kind, error, trace)
        sys.stderr.flush()
        from mpi4py import MPI

        if isinstance(error, Exception) and MPI.Is_initialized() and not MPI.Is_finalized():
            agree_on_error(MPI.COMM_WORLD, error)

    sys.excepthook = uncaught
