"""Drawings of flat panels: true scale, allowances, marks, and what is read back."""

from __future__ import annotations

import re

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from demos.inflatables import dish_from_drawing
from gossamer_fx.core.mesh.quality import area_vectors, corner_points
from tests.pattern_shapes import CYLINDER, surface_of

pytest.importorskip("ezdxf")
FILM = gx.Linear(E=3e7, nu=0.3, density=1000.0, thickness=1e-4)


def panels():
    form = surface_of(CYLINDER, 20, 8)
    return form.cut(form.by_planes([[0, 0, 0.4]], (0, 0, 1))).flatten(FILM, tension=20.0)


def test_a_drawing_is_read_back_as_the_panels(tmp_path):
    made = panels()
    path = tmp_path / "pattern.dxf"
    made.write_dxf(path, allowance=0.01, hem=0.03, marks=0.2)
    mesh = gx.patterns.read_dxf(path, MPI.COMM_WORLD, size=0.1, leave_out=("cut", "marks"))
    area = np.linalg.norm(area_vectors(corner_points(mesh.domain)), axis=1).sum()
    assert area == pytest.approx(sum(panel.area for panel in made), rel=1e-6)
    assert {"panel 0", "panel 1", "panel 0/seam 0", "panel 1/seam 0"} <= set(mesh.groups)
    film = gx.Membrane(mesh, FILM)
    seam = gx.Seam(film, "panel 0/seam 0", film, "panel 1/seam 0")
    assert abs(seam.ease) < 1e-6
    # Otherwise the marks, which are open, are taken for outlines.
    with pytest.raises(gx.InputError, match="open"):
        gx.patterns.read_dxf(path, MPI.COMM_WORLD, size=0.1)


def test_gores_whose_seams_pass_next_to_corners_of_the_form_are_read_back(tmp_path):
    """Points of a seam are then some millionths of a metre apart, which a reader takes as one; the
    chain from the drawing to the sewn dish, 2 mm off the drawing of 1 m."""
    panels = dish_from_drawing.pattern(dish_from_drawing.form(MPI.COMM_SELF))
    assert len(panels) == 8
    ratio = dish_from_drawing.read_again(panels, tmp_path / "gores.dxf")
    assert ratio == pytest.approx(1.0, rel=1e-9)
    dish = dish_from_drawing.sewn(panels, 0.2)
    stow, _ = dish_from_drawing.stowing(dish, 1)
    assert stow.layers_at_end == 2
    at_rest = dish_from_drawing.equilibrium(dish)
    at_rest.find()
    assert panels.deviation(dish.films, at=at_rest).rms < 2.5e-3


def test_allowances_are_rectangles_around_rectangles(tmp_path):
    """Two rectangles with 10 mm at the seam and 30 mm at the rim."""
    made = panels()
    path = tmp_path / "pattern.svg"
    made.write_svg(path, allowance=0.01, hem=0.03, marks=0.2)
    text = path.read_text()
    cuts = re.findall(r'<polygon class="cut" points="([^"]*)"', text)
    assert len(cuts) == 2
    for cut, panel in zip(cuts, made, strict=True):
        points = np.array([[float(x) for x in pair.split(",")] for pair in cut.split()])
        # In millimetres: hems at both ends, a hem and a seam along it
        size = [1e3 * panel.length + 60.0, 1e3 * panel.width + 40.0]
        assert np.ptp(points, axis=0) == pytest.approx(size, abs=2e-3)
    # A seam of π, with marks at most 0.2 m apart: 16 parts on both panels
    assert len(re.findall(r'<polyline class="marks"', text)) == 2 * 17
    assert text.count(">panel 0<") == 1 and text.count(">seam 0<") == 2
    width = float(re.search(r'width="([\d.]+)mm"', text)[1])
    assert width > 1e3 * made[0].length


def test_a_drawing_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(gx.OutputFailure, match="none"):
        panels().write_svg(tmp_path / "none" / "a.svg")
