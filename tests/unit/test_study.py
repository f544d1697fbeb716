"""The engine of studies, on a problem whose error is known."""

from __future__ import annotations

import dataclasses
import logging
import math
import sys

import pytest

import demos.studies.__main__ as command
from demos.studies.__main__ import NAMES, PAGE, study_of
from demos.studies.engine.spreads import SpreadStudy
from demos.studies.engine.study import Claim, Measure, Study, no_order
from gossamer_fx import InputError, NoEquilibrium
from gossamer_fx.analysis.cases.case_set import Judgement, changes, run_cases, verdict
from gossamer_fx.analysis.cases.results import Result
from tests.survival.on_ranks import complete

LOG = logging.getLogger("gossamer_fx")

CALLS = []


def problem(comm, order, cells):
    """2 + h^order; `nothing` is zero in every row."""
    CALLS.append((order, cells))
    if cells == 13:
        raise NoEquilibrium("unlucky")
    if cells == 17:
        LOG.warning("prime")
    return {"y": 2 + (1 / cells) ** order, "nothing": 0.0, "seconds": 1e-3 * cells}


STUDY = Study(
    "toy",
    "A toy",
    problem,
    {"order": [1, 2], "cells": [2, 4, 8]},
    lambda case: 1 / case["cells"],
    (Measure("y", 2.0, 0.1, lambda case: float(case["order"])),),
    quick={"cells": [2, 4]},
    columns="seconds",
)


def run(study, folder, comm, quick=False):
    return run_cases(study.case_set(comm, quick), comm, folder, verbose=False)


def shortfalls(study, comm, results, quick=False):
    found = study.case_set(comm, quick).judgements(results)
    return [one.words for one in found if not one.holds]


@pytest.mark.mpi
def test_an_interrupted_study_goes_on_where_it_stopped(comm, folder):
    CALLS.clear()
    run(STUDY, folder, comm, quick=True)
    assert CALLS == [(1, 2), (1, 4), (2, 2), (2, 4)]
    results = run(STUDY, folder, comm)
    assert CALLS[4:] == [(1, 8), (2, 8)]
    assert [r.numbers["y"] for r in results] == [2.5, 2.25, 2.125, 2.25, 2.0625, 2.015625]
    assert not shortfalls(STUDY, comm, results)
    comm.barrier()
    table = (folder / "toy.md").read_text()
    assert "| 2 | 8 | 2.01562 | 0.0078 | 2.0 | 0.008 |" in table
    assert (folder / "toy.png").read_bytes()[1:4] == b"PNG"
    assert len((folder / "runs.csv").read_text().splitlines()) == 1 + 6


def test_the_summary_tells_the_largest_errors_and_the_spread_of_orders(comm, folder):
    [row] = STUDY.summary(run(STUDY, folder, comm))
    assert row == ["toy", "y", "0.062; 1.0 to 2.0", "", "0.008"]


def test_a_result_without_numbers_is_not_in_the_summary_and_picture(comm, folder):
    def given_up(comm, order, cells):
        figures = problem(comm, order, cells)
        return dict.fromkeys(figures, math.nan) if (order, cells) == (2, 8) else figures

    study = dataclasses.replace(STUDY, problem=given_up)
    results = run(study, folder, comm)
    [row] = study.summary(results)
    assert row == ["toy", "y", "0.062; 1.0 to 2.0", "", "0.004 to 0.008"]
    # The comparison of that case still falls short.
    assert "y, order 2, cells 8: error nan > 0.1" in shortfalls(study, comm, results)


def test_a_finer_case_is_the_last_of_its_curve_and_is_judged(comm, folder):
    demanding = dataclasses.replace(
        STUDY,
        axes={"order": [1], "cells": [2, 4]},
        measures=(Measure("y", 2.0, 0.1),),
        finer=[{"order": 1, "cells": 8}],
    )
    results = run(demanding, folder, comm)
    assert [result.values["cells"] for result in results] == [2, 4, 8]
    assert not shortfalls(demanding, comm, results)
    coarse = dataclasses.replace(demanding, finer=())
    assert shortfalls(coarse, comm, results[:2]) == ["y, order 1, cells 4: error 0.12 > 0.1"]
    assert len(demanding.case_set(comm, quick=True).cases) == 2


