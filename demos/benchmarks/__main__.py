"""Run times compared with those of others: ./gossamer bench NAME [--quick] [--runs N]; NAME `all` runs every problem.

`contact` runs `contact_cost`, too.

The contestants take turns, one thread each; of every figure the median over the runs is shown, times next to results.
Writes out/benchmarks/NAME.csv, and ends with a line `ratio PEER NUMBER` for each peer: its cost over this program's,
the smallest over the cases.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from comparison import compare
from problems import PROBLEMS


def main() -> int:
    parser = argparse.ArgumentParser(prog="gossamer bench", description=__doc__.splitlines()[0])
    parser.add_argument(
        "name", choices=[*PROBLEMS, "all"], metavar="NAME", help=", ".join([*PROBLEMS, "all"])
    )
    parser.add_argument("--quick", action="store_true", help="one small case")
    parser.add_argument("--runs", type=int, default=3, help="of which the median is taken")
    parser.add_argument(
        "--out", type=Path, default=Path("out/benchmarks"), help="folder of the tables"
    )
    wanted = parser.parse_args()
    parts = [name for name in PROBLEMS if wanted.name in (name, name.split("_")[0], "all")]
    for name in parts:
        problem = PROBLEMS[name]
        compare(
            name, problem, problem.quick if wanted.quick else problem.cases, wanted.runs, wanted.out
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
