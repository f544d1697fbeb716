"""Loads along edges: forces in space or normal to the edge, and bending moments along the rim of a
plate."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING

import numpy as np
import ufl
from dolfinx import fem

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check_on_all
from gossamer_fx.core.checks.relations import exactly_one, only_with
from gossamer_fx.core.forms.compilation import constant
from gossamer_fx.core.forms.kinematics import Expr, area_vector
from gossamer_fx.core.model.body import Vector
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import OnBody, Parameter, Term
from gossamer_fx.mechanics.bodies.membrane import Membrane, edge_measure
from gossamer_fx.mechanics.terms.loads import Load, in_time

if TYPE_CHECKING:
    from gossamer_fx.mechanics.bodies.plate import Plate


@check_arguments(exactly_one("force", "normal_force"), only_with("following", "normal_force"))
@dataclass(frozen=True, eq=False)
class EdgeLoad(OnBody):
    """A force per reference length along a named group of edges of a film: δW = ∫f·w ds.

    Args:
        body: a film or plate.
        edges: name of curves of its mesh, on its rim or inside it.
        force: f [N/m], three numbers or a function of time [s] that returns them: its direction in
            space stays.
        normal_force: instead of a force, p [N/m] of f = p ν along the normal ν of a rim, in the
            film's plane and outwards; a number or a function of time [s].
        following: whether ν turns with the deformed film (δW = ∫p ν·w ds, |ν| = 1), or stays that
            of the mesh.
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
        # The normal of an edge in its sheet is defined on the rim only.
        check_on_all(
            film.comm,
            self.normal_force is None or bool(film.mesh.edges.is_boundary[edges].all()),
            f"EdgeLoad: the group '{self.edges}' of '{film.name}' has edges where sheets meet, or "
            "inside the film where a load has no normal; name edges of the rim, or give a force in "
            "space.",
        )
        if not self.name:
            object.__setattr__(self, "name", f"{film.name}/{self.edges} load")

    def terms(self, start: State) -> Iterable[Term]:
        if self.normal_force is None:
            yield self._in_space()
        else:
            yield self._across()

    def _along(self) -> ufl.Measure:
        """The measure of the edges, each seen from one of its triangles, for loads of the order of
        the film.  Positions are continuous, so that any triangle will do, also where several sheets
        meet."""
        film = self.body
        table = film.mesh.edges
        edges = film.mesh.curve(self.edges, "EdgeLoad")
        edges = edges[edges < table.owned]
        column = np.where(table.cells[edges, 0] >= 0, 0, 1)
        facets = np.stack([table.cells[edges, column], table.sides[edges, column]], axis=1)
        return ufl.Measure(
            "ds",
            film.mesh.domain,
            subdomain_data=[(1, facets.ravel().astype(np.int32))],
            subdomain_id=1,
            # Exact for a constant force: test functions have the order of the film.
            metadata={"quadrature_degree": film.order},
        )

    def _in_space(self) -> Term:
        """The load of a force f [N/m] in space: δW = ∫f·w ds.  Collective."""
        force = self.force
        name = self.name
        ds = self._along()
        given: tuple[float, ...] = (0.0, 0.0, 0.0)
        if force is not None and not callable(force):
            given = tuple(float(component) for component in force)
        # A constant, so that other values need no new kernel.
        f = fem.Constant(self.body.mesh.domain, given)

        def work(x: Expr, w: Expr) -> ufl.Form:
            """δW [J] along test functions w."""
            return ufl.dot(f, w) * ds

        if callable(force):
            at = in_time(self.body.comm, f"'{name}'", force, f)
            return Load(name, self.body, work, at=at)
        return Load(name, self.body, work, parameters=(Parameter("force", "N/m", f),))

    def _across(self) -> Term:
        """The load of a force p ν, p [N/m], along the normal ν of the rim: δW = ∫p ν·w ds.
        Collective."""
        film = self.body
        value = self.normal_force
        ds = self._along()
        given = 0.0
        if value is not None and not callable(value):
            given = float(value)
        f = constant(film.mesh.domain, given)
        ν = ufl.FacetNormal(film.mesh.domain)

        def work(x: Expr, w: Expr) -> ufl.Form:
            # Dead load: normal and length of the edge are those of the mesh.
            if not self.following:
                return f * ufl.dot(ν, w) * ds
            # The deformed edge has this tangent; its product with the film's normal is along -ν.
            a = area_vector(film.deformation(x))
            tangent = ufl.dot(ufl.grad(x), ufl.cross(_normal(film), ν))
            along = ufl.cross(a, tangent)
            return -f * ufl.dot(along, w) / ufl.sqrt(ufl.dot(along, along)) * ds

        if callable(value):
            at = in_time(film.comm, f"'{self.name}'", value, f)
            return Load(self.name, film, work, follows=self.following, at=at)
        parameters = (Parameter("normal_force", "N/m", f),)
        return Load(self.name, film, work, follows=self.following, parameters=parameters)


def _normal(film: Membrane) -> Expr:
    """Unit normal of the undeformed film."""
    n = area_vector(film.deformation(ufl.SpatialCoordinate(film.mesh.domain)))
    return n / ufl.sqrt(ufl.dot(n, n))


@check_arguments
@dataclass(frozen=True, eq=False)
class EdgeMoment(OnBody):
    """A moment per reference length about the deformed edge of a plate: δW = ∫ m n·w,n ds.

    n is the normal of the plate, and w,n the derivative of the test function across the edge.

    Args:
        body: a plate.
        edges: name of curves on its rim.
        moment: m [N], a number or a function of time [s]; positive where it lifts the plate's rim
            towards the normal of its mesh, as positive curvature does.
        name: name in messages and output.

    Raises:
        InputError: edges inside the plate.

    Example:
        >>> gx.loads.EdgeMoment(plate, "right", moment=0.1).name
        'plate/right moment'
    """

    body: Plate
    edges: str
    _: KW_ONLY
    moment: float | Callable[[float], float]
    name: str = ""

    def __post_init__(self) -> None:
        edges = self.body.mesh.curve(self.edges, f"EdgeMoment on '{self.body.name}'")
        check_on_all(
            self.body.comm,
            bool(self.body.mesh.edges.is_boundary[edges].all()),
            f"EdgeMoment: the group '{self.edges}' has edges inside '{self.body.name}'; "
            "name a part of its rim.",
        )
        if not self.name:
            object.__setattr__(self, "name", f"{self.body.name}/{self.edges} moment")

    def terms(self, start: State) -> Iterable[Term]:
        plate = self.body
        value = self.moment
        edges = plate.mesh.curve(self.edges, "EdgeMoment")
        # The normal is a quotient of polynomials, for which no degree is exact; a flat plate of
        # order 2 needs 1.
        ds = edge_measure(plate, "ds", edges, degree=3)
        # A function of time is evaluated first by `at`, before any step.
        m = constant(plate.mesh.domain, 0.0 if callable(value) else value)
        at = None
        if callable(value):
            at = in_time(plate.comm, f"EdgeMoment '{self.name}'", value, m)

        # A couple on the rotation of the edge: the slope of the virtual displacement across the
        # edge, along the normal of the deformed plate.
        def work(x: Expr, w: Expr) -> ufl.Form:
            return m * ufl.dot(plate.bending.edge_normal(x), plate.bending.slope(w)) * ds

        yield Load(self.name, plate, work, follows=True, at=at)
