"""Checkpoints: a restarted run equals the uninterrupted run, on any number of ranks."""

from __future__ import annotations

import csv
import json
import os
import re
import signal
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.records.outputs.vtu import read_records
from gossamer_fx.records.run.checkpoint import _checksum_of
from tests.small_scenes import run_until
from tests.survival.scenes import DT, Watch, filled_tube, fluttering_sheet, numbers

COMM = MPI.COMM_WORLD


def run_to(steps: int, scene: gx.Scene, **options: object) -> gx.Simulation:
    run = gx.Simulation(scene, gx.Midpoint(dt=DT), **options)
    run.run(until=steps * DT)
    return run


@pytest.mark.mpi
def test_coordinates_find_their_nodes_on_other_ranks(folder: Path) -> None:
    """Every node of the state that is read has the position and velocity that its point of the mesh
    has."""
    run_to(3, fluttering_sheet(COMM, 5, order=2), checkpoints=gx.Checkpoints(folder))
    COMM.barrier()
    for comm in (COMM, MPI.COMM_SELF):
        run = run_to(3, fluttering_sheet(comm, 5, order=2), restart=folder)
        film = run.system.unknowns.bodies[0]
        X = film.space.tabulate_dof_coordinates()[: film.block.index_map.size_local]
        table = np.hstack(
            [
                X,
                run.system.unknowns.q0.array_r.reshape(-1, 3),
                run.system.unknowns.v0.array_r.reshape(-1, 3),
            ]
        )
        rows = np.concatenate(comm.allgather(table))
        rows = rows[np.lexsort(rows[:, :3].T.round(9))]
        if comm is COMM:
            together = rows
    np.testing.assert_allclose(rows, together, rtol=0, atol=1e-12)


@pytest.mark.mpi
def test_a_small_mesh_about_the_origin_is_the_same_on_other_ranks(folder: Path) -> None:
    """The coordinates of its points cancel, up to a round-off that depends on the partition."""

    def scene(comm: MPI.Intracomm, shift: float = 0.0) -> gx.Scene:
        film = sheet(comm, 7, 9, 3e-3, 3e-3)
        film.domain.geometry.x[:] += (-1.5e-3, -1.5e-3, shift)
        law = gx.Linear(E=1e9, nu=0.3, density=1400.0, thickness=1e-5)
        return gx.Scene(gx.Membrane(film, law, name="film"))

    run_to(1, scene(COMM), checkpoints=gx.Checkpoints(folder))
    COMM.barrier()
    assert run_to(2, scene(MPI.COMM_SELF), restart=folder).step == 2
    with pytest.raises(gx.InputError, match="the mesh of 'film' is not the same"):
        run_to(2, scene(COMM, shift=1e-9), restart=folder)


@pytest.mark.mpi
def test_step_control_goes_on_where_it_was(folder: Path) -> None:
    def go(until: float, **options: object) -> gx.Simulation:
        control = gx.StepControl(target_iterations=8, error=1e-6)
        run = gx.Simulation(
            fluttering_sheet(COMM),
            gx.Midpoint(dt=DT / 10),
            control=control,
            **options,
        )
        run.run(until=until)
        return run

    whole = go(0.01, events=[gx.At(0.004)])
    go(0.004, checkpoints=gx.Checkpoints(folder))
    rest = go(0.01, restart=folder)
    assert (rest.step, rest.iterations) == (whole.step, whole.iterations)
    assert rest.stepping.wanted == pytest.approx(whole.stepping.wanted, rel=1e-6)
    assert numbers(rest) == pytest.approx(numbers(whole), rel=1e-9, abs=1e-12)


@pytest.mark.mpi
def test_generalized_alpha_remembers_its_accelerations(folder: Path) -> None:
    def go(steps: int, **options: object) -> gx.Simulation:
        run = gx.Simulation(fluttering_sheet(COMM), gx.GeneralizedAlpha(dt=1e-4), **options)
        run.run(until=steps * 1e-4)
        return run

    whole = go(6)
    go(3, checkpoints=gx.Checkpoints(folder))
    assert numbers(go(6, restart=folder)) == pytest.approx(numbers(whole), rel=1e-9, abs=1e-12)


