"""Gravity on the bodies of a flying scene, relative to the frame that falls with them.

Problem.  Positions x in the frame are metres, those of its origin R are 7e6 m: the difference of
both attractions would lose seven digits.

Method.  A mass m at X = R + x has over a step from X0 to X1 the exact average of 1/r gravity, with
σ of `orbit.flight`; the origin has the same average from R0 to R1.  The difference is the force in
the frame,

    f/m = -σ(X0, X1) X_mid + σ(R0, R1) R_mid = -σ(R0, R1) [x_mid - γ/(1+γ) X_mid]                (1)

    1 + γ = σ(R0, R1)/σ(X0, X1)                                                                  (2)

γ is a polynomial of the relative growth of |X0|, |X1| and their sum over those of R (`excess`), and
the growth is computed without cancellation (`growth`):

    |X| - |R| = (2R + x)·x/(|X| + |R|)                                                           (3)

The work of the force on the displacement X1 - X0 is m μ (1/|X1| - 1/|X0|), and its moment about the
centre is zero.  So energy and angular momentum are conserved to the tolerance of the solver.
"""

from __future__ import annotations

from collections.abc import Iterator, MutableMapping, Sequence
from typing import Any, ClassVar

import numpy as np
import ufl
from dolfinx import fem, la
from petsc4py import PETSc

from gossamer_fx.extend import (
    Array,
    Assembly,
    AttachedKineticEnergy,
    Body,
    CompiledTerms,
    Compiler,
    Expr,
    Gather,
    Ground,
    KineticEnergy,
    PointMeasure,
    Support,
    Term,
    add_blocks,
    attach_all,
    check,
    compile_form,
    constant,
    evaluated_here,
    translation_weight,
)
from gossamer_fx.mechanics.orbit.flight import Flight, Moments


class MassPoints:
    """Mass points whose total kinetic energy equals that of given terms, of bodies without mesh and
    of masses that are attached to bodies.

    Point p of mass m_p has the position X_p = B_p q + o_p, with the unknowns q of the system.

    Attributes:
        indices: global indices (n, D) of the unknowns that move each of this rank's n points.
        B: matrices (n, 3, D) of these unknowns.
        o: offsets (n, 3) [m].
        mass: masses (n,) [kg].
    """

    def __init__(self, terms: Sequence[AttachedKineticEnergy], system: Assembly) -> None:
        """Replace each mass of this rank's ports by points, and find the unknowns that move them.
        Collective."""
        indices: list[Array] = []
        matrices: list[Array] = []
        offsets: list[Array] = []
        point_masses: list[float] = []
        for term in terms:
            ports = term.ports
            own = evaluated_here(ports)
            if not own:
                continue
            # k: number of vectors (position, directors) of a body; P (3k, D), offset (3k,): the
            # vectors of a port are P times its D unknowns plus the offset.
            k = term.mass.shape[1]
            own_ports = [ports[j] for j in own]
            unknowns, P, offset = attach_all(system.numbering, system.bodies, own_ports, 3 * k)
            for row, j in enumerate(own):
                is_position = np.array([translation_weight(port) for port in ports[j]])
                points, weights = equivalent_points(term.mass[j], is_position)
                # From the k vectors to the points, component by component.
                spread = np.kron(points, np.eye(3)).reshape(len(points), 3, 3 * k)
                indices += [unknowns[row]] * len(points)
                matrices += list(spread @ P[row])
                offsets += list(spread @ offset[row])
                point_masses += list(weights)

        # Points have different numbers of unknowns.  Shorter rows are filled up with an index of
        # their own and the coefficient zero.
        width = max((len(row) for row in indices), default=0)
        n = len(point_masses)
        padded = []
        for of_point in indices:
            missing = width - len(of_point)
            padded.append(np.pad(of_point, (0, missing), constant_values=of_point[0]))
        padded_matrices = []
        for matrix in matrices:
            padded_matrices.append(np.pad(matrix, ((0, 0), (0, width - matrix.shape[1]))))
        self.indices = np.array(padded, dtype=PETSc.IntType).reshape(n, width)
        self.B = np.array(padded_matrices).reshape(n, 3, width)
        self.o = np.array(offsets).reshape(n, 3)
        self.mass = np.array(point_masses)
        # One exchange brings the unknowns of all points, also those that other ranks own.
        self._gather = Gather(system.numbering, [self.indices])

    def __call__(self, q: PETSc.Vec) -> Array:
        """Positions (n, 3) [m] of the points at the unknowns q.  Collective."""
        unknowns = self._gather(q)[0]
        return np.einsum("nax,nx->na", self.B, unknowns) + self.o

    def add(self, forces: Array, r: PETSc.Vec) -> None:
        """Add forces (n, 3) [N] on the points to a vector of the system.  Collective."""
        values = np.einsum("nax,na->nx", self.B, forces)
        r.setValues(self.indices.ravel(), values.ravel(), addv=PETSc.InsertMode.ADD_VALUES)
        r.assemble()

    def add_matrices(self, K: Array, A: PETSc.Mat) -> None:
        """Add stiffness matrices (n, 3, 3) [N/m] of the points to a matrix of the system."""
        blocks = np.einsum("nax,nab,nby->nxy", self.B, K, self.B, optimize=True)
        add_blocks(A, self.indices, self.indices, blocks)


