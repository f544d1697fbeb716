"""The shape of a body on a mesh, as functions of which expressions are made."""

from __future__ import annotations

from typing import Any

from dolfinx import fem

from gossamer_fx.model.body import MeshBody
from gossamer_fx.model.state import State


class BodyShape:
    """Coordinates q and velocities v of a body as functions on its mesh.

    The functions are created once; `update` sets them to the values of the state.  A reduced film has
    no nodal unknowns: then the functions are on the mesh of the film that was reduced.

    Args:
        state: of a run or an equilibrium.
        body: a film, plate, cable or beam in it.

    Attributes:
        body: the body whose mesh, law and measures belong to the functions: of a reduced film the
            film that was reduced, else the body itself.
        q: coordinates: positions [m] and, of a beam, directors.
        v: their rates.

    Raises:
        InputError: the body is not in the scene.
    """

    def __init__(self, state: State, body: MeshBody) -> None:
        """Make the functions; `update` sets their values."""
        self._of = state[body]
        self._reconstruct = body.reconstruct
        self.body: Any = body.full
        self.q = fem.Function(self.body.space)
        self.v = fem.Function(self.body.space)

    def update(self) -> None:
        """Set the functions to the current values of the state, ghosts included.  Collective."""
        # A state is the accepted one: forms of the bodies read the iterate, and are not used here.
        self._reconstruct(self.q, self._of.coordinates().ravel())
        self._reconstruct(self.v, self._of.rates().ravel())
