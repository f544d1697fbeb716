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

State variables x of openings (`contract.DynamicOpening`) are further unknowns: y = (p1, m1, x1).

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
5. `all_derivatives` gives those with respect to the start of the step, areas, boundaries and walls,
   with those of θ, for gradients of runs (`gas.adjoint`).

All of this is C (kernels/network.c), for every network.  Flows, heats and properties of gases are
laws (`gas.laws`), which it calls by their addresses; the network itself is data.

Gas at rest.  A closed chamber at rest is a function of its volume V, whatever the way to it.  The
work p̄ W of a time step is not: its sum over pseudo-steps depends on their number.  While an
equilibrium is looked for, the energy balance is replaced by one of

    adiabatic        U1 = U0 (V0/V)^(γ - 1) + flows,    so that p V^γ = const if closed         (6)
    isothermal       p1 V = m1 R T0                                                             (7)
    held pressure    p1 = p0,   m1 = p0 V/(R T0)                                                (8)

with the pressure p0, volume V0, energy U0 and temperature T0 at the start of a pseudo-step; for
mixtures γ is that of the start.  Steps of (6) compose exactly.  Heat of (7) and gas of (8) count as
supplied.  An adiabatic chamber cools while its film unfolds: a bag that takes ten times its first
volume ends at 0.4 of its first temperature.  At rest a film has the temperature of its
surroundings, or its pressure is held by a blower: (7) and (8).  Where gas flows through an opening
during the search, (6) depends on the pseudo-steps.

Cost: one dense solve of 2n equations in an iteration for n chambers of one species, which is
negligible next to the bodies.  Arrays over chambers have the shape (n,), those over the masses of
all species in all chambers (s,), s = n for one gas; units are SI.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.forms.c_source import c_library, check_indices
from gossamer_fx.core.laws.law import Law, compile_law
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.gas import laws
from gossamer_fx.mechanics.gas.contract import (
    Aperture,
    CompiledWall,
    Gas,
    Holder,
    Opening,
    Wall,
)
from gossamer_fx.mechanics.gas.mixture import Contents

HEADER = Path(__file__).parent / "kernels" / "network.h"

# An end of an opening: the number of a chamber, or a boundary of constant state.
End = int | Holder

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

# Relative pressure difference at which the conductance of an opening at rest is measured: inside
# the laminar range of `Orifice`, where the law is linear, and far above round-off.
REST_DIFFERENCE = 1e-9

# Share of amplified or cancelled round-off in the scale of a residual: 1e-3 of it times
# RESIDUAL_TOLERANCE is the round-off 1e-16 that such a sum has.
ROUND_OFF_SHARE = 1e-3

# Share of the volume at the start below which (6) is continued as a constant: Newton's iterates may
# have volumes that are zero or negative.
SMALLEST_VOLUME = 1e-6

# What stays constant in the chambers of an equilibrium, and their numbers in C
IN_TIME = "in time"
ADIABATIC = "adiabatic"
ISOTHERMAL = "isothermal"
HELD_PRESSURE = "held pressure"
PROCESSES = (IN_TIME, ADIABATIC, ISOTHERMAL, HELD_PRESSURE)


