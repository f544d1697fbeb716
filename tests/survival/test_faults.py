"""Faults of a run: a full disk, a removed folder, a function that fails. They are named, and no
data are lost."""

from __future__ import annotations

import csv
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from tests.survival.on_ranks import complete, complete_module, python
from tests.survival.scenes import DT, filled_tube, fluttering_sheet

COMM = MPI.COMM_WORLD
# A command that may mount file systems in a separate name space; others need a user name space for
# that.
MOUNTING = ["unshare", "--mount"]
if os.geteuid() != 0:
    MOUNTING.insert(1, "--map-root-user")


def meet(
    folder: Path, what: str, *options: str, ranks: int = 1
) -> subprocess.CompletedProcess[str]:
    return complete_module("faults", folder, what, *options, ranks=ranks)


def on_small_disk(
    folder: Path, script: str, what: str = "nothing", ranks: int = 1
) -> subprocess.CompletedProcess[str]:
    """Run a script in which `$mount` mounts a file system of 2 MB in memory on a folder, and `$run`
    is the program of faults; skip the test where no file system can be mounted."""
    variables = f"mount='{sys.executable} -m tests.survival.small_disk {folder}'; "
    program = " ".join([*python(ranks), "-m", "tests.survival.faults"])
    variables += f"run='{program} {folder} {what} fields'; "
    folder.mkdir()
    said = complete([*MOUNTING, "sh", "-c", f"{variables} $mount || exit 77; {script}"])
    if said.returncode == 77 or "unshare" in said.stderr:
        pytest.skip("no file system can be mounted here without privileges")
    return said


def rows(path: Path) -> list[int]:
    """Steps of a table, every row of which must be whole."""
    with path.open(newline="") as file:
        head, *body = list(csv.reader(file))
    assert all(len(row) == len(head) for row in body)
    return [int(row[head.index("step")]) for row in body]


def whole_checkpoints(folder: Path) -> list[str]:
    """Those there are; each can be restarted from."""
    names = sorted(p.name for p in folder.iterdir())
    for name in names:
        run = gx.Simulation(
            fluttering_sheet(MPI.COMM_SELF), gx.Midpoint(dt=DT), restart=folder / name
        )
        assert run.step == int(name.removeprefix("step-"))
    return names


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_full_disk_is_named_and_what_was_written_stays(tmp_path: Path, ranks: int) -> None:
    said = meet(tmp_path, "full", ranks=ranks)
    assert said.returncode == 3, said.stderr
    assert "Cannot write" in said.stdout and "File too large" in said.stdout
    assert "Traceback" not in said.stderr
    steps = rows(tmp_path / "ledger.csv")
    assert steps == list(range(len(steps))) and len(steps) >= 6
    names = whole_checkpoints(tmp_path / "checkpoints")
    assert names and names[-1] >= "step-00000004"


def test_a_full_disk_below_the_fields_is_named(tmp_path: Path) -> None:
    said = meet(tmp_path, "full", "fields")
    assert said.returncode == 3, said.stderr
    assert "Cannot write" in said.stdout
    assert whole_checkpoints(tmp_path / "checkpoints")


