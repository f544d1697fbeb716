"""A warning, given once, if a stiffness that was chosen by hand cannot stop what comes."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from mpi4py import MPI

from gossamer_fx.mechanics.contact.arrays import Array, Int32Array

LOG = logging.getLogger("gossamer_fx")

# A pair with the area density σ and the closing speed v is stopped within the activation distance d
# if its stiffness K d² per area is this multiple of σ v²; the derived stiffness is just that.
STOPPING_FACTOR = 4


class StiffnessWarning:
    """Warns if K d² < 4 σ v²: layers then come so near each other that no step is short enough.

    Args:
        stiffness: K [N/m³].
        activation_distance: d [m].
        names: of bodies and obstacles.
        comm: of the contact.

    Attributes:
        was_given: whether the warning was given.
    """

    def __init__(
        self,
        stiffness: float,
        activation_distance: float,
        names: Sequence[str],
        comm: MPI.Intracomm,
    ) -> None:
        self._stiffness = stiffness
        self._activation_distance = activation_distance
        self._names = names
        self._comm = comm
        self.was_given = False

    def check(self, bodies: Int32Array, density: Array, speed: Array) -> None:
        """Warn once, in the log, if the given stiffness cannot stop a contact pair; collective.

        Of all ranks' pairs the one is named that needs most.  Nothing happens if all are stopped,
        or if the warning was given before.

        Args:
            bodies: numbers (n, 2) of the bodies or obstacles of both sides.
            density: area density of the lighter side (n,) [kg/m²].
            speed: closing speed (n,) [m/s].
        """
        if self.was_given:
            return
        needed = STOPPING_FACTOR * density * speed**2
        present = self._stiffness * self._activation_distance**2
        largest = 0.0
        message = ""
        if len(needed) and needed.max() > present:
            row = int(needed.argmax())
            largest = float(needed[row])
            one, other = (self._names[number] for number in bodies[row])
            message = (
                f"Contact: a stiffness of {self._stiffness:.3g} N/m³ is too soft to stop '{one}' "
                f"and '{other}', "
                f"which close at {speed[row]:.3g} m/s; give "
                f"{largest / self._activation_distance**2:.2g} N/m³ at "
                "least, or leave it out."
            )
        _, message = max(self._comm.allgather((largest, message)))
        self.was_given = bool(message)
        if message and self._comm.rank == 0:
            LOG.warning(message)
