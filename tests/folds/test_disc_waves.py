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


@pytest.mark.mpi
def test_a_disc_that_is_struck_has_waves_in_both_senses(comm) -> None:
    """Two waves around, on a coarse mesh: they run within 3 % of the closed form, and a blow that
    is symmetric about its middle gives both senses the same."""
    # On several ranks only that they agree at the start.
    turns = 3.0 if comm.size == 1 else 0.25
    found = disc_waves.main(comm=comm, cells=2, turns=turns, steps=64)
    assert found["energy_error"] < 1e-10
    closed = found["n = 2: amplitude, closed form [mm]"]
    forward = found["n = 2: amplitude forward [mm]"]
    assert forward == pytest.approx(found["n = 2: amplitude backward [mm]"], rel=0.05)
    if comm.size == 1:
        assert forward == pytest.approx(closed, rel=0.15)
        assert found["n = 2: ω/Ω forward"] == pytest.approx(math.sqrt(2.307), rel=0.03)
