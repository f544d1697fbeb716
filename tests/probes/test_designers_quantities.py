"""What a designer asks of a film, against closed forms: accuracy of its surface, areas by state,
largest stress, rate of a volume, stiffness of a point."""

from __future__ import annotations

import math

import numpy as np
import pytest
from dolfinx.mesh import locate_entities

import gossamer_fx as gx
from gossamer_fx.core.algebra.rotations import rotations
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.meshes.sphere import sphere
from tests.small_scenes import LINEAR, WRINKLING, at_rest

TURN = rotations(np.array([0.6, -0.8, 0.0]), 0.2)
VERTEX = np.array([3.0, -4.0, 5.0])


def film(comm, moved, *, n=6, order=1, law=LINEAR):
    """A film on the square [-½, ½]² whose points X go to moved(X), with halves as groups."""
    mesh = sheet(comm, n, n)
    mesh.domain.geometry.x[:, :2] -= 0.5
    groups = dict(mesh.groups)
    groups["left half"] = (2, locate_entities(mesh.domain, 2, lambda X: X[0] < 1e-9))
    groups["right half"] = (2, locate_entities(mesh.domain, 2, lambda X: X[0] > -1e-9))
    return gx.Membrane(
        gx.Mesh(mesh.domain, groups), law, order=order, displacement=lambda X: moved(X) - X
    )


def placed(x, y, z):
    """Points (3, n) that are turned by 0.2 rad and shifted."""
    return TURN @ np.vstack([x, y, z]) + VERTEX[:, None]


def best(body, surface, **given):
    return gx.analysis.best_surface(gx.Equilibrium(gx.Scene(body)), body, surface=surface, **given)


@pytest.mark.mpi
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("offset", [0.0, 0.8])
def test_a_paraboloid_has_its_focal_length_vertex_and_tilt(comm, order, offset) -> None:
    """Also if the film is next to the vertex, and of a paraboloid that is open downwards, or is
    shallow."""
    for f in (0.4, -0.4, 20.0):
        body = film(
            comm,
            lambda X, f=f: placed(
                X[0] + offset, X[1], ((X[0] + offset) ** 2 + X[1] ** 2) / (4 * f)
            ),
            order=order,
        )
        found = best(body, "paraboloid")
        assert found.rms < 1e-14 and found.peak_to_valley < 1e-13
        # Of a shallow paraboloid round-off turns the axis, and shifts the vertex by 2 f times that.
        turned = 1e-13 * max(1.0, f**2)
        assert found.focal_length == pytest.approx(abs(f), rel=1e-12)
        assert found.tilt == pytest.approx(0.2, abs=10 * turned)
        np.testing.assert_allclose(found.point, VERTEX, atol=10 * turned * max(1.0, 2 * f))
        # From the vertex to the focus.
        np.testing.assert_allclose(found.axis, math.copysign(1, f) * TURN[:, 2], atol=10 * turned)


@pytest.mark.mpi
def test_noise_on_a_paraboloid_is_its_rms_and_the_fit_is_a_minimum(comm) -> None:
    """A deviation across the surface that no paraboloid has; a fit that begins elsewhere agrees."""

    def moved(X):
        height = (X[0] ** 2 + X[1] ** 2) / 1.6
        return placed(X[0], X[1], height + 1e-5 * np.sin(40 * X[0]) * np.sin(37 * X[1]))

    body = film(comm, moved, n=40)
    found = best(body, "paraboloid")
    again = best(body, "paraboloid", axis=TURN[:, 2] + np.array([0.1, 0.2, 0.0]))
    # Half of the amplitude, and less where the surface is inclined.
    assert 0.4e-5 < found.rms < 0.5e-5
    assert found.rms == pytest.approx(again.rms, rel=1e-9)
    assert found.focal_length == pytest.approx(again.focal_length, rel=1e-8)
    assert found.focal_length == pytest.approx(0.4, rel=1e-4)


@pytest.mark.mpi
@pytest.mark.parametrize("order", [1, 2])
def test_a_sphere_has_its_centre_and_radius(comm, order) -> None:
    body = film(comm, lambda X: placed(X[0], X[1], np.sqrt(4 - X[0] ** 2 - X[1] ** 2)), order=order)
    found = best(body, "sphere")
    assert found.rms < 1e-14
    assert found.radius == pytest.approx(2.0, rel=1e-12)
    np.testing.assert_allclose(found.point, VERTEX, atol=1e-12)
    np.testing.assert_allclose(found.axis, TURN[:, 2], atol=1e-2)


