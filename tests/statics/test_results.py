"""Results of an equilibrium by public names: positions, stresses, reactions, joint forces,
probes."""

from __future__ import annotations

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import crossed_sheet, sheet
from tests.small_scenes import at_rest

E = 1e9
THICKNESS = 1e-4
LAW = gx.Linear(E, 0.0, density=1000.0, thickness=THICKNESS)


def column(value):
    # Uniform states are exact up to the tolerance of the equilibrium.
    return pytest.approx(value, rel=1e-7, abs=1e-7)


@pytest.mark.mpi
def test_strains_stresses_and_positions_of_a_pulled_strip(comm):
    """λ = 1.02, ν = 0: E11 = (λ² - 1)/2, S11 = E E11, σ = λ S11."""
    film = gx.Membrane(sheet(comm, 4, 2, 2.0, 1.0), LAW)
    pulled = gx.Fixed(
        film,
        "right",
        motion=lambda X, t: np.vstack([0.04 + 0 * X[0], 0 * X[0], 0 * X[0]]),
    )
    equilibrium = at_rest(gx.Fixed(film, "left"), pulled)
    points, strain = gx.fields.field_values(equilibrium, film, field="strain1")
    _, stress = gx.fields.field_values(equilibrium, film, field="stress1")
    # Green's strain of the stretch 1.02.
    assert strain == column((1.02**2 - 1) / 2)
    # Force over a section that does not change, ν = 0: σ = λ S.
    assert stress == column(1.02 * E * (1.02**2 - 1) / 2)
    assert points.shape == (len(strain), 3)
    x = gx.fields.positions(equilibrium, film)
    assert comm.allreduce(float(x[:, 0].max()), max) == column(2.04)
    _, u = gx.fields.field_values(equilibrium, film, field="displacement")
    assert u.shape[1] == 3
    assert gx.probes.Position(film.port("top right"), "x")(equilibrium) == column(2.04)
    assert gx.probes.AreaFraction(film, "taut")(equilibrium) == column(1.0)
    other = gx.Membrane(sheet(comm, 1, 1), LAW, name="other")
    with pytest.raises(gx.InputError, match="'other' is not in the scene"):
        gx.fields.positions(equilibrium, other)


def test_reaction_of_a_clamped_beam(comm):
    """Force -F and moment about the clamp: its arm is that of the deflected tip."""
    beam = gx.Beam(
        line(comm, [(0, 0, 0), (1, 0, 0)], 8),
        gx.sections.tube(0.02, 5e-4, E=1e11, nu=0.3, density=1560.0),
    )
    clamp = gx.Fixed(beam, "start", rotation=True)
    tip = beam.port("end")
    F = (3.0, -2.0, 5.0)
    equilibrium = at_rest(clamp, gx.loads.Force(tip, F))
    x = [gx.probes.Position(tip, axis)(equilibrium) for axis in "xyz"]
    force, moment = equilibrium.reaction(clamp)
    assert force == pytest.approx([-3.0, 2.0, -5.0], abs=1e-6)
    # Moment about the clamp with the arm of the deflected tip.
    assert moment == pytest.approx(-np.cross(x, F), abs=1e-6)
    _, elsewhere = equilibrium.reaction(clamp, about=(1.0, 2.0, 3.0))
    assert elsewhere == pytest.approx(moment - np.cross((1.0, 2.0, 3.0), force), abs=1e-6)


@pytest.mark.mpi
def test_moment_of_a_clamped_plate(comm):
    """The moment of the clamp is that of the load about it.

    The slope is held by energies of the edge, whose forces act on nodes near it, too.
    """
    sheet_law = gx.Linear(E=1e9, nu=0.0, density=1000.0, thickness=1e-3)
    mesh = crossed_sheet(comm, 8, 2, 0.4, 0.1)
    plate = gx.Plate(mesh, sheet_law, name="plate")
    clamp = gx.Fixed(plate, "left", rotation=True)
    loads = [
        gx.loads.Force(plate.port(corner), (0.0, 0.0, 5e-3), name=corner)
        for corner in ("top right", "bottom right")
    ]
    equilibrium = at_rest(clamp, *loads)
    arms = [
        [gx.probes.Position(plate.port(one.name), axis)(equilibrium) for axis in "xyz"]
        for one in loads
    ]
    moment = equilibrium.reaction(clamp)[1]
    assert moment == pytest.approx(-np.cross(arms, (0.0, 0.0, 5e-3)).sum(axis=0), abs=1e-7)
    # F L, but for what the tip moves inwards.
    assert moment[1] == pytest.approx(0.01 * 0.4, rel=0.01)


