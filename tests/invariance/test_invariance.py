"""Results do not depend on how a scene is described: place, units, order, numbering, ranks,
restart.

In each test a kind of scene is run as it is written, on one rank, and as a transformation describes
it, on all ranks.  The short form runs each kind with all transformations at once, and with one
drawn by hypothesis; the slow form runs each transformation by itself, and prints the deviations.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import Phase, example, given, settings
from mpi4py import MPI

import gossamer_fx as gx
from tests.invariance.kinds import KINDS, Kind
from tests.invariance.transformations import (
    ALL_AT_ONCE,
    SAME,
    SINGLE,
    Description,
    Transformation,
    transformations,
)
from tests.small_scenes import at_rest

# The rule is compared, and not what Newton's iteration leaves.
TIGHT = gx.Tolerances(relative=1e-13)

# Equilibria have no steps, and shapes of a reduced film are recorded again by each run.
MOVING = [kind for kind in KINDS if kind.dt > 0 and kind.name != "reduced film"]


@dataclass(frozen=True)
class Results:
    """Results of a scene in SI units where it is written: displacements (n, 3) [m] and velocities
    (n, 3) [m/s] of the named points, energies [J], and pressures [Pa]; and what the run says of
    itself: steps, iterations, rejected steps, energy [J] of the start and error of the energy."""

    displacements: np.ndarray
    velocities: np.ndarray
    energies: np.ndarray
    pressures: np.ndarray
    account: tuple[float, ...]

    def deviation(self, other: Results) -> float:
        """The largest difference from other results, each over the largest number of its kind."""
        pairs = [
            (self.displacements, other.displacements),
            (self.velocities, other.velocities),
            *zip(self.energies, other.energies, strict=True),
            *zip(self.pressures, other.pressures, strict=True),
        ]
        worst = 0.0
        for mine, others in pairs:
            size = np.abs(others).max()
            # What is zero in the scene has to be zero in each description.
            worst = max(worst, float(np.abs(mine - others).max() / (size or 1.0)))
        return worst


def results(
    kind: Kind, transformation: Transformation, comm: MPI.Intracomm, steps: int, **options: object
) -> Results:
    """The results of a kind of scene as a transformation describes it, at rest or after steps of a
    run with options."""
    at = Description(transformation, comm)
    made = kind.make(at)
    if kind.dt == 0:
        statics = at_rest(*at.in_order(made.parts))
        system = statics.system
        pressures = []
        account = ()
    else:
        run = gx.Simulation(
            gx.Scene(*at.in_order(made.parts)),
            gx.Midpoint(dt=at(kind.dt, "s"), tolerances=TIGHT),
            **options,
        )
        run.run(until=at(kind.dt * steps, "s"))
        system = run.system
        account = (run.step, run.iterations, run.substeps, run.first.energy, run.energy_error)
        pressures = [at.written(run.chamber(name).pressure, "Pa") for name in made.gas]
    names = sorted(made.ports)
    displacements, velocities = [], []
    for name in names:
        port = made.ports[name]
        now = at.written_point(system.unknowns.state.vector(port))
        displacements.append(now - at.written_point(system.unknowns.initial.vector(port)))
        velocities.append(at.written_vector(system.unknowns.state.rate(port), "m/s"))
    totals = system.balance.totals()
    # Potentials of loads count from the origin.
    stored = sum(energy for name, energy in totals.stored.items() if "gravity" not in name)
    energies = [totals.kinetic, stored, totals.dissipated]
    return Results(
        np.array(displacements),
        np.array(velocities),
        np.array([at.written(energy, "J") for energy in energies]),
        np.array(pressures),
        account,
    )


@cache
def written(kind: Kind) -> Results:
    """The results of the scene as it is written, on one rank."""
    return results(kind, SAME, MPI.COMM_SELF, kind.steps)


def deviation(kind: Kind, transformation: Transformation, comm: MPI.Intracomm) -> float:
    """How far the results of a transformation on some ranks are from those of the scene as it is
    written; the same on all ranks."""
    found = results(kind, transformation.without(kind.left_out), comm, kind.steps)
    return comm.allreduce(found.deviation(written(kind)), op=MPI.MAX)


in_each_kind = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)


@pytest.mark.mpi
@in_each_kind
@settings(max_examples=1, phases=(Phase.explicit, Phase.generate))
@example(ALL_AT_ONCE)
@given(transformations())
def test_results_do_not_depend_on_the_description(
    kind: Kind, transformation: Transformation
) -> None:
    assert deviation(kind, transformation, MPI.COMM_WORLD) < kind.tolerance


@pytest.mark.mpi
@pytest.mark.parametrize("kind", MOVING, ids=lambda kind: kind.name)
def test_a_restart_goes_on_as_if_nothing_had_happened(kind: Kind, folder: Path) -> None:
    """All ranks write and each reads for itself; and under mpirun each writes for itself, and all
    read."""
    comm = MPI.COMM_WORLD
    half = kind.steps // 2
    ways = [(comm, folder / "all", MPI.COMM_SELF, folder / "all")]
    if comm.size > 1:
        ways.append((MPI.COMM_SELF, folder / f"own {comm.rank}", comm, folder / "own 0"))
    for first, saved, second, restart in ways:
        results(kind, SAME, first, half, checkpoints=gx.Checkpoints(saved))
        comm.barrier()
        found = results(kind, SAME, second, kind.steps, restart=restart)
        error = comm.allreduce(found.deviation(written(kind)), op=MPI.MAX)
        assert error < kind.tolerance
        if comm.size == 1:
            # Sums over other ranks are in another order, which may cost an iteration.
            assert found.account == pytest.approx(written(kind).account, rel=1e-12, abs=1e-12)


@pytest.mark.mpi
@pytest.mark.slow
@in_each_kind
def test_each_transformation_by_itself(kind: Kind) -> None:
    deviations = {}
    for name, transformation in SINGLE.items():
        if name not in kind.left_out:
            deviations[name] = deviation(kind, transformation, MPI.COMM_WORLD)
    print("\n" + kind.name, *(f"{name} {error:.0e}" for name, error in deviations.items()))
    assert max(deviations.values()) < kind.tolerance


@pytest.mark.mpi
@pytest.mark.slow
@in_each_kind
@settings(max_examples=30)
@given(transformations())
def test_any_transformation(kind: Kind, transformation: Transformation) -> None:
    assert deviation(kind, transformation, MPI.COMM_WORLD) < kind.tolerance
