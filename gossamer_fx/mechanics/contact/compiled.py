"""All contacts of a scene as the system sees them."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, cast

import numpy as np
from petsc4py import PETSc

from gossamer_fx.core.algebra.rank_exchange import maximum_over_ranks
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.drawing import Solid
from gossamer_fx.core.model.body import Body, MeshBody
from gossamer_fx.core.model.parameters import Parameter
from gossamer_fx.mechanics.contact.arrays import Array, Int64Array
from gossamer_fx.mechanics.contact.contact_set import ContactSet
from gossamer_fx.mechanics.contact.geometry.collision_mesh import CollisionMesh
from gossamer_fx.mechanics.contact.history import ContactHistory
from gossamer_fx.mechanics.contact.obstacles import Obstacle
from gossamer_fx.mechanics.contact.pair_table import ActivePairs
from gossamer_fx.mechanics.contact.potential import ContactLaw
from gossamer_fx.mechanics.contact.system_view import ContactAssembly
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
    """The item of a scene to which a contact belongs.

    Attributes:
        name: in messages and outputs.
        obstacles: that take part.
    """

    name: str
    obstacles: list[Obstacle]


class CompiledContacts(ActiveSet, Differentiable, Shown, CompiledTerms["ContactEnergy"]):
    """All `ContactEnergy` terms of a scene; each method is shared out to contact sets.

    Attributes:
        contact_sets: by the item of the scene.
        losses: names of the contacts with friction.
    """

    reversible = False

    def __init__(self, terms: Sequence[ContactEnergy], system: Assembly) -> None:
        """Make a contact set, which holds the pairs that may touch, for each contact; collective.

        Args:
            terms: one for each `Contact` of the scene.
            system: the equations of the scene, with masses and supports.

        Raises:
            InputError: all bodies and obstacles of one contact are in another one, too.
        """
        # The system has a mass matrix and supports when contacts are asked for them.
        whole = cast(ContactAssembly, system)
        _examine_repeated_contacts(terms, system)
        self.contact_sets = {term.item: _contact_set(term, whole) for term in terms}
        self._with_friction = {
            item.name: contact_set
            for item, contact_set in self.contact_sets.items()
            if contact_set.friction is not None
        }
        self.losses = list(self._with_friction)
        self.has_plateaus = bool(self._with_friction)
        self._is_static = system.rule.is_static

    def update_active_set(self) -> None:
        for contact_set in self.contact_sets.values():
            contact_set.begin_step()

    def extend_active_set(self) -> bool:
        # All are asked, whatever the first one says: each is collective.
        extended = [contact_set.extend_active_set() for contact_set in self.contact_sets.values()]
        return any(extended)

    def limit_update(self, update: Array) -> None:
        for contact_set in self.contact_sets.values():
            contact_set.limit_update(update)

    def set_static_load(self, force: float) -> None:
        for contact_set in self.contact_sets.values():
            contact_set.set_static_load(force)

    def inadmissible(self) -> str:
        # All contact sets are asked, since each check is collective.
        messages = [contact_set.find_penetration() for contact_set in self.contact_sets.values()]
        return next(filter(None, messages), "")

    def add_forces(self, r: PETSc.Vec) -> None:
        for contact_set in self.contact_sets.values():
            contact_set.add_forces(r)

    def add_tangents(self, A: PETSc.Mat) -> None:
        for contact_set in self.contact_sets.values():
            contact_set.add_tangents(A)

    def coupling_matrices(self, diagonal: PETSc.Vec | None) -> list[PETSc.Mat]:
        found = [contact_set.coupling(diagonal) for contact_set in self.contact_sets.values()]
        return [matrix for matrix in found if matrix is not None]

    def supplied(self) -> float:
        return sum(contact_set.supplied_work() for contact_set in self.contact_sets.values())

    def dissipated(self) -> Array:
        return np.array(
            [contact_set.friction_loss() for contact_set in self._with_friction.values()]
        )

    def commit(self) -> None:
        for contact_set in self.contact_sets.values():
            contact_set.commit()

    def energies(self) -> dict[str, float]:
        return {
            item.name: contact_set.stored_energy()
            for item, contact_set in self.contact_sets.items()
        }

    # ---- sensitivities ---------------------------------------------------------------------------

    @cached_property
    def _gradients(self) -> dict[ContactItem, ContactGradient]:
        """Derivatives of each contact's forces, by the item of the scene; made for gradients
        only."""
        from gossamer_fx.mechanics.contact.contact_gradient import ContactGradient

        return {
            item: ContactGradient(contact_set) for item, contact_set in self.contact_sets.items()
        }

    def without_gradient(self) -> str:
        """Return in one sentence why a contact of the scene has no gradient; empty if all have one.

        In a run all have one.  At an equilibrium it takes a given stiffness.
        """
        if not self._is_static:
            return ""
        for item, contact_set in self.contact_sets.items():
            if not contact_set.has_given_stiffness:
                return (
                    f"'{item.name}' derives its stiffness from the loads of the equilibrium, "
                    "without a gradient; give it a stiffness"
                )
        return ""

    def gradient_notes(self) -> list[str]:
        return [
            f"friction of '{name}' is piecewise smooth: the gradient is that of the pairs that "
            "stick and slide in this run"
            for name in self._with_friction
        ]

    def get_number(self, term: ContactEnergy, key: str) -> Array:
        """The present friction coefficient, or the given stiffness [N/m³], (1,)."""
        contact_set = self.contact_sets[term.item]
        if key == FRICTION:
            # An equilibrium has no friction, whatever its coefficient.
            friction = contact_set.friction
            return np.array([term.friction if friction is None else friction.coefficient])
        return np.array([contact_set.given_stiffness])

    def set_number(self, term: ContactEnergy, key: str, value: Array) -> None:
        contact_set = self.contact_sets[term.item]
        if key == STIFFNESS:
            contact_set.scale_stiffness(float(value[0]))
        elif contact_set.friction is not None:
            contact_set.friction.set_coefficient(float(value[0]))

    def work_by_number(self, term: ContactEnergy, key: str, w: PETSc.Vec) -> Array:
        gradient = self._gradients[term.item]
        if key == FRICTION:
            return np.array([gradient.work_by_friction(w)])
        return np.array([gradient.work_by_stiffness(w)])

    def energy_by_number(self, term: ContactEnergy, key: str) -> Array:
        if key == FRICTION:
            return np.zeros(1)
        return np.array([self._gradients[term.item].energy_by_stiffness()])

    def start_adjoint(self) -> None:
        for gradient in self._gradients.values():
            gradient.start_adjoint()

    def add_start_derivatives(
        self, μ: PETSc.Vec, by_position: PETSc.Vec, by_velocity: PETSc.Vec
    ) -> None:
        for gradient in self._gradients.values():
            gradient.add_product_with_start_derivative(μ, by_position, by_velocity)

    def add_energy_by_history(self, share: float) -> None:
        for gradient in self._gradients.values():
            gradient.add_energy_by_stiffness(share)

    def masses_changed(self) -> None:
        for contact_set in self.contact_sets.values():
            contact_set.masses_changed()

    def derivatives_by_mass(self) -> dict[MeshBody, float]:
        found: dict[MeshBody, float] = {}
        for gradient in self._gradients.values():
            for body, by_mass in gradient.derivatives_by_mass().items():
                found[body] = found.get(body, 0.0) + by_mass
        return found

    def save_history(self) -> list[Any]:
        return [contact_set.save_history() for contact_set in self.contact_sets.values()]

    def load_history(self, saved: list[Any]) -> None:
        for contact_set, of_set in zip(self.contact_sets.values(), saved, strict=True):
            contact_set.load_history(of_set)

    def save_active_set(self) -> list[ActivePairs | None]:
        return [contact_set.save_active_set() for contact_set in self.contact_sets.values()]

    def load_active_set(self, saved: list[ActivePairs | None]) -> None:
        for contact_set, pairs in zip(self.contact_sets.values(), saved, strict=True):
            contact_set.load_active_set(pairs)

    def activate_present(self) -> None:
        for contact_set in self.contact_sets.values():
            contact_set.activate_present()

    def exchange_ends(self) -> None:
        for contact_set in self.contact_sets.values():
            contact_set.exchange_ends()

    def node_values(self, field: str, body: Body) -> tuple[Int64Array, Array] | None:
        """Return the values of an output field on nodes of a body; collective."""
        if field != "contact_pressure":
            return None
        # Loaded when the field is written: most runs do not ask for it.
        from gossamer_fx.mechanics.contact.contact_pressure import pressures_on

        nodes: list[Int64Array] = [np.zeros(0, dtype=np.int64)]
        values: list[Array] = [np.zeros(0)]
        for contact_set in self.contact_sets.values():
            of_nodes, pressure = pressures_on(body, contact_set)
            nodes.append(of_nodes)
            values.append(pressure)
        return np.concatenate(nodes), np.concatenate(values)

    def solids(self) -> list[Solid]:
        """Return the obstacles of all contacts as solids for pictures; collective.

        Planes, which have no end, are drawn near the bodies of their contact; kinds of obstacles
        without a picture are left out.
        """
        # Loaded when a picture is made.
        from gossamer_fx.mechanics.contact.obstacle_drawing import solid_of

        found = []
        for item, contact_set in self.contact_sets.items():
            of_bodies = _corners_of_all(contact_set)
            found += [solid_of(obstacle, of_bodies) for obstacle in item.obstacles]
        return [solid for solid in found if solid is not None]


def _corners_of_all(contact_set: ContactSet) -> Array:
    """Return the box round the bodies of a contact, of all ranks together.  Collective.

    Returns:
        the corners with the least and with the greatest coordinates, (2, 3) [m].
    """
    x = contact_set.x0[: contact_set.points.body_count]
    corners = np.concatenate([x.max(axis=0, initial=-np.inf), -x.min(axis=0, initial=np.inf)])
    corners = maximum_over_ranks(contact_set.mesh.comm, corners)
    return np.array([-corners[3:], corners[:3]])


def _examine_repeated_contacts(terms: Sequence[ContactEnergy], system: Assembly) -> None:
    """Refuse a contact that is in the scene twice; warn of bodies that two contacts keep apart.

    The warning goes to the log, once for each pair of contacts that share a body.

    Raises:
        InputError: all bodies and obstacles of one contact are in another one, too.
    """
    for k, term in enumerate(terms):
        for other in terms[:k]:
            names = f"'{other.item.name}' and '{term.item.name}'"
            # Bodies are compared as objects, obstacles by their arguments: equal obstacles are
            # one.
            shared = [body for body in term.bodies if body in other.bodies]
            obstacles = [_arguments(obstacle) for obstacle in term.obstacles]
            others = [_arguments(obstacle) for obstacle in other.obstacles]
            # o is an obstacle, given by its arguments.
            has_all = len(shared) == len(term.bodies) and all(o in others for o in obstacles)
            is_in_all = len(shared) == len(other.bodies) and all(o in obstacles for o in others)
            check(
                not has_all and not is_in_all,
                f"Contacts {names} are the same: all of one is in the other, so that pairs would "
                "repel each other "
                "twice; leave one of them out.",
            )
            if shared and system.comm.rank == 0:
                LOG.warning(
                    "Contacts %s both keep '%s' apart from itself, which doubles the stiffness "
                    "there; put all bodies "
                    "and obstacles into one contact.",
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
        bodies: films, cables and beams.
        obstacles: what they touch.
        radii: of the bodies [m].
        law: of the energy.
        activation_distance: largest gap [m] at which pairs have energy.
        stiffness: K [N/m³]; None: derived from the closing speed.
        friction: coefficient of bodies with each other, and with obstacles without a coefficient.
        slip_velocity: speed [m/s] below which what sticks may creep.
        history: history variables.
        parameters: by which results may be derived.
    """

    item: ContactItem
    bodies: Sequence[MeshBody]
    obstacles: Sequence[Obstacle]
    radii: Sequence[float]
    law: ContactLaw
    activation_distance: float
    stiffness: float | None
    friction: float = 0.0
    slip_velocity: float = 1e-3
    history: ContactHistory = field(default_factory=ContactHistory)
    parameters: tuple[Parameter, ...] = ()
    compiler: ClassVar[Compiler] = CompiledContacts


def _contact_set(term: ContactEnergy, system: ContactAssembly) -> ContactSet:
    """Make a contact set: collision mesh, friction, and pairs that may touch, of one contact;
    collective.

    Friction, and the frames of obstacles that it needs, are there only if a coefficient is positive
    and the scene moves: an equilibrium has none."""
    own_coefficients = [obstacle.friction for obstacle in term.obstacles]
    of_obstacles = [term.friction if own is None else own for own in own_coefficients]
    mesh = CollisionMesh(
        term.bodies,
        term.obstacles,
        term.radii,
        system,
        has_friction=[coefficient > 0 for coefficient in of_obstacles],
    )
    friction = None
    # An equilibrium has no sliding, and no friction.
    if (term.friction > 0 or any(of_obstacles)) and not system.rule.is_static:
        from gossamer_fx.mechanics.contact.friction.friction import Friction

        friction = Friction(
            mesh,
            coefficient=term.friction,
            of_obstacles=own_coefficients,
            slip_velocity=term.slip_velocity,
            law=term.law,
            system=system,
        )
    return ContactSet(
        mesh,
        law=term.law,
        activation_distance=term.activation_distance,
        stiffness=term.stiffness,
        history=term.history,
        system=system,
        friction=friction,
    )
