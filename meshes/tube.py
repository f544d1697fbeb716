"""A tube pressed flat: two strips that share their edges, whole or in compartments."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

from mpi4py import MPI

from gossamer_fx import Mesh, gmsh_mesh
from gossamer_fx.extend import check_arguments

from .arrays import Cells, Length, check_cells


@check_arguments
def flat_tube(
    comm: MPI.Intracomm, length: Length, diameter: Length, cells: Cells, compartments: Cells = 1
) -> Mesh:
    """Make a closed tube pressed flat into z = 0: two strips that share their edges.

    The film of a cylinder is flat when it is unrolled, so the two strips of width π d/2 are
    stress-free; the ends are closed by joining the strips.  Interior nodes of the strips coincide
    in space and differ in topology; normals point outwards.  The alternating pattern is symmetric,
    and no triangle has all its nodes on the edges, where it could not open.  Groups: "top",
    "bottom", the seams "inlet" (x = 0), "tip", "left", "right", and the points "tip left", "tip
    right".  With several `compartments` also the surface of each, "compartment 1" and so on from
    the inlet, and the closed line between one and the next, "ring 1" and so on.  Collective.

    Args:
        length: of the tube [m], along x.
        diameter: d of the tube when it is round [m].
        cells: edges of triangles across, at least 1, rounded to an even number of at least 2.
        compartments: of equal length, along the tube.

    Raises:
        InputError: a length is not positive, or there are no cells or compartments.
    """
    width = math.pi * diameter / 2
    # Even numbers, for the symmetry of the pattern; cells along the tube are about as long as wide.
    across = 2 * max(round(cells / 2), 1)
    along = 2 * max(round(across * length / compartments / width / 2), 1)
    check_cells("flat_tube", 4 * across * along * compartments)

    def build(model: Any) -> None:
        geo = model.geo
        size = width / across
        stations = range(compartments + 1)

        def points_along(y: float) -> list[int]:
            """Points of gmsh at the ends of the compartments, on the line at y [m]."""
            return [geo.addPoint(length * i / compartments, y, 0, size) for i in stations]

        right = points_along(-width / 2)
        left = points_along(width / 2)
        right_lines = [geo.addLine(a, b) for a, b in pairwise(right)]
        left_lines = [geo.addLine(a, b) for a, b in pairwise(left)]
        top_lines = [geo.addLine(a, b) for a, b in zip(right, left, strict=True)]
        # At both ends of the tube the strips share a line; between compartments each has its own.
        bottom_lines = list(top_lines)
        for i in range(1, compartments):
            bottom_lines[i] = geo.addLine(right[i], left[i])

        strips: list[list[int]] = []
        for cross_lines in (top_lines, bottom_lines):
            for line in cross_lines:
                geo.mesh.setTransfiniteCurve(line, across + 1)
            loops = []
            for i in range(compartments):
                sides = [
                    right_lines[i],
                    cross_lines[i + 1],
                    -left_lines[i],
                    -cross_lines[i],
                ]
                loops.append(geo.addCurveLoop(sides))
            strips.append([geo.addPlaneSurface([loop]) for loop in loops])
        for line in right_lines + left_lines:
            geo.mesh.setTransfiniteCurve(line, along + 1)
        # Diagonals that alternate leave no triangle with all its nodes on the seams.
        for strip in strips[0] + strips[1]:
            geo.mesh.setTransfiniteSurface(strip, "AlternateLeft")
        geo.synchronize()
        for name, surfaces in zip(("top", "bottom"), strips, strict=True):
            model.addPhysicalGroup(2, surfaces, name=name)
        # A tube that is not divided has no rings, and its only compartment is both strips.
        if compartments > 1:
            for i, pair in enumerate(zip(*strips, strict=True)):
                model.addPhysicalGroup(2, list(pair), name=f"compartment {i + 1}")
            for i in range(1, compartments):
                model.addPhysicalGroup(1, [top_lines[i], bottom_lines[i]], name=f"ring {i}")
        seams = {
            "right": right_lines,
            "tip": top_lines[-1:],
            "left": left_lines,
            "inlet": top_lines[:1],
        }
        for name, lines in seams.items():
            model.addPhysicalGroup(1, lines, name=name)
        model.addPhysicalGroup(0, right[-1:], name="tip right")
        model.addPhysicalGroup(0, left[-1:], name="tip left")
        model.mesh.generate(2)
        # The lower strip is seen from below: its normals point outwards, too.
        model.mesh.reverse([(2, strip) for strip in strips[1]])

    return gmsh_mesh(build, comm)
