"""Compare predictions with measurements: python3 -m demos.validation NAME|FILE|all [--quick].

A case is a TOML file of demos/validation/cases, or one of your own of the same form.  For each test
this prints predicted and measured values, the error of a peer and ours; it writes runs.csv, NAME.md
and NAME.png to FOLDER/NAME, in the quick form to FOLDER/NAME-quick.  Tests that have results there
are not computed again.  Ends with code 1 if a test fails, an error is larger than the case asks of
this form and the stored results have not missed that, too, a prediction differs from the stored one
in either direction, or on a warning that the case does not expect.

With --set the tests have other inputs.

With --sensitivity each input is changed in turn by its standard uncertainty, and tables show the
changes and the intervals of the predictions; in the quick form these are the changes of the quick
form about the stored predictions of the full one.  With --store in addition they are stored in
demos/validation/intervals, and the pages are written.

With --store the results are those that docs/measured.md shows: they go to demos/validation/results,
and from all that is there the table of the page (a row for each quantity), the sentences of
README.md and the picture of all cases are made again; "all --store --only none" computes nothing
and does only that.
On two ranks: ./gossamer mpi 2 demos/validation NAME.
"""

from __future__ import annotations

# First of all, so that no library reads the current folder.
import gossamer_fx  # noqa: F401

# isort: split
import argparse
import math
import re
import sys
from pathlib import Path

from mpi4py import MPI

from demos.validation.engine.case import Case, read_case, with_inputs
from demos.validation.engine.comparison import compared_numbers, results_by_test, with_measured
from demos.validation.engine.interval_report import (
    Stored,
    counted_intervals,
    exact_rows,
    headline,
    interval_picture,
    named_intervals,
    stated_rows,
    summary_rows,
    test_rows,
)
from demos.validation.engine.overview import accuracy_words, overview
from demos.validation.engine.report import figure, rows, summary
from demos.validation.engine.results import case_set
from demos.validation.engine.sensitivity import change_set
from gossamer_fx.extend import (
    InputError,
    Judgement,
    Result,
    changes,
    check,
    markdown_table,
    on_rank_zero,
    read_results,
    run_cases,
    verdict,
    write_results,
)

HERE = Path(__file__).resolve().parent
CASES = HERE / "cases"
STORED = HERE / "results"
# Changes of the predictions of each case by its inputs and by mesh and step.
CHANGES = HERE / "intervals"
ROOT = HERE.parent.parent
PAGE = ROOT / "docs" / "measured.md"
FIRST_PAGE = ROOT / "README.md"
OVERVIEW = STORED / "overview.png"
INTERVALS = STORED / "intervals.png"
MODELS = sorted(p.stem for p in (HERE / "models").glob("*.py") if not p.stem.startswith("_"))
NAMES = sorted(path.stem for path in CASES.glob("*.toml"))
# Largest relative change of a prediction from the stored one that another processor or library may
# cause: pages show three digits.
REPEATABILITY = 1e-3
# The part of a page that is written by this command.
BETWEEN = re.compile(r"(?<=<!-- measured -->\n).*?(?=<!-- /measured -->)", re.DOTALL)

BETWEEN_INTERVALS = re.compile(
    r"(?<=<!-- measured intervals -->\n).*?(?=<!-- /measured -->)", re.DOTALL
)


