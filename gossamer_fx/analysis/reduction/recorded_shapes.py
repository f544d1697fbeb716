"""Shapes of a film, in memory or from the folder of a run, for `reduce`.

Problem.  The run may have been made on another number of ranks, and may have been restarted, so the
field files list the nodes in another order than the film at hand.

Algorithm.

1. A node is identified by its point on the mesh, rounded to a cube of a small edge (`_names`).
2. Each rank reads a share of the points and displacements of each file (`_Part`).
3. Ranks exchange displacements by the names of their nodes (`algebra.rank_exchange.fetch`).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.algebra.rank_exchange import Names, fetch, hash_rows
from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check, check_on_all, on_rank_zero
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.records.outputs.adios import adios2_for
from gossamer_fx.records.outputs.field_files import noted_steps
from gossamer_fx.records.outputs.file_names import file_name, segments
from gossamer_fx.records.outputs.run_file import read_run_file
from gossamer_fx.records.outputs.schedule import Schedule
from gossamer_fx.solve.view import Run


@check_arguments
class Snapshots:
    """Output that keeps positions of a film's nodes in memory; each rank keeps those of the nodes
    that it owns.

    Args:
        body: the film.
        every: number of steps between two shapes.
        times: times [s] of the shapes, in place of `every`.

    Attributes:
        positions: list of arrays (n, 3) [m], one for each shape.

    Raises:
        InputError: when the run starts, the film is not in its scene.

    Example:
        >>> shapes = gx.reduction.Snapshots(film, every=10)
        >>> scene = gx.Scene(film, gx.Fixed(film, "left"), gx.Gravity(film))
        >>> gx.Simulation(scene, gx.Midpoint(dt=1e-3), outputs=[shapes]).run(until=2e-2)
        >>> len(shapes.positions)
        3
    """

    def __init__(self, body: Membrane, every: int = 1, *, times: Sequence[float] = ()) -> None:
        self.body = body
        self.schedule = Schedule(every, tuple(times))
        self.positions: list[Array] = []

    @property
    def times(self) -> Sequence[float]:
        """Times [s] at which the run has to end a step; empty if shapes follow steps."""
        return self.schedule.times

    def open(self, run: Run) -> None:
        check(
            self.body in run.system.bodies,
            f"Snapshots: '{self.body.name}' is not in the scene; give one of its films.",
        )
        self.positions.clear()

    def record(self, run: Run, last: bool) -> None:
        if self.schedule.due(run.step, run.time, last):
            # a copy: the state changes in place
            self.positions.append(run.system.state[self.body].positions().copy())

    def close(self, run: Run) -> None:
        """Do nothing: the shapes stay in memory."""


# Edge of the cubes as a share of the largest coordinate: points in the same cube are the same node.
CUBE_SIZE_RATIO = 1e-6

# Offset of the cubes, as a share of their edge.  A regular mesh has no nodes at the corners that it
# gives, where round-off would move them to another cube.
CUBE_OFFSET = 0.2718


@check_arguments
class RecordedShapes:
    """Shapes of a film at the times at which a `Recording` wrote its fields.

    The run may have been made on another number of ranks, and restarted.  Nodes are identified by
    their points on the mesh, so no two of them may coincide.  Collective.

    Args:
        body: a film with the mesh and the name of the one in the run.
        folder: of the run.

    Attributes:
        times: of the shapes [s].
        positions: of this rank's nodes (n, 3) [m], one array for each shape.

    Raises:
        InputError: the folder does not exist or has no fields of the film, the mesh has other
            nodes, or files are damaged.

    Example:
        >>> shapes = gx.reduction.RecordedShapes(film, "out/sail")  # doctest: +SKIP
        >>> reduced = gx.reduction.reduce(film, [shapes], modes=20)  # doctest: +SKIP
    """

    def __init__(self, body: Membrane, folder: str | Path) -> None:
        self.body = body
        self.folder = Path(folder)
        self.times: list[float] = []
        self.positions: list[Array] = []
        comm = body.comm
        owned = body.space.dofmap.index_map.size_local
        X = body.space.tabulate_dof_coordinates()[:owned]
        paths = self._files()
        largest = comm.allreduce(float(np.abs(X).max(initial=0.0)), MPI.MAX)
        self._cube_size = CUBE_SIZE_RATIO * (largest or 1.0)
        names = self._names(X)
        self._check_distinct(names)
        for path in paths:
            part = _Part(comm, path)
            other_mesh = (
                f"RecordedShapes: '{path}' is of another mesh than '{body.name}'; "
                "give the film that was recorded."
            )
            displacements = fetch(comm, self._names(part.X), part.displacements, names, other_mesh)
            by_time = displacements.reshape(owned, len(part.times), 3).transpose(1, 0, 2)
            self.times += part.times
            self.positions += list(X + by_time)

    def _files(self) -> list[Path]:
        """The field files of the film, one for each part of a run that was restarted.
        Collective."""
        comm = self.body.comm
        name = self.body.name
        path = self.folder / "fields" / f"{file_name(name)}.bp"

        def read() -> tuple[list[str], list[Path]]:
            return list(read_run_file(self.folder)["fields"]), segments(path)

        recorded, paths = comm.bcast(on_rank_zero(comm, read))
        check(
            name in recorded and bool(paths),
            f"RecordedShapes: the run in '{self.folder}' has no fields of '{name}' in ADIOS2 "
            "files, but fields of: "
            f"{', '.join(recorded) or 'none'}; give the film the name that it had there, and "
            "record "
            'with the format "vtx".',
        )
        return list(paths)

    def _names(self, X: Array) -> Names:
        """Names of the nodes at points X (n, 3) [m]: hashes of the cube of a grid in which the
        point lies, the same on every rank."""
        cubes = np.floor(X / self._cube_size + CUBE_OFFSET)
        return hash_rows(cubes.astype(np.int64))

    def _check_distinct(self, names: Names) -> None:
        """Check that no two nodes of all ranks have the same name (n,): files cannot distinguish
        nodes that lie on each other.  Collective."""
        coincide = (
            f"RecordedShapes: nodes of '{self.body.name}' lie on each other, "
            "so that they cannot be told apart in files; "
            "record its shapes in memory with `Snapshots`."
        )
        # All names of the same cube meet on one rank, which compares them; no values are exchanged.
        no_values = np.zeros((len(names), 0))
        fetch(self.body.comm, names, no_values, names[:0], "", coincide)


class _Part:
    """This rank's share of the points of one field file: times [s], points X (n, 3) [m] on the
    mesh, and displacements (n, 3 · times) [m]."""

    def __init__(self, comm: MPI.Intracomm, path: Path) -> None:
        """Read this rank's share of an ADIOS2 file.  Collective."""
        adios2 = adios2_for(path)
        on_rank_zero(comm, lambda: noted_steps(path))
        readable = True
        try:
            file = adios2.FileReader(str(path))
            self._read(file, comm)
            file.close()
        # adios2 raises whatever its C++ side throws.
        except Exception:
            readable = False
        check_on_all(
            comm, readable, f"'{path}' cannot be read; it is damaged, or holds no displacement."
        )

    def _read(self, file: Any, comm: MPI.Intracomm) -> None:
        """Read this rank's share of an open file; whatever ADIOS2 raises for a damaged one, the
        caller turns into `InputError`."""
        steps = file.num_steps()
        times = file.read("step", step_selection=[0, steps])
        self.times = [float(t) for t in np.ravel(times)]
        rows = self._own_rows(file, comm)

        def read(name: str, **which: Any) -> Array:
            """Rows (n, 3) of a variable that belong to this rank, block by block of the file."""
            parts: list[Array] = [np.zeros((0, 3))]
            for block, first, count in rows:
                values = file.read(
                    name, start=[first, 0], count=[count, 3], block_id=block, **which
                )
                parts.append(np.asarray(values).reshape(-1, 3))
            return np.concatenate(parts)

        self.X = read("geometry")
        displacements: list[Array] = [np.zeros((len(self.X), 0))]
        for k in range(steps):
            displacements.append(read("displacement", step_selection=[k, 1]))
        self.displacements = np.concatenate(displacements, axis=1)

    def _own_rows(self, file: Any, comm: MPI.Intracomm) -> list[tuple[int, int, int]]:
        """(block, first row, number of rows) of each block in which this rank has rows.  Each rank
        that wrote the file wrote one block; ranks that read it take equal shares of all rows."""
        blocks = file.all_blocks_info("geometry")[0]
        counts = [int(block["Count"].split(",")[0]) for block in blocks]
        ends = np.cumsum([0, *counts])
        share_start = int(ends[-1]) * comm.rank // comm.size
        share_end = int(ends[-1]) * (comm.rank + 1) // comm.size
        rows = []
        bounds = [int(end) for end in ends]
        for block, (start, end) in enumerate(pairwise(bounds)):
            first = max(share_start, start)
            last = min(share_end, end)
            if first < last:
                rows.append((block, first - start, last - first))
        return rows
