"""Openings through which gas flows between two volumes: orifices, valves and burst vents, pipes and
films that leak; and the heat that a chamber exchanges with walls and through its film.

The flow through an opening depends on pressure, temperature and gas at both ends (`flow`), and has
its effective area, which may change in time or with a film (`aperture`), as a factor.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import Annotated, Any, ClassVar

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.checks.arguments import Range, check_arguments, not_negative, positive
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.relations import different, rising
from gossamer_fx.core.checks.user_functions import ask_numbers
from gossamer_fx.core.laws.tracing import Number, Symbol, root
from gossamer_fx.core.model.state import HasSystem
from gossamer_fx.mechanics.gas.balance import Passage
from gossamer_fx.mechanics.gas.contract import (
    USUAL_TEMPERATURE,
    Aperture,
    CompiledWall,
    Discharge,
    Gas,
    Gases,
    Holder,
    Opening,
    Pair,
    Switch,
    Volume,
    Wall,
    network_of,
)
from gossamer_fx.mechanics.gas.film_area import FilmArea
from gossamer_fx.mechanics.gas.network import GasNetwork
from gossamer_fx.mechanics.gas.ring import Ring
from gossamer_fx.mechanics.gas.surface import Geometry, InStep, SeenSystem
from gossamer_fx.mechanics.gas.tables import LinearTable
from gossamer_fx.mechanics.gas.volumes import Chamber


@check_arguments(different(("a", "b"), give="two volumes"))
@dataclass(frozen=True, eq=False)
class Connection(Opening):
    """An opening between two different ends a and b, the part that the classes of openings share;
    its area, if it has one, may be that of a part of a film."""

    a: Volume | Holder
    b: Volume | Holder
    _: KW_ONLY
    name: str = "opening"
    scalar_unknowns = GasNetwork

    def requires(self) -> Iterable[Any]:
        yield from super().requires()
        # A ring or the area of a film joins the scene with its film.
        if isinstance(self, Discharge) and isinstance(self.area, Ring | FilmArea):
            yield from self.area.requires()


class PassiveOpening(Connection):
    """An opening through which gas flows to the lower pressure, by one law for both directions."""

    def flow(self, gases: Gases, area: float, p: Pair, T: Pair) -> complex:
        """Mass flow [kg/s] from a to b through an effective area [m²]."""
        if p[0].real >= p[1].real:
            return area * self.flux(gases[0], p[0], T[0], p[1])
        return -area * self.flux(gases[1], p[1], T[1], p[0])

    @abstractmethod
    def flux(self, gas: Gas, pu: complex, Tu: complex, pd: complex) -> complex:
        """Mass flow per effective area [kg/(s m²)] of the gas upstream, with the pressure pu [Pa]
        and temperature Tu [K], to the pressure pd."""


# Geometric area of an opening: a number [m²], a function of time [s], or that of a part of a film
Area = Annotated[float, not_negative("m²")] | Callable[[float], float] | Ring | FilmArea

# C_d, the effective over the geometric area
Coefficient = Annotated[float, Range(0.0, 1.0, above=True)]

# Laminar range of an opening: at least a part of the pressure that is well above its round-off.  At
# more than a tenth the regularised law would replace (3) in flows that are far from rest.
Laminar = Annotated[float, Range(1e-12, 0.1)]


def isentropic_flow(gas: Gas, pu: complex, Tu: complex, pd: complex, laminar: float) -> complex:
    """Mass flow per effective area [kg/(s m²)] of an isentropic nozzle, from pu [Pa] and Tu [K] to
    pd ≤ pu.

        ṁ/(C_d A) = p_u/√(R T_u) Ψ(x),   x = p_d/p_u                                   (1)
        choked, x ≤ (2/(γ+1))^(γ/(γ-1)):  Ψ = √γ (2/(γ+1))^((γ+1)/(2(γ-1)))            (2)
        subsonic, larger x:               Ψ = √(2γ/(γ-1) (x^(2/γ) - x^((γ+1)/γ)))      (3)

    (Shapiro, Dynamics and Thermodynamics of Compressible Fluid Flow, 1953, ch. 4.)  The slope of
    (3) is infinite at x = 1: Newton's method fails there, and flows at rest reverse endlessly.  For
    1 - x < `laminar` Ψ is therefore the odd cubic in 1 - x that has the value and the slope of (3)
    at 1 - x = laminar.  A short tube at low Reynolds number is linear in the same way.  Pressures
    within `laminar` of each other equalise later than by (3).

    γ and R are those of the gas upstream, γ at its temperature.  The flow is analytic in pu, Tu, pd
    and the properties of the gas within each branch, so derivatives by complex steps are exact.

    Example:
        >>> air = gx.IdealGas(gamma=1.4, R=287.0)
        >>> round(1e-6 * isentropic_flow(air, 2e5, 300.0, 0.0, 1e-5), 7)
        0.0004667
    """
    if pu.real <= 0:
        return 0.0
    γ = gas.heat_ratio(Tu)
    x = pd / pu
    scale = pu / (gas.R * Tu) ** 0.5
    critical_ratio = (2 / (γ + 1)) ** (γ / (γ - 1))
    if x.real <= critical_ratio.real:
        # (2)
        return scale * γ**0.5 * (2 / (γ + 1)) ** ((γ + 1) / (2 * (γ - 1)))
    if (1 - x).real >= laminar:
        # (3)
        return scale * (2 * γ / (γ - 1) * (x ** (2 / γ) - x ** ((γ + 1) / γ))) ** 0.5
    # The cubic Ψ_l ((1 - c) ξ + c ξ³), ξ = (1 - x)/laminar, with the value Ψ_l and slope of (3) at
    # the limit x_l.
    limit = 1 - laminar
    value = (2 * γ / (γ - 1) * (limit ** (2 / γ) - limit ** ((γ + 1) / γ))) ** 0.5
    slope_terms = 2 * limit ** (2 / γ - 1) - (γ + 1) * limit ** (1 / γ)
    slope = -slope_terms / ((γ - 1) * value)
    cubic = (slope * laminar / value - 1) / 2
    ξ = (1 - x) / laminar
    return scale * value * ((1 - cubic) * ξ + cubic * ξ**3)


@check_arguments
@dataclass(frozen=True, eq=False)
class Orifice(PassiveOpening, Discharge):
    """An opening between two volumes of gas; gas flows either way by `isentropic_flow`.

    Args:
        a, b: chambers, tanks or surroundings; a flow from a to b is positive.
        area: geometric area [m²]: a number ≥ 0, a function of time [s] (a valve), or the `Ring`
            between two chambers or a `FilmArea`, whose deformed area counts.
        discharge_coefficient: C_d, effective over geometric area, in (0, 1]; or a `LinearTable`
            of it over the ratio p_down/p_up.
        laminar: pressure difference as a share of the upstream pressure below which the flow law is
            regularised; in (0, 0.1).
        name: in messages.

    Raises:
        InputError: an end holds no gas, both ends are the same, or a quantity is out of its range.

    Example:
        >>> bottle = gx.gas.Ambient(2e5, 300.0, name="reservoir")
        >>> valve = gx.Orifice(bottle, tank, area=lambda t: 1e-6 if t < 1.0 else 0.0)
    """

    _: KW_ONLY
    area: Area
    discharge_coefficient: Coefficient | LinearTable = 1.0
    # Pressures equalise by the ideal law (3) down to a difference of 1e-5, below what is measured.
    laminar: Laminar = 1e-5
    name: str = "orifice"
    coefficient: ClassVar = "discharge_coefficient"
    USUAL: ClassVar = {"area": (0.0, 1.0, "m²", "is it in mm² or cm²?")}

    def __post_init__(self) -> None:
        what = f"{type(self).__name__} '{self.name}'"
        if isinstance(self.discharge_coefficient, LinearTable):
            self._check_table(what, self.discharge_coefficient)

    def _check_table(self, what: str, table: LinearTable) -> None:
        """Refuse a table of discharge coefficients out of range."""
        for ratio, coefficient in table.points:
            check(
                0 <= ratio <= 1 and 0 < coefficient <= 1,
                f"{what}: the discharge coefficient {coefficient!r} at the pressure ratio "
                f"{ratio!r} is out of range; give ratios of 0 to 1 and coefficients up to 1.",
            )

    def aperture(self, geometry: Geometry) -> Aperture:
        """Return the effective area C_d A [m²] as a function of step length h [s] and time t [s] of
        the middle of the step; the area A of a ring is that of the film's opening at that time.

        The function is collective, and raises `InputError` if a valve's area is negative or not a
        number.
        """
        # A table multiplies the flow instead.
        coefficient = 1.0
        if not isinstance(self.discharge_coefficient, LinearTable):
            coefficient = self.discharge_coefficient
        what = f"{type(self).__name__} '{self.name}'"
        return compile_aperture(self.area, coefficient, geometry, what)

    def flux(self, gas: Gas, pu: complex, Tu: complex, pd: complex) -> complex:
        """`isentropic_flow`, times the coefficient of a table."""
        flux = isentropic_flow(gas, pu, Tu, pd, self.laminar)
        if self._table is not None and pu.real > 0:
            flux = flux * self._table(pd / pu)
        return flux

    # Asked for in each flow
    @cached_property
    def _table(self) -> LinearTable | None:
        """The coefficient of discharge, if it is a table."""
        given = self.discharge_coefficient
        return given if isinstance(given, LinearTable) else None


def compile_aperture(area: Area, coefficient: float, geometry: Geometry, user: str) -> Aperture:
    """The area of an opening times a discharge coefficient [m²] as a function of step length and
    time; collective.  It raises `InputError` if the area of a valve is negative or no number."""
    if isinstance(area, Ring | FilmArea):
        moving = geometry.area(area)
        return lambda h, t: coefficient * moving.aperture(h)
    if callable(area):
        return lambda h, t: coefficient * _area_at(geometry.comm, area, t, user)
    return lambda h, t: coefficient * area


def _area_at(comm: MPI.Intracomm, area: Callable[[float], float], t: float, user: str) -> float:
    """The area [m²] that a user's function gives at time t, checked.  Collective."""
    what = f"{user}: its area at t = {t:.6g} s"
    opening = float(ask_numbers(comm, what, lambda: area(t)))
    not_negative("m²").check(what, opening)
    return opening


