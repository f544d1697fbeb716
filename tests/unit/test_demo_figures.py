"""Pictures of the demos: legends leave curves free."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from demos.common.figures import finish, new_figure, save


@pytest.mark.parametrize("scale", ["linear", "log"])
def test_a_legend_covers_no_curve(tmp_path: Path, scale: str) -> None:
    figure = new_figure(4.0, 3.0)
    axes = figure.subplots()
    t = np.linspace(0.0, 1.0, 500)
    # The curve fills its axes, so that no corner is free.
    [curve] = axes.plot(t, 10 ** np.sin(200 * t), label="a curve that is everywhere")
    axes.set_yscale(scale)
    finish(axes, "t [s]", "y [m]")
    before = axes.get_yticks()
    save(figure, tmp_path / "picture.png")
    figure.draw_without_rendering()
    box = axes.get_legend().get_window_extent()
    path = curve.get_transform().transform_path(curve.get_path())
    assert not path.intersects_bbox(box, filled=False)
    # The axis names no values beyond those of the curve.
    assert set(axes.get_yticks()) <= set(before)
