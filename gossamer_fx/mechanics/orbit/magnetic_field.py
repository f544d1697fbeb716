"""Magnetic field of the Earth by the International Geomagnetic Reference Field, IGRF-14."""

from __future__ import annotations

from functools import cache
from importlib.resources import files

import numpy as np

from gossamer_fx.extend import Array, check
from gossamer_fx.mechanics.orbit.harmonics import Coefficients, SolidHarmonics, unnormalise

# Reference radius [m] of the coefficients of IGRF.
REFERENCE_RADIUS = 6371.2e3


class Igrf:
    """Main magnetic field of the Earth at one time.

        B = -∇V [T],    V = a Σ (a/r)^(n+1) P_n^m(sin φ) (g cos mλ + h sin mλ),    n ≤ 13

    Coefficients are linear between epochs; those of the last five years are a forecast.

    Args:
        year: year with fraction, from 1900 to 2030.

    Raises:
        InputError: the year is outside this range.

    Source: IAGA, International Geomagnetic Reference Field, 14th generation,
    doi:10.5281/zenodo.14012302; its file `igrf14.shc` is in this package.

    >>> import numpy as np
    >>> B = Igrf(2025.0).field(np.array([0.0, 0.0, REFERENCE_RADIUS]))  # at the north pole
    >>> bool(5.5e-5 < np.linalg.norm(B) < 6.0e-5)
    True
    """

    def __init__(self, year: float) -> None:
        # c: coefficients [T] of each epoch; s, below: share of the interval that has passed at the
        # year, 0 to 1.
        epochs, c = _igrf14()
        check(
            bool(epochs[0] <= year <= epochs[-1]),
            f"The magnetic field is known from {epochs[0]:.0f} to {epochs[-1]:.0f}, not in "
            f"{year!r}; give a year between them.",
        )
        # The interval of epochs; the last year belongs to the last interval.
        following = np.searchsorted(epochs, year, side="right")
        k = int(np.clip(following - 1, 0, len(epochs) - 2))
        s = (year - epochs[k]) / (epochs[k + 1] - epochs[k])
        self.harmonics = SolidHarmonics(
            coefficients=(1 - s) * c[k] + s * c[k + 1],
            radius=REFERENCE_RADIUS,
            scale=REFERENCE_RADIUS,
        )

    def field(self, r: Array) -> Array:
        """B (..., 3) [T] at Earth-fixed positions r (..., 3) [m]."""
        return -self.harmonics.gradient(r)


@cache
def _igrf14() -> tuple[Array, list[Coefficients]]:
    """Epochs (k,) [years], and for each of them coefficients c_nm (14, 14) [T] without
    normalisation.

    They are read once, from the file `igrf14.shc` of the package.
    """
    text = (files("gossamer_fx.mechanics.orbit") / "igrf14.shc").read_text()
    lines = [line.split() for line in text.splitlines() if not line.startswith("#")]
    degree = int(lines[0][1])
    epochs = np.array([float(year) for year in lines[1]])
    c = np.zeros((len(epochs), degree + 1, degree + 1), dtype=complex)
    for n, m, *values in lines[2:]:
        nanotesla = np.array([float(value) for value in values])
        # Lines with negative m have the sine coefficients h, the others the cosine coefficients g.
        if int(m) >= 0:
            c[:, int(n), int(m)] += 1e-9 * nanotesla
        else:
            c[:, int(n), -int(m)] += 1e-9 * (-1j * nanotesla)
    return epochs, [unnormalise(each, geodetic=False) for each in c]
