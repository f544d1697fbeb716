"""Every benchmark in its quick form: the contestants finish, agree, and are compared.

No run time is asserted: machines are shared.  The figures are read from `./gossamer bench NAME`.
"""

from __future__ import annotations

import csv
import importlib
import math
import os
import re
import runpy
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from mpi4py import MPI

from gossamer_fx.analysis.cases.results import Result
from tests.hanging import HANG_TIMEOUT

BENCHMARKS = Path(__file__).resolve().parents[2] / "demos" / "benchmarks"

pytestmark = pytest.mark.skipif(
    "OMPI_COMM_WORLD_SIZE" in os.environ or "PMI_SIZE" in os.environ,
    reason="an mpirun cannot start another",
)


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    """Solves a benchmark in its quick form: what it prints, and the rows of its table."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    main = runpy.run_path(str(BENCHMARKS / "__main__.py"))["main"]

    def solved(name: str) -> tuple[str, list[dict[str, str]]]:
        words = [name, "--quick", "--runs", "1", "--out", str(tmp_path)]
        monkeypatch.setattr(sys, "argv", ["bench", *words])
        code = main()
        said = capsys.readouterr().out
        assert code == 0, said
        with (tmp_path / name / "runs.csv").open() as file:
            rows = list(csv.DictReader(file))
        assert not any(row.get("failed") for row in rows), said
        return said, rows

    return solved


def differences(rows: list[dict[str, str]], figure: str) -> list[float]:
    """Of all programs from the first one, relative."""
    values = [float(row[figure]) for row in rows]
    return [abs(value / values[0] - 1) for value in values[1:]]


@pytest.mark.parametrize("name", ["scaling", "tube", "antenna"])
def test_cost_over_size_gives_exponents_and_a_chart(name, bench, tmp_path):
    said, rows = bench(name)
    assert len(rows) == 2 and all(float(row["ΔE/E"]) < 1e-8 for row in rows)
    exponent = re.search(r"exponent of a Newton iteration: (\S+)", said)
    small, large = (
        {key: float(row[key]) for key in ("dofs", "cost", "Newton/step")} for row in rows
    )
    growth = (large["cost"] / large["Newton/step"]) / (small["cost"] / small["Newton/step"])
    slope = math.log(growth) / math.log(large["dofs"] / small["dofs"])
    assert exponent and float(exponent[1]) == pytest.approx(slope, abs=1e-3)
    assert (tmp_path / name / f"{name}.png").read_bytes()[1:4] == b"PNG"


@pytest.mark.parametrize("name, peer", [("ranks", "one-rank"), ("direct", "direct")])
def test_other_ways_give_the_same_energy(name, peer, bench):
    said, rows = bench(name)
    assert {row["program"] for row in rows} == {"gossamer", peer}
    for figure in ("energy", "stored"):
        assert max(differences(rows, figure)) < 1e-8
    assert float(re.search(rf"^ratio {peer} (\S+)$", said, re.MULTILINE)[1]) > 0


def test_twice_the_sheet_on_twice_the_ranks(bench):
    _, (one, two) = bench("weak")
    measured = (one["program"], two["program"])
    assert measured == ("one-rank", "gossamer")
    assert float(two["dofs"]) == pytest.approx(2 * float(one["dofs"]), rel=0.01)


def test_the_pass_backwards_is_exact_and_costs_a_part_of_the_run(bench):
    _, (row,) = bench("gradient")
    assert float(row["energy's gradient off by"]) < 1e-6
    assert float(row["backward [s]"]) > 0
    assert int(float(row["parameters"])) > 100


def test_law_times_of_orthotropic_films_are_compared_with_isotropic_ones(bench):
    _, (row,) = bench("orthotropic")
    ratio = float(row["law [ms]"]) / float(row["isotropic law [ms]"])
    assert float(row["ratio"]) == pytest.approx(ratio)
    # A large bound, as so small a sheet on a loaded machine tells little.
    assert 0.3 < ratio < 6


def test_the_parts_of_a_newton_iteration_are_its_time(bench):
    _, (row,) = bench("profile")
    parts = [
        float(number)
        for key, number in row.items()
        if key.endswith("[ms]") and key != "iteration [ms]"
    ]
    assert len(parts) == 10 and min(parts[:-1]) > 0
    assert sum(parts) == pytest.approx(float(row["iteration [ms]"]), rel=1e-6)


@pytest.mark.skipif(
    "Open MPI" not in MPI.Get_library_version(), reason="messages of Open MPI alone are counted"
)
def test_messages_and_arithmetic_of_ranks_are_counted(bench, monkeypatch):
    # One rank would factorise so small a matrix in blocks, two do so by MUMPS.
    monkeypatch.setenv("PETSC_OPTIONS", "-gx_pc_type lu")
    _, (one, two) = bench("rank_counts")
    assert differences([one, two], "energy")[0] < 1e-8
    # Nothing is sent by a rank that is alone; arithmetic is all but divided.
    assert [float(one[what]) for what in ("messages", "MB", "collectives")] == [0, 0, 0]
    assert float(two["messages"]) > 10 and float(two["MB"]) > 0.01
    assert float(two["collectives"]) > float(two["of MUMPS"]) > 0
    assert float(two["Gflop"]) == pytest.approx(float(one["Gflop"]), rel=0.2)
    assert 1 <= float(two["flops, imbalance"]) <= 2


def test_speed_ups_are_predicted(bench):
    """They are of times of this machine, so that nothing more is asked of them here."""
    _, (row,) = bench("scaling_model")
    for unknowns in ("1e+05", "1e+06", "1e+07"):
        for cores in (2, 16, 128, 1024):
            assert 0 < float(row[f"{unknowns} on {cores}"]) < math.inf


def test_predicted_speed_ups_are_below_the_number_of_cores(monkeypatch: pytest.MonkeyPatch):
    """Of times that are given, proportional to the unknowns."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    model = importlib.import_module("scaling_model")

    def profile(n: int, steps: int) -> dict[str, float]:
        unknowns = 3.0 * (n + 1) ** 2
        parts = ("law", "residual", "tangent", "rest", "incomplete factorisation", "applications")
        parts += ("coarse matrix", "prolongations", "coarse factors", "coarse solutions")
        times = {f"{part} [ms]": 1e-3 * unknowns for part in parts}
        return times | {
            "dofs": unknowns,
            "Krylov/Newton": 5.0,
            "copy on several ranks [s]": 1e-8 * unknowns,
        }

    def factorised(coarse_unknowns: int, by_mumps: bool) -> tuple[float, float]:
        return 1e-7 * coarse_unknowns**1.5, 1e-8 * coarse_unknowns

    monkeypatch.setattr(model, "profile", profile)
    monkeypatch.setattr(model, "factorised", factorised)
    monkeypatch.setattr(model, "choose_levels", lambda levels: None)
    figures = model.scaling_model()
    for unknowns in ("1e+06", "1e+07"):
        for cores in (2, 16, 128):
            assert 1 < figures[f"{unknowns} on {cores}"] < cores
    # More unknowns divide better.
    assert figures["1e+07 on 128"] > figures["1e+05 on 128"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "name, peer",
    [
        ("sheet", "kratos"),
        ("airbag", "kratos"),
        ("airbag_fabric", "kratos"),
        ("pendulum", "exudyn"),
        ("shell_pendulum", "ngsolve"),
    ],
)
def test_peers_solve_the_same_problem(name, peer, bench):
    said, rows = bench(name)
    assert {row["program"] for row in rows} == {"gossamer", peer}
    assert float(re.search(rf"^ratio {peer} (\S+)$", said, re.MULTILINE)[1]) > 0


