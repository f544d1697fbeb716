"""A step that does not resolve the motion: its ends alternate, its means do not."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest
from mpi4py import MPI

import gossamer_fx as gx
from demos.methods import step_size
from demos.methods.step_size import swing, window

ROOT = Path(gx.__file__).parent.parent
UNTIL = 0.25  # s


def test_means_over_long_steps_do_not_alternate(comm, caplog) -> None:
    with caplog.at_level(logging.WARNING, logger="gossamer_fx"):
        series = step_size.move(comm, 5e-3, until=UNTIL)
    swings = {name: swing(window(series, name)) for name in series.probes}
    # The taut part changes by more than half of the dish from one end to the next.
    assert swings["taut, end"] > 0.3 and swings["taut, mean"] < 0.07
    tension = window(series, "tension, mean").mean()
    assert swings["tension, end"] > 0.3 * tension
    assert swings["tension, mean"] < 0.05 * tension
    warnings = [record.getMessage() for record in caplog.records if "'dish'" in record.message]
    assert len(warnings) == (comm.rank == 0)
    if warnings:
        assert "Damping with a stiffness_factor" in warnings[0]


@pytest.mark.mpi(1)
@pytest.mark.parametrize(("dt", "alternates"), [(0.1, True), (5e-3, False)])
def test_ropes_that_are_taut_at_every_other_end_are_named_once(
    comm, caplog, dt: float, alternates: bool
) -> None:
    """A mass between two ropes, with a period of 63 ms."""
    mass = gx.PointMass(1.0, velocity=(1.0, 0.0, 0.0), comm=comm)
    ropes = [
        gx.connectors.Rope(
            gx.Ground((side, 0.0, 0.0)), mass.port(), stiffness=1e4, length=1.0, name=f"rope {side}"
        )
        for side in (-1, 1)
    ]
    tensions = gx.Series({rope.name: gx.probes.Tension(rope) for rope in ropes})
    with caplog.at_level(logging.WARNING, logger="gossamer_fx"):
        gx.Simulation(gx.Scene(*ropes), gx.Midpoint(dt=dt), outputs=[tensions]).run(until=20 * dt)
    said = [
        record.getMessage()
        for record in caplog.records
        if "of ropes their damping" in record.message
    ]
    assert len(said) == (2 if alternates and comm.rank == 0 else 0)
    assert tensions["rope 1"].max() > 0


def test_means_are_those_of_a_step_five_times_shorter() -> None:
    found = {}
    for dt in (5e-3, 1e-3):
        series = step_size.move(MPI.COMM_SELF, dt, until=UNTIL)
        found[dt] = [window(series, f"{name}, mean").mean() for name in ("tension", "taut")]
    (tension, taut), (exact_tension, exact_taut) = found.values()
    assert tension == pytest.approx(exact_tension, rel=0.01)
    # The shorter step resolves more of the vibrations, by which the dish is slack at times.
    assert taut == pytest.approx(exact_taut, abs=0.2)


def test_damping_near_the_step_removes_the_oscillation_as_the_page_says() -> None:
    results = step_size.main(steps=[5e-3])
    damped = [name for name in results if "damping" in name and name.endswith("swing [N]")]
    assert len(damped) == 2
    for name in damped:
        undamped = name.replace(", damping of 5 ms", "")
        assert results[name] < 0.05 * results[undamped]
    page = (ROOT / "docs/howto/step_size.md").read_text(encoding="utf-8")
    for name, row in (("dt = 5 ms", "none"), ("dt = 5 ms, damping of 5 ms", "near the step")):
        # The first of both tables is of the taut part, the second one of the tension.
        lines = [line for line in page.splitlines() if line.startswith(f"| 5 | {row} |")]
        assert len(lines) == 2
        shown = [float(cell) for line in lines for cell in line.split("|")[3:-1]]
        found = [
            results[f"{name}, {at}: {quantity}"]
            for quantities in (("taut", "taut, swing"), ("tension [N]", "tension, swing [N]"))
            for at in ("mean", "end")
            for quantity in quantities
        ]
        # Vibrations that nothing damps depend on round-off.
        assert found == pytest.approx(shown, abs=0.06)
