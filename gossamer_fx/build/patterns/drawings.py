"""Meshes of flat panels from the outlines in a DXF drawing (`read_dxf`).

gmsh hangs on outlines that touch or cross, or leaves holes out, so these are found before.  All
distances are compared with the size of the drawing.
"""

from __future__ import annotations

import itertools
import logging
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from gossamer_fx.core.checks.arguments import check_arguments, positive
from gossamer_fx.core.checks.errors import InputError, are_usual_sizes, check, on_rank_zero
from gossamer_fx.core.checks.lookups import check_file
from gossamer_fx.core.checks.strange_files import open_file
from gossamer_fx.core.mesh.gmsh_reader import TIME_LIMIT, check_cells
from gossamer_fx.core.mesh.mesh import Mesh, built
from gossamer_fx.core.model.body import Array, Indices

LOGGER = logging.getLogger("gossamer_fx")

Mask = npt.NDArray[np.bool_]

# Metres in the units of $INSUNITS that drawings of patterns have: inch, foot, mm, cm, m.
UNITS = {1: 0.0254, 2: 0.3048, 4: 1e-3, 5: 1e-2, 6: 1.0}

# Distance of the ends of curves that meet, over the size of the drawing.
MEETING = 1e-6

# Largest distance of a sampled curve from the drawn one, over the size of the drawing.
SAGITTA = 1e-5

# Most curves, texts and blocks of a drawing: blocks in blocks may stand for any number of them.
MAX_ENTITIES = 200_000

# Pairs of edges that are compared at once.
PAIRS_AT_ONCE = 100_000

# Name of the group of all triangles.
ALL_PANELS = "film"

SMOOTH = ("ARC", "CIRCLE", "ELLIPSE", "SPLINE")
POLYLINES = ("LWPOLYLINE", "POLYLINE")
TEXTS = ("TEXT", "MTEXT")


@dataclass(frozen=True, eq=False)
class DrawnCurve:
    """A line or a smooth curve of a drawing: points [m], and the layer that it is on.  Points are
    (m, 3) as they are read, and (m, 2) once the drawing is known to be flat."""

    points: Array
    layer: str


@dataclass(eq=False)
class Panel:
    """A closed outline and the holes in it, each as a loop of curves in order; and its name."""

    loops: list[list[DrawnCurve]]
    name: str = ""


@dataclass
class Drawing:
    """What is read from a file: curves, texts with their points (2,) [m], and kinds of entities
    that are left out."""

    curves: list[DrawnCurve] = field(default_factory=list)
    labels: list[tuple[str, Array]] = field(default_factory=list)
    left_out: Counter[str] = field(default_factory=Counter)


