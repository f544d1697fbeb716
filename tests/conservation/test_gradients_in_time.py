"""Gradients through conserving steps: energy taken back to the start, remainders, products of both
modes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc

import gossamer_fx as gx
from demos.studies.crease import folded
from demos.studies.thrown_crease import thrown
from gossamer_fx.analysis.sensitivity.transient import TransientGradients
from gossamer_fx.analysis.sensitivity.variables import AdjointFields, Variable, find_variables
from gossamer_fx.extend import ForceOfStart, Item, PointForce, PointLoad
from meshes.creased_strip import creased_strip
from meshes.line import line
from meshes.sheet import sheet
from tests.rates import observed_order

# Derivatives are compared to 1e-9 and better, so each step is solved beyond that.
SOLVED = gx.Tolerances(relative=1e-13)
FILM = {"E": 1e9, "nu": 0.3, "density": 1400.0, "thickness": 1e-4}
SOFT = {"E": 1e7, "nu": 0.3, "density": 1400.0, "thickness": 1e-4}


def waves(X):
    return np.vstack([np.cos(2 * X[1]), np.sin(X[0]), 3 * np.sin(3 * X[0]) * np.cos(2 * X[1])])


def stretched(X):
    return 5e-3 * X


def film(law, comm: MPI.Intracomm, **more) -> gx.Membrane:
    return gx.Membrane(sheet(comm, 4, 4), law, velocity=waves, **more)


def taut(comm):
    body = film(gx.Linear(**FILM), comm, displacement=stretched)
    return gx.Scene(body), 1e-4, 30


def wrinkling(comm):
    law = gx.Miyazaki(**FILM, residual_stiffness=1e-2)
    return gx.Scene(film(law, comm, displacement=stretched)), 1e-3, 30


def on_floor(comm):
    body = gx.Membrane(
        # 1.5 activation distances above the floor: contact begins within a few steps.
        sheet(comm, 4, 4, 0.2, 0.2),
        gx.Linear(**SOFT),
        displacement=lambda X: 0 * X + np.array([[0], [0], [1.5e-3]]),
        velocity=lambda X: np.vstack([0.5 + 0 * X[0], 3 * X[0], -2 + X[1]]),
    )
    floor = gx.contact.Plane(point=(0, 0, 0), normal=(0, 0, 1))
    return gx.Scene(gx.Contact(body, floor, distance=1e-3, stiffness=5e6)), 5e-5, 60


def colliding(comm, steps=60, **contact):
    """Two films, the upper one inclined, meet at their points, edges and faces, and separate."""
    lower = gx.Membrane(sheet(comm, 4, 4, 0.2, 0.2), gx.Linear(**SOFT), name="lower")

    def above(X):
        # Offsets that no symmetry of the two meshes repeats.
        return np.vstack([0.011 + 0 * X[0], 0.013 + 0 * X[0], 1.5e-3 + 0.01 * X[0]])

    upper = gx.Membrane(
        sheet(comm, 5, 5, 0.2, 0.2),
        gx.Linear(**SOFT),
        displacement=above,
        velocity=lambda X: np.vstack([0.5 + 0 * X[0], 3 * X[0], -2 + X[1]]),
    )
    given = {"stiffness": 6e6} | contact
    return gx.Scene(gx.Contact(lower, upper, distance=1e-3, **given)), 5e-5, steps


def touching(comm):
    """The same films, at a time at which they touch."""
    return colliding(comm, steps=24)


def stopping(comm):
    """The colliding films, at a time at which they touch, with a stiffness that stops them."""
    return colliding(comm, steps=25, stiffness=None)


def rubbing_while_stopping(comm):
    """The same with friction, which is proportional to that stiffness."""
    return colliding(comm, steps=20, stiffness=None, friction=0.4, slip_velocity=0.05)


def rubbing(comm):
    """The colliding films with friction, at a time at which they touch."""
    return colliding(comm, steps=24, friction=0.4, slip_velocity=0.05)


def rubbing_while_stopping_fast(comm):
    """A film that turns and meets another one in the first step, faster than the least speed by
    which the stiffness is chosen."""
    lower = gx.Membrane(sheet(comm, 4, 4, 0.2, 0.2), gx.Linear(**SOFT), name="lower")
    upper = gx.Membrane(
        sheet(comm, 5, 5, 0.2, 0.2),
        gx.Linear(**SOFT),
        displacement=lambda X: np.vstack(
            [0.011 + 0 * X[0], 0.013 + 0 * X[0], 1.15e-3 + 0.005 * X[0]]
        ),
        velocity=lambda X: np.vstack([0.5 + 0 * X[0], 3 * X[0], X[1] - 10 - 200 * X[0]]),
    )
    contact = gx.Contact(lower, upper, distance=1e-3, friction=0.4, slip_velocity=0.05)
    return gx.Scene(contact), 5e-5, 4


# Contact of a film with a body that rubs.
RUBS = {"distance": 1e-3, "stiffness": 5e6, "friction": 0.3, "slip_velocity": 0.05}


def rubbing_on_floor(comm):
    """A film that slides, tilts and turns on a plane that rubs."""
    body = gx.Membrane(
        sheet(comm, 4, 4, 0.2, 0.2),
        gx.Linear(**SOFT),
        displacement=lambda X: 0 * X + np.array([[0], [0], [0.95e-3]]),
        velocity=lambda X: np.vstack([0.5 + X[1], 3 * X[0], -1 + X[1]]),
    )
    floor = gx.contact.Plane(point=(0, 0, 0), normal=(0, 0, 1))
    return gx.Scene(gx.Contact(body, floor, **RUBS)), 5e-5, 24


def rubbing_on_a_body(comm, kind, **shape):
    """A film that falls on a rigid body with an obstacle, which it sets in rotation."""
    top = gx.RigidBody(
        0.02, (1e-5, 1.2e-5, 1.5e-5), position=(0.1, 0.1, -0.0505), name="a", comm=comm
    )
    body = gx.Membrane(
        sheet(comm, 5, 5, 0.2, 0.2),
        gx.Linear(**SOFT),
        velocity=lambda X: np.vstack([0.5 + X[1], 3 * X[0], -1 + X[1]]),
    )
    return gx.Scene(gx.Contact(body, kind(body=top, **shape), **RUBS)), 5e-5, 24


def rubbing_on_a_ball(comm):
    return rubbing_on_a_body(comm, gx.contact.Sphere, centre=(0.1, 0.1, -0.0505), radius=0.05)


def rubbing_on_a_cone(comm):
    """The film falls on the tip of the cone."""
    ends = {"start": (0.1, 0.1, -0.06), "end": (0.11, 0.1, -0.0038)}
    return rubbing_on_a_body(comm, gx.contact.Cone, radii=(0.04, 0.006), **ends)


def rubbing_in_a_funnel(comm):
    """A film whose corners slide on the mantle of a funnel."""
    scene, h, steps = rubbing_on_floor(comm)
    given = next(item for item in scene.items if isinstance(item, gx.Contact))
    # The circle through the corners of the film is 0.9 activation distances from the mantle.
    funnel = gx.contact.Cone(
        start=(0.1, 0.1, -0.2), end=(0.1, 0.1, 0.0), radii=(0.0, 0.14195), inside=True
    )
    return gx.Scene(gx.Contact(*given.bodies, funnel, **RUBS)), h, steps


def hinged(comm):
    """Two rigid bodies on a hinge with a spring, and a cable that hangs on one of them."""
    axis = (0.0, 0.0, 1.0)
    V = (0.3, 0.5, 0.0)
    a = gx.RigidBody(1.0, (0.6, 1.1, 1.5), name="a", velocity=V, spin=(0.0, 0.0, 1.0))
    b = gx.RigidBody(1.0, (0.5, 0.9, 1.2), name="b", velocity=V, spin=(0.0, 0.0, -2.0))
    cable = gx.Cable(
        line(comm, [(0, 0, 0), (1, 0, 0)], 6),
        gx.CableLaw(500.0, 0.05),
        velocity=lambda X: X[0] * waves(X) + np.array(V)[:, None],
    )
    sides = (a.frame(), b.frame())
    scene = gx.Scene(
        gx.constraints.RevoluteJoint(*sides, axis=axis),
        gx.connectors.TorsionSpring(*sides, axis=axis, stiffness=3.0, rest_angle=0.5),
        gx.constraints.BallJoint(cable.port("start"), a.port((0.0, 0.0, 0.0))),
    )
    return scene, 1e-2, 30


def folded_strip(comm):
    """A strip of two panels, folded at their hinge and thrown."""
    return gx.Plate(
        creased_strip(comm, 4, 2, 0.05, 0.02),
        gx.Linear(E=2.5e9, nu=0.3, density=1400.0, thickness=50e-6),
        hinges=["crease"],
        displacement=folded(math.radians(80)),
        velocity=lambda X: thrown(1.0, X),
    )


def creased(comm):
    plate = folded_strip(comm)
    return gx.Scene(gx.connectors.Crease(plate, "crease", stiffness=2e-3)), 2e-4, 20


def yielding(comm):
    """The thrown strip with a fold that yields at a small angle."""
    plate = folded_strip(comm)
    crease = gx.connectors.Crease(
        plate, "crease", stiffness=4e-3, rest_angle=math.radians(80), yield_angle=0.003
    )
    return gx.Scene(crease), 2e-4, 20


def bent(comm):
    """A thick arc that its spin opens, and a rope that is linear in its stretch, at its end."""
    spin = np.array([2.0, 8.0, 5.0])

    def turning(X):
        return np.cross(spin, X.T).T

    angles = np.linspace(0, np.pi / 2, 5)
    arc = np.column_stack([np.sin(angles), 0 * angles, 1 - np.cos(angles)])
    section = gx.sections.rectangle(0.2, 0.1, E=1e6, nu=0.3, density=1000.0)
    beam = gx.Beam(line(comm, arc.tolist(), 1), section, normal=(0, 1, 0), velocity=turning)
    rope = gx.Cable(
        line(comm, [(1, 0, 1), (2, 0, 1)], 4),
        gx.CableLaw(500.0, 0.5, strain="engineering"),
        initial_tension=20.0,
        velocity=lambda X: turning(X) + (X[0] - 1) * waves(X),
        name="rope",
    )
    return gx.Scene(gx.constraints.BallJoint(beam.port("end"), rope.port("start"))), 5e-3, 20


# Largest deviation of the carried gradient, over its largest entry.  A film that wrinkles amplifies
# round-off wherever it changes its state.
CONSERVING = {
    taut: 1e-10,
    colliding: 1e-9,
    hinged: 1e-10,
    creased: 1e-9,
    wrinkling: 1e-6,
    on_floor: 1e-10,
    touching: 1e-9,
    stopping: 1e-9,
    bent: 1e-9,
}


def recorded(scene: gx.Scene, h: float, steps: int) -> tuple[gx.Simulation, gx.analysis.RunTape]:
    run = gx.Simulation(scene, gx.Midpoint(dt=h, tolerances=SOLVED))
    tape = gx.analysis.RunTape(run)
    run.run(until=steps * h)
    assert len(tape.states) == steps + 1
    return run, tape


def momenta_at_start(tape: gx.analysis.RunTape, run: gx.Simulation) -> tuple[PETSc.Vec, PETSc.Vec]:
    """v0 of a tape, and M v0, the exact derivative of an energy that is conserved by v0."""
    velocity = run.system.unknowns.numbering.vector()
    velocity.array[:] = tape.states[0].v
    momenta = velocity.duplicate()
    run.system.unknowns.M.mult(velocity, momenta)
    return velocity, momenta


@pytest.mark.mpi(3)
@pytest.mark.parametrize("make", CONSERVING, ids=lambda make: make.__name__)
def test_the_gradient_of_the_last_energy_is_that_of_the_first(comm, make):
    """Energy is conserved from every start, so E(T) and E(0) are one function of the start: dE/dv0
    = M v0.

    Directors and points of joints move on a manifold only; there the gradient is compared along
    motions that the constraints allow, of which the start is one.
    """
    run, tape = recorded(*make(comm))
    system = run.system
    if make in (touching, stopping):
        assert run.totals.stored["contact"] > 1e-3 * run.totals.size
    energy = gx.analysis.Energy()
    names = [f"{body.name}.initial_velocity" for body in system.unknowns.bodies]
    found = gx.analysis.gradient(tape, of=energy, by=names)
    velocity, momenta = momenta_at_start(tape, run)
    exact = momenta.array_r
    largest = comm.allreduce(np.abs(exact).max(initial=0.0), op=MPI.MAX)
    work = 0.0
    for body, derivative in zip(system.unknowns.bodies, found, strict=True):
        owned = system.unknowns.block(body).owned
        work += float(derivative.values @ velocity.array_r[owned])
        if not system.equations.constraints:
            error = np.abs(derivative.values - exact[owned]).max(initial=0.0)
            assert error < CONSERVING[make] * largest, body.name
    work = comm.allreduce(work)
    assert work == pytest.approx(float(momenta.dot(velocity)), rel=CONSERVING[make])
    # The backward pass leaves the run where it was.
    assert energy(run) == found.value
    assert np.array_equal(system.unknowns.q0.array_r, tape.states[-1].q)


# ---- parameters ----------------------------------------------------------------------------------


def steered(comm, period=0.0):
    """A rigid body that torques turn to an attitude; a spring pulls at a point next to its
    centre."""
    hub = gx.RigidBody(1.0, (0.6, 1.1, 1.5), name="a", spin=(0.3, -0.5, 1.0), comm=comm)
    control = gx.control.AttitudeControl(
        hub.frame(),
        (0.4, -0.3, 0.5),
        stiffness=(20.0, 25.0, 30.0),
        damping=(0.5, 0.7, 1.0),
        period=period,
    )
    arm = hub.port((0.5, 0.2, 0.1))
    spring = gx.connectors.Spring(arm, gx.Ground((1.0, 1.0, 1.0)), stiffness=50.0, length=0.4)
    return gx.Scene(control, spring), 1e-2, 20


def sampled(comm):
    """The same body, with torques that are computed in every third step and held in between."""
    return steered(comm, period=0.03)


def held_patch(comm):
    """A film, of which torques hold the attitude of a patch."""
    sail = film(gx.Linear(**FILM), comm, displacement=stretched)
    corners = [sail.port_at((0.75, 0.5, 0.0)), sail.port_at((0.5, 0.75, 0.0))]
    frame = gx.control.patch(sail.port_at((0.5, 0.5, 0.0)), corners)
    control = gx.control.AttitudeControl(
        frame, (0.1, 0.0, 0.05), stiffness=0.5, damping=1e-3, name="hold"
    )
    return gx.Scene(control), 5e-4, 20


def film_corner(body: gx.Membrane):
    return body.port_at((1.0, 1.0, 0.0))


def prestressed(comm):
    """A film and a cable with initial stresses that are free to vibrate by them."""
    tensor = np.diag([3e5, 2e5, 0.0])
    body = film(gx.Miyazaki(**FILM, residual_stiffness=1e-2), comm, initial_stress=tensor)
    cable = gx.Cable(
        line(comm, [(0, 0, 0), (1, 0, 0)], 6),
        gx.CableLaw(500.0, 0.05),
        initial_tension=2.0,
        velocity=waves,
    )
    strip = gx.Membrane(
        sheet(comm, 2, 2), gx.Linear(**FILM), initial_strain=1e-4, velocity=waves, name="strip"
    )
    return gx.Scene(body, cable, strip), 2e-4, 15


def damped(comm):
    body = film(
        gx.Linear(**FILM),
        comm,
        displacement=stretched,
        properties={"thickness": lambda x: 1e-4 * (1 + 0.2 * np.sin(3 * x[0]))},
    )
    scene = gx.Scene(
        gx.Damping(body, mass_factor=30.0, stiffness_factor=1e-6),
        gx.Pressure(body, 40.0),
        gx.Pressure(body, lambda t: 50 * math.cos(300 * t), name="pulse"),
        gx.loads.Force(film_corner(body), lambda t: (0.1, 0.2 * t, 0.3), name="pull"),
        gx.Gravity(body),
        gx.Fixed(body, "left"),
    )
    return scene, 5e-4, 20


def damped_in_tension(comm):
    """A film that wrinkles, with a damping that follows its state at the start of each step."""
    law = gx.Miyazaki(**FILM, residual_stiffness=1e-2)
    body = film(law, comm, displacement=stretched)
    damping = gx.Damping(body, stiffness_factor=1e-5, tension_only=True)
    return gx.Scene(damping), 5e-4, 12


def roped(comm):
    a = gx.PointMass(0.5, (1.0, 0.0, 0.0), velocity=(0.3, 1.2, 0.1), name="a")
    b = gx.PointMass(0.7, (0.0, 1.0, 0.0), velocity=(0.0, 0.4, 0.5), name="b")
    centre = gx.Ground((0.0, 0.0, 0.0))
    scene = gx.Scene(
        gx.connectors.Spring(a.port(), b.port(), stiffness=400.0, length=1.2),
        gx.connectors.Rope(centre, a.port(), length=0.95, stiffness=400.0, damping=4.0),
        gx.connectors.Damper(b.port(), centre, damping=2.0),
        gx.loads.Force(b.port(), (0.2, 0.1, -1.0)),
    )
    return scene, 1e-2, 12


def bundled(comm):
    """A mass on three ropes, of which some get slack."""
    mass = gx.PointMass(0.5, (0.0, 0.0, 0.0), velocity=(0.6, -0.4, 0.5), name="a")
    ends = [gx.Ground(at) for at in ((1.0, 0.0, 0.0), (-0.6, 0.8, 0.0), (-0.6, -0.8, 0.3))]
    bundle = gx.connectors.RopeBundle(
        [(mass.port(), end) for end in ends],
        lengths=[0.97, 0.98, 1.02],
        stiffness=300.0,
        damping=3.0,
    )
    return gx.Scene(bundle), 1e-2, 12


def heated(comm, slope=1.0):
    """A film whose temperature rises in time and differs from point to point."""
    warming = gx.materials.ThermalExpansion(
        2e-5, temperature=lambda X, t: 300.0 + 2e4 * t * (1 + slope * X[0])
    )
    body = film(gx.Linear(**FILM), comm, displacement=stretched, thermal=warming)
    return gx.Scene(body, gx.Fixed(body, "left")), 5e-4, 15


def warmed(comm):
    """A film that is warmed evenly: no temperature moves with the nodes of its mesh."""
    return heated(comm, slope=0.0)


def blown(comm):
    """A film in wind, which edge loads pull: one of given direction, one along its rim's normal."""
    body = film(gx.Linear(**FILM), comm, displacement=stretched)
    return (
        gx.Scene(
            gx.loads.AirDrag(body, 1.2, wind=(0.0, 0.5, 3.0)),
            gx.loads.EdgeLoad(body, "right", force=(30.0, 5.0, 10.0), name="pull"),
            gx.loads.EdgeLoad(body, "top", normal_force=20.0, following=True, name="stretch"),
            gx.Fixed(body, "left"),
        ),
        5e-4,
        15,
    )


