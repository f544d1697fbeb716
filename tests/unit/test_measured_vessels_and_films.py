"""Models of vessels with an orifice, of vibrating tubes, of viscoelastic strips and of elliptic
bulges against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from demos.validation.engine.case import Inputs
from demos.validation.models import (
    elliptic_bulge,
    orifice_vessel,
    vibrating_tube,
    viscoelastic_strip,
)


def quantity(value: object, unit: str) -> dict[str, object]:
    """An entry of a case file."""
    return {"value": value, "unit": unit}


VESSEL = {
    "gas": "air",
    "orientation": "horizontal",
    "length": quantity(1, "m"),
    "diameter": quantity(0.2, "m"),
    "wall_thickness": quantity(10, "mm"),
    "wall_density": quantity(7800, "kg/m3"),
    "wall_heat_capacity": quantity(500, "J/(kg K)"),
    "outer_coefficient": quantity(0, "W/(m2 K)"),
    "discharge_coefficient": quantity(0.8, "1"),
    "orifice_diameter": quantity(4, "mm"),
    "start_pressure": quantity(8, "bar"),
    "start_temperature": quantity(300, "K"),
    "outside_pressure": quantity(1e-5, "bar"),
    "outside_temperature": quantity(300, "K"),
    "duration": quantity(10, "s"),
    "step": quantity(0.05, "s"),
}


@pytest.mark.mpi
def test_a_vessel_without_heat_empties_by_the_choked_flow_of_an_isentropic_gas(comm):
    """p ~ f^(-2γ/(γ-1)) and T ~ f⁻² with f = 1 + (γ-1) t/(2 τ), where the time τ is
    V/(C A √(γRT)) ((γ+1)/2)^((γ+1)/(2(γ-1)))."""
    given = VESSEL | {"convection_factor": quantity(0, "1")}
    found = orifice_vessel.predict(Inputs("a vessel", given), comm, quick=False).quantities
    flow_area = 0.8 * math.pi / 4 * 4e-3**2
    volume = math.pi / 4 * 0.2**2
    τ = volume / (flow_area * math.sqrt(1.4 * 287.05 * 300)) * 1.2**3
    f = 1 + 0.2 * found["pressure"].x / τ
    assert found["pressure"].y == pytest.approx(8e5 * f**-7, rel=1e-3)
    assert found["temperature"].y == pytest.approx(300 * f**-2, rel=1e-3)


@pytest.mark.mpi
def test_a_wall_warms_the_gas_that_expands(comm):
    temperatures = []
    for factor in (0.0, 1.0, 100.0):
        given = VESSEL | {"convection_factor": quantity(factor, "1")}
        found = orifice_vessel.predict(Inputs("a vessel", given), comm, quick=True)
        temperatures.append(found.quantities["temperature"].y[-1])
        # What the gas takes the wall has lost.
        assert (found.details["temperature of the wall at the end [K]"] < 300) == (factor > 0)
    assert temperatures[0] < temperatures[1] - 5 < temperatures[2] - 10
    # Strong convection holds the temperature of the wall.
    assert temperatures[2] == pytest.approx(300, abs=3)


def test_free_convection_is_laminar_at_one_bar_and_turbulent_at_ten():
    """By hand: Ra = 1.459e7 and Nu = 36.5; Ra = 1.459e9 and Nu = 147.4."""
    air = orifice_vessel.SUBSTANCES["air"]
    for pressure, nusselt in ((1e5, 36.5), (1e6, 147.4)):
        h = orifice_vessel.convection(air, 0.2, pressure, 290.0, 310.0)
        assert h == pytest.approx(nusselt * 0.0263 / 0.2, rel=5e-3)


TUBE = {
    "length": quantity(0.5, "m"),
    "diameter": quantity(5, "mm"),
    "wall_thickness": quantity(15, "um"),
    "E": quantity(4.9, "GPa"),
    "poisson": quantity(0.38, "1"),
    "bending_stiffness": quantity(4e-3, "N m2"),
    "mass_per_length": quantity(3.5e-4, "kg/m"),
    "air_inside": quantity(3e-5, "kg/m"),
    "air_outside": quantity(2e-5, "kg/m"),
    "gravity": quantity(10, "m/s2"),
    "tension_masses": quantity([1e-4, 0.5], "kg"),
}


@pytest.mark.mpi
def test_a_clamped_tube_has_the_frequencies_of_a_beam_and_of_a_stiff_string(comm):
    found = vibrating_tube.predict(Inputs("a tube", TUBE), comm, quick=True).quantities
    length = 0.5
    beam = 22.3733 / (2 * math.pi * length**2) * math.sqrt(4e-3 / 4e-4)
    # Stiff ends shorten a string by √(EI/T) each; the next term is half of (1 + π²/8) ξ² times 4.
    ξ = math.sqrt(4e-3 / (5.0 * length**2))
    string = math.sqrt(5.0 / 4e-4) / (2 * length) * (1 + 2 * ξ + (4 + math.pi**2 / 2) * ξ**2)
    assert found["frequency"].y == pytest.approx([beam, string], rel=5e-3)
    # Air adds mass only.
    ratio = found["frequency without air"].y / found["frequency"].y
    assert ratio == pytest.approx(math.sqrt(4.0 / 3.5), rel=1e-3)


def test_a_material_that_creeps_by_one_branch_relaxes_by_one():
    E, ρ = viscoelastic_strip.relaxation(1e-9, np.array([3e-9]), np.array([5.0]))
    assert pytest.approx([1e9 - 0.25e9]) == E
    assert ρ == pytest.approx([5.0 / 4])


def test_creep_of_several_branches_is_that_of_the_relaxation():
    """∫ E(t - s) dD(s) = 1: the strain of a creep test gives back its constant stress."""
    times = np.array([0.1, 3.0, 50.0])
    compliances = np.array([2e-10, 1e-10, 4e-10])
    E, ρ = viscoelastic_strip.relaxation(1e-9, compliances, times)
    limit = 1e9 - E.sum()
    assert limit == pytest.approx(1 / (1e-9 + compliances.sum()))
    for t in (0.02, 1.0, 200.0):
        total = 1e-9 * (limit + (E * np.exp(-t / ρ)).sum())
        for compliance, τ in zip(compliances, times, strict=True):
            # Of each pair of exponentials the convolution is known.
            total += compliance * limit * (1 - math.exp(-t / τ))
            pairs = ρ / (ρ - τ) * (np.exp(-t / ρ) - math.exp(-t / τ))
            total += compliance * float((E * pairs).sum())
        assert total == pytest.approx(1.0, rel=1e-9)


HOLD = np.concatenate([np.linspace(0, 1, 41), np.geomspace(1.05, 50, 40)])
STRIP = {
    "times": quantity(HOLD.tolist(), "s"),
    "strains": quantity((0.01 * np.minimum(HOLD, 1)).tolist(), "1"),
    "instantaneous_compliance": quantity(1e-3, "1/MPa"),
    "compliance_factor": quantity(1, "1"),
    "compliances": quantity([3e-3], "1/MPa"),
    "retardation_times": quantity([20.0], "s"),
    "temperature": quantity(300, "K"),
    "reference_temperature": quantity(300, "K"),
    "activation_energy": quantity(200, "kJ/mol"),
    "activation_volume": quantity(2.5e-3, "m3/mol"),
    "shift_by_stress": "no",
}


def stress_of(comm, **others):
    """Of a strip whose strain grows for 1 s and is then held."""
    found = viscoelastic_strip.predict(Inputs("a strip", STRIP | others), comm, quick=False)
    return found.quantities["stress"].y


@pytest.mark.mpi
def test_a_held_strip_relaxes_as_a_standard_linear_solid(comm):
    """E = 250 + 750 exp(-t/5 s) MPa."""
    stress = stress_of(comm)
    held = HOLD >= 1.05
    gone = np.exp(-HOLD[held] / 5) * 5 * (math.exp(0.2) - 1)
    assert stress[held] == pytest.approx(0.01 * (250e6 + 750e6 * gone), rel=2e-3)


@pytest.mark.mpi
def test_heat_and_stress_speed_up_the_relaxation(comm):
    cold = stress_of(comm)
    # By Arrhenius' law 200 kJ/mol and 3 K are a factor of 2.21: as that on the time of the branch.
    shift = math.exp(-200e3 / 8.3145 * (1 / 300 - 1 / 303))
    warm = stress_of(comm, temperature=quantity(303, "K"))
    faster = stress_of(comm, retardation_times=quantity([20.0 * shift], "s"))
    assert shift == pytest.approx(1 / 2.21, rel=5e-3)
    assert warm == pytest.approx(faster, rel=1e-9)
    loaded = stress_of(comm, shift_by_stress="yes")
    # x = V s/(R T) reaches 9: the strip is relaxed where it was half-way without the shift.
    assert loaded[-1] == pytest.approx(0.01 * 250e6, rel=1e-3)
    assert (loaded <= cold * (1 + 1e-9)).all()


@pytest.mark.mpi
@pytest.mark.parametrize("law", ["neo-Hooke", "Green"])
def test_a_round_bulge_is_round_and_as_high_as_it_was_measured(comm, law):
    given = {
        "short_semi_axis": quantity(50, "mm"),
        "long_semi_axis": quantity(50, "mm"),
        "thickness": quantity(100, "um"),
        "pressure": quantity(5, "kPa"),
        "known_height": quantity(10, "mm"),
        "law": law,
    }
    found = elliptic_bulge.predict(Inputs("a bulge", given), comm, quick=True)
    height = found.quantities["height on the short axis"]
    assert height.y[0] == pytest.approx(0.01, rel=1e-4)
    assert found.quantities["height on the long axis"].y == pytest.approx(height.y, rel=2e-3)
    strains = [found.quantities[f"strain of the top, {axis}"].y for axis in ("short", "long")]
    assert strains[0] == pytest.approx(strains[1], rel=5e-3)
    # Hencky: w0 = 0.594 a (p a/(E t))^(1/3) for ν = 0.5, some per cent lower at this height.
    load = 5e3 * 0.05 / (found.details["modulus [Pa]"] * 1e-4)
    assert pytest.approx(0.594 * load ** (1 / 3), rel=0.06) == 0.2
