"""Bodies as the system sees them, and the ports by which others are attached to them.

A body brings coordinates (a `Block` of unknowns) and an initial state.  Terms on a mesh are written
in UFL; terms between points are written in NumPy and see bodies through `Port`s only.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Any, TypeGuard

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.common import IndexMap
from mpi4py import MPI

from gossamer_fx.core.checks.arguments import Count, Mark, check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.item import Item

Array = npt.NDArray[np.floating]
# dolfinx numbers the nodes of a rank by 32 bits.
Indices = npt.NDArray[np.int32]
# Three numbers, as a tuple, a list or an array.
Vector = Annotated[Sequence[float], Count(3)]


@dataclass(frozen=True)
class Block:
    """Coordinates of one body: `index_map` distributes nodes, each with `size` numbers (a multiple
    of 3: vectors).

    The vectors of a node are positions (3), or a position and directors (6, 9, 12): linear momentum
    counts the first.
    """

    index_map: IndexMap
    size: int


class Body(Item, ABC):
    """An item with coordinates.

    Attributes:
        name: in messages and outputs.
        comm: of the ranks that share it.
        block: its unknowns.
    """

    comm: MPI.Intracomm
    block: Block

    @abstractmethod
    def initial_state(self) -> tuple[Array, Array]:
        """Owned coordinates [m] and velocities [m/s], flattened, node by node; not to be written
        to."""

    @abstractmethod
    def describe(self, node: int) -> str:
        """Where an owned node is, in words, for messages."""


class MeshBody(Body):
    """A body discretised on a mesh: its coordinates are functions of a Lagrange space.

    Attributes:
        space: of the coordinates.
    """

    space: fem.FunctionSpace

    @property
    def full(self) -> MeshBody:
        """The body itself; of a reduced body the one that was reduced, whose nodes have
        positions."""
        return self

    @abstractmethod
    def reconstruct(self, function: fem.Function, unknowns: Array) -> None:
        """Set a function on `full.space`, ghosts included, from this rank's unknowns."""

    @abstractmethod
    def coordinates(self, alpha: float) -> Any:
        """The functions of its forms and how they follow from its unknowns, a
        `terms.coordinates.Coordinates`, for a stress rule whose forces act at q_mid = (1 - α) q0 +
        α q1."""


def has_nodal_unknowns(body: Body) -> TypeGuard[MeshBody]:
    """Whether a body's unknowns are the coordinates of the nodes of its mesh."""
    return (
        isinstance(body, MeshBody)
        and body.block.index_map.size_global == body.space.dofmap.index_map.size_global
    )


WITH_NODES = Mark(has_nodal_unknowns, "an unreduced film, cable or beam")
NodalBody = Annotated[MeshBody, WITH_NODES]


