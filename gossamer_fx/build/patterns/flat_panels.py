"""Flat panels of a cut pattern, the films that are sewn from them, and their distance from the
form."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from scipy.optimize import brentq

from gossamer_fx.build.patterns.closest import Numbers, closest_points
from gossamer_fx.build.patterns.cut_drawings import (
    Outline,
    OutlinePart,
    drawing_of,
    save_dxf,
    save_svg,
)
from gossamer_fx.build.patterns.cutting import CutMesh, named_edges
from gossamer_fx.build.patterns.flattening import FlatMesh, TensionedFilm
from gossamer_fx.build.patterns.triangulation import Triangulation, as_list, as_rows, sides_of
from gossamer_fx.core.checks.arguments import check_arguments, not_negative, positive
from gossamer_fx.core.checks.errors import check, on_rank_zero
from gossamer_fx.core.checks.short_repr import short_repr
from gossamer_fx.core.mesh.gmsh_reader import check_cells
from gossamer_fx.core.mesh.mesh import Mesh, built
from gossamer_fx.core.model.body import Array
from gossamer_fx.core.model.state import HasSystem
from gossamer_fx.mechanics.bodies.cable import BarLaw, CableLaw
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.bodies.tabulated_cable import TabulatedCable
from gossamer_fx.mechanics.connectors.tape import Tape
from gossamer_fx.mechanics.constraints.tie import Seam
from gossamer_fx.mechanics.materials.film import FilmLaw

# Triangles of an unstructured mesh over its area divided by the square of their edges
CELLS_PER_SQUARE = 2.3

# A cord, and the force [N] that it shall have
Cord = tuple[BarLaw, Annotated[float, positive("N")]]

# Largest stretch of a cord in the form
LARGEST_STRETCH = 1.5


@dataclass(frozen=True, eq=False)
class Boundary:
    """A part of the boundary of a panel between two corners, counterclockwise.

    Attributes:
        name: of a seam, or of a part of the rim.
        points: numbers (k + 1,) of the points of the strips' mesh.
        flat: their positions (k + 1, 2) [m] on the panel.
        form: their positions (k + 1, 3) [m] on the form.
        first_corner: names of points of the surface at its start.
    """

    name: str
    points: Numbers
    flat: Array
    form: Array
    first_corner: tuple[str, ...]

    @property
    def fractions(self) -> Array:
        """Fraction (k + 1,) of the length on the form at each point."""
        sums = np.concatenate([[0.0], np.cumsum(_steps(self.form))])
        return sums / sums[-1]

    @property
    def length(self) -> float:
        """Length [m] on the panel."""
        return float(_steps(self.flat).sum())

    @property
    def form_length(self) -> float:
        """Length [m] on the form."""
        return float(_steps(self.form).sum())

    def divided(self, count: int) -> Array:
        """Points (count + 1, 2) [m] on the panel at equal lengths on the form."""
        at = np.linspace(0.0, 1.0, count + 1)
        found = [np.interp(at, self.fractions, self.flat[:, k]) for k in range(2)]
        return np.stack(found, axis=1)


@dataclass(frozen=True, eq=False)
class FlatPanel:
    """A flat panel; `Panels[k]` is one.

    Attributes:
        number: of the panel and its strip, from 0.
        points: (n, 2) [m] in the plane, around the origin, with its seams along x.
        form: positions (n, 3) [m] of the same points on the form.
        triangles: (m, 3).
        boundary: its parts, counterclockwise.
    """

    number: int
    points: Array
    form: Array
    triangles: Numbers
    boundary: tuple[Boundary, ...]

    @property
    def name(self) -> str:
        """E.g. "panel 0"."""
        return f"panel {self.number}"

    @property
    def length(self) -> float:
        """Extent [m] along the seams."""
        return float(np.ptp(self.points[:, 0]))

    @property
    def width(self) -> float:
        """Extent [m] across the seams."""
        return float(np.ptp(self.points[:, 1]))

    @property
    def area(self) -> float:
        """Area [m²]."""
        corners = self.points[self.triangles]
        sides = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
        return float(np.linalg.det(sides).sum() / 2)


@check_arguments
@dataclass(frozen=True, eq=False)
class Deviation:
    """Distances of a film from a form, along the normal of the form.

    Attributes:
        points: positions (n, 3) [m] of the nodes of all films.
        distances: (n,) [m], positive on the side to which the normal of the form points.

    Example:
        >>> found = gx.patterns.Deviation(np.zeros((2, 3)), np.array([1e-3, -2e-3]))
        >>> print(found)
        1.58 mm rms, largest -2 mm at (0, 0, 0) m
    """

    points: Array
    distances: Array

    __repr__ = short_repr

    @property
    def rms(self) -> float:
        """Root of the mean square [m]."""
        return float(np.sqrt(np.mean(self.distances**2)))

    @property
    def largest(self) -> float:
        """The distance of the largest size, with its sign [m]."""
        return float(self.distances[np.abs(self.distances).argmax()])

    def __str__(self) -> str:
        """Both in millimetres, and where the largest is."""
        where = ", ".join(f"{x:.3g}" for x in self.points[np.abs(self.distances).argmax()])
        largest = 1e3 * self.largest
        return f"{1e3 * self.rms:.3g} mm rms, largest {largest:.3g} mm at ({where}) m"


@check_arguments
@dataclass(frozen=True, eq=False)
class Panels(Sequence[FlatPanel]):
    """Flat panels of a cut pattern; made by `Strips.flatten`.

    Attributes:
        form: the surface that was cut.
        mesh: its strips, as one mesh.
        law: of the film.
        tensioned: strain and stiffness of the film under the wanted tension, in the axes of a
            panel.
        flat: plane points of all panels.
        edge_cables: law and force of the cords along edges, by the names of the edges.

    Example:
        >>> points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
        >>> square = gx.patterns.surface((points, [[0, 1, 2], [0, 2, 3]]))
        >>> strips = square.cut(square.by_planes([[0.25, 0, 0]], (1, 0, 0)))
        >>> law = gx.Linear(E=1e8, nu=0.3, density=1000.0, thickness=1e-4)
        >>> panels = strips.flatten(law)
        >>> films = panels.films(size=0.25)
        >>> [film.name for film in films], [seam.name for seam in panels.seams(films)]
        (['panel 0', 'panel 1'], ['seam 0'])
    """

    form: Triangulation
    mesh: CutMesh
    law: FilmLaw
    tensioned: TensionedFilm
    flat: FlatMesh
    edge_cables: Mapping[str, Cord]

    def __len__(self) -> int:
        """Number of panels."""
        return int(self.mesh.strip.max()) + 1

    def __getitem__(self, k: int) -> FlatPanel:  # type: ignore[override]
        """Panel k."""
        return self._panels[k]

    @property
    def tensions(self) -> Array:
        """Principal tensions (m, 2) [N/m], the larger one first, of each triangle of the panels
        when they are pulled into the form; per length of the panel."""
        S = self.flat.tension
        middle = (S[:, 0] + S[:, 1]) / 2
        radius = np.hypot((S[:, 0] - S[:, 1]) / 2, S[:, 2])
        return np.stack([middle + radius, middle - radius], axis=1)

    @cached_property
    def _panels(self) -> list[FlatPanel]:
        """All panels."""
        mesh = self.mesh
        found = []
        for k in range(len(self)):
            used, triangles = np.unique(mesh.triangles[mesh.strip == k], return_inverse=True)
            panel = FlatPanel(
                number=k,
                points=self.flat.points[used],
                form=mesh.points[used],
                triangles=triangles.reshape(-1, 3),
                boundary=self._boundary(k),
            )
            found.append(panel)
        return found

    def _boundary(self, strip: int) -> tuple[Boundary, ...]:
        """The parts of the boundary of a strip, counterclockwise."""
        mesh = self.mesh
        sides = sides_of(mesh.triangles[mesh.strip == strip])
        _, first, count = np.unique(
            np.sort(sides, axis=1), axis=0, return_index=True, return_counts=True
        )
        following = {edge[0]: edge[1] for edge in as_rows(sides[first[count == 1]])}
        name_at: dict[tuple[int, int], str] = {}
        for name, edges in named_edges(mesh, strip).items():
            for a, b in as_rows(edges):
                pair = (a, b) if following.get(a) == b else (b, a)
                name_at.setdefault(pair, name)
        corner_names: dict[int, list[str]] = {}
        for name, points in mesh.corners.items():
            for point in as_list(points):
                corner_names.setdefault(point, []).append(name)
        loop = [min(following)]
        while following[loop[-1]] != loop[0]:
            loop.append(following[loop[-1]])
        names = [name_at[a, following[a]] for a in loop]
        begins = [
            i for i, a in enumerate(loop) if names[i] != names[i - 1] or a in corner_names
        ] or [0]
        found = []
        for start, end in zip(begins, [*begins[1:], begins[0] + len(loop)], strict=True):
            points = np.array([loop[i % len(loop)] for i in range(start, end + 1)])
            part = Boundary(
                name=names[start],
                points=points,
                flat=self.flat.points[points],
                form=mesh.points[points],
                first_corner=tuple(corner_names.get(loop[start], ())),
            )
            found.append(part)
        return tuple(found)

    @check_arguments
    def films(self, *, size: Annotated[float, positive("m")]) -> list[Membrane]:
        """Films on meshes of the flat panels, which start at the form.  Collective.

        The panels lie in the plane z = 0, and the initial displacement of each brings it to its
        strip.  Both sides of a seam have nodes at the same points of the form.  Groups of the
        meshes are "film", seams, parts of the rim and named points of the surface.

        Args:
            size: length of the edges of triangles [m].

        Raises:
            InputError: there would be too many triangles.
        """
        area = sum(panel.area for panel in self)
        check_cells("Panels.films", CELLS_PER_SQUARE * area / size**2)
        films = []
        for panel in self:
            film = Membrane(
                self._mesh(panel, size),
                self.law,
                displacement=_to_form(panel),
                name=panel.name,
            )
            films.append(film)
        return films

    def _mesh(self, panel: FlatPanel, size: float) -> Mesh:
        """The mesh of a panel with edges of a length [m].  Collective."""

        def build(model: Any) -> None:
            geo = model.geo
            corners: list[tuple[str, int]] = []
            lines: list[int] = []
            lines_of: dict[str, list[int]] = {}
            tags: list[list[int]] = []
            for part in panel.boundary:
                # The length on the form is the same on both sides of a seam.
                count = max(1, math.ceil(part.form_length / size - 1e-6))
                flat = part.divided(count)[:-1]
                tags.append([geo.addPoint(x, y, 0.0, size) for x, y in flat])
                corners += [(name, tags[-1][0]) for name in part.first_corner]
            for k, part in enumerate(panel.boundary):
                following = tags[(k + 1) % len(tags)][0]
                chain = [*tags[k], following]
                made = [geo.addLine(a, b) for a, b in pairwise(chain)]
                lines += made
                lines_of.setdefault(part.name, []).extend(made)
            for line in lines:
                geo.mesh.setTransfiniteCurve(line, 2)
            plane = geo.addPlaneSurface([geo.addCurveLoop(lines)])
            geo.synchronize()
            model.addPhysicalGroup(2, [plane], name="film")
            for name, made in lines_of.items():
                model.addPhysicalGroup(1, made, name=name)
            for name, point in corners:
                model.addPhysicalGroup(0, [point], name=name)
            model.mesh.generate(2)

        return built(build, self.form.comm, f"The mesh of {panel.name}")

    @check_arguments
    def seams(self, films: Sequence[Membrane]) -> list[Seam]:
        """The seams between the films, whose edges coincide at the start.

        Args:
            films: of `Panels.films`.

        Raises:
            InputError: there are not as many films as panels, or they have other edges.
        """
        self._check(films)
        found = []
        for seam in self.mesh.seams:
            left, right = seam.strips
            name_left, name_right = seam.names
            sewn = Seam(
                films[left],
                name_left,
                films[right],
                name_right,
                closing=None,
                name=f"seam {seam.number}",
            )
            found.append(sewn)
        return found

    @check_arguments
    def cables(self, films: Sequence[Membrane]) -> list[Tape]:
        """The cords of `edge_cables`, which have their forces when the films are at the form.

        The cord on a seam is on the film on its left.  Collective.

        Args:
            films: of `Panels.films`.

        Raises:
            InputError: there are not as many films as panels, or they have other edges.
        """
        self._check(films)
        found = []
        for film, panel in zip(films, self, strict=True):
            for name in dict.fromkeys(part.name for part in panel.boundary):
                if name not in self.edge_cables or self._is_right_side(panel.number, name):
                    continue
                law, force = self.edge_cables[name]
                parts = [part for part in panel.boundary if part.name == name]
                stretch = sum(part.form_length for part in parts)
                stretch /= sum(part.length for part in parts)
                cord = Tape.along_edges(
                    film,
                    law,
                    edges=name,
                    length_factor=stretch / _cord_stretch(law, force),
                    name=f"{name} of {panel.name}",
                )
                found.append(cord)
        return found

    def _is_right_side(self, strip: int, name: str) -> bool:
        """Whether a name is that of a seam on whose right a strip is, and another on its left."""
        return any(
            seam.names[1] == name and seam.strips[1] == strip and seam.strips[0] != strip
            for seam in self.mesh.seams
        )

    @check_arguments
    def deviation(self, films: Sequence[Membrane], *, at: HasSystem) -> Deviation:
        """Distances of the nodes of the films from the form, along its normal.  Collective.

        Args:
            films: of `Panels.films`.
            at: an `Equilibrium` or a `Simulation` with these films.

        Raises:
            InputError: there are not as many films as panels.
        """
        self._check(films)
        positions = []
        for film in films:
            mine = at.system.unknowns.state[film].positions()
            positions.append(np.concatenate(film.comm.allgather(mine)))
        points = np.concatenate(positions)
        on = self.form.closest(points)
        along = np.einsum("nc,nc->n", points - on.points, self.form.normals[on.triangle])
        # Beyond the rim the closest point is not along the normal; this is the part that is.
        return Deviation(points, along)

    @check_arguments
    def write_dxf(
        self,
        path: str | Path,
        *,
        allowance: Annotated[float, not_negative("m")] = 0.0,
        hem: Annotated[float, not_negative("m")] = 0.0,
        marks: Annotated[float, positive("m")] | None = None,
    ) -> None:
        """Write the panels as DXF in true scale, in millimetres.  Collective; rank 0 writes.

        The outline of a panel is on the layers of its seams and parts of the rim, and its name is
        on the layer "names".  The layer "cut" has the outline with allowances, and "marks" has
        marks at equal positions on both sides of a seam, and names of edges; leave both out to read
        the panels back: `read_dxf(path, comm, size=..., leave_out=("cut", "marks"))`.  The package
        ezdxf has to be installed.

        Args:
            path: of the file.
            allowance: width of film beyond seams [m].
            hem: width of film beyond the rim [m].
            marks: largest distance of marks along seams [m]; None: at the ends of seams only.

        Raises:
            InputError: ezdxf is missing, a width is negative.
            OutputFailure: the file cannot be written.
        """
        drawing = drawing_of(self._outlines(allowance, hem, marks))
        on_rank_zero(self.form.comm, lambda: save_dxf(Path(path), drawing))

    @check_arguments
    def write_svg(
        self,
        path: str | Path,
        *,
        allowance: Annotated[float, not_negative("m")] = 0.0,
        hem: Annotated[float, not_negative("m")] = 0.0,
        marks: Annotated[float, positive("m")] | None = None,
    ) -> None:
        """Write the panels as SVG in true scale, with the lines and names of `write_dxf`, the
        classes of which are the layers.  Collective; rank 0 writes.

        Args:
            path: of the file.
            allowance: width of film beyond seams [m].
            hem: width of film beyond the rim [m].
            marks: largest distance of marks along seams [m]; None: at the ends of seams only.

        Raises:
            InputError: a width is negative.
            OutputFailure: the file cannot be written.
        """
        drawing = drawing_of(self._outlines(allowance, hem, marks))
        on_rank_zero(self.form.comm, lambda: save_svg(Path(path), drawing))

    def _outlines(self, allowance: float, hem: float, spacing: float | None) -> list[Outline]:
        """What is drawn of the panels."""
        seams = {name for seam in self.mesh.seams for name in seam.names}
        outlines = []
        for panel in self:
            parts = []
            for part in panel.boundary:
                is_seam = part.name in seams
                count = 1
                if spacing is not None:
                    count = max(1, math.ceil(part.form_length / spacing - 1e-6))
                    check_cells("Panels: drawing of marks", count)
                marks = part.divided(count) if is_seam else np.zeros((0, 2))
                width = allowance if is_seam else hem
                parts.append(OutlinePart(part.name, part.flat, width, marks))
            outlines.append(Outline(panel.name, parts, panel.points[panel.triangles]))
        return outlines

    def _check(self, films: Sequence[Membrane]) -> None:
        check(
            len(films) == len(self),
            f"Panels: there are {len(films)} films for {len(self)} panels; give those of "
            "Panels.films.",
        )


def _steps(points: Array) -> Array:
    """Distances (k,) [m] of consecutive points."""
    return np.asarray(np.linalg.norm(np.diff(points, axis=0), axis=1))


def _to_form(panel: FlatPanel) -> Any:
    """The displacement that brings points (3, n) [m] of a panel to the form."""
    flat = np.column_stack([panel.points, np.zeros(len(panel.points))])

    def displacement(X: Array) -> Array:
        on = closest_points(flat, panel.triangles, X.T)
        corners = panel.form[panel.triangles[on.triangle]]
        form = np.einsum("nk,nkc->nc", on.weights, corners)
        return np.asarray(form.T - X)

    return displacement


def _cord_stretch(law: BarLaw, force: float) -> float:
    """The stretch λ of a cord under a force N [N]: N = EA λ (λ² - 1)/2 of a law in the Green
    strain, N(λ - 1) of others."""

    def excess(stretch: float) -> float:
        if isinstance(law, TabulatedCable):
            return float(law.force_at(np.array(stretch - 1))) - force
        assert isinstance(law, CableLaw)
        if law.strain == "green":
            return law.EA * stretch * (stretch**2 - 1) / 2 - force
        return law.EA * (stretch - 1) - force

    check(
        excess(LARGEST_STRETCH) > 0,
        f"Panels.cables: {force:g} N stretch the cord to more than {LARGEST_STRETCH:g} times its "
        "length; give less force, or a stiffer cord.",
    )
    return float(brentq(excess, 1.0, LARGEST_STRETCH, xtol=1e-15))
