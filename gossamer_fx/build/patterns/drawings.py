"""Meshes of flat panels from the outlines in a DXF drawing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.checks.arguments import check_arguments, positive
from gossamer_fx.core.checks.errors import InputError, check, on_rank_zero
from gossamer_fx.core.mesh.mesh import Mesh, gmsh_mesh
from gossamer_fx.core.model.body import Array

# Metres in the units of $INSUNITS that drawings of patterns have: inch, foot, mm, cm, m.
UNITS = {1: 0.0254, 2: 0.3048, 4: 1e-3, 5: 1e-2, 6: 1.0}

# Distance of the ends of curves that meet, over the size of the drawing.
MEETING = 1e-6

# Largest distance of a sampled curve from the drawn one, over the size of the drawing.
SAGITTA = 1e-5

# Name of the group of all triangles.
ALL_PANELS = "film"

SMOOTH = ("ARC", "CIRCLE", "ELLIPSE", "SPLINE")
POLYLINES = ("LWPOLYLINE", "POLYLINE")
TEXTS = ("TEXT", "MTEXT")


@dataclass(frozen=True, eq=False)
class DrawnCurve:
    """A line or a smooth curve of a drawing: points (m, 2) [m], and the layer that it is on."""

    points: Array
    layer: str


@dataclass(eq=False)
class Panel:
    """A closed outline and the holes in it, each as a loop of curves in order; and its name."""

    loops: list[list[DrawnCurve]]
    name: str = ""


@dataclass
class Drawing:
    """What is read from a file: curves, and texts with their points (2,) [m]."""

    curves: list[DrawnCurve] = field(default_factory=list)
    labels: list[tuple[str, Array]] = field(default_factory=list)


@check_arguments
def read_dxf(
    path: str | Path,
    comm: MPI.Intracomm,
    *,
    size: Annotated[float, positive("m")],
    scale: Annotated[float, positive("m")] | None = None,
) -> Mesh:
    """Mesh the panels that the closed outlines of a DXF drawing enclose.

    Lines, arcs, circles, ellipses, splines and polylines of the model space are read; curves that
    meet end to end form outlines, and an outline within another one is a hole.  A text within a
    panel is its name; the others are "panel 1", ... from left to right.  The package ezdxf has to
    be installed.

    Groups: "film", each panel by its name, the curves of each layer by the layer's name, and those
    on one panel as "panel/layer", which seams take.

    Args:
        path: path of the file; rank 0 reads it.
        comm: the ranks to which the mesh is distributed.
        size: length of the edges of triangles [m], > 0.
        scale: metres in a unit of the drawing; None: the drawing says its unit.

    Raises:
        InputError: ezdxf is missing, the file does not exist, it is not a DXF drawing, it has no
            unit, an outline is open, two groups would have one name, or a panel or layer is named
            "film".

    Example:
        >>> def balloon(comm):
        ...     return gx.patterns.read_dxf("gores.dxf", comm, size=0.02, scale=1e-3)
    """
    panels = on_rank_zero(comm, lambda: panels_of(_read(Path(path), scale), str(path)))
    # Only rank 0 builds the model, and only it has the panels.
    return gmsh_mesh(lambda model: _build(model, panels or [], size), comm)


def panels_of(drawing: Drawing, path: str) -> list[Panel]:
    """The panels of a drawing [m], from left to right: closed outlines with the holes in them.  The
    name is a text within a panel, or "panel 1", ...  `InputError`: there are no outlines, one is
    open, or names are not unique."""
    check(
        bool(drawing.curves),
        f"The drawing '{path}' has no lines, arcs or splines in its model space; "
        "draw closed outlines.",
    )
    everything = np.concatenate([curve.points for curve in drawing.curves])
    extent = float(np.linalg.norm(np.ptp(everything, axis=0)))
    loops = _loops(drawing.curves, MEETING * extent, path)
    polygons = [_polygon(loop) for loop in loops]
    # How many other outlines each one is in: odd for holes.
    within = [
        [j for j, other in enumerate(polygons) if j != i and _is_inside(polygon[0], other)]
        for i, polygon in enumerate(polygons)
    ]
    outer = [i for i, others in enumerate(within) if len(others) % 2 == 0]
    outer.sort(key=lambda i: tuple(np.rint(polygons[i].min(axis=0) / (MEETING * extent))))
    panels = []
    for number, i in enumerate(outer, start=1):
        holes = [
            j
            for j, others in enumerate(within)
            if i in others and len(others) == len(within[i]) + 1
        ]
        name = f"panel {number}"
        for text, position in drawing.labels:
            in_hole = any(_is_inside(position, polygons[j]) for j in holes)
            if _is_inside(position, polygons[i]) and not in_hole:
                name = text
        panels.append(Panel([loops[i], *(loops[j] for j in holes)], name))
    _check_names(panels, path)
    return panels


def _read(path: Path, scale: float | None) -> Drawing:
    """Read curves and texts of a DXF file, scaled to metres, by the unit of the drawing if `scale`
    is None.  `InputError`: the file cannot be read, is not DXF or has no unit, or ezdxf is not
    installed."""
    check(path.is_file(), f"There is no drawing '{path}'; give the path of a DXF file.")
    try:
        import ezdxf
    except ImportError:
        raise InputError(
            "read_dxf needs the package ezdxf; install it by 'pip install gossamer_fx[patterns]'."
        ) from None
    try:
        document: Any = ezdxf.readfile(str(path))  # type: ignore[attr-defined, unused-ignore]
    except (OSError, ValueError, ezdxf.DXFError) as error:  # type: ignore[attr-defined, unused-ignore]
        raise InputError(f"The drawing '{path}' cannot be read as DXF; save it again.") from error
    if scale is None:
        unit = int(document.header.get("$INSUNITS", 0))
        check(
            unit in UNITS,
            f"The drawing '{path}' does not say its unit; "
            "give scale, the metres in one of its units.",
        )
        scale = UNITS[unit]
    drawing = Drawing()
    for entity in document.modelspace():
        _take(entity, scale, drawing)
    return drawing


def _take(entity: Any, scale: float, drawing: Drawing) -> None:
    """Add an entity of a DXF file to a drawing, if it is a curve or a text; polylines and blocks
    piece by piece."""
    kind = entity.dxftype()
    layer = str(entity.dxf.layer)
    if kind == "LINE":
        ends = [entity.dxf.start, entity.dxf.end]
        drawing.curves.append(DrawnCurve(scale * np.array([[p[0], p[1]] for p in ends]), layer))
    elif kind in SMOOTH:
        from ezdxf import path as paths

        drawn = paths.make_path(entity)
        # A first, coarse polyline has the size of the curve, to which the sagitta is relative.
        corners = np.array([[p[0], p[1]] for p in drawn.approximate(16)])
        tolerance = SAGITTA * float(np.linalg.norm(np.ptp(corners, axis=0)))
        points = np.array([[p[0], p[1]] for p in drawn.flattening(tolerance, segments=16)])
        drawing.curves += _halves(DrawnCurve(scale * points, layer))
    elif kind in POLYLINES or kind == "INSERT":
        for piece in entity.virtual_entities():
            _take(piece, scale, drawing)
    elif kind in TEXTS:
        text = entity.plain_text() if kind == "MTEXT" else entity.dxf.text
        position = entity.dxf.insert
        # A label is in the plane of the drawing.
        in_plane = np.array([position[0], position[1]])
        drawing.labels.append((str(text).strip(), scale * in_plane))


def _halves(curve: DrawnCurve) -> list[DrawnCurve]:
    """A closed smooth curve in two, so that each has two ends; others as they are."""
    points = curve.points
    extent = float(np.ptp(points, axis=0).max())
    if np.linalg.norm(points[0] - points[-1]) > MEETING * extent:
        return [curve]
    middle = len(points) // 2
    return [DrawnCurve(points[: middle + 1], curve.layer), DrawnCurve(points[middle:], curve.layer)]


def _loops(curves: Sequence[DrawnCurve], tolerance: float, path: str) -> list[list[DrawnCurve]]:
    """Closed loops of curves with points (m, 2) [m], counterclockwise, each curve turned so that it
    begins where the one before ends, within a tolerance [m].  `InputError`: a curve has an end at
    which no other one ends, or several do."""
    # Points at which curves end, and the curves that end at each of them.
    joints: list[Array] = []
    meeting: list[list[int]] = []
    ends = []
    for i, curve in enumerate(curves):
        both = []
        for point in (curve.points[0], curve.points[-1]):
            near = [
                k for k, joint in enumerate(joints) if np.linalg.norm(joint - point) <= tolerance
            ]
            if not near:
                near = [len(joints)]
                joints.append(point)
                meeting.append([])
            meeting[near[0]].append(i)
            both.append(near[0])
        ends.append((both[0], both[1]))
    for point, there in zip(joints, meeting, strict=True):
        layer = curves[there[0]].layer
        check(
            len(there) == 2,
            f"The drawing '{path}' has an outline that is open, or branches, at ({point[0]:.6g}, "
            f"{point[1]:.6g}) m on the layer '{layer}'; let two curves meet there.",
        )
    loops = []
    left = set(range(len(curves)))
    while left:
        i = min(left)
        start, joint = ends[i]
        loop = [curves[i]]
        left.remove(i)
        # Two curves meet at each joint: walk along the one that has not yet been passed.
        while joint != start:
            first, second = meeting[joint]
            i = second if i == first else first
            left.remove(i)
            curve = curves[i]
            if ends[i][0] == joint:
                joint = ends[i][1]
            else:
                curve = DrawnCurve(curve.points[::-1], curve.layer)
                joint = ends[i][0]
            loop.append(curve)
        loops.append(_counterclockwise(loop))
    return loops


def _counterclockwise(loop: list[DrawnCurve]) -> list[DrawnCurve]:
    """The loop, turned so that the normal of its panel points along z."""
    x, y = _polygon(loop).T
    area = float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
    if area > 0:
        return loop
    return [DrawnCurve(curve.points[::-1], curve.layer) for curve in reversed(loop)]


def _polygon(loop: Sequence[DrawnCurve]) -> Array:
    """The points (m, 2) of a loop."""
    return np.concatenate([curve.points[:-1] for curve in loop])


def _is_inside(point: Array, polygon: Array) -> bool:
    """Whether a ray from the point passes the polygon an odd number of times."""
    ahead = np.roll(polygon, -1, axis=0)
    passes = (polygon[:, 1] > point[1]) != (ahead[:, 1] > point[1])
    rise = np.where(passes, ahead[:, 1] - polygon[:, 1], 1.0)
    share = (point[1] - polygon[:, 1]) / rise
    crossing = polygon[:, 0] + share * (ahead[:, 0] - polygon[:, 0])
    return bool((passes & (crossing > point[0])).sum() % 2)


def _check_names(panels: Sequence[Panel], path: str) -> None:
    """Raise `InputError` if a panel has the name of another panel, of a layer, or "film"."""
    layers = {curve.layer for panel in panels for loop in panel.loops for curve in loop}
    check(
        ALL_PANELS not in layers,
        f"The drawing '{path}' has a layer '{ALL_PANELS}', the name of the group of all panels; "
        "rename the layer.",
    )
    taken = set(layers)
    for panel in panels:
        check(
            panel.name != ALL_PANELS,
            f"The drawing '{path}' has a panel with the text '{ALL_PANELS}', "
            "the name of the group of all panels; give the panel another text.",
        )
        check(
            panel.name not in taken,
            f"The drawing '{path}' has two groups '{panel.name}'; give each panel its own text, "
            "not that of a layer.",
        )
        taken.add(panel.name)


def _build(model: Any, panels: Sequence[Panel], size: float) -> None:
    """Put the panels [m], the outer loop of each first, into a gmsh model as plane surfaces, and
    mesh them with cells of a size [m]; on one rank.  Neighbouring panels share no edge: seams join
    them later."""
    geo = model.geo
    on_layer: dict[str, list[int]] = {}
    surfaces = {}
    for panel in panels:
        rings = []
        for loop in panel.loops:
            corners = [geo.addPoint(*curve.points[0], 0.0, size) for curve in loop]
            lines = []
            for k, curve in enumerate(loop):
                # A neighbour's first point is this one's last.
                inner = [geo.addPoint(*point, 0.0, size) for point in curve.points[1:-1]]
                through = [corners[k], *inner, corners[(k + 1) % len(loop)]]
                line = geo.addSpline(through) if inner else geo.addLine(*through)
                lines.append(line)
                on_layer.setdefault(curve.layer, []).append(line)
                on_layer.setdefault(f"{panel.name}/{curve.layer}", []).append(line)
            rings.append(geo.addCurveLoop(lines))
        surfaces[panel.name] = geo.addPlaneSurface(rings)
    geo.synchronize()
    model.addPhysicalGroup(2, list(surfaces.values()), name=ALL_PANELS)
    for name, surface in surfaces.items():
        model.addPhysicalGroup(2, [surface], name=name)
    for name, lines in on_layer.items():
        model.addPhysicalGroup(1, lines, name=name)
    model.mesh.generate(2)
