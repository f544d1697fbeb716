"""Checkpoints: all that a run needs to continue after its end, whatever ended it, on any number of
ranks; the names by which other ranks find their nodes; the refusal of a scene that differs.

A checkpoint is a folder such as `step-00000100` with the files

    run.json        time, states of the gas, sums of the ledger, history variables, step control,
                    description of the scene, positions of the outputs in their files
    rank-0000.npz   the share of one rank: for each block of unknowns the names of its nodes, and
                    their coordinates and velocities

Algorithm.

1. Write all files into the folder `.step-00000100`, and wait until they are on the disk.
2. Rename the folder to `step-00000100`.  A checkpoint therefore exists completely or not at all.
3. Remove the oldest checkpoints.

`run.json` contains its own checksum and those of all other files: a damaged checkpoint is refused.

Names of nodes.  A restart may have another number of ranks, and the order of nodes and the rank
that has them depend on the partition of the mesh.  Names do not: a node of a Lagrange space is
named after the vertices of the entity (vertex, edge or cell) on which it is, by their indices in
the mesh as it was read.  A multiplier is named after the first node that its constraint ties, and
by the number of constraints before it that tie the same node.  A name is a hash of these indices
with 64 bits.

Comparison with the scene.  A restart with another mesh, law or load would give wrong results
without an error.  Compared are names and kinds of the items, meshes, numbers of unknowns, the
stepper, the arguments of items and events (see `outputs.output`), and, in the restored state, the
energies.  Initial conditions are not compared: the state of the checkpoint replaces them.

Limits.  A checkpoint is read by the version of the package that wrote it, and by the scene that
wrote it.  Spaces have one node at most on an edge or cell, that is up to order 2.
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
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import basix
import numpy as np
import numpy.typing as npt

from gossamer_fx.core.algebra.rank_exchange import Names, fetch, hash_rows
from gossamer_fx.core.checks.arguments import Range, check_arguments, positive
from gossamer_fx.core.checks.errors import (
    InputError,
    are_usual_sizes,
    check,
    on_rank_zero,
    write_on_all,
)
from gossamer_fx.core.checks.strange_files import DAMAGED, check_inside, open_file
from gossamer_fx.core.forms.backend import geometry_nodes
from gossamer_fx.core.model.body import Array, Attached, Body, MeshBody, Port, has_nodal_unknowns
from gossamer_fx.records.outputs.output import (
    MEASURED,
    TOLERANCE,
    Known,
    arguments_of,
    cursors_of,
    make_parent,
)
from gossamer_fx.records.outputs.run_file import check_kind
from gossamer_fx.solve.steppers.history import History, SavedState, variables_of_data
from gossamer_fx.solve.steppers.stepping import Stepper
from gossamer_fx.solve.system.system import System
from gossamer_fx.solve.system.totals import Totals
from gossamer_fx.solve.view import StateView, SteppedRun
from gossamer_fx.version import VERSION

# A vertex, edge or cell has at most this many vertices; of fewer the last one is repeated, so that
# the rows of all entities have one length.
MAX_VERTICES = 3


def node_names(body: Body) -> Names:
    """Names (n,) of the n nodes of a body that this rank owns: integers of 64 bits.

    A name is the same on any number of ranks: it is a hash of the vertices of the vertex, edge or
    cell on which the node is.
    """
    start, end = body.block.index_map.local_range
    if not has_nodal_unknowns(body):
        # Masses and reduced films have no mesh; their blocks are numbered in the same way
        # everywhere.
        return hash_rows(np.arange(start, end)[:, None])
    layout = body.space.dofmap.dof_layout
    nodes = body.space.dofmap.list
    index_map = body.block.index_map
    node_count = index_map.size_local + index_map.num_ghosts
    entity_of_node = np.zeros((node_count, MAX_VERTICES), dtype=np.int64)
    vertices = cell_vertices(body)
    cell_type = basix.CellType[body.space.mesh.topology.cell_name()]
    for dim, entities in enumerate(basix.topology(cell_type)):
        for i, corners in enumerate(entities):
            nodes_here = layout.entity_dofs(dim, i)
            if not nodes_here:
                continue
            # Two nodes of an edge could not be told apart by its vertices.
            check(
                len(nodes_here) == 1,
                f"'{body.name}' has {len(nodes_here)} nodes on one edge or cell; checkpoints know "
                "one.",
            )
            # Sorted, as neighbouring cells have the vertices of an edge in different orders.
            vertices_of_entity = np.sort(vertices[:, corners], axis=1)
            missing = MAX_VERTICES - len(corners)
            rows = np.pad(vertices_of_entity, ((0, 0), (0, missing)), mode="edge")
            entity_of_node[nodes[:, nodes_here[0]]] = rows
    owned = entity_of_node[: end - start]
    return hash_rows(owned)


def cell_vertices(body: MeshBody) -> npt.NDArray[np.int64]:
    """Vertices (cells, k) of this rank's cells, own and ghost, by their indices in the mesh as it
    was read."""
    mesh = body.space.mesh
    # The first points of a cell are its corners, also if the geometry is of order 2.
    corner_count = mesh.topology.dim + 1
    corners = geometry_nodes(mesh)[:, :corner_count]
    return mesh.geometry.input_global_indices[corners]


def cell_names(body: MeshBody) -> Names:
    """Names (n,) of the n cells that this rank owns."""
    topology = body.space.mesh.topology
    own_count = topology.index_map(topology.dim).size_local
    return hash_rows(np.sort(cell_vertices(body)[:own_count], axis=1))


def mesh_name(body: MeshBody) -> int:
    """A number that depends on the cells of a mesh and not on their order; the same on every
    rank."""
    hashes = cell_names(body)
    # A sum does not depend on the order, nor on the partition.
    sum_of_rank = int(hashes.sum(dtype=np.uint64))
    total = sum(body.comm.allgather(sum_of_rank))
    return total % 2**64


def all_names(system: System) -> list[Names]:
    """Names of this rank's nodes of every block: bodies, then the multipliers of each constraint.

    Returns:
        an array (n,) of integers of 64 bits for each block, the same on any number of ranks.
    """
    names = [node_names(body) for body in system.unknowns.bodies]
    tied_ports: list[list[tuple[Attached, ...]]] = []
    if system.equations.constraints:
        tied_ports = system.equations.constraints.tied_ports()
    multiplier_blocks = system.unknowns.numbering.blocks[len(names) :]
    for ports, block in zip(tied_ports, multiplier_blocks, strict=True):
        # A single multiplier needs no name; it may tie the ground only, which has no node.
        if block.index_map.size_global == 1:
            names.append(hash_rows(np.zeros((len(ports), 1))))
        else:
            names.append(_names_of_multipliers(system, names, ports))
    return names


def _names_of_multipliers(
    system: System,
    names: list[Names],
    constraints: list[tuple[Attached, ...]],
) -> Names:
    """Names (m,) of the Lagrange multipliers of m constraints of this rank.

    A name is a hash of the first node that the constraint ties, which this rank owns, and of the
    number of constraints before it with the same first node.

    Args:
        names: of this rank's nodes of each body.
        constraints: the ports that each constraint ties.
    """
    rows = []
    counts: dict[tuple[int, int], int] = {}  # constraints so far by their first node
    for ports in constraints:
        port = next(port for port in ports if isinstance(port, Port))
        k = system.unknowns.bodies.index(port.body)
        first_owned = port.body.block.index_map.local_range[0]
        name = names[k][port.nodes[0] - first_owned]
        # Names have 64 bits without sign, rows of integers have 63 and a sign.
        node = (k, int(name >> np.uint64(1)))
        count = counts.get(node, 0)
        counts[node] = count + 1
        rows.append((*node, count))
    return hash_rows(np.array(rows, dtype=np.int64).reshape(-1, 3))


# Relative difference of arguments that counts as round-off: a script that is run again computes the
# same numbers, on another machine up to the last digits.
SAME_ARGUMENT = 1e-9

# The same for a component of a vector, over the vector's largest one: a cosine of π/2 is 6e-17, or
# zero.
SAME_COMPONENT = 1e-15

# The same for an energy that is computed again from the coordinates: sums over other ranks are in
# another order, and the strains of a stiff film are small differences.
SAME_ENERGY = 1e-6

# An energy may differ by this fraction of the largest energy: a small one may be all round-off.
NEGLIGIBLE_ENERGY = 1e-9

# Characters of a value in a message: an array would fill the screen.
MAX_SHOWN = 80

Description = dict[str, Any]


def scene_of(
    run: StateView, stepper: Stepper, history: History, events: Mapping[str, Description]
) -> Description:
    """Describe a scene for `compare`, as data for JSON that is the same on any number of ranks.
    Collective.

    Args:
        events: descriptions of the events by their keys, see `EventMonitor.describe`.
    """
    meshes: dict[str, Any] = {}
    for body in run.system.unknowns.bodies:
        if isinstance(body, MeshBody):
            geometry = body.space.mesh.geometry
            x = geometry.x[: geometry.index_map().size_local]
            # The name covers the cells; these sums notice a mesh that is scaled or moved.  Of the
            # two signs apart, as a sum that cancels is round-off, which differs with the partition.
            sums = np.concatenate([np.maximum(x, 0).sum(axis=0), np.maximum(-x, 0).sum(axis=0)])
            meshes[body.name] = [mesh_name(body), run.comm.allreduce(sums).tolist()]
    items = run.scene.items
    blocks = run.system.unknowns.numbering.blocks
    return {
        # Sorted, as the order of items does not matter.
        "parts": sorted(f"{type(item).__name__} '{item.name}'" for item in items),
        "meshes": meshes,
        "unknowns": [block.index_map.size_global * block.size for block in blocks],
        "stepping": [type(stepper).__name__, sorted(history.vectors)],
        "arguments": arguments_of(items),
        "events": events,
    }


def compare(path: Path, there: Description, here: Description, changes: Sequence[str]) -> None:
    """Raise `InputError` unless this scene is that of the checkpoint `path`.

    Args:
        there: description of the scene in the checkpoint, see `scene_of`.
        here: that of this scene.
        changes: names of the items and events whose arguments may differ.
    """
    refusal = f"The checkpoint '{path}' is of another scene: "
    # The order of the checks is that of their causes: another item also changes the unknowns.
    unmatched = sorted(set(there["parts"]) ^ set(here["parts"]))
    check(
        not unmatched,
        f"{refusal}{''.join(unmatched[:1])} is only in one of them; restart the scene that wrote "
        "it.",
    )
    for body, mesh in here["meshes"].items():
        check(
            next(differences(there["meshes"].get(body), mesh), None) is None,
            f"{refusal}the mesh of '{body}' is not the same; read the mesh with which it was "
            "written.",
        )
    check(
        there["unknowns"] == here["unknowns"],
        f"{refusal}it has {sum(there['unknowns'])} unknowns, this one {sum(here['unknowns'])}; use "
        "its order.",
    )
    check(
        there["stepping"] == here["stepping"],
        f"{refusal}it was stepped by {there['stepping'][0]}, with another control; take the same "
        "stepper.",
    )
    known = [*here["arguments"], *(event["name"] for event in here["events"].values())]
    # A misspelt name would let a difference pass as an error of the scene.
    for name in changes:
        check(
            name in known,
            f"changes holds '{name}', but the scene has no such part; it has: {', '.join(known)}.",
        )
    for key, arguments in here["arguments"].items():
        if key not in changes:
            _refuse_difference(refusal, f"'{key}'", there["arguments"][key], arguments)
    for key in sorted(there["events"].keys() | here["events"].keys()):
        one = there["events"].get(key)
        other = here["events"].get(key)
        if (other or one)["name"] in changes:
            continue
        check(
            bool(one and other),
            f"{refusal}the event {key} is only in one of them; restart with the same, or name it "
            "in changes.",
        )
        _refuse_difference(refusal, f"the event {key}", one, other)


def _refuse_difference(refusal: str, owner: str, there: Known, here: Known) -> None:
    """Raise `InputError` for the first difference between the arguments of an item or event, with
    both values."""
    for words, one, other in differences(there, here):
        raise InputError(
            f"{refusal}{' '.join(words)} of {owner} is {_shown(one)} there and {_shown(other)} "
            "here; restart with the same, or name it in changes."
        )


def differences(
    there: Known, here: Known, words: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], Known, Known]]:
    """Yield all differences of two descriptions: the names that lead to them, and both values.

    Numbers count as equal if they differ by less than `SAME_ARGUMENT` of their size, or by
    `SAME_COMPONENT` of the largest number of their list.

    Args:
        words: names that have led to these descriptions, e.g. ("law", "thickness").
    """
    if isinstance(there, dict) and isinstance(here, dict):
        # A position that was computed has a known error, which its description states.
        if MEASURED in there and MEASURED in here:
            if not np.allclose(there[MEASURED], here[MEASURED], rtol=0.0, atol=here[TOLERANCE]):
                yield words, there[MEASURED], here[MEASURED]
            return
        # The class comes first: of objects of two classes, all arguments differ.
        for key in sorted(there.keys() | here.keys(), key=lambda key: (key != "class", key)):
            yield from differences(there.get(key), here.get(key), (*words, key))
    elif isinstance(there, list) and isinstance(here, list) and len(there) == len(here):
        if all(map(_is_number, [*there, *here])):
            if not _same_numbers(there, here):
                yield words, there, here
            return
        for k, (one, other) in enumerate(zip(there, here, strict=True)):
            names = words
            # The message says which of several objects it means; they are counted from one.
            if isinstance(one, dict) and len(there) > 1:
                names = (*words, str(k + 1))
            yield from differences(one, other, names)
    elif _is_number(there) and _is_number(here):
        if not _same_numbers([there], [here]):
            yield words, there, here
    elif there != here:
        yield words, there, here


def _is_number(value: Known) -> bool:
    """Whether a value is a number; Python counts True and False as integers."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def _same_numbers(there: Sequence[float], here: Sequence[float]) -> bool:
    """Whether numbers are equal up to round-off; two NaN are equal."""
    expected = np.array(there, dtype=float)
    largest = np.abs(expected[np.isfinite(expected)]).max(initial=0.0)
    # The tolerance is relative only, since an area may be as small as 1e-13 m².
    return np.allclose(
        here, expected, rtol=SAME_ARGUMENT, atol=SAME_COMPONENT * largest, equal_nan=True
    )


