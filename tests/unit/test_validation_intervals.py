"""Intervals of validation: what cases state, their arithmetic against closed forms, verdicts."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from demos.validation.__main__ import (
    CASES,
    MODELS,
    NAMES,
    PAGE,
    main,
    page_intervals,
    stored_changes,
    table_of_intervals,
    tables_of_uncertainties,
)
from demos.validation.engine.case import read_case
from demos.validation.engine.comparison import (
    Predicted,
    Prediction,
    compare,
    comparisons,
    results_by_test,
)
from demos.validation.engine.interval_report import (
    counted_intervals,
    headline,
    interval_picture,
    intervals_of_test,
)
from demos.validation.engine.intervals import (
    RIGHT,
    UNDETERMINED,
    WRONG,
    Interval,
    changes_of,
    combined,
    count,
    interval_of,
)
from demos.validation.engine.sensitivity import change_set, check_is_stated
from demos.validation.models import braided_tube, cord_plateau
from gossamer_fx import InputError
from gossamer_fx.analysis.cases.case_set import run_cases
from gossamer_fx.analysis.cases.results import Result
from tests.unit.test_validation import GOOD, case_of

# The load is 6 F r/a = 3 F D/a: 6 kN of a force of 1 kN, a diameter of 2 m and an arm of 1 m.
STATED = (
    GOOD
    + """
