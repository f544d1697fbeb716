"""The engine of validation: case files, errors, results, and the page made from them."""

from __future__ import annotations

import importlib
import json
import logging
import math
import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from demos.validation import __main__ as validation
from demos.validation.__main__ import (
    CASES,
    FIRST_PAGE,
    MODELS,
    NAMES,
    PAGE,
    first_page_words,
    main,
    page_table,
    stored,
    stored_changes,
    table_of_tests,
)
from demos.validation.engine.case import read_case, with_inputs
from demos.validation.engine.comparison import Predicted, compare, comparisons
from demos.validation.engine.interval_report import counted_intervals
from demos.validation.engine.overview import (
    count_rows,
    counted,
    is_right,
    marks_by_family,
    overview,
)
from demos.validation.engine.report import is_asked, percent, rows
from demos.validation.engine.results import case_set
from demos.validation.models import hanging_kite
from gossamer_fx import InputError
from gossamer_fx.analysis.cases.case_set import run_cases
from gossamer_fx.analysis.cases.results import Result, read_results, write_results

GOOD = """
format = 1
name = "tube"
title = "A tube"
source = "nobody"
licence = "none"
model = "cord_plateau"
[inputs]
arm = {value = 1000, unit = "mm"}
diameter = {value = 2, unit = "m"}
cords_up = "2"
[[tests]]
name = "one"
[tests.inputs]
cord_force = {value = 1, unit = "kN"}
[[tests.measured]]
quantity = "plateau load"
y = {value = 5, unit = "kN"}
tolerance = 0.1
peer_error = 0.3
"""


def case_of(folder: Path, text: str):
    path = folder / "case.toml"
    path.write_text(text, encoding="utf-8")
    return read_case(path, MODELS)


def run(case, folder, comm, quick=False):
    return run_cases(case_set(case, comm, quick), comm, folder, verbose=False)


def missed(case, comm, results, quick=False):
    found = case_set(case, comm, quick).judgements(results)
    return [one.words for one in found if not one.holds]


def test_units_are_converted_and_the_error_is_relative(comm, folder):
    case = case_of(folder, GOOD) if comm.rank == 0 else None
    case = comm.bcast(case)
    results = run(case, folder, comm)
    (comparison,) = comparisons(case.tests[0], results[0])
    # 2 · 3 F r/a = 2 · 3 kN · 1 m/1 m, compared with 5 kN
    assert comparison.y_predicted[0] == pytest.approx(6.0)
    assert comparison.mean_error == pytest.approx(0.2)
    assert not comparison.is_accepted()
    assert missed(case, comm, results) == ["one, plateau load: error 20.0 %, asked 10 %"]
    _, cells = rows([(case, results)])
    assert cells[3:8] == ["6 kN", "5 kN", "20.0 %", "10 %", "30.0 %"]


def test_the_quick_form_has_its_own_tolerance(comm, folder):
    case = case_of(folder, GOOD)
    results = run(case, folder, comm, quick=True)
    # What is asked of the full form is asked of the quick one, too, unless it is declared.
    [words] = missed(case, comm, results, quick=True)
    assert words == "one, plateau load: error 20.0 %, asked 10 %"
    text = GOOD.replace("tolerance = 0.1", "tolerance = 0.1\nquick_accepted = [0, 0.25]")
    case = case_of(folder, text)
    assert not missed(case, comm, results, quick=True)
    assert missed(case, comm, results)


def test_a_warning_needs_a_reason(comm, folder, monkeypatch):
    from demos.validation.models import cord_plateau

    predict = cord_plateau.predict

    def loud(*given):
        logging.getLogger("gossamer_fx").warning("normals point inwards")
        return predict(*given)

    monkeypatch.setattr(cord_plateau, "predict", loud)
    text = GOOD.replace("tolerance = 0.1", "tolerance = 0.3")
    case = case_of(folder, text)
    results = run(case, folder, comm)
    [words] = missed(case, comm, results)
    assert words.endswith("undeclared warning: normals point inwards")
    reason = '[expected_warnings]\n"normals point" = "a test of warnings"\n[inputs]'
    assert not missed(case_of(folder, text.replace("[inputs]", reason, 1)), comm, results)


