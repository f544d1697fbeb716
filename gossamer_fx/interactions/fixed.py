"""Nodes that are held."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.errors import check
from gossamer_fx.parts import Constraint, Part


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

    def parts(self) -> Iterable[Part]:
        nodes = self.body.nodes(self.group)
        dofs = (3 * nodes[:, None] + np.array(self.components)).ravel().astype(np.int32)
        yield Constraint(self.name, self.body, dofs)
