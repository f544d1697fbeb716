"""A film that wrinkles as a strip buckles: the extensible elastica, and the film law made of it.

A pinned strip of half wavelength L, thickness t and modulus E' has p = P/(E't), e_E = π²t²/(12L²).  With the end slope
α, k = sin(α/2) and sin(θ/2) = k sin φ, the buckled strip obeys (Magnusson, Ristinmaa & Ljung, Int. J. Solids Struct. 38
(2001) 8441, doi:10.1016/S0020-7683(01)00089-0)

    1 = c I[1],   1 - δ = c I[(1 - p cos θ) cos θ],   c = 2√(2 e_E)/(π√p),
    I[f] = ∫₀^{π/2} f dφ / (√(1 - k² sin²φ) √(2 - p (cos θ + cos α))),

and is straight up to p = e_c, p (1 - p) = e_E.
"""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, field
from typing import Any

import numpy as np
import ufl

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.forms.kinematics import Expr, half_trace_and_radius
from gossamer_fx.materials.film import SLACK, TAUT, WRINKLED, FilmLaw
from gossamer_fx.model.body import Array

FITTED_UP_TO = 0.3  # shortening δ
STEEPEST = (
    -0.42
)  # strain beyond which the compressive stress stays what it is: a strip 60 % shorter


def onset(e_E: float) -> float:
    """e_c: the compressive strain, and the load p, at which a strip buckles."""
    return 2 * e_E / (1 + math.sqrt(1 - 4 * e_E))


def buckled_strip(e_E: float, α: float) -> tuple[float, float]:
    """(δ, P/P_c) of the strip with end slope α > 0 [rad]."""
    s, w = np.polynomial.legendre.leggauss(64)
    φ, weights = (s + 1) * math.pi / 4, w * math.pi / 4
    k = math.sin(α / 2)
    cos_θ = 1 - 2 * (k * np.sin(φ)) ** 2

    def integral(f: Array, p: float) -> float:
        root = np.sqrt(1 - (k * np.sin(φ)) ** 2) * np.sqrt(2 - p * (cos_θ + math.cos(α)))
        return float(weights @ (f / root))

    p = onset(e_E)
    for _ in range(50):  # p = (2√(2 e_E)/π I[1](p))², a contraction of rate p
        p = (2 * math.sqrt(2 * e_E) / math.pi * integral(np.ones_like(φ), p)) ** 2
    c = 2 * math.sqrt(2 * e_E) / (math.pi * math.sqrt(p))
    return 1 - c * integral((1 - p * cos_θ) * cos_θ, p), p / onset(e_E)


def cubic(e_E: float) -> tuple[float, float, float]:
    """(c1, c2, c3) of P/P_c = 1 + c1 x + c2 x² + c3 x³, x = δ - e_c, by least squares over δ < 0.3."""
    curve: Array = np.array([buckled_strip(e_E, α) for α in np.linspace(0.02, 1.2, 200)])
    curve = curve[curve[:, 0] < FITTED_UP_TO]
    x = curve[:, 0] - onset(e_E)
    c = np.linalg.lstsq(np.column_stack([x, x**2, x**3]), curve[:, 1] - 1, rcond=None)[0]
    return float(c[0]), float(c[1]), float(c[2])