def test_what_falls_short_is_said_in_the_quick_form_too(comm, folder):
    demanding = dataclasses.replace(STUDY, measures=(Measure("y", 2.0, 1e-2, lambda case: 2.0),))
    assert (
        shortfalls(demanding, comm, run(demanding, folder, comm))
        == [
            "y, order 1, cells 8: error 0.062 > 0.01",
            "y, order 1, cells 8: order 1.00, expected 2",
            "y, order 2, cells 8: error 0.0078 > 0.01",
        ][:2]
    )
    quick = shortfalls(demanding, comm, run(demanding, folder, comm, quick=True), quick=True)
    assert quick[0] == "y, order 1, cells 4: error 0.12 > 0.01"
    # Declared for the mesh of the quick form, and orders not expected there.
    measure = Measure("y", 2.0, 1e-2, lambda case: 2.0, 0.13, is_quick_asymptotic=False)
    coarse = dataclasses.replace(STUDY, measures=(measure,))
    assert not shortfalls(coarse, comm, run(coarse, folder, comm, quick=True), quick=True)


def test_rows_that_show_nothing_and_studies_that_compare_nothing_fall_short(comm, folder):
    empty = dataclasses.replace(STUDY, measures=(), shows=("y", "nothing", "unknown"))
    results = run(empty, folder, comm)
    assert shortfalls(empty, comm, results) == [
        "nothing: zero or missing in every row",
        "unknown: zero or missing in every row",
    ]
    silent = dataclasses.replace(STUDY, measures=())
    words = shortfalls(silent, comm, results)
    assert words == ["nothing is compared with a declared value"]


@pytest.mark.mpi
def test_a_warning_falls_short_unless_it_is_expected_with_a_reason(comm, folder):
    loud = dataclasses.replace(STUDY, axes={"order": [2], "cells": [16, 17]}, quick={})
    results = run(loud, folder, comm)
    assert [result.warnings for result in results] == [[], ["prime"]]
    [words] = shortfalls(loud, comm, results)
    assert words.endswith("undeclared warning: prime")
    expected = dataclasses.replace(loud, expected_warnings={"prim": "17 is prime"})
    assert not shortfalls(expected, comm, results)


def test_a_recorded_warning_is_printed_as_before():
    code = (
        "import logging; from gossamer_fx.analysis.cases.results import recorded_warnings\n"
        "with recorded_warnings() as found:\n"
        "    logging.getLogger('gossamer_fx').warning('prime')\n"
        "print(found)"
    )
    done = complete([sys.executable, "-c", code])
    assert (done.stdout, done.stderr) == ("['prime']\n", "prime\n")


def test_a_failed_case_is_kept_with_its_reason(comm, folder):
    unlucky = dataclasses.replace(STUDY, axes={"order": [2], "cells": [2, 13]}, quick={})
    for _ in range(2):
        CALLS.clear()
        results = run(unlucky, folder, comm)
        assert results[1].failed == "unlucky"
        assert math.isfinite(results[1].seconds)
    assert CALLS == []
    assert "order 2, cells 13, ranks 1: unlucky" in shortfalls(unlucky, comm, results)


def test_a_damaged_result_is_refused(comm, folder):
    run(STUDY, folder, comm, quick=True)
    next((folder / "runs").glob("*.json")).write_text("{}")
    with pytest.raises(InputError, match="is not the result of a run"):
        run(STUDY, folder, comm, quick=True)


def test_a_quick_axis_must_be_an_axis(comm, folder):
    with pytest.raises(InputError, match="quick"):
        run(dataclasses.replace(STUDY, quick={"meshes": [1]}), folder, comm, quick=True)


def test_success_is_said_only_of_what_was_compared(comm, folder):
    found = {"toy": STUDY.case_set(comm).judgements(run(STUDY, folder, comm))}
    assert verdict(found) == ("All 4 comparisons are as declared.", True)
    assert not verdict({})[1]
    failed = [Result({"order": 1, "cells": 2}, {}, 1.0, failed="it snapped")]
    text, is_well = verdict({"toy": STUDY.case_set(comm).judgements(failed)})
    assert not is_well and "toy: order 1, cells 2: it snapped" in text


@pytest.mark.parametrize("name", NAMES)
def test_every_study_declares_what_it_compares(name):
    study = study_of(name)
    assert study.name == name
    if isinstance(study, SpreadStudy):
        assert study.expected
        return
    compared = [m for m in study.measures if math.isfinite(m.tolerance) or m.rate is not no_order]
    assert compared or study.shows, "a study declares measures or what it shows"