@check_arguments
@dataclass(frozen=True, eq=False)
class WallHeat(Wall):
    """A wall of constant temperature that heats or cools a chamber: Q = conductance (T_wall - T)
    [W].

    The heat counts as supplied in the energy balance.

    Args:
        chamber: the chamber or tank.
        conductance: heat transfer coefficient times area [W/K], ≥ 0.
        temperature: of the wall [K], > 0.
        name: in messages.

    Raises:
        InputError: a quantity is out of its range, or `chamber` is not a chamber.

    Example:
        >>> heater = gx.gas.WallHeat(tank, conductance=0.5, temperature=350.0)
    """

    chamber: Chamber
    conductance: Annotated[float, not_negative("W/K")]
    _: KW_ONLY
    temperature: Annotated[float, positive("K")]
    name: str = "wall"
    scalar_unknowns = GasNetwork
    proportional_to: ClassVar = ("conductance", "W/K")
    USUAL: ClassVar = {"temperature": USUAL_TEMPERATURE}

    def requires(self) -> Iterable[Any]:
        yield self.chamber

    def compile(self, geometry: Geometry) -> CompiledWall:
        """The given numbers [K] and [W/K] in every step."""
        return CompiledWall(lambda h: (self.temperature, self.conductance))


@check_arguments(rising("closes", "opens"))
@dataclass(frozen=True, eq=False)
class Valve(Orifice, Switch):
    """An orifice that opens and closes by the difference of the pressures of a and b, or by events.

    It is open or closed in a whole step, by the state at the start of the step.  A relief valve has
    `opens` above `closes`, its hysteresis; a check valve has `opens=0.0, closes=0.0, one_way=True`;
    a burst vent has `opens` alone, and stays open.  Without both it acts by events only.

    Args:
        a, b, area, discharge_coefficient, laminar: as of an `Orifice`.
        opens: pressure of a over that of b [Pa] from which on it opens; None: by events only.
        closes: the same below which it closes, at most `opens`; None: it stays open.
        one_way: whether no gas flows from b to a while it is open.
        starts_open: whether it is open at the start.
        name: in messages.

    Raises:
        InputError: a quantity is out of its range, or `closes` is above `opens`.

    Example:
        >>> outside = gx.gas.Ambient(1e5, 300.0)
        >>> relief = gx.gas.Valve(tank, outside, area=1e-5, opens=5e3, closes=3e3, one_way=True)
        >>> vent = gx.gas.Valve(tank, outside, area=1e-4, opens=2e4, name="vent")
        >>> late = gx.gas.Valve(tank, outside, area=1e-4, name="late")
        >>> opening = gx.At(0.5, late.open)
    """

    _: KW_ONLY
    opens: Annotated[float, not_negative("Pa")] | None = None
    closes: Annotated[float, not_negative("Pa")] | None = None
    one_way: bool = False
    starts_open: bool = False
    name: str = "valve"

    def is_open(self, was_open: bool, p: tuple[float, float]) -> bool:
        """Whether it is open in a step that starts at the pressures p [Pa] of a and b."""
        excess = p[0] - p[1]
        if was_open:
            return self.closes is None or excess >= self.closes
        return self.opens is not None and excess >= self.opens

    def open(self, run: HasSystem) -> None:
        """Open the valve from the present state on: an action of events."""
        self._passage(run).was_open = True

    def close(self, run: HasSystem) -> None:
        """Close the valve from the present state on: an action of events."""
        self._passage(run).was_open = False

    def was_open(self, run: HasSystem) -> bool:
        """Whether the valve was open in the last step: a probe."""
        return self._passage(run).was_open

    def _passage(self, run: HasSystem) -> Passage:
        """The valve in a run.  `InputError`: it is not in the scene."""
        found: Passage = network_of(self, run).switch(self)
        return found

    def flow(self, gases: Gases, area: float, p: Pair, T: Pair) -> complex:
        """Mass flow [kg/s] from a to b while it is open."""
        if self.one_way and p[0].real < p[1].real:
            return 0.0
        return super().flow(gases, area, p, T)


