"""Directions of the axes of orthotropic films, projected on the film."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import ufl
from dolfinx import fem

from gossamer_fx.core.checks.errors import check_on_all
from gossamer_fx.core.checks.user_functions import ask_points
from gossamer_fx.core.forms.backend import cell_nodes
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.mesh.mesh import Mesh
from gossamer_fx.core.mesh.quality import area_vectors, corner_points
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.bodies.properties import cellwise

# Part of a direction that must lie in the film: below it the projection is round-off.
SMALLEST_PROJECTION = 1e-6


def direction_field(mesh: Mesh, given: Any, name: str) -> fem.Function:
    """The first axis of an orthotropic film as a vector (3,) in each cell, as it was given.
    Collective.

    Args:
        mesh: of the film.
        given: a vector (3,), {group: vector}, or a function of points (3, n) that returns (3, n).
            Lengths do not count.
        name: of the film, for messages.

    Returns:
        Function that is constant in each cell, with the vectors not yet projected on the film.

    Raises:
        InputError: the direction is normal to the film, zero or not given in some cell.
    """
    what = f"Membrane '{name}': the direction of its law"
    if callable(given):

        def ask(points: Array) -> Array:
            return ask_points(mesh.domain.comm, what, lambda: given(points), points.shape)

        function = cellwise(mesh, ask, np.zeros(3), (3,), what)
    elif isinstance(given, Mapping):
        function = cellwise(mesh, given, np.zeros(3), (3,), what)
    else:
        vector = np.asarray(given, dtype=float)[:, None]

        def everywhere(points: Array) -> Array:
            return np.repeat(vector, points.shape[1], axis=1)

        function = cellwise(mesh, everywhere, vector, (3,), what)
    _check_in_film(mesh, function, what)
    return function


def _check_in_film(mesh: Mesh, function: fem.Function, what: str) -> None:
    """Check that directions have a part in the film in all cells.  Collective.

    Args:
        function: a vector (3,) in each cell, of any length.

    Raises:
        InputError: on all ranks, if a direction is zero or normal to the film in some cell.
    """
    owned = mesh.domain.topology.index_map(2).size_local
    nodes = cell_nodes(function.function_space)[:owned].ravel()
    # Zero first: a vector without length would also fail the next check, with the wrong advice.
    directions = function.x.array.reshape(-1, 3)[nodes]
    lengths = np.linalg.norm(directions, axis=1)
    check_on_all(
        mesh.domain.comm,
        bool((lengths > 0).all()),
        f"{what} is zero or not given in some cells; give a vector everywhere (of groups: of all "
        "surfaces).",
    )
    normals = area_vectors(corner_points(mesh.domain))[:owned]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    across = np.einsum("ni,ni->n", normals, directions)
    in_film = directions - across[:, None] * normals
    check_on_all(
        mesh.domain.comm,
        bool((np.linalg.norm(in_film, axis=1) > SMALLEST_PROJECTION * lengths).all()),
        f"{what} is normal to the film in some cells; give one that can be projected on it, by "
        "groups if need be.",
    )


def set_axes(constants: SimpleNamespace, direction: fem.Function, frame: Expr) -> None:
    """Add direction, cosine and sine of the first axis of a film to the constants of its law.

    Args:
        constants: coefficients of the law for UFL forms; `direction`, `cosine` and `sine` are set.
        direction: vector (3,) in each cell, whose part in the film is the axis.
        frame: local orthonormal frame (3, 2) of the triangles, to which the angle refers.
    """
    # Projected in the form, not here: a sensitivity to the shape of the mesh turns the axes with
    # it.
    projected = ufl.dot(frame.T, direction)
    length = ufl.sqrt(ufl.dot(projected, projected))
    constants.direction = direction
    constants.cosine = projected[0] / length
    constants.sine = projected[1] / length
