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
6. If its unknowns times the ranks exceed `MAX_UNKNOWNS_FACTORISED`, it becomes a separate level,
   with an incomplete factorisation, of PETSc's multigrid.  Below it are affine functions on large
   patches, P2, and where these are many on groups of them, P3, which cross the boundaries of ranks.
   They are linear combinations of those on the patches above, so that Pᵀ P2 and P2ᵀ P3 take one
   level to the next.  One rank factorises the matrix of the last level.

Source: aggregation of Vaněk, Mandel & Brezina (Computing 56 (1996) 179, doi:10.1007/BF02238511)
without smoothing.

Cost.  A flat film has nine coarse unknowns a patch and three unknowns a node, so that the coarse
matrix has 16 to 33 times fewer rows than A.  Its factorisation hardly divides among ranks, and one
by MUMPS on several ranks makes a hundred collective operations in each solution, 1520 of the 1680
of a step of a sheet with 20 thousand unknowns.  Therefore every rank factorises the whole matrix,
and a solution gathers one vector.  The V-cycle divides, except for its last level, which has nine
unknowns for 128 large patches.

Limits.  Only groups of patches cross the boundaries of ranks, so that the coarse space depends on
their number.  Small patches that cross them did not save iterations on eight ranks.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from dolfinx import la
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from gossamer_fx.core.algebra.numbering import PREFIX
from gossamer_fx.core.forms.backend import cell_nodes
from gossamer_fx.core.model.body import Array, MeshBody, has_nodal_unknowns
from gossamer_fx.solve.system.system import System

Indices = npt.NDArray[np.integer]

# Largest number of nodes in a patch.  Of 30 to 400, this one has the shortest time of a linear
# solve.
NODES_PER_PATCH = 100

# Nodes in a patch of a beam, over those of a film: beams are much stiffer, and few.  An antenna of
# 47 thousand unknowns takes 6.0 Krylov iterations with equal patches, 5.0 with these, if none of 14
# steps is factorised.
BEAM_PATCH_RATIO = 0.08

# Coarse unknowns, times ranks, up to which the coarse matrix is factorised; the V-cycle divides
# among ranks.  On one rank a sheet takes an equal time by both with 5 thousand of them (78 thousand
# unknowns), and by the V-cycle 0.91 with 18 thousand.  An antenna with 10 thousand takes more of
# Newton's iterations by it.  On eight ranks 44 thousand unknowns take 16 and 20 Krylov iterations a
# step.
MAX_UNKNOWNS_FACTORISED = 15_000

# Largest number of nodes in a large patch, and of large patches in a group.  With 78 thousand
# unknowns on eight ranks GMRES takes 8 iterations to 1e-4, with 1600 nodes 10, with 400 nodes 8,
# with the coarse matrix factorised 7.
NODES_PER_LARGE_PATCH = 800
PATCHES_PER_GROUP = 128

# Unknowns of large patches above which a V-cycle has groups of them, too.  One rank factorises what
# is left, while the others wait.
MAX_UNKNOWNS_ON_ONE_RANK = 1000

# Levels of fill of the V-cycle's smoothers, incomplete factorisations, which are applied on the way
# up only.  Another application on the way down doubles time and messages, and saves nothing: with
# 44 thousand unknowns one rank takes 20 instead of 19.5 Krylov iterations to 1e-8.
SMOOTHER_LEVELS = 2

# Patches by which the smoothed parts of ranks overlap.  Eight ranks take 27 of those iterations,
# with three patches 26, with one and the other application 28.  With ten thousand unknowns a rank,
# parts that overlap by two patches are twice as large as without, by three patches three times.
SMOOTHER_OVERLAP = 2

# Workspace of MUMPS over its estimate, less one [%], for the coarse matrix.
WORKSPACE_MARGIN = 100

# Eigenvalues of a Gram matrix below this fraction of the largest one are dropped: the patch is flat
# or straight in their direction, up to a thirtieth of its extent.
FLATNESS = 1e-3

# Smaller than the largest eigenvalue of a Gram matrix with one free node, which is 1 or more:
# components that are fixed in the whole patch have no functions.
LESS_THAN_ONE_NODE = 0.5

TINY = float(np.finfo(float).tiny)  # against division by zero

# Options that `_set_options` has set, not the user.
_OWN_OPTIONS: set[str] = set()

NONE: Indices = np.zeros(0, dtype=np.int64)


