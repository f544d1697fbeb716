"""Cords with a loading and an unloading curve: cycles, steps, statics, ledger, history."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.mechanics.bodies.cord_hysteresis import hysteretic_bar, scaled_hysteretic_bar
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.records.fields.lines import line_forces
from tests.rows import Step, step_of
from tests.small_scenes import at_rest

COMM = MPI.COMM_WORLD
LOADING = (np.array([-0.02, 0.0, 0.01, 0.03]), np.array([-4.0, 0.0, 10.0, 60.0]))
UNLOADING = (np.array([0.0, 0.01, 0.015]), np.array([0.0, 20.0, 60.0]))
CORD = gx.TabulatedCable(*LOADING, line_density=0.1, unloading=UNLOADING)
# Slack up to a third of its last strain, so that a third of each strain is not recovered.
STEEP = (np.array([0.0, 0.005, 0.012, 0.015]), np.array([0.0, 0.01, 15.0, 60.0]))
SCALED = gx.TabulatedCable(*LOADING, line_density=0.1, unloading=STEEP, unloading_rule="scaled")


def cord_step(law: gx.TabulatedCable, x0: Any, x1: Any, largest: Any = 0.0) -> Step:
    """Bars of 1 m without a scene, from engineering strains x0 to x1."""
    numbers = {"length": 1.0} | law.hysteresis.as_numbers()
    bar = scaled_hysteretic_bar if law.unloading_rule == "scaled" else hysteretic_bar
    return step_of(bar, measure(x0), measure(x1), numbers, z0=largest)


def measure(x: Any) -> np.ndarray:
    """ε = ½(λ² - 1) as a column, of engineering strains x."""
    return (((1 + np.atleast_1d(x)) ** 2 - 1) / 2)[:, None]


def test_a_cycle_loses_the_area_between_the_curves() -> None:
    """Up to 2.5 % (47.5 N) and back to zero in 2 × 97 steps: down the upper 47.5 N of the unloading
    curve.  Areas by hand: loading 0.05 + 0.015 · (10 + 47.5)/2, unloading 40 N in 0.5 %, with
    7.5 N left, and 7.5 N at 2 kN."""
    largest = 0.0
    work = 0.0
    loss = 0.0
    path = np.concatenate([np.linspace(0.0, 0.025, 98), np.linspace(0.025, 0.0, 98)])
    for x0, x1 in pairwise(path):
        step = cord_step(CORD, x0, x1, largest)
        work += (step.S * (measure(x1) - measure(x0))).item()
        of_step = step.loss.item()
        assert of_step >= 0
        loss += of_step
        largest = step.history.item()
    loaded = 0.01 * 10 / 2 + 0.015 * (10 + 47.5) / 2
    returned = 0.005 * (47.5 + 7.5) / 2 + 7.5**2 / 2000 / 2
    assert work == pytest.approx(loaded - returned, abs=1e-12)
    assert loss == pytest.approx(loaded - returned, abs=1e-12)


def test_reloading_follows_the_unloading_curve_to_the_turning_point() -> None:
    x = np.array([0.02, 0.0215, 0.024, 0.025, 0.028])
    S = cord_step(CORD, x, x, 0.025).S
    # 47.5 N less 8 kN · 0.5 % at 2 %, slack at 1.625 %, the loading curve beyond 2.5 %.
    force = S[:, 0] * (1 + x)
    assert force == pytest.approx([7.5, 19.5, 39.5, 47.5, 55.0], abs=1e-11)
    assert pytest.approx(0.0, abs=1e-12) == cord_step(CORD, 0.016, 0.016, 0.025).S


@pytest.mark.parametrize("law", [CORD, SCALED], ids=["moved", "scaled"])
def test_work_is_stored_or_lost_on_any_path(law: gx.TabulatedCable) -> None:
    """S Δε = ΔW + loss for any two strains and histories, and dS/dε1 agrees with differences."""
    random = np.random.default_rng(5)
    count = 20000
    largest = random.uniform(0.0, 0.05, count)
    x0 = np.minimum(random.uniform(-0.03, 0.05, count), largest)
    x1 = random.uniform(-0.03, 0.06, count)
    step = cord_step(law, x0, x1, largest)
    resting = cord_step(law, x0, x0, largest)
    change = step.energy - resting.energy + step.loss
    assert (step.S * (measure(x1) - measure(x0)))[:, 0] == pytest.approx(change, abs=1e-13)
    assert step.loss.min() > -1e-13
    δ = 1e-7
    ahead, behind = (cord_step(law, x0, x1 + side * δ, largest).S for side in (1, -1))
    # dε1 = λ1 dx1
    difference = (ahead - behind)[:, 0] / (2 * δ) / (1 + x1)
    far = np.abs(x1 - x0) > 1e-3
    assert difference[far] == pytest.approx(step.dS[far, 0, 0], abs=2e-2)


@pytest.mark.parametrize("largest", [0.008, 0.02, 0.045])
def test_a_scaled_curve_is_as_steep_as_the_force_at_the_reversal_says(largest: float) -> None:
    """N_l(X)/60 N of the curve STEEP at the strain 0.015 x/X: 15 kN at its end, slack from a third
    of the largest strain on."""
    force_there = float(loaded(largest))
    slope = 15e3 * force_there / 60 * 0.015 / largest
    x = largest * np.array([0.2, 1 / 3, 0.8, 0.9, 1.0])
    S = cord_step(SCALED, x, x, largest).S[:, 0] * (1 + x)
    by_hand = [0.0, 0.0, force_there / 4, force_there - slope * 0.1 * largest, force_there]
    assert pytest.approx(by_hand, abs=1e-11) == S


def test_a_cycle_of_a_scaled_curve_loses_a_part_of_the_work_that_only_the_shape_decides() -> None:
    """What STEEP returns is 0.165 J/m of 0.9 J/m, the product of its last strain and force, and so
    is what every scaled curve returns."""
    for largest in (0.02, 0.03):
        out = cord_step(SCALED, 0.0, largest, 0.0)
        back = cord_step(SCALED, largest, 0.0, largest)
        returned = (back.S * measure(largest)).item()
        assert returned == pytest.approx(0.165 / 0.9 * largest * float(loaded(largest)), rel=1e-12)
        loss = (out.loss + back.loss).item()
        assert loss == pytest.approx((out.S * measure(largest)).item() - returned, abs=1e-13)


def loaded(x: float) -> Any:
    """N_l [N] in tension, with its last slope."""
    return 10 + 2500 * (x - 0.01) if x > 0.01 else 1000 * x


def test_never_unloaded_or_with_equal_curves_it_is_the_tabulated_cable() -> None:
    """A cord that is only pulled, and one whose two curves are the same straight line."""
    straight = ([0.0, 0.02], [0.0, 50.0])
    line = gx.TabulatedCable(*straight, line_density=0.1, unloading=straight)
    x = np.linspace(-0.02, 0.04, 31)
    both_ways = np.where(np.arange(30) % 2, -x[1:], x[1:])
    for law, largest, end in ((CORD, 0.0, x[1:]), (line, 0.03, both_ways)):
        start = np.minimum(x[:-1], largest)
        force = law.corners.average(start, end)
        mean = law.hysteresis.average(start, end, np.full(30, largest))
        assert mean == pytest.approx(force, abs=1e-12)
    assert cord_step(line, x[:-1], both_ways, 0.03).loss == pytest.approx(0.0, abs=1e-14)


def ribbon(
    law: gx.TabulatedCable, comm: MPI.Intracomm = COMM, rate: float = 0.0
) -> tuple[gx.Membrane, Any]:
    """A film of no stiffness to speak of, with a cord of 0.5 m along its lower edge; it starts to
    stretch at a rate [1/s]."""
    film = gx.Membrane(
        sheet(comm, 4, 2, 0.5, 0.1),
        gx.TensionField(E=1.0, nu=0.0, density=1.0, thickness=1e-6),
        velocity=lambda X: np.vstack([rate * X[0], 0 * X[0], 0 * X[0]]),
        name="film",
    )
    return film, gx.connectors.Tape.along_edges(film, law, edges="bottom", name="cord")


def drawn_out(law: gx.TabulatedCable, strains: list[float]) -> tuple[gx.Equilibrium, Any, gx.Fixed]:
    """The ribbon at rest, whose right end is held at these strains at the times 0, 1, 2, ...; its
    cord, and the support that holds it."""
    film, cord = ribbon(law)

    def pull(X: np.ndarray, t: float) -> np.ndarray:
        strain = np.interp(t, range(len(strains)), strains)
        return np.vstack([strain * X[0], 0 * X[0], 0 * X[0]])

    right = gx.Fixed(film, "right", motion=pull)
    scene = gx.Scene(film, cord, gx.Fixed(film, "left"), right)
    return gx.Equilibrium(scene), cord, right


@pytest.mark.mpi
def test_equilibria_follow_a_scaled_curve() -> None:
    """To 2 %, back to 1.6 %, and on to 2.8 %."""
    statics, _, right = drawn_out(SCALED, [0.0, 0.02, 0.016, 0.028])
    forces = []
    for k in range(1, 4):
        statics.find(at=float(k))
        forces.append(statics.reaction(right)[0][0])
    assert forces == pytest.approx([35.0, 35.0 / 4, 55.0], rel=1e-6)
    assert statics.totals.losses["cord"] > 0


@pytest.mark.mpi
def test_equilibria_follow_both_curves() -> None:
    """To 2.5 %, back to 2 %, to 2.2 %, and on to 2.8 %: forces of the curves, whatever the
    pseudo-steps, and the loss of loading."""
    statics, cord, right = drawn_out(CORD, [0.0, 0.025, 0.02, 0.022, 0.028])
    forces = []
    for k in range(1, 5):
        statics.find(at=float(k))
        forces.append(statics.reaction(right)[0][0])
        tensions = line_forces(statics.system, cord, "step").tensions
        assert tensions == pytest.approx(forces[-1], rel=1e-6)
    assert forces == pytest.approx([47.5, 7.5, 23.5, 55.0], rel=1e-6)
    lost = 0.5 * CORD.hysteresis.dissipated(np.array(0.028))
    assert statics.totals.losses["cord"] == pytest.approx(lost, rel=1e-6)


def test_a_path_that_turns_goes_back_on_the_unloading_curve() -> None:
    """The end is drawn out by 2.5 %, held for a while, and let back to 2 % in one path: 7.5 N are
    left of 47.5 N."""
    film, cord = ribbon(CORD)

    def drawn(X: np.ndarray, t: float) -> np.ndarray:
        return np.vstack([np.interp(t, range(4), [0.0, 0.025, 0.025, 0.02]) * X[0], 0 * X[:2]])

    held = [gx.Fixed(film, "left"), gx.Fixed(film, "right", motion=drawn, name="end")]
    statics = gx.Equilibrium(gx.Scene(film, cord, *held))
    statics.find(at=0.5)
    probes = {"pull": gx.probes.Reaction(held[1], "x")}
    found = gx.analysis.path(statics, 3.0, start=0.5, first_step=0.3, probes=probes)
    pull = found.columns["pull"]
    assert pull.max() == pytest.approx(47.5, rel=1e-6)
    assert pull[-1] == pytest.approx(7.5, rel=1e-6)


def swinging_mass(comm: MPI.Intracomm = COMM) -> gx.Scene:
    """1 kg on the end of the cord, thrown outwards at 0.5 m/s: it loads the cord to some 2.3 %."""
    film, cord = ribbon(CORD, comm, rate=1.0)
    mass = gx.PointMass(1.0, (0.5, 0.0, 0.0), velocity=(0.5, 0.0, 0.0), comm=comm)
    joint = gx.constraints.BallJoint(mass.port(), film.port_at((0.5, 0.0, 0.0)))
    return gx.Scene(film, cord, mass, joint, gx.Fixed(film, "left"))


def swing(until: float, comm: MPI.Intracomm = COMM, **options: Any) -> gx.Simulation:
    run = gx.Simulation(swinging_mass(comm), gx.Midpoint(dt=5e-4), **options)
    run.run(until=until)
    return run


@pytest.mark.mpi
def test_the_loss_closes_the_energy_balance() -> None:
    run = swing(0.02)
    assert run.totals.losses["cord"] > 1e-3
    run.run(until=0.1)
    assert abs(run.energy_error) < 1e-12
    # The mass comes back with what the unloading curve returns.
    first = 0.5 * 0.5**2
    assert run.totals.losses["cord"] > 0.4 * first
    assert run.totals.kinetic < 0.6 * first


@pytest.mark.mpi
def test_a_restart_in_the_middle_of_the_unloading_curve_goes_on(folder: Path) -> None:
    """On all ranks, and on one."""
    turned = 0.045
    whole = swing(0.06)
    swing(turned, checkpoints=gx.Checkpoints(folder))
    COMM.barrier()
    for comm in (COMM, MPI.COMM_SELF):
        rest = swing(0.06, comm, restart=folder)
        assert rest.totals.losses == pytest.approx(whole.totals.losses, rel=1e-9)
        assert rest.totals.kinetic == pytest.approx(whole.totals.kinetic, rel=1e-9)
        assert abs(rest.energy_error) < 1e-12


def test_gradients_of_equilibria_and_cables_refuse_it_by_name() -> None:
    film, cord = ribbon(CORD)
    statics = at_rest(film, cord, gx.Fixed(film, "left"), gx.Fixed(film, "right"))
    kinds = [
        kind for kind in statics.system.equations.compiled if hasattr(kind, "without_gradient")
    ]
    words = "".join(kind.without_gradient() for kind in kinds)
    assert "'cord' has a history" in words
    with pytest.raises(gx.InputError, match="only a Tape has"):
        gx.Cable(line(COMM, [(0, 0, 0), (1, 0, 0)], 2), CORD)


@pytest.mark.parametrize(
    ("unloading", "words"),
    [
        (([0.0, 0.03], [0.0, 60.0]), "up to the strain 0.01 gains energy"),
        (([-0.01, 0.0, 0.01], [-1.0, 0.0, 60.0]), "begins at the strain -0.01"),
        (
            ([0.0, 0.01], [0.0, -60.0]),
            r"unloading is \(\[0\.0, 0\.01\], \[0\.0, -60\.0\]\), whose number 2 does not fit",
        ),
    ],
)
def test_curves_that_gain_energy_are_refused(unloading: Any, words: str) -> None:
    with pytest.raises(gx.InputError, match=words):
        gx.TabulatedCable(*LOADING, line_density=0.1, unloading=unloading)


def test_a_scaled_curve_that_gains_energy_is_refused() -> None:
    """UNLOADING returns a third of force times strain: at 1 % that grows by 11.7 N, and the work of
    loading by 10 N."""
    with pytest.raises(gx.InputError, match=r"up to the strain 0\.01 gains energy"):
        gx.TabulatedCable(*LOADING, line_density=0.1, unloading=UNLOADING, unloading_rule="scaled")
