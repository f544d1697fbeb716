"""Films, cables and beams whose stiffness relaxes: exact relaxation, energy balance, restarts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.mechanics.loads.viscoelasticity import StepWeights, loss_of
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


def wrinkling(comm):
    law = gx.Miyazaki(1e6, 0.3, density=1000.0, thickness=1e-3, residual_stiffness=1e-3)
    return gx.Membrane(irregular_sheet(comm, 4, 2, 0.6, 0.3), law, velocity=spun)


def tension_field(comm):
    law = gx.TensionField(1e6, 0.3, density=1000.0, thickness=1e-3)
    return gx.Membrane(irregular_sheet(comm, 4, 2, 0.6, 0.3), law, velocity=spun)


def woven(comm):
    law = gx.Orthotropic(
        1e6, 5e5, 0.2, 1e5, density=1000.0, thickness=1e-3, direction=(1.0, 0.3, 0.0)
    )
    return gx.Membrane(irregular_sheet(comm, 4, 2, 0.6, 0.3), law, velocity=spun)


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
@pytest.mark.parametrize("make", [film, cable, beam, wrinkling, tension_field, woven])
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
@pytest.mark.parametrize("make", [film, wrinkling])
def test_a_restart_goes_on_from_the_strains_of_the_branches(comm, make, tmp_path):
    folder = comm.bcast(str(tmp_path), root=0)
    whole = thrown(make(comm))
    whole.run(until=4e-3)
    first = thrown(make(comm), checkpoints=gx.Checkpoints(folder, every=10))
    first.run(until=2e-3)
    second = thrown(make(comm), restart=folder)
    second.run(until=4e-3)
    assert second.totals.losses == pytest.approx(whole.totals.losses, rel=1e-9)
    assert second.system.unknowns.q0.array_r == pytest.approx(
        whole.system.unknowns.q0.array_r, abs=1e-13
    )


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
        sheets.append(equilibrium.system.unknowns.q0.array_r.copy())
    assert sheets[1] == pytest.approx(sheets[0], abs=1e-12)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (
            lambda m: (gx.Membrane(m, LAW), (1.0,), (1.0, 2.0)),
            "ratios has 1 and times has 2 entries",
        ),
        (lambda m: (gx.Membrane(m, LAW), (), ()), r"ratios is \(\)"),
        (lambda m: (gx.Membrane(m, LAW), (1.0,), (0.0,)), "entries are each a positive number"),
        (lambda m: (gx.Plate(m, LAW), (1.0,), (1.0,)), "bending branches do not act on"),
        (
            lambda m: (
                gx.Membrane(m, gx.materials.NeoHooke(1e6, density=1e3, thickness=1e-3)),
                (1.0,),
                (1.0,),
            ),
            "neither quadratic in the strain nor one that is when the film is taut",
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
    found = [compiled.without_gradient() for compiled in run.system.equations.differentiable]
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


# ---- films that wrinkle, and damping that is flat over a band ------------------------------------

STRETCH = 2e-3  # of a strip that is taut


def stretched(law, motion, *items, dt):
    """A sheet of which all nodes are moved: strains (e11, e22) as a function of time."""

    def move(X, t):
        along, across = (math.sqrt(1 + 2 * e) - 1 for e in motion(t))
        return np.stack([along * X[0], across * X[1], 0 * X[0]])

    # Branches are relaxed in the strain of the start.
    at_start = lambda X: move(X, 0.0)  # noqa: E731
    body = gx.Membrane(sheet(MPI.COMM_SELF, 2, 2, 0.2, 0.1), law, displacement=at_start)
    relaxing = [item(body) for item in items]
    grip = gx.Fixed(body, "film", motion=move)
    return gx.Simulation(gx.Scene(body, grip, *relaxing), gx.Midpoint(dt=dt, tolerances=TIGHT))


@pytest.mark.parametrize("x", [1e-9, 1e-3, 0.5, 0.999, 1.001, 3.0, 50.0])
def test_the_weights_of_a_step_are_those_of_a_steady_rate(x):
    """z' = 1 - z/τ and the mean of z, by 2000 steps of the trapezoidal rule on each."""
    weights = StepWeights.of(x, 1.0)
    t = np.linspace(0.0, x, 2001)
    z = -np.expm1(-t) / x
    assert weights.change == pytest.approx(z[-1], rel=1e-13)
    assert weights.mean == pytest.approx(np.trapezoid(z, t) / x, rel=1e-6 + 1e-6 * x**2)
    # The loss is positive whatever the strains: a matrix (z0, Δe) without a negative eigenvalue.
    of_both = (1 - weights.decay) * weights.change
    of_change = 2 * weights.mean - weights.change**2
    of_start = (1 - weights.decay) * (1 + weights.decay)
    loss = np.array([[of_start, of_both], [of_both, of_change]])
    assert np.linalg.eigvalsh(loss)[0] > -1e-15


