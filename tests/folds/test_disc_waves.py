"""Waves round a spinning disc on a hub: their closed form, and a disc that is struck."""

from __future__ import annotations

import math

import numpy as np
import pytest

from demos.sails import disc_waves


def test_modes_are_those_of_the_literature() -> None:
    """(ω/Ω)² of Eversman & Dodson (1969) for a hub of a fifth of the radius, ν = 0.3."""
    squares = [disc_waves.mode(n, hub=0.2, nu=0.3)[0] ** 2 for n in range(4)]
    assert squares == pytest.approx([0.733432, 1.158668, 2.276136, 3.843137], rel=2e-5)


def test_without_a_hub_modes_are_those_of_a_free_disc() -> None:
    """Lamb & Southwell (1921): (2.5 - ν/2) Ω² for n = 2, and w = r²."""
    ratio, r, shape = disc_waves.mode(2, hub=1e-3, nu=0.3)
    assert ratio**2 == pytest.approx(2.35, rel=1e-4)
    assert np.abs(shape / shape[-1] - r**2).max() < 1e-3


@pytest.mark.parametrize("n", [0, 1, 3])
def test_masses_at_the_rim_of_slack_film_do_not_change_its_waves(n: int) -> None:
    """Strings from the axis are straight, w = r, at ω = Ω, whatever mass is at their ends."""
    ratio, r, shape = disc_waves.mode(n, hub=1e-3, rim=1.4, slack=True)
    assert ratio == pytest.approx(1.0, rel=2e-3)
    assert np.abs(shape / shape[-1] - r).max() < 5e-3


def test_a_disc_with_masses_at_its_rim_tilts_as_one() -> None:
    """n = 1 without a hub is a rotation out of the plane of the spin: ω = Ω."""
    ratio, r, shape = disc_waves.mode(1, hub=1e-3, rim=1.4)
    assert ratio == pytest.approx(1.0, rel=1e-4)
    assert np.abs(shape / shape[-1] - r).max() < 2e-3


def test_waves_of_a_ring_are_separated_by_number_and_sense() -> None:
    """Three forward waves, and a ring that rises and falls as a whole, over angles that are not
    even."""
    share = np.linspace(0.0, 1.0, 600)
    turned = 10 * math.pi * (share + 0.1 * share**2)
    angle = 2 * math.pi / 24 * np.arange(24)[:, None]
    heights = 0.02 * np.cos(3 * angle - 2 * turned) + 0.05 * np.cos(1.1 * turned)
    curves = disc_waves.separate(turned, heights, (0, 3))
    assert curves["ω/Ω forward"] == pytest.approx([1.1, 2.0], rel=5e-3)
    assert curves["amplitude forward [mm]"] == pytest.approx([25.0, 20.0], rel=0.02)
    assert curves["amplitude backward [mm]"][0] == pytest.approx(25.0, rel=0.02)
    assert curves["amplitude backward [mm]"][1] < 0.1


@pytest.mark.mpi
def test_waves_of_a_disc_that_leaves_its_roll(comm) -> None:
    """At first it turns with the hub, at 8 revolutions a second.  Six sides that are equal would
    have no wave with n = 1."""
    end = 3.4e-3
    found = disc_waves.folded(until=end, opened=0.0, dt=2e-4, largest=2e-4, comm=comm)
    assert found["energy_error"] < 1e-10 and found["penetrations"] == 0
    assert found["revolutions"] == pytest.approx(8.0 * end, rel=0.03)
    assert found["n = 1: amplitude forward [mm]"] > 1e-5


@pytest.mark.mpi
def test_a_disc_that_is_struck_has_waves_in_both_senses(comm) -> None:
    """Two waves around, on a coarse mesh: they run within 3 % of the closed form, and a blow that
    is symmetric about its middle gives both senses the same."""
    # On several ranks only that they agree at the start.
    turns = 3.0 if comm.size == 1 else 0.25
    found = disc_waves.main(comm=comm, cells=2, turns=turns, steps=64)
    assert found["energy_error"] < 1e-10
    closed = found["n = 2: amplitude closed form [mm]"]
    forward = found["n = 2: amplitude forward [mm]"]
    assert forward == pytest.approx(found["n = 2: amplitude backward [mm]"], rel=0.05)
    if comm.size == 1:
        assert forward == pytest.approx(closed, rel=0.15)
        assert found["n = 2: ω/Ω forward"] == pytest.approx(math.sqrt(2.307), rel=0.03)
