"""Checkpoints: all that a run needs to go on after its end, whatever ended it, on any number of ranks.

A checkpoint is a folder `step-00000100`:

    run.json        numbers and words: time, gas, ledger sums, controllers, step control, where the outputs stand
    rank-0000.npz   the values of one rank: for each block the names of its nodes, coordinates and velocities

It is written as `.step-00000100` beside and renamed when all is on the disk, so it exists completely or not at all.
The zip format of NumPy checks every byte when it is read.  Nodes are found by `node_names`, not by their order.
"""

from __future__ import annotations

import json
import os
import shutil
import time
import zipfile
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from gossamer_fx.checks.errors import InputError, check, check_on_all, on_rank_zero, write_on_all
from gossamer_fx.model.terms import Stateful, is_on_mesh
from gossamer_fx.outputs.output import Continued, Output, make_parent
from gossamer_fx.outputs.run import Run
from gossamer_fx.run.node_keys import all_names, fetch, mesh_name
from gossamer_fx.system.totals import Totals
from gossamer_fx.version import VERSION

FORMAT = 1
SAME = 1e-6  # largest relative difference of an energy that is computed anew: round-off, but no other parameter


class SavedRun(Run, Stateful, Protocol):
    """A run, and its outputs, whose cursors are saved with it."""

    outputs: list[Output]


class Checkpoints:
    """Where a run writes its checkpoints, and when: at the start, at the end, and in between.

    Args:
        folder: it holds nothing else.
        every: steps between two checkpoints; None: only by time.
        minutes: time between two checkpoints; None: only by steps.
        keep: how many are kept; older ones are removed when a new one is complete.

    Raises:
        InputError: the folder cannot be made or written.
    """

    def __init__(
        self, folder: str | Path, every: int | None = 100, minutes: float | None = None, keep: int = 2
    ) -> None:
        self.folder, self.every, self.minutes, self.keep = Path(folder), every, minutes, keep
        check(
            every is None or (isinstance(every, int) and every >= 1),
            f"Checkpoints: every is {every!r}; give a number of steps, or None.",
        )
        check(minutes is None or minutes > 0, f"Checkpoints: minutes is {minutes!r}; give a positive number, or None.")
        check(isinstance(keep, int) and keep >= 1, f"Checkpoints: keep is {keep!r}; keep at least one.")
        self.seconds = 0.0  # spent in writing
        self._written: int | None = None

    def open(self, run: SavedRun) -> None:
        """Before anything is computed."""
        make_parent(run.comm, self.folder / "step")
        self._names = all_names(run.system)
        self._scene = scene_of(run)
        self._clock = time.monotonic()
        there = run.step > 0 and (self.folder / _name(run.step)).is_dir()
        self._written = run.step if run.comm.bcast(there) else None

    @property
    def latest(self) -> Path | None:
        """The last one that was written."""
        return None if self._written is None else self.folder / _name(self._written)

    def record(self, run: SavedRun, last: bool) -> None:
        """Write one if it is due; after the outputs have recorded the step."""
        if self._written != run.step and (last or self._written is None or self._due(run)):
            started = time.perf_counter()
            self._write(run)
            self._written, self._clock = run.step, time.monotonic()
            self.seconds += time.perf_counter() - started

    def _due(self, run: SavedRun) -> bool:
        if self.every is not None and run.step % self.every == 0:
            return True
        if self.minutes is None:
            return False
        return bool(run.comm.bcast(time.monotonic() - self._clock >= 60 * self.minutes))

    def _write(self, run: SavedRun) -> None:
        comm, path = run.comm, self.folder / _name(run.step)
        new = self.folder / f".{path.name}"
        state = self._state(run)

        def prepare() -> None:
            if comm.rank == 0:
                for left in self.folder.glob(".step-*"):
                    shutil.rmtree(left, ignore_errors=True)
                new.mkdir()

        def own_part() -> None:
            with (new / _rank(comm.rank)).open("wb") as file:
                np.savez(file, **self._arrays(run))
                _to_disk(file)

        def finish() -> None:
            if comm.rank == 0:
                with (new / "run.json").open("w", encoding="utf-8") as file:
                    json.dump(state, file, indent=1)
                    _to_disk(file)
                shutil.rmtree(path, ignore_errors=True)
                new.rename(path)
                others = [p for p in sorted(self.folder.glob("step-*")) if p != path]
                before = [p for p in others if p.name < path.name]
                for old in set(others) - set(before[len(before) - self.keep + 1 :]):
                    shutil.rmtree(old, ignore_errors=True)

        try:
            for task in (prepare, own_part, finish):
                write_on_all(comm, new, task)
        except Exception:
            if comm.rank == 0:
                shutil.rmtree(new, ignore_errors=True)
            raise

    def _arrays(self, run: SavedRun) -> dict[str, Any]:
        """This rank's part: names (n,), and (n, size) of every vector of every block."""
        numbering = run.system.numbering
        arrays: dict[str, Any] = {f"names {k}": names for k, names in enumerate(self._names)}
        for name, vector in run.history.vectors.items():
            for k, block in enumerate(numbering.blocks):
                arrays[f"{name} {k}"] = vector.array_r[numbering.owned(k)].reshape(-1, block.size)
        return arrays

    def _state(self, run: SavedRun) -> dict[str, Any]:
        system = run.system
        energies = run.comm.allreduce(np.array([system.supplied_energy, system.dissipated_energy]))
        return {
            "format": FORMAT,
            "version": VERSION,
            "scene": self._scene,
            "ranks": run.comm.size,
            "vectors": list(run.history.vectors),
            "time": system.time,
            "supplied": energies[0],
            "dissipated": energies[1],
            "run": run.get_state(),
            "history": run.history.get_state(),
            "totals": _plain(run.totals),
            "outputs": [[type(o).__name__, o.cursor()] for o in run.outputs if isinstance(o, Continued)],
        }


