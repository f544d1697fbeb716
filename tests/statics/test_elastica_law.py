"""The law of wrinkled strips on a sheared film and a bent strip: the wave lengths that it is given,
its error against a plate, and why free films have no equilibrium."""

from __future__ import annotations

import math

import pytest
from mpi4py import MPI

import gossamer_fx as gx
from demos.studies import elastica_cells, elastica_law, elastica_strip, wrinkled_plate


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


@pytest.mark.parametrize("K", [1.5, 3.0, 6.0])
def test_the_section_has_both_closed_forms_as_limits(K: float) -> None:
    """Without compressive stress that of Stein and Hedgepeth, with enough of it that of a beam."""
    tension_field = 1 - 2 / 3 * K**-0.5
    beam = K / 3
    assert elastica_strip.moment(K, 0.0) == pytest.approx(tension_field, abs=1e-4)
    # The lower edge of the beam has the stress (1 - K) σ0.
    assert elastica_strip.moment(K, K * elastica_strip.TENSION) == pytest.approx(beam, rel=1e-10)
    between = elastica_strip.moment(K, 0.1 * elastica_strip.TENSION)
    assert tension_field < between < beam


@pytest.mark.parametrize("thickness", [50e-6, 200e-6])
def test_bending_and_tension_of_the_predicted_wrinkles_are_equal(thickness: float) -> None:
    """The parts D k² κ b²/2 and T κ Λ/(4 k²) of their energy, per length of the strip."""
    k = math.pi / elastica_strip.half_wavelength(thickness)
    b = elastica_strip.WRINKLED
    law = gx.Linear(**elastica_strip.FILM, thickness=thickness)
    D = law.E * law.thickness**3 / (12 * (1 - law.nu**2))
    T = elastica_strip.TENSION * thickness
    bending = D * k**2 * b**2 / 2
    assert T * math.log(k * b) / (4 * k**2) == pytest.approx(bending, rel=1e-9)


@pytest.mark.slow
def test_the_law_is_nearer_to_a_bent_plate_than_a_tension_field() -> None:
    comm = MPI.COMM_WORLD
    plate = elastica_strip.problem(comm, 200e-6, "plate")
    # The theory leaves numbers of the order of one out of the logarithm.
    assert plate["plate's λ [mm]"] == pytest.approx(plate["λ [mm]"], rel=0.35)
    errors = {
        model: elastica_strip.problem(comm, 200e-6, model)["error"]
        for model in ("tension field", elastica_strip.WITH_TENSION)
    }
    assert errors["tension field"] < errors[elastica_strip.WITH_TENSION] < 0
    assert abs(errors[elastica_strip.WITH_TENSION]) < 0.5 * abs(errors["tension field"])


def test_a_free_film_has_more_unstable_directions_the_smaller_its_cells_are() -> None:
    """Their number grows like that of the cells; that of a plate, which bends, does not."""
    unstable = {}
    for body in elastica_cells.BODIES:
        for columns in (12, 24):
            _, plane = elastica_cells.search_from(MPI.COMM_SELF, body, columns, is_plane=True)
            plane.find(progress=False)
            unstable[body, columns] = elastica_cells.unstable_directions(plane)
    # Halved cells are four times as many.
    assert unstable["film", 24] == pytest.approx(4 * unstable["film", 12], rel=0.15)
    assert unstable["plate", 24] <= unstable["plate", 12]
