"""Tension, strain and length of cables, beams and connectors against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet
from tests.small_scenes import at_rest, run_until

ROPE = gx.TensionOnly(1e4, 0.01)
BOOM = gx.sections.tube(0.02, 5e-4, E=100e9, nu=0.3, density=1560.0)
TOP = gx.Ground((0.0, 0.0, 0.0))


def values(line_part, state):
    return [gx.probes.Tension(line_part, which)(state) for which in ("least", "mean", "largest")]


# ---- connectors ----------------------------------------------------------------------------------


def test_spring_bears_a_weight(comm):
    """N = m g, l = L + m g/k: a spring, a rope and a tether whose length is a function of time."""
    k = 100.0
    natural = 1.0
    load = 20.0
    for connect in (
        lambda port: gx.connectors.Spring(port, TOP, stiffness=k, length=natural),
        lambda port: gx.connectors.Rope(port, TOP, stiffness=k, length=natural),
        lambda port: gx.connectors.Tether(port, TOP, stiffness=k, length=lambda t: natural),
    ):
        mass = gx.PointMass(2.0, (0.0, 0.0, -1.1), comm=comm)
        part = connect(mass.port())
        equilibrium = at_rest(mass, gx.Gravity(mass, (0.0, 0.0, -load / 2.0)), part)
        assert values(part, equilibrium) == pytest.approx([load] * 3, rel=1e-7)
        length = gx.probes.Length(part)(equilibrium)
        assert length == pytest.approx(natural + load / k, rel=1e-9)
        strain = gx.probes.AxialStrain(part)(equilibrium)
        assert strain == pytest.approx(load / k / natural, rel=1e-7)


def test_brake_limits_the_tension_of_a_tether(comm):
    """A tether whose brake slips has the tension of its brake, and a longer natural length."""
    mass = gx.PointMass(2.0, (0.0, 0.0, -1.1), comm=comm)
    tether = gx.connectors.Tether(mass.port(), TOP, stiffness=100.0, length=1.0, brake_force=3.0)
    run = gx.Simulation(gx.Scene(mass, tether), gx.Midpoint(dt=1e-3))
    # The initial stretch of 0.1 m would be 10 N.
    assert values(tether, run) == pytest.approx([3.0] * 3, rel=1e-12)
    assert gx.probes.AxialStrain(tether)(run) == pytest.approx(0.03 / 1.07, rel=1e-10)


@pytest.mark.mpi
def test_ropes_of_a_bundle(comm):
    """Each rope by itself: one is taut, one slack; the mean is that of the ropes."""
    masses = [
        gx.PointMass(1.0, (0.0, 0.0, -length), comm=comm, name=f"mass {length}")
        for length in (1.2, 0.8)
    ]
    ropes = gx.connectors.RopeBundle(
        [(mass.port(), TOP) for mass in masses], stiffness=50.0, lengths=[1.0, 1.0]
    )
    run = gx.Simulation(gx.Scene(*masses, ropes), gx.Midpoint(dt=1e-3))
    assert values(ropes, run) == pytest.approx([0.0, 5.0, 10.0], abs=1e-12)
    assert gx.probes.Length(ropes)(run) == pytest.approx(2.0, rel=1e-12)


@pytest.mark.parametrize(
    ("law", "force"),
    [
        (gx.CableLaw(6e3, 0.01), lambda stretch: 6e3 * (stretch**2 - 1) / 2 * stretch),
        (gx.TensionOnly(6e3, 0.01), lambda stretch: 6e3 * (stretch**2 - 1) / 2 * stretch),
        (
            gx.TabulatedCable([0.0, 0.01, 0.1], [0.0, 10.0, 500.0], line_density=0.01),
            lambda stretch: 10.0 + (stretch - 1.01) * 490.0 / 0.09,
        ),
    ],
    ids=["linear", "tension only", "table"],
)
def test_tape_that_is_cut_short(comm, law, force):
    """A tape of 95 % on a film that is fixed everywhere has the tension of its law at 1/0.95."""
    film = gx.Membrane(sheet(comm, 4, 3), gx.Miyazaki(2.5e9, 0.34, density=1420.0, thickness=25e-6))
    tape = gx.connectors.Tape.along_edges(film, law, edges="left", length_factor=0.95)
    held = gx.Equilibrium(gx.Scene(film, tape, gx.Fixed(film, "film")))
    stretch = 1 / 0.95
    assert values(tape, held) == pytest.approx([force(stretch)] * 3, rel=1e-10)
    assert gx.probes.AxialStrain(tape)(held) == pytest.approx(stretch - 1, rel=1e-10)
    assert gx.probes.Length(tape)(held) == pytest.approx(1.0, rel=1e-12)


# ---- cables and beams ----------------------------------------------------------------------------


@pytest.mark.mpi(1)
@pytest.mark.parametrize("order", [1, 2])
def test_hanging_cable(comm, order):
    """A shallow cable under its weight: the horizontal force H with the arc of the catenary.

    With a = H/w the catenary of a nearly inextensible cable of the length S over the span L has
    S = 2 a sinh(L/2a); the tension is H in the middle and H cosh(L/2a) at the ends.
    """
    span = 2.0
    weight = 0.5  # N/m
    stiff = gx.CableLaw(1e7, 0.05)
    length_factor = 1.01
    cable = gx.Cable(
        line(comm, [(0, 0, 0), (span, 0, 0)], 40),
        stiff,
        order=order,
        length_factor=length_factor,
        displacement=lambda X: np.vstack([0 * X[0], 0 * X[0], -0.1 * X[0] * (span - X[0])]),
    )
    supports = [gx.Fixed(cable, "start"), gx.Fixed(cable, "end")]
    gravity = gx.Gravity(cable, (0.0, 0.0, -weight / 0.05))
    hung = at_rest(cable, gravity, *supports)
    low, high = 0.1, 100.0
    for _ in range(200):
        a = math.sqrt(low * high)
        if 2 * a * math.sinh(span / 2 / a) > length_factor * span:
            low = a
        else:
            high = a
    least, mean, largest = values(cable, hung)
    tolerance = {1: 3e-3, 2: 1e-3}[order]
    assert least == pytest.approx(weight * a, rel=tolerance)
    # Gauss points lie within the last cell.
    assert largest == pytest.approx(weight * a * math.cosh(span / 2 / a), rel=2 * tolerance)
    assert least < mean < largest
    assert gx.probes.Length(cable)(hung) == pytest.approx(length_factor * span, rel=1e-5)


@pytest.mark.mpi
def test_field_along_a_cable_of_groups(comm):
    """Without motion the field "tension" is the initial tension; the probe has its mean."""
    cable = gx.Cable(
        line(comm, [(0, 0, 0), (1, 0, 0)], 10),
        ROPE,
        initial_tension=lambda X: 10.0 + 40.0 * X[0],
    )
    held = gx.Equilibrium(gx.Scene(cable, gx.Fixed(cable, "line")))
    points, tension = gx.fields.field_values(held, cable, field="tension")
    middles = np.floor(points[:, 0] * 10 - 1e-9)
    assert np.abs(tension - 10.0 - 40.0 * points[:, 0]).max(initial=0.0) < 2.0 + 1e-9
    assert len(points) == len(middles)
    least, mean, largest = values(cable, held)
    assert (least, mean, largest) == pytest.approx((12.0, 30.0, 48.0), rel=1e-10)


def test_bent_beam_has_no_tension(comm):
    """A cantilever under a transverse force at its tip bears F sin φ; under an axial one F."""
    boom = gx.Beam(line(comm, [(0, 0, 0), (2, 0, 0)], 6), BOOM, name="boom")
    force = gx.loads.Force(boom.port("end"), (0.0, 5.0, 0.0))
    bent = at_rest(boom, force, gx.Fixed(boom, "start", rotation=True))
    least, mean, largest = values(boom, bent)
    # N = F sin φ with the slope φ = F (L s - s²/2)/EI, whose mean is F L²/3EI.
    assert mean == pytest.approx(5.0 * 5.0 * 2.0**2 / (3 * BOOM.EI2), rel=0.02)
    # At the nodes the quadratic elements would have a strain of (κ h)²/24, 1e-6 and 6 N here.
    assert max(-least, largest) < 2e-8 * BOOM.EA
    boom = gx.Beam(line(comm, [(0, 0, 0), (2, 0, 0)], 6), BOOM, name="boom")
    force = gx.loads.Force(boom.port("end"), (-7.0, 0.0, 0.0))
    pressed = at_rest(boom, force, gx.Fixed(boom, "start", rotation=True))
    assert values(boom, pressed) == pytest.approx([-7.0] * 3, rel=1e-6)


@pytest.mark.mpi(1)
@pytest.mark.parametrize("order", [1, 2])
def test_curve_along_a_cable(comm, order):
    """A cable that hangs straight down bears μ g (L - s) at the distance s from its support."""
    μ = 0.2
    law = gx.CableLaw(1e6, μ)
    hanging = gx.Cable(line(comm, [(0, 0, 0), (0, 0, -3)], 12), law, order=order)
    gravity = gx.Gravity(hanging, (0.0, 0.0, -10.0))
    statics = at_rest(hanging, gravity, gx.Fixed(hanging, "start"))
    found = gx.fields.line_values(statics, hanging)
    assert found.distance == pytest.approx((np.arange(12) + 0.5) / 4, rel=1e-4)
    assert found.tension == pytest.approx(μ * 10.0 * (3.0 - found.distance), rel=1e-4)
    assert found.points[:, 2] == pytest.approx(-found.distance, rel=1e-6)
    assert found.strain == pytest.approx(found.tension / 1e6, rel=1e-4)
    assert found.length.sum() == pytest.approx(gx.probes.Length(hanging)(statics), rel=1e-12)


@pytest.mark.mpi
def test_curve_along_a_tape_is_in_order(comm):
    """Bars of a tape along an edge are in their order along it on any number of ranks."""
    film = gx.Membrane(sheet(comm, 6, 5), gx.Miyazaki(2.5e9, 0.34, density=1420.0, thickness=25e-6))
    tape = gx.connectors.Tape.along_edges(film, ROPE, edges="top", length_factor=0.9)
    held = gx.Equilibrium(gx.Scene(film, tape, gx.Fixed(film, "film")))
    found = gx.fields.line_values(held, tape)
    steps = np.diff(found.points[:, 0])
    assert steps == pytest.approx(np.full(5, 1 / 6), rel=1e-9)


# ---- runs and refusals ---------------------------------------------------------------------------


def test_what_is_refused(comm):
    mass = gx.PointMass(1.0, (0.0, 0.0, -1.0), comm=comm)
    spring = gx.connectors.Spring(mass.port(), TOP, stiffness=1.0, length=1.0)
    other = gx.connectors.Spring(mass.port(), TOP, stiffness=1.0, length=1.0, name="other")
    run = gx.Simulation(gx.Scene(mass, spring), gx.Midpoint(dt=1e-3))
    with pytest.raises(gx.InputError, match="'other' is not in the scene"):
        gx.probes.Tension(other)(run)
    with pytest.raises(gx.InputError, match="'mean' or 'least' or 'largest'"):
        gx.probes.Tension(spring, "max")
    with pytest.raises(gx.InputError, match="Spring, Rope, RopeBundle, Tether or Tape"):
        gx.probes.Tension(mass)
    cable = gx.Cable(line(comm, [(0, 0, 0), (1, 0, 0)], 2), ROPE)
    with pytest.raises(gx.InputError, match="'cable' is not in the scene"):
        gx.probes.Tension(cable)(run)


def test_recorded_tensions_are_in_table_report_and_curves(comm, tmp_path):
    """A cable before a spring: both have the tension that a force on their joint leaves."""
    cable = gx.Cable(
        line(comm, [(0, 0, 0), (1, 0, 0)], 4), gx.CableLaw(1e4, 0.01), initial_tension=10.0
    )
    spring = gx.connectors.Spring(
        cable.port("end"), gx.Ground((2.0, 0.0, 0.0)), stiffness=1e5, length=0.9999
    )
    statics = gx.Equilibrium(gx.Scene(cable, spring, gx.Fixed(cable, "start")))
    fields = {"cable": ("displacement", "tension")}
    recording = gx.Recording(tmp_path / "run", fields)
    gx.outputs.record(statics, [recording], at=[0.0, 1.0])
    recorded = gx.plot.RunReader(tmp_path / "run")
    tensions = recorded.table("tensions.csv")
    columns = [f"cable {which} [N]" for which in ("mean", "least", "largest")]
    assert list(tensions) == ["load parameter", "step", *columns, "spring mean [N]"]
    for name in (*columns, "spring mean [N]"):
        assert tensions[name][-1] == pytest.approx(10.0, rel=1e-6)
    assert recorded.known_fields() == ["displacement", "tension"]
    gx.plot.field(recorded, "tension", times=[0.0], path=tmp_path / "lines.png")
    gx.write_report(recorded, tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    assert "<h2>Tensions at the end</h2>" in page
    assert "<h2>Prestress</h2>" in page
    reached = recorded.about["prestress"]["cable"]
    assert reached["mean"] == pytest.approx(10.0, rel=1e-6)


def test_pictures_colour_lines_by_their_tension(comm, tmp_path):
    """A cable of the field, a rope and a tape of the table; film and slack lines have no colour."""
    film = gx.Membrane(sheet(comm, 4, 3), gx.Miyazaki(2.5e9, 0.34, density=1420.0, thickness=25e-6))
    tape = gx.connectors.Tape.along_edges(film, ROPE, edges="top", length_factor=0.999)
    cable = gx.Cable(line(comm, [(0, 0, 1), (1, 0, 1)], 3), ROPE, initial_tension=10.0)
    rope = gx.connectors.Rope(
        film.port("bottom left"), gx.Ground((-1.0, 0.0, 0.0)), stiffness=50.0, length=0.9
    )
    supports = [gx.Fixed(film, "film"), gx.Fixed(cable, "line")]
    statics = gx.Equilibrium(gx.Scene(film, tape, cable, rope, *supports))
    fields = {"cable": ("displacement", "tension")}
    gx.outputs.record(statics, [gx.Recording(tmp_path / "lines", fields)], at=[0.0])
    recorded = gx.plot.RunReader(tmp_path / "lines")
    assert recorded.known_fields()[-1] == "tension"
    values = {round(float(value), 3) for part in recorded.values("tension", 0) for value in part[0]}
    of_tape = gx.probes.Tension(tape)(statics)
    assert values == {10.0, 5.0, round(of_tape, 3)}

    def kinds(found):
        return np.rint(10 * np.nan_to_num(found)).astype(np.int64)

    shape = recorded.shape(0, "tension", kinds)
    # Three pieces of the cable, then four bars of the tape and the rope in the order of the scene
    assert sorted(shape.line_kinds)[:4] == [50, 100, 100, 100]
    assert len(shape.line_kinds) == len(shape.lines) == 3 + 4 + 1
    plain = recorded.shape(0, "displacement", kinds)
    assert set(plain.line_kinds) == {-2}


def test_a_scene_without_lines_has_no_table_of_tensions(comm, tmp_path):
    mass = gx.PointMass(1.0, (0.0, 0.0, -1.0), comm=comm)
    run_until(2e-3, mass, dt=1e-3, outputs=[gx.Recording(tmp_path / "run")])
    assert not (tmp_path / "run" / "tensions.csv").exists()
