"""Reduced films: conservation, error compared with the film, and refused input."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from demos.methods.reduced_sail import SPIN as DEMO_SPIN
from demos.methods.reduced_sail import film as demo_film
from demos.methods.reduced_sail import main, saddle, steady
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.records.fields.fields import FieldFunctions
from gossamer_fx.records.fields.film_states import AreaFractions
from gossamer_fx.records.outputs.description import describe
from tests.small_scenes import momentum_changes, run_until

COMM = MPI.COMM_WORLD
# rad/s and m.
SPIN = 1.0
SIDE = 2.0
LAW = gx.Miyazaki(E=2e8, nu=0.3, density=1400.0, thickness=1e-5)
CORNERS = [(x, y, 0.0) for x in (0.0, SIDE) for y in (0.0, SIDE)]


def sail(cells: int = 6, amplitude: float = 0.02, order: int = 1, **options) -> gx.Membrane:
    """A square that spins about its middle and swings out of its plane."""

    # A saddle-shaped velocity, which the basis must learn from the snapshots.
    def velocity(X: np.ndarray) -> np.ndarray:
        x = X[0] - SIDE / 2
        y = X[1] - SIDE / 2
        return np.stack([-SPIN * y, SPIN * x, amplitude * x * y])

    mesh = sheet(COMM, cells, cells, SIDE, SIDE)
    return gx.Membrane(mesh, LAW, order=order, velocity=velocity, **options)


def flight(film: gx.Membrane, outputs=(), dt: float = 0.02, **options) -> gx.Simulation:
    """With a mass at each corner, in free flight."""
    ports = [film.port_at(corner) for corner in CORNERS]
    tips = [
        gx.PointMass(0.05, tuple(p.initial()), velocity=tuple(p.initial_rate()), name=f"tip {k}")
        for k, p in enumerate(ports)
    ]
    joints = [
        gx.constraints.BallJoint(p, t.port(), name=f"joint {k}")
        for k, (p, t) in enumerate(zip(ports, tips, strict=True))
    ]
    return gx.Simulation(
        gx.Scene(film, *tips, *joints),
        gx.Midpoint(dt=dt),
        outputs=list(outputs),
        **options,
    )


@pytest.fixture(scope="module")
def recorded() -> tuple[gx.Membrane, gx.reduction.Snapshots]:
    film = sail()
    shapes = gx.reduction.Snapshots(film, every=2)
    flight(film, [shapes]).run(until=2.0)
    return film, shapes


@pytest.mark.mpi
def test_contact_of_a_reduced_sail_is_refused_and_its_pressure_zero(recorded) -> None:
    film, shapes = recorded
    reduced = gx.reduction.reduce(film, [shapes], modes=6)
    with pytest.raises(gx.InputError, match=r"bodies\[0\] is of the kind ReducedMembrane"):
        gx.Contact(reduced, distance=1e-3)
    fields = FieldFunctions(
        gx.Simulation(gx.Scene(reduced), gx.Midpoint(dt=0.1)).system, reduced, ["contact_pressure"]
    )
    fields.update()
    assert not np.abs(fields.functions[0].x.array).max(initial=0.0)


@pytest.mark.mpi(1)
@pytest.mark.parametrize("cells", [None, 25])
# All cells, or a sample of 25: sampling may cost accuracy, but no conservation.
def test_a_reduced_sail_conserves_what_the_film_does(recorded, cells) -> None:
    film, shapes = recorded
    run = flight(gx.reduction.reduce(film, [shapes], modes=8, cells=cells))
    run.run(until=2.0)
    # Newton's method had work to do, and the film was strained.
    assert run.iterations > 2 * run.step and run.totals.stored["film"] > 0
    assert abs(run.energy_error) < 1e-11
    assert max(momentum_changes(run)) < 1e-12 * np.abs(run.first.angular_momentum).max()


@pytest.mark.mpi
def test_more_cells_miss_less_of_the_stiffness(recorded) -> None:
    film, shapes = recorded
    few, more = (
        gx.reduction.reduce(film, [shapes], modes=8, cells=cells).sample for cells in (10, 25)
    )
    assert len(few.cells) <= 10 and (few.weights > 0).all()
    # Positive weights keep the sampled energy convex; more cells, less error.
    assert more.error < few.error < 1 and COMM.allreduce(len(more.cells)) > COMM.allreduce(
        len(few.cells)
    )


@pytest.mark.mpi
def test_mass_momentum_and_energy_at_the_start_are_the_films(recorded) -> None:
    film, shapes = recorded
    full, reduced = (
        gx.Simulation(gx.Scene(b), gx.Midpoint(dt=0.1))
        for b in (film, gx.reduction.reduce(film, [shapes], modes=12))
    )
    assert reduced.totals.angular_momentum == pytest.approx(
        full.totals.angular_momentum, rel=1e-6, abs=1e-9
    )
    assert reduced.totals.kinetic == pytest.approx(full.totals.kinetic, rel=1e-3)
    limit = full.totals.kinetic * (1 + 1e-12)
    assert reduced.totals.kinetic <= limit  # the projection leaves out, it adds nothing


@pytest.mark.parametrize("stress", [None, lambda X: 1e4 * (1 + X[0])])
def test_with_all_modes_it_is_the_film(stress) -> None:
    film = sail(cells=2, initial_stress=stress)
    noise = gx.reduction.Snapshots(film)
    rng = np.random.default_rng(3)
    # Nine nodes: with noise as snapshots the six modes and the rotation span all motions.
    noise.positions += [rng.standard_normal((9, 3)) for _ in range(4)]
    full = flight(film)
    reduced = flight(gx.reduction.reduce(film, [noise], modes=6))
    for run in (full, reduced):
        run.run(until=0.4)
    assert reduced.system.unknowns.numbering.size == full.system.unknowns.numbering.size
    # the kernel of the points chooses strains as the film's forms do, but for the first ones of a
    # step
    assert reduced.iterations <= full.iterations + 2 * reduced.step
    x = reduced.scene.bodies[0]
    shape = (
        x.basis.values
        @ reduced.system.unknowns.q0.array_r[reduced.system.unknowns.numbering.owned(0)].reshape(
            -1, 3
        )
    ).ravel()
    # The same discrete problem in other coordinates.
    error = np.abs(
        shape - full.system.unknowns.q0.array_r[full.system.unknowns.numbering.owned(0)]
    ).max()
    assert error < 1e-9


def test_more_modes_come_closer(recorded) -> None:
    # this film is set spinning without tension and flutters: of its 46 modes it needs more than a
    # taut one does
    film, shapes = recorded
    errors = []
    for modes in (6, 18, 36):
        reduced = gx.reduction.reduce(film, [shapes], modes=modes)
        run = flight(reduced)
        run.run(until=0.4)
        c = run.system.unknowns.q0.array_r[run.system.unknowns.numbering.owned(0)].reshape(-1, 3)
        errors.append(
            np.abs(reduced.basis.values[: len(shapes.positions[0])] @ c - shapes.positions[10])[
                :, 2
            ].max()
        )
    assert errors[2] < errors[1] < errors[0]
    # 1 % of the largest deflection, with 36 of 46 modes.
    assert errors[2] < 0.01 * np.abs(shapes.positions[10][:, 2]).max()


def test_devices_on_the_film_are_on_the_reduced_one_too() -> None:
    heavy = {"density": lambda X: np.where(X[0] > 1.0, 5000.0, 1400.0)}
    film = sail(properties=heavy)
    shapes = gx.reduction.Snapshots(film)
    flight(film, [shapes]).run(until=0.4)
    full = flight(film)
    reduced = flight(gx.reduction.reduce(film, [shapes], modes=24))
    # The basis misses a little of the initial velocity.
    assert reduced.totals.kinetic == pytest.approx(full.totals.kinetic, rel=1e-4)
    for run in (full, reduced):
        run.run(until=0.2)
    assert reduced.totals.stored["film"] == pytest.approx(full.totals.stored["film"], rel=0.02)


@pytest.mark.mpi
def test_fields_are_those_of_the_whole_film(recorded) -> None:
    film, shapes = recorded
    reduced = gx.reduction.reduce(film, [shapes], modes=10, cells=20)
    run = flight(reduced)
    fields = FieldFunctions(run.system, reduced, ("displacement", "stress1"))
    fields.update()
    assert fields.functions[0].function_space.mesh is film.space.mesh
    # The areas of taut, wrinkled and slack film add up to the whole.
    assert AreaFractions([reduced])(run.system).sum() == pytest.approx(1.0)
    # Its shape is that of its nodes, and a port snaps to one of them.
    x = gx.fields.positions(run, reduced)
    owned = film.space.dofmap.index_map.size_local
    np.testing.assert_allclose(
        x, run.system.unknowns.state[reduced].local_positions()[:owned], atol=1e-15
    )
    assert x.shape == (owned, 3)
    low, high = describe(run)["bodies"][reduced.name]["box"]
    assert np.ptp([low, high], axis=0)[:2] == pytest.approx(SIDE, rel=1e-6)
    plane = gx.analysis.best_surface(run, reduced)
    assert plane.area == pytest.approx(SIDE**2, rel=1e-3) and plane.rms < 1e-12
    state = run.system.unknowns.state
    snapped = state.vector(reduced.port_at((0.05 * SIDE, 0.05 * SIDE, 0.0), snap=True))
    corner = state.vector(reduced.port_at(CORNERS[0]))
    np.testing.assert_allclose(snapped, corner, atol=1e-9)
    edge = state.vectors(reduced.ports("bottom"))
    assert np.ptp(edge[:, 0]) == pytest.approx(SIDE, rel=1e-6)


@pytest.mark.mpi
def test_a_restart_goes_on_as_if_nothing_had_happened(recorded, folder: Path) -> None:
    film, shapes = recorded
    reduced = gx.reduction.reduce(film, [shapes], modes=6, cells=20)
    whole = flight(reduced, checkpoints=gx.Checkpoints(folder / "points", every=10))
    whole.run(until=0.2)
    again = flight(reduced, restart=folder / "points")
    for run in (whole, again):
        run.run(until=0.4)
    error = np.abs(whole.system.unknowns.q0.array_r - again.system.unknowns.q0.array_r).max(
        initial=0.0
    )
    assert error < 1e-12


@pytest.mark.mpi
@pytest.mark.parametrize(("cells", "error"), [(None, 1e-3), (20, 0.02)])
# The area of sampled cells is that of the film to their error.
def test_gravity_and_pressure_act_on_it_as_on_the_film(recorded, cells, error) -> None:
    film, shapes = recorded
    reduced = gx.reduction.reduce(film, [shapes], modes=6, cells=cells)
    weight = gx.Gravity(reduced, (0.0, 0.0, -2.0))
    push = gx.Pressure(reduced, 1e-3)
    run = run_until(0.1, reduced, weight, push, dt=0.01)
    mass = reduced.basis.mass
    measured = run.totals.momentum[2]
    # Impulse of pressure on 4 m² less that of the weight, for 0.1 s.
    exact = 0.1 * (1e-3 * SIDE**2 - 2.0 * mass)
    # The film moves as a whole; its bulging turns the pressure slightly.
    assert measured == pytest.approx(exact, rel=error)
    resultant = COMM.allreduce(
        sum(c.resultants().get("pressure", np.zeros((2, 3))) for c in run.system.equations.compiled)
    )
    assert resultant[0, 2] == pytest.approx(1e-3 * SIDE**2, rel=error)
    # Its moment about the origin is that of the force in the middle of the film; the weights of
    # sampled cells are fitted to the area, not to its lever.
    moment = 1e-3 * SIDE**3 / 2
    assert resultant[1, :2] == pytest.approx([moment, -moment], rel=10 * error)
    assert abs(run.energy_error) < 1e-10


def test_what_cannot_be_reduced_is_told_in_one_sentence(recorded) -> None:
    film, shapes = recorded
    for motions, modes, cells, words in (
        ([], 3, None, "no snapshots"),
        ([shapes], 10_000, None, "ask for fewer"),
        ([shapes], 3, 0, "cells is 0"),
    ):
        with pytest.raises(gx.InputError, match=words):
            gx.reduction.reduce(film, motions, modes=modes, cells=cells)
    other = gx.reduction.Snapshots(film)
    other.positions.append(np.zeros((1, 3)))
    with pytest.raises(gx.InputError, match="another mesh"):
        gx.reduction.reduce(film, [other], modes=1)
    with pytest.raises(gx.InputError, match=r"'.*: a reduced film has no group 'left'.*port_at"):
        gx.Scene(gx.Fixed(gx.reduction.reduce(film, [shapes], modes=3), "left")).compile()


def test_shapes_and_fields_that_a_reduced_film_cannot_have_are_told_in_one_sentence(
    tmp_path: Path,
) -> None:
    stiff = gx.Membrane(sheet(COMM, 4, 4), gx.Linear(2e8, 0.3, density=1400.0, thickness=1e-5))
    shapes = gx.reduction.Snapshots(stiff)
    X = stiff.space.tabulate_dof_coordinates()[: stiff.space.dofmap.index_map.size_local]
    shapes.positions += [0.9 * X + np.outer(np.sin(k * X[:, 0]), [0, 0, 0.1]) for k in (3, 5)]
    with pytest.raises(gx.InputError, match="compressed so that its stiffness is negative"):
        gx.reduction.reduce(stiff, [shapes], modes=2, cells=8)
    reduced = gx.reduction.reduce(stiff, [shapes], modes=2)
    relaxing = gx.loads.Viscoelasticity(reduced, ratios=(0.5,), times=(1.0,))
    recording = gx.Recording(tmp_path / "relaxing")
    run = gx.Simulation(gx.Scene(relaxing), gx.Midpoint(dt=1e-3), outputs=[recording])
    run.run(until=1e-3)
    known = gx.plot.RunReader(tmp_path / "relaxing").known_fields()
    assert "strain2" in known and "stress1" not in known
    with pytest.raises(gx.InputError, match="reduced and relaxes is not known"):
        gx.fields.field_values(run, reduced, field="stress1")
    _, strain = gx.fields.field_values(run, reduced, field="strain1")
    assert np.isfinite(strain).all()
    # These ended the program by memory faults.
    with pytest.raises(gx.InputError, match="give an unreduced film"):
        gx.probes.Crossings(reduced)
    air = gx.IdealGas(gamma=1.4, R=287.0)
    bag = gx.Chamber(reduced, gas=air, pressure=1.0, temperature=300.0, dead_volume=1.0)
    with pytest.raises(gx.InputError, match="gas needs the film itself"):
        gx.Simulation(gx.Scene(bag), gx.Midpoint(dt=1e-3))


@pytest.mark.mpi
def test_the_energy_outside_of_the_basis_tells_where_it_does_not_hold(recorded) -> None:
    film, shapes = recorded
    shares = []
    for modes in (6, 30):
        reduced = gx.reduction.reduce(film, [shapes], modes=modes)
        run = flight(reduced)
        run.run(until=0.4)
        shares.append(gx.reduction.OutsideBasis(reduced)(run))
    # Thirty modes leave less than half of what six leave out.
    assert 0 < shares[1] < 0.5 * shares[0]
    with pytest.raises(gx.InputError, match="give a ReducedMembrane"):
        gx.reduction.OutsideBasis(film)


def test_frequencies_of_the_spinning_sail_are_the_films() -> None:
    film = demo_film(COMM, 6, saddle, 0.02)
    found = steady(film, DEMO_SPIN)
    modes = gx.analysis.modes(found, 6, spin=(0.0, 0.0, DEMO_SPIN))
    reduced = gx.reduction.reduce(
        film,
        [gx.analysis.ModeShapes(film, found, modes=modes, height=0.1)],
        modes=5,
    )
    again = gx.analysis.modes(steady(reduced, DEMO_SPIN), 6, spin=(0.0, 0.0, DEMO_SPIN))
    measured = [mode.frequency for mode in again]
    exact = [mode.frequency for mode in modes]
    # Modes of the basis are those of the film; the coupling of spin and deflection errs by 1 %.
    assert measured == pytest.approx(exact, rel=0.01)


@pytest.mark.mpi
def test_it_starts_from_a_shape_of_the_film(recorded) -> None:
    film, shapes = recorded
    reduced = gx.reduction.reduce(film, [shapes], modes=8)
    there = run_until(0.1, film, gx.RigidMotion(velocity=(0.0, 0.0, 1.0)), dt=0.1)
    run = gx.Simulation(gx.Scene(reduced, gx.StartFrom(there.system)), gx.Midpoint(dt=0.1))
    expected, outside = reduced.basis.project(there.system.unknowns.q0.array_r.reshape(-1, 3))
    own = run.system.unknowns.numbering.owned(0)
    measured = run.system.unknowns.q0.array_r[own]
    exact = expected.ravel()[: own.stop - own.start]
    assert measured == pytest.approx(exact, abs=1e-12)
    # 1 m/s for 0.1 s.
    assert expected[0, 2] == pytest.approx(0.1, rel=1e-3) and outside < 1e-3


def test_the_demo_predicts_another_flight() -> None:
    result = main(cells=6, modes=30, training=12.0, until=4.0)
    # The text of the demo states both limits.
    assert result["error"] < 0.1 and result["reduced_unknowns"] < 0.9 * result["unknowns"]
    assert result["energy_error"] < 1e-10 and result["angular_momentum_drift"] < 1e-12
    assert result["energy_error_of_the_long_flight"] < 1e-10
