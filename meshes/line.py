"""Lines and polygons of straight elements."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx import Mesh, gmsh_mesh
from gossamer_fx.core.checks.errors import InputError, check, real_numbers
from gossamer_fx.extend import check_arguments

from .arrays import Cells, check_cells


@check_arguments
def line(
    comm: MPI.Intracomm,
    points: Sequence[Sequence[float]],
    elements: Cells | Sequence[Cells],
    closed: bool = False,
) -> Mesh:
    """Make straight segments through points, each divided into line elements.

    Groups: "line"; the points "start" and "end" of an open line, and all of them as "point 0",
    "point 1", ...  Collective.

    Args:
        points: (x, y, z) [m] of each.
        elements: of each segment, at least 1: one number, or one for each segment.
        closed: whether a further segment leads from the last point to the first.

    Raises:
        InputError: there are fewer than two points, a point does not have three coordinates, a
            segment has no elements, there are not as many numbers of elements as segments, or gmsh
            refuses the geometry.
    """
    check(
        len(points) >= 2,
        f"line: points has {len(points)} points; give at least two.",
    )
    segments = len(points) - 1
    if closed:
        # A polygon has a further segment, from its last point to its first.
        segments += 1
    if isinstance(elements, Sequence | np.ndarray):
        counts = list(elements)
    else:
        counts = [elements] * segments
    check_cells("line", sum(counts))
    check(
        len(counts) == segments,
        f"line: elements has {len(counts)} numbers for {segments} segments; give one for each.",
    )
    vertices = real_numbers(points)
    if vertices is None or vertices.shape != (len(points), 3):
        raise InputError("line: points has points that are not three numbers; give x, y and z.")
    ends = vertices if not closed else np.vstack([vertices, vertices[:1]])
    lengths = np.linalg.norm(np.diff(ends, axis=0), axis=1)
    check(
        bool((lengths > 0).all()),
        "line: two points that follow each other are the same; give each point once.",
    )

    def build(model: Any) -> None:
        geo = model.geo
        # Neighbouring segments share the point between them, so that the line is connected there.
        tags = []
        for point in vertices:
            tags.append(geo.addPoint(*point))
        lines = []
        for i in range(segments):
            following = tags[(i + 1) % len(tags)]
            lines.append(geo.addLine(tags[i], following))
        # Elements of a segment have equal lengths.
        for segment, count in zip(lines, counts, strict=True):
            geo.mesh.setTransfiniteCurve(segment, count + 1)
        geo.synchronize()

        model.addPhysicalGroup(1, lines, name="line")
        for i, tag in enumerate(tags):
            model.addPhysicalGroup(0, [tag], name=f"point {i}")
        if not closed:
            model.addPhysicalGroup(0, [tags[0]], name="start")
            model.addPhysicalGroup(0, [tags[-1]], name="end")
        model.mesh.generate(1)

    return gmsh_mesh(build, comm)
