"""Results that have derivatives: what a gradient is taken of.

An objective is a probe, a function of a run that returns a number, which also knows its derivatives
with respect to coordinates and velocities.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import ufl
from petsc4py import PETSc

from gossamer_fx.core.model.body import Array
from gossamer_fx.solve.system.system import System


class Objective(ABC):
    """A result with derivatives.  All methods are collective.

    Attributes:
        unit: of the result, in SI units.
    """

    unit: str

    @abstractmethod
    def __call__(self, run: Any) -> float:
        """The result in the present state, the same on every rank."""

    @abstractmethod
    def add_derivative(
        self, system: System, by_position: PETSc.Vec, by_velocity: PETSc.Vec
    ) -> None:
        """Add ∂J/∂q and ∂J/∂v of the present state to vectors of the system."""

    def forms(self, system: System) -> list[ufl.Form]:
        """Forms whose sum, at `coordinates[body].q1`, is the part of the result in which parameters
        stand themselves."""
        return []

    def add_scalar_derivative(self, system: System, by_scalars: Array) -> None:
        """Add ∂J/∂y of the present state, y the scalar unknowns of the system in their order, e.g.
        the pressures of gas."""
        return

    def residual_parts(self, system: System) -> Sequence[tuple[PETSc.Vec, PETSc.Vec]]:
        """Coordinates q and weights w, new vectors: by parameters θ the result has the direct
        derivative Σ w·∂r/∂θ(q) of the residual r of an equilibrium, as a reaction or a stiffness
        has; asked after `add_derivative`."""
        return ()

    def mass_parts(self, system: System) -> Sequence[tuple[PETSc.Vec, PETSc.Vec]]:
        """Vectors v and w: by parameters θ the result has the direct derivative Σ w·∂M/∂θ v of the
        masses M; asked after `add_derivative`."""
        return ()


class ForceObjective(Objective):
    """A force in an equilibrium, of which supports bear the part w·r and connectors another one."""

    @abstractmethod
    def residual_weights(self, system: System) -> PETSc.Vec:
        """w, a new vector that is zero at free coordinates."""

    @abstractmethod
    def by_number(self, system: System, compiled: Any, term: Any, key: str) -> float:
        """Direct derivative of the part of connectors by a number of a term, this rank's share."""

    def residual_parts(self, system: System) -> Sequence[tuple[PETSc.Vec, PETSc.Vec]]:
        return [(system.unknowns.q0.copy(), self.residual_weights(system))]
