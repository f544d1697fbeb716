"""Contacts as the system sees them: lists of pairs that change from step to step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from gossamer_fx.contact.contact_set import ContactSet
from gossamer_fx.contact.geometry.collision_mesh import CollisionMesh
from gossamer_fx.contact.history import ContactHistory
from gossamer_fx.contact.obstacles import Obstacle
from gossamer_fx.drawing.solids import Solid
from gossamer_fx.model.body import Array, Body, MeshBody
from gossamer_fx.model.roles import (
    ActiveSet,
    Dissipation,
    Drawable,
    Forces,
    NodeFields,
    StateObserver,
    StepCheck,
    StoredEnergies,
    Supply,
    Tangents,
)
from gossamer_fx.terms.assembly import Assembly, CompiledTerms


class CompiledContacts(
    ActiveSet,
    StateObserver,
    StepCheck,
    Forces,
    Tangents,
    StoredEnergies,
    Supply,
    Dissipation,
    NodeFields,
    Drawable,
    CompiledTerms,
):
    """All `ContactEnergy` terms of a scene."""

    def __init__(self, terms: Sequence[ContactEnergy], system: Assembly) -> None:
        self.groups: dict[Any, ContactSet] = {}  # by the scene's items
        for term in terms:
            of_solids = [
                term.friction if o.friction is None else o.friction for o in term.obstacles
            ]
            bodies = CollisionMesh(
                term.bodies, term.obstacles, term.radii, system, [μ > 0 for μ in of_solids]
            )
            group = ContactSet(bodies, term.law, term.distance, term.stiffness, term.memory, system)
            if (term.friction > 0 or any(of_solids)) and system.rule.alpha < 1:
                from gossamer_fx.contact.friction.friction import Friction

                group.friction = Friction(bodies, term.friction, of_solids, term.creep, system)
            self.groups[term.item] = group
        self._rubbing = {
            item.name: group for item, group in self.groups.items() if group.friction is not None
        }
        self.losses = list(self._rubbing)

    def update_active_set(self) -> None:
        for group in self.groups.values():
            group.search()

    def extend_active_set(self) -> bool:
        missed = [
            group.widen() for group in self.groups.values()
        ]  # all of them, whatever the first says
        return any(missed)

    def limit_update(self, update: Array) -> None:
        for group in self.groups.values():
            group.limit(update)

    def inadmissible(self) -> str:
        return next(filter(None, [group.inadmissible() for group in self.groups.values()]), "")

    def add_forces(self, r: PETSc.Vec) -> None:
        for group in self.groups.values():
            group.add_forces(r)

    def add_tangents(self, A: PETSc.Mat) -> None:
        for group in self.groups.values():
            group.add_tangents(A)

    def coupling_matrices(self, diagonal: PETSc.Vec | None) -> list[PETSc.Mat]:
        found = [group.coupling(diagonal) for group in self.groups.values()]
        return [matrix for matrix in found if matrix is not None]

    def supplied(self) -> float:
        return sum(group.supplied() for group in self.groups.values())

    def dissipated(self) -> Array:
        return np.array([group.dissipated() for group in self._rubbing.values()])

    def commit(self) -> None:
        for group in self.groups.values():
            group.keep()

    def node_values(self, field: str, body: Body) -> tuple[npt.NDArray[np.int64], Array] | None:
        if field != "contact_pressure":
            return None
        from gossamer_fx.contact.contact_pressure import pressures

        nodes: list[npt.NDArray[np.int64]] = [np.zeros(0, dtype=np.int64)]
        values: list[Array] = [np.zeros(0)]
        for group in self.groups.values():
            bodies = group.bodies
            place = next((k for k, other in enumerate(bodies.of) if other is body), None)
            if place is not None:
                here = np.flatnonzero(bodies.body[: bodies.points.n] == place)
                nodes.append(bodies.nodes[here])
                values.append(pressures(group)[here])
        return np.concatenate(nodes), np.concatenate(values)

    def solids(self) -> list[Solid]:
        from gossamer_fx.contact.obstacle_drawing import solid_of

        found = [
            solid_of(obstacle, group.x0[: group.points.n])
            for item, group in self.groups.items()
            for obstacle in item.obstacles
        ]
        return [solid for solid in found if solid is not None]

    def energies(self) -> dict[str, float]:
        return {item.name: group.energy_now() for item, group in self.groups.items()}


@dataclass(frozen=True, eq=False)
class ContactEnergy:
    """Stored energy of all pairs between the primitives of some bodies and obstacles; see `contact.pairs`."""

    item: Any  # of the scene, which has a name
    bodies: Sequence[MeshBody]
    obstacles: Sequence[Obstacle]
    radii: Sequence[float]
    law: int
    distance: float
    stiffness: float | None
    friction: float = 0.0
    creep: float = 1e-3
    memory: ContactHistory = field(default_factory=ContactHistory)
    compiler: ClassVar[type[CompiledTerms]] = CompiledContacts