@pytest.mark.parametrize("share", [1e-4, 0.3, 20.0])
def test_a_steady_rate_is_exact_for_steps_of_any_length(share):
    """z = ė τ (1 - exp(-t/τ)) in steps that are short and long compared with τ."""
    tau = 1e-2
    rate = 0.05
    branch = lambda body: gx.loads.Viscoelasticity(body, ratios=(0.5,), times=(tau,))  # noqa: E731
    run = stretched(LAW, lambda t: (rate * t, 0.0), branch, dt=share * tau)
    run.run(until=4 * share * tau)
    z = rate * tau * -math.expm1(-run.time / tau)
    stored = 0.5 * LAW.E * LAW.thickness / (1 - LAW.nu**2) * z**2 / 2 * 0.02
    assert run.totals.stored["viscoelasticity"] == pytest.approx(stored, rel=1e-8)
    work = run.totals.stored["film"] + stored + run.totals.losses["viscoelasticity"]
    assert run.totals.supplied == pytest.approx(work + run.totals.kinetic, rel=1e-8)


def test_a_branch_that_relaxes_within_a_step_is_a_viscosity(comm):
    """r τ in place of the damping time, also in motions that steps do not resolve."""
    lost = []
    for relaxes in (False, True):
        body = film(comm)
        damping = gx.Damping(body, stiffness_factor=1e-6)
        if relaxes:
            damping = gx.loads.Viscoelasticity(body, ratios=(1e3,), times=(1e-9,), name="damping")
        run = gx.Simulation(gx.Scene(body, damping), gx.Midpoint(dt=2e-4, tolerances=TIGHT))
        run.run(until=4e-3)
        lost.append(run.totals.losses["damping"])
    assert lost[1] == pytest.approx(lost[0], rel=1e-3)


@pytest.mark.parametrize("h", [1e-4, 8e-4])
def test_steps_that_do_not_resolve_a_mode_damp_it_as_the_page_says(h):
    """A mode of 80 kHz in steps of some cycles: in each step 4 β/h of its energy is lost by a
    damping time β, and 1.1 η by a loss factor η that is flat to 1/h or beyond."""
    law = gx.Linear(2.5e9, 0.34, density=1420.0, thickness=25e-6)
    lost = []
    for damping in (
        lambda film: gx.Damping(film, stiffness_factor=1e-6),
        lambda film: gx.loads.flat_damping(film, loss_factor=0.01, band=(1.0, 1e5)),
    ):
        strip = gx.Membrane(
            sheet(MPI.COMM_SELF, 1, 1, 0.01, 0.01), law, velocity=lambda X: [[100.0], [0], [0]] * X
        )
        supports = [gx.Fixed(strip, "left"), gx.Fixed(strip, "film", components=(1, 2))]
        scene = gx.Scene(strip, damping(strip), *supports)
        run = gx.Simulation(scene, gx.Midpoint(dt=h, tolerances=TIGHT))
        before = run.totals.kinetic
        steps = 300
        run.run(until=steps * h)
        left = run.totals.kinetic + sum(run.totals.stored.values())
        lost.append(1 - (left / before) ** (1 / steps))
    assert lost[0] == pytest.approx(4 * 1e-6 / h, rel=0.05)
    assert lost[1] == pytest.approx(1.1 * 0.01, rel=0.1)


@pytest.mark.parametrize("make", [wrinkling, tension_field, woven])
def test_the_balance_closes_over_a_thousand_steps_of_a_film_that_flutters(comm, make):
    body = make(comm)
    damping = gx.loads.flat_damping(body, loss_factor=0.02, band=(1.0, 1e4))
    run = gx.Simulation(gx.Scene(body, damping), gx.Midpoint(dt=2e-4, tolerances=TIGHT))
    run.run(until=0.2)
    assert run.step >= 1000
    lost = run.totals.losses["damping"]
    assert lost > 1e-3 * run.first.kinetic
    assert abs(run.totals.energy + lost - run.first.energy) < 1e-9 * run.first.kinetic
    scale = np.abs(run.first.angular_momentum).max()
    before = run.first.angular_momentum
    assert run.totals.angular_momentum == pytest.approx(before, abs=1e-9 * scale)


