"""Shapes of a film, in memory or from the folder of a run, for `reduce`.

Problem.  The run may have been made on another number of ranks, and may have been restarted, so the
field files list the nodes in another order than the film at hand.

Algorithm.

1. A node is identified by its point on the mesh, rounded to a cube of a small edge (`_names`).
2. Each rank reads the files of some of the ranks that wrote them (`_own_share`).
3. Ranks exchange displacements by the names of their nodes (`algebra.rank_exchange.fetch`).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.algebra.rank_exchange import Names, fetch, hash_rows
from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import InputError, check, on_rank_zero
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.records.fields.units import with_unit
from gossamer_fx.records.outputs.output import Schedule
from gossamer_fx.records.outputs.run_file import file_name, read_run_file
from gossamer_fx.records.outputs.vtu import FieldRecords, read_records
from gossamer_fx.records.outputs.vtu_format import read_vtu
from gossamer_fx.solve.view import StateView


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

    def open(self, run: StateView) -> None:
        check(
            self.body in run.system.bodies,
            f"Snapshots: '{self.body.name}' is not in the scene; give one of its films.",
        )
        self.positions.clear()

    def record(self, run: StateView, last: bool) -> None:
        if self.schedule.due(run.step, run.time, last):
            # a copy: the state changes in place
            self.positions.append(run.system.state[self.body].positions().copy())

    def close(self, run: StateView) -> None:
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
        path = self._file()
        largest = comm.allreduce(float(np.abs(X).max(initial=0.0)), MPI.MAX)
        self._cube_size = CUBE_SIZE_RATIO * (largest or 1.0)
        names = self._names(X)
        self._check_distinct(names)
        other_mesh = (
            f"RecordedShapes: '{path}' is of another mesh than '{body.name}'; give the film that "
            "was recorded."
        )
        # Each restart may have divided the mesh among its ranks in another way.
        for records in comm.bcast(on_rank_zero(comm, lambda: read_records(path))):
            points, shares = _own_share(comm, records)
            displacements = fetch(comm, self._names(points), shares, names, other_mesh)
            by_time = displacements.reshape(owned, len(records.times), 3).transpose(1, 0, 2)
            self.times += records.times
            self.positions += list(X + by_time)

    def _file(self) -> Path:
        """The list of the field files of the film.  Collective.

        Raises:
            InputError: the folder is not that of a run, or has no fields of a film of this name.
        """
        comm = self.body.comm
        name = self.body.name
        about = comm.bcast(on_rank_zero(comm, lambda: read_run_file(self.folder)))
        recorded = list(about["fields"])
        check(
            name in recorded,
            f"RecordedShapes: the run in '{self.folder}' has no fields of '{name}', but fields of: "
            f"{', '.join(recorded) or 'none'}; give the film the name that it had there.",
        )
        return self.folder / "fields" / f"{file_name(name)}.pvd"

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


def _own_share(comm: MPI.Intracomm, records: FieldRecords) -> tuple[Array, Array]:
    """This rank's share of the points of some records.

    Each rank that wrote the records wrote one file; ranks that read take turns.

    Returns:
        points (n, 3) on the mesh [m], and displacements (n, 3 · times) [m].

    Raises:
        InputError: on all ranks, if a file is missing or damaged, or has no displacement.
    """
    points: list[Array] = [np.zeros((0, 3))]
    displacements: list[Array] = [np.zeros((0, 3 * len(records.times)))]
    reason = ""
    try:
        for part in range(comm.rank, len(records.meshes), comm.size):
            X = read_vtu(records.meshes[part]).points
            of_times = [_displacement(files[part], len(X)) for files in records.files]
            points.append(X)
            displacements.append(np.concatenate(of_times, axis=1))
    except InputError as error:
        reason = str(error)
    reasons = [text for text in comm.allgather(reason) if text]
    if reasons:
        raise InputError(reasons[0])
    return np.concatenate(points), np.concatenate(displacements)


def _displacement(file: Path, count: int) -> Array:
    """The displacement (n, 3) [m] of the points in a file, which must be so many."""
    found = read_vtu(file).arrays.get(with_unit("displacement"), np.zeros(0))
    check(
        found.shape == (count, 3),
        f"'{file}' is damaged: it has no displacement of {count} points; write the run again.",
    )
    return found