class CoarseSpace:
    """The levels of a multigrid preconditioner below the mesh.

    Attributes:
        interpolations: between the levels, the finest first: P, and in large systems Pᵀ P2 and
            P2ᵀ P3.
    """

    def __init__(self, system: System, condensed: Indices = NONE) -> None:
        """Build the levels, without `condensed` unknowns (k,) of this rank.  Collective."""
        P = prolongation(system, condensed=condensed)
        self.interpolations = [P]
        if P.getSize()[1] * P.comm.size > MAX_UNKNOWNS_FACTORISED:
            self.interpolations += _interpolations(system, P, condensed)
        self._scalar_matrix: PETSc.Mat | None = None  # A, stored by single numbers
        # Pᵀ A P, and those of the levels below
        self._matrices: list[PETSc.Mat | None] = [None] * len(self.interpolations)

    def set_up(self, A: PETSc.Mat, multigrid: PETSc.PC) -> None:
        """Compute the matrices of the levels, and set up their solvers in a preconditioner from
        `new_multigrid`; A has the same pattern at every call.  Collective."""
        # PETSc has no product of a matrix stored by blocks with P.
        self._scalar_matrix = A.convert("aij", out=self._scalar_matrix or PETSc.Mat())
        matrix = self._scalar_matrix
        for k, interpolation in enumerate(self.interpolations):
            matrix = matrix.PtAP(interpolation, self._matrices[k])
            self._matrices[k] = matrix
        self._set_up_solvers(multigrid)

    def _set_up_solvers(self, multigrid: PETSc.PC) -> None:
        """Factorise the matrices of the levels, all but the last one incompletely."""
        # PETSc counts levels from the coarsest.
        for level, matrix in enumerate(reversed(self._matrices)):
            solver = multigrid.getMGSmoother(level)
            solver.setOperators(matrix)
            solver.setUp()


def new_multigrid(interpolations: list[PETSc.Mat], local: PETSc.PC) -> PETSc.PC:
    """A preconditioner that solves on the last level, and smooths on the way up only: by incomplete
    factorisations, and on the mesh by `local`.  Collective.

    `interpolations` are those between its levels, the finest first.  PETSc's options of the levels
    below the mesh have the prefix `gx_coarse_`.
    """
    prefix = PREFIX + "coarse_"
    several_ranks = local.comm.size > 1
    choices: dict[str, str | int] = {
        # Without smoothing on the way down.
        "pc_mg_type": "kaskade",
        "mg_levels_ksp_type": "richardson",
        "mg_levels_ksp_max_it": 1,
    }
    last = "mg_coarse_"
    if len(interpolations) == 1:
        if several_ranks:
            # Every rank has the whole matrix.
            choices[last + "pc_type"] = "redundant"
            last += "redundant_"
        choices[last + "pc_factor_mat_solver_type"] = "mumps"
        choices[last + "mat_mumps_icntl_14"] = WORKSPACE_MARGIN
    else:
        smoother = "mg_levels_"
        if several_ranks:
            choices["mg_levels_pc_type"] = "asm"
            choices["mg_levels_pc_asm_overlap"] = SMOOTHER_OVERLAP
            smoother = "mg_levels_sub_"
            # One rank has the matrix of the last level.
            choices[last + "pc_type"] = "telescope"
            choices[last + "pc_telescope_reduction_factor"] = local.comm.size
            last += "telescope_"
        choices[smoother + "pc_type"] = "ilu"
        choices[smoother + "pc_factor_levels"] = SMOOTHER_LEVELS
    # With several levels by PETSc: a solution by MUMPS takes 0.2 ms, however small the matrix.
    choices[last + "pc_type"] = "lu"
    _set_options(prefix, choices)
    multigrid = PETSc.PC().create(local.comm)
    multigrid.setOptionsPrefix(prefix)
    multigrid.setType("mg")
    finest = len(interpolations)
    multigrid.setMGLevels(1 + finest)
    # PETSc counts levels from the coarsest.
    for level, interpolation in enumerate(reversed(interpolations), start=1):
        multigrid.setMGInterpolation(level, interpolation)
    multigrid.getMGSmoother(finest).setPC(local)
    multigrid.setFromOptions()
    for level in range(finest):
        multigrid.getMGSmoother(level).setFromOptions()
    return multigrid