@check_arguments
def read_dxf(
    path: str | Path,
    comm: MPI.Intracomm,
    *,
    size: Annotated[float, positive("m")],
    scale: Annotated[float, positive("m")] | None = None,
    leave_out: Sequence[str] = (),
    time_limit: Annotated[float, positive("s")] = TIME_LIMIT,
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
        leave_out: names of layers whose curves and texts are not read, e.g. seam allowances.
        time_limit: [s] after which gmsh is ended.

    Raises:
        InputError: ezdxf is missing, the file does not exist, it is not a DXF drawing, it has no
            unit, refers to another file or is not flat, an outline is open, or touches or crosses
            one, two groups would have one name, or there would be too many triangles.

    Example:
        >>> def balloon(comm):
        ...     return gx.patterns.read_dxf("gores.dxf", comm, size=0.02, scale=1e-3)
    """
    panels = on_rank_zero(comm, lambda: _read_panels(Path(path), scale, size, leave_out))
    # Only rank 0 builds the model, and only it has the panels.
    what = f"The mesh of the drawing '{path}'"
    return built(lambda model: _build(model, panels or [], size), comm, what, time_limit=time_limit)


def _read_panels(
    path: Path, scale: float | None, size: float, leave_out: Sequence[str]
) -> list[Panel]:
    """Read the panels of a file, on one rank; warn of entities that are left out, and refuse a size
    [m] of edges with which there would be too many triangles."""
    drawing = _read(path, scale, leave_out)
    if drawing.left_out:
        kinds = ", ".join(f"{count} {kind}" for kind, count in drawing.left_out.items())
        LOGGER.warning("'%s': %s are not curves or texts, and are left out", path, kinds)
    panels = panels_of(drawing, str(path))
    area = 0.0
    for panel in panels:
        outer, *holes = (_area(_polygon(loop)) for loop in panel.loops)
        area += outer - sum(holes)
    # Equilateral triangles.
    check_cells(f"The drawing '{path}' with size {size:g} m", area / (np.sqrt(3) / 4 * size**2))
    return panels


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
    tolerance = MEETING * extent
    loops = _loops(_flat(drawing.curves, tolerance, path), tolerance, path)
    polygons = [_polygon(loop) for loop in loops]
    _check_apart(polygons, tolerance, path)
    # The other outlines that each one is in: an odd number for holes.
    within = []
    for i, polygon in enumerate(polygons):
        others = [j for j in range(len(polygons)) if j != i and _is_inside(polygon[0], polygons[j])]
        within.append(others)
    outer = [i for i, others in enumerate(within) if len(others) % 2 == 0]
    # From left to right, then upwards; panels in line are not sorted by round-off.
    outer.sort(key=lambda i: tuple(np.rint(polygons[i].min(axis=0) / tolerance)))
    panels = []
    for number, i in enumerate(outer, start=1):
        # One level deeper: an outline within a hole is another panel.
        depth = len(within[i]) + 1
        holes = [j for j, others in enumerate(within) if i in others and len(others) == depth]
        name = f"panel {number}"
        for text, position in drawing.labels:
            in_hole = any(_is_inside(position, polygons[j]) for j in holes)
            if _is_inside(position, polygons[i]) and not in_hole:
                name = text
        panels.append(Panel([loops[i], *(loops[j] for j in holes)], name))
    _check_names(panels, path)
    return panels


def _read(path: Path, scale: float | None, leave_out: Sequence[str] = ()) -> Drawing:
    """Read curves and texts of a DXF file, but for those on layers to leave out, scaled to metres,
    by the unit of the drawing if `scale` is None.  `InputError`: the file cannot be read, is not
    DXF or has no unit, or ezdxf is not installed."""
    check_file(path, "drawing", "give the path of a DXF file")
    try:
        import ezdxf
    except ImportError:
        raise InputError(
            "read_dxf needs the package ezdxf; install it by 'pip install gossamer_fx[patterns]'."
        ) from None
    # ezdxf raises all kinds of errors on a damaged file.
    try:
        with open_file(path):
            # Refused here, if it is not a file that can be read as a whole.
            pass
        document: Any = ezdxf.readfile(str(path))  # type: ignore[attr-defined, unused-ignore]
        unit = int(document.header.get("$INSUNITS", 0))
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"The drawing '{path}' cannot be read as DXF; save it again.") from error
    check(
        scale is not None or unit in UNITS,
        f"The drawing '{path}' does not say its unit; give scale, the metres in one of its units.",
    )
    drawing = Drawing()
    kind = "curve or text"
    layer = ""
    try:
        for entity in _pieces(document.modelspace(), str(path)):
            kind = entity.dxftype()
            layer = ""
            # Entities that are not drawn may have no layer.
            if entity.dxf.is_supported("layer"):
                layer = f" on the layer '{entity.dxf.layer}'"
                if entity.dxf.layer in leave_out:
                    continue
            _take(entity, scale or UNITS[unit], drawing)
    except InputError:
        raise
    except Exception as error:
        words = " ".join(str(error).split())
        raise InputError(
            f"The drawing '{path}' has a {kind}{layer} that is damaged, or what follows it "
            f"({words}); draw it again."
        ) from error
    return drawing


def _pieces(layout: Any, path: str) -> Iterator[Any]:
    """The entities of a layout, polylines and blocks piece by piece.  `InputError`: a block inserts
    itself or is not in the drawing, or there are too many entities."""
    # Entities that are left, with the names of the blocks that they are in: a stack, as blocks may
    # be nested more deeply than calls.
    stack = [(iter(layout), frozenset[str]())]
    count = 0
    while stack:
        entities, blocks = stack[-1]
        try:
            entity = next(entities, None)
        # ezdxf raises all kinds of errors on damaged blocks.
        except Exception as error:
            names = ", ".join(f"'{name}'" for name in sorted(blocks)) or "the model space"
            words = " ".join(str(error).split())
            raise InputError(
                f"The drawing '{path}' is damaged in {names} ({words}); save it again."
            ) from error
        if entity is None:
            stack.pop()
            continue
        count += 1
        check(
            count <= MAX_ENTITIES,
            f"The drawing '{path}' has more than {MAX_ENTITIES} entities, those of inserted blocks "
            "counted each time; draw less.",
        )
        kind = entity.dxftype()
        if kind in POLYLINES:
            stack.append((iter(entity.virtual_entities()), blocks))
        elif kind == "INSERT" and entity.mcount > 1:
            stack.append((iter(entity.multi_insert()), blocks))
        elif kind == "INSERT":
            name = entity.dxf.name
            block = entity.block()
            check(
                block is not None and not block.block.is_xref,
                f"The drawing '{path}' inserts '{name}', which is not in the file; bind external "
                "references, or remove it.",
            )
            check(name not in blocks, f"The block '{name}' in '{path}' inserts itself; remove it.")
            stack.append((iter(entity.virtual_entities()), blocks | {name}))
        else:
            yield entity


def _take(entity: Any, scale: float, drawing: Drawing) -> None:
    """Add an entity of a DXF file to a drawing, if it is a curve or a text; `ValueError`: it is a
    curve without length, or its numbers are not finite."""
    kind = entity.dxftype()
    if kind not in ("LINE", *SMOOTH, *TEXTS):
        drawing.left_out[kind] += 1
        return
    layer = str(entity.dxf.layer)
    if kind == "LINE":
        points = scale * np.array([list(entity.dxf.start), list(entity.dxf.end)])
        _check_points(points)
        # Polylines may have a point twice.
        if (points[0] != points[1]).any():
            drawing.curves.append(DrawnCurve(points, layer))
    elif kind in SMOOTH:
        from ezdxf import path as paths

        if kind in ("ARC", "CIRCLE") and not entity.dxf.radius > 0:
            raise ValueError(f"its radius is {entity.dxf.radius:g}")
        drawn = paths.make_path(entity)
        # A first, coarse polyline has the size of the curve, to which the sagitta is relative.
        corners = np.array([list(point) for point in drawn.approximate(16)])
        _check_points(scale * corners)
        tolerance = SAGITTA * float(np.linalg.norm(np.ptp(corners, axis=0)))
        if not tolerance > 0:
            raise ValueError("it has no length")
        points = np.array([list(point) for point in drawn.flattening(tolerance, segments=16)])
        drawing.curves += _halves(DrawnCurve(scale * points, layer))
    else:
        text = entity.plain_text() if kind == "MTEXT" else entity.dxf.text
        position = entity.dxf.insert
        # Of a mirrored block the coordinates of its texts are mirrored.
        if kind == "TEXT":
            position = entity.ocs().to_wcs(position)
        # A label is in the plane of the drawing.
        in_plane = np.array([position[0], position[1]])
        words = str(text).strip()
        if words:
            drawing.labels.append((words, scale * in_plane))


def _check_points(points: Array) -> None:
    """Raise `ValueError` unless all coordinates [m] are numbers that can be computed with."""
    if not len(points) or not are_usual_sizes(points):
        raise ValueError("its coordinates are not numbers up to 1e100 m")


def _flat(curves: Sequence[DrawnCurve], tolerance: float, path: str) -> list[DrawnCurve]:
    """Curves with points (m, 2) [m]; `InputError`: they are not in one plane z = const, within a
    tolerance [m]."""
    height = curves[0].points[0, 2]
    for curve in curves:
        off = np.abs(curve.points[:, 2] - height)
        x, y, z = curve.points[off.argmax()]
        check(
            bool(off.max() <= tolerance),
            f"The drawing '{path}' is not flat: a curve on the layer '{curve.layer}' goes through "
            f"({x:.6g}, {y:.6g}, {z:.6g}) m; draw all panels in one plane z = const.",
        )
    return [DrawnCurve(curve.points[:, :2], curve.layer) for curve in curves]


def _halves(curve: DrawnCurve) -> list[DrawnCurve]:
    """Both halves of a smooth curve that is closed, which has no ends that meet others; the curve
    alone if it is open."""
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
    points = np.concatenate([curve.points[[0, -1]] for curve in curves])
    joint_of_end = _clusters(points, tolerance)
    ends = joint_of_end.reshape(-1, 2)
    # The curves that end at each joint.
    meeting: list[list[int]] = [[] for _ in range(joint_of_end.max() + 1)]
    for end, joint in enumerate(joint_of_end):
        meeting[joint].append(end // 2)
    for end, joint in enumerate(joint_of_end):
        x, y = points[end]
        check(
            len(meeting[joint]) == 2,
            f"The drawing '{path}' has an outline that is open, or branches, at ({x:.6g}, "
            f"{y:.6g}) m on the layer '{curves[end // 2].layer}'; let two curves meet there.",
        )
    loops = []
    passed: set[int] = set()
    # The first curve that is in no loop yet begins one.
    for begin in range(len(curves)):
        if begin in passed:
            continue
        i = begin
        start, joint = ends[i]
        loop = [curves[i]]
        passed.add(i)
        # Two curves meet at each joint: walk along the one that has not yet been passed.
        while joint != start:
            first, second = meeting[joint]
            i = second if i == first else first
            passed.add(i)
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
    if _area(_polygon(loop)) > 0:
        return loop
    return [DrawnCurve(curve.points[::-1], curve.layer) for curve in reversed(loop)]


def _area(polygon: Array) -> float:
    """Area [m²] of a polygon (m, 2) [m], positive if it is counterclockwise."""
    # Relative to a corner, since far from the origin differences of large products lose digits.
    x, y = (polygon - polygon[0]).T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def _polygon(loop: Sequence[DrawnCurve]) -> Array:
    """The points (m, 2) [m] of a loop, the last point of each curve left out: it is the first of
    the next one."""
    return np.concatenate([curve.points[:-1] for curve in loop])


def _is_inside(point: Array, polygon: Array) -> bool:
    """Whether a point (2,) [m] is within a closed polygon (m, 2) [m]: a ray from it along x crosses
    the polygon an odd number of times."""
    ahead = np.roll(polygon, -1, axis=0)
    passes = (polygon[:, 1] > point[1]) != (ahead[:, 1] > point[1])
    rise = np.where(passes, ahead[:, 1] - polygon[:, 1], 1.0)
    share = (point[1] - polygon[:, 1]) / rise
    crossing = polygon[:, 0] + share * (ahead[:, 0] - polygon[:, 0])
    return bool((passes & (crossing > point[0])).sum() % 2)


def _clusters(points: Array, tolerance: float) -> Indices:
    """Number (n,) of the cluster of each point (n, 2) [m]; points nearer to each other than a
    tolerance [m], also by way of others, are in one cluster."""
    pairs = KDTree(points).query_pairs(tolerance, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(points), len(points)))
    return np.asarray(connected_components(links, directed=False)[1])


def _check_apart(polygons: Sequence[Array], tolerance: float, path: str) -> None:
    """Raise `InputError` if two edges of closed polygons (m, 2) [m] come nearer to each other than
    a tolerance [m], other than neighbours at their common corner."""
    starts = np.concatenate(polygons)
    ends = np.concatenate([np.roll(polygon, -1, axis=0) for polygon in polygons])
    firsts = np.cumsum([0, *(len(polygon) for polygon in polygons)])
    following = np.arange(1, len(starts) + 1)
    following[firsts[1:] - 1] = firsts[:-1]
    low = np.minimum(starts, ends) - tolerance
    high = np.maximum(starts, ends) + tolerance
    for i, j in _near_pairs(low, high):
        # Neighbours may fold back onto each other: of these, the other ends have to be apart.
        is_after = j == following[i]
        is_before = following[j] == i
        segment = starts[i], ends[i]
        touches = ~(is_after | is_before)
        touches &= _segments_touch(*segment, starts[j], ends[j], tolerance)
        touches |= is_after & _near_segment(ends[j], *segment, tolerance)
        touches |= is_before & _near_segment(starts[j], *segment, tolerance)
        x, y = starts[i[touches.argmax()]] if touches.size else (0.0, 0.0)
        check(
            not touches.any(),
            f"The drawing '{path}' has outlines that touch or cross, or one that touches itself, "
            f"on the line from ({x:.6g}, {y:.6g}) m; keep outlines and holes apart.",
        )


def _near_pairs(low: Array, high: Array) -> Iterator[tuple[Indices, Indices]]:
    """Pairs (i, j) of boxes that overlap, from their lowest and highest corners (n, 2) [m], each
    once; in parts that need little memory.

    A sweep along x: only boxes that begin before one ends can meet it.
    """
    order = np.argsort(low[:, 0])
    reach = np.searchsorted(low[order, 0], high[order, 0])
    # How many boxes follow each, and before it of those of all.
    counts = np.maximum(reach - np.arange(1, len(order) + 1), 0)
    total = np.concatenate([[0], np.cumsum(counts)])
    parts = np.searchsorted(total, np.arange(0, total[-1], PAIRS_AT_ONCE))
    for first, last in itertools.pairwise([*np.unique(parts), len(order)]):
        own = np.repeat(np.arange(first, last), counts[first:last])
        other = own + 1 + np.arange(len(own)) - (total[own] - total[first])
        i, j = order[own], order[other]
        overlaps = (low[j, 1] <= high[i, 1]) & (high[j, 1] >= low[i, 1])
        yield i[overlaps], j[overlaps]


def _segments_touch(a: Array, b: Array, p: Array, q: Array, tolerance: float) -> Mask:
    """Whether segments from a to b (n, 2) [m] come nearer than a tolerance to those from p to q
    (n, 2), one to one."""

    def side(start: Array, end: Array, point: Array) -> Array:
        """Positive for points to the left of a line, negative to the right."""
        along = end - start
        away = point - start
        return np.asarray(along[..., 0] * away[..., 1] - along[..., 1] * away[..., 0])

    crosses = (side(a, b, p) * side(a, b, q) < 0) & (side(p, q, a) * side(p, q, b) < 0)
    is_near = _near_segment(a, p, q, tolerance) | _near_segment(b, p, q, tolerance)
    is_near |= _near_segment(p, a, b, tolerance) | _near_segment(q, a, b, tolerance)
    return np.asarray(crosses | is_near)


def _near_segment(points: Array, a: Array, b: Array, tolerance: float) -> Mask:
    """Whether points are nearer than a tolerance to segments from a to b [m]; arrays (..., 2) that
    broadcast."""
    along = b - a
    squared = np.maximum((along**2).sum(axis=-1), np.finfo(float).tiny)
    share = np.clip(((points - a) * along).sum(axis=-1) / squared, 0.0, 1.0)
    away = points - a - share[..., None] * along
    return np.asarray(np.linalg.norm(away, axis=-1) <= tolerance)


def _check_names(panels: Sequence[Panel], path: str) -> None:
    """Raise `InputError` if two groups have the same name, or one has characters that are not
    printed."""
    names = [ALL_PANELS, *{curve.layer for panel in panels for curve in _curves_of(panel)}]
    for panel in panels:
        layers = {curve.layer for curve in _curves_of(panel)}
        names += [panel.name, *(f"{panel.name}/{layer}" for layer in layers)]
    for name, count in Counter(names).items():
        check(
            count == 1,
            f"The drawing '{path}' has two groups '{name}'; give each panel and layer its own "
            f"name, other than '{ALL_PANELS}', the group of all panels.",
        )
        check(
            name.isprintable(),
            f"The drawing '{path}' has a group '{name}'; give the panel or layer a name that can "
            "be printed.",
        )


def _curves_of(panel: Panel) -> list[DrawnCurve]:
    """The curves of all loops of a panel."""
    return [curve for loop in panel.loops for curve in loop]


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
                # The last point of a curve is the first one of the next, one point for gmsh.
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
