"""Sunlight of a given direction in equilibria: resultants in closed form, groups, directions in
time, bad input."""

from __future__ import annotations

import math

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import sheet

pytestmark = pytest.mark.mpi

# Side of the sail [m], pressure of light [Pa].
SIDE = 2.0
PRESSURE = 4.56e-6
# So stiff that the film stays flat to 1e-9 of its side.
LAW = gx.Linear(E=1e9, nu=0.3, density=1000.0, thickness=1e-3)


def resultant(comm, at: float = 0.0, **given) -> np.ndarray:
    """Force (3,) [N] of light on a flat square, from the reactions of its edges."""
    film = gx.Membrane(sheet(comm, 2, 2, SIDE, SIDE), LAW, name="sail")
    light = gx.orbit.Sunlight(film, pressure=PRESSURE, **given)
    # All nodes but the middle one are on the edges, which one support holds.
    film.mesh.groups["rim"] = (
        1,
        np.concatenate([film.mesh.groups[edge][1] for edge in ("bottom", "right", "top", "left")]),
    )
    rim = gx.Fixed(film, "rim")
    search = gx.Equilibrium(gx.Scene(film, light, rim))
    search.find(at=at)
    force, _ = search.reaction(rim)
    return -force


@pytest.mark.parametrize("angle", [0.0, 0.6])
def test_light_on_a_mirror_pushes_along_its_normal(comm, angle):
    """F = 2 P A cos² α against the normal of the lit side (C. McInnes, Solar Sailing, 1999)."""
    u = (math.sin(angle), 0.0, -math.cos(angle))
    force = resultant(comm, direction=u)
    expected = 2 * PRESSURE * SIDE**2 * math.cos(angle) ** 2
    # The film stretches by the light, below 1e-5.
    assert force == pytest.approx([0.0, 0.0, -expected], rel=1e-5, abs=1e-9)


def test_the_direction_follows_the_argument_of_the_equilibrium_and_its_length_does_not_count(comm):
    def direction(t: float) -> tuple[float, float, float]:
        return (7 * math.sin(t), 0.0, -7 * math.cos(t))

    turned = resultant(comm, at=0.6, direction=direction)
    fixed = resultant(comm, direction=direction(0.6))
    assert turned == pytest.approx(fixed, rel=1e-9, abs=1e-14)


def test_a_group_may_have_its_own_optics(comm):
    """A film that absorbs is pushed along the light, with half of the force of a mirror."""
    black = gx.orbit.Optics(0.0, 0.0)
    force = resultant(comm, direction=(0.0, 0.0, -1.0), groups={"film": black})
    # All of the light's momentum, without reflection.
    assert force[2] == pytest.approx(-PRESSURE * SIDE**2, rel=1e-5)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"direction": (0.0, 0.0, 0.0)}, "three finite numbers that are not all zero"),
        ({"direction": lambda t: (0.0, 1.0)}, "direction at t = 0 s"),
        ({"direction": (0.0, 0.0, 1.0), "groups": {"left": gx.orbit.Optics()}}, "dimension 1"),
    ],
)
def test_bad_arguments_are_named(comm, given, message):
    with pytest.raises(gx.InputError, match=message):
        film = gx.Membrane(sheet(comm, 2, 2), LAW)
        light = gx.orbit.Sunlight(film, **given)
        gx.Equilibrium(gx.Scene(film, light, gx.Fixed(film, "left")))


def test_light_of_an_orbit_is_not_for_equilibria_and_the_other_one_is_named(comm):
    film = gx.Membrane(sheet(comm, 2, 2), LAW)
    orbit = gx.orbit.Orbit(gx.orbit.Elements(7e6, 0.0), sun=(0.0, 0.0, 1.0))
    with pytest.raises(
        gx.InputError, match=r"give an equilibrium its light by gx\.orbit\.Sunlight"
    ):
        gx.Equilibrium(gx.Scene(film, gx.orbit.SolarPressure(film, orbit)))