@dataclass
class Passage:
    """An opening in a network.

    Attributes:
        opening: the item of the scene.
        ends: numbers of chambers, or boundaries.
        gases: the gases of boundaries; None at chambers.
        carried: the only gas that it carries; None: that of the end from which the flow comes.
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
    aperture: Aperture
    area: float = 0.0
    was_open: bool = True
    is_open: bool = True
    is_driven: bool = False


@dataclass
class HeatPath:
    """A wall in a network.

    Attributes:
        wall: the item of the scene.
        chamber: number of the chamber that it heats.
        compiled: the wall in the running scene.
        temperature: of the wall in the current step [K].
        size: factor of its coefficient of heat transfer in the current step.
    """

    wall: Wall
    chamber: int
    compiled: CompiledWall
    temperature: float = 0.0
    size: float = 0.0


@dataclass
class Rates:
    """Mass flow [kg/s] through each opening (m,), from its end a to its end b; and sums over all
    openings and walls: mass flows [kg/s] of the species into the chambers (s,), enthalpy flow with
    heat [W] into each chamber (n,), and both from all boundaries and walls."""

    openings: Array
    mass: Array
    energy: Array
    mass_supplied: float
    energy_supplied: float


class _States:
    """The states of gas in a network as the arrays of C: chambers, then boundaries.

    Attributes:
        species: the species of each state.
        boundaries: the boundary of each state that is none of a chamber.
        ends: numbers of the states at the ends of each opening (m, 2).
        fractions: mass fractions of the boundaries, one after another behind zeros for chambers.
    """

    def __init__(self, contents: Contents, passages: Sequence[Passage]) -> None:
        self.species: list[Sequence[Gas]] = [
            [contents.gases[row] for row in rows] for rows in contents.rows
        ]
        self.boundaries: list[Holder] = []
        self.ends = np.zeros((len(passages), 2), dtype=np.int32)
        fractions = [0.0] * len(contents.gases)
        for i, passage in enumerate(passages):
            for side, (end, gas) in enumerate(zip(passage.ends, passage.gases, strict=True)):
                if isinstance(end, int):
                    self.ends[i, side] = end
                    continue
                assert gas is not None, "A boundary has a gas."
                self.ends[i, side] = len(self.species)
                self.species.append(gas.species)
                self.boundaries.append(end)
                fractions.extend(float(share) for share in gas.fractions)
        self.fractions: Array = np.array(fractions)

    def carried_by(self, number: int, passage: Passage) -> list[Gas]:
        """The species that may flow through an opening, by its number."""
        if passage.carried is not None:
            return list(passage.carried.species)
        first, second = self.ends[number]
        return list(dict.fromkeys([*self.species[first], *self.species[second]]))

    def local_numbers(self, number: int, gas: Gas) -> list[int]:
        """The numbers of a species in the states at both ends of an opening; -1 for none."""
        found = []
        for state in self.ends[number]:
            own = list(self.species[state])
            found.append(own.index(gas) if gas in own else -1)
        return found


class Balance:
    """Mass and energy balance (1), (2) of the n chambers of a network in a step.

    In the methods y (n + s + r,) are pressures [Pa], masses [kg], then state variables of openings,
    V (n,) [m³] volumes at the end of the step, W (n,) [m³] the volumes that the enclosures sweep,
    and `magnitude` (n,) [m³] sums of the sizes of the summands of each volume, of which round-off
    is a part.

    Attributes:
        contents: the gas of the chambers.
        passages, walls: the network.
        h: length of the step [s].
        temperatures: of the chambers at the start of the step [K] (n,).
        process: `IN_TIME`, or what stays constant in an equilibrium.
    """

    def __init__(
        self,
        contents: Contents,
        passages: list[Passage],
        walls: list[HeatPath],
        comm: MPI.Intracomm,
        process: str = IN_TIME,
    ) -> None:
        """Compile the laws of the network.  Collective."""
        self.contents = contents
        self.passages = passages
        self.walls = walls
        self.process = process
        self._comm = comm
        self._c = c_library(HEADER, comm)
        self._states = _States(contents, passages)
        # Laws live as long as C may call them; those of Python raise errors.
        self._laws: list[Law] = []
        n = contents.n
        self._n = n
        s = len(contents.gases)
        m = len(passages)
        w = len(walls)
        flow_laws = [
            laws.FlowLaw(passage.opening, self._states.carried_by(i, passage))
            for i, passage in enumerate(passages)
        ]
        self.flow_laws = flow_laws
        self._mass_count = s
        self._variable_count = sum(len(flow.variables) for flow in flow_laws)
        self._size = n + s + self._variable_count
        self._of_step(n, s, m, w)
        fields = self._species() | self._openings() | self._walls() | self._step_fields()
        fields |= {
            "chamber_count": n,
            "mass_count": s,
            "variable_count": self._variable_count,
            "opening_count": m,
            "wall_count": w,
            "boundary_count": len(self._states.boundaries),
            "weight": self._address(
                compile_law(laws.flow_weight, by=("relaxation", "equalisation"), comm=comm)
            ),
            "work": self._c.ffi.NULL,
        }
        self._network = self._c.struct("gas_network", fields)
        # Its length depends on the numbers of the network.
        work = np.zeros(self._c.lib.gas_work_length(self._network.pointer))
        self._work_memory = self._pointer("work", work)
        self._network.pointer.work = self._work_memory
        self._column_count = int(self._c.lib.gas_column_count(self._network.pointer))
        # Pointers are made once: to make them takes longer than the functions.
        self._at = (
            self._network.pointer,
            self._pointer("y", self._y),
            self._pointer("V", self._volumes[0]),
            self._pointer("W", self._volumes[1]),
        )
        self._c_magnitude = self._pointer("magnitude", self._magnitude)
        self._c_result = self._pointer("result", self._result)
        self._c_by = self._pointer("by", self._by)
        self._c_rates = [
            self._pointer("rates", values)
            for values in (self._flows, self._mass, self._energy, self._supplied)
        ]

    def _of_step(self, n: int, s: int, m: int, w: int) -> None:
        """The arrays that C reads and sets in a step."""
        self.h = 0.0
        self._length: Array = np.zeros(1)
        self._start: dict[str, Array] = {
            "p0": np.zeros(n),
            "m0": np.zeros(s),
            "U0": np.zeros(n),
            "V0": np.zeros(n),
            "pV0": np.zeros(n),
            "T0": np.zeros(n),
            "theta": np.zeros(n),
            "amplification": np.zeros(n),
            "exponent": np.zeros(n),
            "wall_theta": np.zeros(w),
            "x0": np.zeros(self._variable_count),
            # In a search for rest state variables have the rates of the end of a pseudo-step.
            "end_share": np.array([0.5 if self.process == IN_TIME else 1.0]),
        }
        self._areas: Array = np.zeros(m)
        self._boundary: Array = np.zeros((len(self._states.boundaries), 2))
        self._wall_states: Array = np.zeros((w, 2))
        # What functions take and set: y, V and W; the sizes of the terms of volumes [m³]
        self._y: Array = np.zeros(self._size)
        self._volumes: Array = np.zeros((2, n))
        self._magnitude: Array = np.zeros(n)
        self._result: Array = np.zeros(self._size)
        self._by: Array = np.zeros((self._size, self._size + n))
        self._flows: Array = np.zeros(m)
        self._mass: Array = np.zeros(s)
        self._energy: Array = np.zeros(n)
        self._supplied: Array = np.zeros(2)

    @property
    def temperatures(self) -> Array:
        """Temperatures of the chambers at the start of the step [K] (n,)."""
        return self._start["T0"]

    @property
    def depends_on_swept_volume(self) -> bool:
        """Whether the work p̄ W is in the equations."""
        return self.process == IN_TIME

    # ---- the network as arrays -------------------------------------------------------------------

    def _pointer(self, name: str, values: Array) -> Any:
        """An array of numbers for C, which may write into it."""
        return self._c.array(name, values, "float64", values.shape, writable=True)

    def _indices(self, name: str, values: Sequence[int] | Any) -> Any:
        """An array of whole numbers for C."""
        numbers = np.ascontiguousarray(values, dtype=np.int32)
        return self._c.array(name, numbers, "int32", numbers.shape)

    def _address(self, law: Law) -> Any:
        """The C function of a law, which is kept."""
        self._laws.append(law)
        return self._c.ffi.cast("gas_law", law.address)

    def _functions(self, compiled: Sequence[Law]) -> Any:
        """An array of laws for C; one more, as an array of C is not empty."""
        addresses = [self._address(law) for law in compiled]
        return self._c.ffi.new("gas_law[]", [*addresses, self._c.ffi.NULL])

    def _species(self) -> dict[str, Any]:
        """The fields of species and states."""
        species = self.contents.species
        inputs: list[float] = []
        first = [0]
        heats = []
        for gas in species:
            law, numbers = laws.heat_law(gas, self._comm)
            heats.append(law)
            inputs += [0.0, *numbers]
            first.append(len(inputs))
        of_states = [[species.index(gas) for gas in own] for own in self._states.species]
        flat = [number for own in of_states for number in own]
        check_indices("The species of states", np.array(flat), len(species))
        state_first = np.cumsum([0, *map(len, of_states)])
        count = len(of_states)
        columns = np.zeros((count, 4 * len(species) + 8), dtype=np.int32)
        self._number_of_process = np.array([PROCESSES.index(self.process)], dtype=np.int32)
        return {
            "species_count": len(species),
            "process": self._c.array("process", self._number_of_process, "int32", (1,)),
            "R": self._pointer("R", np.array([float(gas.R) for gas in species])),
            "heat": self._functions(heats),
            "heat_inputs": self._pointer("heat_inputs", np.array(inputs)),
            "heat_first": self._indices("heat_first", first),
            "state_first": self._indices("state_first", state_first),
            "state_species": self._indices("state_species", flat),
            "fractions": self._pointer("fractions", self._states.fractions),
            "boundary": self._pointer("boundary", self._boundary),
            "columns": self._c.array("columns", columns, "int32", columns.shape, writable=True),
        }

    def _openings(self) -> dict[str, Any]:
        """The fields of openings."""
        species = self.contents.species
        flows = []
        by_counts = []
        output_counts = [0]
        slope_counts = [0]
        variable_inputs: list[int] = []
        variable_first = [0]
        number_first = [0]
        inputs: list[float] = []
        input_first = [0]
        carried_first = [0]
        local: list[list[int]] = []
        fractions: list[float] = []
        carried_species: list[int] = []
        for i, (passage, flow) in enumerate(zip(self.passages, self.flow_laws, strict=True)):
            carried = self._states.carried_by(i, passage)
            variable_inputs += flow.variables
            # One gas of constant specific heats: all other properties of both ends are constant.
            by_count = 2 if self.contents.is_simple else flow.end_count
            flows.append(flow.compile(by_count, self._comm))
            by_counts.append(by_count)
            variable_first.append(len(variable_inputs))
            number_first.append(number_first[-1] + len(flow.parameters))
            # With the slopes by both pressures
            output_counts.append(flow.output_count + 2)
            own_count = 1 + len(flow.variables) + len(flow.parameters)
            slope_counts.append(2 * flow.end_count + own_count)
            inputs += [0.0] * (2 * flow.end_count + 1) + flow.numbers
            input_first.append(len(inputs))
            local += [self._states.local_numbers(i, gas) for gas in carried]
            shares: list[float] = [-1.0] * len(carried)
            if passage.carried is not None:
                shares = [float(share) for share in passage.carried.fractions]
            fractions += shares
            carried_species += [species.index(gas) for gas in carried]
            carried_first.append(len(local))
        return {
            "ends": self._indices("ends", self._states.ends),
            "flow": self._functions(flows),
            # Laws that gradients alone need; see `all_derivatives`
            "slopes": self._c.ffi.NULL,
            "by_count": self._indices("by_count", by_counts),
            "max_outputs": max(output_counts),
            "max_by": max(slope_counts),
            "variable_first": self._indices("variable_first", variable_first),
            "variable_input": self._indices("variable_input", variable_inputs),
            "number_first": self._indices("number_first", number_first),
            "number_count": number_first[-1],
            "inputs": self._pointer("inputs", np.array(inputs, dtype=float)),
            "input_first": self._indices("input_first", input_first),
            "carried_first": self._indices("carried_first", carried_first),
            "local": self._indices("local", np.array(local, dtype=np.int32).reshape(-1, 2)),
            "carried": self._pointer("carried", np.array(fractions, dtype=float)),
            "carried_species": self._indices("carried_species", carried_species),
            "driven": self._indices("driven", [one.is_driven for one in self.passages]),
            "area": self._pointer("area", self._areas),
        }

    def _walls(self) -> dict[str, Any]:
        """The fields of walls."""
        heats = [laws.wall_law(path.compiled, self._comm) for path in self.walls]
        return {
            "wall_chamber": self._indices("walls", [path.chamber for path in self.walls]),
            "heat_flow": self._functions(heats),
            "wall_state": self._pointer("wall_state", self._wall_states),
        }

    def _step_fields(self) -> dict[str, Any]:
        """The fields of the present step and of the solution."""
        start = {name: self._pointer(name, values) for name, values in self._start.items()}
        return start | {
            "h": self._pointer("h", self._length),
            "max_iterations": MAX_ITERATIONS,
            "max_halvings": MAX_HALVINGS,
            "round_off": ROUND_OFF_SHARE,
            "tolerance": RESIDUAL_TOLERANCE,
            "acceptable": ACCEPTABLE_RESIDUAL,
            "remaining": MIN_REMAINING_SHARE,
            "rest_difference": REST_DIFFERENCE,
            "smallest_volume": SMALLEST_VOLUME,
        }

    # ---- a step ----------------------------------------------------------------------------------

    def begin(self, h: float, t: float, p: Array, m: Array, U: Array, V: Array, x: Array) -> None:
        """Start a step of length h [s] with its middle at t [s], from the pressures p [Pa], masses
        m [kg], energies U [J], volumes V [m³] and state variables x of openings, and choose the
        weights θ of its flows: ½ is the middle, 1 the end.  `InputError`: the area of a valve is
        negative or not a number, or the temperature of a wall is not positive."""
        self.h = h
        self._length[0] = h
        for name, values in (("p0", p), ("m0", m), ("U0", U), ("V0", V), ("x0", x)):
            self._start[name][:] = values
        # Pressures that are held do not equalise: a flow would last as long as the search.
        flows = self.process != HELD_PRESSURE
        for i, passage in enumerate(self.passages):
            passage.area = passage.aperture(h, t) if passage.is_open else 0.0
            self._areas[i] = passage.area if flows else 0.0
        # Apertures may set the temperature of what flows.
        for i, end in enumerate(self._states.boundaries):
            self._boundary[i] = (end.pressure, end.temperature)
        for i, path in enumerate(self.walls):
            path.temperature, path.size = path.compiled.state_in(h)
            self._wall_states[i] = (path.temperature, path.size)
        self._c.lib.gas_begin(self._network.pointer)
        self._raise_errors()
        for path in self.walls:
            # Compiled code does not check what a user's function returns: once a step.
            path.compiled.coefficient(float(self.temperatures[path.chamber]), path.temperature)

    def _raise_errors(self) -> None:
        """Raise what a user's function raised below C."""
        for law in self._laws:
            law.raise_error()

    def _take(self, y: Array, V: Array, W: Array) -> None:
        """Copy what the next function of C reads."""
        self._y[:] = y
        self._volumes[0] = V
        self._volumes[1] = W

    def residual(self, y: Array, V: Array, W: Array) -> Array:
        """Return the excess of energy [J] and mass [kg] in each chamber over its balance in a step,
        (1) and (2) of the module: it gains mass by flows, and energy by flows, heat and the work of
        its enclosure; and that of state variables of openings over what their rates give."""
        self._take(y, V, W)
        self._c.lib.gas_residual(*self._at, self._c_result)
        self._raise_errors()
        return self._result.copy()

    def work(self, y: Array, V: Array, W: Array) -> Array:
        """Work [J] of each chamber (n,) on what encloses it: p̄ W, or that of (6)."""
        self._take(y, V, W)
        self._c.lib.gas_work(*self._at, self._c_result)
        return self._result[: self._n].copy()

    def rates(self, y: Array, V: Array) -> Rates:
        """Return mass and energy flows into the chambers, and from boundaries and walls.  What one
        end of an opening loses the other gains in the same sum, so the network conserves mass and
        energy to round-off."""
        self._take(y, V, self._volumes[1])
        self._c.lib.gas_rates(*self._at[:3], *self._c_rates)
        self._raise_errors()
        mass_supplied, energy_supplied = self._supplied
        return Rates(
            openings=self._flows.copy(),
            mass=self._mass.copy(),
            energy=self._energy.copy(),
            mass_supplied=float(mass_supplied),
            energy_supplied=float(energy_supplied),
        )

    def scales(self, y: Array, V: Array, magnitude: Array) -> Array:
        """Energy [J] of each chamber, for each mass that of its chamber [kg], then sizes of state
        variables, to which the residual is compared, (n + s + r,).

        They include the round-off of two sums that the residual cannot fall below: that of the
        volume, and that of flows and heat, which long steps amplify where openings are wide or
        walls conduct well.  Nothing is lost by this, since the accepted state is summed from the
        flows.
        """
        self._take(y, V, self._volumes[1])
        self._magnitude[:] = magnitude
        self._c.lib.gas_scales(*self._at[:3], self._c_magnitude, self._c_result)
        return self._result.copy()

    def derivatives(self, y: Array, V: Array, W: Array) -> tuple[Array, Array]:
        """Return the derivatives (n + s + r, n + s + r) and (n + s + r, n) of the residual
        (energies [J], masses [kg], then state variables) with respect to y and to V.  That with
        respect to W is the mean pressure on the diagonal of the energy rows; the caller has it."""
        self._take(y, V, W)
        self._c.lib.gas_derivatives(*self._at, 0, self._c_by)
        self._raise_errors()
        return self._by[:, : self._size].copy(), self._by[:, self._size :].copy()

    def settle(self, y: Array, V: Array, W: Array, magnitude: Array) -> Array | None:
        """Solve the balance at given volumes by Newton's method, from a positive guess y, to a
        scaled residual of 1e-13, or 1e-9 where round-off allows no less.  None if that is not
        reached in 50 iterations or the matrix is singular."""
        self._take(y, V, W)
        self._magnitude[:] = magnitude
        is_solved = self._c.lib.gas_solve(*self._at, self._c_magnitude)
        self._raise_errors()
        return self._y.copy() if is_solved else None

    # ---- gradients -------------------------------------------------------------------------------

    def all_derivatives(self, y: Array, V: Array, W: Array) -> dict[str, Array]:
        """Return the derivatives of the residual by all quantities of a step, each (n + s + r,
        ...), by their names: "y", "V", "W", "p0", "m0", "V0", "x0" of the start, "area" of
        openings, "numbers" that are their parameters, "boundary" (b, 2) pressure [Pa] and
        temperature [K] of the boundaries, and "wall" (w, 2) temperature [K] and size of walls.  U0
        is that of p0, m0 and V0.  The first call is collective."""
        pointer = self._network.pointer
        if pointer.slopes == self._c.ffi.NULL:
            self._slope_laws = self._functions(
                [flow.compile_slopes(self._comm) for flow in self.flow_laws]
            )
            pointer.slopes = self._slope_laws
        n = self._n
        w = len(self.walls)
        width = self._column_count
        weights: Array = np.zeros((3 * n + w, width))
        by: Array = np.zeros((self._size, width))
        self._take(y, V, W)
        self._c.lib.gas_weight_derivatives(pointer, self._pointer("weights", weights))
        self._c.lib.gas_derivatives(*self._at, 1, self._pointer("by", by))
        self._raise_errors()
        s = self._mass_count
        counts = {
            "y": self._size,
            "V": n,
            "p0": n,
            "m0": s,
            "V0": n,
            "weights": n + w,
            "boundary": 2 * len(self._states.boundaries),
            "area": len(self.passages),
            "wall": 2 * w,
            "W": n,
            "x0": self._variable_count,
            "numbers": sum(len(flow.parameters) for flow in self.flow_laws),
        }
        ends = np.cumsum(list(counts.values()))
        slices = {
            name: slice(end - count, end)
            for (name, count), end in zip(counts.items(), ends, strict=True)
        }
        by += by[:, slices["weights"]] @ weights[: n + w]
        found = {name: by[:, columns] for name, columns in slices.items()}
        del found["weights"]
        return found

    @property
    def boundaries(self) -> list[Holder]:
        """The boundaries in the order of the derivatives by them."""
        return self._states.boundaries