def test_taut_film_relaxes_as_if_it_could_not_wrinkle():
    energies = []
    for law in (gx.Linear, gx.Miyazaki, gx.TensionField):
        made = law(1e6, 0.3, density=1000.0, thickness=1e-3)
        branches = {"ratios": (0.8, 0.3), "times": (2e-3, 2e-2)}
        run = stretched(
            made,
            lambda t: (STRETCH + 1e-3 * math.sin(300 * t), STRETCH),
            lambda body: gx.loads.Viscoelasticity(body, **branches),  # noqa: B023
            dt=1e-4,
        )
        run.run(until=5e-3)
        stress = gx.fields.field_values(
            run, run.system.unknowns.bodies[0], field="stress1", at="end"
        )[1]
        totals = run.totals
        energies.append(
            [totals.losses["viscoelasticity"], totals.stored["viscoelasticity"], stress.max()]
        )
    assert energies[1] == pytest.approx(energies[0], rel=1e-9)
    assert energies[2] == pytest.approx(energies[0], rel=1e-9)


def test_slack_film_has_no_loss():
    """Branches that also act in compression have one."""
    law = gx.TensionField(1e6, 0.3, density=1000.0, thickness=1e-3)
    lost = {}
    for tension_only in (True, False):
        run = stretched(
            law,
            lambda t: (-0.01 - 0.1 * t, -0.01),
            lambda body: gx.loads.Viscoelasticity(
                body,
                ratios=(0.5,),
                times=(1e-2,),
                tension_only=tension_only,  # noqa: B023
            ),
            dt=1e-3,
        )
        run.run(until=0.1)
        lost[tension_only] = run.totals.losses["viscoelasticity"]
    # A steady strain rate, whose stress the branch has after its relaxation time.
    viscous = 0.5 * law.E * law.thickness / (1 - law.nu**2) * 0.1**2 * 1e-2 * 0.085 * 0.02
    assert lost[False] == pytest.approx(viscous, rel=0.02)
    assert lost[True] == 0.0


# Frequency over which a cycle has 400 steps, and what it is measured on.
STATES = {
    "taut": lambda law: (STRETCH, 0.0),
    "wrinkled": lambda law: (STRETCH, -0.05),
}


@pytest.mark.parametrize("frequency", [2.0, 7.0, 100.0, 900.0])
@pytest.mark.parametrize("state", STATES)
def test_the_loss_factor_is_flat_over_its_band(state, frequency):
    """Loss of a cycle over 2π times the amplitude of the strain energy, of taut film, and of film
    with a line of wrinkles, whose stiffness is E t; by the closed form, and 0.02 to 5 %."""
    law = gx.TensionField(1e6, 0.3, density=1000.0, thickness=1e-3)
    amplitude = 2e-4
    start = STATES[state](law)

    def strains(t):
        e11, e22 = start
        return e11 + amplitude * math.sin(2 * math.pi * frequency * t), e22

    band = (1.0, 1e3)
    made = []

    def damping(body):
        made.append(gx.loads.flat_damping(body, loss_factor=0.02, band=band))
        return made[0]

    period = 1 / frequency
    run = stretched(law, strains, damping, dt=period / 400)
    # The first cycles are not steady.
    run.run(until=4 * period)
    ended = run.totals.losses["damping"]
    run.run(until=run.time + period)
    lost = run.totals.losses["damping"] - ended
    stiffness = law.E * law.thickness
    if state == "taut":
        stiffness /= 1 - law.nu**2
    ratios, times = made[0].ratios, made[0].times
    x = 2 * math.pi * frequency * np.array(times)
    loss_modulus = float(np.sum(np.array(ratios) * x / (1 + x**2)))
    closed = loss_modulus * 2 * math.pi * stiffness * amplitude**2 / 2 * 0.02
    assert lost == pytest.approx(closed, rel=2e-3)
    assert loss_of(ratios, times, frequency) == pytest.approx(0.02, rel=0.05)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (
            {"loss_factor": 0.01, "band": (10.0, 1.0)},
            r"band is \(10\.0, 1\.0\), whose number 2 does not fit",
        ),
        ({"loss_factor": 0.01, "band": (0.0, 1.0)}, r"band is \(0\.0, 1\.0\)"),
        ({"loss_factor": 0.5, "band": (1.0, 10.0)}, "loss_factor"),
    ],
)
def test_a_band_that_cannot_be_is_refused(given, words):
    with pytest.raises(gx.InputError, match=words):
        gx.loads.flat_damping(film(MPI.COMM_SELF), **given)


def test_a_loss_factor_at_a_frequency_is_a_damping_time():
    body = film(MPI.COMM_SELF)
    damping = gx.Damping(body, loss_factor=0.02, frequency=50.0)
    assert damping.damping_time == pytest.approx(0.02 / (2 * math.pi * 50.0))
    assert gx.Damping(body, stiffness_factor=1e-4).damping_time == 1e-4
    with pytest.raises(
        gx.InputError, match=r"loss_factor is 0\.02 and frequency is None; give both"
    ):
        gx.Damping(body, loss_factor=0.02)
    with pytest.raises(gx.InputError, match="stiffness_factor and loss_factor are both given"):
        gx.Damping(body, loss_factor=0.02, frequency=50.0, stiffness_factor=0.1)