@check_arguments
@dataclass(frozen=True)
class Elastica(FilmLaw):
    """Film whose wrinkles resist as buckled strips of half wavelength L = `half_wavelength` [m] and its thickness do.

    With f = γ2 + ν γ1, the strain that bears on the strips, and σ1 = E γ1 + ν ψ'(f) the larger stress,

        σ1 ≥ 0          W/t = E γ1²/2 + ψ(f)       taut for f ≥ -e_w, wrinkled below
        σ1 < 0 ≤ γ1     W/t = U(γ2)                compressed one way, free in the other
        γ1 < 0          W/t = U(γ1) + U(γ2)        slack
        ψ' = E/(1-ν²) f            for f ≥ -e_w
        ψ' = -E/(1-ν²) e_w (λ_w/λ)(1 + c1 x + c2 x² + c3 x³) below,   λ = √(1 + 2f),  x = λ_w - λ

    where e_w = e_c and the cubic are those of the extensible elastica of the module: its nominal load at the shortening
    1 - λ, as stress of the Green-Lagrange strain f.  U(γ2) = min over γ1 of Eγ1²/2 + ψ(f) is the energy without stress
    σ1.  W is C1 and convex, and symmetric where both strains are compressive.  Below f = -0.42 the stress is constant.

    A film has no bending stiffness: under this compressive stress its cells buckle in turn, the more so the smaller
    they are.  Take cells of not much less than half_wavelength/4: on the airbag of `demos/studies/airbag.py` 0.1 m
    comes to rest with edges of 27 mm, while with 13 mm cells beside the seam fold up and no equilibrium is found.

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
        super().__post_init__()
        shortest = 10 * math.pi * self.thickness
        check(
            math.isfinite(self.half_wavelength) and self.half_wavelength > shortest,
            f"Elastica: half_wavelength is {self.half_wavelength!r} m; a strip needs more than {shortest:.3g} m, ten "
            "times pi its thickness.",
        )
        e_E = (math.pi * self.thickness / self.half_wavelength) ** 2 / 12
        for name, value in zip(("onset", "c1", "c2", "c3"), (onset(e_E), *cubic(e_E)), strict=True):
            object.__setattr__(self, name, value)

    def energy(self, e: Expr, c: Any) -> Expr:
        h, r = half_trace_and_radius(e)
        γ1, γ2 = h + r, h - r
        tr, det = e[0] + e[1], e[0] * e[1] - e[2] ** 2 / 4
        f = γ2 + c.nu * γ1
        # taut through tr and det, which are smooth where the principal strains coincide
        taut = c.E / (2 * (1 - c.nu**2)) * (tr**2 - 2 * (1 - c.nu) * det)
        borne = ufl.conditional(ufl.ge(f, -c.onset), taut, c.E * γ1**2 / 2 + _buckled(f, c))
        slack = ufl.conditional(
            ufl.ge(γ1, 0), _unloaded(γ2, c), _unloaded(γ1, c) + _unloaded(γ2, c)
        )
        return c.thickness * ufl.conditional(ufl.ge(self._larger_stress(γ1, f, c), 0), borne, slack)

    def state(self, e: Expr, c: Any) -> Expr:
        h, r = half_trace_and_radius(e)
        f = h - r + c.nu * (h + r)
        borne = ufl.conditional(ufl.ge(f, -c.onset), TAUT, WRINKLED)
        return ufl.conditional(ufl.ge(self._larger_stress(h + r, f, c), 0), borne, SLACK)

    def _larger_stress(self, γ1: Expr, f: Expr, c: Any) -> Expr:
        pressed = ufl.conditional(ufl.ge(f, -c.onset), -f, c.onset * _relative_load(f, c))
        return c.E * γ1 - c.nu * c.E / (1 - c.nu**2) * pressed


def _stretch(f: Expr) -> Expr:
    return ufl.sqrt(1 + 2 * ufl.max_value(f, STEEPEST))


def _relative_load(f: Expr, c: Any) -> Expr:
    """Stress of the buckled strip over that at its onset."""
    λ_w, λ = ufl.sqrt(1 - 2 * c.onset), _stretch(f)
    x = λ_w - λ
    return λ_w / λ * (1 + x * (c.c1 + x * (c.c2 + x * c.c3)))


def _buckled(f: Expr, c: Any) -> Expr:
    """ψ(f) below f = -e_w."""
    λ_w = ufl.sqrt(1 - 2 * c.onset)
    x = λ_w - _stretch(f)
    work = λ_w * x * (1 + x * (c.c1 / 2 + x * (c.c2 / 3 + x * c.c3 / 4)))
    beyond = _relative_load(f, c) * (ufl.max_value(f, STEEPEST) - f)
    return c.E / (1 - c.nu**2) * (c.onset**2 / 2 + c.onset * (work + beyond))


def _unloaded(γ: Expr, c: Any) -> Expr:
    """U(γ): straight strips, or buckled ones at f = γ + κ ψ'(f)/ψ'(-e_w), whose solution one iteration gives.

    The next one would change the stress by less than E e_w³.
    """
    κ = c.nu**2 * c.onset / (1 - c.nu**2)
    f = γ + κ * _relative_load(γ + κ, c)
    γ1 = c.nu * c.onset / (1 - c.nu**2) * _relative_load(f, c)
    buckled = c.E * γ1**2 / 2 + _buckled(f, c)
    return ufl.conditional(ufl.ge(γ, -c.onset / (1 - c.nu**2)), c.E * γ**2 / 2, buckled)
