"""Processes that share a sweep are killed: no run with a result is repeated, and all runs are
completed."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.hanging import HANG_TIMEOUT

ROOT = Path(__file__).parents[2]
DESIGN = """
import os, time
from pathlib import Path
import gossamer_fx as gx

def outcome(comm, folder, a, b):
    told = Path(__file__).with_name("told")
    with told.open("a") as file:
        print("begin", a, b, os.getpid(), file=file, flush=True)
        time.sleep(0.15)
        print("end", a, b, os.getpid(), file=file, flush=True)
    return {"y": a + b}

SWEEP = gx.sweep.Factorial(outcome, {"a": [1, 2], "b": [1, 2, 3]})
"""


def start(folder: Path) -> subprocess.Popen[bytes]:
    words = ["-m", "gossamer_fx", "sweep", str(folder / "design.py"), "-o", str(folder / "out")]
    return subprocess.Popen([sys.executable, *words], cwd=ROOT, stdout=subprocess.DEVNULL)


def test_any_process_may_be_killed(tmp_path):
    (tmp_path / "design.py").write_text(DESIGN)
    told = tmp_path / "told"
    chance = random.Random(4)
    runs = [start(tmp_path) for _ in range(3)]
    for _ in range(4):  # the first one, too
        time.sleep(chance.uniform(0.3, 0.8))
        victim = runs.pop(0)
        os.kill(victim.pid, signal.SIGKILL)
        victim.wait()
        runs.append(start(tmp_path))
    assert min(run.wait(timeout=HANG_TIMEOUT) for run in runs) == 0
    words = [line.split() for line in told.read_text().splitlines()]
    ended = [tuple(line[1:3]) for line in words if line[0] == "end"]
    assert {("1", "1"), ("2", "3")} <= set(ended) and len(set(ended)) == 6
    results = list((tmp_path / "out" / "runs").glob("*.json"))
    assert len(results) == 6 and all(json.loads(path.read_text())["numbers"] for path in results)
    # one that came to its end was made again only if its process was killed before the result was
    # written
    begun = [tuple(line[1:3]) for line in words if line[0] == "begin"]
    assert len(begun) <= 6 + 4 and len(ended) <= 6 + 2


# Each run waits until another process has begun one: both processes must take part, however late
# the machine starts the second.
TOGETHER = DESIGN.replace(
    "time.sleep(0.15)",
    "while len({line.split()[3] for line in told.read_text().splitlines()}) < 2: time.sleep(0.05)",
)


@pytest.mark.parametrize("jobs", [2])
def test_jobs_share_the_runs(tmp_path, jobs):
    (tmp_path / "design.py").write_text(TOGETHER)
    words = [
        "-m",
        "gossamer_fx",
        "sweep",
        str(tmp_path / "design.py"),
        "-o",
        str(tmp_path / "out"),
        "--jobs",
        str(jobs),
    ]
    ended = subprocess.run(
        [sys.executable, *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
        timeout=HANG_TIMEOUT,
    )
    assert "written to" in ended.stdout
    words = [line.split() for line in (tmp_path / "told").read_text().splitlines()]
    assert len(words) == 12 and len({line[3] for line in words}) == jobs
