"""Constraints between points, kept exactly by multipliers that are unknowns of the sparse matrix.

    e(q1) = 0,    force De(q_mid)ᵀλ,    tangent [ α λ·D²e  De(q_mid)ᵀ ]
                                                [ De(q1)       0      ]

A multiplier whose measure depends on fixed coordinates only is fixed too.

A constraint may close over time: e(q1) = f(t1) e(q_start), with f falling from 1 to 0.  The work
-λ·(e(q1) - e(q0)) of its force counts as supplied.

A constraint may be switched in a run (`LatchState`).  Released, it has the row λ = 0 instead.

Where seams meet, a tie may follow from others: three points that are tied in a circle need two
ties. Such ties are found in the graph whose vertices are coordinates and whose edges are
constraints between two coordinates each; fixed coordinates are one vertex.  A tie that closes a
circle in this graph is left out, if it says that it may be (`may_repeat`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
from dolfinx.common import IndexMap
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.core.algebra.point_measures import (
    Gather,
    PointMeasure,
    PointMeasures,
    add_blocks,
    evaluated_here,
    nodes_of,
    refuse_ports_outside,
)
from gossamer_fx.core.algebra.rotations import cross_matrices
from gossamer_fx.core.checks.errors import InputError, check
from gossamer_fx.core.model.body import Array, Attached, Block
from gossamer_fx.core.model.state import State
from gossamer_fx.mechanics.terms.assembly import (
    Assembly,
    CompiledTerms,
    Compiler,
    Differentiable,
    Frames,
    HistoryVariables,
    Multipliers,
)

# Largest violation at the start, over the size of the constraint: the bound for "these points
# coincide".
MAX_INITIAL_VIOLATION = 1e-8

# Largest rate of violation at the start, over that which the largest velocity of the scene makes.
MAX_INITIAL_RATE = 1e-8

# Number of constraints up to which redundant ones are looked for: the eigenvalue problem is dense,
# on rank 0.  With more of them a redundant constraint shows as a singular matrix.
MAX_CHECKED_CONSTRAINTS = 1500

# Entry of the gradient of a constraint, over its largest one, below which it does not depend on a
# coordinate.
NO_GRADIENT = 1e-12

# Eigenvalue of the normalised Gram matrix of the constraints below which one of them follows from
# others.
NULL_EIGENVALUE = 1e-12

# Component of a null vector from which a constraint takes part in it.
TAKES_PART = 1e-6

# The vertex of all fixed coordinates in the graph of ties.
GROUND = -1


class PointConstraints(Multipliers, Differentiable, CompiledTerms["PointConstraint"]):
    """All `PointConstraint` terms of a scene; those that are alike are one array.

    The multipliers of term k are the k-th block behind those of the bodies.
    """

    has_shape_derivative = True

    @classmethod
    def multipliers(cls, terms: Sequence[PointConstraint], comm: MPI.Intracomm) -> list[Block]:
        blocks = []
        for term in terms:
            own = len(evaluated_here(term.measure.ports))
            measures_of_tuple = term.measure.H.shape[0]
            blocks.append(Block(IndexMap(comm, own), measures_of_tuple))
        return blocks

    def __init__(self, terms: Sequence[PointConstraint], system: Assembly) -> None:
        """Compile all constraints between points, in the same order on all ranks: arrays and
        indices that stay the same in a run.  Collective."""
        tuples = [(term.name, term.measure.ports) for term in terms]
        refuse_ports_outside(system.comm, system.bodies, tuples)
        numbering = system.numbering
        self._system = system
        self._comm = system.comm
        self._terms = terms
        # Terms with equal shapes and numbers of nodes are one array.
        groups: dict[tuple[int, ...], list[int]] = {}
        for k, term in enumerate(terms):
            groups.setdefault((*term.measure.H.shape, nodes_of(term.measure)), []).append(k)
        self._measures: list[PointMeasures] = []
        self._term_of: list[npt.NDArray[np.int64]] = []
        self._local: list[npt.NDArray[np.int64]] = []
        for alike in groups.values():
            at = PointMeasures(numbering, system.bodies, [terms[k].measure for k in alike])
            self._measures.append(at)
            self._term_of.append(np.array(alike)[at.owner])
            # The multipliers of term k are the block behind those of the bodies.
            owned = [numbering.owned(len(system.bodies) + k) for k in alike]
            local = np.concatenate([np.arange(block.start, block.stop) for block in owned])
            self._local.append(local.reshape(at.n, at.m))
        self._rows = [(local + numbering.start).astype(PETSc.IntType) for local in self._local]
        # Unknowns (n, D) of each array at the start of the step; `commit` sets them.
        self._q0: list[Array] = [np.zeros((at.n, at.D)) for at in self._measures]
        self._gather = Gather(numbering, [at.indices for at in self._measures])
        self._closes = any(term.closing for term in terms)
        # Latches by the number of their term.
        self._latches = {k: term.latch for k, term in enumerate(terms) if term.latch}
        self.losses = [terms[k].name for k, latch in self._latches.items() if latch.can_engage]
        self.can_switch = bool(self._latches)
        self._is_free = self._free_equations()
        # e at the start of the scene, and the right-hand side e(q1) = target of the step.
        self._initial: list[Array] = [np.zeros((at.n, at.m)) for at in self._measures]
        self._targets: list[Array] = [np.zeros((at.n, at.m)) for at in self._measures]
        self.owned = slice(numbering.owned(len(system.bodies)).start, numbering.size_local)
        self.sizes = np.ones(self.owned.stop - self.owned.start)

    def tied_ports(self) -> list[list[tuple[Attached, ...]]]:
        """The tuples of ports of each term that this rank evaluates."""
        found = []
        for term in self._terms:
            ports = term.measure.ports
            found.append([ports[i] for i in evaluated_here(ports)])
        return found

    def begin_step(self, t: float) -> None:
        self._take_targets(self._system.time + self._system.h)

    def _take_targets(self, t: float) -> None:
        """Take the right-hand sides of a time t [s], and which equations are free."""
        if self._closes or self._latches:
            self._targets = self._targets_at(t)
            self._is_free = self._free_equations()

    def commit(self) -> None:
        """Take the unknowns at the end of the step as those at the start of the next one."""
        self._q0 = self._gather(self._system.q0)

    def supplied(self) -> float:
        """Work [J] that constraints supply while they close, -λ·(e(q1) - e(q0)): only a seam that
        is drawn together does work.  Called before the step is committed.  Collective."""
        if not self._closes:
            return 0.0
        values = self._system.q1.array_r.copy()
        term_closes = np.array([term.closing is not None for term in self._terms])
        work = 0.0
        # For each array of constraints: its number k, measures `at`, and unknowns q (n, D).
        for k, at, q in self._at_end():
            closes = term_closes[self._term_of[k]]
            change = at.strain(q) - at.strain(self._q0[k])
            work_of_rows = values[self._local[k]] * change
            work -= float(work_of_rows[closes].sum())
        return work

    def _at_end(self) -> Iterator[tuple[int, PointMeasures, Array]]:
        """Number, measures and unknowns (n, D) in q1 of each array of constraints.  Collective."""
        unknowns = self._gather(self._system.q1)
        return zip(range(len(self._measures)), self._measures, unknowns, strict=True)

    def _targets_at(self, t: float) -> list[Array]:
        """Right-hand sides of the constraints e(q) = openness(t) e(q_start) at a time t [s],
        (constraints, equations) for each kind, in the unit of the constraint.  The openness of a
        seam that is drawn together falls from 1 to 0; that of all other constraints is 0."""
        openness = np.zeros(len(self._terms))
        for k, term in enumerate(self._terms):
            if term.closing:
                openness[k] = term.closing(t)
        targets: list[Array] = []
        for term_of, initial in zip(self._term_of, self._initial, strict=True):
            targets.append(openness[term_of][:, None] * initial)
        for k, latch in self._latches.items():
            for i, rows in self._rows_of(k):
                targets[i][rows] = latch.values
        return targets

    def _rows_of(self, term: int) -> Iterator[tuple[int, npt.NDArray[np.bool_]]]:
        """The number of the array that has a term, and which of its rows are those of the term;
        nothing on ranks that do not evaluate it."""
        for i, term_of in enumerate(self._term_of):
            rows = term_of == term
            if rows.any():
                yield i, rows

    def _free_equations(self) -> list[npt.NDArray[np.bool_]]:
        """Whether each equation is that of a released latch, as the present histories say."""
        found: list[npt.NDArray[np.bool_]] = [
            np.zeros((at.n, at.m), dtype=bool) for at in self._measures
        ]
        for k, latch in self._latches.items():
            for i, rows in self._rows_of(k):
                found[i][rows] = ~latch.is_held
        return found

    def _take_initial(self, q0: PETSc.Vec) -> None:
        """Store e(q0) of the constraints that close, from which they begin.  Collective."""
        if self._closes:
            closes = np.array([term.closing is not None for term in self._terms])
            groups = zip(self._term_of, self._measures, self._gather(q0), strict=True)
            self._initial = [closes[k][:, None] * at.strain(q) for k, at, q in groups]

    def add_forces(self, r: PETSc.Vec) -> None:
        """Add De(q_mid)ᵀ λ to r, and in the rows of the multipliers e(q1) less its target, or λ
        itself where a latch is released."""
        values = self._system.q1.array_r.copy()
        for k, at, q in self._at_end():
            force = values[self._local[k]][:, None] @ self._middle_gradient(k, q)
            r.setValues(at.indices.ravel(), force.ravel(), addv=PETSc.InsertMode.ADD_VALUES)
            excess = at.strain(q) - self._targets[k]
            excess = np.where(self._is_free[k], values[self._local[k]], excess)
            r.setValues(self._rows[k].ravel(), excess.ravel(), addv=PETSc.InsertMode.ADD_VALUES)
        r.assemble()

    def add_tangents(self, A: PETSc.Mat) -> None:
        """With constraints e(q) = 0, multipliers λ and forces De(q_mid)ᵀ λ at q_mid = (1 - α) q0 +
        α q1 the blocks are α λ·D²e [N/m], De(q_mid)ᵀ, and De(q1) in the rows of the multipliers."""
        values = self._system.q1.array_r.copy()
        for k, at, q in self._at_end():
            λ = values[self._local[k]]
            rows = self._rows[k]
            if not at.is_linear:
                stiffness = self._system.rule.alpha * at.stiffness(at.geometric(λ))
                add_blocks(A, at.indices, at.indices, stiffness)
            force_gradient = self._middle_gradient(k, q).transpose(0, 2, 1)
            add_blocks(A, at.indices, rows, force_gradient)
            is_free = self._is_free[k]
            add_blocks(A, rows, at.indices, np.where(is_free[:, :, None], 0.0, at.gradient(q)))
            # A factorisation needs the diagonal in the sparsity pattern, though its entries are
            # zero but for those of free equations.
            add_blocks(A, rows, rows, is_free[:, :, None] * np.eye(at.m))

    def linear_equations(self) -> list[tuple[int, dict[int, float]]]:
        # Those of latches do not always hold, and are left out.
        equations = []
        for k, at in enumerate(self._measures):
            # The gradient of linear measures is the same in every state.
            gradient = at.gradient(np.zeros((at.n, at.D)))
            for i in np.flatnonzero(at.each_is_linear):
                if int(self._term_of[k][i]) in self._latches:
                    continue
                for multiplier, slope in zip(self._rows[k][i].tolist(), gradient[i], strict=True):
                    coefficients: dict[int, float] = {}
                    for d in np.flatnonzero(slope):
                        unknown = int(at.indices[i, d])
                        coefficients[unknown] = coefficients.get(unknown, 0.0) + float(slope[d])
                    equations.append((multiplier, coefficients))
        return equations

    def frames(self) -> list[Frames]:
        found = []
        for at, terms, rows in zip(self._measures, self._term_of, self._rows, strict=True):
            is_frame = np.array([self._terms[k].keeps_orthonormal for k in terms], dtype=bool)
            if is_frame.any():
                products = self._terms[terms[is_frame.argmax()]].measure.H
                found.append(Frames(at.indices[is_frame], rows[is_frame], products))
        return found

    def _middle_gradient(self, k: int, q: Array) -> Array:
        """De(q_mid) (n, m, D) of array k at unknowns q (n, D) at the end of the step."""
        at = self._measures[k]
        if at.is_linear:
            return at.gradient(q)
        α = self._system.rule.alpha
        return at.gradient((1 - α) * self._q0[k] + α * q)

    def add_curvature(self, v: PETSc.Vec, r: PETSc.Vec) -> None:
        """Add D²e[v, v] of rates v in the rows of the multipliers; free equations have none."""
        for k, (at, rates) in enumerate(zip(self._measures, self._gather(v), strict=True)):
            second = np.where(self._is_free[k], 0.0, at.second(rates))
            r.setValues(self._rows[k].ravel(), second.ravel(), addv=PETSc.InsertMode.ADD_VALUES)
        r.assemble()

    def violation(self, q: PETSc.Vec) -> float:
        """Largest violation of a constraint in a state, in its own units; the same on every
        rank."""
        targets = self._targets_at(self._system.time)
        free = self._free_equations()
        worst = []
        for k, (at, x) in enumerate(zip(self._measures, self._gather(q), strict=True)):
            violations = np.where(free[k], 0.0, np.abs(at.strain(x) - targets[k]))
            worst.append(float(violations.max(initial=0.0)))
        return float(self._comm.allreduce(max(worst), op=MPI.MAX))

    # ---- latches ---------------------------------------------------------------------------------

    def without_gradient(self) -> str:
        if not self._latches:
            return ""
        first = self._terms[min(self._latches)]
        return (
            f"'{first.name}' has no gradient, as an impact or a release within a run is not "
            "differentiated; leave it out of the scene"
        )

    def dissipated(self) -> Array:
        # Steps lose nothing: the losses of impacts are added where velocities are projected.
        return np.zeros(len(self.losses))

    def switch(self) -> Iterator[str]:
        """Engage or release each latch of which that is wanted; yields the names of the engaged
        ones.  Multipliers of released ones become zero.  Collective."""
        for k, latch in self._latches.items():
            if latch.is_wanted == latch.is_engaged:
                continue
            if latch.is_wanted:
                self._engage(latch)
                yield self._terms[k].name
            else:
                latch.release()
                with self._system.q0 as values:
                    for i, rows in self._rows_of(k):
                        values[self._local[i][rows]] = 0.0
                self._take_targets(self._system.time)

    def _engage(self, latch: LatchState) -> None:
        """Engage a latch, unless what it holds is held already: `InputError`.  Collective."""
        latch.engage(self._system.state)
        self._take_targets(self._system.time)
        free = self._system.free_marks()
        try:
            self._refuse_redundant(self._system.q0, free)
        except InputError:
            latch.release()
            latch.is_wanted = False
            self._take_targets(self._system.time)
            raise
        finally:
            free.destroy()

    # ---- before the first step -------------------------------------------------------------------

    def idle(self, free: PETSc.Vec, q0: PETSc.Vec) -> npt.NDArray[np.int64]:
        """Multipliers of constraints between fixed coordinates, and those that repeat others.

        `validate` must have been called before: it measures where seams begin.  `InputError`: a
        seam cannot close, since nodes on both of its sides are fixed.  Collective.
        """
        found: list[npt.NDArray[np.int64]] = [np.zeros(0, dtype=np.int64)]
        stuck = 0
        # For each array: its number k, measures `at`, unknowns q (n, D), and `free` at these.
        for k, at, q, mask in self._at_start(free, q0):
            gradient = np.abs(at.gradient(q))
            largest = gradient.max(axis=2, initial=0.0)
            of_free = (gradient * mask[:, None, :]).max(axis=2, initial=0.0)
            is_idle = of_free <= NO_GRADIENT * largest
            found.append(self._local[k][is_idle])
            sizes = self.sizes[self._local[k] - self.owned.start]
            # Zero but for constraints that close in time.
            is_open = np.abs(self._initial[k]) > MAX_INITIAL_VIOLATION * sizes
            stuck += int((is_idle & is_open).sum())
        check(
            self._comm.allreduce(stuck) == 0,
            "A seam cannot close: nodes on both of its sides are fixed; "
            "free one side, or move its support.",
        )
        return np.union1d(np.concatenate(found), self._repeated(free, q0))

    def _at_start(
        self, free: PETSc.Vec, q0: PETSc.Vec
    ) -> Iterator[tuple[int, PointMeasures, Array, Array]]:
        """Number, measures, unknowns (n, D) and `free` (n, D) of each array at q0.  Collective."""
        unknowns = self._gather(q0)
        masks = self._gather(free)
        return zip(range(len(self._measures)), self._measures, unknowns, masks, strict=True)

    def _repeated(self, free: PETSc.Vec, q0: PETSc.Vec) -> npt.NDArray[np.int64]:
        """Sorted multipliers of ties that follow from others, such as the third of three points
        tied in a circle, if they allow it (`may_repeat`).  Collective."""
        none = np.zeros(0, dtype=np.int64)
        if not any(term.may_repeat for term in self._terms):
            return none
        # Of each tie: whether it may be left out, term, two coordinates, rank and position.
        mine: list[tuple[bool, int, int, int, int, int]] = []
        rank = self._comm.rank
        # For each array: its number k, measures `at`, unknowns q (n, D), and `free` at these.
        for k, at, q, mask in self._at_start(free, q0):
            # G (n, m, D) is the gradient of the constraints.
            G = at.gradient(q)
            # A tie is a constraint between two coordinates.
            for i, j in np.argwhere((np.abs(G) > NO_GRADIENT).sum(axis=2) == 2):
                columns = np.flatnonzero(np.abs(G[i, j]) > NO_GRADIENT)
                ends = [int(at.indices[i, c]) if mask[i, c] else GROUND for c in columns]
                number = int(self._term_of[k][i])
                may_repeat = self._terms[number].may_repeat
                position = int(self._local[k][i, j])
                mine.append((may_repeat, number, min(ends), max(ends), rank, position))
        gathered = self._comm.allgather(mine)
        # Ties that must stay come first, so that only others close circles.
        ties = sorted(tie for of_rank in gathered for tie in of_rank)
        # Imported here: few scenes have ties that repeat others.
        from scipy.cluster.hierarchy import DisjointSet

        connected = DisjointSet(vertex for _, _, a, b, _, _ in ties for vertex in (a, b))
        found = []
        for may_repeat, _, a, b, of_rank, position in ties:
            closes_circle = not connected.merge(a, b)
            if closes_circle and may_repeat and of_rank == rank:
                found.append(position)
        return np.array(found, dtype=np.int64)

    def validate(self, q0: PETSc.Vec, v0: PETSc.Vec, free: PETSc.Vec) -> None:
        """Check the constraints, store the values of those that close in time, from which they
        begin, and measure their sizes.  Scenes with more than `MAX_CHECKED_CONSTRAINTS` constraints
        are not searched for dependent ones.  Collective."""
        self._take_initial(q0)
        self._take_targets(0.0)
        # Violations and rates of each term that are above their bounds.
        violations = np.zeros(len(self._terms))
        rates = np.zeros(len(self._terms))
        extents, speeds = self._largest_unknowns()
        groups = zip(self._term_of, self._measures, self._gather(q0), self._gather(v0), strict=True)
        # For each array: the term of each row, measures `at`, unknowns q and rates v (n, D); De (n,
        # m, D) is the gradient of the constraints.
        for k, (term_of, at, q, v) in enumerate(groups):
            De = at.gradient(q)
            # A constraint without a gradient depends on nothing, and keeps the size 1.
            size = np.abs(De * extents[k][:, None, :]).max(axis=2, initial=0.0)
            size[size == 0] = 1.0
            self.sizes[self._local[k] - self.owned.start] = size
            violation = np.abs(at.strain(q) - self._targets[k])
            violation[violation <= MAX_INITIAL_VIOLATION * size] = 0.0
            violation[self._is_free[k]] = 0.0
            np.maximum.at(violations, term_of, violation.max(axis=1, initial=0.0))
            largest_rate = np.abs(De * speeds[k][:, None, :]).max(axis=2, initial=0.0)
            rate = np.abs(np.einsum("nmx,nx->nm", De, v))
            rate[rate <= MAX_INITIAL_RATE * largest_rate] = 0.0
            rate[self._is_free[k]] = 0.0
            np.maximum.at(rates, term_of, rate.max(axis=1, initial=0.0))
        self._comm.Allreduce(MPI.IN_PLACE, violations, op=MPI.MAX)
        self._comm.Allreduce(MPI.IN_PLACE, rates, op=MPI.MAX)
        for term, gap, gap_rate in zip(self._terms, violations, rates, strict=True):
            check(
                gap == 0,
                f"'{term.name}' does not hold at the start: it is off by {gap:.3g}; "
                "let the joined points coincide.",
            )
            check(
                gap_rate == 0,
                f"'{term.name}' does not hold in rate at the start: "
                f"the joined points separate with {gap_rate:.3g} per second; "
                "give both bodies the same velocity there.",
            )
        self._refuse_redundant(q0, free)

    def _largest_unknowns(self) -> tuple[list[Array], list[Array]]:
        """Sizes (n, D) of the unknowns of each array, and of their rates: the extent [m] of the
        scene and its largest velocity [m/s] for positions, 1 and the largest rate [1/s] for
        directors.  Collective."""
        start = self._system.initial
        largest = np.zeros(2)
        for one in start:
            rates = np.abs(one.rates())
            largest[0] = max(largest[0], rates[:, 0].max(initial=0.0))
            largest[1] = max(largest[1], rates[:, 1:].max(initial=0.0))
        self._comm.Allreduce(MPI.IN_PLACE, largest, op=MPI.MAX)
        # Directors' rates below the round-off of velocities mean nothing.
        round_off = np.finfo(float).eps * largest[0] / start.extent()
        largest[1] = max(largest[1], round_off / MAX_INITIAL_RATE)
        sizes = []
        for of_position, of_director in ((start.extent(), 1.0), largest):
            vector = self._system.numbering.vector()
            for body in self._system.bodies:
                vectors = vector.array[self._system.block(body).owned]
                of_nodes = vectors.reshape(-1, body.block.size // 3, 3)
                of_nodes[:, 0] = of_position
                of_nodes[:, 1:] = of_director
            sizes.append(self._gather(vector))
        extents, speeds = sizes
        return extents, speeds

    def _refuse_redundant(self, q0: PETSc.Vec, free: PETSc.Vec) -> None:
        """Raise `InputError` if gradients of constraints are not independent.  Collective; rank 0
        computes.  Scenes with more than `MAX_CHECKED_CONSTRAINTS` are not checked."""
        n = self._comm.allreduce(sum(at.n * at.m for at in self._measures))
        if n > MAX_CHECKED_CONSTRAINTS:
            return
        repeated = self._repeated(free, q0)
        extents, _ = self._largest_unknowns()
        mine: list[tuple[int, Array, Array]] = []
        for k, at, q, mask in self._at_start(free, q0):
            # Gradient (n, m, D) of the constraints by free unknowns, each over its size, so that
            # the unit of length does not matter where positions and directors meet.
            De = at.gradient(q) * (mask * extents[k])[:, None, :]
            for i in range(at.n):
                for j in range(at.m):
                    is_repeated = self._local[k][i, j] in repeated
                    is_kept = not (is_repeated or self._is_free[k][i, j])
                    if np.any(De[i, j]) and is_kept:
                        mine.append((int(self._term_of[k][i]), at.indices[i], De[i, j]))
        message = ""
        gathered = self._comm.gather(mine)
        if gathered is not None:
            rows: list[tuple[int, Array, Array]] = []
            for rows_of_rank in gathered:
                rows += rows_of_rank
            message = self._redundancy(rows)
        message = self._comm.bcast(message)
        check(not message, message)

    def _redundancy(self, rows: list[tuple[int, Array, Array]]) -> str:
        """A sentence that names the constraints that depend on each other, or an empty one: those
        in null vectors of the Gram matrix of the gradients, scaled to unit length.  `rows` has for
        each equation the index of its term, and the global indices (D,) and values (D,) of its
        gradient."""
        if not rows:
            return ""
        columns = np.unique(np.concatenate([indices for _, indices, _ in rows]))
        # The gradients as a dense matrix, one row for each equation.
        G = np.zeros((len(rows), len(columns)))
        for i, (_, indices, values) in enumerate(rows):
            np.add.at(G[i], np.searchsorted(columns, indices), values)
        # Rows of unit length, so that the eigenvalues do not depend on the units of the
        # constraints.
        length = np.linalg.norm(G, axis=1)
        G /= np.where(length > 0, length, 1.0)[:, None]
        eigenvalues, vectors = np.linalg.eigh(G @ G.T)
        null = vectors[:, eigenvalues < NULL_EIGENVALUE]
        if not null.size:
            return ""
        takes_part = np.abs(null).max(axis=1) > TAKES_PART
        involved = {self._terms[rows[i][0]].name for i in np.flatnonzero(takes_part)}
        names = ", ".join(f"'{name}'" for name in sorted(involved))
        return (
            f"{null.shape[1]} of the constraints {names} follow from the others; "
            "free one of the joints, e.g. by a ball joint instead of a revolute one."
        )


class LatchState(HistoryVariables):
    """The history variables of a constraint that is switched: which of its m measures it holds, and
    at which values.

    All ranks have the same values.  A latch has one measure, the travel of a rail, or two, cosine
    and sine of the angle of a hinge; it holds the one nearest to zero, which changes fastest with
    the angle.  A joint that can only be released, `holds_all`, holds all measures at zero from the
    start until then.

    Attributes:
        can_engage: whether it may be engaged in a run, which takes energy.
        is_wanted: whether it shall be engaged; `switch` of the system follows.
        is_held: (m,) which measure is held, none while it is released.
        values: (m,) the measures when it was engaged last.
    """

    def __init__(self, measure: PointMeasure, *, holds_all: bool = False) -> None:
        self._measure = measure
        self.can_engage = not holds_all
        self.is_wanted = holds_all
        self.is_held: npt.NDArray[np.bool_] = np.full(len(measure.c), holds_all)
        self.values: Array = np.zeros(len(measure.c))

    @property
    def is_engaged(self) -> bool:
        return bool(self.is_held.any())

    def engage(self, state: State) -> None:
        """Hold the measure where it is in a state.  Collective."""
        self.values = self._measure.at(state.vectors(self._measure.ports[0]).ravel())
        self.is_held[np.abs(self.values).argmin()] = True
        self.is_wanted = True

    def release(self) -> None:
        """Hold no measure from now on; `is_wanted` is not changed."""
        self.is_held[:] = False

    def get_history(self) -> dict[str, Any]:
        return {
            "wanted": self.is_wanted,
            "held": self.is_held.tolist(),
            "values": self.values.tolist(),
        }

    def shape_history(self) -> dict[str, Any]:
        return self.get_history()

    def set_history(self, state: dict[str, Any]) -> None:
        self.is_wanted = state["wanted"]
        self.is_held = np.array(state["held"])
        self.values = np.array(state["values"])


@dataclass(frozen=True, eq=False)
class PointConstraint:
    """Measures that stay zero, by multipliers λ: e(q1) = 0 at the end of a step, force De(q_mid)ᵀλ
    in it.

    The force does no work: De(q_mid)(q1 - q0) = e(q1) - e(q0) = 0.  It conserves momentum and
    angular momentum if e is invariant to translations and rotations.

    Attributes:
        name: in messages and output.
        measure: e(q).
        closing: f of the time [s] by which e goes to zero, e(q1) = f(t1) e(q_start), 1 at the start
            of the scene and without a rate there; None: e is zero from the start.
        may_repeat: whether a tie of two nodes that follows from others is left out, instead of
            refused.
        latch: whether it holds at present, of one that is switched; None: it always holds.
        keeps_orthonormal: whether all that it does is to keep two or three directors orthonormal.
    """

    name: str
    measure: PointMeasure
    closing: Callable[[float], float] | None = None
    may_repeat: bool = False
    latch: LatchState | None = None
    keeps_orthonormal: bool = False
    compiler: ClassVar[Compiler] = PointConstraints


def multipliers_of(constraint: PointConstraint, system: Assembly) -> Array:
    """λ (n, m) of a constraint in the accepted state, one row for each tuple of ports that this
    rank evaluates; a measure in [m] has the force [N] along it."""
    rows = multiplier_rows(constraint, system) - system.numbering.start
    return np.asarray(system.q0.array_r[rows])


def multiplier_rows(constraint: PointConstraint, system: Assembly) -> npt.NDArray[np.int32]:
    """Global indices (n, m) of the multipliers of a constraint, one row for each tuple of ports
    that this rank evaluates."""
    terms = [term for term in system.terms if isinstance(term, PointConstraint)]
    # Multipliers are numbered behind the bodies, in the order of the constraints.
    k = next(i for i, term in enumerate(terms) if term is constraint)
    owned = system.numbering.owned(len(system.bodies) + k)
    indices = np.arange(owned.start, owned.stop) + system.numbering.start
    return indices.reshape(-1, constraint.measure.H.shape[0]).astype(PETSc.IntType)


def multipliers_in_space(system: Assembly) -> npt.NDArray[np.int64]:
    """Positions (k, 3) in this rank's part of a vector of those multipliers that are the three
    components of a force or moment in space, which turns with the bodies: x_a - x_b = 0 has such
    ones, a product of two directors has not."""
    terms = [term for term in system.terms if isinstance(term, PointConstraint)]
    found: list[npt.NDArray[np.int64]] = [np.zeros((0, 3), dtype=np.int64)]
    for k, term in enumerate(terms):
        owned = system.numbering.owned(len(system.bodies) + k)
        owned_numbers = np.arange(owned.start, owned.stop, dtype=np.int64)
        multipliers = owned_numbers.reshape(-1, len(term.measure.L))
        for first in range(0, len(term.measure.L) - 2, 3):
            if _is_vector(term.measure, slice(first, first + 3)):
                found.append(multipliers[:, first : first + 3])
    return np.concatenate(found)


def _is_vector(measure: PointMeasure, rows: slice) -> bool:
    """Whether three measures are the components of a vector that turns with the stacked vectors X:
    e(X + δX) = e + ω × e for δX = ω × X of every angular velocity ω."""
    H = measure.H[rows]
    L = measure.L[rows]
    for turn in cross_matrices(np.eye(3)):
        turn_all = np.kron(np.eye(L.shape[1] // 3), turn)
        change_of_L = L @ turn_all
        change_of_H = turn_all.T @ H + H @ turn_all
        turned_H = np.einsum("ij,jab->iab", turn, H)
        if not (np.allclose(change_of_L, turn @ L) and np.allclose(change_of_H, turned_H)):
            return False
    return True