def _shown(value: Known) -> str:
    """A value for a message, of `MAX_SHOWN` characters at most."""
    text = repr(value)
    if isinstance(value, float):
        # As many digits as are compared.
        text = f"{value:.9g}"
    if len(text) > MAX_SHOWN:
        return f"{text[:MAX_SHOWN]}..."
    return text


def compare_energies(path: Path, here: Totals, there: Mapping[str, Any]) -> None:
    """Check that this scene has the energies [J] of the checkpoint in the same state.

    This finds differences that a comparison of arguments cannot see, e.g. inside a law of the user.
    Energies may differ by `SAME_ENERGY` of their size and `NEGLIGIBLE_ENERGY` of the largest one;
    an energy that the checkpoint does not have is refused.

    Args:
        there: the "totals" in run.json.
    """
    ours = {"kinetic": here.kinetic, **here.stored}
    theirs = {"kinetic": there["kinetic"], **there["stored"]}
    largest = max(abs(energy) for energy in theirs.values())
    for name, energy in ours.items():
        tolerance = SAME_ENERGY * abs(energy) + NEGLIGIBLE_ENERGY * largest
        check(
            abs(energy - theirs.get(name, np.inf)) <= tolerance,
            f"The checkpoint '{path}' is of another scene: the energy '{name}' is "
            f"{theirs.get(name, 0.0):.6g} J there and {energy:.6g} J here; restart with the same "
            "materials and gas.",
        )


