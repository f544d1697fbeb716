"""Curves of runs: bands of many parts, whole numbers at axes, the forms of equilibria and modes."""

from __future__ import annotations

import math
import re
from functools import partial
from html import unescape
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.records.fields.units import scaled_unit, with_decimals, without_round_off
from gossamer_fx.records.plot import page
from gossamer_fx.records.plot.curve_panels import (
    LINES,
    _in_bands,
    _line_colours,
    _lines,
    _probes,
    grouped,
    label_ends,
    run_curves,
)
from gossamer_fx.records.plot.report import _table

T = np.linspace(0.0, 1.0, 5)
TENDONS = {f"tendon {k}": k * (1 + T) for k in range(1, 13)}  # N


def test_many_parts_are_drawn_as_a_band_with_their_mean() -> None:
    """Twelve tendons from 1 to 12 N, at the end from 2 to 24 N."""
    curves = _in_bands(TENDONS)
    axes = Figure().subplots()
    _lines(T, curves, _line_colours(curves), "Tension", "N", axes)
    (band,) = axes.collections
    corners = band.get_paths()[0].vertices
    at_end = corners[corners[:, 0] == 1.0, 1]
    assert (at_end.min(), at_end.max()) == pytest.approx((2.0, 24.0))
    means = [line for line in axes.lines if line.get_ydata()[0] == pytest.approx(6.5)]
    assert len(means) == 1
    assert {line.get_color() for line in axes.lines} == {LINES[0]}


def test_a_family_becomes_a_band_and_other_parts_keep_their_curves() -> None:
    curves = _in_bands(TENDONS | {"boom": 100 + T, "mast": 200 + T})
    assert list(curves) == [
        "largest of 12 tendon",
        "mean of 12 tendon",
        "least of 12 tendon",
        "boom",
        "mast",
    ]
    assert curves["least of 12 tendon"] == pytest.approx(1 + T)
    colours = _line_colours(curves)
    assert len(set(colours.values())) == 3
    # Few parts stay what they are, and too many others become one band.
    assert _in_bands({"a 1": T, "a 2": T}) == {"a 1": T, "a 2": T}
    names = [f"part {letter}" for letter in "abcdefgh"]
    assert next(iter(_in_bands(dict.fromkeys(names, T)))) == "largest of 8"


def test_numbers_at_an_axis_need_no_addition() -> None:
    """A pressure about 101 325 Pa has neither "+1.01e5" nor a power of ten at the axis."""
    with matplotlib.rc_context(page._STYLE):
        figure = Figure()
        axes = figure.subplots()
        _probes(T, "inside [Pa]", {"": 101325.0 + 0.01 * T}, axes)
        figure.draw_without_rendering()
        assert axes.yaxis.get_offset_text().get_text() == ""
        labels = [label.get_text() for label in axes.get_yticklabels()]
    assert axes.get_title(loc="left") == "inside [kPa]"
    assert len(set(labels)) == len(labels) > 2
    assert all(label.startswith("101.32") for label in labels)


def test_numbers_keep_their_decimals() -> None:
    assert with_decimals(15.0) == "15.00"
    assert with_decimals(0.1) == "0.1000"
    assert with_decimals(1234.5) == "1234"


# ---- equilibria and modes ------------------------------------------------------------------------

STIFFNESS = 50.0  # N/m
MASS = 2.0  # kg
FORCES = [1.0, 2.0, 4.0]  # N


def held(stiffness: float) -> gx.Equilibrium:
    """A mass on a spring along x [N/m] and stiffer ones along y and z; the load parameter pulls
    it along x [N]."""
    mass = gx.PointMass(MASS, comm=MPI.COMM_SELF, name="mass")
    springs = [
        gx.connectors.AxialSpring(
            mass.port(), factor * stiffness, direction=axis, name=f"spring {factor}"
        )
        for factor, axis in ((1, (1.0, 0.0, 0.0)), (4, (0.0, 1.0, 0.0)), (9, (0.0, 0.0, 1.0)))
    ]
    pull = gx.loads.Force(mass.port(), lambda t: (t, 0.0, 0.0))
    return gx.Equilibrium(gx.Scene(mass, *springs, pull))


def plain(html: str) -> str:
    """The text of a page without its tags and data."""
    html = re.sub(r"(?s)<(script|style).*?</\1>", "", html)
    return " ".join(unescape(re.sub(r"<[^>]+>", " ", html)).split())


def test_the_report_of_equilibria_has_load_residual_and_energies(tmp_path: Path) -> None:
    """Of a spring: stored F²/2k and supplied F²/k, the work of a force that is there at once."""
    statics = held(STIFFNESS)
    recording = gx.Recording(tmp_path / "path", title="pulled")
    gx.outputs.record(statics, [recording], at=FORCES, along="force [N]")
    reader = gx.plot.RunReader(tmp_path / "path")
    ledger = reader.table("ledger.csv")
    assert (ledger["residual"] < 1e-8).all()
    gx.write_report(reader, tmp_path / "report.html")
    words = plain((tmp_path / "report.html").read_text())
    assert "Equilibria at unbalanced force iterations supplied [J] stored [J]" in words
    for row, force in enumerate(FORCES):
        stored = force**2 / (2 * STIFFNESS)
        found = re.search(rf"force = {force:g} N (\S+) (\d+) (\S+) {stored:.6g} ", words)
        assert found is not None
        assert float(found[3]) == pytest.approx(ledger["supplied"][row], rel=1e-5)
    # What an equilibrium does not have
    assert "momentum" not in words and "largest magnitude" not in words
    panels = [one for one in run_curves(reader).panels if isinstance(one, partial)]
    assert "_residuals" in [one.func.__name__ for one in panels]
    energies = panels[0].args[1]
    assert energies["stored, all"] == pytest.approx(np.array(FORCES) ** 2 / (2 * STIFFNESS))


