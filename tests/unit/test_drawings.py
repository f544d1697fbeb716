"""Panels that are read from DXF drawings: areas, groups, normals, and drawings that are refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.build.patterns import drawings
from gossamer_fx.mechanics.bodies.edge_lines import edge_line

ezdxf = pytest.importorskip("ezdxf")
COMM = MPI.COMM_WORLD
LAW = gx.Linear(E=1e9, nu=0.3, density=1000.0, thickness=1e-4)


def drawing(path: Path, draw: Callable[[Any], None], unit: int = 4) -> Path:
    """A drawing in the units of $INSUNITS, which rank 0 writes."""
    path = Path(COMM.bcast(str(path)))
    if COMM.rank == 0:
        document = ezdxf.new("R2010")
        document.header["$INSUNITS"] = unit
        draw(document.modelspace())
        document.saveas(path)
    COMM.barrier()
    return path


def two_panels(model: Any) -> None:
    """A disc of 200 mm with a hole of 50 mm, and half a disc on a rectangle of 200 x 100 mm, named
    "flap"."""
    model.add_circle((0, 0), 100, dxfattribs={"layer": "rim"})
    model.add_circle((10, 0), 25, dxfattribs={"layer": "valve"})
    seam = {"layer": "seam"}
    model.add_lwpolyline([(200, 100), (200, 0), (400, 0), (400, 100)], dxfattribs={"layer": "hem"})
    model.add_arc((300, 100), 100, 0, 180, dxfattribs=seam)
    model.add_text("flap", dxfattribs={"insert": (290, 50), "height": 10})


def area_of(mesh: gx.Mesh, group: str) -> float:
    _, cells = mesh.group(group)
    topology = mesh.domain.topology
    own = cells[cells < topology.index_map(2).size_local]
    dx = ufl.Measure("dx", mesh.domain, subdomain_data=[(1, own)], subdomain_id=1)
    normal = ufl.CellNormal(mesh.domain)
    form = fem.form(normal[2] * dx)
    return float(mesh.comm.allreduce(fem.assemble_scalar(form)))


@pytest.mark.mpi
def test_outlines_become_panels(tmp_path: Path) -> None:
    path = drawing(tmp_path / "panels.dxf", two_panels)
    mesh = gx.patterns.read_dxf(path, COMM, size=0.005)
    names = {"film", "panel 1", "flap", "rim", "valve", "hem", "seam"}
    names |= {"panel 1/rim", "panel 1/valve", "flap/hem", "flap/seam"}
    assert set(mesh.groups) == names
    # Normals point along z, so that areas are positive.
    assert area_of(mesh, "panel 1") == pytest.approx(np.pi * (0.1**2 - 0.025**2), rel=2e-3)
    assert area_of(mesh, "flap") == pytest.approx(0.02 + np.pi * 0.01 / 2, rel=2e-3)
    film = gx.Membrane(mesh, LAW)
    assert edge_line(film, "flap/seam", "test").length == pytest.approx(np.pi * 0.1, rel=1e-3)
    assert edge_line(film, "flap/hem", "test").length == pytest.approx(0.4, rel=1e-9)
    rim = edge_line(film, "panel 1/rim", "test")
    assert rim.is_closed
    assert rim.length == pytest.approx(2 * np.pi * 0.1, rel=1e-3)


@pytest.mark.mpi
def test_panels_of_a_drawing_are_sewn(tmp_path: Path) -> None:
    """Half a disc is sewn to half a disc: the seam has the same number of nodes on both sides."""

    def halves(model: Any) -> None:
        for shift in (0, 300):
            model.add_line((shift - 100, 0), (shift + 100, 0), dxfattribs={"layer": "middle"})
            model.add_arc((shift, 0), 100, 0, 180, dxfattribs={"layer": "rim"})

    mesh = gx.patterns.read_dxf(drawing(tmp_path / "halves.dxf", halves), COMM, size=0.02)
    film = gx.Membrane(mesh, LAW)
    seam = gx.Seam(film, "panel 1/rim", film, "panel 2/rim")
    assert abs(seam.ease) < 1e-9
    assert len(seam.lines(gx.Equilibrium(gx.Scene(film)).system.unknowns.initial)[0].nodes) > 10


def test_bad_drawings_are_refused(tmp_path: Path) -> None:
    def gap(model: Any) -> None:
        model.add_line((0, 0), (1, 0), dxfattribs={"layer": "cut"})
        model.add_line((1, 0), (0, 1), dxfattribs={"layer": "cut"})

    def branch(model: Any) -> None:
        model.add_lwpolyline([(0, 0), (1, 0), (0, 1)], close=True, dxfattribs={"layer": "cut"})
        model.add_line((0, 0), (1, 1), dxfattribs={"layer": "aid"})

    def same_names(model: Any) -> None:
        for x in (0, 3):
            model.add_circle((x, 0), 1)
            model.add_text("gore", dxfattribs={"insert": (x, 0)})

    def named_film(model: Any) -> None:
        model.add_circle((0, 0), 1)
        model.add_text("film", dxfattribs={"insert": (0, 0)})

    def layer_film(model: Any) -> None:
        model.add_circle((0, 0), 1, dxfattribs={"layer": "film"})

    def refused(path: Path, words: str, **options: Any) -> None:
        with pytest.raises(gx.InputError, match=words):
            gx.patterns.read_dxf(path, COMM, **{"size": 0.1, "scale": 1.0, **options})

    refused(
        drawing(tmp_path / "gap.dxf", gap), r"open, or branches, at \(0, 0\) m on the layer 'cut'"
    )
    refused(drawing(tmp_path / "branch.dxf", branch), r"open, or branches, at \(0, 0\) m")
    refused(drawing(tmp_path / "names.dxf", same_names), "two groups 'gore'")
    refused(
        drawing(tmp_path / "panel.dxf", named_film), "two groups 'film'.* the group of all panels"
    )
    refused(
        drawing(tmp_path / "layer.dxf", layer_film),
        "two groups 'film'; give each panel and layer its own",
    )
    refused(drawing(tmp_path / "empty.dxf", lambda model: None), "has no lines, arcs or splines")
    refused(tmp_path / "none.dxf", "There is no drawing")
    no_unit = drawing(tmp_path / "unit.dxf", gap, unit=0)
    refused(no_unit, "does not say its unit", scale=None)
    text = Path(COMM.bcast(str(tmp_path / "text.dxf")))
    if COMM.rank == 0:
        text.write_text("no drawing\nat all\n")
    COMM.barrier()
    refused(text, "cannot be read as DXF")
    refused(text, "size must be > 0|size is", size=-1.0)


@pytest.mark.parametrize("damage", ["", "x", "-1", "1e308", "330"])
def test_a_damaged_line_of_a_drawing_is_a_drawing_or_a_sentence(
    tmp_path: Path, damage: str
) -> None:
    """ezdxf raises errors of many kinds, some only when an entity is asked for its points."""
    path = drawing(tmp_path / "sound.dxf", two_panels)
    lines = path.read_text().split("\n")
    first = lines.index("ENTITIES")
    last = lines.index("ENDSEC", first)
    refused = 0
    for number in range(first, last):
        damaged = tmp_path / "damaged.dxf"
        damaged.write_text("\n".join([*lines[:number], damage, *lines[number + 1 :]]))
        try:
            drawings.panels_of(drawings._read(damaged, 1.0), str(damaged))
        except gx.InputError as error:
            assert "\n" not in str(error)
            refused += 1
    assert refused


def test_without_ezdxf_a_sentence_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = drawing(tmp_path / "panels.dxf", two_panels)
    monkeypatch.setitem(__import__("sys").modules, "ezdxf", None)
    with pytest.raises(gx.InputError, match="needs the package ezdxf"):
        gx.patterns.read_dxf(path, COMM, size=0.01)
