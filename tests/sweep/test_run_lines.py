"""The picture with the curves of all runs of a sweep: which lines there are, and what they say."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.analysis.cases.case_runs import CaseRuns
from gossamer_fx.records.plot.curve_panels import INK, LINES


def build(
    comm: MPI.Intracomm, height: float = 1.0, dt: float = 0.05, start: float = 0.0
) -> gx.Case:
    """A ball falls from a height, and moves sideways at 1 m/s whatever the height."""
    ball = gx.PointMass(1.0, (start, 0.0, height), velocity=(1.0, 0.0, 0.0), comm=comm, name="b")
    probes = {
        "z [m]": gx.probes.Position(ball.port(), "z"),
        "x [m]": gx.probes.Position(ball.port(), "x"),
    }
    scene = gx.Scene(ball, gx.Gravity(ball, (0.0, 0.0, -9.81)))
    return gx.Case(scene, gx.Midpoint(dt=dt), until=0.2, probes=probes)


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> dict[str, Figure]:
    """The figures that are written, by the names of their files."""
    found: dict[str, Figure] = {}

    def draw_again(path: Path, *args: Any) -> None:
        """Keep the figure of a page by its name."""
        monkeypatch.setattr(
            Figure, "savefig", lambda figure, *rest, **options: found.update({path.name: figure})
        )
        monkeypatch.setattr("gossamer_fx.records.plot.page.replace_file", lambda *rest: None)
        write_page(path, *args)

    from gossamer_fx.records.plot.page import write_page

    monkeypatch.setattr("gossamer_fx.app.sweep.run_lines.write_page", draw_again)
    return found


def lines_of(figure: Figure, title: str) -> list[Any]:
    """The lines of the panel with a title."""
    [axes] = [axes for axes in figure.axes if axes.get_title(loc="left") == title]
    return list(axes.lines)


def test_each_run_is_a_line_and_equal_ones_are_one(
    tmp_path: Path, drawn: dict[str, Figure]
) -> None:
    sweep = gx.sweep.Factorial(CaseRuns(build), {"height": [1.0, 2.0], "dt": [0.05, 0.1]})
    gx.sweep.run_factorial(sweep, MPI.COMM_SELF, tmp_path)
    figure = drawn["curves.png"]
    # The midpoint rule is exact: both steps are one line, which has the colour of its height.
    heights = lines_of(figure, "z [m]")
    assert [line.get_color() for line in heights] == list(LINES[:2])
    for line, height in zip(heights, (1.0, 2.0), strict=True):
        t = np.asarray(line.get_xdata()) * 1e-3
        assert np.asarray(line.get_ydata()) == pytest.approx(height - 9.81 * t**2 / 2, abs=1e-9)
    # The way sideways is the same in all runs.
    [way] = lines_of(figure, "x [mm]")
    assert way.get_color() == INK
    words = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert words.count("2 runs") == 2 and words.count("all runs") == 1
    named = [
        text.get_text().strip()
        for axes in figure.axes
        if axes.get_legend() is not None
        for text in axes.get_legend().get_texts()
    ]
    assert named == ["height 1", "height 2", "dt 0.05", "dt 0.1"]


def test_many_values_have_a_scale_of_colours(tmp_path: Path, drawn: dict[str, Figure]) -> None:
    heights = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0]
    sweep = gx.sweep.Factorial(CaseRuns(build), {"height": heights})
    gx.sweep.run_factorial(sweep, MPI.COMM_SELF, tmp_path)
    colours = [to_hex(line.get_color()) for line in lines_of(drawn["curves.png"], "z [m]")]
    assert len(set(colours)) == len(heights)
    bars = [axes for axes in drawn["curves.png"].axes if axes.get_xscale() == "log"]
    inset = [child for axes in drawn["curves.png"].axes for child in axes.child_axes]
    labels = [label.get_text() for axes in (*bars, *inset) for label in axes.get_xticklabels()]
    assert labels == ["1", "10", "128"]


def test_a_list_is_told_apart_by_the_factor_with_most_values(
    tmp_path: Path, drawn: dict[str, Figure]
) -> None:
    over = {"dt": [0.05, 0.05, 0.1], "height": [1.0, 2.0, 3.0]}
    sweep = gx.sweep.Factorial(CaseRuns(build), over, listed=True)
    gx.sweep.run_factorial(sweep, MPI.COMM_SELF, tmp_path)
    assert [line.get_color() for line in lines_of(drawn["curves.png"], "z [m]")] == list(LINES[:3])


def test_a_function_that_returns_numbers_has_no_curves(tmp_path: Path) -> None:
    sweep = gx.sweep.Factorial(lambda comm, folder, a: {"y": a}, {"a": [1.0, 2.0]})
    gx.sweep.run_factorial(sweep, MPI.COMM_SELF, tmp_path)
    assert (tmp_path / "sweep.png").is_file() and not (tmp_path / "curves.png").exists()


def failing(comm: MPI.Intracomm, height: float) -> gx.Case:
    if height > 1.0:
        raise gx.StepFailure("It hit the roof.")
    return build(comm, height)


def test_a_run_that_failed_at_once_is_left_out(tmp_path: Path, drawn: dict[str, Figure]) -> None:
    sweep = gx.sweep.Factorial(CaseRuns(failing), {"height": [1.0, 2.0]})
    gx.sweep.run_factorial(sweep, MPI.COMM_SELF, tmp_path)
    assert len(lines_of(drawn["curves.png"], "z [m]")) == 1


@pytest.mark.mpi
def test_the_picture_is_written_on_any_number_of_ranks(folder: Path) -> None:
    sweep = gx.sweep.Factorial(CaseRuns(build), {"height": [1.0, 2.0]})
    gx.sweep.run_factorial(sweep, MPI.COMM_WORLD, folder)
    MPI.COMM_WORLD.barrier()
    assert (folder / "curves.png").read_bytes()[1:4] == b"PNG"
