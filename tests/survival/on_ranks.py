"""How a test starts a program on several ranks."""

from __future__ import annotations

import sys

from mpi4py import MPI

# Open MPI asks for leave to have more ranks than cores, MPICH does not know the word
MANY = ("--oversubscribe",) if "Open MPI" in MPI.Get_library_version() else ()


def python(ranks: int) -> list[str]:
    """The words before the arguments of Python."""
    return [sys.executable] if ranks == 1 else ["mpirun", *MANY, "-n", str(ranks), sys.executable]
