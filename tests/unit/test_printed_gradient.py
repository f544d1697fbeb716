"""A gradient is printed in at most five lines."""

from __future__ import annotations

import numpy as np

from gossamer_fx.analysis import Derivative, Gradient


def test_long_arrays_and_many_parameters_are_counted():
    field = Derivative("film.shape", "m/m", np.linspace(-2.0, 1.0, 300), None)
    numbers = [Derivative(f"spring {k}.length", "m/m", np.array([0.5]), None) for k in range(8)]
    lines = str(Gradient(1.25, "m", (field, *numbers))).splitlines()
    assert lines[0] == "1.25 m"
    assert lines[1] == "by film.shape: 300 values up to 2 m/m"
    assert lines[2] == "by spring 0.length: 0.5 m/m"
    assert lines[4].startswith("and 6 more: spring 2.length, ")
    assert len(lines) == 5
    assert repr(Gradient(1.25, "m", (field,))).splitlines()[0] == "1.25 m"
    four = Gradient(1.0, "", tuple(numbers[:4]))
    assert len(str(four).splitlines()) == 5 and "more" not in str(four)
