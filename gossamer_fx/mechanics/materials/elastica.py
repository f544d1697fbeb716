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
from gossamer_fx.mechanics.materials.film import SLACK, TAUT, WRINKLED, IsotropicFilm, invariants

# Shortening δ up to which the cubic is fitted to the elastica.
FITTED_UP_TO = 0.3

# Strain below which the compressive stress is constant, a strip that is 60 % shorter.  The cubic
# must not be extrapolated further, and the stretch √(1 + 2f) must stay real.
STEEPEST = -0.42

# Gauss points for the integrals (4), whose integrand is smooth.
INTEGRATION_POINTS = 64

# The same points and weights for all strips: to find them took most of the time of `cubic`.
GAUSS_POINTS, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(INTEGRATION_POINTS)

# Steps of the fixed-point iteration for p.  Each reduces the error by the factor p, which is small.
FIXED_POINT_STEPS = 50

# End slopes α [rad] from which the cubic is fitted; the largest one shortens the strip by more than
# `FITTED_UP_TO`.
END_SLOPES = np.linspace(0.02, 1.2, 200)


def onset(e_E: float) -> float:
    """Buckling strain e_c of a strip with Euler's strain e_E ≤ ¼, the smaller root of (2); the load
    p at which it buckles is the same number.

    >>> round(onset(0.09), 12)
    0.1
    """
    # The form of the root that does not subtract nearly equal numbers.
    return 2 * e_E / (1 + math.sqrt(1 - 4 * e_E))


def buckled_strip(e_E: float, α: float) -> tuple[float, float]:
    """Shortening δ and relative load P/P_c of a buckled strip with Euler's strain e_E ≤ ¼ and the
    slope α > 0 [rad] at its ends, equations (3) and (4) of the module.

    >>> δ, load = buckled_strip(1e-6, 0.1)
    >>> round(δ, 6), round(load, 6)
    (0.0025, 1.001251)
    """
    # From [-1, 1] to [0, π/2].
    φ = (GAUSS_POINTS + 1) * math.pi / 4
    weights = GAUSS_WEIGHTS * math.pi / 4
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
    """Coefficients (c1, c2, c3) of P/P_c = 1 + c1 x + c2 x² + c3 x³ with x = δ - e_c.

    They fit the relative loads of `buckled_strip` over the shortening δ < `FITTED_UP_TO` by least
    squares.
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
        E, nu, density, thickness: as of `Linear`.
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
        super().__post_init__()
        shortest = 10 * math.pi * self.thickness
        check(
            math.isfinite(self.half_wavelength) and self.half_wavelength > shortest,
            f"Elastica: half_wavelength is {self.half_wavelength!r} m; "
            f"a strip needs more than {shortest:.3g} m, ten times pi its thickness.",
        )
        slenderness = math.pi * self.thickness / self.half_wavelength
        e_E = slenderness**2 / 12
        c1, c2, c3 = cubic(e_E)
        derived = {"onset": onset(e_E), "c1": c1, "c2": c2, "c3": c3}
        # The dataclass is frozen; these fields follow from the others.
        for name, value in derived.items():
            object.__setattr__(self, name, value)

    def energy(self, e: Expr, c: Any) -> Expr:
        γ1, γ2, f = _strains(e, c)
        # By trace and determinant, which are smooth where the principal strains coincide.
        trace, det = invariants(e)
        taut = c.E / (2 * (1 - c.nu**2)) * (trace**2 - 2 * (1 - c.nu) * det)
        wrinkled = c.E * γ1**2 / 2 + _buckled(f, c)
        tensile = ufl.conditional(ufl.ge(f, -c.onset), taut, wrinkled)
        one_way = _unloaded(γ2, c)
        both_ways = _unloaded(γ1, c) + _unloaded(γ2, c)
        slack = ufl.conditional(ufl.ge(γ1, 0), one_way, both_ways)
        is_tensile = ufl.ge(self._larger_stress(γ1, f, c), 0)
        return c.thickness * ufl.conditional(is_tensile, tensile, slack)

    def state(self, e: Expr, c: Any) -> Expr:
        γ1, _, f = _strains(e, c)
        tensile = ufl.conditional(ufl.ge(f, -c.onset), TAUT, WRINKLED)
        is_tensile = ufl.ge(self._larger_stress(γ1, f, c), 0)
        return ufl.conditional(is_tensile, tensile, SLACK)

    def _larger_stress(self, γ1: Expr, f: Expr, c: Any) -> Expr:
        """Larger principal stress σ1 = E γ1 + ν ψ'(f) [Pa]."""
        buckled = c.onset * _relative_load(f, c)
        is_straight = ufl.ge(f, -c.onset)
        compression = ufl.conditional(is_straight, -f, buckled)
        along = c.E * γ1
        # The second term is ν ψ'(f): the stress of the strips, by Poisson's effect.
        return along - c.nu * c.E / (1 - c.nu**2) * compression


def _strains(e: Expr, c: Any) -> tuple[Expr, Expr, Expr]:
    """Principal strains γ1 ≥ γ2 of e, and the strain f = γ2 + ν γ1 that bears on the strips."""
    h, r = half_trace_and_radius(e)
    γ1 = h + r
    γ2 = h - r
    return γ1, γ2, γ2 + c.nu * γ1


def _stretch(f: Expr) -> Expr:
    """Stretch λ = √(1 + 2f) of a strip with the Green-Lagrange strain f, which is limited to
    `STEEPEST`."""
    return ufl.sqrt(1 + 2 * ufl.max_value(f, STEEPEST))


def _relative_load(f: Expr, c: Any) -> Expr:
    """Stress of the buckled strip at the strain f, over its stress at the onset of buckling."""
    λ_w = ufl.sqrt(1 - 2 * c.onset)
    λ = _stretch(f)
    x = λ_w - λ
    nominal_load = 1 + x * (c.c1 + x * (c.c2 + x * c.c3))
    # λ_w/λ turns the nominal load of the strip into the stress that is conjugate to f.
    return λ_w / λ * nominal_load


def _buckled(f: Expr, c: Any) -> Expr:
    """Energy density ψ(f) [J/m³] of a buckled strip, for a strain f below -e_w; ψ is zero at f =
    0."""
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

    Without stress across, the strain across is γ1 = -ν ψ'(f)/E with f = γ + ν γ1.  Strips are
    straight, or buckled with

        f = γ + κ ψ'(f)/ψ'(-e_w),    κ = ν² e_w/(1 - ν²).

    One iteration solves this equation: the second one would change the stress by less than E e_w³.
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
