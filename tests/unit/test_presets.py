"""Presets agree with what their sources say in other units, and make laws that work."""

from __future__ import annotations

import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.mechanics.loads.viscoelasticity import loss_of
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.presets import fibres, films, gases

KGF_PER_MM2 = 9.80665e6  # Pa
MATERIALS = [thing for thing in vars(films).values() if isinstance(thing, films.FilmMaterial)]


@pytest.mark.parametrize("material", MATERIALS, ids=lambda m: m.name)
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
    assert films.KAPTON_HN.law(25e-6, residual_stiffness=1e-4).residual_stiffness == 1e-4
    with pytest.raises(gx.InputError, match="thickness"):
        films.KAPTON_HN.law(-1.0)
    with pytest.raises(gx.InputError, match="give a kind of IsotropicFilm"):
        films.MYLAR.law(1e-6, float)


@pytest.mark.parametrize("material", MATERIALS, ids=lambda m: m.name)
def test_each_film_has_a_loss_factor_within_a_range_that_has_a_source(material) -> None:
    low, high = material.loss_range
    assert 0 < low < material.loss_factor < high < 0.1
    assert "assumed" in material.loss_source or "doi:" in material.loss_source
    film = gx.Membrane(sheet(MPI.COMM_SELF, 2, 2), material.law(25e-6))
    damping = gx.loads.flat_damping(film, loss_factor=material.loss_factor, band=(1.0, 1e3))
    assert loss_of(damping.ratios, damping.times, 30.0) == pytest.approx(
        material.loss_factor, rel=0.05
    )


def test_the_loss_of_etfe_is_that_of_its_compliance() -> None:
    """Loss factors from the creep compliance of both directions, at 0.001 to 100 Hz."""
    measured = [0.0245, 0.0239, 0.0256, 0.0237, 0.0275, 0.0273]
    measured += [0.0171, 0.0178, 0.0200, 0.0196, 0.0184, 0.0235]
    assert films.ETFE.loss_factor == pytest.approx(sum(measured) / len(measured), rel=0.02)
    assert films.ETFE.loss_range == pytest.approx((min(measured), max(measured)), abs=6e-4)


def test_mylar_is_as_its_sheet_says_in_other_units() -> None:
    assert pytest.approx((490 + 510) / 2 * KGF_PER_MM2, rel=2e-3) == films.MYLAR.E


@pytest.mark.parametrize(
    "gas, speed",
    # of sound at 0 °C [m/s], measured: CRC Handbook of Chemistry and Physics, section 14, "Speed of
    # sound"
    [(gases.AIR, 331.45), (gases.NITROGEN, 337.0), (gases.HELIUM, 973.0), (gases.ARGON, 308.0)],
)
def test_gases_have_the_measured_speed_of_sound(gas: gx.IdealGas, speed: float) -> None:
    assert (gas.gamma * gas.R * 273.15) ** 0.5 == pytest.approx(speed, rel=4e-3)


FIBRES = [thing for thing in vars(fibres).values() if isinstance(thing, fibres.Fibre)]


@pytest.mark.parametrize("fibre", FIBRES, ids=lambda fibre: fibre.name)
def test_a_cable_of_a_fibre_carries_waves_as_fast_as_the_fibre(fibre: fibres.Fibre) -> None:
    """√(EA/μ) = √(E/ρ), whatever the gaps between the fibres."""
    law = fibre.law(linear_density=2e-3)
    assert (law.EA / law.line_density) ** 0.5 == pytest.approx((fibre.E / fibre.density) ** 0.5)
    assert len(fibre.source) > 40
    with pytest.raises(gx.InputError, match="linear_density is 0"):
        fibre.law(linear_density=0.0)


@pytest.mark.parametrize(
    "fibre, kilograms_per_mm2",
    # the moduli of the same table in its other unit
    [(fibres.VECTRAN_HT, 7600.0), (fibres.TECHNORA, 7500.0), (fibres.POLYESTER, 1300.0)],
)
def test_fibres_are_as_their_sheet_says_in_other_units(
    fibre: fibres.Fibre, kilograms_per_mm2: float
) -> None:
    assert pytest.approx(kilograms_per_mm2 * KGF_PER_MM2, rel=0.03) == fibre.E


def test_pbo_is_as_a_review_lists_it() -> None:
    """270 and 275 GPa: doi:10.1038/s41598-021-87957-7, table 1."""
    assert pytest.approx(270e9, rel=0.02) == fibres.PBO_HM.E