# ---- outputs -------------------------------------------------------------------------------------


def outputs(folder: Path) -> list:
    return [
        gx.Ledger(folder / "ledger.csv"),
        gx.outputs.Probes(
            folder / "probes.csv", {"kinetic": lambda run: run.totals.kinetic}, every=3
        ),
        gx.outputs.VTU(folder / "film.pvd", every=2),
    ]


def table(path: Path) -> np.ndarray:
    with path.open() as file:
        return np.array(list(csv.reader(file))[1:], dtype=float)


@pytest.mark.mpi
def test_outputs_go_on_without_gap_or_duplicate(folder: Path) -> None:
    """A run that came to step 7, 13 is restarted at step 5, 10: later rows are cut off and written
    again."""
    run_to(15, fluttering_sheet(COMM), outputs=outputs(folder / "whole"))
    broken = folder / "broken"
    saves = {"every": 5, "keep": 9}
    run_to(
        7,
        fluttering_sheet(COMM),
        outputs=outputs(broken),
        checkpoints=gx.Checkpoints(folder / "c", **saves),
    )
    for until, start in ((13, 5), (15, 10)):
        run_to(
            until,
            fluttering_sheet(COMM),
            outputs=outputs(broken),
            checkpoints=gx.Checkpoints(folder / "c", **saves),
            restart=folder / "c" / f"step-{start:08d}",
        )
    COMM.barrier()
    if COMM.rank == 0:
        for name in ("ledger.csv", "probes.csv"):
            ours = table(broken / name)
            theirs = table(folder / "whole" / name)
            assert ours.shape == theirs.shape
            assert ours[:, :2] == pytest.approx(theirs[:, :2], rel=1e-12)
        parts = read_records(broken / "film.pvd")
        # The run and its two restarts
        assert len(parts) == 3
        measured = np.concatenate([part.times for part in parts]) / DT
        assert measured == pytest.approx([0, 2, 4, 6, 8, 10, 12, 14, 15], abs=1e-9)


@pytest.mark.mpi
def test_a_run_that_is_called_again_goes_on_in_its_files(folder: Path) -> None:
    run = gx.Simulation(fluttering_sheet(COMM), gx.Midpoint(dt=DT), outputs=outputs(folder))
    run.run(until=2 * DT)
    run.run(until=4 * DT)
    COMM.barrier()
    if COMM.rank == 0:
        assert table(folder / "ledger.csv")[:, 1].tolist() == [0, 1, 2, 3, 4]
        [part] = read_records(folder / "film.pvd")
        assert part.times == pytest.approx([0, 2 * DT, 4 * DT])


@pytest.mark.mpi
def test_the_last_ones_are_kept_and_nothing_else(folder: Path) -> None:
    run = run_to(13, fluttering_sheet(COMM), checkpoints=gx.Checkpoints(folder, every=3))
    assert run.checkpoints.latest == folder / "step-00000013" == gx.run.latest_checkpoint(folder)
    COMM.barrier()
    assert sorted(p.name for p in folder.iterdir()) == ["step-00000012", "step-00000013"]


@pytest.mark.mpi
def test_the_first_checkpoint_makes_the_folder(folder: Path) -> None:
    """A program that ends before the start is recorded leaves no empty folder."""
    saves = folder / "saves"
    run = gx.Simulation(
        fluttering_sheet(COMM), gx.Midpoint(dt=DT), checkpoints=gx.Checkpoints(saves)
    )
    COMM.barrier()
    assert not saves.exists()
    COMM.barrier()
    run.run(until=DT)
    COMM.barrier()
    assert sorted(path.name for path in saves.iterdir()) == ["step-00000000", "step-00000001"]


def test_a_file_in_the_place_of_the_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "saves").write_text("precious")
    for path in (tmp_path / "saves", tmp_path / "saves" / "more"):
        with pytest.raises(gx.InputError, match="saves"):
            gx.Simulation(
                fluttering_sheet(COMM), gx.Midpoint(dt=DT), checkpoints=gx.Checkpoints(path)
            )


