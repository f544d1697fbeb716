"""Scenes without equilibrium are refused, and their free rigid motions are named."""

from __future__ import annotations

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx import Equilibrium, NoEquilibrium
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import EDGES, sheet

LAW = gx.Miyazaki(E=1e9, nu=0.3, density=1000.0, thickness=1e-4)
STRETCHED = {"displacement": lambda X: 0.01 * X}


def film(comm, name="film", law=LAW, **start):
    return gx.Membrane(sheet(comm, 3, 3), law, name=name, **start)


@pytest.mark.mpi(1)
@pytest.mark.parametrize("load", ["gravity", "edge", "one of two", "corner"])
def test_what_nothing_holds_has_no_equilibrium(comm, load):
    """It was 'found' 5e9 m away, with half of the load unbalanced."""
    first = film(comm)
    second = film(comm, "other")
    scene = {
        "gravity": lambda: gx.Scene(first, gx.Gravity(first)),
        "edge": lambda: gx.Scene(first, gx.loads.EdgeLoad(first, "right", force=(10.0, 0.0, 0.0))),
        "one of two": lambda: gx.Scene(
            gx.Fixed(first, "left"), gx.Gravity(first), gx.Gravity(second)
        ),
        "corner": lambda: gx.Scene(first, gx.loads.Force(first.port("top right"), (0.0, 1.0, 0.0))),
    }[load]()
    culprit = "other" if load == "one of two" else "film"
    with pytest.raises(NoEquilibrium, match=f"'{culprit}' has moved by .* hold it"):
        Equilibrium(scene).find()


@pytest.mark.parametrize(
    "law",
    [LAW, gx.TensionField(E=1e9, nu=0.3, density=1000.0, thickness=1e-4)],
)
def test_an_unloaded_slack_film_rests_where_it_is(comm, law):
    """Its residual was 5.5, of loads that are nothing but round-off; now it is below the round-off
    of the film."""
    body = film(comm, law=law, displacement=lambda X: -0.1 * X)
    found = Equilibrium(gx.Scene(body)).find()
    # Loads are zero, so that the residual is relative to the round-off of the film.
    assert found.residual < 1e-3
    assert not found.regular


@pytest.mark.filterwarnings("ignore:invalid value encountered")
def test_the_result_is_the_state_that_was_found_before_the_last_iteration(comm):
    """A pendulum hung at (1, 0, 0), whose turn about the vertical nothing resists: the residual was
    nan."""
    bob = gx.RigidBody(1.0, (1.0, 1.0, 1.0), position=(1.0, 0.0, -1.0))
    scene = gx.Scene(
        gx.constraints.BallJoint(bob.port((0.0, 0.0, 1.0)), gx.Ground((1.0, 0.0, 0.0))),
        gx.Gravity(bob),
    )
    found = Equilibrium(scene).find()
    assert found.residual < 1e-8
    assert found.free == ("rotation z about (1, 0, 0)",)
    assert not found.regular


@pytest.mark.mpi
def test_parts_are_free_apart(comm):
    first = film(comm, **STRETCHED)
    second = film(comm, "other", **STRETCHED)
    found = Equilibrium(gx.Scene(gx.Fixed(first, "left"), gx.Fixed(first, "right"), second)).find()
    motions = [
        f"{kind} {axis} of 'other'" for kind in ("translation", "rotation") for axis in "xyz"
    ]
    measured = [words.split(" about")[0] for words in found.free]
    assert measured == [m.split(" about")[0] for m in motions]
    assert not found.regular


def test_a_mass_on_a_slack_rope_is_not_held(comm):
    mass = gx.PointMass(1.0, (0.5, 0.0, 0.0))
    found = Equilibrium(
        gx.Scene(
            gx.connectors.Rope(mass.port(), gx.Ground((0.0, 0.0, 0.0)), length=1.0, stiffness=10.0)
        )
    ).find()
    assert found.free == ("translation x", "translation y", "translation z")
    assert not found.regular


