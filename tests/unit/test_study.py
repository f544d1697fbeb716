"""The engine of studies, on a problem whose error is known."""

from __future__ import annotations

import dataclasses
import math

import pytest

from demos.studies.engine.report import picture, shortfalls, summary, table
from demos.studies.engine.study import Measure, Study, run
from gossamer_fx import InputError, NoEquilibrium

CALLS = []


def problem(comm, order, cells):
    """2 + h^order."""
    CALLS.append((order, cells))
    if cells == 13:
        raise NoEquilibrium("unlucky")
    return {"y": 2 + (1 / cells) ** order, "seconds": 1e-3 * cells}


STUDY = Study(
    "toy",
    "A toy",
    problem,
    {"order": [1, 2], "cells": [2, 4, 8]},
    lambda case: 1 / case["cells"],
    (Measure("y", 2.0, 0.1, lambda case: float(case["order"])),),
    quick={"cells": [2, 4]},
    columns=("seconds",),
)


@pytest.mark.mpi
def test_an_interrupted_study_goes_on_where_it_stopped(comm, folder):
    CALLS.clear()
    run(STUDY, folder, comm, quick=True)
    assert CALLS == [(1, 2), (1, 4), (2, 2), (2, 4)]
    results = run(STUDY, folder, comm)
    expected = [(1, 8), (2, 8)]
    assert CALLS[4:] == expected
    measured = [r.values["y"] for r in results]
    expected = [2.5, 2.25, 2.125, 2.25, 2.0625, 2.015625]
    assert measured == expected
    assert not shortfalls(STUDY, results)
    assert "| 2 | 8 | 2.01562 | 0.0078 | 2.0 | 0.008 |" in table(STUDY, results)


def test_the_summary_tells_the_largest_errors_and_the_spread_of_orders(comm, folder):
    words = summary([(STUDY, run(STUDY, folder, comm))])
    assert "| toy | y |  | 0.062 | 1.0 to 2.0 | 0.008 |" in words


def test_the_picture_is_drawn(comm, folder):
    picture(STUDY, run(STUDY, folder, comm, quick=True), folder / "toy.png")
    measured = (folder / "toy.png").read_bytes()[1:4]
    assert measured == b"PNG"


def test_what_falls_short_is_said(comm, folder):
    demanding = dataclasses.replace(STUDY, measures=(Measure("y", 2.0, 1e-2, lambda case: 2.0),))
    words = shortfalls(demanding, run(demanding, folder, comm))
    assert words == [
        "y, order 1, cells 8: error 0.062 > 0.01",
        "y, order 1, cells 8: order 1.00, expected 2",
    ]


def test_a_failed_case_is_kept_with_its_reason(comm, folder):
    unlucky = dataclasses.replace(
        STUDY,
        axes={"order": [2], "cells": [2, 13]},
        quick={},
    )
    for _ in range(2):
        CALLS.clear()
        results = run(unlucky, folder, comm)
        assert results[1].failed == "unlucky"
        assert math.isfinite(results[1].values["seconds"])
    assert CALLS == []
    assert shortfalls(unlucky, results)[0] == "order 2, cells 13: unlucky"


def test_results_of_another_study_are_refused(comm, folder):
    run(STUDY, folder, comm, quick=True)
    with pytest.raises(InputError, match="other axes"):
        run(
            dataclasses.replace(STUDY, axes={"h": [1]}, quick={}),
            folder,
            comm,
        )


def test_a_quick_axis_must_be_an_axis(comm, folder):
    with pytest.raises(InputError, match="quick"):
        run(
            dataclasses.replace(STUDY, quick={"meshes": [1]}),
            folder,
            comm,
            quick=True,
        )
