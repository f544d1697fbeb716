"""Results of the gas of a run that have derivatives."""

from __future__ import annotations

from petsc4py import PETSc

from gossamer_fx.analysis.sensitivity.objectives import HasScene, chambers_of
from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.gas.volumes import Chamber
from gossamer_fx.solve.system.system import System


@check_arguments
class ChamberPressure:
    """Pressure [Pa] of the gas in a chamber or tank.

    Args:
        chamber: the chamber.

    Example:
        >>> pressure = gx.analysis.ChamberPressure(tank)
        >>> pressure.unit
        'Pa'
    """

    unit = "Pa"

    def __init__(self, chamber: Chamber) -> None:
        self.chamber = chamber

    def _index(self, system: System) -> int:
        chambers = [gas.chamber for gas in chambers_of(system)]
        check(
            any(one is self.chamber for one in chambers),
            f"ChamberPressure: '{self.chamber.name}' is not in the scene; add it.",
        )
        return next(k for k, one in enumerate(chambers) if one is self.chamber)

    def __call__(self, run: HasScene) -> float:
        return float(chambers_of(run.system)[self._index(run.system)].pressure)

    def add_derivative(
        self, system: System, by_position: PETSc.Vec, by_velocity: PETSc.Vec
    ) -> None:
        """Add nothing: it is one of the unknowns, which `add_scalar_derivative` derives by."""

    def add_scalar_derivative(self, system: System, by_scalars: Array) -> None:
        """Add the derivative by itself."""
        by_scalars[self._index(system)] += 1.0