def _set_options(prefix: str, choices: dict[str, str | int]) -> None:
    """Set PETSc's options of a prefix, but those of the user, in place of those of the last call: a
    scene of another size or on other ranks has others."""
    options = PETSc.Options(prefix)
    for key in _OWN_OPTIONS:
        options.delValue(key)
    _OWN_OPTIONS.clear()
    for key, value in choices.items():
        if not options.hasName(key):
            options[key] = value
            _OWN_OPTIONS.add(key)


def _interpolations(system: System, P: PETSc.Mat, condensed: Indices) -> list[PETSc.Mat]:
    """The interpolations between the levels of a V-cycle, the finest first: Pᵀ P2 (coarse unknowns,
    unknowns of large patches) and, if these are many, P2ᵀ P3 (.., unknowns of groups).  Collective.
    """
    P2 = prolongation(system, NODES_PER_LARGE_PATCH, condensed)
    found = [P.transposeMatMult(P2)]
    if P2.getSize()[1] > MAX_UNKNOWNS_ON_ONE_RANK:
        P3 = prolongation(system, NODES_PER_LARGE_PATCH, condensed, in_groups=True)
        found.append(P2.transposeMatMult(P3))
        P3.destroy()
    P2.destroy()
    return found


class Division(NamedTuple):
    """A division of a body's nodes into patches."""

    patch: Indices  # (n,): the number of the patch of each node of this rank
    owner: Indices  # (patches,): the rank that has the coarse unknowns of each patch
    comm: MPI.Intracomm  # of the ranks that have nodes of the patches


def prolongation(
    system: System,
    nodes_per_patch: int = NODES_PER_PATCH,
    condensed: Indices = NONE,
    in_groups: bool = False,
) -> PETSc.Mat:
    """The prolongation P (unknowns, coarse unknowns), whose orthonormal columns are affine
    functions on patches of at most `nodes_per_patch` nodes, and of beams fewer, or on groups of
    such patches.  Those of rigid bodies are single unknowns.

    Rows of fixed and `condensed` coordinates, and of other bodies without nodes, are zero; rows are
    distributed as the unknowns are.  Collective.
    """
    numbering = system.unknowns.numbering
    is_free = np.ones(numbering.size_local)
    is_free[system.unknowns.supports.held] = 0
    is_free[condensed] = 0

    # Empty arrays first, as there may be no nodes.
    all_rows: list[Indices] = [NONE]
    all_columns: list[Indices] = [NONE]
    all_values: list[Array] = [np.zeros(0)]
    all_owners: list[Indices] = [NONE]
    count = 0
    for body in system.unknowns.bodies:
        owned = system.unknowns.block(body).owned
        # Of a body with directors that turn, free are its position and a rotation.
        has_directors = body.block.size > 3
        if has_nodal_unknowns(body):
            X = body.space.tabulate_dof_coordinates()[: body.block.index_map.size_local]
            nodes = nodes_per_patch
            if has_directors:
                nodes = int(BEAM_PATCH_RATIO * nodes)
            patch = patches(body, X, nodes)
            if in_groups:
                division = groups(body, X, patch)
            else:
                owner = np.full(_count(patch), numbering.comm.rank)
                division = Division(patch, owner, MPI.COMM_SELF)
            is_free_at_node = is_free[owned].reshape(-1, body.block.size)
            rows, columns, values, owners = basis(X, is_free_at_node, division)
        elif has_directors and not isinstance(body, MeshBody):
            rows = np.flatnonzero(is_free[owned])
            values = np.ones(len(rows))
            owners = np.full(len(rows), numbering.comm.rank)
            if in_groups:
                # Every rank has the columns of all ranks.
                owners = np.concatenate(numbering.comm.allgather(owners))
            columns = np.flatnonzero(owners == numbering.comm.rank)
        else:
            continue
        all_rows.append(rows + owned.start)
        all_columns.append(columns + count)
        all_values.append(values)
        all_owners.append(owners)
        count += len(owners)

    rows = np.concatenate(all_rows)
    values = np.concatenate(all_values)
    number, own_count, total = _numbers(np.concatenate(all_owners), numbering.comm)
    columns = number[np.concatenate(all_columns)]
    P = csr_matrix((values, (rows, columns)), shape=(numbering.size_local, total))
    row_sizes = (numbering.size_local, numbering.size)
    return PETSc.Mat().createAIJ(
        (row_sizes, (own_count, total)),
        csr=(
            P.indptr.astype(PETSc.IntType),
            P.indices.astype(PETSc.IntType),
            P.data,
        ),
        comm=numbering.comm,
    )


