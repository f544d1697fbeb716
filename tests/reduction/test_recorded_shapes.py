"""Reduced films from the folder of a run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.airbag import airbag
from gossamer_fx.meshes.sheet import sheet
from tests.small_scenes import run_until

WORLD = MPI.COMM_WORLD
LAW = gx.Miyazaki(E=2e8, nu=0.3, density=1400.0, thickness=1e-5)
SIDE = 2.0
DT = 0.05


def sail(
    comm: MPI.Intracomm, cells: int = 4, order: int = 1, name: str = "the sail"
) -> gx.Membrane:
    def velocity(X: np.ndarray) -> np.ndarray:
        x = X[0] - SIDE / 2
        y = X[1] - SIDE / 2
        return np.stack([-y, x, 0.05 * x * y])

    return gx.Membrane(
        sheet(comm, cells, cells, SIDE, SIDE),
        LAW,
        order=order,
        velocity=velocity,
        name=name,
    )


def flown(
    comm: MPI.Intracomm, folder: Path, order: int, halves: bool = False
) -> gx.reduction.Snapshots:
    """A run in a folder, perhaps restarted in the middle; its shapes in memory, too."""
    film = sail(comm, order=order)
    shapes = gx.reduction.Snapshots(film, every=2)
    outputs = [gx.Recording(folder / "run", every=2), shapes]
    points = gx.Checkpoints(folder / "points", every=4)
    run_until(4 * DT if halves else 8 * DT, film, dt=DT, outputs=outputs, checkpoints=points)
    if halves:
        kept = list(shapes.positions)
        again = gx.Recording(folder / "run", every=2), gx.reduction.Snapshots(film, every=2)
        gx.Simulation(
            gx.Scene(film),
            gx.Midpoint(dt=DT),
            outputs=again,
            restart=folder / "points",
        ).run(until=8 * DT)
        shapes.positions = kept + again[1].positions
    return shapes


@pytest.mark.mpi
@pytest.mark.parametrize(("order", "halves"), [(1, False), (2, True)])
def test_shapes_on_the_disk_are_those_in_memory(folder: Path, order: int, halves: bool) -> None:
    shapes = flown(WORLD, folder, order, halves)
    read = gx.reduction.RecordedShapes(shapes.body, folder / "run")
    # Every second of eight steps, and the start: five shapes.
    assert read.times == pytest.approx(np.arange(0, 10, 2) * DT) and len(shapes.positions) == 5
    for a, b in zip(read.positions, shapes.positions, strict=True):
        # Files hold full precision.
        assert a.shape == b.shape and np.abs(a - b).max(initial=0.0) < 1e-14
    a, b = (
        gx.reduction.reduce(shapes.body, [motion], modes=2).basis.singular_values
        for motion in (read, shapes)
    )
    assert a[:2] == pytest.approx(b[:2], rel=1e-9)


@pytest.mark.mpi
def test_a_run_on_one_rank_is_read_on_all(folder: Path) -> None:
    if WORLD.rank == 0:
        flown(MPI.COMM_SELF, folder, 1)
    WORLD.barrier()
    film = sail(WORLD)
    read = gx.reduction.RecordedShapes(film, folder / "run")
    run = run_until(8 * DT, film, dt=DT)
    error = np.abs(read.positions[-1].ravel() - run.system.q0.array_r).max(initial=0.0)
    # Runs on different numbers of ranks.
    assert error < 1e-8
    assert gx.reduction.reduce(film, [read], modes=2).basis.size == 5


@pytest.mark.mpi
def test_what_is_not_there_is_told_in_one_sentence(folder: Path) -> None:
    flown(WORLD, folder, 1)
    for film, where, words in (
        (sail(WORLD), folder / "nowhere", "There is no run in"),
        (
            sail(WORLD, name="other"),
            folder / "run",
            "no fields of 'other', but fields of: the sail; give the film the name",
        ),
        (
            sail(WORLD, cells=3),
            folder / "run",
            "is of another mesh than 'the sail'; give the film that was recorded",
        ),
        (
            gx.Membrane(airbag(WORLD, 1.0, 4), LAW, name="the sail"),
            folder / "run",
            "lie on each other.*Snapshots",
        ),
        # A file that lost its end, as after a full disk.
    ):
        with pytest.raises(gx.InputError, match=words):
            gx.reduction.RecordedShapes(film, where)
    if WORLD.rank == 0:
        data = folder / "run" / "fields" / "the sail_files" / "00003.vtu"
        data.write_bytes(data.read_bytes()[:-100])
    WORLD.barrier()
    with pytest.raises(gx.InputError, match=r"00003\.vtu' is missing or damaged"):
        gx.reduction.RecordedShapes(sail(WORLD), folder / "run")
