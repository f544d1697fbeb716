"""Mass and energy balance of the chambers in one time step: residual, derivatives and solution.

Problem.  Chamber k has the volume V, masses m of one or more species and the internal energy
U(p V, m), p V/(γ - 1) for one gas of constant specific heats; see `mixture`.  Openings carry mass
flows ṁ of the mixture at the end that the gas comes from, walls carry heat Q, and the film that
encloses the chamber sweeps the volume W in a step.  Openings are stiff: their conductance is
infinite at equal pressures for the ideal law, and pressures may equalise within a microsecond while
a step takes a second.

Equations.  The unknowns are y = (p1, m1), pressures and masses at the end of a step of length h.
With the mass fraction Y of a species, the specific gas constant R and the enthalpy h_up of the gas
upstream (c_p T_up for constant specific heats):

    m1 = m0 + h Σ ±Y_up ṁ       for each species                                  (1)
    U1 = U0 + h Σ ±h_up ṁ + h Q - p̄ W,      p̄ = (p0 + p1)/2                      (2)

Flows are taken at the pressures, temperatures and mass fractions of

    p_θ = p0 + θ (p1 - p0),   T = (p0 V0 + p1 V1)/Σ (m0 + m1) R,   m0 + θ (m1 - m0)  (3)

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

Cost: one dense solve of 2n equations in an iteration for n chambers of one species, which is
negligible next to the bodies.  Arrays over chambers have the shape (n,), those over the masses of
all species in all chambers (s,), s = n for one gas; units are SI.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gossamer_fx.core.algebra.dual_numbers import Dual, Number
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.gas.contract import (
    Aperture,
    Conductance,
    Gas,
    Holder,
    Opening,
    Wall,
    WallState,
)
from gossamer_fx.mechanics.gas.mixture import Blend, Contents

# Pressure [Pa], temperature [K] and gas at one end of an opening; complex for derivatives
State = tuple[Number, Number, Gas]

# An end of an opening: the number of a chamber, or a boundary of constant state.
End = int | Holder

# Complex-step derivatives have no cancellation, so the step is as small as possible; its square
# (1e-60) is negligible in double precision next to any quantity of a network.
COMPLEX_STEP = 1e-30
STEP = 1j * COMPLEX_STEP

# Scaled residual of a solution.  Round-off of the sums is some 1e-15; a factor of 100 is left for
# networks with many openings.
RESIDUAL_TOLERANCE = 1e-13

# Scaled residual that is accepted when round-off stops the iteration earlier: the coupled Newton
# iteration with the bodies reduces it further.
ACCEPTABLE_RESIDUAL = 1e-9

# Of 5700 solutions in the tests of this package 99 % took at most 4 iterations.
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

# Difference of temperatures [K] over which the slope of a conductance is measured.  It belongs to
# the user, so that complex steps may fail; Newton's method needs no more than some eight digits.
CONDUCTANCE_STEP = 1e-3

# Share of amplified or cancelled round-off in the scale of a residual: 1e-3 of it times
# RESIDUAL_TOLERANCE is the round-off 1e-16 that such a sum has.
ROUND_OFF_SHARE = 1e-3


@dataclass
class Passage:
    """An opening in a network.

    Attributes:
        opening: the item of the scene.
        ends: numbers of chambers, or boundaries.
        gases: the gases of boundaries; None at chambers.
        carried: the only gas that it carries; None: that of the end from which the flow comes.
        rows: `rows[u][e]` are, for gas that comes from the end u, the numbers of its species at the
            end e: positions among the masses of a chamber, or among all species for a boundary.
        aperture: effective area as a function of step length and time.
        area: that of the current step, C_d A [m²].
        was_open: whether a `Switch` was open in the last accepted step.
        is_open: whether it is in the current step.
        is_driven: whether gas flows also at equal pressures.
    """

    opening: Opening
    ends: tuple[End, End]
    gases: tuple[Gas | None, Gas | None]
    carried: Gas | None
    rows: list[list[list[int]]]
    aperture: Aperture
    area: Number = 0.0
    was_open: bool = True
    is_open: bool = True
    is_driven: bool = False


@dataclass
class HeatPath:
    """A wall in a network.

    Attributes:
        wall: the item of the scene.
        chamber: number of the chamber that it heats.
        state_in: temperature and conductance of the wall in a step.
        temperature: of the wall in the current step [K].
        conductance: that of the current step.
        weight: of the end of the step in the temperature of the gas, ½ to 1.
    """

    wall: Wall
    chamber: int
    state_in: WallState
    temperature: Number = 0.0
    conductance: Conductance = lambda T: 0.0
    weight: Number = 0.5

    def slope(self, T: float) -> float:
        """Derivative [W/K²] of the conductance by the temperature of the gas [K]."""
        above = self.conductance(T + CONDUCTANCE_STEP)
        below = self.conductance(T - CONDUCTANCE_STEP)
        return float(above - below) / (2 * CONDUCTANCE_STEP)


@dataclass
class Rates:
    """Mass flow [kg/s] through each opening (m,), from its end a to its end b; and sums over all
    openings and walls: mass flows [kg/s] of the species into the chambers (s,), enthalpy flow with
    heat [W] into each chamber (n,), and both from all boundaries and walls."""

    openings: list[Number]
    mass: Array
    energy: Array
    mass_supplied: Number
    energy_supplied: Number


class Balance:
    """Mass and energy balance (1), (2) of the n chambers of a network in a step.

    In the methods y (n + s,) are pressures [Pa], then masses [kg], V (n,) [m³] volumes at the end
    of the step, W (n,) [m³] the volumes that the enclosures sweep, and `magnitude` (n,) [m³] sums
    of the sizes of the summands of each volume, of which round-off is a part.  `begin` stores the
    state at the start: `_p0` [Pa], `_m0` (s,) [kg], `_U0` [J], `_pV0` [J] and `temperatures` [K];
    `h` [s] is the length of the step.
    """

    # Whether the work p̄ W is in the equations.
    depends_on_swept_volume = True

    def __init__(self, contents: Contents, passages: list[Passage], walls: list[HeatPath]) -> None:
        n = contents.n
        self.h = 0.0
        self.temperatures: Array = np.zeros(n)
        self.contents = contents
        self.passages = passages
        self.walls = walls
        self._n = n
        # ½ is the midpoint rule; `begin` replaces it.
        self._weights: Array = np.full(n, 0.5)
        self._amplification: Array = np.zeros(n)

    def begin(self, h: float, t: float, p: Array, m: Array, U: Array, V: Array) -> None:
        """Start a step: store its initial state, without a copy, and choose the weights θ of its
        flows: ½ is the middle, 1 the end.  `InputError`: the area of a valve is negative or not a
        number, or the temperature of a wall is not positive."""
        self.h = h
        self._p0 = p
        self._m0 = m
        self._U0 = U
        self._pV0 = p * V
        self.temperatures = self.contents.temperatures(self._pV0, m)
        for passage in self.passages:
            passage.area = passage.aperture(h, t) if passage.is_open else 0.0
        for path in self.walls:
            path.temperature, path.conductance = path.state_in(h)
        self._choose_weights(V)

    # ---- equations -------------------------------------------------------------------------------

    def residual(self, y: Array, V: Array, W: Array, known: Rates | None = None) -> Array:
        """Return the excess of energy [J] and mass [kg] in each chamber over its balance in a step,
        (1) and (2) of the module: it gains mass by flows, and energy by flows, heat and the work of
        its enclosure.  `known` are the rates of y and V, if they have been computed."""
        p1 = y[: self._n]
        m1 = y[self._n :]
        rates = known or self.rates(y, V)
        end_energy = self.contents.energies(p1 * V, m1)
        energy = end_energy - self._U0 - self.h * rates.energy + self.work(y, V, W)
        mass = m1 - self._m0 - self.h * rates.mass
        return np.concatenate([energy, mass])

    def work(self, y: Array, V: Array, W: Array) -> Array:
        """Work p̄ W [J] of each chamber (n,) on what encloses it, see `residual`."""
        return (self._p0 + y[: self._n]) / 2 * W

    def rates(self, y: Array, V: Array) -> Rates:
        """Return mass and energy flows into the chambers, and from boundaries and walls.  What one
        end of an opening loses the other gains in the same sum, so the network conserves mass and
        energy to round-off."""
        n = self._n
        # Lists of numbers: for so few chambers NumPy takes three times as long.
        mass: list[Number] = [0.0] * len(self._m0)
        energy: list[Number] = [0.0] * n
        mass_supplied: Number = 0.0
        energy_supplied: Number = 0.0
        openings: list[Number] = []
        states = self._flow_states(y, V)
        for passage in self.passages:
            at_ends = _at_ends(passage, states)
            upstream, fractions, mass_flow, energy_flow = _flows(passage, at_ends)
            openings.append(mass_flow.real)
            rows_at_ends = passage.rows[upstream]
            for end, sign, rows in zip(passage.ends, (-1, 1), rows_at_ends, strict=True):
                if isinstance(end, int):
                    energy[end] += sign * energy_flow.real
                    for row, fraction in zip(rows, fractions, strict=True):
                        mass[row] += sign * fraction * mass_flow.real
                else:
                    energy_supplied -= sign * energy_flow.real
                    mass_supplied -= sign * mass_flow.real
        for path in self.walls:
            heat = self._heat(path, y, V)
            energy[path.chamber] += heat
            energy_supplied += heat
        return Rates(
            openings=openings,
            mass=np.array(mass),
            energy=np.array(energy),
            mass_supplied=mass_supplied,
            energy_supplied=energy_supplied,
        )

    def scales(self, y: Array, V: Array, magnitude: Array) -> Array:
        """Energy [J] of each chamber, then for each mass that of its chamber [kg], to which the
        residual is compared, (n + s,).

        They include the round-off of two sums that the residual cannot fall below: that of the
        volume, and that of flows and heat, which long steps amplify where openings are wide or
        walls conduct well.  Nothing is lost by this, since the accepted state is summed from the
        flows.
        """
        flows = 1 + ROUND_OFF_SHARE * self._amplification
        volume = abs(V) * flows + ROUND_OFF_SHARE * magnitude
        contents = self.contents
        energy = contents.energies(abs(y[: self._n]) * volume, abs(y[self._n :]))
        mass = contents.sums(abs(y[self._n :])) * flows + contents.sums(self._m0)
        return np.concatenate([energy + self._U0, contents.per_mass(mass)])

    # ---- derivatives -----------------------------------------------------------------------------

    def derivatives(self, y: Array, V: Array, W: Array) -> tuple[Array, Array]:
        """Return the derivatives (n + s, n + s) and (n + s, n) of the residual (energies [J], then
        masses [kg]) with respect to y and to V.  That with respect to W is the mean pressure on the
        diagonal of the energy rows; the caller has it."""
        n = self._n
        p1 = y[:n]
        m1 = y[n:]
        # T1 and ∂U1/∂(p1 V)
        temperature = self.contents.temperatures(p1 * V, m1)
        heat_factor = self.contents.heat_factors(temperature, m1)
        # U1 and p̄ W in the energy rows, m1 in the mass rows.
        energy_by_pressure = V * heat_factor + W / 2
        by_y = np.diag(np.concatenate([energy_by_pressure, np.ones(len(m1))]))
        by_y[self.contents.owners, n + np.arange(len(m1))] += self.contents.energy_slopes(
            temperature, m1
        )
        by_V = np.zeros((len(y), n))
        by_V[np.arange(n), np.arange(n)] = p1 * heat_factor
        self._add_flow_derivatives(by_y, by_V, y, V)
        self._add_heat_derivatives(by_y, by_V, y, V)
        return by_y, by_V

    def _add_flow_derivatives(self, by_y: Array, by_V: Array, y: Array, V: Array) -> None:
        """Subtract step length times the derivatives of the flows from those of the residual, which
        are changed in place.  p [Pa], T [K] (n,) and the sums of masses determine the flows."""
        n = self._n
        states = self._flow_states(y, V)
        total_mass = self._m0 + y[n:]
        # Lists of numbers, as in `rates`
        end_pressure: Any = y[:n].tolist()
        mass_times_R: Any = self.contents.masses_times_R(total_mass).tolist()
        volume: Any = V.tolist()
        weight: Any = self._weights.tolist()
        for passage in self.passages:
            at_ends = _at_ends(passage, states)
            for side, k in enumerate(passage.ends):
                if not isinstance(k, int):
                    continue
                p, T, gas = at_ends[side]
                upstream, by_pressure = _slopes(passage, at_ends, side, (p + STEP, T, gas))
                # At equal pressures round-off decides from where gas comes: once for all slopes.
                _, by_temperature = _slopes(passage, at_ends, side, (p, T + STEP, gas), upstream)
                # ∂T/∂(p1 V) of (3); T falls with the mass of a species by T R times this.
                T_by_pV = 1 / mass_times_R[k]
                by_masses = [
                    [-slope * T * self.contents.gases[row].R * T_by_pV for slope in by_temperature]
                    for row in self.contents.rows[k]
                ]
                if len(by_masses) > 1:
                    self._add_blend_slopes(
                        by_masses, passage, at_ends, side, upstream, self._flow_masses(y)
                    )
                rows_at_ends = passage.rows[upstream]
                for end, sign, rows in zip(
                    passage.ends, (-self.h, self.h), rows_at_ends, strict=True
                ):
                    if not isinstance(end, int):
                        continue
                    # The first slope is that of the energy flow (row end), the others are those of
                    # the mass flows.
                    targets = [end, *[n + row for row in rows]]
                    slopes = zip(targets, by_pressure, by_temperature, strict=True)
                    for target, p_slope, T_slope in slopes:
                        by_p1 = p_slope * weight[k] + T_slope * volume[k] * T_by_pV
                        by_y[target, k] -= sign * by_p1
                        by_V[target, k] -= sign * T_slope * end_pressure[k] * T_by_pV
                    for row, by_mass in zip(self.contents.rows[k], by_masses, strict=True):
                        for target, slope in zip(targets, by_mass, strict=True):
                            by_y[target, n + row] -= sign * slope

    def _add_blend_slopes(
        self,
        by_masses: list[list[Number]],
        passage: Passage,
        at_ends: tuple[State, State],
        side: int,
        upstream: int,
        flow_masses: Array,
    ) -> None:
        """Add the derivatives of the flows at a chamber with a mixture by the masses (s,) of the
        species at the end of the step, at given pressure and temperature; `by_masses` has the
        derivatives of energy and mass flows for each species."""
        p, T, gas = at_ends[side]
        k = passage.ends[side]
        assert isinstance(k, int), "A chamber has a number."
        masses = [flow_masses[row] for row in self.contents.rows[k]]
        for position, sums in enumerate(by_masses):
            amounts: list[Number] = list(masses)
            amounts[position] += STEP
            blend = Blend(gas.species, amounts, gas.name)
            _, slopes = _slopes(passage, at_ends, side, (p, T, blend), upstream)
            for target, slope in enumerate(slopes):
                sums[target] += self._weights[k] * slope

    def _add_heat_derivatives(self, by_y: Array, by_V: Array, y: Array, V: Array) -> None:
        """Subtract step length times the derivatives of the heat of the walls, like
        `_add_flow_derivatives`.  T1 [K] is the temperature of a chamber at the end."""
        n = self._n
        mass_times_R = self.contents.masses_times_R(y[n:])
        for path in self.walls:
            k = path.chamber
            temperature = y[k] * V[k] / mass_times_R[k]
            mean = self._mean_temperature(path, temperature)
            # -∂Q/∂T at the mean temperature
            slope = path.conductance(mean) - path.slope(mean) * (path.temperature - mean)
            # -h ∂Q/∂T1 times ∂T1/∂(p1 V)
            cooling = self.h * slope * path.weight / mass_times_R[k]
            by_y[k, k] += cooling * V[k]
            by_V[k, k] += cooling * y[k]
            for row in self.contents.rows[k]:
                by_y[k, n + row] -= cooling * temperature * self.contents.gases[row].R

    # ---- solution --------------------------------------------------------------------------------

    def settle(self, y: Array, V: Array, W: Array, magnitude: Array) -> Array | None:
        """Solve the balance at given volumes by Newton's method, from a positive guess y, to a
        scaled residual of 1e-13, or 1e-9 where round-off allows no less.  None if that is not
        reached in 50 iterations or the matrix is singular."""
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
            else:
                # None decreases the residual: y is the solution to round-off, or the volumes are
                # far off, and from nearly the same y Newton's method would fail again.
                return y if size <= ACCEPTABLE_RESIDUAL**2 else None
            y = trial
        if abs(error).max() > ACCEPTABLE_RESIDUAL:
            return None
        return y

    # ---- flows -----------------------------------------------------------------------------------

    def _flow_states(self, y: Array, V: Array) -> list[State]:
        """Pressures, temperatures and gases of the chambers by (3), at which flows are taken."""
        p1 = y[: self._n]
        total_mass = self._m0 + y[self._n :]
        p = self._p0 + self._weights * (p1 - self._p0)
        T = self.contents.temperatures(self._pV0 + p1 * V, total_mass)
        return _states(p, T, self.contents.mixtures(self._flow_masses(y)))

    def _flow_masses(self, y: Array) -> Array:
        """Masses (s,) [kg] of which the gases that flow are mixtures, by (3)."""
        weights = self.contents.per_mass(self._weights)
        return self._m0 + weights * (y[self._n :] - self._m0)

    def _heat(self, path: HeatPath, y: Array, V: Array) -> Number:
        """The heat flow [W] from a wall into its chamber."""
        k = path.chamber
        end_temperature = y[k] * V[k] / self.contents.masses_times_R(y[self._n :])[k]
        temperature = self._mean_temperature(path, end_temperature)
        return path.conductance(temperature) * (path.temperature - temperature)

    def _mean_temperature(self, path: HeatPath, end: Number) -> Number:
        """The temperature [K] of the gas at which a wall exchanges heat, for that at the end."""
        return (1 - path.weight) * self.temperatures[path.chamber] + path.weight * end

    # ---- weights ---------------------------------------------------------------------------------

    def _choose_weights(self, V: Array) -> None:
        """Choose the weight θ of the end of the step in the flows of every chamber, `_weights`
        (n,), and of every wall: ½ for short steps and near 1 for steps in which pressures
        equalise, (4) and (5) of the module.

        The conductances at rest are summed too, in `_amplification` (n,) [-]: they amplify the
        round-off of pressures and temperatures, see `scales`.  V [m³] (n,) are of the start.
        """
        relaxation = np.zeros_like(self._p0)  # ζ of (4)
        equalisation = np.zeros_like(self._p0)  # z of (5)
        at_rest = np.zeros_like(self._p0)
        states = _states(self._p0, self.temperatures, self.contents.mixtures(self._m0))
        for passage in self.passages:
            at_ends = _at_ends(passage, states)
            if passage.carried is not None:
                # Its partial pressure relaxes, as fast as in a chamber without other gases.
                (p_a, T_a, _), (p_b, T_b, _) = at_ends
                at_ends = (p_a, T_a, passage.carried), (p_b, T_b, passage.carried)
            first, second = at_ends
            # Of equal pressures the hotter end counts as upstream.
            is_first = first[0] >= second[0]
            if is_first and first[0] <= second[0]:
                is_first = first[1] >= second[1]
            upstream = 0 if is_first else 1
            p_high, T_high, gas = at_ends[upstream]
            p_low = at_ends[1 - upstream][0]
            if p_high <= 0:
                # Two vacuums exchange nothing.
                continue
            # z of (5) has Δp in its denominator: it is taken at no smaller difference than this
            # one.
            almost_equal = p_high * (1 - REST_DIFFERENCE)
            moving: Number = 0.0
            resting: Number = 0.0
            # A driven flow does not fall to zero with the difference of pressures.
            if not passage.is_driven:
                moving = _conductance(passage, at_ends, upstream, min(p_low, almost_equal))
                resting = _conductance(passage, at_ends, upstream, almost_equal)
            for side, (k, sign) in enumerate(zip(passage.ends, (-1, 1), strict=True)):
                if not isinstance(k, int):
                    continue
                # Rise of the pressure in a step per mass flow, h γ R T/V of an adiabatic chamber
                stiffness = self.h * gas.heat_ratio(T_high) * gas.R * T_high / V[k]
                p, T, end_gas = at_ends[side]
                # After the slope of the energy flow follow those of the mass flows of all species.
                _, slopes = _slopes(passage, at_ends, side, (p + STEP, T, end_gas))
                relaxation[k] -= stiffness * sign * sum(slopes[1:])
                equalisation[k] += stiffness * moving
                at_rest[k] += stiffness * resting
        # A chamber whose pressure would not relax, by round-off or a law of the user, has θ_e = ½.
        fitted = np.array([_fitted_weight(rate) for rate in np.maximum(relaxation, 0.0)])
        damping = DAMPING_COEFFICIENT * equalisation**4 / (1 + equalisation**2)
        self._weights = 1 - 1 / (1 / (1 - fitted) + damping)
        self._amplification = at_rest
        if self.walls:
            heat_factors = self.contents.heat_factors(self.temperatures, self._m0)
        for path in self.walls:
            k = path.chamber
            T = self.temperatures[k]
            # m c_v = c_v/R · p V/T
            heat_capacity = heat_factors[k] * self._pV0[k] / T
            # Relaxations of the temperature in a step [-]
            rate = self.h * path.conductance(T) / heat_capacity
            path.weight = _fitted_weight(rate)
            self._amplification[k] += rate


def _states(p: Array, T: Array, gases: list[Gas]) -> list[State]:
    """Pressure [Pa], temperature [K] and gas of each chamber, as Python's or dual numbers."""
    pressures: Any = p.tolist()
    temperatures: Any = T.tolist()
    return list(zip(pressures, temperatures, gases, strict=True))


