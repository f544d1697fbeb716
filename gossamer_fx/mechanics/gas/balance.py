"""Mass and energy balance of the chambers in one time step: residual, derivatives and solution.

Problem.  Chamber k has the volume V, the mass m and the internal energy U = p V/(γ - 1).  Openings
carry mass flows ṁ, walls carry heat Q, and the film that encloses the chamber sweeps the volume W
in a step.  Openings are stiff: their conductance is infinite at equal pressures for the ideal law,
and pressures may equalise within a microsecond while a step takes a second.

Equations.  The unknowns are y = (p1, m1), pressure and mass at the end of a step of length h:

    m1 = m0 + h Σ ±ṁ                                                              (1)
    U1 = U0 + h Σ ±c_p T_up ṁ + h Q - p̄ W,      p̄ = (p0 + p1)/2                  (2)

Flows are taken at the pressures and temperatures

    p_θ = p0 + θ (p1 - p0),      T = (U0 + U1)/((m0 + m1) c_v)                    (3)

Idea.  The weight θ of each chamber blends two rules:

    θ_e = 1/(1 - exp(-ζ)) - 1/ζ                                                   (4)
    1 - θ = 1/(1/(1 - θ_e) + 40 z⁴/(1 + z²))                                      (5)

(4) is the weight with which relaxation at the rate ζ/h is exact (exponential fitting, Liniger and
Willoughby 1970); it is ½ + O(h), so the rule is of second order.  The second
term of (5), with z = h ṁ γ R T/(V Δp) summed over the openings of the chamber, is of fourth order
for short steps; it damps the oscillation of steps that are longer than the time in which pressures
equalise.  Why its size suffices: the flow is a concave function of Δp that begins as √(2Δp/p) and
ends choked with Ψ* > 0.63, so a step of any length stays on its side of equal pressures if 1 - θ <
Ψ*²/(2z²) for z > 1, or a quarter of that between two equal chambers.

Algorithm.  In every step:

1. `begin` takes the state of the start and chooses θ by (4) and (5).
2. In every iteration of the bodies, `settle` solves (1) and (2) for y at the volumes of the
   iterate, by Newton's method with backtracking.
3. `derivatives` gives the Jacobian with respect to y and V, by which the bodies see the gas.
4. `rates` gives the sums of (1) and (2) from which the accepted state is summed.

The equations are written for any numbers that add, multiply and compare: for dual numbers in arrays
of objects `residual` gives its derivatives with respect to the start of the step, too
(`gas.adjoint`).

Cost: one dense solve of 2n equations in an iteration for n chambers, which is negligible next to
the bodies.  Arrays over chambers have the shape (n,) and SI units.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gossamer_fx.core.algebra.dual_numbers import Dual, Number
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.gas.contract import Aperture, Holder, Opening, Wall
from gossamer_fx.mechanics.gas.ideal_gas import IdealGas

# Values at the first and the second end of an opening; complex for derivatives by complex steps.
Pair = tuple[Number, Number]

# Pressure [Pa] and temperature [K] at one end of an opening
State = tuple[Number, Number]

# An end of an opening: the number of a chamber, or a boundary of constant state.
End = int | Holder

# Complex-step derivatives have no cancellation, so the step is as small as possible; its square
# (1e-60) is negligible in double precision next to any quantity of a network.
COMPLEX_STEP = 1e-30

# Scaled residual of a solution.  Round-off of the sums is some 1e-15; a factor of 100 is left for
# networks with many openings.
RESIDUAL_TOLERANCE = 1e-13

# Scaled residual that is accepted when round-off stops the iteration earlier: the coupled Newton
# iteration with the bodies reduces it further.
ACCEPTABLE_RESIDUAL = 1e-9

# Of 5700 solutions in the tests of this package 99 % took at most 4 iterations.  The others are
# stopped here by round-off, with a residual below ACCEPTABLE_RESIDUAL.
MAX_ITERATIONS = 50

# Halvings of a Newton update.  After 30 of them the update is below 1e-9 of itself.
MAX_HALVINGS = 30

# Pressures and masses fall at most to this share in one iteration, because the flow law and the
# temperature exist for positive values only.
MIN_REMAINING_SHARE = 0.1

# Coefficient of the second term of (5).  It keeps 1 - θ below a quarter of Ψ*²/(2z²) ≈ 0.05/z².
DAMPING_COEFFICIENT = 40

# Relative pressure difference at which the conductance of an opening at rest is measured: inside
# the laminar range of `Orifice`, where the law is linear, and far above round-off.
REST_DIFFERENCE = 1e-9

# Share of amplified or cancelled round-off in the scale of a residual: 1e-3 of it times
# RESIDUAL_TOLERANCE is the round-off 1e-16 that such a sum has.
ROUND_OFF_SHARE = 1e-3


@dataclass
class Passage:
    """An opening in a network, with its ends as numbers of chambers or as boundaries, its effective
    area as a function of step length and time, and that of the current step, C_d A [m²]."""

    opening: Opening
    ends: tuple[End, End]
    aperture: Aperture
    area: Number = 0.0


@dataclass
class Rates:
    """Mass flow [kg/s] through each opening (m,), from its end a to its end b; and sums over all
    openings and walls: mass flow [kg/s] and enthalpy flow with heat [W] into each chamber (n,), and
    from all boundaries and walls."""

    openings: list[float]
    mass: Array
    energy: Array
    mass_supplied: float = 0.0
    energy_supplied: float = 0.0


class Balance:
    """Mass and energy balance (1), (2) of the n chambers of a network in a step.

    In the methods y (2n,) are pressures [Pa], then masses [kg], and V (n,) [m³] volumes at the end
    of the step, W (n,) [m³] the volumes that the enclosures sweep, and `magnitude` (n,) [m³] sums
    of the sizes of the summands of each volume, of which round-off is a part.  `begin` stores the
    state at the start (n,): `_p0` [Pa], `_m0` [kg], `_U0` [J] and `temperatures` [K]; `_cv` [J/(kg
    K)] is the specific heat at constant volume, `h` [s] the length of the step.  Walls have the
    number of their chamber.
    """

    # Whether the work p̄ W is in the equations.
    depends_on_swept_volume = True

    def __init__(
        self, gas: IdealGas, passages: list[Passage], walls: list[tuple[Wall, int]], n: int
    ) -> None:
        self.h = 0.0
        self.temperatures: Array = np.zeros(n)
        self._gas = gas
        # Properties of the gas that are asked for each flow
        self._cv = gas.cv
        self._cp = gas.cp
        self.passages = passages
        self.walls = walls
        self._n = n
        # ½ is the midpoint rule; `begin` replaces it.
        self._weights: Array = np.full(n, 0.5)
        self._wall_weights: Array = np.full(len(walls), 0.5)
        self._amplification: Array = np.zeros(n)

    def begin(self, h: float, t: float, p: Array, m: Array, U: Array, V: Array) -> None:
        """Start a step: store its initial state, without a copy, and choose the weights θ of its
        flows: ½ is the middle, 1 the end.  `InputError`: the area of a valve is negative or not a
        number."""
        self.h = h
        self._p0 = p
        self._m0 = m
        self._U0 = U
        self.temperatures = U / (m * self._cv)
        for passage in self.passages:
            passage.area = passage.aperture(h, t)
        self._choose_weights(p, self.temperatures, V)

    # ---- equations -------------------------------------------------------------------------------

    def residual(self, y: Array, V: Array, W: Array, known: Rates | None = None) -> Array:
        """Return the excess of energy [J] and mass [kg] in each chamber over its balance in a step,
        (1) and (2) of the module: it gains mass by flows, and energy by flows, heat and the work of
        its enclosure."""
        p1 = y[: self._n]
        m1 = y[self._n :]
        rates = known or self.rates(y, V)
        energy = (
            p1 * V / (self._gas.gamma - 1) - self._U0 - self.h * rates.energy + self.work(y, V, W)
        )
        mass = m1 - self._m0 - self.h * rates.mass
        return np.concatenate([energy, mass])

    def work(self, y: Array, V: Array, W: Array) -> Array:
        """Work p̄ W [J] of each chamber (n,) on what encloses it, see `residual`."""
        work: Array = (self._p0 + y[: self._n]) / 2 * W
        return work

    def rates(self, y: Array, V: Array) -> Rates:
        """Return mass and energy flows into the chambers, and from boundaries and walls.  What one
        end of an opening loses the other gains in the same sum, so the network conserves mass and
        energy to round-off."""
        n = self._n
        # Lists of numbers: for so few chambers NumPy takes three times as long.
        mass: list[Number] = [0.0] * n
        energy: list[Number] = [0.0] * n
        mass_supplied: Number = 0.0
        energy_supplied: Number = 0.0
        openings: list[float] = []
        states = _states(*self._flow_state(y, V))
        for passage in self.passages:
            at_ends = _at_ends(passage, states)
            mass_flow, energy_flow = self._flows(passage, *at_ends)
            openings.append(mass_flow.real)
            for end, sign in zip(passage.ends, (-1, 1), strict=True):
                if isinstance(end, int):
                    mass[end] += sign * mass_flow.real
                    energy[end] += sign * energy_flow.real
                else:
                    mass_supplied -= sign * mass_flow.real
                    energy_supplied -= sign * energy_flow.real
        rates = Rates(openings, np.array(mass), np.array(energy), mass_supplied, energy_supplied)
        for (wall, k), weight in zip(self.walls, self._wall_weights, strict=True):
            heat = self._heat(wall, k, weight, y, V)
            rates.energy[k] += heat
            rates.energy_supplied += heat
        return rates

    def scales(self, y: Array, V: Array, magnitude: Array) -> Array:
        """Energy [J] and mass [kg] of each chamber to which its residual is compared, (2n,).

        They include the round-off of two sums that the residual cannot fall below: that of the
        volume, and that of flows, which long steps through wide openings amplify.  Nothing is lost
        by this, since the accepted state is summed from the flows.
        """
        flows = 1 + ROUND_OFF_SHARE * self._amplification
        volume = abs(V) * flows + ROUND_OFF_SHARE * magnitude
        energy = abs(y[: self._n]) * volume / (self._gas.gamma - 1)
        mass = abs(y[self._n :]) * flows
        return np.concatenate([energy + self._U0, mass + self._m0])

    # ---- derivatives -----------------------------------------------------------------------------

    def derivatives(self, y: Array, V: Array, W: Array) -> tuple[Array, Array]:
        """Return the derivatives (2n, 2n) and (2n, n) of the residual (energies [J], then masses
        [kg]) with respect to y and to V.  That with respect to W is the mean pressure on the
        diagonal of the energy rows; the caller has it."""
        n = self._n
        heat_factor = self._gas.gamma - 1
        # U1 = p1 V/(γ-1) and p̄ W in the energy rows, m1 in the mass rows.
        energy_by_pressure = V / heat_factor + W / 2
        by_y = np.diag(np.concatenate([energy_by_pressure, np.ones(n)]))
        by_V = np.zeros((2 * n, n))
        by_V[np.arange(n), np.arange(n)] = y[:n] / heat_factor
        self._add_flow_derivatives(by_y, by_V, y, V)
        self._add_heat_derivatives(by_y, by_V, y, V)
        return by_y, by_V

    def _add_flow_derivatives(self, by_y: Array, by_V: Array, y: Array, V: Array) -> None:
        """Subtract step length times the derivatives of the flows from those of the residual, which
        are changed in place.  p [Pa] and T [K] (n,) determine the flows."""
        n = self._n
        p, T = self._flow_state(y, V)
        states = _states(p, T)
        # Lists of numbers, as in `rates`
        end_pressure: Any = y[:n].tolist()
        temperature: Any = T.tolist()
        total_mass: Any = (self._m0 + y[n:]).tolist()
        volume: Any = V.tolist()
        weight: Any = self._weights.tolist()
        for passage in self.passages:
            at_ends = _at_ends(passage, states)
            for side, k in enumerate(passage.ends):
                if not isinstance(k, int):
                    continue
                by_pressure = self._slope(passage, at_ends, side, "pressure")
                by_temperature = self._slope(passage, at_ends, side, "temperature")
                # ∂T/∂(p1 V) of (3)
                T_by_pV = 1 / ((self._gas.gamma - 1) * total_mass[k] * self._cv)
                for end, sign in zip(passage.ends, (-self.h, self.h), strict=True):
                    if not isinstance(end, int):
                        continue
                    # The first slope is that of the mass flow (row n + end), the second that of the
                    # energy flow (row end).
                    slopes = zip((n + end, end), by_pressure, by_temperature, strict=True)
                    for row, p_slope, T_slope in slopes:
                        by_p1 = p_slope * weight[k] + T_slope * volume[k] * T_by_pV
                        by_y[row, k] -= sign * by_p1
                        by_y[row, n + k] += sign * T_slope * temperature[k] / total_mass[k]
                        by_V[row, k] -= sign * T_slope * end_pressure[k] * T_by_pV

    def _add_heat_derivatives(self, by_y: Array, by_V: Array, y: Array, V: Array) -> None:
        """Subtract step length times the derivatives of the heat of the walls, like
        `_add_flow_derivatives`.  Q [W] is the heat flow; p1 [Pa], m1 [kg] and U1 [J] are pressure,
        mass and energy of a chamber at the end."""
        n = self._n
        heat_factor = self._gas.gamma - 1
        for (wall, k), weight in zip(self.walls, self._wall_weights, strict=True):
            p1 = y[k]
            m1 = y[n + k]
            # -h ∂Q/∂U1
            cooling = self.h * wall.conductance * weight / (m1 * self._cv)
            by_y[k, k] += cooling * V[k] / heat_factor
            by_y[k, n + k] -= cooling * p1 * V[k] / (heat_factor * m1)
            by_V[k, k] += cooling * p1 / heat_factor

    def _slope(
        self, passage: Passage, at_ends: tuple[Pair, Pair], side: int, quantity: str
    ) -> Pair:
        """Return derivatives of mass flow [kg/s] and energy flow [W] of a passage with respect to
        the pressure [Pa] or temperature [K] at one end, by complex steps, exact to round-off."""
        pressures = list(at_ends[0])
        temperatures = list(at_ends[1])
        varied = pressures if quantity == "pressure" else temperatures
        varied[side] += 1j * COMPLEX_STEP
        mass_flow, energy_flow = self._flows(
            passage,
            (pressures[0], pressures[1]),
            (temperatures[0], temperatures[1]),
        )
        return mass_flow.imag / COMPLEX_STEP, energy_flow.imag / COMPLEX_STEP

    # ---- solution --------------------------------------------------------------------------------

    def settle(self, y: Array, V: Array, W: Array, magnitude: Array) -> Array | None:
        """Solve the balance at given volumes by Newton's method, from a positive guess y; returns
        None if the iteration does not converge or the matrix is singular."""
        rates = self.rates(y, V)
        flows = abs(np.concatenate([rates.energy, rates.mass]))
        scale = self.scales(y, V, magnitude) + self.h * flows
        error = self.residual(y, V, W, rates) / scale
        for _ in range(MAX_ITERATIONS):
            if abs(error).max() <= RESIDUAL_TOLERANCE:
                return y
            matrix = self.derivatives(y, V, W)[0] / scale[:, None]
            try:
                update = np.linalg.solve(matrix, error)
            except np.linalg.LinAlgError:
                return None
            size = float(error @ error)
            for length in 0.5 ** np.arange(MAX_HALVINGS):
                trial = np.maximum(y - length * update, MIN_REMAINING_SHARE * y)
                error = self.residual(trial, V, W) / scale
                if float(error @ error) < size:
                    break
            # The last trial is taken also if none decreased the residual: at round-off none does.
            y = trial
        if abs(error).max() > ACCEPTABLE_RESIDUAL:
            return None
        return y

    # ---- flows -----------------------------------------------------------------------------------

    def _flow_state(self, y: Array, V: Array) -> tuple[Array, Array]:
        """Pressures [Pa] and temperatures [K] of the chambers by (3), at which flows are taken."""
        p1 = y[: self._n]
        m1 = y[self._n :]
        total_energy = self._U0 + p1 * V / (self._gas.gamma - 1)
        total_mass = self._m0 + m1
        p = self._p0 + self._weights * (p1 - self._p0)
        return p, total_energy / (total_mass * self._cv)

    def _flows(self, passage: Passage, p: Pair, T: Pair) -> Pair:
        """Return mass flow [kg/s] and enthalpy flow [W] from the first to the second end of an
        opening, at pressures p [Pa] and temperatures T [K] of both; the gas has the temperature of
        the end it comes from."""
        mass_flow = passage.opening.flow(self._gas, passage.area, p, T)
        # The gas has the temperature of the end it comes from.
        upstream_temperature = T[0]
        if p[0].real < p[1].real:
            upstream_temperature = T[1]
        # `_cp` is the specific heat of the gas at constant pressure [J/(kg K)].
        return mass_flow, self._cp * upstream_temperature * mass_flow

    def _heat(self, wall: Wall, k: int, weight: Number, y: Array, V: Array) -> Number:
        """Return the heat flow [W] from a wall into chamber k, at a mean of its temperature with a
        weight of the end of the step, ½ to 1."""
        cv = self._cv
        end_energy = y[k] * V[k] / (self._gas.gamma - 1)
        start_temperature = self._U0[k] / (self._m0[k] * cv)
        end_temperature = end_energy / (y[self._n + k] * cv)
        temperature = (1 - weight) * start_temperature + weight * end_temperature
        return wall.conductance * (wall.temperature - temperature)

    # ---- weights ---------------------------------------------------------------------------------

    def _choose_weights(self, p: Array, T: Array, V: Array) -> None:
        """Choose the weight θ of the end of the step in the flows of every chamber, `_weights`
        (n,), and of every wall, `_wall_weights`: ½ for short steps and near 1 for steps in which
        pressures equalise, (4) and (5) of the module.

        The conductances at rest are summed too, in `_amplification` (n,) [-]: they amplify the
        round-off of pressures, see `scales`.  p [Pa], T [K] and V [m³] (n,) are of the start.
        """
        relaxation = np.zeros_like(p)  # ζ of (4)
        equalisation = np.zeros_like(p)  # z of (5)
        at_rest = np.zeros_like(p)
        states = _states(p, T)
        for passage in self.passages:
            pressures, temperatures = _at_ends(passage, states)
            # Of equal pressures the hotter end counts as upstream.
            is_first = pressures[0] >= pressures[1]
            if is_first and pressures[0] <= pressures[1]:
                is_first = temperatures[0] >= temperatures[1]
            upstream = 0 if is_first else 1
            p_high = pressures[upstream]
            p_low = pressures[1 - upstream]
            T_high = temperatures[upstream]
            if p_high <= 0:
                # Two vacuums exchange nothing.
                continue
            # z of (5) has Δp in its denominator: it is taken at no smaller difference than this
            # one.
            almost_equal = p_high * (1 - REST_DIFFERENCE)
            moving = self._conductance(passage, p_high, T_high, min(p_low, almost_equal))
            resting = self._conductance(passage, p_high, T_high, almost_equal)
            for side, (k, sign) in enumerate(zip(passage.ends, (-1, 1), strict=True)):
                if not isinstance(k, int):
                    continue
                # Rise of the pressure in a step per mass flow, h γ R T/V of an adiabatic chamber
                stiffness = self.h * self._gas.gamma * self._gas.R * T_high / V[k]
                slopes = self._slope(passage, (pressures, temperatures), side, "pressure")
                relaxation[k] -= stiffness * sign * slopes[0]
                equalisation[k] += stiffness * moving
                at_rest[k] += stiffness * resting
        # A chamber whose pressure would not relax, by round-off or a law of the user, has θ_e = ½.
        fitted = np.array([_fitted_weight(rate) for rate in np.maximum(relaxation, 0.0)])
        damping = DAMPING_COEFFICIENT * equalisation**4 / (1 + equalisation**2)
        self._weights = 1 - 1 / (1 / (1 - fitted) + damping)
        self._amplification = at_rest
        wall_weights = []
        for wall, k in self.walls:
            heat_capacity = self._m0[k] * self._cv
            cooling_rate = wall.conductance / heat_capacity
            wall_weights.append(_fitted_weight(self.h * cooling_rate))
        self._wall_weights = np.array(wall_weights)

    def _conductance(self, passage: Passage, pu: Number, Tu: Number, pd: Number) -> Number:
        """Return the mass flow over the pressure difference [kg/(s Pa)] of an opening, from the
        pressure pu [Pa] and temperature Tu [K] to a lower pressure pd."""
        mass_flow = passage.opening.flow(self._gas, passage.area, (pu, pd), (Tu, Tu))
        return mass_flow.real / (pu - pd)


def _states(p: Array, T: Array) -> list[State]:
    """Pressure [Pa] and temperature [K] of each chamber, as Python's or dual numbers."""
    pressures: Any = p.tolist()
    temperatures: Any = T.tolist()
    return list(zip(pressures, temperatures, strict=True))


