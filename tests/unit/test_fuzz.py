"""Damaged mesh files and random scenes: a result, or one sentence; never a crash or silence.

The default tests take a few examples; the slow one goes on for ten minutes:

    ./gossamer python -m pytest -m slow tests/unit/test_fuzz.py
"""

from __future__ import annotations

import gc
import math
import os
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.core.mesh import gmsh_reader as raw_mesh
from gossamer_fx.meshes.airbag import airbag
from gossamer_fx.solve.scene.validation import warnings
from tests.small_scenes import LINEAR, MATERIAL

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
    gone = subprocess.CompletedProcess([], -6, b"", b"terminate called")
    monkeypatch.setattr(raw_mesh.subprocess, "run", lambda *args, **kwargs: gone)
    assert (
        read(path)
        == f"gmsh broke off when it read '{path}'; the file is damaged, write it again as MSH 4.1."
    )


def in_a_fork(command: list[str], **kwargs: Any) -> subprocess.CompletedProcess:
    """As `subprocess.run` of the reader, in a fork of this process, which has loaded everything."""
    (end, start), path, arrays = os.pipe(), *command[-2:]
    child = os.fork()
    if child == 0:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        os.dup2(start, 1)
        try:
            raw_mesh._read_here(path, arrays)
        except raw_mesh.BadMesh as error:
            os.write(1, str(error).encode())
            os._exit(raw_mesh._REFUSED)
        except BaseException:
            os._exit(1)
        os._exit(0)
    os.close(start)
    with os.fdopen(end, "rb") as pipe:
        said = pipe.read()
    _, status = os.waitpid(child, 0)
    return subprocess.CompletedProcess(command, os.waitstatus_to_exitcode(status), said, b"")


@pytest.mark.slow
def test_damaged_mesh_files_for_ten_minutes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(raw_mesh.subprocess, "run", in_a_fork)
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


# ---- scenes --------------------------------------------------------------------------------------

ANY = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True),
    st.sampled_from([0.0, -1.0, 1e-300, 1e300, 1e-12, 1e12]),
    st.none(),
    st.text(max_size=3),
    st.tuples(st.floats(), st.floats(), st.floats()),
)


@st.composite
def numbers(draw: st.DrawFn, usual: dict[str, Any]) -> dict[str, Any]:
    """Usual numbers, one or two of which are replaced by anything."""
    names = draw(st.lists(st.sampled_from(sorted(usual)), min_size=1, max_size=2, unique=True))
    return usual | {name: draw(ANY) for name in names}


USUAL = {
    **MATERIAL,
    "residual": 1e-6,
    "pressure": 100.0,
    "temperature": 300.0,
    "dead_volume": 1e-3,
    "gamma": 1.4,
    "R": 287.0,
    "area": 1e-5,
    "discharge_coefficient": 0.8,
    "g": (0.0, 0.0, -9.8),
    "damping": 0.1,
    "dt": 1e-4,
    "until": 3e-4,
    "spin": (0.0, 0.0, 1.0),
}


def run_pillow(mesh: gx.Mesh, n: dict[str, Any]) -> str:
    """A pillow of these numbers for three steps: what is said, or nothing if the run ends with
    finite energies."""
    try:
        law = gx.Miyazaki(
            n["E"],
            n["nu"],
            density=n["density"],
            thickness=n["thickness"],
            residual_stiffness=n["residual"],
        )
        film = gx.Membrane(mesh, law)
        gas = gx.IdealGas(n["gamma"], n["R"])
        bag = gx.Chamber(
            film,
            gas=gas,
            pressure=n["pressure"],
            temperature=n["temperature"],
            dead_volume=n["dead_volume"],
        )
        hole = gx.Orifice(
            gx.gas.Reservoir(1e5, 300.0),
            bag,
            area=n["area"],
            discharge_coefficient=n["discharge_coefficient"],
        )
        loads = [
            gx.Gravity(film, n["g"]),
            gx.Damping(film, mass_factor=n["damping"]),
            gx.RigidMotion(n["spin"]),
        ]
        run = gx.Simulation(gx.Scene(film, bag, hole, *loads), gx.Midpoint(dt=n["dt"]), halvings=1)
        steps = n["until"] / n["dt"]
        run.run(until=n["until"] if steps < 10 else 3 * n["dt"])
    except (gx.InputError, gx.StepFailure) as error:
        return str(error)
    except TypeError as error:  # of the division above
        assert "unsupported operand" in str(error)
        return "until and dt are not numbers."
    assert math.isfinite(run.totals.energy) and np.isfinite(run.system.q0.array_r).all()
    return ""


@pytest.mark.parametrize("examples", [15, pytest.param(600, marks=pytest.mark.slow)])
def test_random_scenes_are_run_or_told(examples: int) -> None:
    mesh = airbag(ALONE, 1.0, 2)

    @settings(max_examples=examples, derandomize=True, **FREE)
    @given(numbers(USUAL))
    def check(chosen: dict[str, Any]) -> None:
        assert is_sentence(run_pillow(mesh, chosen))

    check()
