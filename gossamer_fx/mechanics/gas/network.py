"""The gas of a scene: all chambers and openings as scalar unknowns that are coupled to the bodies.

Problem.  Chambers exchange gas through openings and work with films and pistons.  Energy has to
close to round-off: what the gas loses in a step the bodies must gain, whatever the step length.

Unknowns.  y = (p1, m1, x1), pressures [Pa] of the n chambers, the s masses [kg] of the species that
they hold or can receive, s = n for one gas, and the r state variables of openings, r = 0 without a
`DynamicOpening`, at the end of a step.  They solve the mass and energy
balance of `gas.balance`, in which p̄ = (p0 + p1)/2 does the work p̄ W.  The same p̄ acts on the
film in the midpoint rule, so this work is what the bodies receive, to the last digit.

Algorithm.  In each Newton iteration of the bodies:

1. Evaluate volumes V and swept volumes W of all enclosures (`Geometry.follow`).
2. Solve the balance for y at these volumes (`Balance.settle`).  Newton's method for bodies and gas
   at once does not converge without this: ṁ grows as √Δp outside the laminar range of an orifice,
   and the iteration ends in a cycle of two.
3. Set the pressures on the enclosures; take force, coupling and residual there.

`ScalarUnknowns` describes the linear system that the solver forms from them:

    [ A  G ] [δz]     [ r ]
    [ Hᵀ C ] [δy] = - [ s ]

G = -α ∂V/∂q are the forces of a unit pressure, Hᵀ = ∂s/∂z follows by the chain rule through V and
W, and C = ∂s/∂y.  After the step the state is summed from the flows, see `commit`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from petsc4py import PETSc

from gossamer_fx.core.checks.errors import InputError, check
from gossamer_fx.core.checks.lookups import check_in_scene
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.gas.balance import (
    ACCEPTABLE_RESIDUAL,
    ADIABATIC,
    HELD_PRESSURE,
    MIN_REMAINING_SHARE,
    Balance,
    End,
    HeatPath,
    Passage,
)
from gossamer_fx.mechanics.gas.contract import (
    ChamberState,
    DynamicOpening,
    Gas,
    Holder,
    Opening,
    Switch,
    Volume,
    Wall,
)
from gossamer_fx.mechanics.gas.mixture import Contents
from gossamer_fx.mechanics.gas.surface import Geometry
from gossamer_fx.mechanics.terms.assembly import Assembly
from gossamer_fx.mechanics.terms.scalar_unknowns import ScalarTotals, ScalarUnknowns

if TYPE_CHECKING:
    from gossamer_fx.mechanics.gas.adjoint import GasAdjoint


class GasNetwork(ScalarUnknowns):
    """All chambers and openings of a scene: scalar unknowns y = (p1, m1, x1).

    Attributes:
        size: number of unknowns, n + s + r for n chambers with s masses of species, and r state
            variables of openings.
        chambers: states of the chambers after the last accepted step.
        balance: their equations in a step.
        geometry: volumes and rings of the running scene.
        y: pressures [Pa] and masses [kg] of the last iterate (n + s + r,).
        volumes, swept: V and W of the last iterate (n,) [m³].
        scale: energies [J] and masses [kg] by which the residual is divided (n + s + r,).

    Raises:
        InputError: the scene has no chamber, two of them enclose the same film, two gases have the
            same name, or a boundary supplies gas of a scene with several and names none.
    """

    def __init__(self, items: list[Any], system: Assembly) -> None:
        """Compile what bounds the chambers, and connect them by openings and walls; collective."""
        chambers = [item for item in items if isinstance(item, Volume)]
        _check_chambers(chambers)
        openings = [item for item in items if isinstance(item, Opening)]
        self.contents = Contents(chambers, openings)
        # Weight of the end of a step in the positions where forces act: ½, or 1 at its end.
        self._alpha = system.rule.alpha
        self.geometry = Geometry(system)
        self.chambers = [
            ChamberState(
                chamber=chamber,
                enclosure=None
                if chamber.enclosure is None
                else chamber.enclosure.compile(system, self.geometry),
                species=tuple(self.contents.gases[row] for row in rows),
                masses=np.zeros(len(rows)),
            )
            for chamber, rows in zip(chambers, self.contents.rows, strict=True)
        ]
        # What bounds the chambers that are not rigid, by the number of the chamber
        self._enclosures = {
            k: state.enclosure
            for k, state in enumerate(self.chambers)
            if state.enclosure is not None
        }
        n = len(chambers)
        # Two chambers may have equal values; they are told apart by identity.
        numbers = {id(chamber): k for k, chamber in enumerate(chambers)}
        self._passages = _passages(openings, numbers, self.geometry, self.contents)
        # Openings that open and close by pressures
        self._switches = [
            (passage, passage.opening)
            for passage in self._passages
            if isinstance(passage.opening, Switch)
        ]
        self._walls = [
            HeatPath(item, numbers[id(item.chamber)], item.compile(self.geometry))
            for item in items
            if isinstance(item, Wall)
        ]
        self.geometry.compile()
        self._process = ADIABATIC
        self.balance = Balance(self.contents, self._passages, self._walls, system.comm)
        # State variables of openings after the last accepted step, one opening after the other
        self.x: Array = np.array(
            [number for flow in self.balance.flow_laws for number in flow.start_values]
        )
        # What is positive: pressures and masses
        self._positive = slice(0, n + len(self.contents.gases))
        self.size = self._positive.stop + len(self.x)
        # Of the last iterate: volumes, sizes of the terms that add up to them, and swept volumes
        # [m³]
        self.volumes: Array = np.zeros(n)
        self._magnitude: Array = np.zeros(n)
        self.swept: Array = np.zeros(n)
        # y that solves the balance, and y that Newton's method for the bodies proposed
        self.y: Array = np.ones(self.size)
        self._proposed: Array = self.y
        self._residual: Array = np.zeros(self.size)
        self.scale: Array = np.ones(self.size)
        self._accepted_magnitude: Array = np.zeros(n)
        # Of the step: pressures at its start, and on the outer side of enclosures [Pa]
        self._start_pressures: Array = np.zeros(n)
        self._outside_pressures: Array = np.zeros(n)
        # Energy [J] and mass [kg] from boundaries and walls since the start
        self._supplied = 0.0
        self._mass_supplied = 0.0
        # Mass flows [kg/s] through the openings in the last accepted step
        self._flows = [0.0] * len(self._passages)

    def set_static_process(self, process: str) -> None:
        """Choose by its name what stays constant in the chambers while an equilibrium is looked
        for.  `InputError`: the specific heats of a gas change in an adiabatic search."""
        if process == ADIABATIC:
            for gas in self.contents.species:
                check(
                    gas.constant_heat_ratio is not None,
                    f"Gas '{gas.name}': an adiabatic equilibrium needs constant specific heats; "
                    "give an IdealGas, or gas='isothermal' or 'held pressure'.",
                )
        self._process = process
        comm = self.geometry.comm
        self.balance = Balance(self.contents, self._passages, self._walls, comm, process)

    @property
    def is_closed(self) -> bool:
        """Whether the scene has no openings, so that at rest the gas is a function of its
        volumes."""
        return not self._passages

    def vibration_stiffness(self) -> list[tuple[Array, float]]:
        """Gradients of volumes g [m²] and stiffnesses κ = γ p/V [Pa/m³] of the closed films.

        In a fast vibration no gas flows and no heat is exchanged, so that the pressure changes by
        -κ ΔV and the forces by the stiffness κ g⊗g.  Gradients are this rank's part; collective.
        """
        return self._stiffness(ADIABATIC)

    def static_stiffness(self) -> list[tuple[Array, float]]:
        """Gradients of volumes g [m²] and stiffnesses κ [Pa/m³] of the closed films for slow
        changes by the process of an equilibrium: κ = γ p/V if it is adiabatic, p/V if isothermal,
        an empty list at held pressure.  Collective."""
        return self._stiffness(self._process)

    def _stiffness(self, process: str) -> list[tuple[Array, float]]:
        """Stiffness of the gas in each film or piston against volume changes, p V^exponent =
        const., at the last iterate, as all other parts of a tangent: this rank's part of the
        gradient of its volume [m²], and κ = exponent p/V [Pa/m³]; empty at held pressure.
        Collective."""
        if process == HELD_PRESSURE:
            return []
        found = []
        for k, enclosure in self._enclosures.items():
            exponent = 1.0
            if process == ADIABATIC:
                # γ of the mixture
                exponent += 1 / self.chambers[k].heat_factor
            stiffness = exponent * float(self.y[k] / self.volumes[k])
            found.append((enclosure.of_volume.copy(), stiffness))
        return found

    # ---- scalar unknowns: a step -----------------------------------------------------------------

    def start(self) -> None:
        """Take the initial volumes [m³], and from them mass [kg] and energy [J] of each chamber.
        Collective.  `InputError`: a chamber encloses no volume, or a negative one."""
        self.geometry.follow()
        for enclosure in self._enclosures.values():
            enclosure.start()
        # Again, as normals may have been turned.
        self.geometry.follow()
        self.geometry.accept()
        volumes, self._accepted_magnitude, _ = self._measure()
        for state, volume in zip(self.chambers, volumes, strict=True):
            state.volume = float(volume)
            check(
                state.volume > 0,
                f"Chamber '{state.chamber.name}' encloses {state.volume:.3g} m³ at the start; "
                "open it by an initial displacement or give it a dead_volume.",
            )
            state.pressure = state.chamber.initial_pressure
            gas = state.chamber.gas
            pV = state.pressure * state.volume
            mass = pV / (gas.R * state.chamber.initial_temperature)
            for one, fraction in zip(gas.species, gas.fractions, strict=True):
                state.masses[state.species.index(one)] = fraction * mass
        masses = self._masses()
        products = np.array([state.pressure * state.volume for state in self.chambers])
        energies = self.contents.energies(products, masses)
        for state, energy in zip(self.chambers, energies, strict=True):
            state.internal_energy = float(energy)

    def begin_step(self, h: float, t: float) -> Array:
        """Start a step of the gas, and guess its unknowns y at the end: the solution if no film
        moves."""
        pressures = np.array([state.pressure for state in self.chambers])
        masses = self._masses()
        energies = np.array([state.internal_energy for state in self.chambers])
        volumes = np.array([state.volume for state in self.chambers])
        self._start_pressures = pressures
        self._outside_pressures = np.array([_outside_pressure(state) for state in self.chambers])
        for passage, valve in self._switches:
            first, second = passage.ends
            acting = (self._pressure_at(first), self._pressure_at(second))
            passage.is_open = valve.is_open(passage.was_open, acting)
        self.balance.begin(h, t, p=pressures, m=masses, U=energies, V=volumes, x=self.x)
        # The volumes of the last iterate are not used: they may be those of a step that failed.
        self.volumes = volumes
        self.swept = np.zeros(len(volumes))
        self._magnitude = self._accepted_magnitude
        guess = np.concatenate([pressures, masses, self.x])
        settled = self.balance.settle(guess, self.volumes, self.swept, self._magnitude)
        self.y = guess if settled is None else settled
        self._proposed = self.y
        return self.y

    def residual(self, y: Array) -> Array:
        """Return the scaled residual (n + s + r,) of the gas balance at the iterate, after it was
        solved at its volumes and the pressures were set on the enclosures.  Collective."""
        self.geometry.follow()
        self.volumes, self._magnitude, self.swept = self._measure()
        self.y = self._solve_at_iterate(y)
        self._proposed = y
        self.scale = self.balance.scales(self.y, self.volumes, self._magnitude)
        self._residual = self.balance.residual(self.y, self.volumes, self.swept) / self.scale
        # The pressure that acts in the step: p̄ for the midpoint rule, p1 at the end of the step.
        end_pressures = self.y[: self._start_pressures.size]
        acting = (1 - self._alpha) * self._start_pressures + self._alpha * end_pressures
        difference = acting - self._outside_pressures
        for k, enclosure in self._enclosures.items():
            enclosure.pressure[0] = difference[k]
        return self._residual

    def _solve_at_iterate(self, y: Array) -> Array:
        """Return the solution y of the gas balance at the volumes of the iterate, or the proposed y
        itself if it or the volumes are not finite, a volume is not positive, or no solution is
        found."""
        # A sum is finite only if all of its terms are; a volume that is NaN is not positive.
        total = y @ y + self.volumes @ self.volumes + self.swept @ self.swept
        if not (math.isfinite(total) and self.volumes.min() > 0):
            return y
        # Newton's update of y belongs to the y that was proposed; it is applied to the y that was
        # used.
        update = y - self._proposed
        guess = self.y + update
        of_gas = self._positive
        guess[of_gas] = np.maximum(guess[of_gas], MIN_REMAINING_SHARE * abs(self.y[of_gas]))
        settled = self.balance.settle(guess, self.volumes, self.swept, self._magnitude)
        return y if settled is None else settled

    def add_force(self, values: Array) -> None:
        """Subtract the forces of all chambers [N] from the owned part of a residual."""
        self.geometry.add_forces(values)

    def add_tangents(self, A: PETSc.Mat) -> None:
        self.geometry.add_tangents(A)

    def force_square(self) -> float:
        """Of the pressures inside: those outside are nearly as large where a chamber is in air."""
        square = 0.0
        for k, enclosure in self._enclosures.items():
            force = self.y[k] * enclosure.at_middle
            square += float(force @ force)
        return square

    def coupling(self) -> tuple[list[Array | None], list[Array | None], Array]:
        """Return the blocks of the Newton matrix by which the gas is coupled to the bodies: G are
        the forces [N] of a unit of the unknowns y, H the derivatives of the scaled gas balance by
        coordinates, C those by y.  Collective."""
        G: list[Array | None] = [None] * self.size
        H: list[Array | None] = [None] * self.size
        by_y, by_V = self.balance.derivatives(self.y, self.volumes, self.swept)
        C = by_y / self.scale[:, None]
        if not self._enclosures:
            return G, H, C
        enclosed = list(self._enclosures)
        enclosures = self._enclosures.values()
        of_volume = [enclosure.of_volume for enclosure in enclosures]
        of_swept = [enclosure.of_swept for enclosure in enclosures]
        # By the volumes V, then by the swept volumes W
        by_volumes = np.zeros((self.size, 2, len(enclosed)))
        by_volumes[:, 0] = by_V[:, enclosed]
        for i, k in enumerate(enclosed):
            # The pressure that acts has the weight α of the pressure at the end of the step.
            G[k] = -self._alpha * self._enclosures[k].at_middle
            if self.balance.depends_on_swept_volume:
                # ∂/∂W of p̄ W in the energy balance
                by_volumes[k, 1, i] = (self.chambers[k].pressure + self.y[k]) / 2
        slopes = by_volumes.reshape(self.size, -1) / self.scale[:, None]
        rows = slopes @ np.array(of_volume + of_swept)
        # Zero columns are left out: the solver spends one solve on each of the others.
        is_coupled: Any = slopes.any(axis=1)
        for k in is_coupled.nonzero()[0]:
            H[k] = rows[k]
        return G, H, C

    def commit(self) -> None:
        """Accept the step.  Mass and energy, also those supplied, are summed from the flows, not
        taken from y: so they are conserved to round-off whatever the tolerance to which y is
        solved.  Collective."""
        rates = self.balance.rates(self.y, self.volumes)
        h = self.balance.h
        volumes, _, swept = self._measure()
        works = self.balance.work(self.y, volumes, swept)
        masses = self._masses() + h * rates.mass
        self.x = self.y[self._positive.stop :].copy()
        start_volumes = np.array([state.volume for state in self.chambers])
        for k, state in enumerate(self.chambers):
            if state.enclosure is not None:
                # The surroundings receive the work of the swept volume at their pressure.
                self._supplied -= _outside_pressure(state) * float(state.enclosure.measures[2])
            state.volume = float(volumes[k])
            state.masses = masses[self.contents.rows[k]]
            state.internal_energy += h * float(rates.energy[k]) - float(works[k])
        if self._process != ADIABATIC:
            self._supply_at_rest(volumes / start_volumes)
        energies = np.array([state.internal_energy for state in self.chambers])
        pressures = self.contents.pressures(
            energies, self._masses(), volumes, self.balance.temperatures
        )
        for state, pressure in zip(self.chambers, pressures, strict=True):
            state.pressure = float(pressure)
        self.geometry.accept()
        self._accepted_magnitude = self._magnitude
        self._supplied += h * float(rates.energy_supplied)
        self._mass_supplied += h * float(rates.mass_supplied)
        self._flows = [float(flow) for flow in rates.openings]
        for passage, _ in self._switches:
            passage.was_open = passage.is_open

    def _supply_at_rest(self, expansion: Array) -> None:
        """Count the gas that holds the pressures of the chambers, and the heat that holds their
        temperatures, as supplied; `expansion` (n,) are the volumes over those before the step."""
        masses = self._masses()
        if self._process == HELD_PRESSURE:
            held = masses * self.contents.per_mass(expansion)
            self._mass_supplied += float((held - masses).sum())
            for state, rows in zip(self.chambers, self.contents.rows, strict=True):
                state.masses = held[rows]
            masses = held
        energies = self.contents.thermal_energies(self.balance.temperatures, masses)
        for state, energy in zip(self.chambers, energies, strict=True):
            self._supplied += float(energy) - state.internal_energy
            state.internal_energy = float(energy)

    def _pressure_at(self, end: End) -> float:
        """Pressure [Pa] at one end of an opening after the last accepted step."""
        if isinstance(end, int):
            return self.chambers[end].pressure
        return end.pressure

    def switch(self, opening: Switch) -> Passage:
        """The passage of a valve, whose `was_open` may be set between steps.  `InputError`: the
        valve is not in the scene."""
        found = [passage for passage, valve in self._switches if valve is opening]
        check_in_scene(f"'{opening.name}'", bool(found))
        return found[0]

    def variables(self, opening: DynamicOpening) -> dict[str, float]:
        """The state variables of an opening after the last accepted step, by their names."""
        first = 0
        for passage, flow in zip(self._passages, self.balance.flow_laws, strict=True):
            last = first + len(flow.variables)
            if passage.opening is opening:
                values = [float(value) for value in self.x[first:last]]
                return dict(zip(flow.variable_names, values, strict=True))
            first = last
        raise InputError(f"'{opening.name}' is not in the scene; add it.")

    def _masses(self) -> Array:
        """Masses [kg] of the species in all chambers (s,) after the last accepted step."""
        return np.concatenate([state.masses for state in self.chambers])

    # ---- scalar unknowns: gradients --------------------------------------------------------------

    def adjoint(self) -> GasAdjoint:
        # Imported here: runs without gradients do not load it.
        from gossamer_fx.mechanics.gas.adjoint import GasAdjoint

        return GasAdjoint(self)

    def repeats(self, history: dict[str, Any]) -> bool:
        is_open = [passage.is_open for passage, _ in self._switches]
        return bool(is_open == history["open"])

    def exchange_ends(self) -> None:
        """Evaluate the geometry in the reversed step, which starts at the end of the present one.
        Collective."""
        self.geometry.accept()
        self.geometry.follow()

    # ---- scalar unknowns: checks -----------------------------------------------------------------

    def inadmissible(self) -> str:
        """Report in one clause which chamber has a volume or pressure that is not positive at the
        last iterate; empty if none has, or they are NaN."""
        for state, volume, pressure in zip(self.chambers, self.volumes, self.y, strict=False):
            if volume <= 0 or pressure <= 0:
                return (
                    f"'{state.chamber.name}' would have a volume of {volume:.3g} m³ and a pressure "
                    f"of {pressure:.3g} Pa"
                )
        return ""

    def unsolved(self) -> str:
        """Report in one clause which chamber's balance has the largest residual, with its volume
        [m³] and pressure [Pa] at the last iterate; empty if all are at most `ACCEPTABLE_RESIDUAL`.
        NaN counts as infinite."""
        n = len(self.chambers)
        error = np.abs(self._residual)
        # argmax would pass over a NaN in favour of a number
        error[~np.isfinite(error)] = np.inf
        largest = error[:n]
        np.maximum.at(largest, self.contents.owners, error[n : self._positive.stop])
        k = int(np.argmax(largest))
        if largest[k] <= ACCEPTABLE_RESIDUAL:
            return self._unsolved_variable(error[self._positive.stop :])
        return (
            f"the gas of '{self.chambers[k].chamber.name}' is not in balance (volume "
            f"{self.volumes[k]:.3g} m³, pressure {self.y[k]:.3g} Pa)"
        )

    def _unsolved_variable(self, error: Array) -> str:
        """`unsolved` of the state variables of openings, with their errors (r,)."""
        if error.max(initial=0.0) <= ACCEPTABLE_RESIDUAL:
            return ""
        worst = int(np.argmax(error))
        owners = [
            (passage.opening.name, name)
            for passage, flow in zip(self._passages, self.balance.flow_laws, strict=True)
            for name in flow.variable_names
        ]
        opening, name = owners[worst]
        value = self.y[self._positive.stop + worst]
        return f"'{name}' of '{opening}' does not follow its rate (it would be {value:.3g})"

    # ---- scalar unknowns: energies and state -----------------------------------------------------

    def totals(self) -> ScalarTotals:
        """Internal energy of each chamber, mass, and what boundaries and walls supplied."""
        return ScalarTotals(
            stored={state.chamber.name: state.internal_energy for state in self.chambers},
            supplied=self._supplied,
            mass=sum(state.mass for state in self.chambers),
            mass_supplied=self._mass_supplied,
        )

    def states(self) -> dict[str, ChamberState]:
        return {state.chamber.name: state for state in self.chambers}

    def flows(self) -> dict[str, float]:
        names = [passage.opening.name for passage in self._passages]
        return dict(zip(names, self._flows, strict=True))

    def get_history(self) -> dict[str, Any]:
        """Of each chamber name, pressure [Pa], masses [kg], energy [J] and volume [m³]; what was
        supplied since the start; flows [kg/s] of the last step; which valves were open; state
        variables of openings."""
        chambers = [
            [
                state.chamber.name,
                state.pressure,
                state.masses.tolist(),
                state.internal_energy,
                state.volume,
            ]
            for state in self.chambers
        ]
        return {
            "chambers": chambers,
            "supplied": self._supplied,
            "mass supplied": self._mass_supplied,
            "flows": self._flows,
            "open": [passage.was_open for passage, _ in self._switches],
            "state variables": self.x.tolist(),
        }

    def set_history(self, state: dict[str, Any]) -> None:
        self.geometry.follow()
        self.geometry.accept()
        for chamber, row in zip(self.chambers, state["chambers"], strict=True):
            # The name is for readers of the file; the order of chambers does not change.
            _, chamber.pressure, masses, chamber.internal_energy, chamber.volume = row
            chamber.masses = np.array(masses, dtype=float)
        _, self._accepted_magnitude, _ = self._measure()
        self._supplied = state["supplied"]
        self._mass_supplied = state["mass supplied"]
        self._flows = state["flows"]
        for (passage, _), was_open in zip(self._switches, state["open"], strict=True):
            passage.was_open = was_open
        self.x = np.array(state["state variables"], dtype=float)

    # ---- chambers --------------------------------------------------------------------------------

    def _measure(self) -> Array:
        """Volumes at the iterate, rigid parts included, sums of the sizes of the terms of those of
        enclosures, and volumes that the enclosures sweep in the step, (3, n) [m³]."""
        measured = np.zeros((3, self.volumes.size))
        measured[0] = [state.chamber.fixed_volume for state in self.chambers]
        for k, enclosure in self._enclosures.items():
            measured[:, k] += enclosure.measures
        return measured


def _check_chambers(chambers: list[Volume]) -> None:
    """Raise `InputError` unless there are chambers, and no two enclose the same whole film."""
    check(
        bool(chambers),
        "The scene has gas but no chamber or tank; add one, or remove reservoirs and orifices.",
    )
    whole_films: list[object] = []
    for chamber in chambers:
        if chamber.enclosure is None:
            continue
        for film in chamber.enclosure.whole_films:
            check(
                film not in whole_films,
                f"Two chambers enclose the whole of '{film.name}'; "
                "give each its surface, or leave one out.",
            )
            whole_films.append(film)


def _passages(
    openings: list[Opening], numbers: dict[int, int], geometry: Geometry, contents: Contents
) -> list[Passage]:
    """Return the openings of a scene, with their ends as numbers of chambers or as boundaries."""

    def end(item: Holder | Volume) -> End:
        return item if isinstance(item, Holder) else numbers[id(item)]

    found = []
    for opening in openings:
        ends = (end(opening.a), end(opening.b))
        gases = (
            _boundary_gas(opening.a, opening.b, contents),
            _boundary_gas(opening.b, opening.a, contents),
        )
        passage = Passage(
            opening=opening,
            ends=ends,
            gases=gases,
            carried=opening.carried_gas,
            aperture=opening.aperture(geometry),
            is_driven=opening.is_driven,
        )
        if isinstance(opening, Switch):
            passage.was_open = opening.starts_open
        found.append(passage)
    return found


def _boundary_gas(end: Holder | Volume, other: Holder | Volume, contents: Contents) -> Gas | None:
    """The gas of a boundary at one end of an opening; None for a chamber, whose mixture changes."""
    if not isinstance(end, Holder):
        return None
    if end.gas is not None:
        return end.gas
    check(
        len(contents.species) == 1 or end.pressure <= 0,
        f"'{end.name}' supplies one of several gases; give its gas.",
    )
    # No gas comes from a vacuum; a law may still ask for one.
    return other.gas or contents.species[0]


def _outside_pressure(state: ChamberState) -> float:
    """Pressure [Pa] on the outer side of a chamber's enclosure; 0 for a vacuum."""
    if state.chamber.outside is None:
        return 0.0
    return float(state.chamber.outside.pressure)
