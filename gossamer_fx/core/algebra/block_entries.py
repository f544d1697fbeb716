"""Bilinear forms in the stored blocks of a PETSc matrix whose pattern does not change.

Problem.  PETSc searches the position of each block of a cell in its row, in every assembly again.

Idea.  The positions are found once.  The loop of `cells.c` computes the matrix of a cell and adds
its blocks there.  Cells at the boundary of a rank's part have nodes of other ranks; theirs are
entered by PETSc.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import partial

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from petsc4py import PETSc

from gossamer_fx.core.forms.c_source import c_library
from gossamer_fx.core.forms.cell_loops import HEADER, prepared_integral
from gossamer_fx.core.model.body import Array

# The library to which petsc4py is linked, for C functions that it does not offer.
PETSC = ctypes.CDLL(PETSc.__file__)

# Rows or columns of a matrix, or keys of its blocks (n,).
type Numbers = npt.NDArray[np.int64]


def block_assembly(
    A: PETSc.Mat, form: fem.Form, unknowns: npt.NDArray[np.int32] | npt.NDArray[np.int64]
) -> Callable[[], None] | None:
    """Return what adds a compiled bilinear form to a matrix of fixed pattern that is assembled;
    None: the form is not one integral over cells, or PETSc does not store blocks with 32 bits for
    an index.  `unknowns` are the global indices of all unknowns of the form's space on this rank.
    Collective."""
    if A.getType() not in ("seqbaij", "mpibaij") or PETSc.IntType != np.int32:
        return None
    prepared = prepared_integral(form)
    if prepared is None:
        return None
    function, cells, nodes = prepared
    c = cells.library
    size = A.getBlockSize()
    # A node may have several blocks.
    blocks = (unknowns[::size] // size).reshape(-1, form.function_spaces[0].dofmap.bs // size)
    # Not -1, which says nothing on a rank without cells.
    k = nodes.shape[1] * blocks.shape[1]
    rows = np.ascontiguousarray(blocks[nodes].reshape(len(nodes), k), dtype=np.int32)
    own = A.getDiagonalBlock()
    positions = _positions(own, rows - A.getOwnershipRange()[0] // size)
    values = stored_blocks(own)
    to = c.struct(
        "block_matrix",
        {
            "size": size,
            "node_count": k,
            "values": c.array("values", values, "float64", values.shape, writable=True),
            "positions": c.array("positions", positions, "int32", (len(rows), k, k)),
            "rows": c.array("rows", rows, "int32", rows.shape),
            "matrix": A.handle,
            "set_values": ctypes.cast(PETSC.MatSetValuesBlocked, ctypes.c_void_p).value,
        },
    )
    add = function.applied("add_to_blocks", to, (k * size) ** 2)

    def assemble() -> None:
        error = add()
        own.stateIncrease()
        if error:
            raise PETSc.Error(error)

    return assemble


def block_entry(
    A: PETSc.Mat, rows: Numbers, columns: Numbers, blocks: Array
) -> Callable[[], None] | None:
    """Return what adds the present values of `blocks` (b, 9), each column by column, to a matrix of
    fixed pattern that is assembled, at block rows and columns (b,), so that its state has to be
    increased; None: PETSc does not store it on one rank in blocks of three."""
    if A.getType() != "seqbaij" or A.getBlockSize() != 3:
        return None
    keys = rows * (A.getSize()[0] // 3) + columns
    positions = block_keys(A).searchsorted(keys).astype(np.int32)
    values = stored_blocks(A)
    c = c_library(HEADER)
    return partial(
        c.lib.add_at_positions,
        c.array("blocks", blocks, "float64", (len(keys), 9)),
        c.array("positions", positions, "int32", (len(keys),)),
        len(keys),
        c.array("values", values, "float64", values.shape, writable=True),
    )


def stored_blocks(matrix: PETSc.Mat) -> Array:
    """The stored blocks (k, size²) of an assembled matrix on one rank, in the order of rows and
    columns, each block column by column.

    petsc4py does not offer them.  The array is the memory of the matrix, valid while the matrix
    exists and has the same pattern.  After a change call `stateIncrease` of the matrix, or solvers
    use what they made of the old values.
    """
    address = ctypes.c_void_p()
    error = PETSC.MatSeqBAIJGetArray(ctypes.c_void_p(matrix.handle), ctypes.byref(address))
    if error:
        raise PETSc.Error(error)
    count = int(matrix.getInfo()["nz_used"])
    size = matrix.getBlockSize() ** 2
    if address.value is None or not count:
        return np.zeros((0, size))
    return np.frombuffer((ctypes.c_double * count).from_address(address.value)).reshape(-1, size)


def block_keys(matrix: PETSc.Mat) -> Numbers:
    """Keys (k,) of the stored blocks of an assembled square matrix on one rank: block row times the
    number of block rows, plus block column.  They rise, as PETSc sorts the columns of a row."""
    starts, columns = matrix.getRowIJ(compressed=True)
    count = len(starts) - 1
    of_row = np.repeat(np.arange(count, dtype=np.int64), np.diff(starts))
    return of_row * count + columns


def _positions(own: PETSc.Mat, rows: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
    """Positions (cells, k, k) of the blocks of cells with nodes (cells, k), by their local numbers,
    among the stored blocks of a matrix; -1 in cells that have another node."""
    stored = block_keys(own)
    count = own.getSize()[0] // own.getBlockSize()
    is_own = ((rows >= 0) & (rows < count)).all(axis=1)
    wanted = rows[is_own].astype(np.int64)
    pairs = wanted[:, :, None] * count + wanted[:, None, :]
    found = np.searchsorted(stored, pairs)
    if not np.array_equal(stored.take(found, mode="clip"), pairs):
        raise ValueError("The pattern of the matrix has no place for a cell.")
    positions = np.full((*rows.shape, rows.shape[1]), -1, dtype=np.int32)
    positions[is_own] = found
    return positions
