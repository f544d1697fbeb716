"""Boundaries whose distance is a law: one that is known in C, and the tutorial's torus."""

from __future__ import annotations

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.extend import LawBoundary, ObstacleBoundary
from gossamer_fx.mechanics.contact.pairs import STENCILS, PairTable, closest_points
from gossamer_fx.meshes.sheet import sheet
from tests import own_part

LAW = gx.Linear(E=1e6, nu=0.3, density=1000.0, thickness=1e-4)


class InTube(LawBoundary):
    """The room in a cylinder, whose axis is the first direction."""

    @staticmethod
    def law(rr, ra, rb, aa, ab, bb, shape):
        return shape - np.sqrt(rr - ra * ra / aa)


class OfAllProducts(LawBoundary):
    """A distance that depends on all products of the vector from the origin and both directions."""

    @staticmethod
    def law(rr, ra, rb, aa, ab, bb, shape):
        return shape * np.sqrt(rr + aa + bb) + ra * rb + 0.3 * ab * ra - 0.2 * ab * bb * rb


class Tube(gx.contact.Cylinder):
    """The room of `Cylinder(inside=True)` by its law."""

    def parts(self):
        axis = self.fixed_direction(np.subtract(self.end, self.start))
        origin = self.fixed_point(self.start)
        return [ObstacleBoundary(InTube, (origin, axis, origin), self.radius)], []


def thrown(comm, obstacle, *, v=(0.0, 0.0, -2.0), spin=0.0):
    """A square film that flies at an obstacle."""
    film = gx.Membrane(
        sheet(comm, 4, 4, width=0.2, height=0.2),
        LAW,
        displacement=lambda X: X * 0 - np.array([[0.1], [0.1], [0.0]]),
        velocity=lambda X: np.outer(v, np.ones(X.shape[1])) + spin * X[[1, 0, 2]],
        name="film",
    )
    contact = gx.Contact(film, obstacle, distance=5e-3, stiffness=1e5)
    scene = gx.Scene(film, contact, gx.Damping(film, stiffness_factor=1e-4))
    return film, gx.Simulation(scene, gx.Midpoint(dt=1e-3))


@pytest.mark.mpi
def test_a_law_is_the_room_that_is_known_in_c(comm):
    ends = {"start": (0.0, -1.0, 0.02), "end": (0.0, 1.0, 0.02), "radius": 0.12}
    found = []
    for obstacle in (gx.contact.Cylinder(**ends, inside=True), Tube(**ends)):
        film, run = thrown(comm, obstacle)
        run.run(until=0.05)
        assert abs(run.energy_error) < 1e-11
        found.append(gx.fields.positions(run, film))
    # The room in C has an energy in the square of the distance: the same to a part of the range.
    assert comm.allreduce(abs(found[0] - found[1]).max(), max) < 2e-3


@pytest.mark.parametrize("kind", [InTube, OfAllProducts])
def test_its_derivatives_are_those_of_its_distance(kind):
    """In C and by complex steps, at points and directions of any length."""
    from mpi4py import MPI

    kind.prepare(MPI.COMM_SELF)
    rng = np.random.default_rng(3)
    x = rng.normal(size=(4, 3))
    pairs = PairTable(
        np.array([kind.number], np.uint8),
        np.array([[0, 1, 2, 3]], np.int32),
        shape=np.array([0.7]),
    )
    s, _ = closest_points(pairs, x)
    stencil = STENCILS[kind.number]
    parameters = np.zeros((1, 2))
    value, gradient = stencil.derivatives(x[None], parameters, pairs.shapes)
    assert value[0] == pytest.approx(s[0], rel=1e-14)
    for point in range(4):
        for axis in range(3):
            moved = x[None].astype(complex)
            moved[0, point, axis] += 1e-30j
            ahead, gradient_ahead = stencil.derivatives(moved, parameters, pairs.shapes)
            assert ahead[0].imag / 1e-30 == pytest.approx(
                gradient[0, point, axis], rel=1e-12, abs=1e-14
            )
            # Second derivatives, which the gradients of friction need.
            h = 1e-6
            ends = []
            for sign in (-1, 1):
                varied = x[None].copy()
                varied[0, point, axis] += sign * h
                ends.append(stencil.derivatives(varied, parameters, pairs.shapes)[1])
            difference = (ends[1] - ends[0]) / (2 * h)
            assert np.allclose(gradient_ahead.imag / 1e-30, difference, atol=1e-8)


@pytest.fixture(scope="module")
def torus():
    """The tutorial's obstacle."""
    return own_part.module_of("An obstacle of your own").Torus


@pytest.mark.mpi
def test_a_film_comes_to_rest_on_a_torus(comm, torus, tmp_path):
    ring = torus(centre=(0.0, 0.0, -0.04), axis=(0.0, 0.0, 1.0), radii=(0.06, 0.02))
    film, run = thrown(comm, ring, spin=3.0)
    run.run(until=0.04)
    assert abs(run.energy_error) < 1e-11 and run.totals.losses
    # No node is in the tube of the torus.
    X = gx.fields.positions(run, film)
    across = np.hypot(X[:, 0], X[:, 1]) - 0.06
    distance = np.hypot(across, X[:, 2] + 0.04) - 0.02
    assert comm.allreduce(distance.min(initial=1.0), min) > 0
    # It touched: the film no longer falls at 2 m/s.
    momentum = run.totals.momentum[2] / (1000.0 * 1e-4 * 0.04)
    assert momentum > -1.0


def test_a_gradient_goes_through_it(torus):
    from mpi4py import MPI

    def height(v: float):
        ring = torus(centre=(0.0, 0.0, -0.04), axis=(0.0, 0.0, 1.0), radii=(0.06, 0.02))
        film, run = thrown(MPI.COMM_SELF, ring, v=(0.0, 0.0, v))
        tape = gx.analysis.RunTape(run)
        run.run(until=0.015)
        result = gx.probes.Position(film.port_at((0.1, 0.1, 0.0)), "z")
        return result(run), tape, result

    _, tape, result = height(-2.0)
    found = gx.analysis.gradient(tape, of=result, by=["film.initial_velocity"])
    by_v = float(found["film.initial_velocity"].values.reshape(-1, 3)[:, 2].sum())
    h = 1e-4
    ends = [height(-2.0 + sign * h)[0] for sign in (-1, 1)]
    assert by_v == pytest.approx((ends[1] - ends[0]) / (2 * h), rel=1e-5)
