"""Two tubes in V and the film between them deploy from a cube, with contact and conservation; their
deployed state."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from demos.inflatables import sprout

SHORT = {"length": 0.6, "rows": 1, "tank": 5e-4, "damping": 3e-4}


@pytest.mark.mpi
def test_the_tubes_begin_to_open(comm) -> None:
    found = sprout.main(comm=comm, until=1e-3 if comm.size == 1 else 2e-4, crease=1e-3, **SHORT)
    assert found["penetrations"] == 0
    assert (
        found["energy_error"] < 1e-8
        and found["mass_error"] < 1e-12
        and found["angular_momentum_drift"] < 1e-9
    )
    assert found["pressure_left_1"] > 1.3 * found["pressure_left_2"] > 0.5


@pytest.mark.mpi
def test_the_stack_is_small_and_in_front_of_the_cube(comm) -> None:
    """Tubes and film fill a box; the root of each tube is where it will be; no layer is stretched
    much."""
    case = sprout.build(comm)
    starts = [item for item in case.scene.items if type(item).__name__ == "Folded"]
    assert len(starts) == 3
    positions = [part for start in starts for part in comm.allgather(start.positions())]
    x = np.vstack(positions)
    assert x[:, 1].min() > sprout.CUBE / 2 and np.ptp(x, axis=0).max() < 0.6
    assert sum(start.strain_energy() for start in starts) < 0.02
    figure = sprout.Figure(1.5, 0.03, (0.0, 0.0))
    (x0, y0), (x1, y1) = figure.axis(1)
    assert math.hypot(x1 - x0, y1 - y0) == pytest.approx(1.5) and math.atan2(
        x1 - x0, y1 - y0
    ) == pytest.approx(sprout.HALF)


@pytest.mark.slow
def test_the_tubes_stand_out_in_v(tmp_path) -> None:
    """Both are straight and as wide as the round tube; span and reach are those of the flat figure
    within a tenth."""
    found = sprout.main(tmp_path, until=0.12, **SHORT)
    assert found["penetrations"] == 0
    assert (
        found["energy_error"] < 1e-8
        and found["mass_error"] < 1e-12
        and found["angular_momentum_drift"] < 1e-9
    )
    assert found["reach"] == pytest.approx(0.6 * math.cos(sprout.HALF), rel=0.1)
    assert found["span"] > 0.55
    assert found["pressure_left_2"] == pytest.approx(found["pressure_left_1"], rel=1e-2)
    assert (tmp_path / "sprout.png").read_bytes()[1:4] == b"PNG"


def test_the_lid_of_the_box_turns_the_cube_back(comm) -> None:
    """A cube of 5 kg carries the box: momenta of lid, films and cube together are conserved; the
    valves are closed."""
    found = sprout.main(comm=comm, until=1e-3, mass=5.0, box=True, delay=1.0, **SHORT)
    assert found["penetrations"] == 0
    assert found["energy_error"] < 1e-9
    assert found["angular_momentum_drift"] < 1e-9
    # A spring of 10 N m for a millisecond: a quarter of its impulse turns the lid about its own
    # centre, and the cube has the opposite, less what the lid has by its way past the cube.
    lid_share = 2.5e-3 / sprout.inertia(5.0)
    assert 0.3 * lid_share < found["spin"] < lid_share
    # Nothing has left the tank.
    assert found["pressure_left_1"] < 2.0


def test_on_the_ground_the_cube_is_held_and_air_takes_energy(comm) -> None:
    found = sprout.main(comm=comm, until=5e-4, gravity=9.80665, down="-y", air=1000.0, **SHORT)
    assert found["energy_error"] < 1e-9
    assert found["spin"] < 1e-12
    assert found["dissipated by air drag on film"] > 0
    # The tubes start with the pressure of the air around them.
    assert found["pressure_right_2"] == pytest.approx(1000.0, rel=0.05)


def test_words_that_are_not_known_are_refused() -> None:
    with pytest.raises(gx.InputError, match="down is 'down'; give '-x' or"):
        sprout.build(MPI.COMM_WORLD, gravity=9.8, down="down")
    with pytest.raises(gx.InputError, match="attachment is 'glued'; give 'hung' or"):
        sprout.deployed(MPI.COMM_WORLD, attachment="glued")


def test_the_deployed_tubes_bear_the_film(comm) -> None:
    """Deflection of the tips, moment at the root and tension are those of the design by closed
    forms."""
    held = sprout.deployed(comm, cell=0.016, film_cell=0.1, held=True)
    alone = sprout.deployed(comm, cell=0.016, held=True, attachment="none")
    for satellite in (held, alone):
        result = satellite.statics.find()
        assert result.within_tolerance
        assert result.regular
    deflection = sprout.tip_deflection(held, alone)
    assert deflection == pytest.approx(held.shape.deflection, rel=0.08)
    first, second = sprout.mean_tensions(held)
    assert (first + second) / 2 == pytest.approx(sprout.TENSION, rel=0.3)
    mode = gx.analysis.modes(alone.statics, 1)[0]
    exact = sprout.beam_frequency(alone.figure, sprout.THICKNESS)
    assert mode.frequency == pytest.approx(exact, rel=0.06)


def test_forces_of_film_and_cables_are_in_equilibrium() -> None:
    """The three forces on the cords add up to nothing, and meet in one point."""
    figure = sprout.Figure(1.5, 0.03, (0.0, 0.0))
    shape = sprout.cut(figure, 12.5e-6, 8e-3, 1e4)
    assert np.abs(shape.forces.sum(axis=0)).max() < 1e-14
    x, y = shape.corners.T
    moments = x * shape.forces[:, 1] - y * shape.forces[:, 0]
    assert abs(moments.sum()) < 1e-14


def test_a_flat_root_is_a_hinge() -> None:
    """Across its plane a tube with a flat root has a hundredth of the frequency of a clamped one,
    at most."""
    flat = sprout.deployed(MPI.COMM_WORLD, cell=0.016, held=True, attachment="none", roots="flat")
    flat.statics.find()
    exact = sprout.beam_frequency(flat.figure, sprout.THICKNESS)
    assert gx.analysis.modes(flat.statics, 1)[0].frequency < 0.01 * exact


def test_a_film_cut_for_flat_tubes_closes_the_v(comm) -> None:
    """Round tubes are narrower, so that such a film pulls them together; one that is cut for round
    tubes leaves the angle as it is."""
    half_angles = {}
    for roots, cell in (("flat", 0.03), ("round", 0.016)):
        satellite = sprout.deployed(
            comm,
            length=0.4,
            pressure=8100.0,
            cell=cell,
            film_cell=0.06,
            held=True,
            attachment="tied",
            roots=roots,
        )
        satellite.statics.find()
        half_angles[roots] = satellite.half_angle()
    assert half_angles["round"] == pytest.approx(30.0, abs=0.4)
    assert half_angles["flat"] < 27.0
