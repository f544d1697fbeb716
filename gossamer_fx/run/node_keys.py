"""Names of nodes that stay the same on any number of ranks, and values that are asked for by name.

A node of a Lagrange space is named after the vertices of the entity on which it sits, by their numbers in the mesh as
it was read; a multiplier after the first node that it ties.  A name is a hash of 64 bits.
"""

from __future__ import annotations

from typing import Any

import basix
import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from gossamer_fx.checks.errors import check, check_on_all
from gossamer_fx.model.terms import Attached, Body, MeshBody, Port, has_nodal_unknowns
from gossamer_fx.system.system import System

Names = npt.NDArray[np.uint64]


def hash_rows(words: npt.NDArray[Any]) -> Names:
    """Hashes (n,) of rows of integers (n, k): Stafford's variant 13 of the 64-bit finaliser, word after word."""
    h: Names = np.full(len(words), 0x9E3779B97F4A7C15, dtype=np.uint64)
    for word in words.T.astype(np.int64).view(np.uint64):
        h = h ^ word
        for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
            h = (h ^ (h >> np.uint64(shift))) * np.uint64(factor)
        h = h ^ (h >> np.uint64(31))
        h = h + np.uint64(0x9E3779B97F4A7C15)
    return h


def node_names(body: Body) -> Names:
    """Names of this rank's own nodes of a body."""
    start, end = body.block.index_map.local_range
    if not has_nodal_unknowns(body):
        return hash_rows(np.arange(start, end)[:, None])
    layout, nodes = body.space.dofmap.dof_layout, body.space.dofmap.list
    words = np.zeros((body.block.index_map.size_local + body.block.index_map.num_ghosts, 3), dtype=np.int64)
    vertices, topology = cell_vertices(body), basix.topology(basix.CellType[body.space.mesh.topology.cell_name()])
    for dim, entities in enumerate(topology):
        for i, corners in enumerate(entities):
            here = layout.entity_dofs(dim, i)
            if here:
                check(len(here) == 1, f"'{body.name}' has {len(here)} nodes on one edge or cell; checkpoints know one.")
                of = np.sort(vertices[:, corners], axis=1)
                words[nodes[:, here[0]]] = np.pad(of, ((0, 0), (0, 3 - len(corners))), mode="edge")
    return hash_rows(words[: end - start])


def cell_vertices(body: MeshBody) -> npt.NDArray[np.int64]:
    """Vertices (cells, k) of this rank's cells, own and ghost, by their numbers in the mesh as it was read."""
    geometry, corners = body.space.mesh.geometry, body.space.mesh.topology.dim + 1
    own: npt.NDArray[np.int64] = geometry.input_global_indices[geometry.dofmap[:, :corners]]
    return own


def mesh_name(body: MeshBody) -> int:
    """A number that depends on the cells of a mesh and not on their order; the same on every rank."""
    topology = body.space.mesh.topology
    cells = cell_vertices(body)[: topology.index_map(topology.dim).size_local]
    hashes = hash_rows(np.sort(cells, axis=1))
    return sum(body.comm.allgather(int(hashes.sum(dtype=np.uint64)))) % 2**64


def all_names(system: System) -> list[Names]:
    """Names of this rank's own nodes of every block of a system: bodies, then the multipliers of each constraint."""
    names = [node_names(body) for body in system.bodies]
    tied = system.constraints.places() if system.constraints else []
    for places, block in zip(tied, system.numbering.blocks[len(names) :], strict=True):
        alone = block.index_map.size_global == 1
        names.append(hash_rows(np.zeros((len(places), 1))) if alone else _after_nodes(system, names, places))
    return names


def _after_nodes(system: System, names: list[Names], places: list[tuple[Attached, ...]]) -> Names:
    """Of each place: the first node that it ties, and how many places before it have the same one."""
    words, seen = [], dict[tuple[int, int], int]()
    for place in places:
        port = next(p for p in place if isinstance(p, Port))
        k = system.bodies.index(port.body)
        key = k, int(names[k][port.nodes[0] - port.body.block.index_map.local_range[0]] >> np.uint64(1))
        seen[key] = seen.get(key, -1) + 1
        words.append((*key, seen[key]))
    return hash_rows(np.array(words, dtype=np.int64).reshape(-1, 3))


def fetch(comm: MPI.Intracomm, names: npt.NDArray[Any], values: npt.NDArray[Any], wanted: Names) -> npt.NDArray[Any]:
    """Values (m, k) of the wanted names (m,), whatever rank has them.

    Each name has a rank where those that have it meet those that want it.

    Raises:
        InputError: a name that nobody has, or two nodes of one name.
    """
    size = np.uint64(comm.size)
    homes = [np.flatnonzero(names % size == r) for r in range(comm.size)]
    brought = comm.alltoall([(names[i], values[i]) for i in homes])
    known, rows = np.concatenate([n for n, _ in brought]), np.concatenate([v for _, v in brought])
    order = np.argsort(known)
    known, rows = known[order], rows[order]
    check_on_all(comm, bool((known[1:] != known[:-1]).all()), "Two nodes of the checkpoint have the same name.")
    askers = [np.flatnonzero(wanted % size == r) for r in range(comm.size)]
    asked = comm.alltoall([wanted[i] for i in askers])
    at = [np.minimum(np.searchsorted(known, a), max(len(known) - 1, 0)) for a in asked]
    found = all(len(known) > 0 and bool((known[i] == a).all()) for i, a in zip(at, asked, strict=True) if len(a))
    check_on_all(comm, found, "The checkpoint lacks nodes of this scene; restart the scene by which it was written.")
    answers = comm.alltoall([rows[i] if len(rows) else rows for i in at])
    result = np.zeros((len(wanted), values.shape[1]))
    for i, answer in zip(askers, answers, strict=True):
        result[i] = answer
    return result
