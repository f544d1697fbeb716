"""A part whose pairs change from step to step: spheres that collide, found before each step."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from petsc4py import PETSc
from scipy.spatial import cKDTree

from gossamer_fx.core.algebra.point_measures import Gather, PointMeasure, PointMeasures, add_blocks
from gossamer_fx.core.model.body import Array, Port
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.extend import Item
from gossamer_fx.mechanics.connectors.spring import half_distance_squared, stop
from gossamer_fx.mechanics.terms.assembly import (
    ActiveSet,
    Assembly,
    CompiledTerms,
    Compiler,
    HistoryVariables,
)
from gossamer_fx.mechanics.terms.rows import LawOfRows, Stencil

Pairs = frozenset[tuple[int, int]]


class Collisions(ActiveSet, HistoryVariables, CompiledTerms["CollidingSpheres"]):
    """Pairs of spheres that may touch in the step, as one stencil.

    Before a step they are those within reach at the present speeds; those that its end shows to be
    missing are added. A sphere that another has passed through refuses the step.
    """

    def __init__(self, terms: Sequence[CollidingSpheres], system: Assembly) -> None:
        [self.spheres] = terms
        self._system = system
        self._ports = self.spheres.ports
        self.found = 0  # most pairs of a step
        self.widened = 0
        self._law = LawOfRows(stop, 1, {"k": None, "L": None}, system.comm)
        self._take(frozenset())

    def _take(self, pairs: Pairs) -> None:
        """One array for these pairs."""
        like = half_distance_squared(*self._ports[:2])
        places = [(self._ports[i], self._ports[j]) for i, j in sorted(pairs)]
        at = PointMeasures(
            self._system.numbering,
            self._system.bodies,
            [PointMeasure(places, like.H, like.L, like.c)],
        )
        self.pairs = pairs
        numbers = [self.spheres.stiffness, 2 * self.spheres.radius]
        self._stencil = Stencil(at, self._law, numbers, self._system.rule)
        self._gather = Gather(self._system.numbering, [at.indices])
        self.commit()

    def _within(self, x: Array, reach: float) -> Pairs:
        return frozenset(cKDTree(x).query_pairs(reach))

    def update_active_set(self) -> None:
        v = self._system.state.rates(self._ports)
        reach = 2 * (
            self.spheres.radius
            + self.spheres.foresight * self._system.h * np.linalg.norm(v, axis=1).max()
            # Each sphere may move by h |v|, `foresight` times, and two of them may approach.
        )
        self._take(self._within(self._system.state.vectors(self._ports), reach))
        self.found = max(self.found, len(self.pairs))

    def extend_active_set(self) -> bool:
        touching = self._within(self._system.end.vectors(self._ports), 2 * self.spheres.radius)
        missed = touching - self.pairs
        if missed:
            self._take(self.pairs | missed)
            self.widened += 1
        return bool(missed)

    def inadmissible(self) -> str:
        # Centres nearer than a tenth of the contact distance: the next step would let them pass.
        closest = self._within(self._system.end.vectors(self._ports), 0.2 * self.spheres.radius)
        return f"{len(closest)} spheres passed through each other" if closest else ""

    def commit(self) -> None:
        [q] = self._gather(self._system.q0)
        self._stencil.keep(q)

    def add_forces(self, r: PETSc.Vec) -> None:
        [q] = self._gather(self._system.q1)
        rows = self._stencil.at.indices.ravel()
        r.setValues(rows, self._stencil.force(q).ravel(), addv=PETSc.InsertMode.ADD_VALUES)
        r.assemble()

    def coupling_matrices(self, diagonal: PETSc.Vec | None) -> list[PETSc.Mat]:
        [q] = self._gather(self._system.q1)
        C = self._system.numbering.matrix()
        add_blocks(C, self._stencil.at.indices, self._stencil.at.indices, self._stencil.tangent(q))
        C.assemble()
        return [C]

    def energies(self) -> dict[str, float]:
        return {self.spheres.name: float(self._stencil.energy().sum())}

    def get_history(self) -> dict[str, Any]:
        return {"pairs": sorted(self.pairs)}

    def set_history(self, state: dict[str, Any]) -> None:
        self._take(frozenset((i, j) for i, j in state["pairs"]))


@dataclass(frozen=True, eq=False)
class CollidingSpheres(Item):
    """Spheres of one radius [m] about points, pushed apart by k (2r - l); `foresight` 0 finds pairs
    too late."""

    ports: tuple[Port, ...]
    radius: float
    stiffness: float
    foresight: float = 1.0
    name: str = "collisions"
    compiler: ClassVar[Compiler] = Collisions

    def requires(self) -> Iterable[Any]:
        for port in self.ports:
            yield port.body

    def terms(self, start: State) -> Iterable[Term]:
        yield self
