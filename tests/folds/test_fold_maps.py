"""Fold maps: isometric on lines of the mesh, layers separated for contact, and used by all that
reads positions."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.creased import creased_film, creased_tube
from gossamer_fx.meshes.sails import parallelograms, pinwheel, trapezoids
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.meshes.tube import flat_tube

# The material matters only for the strain energy of the start.
LAW = gx.Miyazaki(E=2.5e9, nu=0.34, density=1420.0, thickness=25e-6, residual_stiffness=1e-6)
WIDTH = math.pi * 0.03 / 2  # of a tube of 30 mm that is pressed flat


@dataclass(frozen=True)
class Sample:
    """A map, a mesh for it, its fold angles [deg] by group, and what opening its layers may cost
    [J]."""

    folds: Any
    mesh: Callable[[MPI.Intracomm], gx.Mesh]
    angles: dict[str, float]
    energy: float


# Fold angles of 1.4 rad and 2.8 rad between panels: nearly shut, but without layers that touch.
ZIGZAG = gx.fold.Zigzag(length=0.3, panels=3, angle=1.4)
TUBE = gx.fold.Zigzag(length=0.25, panels=3, angle=1.4, width=WIDTH, opening=5e-4, lift=1e-4)
ROUND = gx.fold.Zigzag(length=0.25, panels=2, angle=1.2, bends=3, spacing=0.25 / 32)
ROLL = gx.fold.Roll(length=0.25, bends=31, radius=0.02, pitch=3e-3, width=WIDTH, opening=1e-4)
MIURA = gx.fold.Miura(a=0.05, b=0.05, gamma=1.0, theta=0.8)
# The other Miura pattern is open; this one is stowed, and layers are separated for contact.
STOWED = gx.fold.Miura(a=0.1, b=0.1, gamma=1.4, theta=1.4, opening=3e-4, lift=5e-5)
CROSS = gx.fold.Ikaros(n=4, inner=3, outer=8, pitch=0.32, bends=1, gap=1e-3, hub_gap=1e-3)
HEXAGON = gx.fold.Ikaros(
    n=6,
    inner=3,
    outer=6,
    pitch=0.1,
    bends=2,
    gap=1e-3,
    hub_gap=5e-4,
    ramp=0.1,
)
STAR = gx.fold.Star(n=8, side=0.04, columns=2, reach=12, gap=1e-4)
# angle between the panels of Miura's fold at its straight and at its oblique lines
_STRAIGHT = 2 * math.asin(
    math.sin(0.8) * math.cos(1.0) / math.sqrt(1 - (math.sin(0.8) * math.sin(1.0)) ** 2)
)


def begun_at(comm: MPI.Intracomm, x: float, y: float) -> gx.Mesh:
    """A sheet of 0.3 by 0.1 m that begins at (x, y)."""
    mesh = sheet(comm, 9, 2, 0.3, 0.1)
    mesh.domain.geometry.x[:] += (x, y, 0.0)
    return mesh


def placed(comm: MPI.Intracomm, folds: Any, film: gx.Membrane) -> gx.Simulation:
    """A run in which a film starts folded, without creases."""
    return gx.Simulation(gx.Scene(film, folds.start(film)), gx.Midpoint(dt=1e-5))


def oblique_tube(comm: MPI.Intracomm) -> gx.Mesh:
    """A flat tube that Miura's lines cross at any angle, in two compartments."""
    corners = ((0.02, 0.03), (0.07, 0.03), (0.17, 0.27), (0.12, 0.27))
    lines = [*STOWED.segments((0.0, 0.0), (0.3, 0.3)), ((0.045, 0.03), (0.145, 0.27))]
    return creased_tube(comm, corners, lines, 0.03, lambda X: STOWED.lattice(X)[1], (1.0,))


