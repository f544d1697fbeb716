"""Dissipation by cause: each loss compared with its closed form, in files and over restarts."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import sheet

COMM = MPI.COMM_WORLD
LAW = gx.Linear(E=1e9, nu=0.3, density=1400.0, thickness=1e-4)
# Units of these constants: s, 1/s, N, N/m, kg, m/s.
DT = 5e-3
DRAG = 3.0
BRAKE = 2.0
STIFFNESS = 400.0
MASS = 0.5
SPEED = 1.2
CAUSES = ["air", "strain", "rope damping", "reel"]


def scene(comm: MPI.Comm = COMM) -> gx.Scene:
    """A film that drifts as a whole, a mass that a brake stops, and one that swings on a damped
    rope."""
    film = gx.Membrane(sheet(comm, 2, 2), LAW, velocity=lambda x: 0 * x + [[1.0], [0.0], [2.0]])
    at_reel = gx.PointMass(
        MASS,
        (1.0, 0.0, 0.0),
        velocity=(SPEED, 0.0, 0.0),
        comm=comm,
        name="at reel",
    )
    at_rope = gx.PointMass(
        MASS,
        (0.0, 1.0, 0.0),
        velocity=(0.0, 0.1, 0.0),
        comm=comm,
        name="at rope",
    )
    ground = gx.Ground((0.0, 0.0, 0.0))
    return gx.Scene(
        film,
        at_reel,
        at_rope,
        gx.Damping(film, mass_factor=DRAG, name="air"),
        gx.Damping(film, stiffness_factor=1e-4, name="strain"),
        gx.connectors.Tether(
            ground,
            at_reel.port(),
            length=1.0,
            stiffness=STIFFNESS,
            brake_force=BRAKE,
            name="reel",
        ),
        gx.connectors.Rope(
            ground,
            at_rope.port(),
            length=1.0,
            stiffness=STIFFNESS,
            damping=4.0,
            name="rope",
        ),
    )


def run_to(step: int, made: gx.Scene, **given: object) -> gx.Simulation:
    run = gx.Simulation(made, gx.Midpoint(dt=DT), **given)
    run.run(until=step * DT)
    return run


@pytest.mark.mpi
def test_each_cause_takes_what_its_closed_form_says(folder: Path) -> None:
    steps = 90
    run = run_to(steps, scene(), outputs=[gx.Ledger(folder / "ledger.csv")])
    lost = run.totals.losses
    assert sorted(lost) == sorted(CAUSES)
    # the midpoint rule slows a film in drift by the same factor in each step
    factor = (1 - DRAG * DT / 2) / (1 + DRAG * DT / 2)
    film = LAW.density * LAW.thickness * (1 + 4) / 2
    assert lost["air"] == pytest.approx(film * (1 - factor ** (2 * steps)), rel=1e-10)
    assert abs(lost["strain"]) < 1e-15  # nothing is strained
    # the brake pulls with B from where the tether is stretched by B/k
    elastic = BRAKE**2 / 2 / STIFFNESS
    assert lost["reel"] == pytest.approx(MASS * SPEED**2 / 2 - elastic, rel=1e-3)
    # the other mass flies back when its rope is slack again
    v = gx.probes.Velocity(
        next(body for body in run.system.unknowns.bodies if body.name == "at rope").port(), "y"
    )(run)
    assert -0.1 < v < 0 and lost["rope damping"] == pytest.approx(
        MASS * (0.1**2 - v**2) / 2, rel=1e-10
    )
    assert run.totals.dissipated == sum(lost.values()) and abs(run.energy_error) < 1e-12
    COMM.barrier()
    row = list(csv.DictReader((folder / "ledger.csv").open(encoding="utf-8")))[-1]
    assert [float(row[f"dissipated {name} [J]"]) for name in lost] == list(lost.values())
    assert float(row["dissipated [J]"]) == run.totals.dissipated


def test_one_cause_is_the_sum_and_none_is_nothing(folder: Path) -> None:
    mass = gx.PointMass(1.0, velocity=(1.0, 0.0, 0.0), comm=COMM)
    damper = gx.connectors.Damper(mass.port(), gx.Ground((-1.0, 0.0, 0.0)), damping=0.5)
    for items, lost in ((mass,), []), ((mass, damper), ["damper"]):
        run = run_to(2, gx.Scene(*items), outputs=[gx.Ledger(folder / "ledger.csv")])
        COMM.barrier()
        assert list(run.totals.losses) == lost
        assert (
            # c v² t with v = 1 m/s, which falls by less than 1 % in two steps.
            run.totals.dissipated == pytest.approx(0.5 * 2 * DT, rel=0.01)
            if lost
            else run.totals.dissipated == 0
        )
        head = (folder / "ledger.csv").read_text(encoding="utf-8").splitlines()[0]
        assert head.count("dissipated") == 1


def test_a_step_that_is_made_anew_loses_once() -> None:
    run = run_to(3, scene())
    before = dict(run.totals.losses)
    start = run.history.save()
    run.run(until=6 * DT)
    after = dict(run.totals.losses)
    assert after["reel"] > before["reel"] and after["air"] > before["air"]
    run.history.restore(start)
    assert run.system.balance.totals().losses == before


@pytest.mark.mpi
def test_restarts_go_on_with_each_cause(folder: Path) -> None:
    """On as many ranks, and on others: 2 → 1 and 1 → 2 under mpirun -n 2."""
    whole = run_to(20, scene()).totals.losses
    run_to(10, scene(), checkpoints=gx.Checkpoints(folder / "all"))
    run_to(10, scene(MPI.COMM_SELF), checkpoints=gx.Checkpoints(folder / f"own {COMM.rank}"))
    COMM.barrier()
    for comm, written in ((COMM, "all"), (MPI.COMM_SELF, "all"), (COMM, "own 0")):
        again = run_to(20, scene(comm), restart=folder / written).totals.losses
        assert list(again) == list(whole)
        # Steps agree to Newton's tolerance on any number of ranks.
        assert list(again.values()) == pytest.approx(list(whole.values()), rel=1e-9, abs=1e-14)


def test_what_a_part_took_before_it_was_changed_stays_booked(folder: Path) -> None:
    def swing(damping: float) -> gx.Scene:
        mass = gx.PointMass(MASS, (0.0, 1.0, 0.0), velocity=(0.0, 0.1, 0.0), comm=COMM)
        return gx.Scene(
            mass,
            gx.connectors.Rope(
                gx.Ground((0.0, 0.0, 0.0)),
                mass.port(),
                length=1.0,
                stiffness=STIFFNESS,
                damping=damping,
            ),
        )

    lost = run_to(10, swing(4.0), checkpoints=gx.Checkpoints(folder)).totals.losses
    assert lost["rope damping"] > 0
    after = run_to(20, swing(0.0), restart=folder, changes=["rope"])
    # The sum of a part that no longer loses anything is constant.
    assert after.totals.losses == lost and abs(after.energy_error) < 1e-12
