"""Forces and tangents of the active pairs of one contact in a step from x0 to x1.

The pairs are divided into two tables, since their tangents are assembled in two ways:

    pairs between bodies     their four points are block rows of the system, so that the C kernel
                             adds 3 x 3 blocks between them where they belong
    pairs with an obstacle   points of obstacles are combinations of block rows; tangents are
                             computed pair by pair, and multiplied by the weights of these rows
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from petsc4py import PETSc

from gossamer_fx.mechanics.contact.assembly import BlockAssembly
from gossamer_fx.mechanics.contact.contact_step import (
    PUSH_BACK,
    ContactLaw,
    PairEvaluation,
    PairState,
    evaluate,
    reversed_pairs,
)
from gossamer_fx.mechanics.contact.contract import (
    Array,
    ContactAssembly,
    Int32Array,
    Int64Array,
)
from gossamer_fx.mechanics.contact.geometry.contact_points import ContactPoints
from gossamer_fx.mechanics.contact.pairs import ActivePairs

if TYPE_CHECKING:
    # A scene without friction does not load it.
    from gossamer_fx.mechanics.contact.friction.friction import Friction


class StepForces:
    """Forces and tangents of the active pairs of this rank, with friction.

    Attributes:
        friction: if there is any.
        push_back: stiffness of pairs that passed through, over their own [-].
        point_forces: forces (m, 3) [N] of this rank's pairs at the last residual.
        assembly: of the tangent; it has the blocks off the diagonal.
    """

    def __init__(
        self,
        points: ContactPoints,
        law: ContactLaw,
        system: ContactAssembly,
        friction: Friction | None,
    ) -> None:
        self.friction = friction
        self.push_back = PUSH_BACK
        self._points = points
        self._law = law
        self._system = system
        self.assembly = BlockAssembly(points, system)
        # Weight of the end of a step in the configuration where forces act: 1 in an equilibrium.
        self._alpha = system.rule.alpha
        # Whether the ends of the step were exchanged, in which friction has no part.
        self._is_reversed = False
        # Points (m, 3) at the end of the step at the last residual; None before the first one.
        self._last_end: Array | None = None
        # What evaluates forces and tangents of pairs between bodies, and of pairs with obstacles.
        self._forces: list[PairEvaluation] = []
        self._tangents: list[PairEvaluation] = []
        self.point_forces: Array = np.zeros((0, 3))
        self.clear()

    def clear(self) -> None:
        """Set the forces to zero, with a row for each point that this rank knows."""
        count = self._points.count
        # The array stays if it can: pairs that were prepared add to it.
        if len(self.point_forces) != count:
            self.point_forces = np.zeros((count, 3))
        self.point_forces[:] = 0

    def take_state(self, pairs: ActivePairs, x: Array) -> None:
        """Take the forces of pairs in the state x (m, 3) [m] alone, without friction, in place of
        those of a step that is not known."""
        self.clear()
        evaluate(pairs, x, x, self._law, 1.0, point_forces=self.point_forces)

    def set_pairs(self, pairs: ActivePairs, x0: Array) -> None:
        """Take the active pairs of a step, and choose the sparsity pattern of their tangent;
        collective.  The points `x0` (m, 3) [m] are those at the start of the step.

        Pairs between bodies couple their four points.  Points of obstacles are combinations of
        block rows, vectors of three unknowns, which are coupled instead.
        """
        is_of_bodies = np.asarray((pairs.points < self._points.body_count).all(axis=1))
        self._is_of_bodies = is_of_bodies
        self._body_pairs = pairs.rows(is_of_bodies)
        self._obstacle_pairs = pairs.rows(~is_of_bodies)
        block_rows, self._row_weights = self._points.block_rows_of(self._obstacle_pairs.points)
        # Block rows (n, k) of the pairs with friction, by groups.
        rubbing = [] if self.friction is None else self.friction.begin_step(pairs, x0)
        block_index = self.assembly.couple(self._body_pairs.points, block_rows, *rubbing)
        self._body_blocks: Int32Array = block_index[0]
        self._obstacle_blocks: Int32Array = block_index[1]
        if self.friction is not None:
            self.friction.set_block_index(block_index[2:])
        self._is_reversed = False
        self._prepare()

    def reverse(self, pairs: ActivePairs, x0: Array) -> ActivePairs:
        """Return the pairs of the reversed step, which starts at x0 (m, 3) [m] and whose forces are
        computed from now on.  The sparsity pattern of the tangent stays.  Friction differs in the
        reversed step, and is left out."""
        table = reversed_pairs(pairs, x0)
        start = table.start
        assert start is not None, "reversed pairs have the starts of the reversed step"
        self._body_pairs = replace(self._body_pairs, start=start[self._is_of_bodies])
        self._obstacle_pairs = replace(self._obstacle_pairs, start=start[~self._is_of_bodies])
        self._is_reversed = True
        self._prepare()
        # Pairs that separate fast would count as too steep when they approach as fast.
        self.push_back = 0.0
        return table

    def _prepare(self) -> None:
        """Prepare the evaluation of forces and tangents of both kinds of pairs."""
        count = self._points.count
        if len(self.point_forces) != count:
            self.clear()
        self._last_end = None
        blocks = self.assembly.blocks
        of_bodies: dict[str, Any] = {"block_index": self._body_blocks, "blocks": blocks}
        of_obstacles: dict[str, Any] = {"tangents_by_pair": True}
        self._forces = []
        self._tangents = []
        kinds = ((self._body_pairs, of_bodies), (self._obstacle_pairs, of_obstacles))
        for pairs, wanted in kinds:
            # Most contacts have no obstacles, or touch none of them.
            if not len(pairs):
                continue
            of_pairs = partial(PairEvaluation, pairs, count, self._law, self._alpha)
            forces = of_pairs(point_forces=self.point_forces)
            self._forces.append(forces)
            # Tangents need what each pair does at the last residual, too.
            self._tangents.append(of_pairs(state=forces.state, **wanted))

    def compute(self, x0: Array, x1: Array) -> None:
        """Compute the forces of this rank's pairs, with friction, and note what each pair does.
        `point_forces` (m, 3) [N] then has at each point the sum over the pairs of this rank."""
        # Pairs add to the rows of their points.
        self.clear()
        for forces in self._forces:
            forces(x0, x1, push_back=self.push_back)
        self._last_end = x1
        if self.friction is not None and not self._is_reversed:
            self.friction.add_forces(x0, x1, self.point_forces)

    def add_tangents(self, A: PETSc.Mat, x0: Array, x1: Array) -> None:
        """Add the blocks on the diagonal of the tangent [N/m] to a matrix; `assembly` has the
        others.  Collective."""
        blocks = self.assembly.blocks
        blocks[:] = 0
        # Pairs without contact at the last residual have no tangent either.
        is_known = self._knows_states_at(x1)
        for tangents in self._tangents:
            tangents(
                x0,
                x1,
                push_back=self.push_back,
                geometric_share=self._system.geometric,
                is_known=is_known,
            )
            if tangents.tangents is not None:
                self._add_through_block_rows(tangents.tangents)
        self._last_end = x1
        if self.friction is not None and not self._is_reversed:
            self.friction.add_tangents(x0, x1, blocks)
        self.assembly.add_diagonal(A)

    def _add_through_block_rows(self, tangents: Array) -> None:
        """Add tangents of contact pairs with obstacles to the blocks of the unknowns that move
        their points. A point of an obstacle is a weighted sum of vectors of three unknowns.  The 3
        x 3 blocks [N/m] between these vectors, those of the assembly, are changed in place.
        `tangents`: (n, 144) [N/m], derivative of the 12 force components of each pair by its 12
        point coordinates, row by row."""
        weights = self._row_weights
        by_points = tangents.reshape(-1, 4, 3, 4, 3)
        by_rows = np.einsum("npi,npaqb,nqj->nijab", weights, by_points, weights, optimize=True)
        index = self._obstacle_blocks
        np.add.at(self.assembly.blocks, index, by_rows.reshape(*index.shape, 9))

    def identifiers_of_passed(self, x0: Array, x1: Array) -> Int64Array:
        """Return the identifiers (k,) of contact pairs that passed through each other in a step."""
        # What the last residual found serves, unless the end has moved since.
        is_known = self._knows_states_at(x1)
        passed = [np.zeros(0, dtype=np.int64)]
        for forces in self._forces:
            state = forces.state
            if not is_known:
                state = evaluate(forces.pairs, x0, x1, self._law, self._alpha).state
            passed.append(forces.pairs.identifier[state == PairState.PASSED])
        return np.concatenate(passed)

    def _knows_states_at(self, x1: Array) -> bool:
        """Whether the last residual was computed for a step to x1."""
        return self._last_end is not None and bool((x1 == self._last_end).all())
