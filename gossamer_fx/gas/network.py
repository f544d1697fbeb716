"""All volumes and openings of a scene as one border: the unknowns are the pressures and masses of the chambers.

For chamber k with the enclosed volume V(q) and the state (p, m), U = p V/(γ-1), a step of length h solves

    m1 = m0 + h Σ ±ṁ
    U1 = U0 + h Σ ±c_p T_up ṁ + h Q - p̄ W,     W = G(q̄)·(q1 - q0)

where p̄ = (p0 + p1)/2 is the pressure that acts on the film, so that the work p̄ W is what the film receives, to the
last digit; the sum over both sides of an opening is zero, so mass and energy of the network are, too.

Flows are taken at p0 + θ (p1 - p0), θ = 1/(1 - e^(-z)) - 1/z, with z = h times the rate at which the opening
equalises the pressures: ½ + z/12 for small steps (second order), 1 for stiff ones, where the mean p̄ would make the
pressure ring.  Temperatures are those of the mean energy and mass.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from gossamer_fx.errors import check
from gossamer_fx.parts import Array, Assembly, Body, Booking

if TYPE_CHECKING:
    from gossamer_fx.gas.enclosure import CompiledEnclosure
    from gossamer_fx.gas.ideal_gas import IdealGas

Complex = npt.NDArray[np.complex128]
STEP = 1e-30  # of the complex-step derivative


@dataclass
class ChamberState:
    """State of one chamber: pressure [Pa], mass [kg], internal energy [J], volume [m³]."""

    chamber: Any
    enclosure: CompiledEnclosure | None
    p: float = 0.0
    m: float = 0.0
    U: float = 0.0
    V: float = 0.0

    @property
    def temperature(self) -> float:
        """[K]"""
        return self.U / (self.m * float(self.chamber.gas.cv))


@dataclass
class _Rates:
    """Σ over the openings of a chamber network: into the chambers, and out of everything else."""

    mass: Complex
    energy: Complex
    mass_supplied: float = 0.0
    energy_supplied: float = 0.0


@dataclass
class _Opening:
    orifice: Any
    ends: tuple[int | None, int | None]
    area: float = field(default=0.0)
    θ: float = field(default=0.5)


class GasNetwork:
    """Border of a scene's chambers; y = (p1, m1) of each."""

    def __init__(self, items: list[Any], system: Assembly) -> None:
        from gossamer_fx.gas.orifice import Orifice, WallHeat
        from gossamer_fx.gas.volumes import Chamber

        chambers = [i for i in items if isinstance(i, Chamber)]
        check(bool(chambers), "The scene has gas but no chamber or tank; add one, or remove reservoirs and orifices.")
        gases = {c.gas for c in chambers}
        check(
            len(gases) == 1,
            f"The chambers '{chambers[0].name}' and "
            f"'{next((c.name for c in chambers if c.gas != chambers[0].gas), '')}' hold different gases; a scene has one.",
        )
        self._gas: IdealGas = chambers[0].gas
        self.states = [ChamberState(c, c.enclosure.compile(system) if c.enclosure else None) for c in chambers]
        index = {id(c): k for k, c in enumerate(chambers)}
        self._openings = [
            _Opening(o, (index.get(id(o.first)), index.get(id(o.second)))) for o in items if isinstance(o, Orifice)
        ]
        self._walls = [(w, index[id(w.chamber)]) for w in items if isinstance(w, WallHeat)]
        self._α = system.rule.alpha
        self.size = 2 * len(chambers)
        self._supplied = self._mass_supplied = 0.0

    # ---- Border ------------------------------------------------------------------------------------------------

    def start(self) -> None:
        for s in self.states:
            if s.enclosure is not None:
                s.enclosure.start()
            s.V = self._volume(s)
            check(
                s.V > 0,
                f"Chamber '{s.chamber.name}' encloses {s.V:.3g} m³ at the start; open it by an initial displacement or "
                "give it a dead_volume.",
            )
            s.p = s.chamber.pressure
            s.U = s.p * s.V / (self._gas.gamma - 1)
            s.m = s.U / (self._gas.cv * s.chamber.temperature)

    def begin(self, h: float, t: float) -> Array:
        self._h = h
        p = np.array([s.p for s in self.states], dtype=complex)
        T = np.array([s.temperature for s in self.states], dtype=complex)
        for o in self._openings:
            o.area = o.orifice.effective_area(t)
            o.θ = _fitted_weight(h * self._relaxation_rate(o, p, T))
        # a first guess by a step of the rigid network that its own equations limit to half and twice the state
        rates = self._rates(p, p, T)
        grown = [
            (s.U + h * float(e.real), s.m + h * float(dm.real))
            for s, e, dm in zip(self.states, rates.energy, rates.mass, strict=True)
        ]
        guess = [
            (max(U, 0.5 * s.U) * s.p / s.U, max(m, 0.5 * s.m)) for s, (U, m) in zip(self.states, grown, strict=True)
        ]
        return np.array(guess).T.ravel()

    def residual(self, y: Array) -> Array:
        for s in self.states:
            if s.enclosure is not None:
                s.enclosure.evaluate()
        self._y = y
        scale = self._scales(y)
        self._scale = scale
        return np.real(self._balance(y.astype(complex))) / scale

    def add_force(self, values: Array) -> None:
        for s, p1 in zip(self.states, self._y, strict=False):
            if s.enclosure is not None:
                s.enclosure.add_force(values, self._mean(s.p, float(p1)) - self._outside(s))

    def tangents(self, body: Body) -> Iterable[fem.Form]:
        for s in self.states:
            if s.enclosure is not None:
                yield from s.enclosure.tangents(body)

    def coupling(self) -> tuple[list[Array | None], list[Array | None], Array]:
        n = len(self.states)
        G: list[Array | None] = [None] * (2 * n)
        H: list[Array | None] = [None] * (2 * n)
        for k, s in enumerate(self.states):
            if s.enclosure is not None:
                mid, dV, dW = s.enclosure.gradients()
                p1 = float(self._y[k])
                G[k] = -self._α * mid
                H[k] = (p1 / (self._gas.gamma - 1) * dV + self._mean(s.p, p1) * dW) / self._scale[k]
        C = np.empty((2 * n, 2 * n))
        for j in range(2 * n):
            y = self._y.astype(complex)
            y[j] += 1j * STEP
            C[:, j] = np.imag(self._balance(y)) / STEP / self._scale
        return G, H, C

    def accept(self) -> None:
        # mass and energy are summed from the flows, so that they are conserved to round-off whatever the tolerance
        rates, h = self._rates_at(self._y.astype(complex)), self._h
        for k, s in enumerate(self.states):
            if s.enclosure is not None:
                self._supplied -= self._outside(s) * s.enclosure.swept
                s.enclosure.accept()
            s.V = self._volume(s)
            s.m += h * float(rates.mass[k].real)
            s.U += h * float(rates.energy[k].real) - self._mean(s.p, float(self._y[k])) * self._swept(s)
            s.p = (self._gas.gamma - 1) * s.U / s.V
        self._supplied += h * rates.energy_supplied
        self._mass_supplied += h * rates.mass_supplied

    def book(self) -> Booking:
        return Booking(
            {s.chamber.name: s.U for s in self.states},
            self._supplied,
            sum(s.m for s in self.states),
            self._mass_supplied,
        )

    # ---- the balance -------------------------------------------------------------------------------------------

    def _mean(self, p0: float, p1: Any) -> Any:
        """The pressure that acts on the film."""
        return (1 - self._α) * p0 + self._α * p1

    def _outside(self, s: ChamberState) -> float:
        return float(s.chamber.outside.pressure) if s.chamber.outside is not None else 0.0

    def _volume(self, s: ChamberState) -> float:
        return float(s.chamber.fixed_volume) + (s.enclosure.volume if s.enclosure is not None else 0.0)

    def _swept(self, s: ChamberState) -> float:
        return s.enclosure.swept if s.enclosure is not None else 0.0

    def _balance(self, y: Complex) -> Complex:
        """Energy [J] and mass [kg] that each chamber would have too much."""
        n, h = len(self.states), self._h
        rates = self._rates_at(y)
        energy = [
            y[k] * self._volume(s) / (self._gas.gamma - 1) - s.U - h * rates.energy[k] + self._mean(s.p, y[k]) * self._swept(s)
            for k, s in enumerate(self.states)
        ]
        mass = [y[n + k] - s.m - h * rates.mass[k] for k, s in enumerate(self.states)]
        return np.array(energy + mass)

    def _scales(self, y: Array) -> Array:
        """Energy and mass of each chamber, to which errors are compared; never below the round-off of the volume."""
        γ1 = self._gas.gamma - 1
        energy = [
            (abs(p) * (abs(self._volume(s)) + 1e-3 * (s.enclosure.magnitude if s.enclosure is not None else 0))) / γ1
            + s.U
            for s, p in zip(self.states, y, strict=False)
        ]
        mass = [abs(m) + s.m for s, m in zip(self.states, y[len(self.states) :], strict=True)]
        return np.array(energy + mass)

    def _rates_at(self, y: Complex) -> _Rates:
        n, γ1 = len(self.states), self._gas.gamma - 1
        p0 = np.array([s.p for s in self.states], dtype=complex)
        T = np.array(
            [
                (s.U + y[k] * self._volume(s) / γ1) / ((s.m + y[n + k]) * self._gas.cv)
                for k, s in enumerate(self.states)
            ]
        )
        return self._rates(p0, y[:n], T)

    def _rates(self, p0: Complex, p1: Complex, T: Complex) -> _Rates:
        """Mass and energy per second into every chamber, and from reservoirs, surroundings and walls."""
        n = len(self.states)
        rates = _Rates(np.zeros(n, dtype=complex), np.zeros(n, dtype=complex))
        for o in self._openings:
            p = p0 + o.θ * (p1 - p0)
            ṁ, Tu = self._flow(o, p, T)
            ė = self._gas.cp * Tu * ṁ
            for end, sign in zip(o.ends, (-1, 1), strict=True):
                if end is None:
                    rates.mass_supplied -= sign * ṁ.real
                    rates.energy_supplied -= sign * ė.real
                else:
                    rates.mass[end] += sign * ṁ
                    rates.energy[end] += sign * ė
        for wall, k in self._walls:
            Q = wall.conductance * (wall.temperature - T[k])
            rates.energy[k] += Q
            rates.energy_supplied += Q.real
        return rates

    def _flow(self, o: _Opening, p: Complex, T: Complex) -> tuple[complex, complex]:
        """Mass flow from first to second end, and the temperature it carries."""
        holders = (o.orifice.first, o.orifice.second)
        ps = tuple(complex(h.pressure) if k is None else p[k] for k, h in zip(o.ends, holders, strict=True))
        Ts = tuple(complex(h.temperature) if k is None else T[k] for k, h in zip(o.ends, holders, strict=True))
        return complex(o.orifice.flow(self._gas, o.area, ps, Ts)), Ts[0] if ps[0].real >= ps[1].real else Ts[1]

    def _relaxation_rate(self, o: _Opening, p: Complex, T: Complex) -> float:
        """Rate [1/s] at which the opening alone would equalise the pressures of its ends."""
        rate = 0.0
        for end, sign in zip(o.ends, (-1, 1), strict=True):
            if end is not None:
                q = p.copy()
                q[end] += 1j * STEP
                slope = sign * self._flow(o, q, T)[0].imag / STEP
                rate -= slope * self._gas.gamma * self._gas.R * T[end].real / self.states[end].V
        return max(rate, 0.0)


def _fitted_weight(z: float) -> float:
    """θ for which one step of θ-weighted relaxation at rate z/h is exact: ½ at z = 0, 1 at infinity."""
    if z < 1e-3:
        return 0.5 + z / 12
    return float(1 / -np.expm1(-z) - 1 / z)
