"""The base classes of the items of a gas network: gases, volumes, boundaries, openings and walls.

`network.GasNetwork` finds the items of a scene by these bases and knows no class behind them.  A
new kind of valve is therefore a class that is derived from `Opening`; nothing else has to change.
What an item has in its constructor, such as a name, is an annotation here and no property, so that
frozen dataclasses can have it as a field.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from gossamer_fx.core.checks.errors import InputError
from gossamer_fx.core.checks.lookups import check_known
from gossamer_fx.core.laws.tracing import Number
from gossamer_fx.core.model.body import Array
from gossamer_fx.core.model.state import HasSystem
from gossamer_fx.mechanics.gas.enclosure import CompiledEnclosure, Enclosure
from gossamer_fx.mechanics.gas.film_area import FilmArea
from gossamer_fx.mechanics.gas.surface import Geometry
from gossamer_fx.mechanics.terms.scalar_unknowns import BringsScalarUnknowns

# Effective area C_d A [m²] of a step, a function of its length h [s] and of the time [s] of its
# middle.
Aperture = Callable[[float, float], float]


@dataclass(frozen=True)
class CompiledWall:
    """A wall in a running scene, whose conductance [W/K] is its size times a coefficient.

    Attributes:
        state_in: temperature [K] and size of the wall in a step, a function of its length h [s].
            Collective.
        coefficient: a law (`core.laws`) of the temperatures of gas and wall [K].
    """

    state_in: Callable[[float], tuple[float, float]]
    coefficient: Callable[[Number, Number], Number] = lambda T, outside: 1.0


class Gas(ABC):
    """A thermally perfect gas, p V = m R T and U = m u(T), or a mixture of such gases.

    Its functions are laws (`core.laws`) of the temperature T [K], which are compiled.

    Attributes:
        name: in messages and outputs.
        R: specific gas constant [J/(kg K)].
        fractions: mass fractions of the species; their sum is one.
    """

    name: str
    R: Number
    # A pure gas: all of its mass is of one species.
    fractions: Sequence[Number] = (1.0,)

    @property
    def species(self) -> tuple[Gas, ...]:
        """The pure gases that it consists of; of a pure gas the gas itself."""
        return (self,)

    @property
    @abstractmethod
    def constant_heat_ratio(self) -> float | None:
        """γ = c_p/c_v if it is the same at all temperatures, so that U = p V/(γ - 1)."""

    @abstractmethod
    def heat_ratio(self, T: Number) -> Number:
        """γ = c_p/c_v at a temperature."""

    @abstractmethod
    def heat_capacity(self, T: Number) -> Number:
        """c_v [J/(kg K)]."""

    @abstractmethod
    def energy(self, T: Number) -> Number:
        """u [J/kg], positive, with du/dT = c_v."""

    @abstractmethod
    def enthalpy(self, T: Number) -> Number:
        """u + R T [J/kg]."""


# The gases at the ends a and b of an opening
Gases = tuple[Gas, Gas]

# Pressures [Pa] or temperatures [K] of both ends
Pair = tuple[complex, complex]


# Usual temperatures of gas [K], its pressures [Pa] and mass flows [kg/s], from least to most, and
# the likely slip where a number is another one; see `scene.validation`.
USUAL_TEMPERATURE = (40.0, 5e3, "K", "is it in degrees Celsius?")
USUAL_PRESSURE = (0.0, 2e8, "Pa", "")
USUAL_MASS_FLOW = (0.0, 1e3, "kg/s", "is it in g/s or kg/h?")


class Holder:
    """Base of gas boundaries of constant state: gas comes from one or goes to it, and it does not
    change, as reservoirs and the surroundings.

    Openings have a pressure and a temperature, too, so that a class is a boundary because it is
    derived from this one, and not because of its members.

    Attributes:
        name: in messages.
        pressure: absolute [Pa].
        temperature: [K].
        gas: what it supplies; None for the gas of the scene, if that has one species.
    """

    name: str
    pressure: float
    temperature: float
    gas: Gas | None

    USUAL: ClassVar = {"temperature": USUAL_TEMPERATURE, "pressure": USUAL_PRESSURE}


class Volume(BringsScalarUnknowns):
    """A control volume: gas with a mass and an energy that change, e.g. a chamber or a tank.

    The attributes are its initial state and its geometry.  The state in a run is
    `run.chamber(name)`.

    Attributes:
        name: in messages, outputs and `run.chamber`.
        initial_pressure: absolute, at the start [Pa].
        initial_temperature: at the start [K].
        gas: the gas or mixture at the start.
        fixed_volume: rigid part of the volume [m³], added to that of the enclosure.
        enclosure: the film or piston that bounds the volume; None for a rigid one.
        outside: what acts on the outer side of the enclosure; None for a vacuum.
    """

    name: str
    initial_pressure: float
    initial_temperature: float
    gas: Gas
    fixed_volume: float
    enclosure: Enclosure | None
    outside: Holder | None


class Opening(BringsScalarUnknowns, ABC):
    """A connection through which gas flows between two volumes or boundaries.

    `Orifice` is one.  Which arguments its constructor takes does not matter here.

    Attributes:
        name: in messages.
        a: the end from which a positive flow comes.
        b: the end to which a positive flow goes.
        is_driven: whether its flow does not vanish at equal pressures, as of an inflator or a
            blower.
        parameters: names and units of the numbers of `flow` by which gradients have derivatives.
            `aperture` does not depend on them.
    """

    name: str
    a: Holder | Volume
    b: Holder | Volume
    is_driven: ClassVar[bool] = False
    parameters: ClassVar[Mapping[str, str]] = {}

    def requires(self) -> Iterable[Any]:
        yield self.a
        yield self.b

    @property
    def carried_gas(self) -> Gas | None:
        """The gas that flows, whatever the ends hold; None: that of the end from which it comes."""
        return None

    def aperture(self, geometry: Geometry) -> Aperture:
        """The effective area C_d A [m²] in a running scene, as a function of step length and time.
        An opening without an area returns its scale instead, which `flow` gets as `area`: one if it
        does not override this method."""
        return lambda h, t: 1.0

    @abstractmethod
    def flow(self, gases: Gases, area: float, p: Pair, T: Pair) -> complex:
        """Return the mass flow [kg/s] from a to b; negative if the gas flows from b to a.

        The flow has the mixture and the enthalpy of the end that it comes from, or is of
        `carried_gas` alone.  It is a law (`core.laws`): a function of its arguments and of the
        numbers of the opening alone, compiled with exact derivatives.  One that needs real numbers
        is called back from C, which takes some 100 times as long.

        Args:
            gases: the gases at the ends a and b.
            area: effective area C_d A [m²].
            p: pressures [Pa] of the ends a and b.
            T: temperatures [K] of the ends a and b.
        """


class Switch(Opening):
    """An opening that is open or closed in a whole step, by the pressures at its start: valves and
    burst vents.  Whether it was open is part of the state of a run.

    Attributes:
        starts_open: whether it is open at the start of a run.
    """

    starts_open: bool

    @abstractmethod
    def is_open(self, was_open: bool, p: tuple[float, float]) -> bool:
        """Whether it is open in the coming step; p [Pa] are the pressures of the ends a and b."""


class DynamicOpening(Opening):
    """An opening with state variables x, e.g. lift and speed of a plate, dx/dt = rates(p, T, x).

    They are fields of the opening: `flow` and `rates` read their present values, and a scene starts
    with those that are given.  They are unknowns of the gas balance: with pressures and
    temperatures p, T as the flow has them in a step of length h

        x1 = x0 + h rates(p, T, x),     x = (x0 + x1)/2

    and x = x1 in the pseudo-steps of a search for rest.  The rule is of second order, and conserves
    the energy of a linear oscillator; steps have to resolve the motion.

    The energy balance is that of the gas alone, whose flow has the enthalpy upstream, so that it
    closes to round-off.  The kinetic energy of moving parts, that of their springs, and the work of
    the gas on them are left out: 5 mJ for a plate of 10 g at 1 m/s; a litre of gas at 1 bar has
    250 J.

    Attributes:
        variables: names and units of the state variables.

    Example:
        A leak that opens as long as the pressure of a is higher:

        >>> from dataclasses import dataclass
        >>> @dataclass(frozen=True, eq=False)
        ... class Crack(PassiveOpening, DynamicOpening):
        ...     area: float = 1e-6
        ...     growth: float = 1e-11
        ...     variables = {"area": "m²"}
        ...     parameters = {"growth": "m²/(Pa s)"}
        ...
        ...     def rates(self, p, T):
        ...         return {"area": self.growth * positive_part(p[0] - p[1])}
        ...
        ...     def flux(self, gas, pu, Tu, pd):
        ...         return self.area * isentropic_flow(gas, pu, Tu, pd, 1e-5)
        >>> crack = Crack(tank, gx.gas.Ambient())
        >>> run = gx.Simulation(gx.Scene(crack), gx.Midpoint(dt=0.01))
        >>> run.run(until=0.1)
        >>> crack.variable(run, "area") > 1e-6
        True
    """

    variables: ClassVar[Mapping[str, str]]

    @abstractmethod
    def rates(self, p: Pair, T: Pair) -> Mapping[str, Number]:
        """dx/dt of each state variable, by its name; a law, as `flow` is.

        Args:
            p: pressures [Pa] of the ends a and b.
            T: temperatures [K] of the ends a and b.
        """

    def variable(self, run: HasSystem, name: str) -> float:
        """A state variable at the end of the last step, for probes.  `InputError`: the opening is
        not in the scene, or has no variable of that name."""
        check_known(f"'{self.name}'", "state variable", name, self.variables)
        values: dict[str, float] = network_of(self, run).variables(self)
        return values[name]


def network_of(opening: Opening, run: HasSystem) -> Any:
    """The scalar unknowns of a running scene that hold an opening.  `InputError`: none do."""
    for scalars in run.system.equations.scalar_unknowns:
        if isinstance(scalars, opening.scalar_unknowns) and opening.name in scalars.flows():
            return scalars
    raise InputError(f"'{opening.name}' is not in the scene; add it.")


class Discharge(Opening):
    """An opening with a geometric area A, whose effective area is C A.  Gradients have derivatives
    by these two, in addition to `parameters`.

    Attributes:
        area: a number [m²], a function of time [s], a `ring.Ring` or a `film_area.FilmArea`.
        coefficient: name of the attribute C, a number; empty if C is one.
    """

    area: object
    coefficient: ClassVar[str] = ""


class Wall(BringsScalarUnknowns, ABC):
    """Something of known temperature that exchanges heat with a volume: a wall, or what is
    outside of a film.

    Attributes:
        name: in messages.
        chamber: the volume that the wall heats or cools.
        temperature: of the wall [K], a number or a function of the run.
        proportional_to: name and unit of the attribute, a number, to which the conductance is
            proportional, and by which gradients have a derivative; empty if there is none.
    """

    name: str
    chamber: Volume
    temperature: object
    proportional_to: ClassVar[tuple[str, str]] = ("", "")

    @property
    def film_area(self) -> FilmArea | None:
        """The area to which the conductance is proportional if it moves with a film, else None."""
        return None

    @abstractmethod
    def compile(self, geometry: Geometry) -> CompiledWall:
        """The wall in a running scene, with its temperature and conductance (heat transfer
        coefficient times area).  Collective."""


@dataclass(repr=False)
class ChamberState:
    """State of the gas in one chamber at the end of the last accepted step.

    The gas is well mixed and ideal: pressure · volume = Σ m_s R_s · temperature.

    Attributes:
        chamber: the chamber or tank that holds the gas.
        enclosure: what bounds it in the running scene; None for a rigid chamber.
        species: the pure gases that it holds or can receive through openings.
        masses: of each of the species [kg].
        pressure: [Pa], absolute.
        internal_energy: U = Σ m_s u_s(T) [J]; m c_v T for constant specific heats.
        volume: [m³], rigid part included.

    Example:
        >>> run.chamber("tank").pressure
        200000.0
    """

    chamber: Volume
    enclosure: CompiledEnclosure | None
    species: tuple[Gas, ...]
    masses: Array
    pressure: float = 0.0
    internal_energy: float = 0.0
    volume: float = 0.0

    def __repr__(self) -> str:
        """Name, pressure, temperature, volume and mass."""
        state = f"{self.pressure:.6g} Pa"
        # Before the first state is set there is no gas, and no temperature.
        if self.mass > 0:
            state += f", {self.temperature:.5g} K, {self.volume:.5g} m³, {self.mass:.5g} kg"
        return f"<ChamberState of '{self.chamber.name}': {state}>"

    @property
    def mass(self) -> float:
        """Mass of all species [kg]."""
        return float(self.masses.sum())

    def mass_of(self, gas: Gas) -> float:
        """Mass of one species [kg], 0 if the chamber cannot receive it."""
        found = zip(self.species, self.masses, strict=True)
        return float(sum(mass for one, mass in found if one == gas))

    @property
    def mass_times_R(self) -> float:
        """Σ m_s R_s [J/K]."""
        return float(sum(m * gas.R for gas, m in zip(self.species, self.masses, strict=True)))

    @property
    def temperature(self) -> float:
        """Temperature of the gas [K], p V/Σ m_s R_s."""
        return self.pressure * self.volume / self.mass_times_R

    @property
    def heat_factor(self) -> float:
        """∂U/∂(pV) at constant masses: c_v/R of the mixture, 1/(γ - 1)."""
        T = self.temperature
        amounts = zip(self.species, self.masses, strict=True)
        return float(sum(m * gas.heat_capacity(T) for gas, m in amounts)) / self.mass_times_R

    @property
    def energy_by_mass(self) -> Array:
        """∂U/∂m_s at constant pressure and volume, for each of the species [J/kg]: zero for a gas
        of constant specific heats that is alone."""
        T = self.temperature
        c = self.heat_factor
        return np.array([float(gas.energy(T)) - c * T * gas.R for gas in self.species])
