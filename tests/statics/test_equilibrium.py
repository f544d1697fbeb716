"""Static equilibria with known solutions, reactions and work, and the message if there is none."""

from __future__ import annotations

import numpy as np
import pytest

import gossamer_fx as gx
from demos.studies import airbag, clamped_disc, mylar_balloon
from gossamer_fx import Equilibrium, NoEquilibrium
from gossamer_fx.analysis import Continuation
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet
from tests.small_scenes import run_until

FILM = {"E": 1e9, "nu": 0.3, "density": 1000.0, "thickness": 1e-4}

RIGID_MOTIONS = (
    "translation x",
    "translation y",
    "translation z",
    "rotation x",
    "rotation y",
    "rotation z",
)


@pytest.mark.mpi(2)
@pytest.mark.parametrize("law", clamped_disc.LAWS)
@pytest.mark.parametrize(("element", "nodes", "tolerance"), [("P1", 12, 2.5e-3), ("P2", 8, 1.5e-4)])
def test_clamped_disc_under_pressure_rises_as_it_must_by_every_law(
    comm, law, element, nodes, tolerance
):
    """w0/a and V/a³ at q = pa/(Et) = 0.1, from the axisymmetric equations; nothing wrinkles."""
    result = clamped_disc.problem(comm, law, element, 0.1, nodes)
    height, _, volume = clamped_disc.EXACT[0.1]
    assert result["w0/a"] == pytest.approx(height, rel=tolerance)
    # The volume is less accurate than the height.
    assert result["V/a³"] == pytest.approx(volume, rel=4 * tolerance)
    assert result["residual"] < 1e-8


@pytest.mark.parametrize("law", mylar_balloon.LAWS)
def test_mylar_balloon(comm, law):
    """Thickness and radius of the inflated balloon of two discs, extrapolated to an inextensible
    film (Taylor 1919)."""
    result = mylar_balloon.problem(comm, law, "P1", 1)
    assert result["thickness/a"] == pytest.approx(0.913893, rel=5e-3)
    assert result["R/a"] == pytest.approx(0.762760, rel=5e-3)


def strip(comm, *loads, law=None):
    """A film of 2 m × 1 m whose left edge is held, with loads made by functions of the film."""
    film = gx.Membrane(sheet(comm, 8, 4, 2.0, 1.0), law or gx.Linear(**FILM | {"nu": 0.0}))
    held = gx.Fixed(film, "left")
    return film, held, gx.Scene(film, held, *(load(film) for load in loads))


@pytest.mark.mpi
def test_reaction_work_and_stretch_of_a_pulled_strip(comm):
    """Dead load f along an edge, ν = 0: f = E t λ(λ²-1)/2, reaction -f H, work f H (λ-1) L."""
    λ = 1.02
    L = 2.0
    H = 1.0
    # N/m of Saint Venant-Kirchhoff at the stretch λ.
    f = FILM["E"] * FILM["thickness"] * λ * (λ**2 - 1) / 2
    _, held, scene = strip(comm, lambda film: gx.loads.EdgeLoad(film, "right", force=(f, 0.0, 0.0)))
    equilibrium = Equilibrium(scene)
    found = equilibrium.find()
    x = equilibrium.system.unknowns.q0.array_r.reshape(-1, 3)
    # The strain is constant: exact for any mesh.
    assert comm.allreduce(float(x[:, 0].max()), max) == pytest.approx(λ * L, rel=1e-9)
    force, moment = equilibrium.reaction(held, about=(0.0, 0.0, 0.0))
    np.testing.assert_allclose(force, [-f * H, 0, 0], atol=1e-7 * f)
    np.testing.assert_allclose(moment, [0, 0, f * H * H / 2], atol=1e-7 * f)
    assert found.totals.supplied == pytest.approx(f * H * (λ - 1) * L, rel=1e-9)


def test_increments_follow_a_prescribed_motion(comm):
    """A stretched film of ν = 0: the force on the moved edge at every increment, and its work in
    small ones."""
    film, _, _ = strip(comm)
    pulled = gx.Fixed(
        film,
        "right",
        motion=lambda X, t: np.vstack([t + 0 * X[0], 0 * X[0], 0 * X[0]]),
    )
    equilibrium = Equilibrium(gx.Scene(film, gx.Fixed(film, "left"), pulled))
    # Increments grow, so that the last ones need several iterations.
    for t in (0.01, 0.02, 0.04):
        equilibrium.find(at=t)
        λ = 1 + t / 2
        force, _ = equilibrium.reaction(pulled)
        expected = FILM["E"] * FILM["thickness"] * λ * (λ**2 - 1) / 2
        assert force[0] == pytest.approx(expected, rel=1e-7)


def test_motions_that_nothing_resists_are_named(comm):
    """A film with nothing but its prestress: whole and free."""
    film = gx.Membrane(sheet(comm, 4, 4), gx.Miyazaki(**FILM), displacement=lambda X: 0.01 * X)
    found = Equilibrium(gx.Scene(film)).find()
    assert found.free == RIGID_MOTIONS
    assert not found.regular


