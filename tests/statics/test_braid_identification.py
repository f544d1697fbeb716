"""The moduli of a braided tube from a bending test: derivatives against differences, and a fit."""

from __future__ import annotations

import numpy as np
import pytest

from demos.design import braid_identification as demo

FITTED = "1 up, 69 kPa"


def case_test(name: str):
    case = demo.read_case(demo.CASES / "hiad_71.toml", ["braided_tube"])
    return next(test for test in case.tests if test.name == name)


def test_derivatives_of_a_load_agree_with_tubes_that_are_made_again(comm, monkeypatch):
    """Of load and deflection, by both factors, through the stress-free shape of the tube as
    well."""
    monkeypatch.setattr(demo, "DEPTHS", (0.012, 0.06))
    test = case_test(FITTED)
    step = 1e-4
    _, gradients = demo.bend(comm, test, (1.0, 1.0), demo.CELLS)
    for k, name in enumerate(demo.NAMES):
        sides = []
        for sign in (1, -1):
            factors = [1.0, 1.0]
            factors[k] += sign * step
            sides.append(demo.bend(comm, test, factors, demo.CELLS, with_gradients=False)[0])
        of_load = (sides[0].P - sides[1].P) / (2 * step)
        of_height = -(sides[0].w - sides[1].w) / (2 * step)
        assert [one[0][name].values[0] for one in gradients] == pytest.approx(of_load, rel=1e-5)
        assert [one[1][name].values[0] for one in gradients] == pytest.approx(of_height, rel=1e-5)


def test_factors_are_found_again_from_the_curve_that_they_give(comm, monkeypatch):
    monkeypatch.setattr(demo, "DEPTHS", (0.004, 0.012, 0.06))
    test = case_test(FITTED)
    factors = (1.3, 0.7)
    shown, _ = demo.bend(comm, test, factors, demo.CELLS, with_gradients=False)
    # Straight pieces between points at the same depths; the fit ends where it meets them.
    monkeypatch.setattr(demo, "measured_curve", lambda test: shown)
    found = demo.identify(comm, [test], demo.CELLS)
    assert [found.parameters[name][0] for name in demo.NAMES] == pytest.approx(factors, rel=1e-3)
    assert found.scatter < 1e-3


def test_the_fitted_tube_predicts_another_pressure_better(comm, monkeypatch):
    monkeypatch.setattr(demo, "DEPTHS", (0.004, 0.012, 0.06))
    result = demo.main(predicted=("1 up, 103 kPa",), comm=comm)
    assert result[f"{FITTED}: error"] < 0.5 * result[f"{FITTED}: error of the source"]
    assert result["1 up, 103 kPa: error"] < 0.6 * result["1 up, 103 kPa: error of the source"]
    # Stiffnesses of stretching hardly count in bending: they are known less well than those of
    # shear.
    assert result["shear, standard deviation"] < 0.1
    assert 0.05 < result["stretching, standard deviation"] < 0.5
    assert np.isfinite(result["scatter"])
