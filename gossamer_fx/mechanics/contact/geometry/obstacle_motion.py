"""Prescribed motions of obstacles: functions of the user, asked for on all ranks and checked."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.checks.user_functions import ask_numbers
from gossamer_fx.mechanics.contact.arrays import Array

PrescribedMotion = Callable[[float], Sequence[float]]

# Parts of a step at which the motion is asked for.  Multiples of the golden ratio, less whole
# numbers, are spread evenly and are not multiples of each other, so that a motion of a short period
# does not hide between them.
GOLDEN_RATIO = (1 + 5**0.5) / 2
SAMPLES = np.modf(GOLDEN_RATIO * np.arange(1, 9))[0]

# Displacements that are kept: those of both ends of a step and of all samples between them, twice.
KEPT_DISPLACEMENTS = 2 * (len(SAMPLES) + 2)


class ObstacleMotion:
    """The displacement of one obstacle over the time.

    Args:
        name: of the obstacle, for messages.
        function: displacement (3,) [m] at a time [s].
        comm: the ranks, which have to agree.

    Raises:
        InputError: on all ranks, when a displacement is asked for: the function raises, or returns
            something other than three finite numbers, or not the same ones on all ranks.
    """

    def __init__(self, name: str, function: PrescribedMotion, comm: MPI.Intracomm) -> None:
        self.name = name
        self._function = function
        self._comm = comm
        # Newton's iteration asks for the end of the step again and again.
        self._known: dict[float, Array] = {}

    def at(self, time: float) -> Array:
        """Return the displacement (3,) [m] at a time; collective.

        The function of the user is called once for each of the last few times.

        Args:
            time: [s].

        Raises:
            InputError: on all ranks, if the function of the user raises, or returns something other
                than three finite numbers, the same on all ranks.
        """
        if time not in self._known:
            what = f"Motion of the obstacle '{self.name}' at t = {time:.6g} s"
            displacement = ask_numbers(self._comm, what, lambda: self._function(time), (3,))
            while len(self._known) >= KEPT_DISPLACEMENTS:
                del self._known[next(iter(self._known))]
            self._known[time] = displacement
        return self._known[time]

    def deviation(self, time: float, step: float) -> float:
        """Return how far [m] the motion is from a straight and uniform one in a step; collective.

        A smooth motion deviates by its acceleration times step²/8, so that shorter steps bring it
        below any limit.  A jump deviates by at least half of its length, however short the step is.

        Args:
            time: at the start of the step [s].
            step: its length [s].

        Raises:
            InputError: on all ranks, if the function of the user raises, or returns something other
                than three finite numbers, the same on all ranks.
        """
        start = self.at(time)
        way = self.at(time + step) - start
        deviations = [
            float(np.linalg.norm(self.at(time + float(part) * step) - (start + part * way)))
            for part in SAMPLES
        ]
        return max(deviations)
