"""Files belong to one run: a second run is refused, a forgotten restart deletes nothing, damage is
reported."""

from __future__ import annotations

import json
import os
import re
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from tests.hanging import HANG_TIMEOUT
from tests.survival import on_ranks
from tests.survival.on_ranks import python
from tests.survival.scenes import DT, Watch, fluttering_sheet

COMM = MPI.COMM_WORLD


def ball(**options: object) -> gx.Simulation:
    """A mass that falls: the smallest run there is."""
    mass = gx.PointMass(2.0, position=(0.0, 0.0, 1.0), comm=COMM)
    return gx.Simulation(
        gx.Scene(mass, gx.Gravity(mass, (0.0, 0.0, -9.81))), gx.Midpoint(dt=DT), **options
    )


def files(folder: Path) -> dict[str, bytes]:
    return {
        str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()
    }


# A run that says so in its second step, and waits there for a line of its input on rank 0.
WAITING = """
import sys, time
from pathlib import Path
from tests.survival.scenes import Watch
from tests.survival.test_other_runs import ball
import gossamer_fx as gx
folder = Path(sys.argv[1])
def wait(run):
    if run.step == 2 and run.comm.rank == 0:
        print("running", flush=True)
        sys.stdin.readline()
outputs = [gx.Recording(folder / "run", every=1), Watch(wait)]
ball(outputs=outputs, checkpoints=gx.Checkpoints(folder / "saves", every=1)).run(until=4e-3)
print("done", flush=True)
"""

# A second run in the same folder; each rank says why it was refused.
SECOND = """
import sys
from pathlib import Path
from tests.survival.test_other_runs import ball
import gossamer_fx as gx
try:
    ball(outputs=[gx.Recording(Path(sys.argv[1]) / "run", every=1)])
except gx.InputError as error:
    print(error, flush=True)
"""


def start(program: str, folder: Path, ranks: int = 1) -> subprocess.Popen[str]:
    command = [*python(ranks), "-c", program, str(folder)]
    return on_ranks.start(command, stdin=subprocess.PIPE, stderr=None)


@pytest.mark.parametrize("how", ["anew", "restart", "overwrite"])
def test_a_second_run_is_refused_and_the_first_goes_on(tmp_path: Path, how: str) -> None:
    first = start(WAITING, tmp_path)
    assert first.stdout is not None and first.stdout.readline() == "running\n"
    before = files(tmp_path)
    options = {"restart": tmp_path / "saves"} if how == "restart" else {}
    saves = gx.Checkpoints(tmp_path / "saves", overwrite=how == "overwrite")
    with pytest.raises(gx.InputError) as told:
        ball(outputs=[gx.Recording(tmp_path / "run", every=1)], checkpoints=saves, **options)
    assert re.search(
        rf"is being written by another run \(.*process {first.pid} on .*, since .*\); .*\.$",
        str(told.value),
    )
    assert files(tmp_path) == before
    said, _ = first.communicate("\n", timeout=HANG_TIMEOUT)
    assert said == "done\n" and first.returncode == 0
    left = {p.name for p in tmp_path.rglob(".*")}
    assert not left
    assert json.loads((tmp_path / "run" / "run.json").read_text())["status"] == "finished"
    ball(outputs=[gx.Recording(tmp_path / "run", every=1)], restart=tmp_path / "saves").run(
        until=5e-3
    )


@pytest.mark.parametrize("ranks", [1, 2])
def test_every_rank_of_a_second_run_reads_the_same_sentence(tmp_path: Path, ranks: int) -> None:
    """Also the third run: an attempt that is refused leaves the lock and its owner as they were."""
    first = start(WAITING, tmp_path, ranks)
    assert first.stdout is not None and first.stdout.readline() == "running\n"
    for _ in range(2):
        said, _ = start(SECOND, tmp_path, ranks).communicate(timeout=HANG_TIMEOUT)
        # mpirun does not keep the lines of two ranks apart
        sentences = re.findall(r"'[^']*' is being .*? another folder\.", said)
        assert len(sentences) == ranks and len(set(sentences)) == 1
        assert re.search(r"run \(.*process \d+ on .*, since .*\); wait for", sentences[0])
    said, _ = first.communicate("\n", timeout=HANG_TIMEOUT)
    assert said.count("done") == ranks and first.returncode == 0
    assert not list(tmp_path.rglob(".*"))


def test_the_lock_of_a_run_that_was_killed_is_no_obstacle(tmp_path: Path) -> None:
    first = start(WAITING, tmp_path)
    assert first.stdout is not None and first.stdout.readline() == "running\n"
    first.kill()
    first.communicate(timeout=HANG_TIMEOUT)
    options = {"checkpoints": gx.Checkpoints(tmp_path / "saves"), "restart": tmp_path / "saves"}
    ball(outputs=[gx.Recording(tmp_path / "run", every=1)], **options).run(until=4e-3)
    assert not list(tmp_path.rglob(".*"))