def _numbers(owners: Indices, comm: MPI.Intracomm) -> tuple[Indices, int, int]:
    """The global numbers (k,) of columns with these owners (k,), consecutive on each rank, the
    number of this rank's own columns, and that of all.  Collective.

    A rank has either only the columns that it owns, or as all ranks do those of every rank.
    """
    own_count = int(np.count_nonzero(owners == comm.rank))
    end_on_rank = np.cumsum(comm.allgather(own_count))
    first_on_rank = np.append(0, end_on_rank[:-1])
    order = np.argsort(owners, kind="stable")
    sorted_owners = owners[order]
    place = np.arange(len(owners)) - np.searchsorted(sorted_owners, sorted_owners)
    number = np.empty(len(owners), dtype=np.int64)
    number[order] = first_on_rank[sorted_owners] + place
    return number, own_count, int(end_on_rank[-1])


def basis(X: Array, is_free: Array, division: Division) -> tuple[Indices, Indices, Array, Indices]:
    """The part of one body in the prolongation P: rows, columns and values (k,), counted from the
    start of the body, and the ranks that own its columns.

    X (n, 3) [m] are the undeformed positions of the nodes of this rank; `is_free` (n, s) is 1 at
    free coordinates and 0 at fixed ones, for s unknowns a node.  In the code f are the affine
    functions at the nodes, and g these functions with zeros at fixed coordinates.
    """
    s = is_free.shape[1]
    patch = division.patch
    f = affine_functions(X, division)
    g = f[:, None, :] * is_free[:, :, None]
    coefficients, is_kept = orthonormalise(f, g, division)
    values = np.einsum("nci,ncij->ncj", g, coefficients[patch])

    # Functions are numbered by patch, component and eigenvalue.
    column = np.cumsum(is_kept) - 1
    column = column.reshape(is_kept.shape)
    column_at_node = column[patch]
    is_kept_at_node = is_kept[patch]
    node, component, _ = np.nonzero(is_kept_at_node)
    patch_of_column = np.nonzero(is_kept)[0]
    return (
        node * s + component,
        column_at_node[is_kept_at_node],
        values[is_kept_at_node],
        division.owner[patch_of_column],
    )


def affine_functions(X: Array, division: Division) -> Array:
    """The functions f = (1, (X - mean X)/radius) (n, 4) at undeformed positions X (n, 3) [m]; mean
    and radius (root mean square distance) are those of the patch of a node.  Collective on the
    ranks of the patches."""
    patch = division.patch
    f = np.ones((len(X), 4))
    nodes_in_patch = _sums(f[:, :1], division)
    mean = _sums(X, division) / nodes_in_patch
    f[:, 1:] = X - mean[patch]
    squared_distance = (f[:, 1:] ** 2).sum(axis=1, keepdims=True)
    squared_radius = _sums(squared_distance, division) / nodes_in_patch
    # A patch of a single node has the radius zero.
    radius = np.maximum(np.sqrt(squared_radius), TINY)
    f[:, 1:] /= radius[patch]
    return f


def _sums(values: Array, division: Division) -> Array:
    """Sums (patches, ...) of the values (n, ...) at the nodes of each patch.  Collective on the
    ranks of the patches."""
    patch = division.patch
    shape = (len(division.owner), len(patch))
    is_in = csr_matrix((np.ones(len(patch)), (patch, np.arange(len(patch)))), shape=shape)
    own = is_in @ values.reshape(len(patch), -1)
    return division.comm.allreduce(own).reshape(-1, *values.shape[1:])