@pytest.mark.mpi
def test_minutes(folder: Path) -> None:
    """A checkpoint after every step, as each takes longer than a microminute."""
    run = gx.Simulation(
        fluttering_sheet(COMM),
        gx.Midpoint(dt=DT),
        checkpoints=gx.Checkpoints(folder, every=None, minutes=1e-6, keep=9),
    )
    run.run(until=3 * DT)
    COMM.barrier()
    assert len(list(folder.iterdir())) == 4


@pytest.mark.mpi(1)
@pytest.mark.parametrize(("keep", "steps"), [(1, [5]), (4, [2, 3, 4, 5]), (9, [0, 1, 2, 3, 4, 5])])
def test_as_many_checkpoints_are_kept_as_were_asked_for(
    folder: Path, keep: int, steps: list[int]
) -> None:
    ball = gx.PointMass(1.0, comm=COMM)
    run_until(5 * DT, ball, dt=DT, checkpoints=gx.Checkpoints(folder, every=1, keep=keep))
    COMM.barrier()
    assert sorted(int(path.name[5:]) for path in folder.iterdir()) == steps


@pytest.mark.mpi(1)
def test_steps_that_are_made_again_do_not_count_as_the_newest(folder: Path) -> None:
    """Also if the run that makes them is killed before its next regular checkpoint."""
    newest = []
    watch = Watch(lambda run: newest.append(gx.run.latest_checkpoint(folder).name[5:]))
    for until, options in ((6, {}), (4, {"restart": folder / "step-00000002", "outputs": [watch]})):
        saves = gx.Checkpoints(folder, every=2, keep=9)
        run_until(until * DT, gx.PointMass(1.0, comm=COMM), dt=DT, checkpoints=saves, **options)
    # Outputs come before the checkpoint of their step.
    assert newest == ["00000006", "00000003"]


# ---- refusals ------------------------------------------------------------------------------------


@pytest.mark.mpi(1)
@pytest.mark.parametrize(
    ("other", "words"),
    [
        (lambda: fluttering_sheet(COMM, 5), "the mesh of 'film' is not the same"),
        (lambda: fluttering_sheet(COMM, 4, order=2), "unknowns"),
        (lambda: gx.Scene(*fluttering_sheet(COMM).items, gx.PointMass(1.0)), "PointMass"),
        (
            lambda: fluttering_sheet(
                COMM,
                law=gx.Miyazaki(E=2e9, nu=0.3, density=1400.0, thickness=1e-4),
            ),
            "law E of 'film' is 1e.09 there and 2e.09 here",
        ),
        (
            lambda: fluttering_sheet(
                COMM,
                law=gx.Miyazaki(E=1e9, nu=0.3, density=700.0, thickness=1e-4),
            ),
            "law density of 'film' is 1400 there and 700 here",
        ),
    ],
)
def test_another_scene_is_refused(folder: Path, other: Callable[[], gx.Scene], words: str) -> None:
    run_to(4, fluttering_sheet(COMM), checkpoints=gx.Checkpoints(folder))
    with pytest.raises(gx.InputError, match=rf"checkpoint '.*' is of another scene: .*{words}"):
        run_to(5, other(), restart=folder)


