"""Rest angle and stiffness of a crease from a strip that hangs in its fold under weights.

The strip hangs by one end; both ends turn freely, the crease is in its middle, and the weight hangs at the lower end.
Its panels are inextensible elasticas of bending stiffness B per width, φ the angle of the tangent from the vertical,
joined by a linear rotational spring:

    B φ'' = T(s) sin φ,     φ' = 0 at both ends,     B φ' = k (θ - θr) on both sides of the crease,  θ = φ₊ - φ₋

with the tension T(s) per width of the weight and of what of the strip hangs below s.

The experiment is that of Miyazaki, final report of grant 19360384 of the Japan Society for the Promotion of Science
(2009), fig. 6.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass

import numpy as np
import numpy.typing as npt

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import NoEquilibrium, check, check_positive

Array = npt.NDArray[np.float64]

GRAVITY = 9.80665  # m/s²


@check_arguments
@dataclass(frozen=True)
class HangingStrip:
    """A strip of two equal panels that hangs by one end.

    Args:
        length: of one panel [m].
        width: [m].
        bending_stiffness: B = E t³/12 [N m] of a narrow strip, with (1 - ν²) below it for a wide one.
        area_density: ρ t [kg/m²], for its own weight; default none.
    """

    length: float
    width: float
    _: KW_ONLY
    bending_stiffness: float
    area_density: float = 0.0
    name: str = "strip"

    def __post_init__(self) -> None:
        for quantity, unit in (("length", "m"), ("width", "m"), ("bending_stiffness", "N m")):
            check_positive(self, quantity, unit)
        check(
            math.isfinite(self.area_density) and self.area_density >= 0,
            f"HangingStrip '{self.name}': area_density is {self.area_density!r} kg/m²; give zero or a positive number.",
        )

    def equilibrium(
        self, rest_angle: float, stiffness: float, weight: float
    ) -> tuple[float, float]:
        """Angle θ [rad] of the crease, and distance of the ends [m], under a weight [N].

        Args:
            rest_angle: θr [rad].
            stiffness: k [N m/m/rad].

        Raises:
            NoEquilibrium: the boundary value problem was not solved.
        """
        from scipy.integrate import solve_bvp

        check(
            0 <= weight < math.inf,
            f"HangingStrip '{self.name}': a weight is {weight!r} N; give none or a positive one.",
        )
        length, B = self.length, self.bending_stiffness
        own, load = self.area_density * GRAVITY * length, weight / self.width  # N/m
        a, κ = length**2 / B, stiffness * length / B

        def slope(s: Array, y: Array) -> Array:
            """Of (φ, φ') of both panels, and of the way down and sideways along each; s from 0 to 1 in each panel."""
            upper, lower = a * (load + own * (2 - s)), a * (load + own * (1 - s))
            down, sideways = (np.cos(y[0]), np.cos(y[2])), (np.sin(y[0]), np.sin(y[2]))
            return np.vstack(
                [y[1], upper * np.sin(y[0]), y[3], lower * np.sin(y[2]), sum(down), sum(sideways)]
            )

        def conditions(start: Array, end: Array) -> Array:
            moment = κ * (start[2] - end[0] - rest_angle)
            return np.array(
                [start[1], end[3], end[1] - moment, start[3] - moment, start[4], start[5]]
            )

        decay = math.sqrt(a * (load + own))
        s = np.linspace(0, 1, 41)
        bent = rest_angle / 2 / (1 + decay / (2 * κ))
        guess = np.zeros((6, len(s)))
        guess[0], guess[2] = -bent * np.exp(-decay * (1 - s)), bent * np.exp(-decay * s)
        guess[1], guess[3] = decay * guess[0], -decay * guess[2]
        guess[4] = 2 * s
        found = solve_bvp(slope, conditions, s, guess, tol=1e-8, max_nodes=20000)
        if not found.success:
            raise NoEquilibrium(
                f"No equilibrium of '{self.name}' under {weight:.3g} N with the rest angle {rest_angle:.3g} rad and "
                f"the stiffness {stiffness:.3g} N m/m/rad: {found.message}"
            )
        θ = float(found.y[2, 0] - found.y[0, -1])
        return θ, float(length * np.hypot(found.y[4, -1], found.y[5, -1]))


@check_arguments
@dataclass(frozen=True)
class IdentifiedCrease:
    """What a hanging strip tells about its crease.

    rest_angle          θr [rad]
    stiffness           k [N m/m/rad]
    rest_angle_error    standard deviation [rad]
    stiffness_error     standard deviation [N m/m/rad]
    correlation         of both errors
    misfit              √(Σ ((measured - computed)/uncertainty)²/(2n - 2)) of n weights: about 1 if the model and the
                        uncertainties are right
    """

    rest_angle: float
    stiffness: float
    rest_angle_error: float
    stiffness_error: float
    correlation: float
    misfit: float


@check_arguments
def identify_crease(
    strip: HangingStrip,
    weights: Sequence[float],
    *,
    angles: Sequence[float],
    distances: Sequence[float],
    angle_uncertainty: float = math.radians(1.0),
    distance_uncertainty: float = 5e-4,
) -> IdentifiedCrease:
    """Rest angle and stiffness of a crease by weighted least squares.

    Args:
        strip: what hangs.
        weights: [N], two or more; zero for the strip alone.
        angles: of the crease [rad] under each of them, zero for flat.
        distances: of the ends of the strip [m] under each of them.
        angle_uncertainty, distance_uncertainty: standard deviations [rad], [m] of what was measured.

    The errors are those of the linearised problem: the covariance is (JᵀJ)⁻¹ with the derivatives J of the residuals
    over their uncertainties, times the square of the misfit if that is above 1.

    Raises:
        InputError: lists of different lengths, fewer than two weights, uncertainties that are not positive.
        NoEquilibrium: no crease fits.
    """
    from scipy.optimize import least_squares

    W, θ, d = (np.asarray(values, dtype=float) for values in (weights, angles, distances))
    check(
        W.ndim == 1 and len(W) >= 2 and W.shape == θ.shape == d.shape,
        f"identify_crease: there are {W.size} weights, {θ.size} angles and {d.size} distances; give as many of each, "
        "two or more.",
    )
    check(
        bool(np.isfinite([W, θ, d]).all() and (W >= 0).all()),
        "identify_crease: what was measured holds numbers that are not finite, or negative weights; correct it.",
    )
    for what, value in (
        ("angle_uncertainty", angle_uncertainty),
        ("distance_uncertainty", distance_uncertainty),
    ):
        check(
            math.isfinite(value) and value > 0,
            f"identify_crease: {what} is {value!r}; give a positive number.",
        )

    def residuals(p: Array) -> Array:
        states = np.array([strip.equilibrium(float(p[0]), math.exp(p[1]), float(w)) for w in W])
        return np.concatenate(
            [(states[:, 0] - θ) / angle_uncertainty, (states[:, 1] - d) / distance_uncertainty]
        )

    # of a crease that is much stiffer than the panels, or much softer, only the rest angle is known: start between
    start = np.array([θ[W.argmin()], math.log(strip.bending_stiffness / strip.length)])
    fit = least_squares(
        residuals, start, x_scale=(1.0, 1.0), diff_step=1e-4, xtol=1e-10, ftol=1e-12
    )
    if not fit.success:
        raise NoEquilibrium(f"identify_crease: no crease fits what was measured ({fit.message})")
    misfit = math.sqrt(float(np.sum(fit.fun**2)) / (len(fit.fun) - 2))
    covariance = np.linalg.inv(fit.jac.T @ fit.jac) * max(1.0, misfit) ** 2
    k = math.exp(fit.x[1])
    errors = np.sqrt(np.diag(covariance))
    return IdentifiedCrease(
        float(fit.x[0]),
        k,
        rest_angle_error=float(errors[0]),
        stiffness_error=float(k * errors[1]),
        correlation=float(covariance[0, 1] / errors[0] / errors[1]),
        misfit=misfit,
    )
