"""The adjoint of the gas of a step: derivatives of a result carried from its end to its start.

Problem.  A step with gas solves, for the coordinates q1 and for y1 = (p1, m1), pressures and
masses,

    r(q1, q0, v0; p̄) = 0                   the bodies, with -p̄ G(q̄) in r, p̄ = (p0 + p1)/2    (1)
    F(p0, m0, V0; y1, V1, W, A, θ) = 0     energy and mass of `gas.balance`                      (2)

and state variables of openings, which are treated as masses are, with volumes V = V(q), swept
volumes W(q0, q1) and areas A of the openings, of which rings depend on q0 and v0.  Given are a
result's derivatives a, b, c with respect to q1, v1 and y1.

Equations.  With μ and ν the adjoint vectors of (1) and (2),

    [ ∂r/∂q1  ∂r/∂y1 ]ᵀ [μ]   [ a + 2 b/h ]
    [ ∂F/∂q1  ∂F/∂y1 ]  [ν] = [ c         ]                                                      (3)

    dJ/dp0 = -ν·∂F/∂p0 + ½ μ·G(q̄),     dJ/dm0 = -ν·∂F/∂m0                                       (4)
    dJ/dq0 -= ν·∂F/∂V0 G(q0) + ν·∂F/∂W ∂W/∂q0 + ν·∂F/∂A ∂A/∂q0                                   (5)
    dJ/dv0 -= ν·∂F/∂A ∂A/∂v0                                                                     (6)
    dJ/dx  -= ν·∂F/∂x    for a number x of an orifice, a wall, a reservoir or a rigid volume     (7)

U0 is not an unknown: the accepted state has U0 = U(p0 V0, m0), see `mixture`.

Idea.  All derivatives of F, those by the weights θ included, follow from the compiled laws of the
network (`Balance.all_derivatives`).  W is odd in the ends of the step, so that ∂W/∂q0 is -∂W/∂q1 of
the reversed step.

Algorithm.  For each step, last first:

1. `linearise` takes the derivatives of F where the step was solved.
2. The caller solves (3), see `analysis.sensitivity.backward`.
3. `take` sums up (4) and (7), and what (5) and (6) need.
4. After the ends of the step have changed places `carry` adds (5) and (6).

At the first step `finish` adds what the initial pressures and temperatures of the chambers give.

Cost: some microseconds for three chambers; the laws are compiled once more, with the derivatives of
the slopes.  Limits: there are no derivatives by the gas itself (γ, R), but by the fractions of a
mixture, and of openings by the numbers that they name as `parameters`; of an area that a function
of time gives, there is the one by a number that multiplies it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from gossamer_fx.core.checks.errors import InputError, check
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.gas.balance import Balance, Passage
from gossamer_fx.mechanics.gas.contract import (
    ChamberState,
    Discharge,
    DynamicOpening,
    Gas,
    Holder,
    Volume,
    Wall,
)
from gossamer_fx.mechanics.gas.film_area import FilmArea
from gossamer_fx.mechanics.gas.mixture import Contents
from gossamer_fx.mechanics.gas.ring import Ring
from gossamer_fx.mechanics.gas.surface import Geometry, MovingArea

# Name of the number by which the area of a valve, a function of time, is multiplied.
AREA_FACTOR = "area_factor"

# Before the name of a species: its mass fraction in the mixture of a chamber at the start.  The
# ratios of the other species are constant.
FRACTION = "fraction of "

# A parameter: the item of the scene, and the name that the item has for it.
Key = tuple[int, str]


class SolvedGas(Protocol):
    """A `network.GasNetwork`, as far as its adjoint reads it: the start of a step and its
    solution."""

    contents: Contents
    chambers: list[ChamberState]
    balance: Balance
    geometry: Geometry
    y: Array
    volumes: Array
    swept: Array
    scale: Array

    def exchange_ends(self) -> None:
        """Evaluate the geometry in the reversed step."""


class GasAdjoint:
    """Derivatives of the gas of a running scene, for gradients of runs; `units` are those of the
    parameters, by (id of the item, name), `sums` the derivatives of the result by them, so far."""

    def __init__(self, network: SolvedGas) -> None:
        self._network = network
        self._comm = network.geometry.comm
        self._n = len(network.chambers)
        balance = network.balance
        self._passages = balance.passages
        self._walls = balance.walls
        self._holders = _holders(self._passages, network)
        self.units = self._find_parameters()
        self.sums: dict[Key, float] = {}
        self.start()
        # Derivatives of the scaled F of the last step, by the name of the quantity
        self._of_balance: dict[str, Array] = {}
        # Of the last step, for `carry`: ν·∂F/∂V0 and ν·∂F/∂W (n,); areas that move with films, with
        # their gradients by q0 and the derivative of the result by each, its sign that of (5)
        self._to_volumes: Array = np.zeros(self._n)
        self._to_swept: Array = np.zeros(self._n)
        self._to_areas: list[tuple[MovingArea, Array, float]] = []
        self._h = 0.0

    def start(self) -> None:
        """Begin new sums."""
        self.sums = dict.fromkeys(self.units, 0.0)

    def _find_parameters(self) -> dict[Key, str]:
        """Unit, empty for pure numbers, of each number of the gas by which a result is derived:
        initial states, areas and discharge coefficients, walls, reservoirs; by (id of the item of
        the scene, name that the item has for it)."""
        units: dict[Key, str] = {}
        for state in self._network.chambers:
            item = id(state.chamber)
            units[item, "pressure"] = "Pa"
            units[item, "temperature"] = "K"
            units[item, _volume_name(state.chamber)] = "m³"
            gas = state.chamber.gas
            if len(gas.species) > 1:
                for one in gas.species:
                    units[item, FRACTION + one.name] = ""
        for passage in self._passages:
            opening = passage.opening
            for name, unit in opening.parameters.items():
                units[id(opening), name] = unit
            if isinstance(opening, DynamicOpening):
                for name, unit in opening.variables.items():
                    units[id(opening), name] = unit
            if isinstance(opening, Discharge):
                if name := _factor_of(opening):
                    units[id(opening), name] = ""
                if isinstance(opening.area, int | float):
                    units[id(opening), "area"] = "m²"
                elif callable(opening.area):
                    # The function belongs to its user; the number that multiplies it has a
                    # derivative.
                    units[id(opening), AREA_FACTOR] = ""
        for path in self._walls:
            name, unit = _coefficient_of(path.wall)
            units[id(path.wall), name] = unit
            units[id(path.wall), "temperature"] = "K"
        for holder in self._holders:
            units[id(holder), "pressure"] = "Pa"
            units[id(holder), "temperature"] = "K"
        return units

    def value(self, item: Any, name: str) -> float:
        """Return the present value of a parameter of an item, by its name (`names_of`), in SI
        units; 1 for the factor of a valve's area.  `KeyError`: the item has no such parameter."""
        if (id(item), name) not in self.units:
            raise KeyError(name)
        if name == AREA_FACTOR:
            return 1.0
        if name == _volume_name(item):
            return float(item.fixed_volume)
        if name.startswith(FRACTION):
            return float(_fraction(item.gas, name))
        if isinstance(item, Volume):
            name = f"initial_{name}"
        return float(getattr(item, name))

    def names_of(self, item: object) -> list[str]:
        """Names of the parameters of an item of the scene, sorted."""
        return sorted(name for owner, name in self.units if owner == id(item))

    # ---- a step ----------------------------------------------------------------------------------

    def linearise(self, h: float) -> None:
        """Take the derivatives of the mass and energy balance F at the solved step; F is divided by
        the network's scales, as the residual of a step is."""
        network = self._network
        found = network.balance.all_derivatives(network.y, network.volumes, network.swept)
        scale = network.scale[:, None]
        self._of_balance = {name: slopes / scale for name, slopes in found.items()}
        self._h = h

    def take(self, ν: Array, μ: Array) -> Array:
        """Add a step to the sums of all parameters; return derivatives of the result by the n
        pressures [Pa], s masses [kg] and r state variables at its start, (n + s + r,).  Collective.

        ν (n + s + r,) is the adjoint of the scaled gas balance, μ this rank's part of that of
        bodies.  V0, p0 and m0 are volumes [m³], pressures [Pa] and masses [kg] at the start of the
        step, V and W [m³] volumes at its end and those swept; `linearise` has computed the
        derivatives by them.
        """
        by_start = np.concatenate([-ν @ self._of_balance[name] for name in ("p0", "m0", "x0")])
        for k, state in enumerate(self._network.chambers):
            if state.enclosure is None:
                continue
            work = float(self._comm.allreduce(float(state.enclosure.at_middle @ μ)))
            by_start[k] += work / 2
            if state.chamber.outside is not None:
                # The pressure outside acts on the film, too, against that of the gas.
                self._add(state.chamber.outside, "pressure", -work)
        self._to_volumes = ν @ self._of_balance["V0"]
        self._to_swept = ν @ self._of_balance["W"]
        # A rigid volume is part of the volume at the start and at the end.
        by_rigid = -self._to_volumes - ν @ self._of_balance["V"]
        for k, state in enumerate(self._network.chambers):
            self._add(state.chamber, _volume_name(state.chamber), by_rigid[k])
        self._take_openings(ν)
        self._take_boundaries(ν)
        return by_start

    def _take_openings(self, ν: Array) -> None:
        """Add derivatives by areas [m²], discharge coefficients and other numbers of openings to
        their sums, with the adjoint ν (n + s + r,) of the scaled balance.  Those by areas of rings
        and films are stored for `carry`, which takes them to the films."""
        by_area = -ν @ self._of_balance["area"]
        by_numbers = iter(-ν @ self._of_balance["numbers"])
        for passage in self._passages:
            for name in passage.opening.parameters:
                self._add(passage.opening, name, float(next(by_numbers)))
        self._to_areas = []
        for passage, derivative in zip(self._passages, by_area, strict=True):
            opening = passage.opening
            # A valve that is closed in the step stays so, whatever its area.
            if not (isinstance(opening, Discharge) and passage.is_open):
                continue
            coefficient = 1.0
            if name := _factor_of(opening):
                coefficient = getattr(opening, name)
                self._add(opening, name, derivative * passage.area / coefficient)
            if isinstance(opening.area, Ring | FilmArea):
                area = self._network.geometry.area(opening.area)
                gradient = area.aperture_gradient(self._h)
                self._to_areas.append((area, gradient, coefficient * derivative))
            elif callable(opening.area):
                self._add(opening, AREA_FACTOR, derivative * passage.area)
            else:
                self._add(opening, "area", coefficient * derivative)

    def _take_boundaries(self, ν: Array) -> None:
        """Add derivatives by conductances [W/K] or coefficients [W/(m² K)], temperatures [K] and
        pressures [Pa] of walls, reservoirs and surroundings to their sums, with the adjoint ν
        (n + s + r,) of the scaled balance.  Those by areas of films are stored for `carry`."""
        by_walls = (-ν @ self._of_balance["wall"]).reshape(-1, 2)
        by_temperature, by_conductance = by_walls.T
        for j, path in enumerate(self._walls):
            wall = path.wall
            name, _ = _coefficient_of(wall)
            area = wall.film_area
            size = 1.0
            if area is not None:
                moving = self._network.geometry.area(area)
                size = moving.aperture(self._h)
                gradient = moving.aperture_gradient(self._h)
                self._to_areas.append((moving, gradient, getattr(wall, name) * by_conductance[j]))
            self._add(wall, name, size * by_conductance[j])
            self._add(wall, "temperature", by_temperature[j])
        by_boundaries = (-ν @ self._of_balance["boundary"]).reshape(-1, 2)
        boundaries = self._network.balance.boundaries
        for holder, slopes in zip(boundaries, by_boundaries, strict=True):
            self._add(holder, "pressure", slopes[0])
            self._add(holder, "temperature", slopes[1])

    def _add(self, item: object, name: str, derivative: float) -> None:
        """Add a derivative of the result to the sum of a parameter."""
        self.sums[id(item), name] += float(derivative)

    def carry(self, by_position: Array, by_velocity: Array) -> None:
        """Add (5) and (6), of volumes and areas at the start of the step that `take` had last, to
        this rank's derivatives of the result by coordinates [m] and velocities [m/s].  The ends of
        the system's step have changed places before: its end is the start meant here.  Collective.
        """
        self._network.exchange_ends()
        for k, state in enumerate(self._network.chambers):
            if state.enclosure is None:
                continue
            by_position -= self._to_volumes[k] * state.enclosure.of_volume
            by_position += self._to_swept[k] * state.enclosure.of_swept
        for area, gradient, factor in self._to_areas:
            area.add_own(by_position, factor * gradient)
            area.add_own(by_velocity, self._h / 2 * factor * gradient)

    def add_energy_derivative(self, share: float) -> None:
        """Add the derivative of the internal energy U of the chambers in the present state, times a
        weight `share`, by their rigid volumes V at given pressures: ∂U/∂V = p ∂U/∂(pV)."""
        for state in self._network.chambers:
            per_volume = state.pressure * state.heat_factor
            self._add(state.chamber, _volume_name(state.chamber), share * per_volume)

    def finish(self, by_start: Array, by_position: Array) -> None:
        """Add what the initial state gives: the initial masses Y p0 V0/(R T0) of a chamber are
        functions of its pressure, temperature, volume and mixture.  Collective.

        `by_start` (n + s + r,) are derivatives by the pressures [Pa], masses [kg] and state
        variables at the start of the run; to this rank's part of those by coordinates [m] that of
        the volumes is added in place.
        """
        network = self._network
        for k, state in enumerate(network.chambers):
            by_pressure = by_start[k]
            by_masses = by_start[self._n :][network.contents.rows[k]]
            chamber = state.chamber
            # All masses are proportional to p0 V0/T0.
            by_amount = float(by_masses @ state.masses)
            self._add(chamber, "pressure", by_pressure + by_amount / state.pressure)
            self._add(chamber, "temperature", -by_amount / state.temperature)
            self._add(chamber, _volume_name(chamber), by_amount / state.volume)
            self._add_fractions(state, by_masses)
            if state.enclosure is not None:
                by_position += by_amount / state.volume * state.enclosure.of_volume
        by_variables = iter(by_start[self._n + len(network.contents.gases) :])
        for passage in self._passages:
            if isinstance(passage.opening, DynamicOpening):
                for name in passage.opening.variables:
                    self._add(passage.opening, name, float(next(by_variables)))

    def _add_fractions(self, state: ChamberState, by_masses: Array) -> None:
        """Add the derivatives by the mass fractions of a mixture at given pressure, volume and
        temperature, where the masses are Y p V/(R T), R = Σ Y R_s."""
        gas = state.chamber.gas
        for one in gas.species if len(gas.species) > 1 else ():
            share = _fraction(gas, FRACTION + one.name)
            # dY of all species and dR by dY of this one
            change = {
                other: -part / (1 - share)
                for other, part in zip(gas.species, gas.fractions, strict=True)
            }
            change[one] = 1.0
            R_change = sum(rate * other.R for other, rate in change.items())
            fraction_changes = np.array([change.get(held, 0.0) for held in state.species])
            mass_changes = fraction_changes * state.mass - state.masses * R_change / gas.R
            derivative = by_masses @ mass_changes
            self._add(state.chamber, FRACTION + one.name, derivative)


