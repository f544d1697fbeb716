"""Long thin pipes between volumes: adiabatic flow with friction (Fanno flow)."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Annotated

import numpy as np

from gossamer_fx.core.algebra.dual_numbers import Number, log
from gossamer_fx.core.checks.arguments import Range, check_arguments, positive
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.gas.connection import PassiveOpening
from gossamer_fx.mechanics.gas.contract import Aperture, Gas
from gossamer_fx.mechanics.gas.orifice import MAX_LAMINAR, MIN_LAMINAR
from gossamer_fx.mechanics.gas.surface import Geometry

# Bisections of Mach numbers in (0, 1): the last Newton iterations start with 1e-6 of the solution.
BISECTIONS = 20

# Newton iterations after them.  They square the error; the last two carry the first and second
# derivatives of complex and dual numbers.
POLISHING = 4

# Step of derivatives by complex steps
COMPLEX_STEP = 1e-30


def friction_parameter(gamma: Number, M: Number) -> Number:
    """f L*/D of the pipe that chokes a flow of the Mach number M (Shapiro, Dynamics and
    Thermodynamics of Compressible Fluid Flow, 1953, ch. 6), f the friction factor of Darcy:

        (1 - M²)/(γ M²) + (γ + 1)/(2 γ) ln((γ + 1) M²/(2 + (γ - 1) M²))

    >>> round(friction_parameter(1.4, 0.2), 3)
    14.533
    """
    square = M * M
    ratio = (gamma + 1) * square / (2 + (gamma - 1) * square)
    return (1 - square) / (gamma * square) + (gamma + 1) / (2 * gamma) * log(ratio)


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
    laminar: Annotated[float, Range(MIN_LAMINAR, MAX_LAMINAR)] = 1e-5
    name: str = "pipe"

    def aperture(self, geometry: Geometry) -> Aperture:
        """The cross section [m²], always the same."""
        return lambda h, t: np.pi / 4 * self.diameter**2

    def flux(self, gas: Gas, pu: Number, Tu: Number, pd: Number) -> Number:
        """(2) over the cross section [kg/(s m²)]."""
        if pu.real <= 0:
            return 0.0
        γ = gas.heat_ratio(Tu)
        scale = pu * (γ / (gas.R * Tu)) ** 0.5
        x = pd / pu
        if (1 - x).real >= self.laminar:
            return scale * self._mass_number(γ, x)
        # ṁ grows as √(1 - x): the odd cubic with the value and the slope of that at the limit
        ξ = (1 - x) / self.laminar
        return scale * self._mass_number(γ, 1 - self.laminar) * (1.25 * ξ - 0.25 * ξ**3)

    def _mass_number(self, γ: Number, x: Number) -> Number:
        """The factor of Mach numbers in (2) at the ratio x of the pressures."""
        resistance = self.friction * self.length / self.diameter
        # (1) is solved in real numbers first.
        γ_value = float(_value(γ))
        ratio = float(_value(x))
        low = 0.0
        high = 1.0
        first = _inlet(γ_value, resistance, high)
        is_choked = ratio <= 0 or _pressure_excess(γ_value, ratio, first, high) >= 0
        for _ in range(0 if is_choked else BISECTIONS):
            middle = (low + high) / 2
            if _pressure_excess(γ_value, ratio, _inlet(γ_value, resistance, middle), middle) > 0:
                low = middle
            else:
                high = middle
        M: list[Number] = [_inlet(γ_value, resistance, high), high]

        def residual(γ: Number, x: Number, M1: Number, M2: Number) -> list[Number]:
            friction = friction_parameter(γ, M1) - friction_parameter(γ, M2) - resistance
            if is_choked:
                return [friction, M2 - 1]
            return [friction, _pressure_excess(γ, x, M1, M2)]

        for _ in range(POLISHING):
            values = [float(_value(number)) for number in M]
            matrix = np.zeros((2, 2))
            for column in range(2):
                varied: list[Number] = list(values)
                varied[column] += 1j * COMPLEX_STEP
                slopes = residual(γ_value, ratio, *varied)
                matrix[:, column] = [np.imag(slope) / COMPLEX_STEP for slope in slopes]
            inverse: Array = np.linalg.inv(matrix)
            excess = residual(γ, x, *M)
            M = [
                M[row] - (inverse[row, 0] * excess[0] + inverse[row, 1] * excess[1])
                for row in range(2)
            ]
        total = 1 + (γ - 1) / 2 * M[0] * M[0]
        return M[0] * total ** (-(γ + 1) / (2 * (γ - 1)))


def _pressure_excess(γ: Number, x: Number, M1: Number, M2: Number) -> Number:
    """ln of the pressure at the end of the pipe over that of (1), x times the one upstream."""
    first = 2 + (γ - 1) * M1 * M1
    last = 2 + (γ - 1) * M2 * M2
    inlet = -γ / (γ - 1) * log(first / 2)
    return inlet + log(M1 / M2) + log(first / last) / 2 - log(x)


def _inlet(γ: float, resistance: float, M2: float) -> float:
    """M1 of (1) for M2."""
    target = resistance + float(friction_parameter(γ, M2))
    s = np.log(M2)
    # F is convex in ln M: from the left Newton's method converges without overshoot.
    while friction_parameter(γ, float(np.exp(s))) < target:
        s -= 1.0
    for _ in range(BISECTIONS):
        square = float(np.exp(2 * s))
        slope = -4 * (1 - square) / (γ * square * (2 + (γ - 1) * square))
        update = (friction_parameter(γ, float(np.exp(s))) - target) / slope
        s -= update
        if abs(update) < 1e-14:
            break
    return float(np.exp(s))


def _value(number: Number) -> Number:
    """The real value of a real, complex or dual number."""
    real = number.real
    return getattr(real, "value", real)
