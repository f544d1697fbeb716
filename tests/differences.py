"""Derivatives of the gas of a run against differences of runs."""

from __future__ import annotations

from collections.abc import Callable

import pytest

import gossamer_fx as gx


def pressure_by_differences(
    make: Callable[[float], gx.Simulation],
    name: str,
    value: float,
    until: float,
    chamber: str,
    change: float = 1e-4,
) -> float:
    """Return the derivative of the pressure in a chamber at the end of a run, which must be that of
    differences.

    Args:
        make: the run before its start, by the value of the parameter.
        name: of the parameter.
        value: at which the derivative is taken.
        until: time [s] of the end.
        chamber: name of the chamber.
        change: of the value in the differences, relative to it.
    """
    run = make(value)
    tape = gx.analysis.RunTape(run)
    run.run(until=until)
    pressure = gx.analysis.ChamberPressure(run.chamber(chamber).chamber)
    found = gx.analysis.gradient(tape, of=pressure, by=[name])[name].values[0]

    def changed(count: int) -> float:
        other = make(value * (1 + count * change))
        other.run(until=until)
        return other.chamber(chamber).pressure

    # The five-point formula, whose error of the fourth order is far below round-off.
    sums = changed(-2) - 8 * changed(-1) + 8 * changed(1) - changed(2)
    assert found == pytest.approx(sums / (12 * change * value), rel=1e-6)
    return found