def _at_ends(passage: Passage, states: list[State]) -> tuple[State, State]:
    """The states at the two ends of an opening, for the states of all chambers."""
    first, second = passage.ends
    first_gas, second_gas = passage.gases
    return _state_at(first, first_gas, states), _state_at(second, second_gas, states)


def _state_at(end: Any, gas: Gas | None, states: list[State]) -> State:
    """The state of one end of an opening; `gas` is that of a boundary, None at a chamber."""
    if gas is None:
        return states[end]
    return end.pressure, end.temperature, gas


def _flows(
    passage: Passage, at_ends: tuple[State, State], upstream: int | None = None
) -> tuple[int, Sequence[Number], Number, Number]:
    """Return the end from which the gas comes, 0 or 1, `upstream` if that is given, its mass
    fractions, and mass flow [kg/s] and enthalpy flow [W] from the first to the second end of an
    opening; the gas has the temperature of the end it comes from, and its mixture unless the
    opening carries one gas alone."""
    (p_a, T_a, gas_a), (p_b, T_b, gas_b) = at_ends
    mass_flow = passage.opening.flow((gas_a, gas_b), passage.area, (p_a, p_b), (T_a, T_b))
    if upstream is None:
        upstream = 0 if mass_flow.real >= 0 else 1
    _, T, gas = at_ends[upstream]
    gas = passage.carried or gas
    return upstream, gas.fractions, mass_flow, gas.enthalpy(T) * mass_flow