def test_the_page_lists_all_studies_that_declare_measures():
    page = PAGE.read_text(encoding="utf-8")
    part = page.split("<!-- studies -->")[1].split("<!-- /studies -->")[0]
    listed = {line.split("|")[1].strip() for line in part.splitlines() if line.startswith("| ")}
    studies = {name: study_of(name) for name in NAMES}
    declared = {
        name for name, one in studies.items() if isinstance(one, SpreadStudy) or one.measures
    }
    assert declared <= listed


def test_the_page_changes_with_results_only(tmp_path, monkeypatch):
    page = tmp_path / "summary.md"
    before = PAGE.read_text(encoding="utf-8")
    page.write_text(before, encoding="utf-8")
    monkeypatch.setattr(command, "PAGE", page)
    rows = [line.split(" | ") for line in before.splitlines() if line.startswith("| crease |")]
    row = ["crease", *rows[0][1:4], "99"]
    other = ["crease", *rows[1][1:4], "99"]
    command.write_page({"crease": [row, other]})
    assert page.read_text(encoding="utf-8") == before
    command.write_page({"crease": [row]})
    after = page.read_text(encoding="utf-8")
    assert "| 99 |" in after
    assert len(after.splitlines()) == len(before.splitlines()) - 1


# ---- stored results ------------------------------------------------------------------------------


def compared(study, results, stored):
    """What differs from stored results."""
    found = changes(
        study.to_be_stored(results), stored, study.repeatability, study.compared_numbers
    )
    return [one.words for one in found if not one.holds]


def test_a_result_or_a_reference_that_changes_in_either_direction_is_noticed(comm, folder):
    results = run(STUDY, folder, comm)
    stored = STUDY.to_be_stored(results)
    assert compared(STUDY, results, stored) == []
    for factor in (0.8, 1.2):
        first = dataclasses.replace(results[0], numbers=results[0].numbers | {"y": factor * 2.5})
        [words] = compared(STUDY, [first, *results[1:]], stored)
        assert words.startswith("order 1, cells 2, ranks 1: y was 2.5 and is")
        measure = dataclasses.replace(STUDY.measures[0], reference=factor * 2.0)
        other = dataclasses.replace(STUDY, measures=(measure,))
        assert len(compared(other, results, stored)) == len(results)
    # Times are not results, and what vanishes but for round-off has not changed.
    other = [
        dataclasses.replace(one, numbers=one.numbers | {"seconds": 9.0, "nothing": 0.0})
        for one in results
    ]
    assert compared(STUDY, other, stored) == []


def test_what_never_happens_in_one_case_hides_no_change_of_the_others(comm, folder):
    results = run(STUDY, folder, comm)
    never = dataclasses.replace(results[-1], numbers=results[-1].numbers | {"y": math.inf})
    stored = STUDY.to_be_stored([*results[:-1], never])
    assert compared(STUDY, [*results[:-1], never], stored) == []
    assert len(compared(STUDY, results, stored)) == 1
    moved = dataclasses.replace(results[0], numbers=results[0].numbers | {"y": 3.0})
    assert len(compared(STUDY, [moved, *results[1:-1], never], stored)) == 1


def test_a_case_that_fails_or_lacks_a_number_has_changed(comm, folder):
    results = run(STUDY, folder, comm)
    stored = STUDY.to_be_stored(results)
    failed = dataclasses.replace(results[0], numbers={}, failed="unlucky")
    assert "changed: unlucky" in compared(STUDY, [failed, *results[1:]], stored)[0]
    lacking = dataclasses.replace(results[0], numbers={"seconds": 1.0})
    assert len(compared(STUDY, [lacking], stored)) == 2


def test_known_misses_do_not_hide_new_ones():
    known = [Judgement("y, cells 8: error 0.2 > 0.1", False), Judgement("z: 3 > 2", True)]
    text, is_well = verdict(
        {"toy": [Judgement("y, cells 8: error 0.21 > 0.1", False)]}, {"toy": known}
    )
    assert is_well and "(known)" in text and "no new miss" in text
    text, is_well = verdict({"toy": [Judgement("z: 4 > 2", False), known[0]]}, {"toy": known})
    assert not is_well and text.endswith("toy: z: 4 > 2")


def test_claims_of_pages_are_judged(comm, folder):
    claims = (
        Claim("y", 2.4, 2.6, {"order": 1, "cells": 2}),
        Claim("y", 2.0, 2.1, {"cells": 4}),
    )
    claiming = dataclasses.replace(STUDY, claims=claims)
    short = shortfalls(claiming, comm, run(claiming, folder, comm))
    assert short == ["y, order 1, cells 4, ranks 1: 2.25, claimed 2 to 2.1"]
