"""The law of wrinkled strips on a sheared film: the wave lengths that it is given, and its error
against a plate."""

from __future__ import annotations

import pytest
from mpi4py import MPI

import gossamer_fx as gx
from demos.studies import elastica_law, wrinkled_plate


def test_the_predicted_wave_length_is_that_of_the_theory() -> None:
    """The theory's λ of 6.31 mm at 25 µm and a shear of 3 mm; it grows with t^½ γ^(-¼)."""
    film = 25e-6
    expected = wrinkled_plate.LAMBDA * (wrinkled_plate.SHEAR / elastica_law.SHEAR) ** 0.25
    # λ goes with √t and with the shear to the power -1/4.
    assert elastica_law.half_wavelength(film) == pytest.approx(expected, rel=1e-12)
    assert elastica_law.half_wavelength(4 * film) == pytest.approx(2 * expected, rel=1e-12)


@pytest.mark.parametrize("thickness", [50e-6, 400e-6])
def test_the_share_that_a_tension_field_leaves_out_is_that_of_the_law(thickness: float) -> None:
    λ = elastica_law.half_wavelength(thickness)
    law = gx.Elastica(**elastica_law.FILM, thickness=thickness, half_wavelength=λ)
    share = 2 * law.onset / elastica_law.GAMMA
    # Onset of the law over the strain of the test, to first order.
    assert elastica_law.left_out(thickness) == pytest.approx(share, rel=1e-3)


def test_wrinkles_of_a_thick_film_have_the_predicted_length() -> None:
    found = elastica_law.reference(400e-6)
    λ = 1e3 * elastica_law.half_wavelength(400e-6)
    assert found["plate's λ [mm]"] == pytest.approx(λ, rel=0.2)
    # More than a tension field, E t L γ/4 of an endless sheet, and less than a sheet that does not
    # wrinkle.
    stiffness = elastica_law.FILM["E"] * 400e-6 * elastica_law.LENGTH * elastica_law.GAMMA
    assert stiffness / 4 < found["force"] < stiffness / (2 * (1 + elastica_law.FILM["nu"]))


@pytest.mark.slow
def test_the_law_is_nearer_to_the_plate_than_a_tension_field() -> None:
    comm = MPI.COMM_WORLD
    errors = {
        model: elastica_law.problem(comm, 200e-6, model)["force error"]
        for model in ("tension field", "Elastica", elastica_law.WITH_TENSION)
    }
    assert errors["tension field"] < errors["Elastica"] < errors[elastica_law.WITH_TENSION] < 0
    # Half of the error of the tension field is the stress of its wrinkles.
    assert abs(errors[elastica_law.WITH_TENSION]) < 0.6 * abs(errors["tension field"])
