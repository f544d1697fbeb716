"""Air that slows films: closed forms of a fall and a throw, energy balance, moments that vanish by
symmetry."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.solve.scene.validation import warnings
from tests.small_scenes import at_rest, run_until
from tests.survival.scenes import flutter

THIN = {"E": 1e6, "nu": 0.3, "density": 1400.0, "thickness": 1e-5}
# A stiff film stays flat, so that a force on an area has a closed form.
STIFF = gx.Linear(**(THIN | {"E": 1e9}))
FILM = gx.Miyazaki(**THIN, residual_stiffness=1e-6)
PLATE = gx.Linear(**THIN)
# Mass per area [kg/m²]; then density of the air [kg/m³], drag coefficient, gravity [m/s²].
σ = 1400.0 * 1e-5
ρ = 0.1
C = 1.3
g = 9.80665


def body(kind: str, comm: MPI.Comm, velocity: tuple[float, float, float]) -> gx.Membrane:
    """A flat film whose normal is (0, -3, 4)/5, or a plate."""
    given = {
        # The sheet is inclined, so that no component of its normal is zero by chance.
        "displacement": lambda X: np.vstack([0 * X[0], -X[1] / 5, 3 * X[1] / 5]),
        "velocity": lambda X: 0 * X + np.reshape(velocity, (3, 1)),
    }
    mesh = sheet(comm, 2, 2)
    return (
        gx.Plate(mesh, PLATE, name="film", **given)
        if kind == "plate"
        else gx.Membrane(mesh, FILM, **given)
    )


def midpoint(dt: float) -> gx.Midpoint:
    return gx.Midpoint(dt=dt, tolerances=gx.Tolerances(relative=1e-13))


# The normal with a positive z; the film falls along it.
NORMAL = np.array([0.0, -0.6, 0.8])
EVERY = pytest.mark.parametrize("kind", ["film", "plate"])


@EVERY
def test_a_film_falls_at_the_speed_at_which_air_carries_it(comm, kind: str) -> None:
    film = body(kind, comm, (0.0, 0.0, 0.0))
    fall = tuple(-g * NORMAL)
    run = gx.Simulation(
        gx.Scene(film, gx.loads.AirDrag(film, ρ, drag_coefficient=C), gx.Gravity(film, fall)),
        midpoint(4e-3),
    )
    # Terminal speed: the weight σ g balances ½ ρ C v².
    speed = math.sqrt(2 * σ * g / (ρ * C))
    corner = film.port("bottom left")
    run.run(until=0.2)
    v = np.array([gx.probes.Velocity(corner, axis)(run) for axis in "xyz"])
    # Exact is v tanh(g t/v); the midpoint rule with 4 ms is within 1e-4 of it.
    assert v == pytest.approx(-speed * math.tanh(g * 0.2 / speed) * NORMAL, abs=1e-4 * speed)
    run.run(until=1.2)
    v = np.array([gx.probes.Velocity(corner, axis)(run) for axis in "xyz"])
    assert v == pytest.approx(-speed * NORMAL, abs=1e-6 * speed)
    assert list(run.totals.losses) == ["air drag"] and abs(run.energy_error) < 1e-12


@EVERY
def test_of_a_film_that_is_thrown_the_inverse_speed_grows_linearly(comm, kind: str) -> None:
    """Along the film it glides: air takes nothing from that part of its velocity."""
    v0 = 4.0
    along = np.array([1.0, 0.0, 0.0])
    film = body(kind, comm, tuple(v0 * NORMAL + along))
    run = gx.Simulation(
        gx.Scene(film, gx.loads.AirDrag(film, ρ, drag_coefficient=C)),
        midpoint(1e-3),
    )
    corner = film.port("bottom left")
    for t in (0.05, 0.15):
        run.run(until=t)
        v = np.array([gx.probes.Velocity(corner, axis)(run) for axis in "xyz"])
        # d(1/v)/dt = ρ C/2σ for the velocity along the normal.
        assert 1 / (v @ NORMAL) == pytest.approx(1 / v0 + ρ * C * t / (2 * σ), rel=4e-5)
        measured = v - (v @ NORMAL) * NORMAL
        assert measured == pytest.approx(along, abs=1e-9)
    measured = run.totals.losses["air drag"]
    # The ledger closes exactly: the loss is the kinetic energy of the velocity along the normal.
    assert measured == pytest.approx(σ * (v0**2 - (v @ NORMAL) ** 2) / 2, rel=1e-10)
    assert run.totals.supplied == 0 and abs(run.energy_error) < 1e-12


@pytest.mark.mpi(1)
@pytest.mark.parametrize("wind", [(0.0, 0.0, 0.0), (1.0, -2.0, 3.0)])
def test_a_film_that_flutters_loses_what_is_booked(comm, wind) -> None:
    """Wrinkled, slack and turning in space: still air only takes, and a wind gives, too."""
    film = gx.Membrane(sheet(comm, 4, 4), FILM, velocity=flutter)
    air = gx.loads.AirDrag(film, ρ, drag_coefficient=C, wind=wind)
    run = gx.Simulation(gx.Scene(film, air, gx.Damping(film, mass_factor=0.5)), midpoint(1e-3))
    lost = [0.0]
    for k in range(1, 6):
        run.run(until=k * 5e-3)
        lost.append(run.totals.losses["air drag"])
    # Each interval loses at least 1e-4 of the energy, so the loss is not round-off.
    assert (np.diff(lost) > 1e-4 * run.first.energy).all()
    assert (
        abs(run.totals.supplied) > 0.01 * run.first.energy
        if any(wind)
        else run.totals.supplied == 0
    )
    assert abs(run.energy_error) < 1e-12


def test_a_film_that_spins_in_its_plane_keeps_its_spin(comm) -> None:
    """Air pushes it along its axis: it is slowed, and its angular momentum stays, but for the
    strain of its spin, 1e-5, that lets it bulge."""
    film = gx.Membrane(
        sheet(comm, 4, 4),
        STIFF,
        velocity=lambda X: np.vstack([-8 * (X[1] - 0.5), 8 * (X[0] - 0.5), 0 * X[0] + 2]),
    )
    run = gx.Simulation(
        gx.Scene(film, gx.loads.AirDrag(film, ρ, drag_coefficient=C)),
        midpoint(1e-3),
    )
    run.run(until=0.04)
    first = run.first
    now = run.totals
    # Air must have slowed the film by a fifth, or the rest is trivial.
    assert now.momentum[2] < 0.8 * first.momentum[2]
    # About the point (½, ½, 0) over which the film flies.
    about = [t.angular_momentum - np.cross([0.5, 0.5, 0.0], t.momentum) for t in (first, now)]
    assert about[1] == pytest.approx(about[0], abs=1e-9 * abs(about[0][2]))
    assert abs(run.energy_error) < 1e-12


def test_at_rest_air_carries_nothing_and_wind_presses(comm) -> None:
    """In statics: what holds two edges of a flat film bears its weight and ½ ρ C u² on its area."""
    for wind, lift in (((0.0, 0.0, 0.0), 0.0), ((0.0, 0.0, 0.5), ρ * C * 0.5**2 / 2)):
        film = gx.Membrane(sheet(comm, 4, 4), STIFF)
        held = [gx.Fixed(film, edge) for edge in ("left", "right")]
        weight = gx.Gravity(film, (0.0, 0.0, 1.0))
        air = gx.loads.AirDrag(film, ρ, drag_coefficient=C, wind=wind)
        equilibrium = at_rest(film, *held, weight, air)
        total = sum(equilibrium.reaction(support)[0] for support in held)
        assert (
            # 0.2 %: the film sags by its own weight, and wind then presses obliquely.
            total[2] == pytest.approx(-(σ * 1.0 + lift), rel=2e-3) and abs(total[:2]).max() < 1e-6
        )


def test_newton_has_the_tangent_of_the_drag() -> None:
    """With it the iteration of a film that air all but stops converges quadratically."""
    film = body("film", MPI.COMM_WORLD, tuple(4.0 * NORMAL))
    run = run_until(5e-3, film, gx.loads.AirDrag(film, 100 * ρ, drag_coefficient=C), dt=5e-3)
    # Seven iterations at a hundred times the density; a wrong tangent needs far more.
    assert run.iterations <= 7
    assert run.totals.losses["air drag"] > 0.5 * run.first.energy


def test_wind_that_is_no_number_is_refused() -> None:
    film = body("film", MPI.COMM_WORLD, (0.0, 0.0, 0.0))
    with pytest.raises(gx.InputError, match=r"wind is .*; give three"):
        gx.loads.AirDrag(film, 1.0, wind=(1.0, math.nan, 0.0))


def test_thin_air_is_usual_and_water_is_not() -> None:
    film = body("film", MPI.COMM_WORLD, (0.0, 0.0, 0.0))
    assert not [
        words for words in warnings([film, gx.loads.AirDrag(film, 2.4e-4)]) if "air drag" in words
    ]
    [words] = [
        words for words in warnings([film, gx.loads.AirDrag(film, 1000.0)]) if "air drag" in words
    ]
    assert "density = 1000 kg/m³ is unusual" in words