@pytest.mark.mpi
@pytest.mark.parametrize("joint", ["weld", "weld of beams", "ball"])
def test_joints_that_bear_forces_turn_with_what_floats(comm, joint):
    """Two booms that a spring draws together: a rotation turns the forces of their joints, too, so
    that nothing resists it."""
    section = gx.sections.tube(0.03, 1e-3, E=100e9, nu=0.3, density=1600.0)
    tips = [(1.0, 0.2, 0.0), (-1.0, 0.3, 0.1)]
    booms = []
    for k, tip in enumerate(tips):
        booms.append(gx.Beam(line(comm, [(0, 0, 0), tip], 2), section, name=f"boom {k}"))
    roots = [boom.frame("start") for boom in booms]
    ends = [boom.port("end") for boom in booms]
    items = [*booms, gx.connectors.Spring(*ends, stiffness=10.0, length=0.5)]
    if joint == "weld":
        hub = gx.RigidBody(100.0, (20.0, 20.0, 20.0), name="hub", comm=comm)
        items.append(hub)
        for k, root in enumerate(roots):
            items.append(gx.constraints.FixedJoint(root, hub.frame(), name=f"root {k}"))
    else:
        # The normal of one beam follows its section by equations, whose forces turn, too.
        items.append(gx.constraints.FixedJoint(*roots))
    if joint == "ball":
        strut = gx.Beam(line(comm, tips, 2), section, name="strut")
        for end, port in zip(("start", "end"), ends, strict=True):
            items.append(gx.constraints.BallJoint(strut.port(end), port, name=end))
    assert Equilibrium(gx.Scene(*items)).find().free == RIGID_MOTIONS


@pytest.mark.mpi
def test_a_load_resists_the_rotations_that_it_stops(comm):
    """A pendulum turns freely about the vertical only, with the force of its joint."""
    bob = gx.RigidBody(2.0, (0.1, 0.1, 0.2), position=(0.0, 0.0, -1.0), name="bob", comm=comm)
    pivot = gx.constraints.BallJoint(bob.port_at((0.0, 0.0, 0.0)), gx.Ground((0.0, 0.0, 0.0)))
    found = Equilibrium(gx.Scene(bob, pivot, gx.Gravity(bob))).find()
    assert found.free == ("rotation z",)


def test_without_an_equilibrium_the_reason_is_given(comm):
    """The search is given up too early."""
    _, _, scene = strip(comm, lambda film: gx.Gravity(film), law=gx.Miyazaki(**FILM))
    with pytest.raises(NoEquilibrium, match=r"unbalanced force is .* of the load.*at the node"):
        Equilibrium(scene, Continuation(total_iterations=5)).find()


@pytest.mark.parametrize(
    ("name", "value"),
    [("tolerance", 0.0), ("first_step", float("nan")), ("growth_factor", 1.0), ("cut_factor", 2.0)],
)
def test_a_search_that_cannot_be_is_refused(name, value):
    with pytest.raises(gx.InputError, match=f"{name} is"):
        Continuation(**{name: value})


def test_work_of_a_moved_edge_closes_the_ledger_in_time(comm):
    """A film shaken at one edge: energy = what the motion supplied, to round-off, and it is not
    nothing."""
    film = gx.Membrane(sheet(comm, 4, 4), gx.Miyazaki(**FILM))

    def shake(X, t):
        return np.vstack([0 * X[0], 0 * X[0], 0.1 * np.sin(50 * t) ** 2 + 0 * X[0]])

    run = run_until(0.03, film, gx.Fixed(film, "left", motion=shake), dt=1e-3)
    # The shaken edge has done work.
    assert run.totals.supplied > 1e-3
    assert abs(run.energy_error) < 1e-9


@pytest.mark.parametrize(
    ("cells", "iterations"),
    [(8, 100), (16, 150), pytest.param(32, 500, marks=pytest.mark.slow)],
)
@pytest.mark.parametrize("law", ["Miyazaki 1e-6", "Miyazaki 1e-8"])
def test_square_airbag_comes_to_rest_in_few_iterations(comm, law, cells, iterations):
    # Limits of iterations: measured ones, with a third more.
    """Quarter of one sheet from its flat, stress-free state under 5 kPa at once, against converged
    references."""
    result = airbag.problem(comm, law, "P1", cells)
    assert result["iterations"] <= iterations
    assert result["residual"] < 1e-8
    # References of a converged mesh, with the spread that is known of them.
    assert result["w_M"] == pytest.approx(0.2164, rel=5e-3)
    assert result["V"] == pytest.approx(0.1250, rel=5e-3)
    assert result["σ1_M"] == pytest.approx(3.92e6, rel=4e-2)
    assert result["u_A"] == pytest.approx(0.0494, rel=2e-2)


@pytest.mark.mpi(1)
@pytest.mark.parametrize(
    ("cells", "exact"),
    [(8, (0.216181, 0.049403, 0.124409, 3.9816e6)), (16, (0.216516, 0.049328, 0.124843, 3.8886e6))],
)
def test_square_airbag_on_a_mesh_that_others_have_solved_on(comm, cells, exact):
    """The same discrete problem, so the same digits: constant strains, u = 1e-6, cells of four
    triangles."""
    result = airbag.problem(comm, "Miyazaki 1e-6", "P1", cells)
    measured = [result[name] for name in ("w_M", "u_A", "V", "σ1_M")]
    # Published with five or six digits by others on the same mesh.
    assert measured == pytest.approx(exact, rel=1.5e-5)