@pytest.mark.mpi
def test_other_versions_damage_and_nothing_are_refused(folder: Path) -> None:
    with pytest.raises(gx.InputError, match="There is no checkpoint in"):
        run_to(5, fluttering_sheet(COMM), restart=folder / "none")
    run_to(4, fluttering_sheet(COMM), checkpoints=gx.Checkpoints(folder))
    COMM.barrier()
    with pytest.raises(gx.InputError, match=r"newest there, step-00000000, step-00000004\."):
        run_to(5, fluttering_sheet(COMM), restart=folder / "step-00000003")
    last = folder / "step-00000004"
    part = last / "rank-0000.npz"
    page = last / "run.json"
    whole = part.read_bytes()
    text = page.read_text()
    assert b"\x80\x04\x95" not in whole  # a pickle begins so
    COMM.barrier()

    def refused(words: str) -> None:
        COMM.barrier()
        with pytest.raises(gx.InputError, match=words):
            run_to(5, fluttering_sheet(COMM), restart=folder)
        COMM.barrier()

    def put(file: Path, content: bytes) -> None:
        if COMM.rank == 0:
            file.write_bytes(content)

    for content in (
        whole[: len(whole) // 2],
        whole[:500] + bytes([whole[500] ^ 255]) + whole[501:],
        b"",
    ):
        put(part, content)
        refused("is damaged .*; restart from another one, e.g. '.*step-00000000'")
    put(part, whole)
    state = json.loads(text) | {"version": "0.0.1"}
    state["checksum"] = _checksum_of(
        {key: value for key, value in state.items() if key != "checksum"}
    )
    put(page, json.dumps(state).encode())
    refused("was written by version 0.0.1")
    put(page, text.encode()[:100])
    refused("is damaged")
    put(page, text.encode())
    COMM.barrier()
    assert run_to(5, fluttering_sheet(COMM), restart=folder).step == 5


@pytest.mark.mpi
def test_a_table_that_was_changed_is_refused(folder: Path) -> None:
    def go(steps: int, probes: dict, **options: object) -> None:
        run_to(
            steps,
            fluttering_sheet(COMM),
            outputs=[gx.outputs.Probes(folder / "p.csv", probes)],
            **options,
        )

    go(4, {"one": lambda run: 1.0}, checkpoints=gx.Checkpoints(folder / "c"))
    with pytest.raises(gx.InputError, match="has other columns"):
        go(5, {"two": lambda run: 1.0}, restart=folder / "c")
    COMM.barrier()
    if COMM.rank == 0:
        (folder / "p.csv").write_text("time,step,one\r\n")
    COMM.barrier()
    with pytest.raises(gx.InputError, match="is shorter than it was"):
        go(5, {"one": lambda run: 1.0}, restart=folder / "c")


def test_the_version_is_that_of_the_package() -> None:
    import tomllib

    from gossamer_fx.version import VERSION

    root = Path(gx.__file__).parent.parent
    package = tomllib.loads((root / "pyproject.toml").read_text())
    source = package["tool"]["hatch"]["version"]
    [told] = re.findall(source["pattern"], (root / source["path"]).read_text())
    assert package["project"]["dynamic"] == ["version"] and told == VERSION == gx.__version__


@pytest.mark.mpi
def test_a_restart_from_the_start_records_it_once(folder: Path) -> None:
    run_to(
        2,
        fluttering_sheet(COMM),
        outputs=outputs(folder),
        checkpoints=gx.Checkpoints(folder / "c", keep=3),
    )
    run_to(
        2,
        fluttering_sheet(COMM),
        outputs=outputs(folder),
        restart=folder / "c" / "step-00000000",
    )
    COMM.barrier()
    assert table(folder / "ledger.csv")[:, 1].tolist() == [0, 1, 2]


@pytest.mark.parametrize("end", ["ended", "stopped"])
def test_a_restart_knows_of_steps_that_failed(folder: Path, end: str) -> None:
    """Steps that are hard to solve: what the stepper learned of them goes on, and no digit depends
    on the end."""
    dt = 1e-2
    steps = 2

    def run(until: int, **options: object) -> gx.Simulation:
        run = gx.Simulation(filled_tube(COMM, 2), gx.Midpoint(dt=dt), **options)
        run.run(until=until * dt)
        return run

    def stop(run: gx.Simulation) -> None:
        if run.step == steps // 2 - 1:
            os.kill(os.getpid(), signal.SIGTERM)

    whole = run(steps)
    if end == "ended":
        first = run(steps // 2, checkpoints=gx.Checkpoints(folder))
        assert first.substeps > 0
    else:
        with pytest.raises(gx.run.Interrupted):
            run(steps, outputs=[Watch(stop)], checkpoints=gx.Checkpoints(folder))
    rest = run(steps, restart=folder)
    assert rest.iterations == whole.iterations
    assert (rest.system.unknowns.q0.array_r == whole.system.unknowns.q0.array_r).all()
    assert rest.chamber("tube").pressure == whole.chamber("tube").pressure
