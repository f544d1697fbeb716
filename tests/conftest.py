"""How the tests run: long ones on request, and on several ranks as one test that is reported once.

Under mpirun every rank runs every test.  After each phase the ranks tell each other how it went: a
test that fails on one rank fails on all, and rank 0 shows what each of them says.  If a rank fails
while the others wait for it in the middle of the test, it says so itself and ends the run, so that
nobody waits for ever.
"""

from __future__ import annotations

import contextlib
import gc
import itertools
import logging
import os
import pickle
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import hypothesis
import numpy as np
import pytest
from mpi4py import MPI

from gossamer_fx.core.mesh import mesh
from gossamer_fx.core.mesh.gmsh_reader import RawMesh
from gossamer_fx.solve.scene import validation

PATIENCE = 60.0  # s that a failed rank waits for the others
TALK = (
    MPI.COMM_WORLD.Dup()
)  # output of a test that stopped half-way is not mistaken for one of our messages

_TESTS = itertools.count(1)

if (
    "PYTEST_XDIST_WORKER" in os.environ
):  # two jobs that Open MPI starts at the same moment must not share its folder
    _ours = tempfile.TemporaryDirectory(prefix="gossamer-", ignore_cleanup_errors=True)
    os.environ["TMPDIR"] = _ours.name

hypothesis.settings.register_profile(
    "same on every rank", derandomize=True, database=None, deadline=None
)
hypothesis.settings.load_profile("same on every rank")


@pytest.fixture(scope="session")
def comm() -> MPI.Comm:
    """All ranks."""
    return MPI.COMM_WORLD


@pytest.fixture
def folder(tmp_path: Path, comm: MPI.Comm) -> Path:
    """An empty folder, the same one on every rank."""
    return comm.bcast(tmp_path)


@pytest.fixture(autouse=True)
def _usual_ctrl_c() -> None:
    """Let Ctrl-C end each test, and the programs that it starts: a shell that starts the tests in
    the background lets them ignore it, and so does a test that leaves another action of the
    signal, or a library that has set one."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True)
def _collected_together() -> Iterator[None]:
    """Collect garbage after every twentieth test: MPICH has 2048 communicators, and no garbage
    collector counts them.

    On several ranks that is the only time, so that objects with communicators are freed on all at
    once.  A collection of all objects takes up to a second when many forms have been made: forms
    and meshes that tests share live long, and are looked at only at every tenth collection.
    """
    yield
    number = next(_TESTS)
    if number % 200 == 0:
        gc.unfreeze()
    if number % 20 == 0:
        gc.collect()
        gc.freeze()


class _WarningsOfUnits(logging.Handler):
    """Collects the warnings that a number is probably in another unit, of scenes that a program of
    the folder demos runs."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.words: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        if "is unusual" in record.getMessage() and _is_in_demos(sys._getframe()):
            self.words.append(record.getMessage())


# Benchmarks that others have set: shells in feet, pounds or without units, strips and rings whose
# length is one, and a span of 325 m.
SET_BY_OTHERS = {
    "demos.studies.plate",
    "demos.studies.shells",
    "demos.validation.models.heavy_span",
}


def _is_in_demos(frame: FrameType | None) -> bool:
    """Whether a function of the folder demos has called the one of a frame, at any distance, and
    none of a benchmark that others have set."""
    callers = set()
    while frame is not None:
        callers.add(frame.f_globals.get("__name__", ""))
        frame = frame.f_back
    return any(name.startswith("demos.") for name in callers) and not callers & SET_BY_OTHERS


_UNITS = _WarningsOfUnits()


@pytest.fixture(autouse=True, scope="session")
def _listen_for_units() -> Iterator[None]:
    """Listen from the first fixture on: some of them run demos."""
    logger = logging.getLogger("gossamer_fx")
    logger.addHandler(_UNITS)
    yield
    logger.removeHandler(_UNITS)


