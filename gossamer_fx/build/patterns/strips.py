"""Strips of a cut surface, which become flat panels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from gossamer_fx.build.patterns.cutting import CutMesh, SeamEdges, named_edges
from gossamer_fx.build.patterns.flat_panels import Cord, Panels
from gossamer_fx.build.patterns.flattening import flattened, tensioned
from gossamer_fx.build.patterns.triangulation import Triangulation
from gossamer_fx.core.checks.arguments import check_arguments, not_negative
from gossamer_fx.core.checks.lookups import check_known
from gossamer_fx.mechanics.materials.film import FilmLaw

# Tension [N/m] of a panel, in all directions or along and across it
Tension = (
    Annotated[float, not_negative("N/m")]
    | tuple[Annotated[float, not_negative("N/m")], Annotated[float, not_negative("N/m")]]
)


@check_arguments
@dataclass(frozen=True, eq=False)
class Strips(Sequence[Triangulation]):
    """The strips of a cut surface; made by `FormSurface.cut`.

    `strips[k]` is strip k as a surface.  Its groups are the edges of each seam, "seam 0", ..., and
    its parts of the rim, by the names of the surface, or "rim 1", ... from corner to corner.

    Attributes:
        form: the surface that was cut.
        mesh: all strips as one mesh.

    Example:
        >>> points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
        >>> square = gx.patterns.surface((points, [[0, 1, 2], [0, 2, 3]]))
        >>> strips = square.cut(square.by_planes([[0.25, 0, 0]], (1, 0, 0)))
        >>> len(strips), sorted(strips[0].groups)
        (2, ['rim 1', 'rim 2', 'rim 4', 'seam 0'])
    """

    form: Triangulation
    mesh: CutMesh

    def __len__(self) -> int:
        """Number of strips."""
        return int(self.mesh.strip.max()) + 1

    def __getitem__(self, k: int) -> Triangulation:  # type: ignore[override]
        """Strip k."""
        number = k + len(self) if k < 0 else k
        if not 0 <= number < len(self):
            raise IndexError(f"there are strips 0 to {len(self) - 1}, and no strip {k}")
        mesh = self.mesh
        used, triangles = np.unique(mesh.triangles[mesh.strip == number], return_inverse=True)
        groups = {}
        for name, edges in named_edges(mesh, number).items():
            groups[name] = np.searchsorted(used, edges)
        for name, points in mesh.corners.items():
            mine = points[np.isin(points, used)]
            if len(mine):
                groups[name] = np.searchsorted(used, mine)
        return Triangulation(mesh.points[used], triangles.reshape(-1, 3), groups, self.form.comm)

    @property
    def seams(self) -> tuple[SeamEdges, ...]:
        """The seams, with the numbers of the strips on the left and on the right of each."""
        return self.mesh.seams

    @check_arguments
    def flatten(
        self,
        law: FilmLaw,
        *,
        tension: Tension = 0.0,
        edge_cables: Mapping[str, Cord] | None = None,
        equal_seams: bool = True,
    ) -> Panels:
        """Find the flat panels whose tensioned state is the form.

        The energy of the film's own law between the panel and the strip, less the wanted tension,
        is least, so that panels are compensated by the strain under the tension.  The seams of a
        panel lie along its x axis; the axes of an orthotropic law are those of the panel.  A strip
        that can be developed becomes a panel without error.

        Args:
            law: of the film that is cut.
            tension: n [N/m], or along and across the strips (n1, n2) [N/m]; per present length.
            edge_cables: for names of seams or parts of the rim the law of a cord along it, and the
                force [N] that it shall have in the form; `Panels.cables` makes them.
            equal_seams: whether both sides of a seam shall have the same length, edge by edge.

        Raises:
            InputError: the law has no strain of a given tension, or a large one; a strip is closed
                in itself, or curved too much; a cable at an edge that does not exist.

        Example:
            >>> points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
            >>> square = gx.patterns.surface((points, [[0, 1, 2], [0, 2, 3]]))
            >>> strips = square.cut(square.by_planes([[0.25, 0, 0]], (1, 0, 0)))
            >>> law = gx.Linear(E=1e8, nu=0.3, density=1000.0, thickness=1e-4)
            >>> panels = strips.flatten(law, tension=100.0)
            >>> [f"{1 - panel.length:.3f}" for panel in panels]
            ['0.007', '0.007']
        """
        n1, n2 = tension if isinstance(tension, tuple) else (tension, tension)
        known = set(self.mesh.rims)
        for seam in self.mesh.seams:
            known |= set(seam.names)
        for name in edge_cables or {}:
            check_known("Strips.flatten: the pattern", "edge", name, sorted(known))
        film = tensioned(law, (float(n1), float(n2)))
        flat = flattened(self.mesh, film, equal_seams)
        return Panels(self.form, self.mesh, law, film, flat, dict(edge_cables or {}))
