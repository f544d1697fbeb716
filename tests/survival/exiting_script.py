"""A script that imports the package; its ranks exit as its word says."""

from __future__ import annotations

import sys
import time

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.core.checks import ending
from gossamer_fx.meshes.sheet import sheet

assert gx.__version__
comm = MPI.COMM_WORLD
how = sys.argv[1]
if how == "alone" and comm.rank == 1:
    sys.exit(3)
if how == "raised" and comm.rank == 1:
    raise SystemExit("a word")
if how == "all":
    time.sleep(comm.rank)
    sys.exit(3 + comm.rank)
if how == "one at the end":
    sys.exit(3 * comm.rank)
if how == "caught" and comm.rank == 1:
    try:
        sys.exit(4)
    except SystemExit:
        print("goes on")
if how == "error" and comm.rank == 1:
    raise ValueError("a word")
if how == "zero" and comm.rank == 1:
    sys.exit(0)
if how == "zero in a library" and comm.rank == 1:
    sys.exit()
if how == "goes on":
    # Longer than the patience of the rank that exits, in Python and in a library.
    ending.PATIENCE = 2.0
    if comm.rank == 1:
        sys.exit(0)
    end = time.monotonic() + 2 * ending.PATIENCE
    matrix = np.random.default_rng(1).random((300, 300))
    while time.monotonic() < end:
        np.linalg.eigvals(matrix)
    time.sleep(2 * ending.PATIENCE)
    print("has gone on")
    sys.exit()
if how == "zero in a library":
    # Lets no other thread of Python go on while it waits.
    sheet(comm, 2, 2)
comm.barrier()
