"""Coarse space for large meshes: affine functions on patches of nodes.

Problem.  An incomplete factorisation couples unknowns a few cells apart.  A stiff film, in a step
that is many times longer than a wave takes to cross a cell, couples unknowns as far apart as its
edges.

Idea.  What the factorisation does not resolve varies slowly in space.  The nodes are divided into
connected patches, and in a patch each component of the unknowns may vary affinely with the
undeformed position X of the node.  This contains translations, rotations and uniform strains of the
patch.

Algorithm.

1. Divide the nodes of each body and rank into patches of at most `NODES_PER_PATCH` (`patches`).
2. On each patch, and for each of the s components of a node, take the four functions

       f = (1, (X - mean X)/radius),    set to zero at fixed coordinates                      (1)

3. Orthonormalise them by the eigenvectors V and eigenvalues λ of their Gram matrix,

       f V λ^(-1/2)                                                                           (2)

   without those of negligible λ: a flat patch has three functions, a straight one two.
4. They are the columns of the prolongation P (unknowns, coarse unknowns), made once for a run.
5. A coarse solution is

       z = P (Pᵀ A P)⁻¹ Pᵀ r,                                                                 (3)

   with Pᵀ A P factorised by MUMPS, on every rank as a whole.
6. If its unknowns times the ranks exceed `MAX_UNKNOWNS_FACTORISED`, its inverse is replaced by one
   V-cycle of PETSc's multigrid.  The coarse level are affine functions on large patches, P2.  They
   are linear combinations of those on the small patches, so that Pᵀ P2 takes one level to the
   other.

Source: aggregation of Vaněk, Mandel & Brezina (Computing 56 (1996) 179, doi:10.1007/BF02238511)
without smoothing; large patches with affine functions replace the hierarchy of levels.

Cost.  A flat film has nine coarse unknowns a patch and three unknowns a node, so that the coarse
matrix has about 30 times fewer rows than A.  Its factorisation hardly divides among ranks, and one
by MUMPS on several ranks makes a hundred collective operations in each solution, 1520 of the 1680
of a step of a sheet with 20 thousand unknowns.  Therefore every rank factorises the whole matrix,
and a solution gathers one vector.  The V-cycle divides, except for its coarse level.

Limits.  Patches do not cross the boundaries of ranks, so that the coarse space depends on their
number.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from gossamer_fx.core.algebra.numbering import PREFIX
from gossamer_fx.core.forms.backend import cell_nodes
from gossamer_fx.core.model.body import Array, MeshBody, has_nodal_unknowns, is_on_mesh
from gossamer_fx.solve.solvers import factorisation
from gossamer_fx.solve.system.system import System

Indices = npt.NDArray[np.integer]

# Largest number of nodes in a patch.  Of 30 to 400, this one has the shortest time of a linear
# solve.
NODES_PER_PATCH = 100

# Nodes in a patch of a beam, over those of a film: beams are much stiffer, and few.  Antennas of 47
# thousand unknowns take 9.4 Krylov iterations with equal patches, 6.7 with these or single nodes.
BEAM_PATCH_RATIO = 0.08

# Coarse unknowns, times ranks, up to which the coarse matrix is factorised; the V-cycle divides
# among ranks.  With 17 thousand coarse unknowns (300 thousand unknowns) a step of a sheet takes
# 5.0 s of CPU time by the factorisation and 5.7 s by the V-cycle on one rank, 10.7 and 9.1 s on
# two.  On eight ranks 44 thousand unknowns take 12.5 and 15.5 Krylov iterations a step.
MAX_UNKNOWNS_FACTORISED = 20_000

# Largest number of nodes in a patch of the V-cycle's coarse level.
NODES_PER_LARGE_PATCH = 6400

# Levels of fill of the V-cycle's smoother, an incomplete factorisation, and its Chebyshev
# iterations before and after the coarse level.  A sheet of 300 thousand unknowns takes 5.6 Krylov
# iterations for one of Newton's, with one plain iteration 6.8, with the coarse matrix factorised
# 4.6; on eight ranks and 20 thousand unknowns 11.2, 12.7 and 10.8.
SMOOTHER_LEVELS = 2
SMOOTHER_ITERATIONS = 2

# Eigenvalues of a Gram matrix below this fraction of the largest one are dropped: the patch is flat
# or straight in their direction, up to a thirtieth of its extent.
FLATNESS = 1e-3

# Smaller than the largest eigenvalue of a Gram matrix with one free node, which is 1 or more:
# components that are fixed in the whole patch have no functions.
LESS_THAN_ONE_NODE = 0.5

TINY = float(np.finfo(float).tiny)  # against division by zero

NONE: Indices = np.zeros(0, dtype=np.int64)


class CoarseSpace:
    """Solves (3) for a matrix of the system."""

    def __init__(self, system: System, condensed: Indices = NONE) -> None:
        """Build P of equation (2), without `condensed` unknowns (k,) of this rank, and a solver for
        the coarse matrix.  Collective."""
        self._P = prolongation(system, condensed=condensed)
        self._scalar_matrix: PETSc.Mat | None = None  # A, stored by single numbers
        self._coarse_matrix: PETSc.Mat | None = None  # Pᵀ A P
        self._to_large_patches: PETSc.Mat | None = None  # Pᵀ P2 of a V-cycle; None: none is needed
        coarse_unknowns = self._P.getSize()[1]
        if coarse_unknowns * self._P.comm.size > MAX_UNKNOWNS_FACTORISED:
            large = prolongation(system, NODES_PER_LARGE_PATCH, condensed)
            self._to_large_patches = self._P.transposeMatMult(large)
        self._own_matrix: PETSc.Mat | None = None  # Pᵀ A P as a whole, on each rank
        self._solver = self._new_solver()
        self._r = self._P.createVecRight()
        self._z = self._P.createVecRight()
        if self._to_large_patches is None:
            # To the vector of all coarse unknowns that each rank has.
            self._gather, self._all_r = PETSc.Scatter.toAll(self._r)
            self._all_z = self._all_r.duplicate()

    def _new_solver(self) -> PETSc.PC:
        """A factorisation of the coarse matrix, or a V-cycle if it is large."""
        if self._to_large_patches is None:
            solver = PETSc.PC().create(PETSc.COMM_SELF)
            factorisation.choose(solver)
        else:
            solver = PETSc.PC().create(self._P.comm)
            _choose_multigrid(solver, self._to_large_patches)
        return solver

    def recover(self) -> None:
        """Become usable again after a matrix that was not finite.  A factorisation does so by
        itself, and retains its ordering."""
        if self._to_large_patches is not None:
            self._solver.destroy()
            self._solver = self._new_solver()

    def set_up(self, A: PETSc.Mat) -> None:
        """Compute Pᵀ A P and set up its solver; A has the same pattern at every call."""
        # PETSc has no product of a matrix stored by blocks with P.
        self._scalar_matrix = A.convert("aij", out=self._scalar_matrix or PETSc.Mat())
        self._coarse_matrix = self._scalar_matrix.PtAP(self._P, self._coarse_matrix)
        if self._to_large_patches is None:
            self._own_matrix = self._coarse_matrix.getRedundantMatrix(
                self._P.comm.size, PETSc.COMM_SELF, self._own_matrix
            )
            self._solver.setOperators(self._own_matrix)
            factorisation.set_up(self._solver)
        else:
            self._solver.setOperators(self._coarse_matrix)
            self._solver.setUp()

    def solve(self, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """Set z [m] to the coarse solution (3) for a residual r [N].  Collective."""
        self._P.multTranspose(r, self._r)
        if self._to_large_patches is None:
            self._gather.scatter(self._r, self._all_r)
            self._solver.apply(self._all_r, self._all_z)
            self._z.array[:] = self._all_z.array_r[slice(*self._z.getOwnershipRange())]
        else:
            self._solver.apply(self._r, self._z)
        self._P.mult(self._z, z)


def _choose_multigrid(pc: PETSc.PC, interpolation: PETSc.Mat) -> None:
    """Make a preconditioner one V-cycle with two levels and incomplete factorisations as smoother.

    `interpolation` (coarse unknowns, unknowns of large patches) is Pᵀ P2.  PETSc's options of the
    V-cycle have the prefix `gx_coarse_`.
    """
    prefix = PREFIX + "coarse_"
    several_ranks = pc.comm.size > 1
    choices: dict[str, str | int] = {
        "pc_mg_galerkin": "both",
        "mg_levels_ksp_type": "chebyshev",
        "mg_levels_ksp_max_it": SMOOTHER_ITERATIONS,
    }
    smoother = "mg_levels_"
    if several_ranks:
        choices["mg_levels_pc_type"] = "asm"
        choices["mg_levels_pc_asm_overlap"] = 1
        smoother = "mg_levels_sub_"
        # Every rank factorises the whole coarse level, as it does a small coarse matrix.
        choices["mg_coarse_pc_type"] = "redundant"
        choices["mg_coarse_redundant_pc_type"] = "lu"
        choices["mg_coarse_redundant_pc_factor_mat_solver_type"] = "mumps"
    else:
        choices["mg_coarse_pc_type"] = "lu"
        choices["mg_coarse_pc_factor_mat_solver_type"] = "mumps"
    choices[smoother + "pc_type"] = "ilu"
    choices[smoother + "pc_factor_levels"] = SMOOTHER_LEVELS
    options = PETSc.Options(prefix)
    for key, value in choices.items():
        if not options.hasName(key):
            options[key] = value
    pc.setOptionsPrefix(prefix)
    pc.setType("mg")
    pc.setMGLevels(2)
    pc.setMGInterpolation(1, interpolation)
    pc.setFromOptions()


def prolongation(
    system: System, nodes_per_patch: int = NODES_PER_PATCH, condensed: Indices = NONE
) -> PETSc.Mat:
    """The prolongation P (unknowns, coarse unknowns), whose orthonormal columns are affine
    functions on patches of at most `nodes_per_patch` nodes, and of beams fewer.  Those of rigid
    bodies are single unknowns.

    Rows of fixed and `condensed` coordinates, and of other bodies without nodes, are zero; rows are
    distributed as the unknowns are.  Collective.
    """
    numbering = system.numbering
    is_free = np.ones(numbering.size_local)
    is_free[system.supports.held] = 0
    is_free[condensed] = 0

    # Empty arrays first, as a rank may have no nodes.
    all_rows: list[Indices] = [np.zeros(0, dtype=np.int64)]
    all_columns: list[Indices] = [np.zeros(0, dtype=np.int64)]
    all_values: list[Array] = [np.zeros(0)]
    count = 0
    for body in system.bodies:
        owned = system.block(body).owned
        has_nodes_here = owned.stop > owned.start
        # Of a body with directors that turn, free are its position and a rotation.
        has_directors = body.block.size > 3
        if has_nodal_unknowns(body) and has_nodes_here:
            nodes = nodes_per_patch
            if has_directors:
                nodes = int(BEAM_PATCH_RATIO * nodes)
            rows, columns, values, functions = basis(body, is_free[owned], nodes)
            all_rows.append(rows + owned.start)
            all_columns.append(columns + count)
            all_values.append(values)
            count += functions
        elif has_directors and not is_on_mesh(body):
            rows = np.flatnonzero(is_free[owned])
            functions = len(rows)
            columns = np.arange(functions)
            values = np.ones(functions)
            all_rows.append(rows + owned.start)
            all_columns.append(columns + count)
            all_values.append(values)
            count += functions

    rows = np.concatenate(all_rows)
    columns = np.concatenate(all_columns)
    values = np.concatenate(all_values)
    shape = (numbering.size_local, count)
    P = csr_matrix((values, (rows, columns)), shape=shape)
    # Columns are numbered through the ranks.
    first_column = numbering.comm.exscan(count) or 0
    indices = P.indices + first_column
    row_sizes = (numbering.size_local, numbering.size)
    column_sizes = (count, None)
    return PETSc.Mat().createAIJ(
        (row_sizes, column_sizes),
        csr=(
            P.indptr.astype(PETSc.IntType),
            indices.astype(PETSc.IntType),
            P.data,
        ),
        comm=numbering.comm,
    )


def basis(
    body: MeshBody, is_free: Array, nodes_per_patch: int
) -> tuple[Indices, Indices, Array, int]:
    """The part of one body in the prolongation P: rows, columns and values (k,), counted from the
    start of the body, and the number of columns.

    `is_free` (n s,) is 1 at free coordinates and 0 at fixed ones, for n nodes of this rank and s
    unknowns a node.  In the code X are the coordinates (n, 3) [m] of the nodes, f the affine
    functions at them, and g these functions with zeros at fixed coordinates.
    """
    n = body.block.index_map.size_local
    s = body.block.size
    X = body.space.tabulate_dof_coordinates()[:n]
    patch = patches(body, X, nodes_per_patch)
    f = affine_functions(X, patch)
    g = f[:, None, :] * is_free.reshape(n, s, 1)
    coefficients, is_kept = orthonormalise(f, g, patch)
    values = np.einsum("nci,ncij->ncj", g, coefficients[patch])

    # Functions are numbered by patch, component and eigenvalue.
    column = np.cumsum(is_kept) - 1
    column = column.reshape(is_kept.shape)
    column_at_node = column[patch]
    is_kept_at_node = is_kept[patch]
    node, component, _ = np.nonzero(is_kept_at_node)
    return (
        node * s + component,
        column_at_node[is_kept_at_node],
        values[is_kept_at_node],
        int(is_kept.sum()),
    )


def affine_functions(X: Array, patch: Indices) -> Array:
    """The functions f = (1, (X - mean X)/radius) (n, 4) at undeformed positions X (n, 3) [m]; mean
    and radius (root mean square distance) are those of the patch of a node, whose numbers (n,) have
    no gaps."""
    nodes_in_patch = np.bincount(patch)
    f = np.ones((len(X), 4))
    for i in range(3):
        mean = np.bincount(patch, X[:, i]) / nodes_in_patch
        f[:, i + 1] = X[:, i] - mean[patch]
    squared_distance = (f[:, 1:] ** 2).sum(axis=1)
    squared_radius = np.bincount(patch, squared_distance) / nodes_in_patch
    # A patch of a single node has the radius zero.
    radius = np.maximum(np.sqrt(squared_radius), TINY)
    f[:, 1:] /= radius[patch, None]
    return f


def orthonormalise(f: Array, g: Array, patch: Indices) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Coefficients V λ^(-1/2) (patches, s, 4, 4) by which affine functions f (n, 4) on patches (n,)
    of nodes become orthonormal, and whether each is kept (patches, s, 4).

    V and λ are eigenvectors and eigenvalues of the Gram matrix of each patch and component, from
    the functions g (n, s, 4) with zeros at fixed coordinates.  Functions with λ below a thousandth
    of the largest one are dropped: their coefficients are zero.
    """
    # Gram matrices (patches, s, 4, 4): as g is f or zero, g f is g g.
    by_patch = np.argsort(patch, kind="stable")
    g_sorted = g[by_patch]
    f_sorted = f[by_patch]
    products = g_sorted[:, :, :, None] * f_sorted[:, None, None, :]
    nodes_in_patch = np.bincount(patch)
    first_of_patch = np.cumsum(nodes_in_patch) - nodes_in_patch
    gram = np.add.reduceat(products, first_of_patch)

    λ, V = np.linalg.eigh(gram)
    largest = λ.max(axis=-1, keepdims=True)
    is_kept = λ > FLATNESS * np.maximum(largest, LESS_THAN_ONE_NODE)
    root = np.sqrt(np.maximum(λ, TINY))
    scale = np.where(is_kept, 1 / root, 0.0)
    return V * scale[..., None, :], is_kept


