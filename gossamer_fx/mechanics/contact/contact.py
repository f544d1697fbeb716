"""Contact of films, cables and beams with themselves, each other and obstacles: the item of a
scene, and what the system sees of it."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.core.checks.arguments import Range, check_arguments, not_negative, positive
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.lookups import check_known
from gossamer_fx.core.checks.relations import each_once
from gossamer_fx.core.drawing import Solid
from gossamer_fx.core.mesh.quality import box
from gossamer_fx.core.model.body import Body, MeshBody, NodalBody
from gossamer_fx.core.model.item import Item
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Parameter, Term
from gossamer_fx.mechanics.contact.active_set import ContactHistory
from gossamer_fx.mechanics.contact.contact_set import ContactSet
from gossamer_fx.mechanics.contact.contact_step import ContactLaw
from gossamer_fx.mechanics.contact.contract import Array, Int64Array
from gossamer_fx.mechanics.contact.geometry.collision_mesh import CollisionMesh
from gossamer_fx.mechanics.contact.geometry.curved_cells import (
    least_piece_count,
    piece_count,
)
from gossamer_fx.mechanics.contact.geometry.facets import TRIANGLE_SIDES, facets_of
from gossamer_fx.mechanics.contact.obstacles import Obstacle
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

LAWS = {"barrier": ContactLaw.BARRIER, "penalty": ContactLaw.PENALTY}

# Activation distance over the shortest edge, at least: positions have errors of 1e-12 of it.
ROUND_OFF = 1e-10

# Activation distance and diameter of a body, over its shortest edge, at most: neighbours on one
# film would otherwise begin to touch each other.
MAX_REACH = 0.5

# Below the least slip velocity round-off would count as sliding; above the largest one nothing
# slides fast enough for the full friction.
SlipVelocity = Annotated[float, Range(1e-12, 1e6, "m/s")]


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
        own_coefficients = [obstacle.friction for obstacle in item.obstacles]
        of_obstacles = [item.friction if own is None else own for own in own_coefficients]
        has_friction = [coefficient > 0 for coefficient in of_obstacles]
        mesh = CollisionMesh(
            item.bodies, item.obstacles, item.radii, item.piece_counts, system, has_friction
        )
        friction = None
        # An equilibrium has no sliding, and no friction.
        if (item.friction > 0 or any(of_obstacles)) and not system.rule.is_static:
            from gossamer_fx.mechanics.contact.friction.friction import Friction

            friction = Friction(
                mesh,
                coefficient=item.friction,
                of_obstacles=own_coefficients,
                slip_velocity=item.slip_velocity,
                system=system,
            )
        ContactSet.__init__(
            self,
            mesh,
            law=term.law,
            activation_distance=item.distance,
            stiffness=item.stiffness,
            history=term.history,
            system=system,
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
        from gossamer_fx.mechanics.contact.contact_pressure import pressed_nodes

        for touching in self.item.bodies:
            if touching is body:
                pressed = pressed_nodes(touching, self)
                return pressed.nodes, pressed.pressure
        return None

    def solids(self) -> list[Solid]:
        """Return the obstacles as solids for pictures; collective. Planes, which have no end, are
        drawn near the bodies; kinds of obstacles without a picture are left out."""
        x = self.accepted.x[: self.points.body_count]
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
    `contact.contact_step`.

    Attributes:
        item: of the scene.
        law: of the energy.
        parameters: by which results may be derived.
        history: history variables.
    """

    item: Contact
    law: ContactLaw
    parameters: tuple[Parameter, ...] = ()
    history: ContactHistory = field(default_factory=ContactHistory)
    compiler: ClassVar[Compiler] = CompiledContact


