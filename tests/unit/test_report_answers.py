"""The report of a run says first what was run and what came out, with units, without round-off."""

from __future__ import annotations

import csv
import json
import re
import sys
from html import unescape
from pathlib import Path

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.meshes.airbag import airbag
from gossamer_fx.records.outputs.description import _commit

LAW = gx.Miyazaki(E=1e8, nu=0.3, density=1000.0, thickness=1e-4, residual_stiffness=1e-6)
AIR = gx.IdealGas(gamma=1.4, R=287.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag that is blown up, with a probe."""
    from mpi4py import MPI

    film = gx.Membrane(airbag(MPI.COMM_SELF, edge=0.2, cells=3), LAW, name="film")
    bag = gx.Chamber(film, gas=AIR, pressure=10.0, temperature=293.0, dead_volume=1e-6, name="bag")
    tank = gx.Tank(volume=1e-5, gas=AIR, pressure=1e6, temperature=293.0)
    scene = gx.Scene(film, bag, gx.Orifice(tank, bag, area=1e-6))
    run_folder = tmp_path_factory.mktemp("run") / "bag"
    height = gx.probes.LargestStress(film)
    recording = gx.Recording(run_folder, probes={"stress <largest> [Pa]": height}, title="A bag")
    run = gx.Simulation(scene, gx.Midpoint(dt=5e-4), outputs=[recording])
    run.run(until=0.01)
    return run_folder


def rows_of(page: str, heading: str) -> dict[str, list[str]]:
    """Cells of a table of the page by the words of its rows."""
    table = page.split(f"<h2>{heading}</h2>")[1].split("</table>")[0]
    rows = {}
    for row in table.split("<tr>")[1:]:
        first, *cells = re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row)
        rows[unescape(first)] = cells
    return rows


@pytest.fixture(scope="module")
def page(folder: Path) -> str:
    path = folder / "page.html"
    gx.write_report(gx.plot.RunReader(folder), path)
    return path.read_text()


def test_answers_are_those_of_the_tables(folder: Path, page: str) -> None:
    rows = rows_of(page, "Answers")
    # Before the view, pictures and balances.
    assert page.index("<h2>Answers</h2>") < page.index("<h2>Scene</h2>")
    with (folder / "gas.csv").open() as file:
        gas = list(csv.DictReader(file))
    pressures = [float(row["bag pressure [Pa]"]) for row in gas]
    cells = [float(cell) for cell in rows["bag pressure [Pa]"]]
    expected = [pressures[-1], min(pressures), max(pressures)]
    assert cells == pytest.approx(expected, rel=1e-3)
    with (folder / "probes.csv").open() as file:
        probes = [float(row["stress <largest> [Pa]"]) for row in csv.DictReader(file)]
    assert float(rows["stress <largest> [Pa]"][2]) == pytest.approx(max(probes), rel=1e-3)
    reader = gx.plot.RunReader(folder)
    segment, step = reader.bodies["film"].at(len(reader.times) - 1)
    moved = np.linalg.norm(segment.positions(step) - segment.X, axis=1).max()
    assert float(rows["largest displacement [m] of film"][0]) == pytest.approx(moved, rel=1e-3)


def test_one_state_has_one_value_and_no_round_off(tmp_path: Path) -> None:
    """A pendulum at rest: its hinge has no moment, and extremes over one state say nothing."""
    mass = gx.PointMass(2.0, position=(0.3, 0.0, -1.0), name="mass")
    rope = gx.connectors.Rope(
        mass.port(), gx.Ground((0.3, 0.0, 0.0)), stiffness=1e3, length=1.0, name="rope"
    )
    equilibrium = gx.Equilibrium(gx.Scene(rope, gx.Gravity(mass, (0.0, 0.0, -10.0))))
    probes = gx.probes.Reaction.components(rope, "anchor", about=(0.3, 0.0, 0.0))
    probes["nearly nothing [N]"] = lambda state: 1e-15
    gx.analysis.StaticCase(equilibrium, probes=probes).compute(tmp_path / "hung")
    gx.write_report(gx.plot.RunReader(tmp_path / "hung"), tmp_path / "page.html")
    rows = rows_of((tmp_path / "page.html").read_text(), "Answers")
    assert rows[""] == ["value"]
    assert rows["anchor force z [N]"] == ["20"] and rows["nearly nothing [N]"] == ["0"]
    assert rows["anchor moment y [N m]"] == ["0"]


def test_balances_have_units_and_no_round_off(page: str) -> None:
    rows = rows_of(page, "Balances")
    assert {"kinetic [J]", "stored bag [J]", "gas mass [kg]", "energy error"} <= set(rows)
    # A bag between two planes of symmetry has no momentum.
    assert not [name for name in rows if "momentum" in name]


def test_a_momentum_that_counts_is_shown(tmp_path: Path) -> None:
    ball = gx.PointMass(2.0, velocity=(1.0, 0.0, 0.0), name="ball")
    recording = gx.Recording(tmp_path / "throw")
    gx.Simulation(gx.Scene(ball), gx.Midpoint(dt=0.1), outputs=[recording]).run(until=0.2)
    gx.write_report(gx.plot.RunReader(tmp_path / "throw"), tmp_path / "page.html")
    rows = rows_of((tmp_path / "page.html").read_text(), "Balances")
    assert rows["momentum x [kg m/s]"] == ["2", "2", "2"] and "momentum y [kg m/s]" not in rows


def test_it_says_what_was_run(folder: Path, page: str) -> None:
    origin = json.loads((folder / "run.json").read_text())["origin"]
    assert Path(sys.argv[0]).name in origin["command"] or origin["command"].startswith("gossamer")
    assert re.fullmatch(r"\d{4}-\d\d-\d\d \d\d:\d\d", origin["date"])
    assert origin["date"] in page and f"gossamer_fx {gx.__version__}" in page
    assert origin.get("commit", "") == _commit()


def test_what_was_run_is_escaped(folder: Path, tmp_path: Path) -> None:
    about = json.loads((folder / "run.json").read_text())
    about["origin"]["command"] = "<script>alert(1)</script>"
    stranger = tmp_path / "stranger"
    stranger.mkdir()
    for path in folder.iterdir():
        if path.is_file():
            (stranger / path.name).write_bytes(path.read_bytes())
    about["fields"] = {}
    (stranger / "run.json").write_text(json.dumps(about))
    gx.write_report(gx.plot.RunReader(stranger), tmp_path / "page.html")
    assert "<script>alert" not in (tmp_path / "page.html").read_text()
