"""Runs that are killed: at any moment, by any signal, or one rank of two."""

from __future__ import annotations

import contextlib
import csv
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.records.outputs.vtu import read_records
from gossamer_fx.records.outputs.vtu_format import read_vtu
from tests.hanging import HANG_TIMEOUT
from tests.survival import on_ranks
from tests.survival.on_ranks import python

STEPS = 24


def start(ranks: int, folder: Path, *options: str, steps: int = STEPS) -> subprocess.Popen[str]:
    """The tube on some ranks; each rank in a separate session."""
    command = [*python(ranks), "-m", "tests.survival.tube_run", str(folder), str(steps), *options]
    return on_ranks.start(command, start_new_session=True)


def whole(folder: Path) -> Path:
    """The run that nobody interrupts."""
    out = folder / "whole"
    words = start(1, out).communicate(timeout=HANG_TIMEOUT)
    assert (out / "end.txt").is_file(), words
    return out


def ranks_of(run: subprocess.Popen[str]) -> list[int]:
    """Process numbers of the Python programs of a run."""
    found = []  # with its folder
    # The last -m is that of the program, behind the launcher's; no other run has these words.
    first = len(run.args) - 1 - run.args[::-1].index("-m")
    program = [word.encode() for word in run.args[first:]]
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            words = (entry / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if words[1 : 1 + len(program)] == program and b"mpirun" not in words[0]:
            found.append(int(entry.name))
    return sorted(found)


def kill(run: subprocess.Popen[str]) -> None:
    """All of it, at once."""
    for number in [*ranks_of(run), run.pid]:
        with contextlib.suppress(ProcessLookupError):
            os.kill(number, signal.SIGKILL)
    run.communicate(timeout=HANG_TIMEOUT)


def agree(broken: Path, unbroken: Path, tolerance: float = 1e-7) -> None:
    """End state, rows and times of both runs are the same."""
    ours, theirs = (np.loadtxt(folder / "end.txt") for folder in (broken, unbroken))
    np.testing.assert_allclose(ours, theirs, rtol=tolerance, atol=1e-9)
    for name in ("ledger.csv", "gas.csv"):
        tables = []
        for folder in (broken, unbroken):
            with (folder / name).open() as file:
                tables.append(np.array(list(csv.DictReader(file)), dtype=object))
        times, steps = (
            [[float(row[key]) for row in table] for table in tables] for key in ("time", "step")
        )
        assert steps[0] == steps[1]
        np.testing.assert_allclose(times[0], times[1], rtol=1e-12)
    np.testing.assert_allclose(field_times(broken), field_times(unbroken), rtol=1e-12)
    left = sorted(p.name for p in (broken / "checkpoints").iterdir())
    assert all(re.fullmatch(r"step-\d{8}", name) for name in left), left


def field_times(folder: Path) -> list[float]:
    times: list[float] = []
    for part in read_records(folder / "tube.pvd"):
        times += part.times
        for record in range(len(part.times)):
            files = part.files(record)
            for file in files:
                assert np.isfinite(read_vtu(file).arrays["displacement [m]"]).all()
    return times


def wait_for(run: subprocess.Popen[str], happened: Callable[[], bool]) -> None:
    """As long as the run lives."""
    deadline = time.monotonic() + HANG_TIMEOUT
    while not happened():
        assert run.poll() is None and time.monotonic() < deadline, (run.kill(), run.communicate())
        time.sleep(0.05)


def rows(table: Path) -> int:
    return sum(1 for _ in table.open()) if table.is_file() else 0


def wait_until_ready(run: subprocess.Popen[str]) -> None:
    assert run.stdout is not None
    assert run.stdout.readline().strip() == "ready", run.communicate()[1]


@pytest.mark.slow
@pytest.mark.parametrize("ranks", [1, 2])
def test_killed_at_random_moments(tmp_path: Path, ranks: int) -> None:
    """25 times kill -9, anywhere between compilation and end; each restart goes on until the
    next."""
    reference = whole(tmp_path)
    rng = np.random.default_rng(ranks)
    killed = 0
    rounds = 0
    while killed < 25:
        out = tmp_path / f"run {rounds}"
        rounds = rounds + 1
        first = True
        while True:
            run = start(ranks, out, *([] if first else ["--restart"]))
            first = False
            wait_until_ready(run)
            try:
                run.communicate(timeout=float(rng.uniform(0.0, 2.5)))
            except subprocess.TimeoutExpired:
                kill(run)
                killed += 1
                continue
            assert run.returncode == 0
            break
        agree(out, reference)
    print(f"{killed} kills in {rounds} runs on {ranks} ranks")


@pytest.mark.parametrize(
    ("number", "ranks"), [(signal.SIGTERM, 1), (signal.SIGINT, 1), (signal.SIGTERM, 2)]
)
def test_a_signal_ends_the_run_after_its_step(
    tmp_path: Path, number: signal.Signals, ranks: int
) -> None:
    """To one rank of all; the checkpoint is that of the last step, and the run can go on."""
    out = tmp_path / "run"
    run = start(ranks, out, "--every", "1000", steps=100_000)
    wait_until_ready(run)
    wait_for(run, lambda: rows(out / "ledger.csv") >= 5)
    os.kill(ranks_of(run)[-1], number)
    _, said = run.communicate(timeout=HANG_TIMEOUT)
    told = re.search(
        rf"stopped by {number.name} at t = \S+ s, after step (\d+); restart from '(.*)'", said
    )
    assert told, said
    assert run.returncode == 128 + number
    with (out / "ledger.csv").open() as file:
        last = list(csv.DictReader(file))[-1]
    assert last["step"] == told[1] and Path(told[2]) == gx.run.latest_checkpoint(
        out / "checkpoints"
    )
    assert Path(told[2]).name == f"step-{int(told[1]):08d}"


ALONE = [sys.executable]
LAUNCHER = [sys.executable, "-P", "-m", "gossamer_fx.app.cli.launch", "2"]
PLAIN = python(2)


@pytest.mark.parametrize(
    ("number", "launch"),
    [
        (signal.SIGTERM, ALONE),
        (signal.SIGINT, ALONE),
        (signal.SIGTERM, LAUNCHER),
        (signal.SIGINT, LAUNCHER),
        (signal.SIGUSR1, PLAIN),
    ],
)
def test_a_signal_to_the_launcher_waits_for_a_long_step(
    tmp_path: Path, number: signal.Signals, launch: list[str]
) -> None:
    """Of two seconds, ten times what mpirun leaves its ranks."""
    run = on_ranks.start([*launch, "-m", "tests.survival.long_steps", str(tmp_path)])
    assert run.stdout is not None and "step" in run.stdout.readline()
    time.sleep(0.3)
    run.send_signal(number)
    _, said = run.communicate(timeout=HANG_TIMEOUT)
    assert run.returncode == 128 + number, said
    told = re.search(r"stopped by \w+ at t = \S+ s, after step (\d+); restart from", said)
    assert told, said
    newest = gx.run.latest_checkpoint(tmp_path / "saves")
    assert newest is not None and newest.name == f"step-{int(told[1]):08d}" and int(told[1]) >= 3
    assert json.loads((tmp_path / "run" / "run.json").read_text())["status"] == "stopped"


def test_a_rank_that_dies_ends_the_run_and_nothing_is_lost(tmp_path: Path) -> None:
    reference = whole(tmp_path)
    out = tmp_path / "run"
    run = start(2, out, steps=100_000)
    wait_until_ready(run)
    wait_for(run, lambda: rows(out / "ledger.csv") >= 10)
    os.kill(ranks_of(run)[-1], signal.SIGKILL)
    said = "".join(run.communicate(timeout=HANG_TIMEOUT))
    assert run.returncode != 0
    assert re.search(r"signal:? 9", " ".join(said.split()), re.IGNORECASE)
    again = start(1, out, "--restart")
    words = again.communicate(timeout=HANG_TIMEOUT)
    assert again.returncode == 0, words
    agree(out, reference)


def parents_of(numbers: list[int]) -> set[int]:
    """Process numbers of the parents of processes."""
    stats = [Path(f"/proc/{number}/stat").read_text() for number in numbers]
    return {int(stat.rpartition(")")[2].split()[1]) for stat in stats}


@pytest.mark.parametrize("victim", ["mpirun", "launcher", "rank"])
def test_no_rank_outlives_its_launcher(tmp_path: Path, victim: str) -> None:
    """As where memory runs out: what is killed cannot end the others, and must not lock the
    folder."""
    out = tmp_path / "run"
    command = [*LAUNCHER, "-m", "tests.survival.tube_run", str(out), "100000"]
    run = on_ranks.start(command, start_new_session=True)
    wait_until_ready(run)
    wait_for(run, lambda: rows(out / "ledger.csv") >= 3)
    ranks = ranks_of(run)
    assert len(ranks) == 2
    [mpirun] = parents_of(ranks)
    os.kill({"mpirun": mpirun, "launcher": run.pid, "rank": ranks[0]}[victim], signal.SIGKILL)
    deadline = time.monotonic() + HANG_TIMEOUT
    while ranks_of(run):
        assert time.monotonic() < deadline, "ranks are left"
        time.sleep(0.05)
    run.communicate(timeout=HANG_TIMEOUT)
    # The folder is free, and the run can go on.
    again = start(1, out, "--restart")
    words = again.communicate(timeout=HANG_TIMEOUT)
    assert again.returncode == 0, words
