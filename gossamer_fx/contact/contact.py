"""Contact of films, cables and beams with themselves, each other and solids."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.contact.compiled import ContactEnergy
from gossamer_fx.contact.geometry.facets import facets_of
from gossamer_fx.contact.obstacles import Obstacle, check_friction
from gossamer_fx.contact.potential import BARRIER, PENALTY
from gossamer_fx.model.body import MeshBody, has_nodal_unknowns, is_body, is_on_mesh
from gossamer_fx.model.state import State
from gossamer_fx.model.terms import Term

LAWS = {"barrier": BARRIER, "penalty": PENALTY}


@check_arguments
class Contact:
    """Keeps films, cables and beams apart: each from itself, from the others and from solids.

    Stored energy Σ k b(s/d̂²) over all pairs of points and triangles, and of edges, with squared distances s < d̂²:

        barrier   b(x) = (1 - x)³/(4x)     penalty   b(x) = (1 - √x)²/2

    The squared distance is a concave function of quadratic measures, so that a step conserves energy, momentum and
    angular momentum as it does with films (DOI of the path average: 10.1007/BF00913408).  A step in which something
    would pass through something else is made anew in halves.  Layers that are nearer to each other than d̂ at the start
    begin to touch at nine tenths of that distance, which grows as they part.  Where a `Tie` or a `BallJoint` joins
    bodies they hang together, as the cells of one film do: cells that are joined are no pair, all others touch.

    Args:
        bodies: films, cables and beams, and obstacles (`Plane`, `Sphere`, `Cylinder`, `Box`).
        distance: d̂ at which contact begins [m], at most half of the shortest edge; about the spacing that packed layers
            shall keep.
        stiffness: K [N/m³], pressure by closing: k = K d̂² A of a pair that stands for the area A.  None: k = 4 σ v² A
            with the area density σ and the closing speed v, by pairs, which stops what comes at this speed within d̂.
        law: "barrier" or "penalty".
        friction: coefficient μ of Coulomb friction; obstacles may have their own.  Parts that press with the mean
            force N and slide by w in a step resist with μ N φ(|w|/(h v_s)) along w, φ(y) = 2y - y² up to y = 1,
            then 1; the work is booked as dissipated, and momentum and angular momentum are kept.  An equilibrium
            has none.
        slip_velocity: v_s [m/s], below which parts that stick may slide.
        radius: of the cables and beams, by name [m].
        name: name in messages and output.

    Raises:
        InputError: no body, one twice, a distance that is not positive or larger than half an edge, a negative
            stiffness or friction, a cable without radius; when the scene is compiled: layers that pierce each other, or
            coincide and are not tied.
    """

    def __init__(
        self,
        *bodies: MeshBody | Obstacle,
        distance: float,
        stiffness: float | None = None,
        law: str = "barrier",
        friction: float = 0.0,
        slip_velocity: float = 1e-3,
        radius: Mapping[str, float] | None = None,
        name: str = "contact",
    ) -> None:
        self.name, self.distance, self.stiffness = name, distance, stiffness
        check(math.isfinite(distance) and distance > 0, _says(name, "distance", distance, "m"))
        check(
            stiffness is None or (math.isfinite(stiffness) and stiffness > 0),
            _says(name, "stiffness", stiffness, "N/m³"),
        )
        check(law in LAWS, f"Contact '{name}': law is {law!r}; use 'barrier' or 'penalty'.")
        check_friction(f"Contact '{name}'", friction)
        check(
            math.isfinite(slip_velocity) and slip_velocity > 0,
            _says(name, "slip_velocity", slip_velocity, "m/s"),
        )
        self.law, self.friction, self.slip_velocity = law, friction, slip_velocity
        for k, body in enumerate(bodies):
            known = isinstance(body, Obstacle) or (is_body(body) and is_on_mesh(body))
            check(
                known,
                f"Contact '{name}': {body!r} has no surface; give films, cables, beams and obstacles.",
            )
            of_nodes = isinstance(body, Obstacle) or has_nodal_unknowns(body)
            check(
                of_nodes,
                f"Contact '{name}': '{body.name}' is reduced, without nodes that touch; give the film itself.",
            )
            twice = any(body is other for other in bodies[:k])
            check(
                not twice,
                f"Contact '{name}': '{getattr(body, 'name', '')}' is given twice; once covers itself, too.",
            )
        self.bodies = [b for b in bodies if not isinstance(b, Obstacle)]
        self.obstacles = [b for b in bodies if isinstance(b, Obstacle)]
        check(bool(self.bodies), f"Contact '{name}' has no film, cable or beam; give at least one.")
        given = dict(radius or {})
        strangers = sorted(set(given) - {b.name for b in self.bodies})
        check(
            not strangers,
            f"Contact '{name}': there is no '{''.join(strangers[:1])}' whose radius is given.",
        )
        self.radii = [self._radius(body, float(given.get(body.name, 0.0))) for body in self.bodies]

    def _radius(self, body: MeshBody, radius: float) -> float:
        """The radius of a body, which leaves room between its edges."""
        of_line = body.space.mesh.topology.dim == 1
        check(
            math.isfinite(radius) and (radius > 0 if of_line else radius >= 0),
            f"Contact '{self.name}': the radius of '{body.name}' is {radius!r} m; give radius={{'{body.name}': ...}}.",
        )
        facets = facets_of(body)
        sides = ((0, 1), (1, 2), (0, 2))
        ends = facets.lines if of_line else np.vstack([facets.triangles[:, side] for side in sides])
        shortest = float(np.linalg.norm(facets.X[ends[:, 0]] - facets.X[ends[:, 1]], axis=1).min())
        check(
            self.distance + 2 * radius <= shortest / 2,
            f"Contact '{self.name}': a distance of {self.distance:g} m and a radius of {radius:g} m are too much for "
            f"'{body.name}', whose shortest edge is {shortest:.3g} m: distance + 2 radius is at most half of it; give "
            "less, or mesh coarser.",
        )
        return radius

    def requires(self) -> Iterable[Any]:
        yield from self.bodies
        for obstacle in self.obstacles:
            yield from obstacle.requires()

    def terms(self, start: State) -> Iterable[Term]:
        law = LAWS[self.law]
        yield ContactEnergy(
            self,
            self.bodies,
            self.obstacles,
            self.radii,
            law,
            self.distance,
            self.stiffness,
            self.friction,
            self.slip_velocity,
        )


def _says(name: str, what: str, value: Any, unit: str) -> str:
    return f"Contact '{name}': {what} is {value!r} {unit}; give a positive number."
