"""Partly wrinkled films compared with tension-field solutions."""

from __future__ import annotations

import numpy as np
import pytest

from demos.films import wrinkle_fields
from demos.studies import bending_strip, hub_torsion


@pytest.mark.parametrize("K", [0.5, 1.5, 6.0])
@pytest.mark.parametrize("law", ["Miyazaki 1e-6", "TensionField", "Elastica 0.05 m"])
def test_bending_of_a_tensioned_strip(comm, law, K):
    """m and b/H of Stein & Hedgepeth (1961), half of the cells of the study."""
    result = bending_strip.problem(comm, law, "P1", K, 24)
    assert result["m/exact"] == pytest.approx(1, abs=1e-2)
    assert result["b/H error"] < 0.02
    assert result["P/P0"] == pytest.approx(1, abs=1e-2)


def test_bending_with_quadratic_elements(comm):
    result = bending_strip.problem(comm, "Miyazaki 1e-6", "P2", 2.0, 24)
    assert result["m/exact"] == pytest.approx(1, abs=2e-3)
    assert result["b/H error"] < 0.01


@pytest.mark.parametrize("torque", [1.5, 3.0])
def test_torsion_of_a_hub(comm, torque):
    """Rotation at a torque, and stress next to the hub; the first wrinkles come at torque 1."""
    result = hub_torsion.problem(comm, "Miyazaki 1e-6", "P2", torque, 48)
    assert result["θ/exact"] == pytest.approx(1, abs=1.5e-2)
    assert result["σ1/exact"] == pytest.approx(1, abs=3e-2)


def test_reference_of_the_hub_is_continuous_where_wrinkles_begin():
    critical = hub_torsion.TENSION * hub_torsion.HUB**2
    before, after = (hub_torsion.exact(factor * critical) for factor in (0.9999, 1.0001))
    assert pytest.approx(hub_torsion.HUB, rel=1e-3) == after.R
    assert after.θ == pytest.approx(before.θ, rel=1e-3)


def test_fields_of_wrinkles_are_drawn(folder):
    """b/H = 1 - K^(-½) of the strip wrinkles, in lines across it; of the airbag 0.70 of the cells
    do."""
    found = wrinkle_fields.main(folder)
    assert found["strip wrinkled"] == pytest.approx(1 - wrinkle_fields.K**-0.5, abs=0.01)
    assert found["airbag wrinkled"] == pytest.approx(0.70, abs=0.02)
    assert (folder / "wrinkle_fields.png").read_bytes()[1:4] == b"PNG"
    strip = wrinkle_fields.bent_strip(8)
    wrinkled = strip.state == 1
    assert abs(strip.direction[wrinkled, 1]) == pytest.approx(np.ones(wrinkled.sum()), abs=1e-2)