PARAMETERS = {
    damped: (
        "film.E, film.nu, film.density, film.thickness, film.shape, damping.mass_factor, "
        "damping.stiffness_factor, pressure.pressure, pulse.factor, pull.factor, "
        "gravity of film.g, film.initial_velocity, film.initial_position"
    ),
    roped: (
        "spring.stiffness, spring.length, rope.stiffness, rope.length, rope.damping, "
        "damper.damping, force.force, a.initial_velocity"
    ),
    hinged: (
        "torsion spring.stiffness, torsion spring.rest_angle_change, cable.EA, a.velocity, a.spin"
    ),
    bent: "rope.EA, rope.initial_tension, rope.initial_velocity",
    steered: "attitude control.stiffness, attitude control.damping, a.spin",
    sampled: "attitude control.stiffness, attitude control.damping, spring.length, a.spin",
    held_patch: "hold.stiffness, hold.damping",
    prestressed: "film.initial_stress, cable.initial_tension, strip.initial_strain",
    creased: "crease.stiffness, crease.rest_angle, plate.thickness, plate.E",
    yielding: "crease.stiffness, crease.rest_angle, plate.thickness",
    wrinkling: "film.E, film.residual_stiffness",
    damped_in_tension: "film.E, damping.stiffness_factor, film.initial_velocity",
    bundled: "ropes.stiffness, ropes.lengths, ropes.damping",
    heated: "film.alpha, film.reference_temperature, film.initial_velocity",
    warmed: "film.shape",
    blown: "pull.force, stretch.normal_force, film.density, film.shape",
    colliding: "film.E, film.thickness, film.initial_velocity",
    touching: "contact.stiffness",
    stopping: "film.E, film.density, lower.thickness, film.initial_velocity",
    rubbing_while_stopping: (
        "contact.friction, film.thickness, film.initial_velocity, film.initial_position"
    ),
    rubbing_while_stopping_fast: "film.initial_velocity, film.initial_position",
    rubbing_on_floor: "contact.friction, contact.stiffness, film.E, film.initial_velocity",
    rubbing: "contact.friction, contact.stiffness, film.thickness, film.initial_velocity",
    rubbing_on_a_ball: "contact.friction, a.velocity, a.spin, film.initial_velocity",
    rubbing_on_a_cone: "contact.friction, contact.stiffness, a.spin, film.initial_velocity",
    rubbing_in_a_funnel: "contact.friction, contact.stiffness, film.initial_velocity",
}
CASES = [(make, name) for make, names in PARAMETERS.items() for name in names.split(", ")]
# On several ranks, one of each kind: the shape, with joints, with friction in contact, and with
# history.
CASES_ON_RANKS = [
    (damped, "film.shape"),
    (hinged, "torsion spring.stiffness"),
    (rubbing, "contact.friction"),
    (yielding, "crease.stiffness"),
]
CASES.sort(key=lambda case: case not in CASES_ON_RANKS)


