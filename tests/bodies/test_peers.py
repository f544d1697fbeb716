"""What other programs test, in the quick form of the cases of the family "peers", which have the
sources: beams in large rotations, films, heavy cables, pendulum and top."""

from __future__ import annotations

import importlib

import numpy as np
import pytest
from mpi4py import MPI

from demos.validation.__main__ import CASES, MODELS, NAMES
from demos.validation.engine.case import Test, read_case
from demos.validation.engine.comparison import compare
from demos.validation.models.loaded_beam import LoadedBeam

ALL = [read_case(CASES / f"{name}.toml", MODELS) for name in NAMES]
TESTS = [(case.model, test) for case in ALL if case.family == "peers" for test in case.tests]
# On two ranks as well; beams and bodies have their other tests there.
ON_TWO_RANKS = {"loaded_square", "heavy_span"}


@pytest.mark.parametrize(
    ("model", "test"),
    [
        pytest.param(
            model,
            test,
            id=test.name,
            marks=[pytest.mark.mpi] if model in ON_TWO_RANKS else [],
        )
        for model, test in TESTS
    ],
)
def test_the_value_of_another_program(comm: MPI.Intracomm, model: str, test: Test) -> None:
    predict = importlib.import_module(f"demos.validation.models.{model}").predict
    found = predict(test.inputs, comm, True).quantities
    for measured in test.measured:
        comparison = compare(measured, found[measured.quantity])
        assert comparison.is_accepted(quick=True), f"{measured.quantity}: {comparison.error}"


def test_a_beam_rolled_up_to_a_circle_comes_back_to_its_start(comm: MPI.Intracomm) -> None:
    (roll_up,) = [test for _, test in TESTS if test.name == "SSNL103, roll-up"]
    beam = LoadedBeam.read(roll_up.inputs)
    # Over its length of 1 m: 8.2e-4 and 5.0e-5
    errors = [float(np.linalg.norm(beam.tip(elements, comm)[1])) for elements in (8, 16)]
    assert errors[1] < 1e-4
    assert np.log2(errors[0] / errors[1]) > 3.9
