"""Orifices between volumes of gas, and walls that heat or cool a chamber."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Any

from mpi4py import MPI

from gossamer_fx.core.checks.arguments import Range, check_arguments, not_negative, positive
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.user_functions import ask_numbers
from gossamer_fx.mechanics.gas.connection import PassiveOpening
from gossamer_fx.mechanics.gas.contract import Aperture, Conductance, Gas
from gossamer_fx.mechanics.gas.film_area import FilmArea
from gossamer_fx.mechanics.gas.linear_table import LinearTable
from gossamer_fx.mechanics.gas.network import GasNetwork
from gossamer_fx.mechanics.gas.ring import Ring
from gossamer_fx.mechanics.gas.surface import Geometry
from gossamer_fx.mechanics.gas.volumes import Chamber

# Geometric area of an opening: a number [m²], a function of time [s], or that of a part of a film
Area = float | Callable[[float], float] | Ring | FilmArea

# C_d, the effective over the geometric area
Coefficient = Annotated[float, Range(0.0, 1.0, above=True)]

# Largest laminar range of an orifice: above a tenth of the upstream pressure the regularised law
# would replace (3) in flows that are far from rest.
MAX_LAMINAR = 0.1

# Least laminar range: a part of the pressure that is well above its round-off.
MIN_LAMINAR = 1e-12


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
        >>> air = IdealGas(gamma=1.4, R=287.0)
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
class Orifice(PassiveOpening):
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
    laminar: float = 1e-5
    name: str = "orifice"

    def __post_init__(self) -> None:
        super().__post_init__()
        what = f"{type(self).__name__} '{self.name}'"
        check(
            isinstance(self.area, Ring | FilmArea)
            or callable(self.area)
            or 0 <= self.area < math.inf,
            f"{what}: area is {self.area!r} m²; "
            "give a positive number, a function of time, or a ring.",
        )
        check(
            MIN_LAMINAR <= self.laminar < MAX_LAMINAR,
            f"{what}: laminar is {self.laminar!r}; give a small fraction such as 1e-5.",
        )
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
        table = self.discharge_coefficient
        if isinstance(table, LinearTable) and pu.real > 0:
            flux = flux * table(pd / pu)
        return flux


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
    check(opening >= 0, f"{what} is {opening!r} m²; give one that is not negative.")
    return opening


@check_arguments
@dataclass(frozen=True, eq=False)
class WallHeat:
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

    def requires(self) -> Iterable[Any]:
        yield self.chamber

    def compile(self, geometry: Geometry) -> Callable[[float], Conductance]:
        """The given number [W/K] in every step."""
        return lambda h: lambda T: self.conductance