@check_arguments
@dataclass(frozen=True, eq=False)
class Port:
    """A vector attached to a body: Σ_k weights[k] q[nodes[k], vectors[k]], linear in its
    coordinates q.

    With weights of sum 1 on positions it is a point of the body.  Bodies return ports, e.g.
    `film.point` and `hub.port`.

    Args:
        body: to which the vector is attached.
        nodes: global indices of nodes of the body's block.
        weights: one for each node.
        vectors: which vector of each node is meant: 0 the position (default), 1, 2, ... the
            directors.

    Example:
        >>> middle = gx.Port(cable, (0, 1), weights=(0.5, 0.5))
        >>> middle.weights
        (0.5, 0.5)
    """

    body: Body
    nodes: tuple[int, ...]
    _: KW_ONLY
    weights: tuple[float, ...] = (1.0,)
    vectors: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        """Refuse nodes and vectors that the body does not have, and other numbers of them."""
        check(
            len(self.weights) == len(self.nodes),
            f"A port of '{self.body.name}' has {len(self.nodes)} nodes and {len(self.weights)} "
            "weights; give a weight for each node.",
        )
        count = self.body.block.index_map.size_global
        check(
            all(0 <= node < count for node in self.nodes),
            f"A port of '{self.body.name}' has the nodes {self.nodes}; "
            f"its nodes are 0 to {count - 1}.",
        )
        last = self.body.block.size // 3 - 1
        check(
            len(self.vectors) in (0, len(self.nodes)) and all(0 <= k <= last for k in self.vectors),
            f"A port of '{self.body.name}' has {len(self.nodes)} nodes and the vectors "
            f"{self.vectors}; give one for each node, 0 to {last}.",
        )

    def evaluate(self, unknowns: Array) -> Array:
        """The vector (3,) of the port, Σ_k weights[k] q[nodes[k], vectors[k]]: a point [m] or a
        director [-].

        Collective; the same on every rank.

        Args:
            unknowns: coordinates q [m or -] of the nodes that this rank owns, flattened; or their
                rates, of which the rate of the vector is returned.
        """
        block = self.body.block
        start, end = block.index_map.local_range
        nodes = np.array(self.nodes)
        weights = np.array(self.weights)
        # Without vectors all of them are positions.
        vectors = np.array(self.vectors or (0,) * len(nodes))
        # Each node is owned by one rank, so that the sum over ranks is the vector.
        mine = (nodes >= start) & (nodes < end)
        per_node = unknowns.reshape(-1, block.size // 3, 3)
        share = weights[mine] @ per_node[nodes[mine] - start, vectors[mine]]
        return np.asarray(self.body.comm.allreduce(share))

    def initial(self) -> Array:
        """The vector (3,) in the initial state that the body has by itself, outside of any
        scene."""
        return self.evaluate(self.body.initial_state()[0])

    def initial_rate(self) -> Array:
        """The rate (3,) of the vector in the initial state that the body has by itself."""
        return self.evaluate(self.body.initial_state()[1])


@check_arguments
@dataclass(frozen=True)
class Ground:
    """A constant vector of inertial space: a point [m] or a direction.

    Args:
        vector: its components, (3,).

    Example:
        >>> hook = gx.Ground((0.0, 0.0, 2.0))
        >>> gx.connectors.Spring(mass.port(), hook, stiffness=100.0, length=1.0).stiffness
        100.0
    """

    vector: tuple[float, float, float]

    def initial(self) -> Array:
        """The vector (3,) itself."""
        return np.array(self.vector, dtype=float)

    def initial_rate(self) -> Array:
        """Zero (3,): it does not move."""
        return np.zeros(3)


# What connectors, constraints and point loads act on.
Attached = Port | Ground


def unit(direction: Vector | Array) -> Array:
    """The vector (3,) of length one in a direction (3,), which is not zero."""
    n = np.asarray(direction, dtype=float)
    # The largest component becomes 1: squares of tiny ones vanish, those of huge ones overflow.
    n = n / abs(n).max()
    return n / np.linalg.norm(n)


def combine(weights: Sequence[float], ports: Sequence[Attached]) -> Attached:
    """The linear combination Σ_k weights[k] ports[k] of ports of one body, or of the ground; ports
    of several bodies, or of a body and of the ground, raise `InputError`."""
    if all(isinstance(port, Ground) for port in ports):
        vectors_of_ground = np.array([port.initial() for port in ports])
        x, y, z = np.asarray(weights) @ vectors_of_ground
        return Ground((float(x), float(y), float(z)))
    # The first one exists: not all are of the ground.
    body = next(port.body for port in ports if isinstance(port, Port))
    nodes: list[int] = []
    node_weights: list[float] = []
    vectors: list[int] = []
    for weight, port in zip(weights, ports, strict=True):
        is_of_body = isinstance(port, Port) and port.body is body
        check(is_of_body, "Only ports of one body can be combined.")
        assert isinstance(port, Port)
        nodes += port.nodes
        node_weights += [weight * each for each in port.weights]
        # A port without vectors means the positions of its nodes.
        vectors += port.vectors or (0,) * len(port.nodes)
    return Port(
        body,
        tuple(nodes),
        weights=tuple(node_weights),
        vectors=tuple(vectors),
    )
