"""Gores: the flat panels from which a body of revolution is sewn.

Problem.  A balloon or a dome is approximated by n equal flat panels that go from pole to pole.

Idea.  With s the arc length of the meridian (r(s), z(s)), the gore of width

    w(s) = 2 π r(s)/n                                                                            (1)

has everywhere the circumference of the body.  Bent along its length only, it fits the body as a
developable surface: the point (s, y) of gore k goes to

    x = r(s) e_k + y t_k + z(s) e_z, e_k = (cos φ_k, sin φ_k, 0), t_k = (-sin φ_k, cos φ_k, 0)  (2)

without any strain.  The edges of neighbours are then close to each other, r (π/n)³/3 apart, so that
seams have little to close.

The panels lie side by side in the plane of the mesh, at y = k times their pitch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from gossamer_fx.build.meshes.arrays import Numbers, Points, mesh_of_arrays, polyline
from gossamer_fx.core.checks.arguments import Range, check_arguments
from gossamer_fx.core.checks.errors import InputError, check, real_numbers
from gossamer_fx.core.mesh.gmsh_reader import check_cells
from gossamer_fx.core.mesh.mesh import Mesh
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.constraints.tie import Seam

# Radius at an end, over the largest one, below which the gore ends in a point.
POINT = 1e-9

# Distance of the middle lines of panels in the mesh, over the largest width of a gore.
PITCH = 1.25


@check_arguments
@dataclass(frozen=True, eq=False)
class Gores:
    """n equal flat gores of a body of revolution; made by `gores`.

    Attributes:
        profile: points (m, 2) of the meridian [m], radius and height, from one end to the other.
        count: n.

    Example:
        >>> cone = gx.patterns.gores([[0.0, 1.0], [0.5, 0.5], [1.0, 0.0]], 6)
        >>> paper = gx.Membrane(cone.mesh(comm, along=4, across=2), law, displacement=cone.placed)
        >>> [seam.name for seam in cone.seams(paper)[:2]]
        ['seam 0', 'seam 1']
    """

    profile: Array
    count: Annotated[int, Range(3)]

    @cached_property
    def arc_lengths(self) -> Array:
        """s (m,) [m] of the points of the profile."""
        steps = np.linalg.norm(np.diff(self.profile, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    @property
    def length(self) -> float:
        """Length of a gore [m]."""
        return float(self.arc_lengths[-1])

    @check_arguments
    def meridian(self, s: npt.ArrayLike) -> tuple[Array, Array]:
        """Radius and height [m] of the body at arc lengths s [m], arrays of the shape of s."""
        at = np.asarray(s, dtype=np.float64)
        radius = np.interp(at, self.arc_lengths, self.profile[:, 0])
        height = np.interp(at, self.arc_lengths, self.profile[:, 1])
        return radius, height

    @check_arguments
    def width(self, s: npt.ArrayLike) -> Array:
        """Width [m] of a gore at arc lengths s [m], by equation (1) of the module; of the shape of
        s."""
        return 2 * np.pi * self.meridian(s)[0] / self.count

    @property
    def pitch(self) -> float:
        """Distance [m] of the middle lines of panels in the mesh."""
        return PITCH * float(self.width(self.arc_lengths).max())

    @check_arguments
    def mesh(
        self,
        comm: MPI.Intracomm,
        *,
        along: Annotated[int, Range(2)],
        across: Annotated[int, Range(1)],
    ) -> Mesh:
        """All gores, the flat panels of a body of revolution, in one mesh, side by side in the
        plane z = 0.

        Normals point outwards once the gores are moved to their positions.  Groups: "film", of each
        panel "gore k", its edges "left k" and "right k" and, where it does not end in a point,
        "first end k" and "last end k"; the points "first k" and "last k" of pointed ends; k from 0
        to n - 1.

        Args:
            comm: the ranks to which the mesh is distributed.
            along: cells from end to end, two or more.
            across: cells from edge to edge, one or more.

        Raises:
            InputError: too few cells.
        """
        check_cells("Gores.mesh", 2 * self.count * along * across)
        return mesh_of_arrays(comm, lambda: self._arrays(along, across))

    @check_arguments
    def placed(self, X: Array, apart: float = 0.0) -> Array:
        """Displacement (3, n) [m] of mesh points that moves each gore to its position without
        strain.

        A gore is a flat panel of a body of revolution with the meridian r(s), z(s).  The point (s,
        y) of gore k, y from its middle line, goes to r(s) e_k + y t_k + z(s) e_z, with the radial
        and the tangential unit vectors e_k and t_k.

        Args:
            X: points (3, n) of the mesh [m]: arc length s, y plus k times the pitch of the panels,
                and 0.
            apart: distance [m] by which each gore is farther from the axis, for a look at the
                sewing.
        """
        number = np.rint(X[1] / self.pitch)
        y = X[1] - number * self.pitch
        angle = 2 * np.pi * number / self.count
        radius, height = self.meridian(X[0])
        radius = radius + apart
        x1 = radius * np.cos(angle) - y * np.sin(angle)
        x2 = radius * np.sin(angle) + y * np.cos(angle)
        return np.stack([x1, x2, height]) - X

    @check_arguments
    def seams(
        self, film: Membrane, *, closing: tuple[float, float] | None = (0.0, 1.0)
    ) -> list[Seam]:
        """The n seams of a film on `mesh`: the left edge of each gore to the right edge of the
        next.

        Args:
            film: on a mesh of these gores.
            closing: times [s] at which the sewing begins and ends; None: the edges coincide at the
                start.

        Raises:
            InputError: the film's mesh has no edges of these names, or the times do not rise from 0
                on.
        """
        found = []
        for k in range(self.count):
            after = (k + 1) % self.count
            seam = Seam(
                film, f"left {k}", film, f"right {after}", closing=closing, name=f"seam {k}"
            )
            found.append(seam)
        return found

    def _arrays(self, along: int, across: int) -> tuple[Points, Numbers, dict[str, Numbers]]:
        """Points (n, 3) [m], triangles (m, 3) and groups of all panels, see `mesh_of_arrays`."""
        s = np.linspace(0.0, self.length, along + 1)
        half_width = self.width(s) / 2
        largest = float(half_width.max())
        # Normals shall point outwards on the body: triangles are turned if the profile rises.
        rises = self.profile[-1, 1] > self.profile[0, 1]
        points: list[Points] = []
        triangles: list[Numbers] = []
        groups: dict[str, Numbers] = {}
        count = 0
        for k in range(self.count):
            rows = []
            for i in range(along + 1):
                # At a tip, where a gore may begin or end, the nodes of a row would coincide: it has
                # one node.
                y = np.zeros(1)
                if 0 < i < along or half_width[i] > POINT * largest:
                    y = np.linspace(-half_width[i], half_width[i], across + 1)
                points.append(np.stack([np.full(len(y), s[i]), y + k * self.pitch, 0 * y], axis=1))
                rows.append(count + np.arange(len(y)))
                count += len(y)
            panel = np.array(_triangles(rows))
            if rises:
                panel = panel[:, ::-1]
            triangles.append(panel)
            groups[f"gore {k}"] = panel
            groups[f"right {k}"] = polyline(np.array([row[0] for row in rows]))
            groups[f"left {k}"] = polyline(np.array([row[-1] for row in rows]))
            for row, end in ((rows[0], "first"), (rows[-1], "last")):
                if len(row) == 1:
                    groups[f"{end} {k}"] = row
                else:
                    groups[f"{end} end {k}"] = polyline(row)
        return np.concatenate(points), np.concatenate(triangles), groups


@check_arguments
def gores(profile: Sequence[Sequence[float]] | Array, n: Annotated[int, Range(3)]) -> Gores:
    """Cut a body of revolution into n equal flat gores.

    Their width is that of the body, w(s) = 2 π r(s)/n along the arc length s of the meridian, so
    that seams and film bulge between them as the pressure will.

    Args:
        profile: points (m, 2) of the meridian [m], radius r >= 0 and height z, from one end to the
            other.
        n: number of gores, three or more.

    Raises:
        InputError: fewer than three points, repeated points, a negative radius, fewer than three
            gores, a profile that is closed within its length.

    Example:
        >>> angle = np.linspace(0.0, np.pi, 61)
        >>> sphere = gx.patterns.gores(np.stack([np.sin(angle), -np.cos(angle)], axis=1), 12)
        >>> round(sphere.length, 2), round(float(sphere.width(sphere.length / 2)), 3)
        (3.14, 0.524)
    """
    points = real_numbers(profile)
    if points is None or points.ndim != 2 or points.shape[1] != 2 or len(points) < 3:
        raise InputError("gores: profile is not a list of three points (radius, height) or more.")
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    repeated = np.flatnonzero(steps <= 0)
    check(
        not len(repeated),
        f"gores: the points {_first(repeated)} and {_first(repeated) + 1} of the profile are one; "
        "leave one out.",
    )
    largest = float(points[:, 0].max())
    negative = np.flatnonzero(points[:, 0] < -POINT * largest)
    check(
        not len(negative),
        f"gores: the radius of point {_first(negative)} of the profile is negative; "
        "give zero or more.",
    )
    # Round-off of sin(π) is not a radius.
    points[:, 0] = np.where(points[:, 0] <= POINT * largest, 0.0, points[:, 0])
    closed = np.flatnonzero(points[1:-1, 0] == 0)
    check(
        not len(closed),
        f"gores: the radius of point {_first(closed) + 1} of the profile is zero; "
        "only its ends may be poles.",
    )
    return Gores(points, n)


def _first(found: Any) -> int:
    """The first of some numbers, counted from one; zero if there is none."""
    return int(found[0]) + 1 if len(found) else 0


def _triangles(rows: Sequence[Any]) -> list[tuple[int, int, int]]:
    """Triangles between rows of nodes, as three of their numbers each, with normals along z; a row
    of one node is a tip."""
    found = []
    for i, (a, b) in enumerate(pairwise(rows)):
        if len(a) == 1 or len(b) == 1:
            found += _fan(a, b)
            continue
        for j in range(len(a) - 1):
            p = int(a[j])
            q = int(b[j])
            r = int(b[j + 1])
            t = int(a[j + 1])
            # Diagonals alternate, so that the pattern has no direction.
            if (i + j) % 2:
                found += [(p, q, r), (p, r, t)]
            else:
                found += [(p, q, t), (q, r, t)]
    return found


def _fan(a: Any, b: Any) -> list[tuple[int, int, int]]:
    """Triangles between a row of nodes and a tip, with normals along z."""
    if len(a) == 1:
        return [(int(a[0]), int(first), int(second)) for first, second in pairwise(b)]
    return [(int(second), int(first), int(b[0])) for first, second in pairwise(a)]