def test_what_is_stored_is_not_computed_again_unless_inputs_change(comm, folder, monkeypatch):
    from demos.validation.models import cord_plateau

    calls = []
    predict = cord_plateau.predict
    monkeypatch.setattr(cord_plateau, "predict", lambda *given: calls.append(1) or predict(*given))
    for _ in range(2):
        run(case_of(folder, GOOD), folder, comm)
    assert len(calls) == 1
    # Measured values are not inputs.
    run(case_of(folder, GOOD.replace("value = 5", "value = 6")), folder, comm)
    assert len(calls) == 1
    run(case_of(folder, GOOD.replace("value = 2,", "value = 3,")), folder, comm)
    assert len(calls) == 2


def test_a_curve_is_compared_over_its_range(folder):
    x = list(range(11))
    curve = f'y = {{value = {[10 + k for k in x]}, unit = "N"}}\nx = {{value = {x}, unit = "mm"}}'
    text = GOOD.replace('y = {value = 5, unit = "kN"}', f"{curve}\nrange = [2, 8]")
    (measured,) = case_of(folder, text).tests[0].measured
    metres = np.linspace(0, 0.01, 7)
    good = compare(measured, Predicted(1.1 * (10 + 1e3 * metres), metres))
    assert good.mean_error == pytest.approx(0.1)
    assert good.x[0] == 2 and good.x[-1] == 8
    short = compare(measured, Predicted(np.array([10.0, 17.0]), np.array([0.0, 7e-3])))
    assert short.mean_error == math.inf and not short.is_accepted()
    assert compare(measured, None).mean_error == math.inf


def test_errors_of_a_curve_through_zero_are_relative_to_its_reference(folder):
    curve = 'y = {value = [-2, 0, 4], unit = "N"}\nx = {value = [-1, 0, 1], unit = "mm"}'
    text = GOOD.replace('y = {value = 5, unit = "kN"}', f"{curve}\nreference = 4")
    (measured,) = case_of(folder, text).tests[0].measured
    shifted = compare(measured, Predicted(np.array([-1.8, 0.2, 4.2]), np.array([-1e-3, 0, 1e-3])))
    assert shifted.errors == pytest.approx(0.05)
    # Tables show its largest value.
    assert shifted.y_measured[shifted.middle] == 4.0
    with pytest.raises(InputError, match="reference is 0; give a number > 0"):
        case_of(folder, text.replace("reference = 4", "reference = 0"))


def test_a_band_is_of_the_signed_error(folder):
    text = GOOD.replace("tolerance = 0.1", "accepted = [0.05, 0.25]")
    (measured,) = case_of(folder, text).tests[0].measured
    assert compare(measured, Predicted(6000.0)).is_accepted()
    assert not compare(measured, Predicted(4000.0)).is_accepted()