@pytest.mark.mpi
def test_runs_of_one_program_follow_each_other(folder: Path) -> None:
    """Also where the first was never run, or is called again later; but not one within the
    other."""
    ball(outputs=[gx.Ledger(folder / "a.csv")])
    one = ball(outputs=[gx.Ledger(folder / "a.csv")])
    one.run(until=DT)
    ball(outputs=[gx.Ledger(folder / "a.csv")]).run(until=DT)

    def within(run: gx.Simulation) -> None:
        if run.step == 1:
            with pytest.raises(
                gx.InputError, match="is being written by another run of this program"
            ):
                ball(outputs=[gx.Ledger(folder / "a.csv")])

    ball(outputs=[gx.Ledger(folder / "a.csv"), Watch(within)]).run(until=DT)


@pytest.mark.mpi
def test_two_outputs_of_one_file_are_refused(folder: Path) -> None:
    def refused(*outputs: object) -> None:
        with pytest.raises(
            gx.InputError,
            match=r"Two outputs of the run write '.*'; give one of them another name\.$",
        ):
            ball(outputs=list(outputs))

    here = os.path.relpath(folder)
    probes = {"one": lambda run: 1.0}
    refused(gx.Ledger(folder / "a.csv"), gx.outputs.Probes(f"{here}/./a.csv", probes))
    refused(gx.Recording(folder), gx.Ledger(folder / "ledger.csv"))
    refused(gx.plot.Picture(folder / "a.png"), gx.plot.Picture(folder / "b" / ".." / "a.png"))
    film = fluttering_sheet(COMM, 2)
    with pytest.raises(gx.InputError, match="Two outputs of the run write"):
        gx.Simulation(
            film,
            gx.Midpoint(dt=DT),
            outputs=[gx.outputs.VTU(folder / "a.pvd"), gx.outputs.VTU(folder / "." / "a.pvd")],
        )
    COMM.barrier()
    assert not [p for p in folder.rglob("*") if p.is_file()]


@pytest.mark.mpi
def test_a_forgotten_restart_deletes_nothing(folder: Path) -> None:
    ball(checkpoints=gx.Checkpoints(folder, every=1, keep=3)).run(until=5 * DT)
    COMM.barrier()
    before = files(folder)
    COMM.barrier()
    with pytest.raises(
        gx.InputError, match=r"holds checkpoints of a run up to step 5; go on from them .* replace"
    ):
        ball(checkpoints=gx.Checkpoints(folder))
    other = folder.parent / f"{folder.name} other"
    ball(checkpoints=gx.Checkpoints(other)).run(until=2 * DT)
    with pytest.raises(gx.InputError, match="holds checkpoints of a run up to step 5"):
        ball(checkpoints=gx.Checkpoints(folder), restart=other)
    COMM.barrier()
    assert files(folder) == before
    COMM.barrier()
    ball(checkpoints=gx.Checkpoints(folder), restart=folder / "step-00000004").run(until=6 * DT)
    ball(checkpoints=gx.Checkpoints(folder, overwrite=True)).run(until=DT)
    COMM.barrier()
    assert sorted(p.name for p in folder.iterdir()) == ["step-00000000", "step-00000001"]


# ---- damage --------------------------------------------------------------------------------------


def test_any_changed_byte_and_any_removed_key_of_a_checkpoint_is_told(tmp_path: Path) -> None:
    """In one sentence that names an older checkpoint, which can be restarted from."""
    ball(checkpoints=gx.Checkpoints(tmp_path, every=1, keep=2)).run(until=3 * DT)
    page = tmp_path / "step-00000003" / "run.json"
    text = page.read_bytes()
    rng = np.random.default_rng(7)
    tried = 0
    state = json.loads(text)

    def removed(tree: object) -> list[bytes]:
        """The page without each of its keys in turn."""
        found = []
        if isinstance(tree, dict):
            for key in list(tree):
                kept = tree.pop(key)
                found.append(json.dumps(state).encode())
                tree[key] = kept
                found += removed(kept)
        return found

    digits = [i for i, byte in enumerate(text) if chr(byte).isdigit()]
    changed = [
        text[:i] + bytes([(text[i] - 47) % 10 + 48]) + text[i + 1 :] for i in rng.choice(digits, 40)
    ]
    flipped = [
        text[:i] + bytes([text[i] ^ 1 << rng.integers(8)]) + text[i + 1 :]
        for i in rng.integers(0, len(text), 40)
    ]
    for content in [*removed(state), *changed, *flipped, text[:-20], b"", b"[]", b"null", b"{}"]:
        page.write_bytes(content)
        tried += 1
        with pytest.raises(gx.InputError) as told:
            ball(restart=tmp_path)
        words = r"is damaged \(.*\); restart from another one, e\.g\. '.*step-00000002'\.$"
        assert re.search(words, str(told.value))
    assert tried > 120
    assert ball(restart=tmp_path / "step-00000002").step == 2


