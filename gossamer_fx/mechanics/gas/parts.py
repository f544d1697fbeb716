"""Parts of a closed surface that are not connected, all of which must have their normals on one
side.

The triangles of one part agree with each other, since neighbours do.  Nothing relates the normals
of one part to those of another: a part that is inside out counts its volume as negative, and the
gas pulls it inwards.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from dolfinx import la
from mpi4py import MPI

from gossamer_fx.core.checks.errors import InputError
from gossamer_fx.core.forms.spaces import cell_nodes
from gossamer_fx.core.mesh.edges import EdgeTable
from gossamer_fx.core.mesh.quality import area_vectors
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.bodies.membrane import Membrane

Cells = npt.NDArray[np.int32]

# A volume below this share of the sum of its terms' sizes is round-off: a flat part has no inside.
FLAT = 1e-9


@dataclass(frozen=True)
class _Part:
    """Volume and bounding box of one part of a surface, or of what one rank has of it.

    Attributes:
        volume: signed volume [m³] of the cones from the origin to the triangles.
        size: sum [m³] of the absolute volumes of these cones, the scale of its round-off.
        low, high: corners (3,) [m] of the bounding box.
    """

    volume: float
    size: float
    low: Array
    high: Array

    def merged(self, other: _Part) -> _Part:
        """The part that consists of both."""
        return _Part(
            volume=other.volume + self.volume,
            size=other.size + self.size,
            low=np.minimum(other.low, self.low),
            high=np.maximum(other.high, self.high),
        )

    def is_within(self, other: _Part) -> bool:
        """Whether the bounding box is strictly inside that of another part."""
        is_above = bool((self.low > other.low).all())
        is_below = bool((self.high < other.high).all())
        return is_above and is_below


def label_parts(table: EdgeTable, cells: Cells) -> Array:
    """Number the connected parts of a surface.  Collective.

    Each rank finds the parts of its triangles, ghosts included, and gives each the lowest number of
    a triangle in it.  Ranks exchange these numbers until none changes.

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
    local_count = index_map.size_local + index_map.num_ghosts
    is_of_surface = np.zeros(local_count, dtype=bool)
    is_of_surface[cells] = True

    # Triangles of the surface are neighbours where they share an edge.
    has_both = (table.cells >= 0).all(axis=1)
    pairs = table.cells[has_both]
    pairs = pairs[is_of_surface[pairs].all(axis=1)]
    ones = np.ones(len(pairs), dtype=np.int8)
    entries = (ones, (pairs[:, 0], pairs[:, 1]))
    neighbours = coo_array(entries, shape=(local_count, local_count))
    count, part = connected_components(neighbours, directed=False)

    local_cells = np.arange(local_count, dtype=np.int32)
    labels = la.vector(index_map)
    labels.array[:] = index_map.local_to_global(local_cells)
    # A number passes one rank in each round, so there are at most as many rounds as ranks along a
    # part.
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

    A part inside another one may be a hollow, whose normals then point into it; only parts that are
    not inside another one are compared.  Flat parts have no volume and are not examined.

    Args:
        film: whose triangles bound the chamber.
        chamber: its name, for the message.
        cells: local triangles (n,) of the surface.
        labels: number (n,) of each triangle's connected part, as `label_parts` returns it.
        x: initial positions (m, 3) [m] of the film's local nodes.

    Raises:
        InputError: one part is inside out.
    """
    owned = film.mesh.domain.topology.index_map(2).size_local
    is_owned = cells < owned
    corners = x[cell_nodes(film.space)[cells[is_owned], :3]]
    terms = np.einsum("ij,ij->i", corners.mean(axis=1), area_vectors(corners)) / 3
    owned_labels = labels[is_owned]
    mine = {}
    for label in np.unique(owned_labels):
        is_of_part = owned_labels == label
        points = corners[is_of_part].reshape(-1, 3)
        mine[label] = _Part(
            volume=terms[is_of_part].sum(),
            size=abs(terms[is_of_part]).sum(),
            low=points.min(axis=0),
            high=points.max(axis=0),
        )

    # Ranks exchange one entry for each part, not one for each triangle.
    parts: dict[float, _Part] = {}
    for share in film.comm.allgather(mine):
        for label, part in share.items():
            if label in parts:
                parts[label] = parts[label].merged(part)
            else:
                parts[label] = part

    solid = [part for part in parts.values() if abs(part.volume) > FLAT * part.size]
    outer = [part for part in solid if not any(part.is_within(other) for other in solid)]
    # The largest part is taken to be right.
    outer.sort(key=lambda part: -abs(part.volume))
    for part in outer[1:]:
        if part.volume * outer[0].volume < 0:
            middle = ", ".join(f"{value:.4g}" for value in (part.low + part.high) / 2)
            raise InputError(
                f"Chamber '{chamber}': one of the {len(parts)} parts of '{film.name}' is inside "
                "out, "
                f"the one about ({middle}) m, whose volume of {abs(part.volume):.4g} m³ would be "
                "subtracted from the others; turn its normals (gmsh: model.mesh.reverse)."
            )