def test_steps_of_controlled_length_are_frozen(comm):
    """The gradient is that of the steps that were made, whatever their lengths: E(T) is still
    E(0)."""
    scene, h, steps = taut(comm)
    control = gx.StepControl(target_iterations=3, error=1e-7, max_factor=1.5)
    run = gx.Simulation(scene, gx.Midpoint(dt=h, tolerances=SOLVED), control=control)
    tape = gx.analysis.RunTape(run)
    run.run(until=steps * h)
    lengths = {node.h for node in tape.states[1:]}
    assert len(lengths) > 3
    found = gx.analysis.gradient(tape, of=gx.analysis.Energy(), by=["film.initial_velocity"])
    _, momenta = momenta_at_start(tape, run)
    largest = comm.allreduce(np.abs(momenta.array_r).max(initial=0.0), op=MPI.MAX)
    error = np.abs(found["film.initial_velocity"].values - momenta.array_r).max(initial=0.0)
    assert error < CONSERVING[taut] * largest


def fresh(make, names: list[str]) -> tuple[gx.Simulation, list[Variable], float]:
    """A scene at its start, the variables of these names, and the end of its run [s]."""
    scene, h, steps = make(MPI.COMM_WORLD)
    run = gx.Simulation(scene, gx.Midpoint(dt=h, tolerances=SOLVED))
    fields = AdjointFields(run.system)
    return run, find_variables(run.system, names, fields, in_time=True), steps * h


