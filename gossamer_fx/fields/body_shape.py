"""The shape of a body on a mesh in the accepted state, also of a reduced one, whose unknowns are not its nodes'."""

from __future__ import annotations

from typing import Any

from dolfinx import fem

from gossamer_fx.model.terms import MeshBody, has_nodal_unknowns
from gossamer_fx.system.system import System


class BodyShape:
    """Coordinates q and velocities v of a body as functions, for expressions of them; `update` takes them.

    body   whose mesh, law and measures they belong to: of a reduced film, the film that was reduced
    """

    def __init__(self, system: System, body: MeshBody) -> None:
        k = system.bodies.index(body)
        self._system, self._owned, self._reduced = system, system.numbering.owned(k), None
        self.body: Any = body
        if not has_nodal_unknowns(body):
            self._reduced = self.body
            self.body = self._reduced.full
        self.q, self.v = fem.Function(self.body.space), fem.Function(self.body.space)

    def update(self) -> None:
        for function, vector in ((self.q, self._system.q0), (self.v, self._system.v0)):
            values = vector.array_r[self._owned]
            if self._reduced is not None:
                self._reduced.reconstruct(function, values)
            else:
                function.x.array[: len(values)] = values
                function.x.scatter_forward()