@pytest.mark.parametrize(
    ("joint", "free"),
    [
        (
            lambda b, at: gx.constraints.RevoluteJoint(
                b.frame_at(at),
                gx.ground_frame(at),
                axis=(0, 1, 0),
            ),
            "rotation y about (1, 0, 0)",
        ),
        (
            lambda b, at: gx.constraints.PrismaticJoint(
                b.frame_at(at),
                gx.ground_frame(at),
                axis=(0, 1, 1),
            ),
            "translation (0, 0.707, 0.707)",
        ),
        (lambda b, at: gx.constraints.FixedJoint(b.frame_at(at), gx.ground_frame(at)), ""),
    ],
    ids=["hinge", "slide", "fixed"],
)
def test_a_joint_leaves_its_own_motion(comm, joint, free):
    body = gx.RigidBody(1.0, (1.0, 1.0, 1.0), position=(2.0, 0.0, 0.0))
    found = Equilibrium(gx.Scene(joint(body, (1.0, 0.0, 0.0)))).find()
    assert found.free == ((free,) if free else ())
    assert found.regular == (not free)


def test_a_film_that_is_pinned_turns_about_its_pin(comm):
    """A stretched strip between two pins on a slanted line turns about that line."""
    body = film(comm, law=gx.Linear(E=1e9, nu=0.3, density=1000.0, thickness=1e-4), **STRETCHED)
    found = Equilibrium(gx.Scene(gx.Fixed(body, "bottom left"), gx.Fixed(body, "top right"))).find()
    # The axis between two opposite corners of the square.
    assert found.free == ("rotation (0.707, 0.707, 0)",)


def test_a_tank_alone_has_nothing_to_find(comm):
    tank = gx.Tank(1e-3, gas=gx.IdealGas(1.4, 287.0), pressure=1e5, temperature=300.0)
    with pytest.raises(gx.InputError, match="no body"):
        Equilibrium(gx.Scene(tank))


@pytest.mark.parametrize("ask", ["reaction", "joint_force", "modes"])
def test_results_before_an_equilibrium_was_found_are_refused(comm, ask):
    body = film(comm)
    held = gx.Fixed(body, "left")
    corner = gx.constraints.BallJoint(body.port_at((0.0, 0.0, 0.0)), gx.Ground((0.0, 0.0, 0.0)))
    equilibrium = Equilibrium(gx.Scene(held))
    asked = {
        "reaction": lambda: equilibrium.reaction(held),
        "joint_force": lambda: equilibrium.joint_force(corner),
        "modes": lambda: gx.analysis.modes(equilibrium, 1),
    }
    with pytest.raises(gx.InputError, match="no equilibrium was found yet"):
        asked[ask]()


def test_what_lies_on_an_obstacle_counts_as_supported(comm):
    """After one iteration it is not at rest; the advice must not be to hold what the floor
    holds."""
    lying = film(comm)
    floor = gx.contact.Plane(point=(0.0, 0.0, -1e-3), normal=(0.0, 0.0, 1.0))
    weight = gx.Gravity(lying)
    search = gx.analysis.Continuation(total_iterations=1)
    with pytest.raises(NoEquilibrium) as of_contact:
        scene = gx.Scene(lying, weight, gx.Contact(lying, floor, distance=2e-3))
        Equilibrium(scene, search).find()
    assert "supported" not in str(of_contact.value)
    with pytest.raises(NoEquilibrium, match="Nothing in the scene is supported"):
        Equilibrium(gx.Scene(lying, weight), search).find()


def steel_cantilever(comm, scale: float) -> gx.Equilibrium:
    """A bar of steel, 2 m long, with a force at its tip that comes and goes with sin(π t)."""
    section = gx.sections.rectangle(0.1, 0.1, E=scale * 210e9, nu=0.3, density=7850.0)
    beam = gx.Beam(line(comm, [(0.0, 0.0, 0.0), (2.0, 0.0, 0.0)], 20), section)
    force = gx.loads.Force(beam.port("end"), lambda t: (0.0, 0.0, -scale * 1e7 * np.sin(np.pi * t)))
    return gx.Equilibrium(gx.Scene(beam, force, gx.Fixed(beam, "start", rotation=True)))


def test_a_stiff_structure_is_as_regular_as_a_soft_one(comm, caplog):
    """Whether a tangent is singular does not depend on the units of forces and moments."""
    for scale in (1.0, 1e-3, 1e-9):
        result = steel_cantilever(comm, scale).find(0.5)
        assert result.regular and result.within_tolerance
    assert not caplog.records


def test_unloading_is_not_blamed_for_its_round_off(comm, caplog):
    equilibrium = steel_cantilever(comm, 1e-2)
    for at in (0.0, 0.5, 1.0, 1.5, 2.0):
        assert equilibrium.find(at).within_tolerance
    assert not caplog.records


