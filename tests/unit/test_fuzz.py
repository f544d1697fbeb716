"""Damaged mesh files: a mesh, or one sentence; never a crash or silence.

The default test takes a few examples; the slow one goes on for ten minutes:

    ./gossamer python -m pytest -m slow tests/unit/test_fuzz.py
"""

from __future__ import annotations

import gc
import os
import time
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.core.mesh import gmsh_reader as raw_mesh
from gossamer_fx.solve.scene.validation import warnings
from tests.small_scenes import LINEAR

pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="files are read by one rank")

ALONE = MPI.COMM_SELF
FREE = {"database": None, "deadline": None, "suppress_health_check": list(HealthCheck)}
WORDS = b"-1 0 nan inf 1e308 99999999 2 3 4 9 15 16 x -2147483649 18446744073709551615 $EndNodes $Elements".split()


def files(folder: Path) -> list[bytes]:
    """A small mesh in the versions and encodings of gmsh."""
    found = []
    for version in (4.1, 2.2):
        for binary in (0, 1):
            path = folder / f"{version}_{binary}.msh"

            def write(model, version=version, binary=binary, path=path) -> None:
                import gmsh

                surface = model.occ.addRectangle(0, 0, 0, 2, 1)
                model.occ.synchronize()
                model.addPhysicalGroup(2, [surface], name="strip")
                model.addPhysicalGroup(1, [1], name="clamp")
                model.addPhysicalGroup(0, [2], 7)
                model.mesh.setSize(model.getEntities(0), 1.0)
                model.mesh.generate(2)
                gmsh.option.setNumber("Mesh.MshFileVersion", version)
                gmsh.option.setNumber("Mesh.Binary", binary)
                gmsh.write(str(path))

            gx.gmsh_mesh(write, ALONE)
            found.append(path.read_bytes())
    return found


@st.composite
def damaged(draw: st.DrawFn, originals: list[bytes]) -> bytes:
    """One of the files with some words or bytes changed, lost, doubled, or cut off."""
    data = draw(st.sampled_from(originals))
    if draw(st.booleans()):
        separator = draw(st.sampled_from([b" ", b"\n"]))
        words = data.split(separator)
        for _ in range(draw(st.integers(1, 4))):
            i = draw(st.integers(0, len(words) - 1))
            words[i : i + 1] = draw(
                st.sampled_from(
                    [
                        [],
                        [words[i]] * 2,
                        [draw(st.sampled_from(WORDS))],
                        [draw(st.sampled_from(words))],
                    ]
                )
            ) or [b""]
        return separator.join(words)
    changed = bytearray(data)
    for _ in range(draw(st.integers(1, 6))):
        i = draw(st.integers(0, max(len(changed) - 1, 0)))
        kind = draw(st.sampled_from(["byte", "lose", "insert", "end"]))
        if kind == "byte" and changed:
            changed[i] = draw(st.integers(0, 255))
        elif kind == "lose":
            del changed[i : i + draw(st.integers(1, 30))]
        elif kind == "insert":
            changed[i:i] = draw(st.binary(min_size=1, max_size=8))
        else:
            del changed[max(i, 8) :]
    return bytes(changed)


def read(path: Path) -> str:
    """What is said about a file: nothing if it makes a film."""
    try:
        film = gx.Membrane(gx.read_mesh(path, ALONE), LINEAR)
        list(warnings([film]))
    except gx.InputError as error:
        return str(error)
    return ""


def is_sentence(words: str) -> bool:
    return not words or ("\n" not in words and words.endswith("."))


def test_damaged_mesh_files_are_told(tmp_path: Path) -> None:
    originals = files(tmp_path)
    path = tmp_path / "damaged.msh"

    @settings(max_examples=12, derandomize=True, **FREE)
    @given(damaged(originals))
    def check(data: bytes) -> None:
        path.write_bytes(data)
        assert is_sentence(read(path))

    check()


def test_a_file_at_which_gmsh_breaks_off_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.msh"
    path.write_bytes(files(tmp_path)[0])
    monkeypatch.setattr(raw_mesh, "extract", lambda model: os.abort())
    said = read(path)
    assert said.startswith(f"gmsh broke off at the mesh of the file '{path}'; ")
    assert is_sentence(said)


@pytest.mark.slow
def test_damaged_mesh_files_for_ten_minutes(tmp_path: Path) -> None:
    originals = files(tmp_path)
    path = tmp_path / "damaged.msh"
    end = time.monotonic() + 600
    said: dict[str, int] = {}

    @settings(max_examples=10**6, derandomize=False, **FREE)
    @given(damaged(originals))
    def check(data: bytes) -> None:
        if time.monotonic() > end:
            pytest.skip(f"{sum(said.values())} files, told: {said}")
        path.write_bytes(data)
        words = read(path)
        assert is_sentence(words)
        kind = " ".join(words.replace(str(path), "FILE").split()[:4])
        said[kind] = said.get(kind, 0) + 1
        if sum(said.values()) % 100 == 0:
            gc.collect()  # meshes hold communicators, of which MPI has a limited number

    check()
