"""Impacts with exact answers: films on a penalty, oblique impact; cables, beams, edges and corners
that meet."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from demos.studies.contact import on_a_corner, problem
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet
from tests.contact.scenes import (
    FILM,
    assert_conserved,
    contact_set_of,
    count_intersections,
    film,
    simulate,
)

COMM = MPI.COMM_SELF


def _triangle(radius: float) -> gx.Mesh:
    """One cell about the origin."""
    angles = np.pi * np.array([0.5, 7 / 6, 11 / 6])

    def build(model) -> None:
        surface = model.addDiscreteEntity(2)
        corners = radius * np.stack([np.cos(angles), np.sin(angles), 0 * angles], 1)
        model.mesh.addNodes(2, surface, [1, 2, 3], corners.ravel())
        model.mesh.addElementsByType(surface, 2, [], [1, 2, 3])
        model.addPhysicalGroup(2, [surface], name="film")

    return gx.gmsh_mesh(build, COMM)


def down(speed: float):
    return lambda X: np.outer((0.0, 0.0, -speed), np.ones(X.shape[1]))


def test_films_face_to_face_meet_as_bodies_on_a_spring() -> None:
    """Area penalty ε, areal mass m: contact for π √(m/2ε), depth Δv √(m/2ε), velocities
    exchanged."""
    m = 0.01065
    ε = 1e6
    Δv = 1.0
    d = 4e-4
    law = {"E": 1e9, "nu": 0.0, "density": m / 7.5e-6, "thickness": 7.5e-6}
    small = gx.Membrane(
        sheet(COMM, 4, 4, 0.1, 0.1),
        gx.Linear(**law),
        displacement=lambda X: np.outer((-0.05, -0.05, 1.01 * d), np.ones(X.shape[1])),
        velocity=down(Δv),
        name="small",
    )
    # one triangle that reaches beyond the small film, with its centre below that one's, and as
    # heavy as that
    base = gx.Membrane(
        _triangle(0.3),
        # Area of an equilateral triangle in a circle of radius R: ¾ √3 R².
        gx.Linear(**law | {"density": law["density"] * 0.01 / (0.75 * 3**0.5 * 0.3**2)}),
        name="base",
    )
    # a pair of a point and a triangle stands for half of the point's area
    contact = gx.Contact(small, base, distance=d, stiffness=2 * ε, law="penalty")
    seen = gx.Series(
        {
            "force": gx.probes.ContactForce(contact, small, axis="z"),
            "gap": gx.probes.ContactGap(contact),
        }
    )
    dt = 5e-6
    time = math.pi * math.sqrt(m / (2 * ε))
    depth = Δv * math.sqrt(m / (2 * ε))
    run = simulate([contact], 3e-4, dt, outputs=[seen])
    assert_conserved(run, energy=1e-8)
    touching = np.count_nonzero(np.array(seen["force"]) > 1e-6)
    # 5 %: the number of steps in contact is an integer near 60.
    assert touching * dt == pytest.approx(time, rel=0.05)
    assert d - min(seen["gap"]) == pytest.approx(depth, rel=0.05)
    P = run.system.unknowns.numbering.vector()
    run.system.unknowns.M.mult(run.system.unknowns.v0, P)
    owned = run.system.unknowns.state[base].owned
    # Equal masses exchange their velocities; a film that vibrates keeps a few per cent.
    assert P.array_r[owned][2::3].sum() == pytest.approx(run.first.momentum[2], rel=0.03)


def test_oblique_impact_keeps_what_is_along_the_plane() -> None:
    thrown = film(COMM, 2, height=1.5e-3, velocity=(1.5, 0.5, -2.0), name="thrown")
    run = simulate(
        [gx.Contact(thrown, gx.contact.Plane(point=(0, 0, 0), normal=(0, 0, 1)), distance=1e-3)],
        3e-3,
    )
    P = run.totals.momentum
    P0 = run.first.momentum
    error = np.abs(P - P0)[:2].max()
    # A frictionless plane bears no force along itself.
    assert error < 1e-12 * np.abs(P0).max()
    # The film rebounds elastically; up to 1 % stays as vibration.
    assert P[2] == pytest.approx(-P0[2], rel=0.01)
    assert abs(run.energy_error) < 1e-9


def test_films_fall_edge_on_edge() -> None:
    def upright(name: str, turn: float, height: float, speed: float):
        c = math.cos(turn)
        s = math.sin(turn)
        return gx.Membrane(
            sheet(COMM, 3, 3, 0.1, 0.1),
            gx.Miyazaki(**FILM, residual_stiffness=1e-6),
            displacement=lambda X: (
                np.vstack([c * (X[0] - 0.05), s * (X[0] - 0.05), X[1] + height]) - X
            ),
            velocity=down(speed),
            name=name,
        )

    lower = upright("lower", 0.3, -0.1, 0.0)
    upper = upright("upper", -0.4, 2e-3, 2.0)
    run = simulate([gx.Contact(lower, upper, distance=1e-3)], 3e-3)
    assert_conserved(run)
    assert count_intersections(run) == 0
    assert contact_set_of(run).closest < 1e-3
    # It was hit, on a soft edge.
    assert gx.probes.Velocity(lower.port_at((0.05, 0.1, 0.0)), "z")(run) < -1e-3


def test_a_film_falls_over_the_corner_of_a_box() -> None:
    axes = on_a_corner()
    body = gx.RigidBody(0.02, (1e-5, 1e-5, 1e-5), position=(0.0, 0.0, -0.0366), comm=COMM)
    box = gx.contact.Box(centre=(0, 0, -0.0366), sizes=(0.04,) * 3, axes=axes, body=body)
    thrown = film(COMM, 5, velocity=(0.0, 0.0, -2.0), name="thrown")
    run = simulate([gx.Contact(thrown, box, distance=1e-3)], 4e-3)
    assert_conserved(run, momentum=1e-10)
    assert count_intersections(run) == 0
    assert gx.probes.Velocity(body.port(), "z")(run) < -1e-4


def test_a_beam_falls_on_a_cable_and_both_on_a_film() -> None:
    flat = film(COMM, 3, name="flat")
    law = gx.CableLaw(EA=1e4, line_density=0.01)
    rope = gx.Cable(
        line(COMM, [(-0.06, -0.01, 3e-3), (0.06, 0.02, 3e-3)], 3),
        law,
        velocity=down(1.5),
        name="rope",
    )
    rod = gx.Beam(
        line(COMM, [(0.01, -0.06, 6e-3), (-0.02, 0.06, 6e-3)], 3),
        gx.sections.solid_circle(5e-4, E=70e9, nu=0.3, density=2700.0),
        velocity=down(2.0),
        name="rod",
    )
    contact = gx.Contact(flat, rope, rod, distance=5e-4, radius={"rope": 5e-4, "rod": 5e-4})
    run = simulate([contact], 4e-3)
    assert_conserved(run, energy=1e-8, momentum=1e-10)
    assert count_intersections(run) == 0
    assert gx.probes.Velocity(flat.port_at((0.05, 0.05, 0.0)), "z")(run) < -0.05


def test_the_ends_of_a_cylinder_are_round() -> None:
    place = film(COMM, 1, size=0.01, at=(0.035, 0.0), height=0.0, name="film")
    rod = gx.contact.Cylinder(start=(-0.05, 0, 0), end=(0.01, 0, 0), radius=0.0195)
    contact = gx.Contact(place, rod, distance=1e-3)
    run = simulate([contact], 1e-4)
    assert gx.probes.ContactGap(contact)(run) == pytest.approx(5e-4, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["bars", "wall", "block"])
def test_impacts_with_exact_answers(case: str) -> None:
    """Contact time 5 %, velocities and mean stress 3 % (they are told as one number); bodies on a
    spring 1 %."""
    assert problem(COMM, case)["deviation"] < (0.01 if case == "block" else 0.03)