def thrown_against_springs(comm):
    """A clamped strip with weight, on a rope with damping."""
    film = gx.Membrane(sheet(comm, 2, 1), LAW, name="strip")
    clamp = gx.Fixed(film, "left", motion=lambda X, t: np.vstack([0 * X[0], 0 * X[0], X[0] + t]))
    corner = film.port("top right")
    hook = gx.Ground(corner.initial() + np.array((0.0, 0.0, 0.5)))
    rope = gx.connectors.Rope(corner, hook, stiffness=50.0, length=0.3, damping=0.5)
    return clamp, rope, gx.Scene(clamp, rope, gx.Gravity(film, (0.0, 0.0, -9.81)))


@pytest.mark.mpi
def test_reactions_after_a_restart_are_those_of_the_last_step(comm, folder):
    clamp, rope, scene = thrown_against_springs(comm)
    run = gx.Simulation(scene, gx.Midpoint(dt=1e-3), checkpoints=gx.Checkpoints(folder))
    run.run(until=4e-3)
    probes = {
        **gx.probes.Reaction.components(clamp, "clamp"),
        **gx.probes.Reaction.components(rope, "rope", about=(1.0, 0.0, 0.0)),
    }
    before = {name: probe(run) for name, probe in probes.items()}
    clamp, rope, scene = thrown_against_springs(comm)
    again = gx.Simulation(scene, gx.Midpoint(dt=1e-3), restart=folder)
    probes = {
        **gx.probes.Reaction.components(clamp, "clamp"),
        **gx.probes.Reaction.components(rope, "rope", about=(1.0, 0.0, 0.0)),
    }
    assert abs(before["rope force z [N]"]) > 1.0
    assert abs(before["clamp force z [N]"]) > 1.0
    assert {name: probe(again) for name, probe in probes.items()} == pytest.approx(before)


@pytest.mark.mpi
def test_force_of_a_tie(comm):
    """Two strips that are tied and pulled: the tie pulls the second one with the whole force."""
    first = gx.Membrane(sheet(comm, 2, 1), LAW, name="first")
    move = {"displacement": lambda X: np.vstack([1 + 0 * X[0], 0 * X[0], 0 * X[0]])}
    second = gx.Membrane(sheet(comm, 2, 1), LAW, name="second", **move)
    tie = gx.Tie(first, second, group_a="right", group_b="left")
    held = gx.Fixed(first, "left")
    pulled = gx.Fixed(
        second, "right", motion=lambda X, t: np.vstack([1.01 + 0 * X[0], 0 * X[0], 0 * X[0]])
    )
    flat = [
        gx.Fixed(film, "film", components=(2,), name=f"{film.name} flat")
        for film in (first, second)
    ]
    equilibrium = at_rest(held, pulled, tie, *flat)
    force = equilibrium.reaction(pulled)[0]
    assert abs(force[0]) > 100.0
    assert equilibrium.reaction(tie)[0] == pytest.approx(-force, rel=1e-6, abs=1e-4)
    assert equilibrium.joint_force(tie)[0] == pytest.approx(-force, rel=1e-6, abs=1e-4)


def test_reactions_name_what_they_need(comm):
    film = gx.Membrane(sheet(comm, 2, 1), LAW, name="strip")
    held = gx.Fixed(film, "left")
    weight = gx.Gravity(film, (0.0, 0.0, -9.81))
    equilibrium = at_rest(held, gx.Fixed(film, "right", name="other"), weight)
    total = sum(
        gx.probes.Reaction(one, "z")(equilibrium)
        for one in equilibrium.system.unknowns.items
        if isinstance(one, gx.Fixed)
    )
    resultant = gx.probes.LoadResultant((0.0, 0.0, 0.0), weight.name, action="force", axis="z")
    assert total == pytest.approx(-resultant(equilibrium), rel=1e-9)
    torque = gx.probes.LoadResultant((1.0, 0.0, 0.0), weight.name, action="torque", axis="y")
    middle = gx.probes.LoadResultant((0.0, 0.0, 0.0), weight.name, action="torque", axis="y")
    assert torque(equilibrium) - middle(equilibrium) == pytest.approx(resultant(equilibrium))
    tape = gx.connectors.Tape.along_edges(film, gx.CableLaw(1e3, 0.01), edges="top", name="tape")
    taped = at_rest(held, gx.Fixed(film, "right", name="other"), tape)
    with pytest.raises(gx.InputError, match="joins no two bodies and is not on the ground"):
        gx.probes.Reaction(tape, "x")(taped)
    with pytest.raises(gx.InputError, match="a load and not a support or joint"):
        gx.probes.Reaction(weight, "z")(equilibrium)
    with pytest.raises(gx.InputError, match="not a support or joint of this scene"):
        gx.probes.Reaction(gx.Fixed(film, "right"), "z")(equilibrium)


