"""Load along edges of a film, in space or normal to the edge."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import meshtags

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check, check_on_all
from gossamer_fx.checks.user_functions import ask_numbers
from gossamer_fx.forms.compilation import constant
from gossamer_fx.forms.kinematics import Expr, area_vector
from gossamer_fx.model.body import Vector
from gossamer_fx.model.parameters import Parameter
from gossamer_fx.model.state import State
from gossamer_fx.model.terms import Term
from gossamer_fx.terms.loads import Load


@check_arguments
@dataclass(frozen=True, eq=False)
class EdgeLoad:
    """A force per reference length along a named group of edges of a film: δW = ∫f·w ds.

    Args:
        body: a film or plate.
        edges: name of curves of its mesh, on its rim or inside it.
        force: f [N/m], three numbers or a function of time [s] that returns them: its direction in space
            stays.
        normal_force: instead of a force, p [N/m] of f = p ν along the normal ν of a rim, in the film's
            plane and outwards; a number or a function of time [s].
        following: whether ν turns with the deformed film (δW = ∫p ν·w ds, |ν| = 1), or stays that of the
            mesh.
        name: name in messages and output.

    Raises:
        InputError: neither or both of the forces; a normal force on edges that are not on the rim.

    Example:
        >>> gx.loads.EdgeLoad(film, "right", force=(10.0, 0.0, 0.0)).name
        'film/right load'
        >>> gx.loads.EdgeLoad(film, "top", normal_force=lambda t: 10.0 * t).edges
        'top'
    """

    body: Membrane
    edges: str
    _: KW_ONLY
    force: Vector | Callable[[float], Vector] | None = None
    normal_force: float | Callable[[float], float] | None = None
    following: bool = False
    name: str = ""

    def __post_init__(self) -> None:
        film = self.body
        edges = film.mesh.curve(self.edges, f"EdgeLoad on '{film.name}'")
        check(
            (self.force is None) != (self.normal_force is None),
            f"EdgeLoad on '{self.edges}': give either a force or a normal one.",
        )
        sheets = film.mesh.edges.count[edges]
        check_on_all(
            film.comm,
            bool((sheets <= (2 if self.normal_force is None else 1)).all()),
            f"EdgeLoad: the group '{self.edges}' of '{film.name}' has edges where several sheets meet, or inside the "
            "film where a load has no normal; name edges of the rim, or give a force in space.",
        )
        if not self.name:
            object.__setattr__(self, "name", f"{film.name}/{self.edges} load")

    def requires(self) -> Iterable[Any]:
        yield self.body

    def terms(self, start: State) -> Iterable[Term]:
        if self.normal_force is None:
            yield self._in_space()
        else:
            yield self._across()

    def _measures(self) -> tuple[ufl.Measure | None, ufl.Measure | None]:
        """Of the edges on the rim, and of those inside; none if there are none."""
        film, domain = self.body, self.body.mesh.domain
        domain.topology.create_connectivity(1, 2)
        edges = film.mesh.curve(self.edges, "EdgeLoad")
        rim = film.mesh.edges.is_boundary[edges]
        found: list[ufl.Measure | None] = []
        for kind, own in (("ds", edges[rim]), ("dS", edges[~rim])):
            tags = meshtags(domain, 1, own, np.ones(len(own), dtype=np.int32))
            measure = ufl.Measure(
                kind, domain, subdomain_data=tags, metadata={"quadrature_degree": film.order}
            )
            found.append(measure(1) if film.comm.allreduce(len(own)) else None)
        return found[0], found[1]

    def _in_space(self) -> Term:
        force, name, (ds, dS) = self.force, self.name, self._measures()
        given = (
            (0.0, 0.0, 0.0) if force is None or callable(force) else tuple(float(c) for c in force)
        )
        f = fem.Constant(self.body.mesh.domain, given)

        def at(t: float) -> None:
            if callable(force):
                f.value[:] = ask_numbers(
                    self.body.comm, f"'{name}' at t = {t:.6g} s", lambda: force(t), (3,)
                )

        def work(x: Expr, w: Expr) -> ufl.Form:
            both = [] if ds is None else [ufl.dot(f, w) * ds]
            both += [] if dS is None else [ufl.dot(f, ufl.avg(w)) * dS]
            return sum(both[1:], both[0])

        if callable(force):
            return Load(name, self.body, work, at=at)
        return Load(name, self.body, work, parameters=(Parameter("force", "N/m", f),))

    def _across(self) -> Term:
        film, value, (ds, _) = self.body, self.normal_force, self._measures()
        f = constant(film.mesh.domain, 0.0 if callable(value) else float(value or 0.0))
        ν = ufl.FacetNormal(film.mesh.domain)

        def at(t: float) -> None:
            if callable(value):
                f.value = float(
                    ask_numbers(film.comm, f"'{self.name}' at t = {t:.6g} s", lambda: value(t))
                )

        def work(x: Expr, w: Expr) -> ufl.Form:
            if not self.following:
                return f * ufl.dot(ν, w) * ds
            a = area_vector(film.deformation(x))
            along = ufl.cross(a, ufl.dot(ufl.grad(x), ufl.cross(_normal(film), ν)))
            return -f * ufl.dot(along, w) / ufl.sqrt(ufl.dot(along, along)) * ds

        if callable(value):
            return Load(self.name, film, work, follows=self.following, at=at)
        parameters = (Parameter("normal_force", "N/m", f),)
        return Load(self.name, film, work, follows=self.following, parameters=parameters)


def _normal(film: Membrane) -> Expr:
    """Unit normal of the mesh."""
    n = area_vector(film.deformation(ufl.SpatialCoordinate(film.mesh.domain)))
    return n / ufl.sqrt(ufl.dot(n, n))
