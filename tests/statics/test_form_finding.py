"""Shapes of films of prescribed tension."""

from __future__ import annotations

import numpy as np
import pytest

import gossamer_fx as gx
from demos.films import four_corner_film
from gossamer_fx.analysis import Prestress, find_form
from gossamer_fx.meshes.sheet import CORNERS, EDGES, sheet

TENSION = Prestress(E=1e9, nu=0.3, density=1000.0, thickness=1e-5, tension=10.0)


def soap_film(comm, height, metres=1.0):
    """A quarter of a cylinder between two rings; lengths in units of so many metres."""
    mesh = sheet(comm, 12, 12, np.pi / 2, height)
    X = mesh.domain.geometry.x
    X[:] = metres * np.column_stack([np.cos(X[:, 0]), np.sin(X[:, 0]), X[:, 1]])
    film = gx.Membrane(mesh, TENSION)
    rings = ("top", "bottom")

    def scene():
        held = [gx.Fixed(film, ring) for ring in rings]
        return gx.Scene(
            film,
            *held,
            gx.Fixed(film, "left", components=(1,)),
            gx.Fixed(film, "right", components=(0,)),
        )

    return film, scene


@pytest.mark.mpi
@pytest.mark.parametrize("metres", [1.0, 1e-6, 1e3])
def test_soap_film_between_two_rings_is_a_catenoid(comm, metres):
    """r = c cosh((z - h/2)/c) with c cosh(h/(2c)) = 1: c = 0.848338 m for h = 1 m.

    One of a micrometre ended at its first guess, a cylinder; one of a metre not at all."""
    film, scene = soap_film(comm, 1.0, metres)
    find_form(film, scene, updates=10)
    x, y, z = film.space.mesh.geometry.x.T / metres
    # Waist of the catenoid [m], the root of c cosh(h/2c) = 1.
    c = 0.848338
    # 5 mm of 1 m: chords of the mesh between the rings.
    assert np.hypot(x, y) == pytest.approx(c * np.cosh((z - 0.5) / c), abs=5e-3)


def test_rings_too_far_apart_hold_no_film(comm):
    """Beyond h = 1.3255 m no catenoid exists."""
    film, scene = soap_film(comm, 1.6)
    with pytest.raises(gx.NoEquilibrium, match="pinch"):
        find_form(film, scene, updates=10)


def test_only_a_film_of_given_tension_has_a_form_to_find(comm):
    film = gx.Membrane(sheet(comm, 2, 2), gx.Linear(1e9, 0.3, density=1e3, thickness=1e-4))
    with pytest.raises(gx.InputError, match="Prestress"):
        find_form(film, lambda: gx.Scene(film))


@pytest.mark.mpi(1)
@pytest.mark.parametrize("force", [10.0, 20.0])
def test_edge_cables_of_a_film_between_four_corners_are_arcs(comm, force):
    """Radius force/tension, as T κ = n0 of a cable that a film pulls at right angles."""
    film = gx.Membrane(sheet(comm, 12, 12), TENSION)

    def scene():
        corners = [gx.Fixed(film, corner) for corner in CORNERS]
        return gx.Scene(
            film, *corners, *(gx.analysis.EdgeCable(film, edge, force=force) for edge in EDGES)
        )

    find_form(film, scene)
    R = force / TENSION.tension
    # Centre of an arc of radius R through both corners.
    centre = np.array([0.5, -((R**2 - 0.25) ** 0.5)])
    x = film.space.mesh.geometry.x[film.nodes("bottom")]
    # 2 mm for an edge of 12 cells.
    assert np.hypot(*(x[:, :2] - centre).T) == pytest.approx(R, abs=2e-3)
    assert x[:, 2] == pytest.approx(0.0, abs=1e-9)


def test_saddle_of_the_demo_has_cables_of_their_force(comm):
    """Its cables are nearly plane arcs; what bends them out of the film's tangent plane is
    small."""
    result = four_corner_film.main(comm=comm)
    # 3 %: cables bend out of the tangent plane.
    assert result["radius of a cable [m]"] == pytest.approx(result["force/tension [m]"], rel=0.03)
    assert result["residual"] < 1e-8
