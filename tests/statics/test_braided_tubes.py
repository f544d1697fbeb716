"""The model of braided tubes in bending: the inflated state, the load, bad inputs, ranks."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import gossamer_fx as gx
from demos.validation.__main__ import CASES, MODELS
from demos.validation.engine.case import read_case
from demos.validation.engine.comparison import Predicted, compare
from demos.validation.models import braided_tube, cord_plateau

CASE = read_case(CASES / "hiad_71.toml", MODELS)
TEST = CASE.tests[2]
TUBE = braided_tube.Tube.read(TEST.inputs)


def test_the_inflated_wall_and_cords_balance_the_pressure():
    λ_L, λ_H = TUBE.stretches()
    A11, A12, A22, _ = TUBE.stiffnesses
    E_L = (λ_L**2 - 1) / 2
    E_H = (λ_H**2 - 1) / 2
    r = TUBE.radius
    along = λ_L / λ_H * (A11 * E_L + A12 * E_H) * 2 * math.pi * r + 3 * TUBE.cord_force
    around = λ_H / λ_L * (A12 * E_L + A22 * E_H)
    assert along == pytest.approx(TUBE.pressure * math.pi * r**2, rel=1e-9)
    assert around == pytest.approx(TUBE.pressure * r, rel=1e-9)
    # Braid resists mainly around the tube.
    assert λ_H - 1 > 3 * abs(λ_L - 1)


def test_the_tube_begins_in_equilibrium_and_reaches_the_measured_plateau(comm):
    """Two cords up, coarse: no load before bending, the measured curve, and the closed form of the
    plateau."""
    test = CASE.tests[3]
    tube = braided_tube.Tube.read(test.inputs)
    model = braided_tube.build(tube, comm, 6)
    deflection, load, details = braided_tube.bend(model, tube, 20e-3)
    assert abs(deflection[0]) < 1e-3
    # 1 % of the plateau; the section of 12 sides is not quite a circle.
    assert abs(load[0]) < 15.0
    found = compare(test.measured[0], Predicted(load, deflection))
    # 5 % of the measured curve, with six cells only.
    assert found.mean_error < 0.05
    arm = {"value": 1.1176, "unit": "m"}
    inputs = replace(test.inputs, values={**test.inputs.values, "cords_up": "2", "arm": arm})
    plateau = cord_plateau.predict(inputs, comm, True)
    closed_form = plateau.quantities["plateau load"].y
    at_75_mm = float(np.interp(75e-3, deflection, load))
    # 8 %: the closed form lets the cords carry all load.
    assert at_75_mm == pytest.approx(closed_form, rel=0.08)
    assert details["unknowns"] < 2000


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"cord_angles": {"value": [0, 100, 200], "unit": "deg"}}, "multiples of 30"),
        ({"cord_angles": {"value": [30, 150], "unit": "deg"}}, "symmetric"),
        ({"load_at": {"value": 3.0, "unit": "m"}}, "load_at is 3 m"),
        ({"cord_table_force": {"value": [1.0], "unit": "N"}}, "cord_table_force 1"),
        ({"cells_around": {"value": 8, "unit": "1"}}, "a multiple of 6"),
        ({"cord_force": {"value": 9, "unit": "kN"}}, "pulls with 6186 N only"),
        ({"pressure": {"value": -1, "unit": "kPa"}}, "pressure is -1000 Pa"),
    ],
)
def test_bad_inputs_are_refused_in_one_sentence(comm, changes, words):
    inputs = replace(TEST.inputs, values={**TEST.inputs.values, **changes})
    with pytest.raises(gx.InputError, match=words):
        braided_tube.predict(inputs, comm, True)
