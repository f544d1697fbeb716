"""Weight of the fluids inside and outside of a film: lift, ascent, and the atmosphere."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

import gossamer_fx as gx
from gossamer_fx.loads import FluidPressure, StandardAtmosphere, UniformFluid
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.meshes.sphere import sphere
from gossamer_fx.presets.gases import HELIUM
from tests.small_scenes import LINEAR, run_until

G = 9.80665  # m/s²

# Geopotential altitude [m], temperature [K], pressure [Pa] and density [kg/m³], as printed in U.S.
# Standard Atmosphere, NASA-TM-X-74335, table I.
TABLE = [
    (0.0, 288.15, 1.01325e5, 1.2250),
    (5000.0, 255.65, 5.4020e4, 7.3612e-1),
    (11000.0, 216.65, 2.2632e4, 3.6392e-1),
    (15000.0, 216.65, 1.2045e4, 1.9367e-1),
    (20000.0, 216.65, 5.4749e3, 8.8035e-2),
    (30000.0, 226.65, 1.1719e3, 1.8012e-2),
    (40000.0, 251.05, 2.7752e2, 3.8510e-3),
    (50000.0, 270.65, 7.5944e1, 9.7752e-4),
    (60000.0, 245.45, 2.0314e1, 2.8832e-4),
    (70000.0, 217.45, 4.6342e0, 7.4243e-5),
    (80000.0, 196.65, 8.8627e-1, 1.5700e-5),
]


@pytest.mark.parametrize("row", TABLE, ids=str)
def test_standard_atmosphere_has_the_values_of_its_table(row):
    altitude, temperature, pressure, density = row
    air = StandardAtmosphere()
    assert air.temperature(altitude) == pytest.approx(temperature, abs=1e-9)
    assert air(altitude) == pytest.approx(pressure, rel=5e-5)
    assert air.density(altitude) == pytest.approx(density, rel=5e-5)


def test_altitudes_beyond_the_table_are_refused():
    with pytest.raises(gx.InputError, match="altitude is 90000 m"):
        StandardAtmosphere().temperature(9e4)


def ball(comm, **options):
    return gx.Membrane(sphere(comm, 1.0, 12), LINEAR, **options)


def resultant(film, *loads):
    """Force [N] of loads on a film that starts at rest, from its momentum after a step, which is so
    short that it does not move."""
    dt = 1e-7
    run = run_until(dt, film, *loads, dt=dt)
    return run.totals.momentum / dt


@pytest.mark.mpi(1)
@pytest.mark.parametrize("order", [1, 2])
def test_lift_is_the_weight_of_the_displaced_fluid(comm, order):
    film = gx.Membrane(sphere(comm, 1.0, 12, order=order), LINEAR, order=order)
    air = FluidPressure(film, UniformFluid(1.225, pressure=101325.0), side="outside")
    helium = FluidPressure(film, UniformFluid(0.169), side="inside")
    found = resultant(film, air, helium)
    expected = (1.225 - 0.169) * G * film.mesh.enclosed_volume()
    np.testing.assert_allclose(found, [0.0, 0.0, expected], rtol=1e-6, atol=1e-6 * expected)


@pytest.mark.parametrize("altitude", [8e3, 49e3, 80e3])
def test_lift_in_the_standard_atmosphere_is_that_of_its_density(comm, altitude):
    """The density changes by 2e-4 to 4e-4 over a ball of 2 m, and by symmetry its mean is that in
    the middle to 1e-8."""
    film = ball(comm)
    air = StandardAtmosphere(altitude=altitude)
    found = resultant(film, FluidPressure(film, air, side="outside"))
    expected = air.density(altitude) * G * film.mesh.enclosed_volume()
    assert found[2] == pytest.approx(expected, rel=1e-6)


def test_a_free_balloon_conserves_energy_and_spin(comm):
    """Gas, film and the fluids: the work of the fluids is all that is supplied."""

    def thrown(X):
        return np.vstack([-3 * X[1], 3 * X[0], 0.5 + 0 * X[2]])

    film = ball(comm, velocity=thrown)
    gas = gx.Chamber(film, gas=HELIUM, pressure=1.05e5, temperature=288.15)
    air = FluidPressure(film, StandardAtmosphere(), side="outside")
    helium = FluidPressure(film, UniformFluid(0.17), side="inside")
    run = run_until(0.2, film, gas, air, helium, dt=2e-4, tolerances=gx.Tolerances(relative=1e-12))
    assert run.step == 1000
    assert abs(run.energy_error) <= 1e-9
    change = run.totals.angular_momentum[2] - run.first.angular_momentum[2]
    assert abs(change) <= 1e-9 * abs(run.first.angular_momentum[2])


# ---- natural shape of a balloon ------------------------------------------------------------------

LENGTH = 2.0  # of a meridian [m]
AROUND = 72  # wedges
ALONG = 64  # cells along a meridian
WIDE = 0.7  # radius [m] of the film as made: wider than the balloon, so that it has no hoop stress
NARROW = 0.002  # radius [m] of both ends


def natural_shape():
    """Height and largest radius [m] of a weightless balloon without hoop stress, from its foot,
    where the pressure is zero: with the angle θ to the axis and the tension F/(2πr) of a meridian,

        r' = sin θ,    z' = cos θ,    θ' = -2π r ρ g z/F

    up to r = 0, θ = -π/2 at the end of the meridian (F. Baginski, Math. Comput. Simul. 2002; J. H.
    Smalley, NCAR 1964).  F is over ρ g here."""

    def meridian(unknowns):
        θ0, F = unknowns
        return solve_ivp(
            lambda s, y: (math.sin(y[2]), math.cos(y[2]), -2 * math.pi * y[0] * y[1] / F),
            (0.0, LENGTH),
            (0.0, 0.0, θ0),
            rtol=1e-10,
            atol=1e-12,
            max_step=LENGTH / 500,
        )

    def misses(unknowns):
        r, _, θ = meridian(unknowns).y[:, -1]
        return r, θ + math.pi / 2

    r, z, θ = meridian(fsolve(misses, (0.9, 1.5))).y
    assert math.degrees(θ[0]) == pytest.approx(50.15, abs=0.01)
    return z[-1], r.max()


def wedge(comm):
    """A row of cells on a cylinder, and the normal of its second plane of symmetry."""
    angle = 2 * math.pi / AROUND
    mesh = sheet(comm, 1, ALONG, angle, LENGTH)
    X = mesh.domain.geometry.x
    X[:] = np.column_stack([WIDE * np.cos(X[:, 0]), WIDE * np.sin(X[:, 0]), X[:, 1]])
    return mesh, (-math.sin(angle), math.cos(angle), 0.0)


def half_round(X):
    """Displacement from the cylinder to a sphere, the first guess."""
    R = LENGTH / math.pi
    r = np.maximum(R * np.sin(X[2] / R), NARROW)
    factor = r / WIDE - 1
    return np.vstack([factor * X[0], factor * X[1], R * (1 - np.cos(X[2] / R)) - X[2]])


def test_natural_shape_of_a_balloon_follows_its_differential_equation(comm):
    """On a wedge whose film slides on both planes of symmetry.  A sixth of the width of the wedges
    has 25 times this error."""
    mesh, normal = wedge(comm)
    law = gx.Miyazaki(1e9, 0.0, density=1000.0, thickness=1e-4, residual_stiffness=1e-8)
    film = gx.Membrane(mesh, law, displacement=half_round)
    held = [
        gx.Fixed(film, "bottom"),
        gx.Fixed(film, "top", components=(0, 1)),
        gx.Fixed(film, "left", components=(1,)),
        gx.Fixed(film, "right", normal=normal),
    ]
    lift = FluidPressure(film, UniformFluid(1.0), side="outside")
    equilibrium = gx.Equilibrium(gx.Scene(lift, *held))
    equilibrium.find()
    x = positions(equilibrium, film)
    height, radius = natural_shape()
    assert x[:, 2].max() == pytest.approx(height, rel=5e-3)
    assert np.hypot(x[:, 0], x[:, 1]).max() == pytest.approx(radius, rel=5e-3)


def positions(equilibrium, film):
    return equilibrium.system.unknowns.q0.array_r[
        equilibrium.system.unknowns.block(film).owned
    ].reshape(-1, 3)


def test_gradient_by_the_density_is_that_of_differences(comm):
    def height(density):
        film = gx.Membrane(sheet(comm, 4, 4), LINEAR, initial_stress=1e5, name="film")
        held = [gx.Fixed(film, edge) for edge in ("left", "right", "bottom", "top")]
        water = FluidPressure(film, UniformFluid(density, level=-0.2), side="outside", name="water")
        found = gx.Equilibrium(gx.Scene(water, *held))
        found.find()
        return found, gx.probes.Position(film.port_at((0.5, 0.5, 0.0)), "z")

    equilibrium, probe = height(1000.0)
    slope = gx.analysis.gradient(equilibrium, of=probe, by=["water.density"])
    high, low = (p(state) for state, p in (height(1001.0), height(999.0)))
    assert slope["water.density"].along(1.0) == pytest.approx((high - low) / 2, rel=1e-5)


def test_another_side_is_refused(comm):
    with pytest.raises(gx.InputError, match="side"):
        FluidPressure(ball(comm), UniformFluid(1.2), side="above")
