"""Equilibrium paths: limit points, branch points, stability, and bad input."""

from __future__ import annotations

import math

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import CORNERS, sheet

EA = 1000.0  # N
RISE = 0.2  # of the apex, over half of the span
BAR = math.hypot(1.0, RISE)
# Load [N] on the apex of two bars of Green strain at the height z is 2 EA ε z/l0 with the strain
# ε = (z² - h²)/(2 l0²), so that it has its extreme values at z = ± h/√3.
LIMIT_LOAD = 2 / (3 * math.sqrt(3)) * EA * (RISE / BAR) ** 3


def truss(comm, metre=1.0, cells=1):
    """Two bars that meet in an apex, which is free to move vertically; `metre` in units of
    length."""
    points = [(-metre, 0, 0), (0, 0, RISE * metre), (metre, 0, 0)]
    bars = gx.Cable(line(comm, points, 1), gx.CableLaw(EA=EA, line_density=1.0 / metre))
    supports = [
        gx.Fixed(bars, "start"),
        gx.Fixed(bars, "end"),
        gx.Fixed(bars, "point 1", components=(0, 1)),
    ]
    return bars, supports


def truss_path(comm, metre=1.0, **options):
    bars, supports = truss(comm, metre)
    apex = bars.port("point 1")
    push = gx.loads.Force(apex, lambda t: (0.0, 0.0, -t * LIMIT_LOAD))
    equilibrium = gx.Equilibrium(gx.Scene(*supports, push))
    probes = {"z": gx.probes.Position(apex, "z")}
    return gx.analysis.path(equilibrium, 1.5, probes=probes, **options)


@pytest.mark.mpi
def test_two_bars_snap_through_and_rise_again(comm):
    """Limit loads ± 2/(3√3) EA (h/l0)³, between which the equilibria are not stable."""
    found = truss_path(comm)
    assert found.complete and found.loads[-1] == 1.5
    assert found.branch_points == ()
    upper, lower = found.limit_points
    assert found.loads[upper] == pytest.approx(1.0, rel=1e-6)
    assert found.loads[lower] == pytest.approx(-1.0, rel=1e-6)
    z = found.columns["z"]
    np.testing.assert_allclose(z[[upper, lower]], [RISE / 3**0.5, -RISE / 3**0.5], rtol=1e-3)
    # All points are on the exact path.
    exact = EA * (RISE**2 - z**2) * z / BAR**3 / LIMIT_LOAD
    np.testing.assert_allclose(found.loads, exact, atol=1e-8)
    unstable = np.zeros(len(z), dtype=int)
    unstable[upper:lower] = 1
    np.testing.assert_array_equal(found.unstable, unstable)
