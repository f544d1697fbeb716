"""Numbers of a state for scripts: positions, strains, stresses of a run as it is, or of an equilibrium."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.fields.fields import FieldFunctions
from gossamer_fx.model.body import Array, Body, MeshBody, is_on_mesh
from gossamer_fx.system.system import System


@runtime_checkable
class HasSystem(Protocol):
    """A run, or an equilibrium."""

    system: System


@check_arguments
def positions(state: HasSystem, body: Body) -> Array:
    """Positions (n, 3) [m] of this rank's nodes of a body, in a `Simulation` as it is or an `Equilibrium`.

    Raises:
        InputError: the body is not in the scene.
    """
    _check_in(state, body)
    return state.system.state[body].positions().copy()


@check_arguments
def field_values(state: HasSystem, body: MeshBody, *, field: str) -> tuple[Array, Array]:
    """Where and what a field is on this rank's cells: points (n, 3) of the stress-free shape [m], and values.

    Args:
        state: a `Simulation`, as it is, or an `Equilibrium`.
        body: a film, cable or beam of its scene.
        field: of those that `VTX` writes, e.g. "displacement", "strain1", "stress1" [Pa], "state".

    Values are (n,) or (n, 3).  Strains and stresses may jump from cell to cell: each cell has points of its own.

    Raises:
        InputError: the body is not in the scene or has no mesh; a field that it has not.
    """
    _check_in(state, body)
    check(
        is_on_mesh(body),
        f"field_values: '{body.name}' has no mesh; ask for the fields of a film, cable or beam.",
    )
    fields = FieldFunctions(state.system, body, [field])
    fields.update()
    function = fields.functions[0]
    size, n = (
        function.function_space.dofmap.index_map_bs,
        function.function_space.dofmap.index_map.size_local,
    )
    values: Array = function.x.array.reshape(-1, size)[:n].copy()
    points = function.function_space.tabulate_dof_coordinates()[:n]
    return np.asarray(points), values[:, 0] if size == 1 else values


def _check_in(state: HasSystem, body: Body) -> None:
    check(
        any(body is known for known in state.system.bodies),
        f"'{getattr(body, 'name', body)}' is not in the scene; ask for one of its bodies.",
    )
