"""Bodies in motion whose temperature changes: heat closes the energy balance, and momenta stay."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet
from tests.small_scenes import momentum_changes, run_until, thrown

ThermalExpansion = gx.materials.ThermalExpansion
NUMBERS = {"density": 1400.0, "thickness": 1e-4}
LAWS = {
    "tension field": gx.TensionField(1e9, 0.3, **NUMBERS),
    "residual stiffness": gx.Miyazaki(1e9, 0.3, residual_stiffness=1e-2, **NUMBERS),
    "never wrinkles": gx.Linear(1e9, 0.3, **NUMBERS),
    "fabric": gx.Orthotropic(1e9, 1e8, 0.3, 5e7, direction=(1.0, 0.3, 0.0), **NUMBERS),
}
TIGHT = gx.Tolerances(relative=1e-12)


def waves(X: np.ndarray, t: float) -> np.ndarray:
    """A temperature [K] that swings by 100 K, more on one side."""
    # 100 K on a coefficient of 2e-5: strains of 2e-3, as large as those of the motion.
    return 293.15 + 100.0 * np.sin(40.0 * t) * (1 + X[0])


def sheet_in_flight(comm, law: str, order: int, steps: int, n: int = 4) -> gx.Simulation:
    # Fabric expands differently along warp and weft.
    alpha = (2e-5, 5e-6) if law == "fabric" else 2e-5
    film = gx.Membrane(
        sheet(comm, n, n),
        LAWS[law],
        order=order,
        velocity=thrown,
        thermal=ThermalExpansion(alpha, waves),
    )
    return run_until(steps * 1e-3, film, dt=1e-3, tolerances=TIGHT)


def momentum_error(run: gx.Simulation) -> float:
    """Largest change of momentum or angular momentum [kg m/s, kg m²/s]."""
    # Of the larger one, as both must stay.
    return max(momentum_changes(run))


@pytest.mark.mpi(1)
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("law", LAWS)
def test_a_free_sheet_closes_its_balance_by_heat(comm, law: str, order: int) -> None:
    run = sheet_in_flight(comm, law, order, steps=25)
    assert abs(run.energy_error) < 1e-11
    assert momentum_error(run) < 1e-13
    # There is something to close: without the heat the balance would be open by this.
    assert abs(run.totals.supplied) > 1e-4 * run.totals.energy


@pytest.mark.parametrize("law", ["tension field", "fabric"])
def test_it_does_so_for_a_thousand_steps(law: str) -> None:
    run = sheet_in_flight(MPI.COMM_SELF, law, order=1, steps=1000)
    assert run.step == 1000
    # A thousand steps, each solved to 1e-12.
    assert abs(run.energy_error) < 1e-9
    assert momentum_error(run) < 1e-12


def test_a_plate_with_a_gradient_closes_its_balance(comm) -> None:
    """Mean temperature, temperature across the thickness, and a rest curvature, all at once."""
    law = gx.Linear(2e9, 0.3, density=1400.0, thickness=1e-3)
    expansion = ThermalExpansion(
        1e-4,
        lambda X, t: 293.15 + 20 * np.sin(30 * t) * X[0],
        gradient=lambda X, t: 20 * np.sin(60 * t) * (1 + X[0]),
    )
    plate = gx.Plate(
        sheet(comm, 4, 4),
        law,
        thermal=expansion,
        rest_curvature=np.diag((0.1, 0.0, 0.0)),
        velocity=thrown,
    )
    run = run_until(0.05, plate, dt=1e-3, tolerances=TIGHT)
    assert abs(run.energy_error) < 1e-11
    assert momentum_error(run) < 1e-12


def test_a_clamped_plate_with_a_gradient_closes_its_balance(comm) -> None:
    law = gx.Linear(2e9, 0.3, density=1400.0, thickness=1e-3)
    expansion = ThermalExpansion(1e-4, gradient=lambda X, t: 20 * np.sin(60 * t) * (1 + X[0]))
    plate = gx.Plate(sheet(comm, 4, 4), law, thermal=expansion)
    scene = gx.Scene(plate, gx.Fixed(plate, "left", rotation=True))
    run = gx.Simulation(scene, gx.Midpoint(dt=1e-3, tolerances=TIGHT))
    run.run(until=0.05)
    # The clamp is warped against its support: heat does work on it.
    assert run.totals.supplied > 0
    assert abs(run.energy_error) < 1e-10


@pytest.mark.mpi(1)
@pytest.mark.parametrize("kind", ["cable", "slack cable", "table", "beam"])
def test_lines_close_their_balance(comm, kind: str) -> None:
    curve = line(comm, [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)], 6)
    expansion = ThermalExpansion(2e-5, waves)

    def swinging(X: np.ndarray) -> np.ndarray:
        return np.vstack([0 * X[0], 3 * np.sin(3 * X[0]), X[0]])

    if kind == "beam":
        section = gx.sections.tube(0.02, 5e-4, E=100e9, nu=0.3, density=1560.0)
        body = gx.Beam(curve, section, thermal=expansion, velocity=swinging)
    else:
        law = {
            "cable": gx.CableLaw(1e4, 0.01),
            "slack cable": gx.TensionOnly(1e4, 0.01),
            "table": gx.TabulatedCable([0.0, 1e-3, 5e-2], [0.0, 5.0, 900.0], line_density=0.01),
        }[kind]
        body = gx.Cable(curve, law, thermal=expansion, velocity=swinging)
    run = run_until(0.05, body, dt=1e-3, tolerances=TIGHT)
    assert run.totals.supplied != 0
    assert abs(run.energy_error) < 1e-10


def heated_film(comm, law: str) -> gx.Membrane:
    """A film that is thrown while its temperature changes."""
    return gx.Membrane(
        sheet(comm, 4, 4),
        LAWS[law],
        velocity=thrown,
        thermal=ThermalExpansion(2e-5, waves),
    )


@pytest.mark.parametrize("tension_only", [False, True])
def test_damping_counts_beside_heat(comm, tension_only: bool) -> None:
    film = heated_film(comm, "residual stiffness")
    damping = gx.Damping(film, stiffness_factor=1e-4, tension_only=tension_only)
    run = run_until(0.03, film, damping, dt=1e-3, tolerances=TIGHT)
    assert run.totals.dissipated > 0
    assert abs(run.energy_error) < 1e-11


def test_generalized_alpha_follows_the_same_motion(comm) -> None:
    """Both are of second order: their difference falls by four or more when steps are halved."""

    def ends(stepper) -> np.ndarray:
        film = gx.Membrane(
            sheet(MPI.COMM_SELF, 3, 3),
            LAWS["never wrinkles"],
            thermal=ThermalExpansion(2e-5, lambda X, t: 293.15 + 2e3 * t**2 * (1 + X[0])),
        )
        held = gx.Fixed(film, "left")
        run = gx.Simulation(gx.Scene(film, held), stepper)
        run.run(until=0.02)
        return run.system.unknowns.q0.array_r.copy()

    differences = []
    for dt in (1e-4, 5e-5):
        tolerances = gx.Tolerances(relative=1e-10)
        midpoint = ends(gx.Midpoint(dt=dt, tolerances=tolerances))
        other = ends(gx.GeneralizedAlpha(dt=dt, tolerances=tolerances))
        differences.append(float(np.abs(midpoint - other).max()))
    # 4 for two methods of second order, less what higher terms take.
    assert differences[0] / differences[1] > 3.5


def test_the_gradient_of_a_heated_run(comm) -> None:
    """The derivative by the coefficient of expansion through steps, against central differences."""

    def tape_of(alpha: float) -> tuple[gx.Simulation, gx.analysis.RunTape]:
        film = gx.Membrane(
            sheet(MPI.COMM_SELF, 3, 3),
            LAWS["never wrinkles"],
            velocity=thrown,
            thermal=ThermalExpansion(alpha, waves),
        )
        run = gx.Simulation(gx.Scene(film), gx.Midpoint(dt=1e-3, tolerances=TIGHT))
        tape = gx.analysis.RunTape(run)
        run.run(until=0.02)
        return run, tape

    def objective(run: gx.Simulation) -> gx.probes.Position:
        film = run.scene.bodies[0]
        return gx.probes.Position(film.port_at((1.0, 1.0, 0.0)), axis="x")

    # A coefficient ten times that of a film, so that the result depends on it visibly.
    alpha = 2e-4
    run, tape = tape_of(alpha)
    of = objective(run)
    derivative = gx.analysis.gradient(tape, of=of, by=["film.alpha"])["film.alpha"].values[0]
    values = []
    for factor in (1 + 1e-3, 1 - 1e-3):
        other, _ = tape_of(alpha * factor)
        values.append(objective(other)(other))
    difference = (values[0] - values[1]) / (2e-3 * alpha)
    # Central differences with 1e-3: a relative truncation error of 1e-6, and round-off above it.
    assert derivative == pytest.approx(difference, rel=1e-4)


@pytest.mark.mpi
def test_steps_that_are_undone_leave_the_balance_closed(comm) -> None:
    """Step control takes steps back, with the temperatures of their ends."""
    film = heated_film(comm, "never wrinkles")
    control = gx.StepControl(error=1e-7, max_step=4e-3)
    run = run_until(0.03, film, dt=2e-3, tolerances=TIGHT, control=control)
    assert run.substeps > 0
    assert abs(run.energy_error) < 1e-11
