"""Contact in scenes: conservation, no penetration, second order, lines, restart, ranks, bad
input."""

from __future__ import annotations

from functools import partial

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
    film,
    obstacle_of,
    simulate,
    two_films,
)


@pytest.mark.mpi(1)
@pytest.mark.parametrize("law", ["barrier", "penalty"])
def test_two_films_collide(comm, law):
    lower, upper = two_films(comm, height=2e-3)
    run = simulate([gx.Contact(lower, upper, distance=1e-3, law=law)], 2e-3)
    # They touched: nearer than the activation distance of 1 mm.
    assert contact_set_of(run).closest < 1e-3
    assert count_intersections(run) == 0
    assert_conserved(run)
    velocity = gx.probes.Velocity(lower.port_at((0.05, 0.05, 0.0)), "z")
    assert velocity(run) < -0.3  # it was hit
    assert run.substeps == 0


def test_films_of_order_two_touch_each_other():
    comm = MPI.COMM_SELF
    lower = film(comm, 2, order=2, name="lower")
    upper = film(comm, 2, height=2e-3, velocity=(0.0, 0.0, -2.0), turn=0.4, order=2, name="upper")
    run = simulate([gx.Contact(lower, upper, distance=1e-3)], 1.5e-3)
    assert contact_set_of(run).closest < 1e-3
    assert count_intersections(run) == 0
    assert_conserved(run)


def test_a_film_falls_edge_on_edge_and_cables_on_a_film():
    comm = MPI.COMM_SELF
    flat = film(comm, name="flat")
    cables = []
    for k, (a, b) in enumerate((((-0.04, 0.0), (0.05, 0.02)), ((-0.03, -0.04), (0.02, 0.06)))):
        mesh = line(comm, [(*a, 0.003), (*b, 0.003)], 3)
        cables.append(
            gx.Cable(
                mesh,
                gx.CableLaw(EA=1e4, line_density=0.01),
                velocity=_down,
                name=f"cable {k}",
            )
        )
    # The second cable starts 4 mm higher, so that it falls on the first one.
    cables[1]._start[0].reshape(-1, 3)[:, 2] += 0.004
    contact = gx.Contact(flat, *cables, distance=5e-4, radius={"cable 0": 5e-4, "cable 1": 5e-4})
    run = simulate([contact], 4e-3)
    assert_conserved(run)
    assert gx.probes.Velocity(flat.port_at((0.05, 0.05, 0.0)), "z")(run) < -0.1
    contact_set = contact_set_of(run)
    assert contact_set.closest < 5e-4
    assert count_intersections(run) == 0


def _down(X):
    return np.outer((0.0, 0.0, -1.5), np.ones(X.shape[1]))


@pytest.mark.parametrize(
    "kind",
    ["plane", "ball", "cylinder", "box", "cone", "in ball", "in cylinder", "in box", "in cone"],
)
def test_films_hit_solids(kind):
    comm = MPI.COMM_SELF
    thrown = film(comm, height=0.0, velocity=(0.1, 0.0, -2.0), name="thrown")
    block = gx.RigidBody(0.02, (1e-5, 1e-5, 1e-5), position=(0.0, 0.0, -0.022), comm=comm)
    solid = obstacle_of(kind, block)
    run = simulate([gx.Contact(thrown, solid, distance=1e-3)], 4e-3)
    contact_set = contact_set_of(run)
    assert contact_set.closest < 1e-3
    # Film and block exchange momentum, of which the sum is constant.
    assert run.totals.momentum[2] == pytest.approx(run.first.momentum[2], rel=1e-11)
    assert_conserved(run, momentum=1e-10)
    # The block has received momentum, however little a heavy body moves.
    assert gx.probes.Velocity(block.port(), "z")(run) < -1e-8
    assert count_intersections(run) == 0


@pytest.mark.mpi
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_cable_that_falls_on_a_ball_stays_outside(comm, friction):
    radius = 0.02
    mesh = line(comm, [(-0.05, 0.004, 0.022), (0.05, 0.004, 0.022)], 5)
    cable = gx.Cable(mesh, gx.CableLaw(EA=1e4, line_density=0.01), velocity=_down, name="cable")
    block = gx.RigidBody(2e-3, (1e-6, 1e-6, 1e-6), comm=comm)
    ball = gx.contact.Sphere(centre=(0.0, 0.0, 0.0), radius=radius, body=block)
    run = simulate(
        [gx.Contact(cable, ball, distance=5e-4, radius={"cable": 1e-3}, friction=friction)], 4e-3
    )
    assert_conserved(run)
    assert run.totals.losses.get("contact", 0.0) > 0 or friction == 0
    assert gx.probes.Velocity(block.port(), "z")(run) < -0.1
    # The middle cell is above the ball, with its nodes far apart: it touches with its inside.
    assert 0 < contact_set_of(run).closest < 5e-4


