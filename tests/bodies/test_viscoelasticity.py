"""Films, cables and beams whose stiffness relaxes: exact relaxation, energy balance, restarts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.plates import irregular_sheet
from gossamer_fx.meshes.sheet import sheet

LAW = gx.Linear(E=1e6, nu=0.3, density=1000.0, thickness=1e-3)
ENDS = ((0.0, 0.0, 0.0), (0.6, 0.0, 0.0))
TIGHT = gx.Tolerances(relative=1e-12)


def spun(X):
    """A spin about z and a stretch in all directions."""
    return np.stack([2 * X[1] + 3 * X[0], -2 * X[0] + 5 * X[0] ** 2, 0.5 * np.sin(8 * X[0])])


def film(comm):
    return gx.Membrane(irregular_sheet(comm, 4, 2, 0.6, 0.3), LAW, order=2, velocity=spun)


def cable(comm):
    return gx.Cable(line(comm, ENDS, 6), gx.CableLaw(1e3, 1.0), velocity=spun)


def beam(comm):
    section = gx.sections.solid_circle(0.01, E=1e7, nu=0.3, density=1000.0)
    return gx.Beam(line(comm, ENDS, 4), section, velocity=spun)


def thrown(body, **options):
    relaxing = gx.loads.Viscoelasticity(body, ratios=(0.8, 0.3), times=(2e-3, 2e-2))
    return gx.Simulation(
        gx.Scene(body, relaxing), gx.Midpoint(dt=2e-4, tolerances=TIGHT), **options
    )


@pytest.mark.mpi(1)
def test_a_standard_linear_solid_relaxes_as_its_exponential(comm):
    """A film is stretched in a millionth of its relaxation time, and held; steps are long."""
    tau = 10.0
    ratio = 0.6
    held = gx.Membrane(sheet(comm, 2, 2, 0.2, 0.1), LAW)
    relaxing = gx.loads.Viscoelasticity(held, ratios=(ratio,), times=(tau,))

    def stretch(X, t):
        share = min(t / (1e-7 * tau), 1.0)
        return share * 1e-3 * np.stack([X[0], 0 * X[0], 0 * X[0]])

    grip = gx.Fixed(held, "film", motion=stretch)
    run = gx.Simulation(gx.Scene(held, relaxing, grip), gx.Midpoint(dt=0.3 * tau))
    run.run(until=1e-7 * tau)
    started = run.time
    e = 1e-3 + 0.5e-6
    elastic = LAW.E * LAW.thickness / (1 - LAW.nu**2) * e**2 / 2 * 0.02
    for _ in range(5):
        run.run(until=run.time + 0.3 * tau)
        left = ratio * elastic * math.exp(-2 * (run.time - started) / tau)
        assert run.totals.stored["film"] == pytest.approx(elastic, rel=1e-9)
        assert run.totals.stored["viscoelasticity"] == pytest.approx(left, rel=1e-6)
    lost = run.totals.losses["viscoelasticity"]
    assert lost == pytest.approx(ratio * elastic - left, rel=1e-6)


@pytest.mark.mpi
@pytest.mark.parametrize("order", [1, 2])
def test_tension_and_stress_are_those_that_a_balance_would_show(comm, order, tmp_path):
    """A load cell between a mass that swings and a cord that relaxes; a film that is held."""
    cord = gx.Cable(line(comm, ENDS, 3), gx.CableLaw(1e3, 1e-9), order=order)
    mass = gx.PointMass(0.1, ENDS[1], comm=comm)
    cell = gx.constraints.BallJoint(mass.port(), cord.port("end"), name="cell")
    strip = gx.Membrane(sheet(comm, 2, 2, 0.2, 0.1), LAW, order=order)
    grip = gx.Fixed(strip, "film", motion=lambda X, t: 1e-3 * (t > 0) * X)
    branches = {"ratios": (0.8, 0.3), "times": (2e-3, 2e-2)}
    scene = gx.Scene(
        gx.loads.Viscoelasticity(cord, name="cord relaxes", **branches),
        gx.loads.Viscoelasticity(strip, name="strip relaxes", **branches),
        gx.Fixed(cord, "start"),
        gx.Gravity(mass, (100.0, 0.0, 0.0)),
        cell,
        grip,
    )
    folder = comm.bcast(str(tmp_path), root=0)
    checkpoints = gx.Checkpoints(folder, every=None)
    run = gx.Simulation(scene, gx.Midpoint(dt=1e-3), checkpoints=checkpoints)
    run.run(until=0.005)
    for state in (run, gx.Simulation(scene, gx.Midpoint(dt=1e-3), restart=folder)):
        measured = abs(gx.probes.JointForce(cell, axis="x")(run))
        assert gx.probes.Tension(cord)(state) == pytest.approx(measured, rel=1e-4)
        stress = gx.fields.field_values(state, strip, field="stress1", at="end")[1]
        relaxed = LAW.E / (1 - LAW.nu) * (1e-3 + 0.5e-6)
        held = [r * math.exp(-4.5e-3 / t) for r, t in zip(*branches.values(), strict=True)]
        assert stress == pytest.approx(relaxed * (1 + sum(held)), rel=0.02)


@pytest.mark.mpi(1)
@pytest.mark.parametrize("make", [film, cable, beam])
def test_a_free_body_loses_what_is_booked_and_keeps_its_momenta(comm, make):
    run = thrown(make(comm))
    first = run.totals
    run.run(until=0.01)
    lost = run.totals.losses["viscoelasticity"]
    assert lost > 1e-3 * first.kinetic and run.substeps == 0
    assert abs(run.totals.energy + lost - first.energy) < 1e-10 * first.kinetic
    scale = np.abs(first.angular_momentum).max()
    assert run.totals.angular_momentum == pytest.approx(first.angular_momentum, abs=1e-10 * scale)
    assert run.totals.momentum == pytest.approx(first.momentum, abs=1e-10 * scale)


@pytest.mark.mpi(1)
def test_a_restart_goes_on_from_the_strains_of_the_branches(comm, tmp_path):
    folder = comm.bcast(str(tmp_path), root=0)
    whole = thrown(film(comm))
    whole.run(until=4e-3)
    first = thrown(film(comm), checkpoints=gx.Checkpoints(folder, every=10))
    first.run(until=2e-3)
    second = thrown(film(comm), restart=folder)
    second.run(until=4e-3)
    assert second.totals.losses == pytest.approx(whole.totals.losses, rel=1e-9)
    assert second.system.q0.array_r == pytest.approx(whole.system.q0.array_r, abs=1e-13)


def test_at_rest_the_branches_have_relaxed():
    sheets = []
    for relaxes in (False, True):
        pulled = gx.Membrane(sheet(MPI.COMM_WORLD, 2, 2, 0.2, 0.1), LAW)
        items = [pulled, gx.Fixed(pulled, "left")]
        items.append(gx.loads.EdgeLoad(pulled, "right", force=(5.0, 0.0, 0.0)))
        if relaxes:
            items.append(gx.loads.Viscoelasticity(pulled, ratios=(2.0,), times=(1.0,)))
        equilibrium = gx.Equilibrium(gx.Scene(*items))
        equilibrium.find()
        sheets.append(equilibrium.system.q0.array_r.copy())
    assert sheets[1] == pytest.approx(sheets[0], abs=1e-12)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda m: (gx.Membrane(m, LAW), (1.0,), (1.0, 2.0)), "1 ratios and 2 times"),
        (lambda m: (gx.Membrane(m, LAW), (), ()), "0 ratios and 0 times"),
        (lambda m: (gx.Membrane(m, LAW), (1.0,), (0.0,)), "entries are each a positive number"),
        (lambda m: (gx.Plate(m, LAW), (1.0,), (1.0,)), "bending does not relax"),
        (
            lambda m: (
                gx.Membrane(m, gx.TensionField(1e6, 0.3, density=1e3, thickness=1e-3)),
                (1.0,),
                (1.0,),
            ),
            "not quadratic in the strain",
        ),
        (
            lambda m: (
                gx.Membrane(m, LAW, thermal=gx.materials.ThermalExpansion(1e-5, 300.0)),
                (1.0,),
                (1.0,),
            ),
            "has thermal expansion",
        ),
    ],
)
def test_what_does_not_relax_is_refused(make, words):
    body, ratios, times = make(sheet(MPI.COMM_WORLD, 2, 2))
    with pytest.raises(gx.InputError, match=words):
        gx.loads.Viscoelasticity(body, ratios=ratios, times=times)


def test_a_gradient_is_refused_by_name():
    run = thrown(film(MPI.COMM_WORLD))
    found = [compiled.without_gradient() for compiled in run.system.differentiable]
    assert any("'viscoelasticity' depends on its history" in words for words in found)


def test_a_method_of_first_order_for_it_says_so(comm, caplog):
    body = cable(comm)
    relaxing = gx.loads.Viscoelasticity(body, ratios=(0.8,), times=(2e-3,), name="branch")
    gx.Simulation(gx.Scene(body, relaxing), gx.GeneralizedAlpha(dt=2e-4))
    if comm.rank == 0:
        assert "('branch'), for which this method is of first order only" in caplog.text
    caplog.clear()
    gx.Simulation(gx.Scene(body), gx.GeneralizedAlpha(dt=2e-4))
    assert "first order" not in caplog.text
