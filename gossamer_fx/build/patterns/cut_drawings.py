"""Drawings of flat panels in true scale, for the cutting table: DXF and SVG."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import numpy as np

from gossamer_fx.build.patterns.closest import barycentric
from gossamer_fx.core.checks.errors import InputError, output_failures
from gossamer_fx.core.model.body import Array

# Layers of what is not an outline of a panel, which `read_dxf` shall leave out.
CUT_LAYER = "cut"
MARK_LAYER = "marks"
NAME_LAYER = "names"

# Millimetres in a metre: drawings are in millimetres.
MILLIMETRES = 1e3

# Least distance of points of an outline over the size of the drawing: `read_dxf` takes points as
# one below a quarter of it.  Where a seam passes a corner of the form, its points may be as close.
LEAST_DISTANCE = 4e-6

# Distance of panels, and length of marks without an allowance, over the largest width of a panel.
GAP = 0.15
MARK = 0.03

# Longest corner of an allowance, over the allowance itself.
LONGEST_CORNER = 3.0


@dataclass(frozen=True, eq=False)
class DrawnLine:
    """A line of a drawing: its layer, and points (n, 2) [m]."""

    layer: str
    points: Array
    is_closed: bool = False


@dataclass(frozen=True, eq=False)
class DrawnText:
    """A text of a drawing: its layer, position (2,) [m] and height [m]."""

    layer: str
    text: str
    position: Array
    height: float


@dataclass(frozen=True, eq=False)
class OutlinePart:
    """A part of the outline of a panel: name, points (n, 2) [m] counterclockwise, width of the
    allowance at it [m], and points (k, 2) [m] of its marks."""

    name: str
    points: Array
    allowance: float
    marks: Array


@dataclass(frozen=True, eq=False)
class Outline:
    """What is drawn of a panel: its name, the parts of its outline, and its triangles (m, 3, 2)
    [m]."""

    name: str
    parts: Sequence[OutlinePart]
    triangles: Array


def drawing_of(outlines: Sequence[Outline]) -> list[DrawnLine | DrawnText]:
    """The lines and texts of panels, below each other."""
    widths = [float(np.ptp(np.concatenate([p.points for p in o.parts])[:, 1])) for o in outlines]
    margin = max(part.allowance for outline in outlines for part in outline.parts)
    gap = GAP * max(widths) + 2 * margin
    found: list[DrawnLine | DrawnText] = []
    longest = max(
        float(np.ptp(np.concatenate([p.points for p in o.parts])[:, 0])) for o in outlines
    )
    least = LEAST_DISTANCE * (sum(widths) + len(widths) * gap + longest)
    top = 0.0
    for whole, width in zip(outlines, widths, strict=True):
        parts = [replace(part, points=_thinned(part.points, least)) for part in whole.parts]
        outline = replace(whole, parts=parts)
        points = np.concatenate([part.points for part in outline.parts])
        # Left ends in line, and the panels from the first one at the top downwards
        shift = np.array([-points[:, 0].min(), top - points[:, 1].max()])
        found += _panel(outline, shift, GAP * width)
        top -= width + gap
    return found


def _thinned(points: Array, least: float) -> Array:
    """A line (n, 2) [m] without inner points that are nearer than a distance [m] to the one before
    or to the end."""
    kept = [points[0]]
    for point in points[1:-1]:
        if np.linalg.norm(point - kept[-1]) > least and np.linalg.norm(point - points[-1]) > least:
            kept.append(point)
    return np.array([*kept, points[-1]])


def _panel(outline: Outline, shift: Array, height: float) -> list[DrawnLine | DrawnText]:
    """The lines and texts of one panel, moved by a shift (2,) [m]; height of its name [m]."""
    found: list[DrawnLine | DrawnText] = []
    for part in outline.parts:
        found.append(DrawnLine(part.name, part.points + shift))
        length = part.allowance or MARK * height / GAP
        outwards = _outwards(part.points)
        for mark in part.marks:
            nearest = int(np.linalg.norm(part.points - mark, axis=1).argmin())
            normal = outwards[min(nearest, len(outwards) - 1)]
            ends = np.stack([mark, mark + length * normal])
            found.append(DrawnLine(MARK_LAYER, ends + shift))
        middle = len(part.points) // 2
        beside = part.points[middle] + 0.5 * length * outwards[min(middle, len(outwards) - 1)]
        found.append(DrawnText(MARK_LAYER, part.name, beside + shift, 0.4 * height))
    if any(part.allowance > 0 for part in outline.parts):
        found.append(DrawnLine(CUT_LAYER, _with_allowance(outline) + shift, is_closed=True))
    inside = _point_inside(outline.triangles)
    found.append(DrawnText(NAME_LAYER, outline.name, inside + shift, height))
    return found


def _outwards(points: Array) -> Array:
    """Unit normals (n - 1, 2) of the edges of a counterclockwise line, outwards."""
    along = np.diff(points, axis=0)
    along = along / np.linalg.norm(along, axis=1)[:, None]
    return np.stack([along[:, 1], -along[:, 0]], axis=1)


def _with_allowance(outline: Outline) -> Array:
    """The outline (n, 2) [m] with its allowances: edges are moved outwards, and meet again."""
    starts = np.concatenate([part.points[:-1] for part in outline.parts])
    widths = np.concatenate([np.full(len(p.points) - 1, p.allowance) for p in outline.parts])
    normals = _outwards(np.concatenate([starts, starts[:1]]))
    corners = []
    for k in range(len(starts)):
        before = normals[k - 1]
        after = normals[k]
        matrix = np.stack([before, after])
        shifts = np.array([widths[k - 1], widths[k]])
        largest = float(shifts.max())
        if abs(np.linalg.det(matrix)) > 1e-6:
            corner = np.linalg.solve(matrix, shifts)
            if np.linalg.norm(corner) <= LONGEST_CORNER * largest:
                corners.append(starts[k] + corner)
                continue
        # Edges in one line, or a sharp corner, which is cut off
        corners += [starts[k] + shifts[0] * before, starts[k] + shifts[1] * after]
    return np.array(corners)


def _point_inside(triangles: Array) -> Array:
    """A point (2,) [m] in the triangles (m, 3, 2), near their middle."""
    centres = triangles.mean(axis=1)
    sides = np.concatenate([triangles, np.zeros((*triangles.shape[:2], 1))], axis=2)
    middle = np.append(centres.mean(axis=0), 0.0)
    weights = barycentric(sides, np.broadcast_to(middle, (len(sides), 3)))
    if weights.min(axis=1).max() > 0:
        return middle[:2]
    nearest = int(np.linalg.norm(centres - middle[:2], axis=1).argmin())
    return np.asarray(centres[nearest])


def save_dxf(path: Path, drawing: Sequence[DrawnLine | DrawnText]) -> None:
    """Write a drawing as DXF in millimetres, on one rank."""
    try:
        import ezdxf
    except ImportError:
        raise InputError(
            "write_dxf needs the package ezdxf; install it by 'pip install gossamer_fx[patterns]'."
        ) from None
    document: Any = ezdxf.new("R2010")  # type: ignore[attr-defined, unused-ignore]
    document.header["$INSUNITS"] = 4
    model = document.modelspace()
    for layer in dict.fromkeys(item.layer for item in drawing):
        if layer not in document.layers:
            document.layers.add(layer)
    for item in drawing:
        attributes = {"layer": item.layer}
        if isinstance(item, DrawnLine):
            points = (MILLIMETRES * item.points).tolist()
            model.add_lwpolyline(points, close=item.is_closed, dxfattribs=attributes)
        else:
            text = model.add_text(
                item.text, height=MILLIMETRES * item.height, dxfattribs=attributes
            )
            x, y = MILLIMETRES * item.position
            text.set_placement((float(x), float(y)))
    with output_failures(path):
        document.saveas(path)


def save_svg(path: Path, drawing: Sequence[DrawnLine | DrawnText]) -> None:
    """Write a drawing as SVG of its true size in millimetres, on one rank."""
    lines = [item for item in drawing if isinstance(item, DrawnLine)]
    points = np.concatenate([line.points for line in lines])
    margin = 0.02 * float(np.ptp(points, axis=0).max())
    left = points[:, 0].min() - margin
    top = points[:, 1].max() + margin
    width, height = MILLIMETRES * (np.ptp(points, axis=0) + 2 * margin)
    pen = width / 1000

    def place(x: Array) -> tuple[str, str]:
        return f"{MILLIMETRES * (x[0] - left):.4f}", f"{MILLIMETRES * (top - x[1]):.4f}"

    rows = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.4f}mm" height="{height:.4f}mm" '
        f'viewBox="0 0 {width:.4f} {height:.4f}" fill="none" stroke="black" '
        f'stroke-width="{pen:.4f}" font-family="sans-serif">'
    ]
    for item in drawing:
        layer = escape(item.layer, {'"': "&quot;"})
        if isinstance(item, DrawnLine):
            shape = "polygon" if item.is_closed else "polyline"
            positions = " ".join(",".join(place(x)) for x in item.points)
            rows.append(f'<{shape} class="{layer}" points="{positions}"/>')
        else:
            x, y = place(item.position)
            size = f"{MILLIMETRES * item.height:.4f}"
            rows.append(
                f'<text class="{layer}" x="{x}" y="{y}" font-size="{size}" fill="black" '
                f'stroke="none">{escape(item.text)}</text>'
            )
    rows.append("</svg>\n")
    with output_failures(path):
        path.write_text("\n".join(rows), encoding="utf-8")
