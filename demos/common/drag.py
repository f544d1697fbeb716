"""Drag of de-orbit sails in closed form: drag areas of plates, and the fall of a circular orbit."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

import gossamer_fx as gx
from gossamer_fx.extend import Array
from gossamer_fx.orbit.optics import Arrays, flow_coefficients

EARTH = 6378137.0  # equatorial radius [m], WGS 84


def drag_area(
    areas: Array, cosines: Array, air: gx.orbit.Air, speed: float, how: gx.orbit.Accommodation
) -> float:
    """F/(½ρU²) [m²] along the flow, of the sides of plates that the air reaches.

    Args:
        areas: of the sides (n, 1) [m²].
        cosines: of the angles between the flow and the inward normals (n, 1).
        air: its state.
        speed: of the air [m/s].
        how: accommodation of the air on the plates.
    """
    wall = math.sqrt(how.wall_temperature / air.temperature)
    # A pushes against the outer normal, B along the flow.
    A, B = flow_coefficients(
        cosines, speed / air.thermal_speed, how.normal, how.tangential, wall, Arrays
    )
    return float(np.sum(areas * (A * cosines + B)))


def fall_by_formula(
    radius: float,
    force: Callable[[float, float], float],
    mass: float,
    seconds: float,
    step: float,
    mu: float,
) -> tuple[Array, Array]:
    """Times [s] and semi-major axes [m] of a circular orbit with drag, by explicit Euler steps.

    Args:
        radius: of the orbit at the start [m].
        force: of drag [N], as a function of the semi-major axis [m] and the speed [m/s].
        mass: [kg].
        seconds: how long.
        step: length of a step [s].
        mu: gravitational parameter of the Earth [m³/s²].
    """
    times = step * np.arange(round(seconds / step) + 1)
    axes = np.empty(len(times))
    axes[0] = radius
    for k, a in enumerate(axes[:-1]):
        speed = math.sqrt(mu / a)
        orbital_rate = math.sqrt(mu / a**3)
        axes[k + 1] = a - step * 2 * force(a, speed) / mass / orbital_rate
    return times, axes
