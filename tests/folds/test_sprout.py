"""Two tubes in V and the film between them deploy from a free cube, with contact and conservation."""

from __future__ import annotations

import math

import numpy as np
import pytest

from demos import sprout

SHORT = {"length": 0.6, "rows": 1, "tank": 5e-4, "damping": 3e-4}


@pytest.mark.mpi
def test_the_tubes_begin_to_open(comm) -> None:
    found = sprout.main(
        comm=comm,
        until=1e-3 if comm.size == 1 else 2e-4,
        crease=1e-3,
        **SHORT,
    )
    assert found["penetrations"] == 0
    assert (
        found["energy_error"] < 1e-8
        and found["mass_error"] < 1e-12
        and found["angular_momentum_drift"] < 1e-9
    )
    assert found["pressure_left_1"] > 1.3 * found["pressure_left_2"] > 0.5


@pytest.mark.mpi
def test_the_stack_is_small_and_in_front_of_the_cube(comm) -> None:
    """Tubes and film fill a box; the root of each tube is where it will be; no layer is stretched much."""
    case = sprout.build(comm)
    starts = [item for item in case.scene.items if type(item).__name__ == "Folded"]
    assert len(starts) == 3
    positions = [part for start in starts for part in comm.allgather(start.positions())]
    x = np.vstack(positions)
    assert x[:, 1].min() > sprout.CUBE / 2 and np.ptp(x, axis=0).max() < 0.6
    assert sum(start.strain_energy() for start in starts) < 0.02
    figure = sprout.Figure(1.5, 0.03, (0.0, 0.0), 0.025)
    (x0, y0), (x1, y1) = figure.axis(1)
    assert math.hypot(x1 - x0, y1 - y0) == pytest.approx(1.5) and math.atan2(
        x1 - x0, y1 - y0
    ) == pytest.approx(sprout.HALF)


@pytest.mark.slow
def test_the_tubes_stand_out_in_v(tmp_path) -> None:
    """Both are straight and as wide as the round tube; span and reach are those of the flat figure within a tenth."""
    found = sprout.main(tmp_path, until=0.12, **SHORT)
    assert found["penetrations"] == 0
    assert (
        found["energy_error"] < 1e-8
        and found["mass_error"] < 1e-12
        and found["angular_momentum_drift"] < 1e-9
    )
    expected = 0.6 * math.cos(sprout.HALF)
    assert found["reach"] == pytest.approx(expected, rel=0.1)
    assert found["span"] > 0.55
    assert found["pressure_left_2"] == pytest.approx(found["pressure_left_1"], rel=1e-2)
    measured = (tmp_path / "sprout.png").read_bytes()[1:4]
    assert measured == b"PNG"