def test_a_mode_says_that_its_amplitude_is_arbitrary(tmp_path: Path) -> None:
    statics = held(MASS * (2 * math.pi * 15.0) ** 2)
    statics.find()
    modes = gx.analysis.modes(statics, 1)
    (folder,) = gx.outputs.record_modes(statics, modes, tmp_path, amplitude=0.1, frames=4)
    reader = gx.plot.RunReader(folder)
    assert reader.title == "Mode 1: 15.00 Hz"
    gx.write_report(reader, tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text()
    assert "the amplitude of a mode is arbitrary" in text
    # Nor are its energies drawn or listed.
    assert "<picture>" not in text
    assert "Ledger" not in text and "momentum" not in text


def test_what_is_empty_is_left_out(tmp_path: Path) -> None:
    """The energies of a mass that rests where nothing acts, and columns without a cell."""
    rest = gx.PointMass(1.0, comm=MPI.COMM_SELF, name="mass")
    recording = gx.Recording(tmp_path / "rest", every=1)
    gx.Simulation(gx.Scene(rest), gx.Midpoint(dt=0.1), outputs=[recording]).run(until=0.3)
    reader = gx.plot.RunReader(tmp_path / "rest")
    titles = [one.args[3] for one in run_curves(reader).panels if one.func is _lines]
    assert "Energy" not in titles
    table = plain(_table(("[N]", "mean", "least"), [("rope", "1.5", ""), ("tie", "2.5", "")]))
    assert table == "[N] mean rope 1.5 tie 2.5"


@pytest.mark.parametrize(
    ("largest", "unit", "factor", "words"),
    [
        (0.02, "m", 1e-3, "mm"),
        (8e-3, "kg m²/s", 1e-3, "10⁻³ kg m²/s"),
        (2e3, "1/m", 1e3, "10³ 1/m"),
        (2e-6, "m³", 1e-6, "10⁻⁶ m³"),
        (0.02, "N m/m", 1e-3, "mN m/m"),
        (0.02, "rad/s", 1e-3, "mrad/s"),
        (2.0, "kg m²/s", 1.0, "kg m²/s"),
        (0.499, "", 1.0, ""),
        (4e-4, "", 1e-6, "10⁻⁶"),
        (0.0, "m", 1.0, "m"),
    ],
)
def test_units_keep_whole(largest: float, unit: str, factor: float, words: str) -> None:
    """No mkg, no mm³ that is not the cube of a mm."""
    assert scaled_unit(largest, unit) == (pytest.approx(factor), words)


def test_the_title_of_curves_that_differ_in_a_word_ends_in_a_noun() -> None:
    probes = {"spin of the hub [rad/s]": T, "spin of the sail [rad/s]": T}
    assert list(grouped(probes)) == ["spin [rad/s]"]
    assert list(grouped(probes)["spin [rad/s]"]) == ["hub", "sail"]


def test_names_of_curves_that_end_together_keep_their_order() -> None:
    """Values that differ by round-off only would shuffle 0 1 2 3 4 5."""
    axes = Figure().subplots()
    axes.plot([0, 1], [0, 1])
    noise = [0.0, 2e-9, 1e-9, 3e-9, 5e-9, 4e-9]
    label_ends(axes, [(f"{k}", 0.5 + by, "black") for k, by in enumerate(noise)])
    heights = {text.get_text(): text.xy[1] for text in axes.texts}
    assert sorted(heights, key=lambda name: -heights[name]) == list("012345")


def test_a_probe_that_is_zero_throughout_has_no_panel(tmp_path: Path) -> None:
    ball = gx.PointMass(1.0, velocity=(1.0, 0.0, 0.0), comm=MPI.COMM_SELF, name="ball")
    probes = {"x [m]": gx.probes.Position(ball.port(), "x"), "penetrations": lambda run: 0.0}
    recording = gx.Recording(tmp_path, every=1, probes=probes)
    run = gx.Simulation(gx.Scene(ball), gx.Midpoint(dt=0.1), outputs=[recording])
    run.run(until=0.3)
    panels = list(run_curves(gx.plot.RunReader(tmp_path)).panels)
    drawn = [one.args[1] for one in panels if isinstance(one, partial) and one.func is _probes]
    assert drawn == ["x [m]"]


def test_a_curve_that_changes_by_round_off_is_flat() -> None:
    """Not an axis with fourteen digits."""
    axes = Figure().add_subplot()
    values = -0.2 + 2e-13 * np.arange(3)
    axes.plot([0, 1, 2], values)
    label_ends(axes, [("", float(values[-1]), "k")])
    low, high = axes.get_ylim()
    assert (low, high) == pytest.approx((-0.21, -0.19))


def test_round_off_among_numbers_of_a_unit_is_zero() -> None:
    numbers = {"a [N]": 700.0, "b [N]": -3e-13, "hinge [N m]": 5e-22, "share": 1e-20}
    found = without_round_off(numbers)
    assert found == {"a [N]": 700.0, "b [N]": 0.0, "hinge [N m]": 0.0, "share": 1e-20}
    curves = without_round_off({"z [m]": np.array([1.0, 1e-15, 0.5])})
    assert list(curves["z [m]"]) == [1.0, 0.0, 0.5]
