"""Ends of beams and cables with prescribed direction, twist or motion."""

from __future__ import annotations

import math

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.meshes.line import line
from tests.small_scenes import run_until

TUBE = gx.sections.tube(0.002, 5e-5, E=1e11, nu=0.3, density=1560.0)
L = 1.0


def beam_along_x(comm, cells=8, **options):
    return gx.Beam(line(comm, [(0, 0, 0), (L, 0, 0)], cells), TUBE, **options)


@pytest.mark.parametrize("by", ["vector", "function"])
def test_moments_of_a_beam_whose_end_is_turned(comm, by):
    """4 EI θ/L at the end that is turned, 2 EI θ/L at the other, forces 6 EI θ/L²."""
    # Small, so that the linear beam theory holds to θ².
    θ = 1e-4
    beam = beam_along_x(comm)
    if by == "vector":
        turned = gx.Fixed(
            beam,
            "end",
            rotation=True,
            direction=(3 * math.cos(θ), 3 * math.sin(θ), 0.0),
        )
    else:
        turned = gx.Fixed(
            beam,
            "end",
            rotation=True,
            direction=lambda X, t: np.vstack([1 + 0 * X[0], math.tan(θ) * t + 0 * X[0], 0 * X[0]]),
        )
    still = gx.Fixed(beam, "start", rotation=True)
    equilibrium = gx.Equilibrium(gx.Scene(still, turned))
    equilibrium.find(at=1.0)
    moments = [equilibrium.reaction(still)[1], equilibrium.reaction(turned, (L, 0.0, 0.0))[1]]
    # 2 EI θ/L at the end that is held.
    exact = 2 * TUBE.EI2 * θ / L
    assert moments[0] == pytest.approx([0, 0, exact], rel=1e-3, abs=1e-6 * exact)
    assert moments[1] == pytest.approx([0, 0, 2 * exact], rel=1e-3, abs=1e-6 * exact)
    # Eight elements of the beam: 0.1 %.
    assert equilibrium.reaction(still)[0][1] == pytest.approx(3 * exact / L, rel=1e-3)


def test_torque_of_a_twisted_beam(comm):
    """GJ φ/L, also of a large angle."""
    beam = beam_along_x(comm)
    # More than a right angle, so that a linear twist would show.
    φ = 2.0
    still = gx.Fixed(beam, "start", rotation=True)
    twisted = gx.Fixed(beam, "end", rotation=True, twist=lambda t: φ * t)
    slides = gx.Equilibrium(gx.Scene(still, twisted))
    # In four increments of half a radian.
    for t in (0.25, 0.5, 0.75, 1.0):
        slides.find(at=t)
    assert slides.reaction(twisted, (L, 0.0, 0.0))[1][0] == pytest.approx(TUBE.GJ * φ / L, rel=2e-3)


@pytest.mark.mpi
def test_a_root_that_turns_and_moves_books_its_work(comm):
    """A boom whose root turns about z and moves along y as the boom does at the start: the ledger
    closes."""
    ω = 2.0
    u = 0.5
    beam = beam_along_x(comm, 4, velocity=lambda X: np.vstack([-ω * X[1], ω * X[0] + u, 0 * X[0]]))

    def turning(X, t):
        return np.vstack(
            [np.cos(ω * t + t**2) + 0 * X[0], np.sin(ω * t + t**2) + 0 * X[0], 0 * X[0]]
        )

    root = gx.Fixed(
        beam,
        "start",
        rotation=True,
        direction=turning,
        motion=lambda X, t: np.vstack([0 * X[0], u * t + 0 * X[0], 0 * X[0]]),
    )
    run = run_until(0.1, root, dt=1e-3)
    # Energy of the driven motion, over a hundred steps.
    assert abs(run.energy_error) < 1e-9
    assert run.totals.supplied > 0
    # α̇ = 2: the work of the torque I α̇ and of the centripetal force at the root, which moves
    directions = gx.probes.AngularVelocity(beam.frame("start"), "z")(run)
    # 2 %: the beam lags behind its root.
    assert directions == pytest.approx(ω + 2 * 0.1, rel=2e-2)


