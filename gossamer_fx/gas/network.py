"""All volumes and openings of a scene as one border: the unknowns are the pressures and masses of the chambers.

They solve the equations of `balance`, in which p̄ = (p0 + p1)/2 is the pressure that acts on the film, so that the work
p̄ W is what the film receives, to the last digit; the sum over both sides of an opening is zero, so mass and energy of
the network are, too.

In every iteration of the fields these equations are solved for y at the volumes of the iterate, and force, coupling and
residual are taken there: outside of the laminar range ṁ grows as √Δp, of which Newton's iteration for both at once
makes a cycle of two.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from dolfinx import fem
from petsc4py import PETSc

from gossamer_fx.checks.errors import check
from gossamer_fx.gas.balance import ALMOST, Balance, Passage
from gossamer_fx.gas.contract import Opening, Volume, Wall
from gossamer_fx.gas.geometry import Geometry
from gossamer_fx.gas.state import ChamberState
from gossamer_fx.model.body import Array, Body
from gossamer_fx.terms.assembly import Assembly
from gossamer_fx.terms.scalar_unknowns import ScalarTotals


class GasNetwork:
    """ScalarUnknowns of a scene's chambers; y = (p1, m1) of each."""

    def __init__(self, items: list[Any], system: Assembly) -> None:
        chambers = [i for i in items if isinstance(i, Volume)]
        check(
            bool(chambers),
            "The scene has gas but no chamber or tank; add one, or remove reservoirs and orifices.",
        )
        first = chambers[0]
        odd = next((c.name for c in chambers if c.gas != first.gas), "")
        check(
            not odd,
            f"The chambers '{first.name}' and '{odd}' hold different gases; a scene has one.",
        )
        films = [c.enclosure.film for c in chambers if c.enclosure and c.enclosure.is_whole_film]
        twice = next((f.name for k, f in enumerate(films) if f is not None and f in films[:k]), "")
        check(
            not twice,
            f"Two chambers enclose the whole of '{twice}'; give each its surface, or leave one out.",
        )
        self._gas = first.gas
        self._geometry = geometry = Geometry(system)
        self._gases = [
            ChamberState(c, c.enclosure.compile(system, geometry) if c.enclosure else None)
            for c in chambers
        ]
        index = {id(c): k for k, c in enumerate(chambers)}
        passages = [
            Passage(o, (index.get(id(o.a)), index.get(id(o.b))), o.aperture(geometry))
            for o in items
            if isinstance(o, Opening)
        ]
        walls = [(w, index[id(w.chamber)]) for w in items if isinstance(w, Wall)]
        self._balance = Balance(self._gas, passages, walls, len(chambers))
        self._α = system.rule.alpha
        # of the iterate: volumes, sizes of the terms that add up to them, swept volumes, and the gas
        self._V: Array = np.zeros(len(chambers))
        self._magnitude: Array = self._V
        self._W: Array = self._V
        self._y: Array = np.ones(2 * len(chambers))
        self._given: Array = self._y
        self._s: Array = np.zeros(2 * len(chambers))
        self._kept_magnitude: Array = np.zeros(len(chambers))  # of the last accepted state
        self.size = 2 * len(chambers)
        self._supplied = self._mass_supplied = 0.0

    # ---- the border --------------------------------------------------------------------------------------------------

    def start(self) -> None:
        self._geometry.follow()
        self._geometry.accept()
        for s in self._gases:
            if s.enclosure is not None:
                s.enclosure.start()
            s.volume = self._volume(s)
            check(
                s.volume > 0,
                f"Chamber '{s.chamber.name}' encloses {s.volume:.3g} m³ at the start; open it by an "
                "initial displacement or give it a dead_volume.",
            )
            s.pressure = s.chamber.initial_pressure
            s.internal_energy = s.pressure * s.volume / (self._gas.gamma - 1)
            s.mass = s.internal_energy / (self._gas.cv * s.chamber.initial_temperature)
        self._kept_magnitude = self._magnitudes()

    def begin_step(self, h: float, t: float) -> Array:
        p, m, U, V = (
            np.array([getattr(s, name) for s in self._gases])
            for name in ("pressure", "mass", "internal_energy", "volume")
        )
        self._balance.begin(h, t, p, m, U, V)
        # volumes and round-off of the start: those of the last iterate may be of a step that failed
        self._V, self._W, self._magnitude = V, np.zeros(len(V)), self._kept_magnitude
        start = np.concatenate([p, m])
        settled = self._balance.settle(start, V, self._W, self._magnitude)
        self._y = self._given = start if settled is None else settled
        return self._y

    def residual(self, y: Array) -> Array:
        self._geometry.follow()
        self._V = np.array([self._volume(s) for s in self._gases])
        self._W = np.array([self._swept(s) for s in self._gases])
        self._magnitude = self._magnitudes()
        self._y, self._given = self._at_iterate(y), y
        self._scale = self._balance.scales(self._y, self._V, self._magnitude)
        self._s = self._balance.residual(self._y, self._V, self._W) / self._scale
        for s, p1 in zip(self._gases, self._y, strict=False):
            if s.enclosure is not None:
                s.enclosure.set_pressure(self._acting(s.pressure, float(p1)) - self._outside(s))
        return self._s

    def _at_iterate(self, y: Array) -> Array:
        """The gas at the volumes of the iterate; y itself where there is none, e.g. in a negative volume."""
        if not (
            np.isfinite(y).all() and np.isfinite(self._V + self._W).all() and (self._V > 0).all()
        ):
            return y
        # Newton's iteration changes y from where the gas was, not from where it was asked for
        guess = np.maximum(self._y + (y - self._given), 0.1 * abs(self._y))
        settled = self._balance.settle(guess, self._V, self._W, self._magnitude)
        return y if settled is None else settled

    def add_force(self, values: Array) -> None:
        for s in self._gases:
            if s.enclosure is not None:
                s.enclosure.add_force(values)

    def tangents(self, body: Body) -> Iterable[fem.Form]:
        yield from self._geometry.tangents(body)

    def add_tangents(self, A: PETSc.Mat) -> None:
        for s in self._gases:
            if s.enclosure is not None:
                s.enclosure.add_tangents(A)

    def coupling(self) -> tuple[list[Array | None], list[Array | None], Array]:
        n = len(self._gases)
        G: list[Array | None] = [None] * (2 * n)
        H: list[Array | None] = [None] * (2 * n)
        by_y, by_V = self._balance.derivatives(self._y, self._V, self._W)
        bounded = {k: s.enclosure for k, s in enumerate(self._gases) if s.enclosure is not None}
        if bounded:
            by_V = by_V[:, list(bounded)] / self._scale[:, None]
            by_W = np.zeros_like(by_V)
            dV, dW = [], []
            for i, (k, enclosure) in enumerate(bounded.items()):
                mid, of_volume, of_swept = enclosure.gradients()
                G[k] = -self._α * mid
                by_W[k, i] = (self._gases[k].pressure + float(self._y[k])) / (2 * self._scale[k])
                dV.append(of_volume)
                dW.append(of_swept)
            rows = by_V @ np.array(dV) + by_W @ np.array(dW)
            H = [row if by_V[k].any() or by_W[k].any() else None for k, row in enumerate(rows)]
        return G, H, by_y / self._scale[:, None]

    def commit(self) -> None:
        # mass and energy are summed from the flows, so that they are conserved to round-off whatever the tolerance
        rates, h = self._balance.rates(self._y, self._V), self._balance.h
        for k, s in enumerate(self._gases):
            if s.enclosure is not None:
                self._supplied -= self._outside(s) * s.enclosure.swept
            s.volume = self._volume(s)
            s.mass += h * float(rates.mass[k])
            s.internal_energy += h * float(rates.energy[k]) - (
                s.pressure + float(self._y[k])
            ) / 2 * self._swept(s)
            s.pressure = (self._gas.gamma - 1) * s.internal_energy / s.volume
        self._geometry.accept()
        self._kept_magnitude = self._magnitude
        self._supplied += h * rates.energy_supplied
        self._mass_supplied += h * rates.mass_supplied

    def inadmissible(self) -> str:
        for s, V, p1 in zip(self._gases, self._V, self._y, strict=False):
            if V <= 0 or p1 <= 0:
                return f"'{s.chamber.name}' would have a volume of {V:.3g} m³ and a pressure of {p1:.3g} Pa"
        return ""

    def unsolved(self) -> str:
        n = len(self._gases)
        worst = np.abs(self._s).reshape(2, n).max(axis=0)
        worst[~np.isfinite(worst)] = np.inf
        k = int(np.argmax(worst))
        if worst[k] <= ALMOST:
            return ""
        return (
            f"the gas of '{self._gases[k].chamber.name}' is not in balance (volume {self._V[k]:.3g} m³, pressure "
            f"{self._y[k]:.3g} Pa)"
        )

    def totals(self) -> ScalarTotals:
        return ScalarTotals(
            {s.chamber.name: s.internal_energy for s in self._gases},
            self._supplied,
            sum(s.mass for s in self._gases),
            self._mass_supplied,
        )

    def states(self) -> dict[str, ChamberState]:
        return {s.chamber.name: s for s in self._gases}

    def get_state(self) -> dict[str, Any]:
        chambers = [
            [s.chamber.name, s.pressure, s.mass, s.internal_energy, s.volume] for s in self._gases
        ]
        return {
            "chambers": chambers,
            "supplied": self._supplied,
            "mass supplied": self._mass_supplied,
        }

    def set_state(self, state: dict[str, Any]) -> None:
        self._geometry.follow()
        self._geometry.accept()
        for s, kept in zip(self._gases, state["chambers"], strict=True):
            s.pressure, s.mass, s.internal_energy, s.volume = kept[1:]
        self._kept_magnitude = self._magnitudes()
        self._supplied, self._mass_supplied = state["supplied"], state["mass supplied"]

    # ---- chambers ----------------------------------------------------------------------------------------------------

    def _acting(self, p0: float, p1: float) -> float:
        """The pressure that acts on the film, p̄ in the midpoint rule."""
        return (1 - self._α) * p0 + self._α * p1

    def _outside(self, s: ChamberState) -> float:
        return float(s.chamber.outside.pressure) if s.chamber.outside is not None else 0.0

    def _volume(self, s: ChamberState) -> float:
        return float(s.chamber.fixed_volume) + (
            s.enclosure.volume if s.enclosure is not None else 0.0
        )

    def _swept(self, s: ChamberState) -> float:
        return s.enclosure.swept if s.enclosure is not None else 0.0

    def _magnitudes(self) -> Array:
        return np.array(
            [s.enclosure.magnitude if s.enclosure is not None else 0.0 for s in self._gases]
        )
