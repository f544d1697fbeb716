"""Probes of contact: functions of a run that return one number, the same on every rank."""

from __future__ import annotations

from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.contact.compiled import CompiledContacts
from gossamer_fx.contact.contact import Contact
from gossamer_fx.contact.contact_set import ContactSet
from gossamer_fx.contact.narrow_phase.intersections import intersections
from gossamer_fx.contact.obstacles import Obstacle
from gossamer_fx.model.body import MeshBody

AXES = {"x": 0, "y": 1, "z": 2}


def group_of(contact: Contact, run: Any) -> ContactSet:
    """The pairs of a contact in a run.

    Raises:
        InputError: the contact is not in the run's scene.
    """
    for compiled in run.system.compiled:
        if isinstance(compiled, CompiledContacts) and contact in compiled.groups:
            return compiled.groups[contact]
    check(False, f"'{contact.name}' is not in the scene; add it, or remove its probe.")
    raise AssertionError


@check_arguments
class ContactGap:
    """Least distance [m] between parts of a contact that do not hang together, less their radii.

    Infinite if nothing was within reach of the last search.
    """

    def __init__(self, contact: Contact) -> None:
        self.contact = contact

    def __call__(self, run: Any) -> float:
        group = group_of(self.contact, run)
        gaps = group.found.gaps(group.points.at(run.system.q0, run.system.time))
        return float(run.comm.allreduce(float(gaps.min(initial=np.inf)), op=MPI.MIN))


@check_arguments
class ContactForce:
    """Component [N] of the force that a contact exerts on one of its bodies or obstacles: the mean of the last step."""

    def __init__(self, contact: Contact, body: MeshBody | Obstacle, *, axis: str) -> None:
        known: list[MeshBody | Obstacle] = [*contact.bodies, *contact.obstacles]
        names = ", ".join(one.name for one in known)
        check(
            axis in AXES,
            f"A vector has no component {axis!r}; its components are: {', '.join(AXES)}.",
        )
        here = any(body is one for one in known)
        check(
            here,
            f"'{getattr(body, 'name', body)}' is not in '{contact.name}', which holds: {names}.",
        )
        self.contact, self.axis = contact, axis
        self._number = next(k for k, one in enumerate(known) if one is body)

    def __call__(self, run: Any) -> float:
        group = group_of(self.contact, run)
        here = group.bodies.body == self._number
        return float(run.comm.allreduce(-float(group.force[here, AXES[self.axis]].sum())))


@check_arguments
class Penetrations:
    """Number of edges and triangles that pierce each other: zero, unless a contact failed to do its duty."""

    def __init__(self, contact: Contact) -> None:
        self.contact = contact

    def __call__(self, run: Any) -> float:
        group = group_of(self.contact, run)
        x = group.points.at(run.system.q0, run.system.time)
        return float(
            run.comm.allreduce(len(intersections(group.bodies.surface, x, group.bodies.own_edges)))
        )