def result_of(run: gx.Simulation) -> Callable[[gx.Simulation], float]:
    """A sum of weighted positions of the first body: the same function in each run."""
    body = run.system.unknowns.bodies[0]
    start = np.array(run.system.unknowns.initial[body].positions())
    # Weights without symmetry, so that no part of the gradient cancels.
    weights = np.sin(5 * start + 1.0)
    # Only the position of a body with directors counts.
    if body.block.size > 3:
        weights = np.hstack([weights, np.zeros((len(weights), body.block.size - 3))])

    def value(run) -> float:
        coordinates = run.system.unknowns.state[body].coordinates().reshape(weights.shape)
        return float(run.system.comm.allreduce(np.sum(weights * coordinates)))

    return gx.analysis.Functional(value, lambda run: {body: weights}, unit="m")


def change_of(variable: Variable, run: gx.Simulation) -> np.ndarray:
    values = variable.get()
    size = run.comm.allreduce(np.abs(values).max(initial=0.0), op=MPI.MAX) or 1.0
    if not variable.is_distributed or variable.function(values) is None:
        # A direction of the same size as the values.
        return size * np.cos(1.0 + np.arange(len(values)))
    function = variable.function(values)
    space = function.function_space
    owned = space.dofmap.index_map.size_local
    x, y = space.tabulate_dof_coordinates()[:owned, :2].T
    waves = [np.sin(7 * x + 3 * y), np.cos(5 * x - 2 * y), np.sin(4 * x + 6 * y)]
    components = [waves[k % 3] for k in range(space.dofmap.index_map_bs)]
    return size * np.column_stack(components).ravel()