def main(words: list[str] | None = None) -> int:
    """Validate the cases that the command line names; returns 1 if something is missed."""
    comm = MPI.COMM_WORLD
    wanted = _parser().parse_args(words)
    is_full = not wanted.quick or wanted.sensitivity
    check(
        not wanted.store or (is_full and wanted.name in (*NAMES, "all")),
        "--store is for full forms of the cases of demos/validation; leave --quick or the file "
        "out.",
    )
    check(
        not (wanted.store and wanted.set),
        "--store is for the inputs of the cases; leave --set out.",
    )
    changes = dict(_change(word) for word in wanted.set)
    judgements: dict[str, list[Judgement]] = {}
    known: dict[str, list[Judgement]] = {}
    # An input that a case does not have is refused before anything is computed.
    cases = [with_inputs(read_case(path, MODELS), changes) for path in _paths(wanted.name)]
    for case in cases:
        # Of all cases only those with such a test are run; a single case without one is refused.
        is_concerned = any(wanted.only in test.name for test in case.tests)
        if wanted.name == "all" and not is_concerned:
            continue
        chosen = case.with_only(wanted.only)
        if wanted.sensitivity:
            _change_inputs(chosen, comm, wanted)
            continue
        judgements[case.name], known[case.name] = _validate(chosen, comm, wanted)
    if wanted.sensitivity:
        if wanted.store:
            on_rank_zero(comm, write_pages)
        return 0
    text, is_well = verdict(judgements, known)
    if comm.rank == 0:
        if wanted.store:
            write_pages()
        # Cases of which no test has such a name leave nothing to be compared.
        print(text if judgements else "No test has such a name.")
    return 0 if is_well or not judgements else 1


def _validate(
    case: Case, comm: MPI.Intracomm, wanted: argparse.Namespace
) -> tuple[list[Judgement], list[Judgement]]:
    """Compute, report and judge the tests of a case.

    Returns:
        judgements of the results, which in the full form of a case of this folder are compared with
        the stored ones, too; and those of the stored results, whose misses are known.
    """
    # Results of other inputs are other results.
    has_stored = not wanted.quick and not wanted.set and wanted.name in (*NAMES, "all")
    before = read_results(STORED / f"{case.name}.json", case.name) if has_stored else []
    # With --fresh what is stored is computed again; results of tests that are not chosen are kept.
    known = before if wanted.store and not wanted.fresh else []
    cases = case_set(case, comm, wanted.quick, wanted.only, known)
    folder = wanted.out / f"{case.name}{'-quick' * wanted.quick}"
    if comm.rank == 0:
        print(f"source: {case.source}" + f"\npeer: {case.peer}" * bool(case.peer))
    new = run_cases(cases, comm, folder, fresh=wanted.fresh)
    known_judgements = cases.judgements(before) if before else []
    if not wanted.store:
        differences = changes(with_measured(case, new), before, REPEATABILITY, compared_numbers)
        return [*cases.judgements(new), *differences], known_judgements
    by_test = {result.values["test"]: result for result in [*before, *new]}
    results = [result for _, result in results_by_test(case, list(by_test.values()))]
    results = with_measured(case, results)

    def store() -> None:
        write_results(STORED / f"{case.name}.json", case.name, results)
        figure(case, results, STORED / f"{case.name}.png")

    on_rank_zero(comm, store)
    return cases.judgements(results), known_judgements


def _change_inputs(case: Case, comm: MPI.Intracomm, wanted: argparse.Namespace) -> None:
    """Compute and print the changes of the predictions of a case, and store them if asked to."""
    is_own = wanted.name in (*NAMES, "all") and not wanted.set
    full = read_results(STORED / f"{case.name}.json", case.name) if is_own else []
    cases = change_set(case, comm, wanted.quick, wanted.only, full)
    folder = wanted.out / f"{case.name}-intervals{'-quick' * wanted.quick}"
    found = run_cases(cases, comm, folder, fresh=wanted.fresh)
    if comm.rank == 0:
        print(markdown_table(test_rows([(case, full, found)])))
    if not wanted.store:
        return
    path = CHANGES / f"{case.name}.json"

    def store() -> None:
        known = read_results(path, case.name) if path.is_file() else []
        by_test = {result.values["test"]: result for result in [*known, *found]}
        results = [result for _, result in results_by_test(case, list(by_test.values()))]
        write_results(path, case.name, results)

    on_rank_zero(comm, store)


def _parser() -> argparse.ArgumentParser:
    about = (__doc__ or "").splitlines()[0]
    parser = argparse.ArgumentParser(prog="gossamer validate", description=about)
    parser.add_argument(
        "name", metavar="NAME", help=f"a case file, 'all', or one of {', '.join(NAMES)}"
    )
    parser.add_argument("--quick", action="store_true", help="fewer tests, coarser meshes")
    parser.add_argument(
        "--out", type=Path, default=Path("out/validation"), help="folder of the results"
    )
    parser.add_argument("--only", default="", help="only tests whose name contains this")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="INPUT=NUMBER",
        help="another number as an input, in the unit of the case, or in SI units if it is "
        "left out there; may be repeated",
    )
    parser.add_argument(
        "--sensitivity",
        action="store_true",
        help="change each input by its standard uncertainty, and print the intervals",
    )
    parser.add_argument("--fresh", action="store_true", help="compute everything again")
    parser.add_argument(
        "--store", action="store_true", help="store the results that docs/measured.md shows"
    )
    return parser


