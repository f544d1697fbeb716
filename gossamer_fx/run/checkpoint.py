"""Checkpoints: all that a run needs to go on after its end, whatever ended it, on any number of ranks.

A checkpoint is a folder `step-00000100`:

    run.json        numbers and words: time, gas, ledger sums, controllers, step control, where the outputs stand
    rank-0000.npz   the values of one rank: for each block the names of its nodes, coordinates and velocities

It is written as `.step-00000100` in the same folder and renamed when all is on the disk, so it exists
completely or not at all.
`run.json` holds a checksum of itself and of every other file.  Nodes are found by `node_names`, not by their order.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import time
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from gossamer_fx.algebra.rendezvous import fetch
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import InputError, check, on_rank_zero, write_on_all
from gossamer_fx.model.roles import HistoryVariables
from gossamer_fx.outputs.output import Output, cursors_of, make_parent
from gossamer_fx.probes.run import Run
from gossamer_fx.run.node_keys import all_names
from gossamer_fx.run.same_scene import compare, compare_energies
from gossamer_fx.system.totals import Totals
from gossamer_fx.version import VERSION

FORMAT = 5
LACKS = "The checkpoint lacks nodes of this scene; restart the scene by which it was written."
TWICE = "Two nodes of the checkpoint have the same name."


class SavedRun(Run, HistoryVariables, Protocol):
    """A run, and its outputs, whose cursors are saved with it.

    `recorded` says whether the outputs have seen the present state; if not, `cursors` are theirs of before.
    """

    outputs: list[Output]
    recorded: bool
    cursors: list[tuple[str, dict[str, Any]]]


@check_arguments
class Checkpoints:
    """Where a run writes its checkpoints, and when: at the start, at the end, and in between.

    Args:
        folder: it holds nothing else.
        every: steps between two checkpoints; None: only by time.
        minutes: time between two checkpoints; None: only by steps.
        keep: how many are kept; older ones are removed when a new one is complete.
        overwrite: whether a run that does not go on from the folder's checkpoints may remove them.

    Raises:
        InputError: the folder cannot be made or written, or holds checkpoints that would be lost.
    """

    def __init__(
        self,
        folder: str | Path,
        every: int | None = 100,
        *,
        minutes: float | None = None,
        keep: int = 2,
        overwrite: bool = False,
    ) -> None:
        self.folder, self.every, self.minutes, self.keep = Path(folder), every, minutes, keep
        self.overwrite = overwrite
        check(
            every is None or (isinstance(every, int) and every >= 1),
            f"Checkpoints: every is {every!r}; give a number of steps, or None.",
        )
        check(
            minutes is None or minutes > 0,
            f"Checkpoints: minutes is {minutes!r}; give a positive number, or None.",
        )
        check(
            isinstance(keep, int) and keep >= 1,
            f"Checkpoints: keep is {keep!r}; keep at least one.",
        )
        self.seconds = 0.0  # spent in writing
        self._written: int | None = None

    def open(self, run: SavedRun, scene: dict[str, Any], restart: str | Path | None) -> None:
        """Before anything is computed.

        Args:
            run: at its start, or as it was restarted.
            scene: what tells it from others, see `scene_of`.
            restart: where it was restarted from.
        """
        make_parent(run.comm, self.folder / "step")
        on_rank_zero(run.comm, lambda: self._check_free(restart))
        self._names = all_names(run.system)
        self._scene = scene
        self._clock = time.monotonic()
        there = run.step > 0 and (self.folder / _name(run.step)).is_dir()
        self._written = run.step if run.comm.bcast(there) else None

    def _check_free(self, restart: str | Path | None) -> None:
        """Raise `InputError` if checkpoints would be lost that the run does not go on from."""
        newest = latest_checkpoint(self.folder)
        if newest is None or _step(newest) == 0 or self.overwrite:
            return
        own = restart is not None and self.folder.resolve() in (
            Path(restart).resolve(),
            Path(restart).resolve().parent,
        )
        check(
            own,
            f"'{self.folder}' holds checkpoints of a run up to step {_step(newest)}; go on from them with restart "
            "(--restart), replace them with overwrite=True (--overwrite), or give another folder.",
        )

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
        checksums: list[list[int]] = []

        def prepare() -> None:
            if comm.rank == 0:
                for left in self.folder.glob(".step-*"):
                    shutil.rmtree(left, ignore_errors=True)
                new.mkdir()

        def own_part() -> None:
            part = new / _rank(comm.rank)
            with part.open("wb") as file:
                np.savez(file, **self._arrays(run))
                _to_disk(file)
            checksums.append(_checksum(part))

        def finish() -> None:
            gathered = comm.gather(checksums[0])
            if comm.rank == 0:
                state["parts"] = gathered
                state["checksum"] = _checksum_of(state)
                with (new / "run.json").open("wb") as file:
                    file.write(_page(state))
                    _to_disk(file)
                shutil.rmtree(path, ignore_errors=True)
                new.rename(path)
                others = [p for p in complete(self.folder) if p != path]
                before = [p for p in others if _step(p) < run.step]
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
        return {
            "format": FORMAT,
            "version": VERSION,
            "scene": self._scene,
            "ranks": run.comm.size,
            "vectors": list(run.history.vectors),
            "time": system.time,
            "supplied": run.comm.allreduce(system.supplied_energy),
            "run": run.get_state(),
            "history": run.history.get_state(),
            "totals": _plain(run.totals),
            "outputs": cursors_of(run.outputs) if run.recorded else run.cursors,
        }


def complete(folder: Path) -> list[Path]:
    """The checkpoints in a folder, oldest first."""
    found = [
        p
        for p in folder.glob("step-*")
        if re.fullmatch(r"step-\d{8,}", p.name) and (p / "run.json").is_file()
    ]
    return sorted(found, key=_step)


@check_arguments
def latest_checkpoint(folder: str | Path) -> Path | None:
    """The newest complete checkpoint in a folder, if there is one."""
    return next(reversed(complete(Path(folder))), None)


def read(
    run: SavedRun, restart: str | Path, scene: dict[str, Any], changes: Sequence[str]
) -> tuple[list[tuple[str, dict[str, Any]]], str]:
    """Give a run, which stands at its start, the state of a checkpoint.

    Args:
        run: to be given the state.
        restart: a checkpoint, or a folder, of which the newest one is taken.
        scene: what tells the run from others, see `scene_of`.
        changes: names of parts and events whose parameters are meant to be others.

    Returns:
        Where its outputs stood, and what of the scene could not be compared.

    Raises:
        InputError: there is none, it is damaged, of another version, or of another scene.
    """
    path, state = run.comm.bcast(on_rank_zero(run.comm, lambda: _open(Path(restart))))
    unknown = compare(path, state["scene"], scene, changes)
    try:
        arrays, reason = _load(run, path, state), ""
    except (OSError, ValueError, KeyError, zipfile.BadZipFile, EOFError, zlib.error) as error:
        arrays, reason = {}, f"{type(error).__name__}: {error}"
    reason = next(filter(None, run.comm.allgather(reason)), "")
    if reason:
        raise InputError(run.comm.bcast(_damaged(path, reason)))
    system, numbering = run.system, run.system.numbering
    here = all_names(system)
    for name, vector in run.history.vectors.items():
        with vector as values:
            for k, block in enumerate(numbering.blocks):
                rows = fetch(
                    run.comm, arrays[f"names {k}"], arrays[f"{name} {k}"], here[k], LACKS, TWICE
                )
                values[numbering.owned(k)] = rows.reshape(-1, block.size).ravel()
    first, before = (
        float(run.comm.rank == 0),
        state["totals"]["losses"],
    )  # of all ranks: the first carries them on
    system.time, system.supplied_energy = state["time"], first * state["supplied"]
    system.losses = {name: first * before.get(name, 0.0) for name in {**before, **system.losses}}
    run.history.set_state(state["history"])
    run.set_state(state["run"])
    if not changes:
        compare_energies(path, run.totals, state["totals"])
    return [(kind, cursor) for kind, cursor in state["outputs"]], unknown


def _open(path: Path) -> tuple[Path, dict[str, Any]]:
    chosen = path if (path / "run.json").is_file() else latest_checkpoint(path)
    if chosen is None:
        raise InputError(
            f"There is no checkpoint in '{path}'; give a folder of checkpoints, or start without restart."
        )
    try:
        page = (chosen / "run.json").read_bytes()
        state = json.loads(page)
        found, told = (state["format"], state["version"]), state.pop("checksum", None)
        sound = told == _checksum_of(state)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(_damaged(chosen, f"run.json: {error}")) from error
    ours = FORMAT, VERSION
    if found != ours and (sound or told is None):
        raise InputError(
            f"The checkpoint '{chosen}' was written by version {found[1]} (format {found[0]}), this is {ours[1]} "
            f"(format {ours[0]}); restart with the version that wrote it."
        )
    if not sound or page != _page(state | {"checksum": told}):
        raise InputError(_damaged(chosen, "run.json was changed"))
    return chosen, state


def _damaged(path: Path, reason: str) -> str:
    """A sentence about a damaged checkpoint, with the remedy."""
    others = [p for p in complete(path.parent) if p.resolve() != path.resolve()]
    remedy = f"restart from another one, e.g. '{others[-1]}'" if others else "start again"
    return f"The checkpoint '{path}' is damaged ({reason}); {remedy}."


def _load(run: SavedRun, path: Path, state: dict[str, Any]) -> dict[str, Any]:
    """The parts of the ranks that this rank reads, one after the other."""
    names = [
        f"{what} {k}"
        for what in ("names", *state["vectors"])
        for k in range(len(run.system.numbering.blocks))
    ]
    parts = []
    for rank in range(run.comm.rank, state["ranks"], run.comm.size):
        part = path / _rank(rank)
        if _checksum(part) != state["parts"][rank]:
            raise ValueError(f"{part.name} was changed")
        with np.load(part, allow_pickle=False) as file:
            parts.append({name: file[name] for name in names})
    if not parts:
        sizes = [block.size for block in run.system.numbering.blocks]
        empty: dict[str, Any] = {
            f"names {k}": np.zeros(0, dtype=np.uint64) for k in range(len(sizes))
        }
        empty |= {
            f"{what} {k}": np.zeros((0, size))
            for what in state["vectors"]
            for k, size in enumerate(sizes)
        }
        return empty
    return {name: np.concatenate([part[name] for part in parts]) for name in names}


def _plain(totals: Totals) -> dict[str, Any]:
    return {
        name: v.tolist() if isinstance(v, np.ndarray) else v for name, v in asdict(totals).items()
    }


def _name(step: int) -> str:
    return f"step-{step:08d}"


def _step(path: Path) -> int:
    """Of a checkpoint."""
    return int(path.name.removeprefix("step-"))


def _page(state: dict[str, Any]) -> bytes:
    """What `run.json` holds of a state, to the last byte."""
    return json.dumps(state, indent=1).encode()


def _checksum_of(state: dict[str, Any]) -> str:
    """Checksum of everything else in `run.json`."""
    text = json.dumps(json.loads(json.dumps(state)), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _checksum(path: Path) -> list[int]:
    """Length and CRC-32 of a file."""
    crc, size = 0, 0
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            crc, size = zlib.crc32(block, crc), size + len(block)
    return [size, crc]


def _rank(rank: int) -> str:
    return f"rank-{rank:04d}.npz"


def _to_disk(file: Any) -> None:
    file.flush()
    os.fsync(file.fileno())
