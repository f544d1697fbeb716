"""The compiled C functions of reduced films."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

from gossamer_fx.core.forms.c_source import CLibrary, loaded_library

HEADER = Path(__file__).parent / "points.h"


def library(comm: MPI.Intracomm = MPI.COMM_SELF) -> CLibrary:
    """Return the C functions; the first call compiles them on rank 0 of `comm` and is
    collective."""
    return loaded_library(comm, "reduction", HEADER, ["points.c"])
