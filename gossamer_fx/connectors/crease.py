"""Creases: lines along which a film or plate is folded, with stiffness and memory."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import Any

import numpy as np

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.bodies.plate import Plate
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check, check_on_all, check_positive
from gossamer_fx.connectors.crease_energies import CreaseEnergy
from gossamer_fx.forms.spaces import cell_nodes
from gossamer_fx.mesh.edges import EdgeTable
from gossamer_fx.model.body import Array, Indices
from gossamer_fx.model.state import State
from gossamer_fx.model.terms import Term

VALLEY, MOUNTAIN = 1, -1
_CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])  # of the reference triangle
_ENDS = np.array([[1, 2], [2, 0], [0, 1]])  # vertices from and to which a triangle passes its edges
# points and weights along an edge: the order of the film is exact for the energy of a fold of constant angle
_GAUSS = {1: ([0.5], [1.0]), 2: ([0.5 - 12**-0.5, 0.5 + 12**-0.5], [0.5, 0.5])}


@check_arguments
@dataclass(frozen=True, eq=False)
class Crease:
    """A fold along edges of a film: the moment m = k (θ - θr) per length about the fold.

    θ is the angle between the panels, zero where they continue each other, and measured at each edge
    (order 1) or at its two Gauss points (order 2) of the film as it moves; ±π is pressed shut.  It is
    positive for a valley fold: the panels have turned towards the normal of the film (the side from
    which its triangles run counterclockwise); negative for a mountain fold.  Energy and angular momentum
    are conserved exactly; see `algebra.dihedral_angle`.

    With a yield angle φ the rest angle follows as soon as |θ - θr| > φ, at the moment k φ; the loss is
    counted as dissipated.  On a `Plate` the edges are also one of its `hinges`: then the crease alone
    carries the moment.

    Args:
        body: a film or plate, with plane triangles.
        edges: a named group of edges of its mesh, each between two triangles.
        stiffness: k [N m/m/rad], moment per length and angle, positive.
        rest_angle: θr [rad], in [-π, π], at which the crease is at rest.
        yield_angle: φ [rad], the largest |θ - θr|, positive; None: elastic.
        initial_fold: VALLEY (1) or MOUNTAIN (-1), the sign of a fold that starts pressed shut, where the
            positions do not tell it; None: that of the rest angle, and VALLEY for a rest angle of zero.
        name: name in messages and output.

    Raises:
        InputError: a group that is not a line of interior edges, triangles whose normals change sides
            at it, a stiffness or yield angle that is not positive, a rest angle beyond half a turn,
            curved triangles.

    Source: of the model, Lechenault, Thiria & Adda-Bedia, Phys. Rev. Lett. 112 (2014) 244301,
    doi:10.1103/PhysRevLett.112.244301.

    Example:
        >>> gx.connectors.Crease(creased, "crease", stiffness=1e-3, rest_angle=np.radians(90)).name
        'crease'
    """

    body: Membrane
    edges: str
    _: KW_ONLY
    stiffness: float
    rest_angle: float = 0.0
    yield_angle: float | None = None
    initial_fold: int | None = None
    name: str = "crease"

    def __post_init__(self) -> None:
        check_positive(self, "stiffness", "N m/m/rad")
        who = f"Crease '{self.name}'"
        check(
            math.isfinite(self.rest_angle) and abs(self.rest_angle) <= math.pi,
            f"{who}: rest_angle is {self.rest_angle!r} rad; stay within half a turn, between -π and π.",
        )
        φ = self.yield_angle
        check(
            φ is None or (math.isfinite(φ) and φ > 0),
            f"{who}: yield_angle is {φ!r} rad; give a positive number, or None for a crease that does not yield.",
        )
        check(
            self.initial_fold in (None, VALLEY, MOUNTAIN),
            f"{who}: initial_fold is {self.initial_fold!r}; give 1 for a valley fold, -1 for a mountain fold, or None.",
        )
        check(
            self.body.space.mesh.geometry.cmap.degree == 1,
            f"{who}: the triangles of '{self.body.name}' are curved; mesh it with plane triangles (order 1).",
        )
        self._check_edges(who)
        check(
            not isinstance(self.body, Plate) or self.edges in self.body.hinges,
            f"{who}: the plate '{self.body.name}' transmits bending at '{self.edges}' itself; give it "
            f"hinges=['{self.edges}'].",
        )

    def _check_edges(self, who: str) -> None:
        table, lines = self.body.mesh.edges, self.body.mesh.curve(self.edges, who)
        owned = lines[lines < table.owned]
        n, rim, unknown = self.body.comm.allreduce(
            np.array([len(owned), (~table.is_inside[owned]).sum(), (~table.is_known[owned]).sum()])
        ).tolist()
        check(
            n > 0,
            f"{who}: the group '{self.edges}' has no edges; name a line between triangles of the mesh.",
        )
        check(
            rim == 0,
            f"{who}: {rim} of the {n} edges of '{self.edges}' lie on the rim of '{self.body.name}' or where more than "
            "two triangles meet; a crease has one triangle on each side.",
        )
        check(
            unknown == 0,
            f"{who}: the mesh of '{self.body.name}' was distributed without neighbours; read it with read_mesh or "
            "gmsh_mesh.",
        )
        check_on_all(
            self.body.comm,
            bool(_passed_both_ways(table, owned).all()),
            f"{who}: the normals of '{self.body.name}' change sides at '{self.edges}', so that the sign of the fold is "
            "not defined; turn the triangles of one side (gmsh: model.mesh.reverse).",
        )

    def requires(self) -> Iterable[Any]:
        yield self.body

    def terms(self, start: State) -> Iterable[Term]:
        yield self.energy

    @property
    def _owned(self) -> Indices:
        table = self.body.mesh.edges
        lines = self.body.mesh.curve(self.edges, self.name)
        return lines[lines < table.owned]

    @cached_property
    def energy(self) -> CreaseEnergy:
        """The crease as a term of the equations."""
        table, owned = self.body.mesh.edges, self._owned
        points, weights = (np.array(a) for a in _GAUSS[self.body.order])
        cells, sides = table.cells[owned], table.sides[owned]
        geometry = self.body.mesh.domain.geometry
        vertices = geometry.dofmap[:, :3][
            cells[:, 0, None], _ENDS[sides[:, 0]]
        ]  # of the left panel: start and end
        along = geometry.x[vertices[:, 1]] - geometry.x[vertices[:, 0]]
        length = np.linalg.norm(along, axis=1)
        t = along / length[:, None]
        left, right = (
            self._derivatives(cells[:, i], sides[:, i], points, i == 1) for i in range(2)
        )
        inwards = [
            _inwards(geometry.x[geometry.dofmap[cells[:, i], :3]], t, sides[:, i]) for i in range(2)
        ]
        maps: Array = np.zeros((len(owned), len(points), 3, 2 * left.shape[-1]))
        k = left.shape[-1]
        maps[:, :, 0, :k] = np.einsum("egck,ec->egk", left, t)
        maps[:, :, 1, :k] = np.einsum("egck,ec->egk", left, inwards[0])
        maps[:, :, 2, k:] = np.einsum("egck,ec->egk", right, inwards[1])
        nodes: Indices = cell_nodes(self.body.space)[cells].reshape(len(owned), 2 * k)
        nodes, maps = _without_twins(nodes, maps, k)
        numbers = geometry.input_global_indices[vertices]
        swapped = (numbers[:, 0] > numbers[:, 1])[:, None]
        order = np.where(swapped, np.arange(len(points))[::-1], np.arange(len(points)))
        names = np.concatenate(
            [np.repeat(np.sort(numbers, axis=1), len(points), axis=0), order.reshape(-1, 1)], axis=1
        )
        return CreaseEnergy(
            self.name,
            self.body,
            np.repeat(nodes, len(points), axis=0),
            np.repeat(cells, len(points), axis=0),
            maps.reshape(-1, *maps.shape[2:]),
            (self.stiffness * length[:, None] * weights).ravel(),
            self.rest_angle,
            math.inf if self.yield_angle is None else self.yield_angle,
            self.initial_fold or (MOUNTAIN if self.rest_angle < 0 else VALLEY),
            names.astype(np.int64),
            self.stiffness,
        )

    def _derivatives(
        self,
        cells: Indices,
        sides: Indices,
        points: Array,
        backwards: bool,
    ) -> Array:
        """Gradients (n, g, 3, k) on the mesh of the k shape functions of triangles, at points along their edges."""
        domain, element = self.body.mesh.domain, self.body.space.element.basix_element
        s = 1 - points if backwards else points
        a, b = _CORNERS[_ENDS[:, 0]], _CORNERS[_ENDS[:, 1]]
        reference = a[:, None] + s[None, :, None] * (b - a)[:, None]
        table = element.tabulate(1, reference.reshape(-1, 2))[1:, :, :, 0]  # (2, 3 g, k)
        table = table.reshape(2, 3, len(points), -1)[:, sides]  # (2, n, g, k)
        corners = domain.geometry.x[domain.geometry.dofmap[cells, :3]]
        J = np.stack(
            [corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=1
        )  # (n, 2, 3)
        dual = np.linalg.solve(J @ np.swapaxes(J, 1, 2), J)
        gradients: Array = np.einsum("nac,angk->ngck", dual, table)
        return gradients


def _passed_both_ways(table: EdgeTable, edges: Indices) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Of interior edges: whether the left triangle passes them forwards and the right one backwards."""
    corners = table.domain.topology.connectivity(2, 0).array.reshape(-1, 3)
    cells, sides = table.cells[edges], table.sides[edges]
    first = corners[cells, _ENDS[sides, 0]]
    same: np.ndarray[Any, np.dtype[np.bool_]] = (first == table.vertices[edges]).all(axis=1)
    return same


