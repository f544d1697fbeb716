"""The shape of a body on a mesh, as functions of which expressions are made."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from dolfinx import fem

from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.model.body import MeshBody
from gossamer_fx.mechanics.terms.element_energies import thermal_strain_of
from gossamer_fx.solve.system.system import System

if TYPE_CHECKING:
    from gossamer_fx.mechanics.bodies.thermal_expansion import ThermalCurvature


class BodyShape:
    """Coordinates q and velocities v of a body as functions on its mesh.

    The functions are created once; `update` sets them to the values of the state.  A reduced film
    has no nodal unknowns: then the functions are on the mesh of the film that was reduced.

    Attributes:
        body: the body whose mesh, law and measures belong to the functions: of a reduced film the
            film that was reduced, else the body itself.
        q: coordinates: positions [m] and, of a beam, directors.
        v: their rates.
        thermal_strain: thermal strain at q, an expression; None without thermal expansion.
        thermal_curvature: of a plate with a gradient of temperature, an expression; else None.
    """

    def __init__(self, system: System, body: MeshBody) -> None:
        self._system = system
        self._of = system.state[body]
        self._reconstruct = body.reconstruct
        self.body: Any = body.full
        # Positions q [m] and velocities v [m/s] of the body
        self.q = fem.Function(self.body.space)
        self.v = fem.Function(self.body.space)
        self.thermal_strain: Expr | None = None
        self.thermal_curvature: Expr | None = None
        self._curvature: ThermalCurvature | None = None
        if getattr(self.body, "thermal", None) is not None:
            self._add_expansion()

    def _add_expansion(self) -> None:
        """Set the thermal strain of the body, if the scene has one, and make its thermal curvature.

        Both are UFL expressions: the strain [-], and the curvature [1/m] of a plate whose sides
        have different temperatures.
        """
        # Imported here: bodies without thermal expansion do not load it.
        from gossamer_fx.mechanics.bodies.thermal_expansion import thermal_curvature

        strain = thermal_strain_of(self._system, self._of.body)
        if strain is not None:
            self.thermal_strain = strain.start
        if getattr(self.body, "has_thermal_curvature", False):
            self._curvature = thermal_curvature(self.body)
            self.thermal_curvature = self._curvature.curvature

    def elastic_strain(self) -> Expr:
        """The measure of the body less its thermal strain, of which stresses are functions."""
        e = self.body.measure(self.q)
        if self.thermal_strain is not None:
            e -= self.thermal_strain
        return e

    def update(self) -> None:
        """Set the functions to the current values of the state, ghosts included.  Collective."""
        # A state is the accepted one: forms of the bodies read the iterate, and are not used here.
        self._reconstruct(self.q, self._of.coordinates().ravel())
        self._reconstruct(self.v, self._of.rates().ravel())
        if self._curvature is not None:
            self._curvature.set(self._curvature.difference, self._system.time)
