"""Gradients through contact of two small films, against differences of runs; scenes of all kinds of
contact are in tests/conservation/test_gradients_in_time.py."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import sheet

FILM = {"E": 1e7, "nu": 0.3, "thickness": 1e-4}
DENSITY = 1400.0
SPEED = 8.0
STEP = 2e-5
RUBS = {"friction": 0.4, "slip_velocity": 0.05}


def two_films(upwards=SPEED, density=DENSITY, shift=0.0, order=1, **contact):
    """The lower film rises to the upper one, which is lighter, inclined and turned; a run that ends
    while they touch, and the height of a corner."""
    lower = gx.Membrane(
        sheet(MPI.COMM_SELF, 2, 2, 0.1, 0.1),
        gx.Linear(**FILM, density=density),
        velocity=lambda X: np.vstack([0.5 + 0 * X[0], 3 * X[0], upwards - 40 * X[0]]),
        order=order,
        name="lower",
    )
    upper = gx.Membrane(
        sheet(MPI.COMM_SELF, 2, 2, 0.1, 0.1),
        gx.Linear(**FILM, density=900.0),
        displacement=lambda X: np.vstack(
            [0.011 + 0 * X[0], 0.013 + 0 * X[0], 1.05e-3 + shift + 0.01 * X[0]]
        ),
        name="upper",
    )
    scene = gx.Scene(gx.Contact(lower, upper, distance=1e-3, **contact))
    solved = gx.Tolerances(relative=1e-13)
    run = gx.Simulation(scene, gx.Midpoint(dt=STEP, tolerances=solved))
    return run, gx.probes.Position(upper.port_at((0.0, 0.0, 0.0)), "z")


def height(**given) -> float:
    run, result = two_films(**given)
    run.run(until=12 * STEP)
    return result(run)


def by_difference(given, name, value, change) -> float:
    """The five-point formula for the change of a number by a share of 1."""
    ends = [height(**given | {name: value + k * change}) for k in (-2, -1, 1, 2)]
    return float(np.dot(ends, [1, -8, 8, -1])) / (12 * change)


@pytest.mark.parametrize(
    "contact",
    [{"stiffness": 2e7}, {"stiffness": 2e7, **RUBS}, {}, RUBS, {"order": 2, **RUBS}],
    ids=["given", "given with friction", "chosen", "chosen with friction", "of order 2"],
)
def test_gradients_through_contact_are_those_of_differences(contact):
    run, result = two_films(**contact)
    tape = gx.analysis.RunTape(run)
    run.run(until=12 * STEP)
    # They touch at the end: the energy of contact is not zero.
    assert run.system.equations.active_sets[0].stored_energy() > 0
    names = ["lower.initial_velocity", "upper.initial_position", "lower.density"]
    names += [f"contact.{name}" for name in ("stiffness", "friction") if name in contact]
    found = gx.analysis.gradient(tape, of=result, by=names)

    by_velocity = found["lower.initial_velocity"].values.reshape(-1, 3)[:, 2].sum()
    expected = by_difference(contact, "upwards", SPEED, 1e-4)
    assert by_velocity == pytest.approx(expected, rel=1e-5)
    by_position = found["upper.initial_position"].values.reshape(-1, 3)[:, 2].sum()
    assert by_position == pytest.approx(by_difference(contact, "shift", 0.0, 1e-8), rel=1e-5)
    by_density = found["lower.density"].values[0]
    expected = by_difference(contact, "density", DENSITY, 0.1)
    assert by_density == pytest.approx(expected, rel=1e-5)
    for name in names[3:]:
        what = name.rpartition(".")[2]
        value = contact[what]
        expected = by_difference(contact, what, value, 1e-4 * value)
        assert found[name].values[0] == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("contact", [{}, {"stiffness": 2e7}], ids=["chosen", "given"])
def test_the_gradient_of_the_energy_is_that_at_the_start(contact):
    """Bodies and contact conserve energy, so that the energy in the end, while films touch, has the
    derivatives of the kinetic energy at the start: ½ σ A v² of the lower film."""
    run, _ = two_films(**contact)
    tape = gx.analysis.RunTape(run)
    kinetic = run.totals.kinetic
    run.run(until=12 * STEP)
    names = ["lower.density"] + [f"contact.{name}" for name in contact]
    found = gx.analysis.gradient(tape, of=gx.analysis.Energy(), by=names)
    assert found["lower.density"].values[0] == pytest.approx(kinetic / DENSITY, rel=1e-8)
    for name in names[1:]:
        assert abs(found[name].values[0] * contact["stiffness"]) < 1e-8 * kinetic