# Relative changes of the remainders: of the shape, whose strains are large, and of what touches,
# smaller ones.
SIZES = {
    "film.shape": 1e-5,
    "film.initial_position": 2e-6,
    "film.initial_velocity": 1e-4,
    "a.velocity": 3e-4,
    "a.spin": 3e-4,
}


# Share of these changes that a scene tolerates, before pairs come and go or folds slip in other
# steps.
FINER = {colliding: 0.1, touching: 0.1, rubbing: 0.1, yielding: 0.03}


@cache
def linearised(make) -> tuple[float, dict[str, tuple[np.ndarray, float]]]:
    """The result of a scene, and a change of each of its parameters with the derivative along it;
    one gradient by all of them."""
    names = PARAMETERS[make].split(", ")
    run, variables, until = fresh(make, names)
    tape = gx.analysis.RunTape(run)
    run.run(until=until)
    found = gx.analysis.gradient(tape, of=result_of(run), by=names)
    lines = {}
    for name, variable in zip(names, variables, strict=True):
        change = change_of(variable, run)
        slope = float(np.sum(found[name].values * change))
        if variable.is_distributed:
            slope = run.comm.allreduce(slope)
        lines[name] = (change, slope)
    return found.value, lines


@pytest.mark.mpi(len(CASES_ON_RANKS))
@pytest.mark.parametrize(("make", "name"), CASES, ids=lambda case: getattr(case, "__name__", case))
def test_remainders_are_of_second_order(make, name):
    """J(θ + δ) - J(θ) - δ dJ/dθ falls with δ², until round-off hides it."""
    result, lines = linearised(make)
    change, slope = lines[name]

    def at(δ: float) -> float:
        run, [variable], until = fresh(make, [name])
        if name.endswith(("initial_velocity", "initial_position")):
            body = next(b for b in run.system.unknowns.bodies if name.startswith(b.name + "."))
            system = run.system
            vector = system.unknowns.v0 if name.endswith("velocity") else system.unknowns.q0
            vector.array[system.unknowns.block(body).owned] += δ * change
            vector.array[system.unknowns.supports.held] -= (
                δ * _scattered(system, body, change)[system.unknowns.supports.held]
            )
            if vector is system.unknowns.q0:
                system.unknowns.q0.copy(system.unknowns.previous)
                system.restart()
        elif name in ("a.velocity", "a.spin"):
            body = next(b for b in run.system.unknowns.bodies if b.name == "a")
            owned = run.system.unknowns.block(body).owned
            start = run.system.unknowns.q0.array_r[owned].reshape(-1, 4, 3)
            rates = np.zeros_like(start)
            if name == "a.spin":
                rates[:, 1:] = np.cross(δ * change, start[:, 1:])
            else:
                rates[:, 0] = δ * change
            run.system.unknowns.v0.array[owned] += rates.ravel()
        else:
            variable.set(variable.get() + δ * change)
            run.system.parameters_changed()
        run.run(until=until)
        return result_of(run)(run)

    largest = SIZES.get(name, 3e-3) * FINER.get(make, 1.0)
    sizes = [largest, largest / 4]
    remainders = [at(δ) - result - δ * slope for δ in sizes]
    linear = abs(slope) * largest
    # A result that is linear in the parameter leaves round-off only.
    if max(map(abs, remainders)) < 1e-11 * max(linear, abs(result)):
        return
    # Where film changes its state the second derivative jumps, which makes the order a little
    # uneven.
    assert 1.9 < observed_order(sizes, remainders) < 2.6, (slope, remainders)


