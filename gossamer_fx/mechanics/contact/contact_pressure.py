"""The output field `contact_pressure`: the pressure of contact on the nodes of bodies."""

from __future__ import annotations

import logging
from weakref import WeakSet

import numpy as np

from gossamer_fx.core.model.body import Body, is_on_mesh
from gossamer_fx.mechanics.contact.contact_set import ContactSet
from gossamer_fx.mechanics.contact.contract import Array, Int64Array
from gossamer_fx.mechanics.contact.potential import evaluate

LOG = logging.getLogger("gossamer_fx")

# Films for which the warning was logged.
_warned: WeakSet[Body] = WeakSet()


def pressures_on(body: Body, contact_set: ContactSet) -> tuple[Int64Array, Array]:
    """Return global numbers (k,) of the nodes of a body, and the contact pressure (k,) [N/m²] on
    them; collective.  Each node is on one rank; both are empty if the contact does not have the
    body."""
    # The same on all ranks: `pressures` is collective.
    if not any(other is body for other in contact_set.mesh.bodies):
        return np.zeros(0, dtype=np.int64), np.zeros(0)
    warn_of_order(body)
    of_body = nodes_of(body, contact_set)
    return contact_set.mesh.nodes[of_body], pressures(contact_set)[of_body]


def is_curved_film(body: Body) -> bool:
    """Whether the cells of a body are triangles of order 2, which contact cuts into four plane
    pieces."""
    if not is_on_mesh(body):
        return False
    space = body.space
    return space.mesh.topology.dim == 2 and space.ufl_element().degree == 2


def warn_of_order(body: Body) -> None:
    """Warn once of a film of order 2: the pieces share the loads of a cell, and not its shape
    functions, so that a uniform pressure is 0 at vertices and 4/3 of it at other nodes."""
    if body in _warned or not is_curved_film(body):
        return
    _warned.add(body)
    if body.comm.rank == 0:
        LOG.warning(
            "contact_pressure: '%s' is a film of order 2, whose nodes share the contact forces of a"
            " cell unevenly: 0 at vertices and 4/3 of the pressure at other nodes; only sums over "
            "an area are right.",
            body.name,
        )


def nodes_of(body: Body, contact_set: ContactSet) -> Int64Array:
    """Points (k,) of a contact that are nodes of a body and belong to this rank; none if the
    contact does not have the body."""
    mesh = contact_set.mesh
    numbers = [k for k, other in enumerate(mesh.bodies) if other is body]
    is_of_body = np.isin(mesh.body[: mesh.points.body_count], numbers)
    return np.flatnonzero(is_of_body & mesh.shared.is_own)


def pressures(contact_set: ContactSet) -> Array:
    """Return the contact pressure (n,) [N/m²] on the points of bodies that this rank knows, as the
    mean of the last accepted step; collective.

    It is the sum of the sizes of all pairs' forces on a point, over the area of the stress-free
    shape for which the point stands: pressures on both sides of a film add up.  The area of cables
    and beams is length times diameter.  After a restart, until the next step, it is that of the
    state alone.
    """
    contact_set.stored_energy()
    points = contact_set.points
    end = contact_set.x0
    pairs = contact_set.pairs_of_last_step()
    start = end
    # Weight of the end in the configuration where forces act; 1: the state alone.
    α = 1.0
    if pairs is None:
        pairs = contact_set.pairs_with_energy()
    else:
        system = contact_set.system
        start = points.at(system.previous, system.time - system.h)
        α = system.rule.alpha
    force = np.zeros(points.count)
    if len(pairs):
        response = evaluate(
            pairs,
            start,
            end,
            contact_set.law,
            α,
            by_pair=True,
            push_back=contact_set.forces.push_back,
        )
        of_pairs = np.asarray(response.forces).reshape(-1, 4, 3)
        np.add.at(force, pairs.points, np.linalg.norm(of_pairs, axis=2))
    of_bodies = force[: points.body_count]
    # Any rank may have pairs at a point.
    contact_set.mesh.shared.take_sum(of_bodies)
    return of_bodies / contact_set.mesh.area[: points.body_count]
