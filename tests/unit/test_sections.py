"""Sections through films: lines in a plane, layers by colour, and refused input."""

from __future__ import annotations

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.records.plot.plane_cut import PlaneCut, layers
from tests.small_scenes import LINEAR, run_until


def polyline(points) -> np.ndarray:
    points = np.asarray(points, dtype=float)
    return np.stack([points[:-1], points[1:]], axis=1)


def test_layers_of_a_zigzag_and_of_a_lone_line() -> None:
    x = np.linspace(0, 1, 11)
    places = [(s, 0.1 * k) for k in range(4) for s in (x if k % 2 == 0 else x[::-1])]
    zigzag = polyline(places)
    found = layers(zigzag)
    assert found.max() == 3
    flat = zigzag[:, 0, 1] == zigzag[:, 1, 1]
    assert (found[flat] == np.rint(zigzag[flat, 0, 1] / 0.1)).all()
    mixed = np.random.default_rng(0).permutation(len(zigzag))
    groups = layers(zigzag[mixed])
    assert len(np.unique(np.column_stack([groups, found[mixed]]), axis=0)) == 4  # the same layers
    wavy = polyline(np.column_stack([x, 0.03 * np.sin(9 * x)]))
    assert not layers(wavy).any()
    assert len(layers(np.zeros((0, 2, 2)))) == 0


def test_a_closed_line_has_two_layers() -> None:
    angle = np.linspace(0, 2 * np.pi, 41)
    places = np.column_stack([np.cos(angle), 0.2 * np.sin(angle)])
    places[-1] = places[0]
    found = layers(polyline(places))
    assert 2 <= found.max() + 1 <= 3  # three if the line begins in the middle of one


def test_a_plane_cuts_films_where_they_are(comm, folder) -> None:
    low = gx.Membrane(sheet(comm, 5, 4), LINEAR, name="low")
    high = gx.Membrane(
        sheet(comm, 3, 4),
        LINEAR,
        displacement=lambda X: [[0], [0], [0.1]] + 0 * X,
        name="high",
    )
    picture = gx.plot.Picture(folder / "section.png", section=((0.0, 0.45, 0.0), (0.0, -1.0, 0.0)))
    fields = dict.fromkeys(("low", "high"), ("displacement", "group"))
    recording = gx.Recording(folder / "run", fields=fields)
    run_until(2e-3, low, high, dt=1e-3, outputs=[picture, recording])
    if comm.rank == 0:
        read = gx.plot.RunReader(folder / "run")
        section = PlaneCut(read, (0.0, 0.45, 0.0), (0.0, -1.0, 0.0))
        cut = section.cut(len(read.times) - 1)
        assert (folder / "section.png").stat().st_size > 5000
        for k, height in enumerate((0.0, 0.1)):
            ends = cut.ends[cut.kinds == k]
            assert np.allclose(ends[..., 1], height, atol=1e-9)
            measured = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum()
            assert measured == pytest.approx(1.0, rel=1e-9)
        assert list(section.key([cut])) == ["low", "high"]
