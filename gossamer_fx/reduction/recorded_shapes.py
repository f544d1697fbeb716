"""Shapes of a film from the folder of a run, for `reduce`."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.algebra.rendezvous import Names, fetch, hash_rows
from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check, check_on_all, on_rank_zero
from gossamer_fx.model.body import Array
from gossamer_fx.outputs.adios import adios2_for
from gossamer_fx.outputs.field_files import noted_steps
from gossamer_fx.outputs.file_names import file_name, segments
from gossamer_fx.outputs.run_file import read_run_file

# Places that are nearer to each other, over the largest coordinate, are one.  They are sorted into cubes of that size,
# whose corners lie where no regular mesh has nodes.
ALIKE, CORNER = 1e-6, 0.2718


@check_arguments
class RecordedShapes:
    """Positions of a film's nodes at the times at which a `Recording` wrote its fields, for `reduce`.

    The run may have been made on another number of ranks, and have been continued; each rank reads a part of the files,
    and ends with the positions of its own nodes.  Nodes are known by their places in the mesh: no two may coincide.

    Args:
        body: with the mesh and the name of the one in the run.
        folder: of the run.

    Attributes:
        times: of the shapes [s].
        positions: (n, 3) [m], at each of them.

    Raises:
        InputError: no such folder or film, a mesh with other nodes, damaged files.
    """

    def __init__(self, body: Membrane, folder: str | Path) -> None:
        self.body, self.folder = body, Path(folder)
        comm = body.comm
        path = self.folder / "fields" / f"{file_name(body.name)}.bp"
        recorded, paths = comm.bcast(
            on_rank_zero(comm, lambda: (list(read_run_file(self.folder)["fields"]), segments(path)))
        )
        check(
            body.name in recorded and bool(paths),
            f"RecordedShapes: the run in '{folder}' has no fields of '{body.name}', but of: "
            f"{', '.join(recorded) or 'none'}; give the film the name that it had there.",
        )
        X = body.space.tabulate_dof_coordinates()[: body.space.dofmap.index_map.size_local]
        self._pitch = ALIKE * (comm.allreduce(float(np.abs(X).max(initial=0.0)), MPI.MAX) or 1.0)
        names = self._names(X)
        self._check_apart(names)
        self.times: list[float] = []
        self.positions: list[Array] = []
        for one in paths:
            part = _Part(comm, one)
            lacks = f"RecordedShapes: '{one}' is of another mesh than '{body.name}'; give the film that was recorded."
            moved = fetch(comm, self._names(part.X), part.displacements, names, lacks)
            self.times += part.times
            self.positions += list(X + moved.reshape(len(X), len(part.times), 3).transpose(1, 0, 2))

    def _names(self, X: Array) -> Names:
        return hash_rows(np.floor(X / self._pitch + CORNER).astype(np.int64))

    def _check_apart(self, names: Names) -> None:
        """See that no two nodes have the same place."""
        twice = (
            f"RecordedShapes: nodes of '{self.body.name}' lie on each other, so that they cannot be told apart in "
            "files; keep its shapes in memory by `Snapshots`."
        )
        fetch(
            self.body.comm, names, np.zeros((len(names), 0)), names[:0], "", twice
        )  # where names meet


class _Part:
    """This rank's share of the points of one file: X (n, 3), and their displacements (n, 3 · times)."""

    def __init__(self, comm: MPI.Intracomm, path: Path) -> None:
        adios2 = adios2_for(path)
        on_rank_zero(comm, lambda: noted_steps(path))
        whole = True
        try:
            file = adios2.FileReader(str(path))
            steps = file.num_steps()
            self.times = [float(t) for t in np.ravel(file.read("step", step_selection=[0, steps]))]
            counts = [
                int(block["Count"].split(",")[0]) for block in file.all_blocks_info("geometry")[0]
            ]
            ends = np.cumsum([0, *counts])
            share = ends[-1] * np.array([comm.rank, comm.rank + 1]) // comm.size
            rows = [
                (block, max(share[0] - first, 0), min(share[1], last) - max(share[0], first))
                for block, (first, last) in enumerate(pairwise(ends))
                if max(share[0], first) < min(share[1], last)
            ]

            def read(name: str, **which: Any) -> Array:
                parts = [
                    np.asarray(
                        file.read(
                            name, start=[int(at), 0], count=[int(n), 3], block_id=block, **which
                        )
                    )
                    for block, at, n in rows
                ]
                return np.concatenate([np.zeros((0, 3)), *[part.reshape(-1, 3) for part in parts]])

            self.X = read("geometry")
            shapes = [read("displacement", step_selection=[k, 1]) for k in range(steps)]
            self.displacements = np.concatenate([np.zeros((len(self.X), 0)), *shapes], axis=1)
            file.close()
        except Exception:  # adios2 raises what its C++ side throws
            whole = False
        check_on_all(
            comm, whole, f"'{path}' cannot be read; it is damaged, or holds no displacement."
        )
