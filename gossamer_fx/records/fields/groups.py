"""Parts of films that pictures and recordings distinguish: films, and the groups of their cells."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from gossamer_fx.mechanics.bodies.membrane import Membrane

Integers = npt.NDArray[np.int64]


def groups_of(films: Sequence[Membrane]) -> tuple[list[str], list[Integers]]:
    """Return the names of the parts of films, and the part of each of this rank's own cells.
    Collective.

    The parts of a film are the groups of cells of its mesh, and "rest" for the cells in no group. A
    cell in several groups belongs to the last of them; a group that has no cell left is not a part.
    A film with one part only is called by the name of the film.  With several films, the names of
    their groups follow that of the film.

    Returns:
        The names of all parts, and for each film the numbers (cells,) of its cells' parts in that
        list.
    """
    names: list[str] = []
    parts: list[Integers] = []
    for film in films:
        film_names, film_parts = _groups_of_film(film)
        if len(films) > 1 and len(film_names) > 1:
            film_names = [f"{film.name}: {name}" for name in film_names]
        parts.append(film_parts + len(names))
        names += film_names
    return names, parts


def _groups_of_film(film: Membrane) -> tuple[list[str], Integers]:
    """Return the names of the parts of one film, and the part of each of this rank's own cells.

    A part is a group of cells of the mesh, or "rest" for the cells in no group.  Collective.

    Returns:
        names, the same on all ranks, and numbers (cells,) into them.
    """
    # The cells of a reduced film are those of the film that was reduced.
    mesh = film.full.mesh
    count = mesh.domain.topology.index_map(2).size_local
    surfaces = [(name, cells) for name, (dim, cells) in mesh.groups.items() if dim == 2]
    names = [name for name, _ in surfaces] + ["rest"]
    rest = len(surfaces)
    of_cells = np.full(count, rest, dtype=np.int64)
    for k, (_, cells) in enumerate(surfaces):
        owned = cells[cells < count]
        of_cells[owned] = k
    # A part counts if any rank has a cell of it, so that all ranks have the same list.
    here = np.bincount(of_cells, minlength=len(names)) > 0
    everywhere = film.comm.allreduce(here.astype(np.int64))
    visible = np.flatnonzero(everywhere)
    if len(visible) < 2:
        return [film.name], np.zeros(count, dtype=np.int64)
    numbers = np.searchsorted(visible, of_cells).astype(np.int64)
    return [names[k] for k in visible], numbers
