"""Names of files are one to one: two outputs never share a file."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.records.outputs.run_file import file_name
from tests.survival.scenes import DT, LAW

COMM = MPI.COMM_WORLD
NAMES = st.text(st.sampled_from("ab_/0 1%.é:"), max_size=9) | st.text(max_size=200)


@given(NAMES, NAMES)
def test_two_names_have_two_files(one: str, other: str) -> None:
    assert (file_name(one) == file_name(other)) == (one == other)
    first, second = (Path("fields") / f"{file_name(name)}.pvd" for name in (one, other))
    assert first.parent == Path("fields") and first.suffix == ".pvd" and len(first.name) < 255
    assert (first == second) == (one == other)


def test_usual_names_stay() -> None:
    for name in ("film", "tip mass", "panel_1", "boom-2", "v1.2", "film_001", "film_0001"):
        assert file_name(name) == name


PAIRS = [
    ("film", "film_1"),
    ("film", "film_0001"),
    ("panel", "panel_0001"),
    ("wing a/b", "wing a_b"),
]


@pytest.mark.mpi(1)
@pytest.mark.parametrize(("one", "other"), PAIRS)
def test_bodies_whose_names_are_alike_keep_their_fields(folder: Path, one: str, other: str) -> None:
    """Two films move apart; after a restart, too, each is read back where it went."""

    def run(until: int, **options: object) -> None:
        films = [
            gx.Membrane(sheet(COMM, 2, 2), LAW, name=name, velocity=lambda x, v=v: x * 0 + v)
            for name, v in ((one, 1.0), (other, -2.0))
        ]
        gx.Simulation(
            gx.Scene(*films),
            gx.Midpoint(dt=DT),
            outputs=[gx.Recording(folder / "run", every=1)],
            checkpoints=gx.Checkpoints(folder / "saves"),
            **options,
        ).run(until=until * DT)

    run(2)
    run(4, restart=folder / "saves")
    COMM.barrier()
    if COMM.rank == 0:
        reader = gx.plot.RunReader(folder / "run")
        assert reader.times == pytest.approx([0, DT, 2 * DT, 3 * DT, 4 * DT])
        for name, v in ((one, 1.0), (other, -2.0)):
            part, k = reader.bodies[name].at(4)
            moved = part.positions(k) - part.X
            assert moved == pytest.approx(moved * 0 + v * 4 * DT, rel=1e-6)
