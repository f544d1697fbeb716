"""Flat films with arcs for edges: triangles, quadrants and other polygons for cords in the
edges."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from mpi4py import MPI

from gossamer_fx import Mesh, gmsh_mesh
from gossamer_fx.core.checks.errors import InputError, check, real_numbers
from gossamer_fx.extend import Range, check_arguments

from .arrays import Length, Order, check_cells


def arc_radius(chord: float, sag: float) -> float:
    """Radius [m] of an arc whose depth is `sag` times its chord [m].

    In the edge of a film with the tension n [N/m] in all directions a cord along it bears n times
    the radius.

    >>> round(arc_radius(1.0, 0.5), 12)
    0.5
    """
    return chord * (0.25 + sag**2) / (2 * sag)


@check_arguments
def arc_polygon(
    comm: MPI.Intracomm,
    corners: Sequence[Sequence[float]],
    sag: Annotated[float, Range(0, 0.5)],
    size: Length,
    order: Order = 1,
) -> Mesh:
    """Make a flat film in z = 0 whose edges are arcs that bend into it, between given corners.

    Groups: "film"; the edges "edge 1" and so on, from the first corner to the second and so on; the
    points "corner 1" and so on.  Collective.

    Args:
        corners: x and y [m] of each, three or more, counterclockwise: of a triangle, of a quadrant
            of a sail.
        sag: depth of the arcs over their chords, 0 (straight) to ½.
        size: of the edges of triangles, about [m].
        order: of the geometry, 1, or 2 with curved triangles at the arcs.

    Raises:
        InputError: fewer than three corners, corners that do not turn left, arcs that meet, no
            size, or a sag out of its range.
    """
    points = real_numbers(corners)
    if points is None or points.ndim != 2 or points.shape[1] != 2 or len(points) < 3:
        raise InputError("arc_polygon: corners are not three points (x, y) or more.")
    chords = np.roll(points, -1, axis=0) - points
    following = np.roll(chords, -1, axis=0)
    turns = chords[:, 0] * following[:, 1] - chords[:, 1] * following[:, 0]
    check(
        bool((turns > 0).all()),
        "arc_polygon: the corners do not turn left; give a convex polygon counterclockwise.",
    )
    lengths = np.linalg.norm(chords, axis=1)
    # An arc leaves its chord by 2 atan(2 sag), and the arcs of a corner may not cross.
    cosines = -(chords * following).sum(axis=1) / (lengths * np.roll(lengths, -1))
    narrowest = float(np.arccos(np.clip(cosines, -1.0, 1.0)).min())
    check(
        4 * math.atan(2 * sag) < narrowest,
        f"arc_polygon: with sag {sag:g} the arcs cross at a corner of {narrowest:.3g} rad; "
        f"give less than {math.tan(narrowest / 4) / 2:.3g}.",
    )
    check_cells("arc_polygon", round(float(lengths.sum() / size) ** 2))

    def build(model: Any) -> None:
        geo = model.geo
        tags = [geo.addPoint(*point, 0.0, size) for point in points]
        curves = []
        for k in range(len(tags)):
            ends = (tags[k], tags[(k + 1) % len(tags)])
            if sag == 0:
                curves.append(geo.addLine(*ends))
                continue
            radius = arc_radius(float(lengths[k]), sag)
            # The centre is outside of the film, to the right of the chord.
            outwards = np.array([chords[k, 1], -chords[k, 0]]) / lengths[k]
            middle = points[k] + chords[k] / 2
            centre = middle + (radius - sag * lengths[k]) * outwards
            curves.append(geo.addCircleArc(ends[0], geo.addPoint(*centre, 0.0), ends[1]))
        surface = geo.addPlaneSurface([geo.addCurveLoop(curves)])
        geo.synchronize()
        model.addPhysicalGroup(2, [surface], name="film")
        for k, (curve, tag) in enumerate(zip(curves, tags, strict=True), start=1):
            model.addPhysicalGroup(1, [curve], name=f"edge {k}")
            model.addPhysicalGroup(0, [tag], name=f"corner {k}")
        model.mesh.generate(2)
        model.mesh.setOrder(order)

    return gmsh_mesh(build, comm)
