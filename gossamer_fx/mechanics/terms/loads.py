"""Loads on mesh bodies, points and directors: their force at q_mid and their work over a step.

Loads on points are known on every rank and entered by the one that owns the first port.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import ufl
from dolfinx import fem, la
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.core.algebra.point_measures import (
    Gather,
    attach,
    is_evaluated_here,
    refuse_ports_outside,
    translation_weight,
)
from gossamer_fx.core.algebra.rotations import cross_matrices
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.user_functions import ask_numbers
from gossamer_fx.core.forms.cell_loops import assembly
from gossamer_fx.core.forms.compilation import compile_form
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.model.body import Array, Attached, Body, MeshBody
from gossamer_fx.core.model.terms import Parameter
from gossamer_fx.mechanics.terms.assembly import (
    Assembly,
    CompiledTerms,
    Compiler,
    Differentiable,
)
from gossamer_fx.mechanics.terms.coordinates import Coordinates


class Loads(Differentiable, CompiledTerms["Load"]):
    """All `Load` terms of a scene."""

    is_external_load = True
    forces_are_forms = True
    has_shape_derivative = True

    def __init__(self, terms: Sequence[Load], system: Assembly) -> None:
        self._system = system
        self._loads = [LoadForces(term, system.coordinates[term.body]) for term in terms]

    def begin_step(self, t: float) -> None:
        """Set the constants of loads that change with time to the time t [s] of the forces."""
        for load in self._loads:
            if load.term.at is not None:
                load.term.at(t)

    def add_forces(self, r: PETSc.Vec) -> None:
        """Subtract the loads [N] from r."""
        with r as values:
            for load in self._loads:
                load.assemble()
                body = load.term.body
                owned = self._system.block(body).owned
                self._system.coordinates[body].add_forces(-load.force.array, values[owned])

    def tangent_forms(self, body: Body) -> list[fem.Form]:
        return [load.tangent for load in self._loads if load.term.body is body and load.tangent]

    def residual_forms(self, body: Body, w: Expr) -> list[ufl.Form]:
        found = []
        for load in self._loads:
            if load.term.body is body:
                at = self._system.coordinates[load.term.body]
                found.append(-load.term.work(at.mid, w))
        return found

    def parameters_changed(self) -> None:
        for load in self._loads:
            load.forget()

    def supplied(self) -> float:
        """Work [J] of the loads in the present step, this rank's share; collective for loads that
        follow the body, in statics."""
        work = 0.0
        # Change (n,) [m] of this rank's coordinates in the step.
        Δq = self._system.q1.array_r - self._system.q0.array_r
        for load in self._loads:
            body = load.term.body
            owned = self._system.block(body).owned
            forces = np.zeros(owned.stop - owned.start)
            self._system.coordinates[body].add_forces(load.path_average(), forces)
            work += float(Δq[owned] @ forces)
        return work

    def resultants(self) -> dict[str, Array]:
        """Resultants in the configuration in which the forces of the last accepted step acted."""
        # α is the weight of the end of the step in the configuration q in which forces f acted.
        system = self._system
        found = dict[str, Array]()
        α = system.rule.alpha
        for load in self._loads:
            body = load.term.body
            owned = system.block(body).owned
            # The step is committed: its start is `previous`, its end is q0.
            start = system.previous.array_r[owned]
            end = system.q0.array_r[owned]
            q = ((1 - α) * start + α * end).reshape(-1, 3)
            # Of a reduced film these are forces on the coefficients, of which the first is a
            # displacement: their moments about the coefficients add up to that of the nodes.
            forces = np.zeros(owned.stop - owned.start)
            system.coordinates[body].add_forces(load.force.array, forces)
            f = forces.reshape(-1, 3)
            # Of the vectors of a node the first is its position; directors have a moment only.
            vectors_per_node = body.block.size // 3
            force = f[::vectors_per_node].sum(axis=0)
            moment = np.cross(q, f).sum(axis=0)
            found[load.term.name] = found.get(load.term.name, 0.0) + np.array([force, moment])
        return found


@dataclass(frozen=True, eq=False)
class Load:
    """A load: `work(q, w)` is its virtual work [J], linear in w; `at(t)`, if given, sets its
    constants to time t [s].

    `parameters` are constants of the work that no `at` sets.
    """

    name: str
    body: MeshBody
    work: Callable[[Expr, Expr], ufl.Form]
    # Whether the work form depends on the configuration q: then it has a tangent.
    follows: bool = False
    at: Callable[[float], None] | None = None
    parameters: tuple[Parameter, ...] = ()
    compiler: ClassVar[Compiler] = Loads


def in_time(
    comm: MPI.Intracomm, what: str, value: Callable[[float], Any], target: fem.Constant
) -> Callable[[float], None]:
    """What sets a constant of forms to the value of a user's function at a time t [s], the same on
    all ranks; `what` names the function in messages."""

    def at(t: float) -> None:
        source = f"{what} at t = {t:.6g} s"
        target.value = ask_numbers(comm, source, lambda: value(t), target.value.shape)

    return at


def rate_of(at: Coordinates) -> Expr:
    """Mean velocity (q1 - q0)/h of the step."""
    return (at.q1 - at.q0) / at.h


def at_rate(
    name: str, body: MeshBody, work: Callable[[Expr, Expr, Expr], ufl.Form], at: Coordinates
) -> Load:
    """A load that also depends on the mean velocity of the step, `rate`, by its virtual work
    `work(q, rate, w)` [J], as one on these coordinates, whose step h [s] is to be set before each
    step."""
    return Load(name, body, lambda q, w: work(q, rate_of(at), w), follows=True)


class LoadForces:
    """A load, compiled."""

    def __init__(self, term: Load, at: Coordinates) -> None:
        """Compile the virtual work [J] of the load, and its derivative if the load follows the
        body.  Collective."""
        self.term = term
        self._at = at
        # Virtual work along the test function, at the configuration in which the force acts.
        δW = term.work(at.mid, at.w)
        self.form = compile_form(δW)
        # Compiling a zero derivative would take a kernel, and assembling it time.
        self.tangent = None
        if term.follows:
            self.tangent = compile_form(-ufl.derivative(δW, at.q1, at.dq))
        dofmap = at.q0.function_space.dofmap
        self.force = la.vector(dofmap.index_map, dofmap.index_map_bs)
        self._add_forces = assembly(self.form, self.force.array)
        # A dead load is assembled once in a run.
        self._changes = term.follows or term.at is not None
        self._assembled = False

    def assemble(self) -> None:
        """Assemble the forces, unless they are known and cannot have changed."""
        if self._changes or not self._assembled:
            self.force.array[:] = 0
            self._add_forces()
            self.force.scatter_reverse(la.InsertMode.add)
            self._assembled = True

    def forget(self) -> None:
        """Assemble the force again when it is asked for, also if it is constant in a run."""
        self._assembled = False

    def path_average(self) -> Array:
        """The force (n,) [N], over owned and ghost unknowns, whose product with the change Δq of
        the coordinates is the work of the step; `force` has to be that of the end of the step.
        Collective.

        The midpoint rule does its work with the force at the middle of the step.  Of a force at the
        end of the step, the work along the straight path is taken, by Simpson's rule: exact for
        forces that are at most cubic in the coordinates, such as pressure.
        """
        end: Array = self.force.array.copy()
        α = self._at.α
        if not self.term.follows or α.value != 1:
            return end
        # α is a constant of the form: the same kernel gives the force anywhere on the path.
        average = end / 6
        for weight, position in ((1 / 6, 0.0), (4 / 6, 0.5)):
            α.value = position
            self.assemble()
            average += weight * self.force.array
        # Others read the force and α of the end of the step.
        α.value = 1.0
        self.force.array[:] = end
        return average


class PointForce(ABC):
    """Force on attached vectors, evaluated alike on every rank: the law of a `PointLoad`.

    Attributes:
        depends_on_position_only: whether it depends only on the configuration and time at which
            forces act; others have gradients as a `ForceOfStart` only.
    """

    depends_on_position_only: bool = False

    def begin(self, t: float, lag: float, X: Array, V: Array) -> None:
        """Start a step from the state at its beginning.

        Args:
            t: time [s] at the start of the step.
            lag: time [s] from there to the one at which forces act.
            X: k attached vectors (3k,), points [m] or directors [-], one after the other.
            V: their rates (3k,), [m/s] or [1/s].
        """
        return

    @abstractmethod
    def force(self, X: Array) -> Array:
        """Forces (3k,) at the configuration X (3k,) in which forces act."""

    @abstractmethod
    def tangent(self, X: Array) -> Array:
        """Derivatives (3k, 3k) of the forces by X (3k,)."""

    # ---- numbers that are parameters of its load -------------------------------------------------

    def get_number(self, key: str) -> Array:
        """The present value (m,) of a number or vector."""
        raise KeyError(key)

    def with_number(self, key: str, value: Array) -> PointForce:
        """The force with another value (m,)."""
        raise KeyError(key)

    def force_by_number(self, key: str, X: Array) -> Array:
        """Derivatives (3k, m) of the forces by a number, at the configuration X (3k,)."""
        raise KeyError(key)


class ForceOfStart(PointForce):
    """A force that depends also on the vectors and rates at the start of a step: of this step, or
    of an earlier one in which it stored numbers, such as the torque of a sampled control.

    The reversed step, whose `begin` has a negative `lag`, must not change these numbers.  In each
    step of a backward pass `work_by_number` is asked first: `products_at_start` adds the step to
    what `work_by_number` of earlier steps takes into account.
    """

    @abstractmethod
    def start_adjoint(self) -> None:
        """Forget all sums: a backward pass begins."""

    def work_by_number(self, key: str, X: Array, w: Array) -> Array:
        """Derivative (m,) of w·force by a number, of this step and of later ones."""
        raise KeyError(key)

    @abstractmethod
    def products_at_start(self, X: Array, w: Array) -> tuple[Array, Array]:
        """Derivatives (3k,) of w·force by the vectors and by the rates at the start of the step.

        X (3k,) is the configuration in which forces act, w (3k,) a displacement; the dependence on
        X is left out.
        """


class PointLoads(Differentiable, CompiledTerms["PointLoad"]):
    """All `PointLoad` terms of a scene: force f(X_mid) on attached vectors X = P q + o, work f·(X1
    - X0)."""

    is_external_load = True
    reversible = False
    has_shape_derivative = True

    def __init__(self, terms: Sequence[PointLoad], system: Assembly) -> None:
        """Compile all loads on points and directions of bodies, in the same order on all ranks:
        maps and indices that stay the same in a run.  Collective."""
        tuples = [(term.name, [term.ports]) for term in terms]
        refuse_ports_outside(system.comm, system.bodies, tuples)
        self._system = system
        self._terms = terms
        self._laws = [term.law for term in terms]
        attached = [attach(system.numbering, system.bodies, term.ports) for term in terms]
        # The vectors X (3k,) of a load are P q + o: a map P, its unknowns q, and an offset o
        # (ground).
        self._indices = [indices for indices, _, _ in attached]
        self._maps = [(P, o) for _, P, o in attached]
        # Every rank asks the laws, which may be functions of users; one rank adds the force.
        self._mine = [is_evaluated_here(term.ports) for term in terms]
        # Vectors at the start of the step; `begin_step` sets them.
        self._X0 = [o for _, o in self._maps]
        self._gather = Gather(system.numbering, self._indices)

    def _vectors(self, q: PETSc.Vec) -> list[Array]:
        """Vectors X = P q + o (3k,) of each load in a state q.  Collective."""
        return [P @ values + o for (P, o), values in zip(self._maps, self._gather(q), strict=True)]

    def _middle(self) -> list[Array]:
        """Vectors (3k,) of each load in the configuration in which forces act.  Collective."""
        α = self._system.rule.alpha
        ends = zip(self._X0, self._vectors(self._system.q1), strict=True)
        return [(1 - α) * X0 + α * X1 for X0, X1 in ends]

    def begin_step(self, t: float) -> None:
        """Give every load the vectors that it acts on, and their rates, at the start of the step.
        Collective."""
        system = self._system
        self._X0 = self._vectors(system.q0)
        # The vectors are X = P q + o with maps P and offsets o, and have the rates V = P dq/dt:
        # rates of the ports have no offset, as the ground does not move.
        rates = []
        for (P, _), values in zip(self._maps, self._gather(system.v0), strict=True):
            rates.append(P @ values)
        for law, X, V in zip(self._laws, self._X0, rates, strict=True):
            law.begin(system.time, system.rule.alpha * system.h, X, V)

    def add_forces(self, r: PETSc.Vec) -> None:
        """Subtract the forces Pᵀ f [N] of all loads from r."""
        for k, X in enumerate(self._middle()):
            if self._mine[k]:
                force = self._maps[k][0].T @ self._laws[k].force(X)
                r.setValues(self._indices[k], -force, addv=PETSc.InsertMode.ADD_VALUES)
        r.assemble()

    def add_tangents(self, A: PETSc.Mat) -> None:
        """Subtract the derivatives [N/m] of the loads from A."""
        for k, X in enumerate(self._middle()):
            if self._mine[k]:
                P, _ = self._maps[k]
                # The force acts at (1 - α) X0 + α X1, of which the derivative by X1 is α.
                K = -self._system.rule.alpha * P.T @ self._laws[k].tangent(X) @ P
                indices = self._indices[k]
                A.setValues(indices, indices, K, addv=PETSc.InsertMode.ADD_VALUES)

    # ---- sensitivities ---------------------------------------------------------------------------

    def get_number(self, term: PointLoad, key: str) -> Array:
        return np.array(self._laws[self._terms.index(term)].get_number(key), dtype=float)

    def set_number(self, term: PointLoad, key: str, value: Array) -> None:
        # Laws are values that scenes share: a changed number needs another law.
        changed = self._laws[self._terms.index(term)].with_number(key, np.array(value, dtype=float))
        self._laws[self._terms.index(term)] = changed
        # What saves the state of a run finds histories in terms.
        object.__setattr__(term, "law", changed)

    def work_by_number(self, term: PointLoad, key: str, w: PETSc.Vec) -> Array:
        """Loads are subtracted from the residual, hence the sign of -w·Pᵀ ∂f/∂number, with the
        forces f (3k,) on the vectors X = P q + o of the load."""
        k = self._terms.index(term)
        P, _ = self._maps[k]
        # Collective, so asked for on all ranks.
        vectors = P @ self._gather(w)[k]
        X = self._middle()[k]
        law = self._laws[k]
        if isinstance(law, ForceOfStart):
            work: Array = -law.work_by_number(key, X, vectors)
        else:
            work = -law.force_by_number(key, X).T @ vectors
        return work if self._mine[k] else np.zeros(len(work))

    def start_adjoint(self) -> None:
        for law in self._laws:
            if isinstance(law, ForceOfStart):
                law.start_adjoint()

    def add_start_derivatives(
        self, μ: PETSc.Vec, by_position: PETSc.Vec, by_velocity: PETSc.Vec
    ) -> None:
        """Derivatives of loads that depend on the start of the step, e.g. sampled torques of a
        control."""
        displacements = self._gather(μ)
        middle = self._middle()
        for k, law in enumerate(self._laws):
            if not isinstance(law, ForceOfStart):
                continue
            # All ranks, as all of them have the sums of the law.  P maps unknowns to vectors.
            P, _ = self._maps[k]
            by_vectors, by_rates = law.products_at_start(middle[k], P @ displacements[k])
            if not self._mine[k]:
                continue
            # Loads are subtracted from the residual.
            for vector, values in ((by_position, by_vectors), (by_velocity, by_rates)):
                entries = -P.T @ values
                vector.setValues(self._indices[k], entries, addv=PETSc.InsertMode.ADD_VALUES)
        by_position.assemble()
        by_velocity.assemble()

    def without_gradient(self) -> str:
        """A load that depends on velocities or on its history has none."""
        for term in self._terms:
            if not term.law.depends_on_position_only and not isinstance(term.law, ForceOfStart):
                return (
                    f"'{term.name}' depends on more than positions and time, "
                    "without derivatives by the start of a step; "
                    "give its law those of `gossamer_fx.extend.ForceOfStart`, "
                    "or leave it out of the scene"
                )
        return ""

    def wheel_momentum(self) -> Array:
        """Sum (3,) of the angular momenta [kg m²/s] of reaction wheels in the accepted state, this
        rank's share."""
        return np.zeros(3)

    def supplied(self) -> float:
        """Work [J] of the loads in the step, this rank's share."""
        total = 0.0
        ends = zip(self._X0, self._vectors(self._system.q1), self._middle(), strict=True)
        for k, (X0, X1, X) in enumerate(ends):
            if self._mine[k]:
                total += float(np.dot(self._laws[k].force(X), X1 - X0))
        return total

    def resultants(self) -> dict[str, Array]:
        """Resultants in the configuration in which the forces of the last step acted."""
        found: dict[str, Array] = {}
        for k, X in enumerate(self._middle()):
            if self._mine[k]:
                # Vectors r and forces f on them, (k, 3).
                term = self._terms[k]
                r = X.reshape(-1, 3)
                f = self._laws[k].force(X).reshape(-1, 3)
                # A force on a director is a couple: it has a moment, but pushes no point.
                pushed = np.array([translation_weight(port) for port in term.ports])
                total = np.array([pushed @ f, np.cross(r, f).sum(axis=0)])
                found[term.name] = found.get(term.name, 0.0) + total
        return found


