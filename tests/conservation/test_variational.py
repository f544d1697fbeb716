"""The variational midpoint rule: discrete Euler-Lagrange equations, exact momenta, a bounded error
of the energy."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc

import gossamer_fx as gx
from gossamer_fx.meshes.creased_strip import creased_strip
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.plates import irregular_sheet
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.solve.steppers import EndPoint, VariationalMidpoint
from gossamer_fx.solve.system.system import System
from tests.rates import observed_order

COMM = MPI.COMM_WORLD
MATERIAL = {"E": 1e7, "nu": 0.3, "density": 1400.0, "thickness": 1e-4}
LINEAR = gx.Linear(**MATERIAL)
WRINKLING = gx.Miyazaki(**MATERIAL, residual_stiffness=1e-2)
FABRIC = gx.Orthotropic(1e7, 1e6, 0.3, 5e5, direction=(1.0, 0.3, 0.0), density=1e3, thickness=1e-4)
TUBE = gx.sections.tube(0.02, 5e-4, E=1e9, nu=0.3, density=1560.0)
AXIS = [(0, 0, 0), (1, 0, 0)]
HEAT = gx.materials.ThermalExpansion(1e-3, lambda X, t: 293.15 + 20 * X[0])
# The residuals of a step may have the same sign in all steps, so that they add up.
TIGHT = gx.Tolerances(relative=1e-13)


def spin(X: np.ndarray) -> np.ndarray:
    """10 rad/s about the middle of a unit square, with a wave across."""
    return np.vstack([-10 * (X[1] - 0.5), 10 * (X[0] - 0.5), np.sin(np.pi * X[0])])


def tethered_film(comm: MPI.Comm) -> gx.Scene:
    """A spinning film with a mass on a spring at its edge: its period is 0.2 s, that of the fastest
    mode 8 ms."""
    film = gx.Membrane(sheet(comm, 4, 4), LINEAR, velocity=spin)
    mass = gx.PointMass(0.01, (1.5, 0.5, 0.0), velocity=(0.0, 4.0, 0.0))
    tether = gx.connectors.Spring(
        mass.port(), film.port_at((1.0, 0.5, 0.0)), stiffness=20.0, length=0.4
    )
    return gx.Scene(film, mass, tether)


def jointed_bodies(comm: MPI.Comm) -> gx.Scene:
    """Two rigid bodies that tumble about a ball joint, with a soft beam on one of them."""
    rod = gx.RigidBody(1.0, (0.1, 0.2, 0.25), name="rod")
    # It also turns about the joint, at -0.5 m of its x axis.
    other = gx.RigidBody(
        0.5,
        (0.1, 0.1, 0.05),
        position=(1.0, 0.0, 0.0),
        velocity=(0.0, 0.0, -1.0),
        spin=(0.0, 2.0, 0.0),
        name="other",
    )
    beam = gx.Beam(line(comm, [(-1.5, 0, 0), (-0.5, 0, 0)], 4), TUBE, name="beam")
    hinge = gx.constraints.BallJoint(rod.port((0.5, 0, 0)), other.port((-0.5, 0, 0)), name="hinge")
    clamp = gx.constraints.FixedJoint(rod.frame_at((-0.5, 0, 0)), beam.frame("end"), name="clamp")
    return gx.Scene(rod, other, beam, hinge, clamp, gx.RigidMotion(spin=(1.5, 0.3, 0.5)))


@pytest.mark.mpi(2)
@pytest.mark.parametrize("scene, h", [(tethered_film, 4e-4), (jointed_bodies, 2e-3)])
def test_momentum_and_angular_momentum_are_exact(
    comm: MPI.Comm, scene: Callable[[MPI.Comm], gx.Scene], h: float
) -> None:
    run = gx.Simulation(scene(comm), VariationalMidpoint(dt=h, tolerances=TIGHT))
    run.run(until=200 * h)
    assert run.step == 200
    scale = np.linalg.norm(run.first.angular_momentum)
    drift = np.linalg.norm(run.totals.angular_momentum - run.first.angular_momentum)
    assert drift < 1e-12 * scale
    # Of the speed of 1 m/s and the mass of the scene, 1 kg and less.
    assert np.linalg.norm(run.totals.momentum - run.first.momentum) < 1e-12
    assert abs(run.energy_error) < 1e-3


def energy_errors(h: float, until: float) -> np.ndarray:
    """Error of the energy after each step of the film with its tether."""
    run = gx.Simulation(tethered_film(COMM), VariationalMidpoint(dt=h, tolerances=TIGHT))
    errors = []
    while run.totals.time < until - h / 2:
        run.run(until=run.totals.time + h)
        errors.append(run.energy_error)
    return np.abs(errors)


def test_the_error_of_the_energy_is_bounded_and_of_second_order() -> None:
    steps = (8e-4, 4e-4, 2e-4)
    errors = [energy_errors(h, 0.08) for h in steps]
    for of_run in errors:
        half = len(of_run) // 2
        # It oscillates: a drift would double it in the second half of the run.
        assert of_run[half:].max() < 1.2 * of_run[:half].max()
    assert observed_order(steps, [of_run.max() for of_run in errors]) == pytest.approx(2, abs=0.1)


def test_second_order() -> None:
    """A mass on a spring that is stretched and swings; against steps an eighth of the finest."""

    def position(h: float) -> np.ndarray:
        mass = gx.PointMass(1.0, (1.2, 0.0, 0.0), velocity=(0.0, 2.0, 0.0))
        spring = gx.connectors.Spring(
            mass.port(), gx.Ground((0.0, 0.0, 0.0)), stiffness=50.0, length=1.0
        )
        damper = gx.connectors.Damper(mass.port(), gx.Ground((0.0, 0.0, 0.0)), damping=0.3)
        scene = gx.Scene(mass, spring, damper, gx.Gravity(mass, (0.0, -9.81, 0.0)))
        run = gx.Simulation(scene, VariationalMidpoint(dt=h))
        run.run(until=1.0)
        return run.system.unknowns.q0.array_r.copy()

    steps = (2e-2, 5e-3)
    exact = position(steps[-1] / 8)
    errors = [float(np.linalg.norm(position(h) - exact)) for h in steps]
    assert observed_order(steps, errors) == pytest.approx(2, abs=0.1)


def test_three_positions_satisfy_the_discrete_euler_lagrange_equations() -> None:
    """D2 L_d(q0, q1) + D1 L_d(q1, q2) = 0 of a mass on a spring, by complex steps in L_d."""
    h = 0.05
    m, k, length = 2.0, 30.0, 1.0
    mass = gx.PointMass(m, (1.2, 0.0, 0.0), velocity=(0.0, 3.0, 1.0))
    spring = gx.connectors.Spring(
        mass.port(), gx.Ground((0.0, 0.0, 0.0)), stiffness=k, length=length
    )
    run = gx.Simulation(gx.Scene(mass, spring), VariationalMidpoint(dt=h, tolerances=TIGHT))
    path = [run.system.unknowns.q0.array_r.copy()]
    for step in (1, 2):
        run.run(until=step * h)
        path.append(run.system.unknowns.q0.array_r.copy())

    def lagrangian(start: np.ndarray, end: np.ndarray) -> complex:
        middle = (start + end) / 2
        rate = (end - start) / h
        stretch = np.sqrt(middle @ middle) - length
        return complex(h * (m * rate @ rate / 2 - k * stretch**2 / 2))

    tiny = 1e-30
    for direction in np.eye(3) * 1j * tiny:
        by_end = lagrangian(path[0], path[1] + direction).imag / tiny
        by_start = lagrangian(path[1] + direction, path[2]).imag / tiny
        # Both are momenta, of 6 kg m/s.
        assert by_end + by_start == pytest.approx(0, abs=1e-11)


def creased(comm: MPI.Comm) -> gx.Scene:
    """A flat strip with a fold."""
    film = gx.Membrane(creased_strip(comm, 4, 2, 0.05, 0.02), LINEAR, order=2)
    return gx.Scene(film, gx.connectors.Crease(film, "crease", stiffness=2e-3))


def spring_net(comm: MPI.Comm) -> gx.Scene:
    masses = [gx.PointMass(1.0, (float(k), 0.1 * k**2, 0.0), name=f"m{k}") for k in range(3)]
    a, b, c = (mass.port() for mass in masses)
    return gx.Scene(
        *masses,
        gx.connectors.Spring(a, b, stiffness=20.0, length=0.4, name="short"),
        gx.connectors.Spring(b, c, stiffness=30.0, length=1.5, name="long"),
        gx.connectors.Rope(a, c, stiffness=10.0, length=1.0, name="rope"),
    )


SCENES: dict[str, Callable[[MPI.Comm], gx.Scene]] = {
    "film": lambda comm: gx.Scene(gx.Membrane(sheet(comm, 4, 3), LINEAR)),
    "wrinkling": lambda comm: gx.Scene(gx.Membrane(sheet(comm, 4, 3), WRINKLING, order=2)),
    "fabric": lambda comm: gx.Scene(gx.Membrane(sheet(comm, 4, 3), FABRIC)),
    "warm": lambda comm: gx.Scene(gx.Membrane(sheet(comm, 4, 3), WRINKLING, thermal=HEAT)),
    "plate": lambda comm: gx.Scene(
        gx.Plate(
            irregular_sheet(comm, 8, 2, 0.6, 0.15), LINEAR, rest_curvature=np.diag([3.0, 0, 0])
        )
    ),
    "cable": lambda comm: gx.Scene(gx.Cable(line(comm, AXIS, 8), gx.TensionOnly(1e4, 0.1))),
    "beam": lambda comm: gx.Scene(gx.Beam(line(comm, AXIS, 8), TUBE)),
    "crease": creased,
    "springs": spring_net,
}


def moved(scene: gx.Scene, rule: object, share: float) -> tuple[System, PETSc.Vec]:
    """A compiled scene in a step whose end is a share of one and the same motion away from its
    start, and its residual without inertia."""
    system = scene.compile(rule)
    system.equations.set_inertia(0.0)
    y = system.equations.begin_step(1e-3)
    w = system.unknowns.numbering.vector()
    system.equations.predict(w)
    own = system.unknowns.q0.array_r[: 3 * len(system.unknowns.position_marks)].reshape(-1, 3)
    turned = own @ np.random.default_rng(1).standard_normal((3, 3)) + 1.0
    with w as values:
        values[: own.size] = share * 3e-3 * np.sin(20 * turned).ravel()
    system.equations.set_increment(w, None)
    r = system.unknowns.numbering.vector()
    system.equations.residual(y, r)
    return system, r


@pytest.mark.mpi(2)
@pytest.mark.parametrize("name", SCENES)
def test_forces_are_the_gradient_of_the_energy_in_the_middle(comm: MPI.Comm, name: str) -> None:
    """Forces and tangent of a step to q1 are those of a state at q_mid, the tangent by half."""
    step, r = moved(SCENES[name](comm), VariationalMidpoint(dt=1.0).rule, 1.0)
    state, expected = moved(SCENES[name](comm), EndPoint(), 0.5)
    # Without multipliers: constraints hold at q1.
    n = 3 * len(step.unknowns.position_marks)

    def norm(values: np.ndarray) -> float:
        return float(np.sqrt(comm.allreduce(float(values[:n] @ values[:n]))))

    scale = norm(expected.array_r)
    assert scale > 1e-3
    assert norm(r.array_r - expected.array_r) < 1e-12 * scale

    z = step.unknowns.numbering.vector()
    z.array[:n] = np.sin(1e3 * step.unknowns.q1.array_r[:n])
    found = (step.matrices.tangent() * z).array_r
    half = (state.matrices.tangent() * z).array_r / 2
    assert norm(found - half) < 1e-12 * norm(half)


@pytest.mark.mpi
def test_a_film_that_wrinkles_and_is_damped_restarts_as_it_was(folder: Path) -> None:
    def go(steps: int, **options: object) -> gx.Simulation:
        film = gx.Membrane(sheet(COMM, 4, 4), WRINKLING, velocity=spin, thermal=HEAT)
        damping = gx.Damping(film, stiffness_factor=1e-5)
        run = gx.Simulation(gx.Scene(film, damping), VariationalMidpoint(dt=2e-4), **options)
        run.run(until=steps * 2e-4)
        return run

    whole = go(20)
    go(10, checkpoints=gx.Checkpoints(folder))
    rest = go(20, restart=folder)
    assert rest.step == whole.step == 20
    assert rest.totals.kinetic == pytest.approx(whole.totals.kinetic, rel=1e-9)
    assert rest.totals.losses == pytest.approx(whole.totals.losses, rel=1e-9)
    assert rest.energy_error == pytest.approx(whole.energy_error, rel=1e-6)


def above_a_floor() -> gx.Scene:
    film = gx.Membrane(sheet(MPI.COMM_SELF, 2, 2), LINEAR)
    plane = gx.contact.Plane(point=(0.0, 0.0, -0.01), normal=(0.0, 0.0, 1.0))
    return gx.Scene(gx.Contact(film, plane, distance=1e-3))


def blown_piston() -> gx.Scene:
    mass = gx.PointMass(0.5, (0.0, 0.0, 0.0))
    piston = gx.gas.Piston(mass.port(), 0.01, direction=(1.0, 0.0, 0.0))
    gas = gx.IdealGas(gamma=1.4, R=287.0)
    return gx.Scene(gx.Chamber(piston, gas=gas, pressure=1e3, temperature=300.0, dead_volume=1e-3))


def braked_tether() -> gx.Scene:
    mass = gx.PointMass(1.0, (1.0, 0.0, 0.0))
    tether = gx.connectors.Tether(
        mass.port(), gx.Ground((0.0, 0.0, 0.0)), stiffness=1e3, length=1.1, brake_force=2.0
    )
    return gx.Scene(mass, tether)


def in_orbit() -> gx.Scene:
    return gx.Scene(gx.PointMass(1.0), gx.orbit.Orbit(gx.orbit.Elements(7e6)))


def reduced_film() -> gx.Scene:
    film = gx.Membrane(sheet(MPI.COMM_SELF, 2, 2), LINEAR)
    shapes = gx.reduction.Snapshots(film)
    X = film.space.tabulate_dof_coordinates()
    shapes.positions += [X + 0.05 * np.sin((k + 1) * X[:, ::-1]) for k in range(3)]
    return gx.Scene(gx.reduction.reduce(film, [shapes], modes=2))


@pytest.mark.parametrize(
    "scene, words",
    [
        (above_a_floor, "VariationalMidpoint: the scene has contact"),
        (blown_piston, "VariationalMidpoint: the scene has gas"),
        (braked_tether, "'tether' has forces by the strains"),
        (in_orbit, "flies by the midpoint rule only"),
        (reduced_film, "'film' has forces by the strains at the ends"),
    ],
)
def test_what_has_no_discrete_lagrangian_is_refused(
    scene: Callable[[], gx.Scene], words: str
) -> None:
    with pytest.raises(gx.InputError, match=words) as refused:
        gx.Simulation(scene(), VariationalMidpoint(dt=1e-4))
    assert "\n" not in str(refused.value)