def orthonormalise(f: Array, g: Array, division: Division) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Coefficients V λ^(-1/2) (patches, s, 4, 4) by which affine functions f (n, 4) on patches of
    nodes become orthonormal, and whether each is kept (patches, s, 4).  Collective on the ranks of
    the patches.

    V and λ are eigenvectors and eigenvalues of the Gram matrix of each patch and component, from
    the functions g (n, s, 4) with zeros at fixed coordinates.  Functions with λ below a thousandth
    of the largest one are dropped: their coefficients are zero.
    """
    # As g is f or zero, g f is g g.
    gram = _sums(g[:, :, :, None] * f[:, None, None, :], division)
    λ, V = np.linalg.eigh(gram)
    largest = λ.max(axis=-1, keepdims=True)
    is_kept = λ > FLATNESS * np.maximum(largest, LESS_THAN_ONE_NODE)
    root = np.sqrt(np.maximum(λ, TINY))
    scale = np.where(is_kept, 1 / root, 0.0)
    return V * scale[..., None, :], is_kept


# ---- patches -------------------------------------------------------------------------------------


def patches(body: MeshBody, X: Array, nodes_per_patch: int = NODES_PER_PATCH) -> Indices:
    """Divide the nodes of this rank, at undeformed positions X (n, 3) [m], into connected patches
    of at most `nodes_per_patch` nodes: their numbers (n,), without gaps.

    Nodes are halved across their longest extent until a box has few enough.  Nodes of a box that
    are not connected by cells within it are then separated, such as the two films of a flat pillow.
    """
    n = len(X)
    neighbours = _neighbours(cell_nodes(body.space))
    # Ghosts beyond the first n nodes do not count.
    is_own = (neighbours < n).all(axis=1)
    return _connected(_boxes(X, nodes_per_patch), neighbours[is_own])


def groups(body: MeshBody, X: Array, patch: Indices) -> Division:
    """Collect the patches (n,) of the nodes of all ranks, at undeformed positions X (n, 3) [m], in
    groups of at most `PATCHES_PER_GROUP` patches, as `patches` collects nodes.  Collective.

    Every rank has the centres of all patches, and the pairs of them that are neighbours.
    """
    comm = body.space.mesh.comm
    first = comm.exscan(_count(patch)) or 0
    number = la.vector(body.space.dofmap.index_map, dtype=np.int64)
    number.array[: len(patch)] = first + patch
    number.scatter_forward()
    neighbours = _neighbours(number.array[cell_nodes(body.space)])

    division = Division(patch, np.full(_count(patch), comm.rank), MPI.COMM_SELF)
    centres = _sums(X, division) / _sums(np.ones((len(X), 1)), division)
    all_centres = np.concatenate(comm.allgather(centres))
    all_owners = np.concatenate(comm.allgather(division.owner))
    all_neighbours = np.concatenate(comm.allgather(neighbours))
    group = _connected(_boxes(all_centres, PATCHES_PER_GROUP), all_neighbours)
    # The rank of the first patch of a group has its unknowns.
    first_patch = np.unique(group, return_index=True)[1]
    return Division(group[number.array[: len(patch)]], all_owners[first_patch], comm)


def _count(patch: Indices) -> int:
    """The number of patches that this rank's nodes (n,) are in."""
    return int(patch.max(initial=-1)) + 1


def _boxes(X: Array, size: int) -> Indices:
    """The number (n,) of the box of each point X (n, 3) [m]: points are halved across their longest
    extent until a box has at most `size` of them."""
    n = len(X)
    boxes: list[Indices] = [np.arange(n)]
    while len(boxes) * size < n:
        halves: list[Indices] = []
        for box in boxes:
            halves += _halves(box, X)
        boxes = halves
    box_of_point = np.empty(n, dtype=np.int64)
    for k, points in enumerate(boxes):
        box_of_point[points] = k
    return box_of_point


def _neighbours(numbers_of_cell: Indices) -> Indices:
    """The pairs of numbers (pairs, 2) of which a cell has both, from those of all cells
    (cells, k)."""
    cell_count, per_cell = numbers_of_cell.shape
    cells = np.repeat(np.arange(cell_count), per_cell)
    ones = np.ones(numbers_of_cell.size, dtype=np.int32)
    shape = (cell_count, int(numbers_of_cell.max(initial=-1)) + 1)
    incidence = csr_matrix((ones, (cells, numbers_of_cell.ravel())), shape=shape)
    pairs = (incidence.T @ incidence).tocoo()
    return np.column_stack([pairs.row, pairs.col])


def _connected(box: Indices, neighbours: Indices) -> Indices:
    """The number (n,), without gaps, of the part of a box (n,) in which each point is connected by
    pairs (pairs, 2) of neighbours in one box."""
    in_one_box = box[neighbours[:, 0]] == box[neighbours[:, 1]]
    pairs = neighbours[in_one_box]
    graph = csr_matrix((np.ones(len(pairs)), pairs.T), shape=(len(box), len(box)))
    return connected_components(graph, directed=False)[1]


def _halves(points: Indices, X: Array) -> list[Indices]:
    """The points in two sets of equal size, divided across their longest extent."""
    extents = np.ptp(X[points], axis=0)
    longest = extents.argmax()
    order = np.argsort(X[points, longest], kind="stable")
    middle = len(points) // 2
    return [points[order[:middle]], points[order[middle:]]]
