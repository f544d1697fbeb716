"""The unknowns of a compiled scene: their numbering, the vectors of a step, and the supports.

Terms are compiled for these unknowns, of which they see the contract `terms.assembly.Assembly`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Never

import numpy as np
from petsc4py import PETSc

from gossamer_fx.core.algebra.numbering import NumberedBlock, Numbering
from gossamer_fx.core.model.body import Array, Body, MeshBody
from gossamer_fx.core.model.state import InitialState, State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.terms.assembly import (
    Assembly,
    CompiledTerms,
    Compiler,
    ItemTerms,
    Multipliers,
)
from gossamer_fx.mechanics.terms.coordinates import Coordinates
from gossamer_fx.mechanics.terms.discrete_gradient import StressRule
from gossamer_fx.mechanics.terms.supports import Support, Supports
from gossamer_fx.solve.system.increment import Increment


class Unknowns(Assembly):
    """The coordinates of all bodies in one vector, and behind them Lagrange multipliers, which have
    no mass and no rate.  Scalar unknowns, such as gas pressures, are not among them.

    Args:
        start: the initial state, with initial conditions applied.
        items_with_terms: those of the scene.
        rule: the stress rule.

    Attributes:
        bodies: the bodies of the scene, in the order of their unknowns.
        items_with_terms: as given.
        terms: all terms of the scene.
        kinds: the terms by the class that compiles them, but for supports.
        initial: the state in which the scene starts.
        numbering: global indices of all unknowns, which makes vectors and matrices.
        q0, v0: coordinates [m] and velocities [m/s] of the accepted state: distributed vectors of
            all unknowns, without ghosts.
        q1: coordinates at the end of the step, as iterated.
        previous: coordinates at the start of the last accepted step.
        state: the accepted state.
        end: that at the end of the step, as iterated; its velocities are those of the start.
        coordinates: of bodies on meshes, as functions for forms.
        position_marks: 1 for each position and 0 for each director among the vectors of this rank's
            nodes, (n,).
        supports: fixed and prescribed coordinates.
        increment: p, w and the inertia of the step.
        compiled: the compiled kinds of terms, once all are.
        M: mass matrix [kg], once the matrices of the scene are made.
        time: of the accepted state [s].
        previous_time: at the start of the last accepted step [s].
        h: length of the step [s].
        geometric: share of the geometric stiffness in tangents, 0 or 1.
    """

    M: PETSc.Mat

    def __init__(
        self, start: InitialState, items_with_terms: Sequence[ItemTerms], rule: StressRule
    ) -> None:
        self.comm = start.comm
        self.initial = start
        self.rule = rule
        self.bodies: list[Body] = [one.body for one in start]
        self.items_with_terms = items_with_terms
        self.terms: list[Term] = [term for each in items_with_terms for term in each.terms]
        self.time = 0.0
        self.previous_time = 0.0
        self.h = 1.0
        self.geometric = 1.0
        # All terms of a kind are compiled together, so that their arrays and forms are shared.
        kinds: dict[Compiler, list[Term]] = {}
        for term in self.terms:
            kinds.setdefault(term.compiler, []).append(term)
        supports = [term for term in kinds.pop(Supports, []) if isinstance(term, Support)]
        self.kinds = kinds
        # Before any kind is compiled, since a kind needs the numbering.  A block is the unknowns of
        # one body, or the Lagrange multipliers of one constraint.
        multipliers = [
            block
            for kind, alike in kinds.items()
            if issubclass(kind, Multipliers)
            for block in kind.multipliers(alike, self.comm)
        ]
        blocks = [body.block for body in self.bodies]
        self.numbering = numbering = Numbering(self.comm, blocks, multipliers)
        self._block_of = {body: NumberedBlock(numbering, k) for k, body in enumerate(self.bodies)}
        self.q0 = numbering.vector()
        self.q1 = numbering.vector()
        self.v0 = numbering.vector()
        self.previous = numbering.vector()
        self._scratch = numbering.vector()
        self.state = State(self.bodies, self.comm, self.q0, self.v0)
        self.end = State(self.bodies, self.comm, self.q1, self.v0)
        self.coordinates: dict[Body, Coordinates] = {
            body: body.coordinates(rule.alpha) for body in self.bodies if isinstance(body, MeshBody)
        }
        self.position_marks = self._mark_positions()
        self.compiled: list[CompiledTerms[Never]] = []
        self.supports = Supports(supports, self)
        self.increment = Increment(numbering, self.supports)

    def _mark_positions(self) -> Array:
        """`position_marks` of this rank."""
        marks = []
        for body in self.bodies:
            of_node = np.zeros(body.block.size // 3)
            of_node[0] = 1.0
            marks.append(np.tile(of_node, body.block.index_map.size_local))
        return np.concatenate([np.zeros(0), *marks])

    # ---- look-ups --------------------------------------------------------------------------------

    @property
    def items(self) -> list[object]:
        """The items of the scene that bring terms."""
        return [each.item for each in self.items_with_terms]

    def terms_of(self, item: object) -> Sequence[Term]:
        """The terms that an item of the scene has brought; none if it is not in the scene."""
        return next((each.terms for each in self.items_with_terms if each.item is item), ())

    def block(self, body: Body) -> NumberedBlock:
        """The unknowns of a body in the numbering."""
        return self._block_of[body]

    def free_marks(self) -> PETSc.Vec:
        """A new vector with 0 at coordinates that are held, else 1."""
        free = self.numbering.vector()
        free.set(1.0)
        free.array[self.supports.held] = 0
        return free

    # ---- a step ----------------------------------------------------------------------------------

    def move_to(self, q: PETSc.Vec) -> None:
        """Set q1 = q [m], also in the functions of bodies on meshes.  Collective."""
        q.copy(self.q1)
        self._spread(self.q1, "q1")

    def move_by(self, w: PETSc.Vec, base: PETSc.Vec | None) -> None:
        """Set q1 = q0 + p + w [m], and the update w - `base` [m] of bodies on meshes, from which
        their strains follow linearly; not without `base`.  Collective."""
        self.increment.end(w, self.q0, self.q1)
        self._spread(self.q1, "q1")
        if base is not None:
            self._scratch.waxpy(-1.0, base, w)
            self._spread(self._scratch, "δ")

    def _spread(self, z: PETSc.Vec, name: str) -> None:
        """Copy a vector to the function `name`, "q1" or "δ", of the coordinates of each body on a
        mesh, ghosts included."""
        values = z.array_r
        for body, at in self.coordinates.items():
            at.take(getattr(at, name), values[self._block_of[body].owned])

    def middle(self) -> PETSc.Vec:
        """q_mid = (1 - α) q0 + α q1 [m], where α is the weight of the end of the step, in a vector
        that the next call of any method may overwrite."""
        α = self.rule.alpha
        self._scratch.waxpy((1 - α) / α, self.q0, self.q1)
        self._scratch.scale(α)
        return self._scratch

    def begin_next(self) -> None:
        """Make q1 the start of the next step of bodies on meshes."""
        for at in self.coordinates.values():
            at.q0.x.array[:] = at.q1.x.array

    def accept(self, v1: PETSc.Vec) -> None:
        """Make the end of the step, with the velocities v1 [m/s], the accepted state, and its time
        the present one.  Collective."""
        # Before q0 changes: the remainder of the sum q0 + p + w is needed.
        self.increment.commit(self.q0, self.q1)
        self.q0.copy(self.previous)
        self.q1.copy(self.q0)
        v1.copy(self.v0)
        self.previous_time = self.time
        self.time += self.h

    def body_sums(self, values: Array) -> list[float]:
        """Sums of values (n,) over the unknowns of each body that this rank has."""
        return [values[self.block(body).owned].sum() for body in self.bodies]

    def locate(self, r: PETSc.Vec) -> str:
        """Where the forces of a residual are largest, in words, e.g. "'film' at the node (0, 0, 1)
        m of the mesh".  Collective, the same on every rank."""
        values = abs(r.array_r[: 3 * len(self.position_marks)])  # without multipliers
        i = int(values.argmax()) if values.size else -1
        largest = float(values[i]) if i >= 0 else -1.0
        words = ""
        for body in self.bodies:
            owned = self.block(body).owned
            if owned.start <= i < owned.stop:
                words = f"'{body.name}' {body.describe((i - owned.start) // body.block.size)}"
        # The rank with the largest entry names it, the others receive the words.
        _, rank = max(self.comm.allgather((largest, self.comm.rank)))
        return str(self.comm.bcast(words, root=rank))
