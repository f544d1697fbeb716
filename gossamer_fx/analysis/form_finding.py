"""Form-finding: the shape that a film of prescribed tension takes between its supports.

Updated reference strategy (Bletzinger & Ramm, Int. J. Space Structures 14 (1999) 131): in the tension n0 as constant
second Piola-Kirchhoff stress the film is a force-density net, whose equilibrium is a linear problem.  Its solution is
the next reference shape; where both coincide the Cauchy stress is the prescribed one, and the film a minimal surface.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.algebra.point_measures import PointMeasure
from gossamer_fx.analysis.equilibrium import Equilibrium, EquilibriumResult
from gossamer_fx.bodies.cable import CableLaw
from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import NoEquilibrium, check
from gossamer_fx.connectors.tape import Tape
from gossamer_fx.forms.kinematics import Expr
from gossamer_fx.forms.spaces import cell_nodes
from gossamer_fx.materials.film import FilmLaw
from gossamer_fx.model.body import Array
from gossamer_fx.model.ports import combine
from gossamer_fx.model.state import State
from gossamer_fx.model.terms import Term
from gossamer_fx.scene.scene import Scene
from gossamer_fx.terms.point_energies import PointStoredEnergy


@check_arguments
@dataclass(frozen=True)
class Prestress(FilmLaw):
    """Film whose stress is `tension` [N/m] in all directions whatever its strain: W = n0 tr E.

    E and nu are not used, density and thickness give the mass.
    """

    _: KW_ONLY
    tension: float

    quadratic = True

    def __post_init__(self) -> None:
        super().__post_init__()
        check(
            math.isfinite(self.tension) and self.tension > 0,
            f"Prestress: tension is {self.tension!r} N/m; give a positive number.",
        )

    def energy(self, e: Expr, c: Any) -> Expr:
        return c.tension * (e[0] + e[1])


@dataclass(frozen=True)
class GivenForce:
    """ψ(e) = e."""

    def energy(self, e: Array) -> Array:
        return e[:, 0]

    def average(self, e0: Array, e1: Array) -> tuple[Array, Array]:
        return np.ones_like(e1), np.zeros((*e1.shape, 1))


@check_arguments
@dataclass(frozen=True, eq=False)
class EdgeCable:
    """Cable along edges of a film whose force is `force` [N] whatever its strain: W = N Σ L ½(λ² - 1).

    A film of tension n0 pulls it into an arc of radius N/n0.

    Args:
        body: what it borders.
        edges: name of curves of the film's mesh.
    """

    body: Membrane
    edges: str
    _: KW_ONLY
    force: float
    name: str = ""

    def __post_init__(self) -> None:
        check(
            math.isfinite(self.force) and self.force > 0,
            f"EdgeCable: force is {self.force!r} N; give a positive number.",
        )
        if not self.name:
            object.__setattr__(self, "name", f"{self.body.name}/{self.edges} cable")

    def requires(self) -> Iterable[Any]:
        yield self.body

    def terms(self, start: State) -> Iterable[Term]:
        bars = Tape.along_edges(
            self.body, CableLaw(self.force, 1.0), edges=self.edges, name=self.name
        )
        lengths = np.asarray(bars.lengths)
        energies = self.force * lengths
        roots = np.sqrt(energies) / lengths
        vectors = [
            (combine((float(r), -float(r)), (b, a)),)
            for (a, b), r in zip(bars.bars, roots, strict=True)
        ]
        yield PointStoredEnergy(
            self.name,
            PointMeasure(vectors, np.eye(3)[None], np.zeros((1, 3)), -energies[:, None] / 2),
            GivenForce(),
        )


@check_arguments
def find_form(
    body: Membrane, scene: Callable[[], Scene], *, change: float = 1e-6, updates: int = 200
) -> EquilibriumResult:
    """Move the mesh of a film of order 1 to the shape of its prescribed stress.

    Args:
        body: its law is a `Prestress`; its mesh is the first guess and is overwritten.
        scene: makes the scene anew, as supports take their positions from the mesh.
        change: largest movement of a node in an update [m] at which the shape counts as found.
        updates: of the reference shape before the search is given up.

    Raises:
        InputError: another law or order.
        NoEquilibrium: the shape still moves, as that of a film does that pinches off.
    """
    check(
        isinstance(body.law, Prestress),
        f"find_form: the law of '{body.name}' is no Prestress; give its tension.",
    )
    check(body.order == 1, f"find_form: '{body.name}' is of order {body.order}; use 1.")
    moved = math.inf
    for _ in range(updates):
        search = Equilibrium(scene())
        found = search.find()
        moved = _adopt(body, search)
        if moved <= change:
            return found
    raise NoEquilibrium(
        f"After {updates} updates '{body.name}' still moves by {moved:.1e} m; it may pinch off."
    )


def _adopt(film: Membrane, search: Equilibrium) -> float:
    """Give the mesh the positions that were found; returns the largest movement [m]."""
    q = search.system.state[film].local_positions()
    geometry = film.space.mesh.geometry
    before = geometry.x.copy()
    geometry.x[geometry.dofmap.ravel()] = q[cell_nodes(film.space).ravel()]
    return float(
        film.comm.allreduce(float(np.abs(geometry.x - before).max(initial=0.0)), op=MPI.MAX)
    )
