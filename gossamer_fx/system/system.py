"""A compiled scene: numbering, sparsity, residual and tangent.  It knows roles and rules, no kind of term by name."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc
from scipy.linalg import block_diag

from gossamer_fx.algebra.numbering import Numbering
from gossamer_fx.model.scalar_unknowns import InitialCondition, ScalarUnknowns
from gossamer_fx.model.terms import (
    Array,
    Body,
    CompiledConstraints,
    CompiledTerms,
    Term,
    is_on_mesh,
)
from gossamer_fx.system.increment import Increment
from gossamer_fx.system.tangent import Tangent
from gossamer_fx.system.totals import Totals
from gossamer_fx.terms.discrete_gradient import StressRule
from gossamer_fx.terms.supports import Supports

_NEXT, _LAST = [1, 2, 0], [2, 0, 1]


class System:
    """State and equations of a scene for one stress rule.

    The unknowns of a step are the end coordinates q1 of all bodies, in one vector, and the border scalars y.  The
    residual is

        r = c M (w + o) + Σ stored and dissipated forces - Σ loads + border forces,    q1 = q0 + p + w

    where the stepper predicts the increment p (`predict`) and chooses c and o (`inertia`): the midpoint rule has
    p = h v0, c = 2/h², o = 0.  What is solved for is w, see `Increment`.  Multipliers stand behind the coordinates in
    the same vector; they have no mass and no rate, and their rows of r are the constraints.
    """

    def __init__(
        self, bodies: list[Body], terms: Iterable[Term], rule: StressRule, comm: MPI.Intracomm
    ) -> None:
        self.comm, self.bodies, self.rule = comm, bodies, rule
        self.borders: list[ScalarUnknowns] = []
        self.starts: Sequence[
            Array
        ] = ()  # owned coordinates at the start, if initial conditions place bodies
        self.time, self.h, self.geometric, self.supplied_energy = 0.0, 1.0, 1.0, 0.0
        self.terms = list(terms)
        kinds: dict[type[CompiledTerms], list[Any]] = {}
        for term in self.terms:
            kinds.setdefault(term.compiler, []).append(term)
        multipliers = [
            block for kind, alike in kinds.items() for block in kind.multipliers(alike, comm)
        ]
        self.numbering = numbering = Numbering(comm, [b.block for b in bodies] + multipliers)
        self.q0, self.q1, self.v0, self.past, self._scratch, self._momenta = (
            numbering.vector() for _ in range(6)
        )
        vectors = [
            np.tile(np.eye(1, b.block.size // 3)[0], b.block.index_map.size_local) for b in bodies
        ]
        self._is_position = np.concatenate(
            [np.zeros(0), *vectors]
        )  # of each vector of this rank's nodes
        self.fields = {k: b.coordinates(rule.alpha) for k, b in enumerate(bodies) if is_on_mesh(b)}
        self.supports = Supports(kinds.pop(Supports, []), self)
        self.increment = Increment(numbering, self.supports)
        self.compiled = [kind(alike, self) for kind, alike in kinds.items()]
        self.constraints = next(
            (c for c in self.compiled if isinstance(c, CompiledConstraints)), None
        )
        self.searching = [c for c in self.compiled if c.searches]
        self.losses = {name: 0.0 for c in self.compiled for name in c.losses}
        self._has_stiffness = any(
            type(c).add_stiffness is not CompiledTerms.add_stiffness for c in self.compiled
        )

    def start(self, conditions: Iterable[InitialCondition] = ()) -> None:
        """Take the initial state and set up the matrices; after the borders are attached."""
        for k, body in enumerate(self.bodies):
            self.q0.array[self.numbering.owned(k)], self.v0.array[self.numbering.owned(k)] = (
                body.initial_state()
            )
        for condition in conditions:
            condition.initialise(self, self.q0, self.v0)
        self.v0.array[self.supports.at_rest] = 0
        if self.constraints:
            free = self.numbering.vector()
            free.set(1.0)
            free.array[self.supports.held] = 0
            self.constraints.validate(self.q0, self.v0, free)
            self.supports.hold(self.constraints.idle(free, self.q0))
        self.q0.copy(self.past)
        self.resume()
        for border in self.borders:
            border.start()
        self._build_matrices()

    def resume(self) -> None:
        """Take up what follows from q0, and from `past`, where the step before it began, which were set."""
        for q in (self.past, self.q0):
            self.take(q)
            self._keep()

    def _build_matrices(self) -> None:
        """Mass matrix M, constant stiffness K if there is one, and tangent A, with one sparsity pattern.

        They are duplicates: PETSc 3.22 multiplies those by BLAS, in half of the time of its kernel for blocks of three.
        """
        pattern = self.numbering.matrix()
        for compiled in self.compiled:
            compiled.add_mass(pattern)
            compiled.add_stiffness(pattern)
        self._add_tangents(pattern)
        pattern.setDiagonal(
            self.numbering.vector(), addv=PETSc.InsertMode.ADD_VALUES
        )  # all that held rows keep
        pattern.assemble()
        self.M, self.A = pattern.duplicate(), pattern.duplicate()
        self.K = pattern.duplicate() if self._has_stiffness else None
        self._base = pattern.duplicate() if self._has_stiffness else None
        self.A.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        self.A.setOption(PETSc.Mat.Option.NEW_NONZERO_LOCATION_ERR, True)
        for compiled in self.compiled:
            compiled.add_mass(self.M)
            if self.K is not None:
                compiled.add_stiffness(self.K)
        self.M.assemble()
        if self.K is not None:
            self.K.assemble()
        self._based_on = 0.0  # the c of the base
        self.coupled = Tangent(self.A, self.searching)

    # ---- a step ------------------------------------------------------------------------------------------------

    def begin(self, h: float) -> Array:
        """Start a step of length h from (q0, v0); returns the first guess of the border scalars."""
        self.h = h
        for searching in self.searching:
            searching.search()
        t = self.time + self.rule.alpha * h
        for compiled in self.compiled:
            compiled.begin(t)
        return np.concatenate([np.zeros(0), *[b.begin(h, t) for b in self.borders]])

    def widen(self) -> bool:
        """After a step was solved: whether places that it needs were missed; it must then be solved again."""
        if not self.searching:
            return False
        missed = [c.widen() for c in self.searching]
        missed_anywhere: bool = self.comm.allreduce(any(missed))
        return missed_anywhere

    def inadmissible(self) -> str:
        """In words, what cannot be in the solution of a step; else nothing."""
        found = [border.inadmissible() for border in self.borders] + [
            c.inadmissible() for c in self.compiled
        ]
        return next(filter(None, found), "")

    def limit(self, update: Array) -> None:
        """Shorten an update (n,) of the owned coordinates where terms that search cannot follow it."""
        for searching in self.searching:
            searching.limit(update)

    def inertia(self, c: float, offset: PETSc.Vec | None = None) -> None:
        """Choose c and o (none: zero) of the residual's c M (w + o)."""
        self.c = c
        self.increment.inertia(c, offset)

    def predict(self, increment: PETSc.Vec) -> Array:
        """Choose p, from which w counts; returns the w of the held coordinates."""
        return self.increment.predict(increment, self.q0, self.time + self.h)

    def move(self, w: PETSc.Vec, base: PETSc.Vec | None) -> None:
        """Set q1 = q0 + p + w.  Strains follow linearly from the w `base`, or are the true ones if it is None."""
        self.increment.end(w, self.q0, self.q1)
        self._spread(self.q1, "q1")
        if base is not None:
            self._scratch.waxpy(-1.0, base, w)
            self._spread(self._scratch, "δ")
        for compiled in self.compiled:
            compiled.move(base is not None)

    def take(self, q: PETSc.Vec) -> None:
        """Set q1 = q, with its true strains."""
        q.copy(self.q1)
        self._spread(self.q1, "q1")
        for compiled in self.compiled:
            compiled.move(False)

    def residual(self, y: Array, r: PETSc.Vec) -> Array:
        """Field residual into r; returns the border residual s."""
        s = [b.residual(part) for b, part in self._split(y)]
        self.increment.add_inertia(self.M, r)
        if self.K is not None:
            α = self.rule.alpha
            self._scratch.waxpy((1 - α) / α, self.q0, self.q1)
            self._scratch.scale(α)
            self.K.multAdd(self._scratch, r, r)
        for compiled in self.compiled:
            compiled.add_forces(r)
        with r as values:
            for border in self.borders:
                border.add_force(values)
        self.supports.take(r)
        return np.concatenate([np.zeros(0), *s])

    def outside(self) -> PETSc.Vec:
        """Forces of loads, borders and supports at the last residual; what is inside balances them."""
        out = self.numbering.vector()
        for compiled in self.compiled:
            if compiled.supplies:
                compiled.add_forces(out)
        with out as values:
            for border in self.borders:
                border.add_force(values)
            values *= -1
            values[self.supports.held] = self.supports.reactions
        return out

    def gyroscopic(self, spin: tuple[float, float, float]) -> PETSc.Mat:
        """The matrix of the Coriolis force in a frame that turns with `spin` [rad/s]."""
        G = self.A.duplicate()
        G.setOption(PETSc.Mat.Option.NEW_NONZERO_LOCATION_ERR, False)
        for compiled in self.compiled:
            compiled.add_gyroscopic(G, spin)
        G.assemble()
        return G

    def tangent(self) -> PETSc.Mat:
        """Derivative of the field residual with respect to q1."""
        return self.assemble().whole()

    def assemble(self) -> Tangent:
        """The same, as a sum."""
        same = PETSc.Mat.Structure.SAME_NONZERO_PATTERN
        if self._base is None:
            self.M.copy(self.A, same)
            self.A.scale(self.c)
        else:
            if self._based_on != self.c:
                self.M.copy(self._base, same)
                self._base.scale(self.c)
                self._base.axpy(self.rule.alpha, self.K, same)
                self._based_on = self.c
            self._base.copy(self.A, same)
        self._add_tangents(self.A)
        self.A.assemble()
        self.supports.clear(self.A, 1.0)
        self.coupled.take()
        return self.coupled

    def coupling(self) -> tuple[list[Array | None], list[Array | None], Array]:
        """Columns and rows of all borders, zero at held coordinates, and their corner."""
        G: list[Array | None] = []
        H: list[Array | None] = []
        corner = np.zeros((0, 0))
        for border in self.borders:
            columns, rows, C = border.coupling()
            G, H, corner = G + columns, H + rows, block_diag(corner, C)
        for vector in G + H:
            if vector is not None:
                vector[self.supports.held] = 0
        return G, H, corner

    def accept(self, v1: PETSc.Vec) -> None:
        """End the step with the velocities v1; q1 is the state now, and what flowed is booked."""
        Δq = self.q1.array_r - self.q0.array_r
        self.supplied_energy += self.supports.work(Δq) + sum(c.supplied() for c in self.compiled)
        for compiled in self.compiled:
            for name, loss in zip(compiled.losses, compiled.dissipated(), strict=True):
                self.losses[name] += float(loss)
        for border in self.borders:
            border.accept()
        self.increment.accept(self.q0, self.q1)
        self.q0.copy(self.past)
        self.q1.copy(self.q0)
        v1.copy(self.v0)
        if self.constraints:
            self.v0.array[self.constraints.owned] = 0
        self._keep()
        self.time += self.h

    def _keep(self) -> None:
        """q1 and its strains are the start of the next step."""
        for field in self.fields.values():
            field.q0.x.array[:] = field.q1.x.array
        for compiled in self.compiled:
            compiled.keep()

    def totals(self) -> Totals:
        """Energies and momenta of the accepted state, and what was supplied and lost since the start."""
        self.M.mult(self.v0, self._momenta)
        P, x = self._momenta.array_r, self.q0.array_r
        p, q = (
            z[: 3 * len(self._is_position)].reshape(-1, 3) for z in (P, x)
        )  # without multipliers
        qp = q.T @ p
        stored, momenta = (
            dict[str, float](),
            np.stack([self._is_position @ p, qp[_NEXT, _LAST] - qp[_LAST, _NEXT]]),
        )
        for compiled in self.compiled:
            momenta += compiled.momenta()
            for name, energy in compiled.energies().items():
                stored[name] = stored.get(name, 0.0) + energy
        local = [self.v0.array_r @ P / 2, self.supplied_energy, *momenta.ravel(), *stored.values()]
        kinetic, supplied, *rest = self.comm.allreduce(
            np.array([*local, *self.losses.values()])
        ).tolist()
        linear, angular = np.array(rest[:6]).reshape(2, 3)
        stored = dict(zip(stored, rest[6 : 6 + len(stored)], strict=True))
        losses = dict(zip(self.losses, rest[6 + len(stored) :], strict=True))
        mass = mass_supplied = 0.0
        for border in self.borders:
            b = border.totals()
            stored |= b.stored
            supplied, mass, mass_supplied = (
                supplied + b.supplied,
                mass + b.mass,
                mass_supplied + b.mass_supplied,
            )
        return Totals(
            self.time, kinetic, stored, supplied, losses, linear, angular, mass, mass_supplied
        )

    def size(self, diagonal: PETSc.Vec) -> float:
        """Norm [N] of the forces of which the last residual is the sum; the diagonal of the tangent is given."""
        return self.increment.size(self.M, diagonal, self.q1)

    def imbalance(self, r: PETSc.Vec) -> tuple[float, float]:
        """Norm of the forces in r [N], and the largest violation of a constraint."""
        if self.constraints is None:
            return float(r.norm()), 0.0
        values, multipliers = r.array_r, self.constraints.owned
        squares = float(values[: multipliers.start] @ values[: multipliers.start])
        worst = float(np.abs(values[multipliers]).max(initial=0.0))
        if self.comm.size > 1:
            squares, worst = self.comm.allreduce(squares), self.comm.allreduce(worst, op=MPI.MAX)
        return squares**0.5, worst

    def place(self, r: PETSc.Vec) -> str:
        """Where the residual r is largest, in words."""
        values = abs(r.array_r)
        i = int(values.argmax()) if values.size else -1
        here = (float(values[i]) if i >= 0 else -1.0, self.comm.rank)
        words = ""
        for k, body in enumerate(self.bodies):
            owned = self.numbering.owned(k)
            if owned.start <= i < owned.stop:
                words = f"'{body.name}' {body.describe((i - owned.start) // body.block.size)}"
        return str(self.comm.bcast(words, root=max(self.comm.allgather(here))[1]))

    def _spread(self, z: PETSc.Vec, name: str) -> None:
        """Copy a vector to the fields' functions `name`, ghosts included."""
        values = z.array_r
        for k, field in self.fields.items():
            field.take(getattr(field, name), values[self.numbering.owned(k)])

    def tangent_forms(self, k: int) -> list[fem.Form]:
        """The bilinear forms of the tangent of body k."""
        forms = [form for c in self.compiled for form in c.tangent_forms(k)]
        return forms + [form for border in self.borders for form in border.tangents(self.bodies[k])]

    def mass_forms(self, k: int) -> list[fem.Form]:
        """The bilinear forms of the mass of body k."""
        return [form for c in self.compiled for form in c.mass_forms(k)]

    @property
    def made_of_forms(self) -> bool:
        """Whether all of the equations comes from forms on meshes: nothing acts on or between points."""
        return not self.borders and all(c.made_of_forms for c in self.compiled)

    def _add_tangents(self, A: PETSc.Mat) -> None:
        for k, field in self.fields.items():
            field.assemble(self.tangent_forms(k), A, self.numbering, k)
        for compiled in self.compiled:
            compiled.add_tangents(A)
        for border in self.borders:
            border.add_tangents(A)

    def _split(self, y: Array) -> list[tuple[ScalarUnknowns, Array]]:
        ends = np.cumsum([0] + [b.size for b in self.borders])
        return [(b, y[i:j]) for b, i, j in zip(self.borders, ends[:-1], ends[1:], strict=True)]