def latest(folder: str | Path) -> Path | None:
    """The newest complete checkpoint in a folder, if there is one."""
    found = sorted(p for p in Path(folder).glob("step-*") if (p / "run.json").is_file())
    return found[-1] if found else None


def read(run: SavedRun, restart: str | Path) -> list[tuple[str, dict[str, Any]]]:
    """Give a run, which stands at its start, the state of a checkpoint; returns where its outputs stood.

    Args:
        restart: a checkpoint, or a folder, of which the newest one is taken.

    Raises:
        InputError: there is none, it is damaged, of another version, or of another scene.
    """
    path, state = run.comm.bcast(on_rank_zero(run.comm, lambda: _open(Path(restart))))
    _compare(path, state, run)
    try:
        arrays, reason = _load(run, path, state), ""
    except (OSError, ValueError, KeyError, zipfile.BadZipFile, EOFError) as error:
        arrays, reason = {}, f"{type(error).__name__}: {error}"
    check_on_all(run.comm, not reason, f"The checkpoint '{path}' is damaged ({reason}); take an earlier one.")
    system, numbering = run.system, run.system.numbering
    here = all_names(system)
    for name, vector in run.history.vectors.items():
        with vector as values:
            for k, block in enumerate(numbering.blocks):
                rows = fetch(run.comm, arrays[f"names {k}"], arrays[f"{name} {k}"], here[k])
                values[numbering.owned(k)] = rows.reshape(-1, block.size).ravel()
    first = run.comm.rank == 0
    system.time = state["time"]
    system.supplied_energy, system.dissipated_energy = (state[n] if first else 0.0 for n in ("supplied", "dissipated"))
    run.history.set_state(state["history"])
    run.set_state(state["run"])
    _compare_energies(path, run.totals, state["totals"])
    return [(kind, cursor) for kind, cursor in state["outputs"]]


def _open(path: Path) -> tuple[Path, dict[str, Any]]:
    chosen = path if (path / "run.json").is_file() else latest(path)
    if chosen is None:
        raise InputError(f"There is no checkpoint in '{path}'; give a folder of checkpoints, or start without restart.")
    try:
        state = json.loads((chosen / "run.json").read_text(encoding="utf-8"))
        found = state["format"], state["version"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"The checkpoint '{chosen}' is damaged ({error}); take an earlier one.") from error
    ours = FORMAT, VERSION
    if found != ours:
        raise InputError(
            f"The checkpoint '{chosen}' was written by version {found[1]} (format {found[0]}), this is {ours[1]} "
            f"(format {ours[0]}); restart with the version that wrote it."
        )
    return chosen, state


