"""Run studies: python3 -m demos.studies NAME [--quick] [--out FOLDER] [--fresh]; NAME `all` runs
every one.

Writes FOLDER/NAME/runs.csv, NAME.md and NAME.png, and in the full form the study's rows of the
table in demos/studies/summary.md, a page of the site.  What is in the folder already is not
computed again: an interrupted study goes on where it stopped.  Results are compared with those of
demos/studies/results, which --store writes.  Ends with code 1 if a result differs from the stored
one beyond its repeatability, in either direction, or is not as the study declares though the stored
one is, and on every warning that a study does not expect.  Known misses are printed.
On two ranks: ./gossamer mpi 2 demos/studies NAME [--quick].
"""

from __future__ import annotations

# First of all, so that no library reads the current folder.
import gossamer_fx  # noqa: F401

# isort: split
import argparse
import re
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from mpi4py import MPI

from demos.studies.engine.named import outcome_of, study_of
from demos.studies.engine.study import SUMMARY_HEAD
from gossamer_fx.extend import (
    Judgement,
    Result,
    changes,
    errors_as_sentences,
    markdown_table,
    on_rank_zero,
    read_results,
    run_cases,
    verdict,
    write_results,
)

HERE = Path(__file__).parent
NAMES = sorted(path.stem for path in HERE.glob("*.py") if not path.stem.startswith("_"))
PAGE = HERE / "summary.md"
# The part of the page that is written by this command.
BETWEEN = re.compile(r"(?<=<!-- studies -->\n).*?(?=<!-- /studies -->)", re.DOTALL)


def stored_file(name: str, quick: bool, processor: str = "") -> Path:
    """The stored results of the full or the quick form of a study; `processor` is a word for
    another one, on which folded film that moves chaotically ends elsewhere."""
    return HERE / "results" / f"{name}{'-quick' * quick}{processor and '.' + processor}.json"


def fewest_changes(
    study: Any, recorded: list[Result], name: str, quick: bool, axes: set[frozenset[str]]
) -> tuple[list[Judgement], list[Result]]:
    """What differs from the stored results of the processor whose results differ least, and these
    results.  Round-off is that of a processor, and a number has to be one of them."""
    first = stored_file(name, quick)
    found = []
    for file in (first, *sorted(first.parent.glob(f"{first.stem}.*.json"))):
        # Results of a study that had other axes are not results of this one.
        stored = [one for one in read_results(file, name) if frozenset(one.values) in axes]
        # One that lacks cases would find nothing wrong with them.
        if found and len(stored) < len(found[0][1]):
            continue
        differs = list(changes(recorded, stored, study.repeatability, study.compared_numbers))
        found.append((differs, stored))
    return min(found, key=lambda one: sum(not judgement.holds for judgement in one[0]))


def write_page(summaries: dict[str, list[list[str]]]) -> None:
    """Replace the rows of full studies whose results differ from those in the table of the page:
    run times differ each time, and alone leave the page as it is."""
    page = PAGE.read_text(encoding="utf-8")
    old = BETWEEN.search(page)
    lines = old[0].strip().splitlines() if old is not None else []
    found: dict[str, list[list[str]]] = {}
    # The first two lines are the headings.
    for line in lines[2:]:
        cells = [cell.strip() for cell in line.split("|")[1:-1]]
        found.setdefault(cells[0], []).append(cells)
    for name, rows in summaries.items():
        # The last column is the run time.
        if [row[:-1] for row in rows] != [row[:-1] for row in found.get(name, [])]:
            found[name] = rows
    table = markdown_table([SUMMARY_HEAD, *(row for name in sorted(found) for row in found[name])])
    PAGE.write_text(BETWEEN.sub(lambda match: f"\n{table}\n", page), encoding="utf-8")


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
    parser.add_argument(
        "-j", "--jobs", type=int, default=1, help="processes that share the cases, one rank each"
    )
    parser.add_argument(
        "--store", action="store_true", help="store the results with which later ones are compared"
    )
    parser.add_argument(
        "--processor", default="", metavar="WORD", help="with --store: next to those of another one"
    )
    wanted = parser.parse_args(words)
    executor = None
    if wanted.jobs > 1:
        # Forked processes would share the state of MPI.
        executor = ProcessPoolExecutor(wanted.jobs, mp_context=get_context("spawn"))
    judgements = {}
    known: dict[str, list[Judgement]] = {}
    summaries: dict[str, list[list[str]]] = {}
    for name in NAMES if wanted.name == "all" else [wanted.name]:
        study = study_of(name)
        cases = replace(study.case_set(comm, wanted.quick), outcome=partial(outcome_of, name))
        results = run_cases(cases, comm, wanted.out / name, fresh=wanted.fresh, executor=executor)
        recorded = study.to_be_stored(results)
        if wanted.store:
            file = stored_file(name, wanted.quick, wanted.processor)
            on_rank_zero(comm, partial(write_results, file, name, recorded))
        axes = {frozenset(case) for case in cases.cases}
        differs, stored = fewest_changes(study, recorded, name, wanted.quick, axes)
        judgements[name] = [*cases.judgements(results), *differs]
        known[name] = cases.judgements(stored) if stored else []
        summaries[name] = list(study.summary(results))
    text, is_well = verdict(judgements, known)
    if comm.rank == 0:
        if not wanted.quick and PAGE.is_file():
            write_page(summaries)
        print(text)
    return 0 if is_well else 1


if __name__ == "__main__":
    with errors_as_sentences():
        sys.exit(main())
