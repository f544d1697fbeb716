"""Film law whose wrinkles resist compression like buckled strips (extensible elastica).

Problem.  A compressed film wrinkles, and its wrinkles keep a small compressive stress.  The law
needs that stress as a function of the mean compressive strain.

Model.  A pinned strip of half wavelength L, thickness t and plane-strain modulus E' = E/(1-ν²)
carries the load P.  With

    p = P/(E' t),    e_E = π² t²/(12 L²)    (Euler's strain),                                    (1)

it is straight up to p = e_c, the solution of

    p (1 - p) = e_E.                                                                             (2)

Beyond, it has the end slope α.  With k = sin(α/2) and sin(θ/2) = k sin φ, its load p and shortening
δ obey (Magnusson et al.)

    1 = c I[1],    1 - δ = c I[(1 - p cos θ) cos θ],    c = 2√(2 e_E)/(π√p),                     (3)

    I[f] = ∫₀^{π/2} f dφ / (√(1 - k² sin²φ) √(2 - p (cos θ + cos α))).                           (4)

Algorithm.

1. `buckled_strip` solves (3) for one end slope by a fixed-point iteration.
2. `cubic` fits P/P_c over the shortening by a cubic polynomial, once when a law is created.
3. `Elastica` uses the cubic as the stress below buckling, in closed form, so that UFL can derive
   the stress and the tangent.

Source: A. Magnusson, M. Ristinmaa & C. Ljung, Int. J. Solids Struct. 38 (2001) 8441.
"""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, field
from typing import Any

import numpy as np
import ufl

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.forms.kinematics import Expr, half_trace_and_radius
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.materials.film import SLACK, TAUT, WRINKLED, IsotropicFilm

# Shortening δ up to which the cubic is fitted to the elastica.
FITTED_UP_TO = 0.3

# Strain below which the compressive stress is constant, a strip that is 60 % shorter.  The cubic
# must not be extrapolated further, and the stretch √(1 + 2f) must stay real.
STEEPEST = -0.42

# Gauss points for the integrals (4), whose integrand is smooth.
INTEGRATION_POINTS = 64

# Steps of the fixed-point iteration for p.  Each reduces the error by the factor p, which is small.
FIXED_POINT_STEPS = 50

# End slopes α [rad] from which the cubic is fitted; the largest one shortens the strip by more than
# `FITTED_UP_TO`.
END_SLOPES = np.linspace(0.02, 1.2, 200)


def onset(e_E: float) -> float:
    """Buckling strain e_c of a strip, the smaller root of e_c (1 - e_c) = e_E.

    The load p = P/(E' t) at which it buckles is the same number.

    Args:
        e_E: Euler's strain π² t²/(12 L²) [-], at most 1/4.

    Raises:
        ValueError: e_E is above 1/4.

    >>> round(onset(0.09), 12)
    0.1
    """
    # The form of the root that does not subtract nearly equal numbers.
    return 2 * e_E / (1 + math.sqrt(1 - 4 * e_E))


def buckled_strip(e_E: float, α: float) -> tuple[float, float]:
    """Return the shortening and the relative load of a buckled strip, equations (3), (4) of the
    module.

    θ is the slope of the strip, of at most α, and φ with sin(θ/2) = sin(α/2) sin φ the variable of
    integration, from 0 to π/2. p is the load over the plane-strain stiffness of the strip [-], c a
    factor of (3), and I[f] the integral (4).

    Args:
        e_E: Euler's strain π² t²/(12 L²) [-] of a strip of thickness t and half wavelength L; > 0
            and at most 1/4.
        α: slope at the ends [rad], > 0.

    Returns:
        shortening δ over the length [-], and the load over that at the onset of buckling, P/P_c
        [-].

    Raises:
        ValueError: e_E is above 1/4.

    >>> δ, load = buckled_strip(1e-6, 0.1)
    >>> round(δ, 6), round(load, 6)
    (0.0025, 1.001251)
    """
    points, point_weights = np.polynomial.legendre.leggauss(INTEGRATION_POINTS)
    # From [-1, 1] to [0, π/2].
    φ = (points + 1) * math.pi / 4
    weights = point_weights * math.pi / 4
    k = math.sin(α / 2)
    sin_half_θ = k * np.sin(φ)
    cos_θ = 1 - 2 * sin_half_θ**2
    first_root = np.sqrt(1 - sin_half_θ**2)

    def integral(f: Array, p: float) -> float:
        """I[f], equation (4)."""
        second_root = np.sqrt(2 - p * (cos_θ + math.cos(α)))
        root = first_root * second_root
        return float(weights @ (f / root))

    # The first of equations (3) as p = (2√(2 e_E)/π I[1](p))².
    one = np.ones_like(φ)
    p = onset(e_E)
    for _ in range(FIXED_POINT_STEPS):
        square_root = 2 * math.sqrt(2 * e_E) / math.pi * integral(one, p)
        p = square_root**2
    c = 2 * math.sqrt(2 * e_E) / (math.pi * math.sqrt(p))
    projected_stretch = (1 - p * cos_θ) * cos_θ
    δ = 1 - c * integral(projected_stretch, p)
    relative_load = p / onset(e_E)
    return δ, relative_load


