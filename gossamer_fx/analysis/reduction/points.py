"""The quadrature points of a reduced film: gradients of the modes, strains, forces and stiffness.

With the gradients G_a = ∂φ/∂X_a (q, r) of r modes at q quadrature points, a = 1, 2 along the film's
frame, the images of the frame vectors are

    F_a = G_a c                                                                             (1)

A stress S (3,) with the derivatives D = ∂S/∂E gives the coefficients the stiffness

    K = Σ_ac G_aᵀ T_ac G_c,     T_ac = (Σ_bd D_abcd F_b ⊗ F_d + S_ac 1) dA                  (2)

T does not depend on the number of modes: it is computed once at each point, and (2) is a product of
full matrices.

Problem.  A reduced film has some hundred to some thousand quadrature points.  Evaluating products
of small matrices there by NumPy costs more in calls than in arithmetic.

Idea.  In a run (`Points`) the kernel of `points.c` computes strains, forces N and products T G (see
`reduced_energies`) at the points; the law is evaluated by `terms.law_kernel`, as that of a full
film.  Python multiplies with the gradients of the modes, before and after, as full matrices.

Limits.  These are the strains of a `Membrane`.  Those of a plate, `forms.tied_strain`, are not of
the form (1) at one point: a reduced plate takes forms on the mesh of its sampled cells.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import basix
import numpy as np
import ufl
from dolfinx import fem

from gossamer_fx.core.forms.backend import evaluate
from gossamer_fx.core.forms.c_source import CStruct, c_library
from gossamer_fx.core.forms.compilation import compile_expression
from gossamer_fx.core.model.body import Array, Indices
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.terms.law_kernel import LawFunctions, PointLaw, PointValues


def own_cells(film: Membrane) -> Indices:
    """Local numbers of the cells that this rank owns."""
    count = film.space.mesh.topology.index_map(2).size_local
    return np.arange(count, dtype=np.int32)


def points_and_areas(film: Membrane) -> tuple[Array, Array]:
    """Quadrature points (p, 2) of the reference triangle, and the reference areas dA (cells, p)
    [m²] of this rank's own cells that they stand for."""
    degree = film.dx.metadata()["quadrature_degree"]
    points, weights = basix.make_quadrature(basix.CellType.triangle, degree)
    points = np.asarray(points, dtype=np.float64)
    weights = np.asarray(weights, dtype=np.float64)
    mesh = film.space.mesh
    cells = own_cells(film)
    determinant = compile_expression(ufl.JacobianDeterminant(mesh), points)
    values = evaluate(determinant, mesh, cells)
    values = values.reshape(len(cells), len(points))
    # The determinant is negative in cells whose corners are numbered clockwise.
    return points, abs(values) * weights


def mode_gradients(film: Membrane, φ: Array, points: Array) -> Array:
    """Gradients ∂φ_i/∂X_a (q, 2, r) [1/m] of modes φ (nodes, r) in the film's frame, two unit
    vectors in the plane of each cell, at points (p, 2) of own cells; q = cells · p."""
    cells = own_cells(film)
    r = φ.shape[1]
    q = len(cells) * len(points)
    # The deformation gradient of a motion has the gradients of its components: three modes at once.
    motion = fem.Function(film.space)
    gradient = compile_expression(film.deformation(motion), points)
    # Filled up with zeros to a multiple of three.
    motions = math.ceil(r / 3)
    padded = np.zeros((len(φ), 3 * motions))
    padded[:, :r] = φ
    found = np.empty((q, 2, r))
    for first in range(0, r, 3):
        three_modes = padded[:, first : first + 3]
        motion.x.array[:] = three_modes.ravel()
        values = evaluate(gradient, film.space.mesh, cells)
        values = values.reshape(q, 3, 2)
        count = min(3, r - first)
        found[..., first : first + count] = values[:, :count].swapaxes(1, 2)
    return found


def initial_strains(film: Membrane, points: Array) -> Array:
    """The initial strain (q, 3) of a film at points (p, 2) of own cells; q = cells · p."""
    cells = own_cells(film)
    initial = film.initial_strain
    if initial is None:
        return np.zeros((len(cells) * len(points), 3))
    values = evaluate(compile_expression(initial, points), film.space.mesh, cells)
    return values.reshape(-1, 3)


# The C functions of these points.
HEADER = Path(__file__).parent / "points.h"

# Numbers of a stress (3) and its derivatives (9)
RESPONSE = 12