def _scattered(system, body, values: np.ndarray) -> np.ndarray:
    found = np.zeros(system.unknowns.numbering.size_local)
    found[system.unknowns.block(body).owned] = values
    return found


# ---- both modes of one step ----------------------------------------------------------------------


# Scenes in a step of which adjoint and tangent-linear products are compared.
PRODUCTS = [rubbing, yielding, damped, hinged, sampled]
PRODUCTS += [wrinkling, colliding, rubbing_while_stopping, creased, prestressed]
PRODUCTS += [damped_in_tension, roped, bent]


@pytest.mark.mpi(3)
@pytest.mark.parametrize("make", PRODUCTS, ids=lambda make: make.__name__)
def test_products_of_adjoint_and_tangent_linear_step(comm, make):
    """μ-products of one step: (a, b)·T(δq0, δv0) = Tᵀ(a, b)·(δq0, δv0) to round-off, T by forward
    solves."""
    run, tape = recorded(*make(comm))
    system = run.system
    steps = TransientGradients(tape, [f"{system.unknowns.bodies[0].name}.initial_velocity"]).steps
    # A step in the middle of the run, where film wrinkles or contact acts.
    k = len(tape.states) // 3
    first, last = tape.states[k - 1 : k + 1]
    a, b, δq0, δv0 = (_random(system.unknowns.numbering.vector(), seed) for seed in range(4))
    # The start does not contain fixed coordinates and multipliers.
    for vector in (a, b, δq0, δv0):
        steps.clear(vector)
    # 2/h² is the weight of the mass matrix in the step of the midpoint rule.
    h = last.h
    c = 2 / last.h**2
    δq1, right_side, product = (system.unknowns.numbering.vector() for _ in range(3))

    steps.repeat(first, last)
    A = system.matrices.tangent().copy()
    of_irreversible = _irreversible_product(system, δq0, δv0)
    steps.reverse(first, last)
    B = system.matrices.tangent()
    # A δq1 = c M (δq0 + h δv0) - B δq0 - S,    δv1 = 2 (δq1 - δq0)/h - δv0,
    # S of forces that the reversed step leaves out.
    product.waxpy(h, δv0, δq0)
    system.unknowns.M.mult(product, right_side)
    right_side.scale(c)
    B.mult(δq0, product)
    right_side.axpy(-1.0, product)
    right_side.axpy(-1.0, of_irreversible)
    steps.clear(right_side)
    solver = PETSc.KSP().create(comm)
    solver.setOperators(A)
    solver.setType("preonly")
    solver.getPC().setType("lu")
    solver.getPC().setFactorSolverType("mumps")
    solver.solve(right_side, δq1)
    # Two corrections take the error of the factorisation away.
    for _ in range(2):
        A.mult(δq1, product)
        product.aypx(-1.0, right_side)
        correction = product.duplicate()
        solver.solve(product, correction)
        δq1.axpy(1.0, correction)
    δv1 = δq1.copy()
    δv1.axpy(-1.0, δq0)
    δv1.scale(2 / h)
    δv1.axpy(-1.0, δv0)
    forward = a.dot(δq1) + b.dot(δv1)

    steps.solve(first, last, a, b)
    steps.carry(first, last, a, b)
    # Reversed: Tᵀ (a, b) in the same two vectors.
    backward = a.dot(δq0) + b.dot(δv0)
    scale = a.norm() * δq0.norm() + b.norm() * δv0.norm()
    # Round-off of scalar products of vectors of these sizes.
    assert abs(forward - backward) < 1e-12 * scale


