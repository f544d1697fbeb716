"""Domain decomposition: the tangent as the sum of the ranks' own, never assembled, for PETSc's BDDC and FETI-DP.

Each rank is a subdomain with the stiffness and mass of its own cells.  FETI-DP joins subdomains by multipliers and
solves for those (Farhat et al., IJNME 50 (2001) 1523, doi:10.1002/nme.76); BDDC is its primal counterpart (Dohrmann,
SIAM J. Sci. Comput. 25 (2003) 246, doi:10.1137/S1064827502412887).  Joined at corners and mean values of edges, their
iterations hardly grow with the number of subdomains and of cells.  In a film that is wrinkled all over this holds for
BDDC alone: FETI-DP then needs several times as many, and may fail, the more so the more subdomains there are.
"""

from __future__ import annotations

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
# for FETI-DP's multipliers: the tangent is not symmetric, and a restart at 30 iterations may not converge
MULTIPLIERS = {"fetidp_ksp_type": "gmres", "fetidp_ksp_gmres_restart": "300"}


class Subdomains:
    """The tangent of one mesh body in parts, one a rank.

    Raises:
        InputError: the scene has more than one body, or forces and constraints between points, or gas.
    """

    def __init__(self, system: System) -> None:
        bodies = system.bodies
        check(
            len(bodies) == 1 and has_nodal_unknowns(bodies[0]) and system.is_made_of_forms,
            "subdomains: they divide a single film, cable or beam without joints, springs and gas; leave the option "
            "subdomains out for this scene.",
        )
        self._system = system
        self._tangents = [
            (form, fem.create_matrix(form)) for form in system.tangent_forms(bodies[0])
        ]
        mass = [(form, fem.create_matrix(form)) for form in system.mass_forms(bodies[0])]
        space, numbering = system.fields[bodies[0]].q0.function_space, system.numbering
        # only what this rank's own cells touch: ghosts beyond them would make its matrix singular
        cells = space.mesh.topology.index_map(space.mesh.topology.dim).size_local
        nodes, size = np.unique(cell_nodes(space)[:cells]), space.dofmap.index_map_bs
        self._touched = (nodes[:, None] * size + np.arange(size)).ravel()
        self._mass = self._own(mass)
        indices = numbering.indices[0][size * nodes] // size
        mapping = PETSc.LGMap().create(
            indices.astype(PETSc.IntType), bsize=size, comm=numbering.comm
        )
        self.matrix = A = PETSc.Mat().create(numbering.comm)
        A.setSizes(((numbering.size_local, numbering.size), (numbering.size_local, numbering.size)))
        A.setType("is")
        A.setBlockSize(size)
        A.setLGMap(mapping, mapping)
        A.setUp()

    def tangent(self) -> PETSc.Mat:
        """Derivative of the field residual with respect to q1, in the ranks' parts."""
        own = self._own(self._tangents) + self._system.c * self._mass
        own.sort_indices()
        arrays = own.indptr.astype(PETSc.IntType), own.indices.astype(PETSc.IntType), own.data
        local = PETSc.Mat().createAIJ(own.shape, csr=arrays, comm=MPI.COMM_SELF)
        local.setBlockSize(self.matrix.getBlockSize())
        self.matrix.setISLocalMat(local)
        self.matrix.assemble()
        self._system.supports.clear(self.matrix, 1.0)
        return self.matrix

    def _own(self, forms: list[tuple[fem.Form, la.MatrixCSR]]) -> csr_matrix:
        """Sum of forms over this rank's cells, at the unknowns that they touch."""
        total = csr_matrix((len(self._touched), len(self._touched)))
        for form, matrix in forms:
            matrix.set_value(np.float64(0))
            fem.assemble_matrix(matrix, form)  # type: ignore[arg-type]
            a, b = matrix.block_size
            blocks = bsr_matrix((matrix.data.reshape(-1, a, b), matrix.indices, matrix.indptr))
            n = a * (len(matrix.indptr) - 1)
            blocks.resize(n, n)
            total = total + blocks.tocsr()[self._touched][:, self._touched]
        return total


def configure(ksp: PETSc.KSP, method: str) -> None:
    """Krylov method and preconditioner on the ranks' parts; PETSc's options may override."""
    check(
        method in METHODS,
        f"subdomains: there is no method {method!r}; take one of {', '.join(METHODS)}.",
    )
    if method == "fetidp":
        ksp.setType("fetidp")
        # of the multipliers' equations, preconditioned: the forces of a wrinkled film are off by far more
        ksp.setTolerances(rtol=1e-6, max_it=300)
        options = PETSc.Options(PREFIX)
        for name, value in MULTIPLIERS.items():
            if not options.hasName(name):
                options[name] = value
    else:
        ksp.setTolerances(rtol=1e-3, max_it=300)
        ksp.setType("gmres")
        ksp.setPCSide(PETSc.PC.Side.RIGHT)
        ksp.getPC().setType("bddc")
