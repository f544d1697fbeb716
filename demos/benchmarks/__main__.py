"""Run times compared with those of others: ./gossamer bench NAME [--quick] [--runs N]; NAME `all`
runs every problem.

`contact` runs `contact_cost`, too.  `errors` runs all problems whose name begins with it: error
against CPU time on several meshes; with --store their results are those that docs/benchmark.md
shows.

The contestants take turns, one thread each; of every figure the median over the runs is shown,
times next to results.  Writes runs.csv, NAME.md and pictures to out/benchmarks/NAME, and prints a
line `ratio PEER NUMBER` for each peer: its cost over this program's, the smallest over the cases.
Ends with code 1 if a result is not as a problem declares, this program fails, a peer has no ratio,
or on a warning of this program that the problem does not expect.
"""

from __future__ import annotations

# First of all, so that no library reads the current folder.
import gossamer_fx  # noqa: F401

# isort: split
import argparse
import re
import sys
from pathlib import Path

from bench import PAGE, page_part, ratios, solve_errors, turns
from mpi4py import MPI
from problems import ERROR_PROBLEMS, PROBLEMS

from gossamer_fx.extend import errors_as_sentences, run_cases, verdict

# The part of the page that is written by this command.
BETWEEN = re.compile(r"(?<=<!-- benchmark -->\n).*?(?=<!-- /benchmark -->)", re.DOTALL)


def main() -> int:
    """Solve the problems that the command line names; returns 1 if one falls short."""
    about = (__doc__ or "").splitlines()[0]
    parser = argparse.ArgumentParser(prog="gossamer bench", description=about)
    names = [*PROBLEMS, "errors", *ERROR_PROBLEMS, "all"]
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
    if wanted.runs < 1:
        parser.error(f"--runs is {wanted.runs}; give 1 or more.")
    judgements = {}
    for name in ERROR_PROBLEMS:
        if wanted.name in (name, "errors", "all"):
            judgements[name] = solve_errors(
                name, wanted.runs, wanted.quick, wanted.out, wanted.store
            )
    if wanted.store:
        text = PAGE.read_text(encoding="utf-8")
        PAGE.write_text(BETWEEN.sub(lambda _: page_part(), text), encoding="utf-8")
    for name, problem in PROBLEMS.items():
        if wanted.name in (name, name.split("_")[0], "all"):
            cases = turns(name, problem, wanted.runs, wanted.quick)
            # Times are measured again, and not resumed: the machine or the program has changed.
            results = run_cases(cases, MPI.COMM_SELF, wanted.out / name, fresh=True)
            judgements[name] = cases.judgements(results)
            for peer, ratio in ratios(problem, results).items():
                print(f"ratio {peer} {ratio:.3g}")
    text, is_well = verdict(judgements)
    print(text)
    return 0 if is_well else 1


if __name__ == "__main__":
    with errors_as_sentences():
        sys.exit(main())