@pytest.mark.parametrize("elements", [8, 64])
def test_a_load_that_round_off_almost_hides_is_not_within_tolerance(comm, elements, caplog):
    """A stiff rope under a centinewton: its residual is the unbalanced force over the load, not
    over the round-off of the inner forces, which ends the search earlier."""
    load = 1e-2
    straight = line(comm, [(0.0, 0.0, 0.0), (10.0, 0.0, 0.0)], elements)
    cable = gx.Cable(straight, gx.CableLaw(1e7, 0.1))
    force = gx.loads.Force(cable.port("end"), (load, 0.0, 0.0))
    equilibrium = gx.Equilibrium(gx.Scene(cable, force, gx.Fixed(cable, "start")))
    result = equilibrium.find()
    assert not result.within_tolerance
    assert "above the tolerance" in caplog.text and "give a larger tolerance" in caplog.text
    assert 1e-8 < result.residual < 1e-3


@pytest.mark.mpi
def test_a_plate_without_loads_is_not_blamed_for_the_round_off_of_its_reactions(comm, caplog):
    """It was "found to 2.9e-05 of the load", of which there is none."""
    law = gx.Linear(70e9, 0.3, density=2700.0, thickness=5e-3)
    plate = gx.Plate(sheet(comm, 4, 4), law)
    edges = [gx.Fixed(plate, edge) for edge in EDGES]
    assert gx.Equilibrium(gx.Scene(*edges)).find().within_tolerance
    assert not caplog.records


def test_an_open_film_under_pressure_names_what_does_not_close_it(comm):
    """The message of a search that fails; the sheet is held at one edge."""
    sheet_of_film = film(comm)
    search = gx.analysis.Continuation(total_iterations=20)
    pressure = gx.Pressure(sheet_of_film, 1e3, name="wind")
    scene = gx.Scene(gx.Fixed(sheet_of_film, "left"), pressure)
    words = "Nothing closes the open film 'film' against 'wind': [0-9]+ of [0-9]+ nodes of its rim"
    with pytest.raises(gx.NoEquilibrium, match=words) as failure:
        Equilibrium(scene, search).find()
    assert "gx.analysis.path follows its equilibria" in str(failure.value)


def beam_with_dead_moment(comm, moments: tuple[float, float, float]) -> gx.Equilibrium:
    """A beam of 10 m, held at its start, with a moment at its end, over E I, whose direction stays
    [1/m]."""
    section = gx.sections.rectangle(0.1, 0.1, E=1e7, nu=0.0, density=1000.0)
    beam = gx.Beam(line(comm, [(0.0, 0.0, 0.0), (10.0, 0.0, 0.0)], 20), section)
    bending_stiffness = 1e7 * 0.1**4 / 12
    torque = gx.loads.Torque(beam.frame("end"), tuple(bending_stiffness * m for m in moments))
    return gx.Equilibrium(gx.Scene(beam, gx.Fixed(beam, "start", rotation=True), torque))


def test_a_beam_that_a_dead_moment_winds_up_comes_to_the_full_load(comm):
    """Bent to a full turn, and twisted."""
    result = beam_with_dead_moment(comm, (0.3, 0.0, 0.2 * np.pi)).find(progress=False)
    assert result.regular and result.within_tolerance


def test_a_dead_moment_that_is_not_reached_names_the_path(comm):
    with pytest.raises(gx.NoEquilibrium, match=r"gx\.analysis\.path follows its equilibria"):
        beam_with_dead_moment(comm, (1.0, 0.0, 0.4)).find(progress=False)


def test_a_constraint_elsewhere_does_not_hide_an_open_film(comm):
    """A tie on one side of the sheet leaves the others free."""
    sheet_of_film = film(comm)
    search = gx.analysis.Continuation(total_iterations=20)
    other = gx.Membrane(
        sheet(comm, 2, 2, 1.0, 1.0),
        sheet_of_film.law,
        displacement=lambda X: np.vstack([1.0 + 0 * X[0], 0 * X[0], 0 * X[0]]),
        name="other",
    )
    scene = gx.Scene(
        gx.Fixed(sheet_of_film, "left"),
        gx.Pressure(sheet_of_film, 1e3, name="wind"),
        gx.Tie(sheet_of_film, other, group_a="right", group_b="left"),
    )
    words = "Nothing closes the open film 'film' against 'wind'"
    with pytest.raises(gx.NoEquilibrium, match=words):
        Equilibrium(scene, search).find()
