"""Domain decomposition by PETSc's BDDC and FETI-DP: one subdomain on each rank.

Problem.  The factorisation of a large matrix scales badly with the number of ranks.

Idea.  The tangent is the sum of the contributions of the ranks' own cells and is never assembled across
ranks.  A rank factorises its own part, and a small coarse problem of corner values and edge averages
connects the subdomains.  The number of Krylov iterations then hardly grows with the number of subdomains
and of cells.

- FETI-DP enforces continuity by Lagrange multipliers and solves for those (Farhat et al., IJNME 50 (2001)
  1523, doi:10.1002/nme.76).
- BDDC is its primal counterpart (Dohrmann, SIAM J. Sci. Comput. 25 (2003) 246,
  doi:10.1137/S1064827502412887).

Limits.  A single body on a mesh, without forces and constraints between points and without gas.  In a
film that is wrinkled everywhere only BDDC keeps the number of iterations: FETI-DP needs several times as
many and may fail, more often with more subdomains.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from dolfinx import fem, la
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import bsr_matrix, csr_matrix

from gossamer_fx.algebra.numbering import PREFIX
from gossamer_fx.checks.errors import check
from gossamer_fx.forms.spaces import cell_nodes
from gossamer_fx.model.body import has_nodal_unknowns
from gossamer_fx.system.system import System

METHODS = ("bddc", "fetidp")

# Krylov iterations of a solve: several times what BDDC takes with 16 subdomains.
MAX_KSP_ITERATIONS = 300

# Relative tolerance of BDDC's iteration, whose residual is that of the forces.
BDDC_RTOL = 1e-3

# Relative tolerance of FETI-DP's iteration, whose residual is that of the preconditioned equations of
# the multipliers: in a wrinkled film the forces have errors that are larger by orders of magnitude.
FETIDP_RTOL = 1e-6

# PETSc's options of the multipliers' solver.  The tangent may be unsymmetric, hence GMRES; with PETSc's
# default of a restart after 30 iterations it may not converge.
FETIDP_OPTIONS = {
    "fetidp_ksp_type": "gmres",
    "fetidp_ksp_gmres_restart": str(MAX_KSP_ITERATIONS),
}


class Subdomains:
    """The tangent of one body on a mesh as the sum of the ranks' parts.

    Args:
        system: compiled scene.

    Attributes:
        matrix: PETSc's matrix of the parts, of type "is".

    Raises:
        InputError: the scene has more than one body, or forces and constraints between points, or gas.
    """

    def __init__(self, system: System) -> None:
        """Check that the scene is one body of forms, and divide its matrix by ranks.

        Collective.
        """
        bodies = system.bodies
        check(
            len(bodies) == 1 and has_nodal_unknowns(bodies[0]) and system.is_made_of_forms,
            "subdomains: they divide a single film, cable or beam without joints, springs and gas; leave the option "
            "subdomains out for this scene.",
        )
        self._system = system
        [body] = bodies
        self._tangents = with_matrices(system.tangent_forms(body))
        self._find_nodes()
        self._mass = self._sum_of_own_cells(with_matrices(system.mass_forms(body)))
        self.matrix = self._distributed_matrix()

    def _find_nodes(self) -> None:
        """The nodes of this rank's own cells.

        Ghost nodes that only ghost cells touch would make this rank's part of the matrix singular.
        """
        space = self._system.fields[self._system.bodies[0]].q0.function_space
        topology = space.mesh.topology
        own_cells = topology.index_map(topology.dim).size_local
        self._nodes = np.unique(cell_nodes(space)[:own_cells])
        self._size = space.dofmap.index_map_bs  # unknowns of a node
        components = np.arange(self._size)
        self._unknowns = (self._nodes[:, None] * self._size + components).ravel()

    def _distributed_matrix(self) -> PETSc.Mat:
        """An empty matrix of parts with the numbering of the system."""
        numbering = self._system.numbering
        # Numbers of blocks of unknowns, which PETSc's mapping counts, from those of their first unknowns.
        first_unknowns = numbering.indices[0][self._size * self._nodes]
        blocks = (first_unknowns // self._size).astype(PETSc.IntType)
        mapping = PETSc.LGMap().create(blocks, bsize=self._size, comm=numbering.comm)
        sizes = (numbering.size_local, numbering.size)
        matrix = PETSc.Mat().create(numbering.comm)
        matrix.setSizes((sizes, sizes))
        matrix.setType("is")
        matrix.setBlockSize(self._size)
        matrix.setLGMap(mapping, mapping)
        matrix.setUp()
        return matrix

    def tangent(self) -> PETSc.Mat:
        """Derivative of the residual of the coordinates with respect to q1, in the ranks' parts."""
        part = self._sum_of_own_cells(self._tangents) + self._system.c * self._mass
        part.sort_indices()
        pointers = part.indptr.astype(PETSc.IntType)
        indices = part.indices.astype(PETSc.IntType)
        local = PETSc.Mat().createAIJ(
            part.shape, csr=(pointers, indices, part.data), comm=MPI.COMM_SELF
        )
        local.setBlockSize(self.matrix.getBlockSize())
        self.matrix.setISLocalMat(local)
        self.matrix.assemble()
        self._system.supports.clear(self.matrix, 1.0)
        return self.matrix

    def _sum_of_own_cells(self, forms: Iterable[tuple[fem.Form, la.MatrixCSR]]) -> csr_matrix:
        """Sum of forms over this rank's own cells, a square matrix of the unknowns of its nodes."""
        total = csr_matrix((len(self._unknowns), len(self._unknowns)))
        for form, matrix in forms:
            matrix.set_value(np.float64(0))
            # Without the exchange between ranks that would add the parts of others.
            fem.assemble_matrix(matrix, form)  # type: ignore[arg-type]
            rows, columns = matrix.block_size
            entries = matrix.data.reshape(-1, rows, columns)
            blocks = bsr_matrix((entries, matrix.indices, matrix.indptr))
            n = rows * (len(matrix.indptr) - 1)
            blocks.resize(n, n)
            total = total + blocks.tocsr()[self._unknowns][:, self._unknowns]
        return total


def with_matrices(forms: Iterable[fem.Form]) -> list[tuple[fem.Form, la.MatrixCSR]]:
    """Bilinear forms, each with a matrix of the ranks' parts to assemble it into."""
    return [(form, fem.create_matrix(form)) for form in forms]


def configure(ksp: PETSc.KSP, method: str) -> None:
    """Choose the Krylov method and the preconditioner on the ranks' parts; PETSc's options may override.

    Raises:
        InputError: the method is not one of `METHODS`.
    """
    check(
        method in METHODS,
        f"subdomains: there is no method {method!r}; take one of {', '.join(METHODS)}.",
    )
    if method == "fetidp":
        ksp.setType("fetidp")
        ksp.setTolerances(rtol=FETIDP_RTOL, max_it=MAX_KSP_ITERATIONS)
        options = PETSc.Options(PREFIX)
        for name, value in FETIDP_OPTIONS.items():
            if not options.hasName(name):
                options[name] = value
        return
    ksp.setTolerances(rtol=BDDC_RTOL, max_it=MAX_KSP_ITERATIONS)
    ksp.setType("gmres")
    # On the right, so that the tolerance refers to the true residual.
    ksp.setPCSide(PETSc.PC.Side.RIGHT)
    ksp.getPC().setType("bddc")
