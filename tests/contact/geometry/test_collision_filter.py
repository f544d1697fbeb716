"""Contact of films that are tied along a line: they are connected there, and touch everywhere
else."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet
from tests.contact.scenes import (
    FILM,
    assert_conserved,
    contact_set_of,
    count_intersections,
    leaf,
    simulate,
)


@pytest.mark.mpi(1)
@pytest.mark.parametrize("n, order", [(4, 1), (6, 1), (3, 2)])
def test_leaves_clap_together_about_the_line_on_which_they_are_tied(comm, n, order):
    """The mesh of the second is the same on the line, finer without a common multiple, or of order
    two."""
    lower = leaf(comm, order=order, name="lower", n=4 if order == 1 else 2)
    upper = leaf(
        comm,
        # The films turn towards each other by 0.03 rad and meet near their free edges first.
        n,
        angle=0.03,
        spin=-20.0,
        order=order,
        name="upper",
    )
    contact = gx.Contact(lower, upper, distance=1e-3)
    seen = gx.Series(
        {
            "penetrations": gx.probes.Penetrations(contact),
            "crossings": gx.probes.Crossings(lower, upper),
        }
    )
    run = simulate(
        [contact, gx.Tie(upper, lower, group_a="left", group_b="left")],
        4e-3,
        outputs=[seen],
    )
    assert run.first.stored["contact"] == 0
    measured = contact_set_of(run).history.activation_distance.min()
    # Cells at the tied line are near by construction, and must not shrink the activation distance.
    assert measured > 1e-4  # no joined cells are taken for near ones
    assert contact_set_of(run).closest < 1e-3
    assert max(seen["penetrations"]) == max(seen["crossings"]) == count_intersections(run) == 0
    assert_conserved(run, energy=1e-10, momentum=1e-12)
    measured = gx.probes.Velocity(lower.port("top right"), "z")(run)
    assert measured < -0.1  # it was hit
    difference = [gx.probes.Position(b.port("bottom left"), "z")(run) for b in (lower, upper)]
    assert difference[0] == pytest.approx(difference[1], abs=1e-10)


@pytest.mark.mpi
def test_leaves_that_are_nearer_than_the_distance_open_freely(comm):
    lower = leaf(comm, spin=-20.0, angle=-0.03, name="lower")
    upper = leaf(comm, 6, angle=0.03, spin=20.0, name="upper")
    contact = gx.Contact(lower, upper, distance=2e-3)
    seen = gx.Series({"energy": lambda run: run.totals.stored["contact"]})
    run = simulate(
        [contact, gx.Tie(upper, lower, group_a="left", group_b="left")],
        4e-3,
        outputs=[seen],
    )
    # Films that part may not gain energy, though they start within the activation distance.
    assert max(seen["energy"]) == 0
    assert contact_set_of(run).history.activation_distance.min() == 2e-3  # it has grown
    assert_conserved(run, energy=1e-10, momentum=1e-12)


@pytest.mark.mpi
def test_films_and_a_cable_on_one_line_and_a_line_that_is_tied_to_a_tied_one(comm):
    """The third film is tied to the second, and this to the first; the cable is tied to the
    third."""
    films = [
        leaf(comm, n, angle=2 * math.pi * k / 3, name=f"film {k}") for k, n in enumerate((2, 3, 5))
    ]
    cable = gx.Cable(
        line(comm, [(0, 0, 0), (0, 0.1, 0)], 4),
        gx.CableLaw(EA=100.0, line_density=0.1),
        name="cable",
    )
    ties = [
        gx.Tie(b, a, group_a="left", group_b="left")
        for a, b in ((films[0], films[1]), (films[1], films[2]))
    ]
    contact = gx.Contact(*films, cable, distance=1e-3, radius={"cable": 1e-3})
    run = simulate(
        [
            contact,
            *ties,
            gx.Tie(cable, films[2], group_a=None, group_b="left"),
            gx.RigidMotion(spin=(1.0, 5.0, 2.0)),
        ],
        1e-3,
    )
    assert run.first.stored["contact"] == 0
    assert contact_set_of(run).history.activation_distance.min() == 1e-3
    assert_conserved(run, energy=1e-10, momentum=1e-12)


def test_layers_that_coincide_and_are_not_tied_are_refused():
    lower = leaf(MPI.COMM_SELF, name="lower")
    upper = leaf(MPI.COMM_SELF, name="upper")
    tie = gx.Tie(upper, lower, group_a="left", group_b="left")
    with pytest.raises(gx.InputError, match=r"touch something at the start.*or tie them"):
        gx.Scene(gx.Contact(lower, upper, distance=1e-3), tie).compile()
    apart = [leaf(MPI.COMM_SELF, angle=0.5 * k, name=f"leaf {k}") for k in range(2)]
    with pytest.raises(gx.InputError, match="touch something at the start"):
        gx.Scene(gx.Contact(*apart, distance=1e-3)).compile()


def test_films_joined_at_a_point_hang_together_there():
    flat = leaf(MPI.COMM_SELF, name="flat")
    steep = gx.Membrane(
        sheet(MPI.COMM_SELF, 2, 2, 0.1, 0.1),
        gx.Miyazaki(**FILM),
        displacement=lambda X: np.vstack([-X[0], -X[1], X[0]]) - X,
        name="steep",
    )
    contact = gx.Contact(flat, steep, distance=1e-3)
    joint = gx.constraints.BallJoint(flat.port("bottom left"), steep.port("bottom left"))
    with pytest.raises(gx.InputError, match="touch something at the start"):
        gx.Scene(contact).compile()
    gx.Scene(contact, joint).compile()


@pytest.mark.mpi
def test_edges_of_films_that_are_tied_share_the_area_of_one_edge(comm):
    """The rope on the same line touches at another distance, and has its own area."""
    films = [leaf(comm, angle=2 * math.pi * k / 3, name=f"film {k}") for k in range(3)]
    rope = gx.Cable(
        line(comm, [(0, 0, 0), (0, 0.1, 0)], 4), gx.CableLaw(EA=100.0, line_density=0.1)
    )
    ties = [gx.Tie(film, films[0], group_a="left", group_b="left") for film in films[1:]]
    ties.append(gx.Tie(rope, films[0], group_a=None, group_b="left"))
    contact = gx.Contact(*films, rope, distance=1e-3, radius={rope.name: 1e-3})
    mesh = contact_set_of(simulate([contact, *ties], 1e-4)).mesh
    edges = mesh.known.edges
    is_own = edges.owner == comm.rank
    count = comm.allreduce(int(is_own.sum()))
    # Four edges of the line belong to three films, and are four edges together.
    assert comm.allreduce(float(edges.share[is_own].sum())) == pytest.approx(count - 2 * 4)
    of_rope = mesh.body[mesh.surface.edges[: len(edges), 0]] == len(films)
    assert (edges.share[of_rope] == 1).all()
