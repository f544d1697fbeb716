"""The nodes that a support holds, and their coordinates."""

from __future__ import annotations

import numpy as np

from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Indices
from gossamer_fx.mechanics.bodies.meshed import Meshed


def check_support(
    kind: str,
    body: Meshed,
    group: str,
    components: tuple[int, ...],
) -> None:
    """Raise `InputError`, on all ranks, if a support would hold nothing: components other than x,
    y, z (0, 1, 2), a group that the mesh does not have, or one without nodes of the body.
    Collective."""
    check(
        set(components) <= {0, 1, 2} and bool(components),
        f"{kind}: components are {components!r}; choose from 0, 1, 2.",
    )
    body.mesh.group(group)
    # Owned nodes are counted once; a group may have no node on this rank, but not on all.
    nodes = body.nodes(group)
    owned = int((nodes < body.block.index_map.size_local).sum())
    check(
        body.comm.allreduce(owned) > 0,
        f"{kind}: the group '{group}' has no node of '{body.name}', so that nothing would be held; "
        "name another group.",
    )


def dofs_of(body: Meshed, nodes: Indices, components: tuple[int, ...]) -> Indices:
    """Scalar indices (n · components,) of components of the positions of nodes (n,), node by
    node."""
    # The position is the first vector of a node, whatever else it has.
    dofs: Indices = (body.block.size * nodes[:, None] + np.array(components)).ravel()
    return dofs.astype(np.int32)
