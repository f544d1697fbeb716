"""Effects of factors, best levels and refusals of robust designs, on outcomes that are formulas."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.analysis.cases.shared_runs import SharedRuns
from gossamer_fx.app.sweep.robust_design import RobustDesign, signal_to_noise
from gossamer_fx.app.sweep.sweep_report import run_design

CONTROL = {
    "a": [1, 2],
    "b": [1.0, 2.0, 4.0],
    "c": ["x", "y", "z"],
}


def decibels(comm, folder, a, b, c, n=0):
    """A number whose S/N is a sum of effects: 3 dB for a, 1 dB for each level of b, none of c; and
    noise."""
    if a == 2 and c == "z" and b == 4.0:
        raise gx.StepFailure("It snapped.")
    return {
        "y": 10 ** ((3 * a + math.log2(b)) / 20) * (1 + 0.1 * n),
        "spread": 10 + n / a,
    }


def design(**changes):
    given = {"outcome": decibels, "control": CONTROL, "goals": {"y": "smaller"}}
    return RobustDesign(**{**given, **changes})


@pytest.mark.parametrize(
    "goal, y, expected",
    [
        ("smaller", [1.0, 3.0], -10 * math.log10(5.0)),
        ("larger", [1.0, 0.5], -10 * math.log10(2.5)),
        ("nominal", [9.0, 10.0, 11.0], 20.0),
    ],
)
def test_ratios_are_those_of_the_definitions(goal, y, expected):
    assert signal_to_noise(goal, np.array(y)) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    "goal, y, words",
    [
        ("smaller", [0.0, 0.0], "the values of 'gap' with the goal 'smaller' are zero in all runs"),
        ("larger", [0.0, 1.0], "the values of 'gap' with the goal 'larger' are zero in a run"),
        ("nominal", [-1.0, 1.0], "the values of 'gap' with the goal 'nominal' have the mean zero"),
    ],
)
def test_zeros_without_a_ratio_are_refused_by_name(goal, y, words):
    with pytest.raises(gx.InputError, match=words):
        signal_to_noise(goal, np.array(y), "the values of 'gap'")


def test_the_ratio_of_equal_nominal_numbers_is_infinite():
    assert signal_to_noise("nominal", np.array([2.0, 2.0])) == math.inf


@pytest.mark.mpi
def test_effects_that_add_up_are_found_and_failures_are_told(comm, tmp_path):
    folder = comm.bcast(tmp_path)
    one = design()
    results = SharedRuns(comm, folder / "runs", decibels).results(one.cases())
    failed = [r for r in results if r.failed]
    assert len(results) == 18 and failed and {r.failed for r in failed} == {"It snapped."}
    gentle = design(control={"a": [1, 2], "b": [1.0, 2.0, 4.0]})
    results = SharedRuns(
        comm, folder / "gentle", lambda comm, folder, a, b: decibels(comm, folder, a, b, "x")
    ).results(gentle.cases())
    assert np.allclose(gentle.effects(results, "y")["a"], [-4.0, -7.0])
    assert np.allclose(np.diff(gentle.effects(results, "y")["b"]), -1.0)
    shares = gentle.shares(results, "y")
    assert sum(shares.values()) == pytest.approx(1.0) and shares["a"] > shares["b"]
    assert gentle.best(results, "y") == {"a": 1, "b": 1.0}
    assert gentle.before() == {"a": 1, "b": 2.0}
    assert gentle.predicted(results, "y", {"a": 2, "b": 4.0}) == pytest.approx(-8.0)


@pytest.mark.mpi
def test_a_design_is_run_reported_and_not_run_again(comm, tmp_path):
    folder = comm.bcast(tmp_path)
    made = []

    def outcome(comm, folder, **values):
        made.append(values)
        return decibels(comm, folder, **values)

    one = design(
        outcome=outcome,
        noise={"n": [-1, 1]},
        goals={"spread": "nominal", "y": "smaller"},
        usual={"a": 2},
    )
    text = run_design(one, comm, folder)
    # the usual levels, a 2, b 2, c y, are a row of the array; so are those of the best ones, or
    # they are not
    assert 36 <= len(made) <= 40 and "It snapped." in text and "a 2: " not in text
    assert "usual: a 2, b 2, c y" in text and "best: a 2" in text
    again = run_design(one, comm, folder)
    assert again == text and len(made) <= 40
    if comm.rank == 0:
        assert (folder / "main_effects.png").stat().st_size > 1000
        assert len((folder / "runs.csv").read_text().splitlines()) == 41
    damaged = SharedRuns(comm, folder / "runs", outcome)
    if comm.rank == 0:
        damaged.result_file(one.cases()[0]).write_text("{")
    comm.barrier()
    with pytest.raises(gx.InputError, match="not the result of a run"):
        damaged.results(one.cases())


@pytest.mark.parametrize(
    "changes, words",
    [
        ({"array": "L10"}, "no orthogonal array"),
        ({"control": {"a": [1, 2], "b": [1, 2]}}, "no column of 2 levels left for b"),
        ({"control": {"a": [1, 1]}}, "give different levels"),
        ({"control": {"a": [(1, 2), (3, 4)]}}, "numbers or words"),
        ({"noise": {"a": [1, 2]}}, "a is control and noise"),
        ({"goals": {}}, "no goal"),
        ({"goals": {"y": "best"}}, "give one of: smaller, larger, nominal"),
        ({"goals": {"y": "nominal"}}, "cannot vary without noise"),
        ({"usual": {"a": 7}}, "not a level of a control factor"),
        ({"outcome": 3}, "give a function"),
    ],
)
def test_bad_designs_are_one_sentence(changes, words):
    with pytest.raises(gx.InputError, match=words):
        design(**changes)


def test_outcomes_that_are_no_numbers_or_refuse_are_told(tmp_path):
    comm = MPI.COMM_SELF
    with pytest.raises(gx.InputError, match="let it return numbers"):
        SharedRuns(comm, tmp_path, lambda comm, folder, a: {"y": "large"}).results([{"a": 1}])

    def refuse(comm, folder, a):
        raise gx.InputError("a is too large.")

    with pytest.raises(gx.InputError, match=r"The run with a=1 is refused: a is too large\."):
        SharedRuns(comm, tmp_path, refuse).results([{"a": 1}])
