"""A compiled scene: numbering, forms, sparsity, residual and tangent.  It knows roles and rules, no part by name."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from dolfinx import fem, la
from mpi4py import MPI
from petsc4py import PETSc
from scipy.linalg import block_diag

from gossamer_fx.algebra.numbering import Numbering
from gossamer_fx.model.scalar_unknowns import InitialCondition, ScalarUnknowns
from gossamer_fx.model.terms import (
    Array,
    Body,
    Dissipation,
    Load,
    PointConstraint,
    PointDissipation,
    PointLoad,
    PointStoredEnergy,
    StoredEnergy,
    Term,
    is_on_mesh,
)
from gossamer_fx.system.totals import Totals
from gossamer_fx.terms.discrete_gradient import Coordinates, ElementForces, StressRule
from gossamer_fx.terms.loads import LoadForces
from gossamer_fx.terms.masses import Masses
from gossamer_fx.terms.point_constraints import PointConstraints, multiplier_block
from gossamer_fx.terms.point_forces import PointForces
from gossamer_fx.terms.point_loads import PointLoads
from gossamer_fx.terms.supports import Supports


class System:
    """State and equations of a scene for one stress rule.

    The unknowns of a step are the end coordinates q1 of all bodies, in one vector, and the border scalars y.  The
    residual is

        r = c M (q1 - a) + Σ stored and dissipated forces - Σ loads + border forces

    where the stepper chooses c and a (`inertia`): the midpoint rule has c = 2/h², a = q0 + h v0.  Multipliers stand
    behind the coordinates in the same vector; they have no mass and no rate, and their rows of r are the constraints.
    """

    def __init__(self, bodies: list[Body], parts: Iterable[Term], rule: StressRule, comm: MPI.Intracomm) -> None:
        self.comm, self.bodies, self.rule = comm, bodies, rule
        self.borders: list[ScalarUnknowns] = []
        self.time, self.h = 0.0, 1.0
        self.supplied_energy = self.dissipated_energy = 0.0
        self.terms = parts = list(parts)
        bonds = [p for p in parts if isinstance(p, PointConstraint)]
        blocks = [b.block for b in bodies] + [multiplier_block(comm, p) for p in bonds]
        self.numbering = numbering = Numbering(comm, blocks)
        self.q0, self.q1, self.v0, self.past, self._scratch, self._momenta = (numbering.vector() for _ in range(6))

        self.fields = {k: Coordinates(b.space, rule.alpha) for k, b in enumerate(bodies) if is_on_mesh(b)}
        self._forces = {k: la.vector(bodies[k].block.index_map, bodies[k].block.size) for k in self.fields}
        self.stored = [(k, ElementForces(p, at, rule)) for k, at, p in self._on_fields(parts, StoredEnergy)]
        self.dissipated = [(k, ElementForces(p, at, rule)) for k, at, p in self._on_fields(parts, Dissipation)]
        self.loads = [(k, LoadForces(p, at)) for k, at, p in self._on_fields(parts, Load)]
        self._elements = self.stored + self.dissipated
        points = [p for p in parts if isinstance(p, PointStoredEnergy | PointDissipation)]
        self._points = PointForces(numbering, bodies, points, rule.alpha) if points else None
        pushes = [p for p in parts if isinstance(p, PointLoad)]
        self._pushes = PointLoads(numbering, bodies, pushes, rule.alpha) if pushes else None
        self.constraints = PointConstraints(numbering, bodies, bonds, rule.alpha) if bonds else None
        self.masses = Masses(numbering, bodies, self.fields, parts)
        self.supports = Supports(numbering, bodies, parts)

    def start(self, conditions: Iterable[InitialCondition] = ()) -> None:
        """Take the initial state and set up the matrices; after the borders are attached."""
        for k, body in enumerate(self.bodies):
            self.q0.array[self.numbering.owned(k)], self.v0.array[self.numbering.owned(k)] = body.initial_state()
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
            self.move(q, None)
            self._keep()

    def _on_fields(self, parts: list[Term], role: Any) -> list[tuple[int, Coordinates, Any]]:
        """The parts of one role, with the index and coordinates of their body."""
        found = [(self.bodies.index(p.body), p) for p in parts if isinstance(p, role)]
        return [(k, self.fields[k], p) for k, p in found]

    def _build_matrices(self) -> None:
        """Mass matrix M and tangent A, with one sparsity pattern.

        They are duplicates: PETSc 3.22 multiplies those by BLAS, in half of the time of its kernel for blocks of three.
        """
        self.A = self.numbering.matrix()
        self.masses.add(self.A)
        self._add_tangents()
        self.A.assemble()
        self.M, self.A = self.A.duplicate(), self.A.duplicate()
        self.A.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        self.A.setOption(PETSc.Mat.Option.NEW_NONZERO_LOCATION_ERR, True)
        self.masses.add(self.M)
        self.M.assemble()

    # ---- a step ------------------------------------------------------------------------------------------------

    def begin(self, h: float) -> Array:
        """Start a step of length h from (q0, v0); returns the first guess of the border scalars."""
        self.h = h
        t = self.time + self.rule.alpha * h
        for k, force in self._elements:
            self.fields[k].h.value = h
            force.begin()
        for _, load in self.loads:
            if load.part.at is not None:
                load.part.at(t)
        if self._points:
            self._points.h = h
        if self._pushes:
            self._pushes.begin(self.time, h, self.q0, self.v0)
        return np.concatenate([np.zeros(0), *[b.begin(h, t) for b in self.borders]])

    def inertia(self, c: float, a: PETSc.Vec) -> None:
        """Choose c and a of the residual's c M (q1 - a)."""
        self.c, self._a = c, a

    def move(self, z: PETSc.Vec, base: PETSc.Vec | None) -> None:
        """Set q1 = z.  Strains follow linearly from `base`, or are the true ones if it is None."""
        z.copy(self.q1)
        self._spread(self.q1, "q1")
        if base is not None:
            self._scratch.waxpy(-1.0, base, z)
            self._spread(self._scratch, "δ")
        for _, force in self._elements:
            force.evaluate() if base is None else force.linearise()

    def residual(self, y: Array, r: PETSc.Vec) -> Array:
        """Field residual into r; returns the border residual s."""
        s = [b.residual(part) for b, part in self._split(y)]
        self._scratch.waxpy(-1.0, self._a, self.q1)
        self.M.mult(self._scratch, r)
        r.scale(self.c)
        for b in self._forces.values():
            b.array[:] = 0
        for k, force in self._elements:
            fem.assemble_vector(self._forces[k].array, force.residual)
        with r as values:
            for k, b in self._forces.items():
                b.scatter_reverse(la.InsertMode.add)
                self._add_owned(values, k, b.array)
            for k, load in self.loads:
                load.assemble()
                self._add_owned(values, k, -load.force.array)
            for border in self.borders:
                border.add_force(values)
        if self._points:
            self._points.add_forces(self.q1, r)
        if self._pushes:
            self._pushes.add_forces(self.q1, r)
        if self.constraints:
            self.constraints.add_forces(self.q1, r)
        self.supports.take(r)
        return np.concatenate([np.zeros(0), *s])

    def outside(self) -> PETSc.Vec:
        """Forces of loads, borders and supports at the last residual; what is inside balances them."""
        out = self.numbering.vector()
        with out as values:
            for k, load in self.loads:
                self._add_owned(values, k, -load.force.array)
            for border in self.borders:
                border.add_force(values)
        if self._pushes:
            self._pushes.add_forces(self.q1, out)
        with out as values:
            values *= -1
            values[self.supports.held] = self.supports.reactions
        return out

    def gyroscopic(self, spin: tuple[float, float, float]) -> PETSc.Mat:
        """The matrix of the Coriolis force in a frame that turns with `spin` [rad/s]."""
        G = self.A.duplicate()
        G.setOption(PETSc.Mat.Option.NEW_NONZERO_LOCATION_ERR, False)
        self.masses.gyroscopic(G, spin)
        G.assemble()
        return G

    def tangent(self) -> PETSc.Mat:
        """Derivative of the field residual with respect to q1."""
        self.M.copy(self.A, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        self.A.scale(self.c)
        self._add_tangents()
        self.A.assemble()
        self.supports.clear(self.A, 1.0)
        return self.A

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
        for k, load in self.loads:
            owned = self.numbering.owned(k)
            self.supplied_energy += float(Δq[owned] @ load.path_average()[: owned.stop - owned.start])
        self.supplied_energy += self.supports.work(Δq)
        for _, force in self.dissipated:
            self.dissipated_energy += force.dissipated()
        if self._points:
            self.dissipated_energy += self._points.dissipated(self.q1)
        if self._pushes:
            self.supplied_energy += self._pushes.work(self.q1)
        for border in self.borders:
            border.accept()
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
        for _, force in self._elements:
            force.accept()
        if self._points:
            self._points.begin(self.q0)
        if self.constraints:
            self.constraints.begin(self.q0)

    def totals(self) -> Totals:
        """Energies and momenta of the accepted state, and what was supplied and dissipated since the start."""
        self.M.mult(self.v0, self._momenta)
        P, x = self._momenta.array_r, self.q0.array_r
        momenta = np.zeros((2, 3))
        for k, body in enumerate(self.bodies):
            owned = self.numbering.owned(k)
            p, q = P[owned].reshape(-1, 3), x[owned].reshape(-1, 3)
            momenta[0] += p[:: body.block.size // 3].sum(axis=0)
            momenta[1] += np.cross(q, p).sum(axis=0)
        stored = {f.part.name: f.energy() for _, f in self.stored}
        for name, energy in (self._points.energies() if self._points else {}).items():
            stored[name] = stored.get(name, 0.0) + energy
        local = np.array(
            [self.v0.array_r @ P / 2, self.supplied_energy, self.dissipated_energy, *momenta.ravel(), *stored.values()]
        )
        kinetic, supplied, dissipated, *rest = self.comm.allreduce(local).tolist()
        stored = dict(zip(stored, rest[6:], strict=True))
        mass = mass_supplied = 0.0
        for border in self.borders:
            b = border.totals()
            stored |= b.stored
            supplied, mass, mass_supplied = supplied + b.supplied, mass + b.mass, mass_supplied + b.mass_supplied
        linear, angular = np.array(rest[:3]), np.array(rest[3:6])
        return Totals(self.time, kinetic, stored, supplied, dissipated, linear, angular, mass, mass_supplied)

    def imbalance(self, r: PETSc.Vec) -> tuple[float, float]:
        """Norm of the forces in r [N], and the largest violation of a constraint."""
        if self.constraints is None:
            return float(r.norm()), 0.0
        values, multipliers = r.array_r, self.constraints.owned
        forces = self.comm.allreduce(float(values[: multipliers.start] @ values[: multipliers.start]))
        return forces**0.5, self.comm.allreduce(float(np.abs(values[multipliers]).max(initial=0.0)), op=MPI.MAX)

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
            function = getattr(field, name).x
            owned = self.numbering.owned(k)
            function.array[: owned.stop - owned.start] = values[owned]
            function.scatter_forward()

    def _add_owned(self, values: Array, k: int, b: Array) -> None:
        owned = self.numbering.owned(k)
        values[owned] += b[: owned.stop - owned.start]

    def tangent_forms(self, k: int) -> list[fem.Form]:
        """The bilinear forms of the tangent of body k."""
        forms = [f.tangent for j, f in self._elements if j == k]
        forms += [f.tangent for j, f in self.loads if j == k and f.tangent]
        return forms + [form for border in self.borders for form in border.tangents(self.bodies[k])]

    @property
    def couples_points(self) -> bool:
        """Whether something acts on or between points: forces, constraints, masses."""
        return bool(self._points or self._pushes or self.constraints or self.masses.at_points)

    def _add_tangents(self) -> None:
        for k in range(len(self.bodies)):
            self.numbering.assemble(self.A, k, self.tangent_forms(k))
        if self._points:
            self._points.add_tangents(self.q1, self.A)
        if self._pushes:
            self._pushes.add_tangents(self.q1, self.A)
        if self.constraints:
            self.constraints.add_tangents(self.q1, self.A)
        for border in self.borders:
            border.add_tangents(self.A)

    def _split(self, y: Array) -> list[tuple[ScalarUnknowns, Array]]:
        ends = np.cumsum([0] + [b.size for b in self.borders])
        return [(b, y[i:j]) for b, i, j in zip(self.borders, ends[:-1], ends[1:], strict=True)]