def equivalent_points(mass: Array, translation_weight: Array) -> tuple[Array, Array]:
    """Mass points that have the same mass matrix as a body that is moved by k vectors: points c (p,
    k), each an affine combination of the vectors, and masses m (p,) [kg], such that Σ m c cᵀ is the
    mass matrix (k, k): masses [kg] of positions, first [kg m] and second moments [kg m²] of
    directors.

    If all mass moves with the centre (to 1e-13), there is one point.  Otherwise there is a pair of
    points on each principal axis, at equal distances to both sides of the centre.  Mass, centre and
    second moments are exact; third moments are zero.  `translation_weight` (k,) is 1 for positions
    and 0 for directors.

    >>> import numpy as np
    >>> points, masses = equivalent_points(np.diag([2.0, 8.0]), np.array([1.0, 0.0]))
    >>> (masses[:, None] * points).T @ points
    array([[2., 0.],
           [0., 8.]])
    """
    towards = mass @ translation_weight
    total = float(translation_weight @ towards)
    centre = towards / total
    about_centre = mass - total * np.outer(centre, centre)
    # Pairs of points on the principal axes have the second moments and no products of inertia.
    moments, axes = np.linalg.eigh(about_centre)
    # Moments below this are round-off.
    kept = moments > 1e-13 * max(total, float(np.abs(mass).max()))
    pairs = int(kept.sum())
    if not pairs:
        return centre[None], np.array([total])
    each = total / (2 * pairs)
    arms = (np.sqrt(moments[kept] / (2 * each)) * axes[:, kept]).T
    points = np.concatenate([centre + arms, centre - arms])
    return points, np.full(2 * pairs, each)


def growth(R: Any, x: Any, dot: Any, root: Any) -> tuple[Any, Any]:
    """|R| and |R + x| - |R| [m], by (2R + x)·x/(|R + x| + |R|), in which nothing cancels.

    R [m] is the origin of the frame from the attracting centre, x [m] a position in the frame;
    arrays or UFL vectors, for which `dot` and `root` are the functions.  Both results are scalars,
    or (n,) for rows (n, 3), and NaN where both R and R + x are zero.

    >>> import numpy as np
    >>> r, longer = growth(np.array([7e6, 0.0, 0.0]), np.array([1e-3, 0.0, 0.0]), np.dot, np.sqrt)
    >>> float(r), round(float(longer), 12)
    (7000000.0, 0.001)
    """
    r = root(dot(R, R))
    longer = dot(2 * R + x, x)
    return r, longer / (r + root(r**2 + longer))


def excess(r0: Any, r1: Any, d0: Any, d1: Any) -> Any:
    """γ = σ(R0, R1)/σ(X0, X1) - 1 without cancellation, (2) of the module.

    r0 and r1 are |R0| and |R1| [m], d0 and d1 |X0| - |R0| and |X1| - |R1| [m] as `growth` returns
    them; numbers, arrays or UFL scalars.
    """
    p = d0 / r0
    q = d1 / r1
    w = (d0 + d1) / (r0 + r1)
    # (1 + p)(1 + q)(1 + w) - 1 without the subtraction.
    return p + q + w + p * q + p * w + q * w + p * q * w


