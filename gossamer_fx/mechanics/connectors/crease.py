"""Creases: lines along which a film or plate is folded, with a stiffness and a rest angle that may
yield.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import Annotated, Any, Final, Literal

import numpy as np

from gossamer_fx.core.checks.arguments import Range, check_arguments, positive
from gossamer_fx.core.checks.errors import check, check_on_all
from gossamer_fx.core.forms.backend import cell_nodes, geometry_element, geometry_nodes
from gossamer_fx.core.mesh.edges import EdgeTable
from gossamer_fx.core.model.body import Array, Indices
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import OnBody, Term
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.bodies.plate import Plate
from gossamer_fx.mechanics.connectors.crease_energies import (
    PARAMETERS,
    CreaseEnergy,
    FoldMeasure,
    elastic_fold,
    yielding_fold,
)

# Signs of the angle of a fold.
VALLEY: Final = 1
MOUNTAIN: Final = -1

# Corners of the reference triangle.
_CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])

# Corners from which and to which a triangle that is walked counterclockwise passes its edges 0, 1,
# 2.
_ENDS = np.array([[1, 2], [2, 0], [0, 1]])

# Points and weights along an edge, by the order of the film.  They integrate the energy of a fold
# of constant angle exactly.
_GAUSS = {1: ([0.5], [1.0]), 2: ([0.5 - 12**-0.5, 0.5 + 12**-0.5], [0.5, 0.5])}


@check_arguments
@dataclass(frozen=True, eq=False)
class Crease(OnBody):
    """A fold along edges of a film: the moment m = k (θ - θr) per length about the fold.

    θ is the angle between the panels, zero where they continue each other, and measured at each
    edge (order 1) or at its two Gauss points (order 2) of the film as it moves; ±π is pressed shut.
    It is positive for a valley fold: the panels have turned towards the normal of the film (the
    side from which its triangles run counterclockwise); negative for a mountain fold.  Energy and
    angular momentum are conserved exactly; see `algebra.dihedral_angle`.

    With a yield angle φ the rest angle follows as soon as |θ - θr| > φ, at the moment k φ; the loss
    is counted as dissipated.  On a `Plate` the edges are also one of its `hinges`: then the crease
    alone carries the moment.

    Args:
        body: a film or plate, with plane triangles.
        edges: a named group of edges of its mesh, each between two triangles.
        stiffness: k [N m/m/rad], moment per length and angle, positive.
        rest_angle: θr [rad], in [-π, π], at which the crease is at rest.
        yield_angle: φ [rad], the largest |θ - θr|, positive; None: elastic.
        initial_fold: VALLEY (1) or MOUNTAIN (-1), the sign of a fold that starts pressed shut,
            which the positions do not show; None: that of the rest angle, and VALLEY for a rest
            angle of zero.
        name: name in messages and output.

    Raises:
        InputError: a group that is not a line of interior edges, triangles whose normals change
            sides at it, a stiffness or yield angle that is not positive, a rest angle beyond half a
            turn, curved triangles.

    Source: of the model, Lechenault, Thiria & Adda-Bedia, Phys. Rev. Lett. 112 (2014) 244301,
    doi:10.1103/PhysRevLett.112.244301.

    Example:
        >>> gx.connectors.Crease(creased, "crease", stiffness=1e-3, rest_angle=np.radians(90)).name
        'crease'
    """

    body: Membrane
    edges: str
    _: KW_ONLY
    stiffness: Annotated[float, positive("N m/m/rad")]
    rest_angle: Annotated[float, Range(-math.pi, math.pi, "rad")] = 0.0
    yield_angle: Annotated[float, positive("rad")] | None = None
    initial_fold: Literal[1, -1] | None = None
    name: str = "crease"

    def __post_init__(self) -> None:
        who = f"Crease '{self.name}'"
        check(
            geometry_element(self.body.space.mesh).degree == 1,
            f"{who}: the triangles of '{self.body.name}' are curved; "
            "mesh it with plane triangles (order 1).",
        )
        self._check_edges(who)
        check(
            not isinstance(self.body, Plate) or self.edges in self.body.hinges,
            f"{who}: the plate '{self.body.name}' transmits bending at '{self.edges}' itself; "
            f"give it hinges=['{self.edges}'].",
        )

    def _check_edges(self, who: str) -> None:
        """Check that the edges of the crease lie between two triangles with normals on one side.
        Collective."""
        table = self.body.mesh.edges
        owned = self._owned
        on_rim = (~table.is_inside[owned]).sum()
        without_neighbours = (~table.is_known[owned]).sum()
        counts = np.array([len(owned), on_rim, without_neighbours])
        n, rim, unknown = self.body.comm.allreduce(counts).tolist()
        check(
            n > 0,
            f"{who}: the group '{self.edges}' has no edges; "
            "name a line between triangles of the mesh.",
        )
        check(
            rim == 0,
            f"{who}: "
            f"{rim} of the {n} edges of '{self.edges}' lie on the rim of '{self.body.name}' "
            "or where more than two triangles meet; a crease has one triangle on each side.",
        )
        check(
            unknown == 0,
            f"{who}: the mesh of '{self.body.name}' was distributed without neighbours; "
            "read it with read_mesh or gmsh_mesh.",
        )
        check_on_all(
            self.body.comm,
            bool(_passed_both_ways(table, owned).all()),
            f"{who}: the normals of '{self.body.name}' change sides at '{self.edges}', "
            "so that the sign of the fold is not defined; "
            "turn the triangles of one side (gmsh: model.mesh.reverse).",
        )

    def terms(self, start: State) -> Iterable[Term]:
        yield self.energy

    @property
    def _owned(self) -> Indices:
        """The edges of the crease that this rank owns, as indices of the body's `EdgeTable`."""
        table = self.body.mesh.edges
        lines = self.body.mesh.curve(self.edges, f"Crease on '{self.body.name}'")
        return lines[lines < table.owned]

    @cached_property
    def energy(self) -> CreaseEnergy:
        """The crease as arrays over points of its edges that this rank owns: one point on an edge
        of a film of order 1, two for order 2.

        At each point three dimensionless vectors, along the fold and into the left and right
        panels, are constant linear maps [1/m] of the positions of the nodes of both triangles; they
        are unit vectors on the stress-free mesh.  Collective at the first use.
        """
        table = self.body.mesh.edges
        owned = self._owned
        cells = table.cells[owned]
        sides = table.sides[owned]
        points = np.array(_GAUSS[self.body.order][0])
        weights = np.array(_GAUSS[self.body.order][1])
        # Number of points of an edge.
        g = len(points)

        # Start and end of each edge as the left panel passes it, and the direction t along it.
        geometry = self.body.mesh.domain.geometry
        corners = geometry_nodes(self.body.mesh.domain)[:, :3]
        vertices = corners[cells[:, 0, None], _ENDS[sides[:, 0]]]
        along = geometry.x[vertices[:, 1]] - geometry.x[vertices[:, 0]]
        length = np.linalg.norm(along, axis=1)
        t = along / length[:, None]

        # Three vectors at each point as maps of the nodes of both panels: along the fold, into the
        # left panel, into the right one.
        left = self._derivatives(cells[:, 0], sides[:, 0], points, backwards=False)
        right = self._derivatives(cells[:, 1], sides[:, 1], points, backwards=True)
        into_left = _inwards(geometry.x[corners[cells[:, 0]]], t, sides[:, 0])
        into_right = _inwards(geometry.x[corners[cells[:, 1]]], t, sides[:, 1])
        # Number of nodes of a triangle.
        k = left.shape[-1]
        maps: Array = np.zeros((len(owned), g, 3, 2 * k))
        maps[:, :, 0, :k] = np.einsum("egck,ec->egk", left, t)
        maps[:, :, 1, :k] = np.einsum("egck,ec->egk", left, into_left)
        maps[:, :, 2, k:] = np.einsum("egck,ec->egk", right, into_right)
        nodes: Indices = cell_nodes(self.body.space)[cells].reshape(len(owned), 2 * k)
        nodes, maps = _without_twins(nodes, maps, k)

        # Points are named by the numbers of the mesh file, which are the same for any number of
        # ranks: the vertices of the edge, the lower one first, and the position of the point from
        # there.
        numbers = geometry.input_global_indices[vertices]
        is_reversed = (numbers[:, 0] > numbers[:, 1])[:, None]
        order = np.where(is_reversed, np.arange(g)[::-1], np.arange(g))
        edge_names = np.repeat(np.sort(numbers, axis=1), g, axis=0)
        names = np.concatenate([edge_names, order.reshape(-1, 1)], axis=1)

        shut = VALLEY
        if self.rest_angle < 0:
            shut = MOUNTAIN
        if self.initial_fold is not None:
            shut = self.initial_fold
        measure = FoldMeasure(
            body=self.body,
            nodes=np.repeat(nodes, g, axis=0),
            cells=np.repeat(cells, g, axis=0),
            maps=maps.reshape(-1, *maps.shape[2:]),
            shut=shut,
            names=names.astype(np.int64),
        )
        numbers = {"stiffness": self.stiffness, "length": (length[:, None] * weights).ravel()}
        if self.yield_angle is None:
            numbers["rest"] = self.rest_angle
            return CreaseEnergy(self.name, measure, elastic_fold, numbers, PARAMETERS)
        numbers["yield_angle"] = self.yield_angle
        rest = {"rest": self.rest_angle}
        return CreaseEnergy(self.name, measure, yielding_fold, numbers, PARAMETERS, rest)

    def _derivatives(self, cells: Indices, sides: Indices, points: Array, backwards: bool) -> Array:
        """Gradients (n, g, 3, k) [1/m] on the mesh of the k shape functions of n triangles, at g
        points of one edge of each: its number, 0 to 2, is in `sides` (n,).  `points` (g,) are
        positions along it, from 0 to 1; `backwards`: from the end at which the triangle leaves it.
        """
        domain = self.body.mesh.domain
        element = self.body.space.element.basix_element
        # Positions (g,) along the edge in the direction of the triangle, from 0 to 1.
        s = points
        if backwards:
            s = 1 - points
        # The points of all three edges of the reference triangle are tabulated once.
        start = _CORNERS[_ENDS[:, 0]]
        end = _CORNERS[_ENDS[:, 1]]
        reference = start[:, None] + s[None, :, None] * (end - start)[:, None]
        of_edges = element.tabulate(1, reference.reshape(-1, 2))[1:, :, :, 0]
        table = of_edges.reshape(2, 3, len(points), -1)[:, sides]
        # Rows of J (n, 2, 3) are two edges of a triangle; `dual` are their dual vectors in its
        # plane.
        corners = domain.geometry.x[geometry_nodes(domain)[cells, :3]]
        J = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=1)
        dual = np.linalg.solve(J @ np.swapaxes(J, 1, 2), J)
        return np.einsum("nac,angk->ngck", dual, table)


