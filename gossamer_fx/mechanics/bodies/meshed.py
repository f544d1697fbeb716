"""What films, cables and beams have in common: named groups of a mesh, ports on it, motions given
as functions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from dolfinx import fem
from mpi4py import MPI

from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.user_functions import ask_points
from gossamer_fx.core.mesh.mesh import Mesh
from gossamer_fx.core.model.body import Array, Block, Port
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.bodies.ports import global_node, interpolated, local_nodes
from gossamer_fx.mechanics.terms.coordinates import Coordinates

PointFunction = Callable[[Array], Array]  # of points (3, n), returns (3, n)
Property = Mapping[str, Any] | Callable[[Array], Array]  # {group: value}, or of points (3, n)


class Meshed(ABC):
    """A body on a mesh."""

    name: str
    comm: MPI.Intracomm
    mesh: Mesh
    space: fem.FunctionSpace
    block: Block

    @cached_property
    @abstractmethod
    def _start(self) -> tuple[Array, Array]:
        """Owned coordinates [m] and velocities [m/s], flattened, node by node: the user's functions
        are asked once."""

    def initial_state(self) -> tuple[Array, Array]:
        return self._start

    @abstractmethod
    def terms(self, start: State) -> Iterable[Term]:
        """The body's own roles."""

    @property
    def full(self) -> Meshed:
        """The body itself: its unknowns are the coordinates of its nodes."""
        return self

    def reconstruct(self, function: fem.Function, unknowns: Array) -> None:
        function.x.array[: len(unknowns)] = unknowns
        function.x.scatter_forward()

    def coordinates(self, alpha: float) -> Coordinates:
        return Coordinates(self.space, alpha)

    def describe(self, node: int) -> str:
        x, y, z = self.space.tabulate_dof_coordinates()[node]
        return f"at the node ({x:.6g}, {y:.6g}, {z:.6g}) m of the mesh"

    def nodes(self, group: str) -> np.ndarray:
        """Local nodes (owned and ghost) of a named group of the mesh."""
        return local_nodes(self.space, self.mesh, group)

    def port(self, group: str) -> Port:
        """The node of a named point of the mesh."""
        return Port(self, (global_node(self, self.mesh, group),))

    def port_at(self, point: Sequence[float]) -> Port:
        """The point that is at `point` [m] of the mesh, also between nodes."""
        return interpolated(self, point)


def checked(function: PointFunction | None, what: str, comm: MPI.Intracomm) -> PointFunction | None:
    """A function or None; see `checked_function`."""
    if function is None:
        return None
    return checked_function(function, what, comm)


def checked_function(function: PointFunction, what: str, comm: MPI.Intracomm) -> PointFunction:
    """The function, with a check of what it returns on all ranks; each calls it with its own
    points."""
    check(
        callable(function),
        f"{what} is {function!r}; give a function of the points (3, n) that returns (3, n).",
    )

    return lambda points: ask_points(comm, what, lambda: function(points), points.shape)


def positions(
    space: fem.FunctionSpace, displacement: PointFunction | None, velocity: PointFunction | None
) -> tuple[Array, Array]:
    """Owned positions and velocities of a body on a mesh at the start.  Collective.

    Args:
        space: Lagrange space (3,) of the coordinates on the mesh.
        displacement: function of points (3, n) [m] that returns (3, n) [m]; None: the mesh itself.
        velocity: function of points (3, n) [m] that returns (3, n) [m/s]; None: at rest.

    Returns:
        Positions (3 n,) [m] and velocities (3 n,) [m/s] of this rank's own nodes, node by node.

    Raises:
        InputError: a function fails or returns another shape; `checked` has wrapped it for that.
    """
    # x, v, u: functions of position, velocity and displacement; X: points (3, n).
    x = fem.Function(space)
    v = fem.Function(space)
    # The mesh itself, at the nodes of the space: between its vertices where the order is 2.
    x.interpolate(lambda X: X)
    if displacement is not None:
        u = fem.Function(space)
        u.interpolate(displacement)
        # Added as vectors: the user's function is asked for displacements at the nodes only.
        x.x.array[:] += u.x.array
    if velocity is not None:
        v.interpolate(velocity)
    owned = space.dofmap.index_map.size_local * 3
    return x.x.array[:owned].copy(), v.x.array[:owned].copy()