def _factor_of(opening: Discharge) -> str:
    """Name of the number by which the area of an opening is multiplied; empty if it has none."""
    name = opening.coefficient
    # A table has no derivative.
    if name and isinstance(getattr(opening, name), int | float):
        return name
    return ""


def _coefficient_of(wall: Wall) -> tuple[str, str]:
    """Name and unit of the number to which the conductance of a wall is proportional.
    `InputError`: it has none, or its temperature is a function, whose derivatives are not known."""
    check(
        not callable(wall.temperature),
        f"'{wall.name}' has no gradient: its temperature is a function; give a number.",
    )
    name, unit = wall.proportional_to
    if name and isinstance(getattr(wall, name), int | float):
        return name, unit
    raise InputError(
        f"'{wall.name}' has no gradient: its heat transfer coefficient is a function; "
        "give a number."
    )


def _holders(passages: Sequence[Passage], network: SolvedGas) -> list[Holder]:
    """Return reservoirs and surroundings of a network, each once, in the order of the scene."""
    found: dict[int, Holder] = {}
    for passage in passages:
        for end in passage.ends:
            if not isinstance(end, int):
                found[id(end)] = end
    for state in network.chambers:
        if state.chamber.outside is not None:
            found[id(state.chamber.outside)] = state.chamber.outside
    return list(found.values())


def _fraction(gas: Gas, name: str) -> float:
    """The mass fraction of a species of a gas, by the name of the parameter."""
    shares = zip(gas.species, gas.fractions, strict=True)
    return float(sum(share for one, share in shares if FRACTION + one.name == name))


def _volume_name(item: object) -> str:
    """Name of the parameter that is the rigid volume of a chamber; empty for other items."""
    if not isinstance(item, Volume):
        return ""
    return "volume" if item.enclosure is None else "dead_volume"