# Number of the format; it changes with the contents of the files.
FORMAT = 11

# Of the bits that describe a member of a zip file: its bytes are encrypted.
_ENCRYPTED = 1

# A file is summed in blocks of this many bytes, so that its size does not matter.
CHECKSUM_BLOCK = 1 << 20

MISSING_NODES = (
    "The checkpoint lacks nodes of this scene; restart the scene by which it was written."
)
MISSING_CELLS = (
    "The checkpoint lacks temperatures of this scene; restart the scene by which it was written."
)
EQUAL_NAMES = "Two nodes or cells of the checkpoint have the same name."

# Beginnings of the keys of arrays with one row for each cell.
CELL_NAMES = "names of cells"
CELL_VALUES = "cells"

# Kinds of the contents of run.json, see `check_kind`.
_STATE = {
    "scene": {
        "parts": [str],
        "meshes": {str: (object, [float])},
        "unknowns": [int],
        "stepping": (str, [str]),
        "arguments": {str: object},
        "events": {str: {"name": str}},
    },
    "ranks": int,
    "vectors": [str],
    "cells": [str],
    "parts": [(int, int)],
    "time": float,
    "time before": float,
    "supplied": float,
    "run": {str: object},
    "history": {str: object},
    "totals": {
        "kinetic": float,
        "stored": {str: float},
        "losses": {str: float},
    },
    "resultants": {str: object},
    "outputs": [(str, {str: object})],
}

