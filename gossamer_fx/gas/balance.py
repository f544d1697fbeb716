"""Mass and energy of the chambers in a step: the equations, their derivatives, and their solution at given volumes.

For chamber k with the volume V and the state (p, m), U = p V/(γ-1), a step of length h solves

    m1 = m0 + h Σ ±mass_flow
    U1 = U0 + h Σ ±c_p T_up mass_flow + h Q - p̄ W,     p̄ = (p0 + p1)/2

Flows are taken at p0 + θ (p1 - p0) with a weight θ of each chamber,

    1 - θ = 1/(1/(1 - θ_e) + 40 z⁴/(1 + z²)),     z = h mass_flow γRT/(V Δp) summed over its openings

θ_e = ½ + O(h) makes exponential relaxation exact (vents, walls); the term with z is of fourth order while steps are
short, and ends the ringing of steps that are longer than the time in which pressures equalise.  The flow is a concave
function of Δp that begins with √(2Δp/p) and ends choked with Ψ* > 0.63: no step, however long, overshoots equal
pressures if 1 - θ < Ψ*²/(2z²) for z > 1, between two equal chambers a quarter of it.  Temperatures are those of the
mean energy and mass.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gossamer_fx.gas.contract import Aperture, Opening, Wall
from gossamer_fx.gas.ideal_gas import IdealGas
from gossamer_fx.model.body import Array

Pair = tuple[complex, complex]
STEP = 1e-30  # of the complex-step derivative
SETTLED, ALMOST = (
    1e-13,
    1e-9,
)  # residual of solved equations of the gas, and one that is left to Newton's iteration


@dataclass
class Passage:
    """An opening between chambers, by number, or others."""

    opening: Opening
    ends: tuple[int | None, int | None]
    aperture: Aperture
    area: float = 0.0  # C_d A of the step [m²]


@dataclass
class Rates:
    """Σ over the openings and walls: into the chambers, and out of everything else [kg/s], [W]."""

    mass: Array
    energy: Array
    mass_supplied: float = 0.0
    energy_supplied: float = 0.0


class Balance:
    """The equations of n chambers for y = (p1, m1), at volumes V and swept volumes W (n,)."""

    def __init__(
        self, gas: IdealGas, passages: list[Passage], walls: list[tuple[Wall, int]], n: int
    ) -> None:
        self._gas, self._passages, self._walls, self._n = gas, passages, walls, n
        self._θ: Array = np.full(n, 0.5)
        self._θ_walls: Array = np.full(len(walls), 0.5)
        self._amplification: Array = np.zeros(n)

    def begin(self, h: float, t: float, p: Array, m: Array, U: Array, V: Array) -> None:
        """Start a step of length h whose middle is at time t, from these states."""
        self.h, self._p0, self._m0, self._U0 = h, p, m, U
        for passage in self._passages:
            passage.area = passage.aperture(h, t)
        self._choose_weights(p, U / (m * self._gas.cv), V)

    def residual(self, y: Array, V: Array, W: Array, known: Rates | None = None) -> Array:
        """Energy [J] and mass [kg] that each chamber would have too much, (2n,); rates may be known already."""
        p1, m1 = y[: self._n], y[self._n :]
        rates = known or self.rates(y, V)
        energy = (
            p1 * V / (self._gas.gamma - 1)
            - self._U0
            - self.h * rates.energy
            + (self._p0 + p1) / 2 * W
        )
        return np.concatenate([energy, m1 - self._m0 - self.h * rates.mass])

    def derivatives(self, y: Array, V: Array, W: Array) -> tuple[Array, Array]:
        """Of the residual: (2n, 2n) with respect to y, and (2n, n) with respect to V."""
        n, h, γ, cv = self._n, self.h, self._gas.gamma, self._gas.cv
        p, T = self._at_openings(y, V)
        p1, m1, mass = y[:n], y[n:], self._m0 + y[n:]
        by_y, by_V = (
            np.diag(np.concatenate([V / (γ - 1) + W / 2, np.ones(n)])),
            np.zeros((2 * n, n)),
        )
        by_V[np.arange(n), np.arange(n)] = p1 / (γ - 1)
        for passage in self._passages:
            ends = self._at_ends(passage, p, T)
            for side, k in enumerate(passage.ends):
                if k is None:
                    continue
                by_p, by_T = (self._slope(passage, ends, side, which) for which in (0, 1))
                by_U = 1 / ((γ - 1) * mass[k] * cv)
                for end, sign in zip(passage.ends, (-h, h), strict=True):
                    if end is not None:
                        for row, p_slope, T_slope in zip((n + end, end), by_p, by_T, strict=True):
                            by_y[row, k] -= sign * (p_slope * self._θ[k] + T_slope * V[k] * by_U)
                            by_y[row, n + k] += sign * T_slope * T[k] / mass[k]
                            by_V[row, k] -= sign * T_slope * p1[k] * by_U
        for (wall, k), θ in zip(self._walls, self._θ_walls, strict=True):
            warming = h * wall.conductance * θ / (m1[k] * cv)
            by_y[k, k] += warming * V[k] / (γ - 1)
            by_y[k, n + k] -= warming * p1[k] * V[k] / ((γ - 1) * m1[k])
            by_V[k, k] += warming * p1[k] / (γ - 1)
        return by_y, by_V

    def settle(self, y: Array, V: Array, W: Array, magnitude: Array) -> Array | None:
        """The solution, from a guess: Newton's method, backtracking; None if it is not found."""
        rates = self.rates(y, V)
        scale = self.scales(y, V, magnitude) + self.h * abs(
            np.concatenate([rates.energy, rates.mass])
        )
        F = self.residual(y, V, W, rates) / scale
        for _ in range(50):
            if abs(F).max() <= SETTLED:
                return y
            try:
                δ, size = (
                    np.linalg.solve(self.derivatives(y, V, W)[0] / scale[:, None], F),
                    float(F @ F),
                )
            except np.linalg.LinAlgError:
                return None
            for λ in 0.5 ** np.arange(30):
                # no pressure or mass falls below a tenth in one iteration: the flow law knows positive ones only
                trial = np.maximum(y - λ * δ, 0.1 * y)
                F = self.residual(trial, V, W) / scale
                if float(F @ F) < size:
                    break
            y = trial
        return y if abs(F).max() <= ALMOST else None

    def scales(self, y: Array, V: Array, magnitude: Array) -> Array:
        """Energy and mass of each chamber, to which errors are compared; never below the round-off of the volume.

        Nor below that of the flows, which long steps through wide openings multiply: the accepted state is summed from
        them, so that nothing is lost.  `magnitude` [m³] is the size of the terms that add up to the volume.
        """
        flows = 1 + 1e-3 * self._amplification
        energy = abs(y[: self._n]) * (abs(V) * flows + 1e-3 * magnitude) / (self._gas.gamma - 1)
        return np.concatenate([energy + self._U0, abs(y[self._n :]) * flows + self._m0])

    def rates(self, y: Array, V: Array) -> Rates:
        """Mass and energy per second into every chamber, and from reservoirs, surroundings and walls."""
        n, cv = self._n, self._gas.cv
        p, T = self._at_openings(y, V)
        rates = Rates(np.zeros(n), np.zeros(n))
        for passage in self._passages:
            mass_flow, energy_flow = (
                flow.real for flow in self._flows(passage, *self._at_ends(passage, p, T))
            )
            for end, sign in zip(passage.ends, (-1, 1), strict=True):
                if end is None:
                    rates.mass_supplied -= sign * mass_flow
                    rates.energy_supplied -= sign * energy_flow
                else:
                    rates.mass[end] += sign * mass_flow
                    rates.energy[end] += sign * energy_flow
        for (wall, k), θ in zip(self._walls, self._θ_walls, strict=True):
            U1 = y[k] * V[k] / (self._gas.gamma - 1)
            Tw = (1 - θ) * self._U0[k] / (self._m0[k] * cv) + θ * U1 / (y[n + k] * cv)
            Q = wall.conductance * (wall.temperature - Tw)
            rates.energy[k] += Q
            rates.energy_supplied += Q
        return rates

    def _at_openings(self, y: Array, V: Array) -> tuple[Array, Array]:
        """Pressures and temperatures of the chambers that flows see."""
        p1, m1 = y[: self._n], y[self._n :]
        U = self._U0 + p1 * V / (self._gas.gamma - 1)
        return self._p0 + self._θ * (p1 - self._p0), U / ((self._m0 + m1) * self._gas.cv)

    def _flows(self, passage: Passage, p: Pair, T: Pair) -> Pair:
        """Mass and energy flow from the first to the second end."""
        mass_flow = complex(passage.opening.flow(self._gas, passage.area, p, T))
        return mass_flow, self._gas.cp * (T[0] if p[0].real >= p[1].real else T[1]) * mass_flow

    def _slope(
        self, passage: Passage, at_ends: tuple[Pair, Pair], side: int, which: int
    ) -> tuple[float, float]:
        """Derivatives of both flows with respect to pressure (`which` 0) or temperature (1) at one end."""
        ends = [list(pair) for pair in at_ends]
        ends[which][side] += 1j * STEP
        (pa, pb), (Ta, Tb) = ends
        mass_flow, energy_flow = self._flows(passage, (pa, pb), (Ta, Tb))
        return mass_flow.imag / STEP, energy_flow.imag / STEP

    def _at_ends(self, passage: Passage, p: Array, T: Array) -> tuple[Pair, Pair]:
        """Pressures and temperatures at the ends of an opening."""
        ends = tuple(zip(passage.ends, (passage.opening.a, passage.opening.b), strict=True))
        (pa, pb), (Ta, Tb) = (
            [
                complex(getattr(holder, name)) if k is None else complex(values[k])
                for k, holder in ends
            ]
            for name, values in (("pressure", p), ("temperature", T))
        )
        return (pa, pb), (Ta, Tb)

    def _choose_weights(self, p: Array, T: Array, V: Array) -> None:
        """θ of every chamber and wall for the step, and how much flows amplify the round-off of pressures."""
        slopes, rates, resting = np.zeros((3, self._n))
        for o in self._passages:
            ps, Ts = self._at_ends(o, p, T)
            (pd, _), (pu, Tu) = sorted((x.real, t.real) for x, t in zip(ps, Ts, strict=True))
            if pu == 0:
                continue
            almost = pu * (1 - 1e-9)
            moving, at_rest = (self._conductance(o, pu, Tu, pd) for pd in (min(pd, almost), almost))
            for side, (k, sign) in enumerate(zip(o.ends, (-1, 1), strict=True)):
                if k is not None:
                    stiffness = self.h * self._gas.gamma * self._gas.R * Tu / V[k]
                    rates[k] += stiffness * moving
                    resting[k] += stiffness * at_rest
                    slopes[k] -= stiffness * sign * self._slope(o, (ps, Ts), side, 0)[0]
        exponential = np.array([_fitted_weight(z) for z in np.maximum(slopes, 0.0)])
        self._θ = 1 - 1 / (1 / (1 - exponential) + 40 * rates**4 / (1 + rates**2))
        self._amplification = resting
        cooling = [w.conductance / (self._m0[k] * self._gas.cv) for w, k in self._walls]
        self._θ_walls = np.array([_fitted_weight(self.h * rate) for rate in cooling])

    def _conductance(self, o: Passage, pu: float, Tu: float, pd: float) -> float:
        """Mass flow over pressure difference [kg/(s Pa)]."""
        return float(o.opening.flow(self._gas, o.area, (pu, pd), (Tu, Tu)).real) / (pu - pd)


def _fitted_weight(z: float) -> float:
    """θ for which one step of θ-weighted relaxation at rate z/h is exact: ½ at z = 0, 1 at infinity."""
    if z < 1e-3:
        return 0.5 + z / 12
    return float(1 / -np.expm1(-z) - 1 / z)
