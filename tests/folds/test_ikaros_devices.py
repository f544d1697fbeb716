"""The sail of IKAROS with its devices: its mass, its symmetry, the windmill torque, and its
flights."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from demos.orbit import windmill
from demos.orbit.windmill import DISTANCE, OPTICS
from demos.sails import ikaros, ikaros_devices
from demos.sails.ikaros_devices import Build

# Without bending an equilibrium takes less than a second.
FILM_ONLY = Build(bends=False)


@cache
def spinning() -> gx.Equilibrium:
    """The steady spin of the film without bending, at 1 rpm, in sunlight."""
    return ikaros_devices.steady(MPI.COMM_WORLD, FILM_ONLY, 1.0)


def petals(tilt: float) -> np.ndarray:
    """Triangles (8, 3, 3) of four squares of 1 m², 3 m from the axis, turned about their radius."""
    out = np.array([[2.5], [3.5], [3.5], [2.5]])
    across = np.array([[-0.5], [-0.5], [0.5], [0.5]])
    up = np.array([0.0, 0.0, 1.0])
    found = []
    for angle in np.arange(4) * math.pi / 2:
        radial = np.array([math.cos(angle), math.sin(angle), 0.0])
        around = np.cross(up, radial)
        tilted = math.cos(tilt) * around + math.sin(tilt) * up
        square = out * radial + across * tilted
        found.append(square[[0, 1, 2]])
        found.append(square[[0, 2, 3]])
    return np.array(found)


def test_devices_have_the_mass_that_the_film_has_not() -> None:
    comm = MPI.COMM_WORLD
    film = ikaros_devices.sail(comm, FILM_ONLY)
    mass = ikaros_devices.masses(film)
    assert comm.allreduce(mass.sum()) == pytest.approx(ikaros.PETALS, rel=1e-12)
    # Cells are 5 % of the sail of 174 m², devices along the edge 9 %.
    squares = ikaros_devices.device_squares()
    assert squares == 4 * (6 + 10)
    assert 0.14 < squares * ikaros_devices.PITCH**2 / 174 < 0.16


def test_the_layout_of_devices_has_four_mirrors() -> None:
    # 400 random points: enough that each kind of device occurs.
    points = np.random.default_rng(1).uniform(-7.0, 7.0, (3, 400))
    here = ikaros_devices.device_numbers(points) > 0
    mirrored = ikaros_devices.device_numbers(points * [[-1.0], [1.0], [1.0]]) > 0
    turned = ikaros_devices.device_numbers(points[[1, 0, 2]] * [[-1.0], [1.0], [1.0]]) > 0
    # Some points are on a device.
    assert here.any()
    assert (here == mirrored).all()
    assert (here == turned).all()


def test_petals_have_the_windmill_torque_of_the_closed_form() -> None:
    tilt = 1e-3
    torque = windmill.torque_of_light(MPI.COMM_SELF, petals(tilt))
    mirrored, both, _ = OPTICS.coefficients()
    pressure = windmill.PRESSURE_AT_AU / DISTANCE**2
    assert abs(torque) == pytest.approx(pressure * 4 * 3.0 * tilt * (mirrored + both), rel=1e-5)
    # Petals that are turned the other way drive it the other way.
    opposite = windmill.torque_of_light(MPI.COMM_SELF, petals(-tilt))
    assert opposite == pytest.approx(-torque, rel=1e-9)


def test_the_inertia_of_squares_is_that_of_the_closed_form() -> None:
    mass = np.full(8, 0.5)
    found = ikaros_devices.inertia(MPI.COMM_SELF, petals(0.0), mass)
    # Four squares of 1 kg at 3 m, and tips at their farthest corners.
    of_squares = 4 * (1 / 6 + 9.0)
    of_tips = 4 * ikaros.TIP * (3.5**2 + 0.5**2)
    assert found == pytest.approx(of_squares + of_tips, rel=1e-12)


def test_a_sail_with_mirrors_has_no_windmill_torque() -> None:
    found = ikaros_devices.figures(spinning())
    pressure = windmill.PRESSURE_AT_AU / DISTANCE**2
    assert abs(found["torque"]) < 1e-11 * pressure * 174 * 7
    # Devices farther out than the mean of the sail: more than the 677 kg m² of mass that is spread
    # evenly.
    assert found["J"] == pytest.approx(775.7, abs=0.1)
    assert found["slack tethers"] == 0
    # A sail that sunlight pushes away from the Sun.
    assert 5 < found["warp"] < 10
    # Stretched by its spin: more inertia, less spin.
    assert -1e-5 < found["spin change"] < 0


def test_the_whole_sail_and_its_frozen_shape_fly() -> None:
    search = spinning()
    whole = ikaros_devices.fly_plate(search, FILM_ONLY, 1.0, math.radians(1), turns=0.1, steps=30)
    assert whole["energy_error"] < 1e-9
    assert whole["rejected"] == 0
    rigid = ikaros_devices.fly_frozen(search, 1.0, math.radians(1), until=60.0, dt=6.0)
    assert rigid["energy_error"] < 1e-12
    assert abs(rigid["torque"]) < 1e-12
    # 1 %: the spin axis nutates about its start.
    assert rigid["sun angle"] == pytest.approx(math.radians(1), rel=1e-2)


def test_the_reduced_sail_flies_as_the_whole_one() -> None:
    angle = math.radians(1)
    search = spinning()
    reduced = ikaros_devices.reduced_steady(MPI.COMM_WORLD, FILM_ONLY, 1.0, modes=2, cells=None)
    flight = {"rpm": 1.0, "sun_angle": angle, "turns": 0.1, "steps": 30}
    whole = ikaros_devices.fly_plate(search, FILM_ONLY, **flight)
    found = ikaros_devices.fly_plate(reduced, FILM_ONLY, **flight)
    assert found["energy_error"] < 1e-9
    assert found["rms height"] == pytest.approx(whole["rms height"], rel=0.05)
    # Light from the side tilts the axis by its torque over the angular momentum.
    assert 0 <= found["drift of the axis"] < 1e-5
    assert abs(found["spin change"]) < 1e-9
    assert found["outside"] < 0.1


@pytest.mark.slow
def test_curved_devices_make_a_windmill_whose_torque_brakes_the_flight() -> None:
    search = ikaros_devices.steady(MPI.COMM_WORLD, Build(curvature=2.0, seed=2), 1.0)
    found = ikaros_devices.figures(search)
    assert found["rms tilt"] > 3
    assert abs(found["torque"]) > 1e-7
    rigid = ikaros_devices.fly_frozen(search, 1.0, 0.0, until=20.0, dt=1.0)
    # The static torque is of the same triangles, at a sun angle of zero; a step turns the sail by
    # 6°.
    assert rigid["torque"] == pytest.approx(found["torque"], rel=0.05)


def test_the_frozen_shape_changes_little_over_a_day(comm) -> None:
    """A film that its spin stretches has heights in proportion to the light; what the light
    stretches makes it stiffer."""
    found = ikaros_devices.change_over_a_day(comm, FILM_ONLY, 1.0)
    mirrored, diffuse, along_light = OPTICS.coefficients()
    # Of pressure p = a cos α + b cos² α the change is -(a/2 + b) Δ(α²) / (a + b), to second order.
    before, after = ikaros_devices.DAY
    share = (diffuse / 2 + mirrored + along_light) / (diffuse + mirrored + along_light)
    expected = -share * (after**2 - before**2)
    assert found["pressure change"] == pytest.approx(expected, rel=2e-3)
    assert 0.5 * abs(expected) < found["shape change"] < abs(expected)
    # Without bending the torque is round-off.
    assert math.isnan(found["torque change"])


def test_a_larger_change_of_the_sun_angle_changes_the_shape_more() -> None:
    """Twice the change of the pressure is twice the change of the shape."""
    small = ikaros_devices.change_over_a_day(MPI.COMM_WORLD, FILM_ONLY, 1.0, (0.0, 0.05))
    large = ikaros_devices.change_over_a_day(MPI.COMM_WORLD, FILM_ONLY, 1.0, (0.0, 0.1))
    of_pressure = large["pressure change"] / small["pressure change"]
    of_shape = large["shape change"] / small["shape change"]
    assert of_shape == pytest.approx(of_pressure, rel=0.03)