@check_arguments
@dataclass(frozen=True, eq=False)
class PorousFilm(PassiveOpening, Discharge):
    """A film through which gas leaks by its deformed area and the difference of pressures Δp:

        Δp = viscous · v + inertial · v²,     ṁ = ρ A v

    with the density ρ upstream and the velocity v of the gas ahead of the film (Forchheimer's law;
    Ergun, Chem. Eng. Prog. 48 (1952) 89).  The law holds for small Mach numbers.  Parts that other
    films cover leak like the others.

    Args:
        a, b: chambers, tanks or surroundings on both sides; a flow from a to b is positive.
        area: the part of the film that leaks, a `FilmArea`, or a number [m²].
        viscous: Δp over v at low velocities [Pa s/m], > 0.
        inertial: Δp over v² at high ones [Pa s²/m²], ≥ 0.
        name: in messages.

    Raises:
        InputError: a quantity is out of its range, or both ends are the same.

    Example:
        >>> outside = gx.gas.Ambient(1e5, 300.0)
        >>> leak = gx.gas.PorousFilm(tank, outside, area=gx.gas.FilmArea(film), viscous=4e4)
    """

    _: KW_ONLY
    area: FilmArea | Annotated[float, not_negative("m²")]
    viscous: Annotated[float, positive("Pa s/m")]
    inertial: Annotated[float, not_negative("Pa s²/m²")] = 0.0
    name: str = "porous film"
    parameters: ClassVar = {"viscous": "Pa s/m", "inertial": "Pa s²/m²"}

    def aperture(self, geometry: Geometry) -> Aperture:
        """Return the area [m²] as a function of step length h [s] and time."""
        return compile_aperture(self.area, 1.0, geometry, f"PorousFilm '{self.name}'")

    def flux(self, gas: Gas, pu: complex, Tu: complex, pd: complex) -> complex:
        """ρ v [kg/(s m²)] of the law above."""
        difference = pu - pd
        root = (self.viscous**2 + 4 * self.inertial * difference) ** 0.5
        # The root of the quadratic equation in the form that does not cancel
        velocity = 2 * difference / (self.viscous + root)
        return pu / (gas.R * Tu) * velocity


