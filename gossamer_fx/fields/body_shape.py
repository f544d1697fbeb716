"""The shape of a body on a mesh in the accepted state, also of a reduced one."""

from __future__ import annotations

from typing import Any

from dolfinx import fem

from gossamer_fx.model.body import MeshBody
from gossamer_fx.model.state import State


class BodyShape:
    """Coordinates q and velocities v of a body as functions, for expressions of them.

    The functions are made once; `update` gives them the values of the state.

    Args:
        state: of a run or an equilibrium.
        body: a film, plate, cable or beam in it.

    Attributes:
        body: whose mesh, law and measures the functions belong to: of a reduced film, the film that
            was reduced.
    """

    def __init__(self, state: State, body: MeshBody) -> None:
        self._of = state[body]
        self._reconstruct = body.reconstruct
        self.body: Any = body.full
        self.q = fem.Function(self.body.space)
        self.v = fem.Function(self.body.space)

    def update(self) -> None:
        """Take the state as it is now.  Collective."""
        self._reconstruct(self.q, self._of.coordinates().ravel())
        self._reconstruct(self.v, self._of.rates().ravel())