def _inwards(corners: Array, t: Array, sides: Indices) -> Array:
    """Unit vectors (n, 3) in triangles (n, 3, 3), normal to one of their edges along t, away from it."""
    n = np.arange(len(t))
    away = corners[n, sides] - corners[n, _ENDS[sides, 0]]
    away = away - np.einsum("nc,nc->n", away, t)[:, None] * t
    result: Array = away / np.linalg.norm(away, axis=1)[:, None]
    return result


def _without_twins(nodes: Indices, maps: Array, k: int) -> tuple[Indices, Array]:
    """Nodes (n, 2k) of the left and right triangle and their maps, those of both instead of the left one's."""
    twins = nodes[:, k:, None] == nodes[:, None, :k]
    maps[..., :k] += np.einsum("egvj,eji->egvi", maps[..., k:], twins)
    kept = np.concatenate([np.ones((len(nodes), k), dtype=bool), ~twins.any(axis=2)], axis=1)
    shared = 2 if k == 3 else 3  # nodes on an edge, of order 1 and 2
    columns = (
        np.flatnonzero(kept.ravel()).reshape(len(nodes), 2 * k - shared)
        - 2 * k * np.arange(len(nodes))[:, None]
    )
    return np.take_along_axis(nodes, columns, axis=1), np.take_along_axis(
        maps, columns[:, None, None], axis=3
    )
