"""Cords that unwind from a spinning hub stop it according to the closed form."""

from __future__ import annotations

import numpy as np
import pytest

import gossamer_fx as gx
from demos.sails import yo_yo
from tests.small_scenes import spin_drift


def test_the_closed_form_keeps_energy_and_angular_momentum() -> None:
    """Of hub and masses, with the cords' tangent point at angle φ = ω0 t of the hub and s = R φ of
    cord unwound."""
    cells = 36
    R = yo_yo.wound(36)[0]
    I, m, t = yo_yo.inertia(cells), 2 * yo_yo.MASS, np.linspace(0, 0.3, 31)  # noqa: E741
    ω = yo_yo.spin_of(t)
    s = R * yo_yo.SPIN * t
    turning = ω + yo_yo.SPIN  # of the cords' direction
    energy = I * ω**2 / 2 + m * ((R * ω) ** 2 + (s * turning) ** 2) / 2
    momentum = I * ω + m * (R**2 * ω + s**2 * turning)
    assert energy == pytest.approx(energy[0], rel=1e-12)
    assert momentum == pytest.approx(momentum[0], rel=1e-12)


def test_cords_begin_to_unwind(comm) -> None:
    case = yo_yo.build(comm, cells=12, until=4e-3)
    run = case.simulation([series := gx.Series(case.probes)])
    run.run(until=4e-3 if comm.size == 1 else 6e-4)
    assert series["penetrations"].max() == 0
    assert abs(run.energy_error) < 1e-10
    # Contact of cords on the hub is internal.
    assert spin_drift(run) < 1e-11


@pytest.mark.slow
def test_the_hub_is_stopped(tmp_path) -> None:
    found = yo_yo.main(tmp_path)
    # The cords' mass and stiffness, which the closed form leaves out, explain 0.5 %.
    assert found["error_half"] < 0.004 and found["error_whole"] < 0.005
    assert found["energy_error"] < 1e-10 and found["angular_momentum_drift"] < 1e-11
    assert found["penetrations"] == 0 and found["rejected"] == 0
    assert (tmp_path / "yo_yo.png").read_bytes()[1:4] == b"PNG"