@pytest.mark.parametrize("ranks", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_restart_where_nothing_can_be_written_is_refused(tmp_path: Path, ranks: int) -> None:
    """In a sentence, with fields too, and all that was written is as it was."""
    assert meet(tmp_path, "nothing", "fields", ranks=ranks).returncode == 0
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    said = meet(tmp_path, "nothing", "fields", "restart", "no room", ranks=ranks)
    assert said.returncode == 3, said.stderr
    assert said.stdout.count("Cannot write") == 1 and "Traceback" not in said.stderr
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before
    assert meet(tmp_path, "nothing", "fields", "restart", ranks=ranks).returncode == 0
    assert rows(tmp_path / "ledger.csv") == list(range(61))


def test_a_restart_on_a_disk_that_is_full_is_refused(tmp_path: Path) -> None:
    """On a small file system in memory, where the system lets one be mounted."""
    assert meet(tmp_path / "run", "nothing", "fields").returncode == 0
    disk = tmp_path / "disk"
    said = on_small_disk(
        disk,
        f"cp -r {tmp_path}/run/. {disk} || exit 77;"
        f"head -c 3000000 /dev/zero > {disk}/filler 2> /dev/null; $run restart; code=$?;"
        f"rm {disk}/filler; [ $code = 3 ] && $run restart",
    )
    assert said.returncode == 0, said.stderr
    assert "Cannot write" in said.stdout and "No space left on device" in said.stdout


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize(
    ("what", "words"),
    [("full-disk", "No space left on device"), ("read-only", "Read-only file system")],
)
def test_a_disk_that_takes_no_more_during_a_run_is_named(
    tmp_path: Path, what: str, words: str, ranks: int
) -> None:
    """After six of twenty steps; a restart goes on when it can be written again."""
    disk = tmp_path / "disk"
    said = on_small_disk(
        disk, f"$run; code=$?; cp -r {disk}/. {tmp_path}; exit $code", what=what, ranks=ranks
    )
    assert said.returncode == 3, said.stdout + said.stderr
    assert said.stdout.count("Cannot write") == 1 and words in said.stdout
    assert "Traceback" not in said.stderr
    steps = rows(tmp_path / "ledger.csv")
    assert steps == list(range(len(steps))) and len(steps) >= 6
    assert whole_checkpoints(tmp_path / "checkpoints")[-1] >= "step-00000004"
    assert meet(tmp_path, "nothing", "fields", "restart", ranks=ranks).returncode == 0
    assert rows(tmp_path / "ledger.csv") == list(range(61))


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize(
    ("what", "words"),
    [
        ("ledger removed", "ledger.csv' (No such file or directory)"),
        ("folder removed", "(Not a directory)"),
    ],
)
def test_a_file_that_is_gone_is_named(tmp_path: Path, what: str, words: str, ranks: int) -> None:
    said = meet(tmp_path, what, ranks=ranks)
    assert said.returncode == 3, said.stderr
    assert words in said.stdout
    assert rows(tmp_path / "probes.csv")[:6] == [0, 1, 2, 3, 4, 5]


def test_an_error_of_one_rank_alone_ends_the_run(tmp_path: Path) -> None:
    said = meet(tmp_path, "one rank", ranks=2)
    assert said.returncode == 1
    assert "ZeroDivisionError: of this rank alone" in said.stderr
    assert "rank 1 failed alone" in said.stderr
    assert rows(tmp_path / "ledger.csv") == [0, 1, 2, 3, 4, 5, 6]
    assert whole_checkpoints(tmp_path / "checkpoints") == ["step-00000002", "step-00000004"]


def test_a_rank_that_cannot_write_does_not_wait_for_ever(tmp_path: Path) -> None:
    """The other rank is inside the library that writes, and waits for the first one."""
    said = meet(tmp_path, "stuck", ranks=2)
    assert said.returncode == 1
    assert "fields' (No space left on device)" in said.stderr
    assert "Rank 0 failed alone" in said.stderr
    assert whole_checkpoints(tmp_path / "checkpoints") == ["step-00000002", "step-00000004"]


@pytest.mark.parametrize("free", [0, 8, 24, 100])
def test_a_start_on_a_disk_that_is_full_says_so(tmp_path: Path, free: int) -> None:
    """With so many kB free: for nothing, an output, all but the first checkpoint, and some
    steps."""
    disk = tmp_path / "disk"
    said = on_small_disk(
        disk,
        f"head -c 3000000 /dev/zero > {disk}/filler 2> /dev/null;"
        f"truncate -s {(2048 - free) * 1024} {disk}/filler; $run; code=$?; rm {disk}/filler;"
        f"cp -r {disk}/. {tmp_path}; exit $code",
    )
    assert said.returncode == 3, said.stdout + said.stderr
    assert said.stdout.count("Cannot write") == 1
    assert "(No space left on device)" in said.stdout or free == 100
    assert "Traceback" not in said.stderr
    assert "terminate called" not in said.stderr
    # what is there is whole
    checkpoints = tmp_path / "checkpoints"
    names = whole_checkpoints(checkpoints) if checkpoints.is_dir() else []
    assert bool(names) == (free == 100)


def test_an_error_of_every_rank_is_raised_as_it_is(tmp_path: Path) -> None:
    said = meet(tmp_path, "every rank", ranks=2)
    assert "ZeroDivisionError: of all ranks" in said.stderr
    assert "alone" not in said.stderr


@pytest.mark.mpi(1)
@pytest.mark.parametrize("what", ["Ledger", "Probes", "VTU", "Checkpoints"])
def test_folders_that_cannot_be_made_are_refused_before_the_first_step(
    folder: Path, what: str
) -> None:
    if COMM.rank == 0:
        (folder / "file").write_text("")
    COMM.barrier()
    at = folder / "file" / "x.pvd"
    outputs = {
        "Ledger": [gx.Ledger(at)],
        "Probes": [gx.outputs.Probes(at, {"one": lambda run: 1.0})],
        "VTU": [gx.outputs.VTU(at)],
    }
    saves = gx.Checkpoints(at) if what == "Checkpoints" else None
    with pytest.raises(gx.InputError, match="Cannot write"):
        gx.Simulation(
            fluttering_sheet(COMM, 2),
            gx.Midpoint(dt=DT),
            outputs=outputs.get(what, []),
            checkpoints=saves,
        )


@pytest.mark.mpi
def test_a_valve_that_returns_no_number_is_named_and_the_state_before_is_saved(
    folder: Path,
) -> None:
    items = [item for item in filled_tube(COMM).items if item.name != "valve"]
    by_name = {item.name: item for item in items}
    bad = gx.Orifice(
        by_name["tank"],
        by_name["tube"],
        area=lambda t: 1e-8 if t < 5e-4 else float("nan"),
        name="valve",
    )
    run = gx.Simulation(gx.Scene(bad), gx.Midpoint(dt=2e-4), checkpoints=gx.Checkpoints(folder))
    with pytest.raises((gx.StepFailure, gx.InputError), match="valve"):
        run.run(until=2e-3)
    COMM.barrier()
    assert gx.run.latest_checkpoint(folder) is not None
    assert np.isfinite(run.system.unknowns.q0.array_r).all()
