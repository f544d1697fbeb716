"""Measured series over the probes of a run: units, gaps, differences, and files that are
refused."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.app.cli.command import main
from gossamer_fx.records.plot.curve_panels import overlay_curves
from gossamer_fx.records.plot.measured_series import (
    MeasuredSeries,
    read_measured,
    rms_difference,
    unit_factor,
)
from tests.small_scenes import run_until

G = 9.81
DT = 0.01


@pytest.fixture(scope="module")
def fall(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A ball that falls from rest; the heights of the midpoint rule are exact."""
    folder = tmp_path_factory.mktemp("fall") / "run"
    ball = gx.PointMass(1.0, (0.0, 0.0, 0.0), comm=MPI.COMM_SELF, name="ball")
    probes = {
        "ball z [m]": gx.probes.Position(ball.port(), "z"),
        "speed [m/s]": lambda run: G * run.time,
        "turns": lambda run: 1.0,
    }
    run_until(
        20 * DT,
        gx.Gravity(ball, (0.0, 0.0, -G)),
        dt=DT,
        outputs=[gx.Recording(folder, every=1, probes=probes)],
    )
    return folder


def difference(series: MeasuredSeries, run: gx.plot.RunReader) -> float:
    """Of a measured series and the probe of a run."""
    probes = run.table("probes.csv")
    return rms_difference(series, probes["time"], probes[series.probe])


def test_measured_values_are_converted_to_the_unit_of_the_probe(fall: Path, tmp_path: Path) -> None:
    t = np.array([0.05, 0.1, 0.2])
    rows = [f"{1e3 * s},{-1e3 * G * s**2 / 2},{100 * G * s},100" for s in t]
    path = tmp_path / "drop.csv"
    # With the byte order mark of spreadsheets.
    head = "time [ms], ball z [mm] ,speed [cm/s],turns [%]"
    path.write_text("\n".join([head, *rows]), encoding="utf-8-sig")
    run = gx.plot.RunReader(fall)
    z, speed, turns = read_measured(path, run)
    assert (z.label, z.probe) == ("drop", "ball z [m]")
    assert z.t == pytest.approx(t)
    assert z.y == pytest.approx(-G * t**2 / 2)
    assert speed.y == pytest.approx(G * t)
    assert turns.y == pytest.approx([1.0, 1.0, 1.0])
    assert difference(z, run) < 1e-12


def test_differences_are_taken_within_the_run_and_empty_cells_are_left_out(
    fall: Path, tmp_path: Path
) -> None:
    path = tmp_path / "test.csv"
    path.write_text("t;ball z [m]\n0;0.003\n0.1;\n0.1;-0.04605\n\n9;5\n")
    run = gx.plot.RunReader(fall)
    (series,) = read_measured(path, run)
    assert series.t.tolist() == [0, 0.1, 9]
    # 3 mm too high at both times; the time 9 s is after the end of the run.
    assert difference(series, run) == pytest.approx(3e-3)
    path.write_text("t,ball z [m]\n9,5\n")
    (late,) = read_measured(path, run)
    assert math.isnan(difference(late, run))


def test_the_command_draws_measured_series(fall: Path, tmp_path: Path, capsys) -> None:
    from PIL import Image

    paths = [tmp_path / "camera.csv", tmp_path / "gauge.csv"]
    paths[0].write_text("time [s],ball z [mm]\n0,0\n0.1,-50\n0.2,-190\n")
    paths[1].write_text("time [s],speed [m/s],ball z [m]\n0.1,1,-0.05\n0.2,2,-0.2\n")
    assert main(["plot", str(fall), "--with", *map(str, paths)]) == 0
    assert capsys.readouterr().out.strip() == str(fall / "measured.png")
    with Image.open(fall / "measured.png") as image:
        pixels = np.asarray(image.convert("RGB"))
    blue = (abs(pixels.astype(int) - (0x00, 0x72, 0xB2)) < 30).all(axis=2)
    orange = (abs(pixels.astype(int) - (0xD5, 0x5E, 0x00)) < 30).all(axis=2)
    # Both panels have the computed line and measured marks.
    half = pixels.shape[1] // 2
    for colours in (blue, orange):
        assert colours[:, :half].any() and colours[:, half:].any()


