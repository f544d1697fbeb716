"""History variables of contact: what a step takes over from those before, and what a checkpoint
holds."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.mechanics.contact.arrays import Array, Int64Array, MaskArray
from gossamer_fx.mechanics.terms.assembly import HistoryVariables


def _no_numbers() -> Array:
    return np.zeros(0)


def _no_identifiers() -> Int64Array:
    return np.zeros(0, dtype=np.int64)


@dataclass
class ContactHistory(HistoryVariables):
    """History variables of one contact.

    Energy is conserved if a pair that has energy has a constant stiffness, and if the activation
    distance of a pair changes only while it has none.

    Attributes:
        activation_distance: gap (m,) [m] of each point below which its pairs have energy, of those
            points for which this rank keeps it.
        has_begun: whether the initial state is known.
        identifier: of pairs that have energy (k,), sorted; at least those of this rank.
        stiffness: k [J] of these pairs (k,).
        reference_speed: least closing speed [m/s] for which stiffness is chosen; zero before the
            first step.
        restored: how often a state was restored.
        comm: of the contact, once it is known.
    """

    activation_distance: Array = field(default_factory=_no_numbers)
    has_begun: bool = False
    identifier: Int64Array = field(default_factory=_no_identifiers)
    stiffness: Array = field(default_factory=_no_numbers)
    reference_speed: float = 0.0
    restored: int = 0
    comm: MPI.Intracomm | None = None
    _own_points: Int64Array = field(default_factory=_no_identifiers)

    def share(self, comm: MPI.Intracomm, own_points: Int64Array) -> None:
        """Let this rank keep the activation distances [m] of some points only; together the ranks
        keep all. They are the gaps below which pairs of a point have energy. `own_points`: numbers
        (m,) of the points that this rank owns, among those of all ranks."""
        self.comm = comm
        self._own_points = own_points
        # A state that was set before is that of all points.
        if self.has_begun:
            self.activation_distance = self.activation_distance[own_points]

    def get_history(self) -> dict[str, Any]:
        """Return the history variables of all ranks for a checkpoint, the same on every rank;
        collective."""
        identifier = self.identifier
        stiffness = self.stiffness
        activation_distance = self.activation_distance
        if self.comm is not None and self.comm.size > 1:
            of_ranks = self.comm.allgather((identifier, stiffness))
            identifiers = np.concatenate([part for part, _ in of_ranks])
            # Two ranks may hold the same pair; its stiffness is the same on both.
            identifier, first = np.unique(identifiers, return_index=True)
            stiffness = np.concatenate([part for _, part in of_ranks])[first]
            of_points = self.comm.allgather((self._own_points, activation_distance))
            numbers = np.concatenate([part for part, _ in of_points])
            # All ranks have the points of obstacles, with the same values.
            _, first = np.unique(numbers, return_index=True)
            activation_distance = np.concatenate([part for _, part in of_points])[first]
        return {
            "activation distance": activation_distance.tolist(),
            "identifier": identifier.tolist(),
            "stiffness": stiffness.tolist(),
            "reference speed": self.reference_speed,
        }

    def set_history(self, state: dict[str, Any]) -> None:
        """Restore the history variables that `get_history` returned, on any number of ranks."""
        of_all_points = np.array(state["activation distance"], dtype=float)
        self.has_begun = len(of_all_points) > 0
        self.activation_distance = of_all_points
        if self.comm is not None and self.has_begun:
            self.activation_distance = of_all_points[self._own_points]
        self.identifier = np.array(state["identifier"], dtype=np.int64)
        self.stiffness = np.array(state["stiffness"], dtype=float)
        self.reference_speed = float(state["reference speed"])
        # The contact set compares this number, and computes again what follows from the history.
        self.restored += 1

    def keep(self, identifier: Int64Array, stiffness: Array) -> None:
        """Take the stiffness (n,) [J] of the pairs that have energy in the accepted state."""
        order = np.argsort(identifier)
        self.identifier = identifier[order]
        self.stiffness = stiffness[order]

    def keep_some(self, which: MaskArray) -> None:
        """Forget all pairs but some (mask (k,)): a checkpoint has the pairs of all ranks."""
        self.identifier = self.identifier[which]
        self.stiffness = self.stiffness[which]

    def stiffness_of(self, identifier: Int64Array) -> tuple[MaskArray, Array]:
        """Return which contact pairs have energy already, and their stiffness. Returns a mask (n,)
        of those that have energy, and their stiffness (n,) [J]; the stiffness of the others has no
        meaning."""
        if not len(self.identifier):
            return np.zeros(len(identifier), dtype=bool), np.zeros(len(identifier))
        row = np.searchsorted(self.identifier, identifier)
        # An identifier beyond the last one gets the last row, where it is found to differ.
        row = np.minimum(row, len(self.identifier) - 1)
        return self.identifier[row] == identifier, self.stiffness[row]