@pytest.mark.mpi
def test_a_tilted_plane_is_flat_and_waves_have_their_rms(comm) -> None:
    flat = best(film(comm, lambda X: placed(2 * X[0], X[1], 0 * X[0])), "plane")
    assert flat.rms < 1e-14
    assert flat.tilt == pytest.approx(0.2, rel=1e-12)
    assert flat.area == pytest.approx(2.0, rel=1e-12)
    # A flat film is on no other surface: the radius is infinite.
    for surface in ("paraboloid", "sphere"):
        same = best(film(comm, lambda X: placed(2 * X[0], X[1], 0 * X[0])), surface)
        assert math.isinf(same.radius) and same.rms < 1e-14

    errors = []
    for n in (8, 16):
        waves = film(comm, lambda X: placed(X[0], X[1], 1e-3 * np.cos(4 * np.pi * X[0])), n=n)
        found = best(waves, "plane")
        assert found.peak_to_valley == pytest.approx(2e-3, rel=1e-6)
        errors.append(abs(found.rms / (1e-3 / math.sqrt(2)) - 1))
    # Lumped areas: the error is that of the trapezoidal rule, none for whole waves.
    assert max(errors) < 1e-4


@pytest.mark.mpi
def test_a_group_has_a_surface_of_its_own(comm) -> None:
    """Two planes that meet at a right angle: each half is flat, the whole film is not."""
    body = film(comm, lambda X: np.vstack([X[0], X[1], np.maximum(X[0], 0.0)]))
    run = gx.Simulation(gx.Scene(body), gx.Midpoint(dt=1e-3))
    tilt = {
        side: gx.probes.SurfaceError(body, quantity="tilt", group=f"{side} half")(run)
        for side in ("left", "right")
    }
    assert tilt["left"] == pytest.approx(0.0, abs=1e-11)
    assert tilt["right"] == pytest.approx(math.pi / 4, rel=1e-12)
    assert gx.probes.SurfaceError(body)(run) > 0.05


@pytest.mark.mpi
def test_a_line_has_no_best_plane(comm) -> None:
    body = film(comm, lambda X: np.vstack([X[0], X[0], X[0]]))
    with pytest.raises(gx.InputError, match="line"):
        best(body, "plane")
    flat = film(comm, lambda X: X)
    with pytest.raises(gx.InputError, match="'left' of 'film' has no film: it is made of curves"):
        best(flat, "plane", group="left")
    with pytest.raises(gx.InputError, match="no group 'wing'"):
        best(flat, "plane", group="wing")
    with pytest.raises(gx.InputError, match=r"axis is \(0\.0, 0\.0, 0\.0\)"):
        best(flat, "plane", axis=(0.0, 0.0, 0.0))


@pytest.mark.mpi
def test_areas_by_state_are_those_of_the_group(comm) -> None:
    """The right half is stretched and wrinkles, the left half is compressed and slack."""

    def moved(X):
        along = np.where(X[0] > 0, 1.01 * X[0], 0.9 * X[0])
        return np.vstack([along, 0.9 * X[1], X[2]])

    body = film(comm, moved, law=WRINKLING)
    scene = gx.Equilibrium(gx.Scene(body))
    area = {
        (state, group): gx.probes.StateArea(body, state, group=group)(scene)
        for state in ("slack", "wrinkled", "taut")
        for group in ("left half", "right half", "film")
    }
    assert area["slack", "left half"] == pytest.approx(0.5, rel=1e-12)
    assert area["wrinkled", "right half"] == pytest.approx(0.5, rel=1e-12)
    assert area["wrinkled", "film"] == pytest.approx(0.5, rel=1e-12)
    assert area["wrinkled", "left half"] == area["slack", "right half"] == 0
    assert area["taut", "film"] == 0
    assert gx.probes.AreaFraction(body, "slack", group="left half")(scene) == 1


