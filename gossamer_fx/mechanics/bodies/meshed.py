"""What films, cables and beams have in common: named groups of a mesh, ports at its nodes and
between them, motions given as functions."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import ufl
from dolfinx import fem, geometry
from dolfinx.mesh import Mesh as DolfinxMesh
from mpi4py import MPI

from gossamer_fx.core.checks.arguments import check_arguments, collective
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.user_functions import ask_points
from gossamer_fx.core.forms.backend import geometry_element, geometry_nodes
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.mesh.mesh import Mesh
from gossamer_fx.core.mesh.quality import extent
from gossamer_fx.core.model.body import Array, Block, MeshBody, Port, Vector
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.terms.coordinates import Coordinates

if TYPE_CHECKING:
    from gossamer_fx.mechanics.materials.thermal import ThermalExpansion
    from gossamer_fx.mechanics.terms.element_energies import DiscreteDerivative
    from gossamer_fx.mechanics.terms.thermal_strain import ThermalStrain

PointFunction = Callable[[Array], Array]  # of points (3, n), returns (3, n)

# What messages call cells of one and two dimensions.
CELLS = {1: "line elements", 2: "triangles"}

# Shape functions below this value count as zero: a point on an edge of a cell depends on the nodes
# of that edge only, and then on fewer unknowns.
ZERO_WEIGHT = 1e-12

# Relative difference of distances from two nodes that counts as round-off.
NODE_ROUND_OFF = 1e-9

# Distance of a point from the mesh, over the size of the mesh, up to which it is on it.
ON_MESH = 1e-6


class Meshed(MeshBody):
    """A body on a mesh.  Making one is collective."""

    mesh: Mesh
    # Of its law or section, as coefficients of forms
    constants: SimpleNamespace

    bends = False  # whether it is a film with bending stiffness
    # Of its strains, if they are not quadratic in the coordinates
    discrete_derivative: DiscreteDerivative | None = None

    def _take_mesh(
        self, name: str, mesh: Mesh | DolfinxMesh, order: int, *, size: int, dim: int
    ) -> None:
        """Check that the mesh has cells of this dimension in space, and make the space of the
        coordinates, `size` numbers a node, and the measures.  Collective."""
        self.name = name
        self.mesh = mesh if isinstance(mesh, Mesh) else Mesh(mesh)
        domain = self.mesh.domain
        check(
            domain.topology.dim == dim and domain.geometry.dim == 3,
            f"{self._title}: the mesh has cells of dimension {domain.topology.dim} "
            f"in {domain.geometry.dim}-D space; give {CELLS[dim]} in 3-D.",
        )
        self.comm = domain.comm
        self.order = order
        self.space = fem.functionspace(domain, ("Lagrange", order, (size,)))
        self.block = Block(self.space.dofmap.index_map, size)
        # The degree of squared gradients: in a beam two Gauss points, where nothing locks.
        degree = max(2 * (order - 1), 1)
        self.dx = ufl.Measure("dx", domain, metadata={"quadrature_degree": degree})
        self.mass_dx = ufl.Measure("dx", domain, metadata={"quadrature_degree": 2 * order})

    def surface_measure(self, degree: int) -> ufl.Measure:
        """The measure [m²] of loads on the faces of a film, for integrands of a degree."""
        return ufl.Measure("dx", self.space.mesh, metadata={"quadrature_degree": degree})

    def _take_expansion(self, thermal: ThermalExpansion | None) -> None:
        """Set the thermal expansion, which must fit the constants of the body."""
        self.thermal = thermal
        if thermal is not None:
            # Imported here: a body without thermal expansion does not load it.
            from gossamer_fx.mechanics.bodies.thermal_expansion import check_expansion

            has_axes = hasattr(self.constants, "cosine")
            check_expansion(thermal, self._title, has_axes=has_axes, bends=self.bends)

    def thermal_strain(self) -> ThermalStrain | None:
        """The thermal strain of the body for one compiled scene; None without thermal expansion.
        Collective."""
        if self.thermal is None:
            return None
        from gossamer_fx.mechanics.bodies.thermal_expansion import thermal_strain

        return thermal_strain(self, self._free_strain, self._title)

    @abstractmethod
    def _free_strain(self, alphas: tuple[Expr, ...], ΔT: Expr) -> Expr:
        """Strains of a free piece whose temperature changes by ΔT [K], with its coefficients of
        expansion [1/K]."""

    @property
    def _title(self) -> str:
        """What messages call the body."""
        return f"{type(self).__name__} '{self.name}'"

    @cached_property
    @abstractmethod
    def _start(self) -> tuple[Array, Array]:
        """Owned coordinates [m] and velocities [m/s], flattened, node by node: the user's functions
        are asked once."""

    def initial_state(self) -> tuple[Array, Array]:
        return self._start

    @abstractmethod
    def terms(self, start: State) -> Iterable[Term]: ...

    @property
    def full(self) -> Meshed:
        """The body itself: its unknowns are the coordinates of its nodes."""
        return self

    def reconstruct(self, function: fem.Function, unknowns: Array) -> None:
        function.x.array[: len(unknowns)] = unknowns
        function.x.scatter_forward()

    def coordinates(self, alpha: float) -> Coordinates:
        return Coordinates(self.space, alpha)

    def describe(self, node: int) -> str:
        x, y, z = self.space.tabulate_dof_coordinates()[node]
        return f"at the node ({x:.6g}, {y:.6g}, {z:.6g}) m of the mesh"

    @check_arguments
    def nodes(self, group: str) -> np.ndarray:
        """Local nodes (owned and ghost) of a named group of the mesh."""
        dim, entities = self.mesh.group(group, f"'{self.name}'")
        topology = self.mesh.domain.topology
        topology.create_connectivity(dim, topology.dim)
        return fem.locate_dofs_topological(self.space, dim, entities)

    @check_arguments
    @collective
    def port(self, group: str) -> Port:
        """The node of a named point of the mesh."""
        return Port(self, (global_node(self, group),))

    @check_arguments
    @collective
    def ports(self, group: str) -> list[Port]:
        """All nodes of a named group of the mesh, e.g. for a `Force` on each.  Collective."""
        return [Port(self, (node,)) for node in global_nodes(self, group)]

    @check_arguments
    @collective
    def port_at(self, point: Vector, *, snap: bool = False) -> Port:
        """The point that is at `point` [m] of the mesh, also between nodes; with `snap` the node
        that is nearest to it.  Collective."""
        return nearest_node(self, point) if snap else interpolated(self, point)


def checked(function: PointFunction | None, what: str, comm: MPI.Intracomm) -> PointFunction | None:
    """`checked_function` of a function that may be absent: None stays None."""
    if function is None:
        return None
    return checked_function(function, what, comm)


def checked_function(function: PointFunction, what: str, comm: MPI.Intracomm) -> PointFunction:
    """The function, with a check on all ranks of what it returns; each rank calls it with its own
    points.  `what` is the subject of the messages."""

    return lambda points: ask_points(comm, what, lambda: function(points), points.shape)


def positions(
    space: fem.FunctionSpace, displacement: PointFunction | None, velocity: PointFunction | None
) -> tuple[Array, Array]:
    """Positions [m] and velocities [m/s] (3 n,) of the n nodes that this rank owns, node by node,
    at the start.  Without a displacement they are those of the mesh, without a velocity the body is
    at rest.  `space` is the Lagrange space of the coordinates.  Collective."""
    # x, v, u: functions of position, velocity and displacement; X: points (3, n).
    x = fem.Function(space)
    v = fem.Function(space)
    # The mesh itself, at the nodes of the space: between its vertices where the order is 2.
    x.interpolate(lambda X: X)
    if displacement is not None:
        u = fem.Function(space)
        u.interpolate(displacement)
        # Added as vectors: the user's function is asked for displacements at the nodes only.
        x.x.array[:] += u.x.array
    if velocity is not None:
        v.interpolate(velocity)
    owned = space.dofmap.index_map.size_local * 3
    return x.x.array[:owned].copy(), v.x.array[:owned].copy()


def global_node(body: Meshed, group: str) -> int:
    """Global number of the one node of a named point of the mesh.  Collective."""
    found = global_nodes(body, group)
    check(
        len(found) == 1,
        f"Group '{group}' of '{body.name}' has {len(found)} nodes; a port is one point.",
    )
    return found[0]


def global_nodes(body: Meshed, group: str) -> list[int]:
    """Global numbers of the nodes of a named group of the mesh, ascending.  Collective."""
    nodes = body.nodes(group)
    index_map = body.block.index_map
    # Each node is counted once, by its owner.
    owned = nodes[nodes < index_map.size_local]
    found: list[int] = []
    for part in body.comm.allgather(index_map.local_to_global(owned).tolist()):
        found += part
    return sorted(found)


def nearest_node(body: MeshBody, point: Sequence[float]) -> Port:
    """The node of a body that is nearest to coordinates (3,) [m] of its mesh; of nodes at the same
    distance the first one by x, then by y and z.  Collective."""
    index_map = body.block.index_map
    nodes = body.space.tabulate_dof_coordinates()[: index_map.size_local]
    distances = np.linalg.norm(nodes - np.asarray(point, dtype=float), axis=1)
    # A rank without nodes is infinitely far away.
    nearest = (np.inf, (0.0, 0.0, 0.0), -1)
    if len(nodes):
        # Distances that differ by round-off are equal.
        candidates = np.flatnonzero(distances <= distances.min() * (1 + NODE_ROUND_OFF))
        first = min(candidates, key=lambda node: tuple(nodes[node]))
        number = int(index_map.local_to_global(np.array([first], dtype=np.int32))[0])
        nearest = (float(distances[first]), tuple(nodes[first]), number)
    found = body.comm.allgather(nearest)
    least = min(distance for distance, _, _ in found)
    equal = [one for one in found if one[0] <= least * (1 + NODE_ROUND_OFF)]
    _, _, node = min(equal, key=lambda one: one[1])
    return Port(body, (node,))


def interpolated(body: MeshBody, point: Sequence[float]) -> Port:
    """The point of a body at coordinates (3,) [m] of its mesh, also between nodes, as the weighted
    sum of the nodes of the cell around it.  A point that is further than `ON_MESH` from the mesh
    raises `InputError`.  Collective."""
    mesh = body.space.mesh
    x = np.asarray(point, dtype=float)
    cell, distance = _closest_cell(mesh, x)
    # Of ranks at the same distance, the lowest one: a point between two ranks belongs to one of
    # them.
    nearest, rank = body.comm.allreduce((distance, body.comm.rank), op=MPI.MIN)
    check(
        nearest <= ON_MESH * extent(mesh),
        f"The point {x.tolist()} m is {nearest:.3g} m away from '{body.name}'; "
        "give a point of its mesh, or snap=True for the node that is nearest.",
    )
    found = None
    if body.comm.rank == rank:
        found = _weights(body, cell, x)
    nodes, weights = body.comm.bcast(found, root=rank)
    return Port(body, nodes, weights=weights)


def _closest_cell(mesh: DolfinxMesh, x: np.ndarray) -> tuple[int, float]:
    """The cell of this rank that is closest to a point x (3,) [m], and its distance [m]; -1 and inf
    on a rank without cells.

    Boxes around all cells are compared with the point.  To make a tree of them takes nine times as
    long (ten thousand triangles), and one that is kept would be wrong after a mesh is moved."""
    tdim = mesh.topology.dim
    nodes = geometry_nodes(mesh)[: mesh.topology.index_map(tdim).size_local]
    if not len(nodes):
        return -1, np.inf
    # Node by node of the cells, which needs less memory than the corners of all cells.
    first, *others = (mesh.geometry.x[column] for column in nodes.T)
    low = first
    high = first
    for corner in others:
        low = np.minimum(low, corner)
        high = np.maximum(high, corner)
    box_distance = np.linalg.norm(np.maximum(low - x, x - high).clip(min=0.0), axis=1)
    # No cell farther than this is the closest one.
    limit = float(np.linalg.norm(first - x, axis=1).min())
    near = np.flatnonzero(box_distance <= limit * (1 + NODE_ROUND_OFF)).astype(np.int32)
    # The annotation of dolfinx is a list, but the function needs an array.
    cells: Any = near
    squared = geometry.squared_distance(mesh, tdim, cells, np.tile(x, (len(near), 1)))
    return int(near[squared.argmin()]), float(np.sqrt(squared.min()))


def _weights(body: MeshBody, cell: int, x: np.ndarray) -> tuple[tuple[int, ...], tuple[float, ...]]:
    """Global nodes of a cell, and their weights in the interpolation of a point x (3,) [m]; those
    below `ZERO_WEIGHT` are left out."""
    space: Any = body.space
    mesh = space.mesh
    corners = mesh.geometry.x[geometry_nodes(mesh)[cell]]
    reference = geometry_element(mesh).pull_back(x[None], corners)
    values = space.element.basix_element.tabulate(0, reference)[0, 0, :, 0]
    nodes = body.block.index_map.local_to_global(space.dofmap.cell_dofs(cell))
    is_kept = np.abs(values) > ZERO_WEIGHT
    kept_nodes = tuple(int(node) for node in nodes[is_kept])
    weights = tuple(float(value) for value in values[is_kept])
    return kept_nodes, weights
