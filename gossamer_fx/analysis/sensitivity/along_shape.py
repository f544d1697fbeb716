"""Derivatives of u·K u for a given shape u, with the stiffness K of an equilibrium r(q, θ) = 0.

K is the second derivative of an energy, so that its derivatives are those of r along u:

    ∂(u·K u)/∂q = d/dε K(q + ε u) u,    ∂(u·K u)/∂θ = d/dε u·∂r/∂θ(q + ε u)                     (1)

Both are central differences, exact where K is quadratic in the coordinates, as that of a film with
a linear law: so what derives forces derives stiffnesses, too, of all parts of a scene.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.lookups import check_no_contact, check_no_gas
from gossamer_fx.solve.system.system import System

# Largest change of a coordinate in the differences, over the extent of the scene.
STEP_RATIO = 1e-5

# Largest |Ku - Kᵀu| over |Ku|.  Loads that follow the film make K unsymmetric.
MAX_ASYMMETRY = 1e-8


class StiffnessAlong:
    """The derivatives of c u·K u at the equilibrium in which a system stands.

    Args:
        system: without inertia.
        shape: u, which is copied.
        factor: c.
        what: the result, for messages.

    Raises:
        InputError: K is not symmetric, or the scene has contact or scalar unknowns.

    All methods are collective.
    """

    def __init__(self, system: System, shape: PETSc.Vec, factor: float, what: str) -> None:
        check_no_gas(system, what, "by whose state it is not derived")
        check_no_contact(system, what, "with which stiffnesses have no derivative")
        self._system = system
        self._shape = shape.copy()
        self._factor = factor
        own = float(np.abs(shape.array_r).max(initial=0.0))
        largest = system.comm.allreduce(own, op=MPI.MAX)
        self._step = STEP_RATIO * _extent(system) / largest
        self._check_symmetric(what)

    def _check_symmetric(self, what: str) -> None:
        """Raise `InputError` if |K u - Kᵀ u| is more than round-off of |K u|."""
        K = self._system.matrices.tangent()
        force, transposed = K.createVecs()
        K.mult(self._shape, force)
        K.multTranspose(self._shape, transposed)
        transposed.axpy(-1.0, force)
        check(
            transposed.norm() <= MAX_ASYMMETRY * force.norm(),
            f"{what}: loads make the stiffness unsymmetric, so that it has no derivative here; "
            "hold the rim of what is under pressure.",
        )

    def _shifted(self, sign: float) -> PETSc.Vec:
        """q + ε u or q - ε u, a new vector."""
        q = self._system.unknowns.q0.copy()
        q.axpy(sign * self._step, self._shape)
        return q

    def add_by_position(self, by_position: PETSc.Vec) -> None:
        """Add the derivative by the coordinates, zero at fixed ones."""
        product = self._shape.duplicate()
        for sign in (1.0, -1.0):
            self._stand_at(self._shifted(sign))
            self._system.matrices.tangent().mult(self._shape, product)
            product.array[self._system.unknowns.supports.held] = 0.0
            by_position.axpy(sign * self._factor / (2 * self._step), product)
        self._stand_at(self._system.unknowns.q0)
        # Others hold the matrix.
        self._system.matrices.tangent()
        product.destroy()

    def _stand_at(self, q: PETSc.Vec) -> None:
        """Set the coordinates at which tangents are taken, without inertia."""
        equations = self._system.equations
        equations.set_inertia(0.0)
        equations.set_end(q)
        residual = q.duplicate()
        equations.residual(np.zeros(0), residual)
        residual.destroy()

    def residual_parts(self) -> list[tuple[PETSc.Vec, PETSc.Vec]]:
        """Coordinates q and weights w with c u·∂K/∂θ u = Σ w·∂r/∂θ(q)."""
        parts = []
        for sign in (1.0, -1.0):
            weights = self._shape.copy()
            weights.scale(sign * self._factor / (2 * self._step))
            parts.append((self._shifted(sign), weights))
        return parts


def _extent(system: System) -> float:
    """Largest side of the box around all bodies [m], one for a point.  Collective."""
    positions = [system.unknowns.state[body].positions() for body in system.unknowns.bodies]
    points = np.concatenate([np.zeros((0, 3)), *positions])
    low = points.min(axis=0, initial=np.inf)
    high = points.max(axis=0, initial=-np.inf)
    system.comm.Allreduce(MPI.IN_PLACE, low, op=MPI.MIN)
    system.comm.Allreduce(MPI.IN_PLACE, high, op=MPI.MAX)
    return float((high - low).max()) or 1.0
