"""Contact of films, cables and beams with themselves, each other and obstacles."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Annotated, Any, Literal

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.checks.arguments import Range, check_arguments, not_negative, positive
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import MeshBody, has_nodal_unknowns, is_body, is_on_mesh
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Parameter, Term
from gossamer_fx.mechanics.contact.compiled import FRICTION, STIFFNESS, ContactEnergy
from gossamer_fx.mechanics.contact.geometry.facets import TRIANGLE_SIDES, facets_of
from gossamer_fx.mechanics.contact.obstacles import Obstacle
from gossamer_fx.mechanics.contact.potential import ContactLaw

LAWS = {"barrier": ContactLaw.BARRIER, "penalty": ContactLaw.PENALTY}

# Activation distance over the shortest edge, at least: positions have errors of 1e-12 of it.
ROUND_OFF = 1e-10

# Activation distance and diameter of a body, over its shortest edge, at most: neighbours on one
# film would otherwise begin to touch each other.
MAX_REACH = 0.5

# Below the least slip velocity round-off would count as sliding; above the largest one nothing
# slides fast enough for the full friction.
SlipVelocity = Annotated[float, Range(1e-12, 1e6, "m/s")]


@check_arguments
class Contact:
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
        bodies: films, cables and beams, and obstacles (`Plane`, `Sphere`, `Cylinder`, `Box`).
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
        *bodies: MeshBody | Obstacle,
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
        self._check_bodies(bodies)
        self.bodies = [body for body in bodies if not isinstance(body, Obstacle)]
        self.obstacles = [body for body in bodies if isinstance(body, Obstacle)]
        check(bool(self.bodies), f"Contact '{name}' has no film, cable or beam; give at least one.")
        self.radii = self._radii(radius or {})

    def _check_bodies(self, bodies: tuple[Any, ...]) -> None:
        """Raise `InputError` for what has no surface, and for what is given twice."""
        for k, body in enumerate(bodies):
            is_given_before = any(body is other for other in bodies[:k])
            check(
                not is_given_before,
                f"Contact '{self.name}': '{getattr(body, 'name', body)}' is given twice; give it "
                "once, which covers its contact with itself.",
            )
            if isinstance(body, Obstacle):
                continue
            check(
                is_body(body) and is_on_mesh(body),
                f"Contact '{self.name}': {body!r} has no surface; give films, cables, beams and "
                "obstacles.",
            )
            check(
                has_nodal_unknowns(body),
                f"Contact '{self.name}': '{body.name}' is reduced, without nodes that touch; give "
                "the film itself.",
            )

    def _radii(self, given: Mapping[str, float]) -> list[float]:
        """Return the radius [m] of each of `self.bodies`, in their order; 0 where none is given."""
        unknown = sorted(set(given) - {body.name for body in self.bodies})
        check(
            not unknown,
            f"Contact '{self.name}': radius is given for {', '.join(map(repr, unknown))}, which is "
            "not among its bodies; give the names of films, cables and beams of this contact.",
        )
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
        # Every rank knows its own facets.
        facets = facets_of(body)
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
