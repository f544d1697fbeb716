"""The compiled C functions of contact."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

from gossamer_fx.core.forms.c_source import CLibrary, loaded_library

HEADER = Path(__file__).parent / "contact.h"

# One file a stage; see the header for what their functions do.
SOURCES = (
    "broad_phase.c",
    "closest_points.c",
    "stencils.c",
    "ccd.c",
    "intersections.c",
    "pass_through.c",
    "potential.c",
    "block_pattern.c",
)


def library(comm: MPI.Intracomm = MPI.COMM_SELF) -> CLibrary:
    """Return the C functions; the first call compiles them on rank 0 of `comm` and is
    collective."""
    return loaded_library(comm, "contact", HEADER, SOURCES)
