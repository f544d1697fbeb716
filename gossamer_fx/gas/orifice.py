"""Openings between volumes of gas."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import KW_ONLY, dataclass
from typing import Any

from mpi4py import MPI

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.checks.user_functions import ask_numbers
from gossamer_fx.gas.contract import Aperture, Holder, Volume
from gossamer_fx.gas.geometry import Geometry
from gossamer_fx.gas.ideal_gas import IdealGas
from gossamer_fx.gas.network import GasNetwork
from gossamer_fx.gas.ring import Ring
from gossamer_fx.gas.volumes import Chamber


def isentropic_flow(
    gas: IdealGas, pu: complex, Tu: complex, pd: complex, laminar: float
) -> complex:
    """Mass flow per effective area [kg/(s m²)] from pressure pu and temperature Tu through an orifice to pd ≤ pu.

        ṁ/(C_d A) = p_u/√(R T_u) Ψ(x),   x = p_d/p_u
        choked, x ≤ (2/(γ+1))^(γ/(γ-1)):  Ψ = √γ (2/(γ+1))^((γ+1)/(2(γ-1)))
        else                              Ψ = √(2γ/(γ-1) (x^(2/γ) - x^((γ+1)/γ)))

    (Shapiro, Compressible Fluid Flow, 1953, ch. 4).  At x = 1 the slope of Ψ is infinite, which stops Newton's
    iteration and makes flows at rest reverse endlessly; so for 1 - x < `laminar` Ψ is the odd cubic in 1 - x with the
    same value and slope at 1 - x = laminar, as a short tube at low Reynolds number is linear.  The pressures equalise
    to a fraction below `laminar` later than the ideal law says.

    Analytic in its arguments between the branches: derivatives by complex step are exact.
    """
    if pu.real <= 0:
        return 0.0
    γ = gas.gamma
    x = pd / pu
    scale = pu / (gas.R * Tu) ** 0.5
    if x.real <= (2 / (γ + 1)) ** (γ / (γ - 1)):
        return scale * γ**0.5 * (2 / (γ + 1)) ** ((γ + 1) / (2 * (γ - 1)))
    if (1 - x).real >= laminar:
        return scale * (2 * γ / (γ - 1) * (x ** (2 / γ) - x ** ((γ + 1) / γ))) ** 0.5
    xl = 1 - laminar
    Ψ = (2 * γ / (γ - 1) * (xl ** (2 / γ) - xl ** ((γ + 1) / γ))) ** 0.5
    slope = -(2 * xl ** (2 / γ - 1) - (γ + 1) * xl ** (1 / γ)) / ((γ - 1) * Ψ)
    cubic = (slope * laminar / Ψ - 1) / 2
    ξ = (1 - x) / laminar
    return scale * Ψ * ((1 - cubic) * ξ + cubic * ξ**3)


@check_arguments
@dataclass(frozen=True, eq=False)
class Orifice:
    """An opening between two volumes; gas flows either way, choked or not, by `isentropic_flow`.

    Args:
        a, b: chambers, tanks, reservoirs or surroundings; flow from a to b is positive.
        area: opening [m²], a number, a function of time [s] (a valve), or the `Ring` between two chambers.
        discharge_coefficient: C_d, effective over geometric area.
        laminar: pressure difference, as a fraction of the upstream pressure, below which the law is linear.
    """

    a: Volume | Holder
    b: Volume | Holder
    _: KW_ONLY
    area: float | Callable[[float], float] | Ring
    discharge_coefficient: float = 1.0
    laminar: float = 1e-5
    name: str = "orifice"
    scalar_unknowns = GasNetwork

    def __post_init__(self) -> None:
        for end in (self.a, self.b):
            check(
                getattr(end, "scalar_unknowns", None) is GasNetwork
                and not isinstance(end, Orifice),
                f"Orifice '{self.name}': {end!r} holds no gas; connect chambers, tanks, reservoirs or surroundings.",
            )
        check(
            self.a is not self.b,
            f"Orifice '{self.name}' leads from '{self.a.name}' back into it.",
        )
        check(
            isinstance(self.area, Ring) or callable(self.area) or 0 <= self.area < math.inf,
            f"Orifice '{self.name}': area is {self.area!r} m²; give a positive number, a function of time, or a ring.",
        )
        check(
            0 < self.discharge_coefficient <= 1,
            f"Orifice '{self.name}': discharge_coefficient is {self.discharge_coefficient!r}; it lies in (0, 1].",
        )
        check(
            0 < self.laminar < 0.1,
            f"Orifice '{self.name}': laminar is {self.laminar!r}; give a small fraction such as 1e-5.",
        )

    def requires(self) -> Iterable[Any]:
        yield self.a
        yield self.b
        if isinstance(self.area, Ring):
            yield from self.area.requires()

    def aperture(self, geometry: Geometry) -> Aperture:
        """C_d A [m²] of a step of length h whose middle is at time t."""
        cd, area = self.discharge_coefficient, self.area
        if isinstance(area, Ring):
            loop = geometry.loop(area)
            return lambda h, t: cd * loop.aperture(h)
        if callable(area):
            return lambda h, t: cd * self._opening(geometry.comm, area, t)
        return lambda h, t: cd * area

    def _opening(self, comm: MPI.Intracomm, area: Callable[[float], float], t: float) -> float:
        what = f"Orifice '{self.name}': its area at t = {t:.6g} s"
        opening = float(ask_numbers(comm, what, lambda: area(t)))
        check(opening >= 0, f"{what} is {opening!r} m²; give one that is not negative.")
        return opening

    def flow(
        self, gas: IdealGas, area: float, p: tuple[complex, complex], T: tuple[complex, complex]
    ) -> complex:
        """Mass flow [kg/s] from a to b at pressures p and temperatures T of the two ends."""
        if p[0].real >= p[1].real:
            return area * isentropic_flow(gas, p[0], T[0], p[1], self.laminar)
        return -area * isentropic_flow(gas, p[1], T[1], p[0], self.laminar)


@check_arguments
@dataclass(frozen=True, eq=False)
class WallHeat:
    """Heat from a wall into a chamber: conductance (T_wall - T), booked as supplied.

    Args:
        chamber: the chamber.
        conductance: heat transfer coefficient times area [W/K].
        temperature: of the wall [K].
    """

    chamber: Chamber
    conductance: float
    _: KW_ONLY
    temperature: float
    name: str = "wall"
    scalar_unknowns = GasNetwork

    def __post_init__(self) -> None:
        check(
            0 <= self.conductance < math.inf and 0 < self.temperature < math.inf,
            f"WallHeat '{self.name}': conductance {self.conductance!r} W/K and temperature {self.temperature!r} K must "
            "be positive.",
        )

    def requires(self) -> Iterable[Any]:
        yield self.chamber