def _passed_both_ways(table: EdgeTable, edges: Indices) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Whether (n,) the two triangles of interior edges pass them in opposite directions, so that
    their normals are on the same side of the film."""
    corners = table.domain.topology.connectivity(2, 0).array.reshape(-1, 3)
    cells = table.cells[edges]
    sides = table.sides[edges]
    first = corners[cells, _ENDS[sides, 0]]
    return (first == table.vertices[edges]).all(axis=1)


def _inwards(corners: Array, t: Array, sides: Indices) -> Array:
    """Unit vectors (n, 3) in triangles (n, 3, 3), normal to one of their edges along t, away from
    it."""
    n = np.arange(len(t))
    away = corners[n, sides] - corners[n, _ENDS[sides, 0]]
    away = away - np.einsum("nc,nc->n", away, t)[:, None] * t
    return away / np.linalg.norm(away, axis=1)[:, None]


def _without_twins(nodes: Indices, maps: Array, k: int) -> tuple[Indices, Array]:
    """Remove nodes (n, 2k) that both triangles have from those of the right one, and add up their
    maps (n, g, 3, 2k), which are changed in place.  4 nodes remain for order 1 and 9 for order 2.
    """
    n = len(nodes)
    # Which node of the right triangle (second axis) is which one of the left triangle (third axis).
    twins = nodes[:, k:, None] == nodes[:, None, :k]
    maps[..., :k] += np.einsum("egvj,eji->egvi", maps[..., k:], twins)
    is_of_left = np.ones((n, k), dtype=bool)
    is_kept = np.concatenate([is_of_left, ~twins.any(axis=2)], axis=1)
    # Nodes on an edge, of order 1 and 2.
    shared = 3
    if k == 3:
        shared = 2
    # Every row has the same number of kept columns, so their indices are an array.
    flat = np.flatnonzero(is_kept.ravel()).reshape(n, 2 * k - shared)
    columns = flat - 2 * k * np.arange(n)[:, None]
    kept_nodes = np.take_along_axis(nodes, columns, axis=1)
    kept_maps = np.take_along_axis(maps, columns[:, None, None], axis=3)
    return kept_nodes, kept_maps
