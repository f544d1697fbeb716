"""Run studies: python3 -m demos.studies NAME [--quick] [--out FOLDER] [--fresh]; NAME `all` runs
every one.

Writes FOLDER/NAME/runs.csv, NAME.md and NAME.png, and for `all` the summary in docs/verification.md
between the lines `<!-- studies -->` and `<!-- /studies -->`.  What is in the folder already is not
computed again: an interrupted study goes on where it stopped.  Ends with code 1 if something is not
as a study declares, also in the quick form, and on every warning that a study does not expect.
On two ranks: ./gossamer mpi 2 demos/studies NAME [--quick].
"""

from __future__ import annotations

import argparse
import importlib
import re
import sys
from pathlib import Path

from mpi4py import MPI

from demos.studies.engine.study import SUMMARY_HEAD, Study
from gossamer_fx.analysis.cases.case_set import run_cases, verdict
from gossamer_fx.analysis.cases.results import markdown_table
from gossamer_fx.core.checks.errors import InputError

HERE = Path(__file__).parent
NAMES = sorted(path.stem for path in HERE.glob("*.py") if not path.stem.startswith("_"))
PAGE = HERE.parent.parent / "docs" / "verification.md"
# The part of the page that is written by this command.
BETWEEN = re.compile(r"(?<=<!-- studies -->\n).*?(?=<!-- /studies -->)", re.DOTALL)


def study_of(name: str) -> Study:
    """The study of a module of this folder."""
    found: Study = importlib.import_module(f"demos.studies.{name}").STUDY
    return found


def main(words: list[str] | None = None) -> int:
    """Compute the studies that the command line names; returns 1 if one falls short."""
    comm = MPI.COMM_WORLD
    about = (__doc__ or "").splitlines()[0]
    parser = argparse.ArgumentParser(prog="gossamer study", description=about)
    names = [*NAMES, "all"]
    parser.add_argument("name", choices=names, metavar="NAME", help=", ".join(names))
    parser.add_argument("--quick", action="store_true", help="fewer and smaller cases")
    parser.add_argument(
        "--out", type=Path, default=Path("out/studies"), help="folder of the results"
    )
    parser.add_argument("--fresh", action="store_true", help="compute everything again")
    wanted = parser.parse_args(words)
    comparisons = {}
    summaries = [SUMMARY_HEAD]
    for name in NAMES if wanted.name == "all" else [wanted.name]:
        study = study_of(name)
        cases = study.case_set(comm, wanted.quick)
        results = run_cases(cases, comm, wanted.out / name, fresh=wanted.fresh)
        comparisons[name] = cases.comparisons(results)
        summaries += study.summary(results)
    text, is_well = verdict(comparisons)
    if comm.rank == 0:
        # The page of verification shows full studies, and all of them.
        if wanted.name == "all" and not wanted.quick and PAGE.is_file():
            table = markdown_table(summaries)
            PAGE.write_text(BETWEEN.sub(lambda match: f"\n{table}\n", PAGE.read_text()))
        print(text)
    return 0 if is_well else 1


if __name__ == "__main__":
    try:
        sys.exit(main())
    except InputError as error:
        if MPI.COMM_WORLD.rank == 0:
            print(f"gossamer: {error}", file=sys.stderr)
        sys.exit(2)