RAMS = {
    "ball": partial(gx.contact.Sphere, centre=(0, 0, -0.012), radius=0.01),
    "cone": partial(
        gx.contact.Cone,
        start=(0, 0, -0.05),
        end=(0.003, 0.002, -0.002),
        radii=(0.02, 0.001),
    ),
}


@pytest.mark.parametrize("kind", RAMS)
def test_a_moved_obstacle_supplies_its_work(kind):
    rest = film(MPI.COMM_SELF, name="rest")
    ram = RAMS[kind](motion=lambda t: (0.0, 0.0, 2.0 * t))
    run = simulate([gx.Contact(rest, ram, distance=1e-3)], 3e-3)
    # The ram has pushed the film.
    assert run.totals.supplied > 1e-6
    assert abs(run.energy_error) < 1e-9


def test_layers_that_start_near_each_other_have_no_energy_and_part_freely():
    comm = MPI.COMM_SELF
    lower = film(comm, name="lower")
    upper = film(comm, height=1e-5, velocity=(0, 0, 0.5), turn=0.3, name="upper")
    run = simulate([gx.Contact(lower, upper, distance=1e-3)], 3e-3)
    assert run.first.stored["contact"] == 0
    assert run.totals.kinetic == pytest.approx(run.first.kinetic, rel=1e-12)
    distances = contact_set_of(run).history.activation_distance
    # The activation distance of a pair that starts nearer is reduced, and recovers as the pair
    # opens.
    assert distances.min() > 0.9e-3  # grown with the gap


def _two(comm, **second):
    return film(comm, name="one"), film(comm, **{"name": "two", "height": 0.01} | second)


def test_bad_input_is_refused():
    comm = MPI.COMM_SELF
    one, _ = _two(comm)
    with pytest.raises(gx.InputError, match="twice"):
        gx.Contact(one, one, distance=1e-3)
    with pytest.raises(gx.InputError, match="half of it"):
        gx.Contact(one, distance=0.02)
    with pytest.raises(gx.InputError, match="has no film"):
        gx.Contact(gx.contact.Plane(point=(0, 0, 0), normal=(0, 0, 1)), distance=1e-3)
    with pytest.raises(gx.InputError, match=r"bodies\[1\] is of the kind PointMass"):
        gx.Contact(one, gx.PointMass(1.0), distance=1e-3)
    with pytest.raises(gx.InputError, match="radius of 'line'"):
        gx.Contact(
            gx.Cable(line(comm, [(0, 0, 0), (1, 0, 0)], 2), gx.CableLaw(1e4, 0.1), name="line"),
            distance=1e-3,
        )
    nowhere = gx.contact.Plane(point=(0, 0, 0), normal=(0, 0, 0))
    with pytest.raises(gx.InputError, match="has no length"):
        gx.Scene(gx.Contact(one, nowhere, distance=1e-3)).compile()
    with pytest.raises(gx.InputError, match="body and motion are both given"):
        gx.contact.Sphere(
            centre=(0, 0, 0),
            radius=1.0,
            body=gx.RigidBody(1.0, (1, 1, 1)),
            motion=lambda t: (0, 0, 0),
        )
    crossing = gx.Membrane(
        sheet(comm, 4, 4, 0.1, 0.1),
        gx.Miyazaki(**FILM),
        displacement=lambda X: np.vstack([-0.05 + 0 * X[0], -0.05 - X[1], X[1] - 0.05]),
        name="crossing",
    )
    with pytest.raises(
        gx.InputError, match=r"start, \d+ edges .* '(one|crossing)' through '(one|crossing)' near"
    ):
        gx.Scene(gx.Contact(one, crossing, distance=1e-3)).compile()
    with pytest.raises(gx.InputError, match="touch something at the start"):
        gx.Scene(gx.Contact(*_two(comm, height=0.0), distance=1e-3)).compile()
    with pytest.raises(gx.InputError, match="within it"):
        gx.Scene(
            gx.Contact(one, gx.contact.Plane(point=(0, 0, 0.01), normal=(0, 0, 1)), distance=1e-3)
        ).compile()


