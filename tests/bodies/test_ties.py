"""Films and cables that are tied along lines: common motion, and conservation of energy and
momenta."""

from __future__ import annotations

import math

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.meshes.tube import flat_tube
from tests.small_scenes import run_until

LAW = gx.Linear(E=1e6, nu=0.3, density=1000.0, thickness=1e-3)


def strip(comm, name, n=2, *, angle=0.0, order=1, stretch=0.0):
    """A strip of 0.2 x 0.1 m that hangs on the y axis, turned about it."""
    c = math.cos(angle)
    s = math.sin(angle)

    def moved(X):
        x = (1 + stretch) * X[0]
        return np.vstack([c * x, X[1], -s * x]) - X

    mesh = sheet(comm, 4, n, 0.2, 0.1)
    return gx.Membrane(mesh, LAW, name=name, order=order, displacement=moved)


def conserved(run, energy=1e-10, momentum=1e-10):
    first = run.first
    now = run.totals
    assert abs(run.energy_error) < energy
    size = np.abs(first.angular_momentum).max() + 0.1 * np.abs(first.momentum).max()
    error = np.abs(now.momentum - first.momentum).max()
    assert error < momentum * 10 * size
    error = np.abs(now.angular_momentum - first.angular_momentum).max()
    assert error < momentum * size


@pytest.mark.mpi
def test_three_films_of_different_meshes_on_a_line(comm) -> None:
    films = [
        strip(comm, f"film {k}", n, angle=2 * math.pi * k / 3, stretch=0.01)
        for k, n in enumerate((2, 3, 4))
    ]
    ties = [gx.Tie(film, films[0], group_a="left", group_b="left") for film in films[1:]]
    run = run_until(5e-3, *films, *ties, gx.RigidMotion(spin=(1.0, 5.0, 2.0)), dt=1e-3)
    conserved(run)
    for corner in ("bottom left", "top left"):
        places = [
            [gx.probes.Position(film.port(corner), axis)(run) for axis in "xyz"] for film in films
        ]
        assert np.allclose(places, places[0], atol=1e-9)


@pytest.mark.mpi
def test_a_cable_along_an_edge_and_a_film_on_a_tube(comm) -> None:
    film = strip(comm, "film")
    cable = gx.Cable(
        line(comm, [(0, 0, 0), (0, 0.1, 0)], 4),
        gx.CableLaw(EA=100.0, line_density=0.1),
        name="cable",
    )
    run = run_until(
        3e-3,
        film,
        cable,
        gx.Tie(cable, film, group_a=None, group_b="left"),
        gx.RigidMotion(spin=(0.0, 0.0, 4.0)),
        dt=1e-3,
    )
    conserved(run)
    end = [gx.probes.Position(cable.port("end"), axis)(run) for axis in "xyz"]
    expected = [gx.probes.Position(film.port("top left"), axis)(run) for axis in "xyz"]
    assert end == pytest.approx(expected, abs=1e-9)

    width = math.pi * 0.03 / 2
    tube = gx.Membrane(flat_tube(comm, 0.1, 0.03, 4), LAW, name="tube")
    sail = gx.Membrane(
        sheet(comm, 4, 4, 0.1, 0.1),
        LAW,
        name="sail",
        displacement=lambda X: np.vstack([0 * X[0], X[1] * 0 + width / 2, 0 * X[0]]),
    )
    gx.Scene(tube, sail, gx.Tie(sail, tube, group_a="bottom", group_b="left")).compile()


@pytest.mark.mpi(1)
@pytest.mark.parametrize(
    "act, words",
    [
        (
            lambda a, b: gx.Tie(a, a, group_a="left", group_b="left"),
            "a and b, group_a and group_b are the same",
        ),
        (lambda a, b: gx.Tie(a, b, group_a=None, group_b="left"), "name a curve of its mesh"),
        (lambda a, b: gx.Tie(a, b, group_a="left", group_b="film"), "has dimension 2; name curves"),
        (
            lambda a, b: gx.Tie(gx.PointMass(1.0), group_a="left", b=b, group_b="left"),
            "a is|no film or cable",
        ),
        (
            lambda a, b: gx.Scene(gx.Tie(a, b, group_a="right", group_b="left")).compile(),
            "up to 0.2 m away",
        ),
    ],
)
def test_what_cannot_be_tied_is_refused(comm, act, words: str) -> None:
    with pytest.raises(gx.InputError, match=words):
        act(strip(comm, "a"), strip(comm, "b"))


@pytest.mark.mpi
def test_film_and_hem_at_rest_stay_at_rest(comm) -> None:
    """The nodes of meshes miss each other by 1e-12 of their length: all that moves is round-off, at
    strains where film begins to wrinkle."""
    width = 2.3066628965815066
    height = 1.6130161135458592
    law = gx.Miyazaki(E=3e9, nu=0.34, density=1400.0, thickness=25e-6)
    lower = gx.Membrane(sheet(comm, 8, 8, width, height), law, name="lower")

    def above(X):
        return np.outer((0.0, height, 0.0), np.ones(X.shape[1]))

    upper = gx.Membrane(sheet(comm, 4, 4, width, height), law, displacement=above, name="upper")
    ends = [(0.0, height, 0.0), (width, height, 0.0)]
    hem = gx.Cable(line(comm, ends, 12), gx.CableLaw(1e4, 0.01), name="hem")
    ties = [
        gx.Tie(lower, upper, group_a="top", group_b="bottom"),
        gx.Tie(hem, upper, group_b="bottom"),
    ]
    run = run_until(2e-4, lower, upper, hem, *ties, dt=1e-5)
    assert run.substeps == 0
    assert run.totals.kinetic < 1e-17