def _change(word: str) -> tuple[str, float]:
    """Name and number of a word INPUT=NUMBER."""
    name, _, text = word.partition("=")
    # A word that is not a number is refused like a number that is not finite, by one message.
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    check(
        name.isidentifier() and math.isfinite(number),
        f"--set is '{word}'; give INPUT=NUMBER, e.g. pressure=69.",
    )
    return name, number


def _paths(name: str) -> list[Path]:
    """The case files of a name."""
    if name == "all":
        return [CASES / f"{one}.toml" for one in NAMES]
    if name in NAMES:
        return [CASES / f"{name}.toml"]
    check(
        Path(name).is_file(),
        f"There is no case '{name}'; give a TOML file, 'all', or one of {', '.join(NAMES)}.",
    )
    return [Path(name)]


def stored() -> list[tuple[Case, list[Result]]]:
    """All cases with their stored results."""
    found = []
    for name in NAMES:
        case = read_case(CASES / f"{name}.toml", MODELS)
        found.append((case, read_results(STORED / f"{name}.json", name)))
    return found


def stored_changes() -> list[Stored]:
    """All cases with their stored results and the stored changes of their predictions."""
    found = []
    for case, results in stored():
        path = CHANGES / f"{case.name}.json"
        known = read_results(path, case.name) if path.is_file() else []
        found.append((case, results, known))
    return found


def page_table() -> str:
    """The tables of the page: the count, and a row for each quantity of a case."""
    return f"{first_page_words()}\n\n{markdown_table(summary(stored()))}"


def page_intervals() -> str:
    """The table of intervals of the page: a row for each quantity of a case."""
    return markdown_table(summary_rows(stored_changes()))


def table_of_intervals() -> str:
    """The intervals of all tests, which the site has on a separate page."""
    return markdown_table(test_rows(stored_changes()))


def tables_of_uncertainties() -> tuple[str, str]:
    """What all cases state about inputs and measured values, and which inputs have no
    uncertainty."""
    cases = [case for case, _ in stored()]
    return markdown_table(stated_rows(cases)), markdown_table(exact_rows(cases))


def table_of_tests() -> str:
    """The table of all tests, which the site has on a separate page."""
    return markdown_table(rows(stored()))


def first_page_words() -> str:
    """The sentences of the first page about all cases."""
    intervals = stored_changes()
    words = accuracy_words(stored(), counted_intervals(intervals))
    return f"{words}\n{headline(intervals)}"


def write_pages() -> None:
    """Put tables and sentences into the pages, and draw all cases."""
    for page, place, part in (
        (PAGE, BETWEEN, page_table()),
        (PAGE, BETWEEN_INTERVALS, page_intervals()),
        (FIRST_PAGE, BETWEEN, first_page_words()),
    ):
        # An installed program has no pages.
        if page.is_file():
            old = page.read_text(encoding="utf-8")
            # A function, since backslashes in a replacement have a meaning.
            new = place.sub(lambda _, part=part: f"\n{part}\n", old)
            page.write_text(new, encoding="utf-8")
    overview(stored(), OVERVIEW)
    interval_picture(stored_changes(), INTERVALS)
    for case, results, found in stored_changes():
        # Cases without intervals were drawn when their results were stored.
        if found:
            intervals = named_intervals(case, results, found)
            figure(case, results, STORED / f"{case.name}.png", intervals)


if __name__ == "__main__":
    try:
        sys.exit(main())
    except InputError as error:
        # All ranks raise the error, and one reports it.
        if MPI.COMM_WORLD.rank == 0:
            print(f"gossamer: {error}", file=sys.stderr)
        sys.exit(2)