@pytest.mark.parametrize("kind", ["beam", "cable"])
def test_lines_slide_in_planes_of_any_direction(comm, kind):
    """A line that hangs between a pin and a slope of 45°: the slope pushes along its normal
    alone."""
    n = np.array([-1.0, 0.0, 1.0]) / math.sqrt(2)
    if kind == "beam":
        body = beam_along_x(comm)
        weight = TUBE.line_density * L
    else:
        body = gx.Cable(line(comm, [(0, 0, 0), (L, 0, 0)], 8), gx.CableLaw(1e3, 0.1))
        weight = 0.1 * L
    ends = (
        gx.Fixed(body, "start"),
        gx.Fixed(body, "end", normal=tuple(n)),
        gx.Fixed(body, "end", components=(1,)),
    )
    spin = [gx.Fixed(body, "start", rotation=True)] if kind == "beam" else []
    scene = gx.Scene(*(spin or ends[:1]), *ends[1:], gx.Gravity(body, (0.0, 0.0, -1.0)))
    equilibrium = gx.Equilibrium(scene)
    equilibrium.find()
    pin = equilibrium.reaction((spin or ends)[0])[0]
    slope = equilibrium.reaction(ends[1])[0]
    # Equilibrium gives the whole weight to both supports.
    assert pin + slope == pytest.approx([0, 0, weight], abs=1e-6 * weight)
    # A frictionless slope bears along its normal only.
    assert np.cross(slope, n) == pytest.approx([0, 0, 0], abs=1e-9 * weight)
    x = np.array([gx.probes.Displacement(body.port("end"), axis)(equilibrium) for axis in "xyz"])
    # The end lies in the plane of the slope.
    assert x @ n == pytest.approx(0, abs=1e-12) and np.linalg.norm(x) > 0


def test_a_cable_is_moved_as_films_are(comm):
    """Pulled by 1 %: N = EA λ ε."""
    cable = gx.Cable(line(comm, [(0, 0, 0), (L, 0, 0)], 4), gx.CableLaw(1e3, 0.1))
    pulled = gx.Fixed(
        cable,
        "end",
        motion=lambda X, t: np.vstack([0.01 * t + 0 * X[0], 0 * X[0], 0 * X[0]]),
    )
    held = gx.Fixed(cable, "start")
    equilibrium = gx.Equilibrium(gx.Scene(held, pulled))
    equilibrium.find(at=1.0)
    measured = equilibrium.reaction(pulled)[0][0]
    # Saint Venant-Kirchhoff: N = EA λ (λ² - 1)/2.
    assert measured == pytest.approx(1e3 * 1.01 * (1.01**2 - 1) / 2, rel=1e-8)


def test_what_cannot_be_clamped_is_refused(comm):
    beam = beam_along_x(comm)
    cable = gx.Cable(line(comm, [(0, 0, 0), (L, 0, 0)], 2), gx.CableLaw(1e3, 0.1))

    def compiled(**options):
        return gx.Simulation(
            gx.Scene(gx.Fixed(beam, "start", rotation=True, **options)),
            gx.Midpoint(dt=1e-3),
        )

    for act, words in (
        (lambda: gx.Fixed(cable, "start", direction=(0.0, 0.0, 1.0)), "no stiffness in bending"),
        (lambda: gx.Fixed(beam, "start", rotation=True, direction=(0.0, 0.0, 0.0)), "not all zero"),
        (lambda: gx.Fixed(beam, "start", rotation=True, twist=math.nan), "twist is nan"),
        (lambda: compiled(direction=(-1.0, 0.0, 0.0)), "opposite"),
        (lambda: compiled(direction=lambda X, t: 0 * X), "is zero"),
        (lambda: compiled(direction=lambda X, t: X[:2]), "Direction of"),
        (lambda: compiled(twist=lambda t: "much"), "Twist of"),
    ):
        with pytest.raises(gx.InputError, match=words):
            act()
