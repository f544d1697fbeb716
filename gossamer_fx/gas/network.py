"""All volumes and openings of a scene as one border: the unknowns are the pressures and masses of the chambers.

For chamber k with the enclosed volume V(q) and the state (p, m), U = p V/(γ-1), a step of length h solves

    m1 = m0 + h Σ ±ṁ
    U1 = U0 + h Σ ±c_p T_up ṁ + h Q - p̄ W,     W = G(q̄)·(q1 - q0)

where p̄ = (p0 + p1)/2 is the pressure that acts on the film, so that the work p̄ W is what the film receives, to the
last digit; the sum over both sides of an opening is zero, so mass and energy of the network are, too.

Flows are taken at p0 + θ (p1 - p0) with a weight θ of each chamber,

    1 - θ = 1/(1/(1 - θ_e) + 40 z⁴/(1 + z²)),     z = h ṁγRT/(V Δp) summed over its openings

θ_e = ½ + O(h) makes exponential relaxation exact (vents, walls); the term with z is of fourth order while steps are
short, and ends the ringing of steps that are longer than the time in which pressures equalise.  The flow is a concave
function of Δp that begins with √(2Δp/p) and ends choked with Ψ* > 0.63: no step, however long, overshoots equal
pressures if 1 - θ < Ψ*²/(2z²) for z > 1, between two equal chambers a quarter of it.  Temperatures are those of the
mean energy and mass.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from petsc4py import PETSc

from gossamer_fx.checks.errors import check
from gossamer_fx.gas.contract import Aperture, Opening, Volume, Wall
from gossamer_fx.gas.ring import Loops
from gossamer_fx.gas.state import ChamberState
from gossamer_fx.model.scalar_unknowns import ScalarTotals
from gossamer_fx.model.terms import Array, Assembly, Body

if TYPE_CHECKING:
    from gossamer_fx.gas.ideal_gas import IdealGas

Complex = npt.NDArray[np.complex128]
Pair = tuple[complex, complex]
STEP = 1e-30  # of the complex-step derivative


@dataclass
class _Rates:
    """Σ over the openings of a chamber network: into the chambers, and out of everything else."""

    mass: Complex
    energy: Complex
    mass_supplied: float = 0.0
    energy_supplied: float = 0.0


@dataclass
class _Passage:
    """An opening of the network; its ends are chambers by number, or others."""

    opening: Opening
    ends: tuple[int | None, int | None]
    aperture: Aperture
    area: float = 0.0  # C_d A of the step [m²]


class GasNetwork:
    """ScalarUnknowns of a scene's chambers; y = (p1, m1) of each."""

    def __init__(self, items: list[Any], system: Assembly) -> None:
        chambers = [i for i in items if isinstance(i, Volume)]
        check(bool(chambers), "The scene has gas but no chamber or tank; add one, or remove reservoirs and orifices.")
        first = chambers[0]
        odd = next((c.name for c in chambers if c.gas != first.gas), "")
        check(not odd, f"The chambers '{first.name}' and '{odd}' hold different gases; a scene has one.")
        self._gas: IdealGas = first.gas
        self._loops = loops = Loops(system)
        self._gases = [ChamberState(c, c.enclosure.compile(system, loops) if c.enclosure else None) for c in chambers]
        index = {id(c): k for k, c in enumerate(chambers)}
        self._openings = [
            _Passage(o, (index.get(id(o.first)), index.get(id(o.second))), o.aperture(loops))
            for o in items
            if isinstance(o, Opening)
        ]
        self._walls = [(w, index[id(w.chamber)]) for w in items if isinstance(w, Wall)]
        self._α = system.rule.alpha
        self._θ: Array = np.full(len(chambers), 0.5)
        self._θ_walls: Array = np.full(len(self._walls), 0.5)
        self._V: Array = np.zeros(len(chambers))  # volumes and swept volumes of the iterate
        self._W: Array = np.zeros(len(chambers))
        self._amplification: Array = np.zeros(len(chambers))
        self.size = 2 * len(chambers)
        self._supplied = self._mass_supplied = 0.0

    # ---- the border --------------------------------------------------------------------------------------------------

    def start(self) -> None:
        self._loops.follow()
        self._loops.accept()
        for s in self._gases:
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
        p = np.array([s.p for s in self._gases], dtype=complex)
        T = np.array([s.temperature for s in self._gases], dtype=complex)
        for o in self._openings:
            o.area = o.aperture(h, t)
        self._choose_weights(p, T)
        self._V, self._W = np.array([s.V for s in self._gases]), np.zeros(len(self._gases))
        return self._settle(np.array([s.p for s in self._gases] + [s.m for s in self._gases]))

    def _settle(self, y: Array) -> Array:
        """y of the step if no volume changed: Newton's method, backtracking, from which the coupled one starts."""
        rates = self._rates_at(y.astype(complex))
        scale = self._scales(y) + self._h * abs(np.concatenate([rates.energy, rates.mass]))
        F = np.real(self._balance(y.astype(complex))) / scale
        for _ in range(50):
            if abs(F).max() <= 1e-13:
                break
            δ, size = np.linalg.solve(self._derivative(y) / scale[:, None], F), float(F @ F)
            for λ in 0.5 ** np.arange(30):
                # no pressure or mass falls below a tenth in one iteration: the flow law knows positive ones only
                trial = np.maximum(y - λ * δ, 0.1 * y)
                F = np.real(self._balance(trial.astype(complex))) / scale
                if float(F @ F) < size:
                    break
            y = trial
        return y

    def residual(self, y: Array) -> Array:
        self._loops.follow()
        for s in self._gases:
            if s.enclosure is not None:
                s.enclosure.evaluate()
        self._V = np.array([self._volume(s) for s in self._gases])
        self._W = np.array([self._swept(s) for s in self._gases])
        self._y = y
        scale = self._scales(y)
        self._scale = scale
        return np.real(self._balance(y.astype(complex))) / scale

    def add_force(self, values: Array) -> None:
        for s, p1 in zip(self._gases, self._y, strict=False):
            if s.enclosure is not None:
                s.enclosure.add_force(values, self._acting(s.p, float(p1)) - self._outside(s))

    def tangents(self, body: Body) -> Iterable[fem.Form]:
        for s in self._gases:
            if s.enclosure is not None:
                yield from s.enclosure.tangents(body)

    def add_tangents(self, A: PETSc.Mat) -> None:
        for s in self._gases:
            if s.enclosure is not None:
                s.enclosure.add_tangents(A)

    def coupling(self) -> tuple[list[Array | None], list[Array | None], Array]:
        n = len(self._gases)
        G: list[Array | None] = [None] * (2 * n)
        H: list[Array | None] = [None] * (2 * n)
        for k, s in enumerate(self._gases):
            if s.enclosure is not None:
                mid, dV, dW = s.enclosure.gradients()
                p1 = float(self._y[k])
                G[k] = -self._α * mid
                H[k] = (p1 / (self._gas.gamma - 1) * dV + self._mean(s.p, p1) * dW) / self._scale[k]
        return G, H, self._derivative(self._y) / self._scale[:, None]

    def accept(self) -> None:
        # mass and energy are summed from the flows, so that they are conserved to round-off whatever the tolerance
        rates, h = self._rates_at(self._y.astype(complex)), self._h
        self._loops.accept()
        for k, s in enumerate(self._gases):
            if s.enclosure is not None:
                self._supplied -= self._outside(s) * s.enclosure.swept
                s.enclosure.accept()
            s.V = self._volume(s)
            s.m += h * float(rates.mass[k].real)
            s.U += h * float(rates.energy[k].real) - self._mean(s.p, float(self._y[k])) * self._swept(s)
            s.p = (self._gas.gamma - 1) * s.U / s.V
        self._supplied += h * rates.energy_supplied
        self._mass_supplied += h * rates.mass_supplied

    def inadmissible(self) -> str:
        for s, V, p1 in zip(self._gases, self._V, self._y, strict=False):
            if V <= 0 or p1 <= 0:
                return f"'{s.chamber.name}' would have a volume of {V:.3g} m³ and a pressure of {p1:.3g} Pa"
        return ""

    def totals(self) -> ScalarTotals:
        return ScalarTotals(
            {s.chamber.name: s.U for s in self._gases},
            self._supplied,
            sum(s.m for s in self._gases),
            self._mass_supplied,
        )

    def states(self) -> dict[str, ChamberState]:
        return {s.chamber.name: s for s in self._gases}

    def get_state(self) -> dict[str, Any]:
        chambers = [[s.chamber.name, s.p, s.m, s.U, s.V] for s in self._gases]
        return {"chambers": chambers, "supplied": self._supplied, "mass supplied": self._mass_supplied}

    def set_state(self, state: dict[str, Any]) -> None:
        self._loops.follow()
        self._loops.accept()
        for s, kept in zip(self._gases, state["chambers"], strict=True):
            s.p, s.m, s.U, s.V = kept[1:]
            if s.enclosure is not None:
                s.enclosure.evaluate()
                s.enclosure.accept()
        self._supplied, self._mass_supplied = state["supplied"], state["mass supplied"]

    # ---- the balance -------------------------------------------------------------------------------------------

    def _acting(self, p0: float, p1: float) -> float:
        """The pressure that acts on the film, p̄ in the midpoint rule."""
        return (1 - self._α) * p0 + self._α * p1

    def _mean(self, p0: float, p1: Any) -> Any:
        """The pressure at which the gas works, p̄."""
        return (p0 + p1) / 2

    def _outside(self, s: ChamberState) -> float:
        return float(s.chamber.outside.pressure) if s.chamber.outside is not None else 0.0

    def _volume(self, s: ChamberState) -> float:
        return float(s.chamber.fixed_volume) + (s.enclosure.volume if s.enclosure is not None else 0.0)

    def _swept(self, s: ChamberState) -> float:
        return s.enclosure.swept if s.enclosure is not None else 0.0

    def _balance(self, y: Complex) -> Complex:
        """Energy [J] and mass [kg] that each chamber would have too much."""
        n, h = len(self._gases), self._h
        rates = self._rates_at(y)
        energy = [
            y[k] * self._V[k] / (self._gas.gamma - 1) - s.U - h * rates.energy[k] + self._mean(s.p, y[k]) * self._W[k]
            for k, s in enumerate(self._gases)
        ]
        mass = [y[n + k] - s.m - h * rates.mass[k] for k, s in enumerate(self._gases)]
        return np.array(energy + mass)

    def _derivative(self, y: Array) -> Array:
        """Of the balance, by complex steps."""
        columns = []
        for j in range(len(y)):
            moved = y.astype(complex)
            moved[j] += 1j * STEP
            columns.append(np.imag(self._balance(moved)) / STEP)
        return np.array(columns).T

    def _scales(self, y: Array) -> Array:
        """Energy and mass of each chamber, to which errors are compared; never below the round-off of the volume.

        Nor below that of the flows, which long steps through wide openings multiply: the accepted state is summed from
        them, so that nothing is lost.
        """
        n = len(self._gases)
        flows = 1 + 1e-3 * self._amplification
        magnitude = np.array([s.enclosure.magnitude if s.enclosure is not None else 0.0 for s in self._gases])
        energy = abs(y[:n]) * (abs(self._V) * flows + 1e-3 * magnitude) / (self._gas.gamma - 1)
        mass = abs(y[n:]) * flows
        return np.concatenate([energy + [s.U for s in self._gases], mass + [s.m for s in self._gases]])

    def _rates_at(self, y: Complex) -> _Rates:
        """Mass and energy per second into every chamber, and from reservoirs, surroundings and walls."""
        n, cv = len(self._gases), self._gas.cv
        p0, U0, m0 = (np.array([getattr(s, name) for s in self._gases]) for name in ("p", "U", "m"))
        U1, m1 = y[:n] * self._V / (self._gas.gamma - 1), y[n:]
        p, T = p0 + self._θ * (y[:n] - p0), (U0 + U1) / ((m0 + m1) * cv)
        rates = _Rates(np.zeros(n, dtype=complex), np.zeros(n, dtype=complex))
        for o in self._openings:
            ṁ, Tu = self._flow(o, p, T)
            ė = self._gas.cp * Tu * ṁ
            for end, sign in zip(o.ends, (-1, 1), strict=True):
                if end is None:
                    rates.mass_supplied -= sign * ṁ.real
                    rates.energy_supplied -= sign * ė.real
                else:
                    rates.mass[end] += sign * ṁ
                    rates.energy[end] += sign * ė
        for (wall, k), θ in zip(self._walls, self._θ_walls, strict=True):
            Tw = (1 - θ) * U0[k] / (m0[k] * cv) + θ * U1[k] / (m1[k] * cv)
            Q = wall.conductance * (wall.temperature - Tw)
            rates.energy[k] += Q
            rates.energy_supplied += Q.real
        return rates

    def _flow(self, o: _Passage, p: Complex, T: Complex) -> tuple[complex, complex]:
        """Mass flow from first to second end, and the temperature it carries."""
        ps, Ts = self._at_ends(o, p, T)
        return complex(o.opening.flow(self._gas, o.area, ps, Ts)), Ts[0] if ps[0].real >= ps[1].real else Ts[1]

    def _at_ends(self, o: _Passage, p: Complex, T: Complex) -> tuple[Pair, Pair]:
        """Pressures and temperatures at the ends of an opening."""
        ends = tuple(zip(o.ends, (o.opening.first, o.opening.second), strict=True))
        (pa, pb), (Ta, Tb) = (
            [complex(getattr(holder, name)) if k is None else complex(values[k]) for k, holder in ends]
            for name, values in (("pressure", p), ("temperature", T))
        )
        return (pa, pb), (Ta, Tb)

    def _choose_weights(self, p: Complex, T: Complex) -> None:
        """θ of every chamber and wall for the step, and how much flows amplify the round-off of pressures."""
        slopes, rates, resting = np.zeros((3, len(self._gases)))
        for o in self._openings:
            ps, Ts = self._at_ends(o, p, T)
            (pd, _), (pu, Tu) = sorted((x.real, t.real) for x, t in zip(ps, Ts, strict=True))
            if pu == 0:
                continue
            almost = pu * (1 - 1e-9)
            moving, at_rest = (self._conductance(o, pu, Tu, pd) for pd in (min(pd, almost), almost))
            for k, sign in zip(o.ends, (-1, 1), strict=True):
                if k is not None:
                    stiffness = self._h * self._gas.gamma * self._gas.R * Tu / self._gases[k].V
                    rates[k] += stiffness * moving
                    resting[k] += stiffness * at_rest
                    stepped = (ps[0] + 1j * STEP * (sign < 0), ps[1] + 1j * STEP * (sign > 0))
                    slopes[k] -= stiffness * sign * o.opening.flow(self._gas, o.area, stepped, Ts).imag / STEP
        exponential = np.array([_fitted_weight(z) for z in np.maximum(slopes, 0.0)])
        self._θ = 1 - 1 / (1 / (1 - exponential) + 40 * rates**4 / (1 + rates**2))
        self._amplification = resting
        cooling = [w.conductance / (self._gases[k].m * self._gas.cv) for w, k in self._walls]
        self._θ_walls = np.array([_fitted_weight(self._h * rate) for rate in cooling])

    def _conductance(self, o: _Passage, pu: float, Tu: float, pd: float) -> float:
        """Mass flow over pressure difference [kg/(s Pa)]."""
        return float(o.opening.flow(self._gas, o.area, (pu, pd), (Tu, Tu)).real) / (pu - pd)


def _fitted_weight(z: float) -> float:
    """θ for which one step of θ-weighted relaxation at rate z/h is exact: ½ at z = 0, 1 at infinity."""
    if z < 1e-3:
        return 0.5 + z / 12
    return float(1 / -np.expm1(-z) - 1 / z)