def _irreversible_product(system, δq0: PETSc.Vec, δv0: PETSc.Vec) -> PETSc.Vec:
    """∂f/∂q0 δq0 + ∂f/∂v0 δv0 of forces that differ in the reversed step, entry by entry."""
    found, unit, by_position, by_velocity = (system.unknowns.numbering.vector() for _ in range(4))
    kinds = [kind for kind in system.equations.differentiable if not kind.reversible]
    if not kinds:
        return found
    first, last = found.getOwnershipRange()
    for k in range(found.getSize()):
        for vector in (unit, by_position, by_velocity):
            vector.set(0.0)
        if first <= k < last:
            unit.array[k - first] = 1.0
        for kind in kinds:
            kind.start_adjoint()
            kind.add_start_derivatives(unit, by_position, by_velocity)
        entry = by_position.dot(δq0) + by_velocity.dot(δv0)
        if first <= k < last:
            found.array[k - first] = entry
    # The sums of the last unit vector must not enter the step.
    for kind in kinds:
        kind.start_adjoint()
    return found


def _random(vector: PETSc.Vec, seed: int) -> PETSc.Vec:
    """Entries by global number, the same on any number of ranks."""
    first, last = vector.getOwnershipRange()
    vector.array[:] = np.random.default_rng(seed).normal(size=vector.getSize())[first:last]
    return vector


# ---- what a tape refuses, and what it drops ------------------------------------------------------


def test_a_scene_in_orbit_is_refused(comm):
    hub = gx.RigidBody(1.0, (0.6, 1.1, 1.5), name="a", comm=comm)
    orbit = gx.orbit.Orbit(gx.orbit.Elements(6.8e6, i=0.9), name="low orbit")
    run = gx.Simulation(gx.Scene(hub, orbit), gx.Midpoint(dt=1.0))
    tape = gx.analysis.RunTape(run)
    run.run(until=2.0)
    with pytest.raises(gx.InputError, match=r"'low orbit' has .* leave it out of the scene"):
        gx.analysis.gradient(tape, of=gx.analysis.Energy(), by=["a.spin"])


def test_friction_and_yielding_are_noted_in_the_result(comm):
    _, tape = recorded(*rubbing_on_floor(comm))
    found = gx.analysis.gradient(tape, of=gx.analysis.Energy(), by=["contact.friction"])
    assert found.notes[0].startswith("friction of 'contact' is piecewise smooth")
    _, tape = recorded(*yielding(comm))
    found = gx.analysis.gradient(tape, of=gx.analysis.Energy(), by=["crease.stiffness"])
    assert found.notes[0].startswith("yielding of 'crease' is piecewise smooth")