BAD = {
    "no TOML": ("format = 1", "format = = 1", "not a TOML file"),
    "another format": ("format = 1", "format = 2", "format is 2"),
    "a path as a name": ('"tube"', '"../../tube"', "name is '../../tube'"),
    "a model elsewhere": ('"cord_plateau"', '"os.system"', "model is 'os.system'"),
    "a model by path": ('"cord_plateau"', '"../engine/case"', "model is '../engine/case'"),
    "control characters": ('"A tube"', '"\\u001b[2J"', "give one line"),
    "an unknown key": ("title =", "titel = 1\ntitle =", "'titel'"),
    "an unknown unit": ('"mm"', '"parsec"', "unit is 'parsec'"),
    "another dimension": ('"mm"', '"kPa"', "dimension of 'm'"),
    "a word for a number": ("value = 1000", 'value = "1000"', "arm is '1000'"),
    "code for a number": ("value = 1000", "value = '__import__(\"os\")'", "give one number"),
    "infinity": ("value = 1000", "value = inf", "arm is inf"),
    "a negative length": ("value = 1000", "value = -1000", "arm is -1 m"),
    "a missing input": ('cords_up = "2"', "", "'cords_up' is missing"),
    "another word": ('cords_up = "2"', 'cords_up = "7"', "cords_up is '7'"),
    "nothing measured": (
        '[[tests.measured]]\nquantity = "plateau load"',
        "",
        "nothing is measured",
    ),
    "zero measured": ("value = 5", "value = 0", "zeros"),
    "both demands": ("tolerance = 0.1", "tolerance = 0.1\naccepted = [0, 1]", "one of them"),
    "a name twice": ("[[tests]]", '[[tests]]\nname = "one"\n[[tests]]', "nothing is measured"),
    "no tests": ("[[tests]]", "[[test]]", "unknown"),
    "an unknown quick test": ('name = "tube"', 'name = "tube"\nquick_tests = ["x"]', "quick_tests"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_case_file_is_refused_in_one_sentence(comm, folder, name):
    old, new, words = BAD[name]
    assert old in GOOD
    with pytest.raises(InputError) as refused:
        run(case_of(folder, GOOD.replace(old, new)), folder, comm)
    message = str(refused.value)
    assert words in message
    assert "\n" not in message and "\x1b" not in message and len(message) < 900
    assert not list(folder.glob("*.json"))


def test_deep_and_large_files_are_refused(folder):
    with pytest.raises(InputError, match="deep"):
        case_of(folder, "format = " + "[" * 100000)
    with pytest.raises(InputError, match="bytes"):
        case_of(folder, "#" * 5_000_000)
    with pytest.raises(InputError, match="There is no case file"):
        read_case(folder / "missing.toml", MODELS)


def test_results_of_something_else_are_not_used(folder):
    (folder / "tube.json").write_text('{"format": 2, "name": "kite", "results": []}')
    with pytest.raises(InputError, match="does not hold results of 'tube'"):
        read_results(folder / "tube.json", "tube")


def test_the_command_writes_table_results_and_picture(folder, capsys):
    assert main(["hiad_plateau", "--out", str(folder)]) == 0
    assert "All 18 comparisons are as declared." in capsys.readouterr().out
    found = [json.loads(path.read_text()) for path in folder.glob("hiad_plateau/runs/*.json")]
    by_test = {result["values"]["test"]: result["numbers"] for result in found}
    loads = by_test["2 up, 138 kPa"]["y of plateau load"]
    # 6 F_c r/a of the specimen
    assert loads == [pytest.approx(6 * 3114 * 0.339 / 2 / 1.1176, rel=1e-6)]
    assert (folder / "hiad_plateau/hiad_plateau.png").read_bytes()[1:4] == b"PNG"
    table = (folder / "hiad_plateau/hiad_plateau.md").read_text(encoding="utf-8")
    assert table.count("kPa") == 6


def test_a_chosen_test_runs_in_the_quick_form_too(folder, capsys):
    """A test that is not one of the quick form, on the mesh of the quick form."""
    words = ["hiad_plateau", "--quick", "--only", "2 up, 138", "--out", str(folder)]
    assert main(words) == 0
    assert "All 1 comparisons" in capsys.readouterr().out
    assert len(list((folder / "hiad_plateau-quick/runs").glob("*.json"))) == 1


def test_a_name_of_no_test_is_refused_and_all_skips_cases_without_it(folder):
    with pytest.raises(InputError, match="No test of 'hiad_plateau' has '3 up' in its name"):
        main(["hiad_plateau", "--only", "3 up", "--out", str(folder)])
    assert main(["all", "--only", "3 up", "--out", str(folder)]) == 0
    assert not list(folder.iterdir())


def test_results_of_tests_that_are_not_computed_stay_stored(folder, monkeypatch):
    """`--store --fresh` of one test replaces the result of this one."""
    before = read_results(validation.STORED / "hiad_plateau.json", "hiad_plateau")
    changed = [replace(one, numbers={**one.numbers, "y of plateau load": [1.0]}) for one in before]
    write_results(folder / "hiad_plateau.json", "hiad_plateau", changed)
    monkeypatch.setattr(validation, "STORED", folder)
    monkeypatch.setattr(validation, "write_pages", lambda: None)
    words = ["hiad_plateau", "--store", "--fresh", "--only", "2 up, 138", "--out", str(folder)]
    main(words)
    loads = {
        result.values["test"]: result.numbers["y of plateau load"]
        for result in read_results(folder / "hiad_plateau.json", "hiad_plateau")
    }
    assert len(loads) == len(before) == 6
    (new,) = loads.pop("2 up, 138 kPa")
    assert new > 1e3
    assert set(map(tuple, loads.values())) == {(1.0,)}


@pytest.mark.parametrize("name", ["hiad_plateau", "all"])
def test_an_input_that_a_case_has_not_is_refused_before_anything_is_computed(folder, name):
    with pytest.raises(InputError, match=r"Case '[a-z_]+' has no input 'q'; set one of [a-z_]+,"):
        main([name, "--set", "q=1", "--out", str(folder)])
    assert not list(folder.iterdir())


@pytest.mark.parametrize("model", MODELS)
def test_a_number_that_a_case_may_leave_out_can_be_set(model):
    module = importlib.import_module(f"demos.validation.models.{model}")
    source = Path(module.__file__).read_text(encoding="utf-8")
    asked = set(re.findall(r'"(\w+)" in inputs', source))
    # A list is an input that cannot be set.
    lists = set(re.findall(r'inputs\.numbers\("(\w+)"', source))
    assert asked - lists <= set(getattr(module, "OPTIONAL_INPUTS", ()))


def test_a_number_that_a_case_leaves_out_is_set_in_the_unit_of_its_model():
    case = with_inputs(read_case(CASES / "hanging_kite.toml", MODELS), {"tip_rope": 4.85})
    assert case.tests[0].inputs.number("tip_rope", "m") == 4.85
    # In that of the case otherwise: this one is in bar.
    case = with_inputs(case, {"pressure": 0.2})
    assert case.tests[0].inputs.number("pressure", "Pa") == pytest.approx(2e4)


def test_a_curve_may_begin_at_zero_outside_of_its_range(folder):
    curve = 'y = {value = [0, 5, 6], unit = "kN"}\nx = {value = [0, 1, 2], unit = "mm"}'
    text = GOOD.replace('y = {value = 5, unit = "kN"}', f"{curve}\nrange = [1, 2]")
    (measured,) = case_of(folder, text).tests[0].measured
    assert (
        compare(measured, Predicted(np.array([0.0, 12e3]), np.array([0.0, 2e-3]))).y_measured[0]
        == 5.0
    )
    with pytest.raises(InputError, match="zeros"):
        case_of(folder, text.replace("range = [1, 2]", ""))


@pytest.mark.parametrize("name", NAMES)
def test_the_cases_are_complete_and_have_results(name):
    case = read_case(CASES / f"{name}.toml", MODELS)
    assert case.name == name
    assert case.quick_tests


@pytest.mark.parametrize(
    ("page", "table"),
    [(PAGE, page_table), (FIRST_PAGE, first_page_words)],
    ids=["page", "first page"],
)
def test_the_pages_show_the_stored_results(page, table):
    assert table() in page.read_text(encoding="utf-8")


def test_the_picture_shows_every_test_and_a_miss_at_its_error(folder):
    found = marks_by_family(stored())
    marks = [mark for family in found.values() for mark in family]
    assert len(marks) == len(table_of_tests().splitlines()) - 2
    for mark in marks:
        assert abs(mark.ratio - 1) == pytest.approx(abs(mark.comparison.error))
        comparison = mark.comparison
        if not math.isfinite(comparison.measured.reference):
            assert mark.ratios == pytest.approx(comparison.y_predicted / comparison.y_measured)
            assert (mark.ratio >= 1) == (mark.ratios.mean() >= 1)
    # A torus shrinks by more than measured, which is a negative number.
    assert any((one.comparison.y_measured < 0).all() and one.ratios.min() > 1.05 for one in marks)
    # A test without a result of its quantity is drawn as failed.
    failed = case_of(folder, GOOD)
    nothing = Result({"test": "one"}, {}, 0.0)
    overview([*stored(), (failed, [nothing])], folder / "overview.png")
    assert (folder / "overview.png").read_bytes()[1:4] == b"PNG"


def test_what_is_no_prediction_is_not_counted():
    """Calibrated rows, closed forms and tests of other programs raise the count of experiments."""
    experiments = counted(stored(), "experiment")
    asked = [
        mark
        for family in marks_by_family(stored()).values()
        for mark in family
        if is_asked(mark.comparison.measured)
    ]
    left_out = [mark for mark in asked if mark.comparison.measured.not_counted]
    others = [mark for mark in asked if mark.comparison.measured.evidence != "experiment"]
    assert len(experiments) + len(left_out) + len(others) == len(asked)
    [*rows] = count_rows(stored(), counted_intervals(stored_changes()))
    right = sum(mark.comparison.is_accepted() for mark in experiments)
    assert rows[-1][1] == str(len(experiments)) and int(rows[-1][2]) <= right
    # No prediction has two verdicts.
    assert sum(map(int, rows[-1][5:])) <= len(experiments)


def test_a_quantity_on_a_coarse_mesh_is_a_miss(folder):
    found = case_of(folder, GOOD)
    [comparison, *_] = comparisons(
        found.tests[0], Result({"test": "one"}, {"y of plateau load": [1.0]}, 0.0)
    )
    exact = replace(comparison, y_predicted=comparison.y_measured)
    assert is_right(exact)
    coarse = replace(exact.measured, not_converged="twice the cells double the error")
    assert not is_right(replace(exact, measured=coarse))


def test_the_first_page_shows_the_worst_miss():
    errors = [
        abs(mark.comparison.error)
        for family in marks_by_family(stored()).values()
        for mark in family
        if is_asked(mark.comparison.measured)
    ]
    assert f"The worst miss is {percent(max(errors))}: " in first_page_words()


def test_the_rows_of_the_page_count_every_test():
    counted = re.findall(
        r"^\| [^|]+ \| [^|]+ \| \w+ \| [^|]+ \| (\d+) \| [^|]* \| (?:[-+.\de]+|failed) \|",
        # The second table: the first one counts kinds.
        page_table().split("| compared with |")[-1],
        re.MULTILINE,
    )
    # The table of all tests has two further lines: its head, and the rule below it.
    assert sum(map(int, counted)) == len(table_of_tests().splitlines()) - 2
    assert "| hiad_71 | load | 8 | 1.2 | 4.1 |" in page_table()


def test_the_page_names_every_input_of_a_specimen():
    page = PAGE.read_text(encoding="utf-8")
    for name in NAMES:
        data = tomllib.loads((CASES / f"{name}.toml").read_text(encoding="utf-8"))
        named = {one for test in data["tests"] for one in test.get("inputs", {})}
        # The braid angle is in the files of tubes for information: the stiffnesses contain it.
        missing = [one for one in named - {"braid_angle"} if f"`{one}`" not in page]
        assert not missing, f"{name}: {missing}"
        assert f"`{data['model']}`" in page


def test_the_specimen_of_the_page_is_read(folder):
    """The test that the page shows for a kite, after the inputs of the case file."""
    page = PAGE.read_text(encoding="utf-8")
    *_, block = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    head, *_ = (CASES / "hanging_kite.toml").read_text(encoding="utf-8").split("[[tests]]")
    head = head.replace('quick_tests = ["case 5"]', "")
    (test,) = case_of(folder, head + block).tests
    kite = hanging_kite.Kite.read(test.inputs)
    assert kite.pressure == pytest.approx(2e4)
    assert kite.tip_load == 3.0 and kite.point_load == 0.0
