"""Enclosures of chambers: the volume inside a film, and the volume that a piston sweeps.

An enclosure is compiled when a scene is.  The compiled enclosure gives the volume V(q), its
gradient G = ∂V/∂q, and the swept volume W of a step; it takes a pressure and adds the force
pressure · G.

The step goes from coordinates q0 to q1; forces act at q_mid = (1 - α) q0 + α q1, with α of the time
stepping rule.  The work of the gas in the step is then pressure · W with W = G(q_mid)·(q1 - q0), to
the last digit, so film and gas exchange energy without loss.

Connected components of a closed surface must all have their normals on one side.  The triangles of
one component agree with each other, since neighbours do.  Nothing relates the normals of one
component to those of another: a component that is inside out counts its volume as negative, and the
gas pulls it inwards.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, Protocol

import numpy as np
import numpy.typing as npt
from dolfinx import fem, la
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.core.algebra.point_measures import PointPort, attach
from gossamer_fx.core.checks.arguments import Direction, check_arguments, positive
from gossamer_fx.core.checks.errors import InputError, check, check_on_all
from gossamer_fx.core.forms.backend import cell_nodes
from gossamer_fx.core.mesh.edges import EdgeTable
from gossamer_fx.core.mesh.quality import area_vectors
from gossamer_fx.core.model.body import Array, unit
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.gas.film_area import named_triangles
from gossamer_fx.mechanics.gas.patches import ChamberSurfaces, Moving, Side, Triangles
from gossamer_fx.mechanics.gas.ring import Loop, Ring
from gossamer_fx.mechanics.gas.surface import Geometry
from gossamer_fx.mechanics.terms.assembly import Assembly

# A volume below this share of the sum of its terms' sizes is round-off: it has no sign.  Sums over
# 1e4 to 1e6 triangles have a round-off of some 1e-14; a factor of 100 is left.
ROUND_OFF = 1e-12


class CompiledEnclosure(Protocol):
    """An enclosed volume in a running scene, evaluated by the last `Geometry.follow`.

    Gradients are the owned parts of system vectors.
    """

    @property
    def pressure(self) -> Array:
        """The pressure (1,) [Pa] of the iterate, written by the network; forces and tangents use
        it."""

    @property
    def measures(self) -> Array:
        """Three volumes [m³], the same on every rank: V(q1); the sum of the sizes of the terms that
        add up to it, by which round-off is judged; and W = G(q_mid)·(q1 - q0), or V(q1) - V(q0) if
        forces act at the end of the step."""

    def start(self) -> None:
        """Take q1 as the initial state, e.g. to find the sign of the normals; the geometry is
        evaluated again afterwards."""

    # G(q_mid), ∂V/∂q1 and ∂W/∂q1 [m²]; read-only, until the next `Geometry.follow`.

    @property
    def at_middle(self) -> Array: ...

    @property
    def of_volume(self) -> Array: ...

    @property
    def of_swept(self) -> Array: ...


class Enclosure(ABC):
    """What bounds a chamber, as an item of a scene."""

    @property
    @abstractmethod
    def films(self) -> Sequence[Membrane]:
        """The films that bound the chamber, on which outputs show the pressure; none for a
        piston."""

    @property
    @abstractmethod
    def whole_films(self) -> Sequence[Membrane]:
        """Films of which all triangles bound the chamber, so that no second chamber may use
        them."""

    @abstractmethod
    def cells(self, film: Membrane) -> np.ndarray:
        """Local triangles (owned and ghost) of one of its films that bound the chamber."""

    @abstractmethod
    def requires(self) -> Iterable[Any]:
        """The bodies that join the scene with the chamber."""

    @abstractmethod
    def compile(self, system: Assembly, geometry: Geometry) -> CompiledEnclosure:
        """The enclosure in a running scene; `geometry` has what several enclosures share."""


class FilmEnclosure(Enclosure):
    """The volume inside a film and the strips over its rings: V = ⅓∫x·n dA, n the deformed area
    vector.

    `surface` names the groups of triangles that bound the chamber, empty for the whole film.  The
    normals may all point inwards: the compiled enclosure finds that by the sign of V at the start.
    The volume of a flat film is round-off; then the normals of the mesh count as outward.
    """

    def __init__(
        self, film: Membrane, surface: tuple[str, ...], rings: tuple[Ring, ...], chamber: str
    ) -> None:
        self.film = film
        self.surface = surface
        self.rings = rings
        self.chamber = chamber
        for ring in rings:
            check(
                ring.body is film,
                f"Chamber '{chamber}': "
                f"its ring '{ring.edges}' is on another film than '{film.name}'.",
            )

    @property
    def films(self) -> Sequence[Membrane]:
        """The film that bounds the chamber."""
        return (self.film,)

    @property
    def whole_films(self) -> Sequence[Membrane]:
        """The film, if all of it bounds the chamber."""
        return () if self.surface else (self.film,)

    def requires(self) -> Iterable[Any]:
        yield self.film

    def compile(self, system: Assembly, geometry: Geometry) -> CompiledEnclosure:
        """The volume inside the film in a running scene.  Collective.  `InputError`: the surface is
        open, its normals are not consistent, or one of several components is inside out."""
        loops = [geometry.loop(ring) for ring in self.rings]
        cells = self.cells(self.film)
        signs = self.check_closed(cells, loops)
        # Each triangle is integrated by the rank that owns it.
        owned = cells[cells < self.film.mesh.domain.topology.index_map(2).size_local]
        # A component that a ring closes has no separate volume.
        if not loops:
            self._check_components(cells, system)
        sides: list[Side] = [(Triangles(self.film, owned), 1.0)]
        sides += [(loop.patches(), sign) for loop, sign in zip(loops, signs, strict=True)]
        return CompiledSurface(geometry.surfaces, sides)

    def _check_components(self, cells: np.ndarray, system: Assembly) -> None:
        """Refuse a surface of several components that are not connected, one of which has its
        normals on the other side than the largest one.  Collective."""
        labels = label_components(self.film.mesh.edges, cells)
        lowest = self.film.comm.allreduce(float(labels.min(initial=np.inf)), op=MPI.MIN)
        has_several = bool((labels != lowest).any())
        if not self.film.comm.allreduce(has_several, op=MPI.LOR):
            return
        x = fem.Function(self.film.space)
        self.film.reconstruct(x, system.initial[self.film].positions().ravel())
        check_normals(self.film, self.chamber, cells, labels, x.x.array.reshape(-1, 3))

    def cells(self, film: Membrane) -> np.ndarray:
        """Return the local triangles (n,) of the bounding surface, owned and ghost, in rising
        order."""
        user = f"Chamber '{self.chamber}' of '{self.film.name}'"
        return named_triangles(self.film, self.surface, user)

    def check_closed(self, cells: np.ndarray, loops: list[Loop]) -> list[float]:
        """Check that triangles (n,), owned and ghost, and strips over rings form a closed surface,
        in which every edge has two triangles that pass it in opposite directions; otherwise raise
        `InputError`.

        Strips span the hole that a ring of edges leaves.  Returns for each of the loops, in the
        order of `rings`, the sign, +1 or -1, with which its strips close the surface.  Collective.
        """
        comm = self.film.comm
        table = self.film.mesh.edges
        # Number of triangles at each owned edge, and sum of the directions (±1) in which they pass
        # it
        count, sum_of_directions = table.tally(cells)
        open_edges = np.flatnonzero(count == 1)
        end_vertices = table.ends[open_edges]
        signs = []
        for ring, loop in zip(self.rings, loops, strict=True):
            passed = loop.line.directions(end_vertices)
            film_directions = passed * sum_of_directions[open_edges]
            own_sums = np.array([np.count_nonzero(passed), film_directions.sum()])
            found, film_direction = comm.allreduce(own_sums)
            check(
                found == len(loop.line.nodes),
                f"Chamber '{self.chamber}': "
                f"its ring '{ring.edges}' is not a boundary of its surface; "
                "give the groups of triangles on one side of it.",
            )
            # The strips pass the edges of the ring against the film, as a neighbour triangle would.
            sign = -float(np.sign(film_direction))
            signs.append(sign)
            on_ring = passed != 0
            spanned = open_edges[on_ring]
            count[spanned] += 1
            sum_of_directions[spanned] += sign * passed[on_ring]
        check_on_all(
            comm,
            bool(((count == 0) | (count == 2)).all()),
            f"Chamber '{self.chamber}': the surface of '{self.film.name}' is open; close it, "
            "name the groups of triangles that bound the chamber, or span holes by rings.",
        )
        check_on_all(
            comm,
            bool((sum_of_directions == 0).all()),
            f"Chamber '{self.chamber}': "
            f"neighbouring triangles of '{self.film.name}' have opposite normals; "
            "make or read its mesh with orient=True, or turn surfaces (gmsh: model.mesh.reverse).",
        )
        return signs


class CompiledSurface:
    """The surface of one chamber in a running scene, with triangles of films and strips over rings
    and seams."""

    def __init__(self, surfaces: ChamberSurfaces, sides: Sequence[Side]) -> None:
        """Add the chamber to the surfaces of the scene, which are evaluated together."""
        self._surfaces = surfaces
        self._index = surfaces.add(sides)

    # Made when they are first asked for: the surfaces are compiled after all chambers are added.

    @cached_property
    def measures(self) -> Array:
        return self._surfaces.measures[:, self._index]

    @cached_property
    def pressure(self) -> Array:
        return self._surfaces.pressures[self._index : self._index + 1]

    @cached_property
    def at_middle(self) -> Array:
        return self._surfaces.at_middle[self._index]

    @cached_property
    def of_volume(self) -> Array:
        return self._surfaces.at_end[self._index]

    @property
    def of_swept(self) -> Array:
        return self._surfaces.of_swept(self._index)

    def start(self) -> None:
        """Choose the sign of the volume, so that a surface with inward normals encloses a positive
        one."""
        # A flat film has a volume of either sign by round-off; it must not be turned by that.
        self._surfaces.orient(self._index, ROUND_OFF * self.measures[1])


@check_arguments
class Piston(Enclosure):
    """The volume A n·(x - x0) that a point of a body sweeps from x0, where the body was made.

    Args:
        port: a point of a body, its position x.
        area: A [m²], > 0.
        direction: n, the direction in which the volume grows; need not be of unit length.

    Raises:
        InputError: the area is not positive, the direction has no length, or the port is one.

    Example:
        >>> piston = gx.gas.Piston(mass.port(), area=0.01, direction=(1.0, 0.0, 0.0))
        >>> cylinder = gx.Chamber(
        ...     piston, gas=air, pressure=1e5, temperature=300.0, dead_volume=2e-3
        ... )
    """

    def __init__(
        self,
        port: PointPort,
        area: Annotated[float, positive("m²")],
        *,
        direction: Direction,
    ) -> None:
        self.port = port
        self.area = area
        self.direction = unit(direction)

    @property
    def films(self) -> Sequence[Membrane]:
        """Empty: a piston has no film."""
        return ()

    @property
    def whole_films(self) -> Sequence[Membrane]:
        """Empty: a piston has no film."""
        return ()

    def cells(self, film: Membrane) -> np.ndarray:
        """An empty array: a piston has no film."""
        return np.zeros(0, dtype=np.int32)

    def requires(self) -> Iterable[Any]:
        yield self.port.body

    def compile(self, system: Assembly, geometry: Geometry) -> CompiledEnclosure:
        """The enclosure in a running scene."""
        compiled = _CompiledPiston(self, system)
        geometry.add(compiled)
        return compiled


class _CompiledPiston(Moving):
    """A piston in a running scene; its volume is linear in the coordinates, so G is constant."""

    def __init__(self, piston: Piston, system: Assembly) -> None:
        """Compute the gradient of the volume, area times direction [m²], in this rank's
        unknowns."""
        self._system = system
        indices, P, _ = attach(system.numbering, system.bodies, (piston.port,))
        entries = piston.area * piston.direction @ P
        start, end = system.q0.getOwnershipRange()
        mine = (indices >= start) & (indices < end)
        self._gradient = np.zeros(end - start)
        np.add.at(self._gradient, indices[mine] - start, entries[mine])
        self.at_middle = self.of_volume = self.of_swept = self._gradient
        self._piston = piston
        self._origin = 0.0
        self.pressure = np.zeros(1)
        self.measures = np.zeros(3)

    def start(self) -> None:
        piston = self._piston
        # Not at q1: a scene that starts from another one has displaced volume already.
        made = piston.port.evaluate(self._system.initial.made(piston.port.body))
        self._origin = float(piston.area * piston.direction @ made)

    def _height(self, q: PETSc.Vec) -> float:
        """A n·x [m³] at coordinates q, the same on every rank.  Collective."""
        return float(self._system.comm.allreduce(float(self._gradient @ q.array_r)))

    def follow(self) -> None:
        """Compute the volumes [m³] of the present step."""
        end = self._height(self._system.q1)
        start = self._height(self._system.q0)
        self.measures[:] = (end - self._origin, abs(end) + abs(self._origin), end - start)

    def add_forces(self, values: Array) -> None:
        # G is constant: the tangent has no share, as the force depends on the pressure only.
        values -= self.pressure * self._gradient

    def accept(self) -> None:
        # `follow` reads q0 from the system: there is nothing to store.
        pass


# ---- connected components ------------------------------------------------------------------------

Cells = npt.NDArray[np.int32]

# A volume below this share of the sum of its terms' sizes is round-off: a flat component has no
# inside.
FLAT = 1e-9


@dataclass(frozen=True)
class _Component:
    """Signed volume [m³] of the cones from the origin to the triangles of one component of a
    surface, or of what one rank has of it; the sum of their absolute volumes [m³], the scale of
    round-off; and the corners (3,) [m] of the bounding box."""

    volume: float
    size: float
    low: Array
    high: Array

    def merged(self, other: _Component) -> _Component:
        """The component that consists of both."""
        return _Component(
            volume=other.volume + self.volume,
            size=other.size + self.size,
            low=np.minimum(other.low, self.low),
            high=np.maximum(other.high, self.high),
        )

    def is_within(self, other: _Component) -> bool:
        """Whether the bounding box is strictly inside that of another component."""
        is_above = bool((self.low > other.low).all())
        is_below = bool((self.high < other.high).all())
        return is_above and is_below


def label_components(table: EdgeTable, cells: Cells) -> Array:
    """Number the connected components of a surface of local triangles (n,), owned and ghost, in
    rising order: the number (n,) of each triangle's component, the same on all ranks.  Collective.

    Each rank gives each component of its triangles, ghosts included, the lowest number of a
    triangle in it.  Ranks exchange these numbers until none changes.
    """
    # Imported here, as a scene without chambers of films does not need it.
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    topology = table.domain.topology
    index_map = topology.index_map(2)
    comm = table.domain.comm
    local_count = index_map.size_local + index_map.num_ghosts

    # Triangles of the surface are connected by the edges that they share.  (The table has two
    # triangles of an edge; where chambers share a wall there are three.)
    edges = topology.connectivity(2, 1).array.reshape(-1, 3)[cells].ravel()
    entries = (np.ones(len(edges), dtype=np.int8), (np.repeat(cells, 3), local_count + edges))
    size = local_count + len(table.count)
    graph = coo_array(entries, shape=(size, size))
    count, component = connected_components(graph, directed=False)
    component = component[:local_count]

    local_cells = np.arange(local_count, dtype=np.int32)
    labels = la.vector(index_map)
    labels.array[:] = index_map.local_to_global(local_cells)
    # A number passes one rank in each round, so there are at most as many rounds as ranks along a
    # component.
    while True:
        lowest = np.full(count, np.inf)
        np.minimum.at(lowest, component, labels.array)
        has_changed = bool((labels.array != lowest[component]).any())
        labels.array[:] = lowest[component]
        labels.scatter_forward()
        if not comm.allreduce(has_changed, op=MPI.LOR):
            return labels.array[cells].copy()


def check_normals(film: Membrane, chamber: str, cells: Cells, labels: Array, x: Array) -> None:
    """Raise `InputError` unless the components of a closed surface have their normals on the same
    side.  Collective.

    A component inside another one may be a hollow, whose normals then point into it; only
    components that are not inside another one, by their bounding boxes, are compared with the
    largest of them.  Flat components, of a volume below 1e-9 of the sum of its terms' sizes, are
    not examined.  `labels` (n,) are those of `label_components`, x (m, 3) [m] initial positions of
    the film's local nodes.
    """
    owned = film.mesh.domain.topology.index_map(2).size_local
    is_owned = cells < owned
    corners = x[cell_nodes(film.space)[cells[is_owned], :3]]
    terms = np.einsum("ij,ij->i", corners.mean(axis=1), area_vectors(corners)) / 3
    owned_labels = labels[is_owned]
    mine = {}
    for label in np.unique(owned_labels):
        is_of_component = owned_labels == label
        points = corners[is_of_component].reshape(-1, 3)
        mine[label] = _Component(
            volume=terms[is_of_component].sum(),
            size=abs(terms[is_of_component]).sum(),
            low=points.min(axis=0),
            high=points.max(axis=0),
        )

    # Ranks exchange one entry for each component, not one for each triangle.
    components: dict[float, _Component] = {}
    for share in film.comm.allgather(mine):
        for label, component in share.items():
            if label in components:
                components[label] = components[label].merged(component)
            else:
                components[label] = component

    solid = [one for one in components.values() if abs(one.volume) > FLAT * one.size]
    outer = [one for one in solid if not any(one.is_within(other) for other in solid)]
    # The largest component is taken to be right.
    outer.sort(key=lambda one: -abs(one.volume))
    for one in outer[1:]:
        if one.volume * outer[0].volume < 0:
            middle = ", ".join(f"{value:.4g}" for value in (one.low + one.high) / 2)
            raise InputError(
                f"Chamber '{chamber}': "
                f"one of the {len(components)} components of '{film.name}' is inside out, "
                f"the one about ({middle}) m, "
                f"whose volume of {abs(one.volume):.4g} m³ would be subtracted from the others; "
                "turn its normals (gmsh: model.mesh.reverse)."
            )