def _names_of_holders(terms: Sequence[Term]) -> Iterator[str]:
    """Yield the names of terms that fix a body to a point of the frame, which flies and cannot
    hold: supports, and measures between points of which one is on the ground."""
    for term in terms:
        if isinstance(term, Support):
            yield term.name
        measure = getattr(term, "measure", None)
        if isinstance(measure, PointMeasure):
            ports = [port for place in measure.ports for port in place]
            if any(isinstance(port, Ground) for port in ports):
                yield term.name  # type: ignore[attr-defined]


class MeshGravity:
    """Gravity on one body on a mesh, as compiled forms; its mass is that of the body's kinetic
    energy, at the same quadrature points."""

    def __init__(self, term: KineticEnergy, at: Any) -> None:
        """Compile the forms, of which each step sets only constants."""
        self.body = term.body
        self._at = at
        mesh = at.q0.function_space.mesh
        size = len(at.w)
        # Constants, so that the forms are compiled once for all steps.
        # R0, R1: origin of the frame at the ends of the step [m]; A: acceleration [m/s²]; σ [1/s²];
        # μ: gravitational parameter [m³/s²]; G: gradient of the attraction other than 1/r [1/s²];
        # T: derivative of the force per mass by the position at the end of the step [1/s²].
        self.R0 = fem.Constant(mesh, np.zeros(3))
        self.R1 = fem.Constant(mesh, np.zeros(3))
        self.A = fem.Constant(mesh, np.zeros(3))
        self.σ = constant(mesh, 0.0)
        self.μ = constant(mesh, 0.0)
        self.G = fem.Constant(mesh, np.zeros((3, 3)))
        self.T = fem.Constant(mesh, np.zeros((3, 3)))
        one = constant(mesh, 1.0)

        def placed(v: Expr) -> Expr:
            """The vector v for the position, and zeros for the directors."""
            return ufl.as_vector([v[i] if i < 3 else 0 for i in range(size)])

        def point(q: Expr) -> Expr:
            """The position in the unknowns of a node."""
            return ufl.as_vector([q[i] for i in range(3)])

        x = point(at.mid)
        # r0, r1: distance |R| of the origin; d0, d1: distance |X| of the point less |R| [m].
        r0, d0 = growth(self.R0, point(at.q0), ufl.dot, ufl.sqrt)
        r1, d1 = growth(self.R1, point(at.q1), ufl.dot, ufl.sqrt)
        γ = excess(r0, r1, d0, d1)
        # Equation (1).  A is the acceleration of the origin that keeps it near the bodies, G the
        # gradient of all attraction other than 1/r.
        pull = -self.σ * (x - γ / (1 + γ) * ((self.R0 + self.R1) / 2 + x))
        self.force = compile_form(term.mass(placed(pull + self.A + ufl.dot(self.G, x)), at.w))
        self.tidal = compile_form(term.mass(placed(ufl.dot(self.G, x)), at.w))
        self.tangent = compile_form(-term.mass(placed(ufl.dot(self.T, point(at.dq))), at.w))
        unit = placed(ufl.as_vector([one, 0 * one, 0 * one]))
        # μ (1/|R| - 1/|X|), without the difference of two large numbers.
        weight = self.μ * d0 / (r0 * (r0 + d0))
        self.potential = compile_form(
            term.mass(placed(ufl.as_vector([weight, 0 * one, 0 * one])), unit)
        )
        self._weights = compile_form(term.mass(unit, at.w))

    def vector(self, form: fem.Form) -> Array:
        """Assemble a linear form, ghost contributions included, and return the values that this
        rank owns.  Collective."""
        dofmap = self._at.q0.function_space.dofmap
        b = fem.assemble_vector(form)
        b.scatter_reverse(la.InsertMode.add)
        return b.array[: dofmap.index_map.size_local * dofmap.index_map_bs]

    def weights(self) -> Array:
        """Weights of the owned coordinates w, such that Σ m w = Σ_i weights_i w_i for each
        component.
        """
        along_x = self.vector(self._weights).reshape(-1, 3)[:, :1]
        return np.repeat(along_x, 3, axis=1).ravel()


