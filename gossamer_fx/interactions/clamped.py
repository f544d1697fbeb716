"""Nodes that are held with all their vectors."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from gossamer_fx.bodies.curve import Curve
from gossamer_fx.model.terms import Term
from gossamer_fx.terms.supports import Support


@dataclass(frozen=True, eq=False)
class Clamped:
    """The nodes of a named group keep their initial position and directors.

    Args:
        body: a beam (or a cable, which has positions only).
        group: name of points or curves of its mesh.
    """

    body: Curve
    group: str
    name: str = ""

    def __post_init__(self) -> None:
        self.body.mesh.group(self.group)
        if not self.name:
            object.__setattr__(self, "name", f"{self.body.name}/{self.group} clamped")

    def requires(self) -> Iterable[Any]:
        yield self.body

    def terms(self) -> Iterable[Term]:
        size, nodes = self.body.block.size, self.body.nodes(self.group)
        dofs = (size * nodes[:, None] + np.arange(size)).ravel().astype(np.int32)
        yield Support(self.name, self.body, dofs)