def cubic(e_E: float) -> tuple[float, float, float]:
    """Coefficients (c1, c2, c3) [-] of P/P_c = 1 + c1 x + c2 x² + c3 x³ with x = δ - e_c.

    They fit the relative loads P/P_c of `buckled_strip` over the shortening δ by least squares, for
    δ < `FITTED_UP_TO`; e_c is the strain at the onset of buckling.

    α are the end slopes [rad] of the buckled strips whose loads are fitted.

    Args:
        e_E: Euler's strain π² t²/(12 L²) [-], > 0 and at most 1/4.

    Raises:
        ValueError: e_E is above 1/4.
    """
    curve: Array = np.array([buckled_strip(e_E, α) for α in END_SLOPES])
    curve = curve[curve[:, 0] < FITTED_UP_TO]
    shortenings = curve[:, 0]
    loads = curve[:, 1]
    x = shortenings - onset(e_E)
    # Without a constant: the load is continuous at the onset of buckling.
    powers = np.column_stack([x, x**2, x**3])
    coefficients = np.linalg.lstsq(powers, loads - 1, rcond=None)[0]
    c1, c2, c3 = (float(c) for c in coefficients)
    return c1, c2, c3


@check_arguments
@dataclass(frozen=True)
class Elastica(IsotropicFilm):
    """Film whose wrinkles resist like buckled strips of its thickness and a given half wavelength
    L.

    With f = γ2 + ν γ1, the strain that bears on the strips, and σ1 = E γ1 + ν ψ'(f) the larger
    stress,

        σ1 ≥ 0          W/t = E γ1²/2 + ψ(f)       taut for f ≥ -e_w, wrinkled below
        σ1 < 0 ≤ γ1     W/t = U(γ2)                compressed one way, free in the other
        γ1 < 0          W/t = U(γ1) + U(γ2)        slack
        ψ' = E/(1-ν²) f            for f ≥ -e_w
        ψ' = -E/(1-ν²) e_w (λ_w/λ)(1 + c1 x + c2 x² + c3 x³) below,   λ = √(1 + 2f),  x = λ_w - λ

    where e_w = e_c and the cubic are those of the extensible elastica of the module: its nominal
    load at the shortening 1 - λ, as stress of the Green-Lagrange strain f.  U(γ2) = min over γ1 of
    Eγ1²/2 + ψ(f) is the energy without stress σ1.  W is C1 and convex, and symmetric where both
    strains are compressive.  Below f = -0.42 the stress is constant.

    A film has no bending stiffness: where it may leave its plane, this compressive stress makes
    waves of any length unstable, and the number of unstable directions grows like that of the cells
    (`demos/studies/elastica_cells.py`).  Hold a flat film in its plane, or take a `Plate` with this
    law, in which only waves longer than L are unstable.  Else take cells of not much less than
    half_wavelength/4: on the airbag of `demos/studies/airbag.py`, L = 0.1 m has an equilibrium with
    edges of 27 mm; with 13 mm, cells next to the seam fold up and no equilibrium is found, also
    with a `Plate`.

    Args:
        E: Young's modulus [Pa], positive.
        nu: Poisson's ratio, above -1 and at most 0.5.
        density: mass density ρ [kg/m³], positive.
        thickness: t [m], positive.
        half_wavelength: L [m], above 10 π t.

    Raises:
        InputError: a number out of its range.

    Example:
        >>> law = gx.Elastica(2.5e9, 0.34, density=1420.0, thickness=25e-6, half_wavelength=0.05)
        >>> f"{law.onset:.3e}"
        '2.056e-07'
    """

    _: KW_ONLY
    half_wavelength: float
    onset: float = field(init=False)
    c1: float = field(init=False)
    c2: float = field(init=False)
    c3: float = field(init=False)

    def __post_init__(self) -> None:
        """Check the arguments, and fit the cubic of the buckled strip, whose wrinkles the law
        describes.

        Sets `onset`, the strain at which the strip buckles [-], and the coefficients c1, c2, c3 [-]
        of the cubic law of its load, see `cubic`.

        Raises:
            InputError: a modulus, density or thickness that is not positive, nu outside (-1, 0.5],
                or a half wavelength [m] of not more than 10 π thicknesses.
        """
        super().__post_init__()
        shortest = 10 * math.pi * self.thickness
        check(
            math.isfinite(self.half_wavelength) and self.half_wavelength > shortest,
            f"Elastica: half_wavelength is {self.half_wavelength!r} m; a strip needs more than "
            f"{shortest:.3g} m, ten "
            "times pi its thickness.",
        )
        slenderness = math.pi * self.thickness / self.half_wavelength
        e_E = slenderness**2 / 12
        c1, c2, c3 = cubic(e_E)
        derived = {"onset": onset(e_E), "c1": c1, "c2": c2, "c3": c3}
        # The dataclass is frozen; these fields follow from the others.
        for name, value in derived.items():
            object.__setattr__(self, name, value)

    def energy(self, e: Expr, c: Any) -> Expr:
        """Stored energy W per reference area [J/m²] of a strain, as a UFL expression.

        h and r are centre and radius of Mohr's circle of e, γ1 ≥ γ2 the principal strains; f = γ2 +
        ν γ1 is the strain [-] across the direction of the larger stress, with ν the ratio of
        Poisson.

        Args:
            e: Green-Lagrange strain (E11, E22, 2 E12) [-].
            c: the numbers of the law as UFL constants, under their names.
        """
        h, r = half_trace_and_radius(e)
        γ1 = h + r
        γ2 = h - r
        f = γ2 + c.nu * γ1
        # Taut energy by trace and determinant, which are smooth where the principal strains
        # coincide.
        trace = e[0] + e[1]
        det = e[0] * e[1] - e[2] ** 2 / 4
        biaxial = trace**2 - 2 * (1 - c.nu) * det
        taut = c.E / (2 * (1 - c.nu**2)) * biaxial
        wrinkled = c.E * γ1**2 / 2 + _buckled(f, c)
        tensile = ufl.conditional(ufl.ge(f, -c.onset), taut, wrinkled)
        one_way = _unloaded(γ2, c)
        both_ways = _unloaded(γ1, c) + _unloaded(γ2, c)
        slack = ufl.conditional(ufl.ge(γ1, 0), one_way, both_ways)
        is_tensile = ufl.ge(self._larger_stress(γ1, f, c), 0)
        return c.thickness * ufl.conditional(is_tensile, tensile, slack)

    def state(self, e: Expr, c: Any) -> Expr:
        """State of the film at a strain, `TAUT`, `WRINKLED` or `SLACK`, as a UFL expression.

        h and r are centre and radius of Mohr's circle of e, γ1 ≥ γ2 the principal strains; f = γ2 +
        ν γ1 is the strain [-] across the direction of the larger stress, with ν the ratio of
        Poisson.

        Args:
            e: Green-Lagrange strain (E11, E22, 2 E12) [-].
            c: the numbers of the law as UFL constants, under their names.
        """
        h, r = half_trace_and_radius(e)
        γ1 = h + r
        γ2 = h - r
        f = γ2 + c.nu * γ1
        tensile = ufl.conditional(ufl.ge(f, -c.onset), TAUT, WRINKLED)
        is_tensile = ufl.ge(self._larger_stress(γ1, f, c), 0)
        return ufl.conditional(is_tensile, tensile, SLACK)

    def _larger_stress(self, γ1: Expr, f: Expr, c: Any) -> Expr:
        """Larger principal stress σ1 = E γ1 + ν ψ'(f) [Pa] of a film with straight or buckled
        strips.

        ψ(f) is the energy density [J/m³] of a strip and ψ'(f) [Pa] its stress, E Young's modulus
        and ν Poisson's ratio.

        Args:
            γ1: larger principal strain [-].
            f: strain γ2 + ν γ1 that bears on the strips [-], γ2 the smaller principal strain.
        """
        buckled = c.onset * _relative_load(f, c)
        is_straight = ufl.ge(f, -c.onset)
        compression = ufl.conditional(is_straight, -f, buckled)
        along = c.E * γ1
        # The second term is ν ψ'(f): the stress of the strips, by Poisson's effect.
        return along - c.nu * c.E / (1 - c.nu**2) * compression


