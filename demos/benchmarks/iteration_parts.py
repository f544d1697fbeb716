"""Parts of a Newton iteration of the free sheet, as the model of scaling needs them
(`scaling_model`).

Seconds of CPU on the slowest rank; flops, messages and their bytes from PETSc's log, with those of
contact's exchanges; and the machine: memory bandwidth of one core, latency and bandwidth of a
message between two ranks.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from stopwatch import Stopwatch

import gossamer_fx as gx
from demos.films.spinning_sheet import throw
from gossamer_fx.core.algebra.rank_exchange import RankExchange
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.solve.solvers import factorisation
from gossamer_fx.solve.solvers.coarse_space import CoarseSpace
from gossamer_fx.solve.solvers.two_level import TwoLevel
from gossamer_fx.solve.system.system import System

COMM = MPI.COMM_WORLD

# Films of the scene with contact: a unit square falls on another one.
DISTANCE = 1e-3  # m
GAP = 1.5e-3  # m
SPEED = 2.0  # m/s

# Doubles of each of the three arrays of the measured triad: far more than caches hold.
TRIAD_SIZE = 4_000_000
PING_PONGS = 2000
LARGE_MESSAGE = 1_000_000  # bytes


class Timed:
    """CPU time and number of the calls of a method of a class, or of a function of a module."""

    def __init__(self, owner: Any, name: str) -> None:
        self.seconds = 0.0
        self.calls = 0
        original = getattr(owner, name)

        def timed(*given: Any, **named: Any) -> Any:
            started = time.process_time()
            try:
                return original(*given, **named)
            finally:
                self.seconds += time.process_time() - started
                self.calls += 1

        setattr(owner, name, timed)


class TimedSolver:
    """The solver of a coarse matrix, whose solutions are timed.

    The set-up and solution of a coarse space have a part that ranks share, products with the
    prolongation, and one that they hardly do, the factorisation and its use.
    """

    seconds = 0.0
    calls = 0

    def __init__(self, solver: PETSc.PC) -> None:
        self._solver = solver

    def __getattr__(self, name: str) -> Any:
        return getattr(self._solver, name)

    def apply(self, r: PETSc.Vec, z: PETSc.Vec) -> None:
        started = time.process_time()
        self._solver.apply(r, z)
        TimedSolver.seconds += time.process_time() - started
        TimedSolver.calls += 1

    @classmethod
    def install(cls) -> None:
        """Let each coarse space that is made from now on have a timed solver."""
        original = CoarseSpace.__init__

        def with_timed_solver(space: CoarseSpace, system: System) -> None:
            original(space, system)
            space._solver = cls(space._solver)

        CoarseSpace.__init__ = with_timed_solver


class CountedExchanges:
    """Messages and bytes that contact sends from this rank."""

    def __init__(self) -> None:
        self.messages = 0
        self.bytes = 0
        original = RankExchange._transfer

        def counted(exchange: RankExchange, values: Any, sent: Any, received: Any, count: int):
            for rank, rows in sent:
                if rank != COMM.rank:
                    self.messages += 1
                    self.bytes += values[rows].nbytes
            return original(exchange, values, sent, received, count)

        RankExchange._transfer = counted


def memory_bandwidth() -> float:
    """Bytes per second of a + s b on all ranks at once, of one rank."""
    a = np.zeros(TRIAD_SIZE)
    b = np.ones(TRIAD_SIZE)
    out = np.empty(TRIAD_SIZE)
    seconds = []
    for _ in range(5):
        COMM.Barrier()
        started = time.perf_counter()
        np.add(a, b, out=out)
        seconds.append(time.perf_counter() - started)
    return 3 * 8 * TRIAD_SIZE / min(seconds)


def message_times() -> tuple[float, float]:
    """Latency [s] and bandwidth [bytes/s] of messages between ranks 0 and 1; zeros on one rank."""
    if COMM.size == 1:
        return 0.0, 0.0

    def round_trip(size: int) -> float:
        data = np.zeros(size, dtype=np.uint8)
        seconds = []
        for _ in range(PING_PONGS if size == 1 else PING_PONGS // 40):
            started = time.perf_counter()
            if COMM.rank == 0:
                COMM.Send(data, dest=1)
                COMM.Recv(data, source=1)
            elif COMM.rank == 1:
                COMM.Recv(data, source=0)
                COMM.Send(data, dest=0)
            seconds.append(time.perf_counter() - started)
        # The median: a shared machine interrupts some of them.
        return float(np.median(seconds))

    latency = round_trip(1) / 2
    return latency, LARGE_MESSAGE / max(round_trip(LARGE_MESSAGE) / 2 - latency, 1e-9)


def scene(n: int, has_contact: bool) -> gx.Scene:
    """The free sheet of n x n cells, or two films of which one falls on the other."""
    if not has_contact:
        law = gx.Miyazaki(E=1e9, nu=0.3, density=1400.0, thickness=1e-4, residual_stiffness=1e-6)
        return gx.Scene(gx.Membrane(sheet(COMM, n, n), law, velocity=throw))
    films = []
    for name, height, speed in (("lower", 0.0, 0.0), ("upper", GAP, -SPEED)):
        law = gx.Miyazaki(E=1e9, nu=0.3, density=1400.0, thickness=1e-4, residual_stiffness=1e-6)
        films.append(
            gx.Membrane(
                sheet(COMM, n, n, 1.0, 1.0),
                law,
                name=name,
                displacement=lambda X, z=height: np.vstack([0 * X[:2], 0 * X[:1] + z]),
                velocity=lambda X, v=speed: np.vstack([0 * X[:2], 0 * X[:1] + v]),
            )
        )
    return gx.Scene(gx.Contact(*films, distance=DISTANCE))


def slowest(value: float) -> float:
    return float(COMM.allreduce(value, op=MPI.MAX))


def parts(n: int = 40, steps: int = 3, dt: float = 1e-3, contact: int = 0) -> dict[str, float]:
    """Times of the parts of an iteration, counts of messages, and speeds of the machine."""
    timed_parts = {
        "law and forces": [Timed(System, "set_increment"), Timed(System, "residual")],
        "tangent": [Timed(System, "assemble_tangent")],
        "coarse set-up": [Timed(CoarseSpace, "set_up")],
        "coarse factorisation": [Timed(factorisation, "set_up")],
        "factorisation": [Timed(TwoLevel, "_set_up_local_part")],
        "application": [Timed(TwoLevel, "apply")],
    }
    clocks = [clock for timed in timed_parts.values() for clock in timed]
    counted = CountedExchanges()
    TimedSolver.install()
    watch = Stopwatch()
    run = gx.Simulation(scene(n, bool(contact)), gx.Midpoint(dt=dt))
    # Patterns, orderings and work space are made once, in the first step.
    run.run(until=dt)
    for clock in [*clocks, TimedSolver]:
        clock.seconds = 0.0
        clock.calls = 0
    iterations_before = run.solver.newton.all_iterations
    PETSc.Log.begin()
    flops = PETSc.Log.getFlops()
    before = counted.messages, counted.bytes
    figures = watch.measure(run, (1 + steps) * dt)
    newton = run.solver.newton
    iterations = newton.all_iterations - iterations_before
    flops = COMM.allreduce(PETSc.Log.getFlops() - flops)
    solution = PETSc.Log.Event("SNESSolve").getPerfInfo()
    seconds = {name: sum(timed.seconds for timed in clocks) for name, clocks in timed_parts.items()}
    set_ups = max(timed_parts["coarse set-up"][0].calls, 1)
    applications = max(timed_parts["application"][0].calls, 1)
    latency, bandwidth = message_times()
    size = run.system.numbering.size
    matrix = run.system.A.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)
    return (
        {
            key: figures[key]
            for key in ("cpu", "wall", "dofs", "steps", "Newton/step", "Krylov/Newton", "energy")
        }
        | {
            f"{name} [ms]": 1e3 * slowest(seconds[name]) / iterations
            for name in ("law and forces", "tangent", "factorisation")
        }
        | {
            "coarse product [ms]": 1e3
            * slowest(seconds["coarse set-up"] - seconds["coarse factorisation"])
            / set_ups,
            "coarse factorisation [ms]": 1e3 * slowest(seconds["coarse factorisation"]) / set_ups,
            "coarse solution [ms]": 1e3 * slowest(TimedSolver.seconds) / max(TimedSolver.calls, 1),
            "application [ms]": 1e3
            * slowest(seconds["application"] - TimedSolver.seconds)
            / applications,
            "iteration [ms]": 1e3 * slowest(figures["cpu"] / COMM.size) / iterations,
            "flops per unknown": flops / iterations / size,
            "matrix bytes per unknown": 8 * matrix["nz_used"] / size,
            "messages": slowest(
                (solution["numMessages"] + counted.messages - before[0]) / iterations
            ),
            "message bytes": slowest(
                (solution["messageLength"] + counted.bytes - before[1]) / iterations
            ),
            "contact messages": slowest((counted.messages - before[0]) / iterations),
            "reductions": slowest(solution["numReductions"] / iterations),
            "memory [GB/s]": memory_bandwidth() / 1e9,
            "latency [us]": 1e6 * latency,
            "message bandwidth [GB/s]": bandwidth / 1e9,
        }
    )
