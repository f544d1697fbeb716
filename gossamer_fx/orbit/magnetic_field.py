"""The Earth's magnetic field: IGRF-14."""

from __future__ import annotations

from functools import cache
from importlib.resources import files

import numpy as np

from gossamer_fx.extend import Array, check
from gossamer_fx.orbit.harmonics import Coefficients, SolidHarmonics, unnormalise

REFERENCE_RADIUS = 6371.2e3  # m


class Igrf:
    """The main field B = -∇V [T] of a year, V = a Σ (a/r)^(n+1) P_n^m (g cos mλ + h sin mλ), degree 13.

    Source: IAGA, International Geomagnetic Reference Field, 14th generation, doi:10.5281/zenodo.14012302; its file
    `igrf14.shc` is beside this one.  Between epochs coefficients are linear; the last five years are a forecast.

    Args:
        year: with fraction, from 1900 to 2030.
    """

    def __init__(self, year: float) -> None:
        epochs, c = _igrf14()
        check(
            bool(epochs[0] <= year <= epochs[-1]),
            f"The magnetic field is known from {epochs[0]:.0f} to {epochs[-1]:.0f}, not in {year!r}; give a year "
            "between them.",
        )
        k = int(np.clip(np.searchsorted(epochs, year, side="right") - 1, 0, len(epochs) - 2))
        s = (year - epochs[k]) / (epochs[k + 1] - epochs[k])
        self.harmonics = SolidHarmonics(
            (1 - s) * c[k] + s * c[k + 1], REFERENCE_RADIUS, REFERENCE_RADIUS
        )

    def field(self, r: Array) -> Array:
        """B (..., 3) [T] at Earth-fixed positions r (..., 3) [m]."""
        return -self.harmonics.gradient(r)


@cache
def _igrf14() -> tuple[Array, list[Coefficients]]:
    """Epochs [years], and for each of them c_nm [T], unnormalised."""
    lines = [
        line.split()
        for line in (files("gossamer_fx.orbit") / "igrf14.shc").read_text().splitlines()
        if not line.startswith("#")
    ]
    degree, epochs = int(lines[0][1]), np.array([float(year) for year in lines[1]])
    c = np.zeros((len(epochs), degree + 1, degree + 1), dtype=complex)
    for n, m, *values in lines[2:]:
        nT = np.array([float(value) for value in values])
        c[:, int(n), abs(int(m))] += 1e-9 * (nT if int(m) >= 0 else -1j * nT)
    return epochs, [unnormalise(each, geodetic=False) for each in c]
