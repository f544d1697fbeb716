"""Parts of a closed surface that are not connected, all of which must have their normals on one side.

The triangles of one part agree with each other, since neighbours do.  Nothing relates the normals of one
part to those of another: a part that is inside out counts its volume as negative, and the gas pulls it
inwards.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from dolfinx import la
from mpi4py import MPI

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.errors import InputError
from gossamer_fx.forms.spaces import cell_nodes
from gossamer_fx.mesh.edges import EdgeTable
from gossamer_fx.mesh.quality import area_vectors
from gossamer_fx.model.body import Array

Cells = npt.NDArray[np.int32]

# A volume below this share of the sum of its terms' sizes is round-off: a flat part has no inside.
FLAT = 1e-9


def label_parts(table: EdgeTable, cells: Cells) -> Array:
    """Number the connected parts of a surface.  Collective.

    Each rank finds the parts of its triangles, ghosts included, and gives each the lowest number of a
    triangle in it.  Ranks exchange these numbers until none changes.

    Args:
        table: edges of the mesh.
        cells: local triangles (n,) of the surface, owned and ghost, in rising order.

    Returns:
        the number (n,) of each triangle's part, the same on all ranks.
    """
    # Imported here, as a scene without chambers of films does not need it.
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    index_map = table.domain.topology.index_map(2)
    comm = table.domain.comm
    is_of_surface = np.zeros(index_map.size_local + index_map.num_ghosts, dtype=bool)
    is_of_surface[cells] = True
    has_both = (table.cells >= 0).all(axis=1)
    pairs = table.cells[has_both]
    pairs = pairs[is_of_surface[pairs].all(axis=1)]
    ones = np.ones(len(pairs), dtype=np.int8)
    neighbours = coo_array((ones, (pairs[:, 0], pairs[:, 1])), shape=(len(is_of_surface),) * 2)
    count, part = connected_components(neighbours, directed=False)

    labels = la.vector(index_map)
    labels.array[:] = index_map.local_to_global(np.arange(len(is_of_surface), dtype=np.int32))
    while True:
        lowest = np.full(count, np.inf)
        np.minimum.at(lowest, part, labels.array)
        has_changed = bool((labels.array != lowest[part]).any())
        labels.array[:] = lowest[part]
        labels.scatter_forward()
        if not comm.allreduce(has_changed, op=MPI.LOR):
            return labels.array[cells].copy()


def check_normals(film: Membrane, chamber: str, cells: Cells, labels: Array, x: Array) -> None:
    """Check that the parts of a closed surface have their normals on the same side.  Collective.

    A part inside another one may be a hollow, whose normals then point into it; only parts that are not
    inside another one are compared.  Flat parts have no volume and are not examined.

    Args:
        film: whose triangles bound the chamber.
        chamber: its name.
        cells: local triangles (n,) of the surface.
        labels: of `label_parts` (n,).
        x: initial positions (m, 3) [m] of the film's local nodes.

    Raises:
        InputError: one part is inside out.
    """
    owned = film.mesh.domain.topology.index_map(2).size_local
    is_owned = cells < owned
    corners = x[cell_nodes(film.space)[cells[is_owned], :3]]
    terms = np.einsum("ij,ij->i", corners.mean(axis=1), area_vectors(corners)) / 3
    mine = {}
    for label in np.unique(labels[is_owned]):
        of_part = labels[is_owned] == label
        points = corners[of_part].reshape(-1, 3)
        sums = np.array([terms[of_part].sum(), abs(terms[of_part]).sum()])
        mine[label] = (sums, points.min(axis=0), points.max(axis=0))

    # One entry for each part, not for each triangle.
    parts: dict[float, tuple[Array, Array, Array]] = {}
    for share in film.comm.allgather(mine):
        for label, (sums, low, high) in share.items():
            if label in parts:
                sums = sums + parts[label][0]
                low = np.minimum(low, parts[label][1])
                high = np.maximum(high, parts[label][2])
            parts[label] = (sums, low, high)

    found = [part for part in parts.values() if abs(part[0][0]) > FLAT * part[0][1]]
    outer = [part for part in found if not any(_is_within(part, other) for other in found)]
    outer.sort(key=lambda part: -abs(part[0][0]))
    for sums, low, high in outer[1:]:
        volume = sums[0]
        # The largest part is taken to be right.
        if volume * outer[0][0][0] < 0:
            middle = ", ".join(f"{value:.4g}" for value in (low + high) / 2)
            raise InputError(
                f"Chamber '{chamber}': one of the {len(parts)} parts of '{film.name}' is inside out, the one about "
                f"({middle}) m, whose volume of {abs(volume):.4g} m³ would be subtracted from the others; turn its "
                "normals (gmsh: model.mesh.reverse)."
            )


def _is_within(part: tuple[Array, Array, Array], other: tuple[Array, Array, Array]) -> bool:
    """Whether the box around a part is strictly inside that of another one."""
    return bool((part[1] > other[1]).all() and (part[2] < other[2]).all())
