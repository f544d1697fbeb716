"""Step control: error, iterations, and conservation for steps of changing length."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mpi4py import MPI
from scipy.integrate import solve_ivp

import gossamer_fx as gx
from gossamer_fx.extend import Output
from gossamer_fx.solve.steppers.step_control import LocalError
from tests.survival.scenes import Watch, filled_tube, fluttering_sheet, turning_beam

COMM = MPI.COMM_WORLD
OMEGA = 10.0  # rad/s


def oscillator() -> tuple[gx.Scene, gx.PointMass]:
    mass = gx.PointMass(2.0, position=(1.0, 0.0, 0.0), comm=MPI.COMM_SELF)
    return gx.Scene(
        mass, gx.connectors.AxialSpring(mass.port(), 2.0 * OMEGA**2, direction=(1.0, 0.0, 0.0))
    ), mass


class Steps(Output):
    """An output that notes the steps."""

    times = ()

    def __init__(self) -> None:
        self.lengths: list[float] = []

    def open(self, run: gx.Simulation) -> None:
        self._before = run.time

    def record(self, run: gx.Simulation, last: bool) -> None:
        if run.step:
            self.lengths.append(run.time - self._before)
        self._before = run.time

    def close(self, run: gx.Simulation) -> None:
        pass


@pytest.mark.parametrize("h", [0.01, 0.005])
def test_the_local_error_of_an_oscillator_is_estimated(h: float) -> None:
    """x = cos ωt: h³ ω³ |sin ωt|/12 but for terms of higher order."""
    scene, _ = oscillator()
    run = gx.Simulation(scene, gx.Midpoint(dt=h))
    estimate = LocalError(run.system)
    for _ in range(20):
        t = run.time
        step = run.solver.step(h)
        found = estimate.measure(step)
        run.solver.accept(step)
        estimate.commit()
        if t:
            # the difference of the accelerations is centred at the start of the step
            exact = h**3 * OMEGA**3 * abs(math.sin(OMEGA * t)) / 12
            assert found == pytest.approx(exact, rel=0.02, abs=2e-2 * h**3 * OMEGA**3 / 12)


@pytest.mark.parametrize("error", [1e-4, 1e-5, 1e-6])
def test_steps_of_a_given_error(error: float) -> None:
    """Errors of steps add up: at t = 1 the phase is off by 1/h errors of at most the given one."""
    scene, _ = oscillator()
    noted = Steps()
    control = gx.StepControl(target_iterations=10**6, error=error)
    run = gx.Simulation(scene, gx.Midpoint(dt=1e-3), outputs=[noted], control=control)
    run.run(until=1.0)
    off = abs(run.system.unknowns.q0.array_r[0] - math.cos(OMEGA))
    assert off <= error * run.step
    assert off >= error * run.step / 20  # and they are not much shorter than they must be
    assert max(noted.lengths) <= (12 * error / OMEGA**3) ** (1 / 3) * 3
    assert abs(run.energy_error) <= 1e-12


@pytest.mark.mpi
def test_iterations_are_near_their_target() -> None:
    def go(target: int) -> gx.Simulation:
        control = gx.StepControl(target_iterations=target)
        run = gx.Simulation(fluttering_sheet(COMM), gx.Midpoint(dt=1e-4), control=control)
        run.run(until=0.05)
        return run

    few = go(4)
    many = go(5)
    assert few.iterations / few.step == pytest.approx(4, abs=0.7)
    assert many.iterations / many.step == pytest.approx(5, abs=0.7)
    assert many.iterations / many.step > few.iterations / few.step
    assert many.step < few.step
    assert max(abs(few.energy_error), abs(many.energy_error)) <= 1e-10


@settings(max_examples=4)
@given(seed=st.integers(0, 10**6))
@pytest.mark.mpi(1)
@pytest.mark.parametrize("kind", ["film", "film and gas", "beam, hub and control"])
def test_nothing_is_lost_for_any_sequence_of_steps(kind: str, seed: int) -> None:
    """Random steps over three decades, also backwards and forwards again."""
    scene = {
        "film": fluttering_sheet,
        "film and gas": filled_tube,
        "beam, hub and control": turning_beam,
    }[kind](COMM)
    run = gx.Simulation(scene, gx.Midpoint(dt=1.0))
    rng = np.random.default_rng(seed)
    for h in 10 ** rng.uniform(-5, -2.3, 6):
        start = run.history.save()
        run.stepping.advance(h * rng.uniform(0.1, 2))
        run.history.restore(start)
        run._advance(h)
    first = run.first
    last = run.totals
    assert abs(run.energy_error) <= 1e-9
    assert abs(run.mass_error) <= 1e-13
    if kind == "film":
        assert last.momentum == pytest.approx(first.momentum, abs=1e-10)
        assert last.angular_momentum == pytest.approx(first.angular_momentum, rel=1e-10, abs=1e-11)


@pytest.mark.mpi(1)
@pytest.mark.parametrize("scene", [fluttering_sheet, filled_tube, turning_beam])
def test_a_step_that_is_taken_back_leaves_no_trace(
    scene: Callable[[MPI.Intracomm], gx.Scene],
) -> None:
    """The same step twice, with another one between that is undone, is the same to the last digit.

    On several ranks to round-off: a parallel factorisation adds in the order in which its messages
    arrive.
    """
    run = gx.Simulation(scene(COMM), gx.Midpoint(dt=1e-3))
    run.run(until=3e-3)
    start = run.history.save()
    results = []
    for trial in (1e-3, 2.7e-3, 1e-3):
        run.stepping.advance(trial)
        results.append(
            (
                run.system.unknowns.q0.array_r.copy(),
                run.system.unknowns.v0.array_r.copy(),
                run.system.balance.totals().energy,
            )
        )
        run.history.restore(start)
    for first, again in zip(results[0], results[2], strict=True):
        largest = COMM.allreduce(float(np.max(np.abs(first), initial=0.0)), MPI.MAX)
        np.testing.assert_allclose(
            again, first, rtol=0, atol=0 if COMM.size == 1 else 1e-11 * largest
        )
    assert run.time == pytest.approx(3e-3)


@pytest.mark.mpi
def test_milestones_are_met_exactly_and_steps_fit_between_them() -> None:
    noted = Steps()
    times = (1.23e-3, 1.23e-3 + 1e-5, 4.56e-3)

    seen: list[float] = []
    looks = Watch(lambda run: seen.append(run.time))
    looks.times = times
    control = gx.StepControl(target_iterations=30, max_factor=2.0)
    run = gx.Simulation(
        fluttering_sheet(COMM),
        gx.Midpoint(dt=1e-4),
        outputs=[noted, looks],
        control=control,
    )
    run.run(until=6e-3)
    assert set(times) <= set(seen) and seen[-1] == 6e-3
    assert min(noted.lengths) >= 9e-6


@pytest.mark.mpi
def test_a_step_that_fails_is_cut_and_recovers() -> None:
    """A first step a thousand times too long is cut until it converges; without room to cut, the
    run fails by name."""
    from gossamer_fx.solve.solvers.convergence import Tolerances

    stepper = gx.Midpoint(dt=0.05, tolerances=Tolerances(max_iterations=5))
    run = gx.Simulation(
        fluttering_sheet(COMM), stepper, control=gx.StepControl(target_iterations=8)
    )
    run.run(until=0.05)
    assert run.substeps >= 1 and run.step >= 2
    assert abs(run.energy_error) <= 1e-10
    strict = gx.Simulation(fluttering_sheet(COMM), stepper, control=gx.StepControl(min_step=0.049))
    with pytest.raises(
        gx.StepFailure, match=r"t = 0 s failed, also in sub-steps of 0.025 s: diverged max it"
    ):
        strict.run(until=0.05)


@pytest.mark.parametrize("before", [None, gx.StepControl(max_factor=2.0)])
def test_a_restart_may_bring_another_control(before, tmp_path) -> None:
    scene, _ = oscillator()
    saved = gx.Checkpoints(tmp_path / "saves", every=4)
    run = gx.Simulation(scene, gx.Midpoint(dt=1e-3), control=before, checkpoints=saved)
    run.run(until=4e-3)
    noted = Steps()
    control = gx.StepControl(max_factor=1.5, max_step=1.2e-3)
    rest = gx.Simulation(
        oscillator()[0],
        gx.Midpoint(dt=1e-3),
        control=control,
        outputs=[noted],
        restart=tmp_path / "saves",
    )
    rest.run(until=rest.time + 1e-2)
    assert noted.lengths[0] == pytest.approx(1e-3 if before is None else 1.2e-3, rel=0.1)
    assert max(noted.lengths) < 1.201e-3


@pytest.mark.parametrize("bad", [{"max_factor": 0.9}, {"min_factor": 1.0}])
def test_bad_requests(bad: dict) -> None:
    with pytest.raises(gx.InputError, match=f"StepControl: {next(iter(bad))} is"):
        gx.StepControl(**bad)


def test_error_of_a_scene_without_mass_is_refused() -> None:
    tank = gx.Tank(1e-3, gas=gx.IdealGas(gamma=1.4, R=287.0), pressure=1e5, temperature=300.0)
    with pytest.raises(gx.InputError, match="nothing in the scene has mass"):
        gx.Simulation(gx.Scene(tank), gx.Midpoint(dt=1e-3), control=gx.StepControl(error=1e-3))


def test_a_rest_that_is_a_millionth_of_a_step_is_one_short_step():
    """Its number of equal steps would be rounded to zero."""
    scene, _ = oscillator()
    run = gx.Simulation(scene, gx.Midpoint(dt=1e-3))
    run.run(until=1e-3)
    run.run(until=1e-3 + 1e-10)
    assert run.time == 1e-3 + 1e-10
    assert run.step == 2
    assert abs(run.energy_error) < 1e-12 * run.totals.energy


# ---- the error that is reached, by stepper -------------------------------------------------------

GRAVITY = np.array([0.0, 0.0, -9.81])

# Masses [kg] at the start, springs between numbers of masses or a point, and gravity.
OSCILLATOR = ([(1.0, (0.3, 0.0, 0.0))], [(0, (0.0, 0.0, -3.0), 40.0, 2.5)], False)
PENDULUM = ([(2.0, (0.8, 0.0, -0.6))], [(0, (0.0, 0.0, 0.0), 400.0, 1.0)], True)
PAIR = (
    [(1.0, (0.5, 0.0, -1.0)), (3.0, (0.5, 0.8, -1.5))],
    [(0, (0.0, 0.0, 0.0), 90.0, 1.0), (0, 1, 60.0, 0.7)],
    True,
)
STEPPERS = {
    "midpoint": gx.Midpoint(1e-3),
    "stress at the end": gx.Midpoint(1e-3, rule=gx.steppers.EndPoint()),
    "variational": gx.steppers.VariationalMidpoint(1e-3),
    **{f"ρ = {ρ}": gx.GeneralizedAlpha(1e-3, spectral_radius=ρ) for ρ in (0.0, 0.5, 0.8, 1.0)},
}


class States(Steps):
    """Notes the time, positions and velocities of masses after each step."""

    def __init__(self, masses: list[gx.PointMass]) -> None:
        super().__init__()
        self._masses = masses
        self.states: list[tuple[float, np.ndarray, np.ndarray]] = []

    def record(self, run: gx.Simulation, last: bool) -> None:
        parts = [run.system.unknowns.state[mass] for mass in self._masses]
        x = np.vstack([part.positions() for part in parts])
        v = np.vstack([part.rates().reshape(-1, 3) for part in parts])
        self.states.append((run.time, x.copy(), v.copy()))


def masses_on_springs(scene, *others):
    points, springs, falls = scene
    masses = [gx.PointMass(m, at, name=f"mass {k}") for k, (m, at) in enumerate(points)]
    items = [gx.Gravity(mass, tuple(GRAVITY)) for mass in masses if falls]
    for k, (one, other, stiffness, length) in enumerate(springs):
        end = gx.Ground(other) if isinstance(other, tuple) else masses[other].port()
        items.append(
            gx.connectors.Spring(
                masses[one].port(), end, stiffness=stiffness, length=length, name=f"spring {k}"
            )
        )
    return masses, gx.Scene(*masses, *items, *others)


def exact_step(scene, x, v, h):
    """Positions (n, 3) after a time h from positions and velocities, by another program."""
    points, springs, falls = scene
    m = np.array([mass for mass, _ in points])

    def rates(_, y):
        x, v = y.reshape(2, -1, 3)
        a = np.tile(GRAVITY if falls else np.zeros(3), (len(m), 1))
        for one, other, stiffness, length in springs:
            d = x[one] - (np.array(other) if isinstance(other, tuple) else x[other])
            distance = np.linalg.norm(d)
            pull = -stiffness * (distance - length) * d / distance
            a[one] += pull / m[one]
            if not isinstance(other, tuple):
                a[other] -= pull / m[other]
        return np.stack([v, a]).ravel()

    y0 = np.stack([x, v]).ravel()
    found = solve_ivp(rates, (0, h), y0, rtol=1e-11, atol=1e-13)
    return found.y[:, -1].reshape(2, -1, 3)[0]


@pytest.mark.parametrize(
    "scene", [OSCILLATOR, PENDULUM, PAIR], ids=["oscillator", "pendulum", "pair"]
)
@pytest.mark.parametrize("name", STEPPERS)
def test_the_error_that_is_reached_is_the_one_that_was_asked_for(name, scene):
    """The largest local error of a step is within a factor of 2 of the tolerance, for steppers of
    any error constant, also where a mass of 10 t rests far away."""
    tolerance = 1e-5
    far = gx.PointMass(1e4, (1e3, 0.0, 0.0), name="far")
    with_and_without = [()]
    if name == "midpoint":
        with_and_without.append((far,))
    for others in with_and_without:
        masses, compiled = masses_on_springs(scene, *others)
        control = gx.StepControl(error=tolerance, target_iterations=50, max_factor=1.5)
        noted = States(masses)
        run = gx.Simulation(compiled, STEPPERS[name], outputs=[noted], control=control)
        run.run(until=1.6)
        m = np.array([mass for mass, _ in scene[0]])
        reached = []
        # The last steps are shortened to meet the end.
        for before, after in itertools.pairwise(noted.states[10:-2]):
            exact = exact_step(scene, before[1], before[2], after[0] - before[0])
            squares = ((after[1] - exact) ** 2).sum(axis=1)
            reached.append(math.sqrt(m @ squares / m.sum()))
        assert len(reached) > 20
        assert 0.5 < tolerance / max(reached) < 2
