"""Dead load along edges of a film."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import meshtags

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.errors import check, is_vector
from gossamer_fx.model.terms import Term, Vector
from gossamer_fx.terms.loads import Load


@dataclass(frozen=True, eq=False)
class EdgeLoad:
    """Force per reference length along a named group of edges that keeps its direction; δW = ∫f·w ds.

    Args:
        body: the film.
        group: name of curves on its rim.
        force: f [N/m], three numbers or a function of time [s] that returns them.
    """

    body: Membrane
    group: str
    force: Vector | Callable[[float], Vector]
    name: str = ""

    def __post_init__(self) -> None:
        dim, _ = self.body.mesh.group(self.group)
        check(dim == 1, f"EdgeLoad: the group '{self.group}' of '{self.body.name}' is no group of edges; name one.")
        if not self.name:
            object.__setattr__(self, "name", f"{self.body.name}/{self.group} load")

    def requires(self) -> Iterable[Any]:
        yield self.body

    def terms(self) -> Iterable[Term]:
        film = self.body
        domain = film.mesh.domain
        domain.topology.create_connectivity(1, 2)
        _, edges = film.mesh.group(self.group)
        edges = np.unique(edges).astype(np.int32)
        tags = meshtags(domain, 1, edges, np.ones(len(edges), dtype=np.int32))
        force, name = self.force, self.name
        f = fem.Constant(domain, (0.0, 0.0, 0.0) if callable(force) else tuple(float(c) for c in force))
        ds = ufl.Measure("ds", domain, subdomain_data=tags, metadata={"quadrature_degree": film.order})

        def at(t: float) -> None:
            now = np.asarray(force(t) if callable(force) else force, dtype=float)
            check(
                is_vector(now),
                f"'{name}' is {now.tolist()!r} N/m at t = {t:.6g} s; let its function return three numbers.",
            )
            f.value[:] = now

        yield Load(name, film, lambda x, w: ufl.dot(f, w) * ds(1), at=at if callable(force) else None)
