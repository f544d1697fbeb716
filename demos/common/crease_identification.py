"""Rest angle and stiffness of a crease, from a strip that hangs folded under weights.

Problem.  A strip with a crease in its middle hangs by one end, free to turn at both ends; a weight
hangs at the lower end.  Measured are the angle of the crease and the distance of the ends under
some weights; wanted are the rest angle θr and the stiffness k of the crease.

Model.  The two panels are inextensible elasticas of bending stiffness B per width, φ the angle of
the tangent from the vertical, connected by a linear rotational spring:

    B φ'' = T(s) sin φ                                                                        (1)
    φ' = 0                    at both ends                                                    (2)
    B φ' = k (θ - θr)         on both sides of the crease,   θ = φ₊ - φ₋                      (3)

The tension T(s) per width is that of the weight and of the part of the strip below s.

Algorithm.

1. Solve (1) to (3) for each weight, with s scaled to [0, 1] in each panel
   (`HangingStrip.equilibrium`).
2. Fit θr and ln k by weighted least squares (`identify_crease`).

The experiment is that of Miyazaki, final report of grant 19360384 of the Japan Society for the
Promotion of Science (2009), fig. 6.

Limits.  Of a crease that is much stiffer or much softer than the panels only the rest angle can be
identified; the standard deviation of the stiffness is then large.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Annotated

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_bvp
from scipy.optimize import least_squares

from gossamer_fx import NoEquilibrium
from gossamer_fx.extend import check, check_arguments, not_negative, positive

Array = npt.NDArray[np.float64]

GRAVITY = 9.80665  # standard acceleration of gravity [m/s²]

# Points of the first mesh of the boundary value problem, and the most that its solver may use.
MESH_POINTS = 41
MAX_MESH_POINTS = 20_000

# Relative residual of the boundary value problem: far below the uncertainty of a measurement.
EQUILIBRIUM_TOLERANCE = 1e-8

# Relative step of the differences in the fit: above the noise that EQUILIBRIUM_TOLERANCE leaves.
DIFFERENCE_STEP = 1e-4

# Relative changes of the parameters and of the sum of squares at which the fit ends.
PARAMETER_TOLERANCE = 1e-10
SUM_TOLERANCE = 1e-12


@check_arguments
@dataclass(frozen=True)
class HangingStrip:
    """A strip of two equal panels that hangs by one end.

    Args:
        length: of one panel [m].
        width: [m].
        bending_stiffness: B = E t³/12 of a narrow strip [N m]; E t³/(12 (1 - ν²)) of a wide one.
        area_density: ρ t [kg/m²], for the weight of the strip; default none.
        name: for messages.

    Raises:
        InputError: a value is out of its range.

    Example:
        >>> strip = HangingStrip(0.1, 0.02, bending_stiffness=1e-4, area_density=0.01)
        >>> angle, distance = strip.equilibrium(rest_angle=1.2, stiffness=2e-3, weight=0.01)
        >>> round(angle, 3), round(distance, 4)
        (0.431, 0.1997)
    """

    length: Annotated[float, positive("m")]
    width: Annotated[float, positive("m")]
    _: KW_ONLY
    bending_stiffness: Annotated[float, positive("N m")]
    area_density: Annotated[float, not_negative("kg/m²")] = 0.0
    name: str = "strip"

    @check_arguments
    def equilibrium(
        self, rest_angle: float, stiffness: float, weight: float
    ) -> tuple[float, float]:
        """Angle θ [rad] of the crease and distance of the ends [m] under a weight [N], zero for the
        strip alone, with a rest angle [rad] and a stiffness [N m/m/rad]."""
        check(
            0 <= weight < math.inf,
            f"HangingStrip '{self.name}': a weight is {weight!r} N; give none or a positive one.",
        )
        length = self.length
        panel_weight = self.area_density * GRAVITY * length  # of one panel per width [N/m]
        load = weight / self.width  # [N/m]
        # With s scaled by the length, (1) is φ'' = scale T sin φ and (3) is φ' = κ (θ - θr).
        scale = length**2 / self.bending_stiffness
        κ = stiffness * length / self.bending_stiffness

        def slope(s: Array, y: Array) -> Array:
            """Derivatives (6, n) of y = (φ, φ' upper panel, φ, φ' lower panel, down, sideways) by
            the arc length of each panel from its upper end, over its length: φ [rad] is the angle
            from the vertical, the last two the path of both panels over the length."""
            φ_upper = y[0]
            φ_lower = y[2]
            tension_upper = load + panel_weight * (2 - s)
            tension_lower = load + panel_weight * (1 - s)
            return np.vstack(
                [
                    y[1],
                    scale * tension_upper * np.sin(φ_upper),
                    y[3],
                    scale * tension_lower * np.sin(φ_lower),
                    np.cos(φ_upper) + np.cos(φ_lower),
                    np.sin(φ_upper) + np.sin(φ_lower),
                ]
            )

        def conditions(start: Array, end: Array) -> Array:
            """Residuals (6,) of (2), (3) and of the path that begins at zero, with y at the upper
            and lower ends of the panels."""
            moment = κ * (start[2] - end[0] - rest_angle)
            return np.array(
                [
                    start[1],
                    end[3],
                    end[1] - moment,
                    start[3] - moment,
                    start[4],
                    start[5],
                ]
            )

        # First guess: the solution for small angles, which decays from the crease.
        s = np.linspace(0, 1, MESH_POINTS)
        decay = math.sqrt(scale * (load + panel_weight))
        angle_at_crease = rest_angle / 2 / (1 + decay / (2 * κ))
        guess = np.zeros((6, len(s)))
        guess[0] = -angle_at_crease * np.exp(-decay * (1 - s))
        guess[1] = decay * guess[0]
        guess[2] = angle_at_crease * np.exp(-decay * s)
        guess[3] = -decay * guess[2]
        guess[4] = 2 * s
        found = solve_bvp(
            slope,
            conditions,
            s,
            guess,
            tol=EQUILIBRIUM_TOLERANCE,
            max_nodes=MAX_MESH_POINTS,
        )
        if not found.success:
            raise NoEquilibrium(
                f"No equilibrium of '{self.name}' under {weight:.3g} N with the rest angle "
                f"{rest_angle:.3g} rad and the stiffness {stiffness:.3g} N m/m/rad: {found.message}"
            )
        θ = float(found.y[2, 0] - found.y[0, -1])
        down = found.y[4, -1]
        sideways = found.y[5, -1]
        return θ, float(length * np.hypot(down, sideways))


@check_arguments
@dataclass(frozen=True)
class IdentifiedCrease:
    """Properties of a crease that were identified from a hanging strip.

    Attributes:
        rest_angle: θr [rad].
        stiffness: k [N m/m/rad].
        rest_angle_error: standard deviation [rad].
        stiffness_error: standard deviation [N m/m/rad].
        correlation: of both errors, between -1 and 1.
        misfit: √(Σ ((measured - computed)/uncertainty)²/(2n - 2)) for n weights; about 1 if the
            model and the uncertainties are right.

    Example:
        >>> crease = IdentifiedCrease(
        ...     rest_angle=1.2,
        ...     stiffness=2e-3,
        ...     rest_angle_error=0.01,
        ...     stiffness_error=1e-4,
        ...     correlation=-0.6,
        ...     misfit=0.9,
        ... )
        >>> crease.stiffness_error / crease.stiffness
        0.05
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
    angle_uncertainty: Annotated[float, positive("rad")] = math.radians(1.0),
    distance_uncertainty: Annotated[float, positive("m")] = 5e-4,
) -> IdentifiedCrease:
    """Identify the rest angle and the stiffness of a crease by weighted least squares.

    The errors are those of the linearised problem: the covariance is (JᵀJ)⁻¹, J being the
    derivatives of the residuals over their uncertainties, times the square of the misfit if that is
    above 1.

    Args:
        strip: the strip that was measured.
        weights: [N], two or more; zero for the strip alone.
        angles: of the crease [rad] under each weight, zero for a flat strip.
        distances: of the ends of the strip [m] under each weight.
        angle_uncertainty: standard deviation of the measured angles [rad].
        distance_uncertainty: standard deviation of the measured distances [m].

    Raises:
        InputError: the lists have different lengths, there are fewer than two weights, or an
            uncertainty is not positive.
        NoEquilibrium: no crease fits.

    Example:
        >>> strip = HangingStrip(0.1, 0.02, bending_stiffness=1e-4, area_density=0.01)
        >>> weights = [0.0, 1e-3, 1e-2]
        >>> crease = identify_crease(
        ...     strip, weights, angles=[1.048, 0.751, 0.431], distances=[0.1812, 0.1969, 0.1997]
        ... )
        >>> round(crease.rest_angle, 2), round(1e3 * crease.stiffness, 2)
        (1.2, 2.0)
    """
    # W: weights [N], θ: measured angles of the crease [rad], d: measured distances of the ends [m],
    # each (n,).
    W = np.asarray(weights, dtype=float)
    θ = np.asarray(angles, dtype=float)
    d = np.asarray(distances, dtype=float)
    _check_measurements(W, θ, d)

    def residuals(parameters: Array) -> Array:
        """Differences over their uncertainties (2n,), for the parameters θr and ln k."""
        rest_angle = float(parameters[0])
        stiffness = math.exp(parameters[1])
        states = np.array([strip.equilibrium(rest_angle, stiffness, float(weight)) for weight in W])
        angle_errors = (states[:, 0] - θ) / angle_uncertainty
        distance_errors = (states[:, 1] - d) / distance_uncertainty
        return np.concatenate([angle_errors, distance_errors])

    # The fit starts with a crease as stiff as a panel: much stiffer or much softer ones give no
    # derivative with respect to k.
    start = np.array([θ[W.argmin()], math.log(strip.bending_stiffness / strip.length)])
    fit = least_squares(
        residuals,
        start,
        x_scale=(1.0, 1.0),
        diff_step=DIFFERENCE_STEP,
        xtol=PARAMETER_TOLERANCE,
        ftol=SUM_TOLERANCE,
    )
    if not fit.success:
        raise NoEquilibrium(f"identify_crease: no crease fits what was measured ({fit.message})")
    # Two parameters were fitted.
    misfit = math.sqrt(float(np.sum(fit.fun**2)) / (len(fit.fun) - 2))
    covariance = np.linalg.inv(fit.jac.T @ fit.jac) * max(1.0, misfit) ** 2
    rest_angle_error, log_error = np.sqrt(np.diag(covariance))
    stiffness = math.exp(fit.x[1])
    return IdentifiedCrease(
        rest_angle=float(fit.x[0]),
        stiffness=stiffness,
        rest_angle_error=float(rest_angle_error),
        # Δk = k Δ(ln k)
        stiffness_error=float(stiffness * log_error),
        correlation=float(covariance[0, 1] / rest_angle_error / log_error),
        misfit=misfit,
    )


def _check_measurements(W: Array, θ: Array, d: Array) -> None:
    """Refuse weights (n,) [N], angles (n,) [rad] and distances (n,) [m] that differ in number, are
    too few, or have no meaning."""
    check(
        W.ndim == 1 and len(W) >= 2 and W.shape == θ.shape == d.shape,
        f"identify_crease: there are {W.size} weights, {θ.size} angles and {d.size} distances; "
        "give as many of each, two or more.",
    )
    check(
        bool(np.isfinite([W, θ, d]).all() and (W >= 0).all()),
        "identify_crease: "
        "what was measured holds numbers that are not finite, or negative weights; correct it.",
    )
