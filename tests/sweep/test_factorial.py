"""Plain sweeps: which runs are made, what their table says, and how they go on after an
interruption."""

from __future__ import annotations

import csv
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

import pytest
from matplotlib.figure import Figure
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.analysis.cases.case_set import SharedRuns
from gossamer_fx.analysis.cases.results import Result, shown_names, values_text
from gossamer_fx.app.cli.scene_sweep import values_of
from gossamer_fx.app.sweep.factorial import Factorial, run_factorial

ROOT = Path(__file__).resolve().parents[2]
SCENE = """
import gossamer_fx as gx


def build(comm, height=1.0, speed=0.0, kind="plain"):
    velocity = (speed, 0.0, 0.0)
    ball = gx.PointMass(2.0, (0.0, 0.0, height), velocity=velocity, comm=comm, name="ball")
    probes = {
        "z [m]": gx.probes.Position(ball.port(), "z"),
        "x [m]": gx.probes.Position(ball.port(), "x"),
    }
    fall = gx.Gravity(ball, (0.0, 0.0, -9.81))
    return gx.Case(gx.Scene(ball, fall), gx.Midpoint(dt=0.01), until=0.4, probes=probes)
"""


def product_of(comm: MPI.Intracomm, folder: Path, a: float, b: float) -> dict[str, float]:
    if a == b == 3:
        raise gx.StepFailure("It snapped.")
    return {"product": a * b}


def test_all_combinations_or_a_list() -> None:
    over = {"a": [1, 2], "b": [3, 4]}
    both = Factorial(product_of, over).cases()
    assert [(case["a"], case["b"]) for case in both] == [(1, 3), (1, 4), (2, 3), (2, 4)]
    listed = Factorial(product_of, over, listed=True).cases()
    assert [(case["a"], case["b"]) for case in listed] == [(1, 3), (2, 4)]


@pytest.mark.parametrize(
    "over, listed, words",
    [
        ({}, False, r"over is \{\}, of length 0"),
        ({"a": []}, False, "give numbers or words"),
        ({"a": [[1.0]]}, False, "give numbers or words"),
        ({"a": [1, 1]}, False, "in the sweep twice"),
        ({"a": [1, 2], "b": [1]}, True, "a has 2, b has 1"),
        ({name: list(range(30)) for name in "abc"}, False, "27000 runs"),
    ],
)
def test_what_makes_no_sweep_is_refused(over: dict, listed: bool, words: str) -> None:
    with pytest.raises(gx.InputError, match=words):
        Factorial(product_of, over, listed=listed)


@pytest.mark.mpi
def test_the_table_has_all_runs_and_failures(folder: Path) -> None:
    sweep = Factorial(product_of, {"a": [1, 3], "b": [2, 3, "4"][:2]})
    text = run_factorial(sweep, MPI.COMM_WORLD, folder)
    MPI.COMM_WORLD.barrier()
    assert text.startswith("4 runs") and "1 failed" in text
    assert "- a 3, b 3: It snapped." in text
    rows = list(csv.DictReader((folder / "runs.csv").open()))
    products = [row["product"] for row in rows]
    assert products == ["2.0", "3.0", "6.0", ""]
    assert (folder / "sweep.png").read_bytes()[1:4] == b"PNG"


@pytest.mark.parametrize(("count", "words"), [(12, ""), (13, "12 of 13 numbers")])
def test_a_picture_says_what_it_leaves_out(
    count: int, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, path, **options: drawn.append(figure))
    sweep = Factorial(lambda comm, folder, a: {f"n{k}": a for k in range(count)}, {"a": [1, 2]})
    run_factorial(sweep, MPI.COMM_SELF, tmp_path)
    assert len(drawn[0].axes) == 12
    assert drawn[0].get_suptitle().split(";")[0] == words


def test_an_extreme_that_is_the_last_value_is_not_drawn_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, path, **options: drawn.append(figure))

    def outcome(comm: MPI.Intracomm, folder: Path, a: float) -> dict[str, float]:
        return {"y at the end": a, "y smallest": -a, "y largest": a}

    run_factorial(Factorial(outcome, {"a": [1.0, 2.0]}), MPI.COMM_SELF, tmp_path)
    titles = [axes.get_title(loc="left") for axes in drawn[0].axes]
    assert [title for title in titles if title] == ["y at the end", "y smallest"]
    # Neither is it in the table, where extremes come last, too.
    assert shown_names([{"x smallest": 0.0, "x at the end": 1.0, "f": 2.0, "x largest": 1.0}]) == [
        "x at the end",
        "f",
        "x smallest",
    ]


