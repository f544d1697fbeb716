"""Arms wound round a hub are let out by guides on a braked ring."""

from __future__ import annotations

import numpy as np
import pytest

import gossamer_fx as gx
from demos.common.rotation_guides import RotationGuides
from demos.sails import ikaros_arms
from tests.small_scenes import run_until, spin_drift


def test_the_arms_turn_the_ring_and_nothing_passes_through(comm) -> None:
    case = ikaros_arms.build(comm, cells=12, until=0.2)
    run = case.simulation([series := gx.Series(case.probes)])
    run.run(until=0.2 if comm.size == 1 else 0.02)
    # Contact of the arms may cost two rejected steps.
    assert series["penetrations"].max() == 0 and run.substeps <= 2
    assert abs(run.energy_error) < 1e-8
    assert spin_drift(run) < 1e-9
    # After 0.2 s the guides' ring lags behind the hub.
    if comm.size == 1:
        assert series["ring against hub [rad/s]"][-1] > 0.01 and run.totals.dissipated > 0


def test_the_closed_form_begins_as_the_scene_does(comm) -> None:
    """Chords for arcs: 1 %."""
    run = ikaros_arms.build(comm).simulation([])
    corners = ikaros_arms.wound(24)[0]
    tips = np.array([np.linalg.norm(corners[-1])])
    ω = ikaros_arms.START * ikaros_arms.RPM
    measured = ikaros_arms.closed_form(tips, run.totals.angular_momentum[2], 24)
    assert measured == pytest.approx(ω, rel=0.01)


def test_a_reel_draws_the_guides_away(comm) -> None:
    """Its work counts as supplied, the damper's loss as dissipated; both momenta are conserved."""
    hub = gx.RigidBody(10.0, (2.0, 2.0, 2.0), name="hub", comm=comm)
    guides = RotationGuides(
        hub,
        4,
        radius=0.8,
        mass=2.0,
        drawn=lambda t: 0.5 * min(t / 0.4, 1.0),
        reel_depth=0.7,
    )
    run = run_until(0.4, guides, gx.RigidMotion(spin=(0.0, 0.0, 1.0)), dt=1e-3)
    height = gx.probes.Position(guides.ring.port(), "z")(run) - gx.probes.Position(hub.port(), "z")(
        run
    )
    assert height == pytest.approx(-0.5, abs=0.02)
    assert run.totals.supplied > 1.0 and abs(run.energy_error) < 1e-10
    error = np.abs(run.totals.momentum).max()
    assert error < 1e-12
    assert run.totals.angular_momentum == pytest.approx(run.first.angular_momentum, abs=1e-12)


@pytest.mark.slow
def test_the_arms_are_let_out(tmp_path) -> None:
    found = ikaros_arms.main(tmp_path, until=3.0)
    assert found["radius"] > 1.5 and found["penetrations"] == 0
    assert found["rejected"] <= 0.02 * found["steps"]
    assert 0 < found["spin_of_hub"] < found["budget"]  # the arms lag behind the hub that they stop
    assert found["energy_error"] < 1e-8 and found["angular_momentum_drift"] < 1e-9
    assert (tmp_path / "ikaros_arms.png").read_bytes()[1:4] == b"PNG"
