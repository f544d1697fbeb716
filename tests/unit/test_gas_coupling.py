"""Coupling of gas and bodies: signs of volumes, derivatives, rings, and rejected steps."""

from __future__ import annotations

import re

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.core.checks.errors import NotConverged
from gossamer_fx.meshes.airbag import airbag
from gossamer_fx.meshes.arrays import mesh_of_arrays
from gossamer_fx.records.run.simulation import Simulation
from gossamer_fx.solve.solvers import linear
from gossamer_fx.solve.steppers.midpoint import GEOMETRIC_STIFFNESS_DELAY
from tests.small_scenes import AIR, run_until

WORLD = MPI.COMM_WORLD
FILM = gx.Linear(E=1e6, nu=0.3, density=1420.0, thickness=25e-6)


# ---- which side is out ---------------------------------------------------------------------------


@pytest.mark.mpi(1)
@pytest.mark.parametrize("seed", range(6))
def test_a_flat_film_inflates_to_the_side_of_its_normals(seed: int) -> None:
    """In a plane somewhere in space V is round-off of either sign: the sheet with normals along n
    moves along n."""
    random = np.random.default_rng(seed)
    R = np.linalg.qr(random.normal(size=(3, 3)))[0]
    R *= np.sign(np.linalg.det(R))
    centre = random.uniform(-3, 3, 3)

    def shift(X: np.ndarray) -> np.ndarray:
        return R @ X + centre[:, None] - X

    film = gx.Membrane(airbag(WORLD, 1.0, 4), FILM, displacement=shift)
    bag = gx.Chamber(film, gas=AIR, pressure=10.0, temperature=300.0, dead_volume=1e-3)
    run = run_until(2e-3, bag, dt=1e-3)
    n = film.block.index_map.size_local
    x = run.system.unknowns.q0.array_r.reshape(-1, 3)
    sides = [film.nodes("top"), film.nodes("bottom")]
    own = [side[side < n] for side in sides]
    sums = WORLD.allreduce(np.array([np.r_[x[side].sum(axis=0), len(side)] for side in own]))
    means = sums[:, :3] / sums[:, 3:]
    assert (means[0] - means[1]) @ R[:, 2] > 1e-5
    assert run.chamber("chamber").volume > 1e-3 + 1e-5


def test_a_piston_is_the_point_of_a_rigid_body_and_turns_it():
    """A point off the centre of a body that spins: V = V0 + A n·(x - x0), and the angular momentum
    gains the moment of the force, x × p A n."""
    body = gx.RigidBody(2.0, (0.1, 0.2, 0.3), spin=(0.5, 2.0, 0.3))
    port = body.port((0.3, 0.2, 0.1))
    piston = gx.gas.Piston(port, 0.01, direction=(0.0, 0.0, 1.0))
    bag = gx.Chamber(piston, gas=AIR, pressure=1e3, temperature=300.0, dead_volume=1e3)
    dt = 1e-2
    run = gx.Simulation(gx.Scene(bag), gx.Midpoint(dt=dt))
    before = run.totals.angular_momentum
    position = [gx.probes.Position(port, axis) for axis in "xyz"]
    start = np.array([probe(run) for probe in position])
    run.run(until=dt)
    end = np.array([probe(run) for probe in position])
    assert run.chamber("chamber").volume - 1e3 == pytest.approx(0.01 * (end - start)[2], rel=1e-8)
    moment = np.cross((start + end) / 2, (0.0, 0.0, 0.01 * 1e3))
    gained = run.totals.angular_momentum - before
    assert gained == pytest.approx(dt * moment, rel=1e-6)
    assert abs(run.energy_error) < 1e-13


# ---- derivatives ---------------------------------------------------------------------------------


def cylinder(pressure: float, temperature: float, x: float = 0.2) -> gx.Chamber:
    piston = gx.gas.Piston(
        gx.PointMass(0.1, (x, 0.0, 0.0), name=f"mass at {x}").port(), 0.01, direction=(1, 0, 0)
    )
    state = {"pressure": pressure, "temperature": temperature}
    return gx.Chamber(
        piston,
        gas=AIR,
        dead_volume=2e-3,
        name=f"chamber of {pressure:g} Pa",
        **state,
    )


