"""The readers of files, words and requests, each with its examples and some changed ones."""

from __future__ import annotations

import sys

import pytest
from mpi4py import MPI

from tests.survival.on_ranks import complete


@pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="files are read by one rank")
def test_a_changed_input_gives_a_result_or_a_sentence() -> None:
    done = complete([sys.executable, "tools/fuzz.py", "--seconds", "0.5", "--seed", "7"])
    assert done.returncode == 0, done.stdout
    assert done.stdout.count(" 0 kinds of failures") == 16