@pytest.mark.mpi
@pytest.mark.parametrize("order", [1, 2])
def test_the_largest_stress_is_where_the_strain_is_largest(comm, order) -> None:
    """A film that is moved along x by a X²: that of order 2 has this displacement, that of order 1
    the mean stretch of each cell."""
    stretch = 1e-3
    body = film(comm, lambda X: np.vstack([X[0] + stretch * X[0] ** 2, X[1], X[2]]), order=order)
    scene = gx.Equilibrium(gx.Scene(body))
    peak = gx.analysis.largest_stress(scene, body, limit=1e6)
    # dx/dX of a cell of order 1 is the mean over the cell, whose middle is 1/12 inside.
    slope = 2 * stretch * (0.5 if order == 2 else 0.5 - 1 / 12)
    strain = slope + slope**2 / 2
    # Force over present width and thickness: the film does not narrow, and gets thinner.
    across = math.sqrt(1 - 2 * LINEAR.nu / (1 - LINEAR.nu) * strain)
    exact = (1 + slope) * LINEAR.E / (1 - LINEAR.nu**2) * strain / across
    assert peak.stress == pytest.approx(exact, rel=1e-9)
    assert peak.ratio == pytest.approx(exact / 1e6, rel=1e-9)
    assert peak.point[0] == pytest.approx(0.5, abs=0.2)
    # On the left the film is compressed along x, so that the larger stress is that across.
    left = gx.probes.LargestStress(body, group="left half")(scene)
    assert left < 0.2 * peak.stress


@pytest.mark.mpi
def test_the_rate_of_a_volume_is_its_derivative_in_time(comm) -> None:
    """A balloon whose points move with v = k x: dV/dt = 3 k V."""
    balloon = gx.Membrane(sphere(comm, 1.0, 8), LINEAR, velocity=lambda X: 0.1 * X)
    run = gx.Simulation(gx.Scene(balloon), gx.Midpoint(dt=1e-3))
    volume = gx.analysis.EnclosedVolume(balloon)
    assert gx.analysis.Rate(volume)(run) == pytest.approx(0.3 * volume(run), rel=1e-12)


@pytest.mark.mpi
def test_the_stiffness_of_a_tip_is_that_of_the_cantilever(comm) -> None:
    """3 E I/L³ across with a slender section's shear, E A/L along; infinite at the clamp."""
    section = gx.sections.tube(0.02, 5e-4, E=100e9, nu=0.3, density=1560.0)
    beam = gx.Beam(line(comm, [(0, 0, 0), (1, 0, 0)], 40), section)
    scene = at_rest(beam, gx.Fixed(beam, "start", rotation=True))
    tip = beam.port("end")
    across = gx.analysis.point_stiffness(scene, tip, direction=(0, 0, 2))
    along = gx.analysis.point_stiffness(scene, tip, direction=(1, 0, 0))
    shear = 1 / section.GA2
    assert across == pytest.approx(1 / (1 / (3 * section.EI2) + shear), rel=2e-3)
    assert along == pytest.approx(section.EA, rel=1e-9)
    clamp = beam.port("start")
    assert math.isinf(gx.analysis.point_stiffness(scene, clamp))
    with pytest.raises(gx.InputError, match=r"direction is \(0, 0, 0\)"):
        gx.analysis.point_stiffness(scene, tip, direction=(0, 0, 0))


@pytest.mark.mpi
def test_a_saddle_is_no_better_on_a_paraboloid_than_on_a_plane(comm) -> None:
    body = film(comm, lambda X: np.vstack([X[0], X[1], 0.1 * (X[0] ** 2 - X[1] ** 2)]))
    plane = best(body, "plane")
    paraboloid = best(body, "paraboloid")
    assert paraboloid.rms <= plane.rms * (1 + 1e-9)
    assert paraboloid.radius > 1e3


@pytest.mark.mpi
def test_a_probe_is_of_the_scene_with_which_it_is_called(comm) -> None:
    """As where an equilibrium is found first, and a run follows: both have a compiled scene."""
    body = gx.Membrane(
        sheet(comm, 4, 4), WRINKLING, velocity=lambda X: np.vstack([X[0], 0 * X[:2]])
    )
    other = gx.PointMass(1.0, comm=comm, name="other")
    at_start = gx.Simulation(gx.Scene(body), gx.Midpoint(dt=1e-3))
    later = gx.Simulation(gx.Scene(other, body), gx.Midpoint(dt=1e-3))
    later.run(until=1e-3)
    for make in (
        lambda: gx.probes.LargestStress(body, at="end"),
        lambda: gx.probes.StateArea(body, "taut", at="end"),
        lambda: gx.probes.Crossings(body),
    ):
        probe = make()
        before = probe(at_start)
        assert probe(later) == make()(later)
        assert probe(at_start) == before
    assert gx.probes.LargestStress(body, at="end")(later) > 1.0