@pytest.mark.mpi
def test_probes_tell_force_gap_and_penetrations(comm):
    lower = film(comm, name="lower")
    upper = film(comm, height=1.2e-3, velocity=(0.0, 0.0, -2.0), turn=0.4, name="upper")
    contact = gx.Contact(lower, upper, distance=1e-3)
    names = {"down": (lower, "z"), "up": (upper, "z")}
    probes = {
        name: gx.probes.ContactForce(contact, body, axis=axis)
        for name, (body, axis) in names.items()
    }
    seen = gx.Series(
        probes
        | {"gap": gx.probes.ContactGap(contact), "penetrations": gx.probes.Penetrations(contact)}
    )
    run = simulate([contact], 8e-4, outputs=[seen])
    assert np.allclose(seen["down"], -seen["up"], atol=1e-12)
    # Impulse: sum of the force times the step of 1e-4 s.
    impulse = 1e-4 * np.sum(seen["up"])
    owned = run.system.unknowns.state[upper].owned
    P = run.system.unknowns.numbering.vector()
    run.system.unknowns.M.mult(run.system.unknowns.v0, P)
    momentum = comm.allreduce(P.array_r[owned][2::3].sum())
    # Momentum gained from -2 m/s × 0.14 kg/m² × 0.01 m².
    assert impulse == pytest.approx(momentum + 2.0 * 0.14 * 0.01, rel=1e-9)
    assert 0 < min(seen["gap"]) < 1e-3
    assert max(seen["penetrations"]) == 0
    with pytest.raises(gx.InputError, match="axis is 'w'"):
        gx.probes.ContactForce(contact, lower, axis="w")
    with pytest.raises(gx.InputError, match="which holds: lower, upper"):
        gx.probes.ContactForce(contact, film(comm, name="other"), axis="z")
    with pytest.raises(gx.InputError, match="not in the scene"):
        gx.probes.ContactGap(gx.Contact(lower, distance=1e-3))(run)


@pytest.mark.mpi
def test_the_force_on_a_plane_is_opposite_to_that_on_the_film(comm) -> None:
    falling = film(comm, height=1.2e-3, velocity=(0.5, 0.0, -2.0), turn=0.4, name="film")
    # Leaning a little: the film touches it in some points only, so that the moment is not zero.
    floor = gx.contact.Plane(point=(0.0, 0.0, 0.0), normal=(0.01, 0.0, 1.0))
    contact = gx.Contact(falling, floor, distance=1e-3)
    forces = {
        f"{body.name} {axis}": gx.probes.ContactForce(contact, body, axis=axis)
        for body in (falling, floor)
        for axis in "xyz"
    }
    seen = gx.Series(forces)
    simulate([contact], 8e-4, outputs=[seen])
    largest = max(seen["film z"])
    assert largest > 1.0
    for axis in "xyz":
        total = np.add(seen[f"film {axis}"], seen[f"{floor.name} {axis}"])
        # Round-off of the sums over pairs.
        assert abs(total).max() < 1e-12 * largest


def test_penetrations_may_be_counted_in_every_third_step(
    comm, monkeypatch: pytest.MonkeyPatch
) -> None:
    counted_at = []

    def count(*arguments) -> list[int]:
        counted_at.append(run.step)
        return [1]

    monkeypatch.setattr("gossamer_fx.records.probes.contact.find_intersections", count)
    contact = gx.Contact(film(comm, name="film"), distance=1e-3)
    probe = gx.probes.Penetrations(contact, every=3)
    seen = gx.Series({"penetrations": probe})
    scene = gx.Scene(*contact.bodies, contact)
    run = gx.Simulation(scene, gx.Midpoint(dt=1e-4), outputs=[seen])
    run.run(until=7e-4)
    assert counted_at == [0, 3, 6]
    # Steps between have the last number; each rank has found one.
    assert list(seen["penetrations"]) == [comm.size] * 8
    # Two more runs that have not yet begun.
    for _ in range(2):
        probe(gx.Simulation(scene, gx.Midpoint(dt=1e-4)))
    assert len(counted_at) == 5
    with pytest.raises(gx.InputError, match="every is 0"):
        gx.probes.Penetrations(contact, every=0)


def test_films_that_rest_node_over_node_do_not_believe_to_have_passed():
    one = film(MPI.COMM_SELF, name="one")
    other = film(MPI.COMM_SELF, height=1.2e-3, name="other")
    run = simulate([gx.Contact(one, other, distance=1e-3)], 2e-4)
    assert run.substeps == 0
    # They rest: energy of round-off only.
    assert run.totals.kinetic < 1e-20
