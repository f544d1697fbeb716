"""What a run says: the logger `gossamer_fx` of Python's logging, heard from rank 0 only."""

from __future__ import annotations

import logging
import sys
from pathlib import Path

from mpi4py import MPI

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.outputs.output import make_parent

LOGGER = logging.getLogger("gossamer_fx")


class FirstRank(logging.Filter):
    """Lets records of one rank pass; those with `extra={"every_rank": True}` of all."""

    def __init__(self, rank: int) -> None:
        super().__init__()
        self._rank = rank

    def filter(self, record: logging.LogRecord) -> bool:
        return self._rank == 0 or getattr(record, "every_rank", False)


LOGGER.addFilter(FirstRank(MPI.COMM_WORLD.rank))


@check_arguments
def log_to(comm: MPI.Intracomm, file: str | Path | None = None, *, quiet: bool = False) -> None:
    """Show what runs say on the terminal, and write all of it to a file.

    Args:
        comm: of the run.
        file: that is appended to, with date and time; none: no file.
        quiet: only warnings on the terminal.

    Raises:
        InputError: the file cannot be written.
    """
    for handler in list(LOGGER.handlers):
        LOGGER.removeHandler(handler)
        handler.close()
    LOGGER.setLevel(logging.DEBUG if file is not None else logging.INFO)
    terminal = logging.StreamHandler(sys.stderr)
    terminal.setFormatter(logging.Formatter("gossamer: %(message)s"))
    terminal.setLevel(logging.WARNING if quiet else logging.INFO)
    LOGGER.addHandler(terminal)
    if file is not None:
        make_parent(comm, Path(file), file=True)
        if comm.rank == 0:
            written = logging.FileHandler(file, encoding="utf-8")
            written.setFormatter(logging.Formatter("%(asctime)s %(levelname)-7s %(message)s"))
            LOGGER.addHandler(written)
