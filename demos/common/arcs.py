"""Triangular films under the same tension in all directions: arcs for edges, a cable in each.

A cable of radius R in the edge of a film of the tension n [N/m] bears n R; a corner is held by the
resultant of its two cables.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.core.model.body import Array


@dataclass(frozen=True)
class Arc:
    """An edge from corner `first` to the next one, that bends into the film.

    Attributes:
        first, last: numbers of its corners.
        radius: R [m].
        centre: of its circle (3,) [m].
        ends: its corners (2, 3) [m].
    """

    first: int
    last: int
    radius: float
    centre: Array
    ends: Array

    def pull(self, corner: int, tension: float) -> Array:
        """Force (3,) [N] of the cable on one of its corners, for the tension of the film [N/m]."""
        here, other = self.ends if corner == self.first else self.ends[::-1]
        x, y, _ = (here - self.centre) / self.radius
        tangent = np.array([-y, x, 0.0])
        pull: Array = tension * self.radius * np.sign(tangent @ (other - here)) * tangent
        return pull


def arcs(corners: Array, sag: float) -> list[Arc]:
    """The three edges of a triangle, with corners (3, 3) [m] counterclockwise in the plane z = 0,
    and a depth of the arcs over their chords."""
    found = []
    for first in range(3):
        last = (first + 1) % 3
        chord = corners[last] - corners[first]
        length = float(np.linalg.norm(chord))
        depth = sag * length
        radius = (length**2 / 4 + depth**2) / (2 * depth)
        # To the left of the chord, which is the inner side.
        inwards = np.array([-chord[1], chord[0], 0.0]) / length
        middle = (corners[first] + corners[last]) / 2
        centre = middle + (depth - radius) * inwards
        found.append(Arc(first, last, radius, centre, corners[[first, last]]))
    return found


def corner_pulls(edges: Sequence[Arc], tension: float) -> Array:
    """Forces (3, 3) [N] of both cables on each corner, for the tension of the film [N/m]."""
    pulls = np.zeros((3, 3))
    for arc in edges:
        for corner in (arc.first, arc.last):
            pulls[corner] += arc.pull(corner, tension)
    return pulls


def arc_mesh(
    comm: MPI.Intracomm,
    edges: Sequence[Arc],
    names: Sequence[str],
    generate: Callable[[Any, list[int], int], None],
    size: float = 0.0,
) -> gx.Mesh:
    """A mesh of the triangle with the groups "film", "edge 0" to "edge 2" and the corners' names.

    Args:
        comm: communicator of the mesh.
        edges: of the triangle.
        names: of the corners.
        generate: makes the mesh of a gmsh model with three curves and a surface.
        size: of the cells at the corners [m]; 0: none is set.
    """

    def build(model: Any) -> None:
        points = [model.geo.addPoint(*arc.ends[0], size) for arc in edges]
        curves = []
        for arc in edges:
            centre = model.geo.addPoint(*arc.centre)
            curves.append(model.geo.addCircleArc(points[arc.first], centre, points[arc.last]))
        surface = model.geo.addPlaneSurface([model.geo.addCurveLoop(curves)])
        model.geo.synchronize()
        model.addPhysicalGroup(2, [surface], name="film")
        for number, curve in enumerate(curves):
            model.addPhysicalGroup(1, [curve], name=f"edge {number}")
        for name, point in zip(names, points, strict=True):
            model.addPhysicalGroup(0, [point], name=name)
        generate(model, curves, surface)

    return gx.gmsh_mesh(build, comm)