# The kind of each output, and its position in its files.
Cursors = list[tuple[str, dict[str, Any]]]


@check_arguments
class Checkpoints:
    """Writes checkpoints of a run: at its start, at its end, and at intervals.

    Args:
        folder: for the checkpoints only.
        every: steps between two checkpoints; None: at intervals of time only.
        minutes: wall time between two checkpoints [min]; None: at intervals of steps only.
        keep: number of checkpoints that are kept.  Older ones are removed when a new one is
            complete.
        overwrite: whether a run that does not continue from the checkpoints in the folder may
            remove them.

    Attributes:
        seconds: wall time of writing [s].

    Raises:
        InputError: a value is out of its range.

    Example:
        >>> checkpoints = gx.Checkpoints(folder / "checkpoints", every=50)
        >>> free = gx.RigidBody(1.0, (1.0, 1.0, 1.0), comm=comm, name="free body")
        >>> swing = gx.Simulation(gx.Scene(free), gx.Midpoint(dt=0.1), checkpoints=checkpoints)
        >>> swing.run(until=1.0)
        >>> checkpoints.latest.name
        'step-00000010'
    """

    def __init__(
        self,
        folder: str | Path,
        every: Annotated[int, Range(1)] | None = 100,
        *,
        minutes: Annotated[float, positive("min")] | None = None,
        keep: Annotated[int, Range(1)] = 2,
        overwrite: bool = False,
    ) -> None:
        self.folder = Path(folder)
        self.every = every
        self.minutes = minutes
        self.keep = keep
        self.overwrite = overwrite
        self.seconds = 0.0
        self._written: int | None = None  # step of the last checkpoint

    def open(self, run: SteppedRun, scene: dict[str, Any], restart: str | Path | None) -> None:
        """Try whether the folder can be written, before anything is computed; the first checkpoint
        makes it.  Collective.

        Args:
            scene: its description, see `scene_of`.
            restart: the checkpoint, or folder of some, from which the run continues, if any.
        """
        tried = self.folder / ".step" if self.folder.is_dir() else self.folder
        make_parent(run.comm, tried, file=False)
        on_rank_zero(run.comm, lambda: self._check_free(restart))
        self._names = all_names(run.system)
        self._scene = scene
        self._clock = time.monotonic()
        # A restarted run finds the checkpoint of its first state in the folder.  If there are later
        # ones, of steps that it makes again, it writes one after its first step: until then a run
        # that is killed would go on from those.  Rank 0 decides, as not every rank may see the
        # folder.
        newest = latest_checkpoint(self.folder)
        self._written = None
        if run.comm.bcast(run.step > 0 and newest == self.folder / _folder_name(run.step)):
            self._written = run.step

    def _check_free(self, restart: str | Path | None) -> None:
        """Raise `InputError` if the folder has checkpoints that would be lost: those of a run that
        this one does not continue from `restart`; on rank 0."""
        newest = latest_checkpoint(self.folder)
        # The checkpoint of a start has no results that could be lost.
        if newest is None or _step(newest) == 0 or self.overwrite:
            return
        continues = False
        if restart is not None:
            source = Path(restart).resolve()
            continues = self.folder.resolve() in (source, source.parent)
        check(
            continues,
            f"'{self.folder}' holds checkpoints of a run up to step {_step(newest)}; go on from "
            "them with restart (--restart), replace them with overwrite=True (--overwrite), or "
            "give another folder.",
        )

    @property
    def latest(self) -> Path | None:
        """Folder of the last checkpoint of this run; None before the first."""
        if self._written is None:
            return None
        return self.folder / _folder_name(self._written)

    def record(self, run: SteppedRun, last: bool) -> None:
        """Write a checkpoint if it is due; called after the outputs have recorded the step.
        Collective.
        """
        if self._written == run.step:
            return
        is_first = self._written is None
        if not (last or is_first or self._is_due(run)):
            return
        started = time.perf_counter()
        self._write(run)
        self._written = run.step
        self._clock = time.monotonic()
        self.seconds += time.perf_counter() - started

    def _is_due(self, run: SteppedRun) -> bool:
        """Whether the interval of steps or of time has passed; the same on every rank."""
        if self.every is not None and run.step % self.every == 0:
            return True
        if self.minutes is None:
            return False
        elapsed = time.monotonic() - self._clock
        # Clocks differ: rank 0 decides.
        return bool(run.comm.bcast(elapsed >= 60 * self.minutes))

    def _write(self, run: SteppedRun) -> None:
        """Write a checkpoint of the present state by the algorithm of the module.  Collective.

        Folders of incomplete checkpoints (`.step-*`), a checkpoint of the same step, and those that
        are too old or of later steps are removed.
        """
        comm = run.comm
        path = self.folder / _folder_name(run.step)
        new = self.folder / f".{path.name}"
        state = self._state(run)
        checksums: list[list[int]] = []

        def prepare() -> None:
            if comm.rank == 0:
                # A run that was killed while it wrote may have left such a folder.
                for incomplete in self.folder.glob(".step-*"):
                    shutil.rmtree(incomplete, ignore_errors=True)
                new.mkdir(parents=True)

        def write_share() -> None:
            share = new / _rank_file(comm.rank)
            with share.open("wb") as file:
                np.savez(file, **self._arrays(run))
                _to_disk(file)
            checksums.append(_checksum(share))

        def complete_folder() -> None:
            """Write run.json with the checksums of all ranks, and rename the folder to its final
            name.
            """
            gathered = comm.gather(checksums[0])
            if comm.rank == 0:
                state["parts"] = gathered
                state["checksum"] = _checksum_of(state)
                with (new / "run.json").open("wb") as file:
                    file.write(_page(state))
                    _to_disk(file)
                # A folder is only renamed to a name that is free.
                shutil.rmtree(path, ignore_errors=True)
                new.rename(path)
                self._remove_old(path)

        try:
            # All ranks learn of the failure of one, before the next task is begun.
            write_on_all(comm, new, prepare)
            write_on_all(comm, new, write_share)
            write_on_all(comm, new, complete_folder)
        except Exception:
            if comm.rank == 0:
                shutil.rmtree(new, ignore_errors=True)
            raise

    def _remove_old(self, newest: Path) -> None:
        """Remove all checkpoints except the newest and those that are kept before it; on rank 0."""
        others = [path for path in complete(self.folder) if path != newest]
        # Later steps belong to a run that this one has replaced.
        earlier = [path for path in others if _step(path) < _step(newest)]
        # The newest one counts.  A negative start would count from the end of the list.
        first_kept = max(len(earlier) - self.keep + 1, 0)
        kept = earlier[first_kept:]
        for path in others:
            if path not in kept:
                shutil.rmtree(path, ignore_errors=True)

    def _arrays(self, run: SteppedRun) -> dict[str, Any]:
        """This rank's share of a checkpoint: arrays by name, for a file of NumPy.

        Args:
            run: with its vectors, e.g. coordinates [m] and velocities [m/s].

        Returns:
            for each block of unknowns the names (n,) of its n nodes on this rank and values (n,
            size) of every vector; also names (m,) and values (m, 1) of cells with history
            variables.
        """
        numbering = run.system.unknowns.numbering
        arrays: dict[str, Any] = {}
        for k, names in enumerate(self._names):
            arrays[f"names {k}"] = names
        for name, vector in run.history.vectors.items():
            for k, block in enumerate(numbering.blocks):
                values = vector.array_r[numbering.owned(k)]
                arrays[f"{name} {k}"] = values.reshape(-1, block.size)
        for name, (body, cell_values) in run.history.cells.items():
            arrays[f"{CELL_NAMES} {name}"] = cell_names(body)
            arrays[f"{CELL_VALUES} {name}"] = cell_values[:, None]
        return arrays

    def _state(self, run: SteppedRun) -> dict[str, Any]:
        """The contents of run.json, except checksums; the same on every rank.  Collective.

        Args:
            run: with its time [s], energies [J], history variables, counters, and outputs.
        """
        system = run.system
        cursors = run.cursors
        if run.recorded:
            cursors = cursors_of(run.outputs)
        return {
            "format": FORMAT,
            "version": VERSION,
            "scene": self._scene,
            "ranks": run.comm.size,
            "vectors": list(run.history.vectors),
            "cells": list(run.history.cells),
            "time": system.unknowns.time,
            "time before": system.unknowns.previous_time,
            "supplied": run.comm.allreduce(system.balance.supplied_energy),
            "run": run.get_history(),
            "history": run.history.variables_of_all_ranks(),
            "totals": run.totals.as_data(),
            "resultants": {
                name: value.tolist() for name, value in system.balance.resultants().items()
            },
            "outputs": cursors,
        }