def _slopes(
    passage: Passage,
    at_ends: tuple[State, State],
    side: int,
    changed: State,
    upstream: int | None = None,
) -> tuple[int, list[Number]]:
    """Return the end from which the gas comes, and the derivatives of the energy flow [W] and of
    the mass flow of each species [kg/s] of a passage by the quantity of one end to which a complex
    step was added, exact to round-off."""
    varied = (changed, at_ends[1]) if side == 0 else (at_ends[0], changed)
    upstream, fractions, mass_flow, energy_flow = _flows(passage, varied, upstream)
    slopes = [energy_flow.imag / COMPLEX_STEP]
    slopes += [(Y * mass_flow).imag / COMPLEX_STEP for Y in fractions]
    return upstream, slopes


def _conductance(
    passage: Passage, at_ends: tuple[State, State], upstream: int, p_low: Number
) -> Number:
    """Return the mass flow over the pressure difference [kg/(s Pa)] of an opening, from its end
    with the number `upstream` to a lower pressure [Pa] at the same temperature."""
    p_high, T_high, _ = at_ends[upstream]
    gases = (at_ends[0][2], at_ends[1][2])
    if upstream == 0:
        mass_flow = passage.opening.flow(gases, passage.area, (p_high, p_low), (T_high, T_high))
        return mass_flow.real / (p_high - p_low)
    mass_flow = passage.opening.flow(gases, passage.area, (p_low, p_high), (T_high, T_high))
    return -mass_flow.real / (p_high - p_low)


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
