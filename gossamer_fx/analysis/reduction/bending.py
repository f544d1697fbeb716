"""Bending of a reduced plate: a polynomial of the coefficients of its modes.

The bending energy of a plate is ½ a(x, x), the same form for each component of the positions, and
with a rest curvature the integral of triple products of vectors that are linear in the positions
(`bodies.plate`).  For x = Σ φ_i c_i it is therefore, with no other error than that of the modes,

    E(c) = ½ Σ_ij B_ij c_i·c_j + Σ_ijk A_ijk (c_i×c_j)·c_k + constant                      (1)

with B symmetric and A antisymmetric in any two indices.  Both are taken once from second
derivatives of the energy on the whole mesh: B where all positions are zero, A where x = φ_k e_3.
No sampling of cells takes part, and a step does not depend on the mesh.

The first part is a constant stiffness.  Of the second, C(c) = t(c, c, c) with a symmetric trilinear
t, the gradient at the middle m of a step keeps both momenta, but misses the energy C(Δ)/4 of the
change Δ = c1 - c0.  Let P take the rotation out of a change, or the moment out of forces,

    P v = v - ω × m,    ω = (Σ_i |m_i|² 1 - m_i m_iᵀ)⁻¹ Σ_i m_i × v_i                          (2)

and let R = Δ - PΔ be the rotation in Δ.  As C(R) = 0, for all R_i are perpendicular to ω,

    k = ¼ (t(Δ, Δ, ·) + t(Δ, R, ·) + t(R, R, ·)),    k·PΔ = C(Δ)/4,    forces P k               (3)

give the energy back.  P is symmetric, so that their work is Pk·Δ = k·PΔ; they have no moment, and
are smooth functions of the coefficients.  The constant mode has no bending.  The tangent leaves
them out: they are of second order in the step.

Energy along the changes of the products c_i·c_j, as in `triple_products`, is conserved, too, but
those forces are not smooth where a film turns by more than it bends: in steps of 12° Newton's
method took 17 iterations and 16 rejected steps in half a turn of the demo `ikaros_devices`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import ufl
from dolfinx import fem
from petsc4py import PETSc
from ufl.algorithms import expand_derivatives

from gossamer_fx.analysis.reduction.basis import Basis
from gossamer_fx.analysis.reduction.reduced_energies import (
    add_full_block,
    coordinates_of,
    projected,
)
from gossamer_fx.core.algebra.rotations import cross_matrices
from gossamer_fx.core.forms.compilation import compile_form
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.model.body import Array, Body
from gossamer_fx.core.model.state import InitialState
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.bodies.triple_products import TripleProductEnergy
from gossamer_fx.mechanics.terms.assembly import Assembly, CompiledTerms, Compiler
from gossamer_fx.mechanics.terms.quadratic_energies import QuadraticEnergy


@dataclass(frozen=True, eq=False)
class ModalBending:
    """The numbers of (1): `stiffness` B (r, r) [N/m]; `rest` A (r, r, r) [N/m²], None without rest
    curvature; `constant` [J]."""

    stiffness: Array
    rest: Array | None
    constant: float

    def _third(self, a: Array, b: Array) -> Array:
        """t(a, b, ·) (r, 3) of the cubic part, of coefficients (r, 3) each; its gradient is 3 t(c,
        c, ·)."""
        r = len(a)
        if self.rest is None:
            return np.zeros((r, 3))
        products = np.cross(a[:, None], b[None])
        return self.rest.reshape(r, r * r) @ products.reshape(r * r, 3)

    def energy(self, c: Array) -> float:
        """Bending energy (1) [J] of coefficients c (r, 3) [m]."""
        quadratic = float(np.sum(c * (self.stiffness @ c))) / 2
        return quadratic + float(np.sum(c * self._third(c, c))) + self.constant

    def rest_forces(self, start: Array, end: Array, alpha: float, conserves: bool) -> Array:
        """Forces (r, 3) [N] of the cubic part in a step between coefficients (r, 3) [m] that acts
        at the weight `alpha` of the end; with (3) if it `conserves` energy."""
        if self.rest is None:
            return np.zeros_like(start)
        middle = (1 - alpha) * start + alpha * end
        forces = 3 * self._third(middle, middle)
        if conserves:
            change = end - start
            turning = rotation(middle, change)
            missing = self._third(change, change + turning) + self._third(turning, turning)
            forces += (missing - rotation(middle, missing)) / 4
        return forces

    def rest_stiffness(self, c: Array) -> Array:
        """Second derivatives (3r, 3r) [N/m] of the cubic part, which there is."""
        assert self.rest is not None
        size = c.size
        vectors: Array = np.einsum("ijk,jx->ikx", self.rest, c, optimize=True)
        blocks = 6 * cross_matrices(vectors.reshape(-1, 3)).reshape(len(c), len(c), 3, 3)
        return blocks.swapaxes(1, 2).reshape(size, size)


def rotation(m: Array, v: Array) -> Array:
    """The part ω × m_i of vectors v (r, 3) in (2), without that of the constant mode."""
    arms = m.copy()
    arms[0] = 0.0
    inertia = np.sum(arms * arms) * np.eye(3) - arms.T @ arms
    # A film that is a line has no moment of inertia about it.
    ω = np.linalg.lstsq(inertia, np.cross(arms, v).sum(axis=0))[0]
    return np.asarray(np.cross(ω, arms))


def bending_energy(film: Membrane, x: Expr) -> ufl.Form:
    """The bending energy [J] of the whole film at positions x, an empty form without bending."""
    energy = ufl.Form([])
    for term in film.terms(InitialState([film], film.comm)):
        if isinstance(term, QuadraticEnergy):
            energy += 0.5 * term.form(x, x)
        elif isinstance(term, TripleProductEnergy):
            energy += term.energy(x)
    return energy


def bending_of_modes(basis: Basis) -> ModalBending | None:
    """The numbers of (1) for the modes of a film; None if it does not bend.  Collective."""
    film = basis.film
    modes = basis.values
    x = fem.Function(film.space)
    energy = bending_energy(film, x)
    if energy.empty():
        return None
    first = ufl.derivative(energy, x, ufl.TestFunction(film.space))
    second = ufl.derivative(first, x, ufl.TrialFunction(film.space))
    form = compile_form(second)
    matrix = fem.create_matrix(form)

    def second_derivatives() -> Array:
        """Second derivatives (r, 3, r, 3) by the coefficients, at the positions x."""
        matrix.set_value(np.float64(0))
        fem.assemble_matrix(matrix, form)  # type: ignore[arg-type]
        return film.comm.allreduce(projected(matrix, modes))

    stiffness = second_derivatives()[:, 0, :, 0]
    # Without round-off: uniform displacements have no forces.
    stiffness[0] = 0.0
    stiffness[:, 0] = 0.0
    constant = film.comm.allreduce(float(fem.assemble_scalar(compile_form(energy))))
    # Without a rest curvature the energy has no derivative of third order.
    rest = None
    if x in expand_derivatives(second).coefficients():
        rest = np.zeros(3 * (basis.size,))
        for k in range(1, basis.size):
            x.x.array.reshape(-1, 3)[:, 2] = modes[:, k]
            # The derivative along φ_i e_1 and φ_j e_2 is 6 A_ijk.
            rest[1:, 1:, k] = second_derivatives()[1:, 0, 1:, 1] / 6
    return ModalBending((stiffness + stiffness.T) / 2, rest, constant)


class BendingsOfModes(CompiledTerms["BendingOfModes"]):
    """All `BendingOfModes` terms of a scene.  Rank 0, which has the coefficients, does the work."""

    has_constant_stiffness = True

    def __init__(self, terms: Sequence[BendingOfModes], system: Assembly) -> None:
        self._system = system
        self._terms = terms if system.comm.rank == 0 else ()
        self._names = [term.name for term in terms]
        # Coefficients (r, 3) [m] of each body at the start of the step and of the iterate
        self._start: dict[Body, Array] = {}
        self._end: dict[Body, Array] = {}

    def update(self, linearly: bool) -> None:
        for term in self._terms:
            # A copy: they may be a view of a vector that changes.
            self._end[term.body] = coordinates_of(self._system, term.body).end.copy()

    def commit(self) -> None:
        self._start = dict(self._end)

    def add_stiffness(self, K: PETSc.Mat) -> None:
        for term in self._terms:
            full = np.kron(term.bending.stiffness, np.eye(3))
            add_full_block(K, self._system.block(term.body), full)

    def add_forces(self, r: PETSc.Vec) -> None:
        rule = self._system.rule
        with r as values:
            for term in self._terms:
                forces = term.bending.rest_forces(
                    self._start[term.body], self._end[term.body], rule.alpha, rule.conserves
                )
                values[self._system.block(term.body).owned] += forces.ravel()

    def add_tangents(self, A: PETSc.Mat) -> None:
        alpha = self._system.rule.alpha
        for term in self._terms:
            if term.bending.rest is None:
                continue
            middle = (1 - alpha) * self._start[term.body] + alpha * self._end[term.body]
            K = alpha * term.bending.rest_stiffness(middle)
            add_full_block(A, self._system.block(term.body), K)

    def energies(self) -> dict[str, float]:
        found = dict.fromkeys(self._names, 0.0)
        for term in self._terms:
            found[term.name] = term.bending.energy(self._start[term.body])
        return found


@dataclass(frozen=True, eq=False)
class BendingOfModes:
    """The bending energy of a reduced plate."""

    name: str
    body: Body
    bending: ModalBending
    compiler: ClassVar[Compiler] = BendingsOfModes
