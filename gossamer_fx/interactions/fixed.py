"""Nodes that are held, or moved."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.errors import check
from gossamer_fx.checks.user_functions import ask_points
from gossamer_fx.model.terms import Array, Term
from gossamer_fx.terms.supports import Support


@dataclass(frozen=True, eq=False)
class Fixed:
    """The nodes of a named group keep their initial position.

    Args:
        body: a film.
        group: name of points, curves or surfaces of its mesh.
        components: which of x, y, z (0, 1, 2) are held.
    """

    body: Membrane
    group: str
    components: tuple[int, ...] = (0, 1, 2)
    name: str = ""

    def __post_init__(self) -> None:
        check(
            set(self.components) <= {0, 1, 2} and bool(self.components),
            f"Fixed: components are {self.components!r}; choose from 0, 1, 2.",
        )
        self.body.mesh.group(self.group)
        if not self.name:
            object.__setattr__(self, "name", f"{self.body.name}/{self.group} fixed {self.components}")

    def requires(self) -> Iterable[Any]:
        yield self.body

    def terms(self) -> Iterable[Term]:
        nodes = self.body.nodes(self.group)
        dofs = (3 * nodes[:, None] + np.array(self.components)).ravel().astype(np.int32)
        yield Support(self.name, self.body, dofs)


@dataclass(frozen=True, eq=False)
class Prescribed:
    """The nodes of a named group move as prescribed; the work of what moves them is booked as supplied.

    Args:
        body: a film.
        group: name of points, curves or surfaces of its mesh.
        motion: displacement [m] of the points (3, n) of the stress-free shape at a time [s], shape (3, n).
        components: which of x, y, z (0, 1, 2) are prescribed; the others are free.

    The initial velocity of the nodes is that of the film; where it differs from the rate of the motion, the midpoint
    rule carries the difference on as an oscillation of the velocity from step to step.
    """

    body: Membrane
    group: str
    motion: Callable[[Array, float], Array]
    components: tuple[int, ...] = (0, 1, 2)
    name: str = ""

    def __post_init__(self) -> None:
        check(
            set(self.components) <= {0, 1, 2} and bool(self.components),
            f"Prescribed: components are {self.components!r}; choose from 0, 1, 2.",
        )
        self.body.mesh.group(self.group)
        if not self.name:
            object.__setattr__(self, "name", f"{self.body.name}/{self.group} moved {self.components}")

    def requires(self) -> Iterable[Any]:
        yield self.body

    def terms(self) -> Iterable[Term]:
        nodes = self.body.nodes(self.group)
        components = list(self.components)
        dofs = (3 * nodes[:, None] + np.array(components)).ravel().astype(np.int32)
        X = self.body.space.tabulate_dof_coordinates()[nodes].T

        def position(t: float) -> Array:
            u = ask_points(self.body.comm, f"'{self.name}' at t = {t:.6g} s", lambda: self.motion(X, t), X.shape)
            return (X + u).T[:, components].ravel()

        yield Support(self.name, self.body, dofs, position)
