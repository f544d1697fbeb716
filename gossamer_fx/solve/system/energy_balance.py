"""The balance of a compiled scene: energies and momenta, and what was supplied and lost."""

from __future__ import annotations

import numpy as np

from gossamer_fx.core.algebra.rotations import LAST, NEXT
from gossamer_fx.core.model.body import Array
from gossamer_fx.solve.system.equations import Equations
from gossamer_fx.solve.system.totals import Totals
from gossamer_fx.solve.system.unknowns import Unknowns


class EnergyBalance:
    """What the ledger of a run says of energy, momenta and gas.

    Attributes:
        supplied_energy: since the start [J], this rank's share.
        losses: dissipated energies since the start [J] by name, this rank's share.
        restored_resultants: those of the last step of a run that was restarted, until the next one;
            else None.
    """

    def __init__(self, unknowns: Unknowns, equations: Equations) -> None:
        self._unknowns = unknowns
        self._equations = equations
        self._momenta = unknowns.numbering.vector()
        self.supplied_energy = 0.0
        self.losses = {name: 0.0 for kind in equations.compiled for name in kind.losses}
        self.restored_resultants: dict[str, Array] | None = None

    def add_step(self) -> None:
        """Add the works and losses [J] of the step that ends at q1, before it is accepted.
        Collective."""
        change = self._unknowns.q1.array_r - self._unknowns.q0.array_r
        self.supplied_energy += self._unknowns.supports.work(change)
        compiled = self._equations.compiled
        self.supplied_energy += sum(kind.supplied() for kind in compiled)
        for kind in compiled:
            for name, loss in zip(kind.losses, kind.dissipated(), strict=True):
                self.losses[name] += float(loss)
        self.restored_resultants = None

    def totals(self) -> Totals:
        """Energies and momenta of the accepted state, and what was supplied and lost since the
        start; the same on every rank.  Collective."""
        unknowns = self._unknowns
        compiled = self._equations.compiled
        unknowns.M.mult(unknowns.v0, self._momenta)
        # Momenta p and coordinates q of this rank's vectors, (n, 3); qp is the matrix Σ q_i p_j.
        size = 3 * len(unknowns.position_marks)  # without multipliers
        p = self._momenta.array_r[:size].reshape(-1, 3)
        q = unknowns.q0.array_r[:size].reshape(-1, 3)
        qp = q.T @ p
        # Sums over positions; the moment is summed over directors, too.
        momenta = np.stack([unknowns.position_marks @ p, qp[NEXT, LAST] - qp[LAST, NEXT]])
        for kind in compiled:
            momenta += kind.momenta()
        stored: dict[str, float] = {}
        for kind in compiled:
            for name, energy in kind.energies().items():
                stored[name] = stored.get(name, 0.0) + energy
        kinetic = unknowns.v0.array_r @ self._momenta.array_r / 2

        # One message for all sums over the ranks.
        local = [kinetic, self.supplied_energy, *momenta.ravel(), *stored.values()]
        sums = unknowns.comm.allreduce(np.array([*local, *self.losses.values()])).tolist()
        kinetic, supplied = sums[:2]
        linear, angular = np.array(sums[2:8]).reshape(2, 3)
        first_loss = 8 + len(stored)
        stored = dict(zip(stored, sums[8:first_loss], strict=True))
        losses = dict(zip(self.losses, sums[first_loss:], strict=True))

        mass = 0.0
        mass_supplied = 0.0
        for scalars in self._equations.scalar_unknowns:
            share = scalars.totals()
            stored |= share.stored
            supplied += share.supplied
            mass += share.mass
            mass_supplied += share.mass_supplied
        return Totals(
            time=unknowns.time,
            kinetic=kinetic,
            stored=stored,
            supplied=supplied,
            losses=losses,
            momentum=linear,
            angular_momentum=angular,
            mass=mass,
            mass_supplied=mass_supplied,
        )

    def kinetic_energy_of_step(self) -> float:
        """Kinetic energy [J] at the mean velocity of the step, (q1 - q0)/h.  Collective."""
        increment = self._unknowns.increment.total()
        self._unknowns.M.mult(increment, self._momenta)
        return float(increment.dot(self._momenta)) / (2 * self._unknowns.h**2)

    def resultants(self) -> dict[str, Array]:
        """Force [N] and torque about the origin [N m], (2, 3), of each load over the last step, by
        its name; the same on every rank.  Collective."""
        if self.restored_resultants is not None:
            return self.restored_resultants
        total: dict[str, Array] = {}
        own: dict[str, Array] = {}
        for kind in self._equations.compiled:
            for name, value in kind.resultants().items():
                own[name] = own.get(name, 0.0) + value
        # A load on a point is known to one rank only.
        for of_rank in self._unknowns.comm.allgather(own):
            for name, value in of_rank.items():
                total[name] = total.get(name, 0.0) + value
        return total