def vented_piston() -> gx.Scene:
    bag = cylinder(3e5, 400.0)
    return gx.Scene(bag, gx.Orifice(bag, gx.gas.Ambient(1e5, 300.0), area=1e-4))


def heated_piston() -> gx.Scene:
    bag = cylinder(1e5, 300.0)
    return gx.Scene(bag, gx.gas.WallHeat(bag, 20.0, temperature=600.0))


def two_pistons() -> gx.Scene:
    """Connected to each other, to a reservoir and a warm wall."""
    bags = [cylinder(p, 350.0, x) for p, x in ((2e5, 0.2), (1.5e5, 0.4))]
    between = gx.Orifice(*bags, area=2e-4, name="between")
    inlet = gx.Orifice(
        gx.gas.Ambient(4e5, 500.0, name="reservoir"), bags[0], area=1e-4, name="inlet"
    )
    return gx.Scene(between, inlet, gx.gas.WallHeat(bags[1], 5.0, temperature=700.0))


@pytest.mark.parametrize("scene", [vented_piston, heated_piston, two_pistons])
def test_the_gas_follows_the_volume_as_its_coupling_says(scene) -> None:
    """C δy = -Hᵀ δq of the coupling against central differences of the gas at volumes a little
    larger and smaller."""
    run = gx.Simulation(scene(), gx.Midpoint(dt=5e-3))
    system = run.system
    border = system.equations.scalar_unknowns[0]
    y0 = system.equations.begin_step(5e-3)
    system.equations.set_inertia(0.0)
    δ = np.sin(1.3 * np.arange(system.unknowns.numbering.size) + 0.4)

    def gas(step: float) -> np.ndarray:
        z = system.unknowns.q0.copy()
        r = system.unknowns.q0.duplicate()
        z.array[:] += step * δ
        system.equations.set_end(z)
        s = system.equations.residual(y0, r)
        assert abs(s).max() < 1e-12  # it was solved at these volumes
        return border.y.copy()

    ε = 1e-5
    difference = (gas(ε) - gas(-ε)) / (2 * ε)
    gas(0.0)
    _, rows, C = system.matrices.coupling()
    Hδ = np.array([0.0 if row is None else row @ δ for row in rows])
    assert np.linalg.solve(C, -Hδ) == pytest.approx(difference, rel=1e-6)


# ---- rings ---------------------------------------------------------------------------------------


def hoop(n: int) -> gx.Mesh:
    """A cylinder of n × 2 squares with open ends, the groups "first rim" and "last rim"."""
    angle = 2 * np.pi * np.arange(n) / n
    side = 2 * np.pi * 0.1 / n
    points = [(0.1 * np.cos(a), 0.1 * np.sin(a), k * side) for k in range(3) for a in angle]
    at = lambda k, i: k * n + i % n  # noqa: E731
    squares = [
        (at(k, i), at(k, i + 1), at(k + 1, i + 1), at(k + 1, i)) for k in (0, 1) for i in range(n)
    ]
    triangles = [t for a, b, c, d in squares for t in ((a, b, c), (a, c, d))]

    rims = {}
    for k, name in ((0, "first rim"), (2, "last rim")):
        rims[name] = np.array([(at(k, i), at(k, i + 1)) for i in range(n)])
    return mesh_of_arrays(WORLD, lambda: (np.array(points), np.array(triangles), rims))


def open_cylinder(n: int, order: int = 1, **options) -> Simulation:
    film = gx.Membrane(hoop(n), FILM, order=order, **options)
    rims = tuple(gx.gas.Ring(film, name) for name in ("first rim", "last rim"))
    bag = gx.Chamber(film, gas=AIR, pressure=1e3, temperature=300.0, rings=rims)
    return gx.Simulation(gx.Scene(bag), gx.Midpoint(dt=1e-6))


