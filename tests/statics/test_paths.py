"""Equilibrium paths: limit points, branch points, stability, and bad input."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipk

import gossamer_fx as gx
from demos.studies import equilibrium_paths, tape_spring
from gossamer_fx.meshes.airbag import airbag
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import CORNERS, EDGES, sheet
from gossamer_fx.records.plot.curve_panels import run_curves

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


def test_loads_beside_the_load_factor_have_their_time(comm):
    """A pull of 10 N/s is 20 N after 2 s, and another one grows from 5 to 10 N, on 100 N/m."""
    mass = gx.PointMass(1.0, (0.0, 0.0, -1.0), comm=comm)
    top = gx.Ground((0.0, 0.0, 0.0))
    spring = gx.connectors.Spring(mass.port(), top, stiffness=100.0, length=1.0)
    pull = gx.loads.Force(mass.port(), lambda t: (0.0, 0.0, -10.0 * t))
    more = gx.loads.Force(mass.port(), (0.0, 0.0, -5.0), name="more")
    equilibrium = gx.Equilibrium(gx.Scene(spring, pull, more))
    equilibrium.find(at=2.0)
    probes = {"z": gx.probes.Position(mass.port(), "z")}
    found = gx.analysis.path(equilibrium, 2.0, by="more.force", start=1.0, probes=probes)
    assert found.columns["z"][[0, -1]] == pytest.approx([-1.25, -1.3], rel=1e-9)
    assert equilibrium.time == 2.0


def test_units_of_length_do_not_matter(comm):
    """The same points of the path in metres and in millimetres."""
    in_metres = truss_path(comm)
    in_millimetres = truss_path(comm, metre=1000.0)
    np.testing.assert_allclose(in_millimetres.loads, in_metres.loads, atol=1e-7)
    assert in_millimetres.limit_points == in_metres.limit_points


def test_two_bars_pushed_through_a_spring(comm):
    """Prescribed motion: the apex snaps although the end of the spring is moved, at the limit
    points d(u + P(u)/k)/du = 0."""
    bars, supports = truss(comm)
    apex = bars.port("point 1")
    # Below the apex by the natural length 1 of the spring; both ends move down by λ.
    below = line(comm, [(0, 0, RISE - 1), (1, 0, RISE - 1)], 1)
    driver = gx.Cable(below, gx.CableLaw(EA, line_density=1.0), name="driver")
    k = 20.0  # N/m, below the largest falling slope of the load, 2 EA h² / (2 l0³)
    spring = gx.connectors.Spring(apex, driver.port("start"), stiffness=k, length=1.0)
    motion = lambda X, t: np.vstack([0 * X[0], 0 * X[0], -t + 0 * X[0]])  # noqa: E731
    moved = gx.Fixed(driver, "line", motion=motion)
    equilibrium = gx.Equilibrium(gx.Scene(*supports, driver, moved, spring))
    probes = {"z": gx.probes.Position(apex, "z"), "pull": gx.probes.Tension(spring)}
    found = gx.analysis.path(equilibrium, 0.6, first_step=0.05, probes=probes)
    z = found.columns["z"]
    exact = RISE - z + EA * (RISE**2 - z**2) * z / BAR**3 / k
    np.testing.assert_allclose(found.loads, exact, atol=1e-9)
    # dλ/dz = -1 + EA (h² - 3 z²)/(k l0³) = 0
    at_limit = math.sqrt((RISE**2 - k * BAR**3 / EA) / 3)
    assert len(found.limit_points) == 2
    np.testing.assert_allclose(z[list(found.limit_points)], [at_limit, -at_limit], atol=1e-4)


@pytest.mark.parametrize("cells", [8, 16])
def test_buckling_load_of_a_column(comm, cells):
    """A branch point at π² EI/(2 L)², through which the straight path goes on."""
    L = 1.0
    section = gx.sections.rectangle(0.01, 0.02, E=1e9, nu=0.3, density=1000.0)
    column = gx.Beam(line(comm, [(0, 0, 0), (L, 0, 0)], cells), section)
    clamped = gx.Fixed(column, "start", rotation=True)
    EI = min(section.EI2, section.EI3)
    load = math.pi**2 * EI / (2 * L) ** 2
    push = gx.loads.Force(column.port("end"), (-load, 0.0, 0.0), name="push")
    equilibrium = gx.Equilibrium(gx.Scene(clamped, push))
    found = gx.analysis.path(equilibrium, 1.6, by="push.force", first_step=0.3)
    assert found.limit_points == ()
    (branch,) = found.branch_points
    assert list(found.unstable) == [0] * branch + [1] * (len(found.loads) - branch)
    assert found.loads[branch] == pytest.approx(1.0, rel=40 / cells**2 * 1e-2)


@pytest.mark.mpi
def test_a_column_bends_as_the_elastica(comm):
    """The path turns to the branch on which the tip moves to +z; it is stable, and has the loads of
    the elastica for the end shortening and for the deflection."""
    made = equilibrium_paths.column(comm, 8)
    found = made.follow(0.3)
    assert found.complete and found.limit_points == ()
    (branch,) = found.branch_points
    assert found.loads[branch] == pytest.approx(1.0, abs=5e-4)
    assert list(found.unstable) == [int(k == branch) for k in range(len(found.loads))]
    x = found.columns["x"][branch + 1 :]
    np.testing.assert_allclose(found.loads[branch + 1 :], made.exact(x), rtol=5e-4)
    # The modulus k at the deflection 2 k/K(k) has the load (2 K(k)/π)².
    squares = ellipk_inverse(math.pi / 2 * np.sqrt(found.loads[branch + 2 :]))
    deflections = 2 * np.sqrt(squares) / ellipk(squares)
    np.testing.assert_allclose(found.columns["branch"][branch + 2 :], deflections, atol=1e-3)
    assert found.loads[-1] == 2.0 and x[-1] < 0.1


def ellipk_inverse(values):
    """Parameters m = k² with the complete elliptic integral K(m)."""
    return np.array([brentq(lambda m, value=value: ellipk(m) - value, 0, 0.99) for value in values])


def test_a_branch_is_chosen_by_a_probe(comm):
    """The mirrored probe gives the mirrored branch; one that the branch does not change, none."""
    ends = {}
    for name in ("branch", "mirrored"):
        made = equilibrium_paths.column(comm, 4)
        z = made.probes["branch"]
        made.probes["mirrored"] = lambda state, z=z: -z(state)
        found = gx.analysis.path(
            made.equilibrium, 1.2, first_step=0.3, probes=made.probes, branch=name
        )
        ends[name] = found.columns["branch"][-1]
    assert ends["branch"] > 0.5
    assert ends["mirrored"] == pytest.approx(-ends["branch"], rel=1e-6)
    made = equilibrium_paths.column(comm, 4)
    options = {"start": 0.9, "first_step": 0.3, "max_steps": 1, "branch": "branch"}
    found = gx.analysis.path(made.equilibrium, 1.2, probes=made.probes, **options)
    # It ends where it turns, and the tries along the branch leave nothing.
    assert found.branch_points == (1,)
    assert made.equilibrium.time == found.loads[-1]
    made = equilibrium_paths.column(comm, 4)
    with pytest.raises(gx.InputError, match="'x' does not change along the branch"):
        gx.analysis.path(made.equilibrium, 1.2, first_step=0.3, probes=made.probes, branch="x")
    with pytest.raises(gx.InputError, match=r"branch has no probe 'up'; its probes are: none\."):
        gx.analysis.path(made.equilibrium, 1.2, branch="up")


@pytest.mark.mpi
def test_a_shallow_arch_snaps_through(comm):
    """Both limit loads of the sinusoidal arch; between its branch points it is unstable twice."""
    made = equilibrium_paths.arch(comm, 16)
    found = made.follow(0.3)
    assert found.complete
    upper, lower = found.limit_points
    assert found.loads[upper] == pytest.approx(1.0, abs=0.01)
    assert found.loads[lower] == pytest.approx(made.lower, abs=0.01)
    first, second = found.branch_points
    assert upper < first < second < lower
    unstable = np.zeros(len(found.loads), dtype=int)
    unstable[upper:lower] = 1
    unstable[first:second] = 2
    np.testing.assert_array_equal(found.unstable, unstable)


def test_the_branch_of_a_higher_arch_is_unstable(comm):
    """It sways before it snaps: the load falls linearly with the height."""
    made = equilibrium_paths.arch(comm, 16, rise=6.0)
    found = made.follow(0.3)
    branch = found.branch_points[0]
    assert found.loads[branch] == pytest.approx(1.0, abs=0.01)
    # The lowest load of the branch is where it meets the path of the symmetric arch again.
    (lowest,) = found.limit_points
    end = made.exact(-math.sqrt(6.0**2 - 16) * equilibrium_paths.GYRATION)
    assert found.loads[lowest] == pytest.approx(end, abs=0.01)
    # There the eigenvalue of the sway vanishes again, so that its sign is that of round-off.
    assert not found.unstable[:branch].any()
    assert (found.unstable[branch : lowest - 1] == 1).all()
    heights = found.columns["x"][branch:]
    np.testing.assert_allclose(found.loads[branch:], made.exact(heights), atol=0.01)
    sway = found.columns["branch"] - found.columns["x"] / math.sqrt(2)
    assert abs(sway[:branch]).max() < 1e-5 < sway[branch + 1]


def test_a_tape_spring_snaps_and_folds(comm):
    """Half of the tape of the study `tape_spring`, with the moment on its curved end: the largest
    moment of uniform bending, which a short tape exceeds, a way back on which the end turns back,
    too, and a fold whose moment (1+ν) D α is constant."""
    cells = 4
    length = tape_spring.HALF
    tape = tape_spring.tape_of(comm, length, round(cells * length / tape_spring.WIDTH), cells)
    middle = gx.Fixed(tape, "left", rotation=True, components=(0,), direction=(1.0, 0.0, 0.0))
    low = gx.Fixed(tape, "bottom left", components=(2,))
    end = gx.RigidRegion(tape, "right", fixed_components=(1,))
    peak = tape_spring.peak_of_section()
    torque = gx.loads.Torque(end.frame, lambda t: (0.0, t * peak, 0.0))
    axis = end.frame.directors[0]

    def turn(state):
        x, _, z = state.system.unknowns.state.vector(axis)
        return math.atan2(-z, x)

    equilibrium = gx.Equilibrium(gx.Scene(tape, middle, low, end, torque))
    found = gx.analysis.path(equilibrium, 1.5, first_step=0.1, probes={"turn": turn}, max_steps=65)
    # Between the largest moment and the one from which on the fold is stable, and behind it, some
    # more come from coarse cells: how many are met depends on the steps.
    upper = found.limit_points[0]
    lower = next(k for k in found.limit_points if k > upper and not found.unstable[k])
    assert 1.0 < found.loads[upper] < 1.15
    assert (found.loads[upper + 1 :] < found.loads[upper]).all()
    # One more or one less is unstable behind each limit point, and nowhere else.
    changes = abs(np.diff(found.unstable))
    is_limit = np.isin(np.arange(1, len(found.loads)), found.limit_points)
    np.testing.assert_array_equal(changes, is_limit)
    assert not found.unstable[:upper].any() and found.unstable[upper:lower].all()
    turned = np.degrees(found.columns["turn"] - found.columns["turn"][0])
    assert turned[upper:lower].min() < turned[upper] - 1.5
    fold = turned > 2 * turned[upper]
    assert turned[-1] > 25 and fold.sum() > 5
    plateau = tape_spring.PLATEAU / peak
    np.testing.assert_allclose(found.loads[fold], plateau, rtol=0.1)


@pytest.mark.mpi
@pytest.mark.parametrize("by", ["", "pressure.pressure"])
def test_wrinkling_film_under_pressure(comm, by):
    """A film held by its corners wrinkles: the path has the equilibria that are found at its
    loads."""
    law = gx.Miyazaki(1e8, 0.3, density=1000.0, thickness=1e-4, residual_stiffness=1e-3)
    film = gx.Membrane(sheet(comm, 6, 6, crossed=True), law)
    corners = [gx.Fixed(film, corner) for corner in CORNERS]
    pressure = 10.0 if by else lambda t: 10.0 * t
    pushed = gx.Pressure(film, pressure)
    equilibrium = gx.Equilibrium(gx.Scene(film, pushed, *corners))
    middle = gx.probes.Position(film.port_at((0.5, 0.5, 0.0)), "z")
    probes = {"z": middle}
    found = gx.analysis.path(equilibrium, 3.0, by=by, start=1.0, first_step=0.7, probes=probes)
    assert found.complete and found.limit_points == ()
    # From another guess, at loads that are functions of the time.
    again = gx.Pressure(film, lambda t: 10.0 * t)
    fresh = gx.Equilibrium(gx.Scene(film, again, *corners))
    heights = []
    for load in found.loads:
        fresh.find(at=float(load))
        heights.append(middle(fresh))
    np.testing.assert_allclose(found.columns["z"], heights, rtol=1e-8)


def drum(comm, g):
    """A film of weight g on a closed box of gas, which it bulges into thinner air."""
    law = gx.Linear(E=1e7, nu=0.3, density=1000.0, thickness=1e-4)
    film = gx.Membrane(airbag(comm, 1.0, 6), law, initial_stress=1e6, name="film")
    gas = gx.Chamber(
        film,
        gas=gx.IdealGas(gamma=1.4, R=287.05),
        pressure=2e3,
        temperature=300.0,
        dead_volume=0.2,
        outside=gx.gas.Ambient(1e3, 300.0),
    )
    held = [gx.Fixed(film, "seam"), gx.Fixed(film, "bottom")]
    return gx.Equilibrium(gx.Scene(gas, gx.Gravity(film, (0.0, 0.0, -g)), *held))


@pytest.mark.mpi
def test_film_of_growing_weight_on_closed_gas(comm):
    """The gas takes part in the path and in its stability: its pressure is that of the equilibria
    that are found under the first and the last weight."""
    equilibrium = drum(comm, g=5e3)
    probes = {"p": lambda state: state.chamber("chamber").pressure}
    found = gx.analysis.path(
        equilibrium, 1.5, by="gravity of film.g", first_step=0.5, probes=probes
    )
    pressures = []
    for factor in found.loads[[0, -1]]:
        fresh = drum(comm, g=5e3 * factor)
        fresh.find()
        pressures.append(fresh.chamber("chamber").pressure)
    np.testing.assert_allclose(found.columns["p"][[0, -1]], pressures, rtol=1e-9)
    # The weight has compressed the gas.
    assert pressures[0] < 0.99 * pressures[1]
    assert not found.unstable.any()


def test_steps_do_not_depend_on_the_mesh(comm):
    """The same loads, but for what the finer film is softer."""
    loads = []
    for cells in (4, 8):
        law = gx.Linear(E=1e8, nu=0.3, density=1000.0, thickness=1e-4)
        film = gx.Membrane(sheet(comm, cells, cells), law, initial_stress=1e5)
        held = [gx.Fixed(film, edge) for edge in EDGES]
        pressure = gx.Pressure(film, lambda t: 500.0 * t)
        equilibrium = gx.Equilibrium(gx.Scene(film, pressure, *held))
        loads.append(gx.analysis.path(equilibrium, 1.0).loads)
    assert len(loads[0]) == len(loads[1])
    np.testing.assert_allclose(loads[0], loads[1], rtol=0.1)


@pytest.mark.mpi
def test_a_path_is_continued_as_if_it_had_not_ended(comm):
    """From a point before the branch, from the branch, and behind the limit point of an arch."""
    whole = equilibrium_paths.arch(comm, 8, rise=6.0).follow(0.3)
    made = equilibrium_paths.arch(comm, 8, rise=6.0)
    part = replace(made, max_steps=2).follow(0.3)
    assert not part.complete
    loads = [*part.loads]
    unstable = [*part.unstable]
    while len(loads) < len(whole.loads):
        part = gx.analysis.path(
            made.equilibrium, made.until, probes=made.probes, max_steps=3, resume=True
        )
        loads += [*part.loads[1:]]
        unstable += [*part.unstable[1:]]
    count = len(whole.loads)
    np.testing.assert_allclose(loads[:count], whole.loads, atol=1e-8)
    np.testing.assert_array_equal(unstable[:count], whole.unstable)
    made.equilibrium.find()
    with pytest.raises(gx.InputError, match="resume continues the path that was found last"):
        gx.analysis.path(made.equilibrium, 1.0, resume=True)


@pytest.mark.mpi
def test_a_path_is_recorded_over_its_load(comm, folder):
    """Points in their order, curves over a load that falls between the limit points."""
    bars, supports = truss(comm)
    apex = bars.port("point 1")
    push = gx.loads.Force(apex, lambda t: (0.0, 0.0, -t * LIMIT_LOAD))
    probes = {"height z [m]": gx.probes.Position(apex, "z")}
    recording = gx.Recording(folder / "snap", probes=probes, every=1)
    found = gx.analysis.path(
        gx.Equilibrium(gx.Scene(*supports, push)), 1.5, probes=probes, outputs=[recording]
    )
    comm.barrier()
    reader = gx.plot.RunReader(folder / "snap")
    assert reader.times.tolist() == [*range(len(found.loads))]
    ledger = reader.table("ledger.csv")
    np.testing.assert_array_equal(ledger["load factor"], found.loads)
    np.testing.assert_array_equal(ledger["unstable"], found.unstable)
    assert (ledger["residual"][1:] < 1e-8).all()
    heights = reader.table("probes.csv")["height z [m]"]
    np.testing.assert_array_equal(heights, found.columns["height z [m]"])
    (limit, _) = found.limit_points
    assert reader.caption(limit, None) == "load factor = 1, unstable"
    curves = run_curves(reader)
    assert curves.label == "load factor"
    assert (curves.start, curves.end) == (found.loads.min(), found.loads.max())
    if comm.rank == 0:
        gx.write_report(reader, folder / "snap.html")
        assert "load factor = 1.5, stable" in (folder / "snap.html").read_text()
    comm.barrier()


def test_refused_paths(comm):
    bars, supports = truss(comm)
    push = gx.loads.Force(bars.port("point 1"), (0.0, 0.0, -1.0), name="push")
    equilibrium = gx.Equilibrium(gx.Scene(*supports, push))
    with pytest.raises(gx.InputError, match=r"path: until is 0\.0, and so is start"):
        gx.analysis.path(equilibrium, 0.0)
    with pytest.raises(gx.InputError, match=r"path: the scene has no item 'pull'"):
        gx.analysis.path(equilibrium, 1.0, by="pull.force")
    with pytest.raises(gx.InputError, match=r"path: 'push' has no parameter 'weight'"):
        gx.analysis.path(equilibrium, 1.0, by="push.weight")


def test_a_path_that_is_given_up_says_so(comm):
    found = truss_path(comm, max_steps=3)
    assert not found.complete
    assert len(found.loads) == 4
    # A cable that only pulls, and whose end is pushed in: it has no stiffness then.
    rope = gx.Cable(line(comm, [(0, 0, 0), (1, 0, 0)], 1), gx.TensionOnly(EA, line_density=1.0))
    pull = gx.loads.Force(rope.port("end"), lambda t: (1 - t, 0.0, 0.0))
    held = [gx.Fixed(rope, "start"), gx.Fixed(rope, "end", components=(1, 2))]
    equilibrium = gx.Equilibrium(gx.Scene(*held, pull))
    with pytest.raises(gx.NoEquilibrium, match="path: no further equilibrium"):
        gx.analysis.path(equilibrium, 2.0)
    # It stands at the last point, just before the cable is slack.
    assert 0.9 < equilibrium.time < 1.0
    force, _ = equilibrium.reaction(held[0])
    assert force[0] == pytest.approx(equilibrium.time - 1, abs=1e-9)


@pytest.mark.parametrize("call", range(4, 40, 3))
def test_a_load_that_is_refused_once_ends_in_a_sentence_or_a_shorter_step(comm, call):
    """Newton's iteration asks for loads far from the path, e.g. for temperatures below 0 K: it
    ended as "error code -1" of PETSc."""
    bars, supports = truss(comm)
    calls = []

    def force(t):
        calls.append(t)
        if len(calls) == call:
            raise ValueError("out of range")
        return (0.0, 0.0, -t * LIMIT_LOAD)

    push = gx.loads.Force(bars.port("point 1"), force)
    equilibrium = gx.Equilibrium(gx.Scene(*supports, push))
    try:
        assert gx.analysis.path(equilibrium, 0.6).complete
    except gx.InputError as error:
        assert "out of range" in str(error)


@pytest.mark.mpi
def test_a_heated_plate_between_clamps_buckles(comm):
    """The load moves nothing up to the branch point, where the frequency vanishes: its square is
    linear in the heat.  Thermal buckling at ΔT = π² t²/(6 (1+ν) α a²), simply supported."""
    t = 5e-3
    nu = 0.3
    alpha = 2e-5
    heat = math.pi**2 * t**2 / (6 * (1 + nu) * alpha)
    warming = gx.materials.ThermalExpansion(
        alpha, lambda X, load: 300.0 + heat * load, reference=300.0
    )
    law = gx.Linear(70e9, nu, density=2700.0, thickness=t)
    plate = gx.Plate(sheet(comm, 8, 8), law, thermal=warming)
    equilibrium = gx.Equilibrium(gx.Scene(*(gx.Fixed(plate, edge) for edge in EDGES)))
    squares = []
    for load in (0.0, 0.5):
        equilibrium.find(at=load)
        squares.append(gx.analysis.modes(equilibrium, 1)[0].frequency ** 2)
    vanishes = 0.5 / (1 - squares[1] / squares[0])
    probes = {"w": gx.probes.Position(plate.port_at((0.5, 0.5, 0.0)), "z")}
    found = gx.analysis.path(equilibrium, 1.5, probes=probes, branch="w")
    (branch,) = found.branch_points
    assert found.loads[branch] == pytest.approx(vanishes, rel=1e-3)
    # 6 % above with 8 cells
    assert 1.0 < found.loads[branch] < 1.1
    assert found.complete and not found.unstable[branch + 1 :].any()
    assert 0.3 * t < found.columns["w"][-1] < t


@pytest.mark.mpi
def test_a_rigid_link_on_a_torsional_spring_leans_over(comm):
    """A load P along a link of length l on a spring k: P l/k = θ/sin θ, of a column of two links
    and springs (3 ± √5)/2.  The load moves nothing before: the branch ended as a division by
    zero."""
    k = 2.0
    length = 0.4
    y = (0.0, 1.0, 0.0)

    def column(links):
        parts = []
        foot = gx.ground_frame()
        for j in range(links):
            middle = (0, 0, (j + 0.5) * length)
            link = gx.RigidBody(
                1.0, (0.01, 0.01, 0.01), position=middle, comm=comm, name=f"link {j}"
            )
            sides = (foot, link.frame((0, 0, -length / 2)))
            spring = gx.connectors.TorsionSpring(*sides, axis=y, stiffness=k, name=f"spring {j}")
            parts += [gx.constraints.RevoluteJoint(*sides, axis=y, name=f"hinge {j}"), spring]
            foot = link.frame((0, 0, length / 2))
        push = gx.loads.Force(link.port((0, 0, length / 2)), lambda t: (0.0, 0.0, -t * k / length))
        top = gx.probes.Position(link.port((0, 0, length / 2)), "x")
        return gx.Equilibrium(gx.Scene(*parts, push)), {"top": top}

    equilibrium, probes = column(1)
    found = gx.analysis.path(equilibrium, 1.5, probes=probes, branch="top")
    (branch,) = found.branch_points
    assert found.loads[branch] == pytest.approx(1.0, abs=2e-4)
    angle = brentq(lambda angle: angle / math.sin(angle) - 1.5, 0.1, 3.0)
    assert found.columns["top"][-1] == pytest.approx(length * math.sin(angle), rel=1e-8)
    equilibrium, probes = column(2)
    found = gx.analysis.path(equilibrium, 3.0, probes=probes)
    exact = [(3 - math.sqrt(5)) / 2, (3 + math.sqrt(5)) / 2]
    np.testing.assert_allclose(found.loads[list(found.branch_points)], exact, atol=1e-3)


def test_contact_is_refused(comm):
    law = gx.Linear(E=1e8, nu=0.3, density=1000.0, thickness=1e-4)
    film = gx.Membrane(sheet(comm, 2, 2), law)
    scene = gx.Scene(
        film, *(gx.Fixed(film, edge) for edge in EDGES), gx.Contact(film, distance=1e-3)
    )
    with pytest.raises(gx.InputError, match="path: the scene has contact"):
        gx.analysis.path(gx.Equilibrium(scene), 1.0)


@pytest.mark.parametrize(
    ("probe", "words"),
    [(lambda run: math.nan, "nan"), (lambda run: "x", "'x'"), (lambda run: 1 / 0, "ZeroDivision")],
)
def test_probes_of_a_path_are_guarded_as_those_of_a_run(
    probe: Callable[[Any], Any], words: str
) -> None:
    ball = gx.PointMass(1.0, (0.0, 0.0, 0.1), name="ball")
    ends = {"left": (-1.0, 0.0, 0.0), "right": (1.0, 0.0, 0.0), "side": (0.0, 5.0, 0.1)}
    springs = [
        gx.connectors.Spring(ball.port(), gx.Ground(end), stiffness=1e3, length=0.9, name=name)
        for name, end in ends.items()
    ]
    scene = gx.Scene(*springs, gx.loads.Force(ball.port(), force=lambda t: (0.0, 0.0, -4.0 * t)))
    with pytest.raises(gx.InputError, match=f"'height'.*{words}"):
        gx.analysis.path(gx.Equilibrium(scene), 1.0, probes={"height": probe})
