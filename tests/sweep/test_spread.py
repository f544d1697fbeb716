"""Spreads: what may be said of a quantity, and runs that workers of executors make."""

from __future__ import annotations

import math
import os
from concurrent.futures import Executor, ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pytest
from mpi4py import MPI
from mpi4py.futures import MPICommExecutor

import gossamer_fx as gx
from gossamer_fx.analysis.answer_spread import rounded

VARY: dict[str, list[Any]] = {"cells": [4, 6, 8], "damping": [1e-6, 1e-7], "nudge": [0.0, 1e-9]}


def numbers(comm: MPI.Intracomm, cells: int, damping: float, nudge: float) -> dict[str, float]:
    """Three quantities whose verdicts are known."""
    chaos = 1.0 + 0.3 * (nudge > 0)
    return {
        "converged": 2.0 + 0.1 / cells**2,
        "chaotic": chaos + 0.1 / cells,
        "undamped": 10.0 if damping > 5e-7 else 3.0,
        "swing": 0.01 * chaos,
    }


def ends_at_once(comm: MPI.Intracomm, a: int) -> dict[str, float]:
    if a == 2:
        os._exit(3)
    return {"a": float(a)}


def test_the_three_verdicts() -> None:
    found = gx.analysis.spread(numbers, vary=VARY, chance=["nudge"], limit=0.05)
    converged = found.verdict("converged")
    assert converged.kind == "determined" and converged.factor == "cells"
    assert converged.largest_change == pytest.approx((0.1 / 16 - 0.1 / 64) / (2 + 0.1 / 16))
    chaotic = found.verdict("chaotic")
    values = [1 + 0.1 / 4, 1 + 0.1 / 6, 1 + 0.1 / 8, 1 + 0.1 / 4, 1.3 + 0.1 / 4]
    assert chaotic.kind == "statistical"
    assert chaotic.value == pytest.approx(sum(values) / 5)
    assert (chaotic.low, chaotic.high) == (pytest.approx(1.0125), pytest.approx(1.325))
    undamped = found.verdict("undamped")
    assert undamped.kind == "not determined" and undamped.factor == "damping"
    assert str(undamped) == "not determined: 3.0 to 10.0, most by damping"
    assert len(found.results) == 5


def test_a_quantity_around_zero_has_a_scale() -> None:
    found = gx.analysis.spread(numbers, vary=VARY, chance=["nudge"], scales={"swing": 1.0})
    assert found.verdict("swing").kind == "determined"
    assert found.verdict("swing").largest_change == pytest.approx(0.003)


def test_a_start_that_matters_less_than_a_constant_is_no_excuse() -> None:
    """Otherwise a quantity that the damping decides would pass for chance."""
    vary = {"damping": [1e-6, 1e-7], "nudge": [0.0, 1e-9]}
    found = gx.analysis.spread(
        lambda comm, damping, nudge: {"y": 1.0 + 0.2 * (nudge > 0) + (damping < 5e-7)},
        vary=vary,
        chance=["nudge"],
    )
    assert found.verdict("y").kind == "not determined"


def test_a_run_without_a_value_leaves_nothing_determined() -> None:
    found = gx.analysis.spread(
        lambda comm, dt: {"arrival [s]": math.inf if dt > 0.5 else 1.0}, vary={"dt": [0.1, 1.0]}
    )
    assert str(found.verdict("arrival [s]")) == "not determined: dt 1: no finite value"


@pytest.mark.mpi
def test_probes_of_a_case_are_its_quantities(folder: Path) -> None:
    def build(comm: MPI.Intracomm, dt: float, speed: float) -> gx.Case:
        ball = gx.PointMass(2.0, velocity=(speed, 0.0, 0.0), comm=comm, name="ball")
        probes = {"x [m]": gx.probes.Position(ball.port(), "x")}
        return gx.Case(gx.Scene(ball), gx.Midpoint(dt=dt), until=0.4, probes=probes)

    vary = {"dt": [0.02, 0.01], "speed": [1.0, 1.02]}
    found = gx.analysis.spread(build, vary=vary, folder=folder, quantities=["x [m] at the end"])
    MPI.COMM_WORLD.barrier()
    verdict = found.verdict("x [m] at the end")
    assert verdict.value == pytest.approx(0.4)
    assert verdict.changes == pytest.approx({"dt": 0.0, "speed": 0.02}, abs=1e-12)
    assert "determined to 2 %" in (folder / "spread.md").read_text()
    assert (folder / "spread.png").read_bytes()[1:4] == b"PNG"


@pytest.mark.parametrize(
    "options, words",
    [
        ({"vary": {}}, "nothing to vary"),
        ({"vary": {"cells": [4]}}, "give its usual value and one or more others"),
        ({"vary": {"cells": [4, 4]}}, "give its usual value and one or more others"),
        ({"vary": {"cells": [4, 6]}, "chance": ["nudge"]}, "vary has no factor 'nudge'"),
        ({"vary": {"cells": [4, 6]}, "quantities": ["height"]}, "no number 'height'"),
    ],
)
def test_what_makes_no_spread_is_refused(options: dict, words: str) -> None:
    with pytest.raises(gx.InputError, match=words):
        gx.analysis.spread(lambda comm, cells: {"y": float(cells)}, **options)


def test_no_more_digits_than_are_determined() -> None:
    assert rounded(0.022137, 0.0004) == "0.02214"
    assert rounded(8312.0, 250.0) == "8310"
    assert rounded(1.5, 0.0) == "1.5"


# ---- executors -----------------------------------------------------------------------------------


def by_workers(executor: Executor, folder: Path) -> gx.analysis.Spread:
    return gx.analysis.spread(
        numbers, vary=VARY, chance=["nudge"], comm=MPI.COMM_SELF, folder=folder, executor=executor
    )


def test_processes_make_the_runs(tmp_path: Path) -> None:
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as executor:
        found = by_workers(executor, tmp_path)
    here = gx.analysis.spread(numbers, vary=VARY, comm=MPI.COMM_SELF)
    assert [run.numbers for run in found.results] == [run.numbers for run in here.results]


@pytest.mark.mpi
def test_ranks_of_mpi_make_the_runs(folder: Path) -> None:
    with MPICommExecutor(MPI.COMM_WORLD, root=0) as executor:
        # The other ranks are its workers.
        if executor is not None:
            found = by_workers(executor, folder)
            assert found.verdict("converged").kind == "determined"
    MPI.COMM_WORLD.barrier()


def test_a_worker_that_ends_costs_its_runs_only(tmp_path: Path) -> None:
    """What has a result is kept, and the same call makes the rest."""
    vary = {"a": [1, 2]}
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as executor:
        found = gx.analysis.spread(
            ends_at_once, vary=vary, comm=MPI.COMM_SELF, folder=tmp_path, executor=executor
        )
    assert found.results[0].numbers == {"a": 1.0}
    assert "its worker ended without a result" in found.results[1].failed
    assert len(list((tmp_path / "runs").glob("*.json"))) == 1


def test_what_cannot_be_sent_to_a_worker_is_refused(tmp_path: Path) -> None:
    with (
        ProcessPoolExecutor(1, mp_context=get_context("spawn")) as executor,
        pytest.raises(gx.InputError, match="define it with def at the top of a module"),
    ):
        gx.analysis.spread(
            lambda comm, a: {"a": a},
            vary={"a": [1, 2]},
            comm=MPI.COMM_SELF,
            folder=tmp_path,
            executor=executor,
        )
