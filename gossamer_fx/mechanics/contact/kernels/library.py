"""The compiled C functions of contact."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

from gossamer_fx.core.forms.c_source import CLibrary, c_library

# It says what each function does, and its arrays; there is one C file a stage.
HEADER = Path(__file__).parent / "contact.h"


def library(comm: MPI.Intracomm = MPI.COMM_SELF) -> CLibrary:
    """Return the C functions; the first call compiles them on rank 0 of `comm` and is
    collective."""
    return c_library(HEADER, comm)
