"""Thermal expansion of films, plates, cables and beams, as a user describes it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass
from typing import Annotated

import numpy as np

from gossamer_fx.core.checks.arguments import Range, check_arguments, not_negative
from gossamer_fx.core.model.body import Array

# Room temperature [K], at which most things are made.
ROOM_TEMPERATURE = 293.15

# Largest coefficient of expansion [1/K] that is taken.  Rubber has 5e-4; numbers above are parts
# per million.
MAX_ALPHA = 1e-2

# A temperature [K] in space and time: a number, or a function of the points (3, n) and the time [s]
# that returns (n,) or a number; or one of both for each of some groups of cells.
InTime = Annotated[float, not_negative("K")] | Callable[[Array, float], Array]
Difference = float | Callable[[Array, float], Array]
Alpha = Annotated[float, Range(-MAX_ALPHA, MAX_ALPHA, "1/K")]
Temperature = InTime | Mapping[str, InTime]


@check_arguments
@dataclass(frozen=True)
class ThermalExpansion:
    """Thermal expansion: coefficient, temperature in space and time, and reference temperature.

    A cell that is free expands by the stretch λ = 1 + α (T - T0) and has no stress then.  In terms
    of the Green-Lagrange strain that is the thermal strain

        e_th = ½ (λ² - 1) = α ΔT (1 + α ΔT/2),    ΔT = T - T0,

    and the stored energy is ψ(e - e_th(t)).  Of a plate, a temperature difference across the
    thickness changes the curvature without moments by -α (T_front - T_back)/t.

    The energy balance counts what a change of temperature adds to the stored energy as supplied by
    heat.

    Args:
        alpha: coefficient of expansion α [1/K], at most 1e-2; two numbers (α1, α2) along the axes
            of an orthotropic film.
        temperature: T [K]: a number; or a function of points (3, n) and time [s] that returns (n,)
            or a number; or {group: one of these} for groups of cells, others having the reference
            temperature.  Default: the reference temperature.  Where `gx.orbit.SolarHeating`
            computes the temperature of a film, this is the initial one.
        reference: T0 [K], at which the mesh is free of stress.
        gradient: of a plate, temperature of its front less that of its back [K], given as
            `temperature` is.  The front is the side to which the normal of the mesh points.

    Raises:
        InputError: coefficients that are too large, temperatures below 0 K.

    Example:
        >>> warming = gx.materials.ThermalExpansion(
        ...     20e-6, temperature=lambda X, t: 293.15 + 0.5 * t
        ... )
        >>> film = gx.Membrane(mesh, law, thermal=warming)
        >>> film.thermal.alpha
        2e-05
    """

    alpha: Alpha | tuple[Alpha, Alpha]
    temperature: Temperature | None = None
    _: KW_ONLY
    reference: Annotated[float, not_negative("K")] = ROOM_TEMPERATURE
    gradient: Difference | Mapping[str, Difference] | None = None

    @property
    def alphas(self) -> tuple[float, ...]:
        """The coefficients of expansion [1/K], one or two."""
        return tuple(float(alpha) for alpha in np.ravel(self.alpha))
