"""Numbers of a film law that differ from cell to cell: devices, patches, seams."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from types import SimpleNamespace
from typing import Any

import numpy as np
from dolfinx import fem
from dolfinx.mesh import compute_midpoints

from gossamer_fx.core.checks.errors import InputError, check, check_on_all, real_numbers
from gossamer_fx.core.checks.user_functions import ask_points
from gossamer_fx.core.forms.backend import cell_nodes
from gossamer_fx.core.mesh.mesh import Mesh
from gossamer_fx.core.model.body import Array, Indices
from gossamer_fx.mechanics.bodies.meshed import Property
from gossamer_fx.mechanics.materials.film import FilmLaw

LIMITS = {
    "E": (0.0, np.inf),
    "E1": (0.0, np.inf),
    "E2": (0.0, np.inf),
    "G12": (0.0, np.inf),
    "nu": (-1.0, 0.5),
    "density": (0.0, np.inf),
    "thickness": (0.0, np.inf),
}


def vary(
    constants: SimpleNamespace,
    law: FilmLaw,
    mesh: Mesh,
    properties: Mapping[str, Property],
    name: str,
) -> None:
    """Replace some numbers of a film law by functions that are constant in each cell.  Collective.

    Args:
        constants: coefficients of the law for UFL forms, changed in place.
        law: the law, whose numbers hold where nothing is given.
        mesh: of the film.
        properties: by name of the number, as "E" [Pa], "nu" [-], "density" [kg/m³], "thickness"
            [m]: {group of surfaces: value}, or a function of midpoints (3, n) [m] that returns
            (n,).
        name: of the film, for messages.

    Raises:
        InputError: a number that the law has not, or that would change derived ones; values out of
            their limits.
    """
    # Numbers that a law computes from its arguments would stay those of the constant ones.
    derived = [f.name for f in fields(law) if not f.init]
    may_vary = [what for what in LIMITS if hasattr(law, what)]
    for what, given in properties.items():
        check(
            what in may_vary,
            f"Membrane '{name}': there is no property {what!r} that may vary; choose from "
            f"{', '.join(may_vary)}.",
        )
        check(
            not derived or what == "density",
            f"Membrane '{name}': {type(law).__name__} has numbers derived from its {what} "
            f"({', '.join(derived)}), so "
            "it cannot vary; use another law.",
        )
        function = cellwise(mesh, given, getattr(law, what), (), f"Membrane '{name}': its {what}")
        low, high = LIMITS[what]
        values = function.x.array
        limits = f"above {low:g}"
        if np.isfinite(high):
            limits += f" and up to {high:g}"
        # `cellwise` has refused infinite values.
        is_within = bool(((values > low) & (values <= high)).all())
        check_on_all(
            mesh.comm,
            is_within,
            f"Membrane '{name}': its {what} is not {limits} everywhere; correct its values.",
        )
        setattr(constants, what, function)


def cellwise(
    mesh: Mesh,
    given: Any,
    base: Any,
    shape: tuple[int, ...],
    what: str,
) -> fem.Function:
    """A function that is constant in each cell, from values by group or a function of midpoints.
    Collective.

    Args:
        mesh: of triangles or lines.
        given: {group: value}, the other cells have `base`; or a function of points (3, n) [m] that
            returns (*shape, n).
        base: value of cells that are in no group.
        shape: shape of the values, () for numbers.
        what: subject of the messages.

    Returns:
        Discontinuous function of order 0, ghosts included, in the unit of what was given.

    Raises:
        InputError: a group that does not consist of cells, a value of another shape or not finite,
            or a function that raises or returns something else.
    """
    function = fem.Function(fem.functionspace(mesh.domain, ("Discontinuous Lagrange", 0, shape)))
    dim = mesh.domain.topology.dim
    index_map = mesh.domain.topology.index_map(dim)
    # Ghost cells are computed, not sent: each rank has the groups and midpoints of all its cells.
    cells = np.arange(index_map.size_local + index_map.num_ghosts)
    size = int(np.prod(shape, dtype=int))
    values = np.tile(np.asarray(base, dtype=float).ravel(), (len(cells), 1))
    if callable(given):
        points = compute_midpoints(mesh.domain, dim, cells.astype(np.int32)).T
        wanted = (*shape, points.shape[1])
        found = ask_points(mesh.comm, f"{what} function", lambda: given(points), wanted)
        values[:] = found.reshape(size, -1).T
    else:
        for group, value in given.items():
            numbers = _numbers(value, shape, f"{what} in '{group}'")
            values[_cells(mesh, group, what)] = numbers.ravel()
    check_on_all(
        mesh.comm,
        bool(np.isfinite(values).all()),
        f"{what} is not finite everywhere; correct its values.",
    )
    function.x.array.reshape(-1, size)[cell_nodes(function.function_space).ravel()] = values
    return function


def _cells(mesh: Mesh, group: str, what: str) -> Indices:
    """Local cells (n,) of a named group of triangles or lines, owned and ghost.

    Raises:
        InputError: the mesh has no such group, or it does not consist of cells of the mesh.
    """
    dim, cells = mesh.group(group)
    if mesh.domain.topology.dim == 1:
        check(
            dim == 1,
            f"{what}: the group '{group}' is not a group of line elements; name a curve of the "
            "mesh.",
        )
        return cells
    check(
        dim == 2,
        f"{what}: the group '{group}' is not a group of triangles; name a surface of the mesh.",
    )
    return cells


def _numbers(value: Any, shape: tuple[int, ...], what: str) -> Array:
    """The value as an array of this shape; `what` begins the message about another value."""
    numbers = real_numbers(value)
    if numbers is None or numbers.shape != shape:
        wanted = f"numbers of shape {shape}" if shape else "a number"
        raise InputError(f"{what} is {value!r}; give {wanted}.")
    return numbers
