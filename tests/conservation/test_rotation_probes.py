"""Nutation, angular momentum about the centre of mass and waves of spinning scenes, against closed
forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.meshes.revolved import whole_disc


def test_a_symmetric_body_keeps_its_nutation_and_its_momentum_goes_around_in_it(comm):
    """In body axes the transverse momentum turns at (I_a/I_t - 1) ω_a (Euler's equations)."""
    I_t = 0.1
    I_a = 0.15
    ω_t = 0.4
    ω_a = 3.0
    # The centre of mass flies and lies off the origin: neither counts.
    top = gx.RigidBody(
        2.0,
        (I_t, I_t, I_a),
        position=(1.0, -2.0, 0.5),
        velocity=(3.0, 1.0, 0.0),
        spin=(ω_t, 0.0, ω_a),
        comm=comm,
    )
    nutation = gx.probes.Nutation(top.frame())
    in_body = [gx.probes.AngularMomentum(axis, frame=top.frame()) for axis in "xyz"]
    in_space = gx.probes.AngularMomentum("z")
    run = gx.Simulation(gx.Scene(top), gx.Midpoint(dt=2e-3))
    assert in_space(run) == pytest.approx(I_a * ω_a, rel=1e-12)
    run.run(until=0.5)

    # I_t, I_a and both spins give the angle of the cone; 1e-4 is the phase error of 2 ms steps.
    assert nutation(run) == pytest.approx(math.atan2(I_t * ω_t, I_a * ω_a), rel=1e-4)
    assert in_space(run) == pytest.approx(I_a * ω_a, rel=1e-10)
    phase = (I_a / I_t - 1) * ω_a * run.time
    expected = [I_t * ω_t * math.cos(phase), I_t * ω_t * math.sin(phase), I_a * ω_a]
    assert [probe(run) for probe in in_body] == pytest.approx(expected, rel=1e-3, abs=1e-5)


@pytest.mark.parametrize("sense", [1, -1])
def test_a_wave_runs_around_a_spinning_disc_as_lamb_and_southwell_found(comm, sense):
    """In axes that turn with a disc without bending stiffness two waves without nodal circle have
    ω² = (2.5 - ν/2) Ω².

    H. Lamb, R. Southwell, Proc. R. Soc. Lond. A 99 (1921) 272: with n waves, s nodal circles and m
    = n + 2 s,

        ω²/Ω² = (m (m + 2) (3 + ν) - n² (1 + 3 ν))/8

    and for s = 0 the displacement grows with the n-th power of the radius.
    """
    ν = 0.3
    spin = 10.0
    ω = spin * math.sqrt(2.5 - ν / 2)
    size = 2e-3

    def out_of_plane(X: np.ndarray) -> np.ndarray:
        return np.stack([0 * X[0], 0 * X[0], size * (X[0] ** 2 - X[1] ** 2)])

    def velocity(X: np.ndarray) -> np.ndarray:
        # d/dt of r² cos(2 θ - ω t), and the spin
        up = sense * ω * size * 2 * X[0] * X[1]
        return np.stack([-spin * X[1], spin * X[0], up])

    # Stiff, so that the stretch of the disc by its spin changes no frequency: ρ Ω² R²/E = 1e-4.
    law = gx.Linear(E=1e6, nu=ν, density=1.0, thickness=1e-3)
    film = gx.Membrane(whole_disc(comm, 6), law, displacement=out_of_plane, velocity=velocity)
    angles = np.arange(8) * math.pi / 4
    # Points of an edge are chords of the circle: a little inside is in the mesh.
    ring = [film.port_at((0.9 * math.cos(θ), 0.9 * math.sin(θ), 0.0)) for θ in angles]
    waves = {
        part: gx.probes.Waves(ring, gx.ground_frame(), number=2, part=part)
        for part in ("cosine", "sine")
    }
    series = gx.Series(waves)
    run = gx.Simulation(gx.Scene(film), gx.Midpoint(dt=4e-3), outputs=[series])
    # Four periods in turning axes.
    run.run(until=4 * 2 * math.pi / ω)
    # The points turn with the disc, and so do the coefficients.
    found = gx.analysis.travelling_waves(series.time, series["cosine"], series["sine"])

    strong, weak = (found.forward, found.backward)[::sense]
    frequency, _ = (found.forward_frequency, found.backward_frequency)[::sense]
    assert frequency == pytest.approx(ω, rel=2e-2)
    assert strong == pytest.approx(size * 0.9**2, rel=5e-2)
    assert weak < 0.1 * strong


@pytest.mark.mpi
def test_radii_of_an_ellipse_have_two_waves_and_an_imbalance(comm):
    film = gx.Membrane(
        whole_disc(comm, 3),
        gx.Linear(E=1e6, nu=0.3, density=1.0, thickness=1e-3),
        displacement=lambda X: np.stack([0.1 * X[0], -0.1 * X[1], 0 * X[2]]),
    )
    angles = np.arange(8) * math.pi / 4
    # Inside the rim, where every point lies in a triangle.
    ring = [film.port_at((0.9 * math.cos(θ), 0.9 * math.sin(θ), 0.0)) for θ in angles]
    run = gx.Simulation(gx.Scene(film), gx.Midpoint(dt=1e-3))
    # r = 0.9 √(1.01 + 0.2 cos 2θ) at eight points
    radius = 0.9 * np.sqrt(1.01 + 0.2 * np.cos(2 * angles))
    two = gx.probes.Waves(ring, gx.ground_frame(), number=2, quantity="radius")
    mean = gx.probes.Waves(ring, gx.ground_frame(), number=0, quantity="radius")
    imbalance = gx.probes.Imbalance(ring, gx.ground_frame())
    # The second Fourier coefficient of the eight radii: 2/8 of the sum with cos 2θ.
    assert two(run) == pytest.approx(radius @ np.cos(2 * angles) / 4, rel=1e-6)
    assert mean(run) == pytest.approx(radius.mean(), rel=1e-6)
    # Difference of the longest and the shortest radius over the mean.
    assert imbalance(run) == pytest.approx((1.1 - 0.9) * 0.9 / radius.mean(), rel=1e-6)


def test_waves_of_both_senses_are_told_apart(comm):
    t = np.sort(np.random.default_rng(3).uniform(0.0, 3.0, 900))
    forward = 0.2 * np.exp(1j * (17.0 * t - 0.4))
    backward = 0.05 * np.exp(-1j * (31.0 * t + 1.0))
    z = forward + backward + 0.3
    # The limits are the leakage of a window of three seconds with uneven samples.
    found = gx.analysis.travelling_waves(t, z.real, z.imag)
    assert found.forward == pytest.approx(0.2, rel=1e-2)
    assert found.forward_frequency == pytest.approx(17.0, rel=2e-3)
    assert found.backward == pytest.approx(0.05, rel=3e-2)
    assert found.backward_frequency == pytest.approx(31.0, rel=2e-3)


def test_bad_arguments_of_waves_are_named(comm):
    film = gx.Membrane(whole_disc(comm, 2), gx.Linear(E=1e6, nu=0.3, density=1.0, thickness=1e-3))
    ring = [film.port_at((0.5 * math.cos(θ), 0.5 * math.sin(θ), 0.0)) for θ in (0.0, 2.0, 4.0)]
    frame = gx.ground_frame()
    with pytest.raises(gx.InputError, match="3 points cannot show 2 waves"):
        gx.probes.Waves(ring, frame, number=2)
    with pytest.raises(gx.InputError, match="ports is of the kind list, of length 2"):
        gx.probes.Waves(ring[:2], frame, number=1)
    with pytest.raises(gx.InputError, match="quantity is 'depth'"):
        gx.probes.Waves(ring, frame, number=1, quantity="depth")
    with pytest.raises(
        gx.InputError, match="time is of the kind list, whose number 2 does not fit"
    ):
        gx.analysis.travelling_waves([0.0] * 20, [0.0] * 20, [0.0] * 20)
    with pytest.raises(gx.InputError, match="16 or more values"):
        gx.analysis.travelling_waves([0.0, 1.0], [0.0, 1.0], [0.0, 1.0])
