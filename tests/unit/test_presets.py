"""Presets agree with what their sources say in other units, and make laws that work."""

from __future__ import annotations

import pytest

import gossamer_fx as gx
from gossamer_fx.presets import films, gases

KGF_PER_MM2 = 9.80665e6  # Pa
MATERIALS = [thing for thing in vars(films).values() if isinstance(thing, films.FilmMaterial)]


@pytest.mark.parametrize(
    "material",
    MATERIALS,
    ids=lambda m: m.name,
)
@pytest.mark.parametrize("kind", [gx.Miyazaki, gx.TensionField, gx.Linear])
def test_each_film_makes_each_law(material: films.FilmMaterial, kind: type) -> None:
    law = material.law(7.5e-6, kind)
    assert type(law) is kind and (law.E, law.nu, law.density) == (
        material.E,
        material.nu,
        material.density,
    )
    assert len(material.source) > 40


def test_numbers_of_a_law_are_handed_on_and_nonsense_is_refused() -> None:
    measured = films.KAPTON_HN.law(25e-6, residual_stiffness=1e-4).residual_stiffness
    assert measured == 1e-4
    with pytest.raises(gx.InputError, match="thickness"):
        films.KAPTON_HN.law(-1.0)
    with pytest.raises(gx.InputError, match="is not a law"):
        films.MYLAR.law(1e-6, float)


def test_mylar_is_as_its_sheet_says_in_other_units() -> None:
    measured = pytest.approx((490 + 510) / 2 * KGF_PER_MM2, rel=2e-3)
    assert measured == films.MYLAR.E


@pytest.mark.parametrize(
    "gas, speed",
    # of sound at 0 °C [m/s], measured: CRC Handbook of Chemistry and Physics, section 14, "Speed of sound"
    [(gases.AIR, 331.45), (gases.NITROGEN, 337.0), (gases.HELIUM, 973.0), (gases.ARGON, 308.0)],
)
def test_gases_have_the_measured_speed_of_sound(gas: gx.IdealGas, speed: float) -> None:
    measured = (gas.gamma * gas.R * 273.15) ** 0.5
    assert measured == pytest.approx(speed, rel=4e-3)