def _stretch(f: Expr) -> Expr:
    """Stretch λ = √(1 + 2f) of a strip with the Green-Lagrange strain f, which is limited to
    `STEEPEST`.
    """
    return ufl.sqrt(1 + 2 * ufl.max_value(f, STEEPEST))


def _relative_load(f: Expr, c: Any) -> Expr:
    """Stress of the buckled strip at the strain f, over its stress at the onset of buckling [-].

    Args:
        f: Green-Lagrange strain of the strip [-]; below `STEEPEST` the stress is constant.
        c: strain `onset` of buckling [-], and coefficients c1, c2, c3 [-] of the load beyond it, as
            UFL constants.
    """
    λ_w = ufl.sqrt(1 - 2 * c.onset)
    λ = _stretch(f)
    x = λ_w - λ
    nominal_load = 1 + x * (c.c1 + x * (c.c2 + x * c.c3))
    # λ_w/λ turns the nominal load of the strip into the stress that is conjugate to f.
    return λ_w / λ * nominal_load


def _buckled(f: Expr, c: Any) -> Expr:
    """Energy density ψ(f) [J/m³] of a buckled strip, for a strain f below -e_w.

    e_w is the compressive strain at which the strip buckles; ψ is zero at f = 0.

    Args:
        f: Green-Lagrange strain of the strip [-].
    """
    λ_w = ufl.sqrt(1 - 2 * c.onset)
    x = λ_w - _stretch(f)
    # The integral of the cubic, as of the nominal load over the shortening.
    mean_load = 1 + x * (c.c1 / 2 + x * (c.c2 / 3 + x * c.c3 / 4))
    work = λ_w * x * mean_load
    # Below `STEEPEST` the stress is constant.
    beyond = _relative_load(f, c) * (ufl.max_value(f, STEEPEST) - f)
    straight = c.onset**2 / 2
    return c.E / (1 - c.nu**2) * (straight + c.onset * (work + beyond))


