"""Node numbers of the cells of function spaces."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from dolfinx import fem


def cell_nodes(space: fem.FunctionSpace) -> npt.NDArray[np.int32]:
    """Local node numbers (cells, k) of all cells of a space: owned cells first, then ghost cells.

    In each row the corners of the cell come first; nodes on edges follow in the order of the
    element.
    """
    nodes: npt.NDArray[np.int32] = space.dofmap.list
    return nodes
