"""Triangulations in space: points, triangles, and names of some of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from gossamer_fx.build.patterns.closest import ClosestPoints, Numbers, closest_points
from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import InputError, are_usual_sizes, real_numbers
from gossamer_fx.core.model.body import Array


@dataclass(frozen=True, eq=False)
class Triangulation:
    """A triangulated surface, the same on every rank, e.g. a strip of a cut form.

    Attributes:
        points: (n, 3) [m].
        triangles: numbers (m, 3) of their corners, with consistent normals.
        groups: named points (1,) and edges (k, 2), as numbers of points, e.g. of supports.
        comm: the ranks that have it.
    """

    points: Array
    triangles: Numbers
    groups: Mapping[str, Numbers] = field(default_factory=dict)
    comm: MPI.Intracomm = field(default_factory=lambda: MPI.COMM_WORLD)

    def __repr__(self) -> str:
        """The numbers of triangles and points, and the names of the groups."""
        names = ", ".join(self.groups) or "none"
        return (
            f"<{type(self).__name__} of {len(self.triangles)} triangles, {len(self.points)} "
            f"points, {self.area:.4g} m²; groups: {names}>"
        )

    @cached_property
    def normals(self) -> Array:
        """Unit normals (m, 3) of the triangles."""
        vectors = area_vectors(self.points, self.triangles)
        return vectors / np.linalg.norm(vectors, axis=1)[:, None]

    @property
    def area(self) -> float:
        """Area [m²]."""
        vectors = area_vectors(self.points, self.triangles)
        return float(np.linalg.norm(vectors, axis=1).sum())

    @property
    def extent(self) -> float:
        """Diagonal [m] of the box around it."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))

    @check_arguments
    def closest(self, points: npt.ArrayLike) -> ClosestPoints:
        """The points of the surface that are closest to given ones (n, 3) [m].

        Raises:
            InputError: the points are not rows of three numbers.
        """
        given = rows_of_points("closest", points)
        return closest_points(self.points, self.triangles, given)


def rows_of_points(what: str, points: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Given points as an array (n, 3) [m]; `InputError` names the caller."""
    rows = real_numbers(points)
    if rows is None or rows.ndim != 2 or rows.shape[1] != 3 or not are_usual_sizes(rows):
        raise InputError(f"{what}: points are not rows of three numbers (x, y, z); give (n, 3).")
    return rows


def area_vectors(points: Array, triangles: Numbers) -> Array:
    """Half of the cross product of two sides (m, 3) [m²] of each triangle."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return np.cross(b - a, c - a) / 2


def sides_of(triangles: Numbers) -> Numbers:
    """The sides (3 m, 2) of triangles (m, 3), each from a corner to the next."""
    return triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)


def as_rows(numbers: Numbers) -> list[list[int]]:
    """Rows (n, k) of whole numbers as lists."""
    found: Any = numbers.tolist()
    return list(found)


def as_list(numbers: Numbers) -> list[int]:
    """Whole numbers (n,) as a list."""
    found: Any = numbers.tolist()
    return list(found)