def test_a_run_goes_on_where_it_was_after_a_gradient_that_failed(comm):
    mass = gx.PointMass(1.0, (0.0, 0.0, -1.0), comm=comm)
    pull = [0.0]
    force = gx.loads.Force(mass.port(), lambda t: (0.0, 0.0, -pull[0]))
    run = gx.Simulation(gx.Scene(force), gx.Midpoint(dt=0.1))
    tape = gx.analysis.RunTape(run)
    run.run(until=1.0)
    # What the tape does not know: its steps are not those of this force.
    pull[0] = 10.0
    run.run(until=2.0)
    height = gx.probes.Position(mass.port(), "z")
    before = height(run)
    with pytest.raises(gx.StepFailure, match="cannot be repeated"):
        gx.analysis.gradient(tape, of=height, by=["mass.initial_velocity"])
    # Half of 10 m/s² for one second.
    assert before == pytest.approx(-6.0, rel=1e-9)
    assert (run.time, height(run)) == (2.0, before)


def test_a_tape_is_of_conserving_steps(comm):
    mass = gx.PointMass(1.0, (0.0, 0.0, 0.0), velocity=(1.0, 0.0, 0.0))
    dissipating = gx.Simulation(gx.Scene(mass), gx.GeneralizedAlpha(dt=0.1))
    with pytest.raises(gx.InputError, match="not the same backwards"):
        gx.analysis.RunTape(dissipating)


class Resistance(PointForce):
    """A force -c V against the velocity V at the start of a step, which knows no derivatives."""

    def begin(self, t: float, lag: float, X: np.ndarray, V: np.ndarray) -> None:
        self.value = -0.8 * V

    def force(self, X: np.ndarray) -> np.ndarray:
        return self.value

    def tangent(self, X: np.ndarray) -> np.ndarray:
        return np.zeros((3, 3))


class DerivedResistance(Resistance, ForceOfStart):
    """The same force with its derivative by the start; the reversed step keeps it."""

    def begin(self, t: float, lag: float, X: np.ndarray, V: np.ndarray) -> None:
        if lag > 0:
            super().begin(t, lag, X, V)

    def start_adjoint(self) -> None:
        """It holds nothing over several steps."""

    def work_by_number(self, key: str, X: np.ndarray, w: np.ndarray) -> np.ndarray:
        return np.zeros(1)

    def products_at_start(self, X: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros(3), -0.8 * w


@dataclass(frozen=True, eq=False)
class Brake(Item):
    """An own load on a mass, by a law."""

    mass: gx.PointMass
    law: Resistance
    name: str = "brake"

    def requires(self):
        yield self.mass

    def terms(self, start):
        yield PointLoad(self.name, (self.mass.port(),), self.law)


def braked(law: Resistance, speed: float) -> tuple[gx.Simulation, gx.analysis.RunTape]:
    mass = gx.PointMass(1.0, (0.0, 0.0, 0.0), velocity=(speed, 0.0, 0.0))
    top = gx.Ground((0.0, 0.0, 1.0))
    spring = gx.connectors.Spring(mass.port(), top, stiffness=30.0, length=0.5)
    return recorded(gx.Scene(Brake(mass, law), spring), 2e-2, 10)


def test_a_load_that_depends_on_velocities_needs_its_derivatives():
    _, tape = braked(Resistance(), 1.0)
    energy = gx.analysis.Energy()
    with pytest.raises(gx.InputError, match="'brake' depends on more than positions"):
        gx.analysis.gradient(tape, of=energy, by=["mass.initial_velocity"])
    _, tape = braked(DerivedResistance(), 1.0)
    found = gx.analysis.gradient(tape, of=energy, by=["mass.initial_velocity"])
    # Central differences of an analytic function: their error is of second order.
    δ = 1e-4
    ends = [energy(braked(DerivedResistance(), 1.0 + sign * δ)[0]) for sign in (1, -1)]
    difference = (ends[0] - ends[1]) / (2 * δ)
    assert found["mass.initial_velocity"].values[0] == pytest.approx(difference, rel=1e-7)


@pytest.mark.mpi
@pytest.mark.parametrize("kind", ["film", "beam", "mass"])
def test_what_falls_depends_on_gravity_by_half_of_the_square_of_time(comm, kind):
    """x = g t²/2, also of masses that are attached to a body."""
    if kind == "mass":
        body = gx.PointMass(0.3, comm=comm, name="body")
        port = body.port()
        extra = []
    else:
        if kind == "film":
            body = gx.Membrane(sheet(comm, 2, 2), gx.Linear(1e9, 0.3, density=1e3, thickness=1e-4))
            port = body.port("top right")
        else:
            section = gx.sections.solid_circle(0.01, E=1e9, nu=0.3, density=1e3)
            body = gx.Beam(line(comm, [(0, 0, 0), (1, 0, 0)], 2), section)
            port = body.port("end")
        extra = [gx.connectors.AttachedMass(port, 0.2, name="sensor")]
    weight = gx.Gravity(body, (0.0, 0.0, -2.0), name="weight")
    run = gx.Simulation(gx.Scene(weight, *extra), gx.Midpoint(dt=0.05))
    tape = gx.analysis.RunTape(run)
    run.run(until=0.2)
    found = gx.analysis.gradient(tape, of=gx.probes.Position(port, "z"), by=["weight.g"])
    assert found["weight.g"].values == pytest.approx([0, 0, 0.02], abs=1e-9)