[[uncertainties]]
inputs = ["cord_force"]
standard = {value = 0.02, unit = "relative"}
kind = "measured scatter"
source = "nobody"
[[uncertainties]]
inputs = ["diameter"]
half_width = {value = 30, unit = "mm"}
kind = "tolerance"
source = "nobody"
[[uncertainties]]
quantity = "plateau load"
standard = {value = 0.1, unit = "kN"}
kind = "reading"
source = "nobody"
[exact]
arm = "the definition"
"""
)


def changes_by(case, comm, folder, quick=False, stored=()):
    return run_cases(change_set(case, comm, quick, "", stored), comm, folder, verbose=False)


def interval(case, results):
    """The interval of the one quantity about the prediction of 6 kN."""
    test = case.tests[0]
    [comparison] = comparisons(test, Result({"test": "one"}, {"y of plateau load": [6e3]}, 0.0))
    return interval_of(case, test, comparison, changes_of(case, test, results))


def test_a_linear_model_has_the_interval_of_the_closed_form(comm, folder, monkeypatch):
    """u² = (3 D/a u_F)² + (3 F/a u_D)² is exact where the load is linear in each input, by
    derivatives and by differences."""
    case = case_of(folder, STATED)
    exact = 2 * math.hypot(6 * 0.02, 6 * 0.03 / math.sqrt(3) / 2)
    by_derivatives = interval(case, changes_by(case, comm, folder / "derivatives"))
    monkeypatch.delattr(cord_plateau, "gradients")
    by_differences = interval(case, changes_by(case, comm, folder / "differences"))
    for found in (by_derivatives, by_differences):
        assert found.by_inputs == pytest.approx(exact, rel=1e-3)
        assert found.by_measurement == pytest.approx(0.2)
        # Nothing is known of another mesh.
        assert np.isnan(found.by_mesh).all() and found.half == pytest.approx(exact, rel=1e-3)
        assert found.width == pytest.approx(2 * exact / 5, rel=1e-3)
        # 6 ± 0.26 and 5 ± 0.2
        assert found.verdict == WRONG and found.share == 0


def test_inputs_that_change_together_are_added_before_they_are_squared(comm, folder):
    """A factor of F and D gives twice the relative change of one of them."""
    text = STATED.replace('["cord_force"]', '["cord_force", "diameter"]')
    without = text.index('[[uncertainties]]\ninputs = ["diameter"]')
    text = text[:without] + text[text.index("[[uncertainties]]\nquantity") :]
    case = case_of(folder, text)
    found = interval(case, changes_by(case, comm, folder / "together"))
    assert found.by_inputs == pytest.approx(2 * 6 * 2 * 0.02, rel=1e-3)


def test_another_mesh_widens_the_interval_and_is_kept_apart(comm, folder, monkeypatch):
    predict = cord_plateau.predict
    monkeypatch.delattr(cord_plateau, "gradients")

    def on_a_mesh(inputs, comm, quick):
        load = float(predict(inputs, comm, quick).quantities["plateau load"].y)
        cells = inputs.whole("cells") if "cells" in inputs else 10
        return Prediction({"plateau load": Predicted(load * (1 + 1 / cells**2))})

    monkeypatch.setattr(cord_plateau, "predict", on_a_mesh)
    monkeypatch.setattr(cord_plateau, "OPTIONAL_INPUTS", {"cells": "1"}, raising=False)
    case = case_of(folder, STATED + "[finer]\ncells = 20\n")
    stored = [Result({"test": "one"}, {"y of plateau load": [6e3 * 1.01]}, 0.0)]
    [result] = changes_by(case, comm, folder / "mesh", stored=stored)
    mesh = result.numbers["mesh of plateau load"]
    assert mesh == [pytest.approx(6 * (1 / 100 - 1 / 400), rel=1e-3)]
    found = interval(case, [result])
    assert found.half == pytest.approx(math.hypot(found.by_inputs[0], mesh[0]))
    # Without a finer mesh it is the difference of the quick form from the stored prediction.
    case = case_of(folder, STATED)
    monkeypatch.setattr(cord_plateau, "predict", predict)
    [quick] = changes_by(case, comm, folder / "quick", quick=True, stored=stored)
    assert quick.numbers["mesh of plateau load"] == [pytest.approx(0.06, rel=1e-3)]


def test_an_input_without_a_solution_leaves_no_bound(comm, folder, monkeypatch):
    """Nor is it dropped: the prediction is undetermined."""
    predict = cord_plateau.predict
    monkeypatch.delattr(cord_plateau, "gradients")

    def at_one_force_only(inputs, comm, quick):
        if inputs.number("cord_force", "N") != 1e3:
            raise InputError("no solution.")
        return predict(inputs, comm, quick)

    monkeypatch.setattr(cord_plateau, "predict", at_one_force_only)
    case = case_of(folder, STATED)
    [result] = changes_by(case, comm, folder / "none")
    assert result.numbers["inputs of plateau load"] == []
    found = interval(case, [result])
    assert found.width == math.inf and found.verdict == UNDETERMINED


def test_a_curve_that_ends_early_with_a_larger_input_is_changed_by_a_smaller_one(
    comm, folder, monkeypatch
):
    monkeypatch.delattr(cord_plateau, "gradients")

    def up_to_its_input(inputs, comm, quick):
        last = inputs.number("cord_force", "N") / 1e6
        x = np.array([0.0, 2e-3 - last])
        return Prediction({"plateau load": Predicted(5e3 + 1e9 * (x - x[1] + 1e-3), x)})

    monkeypatch.setattr(cord_plateau, "predict", up_to_its_input)
    curve = 'y = {value = [4, 5], unit = "kN"}\nx = {value = [0, 1], unit = "mm"}'
    text = STATED.replace('y = {value = 5, unit = "kN"}', curve)
    case = case_of(folder, text)
    [result] = changes_by(case, comm, folder / "early")
    half = result.numbers["inputs of plateau load"]
    # The load at each deflection changes by 2 % of 1e9 N/m times 1 mm.
    assert len(half) == 21 and half == pytest.approx(21 * [2 * 0.02 * 1e3], rel=1e-3)


def made(y_predicted, half, y_measured, by_measurement):
    """An interval of values whose sizes are 100."""
    y_predicted = np.atleast_1d(np.asarray(y_predicted, dtype=float))
    shape = np.ones(len(y_predicted))
    return Interval(
        comparison=None,
        y_predicted=y_predicted,
        y_measured=y_measured * shape,
        sizes=100 * shape,
        by_inputs=half * shape,
        by_mesh=math.nan * shape,
        by_measurement=by_measurement * shape,
    )


def test_verdicts_at_their_borders():
    # The ends meet at 105.
    assert made(110, 5, 100, 5).verdict == RIGHT
    assert made(110.01, 5, 100, 5).verdict == WRONG
    # An interval of a fifth of the value is determined, and a wider one is not, wherever it is.
    assert made(100, 10, 100, 0).verdict == RIGHT
    assert made(100, 10.01, 100, 0).verdict == UNDETERMINED
    assert made(200, 10, 100, 0).verdict == WRONG
    assert made(200, 10.01, 100, 0).verdict == UNDETERMINED
    # What was not predicted is wrong, however little is known.
    assert made(math.nan, 50, 100, 5).verdict == WRONG
    # A twentieth of the points of a curve may be apart.
    apart = np.full(20, 100.0)
    apart[:1] = 200
    assert made(apart, 5, 100, 5).verdict == RIGHT
    apart[:2] = 200
    assert made(apart, 5, 100, 5).verdict == WRONG
    # Without a stated uncertainty of the measured value nothing overlaps with it.
    assert made(100, 5, 100, math.nan).verdict == WRONG


def test_the_verdicts_of_all_quantities_are_counted():
    intervals = [made(100, 5, 100, 5), made(100, 50, 100, 5), made(200, 5, 100, 5), None]
    assert count(intervals) == {RIGHT: 1, UNDETERMINED: 1, WRONG: 1, "": 1}


def test_changes_are_combined_in_quadrature():
    assert combined([np.array([3.0, 0.0]), np.array([4.0, -2.0])]) == pytest.approx([5.0, 2.0])
    assert combined([]) == 0


def test_a_share_of_a_curve_through_zero_is_that_of_its_reference(folder):
    curve = 'y = {value = [-2, 0, 4], unit = "kN"}\nx = {value = [-1, 0, 1], unit = "mm"}'
    text = STATED.replace('y = {value = 5, unit = "kN"}', f"{curve}\nreference = 4")
    text = text.replace('{value = 0.1, unit = "kN"}', '{value = 0.1, unit = "relative"}')
    case = case_of(folder, text)
    [measured] = case.tests[0].measured
    comparison = compare(
        measured, Predicted(1e3 * np.array([-2, 0, 4]), np.array([-1e-3, 0, 1e-3]))
    )
    found = interval_of(
        case,
        case.tests[0],
        comparison,
        Result({"form": "full"}, {"inputs of plateau load": [0.1] * 21}, 0.0),
    )
    assert found.by_measurement == pytest.approx(0.8)
    assert found.width == pytest.approx(2 * 0.1 / 4)


BAD = {
    "an unknown input": ('["cord_force"]', '["cord_farce"]', "cord_farce"),
    "an unknown quantity": ('quantity = "plateau load"\nstandard', 'quantity = "x"\nstandard', "x"),
    "both widths": ("standard = {value = 0.02", "half_width = {value = 1, unit = 'N'}\nstandard = "
                    "{value = 0.02", "give one of them"),
    "zero": ("value = 0.02", "value = 0", "give one > 0"),
    "an unknown unit": ('"relative"', '"parsec"', "unit is 'parsec'"),
    "another kind": ('"measured scatter"', '"guess"', "kind is 'guess'"),
    "no source": ('kind = "tolerance"\nsource = "nobody"', 'kind = "tolerance"', "'source'"),
    "twice": ('["diameter"]', '["cord_force"]', "several entries"),
    "exact and uncertain": ('arm = "the', 'cord_force = "the', "several entries"),
    "a test that there is not": ("inputs = [", 'tests = ["two"]\ninputs = [', "names of tests"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_a_bad_statement_is_refused_in_one_sentence(folder, name):
    old, new, words = BAD[name]
    assert old in STATED
    with pytest.raises(InputError) as refused:
        case_of(folder, STATED.replace(old, new, 1))
    assert words in str(refused.value) and "\n" not in str(refused.value)


def test_a_unit_of_another_dimension_is_refused(comm, folder):
    case = case_of(folder, STATED.replace('value = 30, unit = "mm"', 'value = 30, unit = "kPa"'))
    with pytest.raises(InputError, match="of the dimension of 'm'"):
        changes_by(case, comm, folder / "units")


@pytest.mark.parametrize(
    ("cut", "name"),
    [('arm = "the definition"\n', "arm"), ('quantity = "plateau load"\nstandard', "plateau load")],
)
def test_a_case_that_states_only_a_part_is_refused(comm, folder, cut, name):
    text = STATED.replace(cut, "" if name == "arm" else 'inputs = ["arm"]\nstandard', 1)
    if name != "arm":
        text = text.replace('arm = "the definition"\n', "").replace(
            '0.1, unit = "kN"', '1, unit = "mm"'
        )
    with pytest.raises(InputError, match=f"{name} have no uncertainty"):
        changes_by(case_of(folder, text), comm, folder / "part")


@pytest.mark.parametrize("name", NAMES)
def test_every_case_of_an_experiment_states_its_uncertainties(name):
    case = read_case(CASES / f"{name}.toml", MODELS)
    for test in case.tests:
        if any(one.evidence == "experiment" for one in test.measured):
            assert case.statement.uncertainties, "no uncertainty is stated"
            check_is_stated(case, test)


def test_a_case_without_a_statement_changes_each_number_by_a_per_cent(comm, folder):
    case = case_of(folder, GOOD)
    [result] = changes_by(case, comm, folder / "unstated")
    assert result.numbers["cord_force on plateau load"] == pytest.approx(0.01 * 6 / 5, rel=1e-3)
    assert result.numbers["bias of plateau load"] == pytest.approx(0.2)


def test_the_command_prints_intervals(folder, capsys):
    words = ["hiad_plateau", "--sensitivity", "--only", "2 up, 138", "--out", str(folder)]
    assert main(words) == 0
    printed = capsys.readouterr().out
    assert "| 2 up, 138 kPa | plateau load | cord_force |" in printed
    assert "| right | full |" in printed


def test_a_braid_of_another_angle_has_the_cord_force_of_the_formula():
    """F_c = p π r²/3 (1 - 2 cot²β) of the specimen of 60 degrees, when angle, pressure and diameter
    change one after another."""
    case = read_case(CASES / "hiad_60.toml", MODELS)
    values = case.tests[0].inputs.values
    changed = braided_tube.with_braid_angle(values, 61.0)
    changed = braided_tube.with_pressure(changed, 40.0)
    changed = braided_tube.with_diameter(changed, 345.0)
    exact = 40e3 * math.pi * 0.1725**2 / 3 * (1 - 2 / math.tan(math.radians(61.0)) ** 2)
    assert changed["cord_force"]["value"] == pytest.approx(exact, rel=2e-3)
    old, new = (one["A11"]["value"] * one["A22"]["value"] for one in (values, changed))
    # (G cot²β + E_L) G tan²β = G² + E_L G tan²β: the wall stays positive definite.
    assert new > changed["A12"]["value"] ** 2 and old > values["A12"]["value"] ** 2
    assert braided_tube.with_braid_angle(values, 59.78) == values


# ---- stored results and pages --------------------------------------------------------------------


def test_stored_intervals_are_those_of_the_present_inputs():
    """An input or an uncertainty that changes leaves intervals of something else, and the headline
    says how many quantities have none."""
    for case, results, changes in stored_changes():
        for test, _ in results_by_test(case, results):
            of_test = [one for one in changes if one.values["test"] == test.name]
            is_present = changes_of(case, test, changes) is not None
            assert is_present or not of_test, f"{case.name}, {test.name}: compute them again"
    every = [one for group in counted_intervals(stored_changes()).values() for one in group]
    without = every.count(None)
    assert (f"{without} have no interval" in headline(stored_changes())) == (without > 0)


def test_the_page_shows_the_stored_intervals():
    page = PAGE.read_text(encoding="utf-8")
    assert page_intervals() in page
    assert headline(stored_changes()) in page


def test_the_rows_of_intervals_count_every_test():
    every = sum(
        one is not None
        for case, results, changes in stored_changes()
        for test, result in results_by_test(case, results)
        for one in intervals_of_test(case, test, result, changes)
    )
    head_and_rule = 2
    assert len(table_of_intervals().splitlines()) == every + head_and_rule
    cells = [line.split(" | ") for line in page_intervals().splitlines()[head_and_rule:]]
    assert sum(int(row[3]) for row in cells) == every
    for row in cells:
        verdicts = [int(one.strip(" |")) for one in row[7:10]]
        assert sum(verdicts) == int(row[3])


def test_what_is_stated_is_shown_with_its_source():
    stated, exact = tables_of_uncertainties()
    assert "| hiad_71 | braid_angle | all | " in stated
    assert "| hiad_71 | deflection |" in exact


def test_the_picture_is_drawn(folder):
    case, results, changes = next(one for one in stored_changes() if one[2])
    interval_picture([(case, results, changes)], folder / "intervals.png")
    assert (folder / "intervals.png").read_bytes()[1:4] == b"PNG"
    # A case without intervals leaves an empty picture.
    interval_picture([(replace(case, name="x"), results, [])], folder / "none.png")
    assert (folder / "none.png").is_file()