def complete(folder: Path) -> list[Path]:
    """The checkpoints in a folder, oldest first."""
    found = []
    for path in folder.glob("step-*"):
        has_name = re.fullmatch(r"step-\d{8,}", path.name)
        if has_name and (path / "run.json").is_file():
            found.append(path)
    # By number, as more than eight digits would not be sorted by name.
    return sorted(found, key=_step)


@check_arguments
def latest_checkpoint(folder: str | Path) -> Path | None:
    """The newest complete checkpoint in a folder; None if there is none.

    Args:
        folder: of checkpoints; it need not exist.

    Returns:
        the folder of the checkpoint, such as `step-00000100`.

    Example:
        >>> print(gx.run.latest_checkpoint("no such folder"))
        None
    """
    found = complete(Path(folder))
    if not found:
        return None
    return found[-1]


def read(
    run: SteppedRun,
    restart: str | Path,
    scene: dict[str, Any],
    changes: Sequence[str],
) -> Cursors:
    """Restore the state of a checkpoint, and return the cursors of its outputs.  Collective.

    Args:
        restart: the checkpoint, or a folder, of which the newest is taken.
        scene: description of the scene of `run`, see `scene_of`.
        changes: names of the items and events whose arguments may differ.
    """
    comm = run.comm
    path, state = comm.bcast(on_rank_zero(comm, lambda: _open(Path(restart))))
    try:
        return _restore(run, path, state, scene, changes)
    except InputError:
        raise
    # Its checksums are right, so that it is not damaged by chance; all ranks have the same state.
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError) as error:
        reason = f"{type(error).__name__}: {error}"
        raise InputError(comm.bcast(_damaged(path, reason))) from error


