"""Form-finding: the shape that a film of prescribed tension takes between its supports.

Problem.  A film in uniform tension n0 is a minimal surface; its shape follows from its supports and
is not known before.

Idea (updated reference strategy, Bletzinger & Ramm, Int. J. Space Structures 14 (1999) 131).  With
n0 as constant second Piola-Kirchhoff stress, equilibrium is a linear problem, that of a
force-density net.  Its solution is the next reference shape.  Where the solution and the reference
coincide, the Cauchy stress is n0.

Algorithm.

1. Find the equilibrium with the present mesh as reference shape (one linear solve).
2. Move the mesh to the equilibrium.
3. Repeat until no node moves by more than `change` times the extent of the mesh.

Limits.  A film that pinches off, such as a catenoid between rings that are too far apart, has no
minimal surface of the assumed topology; its mesh degenerates and the iteration does not end.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.analysis.statics.equilibrium import Equilibrium
from gossamer_fx.analysis.statics.result import EquilibriumResult
from gossamer_fx.core.algebra.point_measures import PointMeasure
from gossamer_fx.core.checks.arguments import (
    Range,
    check_arguments,
    collective,
    not_negative,
    positive,
)
from gossamer_fx.core.checks.errors import NoEquilibrium, check
from gossamer_fx.core.forms.backend import cell_nodes, geometry_nodes
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.mesh.quality import extent
from gossamer_fx.core.model.body import combine
from gossamer_fx.core.model.item import Item
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.bodies.cable import CableLaw
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.connectors.tape import Tape
from gossamer_fx.mechanics.materials.film import FilmLaw, IsotropicFilm
from gossamer_fx.mechanics.terms.rows import Response, Rows
from gossamer_fx.solve.scene.scene import Scene


@check_arguments
@dataclass(frozen=True)
class Prestress(IsotropicFilm):
    """Film whose stress is the same in all directions and at every strain: W = n0 tr E.

    E and nu are not used; density and thickness give the mass.

    Args:
        tension: n0 [N/m].

    Raises:
        InputError: the tension is not a positive number.

    Example:
        >>> law = gx.analysis.Prestress(1e9, 0.3, density=1400.0, thickness=1e-4, tension=100.0)
        >>> law.tension
        100.0
    """

    _: KW_ONLY
    tension: Annotated[float, positive("N/m")]

    quadratic = True

    # Its stress is the same at every strain.
    taut_strain = FilmLaw.taut_strain

    def energy(self, e: Expr, c: Any) -> Expr:
        """W [J/m²] of the strains e = (E_xx, E_yy, ...), with the constants c of the law."""
        return c.tension * (e[0] + e[1])


def constant_tension(e0: Any, e1: Any, z0: Any, h: Any, numbers: Any) -> Response:
    """ψ(e) = e [J], whose force does not depend on its measure e."""
    return Response([1.0], energy=e1[0])


@check_arguments
@dataclass(frozen=True, eq=False)
class EdgeCable(Item):
    """Cable along edges of a film with a prescribed force N: W = N Σ L ½(λ² - 1).

    L are the lengths of the edges in the reference shape, λ their stretches.  A film of tension n0
    pulls the cable into an arc of radius N/n0.

    Args:
        body: the film along whose edges the cable runs.
        edges: name of curves of the film's mesh.
        force: N [N].
        name: for messages; default from body and edges.

    Raises:
        InputError: the force is not a positive number.

    Example:
        >>> gx.analysis.EdgeCable(film, "left", force=50.0).name
        'film/left cable'
    """

    body: Membrane
    edges: str
    _: KW_ONLY
    force: Annotated[float, positive("N")]
    name: str = ""

    def __post_init__(self) -> None:
        if not self.name:
            object.__setattr__(self, "name", f"{self.body.name}/{self.edges} cable")

    def requires(self) -> Iterable[Any]:
        yield self.body

    def terms(self, start: State) -> Iterable[Term]:
        """One stored energy ψ = ½ |√(N/L) (x_b - x_a)|² - ½ N L for each edge of length L [m] with
        ends at x_a and x_b [m]."""
        # The law of the tape is not used, only its edges and their lengths.
        bars = Tape.along_edges(
            self.body, CableLaw(self.force, 1.0), edges=self.edges, name=self.name
        )
        lengths = np.asarray(bars.lengths)
        energies = self.force * lengths  # N L
        roots = np.sqrt(energies) / lengths  # √(N/L)
        vectors = []
        for (a, b), root in zip(bars.bars, roots, strict=True):
            weights = (float(root), -float(root))
            vectors.append((combine(weights, (b, a)),))
        measure = PointMeasure(vectors, np.eye(3)[None], np.zeros((1, 3)), -energies[:, None] / 2)
        yield Rows(self.name, measure, constant_tension)


@check_arguments
@collective
def find_form(
    body: Membrane,
    scene: Callable[[], Scene],
    *,
    change: Annotated[float, not_negative()] = 1e-4,
    updates: Annotated[int, Range(1)] = 200,
) -> EquilibriumResult:
    """Move the mesh of a film of order 1 to the shape of its prescribed stress.

    Collective. Every update solves for the equilibrium of a new scene and moves the nodes of the
    mesh there; after an error the mesh stays where the last update has moved it.

    Args:
        body: its law is a `Prestress`; its mesh is the first guess and is overwritten.
        scene: returns a new scene with the film: supports read their positions from the mesh.
        change: largest movement of a node in an update, over the extent of the mesh (the diagonal
            of its box), at which the shape counts as found.  It falls no further than to 1e-6 to
            5e-5, where nodes slide along the film without changing its shape.
        updates: number of updates of the reference shape after which the search is given up.

    Returns:
        The last equilibrium.

    Raises:
        InputError: the film has another law or order.
        NoEquilibrium: a search for an equilibrium fails, or the shape still moves after the last
            update, as that of a film that pinches off.

    Example:
        >>> law = gx.analysis.Prestress(1e9, 0.3, density=1400.0, thickness=1e-4, tension=100.0)
        >>> canopy = gx.Membrane(mesh, law, name="canopy")
        >>> def scene():
        ...     edges = ("left", "right", "bottom", "top")
        ...     return gx.Scene(canopy, *[gx.Fixed(canopy, edge) for edge in edges])
        >>> result = gx.analysis.find_form(canopy, scene)
        >>> result.regular
        True
    """
    check(
        isinstance(body.law, Prestress),
        f"find_form: the law of '{body.name}' is not a Prestress but a {type(body.law).__name__}; "
        "give the film a Prestress with its tension.",
    )
    check(
        body.order == 1,
        f"find_form: '{body.name}' is of order {body.order}; give a film of order 1.",
    )
    smallest = change * extent(body.space.mesh)
    movement = math.inf
    for _ in range(updates):
        search = Equilibrium(scene())
        found = search.find()
        movement = _move_mesh(body, search)
        if movement <= smallest:
            return found
    raise NoEquilibrium(
        f"After {updates} updates '{body.name}' still moves by {movement:.1e} m; it may pinch off."
    )


def _move_mesh(film: Membrane, search: Equilibrium) -> float:
    """Move the mesh to the equilibrium; returns the largest change of a coordinate [m] on all
    ranks."""
    positions = search.system.unknowns.state[film].local_positions()
    geometry = film.space.mesh.geometry
    before = geometry.x.copy()
    # The nodes of a film of order 1 are the points of its mesh, in another order.
    geometry.x[geometry_nodes(film.space.mesh).ravel()] = positions[cell_nodes(film.space).ravel()]
    largest = float(np.abs(geometry.x - before).max(initial=0.0))
    return float(film.comm.allreduce(largest, op=MPI.MAX))
