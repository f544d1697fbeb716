"""A round tube with flat caps, in compartments: its nodes lie in rows, so that it can start folded
flat between stubs (`gx.fold.TubeZigzag`)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np
from mpi4py import MPI

from gossamer_fx import Mesh
from gossamer_fx.extend import check, check_arguments, not_negative

from .arrays import Cells, Groups, Length, Numbers, Points, check_cells, mesh_of_arrays, polyline


@dataclass(frozen=True)
class TubeLattice:
    """Nodes and triangles of `round_tube`, whose arguments these are.

    Nodes lie in rows across the tube, `around` in each, the first one at y > 0 and the following
    ones turned from y to z; after the last row come the centres of the two caps.
    """

    length: float
    diameter: float
    cells: int
    panels: int
    stub: float

    def __post_init__(self) -> None:
        check(
            2 * self.stub < self.length,
            f"round_tube: two stubs of {self.stub:g} m leave nothing of a tube of "
            f"{self.length:g} m; give shorter stubs.",
        )
        most_rows = self.length / self.edge + 2 * (self.panels + 2)
        check_cells("round_tube", 2 * self.around * most_rows)

    @property
    def around(self) -> int:
        """Nodes of a row.  When the tube is flat, half of its edges are on each side; their number
        is even, for the symmetry of the pattern."""
        return 4 * max(round(self.cells / 2), 1)

    @property
    def edge(self) -> float:
        """Length of the edges of the section [m]: its circumference is that of the circle."""
        return math.pi * self.diameter / self.around

    @property
    def radius(self) -> float:
        """Distance of the nodes from the axis [m]."""
        return self.edge / (2 * math.sin(math.pi / self.around))

    @cached_property
    def borders(self) -> Points:
        """Where compartments begin and end (n + 1,) [m] along the tube."""
        inner = np.linspace(self.stub, self.length - self.stub, self.panels + 1).astype(float)
        if self.stub == 0:
            return inner
        return np.concatenate([[0.0], inner, [self.length]])

    @cached_property
    def border_rows(self) -> Numbers:
        """Numbers (n + 1,) of the rows at `borders`."""
        # An even number of rows in each compartment, for the symmetry of the pattern; cells along
        # the tube are about as long as wide.
        pairs = np.rint(np.diff(self.borders) / self.edge / 2).astype(np.int64)
        return np.concatenate([[0], np.cumsum(2 * np.maximum(pairs, 1))])

    @cached_property
    def rows(self) -> Points:
        """Coordinates x (m,) [m] of the rows."""
        numbers = np.arange(self.border_rows[-1] + 1)
        return np.interp(numbers, self.border_rows, self.borders)

    def nodes(self, row: int) -> Numbers:
        """Nodes (around,) of a row."""
        return row * self.around + np.arange(self.around)

    def ring(self, row: int) -> Numbers:
        """Edges (around, 2) of a row, a closed line."""
        return polyline(np.append(self.nodes(row), self.nodes(row)[0]))

    @property
    def centres(self) -> tuple[int, int]:
        """Nodes at the centres of the first and of the last cap."""
        first = len(self.rows) * self.around
        return first, first + 1

    @cached_property
    def points(self) -> Points:
        """All nodes (n, 3) [m] of the round tube."""
        angle = 2 * math.pi * np.arange(self.around) / self.around
        section = self.radius * np.column_stack([np.cos(angle), np.sin(angle)])
        wall = np.column_stack(
            [np.repeat(self.rows, self.around), np.tile(section, (len(self.rows), 1))]
        )
        return np.vstack([wall, [[0.0, 0.0, 0.0], [self.length, 0.0, 0.0]]])

    def strip(self, row: int) -> Numbers:
        """Triangles (2 around, 3) from a row to the next one; normals point outwards.  The
        diagonals alternate: the pattern is symmetric, and no triangle has all its nodes on a line
        along the tube, where it could not open."""
        a = self.nodes(row)
        b = np.roll(a, -1)
        c = self.nodes(row + 1)
        d = np.roll(c, -1)
        rising = (row + np.arange(self.around)) % 2 == 1
        first = np.where(rising[:, None], np.column_stack([a, b, c]), np.column_stack([a, b, d]))
        second = np.where(rising[:, None], np.column_stack([b, d, c]), np.column_stack([a, d, c]))
        return np.concatenate([first, second])

    def cap(self, end: int) -> Numbers:
        """Triangles (around, 3) of the first cap (0) or of the last one (1); normals point
        outwards."""
        row = 0 if end == 0 else len(self.rows) - 1
        rim = self.ring(row)
        centre = np.full(len(rim), self.centres[end])
        outwards = rim[:, ::-1] if end == 0 else rim
        return np.column_stack([centre, outwards])

    def groups(self) -> Groups:
        """Nodes of the groups of `round_tube`."""
        inlet, tip = self.centres
        last = len(self.rows) - 1
        groups: dict[str, Numbers] = {
            "inlet": self.cap(0),
            "tip": self.cap(1),
            "inlet rim": self.ring(0),
            "tip rim": self.ring(last),
            "inlet centre": np.array([inlet]),
            "tip centre": np.array([tip]),
        }
        count = len(self.borders) - 1
        # A tube that is not divided has no rings, and its only compartment is the whole tube.
        if count == 1:
            return groups
        for k in range(count):
            strips = [self.strip(i) for i in range(self.border_rows[k], self.border_rows[k + 1])]
            if k == 0:
                strips.append(self.cap(0))
            if k == count - 1:
                strips.append(self.cap(1))
            groups[f"compartment {k + 1}"] = np.concatenate(strips)
        for k in range(1, count):
            groups[f"ring {k}"] = self.ring(int(self.border_rows[k]))
        return groups

    def arrays(self) -> tuple[Points, Numbers, Groups]:
        """Points, triangles and groups for `mesh_of_arrays`."""
        strips = [self.strip(i) for i in range(len(self.rows) - 1)]
        triangles = np.concatenate([*strips, self.cap(0), self.cap(1)])
        return self.points, triangles, self.groups()


@check_arguments
def round_tube(
    comm: MPI.Intracomm,
    length: Length,
    diameter: Length,
    cells: Cells,
    panels: Cells = 1,
    stub: Annotated[float, not_negative("m")] = 0.0,
) -> Mesh:
    """Make a round tube about the x axis from x = 0 to `length`, closed by flat caps; normals point
    outwards.

    Its section is a regular polygon whose circumference is π d, so that the same film can be
    pressed flat, as `gx.fold.TubeZigzag` does.  Groups: "film"; the caps "inlet" (x = 0) and "tip",
    their circles "inlet rim", "tip rim" and centres "inlet centre", "tip centre".  Panels and stubs
    are compartments; if there are several, also the surface of each with its cap, "compartment 1"
    and so on from the inlet, and the circle between one and the next, "ring 1" and so on.
    Collective.

    Args:
        length: of the tube [m], along x.
        diameter: d [m].
        cells: edges of triangles on half of the circumference, at least 1, rounded to an even
            number of at least 2.
        panels: of equal length, along the tube between the stubs.
        stub: length [m] of a further compartment at each end; zero: none.

    Raises:
        InputError: a length is not positive, there are no cells or panels, or the stubs are as long
            as the tube.

    Example:
        >>> from gossamer_fx.meshes.round_tube import round_tube
        >>> mesh = round_tube(comm, 0.25, 0.03, cells=4, panels=2, stub=0.045)
        >>> sorted(name for name in mesh.groups if name.startswith("ring"))
        ['ring 1', 'ring 2', 'ring 3']
    """
    lattice = TubeLattice(length, diameter, cells, panels, stub)
    return mesh_of_arrays(comm, lattice.arrays)
