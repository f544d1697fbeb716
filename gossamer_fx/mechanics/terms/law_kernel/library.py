"""The compiled C functions of the law kernel."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

from gossamer_fx.core.forms.backend import KERNELS_TAKE_DATA
from gossamer_fx.core.forms.c_source import CLibrary, loaded_library

HEADER = Path(__file__).parent / "law.h"


def library(comm: MPI.Intracomm = MPI.COMM_SELF) -> CLibrary:
    """Return the C functions; the first call compiles them on rank 0 of `comm` and is
    collective."""
    # Kernels of newer versions of dolfinx have one argument more.
    definitions = ["KERNELS_TAKE_DATA"] if KERNELS_TAKE_DATA else []
    return loaded_library(comm, "law", HEADER, ["law.c"], definitions)
