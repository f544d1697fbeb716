"""Nodes that are held, or moved."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np

from gossamer_fx.algebra.point_measures import PointMeasure
from gossamer_fx.bodies.meshed import Meshed
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.checks.user_functions import ask_points
from gossamer_fx.model.body import Array, Indices, Port, Vector
from gossamer_fx.model.ports import unit
from gossamer_fx.model.state import State
from gossamer_fx.model.terms import Term
from gossamer_fx.terms.point_constraints import PointConstraint
from gossamer_fx.terms.supports import Support


def check_support(kind: str, body: Meshed, group: str, components: tuple[int, ...]) -> None:
    """Raise `InputError` for components that are none, and for a group without nodes of the body; on all ranks."""
    check(
        set(components) <= {0, 1, 2} and bool(components),
        f"{kind}: components are {components!r}; choose from 0, 1, 2.",
    )
    body.mesh.group(group)
    nodes = body.nodes(group)
    owned = int((nodes < body.block.index_map.size_local).sum())
    check(
        body.comm.allreduce(owned) > 0,
        f"{kind}: the group '{group}' has no node of '{body.name}', so that nothing would be held; name another group.",
    )


def dofs_of(body: Meshed, nodes: Indices, components: tuple[int, ...]) -> Indices:
    """Scalar indices of some components of the positions of nodes, node by node."""
    dofs: Indices = (
        (body.block.size * nodes[:, None] + np.array(components)).ravel().astype(np.int32)
    )
    return dofs


@check_arguments
@dataclass(frozen=True, eq=False)
class Fixed:
    """A support: the nodes of a named group keep their initial position, or do not move along one direction.

    Args:
        body: a film, plate, cable or beam; the sections of a beam may turn, see `Clamped`.
        group: name of points, curves or surfaces of its mesh.
        components: which of x, y, z (0, 1, 2) are held.
        normal: instead of components, the one direction along which the nodes do not move: they slide in
            the plane with this normal, e.g. a plane of symmetry.  Multipliers hold them, so that the
            matrix is factorised.
        name: name in messages and output.

    Raises:
        InputError: a group that the mesh does not have or that is empty, components that are not
            coordinates, a normal of length zero.

    Example:
        >>> gx.Fixed(film, "left").name
        'film/left fixed (0, 1, 2)'
        >>> gx.Fixed(film, "bottom", normal=(0.0, 1.0, 0.0)).group
        'bottom'
    """

    body: Meshed
    group: str
    _: KW_ONLY
    components: tuple[int, ...] = (0, 1, 2)
    normal: Vector | None = None
    name: str = ""

    def __post_init__(self) -> None:
        check_support("Fixed", self.body, self.group, self.components)
        if self.normal is not None:
            check(
                any(self.normal),
                f"Fixed: normal is {self.normal!r}; give three numbers, not all zero.",
            )
        if not self.name:
            along = self.components if self.normal is None else f"across {tuple(self.normal)}"
            object.__setattr__(self, "name", f"{self.body.name}/{self.group} fixed {along}")

    def requires(self) -> Iterable[Any]:
        yield self.body

    def terms(self, start: State) -> Iterable[Term]:
        nodes = self.body.nodes(self.group)
        if self.normal is None:
            yield Support(self.name, self.body, dofs_of(self.body, nodes, self.components))
            return
        n, index_map = unit(self.normal), self.body.block.index_map
        own = nodes[nodes < index_map.size_local]
        x = start[self.body].positions()[own]
        places = [(Port(self.body, (int(node),)),) for node in index_map.local_to_global(own)]
        yield PointConstraint(
            self.name, PointMeasure(places, np.zeros((1, 3, 3)), n[None], -(x @ n).reshape(-1, 1))
        )


@check_arguments
@dataclass(frozen=True, eq=False)
class Prescribed:
    """A prescribed motion of the nodes of a named group; the work of what moves them is booked as supplied.

    The initial velocity of the nodes is that of the body.  Where it differs from the rate of the motion,
    the midpoint rule carries the difference on as an oscillation of the velocity from step to step.

    Args:
        body: a film, plate, cable or beam.
        group: name of points, curves or surfaces of its mesh.
        motion: displacement [m] of the points (3, n) of the stress-free shape at a time [s], of shape
            (3, n).
        components: which of x, y, z (0, 1, 2) are prescribed; the others are free.
        name: name in messages and output.

    Raises:
        InputError: a group that the mesh does not have or that is empty, components that are not
            coordinates; during a run: a motion that is not finite or of another shape.

    Example:
        >>> def stretch(X, t):
        ...     return 1e-3 * t * X
        >>> gx.constraints.Prescribed(film, "right", motion=stretch, components=(0,)).components
        (0,)
    """

    body: Meshed
    group: str
    _: KW_ONLY
    motion: Callable[[Array, float], Array]
    components: tuple[int, ...] = (0, 1, 2)
    name: str = ""

    def __post_init__(self) -> None:
        check_support("Prescribed", self.body, self.group, self.components)
        if not self.name:
            object.__setattr__(
                self, "name", f"{self.body.name}/{self.group} moved {self.components}"
            )

    def requires(self) -> Iterable[Any]:
        yield self.body

    def terms(self, start: State) -> Iterable[Term]:
        nodes = self.body.nodes(self.group)
        components = list(self.components)
        X = self.body.space.tabulate_dof_coordinates()[nodes].T

        def position(t: float) -> Array:
            u = ask_points(
                self.body.comm,
                f"'{self.name}' at t = {t:.6g} s",
                lambda: self.motion(X, t),
                X.shape,
            )
            return (X + u).T[:, components].ravel()

        yield Support(self.name, self.body, dofs_of(self.body, nodes, self.components), position)
