"""Cases at rest: equilibria, paths and modes by the command line, in the files of runs."""

from __future__ import annotations

from pathlib import Path
from textwrap import dedent
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.analysis.cases.results import shown_names
from gossamer_fx.app.cli.command import main
from gossamer_fx.meshes.line import line
from gossamer_fx.records.plot.answers import answers

SCENE = """
    import gossamer_fx as gx

    def build(comm, stiffness=100.0, modes=1):
        ball = gx.PointMass(2.0, comm=comm, name="ball")
        hook = gx.Ground((0.0, 0.0, 1.0))
        spring = gx.connectors.Spring(ball.port(), hook, stiffness=stiffness, length=1.0)
        pull = gx.loads.Force(ball.port(), lambda t: (0.0, 0.0, -10.0 * t), name="pull")
        probes = {"hook [N]": gx.probes.Reaction(spring, "z")}
        probes["height [m]"] = gx.probes.Position(ball.port(), "z")
        return gx.analysis.StaticCase(
            gx.Equilibrium(gx.Scene(pull, spring)),
            at=(0.5, 1.0), along="load factor", probes=probes, modes=modes,
        )
"""


def stretched(comm: MPI.Intracomm, **how: Any) -> gx.analysis.StaticCase:
    """A cable that is pulled at its end."""
    cable = gx.Cable(
        line(comm, [(0, 0, 0), (1, 0, 0)], 4), gx.CableLaw(1e4, 0.01), initial_tension=1.0
    )
    held = gx.Fixed(cable, "start")
    pull = gx.loads.Force(cable.port("end"), (10.0, 0.0, 0.0), name="pull")
    probes = {
        "held [N]": gx.probes.Reaction(held, "x"),
        "end [m]": gx.probes.Displacement(cable.port("end"), "x"),
    }
    return gx.analysis.StaticCase(gx.Equilibrium(gx.Scene(held, pull)), probes=probes, **how)


@pytest.mark.mpi
def test_one_equilibrium_with_its_modes(comm, folder):
    numbers = stretched(comm, modes=2).compute(folder / "case")
    assert numbers["held [N] at the end"] == pytest.approx(-10.0, rel=1e-6)
    # (F - T0) L/EA, but for the squares of strains.
    assert numbers["end [m] at the end"] == pytest.approx(9.0 / 1e4, rel=1e-2)
    assert 0 < numbers["frequency 1 [Hz]"] <= numbers["frequency 2 [Hz]"]
    comm.Barrier()
    about = gx.plot.RunReader(folder / "case").about
    assert about["kind"] == "equilibrium"
    assert gx.plot.RunReader(folder / "case" / "modes" / "mode_2").about["kind"] == "mode"
    # Extremes of one equilibrium are not shown, and a report says the frequencies.
    shown = shown_names([numbers])
    assert not [name for name in shown if name.endswith((" smallest", " largest"))]
    _, found = answers(gx.plot.RunReader(folder / "case"))
    rows = {row[0]: row[1] for row in found}
    for name in ("frequency 1 [Hz]", "frequency 2 [Hz]"):
        assert float(rows[name]) == pytest.approx(numbers[name], rel=1e-3)


@pytest.mark.mpi
def test_a_path_and_another_record_in_its_folder(comm, folder):
    """The second record has no modes: those of the first must not stay."""
    how = {"until": 2.0, "by": "pull.force", "start": 0.5}
    numbers = stretched(comm, path=how, modes=1).compute(folder / "case")
    assert numbers["held [N] at the end"] == pytest.approx(-20.0, rel=1e-6)
    assert numbers["held [N] largest"] == pytest.approx(-5.0, rel=1e-6)
    # Extremes come last, as a picture of a sweep has room for the first numbers only.
    names = shown_names([numbers])
    assert names.index("frequency 1 [Hz]") < names.index("held [N] largest")
    with pytest.raises(gx.InputError, match="holds"):
        stretched(comm).compute(folder / "case")
    stretched(comm).compute(folder / "case", overwrite=True)
    comm.Barrier()
    assert not (folder / "case" / "modes").exists()
    assert len(gx.plot.RunReader(folder / "case").table("probes.csv")["held [N]"]) == 1


def test_values_and_a_path_exclude_each_other(comm):
    with pytest.raises(gx.InputError, match="at and path are both given"):
        stretched(comm, at=(1.0,), path={"until": 1.0})


@pytest.mark.parametrize("more", [{}, {"modes": 2}, {"at": (1.0,), "until": 1.0}])
def test_an_equilibrium_in_a_case_of_a_run_is_told_where_it_belongs(comm, more):
    with pytest.raises(gx.InputError, match=r"give it to gossamer_fx\.analysis\.StaticCase"):
        gx.Case(stretched(comm).equilibrium, **more)


class TestCommandLine:
    @pytest.fixture
    def scene(self, tmp_path: Path) -> Path:
        path = tmp_path / "hung.py"
        path.write_text(dedent(SCENE).replace(", modes=1", ", modes=0"), encoding="utf-8")
        return path

    def test_run_finds_and_reports(
        self, scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        out = tmp_path / "out"
        assert main(["run", str(scene), "-o", str(out)]) == 0
        said = capsys.readouterr().out
        assert "hook [N] at the end: 10" in said
        table = gx.plot.RunReader(out).table("probes.csv")
        assert table["hook [N]"] == pytest.approx(np.array([5.0, 10.0]))
        assert table["height [m]"] == pytest.approx(np.array([-0.05, -0.1]))
        assert main(["report", str(out)]) == 0
        # Nothing is replaced unasked.
        assert main(["run", str(scene), "-o", str(out)]) == 2
        assert main(["run", str(scene), "-o", str(out), "--restart"]) == 2
        assert "always computed from the start" in capsys.readouterr().err

    def test_a_dry_run_computes_nothing(
        self, scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        out = tmp_path / "out"
        assert main(["run", str(scene), "-o", str(out), "--dry-run"]) == 0
        assert "nothing was computed" in capsys.readouterr().out
        assert not out.exists()

    def test_a_sweep_over_its_arguments(self, scene: Path, tmp_path: Path) -> None:
        out = tmp_path / "sweep"
        words = ["sweep", str(scene), "--over", "stiffness=50,200", "-o", str(out)]
        assert main(words) == 0
        rows = (out / "runs.csv").read_text(encoding="utf-8").splitlines()
        heights = [
            float(row.split(",")[rows[0].split(",").index("height [m] at the end")])
            for row in rows[1:]
        ]
        assert heights == pytest.approx([-0.2, -0.05])


@pytest.mark.mpi
def test_numbers_of_an_equilibrium_are_probes_of_a_case(comm, folder):
    """The stiffness of a point is asked for when the first equilibrium is found, not before."""
    ball = gx.PointMass(2.0, comm=comm, name="ball")
    hook = gx.Ground((0.0, 0.0, 1.0))
    spring = gx.connectors.Spring(ball.port(), hook, stiffness=100.0, length=1.0)
    equilibrium = gx.Equilibrium(gx.Scene(spring, gx.Gravity(ball)))
    stiffness = gx.analysis.PointStiffness(equilibrium, ball.port())
    case = gx.analysis.StaticCase(equilibrium, at=(0.5, 1.0), probes={"stiffness [N/m]": stiffness})
    numbers = case.compute(folder / "case")
    assert numbers["stiffness [N/m] smallest"] == pytest.approx(100.0)
