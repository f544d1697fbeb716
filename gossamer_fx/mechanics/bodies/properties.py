"""What differs from cell to cell of a film: numbers of its law (devices, patches, seams), and the
axes of an orthotropic law, projected on the film."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from types import SimpleNamespace
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import compute_midpoints

from gossamer_fx.core.checks.errors import InputError, check, check_on_all, real_numbers
from gossamer_fx.core.checks.user_functions import ask_points
from gossamer_fx.core.forms.backend import cell_nodes
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.mesh.mesh import Mesh
from gossamer_fx.core.mesh.quality import area_vectors, corner_points
from gossamer_fx.core.model.body import Array, Indices
from gossamer_fx.mechanics.materials.film import FilmLaw

Property = Mapping[str, Any] | Callable[[Array], Array]  # {group: value}, or of points (3, n)

# Numbers of laws that may vary: each is above its first limit, and at most the second.
LIMITS = {
    "E": (0.0, np.inf),
    "E1": (0.0, np.inf),
    "E2": (0.0, np.inf),
    "G12": (0.0, np.inf),
    "nu": (-1.0, 0.5),
    "density": (0.0, np.inf),
    "thickness": (0.0, np.inf),
}
# Part of a direction that must lie in the film: below it the projection is round-off.
SMALLEST_PROJECTION = 1e-6


def vary(
    constants: SimpleNamespace,
    law: FilmLaw,
    mesh: Mesh,
    properties: Mapping[str, Property],
    name: str,
) -> None:
    """Replace numbers of a film law, in `constants`, by functions that are constant in each cell.
    Collective.

    Where nothing is given the number of the law holds.  `InputError`: a number that cannot vary (of
    a law with numbers that are derived from others all but the density), or values out of `LIMITS`.
    """
    # Numbers that a law computes from its arguments would stay those of the constant ones.
    derived = [f.name for f in fields(law) if not f.init]
    may_vary = [what for what in LIMITS if hasattr(law, what)]
    choices = ["density"] if derived else may_vary
    for what, given in properties.items():
        check(
            what in may_vary,
            f"Membrane '{name}': there is no property {what!r} that may vary; "
            f"choose from {', '.join(choices)}.",
        )
        check(
            not derived or what == "density",
            f"Membrane '{name}': "
            f"{type(law).__name__} has numbers derived from its {what} ({', '.join(derived)}), "
            "so it cannot vary; use another law.",
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


def cellwise(mesh: Mesh, given: Any, base: Any, shape: tuple[int, ...], what: str) -> fem.Function:
    """A function of this shape, () for numbers, that is constant in each cell of a mesh of
    triangles or lines, ghosts included.  Collective.

    It is given as {group: value}, with the value `base` in cells of no group (in all, for {}), or
    as a function of midpoints (3, n) [m] that returns (*shape, n).  `what` is the subject of the
    messages about groups that do not consist of cells, values of another shape, and values that are
    not finite.
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
            values[cells_of_group(mesh, group, what)] = numbers.ravel()
    check_on_all(
        mesh.comm,
        bool(np.isfinite(values).all()),
        f"{what} is not finite everywhere; correct its values.",
    )
    function.x.array.reshape(-1, size)[cell_nodes(function.function_space).ravel()] = values
    return function


def cells_of_group(mesh: Mesh, group: str, what: str) -> Indices:
    """Local cells (n,) of a named group of triangles or lines, owned and ghost.  `InputError`,
    which begins with `what`: a group of another dimension."""
    dim, cells = mesh.group(group, what)
    wanted = mesh.domain.topology.dim
    check(
        dim == wanted,
        f"{what}: the group '{group}' has dimension {dim}; "
        f"name a group of the cells, of dimension {wanted}.",
    )
    return cells


def owned_values(function: fem.Function) -> Array:
    """Values (n, *shape) in the n cells that this rank owns, of a function constant in each."""
    space = function.function_space
    topology = space.mesh.topology
    owned = topology.index_map(topology.dim).size_local
    values: Array = function.x.array.reshape(-1, *space.value_shape)
    return values[cell_nodes(space)[:owned].ravel()]


def cell_normals(mesh: Mesh) -> Array:
    """Unit normals (n, 3) of the n triangles that this rank owns."""
    normals = area_vectors(corner_points(mesh.domain))
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _numbers(value: Any, shape: tuple[int, ...], what: str) -> Array:
    """The value as an array of this shape; `what` begins the message about another value."""
    numbers = real_numbers(value)
    if numbers is None or numbers.shape != shape:
        wanted = f"numbers of shape {shape}" if shape else "a number"
        raise InputError(f"{what} is {value!r}; give {wanted}.")
    return numbers


def direction_field(mesh: Mesh, given: Any, name: str) -> fem.Function:
    """The first axis of an orthotropic film as a vector (3,) in each cell, of any length and not
    yet projected on the film.  Collective.

    It is given as a vector (3,), {group: vector}, or a function of points (3, n) that returns (3,
    n).
    """
    what = f"Membrane '{name}': the direction of its law"
    if callable(given) or isinstance(given, Mapping):
        function = cellwise(mesh, given, np.zeros(3), (3,), what)
    else:
        function = cellwise(mesh, {}, given, (3,), what)
    _check_in_film(mesh, function, what)
    return function


def _check_in_film(mesh: Mesh, function: fem.Function, what: str) -> None:
    """Check that the directions (3,) of all cells have a length, and a part in the film.
    Collective."""
    directions = owned_values(function)
    # Zero first: a vector without length would also fail the next check, with the wrong advice.
    lengths = np.linalg.norm(directions, axis=1)
    check_on_all(
        mesh.domain.comm,
        bool((lengths > 0).all()),
        f"{what} is zero or not given in some cells; "
        "give a vector everywhere (of groups: of all surfaces).",
    )
    normals = cell_normals(mesh)
    across = np.einsum("ni,ni->n", normals, directions)
    in_film = directions - across[:, None] * normals
    check_on_all(
        mesh.domain.comm,
        bool((np.linalg.norm(in_film, axis=1) > SMALLEST_PROJECTION * lengths).all()),
        f"{what} is normal to the film in some cells; "
        "give one that can be projected on it, by groups if need be.",
    )


def set_axes(constants: SimpleNamespace, direction: fem.Function, frame: Expr) -> None:
    """Add `direction`, `cosine` and `sine` of the first axis of a film to the constants of its law.
    The angle is that of the part of `direction` in the film, in the local frame (3, 2) of the
    triangles."""
    # Projected in the form, not here: a sensitivity to the shape of the mesh turns the axes with
    # it.
    projected = ufl.dot(frame.T, direction)
    length = ufl.sqrt(ufl.dot(projected, projected))
    constants.direction = direction
    constants.cosine = projected[0] / length
    constants.sine = projected[1] / length