@pytest.fixture(autouse=True)
def _no_warning_of_units_in_demos() -> Iterator[None]:
    """Fail a test in which a demo, a study or a validation gets a warning of a unit: their numbers
    are ordinary ones."""
    # A warning is printed once in a process.
    validation._printed.clear()
    # A command that an earlier test has run takes the handlers of the log away.
    logging.getLogger("gossamer_fx").addHandler(_UNITS)
    yield
    words = list(_UNITS.words)
    _UNITS.words.clear()
    assert words == [], "an ordinary scene gets warnings of units"


@pytest.fixture(autouse=True, scope="session")
def _generated_once() -> Iterator[None]:
    """Let gmsh make each mesh of the package's own generators once in a process: a fork of the
    tests and a start of gmsh take a fifth of the time of many small scenes.

    A generator's mesh follows from the code and the numbers of its function.  Functions of tests,
    which may do anything, are called each time.
    """
    made: dict[Any, bytes] = {}
    in_child = mesh.in_child

    def once(raw: Callable[[], RawMesh], what: str, time_limit: float) -> RawMesh:
        given = _closure(raw)
        build = given["build"]
        key = None
        if ".meshes." in build.__module__ and build.__module__.startswith("gossamer_fx."):
            with contextlib.suppress(pickle.PicklingError, AttributeError, TypeError):
                key = build.__code__, pickle.dumps([_closure(build), given["orient"]])
        if key is None:
            return in_child(raw, what, time_limit)
        if key not in made:
            made[key] = pickle.dumps(in_child(raw, what, time_limit))
        # Never the same arrays twice.
        return pickle.loads(made[key])

    mesh.in_child = once
    yield
    mesh.in_child = in_child


def _closure(function: Callable[..., Any]) -> dict[str, Any]:
    """The values of variables that a function takes from the functions around it, by name."""
    cells = function.__closure__ or ()
    names = function.__code__.co_freevars
    return {name: cell.cell_contents for name, cell in zip(names, cells, strict=True)}


@pytest.hookimpl(tryfirst=True)
def pytest_sessionstart(session: pytest.Session) -> None:
    if TALK.size > 1:
        gc.disable()
    terminal = session.config.pluginmanager.getplugin("terminalreporter")
    if TALK.rank > 0 and terminal is not None:
        terminal._tw._file = open(os.devnull, "w")  # noqa: SIM115 (open until the end)


def pytest_collection_finish(session: pytest.Session) -> None:
    """Leave the tests themselves out of all collections of garbage: they live to the end."""
    gc.collect()
    gc.freeze()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out long tests, unless they are asked for, and on several ranks the cases of a test
    beyond the number that its mark `mpi` gives.

    A law or a shape does not know how many ranks share it, so that one case of each kind shows
    that ranks agree; tests/invariance has every kind of part.
    """
    cases: Counter[str] = Counter()
    left_out = []
    for item in items:
        function = item.nodeid.partition("[")[0]
        cases[function] += 1
        on_ranks = item.get_closest_marker("mpi")
        is_too_long = item.get_closest_marker("slow") and "slow" not in config.option.markexpr
        is_like_others = on_ranks and on_ranks.args and cases[function] > on_ranks.args[0]
        if is_too_long or (TALK.size > 1 and is_like_others):
            left_out.append(item)
    if left_out:
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if item not in left_out]


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item: pytest.Item):
    report = (yield).get_result()
    if TALK.size == 1:
        return
    failed = np.zeros(TALK.size, dtype=np.intc)
    told = TALK.Iallgather(np.array([report.failed], dtype=np.intc), failed)
    deadline = time.monotonic() + PATIENCE
    while not told.Test():
        if report.failed and time.monotonic() > deadline:
            item.config.pluginmanager.getplugin("capturemanager").suspend_global_capture(in_=True)
            sys.stderr.write(
                f"\n{item.nodeid} on rank {TALK.rank}, while others wait for "
                f"it:\n{report.longreprtext}\n"
            )
            sys.stderr.flush()
            TALK.Abort(1)
        time.sleep(1e-3)
    if failed.any():
        texts = TALK.allgather(report.longreprtext if report.failed else "passed")
        report.outcome = "failed"
        report.longrepr = "\n\n".join(f"rank {rank}: {text}" for rank, text in enumerate(texts))
