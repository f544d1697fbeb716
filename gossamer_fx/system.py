"""A compiled scene: numbering, forms, sparsity, residual and tangent.  It knows roles and rules, no part by name."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import dolfinx.cpp
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, la
from mpi4py import MPI
from petsc4py import PETSc
from scipy.linalg import block_diag

from gossamer_fx.discrete_gradient import Coordinates, ElementForces, StressRule
from gossamer_fx.forms import compile_form
from gossamer_fx.numbering import Numbering
from gossamer_fx.parts import (
    Array,
    AttachedKinetic,
    Body,
    Border,
    Constraint,
    Dissipated,
    InitialCondition,
    Kinetic,
    Part,
    PointConstraint,
    PointDissipated,
    PointKinetic,
    PointStored,
    PointSupplied,
    Stored,
    Supplied,
    is_on_mesh,
)
from gossamer_fx.places import add_mass
from gossamer_fx.point_constraints import PointConstraints, multiplier_block
from gossamer_fx.point_forces import PointForces
from gossamer_fx.point_loads import PointLoads


class LoadForces:
    """A `Supplied` part, compiled: its force at q̄ and its work over the step."""

    def __init__(self, part: Supplied, at: Coordinates) -> None:
        self.part, self._at = part, at
        δW = part.work(at.mid, at.w)
        self.form = compile_form(δW)
        self.tangent = compile_form(-ufl.derivative(δW, at.q1, at.dq)) if part.follows else None
        dofmap = at.q0.function_space.dofmap
        self.force = la.vector(dofmap.index_map, dofmap.index_map_bs)
        self._changes = part.follows or part.at is not None
        self._assembled = False

    def assemble(self) -> None:
        if self._changes or not self._assembled:
            self.force.array[:] = 0
            fem.assemble_vector(self.force.array, self.form)
            self.force.scatter_reverse(la.InsertMode.add)
            self._assembled = True

    def path_average(self) -> Array:
        """The force whose product with Δq is the work of the step, owned and ghost.

        The midpoint rule does its work with the force at q̄.  Of a force at the end of the step, the work along the
        straight path is taken, by Simpson's rule: exact for forces that are at most cubic in q, such as pressure.
        """
        end: Array = self.force.array.copy()
        α = self._at.α
        if not self.part.follows or α.value != 1:
            return end
        average = end / 6
        for weight, place in ((1 / 6, 0.0), (4 / 6, 0.5)):
            α.value = place
            self.assemble()
            average += weight * self.force.array
        α.value = 1.0
        self.force.array[:] = end
        return average


@dataclass(frozen=True)
class Totals:
    """Energies [J], momenta [kg m/s, kg m²/s] and gas masses [kg] of a state; supplied and dissipated since the start."""

    time: float
    kinetic: float
    stored: dict[str, float]
    supplied: float
    dissipated: float
    momentum: Array
    angular_momentum: Array
    mass: float
    mass_supplied: float

    @property
    def energy(self) -> float:
        """Kinetic and stored."""
        return self.kinetic + sum(self.stored.values())


class System:
    """State and equations of a scene for one stress rule.

    The unknowns of a step are the end coordinates q1 of all bodies, in one vector, and the border scalars y.  The
    residual is

        r = c M (q1 - a) + Σ stored and dissipated forces - Σ loads + border forces

    where the stepper chooses c and a (`inertia`): the midpoint rule has c = 2/h², a = q0 + h v0.  Multipliers stand
    behind the coordinates in the same vector; they have no mass and no rate, and their rows of r are the constraints.
    """

    def __init__(self, bodies: list[Body], parts: Iterable[Part], rule: StressRule, comm: MPI.Intracomm) -> None:
        self.comm, self.bodies, self.rule = comm, bodies, rule
        self.borders: list[Border] = []
        self.time, self.h = 0.0, 1.0
        self._supplied = self._dissipated = 0.0
        parts = list(parts)
        bonds = [p for p in parts if isinstance(p, PointConstraint)]
        blocks = [b.block for b in bodies] + [multiplier_block(comm, p) for p in bonds]
        self.numbering = numbering = Numbering(comm, blocks)
        self.q0, self.q1, self.v0, self._scratch, self._momenta = (numbering.vector() for _ in range(5))
        self._start = self.q0.getOwnershipRange()[0]

        self.fields = {k: Coordinates(b.space, rule.alpha) for k, b in enumerate(bodies) if is_on_mesh(b)}
        self._forces = {k: la.vector(bodies[k].block.index_map, bodies[k].block.size) for k in self.fields}
        self.stored = [(k, ElementForces(p, at, rule)) for k, at, p in self._on_fields(parts, Stored)]
        self.dissipated = [(k, ElementForces(p, at, rule)) for k, at, p in self._on_fields(parts, Dissipated)]
        self.loads = [(k, LoadForces(p, at)) for k, at, p in self._on_fields(parts, Supplied)]
        self._elements = self.stored + self.dissipated
        points = [p for p in parts if isinstance(p, PointStored | PointDissipated)]
        self._points = PointForces(numbering, bodies, points, rule.alpha) if points else None
        pushes = [p for p in parts if isinstance(p, PointSupplied)]
        self._pushes = PointLoads(numbering, bodies, pushes, rule.alpha) if pushes else None
        self.constraints = PointConstraints(numbering, bodies, bonds, rule.alpha) if bonds else None
        self._masses = [p for p in parts if isinstance(p, Kinetic | PointKinetic | AttachedKinetic)]
        self._fixed, self._moved = self._held(parts), self._prescribed(parts)
        self._any_fixed = comm.allreduce(len(self._fixed)) > 0

    def start(self, conditions: Iterable[InitialCondition] = ()) -> None:
        """Take the initial state and set up the matrices; after the borders are attached."""
        for k, body in enumerate(self.bodies):
            self.q0.array[self.numbering.owned(k)], self.v0.array[self.numbering.owned(k)] = body.initial_state()
        for condition in conditions:
            condition.set_state(self, self.q0, self.v0)
        self.v0.array[np.setdiff1d(self._fixed, [i for at, _ in self._moved for i in at])] = 0
        if self.constraints:
            free = self.numbering.vector()
            free.set(1.0)
            free.array[self._fixed] = 0
            self.constraints.validate(self.q0, self.v0, free)
            self._fixed = np.union1d(self._fixed, self.constraints.idle(free, self.q0))
            self._any_fixed = self.comm.allreduce(len(self._fixed)) > 0
        self.move(self.q0, None)
        self._keep()
        for border in self.borders:
            border.start()
        self._build_matrices()

    def _on_fields(self, parts: list[Part], role: Any) -> list[tuple[int, Coordinates, Any]]:
        """The parts of one role, with the index and coordinates of their body."""
        found = [(self.bodies.index(p.body), p) for p in parts if isinstance(p, role)]
        return [(k, self.fields[k], p) for k, p in found]

    def _held(self, parts: list[Part]) -> npt.NDArray[np.int64]:
        """Positions of the coordinates that are held, in this rank's part of a vector."""
        held = [np.zeros(0, dtype=np.int64)]
        for part in parts:
            if isinstance(part, Constraint):
                owned = self.numbering.owned(self.bodies.index(part.body))
                held.append(part.dofs[part.dofs < owned.stop - owned.start].astype(np.int64) + owned.start)
        return np.unique(np.concatenate(held))

    def _prescribed(self, parts: list[Part]) -> list[tuple[npt.NDArray[np.int64], Callable[[float], Array]]]:
        """Positions of the coordinates that are moved, in this rank's part of a vector, and their values at a time."""

        def restrict(motion: Callable[[float], Array], mine: npt.NDArray[np.bool_]) -> Callable[[float], Array]:
            return lambda t: motion(t)[mine]

        moved = []
        for part in parts:
            if isinstance(part, Constraint) and part.motion is not None:
                owned = self.numbering.owned(self.bodies.index(part.body))
                mine = part.dofs < owned.stop - owned.start
                moved.append((part.dofs[mine].astype(np.int64) + owned.start, restrict(part.motion, mine)))
        return moved

    def _build_matrices(self) -> None:
        """Mass matrix M and tangent A, with one sparsity pattern."""
        self.A = self.numbering.matrix()
        self._add_masses(self.A)
        self._add_tangents()
        self.A.assemble()
        self.A.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        self.A.setOption(PETSc.Mat.Option.NEW_NONZERO_LOCATION_ERR, True)
        self.M = self.A.duplicate()
        self._add_masses(self.M)
        self.M.assemble()
        self._largest_mass = float(self.M.getDiagonal().max()[1]) if self.numbering.size else 0.0

    def _add_masses(self, target: PETSc.Mat) -> None:
        for part in self._masses:
            if isinstance(part, AttachedKinetic):
                add_mass(target, self.numbering, self.bodies, part)
                continue
            k = self.bodies.index(part.body)
            if isinstance(part, Kinetic):
                at = self.fields[k]
                self._assemble_matrix(target, k, [compile_form(part.mass(at.dq, at.w))])
            else:
                first = self._start + self.numbering.owned(k).start
                size = part.body.block.size
                for i, m in enumerate(part.mass):
                    rows = (first + i * size + np.arange(size)).astype(PETSc.IntType)
                    target.setValues(rows, rows, np.kron(m, np.eye(3)), addv=PETSc.InsertMode.ADD_VALUES)

    def _assemble_matrix(self, A: PETSc.Mat, k: int, forms: Iterable[fem.Form]) -> None:
        view = self.numbering.submatrix(A, k)
        unrolled = self.numbering.block_size != self.bodies[k].block.size
        for form in forms:
            constants = dolfinx.cpp.fem.pack_constants(form._cpp_object)
            coefficients = dolfinx.cpp.fem.pack_coefficients(form._cpp_object)
            dolfinx.cpp.fem.petsc.assemble_matrix(view, form._cpp_object, constants, coefficients, [], unrolled)
        self.numbering.restore(A, k, view)

    def gyroscopic(self, spin: tuple[float, float, float]) -> PETSc.Mat:
        """The matrix of the Coriolis force 2 M (ω×v) in a frame that turns with ω = `spin` [rad/s]."""
        G = self.A.duplicate()
        G.setOption(PETSc.Mat.Option.NEW_NONZERO_LOCATION_ERR, False)
        for part in self._masses:
            k = self.bodies.index(part.body)
            if isinstance(part, Kinetic):
                at = self.fields[k]
                ω = fem.Constant(at.q0.function_space.mesh, tuple(float(c) for c in spin))
                v = [ufl.cross(ω, ufl.as_vector([at.dq[i + j] for j in range(3)])) for i in range(0, len(at.dq), 3)]
                turned = ufl.as_vector([c for vector in v for c in (vector[0], vector[1], vector[2])])
                self._assemble_matrix(G, k, [compile_form(2 * part.mass(turned, at.w))])
            else:
                first, size = self._start + self.numbering.owned(k).start, part.body.block.size
                for i, m in enumerate(part.mass):
                    rows = (first + i * size + np.arange(size)).astype(PETSc.IntType)
                    turned = np.kron(2 * m, np.cross(np.eye(3), np.asarray(spin)))
                    G.setValues(rows, rows, turned, addv=PETSc.InsertMode.ADD_VALUES)
        G.assemble()
        return G

    # ---- a step ------------------------------------------------------------------------------------------------

    def begin(self, h: float) -> Array:
        """Start a step of length h from (q0, v0); returns the first guess of the border scalars."""
        self.h = h
        t = self.time + self.rule.alpha * h
        for field in self.fields.values():
            field.h.value = h
        for _, load in self.loads:
            if load.part.at is not None:
                load.part.at(t)
        if self._points:
            self._points.h = h
        if self._pushes:
            self._pushes.begin(self.time, h, self.q0, self.v0)
        return np.concatenate([np.zeros(0), *[b.begin(h, t) for b in self.borders]])

    def prescribe(self, z: PETSc.Vec) -> None:
        """Give the moved coordinates of z their values at the end of the step."""
        with z as values:
            for at, motion in self._moved:
                values[at] = motion(self.time + self.h)

    def inertia(self, c: float, a: PETSc.Vec) -> None:
        """Choose c and a of the residual's c M (q1 - a)."""
        self._c, self._a = c, a

    @property
    def inertia_diagonal(self) -> float:
        """Largest diagonal entry of c M."""
        return self._c * self._largest_mass

    def move(self, z: PETSc.Vec, base: PETSc.Vec | None) -> None:
        """Set q1 = z.  Strains follow linearly from `base`, or are the true ones if it is None."""
        z.copy(self.q1)
        self._spread(self.q1, "q1")
        if base is not None:
            self._scratch.waxpy(-1.0, base, z)
            self._spread(self._scratch, "δ")
        for _, force in self._elements:
            if base is None:
                force.evaluate()
            else:
                force.linearise()

    def residual(self, y: Array, r: PETSc.Vec) -> Array:
        """Field residual into r; returns the border residual s."""
        s = [b.residual(part) for b, part in self._split(y)]
        self._scratch.waxpy(-1.0, self._a, self.q1)
        self.M.mult(self._scratch, r)
        r.scale(self._c)
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
        with r as values:
            self._reactions = values[self._fixed]
            values[self._fixed] = 0
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
            values[self._fixed] = self._reactions
        return out

    def rigid_motions(self) -> list[PETSc.Vec]:
        """Velocities of the coordinates in three translations and three rotations about the origin, zero where held."""
        motions = []
        for i, axis in enumerate([*np.eye(3), *np.eye(3)]):
            φ = self.numbering.vector()
            with φ as values:
                for k, body in enumerate(self.bodies):
                    owned = self.numbering.owned(k)
                    q = self.q0.array_r[owned].reshape(-1, 3)
                    v = np.cross(axis, q) if i >= 3 else np.zeros_like(q)
                    if i < 3:
                        v[:: body.block.size // 3] = axis
                    values[owned] = v.ravel()
                values[self._fixed] = 0
            motions.append(φ)
        return motions

    def clear_held(self, matrix: PETSc.Mat) -> None:
        """Set the rows and columns of the held coordinates to zero."""
        if self._any_fixed:
            matrix.zeroRowsColumns((self._fixed + self._start).astype(PETSc.IntType), diag=0.0)

    def tangent(self) -> PETSc.Mat:
        """Derivative of the field residual with respect to q1."""
        self.M.copy(self.A, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        self.A.scale(self._c)
        self._add_tangents()
        self.A.assemble()
        if self._any_fixed:
            self.A.zeroRowsColumns((self._fixed + self._start).astype(PETSc.IntType), diag=1.0)
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
                vector[self._fixed] = 0
        return G, H, corner

    def accept(self, v1: PETSc.Vec) -> None:
        """End the step with the velocities v1; q1 is the state now, and what flowed is booked."""
        Δq = self.q1.array_r - self.q0.array_r
        for k, load in self.loads:
            owned = self.numbering.owned(k)
            self._supplied += float(Δq[owned] @ load.path_average()[: owned.stop - owned.start])
        for at, _ in self._moved:
            self._supplied += float(Δq[at] @ self._reactions[np.searchsorted(self._fixed, at)])
        for _, force in self.dissipated:
            self._dissipated += force.dissipated()
        if self._points:
            self._dissipated += self._points.dissipated(self.q1)
        if self._pushes:
            self._supplied += self._pushes.work(self.q1)
        for border in self.borders:
            border.accept()
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

    def book(self) -> Totals:
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
            [self.v0.array_r @ P / 2, self._supplied, self._dissipated, *momenta.ravel(), *stored.values()]
        )
        kinetic, supplied, dissipated, *rest = self.comm.allreduce(local).tolist()
        stored = dict(zip(stored, rest[6:], strict=True))
        mass = mass_supplied = 0.0
        for border in self.borders:
            b = border.book()
            stored |= b.stored
            supplied, mass, mass_supplied = supplied + b.supplied, mass + b.mass, mass_supplied + b.mass_supplied
        return Totals(
            self.time,
            kinetic,
            stored,
            supplied,
            dissipated,
            np.array(rest[:3]),
            np.array(rest[3:6]),
            mass,
            mass_supplied,
        )

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

    def _add_tangents(self) -> None:
        for k, body in enumerate(self.bodies):
            forms = [f.tangent for j, f in self._elements if j == k]
            forms += [f.tangent for j, f in self.loads if j == k and f.tangent]
            forms += [form for border in self.borders for form in border.tangents(body)]
            self._assemble_matrix(self.A, k, forms)
        if self._points:
            self._points.add_tangents(self.q1, self.A)
        if self._pushes:
            self._pushes.add_tangents(self.q1, self.A)
        if self.constraints:
            self.constraints.add_tangents(self.q1, self.A)

    def _split(self, y: Array) -> list[tuple[Border, Array]]:
        ends = np.cumsum([0] + [b.size for b in self.borders])
        return [(b, y[i:j]) for b, i, j in zip(self.borders, ends[:-1], ends[1:], strict=True)]
