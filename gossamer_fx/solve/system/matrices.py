"""The matrices of a compiled scene: masses, constant stiffness, and the tangent of a step."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Never

import numpy as np
from dolfinx import fem
from petsc4py import PETSc

from gossamer_fx.core.model.body import Array, Body
from gossamer_fx.mechanics.terms.assembly import ActiveSet, CompiledTerms
from gossamer_fx.mechanics.terms.scalar_unknowns import ScalarUnknowns
from gossamer_fx.solve.system.tangent import Tangent
from gossamer_fx.solve.system.unknowns import Unknowns

SAME_PATTERN = PETSc.Mat.Structure.SAME_NONZERO_PATTERN


class Matrices:
    """Derivatives of the residual of a scene with respect to its unknowns.

    Attributes:
        scalars: gas networks and the like, each with its part of all scalar unknowns.
        scalar_count: number of all scalar unknowns.
        A: tangent [N/m] of the coordinates without couplings of active sets.
        K: constant stiffness [N/m], None if no term has one.
        coupled_tangent: A with the couplings of active sets.
    """

    A: PETSc.Mat
    K: PETSc.Mat | None
    coupled_tangent: Tangent

    def __init__(
        self,
        unknowns: Unknowns,
        compiled: Sequence[CompiledTerms[Never]],
        active_sets: Sequence[ActiveSet],
    ) -> None:
        self._unknowns = unknowns
        self._compiled = compiled
        self._active_sets = active_sets
        self._with_tangents = defining("add_tangents", compiled)
        self._with_forms = defining("tangent_forms", compiled)
        self.scalars: list[tuple[ScalarUnknowns, slice]] = []
        self.scalar_count = 0
        # c M + α K, with the factor c [1/s²] of the inertia and the weight α [-] of the end of a
        # step in the point at which forces act: it is the same for all tangents of steps of one
        # length.
        self._base: PETSc.Mat | None = None
        self._base_inertia = 0.0

    def add_scalars(self, scalars: ScalarUnknowns) -> None:
        """Count scalar unknowns behind those that are there."""
        start = self.scalar_count
        self.scalar_count += scalars.size
        self.scalars.append((scalars, slice(start, self.scalar_count)))

    def build(self, add_entries: Callable[[PETSc.Mat], None] | None = None) -> None:
        """Make the mass matrix M [kg], the constant stiffness K [N/m] if there is one, and the
        tangent A, which is not assembled.  Collective.

        All have one pattern and are duplicates of one matrix: PETSc 3.22 multiplies those by BLAS,
        in half of the time of its kernel for blocks of three.  The pattern of A is fixed: an entry
        outside it raises an error of PETSc.

        Args:
            add_entries: adds more entries of the pattern to a matrix, as zeros.
        """
        pattern = self._unknowns.numbering.matrix()
        for compiled in self._compiled:
            compiled.add_mass(pattern)
        for compiled in self._compiled:
            compiled.add_stiffness(pattern)
        self._add_tangents(pattern)
        if add_entries is not None:
            add_entries(pattern)
        # All that rows of fixed coordinates keep is the diagonal.
        diagonal = self._unknowns.numbering.vector()
        pattern.setDiagonal(diagonal, addv=PETSc.InsertMode.ADD_VALUES)
        pattern.assemble()
        self._unknowns.M = pattern.duplicate()
        self.A = pattern.duplicate()
        has_stiffness = any(compiled.has_constant_stiffness for compiled in self._compiled)
        self.K = pattern.duplicate() if has_stiffness else None
        self._base = pattern.duplicate() if has_stiffness else None
        self._base_inertia = 0.0
        self._unknowns.numbering.fix_pattern(self.A)
        self._assemble_constant()
        self.coupled_tangent = Tangent(self.A, self._active_sets)

    def _assemble_constant(self) -> None:
        """Add masses and constant stiffnesses to M and K, which are zero."""
        M = self._unknowns.M
        for compiled in self._compiled:
            compiled.add_mass(M)
        M.assemble()
        if self.K is not None:
            for compiled in self._compiled:
                compiled.add_stiffness(self.K)
            self.K.assemble()

    def extend_pattern(self, add_entries: Callable[[PETSc.Mat], None]) -> None:
        """Make all matrices again, with more entries in their pattern, which `add_entries` adds to
        a matrix as zeros, e.g. for a solver that stores more in a copy.  Collective."""
        # On several ranks PETSc would hold what Python drops.
        for matrix in (self._unknowns.M, self.A, self.K, self._base):
            if matrix is not None:
                matrix.destroy()
        self.build(add_entries)

    def assemble_again(self) -> None:
        """Assemble M and K again in place, after coefficients have changed.  Collective."""
        self._unknowns.M.zeroEntries()
        if self.K is not None:
            self.K.zeroEntries()
            # No step has an infinite c, so that the base is built at the next tangent.
            self._base_inertia = math.inf
        self._assemble_constant()
        self._unknowns.increment.mass_changed()

    # ---- the tangent -----------------------------------------------------------------------------

    def tangent(self) -> PETSc.Mat:
        """The sum of `assemble_tangent` as one matrix [N/m]: A itself, which the next assembly
        overwrites, or a new matrix if pairs of contact are active.  Collective."""
        return self.assemble_tangent().whole()

    def assemble_tangent(self) -> Tangent:
        """Derivative [N/m] of the residual of the coordinates by q1, at the last residual: c M + α
        K and the tangents of all terms, in a matrix of fixed pattern, and coupling matrices of
        contact pairs.

        Rows and columns of fixed coordinates are those of the unit matrix.  The object is the same
        in every call, and is overwritten by the next one.  Collective.
        """
        self._assemble()
        self._unknowns.supports.clear(self.A, 1.0)
        self.coupled_tangent.fetch_couplings()
        return self.coupled_tangent

    def tangent_with_supports(self) -> PETSc.Mat:
        """The tangent [N/m] with the rows and columns of fixed coordinates, which are forces on
        supports; without pairs of contact.  It is A, which the next assembly overwrites.
        Collective."""
        self._assemble()
        return self.A

    def _assemble(self) -> None:
        """Assemble A with all rows.  Collective."""
        M = self._unknowns.M
        c = self._unknowns.increment.c
        if self._base is None:
            # Without constant stiffness the base would be a copy of c M.
            M.copy(self.A, SAME_PATTERN)
            self.A.scale(c)
        else:
            # c changes with the length of the step only.
            if self._base_inertia != c:
                M.copy(self._base, SAME_PATTERN)
                self._base.scale(c)
                self._base.axpy(self._unknowns.rule.alpha, self.K, SAME_PATTERN)
                self._base_inertia = c
            self._base.copy(self.A, SAME_PATTERN)
        self._add_tangents(self.A)
        self.A.assemble()

    def tangent_forms(self, body: Body) -> list[fem.Form]:
        """Compiled bilinear forms that add up to the tangent of a body on a mesh, of all terms."""
        return [form for compiled in self._with_forms for form in compiled.tangent_forms(body)]

    def _add_tangents(self, A: PETSc.Mat) -> None:
        """Add to A the tangents of forms on meshes, of terms with arrays, and of scalar
        unknowns."""
        for body, at in self._unknowns.coordinates.items():
            at.assemble(A, self.tangent_forms(body), self._unknowns.block(body))
        for compiled in self._with_tangents:
            compiled.add_tangents(A)
        for scalars, _ in self.scalars:
            scalars.add_tangents(A)

    def coupling(self) -> tuple[list[Array | None], list[Array | None], Array]:
        """Coupling of all m scalar unknowns y, such as gas pressures, with the coordinates in the
        tangent: this rank's parts (n,) of the m columns ∂r/∂y and of the m rows ∂s/∂q1, None where
        zero, with zeros at fixed coordinates; and ∂s/∂y (m, m), of residuals r and s."""
        columns: list[Array | None] = []
        rows: list[Array | None] = []
        corner = np.zeros((self.scalar_count, self.scalar_count))
        for scalars, part in self.scalars:
            own_columns, own_rows, corner[part, part] = scalars.coupling()
            columns += own_columns
            rows += own_rows
        for vector in columns + rows:
            if vector is not None:
                vector[self._unknowns.supports.held] = 0
        return columns, rows, corner

    def gyroscopic(self, spin: tuple[float, float, float]) -> PETSc.Mat:
        """A new matrix [kg/s] of the Coriolis force in a frame that turns with `spin` [rad/s].
        Collective."""
        G = self.A.duplicate()
        # The Coriolis force couples components that the tangent may not couple.
        G.setOption(PETSc.Mat.Option.NEW_NONZERO_LOCATION_ERR, False)
        for compiled in self._compiled:
            compiled.add_gyroscopic(G, spin)
        G.assemble()
        return G


def defining(method: str, compiled: Sequence[CompiledTerms[Never]]) -> list[CompiledTerms[Never]]:
    """The compiled terms that define a method of the contract, whose default does nothing."""
    default = getattr(CompiledTerms, method)
    return [each for each in compiled if getattr(type(each), method) is not default]
