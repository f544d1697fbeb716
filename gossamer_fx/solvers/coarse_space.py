"""A coarse space for large meshes: affine functions on patches of nodes.

An incomplete factorisation sees a few cells far, a stiff film in a step of many times dx/c as far as its edges.  What
it does not see varies slowly: over connected patches of about `PATCH` nodes, each of a node's numbers may vary affinely
with the place in the undeformed mesh, which holds the patch's translations, rotations and mean strains,

    P : patches' coefficients -> unknowns,      P (PᵀAP)⁻¹ Pᵀ.

Patches do not cross ranks or bodies, and P is zero at held coordinates; it is made once.
The aggregation of Vaněk, Mandel & Brezina (Computing 56 (1996) 179, doi:10.1007/BF02238511), not smoothed: large
patches and an affine variation take the place of levels.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from gossamer_fx.forms.spaces import cell_nodes
from gossamer_fx.model.body import Array, MeshBody, has_nodal_unknowns
from gossamer_fx.solvers import factorisation
from gossamer_fx.system.system import System

Indices = npt.NDArray[np.integer]

PATCH = 100  # nodes; of 30 to 400, what costs least a solve
FLAT = 1e-3  # of its largest extent squared, a patch's extent that does not count


class CoarseSpace:
    """Solves A in the coarse space: z = P (PᵀAP)⁻¹ Pᵀ r."""

    def __init__(self, system: System) -> None:
        self._P = prolongation(system)
        self._single: PETSc.Mat | None = (
            None  # A with single numbers: blocks have no product with P
        )
        self._coarse: PETSc.Mat | None = None
        self._solver = PETSc.PC().create(system.comm)
        factorisation.choose(self._solver)
        self._r, self._z = self._P.createVecRight(), self._P.createVecRight()

    def set_up(self, A: PETSc.Mat) -> None:
        self._single = A.convert("aij", out=self._single or PETSc.Mat())
        self._coarse = self._single.PtAP(self._P, self._coarse)
        self._solver.setOperators(self._coarse)
        factorisation.set_up(self._solver)

    def solve(self, r: PETSc.Vec, z: PETSc.Vec) -> None:
        self._P.multTranspose(r, self._r)
        self._solver.apply(self._r, self._z)
        self._P.mult(self._z, z)


def prolongation(system: System) -> PETSc.Mat:
    """P (unknowns, coarse unknowns) with orthonormal columns, distributed as the unknowns are."""
    numbering = system.numbering
    free = np.ones(numbering.size_local)
    free[system.supports.held] = 0
    empty = np.zeros(0, dtype=np.int64)
    entries: list[tuple[Indices, Indices, Array]] = [(empty, empty, np.zeros(0))]
    columns = 0
    for body in system.bodies:
        owned = system.block(body).owned
        if has_nodal_unknowns(body) and owned.stop > owned.start:
            rows, cols, values, new = modes(body, free[owned])
            entries.append((rows + owned.start, cols + columns, values))
            columns += new
    rows, cols, values = (np.concatenate(part) for part in zip(*entries, strict=True))
    start = numbering.comm.exscan(columns) or 0
    P = csr_matrix((values, (rows, cols)), shape=(numbering.size_local, columns))
    arrays = P.indptr.astype(PETSc.IntType), (P.indices + start).astype(PETSc.IntType), P.data
    sizes = (numbering.size_local, numbering.size), (columns, None)
    return PETSc.Mat().createAIJ(sizes, csr=arrays, comm=numbering.comm)


def modes(body: MeshBody, free: Array) -> tuple[Indices, Indices, Array, int]:
    """Rows, columns and values of one body's part of P, and the number of its columns; `free` is 0 where held."""
    n = body.block.index_map.size_local
    size = body.block.size
    X = body.space.tabulate_dof_coordinates()[:n]
    patch = patches(body, X)
    count = np.bincount(patch)
    mean = np.stack([np.bincount(patch, x) / count for x in X.T], axis=1)
    f = np.column_stack([np.ones(n), X - mean[patch]])  # the affine functions
    radius = np.sqrt(np.bincount(patch, (f[:, 1:] ** 2).sum(axis=1)) / count)
    f[:, 1:] /= np.maximum(radius, np.finfo(float).tiny)[patch, None]
    g = f[:, None, :] * free.reshape(n, size, 1)
    order = np.argsort(patch, kind="stable")
    products = g[order, :, :, None] * f[order, None, None, :]
    gram = np.add.reduceat(products, np.concatenate([[0], np.cumsum(count)[:-1]]))
    λ, V = np.linalg.eigh(gram)
    kept = λ > FLAT * np.maximum(λ.max(axis=-1, keepdims=True), 0.5)
    V *= np.where(kept, 1 / np.sqrt(np.maximum(λ, np.finfo(float).tiny)), 0.0)[..., None, :]
    values = np.einsum("nci,ncij->ncj", g, V[patch])
    column = np.cumsum(kept).reshape(kept.shape) - 1
    at = np.nonzero(kept[patch])
    return at[0] * size + at[1], column[patch][at], values[at], int(kept.sum())


def patches(body: MeshBody, X: Array) -> Indices:
    """The patch (n,) of each of the rank's own n nodes, which are at X (n, 3); numbered from 0 without gaps.

    Nodes are halved across their longest side until few are together; of those, what no cell connects is apart again,
    as are the two films of a flat pillow.
    """
    n = len(X)
    boxes: list[Indices] = [np.arange(n)]
    while len(boxes) * PATCH < n:
        boxes = [half for box in boxes for half in _halves(box, X)]
    box = np.empty(n, dtype=np.int64)
    for k, nodes in enumerate(boxes):
        box[nodes] = k
    dofs = cell_nodes(body.space)
    cells = np.repeat(np.arange(len(dofs)), dofs.shape[1])
    touches = csr_matrix((np.ones(dofs.size, dtype=np.int32), (cells, dofs.ravel())))[:, :n]
    graph = (touches.T @ touches).tocoo()
    together = box[graph.row] == box[graph.col]
    ends = graph.row[together], graph.col[together]
    return connected_components(
        csr_matrix((np.ones(len(ends[0])), ends), shape=(n, n)), directed=False
    )[1]


def _halves(nodes: Indices, X: Array) -> list[Indices]:
    """Two sets of equally many nodes."""
    longest = np.ptp(X[nodes], axis=0).argmax()
    order = np.argsort(X[nodes, longest], kind="stable")
    return [nodes[order[: len(nodes) // 2]], nodes[order[len(nodes) // 2 :]]]