@pytest.mark.parametrize(
    ("text", "culprit"),
    [
        ("", "0 rows"),
        ("time [s],ball z [m]\n", "1 rows"),
        ("ball z [m]\n1\n", "'time [s]'"),
        ("time [s]\n1\n", "no column besides the time"),
        ("time [s],time\n1,1\n", "two columns 'time'"),
        ("time [s],ball x [m]\n0,1\n", "'ball x [m]'"),
        ("time [s],ball z [kg]\n0,1\n", "'kg'"),
        ("time [s],ball z [m²]\n0,1\n", "'m²'"),
        ("time [s],ball z\n0,1\n", "the probe's 'm'"),
        ("time [m],ball z [m]\n0,1\n", "'time [m]'"),
        ("time [s],ball z [m]\n0,high\n", "'high'"),
        ("time [s],ball z [m]\n0,nan\n", "'nan'"),
        ("time [s],ball z [m]\n0,1,2\n", "3 cells"),
        ("time [s],ball z [m]\n0,\n", "no value"),
        ("time [s],ball z [m]\n0,\0\n", "row 2"),
    ],
)
def test_a_bad_file_is_refused_in_one_sentence(
    text: str, culprit: str, fall: Path, tmp_path: Path, capsys
) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    assert main(["plot", str(fall), "--with", str(path)]) == 2
    message = capsys.readouterr().err
    assert message.startswith("gossamer: ") and message.count("\n") == 1
    assert culprit in message and "bad.csv" in message


def test_missing_files_and_two_pictures_at_a_time_are_refused(
    fall: Path, tmp_path: Path, capsys
) -> None:
    for words, culprit in (
        (["--with", str(tmp_path / "no.csv")], "no.csv"),
        (["--with", str(tmp_path)], "There is no table"),
        (["--with", "a.csv", "--curves"], "one of them"),
    ):
        assert main(["plot", str(fall), *words]) == 2
        message = capsys.readouterr().err
        assert message.count("\n") == 1 and culprit in message


@pytest.mark.parametrize(
    ("unit", "wanted", "factor"),
    [
        ("mm", "m", 1e-3),
        ("µm", "mm", 1e-3),
        ("mm²", "m²", 1e-6),
        ("cm^3", "m³", 1e-6),
        ("N mm", "N m", 1e-3),
        ("N/mm²", "MPa", None),
        ("kPa", "Pa", 1e3),
        ("bar", "kPa", 100.0),
        ("rpm", "rad/s", math.pi / 30),
        ("deg/s", "rad/s", math.pi / 180),
        ("rad/s", "rpm", 30 / math.pi),
        ("mm/min", "m/s", 1e-3 / 60),
        ("g", "kg", 1e-3),
        ("Hz", "1/s", 1.0),
        ("%", "1", 0.01),
        ("flops", "flops", 1.0),
        ("min", "m", None),
        ("m", "m/s", None),
    ],
)
def test_units_are_converted_or_refused(unit: str, wanted: str, factor: float | None) -> None:
    if factor is None:
        with pytest.raises(gx.InputError, match=re.escape(f"'{unit}'")):
            unit_factor(unit, wanted, "column")
    else:
        assert unit_factor(unit, wanted, "column") == pytest.approx(factor)


def test_no_series_is_refused_in_words(fall: Path, tmp_path: Path) -> None:
    run = gx.plot.RunReader(fall)
    with pytest.raises(gx.InputError, match="there are no measured series"):
        overlay_curves(run, [])
    with pytest.raises(gx.InputError, match="no file of measured values"):
        gx.plot.overlay(run, [], tmp_path / "overlay.png")