def friction_parameter(gamma: Number, M: Number) -> Number:
    """f L*/D of the pipe that chokes a flow of the Mach number M (Shapiro, Dynamics and
    Thermodynamics of Compressible Fluid Flow, 1953, ch. 6), f the friction factor of Darcy:

        (1 - M²)/(γ M²) + (γ + 1)/(2 γ) ln((γ + 1) M²/(2 + (γ - 1) M²))

    >>> round(friction_parameter(1.4, 0.2), 3)
    14.533
    """
    return _friction_of_square(gamma, M * M)


def _friction_of_square(gamma: Number, square: Number) -> Number:
    """`friction_parameter` of the square of a Mach number."""
    ratio = (gamma + 1) * square / (2 + (gamma - 1) * square)
    return (1 - square) / (gamma * square) + (gamma + 1) / (2 * gamma) * np.log(ratio)


@check_arguments
@dataclass(frozen=True, eq=False)
class Pipe(PassiveOpening):
    """A pipe with friction between two volumes: an isentropic inlet, then adiabatic flow with the
    Darcy friction factor f (four times that of Fanning) to the pressure at the other end, at most
    to a Mach number of one.

    With the friction parameter F(M) of `friction_parameter` the Mach numbers M1 behind the inlet
    and M2 at the end obey

        F(M1) - F(M2) = f L/D,     p(M1, M2) = p_down, or M2 = 1 if that is below            (1)
        ṁ = A p_up √(γ/(R T_up)) M1 (1 + (γ - 1)/2 M1²)^(-(γ + 1)/(2 (γ - 1)))                (2)

    The gas in the pipe has no mass or inertia.  Near equal pressures the law is regularised.

    Args:
        a, b: chambers, tanks or surroundings; a flow from a to b is positive.
        diameter: inner diameter D [m], > 0.
        length: L [m], > 0.
        friction: f, 0.02 for turbulent flow in a smooth pipe at a Reynolds number of 2e4.
        laminar: as of an `Orifice`.
        name: in messages.

    Raises:
        InputError: a quantity is out of its range, or both ends are the same.

    Example:
        >>> outside = gx.gas.Ambient(1e5, 300.0)
        >>> hose = gx.gas.Pipe(tank, outside, diameter=2e-3, length=1.0, friction=0.02)
    """

    _: KW_ONLY
    diameter: Annotated[float, positive("m")]
    length: Annotated[float, positive("m")]
    friction: Annotated[float, positive("")]
    laminar: Laminar = 1e-5
    name: str = "pipe"
    parameters: ClassVar = {"diameter": "m", "length": "m", "friction": ""}

    def flux(self, gas: Gas, pu: Number, Tu: Number, pd: Number) -> Number:
        """(2) [kg/s], for an area of one."""
        if pu.real <= 0:
            return 0.0
        γ = gas.heat_ratio(Tu)
        scale = np.pi / 4 * self.diameter**2 * pu * (γ / (gas.R * Tu)) ** 0.5
        x = pd / pu
        if (1 - x).real >= self.laminar:
            return scale * self._mass_number(γ, x)
        # ṁ grows as √(1 - x): the odd cubic with the value and the slope of that at the limit
        ξ = (1 - x) / self.laminar
        return scale * self._mass_number(γ, 1 - self.laminar) * (1.25 * ξ - 0.25 * ξ**3)

    def _mass_number(self, γ: Number, x: Number) -> Number:
        """M1 (1 + (γ - 1)/2 M1²)^(-(γ + 1)/(2 (γ - 1))) of (2), at the ratio x of the pressure
        downstream to that upstream."""
        resistance = self.friction * self.length / self.diameter
        # F is convex and nearly linear in 1/M², and at least resistance at this end.
        most = 1 + 2 * γ * resistance + 2 * (γ + 1)
        square = 1 / root(lambda z: _friction_of_square(γ, 1 / z) - resistance, 1.0, most)
        # The end is choked if its pressure at M2 = 1 is above that downstream.
        if x > _end_pressure_ratio(γ, square):

            def excess(s: Number) -> Number:
                # Times M1², as this is nearly linear in it
                friction = _friction_of_square(γ, s) - _friction_of_square(γ, _end_square(γ, x, s))
                return s * (friction - resistance)

            square = root(excess, 0.0, square)
        return square**0.5 * (1 + (γ - 1) / 2 * square) ** (-(γ + 1) / (2 * (γ - 1)))


