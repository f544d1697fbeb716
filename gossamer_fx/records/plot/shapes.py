"""What a picture shows of a scene: films and solids as triangles, cables and beams as lines, other
bodies as dots."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from gossamer_fx.core.mesh.quality import area_vectors
from gossamer_fx.core.model.body import Array

Integers = npt.NDArray[np.int64]

SOLID = -1  # kind of the triangles of solids
INK = -2  # kind of lines that are not coloured by a field
# Cosine of the angle between a triangle and the mean of its neighbours beyond which an edge is
# drawn sharp: about 53°.
_SHARP_EDGE = 0.6


def _empty(*shape: int) -> Array:
    return np.zeros(shape)


@dataclass(frozen=True)
class Shape:
    """A scene at one time.

    Attributes:
        time: [s].
        corners: (n, 3, 3) of the triangles [m].
        normals: (n, 3, 3), unit vectors at the corners.
        kinds: (n,), rows of a table of colours, or SOLID.
        is_slack: (n,), whether they are slack film, which is hatched.
        lines: (m, 2, 3), ends [m].
        line_kinds: (m,), rows of the table of colours, or INK.
        dots: (k, 3), centres [m].
        edges: (e, 2, 3), ends of the edges of the mesh of films [m].
    """

    time: float
    corners: Array = field(default_factory=lambda: _empty(0, 3, 3))
    normals: Array = field(default_factory=lambda: _empty(0, 3, 3))
    kinds: Integers = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    is_slack: npt.NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))
    lines: Array = field(default_factory=lambda: _empty(0, 2, 3))
    line_kinds: Integers = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    dots: Array = field(default_factory=lambda: _empty(0, 3))
    edges: Array = field(default_factory=lambda: _empty(0, 2, 3))

    @property
    def points(self) -> Array:
        """All points (p, 3) of it [m]."""
        parts = (self.corners, self.lines, self.dots)
        return np.concatenate([part.reshape(-1, 3) for part in parts])


def smooth_normals(corners: Array, vertices: npt.NDArray[np.integer]) -> Array:
    """Unit normals (n, 3, 3) at the corners of triangles.

    At each corner it is the mean over the triangles that share the vertex, weighted by their areas.
    Where a triangle deviates much from that mean, i.e. at a sharp edge, the normal of the triangle
    is returned.  Triangles without area have the normal zero where no other shares the vertex.

    Args:
        corners: (n, 3, 3) [m].
        vertices: numbers (n, 3) of the corners; corners with the same number are joined.
    """
    areas = area_vectors(corners)
    sums = np.zeros((int(vertices.max(initial=-1)) + 1, 3))
    np.add.at(sums, vertices.ravel(), np.repeat(areas, 3, axis=0))
    mean = unit(sums[vertices])
    own = np.repeat(unit(areas)[:, None], 3, axis=1)
    alike = (own * mean).sum(axis=2, keepdims=True) > _SHARP_EDGE
    return np.where(alike, mean, own)


def unit(vectors: npt.NDArray) -> Array:
    """The vectors (..., 3) over their lengths; a vector of length zero stays zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0, length, 1.0)