class Points:
    """The quadrature points of a rank's own cells: p in each cell, q in all.

    They have reference areas dA (cells, p) [m²], times the weights of sampled cells; gradients G
    (q, 2, r) [1/m] of the modes; strains (q, 3) at the start of the last step, `past`, of this
    step, `start`, and of the iterate, `strain`; and as `response` (q, 12) the mean stress S_mean
    [N/m] (3) from start to strain, and its derivatives by the strain (9).  Strains contain the
    `initial` ones (q, 3).  `may_choose` is that of `terms.law_kernel.PointLaw`.
    """

    def __init__(
        self,
        functions: LawFunctions,
        cells: Indices,
        dA: Array,
        G: Array,
        initial: Array,
        *,
        may_choose: bool,
    ) -> None:
        self._c = c_library(HEADER, functions.strain.function_space.mesh.comm)
        q, _, self._r = G.shape
        self._initial = initial
        self.past = np.zeros((q, 3))
        self.start = np.zeros((q, 3))
        self.strain = np.zeros((q, 3))
        self.response = np.zeros((q, RESPONSE))
        rows = np.arange(q, dtype=np.int32).reshape(dA.shape)
        values = PointValues(self.start, self.strain, self.response, rows)
        self.law = PointLaw(functions, values, cells, may_choose=may_choose)
        self._linear_strain = np.zeros((q, 3))
        self._density = np.zeros(q)
        self._set_density = self.law.density_in(self._density)
        self._G = np.ascontiguousarray(G).reshape(2 * q, self._r)
        self._dA = dA.ravel()
        # Gradients at the start and at the end of the step; forces N and products T G (module
        # `reduced_energies`)
        self._F0: Array = np.zeros((2 * q, 3))
        self._F: Array = np.zeros((2 * q, 3))
        self._N = np.zeros((2 * q, 3))
        self._TG = np.zeros((2 * q, 9 * self._r))
        self._struct = self._c.struct(
            "point_stresses",
            {
                "count": q,
                "dA": self._c.array("dA", self._dA, "float64", (q,)),
                "initial": self._c.array("initial", initial, "float64", (q, 3)),
                "strain": self._c.array("strain", self.strain, "float64", (q, 3)),
                "response": self._c.array("response", self.response, "float64", (q, RESPONSE)),
            },
        )
        self._stresses = self._struct.pointer

    def move(self, c: Array) -> None:
        """Set the gradients (2q, 3) of the shape with coefficients c (r, 3) [m] at the end of the
        step. Strains and stresses stay as they are until `linearise` or `set_true_strains`."""
        self._F = self._G @ c

    def keep(self) -> None:
        """Accept a step: its end is the start of the next one."""
        # The kernel has the addresses of `start`: it is written to, not replaced.
        self.past[:] = self.start
        self.start[:] = self.strain
        self._F0 = self._F

    def set_true_strains(self) -> None:
        """Set the strains of the gradients, and the responses at them."""
        self._set_strains(self.strain, None)
        self.law.respond()

    def linearise(self, change: Array) -> None:
        """Set the strains of the next Newton iterate linearly from the last one, and evaluate the
        law there.

        The first strains of a step continue those of the last step, 2 e0 - e_past.  A small basis
        has no modes that alternate from step to step, unlike a full film, and a sail takes half an
        iteration less."""

        def linear_strain() -> Array:
            self._set_strains(self._linear_strain, change)
            return self._linear_strain

        self.law.linearise(linear_strain, first_guess=lambda: 2 * self.start - self.past)

    def _set_strains(self, strains: Array, change: Array | None) -> None:
        """Set `strains` (q, 3): at the gradients of `move` the true ones if `change` is None, else
        those linearised by a change (r, 3) [m] of the coefficients, which has led there."""
        dF = None
        if change is not None:
            dF = self._G @ change
        out = self._c.array("strains", strains, "float64", self.strain.shape, writable=True)
        count = len(strains)
        self._c.lib.strains(count, self._images(self._F), self._images(dF), out)
        strains += self._initial

    def energy(self) -> float:
        """Stored energy [J] of this rank's cells at the start of the step."""
        self._set_density()
        return float(self._density @ self._dA)

    def forces(self, α: float) -> Array:
        """Forces f = Gᵀ N (r, 3) [N] on the coefficients, the sum over this rank's cells.  N (2q,
        3) [N m] is the stress times the area and the gradients of the shape at the weight α of the
        rule."""
        N = self._c.array("N", self._N, "float64", self._N.shape, writable=True)
        self._c.lib.forces(self._stresses, self._gradients(α).pointer, N)
        return self._G.T @ self._N

    def stiffness(self, α: float, share: float) -> Array:
        """Derivatives K = Gᵀ (T G) (3r, 3r) [N/m] of the forces by the coefficients of the end of a
        step, which has the weight α in the rule; the geometric stiffness has the weight `share`,
        from 0 to α."""
        r = self._r
        self._c.lib.stiffness_times(
            self._stresses,
            self._gradients(α).pointer,
            share,
            r,
            self._c.array("G", self._G, "float64", self._G.shape),
            self._c.array("TG", self._TG, "float64", self._TG.shape, writable=True),
        )
        K: Array = (self._G.T @ self._TG).reshape(r, 3, 3, r)
        return K.swapaxes(2, 3).reshape(3 * r, 3 * r)

    def _gradients(self, α: float) -> CStruct:
        """The gradients at both ends of the step, and the weight α of the end."""
        members = {"F0": self._images(self._F0), "F": self._images(self._F), "alpha": α}
        return self._c.struct("point_gradients", members)

    def _images(self, F: Array | None) -> Any:
        """Images of the frame vectors (2q, 3), or their changes, as an argument of a C function;
        None is a null pointer."""
        return self._c.array("F", F, "float64", self._N.shape)