def _at_ends(passage: Passage, states: list[State]) -> tuple[Pair, Pair]:
    """Pressures [Pa] and temperatures [K] at the two ends of an opening, for the states of all
    chambers."""
    first, second = passage.ends
    first_pressure, first_temperature = _state_at(first, states)
    second_pressure, second_temperature = _state_at(second, states)
    return (first_pressure, second_pressure), (first_temperature, second_temperature)


def _state_at(end: End, states: list[State]) -> State:
    """Pressure [Pa] and temperature [K] of one end of an opening."""
    if isinstance(end, int):
        return states[end]
    return end.pressure, end.temperature


def _fitted_weight(rate: Number) -> Number:
    """Return the weight θ_e = 1/(1 - exp(-rate)) - 1/rate, ½ at 0 and 1 at infinity, with which a
    relaxation is exact, equation (4) of the module.

    The rate is the length of the step over the time constant of the relaxation, ≥ 0; a dual number
    carries derivatives.
    """
    # Both terms of (4) grow as 1/rate; below 1e-3 the series is exact to 1e-12 and does not cancel.
    if rate < 1e-3:
        return 0.5 + rate / 12
    decay = (-rate).expm1() if isinstance(rate, Dual) else np.expm1(-rate)
    return -1 / decay - 1 / rate
