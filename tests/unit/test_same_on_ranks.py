"""What differs between ranks is refused on all of them, before anything is computed."""

from __future__ import annotations

import contextlib
from collections.abc import Callable

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.core.checks.same_on_ranks import refuse_differences
from gossamer_fx.extend import Output
from gossamer_fx.meshes.sheet import sheet
from tests.small_scenes import LINEAR

Cause = Callable[[gx.Membrane, int], object]


def scene(film: gx.Membrane, g: float = -9.81) -> gx.Scene:
    return gx.Scene(film, gx.Fixed(film, "left"), gx.Gravity(film, (0.0, 0.0, g)))


def run(film: gx.Membrane, dt: float = 1e-3, **options: object) -> gx.Simulation:
    return gx.Simulation(scene(film), gx.Midpoint(dt=dt), **options)


# What a careless user gives on each rank, by the words of the message that names it.
CAUSES: dict[str, Cause] = {
    "stepper.dt is 0.001 on rank 0 and 0.002 on rank 1": lambda film, rank: run(
        film, dt=1e-3 * (1 + rank)
    ),
    "until is 0.001 on rank 0": lambda film, rank: run(film).run(until=1e-3 * (1 + rank)),
    "halvings is not given on rank 0 and 1": lambda film, rank: run(
        film, **{"halvings": 1} if rank else {}
    ),
    "At 'time': time is 0.001 on rank 0": lambda film, rank: run(
        film, events=[gx.At(1e-3 * (1 + rank), lambda run: None)]
    ),
    "outputs[0] is not given on rank 0 and Progress": lambda film, rank: run(
        film, outputs=[gx.outputs.Progress()] * rank
    ),
    "outputs[0].times is 0.001 on rank 0": lambda film, rank: run(
        film, outputs=[gx.reduction.Snapshots(film, times=[1e-3 * (1 + rank)])]
    ),
    "Gravity 'gravity of film': g is (0, 0, -9.81) on rank 0": lambda film, rank: gx.Equilibrium(
        scene(film, g=-9.81 * (1 + rank))
    ),
    "Fixed 'film/left fixed (1,)' on rank 0": lambda film, rank: gx.Equilibrium(
        gx.Scene(film, gx.Fixed(film, "left", components=(1 + rank,)))
    ),
    "at is 0 on rank 0 and 1": lambda film, rank: gx.Equilibrium(scene(film)).find(at=1.0 * rank),
    "point is (0.25, 0.5, 0) on rank 0": lambda film, rank: film.port_at(
        (0.25 + 0.1 * rank, 0.5, 0.0)
    ),
    "point is (0.25, 0.5, 1) on rank 0": lambda film, rank: film.port_at(
        (0.25 + 0.1 * rank, 0.5, 1.0), snap=True
    ),
    "group is 'left' on rank 0": lambda film, rank: film.ports("right" if rank else "left"),
}


@pytest.mark.mpi
@pytest.mark.parametrize("words", CAUSES)
def test_an_argument_that_differs_is_named(comm: MPI.Intracomm, words: str) -> None:
    """Ranks with another dt waited for each other for ever; one of two points was taken."""
    film = gx.Membrane(sheet(comm, 2, 2), LINEAR, name="film")
    if comm.size == 1:
        CAUSES[words](film, 0)
        return
    with pytest.raises(gx.InputError) as refused:
        CAUSES[words](film, comm.rank)
    assert words in str(refused.value)


class Printer(Output):
    """An own output, which only rank 0 has."""

    times = ()

    def open(self, run: gx.Simulation) -> None: ...

    def record(self, run: gx.Simulation, last: bool) -> None: ...

    def close(self, run: gx.Simulation) -> None: ...


@pytest.mark.mpi
def test_what_may_differ_is_not_compared(comm: MPI.Intracomm) -> None:
    film = gx.Membrane(sheet(comm, 2, 2), LINEAR, name="film")
    alone = [Printer()] * (comm.rank == 0)
    # Of one more digit than a double has.
    simulation = run(film, dt=1e-3 * (1 + 1e-16 * comm.rank), outputs=[*alone])
    simulation.run(until=1e-3)
    gx.Equilibrium(scene(film)).find(progress=comm.rank == 0)
    # Each rank has its own part of an array.
    refuse_differences(comm, "a call", {"nodes": np.arange(comm.rank), "size": 1.0})


@pytest.mark.mpi
def test_round_off_is_no_difference(comm: MPI.Intracomm) -> None:
    for error, differs in ((1e-14, False), (1e-6, comm.size > 1)):
        expected: contextlib.AbstractContextManager[object] = contextlib.nullcontext()
        if differs:
            expected = pytest.raises(gx.InputError, match=r"^a call: x is")
        with expected:
            refuse_differences(comm, "a call", {"x": (1.0, error * comm.rank)})
