"""Run times compared with those of others: ./gossamer bench NAME [--quick] [--runs N]; NAME `all`
runs every problem.

`contact` runs `contact_cost`, too.  `errors` runs all problems whose name begins with it: error
against CPU time on several meshes.  `model` predicts scaling from parts that it measures.  With
--store their results are those that docs/benchmark.md shows.

The contestants take turns, one thread each; of every figure the median over the runs is shown,
times next to results. Writes out/benchmarks/NAME.csv, and ends with a line `ratio PEER NUMBER` for
each peer: its cost over this program's, the smallest over the cases.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from comparison import compare
from error_curves import STORED, solve, write_page
from error_problems import ERROR_PROBLEMS
from problems import PROBLEMS
from scaling_model import predict


def main() -> int:
    parser = argparse.ArgumentParser(prog="gossamer bench", description=__doc__.splitlines()[0])
    names = [*PROBLEMS, "errors", *ERROR_PROBLEMS, "model", "all"]
    parser.add_argument("name", choices=names, metavar="NAME", help=", ".join(names))
    parser.add_argument("--quick", action="store_true", help="one small case")
    parser.add_argument("--runs", type=int, default=3, help="of which the median is taken")
    parser.add_argument(
        "--out", type=Path, default=Path("out/benchmarks"), help="folder of the tables"
    )
    parser.add_argument(
        "--store", action="store_true", help="store the errors that docs/benchmark.md shows"
    )
    wanted = parser.parse_args()
    if wanted.store and (wanted.quick or not wanted.name.startswith("errors")):
        parser.error("--store is for the full form of errors; leave it or --quick out.")
    for name in ERROR_PROBLEMS:
        if wanted.name in (name, "errors", "all"):
            folder = STORED if wanted.store else wanted.out
            solve(name, wanted.runs, wanted.quick, folder)
    if wanted.store:
        write_page()
    if wanted.name in ("model", "all"):
        predict(wanted.quick, wanted.out)
    parts = [name for name in PROBLEMS if wanted.name in (name, name.split("_")[0], "all")]
    for name in parts:
        problem = PROBLEMS[name]
        compare(
            name, problem, problem.quick if wanted.quick else problem.cases, wanted.runs, wanted.out
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
