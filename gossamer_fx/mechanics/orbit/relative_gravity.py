"""Gravity on the bodies of a flying scene, relative to the frame that falls with them.

Problem.  Positions x in the frame are metres, those of its origin R are 7e6 m: the difference of
both attractions would lose seven digits.

Method.  A mass m at X = R + x has over a step from X0 to X1 the exact average of 1/r gravity, with
σ of `orbit.origin`, and the frame the same at R.  The difference is the force in the
frame,

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
    Ground,
    KineticEnergy,
    NodeKineticEnergy,
    PointMeasure,
    Support,
    Term,
    check,
    compile_form,
    constant,
)
from gossamer_fx.mechanics.orbit.flight import Flight, Moments
from gossamer_fx.mechanics.orbit.mass_points import MassPoints


def growth(
    R: Any,
    x: Any,
    dot: Any,
    root: Any,
) -> tuple[Any, Any]:
    """|R| and |R + x| - |R| [m], by (2R + x)·x/(|R + x| + |R|), in which nothing cancels.

    R and x are arrays or UFL vectors; both results are scalars, or (n,) for rows (n, 3).

    For arrays the results are NaN where both R and R + x are zero.

    Args:
        R: origin of the frame, from the attracting centre [m].
        x: position in the frame [m].
        dot: dot product of two such vectors.
        root: square root.

    >>> import numpy as np
    >>> r, longer = growth(np.array([7e6, 0.0, 0.0]), np.array([1e-3, 0.0, 0.0]), np.dot, np.sqrt)
    >>> float(r), round(float(longer), 12)
    (7000000.0, 0.001)
    """
    r = root(dot(R, R))
    longer = dot(2 * R + x, x)
    return r, longer / (r + root(r**2 + longer))


def excess(
    r0: Any,
    r1: Any,
    d0: Any,
    d1: Any,
) -> Any:
    """γ = σ(R0, R1)/σ(X0, X1) - 1 without cancellation, dimensionless.

    σ(b, c) = 2μ/(|b||c|(|b| + |c|)) is the factor of the mean gravity over a step, with the
    gravitational parameter μ; R is the origin of the frame and X a mass point, from the attracting
    centre.  Numbers, arrays or UFL scalars.

    Args:
        r0: |R0|, distance of the origin from the centre at the start of the step [m].
        r1: the same at the end of the step [m].
        d0: |X0| - |R0| [m], as `growth` returns it.
        d1: |X1| - |R1| [m].
    """
    p = d0 / r0
    q = d1 / r1
    w = (d0 + d1) / (r0 + r1)
    # (1 + p)(1 + q)(1 + w) - 1 without the subtraction.
    return p + q + w + p * q + p * w + q * w + p * q * w


def _names_of_holders(terms: Sequence[Term]) -> Iterator[str]:
    """Yield the names of terms that fix a body to a point of the frame, which flies and cannot
    hold.

    These are supports (`Support`), and measures between points of which one is on the ground."""
    for term in terms:
        if isinstance(term, Support):
            yield term.name
        measure = getattr(term, "measure", None)
        if isinstance(measure, PointMeasure):
            ports = [port for place in measure.ports for port in place]
            if any(isinstance(port, Ground) for port in ports):
                yield term.name  # type: ignore[attr-defined]


class MeshGravity:
    """Gravity on one body on a mesh, as compiled forms.

    The mass is that of the body's kinetic energy, at the same quadrature points.

    Args:
        term: kinetic energy of the body.
        at: its fields in the system: q0, q1 and mid of a step, test function w, trial function dq.
    """

    def __init__(self, term: KineticEnergy, at: Any) -> None:
        """Compile relative gravity on one body on a mesh; each step sets only constants of the
        forms.

        The force per mass is the difference of gravity at a point and at the origin R of the frame,
        -σ(R0, R1) [x_mid - γ/(1+γ) X_mid], see the module for σ and γ."""
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
        """Assemble a linear form, and return the values that this rank owns.

        Ghost contributions of other ranks are added. Collective.
        """
        dofmap = self._at.q0.function_space.dofmap
        b = la.vector(dofmap.index_map, dofmap.index_map_bs)
        fem.assemble_vector(b.array, form)
        b.scatter_reverse(la.InsertMode.add)
        owned: Array = b.array[: dofmap.index_map.size_local * dofmap.index_map_bs]
        return owned

    def weights(self) -> Array:
        """Weights of the owned coordinates w, such that Σ m w = Σ_i weights_i w_i for each
        component.
        """
        along_x = self.vector(self._weights).reshape(-1, 3)[:, :1]
        return np.repeat(along_x, 3, axis=1).ravel()


class CompiledOrbit(CompiledTerms["RelativeGravity"]):
    """Gravity on all bodies of a flying scene, and the energy of their common motion.

    Raises:
        InputError: the scene has several orbits, another stepper than the midpoint rule, or an item
            that fixes a body in the frame.
    """

    def __init__(self, terms: Sequence[RelativeGravity], system: Assembly) -> None:
        """Check that the scene can fly, and compile gravity on its bodies.  Collective.

        Args:
            terms: the orbits of the scene; there must be one.
            system: the compiled scene.

        Raises:
            InputError: the scene has several orbits, the time-stepping rule is not the midpoint
                rule, or a term fixes a body to a point of the frame.
        """
        # Positions of the scene are relative to one origin.
        check(len(terms) == 1, f"The scene has {len(terms)} orbits; give it one.")
        check(
            system.rule.alpha == 0.5,
            f"'{terms[0].name}' flies by the midpoint rule only; run its scene with Midpoint, and "
            "give an equilibrium its light by gx.orbit.Sunlight.",
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
            f"'{held}' fixes a body in space, but the frame of '{terms[0].name}' falls round the "
            "Earth: there is "
            "nothing to hold on to; tie bodies to each other, e.g. to a RigidBody.",
        )
        kinetic = [t for t in system.terms if isinstance(t, KineticEnergy)]
        points = [
            t for t in system.terms if isinstance(t, NodeKineticEnergy | AttachedKineticEnergy)
        ]
        self._meshes = [MeshGravity(t, system.fields[t.body]) for t in kinetic]
        self._points = MassPoints(points, system) if points else None
        self._size = sum(b.block.index_map.size_local * b.block.size for b in system.bodies)
        self._weights = self._weigh()
        ones = np.array([self._weights.array_r[: self._size : 3] @ self._is_position()])
        self.mass = float(system.comm.allreduce(ones)[0])
        self.flight.moments = self.moments
        self._tangent: Array = np.zeros((3, 3))
        self._resultant: Array = np.zeros((2, 3))

    def _weigh(self) -> PETSc.Vec:
        """Weights W [kg] with Σ m w = Σ_i W_i w_i, the sum over all masses m that move by w.

        w is a vector of the system: positions, velocities or displacements.

        Returns:
            a vector of the system, of all bodies: the same weight for the three components of a
            node.  Multipliers have the weight zero.  Collective.
        """
        W = self._system.numbering.vector()
        with W as values:
            for mesh in self._meshes:
                values[self._system.block(mesh.body).owned] += mesh.weights()
        if self._points:
            # The weight is the same for all three components.
            self._points.add(np.repeat(self._points.mass[:, None], 3, axis=1), W)
        return W

    def _is_position(self) -> Array:
        """Array of 1 for each owned position and 0 for each director."""
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
        """Advance the origin by one step, whose middle is at t [s], and set all constants.
        Collective.

        The constants are positions R0, R1 [m] of the origin, the factor σ [1/s²] of the mean
        gravity over the step, and the gravity gradient [1/s²].

        It also stores `_X0` (n, 3) [m], the positions of the mass points at the start of the step.

        Raises:
            InputError: the step is too large a part of a revolution.
        """
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
        """Forces (n, 3) [N] of gravity, relative to the falling frame, on the mass points in a
        step.

        m [-σ(R0, R1) (x_mid - γ/(1+γ) X_mid) + tidal and other accelerations], with the origin R of
        the frame and X = R + x; the first term is the exact average of 1/r gravity over the step.

        R0, R1 (3,) [m] are the origin at the ends of the step, r0, r1 their lengths, d0, d1 (n,)
        [m] the distances |X| less |R|. The n points are this rank's; `begin_step` must have stored
        their positions `_X0` at the start of the step.

        Args:
            x1: positions (n, 3) [m] of the points in the frame at the end of the step.
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
        forces: Array = self._points.mass[:, None] * (pull - flight.pushed + x @ flight.gradient)
        return forces

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
        if self._points:
            self._points.add_matrices(-self._points.mass[:, None, None] * self._tangent, A)

    # ---- energy and momentum for the ledger ------------------------------------------------------

    def supplied(self) -> float:
        """Work [J] in the step that no other term counts; on rank 0, zero elsewhere.  Collective.

        It is the work of all attraction other than 1/r, and that of all other loads on the
        displacement of the origin of the moving frame.  The loads count their work on displacements
        in the frame themselves.  Their resultant follows from the change of momentum.

        Side effects: it sets the centre of mass of `flight` and the resultant that `resultants`
        returns. `begin_step` must have been called for the step.
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
        # All ranks know the sums; one of them reports.
        if system.comm.rank != 0:
            return 0.0
        return float(attracted + others @ ΔR)

    def resultants(self) -> dict[str, Array]:
        return {self.name: self._resultant}

    def commit(self) -> None:
        self.flight.keep()

    def energies(self) -> dict[str, float]:
        """Energy [J] of the motion of the frame and of 1/r gravity, by the name of the orbit.

        It is ½ M |V|² + V·P + Σ m μ (1/|R| - 1/|X|) - M μ/|R|, less the first and the last term at
        the start of the run: M is the mass of all bodies [kg], P their momentum in the frame, R and
        V position and velocity of the origin, X = R + x the position of a mass m.  The sum over
        ranks counts.
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
    products: Array = np.einsum("na,na->n", a, b)
    return products


class RelativeGravity:
    """The term of an `Orbit`; a scene has one.

    Args:
        name: name of the orbit.
        flight: origin of the frame, and its surroundings at the present time.
        flights: dictionary of the orbit, into which the flight is entered under its system.
    """

    compiler: ClassVar[Compiler] = CompiledOrbit

    def __init__(
        self, name: str, flight: Flight, flights: MutableMapping[Assembly, Flight]
    ) -> None:
        self.name = name
        self.flight = flight
        self.flights = flights
