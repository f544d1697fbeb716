"""Edges that intersect triangles, of films that may or may not be kept apart by a contact."""

from __future__ import annotations

import numpy as np

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.contact.broad_phase.facet_exchange import import_facets
from gossamer_fx.mechanics.contact.geometry.collision_mesh import CollisionMesh
from gossamer_fx.mechanics.contact.kernels.library import library
from gossamer_fx.mechanics.contact.narrow_phase.intersections import find_intersections
from gossamer_fx.solve.view import StateView


@check_arguments
class Crossings:
    """Number of edges of films that intersect a triangle of a film to which they are not connected.

    Exact, see `contact.narrow_phase.intersections`: an edge that only touches a triangle does not
    intersect it.  Films of order 2 are cut into plane triangles.  Each rank looks at the edges that
    it owns, and knows the triangles of other ranks that are near them, as with `Contact`.

    Args:
        bodies: one or several, in the scene.

    Raises:
        InputError: no film, one twice, or something else.

    Example:
        >>> import gossamer_fx as gx
        >>> def probes(film: gx.Membrane) -> gx.Series:
        ...     return gx.Series({"crossings": gx.probes.Crossings(film)})
    """

    def __init__(self, *bodies: Membrane) -> None:
        check(bool(bodies), "Crossings: there is no film; give one or several.")
        for k, film in enumerate(bodies):
            check(
                isinstance(film, Membrane),
                f"Crossings: {getattr(film, 'name', film)!r} is not a film; give films.",
            )
            check(
                not any(film is other for other in bodies[:k]),
                f"Crossings: '{film.name}' is given twice.",
            )
        self.bodies = bodies
        self._mesh: CollisionMesh | None = None

    def __call__(self, run: StateView) -> float:
        """The number of edges that intersect a triangle in the state of a run.  Collective.

        Args:
            run: whose present state is looked at.

        Raises:
            InputError: a film is not in the scene of the run.
        """
        system = run.system
        for film in self.bodies:
            check(
                any(film is body for body in system.bodies),
                f"'{film.name}' is not in the scene; add it, or remove its probe.",
            )
        library(run.comm)
        if self._mesh is None:
            self._mesh = CollisionMesh(self.bodies, [], [0.0] * len(self.bodies), system)
        mesh = self._mesh
        x = mesh.points.at(system.q0, system.time)
        import_facets(mesh, x, x)
        # The points of the mesh may be other ones now.
        x = mesh.points.at(system.q0, system.time)
        found = find_intersections(mesh.surface, x, mesh.own_edges)
        # An edge counts once, however many triangles it intersects.
        return float(run.comm.allreduce(len(np.unique(found[:, 0]))))