def test_a_part_of_another_checkpoint_is_told(tmp_path: Path) -> None:
    ball(checkpoints=gx.Checkpoints(tmp_path, every=1, keep=2)).run(until=3 * DT)
    newest = tmp_path / "step-00000003"
    older = tmp_path / "step-00000002"
    (newest / "rank-0000.npz").write_bytes((older / "rank-0000.npz").read_bytes())
    with pytest.raises(
        gx.InputError, match=r"is damaged \(ValueError: rank-0000\.npz was changed\)"
    ):
        ball(restart=tmp_path)
    (newest / "rank-0000.npz").unlink()
    with pytest.raises(gx.InputError, match=r"is damaged \(FileNotFoundError"):
        ball(restart=tmp_path)


def record(folder: Path, until: int, dt: float = DT, **options: object) -> None:
    """Run a film with a recording, and checkpoints every second step."""
    outputs = [gx.Recording(folder / "run", every=1)]
    saves = gx.Checkpoints(folder / "saves", every=2)
    film = fluttering_sheet(COMM, 2)
    run = gx.Simulation(film, gx.Midpoint(dt=dt), outputs=outputs, checkpoints=saves, **options)
    run.run(until * DT)


def read_all(folder: Path) -> None:
    run = gx.plot.RunReader(folder / "run")
    for name in ("ledger.csv", "states.csv"):
        run.table(name)
    for frame in range(len(run.times)):
        run.values("state", frame)


def refused(act: Callable[[], None]) -> str:
    """What an `InputError` of one sentence says; nothing if there is none."""
    try:
        act()
    except gx.InputError as error:
        assert "\n" not in str(error) and str(error).endswith(".")
        return str(error)
    return ""


def restore(folder: Path, content: dict[str, bytes]) -> None:
    for name, kept in content.items():
        (folder / name).write_bytes(kept)


def test_a_damaged_recording_is_refused_when_it_is_read_and_when_a_run_goes_on(
    tmp_path: Path,
) -> None:
    """Every file of the fields and the tables, shortened by half or by a byte, emptied, or
    removed."""
    record(tmp_path, 4)
    read_all(tmp_path)
    kept = files(tmp_path / "run")
    fields = [name for name in kept if name.startswith("fields")]
    # The list, the mesh, and five records
    assert len(fields) == 7
    for name in [*fields, "ledger.csv", "states.csv"]:
        path = tmp_path / "run" / name
        whole = kept[name]
        for content in (whole[: len(whole) // 2], whole[:-1], b"", None):
            path.unlink()
            if content is not None:
                path.write_bytes(content)
            # a table that is missing or ends early is that of a run that was killed
            if not name.endswith(".csv"):
                assert refused(lambda: read_all(tmp_path)), (name, content)
            assert refused(lambda: record(tmp_path, 5, restart=tmp_path / "saves")), (name, content)
            restore(tmp_path / "run", kept)
    record(tmp_path, 5, restart=tmp_path / "saves")
    read_all(tmp_path)


def test_a_recording_that_was_replaced_by_another_runs_is_refused(tmp_path: Path) -> None:
    """Fields with steps at other times, a table with other rows; nothing is cut off before that is
    found."""
    record(tmp_path / "one", 4)
    record(tmp_path / "other", 4, dt=DT / 2)
    other = files(tmp_path / "other" / "run")
    kept = files(tmp_path / "one" / "run")
    for name, words in (("fields", "when it had 5 records"), ("ledger", "had 5 rows")):
        restore(
            tmp_path / "one" / "run",
            {file: content for file, content in other.items() if file.startswith(name)},
        )
        spoiled = files(tmp_path / "one" / "run")
        said = refused(lambda: record(tmp_path / "one", 5, restart=tmp_path / "one" / "saves"))
        assert "was replaced since the checkpoint was written" in said and words in said
        assert files(tmp_path / "one" / "run") == spoiled
        for name in files(tmp_path / "one" / "run").keys() - kept.keys():
            (tmp_path / "one" / "run" / name).unlink()
        restore(tmp_path / "one" / "run", kept)
    record(tmp_path / "one", 5, restart=tmp_path / "one" / "saves")