def _restore(
    run: SteppedRun,
    path: Path,
    state: dict[str, Any],
    scene: dict[str, Any],
    changes: Sequence[str],
) -> Cursors:
    """Restore the state of a checkpoint, see `read`.  Collective.

    Args:
        path: of the checkpoint.
        state: the contents of its run.json.
    """
    comm = run.comm
    compare(path, state["scene"], scene, changes)
    arrays = _load_on_all(run, path, state)
    # The checkpoint contains sums over its ranks.  Here, rank 0 has them as its share.
    share = float(comm.rank == 0)
    losses = state["totals"]["losses"]
    balance = run.system.balance
    # Causes of losses that the scene or the checkpoint does not have begin, or remain, as they are.
    causes = {**losses, **balance.losses}
    saved = SavedState(
        time=state["time"],
        time_before=state["time before"],
        vectors=_vectors(run, arrays),
        cells=_cells(run, arrays),
        variables=variables_of_data(state["history"]),
        supplied_energy=share * state["supplied"],
        losses={name: share * losses.get(name, 0.0) for name in causes},
    )
    run.history.restore(saved)
    run.set_history(state["run"])
    loads = state["resultants"].items()
    balance.restored_resultants = {name: np.array(value) for name, value in loads}
    # Arguments that are meant to be others change the energies.
    if not changes:
        compare_energies(path, run.totals, state["totals"])
    return [(kind, cursor) for kind, cursor in state["outputs"]]


