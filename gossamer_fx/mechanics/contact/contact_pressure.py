"""The output field `contact_pressure`: the pressure of contact on the nodes of bodies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from dolfinx import la

from gossamer_fx.core.model.body import Body, MeshBody
from gossamer_fx.mechanics.contact.contact_set import ContactSet
from gossamer_fx.mechanics.contact.contact_step import PairStep
from gossamer_fx.mechanics.contact.contract import Array, Int64Array
from gossamer_fx.mechanics.contact.geometry.curved_cells import has_middle_nodes
from gossamer_fx.mechanics.contact.geometry.facets import EDGES_OF_CELLS


@dataclass(frozen=True)
class PressedNodes:
    """Contact pressure on k nodes of a body; each node is on one rank.

    Attributes:
        nodes: global numbers (k,).
        pressure: (k,) [N/m²].
        area: (k,) [m²] of the stress-free shape for which each node stands; their sum is that of
            the body.
    """

    nodes: Int64Array
    pressure: Array
    area: Array


def pressed_nodes(body: MeshBody, contact_set: ContactSet) -> PressedNodes:
    """Return the contact pressure on the nodes of a body; collective.

    The nodes of a cell of order 2 carry the forces on its points by their shape functions: of a
    uniform pressure, vertices carry none and middle nodes all of it.  The hat function of a vertex
    is the sum of its shape function and half of those of the middle nodes next to it, so that
    forces and areas of these are divided between the ends of their edges.  The pressure is then
    that of cells of order 1, linear along the edges, and its integral is the force.
    """
    of_body = points_of(body, contact_set)
    points = contact_set.mesh.known.points
    force = forces_on_points(contact_set)[of_body]
    area = contact_set.mesh.area[of_body]
    if not has_middle_nodes(body):
        return PressedNodes(points.nodes[of_body, 0], force / area, area)
    nodes = points.nodes[of_body[points.is_node[of_body]], 0]
    halves = _Halves(body, nodes)
    carriers = (points.nodes[of_body], points.weights[of_body])
    force_at_ends = halves.to_ends(halves.carried(force, *carriers))
    area_at_ends = halves.to_ends(halves.carried(area, *carriers))
    has_area = area_at_ends > 0
    pressure = np.zeros(len(nodes))
    pressure[has_area] = force_at_ends[has_area] / area_at_ends[has_area]
    return PressedNodes(nodes, halves.to_middles(pressure), area_at_ends)


class _Halves:
    """Values at the nodes of a body of order 2, divided between and averaged over the ends of its
    edges.

    Args:
        nodes: global numbers (k,) of the nodes of this rank, in the order of all values.
    """

    def __init__(self, body: MeshBody, nodes: Int64Array) -> None:
        """Find the edges of the cells of this rank; collective."""
        mesh = body.space.mesh
        dimension = mesh.topology.dim
        cells = body.space.dofmap.list[: mesh.topology.index_map(dimension).size_local]
        dof_count = cells.shape[1]
        edges = EDGES_OF_CELLS[dimension, dof_count]
        # Middle nodes follow the vertices, in the order of the edges.
        first_middle = dof_count - len(edges)
        self._middle = cells[:, first_middle:].ravel()
        self._ends = cells[:, edges].reshape(-1, 2)
        self._index_map = body.block.index_map
        # The rank that has a point of the contact knows its node, and need not own it.
        self._local = self._index_map.global_to_local(nodes)
        # Two cells share an edge, each of which brings its part.
        count = self._zeros()
        np.add.at(count.array, self._middle, 1.0)
        self._sum_over_ranks(count)
        self._cells_of_edge = count.array[self._middle]

    def _zeros(self) -> la.Vector:
        return la.vector(self._index_map)

    @staticmethod
    def _sum_over_ranks(vector: la.Vector) -> None:
        """Sum what all ranks have for a node, and give it to all; collective."""
        vector.scatter_reverse(la.InsertMode.add)
        vector.scatter_forward()

    def _spread(self, values: Array) -> la.Vector:
        """Return values (k,) at all nodes that this rank knows; collective."""
        vector = self._zeros()
        vector.array[self._local] = values
        self._sum_over_ranks(vector)
        return vector

    def carried(self, values: Array, nodes: Int64Array, weights: Array) -> la.Vector:
        """Return what all nodes that this rank knows carry of the values (p,) of its points;
        collective.  `nodes, weights`: of the shape functions of each point (p, w)."""
        carried = self._zeros()
        # The rank that has a point has its cell.
        local = self._index_map.global_to_local(nodes.ravel())
        np.add.at(carried.array, local, (weights * values[:, None]).ravel())
        self._sum_over_ranks(carried)
        return carried

    def to_ends(self, given: la.Vector) -> Array:
        """Return the values (k,) of nodes, of which half of each middle node's is added to each end
        of its edge, and zero at middle nodes; collective.  `given`: of all nodes."""
        added = self._zeros()
        halves = given.array[self._middle] / (2 * self._cells_of_edge)
        np.add.at(added.array, self._ends, halves[:, None])
        self._sum_over_ranks(added)
        total = given.array + added.array
        total[self._middle] = 0.0
        # Cells of other ranks may have the middle nodes that this rank owns.
        is_middle = self._zeros()
        is_middle.array[self._middle] = 1.0
        self._sum_over_ranks(is_middle)
        return np.asarray(np.where(is_middle.array > 0, 0.0, total)[self._local])

    def to_middles(self, values: Array) -> Array:
        """Return values (k,) of which those at middle nodes are the means of both ends;
        collective."""
        given = self._spread(values)
        means = self._zeros()
        of_edge = given.array[self._ends].mean(axis=1) / self._cells_of_edge
        np.add.at(means.array, self._middle, of_edge)
        self._sum_over_ranks(means)
        return np.asarray((given.array + means.array)[self._local])


def points_of(body: Body, contact_set: ContactSet) -> Int64Array:
    """Points (k,) of a contact that are on a body and belong to this rank; none if the contact does
    not have the body."""
    mesh = contact_set.mesh
    numbers = [k for k, other in enumerate(mesh.bodies) if other is body]
    is_of_body = np.isin(mesh.body[: mesh.points.body_count], numbers)
    return np.flatnonzero(is_of_body & mesh.shared.is_own)


def forces_on_points(contact_set: ContactSet) -> Array:
    """Return the contact force (n,) [N] on the points of bodies that this rank knows, as the mean
    of the last accepted step; collective.

    It is the sum of the sizes of all pairs' forces on a point: those on both sides of a film add
    up.  Pressures are forces over areas of the stress-free shape; that of cables and beams is
    length times diameter.  After a restart, until the next step, it is that of the state alone.
    """
    contact_set.stored_energy()
    x = contact_set.accepted.x
    last = contact_set.last_step()
    if last is None:
        pairs = PairStep.of_state(contact_set.pairs_with_energy(), x, contact_set.law)
    else:
        pairs = last.of_pairs
    force = np.zeros(contact_set.points.count)
    _, of_pairs = pairs.forces(x)
    np.add.at(force, pairs.pairs.points, np.linalg.norm(of_pairs, axis=2))
    of_bodies = force[: contact_set.points.body_count]
    # Any rank may have pairs at a point.
    contact_set.mesh.shared.take_sum(of_bodies)
    return of_bodies
