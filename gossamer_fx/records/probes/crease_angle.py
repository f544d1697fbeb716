"""A probe of the angle of a crease."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import InputError, check
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.connectors.crease import Crease
from gossamer_fx.mechanics.connectors.crease_energies import CreaseEnergies
from gossamer_fx.solve.system.system import System
from gossamer_fx.solve.view import StateView

# What is reported of the angles along a crease
ANGLES = ("mean", "least", "largest", "rest")


@check_arguments
class FoldAngle:
    """Angle [rad] of a crease: positive for a valley fold, zero where it is flat.

    Args:
        crease: a crease of the scene.
        which: "mean", "least" or "largest" along the crease, or "rest" for the mean of its rest
            angle, which changes if the crease yields.  Means are weighted with the stiffness of the
            crease along it.

    Raises:
        InputError: `which` is unknown; when called, the crease is not in the scene.

    Example:
        >>> crease = gx.connectors.Crease(creased, "crease", stiffness=0.01)
        >>> angle = gx.probes.FoldAngle(crease, "mean")
    """

    def __init__(self, crease: Crease, which: str = "mean") -> None:
        check(which in ANGLES, f"FoldAngle: which is {which!r}; choose among: {', '.join(ANGLES)}.")
        self.crease = crease
        self.which = which

    def __call__(self, run: StateView) -> float:
        """The angle [rad] in the state of a run."""
        return self.of(run.system)

    def of(self, system: System) -> float:
        """The angle [rad] in the state of a system, e.g. that of an `Equilibrium`.  Collective.

        Args:
            system: a compiled scene with the crease.

        Raises:
            InputError: the crease is not in the scene.
        """
        energy = self.crease.energy
        angles, rest_angles = self._compiled(system).angles(energy)
        # A rank may have no point of the crease: infinities are neutral then.
        if self.which == "least":
            least = float(angles.min(initial=np.inf))
            return float(system.comm.allreduce(least, op=MPI.MIN))
        if self.which == "largest":
            largest = float(angles.max(initial=-np.inf))
            return float(system.comm.allreduce(largest, op=MPI.MAX))
        if self.which == "rest":
            return _mean(system, energy.stiffness, rest_angles)
        return _mean(system, energy.stiffness, angles)

    def _compiled(self, system: System) -> CreaseEnergies:
        """The compiled creases of a scene, among them this one."""
        energy = self.crease.energy
        for creases in system.compiled_as(CreaseEnergies):
            if any(term is energy for term in creases.terms):
                return creases
        raise InputError(f"'{self.crease.name}' is not in the scene; add it, or remove its probe.")


def _mean(system: System, weights: Array, values: Array) -> float:
    """Weighted mean over the points of all ranks."""
    own_sums = np.array([float(weights @ values), float(weights.sum())])
    total, weight = system.comm.allreduce(own_sums)
    return float(total / weight)
