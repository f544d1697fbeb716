"""Names of nodes that stay the same on any number of ranks.

A node of a Lagrange space is named after the vertices of the entity on which it sits, by their numbers in the mesh as
it was read; a multiplier after the first node that it ties.  A name is a hash of 64 bits.
"""

from __future__ import annotations

import basix
import numpy as np
import numpy.typing as npt

from gossamer_fx.algebra.rendezvous import Names, hash_rows
from gossamer_fx.checks.errors import check
from gossamer_fx.model.body import Attached, Body, MeshBody, Port, has_nodal_unknowns
from gossamer_fx.system.system import System


def node_names(body: Body) -> Names:
    """Names of this rank's own nodes of a body."""
    start, end = body.block.index_map.local_range
    if not has_nodal_unknowns(body):
        return hash_rows(np.arange(start, end)[:, None])
    layout, nodes = body.space.dofmap.dof_layout, body.space.dofmap.list
    words = np.zeros(
        (body.block.index_map.size_local + body.block.index_map.num_ghosts, 3), dtype=np.int64
    )
    vertices, topology = (
        cell_vertices(body),
        basix.topology(basix.CellType[body.space.mesh.topology.cell_name()]),
    )
    for dim, entities in enumerate(topology):
        for i, corners in enumerate(entities):
            here = layout.entity_dofs(dim, i)
            if here:
                check(
                    len(here) == 1,
                    f"'{body.name}' has {len(here)} nodes on one edge or cell; checkpoints know one.",
                )
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
    tied = system.constraints.tied_ports() if system.constraints else []
    for places, block in zip(tied, system.numbering.blocks[len(names) :], strict=True):
        alone = block.index_map.size_global == 1
        names.append(
            hash_rows(np.zeros((len(places), 1))) if alone else _after_nodes(system, names, places)
        )
    return names


def _after_nodes(system: System, names: list[Names], places: list[tuple[Attached, ...]]) -> Names:
    """For each constraint: the first node that it ties, and how many constraints before it have the same one."""
    words, seen = [], dict[tuple[int, int], int]()
    for place in places:
        port = next(p for p in place if isinstance(p, Port))
        k = system.bodies.index(port.body)
        key = (
            k,
            int(names[k][port.nodes[0] - port.body.block.index_map.local_range[0]] >> np.uint64(1)),
        )
        seen[key] = seen.get(key, -1) + 1
        words.append((*key, seen[key]))
    return hash_rows(np.array(words, dtype=np.int64).reshape(-1, 3))
