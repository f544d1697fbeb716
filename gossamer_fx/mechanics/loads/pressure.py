"""Pressure on films: a prescribed one, or that of a heavy fluid at rest, which is the weight of gas
inside or the lift of air outside.

A pressure p presses on the deformed film along its normal n,

    δW = ∫ p n·w da                                                                              (1)

`Pressure` has one p on all of the film, a number or a function of time.  `FluidPressure` has the
p(z) of a fluid at rest, dp/dz = -ρ g, that presses along n from inside, and with the opposite sign
from outside.  On a closed film its resultant is the weight of the fluid inside, or the lift of the
fluid that the film displaces.  For one p, and for a uniform density, (1) is integrated exactly.

A balloon is a `Chamber` whose outside is a vacuum, with the `FluidPressure` of an atmosphere from
outside.  When it rises the pressure outside falls, and its gas expands.  The weight of its gas is
that of a `UniformFluid` from inside as long as its level is near; a film that rises far, as that of
the demo `rising_balloon`, has the mass of the gas instead.

Limits.  The fluid has no inertia: a sphere in air carries half of the mass along that it displaces.
It has no drag either; see `AirDrag`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import ufl
from dolfinx.mesh import Mesh

from gossamer_fx.core.checks.arguments import Range, check_arguments, not_negative, positive
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.forms.compilation import constant
from gossamer_fx.core.forms.kinematics import Expr, area_vector
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import OnBody, Parameter, Term
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.terms.loads import Load, in_time


@check_arguments
@dataclass(frozen=True, eq=False)
class Pressure(OnBody):
    """A pressure along the deformed normal of a film: δW = p ∫n·w da.

    Args:
        body: a film or plate.
        pressure: p [Pa], positive along the normal of the mesh; a number or a function of time [s].
        name: name in messages and output.

    Raises:
        InputError: a number that is not finite.

    Example:
        >>> gx.Pressure(film, lambda t: 100.0 * min(t, 1.0)).name
        'pressure'
    """

    # Suction is a negative pressure.  1e9 Pa tears any film: a value beyond it is one in a wrong
    # unit.
    USUAL: ClassVar = {"pressure": (-1e9, 1e9, "Pa", "")}

    body: Membrane
    pressure: float | Callable[[float], float]
    _: KW_ONLY
    name: str = "pressure"

    def terms(self, start: State) -> Iterable[Term]:
        film = self.body
        value = self.pressure
        mesh = film.space.mesh
        # p [Pa] is the given pressure; a function of time is evaluated first by `at`.
        p = constant(mesh, 0.0 if callable(value) else value)
        pressure: Expr = p
        at = None
        parameters = (Parameter("pressure", "Pa", p),)
        if callable(value):
            # A function of time belongs to its user; a gradient has the number that multiplies it.
            factor = constant(mesh, 1.0)
            pressure = factor * p
            at = in_time(film.comm, f"Pressure '{self.name}'", value, p)
            parameters = (Parameter("factor", "", factor),)
        # Exact: the area vector is a product of two gradients, and w has the order of the film.
        degree = 2 * (film.order - 1) + film.order
        dx = film.surface_measure(degree)

        def work(x: Expr, w: Expr) -> ufl.Form:
            """δW [J] at positions x along test functions w."""
            # The area vector is n da/dA: the integral over the mesh is one over the deformed film.
            return pressure * ufl.dot(area_vector(film.deformation(x)), w) * dx

        yield Load(self.name, film, work, follows=True, at=at, parameters=parameters)


STANDARD_GRAVITY = 9.80665  # m/s²
GAS_CONSTANT = 287.05287  # J/(kg K), of dry air


class Profile(NamedTuple):
    """The pressure [Pa] of a fluid as a function of the height z [m] in UFL, its degree as a
    polynomial of z, and the numbers by which results can be derived."""

    pressure: Callable[[Expr], Expr]
    degree: int
    parameters: tuple[Parameter, ...]


class Fluid(ABC):
    """A fluid at rest."""

    @abstractmethod
    def profile(self, g: float, mesh: Mesh) -> Profile:
        """The pressure under the acceleration g [m/s²] of gravity, with constants of a mesh."""


@check_arguments
@dataclass(frozen=True)
class UniformFluid(Fluid):
    """A fluid of uniform density: p = p0 - ρ g (z - level), a liquid, or gas of little height.

    Args:
        density: ρ [kg/m³].
        pressure: p0 [Pa] at the level.
        level: height [m] at which the pressure is p0.

    Raises:
        InputError: a density that is not positive, a negative pressure.

    Example:
        >>> air = gx.loads.UniformFluid(1.225, pressure=101325.0)
        >>> load = gx.loads.FluidPressure(film, air, side="outside")
    """

    USUAL: ClassVar = {"density": (1e-6, 2e4, "kg/m³", "")}

    density: Annotated[float, positive("kg/m³")]
    _: KW_ONLY
    pressure: Annotated[float, not_negative("Pa")] = 0.0
    level: float = 0.0

    def profile(self, g: float, mesh: Mesh) -> Profile:
        """The straight line of p."""
        ρ = constant(mesh, self.density)
        p0 = constant(mesh, self.pressure)
        level = constant(mesh, self.level)
        gravity = constant(mesh, g)
        parameters = (Parameter("density", "kg/m³", ρ), Parameter("pressure", "Pa", p0))
        return Profile(lambda z: p0 - ρ * gravity * (z - level), 1, parameters)


class _Layer(NamedTuple):
    """A layer of the atmosphere: geopotential altitudes [m] of its bottom and top, temperature [K]
    and pressure [Pa] at the bottom, and the rise of the temperature with the altitude [K/m]."""

    bottom: float
    top: float
    temperature: float
    pressure: float
    lapse: float


# U.S. Standard Atmosphere 1976, NASA-TM-X-74335, table 4 and eqs. 33a and 33b; ISO 2533.
LAYERS = (
    _Layer(-5e3, 11e3, 288.15, 101325.0, -6.5e-3),
    _Layer(11e3, 20e3, 216.65, 22632.06, 0.0),
    _Layer(20e3, 32e3, 216.65, 5474.889, 1e-3),
    _Layer(32e3, 47e3, 228.65, 868.0187, 2.8e-3),
    _Layer(47e3, 51e3, 270.65, 110.9063, 0.0),
    _Layer(51e3, 71e3, 270.65, 66.93887, -2.8e-3),
    _Layer(71e3, 84852.0, 214.65, 3.956420, -2e-3),
)
LOWEST = LAYERS[0].bottom
HIGHEST = LAYERS[-1].top


@check_arguments
@dataclass(frozen=True)
class StandardAtmosphere(Fluid):
    """The standard atmosphere of 1976, to a height of 86 km.

    Called with geopotential altitudes [m], between -5 km and 84.852 km, it returns pressures.
    Films beyond these have the pressure of the nearest of them, 0.373 Pa above.  Temperatures are
    those of the molecular scale, which above 80 km are up to 0.05 % higher.

    Args:
        altitude: geopotential altitude [m] of z = 0.

    Example:
        >>> round(float(gx.loads.StandardAtmosphere()(5000.0)), 1)
        54019.9
        >>> round(float(gx.loads.StandardAtmosphere().density(5000.0)), 5)
        0.73612

    Source: U.S. Standard Atmosphere, NASA-TM-X-74335 (1976).
    """

    altitude: Annotated[float, Range(LOWEST, HIGHEST, unit="m")] = 0.0

    def __call__(self, altitude: float) -> float:
        """Pressure [Pa] at a geopotential altitude [m]."""
        layer = _layer_at(altitude)
        return float(_pressure(layer, altitude, math.exp, math.log))

    def temperature(self, altitude: float) -> float:
        """Temperature [K] at a geopotential altitude [m]."""
        layer = _layer_at(altitude)
        return layer.temperature + layer.lapse * (altitude - _base(layer))

    def density(self, altitude: float) -> float:
        """Density [kg/m³] at a geopotential altitude [m]."""
        return self(altitude) / (GAS_CONSTANT * self.temperature(altitude))

    def profile(self, g: float, mesh: Mesh) -> Profile:
        """The pressure by layers; gravity is that of the standard, whatever g is."""
        start = constant(mesh, self.altitude)

        def pressure(z: Expr) -> Expr:
            altitude = z + start
            found = None
            # From the highest layer down.  Altitudes are limited to those of each layer: outside,
            # its linear temperature may be negative, of which there is no logarithm.
            for layer in reversed(LAYERS):
                within = ufl.max_value(layer.bottom, ufl.min_value(layer.top, altitude))
                here = _pressure(layer, within, ufl.exp, ufl.ln)
                if found is None:
                    found = here
                else:
                    found = ufl.conditional(ufl.gt(altitude, layer.top), found, here)
            return found

        # Over the height of a balloon it is nearly a straight line, so that degree 2 is enough.
        return Profile(pressure, 2, ())


def _layer_at(altitude: float) -> _Layer:
    """The layer of an altitude [m].  `InputError`: it is outside of all of them."""
    check(
        LOWEST <= altitude <= HIGHEST,
        f"StandardAtmosphere: altitude is {altitude:g} m; it is known from {LOWEST:g} to "
        f"{HIGHEST:g} m.",
    )
    return next(layer for layer in LAYERS if altitude <= layer.top)


def _base(layer: _Layer) -> float:
    """The altitude [m] at which the temperature and pressure of a layer are given: its bottom, or
    sea level."""
    return max(layer.bottom, 0.0)


def _pressure(
    layer: _Layer, altitude: Expr, exp: Callable[[Any], Any], ln: Callable[[Any], Any]
) -> Any:
    """Pressure [Pa] at an altitude [m] within a layer, with the functions of its kind of
    number."""
    height = altitude - _base(layer)
    scale = STANDARD_GRAVITY / GAS_CONSTANT
    if layer.lapse == 0:
        return layer.pressure * exp(-scale * height / layer.temperature)
    ratio = 1 + layer.lapse * height / layer.temperature
    return layer.pressure * exp(-scale / layer.lapse * ln(ratio))


@check_arguments
@dataclass(frozen=True, eq=False)
class FluidPressure(OnBody):
    """The pressure p(z) of a fluid at rest on one side of a film: δW = ± ∫p(z) n·w da, with + from
    inside and - from outside, n the normal of the deformed film.

    Args:
        body: a film or plate; the normals of its mesh point outwards.
        fluid: `UniformFluid`, `StandardAtmosphere`, or an object with their method `profile`.
        side: where the fluid is, "inside" or "outside".
        g: acceleration [m/s²] of gravity, along -z.
        name: in messages and output.

    Raises:
        InputError: another side.

    Example:
        >>> air = gx.loads.FluidPressure(film, gx.loads.StandardAtmosphere(), side="outside")
        >>> air.name
        'outside fluid'
    """

    body: Membrane
    fluid: Fluid
    _: KW_ONLY
    side: Literal["inside", "outside"]
    g: Annotated[float, not_negative("m/s²")] = STANDARD_GRAVITY
    name: str = ""

    def __post_init__(self) -> None:
        if not self.name:
            object.__setattr__(self, "name", f"{self.side} fluid")

    def terms(self, start: State) -> Iterable[Term]:
        film = self.body
        mesh = film.space.mesh
        sign = constant(mesh, 1.0 if self.side == "inside" else -1.0)
        profile = self.fluid.profile(self.g, mesh)
        # The area vector is a product of two gradients; w has the order of the film, as z has.
        degree = 2 * (film.order - 1) + film.order * (1 + profile.degree)
        dx = film.surface_measure(degree)

        def work(x: Expr, w: Expr) -> ufl.Form:
            """δW [J] at positions x along test functions w."""
            normal = area_vector(film.deformation(x))  # n da/dA
            return sign * profile.pressure(x[2]) * ufl.dot(normal, w) * dx

        yield Load(self.name, film, work, follows=True, parameters=profile.parameters)