@pytest.mark.mpi
def test_forces_of_joints_at_rest_and_in_motion(comm):
    """A body hung on a hinge that hangs on another: weights; a body swung on a joint: m ω² r to
    second order in h."""
    upper = gx.RigidBody(2.0, (1.0, 1.0, 1.0), position=(0.0, 0.0, -1.0), name="upper")
    lower = gx.RigidBody(3.0, (1.0, 1.0, 1.0), position=(0.5, 0.0, -3.0), name="lower")
    top = gx.constraints.FixedJoint(gx.ground_frame(), upper.frame_at((0.0, 0.0, 0.0)), name="top")
    middle = gx.constraints.FixedJoint(
        upper.frame_at((0.0, 0.0, -2.0)),
        lower.frame_at((0.0, 0.0, -2.0)),
        name="middle",
    )
    g = (0.0, 0.0, -10.0)
    equilibrium = at_rest(top, middle, gx.Gravity(upper, g), gx.Gravity(lower, g))
    force, moment = equilibrium.joint_force(middle, about=(0.0, 0.0, -2.0))
    assert force == pytest.approx([0, 0, 30.0], abs=1e-6)
    # Weight of the lower body, 30 N, at an arm of 0.5 m.
    assert moment == pytest.approx([0, -15.0, 0], abs=1e-6)
    force, moment = equilibrium.joint_force(top)
    # Both weights.
    assert force == pytest.approx([0, 0, 50.0], abs=1e-6)
    assert moment == pytest.approx([0, -15.0, 0], abs=1e-6)
    assert gx.probes.JointForce(top, "z")(equilibrium) == pytest.approx(50.0)

    stone = gx.RigidBody(
        2.0,
        (1.0, 1.0, 1.0),
        position=(0.5, 0.0, 0.0),
        velocity=(0.0, 1.5, 0.0),
        spin=(0.0, 0.0, 3.0),
    )
    hinge = gx.constraints.RevoluteJoint(
        gx.ground_frame(),
        stone.frame_at((0.0, 0.0, 0.0)),
        axis=(0.0, 0.0, 1.0),
        name="hinge",
    )
    series = gx.Series(
        {
            "x": gx.probes.JointForce(hinge, "x"),
            "y": gx.probes.JointForce(hinge, "y"),
            "ω": gx.probes.AngularVelocity(stone.frame(), "z"),
        }
    )
    gx.Simulation(gx.Scene(hinge), gx.Midpoint(dt=1e-3), outputs=[series]).run(until=0.05)
    # m ω² r of the stone, to h².
    assert np.hypot(series["x"], series["y"])[1:] == pytest.approx(2.0 * 3.0**2 * 0.5, rel=1e-4)
    assert series["ω"] == pytest.approx(3.0, rel=1e-6)


def test_angular_velocity_of_a_beam(comm):
    beam = gx.Beam(
        line(comm, [(0, 0, 0), (1, 0, 0)], 2),
        gx.sections.tube(0.02, 5e-4, E=1e11, nu=0.3, density=1560.0),
        velocity=lambda X: np.cross((0.3, 0.0, 2.0), X.T).T,
    )
    run = gx.Simulation(gx.Scene(beam), gx.Midpoint(dt=1e-3))
    assert gx.probes.AngularVelocity(beam.frame("end"), "z")(run) == pytest.approx(2.0)
    assert gx.probes.AngularVelocity(beam.frame("end"), "x")(run) == pytest.approx(0.3)
    with pytest.raises(gx.InputError, match="ground does not turn"):
        gx.probes.AngularVelocity(gx.ground_frame(), "z")


def test_a_line_search_is_refused(comm):
    """The residual follows the iterates one by one: asked at another place, it is another
    function."""
    from petsc4py import PETSc

    film = gx.Membrane(sheet(comm, 2, 2), LAW)
    options = PETSc.Options("gx_")
    options["snes_linesearch_type"] = "cp"
    try:
        with pytest.raises(gx.InputError, match="leave the option out"):
            gx.Simulation(gx.Scene(film), gx.Midpoint(dt=1e-3))
    finally:
        options.delValue("snes_linesearch_type")


@pytest.mark.mpi
def test_components_of_loads_and_supports_add_up_to_zero(comm):
    """Six numbers of each, about one point, by names that say their units."""
    film = gx.Membrane(sheet(comm, 3, 3), LAW, initial_stress=1e6, name="film")
    edges = [gx.Fixed(film, "left"), gx.Fixed(film, "right")]
    loads = [gx.Gravity(film), gx.loads.EdgeLoad(film, "top", force=(0.0, 3.0, 1.0))]
    equilibrium = at_rest(*edges, *loads)
    about = (0.2, -0.3, 1.0)
    supports = [gx.probes.Reaction.components(edge, "edge", about=about) for edge in edges]
    acting = [gx.probes.LoadResultant.components(one.name, "load", about=about) for one in loads]
    assert list(acting[0])[5] == "load torque z [N m]"
    rows = [[probe(equilibrium) for probe in six.values()] for six in (*supports, *acting)]
    assert np.abs(rows).max() > 1.0
    assert np.sum(rows, axis=0) == pytest.approx(np.zeros(6), abs=1e-6)
