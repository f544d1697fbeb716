"""The compiled C functions of orthotropic films."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

from gossamer_fx.core.forms.backend import KERNELS_TAKE_DATA
from gossamer_fx.core.forms.c_source import CLibrary, loaded_library

HEADER = Path(__file__).parent / "orthotropic.h"

SOURCES = ("relaxed_film.c", "strain_path.c", "orthotropic.c")


def library(comm: MPI.Intracomm = MPI.COMM_SELF) -> CLibrary:
    """Return the C functions; the first call compiles them on rank 0 of `comm` and is
    collective."""
    definitions = ["KERNELS_TAKE_DATA"] if KERNELS_TAKE_DATA else []
    return loaded_library(comm, "orthotropic", HEADER, SOURCES, definitions)
