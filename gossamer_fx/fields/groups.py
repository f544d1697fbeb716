"""The parts of films that pictures and recordings distinguish: films, and the groups of their cells."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from gossamer_fx.bodies.membrane import Membrane

Integers = npt.NDArray[np.int64]


def groups_of(films: Sequence[Membrane]) -> tuple[list[str], list[Integers]]:
    """Names of the parts of films, and which part each of this rank's own cells belongs to.  Collective.

    The parts of a film are the groups of cells of its mesh, if more than one of them is not hidden by later ones, and
    the cells in none of them, called "rest".  A film without such groups is one part.  Where there are several films,
    their names stand before those of their groups.

    Returns:
        The names of all parts, and for each film the numbers (cells,) of its cells' parts among these names.
    """
    names: list[str] = []
    parts: list[Integers] = []
    for film in films:
        own_names, own_parts = _groups_of_film(film)
        if len(films) > 1 and len(own_names) > 1:
            own_names = [f"{film.name}: {name}" for name in own_names]
        parts.append(own_parts + len(names))
        names += own_names
    return names, parts


def _groups_of_film(film: Membrane) -> tuple[list[str], Integers]:
    # the cells of a reduced film are those of the film that was reduced
    mesh = film.full.mesh
    count = mesh.domain.topology.index_map(2).size_local
    surfaces = [(name, cells) for name, (dim, cells) in mesh.groups.items() if dim == 2]
    rest = len(surfaces)
    of_cells = np.full(count, rest, dtype=np.int64)
    for k, (_, cells) in enumerate(surfaces):
        of_cells[cells[cells < count]] = k
    here = np.bincount(of_cells, minlength=rest + 1) > 0
    seen = np.flatnonzero(film.comm.allreduce(here.astype(np.int64)))
    if len(seen) < 2:
        return [film.name], np.zeros(count, dtype=np.int64)
    names = [name for name, _ in surfaces] + ["rest"]
    return [names[k] for k in seen], np.searchsorted(seen, of_cells).astype(np.int64)