def _load(run: SavedRun, path: Path, state: dict[str, Any]) -> dict[str, Any]:
    """The parts of the ranks that this rank reads, one after the other."""
    names = [f"{what} {k}" for what in ("names", *state["vectors"]) for k in range(len(run.system.numbering.blocks))]
    parts = []
    for rank in range(run.comm.rank, state["ranks"], run.comm.size):
        with np.load(path / _rank(rank), allow_pickle=False) as file:
            parts.append({name: file[name] for name in names})
    if not parts:
        sizes = [block.size for block in run.system.numbering.blocks]
        empty: dict[str, Any] = {f"names {k}": np.zeros(0, dtype=np.uint64) for k in range(len(sizes))}
        empty |= {f"{what} {k}": np.zeros((0, size)) for what in state["vectors"] for k, size in enumerate(sizes)}
        return empty
    return {name: np.concatenate([part[name] for part in parts]) for name in names}


def scene_of(run: SavedRun) -> dict[str, Any]:
    """What tells scenes apart: parts, unknowns, cells and extent of the meshes; the same on any number of ranks."""
    system, meshes, extents = run.system, dict[str, int](), dict[str, list[float]]()
    for body in system.bodies:
        if is_on_mesh(body):
            geometry = body.space.mesh.geometry
            x = geometry.x[: geometry.index_map().size_local]
            meshes[body.name] = mesh_name(body)
            extents[body.name] = run.comm.allreduce(np.concatenate([x.sum(axis=0), (x**2).sum(axis=0)])).tolist()
    return {
        "parts": sorted(f"{type(item).__name__} '{item.name}'" for item in run.scene.items),
        "unknowns": [block.index_map.size_global * block.size for block in system.numbering.blocks],
        "meshes": meshes,
        "extents": extents,
        "stepper": type(run.stepper).__name__,
        "vectors": sorted(run.history.vectors),
    }


def _compare(path: Path, state: dict[str, Any], run: SavedRun) -> None:
    """Refuse a checkpoint of another scene."""
    there, here = state["scene"], scene_of(run)
    differs: Callable[[str], str] = lambda what: f"The checkpoint '{path}' is of another scene: {what}."  # noqa: E731
    lost = sorted(set(there["parts"]) ^ set(here["parts"]))
    check(not lost, differs(f"{lost[0] if lost else ''} is only in one of them; restart the scene that wrote it"))
    for body in here["meshes"]:
        same = there["meshes"].get(body) == here["meshes"][body] and np.allclose(
            there["extents"][body], here["extents"][body], rtol=1e-9, atol=1e-9 * max(map(abs, here["extents"][body]))
        )
        check(same, differs(f"the mesh of '{body}' is not the same; read the mesh with which it was written"))
    counts = there["unknowns"], here["unknowns"]
    check(
        counts[0] == counts[1], differs(f"it has {sum(counts[0])} unknowns, this one {sum(counts[1])}; use its order")
    )
    control = there["stepper"] == here["stepper"] and there["vectors"] == here["vectors"]
    check(control, differs(f"it was stepped by {there['stepper']}, with another control; take the same stepper"))


def _compare_energies(path: Path, here: Totals, there: dict[str, Any]) -> None:
    """Refuse a checkpoint whose energies these parameters do not give."""
    ours = {"kinetic": here.kinetic, **here.stored}
    theirs = {"kinetic": there["kinetic"], **there["stored"]}
    largest = max(abs(e) for e in theirs.values())
    for name, energy in ours.items():
        same = abs(energy - theirs.get(name, np.inf)) <= SAME * abs(energy) + 1e-9 * largest
        check(
            same,
            f"The checkpoint '{path}' is of another scene: the energy '{name}' is {theirs.get(name, 0.0):.6g} J there "
            f"and {energy:.6g} J here; restart with the same materials and gas.",
        )


def _plain(totals: Totals) -> dict[str, Any]:
    return {name: v.tolist() if isinstance(v, np.ndarray) else v for name, v in asdict(totals).items()}


def _name(step: int) -> str:
    return f"step-{step:08d}"


def _rank(rank: int) -> str:
    return f"rank-{rank:04d}.npz"


def _to_disk(file: Any) -> None:
    file.flush()
    os.fsync(file.fileno())
