"""Paths in strain space: their intersections with a cone, and averages along them."""

from __future__ import annotations

import numpy as np
import pytest
import ufl

from gossamer_fx.core.forms.strain_path import mean_gradient, within_cone
from tests.strain_samples import CELLS, Samples, random_strains

# Parameters of sampled points of a path, the middles of equal pieces.
SAMPLES = (np.arange(4000) + 0.5) / 4000


def mohr(e):
    """Return centre and radius of Mohr's circle of strains (..., 3), the radius as its two
    components."""
    centre = (e[..., 0] + e[..., 1]) / 2
    half_difference = (e[..., 0] - e[..., 1]) / 2
    half_shear = e[..., 2] / 2
    return centre, half_difference, half_shear


def along(e0, e1, s=SAMPLES):
    """Return strains (len(s), n, 3) on the straight paths from e0 to e1 (n, 3)."""
    return e0 + s[:, None, None] * (e1 - e0)


@pytest.mark.parametrize("m", [1 / 3, 0.54, 1.0, 3.0])
@pytest.mark.parametrize("margin", [0.0, 1e-3])
def test_stretch_within_a_cone(m, margin):
    stretch = Samples(lambda a, b: ufl.as_vector(within_cone(a, b, m, margin)), arguments=2)
    e0 = random_strains(CELLS, 0.1, seed=1)
    e1 = random_strains(CELLS, 0.1, seed=2)
    start, end = stretch(e0, e1).T
    h, x, y = mohr(along(e0, e1))
    radius = np.hypot(x, y)
    is_within = h + margin >= m * radius
    assert (start >= 0).all()
    assert (start <= end).all()
    assert (end <= 1).all()
    # Sampling finds the length of the stretch up to one piece.
    sampled_length = is_within.mean(axis=0)
    assert abs(sampled_length - (end - start)).max() <= 1.1 / len(SAMPLES)
    middle_parameter = (start + end) / 2
    middle = e0 + middle_parameter[:, None] * (e1 - e0)
    # Stretches without length have no middle inside.
    h, x, y = mohr(middle[end > start + 1e-9])
    radius = np.hypot(x, y)
    assert (h + margin >= m * radius).all()
    # The random paths enter, leave, cross and avoid the cone.
    ends = set(zip(is_within[0].tolist(), is_within[-1].tolist(), strict=True))
    expected = {(False, False), (False, True), (True, False), (True, True)}
    assert ends == expected


@pytest.mark.parametrize("length", [1.0, 0.3, 0.1, 1e-2, 1e-5])
def test_average_of_the_gradient_of_centre_times_radius(length):
    e0 = random_strains(CELLS, 0.1, seed=3)
    e1 = e0 + length * (random_strains(CELLS, 0.1, seed=4) - e0)
    found = Samples(mean_gradient, arguments=2)(e0, e1)
    points, weights = np.polynomial.legendre.leggauss(400)
    h, x, y = mohr(along(e0, e1, (1 + points) / 2))
    r = np.hypot(x, y)
    # Gradient of h r by (E11, E22, 2 E12).
    cosine = x / r
    sine = y / r
    by_E11 = (r + h * cosine) / 2
    by_E22 = (r - h * cosine) / 2
    by_shear = h * sine / 2
    gradient = np.stack([by_E11, by_E22, by_shear], axis=-1)
    exact = np.tensordot(weights / 2, gradient, axes=1)
    # 400 Gauss points are not accurate for paths that pass close to r = 0.
    assert abs(found - exact).max() <= 3e-4 * 0.1
    assert np.median(abs(found - exact).max(axis=1)) <= 1e-13 * 0.1


def test_average_through_the_apex_is_finite():
    e0 = np.array([[1.0, -1.0, 0.0], [1e-3, -1e-3, 2e-3], [0.0, 0.0, 0.0], [1.0, 1.0, 0.0]])
    found = Samples(mean_gradient, arguments=2)(e0, -e0)
    assert np.isfinite(found).all()
    np.testing.assert_allclose(found[0], [0.25, 0.25, 0.0], atol=1e-9)  # h = 0, mean r = 1/2
