"""Edges that intersect triangles, of films that may or may not be kept apart by a contact."""

from __future__ import annotations

import numpy as np

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.contact.geometry.collision_filter import filter_labels
from gossamer_fx.contact.geometry.collision_primitives import CollisionPrimitives, edges_of
from gossamer_fx.contact.geometry.facets import facets_of
from gossamer_fx.contact.kernels.library import library
from gossamer_fx.contact.narrow_phase.intersections import find_intersections
from gossamer_fx.probes.run import Run
from gossamer_fx.system.system import System


@check_arguments
class Crossings:
    """Number of edges of films that intersect a triangle of a film to which they are not connected.

    Exact, see `contact.narrow_phase.intersections`: an edge that only touches a triangle does not
    intersect it.  Films of order 2 are cut into plane triangles.  Each rank looks at its share of the
    edges, and knows all positions, as with `Contact`.

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
        """Check the films; surfaces are built when the probe is first called."""
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
        self._surface: CollisionPrimitives | None = None

    def __call__(self, run: Run) -> float:
        """The number of edges that intersect a triangle in the state of a run.  Collective."""
        system = run.system
        for film in self.bodies:
            check(
                any(film is body for body in system.bodies),
                f"'{film.name}' is not in the scene; add it, or remove its probe.",
            )
        library(run.comm)
        if self._surface is None:
            self._surface = self._build_surface(system)
        # Any two parts may intersect, so that every rank needs all positions.
        positions = [
            system.state[film].gathered()[nodes]
            for film, nodes in zip(self.bodies, self._nodes, strict=True)
        ]
        x = np.ascontiguousarray(np.concatenate(positions))
        edge_count = len(self._surface.edges)
        # Edges in turn: neighbours in the mesh, which often intersect together, are on different
        # ranks.
        own_edges = np.arange(run.comm.rank, edge_count, run.comm.size, dtype=np.int32)
        found = find_intersections(self._surface, x, own_edges)
        # An edge counts once, however many triangles it intersects.
        return float(run.comm.allreduce(len(np.unique(found[:, 0]))))

    def _build_surface(self, system: System) -> CollisionPrimitives:
        """Return the points, edges and triangles of all films, with the labels of tied points."""
        facets = [facets_of(film) for film in self.bodies]
        self._nodes = [facet.nodes for facet in facets]
        triangles = []
        point_count = 0
        for facet in facets:
            triangles.append(facet.triangles + point_count)
            point_count += len(facet.nodes)
        all_triangles = np.ascontiguousarray(np.vstack(triangles), dtype=np.int32)
        return CollisionPrimitives(
            vertices=np.arange(point_count, dtype=np.int32),
            edges=edges_of(all_triangles),
            triangles=all_triangles,
            is_fixed=np.zeros(point_count, dtype=np.uint8),
            labels=filter_labels(system, self.bodies, self._nodes, point_count),
        )
