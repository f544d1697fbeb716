"""The log of a run: the logger `gossamer_fx` of Python's `logging`, whose records come from rank
0."""

from __future__ import annotations

import logging
import sys
from pathlib import Path

from mpi4py import MPI

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.records.outputs.output import make_parent

LOGGER = logging.getLogger("gossamer_fx")


class FirstRank(logging.Filter):
    """Filter that lets the records of rank 0 pass, and from all ranks those with `every_rank`.

    A record has `every_rank` if it is made with `extra={"every_rank": True}`.
    """

    def __init__(self, rank: int) -> None:
        super().__init__()
        self._rank = rank

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether a record passes; called by `logging`."""
        return self._rank == 0 or getattr(record, "every_rank", False)


class LogFile(logging.FileHandler):
    """File of a log.  The first line that cannot be written is reported; the run goes on."""

    _is_reported = False

    def handleError(self, record: logging.LogRecord) -> None:
        """Report the error that has just occurred; called by `logging`."""
        if self._is_reported:
            return
        self._is_reported = True
        error = sys.exc_info()[1]
        cause = getattr(error, "strerror", None) or error
        sys.stderr.write(
            f"gossamer: The log '{self.baseFilename}' cannot be written ({cause}) and lacks what "
            "follows; the run goes on: make room, or give another file with --log.\n"
        )


# The filter is set at import, so that a script that sets up `logging` itself has no repeated lines.
LOGGER.addFilter(FirstRank(MPI.COMM_WORLD.rank))


@check_arguments
def log_to(comm: MPI.Intracomm, file: str | Path | None = None, *, quiet: bool = False) -> None:
    """Show the log of runs on the terminal, and write it to a file.

    Replaces the destinations of an earlier call.

    Args:
        comm: of the run.
        file: to which lines with date and time are appended; None: no file.
        quiet: whether the terminal shows warnings only.

    Raises:
        InputError: the file cannot be written.

    Example:
        >>> gx.run.log_to(comm, quiet=True)
    """
    for handler in list(LOGGER.handlers):
        LOGGER.removeHandler(handler)
        handler.close()
    # A file takes records of every level, also debug messages of the user's code.
    LOGGER.setLevel(logging.INFO)
    if file is not None:
        LOGGER.setLevel(logging.DEBUG)
    # Standard error, as programs may write results to standard output.
    terminal = logging.StreamHandler(sys.stderr)
    terminal.setFormatter(logging.Formatter("gossamer: %(message)s"))
    terminal.setLevel(logging.INFO)
    if quiet:
        terminal.setLevel(logging.WARNING)
    LOGGER.addHandler(terminal)
    if file is not None:
        make_parent(comm, Path(file), file=True)
        # Several ranks that append to one file would mix their lines.
        if comm.rank == 0:
            to_file = LogFile(file, encoding="utf-8")
            to_file.setFormatter(logging.Formatter("%(asctime)s %(levelname)-7s %(message)s"))
            LOGGER.addHandler(to_file)