def patches(body: MeshBody, X: Array, nodes_per_patch: int = NODES_PER_PATCH) -> Indices:
    """Divide the nodes of this rank, at undeformed positions X (n, 3) [m], into connected patches
    of at most `nodes_per_patch` nodes: their numbers (n,), without gaps.

    Nodes are halved across their longest extent until a box has few enough.  Nodes of a box that
    are not connected by cells within it are then separated, such as the two films of a flat pillow.
    """
    n = len(X)
    boxes: list[Indices] = [np.arange(n)]
    while len(boxes) * nodes_per_patch < n:
        halves: list[Indices] = []
        for box in boxes:
            halves += _halves(box, X)
        boxes = halves
    box_of_node = np.empty(n, dtype=np.int64)
    for k, nodes in enumerate(boxes):
        box_of_node[nodes] = k

    # Two nodes are neighbours if a cell has both; ghosts beyond the first n nodes do not count.
    nodes_of_cell = cell_nodes(body.space)
    cell_count, nodes_per_cell = nodes_of_cell.shape
    cells = np.repeat(np.arange(cell_count), nodes_per_cell)
    ones = np.ones(nodes_of_cell.size, dtype=np.int32)
    incidence = csr_matrix((ones, (cells, nodes_of_cell.ravel())))[:, :n]
    neighbours = (incidence.T @ incidence).tocoo()

    box_of_first = box_of_node[neighbours.row]
    box_of_second = box_of_node[neighbours.col]
    in_one_box = box_of_first == box_of_second
    first = neighbours.row[in_one_box]
    second = neighbours.col[in_one_box]
    graph = csr_matrix((np.ones(len(first)), (first, second)), shape=(n, n))
    _, patch = connected_components(graph, directed=False)
    return patch


def _halves(nodes: Indices, X: Array) -> list[Indices]:
    """The nodes in two sets of equal size, divided across their longest extent."""
    extents = np.ptp(X[nodes], axis=0)
    longest = extents.argmax()
    order = np.argsort(X[nodes, longest], kind="stable")
    middle = len(nodes) // 2
    return [nodes[order[:middle]], nodes[order[middle:]]]
