"""Triangular films under the same tension in all directions: arcs for edges, a cable in each.

A cable of radius R in the edge of a film of the tension n [N/m] bears n R; a corner is held by the
resultant of its two cables.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.extend import Array
from gossamer_fx.meshes.arc_polygon import arc_radius


@dataclass(frozen=True)
class Arc:
    """An edge from corner `first` to the next one, that bends into the film.

    Attributes:
        first, last: numbers of its corners.
        radius: R [m].
        centre: of its circle (2,) [m].
        ends: its corners (2, 2) [m].
    """

    first: int
    last: int
    radius: float
    centre: Array
    ends: Array

    def pull(self, corner: int, tension: float) -> Array:
        """Force (2,) [N] of the cable on one of its corners, for the tension of the film [N/m]."""
        chord = self.ends[1] - self.ends[0]
        length = float(np.linalg.norm(chord))
        # The arc leaves its chord by this angle, to the inner side, which is on the left.
        lean = math.asin(length / (2 * self.radius))
        turn = np.array([[math.cos(lean), -math.sin(lean)], [math.sin(lean), math.cos(lean)]])
        cable = tension * self.radius
        if corner == self.first:
            return np.asarray(cable * turn @ chord / length)
        return np.asarray(-cable * turn.T @ chord / length)


def radii_of(corners: Array, sag: float) -> list[float]:
    """Radii [m] of the edges of a triangle with corners (3, 2) [m], for a depth of the arcs over
    their chords."""
    chords = np.roll(corners, -1, axis=0) - corners
    return [arc_radius(float(np.linalg.norm(chord)), sag) for chord in chords]


def arcs(corners: Array, radii: Sequence[float]) -> list[Arc]:
    """The three edges of a triangle with corners (3, 2) [m], counterclockwise."""
    found = []
    for first, radius in enumerate(radii):
        last = (first + 1) % 3
        chord = corners[last] - corners[first]
        length = float(np.linalg.norm(chord))
        # To the right of the chord, where the arc bulges away from.
        outward = np.array([chord[1], -chord[0]]) / length
        middle = (corners[first] + corners[last]) / 2
        centre = middle + math.sqrt(radius**2 - length**2 / 4) * outward
        found.append(Arc(first, last, radius, centre, corners[[first, last]]))
    return found


def corner_pulls(edges: Sequence[Arc], tension: float) -> Array:
    """Forces (3, 2) [N] of both cables on each corner, for the tension of the film [N/m]."""
    pulls = np.zeros((3, 2))
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
    """A mesh of the triangle in the plane z = 0, with the groups "film", "edge 0" to "edge 2" and
    the corners' names.

    Args:
        comm: communicator of the mesh.
        edges: of the triangle.
        names: of the corners.
        generate: makes the mesh of a gmsh model with three curves and a surface.
        size: of the cells at the corners [m]; 0: none is set.
    """

    def build(model: Any) -> None:
        points = [model.geo.addPoint(*arc.ends[0], 0.0, size) for arc in edges]
        curves = []
        for arc in edges:
            centre = model.geo.addPoint(*arc.centre, 0.0)
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