# Fold map, mesh, expected fold angles [rad] by group, and a bound of the strain energy [J].
SAMPLES = {
    "zigzag": Sample(
        ZIGZAG, lambda c: sheet(c, 9, 2, 0.3, 0.1), {"fold 1": -2.8, "fold 2": 2.8}, 1e-18
    ),
    "tube": Sample(
        TUBE,
        lambda c: flat_tube(c, 0.25, 0.03, 6, 3),
        {"fold 1 top": -2.8, "fold 1 bottom": 2.8, "fold 2 top": 2.8, "fold 2 bottom": -2.8},
        5e-3,
    ),
    "fold with a radius": Sample(
        ROUND, lambda c: sheet(c, 32, 2, 0.25, 0.05), {"fold 1": -0.8}, 1e-18
    ),
    "roll": Sample(ROLL, lambda c: flat_tube(c, 0.25, 0.03, 6), {}, 5e-3),
    "miura": Sample(
        MIURA,
        lambda c: parallelograms(c, 0.05, 0.05, 1.0, 4, 3, 2),
        {"valley 1": 1.6, "valley 2": _STRAIGHT, "mountain 1": -1.6, "mountain 2": -_STRAIGHT},
        1e-18,
    ),
    "tube in Miura's fold": Sample(
        STOWED, oblique_tube, {"mountain top 1": -2.8, "valley bottom 1": 2.8}, 5e-3
    ),
    "cross": Sample(
        CROSS,
        lambda c: trapezoids(c, 4, 3, 8, 0.32),
        {
            "valley 1": math.pi,
            "mountain 1": -math.pi,
            "valley 2": 3 * math.pi / 8,
            "mountain 2": -3 * math.pi / 8,
        },
        5e-3,
    ),
    "hexagon": Sample(
        HEXAGON,
        lambda c: trapezoids(c, 6, 3, 6, 0.1),
        {"valley 1": math.pi, "mountain 1": -math.pi},
        5e-3,
    ),
    "star": Sample(
        STAR,
        lambda c: pinwheel(c, 8, 0.04, 2, 12),
        {
            "valley 1": math.pi,
            "mountain 1": -math.pi,
            "valley 2": math.pi / 8,
            "mountain 2": -math.pi / 8,
        },
        1e-3,
    ),
}


@pytest.mark.mpi(1)
@pytest.mark.parametrize("name", SAMPLES)
def test_no_strain_where_layers_lie_on_each_other_and_little_where_they_are_apart(
    comm, name: str
) -> None:
    sample = SAMPLES[name]
    film = gx.Membrane(sample.mesh(comm), LAW)
    # A pressed fold is an isometry: round-off of squares of strains.
    assert sample.folds.pressed().start(film).strain_energy() < 1e-15
    assert sample.folds.start(film).strain_energy() < sample.energy


@pytest.mark.mpi(1)
@pytest.mark.parametrize("name", SAMPLES)
def test_fold_lines_and_their_angles(comm, name: str) -> None:
    sample = SAMPLES[name]
    mesh = sample.folds.mark(sample.mesh(comm))
    found = {line.name: line.angle for line in sample.folds.lines(mesh)}
    measured = {group: found[group] for group in sample.angles}
    # Angles of separated layers differ from the ideal ones by the opening over the panel.
    assert measured == pytest.approx(sample.angles, abs=2e-5)
    assert set(found) <= set(mesh.groups)


@pytest.mark.mpi(1)
@pytest.mark.parametrize(
    "name", [name for name in SAMPLES if name not in ("zigzag", "miura", "fold with a radius")]
)
def test_layers_are_apart(comm, name: str) -> None:
    """Contact accepts the start, nothing intersects, and unconnected layers of film do not
    touch."""
    sample = SAMPLES[name]
    film = gx.Membrane(sample.mesh(comm), LAW)
    contact = gx.Contact(film, distance=2e-4)
    run = gx.Simulation(gx.Scene(film, sample.folds.start(film), contact), gx.Midpoint(dt=1e-5))
    # No intersection at all, and a gap between all unconnected layers.
    assert gx.probes.Penetrations(contact)(run) == 0
    assert gx.probes.ContactGap(contact)(run) > 1e-6


@pytest.mark.mpi(1)
@pytest.mark.parametrize("name", ["tube", "miura", "cross", "star"])
def test_creases_start_at_rest_on_their_branch(comm, name: str) -> None:
    sample = SAMPLES[name]
    film = gx.Membrane(sample.folds.mark(sample.mesh(comm)), LAW)
    creases = sample.folds.pressed().creases(film, stiffness=1e-3)
    system = gx.Scene(film, sample.folds.pressed().start(film), *creases).compile()
    for crease in creases:
        for which in ("least", "largest"):
            measured = gx.probes.FoldAngle(crease, which).of(system)
            # Fold angles come from positions with gaps of 1e-4 of a panel.
            assert measured == pytest.approx(crease.rest_angle, abs=1e-4)
    half = sample.folds.creases(film, stiffness=1e-3, set_angle_ratio=0.5)
    # A set angle ratio of one half halves all rest angles.
    assert [c.rest_angle for c in half] == pytest.approx([c.rest_angle / 2 for c in creases])


