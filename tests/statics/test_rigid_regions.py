"""Edges, hubs and end plates under a given total force and moment: the motion is found, at rest and
in time."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from demos.studies import bent_tube
from gossamer_fx.mechanics.bodies.rigid_body import fitted
from gossamer_fx.meshes.disc import ring
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.meshes.tube_section import cylinder
from tests.small_scenes import at_rest, run_until

# Pa, m and kg/m³.
E = 1e9
THICKNESS = 1e-4
DENSITY = 1000.0
TUBE = gx.sections.tube(0.02, 5e-4, E=1e11, nu=0.3, density=1560.0)


def strip(comm, nu=0.0, order=2, cells=(8, 4)):
    film = gx.Membrane(
        sheet(comm, *cells, 2.0, 1.0),
        gx.Linear(E, nu, density=DENSITY, thickness=THICKNESS),
        order=order,
    )
    return film, gx.Fixed(film, "film", components=(2,))


@pytest.mark.parametrize("sliding", [False, True])
def test_a_strip_is_pulled_by_the_force_on_its_straight_edge(comm, sliding):
    """f = E t λ ε; with ν and an edge that may shrink evenly, the strip shrinks by √(1 - 2νε)."""
    nu = 0.3 if sliding else 0.0
    film, flat = strip(comm, nu)
    edge = gx.RigidRegion(film, "right", sliding=sliding, fixed_components=(2,))
    λ = 1.02
    ε = (λ**2 - 1) / 2
    left = gx.Fixed(film, "left", components=(0,) if sliding else (0, 1, 2))
    held = [left, gx.Fixed(film, "bottom", components=(1,))] if sliding else [left]
    pull = gx.loads.Force(edge.port(), (E * THICKNESS * λ * ε, 0.0, 0.0))
    equilibrium = at_rest(flat, edge, pull, *held)
    assert gx.probes.Position(edge.port(), "x")(equilibrium) == pytest.approx(2 * λ, rel=1e-9)
    measured = gx.probes.Position(edge.port(), "y")(equilibrium)
    # Half the width of 1 m, shrunk.
    assert measured == pytest.approx(math.sqrt(1 - 2 * nu * ε) / 2, rel=1e-9)
    measured = equilibrium.joint_force(edge)[0]
    assert measured == pytest.approx([-E * THICKNESS * λ * ε, 0, 0], rel=1e-7, abs=1e-3)


def test_a_strip_is_bent_by_the_moment_on_its_straight_edge(comm):
    """θ = M L/(E I) of small bending in the plane."""
    film, flat = strip(comm)
    edge = gx.RigidRegion(film, "right", fixed_components=(2,))
    θ = 1e-5
    # I = t H³/12 with H = 1 m.
    inertia = THICKNESS / 12
    # M = E I θ/L with L = 2 m.
    moment = gx.loads.Torque(edge.line, (0.0, 0.0, θ * E * inertia / 2.0))
    equilibrium = at_rest(flat, gx.Fixed(film, "left"), edge, moment)
    corners = [
        gx.probes.Displacement(film.port(f"{side} right"), "x")(equilibrium)
        for side in ("bottom", "top")
    ]
    # Displacement of the end by θ L/2 = θ.
    assert corners[0] - corners[1] == pytest.approx(θ, rel=1e-4)
    assert gx.probes.Displacement(edge.port(), "y")(equilibrium) == pytest.approx(θ, rel=1e-4)


@pytest.mark.mpi(1)
@pytest.mark.parametrize("piece", ["massless", "rigid body"])
def test_a_hub_turns_by_the_torque_on_it(comm, piece):
    """φ = T/(4π G t) (1/a² - 1/b²) of a ring in shear."""
    film = gx.Membrane(
        ring(comm, 0.3, 1.0, 8, 32, 2),
        gx.Linear(E, 0.3, density=DENSITY, thickness=THICKNESS),
        order=2,
    )
    hub = gx.RigidBody(1.0, (0.1, 0.1, 0.2), name="hub") if piece == "rigid body" else None
    region = gx.RigidRegion(film, "hub", rigid_body=hub, fixed_components=(2,))
    # G = E/2(1 + ν) with ν = 0.3.
    G = E / 2.6
    T = 0.5
    load = gx.loads.Torque(region.frame, (0.0, 0.0, T))
    equilibrium = at_rest(
        gx.Fixed(film, "film", components=(2,)), gx.Fixed(film, "rim"), region, load
    )
    d = [gx.probes.Displacement(region.frame.directors[0], axis)(equilibrium) for axis in "xy"]
    exact = T / (4 * math.pi * G * THICKNESS) * (1 / 0.3**2 - 1)
    # Eight quadratic rings.
    assert math.hypot(*d) == pytest.approx(exact, rel=1e-3)


def test_a_wrinkled_hub_needs_no_secant(comm):
    """The torque that is given is that of a hub which is turned by the angle that was found."""
    law = gx.Miyazaki(E, 0.3, density=DENSITY, thickness=THICKNESS, residual_stiffness=1e-4)

    def film():
        return gx.Membrane(ring(comm, 0.3, 1.0, 6, 24), law)

    loaded = film()
    turned = film()
    T = 500.0
    region = gx.RigidRegion(loaded, "hub", fixed_components=(2,))
    found = at_rest(
        gx.Fixed(loaded, "film", components=(2,)),
        gx.Fixed(loaded, "rim"),
        region,
        gx.loads.Torque(region.frame, (0, 0, T)),
    )
    p = region.frame.directors[0]
    x, y = (gx.probes.Displacement(p, axis)(found) for axis in "xy")
    # Angle from the chord of a unit director.
    φ = 2 * math.asin(math.hypot(x, y) / 2)
    c = math.cos(φ)
    s = math.sin(φ)
    turn = gx.Fixed(
        turned,
        "hub",
        motion=lambda X, t: np.vstack(
            [(c - 1) * X[0] - s * X[1], s * X[0] + (c - 1) * X[1], 0 * X[0]]
        ),
        components=(0, 1),
    )
    check = at_rest(gx.Fixed(turned, "film", components=(2,)), gx.Fixed(turned, "rim"), turn)
    # The film is wrinkled over most of its area.
    assert φ > 0.01 and gx.probes.AreaFraction(loaded, "wrinkled")(found) > 0.5
    assert check.reaction(turn)[1][2] == pytest.approx(T, rel=1e-6)


@pytest.mark.mpi(1)
@pytest.mark.parametrize("ratio", [0.5, 2.0])
def test_an_inflated_tube_bends_under_the_moment_on_its_end_plate(comm, ratio):
    """κ of Stein & Hedgepeth for the moment given, before and after the first wrinkle; the plate
    does not choke."""
    tube = bent_tube
    film = gx.Membrane(cylinder(comm, tube.RADIUS, tube.LENGTH, 16, 3, 2), tube.LAW, order=2)
    plate = gx.RigidRegion(film, "last rim", sliding=True)
    # Axial force of the pressure on the closed end.
    axial = tube.P * math.pi * tube.INFLATED**2
    M = tube.moment(ratio)
    held = [
        gx.Fixed(film, "first rim", components=(0,)),
        *(gx.Fixed(film, side, components=(1,)) for side in ("top", "bottom")),
    ]
    held += [gx.Fixed(film, point, components=(2,)) for point in ("first left", "first right")]
    loads = (
        gx.loads.Force(plate.port(), (axial, 0.0, 0.0)),
        gx.loads.Torque(plate.frame, (0.0, M, 0.0)),
    )
    equilibrium = at_rest(film, gx.Pressure(film, tube.P), plate, *held, *loads)
    n = [gx.probes.Displacement(plate.frame.directors[2], axis)(equilibrium) for axis in "xz"]
    κ = math.asin(math.hypot(*n) / 2) * 2 / tube.LENGTH
    # 1 %, as in the test of the bent tube.
    assert κ == pytest.approx(ratio * tube.FIRST, rel=1e-2)


def test_a_beam_is_bent_into_an_arc_by_the_torque_on_its_end(comm):
    """A half circle, M = π EI/L, reached in steps."""
    thin = gx.sections.tube(0.002, 5e-5, E=1e11, nu=0.3, density=1560.0)
    beam = gx.Beam(line(comm, [(0, 0, 0), (1, 0, 0)], 16), thin)
    torque = gx.loads.Torque(beam.frame("end"), lambda t: (0.0, 0.0, t * math.pi * thin.EI2))
    equilibrium = gx.Equilibrium(gx.Scene(gx.Fixed(beam, "start", rotation=True), torque))
    for t in (0.25, 0.5, 0.75, 1.0):
        equilibrium.find(at=t)
    x, y = (gx.probes.Position(beam.port("end"), axis)(equilibrium) for axis in "xy")
    # A half circle of length 1 has its end at (0, 2/π).
    expected = (pytest.approx(0.0, abs=2e-3), pytest.approx(2 / math.pi, rel=2e-3))
    assert (x, y) == expected


@pytest.mark.mpi(1)
@pytest.mark.parametrize("kind", ["straight", "stretching", "hub", "sliding", "body"])
def test_momenta_of_a_free_film_grow_by_force_and_torque(comm, kind):
    """Nothing is held: momentum F t, angular momentum T t about the origin, and the ledger
    closes."""
    law = gx.Linear(E, 0.3, density=DENSITY, thickness=THICKNESS)
    hub = gx.RigidBody(0.1, (1e-3, 1e-3, 1e-3), name="hub") if kind == "body" else None
    if kind in ("straight", "stretching"):
        film = gx.Membrane(sheet(comm, 4, 2, 2.0, 1.0), law)
        region = gx.RigidRegion(film, "right", sliding=kind == "stretching")
        frame = region.line
    else:
        film = gx.Membrane(ring(comm, 0.3, 1.0, 3, 12), law)
        region = gx.RigidRegion(film, "hub", rigid_body=hub, sliding=kind == "sliding")
        frame = region.frame
    T = np.array([0.0, 0.0, 0.2])
    motion = gx.RigidMotion(spin=(0.0, 0.0, 3.0), velocity=(1.0, 0.0, 0.0))
    run = run_until(0.05, film, region, gx.loads.Torque(frame, tuple(T)), motion, dt=1e-3)
    first = run.first
    last = run.totals
    # No force acts; the torque grows the angular momentum.
    assert last.momentum == pytest.approx(first.momentum, abs=1e-10)
    grown = last.angular_momentum - first.angular_momentum
    assert grown == pytest.approx(0.05 * T, abs=1e-9)
    assert abs(run.energy_error) < 1e-10
    assert last.supplied > 0


@pytest.mark.parametrize("directors", [1, 2])
def test_slanted_lines_and_planes_have_as_many_directors_as_dimensions(directors):
    """Round-off gives them an extent across, of 1e-8 of that along them."""
    random = np.random.default_rng(1)
    for _ in range(100):
        along = random.uniform(-1, 1, (20, directors)) @ random.normal(size=(directors, 3))
        x = random.normal(size=3) + along
        frame, _, coordinates = fitted(MPI.COMM_SELF, x, np.zeros_like(x))
        assert len(frame) == 1 + directors
        np.testing.assert_allclose(frame[0] + coordinates @ frame[1:], x, atol=1e-13)


def test_what_cannot_be_one_piece_is_refused(comm):
    film = gx.Membrane(sheet(comm, 2, 2), gx.Linear(E, 0.3, density=DENSITY, thickness=THICKNESS))
    beam = gx.Beam(line(comm, [(0, 0, 0), (1, 0, 0)], 2), TUBE)
    body = gx.RigidBody(1.0, (1.0, 1.0, 1.0))
    straight = gx.RigidRegion(film, "right")
    plane = gx.RigidRegion(film, "film")
    for act, words in (
        (lambda: gx.RigidRegion(beam, "end"), "whose sections are rigid by themselves"),
        (lambda: gx.RigidRegion(film, "bottom left"), "one point"),
        (lambda: gx.RigidRegion(film, "nowhere"), "nowhere"),
        (
            lambda: gx.RigidRegion(film, "right", rigid_body=body, sliding=True),
            "sliding and rigid_body are both given",
        ),
        (lambda: straight.frame, "apply torques to its line"),
        (lambda: plane.line, "apply torques to its frame"),
        (lambda: gx.constraints.FixedJoint(straight.line, body.frame()), "give a Frame"),
    ):
        with pytest.raises(gx.InputError, match=words):
            act()


@pytest.mark.mpi
def test_a_region_follows_the_fold_map(comm: MPI.Comm) -> None:
    """The piece of the free end of a zigzag is at its nodes; a scene that starts from another one
    has it there without the map.  A group across the fold is refused."""
    folds = gx.fold.Zigzag(length=1.0, panels=3, angle=1.0)
    mesh = folds.mark(sheet(comm, 6, 2, 1.0, 0.5))
    film = gx.Membrane(mesh, gx.Linear(E=1e9, nu=0.3, density=1e3, thickness=1e-4))
    for sliding in (False, True):
        end = gx.RigidRegion(film, "right", sliding=sliding)
        folded = gx.Scene(film, end, folds.start(film)).compile()
        for scene in (folded, gx.Scene(film, end, gx.StartFrom(folded)).compile()):
            assert scene.unknowns.state.vector(end.port())[0] == pytest.approx(
                np.cos(1.0), rel=1e-12
            )
    hub = gx.RigidBody(1.0, (1.0, 1.0, 1.0), comm=comm, name="hub")
    for region, message in (
        (gx.RigidRegion(film, "top"), "is folded at the start"),
        (gx.RigidRegion(film, "right", rigid_body=hub), "use those of 'hub'"),
    ):
        region.port()
        with pytest.raises(gx.InputError, match=message):
            gx.Scene(film, region, folds.start(film)).compile()
