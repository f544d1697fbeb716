"""A contact of a scene as the system sees it."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, Protocol, Self, cast

import numpy as np
from petsc4py import PETSc

from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.drawing import Solid
from gossamer_fx.core.mesh.quality import box
from gossamer_fx.core.model.body import Body, MeshBody
from gossamer_fx.core.model.terms import Parameter
from gossamer_fx.mechanics.contact.active_set import ContactHistory
from gossamer_fx.mechanics.contact.contact_set import ContactSet
from gossamer_fx.mechanics.contact.contract import Array, ContactAssembly, Int64Array
from gossamer_fx.mechanics.contact.geometry.collision_mesh import CollisionMesh
from gossamer_fx.mechanics.contact.obstacles import Obstacle
from gossamer_fx.mechanics.contact.potential import ContactLaw
from gossamer_fx.mechanics.terms.assembly import (
    ActiveSet,
    Assembly,
    CompiledTerms,
    Compiler,
    Differentiable,
    Shown,
)

if TYPE_CHECKING:
    # A run without a gradient does not load it.
    from gossamer_fx.mechanics.contact.contact_gradient import ContactGradient

LOG = logging.getLogger("gossamer_fx")

# Keys of the numbers of a contact by which results may be derived.
FRICTION = "friction"
STIFFNESS = "stiffness"


class ContactItem(Protocol):
    """The item of a scene that is compiled: a `Contact`, whose attributes these are."""

    name: str
    bodies: list[MeshBody]
    obstacles: list[Obstacle]
    radii: list[float]
    distance: float
    stiffness: float | None
    friction: float
    slip_velocity: float


class CompiledContact(ContactSet, ActiveSet, Differentiable, Shown, CompiledTerms["ContactEnergy"]):
    """One contact of a scene as the system sees it: its pairs, and what outputs and gradients ask.
    Methods without a text here are described in `terms.assembly`.

    Attributes:
        item: of the scene.
        losses: its name, if it has friction.
    """

    reversible = False

    def __init__(self, terms: Sequence[ContactEnergy], system: Assembly) -> None:
        """Make the pairs of the only term; collective."""
        (term,) = terms
        item = term.item
        _examine_repeated_contacts(term, system)
        # The system has a mass matrix when contacts ask for it.
        whole = cast(ContactAssembly, system)
        own_coefficients = [obstacle.friction for obstacle in item.obstacles]
        of_obstacles = [item.friction if own is None else own for own in own_coefficients]
        has_friction = [coefficient > 0 for coefficient in of_obstacles]
        mesh = CollisionMesh(item.bodies, item.obstacles, item.radii, whole, has_friction)
        friction = None
        # An equilibrium has no sliding, and no friction.
        if (item.friction > 0 or any(of_obstacles)) and not system.rule.is_static:
            from gossamer_fx.mechanics.contact.friction.friction import Friction

            friction = Friction(
                mesh,
                coefficient=item.friction,
                of_obstacles=own_coefficients,
                slip_velocity=item.slip_velocity,
                law=term.law,
                system=whole,
            )
        ContactSet.__init__(
            self,
            mesh,
            law=term.law,
            activation_distance=item.distance,
            stiffness=item.stiffness,
            history=term.history,
            system=whole,
            friction=friction,
        )
        self.item = item
        self._term = term
        self.losses = [] if friction is None else [item.name]
        self.has_plateaus = friction is not None

    @classmethod
    def compile(cls, terms: Sequence[ContactEnergy], system: Assembly) -> list[Self]:
        return [cls([term], system) for term in terms]

    def has(self, term: object) -> bool:
        return term is self._term

    def energies(self) -> dict[str, float]:
        return {self.item.name: self.stored_energy()}

    # ---- sensitivities ---------------------------------------------------------------------------

    @cached_property
    def _gradient(self) -> ContactGradient:
        """Derivatives of the forces; made for gradients only."""
        from gossamer_fx.mechanics.contact.contact_gradient import ContactGradient

        return ContactGradient(self)

    def without_gradient(self) -> str:
        """Return in one sentence why the contact has no gradient; empty if it has one: always in a
        run, at an equilibrium only with a given stiffness."""
        if not self.system.rule.is_static or self.pair_stiffness.given is not None:
            return ""
        return (
            f"'{self.item.name}' derives its stiffness from the loads of the equilibrium, without "
            "a gradient; give it a stiffness"
        )

    def gradient_notes(self) -> list[str]:
        return [
            f"friction of '{name}' is piecewise smooth: the gradient is that of the pairs that "
            "stick and slide in this run"
            for name in self.losses
        ]

    def get_number(self, term: ContactEnergy, key: str) -> Array:
        """The present friction coefficient, or the given stiffness [N/m³], (1,), by its key."""
        if key == FRICTION:
            # An equilibrium has no friction, whatever its coefficient.
            friction = self.friction
            return np.array([term.item.friction if friction is None else friction.coefficient])
        return np.array([self.pair_stiffness.given])

    def set_number(self, term: ContactEnergy, key: str, value: Array) -> None:
        if key == FRICTION:
            if self.friction is not None:
                self.friction.set_coefficient(float(value[0]))
            return
        factor = self.pair_stiffness.rescale(float(value[0]))
        # Pairs that have energy get the new stiffness, too; the higher number makes `stored_energy`
        # compute the energy at q0 again.
        self.history.stiffness = self.history.stiffness * factor
        self.history.restored += 1

    def work_by_number(self, term: ContactEnergy, key: str, w: PETSc.Vec) -> Array:
        if key == FRICTION:
            return np.array([self._gradient.work_by_friction(w)])
        return np.array([self._gradient.work_by_stiffness(w)])

    def energy_by_number(self, term: ContactEnergy, key: str) -> Array:
        return np.array([0.0 if key == FRICTION else self._gradient.energy_by_stiffness()])

    def start_adjoint(self) -> None:
        self._gradient.start_adjoint()

    def add_start_derivatives(
        self, μ: PETSc.Vec, by_position: PETSc.Vec, by_velocity: PETSc.Vec
    ) -> None:
        self._gradient.add_product_with_start_derivative(μ, by_position, by_velocity)

    def add_energy_by_history(self, share: float) -> None:
        self._gradient.add_energy_by_stiffness(share)

    def masses_changed(self) -> None:
        self.pair_stiffness.masses_changed()

    def derivatives_by_mass(self) -> dict[MeshBody, float]:
        return self._gradient.derivatives_by_mass()

    # ---- outputs ---------------------------------------------------------------------------------

    def node_values(self, field: str, body: Body) -> tuple[Int64Array, Array] | None:
        """Return the values of an output field on nodes of a body; collective."""
        if field != "contact_pressure":
            return None
        # Loaded when the field is written: most runs do not ask for it.
        from gossamer_fx.mechanics.contact.contact_pressure import pressures_on

        return pressures_on(body, self)

    def solids(self) -> list[Solid]:
        """Return the obstacles as solids for pictures; collective. Planes, which have no end, are
        drawn near the bodies; kinds of obstacles without a picture are left out."""
        x = self.x0[: self.points.body_count]
        near = np.array(box(self.mesh.comm, x))
        found = [obstacle.solid(near) for obstacle in self.item.obstacles]
        return [solid for solid in found if solid is not None]


def _examine_repeated_contacts(term: ContactEnergy, system: Assembly) -> None:
    """Refuse a contact that is in the scene twice; warn of bodies that it and one before it keep
    apart."""
    # Bodies are compared as objects, obstacles by their arguments: equal obstacles are one.
    bodies = term.item.bodies
    obstacles = [_arguments(obstacle) for obstacle in term.item.obstacles]
    for other in system.terms:
        if other is term:
            return
        if not isinstance(other, ContactEnergy):
            continue
        names = f"'{other.item.name}' and '{term.item.name}'"
        shared = [body for body in bodies if body in other.item.bodies]
        others = [_arguments(obstacle) for obstacle in other.item.obstacles]
        # o is an obstacle, given by its arguments.
        has_all = len(shared) == len(bodies) and all(o in others for o in obstacles)
        is_in_all = len(shared) == len(other.item.bodies) and all(o in obstacles for o in others)
        check(
            not has_all and not is_in_all,
            f"Contacts {names} are the same: all of one is in the other, so that pairs would repel "
            "each other twice; leave one of them out.",
        )
        if shared and system.comm.rank == 0:
            LOG.warning(
                "Contacts %s both keep '%s' apart from itself, which doubles the stiffness there; "
                "put all bodies and obstacles into one contact.",
                names,
                shared[0].name,
            )


def _arguments(obstacle: Obstacle) -> tuple[type[Obstacle], str]:
    """What makes two obstacles the same: their kind and all arguments but the name."""
    arguments = {key: value for key, value in vars(obstacle).items() if key != "name"}
    return type(obstacle), repr(sorted(arguments.items()))


@dataclass(frozen=True, eq=False)
class ContactEnergy:
    """Stored energy and friction of the pairs between bodies and obstacles; see
    `contact.potential`.

    Attributes:
        item: of the scene.
        law: of the energy.
        parameters: by which results may be derived.
        history: history variables.
    """

    item: ContactItem
    law: ContactLaw
    parameters: tuple[Parameter, ...] = ()
    history: ContactHistory = field(default_factory=ContactHistory)
    compiler: ClassVar[Compiler] = CompiledContact
