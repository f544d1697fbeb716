"""Edges that pierce triangles, of films that may or may not be kept apart by a contact."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.contact.broad_phase.box_tree import CollisionPrimitives
from gossamer_fx.contact.geometry.collision_filter import places_of
from gossamer_fx.contact.geometry.facets import facets_of
from gossamer_fx.contact.kernels.library import library
from gossamer_fx.contact.narrow_phase.intersections import intersections
from gossamer_fx.probes.run import Run
from gossamer_fx.system.system import System


@check_arguments
class Crossings:
    """Number of edges of films that pierce a triangle of the same or another one, with which they do not hang together.

    Exact, see `contact.piercing`: an edge that only touches a triangle does not pierce it.  Films of order 2 are cut
    into plane triangles.  Each rank asks for its part of the edges, and knows all positions, as with `Contact`.

    Args:
        bodies: one or several, in the scene.

    Raises:
        InputError: no film, or one twice.
    """

    def __init__(self, *bodies: Membrane) -> None:
        check(bool(bodies), "Crossings: there is no film; give one or several.")
        for k, film in enumerate(bodies):
            check(
                isinstance(film, Membrane),
                f"Crossings: {getattr(film, 'name', film)!r} is no film; give films.",
            )
            check(
                not any(film is other for other in bodies[:k]),
                f"Crossings: '{film.name}' is given twice.",
            )
        self.bodies = bodies
        self._surface: CollisionPrimitives | None = None

    def __call__(self, run: Run) -> float:
        bodies, system = run.system.bodies, run.system
        for film in self.bodies:
            check(
                any(film is b for b in bodies),
                f"'{film.name}' is not in the scene; add it, or remove its probe.",
            )
        library(run.comm)
        if self._surface is None:
            self._take(system)
        assert self._surface is not None
        films = zip(self.bodies, self._nodes, strict=True)
        x = np.concatenate([system.state[film].gathered()[nodes] for film, nodes in films])
        mine = np.arange(run.comm.rank, len(self._surface.edges), run.comm.size, dtype=np.int32)
        found = intersections(self._surface, np.ascontiguousarray(x), mine)
        return float(run.comm.allreduce(len(np.unique(found[:, 0]))))

    def _take(self, system: System) -> None:
        """Points, edges and triangles of all films, and where these are tied."""
        facets = [facets_of(film) for film in self.bodies]
        self._nodes = [f.nodes for f in facets]
        starts = np.cumsum([0, *(len(f.nodes) for f in facets)])
        T = np.vstack(
            [f.triangles + start for f, (start, _) in zip(facets, pairwise(starts), strict=True)]
        )
        sides = np.unique(np.sort(T[:, [[0, 1], [1, 2], [0, 2]]].reshape(-1, 2), axis=1), axis=0)
        edges, triangles = (np.ascontiguousarray(part, dtype=np.int32) for part in (sides, T))
        n = int(starts[-1])
        places = places_of(system, self.bodies, self._nodes, n)
        self._surface = CollisionPrimitives(
            np.arange(n, dtype=np.int32), edges, triangles, np.zeros(n, dtype=np.uint8), places
        )
