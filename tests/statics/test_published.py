"""Published benchmarks of membranes, wrinkling and cloth, on the coarsest level."""

from __future__ import annotations

import pytest

from demos.studies.published import CASES, ENERGY, STUDY, problem

QUICK = STUDY.quick["case"]


@pytest.mark.mpi
@pytest.mark.parametrize("case", QUICK)
def test_a_published_benchmark_is_met_on_the_coarsest_level(comm, case: str) -> None:
    figures = problem(comm, case, 0)
    [measure] = STUDY.measures
    assert measure.quick_tolerance is not None
    # Coarse meshes are allowed a multiple of what is accepted on fine ones.
    assert figures["error/accepted"] <= measure.quick_tolerance
    assert figures["error"] == pytest.approx(figures["error/accepted"] * CASES[case][1])
    # Scenes in time close their energy, and nothing passes through anything.
    assert figures.get("energy_error", 0.0) < ENERGY
    assert figures.get("penetrations", 0.0) == 0
