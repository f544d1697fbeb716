"""Gravity and sunlight against Basilisk (bsk 2.12.1 of PyPI, University of Colorado), whose numbers
are kept here.

Its spherical-harmonics model had the coefficients of `egm2008.txt` to degree 20, its faceted
sunlight one plate of 2 m² with 0.8 mirrored and 0.05 scattered, 7000 km from the Earth's centre
towards x, the Sun 1 au towards z.
"""

from __future__ import annotations

import numpy as np
import pytest

from gossamer_fx.mechanics.orbit.harmonics import egm2008
from gossamer_fx.mechanics.orbit.optics import Arrays, Optics, light_force
from gossamer_fx.mechanics.orbit.sky import AU

# Points [m] and accelerations [m/s²], copied from Basilisk with all its digits.
GRAVITY = [
    ((7e6, 0, 0), (-8.145743969832791, -2.2756375203681974e-05, 3.852870784694628e-05)),
    ((4e6, 3e6, 5e6), (-4.500668902303778, -3.3756551169322675, -5.640842719608581)),
    ((-2.5e6, 5.5e6, -3.5e6), (2.926462426878247, -6.438406339477357, 4.108351831036327)),
    ((1e5, 2e5, -6.6e6), (-0.13737649391983048, -0.27504347456210965, 9.107267763003096)),
]
# direction to the Sun in the axes of the plate, whose normal is z; force and torque for its centre
# (0.1, 0.2, 0.3) m
SUNLIGHT = [
    (
        (-4.6792109804653416e-05, 0.0, 0.9999999989052492),
        (8.540789528066489e-11, 3.053952001177165e-18, -1.6731574942204715e-05),
        (-3.346314988441859e-06, 1.6731831165890558e-06, -1.7081578750737777e-11),
    ),
    (
        (-0.7405071714665558, 0.19221690921384701, 0.6439734379761921),
        (8.70407466860875e-07, -2.2593573632081448e-07, -7.008360905853427e-06),
        (-1.3338914602744412e-06, 9.619583306436052e-07, -1.9667506700425646e-07),
    ),
    (
        (0.7140334755325416, 0.6710053522190339, 0.19976990041627815),
        (-2.60359848962681e-07, -2.446703945169998e-07, -7.163555709710224e-07),
        (-6.986999583910456e-08, -6.472397591702056e-09, 2.760493034083623e-08),
    ),
]


@pytest.mark.parametrize(("place", "known"), GRAVITY)
def test_gravity_to_degree_20(place: tuple[float, ...], known: tuple[float, ...]) -> None:
    g = egm2008(20, central=True).gradient(np.array(place))
    # Both use the same coefficients, so they agree to round-off.
    error = np.linalg.norm(g - known)
    assert error < 1e-12 * np.linalg.norm(known)


@pytest.mark.parametrize(("to_sun", "force", "torque"), SUNLIGHT)
def test_sunlight_on_a_plate(
    to_sun: tuple[float, ...], force: tuple[float, ...], torque: tuple[float, ...]
) -> None:
    optics = Optics(reflectivity=0.85, specular=0.8 / 0.85)
    f = light_force(
        np.array([0.0, 0.0, 2.0]),
        -np.array(to_sun),
        optics.coefficients(),
        (0, 0, 0),
        Arrays,
    )
    distance = np.linalg.norm(np.array([0, 0, AU]) - np.array([7e6, 0, 0]))
    f = f * (AU / distance) ** 2
    scale = float(f @ force / (f @ f))  # the pressure at 1 au that it takes
    # The pressure of sunlight [Pa] at 1 au.
    assert scale == pytest.approx(4.563e-6, rel=1e-4)
    error = np.abs(scale * f - force).max()
    # Basilisk's own constants have nine digits.
    assert error < 1e-9 * np.linalg.norm(force)
    error = np.abs(np.cross([0.1, 0.2, 0.3], scale * f) - torque).max()
    assert error < 1e-9 * np.linalg.norm(torque)