@check_arguments(each_once("bodies"))
class Contact(Item):
    """Keeps films, cables and beams apart: each from itself, from the others and from obstacles.

    Pairs of points and triangles, and of two edges, store the energy k b(s/d²) while their squared
    distance s is below d², d being the `distance`:

        barrier   b(x) = (1 - x)³/(4x)     penalty   b(x) = (1 - √x)²/2

    Steps conserve energy, momentum and angular momentum.  A step in which something would pass
    through something else is rejected and solved again in two halves.  Layers that are nearer to
    each other than d at the start begin to touch at nine tenths of their gap, which grows back to d
    as they part.  Where a `Tie` or a `BallJoint` connects bodies they do not touch, just as
    neighbouring cells of one film.

    Args:
        bodies: films, cables and beams, and obstacles (`Plane`, `Sphere`, `Cylinder`, `Cone`,
            `Box`, or an `Obstacle` of your own).
        distance: gap d [m] at which contact begins, at most half of the shortest edge; about the
            spacing that packed layers shall keep.
        stiffness: K [N/m³], pressure over closing: k = K d² A of a pair that stands for the area A.
            None: k = 4 σ v² A of each pair, with the area density σ and the closing speed v, at
            least d/2 in the first step, which stops what comes at this speed within d; in an
            equilibrium k = 10 p d A, with the mean pressure p of the loads or that of the
            prestress, and ten times as much whenever pairs are closed to a third of d, or films
            with a barrier to half of it.
        law: "barrier" or "penalty".
        friction: coefficient μ of Coulomb friction; obstacles may have their own.  The work of
            friction is dissipated, in the ledger under the name of the contact.  An equilibrium has
            no friction.
        slip_velocity: speed [m/s] below which parts that stick may slide: friction grows up to it.
        radius: of cables and beams, and of films if they shall have one, by name of the body [m].
        name: name in messages and outputs.

    Raises:
        InputError: no body, one twice, a distance that is not positive or larger than half an edge,
            a negative stiffness or friction, a slip velocity out of its range, a cable without a
            radius; when the scene is compiled: layers that intersect, or that coincide and are not
            tied.

    Example:
        >>> import gossamer_fx as gx
        >>> from mpi4py import MPI
        >>> from gossamer_fx.presets.films import KAPTON_HN
        >>> from gossamer_fx.meshes.sheet import sheet
        >>> film = gx.Membrane(sheet(MPI.COMM_WORLD, 2, 2, 0.1, 0.1), KAPTON_HN.law(25e-6))
        >>> floor = gx.contact.Plane(point=(0.0, 0.0, -0.01), normal=(0.0, 0.0, 1.0))
        >>> scene = gx.Scene(gx.Contact(film, floor, distance=1e-3, friction=0.3))
    """

    def __init__(
        self,
        *bodies: NodalBody | Obstacle,
        distance: Annotated[float, positive("m")],
        stiffness: Annotated[float, positive("N/m³")] | None = None,
        law: Literal["barrier", "penalty"] = "barrier",
        friction: Annotated[float, not_negative()] = 0.0,
        slip_velocity: SlipVelocity = 1e-3,
        radius: Mapping[str, float] | None = None,
        name: str = "contact",
    ) -> None:
        """Check the arguments, and divide the bodies into those on meshes and obstacles.
        Collective: the shortest edge of a body is that of all ranks."""
        self.name = name
        self.distance = distance
        self.stiffness = stiffness
        self.law = law
        self.friction = friction
        self.slip_velocity = slip_velocity
        self.bodies = [body for body in bodies if not isinstance(body, Obstacle)]
        self.obstacles = [body for body in bodies if isinstance(body, Obstacle)]
        check(bool(self.bodies), f"Contact '{name}' has no film, cable or beam; give at least one.")
        self.radii = self._radii(radius or {})
        # Cells of order 2 are cut into flat pieces, as many as curvature asks for and as have room.
        self.piece_counts = [
            piece_count(body, distance, longest=(distance + 2 * body_radius) / MAX_REACH)
            for body, body_radius in zip(self.bodies, self.radii, strict=True)
        ]

    def _radii(self, given: Mapping[str, float]) -> list[float]:
        """Return the radius [m] of each of `self.bodies`, in their order; 0 where none is given."""
        names = [body.name for body in self.bodies]
        for name in given:
            check_known(f"Contact '{self.name}'", "body", name, names)
        return [self._radius(body, float(given.get(body.name, 0.0))) for body in self.bodies]

    def _radius(self, body: MeshBody, radius: float) -> float:
        """Return the radius [m] of a body, if its edges are long enough for it; collective."""
        is_line = body.space.mesh.topology.dim == 1
        is_allowed = radius > 0 or (radius == 0 and not is_line)
        check(
            math.isfinite(radius) and is_allowed,
            f"Contact '{self.name}': the radius of '{body.name}' is {radius!r} m; give "
            f"radius={{'{body.name}': ...}}.",
        )
        # Every rank knows its own facets; cells of order 2 are cut into pieces.
        facets = facets_of(body, least_piece_count(body))
        ends = facets.lines if is_line else facets.triangles[:, TRIANGLE_SIDES].reshape(-1, 2)
        lengths = np.linalg.norm(facets.X[ends[:, 0]] - facets.X[ends[:, 1]], axis=1)
        shortest = float(body.comm.allreduce(lengths.min(initial=np.inf), op=MPI.MIN))
        check(
            self.distance >= ROUND_OFF * shortest,
            f"Contact '{self.name}': a distance of {self.distance:g} m is below the round-off of "
            f"'{body.name}', whose shortest edge is {shortest:.3g} m; give a larger one.",
        )
        check(
            self.distance + 2 * radius <= MAX_REACH * shortest,
            f"Contact '{self.name}': a distance of {self.distance:g} m and a radius of {radius:g} "
            f"m are too much for '{body.name}', whose shortest edge is {shortest:.3g} m: distance "
            "+ 2 radius is at most half of it; give less, or mesh coarser.",
        )
        return radius

    def requires(self) -> Iterable[Any]:
        yield from self.bodies
        for obstacle in self.obstacles:
            yield from obstacle.requires()

    def terms(self, start: State) -> Iterable[Term]:
        yield ContactEnergy(self, LAWS[self.law], tuple(self._parameters()))

    def _parameters(self) -> Iterable[Parameter]:
        """Yield the numbers by which results may be derived: those that the user gave."""
        if self.friction > 0:
            yield Parameter("friction", "", FRICTION)
        if self.stiffness is not None:
            yield Parameter("stiffness", "N/m³", STIFFNESS)
