"""What other programs test, in the quick form of the cases of the family "peers", which have the
sources: beams in large rotations, films, heavy cables, pendulum and top."""

from __future__ import annotations

import importlib
from dataclasses import replace

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from demos.validation.__main__ import CASES, MODELS, NAMES
from demos.validation.engine.case import Test, read_case
from demos.validation.engine.comparison import compare
from demos.validation.models.loaded_beam import LoadedBeam
from gossamer_fx.meshes.line import line

ALL = [read_case(CASES / f"{name}.toml", MODELS) for name in NAMES]
TESTS = [(case.model, test) for case in ALL if case.family == "peers" for test in case.tests]
# On two ranks as well; beams and bodies have their other tests there.
ON_TWO_RANKS = {"heavy_span"}


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


def test_load_steps_without_inertia_roll_a_beam_up_in_half_of_the_iterations(
    comm: MPI.Intracomm,
) -> None:
    (roll_up,) = [test for _, test in TESTS if test.name == "SSNL103, roll-up"]
    given = LoadedBeam.read(roll_up.inputs)

    def iterations(load_steps: int, first_step: float) -> int:
        axis = line(comm, given.axis(1).tolist(), 8)
        beam = gx.Beam(axis, given.section, normal=(0, 1, 0))
        moment = gx.loads.Torque(beam.frame("end"), lambda t: tuple(t * np.array(given.vector)))
        scene = gx.Scene(beam, gx.Fixed(beam, "start", rotation=True), moment)
        search = gx.Equilibrium(scene, gx.analysis.Continuation(first_step=first_step))
        used = sum(search.find(at=(k + 1) / load_steps).iterations for k in range(load_steps))
        assert np.linalg.norm(search.system.unknowns.state.vector(beam.port("end"))) < 1e-3
        return used

    # 60 and 143
    assert iterations(8, first_step=1e6) < 0.6 * iterations(1, first_step=2e-3)


def test_one_torsion_constant_explains_the_princeton_beam(comm: MPI.Intracomm) -> None:
    """With Saint-Venant's the twelve values differ by up to 3.0e-4 of the length, and 32 elements
    change that by 1e-6.  The source does not give its own."""
    tests = [test for _, test in TESTS if test.name.startswith("Princeton")]
    assert len(tests) == 6
    for test in tests:
        beam = LoadedBeam.read(test.inputs)
        stiffer = replace(beam, section=replace(beam.section, GJ=1.034 * beam.section.GJ))
        start, tip = stiffer.tip(8, comm)
        published = [float(np.ravel(measured.y)[0]) for measured in test.measured]
        assert (tip - start)[1:] == pytest.approx(published, abs=1.5e-5 * beam.length)