def test_a_contestant_that_fails_is_told_and_ends_nothing(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    from contestants import Failed, run

    with pytest.raises(Failed, match="dt is -1"):
        run("sheet", "gossamer", {"n": 4, "dt": -1}, HANG_TIMEOUT)
    with pytest.raises(Failed, match="not finished after"):
        run("sheet", "gossamer", {"n": 40, "steps": 1000, "ranks": 2}, 3)


def results_of(problem, **figures):
    """One row of this program and one of a peer, with figures of the peer."""
    own = {"cpu": 1.0, "cost": 1.0, "energy": 2.0, "ΔE/E": 1e-15}
    return [
        Result({"case": "small", "program": "gossamer", "run": 0}, own, 1.0),
        Result({"case": "small", "program": "kratos", "run": 0}, own | figures, 1.0),
    ]


def test_what_is_not_as_declared_makes_the_command_fail(monkeypatch):
    """The command returns 1 if one of these judgements does not hold."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    from bench import turns
    from problems import Problem

    problem = Problem(
        title="a problem",
        cost=["cpu"],
        unit="s",
        cases={"small": {"gossamer": {}, "kratos": {}}},
        quick={},
        peers=("kratos",),
        equal={"energy": 1e-8},
        limits={"ΔE/E": 1e-9},
    )
    cases = turns("a problem", problem, 1, quick=False)

    def missed(results):
        return [one.words for one in cases.judgements(results) if not one.holds]

    good = results_of(problem)
    assert not missed(good)
    [words] = missed(results_of(problem, energy=2.1))
    assert words == "small, kratos: energy differs by 5.0e-02 > 1e-08"
    [words] = missed([good[0], replace(good[1], numbers={}, failed="no convergence")])
    assert words == "no ratio to kratos: it failed"
    [words] = missed([replace(good[0], numbers=good[0].numbers | {"ΔE/E": 1e-3}), good[1]])
    assert words == "small, gossamer: ΔE/E 1.0e-03 > 1e-09"
    [words] = missed([replace(good[0], warnings=["normals point inwards"]), good[1]])
    assert words.endswith("undeclared warning: normals point inwards")
    own_failed = missed([replace(good[0], numbers={}, failed="it snapped"), good[1]])
    assert any("it snapped" in words for words in own_failed)
