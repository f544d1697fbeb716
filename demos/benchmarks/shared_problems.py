"""Numbers that the scripts of several programs have in common (SI or any consistent units).

It uses numpy only, as it also runs in environments without dolfinx; so does `contact_scene.py`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# The fabric of the square airbag, a balanced plain weave: as stiff as the isotropic film along its
# yarns, and soft in shear [Pa].  Balanced, so that a quarter of the airbag has planes of symmetry
# with the yarns along the edges and along the diagonals.
MODULI = {"E1": 588e6, "E2": 588e6, "nu12": 0.2, "G12": 20e6}


# The airbag that is blown up: its pressure grows during this time [s] and stays; its film has a
# damping in proportion to its mass [1/s], which both programs have; until the end [s] its volume is
# compared at `instants_of`.
RISE = 0.01
MASS_DAMPING = 60.0
BLOWN_UNTIL = 0.08


def volume_below(x: np.ndarray, triangles: np.ndarray) -> float:
    """Volume [m³] of the whole airbag, from the positions x (p, 3) of a quarter of one sheet: eight
    times that between its triangles (t, 3) and the plane z = 0."""
    corners = x[triangles]
    first = corners[:, 1] - corners[:, 0]
    second = corners[:, 2] - corners[:, 0]
    areas = (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2
    return 8 * abs(float(np.dot(areas, corners[:, :, 2].mean(axis=1))))


@dataclass(frozen=True)
class Shape:
    """A flat plate, ν = 0, clamped at one end: `load` per length of the other end, across, and its
    deflection."""

    E: float
    thickness: float
    load: float
    deflection: float


CASES = {
    # The elastica for PL²/EI = 4.
    "strip": Shape(E=1.2e6, thickness=0.1, load=4.0, deflection=6.6996),
    # The outer corner of Sze, Liu & Lo (2004).
    "slit ring": Shape(E=21e6, thickness=0.03, load=0.8, deflection=17.528),
}


def grid(shape: str, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (i, j, 3) and their numbers from 0: i from the clamped to the loaded end, j across; n
    cells along or 4n."""
    along, across = (n, max(n // 8, 1)) if shape == "strip" else (4 * n, n // 2)
    u, v = np.meshgrid(
        np.linspace(0, 1, along + 1),
        np.linspace(0, 1, across + 1),
        indexing="ij",
    )
    points = np.stack(mapped(shape, u, v), axis=-1)
    return points, np.arange((along + 1) * (across + 1)).reshape(along + 1, across + 1)


def mapped(shape: str, u, v):
    """Points of the plate, u in [0, 1] from the clamped to the loaded end, v in [0, 1] across."""
    if shape == "strip":
        return 10 * u, 1 * v, 0 * u
    angle = -2 * np.pi * u
    radius = 6 + 4 * v
    return radius * np.cos(angle), radius * np.sin(angle), 0 * u


def instants_of(until: float) -> list[float]:
    """Forty instants [s] at which motions are compared: multiples of all steps of the pendulum, if
    the end is 2 s."""
    return [until * k / 40 for k in range(1, 41)]