def _load_on_all(run: SteppedRun, path: Path, state: dict[str, Any]) -> dict[str, Any]:
    """The arrays that this rank reads of a checkpoint, see `_load`; if one rank cannot read its
    files, `InputError` on all.  Collective."""
    arrays: dict[str, Any] = {}
    reason = ""
    try:
        arrays = _load(run, path, state)
    except (
        OSError,
        ValueError,
        TypeError,
        LookupError,
        NotImplementedError,
        zipfile.BadZipFile,
        EOFError,
        zlib.error,
    ) as error:
        reason = f"{type(error).__name__}: {error}"
    reasons = [text for text in run.comm.allgather(reason) if text]
    if reasons:
        # The message names another checkpoint, which only some ranks may see.
        raise InputError(run.comm.bcast(_damaged(path, reasons[0])))
    return arrays


def _vectors(run: SteppedRun, arrays: dict[str, Any]) -> dict[str, Array]:
    """Coordinates, velocities and other vectors (n,) of this rank by name, from what all ranks have
    loaded.  Collective.

    Args:
        arrays: what this rank has read, see `_load`; it may belong to nodes of any rank.
    """
    numbering = run.system.unknowns.numbering
    names_here = all_names(run.system)
    found = {}
    for name, vector in run.history.vectors.items():
        found[name] = np.array(vector.array_r)
        for k, block in enumerate(numbering.blocks):
            rows = fetch(
                run.comm,
                names=arrays[f"names {k}"],
                values=arrays[f"{name} {k}"],
                wanted=names_here[k],
                lacks=MISSING_NODES,
                twice=EQUAL_NAMES,
            )
            found[name][numbering.owned(k)] = rows.reshape(-1, block.size).ravel()
    return found


def _cells(run: SteppedRun, arrays: dict[str, Any]) -> dict[str, Array]:
    """The history variables (n,) in this rank's cells by name, from what all ranks have loaded.
    Collective.

    Args:
        arrays: names of cells and their values that this rank has read, e.g. temperatures [K], for
            any cells.
    """
    found = {}
    for name, (body, _) in run.history.cells.items():
        nothing = np.zeros(0, dtype=np.uint64)
        rows = fetch(
            run.comm,
            names=arrays.get(f"{CELL_NAMES} {name}", nothing),
            values=arrays.get(f"{CELL_VALUES} {name}", np.zeros((0, 1))),
            wanted=cell_names(body),
            lacks=MISSING_CELLS,
            twice=EQUAL_NAMES,
        )
        found[name] = rows[:, 0]
    return found


def _open(path: Path) -> tuple[Path, dict[str, Any]]:
    """The folder of a checkpoint, and the contents of its run.json; on one rank."""
    folder: Path | None = path
    if not (path / "run.json").is_file():
        folder = latest_checkpoint(path)
    if folder is None:
        remedy = "give a folder of checkpoints, or start without restart."
        # Older checkpoints are removed: a wanted step may have been among them.
        others = [other.name for other in complete(path.parent)]
        if others:
            remedy = f"give one of the newest there, {', '.join(others[-3:])}."
        raise InputError(f"There is no checkpoint in '{path}'; {remedy}")
    try:
        with open_file(folder / "run.json", _home(folder)) as file:
            page = file.read()
        state = json.loads(page)
        written_format = state["format"]
        written_version = state["version"]
        checksum = state.pop("checksum", None)
        is_sound = checksum == _checksum_of(state)
    except InputError:
        raise
    except DAMAGED as error:
        raise InputError(_damaged(folder, f"run.json: {error}")) from error
    # Earlier formats had no checksum.  A wrong one means damage, also if the version differs.
    is_other_version = (written_format, written_version) != (FORMAT, VERSION)
    if is_other_version and (is_sound or checksum is None):
        raise InputError(
            f"The checkpoint '{folder}' was written by version {written_version} (format "
            f"{written_format}), this is {VERSION} (format {FORMAT}); restart with the version "
            "that wrote it."
        )
    # The checksum is one of values; the text is compared too, so that any changed byte is noticed.
    if not is_sound or page != _page(state | {"checksum": checksum}):
        raise InputError(_damaged(folder, "run.json was changed"))
    check_kind(folder / "run.json", "the file", state, _STATE)
    return folder, state


def _home(path: Path) -> Path:
    """The folder in which all files of a checkpoint are: that of its run, if it has one, else that
    of the checkpoints or the checkpoint that was given."""
    for folder in (path.parent.parent, path.parent):
        if (folder / "run.json").is_file():
            return folder
    return path


def _damaged(path: Path, reason: str) -> str:
    """A sentence about a damaged checkpoint, with the remedy."""
    others = [other for other in complete(path.parent) if other.resolve() != path.resolve()]
    remedy = "start again"
    if others:
        remedy = f"restart from another one, e.g. '{others[-1]}'"
    return f"The checkpoint '{path}' is damaged ({reason}); {remedy}."


