"""Sections of beams: their stiffness and inertia."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass
from typing import Annotated

from gossamer_fx.core.checks.arguments import Range, check_arguments, positive
from gossamer_fx.core.checks.relations import below

__all__ = ["Section", "rectangle", "solid_circle", "tube"]

Length = Annotated[float, positive("m")]
Modulus = Annotated[float, positive("Pa")]
Density = Annotated[float, positive("kg/m³")]
PoissonsRatio = Annotated[float, Range(-1.0, 0.5, above=True)]


@check_arguments
@dataclass(frozen=True)
class Section:
    """Stiffness and mass of a beam's section with principal axes along the directors d2, d3.

    Args:
        EA: axial stiffness [N].
        GA2: shear stiffness along d2 [N], including the shear coefficient.
        GA3: shear stiffness along d3 [N].
        EI2: E∫X2² dA [N m²]: bending in the plane of the tangent and d2.
        EI3: E∫X3² dA [N m²]: bending in the plane of the tangent and d3.
        GJ: torsional stiffness [N m²].
        line_density: mass per length [kg/m].
        rotary2: ρ∫X2² dA [kg m].
        rotary3: ρ∫X3² dA [kg m].

    Raises:
        InputError: a value is not positive.

    Example:
        >>> boom = gx.sections.Section(
        ...     EA=1e6, GA2=2e5, GA3=2e5, EI2=50.0, EI3=50.0, GJ=10.0,
        ...     line_density=0.1, rotary2=1e-5, rotary3=1e-5,
        ... )
        >>> boom.EI2
        50.0
    """

    _: KW_ONLY
    EA: Annotated[float, positive("N")]
    GA2: Annotated[float, positive("N")]
    GA3: Annotated[float, positive("N")]
    EI2: Annotated[float, positive("N m²")]
    EI3: Annotated[float, positive("N m²")]
    GJ: Annotated[float, positive("N m²")]
    line_density: Annotated[float, positive("kg/m")]
    rotary2: Annotated[float, positive("kg m")]
    rotary3: Annotated[float, positive("kg m")]


def _of_shape(
    E: float, nu: float, density: float, A: float, I2: float, I3: float, J: float, k: float
) -> Section:
    """Section of isotropic material with the area A [m²], the second moments I2 = ∫X2² dA and I3
    [m⁴], the torsion constant J [m⁴] and the shear coefficient k."""
    G = E / (2 * (1 + nu))
    return Section(
        EA=E * A,
        GA2=k * G * A,
        GA3=k * G * A,
        EI2=E * I2,
        EI3=E * I3,
        GJ=G * J,
        line_density=density * A,
        rotary2=density * I2,
        rotary3=density * I3,
    )


@check_arguments
def solid_circle(radius: Length, *, E: Modulus, nu: PoissonsRatio, density: Density) -> Section:
    """Circular section; shear coefficient 6(1+ν)/(7+6ν) (Cowper, J. Appl. Mech. 33 (1966) 335).

    Args:
        radius: [m].
        E: Young's modulus [Pa].
        nu: Poisson's ratio, in (-1, 0.5].
        density: [kg/m³].

    Raises:
        InputError: a value is not positive, or nu is out of range.

    Example:
        >>> section = gx.sections.solid_circle(0.01, E=70e9, nu=0.33, density=2700.0)
        >>> round(section.line_density, 3)
        0.848
    """
    second = math.pi * radius**4 / 4
    k = 6 * (1 + nu) / (7 + 6 * nu)
    return _of_shape(E, nu, density, math.pi * radius**2, second, second, 2 * second, k)


@check_arguments(
    below("wall_thickness", "outer_radius", give="a thinner wall, or use solid_circle")
)
def tube(
    outer_radius: Length, wall_thickness: Length, *, E: Modulus, nu: PoissonsRatio, density: Density
) -> Section:
    """Section of a circular tube.

    With the ratio m of inner and outer radius, the shear coefficient is
    6(1+ν)(1+m²)²/((7+6ν)(1+m²)² + (20+12ν)m²) (Cowper 1966).

    Args:
        outer_radius: [m].
        wall_thickness: [m], less than the outer radius.
        E, nu, density: as of `solid_circle`.

    Raises:
        InputError: a value is not positive, or out of range.

    Example:
        >>> section = gx.sections.tube(0.02, 5e-4, E=100e9, nu=0.3, density=1560.0)
        >>> round(section.line_density, 4)
        0.0968
    """
    inner = outer_radius - wall_thickness
    area = math.pi * (outer_radius**2 - inner**2)
    second = math.pi * (outer_radius**4 - inner**4) / 4
    m2 = (inner / outer_radius) ** 2
    k = 6 * (1 + nu) * (1 + m2) ** 2 / ((7 + 6 * nu) * (1 + m2) ** 2 + (20 + 12 * nu) * m2)
    return _of_shape(E, nu, density, area, second, second, 2 * second, k)


@check_arguments
def rectangle(
    width2: Length, width3: Length, *, E: Modulus, nu: PoissonsRatio, density: Density
) -> Section:
    """Rectangular section; shear coefficient 10(1+ν)/(12+11ν) (Cowper 1966).

    Its torsion constant is J = a b³ (1/3 - 64 b/(π⁵ a) Σ tanh(nπa/(2b))/n⁵), odd n, with the sides
    a ≥ b (Saint-Venant's series; Timoshenko & Goodier, Theory of Elasticity, § 109).

    Args:
        width2: along d2 [m].
        width3: along d3 [m].
        E, nu, density: as of `solid_circle`.

    Raises:
        InputError: a value is not positive, or nu is out of range.

    Example:
        >>> section = gx.sections.rectangle(0.02, 0.01, E=70e9, nu=0.33, density=2700.0)
        >>> round(section.EA)
        14000000
    """
    a, b = max(width2, width3), min(width2, width3)
    series = sum(math.tanh(n * math.pi * a / (2 * b)) / n**5 for n in range(1, 100, 2))
    J = a * b**3 * (1 / 3 - 64 * b / (math.pi**5 * a) * series)
    k = 10 * (1 + nu) / (12 + 11 * nu)
    return _of_shape(E, nu, density, a * b, width3 * width2**3 / 12, width2 * width3**3 / 12, J, k)
