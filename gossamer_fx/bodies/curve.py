"""What cables and beams have in common: a mesh of line elements in space."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh as DolfinxMesh

from gossamer_fx.bodies.ports import global_node, interpolated, local_nodes
from gossamer_fx.errors import check
from gossamer_fx.mesh import Mesh
from gossamer_fx.parts import Array, Block, Part, Port


class Curve(ABC):
    """A body on line elements: `size` numbers a node, Lagrange elements of an `order`."""

    def __init__(self, kind: str, name: str, mesh: Mesh | DolfinxMesh, order: int, size: int) -> None:
        self.mesh = mesh if isinstance(mesh, Mesh) else Mesh(mesh)
        domain = self.mesh.domain
        check(
            domain.topology.dim == 1 and domain.geometry.dim == 3,
            f"{kind} '{name}': the mesh has cells of dimension {domain.topology.dim} in {domain.geometry.dim}-D space; "
            "give line elements in 3-D.",
        )
        self.name, self.comm, self.order = name, domain.comm, order
        self.space = fem.functionspace(domain, ("Lagrange", order, (size,)))
        self.block = Block(self.space.dofmap.index_map, size)
        # the strain of the element is taken where it does not lock
        self.dx = ufl.Measure("dx", domain, metadata={"quadrature_degree": max(2 * (order - 1), 1)})
        self.mass_dx = ufl.Measure("dx", domain, metadata={"quadrature_degree": 2 * order})

    @abstractmethod
    def initial_state(self) -> tuple[Array, Array]:
        """Owned coordinates [m] and velocities [m/s], flattened, node by node."""

    @abstractmethod
    def parts(self) -> Iterable[Part]:
        """The body's own roles."""

    def describe(self, node: int) -> str:
        x, y, z = self.space.tabulate_dof_coordinates()[node]
        return f"at the node ({x:.6g}, {y:.6g}, {z:.6g}) m of the mesh"

    def nodes(self, group: str) -> np.ndarray:
        """Local nodes (owned and ghost) of a named group of the mesh."""
        return local_nodes(self.space, self.mesh, group)

    def port(self, group: str) -> Port:
        """The node of a named point of the mesh."""
        return Port(self, (global_node(self, self.mesh, group),))

    def port_at(self, point: Sequence[float]) -> Port:
        """The point that is at `point` [m] of the mesh, also between nodes."""
        return interpolated(self, point)
