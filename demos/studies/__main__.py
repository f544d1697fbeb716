"""Run studies: python3 -m demos.studies NAME [--quick] [--out FOLDER] [--fresh]; NAME `all` runs
every one.

Writes FOLDER/NAME.csv, .md and .png, and for `all` the summary in docs/verification.md between the
lines `<!-- studies -->` and `<!-- /studies -->`.  What is in the CSV already is not computed again:
an interrupted study goes on where it stopped.  Ends with code 1 if something is not as a study
declares.  On two ranks:
./gossamer mpi 2 demos/studies NAME [--quick].
"""

from __future__ import annotations

import argparse
import importlib
import re
import sys
from pathlib import Path

from mpi4py import MPI

from demos.studies.engine.report import picture, shortfalls, summary, table
from demos.studies.engine.study import Study, run
from gossamer_fx.core.checks.errors import InputError

HERE = Path(__file__).parent
NAMES = sorted(path.stem for path in HERE.glob("*.py") if not path.stem.startswith("_"))
PAGE = HERE.parent.parent / "docs" / "verification.md"
# The part of the page that is written by this command.
BETWEEN = re.compile(r"(?<=<!-- studies -->\n).*?(?=<!-- /studies -->)", re.DOTALL)


def main() -> int:
    """Compute the studies that the command line names; returns 1 if one falls short of its
    references.
    """
    comm = MPI.COMM_WORLD
    parser = argparse.ArgumentParser(prog="gossamer study", description=__doc__.splitlines()[0])
    parser.add_argument(
        "name",
        choices=[*NAMES, "all"],
        metavar="NAME",
        help=", ".join([*NAMES, "all"]),
    )
    parser.add_argument("--quick", action="store_true", help="fewer and smaller cases")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("out/studies"),
        help="folder of the results",
    )
    parser.add_argument("--fresh", action="store_true", help="compute everything again")
    wanted = parser.parse_args()
    names = NAMES if wanted.name == "all" else [wanted.name]
    missing = []
    done = []
    for name in names:
        study: Study = importlib.import_module(f"demos.studies.{name}").STUDY
        if wanted.fresh and comm.rank == 0:
            for kept in (f"{name}.csv", f"{name}-quick.csv"):
                (wanted.out / kept).unlink(missing_ok=True)
        # No rank may read a file that another one is about to remove.
        comm.barrier()
        results = run(study, wanted.out, comm, wanted.quick)
        missing += [f"{name}: {words}" for words in shortfalls(study, results) if not wanted.quick]
        done.append((study, results))
        if comm.rank == 0:
            text = table(study, results)
            (wanted.out / f"{name}.md").write_text(text)
            if study.draw is not None:
                study.draw(results, wanted.out / f"{name}.png")
            elif study.measures:
                picture(study, results, wanted.out / f"{name}.png")
            print(text)
    if comm.rank == 0:
        # The page of verification shows full studies, and all of them.
        if wanted.name == "all" and not wanted.quick and PAGE.is_file():
            text = summary(done)
            PAGE.write_text(BETWEEN.sub(lambda match: f"\n{text}\n", PAGE.read_text()))
        print("\n".join(missing) or "Everything is as the studies declare.")
    return 1 if missing else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except InputError as error:
        if MPI.COMM_WORLD.rank == 0:
            print(f"gossamer: {error}", file=sys.stderr)
        sys.exit(2)