@pytest.mark.mpi
def test_a_ring_couples_few_nodes() -> None:
    """Entries of the tangent grow as the edges of the ring, not as their square."""
    few, many = (open_cylinder(n).system.matrices.A.getInfo(3)["nz_used"] for n in (60, 240))
    assert many < 4.2 * few


@pytest.mark.mpi(1)
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("n", [8, 9])
def test_rings_of_even_and_odd_numbers_of_edges_close_a_volume(n: int, order: int) -> None:
    """That of the prism, and the same wherever and however the warped cylinder stands in space."""
    exact = n / 2 * 0.1**2 * np.sin(2 * np.pi / n) * 2 * (2 * np.pi * 0.1 / n)
    assert pytest.approx(exact, rel=1e-12) == open_cylinder(n, order).chamber("chamber").volume

    def warp(X: np.ndarray) -> np.ndarray:
        return 0.02 * np.sin(np.array([40 * X[1] * X[2], 30 * X[0], 50 * X[0] * X[1]]) + 0.5)

    R = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    R *= np.sign(np.linalg.det(R))
    there = np.array([[3.0], [-2.0], [5.0]])
    volumes = [
        open_cylinder(n, order, displacement=shape).chamber("chamber").volume
        for shape in (warp, lambda X: R @ (X + warp(X)) + there - X)
    ]
    assert volumes[1] == pytest.approx(volumes[0], rel=1e-11) != pytest.approx(exact, rel=1e-3)


# ---- steps that fail -----------------------------------------------------------------------------


def test_the_chamber_is_named_whose_gas_is_not_in_balance() -> None:
    """The mass of the second chamber's piston is beyond its bottom."""
    system = gx.Simulation(two_pistons(), gx.Midpoint(dt=5e-3)).system
    y = system.equations.begin_step(5e-3)
    border = system.equations.scalar_unknowns[0]
    system.equations.set_inertia(0.0)
    z = system.unknowns.q0.copy()
    r = system.unknowns.q0.duplicate()
    system.equations.set_end(z)
    system.equations.residual(y, r)
    assert border.unsolved() == ""
    z.array[3] -= 0.5
    system.equations.set_end(z)
    system.equations.residual(y, r)
    assert re.match(
        r"the gas of 'chamber of 150000 Pa' is not in balance \(volume -0\.003 m³",
        border.unsolved(),
    )


@pytest.mark.mpi
def test_an_iterate_that_is_no_number_is_forgotten() -> None:
    system = open_cylinder(8).system
    first = system.equations.begin_step(1e-6)
    system.equations.set_inertia(0.0)
    z = system.unknowns.q0.copy()
    r = system.unknowns.q0.duplicate()
    z.set(np.nan)
    system.equations.set_end(z)
    assert np.isnan(system.equations.residual(first, r)).any()
    assert system.equations.begin_step(1e-6) == pytest.approx(first, rel=1e-14)
    system.equations.set_end(system.unknowns.q0)
    assert abs(system.equations.residual(first, r)).max() < 1e-12


def test_an_attempt_takes_no_columns_of_one_that_failed(monkeypatch) -> None:
    """The step is tried twice; each attempt begins with P⁻¹ G of its first iterate."""
    monkeypatch.setattr(linear, "MAX_UNKNOWNS_DIRECT", 0)
    bag = gx.Chamber(
        gx.Membrane(airbag(MPI.COMM_SELF, 1.0, 4), FILM),
        gas=AIR,
        pressure=10.0,
        temperature=300.0,
        dead_volume=1e-3,
    )
    stepper = gx.Midpoint(dt=1e-2, tolerances=gx.Tolerances(max_iterations=1))
    run = gx.Simulation(gx.Scene(bag), stepper)
    computed = []
    original = linear.BorderedPreconditioner._solve_columns

    def noted(preconditioner) -> None:
        computed.append(run.solver.newton.geometric_stiffness_delay)
        original(preconditioner)

    monkeypatch.setattr(linear.BorderedPreconditioner, "_solve_columns", noted)
    with pytest.raises(NotConverged):
        run.solver.step(1e-2)
    assert computed == [0, GEOMETRIC_STIFFNESS_DELAY]