class CompiledOrbit(CompiledTerms["RelativeGravity"]):
    """Gravity on all bodies of a flying scene, and the energy of their common motion.
    `InputError`: the scene has several orbits, another stepper than the midpoint rule, or an item
    that fixes a body in its reference frame."""

    def __init__(self, terms: Sequence[RelativeGravity], system: Assembly) -> None:
        """Check that the scene can fly, and compile gravity on its bodies.  Collective."""
        # Positions of the scene are relative to one origin.
        check(len(terms) == 1, f"The scene has {len(terms)} orbits; give it one.")
        check(
            system.rule.conserves,
            f"'{terms[0].name}' flies by the midpoint rule only; "
            "run its scene with Midpoint, and give an equilibrium its light by gx.orbit.Sunlight.",
        )
        self._system = system
        self.name = terms[0].name
        self.flight = terms[0].flight
        self._around = self.flight.around
        terms[0].flights[system] = self.flight
        # Ranks may hold different terms, and all report the same name.
        held = max(system.comm.allgather(next(_names_of_holders(system.terms), "")))
        check(
            not held,
            f"'{held}' fixes a body in space, "
            f"but the frame of '{terms[0].name}' falls round the Earth: "
            "there is nothing to hold on to; tie bodies to each other, e.g. to a RigidBody.",
        )
        kinetic = [t for t in system.terms if isinstance(t, KineticEnergy)]
        points = [t for t in system.terms if isinstance(t, AttachedKineticEnergy)]
        self._meshes = [MeshGravity(t, system.coordinates[t.body]) for t in kinetic]
        self._points = MassPoints(points, system) if points else None
        # Number of the owned coordinates of bodies; multipliers follow them in vectors.
        self._size = sum(b.block.index_map.size_local * b.block.size for b in system.bodies)
        self._weights = self._weigh()
        ones = np.array([self._weights.array_r[: self._size : 3] @ self._is_position()])
        self.mass = float(system.comm.allreduce(ones)[0])
        self.flight.moments = self.moments
        # Of the last step: derivative [1/s²] of the force per mass by the position at the end, and
        # this rank's share of force [N] and moment [N m] of gravity.
        self._tangent: Array = np.zeros((3, 3))
        self._resultant: Array = np.zeros((2, 3))

    def _weigh(self) -> PETSc.Vec:
        """Weights W [kg] with Σ m w = Σ_i W_i w_i, the sum over all masses m that move by w, a
        vector of the system: the same weight for the three components of a node, zero for
        multipliers.  Collective."""
        W = self._system.numbering.vector()
        with W as values:
            for mesh in self._meshes:
                values[self._system.block(mesh.body).owned] += mesh.weights()
        if self._points:
            # The weight is the same for all three components.
            self._points.add(np.repeat(self._points.mass[:, None], 3, axis=1), W)
        return W

    def _is_position(self) -> Array:
        """1 for each owned position and 0 for each owned director, in the order of the unknowns,
        three of which are one of them."""
        each = [
            np.tile(np.eye(b.block.size // 3)[0], b.block.index_map.size_local)
            for b in self._system.bodies
        ]
        return np.concatenate([np.zeros(0), *each])

    def _sums(self, *vectors: Array) -> list[Array]:
        """Σ m w (3,) over all ranks, for each vector of owned values w.  Collective."""
        W = self._weights.array_r[: self._size]
        local = np.array([(W * w[: self._size]).reshape(-1, 3).sum(axis=0) for w in vectors])
        return list(self._system.comm.allreduce(local))

    def moments(self) -> Moments:
        """Mass, first moment and momentum at the start of the step.  Collective."""
        first, momentum = self._sums(self._system.q0.array_r, self._system.v0.array_r)
        return Moments(self.mass, first, momentum)

    # ---- a step ----------------------------------------------------------------------------------

    def begin_step(self, t: float) -> None:
        """Advance the origin by one step, whose middle is at t [s], and set all constants: its
        positions R0, R1 [m], the factor σ [1/s²] of the mean gravity over the step, and the gravity
        gradient [1/s²].  `_X0` (n, 3) [m] are the mass points at the start of the step.
        Collective."""
        flight = self.flight
        flight.prepare(self._system)
        # Origin of the frame from the attracting centre at both ends of the step [m]; r0, r1 are
        # its distances.
        R0 = flight.origin.R0
        R1 = flight.origin.R1
        r0 = np.linalg.norm(R0)
        r1 = np.linalg.norm(R1)
        self._σ = 2 * self._around.mu / (r0 * r1 * (r0 + r1))
        # Derivative of the force by the position at the end of the step; of equation (1) the
        # gravity gradient at the origin is accurate enough for Newton's method.
        self._tangent = (flight.gradient - self._around.tide(flight.R)) / 2
        for mesh in self._meshes:
            mesh.R0.value = R0
            mesh.R1.value = R1
            mesh.σ.value = self._σ
            mesh.A.value = -flight.pushed
            mesh.G.value = flight.gradient
            mesh.T.value = self._tangent
        if self._points:
            self._X0 = self._points(self._system.q0)

    def _on_points(self, x1: Array) -> Array:
        """Forces (n, 3) [N] of gravity, relative to the falling frame, on this rank's mass points
        in a step that ends at x1 (n, 3) [m]: (1) of the module, plus tidal and other accelerations.

        r0 and r1 are |R0| and |R1| [m], d0 and d1 (n,) [m] the distances |X| less |R|.
        """
        assert self._points is not None
        flight = self.flight
        x0 = self._X0
        x = (x0 + x1) / 2
        R0 = flight.origin.R0
        R1 = flight.origin.R1
        r0, d0 = growth(np.broadcast_to(R0, x.shape), x0, _dots, np.sqrt)
        r1, d1 = growth(np.broadcast_to(R1, x.shape), x1, _dots, np.sqrt)
        γ = excess(r0, r1, d0, d1)[:, None]
        pull = -self._σ * (x - γ / (1 + γ) * ((R0 + R1) / 2 + x))
        return self._points.mass[:, None] * (pull - flight.pushed + x @ flight.gradient)

    def add_forces(self, r: PETSc.Vec) -> None:
        """Subtract gravity [N] on all bodies at the iterate from the residual r.  Collective."""
        with r as values:
            for mesh in self._meshes:
                values[self._system.block(mesh.body).owned] -= mesh.vector(mesh.force)
        if self._points:
            self._points.add(-self._on_points(self._points(self._system.q1)), r)

    def tangent_forms(self, body: Body) -> list[fem.Form]:
        return [mesh.tangent for mesh in self._meshes if mesh.body is body]

    def add_tangents(self, A: PETSc.Mat) -> None:
        """Subtract the derivatives [N/m] of gravity on mass points from the tangent."""
        if self._points:
            self._points.add_matrices(-self._points.mass[:, None, None] * self._tangent, A)

    # ---- energy and momentum for the ledger ------------------------------------------------------

    def supplied(self) -> float:
        """Work [J] in the step that no other term counts; on rank 0, zero elsewhere.  Collective.

        It is the work of all attraction other than 1/r, and that of all other loads on the
        displacement of the origin of the moving frame.  The loads count their work on displacements
        in the frame themselves.  Their resultant follows from the change of momentum.  It also sets
        the centre of mass of `flight` and what `resultants` returns.
        """
        system = self._system
        flight = self.flight
        h = system.h
        # ΔR (3,): displacement of the origin; Δq: change of this rank's coordinates [m] in the
        # step.
        ΔR = flight.origin.moved
        Δq = system.q1.array_r - system.q0.array_r
        middle = (system.q0.array_r + system.q1.array_r) / 2
        # Forces of gravity in the frame, as the residual has them: with the opposite sign.
        r = system.numbering.vector()
        self.add_forces(r)
        tidal = system.numbering.vector()
        if self._around.is_perturbed:
            with tidal as values:
                for mesh in self._meshes:
                    values[system.block(mesh.body).owned] += mesh.vector(mesh.tidal)
            if self._points:
                x = (self._X0 + self._points(system.q1)) / 2
                self._points.add(self._points.mass[:, None] * (x @ flight.gradient), tidal)
        # Forces on directors have a moment, and no resultant.
        is_position = self._is_position()[:, None]
        forces = -r.array_r[: self._size].reshape(-1, 3)
        gravity = (is_position * forces).sum(axis=0)
        moment = np.cross(middle[: self._size].reshape(-1, 3), forces).sum(axis=0)
        self._resultant = np.array([gravity, moment])
        deformed = float(tidal.array_r[: self._size] @ Δq[: self._size])
        *gravity, deformed = system.comm.allreduce(np.array([*gravity, deformed]))
        # ΔS, S [kg m]: change of the first moment Σ m x in the step, and the moment at its middle;
        # P0 [kg m/s]: momentum at its start.
        ΔS, S, P0 = self._sums(Δq, middle, system.v0.array_r)
        self.flight.centre = S / self.mass
        # The midpoint rule has P1 = 2 ΔS/h - P0; (P1 - P0)/h less gravity is the resultant of all
        # other loads.
        others = 2 * (ΔS / h - P0) / h - np.array(gravity)
        # Work of the field and its gradient on the displacements of origin and bodies, to first
        # order in x.
        attracted = (
            self.mass * flight.field @ ΔR + flight.field @ ΔS + S @ flight.gradient @ ΔR + deformed
        )
        # All ranks know the sums; one of them reports.  The origin moves in time, and not in the
        # pseudo-time of a search for rest.
        if system.comm.rank != 0 or system.rule.is_static:
            return 0.0
        return float(attracted + others @ ΔR)

    def resultants(self) -> dict[str, Array]:
        return {self.name: self._resultant}

    def commit(self) -> None:
        self.flight.keep()

    def energies(self) -> dict[str, float]:
        """Energy of the motion of the frame and of 1/r gravity, by the name of the orbit.

        It is ½ M |V|² + V·P + Σ m μ (1/|R| - 1/|X|) - M μ/|R|, less the first and the last term at
        the start of the run: M is the mass of all bodies [kg], P their momentum in the frame, R and
        V position and velocity of the origin, X = R + x the position of a mass m.
        """
        system = self._system
        origin = self.flight.origin
        gained, _ = origin.gained()
        momentum = self._weights.array_r[: self._size] * system.v0.array_r[: self._size]
        energy = float(origin.V0 @ momentum.reshape(-1, 3).sum(axis=0))
        for mesh in self._meshes:
            mesh.R0.value = origin.R0
            mesh.μ.value = self._around.mu
            energy += float(fem.assemble_scalar(mesh.potential))
        if self._points:
            x = self._points(system.q0)
            # r: |R| [m]; d: |X| - |R| of each point [m].
            r, d = growth(np.broadcast_to(origin.R0, x.shape), x, _dots, np.sqrt)
            energy += float(np.sum(self._points.mass * self._around.mu * d / (r * (r + d))))
        # The energy of the origin belongs to no rank in particular: the first one counts it.
        if system.comm.rank == 0:
            energy += self.mass * gained
        return {self.name: energy}

    def momenta(self) -> Array:
        """Momentum [kg m/s] and angular momentum [kg m²/s] about the central body, less those in
        the frame."""
        m = self.moments()
        origin = self.flight.origin
        # R (3,) [m], V (3,) [m/s]: origin of the frame from the central body, at the start of the
        # step.
        R = origin.R0
        V = origin.V0
        momentum = m.mass * V
        moment = m.mass * origin.moment() + np.cross(R, m.momentum) + np.cross(m.first, V)
        if self._system.comm.rank != 0:
            return np.zeros((2, 3))
        return np.array([momentum, moment])


def _dots(a: Array, b: Array) -> Array:
    """Dot products (n,) of the rows of two arrays (n, 3)."""
    return np.einsum("na,na->n", a, b)


class RelativeGravity:
    """The term of an `Orbit`; a scene has one.  Its flight is entered into `flights` of the orbit
    under its system."""

    compiler: ClassVar[Compiler] = CompiledOrbit

    def __init__(
        self, name: str, flight: Flight, flights: MutableMapping[Assembly, Flight]
    ) -> None:
        self.name = name
        self.flight = flight
        self.flights = flights