def _load(run: SteppedRun, path: Path, state: dict[str, Any]) -> dict[str, Any]:
    """The shares of a checkpoint that this rank reads: of n ranks now, rank r reads the files r,
    r + n, r + 2 n, ...

    Returns:
        Names (n,) and vectors (n, size) of the n nodes in these shares, and those of cells, by the
        keys of `_arrays`; empty arrays on a rank without a file.
    """
    blocks = run.system.unknowns.numbering.blocks
    shares = []
    # The checkpoint may have more or fewer files than there are ranks now.
    for rank in range(run.comm.rank, state["ranks"], run.comm.size):
        share = path / _rank_file(rank)
        check_inside(share, _home(path))
        if _checksum(share) != state["parts"][rank]:
            raise ValueError(f"{share.name} was changed")
        shares.append(_read_arrays(share))
    arrays: dict[str, Any] = {}
    for k, block in enumerate(blocks):
        # Ranks without a file take part in the exchange with empty arrays.
        empty: dict[str, Any] = {f"names {k}": np.zeros(0, dtype=np.uint64)}
        for name in state["vectors"]:
            empty[f"{name} {k}"] = np.zeros((0, block.size))
        _join(shares, empty, arrays)
    for name in state["cells"]:
        no_cells: dict[str, Any] = {
            f"{CELL_NAMES} {name}": np.zeros(0, dtype=np.uint64),
            f"{CELL_VALUES} {name}": np.zeros((0, 1)),
        }
        _join(shares, no_cells, arrays)
    return arrays


def _read_arrays(share: Path) -> dict[str, Any]:
    """The arrays of a file of NumPy by name.

    They are read from bytes that exist: `numpy.load` takes the memory that a header asks for.

    Raises:
        ValueError: a header says another size than its bytes have, or asks for objects, which could
            run code of whoever wrote the file, or values are not usual numbers.
    """
    arrays: dict[str, Any] = {}
    with open_file(share) as file, zipfile.ZipFile(file) as archive:
        size = os.fstat(file.fileno()).st_size
        members = archive.infolist()
        # A run stores arrays as they are; the bytes of one may not stand for several.
        is_plain = all(
            member.compress_type == zipfile.ZIP_STORED and not member.flag_bits & _ENCRYPTED
            for member in members
        )
        if not is_plain or sum(member.file_size for member in members) > size:
            raise ValueError(f"{share.name} claims to be larger than it is")
        for member in members:
            name = member.filename.removesuffix(".npy")
            with archive.open(member) as content:
                version = np.lib.format.read_magic(content)
                read_header = np.lib.format.read_array_header_1_0
                if version != (1, 0):
                    read_header = np.lib.format.read_array_header_2_0
                shape, is_by_columns, kind = read_header(content)
                numbers = content.read()
            if kind.hasobject or kind.kind not in "uif":
                raise ValueError(f"{share.name} holds something else than numbers")
            order = "C"
            if is_by_columns:
                order = "F"
            array = np.frombuffer(numbers, dtype=kind).reshape(shape, order=order)  # type: ignore[call-overload]
            if kind.kind == "f" and not are_usual_sizes(array):
                raise ValueError(f"{share.name} holds values that are not numbers up to 1e100")
            arrays[name] = array
    return arrays


def _join(shares: list[dict[str, Any]], empty: dict[str, Any], arrays: dict[str, Any]) -> None:
    """Set `arrays` for each key of `empty` to the arrays of all shares, one after the other;
    without shares to the empty array."""
    for key, no_rows in empty.items():
        arrays[key] = no_rows
        for share in shares:
            if share[key].dtype != no_rows.dtype or share[key].shape[1:] != no_rows.shape[1:]:
                raise ValueError(f"'{key}' is an array of another kind")
        if shares:
            arrays[key] = np.concatenate([share[key] for share in shares])


def _folder_name(step: int) -> str:
    """Name of the folder of a checkpoint."""
    return f"step-{step:08d}"


def _step(path: Path) -> int:
    """Step of a checkpoint, from the name of its folder."""
    return int(path.name.removeprefix("step-"))


def _rank_file(rank: int) -> str:
    """Name of the file with the share of a rank."""
    return f"rank-{rank:04d}.npz"


def _page(state: dict[str, Any]) -> bytes:
    """The bytes of run.json, as they are written, and compared when it is read."""
    return json.dumps(state, indent=1).encode()


def _checksum_of(state: dict[str, Any]) -> str:
    """SHA-256 of the contents of run.json, except the checksum itself."""
    # Written and read once, so that keys and numbers are those that a reader of the file has.
    as_read = json.loads(json.dumps(state))
    text = json.dumps(as_read, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _checksum(path: Path) -> list[int]:
    """Length in bytes and CRC-32 of a file, which find damage and are faster than SHA-256."""
    crc = 0
    size = 0
    with open_file(path) as file:
        while block := file.read(CHECKSUM_BLOCK):
            crc = zlib.crc32(block, crc)
            size += len(block)
    return [size, crc]


def _to_disk(file: Any) -> None:
    """Wait until a file is on the disk: a rename must not come before its contents."""
    file.flush()
    os.fsync(file.fileno())
