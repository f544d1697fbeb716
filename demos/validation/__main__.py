"""Compare predictions with measurements: python3 -m demos.validation NAME|FILE|all [--quick].

A case is a TOML file of demos/validation/cases, or one of your own of the same form.  For each test
this prints predicted and measured values, the error of a peer and ours; it writes FOLDER/NAME.json,
.md and .png.  Tests whose results are stored are not computed again.  Ends with code 1 if an error
is larger than the case asks, or, in the quick form, if a test fails.

With --set the tests have other inputs; with --sensitivity each input is changed in turn and the
errors are printed.

With --store the results are those that docs/measured.md shows: they go to demos/validation/results,
and the table of the page is made again from all that is there.
On two ranks: ./gossamer mpi 2 demos/validation NAME.
"""

from __future__ import annotations

import argparse
import math
import re
import sys
from pathlib import Path

from mpi4py import MPI

from demos.validation.engine.case import Case, read_case, with_inputs
from demos.validation.engine.report import figure, misses, table
from demos.validation.engine.results import Stored, read, result_path, run
from demos.validation.engine.sensitivity import sensitivities
from gossamer_fx.core.checks.errors import InputError, check, on_rank_zero

HERE = Path(__file__).resolve().parent
CASES = HERE / "cases"
STORED = HERE / "results"
PAGE = HERE.parent.parent / "docs" / "measured.md"
MODELS = sorted(p.stem for p in (HERE / "models").glob("*.py") if not p.stem.startswith("_"))
NAMES = sorted(path.stem for path in CASES.glob("*.toml"))
# The part of the page that is written by this command.
BETWEEN = re.compile(r"(?<=<!-- measured -->\n).*?(?=<!-- /measured -->)", re.DOTALL)


def main(words: list[str] | None = None) -> int:
    """Validate the cases that the command line names; returns 1 if something is missed."""
    comm = MPI.COMM_WORLD
    wanted = _parser().parse_args(words)
    check(
        not wanted.store or (not wanted.quick and wanted.name in (*NAMES, "all")),
        "--store is for full forms of the cases of demos/validation; leave --quick or the file "
        "out.",
    )
    check(
        not (wanted.store and wanted.set),
        "--store is for the inputs of the cases; leave --set out.",
    )
    changes = dict(_change(word) for word in wanted.set)
    # Sentences about errors that are too large, of all cases.
    missed = []
    folder = STORED if wanted.store else wanted.out
    for path in _paths(wanted.name):
        case = with_inputs(read_case(path, MODELS), changes)
        # Of all cases only those with such a test are run; a single case without one is refused.
        is_concerned = any(wanted.only in test.name for test in case.tests)
        if wanted.name == "all" and not is_concerned:
            continue
        case = case.with_only(wanted.only)
        if wanted.sensitivity:
            for line in sensitivities(case, comm, quick=wanted.quick, only=wanted.only):
                if comm.rank == 0:
                    print(line, flush=True)
            continue
        stored = run(case, folder, comm, quick=wanted.quick, only=wanted.only, fresh=wanted.fresh)
        missed += misses(case, stored, wanted.quick)
        if comm.rank == 0:
            _report(case, stored, folder, wanted.quick)
    if comm.rank == 0 and not wanted.sensitivity:
        if wanted.store:
            # Only this rank is here, so that an error need not be shared with others.
            on_rank_zero(MPI.COMM_SELF, write_page)
        if wanted.quick:
            # A coarse mesh need not predict well, so only failures count.
            all_well = "All tests ran; errors are judged in the full form."
        else:
            all_well = "All errors are within what the cases ask."
        print("\n".join(missed) or all_well)
    return 1 if missed else 0


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
        help="another number as an input, in the unit of the case; may be repeated",
    )
    parser.add_argument(
        "--sensitivity", action="store_true", help="the error with each input 1 %% larger"
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


def _report(case: Case, stored: Stored, folder: Path, quick: bool) -> None:
    """Print the table of a case, and write it and the figure next to the results."""
    text = table([(case, stored)], quick)
    path = result_path(folder, case, quick)
    # Stored results are shown by docs/measured.md, which has its own table.
    if folder != STORED:
        path.with_suffix(".md").write_text(text, encoding="utf-8")
    figure(case, stored, path.with_suffix(".png"), quick)
    print(f"{case.title}\nsource: {case.source}")
    if case.peer:
        print(f"peer: {case.peer}")
    print(text)


def page_table() -> str:
    """The table of the page, from the stored results of all cases."""
    found = []
    for name in NAMES:
        case = read_case(CASES / f"{name}.toml", MODELS)
        stored = read(result_path(STORED, case, quick=False), case)
        found.append((case, stored))
    return table(found)


def write_page() -> None:
    """Put the table into docs/measured.md."""
    if PAGE.is_file():
        text = PAGE.read_text(encoding="utf-8")
        PAGE.write_text(BETWEEN.sub(lambda _: f"\n{page_table()}\n", text), encoding="utf-8")


if __name__ == "__main__":
    try:
        sys.exit(main())
    except InputError as error:
        # All ranks raise the error, and one reports it.
        if MPI.COMM_WORLD.rank == 0:
            print(f"gossamer: {error}", file=sys.stderr)
        sys.exit(2)
