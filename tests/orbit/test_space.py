"""Elements, shadow, optics, free-molecular flow, Sun and Moon, each against closed forms or another
route."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import integrate, special

import gossamer_fx as gx
from gossamer_fx.mechanics.orbit.elements import Elements, elements_of
from gossamer_fx.mechanics.orbit.harmonics import EARTH_MU, EARTH_RADIUS
from gossamer_fx.mechanics.orbit.optics import JPL_SAIL, MIRROR, PRESSURE, Optics, flow_coefficients
from gossamer_fx.mechanics.orbit.sky import (
    AU,
    MU_MOON,
    MU_SUN,
    SUN_RADIUS,
    Sky,
    sunlit_in_cone,
    sunlit_in_cylinder,
    third_body,
    third_body_gradient,
)

# Ellipses, a hyperbola, and orbits without inclination or eccentricity, whose angles are
# conventions.
ORBITS = [
    Elements(7e6, 0.1, i=1.0, node=2.0, perigee=3.0, anomaly=4.0),
    Elements(42e6, 0.7, i=2.9, node=0.1, perigee=6.0, anomaly=1.0),
    Elements(-8e6, 1.7, i=2.5, node=0.3, perigee=0.4, anomaly=-1.2),
    Elements(7e6),
    Elements(7e6, 0.2, perigee=1.0, anomaly=2.0),
    Elements(7e6, 0.0, i=1.5, node=2.0, perigee=0.0, anomaly=5.0),
]


@pytest.mark.parametrize("orbit", ORBITS)
def test_elements_of_their_own_state(orbit: Elements) -> None:
    again = elements_of(*orbit.state())
    measured = (again.a, again.e, again.i)
    # Conversions to and from elements lose a few bits.
    assert measured == pytest.approx((orbit.a, orbit.e, orbit.i), rel=1e-12, abs=1e-14)
    for angle in ("node", "perigee", "anomaly"):
        difference = getattr(again, angle) - getattr(orbit, angle)
        error = abs(math.remainder(difference, 2 * math.pi))
        assert error < 1e-12


@pytest.mark.parametrize("orbit", ORBITS)
def test_keplers_motion_obeys_newtons_law(orbit: Elements) -> None:
    """The state after a while is that of an integration to 1e-12."""
    r, v = orbit.state()
    t = 4000.0

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[3:], -EARTH_MU * y[:3] / np.linalg.norm(y[:3]) ** 3])

    found = integrate.solve_ivp(
        rate,
        (0, t),
        np.concatenate([r, v]),
        method="DOP853",
        rtol=1e-13,
        atol=1e-6,
    ).y[:, -1]
    r1, v1 = orbit.after(t).state()
    error = np.linalg.norm(found[:3] - r1)
    # DOP853 at 1e-13.
    assert error < 1e-9 * np.linalg.norm(r1)
    error = np.linalg.norm(found[3:] - v1)
    assert error < 1e-9 * np.linalg.norm(v1)


def test_what_is_no_orbit_is_refused() -> None:
    for wrong in (
        {"a": 7e6, "e": 1.0},
        {"a": 7e6, "i": 4.0},
        {"a": -7e6, "e": 2.0, "anomaly": 3.0},
    ):
        with pytest.raises(gx.InputError):
            Elements(**wrong)
    with pytest.raises(gx.InputError, match="straight"):
        elements_of(np.array([7e6, 0, 0]), np.array([1e3, 0, 0]))


@pytest.mark.parametrize(
    ("a", "degrees", "known"),
    [(7e6, 0, 0.364814), (7e6, 20, 0.355513), (7e6, 40, 0.319222), (42164e3, 0, 0.048336)],
)
def test_part_of_an_orbit_in_the_cylinder(a: float, degrees: float, known: float) -> None:
    β = math.radians(degrees)
    sun = AU * np.array([math.cos(β), 0, math.sin(β)])
    exact = math.acos(math.sqrt(a**2 - EARTH_RADIUS**2) / (a * math.cos(β))) / math.pi
    assert exact == pytest.approx(known, abs=5.1e-7)
    angles = math.pi * np.array(
        [1 - exact * (1 - 1e-9), 1 - exact * (1 + 1e-9)]
    )  # just inside, just outside
    lit = [sunlit_in_cylinder(a * np.array([math.cos(x), math.sin(x), 0]), sun) for x in angles]
    assert lit == [0.0, 1.0]


def test_geostationary_orbits_have_seasons_without_shadow() -> None:
    # The Sun is 20° above the orbit's plane: no point of the orbit can be in the shadow.
    β = math.radians(20)
    sun = AU * np.array([math.cos(β), 0, math.sin(β)])
    angles = np.linspace(0, 2 * math.pi, 721)
    assert all(
        sunlit_in_cylinder(42164e3 * np.array([math.cos(x), math.sin(x), 0]), sun) == 1
        for x in angles
    )


def test_penumbra_is_the_share_of_points_of_the_suns_disc() -> None:
    """Points of the disc that the Earth does not hide, counted."""
    sun = AU * np.array([1.0, 0, 0])
    r = 7e6
    # 40 000 points of equal area.
    radius, angle = np.meshgrid(
        np.sqrt((np.arange(200) + 0.5) / 200), 2 * np.pi * (np.arange(200) + 0.5) / 200
    )
    disc = (
        SUN_RADIUS * np.stack([0 * radius, radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
        + sun
    )
    for lateral in np.linspace(EARTH_RADIUS - 4e4, EARTH_RADIUS + 4e4, 9):
        place = np.array([-math.sqrt(r**2 - lateral**2), lateral, 0])
        ray = disc - place
        nearest = (
            place
            - np.sum(ray * place, axis=-1, keepdims=True)
            / np.sum(ray**2, axis=-1, keepdims=True)
            * ray
        )
        seen = np.mean(np.linalg.norm(nearest, axis=-1) > EARTH_RADIUS)
        # The count has the error of the points on the limb.
        assert sunlit_in_cone(place, sun) == pytest.approx(seen, abs=0.006)
    assert sunlit_in_cone(np.array([7e6, 0, 0]), sun) == 1
    assert sunlit_in_cone(np.array([-7e6, 0, 0]), sun) == 0
    far = np.array([-3e9, 0, 0])
    # Beyond the tip of the umbra: one less the ratio of the two discs.
    annular = 1 - (math.asin(EARTH_RADIUS / 3e9) / math.asin(SUN_RADIUS / (AU + 3e9))) ** 2
    assert sunlit_in_cone(far, sun) == pytest.approx(annular, rel=1e-12)


def test_optics_of_mcinnes() -> None:
    # μPa by angle of incidence [deg], of McInnes' non-perfect sail; seven decimals.
    known = {0: (8.287832, 0.0), 30: (6.210109, 0.341425), 60: (2.059537, 0.341425)}
    mirrored, both, along = JPL_SAIL.coefficients()
    for degrees, (normal, tangential) in known.items():
        c = math.cos(math.radians(degrees))
        s = math.sin(math.radians(degrees))
        P = 1e6 * PRESSURE * c
        measured = P * (mirrored * c + both + along * c)
        assert measured == pytest.approx(normal, abs=5.1e-7)
        assert P * along * s == pytest.approx(tangential, abs=5.1e-7)
    ideal = {0: 9.126, 15: 8.514674, 30: 6.8445, 45: 4.563, 60: 2.2815, 75: 0.611326}
    for degrees, pressure in ideal.items():
        c = math.cos(math.radians(degrees))
        measured = 1e6 * PRESSURE * c * (MIRROR.coefficients()[0] * c)
        assert measured == pytest.approx(pressure, abs=5.1e-7)
        measured = MIRROR.coefficients()[1:]
        assert measured == (0, 0)


def test_lit_from_the_back_the_sides_change_places() -> None:
    swapped = Optics(
        0.88,
        0.94,
        emissivity=0.55,
        lambertian=0.55,
        other_side=Optics(0.88, 0.94, emissivity=0.05, lambertian=0.79),
    )
    assert JPL_SAIL.coefficients(back=True) == swapped.coefficients()
    black = Optics(reflectivity=0.0, emissivity=0.9)
    assert black.coefficients() == (0, 0, 1)


@pytest.mark.parametrize("angle", [0.0, 0.6, 1.4, 2.0, 3.1])
@pytest.mark.parametrize("speed", [0.5, 3.0, 9.0])
def test_free_molecular_flow_is_the_integral_over_maxwells_molecules(
    angle: float, speed: float
) -> None:
    """Momentum that molecules bring and carry away, by quadrature over their velocities."""
    c = math.cos(angle)
    s = speed
    wall = math.sqrt(0.3)
    top = max(s * c, 0) + 8  # Gaussian around s c, in units of the thermal speed

    def moment(power: int) -> float:
        """∫ u^power of the molecules that arrive, u their normal velocity."""
        bell = lambda u: u**power * math.exp(-((u - s * c) ** 2)) / math.sqrt(math.pi)  # noqa: E731
        return float(integrate.quad(bell, 0, top, epsabs=1e-14, points=[max(s * c, 0)])[0])

    flux = moment(1)
    brought = moment(2)
    for σn, σt in ((1.0, 1.0), (0.8, 0.9), (0.0, 0.0)):
        # a wall of that heat sends the same number back, with √π/2 of its thermal speed on average
        # along the normal
        pressure = (2 - σn) * brought + σn * flux * math.sqrt(math.pi) / 2 * wall
        shear = σt * flux * s * math.sin(angle)
        A, B = flow_coefficients(c, s, σn, σt, wall, special_numbers)
        assert s**2 / 2 * (A + c * B) == pytest.approx(pressure, rel=1e-7, abs=1e-12)
        assert s**2 / 2 * B * math.sin(angle) == pytest.approx(shear, rel=1e-7, abs=1e-12)


class special_numbers:
    exp = math.exp
    erf = special.erf


def test_sun_on_three_days() -> None:
    pytest.importorskip("erfa")
    for day, known in {
        "2010-06-09": (0.21221281, 0.91075984, 0.39483935),
        "2015-06-23": (-0.01837951, 0.93233010, 0.40417666),
        "2026-01-01": (0.17429528, -0.88792281, -0.38489686),
    }.items():
        # The Sun in an almanac, in au.
        assert np.allclose(Sky(day).sun(0.0) / AU, known, rtol=0, atol=2e-8)
    assert np.allclose(Sky("2010-06-08").sun(86400.0), Sky("2010-06-09").sun(0.0), rtol=1e-12)


def test_moon_and_axes_of_the_earth() -> None:
    pytest.importorskip("erfa")
    sky = Sky("2026-03-20T12:00:00")
    assert 3.5e8 < np.linalg.norm(sky.moon(0.0)) < 4.1e8
    R = sky.earth(0.0)
    assert np.allclose(R @ R.T, np.eye(3), atol=1e-14)
    day = sky.earth(86164.0989)  # a sidereal day later
    error = np.linalg.norm(day - R)
    assert error < 1e-6
    noon = R @ sky.sun(
        0.0
    )  # at the equinox the sun stands over Greenwich at noon, but for the equation of time
    error = abs(math.degrees(math.atan2(noon[1], noon[0])))
    assert error < 2.5
    error = abs(math.degrees(math.asin(noon[2] / np.linalg.norm(noon))))
    assert error < 0.5
    elsewhere = Sky("2026-03-20T14:00:00+02:00")
    assert np.array_equal(elsewhere.sun(0.0), sky.sun(0.0))
    with pytest.raises(gx.InputError, match="epoch"):
        Sky("next Tuesday")


def test_the_sun_as_the_centre_casts_no_shadow() -> None:
    orbit = gx.orbit.Orbit(gx.orbit.Elements(AU), mu=MU_SUN, radius=7e8, sun=(0.0, 0.0, 0.0))
    r, _ = orbit.state
    assert orbit.light(r, 0.0)[1] == pytest.approx(orbit.pressure, rel=1e-12)
    with pytest.raises(gx.InputError, match="casts no shadow"):
        orbit.depth(r, 0.0)


def test_third_bodies_by_the_plain_formula() -> None:
    from mpmath import mp, mpf

    mp.dps = 40
    r = np.array([4e6, 3e6, 5e6])
    b = np.array([2e8, -3e8, 1e8])
    exact_r = [mpf(x) for x in r]
    exact_b = [mpf(x) for x in b]
    d = mp.sqrt(sum((y - x) ** 2 for x, y in zip(exact_r, exact_b, strict=True)))
    D = mp.sqrt(sum(y**2 for y in exact_b))
    plain = [
        float(mpf(MU_MOON) * ((y - x) / d**3 - y / D**3))
        for x, y in zip(exact_r, exact_b, strict=True)
    ]
    # Forty digits of the plain formula, which cancels in double precision.
    assert np.allclose(third_body(r, b, MU_MOON), plain, rtol=1e-13, atol=0)
    step = 1e3
    slopes = [
        (third_body(r + step * e, b, MU_MOON) - third_body(r - step * e, b, MU_MOON)) / 2 / step
        for e in np.eye(3)
    ]
    # Central differences with 1 km.
    assert np.allclose(third_body_gradient(r, b, MU_MOON), slopes, rtol=1e-6, atol=1e-19)
