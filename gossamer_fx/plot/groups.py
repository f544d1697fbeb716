"""The parts of films that pictures tell apart: films, and the groups of their cells."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.model.body import Array

# told apart with any colour vision (Okabe & Ito 2008)
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000")


def groups_of(films: Sequence[Membrane]) -> tuple[list[str], list[npt.NDArray[np.int64]]]:
    """Names of the parts of films, and which of them each of this rank's cells of each film is in; collective.

    They are the groups of its cells, if there are several that are not hidden by later ones, else the film.
    """
    names: list[str] = []
    parts = []
    for film in films:
        count = film.mesh.domain.topology.index_map(2).size_local
        surfaces = [(name, found) for name, (dim, found) in film.mesh.groups.items() if dim == 2]
        of_cells = np.full(count, len(surfaces))
        for k, (_, found) in enumerate(surfaces):
            of_cells[found[found < count]] = k
        here = np.bincount(of_cells, minlength=len(surfaces) + 1) > 0
        seen = np.flatnonzero(film.comm.allreduce(here.astype(np.int64)))
        if len(seen) < 2:
            seen, of_cells, own = np.array([0]), np.zeros(count, dtype=np.int64), [film.name]
        else:
            prefix = f"{film.name}: " if len(films) > 1 else ""
            own = [
                f"{prefix}{surfaces[k][0]}" if k < len(surfaces) else f"{prefix}rest" for k in seen
            ]
        parts.append(np.searchsorted(seen, of_cells) + len(names))
        names += own
    return names, parts


def colour_table(kinds: int) -> Array:
    """Red, green and blue in [0, 1] (kinds, 3)."""
    numbers = [
        [int(COLOURS[k % len(COLOURS)][i : i + 2], 16) for i in (1, 3, 5)] for k in range(kinds)
    ]
    return np.array(numbers, dtype=float).reshape(kinds, 3) / 255