def test_numbers_that_cover_each_other_are_one_line_by_the_rule_of_curves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What differs by less than a line's width in the panel is one line, also where the numbers are
    not equal."""
    drawn: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, path, **options: drawn.append(figure))
    shifts = {"p": 0.0, "q": 1e-3, "r": 0.1}

    def outcome(comm: MPI.Intracomm, folder: Path, a: float, kind: str) -> dict[str, float]:
        return {"y": a + shifts[kind]}

    over = {"a": [1.0, 2.0], "kind": list(shifts)}
    run_factorial(Factorial(outcome, over), MPI.COMM_SELF, tmp_path)
    [axes] = [axes for axes in drawn[0].axes if axes.get_title(loc="left") == "y"]
    assert [line.get_ydata()[0] for line in axes.lines] == [1.0, 1.1]
    assert {text.get_text() for text in axes.texts} == {"kind p; kind q", "kind r"}


def test_seeds_are_told_apart_by_their_last_digit() -> None:
    assert values_text({"seed": 1000001, "on": True, "E": 2.5e9}) == "seed 1000001, on 1, E 2.5e+09"


def test_words_of_the_command_line_are_values() -> None:
    assert values_of(["a=1,2.5", "kind=plain,fine", "on=True"]) == {
        "a": [1, 2.5],
        "kind": ["plain", "fine"],
        "on": [True],
    }


@pytest.mark.parametrize(
    "words, refused",
    [
        (["a"], "NAME=VALUE"),
        (["a="], "NAME=VALUE,VALUE"),
        (["1a=2"], "NAME=VALUE"),
        (["a=1", "a=2"], "has a twice"),
    ],
)
def test_other_words_are_refused(words: list[str], refused: str) -> None:
    with pytest.raises(gx.InputError, match=refused):
        values_of(words)


def test_a_disk_that_is_full_between_two_runs_ends_a_sweep(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No other process makes the runs that are left."""
    usual = resource.getrlimit(resource.RLIMIT_FSIZE)

    def fill_disk(result: Result) -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, usual[1]))

    monkeypatch.setattr(time, "sleep", lambda seconds: pytest.fail("it waits for another process"))
    shared = SharedRuns(MPI.COMM_SELF, tmp_path, product_of, progress=fill_disk)
    try:
        with pytest.raises(gx.InputError, match="Cannot write"):
            shared.results([{"a": 1.0, "b": 1.0}, {"a": 1.0, "b": 2.0}])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, usual)


# ---- the command ---------------------------------------------------------------------------------

alone = pytest.mark.skipif(
    "OMPI_COMM_WORLD_SIZE" in os.environ or "PMI_SIZE" in os.environ,
    reason="an mpirun cannot start another",
)


def command(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    (folder / "ball.py").write_text(SCENE) if not (folder / "ball.py").exists() else None
    return subprocess.run(
        [sys.executable, "-m", "gossamer_fx", "sweep", *words],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )


@alone
def test_a_scene_is_swept_and_only_new_runs_are_made(tmp_path: Path) -> None:
    first = command(tmp_path, "ball.py", "--over", "height=1,2", "speed=0.5")
    assert first.returncode == 0, first.stderr
    assert first.stderr.count("run with") == 2
    folder = tmp_path / "out" / "ball_sweep"
    rows = list(csv.DictReader((folder / "runs.csv").open()))
    for row in rows:
        # The midpoint rule is exact in a constant field: h - g t²/2.
        fallen = float(row["height"]) - 9.81 * 0.4**2 / 2
        assert float(row["z [m] at the end"]) == pytest.approx(fallen, abs=1e-12)
        assert float(row["x [m] largest"]) == pytest.approx(0.2, abs=1e-12)
    # The picture has room for the first columns.
    kinds = [name.split()[-1] for name in rows[0] if "[m]" in name]
    assert kinds == ["end"] * (len(kinds) // 3) + ["smallest", "largest"] * (len(kinds) // 3)
    second = command(tmp_path, "ball.py", "--over", "height=1,2,3", "speed=0.5")
    assert second.stderr.count("run with") == 1 and "height=3" in second.stderr
    # Each run is a folder that can be looked at.
    assert len(list((folder / "runs").glob("*/run.json"))) == 3


@alone
def test_arguments_that_are_not_varied_are_given_as_of_run(tmp_path: Path) -> None:
    for words in (["height=1,2"], ["height=1,2", "--list"]):
        done = command(tmp_path, "ball.py", "speed=0.5", "--over", *words)
        assert done.returncode == 0, done.stderr
        rows = list(csv.DictReader((tmp_path / "out" / "ball_sweep" / "runs.csv").open()))
        assert [row["speed"] for row in rows] == ["0.5", "0.5"]
    for words, said in (
        (("ball.py", "speed=1", "--over", "speed=1,2"), "speed is given twice, by 'speed=1'"),
        (("ball.py", "speed=1"), "NAME=VALUE gives arguments that are not varied; vary others"),
    ):
        refused = command(tmp_path, *words)
        assert refused.returncode == 2 and said in refused.stderr, refused.stderr


@alone
def test_a_run_that_was_killed_goes_on_from_its_checkpoint(tmp_path: Path) -> None:
    done = command(tmp_path, "ball.py", "--over", "height=1")
    assert done.returncode == 0, done.stderr
    [result] = (tmp_path / "out" / "ball_sweep" / "runs").glob("*.json")
    before = result.read_text()
    # As a process leaves it that is killed before it writes the result.
    result.unlink()
    again = command(tmp_path, "ball.py", "--over", "height=1")
    assert again.returncode == 0, again.stderr
    assert before.split('"seconds"')[0] == result.read_text().split('"seconds"')[0]


@alone
def test_bad_input_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    for words, said in (
        (
            ("ball.py", "--over", "heigth=1,2"),
            "takes no heigth; its arguments are: height, speed, kind.",
        ),
        (("ball.py", "--over", "height=1,2", "speed=1", "--list"), "height has 2, speed has 1."),
        (("ball.py", "--list"), "give --over NAME=VALUE,VALUE."),
        (("ball.py",), "has no SWEEP"),
    ):
        done = command(tmp_path, *words)
        assert done.returncode == 2 and said in done.stderr, done.stderr
        assert done.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()


@alone
def test_runs_of_another_scene_are_not_mixed_with_these(tmp_path: Path) -> None:
    assert command(tmp_path, "ball.py", "--over", "height=1").returncode == 0
    (tmp_path / "ball.py").write_text(SCENE.replace("2.0", "3.0"))
    done = command(tmp_path, "ball.py", "--over", "height=1,2")
    assert done.returncode == 2 and "before a change, or of another scene" in done.stderr
