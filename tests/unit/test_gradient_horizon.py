"""The study of how long gradients of deployments predict changes: its parts, and a short form of
it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from demos.studies import gradient_horizon as study
from gossamer_fx.analysis.sensitivity.transient import GROWTH_TO_WARN_OF


def test_the_times_of_a_warning_are_those_of_an_exponential_growth() -> None:
    """With exp(λ t) a warning begins at ln(1000)/λ, and a change of δ is predicted until
    ln(1/δ)/λ."""
    times = np.linspace(0.01, 0.2, 20)
    rate = 50.0
    found = study.warned(times, np.exp(rate * times))
    first = math.log(GROWTH_TO_WARN_OF) / rate
    assert 1e-3 * found["warned at [ms]"] == pytest.approx(first, abs=0.01)
    assert 1e-3 * found["warned 0.0001 [ms]"] == pytest.approx(math.log(1e4) / rate)
    calm = study.warned(times, np.full(20, 4.0))
    assert math.isnan(calm["warned at [ms]"])


def test_gradients_of_the_disc_predict_its_first_milliseconds(comm) -> None:
    """Before layers meet the motion is smooth, and every change is predicted."""
    found = study.problem(comm, "disc", share=0.02)
    last = study.FRAMES - 1
    end = 1e3 * found[f"time {last}"]
    # The difference of two runs has the tolerance of their steps, which counts for the least
    # change.
    for change, bound in ((1e-6, 1e-2), (1e-4, 1e-3), (1e-2, 2e-2)):
        errors = [found[f"error {change:g} at {k}"] for k in range(study.FRAMES)]
        assert max(errors) < bound
        assert found[f"predicts {change:g} [ms]"] == pytest.approx(end)
    # A free motion lets the adjoint grow with the time, which counts as 4.
    assert found["growth"] == pytest.approx(4.0, rel=0.2)