@pytest.mark.mpi
def test_a_folded_plate_with_creases_stays_as_it_is(comm) -> None:
    mesh = ZIGZAG.mark(sheet(comm, 9, 2, 0.3, 0.1))
    plate = gx.Plate(
        mesh, gx.Linear(E=3e9, nu=0.3, density=1400.0, thickness=1e-4), hinges=["fold 1", "fold 2"]
    )
    items = (plate, ZIGZAG.start(plate), *ZIGZAG.creases(plate, stiffness=1e-2))
    run = gx.Simulation(gx.Scene(*items), gx.Midpoint(dt=1e-3))
    before = gx.fields.positions(run, plate)
    run.run(until=3e-3)
    # In equilibrium: it moves only by the tolerance of three steps.
    error = np.abs(gx.fields.positions(run, plate) - before).max(initial=0.0)
    assert error < 1e-9
    # An edge is clamped as it is folded: at 1.4 rad to the mesh.
    clamped = gx.Scene(*items, gx.Fixed(plate, "left", rotation=True)).compile()
    assert abs(clamped.balance.totals().stored["plate bending"]) < 1e-15


@pytest.mark.mpi
def test_joints_and_probes_see_the_folded_film(comm) -> None:
    mesh = sheet(comm, 9, 2, 0.3, 0.1)
    film = gx.Membrane(mesh, LAW)
    port = film.port("top right")
    place = ZIGZAG.place(np.array([[0.3, 0.1, 0.0]]), np.zeros(1))[0] + [0.0, 0.0, 0.5]
    start = ZIGZAG.start(film, origin=(0.0, 0.0, 0.5))
    run = gx.Simulation(
        gx.Scene(film, start, gx.constraints.BallJoint(port, gx.Ground(tuple(place)))),
        gx.Midpoint(dt=1e-4),
    )
    measured = [gx.probes.Position(port, axis)(run) for axis in "xyz"]
    # A joint at the folded position does not move the film.
    assert measured == pytest.approx(place, abs=1e-12)


def test_a_turned_start(comm) -> None:
    film = gx.Membrane(sheet(comm, 9, 2, 0.3, 0.1), LAW)
    straight = ZIGZAG.start(film).positions()
    turned = ZIGZAG.start(film, turn=(0.0, 0.0, math.pi / 2)).positions()
    assert np.allclose(
        turned, np.column_stack([-straight[:, 1], straight[:, 0], straight[:, 2]]), atol=1e-12
    )


def test_sizes_of_miuras_fold() -> None:
    """Sides and angle of a parallelogram are constant."""
    H, S, L, V = MIURA.sizes
    a = np.array([0.0, L, H])
    b = np.array([S, V, 0.0])
    # Both sides of the parallelogram are 0.05 m, with the angle of 1 rad between them.
    assert [np.linalg.norm(a), np.linalg.norm(b)] == pytest.approx([0.05, 0.05], rel=1e-12)
    assert a @ b / 0.05**2 == pytest.approx(math.cos(1.0), rel=1e-12)


def test_a_polygon_along_miuras_lines(comm) -> None:
    """One parallelogram stays where it is under the inverse of its axes."""
    corners = ((0.01, 0.03), (0.09, 0.03), (0.2, 0.25), (-0.1, 0.25))
    lines = STOWED.segments((-0.1, 0.0), (0.2, 0.3))
    film = gx.Membrane(creased_film(comm, corners, lines, (0.03, 0.03, 0.06, 0.06)), LAW)
    assert STOWED.start(film).strain_energy() < 1e-15
    X = film.space.tabulate_dof_coordinates()[: film.block.index_map.size_local]
    u, v = STOWED.lattice(X)
    first = (u >= 0) & (u <= 1) & (v >= 0) & (v <= 1)
    assert np.allclose((STOWED.start(film).positions() @ STOWED.axes)[first], X[first], atol=1e-12)
    assert np.allclose(STOWED.axes.T @ STOWED.axes, np.eye(3), atol=1e-12)
    # Enough nodes in the first parallelogram to define its axes.
    assert comm.allreduce(int(first.sum())) > 4


