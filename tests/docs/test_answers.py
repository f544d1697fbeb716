"""The demos that answer frequent questions: the check numbers that their texts state."""

from __future__ import annotations

import pytest
from mpi4py import MPI

from demos import airbag_pressure, follower_pressure, uniform_pressure


@pytest.mark.slow
def test_the_pressure_of_an_airbag_follows_its_volume() -> None:
    found = airbag_pressure.main(cells=8)
    assert found["exponent, no heat passes"] == pytest.approx(1.4, abs=1e-4)
    assert found["exponent, perfect wall"] == pytest.approx(1.0, abs=1e-3)
    assert 1.05 < found["exponent, τ = 0.03 s"] < 1.35
    assert max(value for name, value in found.items() if name.startswith("energy")) < 1e-12


@pytest.mark.mpi
def test_an_airbag_starts_on_any_number_of_ranks() -> None:
    _, case = airbag_pressure.build(MPI.COMM_WORLD, conductance=0.0, cells=6)
    run = case.simulation()
    run.run(until=2e-3)
    assert abs(run.energy_error) < 1e-12


@pytest.mark.mpi
def test_a_ring_under_follower_pressure_has_its_closed_frequencies() -> None:
    found = follower_pressure.main(around=32, comm=MPI.COMM_WORLD)
    assert found.pop("stiffness, follower over dead, n = 2") == pytest.approx(4 / 3, rel=4e-3)
    assert list(found.values()) == pytest.approx([1.0] * len(found), abs=6e-3)


def test_the_spread_of_pressure_in_a_round_tube_has_its_closed_form() -> None:
    spread, closed_form = uniform_pressure.spread_of_rigid_tube(10 * uniform_pressure.SOUND)
    assert spread == pytest.approx(closed_form, rel=0.01)
    assert spread == pytest.approx(0.01 / 1.4, rel=0.1)


@pytest.mark.slow
def test_a_flat_tube_is_opened_from_its_inlet_if_it_is_filled_fast() -> None:
    found = uniform_pressure.main(cells=4, parts=4, ratios=(40.0, 5.0))
    assert found["flat tube, T = 5 L/c: spread at T/10 [%]"] > 50
    assert found["flat tube, T = 40 L/c: spread at T/10 [%]"] < 25
