"""Several equilibria of one scene, found from disturbed starts."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.creased_strip import creased_strip
from gossamer_fx.meshes.line import line

EA = 1000.0  # N
RISE = 0.2


def two_bars(comm, load=0.0):
    """A two-bar arch, whose apex moves vertically."""
    points = [(-1.0, 0.0, 0.0), (0.0, 0.0, RISE), (1.0, 0.0, 0.0)]
    bars = gx.Cable(line(comm, points, 1), gx.CableLaw(EA=EA, line_density=1.0), name="bars")
    held = [
        gx.Fixed(bars, "start"),
        gx.Fixed(bars, "end"),
        gx.Fixed(bars, "point 1", components=(0, 1)),
    ]
    push = gx.loads.Force(bars.port("point 1"), (0.0, 0.0, -load))
    return gx.Equilibrium(gx.Scene(*held, push)), gx.probes.Position(bars.port("point 1"), "z")


@pytest.mark.mpi
def test_a_two_bar_arch_has_an_upper_and_a_lower_equilibrium(comm):
    """Without load at ± the rise, both stable and without energy."""
    equilibrium, height = two_bars(comm)
    found = gx.analysis.equilibria(equilibrium, starts=12, perturbation=0.5)
    assert len(found) >= 2
    upper, lower = (one for one in found if one.result.unstable == 0)
    assert 0 in upper.starts and 0 not in lower.starts
    assert upper.stored < 1e-9 and lower.stored < 1e-9
    assert lower.distance == pytest.approx(2 * RISE, rel=1e-6)
    assert sum(len(one.starts) for one in found) <= 12
    # The scene has the state of the first.
    assert height(equilibrium) == pytest.approx(RISE, rel=1e-9)


def test_equilibria_under_a_load_have_the_energies_of_closed_forms(comm):
    """P = 2 EA ε z/l0 with ε = (z² - h²)/(2 l0²), of which three roots are in equilibrium."""
    l0 = np.hypot(1.0, RISE)
    load = 0.3 * 2 / (3 * np.sqrt(3)) * EA * (RISE / l0) ** 3
    roots = np.sort(np.roots([EA / l0**3, 0.0, -EA * RISE**2 / l0**3, load]).real)
    energies = sorted(EA * l0 * ((z**2 - RISE**2) / (2 * l0**2)) ** 2 for z in roots[[0, 2]])
    equilibrium, _ = two_bars(comm, load)
    found = gx.analysis.equilibria(equilibrium, starts=12, perturbation=0.5)
    stable = sorted(one.stored for one in found if one.result.unstable == 0)
    assert stable == pytest.approx(energies, rel=1e-6)
    # The work of the load is that of each search, from the start of all.
    for one in found:
        if one.result.unstable == 0:
            z = RISE if one is found[0] else -RISE
            moved = min(roots, key=lambda root: abs(root - z)) - RISE
            assert one.result.totals.supplied == pytest.approx(-load * moved, rel=1e-6)


def test_one_equilibrium_is_listed_once(comm):
    mass = gx.PointMass(1.0, name="mass", comm=comm)
    anchor = gx.Ground((0.0, 0.0, 1.0))
    spring = gx.connectors.Spring(mass.port(), anchor, stiffness=100.0, length=0.5)
    equilibrium = gx.Equilibrium(gx.Scene(spring, gx.Gravity(mass)))
    (found,) = gx.analysis.equilibria(equilibrium, starts=5)
    assert found.starts == (0, 1, 2, 3, 4)


def test_no_equilibrium_from_any_start_is_an_error(comm):
    mass = gx.PointMass(1.0, name="mass", comm=comm)
    search = gx.analysis.Continuation(total_iterations=50)
    equilibrium = gx.Equilibrium(gx.Scene(gx.Gravity(mass)), search)
    with pytest.raises(gx.NoEquilibrium, match="none of 2 searches has found one"):
        gx.analysis.equilibria(equilibrium, starts=2)


def test_the_number_of_searches_without_a_result_is_said(comm, caplog):
    """Two bars that snap through need more iterations than they have."""
    equilibrium, _ = two_bars(comm)
    search = gx.analysis.Continuation(total_iterations=3)
    few = gx.Equilibrium(gx.Scene(*equilibrium.system.unknowns.items), search)
    found = gx.analysis.equilibria(few, starts=4, perturbation=0.5)
    reached = sum(len(one.starts) for one in found)
    assert 0 < reached < 4
    assert f"equilibria: {4 - reached} of 4 searches have found nothing" in caplog.text


def test_each_search_has_the_creases_of_the_start() -> None:
    """The second start bends a fold beyond its yield angle; the later ones find it flat again."""
    film = gx.Plate(
        creased_strip(MPI.COMM_SELF, 1, 1, 0.1, 0.1),
        gx.Linear(E=1e6, nu=0.3, density=1400.0, thickness=1e-3),
        hinges=["crease"],
    )
    fold = gx.connectors.Crease(film, "crease", stiffness=2e-3, yield_angle=0.05)
    held = [gx.Fixed(film, name) for name in ("left", "crease")]
    equilibrium = gx.Equilibrium(gx.Scene(film, fold, *held))
    found = gx.analysis.equilibria(equilibrium, starts=6, perturbation=0.04)
    assert [one.starts for one in found] == [(0, 2, 3, 4, 5), (1,)]
    assert [one.result.totals.dissipated > 0 for one in found] == [False, True]
    assert equilibrium.system.balance.totals().dissipated == 0


def test_a_found_equilibrium_can_be_taken(comm) -> None:
    equilibrium, height = two_bars(comm)
    found = gx.analysis.equilibria(equilibrium, starts=12, perturbation=0.5)
    _, lower = (one for one in found if one.result.unstable == 0)
    lower.take(equilibrium)
    assert height(equilibrium) == pytest.approx(-RISE, rel=1e-9)
    assert equilibrium.result is lower.result
    # A search that begins there stays there.
    assert equilibrium.find(progress=False).iterations <= 1
    assert height(equilibrium) == pytest.approx(-RISE, rel=1e-9)