@pytest.mark.mpi(2)
@pytest.mark.parametrize(
    "act, words",
    [
        (
            lambda c: ZIGZAG.mark(sheet(c, 10, 2, 0.3, 0.1)),
            "8 triangles lie on both sides of a fold line",
        ),
        (lambda c: ROLL.mark(flat_tube(c, 0.25, 0.03, 4)), "lie on both sides of a fold line"),
        (lambda c: STAR.mark(sheet(c, 2, 2)), "as within its hub"),
        (
            lambda c: ZIGZAG.creases(gx.Membrane(sheet(c, 9, 2, 0.3, 0.1), LAW), stiffness=1.0),
            "has no group 'fold 1'",
        ),
        (
            lambda c: ZIGZAG.creases(
                gx.Membrane(ZIGZAG.mark(sheet(c, 9, 2, 0.3, 0.1)), LAW),
                stiffness=1.0,
                set_angle_ratio=2.0,
            ),
            "between 0 and 1",
        ),
        (
            lambda c: ZIGZAG.start(gx.Membrane(sheet(c, 2, 2), LAW), origin=(0.0, math.nan, 0.0)),
            "three numbers",
        ),
        (
            lambda c: gx.fold.Zigzag(length=0.3, panels=3, opening=1e-3),
            "need the width of the film",
        ),
        (
            lambda c: gx.fold.Zigzag(length=0.3, panels=3, bends=3, spacing=0.06),
            "take more than a panel",
        ),
        (lambda c: gx.fold.Roll(length=0.3, bends=3, radius=0.02), "do not go round"),
        # a map that is longer than its film, and films that begin elsewhere
        (
            lambda c: ZIGZAG.mark(sheet(c, 8, 2, 0.2, 0.1)),
            "from x = 0 to 0.3 m, but the mesh reaches from 0 to 0.2 m",
        ),
        (
            lambda c: gx.fold.Roll(length=0.3, bends=30, radius=0.02).mark(begun_at(c, 0.1, 0.0)),
            "but the mesh reaches from 0.1 to 0.4 m",
        ),
        (
            lambda c: placed(c, ZIGZAG, gx.Membrane(begun_at(c, -0.15, 0.0), LAW)),
            "but the mesh reaches from -0.15 to 0.15 m",
        ),
        (lambda c: replace(CROSS, wound=True, out=7), "out is 7"),
        (lambda c: replace(CROSS, out=2), "give wound=True"),
        (
            lambda c: gx.fold.Star(n=8, side=0.04, columns=2, reach=20, gap=5e-3),
            "no room for a hub",
        ),
        (
            lambda c: creased_tube(
                c,
                ((0, 0), (0.1, 0), (0.1, 0.02), (0, 0.02)),
                (),
                0.05,
                lambda X: X[:, 0],
                (),
            ),
            "has all its nodes on the rim; mesh finer",
        ),
    ],
)
def test_what_cannot_be_folded_is_refused(
    comm, act: Callable[[MPI.Intracomm], Any], words: str
) -> None:
    with pytest.raises(gx.InputError, match=words) as caught:
        act(comm)
    assert str(caught.value).endswith(".") and "\n" not in str(caught.value)


def test_contact_starts_from_layers_that_meet_at_folds() -> None:
    """At a fold line edges lie in the next panel's triangles to round-off, and intersect none."""
    film = gx.Membrane(sheet(MPI.COMM_WORLD, 20, 4, 0.8, 0.1), LAW)
    fold = gx.fold.Zigzag(length=0.8, panels=5, angle=1.4)
    contact = gx.Contact(film, distance=2e-4)
    run = gx.Simulation(gx.Scene(film, contact, fold.start(film)), gx.Midpoint(dt=1e-5))
    assert gx.probes.Penetrations(contact)(run) == gx.probes.Crossings(film)(run) == 0


@pytest.mark.parametrize("bends", range(5, 120, 7))
def test_a_roll_is_taken_at_its_documented_limit(bends):
    """Rows that are apart by two thirds of the radius, but for round-off."""
    spacing = 0.5 / (bends + 1)
    gx.fold.Roll(0.5, bends, radius=1.5 * spacing)
    with pytest.raises(gx.InputError, match="do not go round a radius"):
        gx.fold.Roll(0.5, bends, radius=1.499 * spacing)
