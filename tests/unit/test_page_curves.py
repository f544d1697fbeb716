"""The curves of a page: the data that its script draws are those of the tables."""

from __future__ import annotations

import json
import math
import re
from base64 import b64decode
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.records.plot.curve_data import curve_data
from gossamer_fx.records.plot.curve_panels import Curves, run_curves

DT = 0.01
SPEED = 3.0  # m/s


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> gx.plot.RunReader:
    """A ball that is thrown upwards, recorded with the arguments of its scene."""
    ball = gx.PointMass(2.0, velocity=(1.0, 0.0, SPEED), comm=MPI.COMM_SELF, name="ball")
    probes = {
        "way of the ball x [m]": gx.probes.Position(ball.port(), "x"),
        "way of the ball z [m]": gx.probes.Position(ball.port(), "z"),
    }
    folder = tmp_path_factory.mktemp("throw") / "run"
    given = {"speed": SPEED, "kind": "<ball>", "law": None, "limit": math.inf}
    recording = gx.Recording(folder, probes=probes, parameters=given, title="A throw")
    scene = gx.Scene(ball, gx.Gravity(ball, (0.0, 0.0, -9.81)))
    gx.Simulation(scene, gx.Midpoint(dt=DT), outputs=[recording]).run(until=0.3)
    return gx.plot.RunReader(folder)


def unpacked(packed: dict[str, Any]) -> np.ndarray:
    """Numbers as the script of the page reads them."""
    raw = np.frombuffer(b64decode(packed["data"]), dtype="<u2").reshape(-1, len(packed["low"]))
    values = np.array(packed["low"]) + raw / 65534 * np.array(packed["span"])
    return np.where(raw == 65535, np.nan, values)


def panel_of(data: dict[str, Any], title: str) -> dict[str, Any]:
    """The panel with a title."""
    [found] = [one for one in data["panels"] if one["title"] == title]
    return found


def test_lines_are_those_of_the_tables(run: gx.plot.RunReader) -> None:
    curves = run_curves(run)
    data = curve_data(curves, curves.at(run.times))
    assert data["label"] == "t [ms]" and data["end"] == pytest.approx(300.0)
    assert data["records"] == pytest.approx(1e3 * np.asarray(run.times))
    panel = panel_of(data, "way of the ball [mm]")
    assert [line["name"] for line in panel["lines"]] == ["x", "z"]
    t, z = unpacked(panel["lines"][1]["xy"]).T
    seconds = 1e-3 * t
    exact = 1e3 * (SPEED * seconds - 9.81 * seconds**2 / 2)
    assert z == pytest.approx(exact, abs=2e-5 * np.ptp(exact))
    assert panel["low"] <= z.min() and z.max() <= panel["high"] and not panel["log"]


def test_a_logarithmic_axis_has_logarithms_and_gaps() -> None:
    def draw(axes: Any) -> None:
        axes.set_yscale("log")
        axes.plot([0.0, 1.0, 2.0], [1e-3, 0.0, 1e2], label="one")
        axes.set_ylim(1e-4, 1e3)

    data = curve_data(Curves([draw], end=2.0), np.zeros(0))
    [panel] = data["panels"]
    assert (panel["low"], panel["high"]) == pytest.approx((-4.0, 3.0))
    assert unpacked(panel["lines"][0]["xy"])[:, 1] == pytest.approx([-3, np.nan, 2], nan_ok=True)


def test_states_are_areas_with_names() -> None:
    def draw(axes: Any) -> None:
        axes.stackplot([0.0, 1.0], [30.0, 40.0], [70.0, 60.0], labels=["taut", "slack"])
        axes.set_ylim(0, 100)

    [panel] = curve_data(Curves([draw]), np.zeros(0))["panels"]
    assert [area["name"] for area in panel["areas"]] == ["taut", "slack"]
    assert unpacked(panel["areas"][1]["xy"])[:, 1].max() == pytest.approx(100.0, abs=0.01)


def test_the_report_has_the_curves_and_the_arguments(
    run: gx.plot.RunReader, tmp_path: Path
) -> None:
    about = json.loads((run.folder / "run.json").read_text())
    assert about["parameters"] == {
        "speed": SPEED,
        "kind": "<ball>",
        "law": None,
        "limit": "inf",
    }
    gx.write_report(run, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert "with speed 3.0, kind &lt;ball&gt;, law None, limit inf" in page
    found = re.search(r'<script type="application/json" id="run-data">(.*?)</script>', page)
    assert found is not None
    titles = [panel["title"] for panel in json.loads(found[1])["curves"]["panels"]]
    assert "way of the ball [mm]" in titles and "Energy [J]" in titles


SCENE = """
import gossamer_fx as gx

def build(comm, height=1.0, kind="plain"):
    ball = gx.PointMass(2.0, (0.0, 0.0, height), comm=comm, name="ball")
    return gx.Case(gx.Scene(ball), gx.Midpoint(dt=0.1), until=0.2)
"""


def test_a_run_of_the_command_line_has_all_arguments(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those that are given, and the defaults of the others."""
    from gossamer_fx.app.cli.command import main

    monkeypatch.chdir(tmp_path)
    Path("ball.py").write_text(SCENE)
    assert main(["run", "ball.py", "height=2", "--quiet"]) == 0
    about = json.loads(Path("out/ball/run.json").read_text())
    assert about["parameters"] == {"height": 2, "kind": "plain"}
    assert main(["sweep", "ball.py", "kind=fine", "--over", "height=3,4"]) == 0
    found = [
        json.loads(one.read_text())["parameters"] for one in Path("out").rglob("runs/*/run.json")
    ]
    assert sorted(one["height"] for one in found) == [3, 4]
    assert {one["kind"] for one in found} == {"fine"}
