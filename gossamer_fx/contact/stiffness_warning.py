"""A warning, told once, when a stiffness that was given cannot stop what comes."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from mpi4py import MPI

from gossamer_fx.contact.kernels.library import Array, Integers

LOG = logging.getLogger("gossamer_fx")


class StiffnessWarning:
    """Whether K d̂² < 4 σ v² of a pair with area density σ of the lighter side and closing speed v: its films may then
    come so near that no step is short enough.

    stiffness: K [N/m³].  distance: d̂ [m].  names: of bodies and obstacles.
    """

    def __init__(
        self, stiffness: float, distance: float, names: Sequence[str], comm: MPI.Intracomm
    ) -> None:
        self._K, self._d, self._names, self._comm = stiffness, distance, names, comm
        self._told = False

    def look(self, bodies: Integers, density: Array, speed: Array) -> None:
        """Of n pairs between bodies (n, 2), with σ (n,) [kg/m²] and v (n,) [m/s]; collective."""
        if self._told:
            return
        need = 4 * density * speed**2
        worst, words = 0.0, ""
        if len(need) and need.max() > self._K * self._d**2:
            i = int(need.argmax())
            worst, (a, b) = float(need[i]), (self._names[k] for k in bodies[i])
            words = (
                f"Contact: a stiffness of {self._K:.3g} N/m³ is too soft to stop '{a}' and '{b}', which close at "
                f"{speed[i]:.3g} m/s; give {worst / self._d**2:.2g} N/m³ at least, or leave it out."
            )
        worst, words = max(self._comm.allgather((worst, words)))
        self._told = bool(words)
        if words and self._comm.rank == 0:
            LOG.warning(words)
