"""Results with long arrays are printed in a few lines."""

from __future__ import annotations

import numpy as np

import gossamer_fx as gx


def test_arrays_are_described_by_their_size_and_range() -> None:
    response = gx.analysis.RandomResponse(
        np.linspace(1.0, 5.0, 400), {"z [m]": np.full(400, 2e-6)}, {"z [m]": 2e-3}, {"z [m]": 1.5}
    )
    assert repr(response).splitlines() == [
        "<RandomResponse",
        "  frequencies: 400 numbers from 1 to 5",
        "  densities: 'z [m]': 400 numbers from 2e-06 to 2e-06",
        "  rms: 'z [m]': 0.002",
        "  crossings: 'z [m]': 1.5>",
    ]


def test_short_arrays_complex_ones_and_matrices() -> None:
    shaken = gx.analysis.HarmonicResponse(np.array([1.0, 2.0]), {"z [m]": np.full(9, 3 + 4j)})
    words = str(shaken)
    assert "frequencies: 1, 2" in words and "9 complex numbers of up to 5" in words
    A = np.eye(4)
    system = gx.analysis.StateSpace(
        A, A[:, :1], A[:1], np.zeros((1, 1)), np.zeros(1), ("force",), ("z",)
    )
    assert "A: 4 × 4 numbers from 0 to 1" in str(system) and "inputs: ('force',)" in str(system)
    optimum = gx.analysis.Optimum(0.5, {}, iterations=3, converged=True, message="")
    assert "converged: True" in str(optimum) and "message" not in str(optimum)