def _unloaded(γ: Expr, c: Any) -> Expr:
    """Energy density U(γ) [J/m³] of strips with the strain γ along them and no stress across.

    Without stress across, the strain across is γ1 = -ν ψ'(f)/E, with Poisson's ratio ν, Young's
    modulus E, the strain f = γ + ν γ1 that bears on the strips, and the energy density ψ(f) [J/m³]
    of a strip, whose derivative ψ'(f) [Pa] is its stress.  Strips buckle at f = -e_w.  They are
    straight, or buckled with

        f = γ + κ ψ'(f)/ψ'(-e_w),    κ = ν² e_w/(1 - ν²).

    One iteration solves this equation: the second one would change the stress by less than E e_w³.

    Args:
        γ: Green-Lagrange strain along the strips [-].
    """
    κ = c.nu**2 * c.onset / (1 - c.nu**2)
    # The iteration starts with the load at the onset of buckling, where the relative load is 1.
    f = γ + κ * _relative_load(γ + κ, c)
    # The strain γ1 across the strips at which σ1 vanishes.
    γ1 = c.nu * c.onset / (1 - c.nu**2) * _relative_load(f, c)
    straight = c.E * γ**2 / 2
    buckled = c.E * γ1**2 / 2 + _buckled(f, c)
    onset_without_stress = -c.onset / (1 - c.nu**2)
    is_straight = ufl.ge(γ, onset_without_stress)
    return ufl.conditional(is_straight, straight, buckled)
