"""The compiled C functions of rings."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

from gossamer_fx.forms.c_source import CLibrary, compile_library

HEADER = Path(__file__).parent / "ring.h"

_loaded: list[CLibrary] = []


def library(comm: MPI.Intracomm = MPI.COMM_SELF) -> CLibrary:
    """Return the C functions; the first call compiles them on rank 0 of `comm` and is collective."""
    if not _loaded:
        _loaded.append(compile_library(comm, "ring", HEADER, ["ring.c"]))
    return _loaded[0]
