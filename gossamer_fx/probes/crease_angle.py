"""The angle of a crease as a probe."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.connectors.crease import Crease
from gossamer_fx.connectors.crease_energies import CreaseEnergies
from gossamer_fx.probes.run import Run
from gossamer_fx.system.system import System

KINDS = ("mean", "least", "largest", "rest")


@check_arguments
class FoldAngle:
    """Angle [rad] of a crease, positive for a valley fold, zero where it is flat.

    Args:
        crease: in the scene.
        which: "mean", "least" or "largest" along it, or "rest": the mean of its rest angle, which may have yielded.
    """

    def __init__(self, crease: Crease, which: str = "mean") -> None:
        check(which in KINDS, f"FoldAngle: which is {which!r}; choose among: {', '.join(KINDS)}.")
        self.crease, self.which = crease, which

    def __call__(self, run: Run) -> float:
        return self.of(run.system)

    def of(self, system: System) -> float:
        """The angle in the state of a system, e.g. that of an `Equilibrium`.

        Raises:
            InputError: the crease is not in it.
        """
        energy = self.crease.energy
        compiled = [
            c
            for c in system.compiled
            if isinstance(c, CreaseEnergies) and any(t is energy for t in c.terms)
        ]
        check(
            bool(compiled),
            f"'{self.crease.name}' is not in the scene; add it, or remove its probe.",
        )
        θ, rest = compiled[0].angles(energy)
        if self.which in ("mean", "rest"):
            weights, values = energy.stiffness, θ if self.which == "mean" else rest
            total, length = system.comm.allreduce(
                np.array([float(weights @ values), float(weights.sum())])
            )
            return float(total / length)
        if self.which == "least":
            return float(system.comm.allreduce(float(θ.min(initial=np.inf)), op=MPI.MIN))
        return float(system.comm.allreduce(float(θ.max(initial=-np.inf)), op=MPI.MAX))