def _end_pressure_ratio(γ: Number, square: Number) -> Number:
    """p_end/p_up of a `Pipe` that is choked at its end, for M1² behind its inlet."""
    first = 2 + (γ - 1) * square
    return (first / 2) ** (-γ / (γ - 1)) * (square * first / (γ + 1)) ** 0.5


def _end_square(γ: Number, x: Number, square: Number) -> Number:
    """M2² at the end of a `Pipe` at which its pressure is x p_up, for M1² behind its inlet:

    p_end/p_up = (1 + (γ - 1)/2 M1²)^(-γ/(γ - 1)) M1/M2 √((2 + (γ - 1) M1²)/(2 + (γ - 1) M2²))
    """
    first = 2 + (γ - 1) * square
    # M2² (2 + (γ - 1) M2²), solved for M2² in the form that does not cancel
    product = square / x**2 * first * (first / 2) ** (-2 * γ / (γ - 1))
    return product / (1 + (1 + (γ - 1) * product) ** 0.5)


@check_arguments
@dataclass(frozen=True, eq=False)
class FilmHeat(Wall):
    """Heat between the gas of a chamber and its surroundings through the deformed film:

        Q = h A (T_outside - T)

    The heat counts as supplied in the energy balance.  The film itself takes none.  Films that fold
    on each other exchange heat as if they were apart.

    Args:
        chamber: the chamber or tank.
        area: the film or the part of it through which the heat goes; A is its deformed area [m²].
        coefficient: h [W/(m² K)] from the gas to the outside, ≥ 0: 1/h is the sum of 1/h on both
            sides and of thickness over conductivity of the film.  A number, or a function of the
            temperatures [K] of the gas and outside; gradients take a number.
        temperature: T_outside [K], > 0: a number, or a function of the run, called at the start of
            every step with an object that has `run.system`, as probes are: the temperature of the
            air at an altitude, or of a film in sunlight.  Gradients take a number.
        name: in messages.

    Raises:
        InputError: a quantity is out of its range, also when a function gives it.

    Example:
        >>> outside = gx.gas.FilmHeat(
        ...     tank, gx.gas.FilmArea(film), coefficient=5.0, temperature=223.0
        ... )
        >>> def free_convection(gas, air):
        ...     return 1.3 * abs(gas - air) ** 0.25
        >>> outside = gx.gas.FilmHeat(
        ...     tank, gx.gas.FilmArea(film), coefficient=free_convection, temperature=223.0
        ... )
        >>> air = gx.loads.StandardAtmosphere()
        >>> height = gx.probes.Position(film.port_at((0.0, 0.0, 0.0)), "z")
        >>> outside = gx.gas.FilmHeat(
        ...     tank,
        ...     gx.gas.FilmArea(film),
        ...     coefficient=5.0,
        ...     temperature=lambda run: air.temperature(12e3 + height(run)),
        ... )
    """

    chamber: Chamber
    area: FilmArea
    _: KW_ONLY
    coefficient: Annotated[float, not_negative("W/(m² K)")] | Callable[[float, float], float]
    temperature: Annotated[float, positive("K")] | Callable[[HasSystem], float]
    name: str = "heat through film"
    scalar_unknowns = GasNetwork
    USUAL: ClassVar = {"temperature": USUAL_TEMPERATURE}
    proportional_to: ClassVar = ("coefficient", "W/(m² K)")

    @property
    def film_area(self) -> FilmArea:
        """The given area."""
        return self.area

    def requires(self) -> Iterable[Any]:
        yield self.chamber
        yield from self.area.requires()

    def compile(self, geometry: Geometry) -> CompiledWall:
        """T_outside [K], and h A [W/K] with the area in the middle of the step, or A [m²] if h is a
        function."""
        area = geometry.area(self.area)

        def state_in(h: float) -> tuple[float, float]:
            # Measured once a step, not in each iteration
            size = area.aperture(h)
            if not callable(self.coefficient):
                size = size * self.coefficient
            return self._outside(geometry), size

        def coefficient(T: Number, outside: Number) -> Number:
            return self._coefficient_at(T, outside, geometry)

        return CompiledWall(state_in, coefficient)

    def _outside(self, geometry: Geometry) -> float:
        """T_outside [K] at the start of a step.  Collective."""
        given = self.temperature
        if not callable(given):
            return given
        what = f"FilmHeat '{self.name}': its temperature at t = {geometry.system.time:.6g} s"
        seen = InStep(SeenSystem(geometry.system))
        found = float(ask_numbers(geometry.comm, what, lambda: given(seen)))
        positive("K").check(what, found)
        return found

    def _coefficient_at(self, T: Number, outside: Number, geometry: Geometry) -> Number:
        """The coefficient [W/(m² K)] at temperatures of the gas and outside [K], one if it is a
        number, which is part of the size."""
        given: Any = self.coefficient
        if not callable(given):
            return 1.0
        if isinstance(T, Symbol):
            return given(T, outside)
        what = f"FilmHeat '{self.name}': its coefficient at {T:.6g} K"
        found = float(ask_numbers(geometry.comm, what, lambda: given(T, outside)))
        not_negative("W/(m² K)").check(what, found)
        return found
