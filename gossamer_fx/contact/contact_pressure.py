"""The pressure of contact on the points of bodies."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from gossamer_fx.contact.contact_set import ContactSet
from gossamer_fx.contact.kernels.library import Array
from gossamer_fx.contact.potential import act


def pressures(group: ContactSet) -> Array:
    """p (m,) [N/m²] of points in the accepted state: forces of pairs, the two sides of a film added, per area.

    The area is that of the stress-free shape for which a point stands; of cables and beams that of their shadow.
    Collective; the same on every rank.
    """
    group.energy_now()
    pairs = group.touching()
    forces = np.zeros(group.points.m)
    if len(pairs):
        of_pairs = np.asarray(act(pairs, group.x0, group.x0, group.law, 1.0, each=True).forces)
        np.add.at(forces, pairs.nodes, np.linalg.norm(of_pairs.reshape(-1, 4, 3), axis=2))
    group.points.comm.Allreduce(MPI.IN_PLACE, forces, op=MPI.SUM)
    n = group.points.n
    forces[:n] /= group.bodies.area[:n]
    return forces