@dataclass(frozen=True, eq=False)
class PointLoad:
    """A load on attached vectors; its work counts as supplied."""

    name: str
    ports: tuple[Attached, ...]
    law: PointForce
    parameters: tuple[Parameter, ...] = ()
    compiler: ClassVar[Compiler] = PointLoads

    def __post_init__(self) -> None:
        check(
            isinstance(self.law, PointForce),
            f"The law of the load '{self.name}' is a {type(self.law).__name__}; derive its class "
            "from gossamer_fx.extend.PointForce.",
        )


# ---- torques -------------------------------------------------------------------------------------


class Couple(PointForce):
    """A torque T on attached vectors r_i (directors, or arms between points): forces f_i = F × r_i
    with

        (tr S 1 - S) F = T,    S = Σ r_i r_iᵀ

    Then Σ r_i × f_i = T whatever the lengths and angles of the vectors, so the angular momentum
    grows by exactly hT also at the middle of a step, where directors are shorter than 1.  One
    vector alone takes the torque across it, f = T × r/|r|².
    """

    depends_on_position_only = True

    def __init__(self) -> None:
        # T [N m], which subclasses set.
        self.torque: Array = np.zeros(3)

    def _spread(self, r: Array) -> tuple[Array, Array]:
        """The matrix (tr S 1 - S)⁻¹ (3, 3) [1/m²] of the k attached vectors r (k, 3) [m], or
        directors without a unit, and its product F (3,) [N/m] with the torque.  `LinAlgError`: a
        single vector has no length, or several are parallel."""
        S = r.T @ r
        matrix = np.trace(S) * np.eye(3)
        # With one vector the matrix would be singular: S is left out, which gives T × r/|r|².
        if len(r) > 1:
            matrix = matrix - S
        inverse = np.linalg.inv(matrix)
        return inverse, inverse @ self.torque

    def forces_by_torque(self, X: Array) -> Array:
        """The matrix (3k, 3) of the forces on the vectors X (3k,), which are linear in the
        torque."""
        r = X.reshape(-1, 3)
        inverse, _ = self._spread(r)
        arms = np.hstack(tuple(cross_matrices(r)))
        return arms.T @ inverse

    def force(self, X: Array) -> Array:
        """Forces f_i (3k,) on the vectors X (3k,)."""
        r = X.reshape(-1, 3)
        return np.cross(self._spread(r)[1], r).ravel()

    def tangent(self, X: Array) -> Array:
        """Derivatives (3k, 3k) of the forces by the vectors X (3k,)."""
        r = X.reshape(-1, 3)
        inverse, F = self._spread(r)
        # Of f_i = F × r_i with F constant; the change of F follows.
        K: Array = np.kron(np.eye(len(r)), cross_matrices(F))
        for j, d in enumerate(r):
            # dS F for a change of vector j, and with it dF = -(tr S 1 - S)⁻¹ (tr dS F - dS F)
            change = 2 * np.outer(F, d)
            if len(r) > 1:
                change -= (d @ F) * np.eye(3) + np.outer(d, F)
            dF = -inverse @ change
            for i, other in enumerate(r):
                K[3 * i : 3 * i + 3, 3 * j : 3 * j + 3] -= cross_matrices(other) @ dF
        return K
