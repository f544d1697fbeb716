"""A script that imports the package; its ranks exit as its word says."""

from __future__ import annotations

import sys
import time

from mpi4py import MPI

import gossamer_fx as gx

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
comm.barrier()
