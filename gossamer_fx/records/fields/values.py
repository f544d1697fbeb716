"""Positions and fields of a state as arrays, for scripts that compute with them."""

from __future__ import annotations

import numpy as np

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array, Body, MeshBody, is_on_mesh
from gossamer_fx.core.model.state import HasSystem
from gossamer_fx.records.fields.body_shape import At
from gossamer_fx.records.fields.fields import FieldFunctions


@check_arguments
def positions(state: HasSystem, body: Body) -> Array:
    """Positions (n, 3) [m] of this rank's nodes of a body.

    Args:
        state: a `Simulation` in its current state, or an `Equilibrium`.
        body: a body of its scene.

    Returns:
        A copy, which does not change with the state.

    Raises:
        InputError: the body is not in the scene.

    Example:
        >>> gx.fields.positions(run, mass)
        array([[ 0.,  0., -1.]])
    """
    _check_in(state, body)
    return state.system.state[body].positions().copy()


@check_arguments
def field_values(
    state: HasSystem, body: MeshBody, *, field: str, at: At = "mean"
) -> tuple[Array, Array]:
    """Points and values of a field on this rank's part of a body.  Collective.

    Args:
        state: a `Simulation` in its current state, or an `Equilibrium`.
        body: a film, plate, cable or beam of its scene.
        field: e.g. "displacement" [m], "strain1", "stress1" [Pa] or "state"; the error of a wrong
            name lists those of the body.
        at: "mean" for stresses, tensions, moments and states of films as means over the last step,
            or "end" for those at its end; of an equilibrium both are the same.

    Returns:
        Points (n, 3) [m] on the stress-free shape, and values (n,) or (n, 3) at these points.
        Fields that jump between cells have points of each cell, so a node occurs several times.

    Raises:
        InputError: the body is not in the scene, has no mesh, or does not have the field.

    Example:
        >>> scene = gx.Scene(film, gx.Fixed(film, "left"))
        >>> points, strain = gx.fields.field_values(
        ...     gx.Simulation(scene, gx.Midpoint(dt=0.1)), film, field="strain1"
        ... )
        >>> float(abs(strain).max()) < 1e-12
        True
    """
    _check_in(state, body)
    check(
        is_on_mesh(body),
        f"field_values: '{body.name}' has no mesh; ask for the fields of a film, cable or beam.",
    )
    fields = FieldFunctions(state.system, body, [field], at=at)
    fields.update()
    function = fields.functions[0]
    space = function.function_space
    # Ghosts follow the owned points; other ranks return those.
    owned = space.dofmap.index_map.size_local
    components = space.dofmap.index_map_bs
    points = np.asarray(space.tabulate_dof_coordinates()[:owned])
    values: Array = function.x.array.reshape(-1, components)[:owned].copy()
    if components == 1:
        values = values[:, 0]
    return points, values


def _check_in(state: HasSystem, body: Body) -> None:
    """Check that a body is in the scene of a run or an equilibrium."""
    # by identity: two bodies may compare equal
    check(
        any(body is known for known in state.system.bodies),
        f"'{getattr(body, 'name', body)}' is not in the scene; ask for one of its bodies.",
    )
